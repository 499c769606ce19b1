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
def _weights(u, h, N, D, E):
    """Fill N, D, E (4): cubic B-spline weights at u in [0, 1], and derivatives by time, knots h."""
    v, one, two = 1.0 - u, 1.0 / h, 1.0 / (h * h)
    N[0], N[3] = v * v * v / 6.0, u * u * u / 6.0
    N[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    N[2] = 1.0 - N[0] - N[1] - N[3]
    D[0], D[3] = -0.5 * v * v * one, 0.5 * u * u * one
    D[1] = (1.5 * u * u - 2.0 * u) * one
    D[2] = -D[0] - D[1] - D[3]
    E[0], E[1], E[2], E[3] = v * two, (3.0 * u - 2.0) * two, (1.0 - 3.0 * u) * two, u * two


@part
def _motion(spline, k, N, D, E, out):
    """Fill out (5, 3): w, alpha, alpha', f, f' of a spline (n, 6) in the interval k."""
    for i in range(3):
        w, alpha, change, f, pull = 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(4):
            turn, force = spline[k + j, i], spline[k + j, 3 + i]
            w += N[j] * turn
            alpha += D[j] * turn
            change += E[j] * turn
            f += N[j] * force
            pull += D[j] * force
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i] = w, alpha, change, f, pull


@part
def _products(triad, x, P, F):
    """Fill P, F (3, 3): what rates and forces of the master do to gyros or accelerometers."""
    for i in range(3):
        for j in range(3):
            P[i, j], F[i, j] = 0.0, 0.0
            for n in range(3):
                if triad == 0:
                    P[i, j] += x[9 + 3 * i + n] * x[3 * n + j]
                F[i, j] += x[(18 if triad == 0 else 27) + 3 * i + n] * x[3 * n + j]


