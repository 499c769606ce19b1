"""Velocities that should lead from each position of a table to the next, and where they lead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.geodesy import displacement

LEG = 20.0
"""Velocities are added up over so long, where noise of positions counts little [s]."""

BETTER = 3.0
"""So many times nearer another reading of the columns has to come [1]."""


@dataclass(frozen=True)
class Misses:
    """By how much velocities miss the positions, over legs of a table."""

    miss: float  # as the table is read, root mean square over the legs [m]
    other_frame: float  # with velocities north, east, down [m]
    exchanged: float  # with latitude and longitude exchanged, infinite where they cannot be [m]
    time: float  # length of a leg [s]

    @property
    def place_swapped(self) -> bool:
        """Whether latitude and longitude are exchanged."""
        return self.exchanged < self.other_frame and self.miss > BETTER * self.exchanged

    @property
    def frame_swapped(self) -> bool:
        """Whether the velocities are north, east, down."""
        return self.miss > BETTER * self.other_frame


def misses(
    time: FloatArray, position: FloatArray, velocity_n: FloatArray, *, heights: bool
) -> Misses | None:
    """Compare velocities with positions.

    `time` (n,): when each row holds, rising [s]; `position` (n, 3): latitude, longitude [rad] and
    height [m]; `velocity_n` (n, 3): East, north, up [m/s]; `heights`: whether the heights mean
    something, else level ways are compared. Returns None where the table is shorter than a leg.
    """
    if len(time) < 2:
        return None
    legs = np.arange(0, len(time), max(1, round(LEG / float(np.median(np.diff(time))))))
    if len(legs) < 2:
        return None
    a, b = legs[:-1], legs[1:]
    steps = np.diff(time)[:, None] * (velocity_n[1:] + velocity_n[:-1]) / 2
    way = np.add.reduceat(steps, a)[: len(a)]
    way[-1] = steps[a[-1] : b[-1]].sum(axis=0)
    axes = slice(0, 3 if heights else 2)

    def off(latitude: FloatArray, longitude: FloatArray, way: FloatArray) -> float:
        at = (latitude, longitude, position[:, 2])
        gone = displacement(*(x[a] for x in at), *(x[b] for x in at))
        return float(np.sqrt(np.mean(np.sum((gone - way)[:, axes] ** 2, axis=1))))

    latitude, longitude = position[:, 0], position[:, 1]
    possible = np.abs(longitude).max() < np.pi / 2
    return Misses(
        off(latitude, longitude, way),
        off(latitude, longitude, way[:, [1, 0, 2]] * [1.0, 1.0, -1.0]),
        off(longitude, latitude, way) if possible else float("inf"),
        float(np.median(time[b] - time[a])),
    )
