"""The time offset of two instruments on one body, by what they turned.

First where, then how much. All turns of the master are compared with those of the slave for every
offset of a bracket at once, by correlation; the mounting that fits best at each offset is that of
Wahba's problem, or the one that is known. From the best offset, and from others that fit nearly as
well, `estimate.delay.matching` goes on to the last digit. Turns that no body makes, such as those
of a heading that was averaged across its wrap, are left out; a clock that goes faster than the
other shows as a delay that grows, and is followed.

What bends between the two in time with the motion, as a mount does that lags, cannot be told from a
delay by any method that looks at both instruments only.

References
----------
.. [1] F. L. Markley, "Attitude Determination Using Vector Observations and the Singular Value
   Decomposition", J. Astronaut. Sci. 36, 1988, p. 245-258.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.estimate.delay import offsets
from foucault.estimate.delay.matching import (
    BIAS,
    MU,
    TAU,
    Match,
    covariance,
    match,
    residual_step,
    weigh,
    whitened,
)
from foucault.estimate.delay.turned import SlaveAttitude, Turns, inside, turns_of
from foucault.navigate.increments import Increments

BRACKET = (-1.0, 1.0)
"""Where an offset is looked for if nothing is said [s]."""

SEEN = 0.01
"""A delay with a larger standard deviation is not seen [s]."""

UNLIKE = 0.5
"""A slave whose turning has less in common with the master is on another body [1]."""

FEWEST = 20
"""So few intervals do not show an offset [1]."""

LONG = 5.0
"""Intervals that are so many times the usual are not used [1]."""

WILD = 10.0
"""Residuals that are so many times the usual are not of this noise [1]."""

WILD_TURN = 0.5
"""And so large a part of what the slave turned [1]."""

WILD_PART = 0.05
"""At most this part of the intervals is left out for that [1]."""

PARTS = 4
"""The delay is shown in so many parts of the log [1]."""

DRIFTS = 4.0
"""A drift of so many standard deviations is followed [1]."""

DRIFT_STEPS = 5
"""In at most so many steps [1]."""

OTHER_UNIT = 0.25
"""A ratio of sizes whose logarithm is larger is taken out before all else [1]."""

RIVAL = 1.5
"""An offset whose squared residuals are at most so many times the best is a rival [1]."""


@dataclass(frozen=True)
class Delay:
    """The time offset of two instruments on one body. It and its drift hold at `middle`."""

    match: Match  # what matching has found, the drift of the clocks taken out [SI]
    turns: Turns  # what the master turned, by its own stamps
    C_ms: FloatArray  # (3, 3) the mounting, slave to master [1]
    middle: float  # when the delay is known best, by the master's stamps [s]
    # drift, drift_sd: growth of the delay: how much the clock of the stamps is fast; 0 where it is
    # not seen [1]
    drift: float
    drift_sd: float
    # part_start, part_end: (p,) parts of the log, by the master's stamps [s]
    part_start: FloatArray
    part_end: FloatArray
    part_delay: FloatArray  # (p,) delay in the middle of each [s]
    part_cov: FloatArray  # (p, p) its covariance [s^2]
    bracket: tuple[float, float]  # where it was looked for [s]
    edge: bool  # whether the best is at an end of that
    rivals: FloatArray  # (r,) other offsets that fit nearly as well [s]
    wild: BoolArray  # (k,) turns of the master that no body makes
    # part of the slave's turning that the master has too, whatever its size, as a variance [1]
    likeness: float
    # scale, scale_sd: how many times as much the slave turns [1]
    scale: float
    scale_sd: float

    @property
    def delay(self) -> float:
        """The delay: what is stamped t was true at t - delay on the slave's clock [s]."""
        return self.match.delay

    @cached_property
    def delay_sd(self) -> float:
        """Its standard deviation [s]."""
        return float(np.sqrt(self.match.cov[TAU, TAU]))

    @property
    def seen(self) -> bool:
        """Whether the motion shows a delay at all."""
        known = self.match.converged and self.delay_sd <= SEEN
        return bool(known and self.likeness >= UNLIKE)

    @property
    def mu_cov(self) -> FloatArray:
        """Covariance of the mounting as a rotation vector, frame s, shape (3, 3) [rad^2]."""
        return self.match.cov[MU, MU]

    @property
    def bias(self) -> FloatArray:
        """Bias of the slave's gyros less that of the master, frame s, shape (3,) [rad/s]."""
        return self.match.x[BIAS]

    @property
    def bias_cov(self) -> FloatArray:
        """Its covariance, shape (3, 3) [rad^2/s^2]."""
        return self.match.cov[BIAS, BIAS]

    def later(self, time: float) -> Delay:
        """Return the same by clocks that show more by `time`, shape () [s]."""
        turns = replace(self.turns, start=self.turns.start + time, end=self.turns.end + time)
        begin, end = self.part_start + time, self.part_end + time
        return replace(self, turns=turns, middle=self.middle + time, part_start=begin, part_end=end)