@part
def _slave(triad, m, x, P, F, since, A, B, S, out):
    """Fill A (3, 9), B (3, 7), S (3, 9), out (3): derivatives of gyros or accelerometers (triad 1).

    m (5, 3): motion; x (46): Q, K_g, G, K_a (9 each), r, b_g, b_a, late; P, F: of `_products`;
    since: time from the middle of the stamps. A by what all three hang on: rotation, r, offset,
    rate of the clocks, late; B by what one alone does: its bias, its row of K_g and of G, or of
    K_a; S by w, alpha and f. With y = f + Om r, rows are those of K (d x w_c), F dOm r and so on.
    """
    w0, w1, w2, a0, a1, a2 = m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2]
    r0, r1, r2 = x[36], x[37], x[38]
    wr, ww = w0 * r0 + w1 * r1 + w2 * r2, w0 * w0 + w1 * w1 + w2 * w2
    ra, wa = r0 * a0 + r1 * a1 + r2 * a2, w0 * a0 + w1 * a1 + w2 * a2
    y0 = m[3, 0] + a1 * r2 - a2 * r1 + w0 * wr - r0 * ww
    y1 = m[3, 1] + a2 * r0 - a0 * r2 + w1 * wr - r1 * ww
    y2 = m[3, 2] + a0 * r1 - a1 * r0 + w2 * wr - r2 * ww
    d0 = m[4, 0] + wr * a0 + w0 * ra - 2.0 * r0 * wa + m[2, 1] * r2 - m[2, 2] * r1
    d1 = m[4, 1] + wr * a1 + w1 * ra - 2.0 * r1 * wa + m[2, 2] * r0 - m[2, 0] * r2
    d2 = m[4, 2] + wr * a2 + w2 * ra - 2.0 * r2 * wa + m[2, 0] * r1 - m[2, 1] * r0
    u0, u1, u2 = (  # w_c and f_c
        x[0] * w0 + x[1] * w1 + x[2] * w2,
        x[3] * w0 + x[4] * w1 + x[5] * w2,
        x[6] * w0 + x[7] * w1 + x[8] * w2,
    )
    f0, f1, f2 = (
        x[0] * y0 + x[1] * y1 + x[2] * y2,
        x[3] * y0 + x[4] * y1 + x[5] * y2,
        x[6] * y0 + x[7] * y1 + x[8] * y2,
    )
    for i in range(3):
        k = (18 if triad == 0 else 27) + 3 * i
        s0, s1, s2 = x[k], x[k + 1], x[k + 2]
        F0, F1, F2, P0, P1, P2 = F[i, 0], F[i, 1], F[i, 2], P[i, 0], P[i, 1], P[i, 2]
        Fw, Fr = F0 * w0 + F1 * w1 + F2 * w2, F0 * r0 + F1 * r1 + F2 * r2
        Fd = F0 * d0 + F1 * d1 + F2 * d2
        out[i] = x[39 + 3 * triad + i] + P0 * w0 + P1 * w1 + P2 * w2 + F0 * y0 + F1 * y1 + F2 * y2
        A[i, 0] = f1 * s2 - f2 * s1
        A[i, 1] = f2 * s0 - f0 * s2
        A[i, 2] = f0 * s1 - f1 * s0
        A[i, 3] = F1 * a2 - F2 * a1 + Fw * w0 - ww * F0
        A[i, 4] = F2 * a0 - F0 * a2 + Fw * w1 - ww * F1
        A[i, 5] = F0 * a1 - F1 * a0 + Fw * w2 - ww * F2
        A[i, 6] = P0 * a0 + P1 * a1 + P2 * a2 + Fd
        A[i, 7] = since * A[i, 6]
        A[i, 8] = -Fd
        S[i, 0] = P0 + wr * F0 + Fw * r0 - 2.0 * Fr * w0
        S[i, 1] = P1 + wr * F1 + Fw * r1 - 2.0 * Fr * w1
        S[i, 2] = P2 + wr * F2 + Fw * r2 - 2.0 * Fr * w2
        S[i, 3], S[i, 4], S[i, 5] = r1 * F2 - r2 * F1, r2 * F0 - r0 * F2, r0 * F1 - r1 * F0
        S[i, 6], S[i, 7], S[i, 8] = F0, F1, F2
        B[i, 0] = 1.0
        if triad == 0:
            g0, g1, g2 = x[9 + 3 * i], x[10 + 3 * i], x[11 + 3 * i]
            A[i, 0] += u1 * g2 - u2 * g1
            A[i, 1] += u2 * g0 - u0 * g2
            A[i, 2] += u0 * g1 - u1 * g0
            B[i, 1], B[i, 2], B[i, 3] = u0, u1, u2
            B[i, 4], B[i, 5], B[i, 6] = f0, f1, f2
        else:
            B[i, 1], B[i, 2], B[i, 3] = f0, f1 if i > 0 else 0.0, f2 if i > 1 else 0.0


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
def _spread(S, N, D, one, out):
    """Fill out (24) by the four knots with one times a row S (9) by w, alpha and f."""
    for j in range(4):
        n, d = one * N[j], one * D[j]
        for c in range(3):
            out[6 * j + c] = n * S[c] + d * S[3 + c]
            out[6 * j + 3 + c] = n * S[6 + c]


@part
def _gather(R, width, shared, alone):
    """Add rows to the sums of their products, and empty them.

    R (3, 4, 41): four readings of each axis, by knots (24), by what all axes hang on, and the
    reading (10), by what one alone does (7, of which width are used). shared (34, 34): products of
    the first 34, lower half; alone (3, 7, 41): of the others with all, axis by axis.
    """
    for i in range(3):
        Q, T = R[i], alone[i]
        for a in range(34 + width):
            u, v, w, x = Q[0, a], Q[1, a], Q[2, a], Q[3, a]
            if u == 0.0 and v == 0.0 and w == 0.0 and x == 0.0:
                continue
            if a < 34:
                for b in range(a + 1):
                    shared[a, b] += u * Q[0, b] + v * Q[1, b] + w * Q[2, b] + x * Q[3, b]
            else:
                for b in range(a + 1):
                    T[a - 34, b] += u * Q[0, b] + v * Q[1, b] + w * Q[2, b] + x * Q[3, b]
        for k in range(4):
            for a in range(41):
                Q[k, a] = 0.0


