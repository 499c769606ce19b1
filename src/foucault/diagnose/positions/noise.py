"""The noise of means over rests and spins, measured where they were taken.

As `diagnose.rests.measure_noise` does it: neighbouring cells give the noise of short means, the
quarters of a rest that of long ones, and steps of the output that the noise does not blur give a
constant error. It is the same wherever the signal is the same, and gyros at rest read their bias
every time. An error of variance v that m readings share is no more than independent errors of
variance m v, in every combination of them: that is what they are given here, so that averaging
does not pretend to know more than one rounding tells. A spin has its own noise, for the table is
not perfectly even; the harmonics of the outer angle, which average out over whole turns, are
removed first. Increments carry their rounding on: it is told from white noise by the spectrum of
the cells (`diagnose.carried`), and falls with the square of the time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.carried import white_and_carried
from foucault.diagnose.positions.cells import Reduced, held
from foucault.diagnose.positions.stretches import Stretch
from foucault.diagnose.positions.turns import Window
from foucault.diagnose.rests import Rests, measure_noise, resolution
from foucault.tables import Log

HARMONICS = 2
"""Harmonics of the outer angle that are removed from a spin [1]."""

KEPT = 500
"""Samples of each reading that are looked at for rounding [1]."""

THINNED = 40_000
"""Most samples of the whole log that are looked at for the steps of the output [1]."""

PARTS = 8
"""So many steps at most lie between the two values of an axis that are nearest each other [1]."""

LEAST = 1e-24
"""Least variance of a mean [SI]."""


@dataclass
class Glimpses:
    """The first samples of each reading, and some of the whole log, kept while it passes by."""

    windows: list[Window]
    kept: list[list[Log]] = field(default_factory=list)  # of each the first samples
    some: list[Log] = field(default_factory=list)  # samples of the whole log, thinned
    # every, rows: of how many samples one is kept in `some`, and how many have passed by [1]
    every: int = 1
    rows: int = 0

    def __post_init__(self) -> None:
        self.kept = [[] for _ in self.windows]

    def see(self, log: Log) -> None:
        """Keep what is wanted of a block."""
        for window, kept in zip(self.windows, self.kept, strict=True):
            more = KEPT - sum(len(part) for part in kept)
            i, j = (int(k) for k in np.searchsorted(log.time, [window.start, window.end]))
            if more > 0 and j > i:
                kept.append(held(log[i : min(j, i + more)]))
        self.some.append(held(_every(log, self.every, -self.rows % self.every)))
        self.rows += len(log)
        while sum(len(part) for part in self.some) > THINNED:
            self.some = _halved(self.some)
            self.every *= 2

    def steps(self, name: str) -> FloatArray:
        """Return the steps of the output, 0 where it is not rounded, shape (3,) [unit].

        A coarse axis does not move at rest; only with the moves and spins does it show its steps.
        """
        if not self.some:
            return np.zeros(3)
        x = np.concatenate([getattr(part, name) for part in self.some])
        return np.array([lattice(x[:, i]) for i in range(3)])

    def rounding(
        self, name: str, which: list[int], interval: float, increments: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return what rounding leaves in some readings.

        `which`: numbers of the readings [1]; `interval`: sample interval [s]; `increments`:
        whether rows are means over the interval before their time. Returns `rounding` (3,): its
        constant error, sd [unit]; `carried` (3,): variance of what goes on to the next sample
        [unit^2 s^2].
        """
        x = [
            np.concatenate([getattr(p, name) for p in self.kept[k]]) for k in which if self.kept[k]
        ]
        if not x:
            return np.zeros(3), np.zeros(3)
        last = np.cumsum([len(part) for part in x])
        none = np.empty(0)
        rests = Rests(last - [len(p) for p in x], last, none, none, none, np.nan, 1)
        steps = self.steps(name)
        found = measure_noise(np.concatenate(x), interval, rests, steps, increments=increments)
        return found.rounding, found.carried

    def shared(self, name: str) -> FloatArray:
        """Return with how many readings each shares its rounding, itself included, (n, 3) [1].

        Signals within a step of each other count as the same.
        """
        steps, n = self.steps(name), len(self.kept)
        out = np.full((n, 3), float(n))
        seen = [k for k in range(n) if self.kept[k]]
        if not seen:
            return out
        means = np.array(
            [np.concatenate([getattr(p, name) for p in self.kept[k]]).mean(axis=0) for k in seen]
        )
        for i in range(3):
            x, near = np.sort(means[:, i]), 0.99 * steps[i]
            above = np.searchsorted(x, means[:, i] + near, side="right")
            out[seen, i] = above - np.searchsorted(x, means[:, i] - near, side="left")
        return np.asarray(np.maximum(out, 1.0))


