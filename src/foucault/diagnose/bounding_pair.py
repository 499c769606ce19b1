"""White noise N and random walk K whose Allan curve bounds a measured one.

Most estimators know two noises, white noise and a random walk of the bias::

    sigma^2(tau) = N^2/tau + K^2 tau/3

An instrument has more: its bias instability is flat, and an N and K read off the slopes alone lie
below the curve where it is. Sought is the pair that lies above the curve between two averaging
times, as little as possible: N may rise by a third above that of the fit, K by whatever it takes.
For every N on a grid the K that just reaches the curve is known, as the variance is linear in K^2;
of these pairs the one is taken that is above the measured curve by least on the average of the
octaves.

The averaging times are the widest apart, the first of them 2 s or less, between which the pair is
nowhere more than three times the measured deviation. Below the first of them the curve may be
higher (quantisation, vibration), above the last it is unknown or higher (the receiver's walk too,
as its K goes on).

Reached is the curve of the noises that were fitted, and 0.95 of every deviation measured: single
ones scatter by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.allan import Channel, LogAllan

LEAST, MOST = 0.95, 3.0
"""The pair is nowhere below, nowhere above, this many times the measured deviation [1]."""

RISE = 4.0 / 3.0  # N may rise above that of the fit by this factor [1].
FIRST = 2.0  # The shortest averaging time bounded is this or less [s].
SPAN = 30.0  # The longest over the shortest averaging time bounded, at least [1].

UNSEEN = 1.1
"""Where no walk shows, the variance at the longest averaging time over that of N alone [1]."""

_STEPS = 65  # values of N that are tried


@dataclass(frozen=True)
class Pair:
    """White noise and random walk that bound a measured Allan curve."""

    white: float  # N [unit/sqrt(Hz)]
    walk: float  # K [unit/sqrt(s)]
    # first, last: averaging times between which it does [s]
    first: float
    last: float
    # least, most: its deviation over the measured one, between these times [1]
    least: float
    most: float
    raised: float  # N over the N of the fit [1]
    seen: bool  # whether the curve asks for a walk; else K adds a tenth of variance at its end

    def deviation(self, tau: FloatArray) -> FloatArray:
        """Return the deviations of the pair, shape (k,) [unit], at `tau` (k,) [s]."""
        return np.asarray(np.sqrt(self.white**2 / tau + self.walk**2 * tau / 3))


def bounding_pair(
    tau: FloatArray, deviation: FloatArray, curve: FloatArray, white: float
) -> Pair | None:
    """Return the pair that bounds a curve, None where no pair does over a factor of `SPAN`.

    `tau` (k,): averaging times in rising order [s]; `deviation`, `curve` (k,): measured and fitted
    [unit]; `white`: N of the fit [unit/sqrt(Hz)].
    """
    if white <= 0:  # hidden below the step of the output: what its curve has at the shortest times
        early = tau <= FIRST
        white = float(np.sqrt(tau[early] * deviation[early] ** 2).min(initial=np.inf))
        if not np.isfinite(white):
            return None
    ends = [
        (i, j)
        for i in range(len(tau))
        for j in range(i + 1, len(tau))
        if tau[i] <= FIRST and tau[j] >= SPAN * tau[i]
    ]
    # Of spans that are equally wide the one that reaches further up: slow noise is what harms.
    for i, j in sorted(ends, key=lambda e: (-tau[e[1]] / tau[e[0]], -tau[e[1]])):
        part = slice(i, j + 1)
        pair = _within(tau[part], deviation[part], curve[part], white)
        if pair is not None:
            return pair
    return None


def _within(tau: FloatArray, deviation: FloatArray, curve: FloatArray, white: float) -> Pair | None:
    reach = np.maximum(np.minimum(curve, deviation / LEAST) ** 2, (LEAST * deviation) ** 2)
    N2 = np.linspace(1.0, RISE**2, _STEPS) * white**2
    K2 = np.max(3 * (reach - N2[:, None] / tau) / tau, axis=1)
    seen = bool((K2 > 0).all())
    K2 = np.where(K2 > 0, K2, 3 * (UNSEEN - 1) * N2 / tau[-1] ** 2)
    ratio = np.sqrt(N2[:, None] / tau + K2[:, None] * tau / 3) / deviation
    fits = (ratio.max(axis=1) <= MOST) & (ratio.min(axis=1) >= LEAST * (1 - 1e-12))
    if not fits.any():
        return None
    best = int(np.where(fits, np.log(ratio).mean(axis=1), np.inf).argmin())
    N, K = float(np.sqrt(N2[best])), float(np.sqrt(K2[best]))
    return Pair(
        N, K, float(tau[0]), float(tau[-1]), float(ratio[best].min()), float(ratio[best].max()),
        N / white, seen,
    )  # fmt: skip


def pair_of(channels: Sequence[Channel]) -> Pair | None:
    """Return the pair that bounds the curves of all `channels`, of the same averaging times."""
    useful = channels[0].tau <= min(c.longest for c in channels)
    deviation = np.max([c.deviation for c in channels], axis=0)[useful]
    curve = np.max([c.curve for c in channels], axis=0)[useful]
    white = max(c.noise("white").value for c in channels)
    return bounding_pair(channels[0].tau[useful], deviation, curve, white)


def pairs(measured: LogAllan) -> dict[str, Pair | None]:
    """Return the pairs of each axis (``gyro.x``) and of all axes of each triad (``gyro``)."""
    channels = measured.channels
    triads = dict.fromkeys(name.split(".")[0] for name in channels)
    groups = {name: [c] for name, c in channels.items()} | {
        triad: [c for name, c in channels.items() if name.startswith(triad)] for triad in triads
    }
    return {
        name: pair_of(group) if group[0].kind == "overlapping" else None
        for name, group in groups.items()
    }
