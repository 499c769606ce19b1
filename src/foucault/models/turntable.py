"""A three-axis table: from its angles and its errors to the attitude of what it carries.

Axes: the outer axis is nearly vertical, the middle axis is carried by it, the inner axis by the
middle one. Case axes k are parallel to the middle (x), inner (y) and outer (z) axes when all
angles are zero. Table axes t are fixed to the ground, z up. With active rotation matrices::

    C_tk = Rx(plumb_x) Ry(plumb_y) Rz(outer) Ry(p_mo) Rx(middle + zero_m + e_m)
           Rz(p_im) Ry(inner + zero_i + e_i)

plumb: the outer axis is not vertical; p_mo, p_im: middle not perpendicular to outer, inner not to
middle; zero: constant errors of the angle readings; e: another error in every position.

The outer axis points along ``u = (-cos(middle) sin(inner), sin(middle), cos(middle) cos(inner))``
in case axes where the table is perfect, and so does up.

The body axes b of the instrument (see `models.imu`) are mounted on k with a small rotation:
``C_bk = Exp(-[mounting x])``.

References
----------
.. [1] Dong, Ren, Chen, Wang, "Calibration method for the laser gyro strapdown inertial navigation
   system based on norm-observation", Infrared and Laser Engineering 47(9), 2018, section 1.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, Layout
from foucault.models.earth import EARTH_RATE
from foucault.tables import AXES

RIG = Layout(
    (
        Coefficient("table.plumb.x", "x_0", "angle", "tilt of the outer axis about table x"),
        Coefficient("table.plumb.y", "y_0", "angle", "tilt of the outer axis about table y"),
        Coefficient(
            "table.orthogonality.middle_outer", "p_mo", "angle",
            "departure of the middle from the perpendicular to the outer axis",
        ),
        Coefficient(
            "table.orthogonality.inner_middle", "p_im", "angle",
            "departure of the inner from the perpendicular to the middle axis",
        ),
        Coefficient("table.zero.middle", "z_m", "angle", "zero error of the middle angle"),
        Coefficient("table.zero.inner", "z_i", "angle", "zero error of the inner angle"),
        Coefficient("table.rate", "e_w", "scale factor error", "relative error of all spin rates"),
        Coefficient("table.heading", "psi", "angle", "azimuth of table y at outer angle zero"),
        *(
            Coefficient(
                f"mounting.{a}", f"th_{a}", "angle",
                f"rotation of the body axes about case {a}",
            )
            for a in AXES
        ),
        *(
            Coefficient(
                f"lever_arm.{a}", f"r_{a}", "length",
                f"{a} of the accelerometers from the centre of the table",
            )
            for a in AXES
        ),
    )
)  # fmt: skip
"""What a session on a table can find beside the coefficients of the instrument."""

COMMON = RIG.names[:6]
"""Names of the angle errors that all positions share."""


@dataclass(frozen=True)
class TablePlan:
    """What a table is told to do: rests, and spins of the outer axis."""

    name: str  # name of the plan, shape ()
    # (n, 3) outer, middle and inner angle of each position; the outer one is where a spin starts
    # [rad]
    angles: FloatArray
    # (n,) rate of the outer axis, counter-clockwise seen from above; 0 for a rest [rad/s]
    rate: FloatArray
    time: FloatArray  # (n,) length of each rest, or of the whole turns of a spin [s]

    def __len__(self) -> int:
        return len(self.rate)


@dataclass(frozen=True)
class TableErrors:
    """Errors of a table that are the same in all positions."""

    # plumb_x, plumb_y: tilt of the outer axis about table x, then y [rad]
    plumb_x: float = 0.0
    plumb_y: float = 0.0
    # middle_outer, inner_middle: departures from the perpendicular p_mo and p_im [rad]
    middle_outer: float = 0.0
    inner_middle: float = 0.0
    # middle_zero, inner_zero: zero errors of the angle readings: true minus said [rad]
    middle_zero: float = 0.0
    inner_zero: float = 0.0

    @property
    def values(self) -> FloatArray:
        """The six errors in the order of `COMMON`, shape (6,) [rad]."""
        return np.array([getattr(self, f.name) for f in fields(self)])

    @classmethod
    def of(cls, values: FloatArray) -> TableErrors:
        """Take six errors in the order of `COMMON` from `values`, shape (6,) [rad]."""
        return cls(*(float(v) for v in values))


@dataclass(frozen=True)
class Chain:
    """Attitudes of the case, and the axes that errors turn it about."""

    C_tk: FloatArray  # (n, 3, 3) attitude of the case [1]
    # (n, 3, 7) in case axes the directions of the seven elementary rotations plumb x, plumb y,
    # outer, p_mo, middle, p_im, inner: a small increase e of one turns ``C_tk`` into ``C_tk Exp([a
    # e x])``
    axes: FloatArray

    @property
    def up_k(self) -> FloatArray:
        """Direction of up in case axes, shape (n, 3) [1]."""
        return np.asarray(self.C_tk[:, 2, :])

    @property
    def outer_k(self) -> FloatArray:
        """Direction of the outer axis in case axes, shape (n, 3) [1]."""
        return np.asarray(self.axes[:, :, 2])


PLUMB_X, PLUMB_Y, OUTER, MIDDLE_OUTER, MIDDLE, INNER_MIDDLE, INNER = range(7)
"""Columns of `Chain.axes`."""

COMMON_AXES = (PLUMB_X, PLUMB_Y, MIDDLE_OUTER, INNER_MIDDLE, MIDDLE, INNER)
"""The column of `Chain.axes` for each of `COMMON`."""

_ABOUT = (0, 1, 2, 1, 0, 2, 1)  # the axis each elementary rotation is about


def chain(
    angles: FloatArray, errors: TableErrors | None = None, position: FloatArray | None = None
) -> Chain:
    """Compute the attitude of the case for angles of the table.

    `angles` (n, 3): outer, middle and inner angle as the table says [rad]; `errors` or None:
    errors that all positions share [rad]; `position` (n, 2) or None: errors of the middle and the
    inner angle in each position [rad].
    """
    e = errors or TableErrors()
    extra = np.zeros((len(angles), 2)) if position is None else position
    one = np.ones(len(angles))
    turns = (
        e.plumb_x * one,
        e.plumb_y * one,
        angles[:, 0],
        e.middle_outer * one,
        angles[:, 1] + e.middle_zero + extra[:, 0],
        e.inner_middle * one,
        angles[:, 2] + e.inner_zero + extra[:, 1],
    )
    C = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    axes = np.empty((len(angles), 3, 7))
    for k in reversed(range(7)):  # C is what follows rotation k: its axis is a row of C
        axes[:, :, k] = C[:, _ABOUT[k], :]
        C = elementary(_ABOUT[k], turns[k]) @ C
    return Chain(C, axes)


def elementary(axis: int, angle: FloatArray) -> FloatArray:
    """Return active rotation matrices about x, y or z, shape (n, 3, 3) [1].

    `axis`: 0, 1 or 2 for x, y or z [1]; `angle` (n,): angles [rad].
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((len(angle), 3, 3))
    c, s = np.cos(angle), np.sin(angle)
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = c
    out[:, i, j], out[:, j, i] = -s, s
    return out


