"""Find the rests of a log, with a threshold chosen from the data, and measure noise in them.

The level of a window is the standard deviation of its samples relative to the quietest part of
the log (1 = quiet), the larger of accelerometers and gyros. Levels of rests and of turns form
two heaps on a logarithmic axis; the threshold separates them best in Otsu's sense. A window
belongs to a rest only as a whole, so that a rest starts and ends half a window inside the quiet.

References
----------
.. [1] N. Otsu, "A threshold selection method from gray-level histograms", IEEE Trans. SMC 9(1),
   1979.
.. [2] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014, section IV-A (static detector).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.carried import white_and_carried
from foucault.errors import Finding, error, finding
from foucault.kernels.moving import moving_moments
from foucault.models.noise import rounding_bias
from foucault.tables import AXES, Log


@dataclass(frozen=True)
class Rests:
    """The rests of a log and how they were found."""

    # first, last: (n,) first sample of each rest and the sample after its last
    first: IntArray
    last: IntArray
    # level, accel_level, gyro_level: (samples,) standard deviation in the window around each
    # sample, relative to the quiet [1]
    level: FloatArray
    accel_level: FloatArray
    gyro_level: FloatArray
    threshold: float  # level below which a window is at rest [1]
    window: int  # samples of a window [1]
    findings: tuple[Finding, ...] = ()  # candidates that were left out, and why
    # (len(findings) rate of each against the others [rad/s], and its duration [s]
    left_out: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))

    def __len__(self) -> int:
        return len(self.first)


def require_live_gyros(log: Log) -> None:
    """Refuse gyros that all read one value throughout while the accelerometers live.

    `log`: readings [SI]. Raises ``gyro.stuck``.
    """
    if log.gyro is None or log.accel is None or len(log) < 2:
        return
    if not np.ptp(log.gyro, axis=0).any() and np.ptp(log.accel, axis=0).any():
        values = ", ".join(f"{v:.6g}" for v in log.gyro[0])
        raise error("gyro.stuck", values=values)


def find_rests(
    log: Log,
    *,
    window: float = 0.5,
    threshold: float | None = None,
    shortest: float = 1.0,
) -> Rests:
    """Find the intervals in which the instrument did not move.

    `log`: readings with accelerometers, gyros or both [SI]; `window`: length of the moving window
    [s]; `threshold`: level that separates rest from motion, None chooses it from the data [1];
    `shortest`: shortest quiet time that counts as a rest, the window's length not included [s].
    """
    rate = log.rate if len(log) > 1 else 0.0
    samples = max(5, 2 * round(window * rate / 2) + 1)
    accel_level = _level(log.accel, samples)
    gyro_level = _level(log.gyro, samples)
    level = np.fmax(accel_level, gyro_level)
    limit = split(level) if threshold is None else threshold
    first, last = quiet_runs(level < limit, max(2, round(shortest * rate)))
    if threshold is None:
        first, last = trimmed(level, first, last, max(2, round(shortest * rate)))
    first, last, found, out = _drop_moving(log, first, last)
    return Rests(first, last, level, accel_level, gyro_level, limit, samples, found, out)


def _level(x: FloatArray | None, samples: int) -> FloatArray:
    if x is None:
        return np.array([np.nan])
    sd = moving_sd(x, samples)
    return sd / quiet_sd(sd)


def moving_sd(x: FloatArray, samples: int) -> FloatArray:
    """Return the standard deviation in the window around each sample, all axes together, (n,).

    `x` (n, 3): readings of one triad [unit]; `samples`: length of the window, odd, the result is
    NaN in the half window at either end [1].
    """
    _, variance = moving_moments(np.ascontiguousarray(x), samples)
    return np.asarray(np.sqrt(variance.sum(axis=1)))


def quiet_sd(sd: FloatArray) -> float:
    """Return the standard deviation of a quiet window, of which the level is 1.

    `sd` (n,): standard deviation in each window [unit].
    """
    seen = sd[np.isfinite(sd) & (sd > 0)]
    # The quietest windows, but not the luckiest: the 5th percentile.
    return float(np.percentile(seen, 5)) if len(seen) else 1.0


APART = 0.2
"""Rest and motion differ by this much at least, in decades of the mean level [1]."""


def split(level: FloatArray) -> float:
    """Return the level that splits the log-levels into the two most distinct classes [1].

    `level` (n,): levels, 1 for quiet, NaN does not count [1].
    """
    x = np.log10(np.maximum(level[np.isfinite(level)], 0.1))
    if len(x) == 0 or x.max() - x.min() < 0.3:  # nothing moves: everything is rest
        return float(10 ** (x.max() + 0.3)) if len(x) else 2.0
    counts, edges = np.histogram(x, bins=256)
    centres = (edges[1:] + edges[:-1]) / 2
    below = np.cumsum(counts)
    mean_below = np.cumsum(counts * centres)
    above = below[-1] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = mean_below / below - (mean_below[-1] - mean_below) / above
    # What is left of one heap when it is cut in two differs less than rest and motion do: a few
    # windows far above a long rest would else be outvoted by the scatter of the rest.
    between = np.nan_to_num(np.where(np.abs(gap) < APART, 0.0, below * above * gap**2))
    if not between.any():
        return float(10 ** (x.max() + 0.3))
    best = np.flatnonzero(between >= between.max() * (1 - 1e-9))
    return float(10 ** edges[1 + int(best.mean())])  # middle of an empty valley


def quiet_runs(quiet: npt.NDArray[np.bool_], shortest: int) -> tuple[IntArray, IntArray]:
    """Return first and one-past-last index of the runs of True that are long enough.

    `quiet` (n,): where the instrument is at rest; `shortest`: fewest samples of a run [1].
    """
    edge = np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    keep = last - first >= shortest
    return first[keep].astype(np.int64), last[keep].astype(np.int64)


EDGE = 2.5
"""A rest ends where its level leaves this multiple of its own median [1]."""


def trimmed(
    level: FloatArray, first: IntArray, last: IntArray, shortest: int
) -> tuple[IntArray, IntArray]:
    """Cut the slow beginnings and ends of turns off the rests.

    The threshold that tells rest from turn lies far above the level of a rest, and the more so
    the slower the log; a turn that starts gently is below it for a while.

    `level` (samples,): level of each window, 1 for quiet [1]; `first`, `last` (n,): first sample
    of each rest and the sample after its last; `shortest`: fewest samples of a rest, a rest is
    not cut below it [1].
    """
    first, last = first.copy(), last.copy()
    for j, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        part = level[a:b]
        calm = np.flatnonzero(part <= EDGE * np.median(part))
        # Only the ends are cut: a bump in the middle stays part of the rest.
        if len(calm) and calm[-1] + 1 - calm[0] >= shortest:
            first[j], last[j] = a + calm[0], a + calm[-1] + 1
    return first, last


def _drop_moving(
    log: Log, first: IntArray, last: IntArray
) -> tuple[IntArray, IntArray, tuple[Finding, ...], FloatArray]:
    """Leave out "rests" with a steady rotation: quiet by variance, moving all the same."""
    if log.gyro is None or len(first) < 5:
        return first, last, (), np.zeros((0, 2))
    mean = np.array([log.gyro[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)])
    moving, off = turning(mean)
    ends = [(log.time[first[i]], log.time[last[i] - 1], off[i]) for i in np.flatnonzero(moving)]
    found = tuple(
        finding("rest.moving", start=f"{a:.1f}", end=f"{b:.1f}", rate=f"{np.degrees(w):.2f}")
        for a, b, w in ends
    )
    how = np.column_stack([off, (last - first) * log.interval])[moving]
    return first[~moving], last[~moving], found, how


def turning(gyro_mean: FloatArray) -> tuple[npt.NDArray[np.bool_], FloatArray]:
    """Tell which rests turn steadily, and how fast against the others, shape (n,) [rad/s].

    `gyro_mean` (n, 3): mean rate of each rest, fewer than five cannot be told apart [rad/s].
    """
    off = np.linalg.norm(gyro_mean - np.median(gyro_mean, axis=0), axis=1)
    # 1 deg/s is far beyond Earth rate and bias drift, and slow for a hand.
    return off > max(np.radians(1.0), 8.0 * float(np.median(off))), off


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


CARRIED = 0.75
"""Counts carry their rounding on if their sums show less than this of what their own scatter would
make of them: beyond it noise hides all steps [1]."""


def measure_noise(
    x: FloatArray,
    interval: float,
    rests: Rests,
    steps: FloatArray | None = None,
    *,
    increments: bool = False,
) -> RestNoise:
    """Measure the noise of one triad in the rests of a log.

    `x` (samples, 3): readings [unit]; `interval`: sample interval [s]; `steps` (3,) or None:
    steps of the output, where `x` alone does not show them [unit]; `increments`: whether the
    readings are means over their intervals, which may carry their rounding on.
    """
    from scipy.special import fdtri

    short = max(1, round(0.2 / interval))
    fast, slow, fast_n, slow_n, square, n = (np.zeros(3), np.zeros(3), 0, 0, np.zeros(3), 0)
    for a, b in zip(rests.first, rests.last, strict=True):
        part = x[a:b]
        square += ((part - part.mean(axis=0)) ** 2).sum(axis=0)
        n += len(part) - 1
        means = _block_means(part, short)
        # Successive differences: blind to slow motion of the hand (von Neumann's ratio).
        fast += (np.diff(means, axis=0) ** 2).sum(axis=0) / 2 * short
        fast_n += len(means) - 1
        quarter = (b - a) // 4
        if quarter > short:
            quarters = _block_means(part, quarter)[:4]
            slow += quarters.var(axis=0) * 4 * quarter
            slow_n += 3
    psd, carried = fast / max(fast_n, 1) * interval, np.zeros(3)
    sd = np.sqrt(square / max(n, 1))
    if steps is None:
        steps = np.array([resolution(x[:, i]) for i in range(3)])
    # What is rounded moves by less than it seems, for rounding adds a variance of its own. A
    # signal that hardly leaves two steps says nothing of how much it moves: take it for still.
    before = np.sqrt(np.maximum(sd**2 - steps**2 / 12, 0.0))
    before[_levels(x, rests) < 3] = 0.0
    rounding = np.array([rounding_bias(step, s) for step, s in zip(steps, before, strict=True)])
    floor = steps**2 / 12 * interval  # in motion, rounding is white noise
    if increments and len(rests):
        # Means that hold more than one pulse: the fewer it has, the less its lines look like noise.
        parts = [_block_means(x[a:b], short) for a, b in zip(rests.first, rests.last, strict=True)]
        psd, carried = white_and_carried(parts, short * interval)
        # An axis that never changes does not tell: counters carry on.
        on = (psd < CARRIED * sd**2 * interval) | (square == 0)
        counted = white_and_carried(parts, short * interval, np.where(on, floor * interval, 0.0))
        psd, carried = np.where(on, counted, (psd, carried))
        carried = np.where(on, np.maximum(carried, floor * interval), carried)
        rounding, floor = np.where(on, 0.0, rounding), np.where(on, 0.0, floor)
    of_mean = psd
    if slow_n:
        measured = slow / slow_n * interval
        # Of four quarters that follow each other, carried rounding leaves 5/2 of v / time.
        ends = 2.5 * carried * float(np.mean(4 / (rests.last - rests.first))) / interval
        limit = fdtri(slow_n, max(fast_n, 1), 0.99)
        of_mean = np.where(measured > limit * (psd + ends), measured - ends, psd)
    return RestNoise(np.maximum(psd, floor), np.maximum(of_mean, floor), rounding, carried)


def _levels(x: FloatArray, rests: Rests) -> FloatArray:
    """Return how many values the samples of a typical rest take, rare ones left out, (3,)."""
    counts = []
    for a, b in zip(rests.first, rests.last, strict=True):
        part = x[a : min(b, a + 500)]
        shares = [np.unique(part[:, i], return_counts=True)[1] / len(part) for i in range(3)]
        counts.append([int(np.sum(share >= 0.005)) for share in shares])
    return np.asarray(np.median(np.array(counts).reshape(-1, 3), axis=0))


def resolution(x: FloatArray, most: int = 10_000) -> float:
    """Return the step of a rounded signal [unit], 0 where the samples are not rounded.

    `x` (n,): readings of one axis [unit]; `most`: number of samples to look at [1].
    """
    seen = x[:: max(1, len(x) // most)]
    values = np.unique(seen)
    if len(values) < 2 or len(values) > 0.9 * len(seen):
        return 0.0
    steps = np.diff(values)
    # Equal steps differ by the rounding of their own arithmetic.
    return float(steps[steps > 1e-6 * steps.max()].min())


def _block_means(x: FloatArray, size: int) -> FloatArray:
    blocks = len(x) // size
    return np.asarray(x[: blocks * size].reshape(blocks, size, x.shape[1]).mean(axis=1))


def rest_levels(rests: Rests) -> FloatArray:
    """Return the median level of each rest, shape (n,); 1 is quiet [1].

    `rests`: the rests and the levels of the log.
    """
    spans = zip(rests.first, rests.last, strict=True)
    return np.array([np.nanmedian(rests.level[a:b]) for a, b in spans])


def rest_table(log: Log, rests: Rests) -> dict[str, npt.NDArray[np.generic]]:
    """Return the columns first, last, start, end and means of `tables.RESTS`."""
    out: dict[str, npt.NDArray[np.generic]] = {
        "first": rests.first,
        "last": rests.last,
        "start": log.time[rests.first],
        "end": log.time[rests.last - 1],
    }
    for name, x in (("accel", log.accel), ("gyro", log.gyro)):
        if x is not None:
            mean = np.array(
                [x[a:b].mean(axis=0) for a, b in zip(rests.first, rests.last, strict=True)]
            ).reshape(len(rests), 3)
            out |= {f"{name}_{axis}": mean[:, i] for i, axis in enumerate(AXES)}
    return out


def detection_table(log: Log, rests: Rests, rows: int = 4000) -> dict[str, FloatArray]:
    """Return the table "detection" of the report: the levels, thinned, peaks kept.

    `log`: readings [SI]; `rows`: largest number of rows [1].
    """
    step = max(1, -(-len(log) // rows))
    n = len(log) // step * step

    def peaks(x: FloatArray) -> FloatArray:
        if len(x) < n:
            return np.full(n // step, np.nan)
        filled = np.where(np.isfinite(x[:n]), x[:n], -np.inf).reshape(-1, step).max(axis=1)
        return np.where(np.isfinite(filled), filled, np.nan)

    return {
        "time": log.time[:n:step],
        "accel_level": peaks(rests.accel_level),
        "gyro_level": peaks(rests.gyro_level),
        "level": peaks(rests.level),
    }
