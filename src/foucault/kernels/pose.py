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

from foucault.kernels import kernel, part
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


@kernel
def _turned(C, u, J, out):
    """Fill out (3, 9) with C ([-u x] J), J (3, 9): what attitude errors do to a force turned."""
    for k in range(J.shape[1]):
        a = u[2] * J[1, k] - u[1] * J[2, k]
        b = u[0] * J[2, k] - u[2] * J[0, k]
        c = u[1] * J[0, k] - u[0] * J[1, k]
        for i in range(3):
            out[i, k] = C[i, 0] * a + C[i, 1] * b + C[i, 2] * c


@kernel
def preintegrate(node, dt, theta, force, middle, K_g, K_a, raw_g, raw_a, late, q_g, q_a, out, J, Q):
    """Add up increments from node to node; node (m,) is the number of the last sample before it.

    theta, force, middle (n, 3): increments of angle, velocity, position over dt (n,), corrected;
    raw_g, raw_a, late (n, 3): angle, velocity before the matrices' errors, and derivative of the
    velocity by the accelerometers' delay. out (m, 16): C (9), dv, dp, T; J (m, 9, 22): derivative
    of (phi, dv, dp) by biases of gyros, accelerometers, 9 of gyros, 6 of accelerometers, delay;
    Q (m, 9, 9) noise. Entry k leads from node k - 1 to node k.
    """
    m = node.shape[0]
    C, E, X = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    v, p = np.zeros(3), np.zeros(3)
    A, T9, T22 = np.zeros((9, 22)), np.zeros((3, 9)), np.zeros((3, 22))
    I_g, I_a, S = np.zeros((3, 22)), np.zeros((3, 22)), np.zeros((9, 9))
    new, D_a = np.zeros((3, 22)), np.zeros((3, 22))
    for k in range(1, m):
        for i in range(3):
            v[i] = 0.0
            p[i] = 0.0
            for j in range(3):
                C[i, j] = 1.0 if i == j else 0.0
        A[:] = 0.0
        S[:] = 0.0
        total = 0.0
        for r in range(node[k - 1] + 1, node[k] + 1):
            h = dt[r]
            total += h
            for i in range(3):
                for j in range(3):
                    I_g[i, j] = -K_g[i, j] * h
                    I_a[i, 3 + j] = -K_a[i, j] * h
                    for c in range(3):
                        I_g[i, 6 + 3 * j + c] = -K_g[i, j] * raw_g[r, c]
                I_a[i, 21] = late[r, i]
                column = 15
                for j in range(3):
                    for c in range(j + 1):
                        I_a[i, column] = -K_a[i, j] * raw_a[r, c]
                        column += 1
            # The force in axes of the beginning, u + theta x u / 2: both change. Columns cancel
            # where a motion does not show them, and must not be less exact than that.
            u0, u1, u2 = force[r, 0], force[r, 1], force[r, 2]
            t0, t1, t2 = 0.5 * theta[r, 0], 0.5 * theta[r, 1], 0.5 * theta[r, 2]
            for c in range(22):
                a, b, d = 0.5 * I_g[0, c], 0.5 * I_g[1, c], 0.5 * I_g[2, c]
                x, y, z = I_a[0, c], I_a[1, c], I_a[2, c]
                D_a[0, c] = x + b * u2 - d * u1 + t1 * z - t2 * y
                D_a[1, c] = y + d * u0 - a * u2 + t2 * x - t0 * z
                D_a[2, c] = z + a * u1 - b * u0 + t0 * y - t1 * x
            # The position first, with velocity and attitude of the beginning.
            _turned(C, force[r], A[:3], T22)
            for i in range(3):
                p[i] += v[i] * h
                for j in range(3):
                    p[i] += C[i, j] * middle[r, j]
                for c in range(22):
                    s = T22[i, c]
                    for j in range(3):
                        s += C[i, j] * D_a[j, c]
                    A[6 + i, c] += A[3 + i, c] * h + 0.5 * h * s
                    new[i, c] = s
            for i in range(3):
                for j in range(3):
                    v[i] += C[i, j] * force[r, j]
                for c in range(22):
                    A[3 + i, c] += new[i, c]
            # Noise: S <- F S F' + N, by its columns and then by its rows.
            _exp(theta[r], E)
            for _ in range(2):
                _turned(C, force[r], S[:3], T9)
                for c in range(9):
                    for i in range(3):
                        S[6 + i, c] += S[3 + i, c] * h + 0.5 * h * T9[i, c]
                        S[3 + i, c] += T9[i, c]
                    a, b, d = S[0, c], S[1, c], S[2, c]
                    for i in range(3):
                        S[i, c] = E[0, i] * a + E[1, i] * b + E[2, i] * d
                for i in range(9):
                    for c in range(i):
                        S[i, c], S[c, i] = S[c, i], S[i, c]
            for i in range(3):
                S[i, i] += q_g * h
                S[3 + i, 3 + i] += q_a * h
                S[6 + i, 6 + i] += q_a * h * h * h / 3.0
                S[3 + i, 6 + i] += q_a * h * h / 2.0
                S[6 + i, 3 + i] += q_a * h * h / 2.0
            for c in range(22):
                a, b, d = A[0, c], A[1, c], A[2, c]
                x, y, z = I_g[0, c], I_g[1, c], I_g[2, c]
                A[0, c] = E[0, 0] * a + E[1, 0] * b + E[2, 0] * d + x - (t1 * z - t2 * y)
                A[1, c] = E[0, 1] * a + E[1, 1] * b + E[2, 1] * d + y - (t2 * x - t0 * z)
                A[2, c] = E[0, 2] * a + E[1, 2] * b + E[2, 2] * d + z - (t0 * y - t1 * x)
            for i in range(3):
                for j in range(3):
                    X[i, j] = C[i, 0] * E[0, j] + C[i, 1] * E[1, j] + C[i, 2] * E[2, j]
            copy(X, C)
        for i in range(3):
            for j in range(3):
                out[k, 3 * i + j] = C[i, j]
            out[k, 9 + i] = v[i]
            out[k, 12 + i] = p[i]
        out[k, 15] = total
        copy(A, J[k])
        copy(S, Q[k])


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
def _crossed(C, u, sign, out):
    """Fill out (3, 3) with sign C [u x]."""
    for i in range(3):
        out[i, 0] = sign * (C[i, 1] * u[2] - C[i, 2] * u[1])
        out[i, 1] = sign * (C[i, 2] * u[0] - C[i, 0] * u[2])
        out[i, 2] = sign * (C[i, 0] * u[1] - C[i, 1] * u[0])


