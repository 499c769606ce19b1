"""Counts carry their rounding on: told from white noise, and counted at the ends of a mean."""

import numpy as np
import pytest

from foucault.detect.noise import measure_noise, white_and_carried
from foucault.detect.stretches import Rests
from foucault.models.noise import ImuNoise, SessionNoise, TriadNoise, mean_variance
from foucault.simulate.noise import quantise

DT, TIME = 0.01, 60.0


def counted(rate, white, step, seed=1):
    """Rests of pulses of `step` at some true rates, as rates."""
    rng = np.random.default_rng(seed)
    n = round(TIME / DT)
    noise = white / np.sqrt(DT) * rng.standard_normal((len(rate), n, 3))
    return [quantise(r + x, step / DT, carried=True) for r, x in zip(rate, noise, strict=True)]


def rests_of(parts):
    last = np.cumsum([len(x) for x in parts])
    return Rests(last - len(parts[0]), last)


def rates(seed=2):
    return np.random.default_rng(seed).uniform(-12, 12, (12, 3))


@pytest.mark.parametrize(("white", "v"), [(1.0, 1.0), (1.0, 0.0), (0.3, 10.0)])
def test_white_noise_and_carried_rounding_are_told_apart(white, v):
    rng = np.random.default_rng(3)
    ends = np.sqrt(12 * v) * rng.uniform(-0.5, 0.5, (12, 241, 3))
    noise = 2 * white * rng.standard_normal((12, 240, 3))
    got, carried = white_and_carried(list(noise + np.diff(ends, axis=1) / 0.25), 0.25)
    mean = got / 60 + 2 * carried / 60**2
    # Three axes scatter by a fifth each; 3 sd.
    assert mean.mean() == pytest.approx(white**2 / 60 + 2 * v / 60**2, rel=0.35)
    assert carried == pytest.approx(v, rel=0.15, abs=0.02)
    assert all(np.all(x == 0) for x in white_and_carried([], 0.25))


@pytest.mark.parametrize(("white", "step"), [(0.12, 1.0), (0.12, 0.1), (5.0, 1.0), (0.12, 5.0)])
def test_the_mean_of_pulses_scatters_as_their_noise_says(white, step):
    truth = rates()
    parts = counted(truth, white, step)
    x = np.concatenate(parts)
    got = measure_noise(x, DT, rests_of(parts), increments=True)
    off = np.array([p.mean(axis=0) for p in parts]) - truth
    variance = got.psd_of_mean / TIME + 2 * got.carried / TIME**2
    assert 0.25 < (off**2 / variance).mean() < 1.7  # 36 numbers; 3 sd
    assert not got.rounding.any()
    plain = measure_noise(x, DT, rests_of(parts))
    if white < step / np.sqrt(DT) / 10:  # white, the same scatter would be far too large
        assert (plain.psd / TIME > 2 * variance).all()


def test_an_axis_that_never_counts_is_known_to_a_count():
    parts = [np.zeros((600, 3)) for _ in range(3)]
    got = measure_noise(np.concatenate(parts), DT, rests_of(parts), np.ones(3), increments=True)
    np.testing.assert_allclose(got.carried, DT**2 / 12)
    assert not got.rounding.any()


def test_declared_steps_of_increments_count_at_the_ends_only():
    triad = TriadNoise(white=0.1, quantisation=3.0)
    time = np.array([1.0, 10.0])
    v = (3.0 * DT) ** 2 / 12
    np.testing.assert_allclose(
        mean_variance(triad, time, DT, increments=True), 0.01 / time + 2 * v / time**2
    )
    assert (mean_variance(triad, time, DT) > 0.01 / time + 9 * DT / (12 * time)).all()
    noise = SessionNoise.declared(ImuNoise(triad, triad), DT, increments=True)
    np.testing.assert_allclose(noise.gyro_carried, v)
    np.testing.assert_allclose(noise.turn_psd, 0.01)
    assert not noise.gyro_rounding.any() and not noise.accel_rounding.any()


def test_carried_rounding_loses_nothing():
    x = np.random.default_rng(4).normal(0.3, 0.2, (500, 3))
    got = quantise(x, 0.5, carried=True)
    assert np.abs(np.cumsum(got - x, axis=0)).max() <= 0.25 + 1e-9
    np.testing.assert_allclose(got / 0.5, np.round(got / 0.5), atol=1e-9)
