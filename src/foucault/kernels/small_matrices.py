"""Small linear algebra on arrays of fixed size, without allocation: Cholesky, 3 x 3 rotations."""

import math

import numpy as np

from foucault.kernels import kernel


@kernel
def copy(A, out):
    """Write A (r, c) into out; a slice that is assigned takes seconds to compile."""
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            out[i, k] = A[i, k]


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
def decorrelate(u, x):
    """Replace x (m, c) by inv(L) x, L the Cholesky factor of I + u u', u (m, k).

    Row by row, as a filter of k causes with the root S of their covariance [Potter]: what few
    causes do to many rows takes m k (k + c) steps, and no matrix of m rows and columns.
    """
    m, k = u.shape
    S, z = np.zeros((k, k)), np.zeros((k, x.shape[1]))
    for a in range(k):
        S[a, a] = 1.0
    f, g = np.zeros(k), np.zeros(k)
    for i in range(m):
        s = 1.0
        for a in range(k):
            f[a] = 0.0
            for b in range(k):
                f[a] += S[b, a] * u[i, b]
            s += f[a] * f[a]
        q = 1.0 / math.sqrt(s)
        for a in range(k):
            for j in range(x.shape[1]):
                x[i, j] -= u[i, a] * z[a, j]
        for j in range(x.shape[1]):
            x[i, j] *= q
        for a in range(k):
            g[a] = 0.0
            for b in range(k):
                g[a] += S[a, b] * f[b]
            for j in range(x.shape[1]):
                z[a, j] += g[a] * q * x[i, j]
        for a in range(k):
            for b in range(k):
                S[a, b] -= q * q / (1.0 + q) * g[a] * f[b]


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
def multiply(P, A, rows, columns, T):
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
def polar(B, C, X):
    """Fill C with the rotation nearest to B (3, 3), by Newton's iteration; False without one."""
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
