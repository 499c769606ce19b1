"""Systematic calibration by its public path: what was put in comes back, and what it says."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign
from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError, Status
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.layouts import model_of
from foucault.models.noise import ImuNoise
from foucault.models.size_effect import LEVER, OFFSET
from foucault.plans.manoeuvres import Rest
from foucault.plans.sequence import quarter_turns
from foucault.procedures import systematic
from foucault.procedures.systematic.problem import exchanged
from foucault.procedures.systematic.settings import NAMES, PRIOR, Settings
from foucault.report import html
from foucault.result import Level
from foucault.simulate.systematic import TableErrors, simulate_systematic
from make_sequence import ARCSEC, DEG, DPH, NOISE, third_party
from refusals import refuses
from sessions import codes, failed

UG = 9.80665e-6
SITE = Site.at(40 * DEG, 100.0)
BOTH = ("19 positions", "spins, simple 6")
SHORT = systematic.Session(rest_time=30.0, rate=25.0)


def simulated(settings=None, session=SHORT, seed=1, model=None, noise=NOISE, site=SITE):
    settings = settings or Settings()
    model = model or systematic.draw_errors("navigation", seed)
    return systematic.simulate(
        session, settings=settings, model=model, noise=noise, site=site, seed=seed
    )


def trial(made, settings=None, site=SITE, **more):
    return systematic.trial(
        made.log, site=site, settings=settings or Settings(), **{"noise": NOISE} | more
    )


def nees(result, model, names):
    c = result.coefficients
    at = [c.layout.index(name) for name in names]
    err = c.values[at] - model.coefficients(names).values
    return float(err @ np.linalg.solve(c.cov[np.ix_(at, at)], err))


@pytest.fixture(scope="module")
def nineteen():
    return simulated()


@pytest.fixture(scope="module")
def bending():
    """Make a session with spins of an instrument whose gyros bend."""
    settings = Settings(sequence=BOTH, deflection="coupled6")
    return settings, simulated(settings, seed=3)


# -- what was put in comes back --------------------------------------------------------------------


@pytest.mark.thorough
def test_a_campaign_from_simulation_to_report(tmp_path):
    text = campaign.template("systematic")
    text = text.replace('# rest_time = "60 s"', 'rest_time = "40 s"')
    text = text.replace('["19 positions"]', json.dumps(BOTH))
    text = text.replace('deflection = "none"', 'deflection = "coupled6"')
    session = campaign.simulate(campaign.parse(text), seed=5)
    file = campaign.save_session(session, tmp_path)
    heard = []
    result = campaign.calibrate(file, lambda done, what: heard.append((done, what)))
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    assert result.status is Status.CONVERGED
    assert codes(result) == ["systematic.stands_for"]
    assert heard[-1] == (1.0, "done")
    names = systematic.names_of(campaign.load(file).settings)
    assert len(names) == 30
    score = nees(result, model_of(session.truth), names)
    low, high = chi_square_limits(len(names))
    assert low < score < high
    # The twelve that the model makes of its six are tied together, and right too.
    assert sum(n.startswith("gyro.deflection.") for n in result.coefficients.names) == 12
    c = result.coefficients
    assert c.value("gyro.deflection.xyz") == pytest.approx(-c.value("gyro.deflection.xzz"))
    assert set(result.tables) == {"velocities", "attitudes", "innovations", "navigation"}
    page = html(result)
    for title in ("Velocity at rest before and after", "The sequence", "in navigation"):
        assert title in page
    for row in (r for r in result.diagnostics["navigation"] if r["compensated"] == "all"):
        raw = next(r for r in result.diagnostics["navigation"]
                   if r["about"] == row["about"] and r["compensated"] == "none")  # fmt: skip
        assert np.linalg.norm(row["shift"][:2]) < 0.05 * np.linalg.norm(raw["shift"][:2])
        assert np.linalg.norm(row["velocity"][:2]) < 0.05 * np.linalg.norm(raw["velocity"][:2])


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gyro.bias.x", "gyro.misalignment.zy", "accel.asymmetry.y"])
def test_one_error_alone_comes_back(name):
    size = {"gyro.bias.x": 0.1 * DPH, "gyro.misalignment.zy": 60 * ARCSEC,
            "accel.asymmetry.y": 5e-5}[name]  # fmt: skip
    vector = ImuModel().coefficients().with_values({name: size})
    quiet = systematic.Session(rest_time=30.0, start_sd=0.0)
    made = simulated(session=quiet, model=ImuModel.from_coefficients(vector), noise=ImuNoise())
    result = trial(made, Settings(passes=4))
    c = result.coefficients
    truth = np.array([vector.value(n) for n in c.names])
    pull = c.cov @ (truth / c.prior_sd**2)  # of the prior, which is about zero
    assert np.abs(c.values + pull - truth).max() < 0.05 * size
    np.testing.assert_array_less(np.abs(c.values + pull - truth), 0.2 * c.sd)


def test_without_noise_there_is_no_bound():
    made = simulated(noise=ImuNoise())
    given = {"settings": Settings(passes=1), "noise": ImuNoise()}
    result = systematic.calibrate(made.log, site=SITE, **given)
    assert result.verdict.level is Level.PASS
    assert "bound" not in result.diagnostics and "sd / bound" not in html(result)


@pytest.mark.thorough
def test_extended_states_come_back():
    settings = Settings(lever_arms=True, delay=True, accel_quadratic=True)
    assert not settings.restarts and Settings().restarts
    model = replace(systematic.draw_errors("navigation", 4))
    model.accel_quadratic[range(3), range(3)] = np.array([12.0, -8.0, 5.0]) * UG / 9.80665**2
    made = simulated(settings, systematic.Session(rest_time=40.0, arms=0.03, delay=2e-3),
                     seed=4, model=model)  # fmt: skip
    result = trial(made, settings)
    c, truth = result.coefficients, made.size_effect.coefficients()
    assert (4 * c["accel.lever"].sd < 0.01).all() and 4 * c["accel.delay"].sd < 1e-4
    names = systematic.names_of(settings)
    assert names == c.names and names[-7:] == truth.names
    err = c.values - np.concatenate([made.model.coefficients(names[:-7]).values, truth.values])
    low, high = chi_square_limits(34)
    assert low < err @ np.linalg.solve(c.cov, err) < high
    assert "e_i = " in result.equation
    page = html(result)
    for words in ("accel.lever.xy", "result.apply(log)", "tau = "):
        assert words in page.replace("<wbr>", "")


@pytest.mark.thorough
def test_lever_arms_do_no_harm_where_every_rest_starts_anew():
    """An IMU whose accelerometers are centimetres apart, without telling the filter."""
    made = simulated(session=systematic.Session(rest_time=30.0, arms=0.03), seed=6)
    names = systematic.names_of(Settings())
    _, high = chi_square_limits(24)
    assert nees(trial(made), made.model, names) < high
    assert nees(trial(made, Settings(decorrelate=False)), made.model, names) > 4 * high


@pytest.mark.thorough
def test_the_published_steps_find_the_same(bending):
    settings, made = bending
    steps = settings.model_copy(update={"steps": "published", "passes": 1})
    result = trial(made, steps)
    names = systematic.names_of(steps)
    deflections = [n for n in names if "deflection" in n]
    assert nees(result, made.model, deflections) < chi_square_limits(6)[1]
    assert not failed(result)
    joint = trial(made, settings)
    assert nees(joint, made.model, names) < chi_square_limits(30)[1]
    sd = [r.coefficients["gyro.deflection"].sd.mean() for r in (joint, result)]
    assert sd[0] < sd[1] < 3 * sd[0]


@pytest.mark.thorough
def test_the_wrong_chirality_fits_worse(bending):
    settings, made = bending
    other = settings.model_copy(update={"chirality": 1})
    right, wrong = (trial(made, s).diagnostics["log_likelihood"] for s in (settings, other))
    assert right > wrong + 5


def test_a_prior_of_another_width_is_exchanged_exactly():
    """One linear measurement, with one prior and with the other."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(7, 3))
    y = rng.normal(size=7)
    base = Settings().sensors.layout
    layout = type(base)(base.coefficients[:3])

    def solved(mean, sd):
        cov = np.linalg.inv(A.T @ A + np.diag(sd**-2.0))
        return CoefficientVector(layout, cov @ (A.T @ y + mean / sd**2), cov, prior_sd=sd)

    wide = CoefficientVector(layout, np.array([0.3, -0.2, 1.0]), prior_sd=np.array([0.7, 2.0, 9.0]))
    used = np.array([1.0, 1.0, -1.0]), np.array([0.2, 0.3, 0.1])
    found, want = exchanged(solved(*used), used, wide), solved(wide.values, wide.prior_sd)
    np.testing.assert_allclose(found.values, want.values, rtol=1e-10)
    np.testing.assert_allclose(found.cov, want.cov, rtol=1e-10)


