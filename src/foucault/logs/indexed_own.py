"""Readings of a north seeker whose titles say what the columns are, and how we write them.

``setup, time (s), index (deg), gyro (deg/h), specific force (g), dwell (s), heading (deg)``.

The ``[log]`` block of a north seeker: one gyro on an indexing base, and its accelerometers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.files import atomic
from foucault.logs.description import bare_title, unit_in
from foucault.logs.layout import (
    Block,
    ColumnName,
    FileLayout,
    Length,
    Measured,
    Temperature,
    TimeColumn,
    conversion,
    limits,
)
from foucault.logs.raw import open_raw
from foucault.tables import IndexedLog, declared
from foucault.units import Quantity

_SINGLE = {
    "setup": ("setup", "station", "mark", "point"),
    "time": ("time", "t", "start"),
    "index": ("index", "indexangle", "angle"),
    "gyro": ("gyro", "rate", "gyrorate"),
    "heading": ("heading", "reference", "referenceheading"),
    "latitude": ("latitude", "lat"),
    "latitude_sd": ("latitudesd", "latsd"),
    "averaged": ("dwell", "averaged", "dwelltime"),
    "temperature": ("temperature", "temp"),
}
"""Block of the description -> how its column may be titled, spaces and signs left out."""

_FORCES = {
    "accel": None, "accelerometer": None, "acc": None,
    "specificforce": "specific force", "gravity": "gravity",
}  # fmt: skip
"""How the column of an accelerometer may be titled -> which sign that states."""

_ENDINGS = {
    "time": {"s": "s", "ms": "ms"},
    "index": {"deg": "deg", "rad": "rad"},
    "gyro": {"dph": "deg/h", "deg_h": "deg/h", "dps": "deg/s", "rad_s": "rad/s"},
    "heading": {"deg": "deg", "rad": "rad"},
    "latitude": {"deg": "deg", "rad": "rad"},
    "latitude_sd": {"deg": "deg", "rad": "rad"},
    "averaged": {"s": "s", "min": "min"},
    "temperature": {"c": "degC", "degc": "degC", "k": "K"},
    "accel": {"g": "g", "mg": "mg", "m_s2": "m/s^2"},
}
"""How titles end that carry their unit without brackets: ``index_deg``, ``gyro_dph``."""

SIGNS = ("specific force", "gravity")
"""What an accelerometer may read."""


def description_of(
    path: Path, reads: str | None = None
) -> tuple[IndexedDescription, tuple[Finding, ...]]:
    """Describe the readings of a north seeker by the titles of the columns.

    `reads` or None: what the accelerometers read, where no title says it.
    """

    raw = open_raw(path, FileLayout.model_validate({"file": path.name}))
    have = "the columns " + ", ".join(raw.names) if raw.named else f"{len(raw.names)} columns"
    words = {"file": path.name, "have": have}
    if not raw.named:
        raise error("north.bare", reason="the file has no titles", **words)
    try:
        said = _blocks(raw.names, raw.stamps)
    except ValueError as problem:
        raise error("north.bare", reason=problem, **words) from None
    if "accel" in said:
        said["accel"]["reads"] = _sign(said["accel"], raw.names, reads, path)
    try:
        described = IndexedDescription.model_validate({"file": path.name, **said})
    except FoucaultError as problem:  # a unit that is not known, or counts without a scale
        reason = f"{problem.message.rstrip('.')}"
        raise error("north.bare", reason=reason, **words) from None
    units = [f"{k} in {b['unit']}" for k, b in said.items() if isinstance(b, dict)]
    if "accel" in said:
        units.append(f"accel reads {said['accel']['reads']}")
    return described, (finding("north.titles", file=path.name, units=", ".join(units)),)


def _blocks(names: tuple[str, ...], stamps: tuple[int, ...]) -> dict[str, Any]:
    plain = {block: [bare_title(name, ends) for name in names] for block, ends in _ENDINGS.items()}
    plain["setup"] = [bare_title(name, {}) for name in names]
    said: dict[str, Any] = {}
    for block, titles in _SINGLE.items():
        number = next((plain[block].index(t) for t in titles if t in plain[block]), None)
        if number is None:
            continue
        if block == "setup":
            said[block] = number
            continue
        unit = "iso" if number in stamps else unit_in(names[number], _ENDINGS[block])
        said[block] = {"column": number, "unit": _unit(unit, names[number])}
    for block in ("index", "gyro"):
        if block not in said:
            raise ValueError(f"no column has a usual title of {block}")
    if not said.keys() & {"time", "averaged"}:
        raise ValueError("no column has a usual title of time or dwell")
    forces = [i for i, name in enumerate(plain["accel"]) if name in _FORCES]
    pairs = [[i for i, name in enumerate(plain["accel"]) if name in {f + axis for f in _FORCES}]
             for axis in "xy"]  # fmt: skip
    if len(forces) > 1 or any(len(pair) > 1 for pair in pairs) or (forces and any(pairs)):
        raise ValueError("more than one column is titled as accelerometer or its component")
    if all(pairs):
        numbers = [pair[0] for pair in pairs]
        units = {_unit(unit_in(names[i], _ENDINGS["accel"]), names[i]) for i in numbers}
        if len(units) > 1:
            raise ValueError("the two accelerometers have different units")
        said["accel"] = {"columns": numbers, "unit": units.pop()}
    elif any(pairs):
        raise ValueError("of two accelerometers only one has a usual title")
    elif forces:
        unit = unit_in(names[forces[0]], _ENDINGS["accel"])
        said["accel"] = {"column": forces[0], "unit": _unit(unit, names[forces[0]])}
    return said


def _unit(unit: str | None, title: str) -> str:
    if unit is None:
        raise ValueError(f"the title {title} gives no unit")
    return unit


def _sign(block: dict[str, Any], names: tuple[str, ...], reads: str | None, path: Path) -> str:
    """Return what the accelerometers read by their titles or by `reads`."""
    numbers = block["columns"] if "columns" in block else [block["column"]]
    titles = [bare_title(names[i], _ENDINGS["accel"]) for i in numbers]
    stated = {_FORCES[t if t in _FORCES else t[:-1]] for t in titles} | {reads}
    stated.discard(None)
    shown = ", ".join(names[i] for i in numbers)
    if not stated:
        given = f"the title {shown} does not say it"
    elif len(stated) > 1:
        given = f"the title {shown} and --accel-reads {reads} contradict one another"
    elif not stated <= set(SIGNS):
        given = f"--accel-reads {reads} is neither specific force nor gravity"
    else:
        return str(stated.pop())
    raise error("north.accel_sign", where=f"'{path.name}'", given=given)


# -- writing -------------------------------------------------------------------------------


def _columns(log: IndexedLog) -> dict[str, Any]:
    accel = [] if log.accel is None else list(log.accel.T)
    values = {
        "setup": [log.names[i] for i in log.setup],
        "time": log.time,
        "index": log.index,
        "gyro": log.gyro,
        "specific force": accel[0] if len(accel) == 1 else None,
        "specific force x": accel[0] if len(accel) == 2 else None,
        "specific force y": accel[1] if len(accel) == 2 else None,
        "heading": log.heading,
        "latitude": log.latitude,
        "latitude sd": log.latitude_sd,
        "dwell": log.averaged,
        "temperature": log.temperature,
    }
    units = {c.name: f" ({c.unit})" * bool(c.unit) for c in declared("indexed_log")}
    return {f"{k}{units[k]}": v for k, v in values.items() if v is not None}


def write(log: IndexedLog, path: str | Path) -> None:
    """Write the log of a north seeker as CSV or Parquet, with titles that describe it.

    `log`: the log [SI].
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise error("log.cannot_write", path=path, allowed=".csv, .parquet")
    wrong = [name for name in log.names if re.search(r'[,;\t|"#%\n]|^\s*$', name)]
    if wrong and suffix == ".csv":
        raise error("north.setup_name", name=wrong[0])
    columns = {k: v if isinstance(v, list) else np.ascontiguousarray(v)
               for k, v in _columns(log).items()}  # fmt: skip
    table = pa.table(columns)
    with atomic(path) as temporary:
        if suffix == ".parquet":
            parquet.write_table(table, temporary, write_page_checksum=True)
            return
        with temporary.open("wb") as stream:
            stream.write((",".join(columns) + "\n").encode())
            options = csv.WriteOptions(include_header=False, quoting_style="none")
            csv.write_csv(table, stream, options)


