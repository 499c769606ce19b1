"""Spins: stretches of a log in which the instrument turned steadily about one axis.

Whether gravity turned in the body with it, as about a level axis, `frequency` and `plane` say by
the accelerometers alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.noise import resolution
from foucault.tables import Log, usual_step
from foucault.units import plain

TURNS = 2.0  # Fewer turns are no spin [1].
STEADY = 0.3  # A spin keeps its rate to this share [1].

WIDE, EVEN = 8.0, 0.03
"""What is no ramp keeps to so many times the median spread, or to this share [1]."""

STRAIGHT = np.radians(10.0)  # A spin keeps its axis to this angle [rad].
FINE = 0.12  # Samples are averaged where they are finer than this angle of the spin [rad].


@dataclass(frozen=True)
class Spin:
    """A stretch of a log in which the instrument turned steadily."""

    time: FloatArray  # (n,) [s]
    readings: FloatArray  # (n, 6) accelerometers [m/s^2], gyros [rad/s]
    many: int  # samples that a reading is the mean of [1]
    interval: float  # from a sample to the next [s]
    summed: bool  # whether a sample is the mean over its interval
    mounting: int = 0  # number of its mounting [1]
    rate: float = 0.0  # mean, about the axis of its mounting [rad/s]
    # (6,) what is rounded of a reading, sd; of an axis that reads one value too [m/s^2, rad/s]
    rounding: FloatArray = field(default_factory=lambda: np.zeros(6))

    @cached_property
    def step(self) -> float:
        """Time from a reading to the next [s]."""
        return usual_step(np.diff(self.time))

    @property
    def turns(self) -> float:
        """How often it went round [1]."""
        return abs(self.rate) * float(np.ptp(self.time)) / (2 * np.pi)

    def shrunk(self, w: FloatArray) -> FloatArray:
        """Return by how much means are shorter than what turns at `w` (n,) [rad/s], (n,) [1]."""
        x = np.abs(w) * self.interval / 2
        inner = x if self.summed else np.sin(x)
        return np.sin(self.many * x) / np.maximum(self.many * inner, 1e-300)


def find_spins(log: Log, shortest: float, slowest: float) -> list[Spin]:
    """Return the stretches of a log that are spins, in their order.

    `shortest`: time of a spin [s]; `slowest`: rate of one [rad/s].
    """
    assert log.accel is not None
    assert log.gyro is not None
    width = max(round(0.25 / log.interval), 1)
    w = _moving_mean(log.gyro, width)
    speed = np.linalg.norm(w, axis=1)
    # A change of sense, of axis or a gap ends a stretch.
    back = np.roll(w, width, axis=0)
    bent = np.einsum("ni,ni->n", w, back) < np.cos(STRAIGHT) * speed * np.linalg.norm(back, axis=1)
    bent[:width] = False
    ends = np.concatenate([[False], np.diff(log.time) > 5 * log.interval])
    fast = (speed > slowest) & ~bent & ~ends
    steps = np.array([resolution(c) for x in (log.accel, log.gyro) for c in x.T])
    out = []
    for a, b in _runs(fast):
        for begin, end in _steady(speed[a:b], a, width):
            n = end - begin
            if n < 10:
                continue
            axis = w[begin:end].mean(axis=0)
            size = float(np.linalg.norm(axis))
            off = np.linalg.norm(np.cross(w[begin:end], axis), axis=1)
            kept = off < np.sin(STRAIGHT) * size * speed[begin:end]
            if n * log.interval < shortest or kept.mean() < 0.98:
                continue
            if size * n * log.interval < TURNS * 2 * np.pi:
                continue
            out.append(_spin(log, begin, end, size, steps))
    return out


def _moving_mean(x: FloatArray, width: int) -> FloatArray:
    """Return the mean of `x` (n, q) over `width` rows about each, the first and last repeated."""
    before = width // 2
    padded = np.pad(x, ((before + 1, width - 1 - before), (0, 0)), mode="edge")
    total = np.cumsum(padded, axis=0)
    return np.asarray((total[width:] - total[:-width]) / width)


def _runs(inside: BoolArray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _steady(speed: FloatArray, first: int, width: int) -> list[tuple[int, int]]:
    """Return the runs in which the `speed` (n,) [rad/s] keeps to that of the most samples.

    `first`: row of the first of them [1]; `width`: of the mean that they are [1].
    """
    out = []
    left = np.ones(len(speed), bool)
    while left.sum() > 10:
        middle = float(np.median(speed[left]))
        near = left & (np.abs(speed - middle) < STEADY * middle)
        # Ramps at its ends are no part of a spin: they are not as the rate is else.
        spread = float(np.median(np.abs(speed[near] - middle))) if near.any() else 0.0
        runs = _runs(near & (np.abs(speed - middle) < max(WIDE * spread, EVEN * middle)))
        if not runs:
            break
        a, b = max(runs, key=lambda r: r[1] - r[0])
        out.append((first + a + width, first + b - width))
        left[max(a - 10, 0) : b + 10] = False
    return sorted(out)


def _spin(log: Log, begin: int, end: int, speed: float, steps: FloatArray) -> Spin:
    assert log.accel is not None
    assert log.gyro is not None
    many = max(int(FINE / (speed * log.interval)), 1)
    n = (end - begin) // many
    rows = slice(begin, begin + n * many)
    both = np.column_stack([log.accel[rows], log.gyro[rows]])
    return Spin(log.time[rows].reshape(n, many).mean(axis=1),
                both.reshape(n, many, 6).mean(axis=1), many, log.interval,
                log.sampled == "increment", rounding=steps / np.sqrt(12 * many))  # fmt: skip


def grouped(spins: list[Spin], apart: float) -> tuple[list[Spin], list[FloatArray]]:
    """Return spins with their mountings, and the axes (3,) of these.

    `apart`: axes that are no more than this apart are of one mounting [rad].
    """
    axes: list[FloatArray] = []
    out = []
    for spin in spins:
        mean = spin.readings[:, 3:].mean(axis=0)
        unit = mean / np.linalg.norm(mean)
        near = [abs(float(unit @ axis)) > np.cos(apart) for axis in axes]
        k = near.index(True) if any(near) else len(axes)
        if k == len(axes):
            axes.append(unit)
        out.append(replace(spin, mounting=k, rate=float(mean @ axes[k])))
    return out, axes


def frequency(spin: Spin) -> float:
    """Return the rate at which gravity turns in the accelerometers, without gyros [rad/s]."""
    x = spin.readings[:, :3] - spin.readings[:, :3].mean(axis=0)
    n = 8 * len(x)
    power = np.sum(np.abs(np.fft.rfft(x * np.hanning(len(x))[:, None], n, axis=0)) ** 2, axis=1)
    return float(2 * np.pi * np.argmax(power[8:]) + 16 * np.pi) / (n * spin.step)


def plane(spin: Spin) -> FloatArray:
    """Return the axis, either way, in whose plane the specific force turns, (3,) [1]."""
    return np.asarray(np.linalg.eigh(np.cov(spin.readings[:, :3].T))[1][:, 0])


def turning(spin: Spin) -> float:
    """Return how fast the gyros turn against gravity in the accelerometers, 0 where it rests [1].

    A quarter of the square of what is read has to turn at least.
    """
    x = spin.readings[:, :3]
    if x.var(axis=0).sum() < 0.25 * np.mean(np.sum(x**2, axis=1)):
        return 0.0
    return float(np.linalg.norm(spin.readings[:, 3:].mean(axis=0))) / frequency(spin)


def spin_words(spin: Spin) -> str:
    """Return what people call a spin."""
    where = f"mounting {spin.mounting + 1}, {plain(spin.rate, 3)} rad/s"
    return f"the spin at {spin.time[0]:.0f} s ({where})"
