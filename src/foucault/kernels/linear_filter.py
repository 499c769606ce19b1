"""Kalman and a-posteriori H-infinity filter of a linear system that is given epoch by epoch.

::

    x_k = Phi_k x_k-1 + w_k,    z_k = H_k x_k + v_k,    s_k = L x_k is what is wanted

One loop does both. The Kalman filter takes in each row h of H as a scalar measurement of variance
R; the H-infinity filter then takes in each row l of L as one of variance -gamma^2 whose outcome is
what was expected, which leaves x and adds to P. It exists as long as ``l P l' < gamma^2`` at every
one of these rows: the pivots of ``gamma^2 I - L P L'``. With gamma infinite nothing is added.

References
----------
.. [1] B. Hassibi, A. H. Sayed, T. Kailath, "Linear estimation in Krein spaces, part II:
   applications", *IEEE Transactions on Automatic Control* 41 (1996) 34-49, theorem 1.
"""

import math

import numpy as np

from foucault.kernels import kernel


@kernel
def carried(Phi, P, half, M, out):
    """Fill out (n, n) with ``Phi (P + half) Phi' + half``; M (n, n) is scratch, half (n,).

    Zeros of Phi are passed over: most rows of it are those of the identity.
    """
    n = half.size
    for j in range(n):
        P[j, j] += half[j]
    for r in range(n):
        for j in range(n):
            M[j, r] = 0.0
    # M = (Phi P)' = P Phi', row by row of P, which is symmetric.
    for r in range(n):
        row = out[r]
        for j in range(n):
            row[j] = 0.0
        for i in range(n):
            c = Phi[r, i]
            if c != 0.0:
                p = P[i]
                for j in range(n):
                    row[j] += c * p[j]
    for r in range(n):
        for j in range(n):
            M[j, r] = out[r, j]
    for r in range(n):
        row = out[r]
        for j in range(n):
            row[j] = 0.0
        for i in range(n):
            c = Phi[r, i]
            if c != 0.0:
                p = M[i]
                for j in range(n):
                    row[j] += c * p[j]
    for r in range(n):
        for j in range(r):
            out[r, j] = out[j, r] = 0.5 * (out[r, j] + out[j, r])
        out[r, r] += half[r]


@kernel
def seen(P, h, g):
    """Return ``h P h'`` for a row h (n,); g (n,) is filled with P h'."""
    n = h.size
    for j in range(n):
        g[j] = 0.0
    for i in range(n):
        c = h[i]
        if c != 0.0:
            p = P[i]
            for j in range(n):
                g[j] += c * p[j]
    S = 0.0
    for j in range(n):
        S += h[j] * g[j]
    return S


@kernel
def take_in(P, g, S):
    """Take ``g g' / S`` away from P (n, n)."""
    n = g.size
    for i in range(n):
        c = g[i] / S
        p = P[i]
        for j in range(n):
            p[j] -= c * g[j]


@kernel
def linear_filter(Phi, half, H, z, R, L, limit, gate, x0, P0, keep):
    """Filter forward.

    Parameters: Phi (m, n, n) from the epoch before; half (m, n) half of the white noise between
    them, taken in before and after; H (m, q, n), z (m, q), R (m, q) infinite where nothing is
    measured; L (r, n) and limit gamma^2, infinite for a Kalman filter; gate: innovations beyond so
    many sds are left out; x0 (n,), P0 (n, n) before the first; keep: whether covariances are kept.

    Returns x (m, n), sd (m, n), innovations and variances (m, q) (NaN where not measured; a NaN
    innovation alone where beyond the gate), predictions (m, n) and their covariances (m, n, n)
    where kept, the covariance after the last update, the smallest ``1 - l P l' / gamma^2`` of every
    epoch (m,), and the epoch at which the H-infinity filter ceased to exist, m if it did not.
    """
    m, q, n = H.shape
    kept = m if keep else 0
    states = np.full((m, n), np.nan)
    spread = np.full((m, n), np.nan)
    innovation = np.full((m, q), np.nan)
    variance = np.full((m, q), np.nan)
    predicted = np.empty((kept, n))
    before = np.empty((kept, n, n))
    margin = np.full(m, np.nan)
    x, P = x0.copy(), P0.copy()
    new, other, M = np.empty(n), np.empty((n, n)), np.empty((n, n))
    g = np.empty(n)
    after = P0.copy()
    for k in range(m):
        for r in range(n):
            c = 0.0
            for i in range(n):
                c += Phi[k, r, i] * x[i]
            new[r] = c
        x, new = new, x
        carried(Phi[k], P, half[k], M, other)
        P, other = other, P
        if keep:
            for r in range(n):
                predicted[k, r] = x[r]
                for j in range(n):
                    before[k, r, j] = P[r, j]
        for a in range(q):
            if R[k, a] < np.inf:
                h = H[k, a]
                e = z[k, a]
                for i in range(n):
                    e -= h[i] * x[i]
                S = seen(P, h, g) + R[k, a]
                variance[k, a] = S
                if e * e > gate * gate * S:
                    continue
                innovation[k, a] = e
                if S > 0.0:
                    take_in(P, g, S)
                    for i in range(n):
                        x[i] += g[i] * e / S
        for r in range(n):
            states[k, r] = x[r]
            spread[k, r] = math.sqrt(P[r, r]) if P[r, r] > 0.0 else 0.0
        if k == m - 1:
            for r in range(n):
                for j in range(n):
                    after[r, j] = P[r, j]
        if limit < np.inf:
            least = 1.0
            for a in range(L.shape[0]):
                S = seen(P, L[a], g) - limit
                least = min(least, -S / limit)
                if S < 0.0:
                    take_in(P, g, S)
                else:
                    margin[k] = least
                    return (
                        states, spread, innovation, variance, predicted, before, after, margin, k
                    )  # fmt: skip
            margin[k] = least
    return states, spread, innovation, variance, predicted, before, after, margin, m