@part
def _settle(q, own, number, shared, alone, band, border):
    """Add what an interval q holds of its knots to the normal equations, and empty that.

    number (31): columns of what all hang on, then of what one axis alone does; own negative: none.
    """
    for a in range(24):
        for b in range(a + 1):
            band[6 * q + b, a - b] += shared[a, b]
            shared[a, b] = 0.0
        border[6 * q + a, border.shape[1] - 1] += shared[33, a]
    if own >= 0:
        for c in range(31):
            if number[c] >= 0:
                for a in range(24):
                    s = shared[24 + c, a] if c < 10 else alone[(c - 10) // 7, (c - 10) % 7, a]
                    border[6 * q + a, own + number[c]] += s
    for c in range(10):
        for a in range(24):
            shared[24 + c, a] = 0.0
    for i in range(3):
        for c in range(7):
            for a in range(24):
                alone[i, c, a] = 0.0


@kernel
def normal(
    time, since, read, var, x, own, spline, other, first, h, band, border, corner, rhs, left
):
    """Add readings of one instrument to the normal equations.

    time, since (n,): clock of the master, and own time from the middle; read (n, 6); var (2,) of
    gyros and accelerometers; x (46,) its parameters, as `_slave`; own: first of its columns,
    negative: the master; spline (m, 6). other (m, 6) or (0, 6): columns are those there less those
    here. band (6 m, 24), border (6 m, p + 1), the gradient last, corner (p, p), rhs (p,) are added
    to, left (n, 6) is filled: readings less what they should be, NaN beyond the spline. Where p is
    0, parameters stand still.
    """
    N, D, E, m = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((5, 3))
    A, A2, B, B2 = np.zeros((3, 9)), np.zeros((3, 9)), np.zeros((3, 7)), np.zeros((3, 7))
    S, S2, out, out2 = np.zeros((3, 9)), np.zeros((3, 9)), np.zeros(3), np.zeros(3)
    P, F = np.zeros((3, 3)), np.zeros((3, 3))
    of_all, of_one, number = (
        np.zeros(9, np.int64),
        np.zeros((3, 7), np.int64),
        np.zeros(31, np.int64),
    )
    noise, to = other.shape[0] > 0, own if rhs.shape[0] > 0 else -1
    R = np.zeros((3, 4, 41))
    for triad in range(2):
        _columns(triad, of_all, of_one)
        _products(triad, x, P, F)
        # One by one: of slices Numba compiles how it would name their lengths, 2.5 s of strings.
        for i in range(9):
            number[i] = of_all[i]
        number[9] = -1
        for i in range(21):
            number[10 + i] = of_one[i // 7, i % 7]
        width = 0 if to < 0 else 7 if triad == 0 else 4
        shared, alone, now, held = np.zeros((34, 34)), np.zeros((3, 7, 41)), -1, 0
        root = 1.0 / math.sqrt(var[triad])
        for k in range(time.shape[0]):
            at = (time[k] - (triad * x[45] if own >= 0 else 0.0) - first) / h
            q = math.floor(at)
            for i in range(3 * triad, 3 * triad + 3):
                left[k, i] = np.nan
            if q < 0 or q > spline.shape[0] - 4:
                continue
            _weights(at - q, h, N, D, E)
            _motion(spline, q, N, D, E, m)
            if own < 0:  # its readings are the spline
                for i in range(3):
                    r = read[k, 3 * triad + i] - m[3 * triad, i]
                    left[k, 3 * triad + i] = r
                    if not np.isfinite(r):
                        continue
                    for j in range(4):
                        row, u = 6 * (q + j) + 3 * triad + i, N[j] / var[triad]
                        border[row, rhs.shape[0]] += u * r
                        for b in range(j + 1):
                            band[row - 6 * (j - b), 6 * (j - b)] += u * N[b]
                continue
            if q != now or held == 4:
                _gather(R, width, shared, alone)
                held = 0
                if q != now and now >= 0:
                    _settle(now, to, number, shared, alone, band, border)
                now = q
            _slave(triad, m, x, P, F, since[k], A, B, S, out)
            if noise:
                _motion(other, q, N, D, E, m)
                _slave(triad, m, x, P, F, since[k], A2, B2, S2, out2)
                for i in range(3):
                    for c in range(9):
                        A[i, c] = A2[i, c] - A[i, c]
                    for c in range(7):
                        B[i, c] = B2[i, c] - B[i, c]
            for i in range(3):
                r = read[k, 3 * triad + i] - out[i]
                left[k, 3 * triad + i] = r
                if not np.isfinite(r):
                    continue
                row = R[i, held]
                _spread(S[i], N, D, root, row)
                row[33] = root * r
                if to >= 0:
                    for c in range(9):
                        row[24 + c] = root * A[i, c]
                    for c in range(width):
                        row[34 + c] = root * B[i, c]
            held += 1
        if now < 0:
            continue
        _gather(R, width, shared, alone)
        _settle(now, to, number, shared, alone, band, border)
        if to < 0:
            continue
        for a in range(31):
            for b in range(a + 1):
                i, j = number[a], number[b]
                if a < 10:
                    s = shared[24 + a, 24 + b]
                elif b < 10:
                    s = alone[(a - 10) // 7, (a - 10) % 7, 24 + b]
                elif (a - 10) // 7 == (b - 10) // 7:
                    s = alone[(a - 10) // 7, (a - 10) % 7, 34 + (b - 10) % 7]
                else:
                    continue
                if a == 9 and j >= 0:
                    rhs[own + j] += s
                elif b == 9 and i >= 0:
                    rhs[own + i] += s
                elif i >= 0 and j >= 0:
                    corner[own + max(i, j), own + min(i, j)] += s


@kernel
def pulled(time, since, off, var, x, own, spline, first, h, border, rhs):
    """Add what readings that are off say, J' off / var, to border (6 m, c) and rhs (p, c).

    off (n, 6, c): by so much each time, NaN where nothing was read; others as in `normal`.
    """
    N, D, E, m = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((5, 3))
    A, B, S, out = np.zeros((3, 9)), np.zeros((3, 7)), np.zeros((3, 9)), np.zeros(3)
    P, F, row = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(24)
    of_all, of_one = np.zeros(9, np.int64), np.zeros((3, 7), np.int64)
    for triad in range(2):
        _columns(triad, of_all, of_one)
        _products(triad, x, P, F)
        for k in range(time.shape[0]):
            at = (time[k] - (triad * x[45] if own >= 0 else 0.0) - first) / h
            q = math.floor(at)
            if q < 0 or q > spline.shape[0] - 4:
                continue
            _weights(at - q, h, N, D, E)
            if own >= 0:
                _motion(spline, q, N, D, E, m)
                _slave(triad, m, x, P, F, since[k], A, B, S, out)
            else:  # its readings are the spline
                S[:] = 0.0
                for i in range(3):
                    S[i, 6 * triad + i] = 1.0
            for i in range(3):
                by, one = off[k, 3 * triad + i], 1.0 / var[triad]
                if not np.isfinite(by[0]):
                    continue
                _spread(S[i], N, D, one, row)
                for a in range(24):
                    if row[a] != 0.0:
                        for c in range(border.shape[1]):
                            border[6 * q + a, c] += row[a] * by[c]
                for n in range(16 if own >= 0 else 0):
                    j = of_all[n] if n < 9 else of_one[i, n - 9]
                    s = one * (A[i, n] if n < 9 else B[i, n - 9])
                    if j >= 0 and s != 0.0:
                        for c in range(border.shape[1]):
                            rhs[own + j, c] += s * by[c]
