"""Axes that say nothing: saturated, stuck, or slower than the log; told from the samples alone.

All three show as runs of exactly equal samples. So do coarse sensors at rest and logs without
noise, which are none of them; the tests below keep them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.errors import Finding, finding
from foucault.logs.checks import moment
from foucault.tables import AXES, Log, usual_step
from foucault.units import plain

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
    sample given [s]. Returns one for each saturated and each stuck axis, and one for what is slower
    than the log.
    """
    if len(time) < 10:
        return ()
    zero = float(time[0]) if zero is None else zero
    # What neither repeats a reading nor has a declared end shows nothing of the kind.
    repeats = values[1:] == values[:-1]
    most = max(np.count_nonzero(column) for column in repeats.T)
    slower = rows_per_reading(values) if most > SOME_REPEAT * len(repeats) else np.ones(3)
    for _ in range(2, CLIPPED_RUN):
        repeats = repeats[1:] & repeats[:-1]
    if limits is None and not repeats.any() and (slower == 1.0).all():
        return ()
    step = usual_step(np.diff(time))
    needed = long_enough(step)
    found = list(_held(slower, triad, step))
    for i, axis in enumerate(AXES):
        if limits is None and not repeats[:, i].any():
            continue
        x = np.ascontiguousarray(values[:, i])
        if np.isnan(x).all():  # not logged
            continue
        runs = _runs(x)
        words = {"triad": triad, "axis": axis}
        told = _clipped(x, runs) if limits is None else _at_limit(x, runs, limits[i])
        still = _stuck(x, values, i, runs, needed, triad)
        # What stands still at the end of its range, came there in full flight and left it again, is
        # not stuck.
        lost = told is None or (limits is None and still is not None and still[1] == len(x))
        if still is not None and (lost or x.min() < x[still[0]] < x.max()):
            start, end = still
            words |= {"start": moment(time[start] - zero), "end": moment(time[end - 1] - zero)}
            found.append(finding("log.stuck", **words))
        elif told is not None:
            first, count = told
            words["start"] = moment(time[first] - zero)
            found.append(finding("log.saturated", count=count, **words))
    return tuple(found)


SLOWER = 1.25
"""Rows per reading on average, of a sensor that is slower than its log: not a lost reading now and
then [1]."""

SOME_REPEAT = 0.15
"""Where fewer readings are like the one before, no sensor is so slow [1]."""

ENOUGH = 20
"""Fewer readings do not show at which rate they come [1]."""

TOGETHER = 0.7
"""Share of the axes that change in a row with a new reading, of a triad that is slow: of one in
coarse steps each changes alone [1]."""


ANY_READING = 0.2
"""A slow sensor repeats any reading; one that repeats a single one so often rests or is locked in
there [1]."""


def rows_per_reading(values: FloatArray) -> FloatArray:
    """Return in how many rows each axis repeats a reading, on average, shape (3,) [1].

    1 where it does not, or where coarse steps may be why: a slow sensor repeats any reading and
    comes to it by more than a few counts, or all three axes go on at once. A rest without noise,
    or a stuck time, is one long run among many short ones and does not count.

    `values` (n, 3): the samples as recorded [SI].
    """
    new = values[1:] != values[:-1]
    rows = new.any(axis=1)
    together = bool(rows.any()) and float(new[rows].mean()) > TOGETHER
    if together and (each := _usual_run(np.flatnonzero(rows))[0]) > SLOWER:
        return np.full(3, each)
    out = np.ones(3)
    for i in range(3):
        at = np.flatnonzero(new[:, i])
        each, again = _usual_run(at)
        if each > SLOWER and again.any():
            x = values[at + 1, i]
            size = np.abs(x - values[at, i])
            far = np.median(size[:-1][again]) > FULL_FLIGHT * size.min()
            most = np.unique(x[:-1][again], return_counts=True)[1].max()
            out[i] = each if far and most < ANY_READING * again.sum() else 1.0
    return out


def _usual_run(at: IntArray) -> tuple[float, BoolArray]:
    """Return how many rows a reading usually lasts [1], and which last longer than one, (n - 1,).

    `at` (n,): rows with a new one [1].
    """
    length = np.diff(at)
    if len(length) < ENOUGH:
        return 1.0, length < 0
    usual = length <= LONGER * np.median(length)
    return float(length[usual].mean()), usual & (length > 1)


def _held(slower: FloatArray, triad: str, interval: float) -> tuple[Finding, ...]:
    """Name the axes that repeat each reading, by their rows per reading (3,) [1]."""
    axes = ", ".join(axis for axis, rows in zip(AXES, slower, strict=True) if rows > 1.0)
    if not axes:
        return ()
    rows = float(slower.max())
    words = {"rate": plain(1 / interval / rows, 3), "log": plain(1 / interval, 3)}
    more = plain(float(np.sqrt(rows)), 2)
    return (finding("log.held", triad=triad, axes=axes, rows=plain(rows, 3), more=more, **words),)


PIECES = 10
"""Parts of the time in which an axis is constant, and of the log outside that are as long [1]."""

TURNED = 0.1
"""A vector that turned by so much of itself was seen to turn [1]."""

OBEYS = 0.8
"""Share of the parts outside in which the axis changes as it should [1]."""

SOME_MOVED = 3
"""Fewer parts that should have changed an axis prove nothing [1]."""


