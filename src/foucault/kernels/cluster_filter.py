"""The published filter of a torqued cluster: 45 states, of which only the attitude moves.

State: the 42 constants of `kernels.cluster`, then outer, middle, inner angle of ``C_np`` [rad]. In
one interval of length h::

    C_np' = Exp(-w_in h) C_np Exp(w h)           what eq. (14) integrates to, w at mid-step
    P'    = Phi P Phi' + T' q T'' h              attitude rows only, see `cluster_transition`

The readings of the three axes come in one after the other; their three corrections are subtracted
from P in one sweep, and a correction that would leave a negative variance is not made.

FREE_ANGLES is that filter. The other two forms carry the attitude error as a small rotation phi of
p, ``C_np (true) = C_np Exp(phi)``, that is never fed back, so that nothing is linearised again
about a better attitude. In PLANNED the constants are not fed back either, in INTEGRATED they are.

P is flat, row i from 48 i, for then the compiler sees that rows do not overlap: twice as fast.
"""

import math

import numpy as np

from foucault.kernels import kernel, part, reduction
from foucault.kernels.cluster import inputs
from foucault.kernels.cluster_transition import (
    ANGLES,
    ATTITUDE,
    CONSTANTS,
    CORRECTION,
    EARTH,
    ERROR,
    ESTIMATE,
    FREE_ANGLES,
    INDEFINITE,
    NOT_FINITE,
    PAGES,
    PLANNED,
    PREDICTED,
    PREDICTED_ERROR,
    ROWS,
    RUNNING,
    STATES,
    WIDTH,
    C,
    H,
    L,
    T,
    X,
    Y,
    attitude,
    chart,
    copy,
    inverse_chart,
    on_error,
    predict,
    products,
    unit,
)
from foucault.kernels.rotation import multiply_exp

# -- correction ------------------------------------------------------------------------------


@part
def _towards(w, r):
    """Return the first two components of w x (w x r)."""
    along = w[0] * r[0] + w[1] * r[1] + w[2] * r[2]
    size = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    return w[0] * along - size * r[0], w[1] * along - size * r[1]


@kernel
def look(wide, m, fx, fy, fz, w, arms, g, said):
    """Write the predicted readings into said (3,) and their derivatives into the rows H.

    f: specific force [local g]; w: rate w_ip_p; arms (3, 3) [m]; g [m/s^2]. L: as `inverse_chart`
    writes it where angles are the state, I for a rotation of p.
    """
    theta = wide[ESTIMATE:]
    sensed = inputs(theta, fx, fy, fz, w[0], w[1], w[2], 0.0, 0.0, 0.0, arms, g)
    ux, _ = _towards(w, arms[1])
    vx, vy = _towards(w, arms[2])
    c, d, e = theta[36], theta[37], theta[38]
    for i in range(3):
        W, at = sensed[i], H + WIDTH * i
        said[i] = theta[30 + i] + (1.0 + theta[33 + i] + theta[39 + i] * W) * W
        s = 1.0 + theta[33 + i] + 2.0 * theta[39 + i] * W
        wide[at + 30 + i], wide[at + 33 + i], wide[at + 39 + i] = 1.0, W, W * W
        if i == 0:  # axis x f for the axes (1, 0, 0), (c, 1, 0), (d, e, 1)
            x, y, z = 0.0, -s * fz, s * fy
        elif i == 1:
            x, y, z = s * fz, -s * c * fz, s * (c * fy - fx)
            wide[at + 36] = s * (fx + ux / g)
        else:
            x, y, z = s * (e * fz - fy), s * (fx - d * fz), s * (d * fy - e * fx)
            wide[at + 37], wide[at + 38] = s * (fx + vx / g), s * (fy + vy / g)
        for j in range(3):
            wide[at + ANGLES + j] = x * m[L, 0, j] + y * m[L, 1, j] + z * m[L, 2, j]


@reduction
def _columns(P, wide):
    """Write P H' into the corrections: H has the attitude and three to five constants an axis."""
    a0, a1, a2 = wide[H + 42], wide[H + 43], wide[H + 44]
    b0, b1, b2 = wide[H + 90], wide[H + 91], wide[H + 92]
    c0, c1, c2 = wide[H + 138], wide[H + 139], wide[H + 140]
    a3, b3, c3 = wide[H + 33], wide[H + 82], wide[H + 131]
    a4, b4, c4 = wide[H + 39], wide[H + 88], wide[H + 137]
    b5, c5, c6 = wide[H + 84], wide[H + 133], wide[H + 134]
    for j in range(WIDTH):
        x, y, z = P[ATTITUDE + j], P[ATTITUDE + 48 + j], P[ATTITUDE + 96 + j]
        u = a0 * x + a1 * y + a2 * z + P[1440 + j] + a3 * P[1584 + j] + a4 * P[1872 + j]
        v = b0 * x + b1 * y + b2 * z + P[1488 + j] + b3 * P[1632 + j] + b4 * P[1920 + j]
        w = c0 * x + c1 * y + c2 * z + P[1536 + j] + c3 * P[1680 + j] + c4 * P[1968 + j]
        wide[CORRECTION + j] = u
        wide[CORRECTION + 48 + j] = v + b5 * P[1728 + j]
        wide[CORRECTION + 96 + j] = w + c5 * P[1776 + j] + c6 * P[1824 + j]


