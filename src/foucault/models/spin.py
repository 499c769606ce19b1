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
    """True specific force and rate of every sample, and what they hang on, axes b."""

    f: FloatArray  # (n, 3) [m/s^2]
    w: FloatArray  # (n, 3) [rad/s]
    C_bm: FloatArray  # (3, 3) [p q e]
    # path, grip: (n, 3, 3), (n, 3, 7) derivatives of both, in axes of the mounting [SI]
    path: tuple[FloatArray, FloatArray]
    grip: tuple[FloatArray, FloatArray]

    @property
    def by_path(self) -> tuple[FloatArray, FloatArray]:
        """Specific force and rate by phase, rate and acceleration, (n, 3, 3) each [SI]."""
        return self.C_bm @ self.path[0], self.C_bm @ self.path[1]

    @property
    def by_grip(self) -> tuple[FloatArray, FloatArray]:
        """Specific force and rate by the grip, (n, 3, 7) each [SI]."""
        return self.C_bm @ self.grip[0], self.C_bm @ self.grip[1]


def moved(grip: Grip, path: FloatArray, site: Site, shrunk: FloatArray) -> Moved:
    """Return the true motion of a spin along a `path` (n, 3) [rad, rad/s, rad/s^2].

    `shrunk` (n,): by how much means are shorter than what turns [1].
    """
    n, g, (r1, r2) = len(path), site.gravity, grip.arm
    th, w, al = path.T
    c, s = shrunk * np.cos(th), shrunk * np.sin(th)
    ct, st = np.cos(grip.tilt), np.sin(grip.tilt)
    zero, one = np.zeros(n), np.ones(n)
    up = np.column_stack([ct * c, -ct * s, st * one])
    up_by_tilt = np.column_stack([-st * c, st * s, ct * one])  # it is h too
    up_by_phase = np.column_stack([-ct * s, -ct * c, zero])
    across = np.column_stack([s, c, zero])
    f = g * up + np.column_stack([-(w**2) * r1 - al * r2, -(w**2) * r2 + al * r1, zero])
    f_path = np.zeros((n, 3, 3))
    f_path[:, :, 0] = g * up_by_phase
    f_path[:, 0, 1], f_path[:, 1, 1] = -2 * w * r1, -2 * w * r2
    f_path[:, 0, 2], f_path[:, 1, 2] = -r2, r1
    f_grip, w_grip = np.zeros((2, n, 3, GRIP))
    f_grip[:, :, 2] = g * up_by_tilt
    f_grip[:, 0, 3], f_grip[:, 1, 3] = -(w**2), al
    f_grip[:, 0, 4], f_grip[:, 1, 4] = -al, -(w**2)
    w_path = np.zeros((n, 3, 3))
    w_path[:, 2, 1] = 1.0
    rate = np.column_stack([zero, zero, w])
    sine = 0.0 if site.latitude is None else np.sin(site.latitude)  # its mean anywhere
    rate += EARTH_RATE * (sine * up + grip.level[0] * up_by_tilt + grip.level[1] * across)
    w_path[:, :, 0] = EARTH_RATE * (
        sine * up_by_phase
        + grip.level[0] * np.column_stack([st * s, st * c, zero])
        + grip.level[1] * np.column_stack([c, -s, zero])
    )
    w_grip[:, :, 2] = EARTH_RATE * (sine * up_by_tilt - grip.level[0] * up)
    w_grip[:, :, 5], w_grip[:, :, 6] = EARTH_RATE * up_by_tilt, EARTH_RATE * across
    for by, v in ((f_grip, f), (w_grip, rate)):  # a turn of the axis: delta x v
        by[:, 1, 0], by[:, 2, 0] = -v[:, 2], v[:, 1]
        by[:, 0, 1], by[:, 2, 1] = v[:, 2], -v[:, 0]
    C = grip.C_bm
    return Moved(f @ C.T, rate @ C.T, C, (f_path, w_path), (f_grip, w_grip))


def across(axis: FloatArray) -> FloatArray:
    """Return ``[p q e]`` (3, 3) with `axis` (3,) for e and any p across it."""
    p = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    p /= np.linalg.norm(p)
    return np.column_stack([p, np.cross(axis, p), axis])
