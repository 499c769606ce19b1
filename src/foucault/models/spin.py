"""The motion of an instrument that turns about a roughly level axis, in the axes of its mounting.

``m`` are axes of one mounting in the body: e along the spin axis, p and q across it,
``C_bm = [p q e]``. With th the phase, w its rate, al its acceleration, tau the tilt of e above the
level, r the lever arm from the axis to the accelerometers, n level across the axis and h level
along it::

    up = (cos tau cos th, -cos tau sin th, sin tau)      n = (sin th, cos th, 0)
    f  = g up - w^2 r + al e x r                          h = (e - sin tau up) / cos tau
    w_ib = w e + w_ie (sin L up + c_1 h + c_2 n)          all in axes m
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.rotation import exp

GRIP = 7
"""Unknowns of a mounting: two turns of the axis [rad], tilt [rad], lever arm (2) [m], level Earth
rate along and across the axis (2) [of the Earth's rate]."""


@dataclass(frozen=True)
class Grip:
    """How the instrument sits on the axis in one mounting."""

    C_bm: FloatArray  # (3, 3) [p q e]
    tilt: float = 0.0  # [rad]
    arm: FloatArray = field(default_factory=lambda: np.zeros(2))  # along p and q [m]
    level: FloatArray = field(default_factory=lambda: np.zeros(2))  # c_1, c_2 [1]

    def moved(self, step: FloatArray) -> Grip:
        """Return it with something added, `step` (7,) [SI]."""
        turned = self.C_bm @ exp(np.array([step[0], step[1], 0.0]))
        return Grip(turned, self.tilt + float(step[2]), self.arm + step[3:5], self.level + step[5:])


@dataclass(frozen=True)
class Moved:
    """True specific force and rate of every sample, and what they hang on."""

    f: FloatArray  # (n, 3) axes b [m/s^2]
    w: FloatArray  # (n, 3) axes b [rad/s]
    C_bm: FloatArray  # (3, 3) [p q e]
    grip: Grip
    path: FloatArray  # (n, 3) [rad, rad/s, rad/s^2]
    site: Site
    own: tuple[FloatArray, FloatArray]  # f and w in axes of the mounting [SI]
    up: tuple[FloatArray, ...]  # up, h but for its length, n, and up by the phase, (n, 3) each [1]

    @property
    def by_path(self) -> tuple[FloatArray, FloatArray]:
        """Specific force and rate by phase, rate and acceleration, (n, 3, 3) each [SI]."""
        (r1, r2), (n_1, n_2), w = self.grip.arm, self.grip.level, self.path[:, 1]
        across, up_by_phase = self.up[2:]
        f, rate = np.zeros((2, len(w), 3, 3))
        f[:, :, 0] = self.site.gravity * up_by_phase
        f[:, 0, 1], f[:, 1, 1] = -2 * w * r1, -2 * w * r2
        f[:, 0, 2], f[:, 1, 2] = -r2, r1
        rate[:, 2, 1] = 1.0
        rate[:, :, 0] = EARTH_RATE * (self._sine - n_1 * np.tan(self.grip.tilt)) * up_by_phase
        rate[:, 0, 0] += EARTH_RATE * n_2 * across[:, 1]
        rate[:, 1, 0] -= EARTH_RATE * n_2 * across[:, 0]
        return self.C_bm @ f, self.C_bm @ rate

    @property
    def by_grip(self) -> tuple[FloatArray, FloatArray]:
        """Specific force and rate by the grip, (n, 3, 7) each [SI]."""
        up, along, across, _ = self.up
        w, al = self.path[:, 1], self.path[:, 2]
        f, rate = np.zeros((2, len(w), 3, GRIP))
        f[:, :, 2] = self.site.gravity * along
        f[:, 0, 3], f[:, 1, 3] = -(w**2), al
        f[:, 0, 4], f[:, 1, 4] = -al, -(w**2)
        rate[:, :, 2] = EARTH_RATE * (self._sine * along - self.grip.level[0] * up)
        rate[:, :, 5], rate[:, :, 6] = EARTH_RATE * along, EARTH_RATE * across
        for by, v in zip((f, rate), self.own, strict=True):  # a turn of the axis: delta x v
            by[:, 1, 0], by[:, 2, 0] = -v[:, 2], v[:, 1]
            by[:, 0, 1], by[:, 2, 1] = v[:, 2], -v[:, 0]
        return self.C_bm @ f, self.C_bm @ rate

    @property
    def _sine(self) -> float:
        """Of the latitude; its mean where nobody knows it."""
        return 0.0 if self.site.latitude is None else float(np.sin(self.site.latitude))


def moved(grip: Grip, path: FloatArray, site: Site, shrunk: FloatArray) -> Moved:
    """Return the true motion of a spin along a `path` (n, 3) [rad, rad/s, rad/s^2].

    `shrunk` (n,): by how much means are shorter than what turns [1].
    """
    (r1, r2), (th, w, al), zero = grip.arm, path.T, np.zeros(len(path))
    c, s = shrunk * np.cos(th), shrunk * np.sin(th)
    ct, st = np.cos(grip.tilt), np.sin(grip.tilt)
    up = np.column_stack([ct * c, -ct * s, zero + st])
    along = np.column_stack([-st * c, st * s, zero + ct])  # up by the tilt; it is h too
    across = np.column_stack([s, c, zero])
    by_phase = -ct * across
    f = site.gravity * up
    f[:, 0] -= w**2 * r1 + al * r2
    f[:, 1] -= w**2 * r2 - al * r1
    sine = 0.0 if site.latitude is None else np.sin(site.latitude)  # its mean anywhere
    rate = EARTH_RATE * (sine * up + grip.level[0] * along + grip.level[1] * across)
    rate[:, 2] += w
    C = grip.C_bm
    own, ups = (f, rate), (up, along, across, by_phase)
    return Moved(f @ C.T, rate @ C.T, C, grip, path, site, own, ups)


def across(axis: FloatArray) -> FloatArray:
    """Return ``[p q e]`` (3, 3) with `axis` (3,) for e and any p across it."""
    p = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    p /= np.linalg.norm(p)
    return np.column_stack([p, np.cross(axis, p), axis])
