"""A body in a hand, an IMU on it, and a tracking system that says where it is.

Angles and places are sums of a few oscillations whose frequencies and phases are drawn, so that
rates and accelerations are known exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.pose import PoseTable, Second
from foucault.models.rotation import body_rate, exp, matrix_of
from foucault.simulate.noise import sampled_log
from foucault.tables import Log, whole_samples

TONES = 6
"""Oscillations of each angle and place [1]."""

BAND = (0.15, 1.5)
"""Their frequencies [Hz]."""

ANGLE_SD, PLACE_SD = 0.5, 0.04
"""Root mean square of each angle [rad] and place [m] of a usual motion."""


@dataclass(frozen=True)
class HandMotion:
    """Oscillations: amplitudes, angular rates and phases of heading, pitch, roll, x, y, z."""

    size: FloatArray  # (6, k) [rad], [m]
    rate: FloatArray  # (6, k) [rad/s]
    phase: FloatArray  # (6, k) [rad]
    steady: float = 0.0  # rate of the heading beside that [rad/s]

    @classmethod
    def drawn(cls, name: str, vigour: float, rng: np.random.Generator) -> HandMotion:
        """Draw a motion, of all axes but where `name` says less.

        `vigour`: how fast against the usual one [1].
        """
        wide = np.repeat([ANGLE_SD, PLACE_SD], 3) * np.sqrt(2 / TONES)
        wide[1] *= 0.5  # pitch stays away from straight up
        moves = {"rotation only": (0, 1, 2), "one axis": (0,), "planar": (0, 3, 4),
                 "translation only": (3, 4, 5), "constant rate": ()}  # fmt: skip
        wide[[k for k in range(6) if k not in moves.get(name, range(6))]] = 0.0
        amplitude = wide[:, None] * rng.uniform(0.5, 1.5, (6, TONES))
        # As many oscillations as there are shares of the band, so that no two motions differ much.
        share = (np.arange(TONES) + rng.uniform(0, 1, (6, TONES))) / TONES
        frequency = BAND[0] + (BAND[1] - BAND[0]) * share
        return cls(amplitude, 2 * np.pi * frequency * vigour, rng.uniform(0, 2 * np.pi, (6, TONES)),
                   1.0 if name == "constant rate" else 0.0)  # fmt: skip

    def at(self, time: FloatArray, order: int = 0) -> FloatArray:
        """Return angles [rad] and places [m], or derivatives of `order` [1], shape (n, 6).

        `time` (n,): when [s].
        """
        argument = self.rate * time[:, None, None] + self.phase + order * np.pi / 2
        out = np.sum(self.size * self.rate**order * np.sin(argument), axis=2)
        out[:, 0] += self.steady * (time if order == 0 else 1.0 if order == 1 else 0.0)
        return np.asarray(out)

    def attitude(self, time: FloatArray) -> FloatArray:
        """Return C_lb, body to level axes, shape (n, 3, 3), at `time` (n,) [s]."""
        return matrix_of(*self.at(time)[:, :3].T)

    def rates(self, time: FloatArray) -> FloatArray:
        """Return the rate in body axes, shape (n, 3) [rad/s], at `time` (n,) [s]."""
        return body_rate(self.at(time)[:, :3], self.at(time, 1)[:, :3])

    def force(self, time: FloatArray, gravity: float) -> FloatArray:
        """Return the specific force in body axes, (n, 3); `time` (n,) [s]; `gravity` [m/s^2]."""
        pull = self.at(time, 2)[:, 3:] + [0.0, 0.0, gravity]
        return np.asarray(np.einsum("kji,kj->ki", self.attitude(time), pull))


@dataclass(frozen=True)
class Tracker:
    """A tracking system."""

    rate: float  # of its poses [Hz]
    position_sd: float  # [m]
    attitude_sd: float | None  # [rad]; None: position alone
    C_bm: FloatArray  # (3, 3) axes of the tracked body to those of the IMU [1]
    lever_b: FloatArray  # (3,) from the accelerometers to the tracked point [m]
    delay: float = 0.0  # what is added to a stamp gives the time of the IMU [s]
    drift: float = 0.0  # by how much the clock of the IMU is faster [1]
    tilt: tuple[float, float] = (0.0, 0.0)  # of its world about x and y [rad]
    outliers: float = 0.0  # part of the poses that are off by `far` [1]
    far: float = 0.05  # [m]
    lost: float = 0.0  # part of the poses that are lost, in stretches of a second [1]
    jitter: float = 0.0  # mean of a latency that is not stamped [s]
    base_b: FloatArray | None = None  # (3,) from the tracked point to a second antenna [m]

    def poses(self, motion: HandMotion, duration: float, rng: np.random.Generator) -> PoseTable:
        """Return what it says of a motion; `duration` [s]."""
        whole_samples(duration * self.rate)
        t = np.arange(0.0, duration, 1 / self.rate)
        t = t[(t > 0.2) & (t < duration - 0.2)]
        if self.lost:
            second = rng.uniform(size=int(duration) + 2) < self.lost
            t = t[~second[t.astype(int)]]
        whole_samples(len(t))  # else none is left of them
        stamp = t - self.delay
        stamp = stamp - self.drift * (stamp - (stamp[0] + stamp[-1]) / 2)
        seen = t - (rng.exponential(self.jitter, len(t)) if self.jitter else 0.0)
        C_vl = exp(np.array([*self.tilt, 0.0]))
        C_vb = C_vl @ motion.attitude(seen)
        place = motion.at(seen)[:, 3:] @ C_vl.T + C_vb @ self.lever_b
        p = place + self.position_sd * rng.standard_normal(place.shape)
        off = rng.uniform(size=len(t)) < self.outliers
        p[off] += self.far * rng.standard_normal((int(off.sum()), 3))
        if self.base_b is not None:
            other = place + C_vb @ self.base_b
            other = other + self.position_sd * rng.standard_normal(other.shape)
            return PoseTable(stamp, p, second=Second(other))
        if self.attitude_sd is None:
            return PoseTable(stamp, p)
        noise = self.attitude_sd * rng.standard_normal((len(t), 3))
        noise[off] *= 60.0 * self.far / 0.05
        q = quaternion(C_vb @ self.C_bm @ exp(noise))
        return PoseTable(stamp, p, q, "w x y z, body to world")


def quaternion(C: FloatArray) -> FloatArray:
    """Return quaternions, scalar first, shape (n, 4), of rotations `C` (n, 3, 3) [1]."""
    from foucault.models.rotation import log

    vector = log(C)
    half = np.linalg.norm(vector, axis=1)[:, None] / 2
    return np.column_stack([np.cos(half), vector / 2 * np.sinc(half / np.pi)])


def simulate_hand(
    motion: HandMotion, tracker: Tracker, *, duration: float, rate: float, model: ImuModel,
    noise: ImuNoise, late: float, gravity: float, rng: np.random.Generator,
) -> tuple[Log, PoseTable]:  # fmt: skip
    """Simulate an IMU and a tracking system.

    `duration` [s]; `rate` [Hz]; `noise`: of the IMU [SI]; `late`: how much later its accelerometers
    read than its gyros [s]; `gravity` [m/s^2].
    """

    def truth(time: FloatArray) -> tuple[FloatArray, FloatArray]:
        return motion.force(time - late, gravity), motion.rates(time)

    made: Callable[..., Log] = sampled_log
    count = whole_samples(duration * rate + 0.5)
    log = made(truth, samples=count, rate=rate, sampled="rate", model=model, noise=noise, rng=rng)
    return log, tracker.poses(motion, duration, rng)
