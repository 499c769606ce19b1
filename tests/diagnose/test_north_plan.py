"""What a plan for north seeking will give, against formulas and against the field solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import units
from foucault.coefficients import CoefficientVector
from foucault.estimate.north import Known, solve
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import SEEKER, Compensation
from foucault.models.rotation import turned
from foucault.plans import north_orders as plans
from foucault.plans.north_stops import LINEAR_DRIFT, Conditions, poses, predict, readings
from foucault.simulate.noise import mean_noise

LATITUDE = np.radians(30.0)
RATE = EARTH_RATE * np.cos(LATITUDE)
ARW = units.parse("0.003 deg/sqrt(h)", "angle random walk")
NOISE = ImuNoise(TriadNoise(5e-5), TriadNoise(ARW))
LEVEL = poses(0.0)
TIME = 300.0
BASE = Conditions(LATITUDE, NOISE)
ARCMIN = np.radians(1 / 60)


def predicted(order: plans.Order, conditions: Conditions = BASE, at=LEVEL):
    dwells = order.dwells(TIME, 0.0, at[:, 0])
    return predict(dwells, at, conditions, near=order is plans.PAIR)


@pytest.mark.parametrize("name", ["published", "sequential", "palindrome", "3 positions"])
def test_white_noise(name: str) -> None:
    found = predicted(plans.orders(name)[0])
    expected = np.sqrt(2) * ARW / (np.sqrt(TIME) * RATE)
    assert found.sd == pytest.approx(expected, rel=1e-6)
    assert found.worst == pytest.approx(expected, rel=1e-6)
    assert max(found.sources, key=found.sources.__getitem__) == "gyro noise"


def test_the_floor_and_a_given_noise_per_position() -> None:
    assert predicted(plans.PAIR).sd == pytest.approx(ARW / (np.sqrt(TIME) * RATE), rel=1e-5)
    one = units.parse("0.01 deg/h", "angular rate")
    loud = TriadNoise(white=one * np.sqrt(TIME / 4))
    found = predicted(plans.PUBLISHED, replace(BASE, noise=ImuNoise(NOISE.accel, loud)))
    assert np.degrees(found.sd) == pytest.approx(0.0311, abs=5e-5)


def test_linear_drift() -> None:
    drift = units.parse("0.01 deg/h", "angular rate") / (TIME / 4)
    orders = (plans.PUBLISHED, plans.SEQUENTIAL, plans.PALINDROME)
    errors = [np.degrees(predicted(o).drift_error * drift) for o in orders]
    np.testing.assert_allclose(errors, [0.0311, 0.0622, 0.0], atol=5e-5)
    white = predicted(plans.PUBLISHED).sd
    for order, cost in zip(orders, (1.0572, 1.5, 1.0), strict=True):
        free = predicted(order, replace(BASE, drift=1e3 * drift))
        assert free.sd / white == pytest.approx(cost, abs=1e-3)  # estimated without a prior to use
        ignored = predicted(order, replace(BASE, drift=drift, drift_estimated=False))
        rest = ignored.sources[LINEAR_DRIFT]
        assert ignored.sd**2 - white**2 == pytest.approx(rest, abs=1e-12)
        assert rest <= (predicted(order).drift_error * drift) ** 2


def test_other_sources() -> None:
    white = predicted(plans.PUBLISHED).sd
    tilted = predicted(plans.PUBLISHED, replace(BASE, tilt=0.1), poses(np.radians(10.0)))
    assert white < tilted.sd < 1.01 * white
    level = predicted(plans.PUBLISHED, replace(BASE, level_sd=ARCMIN)).sources["tilt: level"]
    assert np.sqrt(level) == pytest.approx(ARCMIN * np.tan(LATITUDE), rel=1e-3)
    # Small, so that the weights stay those of the noise; the mean of sin^4 is 3 / 8.
    index = predicted(plans.PUBLISHED, replace(BASE, index_sd=1e-3 * ARCMIN)).sources["indexing"]
    assert np.sqrt(index) == pytest.approx(1e-3 * ARCMIN * np.sqrt(3 / 8), rel=1e-3)
    bias = units.parse("0.01 deg/h", "angular rate")
    names = ("gyro.bias.x", "gyro.bias.y")
    vector = CoefficientVector(SEEKER.subset(names), np.zeros(2), np.eye(2) * bias**2)
    made = predicted(plans.PUBLISHED, replace(BASE, compensation=Compensation(vector)))
    assert np.sqrt(made.sources["calibration: bias"]) == pytest.approx(bias / RATE, rel=1e-3)
    tilt = poses(np.radians(10.0))
    rough = replace(BASE, latitude_sd=np.radians(1.0))
    assert predicted(plans.PUBLISHED, rough, tilt).sources["latitude"] > 0
    assert predicted(plans.PUBLISHED, replace(rough, latitude_known=False), tilt).sd > tilted.sd


@pytest.mark.thorough
def test_the_field_solution_scatters_as_predicted() -> None:
    gyro = replace(NOISE.gyro, bias_instability=units.parse("0.03 deg/h", "angular rate"))
    conditions = replace(BASE, noise=ImuNoise(NOISE.accel, gyro))
    n, rng = 3000, np.random.default_rng(3)
    orders = (plans.PUBLISHED, plans.PALINDROME, plans.continuous(3), plans.two_stage(0.2))
    low, high = chi_square_limits(n, tests=len(orders))
    for order in orders:
        at = np.resize(LEVEL, (n, 3))
        made = readings(order.dwells(TIME, 0.0, at[:, 0]), at, conditions)
        one = made.of(0)
        noise = mean_noise(gyro, one.start, one.time, 0.1, n, rng)
        assert made.accel is not None
        force = 5e-5 / np.sqrt(made.time) * rng.standard_normal(len(made))
        made = replace(made, gyro=made.gyro + noise.T.ravel(), accel=made.accel + force[:, None])
        found = solve(
            reduce(made, conditions.noise, Nuisance()), Known(gravity(LATITUDE), LATITUDE)
        )
        error = turned(found.angles[:, 0] - at[:, 0])
        assert low <= np.sum((error / predicted(order, conditions).sd) ** 2) <= high
