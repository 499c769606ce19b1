"""Allan variance of one channel: deviations, their confidence, and the noises they show.

The overlapping Allan variance at tau = m dt, from the phase x (integral of the rate y)::

    sigma^2(tau) = <(x_{i+2m} - 2 x_{i+m} + x_i)^2> / (2 tau^2)

The modified one averages the difference over m neighbours first, the Hadamard variance takes
third differences (and does not see a ramp). Each noise has its own slope::

    sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2

The noises are always fitted to the overlapping Allan variance; the other kinds are shown with the
curve that the same noises have there.

References
----------
.. [1] IEEE Std 952-1997, annex C.
.. [2] W. J. Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065, 2008, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.allan.covariance import SPAN, Kind, degrees_of_freedom, expected, norm
from foucault.errors import error, suggestion

KINDS: tuple[Kind, ...] = get_args(Kind)

LEAST = 256
"""Fewest samples: seven octaves for five noises [1]."""

USEFUL = 5.0
"""Fewest degrees of freedom of a useful tau: the deviation is known to 32 % (1 sd) [1]."""

NOISES = ("quantisation", "white", "bias_instability", "random_walk", "ramp")
"""The five noises, in the order of their slopes; keys of [noise] where it has them."""

WORDS = {
    "gyro": (
        "quantisation",
        "angle random walk",
        "bias instability",
        "rate random walk",
        "rate ramp",
    ),
    "accel": (
        "quantisation",
        "velocity random walk",
        "bias instability",
        "acceleration random walk",
        "acceleration ramp",
    ),
}
"""What people call them."""

UNIT_KINDS = {
    "gyro": ("angle increment", "angle random walk", "angular rate", *WORDS["gyro"][3:]),
    "accel": ("velocity increment", "velocity random walk", "specific force", *WORDS["accel"][3:]),
}
"""What they are measured in: keys of `units.KINDS`."""


@dataclass(frozen=True)
class Noise:
    """One of the five noises in one channel."""

    name: str
    # value, sd: Q [unit s], N [unit/sqrt(Hz)], B [unit], K [unit/sqrt(s)] or R [unit/s]; sd is NaN
    # where the value is zero
    value: float
    sd: float
    seen: bool  # whether the data show it
    # low, high: interval that holds the truth with a probability of 95 % [as value]. Of a noise not
    # seen, low is 0 and high the upper limit; infinite where the data set none
    low: float
    high: float


@dataclass(frozen=True)
class Channel:
    """The Allan deviations of one channel and what they show."""

    kind: Kind
    interval: float  # sample interval [s]
    samples: int  # number of samples [1]
    tau: FloatArray  # (k,) averaging times [s]
    # deviation, low, high: (k,) deviations and their 95 % interval [unit]
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    dof: FloatArray  # (k,) equivalent degrees of freedom for the noises fitted and the excess [1]
    curve: FloatArray  # (k,) deviations that the noises fitted have on average [unit]
    parts: FloatArray  # (5, k) the same of each noise alone [unit]
    noises: tuple[Noise, ...]  # the five noises, in the order of `NOISES`
    # relative scatter of the variances about the curve that noise does not explain [1]
    excess: float
    longest: float  # longest useful averaging time, `USEFUL` [s]

    def noise(self, name: str) -> Noise:
        """Return the noise `name`, one of `NOISES`."""
        return self.noises[NOISES.index(name)]


def octaves(samples: int) -> IntArray:
    """Return the averaging factors 1, 2, 4, ... up to a quarter of the record, shape (k,).

    `samples`: number of samples [1].
    """
    return np.asarray(2 ** np.arange(int(np.log2(max(samples, 4))) - 1), np.int64)


def deviations(
    rate: FloatArray,
    interval: float,
    factors: IntArray | None = None,
    kind: Kind = "overlapping",
) -> tuple[FloatArray, FloatArray]:
    """Compute deviations of one channel.

    Parameters
    ----------
    rate : ndarray, shape (n,)
        Readings, evenly spaced [unit].
    interval : float
        Sample interval [s].
    factors : ndarray of int, shape (k,), or None
        Averaging times in samples; None takes `octaves` [1].
    kind : {"overlapping", "modified", "hadamard"}
        Which deviation.

    Returns
    -------
    tau : ndarray, shape (k,)
        Averaging times [s].
    deviation : ndarray, shape (k,)
        Deviations [unit].

    Notes
    -----
    Needs twice the memory of `rate`: 1.6 GB for 1e8 samples.
    """
    m = octaves(len(rate)) if factors is None else np.asarray(factors, np.int64)
    deviation = np.sqrt(_variances(_phase(rate), m, check_kind(kind)))
    return np.asarray(m * interval, float), np.asarray(deviation)


def _phase(rate: FloatArray) -> FloatArray:
    from foucault.kernels import allan

    return np.asarray(allan.integrate(rate, float(rate.mean())))


def _variances(phase: FloatArray, m: IntArray, kind: Kind) -> FloatArray:
    from foucault.kernels import allan

    largest = (len(phase) - (kind != "modified")) // SPAN[kind]
    wrong = m[(m < 1) | (m > largest)]
    if len(wrong):
        raise error("allan.factor", given=wrong[0], samples=len(phase) - 1, largest=largest)
    return np.asarray(getattr(allan, kind)(phase, m) * norm(kind, m))


def measure(
    rate: FloatArray, interval: float, kind: Kind = "overlapping", axis: str = "the channel"
) -> Channel:
    """Compute the deviations of one channel and find the noises in them.

    `rate` (n,): readings at rest, evenly spaced [unit]; `interval`: sample interval [s].
    """
    from scipy.stats import chi2

    from foucault.diagnose.allan.fit import CONFIDENCE, fit

    check(rate, interval, axis)
    n, m = len(rate), octaves(len(rate))
    phase = _phase(rate)
    allan = _variances(phase, m, "overlapping")
    found = fit(allan, n, m)
    shown = allan if kind == "overlapping" else _variances(phase, m, kind)
    # A ramp alone has no degrees of freedom: a trace of white noise, far below rounding, has.
    random = np.maximum(found.p, [0, 1e-12 * allan[0], 0, 0, 0])
    by_noise = degrees_of_freedom(kind, n, m, random)
    dof = 2 / (2 / by_noise + found.excess**2)
    edge = (1 + CONFIDENCE) / 2
    parts = expected(kind, m) * found.p
    # From units of one sample interval to seconds.
    scale = interval ** np.array([1.0, 0.5, 0.0, -0.5, -1.0])
    value = np.sqrt(found.p)
    sd = found.sd / (2 * np.where(value > 0, value, np.nan))
    columns = (value * scale, sd * scale, found.seen, np.sqrt(found.low) * scale,
               np.sqrt(found.high) * scale)  # fmt: skip
    return Channel(
        kind=kind,
        interval=interval,
        samples=n,
        tau=np.asarray(m * interval, float),
        deviation=np.sqrt(shown),
        low=np.sqrt(shown * dof / chi2.ppf(edge, dof)),
        high=np.sqrt(shown * dof / chi2.ppf(1 - edge, dof)),
        dof=dof,
        curve=np.sqrt(parts.sum(axis=1)),
        parts=np.sqrt(parts.T),
        noises=tuple(
            Noise(name, float(v), float(s), bool(seen), float(low), float(high))
            for name, v, s, seen, low, high in zip(NOISES, *columns, strict=True)
        ),
        excess=found.excess,
        longest=float(interval * m[by_noise >= USEFUL][-1]),
    )


def check_kind(given: str) -> Kind:
    """Return `given` as a kind of deviation, or raise what the kinds are."""
    for kind in KINDS:
        if given == kind:
            return kind
    hint = suggestion(given, KINDS)
    raise error("allan.kind", given=given, allowed=", ".join(KINDS), hint=hint)


def check(rate: FloatArray, interval: float, axis: str = "the channel") -> None:
    """Raise what makes an Allan variance of a channel impossible.

    `rate` (n,): readings [unit]; `interval`: sample interval [s].
    """
    if len(rate) < LEAST:
        duration = f"{len(rate) * interval:.4g}"
        raise error("allan.too_short", samples=len(rate), duration=duration, least=LEAST)
    # A sum is finite only if every term is: no mask for the usual case.
    if not np.isfinite(rate.sum()):
        wrong = np.flatnonzero(~np.isfinite(rate))
        raise error("allan.not_finite", axis=axis, count=len(wrong), row=wrong[0])
    if rate.min() == rate.max():
        raise error("allan.constant", axis=axis)
