"""What can be wrong with the samples of a log, and what probably caused it.

Structure that no later stage could survive (missing values, time that runs backward) is an
error. All else is a finding: it is reported with its likely cause, and the work goes on.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.models.earth import EARTH_RATE
from foucault.models.temperature import KELVIN_IN_CELSIUS
from foucault.symptoms import SYMPTOMS
from foucault.tables import gaps, usual_step
from foucault.units import STANDARD_GRAVITY, ZERO_CELSIUS, factor, plain, span

IRREGULAR = (0.1, 0.01)
"""Irregular: this part of an interval off [1], in more than this part of all intervals [1]."""

FASTEST_GYRO = 100.0
"""No gyro in use measures more (5730 deg/s) [rad/s]."""

GRAVITY_BAND = 1.25
"""The median specific force of a working log is gravity within this factor [1]."""

CAUSE_BAND = 1.15
"""A wrong unit explains a wrong norm when it brings it within this factor of gravity [1]."""

LARGEST = 1e100
"""What is beyond is as good as infinite, and the sum of its squares is [SI]."""

RATE_BAND = (1.0, 1e5)
"""Inertial instruments are sampled at rates within this band [Hz]."""

USUAL_RATE = 200.0
"""Where several units of time are possible, the one that gives a rate nearest to this [Hz]."""

TIME_UNITS = ("s", "ms", "us", "ns")
"""Units people log time in."""

_SAMPLE = 200_000  # rows are thinned to about this many for a median or quantile

Missing = Literal["error", "drop", "mask"]


def finite(
    columns: dict[str, FloatArray], missing: Missing, file: str, start: int = 0
) -> tuple[npt.NDArray[np.bool_] | None, tuple[Finding, ...]]:
    """Look for missing (NaN) and infinite values, or such as no sum of squares would hold.

    `columns` (n,) or (n, 3): the blocks of the log by name [SI]; `missing`: whether such rows are
    an error, are left out, or are kept where only the accelerometers are missing; `start`: number
    of the first row, where these are not the first of the log [1]. Returns `keep` (n,): rows to
    keep; None where all are good.
    """
    bad: dict[str, npt.NDArray[np.int64]] = {}
    for name, values in columns.items():
        # Without a mask for the usual case; both are NaN where any value is.
        if not -LARGEST < values.min(initial=0.0) <= values.max(initial=0.0) < LARGEST:
            wrong = ~(np.abs(values) < LARGEST)
            rows = np.flatnonzero(wrong.any(axis=1) if wrong.ndim == 2 else wrong)
            if len(rows):
                bad[name] = rows
    if missing == "mask" and not (np.abs(columns.get("accel", np.zeros(1))) >= LARGEST).any():
        bad.pop("accel", None)  # the rest of such a row is needed
    if not bad:
        return None, ()
    rows = np.unique(np.concatenate(list(bad.values())))
    where = ", ".join(bad)
    if missing != "drop":
        infinite = any((np.abs(columns[name][rows]) >= LARGEST).any() for name in bad)
        code = "log.infinite" if infinite else "log.missing_value"
        raise error(code, file=file, count=len(rows), rows=_row_list(rows + start),
                    columns=where)  # fmt: skip
    keep = np.ones(len(next(iter(columns.values()))), bool)
    keep[rows] = False
    told = finding("log.dropped", count=len(rows), rows=_row_list(rows + start), columns=where)
    return keep, (told,)


def doubled(
    columns: dict[str, FloatArray], last: dict[str, FloatArray] | None = None
) -> tuple[npt.NDArray[np.bool_] | None, tuple[Finding, ...]]:
    """Look for rows that repeat the row before them in every column, time included.

    `columns` (n,) or (n, 3): the blocks of the log by name, ``time`` among them [SI]; `last` or
    None: rows before these, where these are not the first of the log [SI]. Returns `keep` (n,):
    rows to keep; None where none repeats.
    """
    time = columns["time"]
    rows = np.flatnonzero(time[1:] == time[:-1]) + 1
    for values in columns.values():
        same = values[rows] == values[rows - 1]
        rows = rows[same.all(axis=1) if values.ndim == 2 else same]
    if last and all(np.array_equal(last[name][-1], values[0]) for name, values in columns.items()):
        rows = np.concatenate(([0], rows))
    if not len(rows):
        return None, ()
    keep = np.ones(len(time), bool)
    keep[rows] = False
    return keep, (finding("log.rows_doubled", count=len(rows)),)


EARLIEST = 20
"""Parts of a log of which each has stamps that came without delay [1]."""


def even_rate(time: FloatArray) -> float | None:
    """Return the rate of samples that are even while their stamps come late, N / T [Hz].

    A host stamps what has waited, so that intervals say nothing of the rate: their median neither,
    where samples come in bursts. Count over time does, if no sample is lost; then the earliest
    stamps of every part of the log lie on one straight line.

    `time` (n,): time of each sample, None is returned where samples are lost [s].
    """
    count = len(time) - 1
    if count < 1 or not time[-1] > time[0]:
        return None
    # Line through the first and the last part, by their least delayed stamps.
    index = np.arange(count + 1)
    size = max(1, (count + 1) // EARLIEST)
    off = time - time[0] - index * (time[-1] - time[0]) / count
    first, last = int(np.argmin(off[:size])), count + 1 - size + int(np.argmin(off[-size:]))
    period = float((time[last] - time[first]) / (last - first)) if last > first else 0.0
    if not period > 0:
        return None
    late = time - time[0] - index * period
    parts = late[: size * EARLIEST].reshape(-1, size) if count + 1 >= 25 * EARLIEST else late[None]
    earliest = parts.min(axis=1)
    waits = float(np.median(parts.max(axis=1) - earliest))
    return 1.0 / period if np.ptp(earliest) <= max(2.0 * period, waits) else None


def rate_instead(time: FloatArray, *, shared: bool = False) -> str:
    """Say whether a rate may take the place of a log's time, and which.

    `time` (n,): time of each sample [s]; `shared`: whether something else is stamped by the same
    clock: a master, a second log, a table.
    """
    if shared:
        return SHARED
    rate = even_rate(time)
    if rate is None:
        return "No rate can take the place of [log.time]: samples are lost besides"
    return (
        "If the instrument samples evenly, loses nothing and only its time is coarse, replace "
        f'[log.time] by rate = "{plain(rate, 6)} Hz" in [log]: their number over their time'
    )


RESTARTED = "The logger was restarted, or two logs were put together: keep one part of the file"
SET_BACK = (
    "The clock went back by one hour, as where summer time ends: "
    "add 3600 s to the times from there on"
)
BITS, TICKS = (16, 24, 32), (1e-9, 1e-6, 1e-3, 1.0)
"""Of counters that begin again: how many they have, and how long one count is [s]."""


def _set_back(fall: float, nominal: float) -> str:
    """Say what a clock was that fell by `fall` between two samples `nominal` apart [s]."""
    if abs(fall - 3600.0) < 1.0:
        return SET_BACK
    for bits, tick in itertools.product(BITS, TICKS):
        if abs(fall + nominal - 2.0**bits * tick) < 0.5 * nominal:
            return (f"The counter has {bits} bits and began again: add {2.0**bits * tick:.9g} s to "
                    "the times from there on")  # fmt: skip
    return RESTARTED


SHARED = "Keep [log.time]: another log or a table is stamped by the same clock"


def on_a_shared_clock(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Take back the advice to replace a time that something else is stamped by too."""
    cure = SYMPTOMS["log.irregular"].cure.format(advice=SHARED)
    return tuple(replace(f, cure=cure) if f.code == "log.irregular" else f for f in findings)


