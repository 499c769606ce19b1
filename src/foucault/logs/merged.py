"""Files of one log, each sampled at instants of its own, brought to the instants of the slowest.

At an instant t of the slowest the others read the mean of their samples, joined by straight lines,
over its interval h about t::

    y(t) = (X(t + h/2) - X(t - h/2)) / h,    X(t) = int x dt

so that what gyros turn and what accelerometers gain is kept, and with it the density of white
noise. From one sample to the next that noise reads too small, as neighbours share samples: of k
samples in an interval the variance is 1 - 0.47/k of that of k samples of their own (k >= 2), 0.55
for k = 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.errors import Finding, error, finding
from foucault.logs.checks import timing
from foucault.tables import GAP, gaps, usual_step

GRIDS = ("gyro", "accel")
"""The slowest file that holds one of these gives the instants."""

NO_MEANS = ("outer", "middle", "inner", "table_rate", "position", "averaged")
"""Columns whose mean over an interval says nothing, as they jump."""


def on_one_clock(
    parts: Sequence[Mapping[str, FloatArray]], names: Sequence[str]
) -> tuple[dict[str, FloatArray], tuple[Finding, ...]]:
    """Bring the blocks of several files to the instants of the slowest; say what was done.

    `parts`: of each file its blocks by name, ``time`` among them, each shape (n,) or (n, 3) [SI];
    `names`: of the files.
    """
    odd = next((block for part in parts for block in part if block in NO_MEANS), None)
    if odd is not None:
        raise error("log.join_jumps", block=odd)
    for part in parts:
        timing(part["time"])  # raises where time runs backward
    steps = [usual_step(np.diff(part["time"])) for part in parts]
    able = [i for i, part in enumerate(parts) if set(GRIDS) & part.keys()]
    slow = max(able, key=lambda i: steps[i])
    grid, h = parts[slow]["time"], steps[slow]
    data, keep = dict(parts[slow]), np.ones(len(grid), bool)
    for part in parts:
        if part is parts[slow]:
            continue
        fine = within(grid, h, part["time"])
        keep &= fine
        for block, x in part.items():
            if block != "time":
                data[block] = means_at(grid, h, part["time"], x)
    if keep.sum() < 2:
        raise error("log.join_apart", files=", ".join(names))
    fast = min(step for i, step in enumerate(steps) if i != slow)
    told = finding(
        "log.joined", files=" and ".join(f"'{n}'" for n in names), first=names[slow],
        rate=f"{1 / h:.4g}", rows=int(keep.sum()),
        less=round(100 * (1 - smaller(h / fast))),
    )  # fmt: skip
    return {block: x[keep] for block, x in data.items()}, (told,)


def smaller(k: float) -> float:
    """Return by how much white noise reads too small from sample to sample [1].

    `k`: samples of a file in one interval of the slowest [1].
    """
    return float(np.sqrt(1.0 - min(0.45, 7 / 15 / k)))


def within(grid: FloatArray, h: float, time: FloatArray) -> BoolArray:
    """Tell which intervals `h` [s] about instants `grid` (n,) lie in `time` (m,) and in no gap."""
    step = np.diff(time)
    number = np.concatenate([[0], np.cumsum(gaps(step) & (step > GAP * h))])
    first = np.searchsorted(time, grid - h / 2, "right") - 1
    last = np.searchsorted(time, grid + h / 2, "left")
    inside = (first >= 0) & (last < len(time))
    first, last = np.clip(first, 0, None), np.clip(last, None, len(time) - 1)
    return np.asarray(inside & (number[first] == number[last]))


def means_at(grid: FloatArray, h: float, time: FloatArray, x: FloatArray) -> FloatArray:
    """Return the mean over `h` about each instant of samples joined by straight lines.

    `grid` (n,) and `time` (m,): instants of what is wanted and of the samples [s]; `h`: interval
    [s]; `x` (m,) or (m, k): samples. Shape (n,) or (n, k).
    """
    flat = x.reshape(len(x), -1)
    step = np.diff(time)[:, None]
    whole = np.zeros_like(flat, dtype=float)
    np.cumsum(0.5 * (flat[1:] + flat[:-1]) * step, axis=0, out=whole[1:])

    def integral(at: FloatArray) -> FloatArray:
        j = np.clip(np.searchsorted(time, at, "right") - 1, 0, len(time) - 2)
        u = (at - time[j])[:, None]
        return np.asarray(whole[j] + u * (flat[j] + 0.5 * u * (flat[j + 1] - flat[j]) / step[j]))

    out = (integral(grid + h / 2) - integral(grid - h / 2)) / h
    return np.asarray(out.reshape(len(grid), *x.shape[1:]))
