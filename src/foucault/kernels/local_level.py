"""What the states of `kernels.strapdown` mean in East-North-Up, row by row."""

import math

import numpy as np

from foucault.kernels import kernel
from foucault.kernels.rotation import atan2


@kernel
def local_level(x, position, velocity, attitude, wander, angles):
    """Turn states x (m, 12) from frame l to East-North-Up.

    Fills position (m, 2) latitude and longitude [rad], velocity (m, 3) [m/s], attitude (m, 3, 3)
    C_nb, wander (m, 3, 3) C_nl, angles (m, 3) heading in [0, 2 pi), pitch and roll [rad]. Where
    attitude and wander have no rows, they are not wanted.
    """
    L, C = np.zeros((3, 3)), np.zeros((3, 3))
    framed = len(attitude) > 0
    for i in range(len(x)):
        a, b, c, d = x[i, 7], x[i, 8], x[i, 9], x[i, 10]
        up0, up1, up2 = 2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d
        level = math.sqrt(up0 * up0 + up1 * up1)
        position[i, 0] = atan2(up2, level)
        position[i, 1] = atan2(up1, up0)
        # East in frame e; at a pole along the meridian of longitude zero, as the angles say.
        s, k = (up1 / level, up0 / level) if level > 0.0 else (0.0, 1.0)
        # East along the axes of l. Both frames are level: the rest of C_nl follows.
        e0 = k * 2.0 * (b * c + a * d) - s * (a * a + b * b - c * c - d * d)
        e1 = k * (a * a - b * b + c * c - d * d) - s * 2.0 * (b * c - a * d)
        if framed:
            wander[i, 0, 0], wander[i, 0, 1], wander[i, 0, 2] = e0, e1, 0.0
            wander[i, 1, 0], wander[i, 1, 1], wander[i, 1, 2] = -e1, e0, 0.0
            wander[i, 2, 0], wander[i, 2, 1], wander[i, 2, 2] = 0.0, 0.0, 1.0
        velocity[i, 0] = e0 * x[i, 4] + e1 * x[i, 5]
        velocity[i, 1] = e0 * x[i, 5] - e1 * x[i, 4]
        velocity[i, 2] = x[i, 6]
        a, b, c, d = x[i, 0], x[i, 1], x[i, 2], x[i, 3]
        L[0, 0], L[1, 1] = a * a + b * b - c * c - d * d, a * a - b * b + c * c - d * d
        L[0, 1], L[1, 0] = 2.0 * (b * c - a * d), 2.0 * (b * c + a * d)
        L[0, 2], L[1, 2] = 2.0 * (b * d + a * c), 2.0 * (c * d - a * b)
        for j in range(3):
            C[0, j] = e0 * L[0, j] + e1 * L[1, j]
            C[1, j] = e0 * L[1, j] - e1 * L[0, j]
        C[2, 0], C[2, 1] = 2.0 * (b * d - a * c), 2.0 * (c * d + a * b)
        C[2, 2] = a * a - b * b - c * c + d * d
        for j in range(3 if framed else 0):
            attitude[i, 0, j], attitude[i, 1, j], attitude[i, 2, j] = C[0, j], C[1, j], C[2, j]
        # As `models.rotation.angles_of` has them.
        flat = math.sqrt(C[2, 0] * C[2, 0] + C[2, 2] * C[2, 2])
        upright = flat > 1e-12
        heading = atan2(C[0, 1], C[1, 1]) if upright else atan2(-C[1, 0], C[0, 0])
        heading += 2.0 * math.pi if heading < 0.0 else 0.0
        angles[i, 0] = heading if heading < 2.0 * math.pi else 0.0
        angles[i, 1] = atan2(C[2, 1], flat)
        angles[i, 2] = atan2(-C[2, 0], C[2, 2]) if upright else 0.0
