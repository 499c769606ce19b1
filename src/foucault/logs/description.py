"""The ``[log]`` block of a campaign: which column of a file is which axis, in which unit.

Everything a file cannot say about itself is declared, never guessed: units above all. Only
files written by this package need no description, because they say it themselves.

From the words of a description to column numbers of a file.

What the titles of the columns of a file say: which axis, and in which unit.

``gyro_x (deg/s)``, ``acc_x [g]``, ``time_ms``. A triad in a unit of increments, such as ``gyro_x
(rad)`` and ``accel_x (m/s)``, holds increments, if all triads do. Used only for a log that nobody
described; what a campaign declares is never overruled.

What a file or its format says about itself, and what must still be described.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

import numpy as np
from pydantic import Field, field_validator, model_validator

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding, some, suggestion
from foucault.logs.layout import (
    COUNTS,
    Averaged,
    Block,
    ColumnName,
    FileLayout,
    TemperatureColumn,
    TimeColumn,
    conversion,
    limits,
    no_count_scale,
    scaled_unit,
)
from foucault.logs.raw import RawTable, open_raw
from foucault.tables import AXES
from foucault.units import parse

if TYPE_CHECKING:
    from foucault.logs.layout import ColumnName

TIME_NAMES = ("time", "t", "timestamp", "time_s", "seconds", "sec")
TEMPERATURE_NAMES = ("temperature", "temp")
TRIAD_PREFIXES = {
    "gyro": ("gyro", "gyr", "g", "w", "omega", "angular_velocity"),
    "accel": ("accel", "acc", "a", "f", "linear_acceleration"),
    "mag": ("mag", "m", "magnetometer", "magnetic_field"),
}
"""Usual beginnings of column names; ``gx``, ``gyr_x``, ``gyro.x`` and ``Gyro X`` all count."""

SINGLE_NAMES = {
    "gyro": ("rate", "angularrate", "rotationrate"),
    "accel": ("acceleration", "specificforce"),
    "mag": (),
}
"""Usual names of the only column of a triad, without spaces."""


OWN_LOG = """\
[log]
file = "log.csv"                        # relative to this file; it says itself what it holds
"""
"""[log] of a simulated log that no column and unit can describe: means over the intervals."""


def log_head(note: str = "", *, before_gyro: str = "", up: str = "") -> str:
    """Return how [log] of an IMU begins in a template.

    `note`: on the file; `before_gyro`: lines; `up`: what [log] says of the accelerometers besides.
    """
    return f"""\
