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
def _slave(triad, m, x, since, D, B, Y, out, room):
    """Fill D (3, 9), B (3, 7), out (3): derivatives of a slave's gyros or accelerometers (triad 1).

    m (5, 3): motion; x (46): Q, K_g, G, K_a (9 each), r, b_g, b_a, late; since: time from the
    middle of the stamps. D by what all three hang on: rotation, r, offset, rate of the clocks,
    late; B by what one alone does: its bias, its row of K_g and of G, or of K_a. Y (2, 3, 3):
    derivatives of f_c by w and by alpha. room (6, 3, 3): to work in.
    """
    w, a, b, f, df = m[0], m[1], m[2], m[3], m[4]
    r = x[36:39]
    wr, ww = 0.0, 0.0
    for i in range(3):
        wr += w[i] * r[i]
        ww += w[i] * w[i]
    room[:] = 0.0
    W, A, T, R = room[0], room[1], room[2], room[3]
    y, dy, wc, fc, ac, dc = (room[4, 0], room[4, 1], room[4, 2], room[5, 0], room[5, 1], room[5, 2])
    A[0, 1], A[0, 2], A[1, 2] = r[2], -r[1], r[0]
    A[1, 0], A[2, 0], A[2, 1] = -r[2], r[1], -r[0]
    T[0, 1], T[0, 2], T[1, 2] = -a[2], a[1], -a[0]
    T[1, 0], T[2, 0], T[2, 1] = a[2], -a[1], a[0]
    for i in range(3):
        for j in range(3):
            W[i, j] = w[i] * r[j] - 2.0 * r[i] * w[j]
            T[i, j] += w[i] * w[j]
        W[i, i] += wr
        T[i, i] -= ww
    for i in range(3):
        y[i], dy[i] = f[i], df[i]
        for j in range(3):
            y[i] += T[i, j] * r[j]
            dy[i] += W[i, j] * a[j] + A[i, j] * b[j]
    Y[:] = 0.0
    for i in range(3):
        for j in range(3):
            q = x[3 * i + j]
            wc[i] += q * w[j]
            ac[i] += q * a[j]
            fc[i] += q * y[j]
            dc[i] += q * dy[j]
            for n in range(3):
                Y[0, i, n] += q * W[j, n]
                Y[1, i, n] += q * A[j, n]
                R[i, n] += q * T[j, n]
    D[:] = 0.0
    for i in range(3):
        out[i] = x[39 + 3 * triad + i]
        B[i, 0] = 1.0
        for j in range(3):
            g = x[9 + 3 * i + j] if triad == 0 else 0.0
            s = x[(18 if triad == 0 else 27) + 3 * i + j]
            out[i] += g * wc[j] + s * fc[j]
            p, q = (j + 1) % 3, (j + 2) % 3
            # d (e x v)_j = e_p v_q - e_q v_p
            D[i, p] += g * wc[q] + s * fc[q]
            D[i, q] -= g * wc[p] + s * fc[p]
            for n in range(3):
                D[i, 3 + n] += s * R[j, n]
            D[i, 6] += g * ac[j] + s * dc[j]
            D[i, 8] -= s * dc[j]
            B[i, 1 + j] = wc[j] if triad == 0 else fc[j] if j <= i else 0.0
            B[i, 4 + j] = fc[j]
        D[i, 7] = since * D[i, 6]


@part
def _columns(triad, of_all, of_one):
    """Fill of_all (9), of_one (3, 7) with the columns that `_slave` derives by; none: negative."""
    for c in range(8):
        of_all[c] = c
    of_all[8] = 29 if triad == 1 else -1
    of_one[:] = -1
    for i in range(3):
        of_one[i, 0] = 8 + 3 * triad + i
        for j in range(3):
            if triad == 0:
                of_one[i, 1 + j], of_one[i, 4 + j] = 14 + 3 * i + j, 30 + 3 * i + j
            elif j <= i:
                of_one[i, 1 + j] = 23 + i * (i + 1) // 2 + j


