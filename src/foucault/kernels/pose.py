"""Smoothing of the motion of an IMU between poses, with what constant parameters do to it.

Errors of a node are ``x = (phi, dv, dp)``: attitude in body axes, ``C_true = C Exp(phi)``, velocity
and position in the world of the pose. A Kalman filter of x carries ``U``, the derivative of its
state by the parameters [Friedland]: what it makes white are rows ``nu = M delta + e`` that hold
all that poses say of the parameters, the motion eliminated. Once the step delta is known a
Rauch-Tung-Striebel pass returns the motion that goes with it.

Where errors of poses are like those before them they are states too, ``x = (phi, dv, dp, e)``, the
errors of the 6 numbers of a pose: each keeps the part `keep` of itself from pose to pose, and has
the variance `stays`. Without them both are of no length.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel, part
from foucault.kernels.small_matrices import cholesky, copy, substitute


@part
def _exp(p, C):
    """Fill C (3, 3) with Exp(p)."""
    s = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    a = math.sqrt(s)
    sa = 1.0 - s / 6.0 if a < 1e-4 else math.sin(a) / a
    ca = 0.5 - s / 24.0 if a < 1e-4 else (1.0 - math.cos(a)) / s
    x, y, z = p[0], p[1], p[2]
    C[0, 0] = 1.0 - ca * (y * y + z * z)
    C[1, 1] = 1.0 - ca * (x * x + z * z)
    C[2, 2] = 1.0 - ca * (x * x + y * y)
    C[0, 1], C[1, 0] = ca * x * y - sa * z, ca * x * y + sa * z
    C[0, 2], C[2, 0] = ca * x * z + sa * y, ca * x * z - sa * y
    C[1, 2], C[2, 1] = ca * y * z - sa * x, ca * y * z + sa * x


@inlined
def _pulled(K, E, h, D, A, Y, width):
    """Replace the first columns of Y (9, width) by F Y + (A; D; h D / 2), one sample on.

    K (3, 3): what attitude errors do to its force turned; E (3, 3) its turn; D (3, width) is
    added to the velocity, A (3, width) to the attitude.
    """
    # Numbers that are named, and one loop over columns: so it is compiled for many at once.
    k00, k01, k02, k10, k11, k12 = K[0, 0], K[0, 1], K[0, 2], K[1, 0], K[1, 1], K[1, 2]
    k20, k21, k22, e20, e21, e22 = K[2, 0], K[2, 1], K[2, 2], E[0, 2], E[1, 2], E[2, 2]
    e00, e01, e02, e10, e11, e12 = E[0, 0], E[1, 0], E[2, 0], E[0, 1], E[1, 1], E[2, 1]
    half = 0.5 * h
    for c in range(width):
        x, y, z, u, v, w = Y[0, c], Y[1, c], Y[2, c], Y[3, c], Y[4, c], Y[5, c]
        a = k00 * x + k01 * y + k02 * z + D[0, c]
        b = k10 * x + k11 * y + k12 * z + D[1, c]
        d = k20 * x + k21 * y + k22 * z + D[2, c]
        Y[0, c] = e00 * x + e01 * y + e02 * z + A[0, c]
        Y[1, c] = e10 * x + e11 * y + e12 * z + A[1, c]
        Y[2, c] = e20 * x + e21 * y + e22 * z + A[2, c]
        Y[3, c] = u + a
        Y[4, c] = v + b
        Y[5, c] = w + d
        Y[6, c] += h * u + half * a
        Y[7, c] += h * v + half * b
        Y[8, c] += h * w + half * d


@kernel
def preintegrate(node, dt, theta, force, middle, K_g, K_a, raw_g, raw_a, late, q_g, q_a, out, J, Q):
    """Add up increments from node to node; node (m,) is the number of the last sample before it.

    theta, force, middle (n, 3): increments of angle, velocity, position over dt (n,), corrected;
    raw_g, raw_a, late (n, 3): angle, velocity before the matrices' errors, and derivative of the
    velocity by the accelerometers' delay. out (m, 16): C (9), dv, dp, T; J (m, 9, 22): derivative
    of (phi, dv, dp) by biases of gyros, accelerometers, 9 of gyros, 6 of accelerometers, delay;
    Q (m, 9, 9) noise. Entry k leads from node k - 1 to node k. J may have no rows: it is left.
    """
    m, slopes = node.shape[0], J.shape[0] > 0
    C, E, X, K = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    v, p = np.zeros(3), np.zeros(3)
    # Columns of Y: the noise, and from 12 on what parameters do; of g, a what they do to a sample.
    Y, S, D, A = np.zeros((9, 36)), np.zeros((9, 12)), np.zeros((3, 36)), np.zeros((3, 36))
    g, a, width = np.zeros((3, 22)), np.zeros((3, 22)), 36 if slopes else 12
    for k in range(1, m):
        for i in range(3):
            v[i] = 0.0
            p[i] = 0.0
            for j in range(3):
                C[i, j] = 1.0 if i == j else 0.0
        for i in range(9):
            for c in range(width):
                Y[i, c] = 0.0
        total = 0.0
        for r in range(node[k - 1] + 1, node[k] + 1):
            h = dt[r]
            total += h
            _exp(theta[r], E)
            _crossed(C, force[r], -1.0, K)
            if slopes:
                for i in range(3):
                    for j in range(3):
                        g[i, j] = -K_g[i, j] * h
                        a[i, 3 + j] = -K_a[i, j] * h
                        for c in range(3):
                            g[i, 6 + 3 * j + c] = -K_g[i, j] * raw_g[r, c]
                    a[i, 21] = late[r, i]
                    column = 15
                    for j in range(3):
                        for c in range(j + 1):
                            a[i, column] = -K_a[i, j] * raw_a[r, c]
                            column += 1
                # The force in axes of the beginning, u + theta x u / 2: both change. Columns cancel
                # where a motion does not show them, and must not be less exact than that.
                u0, u1, u2 = force[r, 0], force[r, 1], force[r, 2]
                t0, t1, t2 = 0.5 * theta[r, 0], 0.5 * theta[r, 1], 0.5 * theta[r, 2]
                c00, c01, c02, c10, c11, c12 = C[0, 0], C[0, 1], C[0, 2], C[1, 0], C[1, 1], C[1, 2]
                c20, c21, c22 = C[2, 0], C[2, 1], C[2, 2]
                for c in range(22):
                    x, y, z, d, e, f = g[0, c], g[1, c], g[2, c], a[0, c], a[1, c], a[2, c]
                    A[0, 12 + c] = x - (t1 * z - t2 * y)
                    A[1, 12 + c] = y - (t2 * x - t0 * z)
                    A[2, 12 + c] = z - (t0 * y - t1 * x)
                    x, y, z = (
                        d + 0.5 * (y * u2 - z * u1) + t1 * f - t2 * e,
                        e + 0.5 * (z * u0 - x * u2) + t2 * d - t0 * f,
                        f + 0.5 * (x * u1 - y * u0) + t0 * e - t1 * d,
                    )
                    D[0, 12 + c] = c00 * x + c01 * y + c02 * z
                    D[1, 12 + c] = c10 * x + c11 * y + c12 * z
                    D[2, 12 + c] = c20 * x + c21 * y + c22 * z
            _pulled(K, E, h, D, A, Y, width)
            # The position first, with velocity and attitude of the beginning.
            for i in range(3):
                p[i] += v[i] * h
                for j in range(3):
                    p[i] += C[i, j] * middle[r, j]
                    v[i] += C[i, j] * force[r, j]
            # Noise: S <- F S F' + N, by its columns and then by its rows.
            for i in range(9):
                for c in range(9):
                    S[i, c] = Y[c, i]
            _pulled(K, E, h, D, A, S, width - width // 36 * 24)
            for i in range(3):
                S[i, i] += q_g * h
                S[3 + i, 3 + i] += q_a * h
                S[6 + i, 6 + i] += q_a * h * h * h / 3.0
                S[3 + i, 6 + i] += q_a * h * h / 2.0
                S[6 + i, 3 + i] += q_a * h * h / 2.0
            for i in range(9):
                for c in range(9):
                    Y[i, c] = S[i, c]
            _times(C, E, X)
            copy(X, C)
        for i in range(3):
            for j in range(3):
                out[k, 3 * i + j] = C[i, j]
            out[k, 9 + i] = v[i]
            out[k, 12 + i] = p[i]
        out[k, 15] = total
        for i in range(9):
            for c in range(9):
                Q[k, i, c] = Y[i, c]
            if slopes:
                for c in range(22):
                    J[k, i, c] = Y[i, 12 + c]


@part
def _crossed(C, u, sign, out):
    """Fill out (3, 3) with sign C [u x]."""
    for i in range(3):
        out[i, 0] = sign * (C[i, 1] * u[2] - C[i, 2] * u[1])
        out[i, 1] = sign * (C[i, 2] * u[0] - C[i, 0] * u[2])
        out[i, 2] = sign * (C[i, 0] * u[1] - C[i, 1] * u[0])


@part
def _times(A, B, out):
    """Fill out (3, 3) with A B."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@part
