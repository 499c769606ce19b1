"""The error of a navigated trajectory against a reference, and how it grows.

Position error is a straight line from the reference to the estimate, east, north and up at the
reference. The trajectory, which is dense, is interpolated to the epochs of the reference, which
may be far apart: cubically in position with the velocities as slopes, linearly in velocity, about
a fixed axis in attitude.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, appendix B.2.3 (circular error probable).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.logs.reference import Reference
from foucault.models import geodesy, rotation
from foucault.models.attitude import angles_of
from foucault.models.earth import radii
from foucault.models.rotation import turned

if TYPE_CHECKING:
    from foucault.navigate.strapdown import Trajectory

NAUTICAL_MILE = 1852.0
"""[m]."""

AGES = (1, 2, 5, 10, 20, 30, 60, 120, 180, 240, 300, 360, 480, 600, 720, 960, 1200, 1440)
"""Ages at which the growth of the error is listed [min]."""

WIDE = 0.25
"""Between epochs farther apart than this part of an age nothing is listed at it [1]."""

MOST = 2000
"""Epochs at which errors are kept [1]."""


@dataclass(frozen=True)
class NavigationError:
    """Error of a trajectory, estimate minus reference; NaN where the reference does not say."""

    time: FloatArray  # (m,) epochs, of the log's clock [s]
    start: float  # time at which the navigation started [s]
    position: FloatArray  # (m, 3) East, north, up [m]
    velocity: FloatArray  # (m, 3) East, north, up [m/s]
    angles: FloatArray  # (m, 3) heading, pitch, roll, between -pi and pi [rad]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def age(self) -> FloatArray:
        """Time since the navigation started, shape (m,) [s]."""
        return np.asarray(self.time - self.start)

    @property
    def horizontal(self) -> FloatArray:
        """Length of the horizontal position error, shape (m,) [m]."""
        return np.hypot(self.position[:, 0], self.position[:, 1])


@dataclass(frozen=True)
class Growth:
    """The error at one age of the navigation; NaN where the reference does not say."""

    age: float  # time since the start [s]
    # horizontal, vertical: length of the horizontal, and size of the vertical position error [m]
    horizontal: float
    vertical: float
    velocity: float  # length of the horizontal velocity error [m/s]
    heading: float  # heading error [rad]


def common_epochs(trajectory: Trajectory, reference: Reference) -> FloatArray:
    """Return the epochs of a reference that a trajectory covers, thinned evenly, shape (m,) [s].

    Raises ``navigate.apart``: they have no time in common.
    """
    first = float(trajectory.time[0])
    time = covered(reference, first, float(trajectory.time[-1]))
    step = -(-len(time) // MOST)
    kept = np.arange(len(time))[::-1][::step]  # the last one stays
    listed = np.searchsorted(time, first + 60.0 * np.array(AGES) - 1e-6)
    return np.asarray(time[np.union1d(kept, listed[listed < len(time)])])


def covered(reference: Reference, first: float, last: float) -> FloatArray:
    """Return the epochs of a reference between two times, shape (m,) [s].

    `first`, `last`: where the navigation starts and ends [s]. Raises ``navigate.apart``: there
    are fewer than two.
    """
    # Rows that are blank are no measurement: a slow sensor beside a fast one writes many.
    inside = (reference.time >= first) & (reference.time <= last) & reference.says
    if np.count_nonzero(inside) < 2:
        raise error(
            "navigate.apart", first=f"{first:.9g}", last=f"{last:.9g}",
            start=f"{reference.time[0]:.9g}", end=f"{reference.time[-1]:.9g}",
        )  # fmt: skip
    return np.asarray(reference.time[inside])


def error_of(trajectory: Trajectory, reference: Reference) -> NavigationError:
    """Compute the error of a trajectory at the epochs of a reference.

    `reference`: positions, velocities or angles, of the same clock. Raises ``navigate.apart``:
    they have no time in common.
    """
    time = common_epochs(trajectory, reference)
    row = np.searchsorted(reference.time, time)
    seen = _Bracket.of(trajectory, time)
    blank = np.full((len(time), 3), np.nan)
    position = blank.copy()
    if reference.position is not None:
        latitude, longitude, height = reference.position[row].T
        position = geodesy.displacement(latitude, longitude, height, *seen.position())
        if not reference.has_height:
            position[:, 2] = np.nan
    fast = blank if reference.velocity_n is None else seen.velocity() - reference.velocity_n[row]
    angles = blank
    if reference.angles is not None:
        angles = turned(angles_of(seen.attitude()) - reference.angles[row])
    return NavigationError(time, float(trajectory.time[0]), position, fast, angles)


@dataclass(frozen=True)
class _Bracket:
    """The states before and after each epoch, and how far between them it lies."""

    before: Trajectory
    after: Trajectory
    part: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory, time: FloatArray) -> _Bracket:
        t = trajectory.time
        i = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
        before = replace(trajectory, time=t[i], history=trajectory.history[i])
        after = replace(trajectory, time=t[i + 1], history=trajectory.history[i + 1])
        return cls(before, after, (time - t[i]) / (t[i + 1] - t[i]))

    def position(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude and height."""
        a, b, u = self.before, self.after, self.part
        # The straight line between two samples misses u (u-1)/2 step (v1 - v0).
        step = b.time - a.time
        bow = (u * (u - 1) / 2 * step)[:, None] * (b.velocity_n - a.velocity_n)
        latitude = a.latitude + u * (b.latitude - a.latitude)
        height = a.height + u * (b.height - a.height) + bow[:, 2]
        longitude = a.longitude + u * turned(b.longitude - a.longitude)
        along, across = radii(latitude)
        longitude = longitude + bow[:, 0] / ((across + height) * np.cos(latitude))
        return latitude + bow[:, 1] / (along + height), longitude, height

    def velocity(self) -> FloatArray:
        """Return the velocity, linear between the samples."""
        v = self.before.velocity_n
        return np.asarray(v + self.part[:, None] * (self.after.velocity_n - v))

    def attitude(self) -> FloatArray:
        """Return C_nb, turned about a fixed axis between the samples."""
        C = self.before.C_nb
        turn = rotation.log(np.swapaxes(C, -1, -2) @ self.after.C_nb)
        return np.asarray(C @ rotation.exp(self.part[:, None] * turn))


