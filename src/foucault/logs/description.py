"""The ``[log]`` block of a campaign: which column of a file is which axis, in which unit.

Everything a file cannot say about itself is declared, never guessed: units above all. Only
files written by this package need no description, because they say it themselves.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from foucault.errors import FoucaultError, error
from foucault.tables import FloatArray
from foucault.units import Quantity, factor, parse

ColumnName = int | str
"""A column by name, or by number from 0; text may start with "-" to flip the sign."""

Direction = Literal["x up", "x down", "y up", "y down", "z up", "z down"]

ABSOLUTE_ZERO = 273.15
"""Kelvin at 0 degC [K]."""


def scaled_unit(text: str, kind: str) -> float:
    """Give the SI value of a unit that may carry a number, such as ``"0.1 arcsec"``.

    Parameters
    ----------
    text : str
        Unit, or number and unit.
    kind : str
        What it must measure, a key of `foucault.units.KINDS`.

    Returns
    -------
    float
        SI value of one [SI unit of the kind].
    """
    return parse(text, kind, "unit") if re.match(r"\s*[-+.\d]", text) else factor(text, kind)


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class TimeColumn(_Block):
    """The time column."""

    column: ColumnName | None = Field(
        None, description="name, or number from 0; guessed from the header if left out"
    )
    unit: str = Field(
        description='"s", "ms", "us", a tick such as "15.625 us", or "iso" for 2026-05-04T10:00:00Z'
    )

    @model_validator(mode="after")
    def _unit(self) -> TimeColumn:
        self.one()
        return self

    @property
    def iso(self) -> bool:
        """Whether the column holds dates and times of day."""
        return self.unit.lower() == "iso"

    def one(self) -> float:
        """Return the value of one `unit` [s]."""
        return 1.0 if self.iso else scaled_unit(self.unit, "time")


class TemperatureColumn(_Block):
    """The temperature column."""

    file: str | None = Field(None, description="file of this column, if not the log's")
    column: ColumnName | None = Field(None, description="name, or number from 0")
    unit: str = Field(description='"degC" or "K"')

    @model_validator(mode="after")
    def _unit(self) -> TemperatureColumn:
        self.conversion()
        return self

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (1,): kelvin = (raw - zero) * factor."""
        if self.unit in ("degC", "°C", "C", "celsius"):  # an offset is no factor: done by hand
            return np.array([-ABSOLUTE_ZERO]), np.ones(1)
        return np.zeros(1), np.array([factor(self.unit, "temperature")])


