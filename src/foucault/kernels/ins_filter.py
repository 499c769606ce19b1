"""The error-state filter of a strapdown navigator: navigate, carry the covariance, correct.

Errors are those of `models.ins_errors`: attitude psi, velocity dv and position dr in the level
frame l of the computed position, estimate minus truth but for psi (``C_est = (I - psi x) C``), and
what is left of each sensor coefficient (true minus estimated). Over one interval of dt with the
velocity increment a of the specific force::

    psi' = -w_il x psi - C u_g            dv' = a/dt x psi - (2 w_ie + w_el) x dv + C u_a + G dr
    dr'  = dv - w_el x dr                 G = (g / R) diag(-1, -1, 2)

where u_g, u_a are the columns of the terms below. The transition of the nine first is added up
sample by sample, so that a coefficient is seen through the motion as it was; the covariance is
carried from one epoch to the next. All errors found are fed back at once.

A term says that coefficient `coefficient[t]` adds ``weight[t] * s[input[t]]`` to sensor axis
`axis[t]` (gyros 0 to 2, accelerometers 3 to 5), s being the inputs of `sense`.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel, part
from foucault.kernels.ins_transition import (
    INPUTS,
    ROWS,
    advance,
    changes,
    compensated,
    errors_of,
    inputs_used,
)
from foucault.kernels.strapdown import curvature, product, rotation, transport


@inlined
def axis_of_earth(x):
    """Return the Earth's axis in l of the state x."""
    r0, r1, r2, r3 = x[7], x[8], x[9], x[10]
    return (
        2.0 * (r1 * r3 - r0 * r2),
        2.0 * (r2 * r3 + r0 * r1),
        r0 * r0 - r1 * r1 - r2 * r2 + r3 * r3,
    )


@part
def shift(x, c0, c1, px, py, d):
    """Move the state x by d (3,) in l: the frame turns with it, the attitude in space stays."""
    t0, t1 = transport(c0, c1, px, py, d[0], d[1])
    a, b, c, e = rotation(t0, t1, 0.0)
    x[7], x[8], x[9], x[10] = product(x[7], x[8], x[9], x[10], a, b, c, e)
    x[0], x[1], x[2], x[3] = product(a, -b, -c, -e, x[0], x[1], x[2], x[3])
    v0, v1, v2 = x[4], x[5], x[6]
    x[4] = v0 - t1 * v2
    x[5] = v1 + t0 * v2
    x[6] = v2 - t0 * v1 + t1 * v0
    x[11] += d[2]


@part
def propagate(P, Phi, M, keep, q, T, n):
    """Carry P (n, n) over T: half the noise before, half after; M (9, n) is scratch.

    keep (n - 9,) is what is left of each coefficient, q (n,) white noise of each error.
    """
    sure = True  # a run that is only navigated: nothing to carry
    for j in range(n):
        sure = sure and P[j, j] == 0.0 and q[j] == 0.0
    if sure:
        return
    for j in range(n):
        P[j, j] += 0.5 * T * q[j]
    for r in range(Phi.shape[0]):
        for j in range(n):
            M[r, j] = 0.0
        for i in range(n):
            c = Phi[r, i]
            if c != 0.0:
                for j in range(n):
                    M[r, j] += c * P[i, j]
    for r in range(Phi.shape[0]):
        for k in range(r + 1):  # what is not symmetric, no measurement would take away again
            c = 0.0
            for j in range(n):
                c += M[r, j] * Phi[k, j]
            P[r, k] = P[k, r] = c
        for j in range(9, n):
            P[r, j] = M[r, j] * keep[j - 9]
            P[j, r] = P[r, j]
    for i in range(9, n):
        for j in range(9, n):
            P[i, j] *= keep[i - 9] * keep[j - 9]
    for j in range(n):
        P[j, j] += 0.5 * T * q[j]