@contextmanager
def beside_another() -> Iterator[None]:
    """Read a log that shares its clock: what stops it does not advise another time either."""
    try:
        yield
    except FoucaultError as problem:
        if problem.code != "log.time_repeated":
            raise
        cure = SYMPTOMS[problem.code].cure.format(advice=SHARED)
        raise FoucaultError(problem.code, problem.message, cure) from None


def timing(
    time: FloatArray, start: int = 0, zero: float | None = None, *, shared: bool = False
) -> tuple[Finding, ...]:
    """Check that time runs forward, and look for gaps and an irregular rate.

    `time` (n,): time of each sample [s]; `start`: number of the first row, where these are not
    the first of the log [1]; `zero`: time that texts count from, None is that of the first sample
    given [s]; `shared`: whether something else is stamped by the same clock. Returns gaps and
    irregularity; time that repeats or runs backward is raised as an error.
    """
    if len(time) < 3:
        return ()
    zero = float(time[0]) if zero is None else zero
    step = np.diff(time)
    least, longest_step = float(step.min()), float(step.max())
    if least > 0.0 and longest_step < (1.0 + IRREGULAR[0]) * least:
        return ()  # all are within that of each other, so of their median
    wrong = step <= 0
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        code = "log.time_repeated" if step[row - 1] == 0 else "log.time_backward"
        now, before = (moment(t - zero) for t in (time[row], time[row - 1]))
        jitter = least >= -2.0 * float(np.median(step)) and np.mean(step < 0) < 0.5
        back = _set_back(-least, float(np.median(step)))
        raise error(code, row=row + start, time=now, before=before, count=int(wrong.sum()),
                    advice=rate_instead(time, shared=shared) if jitter else back)  # fmt: skip
    nominal, wide = usual_step(step), gaps(step)
    off = ~wide & (np.abs(step / nominal - 1.0) > IRREGULAR[0])
    found = []
    if off.mean() > IRREGULAR[1]:
        low, high = np.quantile(step, (0.01, 0.99))
        words = {"nominal": span(nominal), "low": span(low), "high": span(high)}
        advice = rate_instead(time, shared=shared)
        share = f"{100 * off.mean():.3g}"
        found.append(finding("log.irregular", share=share, advice=advice, **words))
    if wide.any():
        longest = int(np.argmax(np.where(wide, step, 0.0)))
        found.append(
            finding(
                "log.gap",
                count=int(wide.sum()),
                lost=f"{np.sum(np.round(step[wide] / nominal) - 1):.0f}",
                longest=span(step[longest]),
                start=moment(time[longest] - zero),
                nominal=span(nominal),
            )
        )
    return tuple(found)