def test_a_narrow_prior_pulls_once_however_many_passes(nineteen):
    given = {"gyro.bias.x": (0.5 * DPH, 0.003 * DPH)}
    few, many = (trial(nineteen, Settings(passes=n), prior=given) for n in (2, 6))
    assert abs(few.coefficients.value("gyro.bias.x") - many.coefficients.value("gyro.bias.x")) < (
        0.05 * many.coefficients["gyro.bias.x"].sd[0]
    )
    assert "prior" in failed(many)


def test_noise_is_measured_where_it_is_not_declared(nineteen):
    said = trial(nineteen, noise=None).diagnostics["noise"]
    assert said["measured"]
    assert said["gyro"] == pytest.approx(NOISE.gyro.white, rel=0.05)
    assert said["accel"] == pytest.approx(NOISE.accel.white, rel=0.05)


@pytest.mark.thorough
def test_the_session_of_another_program():
    """Its author gave his sensors these errors, with the opposite sign in our model."""
    settings = Settings(accel_quadratic=True, lever_arms=True, delay=True, passes=5)
    result = systematic.trial(third_party(), site=Site.at(34 * DEG), settings=settings)
    assert result.status is Status.CONVERGED
    c, three = result.coefficients, np.array([1.0, 2.0, 3.0])
    truth = {
        "gyro.bias": -0.1 * DPH * three, "gyro.scale": -1e-5 * three,
        "gyro.misalignment": ARCSEC * np.array([10, 20, 30, 40, 50, 60]),
        "accel.misalignment": ARCSEC * 10 * three,
        "accel.quadratic": -10 * UG / 9.80665**2 * three, "accel.bias": -10 * UG * three,
        "accel.asymmetry": 0 * three,
    }  # fmt: skip
    for group, values in truth.items():
        assert (np.abs(c[group].values - values) < 3 * c[group].sd).all(), group
    # His gravity is not known to better than a tenth of a ppm.
    scale = c["accel.scale"].values + 1e-5 * three
    assert (np.abs(scale) < 3 * c["accel.scale"].sd + 0.1e-6).all()
    found = c.chosen([*LEVER.names, *OFFSET.names])
    want = -np.array([0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 1e-3])
    assert (np.abs(found.values - want) < 3 * found.sd).all()


