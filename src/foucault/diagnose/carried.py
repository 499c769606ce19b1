"""White noise and carried rounding of a sensor that integrates, apart.

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
.. [1] IEEE Std 952-1997, annex C, eq. (C.15) ff. (quantisation noise, Q^2 = v).
.. [2] P. Whittle, "Estimation and information in stationary time series", Arkiv for Matematik
   2(23), 1953 (the likelihood of a periodogram).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from foucault.arrays import FloatArray

PER_OCTAVE = 8
"""Lines of the spectrum are joined, so many groups an octave. Of each the median counts: pulses
that come evenly, dither and engines stand in single lines [1]."""

SLOW = 10.83
"""Slow motion is told from white noise at this likelihood ratio: 1 in 1000 [1]."""

FEWER = 6.63
"""Less carried rounding than the counts make is told at this likelihood ratio: 1 in 100 [1]."""

PASSES = 50
"""Most times that the lines are weighed by what was found of them [1]."""


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

    freely, counted = best(0.0), best(least)
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
