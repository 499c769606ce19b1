"""What a strapdown navigator's errors become over one interval: inputs, compensation, transition.

The equations are those of `kernels.ins_filter`, whose loop the parts here are compiled into.
"""

from foucault.kernels import inlined, part, summed
from foucault.kernels.strapdown import step

ROWS = 32
"""So many rows are gone through at a time, forward and backward."""

INPUTS = 50
"""Inputs of the terms: 1; w; f; q(f); |w|; w^3; |f|; f_k w_j at 22 + 3 k + j; see `sense`."""


@inlined
def sense(w, s, most):
    """Fill s (INPUTS,) from w (6,) rate and specific force; those above `most` are left.

    The inputs: 1, w (3), f (3), the six products of f as in `models.imu`, |w|, w^3, |f|, f_k w_j,
    the six products of w, and, of `changes`, the derivatives of w and f, and the time r, by which
    r w and r f follow.
    """
    s[0] = 1.0
    for c in range(6):
        s[1 + c] = w[c]
    if most > 6:
        s[7], s[8], s[9] = w[3] * w[3], w[4] * w[4], w[5] * w[5]
        s[10], s[11], s[12] = w[3] * w[4], w[3] * w[5], w[4] * w[5]
    if most > 12:
        for c in range(3):
            s[13 + c] = abs(w[c])
            s[16 + c] = w[c] * w[c] * w[c]
            s[19 + c] = abs(w[3 + c])
    if most > 21:
        for k in range(3):
            for j in range(3):
                s[22 + 3 * k + j] = w[3 + k] * w[j]
    if most > 30:
        s[31], s[32], s[33] = w[0] * w[0], w[1] * w[1], w[2] * w[2]
        s[34], s[35], s[36] = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    if most > 43:
        for c in range(6):
            s[44 + c] = s[43] * w[c]


@inlined
def changes(dtheta, dvel, dt, left, right, i, age, total, s):
    """Fill s[37:43] with the derivatives of rate and specific force, as measured, at row i.

    s[43] is the time of its middle, -1/2 at the start and 1/2 at the end; age: at its start [s].
    """
    s[43] = (age + 0.5 * dt[i]) / total - 0.5
    before, after = i - (left[i] != 0.0), i + (right[i] != 0.0)
    apart = 0.5 * (dt[before] + dt[after]) + (dt[i] if after - before == 2 else 0.0)
    for c in range(3):
        if after == before:
            s[37 + c] = s[40 + c] = 0.0
        else:
            s[37 + c] = (dtheta[after, c] / dt[after] - dtheta[before, c] / dt[before]) / apart
            s[40 + c] = (dvel[after, c] / dt[after] - dvel[before, c] / dt[before]) / apart


@part
def inputs_used(entry, used, which):
    """Fill used with the inputs of the terms, each once, and which (t,) with their place there.

    Returns how many they are.
    """
    many = 0
    for t in range(entry.size):
        which[t] = many
        for k in range(many):
            if used[k] == entry[t]:
                which[t] = k
        if which[t] == many:
            used[many] = entry[t]
            many += 1
    return many


@part
def errors_of(coefficient, axis, weight, which, estimate, matrix):
    """Fill matrix (inputs used, 6): what one of each input adds to the readings."""
    for k in range(matrix.shape[0]):
        for a in range(6):
            matrix[k, a] = 0.0
    for t in range(axis.size):
        matrix[which[t], axis[t]] += weight[t] * estimate[coefficient[t]]


@inlined
def compensated(raw_angle, raw_velocity, dt, used, matrix, most, w, s, u):
    """Fill u (6,) with increments free of the errors of `errors_of`; s with the inputs.

    The model gives readings for what is true; it is turned round by repeating it.
    """
    rate = 1.0 / dt
    r0, r1, r2 = raw_angle[0] * rate, raw_angle[1] * rate, raw_angle[2] * rate
    r3, r4, r5 = raw_velocity[0] * rate, raw_velocity[1] * rate, raw_velocity[2] * rate
    w[0], w[1], w[2], w[3], w[4], w[5] = r0, r1, r2, r3, r4, r5
    if used.size > 0:
        for _ in range(2):
            sense(w, s, most)
            e0 = e1 = e2 = e3 = e4 = e5 = 0.0
            for k in range(used.size):
                x = s[used[k]]
                e0 += matrix[k, 0] * x
                e1 += matrix[k, 1] * x
                e2 += matrix[k, 2] * x
                e3 += matrix[k, 3] * x
                e4 += matrix[k, 4] * x
                e5 += matrix[k, 5] * x
            w[0], w[1], w[2] = r0 - e0, r1 - e1, r2 - e2
            w[3], w[4], w[5] = r3 - e3, r4 - e4, r5 - e5
    for c in range(6):
        u[c] = w[c] * dt


