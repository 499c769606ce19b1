"""Means of a log between any two times, its blocks passing by once.

A rate log is taken to run straight from sample to sample (trapezoids), an increment log to be
constant over the interval before each sample; the first and the last sample of a mean count with
the part of them that lies inside. So a mean covers exactly the time that is asked for, and whole
turns are whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.positions.cells import Source, held, longest_step
from foucault.tables import Log


def means(
    source: Source,
    windows: FloatArray,
    interval: float,
    see: Callable[[Log], None] = lambda log: None,
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the means of accelerometers and gyros over some windows, each shape (m, 3) [SI].

    `source`: gives the blocks of the log [SI]; `windows` (m, 2): first and last time of each [s];
    `interval`: sample interval of the log [s]; `see`: is shown each block as it passes by.
    """
    sums: dict[str, FloatArray] = {}
    covered = np.zeros(len(windows))
    for time, triads in _pieces(source, interval, see):
        inside = np.clip(windows, time[0], time[-1])
        some = inside[:, 1] > inside[:, 0]
        covered += inside[:, 1] - inside[:, 0]
        for name, (left, right) in triads.items():
            total = sums.setdefault(name, np.zeros((len(windows), 3)))
            if some.any():
                total[some] += _integral(time, left, right, inside[some])
    out = [sums[name] / covered[:, None] if name in sums else None for name in ("accel", "gyro")]
    return out[0], out[1]


Piece = tuple[FloatArray, dict[str, tuple[FloatArray, FloatArray]]]
"""Times, and by triad the values at the beginning and at the end of the intervals between them."""


def _pieces(source: Source, interval: float, see: Callable[[Log], None]) -> Iterator[Piece]:
    before: Log | None = None
    for log in source():
        see(log)
        yield _piece(before, log, interval)
        before = held(log[len(log) - 1 :])
    if before is not None and before.sampled == "rate":
        # The last sample stands for half an interval more, as the first one does.
        time = before.time[-1] + np.array([0.0, 0.5 * interval])
        yield time, {name: (x, x) for name, x in _triads(before).items()}


def _triads(log: Log) -> dict[str, FloatArray]:
    both = {"accel": log.accel, "gyro": log.gyro}
    return {name: x for name, x in both.items() if x is not None}


def _piece(before: Log | None, log: Log, interval: float) -> Piece:
    increments = log.sampled == "increment"
    ahead = interval if increments else 0.5 * interval
    first = log.time[0] - ahead if before is None else before.time[-1]
    time = np.concatenate([[first], log.time])
    hole = np.flatnonzero(np.diff(time) > longest_step(interval))
    foreign = np.empty(0, np.intp) if increments else np.setdiff1d(_foreign(before, log), hole)
    middle = 0.5 * (time[foreign] + time[foreign + 1])
    # Beside missing samples each sample stands for its own interval only, and nothing for the rest.
    reach = np.empty(0) if increments else time[hole] + ahead
    at = np.concatenate([foreign, hole, hole[: len(reach)]])
    cuts = np.concatenate([middle, time[hole + 1] - ahead, reach])
    order = np.lexsort((cuts, at))
    at, cuts = at[order], cuts[order]
    triads = {}
    for name, x in _triads(log).items():
        previous = x[:1] if before is None else _triads(before)[name]
        left = x if increments else np.concatenate([previous, x[:-1]])
        # Between two positions each sample stands for its half of the interval.
        triads[name] = _held_apart(left, x, at)
    return np.insert(time, at + 1, cuts), triads


def _held_apart(left: FloatArray, right: FloatArray, at: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return values at the beginning and end of intervals, those in `at` cut into parts.

    In the first part the value is that of the left end, in the last that of the right end.
    """
    after = np.flatnonzero(np.diff(at, append=-1))  # the last cut of each interval
    begin, end = np.insert(left, at + 1, left[at], axis=0), np.insert(right, at, left[at], axis=0)
    last = at[after] + after + 1  # the part behind it
    begin[last] = right[at[after]]
    return begin, end


def _foreign(before: Log | None, log: Log) -> npt.NDArray[np.intp]:
    """Return the intervals that begin in one numbered position and end in another."""
    if log.table is None or log.table.position is None:
        return np.empty(0, np.intp)
    label = log.table.position
    old = label[:1] if before is None or before.table is None else before.table.position
    assert old is not None
    return np.flatnonzero(np.diff(label, prepend=old[-1:]))


def _integral(
    time: FloatArray, left: FloatArray, right: FloatArray, windows: FloatArray
) -> FloatArray:
    """Integrate over windows inside `time`; straight lines from `left` to `right`."""
    step = np.diff(time)
    total = np.zeros((len(time), 3))
    np.cumsum(0.5 * (left + right) * step[:, None], axis=0, out=total[1:])
    i = np.clip(np.searchsorted(time, windows, side="right") - 1, 0, len(step) - 1)
    s = (windows - time[i])[..., None]
    h = step[i][..., None]
    at = total[i] + left[i] * s + (right[i] - left[i]) * s**2 / (2 * h)
    return np.asarray(at[:, 1] - at[:, 0])
