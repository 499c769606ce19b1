"""The tables that stages hand to one another: columns, SI units and meaning, in `tables.toml`.

Every table is saved as Parquet with these column names; the unit of a column is its SI unit
and is written into the file's column metadata.
"""

from __future__ import annotations

import tomllib
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.display import Shown
from foucault.errors import FoucaultError, error, require_word

if TYPE_CHECKING:
    from foucault.errors import Finding

AXES = ("x", "y", "z")

GAP = 1.5  # An interval longer than this many usual ones is a gap [1].
LATE = 3  # So many stamps in a row may be late [1].
EVEN = 1e-6  # Intervals that differ by no more are one, rounded in the last places [1].

ROUNDED, NEAR = (1e-2, 1e-3, 1e-4), 1e-2
"""Last places to which stamps are rounded [s], and by how much of one they miss it [1]."""

OFF = 0.6
"""Rounding, and the line through rounded stamps, are off by so much of the last place [1]."""


def gaps(step: FloatArray) -> BoolArray:
    """Tell which intervals between stamps are gaps, shape (n,); `step` (n,): those intervals [s].

    A stamp that came late is made good by the next few; a gap by none. An interval of rounded
    stamps may be as long as the next multiple of their last place.
    """
    usual, longest = _usual_and_longest(step)
    wide = np.asarray(step > longest)
    if wide.any():
        for more in range(1, min(LATE, len(step) - 1) + 1):
            total = np.convolve(step, np.ones(more + 1), "valid")
            made_good = total <= (more + GAP) * usual
            wide[: len(total)] &= ~made_good
            wide[more:] &= ~made_good
    return wide


def _usual_and_longest(step: FloatArray) -> tuple[float, float]:
    """Return the interval that most are, and the longest that may be no gap [s].

    The median, but for stamps that are rounded to about an interval: then it is a multiple of their
    last place, and the mean over `MANY` tells, if it is the same everywhere but for rounding.
    """
    usual = float(np.median(step)) if len(step) else 0.0
    few = step[:1000]
    places = (u for u in ROUNDED if np.abs(few / u - np.round(few / u)).max(initial=0.0) < NEAR)
    unit = next(places, 0.0)
    if unit < usual / 5 or len(step) < 2 * MANY:
        return usual, GAP * usual
    sums = np.convolve(step, np.ones(MANY), "valid")
    alike = np.abs(sums - np.median(sums)) <= 1.5 * unit
    mean = float(sums[alike].mean()) / MANY if alike.any() else usual
    if np.mean(np.abs(sums - MANY * mean) <= 1.2 * unit) < MOSTLY:
        return usual, GAP * usual  # samples are lost here and there
    return mean, max(GAP * mean, (np.ceil(mean / unit - 2 * NEAR) + 0.5) * unit)


def usual_step(step: FloatArray) -> float:
    """Return the interval that samples really have; `step` (n,): those of their stamps [s].

    The mean of those that are no gaps: stamps that are rounded to milliseconds have a median that
    is off by up to some percent.
    """
    if not len(step):
        return float("nan")
    median = float(np.median(step))
    even = float(np.ptp(step)) <= EVEN * median
    return median if even else float(step[~gaps(step)].mean())


def whole_means(time: FloatArray, x: FloatArray) -> FloatArray:
    """Return increments as means since the row before, (n, k).

    `x` (n, k): means over the usual interval that ends at each row; `time` (n,): of the rows [s].
    Of what a gap has before that both neighbours hold half.
    """
    step = np.diff(time)
    gap = 1 + np.flatnonzero(gaps(step))
    lost = 1.0 - usual_step(step) / step[gap - 1, None]
    out = x.copy()
    out[gap] += lost * 0.5 * (x[gap - 1] - x[gap])
    return out


def evened(time: FloatArray) -> FloatArray:
    """Return the stamps of an even clock without their rounding, any others as they are, (n,) [s].

    `time` (n,): stamps [s]. They are such where none is farther from a line than rounding makes it.
    """
    step = np.diff(time)
    usual = usual_step(step)
    if len(step) < 2 or not usual > 0 or float(np.ptp(step)) <= EVEN * usual:
        return time
    t = time - time[0]
    units = (u for u in ROUNDED if np.abs(t / u - np.round(t / u)).max() < NEAR)
    unit = next(units, 0.0)
    count = np.concatenate([[0.0], np.cumsum(np.round(step / usual))])
    slope, start = np.polyfit(count, t, 1)
    line = np.asarray(time[0] + start + slope * count)
    within = np.abs(line - time).max() <= OFF * unit and (np.diff(count) > 0).all()
    return line if within else time


MANY, MOSTLY = 16, 0.9
"""So many intervals in a row last as long as others, but for rounding, in so many places [1]."""


