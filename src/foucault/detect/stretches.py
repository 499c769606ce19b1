"""Which parts of a log rest, with a threshold chosen from the data: the one segmentation.

Every log is judged by the scatter of its samples in short windows: around each sample where it is
in memory or grows (`find_rests`, `live`), one after the other where a table's is read from disk
(`cells`, `table`). The level of a window is its standard deviation relative to the quietest part
of the log (1 = quiet), the largest of its triads. Levels of rests and of motion form two heaps on
a logarithmic axis; the threshold separates them best in Otsu's sense. Windows in a row that are
quiet, and belong together, are a stretch; what is not as quiet as the rest of it, or turns beside
it, is cut off its ends. A window belongs to a rest only as a whole, so that a rest starts and ends
half a window inside the quiet. A stretch that turns steadily is quiet too: its mean rate tells.

References
----------
.. [1] N. Otsu, "A threshold selection method from gray-level histograms", IEEE Trans. SMC 9(1),
   1979.
.. [2] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014, section IV-A (static detector).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.errors import Finding, error, finding
from foucault.kernels.moving import moving_moments
from foucault.tables import AXES, Log


@dataclass(frozen=True)
class How:
    """What differs from one kind of log to another."""

    window: float = 0.5  # length of a window: several samples, and short against a rest [s]
    # shortest quiet time that counts as a rest, the window's length not included [s]
    shortest: float = 1.0
    # level that separates rest from motion; None chooses it from the data [1]
    threshold: float | None = None
    # scatter of a triad below which none is quieter, 0 where not given: a log without noise would
    # make motion of its last digits [SI]
    least: Mapping[str, float] = field(default_factory=dict)

    def samples(self, rate: float) -> int:
        """Return the samples of a window that has a middle, at a `rate` [Hz]."""
        return max(5, 2 * round(self.window * rate / 2) + 1)

    def fewest(self, rate: float) -> int:
        """Return the samples of the shortest rest, at a `rate` [Hz]."""
        return max(2, round(self.shortest * rate))


HAND = How()  # Held or turned by hand, and whatever nothing else is known of.

SEQUENCE = How(shortest=5.0)
"""A calibration by navigation: each rest is long, and a pause between two turns is none."""

TABLE = How(window=0.25, least={"accel": 1e-4, "gyro": 2e-5})
"""A table: rests and spins last seconds, and a cell must not hold much of a ramp."""

LOWEST = 2.0
"""On a table, and while a log grows, no threshold is below this: nothing may have moved yet [1]."""

APART = 0.2  # Rest and motion differ by this much at least, in decades of the mean level [1].
EDGE = 2.5  # A rest ends where its level leaves this multiple of its own median [1].

STEADY_TURN = np.radians(1.0), 8.0
"""A quiet stretch turns if its rate is off by this, far beyond Earth rate and the drift of a bias
and slow for a hand, and by so many times the usual [rad/s], [1]."""

STARTS = 4.0
"""A turn starts, or ends, where windows of a rest are off by more than the least rate of a steady
turn and by so many times the usual [1]."""

SWUNG, PARTS = np.radians(3.0), 8
"""Gravity that swings by more shows that a quiet stretch turns; means that are looked at [rad],
[1]."""

SLOW_SPIN = np.radians(0.05), 12.0, 2.0 * np.pi, np.radians(10.0)
"""Where gravity stays, so does a rate that is off by this and by so many times what those of rests
are apart, makes so much of a turn and is as near to up [rad/s], [1], [rad], [rad]."""

FEW = 5  # Fewer rests cannot be told apart by their rates [1].


@dataclass(frozen=True)
class Rests:
    """The rests of a log and how they were found."""

    # first, last: (n,) first sample of each rest and the sample after its last
    first: IntArray
    last: IntArray
    # level, accel_level, gyro_level: (samples,) standard deviation in the window around each
    # sample, relative to the quiet [1]
    level: FloatArray = field(default_factory=lambda: np.empty(0))
    accel_level: FloatArray = field(default_factory=lambda: np.empty(0))
    gyro_level: FloatArray = field(default_factory=lambda: np.empty(0))
    threshold: float = float("nan")  # level below which a window is at rest [1]
    window: int = 1  # samples of a window [1]
    findings: tuple[Finding, ...] = ()  # candidates that were left out, and why
    # (len(findings) rate of each against the others [rad/s], and its duration [s]
    left_out: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))

    def __len__(self) -> int:
        return len(self.first)

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First sample of each rest and the sample after its last."""
        return list(zip(self.first.tolist(), self.last.tolist(), strict=True))