def lattice(x: FloatArray) -> float:
    """Return the step of a rounded signal [unit], 0 where its values are not whole steps apart.

    `x` (n,): readings of one axis, thinned beforehand [unit].
    """
    least = resolution(x, most=len(x) or 1)
    if least == 0:
        return 0.0
    apart = np.diff(np.unique(x))
    apart = apart[(apart > 0.5 * least) & (apart < 50 * least)]  # written digits may end too early
    for part in range(1, PARTS + 1):  # values seldom met may be several steps apart at least
        steps = apart / (least / part)
        if np.mean(np.abs(steps - np.round(steps)) < 0.1) > 0.8:
            return least / part
    return 0.0


def _every(log: Log, step: int, first: int) -> Log:
    def thin(x: FloatArray | None) -> FloatArray | None:
        return None if x is None else x[first::step]

    return Log(log.time[first::step], thin(log.gyro), thin(log.accel), log.sampled)


def _halved(parts: list[Log]) -> list[Log]:
    out, rows = [], 0
    for part in parts:
        out.append(held(_every(part, 2, rows % 2)))
        rows += len(part)
    return out


def covariance(
    name: str, data: Reduced, runs: list[Stretch], windows: list[Window], seen: Glimpses
) -> FloatArray:
    """Return the covariance of the mean of one triad in each reading, shape (n, 3, 3) [SI]."""
    out = np.zeros((len(runs), 3))
    spins = [k for k, window in enumerate(windows) if window.rate != 0]
    rests = [k for k, window in enumerate(windows) if window.rate == 0]
    kinds = [which for which in (rests, spins) if which]
    rounding = [seen.rounding(name, w, data.interval, data.increments) for w in kinds]
    measured = [
        _power(name, data, [runs[k] for k in w], [windows[k] for k in w], carried)
        for w, (_, carried) in zip(kinds, rounding, strict=True)
    ]
    shared = seen.shared(name)
    for i, which in enumerate(kinds):
        power, ends, freedom = measured[i]
        if freedom < 10 and len(measured) == 2 and measured[1 - i][2] > freedom:
            power, ends, _ = measured[1 - i]
        time = np.array([windows[k].end - windows[k].start for k in which])[:, None]
        out[which] = power / time + 2 * ends / time**2 + rounding[i][0] ** 2 * shared[which]
    return np.maximum(out, LEAST)[:, :, None] * np.eye(3)


def _power(
    name: str, data: Reduced, runs: list[Stretch], windows: list[Window], carried: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Return the power of the noise of means [unit^2 s], what their ends add, and how sure it is.

    The first two have shape (3,); the second is the variance of carried rounding [unit^2 s^2],
    at least what the samples show of it, the third a number of degrees of freedom.
    """
    from scipy.special import fdtri

    cells, parts = data.cells, []
    x = getattr(cells, name)
    length = cells.end - cells.start
    fast, slow, fast_n, slow_n, ends = np.zeros(3), np.zeros(3), 0, 0, 0.0
    time = 1.0
    for run, window in zip(runs, windows, strict=True):
        part = slice(run.first, run.last)
        time = float(np.median(length[part]))
        full = length[part] > 0.75 * time  # a cell cut short by a label has more noise
        middle = 0.5 * (cells.start + cells.end)[part][full]
        rest = _without_harmonics(x[part][full], window.rate * middle)
        fast += (np.diff(rest, axis=0) ** 2).sum(axis=0) / 2 * time
        fast_n += len(rest) - 1
        parts.append(rest)
        quarter = len(rest) // 4
        if quarter > 1:
            quarters = rest[: 4 * quarter].reshape(4, quarter, 3).mean(axis=1)
            slow += quarters.var(axis=0) * 4 * quarter * time
            slow_n += 3
            ends += 7.5 / (quarter * time)  # as `diagnose.rests.measure_noise` has it
    power = fast / max(fast_n, 1)
    if data.increments:
        power, seen = white_and_carried(parts, time)
        carried = np.maximum(carried, seen)
    if slow_n:
        limit = fdtri(slow_n, max(fast_n, 1), 0.99)
        measured, known = slow / slow_n, carried * ends / slow_n
        power = np.where(measured > limit * (power + known), measured - known, power)
    return power, carried, fast_n


def _without_harmonics(x: FloatArray, angle: FloatArray) -> FloatArray:
    if angle[0] == angle[-1] or len(x) < 4 * (2 * HARMONICS + 1):
        return x
    k = np.arange(1, HARMONICS + 1)
    angle = angle - angle[0]
    A = np.column_stack([np.ones(len(x)), np.cos(np.outer(angle, k)), np.sin(np.outer(angle, k))])
    return np.asarray(x - A @ np.linalg.lstsq(A, x, rcond=None)[0])
