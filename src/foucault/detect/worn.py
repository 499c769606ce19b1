"""The rests of an accelerometer that was worn for days, found block by block.

What is kept of the log are windows of ten seconds: mean and scatter. Windows as quiet as a rest,
one after the other and in one attitude, are one rest [1]_. A night has thousands of rests in few
attitudes, which say nothing new: of each attitude the longest few are kept.

References
----------
.. [1] V. T. van Hees et al., "Autocalibration of accelerometer data for free-living physical
   activity assessment using local gravity and temperature: an evaluation on four continents",
   Journal of Applied Physiology 117 (2014) 738-744.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.stretches import HAND, level_of, limit_of, quiet_sd
from foucault.errors import Finding, error
from foucault.logs import follow
from foucault.logs.follow import OnDisk
from foucault.tables import Log

WINDOW = 10.0  # Length of a window [s].

LOUD = 0.03
"""Scatter of the three axes together, over gravity, that no rest has: 17 mg of each [1]."""

CONE = np.radians(30.0)
"""Rests whose directions of up all lie within this of their mean tell no bias from scale [rad]."""

STILL = 0.02  # Windows of one rest differ by less than this part of gravity from its first [1].
CELL = 0.15  # Directions of up within about this are one attitude [rad].
OF_A_CELL, MOST = 3, 400  # Rests that are kept of one attitude, and of all, the longest [1].


def rests(log: OnDisk, progress: Callable[[float], None] | None = None) -> Log:
    """Return the rests of a long log of accelerometers alone as a log of means.

    `log`: it is read once and never held as a whole; `progress` or None: called with the fraction
    done. Returns one row per rest: beginning and length [s], mean specific force [m/s^2]. Raises
    ``session.no_accel``; ``worn.no_rest``, ``worn.never_turned``: nothing can be told from it.
    """
    found: list[tuple[Finding, ...]] = [log.findings]

    def seen() -> Iterable[Log]:
        for block in follow.blocks(log.description, log.folder, progress):
            found.append(block.findings)
            yield block

    start, mean, sd = _windows(seen())
    level = level_of(sd, quiet_sd(sd))
    quiet = (level < limit_of(level, HAND)) & (sd < LOUD * np.median(np.linalg.norm(mean, axis=1)))
    if not quiet.any():
        raise error("worn.no_rest", window=f"{WINDOW:g} s")
    first, count = _in_one_attitude(start, mean, quiet)
    # By sums from one end: a mean of a night costs as much as that of ten seconds.
    total = np.concatenate((np.zeros((1, 3)), np.cumsum(mean, axis=0)))
    means = (total[first + count] - total[first]) / count[:, None]
    up = means / np.linalg.norm(means, axis=1, keepdims=True)
    middle = up.mean(axis=0) / max(float(np.linalg.norm(up.mean(axis=0))), 1e-9)
    widest = float(np.arccos(np.clip(np.min(up @ middle), -1.0, 1.0)))
    if widest < CONE:
        angle = f"{max(1, round(np.degrees(widest)))} deg"
        raise error("worn.never_turned", count=len(first), angle=angle)
    kept = _of_each_attitude(up, count)
    first, count = first[kept], count[kept]
    return Log(
        start[first], None, means[kept], averaged=np.asarray(count * WINDOW, float),
        findings=follow.merged(found), source=log.source, clock=log.clock,
    )  # fmt: skip


def _windows(blocks: Iterable[Log]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the beginning of each window (m,), its mean (m, 3) and its scatter (m,) [SI]."""
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    time, accel, size = np.empty(0), np.empty((0, 3)), 0
    for block in blocks:
        if block.accel is None:
            raise error("session.no_accel")
        size = size or max(2, round(WINDOW * block.rate))
        time = np.concatenate((time, block.time))
        accel = np.concatenate((accel, block.accel))
        k = len(time) // size
        t, x = time[: k * size].reshape(k, size), accel[: k * size].reshape(k, size, 3)
        time, accel = time[k * size :], accel[k * size :]
        mean = np.full(size, 1.0 / size) @ x
        square = np.einsum("kij,kij->k", x, x) / size - np.einsum("kj,kj->k", mean, mean)
        # A window in which samples are missing stands for more time than it holds.
        whole = t[:, -1] - t[:, 0] < 1.5 * WINDOW
        parts.append((t[whole, 0], mean[whole], np.sqrt(np.maximum(square, 0.0))[whole]))
    start, mean, sd = (np.concatenate(x) for x in zip(*parts, strict=True))
    return start, mean, sd


def _in_one_attitude(
    start: FloatArray, mean: FloatArray, quiet: BoolArray
) -> tuple[IntArray, IntArray]:
    """Return the first window of each rest and how many it has, (k,) [1]."""
    follows = np.append(False, np.diff(start) < 1.5 * WINDOW) & quiet
    size = float(np.median(np.linalg.norm(mean, axis=1)))
    first, count = list[int](), list[int]()
    for i in np.flatnonzero(quiet).tolist():
        going_on = count and first[-1] + count[-1] == i and follows[i]
        if going_on and np.abs(mean[i] - mean[first[-1]]).max() < STILL * size:
            count[-1] += 1
        else:
            first.append(i)
            count.append(1)
    return np.array(first, np.int64), np.array(count, np.int64)


def _of_each_attitude(up: FloatArray, count: IntArray) -> IntArray:
    """Return which rests are kept, (k,), in their order [1]."""
    order = np.argsort(-count, kind="stable")  # the longest first
    _, cell = np.unique(np.round(up[order] / CELL), axis=0, return_inverse=True)
    taken = np.zeros(int(cell.max()) + 1, np.int64)
    kept: list[int] = []
    for i, c in zip(order.tolist(), np.ravel(cell).tolist(), strict=True):
        taken[c] += 1
        if taken[c] <= OF_A_CELL and len(kept) < MOST:
            kept.append(i)
    return np.array(sorted(kept), np.int64)
