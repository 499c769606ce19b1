"""Attitude and velocity of a body relative to its own axes at the start, held in inertial space.

Frame 0 is b at the start and does not turn. With theta, dv the increments of one interval, b and
c as in `kernels.strapdown`::

    v += C_0b (dv + theta x dv / 2 + theta x (theta x dv) / 6 + b x dv + c x theta)
    C_0b = C_0b Exp(theta + b x theta)

Nothing of the Earth is in it: v is the integral of the specific force in frame 0.
"""

import numpy as np

from foucault.kernels import kernel
from foucault.kernels.rotation import multiply_exp


@kernel
def from_start(dtheta, dvel, left, right):
    """Integrate increments from the identity and zero velocity.

    Parameters: dtheta, dvel (n, 3) [rad], [m/s]; left, right (n,) as in
    `kernels.strapdown.strapdown`. Returns C_0b (n, 3, 3) and the velocity (n, 3) [m/s] at the end
    of every interval.
    """
    n = left.size
    C_0b = np.empty((n, 3, 3))
    velocity = np.empty((n, 3))
    C = np.zeros((3, 3))
    C[0, 0] = C[1, 1] = C[2, 2] = 1.0
    v = np.zeros(3)
    u, b, e = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):
        a0, a1, a2 = dtheta[i, 0], dtheta[i, 1], dtheta[i, 2]
        d0, d1, d2 = dvel[i, 0], dvel[i, 1], dvel[i, 2]
        x0, x1, x2 = a1 * d2 - a2 * d1, a2 * d0 - a0 * d2, a0 * d1 - a1 * d0
        u[0] = d0 + x0 / 2.0 + (a1 * x2 - a2 * x1) / 6.0
        u[1] = d1 + x1 / 2.0 + (a2 * x0 - a0 * x2) / 6.0
        u[2] = d2 + x2 / 2.0 + (a0 * x1 - a1 * x0) / 6.0
        k0, k1 = left[i], right[i]
        before, after = i - (k0 != 0.0), i + (k1 != 0.0)
        for c in range(3):
            b[c] = k0 * dtheta[before, c] + k1 * dtheta[after, c]
            e[c] = k0 * dvel[before, c] + k1 * dvel[after, c]
        u[0] += b[1] * d2 - b[2] * d1 + e[1] * a2 - e[2] * a1
        u[1] += b[2] * d0 - b[0] * d2 + e[2] * a0 - e[0] * a2
        u[2] += b[0] * d1 - b[1] * d0 + e[0] * a1 - e[1] * a0
        a0, a1, a2 = (
            a0 + b[1] * a2 - b[2] * a1,
            a1 + b[2] * a0 - b[0] * a2,
            a2 + b[0] * a1 - b[1] * a0,
        )
        for r in range(3):
            v[r] += C[r, 0] * u[0] + C[r, 1] * u[1] + C[r, 2] * u[2]
            velocity[i, r] = v[r]
        multiply_exp(C, a0, a1, a2)
        for r in range(3):  # a slice takes seconds to compile
            for c in range(3):
                C_0b[i, r, c] = C[r, c]
    return C_0b, velocity