@part
def _cross(a, b, out):
    """Fill out (3,) with a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@part
def _times(A, B, out):
    """Fill out (3, 3) with A B."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


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


@part
def _step(k, C, moved, J, G, keep, Phi, B):
    """Fill Phi (d, d) and B (d, p): from the errors of node k - 1 to those of node k."""
    T = moved[k, 15]
    Phi[:] = 0.0
    B[:] = 0.0
    for i in range(keep.shape[1]):
        Phi[9 + i, 9 + i] = keep[k, i]
    a, b = moved[k, 9:12], moved[k, 12:15]
    for i in range(3):
        for j in range(3):
            Phi[i, j] = moved[k, 3 * j + i]
        Phi[3 + i, 3 + i] = 1.0
        Phi[6 + i, 6 + i] = 1.0
        Phi[6 + i, 3 + i] = T
        for d in range(2):
            u = a if d == 0 else b
            r = 3 + 3 * d + i
            Phi[r, 0] = -(C[i, 1] * u[2] - C[i, 2] * u[1])
            Phi[r, 1] = -(C[i, 2] * u[0] - C[i, 0] * u[2])
            Phi[r, 2] = -(C[i, 0] * u[1] - C[i, 1] * u[0])
        if B.shape[1] == 0:
            continue
        for c in range(22):
            B[i, 10 + c] = J[k, i, c]
            for d in range(2):
                r = 3 + 3 * d
                B[r + i, 10 + c] = (
                    C[i, 0] * J[k, r, c] + C[i, 1] * J[k, r + 1, c] + C[i, 2] * J[k, r + 2, c]
                )
        for c in range(2):
            B[3 + i, 8 + c] = T * G[i, c]
            B[6 + i, 8 + c] = 0.5 * T * T * G[i, c]


@part
def _predicted(C, Q, Phi, P, stays, W, out):
    """Fill W (d, d) with Phi P and out with Phi P Phi' + Q, that of velocity, position by C."""
    d = Phi.shape[0]
    for i in range(d):
        for j in range(d):
            W[i, j] = 0.0
        for n in range(d):
            s = Phi[i, n]
            if s != 0.0:
                for j in range(d):
                    W[i, j] += s * P[n, j]
    for j in range(d):  # of the lower half, column by column of Phi'
        for i in range(j, d):
            out[i, j] = 0.0
        for n in range(d):
            s = Phi[j, n]
            if s != 0.0:
                for i in range(j, d):
                    out[i, j] += s * W[i, n]
    for i in range(9, d):
        out[i, i] += (1.0 - Phi[i, i] * Phi[i, i]) * stays[i - 9]
    # Q with velocity and position turned: rows, then columns.
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
                    if a != b or j <= i:
                        out[3 * a + i, 3 * b + j] += s
    for i in range(d):
        for j in range(i):
            out[j, i] = out[i, j]