@part
def differences(x, reference, c0, c1, px, py, pz, z):
    """Fill z (6,): computed minus reference velocity and position, in l.

    reference (8,): velocity east, north, up; the normal of the ellipsoid in e; the height; above 0
    where the place is known. Else the axes of the velocity are those of the computed place: right
    to (reference velocity) x (position error) tan L / R.
    """
    # C_le n, the normal there seen here: (0, 0, 1) where both are one.
    a, b, c, d = x[7], -x[8], -x[9], -x[10]
    n0, n1, n2 = reference[3], reference[4], reference[5]
    y0 = 2.0 * (c * n2 - d * n1)
    y1 = 2.0 * (d * n0 - b * n2)
    y2 = 2.0 * (b * n1 - c * n0)
    n0 += a * y0 + c * y2 - d * y1
    n1 += a * y1 + d * y0 - b * y2
    n2 += a * y2 + b * y1 - c * y0
    # Arcs along and across the meridian: R = N + h, and M + h along (px, py).
    big = 1.0 / c0
    shrink = -c1 / (c0 * (c0 + c1 * (px * px + py * py)))
    along = shrink * (n0 * px + n1 * py)
    z[3] = -big * n0 - along * px
    z[4] = -big * n1 - along * py
    z[5] = x[11] - reference[6]
    if not reference[7] > 0.0:
        n0, n1, n2 = 0.0, 0.0, 1.0
    # North is what of the Earth's axis is level, over cos L.
    up = px * n0 + py * n1 + pz * n2
    p0, p1, p2 = px - up * n0, py - up * n1, pz - up * n2
    level = p0 * p0 + p1 * p1 + p2 * p2
    v0, v1, v2 = reference[0], reference[1], reference[2]
    unit = 1.0 / math.sqrt(level) if level > 0.0 else 0.0
    v0, v1 = v0 * unit, v1 * unit
    z[0] = x[4] - v0 * (p1 * n2 - p2 * n1) - v1 * p0 - v2 * n0
    z[1] = x[5] - v0 * (p2 * n0 - p0 * n2) - v1 * p1 - v2 * n1
    z[2] = x[6] - v0 * (p0 * n1 - p1 * n0) - v1 * p2 - v2 * n2


@part
def update(P, X, K, n, row, z, R, gate):
    """Take in one measurement ``z = X[row]`` of variance R; X (n,) errors so far, K (n,) scratch.

    Returns innovation and its variance; a NaN innovation where it lies beyond the gate, and nothing
    is changed.
    """
    e = z - X[row]
    S = P[row, row] + R
    if e * e > gate * gate * S:
        return math.nan, S
    for j in range(n):
        K[j] = P[row, j]
    share = 1.0 / S
    for i in range(n):
        c = K[i] * share
        X[i] += c * e
        for j in range(n):
            P[i, j] -= c * K[j]
    return e, S


@part
def correct(x, X, c0, c1, px, py, d):
    """Take the errors X (n,) out of the state x; d (3,) is scratch."""
    a, b, c, e = rotation(X[0], X[1], X[2])
    x[0], x[1], x[2], x[3] = product(a, b, c, e, x[0], x[1], x[2], x[3])
    for r in range(3):
        x[4 + r] -= X[3 + r]
        d[r] = -X[6 + r]
    shift(x, c0, c1, px, py, d)


@kernel
def corrected(states, errors):
    """Return states (m, 12) with errors (m, 9 or more) taken out of each."""
    out = states.copy()
    d = np.empty(3)
    for k in range(out.shape[0]):
        px, py, pz = axis_of_earth(out[k])
        c0, c1, _ = curvature(pz, out[k, 11])
        correct(out[k], errors[k], c0, c1, px, py, d)
    return out


