"""Fine alignment: consistent by zero and by given velocity, and by two positions."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.navigate.fine_alignment import by_velocity, two_position
from foucault.navigate.increments import Increments
from foucault.navigate.inertial_frame import SensorErrors
from foucault.plans.manoeuvres import Accelerate, Rest, Rotate, Straight, Turn
from make_alignment import DPH, attitude_error, drawn_biases, moving, resting, with_errors
from refusals import refuses

SITE = Site.at(np.radians(45.0), 50.0)
SENSORS = SensorErrors(np.full(3, 9e-14), np.full(3, 1e-10), 0.02 * DPH, 5e-4)
DISTURBANCE = 1e-3


def _shaken(increments, rng):
    """Add a velocity disturbance that is white from sample to sample."""
    v = DISTURBANCE * rng.normal(size=(len(increments) + 1, 3))
    return Increments.of(increments.time, increments.dtheta_b,
                         increments.dvel_b + np.diff(v, axis=0))  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("given", [False, True], ids=["at rest", "given velocity"])
def test_consistent_by_monte_carlo(given):
    """NEES of attitude and NIS of 60 alignments, two-sided, four tests at 1 % together."""
    rng = np.random.default_rng(31)
    attitude, nis, dof, trials = 0.0, 0.0, 0, 60
    velocity = None
    if given:  # a car on a bend, and then faster
        plan = [Straight(60.0), Turn(np.radians(50), 60.0), Accelerate(16.0, 60.0), Straight(60.0)]
        exact, truth = moving(plan, SITE, 5.0, heading=0.6, speed=10.0)
        C_nb, velocity = truth.C_nb[-1], truth.velocity_n
    else:
        exact, C_nb = resting(SITE, 240.0, 0.2, 2.0, 0.1, -0.2)
    for _ in range(trials):
        made = _shaken(with_errors(exact, SENSORS, rng), rng)
        fit = by_velocity(made, SITE, SENSORS, velocity)
        phi = attitude_error(fit.C_nb, C_nb)
        attitude += phi @ np.linalg.solve(fit.cov, phi)
        nis, dof = nis + fit.nis.sum(), dof + fit.dof.sum()
    low, high = chi_square_limits(3 * trials, tests=4)
    assert low < attitude < high
    low, high = chi_square_limits(dof, tests=4)
    assert low < nis < high


def _turned(angle):
    plan = [Rest(120.0), Rotate("up", angle, np.radians(10.0)), Rest(132.0)]
    exact, truth = moving(plan, SITE, 10.0, heading=0.5, pitch=0.02, roll=-0.02)
    return exact, truth.C_nb


RESTS = ((0.0, 120.0), (150.0, 270.0))


@pytest.mark.thorough
def test_two_positions_show_the_gyro_bias():
    """NEES of attitude and gyro biases of 60, at 1 %; azimuth far below the limit of one."""
    rng = np.random.default_rng(8)
    exact, C_nb = _turned(np.pi)
    attitude, biases, trials = 0.0, 0.0, 60
    limit = azimuth_from_gyro_bias(SENSORS.gyro_bias_sd, SITE.latitude)
    for _ in range(trials):
        true = drawn_biases(SENSORS, rng)
        made = _shaken(with_errors(exact, SENSORS, rng, true), rng)
        fit = two_position(made, SITE, SENSORS, RESTS)
        phi = attitude_error(fit.C_nb, C_nb[-1])
        attitude += phi @ np.linalg.solve(fit.cov, phi)
        error = fit.run.coefficients[-1][:3] - true[0]
        biases += error @ np.linalg.solve(fit.run.cov[9:12, 9:12], error)
        assert np.sqrt(fit.cov[2, 2]) < 0.35 * limit
    low, high = chi_square_limits(3 * trials, tests=2)
    assert low < attitude < high
    assert low < biases < high


def test_two_positions_of_another_tilt():
    """NEES of 40 with biased accelerometers, at 1 %: along up they read another bias."""
    sensors = replace(SENSORS, accel_bias_sd=2e-3)
    rng = np.random.default_rng(12)
    plan = [Rest(120.0), Rotate("up", np.pi, 0.2), Rotate("x", 0.5, 0.2), Rest(130.0)]
    exact, truth = moving(plan, SITE, 10.0, heading=0.5, pitch=0.02, roll=-0.02)
    end = float(exact.time[-1])
    total, trials = 0.0, 40
    for _ in range(trials):
        made = _shaken(with_errors(exact, sensors, rng), rng)
        fit = two_position(made, SITE, sensors, (RESTS[0], (end - 120.0, end)))
        phi = attitude_error(fit.C_nb, truth.C_nb[-1])
        total += phi @ np.linalg.solve(fit.cov, phi)
    low, high = chi_square_limits(3 * trials)
    assert low < total < high


def test_one_position_does_not():
    exact, _ = resting(SITE, 270.0, 0.1, 0.5)
    made = _shaken(with_errors(exact, SENSORS, np.random.default_rng(0)), np.random.default_rng(1))
    fit = by_velocity(made, SITE, SENSORS)
    limit = azimuth_from_gyro_bias(SENSORS.gyro_bias_sd, SITE.latitude)
    assert np.sqrt(fit.cov[2, 2]) > 0.98 * limit


def test_two_positions_need_a_turn():
    exact, _ = resting(SITE, 270.0, 0.1, 0.5)
    made = _shaken(exact, np.random.default_rng(1))
    with refuses("alignment.two_rests", match=r"differ by 0\.0 deg in heading"):
        two_position(made, SITE, SENSORS, RESTS)
    for wrong in (RESTS[:1], RESTS[::-1], ((0.0, 100.0), (150.0, 400.0))):
        with pytest.raises(FoucaultError, match=r"given are \d+ s to \d+ s") as caught:
            two_position(made, SITE, SENSORS, wrong)
        assert "(" not in caught.value.message
    with pytest.raises(FoucaultError, match="No rests are given"):
        two_position(made, SITE, SENSORS, ())
