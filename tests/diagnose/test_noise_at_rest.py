"""Noise that is declared against the noise that the rests show."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.detect.noise import blocks, successive
from foucault.diagnose.noise_at_rest import noise_at_rest, outlying
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.tables import Log

DECLARED = ImuNoise(TriadNoise(white=5e-5), TriadNoise(white=2e-7))
RATE = 50.0
RESTS = [(100 + 2000 * k, 1900 + 2000 * k) for k in range(6)]


def made(seed=0, share=0.0, size=20.0, noisier=1.0, rounded=0.0):
    """Return a log that moves between its rests, with white noise and outlying samples."""
    rng = np.random.default_rng(seed)
    n, out = RESTS[-1][1] + 100, []
    for triad in (DECLARED.gyro, DECLARED.accel):
        sd = triad.white * np.sqrt(RATE)
        x = noisier * sd * rng.standard_normal((n, 3)) + 1e-3
        hit = rng.random((n, 3)) < share
        x[hit] += size * sd * rng.choice([-1.0, 1.0], int(hit.sum()))
        moving = np.ones(n, bool)
        for a, b in RESTS:
            moving[a:b] = False
        x[moving] += 1e3 * sd
        out.append(np.round(x / (rounded * sd)) * rounded * sd if rounded else x)
    return Log(np.arange(n) / RATE, gyro=out[0], accel=out[1])


@pytest.mark.thorough
def test_the_declared_noise_of_a_clean_log_is_kept_in_99_of_100():
    told = [noise_at_rest(made(seed), RESTS, DECLARED) for seed in range(100)]
    assert sum(t.noise != DECLARED for t in told) <= 4  # binomial, 1 % a log, 1 in 300
    assert all(t.check.passed for t in told) and sum(len(t.findings) for t in told) <= 8
    clean = next(t for t in told if t.noise == DECLARED)
    assert clean.check.sentence == "The readings at rest scatter no more than [noise] says."


def test_outlying_samples_are_counted_named_and_their_noise_is_used():
    log = made(share=0.01)
    log.gyro[3000, 1] += 60 * DECLARED.gyro.white * np.sqrt(RATE)
    seen = noise_at_rest(log, RESTS, DECLARED)
    for used, said in ((seen.noise.gyro, DECLARED.gyro), (seen.noise.accel, DECLARED.accel)):
        assert used.white / said.white == pytest.approx(np.sqrt(1 + 0.01 * 400), rel=0.05)
    assert not seen.check.passed
    assert "samples are outlying and make 8" in seen.check.sentence
    gyro, _ = seen.findings
    assert gyro.code == "rest.outliers" and gyro.severity == "note"
    assert "gyro_y at 60 s" in gyro.message
    out, _ = outlying(log.gyro, RESTS)
    assert out[3000, 1] and out.mean() == pytest.approx(0.01 * 10800 / 12000, rel=0.1)


def test_a_noisier_sensor_is_no_outlier():
    seen = noise_at_rest(made(noisier=2.0), RESTS, DECLARED)
    assert not seen.check.passed and not seen.findings
    assert "the sensor is noisier than that, or what it stands on shakes" in seen.check.sentence
    assert seen.noise.accel.white == pytest.approx(2 * DECLARED.accel.white, rel=0.03)
    little = noise_at_rest(made(noisier=1.1), RESTS, DECLARED)  # used, and that is enough
    assert little.check.passed and "The noise that is seen was used." in little.check.sentence
    assert little.noise.accel.white > DECLARED.accel.white


@pytest.mark.parametrize("noise", [None, ImuNoise()])
def test_noise_that_is_not_declared_contradicts_nothing(noise):
    seen = noise_at_rest(made(share=0.01), RESTS, noise)
    assert seen.check.passed and len(seen.findings) == 2
    if noise is None:
        white = DECLARED.gyro.white * np.sqrt(5.0)
        assert seen.noise.gyro.white == pytest.approx(white, rel=0.05)


def test_steps_of_the_output_are_no_outliers():
    assert not outlying(made(rounded=8.0).gyro, RESTS)[0].any()
    assert noise_at_rest(made(rounded=0.5), RESTS, DECLARED).check.passed


def test_successive_differences_are_blind_to_a_slope():
    x = np.random.default_rng(1).standard_normal((4000, 3)) + np.arange(4000)[:, None] * 1e-3
    power, count = successive(blocks(x, [(0, 4000)], 20), 20.0)
    assert count == 199
    assert power == pytest.approx(np.ones(3), rel=0.35)


@pytest.mark.thorough
@pytest.mark.parametrize("times", [1.0, 5.0])
def test_rounding_of_counts_that_is_carried_is_no_white_noise(times):
    said = ImuNoise(TriadNoise(white=5e-5), TriadNoise(white=5.8e-7))
    rng, n, dt, out = np.random.default_rng(3), 30_000, 0.01, []
    for triad, step, mean in ((said.gyro, 4.8e-6, 4e-5), (said.accel, 6e-4, 0.3)):
        sd = times * triad.white * np.sqrt(dt)
        total = np.cumsum(sd * rng.standard_normal((n, 3)) + mean * dt, axis=0)
        out.append(np.diff(np.floor(total / step), axis=0, prepend=0) * step / dt)
    log = Log(dt * np.arange(n), gyro=out[0], accel=out[1], sampled="increment")
    found = noise_at_rest(log, [(0, n)], said)
    assert found.check.passed == (times == 1.0)
    if times == 1.0:
        assert found.noise == said
    else:
        assert found.noise.gyro.white == pytest.approx(5 * said.gyro.white, rel=0.15)