def delay_of(
    increments: Increments,
    time: FloatArray,
    C_nb: FloatArray,
    *,
    w_in_n: FloatArray | None = None,
    C_ms: FloatArray | None = None,
    bracket: tuple[float, float] | None = BRACKET,
) -> Delay | None:
    """Find the offset of a slave's clock from the stamps of a master.

    `increments`: what the slave's gyros added up [SI]; `time` (k,): stamps of the master, rising
    [s]; `C_nb` (k, 3, 3): its attitude, NaN where it is not known [1]; `w_in_n` (k, 3): rate of
    frame n, of Earth and transport [rad/s], None where n does not turn; `C_ms` (3, 3): how the
    slave is mounted, to within some 10 deg, None where nobody knows; `bracket`: where the delay
    lies [s], None for as far as the logs overlap at all. Returns None where fewer than `FEWEST`
    intervals are common to both. Whether the delay is seen, it says itself.
    """
    # A clock that counts from 1970 is good to 0.2 us only, too coarse for the iteration to settle.
    start = float(increments.time[0])
    found = _delay_of(replace(increments, time=increments.time - start), time - start, C_nb, w_in_n,
                      C_ms, bracket)  # fmt: skip
    return found and found.later(start)


def _delay_of(
    increments: Increments, time: FloatArray, C_nb: FloatArray, w_in_n: FloatArray | None,
    C_ms: FloatArray | None, bracket: tuple[float, float] | None,
) -> Delay | None:  # fmt: skip
    """Find the offset by a clock that begins near zero."""
    turns = turns_of(time, C_nb, w_in_n)
    slave = SlaveAttitude(increments)
    usable = possible(slave, turns)
    seen = offsets.scan(increments, turns, usable, C_ms, bracket)
    if seen is None:
        return None
    size = seen.size if seen.likeness.max() > UNLIKE else 1.0
    if abs(np.log(size)) > OTHER_UNIT:
        reduced = replace(increments, dtheta_b=increments.dtheta_b / size)
        found = _delay_of(reduced, time, C_nb, w_in_n, C_ms, bracket)
        return found and replace(found, scale=size * found.scale, scale_sd=size * found.scale_sd)
    tried = []
    for tau in seen.peaks:
        # A mount of which nothing is known is that of Wahba's problem here.
        start = seen.mounting(tau) if C_ms is None else C_ms
        if np.sum(inside(slave, turns, tau, usable)) >= FEWEST:
            tried.append(match(slave, turns, tau, start, usable))
    if not tried:
        return None
    sizes = np.array([np.mean(one.residual[one.used] ** 2) for one in tried])
    sizes[[not one.converged for one in tried]] *= 1e3
    best = tried[int(np.argmin(sizes))]
    near = np.array([
        one.delay for one, size in zip(tried, sizes, strict=True)
        if size < RIVAL * sizes.min() and abs(one.delay - best.delay) > turns.interval
    ])  # fmt: skip
    low, high = (seen.low, seen.high) if bracket is None else bracket
    edge = not low < best.delay < high or seen.at_edge(best.delay)
    return _refined(slave, turns, best, usable, (low, high), edge, near)


def possible(slave: SlaveAttitude, turns: Turns) -> BoolArray:
    """Return which turns a body can have made that turned like the slave, shape (k,)."""
    x = slave.increments
    fastest = float(np.max(np.linalg.norm(x.dtheta_b, axis=1) / x.dt))
    limit = 1.5 * fastest * turns.dt + np.radians(3.0)
    size = np.linalg.norm(turns.phi_m, axis=1)
    usable = (turns.dt < LONG * turns.interval) & np.isfinite(size)
    slow = usable & (size < limit)
    few = np.sum(usable) - np.sum(slow) <= WILD_PART * np.sum(usable)
    return np.asarray(slow if few else usable)  # many: a wrong unit, which is told by its size


