"""Where to start with two bodies that are one: what their rates say before anything is known.

Norms of rates do not know how two instruments are turned against each other: their correlation
tells the offset of the clocks, window by window their rate. A rotation then brings the rates
together [1].

References
----------
.. [1] G. Wahba, "A least squares estimate of satellite attitude", SIAM Review 7(3), 1965.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import factorial
from typing import NamedTuple, Protocol

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, finding
from foucault.infer.linear_filter import Shock, likeliest
from foucault.units import plain

FASTEST = 0.02  # No clock is faster by so much than another [1].

ONE_AXIS = 0.05
"""Rates that are smaller in all other directions by such a factor are about one axis [1]."""

GRID, SMOOTH = 0.005, 0.1  # Grid of the correlation, and window of the derivatives [s].

WINDOW = (3.0, 10.0)
"""Length of windows whose offsets tell the rate of clocks: a sixth of the log, within these [s]."""

SOME = 40  # Windows that are looked for in the whole of the other log [1].
SETTLED = 0.02  # A step that moves nothing by more of its sd is the last [1].
SPLIT = 0.5  # Parameters are asked whether they changed every so often [s].
FEW, LOST = 200, 4
"""Fewer values are alike by chance; an interval of so many usual ones has none inside [1]."""

BLOCK = 2.0  # Errors of what is farther apart are taken as independent [s].

COLOURED, MOVED = 1.1, 1.3
"""More than chance, as sds: scatter of scores beyond that of white rows, and difference of the
halves beyond what noise makes [1]."""

ROUND = 0.1  # A rotation that is less certain is none [rad].

LEAST_PEAK, SECOND, MISFIT = 0.5, 0.02, 0.5
"""Correlation of the rates below which nothing is in common, by how much another offset has to be
worse, and the part of the rates that a rotation may leave before errors are known [1]."""

OTHER_UNIT, CLEARLY = 1.5, 3.0
"""Factor in size of another unit, and by how many times less must be left over for a mistake to be
told [1]."""

HARM, TOGETHER, CERTAIN, CLEAR, ALMOST = 1.5, 0.7, 10.0, 3.0, 0.9
"""What changed half-way is told where a result would be another by so many sds, or all of them
together, rms, or where it is so many times beyond chance; it explains most of what scatters, or is
beyond chance so clearly beside all of that; what explains almost as much is told beside it [1]."""

OF_IMU = {
    "gyro.bias": "the biases of the gyros", "accel.bias": "the biases of the accelerometers",
    "gyro.scale": "scale factors or misalignments of the gyros",
    "accel.scale": "scale factors or misalignments of the accelerometers",
    "accel.delay": "the delay of the accelerometers",
    "gyro.g_sensitivity": "the g-sensitivity of the gyros",
}  # fmt: skip
"""What of an IMU may change for good half-way, in words."""

COLOUR_BASIS = ("A", "scatter of scores of blocks beyond that of white rows")
"""Type and basis of what is related from one reading to the next."""

HALVES, SURE, SHORTEST, JUMPS = 3.0, 5.0, 5.0, 0.3
"""Limit of the difference of the halves [sd]; from where clocks differ [sd]; the shortest log [s];
offsets of windows that leave their line by so many samples are of lost samples [1]."""

UNSURE_DELAY = 1e-3  # An offset that is less sure than this is none [s].

NEAR, ALIKE = 0.5, 0.02
"""How far from a line windows are looked for [s]; by how much another place is worse [1]."""


class Answers(NamedTuple):
    """What something that is added to readings changes of white rows and of parameters.

    With rows e of a solution, and E (r, c) what changes of them, the motion and the parameters
    found again.
    """

    square: float  # e'e [1]
    pull: FloatArray  # (c,) E'e [1]
    gram: FloatArray  # (c, c) E'E [1]
    A: FloatArray  # (p, c) change of the parameters [SI]
    redundancy: int  # rows more than the motion has [1]

    def of(self, spread: float, kept: Sequence[int], follows: IntArray) -> Answers:
        """Return the same of terms alone, of rows that scatter more, of parameters that are `kept`.

        `spread`: sd of the rows [1]; `follows` (c,): which of those a column goes with, as much of
        it as that parameter moves: ``dc = -A dx - A_f dc``; negative: it is a term [1].
        """
        A, moves, one = self.A[kept], follows >= 0, spread**-2.0
        own = A[follows[moves]]
        V = np.eye(len(follows))[:, ~moves]
        V[moves] = -np.linalg.solve(np.eye(len(own)) + own[:, moves], own[:, ~moves])
        return Answers(one * self.square, one * V.T @ self.pull, one * V.T @ self.gram @ V, A @ V,
                       self.redundancy)  # fmt: skip


@dataclass(frozen=True)
class Clocks:
    """How two clocks stand to each other: ``t_first = t + tau + kappa (t - middle)``."""

    tau: float  # [s]
    kappa: float  # [1]
    peak: float  # correlation of the norms there [1]
    second: float  # the next highest beside it [1]
    drift: float  # of the offset, window by window [1]
    jumps: float  # what windows leave of a line (rms) [s]


def clocks(
    first: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray], middle: float,
    known: BoolArray | None = None,
) -> Clocks:  # fmt: skip
    """Find offset and rate of two clocks by the norms of the rates that both bodies had.

    `first`, `other`: time (n,) [s] and rate (n, 3) [rad/s] of each; `middle`: of the other's stamps
    [s]; `known` (m,) or None: which of the other's rates are.
    """
    fine, later = (np.arange(t[0], t[-1], GRID) for t, _ in (first, other))
    a, b = (np.interp(grid, t, np.linalg.norm(w, axis=1))
            for grid, (t, w) in ((fine, first), (later, other)))  # fmt: skip
    seen = [~gaps(t, grid, max(LOST * float(np.median(np.diff(t))), SMOOTH))
            for grid, (t, _) in ((fine, first), (later, other))]  # fmt: skip
    if known is not None:
        seen[1] &= np.interp(later, other[0], known.astype(float)) > 0.99
    lag, peak, second = offset(a, b, GRID, *seen)
    tau, kappa = lag + fine[0] - later[0], 0.0
    slope, at, jumps = drift(a, b, GRID, *seen)
    far = abs(slope) * (later[-1] - later[0]) > 2 * GRID or peak < 0.9
    if far and np.isfinite(at) and abs(slope) < FASTEST:
        kappa, tau = slope, at + fine[0] - later[0]
        there = later + kappa * (later - middle)
        both = seen[1] & (np.interp(there + tau, fine, seen[0].astype(float)) > 0.99)
        _, peak, second = offset(np.interp(there + tau, fine, a), b, GRID, both, both)
    return Clocks(tau, kappa, peak, second, slope, jumps)


def smooth(x: FloatArray, step: float, order: int = 0, over: float = SMOOTH) -> FloatArray:
    """Return `x` (n, q) or its derivative of `order` [1] by parabolas.

    `step`: between two values [s]; `over`: length of a window, three values at least [s].
    """
    from scipy.linalg import lstsq
    from scipy.ndimage import convolve1d  # scipy.signal, which has all this, takes long to load

    half = max(1, round(over / step / 2))
    window, per = 2 * half + 1, step**order
    degree = min(2 if order < 2 else 3, window - 1)
    powers = np.arange(half, -half - 1.0, -1.0) ** np.arange(degree + 1.0)[:, None]
    wanted = np.where(np.arange(degree + 1) == order, factorial(order) / per, 0.0)
    out = convolve1d(x, lstsq(powers, wanted)[0], axis=0, mode="constant")
    for part, at in ((slice(window), slice(half)), (slice(-window, None), slice(-half, None))):
        ends = np.polyfit(np.arange(float(window)), x[part], degree)
        for _ in range(order):
            ends = ends[:-1] * np.arange(len(ends) - 1, 0, -1)[:, None]
        out[at] = np.polyval(ends, np.arange(float(window))[at, None]) / per
    return np.asarray(out)


def smoothed_alike(x: FloatArray, step: float, order: int, others: float) -> FloatArray:
    """Return `x` (n, q) smoothed as is a derivative of `order` [1] that `smooth` finds.

    `step`: between two values [s]; `others`: between two of those whose derivative it is [s].
    """
    over = max(2, 2 * round(SMOOTH / others / 2)) * others
    over = min(over, (len(x) // 3) * step)
    mean = x.mean(axis=0)
    total = x - mean
    for _ in range(order):
        total = np.cumsum(total + np.vstack([total[:1], total[:-1]]), axis=0) * (step / 2)
    return np.asarray(smooth(total, step, order, over) + mean)


def even(time: FloatArray, x: FloatArray, grid: FloatArray) -> FloatArray:
    """Return `x` (n, q) at `time` (n,) at the times of a `grid` (m,) [s], shape (m, q)."""
    return np.column_stack([np.interp(grid, time, c) for c in x.T])


def gaps(time: FloatArray, grid: FloatArray, widest: float) -> BoolArray:
    """Return which times of a `grid` (m,) lie in gaps of `time` (n,) longer than `widest` [s]."""
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    near = time[after] - time[after - 1] > widest
    return np.asarray(near | (grid < time[0]) | (grid > time[-1]))


def offset(
    a: FloatArray, b: FloatArray, step: float, seen_a: BoolArray | None = None,
    seen_b: BoolArray | None = None,
) -> tuple[float, float, float]:  # fmt: skip
    """Return by how much `b` (m,) is later than `a` (n,) [s], the peak and the second peak.

    `step`: between two of their values [s]; `seen_a` (n,), `seen_b` (m,) or None: which of them
    are, all of it where hardly any is.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    (x, u), (y, v) = (_about_mean(z, seen) for z, seen in ((a, seen_a), (b, seen_b)))
    lags = np.arange(1 - len(y), len(x))
    fast = next_fast_len(len(lags), real=True)

    def beside(one: FloatArray, other: FloatArray) -> FloatArray:
        return np.asarray(irfft(rfft(one, fast) * rfft(other[::-1], fast), fast)[: len(lags)])

    total = beside(x, y)
    # What of each overlaps, with its own mean there: another mean would move the peak.
    first, last = np.maximum(lags, 0), np.minimum(lags + len(y), len(x))
    count = (last - first).astype(float)
    (sum_x, one), (sum_y, two) = _sums(x, first, last), _sums(y, first - lags, last - lags)
    if not (u.all() and v.all()):
        count = np.maximum(beside(u, v), 1.0)
        (sum_x, one), (sum_y, two) = ((beside(x**k, v) for k in (1, 2)),
                                      (beside(u, y**k) for k in (1, 2)))  # fmt: skip
    total = total - sum_x * sum_y / count
    one = (one - sum_x**2 / count) * (two - sum_y**2 / count)
    enough = count > 0.5 * min(u.sum(), v.sum())
    r = np.where(enough, total / np.sqrt(np.maximum(one, 1e-12 * one.max() + 1e-300)), -1.0)
    k = int(np.argmax(r))
    peaks = 1 + np.flatnonzero((r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:]))
    others = [r[j] for j in peaks if abs(lags[j] - lags[k]) * step > 0.2]
    part = 0.0
    if 0 < k < len(r) - 1:
        bend = r[k - 1] - 2 * r[k] + r[k + 1]
        part = float(0.5 * (r[k - 1] - r[k + 1]) / bend) if bend < 0 else 0.0
    return (lags[k] + part) * step, float(r[k]), float(max(others, default=-1.0))