def find_rests(log: Log, how: How = HAND, *, spins: bool = False) -> Rests:
    """Find the intervals in which the instrument did not move.

    `log`: readings with accelerometers, gyros or both [SI]; `how`: what is special about it;
    `spins`: steady turns of a whole turn or more, which nobody takes for a rest, stay among them.
    """
    rate = log.rate if len(log) > 1 else 0.0
    samples = how.samples(rate)
    triads = {"accel": log.accel, "gyro": log.gyro}
    moments = {k: moments_of(x, samples) for k, x in triads.items() if x is not None}
    levels = {k: level_of(sd, quiet_sd(sd)) for k, (_, sd) in moments.items()}
    level = np.asarray(np.fmax.reduce(list(levels.values())))
    limit = limit_of(level, how)
    if log.rests is not None:
        return _as_said(log, log.rests, levels, limit, samples)
    first, last = runs(level < limit, how.fewest(rate))
    if how.threshold is None:
        mean = moments["gyro"][0] if "gyro" in moments else None
        first, last = trimmed(level, first, last, how.fewest(rate), mean)
    none = np.array([np.nan])
    found = Rests(first, last, level, levels.get("accel", none), levels.get("gyro", none), limit,
                  samples)  # fmt: skip
    if log.gyro is None or len(found) < FEW:
        return found
    moving, off = turning(means_of(log.gyro, found.spans))
    lasting = (last - first) * log.interval
    if spins:
        moving &= off * lasting < 2 * np.pi
    return replace(
        found,
        first=first[~moving],
        last=last[~moving],
        findings=tuple(
            finding("rest.moving", start=f"{log.time[first[i]]:.1f}",
                    end=f"{log.time[last[i] - 1]:.1f}", rate=f"{np.degrees(off[i]):.2f}")
            for i in np.flatnonzero(moving)
        ),
        left_out=np.column_stack([off, lasting])[moving],
    )  # fmt: skip


def _as_said(
    log: Log, said: Sequence[tuple[float, float]], levels: Mapping[str, FloatArray],
    limit: float, samples: int,
) -> Rests:  # fmt: skip
    """Return the rests that somebody has said, as far as the log has two samples of them.

    `said`: times of the first and last sample of each [s]; `levels` (n,): of each triad [1];
    `limit`: that would have told them [1]; `samples`: of a window [1].
    """
    times = np.array(said).reshape(-1, 2) + 0.5 * log.interval * np.array([-1.0, 1.0])
    first, last = np.searchsorted(log.time, times).T.astype(np.int64)
    there = last - first > 1
    told = finding("rest.said", count=int(there.sum()))
    none = np.array([np.nan])
    return Rests(
        first[there], last[there], np.asarray(np.fmax.reduce(list(levels.values()))),
        levels.get("accel", none), levels.get("gyro", none), limit, samples, (told,),
        np.zeros((1, 2)),
    )  # fmt: skip


# -- level and threshold ---------------------------------------------------------------------------


