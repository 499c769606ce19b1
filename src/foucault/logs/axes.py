"""Saturated and stuck axes, told from the samples alone.

Both show as runs of exactly equal samples. So do coarse sensors at rest and logs without noise,
which are neither; the tests below keep them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.errors import Finding, finding
from foucault.logs.checks import moment
from foucault.tables import AXES, FloatArray, IntArray

CLIPPED_RUN = 4
"""Shortest run at the extreme value that can be saturation [samples]."""

STUCK_TIME = 1.0
"""An axis that normally moves is stuck when it is constant for longer [s]."""

LONGER = 4.0
"""And for so many times longer than it repeats a reading otherwise [1]."""

ALTERNATES = 0.25
"""Of the steps of noise two in three turn back, of those of smooth motion hardly any: a signal has
noise where more than this do [1]."""

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

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time of each sample [s].
    values : ndarray, shape (n, 3)
        The samples as recorded, before increments are divided by the interval [SI].
    triad : str
        "gyro" or "accel", for the texts.
    limits : ndarray, shape (3, 2), or None
        Declared range of each axis, lowest and highest [SI].
    zero : float or None
        Time that texts count from; None is that of the first sample given [s].

    Returns
    -------
    tuple of Finding
        One for each saturated and each stuck axis.
    """
    if len(time) < 10:
        return ()
    zero = float(time[0]) if zero is None else zero
    needed = long_enough(float(np.median(np.diff(time))))
    found = []
    for i, axis in enumerate(AXES):
        x = np.ascontiguousarray(values[:, i])
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

    Parameters
    ----------
    interval : float
        Sample interval [s].
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
        moved = np.ptp(values[first : first + length, others], axis=0)
        still = moved == 0
        # Neighbours that are as still: a log without noise, or they were lost together.
        if still.any() and (len(constant) > 1 or still.all() or not noisy(x)):
            return None
        if length >= LONGER * usual_run and (moved[~still] >= 3 * usual).all():
            return int(first), int(first + length)
    return None


def standstill(x: FloatArray, needed: int) -> tuple[int, int] | None:
    """Return the first and the last row of a time in which a noisy signal repeats one reading.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Readings of one sensor that others do not tell anything of [unit].
    needed : int, shape ()
        So many rows do not read the same by chance [1].
    """
    runs = _runs(np.ascontiguousarray(x))
    chosen = runs.length >= needed
    rest = len(x) - int(runs.length[chosen].sum())
    if not chosen.any() or rest < needed or runs.count - int(chosen.sum()) < 0.5 * rest:
        return None
    k = int(np.argmax(runs.length))
    usual = int(runs.length[~chosen].max(initial=CLIPPED_RUN - 1))
    if runs.length[k] < LONGER * usual or not noisy(x):
        return None
    return int(runs.first[k]), int(runs.first[k] + runs.length[k] - 1)


def noisy(x: FloatArray) -> bool:
    """Tell whether a signal goes up and down from sample to sample, as noise does.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Readings of one sensor [unit].
    """
    step = np.diff(x)
    step = step[step != 0]
    return len(step) > 2 and float(np.mean(step[1:] * step[:-1] < 0)) > ALTERNATES