def _log(C, out):
    """Fill out (3,) with the rotation vector of C (3, 3), by its quaternion's largest part."""
    trace = C[0, 0] + C[1, 1] + C[2, 2]
    j, largest = 0, trace
    for i in range(3):
        if C[i, i] > largest:
            j, largest = i + 1, C[i, i]
    a, b, c = C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]
    w, x, y, z = 1.0 + trace, a, b, c
    xy, xz, yz = C[0, 1] + C[1, 0], C[0, 2] + C[2, 0], C[1, 2] + C[2, 1]
    if j == 1:
        w, x, y, z = a, 1.0 + 2.0 * C[0, 0] - trace, xy, xz
    elif j == 2:
        w, x, y, z = b, xy, 1.0 + 2.0 * C[1, 1] - trace, yz
    elif j == 3:
        w, x, y, z = c, xz, yz, 1.0 + 2.0 * C[2, 2] - trace
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    k = 2.0 / w if sine < 1e-12 * w else 2.0 * math.atan2(sine, w) / sine
    out[0], out[1], out[2] = k * x, k * y, k * z


@part
def _turning(by, K_g, raw, d, D):
    """Fill three rows of D by the errors of the gyros: turned since the node, `by` (3, 3)."""
    for i in range(3):
        for j in range(3):
            s = by[i, 0] * K_g[0, j] + by[i, 1] * K_g[1, j] + by[i, 2] * K_g[2, j]
            D[i, 10 + j] = -s * d
            for n in range(3):
                D[i, 16 + 3 * j + n] = -s * raw[n]