@kernel
def linear_smoother(Phi, H, R, innovation, predicted, before):
    """Smooth a Kalman run backward: the modified Bryson-Frazier form, without an inverse.

    Parameters: as `linear_filter` was given and what it kept. Returns states (m, n) and their
    covariances (m, n, n) as seen from the end, and the adjoint lambda (n,), Lambda (n, n) at the
    start: with x0, P0 the smoothed start is ``x0 - P0 lambda``, of covariance
    ``P0 - P0 Lambda P0``.
    """
    m, q, n = H.shape
    states = np.empty((m, n))
    cov = np.empty((m, n, n))
    lam, adj = np.zeros(n), np.zeros((n, n))
    gains, variances = np.empty((q, n)), np.empty(q)
    P, u, M = np.empty((n, n)), np.empty(n), np.empty((n, n))
    for k in range(m - 1, -1, -1):
        for r in range(n):
            for j in range(n):
                P[r, j] = before[k, r, j]
        for a in range(q):  # the gains once more
            if not math.isnan(innovation[k, a]):
                variances[a] = seen(P, H[k, a], gains[a]) + R[k, a]
                take_in(P, gains[a], variances[a])
        for a in range(q - 1, -1, -1):
            if math.isnan(innovation[k, a]):
                continue
            h, g, S = H[k, a], gains[a], variances[a]
            c = innovation[k, a]
            for i in range(n):
                u[i] = 0.0
            for i in range(n):
                c += g[i] * lam[i]
                for j in range(n):
                    u[j] += g[i] * adj[i, j] / S
            both = 1.0
            for i in range(n):
                both += u[i] * g[i]
            for i in range(n):
                lam[i] -= h[i] * c / S
                for j in range(n):
                    adj[i, j] += h[i] * h[j] * both / S - h[i] * u[j] - u[i] * h[j]
        for r in range(n):
            c = predicted[k, r]
            for i in range(n):
                c -= before[k, r, i] * lam[i]
            states[k, r] = c
            for j in range(n):
                M[r, j] = 0.0
            for i in range(n):
                for j in range(n):
                    M[r, j] += before[k, r, i] * adj[i, j]
        for r in range(n):
            for j in range(n):
                cov[k, r, j] = before[k, r, j]
            for i in range(n):
                for j in range(n):
                    cov[k, r, j] -= M[r, i] * before[k, i, j]
        for i in range(n):
            u[i] = 0.0
            for j in range(n):
                M[i, j] = 0.0
        for r in range(n):
            for i in range(n):
                c = Phi[k, r, i]
                if c != 0.0:
                    u[i] += c * lam[r]
                    for j in range(n):
                        M[i, j] += c * adj[r, j]
        for i in range(n):
            lam[i] = u[i]
            for j in range(n):
                adj[i, j] = 0.0
        for r in range(n):
            for i in range(n):
                c = Phi[k, r, i]
                if c != 0.0:
                    for j in range(n):
                        adj[j, i] += M[j, r] * c
    return states, cov, lam, adj