@dataclass(frozen=True)
class Column:
    """One column: name, SI unit, meaning."""

    name: str
    unit: str
    meaning: str


@cache
def _columns() -> dict[str, list[tuple[str, str, str]]]:
    found: dict[str, list[tuple[str, str, str]]] = tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    )
    return found


@cache
def declared(table: str) -> tuple[Column, ...]:
    """Return the columns of a table, none of one that tables.toml does not have."""
    out: list[Column] = []
    for name, unit, meaning in _columns().get(table, ()):
        bare = name.removesuffix("x|y|z")
        triad = [Column(bare + a, unit, f"{meaning}, {a} axis") for a in AXES if bare != name]
        out += triad or [Column(name, unit, meaning)]
    return tuple(out)


CLOCKS = {"sensor": 1e-2, "host": 1e-4, "disciplined": 1e-6}
"""Whose clock counted a log's time -> relative standard deviation of its rate [1].

A sensor's own oscillator: inside a MEMS instrument it is trimmed to a percent or so (data sheets of
such give a register for the deviation). A host or logger counts by a crystal. A disciplined clock
is steered by GNSS or a network (PTP).
"""


@dataclass(frozen=True)
class Clock:
    """How far the time of a log can be trusted: nothing in the log shows that its clock is fast."""

    source: str = "host"  # whose clock it is
    sd: float = CLOCKS["host"]  # relative standard deviation of its rate [1]
    # whether the standard deviation was declared; else it is usual for the source
    declared: bool = False

    @classmethod
    def of(cls, source: str, sd: float | None = None) -> Clock:
        """Return the clock of a `source`, its usual standard deviation where `sd` is None [1]."""
        return cls(source, CLOCKS[source] if sd is None else sd, sd is not None)


@dataclass(frozen=True)
class TableColumns:
    """What a log says about the table that the instrument stood on."""

    # (n, 3) outer, middle and inner angle as the table says [rad]; NaN where an axis is not logged
    angles: FloatArray
    # (n,) rate of the outer axis, counter-clockwise seen from above, as the table says [rad/s]
    rate: FloatArray | None = None
    # (n,) number of the position that each row belongs to, -1 between positions [1]
    position: IntArray | None = None

    def __getitem__(self, rows: slice | IntArray) -> TableColumns:
        """Return the samples of a slice."""
        return TableColumns(
            self.angles[rows],
            None if self.rate is None else self.rate[rows],
            None if self.position is None else self.position[rows],
        )


MOST_SAMPLES = 20_000_000  # Longest log that is simulated: 55 hours at 100 Hz [1].

SAMPLE_SIZE = 200
"""What a sample takes while it is simulated, in all columns and their halfway stages [byte]."""


def whole_samples(count: float) -> int:
    """Return `count`, shape () [1], as a number of samples that can be simulated.

    Raises ``program.samples``: more than any memory holds; ``program.few``: not two.
    """
    if not count >= 1:
        raise error("program.few")
    if not count <= MOST_SAMPLES:
        size = SAMPLE_SIZE * count / 1e9
        raise error("program.samples", count=count, size=size, most=MOST_SAMPLES)
    return int(count)


def numbers(
    name: str, given: object, shape: tuple[int | None, ...], *, more: bool = False
) -> FloatArray:
    """Return `given` as floats, those that are masked as NaN; refuse what is none, or shaped else.

    `name`: what an error calls it; `shape`: what it must be, None for any length [1]; `more`:
    whether axes in front of these are allowed.
    """
    x: Any = given
    if type(x) is not np.ndarray or x.dtype != float:
        try:
            x = np.ma.asarray(given)
            x = x.astype(float) if x.dtype.kind in "fiuO" else x
        except (TypeError, ValueError):
            raise _not_numbers(name, f"a {type(given).__name__}", shape) from None
        x = x.filled(np.nan) if x.dtype == float else x
    if x.dtype != float:
        raise _not_numbers(name, f"of {x.dtype}", shape)
    extra = x.ndim - len(shape)
    fits = extra >= 0 if more else extra == 0
    if not fits or any(s not in (None, n) for n, s in zip(x.shape[extra:], shape, strict=True)):
        raise _not_numbers(name, f"of shape {x.shape}", shape)
    return x  # type: ignore[no-any-return]


def _not_numbers(name: str, given: str, shape: tuple[int | None, ...]) -> FoucaultError:
    allowed = str(tuple("n" if s is None else s for s in shape)).replace("'", "")
    return error("argument.array", name=name, given=given, allowed=allowed)


