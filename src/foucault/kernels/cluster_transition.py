"""How the attitude of a torqued cluster moves in one interval, and with what slopes.

Two workspaces are handed on, because every array costs time in a call. `wide`, flat, has rows of
48: 0-41 the constants in the order of `kernels.cluster`, 42-44 the attitude. `m` has pages (3, 3).
With L the inverse of the kinematic matrix T of eq. (14), R the rotation of p over half the interval
h, E = d drift / d f, and M = inverse of the input axes (I where the drift is left as it is)::

    Phi_pp = T' (R R + R M E [f x] R h) L        attitude on attitude
    Phi_pt = T' R (M d drift + Ti d torqued) h   attitude on constants, 10 of each gyro

T and L are I where the attitude error is a rotation of p and not three angles.
"""

import math

import numpy as np

from foucault.kernels import kernel, reduction
from foucault.kernels.cluster import actual_rate, drift_rates, inverse_input_axes
from foucault.kernels.rotation import multiply_exp

FREE_ANGLES, PLANNED, INTEGRATED = 0, 1, 2
RUNNING, INDEFINITE, NOT_FINITE, SINGULAR = 0, 1, 2, 3
WIDTH = 48
STATES = 45
CONSTANTS = 42
ANGLES = CONSTANTS  # where the attitude begins in a row
ATTITUDE = WIDTH * CONSTANTS  # where its rows begin in P
SMALLEST_COSINE = 1e-6

# Rows of `wide`: estimate; its error, not fed back; both as predicted; new rows of the covariance;
# corrections; derivatives of the readings; rows of the transition matrix; slopes of each gyro.
ESTIMATE, ERROR, PREDICTED, PREDICTED_ERROR = 0, 48, 96, 144
NEW, CORRECTION, H, F, SLOPES = 192, 336, 480, 624, 768
ROWS = 19

# Pages of `m`: C_np, Exp(-w_in h), inverse of the input axes, T, L, E, parts of Phi_pt, scratch.
C, EARTH, TI, T, L, E, A, B, X, Y, Z = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10
PAGES = 11


@kernel
def product(m, a, b, out):
    """Write page a times page b into page out, another one."""
    for i in range(3):
        x, y, z = m[a, i, 0], m[a, i, 1], m[a, i, 2]
        for j in range(3):
            m[out, i, j] = x * m[b, 0, j] + y * m[b, 1, j] + z * m[b, 2, j]


@kernel
def copy(m, a, out):
    """Write page a into page out."""
    for i in range(3):
        for j in range(3):
            m[out, i, j] = m[a, i, j]


@kernel
def unit(m, page):
    """Write I into a page."""
    for i in range(3):
        for j in range(3):
            m[page, i, j] = 1.0 if i == j else 0.0


@kernel
def attitude(outer, middle, inner, m):
    """Write C_np, rows East-North-Up, into its page."""
    so, co = math.sin(outer), math.cos(outer)
    sm, cm = math.sin(middle), math.cos(middle)
    si, ci = math.sin(inner), math.cos(inner)
    m[C, 0, 0], m[C, 0, 1], m[C, 0, 2] = co * sm * ci + so * si, co * sm * si - so * ci, co * cm
    m[C, 1, 0], m[C, 1, 1], m[C, 1, 2] = cm * ci, cm * si, -sm
    m[C, 2, 0], m[C, 2, 1], m[C, 2, 2] = so * sm * ci - co * si, so * sm * si + co * ci, so * cm


@kernel
def inverse_chart(m, cosine):
    """Write L: ``L (rates of the angles) = w_np_p``; `cosine`: of the middle angle of page C."""
    ci, si = m[C, 1, 0] / cosine, m[C, 1, 1] / cosine
    m[L, 0, 0], m[L, 0, 1], m[L, 0, 2] = -m[C, 1, 0], si, 0.0
    m[L, 1, 0], m[L, 1, 1], m[L, 1, 2] = -m[C, 1, 1], -ci, 0.0
    m[L, 2, 0], m[L, 2, 1], m[L, 2, 2] = -m[C, 1, 2], 0.0, -1.0


