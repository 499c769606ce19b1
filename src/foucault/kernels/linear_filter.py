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

from foucault.kernels import kernel, part, reduction, summed

TOGETHER = 6
"""So many rows are taken away from P in one pass over it."""


@part
def picked(c, at, some):
    """Fill at and some with where c (n,) is not zero and what it is there; return how many.

    at, some (n + 3,): zeros follow up to a multiple of four.
    """
    many = 0
    for i in range(c.size):
        if c[i] != 0.0:
            at[many], some[many] = i, c[i]
            many += 1
    for a in range(many, many + 3):
        at[a], some[a] = at[many - 1], 0.0
    return many


@summed
def combined(at, some, many, rows, out, r):
    """Fill row r of out with the sum of ``some[a] * rows[at[a]]`` over the many of `picked`.

    Four rows at a time: one row at a time, a loop over so few columns is mostly its own beginning.
    """
    width = rows.shape[1]
    for j in range(width):
        out[r, j] = 0.0
    for a in range(0, many, 4):
        i0, i1, i2, i3 = at[a], at[a + 1], at[a + 2], at[a + 3]
        c0, c1, c2, c3 = some[a], some[a + 1], some[a + 2], some[a + 3]
        for j in range(width):  # a row by itself, rows[i0], takes long to compile
            out[r, j] += c0 * rows[i0, j] + c1 * rows[i1, j] + c2 * rows[i2, j] + c3 * rows[i3, j]


@reduction
def carried(Phi, half, P, T, at, some):
    """Carry P over ``Phi (P + half) Phi' + half`` and x over ``Phi x``, in place; half (n,).

    Phi (b, n): rows beyond are those of the identity, and what they make of P is P. P (n, w): x is
    column n, the others are nothing. T (b, w) and at, some (n + 3,) are scratch.
    """
    n, many = half.size, Phi.shape[0]
    for r in range(n):
        P[r, r] += half[r]
    for b in range(many):
        combined(at, some, picked(Phi[b], at, some), P, T, b)
    for b in range(many):
        for a in range(b + 1):
            c = 0.0
            for j in range(n):
                c += T[b, j] * Phi[a, j]
            P[b, a] = P[a, b] = c
        for j in range(many, n):
            P[b, j] = P[j, b] = T[b, j]
        P[b, n] = T[b, n]
    for r in range(n):
        P[r, r] += half[r]


@summed
def seen(P, h, G, share, taken, at, some):
    """Return ``h P h'`` for a row h (n,), and fill row `taken` of G (., w) with ``h (P x)``.

    Of P (n, w) what the rows of G before take away, ``share g' g`` each, is not yet taken away.
    """
    many = picked(h, at, some)
    combined(at, some, many, P, G, taken)
    for b in range(taken):
        c = 0.0
        for a in range(many):
            c += some[a] * G[b, at[a]]
        c *= share[b]
        for j in range(G.shape[1]):
            G[taken, j] -= c * G[b, j]
    S = 0.0
    for a in range(many):
        S += some[a] * G[taken, at[a]]
    return S


@summed
def take_in(P, G, share, taken):
    """Take ``share g' g`` of the first `taken` rows of G away from P (n, w); the others are lost.

    TOGETHER rows at a time: one by one, P is loaded and stored as often.
    """
    for a in range(taken, G.shape[0]):
        share[a] = 0.0
        for j in range(G.shape[1]):
            G[a, j] = 0.0
    for a in range(0, taken, TOGETHER):
        for i in range(P.shape[0]):
            c0, c1, c2 = share[a] * G[a, i], share[a + 1] * G[a + 1, i], share[a + 2] * G[a + 2, i]
            c3, c4, c5 = (
                share[a + 3] * G[a + 3, i], share[a + 4] * G[a + 4, i], share[a + 5] * G[a + 5, i],
            )  # fmt: skip
            for j in range(P.shape[1]):
                P[i, j] -= (
                    c0 * G[a, j] + c1 * G[a + 1, j] + c2 * G[a + 2, j]
                    + c3 * G[a + 3, j] + c4 * G[a + 4, j] + c5 * G[a + 5, j]
                )  # fmt: skip