def up_k(angles: FloatArray) -> FloatArray:
    """Return the direction of up in case axes on a perfect table, shape (n, 3) [1].

    `angles` (n, 3): outer, middle and inner angle [rad].
    """
    a, b = angles[:, 1], angles[:, 2]
    return np.stack([-np.cos(a) * np.sin(b), np.sin(a), np.cos(a) * np.cos(b)], axis=1)


def earth_rate_t(latitude: float, heading: float) -> FloatArray:
    """Return the Earth's rotation in table axes, shape (3,) [rad/s].

    `latitude`: geodetic latitude, positive north [rad]; `heading`: azimuth of table y, clockwise
    from North [rad].
    """
    horizontal = np.cos(latitude)
    return EARTH_RATE * np.array(
        [-horizontal * np.sin(heading), horizontal * np.cos(heading), np.sin(latitude)]
    )


def mean_rate(rate: FloatArray, latitude: float) -> FloatArray:
    """Return the norm of the mean rate over whole turns about up, with the sign of `rate`.

    ``h = rate + w_ie sin L``: the horizontal part of the Earth's rotation averages to zero.

    `rate` (n,): rate of the outer axis, counter-clockwise seen from above [rad/s]; `latitude`:
    geodetic latitude, positive north [rad].
    """
    return np.asarray(rate + EARTH_RATE * np.sin(latitude))


def mean_force(up: FloatArray, h: FloatArray, gravity: float, lever_arm: FloatArray) -> FloatArray:
    """Return the mean specific force over whole turns, shape (n, 3) [m/s^2].

    ``f = g o - h^2 (r - (r.o) o)``: gravity along the axis, and the centripetal acceleration.

    `up` (n, 3): direction o of up at rest, or of the outer axis in a spin, body axes [1]; `h`
    (n,): rate about it, 0 at rest [rad/s]; `gravity`: local gravity [m/s^2]; `lever_arm` (3,):
    the accelerometers from the centre of the table, body axes [m].
    """
    across = lever_arm - (up @ lever_arm)[:, None] * up
    return np.asarray(gravity * up - (h**2)[:, None] * across)