@reduction
def _take_in(wide, s, x, y, z):
    """Divide the corrections by the factor s (3, 3), and add those that x, y, z call for."""
    s00, s11, s22, s10, s20, s21 = s[0, 0], s[1, 1], s[2, 2], s[1, 0], s[2, 0], s[2, 1]
    for j in range(WIDTH):
        u = wide[CORRECTION + j] * s00
        v = (wide[CORRECTION + 48 + j] - s10 * u) * s11
        w = (wide[CORRECTION + 96 + j] - s20 * u - s21 * v) * s22
        wide[CORRECTION + j] = u
        wide[CORRECTION + 48 + j] = v
        wide[CORRECTION + 96 + j] = w
        wide[ERROR + j] += x * u + y * v + z * w


@kernel
def correct(P, wide, m, reading, said, r):
    """Take in three readings, one after the other: change the error, write the corrections W.

    P - W' W is the new P; P is left as it is. Returns a code and the sum of squares of the
    normalised innovations.
    """
    s, nu = m[X], m[Y, 0]
    _columns(P, wide)
    products(wide, CORRECTION, H, s)
    on_error(wide, H, nu)
    nis = 0.0
    for i in range(3):  # s: its factor below the diagonal, one over it there
        e, S = reading[i] - said[i] - nu[i], s[i, i]
        for k in range(i):
            for n in range(k):
                s[i, k] -= s[i, n] * s[k, n]
            s[i, k] *= s[k, k]
            S -= s[i, k] * s[i, k]
            e -= s[i, k] * nu[k]
        if not abs(e) + abs(S) < np.inf:
            return NOT_FINITE, nis
        if not S > -0.5 * r[i]:  # H P H' < 0: P has lost its sign
            return INDEFINITE, nis
        s[i, i] = 1.0 / math.sqrt(S + r[i])
        nu[i] = e * s[i, i]
        nis += nu[i] * nu[i]
    _take_in(wide, s, nu[0], nu[1], nu[2])
    for j in range(STATES):
        x, y, z = wide[CORRECTION + j], wide[CORRECTION + 48 + j], wide[CORRECTION + 96 + j]
        if not P[WIDTH * j + j] - x * x - y * y - z * z >= 0.0:
            return INDEFINITE, nis
    return RUNNING, nis


@reduction
def subtract(P, wide):
    """Replace P by ``P - W' W``, three rows at a time; what was symmetric stays so."""
    for i in range(0, STATES, 3):
        w = CORRECTION + i
        x0, y0, z0 = wide[w], wide[w + 48], wide[w + 96]
        x1, y1, z1 = wide[w + 1], wide[w + 49], wide[w + 97]
        x2, y2, z2 = wide[w + 2], wide[w + 50], wide[w + 98]
        p = WIDTH * i
        for j in range(WIDTH):
            x, y, z = wide[CORRECTION + j], wide[CORRECTION + 48 + j], wide[CORRECTION + 96 + j]
            P[p + j] -= x0 * x + y0 * y + z0 * z
            P[p + 48 + j] -= x1 * x + y1 * y + z1 * z
            P[p + 96 + j] -= x2 * x + y2 * y + z2 * z


@kernel
def feed_back(wide, m, form):
    """Move what was found of the errors into the estimate, as far as this form does."""
    if form != PLANNED:
        for j in range(STATES if form == FREE_ANGLES else CONSTANTS):
            wide[ESTIMATE + j] += wide[ERROR + j]
            wide[ERROR + j] = 0.0
    if form == FREE_ANGLES:
        at = ESTIMATE + ANGLES
        attitude(wide[at], wide[at + 1], wide[at + 2], m)


@kernel
def update(P, wide, m, reading, r, w, arms, g, form, iterations, offset, said):
    """Take in the readings at the end of an interval; return a code and their sum of squares.

    reading (3,), r (3,) their variance; w: rate w_ip_p. With more than one iteration the readings
    are linearised again about what they made of the estimate.
    """
    for j in range(STATES):
        wide[PREDICTED + j] = wide[ESTIMATE + j]
        wide[PREDICTED_ERROR + j] = wide[ERROR + j]
    code, nis = RUNNING, 0.0
    for n in range(iterations):
        if n > 0:
            for j in range(STATES):
                wide[ERROR + j] = wide[PREDICTED + j] - wide[ESTIMATE + j]
        if form == FREE_ANGLES:
            inverse_chart(m, math.cos(wide[ESTIMATE + ANGLES + 1]))
        fx, fy, fz = m[C, 2, 0] + offset[0], m[C, 2, 1] + offset[1], m[C, 2, 2] + offset[2]
        look(wide, m, fx, fy, fz, w, arms, g, said)
        code, nis = correct(P, wide, m, reading, said, r)
        if code != RUNNING:
            for j in range(STATES):
                wide[ESTIMATE + j] = wide[PREDICTED + j]
                wide[ERROR + j] = wide[PREDICTED_ERROR + j]
            return code, nis
        feed_back(wide, m, form)
    subtract(P, wide)
    return code, nis


