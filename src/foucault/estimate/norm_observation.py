"""Calibrate a triad from the known norm of what it measures: the linear solution, exact.

With ``N = L x + b`` and ``|x| = h`` known, ``(N - b)' A (N - b) = h^2`` where ``A = inv(L L')``.
Dividing by h^2 and collecting terms gives nine unknowns that enter linearly. The scale that the
division hides is recovered exactly, so that the solution is right for errors of any size.

How the axes of gyros lie to those of accelerometers: two ways to unify their frames.

By vectors that are parallel in truth (`unify`): in a spin of the outer axis the whole-turn mean of
the rate and that of the specific force both lie along that axis. With u the first in the gyros'
frame d and v the second in the accelerometers' frame b, ``v = C_bd u``, up to the centripetal part
of the specific force, which shows the lever arm r: ``f / g = o - (h^2 / g) (r - (r.o) o)``.

As published, by four rests and two spins at known angles of the table (`unify_four_positions`): the
mounting of b on the case k comes from rests at (middle, outer) = (0, 0), (90, 0), (0, 180),
(90, 180) degrees with the inner angle zero, that of d from spins at middle angle 0 and 90 degrees.
Both to first order in the mounting; errors of the middle and inner angle enter in full, which is
why parallel vectors are the default.

References
----------
.. [1] Dong, Ren, Chen, Wang, Infrared and Laser Engineering 47(9), 2018, eqs. (7), (8), with
   the recovery made exact.
.. [2] G. Wahba, "A least squares estimate of satellite attitude", SIAM Review 7(3), 1965.
.. [3] F. L. Markley, "Attitude determination using vector observations and the singular value
   decomposition", J. Astronautical Sciences 36(3), 1988.
.. [4] Dong, Ren, Chen, Wang, Infrared and Laser Engineering 47(9), 2018, eqs. (13)-(27). Corrected:
   the printed matrices are C_bk and C_dk; (25) takes theta_y with the sign below; in (27) the
   horizontal part of the Earth's rotation averages to zero over whole turns and is left out, and
   lambda_z belongs to the second spin.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.noise import Readings
from foucault.models.rotation import cross_matrix, exp


def design(readings: FloatArray, norm: float) -> FloatArray:
    """Return the rows of `readings` (m, 3) of true `norm` [unit], shape (m, 9) [1]."""
    x, y, z = (readings / norm).T  # normalised: condition 10 instead of 3e8
    return np.stack(
        [x * x, y * y, z * z, -2 * x * y, -2 * x * z, -2 * y * z, -2 * x, -2 * y, -2 * z], axis=1
    )


def solve(readings: FloatArray, norm: float | FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Solve for the lower-triangular matrix L and the bias b of ``N = L x + b``, ``|x| = norm``.

    `readings` (m, 3): mean readings N, one per orientation, m >= 9 [unit of norm]; `norm` (m,):
    true norm, of all or of each, its sign does not count [unit of readings]. Returns `L` (3, 3):
    lower triangular, positive diagonal [1]; `b` (3,): bias [unit of readings]. None instead of
    the pair where the orientations do not determine an ellipsoid.

    With ``s = |norm| / h``, h the largest norm, ``(N - b)' A (N - b) = (s h)^2`` divided by h^2 is
    ``rows @ K = s^2 - c`` where ``c = b' A b / h^2`` follows from K itself: K is affine in c. With
    equal norms ``c = d' b / (1 + d' b)`` of the solution for c = 0; otherwise it is iterated.
    """
    sizes = np.broadcast_to(np.abs(norm), len(readings))
    h = float(sizes.max())
    s = sizes / h
    rows = design(readings, h) / s[:, None]  # equal noise in the readings, whatever their size
    right = np.column_stack([s, 1.0 / s])
    fit, _, rank, _ = np.linalg.lstsq(rows, right, rcond=1e-9)
    if rank < 9:
        return None
    # Once more for what rounding left: the decomposition costs two digits.
    fit = fit + np.linalg.lstsq(rows, right - rows @ fit, rcond=1e-9)[0]
    K = np.asarray(fit, float)
    try:
        A, d = _ellipsoid(K[:, 0] - _excess(K) * K[:, 1])
        b = np.linalg.solve(A, d)
        # L L' = inv(A) with L lower triangular
        return np.linalg.cholesky(np.linalg.inv(A)), np.asarray(b * h)
    except np.linalg.LinAlgError:  # not an ellipsoid
        return None