def time_scale(interval: float, unit: str, one: float) -> tuple[Finding, ...]:
    """Find a rate that no inertial log has, and name the unit of time that would explain it.

    `interval`: nominal sample interval as read [s]; `one`: value of one such unit [s]. Returns
    one where the rate is far off and another unit would mend it.
    """
    low, high = RATE_BAND
    if not interval > 0 or low <= 1 / interval <= high:
        return ()
    rates = {other: one / (interval * factor(other, "time")) for other in TIME_UNITS}
    fits = {other: rate for other, rate in rates.items() if low <= rate <= high}
    if not fits:
        return ()
    likely = min(fits, key=lambda other: abs(np.log(fits[other] / USUAL_RATE)))
    words = {"rate": plain(1 / interval), "unit": unit, "interval": span(interval)}
    return (finding("log.time_unit", likely=likely, then=plain(fits[likely]), **words),)


ACCEL_UNITS = {"rate": ("m/s^2", "g", "mg"), "increment": ("m/s", "g*s")}
"""Units people log specific force and its increments in, for naming the likely one."""

_ACCEL_KINDS = {"rate": "specific force", "increment": "velocity increment"}


def accel_scale(
    accel: FloatArray,
    interval: float,
    unit: str,
    one: float | None,
    kind: Literal["rate", "increment"],
) -> tuple[Finding, ...]:
    """Compare the median specific force with gravity, and name the unit that would fit.

    `accel` (n, 3): specific force as read [m/s^2]; `interval`: nominal sample interval [s];
    `one`: SI value of one such unit, None for counts with a scale [m/s^2 or m/s].
    """
    norm, gravity = float(np.nanmedian(_norms(accel))), STANDARD_GRAVITY
    if _near(norm, gravity, GRAVITY_BAND):
        return ()
    words = {"norm": f"{norm:.4g}", "ratio": f"{norm / gravity:.3g}", "unit": unit, "kind": kind}
    if one is None or norm == 0:
        return (finding("log.accel_norm", **words),)
    raw = norm / one * (interval if kind == "increment" else 1.0)
    fits = []
    for other, units in ACCEL_UNITS.items():
        for candidate in units:
            value = raw * factor(candidate, _ACCEL_KINDS[other])
            true = value / interval if other == "increment" else value
            if _near(true, gravity, CAUSE_BAND):
                lines = f'unit = "{candidate}"'
                if other != kind:
                    lines += f' and kind = "{other}" (in [log.gyro] too)'
                fits.append(lines)
    if not fits:
        return (finding("log.accel_norm", **words),)
    return (finding("log.accel_unit", lines=", or ".join(fits), **words),)