def _refined(
    slave: SlaveAttitude, turns: Turns, start: Match, usable: BoolArray,
    bracket: tuple[float, float], edge: bool, rivals: FloatArray,
) -> Delay:  # fmt: skip
    """Leave out what is wild, weigh, and follow a drift of the clocks."""
    wild = ~usable & (turns.dt < LONG * turns.interval) | _wild(start)
    usable = usable & ~wild
    now = weigh(slave, turns, start, usable)
    middle, drift = _centre(now, turns), 0.0
    for _ in range(DRIFT_STEPS):
        age = (turns.start + turns.end) / 2 - middle
        slope = now.slope[:, :, :1]
        both = np.concatenate([slope, slope * age[:, None, None]], axis=2)
        step, cov = residual_step(now, both)
        if not (abs(step[1]) > DRIFTS * np.sqrt(cov[1, 1]) and now.converged):
            break
        drift += float(step[1])
        begins, ends = (t - drift * (t - middle) for t in (turns.start, turns.end))
        slowed = Turns(begins, ends, turns.phi_m)
        now = weigh(slave, slowed, now, usable)
    if drift:  # it was estimated with the others
        now = replace(now, cov=np.delete(np.delete(cov, 1, 0), 1, 1))
    drift_sd = float(np.sqrt(cov[1, 1]))
    parts = _parts(now, turns, drift, middle)
    return Delay(now, turns, now.C_ms, middle, drift, drift_sd, *parts, bracket, edge, rivals, wild,
                 *_alike(now))  # fmt: skip


def _centre(found: Match, turns: Turns) -> float:
    """Return the time at which the delay is known best, whatever it does before and after [s]."""
    weight = np.sum(found.slope[:, :, TAU] ** 2 / np.mean(found.residual**2, axis=0), axis=1)
    return float(np.average((turns.start + turns.end) / 2, weights=weight + 1e-300))


def _wild(found: Match) -> BoolArray:
    """Return residuals that are not of this noise, nor of jitter of the stamps, if they are few."""
    size, turned = (np.linalg.norm(x, axis=1) for x in (found.residual, found.phi_s))
    usual = float(np.median(size[found.used]))
    wild = found.used & (size > WILD * usual) & (size > WILD_TURN * turned)
    few = np.sum(wild) <= WILD_PART * np.sum(found.used)
    return np.asarray(wild if few else np.zeros_like(wild))


def _parts(
    found: Match, turns: Turns, drift: float, middle: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return start, end, delay and covariance of the delay in parts of the log."""
    rows = np.flatnonzero(found.used)
    edges = np.linspace(turns.start[rows[0]], turns.end[rows[-1]], PARTS + 1)
    at = (turns.start + turns.end) / 2
    part = np.clip(np.searchsorted(edges, at) - 1, 0, PARTS - 1)
    alone = (part[:, None] == np.arange(PARTS))[:, None, :] * found.slope[:, :, :1]
    step, cov = residual_step(found, alone)
    centre = (edges[1:] + edges[:-1]) / 2
    delay = found.delay + drift * (centre - middle) + step[:PARTS]
    return edges[:-1], edges[1:], delay, cov[:PARTS, :PARTS]


def _alike(found: Match) -> tuple[float, float, float]:
    """Return the common part of what both turned, and the ratio of their sizes with its sd."""
    turned = found.phi_s[found.used]
    turned = turned - turned.mean(axis=0)
    expected = found.phi_s - found.residual
    expected[found.used] -= expected[found.used].mean(axis=0)
    expected[~found.used] = 0.0
    both = float(np.sum(turned * expected[found.used]))
    total = float(np.sum(turned**2) * np.sum(expected**2))
    e, J = whitened(found, -expected[:, :, None])
    information = float(np.sum(J * J))
    if not information > 0 or not total > 0:
        return 0.0, 1.0, np.inf
    sd = float(np.sqrt(covariance(e, J)[0, 0]))
    return both**2 / total, 1.0 - float(np.sum(J[:, :, 0] * e)) / information, sd
