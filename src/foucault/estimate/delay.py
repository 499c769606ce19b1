"""The time offset of two instruments on one body.

The time offset of two instruments on one body, by what they turned.

First where, then how much. All turns of the master are compared with those of the slave for every
offset of a bracket at once, by correlation; the mounting that fits best at each offset is that of
Wahba's problem, or the one that is known. From the best offset, and from others that fit nearly as
well, `estimate.delay_matching` goes on to the last digit. Turns that no body makes, such as those
of a heading that was averaged across its wrap, are left out; a clock that goes faster than the
other shows as a delay that grows, and is followed.

What bends between the two in time with the motion, as a mount does that lags, cannot be told from a
delay by any method that looks at both instruments only.

References
----------
.. [1] F. L. Markley, "Attitude Determination Using Vector Observations and the Singular Value
   Decomposition", J. Astronaut. Sci. 36, 1988, p. 245-258.

All offsets of two logs of turning at once: which of them fits, and with which mounting.

With s and m the turning of slave and master over intervals of one length, less their means, an
offset tau fits as well as the gain ``max over C of sum s(t - tau)' C' m(t)`` is large against the
sizes of both; C is a rotation (Wahba's problem) or known. Sums for all offsets are correlations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.estimate.delay_matching import (
    ALIKE,
    BIAS,
    GAIN,
    GAINS,
    HELD,
    MU,
    TAU,
    Match,
    SlaveAttitude,
    Turns,
    covariance,
    inside,
    match,
    residual_step,
    turns_of,
    weigh,
    whitened,
)
from foucault.navigate.increments import Increments

FINER = 4  # Offsets lie so many times closer than the intervals, over which all is averaged [1].
OVERLAP = 0.2  # So much of the shorter log both must have in common [1].
LEAST = 20  # And so many intervals [1].
PEAKS = 4  # Peaks that are followed [1].
ROUNDING = 1e-12  # Variances below this part of the mean squares are rounding [1].
NEARLY = 0.1  # A peak whose correlation is lower than the best by more is not [1].


@dataclass(frozen=True)
class Offsets:
    """How well each offset fits."""

    tau: FloatArray  # (n,) offsets, rising [s]
    # (n,) correlation at each, with the best mounting or the known one; at most 1 [1]
    likeness: FloatArray
    products: FloatArray  # (n, 3, 3) sums of s m' [rad^2]
    ratio: FloatArray  # (n,) how many times as much the slave turns [1]

    @property
    def size(self) -> float:
        """How many times as much the slave turns, at the best offset [1]."""
        return float(self.ratio[np.argmax(self.likeness)])

    @property
    def low(self) -> float:
        """The lowest offset [s]."""
        return float(self.tau[0])

    @property
    def high(self) -> float:
        """The highest offset [s]."""
        return float(self.tau[-1])

    @property
    def peaks(self) -> FloatArray:
        """The best offsets, the very best first, shape (1..PEAKS,) [s]."""
        x = np.concatenate([[-np.inf], self.likeness, [-np.inf]])
        top = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]))
        if not len(top):
            return self.tau[:1]
        order = top[np.argsort(-self.likeness[top])]
        best = self.likeness[order[0]]
        return np.array([self._top(i) for i in order[:PEAKS] if self.likeness[i] > best - NEARLY])

    def _top(self, i: int) -> float:
        """Return the top of the parabola through a peak and its neighbours."""
        if not 0 < i < len(self.tau) - 1:
            return float(self.tau[i])
        a, b, c = self.likeness[i - 1 : i + 2]
        bend = a - 2 * b + c
        shift = 0.5 * (a - c) / bend if bend < 0 else 0.0
        return float(self.tau[i] + shift * (self.tau[1] - self.tau[0]))

    def at_edge(self, tau: float) -> bool:
        """Tell whether an offset `tau` [s] lies at an end."""
        step = self.tau[1] - self.tau[0] if len(self.tau) > 1 else 0.0
        return bool(min(tau - self.low, self.high - tau) < step / 2)

    def mounting(self, tau: float) -> FloatArray:
        """Return the mounting C_ms that fits best at an offset `tau` [s], shape (3, 3)."""
        row = int(np.argmin(np.abs(self.tau - tau)))
        U, _, Vt = np.linalg.svd(self.products[row])
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
        return np.asarray((U @ sign @ Vt).T)  # C_sm fits, s = C_sm m


def scan(
    increments: Increments, turns: Turns, usable: BoolArray, C_ms: FloatArray | None,
    bracket: tuple[float, float] | None,
) -> Offsets | None:  # fmt: skip
    """Return how well each offset of a bracket fits.

    `increments`: the slave [SI]; `usable` (k,): which of its turns count; `C_ms` (3, 3) or None:
    the mounting, where it is known; `bracket`: where to look [s], None for as far as they
    overlap, more coarsely. Returns None where they have too little in common at every offset.
    """
    h, begin, end = turns.interval, float(turns.start[0]), float(turns.end[-1])
    first, last = float(increments.time[0]), float(increments.time[-1])
    least = max(LEAST, round(OVERLAP * min(end - begin, last - first) / h))
    finer = int(np.clip(np.ceil(h / np.median(increments.dt)), 1, FINER))
    if bracket is None:
        bracket, finer = (begin - last, end - first), min(finer, 2)
    step = h / finer
    master = _on_grid(begin, h, round((end - begin) / h), turns, usable)
    # Ends of the slave's intervals at `begin + i step`, i from `base`, one table for each remainder
    base = int(np.ceil((first - begin) / step))
    grid = begin + step * np.arange(base, int(np.floor((last - begin) / step)) + 1)
    angle = np.cumsum(increments.dtheta_b, axis=0)
    path = np.stack([np.interp(grid, increments.time, a) for a in angle.T], axis=1)
    turned = [np.diff(path[p::finer], axis=0) for p in range(finer)]
    tau, fits = [], []
    for lag in range(int(np.floor(bracket[0] / step)), int(np.ceil(bracket[1] / step)) + 1):
        skip, phase = divmod(-lag - base, finer)  # row k of the master, row k + skip of the slave
        s = turned[phase] if phase < len(turned) else path[:0]
        m = master[max(0, -skip) : max(0, len(s) - skip)]
        s = s[max(0, skip) :][: len(m)]
        if np.sum(m[:, 3]) < least:
            continue
        tau.append(lag * step)
        fits.append(_fit(s, m, C_ms))
    if not tau:
        return None
    products, likeness, ratio = (np.array(column) for column in zip(*fits, strict=True))
    return Offsets(np.array(tau), likeness, products, ratio)


def _on_grid(begin: float, h: float, rows: int, turns: Turns, usable: BoolArray) -> FloatArray:
    """Return turns over equal intervals, and whether each is known, shape (rows, 4)."""
    out = np.zeros((rows, 4))
    place = np.round((turns.start - begin) / h).astype(int)
    single = usable & (np.round(turns.dt / h) == 1) & (place < rows)
    out[place[single], :3] = turns.phi_m[single]
    out[place[single], 3] = 1.0
    return out


def _fit(s: FloatArray, m: FloatArray, C_ms: FloatArray | None) -> tuple[FloatArray, float, float]:
    """Return the sum of s m' less the means, the correlation and the ratio of the sizes."""
    n = m[:, 3].sum()
    both = s.T @ m
    s_mean, m_mean = both[:, 3] / n, m[:, :3].sum(axis=0) / n
    A = both[:, :3] - n * np.outer(s_mean, m_mean)
    squares = np.array([np.einsum("ka,ka,k->", s, s, m[:, 3]), np.sum(m[:, :3] ** 2)])
    means = n * np.array([s_mean @ s_mean, m_mean @ m_mean])
    if np.any(squares - means <= ROUNDING * squares):  # one does not turn, or at one rate only
        return A, 0.0, 1.0
    s_size, m_size = np.sqrt(squares - means)
    if C_ms is None:
        w = np.linalg.svd(A, compute_uv=False)
        gain = w[0] + w[1] + np.sign(np.linalg.det(A)) * w[2]
    else:
        gain = np.einsum("ij,ji->", A, C_ms)
    return A, float(gain / (s_size * m_size)), float(s_size / m_size)


