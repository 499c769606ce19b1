"""Least squares of many small sets of means: few readings each, and fewer unknowns.

With L L' the covariance of the k readings of a set, J = L^-1 X, and the p unknowns scaled so that
``J'J`` and what is known of them beforehand have a unit diagonal together::

    W = N^+ J' L^-1,  N = J'J + known      hat = J N^+ J'

N^+ is a pseudo-inverse, by Jacobi's rotations where stops leave an unknown unseen.

Sets lie side by side, so that an instruction takes several of them.
"""

import math

import numpy as np

from foucault.kernels import kernel, part

SEEN = 1e-13
"""Least eigenvalue of N that is seen, over the largest [1]."""

APART = 1e-2
"""Least pivot of N of unknowns that are well told apart [1]."""

SWEEPS = 30


@kernel
def fit_batch(
    design, variance, slow, known, weights, root, redundancy, dof, unseen, x, cosine, sine,
    index_sd, unknowns, expected, residuals, white, square,
):  # fmt: skip
    """Weigh k readings for p unknowns, g times, with wrong index angles; look at what they say.

    Parameters: design (g, k, p) [1]; variance (g, k) of each reading by itself, slow (g, k, k)
    covariance of what ties them together [unit^2]; known (p,) one over the variance that an unknown
    has before [1/unit^2]; x (g, k) readings [unit], none where they are weighed alone; cosine, sine
    (g, k) of the index angle [1], index_sd of it, 0 for none [rad]: it moves a reading by what the
    first two unknowns, along sine and cosine, are without it. What all share has one row.

    Fills weights (g, p, k) [1]; root (g, k, k) L, one over its diagonal there [unit]; redundancy
    (g, k) [1]; dof (g,) readings that are not spent; unseen (g,) the sum of squares of what is
    missing to the first two unknowns in ``W X`` [1]. NaN where there is no L.
    Of readings: unknowns (g, p), expected (g, k) [unit]; residuals (g, k) over their sd, NaN where
    nothing controls them, white (g, k) residuals [1]; square (g,) the sum of their squares [1].
    """
    k, p = design.shape[1], design.shape[2]
    many = max(len(weights), len(x))
    lanes = _lanes(k, many)
    X, v, C, W = _room(k, p, lanes)
    L, J, N = np.empty((k, k, lanes)), np.empty((k, p, lanes)), np.empty((p, p, lanes))
    red, room = np.empty((k, lanes)), np.empty((p + 2, lanes))
    y, z, u = np.empty((k, lanes)), np.empty((k, lanes)), np.empty((p, lanes))
    total = np.empty(lanes)
    for first in range(0, many, lanes):
        n = min(lanes, many - first)
        for j in range(min(n, len(x))):
            for a in range(k):
                y[a, j] = x[first + j, a]
        if len(weights) > 1 or first == 0:
            m = n if len(weights) > 1 else 1
            _take(design, variance, slow, first, m, X, v, C)
            for again in range(1 if index_sd > 0.0 else 0, -1, -1):
                _weigh(X, v, C, known, m, W, L, red, dof[first : first + m],
                       unseen[first : first + m], J, N, room)  # fmt: skip
                if again:
                    _times(W, y, n, u)
                    for a in range(k):
                        for j in range(n):
                            i = first + j
                            c = cosine[i if len(cosine) > 1 else 0, a]
                            s = sine[i if len(sine) > 1 else 0, a]
                            v[a, j] += (index_sd * (u[0, j] * c - u[1, j] * s)) ** 2
            _give(W, L, red, m, weights, root, redundancy, first)
            if m < lanes and len(weights) == 1:
                _spread(X, W, L, red, lanes)
        if len(x) == 0:
            continue
        _times(W, y, n, u)
        for j in range(n):
            total[j] = 0.0
        for a in range(k):
            for j in range(n):
                z[a, j] = 0.0
            for b in range(p):
                for j in range(n):
                    z[a, j] += X[a, b, j] * u[b, j]
            for j in range(n):
                expected[first + j, a] = z[a, j]
                z[a, j] = y[a, j] - z[a, j]
            for c in range(a):
                for j in range(n):
                    z[a, j] -= L[a, c, j] * z[c, j]
            for j in range(n):
                z[a, j] *= L[a, a, j]
                total[j] += z[a, j] * z[a, j]
            for j in range(n):
                white[first + j, a] = z[a, j]
                seen = z[a, j] / math.sqrt(red[a, j]) if red[a, j] > 1e-6 else np.nan
                residuals[first + j, a] = seen
        for j in range(n):
            square[first + j] = total[j]
            for b in range(p):
                unknowns[first + j, b] = u[b, j]


