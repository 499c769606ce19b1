"""Transfer alignment by its public path: what was put in comes back, and what it says."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import sessions
from foucault.diagnose.comparable import gravity_errors
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import angles_of, matrix_of
from foucault.models.rotation import log as rotation_vector
from foucault.plans.manoeuvres import Straight
from foucault.procedures import transfer_alignment
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment.session import foreseen, manoeuvres, moved
from foucault.procedures.transfer_alignment.settings import Settings, SlaveLog
from foucault.result import Level
from make_transfer_campaign import LEVER, calibrated, made, missed, trial
from make_transfer_campaign import faultless as described
from refusals import refuses
from sessions import SITE, SLAVE, Case, codes, failed, solved

ARCMIN = np.pi / 10800


@pytest.fixture(scope="module")
def flight():
    c = described()
    return c, made(c, 7)


@pytest.fixture(scope="module")
def found(flight):
    c, session = flight
    return calibrated(c, session.simulation.log)


def settings(c, **changes):
    return c.settings.model_copy(update=changes)


# -- what was put in comes back --------------------------------------------------------------------


def test_one_flight_is_told_whole(flight, found):
    _, session = flight
    assert found.verdict.level is Level.PASS, found.verdict.reasons
    _, score = missed(found, session)
    low, high = chi_square_limits(13)
    assert low < score < high
    assert found.coefficients.names == Settings().reported
    assert found.coefficients.names[9:] == (
        "installation.x", "installation.y", "installation.z", "master.delay",
    )  # fmt: skip
    # A Kalman filter of a linear system is at its bound; gravity is uncertain besides.
    (error,) = gravity_errors(found, found.coefficients).values()
    bound = np.array(found.diagnostics["bound"])
    np.testing.assert_allclose(found.coefficients.sd, np.hypot(bound, error), rtol=1e-9)
    assert set(found.tables) == {
        "innovations", "estimates", "undelayed", "smoothed", "delayed", "stretches", "delay_parts",
    }  # fmt: skip
    last = {name: found.tables["estimates"][name][-1] for name in found.coefficients.names}
    near = found.tables["estimates"]["master.delay_sd"][-1]
    assert last["master.delay"] == pytest.approx(found.coefficients.values[-1], abs=near)
    delayed = found.tables["delayed"]
    assert 1.5 < np.degrees(np.abs(delayed["heading"]).max()) < 2.2
    assert 1.0 < np.abs(delayed["velocity_east"]).max() < 2.0


@pytest.mark.thorough
def test_gravity_that_is_not_known_is_a_bias_that_is_not_known(flight, found):
    """1 mGal is 1 ug of the accelerometer that points up, whatever the filter thinks of it."""
    c, session = flight
    site = replace(c.site, gravity=c.site.gravity + c.site.gravity_sd)
    other = calibrated(replace(c, site=site), session.simulation.log)
    step = other.coefficients.values - found.coefficients.values
    (error,) = gravity_errors(found, found.coefficients).values()
    sd = np.array(found.diagnostics["bound"])
    np.testing.assert_allclose(step / sd, error / sd, atol=0.05)
    up = found.coefficients.names.index("accel.bias.z")
    assert error[up] == pytest.approx(-c.site.gravity_sd, rel=0.05) and -error[up] > 10 * sd[up]
    known = calibrated(replace(c, site=replace(c.site, gravity_sd=0.0)), session.simulation.log)
    np.testing.assert_array_equal(known.coefficients.sd, sd)


@pytest.mark.thorough
def test_a_preflight_knows_gravity_as_the_calibration_does(flight, found):
    c, unknown = flight[0], flight[0].site.gravity_sd
    told = {}
    for sd in (0.0, unknown):
        site = replace(c.site, gravity_sd=sd)
        foreseen = transfer_alignment.foresee(
            Beforehand(c.settings, session=c.session, site=site, noise=c.noise)
        )
        told[sd] = foreseen.coefficients["accel.bias.z"].sd
        # To fly on does not tell what gravity is.
        assert ("accel.bias.z" in dict(foreseen.more[0].best)) == (sd == 0.0)
    assert told[unknown] == pytest.approx(np.hypot(told[0.0], unknown), rel=0.05)
    assert told[unknown] == pytest.approx(found.coefficients["accel.bias.z"].sd, rel=0.05)


def test_the_flight_is_told_by_what_was_flown(found):
    """The S-turn, the climb between turns, the accelerations and the straight end of the plan."""
    flown = found.tables["stretches"]
    kinds = flown["kind"].tolist()
    assert kinds[-1] == "straight"
    assert flown["end"][-1] - flown["start"][-1] > 130
    assert {"accelerated", "turning"} <= set(kinds)
    turn = float(np.degrees(flown["turn"][flown["kind"] == "turning"]).max())
    assert turn == pytest.approx(120, abs=5)
    assert (np.diff(flown["gyro.scale.z_sd"]) <= 1e-12).all()
    at = found.coefficients.names.index("gyro.scale.z")
    assert flown["gyro.scale.z_sd"][-1] == found.diagnostics["bound"][at]


def test_the_attitude_history_is_smoothed(flight, found):
    """Against the true attitude, with the sd it says; sharper than the messages."""
    table, truth = found.tables["smoothed"], flight[1].simulation.made.truth
    rows = np.round(table["time"] * 100).astype(int)
    np.testing.assert_allclose(truth.time[rows], table["time"], atol=1e-9)
    C = matrix_of(table["heading"], table["pitch"], table["roll"])
    phi = rotation_vector(truth.C_nb[rows] @ np.swapaxes(C, 1, 2))
    sd = np.stack([table[f"phi_{a}_sd"] for a in ("east", "north", "up")], axis=1)
    assert np.abs(phi / sd).max() < 4.5
    assert np.sqrt(np.mean(phi**2)) < 0.3 * ARCMIN
    # Some 30 independent stretches: their mean square is about 1.
    assert 0.3 < np.mean((phi / sd) ** 2) < 2.5


@pytest.mark.thorough
def test_it_is_handed_over_as_well_as_it_says():
    total, runs = 0.0, 8
    c = described(hand_over='"239.5 s"')
    for seed in range(20, 20 + runs):
        session = made(c, seed)
        handed = trial(c, session.simulation.log).diagnostics["hand_over"]
        assert handed["time"] == pytest.approx(239.5, abs=0.006)
        truth = session.simulation.made.truth
        k = int(np.argmin(np.abs(truth.time - handed["time"])))
        C = matrix_of(handed["heading"], handed["pitch"], handed["roll"])
        phi = rotation_vector(truth.C_nb[k] @ C.T)
        err = np.concatenate([phi, handed["velocity"] - truth.velocity_n[k]])
        total += err @ np.linalg.solve(np.array(handed["covariance"]), err)
        assert handed["latitude"] == pytest.approx(truth.latitude[k], abs=2e-6)
    low, high = chi_square_limits(6 * runs)
    assert low < total < high


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["likelihood", "state"])
def test_the_delay_is_found_by_other_methods(flight, found, method):
    c, session = flight
    result = trial(c, session.simulation.log, settings=settings(c, delay_method=method))
    sd = found.coefficients["master.delay"].sd[0]
    assert sd < 1e-4
    one, other = (r.coefficients.value("master.delay") for r in (result, found))
    assert abs(one - other) < 0.1 * sd
    assert result.diagnostics["delay"]["method"] == method
    if method == "likelihood":
        fit = result.diagnostics["delay"]["likelihood"]
        assert abs(fit["value"] - session.simulation.delay) < 4 * fit["sd"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "simulated, chosen",
    [
        ({"compliance_sd": '"2 arcmin"'}, {"load": "true"}),
        ({"flexure": '"1 arcmin"'}, {"flexure_sd": '"1 arcmin"'}),
        ({}, {"lever_arm": LEVER, "mounting_heading": '"30 deg"', "mounting_roll": '"5 deg"'}),
        ({"profile": '"uav"'}, {"attitude_form": '"angles"'}),
        ({"profile": '"ship"'}, {"vertical": "true"}),
        ({"stamped": '"both"', "jitter": '"3 ms"', "clock_drift": "50e-6"}, {}),
        ({"lost": "0.2", "repeated": "0.2"}, {}),
    ],
)
def test_other_mounts_motions_and_messages(simulated, chosen):
    c = described(**simulated, **chosen)
    total, runs = 0.0, 2
    for seed in range(40, 40 + runs):
        session = made(c, seed)
        result = trial(c, session.simulation.log)
        assert not failed(result)
        total += missed(result, session)[1]
    n = len(result.coefficients)
    low, high = chi_square_limits(n * runs, tests=7)
    assert low < total < high
    assert ("load.x" in result.coefficients.layout) == ("load" in chosen)


def test_the_published_sixteen_states():
    c = described(accel_bias_z="false", delay='"100 ms"', shift='"sample"')
    session = made(c, 3)
    result = trial(c, session.simulation.log)
    assert result.diagnostics["filter"]["states"] == 9 + 8 + 3
    assert "accel.bias.z" not in result.coefficients.layout
    assert "master.delay" not in result.coefficients.layout
    assert "transfer.delay_differs" not in codes(result)


# -- the bounded filter ----------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("wanted", ["prior", "navigation"])
def test_h_infinity(flight, found, wanted):
    c, session = flight
    bounded = settings(c, filter="h_infinity", wanted=wanted)
    result = calibrated(c, session.simulation.log, settings=bounded)
    said = result.diagnostics["filter"]
    assert said["gamma"] == pytest.approx(1.2 * said["least_gamma"])
    assert result.tables["gamma"]["margin"].min() > 0
    assert np.abs(missed(result, session)[0]).max() < 5
    bound = np.array(result.diagnostics["bound"])
    np.testing.assert_allclose(bound, found.diagnostics["bound"], rtol=1e-9)
    assert (result.coefficients.sd >= bound * (1 - 1e-9)).all()
    assert "budget" not in result.diagnostics  # its covariance is not that of its error
    few = settings(c, filter="h_infinity", wanted=wanted, gamma=0.5 * said["least_gamma"])
    with refuses("transfer.gamma") as caught:
        trial(c, session.simulation.log, settings=few)
    assert re.search(r"ceases to exist at [\d.]+ s; the least gamma of this run is [\d.e+]+\.",
                     caught.value.message)  # fmt: skip


# -- where its uncertainty is from -----------------------------------------------------------------

ALWAYS = {"state at the start", "prior", "white noise of gyros", "white noise of accelerometers",
          "velocity of the messages"}  # fmt: skip
ATTITUDE = {"attitude of the messages"}
ASIDE = {"gyro.misalignment", "accel.misalignment", "accel.scale", "gyro.g_sensitivity"}
BUDGETS = {
    "alone": ({"left_out": False}, {}, ALWAYS | ATTITUDE),
    "velocity": ({"matching": "velocity"}, {}, ALWAYS | ASIDE),
    "bending": ({"flexure_sd": 3e-4}, {}, ALWAYS | ATTITUDE | ASIDE | {"slow noise and bending"}),
    "gravity": (
        {}, {"site": replace(SITE, gravity_sd=1e-4)}, ALWAYS | ATTITUDE | ASIDE | {"local gravity"}
    ),
    "one noise": (
        {"left_out": False}, {"noise": ImuNoise(SLAVE.accel, TriadNoise(white=1e-12))},
        ALWAYS | ATTITUDE,
    ),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", BUDGETS)
def test_the_budget_has_every_source_and_adds_up(name):
    said, more, sources = BUDGETS[name]
    flight = {"rate": 50.0, "message_rate": 2.0, "with_outage": False}
    case = Case("transfer_alignment", said, flight, **{"noise": SLAVE} | more)
    result = solved(case, sessions.made(case, 1).log, whole=True)
    budget = {k: np.array(v) for k, v in result.diagnostics["budget"].items()}
    assert budget.keys() == sources
    variance = result.coefficients.sd**2
    np.testing.assert_allclose(sum(budget.values()), variance, rtol=1e-9)
    share = {k: float((v / variance).max()) for k, v in budget.items()}
    assert share["white noise of accelerometers"] > 1e-3
    assert (share["white noise of gyros"] < 1e-9) == (name == "one noise")


# -- what it says ----------------------------------------------------------------------------------


def test_a_delay_that_is_ignored_is_named(flight):
    c, session = flight
    result = trial(c, session.simulation.log, settings=settings(c, delay="none"))
    (said,) = [f for f in result.findings if f.code == "transfer.delay_differs"]
    assert said.message.startswith("The delay was given as 0.0 ms; by what both turned it is 100.0")
    assert np.abs(missed(result, session)[0]).max() > 100
    assert {"velocity innovations", "attitude innovations", "whiteness"} <= failed(result)


def test_a_heading_that_counts_the_other_way_is_named(flight):
    c, session = flight
    log = session.simulation.log
    heading, pitch, roll = angles_of(log.messages.C_nb).T
    turned = replace(log.messages, C_nb=matrix_of(-heading, pitch, roll))
    result = trial(c, replace(log, master=turned))
    (said,) = [f for f in result.findings if f.code == "transfer.sense"]
    assert 'sense = "counter-clockwise"' in said.cure
    assert result.verdict.level is Level.UNUSABLE


@pytest.mark.thorough
def test_another_mounting_is_named(flight):
    c, session = flight
    result = trial(c, session.simulation.log, settings=settings(c, mounting_heading=np.pi / 2))
    (said,) = [f for f in result.findings if f.code == "transfer.mounting"]
    assert re.search(r"mounted at heading -?0\.\d, pitch -?0\.\d, roll -?0\.\d deg, 9?0\.\d deg",
                     said.message)  # fmt: skip


def test_messages_stamped_when_they_hold():
    c = described(stamped='"validity"')
    result = trial(c, made(c).simulation.log)
    (said,) = [f for f in result.findings if f.code == "transfer.at_validity"]
    assert re.match(r"The delay is -?0\.\d ± 0\.0\d+ ms: as far as can be told", said.message)


@pytest.mark.thorough
def test_a_delay_outside_its_bracket():
    c = described(message_delay='"260 ms"')
    session = made(c)
    result = trial(c, session.simulation.log)
    (said,) = [f for f in result.findings if f.code == "transfer.outside"]
    assert re.match(r"The delay is 2(60|59)\.\d ms, and was looked for from 0 to 200.0 ms",
                    said.message)  # fmt: skip
    low, high = chi_square_limits(13)
    assert low < missed(result, session)[1] < high
    likely = trial(c, session.simulation.log, settings=settings(c, delay_method="likelihood"))
    (said,) = [f for f in likely.findings if f.code == "transfer.edge"]
    assert "The likeliest delay, 200.0 ms, lies at an end of the bracket" in said.message


@pytest.mark.thorough
def test_no_manoeuvre():
    c = described(profile='"straight"')
    result = trial(c, made(c).simulation.log)
    told = {f.code: f for f in result.findings}
    assert told["transfer.straight"].message.startswith("The vehicle turned by 0.")
    unseen = told["transfer.unseen"]
    assert "gyro.scale.z" in unseen.message
    assert "accel.bias.x" in unseen.message
    assert "gyro.bias" not in unseen.message
    assert "Add turns of 90 deg and more about the axis" in unseen.cure
    assert "seen" in failed(result)


def test_innovations_that_are_larger_or_smaller_than_stated(flight):
    c, session = flight
    wrong = settings(c, velocity_sd=0.02, attitude_sd=5 * ARCMIN)
    result = trial(c, session.simulation.log, settings=wrong)
    assert {"velocity innovations", "attitude innovations"} <= failed(result)
    told = [f for f in result.findings if f.code in ("transfer.spread", "transfer.narrow")]
    explained = [re.match(r'(\w+) = "([\d.]+) ', f.cure).groups() for f in told]
    assert dict(explained).keys() == {"velocity_sd", "attitude_sd"}
    for key, value in explained:
        assert float(value) == pytest.approx(
            {"velocity_sd": 0.05, "attitude_sd": 1.0}[key], rel=0.3
        )


def test_messages_that_are_worse_for_a_while_are_hidden_from_all_but_what_was_held_out(flight):
    """A master is a quarter noisier for a sixth of the flight: its innovations are as allowed."""
    c, session = flight
    log = session.simulation.log
    table = log.messages
    fast, sixth = table.velocity_n.copy(), len(table) // 6
    part = slice(2 * sixth, 3 * sixth)
    noise = np.random.default_rng(1).standard_normal((sixth, 3))
    fast[part] += 0.75 * c.settings.velocity_sd * noise
    result = trial(c, replace(log, master=replace(table, velocity_n=fast)))
    assert failed(result) == {"held-out messages"}
    assert result.verdict.level is Level.DOUBTFUL
    said = next(x for x in result.checks if x.name == "held-out messages").sentence
    begin, end = (float(x) for x in re.findall(r"from (\d+) to (\d+) s", said)[0])
    first, last = table.time[part][[0, -1]]
    assert abs(begin - first) < 1.0 and abs(end - last) < 1.0


def test_flexure_that_is_not_modelled_shows():
    c = described(flexure='"1 arcmin"')
    result = trial(c, made(c).simulation.log)
    assert {"attitude innovations", "whiteness"} <= failed(result)


def test_noise_that_is_not_stated(flight):
    c, session = flight
    result = trial(c, session.simulation.log, noise=None)
    (said,) = [f for f in result.findings if f.code == "transfer.noise"]
    assert "0.06 deg/sqrt(h) and 30 ug/sqrt(Hz)" in said.message


# -- what it refuses -------------------------------------------------------------------------------


def refused(c, log, **more):
    with pytest.raises(FoucaultError) as caught:
        trial(c, log, **more)
    return caught.value


def test_input_that_cannot_be_used(flight):
    c, session = flight
    log = session.simulation.log
    for alone in (replace(log, master=None), session.simulation.outage):
        said = refused(c, alone)
        assert said.code == "transfer.no_master"
        assert "nothing that its master said" in said.message
    away = replace(log.messages, time=log.messages.time + 1000.0)
    said = refused(c, SlaveLog.of(log, away))
    assert said.code == "transfer.overlap"
    assert "from 0 to 240 s" in said.message or "from 0 to 241 s" in said.message
    assert "0 messages can be used, and it takes 20" in said.message
    nowhere = replace(log.messages, latitude=None, longitude=None, height=None)
    said = refused(c, SlaveLog.of(log, nowhere), site=Site(9.81))
    assert said.code == "transfer.place"
    assert "has no latitude, and neither has [site]" in said.message
    result = trial(c, SlaveLog.of(log, nowhere))
    assert np.abs(missed(result, session)[0]).max() < 4.5
    said = refused(c, log, settings=settings(c, hand_over=500.0))
    assert said.code == "transfer.hand_over"
    assert "hand_over is 500 s; messages hold from 0." in said.message


def test_a_delay_that_cannot_be_found(flight):
    c, session = flight
    log = session.simulation.log
    said = refused(c, SlaveLog.of(log, log.messages[:20]))
    assert said.code == "transfer.no_delay"
    assert "have too few turns in common" in said.message


def test_settings_that_contradict_one_another():
    for keys, code, words in (
        ({"delay": '"-5 ms"'}, "transfer.delay", "procedure.delay: delay = \"-5 ms\" is before"),
        ({"delay": '"soon"'}, "unit.missing", "procedure.delay"),
        ({"lever_arm": '["1 m", "2 s", "0 m"]'}, "unit.kind", "procedure.lever_arm"),
        ({"matching": '"velocity"', "load": "true"}, "transfer.no_attitude",
         'matching = "velocity"'),
        ({"profile": '"flihgt"'}, "transfer_plan.profile", "Did you mean 'flight'?"),
    ):  # fmt: skip
        with refuses(code) as caught:
            made(described(**keys))
        assert words in caught.value.message, caught.value.message


# -- beforehand ------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_what_is_foreseen_is_what_comes(flight, found):
    c, _ = flight
    seen = transfer_alignment.foresee(
        Beforehand(c.settings, session=c.session, site=c.site, noise=c.noise, prior=c.prior)
    )
    np.testing.assert_allclose(seen.sd, found.coefficients.sd, rtol=0.05)
    assert seen.complete
    turns = {extra.what: extra for extra in seen.more}
    assert turns["an S-turn of 40 deg"].ratio < turns["straight on"].ratio < 1


@pytest.mark.thorough
def test_a_manoeuvre_more_before_the_hand_over_tells_something():
    c = described(hand_over='"100 s"')
    told = transfer_alignment.foresee(
        Beforehand(c.settings, session=c.session, site=c.site, noise=c.noise)
    )
    for extra in told.more:
        assert min(ratio for _, ratio in extra.best) < 0.95


def test_what_each_manoeuvre_shows():
    """A bias and a tilt are told apart by turning; the delay by anything but a straight run."""
    c = described()
    plan = moved(replace(c.session.motion, outage=()), c.site)
    seen = {}
    for name, segments in manoeuvres(float(plan.start.speed)).items():
        half = Straight((plan.hand_over - sum(s.time for s in segments)) / 2)
        one = replace(plan, name=name, calibration=(half, *segments, half))
        seen[name] = foreseen(one, Beforehand(c.settings, c.session, c.site, c.noise)).vector
    straight = seen["straight on"]
    for name, vector in seen.items():
        if name == "straight on":
            continue
        less = {n: vector.sd[i] / straight.sd[i] for i, n in enumerate(vector.names)}
        assert less["master.delay"] < 0.2
        assert less["gyro.bias.z"] == pytest.approx(1.0, abs=0.1)
        turns = "turn" in name
        assert (less["accel.bias.x"] < 0.3) == turns
        assert (less["installation.x"] < 0.3) == turns
    assert straight["gyro.scale"].sd == pytest.approx(straight["gyro.scale"].prior_sd, rel=1e-4)
