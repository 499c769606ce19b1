"""White noise, carried rounding and the steps of an output, measured where a log does not move.

The power of successive means over tau is blind to slow motion (von Neumann's ratio [1])::

    psd(tau) = tau <(m_k+1 - m_k)^2> / 2

The four quarters of a rest show what its mean scatters by; it is more where a rest was not quite
still. Rounding adds a variance of its own, and one that averaging does not remove where the noise
does not blur the steps.

An instrument that counts pulses rounds the angle or the velocity, not each increment: what a
reading leaves out is in the next one. A mean over T begins and ends at an instant, and at each the
count is off by an error of its own, of variance v = q^2/12 for counts of size q::

    variance of a mean = N^2 / T + 2 v / T^2,    shared by means that follow each other: -v / T^2

N^2 is the density of the white noise beside it. In the spectrum of m successive means over tau
both show where they are largest, white noise flat and carried rounding as a first difference; the
second term is what the ends of a record of m means leave between its lines::

    N^2 + v/tau (2 - 2 cos w + 2/m cos w),    w = 2 pi k/m

Motion that is slower than the record has, as a random walk, 2/(2 - 2 cos w).

References
----------
.. [1] J. von Neumann, "Distribution of the ratio of the mean square successive difference to the
   variance", Annals of Mathematical Statistics 12(4), 1941 (two thirds of the degrees of freedom).
.. [2] IEEE Std 952-1997, annex C, eq. (C.15) ff. (quantisation noise, Q^2 = v).
.. [3] P. Whittle, "Estimation and information in stationary time series", Arkiv for Matematik
   2(23), 1953 (the likelihood of a periodogram).

Single readings that are far from those before and after: spikes of a converter or a link.

A reading is compared with the median of those around it. Motion takes longer than two samples, or
shakes its neighbours too; what stands alone is no motion, and neither cuts a rest nor enters its
mean. Steps of the output are no spikes. A row of zeros in both triads is no reading, on the move
either. What moves as fast as a spike hides it: there it counts as noise, which one reading among
thousands does not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.stretches import Rests
from foucault.errors import Finding, finding
from foucault.models.noise import rounding_bias
from foucault.tables import AXES, IndexedLog, Log

SHORT = 0.2  # Means over so long show white noise above rounding [s].

CARRIED = 0.75
"""Counts carry their rounding on if their sums show less than this of what their own scatter would
make of them: beyond it noise hides all steps [1]."""

PARTS = 8
"""So many steps at most lie between the two values of an axis that are nearest each other [1]."""

PER_OCTAVE = 8
"""Lines of the spectrum are joined, so many groups an octave. Of each the median counts: pulses
that come evenly, dither and engines stand in single lines [1]."""

SLOW = 10.83  # Slow motion is told from white noise at this likelihood ratio: 1 in 1000 [1].

FEWER = 6.63
"""Less carried rounding than the counts make is told at this likelihood ratio: 1 in 100 [1]."""

PASSES = 50  # Most times that the lines are weighed by what was found of them [1].


def white_and_carried(
    parts: Sequence[FloatArray], interval: float, least: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the density of white noise and the variance of carried rounding, each shape (3,).

    `parts` (m, 3): increments over `interval`, as rates, of stretches without motion [unit];
    `interval`: time over which each is the mean [s]; `least` (3,) or None: variance of carried
    rounding where the size of a count is known: q^2/12. Found freely in a few seconds it may come
    out smaller, and white noise would take up what it lacks [unit^2 s^2]. Returns `white` (3,):
    n^2 [unit^2 s]; `carried` (3,): v, of the integral [unit^2 s^2].
    """
    rows = [_lines(x, interval) for x in parts if len(x) >= 4]
    if not rows:
        return np.zeros(3), np.zeros(3)
    power, design, octave = (np.concatenate(x) for x in zip(*rows, strict=True))
    group = np.unique(np.floor(PER_OCTAVE * octave), return_inverse=True)[1]
    order = np.argsort(group, kind="stable")
    first = np.flatnonzero(np.diff(group[order], prepend=-1))
    count = np.diff(np.append(first, len(order))).astype(float)
    typical = np.array([np.median(x, axis=0) for x in np.split(power[order], first[1:])])
    typical /= _of_median(count)[:, None]
    design = np.add.reduceat(design[order], first) / count[:, None]
    known = 0.5 * (count + 1)  # of many lines the median tells as much as half of them
    floor = np.zeros(typical.shape[1]) if least is None else least
    out = np.array([_fitted(typical[:, i], design, known, v) for i, v in enumerate(floor)])
    return out[:, 0], out[:, 1]


