"""What is left out of a calibration, put into samples by formulas that are not its columns."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from foucault.models.left_out import Sizes
from foucault.tables import Log

CROSSED = [(o, i, j) for o in range(3) for i in range(3) for j in range(i, 3) if {o, i, j} != {o}]
BENT = [(o, i, k) for o in range(3) for i in range(3) for k in range(3) if i != o]


def ramp(log: Log) -> np.ndarray:
    """From -1/2 at the start of a log to 1/2 at its end, shape (n, 1)."""
    return np.asarray((log.time - log.time[0]) / (log.time[-1] - log.time[0]) - 0.5)[:, None]


def with_terms(log: Log, sizes: Sizes, rng: np.random.Generator, skip: Collection[str] = ()) -> Log:
    """Return the log of an instrument with all other terms, each drawn at its size [SI].

    Its readings are taken for true: the terms are small against them. `skip`: groups that it has
    already, or not at all.
    """
    f, w, r = log.accel, log.gyro, ramp(log)
    assert f is not None
    assert w is not None

    def drawn(group: str, n: int = 3) -> np.ndarray:
        return (group not in skip) * sizes[group][0] * rng.standard_normal(n)

    a = drawn("accel.quadratic") * f**2 + drawn("accel.asymmetry") * np.abs(f)
    a += r * (drawn("accel.bias drift") + drawn("accel.scale drift") * f)
    g = f @ drawn("gyro.g_sensitivity", 9).reshape(3, 3)
    g += drawn("gyro.asymmetry") * np.abs(w) + drawn("gyro.cubic") * w**3
    g += r * (drawn("gyro.bias drift") + drawn("gyro.scale drift") * w)
    for x, (o, i, j) in zip(drawn("accel.cross", len(CROSSED)), CROSSED, strict=True):
        a[:, o] += x * f[:, i] * f[:, j]
    for x, (o, i, k) in zip(drawn("gyro.deflection", len(BENT)), BENT, strict=True):
        g[:, o] += x * f[:, k] * w[:, i]
    return replace(log, accel=f + a, gyro=w + g)
