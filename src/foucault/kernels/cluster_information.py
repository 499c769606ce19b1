"""What a log of a torqued cluster says about its constants: one linearised pass, in two stages.

The attitude error of a reference trajectory is a rotation vector psi, resolved in the axes i that n
has at the start: ``C_ip_true = Exp(psi) C_ip``. Only psi moves::

    psi' = A (E [f x] C_pi psi + G theta + noise),   A = C_ip T^-1
    r    = H psi + J theta + noise,                  H = s (axis x f)' C_pi

with psi = xi + Y x: x are the constants (the start attitude psi_0 among them, all in units of their
prior sd), xi is what gyro noise adds. A Kalman filter of the three entries of xi whitens the
residuals; the same gain acts on the sensitivities Y (stage one), and the whitened rows
``[S | residual]`` are summed to their Gram matrix in blocks (stage two), turned so that a third of
them has zeros where attitude would stand. It is the linearised
45-state filter, rearranged: no 45 x 45 covariance is carried, nothing can lose its sign.

Columns: 0-2 psi_0, 3-44 the constants in the order of `kernels.cluster`, 45 the delay of the
readings, 46 empty, 47 the residual.
"""

import math

import numpy as np

from foucault.kernels import fused, inlined, kernel, part, reduction
from foucault.kernels.cluster import actual_rate, inputs, inverse_input_axes
from foucault.kernels.cluster_slopes import (
    APART,
    SLOPE,
    TI,
    WHITE,
    A,
    B,
    D,
    F,
    H,
    K,
    L,
    P,
    S,
    U,
    Y,
    look,
    move,
)
from foucault.kernels.cluster_slopes import COLUMNS as COLUMNS
from foucault.kernels.cluster_slopes import RESIDUAL as RESIDUAL
from foucault.kernels.rotation import C4, C6, S3, S5, multiply_exp

# Rows of the workspace of vectors (7, 3): up in i, specific force now and one interval ago, rate,
# what p turns by beside its command, its turn since the last epoch, sum of the misses.
UP, FORCE, BEFORE, RATE, BESIDE, TURNED, MISSED = 0, 1, 2, 3, 4, 5, 6

ALONE = 33
"""From this column on constants are not of the gyros; these alone are in a third of the rows."""

# Few arrays are handed on: each costs seven words in a call that is not inlined.


@inlined
def _earth_turns(v, w_in, h):
    """Turn `up` by the Earth's rotation vector w h."""
    ax = w_in[0] * h
    ay = w_in[1] * h
    az = w_in[2] * h
    a2 = ax * ax + ay * ay + az * az
    s = 1.0 + a2 * (S3 + a2 * S5)
    c = 0.5 + a2 * (C4 + a2 * C6)
    x = v[UP, 0]
    y = v[UP, 1]
    z = v[UP, 2]
    bx = ay * z - az * y
    by = az * x - ax * z
    bz = ax * y - ay * x
    v[UP, 0] = x + s * bx + c * (ay * bz - az * by)
    v[UP, 1] = y + s * by + c * (az * bx - ax * bz)
    v[UP, 2] = z + s * bz + c * (ax * by - ay * bx)


