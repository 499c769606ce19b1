"""What a systematic calibration says of errors that it does not estimate, or does not see."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from foucault.diagnose.deflection import UNIT, Told, judged
from foucault.models.deflection import deflection_model
from foucault.models.earth import Site
from foucault.procedures import systematic
from foucault.procedures.systematic.choice import bending
from foucault.procedures.systematic.settings import PRIOR, Settings
from foucault.result import Level
from make_sequence import DEG, DPH, NOISE
from refusals import refuses
from sessions import failed

UG = 9.80665e-6
SITE = Site.at(40 * DEG, 100.0)
BOTH = ("19 positions", "spins, simple 6")
SHORT = systematic.Session(rest_time=30.0, rate=25.0)
QUADRATIC = np.array([20.0, -15.0, 12.0]) * UG / 9.80665**2
ASYMMETRY = [f"accel.asymmetry.{axis}" for axis in "xyz"]


def simulated(settings, *, bend=0.0, quadratic=0.0, session=SHORT, seed=1):
    """Simulate a session of an instrument that bends by some arcsec/g, or not at all."""
    theta = bend * np.array([2.0, -1.5, 3.0, 2.5, -2.0, 1.0]) * UNIT
    T = deflection_model("coupled6").tensor(theta) if bend else np.full((3, 3, 3), 1e-30)
    model = replace(systematic.draw_errors("navigation", seed), deflection=T)
    model.accel_quadratic[range(3), range(3)] = quadratic
    return systematic.simulate(
        session, settings=settings, model=model, noise=NOISE, site=SITE, seed=seed
    )


def calibrated(made, settings, **more):
    return systematic.calibrate(made.log, site=SITE, settings=settings, noise=NOISE, **more)


def trial(made, settings, **more):
    return systematic.trial(made.log, site=SITE, settings=settings, noise=NOISE, **more)


def told(result):
    return {f.code: f for f in result.findings}


@pytest.fixture(scope="module")
def curved():
    """Make nineteen positions of accelerometers with quadratic terms."""
    return simulated(Settings(), quadratic=QUADRATIC)


# -- asymmetry and quadratic terms -----------------------------------------------------------------


def test_asymmetry_that_stands_for_a_quadratic_term_too(curved):
    result = calibrated(curved, Settings())
    c = result.coefficients["accel.asymmetry"]
    true = curved.model.coefficients(ASYMMETRY).values
    assert not failed(result) and np.abs(c.values - true).max() > 10 * c.sd.max()
    assert (np.abs(c.values - true - SITE.gravity * QUADRATIC) < 4 * c.sd).all()
    said = told(result)["systematic.stands_for"]
    assert said.severity == "note"
    assert "a quadratic term of the accelerometers x, y, z and an asymmetry" in said.message
    assert "accel.asymmetry is accel.asymmetry + g accel.quadratic, and its" in said.message
    assert said.cure.endswith("slanting, such as at 45 deg, and set accel_quadratic = true.")


@pytest.mark.thorough
def test_a_quadratic_term_that_stands_for_asymmetry_too(curved):
    other = Settings(accel_quadratic=True, accel_asymmetry=False)
    said = told(calibrated(curved, other))["systematic.stands_for"]
    assert "accel.quadratic is accel.quadratic + accel.asymmetry / g, and its" in said.message
    assert said.cure.endswith("set accel_asymmetry = true.")


@pytest.mark.thorough
def test_slanting_rests_tell_them_apart():
    settings = Settings(sequence=BOTH)
    made = simulated(settings, quadratic=QUADRATIC)
    said = told(calibrated(made, settings))
    assert said["systematic.stands_for"].cure.endswith("Else set accel_quadratic = true.")
    # Not for a deflection, which looks a little like it.
    assert set(said) == {"systematic.stands_for", "systematic.curves"}
    assert "better with accel.quadratic, which is left out" in said["systematic.curves"].message
    assert said["systematic.curves"].cure.startswith("Set accel_quadratic = true. Checks that")
    assert not calibrated(made, settings.model_copy(update={"accel_quadratic": True})).findings
    assert set(told(calibrated(simulated(settings), settings))) == {"systematic.stands_for"}


@pytest.mark.thorough
def test_a_crooked_table_hardly_tells_them_apart():
    """Turns off by degrees: the session tells a little of each, and far less than of the sum."""
    rough = systematic.Session(rest_time=60.0, angle_sd=1.5 * DEG, start_sd=3 * DEG)
    made = simulated(Settings(), quadratic=QUADRATIC, session=rough, seed=6)
    assert not failed(trial(made, Settings(sequence=(), accel_quadratic=True)))
    said = told(calibrated(made, Settings(sequence=())))["systematic.stands_for"]
    assert "accelerometers x, y, z and" in said.message


def test_only_the_sum_is_seen_where_both_are_estimated(curved):
    result = trial(curved, Settings(accel_quadratic=True))
    assert failed(result) == {"seen"}
    (reason,) = result.verdict.reasons
    assert reason.startswith("Of asymmetry and quadratic term of the accelerometers x, y, z the ")
    assert "only the sum, accel.asymmetry + g accel.quadratic" in reason
    (said,) = result.findings
    assert (said.code, said.message) == ("systematic.only_sum", reason)
    assert "leave out accel_quadratic" in said.cure


def test_knowing_one_of_them_tells_the_other(curved):
    known = {"accel.quadratic": (0.0, 20 * UG / 9.80665**2)}
    result = trial(curved, Settings(accel_quadratic=True), prior=known)
    assert not failed(result) and set(told(result)) == {"systematic.only_prior"}


# -- what is known beforehand ----------------------------------------------------------------------


def test_what_is_known_well_beforehand_is_no_fault():
    made = simulated(Settings())
    truth = made.model.coefficients(["gyro.bias.x", "gyro.bias.y", "gyro.bias.z"]).values
    known = {
        f"gyro.bias.{axis}": (value, 0.0005 * DPH) for axis, value in zip("xyz", truth, strict=True)
    }
    result = trial(made, Settings(), prior=known)
    assert result.verdict.level is Level.PASS
    (said,) = result.findings
    assert said.code == "systematic.only_prior" and said.severity == "note"
    assert said.message == (
        "What is said of gyro.bias.x, gyro.bias.y, gyro.bias.z is what [prior] says; the session "
        "adds hardly anything."
    )


def test_no_better_than_usual_is_no_knowledge():
    """Four turns about y show no scale factor of x, and a prior as wide as always is no help."""
    turn = {"turn": "90 deg", "about": "y"}
    actions = [{"rest": "60 s"}, *[turn, {"rest": "60 s"}] * 4]
    settings = Settings.model_validate({"sequence": (), "actions": actions})
    made = simulated(settings, session=systematic.Session(rest_time=None))
    scale = {"gyro.scale": PRIOR["gyro.scale"]}
    for prior in ({}, scale):
        result = trial(made, settings, prior=prior)
        assert "seen" in failed(result)
        assert "gyro.scale.x" in told(result)["systematic.unseen"].message
    result = trial(made, settings, prior={"gyro.scale": (0.0, 5e-4)})
    assert "gyro.scale.x" not in told(result)["systematic.unseen"].message
    assert "gyro.scale.x" in told(result)["systematic.only_prior"].message


# -- settings --------------------------------------------------------------------------------------


def test_lever_arms_that_are_forgotten_at_every_rest():
    with refuses("systematic.levers_forgotten", "Leave out decorrelate"):
        Settings(lever_arms=True, decorrelate=True)
    assert Settings(lever_arms=True, decorrelate=False).lever_arms


# -- gyros that bend -------------------------------------------------------------------------------


def test_gyros_that_bend_are_named_before_a_check_fails():
    made = simulated(Settings(), bend=0.3)
    result = calibrated(made, Settings())
    assert failed(result) == {"left out"}  # said, and no pass beside it
    said = told(result)["systematic.bends"]
    assert said.severity == "warning" and 'deflection is "none"' in said.message
    assert said.cure.startswith("Add spins of ten turns") and 'deflection = "choose"' in said.cure


@pytest.mark.thorough
def test_gyros_that_bend_in_spins_are_to_be_chosen_of():
    settings = Settings(sequence=BOTH)
    result = calibrated(simulated(settings, bend=1.0), settings)
    assert {"innovations", "velocities"} <= failed(result)
    said = told(result)["systematic.bends"]
    assert "less than 1e-99 (said below 0.5 %)" in said.message
    assert said.cure.startswith('Set deflection = "choose". Checks that fail then too show another')


@pytest.mark.thorough
def test_lever_arms_are_not_taken_for_bending():
    settings = Settings(decorrelate=False)
    made = simulated(settings, session=systematic.Session(rest_time=30.0, arms=0.03))
    result = calibrated(made, settings)
    assert {"innovations", "rests", "velocities"} <= failed(result)
    assert "systematic.bends" not in told(result)


@pytest.mark.thorough
def test_the_false_alarm_rate_of_bending_is_one_percent_or_less():
    """Imagined sessions without bending, of a filter that fits its noise; 3 % is seen with 96 %."""
    rng = np.random.default_rng(5)
    A = rng.normal(size=(12, 18)) / UNIT  # twelve combinations are seen
    J, dof, runs = A.T @ A, 3000, 700
    alarms = 0
    for _ in range(runs):
        choice = judged(Told(J, A.T @ rng.standard_normal(12)), {"deflection": PRIOR["deflection"]})
        run = SimpleNamespace(nis=np.array([rng.chisquare(dof)]), measured=np.array([dof]))
        alarms += bending(choice, SimpleNamespace(run=run))[0] < 0.01
    assert alarms <= 13  # binomial, 1 % of 700, once in a hundred