def log_table(log: IndexedLog | None = None) -> str:
    """Write the table [log] of a campaign for a file that `write` makes.

    `log`: the log in that file, None for the template, which loads and explains [SI].
    """
    pair = log is not None and log.accel is not None and log.accel.shape[1] == 2
    which = 'columns = ["specific force x", "specific force y"]'
    lines = [
        "[log]",
        'file = "log.csv"                        # relative to this file',
        "# CSV or spaced text (.gz too), Parquet, .npy, .npz, .mat and binary records can be read.",
        'setup = "setup"                         # a new value: a new placement of the instrument',
        'time = { column = "time", unit = "s" }',
        "# The index angle counts clockwise seen from above, 0 where the gyro points forward; else",
        '# add zero = "30 deg" (what the file says there) and sense = "counter-clockwise".',
        'index = { column = "index", unit = "rad" }',
        'gyro = { column = "gyro", unit = "rad/s" }',
        '# Raw counts:  gyro = { column = "u", unit = "count", scale = "1e6 count/(deg/s)" }',
        "# One accelerometer turns with the gyro; of two that stay with the case give right and",
        '# forward, columns = ["ax", "ay"]. reads: "gravity" where it says -1 g along up at rest.',
    ]
    if log is None or log.accel is not None:
        some = which if pair else 'column = "specific force"'
        lines.append(f'accel = {{ {some}, unit = "m/s^2", reads = "specific force" }}')
    lines.append("# Of y_b by another reference, as a calibration needs it:")
    off = "# " * (log is not None and log.heading is None)
    lines.append(off + 'heading = { column = "heading", unit = "rad" }')
    lines.append("# Where every row is the mean of one dwell: over how long. Left out: samples.")
    off = "# " * (log is not None and log.averaged is None)
    lines.append(off + 'averaged = { column = "dwell", unit = "s" }')
    return "\n".join(lines) + "\n"