[log]
file = "log.csv"                        # {note}relative to this file
# CSV or spaced text (.gz too), Parquet, .npy, .npz, .mat and binary records can be read.
# Columns by name, or by number from 0 in a file without a header; "-gy" flips a sign.
# Numbers such as 9,81: write decimal = "," too; what stands between columns is found.
# Without a time column write rate = "100 Hz" instead of `time`.
time = {{ column = "time", unit = "s" }}
{before_gyro}\
gyro = {{ columns = ["gyro_x", "gyro_y", "gyro_z"], unit = "rad/s" }}
accel = {{ columns = ["accel_x", "accel_y", "accel_z"], unit = "m/s^2"{up} }}
"""


def find(
    raw: RawTable, wanted: ColumnName, path: Path, block: str, table: str = "log"
) -> tuple[int, float]:
    """Find one column.

    `wanted`: name, or number from 0, text may start with "-"; `block`: block of the campaign that
    names the column, for the error text; `table`: table of the campaign that the block is in, for
    the error text. Returns `number`: number of the column; `sign`: -1.0 where the sign is to be
    turned, else 1.0.
    """
    if isinstance(wanted, str) and wanted in raw.names:
        return raw.names.index(wanted), 1.0
    text = _spaced(str(wanted))
    if isinstance(wanted, str) and raw.named:
        # Spaces at the ends are not seen; and `t` names "t (s)" too. Where only one is called so.
        for known in (_spaced, _bare):
            alike = [i for i, name in enumerate(raw.names) if known(name) == text]
            if len(alike) == 1:
                return alike[0], 1.0
            if alike:
                break
    if isinstance(wanted, str) and text.startswith("-"):
        number, _ = find(raw, text[1:], path, block, table)
        return number, -1.0
    if text.isdecimal() and len(text) < 9 and int(text) < len(raw.names):
        return int(text), 1.0
    if raw.named:
        hint = suggestion(text, raw.names)
        allowed = f"The columns are {some(raw.names)}."
    else:
        hint = ""
        count = len(raw.names)
        allowed = f"The file has no names; its {count} columns are numbered 0 to {count - 1}."
    words = {"hint": hint, "allowed": allowed, "table": table, "block": block}
    raise error("log.unknown_column", file=path.name, name=text, **words)


def find_all(
    raw: RawTable, wanted: Sequence[ColumnName | None], path: Path, block: str
) -> tuple[list[int], FloatArray]:
    """Return numbers and signs, shape (k,) [1], of the columns of a block; [None]: guessed."""
    if list(wanted) == [None]:
        numbers = guess(raw, block, path)
        return numbers, np.ones(len(numbers))
    pairs = [find(raw, name, path, block) for name in wanted if name is not None]
    return [number for number, _ in pairs], np.array([sign for _, sign in pairs])


def find_time(raw: RawTable, time: TimeColumn, path: Path) -> tuple[list[int], FloatArray]:
    """Return the number of the column of the times and the SI value of one, shape (1,) [s]."""
    numbers, sign = find_all(raw, [time.column], path, "time")
    if time.iso != (numbers[0] in raw.stamps):
        code = "log.time_not_iso" if time.iso else "log.time_iso"
        raise error(code, file=path.name, column=raw.names[numbers[0]], unit=time.unit)
    return numbers, time.one() * sign


def no_dates(raw: RawTable, numbers: list[int], path: Path) -> None:
    """Refuse dates where readings are expected; `numbers`: of their columns [1]."""
    dates = [raw.names[n] for n in numbers if n in raw.stamps]
    if dates:
        raise error("log.not_numeric", file=path.name, line="every line", column=dates[0],
                    cell="a date", hint="")  # fmt: skip


def guess(raw: RawTable, block: str, path: Path) -> list[int]:
    """Find the columns of a block by the names people usually give them.

    Returns column numbers: one, or three for a triad.
    """
    plain = [_plain(name) for name in raw.names] if raw.named else []
    singles = {"time": TIME_NAMES, "temperature": TEMPERATURE_NAMES}.get(block)
    groups: list[Sequence[str]]
    if singles is not None:
        groups = [[name] for name in singles]
    else:
        groups = [[p + axis for axis in AXES] for p in TRIAD_PREFIXES[block]]
    for group in groups:
        names = [re.sub(r"[^a-z0-9]", "", name) for name in group]
        if set(names) <= set(plain):
            return [plain.index(name) for name in names]
    example = "columns = [1, 2, 3]" if singles is None else "column = 0"
    have = f"columns {', '.join(raw.names)}" if raw.named else f"{len(raw.names)} unnamed columns"
    raise error("log.cannot_guess", file=path.name, block=block, have=have, example=example)


def guess_some(raw: RawTable, block: str) -> list[int | None]:
    """Find the columns of a triad that lacks some, by the names people usually give them.

    Returns column numbers of x, y, z; a single column without an axis in its name is x; empty
    where there is none.
    """
    plain = [_plain(name) for name in raw.names] if raw.named else []
    known = [re.sub(r"[^a-z0-9]", "", p) for p in TRIAD_PREFIXES[block]]
    for prefix in known:
        found = [plain.index(prefix + a) if prefix + a in plain else None for a in AXES]
        if found != [None] * 3:
            return found
    alone = [i for i, name in enumerate(plain) if name in (*known, *SINGLE_NAMES[block])]
    return [alone[0], None, None] if len(alone) == 1 else []


def titled_axis(title: str) -> int:
    """Return the number of the axis that a title names, as "gyro_z (deg/s)" does; else 0, for x."""
    word = _plain(title)
    named = [p for known in TRIAD_PREFIXES.values() for p in known]
    prefixes = {re.sub(r"[^a-z0-9]", "", p) for p in named} | {""}
    ends = bool(re.search(r"[_. -][xyzXYZ]$", re.sub(r"\s*[(\[].*", "", title.strip())))
    return AXES.index(word[-1]) if word[-1:] in AXES and (ends or word[:-1] in prefixes) else 0


def _bare(name: str) -> str:
    """Return a column's `name` without a unit in brackets."""
    return re.sub(r"\s*[(\[][^)\]]*[)\]]\s*$", "", _spaced(name))


