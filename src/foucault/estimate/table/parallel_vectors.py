"""Frame unification: the rotation between two triads, from vectors that are parallel in truth.

In a spin of the outer axis the whole-turn mean of the rate and that of the specific force both lie
along that axis. With u the first in the gyros' frame d and v the second in the accelerometers'
frame b, ``v = C_bd u``, up to the centripetal part of the specific force, which shows the lever
arm r: ``f / g = o - (h^2 / g) (r - (r.o) o)``.

References
----------
.. [1] G. Wahba, "A least squares estimate of satellite attitude", SIAM Review 7(3), 1965.
.. [2] F. L. Markley, "Attitude determination using vector observations and the singular value
   decomposition", J. Astronautical Sciences 36(3), 1988.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.rotation import cross_matrix, exp


def wahba(v: FloatArray, u: FloatArray) -> FloatArray:
    """Return the rotation C with ``v = C u`` in the least-squares sense, shape (3, 3) [1].

    `v`, `u` (n, 3): parallel vectors in the two frames [1].
    """
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