def _about_mean(x: FloatArray, seen: BoolArray | None) -> tuple[FloatArray, FloatArray]:
    """Return `x` (n,) less its mean, nothing where it is not `seen` (n,), and 1 where it is [1]."""
    seen = np.ones(len(x), bool) if seen is None or seen.sum() < FEW else seen
    return (x - x[seen].mean()) * seen, seen.astype(float)


def _sums(x: FloatArray, first: IntArray, last: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return sums of `x` (n,) [any unit] and its squares from `first` to before `last`, (k,)."""
    sums, squares = (np.concatenate(([0.0], np.cumsum(v))) for v in (x, x**2))
    return sums[last] - sums[first], squares[last] - squares[first]


def drift(
    a: FloatArray, b: FloatArray, step: float, seen_a: BoolArray, seen_b: BoolArray
) -> tuple[float, float, float]:
    """Return drift, offset in the middle of `b`, and what windows leave of that line (rms) [s].

    Windows are looked for anywhere, then beside the line of most of them: one of a turn like others
    has its like far away.

    `a` (n,), `b` (m,): as of `offset` [any unit]; `step`: between two [s]; `seen_a` (n,), `seen_b`
    (m,): which of them are.
    """
    slope, middle, found = 0.0, 0.0, np.zeros((0, 2))
    window = np.clip(len(b) * step / 6, *WINDOW)
    for reach in (np.inf, NEAR):
        found = _windows((a, seen_a), (b, seen_b), step, round(window / step), (slope, middle),
                         reach)  # fmt: skip
        if len(found) < 3:
            return 0.0, np.nan, 0.0
        t, off = found.T
        rows, columns = np.tril_indices(len(t), -1)
        slope = float(np.median((off[rows] - off[columns]) / (t[rows] - t[columns])))
        middle = float(np.median(off - slope * t))
    return slope, middle, float((found[:, 1] - slope * found[:, 0] - middle).std())


def _windows(
    one: tuple[FloatArray, BoolArray], other: tuple[FloatArray, BoolArray], step: float, n: int,
    line: tuple[float, float], reach: float,
) -> FloatArray:  # fmt: skip
    """Return time from the middle of `b` and offset of windows of `n` values, shape (k, 2) [s].

    As far as `reach` [s] from a `line`, drift [1] and offset in the middle [s].
    """
    (a, seen_a), (b, seen_b) = one, other
    found, least = [], 0.2 * b.std()
    lively = [k for k in range(0, len(b) - n + 1, n)
              if b[k : k + n].std() >= least and seen_b[k : k + n].all()]  # fmt: skip
    if np.isinf(reach):  # some tell the line; all would take the square of the time
        lively = lively[:: -(-len(lively) // SOME) or 1]
    for first in lively:
        part, t = b[first : first + n], (first + n / 2 - len(b) / 2) * step
        low, high = 0, len(a)
        if np.isfinite(reach):
            at = first + round((line[1] + line[0] * t) / step)
            low = max(at - round(reach / step), 0)
            high = min(at + n + round(reach / step), len(a))
        # Between the ends of a gap is nothing to be like.
        if high - low < n or (np.isfinite(reach) and not seen_a[low:high].all()):
            continue
        lag, peak, second = offset(a[low:high], part, step, seen_a[low:high])
        if peak > 0.9 and second < peak - ALIKE:
            found.append((t, lag + (low - first) * step))
    return np.array(found).reshape(-1, 2)


def group_of(name: str) -> str:
    """Return what a parameter changes with: a triad's slopes together."""
    group, _, last = name.rpartition(".")
    return (group if len(last) < 3 else name).replace("misalignment", "scale")


def scatter(
    scores: FloatArray, gain: FloatArray, formal: FloatArray, prior_sd: FloatArray
) -> tuple[FloatArray, BoolArray, float]:
    """Return by how much `scores` (b, p) of blocks [1 / SI] scatter beyond white rows, as sds [1].

    For each parameter (p,), which of them are told by scores (p,), and of these together; `gain`
    (p, p): takes scores to parameters; `formal` (p, p): their covariance by white rows [SI];
    `prior_sd` (p,): beforehand [SI].
    """
    var = np.diag(formal)
    share = 1 - var / prior_sd**2  # what the prior adds scatters in no score
    ratio = np.sqrt(np.sum((scores @ gain.T) ** 2, axis=0) / (var * np.maximum(share, 1e-3)))
    told = share > 0.5
    return ratio, told, float(np.sqrt(np.mean(ratio[told] ** 2))) if told.any() else 1.0


class Scattered(Protocol):
    """How a solution's scores scatter."""

    @property
    def spread(self) -> float:
        """More than white rows, as an sd [1]."""

    @property
    def halves(self) -> float:
        """Difference of the halves over its sd, rms [1]."""


@dataclass(frozen=True)
class Change:
    """What may have changed for good, where that explains most."""

    time: float  # [s]
    shock: Shock
    # (k, p) by how much parameters are another than was found, before it and after [SI]
    moved: FloatArray
    spread: float  # of the scores beside it, as of `scatter` [1]


def changes(
    begin: FloatArray, scores: FloatArray, information: FloatArray, prior_sd: FloatArray,
    groups: Mapping[str, Sequence[int]],
) -> dict[str, Change]:  # fmt: skip
    """Return of each of the `groups` of parameters where another value from there on explains most.

    By scores of blocks, of all parameters once more beside it: nothing is fitted again. `begin`
    (b,): of blocks [s]; `scores` (b, p) and `information` (b, p, p): of a solution [1 / SI];
    `prior_sd` (p,) [SI].
    """
    P = np.linalg.inv(information.sum(axis=0) + np.diag(prior_sd**-2.0))
    s, later = (np.cumsum(x[:0:-1], axis=0)[::-1] for x in (scores, information))
    out = {}
    for name, g in groups.items():
        across = later[:, :, g]
        own = across[:, g] - np.swapaxes(across, 1, 2) @ P @ across
        # Where less is told of it than was known beforehand rounding is what is left.
        own[np.einsum("kii->ki", own).min(axis=1) * prior_sd[g].max() ** 2 < 1.0] = 0.0
        shock = likeliest(own, s[:, g], ways=len(groups) + 1)
        k = shock.epoch
        moved = np.tile(-P @ across[k] @ shock.size, (2, 1))
        moved[1, g] += shock.size
        each = moved[(np.arange(len(begin)) > k).astype(int)]
        left = scores - np.einsum("bij,bj->bi", information, each)
        out[name] = Change(
            float(begin[k + 1]), shock, moved, scatter(wider(begin, left), P, P, prior_sd)[2]
        )
    return out


def wider(begin: FloatArray, scores: FloatArray) -> FloatArray:
    """Return `scores` (b, p) [1 / SI] of blocks that `begin` (b,) [s] by those of `BLOCK`."""
    first = np.flatnonzero(np.diff(((begin - begin[0]) / BLOCK).astype(int), prepend=-1))
    return np.add.reduceat(scores, first)


def changed(
    found: Mapping[str, Change], s: Scattered, c: CoefficientVector, kept: Sequence[int],
    code: str, words: Mapping[str, str],
) -> list[Finding]:  # fmt: skip
    """Say what of `found` is believed to have changed, the likeliest first, with its like.

    Where it explains more than chance and most of what the scores of a solution, `s`, scatter
    beyond white rows, or several times what these would, and results would be others by their
    uncertainties, but for what halves that differ added to them. `c`: results, of the numbers that
    are `kept` (p,) [1]; `code`: of the finding; `words`: for what is not of an IMU.
    """
    beyond, chance = max(s.spread, COLOURED) ** 2 - 1, max(1.0, s.spread) ** 2
    if not found:
        return []
    first = max(found.values(), key=lambda x: x.shock.square)
    # Errors of poses look like motion for a moment, not like a parameter.
    clear = len(first.moved) > 1 and first.shock.square > CLEAR * first.shock.limit * chance
    sure = sorted(
        (name for name, x in found.items()
         if x.shock.square > x.shock.limit * max(1.0, x.spread) ** 2
         and (x.spread**2 - 1 < beyond / 2 or (clear and x is first))),
        key=lambda name: -found[name].shock.square,
    )  # fmt: skip
    if not sure:
        return []
    assert c.cov is not None
    moved = found[sure[0]].moved[:, kept].T * (s.halves if s.halves > MOVED else 1.0)
    most = np.max(np.abs(moved) / c.sd[:, None], axis=0)
    together = np.sqrt(np.mean(moved * np.linalg.solve(c.cov, moved), axis=0))
    harm = float(np.min(np.maximum(most / HARM, together / TOGETHER)))
    shock = found[sure[0]].shock
    if harm < 1.0 and shock.square < CERTAIN * shock.limit:
        return []
    least = ALMOST * shock.square
    what = [{**OF_IMU, **words}[n] for n in sure if found[n].shock.square > least]
    return [finding(code, what=" or ".join(what), time=plain(found[sure[0]].time, 4))]


def of_a_unit(ratio: float) -> bool:
    """Tell whether two sizes are of one unit, by their `ratio` [1]."""
    return bool(1 / OTHER_UNIT < ratio < OTHER_UNIT)


def one_axis(rates: FloatArray) -> FloatArray | None:
    """Return the axis about which all turns are, (3,) [1], None where there is none.

    `rates` (n, 3): without their mean [rad/s].
    """
    size, axes = np.linalg.eigh(rates.T @ rates)
    return np.asarray(axes[:, 2]) if size[1] < ONE_AXIS**2 * size[2] else None
