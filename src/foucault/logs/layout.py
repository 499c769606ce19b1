"""How a file is laid out, and the single columns that every description of a log may name."""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error
from foucault.tables import Clock
from foucault.units import CELSIUS, KINDS, ZERO_CELSIUS, Quantity, Ratio, factor, parse

ColumnName = int | str
"""A column by name, or by number from 0; text may start with "-" to flip the sign."""


def scaled_unit(text: str, kind: str) -> float:
    """Give the SI value of a unit that may carry a number, such as ``"0.1 arcsec"``.

    `kind`: what it must measure, a key of `foucault.units.KINDS`. Returns SI value of one [SI
    unit of the kind].
    """
    one = parse(text, kind, "unit") if re.match(r"\s*[-+.\d]", text) else factor(text, kind)
    if not 1 / MOST < abs(one) < MOST:
        reading = "zero" if abs(one) < 1 else "too large"
        raise error("unit.size", unit=text, kind=kind, reading=reading, example=KINDS[kind].example)
    return one


MOST = 1e30
"""No unit is as large in SI, and none as small as its inverse [SI]."""

RATES = (1e-4, 1e8)
"""From a mean every few hours to the fastest converter [Hz]."""


SPACES = ("space", "spaces", "whitespace")
"""Words for any number of spaces and tabs between two cells."""

COUNTS = ("count", "counts", "LSB")
"""Units of readings that a count scale turns into SI."""

_COUNT_EXAMPLES = {
    "gyro": ("4778 count/(rad/s)", "0.1 arcsec", "gyro count scale"),
    "accel": ("415 count/(m/s^2)", "0.0001 m/s", "accelerometer count scale"),
    "mag": ("6.7 count/uT", "0.15 uT", "magnetometer count scale"),
}


def no_count_scale(block: str) -> FoucaultError:
    """Build the error for counts of a `block` without a scale."""
    example, tick, _ = _COUNT_EXAMPLES[block]
    return error("log.count_scale", block=block, example=example, tick=tick)


def conversion(
    block: str,
    unit: str,
    kind: str,
    scale: str | tuple[str, ...] | None,
    zero: float | tuple[float, ...],
    axes: int,
) -> tuple[FloatArray, FloatArray]:
    """Return zero and factor of readings, shape (axes,) each: SI value = (raw - zero) * factor.

    `kind`: what it must measure, a key of `foucault.units.KINDS`; `scale` or None: count scale,
    only with counts; `zero`: count that means zero, only with counts [count]; `axes`: number of
    columns [1].
    """
    if unit not in COUNTS:
        if scale is not None or np.any(zero):
            raise error("log.scale_without_count", block=block, unit=unit)
        return np.zeros(axes), np.full(axes, scaled_unit(unit, kind))
    if scale is None:
        raise no_count_scale(block)
    texts = (scale,) * axes if isinstance(scale, str) else scale
    of = _COUNT_EXAMPLES[block][2]
    scales = np.array([parse(text, of, f"[log.{block}] scale") for text in texts])
    if not np.all((np.abs(scales) > 1 / MOST) & (np.abs(scales) < MOST)):
        raise error("log.scale_zero", block=block)
    return np.broadcast_to(zero, axes).astype(float), 1.0 / scales


def limits(saturation: float | tuple[float, float] | None) -> FloatArray | None:
    """Return a range as declared, lowest and highest, shape (2,) [as declared].

    `saturation` or None: largest value, or both ends [as declared].
    """
    if saturation is None:
        return None
    if isinstance(saturation, tuple):
        return np.sort(np.array(saturation, float))
    return np.array([-abs(saturation), abs(saturation)])