def unmoved(log: Log) -> tuple[Finding, ...]:
    """Name what is constant while the other triad says that it turned, however coarse it is.

    A field that is fixed outside changes in the body by ``df/dt = f x w``, axis by axis; and gyros
    turn where the field does. This is asked of the longest time in which an axis is constant (of
    the gyros, all of them), and told if it holds in the rest of the log: an axis of another name,
    sign or unit proves nothing.

    `log`: rates [SI]; what it already tells as stuck is left out.
    """
    gyro = log.gyro
    if gyro is None or len(log) < 2 * SOME_MOVED or np.isnan(gyro[0]).any():
        return ()
    told = {tuple(f.message.split()[:2]) for f in log.findings if f.code == "log.stuck"}
    needed = long_enough(log.interval)
    found = []
    for triad in ("accel", "mag", "gyro"):
        values = log.accel if triad == "gyro" else getattr(log, triad)
        if values is None or np.isnan(values[0]).any():
            continue
        every = _longest(gyro, needed) if triad == "gyro" else None
        for i, axis in enumerate(AXES):
            a, b = every or _longest(values[:, i : i + 1], needed)
            if (triad, axis) in told or b - a < needed:
                continue
            size = max(needed, (b - a) // PIECES)
            first = np.arange(a % size, len(log) - size + 1, size)
            should, does = _turned(log, values, first, size, None if triad == "gyro" else i)
            inside = (a <= first) & (first + size <= b)
            moves = should > TURNED
            if (moves & inside).sum() < SOME_MOVED or (moves & ~inside).sum() < SOME_MOVED:
                continue
            if float(np.mean(does[moves & ~inside] > should[moves & ~inside] / 2)) > OBEYS:
                start, end = (moment(log.time[k] - log.time[0]) for k in (a, b - 1))
                told_of = finding("log.stuck", triad=triad, axis=axis, start=start, end=end)
                # Most procedures do not use a magnetometer; the one that does looks at it itself.
                found.append(replace(told_of, severity="note") if triad == "mag" else told_of)
    return tuple(found)


def _longest(values: FloatArray, least: int) -> tuple[int, int]:
    """Return first row, and row after, of the longest constant time, if it has `least` rows [1]."""
    few = values[:: least // 2]
    if not (few[1:] == few[:-1]).all(axis=1).any():  # two of which lie in each time that counts
        return 0, 1
    moves = (values[1:] != values[:-1]).any(axis=1)
    at = np.flatnonzero(moves) + 1
    edges = np.concatenate([[0], at, [len(values)]])
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])


def _turned(
    log: Log, values: FloatArray, first: IntArray, size: int, axis: int | None
) -> tuple[FloatArray, FloatArray]:
    """Return by how much pieces should have moved an axis, and by how much they did, (k,) [1].

    `values` (n, 3): a field that is fixed outside [unit]; `first` (k,), `size`: rows of the pieces;
    `axis`: which of the field, by the gyros; None: the gyros, by how far the field turned. Both are
    parts of the field.
    """
    assert log.gyro is not None
    whole = float(np.median(np.linalg.norm(values[:: max(1, len(values) // 10_000)], axis=1)))
    out = np.zeros((2, len(first)))
    for k, row in enumerate(first.tolist()):
        w, f = log.gyro[row : row + size], values[row : row + size]
        if axis is None:
            begin, end = f[: size // 3].mean(axis=0), f[-(size // 3) :].mean(axis=0)
            turned = np.linalg.norm(np.cross(begin, end)) / whole**2
            out[:, k] = turned, np.linalg.norm(np.ptp(w, axis=0)) * size * log.interval
        else:
            i, j = (axis + 1) % 3, (axis + 2) % 3
            rate = f[:, i] * w[:, j] - f[:, j] * w[:, i]
            out[:, k] = np.ptp(np.cumsum(rate)) * log.interval / whole, np.ptp(f[:, axis]) / whole
    return out[0], out[1]


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
    x: FloatArray, values: FloatArray, i: int, runs: _Runs, needed: int, triad: str
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
    step = np.abs(np.diff(x))
    step = step[step > 0]
    # With less noise than a count it is constant wherever it does not move. A stuck gyro is so far
    # longer than in any rest; of other sensors `unmoved` judges by the gyros.
    fine = noisy(x) and float(np.median(step)) > 2.0 * runs.resolution
    if not fine and triad != "gyro":
        return None
    if not fine and len(constant) > 1:
        *_, second, longest = np.sort(runs.length[chosen])
        if longest < LONGER * second:
            return None
        constant = [run for run in constant if run[1] == longest]
    # Pulses of a steady rate come as evenly as they can: where some repeat for almost as long,
    # that one repeats for longer is their resolution.
    usual_run = int(runs.length[~chosen].max(initial=CLIPPED_RUN))
    usual = float(np.quantile(step, 0.25))
    others = [j for j in range(3) if j != i and np.ptp(values[:, j]) > 0]
    for first, length in constant:
        if length < LONGER * usual_run:
            continue
        # What stopped with it may happen to read the same a few rows earlier or later.
        inside = slice(first + usual_run, first + length - usual_run)
        moved = np.ptp(values[inside, others], axis=0)
        still = moved == 0
        # Neighbours that are as still: a log without noise, or they were lost together.
        if still.any() and (chosen.sum() > 1 or not noisy(x)):
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
    each = needed - 1  # so often a long run is met, wherever it begins
    if not (x[each::each] == x[each - 1 : -1 : each]).any():
        return None
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