@dataclass(frozen=True)
class Log(Shown):
    """An inertial log in SI units and body axes, exactly as measured (nothing compensated).

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time of each sample, strictly increasing [s].
    gyro : ndarray, shape (n, 3), or None
        Angular rate w_ib_b; an axis that was not logged is NaN throughout [rad/s].
    accel : ndarray, shape (n, 3), or None
        Specific force f_b, +1 g up at rest; an axis that was not logged is NaN [m/s^2].
    sampled : {"rate", "increment"}
        "rate": each row is the instantaneous value at its time. "increment": each row is the
        mean over the interval that ends at its time (increments divided by the interval).
    temperature : ndarray, shape (n,), or None
        Temperature [K].
    table : TableColumns or None
        Angles of the table the instrument stood on, where logged.
    averaged : ndarray, shape (n,), or None
        Where every row is already the mean over a position: over how long [s]. None: samples.
    findings : tuple of Finding
        What the reader noticed and repaired or left as it was.
    source : dict
        Where the log came from: file, sha256, size and the description it was read with.
    clock : Clock
        What counted its time.
    begins : tuple of int
        Rows with which further recordings begin, where files recorded one by one were joined [1].
    mag : ndarray, shape (n, 3), or None
        Magnetic field along the axes of the magnetometer [T].
    rests : tuple of (float, float), or None
        Times of the first and the last sample of each rest, where somebody has said them [s].
    """

    time: FloatArray
    gyro: FloatArray | None
    accel: FloatArray | None
    sampled: Literal["rate", "increment"] = "rate"
    temperature: FloatArray | None = None
    findings: tuple[Finding, ...] = ()
    source: dict[str, Any] = field(default_factory=dict)
    table: TableColumns | None = None
    averaged: FloatArray | None = None
    clock: Clock = Clock()
    begins: tuple[int, ...] = ()
    mag: FloatArray | None = None
    rests: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        time = numbers("time of the log", self.time, (None,))
        object.__setattr__(self, "time", time)
        for name in ("gyro", "accel", "mag", "temperature", "averaged"):
            if (block := getattr(self, name)) is not None:
                shape = (len(time), 3)[: 2 if name in ("gyro", "accel", "mag") else 1]
                object.__setattr__(self, name, numbers(f"{name} of the log", block, shape))
        require_word("sampled", self.sampled, ("rate", "increment"))

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def interval(self) -> float:
        """Nominal sample interval, see `usual_step` [s]."""
        return usual_step(np.diff(self.time))

    @cached_property
    def lasting(self) -> FloatArray:
        """Time that each sample stands for, of a gap half of what is missing, shape (n,) [s]."""
        step = np.diff(self.time)
        missing = np.where(gaps(step), step - self.interval, 0.0)
        out = np.full(len(self), self.interval)
        out[:-1] += missing / 2
        out[1:] += missing / 2
        return out

    @property
    def rate(self) -> float:
        """Nominal sample rate [Hz]."""
        return 1.0 / self.interval

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def __getitem__(self, rows: slice | IntArray) -> Log:
        """Return the samples of a slice, or of rows by number in rising order."""
        kept = range(len(self))[rows] if isinstance(rows, slice) else rows
        begins = {bisect_left(kept, k) for k in self.begins}
        return replace(
            self,
            begins=tuple(sorted(k for k in begins if 0 < k < len(kept))),
            time=self.time[rows],
            gyro=None if self.gyro is None else self.gyro[rows],
            accel=None if self.accel is None else self.accel[rows],
            mag=None if self.mag is None else self.mag[rows],
            temperature=None if self.temperature is None else self.temperature[rows],
            table=None if self.table is None else self.table[rows],
            averaged=None if self.averaged is None else self.averaged[rows],
        )

    def from_start(self) -> tuple[Log, float]:
        """Return the log with its time counted from its first sample, and that time [s]."""
        start = float(self.time[0])
        said = self.rests and tuple((a - start, b - start) for a, b in self.rests)
        return replace(self, time=self.time - start, rests=said), start

    def recordings(self) -> list[tuple[int, Log]]:
        """Return each recording and its first row [1]."""
        edges = [0, *self.begins, len(self)]
        return [(a, self[a:b]) for a, b in pairwise(edges)]

    def logged(self, triad: str) -> tuple[int, ...]:
        """Return the numbers of the axes that were logged.

        Parameters
        ----------
        triad : {"gyro", "accel"}
            Which instrument.
        """
        block = getattr(self, triad)
        if block is None:
            return ()
        absent = np.isnan(block[:1]).all(axis=0)  # that of a log is the whole column
        absent[absent] = np.isnan(block[:, absent]).all(axis=0)
        return tuple(np.flatnonzero(~absent).tolist())

    def filled(self) -> Log:
        """Return the log with zeros for the axes that were not logged."""
        new: dict[str, Any] = {}
        for name in ("gyro", "accel"):
            axes = list(self.logged(name))
            if len(self) and len(axes) in (1, 2):
                new[name] = np.zeros((len(self), 3))
                new[name][:, axes] = getattr(self, name)[:, axes]
        return replace(self, **new) if new else self

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns of imu_log that this log has, by name, each shape (n,) [SI]."""
        out = {"time": self.time}
        for name, block in (("gyro", self.gyro), ("accel", self.accel), ("mag", self.mag)):
            if block is not None:
                out |= {f"{name}_{a}": block[:, i] for i, a in enumerate(AXES)}
        if self.temperature is not None:
            out["temperature"] = self.temperature
        return out


@dataclass(frozen=True)
class IndexedLog:
    """What a north seeker said: one gyro on an indexing base, with its accelerometers."""

    # (n,) time of each sample, or the beginning of each mean; it runs forward within a set-up [s]
    time: FloatArray
    # (n,) index angle, clockwise seen from above, 0 where the sensing axis lies along y_b [rad]
    index: FloatArray
    gyro: FloatArray  # (n,) angular rate along the sensing axis [rad/s]
    # (n, 1) or (n, 2) specific force: along the sensing axis, or right and forward of two
    # accelerometers that stay with the case [m/s^2]
    accel: FloatArray | None
    setup: IntArray  # (n,) number of the set-up of each row, from 0, never falling [1]
    names: Sequence[str]  # name of each set-up, all different
    # (n,) heading of y_b by another reference, NaN where it is not known [rad]
    heading: FloatArray | None = None
    temperature: FloatArray | None = None  # (n,) temperature [K]
    # (n,) where every row is already a mean: over how long [s]. None: samples
    averaged: FloatArray | None = None
    findings: tuple[Finding, ...] = ()  # what the reader noticed
    # where the log came from: file, sha256, rows and the description it was read with
    source: dict[str, Any] = field(default_factory=dict)
    clock: Clock = Clock()  # what counted its time
    # latitude, latitude_sd: (n,) latitude of the set-up and its standard deviation, NaN where the
    # row does not say it; None where one place counts for all [rad]
    latitude: FloatArray | None = None
    latitude_sd: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def interval(self) -> float:
        """Nominal interval within a set-up, see `usual_step` [s]."""
        step = np.diff(self.time)[np.diff(self.setup) == 0]
        return usual_step(step)

    @property
    def rate(self) -> float:
        """Nominal rate of the rows [Hz]."""
        return 1.0 / self.interval

    @property
    def duration(self) -> float:
        """Time that the rows cover, set-up by set-up [s]."""
        starts = np.flatnonzero(np.diff(self.setup, prepend=-1))
        ends = np.append(starts[1:], len(self)) - 1
        last = 0.0 if self.averaged is None else self.averaged[ends]
        return float(np.sum(self.time[ends] - self.time[starts] + last))

    def rows(self, keep: IntArray) -> IndexedLog:
        """Return some rows; set-ups keep their numbers.

        `keep` (k,): numbers of the rows [1].
        """
        optional = ("accel", "heading", "temperature", "averaged", "latitude", "latitude_sd")
        some = {name: getattr(self, name)[keep] for name in ("time", "index", "gyro", "setup")}
        some |= {k: None if getattr(self, k) is None else getattr(self, k)[keep] for k in optional}
        return replace(self, **some)


def temperature_range(log: Log | IndexedLog) -> dict[str, Any]:
    """Return lowest, highest and mean temperature of a log that has one, for result.json [K].

    `log`: the log of the session [SI].
    """
    if (T := log.temperature) is None:
        return {}
    return {
        "temperature": [float(T.min()), float(T.max())],
        "temperature_mean": float(T.mean()),
    }


def ranges(log: Log) -> dict[str, Any]:
    """Return the ranges of a session of six sensors, outside which a result is extrapolated.

    `log`: the log of the session [SI].
    """
    out: dict[str, Any] = {"sampled": log.sampled, "rate": log.rate}
    for name in ("accel", "gyro"):
        x = getattr(log, name)
        out[name] = [float(x.min()), float(x.max())]
    return out | temperature_range(log)


SPIKES = 1e-3  # Part of the rates on either side that may be spikes, and no range [1].


def range_below_g(log: Log, gravity: float, tail: float = 0.0) -> dict[str, Any]:
    """Return the ranges of a session in a standing body, whatever it turned, for result.json.

    Outside them the result is extrapolated.

    `log`: the log of the session [SI]; `gravity`: local gravity [m/s^2]; `tail`: part of the rates
    that is left out on either side, where a spike is no range [1].
    """
    out: dict[str, Any] = {"accel": [-gravity, gravity], "sampled": log.sampled}
    if log.averaged is None:
        out["rate"] = log.rate
    if log.gyro is not None:
        out["gyro"] = [float(v) for v in np.quantile(log.gyro, (tail, 1 - tail))]
    return out | temperature_range(log)
