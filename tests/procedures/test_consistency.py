"""Are the uncertainties right? Errors of simulated sessions against predicted covariance.

Two-sided chi-square limits at 1 % for all tests of this file together; `validation/` has the
long version, with the power to see a covariance that is 5 % off.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.diagnose.consistency import nees
from foucault.estimate.chi_square import chi_square_limits
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import GRADES, ImuNoise, TriadNoise, grade
from foucault.procedures.hand_rotated import Settings, calibrate
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_session import SITE, short_plan

SESSIONS = 36  # 756 dof: a covariance that is 25 % off is seen with 96 %
TESTS = len(GRADES) + 1


@cache
def _log(name, seed, noise=None):
    model = draw_errors(name, seed)
    simulation = simulate(
        short_plan(14, seed), model=model, noise=noise or grade(name).noise, site=SITE, seed=seed
    )
    return simulation.log, model.coefficients(LINEAR_LOWER).values


def _sum(name, sessions, declared, noise=None, **settings):
    """Sum of the NEES, and its limits."""
    errors, covs = [], []
    for seed in range(sessions):
        log, truth = _log(name, seed, noise)
        result = calibrate(
            log, site=SITE, noise=declared, settings=Settings(held_out=0, **settings)
        )
        errors.append(result.coefficients.values - truth)
        covs.append(result.coefficients.cov)
    limits = chi_square_limits(21 * sessions, tests=TESTS)
    return float(nees(np.array(errors), np.array(covs)).sum()), limits


def _scaled(noise, factor):
    return ImuNoise(
        replace(noise.accel, white=noise.accel.white * factor),
        replace(noise.gyro, white=noise.gyro.white * factor),
    )


@pytest.mark.thorough
@pytest.mark.parametrize("name", GRADES)
def test_errors_have_the_size_that_was_promised(name):
    total, (low, high) = _sum(name, SESSIONS, grade(name).noise)
    assert low < total < high


@pytest.mark.thorough
def test_slow_noise_is_accounted_for():
    gyro = TriadNoise(white=2e-5, bias_instability=2e-5, correlation_time=30.0, random_walk=2e-6)
    accel = TriadNoise(white=3e-4, bias_instability=5e-4, correlation_time=60.0, random_walk=2e-5)
    noise = ImuNoise(accel, gyro)
    total, (low, high) = _sum("tactical", 20, noise, noise)
    assert low < total < high
    white = ImuNoise(TriadNoise(white=3e-4), TriadNoise(white=2e-5))
    total, (low, high) = _sum("tactical", 12, white, noise, repeatability=False)
    assert total > high


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [1.3, 1 / 1.3])
def test_the_check_sees_a_wrong_noise(factor):
    noise = _scaled(grade("tactical").noise, factor)
    total, (low, high) = _sum("tactical", 20, noise, repeatability=False)
    assert (total < low) if factor > 1 else (total > high)


def test_nees_is_the_quadratic_form():
    rng = np.random.default_rng(16)
    root = rng.normal(size=(4, 3, 3)) * [1e-9, 1.0, 1e6]
    cov = np.swapaxes(root, 1, 2) @ root
    e = np.einsum("nji,nj->ni", root, np.ones((4, 3)))  # root' 1: its NEES is 3
    np.testing.assert_allclose(nees(e, cov), 3.0, rtol=1e-6)
    np.testing.assert_allclose(nees(e[:1], cov[0]), 3.0, rtol=1e-6)
