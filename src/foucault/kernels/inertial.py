"""Attitude and velocity of a body relative to its own axes at the start, held in inertial space.

Frame 0 is b at the start and does not turn. With theta, dv the increments of one interval and '
those of the one before, k as in `kernels.strapdown`::

    v += C_0b (dv + theta x dv / 2 + theta x (theta x dv) / 6 + k (theta' x dv + dv' x theta))
    C_0b = C_0b Exp(theta + k theta' x theta)

Nothing of the Earth is in it: v is the integral of the specific force in frame 0.
"""

import numpy as np

from foucault.kernels import kernel
from foucault.kernels.rotation import multiply_exp


@kernel
def from_start(dtheta, dvel, dt, joined):
    """Integrate increments from the identity and zero velocity.

    Parameters: dtheta, dvel (n, 3) [rad], [m/s] over dt (n,) [s]; joined (n,): whether the row
    before is what went before it. Returns C_0b (n, 3, 3) and the velocity (n, 3) [m/s] at the end
    of every interval.
    """
    n = dt.size
    C_0b = np.empty((n, 3, 3))
    velocity = np.empty((n, 3))
    C = np.eye(3)
    v = np.zeros(3)
    u = np.empty(3)
    for i in range(n):
        a0, a1, a2 = dtheta[i, 0], dtheta[i, 1], dtheta[i, 2]
        d0, d1, d2 = dvel[i, 0], dvel[i, 1], dvel[i, 2]
        x0, x1, x2 = a1 * d2 - a2 * d1, a2 * d0 - a0 * d2, a0 * d1 - a1 * d0
        u[0] = d0 + x0 / 2.0 + (a1 * x2 - a2 * x1) / 6.0
        u[1] = d1 + x1 / 2.0 + (a2 * x0 - a0 * x2) / 6.0
        u[2] = d2 + x2 / 2.0 + (a0 * x1 - a1 * x0) / 6.0
        if i > 0 and joined[i]:
            k = dt[i] * dt[i] / (6.0 * dt[i - 1] * (dt[i] + dt[i - 1]))
            b0, b1, b2 = dtheta[i - 1, 0], dtheta[i - 1, 1], dtheta[i - 1, 2]
            e0, e1, e2 = dvel[i - 1, 0], dvel[i - 1, 1], dvel[i - 1, 2]
            u[0] += k * (b1 * d2 - b2 * d1 + e1 * a2 - e2 * a1)
            u[1] += k * (b2 * d0 - b0 * d2 + e2 * a0 - e0 * a2)
            u[2] += k * (b0 * d1 - b1 * d0 + e0 * a1 - e1 * a0)
            a0, a1, a2 = (
                a0 + k * (b1 * a2 - b2 * a1),
                a1 + k * (b2 * a0 - b0 * a2),
                a2 + k * (b0 * a1 - b1 * a0),
            )
        for r in range(3):
            v[r] += C[r, 0] * u[0] + C[r, 1] * u[1] + C[r, 2] * u[2]
            velocity[i, r] = v[r]
        multiply_exp(C, a0, a1, a2)
        C_0b[i] = C
    return C_0b, velocity