@inlined
def _rotated(C, x, y, z):
    """Return ``C' (x, y, z)``."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


@inlined
def _advance(here, v, theta, Ti, cx, cy, cz, w_in, h):
    """Turn p through one interval under the command c."""
    fx, fy, fz = v[FORCE, 0], v[FORCE, 1], v[FORCE, 2]
    # Specific force in the middle, to second order, by the rate of p relative to n.
    ex, ey, ez = _rotated(here, w_in[0], w_in[1], w_in[2])
    sx = 0.5 * h * (cx + v[BESIDE, 0] - ex)
    sy = 0.5 * h * (cy + v[BESIDE, 1] - ey)
    sz = 0.5 * h * (cz + v[BESIDE, 2] - ez)
    ax = fy * sz - fz * sy
    ay = fz * sx - fx * sz
    az = fx * sy - fy * sx
    mx = fx + ax + 0.5 * (ay * sz - az * sy)
    my = fy + ay + 0.5 * (az * sx - ax * sz)
    mz = fz + az + 0.5 * (ax * sy - ay * sx)
    wx, wy, wz = actual_rate(theta, Ti, cx, cy, cz, mx, my, mz)
    v[BESIDE, 0] = wx - cx  # hardly another one interval later
    v[BESIDE, 1] = wy - cy
    v[BESIDE, 2] = wz - cz
    v[RATE, 0] = wx
    v[RATE, 1] = wy
    v[RATE, 2] = wz
    v[TURNED, 0] += wx * h
    v[TURNED, 1] += wy * h
    v[TURNED, 2] += wz * h
    multiply_exp(here, wx * h, wy * h, wz * h)
    _earth_turns(v, w_in, h)
    v[BEFORE, 0] = fx
    v[BEFORE, 1] = fy
    v[BEFORE, 2] = fz
    fx, fy, fz = _rotated(here, v[UP, 0], v[UP, 1], v[UP, 2])
    v[FORCE, 0] = fx
    v[FORCE, 1] = fy
    v[FORCE, 2] = fz


@inlined
def _miss(here, v, theta, zx, zy, zz, h, mean, delay, arms, g, w_in):
    """Add what a reading z says beyond the trajectory to the misses."""
    fx, fy, fz = v[FORCE, 0], v[FORCE, 1], v[FORCE, 2]
    bx, by, bz = v[BEFORE, 0], v[BEFORE, 1], v[BEFORE, 2]
    wx, wy, wz = v[RATE, 0], v[RATE, 1], v[RATE, 2]
    ex, ey, ez = _rotated(here, w_in[0], w_in[1], w_in[2])
    nx, ny, nz = wx - ex, wy - ey, wz - ez  # rate relative to n: f' = f x n
    if mean:  # exact while n stands still: a - tan(x)/x ..., a mean of both ends, x = |n| h / 2
        fx = 0.5 * (bx + fx)
        fy = 0.5 * (by + fy)
        fz = 0.5 * (bz + fz)
        x2 = 0.25 * h * h * (nx * nx + ny * ny + nz * nz)
        k = 0.25 * h * h * (1.0 / 3.0 + x2 * (2.0 / 15.0 + x2 * (17.0 / 315.0)))
        sx, sy, sz = fy * nz - fz * ny, fz * nx - fx * nz, fx * ny - fy * nx
        fx, fy, fz = (
            fx - k * (sy * nz - sz * ny),
            fy - k * (sz * nx - sx * nz),
            fz - k * (sx * ny - sy * nx),
        )
    if delay != 0.0:  # to second order
        sx, sy, sz = fy * nz - fz * ny, fz * nx - fx * nz, fx * ny - fy * nx
        k = 0.5 * delay * delay
        fx += k * (sy * nz - sz * ny) - delay * sx
        fy += k * (sz * nx - sx * nz) - delay * sy
        fz += k * (sx * ny - sy * nx) - delay * sz
    X, V, Z = inputs(theta, fx, fy, fz, wx, wy, wz, 0.0, 0.0, 0.0, arms, g)
    v[MISSED, 0] += zx - theta[30] - (1.0 + theta[33] + theta[39] * X) * X
    v[MISSED, 1] += zy - theta[31] - (1.0 + theta[34] + theta[40] * V) * V
    v[MISSED, 2] += zz - theta[32] - (1.0 + theta[35] + theta[41] * Z) * Z


@fused
def _whiten_and_correct(wide, m, W, V, at):
    """Write white rows into columns at and at + 1 of W (48, rows), at / 2 of V; correct Y."""
    for i in range(3):
        u0, u1, u2 = m[U, i, 0], m[U, i, 1], m[U, i, 2]
        for j in range(ALONE, COLUMNS):
            wide[APART + i, j] = u0 * wide[S, j] + u1 * wide[S + 1, j] + u2 * wide[S + 2, j]
    n00, n01, n02 = m[B, 0, 0], m[B, 0, 1], m[B, 0, 2]
    n10, n11, n12 = m[B, 1, 0], m[B, 1, 1], m[B, 1, 2]
    d00, d10, d20 = m[D, 0, 0], m[D, 1, 0], m[D, 2, 0]
    d01, d11, d21 = m[D, 0, 1], m[D, 1, 1], m[D, 2, 1]
    for j in range(COLUMNS):
        x, y, z = wide[Y, j], wide[Y + 1, j], wide[Y + 2, j]
        a = wide[APART, j] + n00 * x + n01 * y + n02 * z
        b = wide[APART + 1, j] + n10 * x + n11 * y + n12 * z
        wide[Y, j] = x - d00 * a - d01 * b
        wide[Y + 1, j] = y - d10 * a - d11 * b
        wide[Y + 2, j] = z - d20 * a - d21 * b
        wide[WHITE, j] = a
        wide[WHITE + 1, j] = b
    for j in range(COLUMNS):
        w = W[j, at : at + 2]
        w[0], w[1] = wide[WHITE, j], wide[WHITE + 1, j]
    for j in range(ALONE, COLUMNS):
        V[j, at // 2] = wide[APART + 2, j]


@reduction
def _gram(G, W, first, rows):
    """Add ``W W'`` of the first `rows` columns to the upper triangle of G, in tiles of 3 x 3.

    W is zero above its row `first`.
    """
    for i in range(first, COLUMNS, 3):
        for j in range(i, COLUMNS, 3):
            a0 = a1 = a2 = b0 = b1 = b2 = c0 = c1 = c2 = 0.0
            for r in range(rows):
                x, y, z = W[i, r], W[i + 1, r], W[i + 2, r]
                s, t, u = W[j, r], W[j + 1, r], W[j + 2, r]
                a0, a1, a2 = a0 + x * s, a1 + x * t, a2 + x * u
                b0, b1, b2 = b0 + y * s, b1 + y * t, b2 + y * u
                c0, c1, c2 = c0 + z * s, c1 + z * t, c2 + z * u
            G[i, j] += a0
            G[i, j + 1] += a1
            G[i, j + 2] += a2
            G[i + 1, j] += b0
            G[i + 1, j + 1] += b1
            G[i + 1, j + 2] += b2
            G[i + 2, j] += c0
            G[i + 2, j + 1] += c1
            G[i + 2, j + 2] += c2


@fused
def _innovation(m, r):
    """Turn the readings so that the third sees no attitude; update P with the two others.

    Nobody sees a turn about the vertical: t' H = 0. With T orthogonal, t along its third row, and
    L the Cholesky factor of the covariance of T (H xi + noise), ``U = L^-1 T``, B = U H and
    D = P B' of the two. White rows are U times the innovations, ``xi`` changes by D times two.
    """
    x, y, z = m[SLOPE, 2, 0], m[SLOPE, 2, 1], m[SLOPE, 2, 2]
    t2 = x * x + y * y + z * z
    size = math.sqrt(t2)
    sign = math.copysign(1.0, z)
    a = size + abs(z)
    k = size * a  # length of the first two rows until they are divided by L
    m[U, 0, 0], m[U, 0, 1], m[U, 0, 2] = k - x * x, -x * y, -sign * x * a
    m[U, 1, 0], m[U, 1, 1], m[U, 1, 2] = -x * y, k - y * y, -sign * y * a
    size = 1.0 / math.sqrt(r * t2)
    m[U, 2, 0], m[U, 2, 1], m[U, 2, 2] = x * size, y * size, z * size
    r *= k * k
    for i in range(2):
        x, y, z = m[U, i, 0], m[U, i, 1], m[U, i, 2]
        for j in range(3):
            m[B, i, j] = x * m[H, 0, j] + y * m[H, 1, j] + z * m[H, 2, j]
    for i in range(3):
        x, y, z = m[P, i, 0], m[P, i, 1], m[P, i, 2]
        for j in range(2):
            m[D, i, j] = x * m[B, j, 0] + y * m[B, j, 1] + z * m[B, j, 2]
    s00 = r + m[B, 0, 0] * m[D, 0, 0] + m[B, 0, 1] * m[D, 1, 0] + m[B, 0, 2] * m[D, 2, 0]
    s10 = m[B, 1, 0] * m[D, 0, 0] + m[B, 1, 1] * m[D, 1, 0] + m[B, 1, 2] * m[D, 2, 0]
    s11 = r + m[B, 1, 0] * m[D, 0, 1] + m[B, 1, 1] * m[D, 1, 1] + m[B, 1, 2] * m[D, 2, 1]
    r0 = 1.0 / s00
    l10 = s10 * r0
    r1 = 1.0 / (s11 - l10 * s10)
    i0, i1 = math.sqrt(r0), math.sqrt(r1)
    for i in range(3):
        m[U, 1, i] = (m[U, 1, i] - l10 * m[U, 0, i]) * i1
        m[B, 1, i] = (m[B, 1, i] - l10 * m[B, 0, i]) * i1
        m[D, i, 1] = (m[D, i, 1] - l10 * m[D, i, 0]) * i1
        m[U, 0, i] *= i0
        m[B, 0, i] *= i0
        m[D, i, 0] *= i0
        for j in range(i + 1):
            p = m[P, i, j] - m[D, i, 0] * m[D, j, 0] - m[D, i, 1] * m[D, j, 1]
            m[P, i, j] = p
            m[P, j, i] = p


@part
def _as_read(k, wide, m, r, rows):
    """Factor ``H P H' + r I = L L'``, write K = P H' (L L')^-1, and white rows into entry k.

    For whom readings must not be turned. The diagonal of L is stored as its reciprocal.
    """
    for i in range(3):
        for j in range(3):
            m[K, i, j] = m[P, i, 0] * m[H, j, 0] + m[P, i, 1] * m[H, j, 1] + m[P, i, 2] * m[H, j, 2]
    for i in range(3):
        for j in range(i + 1):
            s = m[H, i, 0] * m[K, 0, j] + m[H, i, 1] * m[K, 1, j] + m[H, i, 2] * m[K, 2, j]
            for n in range(j):
                s -= m[L, i, n] * m[L, j, n]
            m[L, i, j] = s * m[L, j, j] if j < i else 1.0 / math.sqrt(r + s)
    for i in range(3):
        for j in range(3):
            for n in range(j):
                m[K, i, j] -= m[L, j, n] * m[K, i, n]
            m[K, i, j] *= m[L, j, j]
        for j in range(2, -1, -1):
            for n in range(j + 1, 3):
                m[K, i, j] -= m[L, n, j] * m[K, i, n]
            m[K, i, j] *= m[L, j, j]
    for i in range(3 if k < rows.shape[0] else 0):
        for j in range(COLUMNS):
            s = wide[S + i, j]
            for n in range(3):
                s += m[H, i, n] * wide[Y + n, j]
            for n in range(i):
                s -= m[L, i, n] * rows[k, n, j]
            rows[k, i, j] = s * m[L, i, i]


@inlined
def _epoch(wide, m, here, there, half, v, theta, scale, w_in, arms, g, span, tail, q):
    """Carry the sensitivities to the epoch, `tail` [s] ago and `span` after the last one; look."""
    ex, ey, ez = w_in[0], w_in[1], w_in[2]
    wx, wy, wz = v[RATE, 0], v[RATE, 1], v[RATE, 2]
    for i in range(3):
        for j in range(3):
            there[i, j] = here[i, j]
    if tail > 0.0:
        multiply_exp(there, -wx * tail, -wy * tail, -wz * tail)
    x, y, z = v[UP, 0], v[UP, 1], v[UP, 2]
    dx, dy, dz = ey * z - ez * y, ez * x - ex * z, ex * y - ey * x  # how up turns
    ago = tail + 0.5 * span
    px = v[TURNED, 0] - wx * tail
    py = v[TURNED, 1] - wy * tail
    pz = v[TURNED, 2] - wz * tail
    move(
        wide,
        m,
        there,
        half,
        theta,
        scale,
        x - ago * dx,
        y - ago * dy,
        z - ago * dz,
        span,
        px,
        py,
        pz,
        q,
    )
    fx, fy, fz = _rotated(there, x - tail * dx, y - tail * dy, z - tail * dz)
    ax, ay, az = _rotated(there, ex, ey, ez)
    X, V, Z = inputs(theta, fx, fy, fz, wx, wy, wz, 0.0, 0.0, 0.0, arms, g)
    look(wide, m, there, theta, scale, fx, fy, fz, X, V, Z, wx - ax, wy - ay, wz - az)
    v[TURNED, 0] = wx * tail
    v[TURNED, 1] = wy * tail
    v[TURNED, 2] = wz * tail


@part
def _carry(wide, m, here, there, half, v, theta, scale, span, q):
    """Carry the sensitivities on by `span` [s], to now."""
    for i in range(3):
        for j in range(3):
            there[i, j] = here[i, j]
    x, y, z = v[TURNED, 0], v[TURNED, 1], v[TURNED, 2]
    move(wide, m, there, half, theta, scale, v[UP, 0], v[UP, 1], v[UP, 2], span, x, y, z, q)
    for i in range(3):
        v[TURNED, i] = 0.0


@part
def _keep(k, G, wide, m, here, gram, sensitivities, cov, attitude):
    """Copy Gram matrix, Y, P and C_ip to entry k of four arrays; slices compile slowly."""
    for i in range(COLUMNS):
        for j in range(COLUMNS):
            gram[k, i, j] = G[i, j]
    for i in range(3):
        for j in range(COLUMNS):
            sensitivities[k, i, j] = wide[Y + i, j]
        for j in range(3):
            cov[k, i, j] = m[P, i, j]
            attitude[k, i, j] = here[i, j]


@part
def _keep_gains(k, m, read, gains):
    """Copy F, A, H, K and L to entry k; `read` is 0 where there was no reading."""
    for i in range(3):
        for j in range(3):
            gains[k, 0, i, j] = m[F, i, j]
            gains[k, 1, i, j] = m[A, i, j]
            gains[k, 2, i, j] = read * m[H, i, j]
            gains[k, 3, i, j] = read * m[K, i, j]
            gains[k, 4, i, j] = read * m[L, i, j]


@kernel
def information_pass(
    dt, command, reading, used, theta, scale, C_ip, w_in, q, r, arms, g, mean, block,
    rows, checkpoints, delay, gains,
):  # fmt: skip
    """Linearise a log about the trajectory of `theta` from `C_ip`, whiten it, sum its information.

    Parameters: dt (N,) length of the intervals [s]; command (N, 3) rate commanded during each
    [rad/s]; reading (N, 3) of the accelerometers at the end of each, or its mean over each where
    `mean` [local g]; used (N,) which readings count; theta (42,) packed constants; scale (46,)
    what one unit of each column is; C_ip (3, 3) attitude at the start, i = n then; w_in (3,)
    Earth's rate in n [rad/s]; q white gyro noise [rad^2/s]; r variance of one reading; arms (3, 3)
    [m]; g [m/s^2]; block: so many readings are averaged to one residual; rows (blocks, 3, 48) or
    (0, 3, 48) gets the whitened rows; checkpoints (c,) samples, ascending, after which the state
    is kept; delay of the readings [s]; gains (blocks + 1, 5, 3, 3) or (0, 5, 3, 3) gets what
    `answer` needs of every step.

    Returns the Gram matrix (1, 48, 48), upper triangle; Y (1, 3, 48), P (1, 3, 3) and C_ip
    (1, 3, 3) at the end; time (c,), Gram (c, 48, 48), Y (c, 3, 48), P (c, 3, 3) and C_ip
    (c, 3, 3) at the checkpoints; time (blocks,) of every residual and (steps,) of the end of every
    step whose gains are kept, from the start [s].
    """
    N = dt.size
    BATCH = 128
    m = np.zeros((13, 3, 3))
    v = np.zeros((7, 3))
    wide = np.zeros((11, COLUMNS))
    Ti = np.empty((3, 3))
    inverse_input_axes(theta, Ti)
    for i in range(3):
        for j in range(3):
            m[TI, i, j] = Ti[i, j]
    here, there, half = C_ip.copy(), np.empty((3, 3)), np.empty((3, 3))
    v[UP, 2] = 1.0
    for i in range(3):
        wide[Y + i, i] = scale[i]
        v[FORCE, i] = C_ip[2, i]
    W = np.zeros((COLUMNS, 2 * BATCH + 4))  # + 4: columns must not share their cache lines
    V = np.zeros((COLUMNS, BATCH + 4))
    G = np.zeros((COLUMNS, COLUMNS))
    c_time = np.zeros(checkpoints.size)
    c_gram = np.zeros((checkpoints.size, COLUMNS, COLUMNS))
    c_wide = np.zeros((checkpoints.size, 3, COLUMNS))
    c_P = np.zeros((checkpoints.size, 3, 3))
    c_C = np.zeros((checkpoints.size, 3, 3))
    at_block = np.zeros(N // block + 1)
    at_step = np.zeros(gains.shape[0])
    now = epoch = times = 0.0
    # A 0 as an argument would compile what takes it once more, for 0.
    none = N - N
    count = blocks = kept = steps = filled = none
    alone = none + ALONE
    for k in range(N):
        h = dt[k]
        _advance(here, v, theta, Ti, command[k, 0], command[k, 1], command[k, 2], w_in, h)
        now += h
        if used[k]:
            x, y, z = reading[k, 0], reading[k, 1], reading[k, 2]
            _miss(here, v, theta, x, y, z, h, mean, delay, arms, g, w_in)
            times += now - 0.5 * h if mean else now
            count += 1
        if count > 0 and ((k + 1) % block == 0 or k == N - 1):
            at = times / count
            _epoch(
                wide, m, here, there, half, v, theta, scale, w_in, arms, g, at - epoch, now - at, q
            )
            for i in range(3):
                wide[S + i, RESIDUAL] = v[MISSED, i] / count
                v[MISSED, i] = 0.0
            if rows.shape[0] > 0 or at_step.size > 0:
                _as_read(blocks, wide, m, r / count, rows)
            _innovation(m, r / count)
            _whiten_and_correct(wide, m, W, V, filled)
            if at_step.size > 0:
                _keep_gains(steps, m, 1.0, gains)
                at_step[steps] = at
                steps += 1
            at_block[blocks] = at
            epoch = at
            times = 0.0
            count = 0
            blocks += 1
            filled += 2
        elif (k + 1) % block == 0:  # nothing was read for long: the slopes must not go far at once
            _carry(wide, m, here, there, half, v, theta, scale, now - epoch, q)
            if at_step.size > 0:
                _keep_gains(steps, m, 0.0, gains)
                at_step[steps] = now
                steps += 1
            epoch = now
        if filled == 2 * BATCH or (kept < checkpoints.size and k >= checkpoints[kept]):
            _gram(G, W, none, filled)
            _gram(G, V, alone, filled // 2)
            filled = 0
        if kept < checkpoints.size and k >= checkpoints[kept]:
            c_time[kept] = now
            _keep(kept, G, wide, m, here, c_gram, c_wide, c_P, c_C)
            kept += 1
    _gram(G, W, none, filled)
    _gram(G, V, alone, filled // 2)
    tail = now - epoch
    if tail > 0.0:
        _carry(wide, m, here, there, half, v, theta, scale, tail, q)
        if at_step.size > 0:
            _keep_gains(steps, m, 0.0, gains)
            at_step[steps] = now
            steps += 1
    e_gram, e_wide = np.empty((1, COLUMNS, COLUMNS)), np.empty((1, 3, COLUMNS))
    e_P, e_C = np.empty((1, 3, 3)), np.empty((1, 3, 3))
    _keep(none, G, wide, m, here, e_gram, e_wide, e_P, e_C)
    read, ends = at_block[:blocks], at_step[:steps]
    return e_gram, e_wide, e_P, e_C, c_time, c_gram, c_wide, c_P, c_C, read, ends


@reduction
def answer(gains, turned, rows):
    """Filter what small changes of a log do to its residuals, with the gains of a pass over it.

    Parameters: gains (steps, 5, 3, 3) as `information_pass` writes them; turned (steps, 3, c) by
    what every change has the gyros turn p more in each step, beside their axes [rad]; rows
    (steps, 3, c) gets the changes of the white rows, and holds what they add to the readings
    averaged there [local g]; where nothing was read, zero.

    Returns by what the estimate of xi falls short of the change of the trajectory at the end
    (3, c) [rad].
    """
    C = rows.shape[2]
    b = np.zeros((3, C))
    for k in range(rows.shape[0]):
        f, a, h = gains[k, 0], gains[k, 1], gains[k, 2]
        g, low = gains[k, 3], gains[k, 4]
        i0, i1, i2, l10, l20, l21 = low[0, 0], low[1, 1], low[2, 2], low[1, 0], low[2, 0], low[2, 1]
        for j in range(C):
            x, y, z = b[0, j], b[1, j], b[2, j]
            p, q, r = turned[k, 0, j], turned[k, 1, j], turned[k, 2, j]
            u = x + f[0, 0] * x + f[0, 1] * y + f[0, 2] * z
            v = y + f[1, 0] * x + f[1, 1] * y + f[1, 2] * z
            w = z + f[2, 0] * x + f[2, 1] * y + f[2, 2] * z
            u -= a[0, 0] * p + a[0, 1] * q + a[0, 2] * r
            v -= a[1, 0] * p + a[1, 1] * q + a[1, 2] * r
            w -= a[2, 0] * p + a[2, 1] * q + a[2, 2] * r
            x = rows[k, 0, j] + h[0, 0] * u + h[0, 1] * v + h[0, 2] * w
            y = rows[k, 1, j] + h[1, 0] * u + h[1, 1] * v + h[1, 2] * w
            z = rows[k, 2, j] + h[2, 0] * u + h[2, 1] * v + h[2, 2] * w
            b[0, j] = u - g[0, 0] * x - g[0, 1] * y - g[0, 2] * z
            b[1, j] = v - g[1, 0] * x - g[1, 1] * y - g[1, 2] * z
            b[2, j] = w - g[2, 0] * x - g[2, 1] * y - g[2, 2] * z
            x *= i0
            y = (y - l10 * x) * i1
            rows[k, 0, j] = x
            rows[k, 1, j] = y
            rows[k, 2, j] = (z - l20 * x - l21 * y) * i2
    return b
