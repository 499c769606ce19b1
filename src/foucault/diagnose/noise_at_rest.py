"""Hold the noise that was declared against the noise that the rests of a log show.

A filter is as sure as its noise lets it be. Where what is measured is far larger than the noise of
the sensors (a velocity at rest, to a tenth of a millimetre per second) its innovations show neither
too small a noise nor single samples that are far off; the readings at rest do, before any model.

The power of means over a time T is that of successive differences (`detect.noise`). Rounding and
vibration fade with T where white noise does not, so that it is judged by the least of two such
times, a fifth of a second and a longer one, a rest having several. Counts that an instrument adds
up carry their rounding to the next reading; the white noise beside it stands in the spectrum, and
where that is less it is what counts. Of successive means that rounding, of variance v, makes 3 v/T.

A rest in which people walk about or the wind blows tells less of white noise (`white_noise`): the
k-th differences of successive means over tau see white noise of density N^2 with the variance
``C(2k, k) N^2 / tau``, and a sway of angular frequency w by ``(2 sin(w tau / 2))^k`` of its size
only: of slow motion little is left in high differences at short tau. Where two averaging times an
octave apart show the same density, the noise is white there. Rounding and dither raise the short
tau, motion the long ones, so what is smallest is taken.

Limits: a noise that a filter in the sensor takes away at high frequency is found too small where
the rest sways, and motion as fast as the samples cannot be told from noise. `RestNoise.clear`
says whether first differences alone, the Allan variance, were enough.

References
----------
.. [1] W. J. Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065, 2008, section 5.2
   (the Allan variance has first differences of the rate, the Hadamard variance second ones).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.noise import SHORT, blocks, resolution, successive, white_and_carried
from foucault.diagnose.checks import check
from foucault.errors import Finding, finding
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.noise import QUIETEST, ImuNoise, TriadNoise
from foucault.result import Check
from foucault.tables import AXES, Log
from foucault.units import convert

SEVERAL = 16  # A rest has at least so many of the longer means [1].
FEW = 30  # Fewer differences than this tell too little of noise [1].

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
    """Return the noise [SI] that was `declared`, or what the `rests` show where more."""
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
    middle = _medians(x, rests)
    inside = np.where(out, middle, x)
    # A rounded sum is off by less than one step.
    steps = [resolution(column) * interval if counted else 0.0 for column in x[rows].T]
    carried = np.square(steps) / 12
    best, before = (np.full(3, np.inf), np.ones(3), np.zeros(3)), 0
    for size in sorted({short, long}):
        psd, count = successive(blocks(x, rests, size), size * interval)
        if count < FEW:
            continue
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
        kept, _ = successive(blocks(inside, rests, size), size * interval)  # of samples within
        part = 1.0 - kept / np.maximum(psd, 1e-300)
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
    far = np.abs(x - middle)[rows] / np.where(sd > 0, sd, np.inf)
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
    return white_and_carried(blocks(x, rests, size), size * interval)[0]


def _power(noise: TriadNoise, interval: float, size: int, counted: bool) -> float:
    """Return the power that successive differences of means over `size` samples should have."""
    T = size * interval
    slow = noise.random_walk**2 + 2 * noise.bias_instability**2 / noise.correlation_time
    rounding = 0.0 if counted else noise.quantisation**2 / 12 * interval
    return noise.white**2 + rounding + slow * T**2 / 3


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


BLOCKS = 16  # A rest holds so many of the longest averaging time [1].
FEWEST = BLOCKS  # Fewer samples tell nothing of the noise [1].
ORDERS = 6  # Highest difference [1].
FLAT = 1.2  # Densities an octave apart that differ by less, or by chance, are the same [1].


SURE = 4.0  # A density is surely not larger than by this many standard deviations [1].
BESIDE = 4.0  # Rounding or dither of a larger share of the first samples hides the noise [1].


@dataclass(frozen=True)
class RestNoise:
    """White noise of one triad."""

    white: float  # root of its density, all axes together [SI/sqrt(Hz)]
    clear: bool  # whether the Allan variance shows it, without motion or rounding beside it


def noise_of(rest: Log) -> tuple[ImuNoise, tuple[Finding, ...]]:
    """Measure the white noise of both triads in a rest [SI], and say where it is not clear."""
    assert rest.accel is not None
    assert rest.gyro is not None
    counted = rest.sampled == "increment"
    accel, gyro = (white_noise(x, rest.interval, counted) for x in (rest.accel, rest.gyro))
    noise = ImuNoise(TriadNoise(white=accel.white), TriadNoise(white=gyro.white))
    if accel.clear and gyro.clear:
        return noise, ()
    of_gyro = convert(gyro.white, "angle random walk", "deg/sqrt(h)")
    of_accel = convert(accel.white, "velocity random walk", "ug/sqrt(Hz)")
    return noise, (finding("alignment.noise", gyro=f"{of_gyro:.2g}", accel=f"{of_accel:.2g}"),)


def held_against(rest: Log, declared: ImuNoise, least: ImuNoise) -> NoiseAtRest:
    """Hold the noise that was declared against a rest that may sway.

    Sway and dither scatter the readings as noise does. Noise beyond what was declared is what
    differences that are blind to them show too.

    `least`: noise by `noise_of` [SI].
    """
    plain = noise_at_rest(rest, [(0, len(rest))], declared)
    seen, used = [], {}
    for s in plain.seen:
        said = getattr(declared, s.triad)
        most: float = min(s.white, getattr(least, s.triad).white)
        ratio: float = min(s.ratio, (most / said.white) ** 2) if said.white > 0 else 1.0
        seen.append(replace(s, white=most, ratio=max(ratio, 1.0)))
        used[s.triad] = replace(said, white=most) if ratio > 1.0 else said
    return NoiseAtRest(ImuNoise(accel=used["accel"], gyro=used["gyro"]), tuple(seen))


def white_noise(x: FloatArray, interval: float, counted: bool = False) -> RestNoise:
    """Measure the white noise of `x` (n, 3) [SI], each `interval` [s]; `counted`: increments."""
    sizes = 2 ** np.arange(max(1, int(np.log2(max(len(x) / BLOCKS, 1))) + 1))
    orders = range(1, ORDERS + 1)
    psd = np.array([[_density(x, int(n), k, interval) for n in sizes] for k in orders])
    part = np.array([[_relative_sd(len(x) // int(n), k) for n in sizes] for k in orders])
    surely = psd * (1 + SURE * part)
    apart = np.abs(np.diff(psd, axis=1))
    chance = 3 * np.hypot(psd[:, 1:] * part[:, 1:], psd[:, :-1] * part[:, :-1])
    flat = np.zeros(psd.shape, bool)
    flat[:, :-1] = apart <= np.maximum((FLAT - 1) * psd[:, :-1], chance)
    # Of first differences the smallest bounds the noise, whether it is flat there or not.
    bound = int(np.argmin(surely[0]))
    usable = flat.copy()
    usable[0, bound] = True
    least = np.min(surely[usable])
    # Of those that may be the smallest the surest one: the smallest itself is so by chance too.
    usable &= psd * (1 - 3 * part) <= least
    k, n = np.unravel_index(np.argmin(np.where(usable, part, np.inf)), psd.shape)
    clear = k == 0 and flat[0, n] and psd[0, 0] < BESIDE * psd[0, n]
    if not clear and (k == 0 or psd[k, n] > psd[0, bound]):
        k, n = np.intp(0), np.intp(bound)
    white = float(np.sqrt(psd[k, n]))
    if counted:  # carried rounding is in all differences, and apart in the spectrum
        beside = float(np.sqrt(white_beside_rounding(x, [(0, len(x))], interval).mean()))
        white = min(white, beside) if beside > 0 else white
    return RestNoise(white, bool(clear) or float(np.sqrt(surely[0, bound])) < QUIETEST)


def _density(x: FloatArray, block: int, order: int, interval: float) -> float:
    """Return the density that differences of means of `block` samples show, all axes together."""
    count = len(x) // block
    means = x[len(x) - count * block :].reshape(count, block, -1).mean(axis=1)
    power = float(np.mean(np.diff(means, n=order, axis=0) ** 2)) / comb(2 * order, order)
    return power * block * interval


def _relative_sd(count: int, order: int) -> float:
    """Return the relative sd of such a density, from `count` means on three axes."""
    alike = comb(4 * order, 2 * order) / comb(2 * order, order) ** 2
    return float(np.sqrt(2 * alike / (3 * max(count - order, 1))))
