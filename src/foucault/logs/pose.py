"""Read what a tracking system said of a body: TUM, EuRoC, OptiTrack, Vicon, or columns of any file.

::

    TUM        t x y z qx qy qz qw, blanks between, no titles                 [s], [m]
    EuRoC      #timestamp [ns], p_RS_R_x [m], ..., q_RS_w [], q_RS_x [], ...
    OptiTrack  lines of titles, the last begins with Frame; rotation before position
    ROS        a bag: PoseStamped, Odometry, TransformStamped, tf with a child
    Vicon      begins with Segments: frame, RX RY RZ, TX TY TZ, or a quaternion

A quaternion is kept as it stands; which of its numbers is the scalar, and whether it turns the
body into the world or the other way, is told by the data unless it is declared.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.errors import Finding, error, finding
from foucault.files import atomic, sha256
from foucault.logs import description as columns
from foucault.logs.layout import Block, ColumnName, FileLayout, Measured, TimeColumn, scaled_unit
from foucault.logs.raw import RawTable, kept, open_raw
from foucault.models.pose import READINGS, PoseTable, Second

Triple = tuple[ColumnName, ColumnName, ColumnName]
Four = tuple[ColumnName, ColumnName, ColumnName, ColumnName]


class PositionColumns(Measured):
    """Position of the tracked point."""

    of: ClassVar[dict[str, str]] = {"unit": "length"}

    columns: Triple | None = Field(None, description="names or numbers from 0 for x, y, z")
    unit: str = Field("m", description='unit of all three, such as "m" or "mm"')


class QuaternionColumns(Block):
    """Attitude of the tracked body."""

    columns: Four | None = Field(None, description="names or numbers from 0, in their order")
    order: Literal["auto", "wxyz", "xyzw"] = Field(
        "auto", description="which of them is the scalar; auto: the data tell"
    )
    turns: Literal["auto", "body to world", "world to body"] = Field(
        "auto", description="which way it turns; auto: the data tell"
    )


class HeadingColumns(Measured):
    """Direction of the base of two antennas: heading clockwise from north, y, and pitch up."""

    of: ClassVar[dict[str, str]] = {"unit": "angle"}

    columns: tuple[ColumnName, ColumnName] = Field(description="names or numbers: heading, pitch")
    unit: str = Field("deg", description='unit of both, such as "deg"')


class FixedColumn(Block):
    """Quality that a receiver gives its positions."""

    column: ColumnName = Field(description="name or number from 0")
    values: tuple[float, ...] = Field((1.0,), description="what it says of a position to be used")


class PoseDescription(FileLayout):
    """Where the poses are and what their columns mean."""

    time: TimeColumn | None = None
    position: PositionColumns = Field(default_factory=lambda: PositionColumns.model_validate({}))
    attitude: QuaternionColumns | None = Field(
        default_factory=lambda: QuaternionColumns.model_validate({})
    )
    child: str | None = Field(
        None, description="frame of the tracked body, of a bag's tf", examples=["imu_marker"]
    )
    second: PositionColumns | None = Field(
        None, description="position of a second antenna, or prism, in the same axes"
    )
    base: PositionColumns | None = Field(
        None, description="vector from the first antenna to a second, in the same axes"
    )
    heading: HeadingColumns | None = Field(
        None, description="direction of that vector; its length is base_length of [procedure]"
    )
    fixed: FixedColumn | None = Field(
        None, description="which positions are used, by a column of a GNSS receiver"
    )
    position_only: bool = Field(False, description="use no attitude, whether there is one or not")

    @model_validator(mode="after")
    def _consistent(self) -> PoseDescription:
        self.dated(self.time is not None)
        if self.file is None:
            raise error("log.no_file")
        two = [name for name in ("second", "base", "heading") if getattr(self, name) is not None]
        attitude = self.attitude is not None and self.attitude.columns is not None
        if len(two) > 1 or (two and (self.position_only or attitude)):
            other = "position_only" if self.position_only else "attitude"
            raise error("pose.two_ways", given=" and ".join([*two, other][:2]))
        return self

    @property
    def reading(self) -> str | None:
        """Key of `READINGS`, where order and direction are both declared."""
        q = self.attitude
        if q is None or "auto" in (q.order, q.turns):
            return None
        return f"{' '.join(q.order)}, {q.turns}"


POSITIONS = (*(tuple(word + axis for axis in "xyz") for word in (
                 "", "p", "position", "t", "prsr", "pos", "translation")),
             ("pxm", "pym", "pzm"), ("easting", "northing", "height"))  # fmt: skip
QUATERNIONS = (("q0", "q1", "q2", "q3"), ("q1", "q2", "q3", "q4"), *(
    tuple(word + axis for axis in "wxyz") for word in (
        "q", "qrs", "orientation", "r", "quat", "quaternion", "rot", "rotation")))  # fmt: skip
SECONDS = (("x2", "y2", "z2"),)
"""Titles that people give, without unit and marks; q1 to q4 begin or end with the scalar."""


def read(description: PoseDescription, folder: str | Path = ".") -> PoseTable:
    """Read the poses of a file in order, each stamp once.

    `folder`: folder that a relative file name starts from. Raises ``pose.*``, ``log.*``: what is
    missing, or cannot be.
    """
    assert description.file is not None
    path = Path(folder) / description.file
    made = _exported(path) if path.suffix.lower() in (".csv", ".txt") and path.is_file() else None
    time, position, q, declared, second, fixed = made or _of_columns(path, description)
    told: tuple[Finding, ...] = ()
    finite = _there(position) & np.isfinite(time)
    if second is not None:
        # One antenna may be lost alone; a receiver repeats its last position then.
        q, one, two = None, _new(position), _new(second.place)
        position = np.where(one[:, None], position, np.nan)
        second = replace(second, place=np.where(two[:, None], second.place, np.nan))
        finite = (one | two) & np.isfinite(time)
        for which, there in (("first", one), ("second", two)):
            if alone := int((finite & ~there).sum()):
                told = (*told, finding("pose.antenna_lost", file=path.name, which=which,
                                       count=alone, of=len(time)))  # fmt: skip
    if fixed is not None:
        if (count := int((finite & ~fixed).sum())) > 0:
            told = (*told, finding("pose.float", file=path.name, count=count, of=len(time)))
        finite &= fixed
    if q is not None:
        size = np.linalg.norm(q, axis=1)
        finite &= (np.abs(size - 1.0) < 0.05) & np.isfinite(size)
    # A body that is lost is held at its last pose, or at zero.
    if second is None:
        finite &= _new(position if q is None else np.column_stack([position, q]))
    order = np.argsort(time[finite], kind="stable")
    rows = np.flatnonzero(finite)[order]
    rows = rows[np.append(True, np.diff(time[rows]) > 0)] if len(rows) else rows
    lost = len(time) - len(rows)
    if lost and fixed is None:
        told = (*told, finding("pose.lost", file=path.name, count=lost, of=len(time)))
    if len(rows) < FEWEST:
        raise error("pose.few", file=path.name, count=len(rows), least=FEWEST)
    reading = description.reading or declared
    use = None if q is None or description.position_only else q[rows]
    other = None if second is None else second[rows]
    return PoseTable(time[rows], position[rows], use, reading, other, told,
                     {"file": description.file, "sha256": sha256(path)})  # fmt: skip


def _there(x: FloatArray) -> BoolArray:
    return np.asarray(np.isfinite(x).all(axis=1))


def _new(x: FloatArray) -> BoolArray:
    """Tell which rows of `x` (n, q) [any unit] are numbers, and not those of the row before."""
    out = _there(x)
    out[1:] &= (np.diff(x, axis=0) != 0.0).any(axis=1)
    return out


FEWEST = 50
"""Poses below which nothing is compared [1]."""


class Columns(NamedTuple):
    """What a file holds, as it stands [SI]."""

    time: FloatArray
    position: FloatArray
    quaternion: FloatArray | None
    declared: str | None
    second: Second | None = None
    fixed: BoolArray | None = None


def _of_columns(path: Path, said: PoseDescription) -> Columns:
    raw = open_raw(path, said)
    position = _numbers(raw, said.position.columns, POSITIONS, path, "position")
    q = None if said.attitude is None else said.attitude.columns
    attitude = _numbers(raw, q, QUATERNIONS, path, "attitude") if said.attitude else None
    tum = not raw.named and len(raw.names) == 8 and position is None
    if tum:
        position, attitude = [1, 2, 3], [4, 5, 6, 7]
    if position is None:
        have = f"columns {', '.join(raw.names)}" if raw.named else f"{len(raw.names)} columns"
        raise error("pose.columns", file=path.name, have=have)
    time, one = _time(raw, said, path, tum)
    beside, of_second = _second(raw, said, path, attitude is not None)
    good = [] if said.fixed is None else [_one(raw, said.fixed.column, path, "fixed")]
    own = attitude if attitude and not beside else []
    wanted = [*([] if time is None else [time]), *position, *own, *beside, *good]
    rows = np.concatenate([*kept(raw, path).blocks(wanted)])
    stamp = np.arange(len(rows)) / (said.rate or 1.0) if time is None else rows[:, 0] * one
    rows = rows[:, 0 if time is None else 1 :]
    p = rows[:, :3] * said.position.one()
    declared = "x y z w, body to world" if tum else (raw.declared or {}).get("reading")
    fixed = None if said.fixed is None else np.isin(rows[:, -1], said.fixed.values)
    second = of_second(rows[:, 3 : 3 + len(beside)]) if beside else None
    return Columns(stamp, p, rows[:, 3:7] if own else None, declared, second, fixed)


def _second(
    raw: RawTable, said: PoseDescription, path: Path, attitude: bool
) -> tuple[list[int], Callable[[FloatArray], Second]]:
    """Return the columns of a second antenna, and what makes it of their numbers."""
    if said.heading is not None:
        angle = said.heading.one()

        def pointing(x: FloatArray) -> Second:
            heading, pitch = angle * x.T
            level = np.cos(pitch)
            return Second(np.column_stack([level * np.sin(heading), level * np.cos(heading),
                                           np.sin(pitch)]), "direction")  # fmt: skip

        return [_one(raw, name, path, "heading") for name in said.heading.columns], pointing
    told, block = ("base", said.base) if said.base is not None else ("position", said.second)
    if block is None and (attitude or said.position_only):
        return [], Second
    known = SECONDS if told == "position" else ()
    found = _numbers(raw, None if block is None else block.columns, known, path,
                        "second" if told == "position" else told)  # fmt: skip
    if found is None and block is not None:
        raise error("pose.second_columns", file=path.name, block="second" if said.second else told)
    one = (block or said.position).one()
    return found or [], lambda x: Second(one * x, told)


def _one(raw: RawTable, name: ColumnName, path: Path, block: str) -> int:
    return columns.find(raw, name, path, block, "master")[0]


def _time(raw: RawTable, said: PoseDescription, path: Path, tum: bool) -> tuple[int | None, float]:
    if said.rate is not None:
        return None, 1.0
    if said.time is not None and said.time.column is not None:
        return columns.find(raw, said.time.column, path, "time", "master")[0], said.time.one()
    number = 0 if tum else columns.guess(raw, "time", path)[0]
    if said.time is not None:
        return number, said.time.one()
    title = raw.names[number].lower() if raw.named else ""
    unit = re.search(r"[\[(]\s*(ns|us|ms|s)\s*[\])]|_(ns|us|ms|s)$", title)
    return number, scaled_unit(next(filter(None, unit.groups())) if unit else "s", "time")


def _numbers(
    raw: RawTable, given: tuple[ColumnName, ...] | None, known: tuple[tuple[str, ...], ...],
    path: Path, block: str,
) -> list[int] | None:  # fmt: skip
    if given is not None:
        return [_one(raw, name, path, block) for name in given]
    titles = [_bare(name) for name in raw.names] if raw.named else []
    for names in known:
        if set(names) <= set(titles):
            return [titles.index(name) for name in names]
    return None


def _bare(title: str) -> str:
    bare = re.sub(r"[(\[].*", "", title).lower()
    return re.sub(r"[^a-z0-9]", "", re.sub(r"_(m|mm)$", "", bare.strip()))


def _exported(path: Path) -> Columns | None:
    """Read what Motive and Nexus export, whose titles are several lines; None for other files."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        lines = [row for _, row in zip(range(20), csv.reader(stream), strict=False)]
    if not lines or not lines[0]:
        return None
    if lines[0][0] == "Format Version":
        return _optitrack(path, lines)
    if lines[0][0].strip() in ("Segments", "Global Angles", "Objects"):
        return _vicon(path, lines)
    return None


