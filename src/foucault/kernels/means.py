"""Least squares of many small sets of means: few readings each, and fewer unknowns.

With L L' the covariance of the k readings of a set, J = L^-1 X, and the p unknowns scaled so that
``J'J`` and what is known of them beforehand have a unit diagonal together::

    W = N^+ J' L^-1,  N = J'J + known      hat = J N^+ J'

N^+ is a pseudo-inverse, by Jacobi's rotations: stops may leave an unknown unseen.
"""

import math

import numpy as np

from foucault.kernels import kernel, part
from foucault.kernels.small_matrices import cholesky

SEEN = 1e-13
"""Least eigenvalue of N that is seen, over the largest [1]."""

SWEEPS = 30


@kernel
def fit_batch(design, variance, slow, known, weights, root, redundancy, dof):
    """Weigh k readings for p unknowns, g times.

    Parameters: design (g, k, p) [1]; variance (g, k) of each reading by itself, slow (g, k, k)
    covariance of what ties them together [unit^2]; known (p,) one over the variance that an unknown
    has before [1/unit^2]. What all share has one row.

    Fills weights (g, p, k) [1]; root (g, k, k) L, one over its diagonal there [unit]; redundancy
    (g, k) [1]; dof (g,) readings that are not spent. NaN where there is no L.
    """
    k, p = design.shape[1], design.shape[2]
    J, N, V = np.empty((k, p)), np.empty((p, p)), np.empty((p, p))
    scale, share, x = np.empty(p), np.empty(p), np.empty(k)
    for i in range(len(weights)):
        X, v = design[i if len(design) > 1 else 0], variance[i if len(variance) > 1 else 0]
        S, L, W = slow[i if len(slow) > 1 else 0], root[i], weights[i]
        for a in range(k):
            for b in range(k):
                L[a, b] = S[a, b] if b <= a else 0.0
            L[a, a] += v[a]
        if not cholesky(L, k):
            for a in range(k):
                redundancy[i, a] = np.nan
                for b in range(p):
                    W[b, a] = np.nan
            dof[i] = 0
            continue
        for b in range(p):
            scale[b] = known[b]
            for a in range(k):
                s = X[a, b]
                for c in range(a):
                    s -= L[a, c] * J[c, b]
                J[a, b] = s * L[a, a]
                scale[b] += J[a, b] * J[a, b]
            scale[b] = 1.0 / math.sqrt(scale[b]) if scale[b] > 0.0 else 1.0
            for a in range(k):
                J[a, b] *= scale[b]
        for b in range(p):
            for c in range(p):
                s = known[b] * scale[b] * scale[b] if b == c else 0.0
                for a in range(k):
                    s += J[a, b] * J[a, c]
                N[b, c] = s
        _pseudo_inverse(N, V, share, p)
        spent = 0.0
        for b in range(p):
            for a in range(k):
                s = 0.0
                for c in range(p):
                    s += N[b, c] * J[a, c]
                W[b, a] = s
        for a in range(k):
            s = 0.0
            for b in range(p):
                s += J[a, b] * W[b, a]
            redundancy[i, a] = 1.0 - s
            spent += s
        dof[i] = max(k - round(spent), 0)
        for b in range(p):
            for a in range(k - 1, -1, -1):
                s = W[b, a] * scale[b]
                for c in range(a + 1, k):
                    s -= L[c, a] * x[c]
                x[a] = s * L[a, a]
            for a in range(k):
                W[b, a] = x[a]


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

    Fills S, T (m, 4, 4): by what each has itself, and by what ties them together [unit^2].
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
                    for b in range(k):
                        t += w[p, a] * C[a, b] * w[q, b]
                S[n, at + p, at + q], T[n, at + p, at + q] = s, t


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
