"""Hold the noise that was declared against the noise that the rests of a log show.

A filter is as sure as its noise lets it be. Where what is measured is far larger than the noise of
the sensors (a velocity at rest, to a tenth of a millimetre per second) its innovations show neither
too small a noise nor single samples that are far off; the readings at rest do, before any model.

The power of means over a time T is that of successive differences, blind to what is slower than T:

    psd(T) = T <(m_k+1 - m_k)^2> / 2

Rounding and vibration fade with T where white noise does not, so that it is judged by the least of
two such times, a fifth of a second and a longer one, a rest having several. Counts that an
instrument adds up carry their rounding to the next reading; the white noise beside it stands in the
spectrum (`diagnose.carried`), and where that is less it is what counts. Of successive means that
rounding, of variance v, makes 3 v/T.

References
----------
.. [1] J. von Neumann, "Distribution of the ratio of the mean square successive difference to the
   variance", Annals of Mathematical Statistics 12(4), 1941 (two thirds of the degrees of freedom).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.diagnose.carried import white_and_carried
from foucault.diagnose.rests import resolution
from foucault.diagnose.words import check
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.result import Check
from foucault.tables import AXES, Log

SHORT = 0.2
"""Means over so long show white noise above rounding [s]."""

SEVERAL = 16
"""A rest has at least so many of the longer means [1]."""

FEW = 30
"""Fewer differences than this tell too little of noise [1]."""

UNLIKE = 1.5
"""Noise of more than this times the power that was declared is not the noise that was declared; up
to it the noise that is seen is used, and that is enough [1]."""


@dataclass(frozen=True)
class SeenNoise:
    """The noise of one triad at rest beside what was declared."""

    triad: str
    white: float  # white noise seen, outlying samples included, mean of the axes [unit/sqrt(Hz)]
    # power seen over power declared, of the axis where it is largest; 1 where none was declared or
    # what is seen is not significantly larger [1]
    ratio: float
    axis: str
    # samples, outliers: samples at rest, and how many lie farther off than any would by chance [1]
    samples: int
    outliers: int
    # share of the power, on the axis where it is largest, that the outlying samples make [1]
    part: float
    # axis, time [s] and size in standard deviations [1] of the farthest sample
    worst: tuple[str, float, float]


@dataclass(frozen=True)
class NoiseAtRest:
    """The noise to use, and what is to be said of it."""

    noise: ImuNoise  # as declared, or as the rests show where that is more [SI]
    seen: tuple[SeenNoise, ...]

    @property
    def check(self) -> Check:
        """The check `noise`: is it as it was declared?"""
        worst = max(self.seen, key=lambda s: s.ratio)
        given = {
            "triad": worst.triad, "axis": worst.axis, "ratio": np.sqrt(worst.ratio),
            "cause": _cause(worst),
        }  # fmt: skip
        key = "noise seen at rest" if worst.ratio > 1.0 else "noise at rest"
        return check(key, "noise", worst.ratio, None, UNLIKE, given)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Outlying samples, counted."""
        out = []
        for s in self.seen:
            if s.outliers:
                axis, time, size = s.worst
                out.append(finding(
                    "rest.outliers", triad=s.triad, count=s.outliers, samples=s.samples,
                    share=f"{100 * s.outliers / s.samples:.2g}", axis=axis, time=f"{time:.6g}",
                    size=f"{size:.3g}", part=f"{100 * s.part:.0f}",
                ))  # fmt: skip
        return tuple(out)


def _cause(s: SeenNoise) -> str:
    if s.part > 0.5:
        return (
            f"{s.outliers} of {s.samples} samples are outlying and make {100 * s.part:.0f} % of "
            "its power"
        )
    return "the sensor is noisier than that, or what it stands on shakes"


def noise_at_rest(
    log: Log, rests: Sequence[tuple[int, int]], declared: ImuNoise | None
) -> NoiseAtRest:
    """Return the noise to use: what was declared, or what is seen where that is more.

    `log`: readings of both triads [SI]; `rests`: first sample of each rest and the sample after
    its last [1]; `declared`: noise as declared [SI], None takes what is seen.
    """
    assert log.gyro is not None and log.accel is not None
    said = declared or ImuNoise()
    seen = tuple(
        _seen(name, x, log, rests, None if declared is None else triad)
        for name, x, triad in (("gyro", log.gyro, said.gyro), ("accel", log.accel, said.accel))
    )
    used = {
        s.triad: replace(triad, white=max(triad.white, s.white))
        if declared is None or s.ratio > 1.0 else triad
        for s, triad in zip(seen, (said.gyro, said.accel), strict=True)
    }  # fmt: skip
    return NoiseAtRest(ImuNoise(accel=used["accel"], gyro=used["gyro"]), seen)


