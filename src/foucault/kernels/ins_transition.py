"""What a strapdown navigator's errors become over one interval: inputs, compensation, transition.

The equations are those of `kernels.ins_filter`, whose loop the parts here are compiled into.
"""

from foucault.kernels import inlined, part

HALF, WIDE = 64, 128
"""Columns of the transition: from 0 on those that have a share in psi, from HALF on the others."""

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
    """Fill C (3, 3) with C_lb half way between the quaternion q and that of the state x."""
    a, b, c, d = q0 + x[0], q1 + x[1], q2 + x[2], q3 + x[3]
    unit = 1.0 / (a * a + b * b + c * c + d * d)
    twice = 2.0 * unit
    C[0, 0] = (a * a + b * b - c * c - d * d) * unit
    C[1, 1] = (a * a - b * b + c * c - d * d) * unit
    C[2, 2] = (a * a - b * b - c * c + d * d) * unit
    C[0, 1] = (b * c - a * d) * twice
    C[1, 0] = (b * c + a * d) * twice
    C[0, 2] = (b * d + a * c) * twice
    C[2, 0] = (b * d - a * c) * twice
    C[1, 2] = (c * d - a * b) * twice
    C[2, 1] = (c * d + a * b) * twice


@inlined
def excite(Phi, s, dt, turning, others, place, entry, weight):
    """Fill rows 9 to 11 of Phi: what the coefficients add to the readings of each axis in dt."""
    for a in range(9, 12):
        for j in range(turning):
            Phi[a * WIDE + j] = 0.0
        for j in range(others):
            Phi[a * WIDE + HALF + j] = 0.0
    for t in range(place.size):
        Phi[place[t]] += weight[t] * s[entry[t]] * dt


@inlined
def carry(Phi, turning, others, C, dt, mid):
    """Carry the transition Phi, 9 rows and 3 of `excite`, over one interval.

    The first `turning` columns have a share in psi, the `others` from HALF on have none. All rows
    are in one array and WIDE apart, a number known when this is compiled: only so does the
    processor take several columns at once.
    """
    i0, i1, i2 = dt * mid[3], dt * mid[4], dt * mid[5]
    e0, e1 = dt * mid[6], dt * mid[7]
    w0, w1 = i0 + e0, i1 + e1
    o0, o1, o2 = i0 + w0, i1 + w1, 2.0 * i2
    a0, a1, a2 = mid[0], mid[1], mid[2]
    pull = dt * mid[8] * mid[9]
    half = 0.5 * dt
    C00, C01, C02 = C[0, 0], C[0, 1], C[0, 2]
    C10, C11, C12 = C[1, 0], C[1, 1], C[1, 2]
    C20, C21, C22 = C[2, 0], C[2, 1], C[2, 2]
    for j in range(turning):
        x0, x1, x2 = Phi[9 * WIDE + j], Phi[10 * WIDE + j], Phi[11 * WIDE + j]
        p0, p1, p2 = Phi[j], Phi[WIDE + j], Phi[2 * WIDE + j]
        v0, v1, v2 = Phi[3 * WIDE + j], Phi[4 * WIDE + j], Phi[5 * WIDE + j]
        r0, r1, r2 = Phi[6 * WIDE + j], Phi[7 * WIDE + j], Phi[8 * WIDE + j]
        d0 = 0.5 * (C00 * x0 + C01 * x1 + C02 * x2 + w1 * p2 - i2 * p1)
        d1 = 0.5 * (C10 * x0 + C11 * x1 + C12 * x2 + i2 * p0 - w0 * p2)
        d2 = 0.5 * (C20 * x0 + C21 * x1 + C22 * x2 + w0 * p1 - w1 * p0)
        m0, m1, m2 = p0 - d0, p1 - d1, p2 - d2  # psi at the middle pulls at the velocity
        n0 = v0 - o1 * v2 + o2 * v1 - pull * r0 + a1 * m2 - a2 * m1
        n1 = v1 - o2 * v0 + o0 * v2 - pull * r1 + a2 * m0 - a0 * m2
        n2 = v2 - o0 * v1 + o1 * v0 + 2.0 * pull * r2 + a0 * m1 - a1 * m0
        Phi[j] = m0 - d0
        Phi[WIDE + j] = m1 - d1
        Phi[2 * WIDE + j] = m2 - d2
        Phi[3 * WIDE + j] = n0
        Phi[4 * WIDE + j] = n1
        Phi[5 * WIDE + j] = n2
        Phi[6 * WIDE + j] = r0 + half * (v0 + n0) - e1 * r2
        Phi[7 * WIDE + j] = r1 + half * (v1 + n1) + e0 * r2
        Phi[8 * WIDE + j] = r2 + half * (v2 + n2) - e0 * r1 + e1 * r0
    for k in range(others):
        j = HALF + k
        x0, x1, x2 = Phi[9 * WIDE + j], Phi[10 * WIDE + j], Phi[11 * WIDE + j]
        v0, v1, v2 = Phi[3 * WIDE + j], Phi[4 * WIDE + j], Phi[5 * WIDE + j]
        r0, r1, r2 = Phi[6 * WIDE + j], Phi[7 * WIDE + j], Phi[8 * WIDE + j]
        n0 = v0 - o1 * v2 + o2 * v1 - pull * r0 + C00 * x0 + C01 * x1 + C02 * x2
        n1 = v1 - o2 * v0 + o0 * v2 - pull * r1 + C10 * x0 + C11 * x1 + C12 * x2
        n2 = v2 - o0 * v1 + o1 * v0 + 2.0 * pull * r2 + C20 * x0 + C21 * x1 + C22 * x2
        Phi[3 * WIDE + j] = n0
        Phi[4 * WIDE + j] = n1
        Phi[5 * WIDE + j] = n2
        Phi[6 * WIDE + j] = r0 + half * (v0 + n0) - e1 * r2
        Phi[7 * WIDE + j] = r1 + half * (v1 + n1) + e0 * r2
        Phi[8 * WIDE + j] = r2 + half * (v2 + n2) - e0 * r1 + e1 * r0


@part
def places(slot, gyros):
    """Fill slot (n,) with the column of each state: psi and gyro coefficients, and from HALF on."""
    for j in range(slot.size):
        if j < 3:
            slot[j] = j
        elif j < 9:
            slot[j] = HALF + j - 3
        elif j < 9 + gyros:
            slot[j] = j - 6
        else:
            slot[j] = HALF + j - 3 - gyros


@part
def begin(wide, slot):
    """Make the transition the identity on the nine first states, zero on the others."""
    for k in range(9 * WIDE):
        wide[k] = 0.0
    for j in range(9):
        wide[j * WIDE + slot[j]] = 1.0


@part
def hold(wide, slot, c0, v0, v1):
    """Let an error of height stay; the vertical velocity errs only as the tilt of l makes it."""
    for j in range(WIDE):
        wide[5 * WIDE + j] = -c0 * (v0 * wide[6 * WIDE + j] + v1 * wide[7 * WIDE + j])
        wide[8 * WIDE + j] = 0.0
    wide[8 * WIDE + slot[8]] = 1.0


@part
def gather(wide, slot, Phi):
    """Fill Phi (9, n) with the columns in the order of the states."""
    for j in range(slot.size):
        for r in range(9):
            Phi[r, j] = wide[r * WIDE + slot[j]]