def _spaced(name: str) -> str:
    """Return a title without spaces at its ends, and one of each within."""
    return " ".join(name.split())


def _plain(name: str) -> str:
    # "Gyro_X (deg/s)" and "gyro x [deg/s]" both mean gyrox
    return re.sub(r"[^a-z0-9]", "", re.sub(r"[(\[].*", "", name).lower())


Direction = Literal["x up", "x down", "y up", "y down", "z up", "z down"]


def _or_one_column(schema: dict[str, Any]) -> None:
    """Let a schema take one column too, by itself or in a list."""
    one = {"anyOf": [{"type": "string"}, {"type": "integer"}]}
    schema["anyOf"] += [*one["anyOf"], {"type": "array", "items": one, "maxItems": 1}]


class Triad(Block):
    """Columns of one instrument, x y z in right-forward-up body axes; fewer for its noise alone."""

    name: ClassVar[str]
    kinds: ClassVar[dict[str, str]]

    file: str | None = Field(None, description="file of these columns, if not the log's")
    columns: tuple[ColumnName | None, ColumnName | None, ColumnName | None] | None = Field(
        None,
        description='names or numbers from 0 for x, y, z; a leading "-" flips the sign ("-gy"); '
        'guessed from the header if left out. For allan and inspect also one column, or "" for an '
        "axis that is not logged",
        json_schema_extra=_or_one_column,
    )
    unit: str | tuple[str, str, str] = Field(
        description='unit of one, such as "deg/s", "0.1 arcsec", or "count"; a list of three where '
        "the axes have their own, such as the weights of their pulses"
    )
    kind: Literal["rate", "increment"] = Field(
        "rate", description='"increment": each row is the integral over the interval before it'
    )
    scale: str | tuple[str, str, str] | None = Field(
        None, description="count scale, one for all axes or three; only with unit = 'count'"
    )
    zero: float | tuple[float, float, float] = Field(
        0.0, description="count that means zero, one or three; only with unit = 'count'"
    )
    saturation: float | tuple[float, float] | None = Field(
        None, description="largest value the instrument can say, or [lowest, highest], in `unit`"
    )

    @field_validator("columns", mode="before")
    @classmethod
    def _three(cls, value: object) -> object:
        if value is None:
            return None
        given = list(value) if isinstance(value, list | tuple) else [value]
        named = [c for c in given if c not in ("", None)]
        if not named or len(given) not in (1, 3):
            raise error("log.three_columns", block=cls.name, given=value)
        if len(given) == 3:
            return tuple(None if name == "" else name for name in given)
        out: list[object] = [None, None, None]
        out[titled_axis(str(given[0]))] = given[0]
        return tuple(out)

    @model_validator(mode="after")
    def _convertible(self) -> Triad:
        self.conversion()
        return self

    @property
    def logged(self) -> tuple[int, ...]:
        """Numbers of the axes that have a column."""
        return tuple(i for i in range(3) if self.columns is None or self.columns[i] is not None)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every axis, or the one of all."""
        return (self.unit,) if isinstance(self.unit, str) else self.unit

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (3,): SI value = (raw - zero) * factor."""
        if not isinstance(self.unit, str):
            for unit in self.unit:
                self._check_kind(unit)
            if self.scale is not None or np.any(self.zero):
                raise error("log.scale_without_count", block=self.name, unit=", ".join(self.unit))
            kind = self.kinds[self.kind]
            return np.zeros(3), np.array([scaled_unit(unit, kind) for unit in self.unit])
        if self.unit not in COUNTS and self.scale is None:
            self._check_kind(self.unit)
        elif self.unit in COUNTS and self.kind == "increment":
            raise no_count_scale(self.name)
        kind = self.kinds[self.kind]
        return conversion(self.name, self.unit, kind, self.scale, self.zero, 3)

    def limits(self) -> FloatArray | None:
        """Return the range as declared, lowest and highest, shape (2,) [`unit`]."""
        return limits(self.saturation)

    def _check_kind(self, unit: str) -> None:
        try:
            scaled_unit(unit, self.kinds[self.kind])
        except FoucaultError as problem:
            other = "increment" if self.kind == "rate" else "rate"
            try:
                scaled_unit(unit, self.kinds[other])
            except FoucaultError:
                raise problem from None
            raise error(
                "log.kind", block=self.name, unit=unit, kind=self.kind, other=other
            ) from None