RESTS_SLOWER = 0.05
"""At rest no gyro reads more, unless it is of another unit [rad/s]."""


def exchanged_triads(
    gyro: FloatArray, accel: FloatArray, ratio: FloatArray, gravity: float
) -> tuple[Finding, ...]:
    """Find columns of gyros that hold gravity, while those of accelerometers hold hardly anything.

    `gyro`, `accel` (n, 3): the readings [rad/s, m/s^2]; `ratio` (3,): what one rad/s is if the
    column is one of accelerometers [m/s^2]; `gravity`: local gravity [m/s^2].
    """
    held = _norms(thinned(gyro) * ratio)
    if not _near(float(np.nanmedian(held)), gravity, GRAVITY_BAND):
        return ()
    low, norm, high = np.nanquantile(held, (0.25, 0.5, 0.75))
    if not high < GRAVITY_BAND * low:
        return ()
    slowest = float(np.nanquantile(_norms(thinned(accel) / ratio), 0.1))
    if slowest > RESTS_SLOWER:
        return ()
    return (finding("log.triads_exchanged", gyro=f"{norm:.4g}", accel=f"{slowest:.2g}"),)


def gyro_scale(
    gyro: FloatArray, unit: str, kind: Literal["rate", "increment"]
) -> tuple[Finding, ...]:
    """Find rates that no gyro can measure: deg/s read as rad/s, rates read as increments.

    `gyro` (n, 3): angular rate as read [rad/s].

    Rates that are too small cannot be told from a quiet instrument by the log alone; the
    turns between rests show them.
    """
    few = thinned(gyro)
    if few.min(initial=0.0) >= -FASTEST_GYRO and few.max(initial=0.0) <= FASTEST_GYRO:
        return ()
    peak = float(np.quantile(np.abs(few).max(axis=1), 0.999))
    if peak <= FASTEST_GYRO:
        return ()
    likely = []
    if unit.startswith("rad"):
        likely.append('unit = "deg/s"' if kind == "rate" else 'unit = "deg"')
    if kind == "increment":
        likely.append('kind = "rate" with a unit such as "rad/s" (in [log.accel] too)')
    if unit.startswith("deg"):
        likely.append('unit = "deg/h" or "arcsec/s"' if kind == "rate" else 'unit = "arcsec"')
    lines = ", or ".join(likely) or "the right unit or count scale"
    return (
        finding(
            "log.gyro_unit", peak=f"{peak:.4g}", degrees=f"{np.degrees(peak):.4g}", unit=unit,
            kind=kind, lines=lines,
        ),
    )  # fmt: skip