@kernel
def linear_filter(Phi, jump, half, H, z, R, L, limit, gate, P, T, G, keep):
    """Filter forward.

    Parameters: Phi (m, b, n) from the epoch before, rows beyond b those of the identity; jump
    (m, b) what is then added to the state; half (m, n) half of the white noise between them, taken
    in before and after; H (m, q, n), z (m, q),
    R (m, q) infinite where nothing is measured; L (r, n) and limit gamma^2, infinite for a Kalman
    filter; gate: innovations beyond so many sds are left out; P (n, w) covariance before the
    first, column n the state, the others zero; T (b, w) and G (TOGETHER rows, or the
    next multiple that holds q, w) are scratch; keep: whether covariances are kept.

    Returns x (m, n), sd (m, n), innovations and variances (m, q) (NaN where not measured; a NaN
    innovation alone where beyond the gate), predictions (m, n) and their covariances (m, n, n)
    where kept, the covariance after the last update, the smallest ``1 - l P l' / gamma^2`` of every
    epoch (m,), and the epoch at which the H-infinity filter ceased to exist, m if it did not.

    The state is one column more of P: what is done to both is the same.
    """
    m, q, n = H.shape
    many, kept = Phi.shape[1], m if keep else 0
    states, spread = np.empty((m, n)), np.empty((m, n))
    innovation, variance = np.empty((m, q)), np.empty((m, q))
    predicted, before = np.empty((kept, n)), np.empty((kept, n, n))
    margin = np.empty(m)
    for k in range(m):  # np.full takes long to compile
        margin[k] = np.nan
        for r in range(n):
            states[k, r] = spread[k, r] = np.nan
        for a in range(q):
            innovation[k, a] = variance[k, a] = np.nan
    after = np.empty((n, n))
    for r in range(n):
        for j in range(n):
            after[r, j] = P[r, j]
    share = np.zeros(G.shape[0])
    at, some = np.zeros(n + 3, np.int64), np.zeros(n + 3)
    for k in range(m):
        carried(Phi[k], half[k], P, T, at, some)
        for r in range(many):
            P[r, n] += jump[k, r]
        for r in range(n if keep else 0):
            predicted[k, r] = P[r, n]
            for j in range(n):
                before[k, r, j] = P[r, j]
        taken = np.int64(0)  # a number written here would be compiled for by itself
        for a in range(q):
            if R[k, a] < np.inf:
                S = seen(P, H[k, a], G, share, taken, at, some) + R[k, a]
                G[taken, n] -= z[k, a]
                e = -G[taken, n]
                variance[k, a] = S
                if e * e > gate * gate * S:
                    continue
                innovation[k, a] = e
                if S > 0.0:
                    share[taken] = 1.0 / S
                    taken += 1
        take_in(P, G, share, taken)
        for r in range(n):
            states[k, r] = P[r, n]
            spread[k, r] = math.sqrt(P[r, r]) if P[r, r] > 0.0 else 0.0
        if k == m - 1:
            for r in range(n):
                for j in range(n):
                    after[r, j] = P[r, j]
        if limit < np.inf:
            margin[k] = 1.0
            taken = np.int64(0)
            for a in range(L.shape[0]):
                S = seen(P, L[a], G, share, taken, at, some) - limit
                if -S < margin[k] * limit:
                    margin[k] = -S / limit
                if not S < 0.0:
                    return (
                        states, spread, innovation, variance, predicted, before, after, margin, k
                    )  # fmt: skip
                G[taken, n] = 0.0
                share[taken] = 1.0 / S
                taken += 1
                if taken == TOGETHER or a == L.shape[0] - 1:
                    take_in(P, G, share, taken)
                    taken = np.int64(0)
    return states, spread, innovation, variance, predicted, before, after, margin, m


@kernel
def linear_smoother(Phi, H, R, innovation, before, whole):
    """Smooth a Kalman run backward: the modified Bryson-Frazier form, without an inverse.

    Parameters: as `linear_filter` was given and what it kept; whole: whether more than the adjoint
    at the start is wanted, which takes a small part of the time. Returns the adjoint lambda (m, n)
    and Lambda (m, n, n) just before what each epoch measures, and the same (n,), (n, n) at the
    start: with x, P predicted there the smoothed state is ``x - P lambda``, of covariance
    ``P - P Lambda P``.
    """
    m, q, n = H.shape
    kept = m if whole else 0
    lams, adjs = np.empty((kept, n)), np.empty((kept, n, n))
    lam, adj = np.zeros(n), np.zeros((n, n))
    G, share = np.zeros((q, n)), np.zeros(q)
    at, some = np.zeros(n + 3, np.int64), np.zeros(n + 3)
    row, u, M = np.zeros(q, np.int64), np.empty(n), np.empty((n, n))
    many = Phi.shape[1]
    for k in range(m - 1, -1, -1):
        taken = np.int64(0)
        for a in range(q):  # the gains once more
            if not math.isnan(innovation[k, a]):
                S = seen(before[k], H[k, a], G, share, taken, at, some) + R[k, a]
                share[taken] = 1.0 / S
                row[taken] = a
                taken += 1
        for b in range(taken - 1, -1, -1):
            a = row[b]
            c = innovation[k, a]
            for i in range(n):
                c += G[b, i] * lam[i]
            for i in range(n):
                lam[i] -= H[k, a, i] * c * share[b]
            if not whole:
                continue
            for i in range(n):
                u[i] = 0.0
            for i in range(n):
                c = G[b, i] * share[b]
                for j in range(n):
                    u[j] += c * adj[i, j]
            both = 1.0
            for i in range(n):
                both += u[i] * G[b, i]
            both *= share[b]
            for i in range(n):
                for j in range(n):
                    adj[i, j] += H[k, a, i] * (H[k, a, j] * both - u[j]) - u[i] * H[k, a, j]
        for r in range(kept and n):
            lams[k, r] = lam[r]
            for j in range(n):
                adjs[k, r, j] = adj[r, j]
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
    return lams, adjs, lam, adj