@part
def _lanes(k, most):
    """Return how many sets of k readings are weighed side by side: the cache holds them."""
    return max(1, min(most, 128, 4096 // (k * k)))


@part
def _room(k, p, lanes):
    """Return room for design, variance, covariance and weights of sets side by side."""
    return (np.empty((k, p, lanes)), np.empty((k, lanes)), np.empty((k, k, lanes)),
            np.empty((p, k, lanes)))  # fmt: skip


@part
def _take(design, variance, slow, first, n, X, v, C):
    """Put n sets side by side, from number `first` on."""
    k, p = design.shape[1], design.shape[2]
    for j in range(n):
        i = first + j
        d, s = i if len(design) > 1 else 0, i if len(slow) > 1 else 0
        for a in range(k):
            v[a, j] = variance[i if len(variance) > 1 else 0, a]
            for b in range(p):
                X[a, b, j] = design[d, a, b]
            for b in range(a + 1):
                C[a, b, j] = slow[s, a, b]


@part
def _give(W, L, red, n, weights, root, redundancy, first):
    """Put what was found of n sets where each has its own."""
    p, k = W.shape[0], W.shape[1]
    for j in range(n):
        for a in range(k):
            redundancy[first + j, a] = red[a, j]
            for b in range(p):
                weights[first + j, b, a] = W[b, a, j]
            for b in range(k):
                root[first + j, a, b] = L[a, b, j] if b <= a else 0.0


@part
def _spread(X, W, L, red, lanes):
    """Let all sets side by side have what the first one has."""
    p, k = W.shape[0], W.shape[1]
    for a in range(k):
        for j in range(1, lanes):
            red[a, j] = red[a, 0]
        for b in range(p):
            for j in range(1, lanes):
                X[a, b, j], W[b, a, j] = X[a, b, 0], W[b, a, 0]
        for b in range(a + 1):
            for j in range(1, lanes):
                L[a, b, j] = L[a, b, 0]


@part
def _times(W, y, n, u):
    """Fill u (p, n) with W (p, k, n) y (k, n), set by set."""
    for b in range(W.shape[0]):
        for j in range(n):
            u[b, j] = 0.0
        for a in range(W.shape[1]):
            for j in range(n):
                u[b, j] += W[b, a, j] * y[a, j]


@part
def _weigh(X, v, C, known, n, W, L, redundancy, dof, unseen, J, N, x):
    """Weigh n sets of readings, which lie side by side: the last axis of all but `known`.

    X (k, p, n), v (k, n), C (k, k, n), known (p,): design, variance, slow and known of `fit_batch`,
    which says what is filled; J (k, p, n), N (p, p, n), x (p + 2, n) are room.
    """
    k, p = X.shape[0], X.shape[1]
    bad, scale = x[p + 1], x[:p]
    for a in range(k):
        for b in range(a + 1):
            for j in range(n):
                L[a, b, j] = C[a, b, j]
        for j in range(n):
            L[a, a, j] += v[a, j]
    _cholesky(L, n, 1e-13, x[p], bad)
    for b in range(p):
        for j in range(n):
            scale[b, j] = known[b]
        for a in range(k):
            for j in range(n):
                J[a, b, j] = X[a, b, j]
            for c in range(a):
                for j in range(n):
                    J[a, b, j] -= L[a, c, j] * J[c, b, j]
            for j in range(n):
                J[a, b, j] *= L[a, a, j]
                scale[b, j] += J[a, b, j] * J[a, b, j]
        for j in range(n):
            scale[b, j] = 1.0 / math.sqrt(scale[b, j]) if scale[b, j] > 0.0 else 1.0
        for a in range(k):
            for j in range(n):
                J[a, b, j] *= scale[b, j]
    for b in range(p):
        for c in range(b + 1):
            for j in range(n):
                N[b, c, j] = known[b] * scale[b, j] * scale[b, j] if b == c else 0.0
            for a in range(k):
                for j in range(n):
                    N[b, c, j] += J[a, b, j] * J[a, c, j]
    _inverted(N, n, x[p], unseen)
    for j in range(n):
        x[p, j], unseen[j] = 0.0, 0.0
    for a in range(k):
        for j in range(n):
            redundancy[a, j] = 1.0
        for b in range(p):
            for j in range(n):
                W[b, a, j] = 0.0
            for c in range(p):
                for j in range(n):
                    W[b, a, j] += N[b, c, j] * J[a, c, j]
            for j in range(n):
                redundancy[a, j] -= J[a, b, j] * W[b, a, j]
        for j in range(n):
            x[p, j] += 1.0 - redundancy[a, j]
    for b in range(p):
        for a in range(k - 1, -1, -1):
            for j in range(n):
                W[b, a, j] *= scale[b, j]
            for c in range(a + 1, k):
                for j in range(n):
                    W[b, a, j] -= L[c, a, j] * W[b, c, j]
            for j in range(n):
                W[b, a, j] *= L[a, a, j]
    for j in range(n):
        dof[j] = 0 if bad[j] > 0.0 else max(k - round(x[p, j]), 0)
        if bad[j] > 0.0:
            for a in range(k):
                redundancy[a, j] = np.nan
                for b in range(p):
                    W[b, a, j] = np.nan
    for b in range(min(p, 2)):
        for c in range(min(p, 2)):
            for j in range(n):
                x[p, j] = 1.0 if b == c else 0.0
            for a in range(k):
                for j in range(n):
                    x[p, j] -= W[b, a, j] * X[a, c, j]
            for j in range(n):
                unseen[j] += x[p, j] * x[p, j]


@part
def _cholesky(L, n, floor, limit, bad):
    """Replace n matrices, lower triangles L (k, k, n), by their factors, one over their diagonals.

    bad (n,) is 1 where a pivot is no larger than `floor` of its diagonal: there is none; limit (n,)
    is room.
    """
    k = L.shape[0]
    for j in range(n):
        bad[j] = 0.0
    for b in range(k):
        for j in range(n):
            limit[j] = floor * L[b, b, j]
        for c in range(b):
            for j in range(n):
                L[b, b, j] -= L[b, c, j] * L[b, c, j]
        for j in range(n):
            fine = L[b, b, j] > limit[j]
            bad[j] = bad[j] if fine else 1.0
            L[b, b, j] = 1.0 / math.sqrt(L[b, b, j] if fine else 1.0)
        for a in range(b + 1, k):
            for c in range(b):
                for j in range(n):
                    L[a, b, j] -= L[a, c, j] * L[b, c, j]
            for j in range(n):
                L[a, b, j] *= L[b, b, j]


@part
def _inverted(N, n, limit, near):
    """Replace matrices N (p, p, n), lower triangles, by their pseudo-inverses, whole ones.

    Where all unknowns are well told apart that is the inverse. limit, near (n,) are room.
    """
    p = N.shape[0]
    L, A, V, share = np.empty(N.shape), np.empty((p, p)), np.empty((p, p)), np.empty(p)
    for a in range(p):
        for b in range(a + 1):
            for j in range(n):
                L[a, b, j] = N[a, b, j]
    _cholesky(L, n, APART, limit, near)
    for j in range(n):
        if near[j] > 0.0:
            for a in range(p):
                for b in range(a + 1):
                    A[a, b], A[b, a] = N[a, b, j], N[a, b, j]
            _pseudo_inverse(A, V, share, p)
            for a in range(p):
                for b in range(p):
                    N[a, b, j] = A[a, b]
    for c in range(p):  # the inverse of L, then of L L'
        for a in range(c + 1, p):
            for j in range(n):
                L[a, c, j] *= -L[c, c, j]
            for b in range(c + 1, a):
                for j in range(n):
                    L[a, c, j] -= L[a, b, j] * L[b, c, j]
            for j in range(n):
                L[a, c, j] *= L[a, a, j]
    for a in range(p):
        for b in range(a + 1):
            for j in range(n):
                N[a, b, j] = N[a, b, j] if near[j] > 0.0 else 0.0
            for c in range(a, p):
                for j in range(n):
                    N[a, b, j] += 0.0 if near[j] > 0.0 else L[c, a, j] * L[c, b, j]
            for j in range(n):
                N[b, a, j] = N[a, b, j]


@kernel
def whiten_batch(root, x):
    """Replace x (g, k, q) by inv(L) x, L (g, k, k) or one of all (1, k, k) as `fit_batch` fills."""
    for i in range(len(x)):
        L = root[i if len(root) > 1 else 0]
        for a in range(x.shape[1]):
            for q in range(x.shape[2]):
                s = x[i, a, q]
                for c in range(a):
                    s -= L[a, c] * x[i, c, q]
                x[i, a, q] = s * L[a, a]


@kernel
def carried_batch(W, white, slow, setups, at, S, T):
    """Fill what noise of k readings is in the two numbers from `at` on of set-ups.

    Parameters: W (g, 2, k) what a reading adds to them [1]; white (g, k) the variance of each by
    itself, slow (g, k, k) covariance of what ties them together [unit^2]; setups (g,) their
    numbers. What all share has one row.

    Fills S, T (m, 4, 4): by what each has itself, and by what ties them together, where T has room
    [unit^2].
    """
    k = W.shape[2]
    for i in range(len(setups)):
        w, v = W[i if len(W) > 1 else 0], white[i if len(white) > 1 else 0]
        C, n = slow[i if len(slow) > 1 else 0], setups[i]
        for p in range(2):
            for q in range(2):
                s, t = 0.0, 0.0
                for a in range(k):
                    s += w[p, a] * v[a] * w[q, a]
                S[n, at + p, at + q] = s
                if len(T) > 0:
                    for a in range(k):
                        for b in range(k):
                            t += w[p, a] * C[a, b] * w[q, b]
                    T[n, at + p, at + q] = t


@part
def _pseudo_inverse(A, V, share, n):
    """Replace A (n, n), symmetric and not negative, by its pseudo-inverse.

    V (n, n) and share (n,) are room.
    """
    for a in range(n):
        for b in range(n):
            V[a, b] = 1.0 if a == b else 0.0
    for _ in range(SWEEPS):
        off, on = 0.0, 0.0
        for a in range(n):
            on += A[a, a] * A[a, a]
            for b in range(a):
                off += A[a, b] * A[a, b]
        if not off > 1e-32 * on:
            break
        for a in range(n):
            for b in range(a + 1, n):
                if not A[a, b] * A[a, b] > 1e-36 * on:
                    continue
                tau = 0.5 * (A[b, b] - A[a, a]) / A[a, b]
                t = math.copysign(1.0, tau) / (abs(tau) + math.hypot(1.0, tau))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(n):
                    u, v = A[k, a], A[k, b]
                    A[k, a], A[k, b] = c * u - s * v, s * u + c * v
                for k in range(n):
                    u, v = A[a, k], A[b, k]
                    A[a, k], A[b, k] = c * u - s * v, s * u + c * v
                    u, v = V[k, a], V[k, b]
                    V[k, a], V[k, b] = c * u - s * v, s * u + c * v
    most = 0.0
    for a in range(n):
        most = max(most, A[a, a])
    for a in range(n):
        share[a] = 1.0 / A[a, a] if A[a, a] > SEEN * most else 0.0
    for a in range(n):
        for b in range(a + 1):
            s = 0.0
            for k in range(n):
                s += V[a, k] * share[k] * V[b, k]
            A[a, b] = s
            A[b, a] = s
