"""Gauss-Newton of trials whose rows are followed to second order, each by itself.

A row of a model says something of few unknowns, and bends along these alone. `jet` holds no others:
`width` (N,) how many they are, `column` (N, w) which, `J` (N, w) first derivatives, `H` (N, w, w)
second ones; w is the largest width, and what is beyond that of a row is never read::

    h(d) = (J + (H d) / 2) d      J(d) = J + H d

`solve` is one trial. Whoever has many calls it for each: `solve_batch` on the processor, and
`cuda.solve_batch` on a device.
"""

import math

import numpy as np

from foucault.kernels import kernel, part
from foucault.kernels.small_matrices import cholesky, invert, substitute


@part
def _rows(jet, d, y, j, r):
    """Fill the Jacobian j (N, w) at d (m,), and r (N,) with what it leaves of readings y (N,)."""
    width, column, J, H = jet
    for n in range(r.shape[0]):
        w = width[n]
        for c in range(w):
            j[n, c] = J[n, c]
        for k in range(w):
            x = d[column[n, k]]
            for c in range(w):
                j[n, c] += x * H[n, k, c]
        h = 0.0
        for c in range(w):
            h += 0.5 * (J[n, c] + j[n, c]) * d[column[n, c]]
        r[n] = y[n] - h


@part
def _normal(jet, j, r, row, g, A):
    """Add J' J to the lower triangle of A (m, m), and J' r to g (m,)."""
    width, column = jet[0], jet[1]
    for n in range(r.shape[0]):
        for a in range(g.shape[0]):
            row[a] = 0.0
        for c in range(width[n]):
            row[column[n, c]] = j[n, c]
        for c in range(width[n]):
            a = column[n, c]
            g[a] += j[n, c] * r[n]
            for b in range(a + 1):
                A[a, b] += j[n, c] * row[b]


@part
def _normal_spread(jet, S, j, r, row, g, A, dense):
    """Add J' S J to the lower triangle of A (m, m), and J' S r to g (m,).

    Of S (N, N) the lower triangle is read. With its diagonal halved, S = L + L' and J' S J = J' L J
    + (J' L J)'. `dense` (N, m) becomes J.
    """
    width, column = jet[0], jet[1]
    m = g.shape[0]
    for n in range(r.shape[0]):
        for a in range(m):
            dense[n, a] = row[a] = 0.0
        for c in range(width[n]):
            dense[n, column[n, c]] = j[n, c]
        rest = 0.0
        for k in range(n + 1):
            s = S[n, k] if k < n else 0.5 * S[n, n]
            if s != 0.0:
                rest += s * r[k]
                for a in range(m):
                    row[a] += s * dense[k, a]
        for a in range(m):
            g[a] += r[n] * row[a]
        for c in range(width[n]):
            a = column[n, c]
            g[a] += j[n, c] * rest
            for b in range(m):
                A[a, b] += j[n, c] * row[b]
    for a in range(m):
        for b in range(a + 1):
            A[a, b] += A[b, a]


@part
def solve(jet, y, S, spread, d, most, small, j, r, row, g, A, V, dense):
    """Move d (m,) to where J' S (y - h(d)) = 0, and say whether it settled.

    It has where no unknown moves by `small` any more, within `most` iterations; none leaves d as it
    is. V (m, m) becomes the inverse of J' S J there, r (N,) what is left of y (N,); where the
    readings do not tell d, it and V are NaN. S (N, N) is one unless `spread`. Room to work in: j
    (N, w), row, g (m,), A (m, m) and, with S, dense (N, m).
    """
    m, good = d.shape[0], False
    for i in range(most + 1):
        _rows(jet, d, y, j, r)
        for a in range(m):
            g[a] = 0.0
            for b in range(m):
                A[a, b] = 0.0
        if spread:
            _normal_spread(jet, S, j, r, row, g, A, dense)
        else:
            _normal(jet, j, r, row, g, A)
        if not cholesky(A, m):
            for a in range(m):
                d[a] = math.nan
                for b in range(m):
                    V[a, b] = math.nan
            return False
        if good or i == most:
            break
        substitute(A, g, m)
        good = True
        for a in range(m):
            d[a] += g[a]
            if not abs(g[a]) < small:
                good = False
    invert(A, V, m)
    return good


@kernel
def solve_batch(
    width, column, J, H, y, S, spread, d, most, small, cov, left, good
):  # fmt: skip
    """Solve trials from d (b, m), in place; y (b, N), S (b, N, N) or anything of three axes.

    Fills cov (b, p, p) of the first unknowns, left (b, N), good (b,): see `solve`.
    """
    m, p = d.shape[1], cov.shape[1]
    j, row, g = np.empty(J.shape), np.empty(m), np.empty(m)
    A, V, dense = np.empty((m, m)), np.empty((m, m)), np.empty((y.shape[1] if spread else 1, m))
    jet = (width, column, J, H)
    for t in range(d.shape[0]):
        good[t] = solve(
            jet, y[t], S[t if spread else 0], spread, d[t], most, small, j, left[t], row, g, A, V,
            dense,
        )  # fmt: skip
        for a in range(p):
            for b in range(p):
                cov[t, a, b] = V[a, b]


@kernel
def predict_batch(width, column, J, H, d, e, y):
    """Fill y (b, N) = h(d) + e, d (b, m), e (b, N)."""
    j, r, none = np.empty(J.shape), np.empty(e.shape[1]), np.zeros(e.shape[1])
    for t in range(d.shape[0]):
        _rows((width, column, J, H), d[t], none, j, r)
        for n in range(e.shape[1]):
            y[t, n] = e[t, n] - r[n]