@inlined
def middle(q0, q1, q2, q3, x, C):
    """Fill C[12:21] with C_lb, row by row, half way between the quaternion q and that of x."""
    a, b, c, d = q0 + x[0], q1 + x[1], q2 + x[2], q3 + x[3]
    unit = 1.0 / (a * a + b * b + c * c + d * d)
    twice = 2.0 * unit
    C[12] = (a * a + b * b - c * c - d * d) * unit
    C[16] = (a * a - b * b + c * c - d * d) * unit
    C[20] = (a * a - b * b - c * c + d * d) * unit
    C[13] = (b * c - a * d) * twice
    C[15] = (b * c + a * d) * twice
    C[14] = (b * d + a * c) * twice
    C[18] = (b * d - a * c) * twice
    C[17] = (c * d - a * b) * twice
    C[19] = (c * d + a * b) * twice


@summed
def carry_back(L, D, k, dt, mid, many):
    """Carry L over interval k backward, and fill D[k] with what the readings of it do to the end.

    L[16 j + r] is what error j does to error r at the end, after the interval on entry and before
    it on return: 16, a number known when this is compiled, since only so does the processor take
    several r at once. D[k, 9 a + r] is what one of axis a, gyros 0 to 2 and then accelerometers,
    does to it. dt, mid as of `advance`; many: 9, which known here would be unrolled.

    Forward, with x the error of the readings of the interval, the equations of the module are::

        d = (C x_g + w x psi) / 2    m = psi - d    n = dv - o x dv + a x m + C x_a + G dr
        psi <- m - d    dv <- n    dr <- dr + dt (dv + n) / 2 - e x dr
    """
    i0, i1, i2 = dt * mid[k, 3], dt * mid[k, 4], dt * mid[k, 5]
    e0, e1 = dt * mid[k, 6], dt * mid[k, 7]
    w0, w1 = i0 + e0, i1 + e1
    o0, o1, o2 = i0 + w0, i1 + w1, 2.0 * i2
    a0, a1, a2 = mid[k, 0], mid[k, 1], mid[k, 2]
    pull = dt * mid[k, 8] * mid[k, 9]
    half = 0.5 * dt
    C0, C1, C2 = mid[k, 12], mid[k, 13], mid[k, 14]
    C3, C4, C5 = mid[k, 15], mid[k, 16], mid[k, 17]
    C6, C7, C8 = mid[k, 18], mid[k, 19], mid[k, 20]
    for r in range(many):
        p0, p1, p2 = L[r], L[16 + r], L[32 + r]
        r0, r1, r2 = L[96 + r], L[112 + r], L[128 + r]
        h0, h1, h2 = half * r0, half * r1, half * r2
        n0, n1, n2 = L[48 + r] + h0, L[64 + r] + h1, L[80 + r] + h2
        m0 = p0 + a2 * n1 - a1 * n2
        m1 = p1 + a0 * n2 - a2 * n0
        m2 = p2 + a1 * n0 - a0 * n1
        d0, d1, d2 = -0.5 * (p0 + m0), -0.5 * (p1 + m1), -0.5 * (p2 + m2)
        L[r] = m0 + i2 * d1 - w1 * d2
        L[16 + r] = m1 + w0 * d2 - i2 * d0
        L[32 + r] = m2 + w1 * d0 - w0 * d1
        L[48 + r] = n0 + h0 - o2 * n1 + o1 * n2
        L[64 + r] = n1 + h1 + o2 * n0 - o0 * n2
        L[80 + r] = n2 + h2 - o1 * n0 + o0 * n1
        L[96 + r] = r0 - pull * n0 + e1 * r2
        L[112 + r] = r1 - pull * n1 - e0 * r2
        L[128 + r] = r2 + 2.0 * pull * n2 - e1 * r0 + e0 * r1
        D[k, r] = C0 * d0 + C3 * d1 + C6 * d2
        D[k, 9 + r] = C1 * d0 + C4 * d1 + C7 * d2
        D[k, 18 + r] = C2 * d0 + C5 * d1 + C8 * d2
        D[k, 27 + r] = C0 * n0 + C3 * n1 + C6 * n2
        D[k, 36 + r] = C1 * n0 + C4 * n1 + C7 * n2
        D[k, 45 + r] = C2 * n0 + C5 * n1 + C8 * n2


@part
def held_back(L, k, mid, many):
    """Let an error of height stay over interval k, and that of vertical velocity follow the tilt.

    Before `carry_back`, with what the error of height does to the end kept for after it.
    """
    c0, v0, v1 = mid[k, 9], mid[k, 10], mid[k, 11]
    for r in range(many):
        L[96 + r] -= c0 * v0 * L[80 + r]
        L[112 + r] -= c0 * v1 * L[80 + r]
        L[144 + r] = L[128 + r]
        L[80 + r] = L[128 + r] = 0.0


