"""Sets of poses for spins about a level axis, from which the deflection of dithered gyros is found.

A gyro on a dither spring bends under specific force, and its sensitive axis with it. Six
coefficients say how far (arcsec per g). In a spin about North the attitude tilts about East; after
whole turns through the angle theta, with u the direction of North in body axes,

    tilt = theta (g / 2) row(u) . T,     u = (sin a cos b, cos a cos b, -sin b)

where the case is turned by the angle a about its z axis and then by b about East. Every entry of
the row is a quadratic form in u, so that six coefficients need six poses, three of them tilted.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5), eqs. (20)-(26).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion

COEFFICIENTS = ("xyy", "xzz", "yzz", "yxx", "zxx", "zyy")
"""Gyro, direction it bends to, direction of the specific force: the six of the design's columns."""

SINGULAR = 1e-9
"""A singular value below this share of the largest is zero [1]."""

_A = float(np.degrees(np.arctan(2 / (1 + 5**0.5))))

_SETS: dict[str, tuple[tuple[float, float], ...]] = {
    "simple 6": ((0, 0), (90, 0), (0, -90), (45, 0), (0, -45), (90, -45)),
    "face diagonals 6": ((45, 0), (135, 0), (0, -45), (0, 45), (90, -45), (90, 45)),
    "icosahedral 6": (
        (0, _A - 90), (0, 90 - _A), (_A, 0), (180 - _A, 0), (90, -_A), (90, _A),
    ),
}  # fmt: skip

NAMES = tuple(_SETS)
"""Names of the sets of poses."""


def poses(name: str) -> FloatArray:
    """Return the angles a and b of a named set, shape (n, 2) [rad]."""
    if name not in _SETS:
        raise error(
            "poses.unknown", name=name, hint=suggestion(name, NAMES), allowed=", ".join(NAMES)
        )
    return np.radians(_SETS[name])


def spin_axis(angles: FloatArray) -> FloatArray:
    """Return the axis of the spin in body axes, shape (n, 3) [1]; eq. (20).

    `angles` (n, 2): angle a about z and angle b about East of each pose [rad].
    """
    a, b = angles.T
    return np.stack([np.sin(a) * np.cos(b), np.cos(a) * np.cos(b), -np.sin(b)], axis=1)


def design(u: FloatArray) -> FloatArray:
    """Return the row of each pose, shape (n, 6) [1]; eq. (25).

    `u` (n, 3): axis of the spin in body axes [1].
    """
    x, y, z = u.T
    return np.stack(
        [z**2 + y * z, y**2 - y * z, x**2 + x * z, z**2 - x * z, y**2 + x * y, x**2 - x * y], axis=1
    )


@dataclass(frozen=True)
class PoseQuality:
    """How well a set of poses tells the six coefficients."""

    rows: FloatArray  # (n, 6) the design [1]

    @property
    def rank(self) -> int:
        """Combinations of the six that are seen."""
        return int(np.linalg.matrix_rank(self.rows, tol=SINGULAR * np.linalg.norm(self.rows, 2)))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value, infinite where something is unseen [1]."""
        return float(np.linalg.cond(self.rows)) if self.rank == 6 else float("inf")

    @property
    def sd(self) -> FloatArray:
        """Sd of each coefficient per sd of ``2 tilt / (theta g)`` in a pose, shape (6,) [1]."""
        if self.rank < 6:
            return np.full(6, np.inf)
        return np.sqrt(np.diag(np.linalg.inv(self.rows.T @ self.rows)))

    @property
    def spread(self) -> float:
        """Root mean square of `sd` [1]."""
        return float(np.sqrt(np.mean(self.sd**2)))


def quality(angles: FloatArray) -> PoseQuality:
    """Judge a set of poses.

    `angles` (n, 2): angle a about z and angle b about East of each pose [rad].
    """
    return PoseQuality(design(spin_axis(angles)))