@part
def set_to_reference(x, P, Phi, X, z, sd, c0, c1, px, py, d):
    """Set velocity and position to the reference, where it has an sd, as known as that says.

    They forget how they went with the rest: nothing of it is left in the transition Phi either.
    """
    n = P.shape[0]
    for r in range(9):
        X[r] = 0.0
    for r in range(sd.size):
        if sd[r] < np.inf:
            X[3 + r] = z[r]
            for j in range(n):
                Phi[3 + r, j] = P[3 + r, j] = P[j, 3 + r] = 0.0
            P[3 + r, 3 + r] = sd[r] ** 2
    correct(x, X, c0, c1, px, py, d)


@kernel
def transitions_of(
    dtheta, dvel, dt, left, right, first, x0, estimate, coefficient, axis, entry, weight, most,
    epochs, g_offset, held, states, transitions,
):  # fmt: skip
    """Navigate from row first, with nothing measured.

    Parameters as `ins_filter`; fills states (m, 12) and, of transitions (m, 9 or more, 9 + p or
    more), the nine first rows: from NumPy they have large pages.
    """
    x = x0.copy()
    M = np.empty((9, transitions.shape[2]))
    used, which = np.empty(axis.size, np.int64), np.empty(axis.size, np.int64)
    used = used[: inputs_used(entry, used, which)]
    matrix, sums = np.empty((used.size, 6)), np.empty((used.size, 56))
    u, w, s, bend = np.zeros((ROWS + 2, 6)), np.empty(6), np.empty(INPUTS), np.empty(6)
    felt, mid = np.empty((ROWS + 5, used.size)), np.empty((ROWS + 1, 21))
    D, L = np.zeros((ROWS + 5, 56)), np.empty(153)
    total = age = 0.0  # of all rows, whichever the run takes: a drift is that of the session
    for j in range(dt.size):
        total += dt[j]
        age += dt[j] if j <= first else 0.0
    errors_of(coefficient, axis, weight, which, estimate, matrix)
    if most > 36:
        changes(dtheta, dvel, dt, left, right, first, age - dt[first], total, s)
    compensated(dtheta[first], dvel[first], dt[first], used, matrix, most, w, s, u[0])
    begin = first + 1
    for k in range(epochs.size):
        age += advance(
            dtheta, dvel, dt, left, right, begin, epochs[k], age, total, coefficient, axis, weight,
            which, used, most, matrix, g_offset, held, x, u, w, s, felt, bend, mid, D, L, sums, M,
            transitions[k],
        )  # fmt: skip
        begin = epochs[k] + 1
        for c in range(x.size):
            states[k, c] = x[c]