class _Column(Block):
    column: ColumnName = Field(
        description='name, or number from 0; a leading "-" flips the sign ("-rate")'
    )


class Angle(Measured, _Column):
    """A column of angles."""

    of: ClassVar[dict[str, str]] = {"unit": "angle"}

    unit: str = Field(description='unit of one, such as "deg", "rad" or "0.001 deg"')


class IndexColumn(Angle):
    """The index angle of the base."""

    zero: Annotated[float, Quantity("angle")] = Field(
        0.0, description="what the file says where the sensing axis points forward, along y_b"
    )
    sense: Literal["clockwise", "counter-clockwise"] = Field(
        "clockwise", description="how it counts, seen from above"
    )

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (1,): angle = (raw - zero) * factor."""
        sign = 1.0 if self.sense == "clockwise" else -1.0
        return np.array([self.zero / self.one()]), np.array([sign * self.one()])


class GyroColumn(_Column):
    """The gyro: angular rate along its sensing axis."""

    unit: str = Field(description='unit of one, such as "deg/h", or "count"')
    scale: str | None = Field(
        None, description="count scale, such as 1e6 count/(deg/s); only with unit = 'count'"
    )
    zero: float = Field(0.0, description="count that means zero; only with unit = 'count'")
    saturation: float | tuple[float, float] | None = Field(
        None, description="largest value the gyro can say, or [lowest, highest], in `unit`"
    )

    @model_validator(mode="after")
    def _convertible(self) -> GyroColumn:
        self.conversion()
        return self

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (1,): SI value = (raw - zero) * factor."""
        return conversion("gyro", self.unit, "angular rate", self.scale, self.zero, 1)

    def limits(self) -> FloatArray | None:
        """Return the range as declared, lowest and highest, shape (2,) [`unit`]."""
        return limits(self.saturation)


