"""How the constants of a torqued cluster move its attitude and its readings: one step of slopes.

Equations and columns as in `kernels.cluster_information`, which drives this.
"""

from foucault.kernels import fused
from foucault.kernels.rotation import multiply_exp

COLUMNS = 48
RESIDUAL = 47

# Rows of the wide workspace (11, 48): sensitivities of psi, of readings beside it; both, white.
Y, S, APART, WHITE = 0, 3, 6, 9
# Pages of the small workspace (13, 3, 3): covariance of xi, T^-1, A, slopes of the drift, axes of
# the gyros, transition, H, Cholesky factor, gain; of white rows B = U H, gain and U.
P, TI, A, E, AXES, F, H, L, K, B, D, U = 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11, 12
SLOPE = 9  # two rows: slopes by the misalignments; t, which has t' H = 0


@fused
def _slopes(m, theta, fx, fy, fz, wx, wy, wz):
    """Linearise the drift at f: slopes by f, axes of the gyros, slopes of drift - T w by T."""
    m0, m1, m2 = theta[24], theta[25], theta[26]
    m3, m4, m5 = theta[27], theta[28], theta[29]
    a, o, s = fx + m0 * fy + m1 * fz, fy - m0 * fx, fz - m1 * fx
    dI = theta[3] + theta[12] * o + theta[15] * s
    dO = theta[6] + theta[12] * a + theta[18] * s
    dS = theta[9] + theta[15] * a + theta[18] * o
    m[AXES, 0, 0], m[AXES, 0, 1], m[AXES, 0, 2] = a, o, s
    m[E, 0, 0], m[E, 0, 1], m[E, 0, 2] = dI - m0 * dO - m1 * dS, m0 * dI + dO, m1 * dI + dS
    m[SLOPE, 0, 0] = -wy + dI * fy - dO * fx
    m[SLOPE, 1, 0] = -wz + dI * fz - dS * fx
    a, o, s = m2 * fx + fy + m3 * fz, fx - m2 * fy, m3 * fy - fz
    dI = theta[4] + theta[13] * o + theta[16] * s
    dO = theta[7] + theta[13] * a + theta[19] * s
    dS = theta[10] + theta[16] * a + theta[19] * o
    m[AXES, 1, 0], m[AXES, 1, 1], m[AXES, 1, 2] = a, o, s
    m[E, 1, 0], m[E, 1, 1], m[E, 1, 2] = m2 * dI + dO, dI - m2 * dO + m3 * dS, m3 * dI - dS
    m[SLOPE, 0, 1] = -wx + dI * fx - dO * fy
    m[SLOPE, 1, 1] = -wz + dI * fz + dS * fy
    a, o, s = m4 * fx + m5 * fy + fz, fx - m4 * fz, fy - m5 * fz
    dI = theta[5] + theta[14] * o + theta[17] * s
    dO = theta[8] + theta[14] * a + theta[20] * s
    dS = theta[11] + theta[17] * a + theta[20] * o
    m[AXES, 2, 0], m[AXES, 2, 1], m[AXES, 2, 2] = a, o, s
    m[E, 2, 0], m[E, 2, 1], m[E, 2, 2] = m4 * dI + dO, m5 * dI + dS, dI - m4 * dO - m5 * dS
    m[SLOPE, 0, 2] = -wx + dI * fx - dO * fz
    m[SLOPE, 1, 2] = -wy + dI * fy - dS * fz


