"""Frame unification as published: four rests and two spins at known angles of the table.

The mounting of the accelerometers' frame b on the case k comes from rests at (middle, outer) =
(0, 0), (90, 0), (0, 180), (90, 180) degrees with the inner angle zero, that of the gyros' frame d
from spins at middle angle 0 and 90 degrees. Both to first order in the mounting; errors of the
middle and inner angle enter in full, which is why `parallel_vectors` is the default.

References
----------
.. [1] Dong, Ren, Chen, Wang, Infrared and Laser Engineering 47(9), 2018, eqs. (13)-(27). Corrected:
   the printed matrices are C_bk and C_dk; (25) takes theta_y with the sign below; in (27) the
   horizontal part of the Earth's rotation averages to zero over whole turns and is left out, and
   lambda_z belongs to the second spin.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.readings import Readings
from foucault.models.rotation import exp

NEAR = np.radians(1.0)
"""Angles this close are those of the method [rad]."""


def unify(
    readings: Readings, accel_bias: FloatArray, gyro_bias: FloatArray, h: FloatArray, gravity: float
) -> FloatArray:
    """Return the rotation C_bd from the four rests and the two spins, shape (3, 3) [1].

    `readings`: rests and spins with the angles of the table [SI]; `accel_bias` (3,): bias of the
    accelerometers [m/s^2]; `gyro_bias` (3,): bias of the gyros [rad/s]; `h` (n,): norm of the
    true mean rates, signed [rad/s]; `gravity`: local gravity [m/s^2].
    """
    assert readings.accel is not None and readings.gyro is not None
    force = (readings.accel - accel_bias) / gravity
    up1, side1, up2, side2 = (
        force[_find(readings, middle, outer)]
        for middle, outer in ((0, 0), (90, 0), (0, 180), (90, 180))
    )
    # eq. (25): what the plumb error does to two rests half a turn apart cancels
    theta = np.array([(up1[1] + up2[1]) / 2, -(up1[0] + up2[0]) / 2, (side1[0] + side2[0]) / 2])
    first, second = _find(readings, 0, None), _find(readings, 90, None)
    rate1 = (readings.gyro[first] - gyro_bias) / h[first]
    rate2 = (readings.gyro[second] - gyro_bias) / h[second]
    lam = np.array([rate1[1], -rate1[0], rate2[0]])  # eq. (27)
    return np.asarray(exp(-theta) @ exp(lam))


def _find(readings: Readings, middle: float, outer: float | None) -> int:
    """Return the number of the rest, or of the spin where `outer` is None, at angles in degrees."""
    wanted = np.array([0.0 if outer is None else outer, middle, 0.0])
    off = np.abs(np.angle(np.exp(1j * (readings.angles - np.radians(wanted)))))
    if outer is None:
        off[:, 0] = 0.0
    mine = readings.spin == (outer is None)
    near = np.flatnonzero(mine & (np.nan_to_num(off, nan=np.inf).max(axis=1) < NEAR))
    if not len(near):
        what = "spin" if outer is None else f"rest at outer angle {outer:g} deg,"
        raise error("unification.four_positions", what=f"{what} middle angle {middle:g} deg")
    return int(near[0])