def _optitrack(path: Path, lines: list[list[str]]) -> Columns | None:
    """Read the first rigid body of an export of Motive."""
    said = dict(zip(lines[0][::2], lines[0][1::2], strict=False))
    last = next((k for k, row in enumerate(lines) if row[:2] == ["Frame", "Time (Seconds)"]), None)
    if last is None:
        return None
    what = lines[last - 1]
    rotation = [k for k, word in enumerate(what) if word == "Rotation"][:4]
    position = [k for k, word in enumerate(what) if word == "Position"][:3]
    if said.get("Rotation Type", "Quaternion") != "Quaternion":
        raise error("pose.euler", file=path.name, given=said["Rotation Type"])
    if len(rotation) < 4 or len(position) < 3:
        raise error("pose.columns", file=path.name, have="no rigid body with position and rotation")
    rows = _cells(path, last + 1, [1, *position, *rotation])
    unit = {"Meters": 1.0, "Centimeters": 0.01, "Millimeters": 1e-3}
    one = unit.get(said.get("Length Units", "Meters"), 1.0)
    return Columns(rows[:, 0], rows[:, 1:4] * one, rows[:, 4:8], "x y z w, body to world")


def _vicon(path: Path, lines: list[list[str]]) -> Columns:
    """Read the first segment of an export of Nexus: its rate, titles, units, then frames."""
    rate = float(lines[1][0])
    titles, units = lines[3], lines[4]
    turn = [k for k, word in enumerate(titles) if re.fullmatch(r"R[XYZW]", word.strip())]
    place = [k for k, word in enumerate(titles) if re.fullmatch(r"T[XYZ]", word.strip())][:3]
    quaternion = any(titles[k].strip() == "RW" for k in turn[:4])
    turn = turn[: 4 if quaternion else 3]
    rows = _cells(path, 5, [0, *place, *turn])
    one = scaled_unit(units[place[0]].strip() or "mm", "length")
    time = (rows[:, 0] - 1) / rate
    if quaternion:
        return Columns(time, rows[:, 1:4] * one, rows[:, 4:8], "x y z w, body to world")
    # Nexus writes the rotation vector of a segment.
    vector = rows[:, 4:7] * scaled_unit(units[turn[0]].strip() or "rad", "angle")
    half = np.linalg.norm(vector, axis=1)[:, None] / 2
    q = np.column_stack([np.cos(half), vector / 2 * np.sinc(half / np.pi)])
    return Columns(time, rows[:, 1:4] * one, q, "w x y z, body to world")


