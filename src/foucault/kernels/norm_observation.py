"""Norm observation and frame unification of many instruments at once, with covariance.

Per instrument: the linear norm solution of the accelerometers at rest and of the gyros in spins
(see `estimate.norm_observation` for the equations), the rotation between the two frames from the
spins (see `estimate.parallel_vectors`), and the first-order covariance of all 21 coefficients.

Order of the 21: accelerometer bias 3, scale 3, misalignments yx zx zy; gyro bias 3, scale 3,
misalignments xy xz yx yz zx zy. Order of the 9 of one triad in its own frame: L00 L10 L11 L20 L21
L22, then the bias. Status: 0 solved, 1 singular, 2 not an ellipsoid, 3 not finite.
"""

import math

import numpy as np

from foucault.kernels import kernel

SOLVED, SINGULAR, NO_ELLIPSOID, NOT_FINITE = 0, 1, 2, 3


@kernel
def cholesky(A, n):
    """Replace the lower triangle of A (n, n) by its Cholesky factor L; False where there is none.

    The diagonal holds 1 / L[i, i], so that nothing that follows divides.
    """
    for j in range(n):
        s = A[j, j]
        limit = 1e-13 * s
        for k in range(j):
            s -= A[j, k] * A[j, k]
        if not s > limit:
            return False
        q = 1.0 / math.sqrt(s)
        A[j, j] = q
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s * q
    return True


