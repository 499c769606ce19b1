"""Draw the five noises of an Allan variance as means over each interval (what a log reads)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=4)
def _flicker_filter(length: int) -> np.ndarray:
    """Amplitudes of the averages of S(f) = 1/(2 pi |f|), aliases included."""
    f = np.fft.rfftfreq(length)
    power = np.zeros(len(f))
    for alias in range(-30, 31):
        with np.errstate(divide="ignore"):
            power += np.sinc(f + alias) ** 2 / np.abs(f + alias) / (2 * np.pi)
    power[0] = 0.0
    return np.sqrt(power)


def flicker(n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw flicker with B = 1 that repeats only after eight records."""
    white = np.fft.rfft(rng.normal(size=8 * n))
    return np.fft.irfft(white * _flicker_filter(8 * n), 8 * n)[:n]


def walk(n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the means of a random walk with unit steps over each interval."""
    step, bridge = rng.normal(size=(2, n))
    return np.cumsum(step) - step / 2 + bridge / np.sqrt(12)


def draw(n: int, p: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """Draw the sum of the noises with strengths p = (Q^2, N^2, B^2, K^2, R^2), interval 1."""
    Q, N, B, K, R = np.sqrt(p)
    y = N * rng.normal(size=n) + R * np.arange(n)
    if Q:
        y += Q * np.diff(rng.normal(size=n + 1))
    if B:
        y += B * flicker(n, rng)
    if K:
        y += K * walk(n, rng)
    return y