class ForceColumns(Block):
    """The accelerometers: one that turns with the gyro, or two that stay with the case."""

    column: ColumnName | None = Field(
        None, description="one along the gyro's sensing axis: name, or number from 0"
    )
    columns: tuple[ColumnName, ColumnName] | None = Field(
        None, description="two that stay with the case: right, forward"
    )
    unit: str = Field(description='unit of one, such as "g", "m/s^2", or "count"')
    reads: Literal["specific force", "gravity"] = Field(
        description='"specific force" where it reads +1 g up at rest, "gravity" where -1 g'
    )
    scale: str | tuple[str, str] | None = Field(
        None, description="count scale, one or two; only with unit = 'count'"
    )
    zero: float | tuple[float, float] = Field(
        0.0, description="count that means zero, one or two; only with unit = 'count'"
    )
    saturation: float | tuple[float, float] | None = Field(
        None, description="largest value it can say, or [lowest, highest], in `unit`"
    )

    @model_validator(mode="before")
    @classmethod
    def _signed(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and raw.get("reads") is None:
            raise error("north.accel_sign", where="[log.accel]", given="`reads` is missing")
        return raw

    @model_validator(mode="after")
    def _convertible(self) -> ForceColumns:
        if (self.column is None) == (self.columns is None):
            both = self.column is not None
            raise error("north.accel_columns", given="column and columns" if both else "no column")
        one = isinstance(self.scale, tuple) or isinstance(self.zero, tuple)
        if one and self.columns is None:
            raise error("north.accel_columns", given="one column, but two scales or zeros")
        self.conversion()
        return self

    @property
    def wanted(self) -> tuple[ColumnName, ...]:
        """The columns, one or two."""
        return (self.column,) if self.column is not None else (self.columns or ())

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (k,); the sign turns gravity into specific force."""
        n = len(self.wanted)
        zero, one = conversion("accel", self.unit, "specific force", self.scale, self.zero, n)
        return zero, -one if self.reads == "gravity" else one

    def limits(self) -> FloatArray | None:
        """Return the range as declared, lowest and highest, shape (2,) [`unit`]."""
        return limits(self.saturation)


class IndexedDescription(FileLayout):
    """Where the log of a north seeker is and what its columns mean."""

    time: TimeColumn | None = None
    index: IndexColumn
    gyro: GyroColumn
    accel: ForceColumns | None = Field(
        None, description="left out where the case was levelled: the tilt is then not measured"
    )
    heading: Angle | None = Field(
        None, description="heading of y_b by another reference, clockwise from north; may be empty"
    )
    latitude: Angle | None = Field(
        None,
        description="latitude of each set-up, positive north, where a file has several places; "
        "where it is empty that of [site] counts",
    )
    latitude_sd: Angle | None = Field(
        None, description="sd of it; where it is empty that of [procedure] counts"
    )
    setup: ColumnName | None = Field(
        None,
        description="column of the set-up: a new value is a new placement of the instrument, rows "
        "where it is empty are left out. Left out: every new reference heading or latitude, else "
        "all one",
    )
    averaged: Length | None = Field(
        None,
        description="only where every row is already the mean of one dwell: over how long; a time "
        "column is then the beginning of each mean, and may be left out",
    )

    temperature: Temperature | None = None

    @model_validator(mode="after")
    def _consistent(self) -> IndexedDescription:
        self.dated(self.time is not None)
        if self.file is None:
            raise error("log.no_file")
        if self.time is None and self.rate is None and self.averaged is None:
            raise error("log.no_time", file=self.file)
        return self
