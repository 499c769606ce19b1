"""Noise of what a session of rests and turns observes.

White noise makes the observations independent, one 3 x 3 block each. Bias instability and
random walk tie them together: the bias averaged over one rest or turn is correlated with the
bias over every other, and their covariance matrix is known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.noise import ImuNoise, TriadNoise, carried_rounding, rounding_bias

QUIET_ENDS = 0.6
"""About how long a turn between two detected rests is still quiet, both ends together [s]."""

QUIETEST = 1e-9
"""Least white noise, [m/s^2/sqrt(Hz)] and [rad/s/sqrt(Hz)]: below what any instrument has, and far
enough above rounding that the estimation of a noise-free log settles."""


@dataclass(frozen=True)
class SessionNoise:
    """The noise of the readings of a session."""

    # accel_psd, gyro_psd: (3,) white noise power that acts on the mean of a rest [unit^2 s]
    accel_psd: FloatArray
    gyro_psd: FloatArray
    # (3,) white noise power that the integration over a turn adds up [rad^2/s]
    turn_psd: FloatArray
    slow: ImuNoise  # bias instability and random walk; its white part is not used here
    # accel_rounding, gyro_rounding: (3,) constant error of rounding in the mean of a rest [unit]:
    # another one in every rest for the accelerometers, the same in all rests for the gyros, which
    # always read their bias
    accel_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    # accel_carried, gyro_carried: (3,) variance of the sum of increments at an instant, whose
    # rounding goes on to the next reading: it counts at both ends of a rest or turn [unit^2 s^2]
    accel_carried: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_carried: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("accel_psd", "gyro_psd", "turn_psd"):
            object.__setattr__(self, name, np.maximum(getattr(self, name), QUIETEST**2))

    @classmethod
    def declared(cls, noise: ImuNoise, interval: float, increments: bool = False) -> SessionNoise:
        """Take the noise as declared; rounding to steps acts as white noise, but of increments.

        `noise`: declared noise [SI]; `interval`: sample interval [s]; `increments`: whether the
        samples are means over their intervals, which carry rounding on.
        """

        def carried(triad: TriadNoise) -> FloatArray:
            return np.full(3, carried_rounding(triad.quantisation, interval))

        if increments:
            white = [np.full(3, triad.white**2) for triad in (noise.accel, noise.gyro)]
            return cls(
                white[0], white[1], white[1], noise,
                accel_carried=carried(noise.accel), gyro_carried=carried(noise.gyro),
            )  # fmt: skip

        def psd(triad: TriadNoise) -> FloatArray:
            return np.full(3, triad.white**2 + triad.quantisation**2 / 12 * interval)

        def rounding(triad: TriadNoise) -> FloatArray:
            sd = triad.white / np.sqrt(interval)
            return np.full(3, rounding_bias(triad.quantisation, sd))

        return cls(
            psd(noise.accel), psd(noise.gyro), psd(noise.gyro), noise,
            accel_rounding=rounding(noise.accel), gyro_rounding=rounding(noise.gyro),
        )  # fmt: skip


def window_covariance(start: FloatArray, end: FloatArray, noise: TriadNoise) -> FloatArray:
    """Return the covariance of the slow bias averaged over windows that do not overlap.

    Markov part, with tau the correlation time and T the lengths: ``s^2 2 tau/T (1 - tau/T
    (1 - exp(-T/tau)))`` on the diagonal, and off it ``s^2`` times the product of the averages
    of the two exponentials. Random walk: ``q^2 (t + T/3)`` on the diagonal, ``q^2`` times the
    middle of the earlier window off it (the bias of the model is the value at time zero).

    `start`, `end` (m,): ends of the windows, counted from the start of the log [s]; `noise`: bias
    instability, correlation time and random walk [SI]. Returns (m, m): covariance [unit^2].
    """
    T = np.maximum(end - start, 1e-9)
    mid = (start + end) / 2
    tau = noise.correlation_time
    x = T / tau
    gap = np.abs(mid[:, None] - mid[None, :]) / tau
    # exp(-gap) sinh(x/2)/(x/2) for each window, kept from overflowing at long windows.
    shape = -np.expm1(-x) / x
    between = np.maximum(gap - (x[:, None] + x[None, :]) / 2, 0.0)
    markov = np.exp(-between) * np.outer(shape, shape)
    small = x < 1e-4
    own = 2 / x * (1 - shape)
    np.fill_diagonal(markov, np.where(small, 1 - x / 3, own))
    walk = np.minimum(mid[:, None], mid[None, :])
    np.fill_diagonal(walk, start + T / 3)
    return np.asarray(noise.bias_instability**2 * markov + noise.random_walk**2 * walk)
