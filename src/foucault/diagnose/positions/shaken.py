"""Spins that something shakes, and outputs in coarse steps: what a change of the means is not.

A table that turns may shake the accelerometers, while the gyros show that it turns evenly. Noise
jumps from cell to cell, a tilt goes on: the second differences of the means tell the noise alone.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.diagnose.positions.cells import CELL, Cells, Reduced

LONG = 8
"""Fewer cells than this do not tell noise from a change [1]."""

SLOW_TURN = 0.25
"""Beyond this angle per cell a turn about a horizontal axis has second differences too [rad]."""

SHAKEN = 0.1
"""An instrument that is shaken by more of gravity than this is not at one place [1]."""

BLURRED = 0.7
"""Steps of the output are blurred by noise of so many of them [1]."""


def runs_of(links: BoolArray) -> list[tuple[int, int]]:
    """Return first cell and the cell after the last of each run of linked cells.

    `links` (m - 1,): whether a cell and the next one belong together.
    """
    edge = np.diff(np.concatenate([[0], links.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1) + 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def noise_steps(cells: Cells, even: BoolArray, turn: FloatArray) -> FloatArray:
    """Return the usual step of accelerometer means while the table turns evenly, shape (m - 1,).

    `even` (m - 1,): where gyros or table turn evenly from a cell to the next; `turn` (m,): size
    of the rate [rad/s].
    """
    out = np.zeros(len(even))
    for a, b in runs_of(even):
        if b - a >= LONG and float(np.median(turn[a:b])) * CELL < SLOW_TURN:
            second = np.linalg.norm(np.diff(cells.accel[a:b], n=2, axis=0), axis=1)
            step = float(np.median(second)) / np.sqrt(3)  # variances 6 and 2
            size = float(np.median(np.linalg.norm(cells.accel[a:b], axis=1)))
            out[a : b - 1] = step if step < SHAKEN * size else 0.0
    return out


def rounding(name: str, data: Reduced) -> float:
    """Return by how much cells that follow may differ by the steps of the output alone [unit]."""
    # That module needs the stretches that are found with this one.
    from foucault.diagnose.positions.noise import lattice

    samples = data.samples.get(name)
    if samples is None:
        return 0.0
    step = np.array([lattice(samples[:, i]) for i in range(3)])
    sd = np.sqrt(np.median(getattr(data.cells, f"{name}_var"), axis=0))
    return float(np.linalg.norm(np.where(sd < BLURRED * step, step, 0.0)))