@fused
def _constants_move(wide, m, there, half, theta, scale, span, wx, wy, wz):
    """Add to Y what the constants of the gyros do to psi over `span` [s]."""
    for i in range(3):
        m0, m1 = theta[24 + 2 * i], theta[25 + 2 * i]
        if i == 0:
            sensed = wx + m0 * wy + m1 * wz
        elif i == 1:
            sensed = m0 * wx + wy + m1 * wz
        else:
            sensed = m0 * wx + m1 * wy + wz
        a, o, s = m[AXES, i, 0], m[AXES, i, 1], m[AXES, i, 2]
        drift = theta[i] + (theta[3 + i] + theta[12 + i] * o + theta[15 + i] * s) * a
        drift += (theta[6 + i] + theta[18 + i] * s) * o + theta[9 + i] * s
        command = (sensed - drift) * (1.0 / (1.0 + theta[21 + i]))
        d = scale[3 + i]
        dI, dO, dS = a * scale[6 + i], o * scale[9 + i], s * scale[12 + i]
        dIO, dIS, dOS = a * o * scale[15 + i], a * s * scale[18 + i], o * s * scale[21 + i]
        dK = command * scale[24 + i]
        t0, t1 = m[SLOPE, 0, i] * scale[27 + 2 * i], m[SLOPE, 1, i] * scale[28 + 2 * i]
        for b in range(3):
            g = m[A, b, i] * span
            wide[Y + b, 3 + i] += g * d
            wide[Y + b, 6 + i] += g * dI
            wide[Y + b, 9 + i] += g * dO
            wide[Y + b, 12 + i] += g * dS
            wide[Y + b, 15 + i] += g * dIO
            wide[Y + b, 18 + i] += g * dIS
            wide[Y + b, 21 + i] += g * dOS
            wide[Y + b, 24 + i] += g * dK
            wide[Y + b, 27 + 2 * i] += g * t0
            wide[Y + b, 28 + 2 * i] += g * t1


@fused
def _mix(wide, m):
    """Replace Y by ``Y + F Y``."""
    f00, f01, f02 = m[F, 0, 0], m[F, 0, 1], m[F, 0, 2]
    f10, f11, f12 = m[F, 1, 0], m[F, 1, 1], m[F, 1, 2]
    f20, f21, f22 = m[F, 2, 0], m[F, 2, 1], m[F, 2, 2]
    for j in range(COLUMNS):
        x = wide[Y, j]
        y = wide[Y + 1, j]
        z = wide[Y + 2, j]
        wide[Y, j] = x + f00 * x + f01 * y + f02 * z
        wide[Y + 1, j] = y + f10 * x + f11 * y + f12 * z
        wide[Y + 2, j] = z + f20 * x + f21 * y + f22 * z


@fused
def _propagate(m, half, q):
    """Replace P by ``(I + F) P (I + F)' + q A A'``; `half` is scratch."""
    for i in range(3):
        f0, f1, f2 = m[F, i, 0], m[F, i, 1], m[F, i, 2]
        for j in range(3):
            half[i, j] = m[P, i, j] + f0 * m[P, 0, j] + f1 * m[P, 1, j] + f2 * m[P, 2, j]
    for i in range(3):
        b0, b1, b2 = half[i, 0], half[i, 1], half[i, 2]
        a0, a1, a2 = q * m[A, i, 0], q * m[A, i, 1], q * m[A, i, 2]
        for j in range(i + 1):
            p = half[i, j] + b0 * m[F, j, 0] + b1 * m[F, j, 1] + b2 * m[F, j, 2]
            p += a0 * m[A, j, 0] + a1 * m[A, j, 1] + a2 * m[A, j, 2]
            m[P, i, j] = p
            m[P, j, i] = p


