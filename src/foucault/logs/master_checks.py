"""What of a master's table contradicts itself: its velocities, positions and headings.

Over some time the velocities have to lead from one position to the next; they do so in one order of
north and east only. And most vehicles go where their nose points: the difference of course and
heading is small and steady, where that of course and the heading the other way round is not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from foucault.errors import Finding, error, finding
from foucault.logs.master_description import MasterDescription
from foucault.models.geodesy import displacement
from foucault.models.master import MasterTable
from foucault.units import plain

FloatArray = npt.NDArray[np.float64]

LEG = 20.0
"""Velocities are added up over so long, where noise of positions counts little [s]."""

BETTER = 3.0
"""So many times nearer the other frame has to come [1]."""

MOVING = 1.0
"""Below this speed a course says nothing [m/s]."""

ALIKE = 0.9
"""Length of the mean of unit vectors whose directions agree, within some 25 deg [1]."""

CLEARLY = 10.0
"""So much steadier the other sense has to be, as a variance [1]."""

SEEN = 1e-5
"""Variance of course minus heading below which neither sense is wrong, some 0.25 deg [rad^2]."""

ASTRAY = np.radians(45.0)
"""A heading that is this far from the course on average is told [rad]."""


def checked(table: MasterTable, description: MasterDescription, name: str) -> MasterTable:
    """Return the table with what looks wrong added to its findings.

    Parameters
    ----------
    table : MasterTable
        Messages in order.
    description : MasterDescription
        How they were read.
    name : str
        What texts call the table.

    Raises
    ------
    FoucaultError
        ``master.frame``: its velocities are in another frame.
    """
    _one_frame(table, description.velocity.frame, name)
    return replace(
        table, findings=(*table.findings, *heading(table, description.attitude.sense, name))
    )


def _one_frame(table: MasterTable, frame: str, name: str) -> None:
    if table.latitude is None or table.longitude is None:
        return
    legs = np.arange(0, len(table), max(1, round(LEG / table.interval)))
    if len(legs) < 2:
        return
    height = np.zeros(len(table)) if table.height is None else table.height
    a, b = legs[:-1], legs[1:]
    gone = _gone(table.latitude, table.longitude, height, a, b)
    v = table.velocity_n
    steps = np.diff(table.time)[:, None] * (v[1:] + v[:-1]) / 2
    way = np.add.reduceat(steps, a)[: len(a)]
    way[-1] = steps[a[-1] : b[-1]].sum(axis=0)
    axes = slice(0, 3 if table.height is not None else 2)

    def off(gone: FloatArray, way: FloatArray) -> float:
        return float(np.sqrt(np.mean(np.sum((gone - way)[:, axes] ** 2, axis=1))))

    miss, better = off(gone, way), off(gone, way[:, [1, 0, 2]] * [1.0, 1.0, -1.0])
    if np.abs(table.longitude).max() < np.pi / 2:
        exchanged = off(_gone(table.longitude, table.latitude, height, a, b), way)
        if exchanged < better and miss > BETTER * exchanged:
            usual = float(np.median(table.time[b] - table.time[a]))
            raise error("master.place_swapped", file=name, miss=plain(miss, 3),
                        better=plain(exchanged, 3), time=plain(usual, 3))  # fmt: skip
    if miss > BETTER * better:
        other = "NED" if frame == "ENU" else "ENU"
        usual = float(np.median(table.time[b] - table.time[a]))
        raise error("master.frame", file=name, given=frame, other=other, miss=plain(miss, 3),
                    better=plain(better, 3), time=plain(usual, 3))  # fmt: skip


def _gone(
    latitude: FloatArray, longitude: FloatArray, height: FloatArray,
    a: npt.NDArray[np.int64], b: npt.NDArray[np.int64],
) -> FloatArray:  # fmt: skip
    """Return how far messages b are from messages a, shape (m, 3) [m]."""
    return displacement(latitude[a], longitude[a], height[a], latitude[b], longitude[b], height[b])


def heading(table: MasterTable, sense: str, name: str) -> tuple[Finding, ...]:
    """Return a warning where headings do not go with the courses.

    Parameters
    ----------
    table : MasterTable
        Messages.
    sense : {"clockwise", "counter-clockwise"}
        How the heading was taken to count.
    name : str
        What texts call the table.
    """
    v = table.velocity_n[:, :2]
    moving = np.hypot(*v.T) > MOVING
    if np.sum(moving) < 2:
        return ()
    course = np.arctan2(v[moving, 0], v[moving, 1])
    H = table.angles[moving, 0]
    same, against = (np.mean(np.exp(1j * (course - sign * H))) for sign in (1, -1))
    # Also where a course hardly changes: what it does change by decides.
    reversed_ = 1 - abs(same) > max(CLEARLY * (1 - abs(against)), SEEN)
    if not reversed_ and abs(same) > ALIKE and abs(np.angle(same)) < ASTRAY:
        return ()
    if reversed_ or (abs(against) > ALIKE and abs(np.angle(against)) < ASTRAY):
        other = "clockwise" if sense == "counter-clockwise" else "counter-clockwise"
        return (finding("master.heading_sense", file=name, other=other),)
    offset = float(np.angle(same))
    spread = float(np.sqrt(-2 * np.log(np.clip(abs(same), 1e-3, 1 - 1e-12))))
    return (finding("master.heading_course", file=name, offset=f"{np.degrees(offset):.0f}",
                    spread=f"{np.degrees(spread):.0f}"),)  # fmt: skip