BRACKET = (-1.0, 1.0)  # Where an offset is looked for if nothing is said [s].
SEEN = 0.01  # A delay with a larger standard deviation is not seen [s].
UNLIKE = 0.5  # A slave whose turning has less in common with the master is on another body [1].
FEWEST = 20  # So few intervals do not show an offset [1].
LONG = 5.0  # Intervals that are so many times the usual are not used [1].
WILD = 10.0  # Residuals that are so many times the usual are not of this noise [1].
WILD_TURN = 0.5  # And so large a part of what the slave turned [1].
WILD_PART = 0.05  # At most this part of the intervals is left out for that [1].
PARTS = 4  # The delay is shown in so many parts of the log [1].
SOUND = 4.0  # Scale factor errors of so many times the usual are something else [1].

DIFFER = 21.1
"""Chi-square of three that one in 10,000 exceeds: scale factors are estimated where they differ by
more; where few turns tell them, they would cost much of what is known of the delay [1]."""

DRIFTS = 4.0  # A drift of so many standard deviations is followed [1].
DRIFT_STEPS = 5  # In at most so many steps [1].
OTHER_UNIT = 0.25  # A ratio of sizes whose logarithm is larger is taken out before all else [1].
RIVAL = 1.5  # An offset whose squared residuals are at most so many times the best is a rival [1].


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
    seen = scan(increments, turns, usable, C_ms, bracket)
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
    # In the middle the delay is known best, whatever it does before and after.
    weight = np.sum(start.slope[:, :, TAU] ** 2 / np.mean(start.residual**2, axis=0), axis=1)
    middle = float(np.average((turns.start + turns.end) / 2, weights=weight + 1e-300))
    now, drift, cov = _followed(slave, turns, start, usable, middle, HELD)
    if not _unlike(now):
        now, drift, cov = _followed(slave, turns, start, usable, middle, ALIKE)
    if drift:  # it was estimated with the others
        now = replace(now, cov=np.delete(np.delete(cov, 1, 0), 1, 1))
    drift_sd = float(np.sqrt(cov[1, 1]))
    parts = _parts(now, turns, drift, middle)
    return Delay(now, turns, now.C_ms, middle, drift, drift_sd, *parts, bracket, edge, rivals, wild,
                 *_alike(now))  # fmt: skip


