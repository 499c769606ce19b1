"""Good logs of a slave and its master that were spoiled: what is said of each, in its own words."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.estimate import transfer
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import ByNoise
from foucault.models.rotation import angles_of, exp, matrix_of
from foucault.plans.transfer import transfer_profile
from foucault.procedures.transfer_alignment import simulate
from foucault.procedures.transfer_alignment.problem import problem_of
from foucault.procedures.transfer_alignment.session import moved, simulate_motion
from foucault.procedures.transfer_alignment.settings import SlaveLog
from foucault.result import Level
from foucault.simulate.noise import quantise
from make_transfer_campaign import LEVER, calibrated, described, faultless, made, missed, trial
from refusals import refuses
from sessions import codes, failed

DEG, ARCMIN, G = np.pi / 180, np.pi / 10800, 9.80665


@pytest.fixture(scope="module")
def flight():
    c = described()
    return c, made(c, 7)


@pytest.fixture(scope="module")
def bare():
    """A slave that holds nothing which could hide that a prior is wrong."""
    return made(faultless(), 7)


@pytest.fixture(scope="module")
def levered():
    """A slave 2.3 m from its master."""
    c = described(lever_arm=LEVER)
    return c, made(c, 2)


def said(flight, spoil, **changes):
    """Calibrate a spoiled pair; return the result."""
    c, session = flight
    settings = c.settings.model_copy(update=changes)
    return trial(c, spoil(session.simulation.log), settings=settings)


def told(result, code: str) -> str:
    """Return message and cure of the one finding of a code."""
    (one,) = [f for f in result.findings if f.code == code]
    return f"{one.message} {one.cure}"


def as_it_is(log):
    return log


def slave(**columns):
    """Return what changes gyro or accel of the slave."""
    return lambda log: replace(log, **{name: f(getattr(log, name)) for name, f in columns.items()})


def master(**columns):
    """Return what changes time, velocity_n or angles of the master."""

    def spoil(log):
        m, changed = log.messages, dict(columns)
        turned = changed.pop("angles", None)
        if turned is not None:
            changed["C_nb"] = lambda C: matrix_of(*turned(angles_of(C)).T)
        return replace(
            log, master=replace(m, **{name: f(getattr(m, name)) for name, f in changed.items()})
        )

    return spoil


def swapped(x):
    return x[:, [1, 0, 2]]


# -- what is given comes with its own words --------------------------------------------------------

SPOILED = [
    (slave(gyro=lambda w: w / DEG), "delay.scale", "the unit is deg/s and was declared as rad/s"),
    (slave(gyro=lambda w: w * DEG), "delay.scale", "the unit is rad/s and was declared as deg/s"),
    (slave(gyro=lambda w: w / 100), "delay.scale",
     "Of the slave probably increments were declared as rates."),
    (slave(gyro=lambda w: w * 100), "delay.scale",
     "Of the slave probably rates were declared as increments."),
    (slave(accel=lambda f: f / G), "transfer.force_size",
     "the unit is g and was declared as m/s^2."),
    (slave(accel=lambda f: f * G), "transfer.force_size",
     "the unit is m/s^2 and was declared as g."),
    (slave(accel=lambda f: f / 100), "transfer.force_size",
     "Probably increments were declared as rates."),
    (slave(accel=lambda f: f * 7), "transfer.force_size",
     "7.03 times the force that moves its master. Check the unit in [log.accel]"),
    (slave(accel=np.negative), "transfer.gravity", 'Write reads = "gravity" in [log.accel]'),
    (slave(accel=swapped), "transfer.force_axes", "if the accelerometers are taken as y, x, z"),
    (slave(accel=lambda f: f * [1, -1, 1]), "transfer.force_axes", "are taken as x, -y, z"),
    (slave(gyro=swapped), "transfer.mirror", "gyros x, y, z point along y, x, z"),
    (slave(gyro=lambda w: w * [1, 1, -1]), "transfer.mirror", "point along x, y, -z"),
    (slave(gyro=lambda w: swapped(w) * [1, 1, -1], accel=lambda f: swapped(f) * [1, 1, -1]),
     "transfer.mounting", "the order and the signs of the columns"),
    (master(angles=lambda a: a * [-1, 1, 1]), "transfer.sense",
     "as the master would if its heading counted the other way: 100 % of its turning"),
    (master(angles=lambda a: [90 * DEG, 0, 0] + a * [-1, 1, 1]), "transfer.sense",
     'Write sense = "counter-clockwise"'),
    (master(angles=lambda a: a * [1, 1, -1]), "transfer.sense", 'Write "-roll", or whatever'),
    (master(angles=lambda a: a * [1, -1, 1]), "transfer.force_velocity",
     "a pitch that counts the other way"),
    (master(angles=lambda a: a + np.array([np.pi, 0, 0])), "transfer.force_velocity",
     "a heading that is off by 180 deg"),
    (master(velocity_n=lambda v: swapped(v) * [1, 1, -1]), "transfer.force_velocity",
     'north, east, down for east, north, up'),
    (master(velocity_n=lambda v: v * [1, 1, -1]), "transfer.force_velocity", "down for up"),
    (master(velocity_n=lambda v: v * 3.6), "transfer.force_unit", "if they are km/h"),
    (master(velocity_n=lambda v: v / 0.514444), "transfer.force_unit", "if they are knots"),
]  # fmt: skip


def noticed(flight, spoil):
    """Return what is noticed before anything is filtered."""
    c, session = flight
    return problem_of(spoil(session.simulation.log), c.site, c.settings, c.noise, {}).findings


@pytest.mark.parametrize(("spoil", "code", "words"), SPOILED)
def test_a_mistake_is_named(flight, spoil, code: str, words: str) -> None:
    one = next(f for f in noticed(flight, spoil) if f.code == code)
    assert words in f"{one.message} {one.cure}"


def test_nobody_is_sent_elsewhere_for_a_wrong_column(flight) -> None:
    """Neither to velocity_sd and attitude_sd, nor to more passes or another lever arm."""
    for spoil in (
        slave(accel=swapped),
        slave(gyro=swapped),
        master(angles=lambda a: a * [-1, 1, 1]),
    ):
        result = said(flight, spoil)
        assert len(codes(result)) == 1
        assert result.verdict.reasons[0].startswith(result.findings[0].message)
        assert result.verdict.level is not Level.PASS


@pytest.mark.thorough
@pytest.mark.parametrize("profile", ["ship", "uav", "survey"])
def test_other_vehicles_name_them_too(profile: str) -> None:
    c = described(profile=f'"{profile}"')
    both = c, made(c, 3)
    assert not noticed(both, as_it_is)
    for spoil, code in (
        (slave(accel=np.negative), "transfer.gravity"),
        (slave(accel=swapped), "transfer.force_axes"),
        (master(velocity_n=swapped), "transfer.force_velocity"),
        (master(velocity_n=lambda v: v * 3.6), "transfer.force_unit"),
    ):
        assert [f.code for f in noticed(both, spoil)] == [code]


@pytest.mark.thorough
@pytest.mark.parametrize("away", [1.0, -0.3])
def test_clocks_that_differ(flight, away: float) -> None:
    result = said(flight, master(time=lambda t: t + away))
    words = told(result, "transfer.outside")
    assert f"The delay is {1e3 * away + 100:.1f} ms, and was looked for from 0 to 200.0 ms" in words
    assert "A negative delay means clocks that differ" in words
    assert "transfer.at_validity" not in codes(result)
    assert "delay" in failed(result)


def test_a_mounting_of_some_degrees_is_no_wrong_column() -> None:
    c = described(installation_sd='"2 deg"')
    assert not noticed((c, made(c, 1)), as_it_is)


# -- time ------------------------------------------------------------------------------------------


def test_clocks_that_drift_a_little(flight) -> None:
    """3 ppm of a straight line over the log are 0.7 ms: told as soon as they are seen."""
    c = described(message_rate='"20 Hz"', profile='"uav"')
    both = c, made(c, 1)
    (one,) = noticed(both, master(time=lambda t: t * (1 - 3e-6)))
    assert re.match(r"The clock of the stamps gains -(2|3)\.\d ± 0\.\d ppm on the slave's, "
                    r"-0\.[678] ms over the log; this was taken out\.", one.message)  # fmt: skip
    assert not noticed(both, as_it_is)


def test_stamps_that_do_not_rise(flight) -> None:
    back = slave(time=lambda t: np.where(t > 90.0, t - 3.0, t))
    with refuses("transfer.backwards") as caught:
        said(flight, back)
    assert "1 stamps of the slave are not after the one before, the first at 87.01 s" in (
        caught.value.message
    )
    twice = slave(time=lambda t: np.where(np.arange(len(t)) == 9000, t - 0.01, t))
    with pytest.raises(FoucaultError, match=r"the first at 89\.99 s"):
        said(flight, twice)
    with refuses("master.time"):
        said(flight, master(time=lambda t: np.where(t > 100.0, t - 20.0, t)))


def test_a_slave_that_lost_samples(flight) -> None:
    def lost(log, rows):
        kept = np.setdiff1d(np.arange(len(log)), rows)
        return replace(log, time=log.time[kept], gyro=log.gyro[kept], accel=log.accel[kept])

    result = said(flight, lambda log: lost(log, [3000, 8000, 8001, 20000]))
    assert "Gaps were bridged, 3 in all, the longest 30 ms" in told(result, "strapdown.bridged")
    assert not failed(result)
    assert np.abs(missed(result, flight[1])[0]).max() < 4.5
    with refuses("transfer.gap") as caught:
        said(flight, lambda log: lost(log, np.arange(8000, 8200)))
    assert "gaps, 1 in all, the longest of 2.01 s at 79.99 s; up to 250 ms" in caught.value.message
    # What lies before the gap can be used.
    before = said(flight, lambda log: lost(log, np.arange(20000, 20200)), hand_over=190.0)
    assert not failed(before)


@pytest.mark.parametrize("seed", [0, 5, 6])
def test_a_slave_that_loses_one_sample_in_ten(flight, seed) -> None:
    def lost(log):
        kept = np.flatnonzero(np.random.default_rng(seed).random(len(log)) > 0.1)
        return replace(log, time=log.time[kept], gyro=log.gyro[kept], accel=log.accel[kept])

    result = said(flight, lost)
    assert result.verdict.level is Level.PASS
    apart, nees = missed(result, flight[1])
    assert np.abs(apart).max() < 4.5 and nees < chi_square_limits(len(apart))[1]


def test_what_is_no_number(flight) -> None:
    def hole(x):
        out = x.copy()
        out[500] = np.nan
        return out

    for spoil in (slave(gyro=hole), slave(accel=hole)):
        with refuses("transfer.not_finite") as caught:
            said(flight, spoil)
        assert "1 readings of the slave are not finite, the first at 5 s" in caught.value.message
    for spoil in (master(velocity_n=hole), master(C_nb=hole)):
        with refuses("master.missing") as caught:
            said(flight, spoil)
        assert "the first of them is number 500" in caught.value.message


# -- messages --------------------------------------------------------------------------------------


def test_messages_that_were_lost_or_came_twice(flight) -> None:
    def kept(rows):
        return lambda log: replace(log, master=log.messages[rows(len(log.messages))])

    lost = said(flight, kept(lambda n: np.r_[0:300, 400:n]))
    assert "gaps, 1 in all, in which about 100 messages are missing" in told(lost, "master.gaps")
    twice = said(flight, kept(lambda n: np.repeat(np.arange(n), 2)))
    assert "1199 messages repeat the one before" in told(twice, "master.repeated")
    for result in (lost, twice):
        assert not failed(result)
        assert np.abs(missed(result, flight[1])[0]).max() < 4.5


def test_a_heading_averaged_across_its_wrap(flight) -> None:
    def averaged(angles):
        H = angles[:, 0] % (2 * np.pi)
        wrapped = np.flatnonzero(np.abs(np.diff(H)) > 3.0)
        assert len(wrapped) > 1
        H[wrapped + 1] = (H[wrapped] + H[wrapped + 1]) / 2
        return np.column_stack([H, angles[:, 1:]])

    result = said(flight, master(angles=averaged))
    assert "A heading that was averaged or interpolated across its wrap" in (
        told(result, "delay.wild")
    )
    assert not failed(result)
    assert np.abs(missed(result, flight[1])[0]).max() < 4.5
    # Wrapped at 180 deg instead of at 360 it is the same heading.
    other = said(flight, master(angles=lambda a: a - [2 * np.pi, 0, 0] * (a[:, :1] > np.pi)))
    assert codes(other) == []


def test_a_master_without_vertical_velocity(flight) -> None:
    result = said(flight, master(velocity_n=lambda v: v * [1, 1, 0]))
    assert "The vertical velocity of all messages is zero" in told(result, "transfer.no_vertical")
    assert not failed(result)
    assert np.abs(missed(result, flight[1])[0]).max() < 4.5
    assert codes(said(flight, as_it_is, vertical=False)) == []


def test_a_delay_that_jumps_is_no_drift() -> None:
    c = described(profile='"uav"')
    (one,) = noticed((c, made(c, 1)), master(time=lambda t: t + 0.03 * (t > 120.0)))
    assert one.code == "delay.wanders"
    assert "it jumps or wanders" in one.message


def test_whole_samples_and_an_unknown_delay() -> None:
    with refuses("transfer.sample_delay") as caught:
        described(shift='"sample"')
    assert "a delay that is estimated jumps from one to the next" in caught.value.message


# -- what was said of the mount, and beforehand ----------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((-1, -2, 0.5), "what was given is (-1.000, -2.000, 0.500) m: what shows is the opposite"),
        ((0, 0, 0), "and none was given"),
        ((2, 1, -0.5), "what shows is it with x and y exchanged"),
        ((2, 1, 0.5), "it with forward, right, down taken for right, forward, up"),
        ((1, 2, 0.5), "it with z reversed"),
        ((1, 2, -0.3), "and what was given is (1.000, 2.000, -0.300) m (log-likelihood"),
    ],
)
def test_a_wrong_lever_arm_is_named_with_its_size(levered, given, words: str) -> None:
    result = said(levered, as_it_is, lever_arm=tuple(f"{x} m" for x in given))
    (one,) = [f for f in result.findings if f.code == "transfer.lever"]
    assert words in one.message
    assert result.verdict.reasons[0].startswith(one.message)
    shown = [float(x.strip(' "m')) for x in one.cure.split("[")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(shown, [1, 2, -0.5], atol=0.06)
    assert "transfer.spread" not in codes(result)


@pytest.mark.thorough
def test_a_wrong_lever_arm_is_named_where_it_is_counted_with(levered) -> None:
    """Enlarged as what the messages contradict it hid itself; one as far off as said is none."""
    c, session = levered

    def codes_of(given, sd):
        arm = {"lever_arm": tuple(f"{x} m" for x in given), "lever_arm_sd": sd, "left_out": True}
        settings = c.settings.model_copy(update=arm)
        return codes(calibrated(c, session.simulation.log, settings=settings, sizes=ByNoise()))

    assert "transfer.lever" in codes_of((-1, -2, 0.5), 0.01)
    assert "transfer.lever" not in codes_of((1, 2, -0.3), 0.2)


@pytest.mark.thorough
def test_a_lever_arm_is_as_sure_on_a_run_that_is_reset(levered, monkeypatch) -> None:
    """Four pieces of a minute: what a reset takes out is no innovation."""
    none = ("0 m", "0 m", "0 m")
    whole, _ = _lever_arm(said(levered, as_it_is, lever_arm=none))
    monkeypatch.setattr(transfer, "PIECE", 60.0)
    assert codes(said(levered, as_it_is)) == []
    arm, sd = _lever_arm(said(levered, as_it_is, lever_arm=none))
    np.testing.assert_allclose(arm, whole, atol=0.02)
    assert np.abs((np.array(arm) - [1, 2, -0.5]) / sd).max() < 4.0 and max(sd) < 0.02


def _lever_arm(result) -> list[list[float]]:
    """Return the arm and its sd as they are told [m]."""
    (one,) = [f for f in result.findings if f.code == "transfer.lever"]
    told = re.findall(r"\(([^()]*)\)", one.message)[:2]
    return [[float(x) for x in part.split(",")] for part in told]


def test_the_right_lever_arm_is_left_alone(levered) -> None:
    assert codes(said(levered, as_it_is)) == []
    assert "transfer.lever" not in codes(said(levered, as_it_is, matching="attitude",
                                              lever_arm=("0 m", "0 m", "0 m")))  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ({"gyro.bias": (0.0, 0.02 * DEG / 3600)}, 'Write "gyro.bias" with sd = "9.9 deg/h"'),
        ({"installation": (0.0, 0.1 * ARCMIN)}, 'Write "installation" with sd = "11 arcmin"'),
        ({"accel.bias": (0.0, 1e-5 * G)}, 'Write "accel.bias" with sd = "1300 ug"'),
    ],
)
def test_a_prior_that_is_too_narrow_is_named(bare, prior, words: str) -> None:
    c, session = faultless(), bare
    result = trial(c, session.simulation.log, prior=prior)
    assert words in told(result, "transfer.prior")
    assert result.verdict.level is Level.DOUBTFUL
    assert not {"transfer.spread", "transfer.unseen"} & set(codes(result))
    wider = {k: (0.0, 300 * sd) for k, (_, sd) in prior.items()}
    wide = trial(c, session.simulation.log, prior=wider)
    assert codes(wide) == []


@pytest.mark.thorough
@pytest.mark.parametrize("group", ["gyro.bias", "gyro.scale", "accel.bias"])
def test_a_prior_that_is_contradicted_is_named_beside_what_could_hide_it(bare, group) -> None:
    """What is left out may take up what a prior does not allow: both are named, none is a pass."""
    c, session = described(), bare
    sd = {"gyro.bias": 0.02 * DEG / 3600, "gyro.scale": 2e-5, "accel.bias": 1e-5 * G}[group]
    result = trial(c, session.simulation.log, prior={group: (0.0, sd)})
    named = [f for f in result.findings if f.code == "transfer.prior"]
    assert any(f.message.startswith(group) for f in named)
    assert result.verdict.level is Level.DOUBTFUL and "prior" in failed(result)
    right = trial(c, session.simulation.log, prior={group: (0.0, 300 * sd)})
    assert "transfer.prior" not in codes(right) and "prior" not in failed(right)


@pytest.mark.thorough
def test_a_wrong_sd_of_the_messages_is_no_prior(flight) -> None:
    result = said(flight, as_it_is, attitude_sd=0.1 * ARCMIN)
    assert codes(result) == ["transfer.spread"]


def test_a_nominal_mounting_two_degrees_off(bare) -> None:
    for c in (described(), faultless()):
        result = said((c, bare), as_it_is, mounting_heading=2 * DEG)
        words = told(result, "transfer.prior")
        assert result.verdict.level is Level.DOUBTFUL
        assert words.startswith("installation.z was said to be 0 deg give or take 0.083 deg")
        assert "the messages alone say 2 deg" in words


# -- passes ----------------------------------------------------------------------------------------


def test_one_pass_is_judged_by_a_second(bare) -> None:
    result = said((faultless(), bare), as_it_is, passes=1)
    words = told(result, "transfer.unsettled")
    assert "From pass 1 to pass 2 accel.bias.z moves by 4.4 of its standard deviations" in words
    assert "1 pass was asked for. Write passes = 5." in words
    assert failed(result) == {"converged"}


def test_one_pass_of_a_slave_without_errors_has_settled(flight) -> None:
    """Nothing is to be moved: the equations hold where they begin."""
    c, session = flight
    log, model = session.simulation.log, session.simulation.made.slave
    force, rate = model.model.compensate(log.accel, log.gyro)
    C = exp(np.array(model.mu))
    right = replace(log, accel=force @ C.T, gyro=rate @ C.T)
    result = trial(c, SlaveLog.of(right, log.messages),
                   settings=c.settings.model_copy(update={"passes": 1}))  # fmt: skip
    assert failed(result) == set() and codes(result) == []


# -- a slave whose axes are not at right angles ----------------------------------------------------


@pytest.mark.thorough
def test_misalignments_widen_the_uncertainties_of_biases(flight) -> None:
    """Axes off by 1 mrad: of uncertainties that know nothing of it biases are tens off."""
    total, runs, worst = 0.0, 2, 0.0
    c = described(misalignments="true")
    for seed in range(runs):
        model = skewed(made(c, seed).simulation.model, seed)
        made_ = simulate(c.session, settings=c.settings, model=model, noise=c.noise, site=c.site,
                         seed=seed)  # fmt: skip
        result = trial(c, made_.log)
        assert not failed(result) and not codes(result)
        total += off(result, model, made_)[1]
        plain = trial(c, made_.log, settings=faultless().settings)
        worst = max(worst, float(np.abs(off(plain, model, made_)[0]).max()))
    low, high = chi_square_limits(28 * runs)
    assert low < total < high
    assert worst > 50
    assert not any("Misalignments" in one for one in result.diagnostics["unseen"])
    assert any("1 mrad, or 1000 ppm, makes 1 mg" in one for one in plain.diagnostics["unseen"])


def skewed(model, seed):
    vector, rng = model.coefficients(), np.random.default_rng([seed, 5])
    for group, sd in (("gyro.misalignment", 1e-3), ("accel.misalignment", 1e-3),
                      ("accel.scale", 5e-4)):  # fmt: skip
        at = vector.layout.group(group)
        vector.values[at] = sd * rng.standard_normal(len(at))
    return ImuModel.from_coefficients(vector)


def off(result, model, made_):
    """Return the errors of a result in its sds, and their NEES."""
    c, true = result.coefficients, model.coefficients().with_others(made_.beside)
    err = c.values - true.chosen(c.names).values
    return err / c.sd, float(err @ np.linalg.solve(c.cov, err))


@pytest.mark.parametrize("off", [-5.0, 7.0, 12.0])
@pytest.mark.thorough
def test_a_master_s_clock_that_is_seconds_off(flight, off: float) -> None:
    result = said(flight, master(time=lambda t: t + off))
    words = told(result, "transfer.clock")
    assert f"is of {off + 0.1:+.3f} ± 0.00" in words
    verb, to = ("take", "from") if off > 0 else ("add", "to")
    assert f"{verb} {abs(off + 0.1):.3f} s {to} the master's stamps" in words
    assert not {"transfer.mounting", "transfer.sense", "transfer.mirror"} & set(codes(result))
    assert result.verdict.level is not Level.PASS


@pytest.mark.thorough
def test_two_delays_that_contradict_each_other(flight) -> None:
    """Velocities 30 ms older than the attitudes of the same message."""
    t = flight[1].simulation.log.messages.time

    def older(v):
        return np.column_stack([np.interp(t - 0.03, t, x) for x in v.T])

    late = said(flight, master(velocity_n=older), matching="velocity")
    assert late.verdict.level is Level.DOUBTFUL
    words = told(late, "transfer.delays")
    assert "By what both turned messages are 100." in words
    assert "by the filter, velocities included, 130." in words
    assert "transfer.delays" not in codes(said(flight, as_it_is))


def test_noise_of_messages_that_is_declared_too_large_is_no_mount_that_bends(flight) -> None:
    result = said(flight, as_it_is, attitude_sd=2 * ARCMIN)
    words = told(result, "transfer.narrow")
    assert "Innovations of attitude are 0.50 times what is expected: attitude_sd is" in words
    assert 'attitude_sd = "1 arcmin"' in words or 'attitude_sd = "0.9' in words
    assert "bends" not in words and "transfer.spread" not in codes(result)


@pytest.mark.thorough
def test_a_site_elsewhere_than_the_master(flight) -> None:
    c, session = flight
    right = trial(c, session.simulation.log)
    far = Site.at(28 * DEG, 60.0)
    result = trial(replace(c, site=replace(far, gravity_sd=4e-4)), session.simulation.log)
    words = told(result, "transfer.site")
    assert "[site] has latitude 28.0000 deg; by its positions the master begins at 48.8462" in words
    assert result.site["latitude"] == pytest.approx(48.8462 * DEG, abs=1e-5)
    assert result.site["gravity"] == pytest.approx(right.site["gravity"], abs=1e-5)
    np.testing.assert_allclose(result.coefficients.values, right.coefficients.values, atol=1e-6)
    assert "transfer.site" not in codes(right)


@pytest.mark.parametrize("triad", ["gyro", "accel"])
@pytest.mark.parametrize("value", [0.0, 0.01])
def test_sensors_that_read_one_number_are_named(flight, triad: str, value: float) -> None:
    with refuses("transfer.dead") as caught:
        said(flight, slave(**{triad: lambda x: np.full_like(x, value)}))
    assert f"All readings of the {triad} are the same on every axis" in str(caught.value)


def test_a_few_messages_that_are_off(bare) -> None:
    def jumped(v):
        out = v.copy()
        out[500:503] += 5.0
        return out

    words = told(said((described(), bare), master(velocity_n=jumped)), "transfer.outliers")
    assert "3 messages differ from the slave by more than 8 standard deviations" in words
    assert re.search(r"stamped 100\.\d+, 100\.\d+, 100\.\d+ s", words)


def test_as_many_passes_as_it_takes(flight) -> None:
    """Forty times the usual errors take more passes than usual, and are found as well."""
    c = described()
    model = made(faultless(), 1).simulation.model
    vector = model.coefficients()
    vector.values[:] *= 40
    prior = {"gyro.bias": (0.0, 100 * DEG / 3600), "gyro.scale": (0.0, 0.02),
             "accel.bias": (0.0, 0.04 * G)}  # fmt: skip
    large = ImuModel.from_coefficients(vector)
    session = simulate(c.session, settings=c.settings, model=large, noise=c.noise, site=c.site,
                       seed=1)  # fmt: skip
    result = trial(c, session.log, prior=prior)
    assert not failed(result)
    assert np.abs(off(result, large, session)[0]).max() < 4.5
    few = len(said(flight, as_it_is).diagnostics["passes"]["values"])
    assert few < len(result.diagnostics["passes"]["values"]) <= c.settings.passes


@pytest.mark.thorough
def test_two_hours() -> None:
    """A free run of the slave would be gone by far: its vertical grows 300 000 times."""
    c = faultless(profile='"ship"', rate='"10 Hz"', message_rate='"0.5 Hz"')
    plan = moved(transfer_profile("ship"), c.site)
    plan = replace(plan, calibration=plan.calibration * 30, outage=())
    model = made(c, 0).simulation.model
    session = simulate_motion(plan, c.session, c.settings, model, c.noise, 0)
    result = trial(c, session.log)
    assert not failed(result) and not codes(result)
    low, high = chi_square_limits(13)
    assert low < off(result, model, session)[1] < high


@pytest.mark.thorough
def test_a_row_of_zeros_in_a_turn_moves_no_coefficient(flight):
    c, session = flight
    log = session.simulation.log
    gyro, accel = log.gyro.copy(), log.accel.copy()
    gyro[8000] = accel[8000] = 0.0  # 9.8 m/s^2 for 10 ms: 10 sd of the scale of a gyro
    clean, got = (trial(c, x) for x in (log, replace(log, gyro=gyro, accel=accel)))
    moved_by = (got.coefficients.values - clean.coefficients.values) / clean.coefficients.sd
    assert np.abs(moved_by).max() < 0.05
    assert got.verdict.level is Level.PASS
    assert "1 (accel.x, accel.y, accel.z, gyro.x, gyro.y, gyro.z)" in told(got, "log.spikes")


@pytest.mark.thorough
@pytest.mark.parametrize("row", [500, 8000, 12000])
@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_one_reading_20_sd_off_moves_no_coefficient_by_a_quarter_of_its_sd(flight, row, triad):
    c, session = flight
    log = session.simulation.log
    x = getattr(log, triad).copy()
    x[row, 2] += 20 * getattr(c.noise, triad).white / np.sqrt(log.interval)
    clean, got = (trial(c, each) for each in (log, replace(log, **{triad: x})))
    moved_by = (got.coefficients.values - clean.coefficients.values) / clean.coefficients.sd
    assert np.abs(moved_by).max() < 0.25
    assert got.verdict.level is Level.PASS


# -- what happens at once --------------------------------------------------------------------------


def _late(x, step, last=None):
    """Return readings (n, 3) with `step` added from the middle on, for `last` rows or for good."""
    first = len(x) // 2
    out = x.copy()
    out[first : None if last is None else first + last] += step
    return out


def test_a_spike_of_the_accelerometers_is_left_out_and_told(flight) -> None:
    result = said(flight, slave(accel=lambda f: _late(f, [G, 0.0, 0.0], 3)))
    assert "transfer.mishap" in codes(result) and "transfer.flexure" not in codes(result)


def test_biases_that_change_for_good_are_named_and_are_no_flexure(flight) -> None:
    result = said(flight, slave(accel=lambda f: _late(f, [0.02 * G, 0.0, 0.0])))
    assert "transfer.flexure" not in codes(result)
    assert "the biases of the accelerometers" in told(result, "transfer.shift")
    assert result.verdict.level is not Level.PASS


@pytest.mark.parametrize(("times", "carried", "named"), [
    (2.0, False, []),
    (4.0, False, ["gyros", "accelerometers"]),
    (5.0, False, ["gyros", "accelerometers"]),
    (5.0, True, []),
    (8.0, True, []),
])  # fmt: skip
def test_readings_in_steps_that_their_noise_does_not_blur(flight, times, carried, named):
    """Times the noise of a reading: rounded each by itself, or counted, the rest carried on."""
    c, session = flight
    log = session.simulation.log
    steps = [times * t.white / np.sqrt(log.interval) for t in (c.noise.gyro, c.noise.accel)]
    gyro, accel = (quantise(x, step, carried=carried)
                   for x, step in zip((log.gyro, log.accel), steps, strict=True))  # fmt: skip
    result = trial(c, replace(log, gyro=gyro, accel=accel))
    found = [f.message for f in result.findings if f.code == "transfer.resolution"]
    assert [f"The {what} of the slave are read in steps" in m
            for what, m in zip(named, found, strict=True)] == [True] * len(named)  # fmt: skip
    if named:
        assert result.verdict.level == Level.DOUBTFUL
    else:
        _, nees = missed(result, session)
        assert nees < chi_square_limits(len(result.coefficients), 1e-3)[1]


def test_a_rate_log_in_coarse_steps(flight):
    c, session = flight
    log = session.simulation.log
    step = 5 * c.noise.gyro.white / np.sqrt(log.interval)
    result = trial(c, replace(log, gyro=quantise(log.gyro, step), sampled="rate"))
    said = told(result, "transfer.resolution")
    assert said.startswith("The gyros of the slave") and "log its increments as counts" in said
