"""Read what a master INS said from a file of any format, and write it as one.

Whatever a file holds - north, east, down; a heading that counts the other way; degrees, wrapped at
180 or at 360 - becomes East-North-Up and an attitude matrix. What cannot be is refused, what looks
wrong is told (`logs.master_checks`).

The ``[master]`` block of a campaign: which column of a table is what a master INS said.

What a block leaves out is looked for in the titles of the columns, as those of a reference are
(`logs.reference`): title and unit, such as ``velocity north (m/s)``.

What of a master's table contradicts itself: its velocities, positions and headings.

Over some time the velocities have to lead from one position to the next; they do so in one order of
north and east only. And most vehicles go where their nose points: the difference of course and
heading is small and steady, where that of course and the heading the other way round is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding
from foucault.files import atomic
from foucault.logs import description as columns
from foucault.logs import reference
from foucault.logs.layout import Block, ColumnName, FileLayout, Measured, TimeColumn, scaled_unit
from foucault.logs.raw import RawTable, kept, open_raw
from foucault.logs.reference import misses
from foucault.models.rotation import matrix_of, turned
from foucault.models.transfer import MasterTable
from foucault.units import plain

Frame = Literal["ENU", "NED"]
Sense = Literal["clockwise", "counter-clockwise"]
Triple = tuple[ColumnName, ColumnName, ColumnName]


def _pair(block: str, columns: object, unit: object) -> None:
    if (columns is None) != (unit is None):
        missing = "unit" if unit is None else "columns"
        raise error("master.columns", file="The master's table", what=f"{block} has no `{missing}`")


class PositionColumns(Measured):
    """Latitude and longitude, and the height where there is one."""

    of: ClassVar[dict[str, str]] = {"unit": "angle", "height_unit": "length"}

    columns: tuple[ColumnName, ColumnName] | Triple = Field(
        description="names or numbers from 0 for latitude, longitude, height"
    )
    unit: str = Field(description='unit of latitude and longitude, such as "deg" or "rad"')
    height_unit: str = Field("m", description="unit of the height")


class VelocityColumns(Block):
    """Velocity of the master relative to the Earth."""

    columns: Triple | None = Field(
        None,
        description="names or numbers from 0, in the order of `frame`: east, north, up or north, "
        'east, down; a leading "-" flips the sign',
    )
    unit: str | None = Field(None, description='unit of one, such as "m/s"')
    frame: Frame = Field("ENU", description='"NED" where they are north, east, down')

    @model_validator(mode="after")
    def _whole(self) -> VelocityColumns:
        _pair("velocity", self.columns, self.unit)
        if self.columns is None and self.frame != "ENU":
            what = "frame is given without columns; titles say what is north"
            raise error("master.columns", file="The master's table", what=what)
        if self.unit is not None:
            scaled_unit(self.unit, "velocity")
        return self


class AttitudeColumns(Block):
    """Heading, pitch and roll of the master: nose up and right side down are positive."""

    columns: Triple | None = Field(
        None,
        description="names or numbers from 0 for heading, pitch, roll; a leading "
        '"-" flips the sign',
    )
    unit: str | None = Field(None, description='unit of one, such as "deg" or "rad"')
    sense: Sense = Field(
        "clockwise", description="how the heading counts from north, seen from above"
    )

    @model_validator(mode="after")
    def _whole(self) -> AttitudeColumns:
        _pair("attitude", self.columns, self.unit)
        if self.unit is not None:
            scaled_unit(self.unit, "angle")
        return self


class MasterDescription(FileLayout):
    """Where the table of a master INS is and what its columns mean."""

    time: TimeColumn | None = Field(
        None, description="the stamp of each message, on the slave's clock or the master's"
    )
    arrival: TimeColumn | None = Field(
        None, description="when each arrived on the slave's clock, where that is logged beside it"
    )
    position: PositionColumns | None = None
    velocity: VelocityColumns = Field(default_factory=lambda: VelocityColumns.model_validate({}))
    attitude: AttitudeColumns = Field(default_factory=lambda: AttitudeColumns.model_validate({}))

    @model_validator(mode="after")
    def _consistent(self) -> MasterDescription:
        self.dated(self.time is not None)
        if self.file is None:
            raise error("log.no_file")
        return self


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


Data = dict[str, FloatArray]

_VELOCITY = {
    "ENU": ("velocity_east", "velocity_north", "velocity_up"),
    "NED": ("velocity_north", "velocity_east", "velocity_down"),
}
_PLACE = ("latitude", "longitude", "height")
_ANGLES = ("heading", "pitch", "roll")
_ROUNDING = 1e-6  # of angles at the end of their range [rad]


def read(description: MasterDescription, folder: str | Path = ".") -> MasterTable:
    """Read the table of a master.

    `folder`: folder that a relative file name starts from. Raises ``master.*``, ``log.*``,
    ``reference.*``: what is missing, or cannot be.
    """
    assert description.file is not None
    path = Path(folder) / description.file
    return master_table(open_raw(path, description), description, path)


def master_table(raw: RawTable, description: MasterDescription, path: Path) -> MasterTable:
    """Return the messages of a file in order, each once, East-North-Up and in SI."""
    data = _columns(raw, description, path)
    missing = [n for n in ("time", *_VELOCITY["ENU"], *_ANGLES) if n not in data]
    if missing:
        names = ", ".join(name.replace("_", " ") for name in missing)
        raise error("master.columns", file=path.name, what=f"it has no {names}")
    _possible(data, description, path)
    heading = data["heading"]
    if description.attitude.sense == "counter-clockwise":
        heading = -heading
    place = {"latitude", "longitude"} <= data.keys() and {n: data.get(n) for n in _PLACE}
    table = MasterTable(
        data["time"],
        np.column_stack([data[name] for name in _VELOCITY["ENU"]]),
        matrix_of(heading, data["pitch"], data["roll"]),
        data.get("arrival"),
        findings=raw.findings,
        **(place or {}),
    ).cleaned(description.missing, path.name)
    return checked(table, description, path.name)


def _columns(raw: RawTable, used: MasterDescription, path: Path) -> Data:
    """Read what is described, and by titles what is not, in SI; down turned up."""
    picks = dict(_described(raw, used, path))
    needed = {"time", *_VELOCITY["ENU"], *_ANGLES} - {"time" if used.rate else ""}
    known = picks.keys() | ({"velocity_up"} if "velocity_down" in picks else set())
    if raw.named and needed - known:
        picks = reference.titled_columns(raw, path) | picks
    numbers = [number for number, _ in picks.values()]
    pieces = list(kept(raw, path).blocks(numbers))
    rows = np.concatenate(pieces) if pieces else np.empty((0, len(numbers)))
    if not len(rows):
        raise error("log.empty", file=path.name)
    data = dict(zip(picks, (rows * [size for _, size in picks.values()]).T, strict=True))
    if "velocity_down" in data:
        data.setdefault("velocity_up", -data["velocity_down"])
    if used.rate is not None:
        data["time"] = np.arange(len(rows)) / used.rate
    return data


def _described(
    raw: RawTable, used: MasterDescription, path: Path
) -> Iterator[tuple[str, tuple[int, float]]]:
    """Yield name, number of the column and the SI value of one."""
    for name in ("time", "arrival"):
        block: TimeColumn | None = getattr(used, name)
        if block is not None:
            yield name, _time(raw, block, name, path)
    wanted: list[tuple[tuple[str, ...], tuple[int | str, ...] | None, list[float], str]] = []
    if used.position is not None:
        angle = used.position.one()
        sizes = [angle, angle, used.position.one("height_unit")]
        wanted.append((_PLACE, used.position.columns, sizes, "position"))
    if used.velocity.unit is not None:
        sizes = [scaled_unit(used.velocity.unit, "velocity")] * 3
        wanted.append((_VELOCITY[used.velocity.frame], used.velocity.columns, sizes, "velocity"))
    if used.attitude.unit is not None:
        sizes = [scaled_unit(used.attitude.unit, "angle")] * 3
        wanted.append((_ANGLES, used.attitude.columns, sizes, "attitude"))
    for names, some, sizes, what in wanted:
        for name, column, size in zip(names, some or (), sizes, strict=False):
            number, sign = columns.find(raw, column, path, what, "master")
            yield name, (number, sign * size)


def _time(raw: RawTable, block: TimeColumn, name: str, path: Path) -> tuple[int, float]:
    if block.column is None:
        if name != "time":
            raise error("master.columns", file=path.name, what=f"{name} has no `column`")
        return columns.guess(raw, name, path)[0], block.one()
    number, sign = columns.find(raw, block.column, path, name, "master")
    if block.iso != (number in raw.stamps):
        code = "log.time_not_iso" if block.iso else "log.time_iso"
        raise error(code, file=path.name, column=raw.names[number], unit=block.unit)
    return number, sign * block.one()


def _possible(data: Data, used: MasterDescription, path: Path) -> None:
    """Refuse angles outside of their range: a wrong unit, or columns in another order."""
    unit = used.attitude.unit or "in the titles"
    limits = {"heading": 2 * np.pi, "pitch": np.pi / 2, "roll": np.pi}
    for name, limit in limits.items():
        worst = float(np.nanmax(np.abs(data[name]), initial=0.0))
        if worst > limit + _ROUNDING:
            raise error("master.angles", file=path.name, angle=name, unit=unit,
                        given=f"{np.degrees(worst):.6g}")  # fmt: skip
    if "latitude" in data:
        worst = float(np.nanmax(np.abs(data["latitude"]), initial=0.0))
        if worst > np.pi / 2:
            raise error("reference.latitude", file=path.name, given=f"{np.degrees(worst):.6g}")


def write(table: MasterTable, path: str | Path, *, wrap: Literal[180, 360] = 360) -> None:
    """Write a table as CSV whose titles say what it holds, readable as master and as reference.

    `path`: the file, replaced whole or not at all; `wrap`: headings from 0 to 360 deg, or from
    -180 to 180 deg.
    """
    angles = table.angles.copy()
    if wrap == 180:
        angles[:, 0] = turned(angles[:, 0])
    made: dict[str, tuple[FloatArray | None, int]] = {
        "time (s)": (table.time, 6),
        "arrival (s)": (table.arrival, 6),
        **{f"{n} (deg)": (np.degrees(angles[:, i]), 7) for i, n in enumerate(_ANGLES)},
        **{f"velocity {n} (m/s)": (table.velocity_n[:, i], 6)
           for i, n in enumerate(("east", "north", "up"))},
        "latitude (deg)": (None if table.latitude is None else np.degrees(table.latitude), 10),
        "longitude (deg)": (None if table.longitude is None else np.degrees(table.longitude), 10),
        "height (m)": (table.height, 4),
    }  # fmt: skip
    some = {title: (v, digits) for title, (v, digits) in made.items() if v is not None}
    with atomic(Path(path)) as part:
        np.savetxt(
            part, np.column_stack([v for v, _ in some.values()]), delimiter=",", comments="",
            header=",".join(some), fmt=[f"%.{digits}f" for _, digits in some.values()],
        )  # fmt: skip