@part
def _spread(x, own, triad, Y, N, D, h, S):
    """Fill S (3, 24): derivatives of gyros (triad 0) or accelerometers by the four knots."""
    S[:] = 0.0
    if own < 0:
        for j in range(4):
            for i in range(3):
                S[i, 6 * j + 3 * triad + i] = N[j]
        return
    for i in range(3):
        for c in range(3):
            by_w, by_alpha, by_f = 0.0, 0.0, 0.0
            for n in range(3):
                s, q = x[(18 if triad == 0 else 27) + 3 * i + n], x[3 * n + c]
                by_w += s * Y[0, n, c] + (x[9 + 3 * i + n] * q if triad == 0 else 0.0)
                by_alpha += s * Y[1, n, c]
                by_f += s * q
            for j in range(4):
                S[i, 6 * j + c] = N[j] * by_w + D[j] / h * by_alpha
                S[i, 6 * j + 3 + c] = N[j] * by_f


@part
def _gather(S, A, B, one, own, width, here, cross, total):
    """Add three rows of weight one: S (3, 24) by knots, A (3, 10) and B (3, 7) by parameters.

    A: what all hang on, and the readings; width: used of B. cross (24, 24): knots by knots, here
    (24, 31): by A and, row after row, by B; total (31, 31): A and B by themselves.
    """
    for a in range(24):
        u, v, w = one * S[0, a], one * S[1, a], one * S[2, a]
        if u == 0.0 and v == 0.0 and w == 0.0:
            continue
        for b in range(a + 1):
            cross[a, b] += u * S[0, b] + v * S[1, b] + w * S[2, b]
        if own < 0:
            here[a, 9] += u * A[0, 9] + v * A[1, 9] + w * A[2, 9]
            continue
        for c in range(10):
            here[a, c] += u * A[0, c] + v * A[1, c] + w * A[2, c]
        for c in range(width):
            here[a, 10 + c] += u * B[0, c]
            here[a, 17 + c] += v * B[1, c]
            here[a, 24 + c] += w * B[2, c]
    if own < 0:
        return
    for a in range(10):
        u, v, w = one * A[0, a], one * A[1, a], one * A[2, a]
        for b in range(a + 1):
            total[a, b] += u * A[0, b] + v * A[1, b] + w * A[2, b]
        for c in range(width):
            total[10 + c, a] += u * B[0, c]
            total[17 + c, a] += v * B[1, c]
            total[24 + c, a] += w * B[2, c]
    for i in range(3):
        for a in range(width):
            for b in range(a + 1):
                total[10 + 7 * i + a, 10 + 7 * i + b] += one * B[i, a] * B[i, b]


@part
def _settle(q, own, number, here, cross, band, border, grad):
    """Add what an interval q holds to the normal equations, and empty it; number (31): columns."""
    for a in range(24):
        for b in range(a + 1):
            band[6 * q + b, a - b] += cross[a, b]
        if own >= 0:
            for c in range(31):
                if number[c] >= 0:
                    border[6 * q + a, own + number[c]] += here[a, c]
        grad[6 * q + a] += here[a, 9]
    here[:] = 0.0
    cross[:] = 0.0