@kernel
def chart(m, page, angles):
    """Write the angles of C_np in `page`, and T there; False near its singularity."""
    cm = math.hypot(m[page, 1, 0], m[page, 1, 1])
    far = cm > SMALLEST_COSINE
    angles[0] = math.atan2(m[page, 2, 2], m[page, 0, 2])
    angles[1] = math.atan2(-m[page, 1, 2], cm)
    angles[2] = math.atan2(m[page, 1, 1], m[page, 1, 0])
    cm = max(cm, SMALLEST_COSINE)  # finite even there
    ci, si, tm = m[page, 1, 0] / cm, m[page, 1, 1] / cm, -m[page, 1, 2] / cm
    m[T, 0, 0], m[T, 0, 1], m[T, 0, 2] = -ci / cm, -si / cm, 0.0
    m[T, 1, 0], m[T, 1, 1], m[T, 1, 2] = si, -ci, 0.0
    m[T, 2, 0], m[T, 2, 1], m[T, 2, 2] = -ci * tm, -si * tm, -1.0
    return far


@kernel
def believed_rate(theta, m, cx, cy, cz, fx, fy, fz, full_rate):
    """Return the rate w_ip_p [rad/s] that the filter believes under the command c."""
    if full_rate:
        return actual_rate(theta, m[TI], cx, cy, cz, fx, fy, fz)
    ex, ey, ez = drift_rates(theta, fx, fy, fz)  # eqs. (19), (20)
    sx, sy, sz = (1.0 + theta[21]) * cx, (1.0 + theta[22]) * cy, (1.0 + theta[23]) * cz
    return (
        m[TI, 0, 0] * sx + m[TI, 0, 1] * sy + m[TI, 0, 2] * sz + ex,
        m[TI, 1, 0] * sx + m[TI, 1, 1] * sy + m[TI, 1, 2] * sz + ey,
        m[TI, 2, 0] * sx + m[TI, 2, 1] * sy + m[TI, 2, 2] * sz + ez,
    )


@kernel
def drift_slopes(theta, wide, m, x, y, z):
    """Write E, and into each row of slopes: drift by d, d_I ... d_OS and the two misalignments.

    (x, y, z): specific force, frame p [local g].
    """
    m0, m1, m2, m3, m4, m5 = theta[24], theta[25], theta[26], theta[27], theta[28], theta[29]
    along = (x + m0 * y + m1 * z, m2 * x + y + m3 * z, m4 * x + m5 * y + z)
    across = (y - m0 * x, x - m2 * y, x - m4 * z)
    spin = (z - m1 * x, m3 * y - z, y - m5 * z)
    for i in range(3):
        a, o, s = along[i], across[i], spin[i]
        dI = theta[3 + i] + theta[12 + i] * o + theta[15 + i] * s
        dO = theta[6 + i] + theta[12 + i] * a + theta[18 + i] * s
        dS = theta[9 + i] + theta[15 + i] * a + theta[18 + i] * o
        at = SLOPES + WIDTH * i
        wide[at], wide[at + 1], wide[at + 2], wide[at + 3] = 1.0, a, o, s
        wide[at + 4], wide[at + 5], wide[at + 6] = a * o, a * s, o * s
        if i == 0:
            m[E, 0, 0] = dI - m0 * dO - m1 * dS
            m[E, 0, 1], m[E, 0, 2] = m0 * dI + dO, m1 * dI + dS
            wide[at + 7], wide[at + 8] = dI * y - dO * x, dI * z - dS * x
        elif i == 1:
            m[E, 1, 1] = dI - m2 * dO + m3 * dS
            m[E, 1, 0], m[E, 1, 2] = m2 * dI + dO, m3 * dI - dS
            wide[at + 7], wide[at + 8] = dI * x - dO * y, dI * z + dS * y
        else:
            m[E, 2, 2] = dI - m4 * dO - m5 * dS
            m[E, 2, 0], m[E, 2, 1] = m4 * dI + dO, m5 * dI + dS
            wide[at + 7], wide[at + 8] = dI * x - dO * z, dI * y - dS * z


@kernel
def torque_slopes(wide, cx, cy, cz, tx, ty, tz):
    """Write into each row of slopes: torqued rate by its scale factor and the two misalignments.

    c: commanded rate; t: the rate that the misalignments turn, w of T w = ... [rad/s].
    """
    x, y, z = SLOPES, SLOPES + WIDTH, SLOPES + 2 * WIDTH
    wide[x + 9], wide[x + 10], wide[x + 11] = cx, -ty, -tz
    wide[y + 9], wide[y + 10], wide[y + 11] = cy, -tx, -tz
    wide[z + 9], wide[z + 10], wide[z + 11] = cz, -tx, -ty


