"""White noise of a rest: as it is in a quiet one, beside sway, beside rounding."""

import numpy as np
import pytest

from foucault.diagnose.noise_at_rest import white_noise

RATE, LENGTH = 50.0, 300.0
TIME = np.arange(0, LENGTH, 1 / RATE)


def _white(seed, white=1e-6):
    return np.random.default_rng(seed).normal(size=(len(TIME), 3)) * white * np.sqrt(RATE)


def _sway(size, frequency=0.4):
    tones = [(1.0, 0.0), (0.6, 1.0), (0.83, 2.0)]
    return size * np.stack([np.sin(2 * np.pi * frequency * f * TIME + p) for f, p in tones], axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_a_quiet_rest(seed):
    found = white_noise(_white(seed), 1 / RATE)
    # 45000 readings, first differences: 0.4 % (1 sd).
    assert found.white == pytest.approx(1e-6, rel=0.02)
    assert found.clear


@pytest.mark.parametrize("size", [1e-4, 1e-3, 5e-3])
def test_sway_is_told_from_noise(size):
    """A vehicle of 2 mrad sway at 0.4 Hz turns at 5 mrad/s, 700 times the noise of a reading."""
    found = white_noise(_white(1) + _sway(size), 1 / RATE)
    assert found.white == pytest.approx(1e-6, rel=0.05)
    assert not found.clear


def test_sway_near_the_sample_rate_passes_for_noise():
    found = white_noise(_white(1) + _sway(1e-3, 10.0), 1 / RATE)
    assert found.white > 1e-6
    assert not found.clear


def test_rounding_falls_out_at_long_averages():
    """Angles rounded to 5 urad: 10 times the noise in one interval."""
    angle = np.cumsum(_white(2), axis=0) / RATE
    rate = np.diff(np.round(angle / 5e-6) * 5e-6, axis=0, prepend=0.0) * RATE
    found = white_noise(rate, 1 / RATE)
    assert 0.9e-6 < found.white < 1.5e-6
    assert not found.clear


def test_few_readings():
    assert white_noise(_white(3)[:20], 1 / RATE).white == pytest.approx(1e-6, rel=0.4)


def test_readings_without_noise():
    found = white_noise(np.ones((500, 3)), 1 / RATE)
    assert found.white == 0.0 and found.clear