def _excess(K: FloatArray) -> float:
    """Find c with ``c = d' b`` where A and d are those of ``K[:, 0] - c K[:, 1]``, by secants."""

    def miss(c: float) -> float:
        A, d = _ellipsoid(K[:, 0] - c * K[:, 1])
        return float(d @ np.linalg.solve(A, d)) - c

    before, at_before = 0.0, miss(0.0)
    c = at_before / (1.0 + at_before)
    for _ in range(30):
        at = miss(c)
        if abs(at) <= 1e-16 or at == at_before:
            break
        before, at_before, c = c, at, c - at * (c - before) / (at - at_before)
    return c


def _ellipsoid(K: FloatArray) -> tuple[FloatArray, FloatArray]:
    A = np.array([[K[0], -K[3], -K[4]], [-K[3], K[1], -K[5]], [-K[4], -K[5], K[2]]])
    return A, K[6:9]


def published_recovery(readings: FloatArray, norm: float) -> tuple[FloatArray, FloatArray]:
    """Recover L and b as published, to first order: for showing what that costs.

    ``b' A b`` is neglected, so that scale factor errors are too small by about ``|b|^2 / 2``
    relative to the norm; misalignments and biases are right to first order only.

    `readings` (m, 3): mean readings, one per orientation, m >= 9 [unit of norm]; `norm`: true
    norm [unit of readings].

    References
    ----------
    .. [1] Dong et al., 2018, eqs. (8) and (12), misprints corrected.
    """
    rows = design(readings, norm)
    K = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    root = K[:3] ** -0.5
    yx = K[3] * root[0] / K[1]
    zx = K[4] * root[0] / K[2]
    zy = K[5] * root[1] / K[2]
    L = np.array([[root[0], 0.0, 0.0], [yx, root[1], 0.0], [zx, zy, root[2]]])
    return L, K[6:9] / K[:3] * norm


NEAR = np.radians(1.0)  # Angles this close are those of the method [rad].


def unify_four_positions(
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


def wahba(v: FloatArray, u: FloatArray) -> FloatArray:
    """Return C with ``v = C u`` by least squares; `v`, `u` (n, 3), shape (3, 3) [1]."""
    U, _, Vt = np.linalg.svd(v.T @ u)
    handed = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    return np.asarray((U * handed) @ Vt)


def unify(
    f_b: FloatArray, w_d: FloatArray, h: FloatArray, gravity: float, lever_arm: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Return the rotation C_bd and the lever arm from the means of spins.

    `f_b` (n, 3): mean specific force of each spin, compensated, accelerometer frame b [m/s^2];
    `w_d` (n, 3): mean rate of each spin, compensated, gyro frame d [rad/s]; `h` (n,): norm of the
    true mean rate, negative for a spin clockwise seen from above [rad/s]; `gravity`: local
    gravity [m/s^2]. Returns `C_bd` (3, 3): rotation [1]; `lever_arm` (3,): the accelerometers
    from the centre of the table, frame b [m].
    """
    # For a spin in the other sense the rate points down: without the sign C were a reflection.
    u = np.sign(h)[:, None] * w_d / np.linalg.norm(w_d, axis=1, keepdims=True)
    C, r = wahba(f_b, u), np.zeros(3)
    if not lever_arm:
        return C, r
    for _ in range(20):  # Gauss-Newton: without antipodes the two are not told apart one by one
        o = u @ C.T
        rows = -(h**2)[:, None, None] * (np.eye(3) - o[:, :, None] * o[:, None, :])
        miss = f_b - gravity * o - np.einsum("nij,j->ni", rows, r)
        # A small rotation moves o by d x o, and with it the part of r that lies along it.
        along = (gravity + h**2 * (o @ r))[:, None, None] * np.eye(3)
        by_o = along + (h**2)[:, None, None] * o[:, :, None] * r
        slope = np.concatenate([-by_o @ cross_matrix(o), rows], axis=2)
        step = np.linalg.lstsq(slope.reshape(-1, 6), miss.reshape(-1), rcond=1e-12)[0]
        C, r = exp(step[:3]) @ C, r + step[3:]
        if float(np.abs(step).max()) <= 1e-13:
            break
    return C, r