@kernel
def transition(wide, m, wx, wy, wz, fx, fy, fz, h, full_rate):
    """Write the rows F of the transition matrix, and A = T' R M h, B = T' R Ti h.

    w, f, E and the slopes are those at mid-step; L belongs to the start, T to the end.
    """
    unit(m, X)
    multiply_exp(m[X], -0.5 * h * wx, -0.5 * h * wy, -0.5 * h * wz)  # R
    product(m, T, X, A)
    for i in range(3):  # Y = E [f x] h
        x, y, z = h * m[E, i, 0], h * m[E, i, 1], h * m[E, i, 2]
        m[Y, i, 0], m[Y, i, 1], m[Y, i, 2] = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
    if full_rate:
        product(m, TI, Y, Z)
    else:
        copy(m, Y, Z)
    m[Z, 0, 0] += 1.0
    m[Z, 1, 1] += 1.0
    m[Z, 2, 2] += 1.0
    product(m, Z, X, Y)
    product(m, A, Y, Z)  # T' R (I + ...) R
    product(m, Z, L, Y)
    for i in range(3):
        for j in range(3):
            m[A, i, j] *= h
    product(m, A, TI, B)
    if full_rate:
        copy(m, B, A)
    for r in range(3):
        at = F + WIDTH * r
        for i in range(3):
            wide[at + CONSTANTS + i] = m[Y, r, i]
            x, y, s = m[A, r, i], m[B, r, i], SLOPES + WIDTH * i
            for k in range(7):
                wide[at + 3 * k + i] = x * wide[s + k]
            wide[at + 21 + i] = y * wide[s + 9]
            wide[at + 24 + 2 * i] = x * wide[s + 7] + y * wide[s + 10]
            wide[at + 25 + 2 * i] = x * wide[s + 8] + y * wide[s + 11]


# -- prediction ------------------------------------------------------------------------------


@reduction
def _move(P, wide, m):
    """Write the new attitude rows of P: Phi_pp times the old ones and what each gyro brings."""
    f00, f01, f02 = wide[F + 42], wide[F + 43], wide[F + 44]
    f10, f11, f12 = wide[F + 90], wide[F + 91], wide[F + 92]
    f20, f21, f22 = wide[F + 138], wide[F + 139], wide[F + 140]
    for j in range(WIDTH):
        x, y, z = P[ATTITUDE + j], P[ATTITUDE + 48 + j], P[ATTITUDE + 96 + j]
        wide[NEW + j] = f00 * x + f01 * y + f02 * z
        wide[NEW + 48 + j] = f10 * x + f11 * y + f12 * z
        wide[NEW + 96 + j] = f20 * x + f21 * y + f22 * z
    for i in range(3):
        s, p, r = SLOPES + WIDTH * i, WIDTH * i, WIDTH * (24 + 2 * i)
        c1, c2, c3, c4, c5 = wide[s + 1], wide[s + 2], wide[s + 3], wide[s + 4], wide[s + 5]
        c6, c7, c8 = wide[s + 6], wide[s + 7], wide[s + 8]
        d0, d1, d2 = wide[s + 9], wide[s + 10], wide[s + 11]
        a0, a1, a2 = m[A, 0, i], m[A, 1, i], m[A, 2, i]
        b0, b1, b2 = m[B, 0, i], m[B, 1, i], m[B, 2, i]
        for j in range(WIDTH):
            y, z = P[r + j], P[r + 48 + j]
            u = P[p + j] + c1 * P[p + 144 + j] + c2 * P[p + 288 + j] + c3 * P[p + 432 + j]
            u += c4 * P[p + 576 + j] + c5 * P[p + 720 + j] + c6 * P[p + 864 + j] + c7 * y + c8 * z
            v = d0 * P[p + 1008 + j] + d1 * y + d2 * z
            wide[NEW + j] += a0 * u + b0 * v
            wide[NEW + 48 + j] += a1 * u + b1 * v
            wide[NEW + 96 + j] += a2 * u + b2 * v


@reduction
def products(wide, a, b, t):
    """Write the products of three rows from `a` and three from `b` into t (3, 3), lower half.

    Each argument of a compiled loop may be negative, for all the compiler knows, and then nothing
    is done four at a time; views that begin at the rows are not.
    """
    x, y = wide[a : a + 144], wide[b : b + 144]
    p = q = r = s = u = v = 0.0
    for j in range(WIDTH):
        x0, x1, x2, y0, y1, y2 = x[j], x[48 + j], x[96 + j], y[j], y[48 + j], y[96 + j]
        p += x0 * y0
        q += x1 * y0
        r += x1 * y1
        s += x2 * y0
        u += x2 * y1
        v += x2 * y2
    t[0, 0], t[1, 0], t[1, 1], t[2, 0], t[2, 1], t[2, 2] = p, q, r, s, u, v