@part
def _cross(a, b, out):
    """Fill out (3,) with a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@part
def _arm(arm, share, C, E, CE, w, moving, place, since, d, K_g, raw, K, u, z, H, D):
    """Fill three rows of a place on the body: what was measured less where it is, H and D.

    arm (3,) turns with the body; share: how much of the IMU's place and velocity is in it. Of D
    (3, p) not the columns of the arm itself; it may have none.
    """
    for i in range(3):
        u[i] = E[i, 0] * arm[0] + E[i, 1] * arm[1] + E[i, 2] * arm[2]
    _crossed(C, u, -1.0, K)
    for i in range(3):
        z[i] = place[i] - (CE[i, 0] * arm[0] + CE[i, 1] * arm[1] + CE[i, 2] * arm[2])
        for j in range(3):
            H[i, j] = K[i, j]
        H[i, 3 + i], H[i, 6 + i] = share * d, share
    if D.shape[1] == 0:
        return
    _crossed(CE, arm, -1.0, K)
    _turning(K, K_g, raw, d, D)
    _cross(w, arm, u)
    for i in range(3):
        fast = CE[i, 0] * u[0] + CE[i, 1] * u[1] + CE[i, 2] * u[2]
        D[i, 6] = share * moving[i] + fast
        D[i, 7] = D[i, 6] * since


@part
def _along(e, T, W, rows):
    """Turn three rows (3, n) to axes along e (3,), level across it, and across both."""
    size = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    level = math.sqrt(e[0] * e[0] + e[1] * e[1])
    T[0, 0], T[0, 1], T[0, 2] = e[0] / size, e[1] / size, e[2] / size
    T[1, 0], T[1, 1], T[1, 2] = e[1] / level, -e[0] / level, 0.0
    _cross(T[1], T[0], T[2])
    for c in range(rows.shape[1]):
        for i in range(3):
            W[i] = T[i, 0] * rows[0, c] + T[i, 1] * rows[1, c] + T[i, 2] * rows[2, c]
        for i in range(3):
            rows[i, c] = W[i]


@kernel
def compared(node, later, since, dt, theta, force, raw_g, K_g, C, v, p, g_v, C_bm, lever, arm,
             share, kind, position, other, C_vm, z, H, D):  # fmt: skip
    """Compare poses with a point: z (m, 6), H (m, 6, 9) by the motion, D (m, 6, p) by parameters.

    later (m,): time since the node; since (m,): stamp less the middle of all; g_v (3,) gravity.
    The first three numbers of a pose are, by kind, nothing (0), its attitude C_vm (1), the place of
    a second antenna, other (m, 3), whose arm (3,) turns with the body and which has a share of the
    IMU's place (2), or the same along the base and across it (3). D may have no columns.

    What is turned since a node is that of the parabola of the rate whose means over three intervals
    are the increments': their mean alone misses what an oscillation does in between, and that would
    look like a scale factor.
    """
    E, CE, K, R = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    w, e, u = np.zeros(3), np.zeros(3), np.zeros(3)
    raw, place, moving = np.zeros(3), np.zeros(3), np.zeros(3)
    p_D = D.shape[2]
    for k in range(node.shape[0]):
        n, d = node[k], later[k]
        h = dt[n + 1]
        for i in range(3):
            m0, m1, m2 = theta[n, i] / dt[n], theta[n + 1, i] / h, theta[n + 2, i] / dt[n + 2]
            bend, dw = (m2 - 2.0 * m1 + m0) / (2.0 * h * h), (m1 - m0) / h
            w[i] = (m0 + m1) / 2.0 - bend * h * h / 3.0
            e[i] = d * (w[i] + d * (dw / 2.0 + d * bend / 3.0))
            w[i] += d * (dw + d * bend)
            u[i] = (force[n, i] / dt[n] + force[n + 1, i] / h) / 2.0
            raw[i] = raw_g[n + 1, i] / h * d
        _exp(e, E)
        _times(C[k], E, CE)
        for i in range(3):
            a = C[k, i, 0] * u[0] + C[k, i, 1] * u[1] + C[k, i, 2] * u[2] + g_v[i]
            moving[i] = v[k, i] + a * d
            e[i] = p[k, i] + v[k, i] * d + a * d * d / 2.0
            place[i] = position[k, i] - e[i]
        _arm(lever, 1.0, C[k], E, CE, w, moving, place, since[k], d, K_g, raw, K, u,
             z[k, 3:], H[k, 3:], D[k, 3:])  # fmt: skip
        if p_D > 0:
            for i in range(3):
                for j in range(3):
                    D[k, 3 + i, 3 + j] = CE[i, j]
        if kind == 1:
            _times(CE, C_bm, K)
            for i in range(3):
                for j in range(3):
                    R[i, j] = 0.0
                    H[k, i, j] = 0.0
                    for o in range(3):
                        R[i, j] += K[o, i] * C_vm[k, o, j]
                        H[k, i, j] += C_bm[o, i] * E[j, o]
            _log(R, z[k])
            if p_D > 0:
                for i in range(3):
                    for j in range(3):
                        R[i, j] = C_bm[j, i]
                    D[k, i, i] = 1.0
                    D[k, i, 6] = w[0] * C_bm[0, i] + w[1] * C_bm[1, i] + w[2] * C_bm[2, i]
                    D[k, i, 7] = D[k, i, 6] * since[k]
                _turning(R, K_g, raw, d, D[k])
        elif kind > 1:
            for i in range(3):
                place[i] = other[k, i] - share * e[i]
            _arm(arm, share, C[k], E, CE, w, moving, place, since[k], d, K_g, raw, K, u,
                 z[k, :3], H[k, :3], D[k, :3])  # fmt: skip
            if p_D > 0:
                for i in range(3):
                    for j in range(3):
                        D[k, i, j] = CE[i, j]
                        D[k, i, 3 + j] = share * CE[i, j]
            if kind == 3:
                for i in range(3):
                    e[i] = CE[i, 0] * arm[0] + CE[i, 1] * arm[1] + CE[i, 2] * arm[2]
                _along(e, R, u, z[k, :3].reshape(3, 1))
                _along(e, R, u, H[k, :3])
                _along(e, R, u, D[k, :3])


@inlined
def _across(C, i, x, y, z):
    """Return row i of -C [u x], u = (x, y, z)."""
    return C[i, 2] * y - C[i, 1] * z, C[i, 0] * z - C[i, 2] * x, C[i, 1] * x - C[i, 0] * y


@inlined
def _carried(C, moved, keep, Y, width):
    """Replace the first columns of Y (15, width) by Phi Y, from a node to the next.

    C (3, 3): attitude there; moved (16,) and keep (n,) as `forward` takes them.
    """
    # Numbers that are named, and one loop over columns: so it is compiled for many at once.
    e00, e01, e02, e10, e11, e12 = moved[0], moved[3], moved[6], moved[1], moved[4], moved[7]
    e20, e21, e22, T = moved[2], moved[5], moved[8], moved[15]
    a0, a1, a2, b0, b1, b2 = moved[9], moved[10], moved[11], moved[12], moved[13], moved[14]
    v00, v01, v02 = _across(C, 0, a0, a1, a2)
    v10, v11, v12 = _across(C, 1, a0, a1, a2)
    v20, v21, v22 = _across(C, 2, a0, a1, a2)
    p00, p01, p02 = _across(C, 0, b0, b1, b2)
    p10, p11, p12 = _across(C, 1, b0, b1, b2)
    p20, p21, p22 = _across(C, 2, b0, b1, b2)
    for c in range(width):
        x, y, z, u, v, w = Y[0, c], Y[1, c], Y[2, c], Y[3, c], Y[4, c], Y[5, c]
        Y[0, c] = e00 * x + e01 * y + e02 * z
        Y[1, c] = e10 * x + e11 * y + e12 * z
        Y[2, c] = e20 * x + e21 * y + e22 * z
        Y[3, c] = u + v00 * x + v01 * y + v02 * z
        Y[4, c] = v + v10 * x + v11 * y + v12 * z
        Y[5, c] = w + v20 * x + v21 * y + v22 * z
        Y[6, c] += T * u + p00 * x + p01 * y + p02 * z
        Y[7, c] += T * v + p10 * x + p11 * y + p12 * z
        Y[8, c] += T * w + p20 * x + p21 * y + p22 * z
    for i in range(keep.shape[0]):
        for c in range(width):
            Y[9 + i, c] *= keep[i]


@inlined
def _pushed(C, moved, J, G, Y, first):
    """Add to Y (15, first + 32), from column `first`, what parameters do on the way to a node."""
    T = moved[15]
    c00, c01, c02, c10, c11, c12 = C[0, 0], C[0, 1], C[0, 2], C[1, 0], C[1, 1], C[1, 2]
    c20, c21, c22 = C[2, 0], C[2, 1], C[2, 2]
    for c in range(22):
        x, y, z, u, v, w = J[3, c], J[4, c], J[5, c], J[6, c], J[7, c], J[8, c]
        Y[0, first + 10 + c] += J[0, c]
        Y[1, first + 10 + c] += J[1, c]
        Y[2, first + 10 + c] += J[2, c]
        Y[3, first + 10 + c] += c00 * x + c01 * y + c02 * z
        Y[4, first + 10 + c] += c10 * x + c11 * y + c12 * z
        Y[5, first + 10 + c] += c20 * x + c21 * y + c22 * z
        Y[6, first + 10 + c] += c00 * u + c01 * v + c02 * w
        Y[7, first + 10 + c] += c10 * u + c11 * v + c12 * w
        Y[8, first + 10 + c] += c20 * u + c21 * v + c22 * w
    for i in range(3):
        for c in range(2):
            Y[3 + i, first + 8 + c] += T * G[i, c]
            Y[6 + i, first + 8 + c] += 0.5 * T * T * G[i, c]


@inlined
def _spread(C, moved, Q, keep, stays, P, W, width):
    """Replace P (15, 16 or more), which holds Phi P, by Phi P Phi' + Q, by way of W (15, 16).

    Q (9, 9) has axes of the body: velocity and position are turned by C.
    """
    d = 9 + keep.shape[0]
    for i in range(d):
        for j in range(d):
            W[i, j] = P[j, i]
    _carried(C, moved, keep, W, width)
    for i in range(9, d):
        W[i, i] += (1.0 - keep[i - 9] * keep[i - 9]) * stays[i - 9]
    for a in range(3):
        for b in range(a + 1):
            for i in range(3):
                x, y, z = Q[3 * a + i, 3 * b], Q[3 * a + i, 3 * b + 1], Q[3 * a + i, 3 * b + 2]
                if a > 0:
                    x, y, z = 0.0, 0.0, 0.0
                    for n in range(3):
                        x += C[i, n] * Q[3 * a + n, 3 * b]
                        y += C[i, n] * Q[3 * a + n, 3 * b + 1]
                        z += C[i, n] * Q[3 * a + n, 3 * b + 2]
                for j in range(3):
                    s = x if j == 0 else (y if j == 1 else z)
                    if b > 0:
                        s = x * C[j, 0] + y * C[j, 1] + z * C[j, 2]
                    W[3 * a + i, 3 * b + j] += s
    for i in range(d):
        for j in range(i + 1):
            P[i, j] = P[j, i] = W[i, j]


@kernel
def forward(C, moved, J, Q, u, G, keep, stays, z, H, D, R, P0, nu, M, x_f, P_f):
    """Filter the poses; fill nu (m, 6), M (m, 6, p) white, and x_f, P_f after each pose.

    C (m, 3, 3): attitude of the nodes; u (m, d): predicted less nominal; G (3, 2): gravity by
    level; keep (m, d - 9), stays (d - 9,): of errors that stay; z (m, 6), H (m, 6, d),
    D (m, 6, p), R (m, 6): pose less nominal, its derivatives, variances, infinite where there is
    none. Without parameters, p = 0 for 32, the motion alone; without rows of x_f, only what is
    white is kept. False where a covariance is none.
    """
    m, p, d = z.shape[0], D.shape[2], P0.shape[0]
    # Columns of Y: the covariance of the state, less the state at 15, its derivatives from 16 on.
    # All of them move alike, and a pose takes from all of them alike.
    Y, row, W, width = np.zeros((15, 48)), np.zeros(48), np.zeros((15, 16)), 16 + p
    for i in range(d):
        for n in range(d):
            Y[i, n] = P0[i, n]
    for k in range(m):
        if k:
            _carried(C[k - 1], moved[k], keep[k], Y, width)
            _spread(C[k - 1], moved[k], Q[k], keep[k], stays, Y, W, 16 if d > 9 else 12)
            for i in range(d):
                Y[i, 15] += u[k, i]
            if p > 0:
                _pushed(C[k - 1], moved[k], J[k], G, Y, 16)
        # The numbers of a pose are independent of one another: one after the other.
        for q in range(6):
            var = R[k, q]
            if not var < 1e30:
                nu[k, q] = 0.0
                for c in range(p):
                    M[k, q, c] = 0.0
                continue
            for c in range(15):
                row[c] = 0.0
            row[15] = -z[k, q]
            for c in range(p):
                row[16 + c] = D[k, q, c]
            for n in range(d):
                s = H[k, q, n]
                if s != 0.0:
                    for c in range(width):
                        row[c] += s * Y[n, c]
            for i in range(d):
                var += H[k, q, i] * row[i]
            if not var > 0.0:
                return False
            s = 1.0 / math.sqrt(var)
            nu[k, q] = -row[15] * s
            for c in range(p):
                M[k, q, c] = row[16 + c] * s
            for i in range(d):
                s = row[i] / var
                for c in range(width):
                    Y[i, c] -= s * row[c]
        if x_f.shape[0] == 0:
            continue
        for i in range(d):
            x_f[k, i] = Y[i, 15]
            for n in range(d):
                P_f[k, i, n] = 0.5 * (Y[i, n] + Y[n, i])
    return True


@kernel
def backward(C, moved, Q, u, keep, stays, spread, x_f, P_f, next_f):
    """Replace x_f (m, d), filtered, by the smoothed errors; spread: P_f too.

    u (m, d): predicted less nominal, with what the step of the parameters does to it. P_f by their
    covariance, else it is left as it was, and next_f (m, d - 9) by that of an error that stays with
    its next. False where a covariance is none.
    """
    m, d = x_f.shape
    W, N, L, X = np.zeros((15, 16)), np.zeros((15, 16)), np.zeros((15, 16)), np.zeros((15, 16))
    S, ahead = np.zeros((15, 16)), np.zeros(15)
    wide = d + 3 if d == 9 else 16  # a number that the compiler does not know: no loop is unrolled
    for i in range(d):
        for n in range(d):
            S[i, n] = P_f[m - 1, i, n]
    for k in range(m - 2, -1, -1):
        # Columns of X: Phi P_f, and Phi x_f at 15.
        for i in range(d):
            for n in range(d):
                X[i, n] = P_f[k, i, n]
            X[i, wide - 1] = x_f[k, i]
        _carried(C[k], moved[k + 1], keep[k + 1], X, wide)
        for i in range(d):
            for n in range(d):
                N[i, n] = X[i, n]
            ahead[i] = x_f[k + 1, i] - u[k + 1, i] - X[i, wide - 1]
        _spread(C[k], moved[k + 1], Q[k + 1], keep[k + 1], stays, N, W, wide)
        for i in range(d):
            for n in range(i + 1):
                L[i, n] = N[i, n]
        if not cholesky(L, d):
            return False
        if not spread:
            substitute(L, ahead, d)
            for i in range(d):
                for n in range(d):
                    x_f[k, n] += X[i, n] * ahead[i]
            continue
        for i in range(d):  # X becomes N^-1 Phi P_f, the gain with rows for columns
            for n in range(i):
                s = L[i, n]
                for c in range(wide):
                    X[i, c] -= s * X[n, c]
            s = L[i, i]
            for c in range(wide):
                X[i, c] *= s
        for i in range(d - 1, -1, -1):
            for n in range(i + 1, d):
                s = L[n, i]
                for c in range(wide):
                    X[i, c] -= s * X[n, c]
            s = L[i, i]
            for c in range(wide):
                X[i, c] *= s
        for i in range(d):
            for n in range(d):
                x_f[k, n] += X[i, n] * ahead[i]
            for c in range(wide):
                W[i, c] = 0.0
            for n in range(d):
                s = S[i, n] - N[i, n]
                for c in range(wide):
                    W[i, c] += s * X[n, c]
        for i in range(9, d):
            for n in range(d):
                next_f[k, i - 9] += X[n, i] * S[n, i]
        for i in range(d):
            for n in range(d):
                S[i, n] = P_f[k, i, n]
            for o in range(d):
                s = X[o, i]
                for c in range(wide):
                    S[i, c] += s * W[o, c]
            for n in range(d):
                P_f[k, i, n] = S[i, n]
    return True
