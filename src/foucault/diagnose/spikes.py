"""Single readings that are far from those before and after: spikes of a converter or a link.

A reading is compared with the median of those around it. Motion takes longer than two samples, or
shakes its neighbours too; what stands alone is no motion, and neither cuts a rest nor enters its
mean. Steps of the output are no spikes. A row of zeros in both triads is no reading, on the move
either. What moves as fast as a spike hides it: there it counts as noise, which one reading among
thousands does not change.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.diagnose.rests import resolution
from foucault.errors import Finding, finding
from foucault.tables import AXES, IndexedLog, Log

AROUND = 20
"""So many samples before a reading and after it tell what it should be [1]."""

BLOCK = 32
"""Samples that tell how much readings scatter at rest [1]."""

FAR = 8.0
"""A spike is so many robust standard deviations off: no noise reaches it in a year [1]."""

STEPS = 4.0
"""And so many steps of the output, at least [1]."""

BACK = 3
"""Readings so many samples apart are compared first: more than a spike is long [1]."""

CALM = 3.0
"""Spikes are looked for where readings scatter by less than this much more than usual at rest: a
hand that turns an instrument or puts it down makes peaks of its own [1]."""

LONGEST = 2
"""Samples of a spike, at most; what lasts longer is motion [1]."""


L = TypeVar("L", bound=Log | IndexedLog)

Spike = tuple[float, float, str]
"""When it was [s], how far off it is [sd of the noise], and its axis."""


KNOCKS = 10
"""Where a log is integrated, more than so many are steps and knocks of a real motion [1]."""


def without_spikes(log: L, most: float = np.inf) -> L:
    """Return the log with spikes replaced by what is around them, and a finding that counts them.

    `log`: readings, rows that are means, and logs with missing readings, are left as they are
    [SI]; `most`: of more than so many they are steps and knocks of a real motion, and stay [1].
    """
    new, seen = spikes_of(log)
    if len(seen) > most:
        return log
    return replace(log, findings=(*log.findings, *told_of(seen)), **new) if seen else log


def spikes_of(log: Log | IndexedLog) -> tuple[dict[str, Any], list[Spike]]:
    """Return the triads that have spikes, without them, and the spikes.

    `log`: readings; of rows that are means, and of missing readings, nothing is said [SI].
    """
    new: dict[str, Any] = {}
    seen: list[Spike] = []
    if log.averaged is not None or len(log) < 2 * BLOCK:
        return new, seen
    lost = _lost(log)
    for name in ("gyro", "accel"):
        x = getattr(log, name)
        if x is None or not np.isfinite(x).all():
            continue
        columns = x.reshape(len(x), -1)
        sizes = spike_sizes(columns)
        bad = sizes.any(axis=1) | lost
        if not bad.any() or bad.all():
            continue
        good = np.flatnonzero(~bad)
        cleaned = columns.copy()
        for column in cleaned.T:
            column[bad] = np.interp(np.flatnonzero(bad), good, column[good])
        new[name] = cleaned.reshape(x.shape)
        if lost.any():
            sizes[lost] = np.maximum(sizes[lost], np.abs(cleaned[lost]) / _noise(columns))
        for row, k in zip(*np.nonzero(sizes), strict=True):
            axis = name if columns.shape[1] == 1 else f"{name}.{AXES[k]}"
            seen.append((float(log.time[row]), float(sizes[row, k]), axis))
    return new, seen


def _lost(log: Log | IndexedLog) -> BoolArray:
    """Tell rows of zeros in both triads, (n,): a reading that is lost, at rest and on the move."""
    if log.gyro is None or log.accel is None:
        return np.zeros(len(log), bool)
    empty = ~(
        log.gyro.reshape(len(log), -1).any(axis=1) | log.accel.reshape(len(log), -1).any(axis=1)
    )
    many = np.convolve(empty, np.ones(LONGEST + 1, int))[LONGEST:] > LONGEST
    return empty & ~np.convolve(many, np.ones(LONGEST + 1, int))[: len(log)].astype(bool)


def _noise(x: FloatArray) -> FloatArray:
    """Return the noise of some axes where it is quiet, (k,); `x` (n, k): readings [unit]."""
    return np.array([max(_quiet(np.abs(c[BACK:] - c[:-BACK])), 1e-9) for c in x.T])


def told_of(seen: list[Spike]) -> tuple[Finding, ...]:
    """Return the finding that counts and names spikes; none where there are none."""
    if not seen:
        return ()
    time = min(each[0] for each in seen)
    _, size, axis = max(each for each in seen if each[0] == time)
    return (finding(
        "log.spikes", count=len({each[0] for each in seen}), axis=axis, size=f"{size:.2g}",
        axes=", ".join(sorted({each[2] for each in seen})), time=f"{time:.9g}",
    ),)  # fmt: skip


def spike_sizes(x: FloatArray) -> FloatArray:
    """Return how far each reading is off if it is a spike, else 0, in sd of the noise, (n, k) [1].

    `x` (n, k): readings of some axes [unit].
    """
    out = np.zeros(x.shape)
    for i, column in enumerate(x.T):
        apart = column[BACK:] - column[:-BACK]
        step = max(resolution(column), 1e-9 * float(np.abs(column).max(initial=0.0)) / STEPS)
        least = STEPS * step
        quiet = _quiet(np.abs(apart))
        # A spike is far from what is before it and from what is after it, on the same side; at an
        # end of the log from one of them.
        after = np.append(-apart, np.zeros(BACK))
        before = np.append(after[:BACK], apart)
        after[-BACK:] = before[-BACK:]
        far = np.minimum(np.abs(before), np.abs(after)) > max(0.8 * FAR * quiet, least)
        rows = np.flatnonzero(far & (before * after > 0))
        around = np.pad(column, AROUND, mode="reflect")
        for some in np.array_split(rows, 1 + len(rows) // 100_000):
            out[some, i] = _sizes(around, some, quiet, step)
    return out


def _quiet(apart: FloatArray) -> float:
    """Return the standard deviation of the noise where it is quiet."""
    # Of a sensor that reads one value mostly, what is seldom is not seen in the median.
    count, at = len(apart) // BLOCK, round(0.9 * BLOCK)
    blocks = np.partition(apart[: count * BLOCK].reshape(count, BLOCK), at, axis=1)[:, at]
    seen = blocks[blocks > 0] / (1.645 * 2**0.5)  # a difference of two scatters by sqrt(2)
    return float(np.percentile(seen, 5)) if len(seen) else 0.0


def _sizes(around: FloatArray, rows: IntArray, quiet: float, step: float) -> FloatArray:
    """Judge some readings by what is around each; `around` is padded by `AROUND` on both sides."""
    near = around[rows[:, None] + np.arange(2 * AROUND + 1)]
    off = np.abs(near - np.median(near, axis=1)[:, None])
    at = round(0.9 * (2 * AROUND + 1))
    scale = np.partition(off, at, axis=1)[:, at] / 1.645
    # What is rounded to one step less was up to half a step more.
    limit = np.maximum(FAR * (scale + 0.5 * step / 1.645), STEPS * step)
    # It stands alone: what shakes the instrument shakes it for a while.
    lonely = (off > 0.5 * limit[:, None]).sum(axis=1) <= LONGEST
    spike = lonely & (off[:, AROUND] > limit) & (scale <= CALM * quiet)
    return np.where(spike, FAR * off[:, AROUND] / np.maximum(limit, 1e-300), 0.0)