@summed
def gathered(felt, D, many, total):
    """Fill total (c, .) with the sum of ``felt[k, c] D[k]`` over the rows 1 to `many`.

    Four at a time: three rows more of felt have to be zero.
    """
    for c in range(total.shape[0]):
        for j in range(total.shape[1]):
            total[c, j] = 0.0
        for k in range(1, many + 1, 4):
            s0, s1, s2, s3 = felt[k, c], felt[k + 1, c], felt[k + 2, c], felt[k + 3, c]
            for j in range(total.shape[1]):
                total[c, j] += s0 * D[k, j] + s1 * D[k + 1, j] + s2 * D[k + 2, j] + s3 * D[k + 3, j]


@summed
def joined(L, M, Phi, fresh):
    """Carry the transition Phi (9 or more, n) on by L of `carry_back`; M (9, n) is scratch.

    fresh: nothing came before.
    """
    for r in range(M.shape[0]):
        for j in range(M.shape[1]):
            M[r, j] = L[16 * j + r] if fresh and j < 9 else 0.0
        for i in range(0 if fresh else 9):
            for j in range(M.shape[1]):
                M[r, j] += L[16 * i + r] * Phi[i, j]
    for r in range(M.shape[0]):
        for j in range(M.shape[1]):
            Phi[r, j] = M[r, j]


@part
def advance(
    dtheta, dvel, dt, left, right, begin, end, age, total, coefficient, axis, weight, which, used,
    most, matrix, g_offset, held, x, u, w, s, felt, bend, mid, D, L, sums, M, Phi,
):  # fmt: skip
    """Carry the state x (12,) over the rows begin to end, and fill Phi with the transition.

    Parameters: dtheta, dvel (n, 3), dt, left, right (n,) as `strapdown`; age [s] at the start of
    row begin, of total; the terms; used, which of `inputs_used`, matrix of `errors_of`; Phi (9 or
    more, n). The rest is scratch: u (ROWS + 2, 6), whose first row is the increment
    before `begin`, and on return for the next call; w (6,), s (INPUTS,), felt (ROWS + 5, used),
    bend (6,); mid (ROWS + 1, 21): velocity increment of the specific force in l (3), w_ie (3), w_el
    (2), gravity, c0, level velocity (2), C_lb; D (ROWS + 5, 56) of zeros, L (153,), sums (used,
    56), M (9, n). Returns how long it takes [s].

    What the readings do is found backward, by axis and input, for all coefficients at once.
    """
    T, many = 0.0, M.shape[0]
    for start in range(begin, max(begin, end) + 1, ROWS):
        rows = min(ROWS, end + 1 - start)
        time = age + T
        for k in range(1, rows + 2):
            j = start + k - 1
            if j < dt.size:
                if most > 36:
                    changes(dtheta, dvel, dt, left, right, j, time, total, s)
                time += dt[j]
                compensated(dtheta[j], dvel[j], dt[j], used, matrix, most, w, s, u[k])
                for c in range(used.size):
                    felt[k, c] = s[used[c]] * dt[j]
        for k in range(rows + 1, rows + 4):
            for c in range(used.size):
                felt[k, c] = 0.0
        for k in range(1, rows + 1):
            i = start + k - 1
            for c in range(6):
                bend[c] = left[i] * u[k - 1, c] if left[i] != 0.0 else 0.0
                bend[c] += right[i] * u[k + 1, c] if right[i] != 0.0 else 0.0
            q0, q1, q2, q3 = x[0], x[1], x[2], x[3]
            step(x, u[k], bend, dt[i], g_offset, held, mid[k])
            mid[k, 10], mid[k, 11] = x[4], x[5]
            middle(q0, q1, q2, q3, x, mid[k])
            T += dt[i]
        for j in range(many):
            for r in range(many):
                L[16 * j + r] = 1.0 if j == r else 0.0
        for k in range(rows, 0, -1):
            if held:
                held_back(L, k, mid, many)
            carry_back(L, D, k, dt[start + k - 1], mid, many)
            for r in range(many if held else 0):
                L[128 + r] += L[144 + r]
        gathered(felt, D, rows, sums)
        joined(L, M, Phi, start == begin)
        for t in range(axis.size):
            to, by, row, at = 9 + coefficient[t], weight[t], which[t], 9 * axis[t]
            for r in range(many):
                Phi[r, to] += by * sums[row, at + r]
        for c in range(6):
            u[0, c] = u[rows, c]
    return T