def _of_median(count: FloatArray) -> FloatArray:
    """Return the mean of the median of so many lines: they scatter as exp(-power/mean)."""
    from scipy.special import digamma

    return np.asarray(digamma(count + 1) - digamma((count + 1) / 2))


def _lines(x: FloatArray, interval: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the power of the lines of a spectrum, what makes it, and their octaves."""
    from scipy.fft import rfft

    m = len(x)
    k = np.arange(1, (m - 1) // 2 + 1)  # the last line of an even number has half the freedom
    power = np.abs(rfft(x - x.mean(axis=0), axis=0)[k]) ** 2 * (interval / m)
    cosine = np.cos(2 * np.pi * k / m)
    difference = 2 - 2 * cosine
    design = np.stack(
        [np.ones(len(k)), (difference + 2 / m * cosine) / interval, 2 / difference], axis=1
    )
    return power, design, np.log2(k / m)


def _fitted(power: FloatArray, design: FloatArray, count: FloatArray, least: float) -> FloatArray:
    """Return what is most likely of the three parts, the slow one where it is there for sure.

    Of carried rounding there is `least`, unless less of it is in these lines for sure: that of
    even pulses stands in few others.
    """
    if not power.any():
        return np.array([0.0, least, 0.0])

    def best(carried: float) -> tuple[FloatArray, float]:
        two, three = (_likeliest(power, design[:, :n], count, carried) for n in (2, 3))
        if three[1] - two[1] > SLOW / 2:
            return three
        return np.append(two[0], 0.0), two[1]

    freely = best(0.0)
    counted = best(least) if least else freely
    return freely[0] if freely[1] - counted[1] > FEWER / 2 else counted[0]


def _likeliest(
    power: FloatArray, design: FloatArray, count: FloatArray, carried: float
) -> tuple[FloatArray, float]:
    """Maximise -sum count (log S + power/S), S = design @ parts: least squares weighed by 1/S.

    Of carried rounding there is at least `carried`.
    """
    from scipy.optimize import nnls

    least = 1e-9 * float(power.mean())
    size = np.maximum(design.mean(axis=0), 1e-300)
    expected = np.full(len(power), float(power.mean()))
    parts, known = np.zeros(design.shape[1]), np.zeros(design.shape[1])
    known[1] = carried
    beyond = power - design @ known
    best = -np.inf
    for _ in range(PASSES):  # each pass weighs by the last; the first takes all lines for alike
        weight = np.sqrt(count) / expected
        found = nnls(design / size * weight[:, None], beyond * weight)[0] / size
        found += known
        expected = np.maximum(design @ found, least)
        likelihood = -float(count @ (np.log(expected) + power / expected))
        if likelihood > best:
            best, parts, gain = likelihood, found, likelihood - best
            if gain < 1e-6:
                break
        else:
            break
    return parts, best


# -- steps of the output ---------------------------------------------------------------------------


def resolution(x: FloatArray, most: int = 10_000) -> float:
    """Return the step of a rounded signal [unit], 0 where the samples are not rounded.

    `x` (n,): readings of one axis [unit]; `most`: number of samples to look at [1].
    """
    seen = x[:: max(1, len(x) // most)]
    values = np.unique(seen)
    if len(values) < 2 or len(values) > 0.9 * len(seen):
        return 0.0
    steps = np.diff(values)
    # Equal steps differ by the rounding of their own arithmetic. A single reading far off is none.
    span = float(np.diff(np.percentile(seen, [1, 99]))[0])
    largest = min(float(steps.max()), span or np.inf)
    return float(steps[steps > 1e-6 * largest].min())


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


# -- noise in rests --------------------------------------------------------------------------------


def blocks(x: FloatArray, spans: Sequence[tuple[int, int]], size: int) -> list[FloatArray]:
    """Return the means of `size` samples that follow each other in each span, (k, c) each [unit].

    `x` (n, c): readings [unit]; `spans`: first sample of each and the sample after its last [1].
    """
    return [
        x[a : a + (b - a) // size * size].reshape(-1, size, x.shape[1]).mean(axis=1)
        for a, b in spans
    ]


def successive(means: Sequence[FloatArray], time: float) -> tuple[FloatArray, int]:
    """Return the power of successive means, (3,) [unit^2 s], and of how many differences it is.

    `means` (k, 3): that follow each other, of every stretch [unit]; `time`: over which each is [s].
    """
    squares = [(np.diff(m, axis=0) ** 2).sum(axis=0) for m in means]
    count = sum(max(len(m) - 1, 0) for m in means)
    return np.asarray(sum(squares, np.zeros(3)) / 2 * time / max(count, 1)), count


def power_of_means(
    psd: FloatArray, count: int, carried: FloatArray, quarters: Sequence[tuple[FloatArray, float]]
) -> FloatArray:
    """Return the power that the scatter of means over whole stretches corresponds to, (3,).

    `psd` (3,): of short means, from `count` differences [unit^2 s]; `carried` (3,): variance of
    carried rounding [unit^2 s^2]; `quarters`: of each stretch its four means, (4, 3) [unit], and
    the time of each [s]. It is `psd` unless the quarters scatter by significantly more.
    """
    from scipy.special import fdtri

    if not quarters:
        return psd
    freedom = 3 * len(quarters)
    measured = sum((m.var(axis=0) * 4 * T for m, T in quarters), np.zeros(3)) / freedom
    # Of four quarters that follow each other, carried rounding leaves 5/2 of v / time.
    ends = 2.5 * carried * float(np.mean([1 / T for _, T in quarters]))
    limit = fdtri(freedom, max(count, 1), 0.99)
    return np.where(measured > limit * (psd + ends), measured - ends, psd)


@dataclass(frozen=True)
class RestNoise:
    """White noise power of one triad, measured at rest."""

    # (3,) power spectral density around a few hertz: what integration over a turn adds up [unit^2
    # s]
    psd: FloatArray
    # (3,) power that the scatter of a rest's mean corresponds to; larger than `psd` where the rests
    # were not quite still [unit^2 s]
    psd_of_mean: FloatArray
    # (3,) constant error of rounding that averaging does not remove, sd [unit]
    rounding: FloatArray
    # (3,) variance of the integral of an increment log at an instant, whose rounding goes on to the
    # next reading: 2 carried / T^2 in a mean over T; 0 where readings are no increments [unit^2
    # s^2]
    carried: FloatArray = field(default_factory=lambda: np.zeros(3))


def measure_noise(
    x: FloatArray, interval: float, rests: Rests, steps: FloatArray | None = None, *,
    increments: bool = False,
) -> RestNoise:  # fmt: skip
    """Measure the noise of one triad in the rests of a log.

    `x` (samples, 3): readings [unit]; `interval`: sample interval [s]; `steps` (3,) or None:
    steps of the output, where `x` alone does not show them [unit]; `increments`: whether the
    readings are means over their intervals, which may carry their rounding on.
    """
    spans = rests.spans
    short = max(1, round(SHORT / interval))
    means = blocks(x, spans, short)
    (psd, count), carried = successive(means, short * interval), np.zeros(3)
    quarters = [
        (blocks(x, [(a, b)], (b - a) // 4)[0][:4], (b - a) // 4 * interval)
        for a, b in spans if (b - a) // 4 > short
    ]  # fmt: skip
    square = sum((x[a:b].var(axis=0) * (b - a) for a, b in spans), np.zeros(3))
    sd = np.sqrt(square / max(sum(b - a - 1 for a, b in spans), 1))
    if steps is None:
        steps = np.array([resolution(x[:, i]) for i in range(3)])
    # What is rounded moves by less than it seems, for rounding adds a variance of its own. A
    # signal that hardly leaves two steps says nothing of how much it moves: take it for still.
    before = np.sqrt(np.maximum(sd**2 - steps**2 / 12, 0.0))
    before[_values(x, spans) < 3] = 0.0
    rounding = np.array([rounding_bias(step, s) for step, s in zip(steps, before, strict=True)])
    floor = steps**2 / 12 * interval  # in motion, rounding is white noise
    if increments and spans:
        # Means that hold more than one pulse: the fewer it has, the less its lines look like noise.
        psd, carried = white_and_carried(means, short * interval)
        # An axis that never changes does not tell: counters carry on.
        on = (psd < CARRIED * sd**2 * interval) | (square == 0)
        counted = white_and_carried(means, short * interval, np.where(on, floor * interval, 0.0))
        psd, carried = np.where(on, counted, (psd, carried))
        carried = np.where(on, np.maximum(carried, floor * interval), carried)
        rounding, floor = np.where(on, 0.0, rounding), np.where(on, 0.0, floor)
    of_mean = power_of_means(psd, count, carried, quarters)
    return RestNoise(np.maximum(psd, floor), np.maximum(of_mean, floor), rounding, carried)


def _values(x: FloatArray, spans: Sequence[tuple[int, int]]) -> FloatArray:
    """Return how many values the samples of a typical rest take, rare ones left out, (3,)."""
    counts = []
    for a, b in spans:
        part = x[a : min(b, a + 500)]
        shares = [np.unique(part[:, i], return_counts=True)[1] / len(part) for i in range(3)]
        counts.append([int(np.sum(share >= 0.005)) for share in shares])
    return np.asarray(np.median(np.array(counts).reshape(-1, 3), axis=0))


AROUND = 20  # So many samples before a reading and after it tell what it should be [1].
BLOCK = 32  # Samples that tell how much readings scatter at rest [1].
FAR = 8.0  # A spike is so many robust standard deviations off: no noise reaches it in a year [1].
STEPS = 4.0  # And so many steps of the output, at least [1].
BACK = 3  # Readings so many samples apart are compared first: more than a spike is long [1].

CALM = 3.0
"""Spikes are looked for where readings scatter by less than this much more than usual at rest: a
hand that turns an instrument or puts it down makes peaks of its own [1]."""

TORN = 30.0  # Readings so many times as far off as others about them are of no motion [1].
LONGEST = 2  # Samples of a spike, at most; what lasts longer is motion [1].


L = TypeVar("L", bound=Log | IndexedLog)

Spike = tuple[float, float, str]
"""When it was [s], how far off it is [sd of the noise], and its axis."""


KNOCKS = 10
"""Where a log is integrated, more than so many are steps and knocks of a real motion [1]."""


def without_spikes(log: L, most: float = np.inf) -> L:
    """Return the log with spikes replaced by what is around them, and a finding that counts them.

    `log`: readings, rows that are means, and logs with missing readings, are left as they are
    [SI]; `most`: more than so many are steps and knocks of a real motion, and stay but for those
    that are far beyond it [1].
    """
    new, seen = spikes_of(log)
    if len(seen) > most:
        new, seen = spikes_of(log, beyond=TORN)
    return replace(log, findings=(*log.findings, *told_of(seen)), **new) if seen else log


def spikes_of(
    log: Log | IndexedLog, beyond: float = 0.0
) -> tuple[dict[str, Any], list[Spike]]:  # fmt: skip
    """Return the triads that have spikes, without them, and the spikes.

    `log`: readings; of rows that are means, and of missing readings, nothing is said [SI];
    `beyond`: so many times as far off as all but one in a hundred, at least [1].
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
        if beyond:
            off = np.abs(columns - np.median(columns, axis=0))
            sizes[off <= beyond * np.percentile(off, 99, axis=0)] = 0.0
        bad = sizes.any(axis=1) | lost
        if not bad.any() or bad.all():
            continue
        cleaned = _between(columns, bad)
        new[name] = cleaned.reshape(x.shape)
        if lost.any():
            sizes[lost] = np.maximum(sizes[lost], np.abs(cleaned[lost]) / _noise(columns))
        for row, k in zip(*np.nonzero(sizes), strict=True):
            axis = name if columns.shape[1] == 1 else f"{name}.{AXES[k]}"
            seen.append((float(log.time[row]), float(sizes[row, k]), axis))
    return new, seen


def _between(x: FloatArray, bad: BoolArray) -> FloatArray:
    """Return `x` (n, k) with what is around them in place of the rows `bad` (n,).

    The cubic through two rows before and two after, a straight line where these are not near;
    rounded as other rows are, which tell by how much they are.
    """
    good, rows, out = np.flatnonzero(~bad), np.flatnonzero(bad), x.copy()
    for column in out.T:
        column[rows] = np.interp(rows, good, column[good])
    four = np.searchsorted(good, rows)[:, None] + np.arange(-2, 2)
    inner = (four[:, 0] >= 0) & (four[:, 3] < len(good))
    at = good[four[inner]]
    near = at[:, 3] - at[:, 0] <= 3 + LONGEST
    at, some = at[near], rows[inner][near]
    apart = (at[:, :, None] - at[:, None, :]).astype(float) + np.eye(4)
    off = np.where(np.eye(4) > 0, 1.0, some[:, None, None] - at[:, None, :])
    out[some] = np.einsum("ri,rik->rk", np.prod(off / apart, axis=2), x[at])
    beside = x[good[np.maximum(np.searchsorted(good, rows) - 1, 0)]]
    for column, usual, middle in zip(out.T, x[good].T, beside.T, strict=True):
        if step := resolution(usual):
            column[rows] = middle + step * np.rint((column[rows] - middle) / step)
    return out


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
    """Return how far each reading of `x` is off if it is a spike, else 0, in sd, (n, k) [1]."""
    out = np.zeros(x.shape)
    for i, column in enumerate(x.T):
        step = max(resolution(column), 1e-9 * float(np.abs(column).max(initial=0.0)) / STEPS)
        quiet = _quiet(np.abs(column[BACK:] - column[:-BACK]))
        # Of two spikes `BACK` apart neither is seen beside the other: of large ones look again.
        far = [_far(column, back, max(least * quiet, STEPS * step))
               for back, least in ((BACK, 0.8 * FAR), (BACK + 1, TORN))]  # fmt: skip
        rows = np.flatnonzero(np.logical_or(*far))
        around = np.pad(column, AROUND, mode="reflect")
        for some in np.array_split(rows, 1 + len(rows) // 100_000):
            out[some, i] = _sizes(around, some, quiet, step)
        # Beside a step what is next to it on both sides tells, and stands alone among two levels.
        near = _far(column, 1, max(0.8 * FAR * quiet, STEPS * step))
        rows = np.flatnonzero(near[1:-1]) + 1
        rows = rows[out[rows, i] == 0]
        for some in np.array_split(rows, 1 + len(rows) // 100_000):
            out[some, i] = _sizes(around, some, quiet, step, stepped=True)
    return out


def _far(x: FloatArray, back: int, least: float) -> BoolArray:
    """Tell which of `x` (n,) are `least` from what is before and what is after, on the same side.

    `back`: so many samples before and after [1]. At an end of the log one of them counts.
    """
    apart = x[back:] - x[:-back]
    after = np.append(-apart, np.zeros(back))
    before = np.append(after[:back], apart)
    after[-back:] = before[-back:]
    return (np.minimum(np.abs(before), np.abs(after)) > least) & (before * after > 0)


def _quiet(apart: FloatArray) -> float:
    """Return the standard deviation of the noise where it is quiet."""
    # Of a sensor that reads one value mostly, what is seldom is not seen in the median.
    count, at = len(apart) // BLOCK, round(0.9 * BLOCK)
    blocks = np.partition(apart[: count * BLOCK].reshape(count, BLOCK), at, axis=1)[:, at]
    seen = blocks[blocks > 0] / (1.645 * 2**0.5)  # a difference of two scatters by sqrt(2)
    return float(np.percentile(seen, 5)) if len(seen) else 0.0


def _sizes(
    around: FloatArray, rows: IntArray, quiet: float, step: float, stepped: bool = False
) -> FloatArray:
    """Judge some readings by what is around each; `around` is padded by `AROUND` on both sides.

    `stepped`: what is before has another level than what is after, but next to the reading.
    """
    near = around[rows[:, None] + np.arange(2 * AROUND + 1)]
    off = np.abs(near - np.median(near, axis=1)[:, None])
    if stepped:
        end = AROUND // 4
        sides = near[:, :AROUND], near[:, AROUND + 1 :], near[:, :end], near[:, -end:]
        levels = np.array([np.median(x, axis=1) for x in sides])
        off = np.abs(near[None] - levels[:, :, None]).min(axis=0)
        across = near[:, AROUND + 1] - near[:, AROUND - 1]
    at = round(0.9 * (2 * AROUND + 1))
    scale = np.partition(off, at, axis=1)[:, at] / 1.645
    # What is rounded to one step less was up to half a step more.
    limit = np.maximum(FAR * (scale + 0.5 * step / 1.645), STEPS * step)
    # It stands alone: what shakes the instrument shakes it for a while.
    high = off > 0.5 * limit[:, None]
    lonely = (high.sum(axis=1) <= LONGEST) & (scale <= CALM * quiet)
    if stepped:  # a peak between two levels is how the instrument came from one to the other
        lonely &= (np.abs(across) < limit) & (np.ptp(levels, axis=0) > limit)
    # And no motion goes so far and back within two intervals.
    beside = high[:, AROUND - BACK : AROUND + BACK + 1].sum(axis=1) <= LONGEST
    torn = beside & (high.sum(axis=1) <= 0.1 * high.shape[1]) & (off[:, AROUND] > TORN * scale)
    spike = (lonely | (torn & (not stepped))) & (off[:, AROUND] > limit)
    return np.where(spike, FAR * off[:, AROUND] / np.maximum(limit, 1e-300), 0.0)