def moments_of(x: FloatArray, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, 3) and sd (n,) of `x` (n, 3) in windows around each sample [unit].

    `samples`: of a window, odd [1].
    """
    mean, variance = moving_moments(np.ascontiguousarray(x), samples)
    return np.asarray(mean), np.asarray(np.sqrt(variance.sum(axis=1)))


def quiet_sd(sd: FloatArray) -> float:
    """Return the sd of a quiet window, of level 1, from `sd` (n,) of each [unit]."""
    seen = sd[np.isfinite(sd) & (sd > 0)]
    # The quietest windows, but not the luckiest: the 5th percentile.
    return float(np.percentile(seen, 5)) if len(seen) else 1.0


def level_of(sd: FloatArray, quiet: float, least: float = 0.0, step: float = 0.0) -> FloatArray:
    """Return the level of each window, (n,) [1].

    `sd` (n,): standard deviation in each [unit]; `quiet`: that of a quiet one [unit]; `least`: none
    is quieter [unit]; `step`: of an output whose steps noise does not blur [unit].
    """
    level = sd / max(quiet, least, 0.5 * step)
    # An output in coarse steps is as quiet where it happens not to jump as where it does.
    return np.maximum(level, 1.0) if step > 0 else level


def limit_of(level: FloatArray, how: How, lowest: float = 0.0) -> float:
    """Return the `level` (n,) below which a window is at rest, `lowest` at least [1]."""
    return max(split(level), lowest) if how.threshold is None else how.threshold


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


# -- stretches -------------------------------------------------------------------------------------


def runs(
    wanted: BoolArray, fewest: int = 1, linked: BoolArray | None = None
) -> tuple[IntArray, IntArray]:
    """Return the first of each run of what is wanted, and the one after its last, (k,) each.

    `wanted` (n,): whether a window, or a sample, is; `fewest`: of a run [1]; `linked` (n - 1,) or
    None: whether one belongs to the next; where None is given all do.
    """
    apart = np.zeros(max(len(wanted) - 1, 0), bool) if linked is None else ~linked
    begins = wanted & np.concatenate([[True], apart | ~wanted[:-1]])
    ends = wanted & np.concatenate([apart | ~wanted[1:], [True]])
    first, last = np.flatnonzero(begins), np.flatnonzero(ends) + 1
    keep = last - first >= fewest
    return first[keep].astype(np.int64), last[keep].astype(np.int64)


def trimmed(
    level: FloatArray, first: IntArray, last: IntArray, fewest: int = 1,
    gyro: FloatArray | None = None,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    """Cut the slow beginnings and ends of turns off the rests.

    The threshold that tells rest from turn lies far above the level of a rest, and the more so
    the slower the log; a turn that starts gently is below it for a while. Where the rest itself is
    shaken its scatter hides the turn for longer: there the mean rate tells.

    `level` (n,): level of each window, 1 for quiet [1]; `first`, `last` (k,): first of each rest
    and the one after its last; `fewest`: of a rest, which is not cut below it [1]; `gyro` (n, 3)
    or None: mean rate in each window [rad/s].
    """
    first, last = first.copy(), last.copy()
    for j, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        part = level[a:b]
        steady = part <= EDGE * np.median(part)
        if gyro is not None:
            off = np.sqrt(np.nansum((gyro[a:b] - np.median(gyro[a:b], axis=0)) ** 2, axis=1))
            steady &= off <= max(STEADY_TURN[0], STARTS * float(np.median(off)))
        calm = np.flatnonzero(steady)
        # Only the ends are cut: a bump in the middle stays part of the rest.
        if len(calm) and calm[-1] + 1 - calm[0] >= fewest:
            first[j], last[j] = a + calm[0], a + calm[-1] + 1
    return first, last


def turning(gyro_mean: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Tell which rests turn steadily, and how fast against the others, shape (n,) [rad/s].

    `gyro_mean` (n, 3): mean rate of each rest, fewer than five cannot be told apart [rad/s].
    """
    least, usual = STEADY_TURN
    off = np.linalg.norm(gyro_mean - np.median(gyro_mean, axis=0), axis=1)
    return off > max(least, usual * float(np.median(off))), off


