"""Normal equations of IMUs on one rigid body, whose motion is a cubic B-spline.

Rate w and specific force f of the master are splines with uniform knots; alpha is w'. Of a slave::

    w_c = Q w,  f_c = Q (f + Om r),  Om = [alpha x] + [w x]^2
    gyro = K_g w_c + G f_c + b_g at t,    accel = K_a f_c + b_a at t - late

The spline fills a band of 24 and each slave a border of 39 columns: rotation (3, on the left of Q),
r (3), offset, rate of the clocks, b_g (3), b_a (3), K_g (9), K_a (6, lower), late, G (9).
"""

import math

import numpy as np

from foucault.kernels import kernel, part

COLUMNS = 39


@part
def _weights(u, N, D, E):
    """Fill N, D, E (4): cubic B-spline weights at u in [0, 1], first and second derivatives."""
    v = 1.0 - u
    N[0], N[3] = v * v * v / 6.0, u * u * u / 6.0
    N[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    N[2] = 1.0 - N[0] - N[1] - N[3]
    D[0], D[3] = -0.5 * v * v, 0.5 * u * u
    D[1] = 1.5 * u * u - 2.0 * u
    D[2] = -D[0] - D[1] - D[3]
    E[0], E[1], E[2], E[3] = v, 3.0 * u - 2.0, 1.0 - 3.0 * u, u


@part
def _motion(spline, k, h, N, D, E, out):
    """Fill out (5, 3): w, alpha, alpha', f, f' of a spline (n, 6) in the interval k."""
    out[:] = 0.0
    for j in range(4):
        for i in range(3):
            out[0, i] += N[j] * spline[k + j, i]
            out[1, i] += D[j] * spline[k + j, i] / h
            out[2, i] += E[j] * spline[k + j, i] / (h * h)
            out[3, i] += N[j] * spline[k + j, 3 + i]
            out[4, i] += D[j] * spline[k + j, 3 + i] / h


@part
def _slave(m, x, since, J, Y, out):
    """Fill J (6, 39), Y (2, 3, 3), out (6): derivatives of a slave's reading, and the reading.

    m (5, 3): motion; x (46): Q, K_g, G, K_a (9 each), r, b_g, b_a, late; since: time from the
    middle of the stamps. Y: derivatives of f_c by w and by alpha.
    """
    w, a, b, f, df = m[0], m[1], m[2], m[3], m[4]
    r = x[36:39]
    wr, ww = 0.0, 0.0
    for i in range(3):
        wr += w[i] * r[i]
        ww += w[i] * w[i]
    W, A, Q, y, dy = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    T = np.zeros((3, 3))
    A[0, 1], A[0, 2], A[1, 2] = r[2], -r[1], r[0]
    A[1, 0], A[2, 0], A[2, 1] = -r[2], r[1], -r[0]
    T[0, 1], T[0, 2], T[1, 2] = -a[2], a[1], -a[0]
    T[1, 0], T[2, 0], T[2, 1] = a[2], -a[1], a[0]
    for i in range(3):
        for j in range(3):
            Q[i, j] = x[3 * i + j]
            W[i, j] = w[i] * r[j] - 2.0 * r[i] * w[j]
            T[i, j] += w[i] * w[j]
        W[i, i] += wr
        T[i, i] -= ww
    for i in range(3):
        y[i], dy[i] = f[i], df[i]
        for j in range(3):
            y[i] += T[i, j] * r[j]
            dy[i] += W[i, j] * a[j] + A[i, j] * b[j]
    wc, fc, ac, dc, R = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    Y[:] = 0.0
    for i in range(3):
        for j in range(3):
            wc[i] += Q[i, j] * w[j]
            ac[i] += Q[i, j] * a[j]
            fc[i] += Q[i, j] * y[j]
            dc[i] += Q[i, j] * dy[j]
            for n in range(3):
                Y[0, i, j] += Q[i, n] * W[n, j]
                Y[1, i, j] += Q[i, n] * A[n, j]
                R[i, j] += Q[i, n] * T[n, j]
    J[:] = 0.0
    for i in range(3):
        out[i], out[3 + i] = x[39 + i], x[42 + i]
        J[i, 8 + i] = J[3 + i, 11 + i] = 1.0
        column = 23
        for j in range(3):
            g, s, k = x[9 + 3 * i + j], x[18 + 3 * i + j], x[27 + 3 * i + j]
            out[i] += g * wc[j] + s * fc[j]
            out[3 + i] += k * fc[j]
            p, q = (j + 1) % 3, (j + 2) % 3
            # d (e x v)_j = e_p v_q - e_q v_p
            J[i, p] += g * wc[q] + s * fc[q]
            J[i, q] -= g * wc[p] + s * fc[p]
            J[3 + i, p] += k * fc[q]
            J[3 + i, q] -= k * fc[p]
            for n in range(3):
                J[i, 3 + n] += s * R[j, n]
                J[3 + i, 3 + n] += k * R[j, n]
            J[i, 6] += g * ac[j] + s * dc[j]
            J[3 + i, 6] += k * dc[j]
            J[i, 14 + 3 * i + j] = wc[j]
            J[i, 30 + 3 * i + j] = fc[j]
            J[3 + i, 29] -= k * dc[j]
        for n in range(i):
            column += n + 1
        for j in range(i + 1):
            J[3 + i, column + j] = fc[j]
        J[i, 7], J[3 + i, 7] = since * J[i, 6], since * J[3 + i, 6]


@part
def _spread(x, own, triad, Y, N, D, h, S):
    """Fill S (3, 24): derivatives of gyros (triad 0) or accelerometers by the four knots."""
    S[:] = 0.0
    for j in range(4):
        for i in range(3):
            if own < 0:
                S[i, 6 * j + 3 * triad + i] = N[j]
                continue
            for c in range(3):
                by_w, by_f = 0.0, 0.0
                for n in range(3):
                    g = x[9 + 3 * i + n] if triad == 0 else 0.0
                    s = x[(18 if triad == 0 else 27) + 3 * i + n]
                    q = N[j] * x[3 * n + c]
                    by_w += g * q + s * (N[j] * Y[0, n, c] + D[j] / h * Y[1, n, c])
                    by_f += s * q
                S[i, 6 * j + c], S[i, 6 * j + 3 + c] = by_w, by_f


@part
def _gather(S, X, one, own, here, total):
    """Add three rows: S (3, 24) by knots, X (3, 40) by parameters and readings, weight one.

    here (24, 64): what an interval holds, by knots and by X; total (40, 40): by X alone.
    """
    for a in range(24):
        u, v, w = one * S[0, a], one * S[1, a], one * S[2, a]
        if u == 0.0 and v == 0.0 and w == 0.0:
            continue
        for b in range(a + 1):
            here[a, b] += u * S[0, b] + v * S[1, b] + w * S[2, b]
        if own < 0:
            here[a, 63] += u * X[0, 39] + v * X[1, 39] + w * X[2, 39]
            continue
        for c in range(40):
            here[a, 24 + c] += u * X[0, c] + v * X[1, c] + w * X[2, c]
    if own >= 0:
        for a in range(40):
            u, v, w = one * X[0, a], one * X[1, a], one * X[2, a]
            if u == 0.0 and v == 0.0 and w == 0.0:
                continue
            for b in range(a + 1):
                total[a, b] += u * X[0, b] + v * X[1, b] + w * X[2, b]


@part
def _settle(q, own, here, band, border, grad):
    """Add what an interval q holds, here (24, 64), to the normal equations, and empty it."""
    for a in range(24):
        for b in range(a + 1):
            band[6 * q + b, a - b] += here[a, b]
        if own >= 0:
            for c in range(39):
                border[6 * q + a, own + c] += here[a, 24 + c]
        grad[6 * q + a] += here[a, 63]
    here[:] = 0.0


@kernel
def normal(time, since, read, var, x, own, spline, other, first, h, band, border, corner, grad, rhs,
           left):  # fmt: skip
    """Add readings of one instrument to the normal equations.

    time, since (n,): clock of the master, and own time from the middle; read (n, 6); var (2,) of
    gyros and accelerometers; x (46,) its parameters, as `_slave`; own: first of its columns,
    negative: the master; spline (m, 6). other (m, 6) or (0, 6): columns are those there less those
    here. band (6 m, 24), border (6 m, p), corner (p, p), grad (6 m,), rhs (p,) are added to,
    left (n, 6) is filled: readings less what they should be, NaN beyond the spline.
    """
    N, D, E, m = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((5, 3))
    J, K, Y, Y2 = np.zeros((6, 39)), np.zeros((6, 39)), np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    out, out2, S = np.zeros(6), np.zeros(6), np.zeros((3, 24))
    X, here, total = np.zeros((3, 40)), np.zeros((24, 64)), np.zeros((40, 40))
    noise = other.shape[0] > 0
    for triad in range(2):
        now = -1
        for k in range(time.shape[0]):
            at = (time[k] - (triad * x[45] if own >= 0 else 0.0) - first) / h
            q = math.floor(at)
            for i in range(3 * triad, 3 * triad + 3):
                left[k, i] = np.nan
            if q < 0 or q > spline.shape[0] - 4:
                continue
            _weights(at - q, N, D, E)
            _motion(spline, q, h, N, D, E, m)
            if own < 0:
                for i in range(3):
                    out[i], out[3 + i] = m[0, i], m[3, i]
            else:
                _slave(m, x, since[k], J, Y, out)
            _spread(x, own, triad, Y, N, D, h, S)
            if noise and own >= 0:
                _motion(other, q, h, N, D, E, m)
                _slave(m, x, since[k], K, Y2, out2)
                for i in range(6):
                    for c in range(39):
                        J[i, c] = K[i, c] - J[i, c]
            for i in range(3):
                r = read[k, 3 * triad + i] - out[3 * triad + i]
                left[k, 3 * triad + i] = r
                told = np.isfinite(r)
                for c in range(39):
                    X[i, c] = J[3 * triad + i, c] if told else 0.0
                X[i, 39] = r if told else 0.0
                if not told:
                    for a in range(24):
                        S[i, a] = 0.0
            if q != now:
                if now >= 0:
                    _settle(now, own, here, band, border, grad)
                now = q
            _gather(S, X, 1.0 / var[triad], own, here, total)
        if now >= 0:
            _settle(now, own, here, band, border, grad)
    if own >= 0:
        for a in range(39):
            rhs[own + a] += total[39, a]
            for b in range(a + 1):
                corner[own + a, own + b] += total[a, b]


@kernel
def forward(L, W):
    """Solve with a banded triangle, L (b, m) by its diagonals; W (m, c) is overwritten."""
    for i in range(W.shape[0]):
        for j in range(max(0, i - L.shape[0] + 1), i):
            v = L[i - j, j]
            for c in range(W.shape[1]):
                W[i, c] -= v * W[j, c]
        one = 1.0 / L[0, i]
        for c in range(W.shape[1]):
            W[i, c] *= one


@kernel
def backward(L, W):
    """Solve with the transpose of a banded triangle, as `forward`."""
    for i in range(W.shape[0] - 1, -1, -1):
        one = 1.0 / L[0, i]
        for c in range(W.shape[1]):
            W[i, c] *= one
        for j in range(max(0, i - L.shape[0] + 1), i):
            v = L[i - j, j]
            for c in range(W.shape[1]):
                W[j, c] -= v * W[i, c]


@kernel
def scores(time, since, left, var, x, own, spline, Z, first, h, block, out):
    """Add what readings say of the parameters, the motion eliminated, to out (blocks, p).

    Z (6 m, p): what the spline does with them; block (n,): of each reading; others as in `normal`.
    """
    N, D, E, m = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((5, 3))
    J, Y, read = np.zeros((6, 39)), np.zeros((2, 3, 3)), np.zeros(6)
    S, total = np.zeros((3, 24)), np.zeros(24)
    for k in range(time.shape[0]):
        for triad in range(2):
            if not np.isfinite(left[k, 3 * triad]):
                continue
            at = (time[k] - (triad * x[45] if own >= 0 else 0.0) - first) / h
            q = math.floor(at)
            _weights(at - q, N, D, E)
            _motion(spline, q, h, N, D, E, m)
            if own >= 0:
                _slave(m, x, since[k], J, Y, read)
            _spread(x, own, triad, Y, N, D, h, S)
            # Rows weighted by what is left, added up before they are multiplied by Z.
            for a in range(24):
                total[a] = 0.0
                for i in range(3):
                    total[a] += S[i, a] * left[k, 3 * triad + i] / var[triad]
            if own >= 0:
                for i in range(3 * triad, 3 * triad + 3):
                    for c in range(39):
                        out[block[k], own + c] += J[i, c] * left[k, i] / var[triad]
            for a in range(24):
                if total[a] != 0.0:
                    for c in range(Z.shape[1]):
                        out[block[k], c] -= total[a] * Z[6 * q + a, c]
