"""What can be wrong with the samples of a log, and what probably caused it.

Structure that no later stage could survive (missing values, time that runs backward) is an
error. All else is a finding: it is reported with its likely cause, and the work goes on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.models.earth import EARTH_RATE
from foucault.models.temperature import KELVIN_IN_CELSIUS
from foucault.symptoms import SYMPTOMS
from foucault.tables import AXES, Log, gaps, usual_step
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
        raise error(code, row=row + start, time=now, before=before, count=int(wrong.sum()),
                    advice=rate_instead(time, shared=shared))  # fmt: skip
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
    gravity: float = STANDARD_GRAVITY,
) -> tuple[Finding, ...]:
    """Compare the median specific force with gravity, and name the unit that would fit.

    `accel` (n, 3): specific force as read [m/s^2]; `interval`: nominal sample interval [s];
    `one`: SI value of one such unit, None for counts with a scale [m/s^2 or m/s]; `gravity`:
    local gravity [m/s^2].
    """
    norm = float(np.nanmedian(_norms(accel)))
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
    return values[:: max(1, len(values) // _SAMPLE)]


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


# -- Saturated and stuck axes, told from the samples alone ---------------------------------------
# Both show as runs of exactly equal samples. So do coarse sensors at rest and logs without noise,
# which are neither; the tests below keep them apart.

CLIPPED_RUN = 4
"""Shortest run at the extreme value that can be saturation [samples]."""

STUCK_TIME = 1.0
"""An axis that normally moves is stuck when it is constant for longer [s]."""

LONGER = 4.0
"""And for so many times longer than it repeats a reading otherwise [1]."""

ALTERNATES = 0.25
"""Of the steps of noise two in three turn back, of those of smooth motion hardly any: a signal has
noise where more than this do [1]."""

FEW_MOVES = 20
"""Fewer samples while a signal moves do not tell noise from motion [1]."""

SAME_MEAN = 4.0
"""Two halves of a rest have means that differ by no more of their noise than this [1]."""

FULL_FLIGHT = 4.5
"""A clipped signal reaches its limit by a step of more than this many counts [1]."""


@dataclass(frozen=True)
class _Runs:
    """Runs of equal samples of one axis.

    `first` and `length`, shape (k,), are those of the runs of `CLIPPED_RUN` samples and more;
    `count` is the number of all runs, and `resolution` the smallest step between two.
    """

    first: IntArray
    length: IntArray
    count: int
    resolution: float


def check(
    time: FloatArray,
    values: FloatArray,
    triad: str,
    limits: FloatArray | None = None,
    zero: float | None = None,
) -> tuple[Finding, ...]:
    """Look for saturated and stuck axes of one triad.

    `time` (n,): time of each sample [s]; `values` (n, 3): the samples as recorded, before
    increments are divided by the interval [SI]; `limits` (3, 2) or None: declared range of each
    axis, lowest and highest [SI]; `zero`: time that texts count from, None is that of the first
    sample given [s]. Returns one for each saturated and each stuck axis.
    """
    if len(time) < 10:
        return ()
    zero = float(time[0]) if zero is None else zero
    # What neither repeats a reading nor has a declared end shows nothing of the kind.
    repeats = values[1:] == values[:-1]
    for _ in range(2, CLIPPED_RUN):
        repeats = repeats[1:] & repeats[:-1]
    if limits is None and not repeats.any():
        return ()
    needed = long_enough(float(np.median(np.diff(time))))
    found = []
    for i, axis in enumerate(AXES):
        if limits is None and not repeats[:, i].any():
            continue
        x = np.ascontiguousarray(values[:, i])
        if np.isnan(x).all():  # not logged
            continue
        runs = _runs(x)
        words = {"triad": triad, "axis": axis}
        told = _clipped(x, runs) if limits is None else _at_limit(x, runs, limits[i])
        still = _stuck(x, values, i, runs, needed)
        # What stands still at the end of its range, and came there in full flight, is not stuck.
        if still is not None and (told is None or x.min() < x[still[0]] < x.max()):
            start, end = still
            words |= {"start": moment(time[start] - zero), "end": moment(time[end - 1] - zero)}
            found.append(finding("log.stuck", **words))
        elif told is not None:
            first, count = told
            words["start"] = moment(time[first] - zero)
            found.append(finding("log.saturated", count=count, **words))
    return tuple(found)


def long_enough(interval: float) -> int:
    """Return the number of samples that do not repeat one reading by chance [1].

    `interval`: sample interval [s].
    """
    return max(10, int(np.ceil(STUCK_TIME / interval)))


def _runs(x: FloatArray) -> _Runs:
    step = np.abs(np.diff(x))
    changes = np.flatnonzero(step) + 1
    resolution = float(step[changes - 1].min()) if len(changes) else 0.0
    del step  # a log of ten million rows leaves no room for more than a few columns
    bounds = np.concatenate(([0], changes, [len(x)]))
    del changes
    length = np.diff(bounds)
    long = np.flatnonzero(length >= CLIPPED_RUN)
    return _Runs(bounds[long], length[long], len(length), resolution)


def _at_limit(x: FloatArray, runs: _Runs, limits: FloatArray) -> tuple[int, int] | None:
    """Return the first row within one count of the declared limits, and the number of rows."""
    slack = max(runs.resolution, 1e-9 * float(limits[1] - limits[0]))
    rows = np.flatnonzero((x <= limits[0] + slack) | (x >= limits[1] - slack))
    return (int(rows[0]), len(rows)) if len(rows) else None


def _clipped(x: FloatArray, runs: _Runs) -> tuple[int, int] | None:
    """Return the first row of a run at the extreme value, and the number of rows, or None."""
    if runs.count < 3:
        return None
    before = np.abs(x[runs.first] - x[np.maximum(runs.first - 1, 0)])
    end = runs.first + runs.length
    after = np.abs(x[end - 1] - x[np.minimum(end, len(x) - 1)])
    # A quantised signal also lingers at its top while it turns round, but it gets there by
    # steps of one or two counts. A clipped one arrives in full flight.
    arrives = np.maximum(before, after) > FULL_FLIGHT * runs.resolution
    flat = arrives & (runs.length >= 3 * len(x) / runs.count)
    value = x[runs.first]
    extreme = (value == x.max()) | (value == x.min())
    inside, outside = (int(runs.length[flat & where].sum()) for where in (~extreme, extreme))
    # Where such plateaus are as common inside the range, the log is free of noise (simulated).
    if outside <= inside:
        return None
    return int(runs.first[flat & extreme][0]), outside


def _stuck(
    x: FloatArray, values: FloatArray, i: int, runs: _Runs, needed: int
) -> tuple[int, int] | None:
    """Return the first row of a stuck time of axis `i` and the row after its last, or None."""
    if runs.count == 1:
        return 0, len(x)
    chosen = runs.length >= needed
    constant = list(zip(runs.first[chosen], runs.length[chosen], strict=True))
    rest = len(x) - int(runs.length[chosen].sum())
    # Outside these runs a fine sensor changes with nearly every sample; a coarse one does not,
    # and says nothing by being constant.
    if not constant or rest < needed or runs.count - len(constant) < 0.5 * rest:
        return None
    # Pulses of a steady rate come as evenly as they can: where some repeat for almost as long,
    # that one repeats for longer is their resolution.
    usual_run = int(runs.length[~chosen].max(initial=CLIPPED_RUN))
    step = np.abs(np.diff(x))
    usual = float(np.quantile(step[step > 0], 0.25))
    others = [j for j in range(3) if j != i and np.ptp(values[:, j]) > 0]
    for first, length in constant:
        if length < LONGER * usual_run:
            continue
        # What stopped with it may happen to read the same a few rows earlier or later.
        inside = slice(first + usual_run, first + length - usual_run)
        moved = np.ptp(values[inside, others], axis=0)
        still = moved == 0
        # Neighbours that are as still: a log without noise, or they were lost together.
        if still.any() and (len(constant) > 1 or not noisy(x)):
            return None
        # All three: a sensor too coarse to show noise at rest, unless it does in another rest.
        if still.all() and not _shows_noise_at_rest(values, needed):
            return None
        if (moved[~still] >= 3 * usual).all():
            return int(first), int(first + length)
    return None


def standstill(x: FloatArray, needed: int) -> tuple[int, int] | None:
    """Return the first and the last row of a time in which a noisy signal repeats one reading.

    `x` (n,): readings of one sensor that others do not tell anything of [unit]; `needed`: so many
    rows do not read the same by chance [1].
    """
    runs = _runs(np.ascontiguousarray(x))
    chosen = runs.length >= needed
    rest = len(x) - int(runs.length[chosen].sum())
    if not chosen.any() or rest < needed or runs.count - int(chosen.sum()) < 0.5 * rest:
        return None
    k = int(np.argmax(runs.length))
    # Shorter runs are not listed; where each row reads otherwise, there is none.
    unlisted = CLIPPED_RUN - 1 if runs.count - len(runs.length) < len(x) - runs.length.sum() else 1
    usual = int(runs.length[~chosen].max(initial=unlisted))
    if runs.length[k] < LONGER * usual or not noisy(x):
        return None
    return int(runs.first[k]), int(runs.first[k] + runs.length[k] - 1)


def _shows_noise_at_rest(values: FloatArray, needed: int) -> bool:
    """Tell whether all axes stay where they are for `needed` samples and change with each."""
    n = len(values) // needed
    x = values[: n * needed].reshape(n, needed, 3)
    step = np.diff(x, axis=1)
    half = needed // 2
    moved = np.abs(x[:, half:].mean(axis=1) - x[:, :half].mean(axis=1))
    # Of white noise the difference of two means scatters by twice its sd over the root of the
    # number, and the step of two samples by 1.4 times its sd.
    noise = np.sqrt(2.0 * (step**2).mean(axis=1) / needed)
    changes = (step != 0).mean(axis=1) > 0.5
    return bool(np.any(np.all(changes & (moved < SAME_MEAN * noise), axis=1)))


def noisy(x: FloatArray) -> bool:
    """Tell whether a signal goes up and down from sample to sample, as noise does.

    Where motion is larger than noise, fourth differences have next to nothing of the motion left.

    `x` (n,): readings of one sensor [unit].
    """
    step = np.diff(x)
    changes = step[step != 0]
    if len(changes) > 2 and float(np.mean(changes[1:] * changes[:-1] < 0)) > ALTERNATES:
        return True
    fourth = np.diff(step, 3)
    # Where it moves throughout, so that ends of ramps are none, and by more than digits round.
    moves = np.convolve(step != 0, np.ones(4), "valid") == 4
    if moves.sum() < FEW_MOVES:
        return False
    count = float(np.diff(np.unique(x)).min())
    least = max(count, 1e-12 * float(np.abs(x).max()))
    large = moves & (np.abs(fourth) > 4.0 * least)
    turns = large[1:] & large[:-1] & (fourth[1:] * fourth[:-1] < 0)
    return bool(turns.sum() > 0.5 * moves.sum())


def spared(
    findings: tuple[Finding, ...],
    log: Log,
    gyro: Sequence[tuple[FloatArray, FloatArray]] | None,
    accel: Sequence[tuple[FloatArray, FloatArray]] | None,
) -> tuple[Finding, ...]:
    """Tell saturation as a note where no reading that was used is at the limit.

    `log`: readings [SI]; `gyro`, `accel`: start and duration, each (k,), of the readings that were
    used [s]; None where all were. Returns the findings, others as they were.
    """
    out = []
    for told in findings:
        triad, axis = (*told.message.split(), "", "")[:2]
        parts = {"gyro": gyro, "accel": accel}.get(triad)
        if told.code == "log.saturated" and parts is not None and log.sampled != "increment":
            x = getattr(log, triad)[:, AXES.index(axis)]
            top = (x == np.nanmax(x)) | (x == np.nanmin(x))
            pairs = top[1:] & top[:-1] & (np.diff(x) == 0)  # one reading alone is noise
            at = log.time[1:][pairs]
            inside = [
                np.searchsorted(at, start) < np.searchsorted(at, start + time)
                for start, time in parts
            ]
            if not any(part.any() for part in inside):
                told = replace(told, severity="note")
        out.append(told)
    return tuple(out)
