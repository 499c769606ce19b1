"""Alignment from the means of two vectors: exact, its covariance, its limit."""

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.rotation import angles_of, exp
from foucault.navigate.align import (
    latitude_seen,
    two_vector,
    two_vector_covariance,
    two_vector_slopes,
)
from foucault.navigate.inertial_frame import SensorErrors
from make_alignment import DPH, LN100_SITE, attitude_error, ln100_log, resting, with_errors
from refusals import refuses

SITE = Site.at(np.radians(-37.0), 250.0)


def _means(increments):
    length = increments.dt.sum()
    return increments.dvel_b.sum(axis=0) / length, increments.dtheta_b.sum(axis=0) / length


@pytest.mark.parametrize("heading", [0.0, 1.0, np.pi, 5.0])
def test_without_noise_the_attitude_comes_back(heading):
    increments, C_nb = resting(SITE, 10.0, 0.01, heading, 0.3, -2.0)
    f, w = _means(increments)
    np.testing.assert_allclose(two_vector(f, w), C_nb, atol=1e-10)
    np.testing.assert_allclose(latitude_seen(f, w), SITE.latitude, atol=1e-9)


def test_up_is_fitted_exactly():
    rng = np.random.default_rng(3)
    f, w = rng.normal(size=(2, 3))
    C_nb = two_vector(f, w)
    np.testing.assert_allclose(C_nb @ f, [0, 0, np.linalg.norm(f)], atol=1e-12)
    assert (C_nb @ w)[0] == pytest.approx(0, abs=1e-12) and (C_nb @ w)[1] > 0


def test_slopes_are_the_derivatives():
    C_nb = exp(np.array([0.4, -1.0, 2.0]))
    f, w = C_nb.T @ [0, 0, SITE.gravity], C_nb.T @ earth_rate_n(SITE.latitude)
    for slope, x, size in zip(
        two_vector_slopes(SITE.latitude, SITE.gravity), (f, w), (1e-4, 1e-9), strict=True
    ):
        for k in range(3):
            error = size * C_nb.T[:, k]
            C_est = two_vector(f + error, w) if x is f else two_vector(f, w + error)
            phi = attitude_error(C_est, C_nb)
            np.testing.assert_allclose(phi / size, slope[:, k], rtol=1e-4, atol=1e-5 / size * 1e-4)


def test_a_heading_error_is_phi_up():
    C_nb = exp(np.array([0.0, 0.0, 0.3])).T
    C_est = (np.eye(3) - np.array([[0, -1e-6, 0], [1e-6, 0, 0], [0, 0, 0]])) @ C_nb
    assert angles_of(C_est)[0] - angles_of(C_nb)[0] == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("latitude", [-37.0, 60.0])
def test_covariance_by_monte_carlo(latitude):
    """NEES of 400 alignments, two-sided, two latitudes at 1 % together."""
    site = Site.at(np.radians(latitude))
    sensors = SensorErrors(np.array([1, 4, 2]) * 1e-12, np.array([2, 1, 3]) * 1e-8,
                           0.02 * DPH, 5e-4)  # fmt: skip
    rng = np.random.default_rng(11)
    total = 0.0
    for _ in range(400):
        increments, C_nb = resting(site, 100.0, 1.0, *rng.uniform(-1.4, 1.4, 3))
        f, w = _means(with_errors(increments, sensors, rng))
        C_est = two_vector(f, w)
        cov = two_vector_covariance(C_est, site.latitude, site.gravity, *sensors.mean_cov(100.0))
        phi = attitude_error(C_est, C_nb)
        total += phi @ np.linalg.solve(cov, phi)
    low, high = chi_square_limits(3 * 400, tests=2)
    assert low < total < high
    low, high = chi_square_limits(3 * 400, tests=2)
    assert not low < total / 1.5**2 < high, "a covariance 1.5 sd too large is noticed"


def test_azimuth_limit_of_a_gyro_bias():
    limit = azimuth_from_gyro_bias(0.01 * DPH, SITE.latitude)
    increments, C_nb = resting(SITE, 10.0, 0.1, 0.0)
    f, w = _means(increments)
    east = np.array([0.01 * DPH, 0.0, 0.0])
    assert abs(attitude_error(two_vector(f, w + east), C_nb)[2]) == pytest.approx(limit, rel=1e-6)


def test_no_north_without_a_rate():
    with refuses("alignment.parallel", "show no north"):
        two_vector(np.array([0, 0, 9.8]), np.zeros(3))


def test_ln100():
    log = ln100_log()
    f, w = log.accel.mean(axis=0), log.gyro.mean(axis=0)
    heading = np.degrees(angles_of(two_vector(f, w))[0])
    assert 7.29 <= round(heading, 2) <= 7.33
    assert round(np.linalg.norm(w) / DPH, 3) == 14.755
    assert round(np.degrees(latitude_seen(f, w)), 4) == 51.0826
    assert abs(np.linalg.norm(w) / EARTH_RATE - 1) < 0.02
    assert abs(np.degrees(LN100_SITE.latitude) - np.degrees(latitude_seen(f, w))) < 0.01
