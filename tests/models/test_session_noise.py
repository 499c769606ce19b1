"""Noise of a session: slow noise against drawn noise, declared noise against its numbers."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.noise import QUIETEST, ImuNoise, SessionNoise, TriadNoise, window_covariance
from foucault.simulate.noise import draw_noise

START = np.array([0.0, 3.0, 3.5, 20.0, 40.0])
END = np.array([2.0, 3.5, 12.0, 20.2, 60.0])


def _windows(noise, rng, dt=0.02, trials=1000):
    """Mean of drawn noise over each window, shape (3 trials, windows)."""
    time = np.arange(0, round(60 / dt) + 1) * dt
    rows = []
    for _ in range(trials):
        x = draw_noise(noise, time, rng)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(x, axis=0)])
        a, b = np.searchsorted(time, START), np.searchsorted(time, END - 1e-9)
        rows.append(((total[b] - total[a]) / (b - a)[:, None]).T)
    return np.concatenate(rows)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "noise",
    [
        TriadNoise(bias_instability=2.0, correlation_time=5.0),
        TriadNoise(bias_instability=2.0, correlation_time=500.0),
        TriadNoise(random_walk=0.3),
        TriadNoise(bias_instability=1.0, correlation_time=20.0, random_walk=0.2),
    ],
)
def test_window_covariance_is_that_of_drawn_noise(noise):
    drawn = _windows(noise, np.random.default_rng(8))
    cov = window_covariance(START, END, noise)
    assert np.linalg.eigvalsh(cov).min() > 0
    white = np.linalg.solve(np.linalg.cholesky(cov), drawn.T)
    n = white.shape[1]
    # Every white component has unit variance, every pair no correlation. 15 tests, 4 cases.
    tests = 4 * 15
    low, high = chi_square_limits(n, tests=tests)
    square = np.sum(white**2, axis=1)
    assert (low < square).all() and (square < high).all()
    for i in range(5):
        for j in range(i):
            # u + v and u - v have variance 2 each and are as independent as u and v are.
            both = np.sum((white[i] + white[j]) ** 2) / 2
            assert low < both < high


def test_a_wrong_window_covariance_would_be_seen():
    noise = TriadNoise(bias_instability=2.0, correlation_time=5.0)
    drawn = _windows(noise, np.random.default_rng(8), trials=400)
    for wrong in (TriadNoise(bias_instability=2.3, correlation_time=5.0),
                  TriadNoise(bias_instability=2.0, correlation_time=3.0)):  # fmt: skip
        white = np.linalg.solve(np.linalg.cholesky(window_covariance(START, END, wrong)), drawn.T)
        low, high = chi_square_limits(white.shape[1], tests=5)
        square = np.sum(white**2, axis=1)
        assert ((square < low) | (square > high)).any()


@pytest.mark.parametrize("tau", [1e-3, 1.0, 1e3, 1e9])
def test_window_covariance_has_its_limits(tau):
    cov = window_covariance(START, END, TriadNoise(bias_instability=1.0, correlation_time=tau))
    if tau == 1e9:  # a constant
        np.testing.assert_allclose(cov, 1.0, rtol=1e-6)
    if tau == 1e-3:  # white, with density 2 tau
        np.testing.assert_allclose(np.diag(cov), 2e-3 / (END - START), rtol=6e-3)
    assert np.isfinite(cov).all() and np.linalg.eigvalsh(cov).min() > -1e-12


def test_declared_noise_takes_rounding_as_white():
    noise = ImuNoise(TriadNoise(white=3e-3, quantisation=0.01), TriadNoise(quantisation=1e-4))
    got = SessionNoise.declared(noise, 0.02)
    assert got.accel_psd == pytest.approx(np.full(3, 9e-6 + 1e-4 / 12 * 0.02))
    assert got.gyro_psd == pytest.approx(np.full(3, 1e-8 / 12 * 0.02))
    assert np.array_equal(got.turn_psd, got.gyro_psd)


def test_noise_that_is_not_there_is_still_a_number():
    got = SessionNoise.declared(ImuNoise(), 0.01)
    for psd in (got.accel_psd, got.gyro_psd, got.turn_psd):
        assert np.array_equal(psd, np.full(3, QUIETEST**2))