class GyroColumns(Triad):
    """The gyro columns: angular rate w_ib_b, or its integral over each interval."""

    name: ClassVar[str] = "gyro"
    kinds: ClassVar[dict[str, str]] = {"rate": "angular rate", "increment": "angle increment"}


class AccelColumns(Triad):
    """The accelerometer columns: specific force f_b (+1 g up at rest), or its integral."""

    name: ClassVar[str] = "accel"
    kinds: ClassVar[dict[str, str]] = {"rate": "specific force", "increment": "velocity increment"}

    reads: Literal["specific force", "gravity"] = Field(
        "specific force", description='"gravity" where the file says -1 g along up at rest'
    )
    first_rest: Direction | None = Field(
        None, description="which axis points where during the first rest, if known"
    )

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (3,); the sign turns gravity into f_b."""
        zero, scale = super().conversion()
        return zero, -scale if self.reads == "gravity" else scale


class MagColumns(Triad):
    """The magnetometer columns: field along its axes, which may differ from those of the IMU."""

    name: ClassVar[str] = "mag"
    kinds: ClassVar[dict[str, str]] = {"rate": "magnetic field", "increment": "magnetic field"}

    kind: Literal["rate"] = Field("rate", description="each row is the field at its time")


class TableBlock(Block):
    """Columns of the table that the instrument stands on."""

    file: str | None = Field(None, description="file of these columns, if not the log's")
    columns: tuple[ColumnName | None, ColumnName | None, ColumnName | None] | None = Field(
        None,
        description='names or numbers from 0 for the outer, middle and inner angle; "" where one '
        'is not logged; a leading "-" flips the sign',
    )
    unit: str | None = Field(None, description='unit of the angles, such as "deg" or "rad"')
    rate: ColumnName | None = Field(
        None,
        description="rate of the outer axis, counter-clockwise from above; 0 at rest",
    )
    rate_unit: str | None = Field(None, description='unit of the rate, such as "deg/s"')
    position: ColumnName | None = Field(
        None, description="number of the position, a whole number; empty or -1 in between"
    )

    stamped: Literal["start", "middle", "end"] | None = Field(
        None,
        description="instant of the interval of its row that an angle belongs to, where rows are "
        "increments or means over it; left out: the instant of the row's time",
    )

    @field_validator("columns", mode="before")
    @classmethod
    def _three(cls, value: object) -> object:
        if value is None:
            return None
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise error("log.table_columns", given=value)
        return tuple(None if name in ("", None) else name for name in value)

    @model_validator(mode="after")
    def _complete(self) -> TableBlock:
        if self.columns is None and self.rate is None and self.position is None:
            raise error("log.table_empty")
        for name, unit, kind in (("columns", self.unit, "angle"),
                                 ("rate", self.rate_unit, "angular rate")):  # fmt: skip
            if getattr(self, name) is not None:
                key = "unit" if name == "columns" else "rate_unit"
                if unit is None:
                    raise error("log.table_unit", key=key, name=name,
                                example={"angle": "deg"}.get(kind, "deg/s"))  # fmt: skip
                scaled_unit(unit, kind)
        return self

    def numbers(self) -> dict[str, tuple[ColumnName, float]]:
        """Return what is logged: the column, and the SI value of one of its units, by name."""
        found: dict[str, tuple[ColumnName, float]] = {}
        for name, column in zip(("outer", "middle", "inner"), self.columns or (), strict=False):
            if column is not None and self.unit is not None:
                found[name] = (column, scaled_unit(self.unit, "angle"))
        if self.rate is not None and self.rate_unit is not None:
            found["table_rate"] = (self.rate, scaled_unit(self.rate_unit, "angular rate"))
        if self.position is not None:
            found["position"] = (self.position, 1.0)
        return found


_SPAN = re.compile(r"\s*([0-9.eE+]+)\s*-\s*([0-9.eE+]+)\s*([A-Za-z]+)\s*")


def _of_texts(schema: dict[str, Any]) -> None:
    """Let a schema take what a file says: one text for each rest."""
    schema["anyOf"][0] = {"type": "array", "items": {"type": "string"}, "minItems": 1}


class LogDescription(FileLayout):
    """Where a log is and what its columns mean."""

    more: tuple[str, ...] = Field(
        (),
        examples=[["spins.csv"]],
        description="further files with the same columns, recorded one by one, such as the rests "
        "in one and the spins in another; what is between them was not logged",
    )
    join: Literal["rows", "times"] = Field(
        "rows",
        description='what puts the rows of several files together: "rows", their number, as of one '
        'sampler; "times", their stamps: the faster are averaged over the intervals of the slowest',
    )
    time: TimeColumn | None = None
    gyro: GyroColumns | None = None
    accel: AccelColumns | None = None
    mag: MagColumns | None = None
    temperature: TemperatureColumn | None = None
    table: TableBlock | None = Field(
        None, description="angles and rate of the table that the instrument stands on"
    )
    stamped: Literal["end", "start"] = Field(
        "end",
        description="which end of its interval the time of a row of increments is; a stamp at the "
        "start is moved to the end",
    )
    averaged: Averaged | None = Field(
        None,
        description="only where every row is already the mean over one position: over how long; "
        "a time column is then the beginning of each mean, and may be left out",
    )
    rests: tuple[tuple[float, float], ...] | None = Field(
        None,
        examples=[["0-3.1 s", "4.25-9.7 s"]],
        description="first and last sample of each rest, in time from the first sample of the log, "
        "where they are not to be looked for; as `foucault serve` writes them",
        json_schema_extra=_of_texts,
    )
    serial: ColumnName | None = Field(
        None, description="column of the serial number, where rows of several instruments are mixed"
    )

    @field_validator("rests", mode="before")
    @classmethod
    def _spans(cls, value: object) -> object:
        if value is None:
            return None
        out: list[tuple[float, float]] = []
        for one in value if isinstance(value, list | tuple) else [value]:
            said = _SPAN.fullmatch(one) if isinstance(one, str) else None
            ends = [f"{said[k]} {said[3]}" for k in (1, 2)] if said else one
            try:
                a, b = (parse(x, "time") if said else float(x) for x in cast(Any, ends))
            except (FoucaultError, TypeError, ValueError):
                raise error("log.rests", given=one) from None
            if not (out[-1][1] if out else -math.inf) < a < b < math.inf:
                raise error("log.rests", given=one)
            out.append((a, b))
        if not out:
            raise error("log.rests", given=value)
        return tuple(out)

    @model_validator(mode="after")
    def _consistent(self) -> LogDescription:
        self.dated(self.time is not None)
        if self.gyro and self.accel and self.gyro.kind != self.accel.kind:
            raise error("log.kinds_differ", gyro=self.gyro.kind, accel=self.accel.kind)
        if self.file is None and not self.files():
            raise error("log.no_file")
        triads = [block for block in (self.gyro, self.accel) if block is not None]
        if self.join == "times" and (
            self.rate is not None or self.more or any(b.kind == "increment" for b in triads)
        ):
            raise error("log.join_rates")
        if self.more and (self.serial is not None or set(self._files()) != {self.file}):
            raise error("log.more_alone")
        return self

    @property
    def apart(self) -> float:
        """How many intervals the time of a row is after the instant of its table angles [1]."""
        if self.table is None or self.table.stamped is None:
            return 0.0
        at = {"start": 0.0, "middle": 0.5, "end": 1.0}
        return at[self.stamped] - at[self.table.stamped]

    def whole(self) -> LogDescription:
        """Return the description; refused where an axis of a triad has no column."""
        for block in (self.gyro, self.accel, self.mag):
            if block is not None and len(block.logged) < len(AXES):
                axes = " and ".join(AXES[i] for i in block.logged)
                raise error("log.one_axis", block=block.name, axes=axes)
        return self

    @property
    def shared_clock(self) -> bool:
        """Whether the angles of a table are another file, stamped by the same clock."""
        return self.table is not None and self.table.file not in (None, self.file)

    def files(self) -> dict[str, tuple[str, ...]]:
        """Return each file with the blocks that are read from it, in order."""
        found = self._files()
        return found | {name: next(iter(found.values())) for name in self.more}

    def each(self) -> list[LogDescription]:
        """Return a description of each file alone, where there are more."""
        alone = {"more": (), "rests": None}
        return [self.model_copy(update={"file": f, **alone}) for f in self.files()]

    def _files(self) -> dict[str, tuple[str, ...]]:
        found: dict[str, list[str]] = {} if self.file is None else {self.file: []}
        for name in ("gyro", "accel", "mag", "temperature", "table", "averaged"):
            block = getattr(self, name)
            if block is None:
                continue
            where = block.file or self.file
            if where is None:
                raise error("log.no_file")
            found.setdefault(where, []).append(name)
        if len(found) > 1 and self.file in found and not found[self.file]:
            del found[self.file]  # every block names its own file
        return {file: tuple(names) for file, names in found.items()}


_BRACKETS = re.compile(r"[^(\[]+[(\[]\s*([^)\]]+?)\s*[)\]]")
_ENDINGS = {
    "time": {"s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns"},
    "gyro": {"dps": "deg/s", "deg_s": "deg/s", "rad_s": "rad/s"},
    "accel": {"g": "g", "mg": "mg", "m_s2": "m/s^2", "ms2": "m/s^2", "mps2": "m/s^2"},
    "mag": {"ut": "uT", "nt": "nT", "mg": "mG", "mgauss": "mG", "gauss": "G", "t": "T"},
    "temperature": {"c": "degC", "degc": "degC", "k": "K"},
}
"""How names end that carry their unit without brackets: ``time_ms``, ``gyro_x_dps``."""

_RATES = {"gyro": "angular rate", "accel": "specific force"}
_INCREMENTS = {"gyro": "angle increment", "accel": "velocity increment"}
"""What triads measure, and those whose rows are integrals over the interval before."""


def description_of(path: Path) -> tuple[LogDescription, tuple[Finding, ...]]:
    """Describe a log by the titles of its columns, or not at all where it describes itself."""

    alone = LogDescription.model_validate({"file": path.name})
    raw = open_raw(path, alone)
    if raw.declared is not None:
        return alone, ()
    have = f"the columns {some(raw.names)}" if raw.named else f"{len(raw.names)} columns"
    words = {"file": path.name, "have": have}
    try:
        said = _blocks(raw, path)
        described = LogDescription.model_validate({"file": path.name, **said})
    except FoucaultError as problem:  # a unit that is not known, or counts without a scale
        raise error("log.bare", reason=problem.message.rstrip("."), **words) from None
    except ValueError as problem:
        raise error("log.bare", reason=problem, **words) from None
    units = ", ".join(
        f"{name} in {about['unit']}" + " (increments)" * ("kind" in about)
        for name, about in said.items()
    )
    return described, (finding("log.units_from_titles", file=path.name, units=units),)


def _blocks(raw: RawTable, path: Path) -> dict[str, dict[str, Any]]:
    if not raw.named:
        raise ValueError("the file has no titles")
    found: dict[str, dict[str, Any]] = {}
    for block, endings in _ENDINGS.items():
        bare = tuple(_without(name, endings) for name in raw.names)
        try:
            numbers = guess(RawTable(bare, True, raw.blocks), block, path)
        except FoucaultError:
            continue
        names = [raw.names[n] for n in numbers]
        if block == "time" and numbers[0] in raw.stamps:
            given: set[str | None] = {"iso"}
        else:
            given = {unit_in(name, endings) for name in names}
        if None in given or len(given) != 1:
            raise ValueError(f"the titles of {block} do not give one unit: {', '.join(names)}")
        key = {"column": numbers[0]} if len(numbers) == 1 else {"columns": numbers}
        found[block] = {**key, "unit": given.pop()}
    if not found.keys() & {"gyro", "accel"}:
        found |= _some_axes(raw)
    if "time" not in found:
        raise ValueError("no column has a usual name of time")
    if not found.keys() & {"gyro", "accel"}:
        raise ValueError(
            "no three columns have usual names of gyro or accelerometer, nor has one with a unit"
        )
    triads = {name: said for name, said in found.items() if name in _INCREMENTS}
    if all(_measures(said["unit"], _INCREMENTS[name]) for name, said in triads.items()):
        for said in triads.values():
            said["kind"] = "increment"
    return found


def _some_axes(raw: RawTable) -> dict[str, dict[str, Any]]:
    """Describe triads that lack columns, such as a single gyro, where the titles give the unit."""
    found: dict[str, dict[str, Any]] = {}
    for block, kind in _RATES.items():
        bare = tuple(_without(name, _ENDINGS[block]) for name in raw.names)
        numbers = guess_some(RawTable(bare, True, raw.blocks), block)
        units = {unit_in(raw.names[n], _ENDINGS[block]) for n in numbers if n is not None}
        unit = units.pop() if len(units) == 1 else None
        if unit is not None and (_measures(unit, kind) or _measures(unit, _INCREMENTS[block])):
            found[block] = {"columns": numbers, "unit": unit}
    return found


def _measures(unit: str, kind: str) -> bool:
    try:
        scaled_unit(unit, kind)
    except FoucaultError:
        return False
    return True


def unit_in(title: str, endings: dict[str, str]) -> str | None:
    """Return the unit in a column's `title`, None where it has none.

    `endings`: how names may end that carry their unit, and that unit.
    """
    inside = _BRACKETS.fullmatch(title.strip())
    if inside:
        return re.sub(r"(?<=s)2$", "^2", inside[1])
    low = title.strip().lower()
    return next((unit for end, unit in endings.items() if low.endswith(f"_{end}")), None)


def _without(title: str, endings: dict[str, str]) -> str:
    """Return a column's `title` without an ending that is its unit."""
    low = title.strip().lower()
    end = next((end for end in endings if low.endswith(f"_{end}")), None)
    return title.strip() if end is None else title.strip()[: -len(end) - 1]