class Block(BaseModel):
    """A table inside [log]."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Measured(Block):
    """A table inside [log] whose units are checked when it is read."""

    of: ClassVar[dict[str, str]]
    """Name of a unit -> what it must measure, a key of `foucault.units.KINDS`."""

    @model_validator(mode="after")
    def _units(self) -> Self:
        for name in self.of:
            self.one(name)
        return self

    def one(self, name: str = "unit") -> float:
        """Return the value of one of unit `name` [SI]."""
        return scaled_unit(getattr(self, name), self.of[name])


class TimeColumn(Measured):
    """The time column."""

    of: ClassVar[dict[str, str]] = {"unit": "time"}

    column: ColumnName | None = Field(
        None, description="name, or number from 0; guessed from the header if left out"
    )
    unit: str = Field(
        description='"s", "ms", "us", a tick such as "15.625 us", or "iso" for 2026-05-04T10:00:00Z'
    )

    @property
    def iso(self) -> bool:
        """Whether the column holds dates and times of day."""
        return self.unit.lower() == "iso"

    def one(self, name: str = "unit") -> float:
        """Return the value of one of unit `name` [s]."""
        return 1.0 if self.iso else super().one(name)


class Temperature(Block):
    """The temperature column."""

    column: ColumnName | None = Field(None, description="name, or number from 0")
    unit: str = Field(description='"degC", "K" or "degF"')

    @model_validator(mode="after")
    def _unit(self) -> Temperature:
        self.conversion()
        return self

    def conversion(self) -> tuple[FloatArray, FloatArray]:
        """Return zero and factor, each shape (1,): kelvin = (raw - zero) * factor."""
        if self.unit in CELSIUS:  # an offset is no factor
            return np.array([-ZERO_CELSIUS]), np.ones(1)
        if self.unit == "degF":
            return np.array([32.0 - 1.8 * ZERO_CELSIUS]), np.array([1 / 1.8])
        return np.zeros(1), np.array([factor(self.unit, "temperature")])


class TemperatureColumn(Temperature):
    """The temperature column, of this file or another."""

    file: str | None = Field(None, description="file of this column, if not the log's")


class Length(Measured):
    """The column that says over how long each row is already a mean."""

    of: ClassVar[dict[str, str]] = {"unit": "time"}

    column: ColumnName = Field(description="name, or number from 0")
    unit: str = Field(description='"s", "min" or another unit of time')


class Averaged(Length):
    """The column that says over how long each row is already a mean, of this file or another."""

    file: str | None = Field(None, description="file of this column, if not the log's")


NumberType = Literal[
    "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"
]


class Record(Block):
    """A plain binary file: records of numbers, one record per sample."""

    type: NumberType | tuple[NumberType, ...] = Field(
        description="type of every number, or a list with one type per column"
    )
    columns: int | None = Field(
        None, ge=1, le=10_000, description="numbers per record, for a single type"
    )
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


class Kind(NamedTuple):
    """What is done with files of a format: modules of `logs` and their functions."""

    opens: str
    suffixes: str = ""  # how their names end, between blanks
    names: str = ""  # of a whole vehicle: what names its instruments


Format = Literal["auto", "csv", "text", "parquet", "npy", "npz", "mat", "binary", "ros", "ulog",
                 "dataflash", "mavlink", "novatel", "vectornav"]  # fmt: skip
"""What [log] may say; "auto" goes by suffix and content."""

FORMATS = {
    "csv": Kind("text.open_delimited", ".csv .tsv"),
    "text": Kind("text.open_delimited", ".txt .log .dat .asc .imu"),
    "parquet": Kind("formats.open_parquet", ".parquet .pq"),
    "npy": Kind("formats.open_numpy", ".npy"),
    "npz": Kind("formats.open_numpy", ".npz"),
    "mat": Kind("formats.open_matlab", ".mat"),
    "binary": Kind("formats.open_binary", ".bin"),
    "ros": Kind("formats.open_ros", ".bag .mcap .db3", "formats.instruments_of_bag"),
    "ulog": Kind("formats.open_ulog", ".ulg", "formats.instruments_of_ulog"),
    "dataflash": Kind("dataflash.open_dataflash", "", "dataflash.instruments"),
    "mavlink": Kind("mavlink.open_mavlink", ".tlog", "mavlink.instruments"),
    "novatel": Kind("text.open_sentences"),
    "vectornav": Kind("text.open_sentences"),
}


class FileLayout(Block):
    """Where a log is and how its file is written."""

    file: str | None = Field(None, description="path, relative to the campaign file")
    format: Format = Field("auto", description="by suffix and content if left out")
    topic: str | None = Field(
        None,
        description='topic of a ROS bag, or message of a PX4 log such as "vehicle_imu/1", of one '
        'of ArduPilot such as "IMU/1", of MAVLink such as "HIGHRES_IMU/0"; may be left out where '
        "there is only one",
    )
    own_calibration: Literal["undo", "keep"] = Field(
        "undo", description="that of ArduPilot itself, where its parameters in the log say it"
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
    clock: Literal["sensor", "host", "disciplined"] | None = Field(
        None,
        description='what counts its time: "sensor", the instrument\'s own oscillator; "host", the '
        'crystal of the logger or computer; "disciplined", a clock steered by GNSS or PTP. Left '
        "out: sensor where only `rate` is given, host where there is a time column",
    )
    clock_sd: Annotated[Ratio, Field(ge=0, le=0.1)] | None = Field(
        None,
        examples=["100 ppm"],
        description="standard deviation of the rate of that clock. Left out: 1 % for sensor, "
        "100 ppm for host, 1 ppm for disciplined",
    )
    missing: Literal["error", "drop"] = Field(
        "error", description='"drop" leaves out rows with missing or infinite values'
    )

    @property
    def time_base(self) -> Clock:
        """How far the time of the log can be trusted."""
        # A rate alone is a data sheet's number for the instrument's own oscillator.
        source = self.clock or ("sensor" if self.rate is not None else "host")
        return Clock.of(source, self.clock_sd)

    @field_validator("delimiter")
    @classmethod
    def _delimiter(cls, given: str) -> str:
        mark = (
            len(given) == 1 and given.isascii() and not given.isalnum() and given not in '"\r\n+-.'
        )
        if mark or given in ("auto", *SPACES):
            return given
        raise ValueError('it should be "auto", "space" or one character, such as \';\'')

    def dated(self, timed: bool) -> None:
        """Refuse a sample rate beside a time column (`timed`), or one that is not positive."""
        if self.rate is not None and timed:
            raise error("log.time_and_rate")
        if self.rate is not None and not RATES[0] <= self.rate <= RATES[1]:
            raise error("log.rate", rate=f"{self.rate:g}")
