"""The ``[log]`` block of a north seeker: one gyro on an indexing base, and its accelerometers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.logs.layout import (
    Block,
    ColumnName,
    FileLayout,
    Length,
    Temperature,
    TimeColumn,
    conversion,
    limits,
    scaled_unit,
)
from foucault.units import Quantity


class _Column(Block):
    column: ColumnName = Field(
        description='name, or number from 0; a leading "-" flips the sign ("-rate")'
    )


class Angle(_Column):
    """A column of angles."""

    unit: str = Field(description='unit of one, such as "deg", "rad" or "0.001 deg"')

    @model_validator(mode="after")
    def _unit(self) -> Angle:
        self.one()
        return self

    def one(self) -> float:
        """Return the value of one `unit` [rad]."""
        return scaled_unit(self.unit, "angle")


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
