"""White noise of a sensor from a rest in which people walk about or the wind blows.

The k-th differences of successive means over tau see white noise of density N^2 with the variance
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

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.noise_at_rest import NoiseAtRest, noise_at_rest, white_beside_rounding
from foucault.errors import Finding, finding
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.session_noise import QUIETEST
from foucault.tables import Log
from foucault.units import convert

BLOCKS = 16
"""A rest holds so many of the longest averaging time [1]."""

FEWEST = BLOCKS
"""Fewer samples tell nothing of the noise [1]."""

ORDERS = 6
"""Highest difference [1]."""

FLAT = 1.2
"""Densities an octave apart that differ by less, or by chance, are the same [1]."""


SURE = 4.0
"""A density is surely not larger than by this many standard deviations [1]."""

BESIDE = 4.0
"""Rounding or dither of a larger share of the first samples hides the noise [1]."""


@dataclass(frozen=True)
class RestNoise:
    """White noise of one triad."""

    white: float  # root of its density, all axes together [SI/sqrt(Hz)]
    clear: bool  # whether the Allan variance shows it, without motion or rounding beside it


def noise_of(rest: Log) -> tuple[ImuNoise, tuple[Finding, ...]]:
    """Measure the white noise of both triads, and say where it is not clear.

    `rest`: the part of a log that rests [SI].
    """
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

    `rest`: the part of a log that rests [SI]; `declared`: noise as declared [SI]; `least`: noise
    by `noise_of` [SI].
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
    """Measure the white noise of a triad at rest.

    `x` (n, 3): readings of the rest [SI]; `interval`: sample interval [s]; `counted`: whether
    readings are increments, whose rounding is carried to the next one.
    """
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
