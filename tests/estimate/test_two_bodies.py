"""Offsets of windows: what lost samples make of them, and what errors of instruments do."""

from __future__ import annotations

import numpy as np

from foucault.estimate import two_bodies
from foucault.estimate.two_bodies import JUMPS

STEP = 0.005
"""Of the readings, and so the sample that jumps are counted in [s]."""


def _pair(seed: int, lost: int = 0) -> two_bodies.Clocks:
    """Return the clocks of a good gyro and of a raw one, which lost some samples half-way."""
    rng = np.random.default_rng([seed, 71])
    time = np.arange(0.0, 30.0, STEP)
    waves = rng.uniform(0.12, 0.75, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
    w = 2.5 * np.sin(2 * np.pi * time[:, None, None] * waves[0] + waves[1]).sum(axis=2) / 3**0.5
    raw = w @ (np.eye(3) + rng.normal(0, 5e-3, (3, 3))).T + rng.normal(0, 0.01, 3)
    raw += rng.normal(0, 0.01, w.shape)
    raw = np.delete(raw, slice(3000, 3000 + lost), axis=0)
    return two_bodies.clocks((time, w), (time[: len(raw)], raw), 15.0)


def test_errors_of_a_gyro_are_no_lost_samples() -> None:
    found = [_pair(seed).jumps / STEP for seed in range(12)]
    assert max(found) < JUMPS


def test_lost_samples_are() -> None:
    found = [_pair(seed, lost=4).jumps / STEP for seed in range(12)]
    assert min(found) > JUMPS
