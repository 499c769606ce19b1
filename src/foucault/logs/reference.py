"""The reference that a navigation is compared with: a file of positions, velocities, angles.

``time (s), latitude (deg), longitude (deg), height (m), velocity east (m/s), velocity north (m/s),
velocity up (m/s), heading (deg), pitch (deg), roll (deg)``: time and some of the others, in any
order, the unit in the title. A trajectory that Foucault has written is read too.

Velocities that should lead from each position of a table to the next, and where they lead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error
from foucault.files import sha256
from foucault.logs.description import bare_title, unit_in
from foucault.logs.layout import FileLayout
from foucault.logs.raw import RawTable, kept, open_raw
from foucault.models.earth import displacement
from foucault.models.rotation import turned
from foucault.units import plain

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


_TITLES = {
    "time": ("time", "t", "timestamp"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long"),
    "height": ("height", "altitude", "alt", "h"),
    "velocity_east": ("velocityeast", "velocitye", "eastvelocity", "ve", "veast"),
    "velocity_north": ("velocitynorth", "velocityn", "northvelocity", "vn", "vnorth"),
    "velocity_up": ("velocityup", "velocityu", "upvelocity", "vu", "vup"),
    "velocity_down": ("velocitydown", "velocityd", "downvelocity", "vd", "vdown"),
    "heading": ("heading", "yaw", "trueheading"),
    "pitch": ("pitch",),
    "roll": ("roll",),
    "arrival": ("arrival", "arrivaltime", "received"),
}
"""Column -> how it may be titled, spaces and signs left out."""

_KINDS = {"time": "time", "arrival": "time", "height": "length"} | dict.fromkeys(
    ("velocity_east", "velocity_north", "velocity_up", "velocity_down"), "velocity"
)
_ENDINGS = {
    "time": {"s": "s", "ms": "ms", "us": "us"},
    "angle": {"deg": "deg", "rad": "rad"},
    "length": {"m": "m", "km": "km"},
    "velocity": {"mps": "m/s", "m_s": "m/s", "ms": "m/s"},
}
BESIDE = 2.0
"""On the move a place is interpolated between epochs that are no farther apart [s]."""

_VELOCITY = ("velocity_east", "velocity_north", "velocity_up")
_ANGLES = ("heading", "pitch", "roll")


@dataclass(frozen=True)
class Reference:
    """What is known of a trajectory from elsewhere; None where it says nothing of it."""

    time: FloatArray  # (n,) time, of the same clock as the log, rising [s]
    # (n, 3) latitude, longitude [rad] and height [m]; NaN where a row does not say it
    position: FloatArray | None = None
    # (n, 3) East, north, up; NaN where a component is not given [m/s]
    velocity_n: FloatArray | None = None
    # (n, 3) heading, pitch, roll; NaN where an angle is not given [rad]
    angles: FloatArray | None = None
    has_height: bool = True  # whether the heights mean something
    still: bool = False  # it stood still at a known site all the time
    source: dict[str, Any] = field(default_factory=dict)  # file, sha256 and rows

    @property
    def says(self) -> npt.NDArray[np.bool_]:
        """Which rows say where it is, or how fast where no row says that, shape (n,)."""
        for table, some in ((self.position, 2), (self.velocity_n, 2), (self.angles, 3)):
            if table is None:
                continue
            known = np.isfinite(table[:, :some]).any(axis=1)
            if known.any():
                return np.asarray(known)
        return np.ones(len(self.time), bool)

    @classmethod
    def site(cls, time: FloatArray, latitude: float, longitude: float, height: float) -> Reference:
        """Return the reference of something that never moved.

        `time` (n,): epochs to compare at [s]; `latitude`, `longitude`: of the site [rad];
        `height`: of the site [m].
        """
        position = np.tile([latitude, longitude, height], (len(time), 1))
        return cls(np.asarray(time, float), position, np.zeros((len(time), 3)), still=True)

    def place(self, start: float, end: float) -> FloatArray | None:
        """Return latitude, longitude [rad] and height [m] at the end of a rest, shape (3,).

        `start`, `end`: the rest, the same where it moves [s]. Returns None where the reference
        says nothing of that time.
        """
        if self.position is None:
            return None
        known = np.isfinite(self.position).all(axis=1)
        time, position = self.time[known], self.position[known]
        before = int(np.searchsorted(time, end, side="right")) - 1
        if before >= 0 and time[before] >= start:
            return np.asarray(position[before])
        i = min(max(before, 0), len(time) - 2)
        if i < 0 or time[i + 1] - time[i] > BESIDE:
            return None
        part = (end - time[i]) / (time[i + 1] - time[i])
        if not -1 <= part <= 2:  # an epoch more than it has
            return None
        step = position[i + 1] - position[i]
        step[1:2] = turned(step[1:2])
        return np.asarray(position[i] + part * step)

    def velocity(self, time: float) -> FloatArray | None:
        """Return the velocity E N U at a time, shape (3,) [m/s].

        `time`: when [s]. Returns as given, zero where a component is not; else by the positions
        around it, where they are close enough; else None.
        """
        if self.velocity_n is not None:
            return np.array([_between(time, self.time, v) for v in self.velocity_n.T])
        before, after = (self.place(t, t) for t in (time - BESIDE / 2, time + BESIDE / 2))
        if before is None or after is None:
            return None
        return np.asarray(displacement(*before, *after) / BESIDE)


def _between(at: float, time: FloatArray, value: FloatArray) -> float:
    """Return a value between those that are known, shape (n,); zero where none is."""
    known = np.isfinite(value)
    return float(np.interp(at, time[known], value[known])) if known.any() else 0.0


def read(path: str | Path) -> Reference:
    """Read a reference; the titles of its columns carry the units.

    Raises ``reference.titles``, ``reference.time``: what is missing or wrong.
    """
    path = Path(path)
    raw = open_raw(path, FileLayout.model_validate({"file": path.name}))
    where = titled_columns(raw, path)
    rows = np.concatenate([*kept(raw, path).blocks([number for number, _ in where.values()])])
    scale = [size for _, size in where.values()]
    columns = dict(zip(where, (rows * scale).T, strict=True))
    if "velocity_down" in columns:
        columns.setdefault("velocity_up", -columns["velocity_down"])
    time = columns["time"]
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise error("reference.time", file=path.name, rows=len(time))
    source = {"file": str(path), "sha256": sha256(path), "rows": len(time)}
    found = Reference(
        time, _position(columns, path), _together(columns, _VELOCITY), _together(columns, _ANGLES),
        "height" in columns, source=source,
    )  # fmt: skip
    _not_swapped(found, path)
    return found


def _not_swapped(found: Reference, path: Path) -> None:
    """Refuse latitude and longitude that are exchanged, by what the velocities say of the way."""
    if found.position is None or found.velocity_n is None:
        return
    both = np.column_stack([found.position[:, :2], found.velocity_n[:, :2]])
    rows = np.isfinite(both).all(axis=1)
    # Level ways alone: heights and velocities up are often left out.
    position, velocity = (np.nan_to_num(x[rows]) for x in (found.position, found.velocity_n))
    seen = misses(found.time[rows], position, velocity, heights=False)
    if seen is not None and seen.place_swapped:
        raise error("reference.place_swapped", file=path.name, miss=plain(seen.miss, 3),
                    time=plain(seen.time, 3), better=plain(seen.exchanged, 3))  # fmt: skip


def titled_columns(raw: RawTable, path: Path) -> dict[str, tuple[int, float]]:
    """Return the number of every column that is known, and the SI value of its unit.

    Raises ``reference.titles``: what is missing or not said.
    """
    have = "the columns " + ", ".join(raw.names) if raw.named else f"{len(raw.names)} columns"

    def wrong(reason: str) -> FoucaultError:
        return error("reference.titles", file=path.name, have=have, reason=reason)

    if not raw.named:
        raise wrong("the file has no titles")
    found: dict[str, tuple[int, float]] = {}
    stated = _stated(path)
    for column, titles in _TITLES.items():
        kind = _KINDS.get(column, "angle")
        ends = _ENDINGS[kind]
        names = [bare_title(name, ends) for name in raw.names]
        numbers = [i for i, name in enumerate(names) if name in titles]
        if len(numbers) > 1:
            raise wrong(f"more than one column is titled as {column.replace('_', ' ')}")
        if numbers:
            number = numbers[0]
            found[column] = (number, _size(raw, number, kind, stated, wrong))
    if "time" not in found:
        raise wrong("no column has a usual title of time")
    if not ({"latitude", "longitude"} <= found.keys() or set(_VELOCITY[:2]) <= found.keys()):
        raise wrong("it has neither latitude and longitude nor velocities to east and north")
    return found


def _size(raw: RawTable, number: int, kind: str, stated: Mapping[str, str], wrong: Any) -> float:
    """Return the SI value of the unit of a column."""
    title = raw.names[number]
    if number in raw.stamps:  # dates come as seconds
        return 1.0
    unit = stated.get(title) or unit_in(title, _ENDINGS[kind])
    if unit is None:
        raise wrong(f"the title {title} gives no unit")
    try:
        return units.factor(unit, kind)
    except FoucaultError as problem:
        raise wrong(f"{title}: {problem.message.rstrip('.')}") from None


def _stated(path: Path) -> dict[str, str]:
    """Return the units that the columns of a table of ours carry beside their titles."""
    if path.suffix.lower() not in (".parquet", ".pq"):
        return {}
    from pyarrow import parquet

    fields = parquet.read_schema(path)
    units_of = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in fields}
    return {name: unit for name, unit in units_of.items() if unit}


def _position(columns: dict[str, FloatArray], path: Path) -> FloatArray | None:
    if not {"latitude", "longitude"} <= columns.keys():
        return None
    latitude = columns["latitude"]
    worst = float(np.nanmax(np.abs(latitude)))
    if worst > np.pi / 2:
        raise error("reference.latitude", file=path.name, given=f"{np.degrees(worst):.6g}")
    height = columns.get("height", np.zeros_like(latitude))
    return np.column_stack([latitude, columns["longitude"], height])


def _together(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    if not columns.keys() & set(names):
        return None
    empty = np.full(len(columns["time"]), np.nan)
    return np.column_stack([columns.get(name, empty) for name in names])