def _cells(path: Path, first: int, wanted: list[int]) -> FloatArray:
    """Return the numbers of some columns; where a body was lost its cells are empty: NaN."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        rows = [
            [float(row[k]) if k < len(row) and row[k].strip() else np.nan for k in wanted]
            for n, row in enumerate(csv.reader(stream))
            if n >= first and row and row[0].strip()
        ]
    return np.array(rows, float).reshape(-1, len(wanted))


STANDS_OUT, BESIDE = 8.0, 10
"""A step of poses is so many times any within so many poses beside it [1]."""


def jumps_of(q: PoseTable) -> IntArray:
    """Return how often positions or attitudes have jumped before each pose, shape (m,).

    A wild pose jumps and comes back; where a tracking system has lost its body and found it again
    elsewhere there is one step that no motion beside it has the like of.
    """
    far = _jumps(q.time, q.position)
    if q.quaternion is not None:  # in whatever order and direction
        turned = np.sum(q.quaternion[1:] * q.quaternion[:-1], axis=1)
        same = np.cumprod(np.append(1.0, np.where(turned < 0.0, -1.0, 1.0)))
        far |= _jumps(q.time, q.quaternion * same[:, None])
    return np.cumsum(np.concatenate([[0, 0], far, [0]]).astype(int))


def _jumps(time: FloatArray, x: FloatArray) -> BoolArray:
    """Return which of all steps but the first and the last are jumps, (m - 3,), of `x` (m, q)."""
    from scipy.ndimage import maximum_filter1d

    dt = np.diff(time)[:, None]
    v = np.diff(x, axis=0) / dt
    step = np.linalg.norm((v[1:-1] - (v[2:] + v[:-2]) / 2) * dt[1:-1], axis=1)
    step[(dt > 3 * np.median(dt))[1:-1, 0]] = 0.0  # lost for a while it has moved
    away = BESIDE // 2 + 2
    near = maximum_filter1d(step, BESIDE + 1)
    beside = np.maximum(np.roll(near, away), np.roll(near, -away))
    # Both intervals beside a step are half as far from their neighbours as it is.
    far = (step > STANDS_OUT * beside) & (step == maximum_filter1d(step, 7))
    return np.asarray(far & (np.linalg.norm(x[3:] - x[:-3], axis=1) > step / 2))


def write(table: PoseTable, path: str | Path) -> None:
    """Write poses as CSV whose titles say what it holds.

    `path`: the file, replaced whole or not at all.
    """
    made = [table.time[:, None], table.position]
    titles = ["time (s)", "x (m)", "y (m)", "z (m)"]
    if table.quaternion is not None:
        order, sign = READINGS[table.reading or next(iter(READINGS))]
        made.append(table.quaternion[:, order] * [1.0, sign, sign, sign])
        titles += ["qw", "qx", "qy", "qz"]
    if table.second is not None:
        made.append(table.second.place)
        titles += ["x2 (m)", "y2 (m)", "z2 (m)"]
    with atomic(Path(path)) as part:
        np.savetxt(part, np.column_stack(made), delimiter=",", comments="",
                   header=",".join(titles), fmt="%.9f")  # fmt: skip