def growth(errors: NavigationError) -> tuple[Growth, ...]:
    """Return the error at the ages of `AGES` that the run reaches, and at its last epoch.

    Between epochs it is interpolated.
    """
    age = errors.age
    # An age that the last epoch is hardly beyond would be listed twice.
    wanted = [60.0 * a for a in AGES if 60.0 * a < 0.95 * age[-1]]
    rows = []
    for at in [*wanted, float(age[-1])]:
        i = int(np.clip(np.searchsorted(age, at), 1, max(1, len(age) - 1))) if len(age) > 1 else 0
        if at < age[-1] and (at < age[i - 1] or age[i] - age[i - 1] > WIDE * at):
            continue  # the reference says nothing there
        rows.append(_at(errors, at, i))
    return tuple(rows)


def _at(errors: NavigationError, age: float, i: int) -> Growth:
    """Return the error at an age between the epochs before and at `i`."""
    part = 1.0 if i == 0 else (age - errors.age[i - 1]) / (errors.age[i] - errors.age[i - 1])

    def between(x: FloatArray) -> FloatArray:
        return np.asarray(x[i] if part == 1 else x[i - 1] + part * (x[i] - x[i - 1]))

    east, north, up = between(errors.position)
    speed = float(np.hypot(*between(errors.velocity)[:2]))
    heading = float(errors.angles[i, 0])
    if part < 1:
        heading -= (1 - part) * float(turned(np.diff(errors.angles[i - 1 : i + 1, 0]))[0])
    return Growth(age, float(np.hypot(east, north)), abs(float(up)), speed, heading)


def radial_rate(errors: NavigationError, after: float = 60.0) -> float:
    """Return the root mean square over a run of radial error over age [m/s].

    `after`: the first part of the run does not count [s].
    """
    age, r = errors.age, errors.horizontal
    counts = (age >= min(after, 0.5 * float(age[-1]))) & np.isfinite(r) & (age > 0)
    return float(np.sqrt(np.mean((r[counts] / age[counts]) ** 2))) if counts.any() else float("nan")


def circular_error(cov: FloatArray) -> FloatArray:
    """Return the radius that holds half of all errors, shape (...) [m].

    The integral of the Gaussian over the circle is solved for, not approximated.

    `cov` (..., 2, 2): covariance of the horizontal position error [m^2].
    """
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(cov), 0.0))
    small, large = values[..., 0], values[..., 1]
    share = np.divide(small, large, out=np.zeros_like(small), where=large > 0)
    return np.asarray(large * np.interp(share, *_circular_table()))


@cache
def _circular_table() -> tuple[FloatArray, FloatArray]:
    """Return axis ratios, and the radius for half of the errors where the larger sd is 1."""
    angle = (np.arange(512) + 0.5) * np.pi / 512
    ratio = np.linspace(0.0, 1.0, 101)[1:, None]
    # P(r) = 1 - mean over angle of ratio/d exp(-r^2 d / (2 ratio^2)), d = ratio^2 c^2 + s^2
    d = (ratio * np.cos(angle)) ** 2 + np.sin(angle) ** 2
    low, high = np.full_like(ratio, 0.5), np.full_like(ratio, 1.3)
    for _ in range(50):
        r = (low + high) / 2
        inside = 1 - np.mean(ratio / d * np.exp(-(r**2) * d / (2 * ratio**2)), axis=1)[:, None]
        low, high = np.where(inside < 0.5, r, low), np.where(inside < 0.5, high, r)
    least = 0.6744897501960817  # the quartile of the normal distribution
    return np.append(0.0, ratio), np.append(least, (low + high) / 2)
