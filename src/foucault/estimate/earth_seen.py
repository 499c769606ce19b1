"""What a session says of the Earth's rate, which its filter takes for known.

Attitudes differ from rest to rest and the Earth's rate with them, the biases of the gyros do not:
the Earth is a clock, and a compass needle that dips by the latitude. Were its rate along north and
up more by x, the innovations of the filter would be more by ``D x``, with all coefficients as free
as they are. D is found by taking some of the Earth's rate out of the readings; then

    x = (D' S^-1 D)^-1 D' S^-1 nu,      P = (D' S^-1 D)^-1

is what an estimate of x beside everything else would be, for innovations are white.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.ins_filter import FilterRun
from foucault.models.earth import EARTH_RATE
from foucault.models.rotation import exp, log
from foucault.navigate.increments import Increments

STEP = 1e-3
"""So much of the Earth's rate is taken out [1]."""


@dataclass(frozen=True)
class EarthSeen:
    """The Earth's rate, over what was taken for it."""

    # (2,) by how much it is more along north and up, in parts of the whole Earth's rate [1]
    more: FloatArray
    cov: FloatArray  # (2, 2) covariance of that [1]
    latitude: float  # the latitude that was taken for known [rad]

    @property
    def square(self) -> float:
        """Squared normalised difference, two degrees of freedom [1]."""
        return self.left_by(np.zeros(2))

    def left_by(self, more: FloatArray) -> float:
        """Return the squared normalised difference from what a cause would make [1].

        `more` (2,): by how much it makes the rate more along north and up [1].
        """
        left = self.more - more
        return float(left @ np.linalg.solve(self.cov, left))

    def along(self, way: FloatArray) -> tuple[float, float, float]:
        """Return what explains the difference best along a way, its sd, and what is left then.

        `way` (2,): what one unit of a cause makes along north and up [1]. Returns `value`, `sd`:
        size of the cause [unit of it]; `left`: squared normalised difference that it leaves, one
        degree of freedom [1].
        """
        weighed = np.linalg.solve(self.cov, way)
        value = float(weighed @ self.more / (weighed @ way))
        return value, float(1 / np.sqrt(weighed @ way)), self.left_by(value * way)

    @property
    def faster(self) -> tuple[float, float, float]:
        """By how much the whole rate is more, as `along` [1]."""
        return self.along(np.array([np.cos(self.latitude), np.sin(self.latitude)]))

    @property
    def farther_north(self) -> tuple[float, float, float]:
        """By how much the latitude is more, as `along` [rad]."""
        return self.along(np.array([-np.sin(self.latitude), np.cos(self.latitude)]))


def earth_seen(
    filtered: Callable[[Increments], FilterRun], increments: Increments, latitude: float
) -> EarthSeen | None:
    """Return what a session says of the Earth's rate; None where it says nothing.

    `filtered`: the filter, from the same start each time; `increments`: the session [SI];
    `latitude`: where it stood [rad].
    """
    run = filtered(increments)
    seen = np.isfinite(run.innovation)
    size = np.sqrt(run.variance[seen])
    nu, D = run.innovation[seen] / size, []
    for way in (1, 2):
        other = filtered(replace(increments, dtheta_b=_taken_out(increments, run, way)))
        D.append((nu - other.innovation[seen] / size) / STEP)
    told = np.stack(D) @ np.stack(D).T
    if not np.isfinite(told).all() or np.linalg.cond(told) > 1e12:
        return None
    cov = np.linalg.inv(told)
    return EarthSeen(np.asarray(cov @ (np.stack(D) @ nu)), np.asarray(cov), latitude)


def _taken_out(increments: Increments, run: FilterRun, way: int) -> FloatArray:
    """Return the angles turned with `STEP` of the Earth's rate less along axis `way` of n."""
    C_bn = np.swapaxes(run.trajectory.C_nb, 1, 2)
    time = run.time
    rows = np.flatnonzero((increments.time > time[0]) & (increments.time <= time[-1]))
    middle = increments.time[rows] - increments.dt[rows] / 2
    k = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 2)
    share = np.clip((middle - time[k]) / (time[k + 1] - time[k]), 0.0, 1.0)
    # From one epoch to the next the body turns by less than half a turn: C_b'n = Exp(-r) C_bn.
    turn = log(C_bn[:-1] @ np.swapaxes(C_bn[1:], 1, 2))
    part = exp(-share[:, None] * turn[k])
    axis_b = np.einsum("kij,kj->ki", part, C_bn[k, :, way])
    out = increments.dtheta_b.copy()
    out[rows] -= STEP * EARTH_RATE * increments.dt[rows, None] * axis_b
    return out
