"""What an instrument said on a table: one mean per rest, and one per spin of the outer axis."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray
from foucault.errors import Finding
from foucault.models.noise import ImuNoise, TriadNoise, carried_rounding, rounding_bias
from foucault.models.session_noise import window_covariance


@dataclass(frozen=True)
class Readings:
    """Means over the positions of a session on a table."""

    # (n, 3) outer, middle and inner angle at the start, as the table or the plan says; NaN where
    # unknown [rad]
    angles: FloatArray
    # (n,) rate of the outer axis, counter-clockwise seen from above; 0 at rest [rad/s]
    rate: FloatArray
    turns: FloatArray  # (n,) turns that were averaged; whole for a spin, 0 at rest [1]
    # start, time: (n,) beginning and length of each average [s]
    start: FloatArray
    time: FloatArray
    accel: FloatArray | None  # (n, 3) mean specific force as measured, frame b [m/s^2]
    gyro: FloatArray | None  # (n, 3) mean rate w_ib_b as measured [rad/s]
    # accel_cov, gyro_cov: (n, 3, 3) covariance of the noise of these means [SI]
    accel_cov: FloatArray
    gyro_cov: FloatArray
    interval: float = 0.0  # sample interval of the log, 0 where it held means [s]
    # whether the rows of the log were means over their intervals, which carry rounding on
    increments: bool = False
    declared: bool = False  # whether the noise was declared, not measured
    findings: tuple[Finding, ...] = field(default=())  # what was noticed when they were made
    # bias instability and random walk that were declared: they are in the covariances, and tie the
    # readings together besides; None for none [SI]
    slow: ImuNoise | None = None

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def spin(self) -> BoolArray:
        """Which readings are spins, shape (n,)."""
        return np.asarray(self.rate != 0.0)

    @property
    def noise_unknown(self) -> bool:
        """Whether nothing but the residuals of a fit tells the noise."""
        return any(f.code == "readings.noise_unknown" for f in self.findings)

    @property
    def noise_from(self) -> Literal["declared", "measured", "unknown"]:
        """Where the noise is from."""
        if self.declared:
            return "declared"
        return "unknown" if self.noise_unknown else "measured"

    def __getitem__(self, rows: BoolArray | npt.NDArray[np.intp]) -> Readings:
        """Return some of the readings, by mask or by number."""
        names = ("angles", "rate", "turns", "start", "time", "accel_cov", "gyro_cov")
        some = {name: getattr(self, name)[rows] for name in names}
        accel = None if self.accel is None else self.accel[rows]
        gyro = None if self.gyro is None else self.gyro[rows]
        return replace(self, accel=accel, gyro=gyro, **some)

    def with_noise(self, noise: ImuNoise) -> Readings:
        """Return the same readings with the covariance that declared `noise` [SI] gives them.

        White noise and rounding average out. Bias instability and random walk do so hardly, and
        tie one reading to the next: see `wander`.
        """
        accel = mean_variance(noise.accel, self.time, self.interval, self.increments)
        gyro = mean_variance(noise.gyro, self.time, self.interval, self.increments)
        return replace(
            self,
            accel_cov=accel[:, None, None] * np.eye(3),
            gyro_cov=gyro[:, None, None] * np.eye(3),
            declared=True,
            findings=tuple(f for f in self.findings if f.code != "readings.noise_unknown"),
            slow=slow_part(noise),
        )

    def wander(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Return the covariance of the slow biases over all readings, as accel and gyro have them.

        Each shape (n, n), alike for the three axes [SI]; None where nothing slow was declared.
        """
        if self.slow is None:
            return None, None
        out = []
        for means, noise in ((self.accel, self.slow.accel), (self.gyro, self.slow.gyro)):
            none = means is None or not (noise.bias_instability or noise.random_walk)
            middle = self.start + self.time / 2
            out.append(None if none else wander(noise, middle, self.time))
        return out[0], out[1]

    def without_wander(self) -> Readings:
        """Return the same readings with the covariance of what is new in each of them alone."""
        if self.slow is None:
            return self
        quick = []
        for cov, noise in ((self.accel_cov, self.slow.accel), (self.gyro_cov, self.slow.gyro)):
            slow = wander_variance(noise, self.time)
            quick.append(cov - slow[:, None, None] * np.eye(3))
        return replace(self, accel_cov=quick[0], gyro_cov=quick[1])


def slow_part(noise: ImuNoise) -> ImuNoise | None:
    """Return bias instability and random walk alone, None where there is neither.

    `noise`: noise of the instrument [SI].
    """
    if not any(t.bias_instability or t.random_walk for t in (noise.accel, noise.gyro)):
        return None
    alone = (replace(t, white=0.0, quantisation=0.0) for t in (noise.accel, noise.gyro))
    return ImuNoise(*alone)


def wander(noise: TriadNoise, middle: FloatArray, time: FloatArray) -> FloatArray:
    """Return the covariance between means that declared wander of the bias makes, (n, n) [unit^2].

    The bias is the long-term one: a session that is shorter than the correlation time has one
    error of it in all its means, however many there are. A random walk starts with the first.
    Its part of the variance of each mean alone, which `Readings.accel_cov` or `gyro_cov` hold, is
    `wander_variance`.

    `noise`: noise of the triad [SI]; `middle` (n,): middle of each mean [s]; `time` (n,): length
    of each mean [s].
    """
    start = middle - time / 2
    first = float(start.min())
    return window_covariance(start - first, start - first + time, noise)


def wander_variance(noise: TriadNoise, time: FloatArray) -> FloatArray:
    """Return the variance of a mean by wander of the bias, each for itself, shape (n,) [unit^2].

    `noise`: noise of the triad [SI]; `time` (n,): length of each mean [s].
    """
    x = np.maximum(time / noise.correlation_time, 1e-6)
    markov = 2 * (x + np.expm1(-x)) / x**2
    return np.asarray(noise.bias_instability**2 * markov + noise.random_walk**2 * time / 3)


def mean_variance(
    noise: TriadNoise, time: FloatArray, interval: float, increments: bool = False
) -> FloatArray:
    """Return the variance of a mean, shape (n,) [unit^2].

    ``white^2 / T + B^2 m(T / T_c) + K^2 T / 3 + q^2 dt / (12 T) + rounding^2`` with
    ``m(x) = 2 (x - 1 + exp(-x)) / x^2``, the variance of the mean of a Markov process. Of
    increments the sum is rounded, and q adds ``2 (q dt)^2 / (12 T^2)`` alone.

    `noise`: noise of the triad [SI]; `time` (n,): length of each mean [s]; `interval`: sample
    interval, 0 where unknown [s]; `increments`: whether the samples are means over their
    intervals, which carry rounding on.
    """
    out = noise.white**2 / time + wander_variance(noise, time)
    if increments:
        out += 2 * carried_rounding(noise.quantisation, interval) / time**2
    elif interval > 0 and noise.quantisation > 0:
        out += noise.quantisation**2 * interval / (12 * time)
        out += rounding_bias(noise.quantisation, noise.white / np.sqrt(interval)) ** 2
    return np.asarray(np.maximum(out, 1e-24))