def _followed(
    slave: SlaveAttitude, turns: Turns, start: Match, usable: BoolArray, middle: float,
    held: FloatArray,
) -> tuple[Match, float, FloatArray]:  # fmt: skip
    """Return the match less the drift of the clocks, that drift, and the covariance with it.

    Weights are those of what is left when the clocks go alike: first without any, then by these.
    """
    drift, slowed, age = 0.0, turns, (turns.start + turns.end) / 2 - middle
    now = match(slave, turns, start.delay, start.C_ms, usable, held)
    for weighs in (False, True):
        now = weigh(slave, slowed, now, usable) if weighs else now
        for _ in range(DRIFT_STEPS):
            step, cov = residual_step(now, np.stack([np.ones_like(age), age], axis=1))
            if not (abs(step[1]) > DRIFTS * np.sqrt(cov[1, 1]) and now.converged):
                break
            drift += float(step[1])
            begins, ends = (t - drift * (t - middle) for t in (turns.start, turns.end))
            slowed = Turns(begins, ends, turns.phi_m)
            if weighs:
                now = weigh(slave, slowed, now, usable)
            else:
                now = match(slave, slowed, now.delay, now.C_ms, usable, held)
    return now, drift, cov


def _unlike(found: Match) -> bool:
    """Tell whether gyros are seen to differ in scale factor, no more than gyros do."""
    k, P = found.x[GAIN], found.cov[GAIN, GAIN]
    if not found.converged or np.any(np.abs(k) > SOUND * GAINS):  # as where one is reversed
        return False
    return bool(k @ np.linalg.pinv(P, hermitian=True) @ k > DIFFER)


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
    step, cov = residual_step(found, 1.0 * (part[:, None] == np.arange(PARTS)))
    centre = (edges[1:] + edges[:-1]) / 2
    delay = found.delay + drift * (centre - middle) + step[:PARTS]
    return edges[:-1], edges[1:], delay, cov[:PARTS, :PARTS]


def _alike(found: Match) -> tuple[float, float, float]:
    """Return the common part of what both turned, and the ratio of their sizes with its sd."""
    turned = found.phi_s[found.used]
    alone = found.residual - found.slope[:, :, GAIN] @ found.x[GAIN]  # as if the gyros were alike
    expected = turned - alone[found.used]
    turned, expected = turned - turned.mean(axis=0), expected - expected.mean(axis=0)
    total = float(np.sum(turned**2) * np.sum(expected**2))
    if not total > 0:
        return 0.0, 1.0, np.inf
    # As many times as the master in all axes alike.
    J, Z = (slope[:, :, GAIN].sum(axis=2, keepdims=True) for slope in (found.slope, found.weighted))
    e, both = whitened(replace(found, residual=alone), np.concatenate([J, Z], axis=2))
    J, Z = both[:, :, :1], both[:, :, 1:]
    information = float(np.sum(Z * J))
    if not information > 0:
        return 0.0, 1.0, np.inf
    more = -float(np.sum(Z[:, :, 0] * e)) / information
    sd = float(np.sqrt(covariance(e + J @ [more], J, weighted=Z)[0, 0]))
    return float(np.sum(turned * expected)) ** 2 / total, 1.0 + more, sd
