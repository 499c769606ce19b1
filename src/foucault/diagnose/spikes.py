"""Single readings that are far from those before and after: spikes of a converter or a link.

A reading is compared with the median of those around it. Motion takes longer than two samples, or
shakes its neighbours too; what stands alone is no motion, and neither cuts a rest nor enters its
mean. Steps of the output are no spikes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from foucault.diagnose.rests import resolution
from foucault.errors import finding
from foucault.tables import AXES, FloatArray, IndexedLog, IntArray, Log

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


L = TypeVar("L", Log, IndexedLog)


def without_spikes(log: L) -> L:
    """Return the log with spikes replaced by what is around them, and a finding that counts them.

    Parameters
    ----------
    log : Log or IndexedLog
        Readings; rows that are means, and logs with missing readings, are left as they are [SI].
    """
    if log.averaged is not None or len(log) < 2 * BLOCK:
        return log
    new: dict[str, Any] = {}
    seen: list[tuple[int, float, str]] = []
    for name in ("gyro", "accel"):
        x = getattr(log, name)
        if x is None or not np.isfinite(x).all():
            continue
        columns = x.reshape(len(x), -1)
        sizes = spike_sizes(columns)
        bad = sizes.any(axis=1)
        if not bad.any():
            continue
        good = np.flatnonzero(~bad)
        cleaned = columns.copy()
        for column in cleaned.T:
            column[bad] = np.interp(np.flatnonzero(bad), good, column[good])
        new[name] = cleaned.reshape(x.shape)
        for row, k in zip(*np.nonzero(sizes), strict=True):
            axis = name if columns.shape[1] == 1 else f"{name}.{AXES[k]}"
            seen.append((int(row), float(sizes[row, k]), axis))
    if not seen:
        return log
    row = min(each[0] for each in seen)
    _, size, axis = max(each for each in seen if each[0] == row)
    told = finding(
        "log.spikes", count=len({each[0] for each in seen}), axis=axis, size=f"{size:.2g}",
        axes=", ".join(sorted({each[2] for each in seen})), time=f"{log.time[row]:.9g}",
    )  # fmt: skip
    return replace(log, findings=(*log.findings, told), **new)


def spike_sizes(x: FloatArray) -> FloatArray:
    """Return how far each reading is off if it is a spike, else 0, in sd of the noise, (n, k) [1].

    Parameters
    ----------
    x : ndarray, shape (n, k)
        Readings of some axes [unit].
    """
    out = np.zeros(x.shape)
    for i, column in enumerate(x.T):
        apart = column[BACK:] - column[:-BACK]
        least = np.maximum(STEPS * resolution(column), 1e-9 * np.abs(column).max(initial=0.0))
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
            out[some, i] = _sizes(around, some, quiet, least)
    return out


def _quiet(apart: FloatArray) -> float:
    """Return the standard deviation of the noise where it is quiet."""
    # Of a sensor that reads one value mostly, what is seldom is not seen in the median.
    count, at = len(apart) // BLOCK, round(0.9 * BLOCK)
    blocks = np.partition(apart[: count * BLOCK].reshape(count, BLOCK), at, axis=1)[:, at]
    seen = blocks[blocks > 0] / (1.645 * 2**0.5)  # a difference of two scatters by sqrt(2)
    return float(np.percentile(seen, 5)) if len(seen) else 0.0


def _sizes(around: FloatArray, rows: IntArray, quiet: float, least: float) -> FloatArray:
    """Judge some readings by what is around each; `around` is padded by `AROUND` on both sides."""
    near = around[rows[:, None] + np.arange(2 * AROUND + 1)]
    off = np.abs(near - np.median(near, axis=1)[:, None])
    at = round(0.9 * (2 * AROUND + 1))
    scale = np.partition(off, at, axis=1)[:, at] / 1.645
    limit = np.maximum(FAR * scale, least)
    # It stands alone: what shakes the instrument shakes it for a while.
    lonely = (off > 0.5 * limit[:, None]).sum(axis=1) <= LONGEST
    spike = lonely & (off[:, AROUND] > limit) & (scale <= CALM * quiet)
    return np.where(spike, FAR * off[:, AROUND] / np.maximum(limit, 1e-300), 0.0)
