"""The angles that a table can stand at: ranges of its axes, and steps of a dividing head."""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, ceil, cos, floor, inf, pi, remainder, sin

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error

Position = tuple[float, float, float]
Range = tuple[float, float]

AXES = ("outer", "middle", "inner")

EVERYWHERE = (-pi, pi)

NEARLY = 1e-7
"""Angles nearer than this are the same; files give them to a millionth of a degree [rad]."""


@dataclass(frozen=True)
class Reach:
    """What the three axes of a table allow in a rest."""

    # outer, middle, inner: (2,) smallest and largest angle [rad]
    outer: Range = EVERYWHERE
    middle: Range = EVERYWHERE
    inner: Range = EVERYWHERE
    step: float = 0.0  # angles are multiples of this; 0 where any angle will do [rad]

    @property
    def ranges(self) -> tuple[Range, Range, Range]:
        """The ranges of outer, middle and inner angle."""
        return self.outer, self.middle, self.inner

    @property
    def words(self) -> str:
        """The limits in words, empty where there are none."""
        said = [
            f"{name} angle {np.degrees(low):g} to {np.degrees(high):g} deg"
            for name, (low, high) in zip(AXES, self.ranges, strict=True)
            if high - low < 2 * pi - NEARLY
        ]
        return ", ".join(
            [*said, *([f"steps of {np.degrees(self.step):g} deg"] if self.step else [])]
        )

    def checked(self) -> Reach:
        """Return itself, or refuse ranges without an angle in them."""
        for name, (low, high) in zip(AXES, self.ranges, strict=True):
            if self._snapped(0.5 * (low + high), (low, high)) is None:
                raise error(
                    "table.range", name=name, low=f"{np.degrees(low):g}",
                    high=f"{np.degrees(high):g}", step=f"{np.degrees(self.step):g}",
                )  # fmt: skip
        return self

    def _snapped(self, angle: float, within: Range) -> float | None:
        """Return the nearest angle that is allowed; None where none is."""
        low, high = within
        # The same angle whole turns away may lie in the range.
        middle = 0.5 * (low + high)
        angle = middle + remainder(angle - middle, 2 * pi)
        if self.step == 0.0:
            return min(max(angle, low), high) if low <= high else None
        first, last = ceil((low - NEARLY) / self.step), floor((high + NEARLY) / self.step)
        return (
            min(max(round(angle / self.step), first), last) * self.step if first <= last else None
        )

    def nearest(self, position: Position) -> Position:
        """Return the allowed position nearest to one, axis by axis [rad], shape (3,)."""
        out = [self._snapped(a, r) for a, r in zip(position, self.ranges, strict=True)]
        return tuple(0.0 if a is None else a for a in out)  # type: ignore[return-value]

    def allows(self, position: Position) -> bool:
        """Tell whether the table can stand at a position [rad], shape (3,)."""
        there = self.nearest(position)
        return all(
            abs(remainder(a - b, 2 * pi)) < NEARLY for a, b in zip(there, position, strict=True)
        )

    def pointing(self, up: FloatArray, outer: float) -> Position:
        """Return the allowed position that turns a direction upwards as nearly as it can.

        `up` (3,): direction that is to be up, case axes, not of length zero [1]; `outer`: outer
        angle [rad].
        """
        x, y, z = (up / np.linalg.norm(up)).tolist()
        middle = asin(min(max(y, -1.0), 1.0))
        inner = atan2(-x, z)
        best, least = (outer, middle, inner), inf
        # Beyond the pole of the middle axis the same direction is reached the other way round.
        for m, i in ((middle, inner), (pi - middle, inner + pi)):
            at = self.nearest((outer, m, i))
            _, a, b = at
            near = -cos(a) * sin(b) * x + sin(a) * y + cos(a) * cos(b) * z
            if 1.0 - near < least - 1e-12:
                best, least = at, 1.0 - near
        return best


def travel_time(angles: FloatArray, rate: float) -> FloatArray:
    """Return how long the slowest axis takes from each position to each other, shape (n, n).

    The outer axis goes the shorter way round; in units of 1 / rate.

    `angles` (n, 3): outer, middle and inner angle [rad]; `rate`: rate of the axes [rad/s].
    """
    apart = np.abs(angles[:, None, :] - angles[None, :, :])
    apart[:, :, 0] = np.abs(np.remainder(apart[:, :, 0] + pi, 2 * pi) - pi)
    return np.asarray(apart.max(axis=2) / rate)


def shortest_order(time: FloatArray) -> npt.NDArray[np.intp]:
    """Return an order of positions with little travel: nearest neighbours, then 2-opt, shape (n,).

    `time` (n, n): travel from each to each [s].
    """
    n = len(time)
    orders = [_improved(_nearest(time, first), time) for first in range(n)]
    lengths = [time[o[:-1], o[1:]].sum() for o in orders]
    return np.array(orders[int(np.argmin(lengths))], dtype=np.intp)


def _nearest(time: FloatArray, first: int) -> list[int]:
    order, left = [first], set(range(len(time))) - {first}
    while left:
        here = order[-1]
        order.append(min(left, key=lambda k: (time[here, k], k)))
        left.remove(order[-1])
    return order


def _improved(order: list[int], time: FloatArray) -> list[int]:
    """Turn stretches round for as long as that saves travel; the ends are free."""
    n = len(order)

    def leg(a: int, b: int) -> float:
        return float(time[order[a], order[b]]) if a >= 0 and b < n else 0.0

    better = True
    while better:
        better = False
        for i in range(n - 1):
            for j in range(i + 1, n):
                before = leg(i - 1, i) + leg(j, j + 1)
                after = 0.0
                if i > 0:
                    after += float(time[order[i - 1], order[j]])
                if j < n - 1:
                    after += float(time[order[i], order[j + 1]])
                if after < before - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    better = True
    return order