@reduction
def on_error(wide, a, out):
    """Write the products of three rows from `a` with the error into out (3,)."""
    x, y = wide[a : a + 144], wide[ERROR : ERROR + 48]
    p = q = r = 0.0
    for j in range(WIDTH):
        p += x[j] * y[j]
        q += x[48 + j] * y[j]
        r += x[96 + j] * y[j]
    out[0], out[1], out[2] = p, q, r


@kernel
def propagate(P, wide, m, q, h):
    """Carry the covariance over an interval of length h, q (3,) the noise of the gyros."""
    _move(P, wide, m)
    products(wide, NEW, F, m[X])
    for r in range(3):
        for c in range(r + 1):
            s = m[X, r, c]
            for j in range(3):
                s += h * q[j] * m[T, r, j] * m[T, c, j]
            wide[NEW + WIDTH * r + ANGLES + c] = wide[NEW + WIDTH * c + ANGLES + r] = s
    for j in range(WIDTH):
        P[ATTITUDE + j] = wide[NEW + j]
        P[ATTITUDE + 48 + j] = wide[NEW + 48 + j]
        P[ATTITUDE + 96 + j] = wide[NEW + 96 + j]
    for j in range(CONSTANTS):
        P[WIDTH * j + 42] = wide[NEW + j]
        P[WIDTH * j + 43] = wide[NEW + 48 + j]
        P[WIDTH * j + 44] = wide[NEW + 96 + j]


@kernel
def predict(P, wide, m, c, h, q, full_rate, form, offset):
    """Carry everything over an interval under the command c (3,); return a code and w_ip_p.

    offset (3,) is how much the mean of f over the interval differs from f at its end.
    """
    theta, angles = wide[ESTIMATE:], wide[ESTIMATE + ANGLES :]
    if form == FREE_ANGLES:
        inverse_chart(m, math.cos(angles[1]))
    cx, cy, cz = c[0], c[1], c[2]
    x, y, z = m[C, 2, 0], m[C, 2, 1], m[C, 2, 2]
    # f at mid-step, f + h/2 f x c; what the Earth and the drift add would not be seen
    fx = x + 0.5 * h * (y * cz - z * cy)
    fy = y + 0.5 * h * (z * cx - x * cz)
    fz = z + 0.5 * h * (x * cy - y * cx)
    inverse_input_axes(theta, m[TI])
    wx, wy, wz = believed_rate(theta, m, cx, cy, cz, fx, fy, fz, full_rate)
    if not abs(wx) + abs(wy) + abs(wz) < np.inf:
        return NOT_FINITE, wx, wy, wz
    copy(m, C, X)
    multiply_exp(m[X], wx * h, wy * h, wz * h)
    product(m, EARTH, X, Y)
    if form == FREE_ANGLES and not chart(m, Y, wide[NEW:]):
        return SINGULAR, wx, wy, wz
    copy(m, Y, C)
    if form == FREE_ANGLES:
        angles[0], angles[1], angles[2] = wide[NEW], wide[NEW + 1], wide[NEW + 2]
    # The trapezoid and its first correction (Euler and Maclaurin), f' = f x w.
    x, y, z = x - m[C, 2, 0], y - m[C, 2, 1], z - m[C, 2, 2]
    offset[0] = 0.5 * x + h / 12.0 * (y * wz - z * wy)
    offset[1] = 0.5 * y + h / 12.0 * (z * wx - x * wz)
    offset[2] = 0.5 * z + h / 12.0 * (x * wy - y * wx)
    drift_slopes(theta, wide, m, fx, fy, fz)
    if full_rate:  # the misalignments turn the drift as well
        torque_slopes(wide, cx, cy, cz, wx, wy, wz)
    else:
        ex, ey, ez = believed_rate(theta, m, 0.0, 0.0, 0.0, fx, fy, fz, False)
        torque_slopes(wide, cx, cy, cz, wx - ex, wy - ey, wz - ez)
    transition(wide, m, wx, wy, wz, fx, fy, fz, h, full_rate)
    propagate(P, wide, m, q, h)
    if form != FREE_ANGLES:
        on_error(wide, F, wide[ERROR + ANGLES :])
    return RUNNING, wx, wy, wz