# -- the whole log ---------------------------------------------------------------------------


@part
def _aligned(n):
    """Return zeros that begin where a cache line does: elsewhere sweeps take half as long again."""
    a = np.zeros(n + 7)
    first = (64 - a.ctypes.data % 64) % 64 // 8
    return a[first : first + n]


@kernel
def keep(P, wide, m, form, estimate, sd):
    """Write the estimates (constants, then angles) and their standard deviations, each (45,)."""
    for j in range(CONSTANTS):
        estimate[j] = wide[ESTIMATE + j] + wide[ERROR + j]
    for j in range(STATES):
        sd[j] = math.sqrt(P[WIDTH * j + j])
    copy(m, C, X)
    if form != FREE_ANGLES:
        at = ERROR + ANGLES
        multiply_exp(m[X], wide[at], wide[at + 1], wide[at + 2])
    chart(m, X, estimate[ANGLES:])
    if form != FREE_ANGLES:
        for i in range(3):
            s = 0.0
            for j in range(3):
                for k in range(3):
                    s += m[T, i, j] * P[ATTITUDE + WIDTH * j + ANGLES + k] * m[T, i, k]
            sd[ANGLES + i] = math.sqrt(max(s, 0.0))
        unit(m, T)


@kernel
def run(
    dt, command, reading, used, variance, mean, start, prior, w_in, q, arms, g,
    form, full_rate, first_iterations, after, estimate, sd, nis, count,
):  # fmt: skip
    """Filter one log; write estimates and innovations at checkpoints.

    Parameters: dt (N,) length of the intervals [s]; command (N, 3) rate commanded during each
    [rad/s]; reading (N, 3) of the accelerometers at the end of each, or its mean over each where
    `mean` [local g]; used (N,) which readings count; variance (N, 3) of the readings; start (45,)
    constants and angles; prior (45, 45) their covariance, the last three those of a rotation of p
    where angles are not the state; w_in (3,) the Earth's rate in n [rad/s]; q (3,) white noise of
    the gyros [rad^2/s]; arms (3, 3) [m]; g [m/s^2]; form: FREE_ANGLES, PLANNED or INTEGRATED;
    full_rate: the inverse of the input axes in front of the drift; first_iterations: how often the
    first readings are linearised; after (c,) numbers of intervals, ascending, after which estimate
    (c, 45), sd (c, 45), sum of squares of the normalised innovations nis (c,) and their count (c,)
    are written.

    Returns a code, the number of intervals done and of checkpoints reached; then C_np (3, 3), the
    row of estimates (48,), of errors not fed back (48,), and P (45, 48). With a code other than
    RUNNING they are the last that were good.
    """
    P, wide, m = _aligned(STATES * WIDTH), _aligned(ROWS * WIDTH), np.zeros((PAGES, 3, 3))
    offset, said, none = np.zeros(3), np.zeros(3), np.zeros(3)
    for j in range(STATES):
        wide[ESTIMATE + j] = start[j]
        for i in range(STATES):
            P[WIDTH * j + i] = prior[j, i]
    attitude(start[ANGLES], start[ANGLES + 1], start[ANGLES + 2], m)
    unit(m, T)
    unit(m, L)
    kept = updates = readings = 0
    h = total = 0.0
    code, k = RUNNING, 0
    while k < dt.size:
        if dt[k] != h:
            h = dt[k]
            unit(m, EARTH)
            multiply_exp(m[EARTH], -w_in[0] * h, -w_in[1] * h, -w_in[2] * h)
        code, wx, wy, wz = predict(P, wide, m, command[k], h, q, full_rate, form, offset)
        if code != RUNNING:
            break
        if used[k]:
            again = first_iterations if updates == 0 and form == FREE_ANGLES else 1
            code, more = update(
                P, wide, m, reading[k], variance[k], (wx, wy, wz), arms, g, form, again,
                offset if mean else none, said,
            )  # fmt: skip
            if code != RUNNING:
                break
            updates += 1
            readings += 3
            total += more
        k += 1
        if kept < after.size and k >= after[kept]:
            keep(P, wide, m, form, estimate[kept], sd[kept])
            nis[kept], count[kept] = total, readings
            kept += 1
            readings = 0
            total = 0.0
    return (
        code, k, kept, m[C].copy(), wide[ESTIMATE : ESTIMATE + WIDTH].copy(),
        wide[ERROR : ERROR + WIDTH].copy(), P.reshape(STATES, WIDTH),
    )  # fmt: skip
