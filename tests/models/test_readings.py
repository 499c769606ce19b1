"""Readings of a table: the variance of their means, against sums over samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import finding
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.noise import ImuNoise, Readings, TriadNoise, mean_variance
from foucault.simulate.noise import draw_noise, quantise


def readings(n=5, gyro=True):
    rng = np.random.default_rng(5)
    eye = np.broadcast_to(np.eye(3), (n, 3, 3))
    rate = np.where(np.arange(n) < n // 2, 0.0, -0.2)
    return Readings(
        rng.normal(size=(n, 3)), rate, (rate != 0) * 2.0, np.arange(n) * 60.0,
        10.0 + np.arange(n), rng.normal(size=(n, 3)),
        rng.normal(size=(n, 3)) if gyro else None, eye * 1e-8, eye * 1e-12, 0.01,
    )  # fmt: skip


def test_white_noise_averages_with_time():
    got = mean_variance(TriadNoise(white=0.3), np.array([1.0, 100.0]), 0.0)
    np.testing.assert_allclose(got, [0.09, 0.0009], rtol=1e-12)


@pytest.mark.parametrize("length", [0.3, 3.0, 40.0])
def test_markov_noise_averages_as_the_double_sum_of_its_correlation(length):
    noise = TriadNoise(bias_instability=2.0, correlation_time=10.0)
    i = np.arange(2000)
    lag = np.abs(i[:, None] - i) * length / len(i)
    wanted = 4.0 * np.exp(-lag / 10.0).mean()
    assert mean_variance(noise, np.array([length]), 0.0)[0] == pytest.approx(wanted, rel=1e-3)


def test_random_walk_averages_as_the_double_sum_of_its_covariance():
    t = (np.arange(2000) + 0.5) / 2000 * 30.0
    wanted = 0.5**2 * np.minimum(t[:, None], t).mean()
    got = mean_variance(TriadNoise(random_walk=0.5), np.array([30.0]), 0.0)[0]
    assert got == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize(
    "noise",
    [
        TriadNoise(white=0.02, bias_instability=0.05, correlation_time=4.0),
        TriadNoise(white=0.02, random_walk=0.02),
        TriadNoise(white=0.008, quantisation=0.1),
    ],
    ids=["markov", "walk", "rounded"],
)
def test_means_of_simulated_noise_have_that_variance(noise):
    rng, dt, n = np.random.default_rng(11), 0.02, 1500
    time = np.arange(n) * dt
    draws = []
    for _ in range(300):
        offset = rng.uniform(0, 1) if noise.quantisation else 0.0
        x = draw_noise(noise, time, rng)
        draws.append((quantise(x + offset, noise.quantisation) - offset).mean(axis=0))
    squares = np.sum(np.square(draws)) / mean_variance(noise, np.array([n * dt]), dt)[0]
    low, high = chi_square_limits(900, tests=3)
    assert low < squares < high


def test_rounding_of_a_silent_instrument_does_not_average_out():
    silent = mean_variance(TriadNoise(white=1e-6, quantisation=0.1), np.array([1e6]), 0.01)[0]
    assert np.sqrt(silent) == pytest.approx(0.1 / np.sqrt(12), rel=0.01)
    dithered = mean_variance(TriadNoise(white=0.01, quantisation=0.1), np.array([1e6]), 0.01)[0]
    assert np.sqrt(dithered) < 1e-4


def test_without_any_noise_the_variance_is_still_not_zero():
    assert (mean_variance(TriadNoise(), np.array([1.0, 60.0]), 0.01) > 0).all()


def test_declared_noise_replaces_the_covariance_of_every_reading():
    noise = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1e-5))
    got = readings().with_noise(noise)
    assert got.declared
    for k, time in enumerate(got.time):
        np.testing.assert_allclose(got.accel_cov[k], 4e-6 / time * np.eye(3), rtol=1e-12)
        np.testing.assert_allclose(got.gyro_cov[k], 1e-10 / time * np.eye(3), rtol=1e-12)


def test_once_declared_the_noise_is_no_longer_called_unknown():
    found = (finding("readings.noise_unknown"), finding("readings.no_spins"))
    got = replace(readings(), findings=found).with_noise(ImuNoise(TriadNoise(1.0), TriadNoise(1.0)))
    assert [f.code for f in got.findings] == ["readings.no_spins"]


def test_some_of_the_readings():
    r = readings()
    for rows in (r.spin, np.flatnonzero(r.spin)):
        some = r[rows]
        assert len(some) == 3
        assert some.spin.all()
        assert np.array_equal(some.accel, r.accel[2:])
        assert np.array_equal(some.gyro_cov, r.gyro_cov[2:])
    assert readings(gyro=False)[r.spin].gyro is None
    assert replace(r, accel=None)[r.spin].accel is None


def test_a_spin_clockwise_is_a_spin():
    assert readings().spin.tolist() == [False, False, True, True, True]