class Triad(_Block):
    """Three columns of one instrument, x y z in right-forward-up body axes."""

    name: ClassVar[str]
    kinds: ClassVar[dict[str, str]]

    file: str | None = Field(None, description="file of these columns, if not the log's")
    columns: tuple[ColumnName, ColumnName, ColumnName] | None = Field(
        None,
        description='names or numbers from 0 for x, y, z; a leading "-" flips the sign ("-gy"); '
        "guessed from the header if left out",
    )
    unit: str = Field(description='unit of one, such as "deg/s", "0.1 arcsec", or "count"')
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
        if value is not None and (not isinstance(value, list | tuple) or len(value) != 3):
            raise error("log.three_columns", block=cls.name, given=value)
        return value

    @model_validator(mode="after")
    def _convertible(self) -> Triad:
        self.conversion()
        return self

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (3,): SI value = (raw - zero) * factor."""
        if self.unit in ("count", "counts", "LSB"):
            return np.broadcast_to(self.zero, 3).astype(float), 1.0 / self._count_scale()
        if self.scale is not None or np.any(self.zero):
            raise error("log.scale_without_count", block=self.name, unit=self.unit)
        return np.zeros(3), np.full(3, self._unit())

    def limits(self) -> FloatArray | None:
        """Return the range as declared, lowest and highest, shape (2,) [`unit`]."""
        if self.saturation is None:
            return None
        if isinstance(self.saturation, tuple):
            return np.sort(np.array(self.saturation, float))
        return np.array([-abs(self.saturation), abs(self.saturation)])

    def _count_scale(self) -> FloatArray:
        if self.scale is None or self.kind == "increment":
            example = {"gyro": "4778 count/(rad/s)", "accel": "415 count/(m/s^2)"}[self.name]
            tick = {"gyro": "0.1 arcsec", "accel": "0.0001 m/s"}[self.name]
            raise error("log.count_scale", block=self.name, example=example, tick=tick)
        texts = (self.scale,) * 3 if isinstance(self.scale, str) else self.scale
        kind = {"gyro": "gyro count scale", "accel": "accelerometer count scale"}[self.name]
        scale = np.array([parse(t, kind, f"[log.{self.name}] scale") for t in texts])
        if np.any(scale == 0):
            raise error("log.scale_zero", block=self.name)
        return scale

    def _unit(self) -> float:
        try:
            return scaled_unit(self.unit, self.kinds[self.kind])
        except FoucaultError as problem:
            other = "increment" if self.kind == "rate" else "rate"
            try:
                scaled_unit(self.unit, self.kinds[other])
            except FoucaultError:
                raise problem from None
            raise error(
                "log.kind", block=self.name, unit=self.unit, kind=self.kind, other=other
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


class TableBlock(_Block):
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


class Averaged(_Block):
    """The column that says over how long each row is already a mean."""

    file: str | None = Field(None, description="file of this column, if not the log's")
    column: ColumnName = Field(description="name, or number from 0")
    unit: str = Field(description='"s", "min" or another unit of time')

    @model_validator(mode="after")
    def _unit(self) -> Averaged:
        self.one()
        return self

    def one(self) -> float:
        """Return the value of one `unit` [s]."""
        return scaled_unit(self.unit, "time")


NumberType = Literal[
    "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"
]


class Record(_Block):
    """A plain binary file: records of numbers, one record per sample."""

    type: NumberType | tuple[NumberType, ...] = Field(
        description="type of every number, or a list with one type per column"
    )
    columns: int | None = Field(None, ge=1, description="numbers per record, for a single type")
    byte_order: Literal["little", "big"] = Field("little", description="byte order")
    skip: int = Field(0, ge=0, description="bytes before the first record")

    @model_validator(mode="after")
    def _complete(self) -> Record:
        self.types()
        return self

    def types(self) -> tuple[str, ...]:
        """Return the type of each column."""
        if isinstance(self.type, tuple):
            if self.columns not in (None, len(self.type)) or not self.type:
                raise error("log.record_columns")
            return self.type
        if self.columns is None:
            raise error("log.record_columns")
        return (self.type,) * self.columns


class LogDescription(_Block):
    """Where a log is and what its columns mean."""

    file: str | None = Field(None, description="path, relative to the campaign file")
    format: Literal["auto", "csv", "text", "parquet", "npy", "npz", "mat", "binary"] = Field(
        "auto", description="by suffix and content if left out"
    )
    delimiter: str = Field("auto", min_length=1, description='"auto", "space", ",", ";", "\\t"')
    decimal: Literal[".", ","] = Field(".", description="decimal sign of a text file")
    header: Literal["auto", "none"] | Annotated[int, Field(ge=0)] = Field(
        "auto", description='lines before the data, counted as an editor does, or "none"'
    )
    comment: tuple[str, ...] = Field(("#", "%"), description="what starts a comment")
    variable: str | None = Field(None, description="array inside a .mat or .npz file")
    record: Record | None = Field(None, description="layout of a binary file")
    rate: Annotated[float, Quantity("frequency")] | None = Field(
        None, description="sample rate, only where there is no time column"
    )
    missing: Literal["error", "drop"] = Field(
        "error", description='"drop" leaves out rows with missing or infinite values'
    )
    time: TimeColumn | None = None
    gyro: GyroColumns | None = None
    accel: AccelColumns | None = None
    temperature: TemperatureColumn | None = None
    table: TableBlock | None = Field(
        None, description="angles and rate of the table that the instrument stands on"
    )
    averaged: Averaged | None = Field(
        None,
        description="only where every row is already the mean over one position: over how long; "
        "a time column is then the beginning of each mean, and may be left out",
    )
    serial: ColumnName | None = Field(
        None, description="column of the serial number, where rows of several instruments are mixed"
    )

    @model_validator(mode="after")
    def _consistent(self) -> LogDescription:
        if self.rate is not None and self.time is not None:
            raise error("log.time_and_rate")
        if self.rate is not None and not self.rate > 0:
            raise error("log.rate", rate=f"{self.rate:g}")
        if self.gyro and self.accel and self.gyro.kind != self.accel.kind:
            raise error("log.kinds_differ", gyro=self.gyro.kind, accel=self.accel.kind)
        if self.file is None and not self.files():
            raise error("log.no_file")
        return self

    def files(self) -> dict[str, tuple[str, ...]]:
        """Return each file with the blocks that are read from it, in order."""
        found: dict[str, list[str]] = {} if self.file is None else {self.file: []}
        for name in ("gyro", "accel", "temperature", "table", "averaged"):
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