def _seen(
    name: str,
    x: FloatArray,
    log: Log,
    rests: Sequence[tuple[int, int]],
    declared: TriadNoise | None,
) -> SeenNoise:
    from scipy.special import chdtri, fdtri

    interval, counted = log.interval, log.sampled == "increment"
    out, sd = outlying(x, rests)
    rows = np.concatenate([np.arange(a, b) for a, b in rests])
    shortest = min(b - a for a, b in rests)
    short = max(1, round(SHORT / interval))
    long = max(short, shortest // SEVERAL)
    inside = np.where(out, _medians(x, rests), x)
    # A rounded sum is off by less than one step.
    steps = [resolution(column) * interval if counted else 0.0 for column in x[rows].T]
    carried = np.square(steps) / 12
    best, before = (np.full(3, np.inf), np.ones(3), np.zeros(3)), 0
    for size in sorted({short, long}):
        psd, count = successive(x, rests, size)
        if count < FEW:
            continue
        psd = psd * interval
        rounding = 3 * carried / (size * interval)
        expected = np.zeros(3)
        if declared is not None:
            expected += _power(declared, interval, size, counted)
        limit = float(chdtri(2 * count / 3, FALSE_ALARM / 12)) / (2 * count / 3)
        over = np.ones(3)
        more = psd > limit * (expected + rounding)
        np.divide(psd - rounding, expected, out=over, where=more & (expected > 0))
        over = np.maximum(over, 1.0)
        # The longer means are fewer: they count where they are calmer for sure.
        surely = fdtri(2 * before / 3, 2 * count / 3, 1 - FALSE_ALARM / 6) if before else 1.0
        calmer, before = psd * surely < best[0], count
        kept, _ = successive(inside, rests, size)  # what samples within leave of it
        part = 1.0 - kept * interval / np.maximum(psd, 1e-300)
        best = tuple(  # type: ignore[assignment]
            np.where(calmer, new, old) for new, old in zip((psd, over, part), best, strict=True)
        )
    psd, ratio, part = best
    if counted:
        # The spectrum is that of most lines and rests; outlying samples are noise beside it.
        white = white_beside_rounding(x, rests, interval)
        white = np.where(white > 0, white + np.maximum(part, 0.0) * psd, 0.0)
        if declared is not None and declared.white > 0:
            ratio = np.maximum(np.minimum(ratio, white / declared.white**2), 1.0)
        psd = np.where(white > 0, np.minimum(psd, white), psd)
    if not np.isfinite(psd).all() or (declared is not None and not declared.white > 0):
        psd, ratio, part = np.where(np.isfinite(psd), psd, 0.0), np.ones(3), np.zeros(3)
    k = int(np.argmax(ratio if ratio.max() > 1.0 else part))
    far = np.abs(x - _medians(x, rests))[rows] / np.where(sd > 0, sd, np.inf)
    row, axis = (int(v) for v in np.unravel_index(int(np.argmax(far)), far.shape))
    return SeenNoise(
        name, float(np.sqrt(psd.mean())), float(ratio[k]), AXES[k], 3 * len(rows),
        int(out.sum()), float(max(part[k], 0.0)),
        (f"{name}_{AXES[axis]}", float(log.time[rows[row]]), float(far[row, axis])),
    )  # fmt: skip


def white_beside_rounding(
    x: FloatArray, rests: Sequence[tuple[int, int]], interval: float
) -> FloatArray:
    """Return the density of white noise beside carried rounding, 0 where it does not show, (3,).

    `x` (n, 3): increments, as rates [unit]; `rests`: first sample of each rest and the sample
    after its last [1]; `interval`: sample interval [s].
    """
    size = max(1, round(SHORT / interval))
    parts = [x[a : a + (b - a) // size * size].reshape(-1, size, 3).mean(axis=1) for a, b in rests]
    return white_and_carried(parts, size * interval)[0]


def _power(noise: TriadNoise, interval: float, size: int, counted: bool) -> float:
    """Return the power that successive differences of means over `size` samples should have."""
    T = size * interval
    slow = noise.random_walk**2 + 2 * noise.bias_instability**2 / noise.correlation_time
    rounding = 0.0 if counted else noise.quantisation**2 / 12 * interval
    return noise.white**2 + rounding + slow * T**2 / 3


def successive(
    x: FloatArray, rests: Sequence[tuple[int, int]], size: int
) -> tuple[FloatArray, int]:
    """Return half the mean square difference of successive means, times their size.

    `x` (n, 3): readings [unit]; `rests`: first sample of each rest and the sample after its last
    [1]; `size`: samples of a mean [1]. Returns `power` (3,): the variance of one sample where
    noise is white [unit^2]; `count`: number of differences [1].
    """
    total, count = np.zeros(3), 0
    for a, b in rests:
        n = (b - a) // size
        means = x[a : a + n * size].reshape(n, size, 3).mean(axis=1)
        total += (np.diff(means, axis=0) ** 2).sum(axis=0) / 2 * size
        count += max(n - 1, 0)
    return total / max(count, 1), count


def _medians(x: FloatArray, rests: Sequence[tuple[int, int]]) -> FloatArray:
    """Return the readings with each rest at its median, shape (n, 3)."""
    out = x.copy()
    for a, b in rests:
        out[a:b] = np.median(x[a:b], axis=0)
    return out


def outlying(x: FloatArray, rests: Sequence[tuple[int, int]]) -> tuple[BoolArray, FloatArray]:
    """Find the samples at rest that lie farther from its median than any would by chance.

    `x` (n, 3): readings [unit]; `rests`: first sample of each rest and the sample after its last
    [1]. Returns `out` (n, 3): those samples; none in turns; `sd` (3,): standard deviation of the
    others, by the median of their size [unit].
    """
    from scipy.special import ndtri

    rows = np.concatenate([np.arange(a, b) for a, b in rests])
    size = np.abs(x - _medians(x, rests))
    sd = 1.4826 * np.median(size[rows], axis=0)
    limit = -float(ndtri(FALSE_ALARM / (2 * 3 * len(rows))))
    out = np.zeros(x.shape, bool)
    # Where most samples are one value, steps of the output are no outliers.
    out[rows] = (size[rows] > limit * sd) & (sd > 0)
    return out, sd