def bare_title(title: str, endings: dict[str, str]) -> str:
    """Return a column's `title` in small letters and digits, without its unit."""
    bare = _without(re.sub(r"[(\[].*", "", title), endings).lower()
    return re.sub(r"[^a-z0-9]", "", bare)


def describes_itself(path: Path) -> bool:
    """Tell whether the file at `path` says itself what its columns are, and in which units."""

    plain = LogDescription.model_validate({"file": path.name})
    try:
        return open_raw(path, plain).described
    except FoucaultError:  # it needs a description even to be opened, or is not there
        return False


def complete(
    description: LogDescription, wanted: tuple[str, ...], raw: RawTable, path: Path
) -> tuple[LogDescription, tuple[str, ...]]:
    """Fill in what a file or its format says about itself; others must be described.

    `wanted`: blocks that the description takes from this file.
    """
    given = description.gyro is not None or description.accel is not None
    if given and (raw.declared is None or raw.marker):
        return description, wanted
    if raw.declared is None:
        have = ", ".join(raw.names) if raw.named else f"{len(raw.names)} unnamed columns"
        raise error("log.undescribed", file=path.name, have=have)
    if not raw.declared.keys() & {"gyro", "accel"}:
        raise error("log.cannot_guess", file=path.name, block="gyro", have=", ".join(raw.names),
                    example='columns = ["gyro_x", "gyro_y", "gyro_z"]')  # fmt: skip
    blocks = dict(raw.declared) if raw.marker else _over(raw.declared, description, path)
    said = description.model_dump(exclude={"time", "mag", "temperature", "table", "averaged"})
    if "time" in blocks:
        del said["rate"]
    filled = type(description).model_validate({**said, **blocks})
    return filled, tuple(name for name in blocks if name not in ("time", "clock"))


def _over(declared: Mapping[str, Any], description: LogDescription, path: Path) -> dict[str, Any]:
    """Let what a description gives take the place of what a format declares, key by key."""
    out: dict[str, Any] = {
        name: dict(block) if isinstance(block, Mapping) else block
        for name, block in declared.items()
    }
    if description.rate is not None:
        out.pop("time", None)
        out.pop("clock", None)
    if description.clock is not None:
        out["clock"] = description.clock
    for name in ("time", "gyro", "accel", "mag", "temperature", "table", "averaged"):
        block = getattr(description, name)
        if block is not None:
            given = block.model_dump(mode="json", exclude_unset=True)
            out[name] = out.get(name, {}) | given
    for name in ("gyro", "accel"):
        if "unit" not in out.get(name, {"unit": ""}):
            raise error("log.open_unit", file=path.name, block=name,
                        kind=out[name].get("kind", "rate"))  # fmt: skip
    return out