def swung(accel: FloatArray, spans: Sequence[tuple[int, int]], window: int) -> BoolArray:
    """Tell along which of `spans` gravity swings in `accel` (samples, 3) [any], shape (n,).

    `window`: samples over which a mean is no noise [1].
    """
    out = np.zeros(len(spans), bool)
    for j, (a, b) in enumerate(spans):
        parts = np.array_split(accel[a:b], max(min(PARTS, (b - a) // window), 1))
        mean = np.array([part.mean(axis=0) for part in parts])
        up = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
        out[j] = (up @ up[0]).min() < np.cos(SWUNG)
    return out


def spun(gyro_mean: FloatArray, accel_mean: FloatArray, lasting: FloatArray) -> BoolArray:
    """Tell which stretches are slow spins about up, shape (n,); none of few.

    `gyro_mean`, `accel_mean` (n, 3): mean rate [rad/s] and specific force [any] of each; `lasting`
    (n,): how long it is [s].
    """
    if len(gyro_mean) < FEW:
        return np.zeros(len(gyro_mean), bool)
    least, times, whole, near = SLOW_SPIN
    # As many may spin as rest, and those that rest are alike: the nearest quarter is the densest.
    apart = np.linalg.norm(gyro_mean[:, None] - gyro_mean, axis=2)
    usual = np.quantile(apart, 0.25, axis=1)
    centre = int(np.argmin(usual))
    off, size, force = (gyro_mean - gyro_mean[centre], apart[centre],
                        np.linalg.norm(accel_mean, axis=1))  # fmt: skip
    upright = np.abs(np.sum(off * accel_mean, axis=1)) > np.cos(near) * size * force
    far = size > max(least, times * float(usual[centre]))
    return np.asarray(far & upright & (size * lasting > whole))


def slowest(gyro: FloatArray, share: float = 0.1) -> FloatArray:
    """Return what gyros read where they read least, shape (3,) [rad/s].

    That is about their bias where the log rests a while; of one that turns most of the time the
    median is a rate. `gyro` (n, 3): readings [rad/s];
    `share`: of the samples that count [1].
    """
    size = np.linalg.norm(gyro, axis=1)
    return np.asarray(np.median(gyro[size <= np.quantile(size, share)], axis=0))


def means_of(x: FloatArray, spans: Sequence[tuple[int, int]]) -> FloatArray:
    """Return the mean over each span, (n, ...) [unit].

    `x` (samples, ...): readings [unit]; `spans`: first sample of each and the sample after its last
    [1]. One by one: sums of a long log from its start would lose digits.
    """
    if not spans:
        return np.zeros((0, *x.shape[1:]))
    return np.array([x[a:b].mean(axis=0) for a, b in spans])


def require_finite(log: Log) -> None:
    """Refuse readings that are no numbers; raises ``session.not_finite``."""
    for what, x in (("accel", log.accel), ("gyro", log.gyro)):
        if x is None:
            continue
        bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
        if len(bad):
            raise error("session.not_finite", what=what, index=int(bad[0]))


def require_live_gyros(log: Log) -> None:
    """Refuse gyros that read one value while the accelerometers live: ``gyro.stuck``."""
    if log.gyro is None or log.accel is None or len(log) < 2:
        return
    if not np.ptp(log.gyro, axis=0).any() and np.ptp(log.accel, axis=0).any():
        values = ", ".join(f"{v:.6g}" for v in log.gyro[0])
        raise error("gyro.stuck", values=values)


# -- tables ----------------------------------------------------------------------------------------


def rest_levels(rests: Rests) -> FloatArray:
    """Return the median level of each rest, shape (n,); 1 is quiet [1]."""
    return np.array([np.nanmedian(rests.level[a:b]) for a, b in rests.spans])


def rest_table(log: Log, rests: Rests) -> dict[str, npt.NDArray[np.generic]]:
    """Return the columns first, last, start, end and means of "rests" in tables.toml."""
    out: dict[str, npt.NDArray[np.generic]] = {
        "first": rests.first,
        "last": rests.last,
        "start": log.time[rests.first],
        "end": log.time[rests.last - 1],
    }
    for name, x in (("accel", log.accel), ("gyro", log.gyro)):
        if x is not None:
            mean = means_of(x, rests.spans)
            out |= {f"{name}_{axis}": mean[:, i] for i, axis in enumerate(AXES)}
    return out


def detection_table(log: Log, rests: Rests, rows: int = 4000) -> dict[str, FloatArray]:
    """Return the table "detection" of the report: the levels, thinned, peaks kept.

    `rows`: largest number of rows [1].
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