# -- what it says ----------------------------------------------------------------------------------


def test_a_gyro_that_jumps_fails_the_checks(nineteen):
    gyro = nineteen.log.gyro.copy()
    gyro[len(gyro) // 2 :, 1] += 1.0 * DPH
    result = trial(replace(nineteen, log=replace(nineteen.log, gyro=gyro)))
    assert {"innovations", "rests"} & failed(result) or "velocities" in failed(result)
    assert result.verdict.level is not Level.PASS


def test_what_a_sequence_does_not_show_is_named():
    actions = [{"rest": "60 s"}]
    for _ in range(4):
        actions += [{"turn": "90 deg", "about": "y"}, {"rest": "60 s"}]
    text = campaign.template("systematic").replace('sequence = ["19 positions"]', "sequence = []")
    listed = "actions = [" + ", ".join(
        "{ " + ", ".join(f'{k} = "{v}"' for k, v in a.items()) + " }" for a in actions
    ) + "]"  # fmt: skip
    text = text.replace("actions = []", listed)
    settings = campaign.parse(text).settings
    assert settings.plan.name == "own sequence"
    result = trial(simulated(settings, systematic.Session(rest_time=None)), settings)
    assert "seen" in failed(result)
    (said,) = [f for f in result.findings if f.code == "systematic.unseen"]
    assert "gyro.scale.x" in said.message and "gyro.scale.y" not in said.message
    assert said.cure.startswith("Add ") and "quarter turns about each axis of the body" in said.cure


def test_passes_settle_where_a_short_sequence_hardly_shows_something():
    """Every pass is linear about the one before with the prior: else the rest would wander."""
    settings = Settings(sequence=())
    told = quarter_turns("short", "ENU", "+y +y +z -x +x +y +z -y", rest=60.0)
    made = simulate_systematic(
        told, site=SITE, model=systematic.draw_errors("navigation", 1), noise=NOISE, rate=50.0,
        table=TableErrors(60 * ARCSEC), seed=1,
    )  # fmt: skip
    result = trial(made, settings)
    assert result.status is Status.CONVERGED and not failed(result)
    c = result.coefficients
    assert (c.sd / c.prior_sd).max() > 0.02  # hardly shown, against 0.001 by the nineteen
    score = nees(result, made.model, c.names)
    low, high = chi_square_limits(len(c))
    assert low < score < high


@pytest.mark.thorough
def test_a_deflection_that_the_session_cannot_see_is_refused(nineteen, bending):
    bent = Settings(deflection="coupled6")
    with refuses("systematic.deflection_unseen") as caught:
        trial(nineteen, bent)
    assert re.match(
        r"The model of deflection 'coupled6' has 6 parameters, and this session tells [0-5] "
        r"combinations of them better than 3 arcsec/g. It cannot see: \+\d.\d\d deflection\.",
        caught.value.message,
    )
    assert "six poses" in caught.value.cure
    settings, made = bending
    direct = settings.model_copy(update={"deflection": "direct6"})
    with pytest.raises(FoucaultError, match="tells 5 combinations"):
        trial(made, direct)
    result = trial(made, direct, prior={"deflection": (0.0, 3 * ARCSEC / 9.80665)})
    (said,) = [f for f in result.findings if f.code == "systematic.deflection_prior"]
    assert said.message.startswith("Of 6 parameters of the model of deflection 'direct6' this ")


def test_settings_that_contradict_one_another():
    for text, words in (
        ('steps = "published"', 'Take steps = "joint", or choose a model of deflection.'),
        ('sequence = ["20 positions"]', "There is no sequence '20 positions'."),
    ):
        key = text.split(" = ")[0]
        lines = [
            text if line.startswith(f"{key} = ") else line
            for line in campaign.template("systematic").splitlines()
        ]
        with pytest.raises(FoucaultError) as caught:
            campaign.parse("\n".join(lines))
        assert words in str(caught.value)
    with refuses("systematic.published"):
        Settings(steps="published")
    with refuses("systematic.no_sequence") as caught:
        simulated(Settings(sequence=()))
    assert "No sequence is declared" in caught.value.message


def test_published_steps_need_two_sequences(nineteen):
    with refuses("systematic.first_part") as caught:
        trial(nineteen, Settings(steps="published", deflection="coupled6"))
    assert caught.value.message.endswith("over those that follow; one sequence is declared.")


def test_a_site_without_a_latitude(nineteen):
    with refuses("systematic.site") as caught:
        trial(nineteen, site=Site(9.81))
    assert "a systematic calibration needs the Earth's rate" in caught.value.message


def test_another_start_and_other_axes_than_declared(nineteen):
    log = nineteen.log
    accel = log.accel[:, [1, 2, 0]]
    gyro = log.gyro[:, [1, 2, 0]]
    with refuses("systematic.start"):
        trial(replace(nineteen, log=replace(log, accel=accel, gyro=gyro)))
    with pytest.raises(FoucaultError) as caught:
        trial(nineteen, Settings(sequence=("9 positions",)))
    assert caught.value.code in ("systematic.start", "systematic.count")


def test_a_log_as_it_is_found_is_recognised(nineteen):
    result = trial(nineteen, Settings(sequence=()))
    (said,) = result.findings
    assert said.code == "systematic.recognised"
    assert said.message == "The turns of the log are those of the sequence '19 positions'."
    assert result.diagnostics["sequence"]["name"] == "as found"
    assert result.diagnostics["sequence"]["labels"][:2] == ["rest 1", "rest 2"]


def test_an_interval_longer_than_the_rests_is_refused(nineteen):
    with refuses("systematic.interval", match=r"With interval = 70 s rest \d+, of \d+ s"):
        trial(nineteen, Settings(interval=70.0))


def test_a_first_rest_that_is_too_short(nineteen):
    late = replace(nineteen, log=nineteen.log[16 * 25 :])
    with refuses("systematic.first_rest") as caught:
        trial(late)
    assert re.match(r"The first rest lasts 1\d\.\d s; the attitude at the start needs 20 s or more",
                    caught.value.message)  # fmt: skip


def test_rests_that_all_move(nineteen):
    accel = nineteen.log.accel.copy()
    accel[:, 1:] += 0.01 * nineteen.log.time[:, None] * [1.0, -0.7]
    with refuses("systematic.all_move") as caught:
        trial(replace(nineteen, log=replace(nineteen.log, accel=accel)), Settings(sequence=()))
    assert caught.value.message == "Of 19 rests 0 are still; it takes two or more."


def test_biases_that_leave_no_heading(nineteen):
    wide = {"gyro.bias": (0.0, 20 * DPH)}
    said = {f.code: f for f in trial(nineteen, prior=wide).findings}
    assert "systematic.start_heading" in said
    assert re.search(r"uncertain by \d+ deg", said["systematic.start_heading"].message)


def test_what_is_usual_covers_what_is_estimated():
    full = Settings(sequence=BOTH, deflection="general18", lever_arms=True, delay=True,
                    accel_quadratic=True, gyro_asymmetry=True)  # fmt: skip
    known = CoefficientVector.prior(
        full.sensors.layout,
        {k: v for k, v in PRIOR.items()
         if any(n == k or n.startswith(f"{k}.") for n in full.sensors.layout.names)},
    )  # fmt: skip
    assert np.isfinite(known.prior_sd).all()
    assert len(full.sensors) == 24 + 18 + 3 + 3 + 6 + 1
    assert len(NAMES) == 9


def test_a_rest_that_moves_is_left_out(nineteen):
    """It tilts by 20 arcsec in every second of its thirty."""
    log = nineteen.log
    rest = nineteen.told.positions[4]
    inside = (log.time >= rest.start) & (log.time <= rest.end)
    accel, gyro = log.accel.copy(), log.gyro.copy()
    rate = 20 * ARCSEC
    axis = int(np.abs(log.accel[inside].mean(axis=0)).argmin())
    up = int(np.abs(log.accel[inside].mean(axis=0)).argmax())
    third = 3 - axis - up
    gyro[inside, axis] += rate
    # df / dt = f x w; it goes on tilted, as the gyro says.
    sign = 1.0 if (third + 1) % 3 == up else -1.0
    tilt = rate * np.clip(log.time - rest.start, 0.0, rest.end - rest.start)
    still = log.time <= rest.end
    accel[still, third] -= sign * tilt[still] * log.accel[still, up]
    moving = replace(nineteen, log=replace(log, accel=accel, gyro=gyro))
    result = trial(moving, Settings(sequence=()))
    assert "systematic.rest_moves" in codes(result)
    assert result.diagnostics["sequence"]["rests"] == 18
    assert "rest 5" not in result.diagnostics["sequence"]["labels"]


@pytest.mark.thorough
def test_no_deflection_where_there_is_none():
    """Six parameters of a rigid instrument, four sessions: inside their promise about zero."""
    settings, score = Settings(sequence=BOTH, deflection="coupled6"), 0.0
    # Nothing to speak of, so that `simulate` draws no deflection of its own.
    for seed in range(4):
        rigid = replace(systematic.draw_errors("navigation", seed), deflection=np.full(
            (3, 3, 3), 1e-30))  # fmt: skip
        result = trial(simulated(settings, seed=seed, model=rigid), settings)
        names = [n for n in systematic.names_of(settings) if "deflection" in n]
        score += nees(result, rigid, names)
    low, high = chi_square_limits(6 * 4)
    assert low < score < high


@pytest.mark.thorough
@pytest.mark.parametrize("line", [
    'sequence = ["spins, simple 6"]',
    'sequence = ["spins, icosahedral 6"]',
    'actions = [{ turn = "90 deg", about = "y" }, { rest = "100 s" }, { turn = "90 deg", about = '
    '"x" }, { rest = "100 s" }, { turn = "90 deg", about = "z" }]',
])  # fmt: skip
def test_a_sequence_without_a_rest_at_its_ends_is_simulated_with_one(line):
    text = campaign.template("systematic").replace('sequence = ["19 positions"]', line)
    text = text.replace("actions = []\n", "") if line.startswith("actions") else text
    text = text.replace('rate = "50 Hz"', 'rate = "20 Hz"\nrest_time = "60 s"')
    one = campaign.parse(text, "spins.toml")
    simulation = campaign.simulate(one, seed=1).simulation
    assert isinstance(simulation.sequence.actions[0], Rest)
    assert isinstance(simulation.sequence.actions[-1], Rest)
    result = systematic.trial(simulation.log, site=one.site, settings=one.settings)
    sd = result.coefficients.sd
    assert (np.isfinite(sd) & (sd > 0)).all()
    assert "systematic.rest_missing" not in {f.code for f in result.findings}
