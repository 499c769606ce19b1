"""The ``[log]`` block of a campaign: which column of a file is which axis, in which unit.

Everything a file cannot say about itself is declared, never guessed: units above all. Only
files written by this package need no description, because they say it themselves.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error
from foucault.logs.columns import titled_axis
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
from foucault.tables import AXES

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


class LogDescription(FileLayout):
    """Where a log is and what its columns mean."""

    more: tuple[str, ...] = Field(
        (),
        examples=[["spins.csv"]],
        description="further files with the same columns, recorded one by one, such as the rests "
        "in one and the spins in another; what is between them was not logged",
    )
    time: TimeColumn | None = None
    gyro: GyroColumns | None = None
    accel: AccelColumns | None = None
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
    serial: ColumnName | None = Field(
        None, description="column of the serial number, where rows of several instruments are mixed"
    )

    @model_validator(mode="after")
    def _consistent(self) -> LogDescription:
        self.dated(self.time is not None)
        if self.gyro and self.accel and self.gyro.kind != self.accel.kind:
            raise error("log.kinds_differ", gyro=self.gyro.kind, accel=self.accel.kind)
        if self.file is None and not self.files():
            raise error("log.no_file")
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
        for block in (self.gyro, self.accel):
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
        return [self.model_copy(update={"file": f, "more": ()}) for f in self.files()]

    def _files(self) -> dict[str, tuple[str, ...]]:
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
