"""Attitudes of a log by its gyros alone, with what their errors do, and means over cells of rows.

With w_m the rates as measured, ``w = w_m - bias - matrix w_m`` is integrated from the first row on;
what stands still in space is then seen from every row, and a reading is a mean over some rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.kernels.rotation import integrate_turns, running_product
from foucault.models.rotation import cross_matrix


@dataclass(frozen=True)
class Cells:
    """Rows of a log in groups, of which each makes one reading: their mean."""

    rows: IntArray  # (r,) rows that are in a group, in rising order [1]
    start: IntArray  # (k,) first of `rows` of each group [1]

    def __len__(self) -> int:
        return len(self.start)

    @property
    def count(self) -> IntArray:
        """Rows of each group, shape (k,) [1]."""
        return np.diff(self.start, append=len(self.rows))

    def mean(self, x: FloatArray) -> FloatArray:
        """Return the mean of `x` (r, ...), given for `rows`, over each group, shape (k, ...)."""
        count = self.count.reshape(-1, *[1] * (x.ndim - 1))
        return np.asarray(np.add.reduceat(x, self.start, axis=0) / count)

    def chosen(self, keep: BoolArray) -> Cells:
        """Return the groups `keep` (k,) [1]."""
        some = np.repeat(keep, self.count)
        count = self.count[keep]
        return Cells(self.rows[some], np.cumsum(count) - count)


@dataclass(frozen=True)
class Chain:
    """Attitudes of a log against that of its first row, by the gyros alone."""

    C: FloatArray  # (n, 3, 3) body axes at each row to those at the first row [1]
    w: FloatArray  # (n, 3) rate [rad/s]
    # by_bias, by_matrix: (n - 1, 3, 3) [s], (n - 1, 3, 9) [rad] what errors of the rates turn each
    # step by, in axes of its beginning
    by_bias: FloatArray
    by_matrix: FloatArray

    @cached_property
    def slopes(self) -> FloatArray:
        """Rotation, in axes of the first row, per error of rates, (n, 3, 12).

        By bias [s], then by element of a matrix that is multiplied with them, row by row [rad].
        """
        made = self.C[:-1] @ np.concatenate([self.by_bias, self.by_matrix], axis=2)
        return np.concatenate([np.zeros((1, 3, 12)), -np.cumsum(made, axis=0)])

    def seen(self, cells: Cells, v: FloatArray) -> FloatArray:
        """Return the means of a vector that stands still, ``mean(C' v)``, shape (k, 3).

        `v` (3,): the vector in body axes of the first row.
        """
        return cells.mean(np.swapaxes(self.C[cells.rows], 1, 2) @ v)

    def seen_by(self, cells: Cells, v: FloatArray) -> FloatArray:
        """Return the slopes of `seen`, (k, 3, 15): by v, by bias and by matrix of the gyros.

        `v` (3,): the vector in body axes of the first row [any unit].
        """
        back = np.swapaxes(self.C[cells.rows], 1, 2)
        by_rates = back @ cross_matrix(v) @ self.slopes[cells.rows]
        return cells.mean(np.concatenate([back, by_rates], axis=2))


@dataclass(frozen=True)
class Turning:
    """Rates of a log, to be integrated with other errors and another delay."""

    time: FloatArray  # (n,) [s]
    gyro: FloatArray  # (n, 3) as measured [rad/s]
    sampled: str = "rate"

    @cached_property
    def _angle(self) -> Any:
        """Its integral over time, from the row before the first on."""
        from scipy.interpolate import CubicSpline

        before = 2 * self.time[0] - self.time[1]
        if self.sampled == "rate":
            ends = np.concatenate([[before], self.time])
            return CubicSpline(ends, np.concatenate([self.gyro[:1], self.gyro])).antiderivative()
        # Means over intervals: the angle at their ends.
        step = np.diff(self.time, prepend=before)[:, None]
        ends = np.concatenate([[before], self.time])
        return CubicSpline(ends, np.concatenate([np.zeros((1, 3)), np.cumsum(self.gyro * step, 0)]))

    def late(self, delay: float) -> FloatArray:
        """Return the mean rates over the interval to each row, `delay` [s] before, (n, 3) [rad/s].

        As angles over intervals: rates read between rows would make the delay larger by what
        intervals scatter, where stamps do and samples do not.
        """
        if not delay and self.sampled == "increment":
            return self.gyro
        t = np.clip(self.time - delay, self.time[0], self.time[-1])
        ends = np.concatenate([[2 * t[0] - t[1]], t])
        step = np.maximum(np.diff(ends), 1e-3 * np.median(np.diff(self.time)))
        return np.asarray(np.diff(self._angle(ends), axis=0) / step[:, None])

    def chain(self, delay: float, bias: FloatArray, matrix: FloatArray) -> Chain:
        """Integrate ``w = w_m - bias - matrix w_m``, all of it `delay` earlier.

        `delay`: of the readings that it is for [s]; `bias` (3,): [rad/s]; `matrix` (3, 3): [1].
        """
        measured = np.ascontiguousarray(self.late(delay))
        w = np.ascontiguousarray(measured - bias - measured @ matrix.T)
        n = np.arange(len(w))
        step, by_bias, _, by_matrix, _, _ = integrate_turns(
            self.time, w, measured, np.zeros((3, 3)), n[:-1], n[1:], True
        )
        return Chain(running_product(step), w, by_bias, by_matrix)