@kernel
def normal(time, since, read, var, x, own, spline, other, first, h, band, border, corner, grad, rhs,
           left):  # fmt: skip
    """Add readings of one instrument to the normal equations.

    time, since (n,): clock of the master, and own time from the middle; read (n, 6); var (2,) of
    gyros and accelerometers; x (46,) its parameters, as `_slave`; own: first of its columns,
    negative: the master; spline (m, 6). other (m, 6) or (0, 6): columns are those there less those
    here. band (6 m, 24), border (6 m, p), corner (p, p), grad (6 m,), rhs (p,) are added to,
    left (n, 6) is filled: readings less what they should be, NaN beyond the spline. Without a
    column of border, parameters stand still.
    """
    N, D, E, m = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((5, 3))
    A, A2, Y, Y2 = np.zeros((3, 10)), np.zeros((3, 10)), np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    B, B2, out, out2 = np.zeros((3, 7)), np.zeros((3, 7)), np.zeros(3), np.zeros(3)
    room = np.zeros((6, 3, 3))
    S, here, cross = np.zeros((3, 24)), np.zeros((24, 31)), np.zeros((24, 24))
    of_all, of_one, number = (
        np.zeros(9, np.int64),
        np.zeros((3, 7), np.int64),
        np.zeros(31, np.int64),
    )
    noise, to = other.shape[0] > 0, own if border.shape[1] > 0 else -1
    for triad in range(2):
        _columns(triad, of_all, of_one)
        number[:9], number[9] = of_all, -1
        number[10:] = of_one.ravel()
        width = 7 if triad == 0 else 4
        total, now = np.zeros((31, 31)), -1
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
                    out[i] = m[3 * triad, i]
            else:
                _slave(triad, m, x, since[k], A, B, Y, out, room)
            _spread(x, own, triad, Y, N, D, h, S)
            if noise and own >= 0:
                _motion(other, q, h, N, D, E, m)
                _slave(triad, m, x, since[k], A2, B2, Y2, out2, room)
                for i in range(3):
                    for c in range(9):
                        A[i, c] = A2[i, c] - A[i, c]
                    for c in range(7):
                        B[i, c] = B2[i, c] - B[i, c]
            for i in range(3):
                r = read[k, 3 * triad + i] - out[i]
                left[k, 3 * triad + i] = r
                A[i, 9] = r
                if not np.isfinite(r):
                    A[i], B[i], S[i] = 0.0, 0.0, 0.0
            if q != now:
                if now >= 0:
                    _settle(now, to, number, here, cross, band, border, grad)
                now = q
            _gather(S, A, B, 1.0 / var[triad], to, width, here, cross, total)
        if now >= 0:
            _settle(now, to, number, here, cross, band, border, grad)
        if to < 0:
            continue
        for a in range(31):
            for b in range(a + 1):
                s, i, j = total[a, b], number[a], number[b]
                if a == 9 and j >= 0:
                    rhs[own + j] += s
                elif b == 9 and i >= 0:
                    rhs[own + i] += s
                elif i >= 0 and j >= 0:
                    corner[own + max(i, j), own + min(i, j)] += s


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
    A, B, Y, read = np.zeros((3, 10)), np.zeros((3, 7)), np.zeros((2, 3, 3)), np.zeros(3)
    room = np.zeros((6, 3, 3))
    S, total = np.zeros((3, 24)), np.zeros(24)
    of_all, of_one = np.zeros(9, np.int64), np.zeros((3, 7), np.int64)
    for triad in range(2):
        _columns(triad, of_all, of_one)
        for k in range(time.shape[0]):
            if not np.isfinite(left[k, 3 * triad]):
                continue
            at = (time[k] - (triad * x[45] if own >= 0 else 0.0) - first) / h
            q = math.floor(at)
            _weights(at - q, N, D, E)
            _motion(spline, q, h, N, D, E, m)
            if own >= 0:
                _slave(triad, m, x, since[k], A, B, Y, read, room)
            _spread(x, own, triad, Y, N, D, h, S)
            # Rows weighted by what is left, added up before they are multiplied by Z.
            for a in range(24):
                total[a] = 0.0
                for i in range(3):
                    total[a] += S[i, a] * left[k, 3 * triad + i] / var[triad]
            if own >= 0:
                for i in range(3):
                    weighed = left[k, 3 * triad + i] / var[triad]
                    for c in range(9):
                        if of_all[c] >= 0:
                            out[block[k], own + of_all[c]] += A[i, c] * weighed
                    for c in range(7):
                        if of_one[i, c] >= 0:
                            out[block[k], own + of_one[i, c]] += B[i, c] * weighed
            for a in range(24):
                if total[a] != 0.0:
                    for c in range(Z.shape[1]):
                        out[block[k], c] -= total[a] * Z[6 * q + a, c]
