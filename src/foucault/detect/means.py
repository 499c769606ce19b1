"""Means of a log between any two times, its blocks passing by once, and their noise.

A rate log is taken to run straight from sample to sample (trapezoids), an increment log to be
constant over the interval before each sample; the first and the last sample of a mean count with
the part of them that lies inside. So a mean covers exactly the time that is asked for, and whole
turns are whole.

Noise is measured where the means were taken (as `noise.measure_noise` does it): neighbouring cells
give the noise of short means, the quarters of a rest that of long ones, and steps of the output
that the noise does not blur give a constant error. It is the same wherever the signal is the same,
and gyros at rest read their bias every time. An error of variance v that m readings share is no
more than independent errors of variance m v, in every combination of them: that is what they are
given here, so that averaging does not pretend to know more than one rounding tells. A spin has its
own noise, for the table is not perfectly even; the harmonics of the outer angle, which average out
over whole turns, are removed first. Increments carry their rounding on: it is told from white noise
by the spectrum of the cells, and falls with the square of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray, IndexArray, IntArray
from foucault.detect.cells import Reduced, Source, held, longest_step
from foucault.detect.noise import (
    measure_noise,
    power_of_means,
    successive,
    white_and_carried,
)
from foucault.detect.spins import Window
from foucault.detect.stretches import Rests
from foucault.detect.table import Stretch
from foucault.tables import Log

HARMONICS = 2  # Harmonics of the outer angle that are removed from a spin [1].
KEPT = 500  # Samples of each reading that are looked at for rounding [1].
LEAST = 1e-24  # Least variance of a mean [SI].


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


def _foreign(before: Log | None, log: Log) -> IndexArray:
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


# -- noise -----------------------------------------------------------------------------------------


@dataclass
class Glimpses:
    """The first samples of each reading, kept while the log passes by."""

    windows: list[Window]
    kept: list[list[Log]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.kept = [[] for _ in self.windows]

    def see(self, log: Log) -> None:
        """Keep what is wanted of a block."""
        for window, kept in zip(self.windows, self.kept, strict=True):
            more = KEPT - sum(len(part) for part in kept)
            i, j = (int(k) for k in np.searchsorted(log.time, [window.start, window.end]))
            if more > 0 and j > i:
                kept.append(held(log[i : min(j, i + more)]))

    def samples(self, name: str, k: int) -> FloatArray:
        """Return the first samples of reading `k` [1], (n, 3) [SI]."""
        return np.concatenate([getattr(part, name) for part in self.kept[k]])

    def shared(self, name: str, steps: FloatArray) -> FloatArray:
        """Return with how many readings each shares its rounding, itself included, (n, 3) [1].

        Signals within a step, `steps` (3,), of each other count as the same.
        """
        n = len(self.kept)
        out = np.full((n, 3), float(n))
        seen = [k for k in range(n) if self.kept[k]]
        if not seen:
            return out
        means = np.array([self.samples(name, k).mean(axis=0) for k in seen])
        for i in range(3):
            x, near = np.sort(means[:, i]), 0.99 * steps[i]
            above = np.searchsorted(x, means[:, i] + near, side="right")
            out[seen, i] = above - np.searchsorted(x, means[:, i] - near, side="left")
        return np.asarray(np.maximum(out, 1.0))


def covariance(
    name: str, data: Reduced, runs: list[Stretch], windows: list[Window], seen: Glimpses
) -> FloatArray:
    """Return the covariance of the mean of one triad in each reading, shape (n, 3, 3) [SI]."""
    out = np.zeros((len(runs), 3))
    spins = [k for k, window in enumerate(windows) if window.rate != 0]
    rests = [k for k, window in enumerate(windows) if window.rate == 0]
    steps = data.steps(name)
    kinds = [which for which in (rests, spins) if which]
    measured = []
    for which in kinds:
        rounding, carried = np.zeros((2, 3))
        x = [seen.samples(name, k) for k in which if seen.kept[k]]
        if x:
            last = np.cumsum([len(part) for part in x])
            found = measure_noise(
                np.concatenate(x), data.interval, Rests(last - [len(p) for p in x], last), steps,
                increments=data.increments,
            )  # fmt: skip
            rounding, carried = found.rounding, found.carried
        some = [(runs[k], windows[k]) for k in which]
        measured.append((rounding, *_power(name, data, some, carried)))
    shared = seen.shared(name, steps)
    for i, which in enumerate(kinds):
        rounding, power, ends, freedom = measured[i]
        if freedom < 10 and len(measured) == 2 and measured[1 - i][3] > freedom:
            _, power, ends, _ = measured[1 - i]
        time = np.array([windows[k].end - windows[k].start for k in which])[:, None]
        out[which] = power / time + 2 * ends / time**2 + rounding**2 * shared[which]
    return np.maximum(out, LEAST)[:, :, None] * np.eye(3)


def _power(
    name: str, data: Reduced, some: list[tuple[Stretch, Window]], carried: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Return the power of the noise of means [unit^2 s], what their ends add, and how sure it is.

    The first two have shape (3,); the second is the variance of carried rounding [unit^2 s^2],
    at least what the samples show of it, the third a number of degrees of freedom.
    """
    cells, parts, quarters = data.cells, [], []
    length = cells.end - cells.start
    fast, freedom, time = np.zeros(3), 0, 1.0
    for run, window in some:
        part = run.cells
        time = float(np.median(length[part]))
        full = length[part] > 0.75 * time  # a cell cut short by a label has more noise
        middle = 0.5 * (cells.start + cells.end)[part][full]
        rest = _without_harmonics(getattr(cells, name)[part][full], window.rate * middle)
        psd, count = successive([rest], time)
        fast, freedom = fast + psd * count, freedom + count
        parts.append(rest)
        quarter = len(rest) // 4
        if quarter > 1:
            means = rest[: 4 * quarter].reshape(4, quarter, 3).mean(axis=1)
            quarters.append((means, quarter * time))
    power = fast / max(freedom, 1)
    if data.increments:
        power, seen = white_and_carried(parts, time)
        carried = np.maximum(carried, seen)
    return power_of_means(power, freedom, carried, quarters), carried, freedom


def _without_harmonics(x: FloatArray, angle: FloatArray) -> FloatArray:
    if angle[0] == angle[-1] or len(x) < 4 * (2 * HARMONICS + 1):
        return x
    k = np.arange(1, HARMONICS + 1)
    angle = angle - angle[0]
    A = np.column_stack([np.ones(len(x)), np.cos(np.outer(angle, k)), np.sin(np.outer(angle, k))])
    return np.asarray(x - A @ np.linalg.lstsq(A, x, rcond=None)[0])