@kernel
def ins_filter(
    dtheta, dvel, dt, left, right, first, x0, estimate0, P0, q, decay,
    coefficient, axis, entry, weight, most,
    epochs, reference, sd, gate, restart, g_offset, held, keep,
):  # fmt: skip
    """Navigate from row first, correcting at the epochs.

    Parameters: dtheta, dvel (n, 3), dt, left, right (n,) as `strapdown`; x0 (12,) state,
    estimate0 (p,) coefficients, P0 (9 + p, 9 + p) their covariance; q (9 + p,) white noise
    [unit^2/s]; decay (p,) 1 / correlation time [1/s]; terms: coefficient, axis, entry (t,),
    weight (t,); most: largest entry;
    epochs (m,) rows that rise; reference (m, 8) of `differences`; sd (m, 6) of velocity and
    position in l, infinite where nothing is measured; gate: innovations beyond so many sds are
    left out; restart (m,): there velocity and position are set to the reference, as known as sd
    says, and that is all that is taken in; held: height stays; keep: whether
    transitions and covariances are kept.

    Returns states (m, 12), coefficients (m, p), sds (m, 9 + p), innovations and their variances
    (m, 6) (NaN where none), corrections X (m, 9 + p), transitions (m, 9, 9 + p), covariances before
    and after (m, 9 + p, 9 + p), and the covariance at the end.
    """
    p = estimate0.size
    n = 9 + p
    m = epochs.size
    kept = m if keep else 0
    states = np.empty((m, 12))
    coefficients = np.empty((m, p))
    spread = np.empty((m, n))
    innovation = np.empty((m, 6))
    variance = np.empty((m, 6))
    corrections = np.empty((m, n))
    transitions = np.empty((kept, 9, n))
    before_P = np.empty((kept, n, n))
    after_P = np.empty((kept, n, n))
    x = x0.copy()
    estimate = estimate0.copy()
    P = P0.copy()
    Phi = np.empty((9, n))
    M = np.empty((9, n))
    K = np.empty(n)
    X = np.empty(n)
    left_of = np.empty(p)
    used, which = np.empty(axis.size, np.int64), np.empty(axis.size, np.int64)
    used = used[: inputs_used(entry, used, which)]
    matrix, sums = np.empty((used.size, 6)), np.empty((used.size, 56))
    u, w, s, bend = np.zeros((ROWS + 2, 6)), np.empty(6), np.empty(INPUTS), np.empty(6)
    felt, mid = np.empty((ROWS + 5, used.size)), np.empty((ROWS + 1, 21))
    D, L = np.zeros((ROWS + 5, 56)), np.empty(153)
    z = np.empty(6)
    d = np.empty(3)
    total = age = 0.0  # of all rows, whichever the run takes: a drift is that of the session
    for j in range(dt.size):
        total += dt[j]
        age += dt[j] if j <= first else 0.0
    errors_of(coefficient, axis, weight, which, estimate, matrix)
    if most > 36:
        changes(dtheta, dvel, dt, left, right, first, age - dt[first], total, s)
    compensated(dtheta[first], dvel[first], dt[first], used, matrix, most, w, s, u[0])
    begin = first + 1
    for k in range(m):
        errors_of(coefficient, axis, weight, which, estimate, matrix)
        T = advance(
            dtheta, dvel, dt, left, right, begin, epochs[k], age, total, coefficient, axis, weight,
            which, used, most, matrix, g_offset, held, x, u, w, s, felt, bend, mid, D, L, sums, M,
            Phi,
        )  # fmt: skip
        begin = epochs[k] + 1
        age += T
        for j in range(p):
            left_of[j] = math.exp(-T * decay[j]) if decay[j] > 0.0 else 1.0
            estimate[j] *= left_of[j]
        propagate(P, Phi, M, left_of, q, T, n)
        px, py, pz = axis_of_earth(x)
        c0, c1, _ = curvature(pz, x[11])
        differences(x, reference[k], c0, c1, px, py, pz, z)
        if restart[k]:
            set_to_reference(x, P, Phi, X, z, sd[k], c0, c1, px, py, d)
        if keep:
            for a in range(n):
                for b in range(n):
                    before_P[k, a, b] = P[a, b]
        if keep:
            for a in range(Phi.shape[0]):
                for b in range(n):
                    transitions[k, a, b] = Phi[a, b]
        for j in range(n):
            X[j] = 0.0
        for r in range(z.size):  # a bound that is known would be unrolled, and take a second
            innovation[k, r] = variance[k, r] = np.nan
            if sd[k, r] < np.inf and not restart[k]:
                e, S = update(P, X, K, n, 3 + r, z[r], sd[k, r] ** 2, gate)
                innovation[k, r] = e
                variance[k, r] = S
        if keep:
            for a in range(n):
                for b in range(n):
                    after_P[k, a, b] = P[a, b]
        correct(x, X, c0, c1, px, py, d)
        for j in range(p):
            estimate[j] += X[9 + j]
            coefficients[k, j] = estimate[j]
        for j in range(n):
            corrections[k, j] = X[j]
            spread[k, j] = math.sqrt(P[j, j])
        for c in range(12):
            states[k, c] = x[c]
    return (
        states, coefficients, spread, innovation, variance, corrections, transitions, before_P,
        after_P, P,
    )  # fmt: skip
