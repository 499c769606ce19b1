"""Kalman and a-posteriori H-infinity filter of a linear system that is given epoch by epoch.

::

    x_k = Phi_k x_k-1 + u_k + w_k,    z_k = H_k x_k + v_k,    s_k = L x_k is what is wanted

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

from foucault.kernels import inlined, kernel, part


@inlined
def combined(c, rows, many, width, out):
    """Fill out[:width] with the sum of ``c[i] * rows[i, :width]`` over the many i with c[i] != 0.

    Four rows at a time: one row at a time, a loop over so few columns is mostly its own beginning.
    """
    for j in range(width):
        out[j] = 0.0
    i0 = i1 = i2 = 0
    got = 0
    for i in range(many):
        if c[i] != 0.0:
            if got == 3:
                c0, c1, c2, c3 = c[i0], c[i1], c[i2], c[i]
                for j in range(width):  # a row by itself, rows[i0], takes long to compile
                    out[j] += (
                        c0 * rows[i0, j] + c1 * rows[i1, j] + c2 * rows[i2, j] + c3 * rows[i, j]
                    )
                got = 0
            else:
                i0, i1, i2 = i1, i2, i
                got += 1
    if got > 0:
        c0, c1, c2 = c[i0] if got > 2 else 0.0, c[i1] if got > 1 else 0.0, c[i2]
        i1 = i1 if got > 1 else i2
        i0 = i0 if got > 2 else i2
        for j in range(width):
            out[j] += c0 * rows[i0, j] + c1 * rows[i1, j] + c2 * rows[i2, j]


@part
def carried(Phi, P, half, row, M):
    """Carry P (n, n) over ``Phi (P + half) Phi' + half``, in place; half (n,).

    Phi (b, n): rows beyond are those of the identity, and what they make of P is P. row (n,) and
    M (n, n) are scratch.
    """
    n, many = half.size, Phi.shape[0]
    for r in range(n):
        P[r, r] += half[r]
    for b in range(many):  # (Phi P)', column by column
        combined(Phi[b], P, n, n, row)
        for j in range(n):
            M[j, b] = row[j]
    for b in range(many):
        for j in range(n):
            P[b, j] = P[j, b] = M[j, b]
    for b in range(many):
        combined(Phi[b], M, n, many, row)
        for a in range(b + 1):
            P[b, a] = P[a, b] = row[a]
    for r in range(n):
        P[r, r] += half[r]


@part
def seen(P, h, g):
    """Return ``h P h'`` for a row h (n,); g (n,) is filled with P h'."""
    n = h.size
    for j in range(n):
        g[j] = 0.0
    for i in range(n):
        c = h[i]
        if c != 0.0:
            for j in range(n):
                g[j] += c * P[i, j]
    S = 0.0
    for j in range(n):
        S += h[j] * g[j]
    return S


@part
def take_in(P, g, S):
    """Take ``g g' / S`` away from P (n, n)."""
    n = g.size
    share = 1.0 / S
    for i in range(n):
        c = g[i] * share
        for j in range(n):
            P[i, j] -= c * g[j]


@kernel
def linear_filter(Phi, jump, half, H, z, R, L, limit, gate, x0, P0, keep):
    """Filter forward.

    Parameters: Phi (m, b, n) from the epoch before, rows beyond b those of the identity; jump
    (m, b) what is then added to the state; half (m, n) half of the white noise between them, taken
    in before and after; H (m, q, n), z (m, q),
    R (m, q) infinite where nothing is measured; L (r, n) and limit gamma^2, infinite for a Kalman
    filter; gate: innovations beyond so many sds are left out; x0 (n,), P0 (n, n) before the first;
    keep: whether covariances are kept.

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
    new, g, M = np.empty(n), np.empty(n), np.empty((n, n))
    many = Phi.shape[1]
    after = P0.copy()
    for k in range(m):
        for r in range(many):
            c = 0.0
            for i in range(n):
                c += Phi[k, r, i] * x[i]
            new[r] = c
        for r in range(many):
            x[r] = new[r] + jump[k, r]
        carried(Phi[k], P, half[k], g, M)
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
def linear_smoother(Phi, H, R, innovation, predicted, before, whole):
    """Smooth a Kalman run backward: the modified Bryson-Frazier form, without an inverse.

    Parameters: as `linear_filter` was given and what it kept; whole: whether more than the adjoint
    lambda is wanted, which takes a small part of the time. Returns states (m, n) and their
    covariances (m, n, n) as seen from the end, and the adjoint lambda (n,), Lambda (n, n) at the
    start: with x0, P0 the smoothed start is ``x0 - P0 lambda``, of covariance
    ``P0 - P0 Lambda P0``.
    """
    m, q, n = H.shape
    kept = m if whole else 0
    states = np.empty((kept, n))
    cov = np.empty((kept, n, n))
    lam, adj = np.zeros(n), np.zeros((n, n))
    gains, variances = np.empty((q, n)), np.empty(q)
    P, u, M = np.empty((n, n)), np.empty(n), np.empty((n, n))
    many = Phi.shape[1]
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
                c += g[i] * lam[i]
            for i in range(n):
                lam[i] -= h[i] * c / S
            if not whole:
                continue
            for i in range(n):
                u[i] = 0.0
            for i in range(n):
                for j in range(n):
                    u[j] += g[i] * adj[i, j] / S
            both = 1.0
            for i in range(n):
                both += u[i] * g[i]
            for i in range(n):
                for j in range(n):
                    adj[i, j] += h[i] * h[j] * both / S - h[i] * u[j] - u[i] * h[j]
        for r in range(kept and n):
            c = predicted[k, r]
            for i in range(n):
                c -= before[k, r, i] * lam[i]
            states[k, r] = c
            for j in range(n):
                M[r, j] = 0.0
            for i in range(n):
                for j in range(n):
                    M[r, j] += before[k, r, i] * adj[i, j]
        for r in range(kept and n):
            for j in range(n):
                cov[k, r, j] = before[k, r, j]
            for i in range(n):
                for j in range(n):
                    cov[k, r, j] -= M[r, i] * before[k, i, j]
        for i in range(n):
            u[i] = lam[i] if i >= many else 0.0
        for r in range(many):
            for i in range(n):
                c = Phi[k, r, i]
                if c != 0.0:
                    u[i] += c * lam[r]
        for i in range(n):
            lam[i] = u[i]
        if not whole:
            continue
        for i in range(n):  # M = Phi' adj
            for j in range(n):
                M[i, j] = adj[i, j] if i >= many else 0.0
        for r in range(many):
            for i in range(n):
                c = Phi[k, r, i]
                if c != 0.0:
                    for j in range(n):
                        M[i, j] += c * adj[r, j]
        for i in range(n):  # adj = M Phi
            for j in range(n):
                adj[i, j] = M[i, j] if j >= many else 0.0
        for r in range(many):
            for i in range(n):
                c = Phi[k, r, i]
                if c != 0.0:
                    for j in range(n):
                        adj[j, i] += M[j, r] * c
    return states, cov, lam, adj
