"""The linear norm solution of one triad, and its covariance.

With ``N = L x + b`` and ``|x| = h``: see `estimate.norm_observation` for the equations. Order of
the nine: L00 L10 L11 L20 L21 L22, then the bias. Status: 0 solved, 1 singular, 2 not an ellipsoid,
3 not finite.
"""

import math

from foucault.kernels import kernel, part
from foucault.kernels.small_matrices import cholesky, invert, substitute

SOLVED, SINGULAR, NO_ELLIPSOID, NOT_FINITE = 0, 1, 2, 3


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


@part
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


@part
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