@fused
def move(wide, m, there, half, theta, scale, ux, uy, uz, span, px, py, pz, q):
    """Carry sensitivities and covariance of xi over `span` [s] in which p turned by (px, py, pz).

    C is C_ip at the end of the span; the slopes are those at its middle, with up in i there.
    """
    for i in range(3):
        for j in range(3):
            half[i, j] = there[i, j]
    multiply_exp(half, -0.5 * px, -0.5 * py, -0.5 * pz)
    fx = half[0, 0] * ux + half[1, 0] * uy + half[2, 0] * uz
    fy = half[0, 1] * ux + half[1, 1] * uy + half[2, 1] * uz
    fz = half[0, 2] * ux + half[1, 2] * uy + half[2, 2] * uz
    rate = 1.0 / span
    wx, wy, wz = px * rate, py * rate, pz * rate
    _slopes(m, theta, fx, fy, fz, wx, wy, wz)
    for i in range(3):
        c0, c1, c2 = half[i, 0], half[i, 1], half[i, 2]
        for j in range(3):
            m[A, i, j] = c0 * m[TI, 0, j] + c1 * m[TI, 1, j] + c2 * m[TI, 2, j]
    for i in range(3):  # E [f x] C_pi, row by row
        x = span * (m[E, i, 1] * fz - m[E, i, 2] * fy)
        y = span * (m[E, i, 2] * fx - m[E, i, 0] * fz)
        z = span * (m[E, i, 0] * fy - m[E, i, 1] * fx)
        for j in range(3):
            m[E, i, j] = x * half[j, 0] + y * half[j, 1] + z * half[j, 2]
    for i in range(3):
        a0, a1, a2 = m[A, i, 0], m[A, i, 1], m[A, i, 2]
        for j in range(3):
            m[F, i, j] = a0 * m[E, 0, j] + a1 * m[E, 1, j] + a2 * m[E, 2, j]
    _mix(wide, m)
    _constants_move(wide, m, there, half, theta, scale, span, wx, wy, wz)
    _propagate(m, half, q * span)


@fused
def look(wide, m, there, theta, scale, fx, fy, fz, X, V, Z, wx, wy, wz):
    """Write H, the rows S, what readings say of the constants beside H Y, and t of ``t' H = 0``."""
    sx = 1.0 + theta[33] + 2.0 * theta[39] * X
    sy = 1.0 + theta[34] + 2.0 * theta[40] * V
    sz = 1.0 + theta[35] + 2.0 * theta[41] * Z
    b, c, d = theta[36], theta[37], theta[38]
    # axis x f for the axes (1, 0, 0), (b, 1, 0), (c, d, 1); a late reading says -tau dA/dt,
    # where f' = f x w_np makes dA/dt the product of axis x f and w_np.
    y0, y1, y2 = sy * fz, -sy * b * fz, sy * (b * fy - fx)
    z0, z1, z2 = sz * (d * fz - fy), sz * (fx - c * fz), sz * (c * fy - d * fx)
    for j in range(3):
        c0, c1, c2 = there[j, 0], there[j, 1], there[j, 2]
        m[H, 0, j] = sx * (c2 * fy - c1 * fz)
        m[H, 1, j] = c0 * y0 + c1 * y1 + c2 * y2
        m[H, 2, j] = c0 * z0 + c1 * z1 + c2 * z2
    wide[S, 33] = scale[33]
    wide[S + 1, 34] = scale[34]
    wide[S + 2, 35] = scale[35]
    wide[S, 36] = X * scale[36]
    wide[S + 1, 37] = V * scale[37]
    wide[S + 2, 38] = Z * scale[38]
    wide[S + 1, 39] = sy * fx * scale[39]
    wide[S + 2, 40] = sz * fx * scale[40]
    wide[S + 2, 41] = sz * fy * scale[41]
    wide[S, 42] = X * X * scale[42]
    wide[S + 1, 43] = V * V * scale[43]
    wide[S + 2, 44] = Z * Z * scale[44]
    wide[S, 45] = -sx * (wz * fy - wy * fz) * scale[45]
    wide[S + 1, 45] = -(y0 * wx + y1 * wy + y2 * wz) * scale[45]
    wide[S + 2, 45] = -(z0 * wx + z1 * wy + z2 * wz) * scale[45]
    fy -= d * fz
    fx -= b * fy + c * fz
    m[SLOPE, 2, 0], m[SLOPE, 2, 1], m[SLOPE, 2, 2] = fx * sy * sz, fy * sx * sz, fz * sx * sy
