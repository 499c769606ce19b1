"""What of a master's table contradicts itself: its velocities, positions and headings.

Over some time the velocities have to lead from one position to the next; they do so in one order of
north and east only. And most vehicles go where their nose points: the difference of course and
heading is small and steady, where that of course and the heading the other way round is not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.errors import Finding, error, finding
from foucault.logs.master_description import MasterDescription
from foucault.logs.places import misses
from foucault.models.master import MasterTable
from foucault.units import plain

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

    Raises ``master.frame``: its velocities are in another frame.
    """
    _one_frame(table, description.velocity.frame, name)
    return replace(
        table, findings=(*table.findings, *heading(table, description.attitude.sense, name))
    )


def _one_frame(table: MasterTable, frame: str, name: str) -> None:
    if table.latitude is None or table.longitude is None:
        return
    height = np.zeros(len(table)) if table.height is None else table.height
    position = np.column_stack([table.latitude, table.longitude, height])
    seen = misses(table.time, position, table.velocity_n, heights=table.height is not None)
    if seen is None:
        return
    words = {"file": name, "miss": plain(seen.miss, 3), "time": plain(seen.time, 3)}
    if seen.place_swapped:
        raise error("master.place_swapped", better=plain(seen.exchanged, 3), **words)
    if seen.frame_swapped:
        other = "NED" if frame == "ENU" else "ENU"
        raise error("master.frame", given=frame, other=other, better=plain(seen.other_frame, 3),
                    **words)  # fmt: skip


def heading(table: MasterTable, sense: str, name: str) -> tuple[Finding, ...]:
    """Return a warning where headings do not go with the courses."""
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
