"""Alignment in inertial space: exact, its covariance, sway, and a standing vehicle."""

import numpy as np
import pytest
from scipy.signal import lfilter

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site, earth_rate_n
from foucault.models.rotation import exp
from foucault.navigate.inertial_frame import (
    SensorErrors,
    correlation_time,
    gravity_velocity,
    inertial_frame,
)
from foucault.plans.manoeuvres import Accelerate, Rotate, Straight, Sway, Turn
from make_alignment import DPH, attitude_error, moving, resting, with_errors
from refusals import refuses

SITE = Site.at(np.radians(50.0), 100.0)


def test_gravity_turns_with_the_earth():
    t = np.linspace(0, 600, 60001)
    w = earth_rate_n(SITE.latitude)
    f = exp(np.outer(t, w))[:, :, 2] * SITE.gravity
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (f[1:] + f[:-1]) * 0.01, axis=0)])
    np.testing.assert_allclose(
        gravity_velocity(t, SITE.latitude, SITE.gravity), sums, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("heading", [0.2, 3.0, 5.5])
def test_without_noise_the_attitude_comes_back(heading):
    increments, C_nb = resting(SITE, 60.0, 0.02, heading, -0.4, 1.0)
    fit = inertial_frame(increments, SITE)
    np.testing.assert_allclose(attitude_error(fit.C_nb, C_nb), 0, atol=2e-8)
    assert fit.gravity_seen == pytest.approx(SITE.gravity, rel=1e-12)


def test_sway_and_a_turn_do_not_matter():
    """A ship at the quay that swings round by 100 deg: arcseconds level, 0.05 deg in azimuth."""
    sway = {"angles": (0.02, 0.03, 0.08), "shift": (0.3, 0.2, 0.2), "tones": 3, "fade": 5.0}
    plan = [
        Sway(140.0, 6.0, seed=1, **sway), Rotate("up", -np.radians(100), 0.1, ramp=5.0),
        Sway(140.0, 8.0, seed=2, **sway),
    ]  # fmt: skip
    increments, truth = moving(plan, SITE, 100.0, heading=0.5)
    fit = inertial_frame(increments, SITE)
    phi = attitude_error(fit.C_nb, truth.C_nb[-1])
    assert np.all(np.abs(phi) < 3.3 * np.sqrt(np.diag(fit.cov))), "three at 1 % together"
    assert np.all(np.abs(phi[:2]) < 3 / 206265) and abs(phi[2]) < np.radians(0.05)
    # The velocity of the ship itself is what is left, less what the fit takes for its own.
    ratio = fit.disturbance_sd / truth.velocity_n.std(axis=0)
    assert np.all((ratio > 0.5) & (ratio < 1.2)), ratio


def test_a_given_velocity():
    """A car that drives in a circle and speeds up, without noise: what remains are arcseconds."""
    plan = [Straight(60.0), Turn(np.radians(120), 60.0), Accelerate(25.0, 60.0), Straight(60.0)]
    increments, truth = moving(plan, SITE, 50.0, heading=0.6, speed=10.0)
    fit = inertial_frame(increments, SITE, velocity_n=truth.velocity_n)
    phi = attitude_error(fit.C_nb, truth.C_nb[-1])
    assert np.all(np.abs(phi) < np.radians([0.005, 0.005, 0.05]))
    blind = inertial_frame(increments, SITE)
    assert np.abs(attitude_error(blind.C_nb, truth.C_nb[-1])).max() > 0.1


@pytest.mark.thorough
def test_covariance_by_monte_carlo():
    """NEES of 300 alignments with noise and biases, two-sided at 1 %."""
    sensors = SensorErrors(np.full(3, 4e-12), np.full(3, 4e-8), 0.05 * DPH, 1e-3)
    rng = np.random.default_rng(5)
    total, trials = 0.0, 300
    for _ in range(trials):
        increments, C_nb = resting(SITE, 120.0, 0.2, *rng.uniform(-1.4, 1.4, 3))
        fit = inertial_frame(with_errors(increments, sensors, rng), SITE, sensors)
        phi = attitude_error(fit.C_nb, C_nb)
        # There is no disturbance; what noise leaves in the residuals is counted already.
        total += phi @ np.linalg.solve(fit.cov - fit.parts["disturbance"], phi)
    low, high = chi_square_limits(3 * trials)
    assert low < total < high
    assert not low < total / 1.3**2 < high, "a covariance 1.3 sd too large is noticed"


@pytest.mark.thorough
@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_covariance_of_a_disturbance_by_monte_carlo(memory):
    """Bounded velocity noise, white and correlated: NEES of 160, two-sided, two tests at 1 %."""
    rng = np.random.default_rng(17)
    increments, C_nb = resting(SITE, 600.0, 1.0, 0.7)
    total, trials = 0.0, 160
    for _ in range(trials):
        x = lfilter([1e-3], [1.0, -memory], rng.normal(size=(700, 3)), axis=0)
        shake = np.diff(x[99:], axis=0)
        noisy = type(increments).of(increments.time, increments.dtheta_b, increments.dvel_b + shake)
        fit = inertial_frame(noisy, SITE)
        phi = attitude_error(fit.C_nb, C_nb)
        total += phi @ np.linalg.solve(fit.cov, phi)
    low, high = chi_square_limits(3 * trials, tests=2)
    assert low < total < high


def test_correlated_samples_count_less():
    rng = np.random.default_rng(2)
    x = rng.normal(size=20000)
    assert correlation_time(x) == pytest.approx(1.0, abs=0.1)
    y = x.copy()
    for k in range(1, len(y)):
        y[k] += 0.9 * y[k - 1]
    assert correlation_time(y) == pytest.approx(19.0, rel=0.2)
    assert correlation_time(np.zeros(50)) == 1.0


def test_too_short():
    increments, _ = resting(SITE, 5.0, 0.01, 0.0)
    with refuses("alignment.too_short", r"5 s long; at least 20 s"):
        inertial_frame(increments, SITE)


def test_a_latitude_is_needed():
    increments, _ = resting(SITE, 30.0, 0.01, 0.0)
    with refuses("alignment.no_latitude", "latitude of the site is unknown"):
        inertial_frame(increments, Site(9.81))
