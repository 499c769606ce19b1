"""What gyros said on a rate table: one mean per constant rate, and what was true of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.models.earth import Site
from foucault.models.noise import TriadNoise


@dataclass(frozen=True)
class Steps:
    """What the gyros said at constant rates of the table."""

    up: FloatArray  # (n, 3) axis that is along the vertical, with its sense; fixture axes [1]
    placement: IntArray  # (n,) number of the placement; up is the same in all steps of one [1]
    rate: FloatArray  # (n,) rate of the table, counter-clockwise seen from above [rad/s]
    time: FloatArray  # (n,) how long was averaged [s]
    gyro: FloatArray  # (n, 3) mean rate as measured [rad/s]
    cov: FloatArray  # (n, 3, 3) covariance of the noise of these means [(rad/s)^2]
    # (n, 3) true mean specific force, fixture axes, for the g-sensitivity [m/s^2]
    force: FloatArray
    # (n,) when each step began; None: one right after the other [s]
    start: FloatArray | None = None
    # declared noise of the gyros whose bias wanders, which ties the steps together; it is not in
    # `cov` [SI]
    slow: TriadNoise | None = None
    # (n,) angle of the table when each step began, counter-clockwise from above; NaN where it did
    # not tell it [rad]
    azimuth: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def axis(self) -> IntArray:
        """Which axis is along the vertical, 0, 1 or 2, shape (n,)."""
        return np.asarray(np.abs(self.up).argmax(axis=1))

    @property
    def sense(self) -> FloatArray:
        """1 where that axis points up, -1 where it points down, shape (n,)."""
        return np.asarray(np.sign(np.take_along_axis(self.up, self.axis[:, None], 1)[:, 0]))

    @cached_property
    def level(self) -> FloatArray:
        """The next two axes of the fixture, which are level, shape (n, 3, 2) [1]."""
        eye = np.eye(3)
        return np.stack([eye[(self.axis + 1) % 3], eye[(self.axis + 2) % 3]], axis=2)

    @cached_property
    def azimuth_known(self) -> BoolArray:
        """Whether the table told its angle when a step began, shape (n,)."""
        told = np.zeros(len(self)) if self.azimuth is None else np.isfinite(self.azimuth)
        return np.asarray(told, bool)

    @cached_property
    def level_at_zero(self) -> FloatArray:
        """What is `level` where the table is at angle 0, as seen by the steps, (n, 3, 2) [1]."""
        angle = np.zeros(len(self)) if self.azimuth is None else self.azimuth
        turn = np.where(self.azimuth_known, angle, 0.0) * self.sense
        c, s = np.cos(turn), np.sin(turn)
        return np.asarray(self.level @ np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0))

    @property
    def half_time(self) -> float:
        """When the session was half over [s]."""
        middle, half = self.middle, self.time / 2
        return float(((middle - half).min() + (middle + half).max()) / 2)

    @property
    def middle(self) -> FloatArray:
        """When each step was half over, shape (n,) [s]."""
        ends = np.concatenate([[0.0], np.cumsum(self.time)])
        start = self.start
        if start is None or not np.isfinite(start).all() or (np.diff(start) <= 0).any():
            start = ends[:-1]
        return np.asarray(start + self.time / 2)

    @property
    def turns(self) -> FloatArray:
        """Turns averaged, shape (n,) [1]."""
        return np.asarray(np.abs(self.rate) * self.time / (2 * np.pi))


def mean_force_of_steps(
    up: FloatArray,
    placement: IntArray,
    rate: FloatArray,
    accel: FloatArray | None,
    site: Site,
) -> FloatArray:
    """Return the true specific force of each step, fixture axes, shape (n, 3) [m/s^2].

    Gravity along up, and what grows with the square of the rate across it: the accelerometers see
    the centripetal acceleration of their place, and the gyros are taken to be there too.

    `up` (n, 3): axis that is along the vertical, with its sense [1]; `placement` (n,): number of
    the placement [1]; `rate` (n,): rate of the table [rad/s]; `accel` (n, 3) or None: mean
    specific force as measured [m/s^2].
    """
    force = site.gravity * up
    if accel is None:
        return force
    for p in np.unique(placement):
        mine = placement == p
        square = rate[mine] ** 2
        spread = square - square.mean()
        if spread @ spread > 0:
            slope = spread @ (accel[mine] - accel[mine].mean(axis=0)) / (spread @ spread)
            slope -= (slope @ up[mine][0]) * up[mine][0]
            force[mine] += square[:, None] * slope
    return np.asarray(force)