def standard_gravity(scale: str | tuple[str, ...] | None) -> tuple[Finding, ...]:
    """Say which g a count scale per g is of: local gravity is up to 0.3 % off.

    `scale` or None: count scale as declared.
    """
    texts = (scale,) if isinstance(scale, str) else scale or ()
    per_g = [text for text in texts if re.search(r"\b[mun]?g\b", text)]
    return (finding("log.per_g", scale=per_g[0]),) if per_g else ()


TURNING_EARTH = 0.05
"""So near to a multiple of the Earth's rate is no chance [1]."""


def earth_scale(
    gyro: FloatArray, interval: float, unit: str, one: float, kind: Literal["rate", "increment"]
) -> tuple[Finding, ...]:
    """Find a log whose rests turn 3600 times as fast as the Earth: arcsec read as deg.

    `gyro` (n, 3): angular rate as read [rad/s]; `interval`: nominal sample interval [s]; `one`:
    SI value of one such unit [rad/s or rad].

    The norm of the Earth's rate is the same in every attitude; the tenth of the seconds that turns
    slowest is at rest in most logs. A bias of as many degrees per second has no gyro that sees it.
    """
    each = max(1, round(1.0 / interval)) if interval > 0 else 1
    count = len(gyro) // each
    if count < 10:
        return ()
    mean = np.full(each, 1.0 / each) @ gyro[: count * each].reshape(count, each, 3)
    slow = np.linalg.norm(mean, axis=1)
    ratio = float(np.quantile(slow, 0.1)) / EARTH_RATE
    if not abs(ratio / 3600.0 - 1.0) < TURNING_EARTH:
        return ()
    small = {"rate": ("arcsec/s", "deg/h"), "increment": ("arcsec",)}[kind]
    what = {"rate": "angular rate", "increment": "angle increment"}[kind]
    fits = [u for u in small if abs(one / factor(u, what) / 3600.0 - 1.0) < TURNING_EARTH]
    likely = " or ".join(f'"{u}"' for u in fits) or "3600 times smaller"
    rate = plain(float(np.degrees(ratio * EARTH_RATE)), 4)
    return (finding("log.gyro_earth", rate=rate, ratio=plain(ratio, 4), unit=unit, likely=likely),)


def _norms(values: FloatArray) -> FloatArray:
    """Return the lengths of the vectors in rows enough for a quantile, shape (k,)."""
    few = thinned(values)
    return np.sqrt(few[:, 0] ** 2 + few[:, 1] ** 2 + few[:, 2] ** 2)


def _near(value: float, wanted: float, band: float) -> bool:
    return wanted / band < value < wanted * band


def thinned(values: FloatArray) -> FloatArray:
    """Return rows enough for a median or a quantile, evenly out of `values`, shape (n,) or (n, 3).

    [unit of `values`]
    """
    return np.ascontiguousarray(values[:: max(1, len(values) // _SAMPLE)])


def moment(time: float) -> str:
    """Write a `time` counted from the start [s]; below a microsecond it is only rounding."""
    return f"{round(float(time), 6):.9g}"


def _row_list(rows: npt.NDArray[np.int64]) -> str:
    shown = ", ".join(str(row) for row in rows[:5])
    return f"{'row' if len(rows) == 1 else 'rows'} {shown}{', ...' if len(rows) > 5 else ''}"


def temperature_scale(temperature: FloatArray) -> tuple[Finding, ...]:
    """Tell temperatures that no instrument has: kelvin said to be degC, or the other way round.

    `temperature` (n,): as the log has it [K].
    """
    middle = float(np.nanmedian(temperature)) - ZERO_CELSIUS
    if not abs(middle) > KELVIN_IN_CELSIUS:
        return ()
    return (finding("log.temperature_unit", given=f"{middle:.1f}"),)