@kernel
def substitute(L, x, n):
    """Replace x (n,) by inv(L L') x, L as `cholesky` leaves it."""
    for i in range(n):
        s = x[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s * L[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= L[k, i] * x[k]
        x[i] = s * L[i, i]


@kernel
def invert(L, out, n):
    """Write inv(L L') into out (n, n), L as `cholesky` leaves it; L is replaced by its inverse."""
    for j in range(n):
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= L[i, k] * L[k, j]
            L[i, j] = s * L[i, i]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(i, n):
                s += L[k, i] * L[k, j]
            out[i, j] = s
            out[j, i] = s


@kernel
def solve_ellipsoid(K, c, b):
    """Write b = inv(A) d for K[:, 0] - c K[:, 1]; return d.b and A, and whether A is definite."""
    a00 = K[0, 0] - c * K[0, 1]
    a11 = K[1, 0] - c * K[1, 1]
    a22 = K[2, 0] - c * K[2, 1]
    a10 = -(K[3, 0] - c * K[3, 1])
    a20 = -(K[4, 0] - c * K[4, 1])
    a21 = -(K[5, 0] - c * K[5, 1])
    d0 = K[6, 0] - c * K[6, 1]
    d1 = K[7, 0] - c * K[7, 1]
    d2 = K[8, 0] - c * K[8, 1]
    c00 = a11 * a22 - a21 * a21
    c10 = a20 * a21 - a10 * a22
    c20 = a10 * a21 - a11 * a20
    det = a00 * c00 + a10 * c10 + a20 * c20
    b[0] = (c00 * d0 + c10 * d1 + c20 * d2) / det
    c11 = a00 * a22 - a20 * a20
    c21 = a10 * a20 - a00 * a21
    b[1] = (c10 * d0 + c11 * d1 + c21 * d2) / det
    c22 = a00 * a11 - a10 * a10
    b[2] = (c20 * d0 + c21 * d1 + c22 * d2) / det
    definite = a00 > 0.0 and c22 > 0.0 and det > 0.0
    # inv(A) as six numbers, for the Cholesky factor that follows
    return (
        d0 * b[0] + d1 * b[1] + d2 * b[2],
        (c00 / det, c10 / det, c11 / det, c20 / det, c21 / det, c22 / det),
        definite,
    )


@kernel
def _fill_row(N, j, size, s, row):
    """Fill row (9,) of the linear system with reading j over the norm s, in units of size."""
    x = N[j, 0] / size
    y = N[j, 1] / size
    z = N[j, 2] / size
    q = 1.0 / s
    row[0] = x * x * q
    row[1] = y * y * q
    row[2] = z * z * q
    q *= -2.0
    row[3] = x * y * q
    row[4] = x * z * q
    row[5] = y * z * q
    row[6] = x * q
    row[7] = y * q
    row[8] = z * q


@kernel
def solve_triad(N, h, G, K, row, r0, r1, b, L, Linv):
    """Solve one triad: fills L (3, 3), Linv (3, 3) and b (3,); returns the status.

    Parameters: N (m, 3) readings; h (m,) norms, the sign does not count; workspaces G (9, 9),
    K (9, 2), row, r0, r1 (9,).
    """
    m = N.shape[0]
    if m < 9:
        return SINGULAR
    size = 0.0
    least = abs(h[0])
    for j in range(m):
        size = max(size, abs(h[j]))
        least = min(least, abs(h[j]))
    equal = least == size  # both right sides are then the same
    for i in range(9):
        K[i, 0] = 0.0
        K[i, 1] = 0.0
        for k in range(9):
            G[i, k] = 0.0
    for j in range(m):
        s = abs(h[j]) / size
        _fill_row(N, j, size, s, row)
        for i in range(9):
            r = row[i]
            K[i, 0] += r * s
            K[i, 1] += r / s
            for k in range(9):  # the half above the diagonal too: whole rows are faster
                G[i, k] += r * row[k]
    if not cholesky(G, 9):
        return SINGULAR
    for side in range(1 if equal else 2):
        for i in range(9):
            r0[i] = K[i, side]
            r1[i] = 0.0
        substitute(G, r0, 9)
        # One step of refinement brings the accuracy of an orthogonal method.
        for j in range(m):
            s = abs(h[j]) / size
            _fill_row(N, j, size, s, row)
            e = s if side == 0 else 1.0 / s
            for i in range(9):
                e -= row[i] * r0[i]
            for i in range(9):
                r1[i] += row[i] * e
        substitute(G, r1, 9)
        for i in range(9):
            K[i, side] = r0[i] + r1[i]
    if equal:
        for i in range(9):
            K[i, 1] = K[i, 0]
    return _recover(K, size, b, L, Linv)


@kernel
def _recover(K, size, b, L, Linv):
    """Fill b, L and Linv from the solutions K (9, 2) of the linear system; returns the status."""
    before = 0.0
    at_before, inverse, definite = solve_ellipsoid(K, 0.0, b)
    c = at_before / (1.0 + at_before)
    for _ in range(30):
        value, inverse, definite = solve_ellipsoid(K, c, b)
        at = value - c
        if abs(at) <= 1e-16 or at == at_before:
            break
        step = at * (c - before) / (at - at_before)
        before = c
        at_before = at
        c -= step
    if not math.isfinite(c):
        return NOT_FINITE
    if not definite:
        return NO_ELLIPSOID
    i00, i10, i11, i20, i21, i22 = inverse
    l00 = math.sqrt(i00)
    l10 = i10 / l00
    l11 = math.sqrt(i11 - l10 * l10)
    l20 = i20 / l00
    l21 = (i21 - l20 * l10) / l11
    l22 = math.sqrt(i22 - l20 * l20 - l21 * l21)
    L[0, 0] = l00
    L[1, 0] = l10
    L[1, 1] = l11
    L[2, 0] = l20
    L[2, 1] = l21
    L[2, 2] = l22
    L[0, 1] = L[0, 2] = L[1, 2] = 0.0
    Linv[0, 0] = 1.0 / l00
    Linv[1, 1] = 1.0 / l11
    Linv[2, 2] = 1.0 / l22
    Linv[1, 0] = -l10 / (l00 * l11)
    Linv[2, 1] = -l21 / (l11 * l22)
    Linv[2, 0] = -(l20 * Linv[0, 0] + l21 * Linv[1, 0]) / l22
    Linv[0, 1] = Linv[0, 2] = Linv[1, 2] = 0.0
    for i in range(3):
        b[i] *= size
    return SOLVED


@kernel
def triad_covariance(N, var, b, Linv, G, S, T, J, C):
    """Fill C (9, 9), the covariance of one triad in its own frame, and G = inv(J' J).

    Parameters: N as solve_triad; var (m,) variance of each reading per axis; b, Linv the
    solution; S, T workspaces (9, 9), J (9,). The linear solution weighs all readings alike, so
    that its covariance is ``G J' V J G`` with ``V_j = var_j |m_j|^2``, ``m_j = L^-T x_j / |x_j|``.
    """
    m = N.shape[0]
    for i in range(9):
        for k in range(i + 1):
            G[i, k] = 0.0
            S[i, k] = 0.0
    for j in range(m):
        d0 = N[j, 0] - b[0]
        d1 = N[j, 1] - b[1]
        d2 = N[j, 2] - b[2]
        x = Linv[0, 0] * d0
        y = Linv[1, 0] * d0 + Linv[1, 1] * d1
        z = Linv[2, 0] * d0 + Linv[2, 1] * d1 + Linv[2, 2] * d2
        q = 1.0 / math.sqrt(x * x + y * y + z * z)
        m0 = (Linv[0, 0] * x + Linv[1, 0] * y + Linv[2, 0] * z) * q
        m1 = (Linv[1, 1] * y + Linv[2, 1] * z) * q
        m2 = Linv[2, 2] * z * q
        J[0] = m0 * x
        J[1] = m1 * x
        J[2] = m1 * y
        J[3] = m2 * x
        J[4] = m2 * y
        J[5] = m2 * z
        J[6] = m0
        J[7] = m1
        J[8] = m2
        # In units of the largest norm the entries of J' J are of one size.
        V = var[j] * (m0 * m0 + m1 * m1 + m2 * m2)
        for i in range(9):
            r = J[i]
            v = V * r
            for k in range(i + 1):
                G[i, k] += r * J[k]
                S[i, k] += v * J[k]
    for i in range(9):
        for k in range(i):
            S[k, i] = S[i, k]
    if not cholesky(G, 9):
        return False
    invert(G, T, 9)
    for i in range(9):
        for k in range(9):
            G[i, k] = T[i, k]
    for i in range(9):
        for k in range(9):
            T[i, k] = 0.0
        for p in range(9):
            g = G[i, p]
            for k in range(9):
                T[i, k] += g * S[p, k]
    for i in range(9):
        for k in range(i + 1):
            s = 0.0
            for p in range(9):
                s += T[i, p] * G[k, p]
            C[i, k] = s
            C[k, i] = s
    return True


@kernel
def polar(B, C, X):
    """Fill C with the rotation nearest to B (3, 3), by Newton's iteration; False if there is none."""
    size = 0.0
    for i in range(3):
        for k in range(3):
            size += B[i, k] * B[i, k]
    size = math.sqrt(size / 3.0)
    for i in range(3):
        for k in range(3):
            C[i, k] = B[i, k] / size
    for _ in range(40):
        X[0, 0] = C[1, 1] * C[2, 2] - C[1, 2] * C[2, 1]
        X[0, 1] = C[1, 2] * C[2, 0] - C[1, 0] * C[2, 2]
        X[0, 2] = C[1, 0] * C[2, 1] - C[1, 1] * C[2, 0]
        X[1, 0] = C[2, 1] * C[0, 2] - C[2, 2] * C[0, 1]
        X[1, 1] = C[2, 2] * C[0, 0] - C[2, 0] * C[0, 2]
        X[1, 2] = C[2, 0] * C[0, 1] - C[2, 1] * C[0, 0]
        X[2, 0] = C[0, 1] * C[1, 2] - C[0, 2] * C[1, 1]
        X[2, 1] = C[0, 2] * C[1, 0] - C[0, 0] * C[1, 2]
        X[2, 2] = C[0, 0] * C[1, 1] - C[0, 1] * C[1, 0]
        det = C[0, 0] * X[0, 0] + C[0, 1] * X[0, 1] + C[0, 2] * X[0, 2]
        if not det > 1e-9:
            return False
        change = 0.0
        for i in range(3):
            for k in range(3):
                new = 0.5 * (C[i, k] + X[i, k] / det)
                change = max(change, abs(new - C[i, k]))
                C[i, k] = new
        if change <= 1e-15:
            break
    return True


@kernel
def _turned(o, kappa, M, Q):
    """Fill Q (6, 3) = R' M, R = ([o x], kappa (I - o o')): how f/g - o across o changes with phi, r."""
    for k in range(3):
        x = M[0, k]
        y = M[1, k]
        z = M[2, k]
        along = o[0] * x + o[1] * y + o[2] * z
        Q[0, k] = o[2] * y - o[1] * z
        Q[1, k] = o[0] * z - o[2] * x
        Q[2, k] = o[1] * x - o[0] * y
        Q[3, k] = kappa * (x - along * o[0])
        Q[4, k] = kappa * (y - along * o[1])
        Q[5, k] = kappa * (z - along * o[2])


@kernel
def unify(f, u, kappa, nz, C, r, X, H, z, o):
    """Fill C (3, 3) and r (3,) from f (m, 3) over g and unit u (m, 3); H the 6 x 6 normal matrix.

    nz is 6, or 3 where the lever arm is held at zero. Gauss-Newton from the polar factor.
    """
    m = f.shape[0]
    for i in range(3):
        r[i] = 0.0
        for k in range(3):
            s = 0.0
            for j in range(m):
                s += f[j, i] * u[j, k]
            H[i, k] = s
    if not polar(H, C, X):
        return False
    for _ in range(20):
        # R' R and R' e from sums of o, f and their products: see `_turned`.
        for i in range(6):
            z[i] = 0.0
            for k in range(i + 1):
                H[i, k] = 0.0
        level = 0.0
        for j in range(m):
            for i in range(3):
                o[i] = C[i, 0] * u[j, 0] + C[i, 1] * u[j, 1] + C[i, 2] * u[j, 2]
            c = kappa[j]
            e0 = f[j, 0] + c * r[0]
            e1 = f[j, 1] + c * r[1]
            e2 = f[j, 2] + c * r[2]
            along = o[0] * e0 + o[1] * e1 + o[2] * e2
            z[0] += o[1] * e2 - o[2] * e1
            z[1] += o[2] * e0 - o[0] * e2
            z[2] += o[0] * e1 - o[1] * e0
            z[3] -= c * (e0 - along * o[0])
            z[4] -= c * (e1 - along * o[1])
            z[5] -= c * (e2 - along * o[2])
            level += c * c
            for i in range(3):
                for k in range(i + 1):
                    H[i, k] -= o[i] * o[k]
                    H[3 + i, 3 + k] -= c * c * o[i] * o[k]
            H[3, 1] -= c * o[2]
            H[4, 0] += c * o[2]
            H[3, 2] += c * o[1]
            H[5, 0] -= c * o[1]
            H[4, 2] -= c * o[0]
            H[5, 1] += c * o[0]
        for i in range(3):
            H[i, i] += m
            H[3 + i, 3 + i] += level
        if not cholesky(H, nz):
            return False
        substitute(H, z, nz)
        px = z[0]
        py = z[1]
        pz = z[2]
        for k in range(3):  # C <- (I + [z x]) C; the polar factor brings it back to a rotation
            x = C[0, k]
            y = C[1, k]
            w = C[2, k]
            H[0, 3 + k] = x + py * w - pz * y
            H[1, 3 + k] = y + pz * x - px * w
            H[2, 3 + k] = w + px * y - py * x
        if not polar(H[:3, 3:], C, X):
            return False
        size = abs(px) + abs(py) + abs(pz)
        for k in range(3, nz):
            r[k - 3] += z[k]
        if size <= 1e-9:  # what is left is this times the size of the residuals
            break
    return True


@kernel
def unify_covariance(f, u, s, ca, cg, kappa, nz, g, C, Ainv, Ginv, GC, H, Q, W, A, B, D, o, P, T):
    """Fill A, B (6, 9), D (6, 6): how errors of both triads and direct noise move z = (phi, r).

    s (m,) is the signed inverse of the norm of each rate; ca, cg (m,) variances per axis; Ainv,
    Ginv the inverse triad matrices; H holds the Cholesky factor of the normal matrix.
    """
    m = f.shape[0]
    for i in range(3):
        for k in range(3):
            t = 0.0
            for p in range(3):
                t += C[i, p] * Ginv[p, k]
            GC[i, k] = t
    # Accelerometers' L^-1 is lower triangular; that of the gyros, turned into b, is not.
    for i in range(6):
        for k in range(9):
            A[i, k] = 0.0
            B[i, k] = 0.0
        for k in range(6):
            D[i, k] = 0.0
    for j in range(m):
        for i in range(3):
            o[i] = C[i, 0] * u[j, 0] + C[i, 1] * u[j, 1] + C[i, 2] * u[j, 2]
        va = ca[j] / (g * g)
        vg = cg[j] * s[j] * s[j]
        _turned(o, kappa[j], Ainv, Q)
        _turned(o, kappa[j], GC, W)
        f0, f1, f2 = f[j, 0], f[j, 1], f[j, 2]
        u0, u1, u2 = u[j, 0], u[j, 1], u[j, 2]
        for i in range(nz):
            q0, q1, q2 = Q[i, 0], Q[i, 1], Q[i, 2]
            w0, w1, w2 = W[i, 0], W[i, 1], W[i, 2]
            A[i, 0] += q0 * f0
            A[i, 1] += q1 * f0
            A[i, 2] += q1 * f1
            A[i, 3] += q2 * f0
            A[i, 4] += q2 * f1
            A[i, 5] += q2 * f2
            A[i, 6] += q0 / g
            A[i, 7] += q1 / g
            A[i, 8] += q2 / g
            B[i, 0] -= w0 * u0
            B[i, 1] -= w1 * u0
            B[i, 2] -= w1 * u1
            B[i, 3] -= w2 * u0
            B[i, 4] -= w2 * u1
            B[i, 5] -= w2 * u2
            B[i, 6] -= w0 * s[j]
            B[i, 7] -= w1 * s[j]
            B[i, 8] -= w2 * s[j]
            a0, a1, a2 = va * q0, va * q1, va * q2
            b0, b1, b2 = vg * w0, vg * w1, vg * w2
            for k in range(i + 1):
                D[i, k] += a0 * Q[k, 0] + a1 * Q[k, 1] + a2 * Q[k, 2]
                D[i, k] += b0 * W[k, 0] + b1 * W[k, 1] + b2 * W[k, 2]
    _solve_normal(H, nz, A, B, D, P, T)


@kernel
def _multiply(P, A, rows, columns, T):
    """Replace A (rows, columns) by P A, P (rows, rows), by way of T."""
    for i in range(rows):
        for k in range(columns):
            T[i, k] = 0.0
        for p in range(rows):
            a = P[i, p]
            for k in range(columns):
                T[i, k] += a * A[p, k]
    for i in range(rows):
        for k in range(columns):
            A[i, k] = T[i, k]


@kernel
def _solve_normal(H, nz, A, B, D, P, T):
    """Replace A, B by inv(H) A, inv(H) B and D by inv(H) D inv(H), H given as its factor."""
    invert(H, P, nz)
    for i in range(nz):
        for k in range(i):
            D[k, i] = D[i, k]
    _multiply(P, A, nz, 9, T)
    _multiply(P, B, nz, 9, T)
    _multiply(P, D, nz, nz, T)
    for i in range(nz):
        for k in range(i):
            D[k, i], D[i, k] = D[i, k], D[k, i]
    _multiply(P, D, nz, nz, T)


@kernel
def _slopes(M, C, F, S, first, count):
    """Fill F (12, 3) and S (12, 9): the gyro's 12 by phi and by theta_g; S is sparse."""
    row = 6
    for i in range(3):
        first[i] = 6 + i
        count[i] = 1
        S[i, 6 + i] = 1.0
        for k in range(3):
            F[i, k] = 0.0
        for k in range(3):
            at = 3 + i
            if i != k:
                at = row
                row += 1
            k1 = (k + 1) % 3
            k2 = (k + 2) % 3
            # column k of [phi x] has phi[k2] in row k1 and -phi[k1] in row k2
            F[at, k] = 0.0
            F[at, k2] = -M[i, k1]
            F[at, k1] = M[i, k2]
            first[at] = i * (i + 1) // 2
            count[at] = i + 1
            for q in range(i + 1):
                S[at, first[at] + q] = C[k, q]


@kernel
def _congruence(A, P, nz, T, D):
    """Fill T = A P (nz, 9) and add A P A' to the lower triangle of D."""
    for i in range(nz):
        for k in range(9):
            T[i, k] = 0.0
        for p in range(9):
            a = A[i, p]
            for k in range(9):
                T[i, k] += a * P[p, k]
        for k in range(i + 1):
            t = 0.0
            for p in range(9):
                t += T[i, p] * A[k, p]
            D[i, k] += t


@kernel
def assemble(Lg, C, Ca, Cg, A, B, D, nz, M, cov, arm_cov, T, Y, V, E, F, S, first, count):
    """Fill M (3, 3) = L_g C_db and the covariance of the 21 coefficients and of the lever arm.

    T (6, 9), Y, V, S (12, 9), E, F (12, 3), first, count (12,) are workspaces. With ``z = (phi, r)`` the unification's errors,
    ``dM = dL_g C_db - M [phi x]`` and ``z = A theta_a + B theta_g + direct noise``.
    """
    for i in range(3):
        for k in range(3):
            t = 0.0
            for q in range(i + 1):
                t += Lg[i, q] * C[k, q]
            M[i, k] = t
    order = (6, 7, 8, 0, 2, 5, 1, 3, 4)
    _slopes(M, C, F, S, first, count)
    # z: covariance, and its covariance with theta_a and theta_g
    _congruence(A, Ca, nz, T, D)
    for i in range(12):
        for k in range(9):
            t = F[i, 0] * T[0, k] + F[i, 1] * T[1, k] + F[i, 2] * T[2, k]
            Y[i, k] = t
    at = 0
    for i in range(9):
        for k in range(i + 1):
            cov[at] = Ca[order[i], order[k]]
            at += 1
    for i in range(12):
        at = (9 + i) * (10 + i) // 2
        for k in range(9):
            cov[at + k] = Y[i, order[k]]
    _congruence(B, Cg, nz, T, D)
    for i in range(nz):
        for k in range(i):
            D[k, i] = D[i, k]
    # covariance = (S Cg + Y) S' + S Y' + F Czz F' with Y = F B Cg
    for i in range(12):
        for k in range(9):
            t = 0.0
            for p in range(first[i], first[i] + count[i]):
                t += S[i, p] * Cg[p, k]
            y = F[i, 0] * T[0, k] + F[i, 1] * T[1, k] + F[i, 2] * T[2, k]
            Y[i, k] = y
            V[i, k] = t + y
        for q in range(3):
            E[i, q] = F[i, 0] * D[0, q] + F[i, 1] * D[1, q] + F[i, 2] * D[2, q]
    for i in range(12):
        at = (9 + i) * (10 + i) // 2 + 9
        for k in range(i + 1):
            t = E[i, 0] * F[k, 0] + E[i, 1] * F[k, 1] + E[i, 2] * F[k, 2]
            for p in range(first[k], first[k] + count[k]):
                t += V[i, p] * S[k, p]
            for p in range(first[i], first[i] + count[i]):
                t += S[i, p] * Y[k, p]
            cov[at + k] = t
    for i in range(3):
        for k in range(3):
            arm_cov[i, k] = D[3 + i, 3 + k] if nz == 6 else 0.0


@kernel
def calibrate_batch(rest, rest_var, f_spin, f_var, w_spin, w_var, h, g, lever_arm):
    """Calibrate n instruments that went through the same positions.

    Parameters: rest (n, m, 3) mean specific forces at rest [m/s^2]; rest_var (m,) their variance
    per axis; f_spin, w_spin (n, k, 3) means over spins [m/s^2], [rad/s]; f_var, w_var (k,); h (k,)
    norm of the true mean rates, signed [rad/s]; g [m/s^2]; lever_arm: solve for it.

    Returns Ma (n, 3, 3), ba (n, 3), Mg (n, 3, 3), bg (n, 3), arm (n, 3), cov (n, 231) its lower triangle row
    by row,
    arm_cov (n, 3, 3), C_bd (n, 3, 3), status (n,).
    """
    n, m = rest.shape[0], rest.shape[1]
    k = w_spin.shape[1]
    nz = 6 if lever_arm else 3
    # Not filled beforehand: touching this much memory twice costs a tenth of the work.
    Ma, Mg, C = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    ba, bg, arm = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    cov, arm_cov = np.zeros((n, 231)), np.zeros((n, 3, 3))
    status = np.zeros(n, np.int64)
    G, S, T, K, row = np.empty((9, 9)), np.empty((9, 9)), np.empty((9, 9)), np.empty((9, 2)), np.empty(9)
    Ca, Cg, r0, r1 = np.empty((9, 9)), np.empty((9, 9)), np.empty(9), np.empty(9)
    Ainv, Ginv, Lg = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    f, u, s, kappa = np.empty((k, 3)), np.empty((k, 3)), np.empty(k), np.empty(k)
    X, R, H, z, o = np.empty((3, 3)), np.empty((3, 3)), np.zeros((6, 6)), np.empty(6), np.empty(3)
    A, B, D, Q, W, Y = np.zeros((6, 9)), np.zeros((6, 9)), np.zeros((6, 6)), np.empty((6, 3)), np.empty((6, 3)), np.empty((12, 9))
    P = np.empty((6, 6))
    V, E, F, L = np.empty((12, 9)), np.empty((12, 3)), np.empty((12, 3)), np.zeros((12, 9))
    first, count = np.empty(12, np.int64), np.empty(12, np.int64)
    norms = np.full(m, g)
    for j in range(k):
        kappa[j] = h[j] * h[j] / g
    for i in range(n):
        status[i] = solve_triad(rest[i], norms, G, K, row, r0, r1, ba[i], Ma[i], Ainv)
        if status[i] != 0:
            continue
        status[i] = solve_triad(w_spin[i], h, G, K, row, r0, r1, bg[i], Lg, Ginv)
        if status[i] != 0:
            continue
        for j in range(k):
            size = 0.0
            for p in range(3):
                x = 0.0
                y = 0.0
                for q in range(p + 1):
                    x += Ainv[p, q] * (f_spin[i, j, q] - ba[i, q])
                    y += Ginv[p, q] * (w_spin[i, j, q] - bg[i, q])
                f[j, p] = x / g
                u[j, p] = y
                size += y * y
            s[j] = math.copysign(1.0 / math.sqrt(size), h[j])
            for p in range(3):
                u[j, p] *= s[j]
        if not unify(f, u, kappa, nz, C[i], arm[i], X, H, z, o):
            status[i] = SINGULAR
            continue
        fine = triad_covariance(rest[i], rest_var, ba[i], Ainv, G, S, T, row, Ca)
        if not (fine and triad_covariance(w_spin[i], w_var, bg[i], Ginv, G, S, T, row, Cg)):
            status[i] = SINGULAR
            continue
        unify_covariance(f, u, s, f_var, w_var, kappa, nz, g, C[i], Ainv, Ginv, R, H, Q, W, A, B, D, o, P, T)
        assemble(Lg, C[i], Ca, Cg, A, B, D, nz, Mg[i], cov[i], arm_cov[i], T, Y, V, E, F, L, first, count)
        if not math.isfinite(cov[i, 230]):
            status[i] = NOT_FINITE
    return Ma, ba, Mg, bg, arm, cov, arm_cov, C, status