@kernel
def forward(C, moved, J, Q, u, G, keep, stays, z, H, D, R, P0, nu, M, x_f, U_f, P_f):
    """Filter the poses; fill nu (m, 6), M (m, 6, p) white, and x_f, U_f, P_f after each pose.

    C (m, 3, 3): attitude of the nodes; u (m, d): predicted less nominal; G (3, 2): gravity by
    level; keep (m, d - 9), stays (d - 9,): of errors that stay; z (m, 6), H (m, 6, d),
    D (m, 6, p), R (m, 6): pose less nominal, its derivatives, variances, infinite where there is
    none. Without parameters, p = 0, the motion alone. False where a covariance is none.
    """
    m, p, d = z.shape[0], D.shape[2], P0.shape[0]
    Phi, B, W, N = np.zeros((d, d)), np.zeros((d, p)), np.zeros((d, d)), np.zeros((d, d))
    x, U, P, V = np.zeros(d), np.zeros((d, p)), P0.copy(), np.zeros((d, p))
    h, row = np.zeros(d), np.zeros(p)
    for k in range(m):
        if k:
            _step(k, C[k - 1], moved, J, G, keep, Phi, B)
            _predicted(C[k - 1], Q[k], Phi, P, stays, W, N)
            copy(N, P)
            for i in range(d):
                s = u[k, i]
                for n in range(d):
                    s += Phi[i, n] * x[n]
                h[i] = s
                for c in range(p):
                    V[i, c] = B[i, c]
                for n in range(d):
                    if Phi[i, n] != 0.0:
                        for c in range(p):
                            V[i, c] += Phi[i, n] * U[n, c]
            for i in range(d):
                x[i] = h[i]
            copy(V, U)
        # The numbers of a pose are independent of one another: one after the other.
        for q in range(6):
            nu[k, q] = 0.0
            for c in range(p):
                M[k, q, c] = 0.0
            if not R[k, q] < 1e30:
                continue
            var, off = R[k, q], z[k, q]
            for i in range(d):
                h[i] = 0.0
                for n in range(d):
                    h[i] += P[i, n] * H[k, q, n]
                off -= H[k, q, i] * x[i]
            for i in range(d):
                var += H[k, q, i] * h[i]
            if not var > 0.0:
                return False
            for c in range(p):
                row[c] = D[k, q, c]
            for n in range(d):
                if H[k, q, n] != 0.0:
                    for c in range(p):
                        row[c] += H[k, q, n] * U[n, c]
            root = math.sqrt(var)
            nu[k, q] = off / root
            for c in range(p):
                M[k, q, c] = row[c] / root
            for i in range(d):
                gain = h[i] / var
                x[i] += gain * off
                for c in range(p):
                    U[i, c] -= gain * row[c]
                for n in range(d):
                    P[i, n] -= gain * h[n]
        for i in range(d):
            for n in range(i):
                P[i, n] = P[n, i] = 0.5 * (P[i, n] + P[n, i])
        for i in range(d):
            x_f[k, i] = x[i]
        copy(U, U_f[k])
        copy(P, P_f[k])
    return True


@kernel
def backward(C, moved, J, Q, u, G, keep, stays, delta, spread, x_f, U_f, P_f, next_f):
    """Replace x_f (m, d) by the smoothed errors for the step delta (p,); spread: P_f too.

    P_f by their covariance, else it is left as it was, and next_f (m, d - 9) by that of an error
    that stays with its next. False where a covariance is none.
    """
    m, p, d = x_f.shape[0], delta.shape[0], x_f.shape[1]
    Phi, B, W, N = np.zeros((d, d)), np.zeros((d, p)), np.zeros((d, d)), np.zeros((d, d))
    L, g, gain, ahead = np.zeros((d, d)), np.zeros(d), np.zeros((d, d)), np.zeros(d)
    for k in range(m):
        for i in range(d):
            for c in range(p):
                x_f[k, i] += U_f[k, i, c] * delta[c]
    for k in range(m - 2, -1, -1):
        _step(k + 1, C[k], moved, J, G, keep, Phi, B)
        _predicted(C[k], Q[k + 1], Phi, P_f[k], stays, W, N)
        copy(N, L)
        if not cholesky(L, g.size):
            return False
        for i in range(d):
            s = x_f[k + 1, i] - u[k + 1, i]
            for n in range(d):
                s -= Phi[i, n] * x_f[k, n]
            for c in range(p):
                s -= B[i, c] * delta[c]
            ahead[i] = s
        if not spread:
            substitute(L, ahead, g.size)
            for i in range(d):
                for n in range(d):
                    x_f[k, n] += W[i, n] * ahead[i]
            continue
        for j in range(d):  # W holds Phi P_f; a row of the gain is N^-1 of its column
            for i in range(d):
                g[i] = W[i, j]
            substitute(L, g, g.size)
            for i in range(d):
                gain[j, i] = g[i]
        for i in range(d):
            for n in range(d):
                x_f[k, i] += gain[i, n] * ahead[n]
        for i in range(d):
            for n in range(d):
                N[i, n] = P_f[k + 1, i, n] - N[i, n]
                W[i, n] = 0.0
                L[i, n] = gain[n, i]
        for i in range(d):
            for o in range(d):
                for n in range(d):
                    W[i, n] += gain[i, o] * N[o, n]
        for i in range(d):
            for o in range(d):
                for n in range(d):
                    P_f[k, i, n] += W[i, o] * L[o, n]
        for i in range(9, d):
            for n in range(d):
                next_f[k, i - 9] += gain[i, n] * P_f[k + 1, n, i]
    return True
