"""Attitude and latitude of many set-ups by maximum likelihood, with covariance.

The four numbers of a set-up are ``y = b + A (w, f)``, rates in the first two, specific forces in
the last two, of the Earth's rate ``w = C_bn (0, cos L, sin L) w_ie`` and ``f = C_bn (0, 0, g)``;
with ``D = A C_bn`` that is ``b + w_ie (D_N cos L + D_U sin L)`` and ``b + g D_U``. Gauss-Newton,
with the latitude known before as one number more::

    J' W J s = J' W r        C_bn <- C_bn exp([phi x]), L <- L + dL, (phi, dL) = s

so that no attitude is singular: ``d (C v) = C (phi x v)``. A step that does not lower the sum of
squares is halved.

Set-ups go through a step together, in groups, and without a branch, so that an instruction takes
several of them; one that has settled stays as it is. Their numbers lie in one flat array, row by
row, for only then is it known that none is another. Status: see `north_seeking`.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel
from foucault.kernels.north_seeking import NOT_CONVERGED, NOT_FINITE, SINGULAR, SOLVED
from foucault.kernels.rotation import atan2

GOING = -1.0
"""Status of a set-up that has not settled yet."""

LEAST = 1e-18
"""Variance of a latitude that is known exactly [rad^2]."""

DISTINCT = 1e-5
"""Solutions nearer than this are one [rad]."""

AGAINST = 1e3
"""What speaks against the opposite hemisphere, or a case that hangs upside down, which two
components of gravity cannot tell from one that stands [1]."""

DEFAULT = 1e-3
"""What speaks against the other sign of the rate along z_b, where both give the same hemisphere:
less than anything that is known, more than rounding [1]."""

UNSETTLED = 1e6
"""What speaks against an unfinished solution, which is better than none [1]."""

HALVINGS = 12.0
"""Times that a step is halved at most [1]."""

UNSEEN = 1e-13
"""A pivot of normal equations of unit diagonal that is no larger is none [1]."""

LANES = 32
"""Set-ups that go through a step together: what they need stays in the cache [1]."""

# Where in the room of a group each number of its first set-up stands. First what a solution is,
# then what it is made of, then how far it is, then its covariance and gain.
(
    C00, C01, C02, C10, C11, C12, C20, C21, C22, LAT, MISS, STATE,
    PSI, THETA, GAMMA,
    Y0, Y1, Y2, Y3, W00, W10, W11, W20, W21, W22, W30, W31, W32, W33, G, NORTH, KNOWN,
    SL, CL, SHARE, HALVED, STEPS,
) = range(0, 37 * LANES, LANES)  # fmt: skip
COV = 37 * LANES  # lower triangle of (4, 4)
GAIN = COV + 10 * LANES  # (4, 5)
ROOM = GAIN + 20 * LANES
FOUND = 15  # Rows that a solution is: rotation to angles.


@kernel
def likelihood_batch(
    y, cov, starts, A, b, g, earth_rate, latitude, latitude_sd, sign, near, near_sd, rounds,
    angles, P, gain, square, rank, other, other_rank, status,
):  # fmt: skip
    """Solve n set-ups by maximum likelihood of the four numbers and the latitude known before.

    Of the solutions from several starts the best counts, and the next best that is another one.

    Parameters: y (n, 4) rates along x_b, y_b and specific forces along them [SI]; cov (n, 4, 4);
    starts (s, n, 4) heading, pitch, roll, latitude [rad]; A (4, 3), b (4,) the model y = A w + b of
    the gyro in the first two rows and y = A f + b in the last two; g (n,) [m/s^2]; earth_rate
    [rad/s]; latitude, latitude_sd (n,) known before, sd infinite where not [rad]; sign of the
    hemisphere where it is not; near (n,) a rough heading, NaN where there is none, good to near_sd
    [rad]; rounds.

    Fills angles (n, 4) as starts; P (n, 4, 4) their covariance [rad^2]; gain (n, 4, 5): slope of
    each angle against the four numbers [1/SI] and the latitude [1]; square (n,) sum of squares, and
    rank (n,) what speaks against the solution beside; other (n, 4), other_rank (n,) of the next
    best, NaN and infinite where there is none; status (n,).
    """
    m = len(starts)
    Z, F = np.empty(ROOM), np.empty((m, FOUND * LANES))
    each, best = np.empty((m, LANES)), np.empty(LANES, np.int64)
    for first in range(0, len(y), LANES):
        n = min(LANES, len(y) - first)
        unknown = False
        for j in range(n):
            i = first + j
            for p in range(4):
                Z[Y0 + p * LANES + j] = y[i, p]
                for q in range(p + 1):
                    Z[W00 + (p * (p + 1) // 2 + q) * LANES + j] = cov[i, p, q]
            Z[G + j], Z[NORTH + j] = g[i], latitude[i]
            known = math.isfinite(latitude_sd[i])
            Z[KNOWN + j] = 1.0 / latitude_sd[i] ** 2 if known else 0.0
            unknown = unknown or not known
        _weigh(Z, n)
        for k in range(m):
            for j in range(n):
                i = first + j
                Z[PSI + j], Z[THETA + j] = starts[k, i, 0], starts[k, i, 1]
                Z[GAMMA + j], Z[LAT + j] = starts[k, i, 2], starts[k, i, 3]
            if _begin(Z, n, earth_rate) > 0:
                while _step(Z, n, A, b, earth_rate, rounds) > 0:
                    pass
            _angles(Z, n)
            if unknown:
                _uncertainty(Z, n, A, earth_rate)
            for j in range(n):
                each[k, j] = _against(Z, j, sign, near[first + j], near_sd)
                for r in range(FOUND):
                    F[k, r * LANES + j] = Z[r * LANES + j]
        for j in range(n):
            i = first + j
            best[j], rank[i] = -1, np.inf
            for k in range(m):
                there = F[k, STATE + j] != NOT_FINITE
                if there and (best[j] < 0 or each[k, j] < rank[i]):
                    best[j], rank[i] = k, each[k, j]
            at = max(best[j], 0)
            for r in range(FOUND):
                Z[r * LANES + j] = F[at, r * LANES + j]
        _uncertainty(Z, n, A, earth_rate)
        for j in range(n):
            i = first + j
            there = best[j] >= 0
            status[i] = int(Z[STATE + j]) if there else NOT_FINITE
            square[i] = Z[MISS + j] if there else np.nan
            for p in range(4):
                angles[i, p] = Z[(LAT if p == 3 else PSI + p * LANES) + j] if there else np.nan
                other[i, p] = np.nan
                for q in range(4):
                    r = p * (p + 1) // 2 + q if q <= p else q * (q + 1) // 2 + p
                    P[i, p, q] = Z[COV + r * LANES + j] if there else np.nan
                for q in range(5):
                    gain[i, p, q] = Z[GAIN + (5 * p + q) * LANES + j] if there else np.nan
            other_rank[i] = np.inf
            for k in range(m if there else 0):
                if F[k, STATE + j] == SOLVED and each[k, j] < other_rank[i]:
                    turn = abs(F[k, PSI + j] - angles[i, 0])
                    turn = min(turn, 2.0 * math.pi - turn)
                    if max(turn, abs(F[k, LAT + j] - angles[i, 3])) > DISTINCT:
                        other_rank[i] = each[k, j]
                        for p in range(4):
                            other[i, p] = F[k, (LAT if p == 3 else PSI + p * LANES) + j]


@inlined
def _weigh(Z, n):
    """Replace the covariances of n set-ups, lower triangles, by their inverse; NaN without one."""
    for j in range(n):
        a, b, c = Z[W00 + j], Z[W10 + j], Z[W11 + j]
        d, e, f = Z[W20 + j], Z[W21 + j], Z[W22 + j]
        h, k, m, o = Z[W30 + j], Z[W31 + j], Z[W32 + j], Z[W33 + j]
        u0 = _over_root(a)
        l10, l20, l30 = b * u0, d * u0, h * u0
        c1 = c - l10 * l10
        u1 = _over_root(c1)
        l21, l31 = (e - l20 * l10) * u1, (k - l30 * l10) * u1
        c2 = f - l20 * l20 - l21 * l21
        u2 = _over_root(c2)
        l32 = (m - l30 * l20 - l31 * l21) * u2
        c3 = o - l30 * l30 - l31 * l31 - l32 * l32
        u3 = _over_root(c3)
        fine = (a > 0.0) & (c1 > UNSEEN * c) & (c2 > UNSEEN * f) & (c3 > UNSEEN * o)
        # The inverse of L, then of L L'.
        v10, v21, v32 = -l10 * u0 * u1, -l21 * u1 * u2, -l32 * u2 * u3
        v20 = -(l20 * u0 + l21 * v10) * u2
        v31 = -(l31 * u1 + l32 * v21) * u3
        v30 = -(l30 * u0 + l31 * v10 + l32 * v20) * u3
        Z[W00 + j] = u0 * u0 + v10 * v10 + v20 * v20 + v30 * v30 if fine else np.nan
        Z[W10 + j] = u1 * v10 + v21 * v20 + v31 * v30
        Z[W11 + j] = u1 * u1 + v21 * v21 + v31 * v31
        Z[W20 + j] = u2 * v20 + v32 * v30
        Z[W21 + j] = u2 * v21 + v32 * v31
        Z[W22 + j] = u2 * u2 + v32 * v32
        Z[W30 + j], Z[W31 + j], Z[W32 + j], Z[W33 + j] = u3 * v30, u3 * v31, u3 * v32, u3 * u3


@inlined
def _begin(Z, n, earth_rate):
    """Fill rotations and rates of n set-ups from their angles; return how many can be solved."""
    going = 0
    for j in range(n):
        total = Z[Y0 + j] + Z[Y1 + j] + Z[Y2 + j] + Z[Y3 + j] + Z[W00 + j]
        total += Z[PSI + j] + Z[THETA + j] + Z[GAMMA + j] + Z[LAT + j]
        fine = math.isfinite(total)
        Z[STATE + j] = GOING if fine else NOT_FINITE
        going += fine
    for j in range(n):
        fine = Z[STATE + j] == GOING
        sf, cf = _sincos(Z[PSI + j] if fine else 0.0)
        st, ct = _sincos(Z[THETA + j] if fine else 0.0)
        sg, cg = _sincos(Z[GAMMA + j] if fine else 0.0)
        sl, cl = _sincos(Z[LAT + j] if fine else 0.0)
        Z[C00 + j], Z[C01 + j] = cg * cf + sg * st * sf, sg * st * cf - cg * sf
        Z[C02 + j], Z[C10 + j], Z[C11 + j], Z[C12 + j] = -sg * ct, ct * sf, ct * cf, st
        Z[C20 + j], Z[C21 + j] = sg * cf - cg * st * sf, -sg * sf - cg * st * cf
        Z[C22 + j], Z[SL + j], Z[CL + j] = cg * ct, earth_rate * sl, earth_rate * cl
        Z[LAT + j] = Z[LAT + j] if fine else 0.0
        Z[SHARE + j], Z[HALVED + j], Z[STEPS + j], Z[MISS + j] = 1.0, 0.0, 0.0, np.inf
    return going


@inlined
def _step(Z, n, A, b, earth_rate, rounds):
    """Take n set-ups a step on, where they have not settled; return how many still have not."""
    a00, a01, a02, a10, a11, a12 = A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2]
    a20, a21, a22, a30, a31, a32 = A[2, 0], A[2, 1], A[2, 2], A[3, 0], A[3, 1], A[3, 2]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    most = float(rounds)
    for j in range(n):
        c00, c01, c02 = Z[C00 + j], Z[C01 + j], Z[C02 + j]
        c10, c11, c12 = Z[C10 + j], Z[C11 + j], Z[C12 + j]
        c20, c21, c22 = Z[C20 + j], Z[C21 + j], Z[C22 + j]
        lat, sl, cl, g = Z[LAT + j], Z[SL + j], Z[CL + j], Z[G + j]
        y0, y1, y2, y3 = Z[Y0 + j], Z[Y1 + j], Z[Y2 + j], Z[Y3 + j]
        W = _weights(Z, j)
        north, known, share = Z[NORTH + j], Z[KNOWN + j], Z[SHARE + j]
        # What is left, W times that, and the sum of squares.
        n0, u0 = a00 * c01 + a01 * c11 + a02 * c21, a00 * c02 + a01 * c12 + a02 * c22
        n1, u1 = a10 * c01 + a11 * c11 + a12 * c21, a10 * c02 + a11 * c12 + a12 * c22
        n2, u2 = a20 * c01 + a21 * c11 + a22 * c21, a20 * c02 + a21 * c12 + a22 * c22
        n3, u3 = a30 * c01 + a31 * c11 + a32 * c21, a30 * c02 + a31 * c12 + a32 * c22
        r0, r1 = y0 - (b0 + cl * n0 + sl * u0), y1 - (b1 + cl * n1 + sl * u1)
        r2, r3 = y2 - (b2 + g * u2), y3 - (b3 + g * u3)
        q0, q1, q2, q3 = _times(W, r0, r1, r2, r3)
        far = north - lat
        now = r0 * q0 + r1 * q1 + r2 * q2 + r3 * q3 + known * far * far
        # Slopes against phi (E, N, U) and latitude: specific force sees tilt alone.
        e0, e1 = a00 * c00 + a01 * c10 + a02 * c20, a10 * c00 + a11 * c10 + a12 * c20
        e2, e3 = a20 * c00 + a21 * c10 + a22 * c20, a30 * c00 + a31 * c10 + a32 * c20
        x0, x1, x2, x3 = u0 * cl - n0 * sl, u1 * cl - n1 * sl, -n2 * g, -n3 * g
        z0, z1, z2, z3 = e0 * sl, e1 * sl, e2 * g, e3 * g
        t0, t1 = -e0 * cl, -e1 * cl
        s0 = x0 * q0 + x1 * q1 + x2 * q2 + x3 * q3
        s1 = z0 * q0 + z1 * q1 + z2 * q2 + z3 * q3
        s2 = t0 * q0 + t1 * q1
        s3 = x0 * q0 + x1 * q1 + known * far
        d0, d1, d2, d3, m10, m20, m21, m30, m31, m32 = _normal(
            x0, x1, x2, x3, z0, z1, z2, z3, t0, t1, W, known
        )
        fine, v1, v2, v3, l21, l31, l32 = _factor(m10, m20, m21, m30, m31, m32)
        fine = fine & (d0 > 0.0) & (d1 > 0.0) & (d2 > 0.0) & (d3 > 0.0)
        s0 = s0 * d0
        s1 = (s1 * d1 - m10 * s0) * v1
        s2 = (s2 * d2 - m20 * s0 - l21 * s1) * v2
        s3 = (s3 * d3 - m30 * s0 - l31 * s1 - l32 * s2) * v3
        s3 = s3 * v3
        s2 = (s2 - l32 * s3) * v2
        s1 = (s1 - l21 * s2 - l31 * s3) * v1
        s0 = (s0 - m10 * s1 - m20 * s2 - m30 * s3) * d0
        s1, s2, s3 = s1 * d1, s2 * d2, s3 * d3
        moved = s0 * s0 + s1 * s1 + s2 * s2 + s3 * s3
        # C exp([phi x]): rows times phi, and that times phi.
        px, py, pz = share * s0, share * s1, share * s2
        half = 0.5 * math.sqrt(px * px + py * py + pz * pz)
        sh, ch = _sincos(half)
        over = sh / half if half > 1e-9 else 1.0
        along, across = over * ch, 0.5 * over * over
        i0, i1, i2 = c01 * pz - c02 * py, c02 * px - c00 * pz, c00 * py - c01 * px
        k0, k1, k2 = c11 * pz - c12 * py, c12 * px - c10 * pz, c10 * py - c11 * px
        o0, o1, o2 = c21 * pz - c22 * py, c22 * px - c20 * pz, c20 * py - c21 * px
        t00 = c00 + along * i0 + across * (i1 * pz - i2 * py)
        t01 = c01 + along * i1 + across * (i2 * px - i0 * pz)
        t02 = c02 + along * i2 + across * (i0 * py - i1 * px)
        t10 = c10 + along * k0 + across * (k1 * pz - k2 * py)
        t11 = c11 + along * k1 + across * (k2 * px - k0 * pz)
        t12 = c12 + along * k2 + across * (k0 * py - k1 * px)
        t20 = c20 + along * o0 + across * (o1 * pz - o2 * py)
        t21 = c21 + along * o1 + across * (o2 * px - o0 * pz)
        t22 = c22 + along * o2 + across * (o0 * py - o1 * px)
        trial = lat + share * s3
        sn, cn = _sincos(trial)
        sn, cn = earth_rate * sn, earth_rate * cn
        n0, u0 = a00 * t01 + a01 * t11 + a02 * t21, a00 * t02 + a01 * t12 + a02 * t22
        n1, u1 = a10 * t01 + a11 * t11 + a12 * t21, a10 * t02 + a11 * t12 + a12 * t22
        r0, r1 = y0 - (b0 + cn * n0 + sn * u0), y1 - (b1 + cn * n1 + sn * u1)
        r2 = y2 - (b2 + g * (a20 * t02 + a21 * t12 + a22 * t22))
        r3 = y3 - (b3 + g * (a30 * t02 + a31 * t12 + a32 * t22))
        q0, q1, q2, q3 = _times(W, r0, r1, r2, r3)
        far = north - trial
        new = r0 * q0 + r1 * q1 + r2 * q2 + r3 * q3 + known * far * far
        # Where no step helps it is the minimum, to rounding, unless the step was a large one.
        state, halved, steps = Z[STATE + j], Z[HALVED + j], Z[STEPS + j]
        going = state == GOING
        better = fine & (new <= now * (1.0 + 1e-12) + 1e-12)
        small = (moved * share * share < 1e-18) | ((now - new < 1e-10) & (moved < 1e-12))
        given_up = fine & (not better) & (halved >= HALVINGS - 1.0)
        at_end = better & (not small) & (steps >= most - 1.0)
        settled = (better & small) | (given_up & (moved < 1e-8))
        then = SINGULAR if not fine else GOING
        then = NOT_CONVERGED if given_up | at_end else then
        then = SOLVED if settled else then
        Z[STATE + j] = then if going else state
        taken = going & better
        Z[MISS + j] = (new if better else now) if going else Z[MISS + j]
        Z[SHARE + j] = 1.0 if taken else 0.5 * share
        Z[HALVED + j] = 0.0 if taken else halved + 1.0
        Z[STEPS + j] = steps + 1.0 if taken else steps
        Z[C00 + j], Z[C01 + j] = t00 if taken else c00, t01 if taken else c01
        Z[C02 + j], Z[C10 + j] = t02 if taken else c02, t10 if taken else c10
        Z[C11 + j], Z[C12 + j] = t11 if taken else c11, t12 if taken else c12
        Z[C20 + j], Z[C21 + j] = t20 if taken else c20, t21 if taken else c21
        Z[C22 + j], Z[LAT + j] = t22 if taken else c22, trial if taken else lat
        Z[SL + j], Z[CL + j] = sn if taken else sl, cn if taken else cl
    count = 0
    for j in range(n):
        count += Z[STATE + j] == GOING
    return count


@inlined
def _weights(Z, j):
    """Return the lower triangle of the weights of set-up j, row by row."""
    return (Z[W00 + j], Z[W10 + j], Z[W11 + j], Z[W20 + j], Z[W21 + j], Z[W22 + j],
            Z[W30 + j], Z[W31 + j], Z[W32 + j], Z[W33 + j])  # fmt: skip


@inlined
def _times(W, x0, x1, x2, x3):
    """Return W x, of the lower triangle of W."""
    w00, w10, w11, w20, w21, w22, w30, w31, w32, w33 = W
    return (
        w00 * x0 + w10 * x1 + w20 * x2 + w30 * x3,
        w10 * x0 + w11 * x1 + w21 * x2 + w31 * x3,
        w20 * x0 + w21 * x1 + w22 * x2 + w32 * x3,
        w30 * x0 + w31 * x1 + w32 * x2 + w33 * x3,
    )


@inlined
def _normal(x0, x1, x2, x3, z0, z1, z2, z3, t0, t1, W, known):
    """Return what scales J' W J and the latitude known before to a unit diagonal, and the rest.

    The columns of J are x, z, (t0, t1, 0, 0) and (x0, x1, 0, 0).
    """
    i0, i1, i2, i3 = _times(W, x0, x1, x2, x3)
    k0, k1, k2, k3 = _times(W, z0, z1, z2, z3)
    w00, w10, w11 = W[0], W[1], W[2]
    o0, o1 = w00 * t0 + w10 * t1, w10 * t0 + w11 * t1
    d0 = _over_root(x0 * i0 + x1 * i1 + x2 * i2 + x3 * i3)
    d1 = _over_root(z0 * k0 + z1 * k1 + z2 * k2 + z3 * k3)
    d2 = _over_root(t0 * o0 + t1 * o1)
    d3 = _over_root(w00 * x0 * x0 + 2.0 * w10 * x0 * x1 + w11 * x1 * x1 + known)
    m10 = (x0 * k0 + x1 * k1 + x2 * k2 + x3 * k3) * d0 * d1
    m20, m21 = (t0 * i0 + t1 * i1) * d0 * d2, (t0 * k0 + t1 * k1) * d1 * d2
    m30, m31 = (x0 * i0 + x1 * i1) * d0 * d3, (x0 * k0 + x1 * k1) * d1 * d3
    m32 = (x0 * o0 + x1 * o1) * d2 * d3
    return d0, d1, d2, d3, m10, m20, m21, m30, m31, m32


@inlined
def _factor(m10, m20, m21, m30, m31, m32):
    """Return whether a matrix of unit diagonal has a Cholesky factor L, and what of it is new.

    One over its diagonal stands for that; its first column is that of the matrix.
    """
    p1 = 1.0 - m10 * m10
    v1 = _over_root(p1)
    l21, l31 = (m21 - m20 * m10) * v1, (m31 - m30 * m10) * v1
    p2 = 1.0 - m20 * m20 - l21 * l21
    v2 = _over_root(p2)
    l32 = (m32 - m30 * m20 - l31 * l21) * v2
    p3 = 1.0 - m30 * m30 - l31 * l31 - l32 * l32
    v3 = _over_root(p3)
    fine = (p1 > UNSEEN) & (p2 > UNSEEN) & (p3 > UNSEEN)
    return fine, v1, v2, v3, l21, l31, l32


@inlined
def _angles(Z, n):
    """Fill heading, pitch, roll and latitude of the rotations of n set-ups."""
    for j in range(n):
        lat = Z[LAT + j]
        over = abs(lat) > 0.5 * math.pi  # over the pole: the same rate, turned
        lat = math.copysign(math.pi, lat) - lat if over else lat
        c00, c01, c10, c11 = Z[C00 + j], Z[C01 + j], Z[C10 + j], Z[C11 + j]
        c20, c21, c02, c12, c22 = Z[C20 + j], Z[C21 + j], Z[C02 + j], Z[C12 + j], Z[C22 + j]
        c00, c01 = -c00 if over else c00, -c01 if over else c01
        c10, c11 = -c10 if over else c10, -c11 if over else c11
        c20, c21 = -c20 if over else c20, -c21 if over else c21
        psi = atan2(c10, c11)
        Z[PSI + j] = psi if psi >= 0.0 else psi + 2.0 * math.pi
        Z[THETA + j] = atan2(c12, math.sqrt(c02 * c02 + c22 * c22))
        Z[GAMMA + j] = atan2(-c02, c22)
        Z[C00 + j], Z[C01 + j], Z[C10 + j], Z[C11 + j] = c00, c01, c10, c11
        Z[C20 + j], Z[C21 + j], Z[LAT + j] = c20, c21, lat


@inlined
def _against(Z, j, sign, near, near_sd):
    """Return the sum of squares of set-up j with what speaks against its solution."""
    against = 0.0 if Z[STATE + j] == SOLVED else UNSETTLED  # better than none
    lat = Z[LAT + j]
    if Z[KNOWN + j] == 0.0:  # the other side of the equator, in squares of a sd
        beyond = max(-sign * lat, 0.0)
        variance = max(Z[COV + 9 * LANES + j], LEAST)
        against += min(beyond * beyond / variance, AGAINST)
        along = Z[C21 + j] * math.cos(lat) + Z[C22 + j] * math.sin(lat)
        against += DEFAULT if sign * along < 0.0 else 0.0
    if abs(Z[GAMMA + j]) > 0.5 * math.pi:
        against += AGAINST
    if math.isfinite(near):
        against += 2.0 * (1.0 - math.cos(Z[PSI + j] - near)) / near_sd**2
    return Z[MISS + j] + against if math.isfinite(Z[MISS + j]) else np.inf


@inlined
def _uncertainty(Z, n, A, earth_rate):
    """Fill covariance and gain of heading, pitch, roll and latitude of n set-ups."""
    a00, a01, a02, a10, a11, a12 = A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2]
    a20, a21, a22, a30, a31, a32 = A[2, 0], A[2, 1], A[2, 2], A[3, 0], A[3, 1], A[3, 2]
    for j in range(n):
        c00, c01, c02 = Z[C00 + j], Z[C01 + j], Z[C02 + j]
        c10, c11, c12 = Z[C10 + j], Z[C11 + j], Z[C12 + j]
        c20, c21, c22 = Z[C20 + j], Z[C21 + j], Z[C22 + j]
        g, known = Z[G + j], Z[KNOWN + j]
        W = _weights(Z, j)
        sl, cl = _sincos(Z[LAT + j])
        sl, cl = earth_rate * sl, earth_rate * cl
        e0, e1 = a00 * c00 + a01 * c10 + a02 * c20, a10 * c00 + a11 * c10 + a12 * c20
        e2, e3 = a20 * c00 + a21 * c10 + a22 * c20, a30 * c00 + a31 * c10 + a32 * c20
        n0, u0 = a00 * c01 + a01 * c11 + a02 * c21, a00 * c02 + a01 * c12 + a02 * c22
        n1, u1 = a10 * c01 + a11 * c11 + a12 * c21, a10 * c02 + a11 * c12 + a12 * c22
        n2, n3 = a20 * c01 + a21 * c11 + a22 * c21, a30 * c01 + a31 * c11 + a32 * c21
        x0, x1, x2, x3 = u0 * cl - n0 * sl, u1 * cl - n1 * sl, -n2 * g, -n3 * g
        z0, z1, z2, z3 = e0 * sl, e1 * sl, e2 * g, e3 * g
        t0, t1 = -e0 * cl, -e1 * cl
        d0, d1, d2, d3, m10, m20, m21, m30, m31, m32 = _normal(
            x0, x1, x2, x3, z0, z1, z2, z3, t0, t1, W, known
        )
        fine, v1, v2, v3, l21, l31, l32 = _factor(m10, m20, m21, m30, m31, m32)
        fine = fine & (d0 > 0.0) & (d1 > 0.0) & (d2 > 0.0) & (d3 > 0.0)
        # The inverse of L, then the covariance of phi and latitude.
        k10, k21, k32 = -m10 * v1, -l21 * v1 * v2, -l32 * v2 * v3
        k20, k31 = -(m20 + l21 * k10) * v2, -(l31 * v1 + l32 * k21) * v3
        k30 = -(m30 + l31 * k10 + l32 * k20) * v3
        h00 = (1.0 + k10 * k10 + k20 * k20 + k30 * k30) * d0 * d0
        h10 = (v1 * k10 + k21 * k20 + k31 * k30) * d1 * d0
        h11 = (v1 * v1 + k21 * k21 + k31 * k31) * d1 * d1
        h20, h21 = (v2 * k20 + k32 * k30) * d2 * d0, (v2 * k21 + k32 * k31) * d2 * d1
        h22, h30 = (v2 * v2 + k32 * k32) * d2 * d2, v3 * k30 * d3 * d0
        h31, h32, h33 = v3 * k31 * d3 * d1, v3 * k32 * d3 * d2, v3 * v3 * d3 * d3
        # Slopes of heading, pitch and roll, first against a small rotation of the case,
        # C_bn <- (I - [phi_b x]) C_bn, then against phi: phi_b = -C_bn phi.
        ct = math.sqrt(c02 * c02 + c22 * c22)
        sg, cg, t = -c02 / ct, c22 / ct, c12 / ct
        k0, k1, k2 = cg * c20 - sg * c00, cg * c21 - sg * c01, cg * c22 - sg * c02
        f00, f01, f02 = k0 / ct, k1 / ct, k2 / ct
        f10, f11, f12 = -cg * c00 - sg * c20, -cg * c01 - sg * c21, -cg * c02 - sg * c22
        f20, f21, f22 = t * k0 - c10, t * k1 - c11, t * k2 - c12
        # Those times the covariance; the last angle is the latitude itself.
        i0, i1 = f00 * h00 + f01 * h10 + f02 * h20, f00 * h10 + f01 * h11 + f02 * h21
        i2, i3 = f00 * h20 + f01 * h21 + f02 * h22, f00 * h30 + f01 * h31 + f02 * h32
        k0, k1 = f10 * h00 + f11 * h10 + f12 * h20, f10 * h10 + f11 * h11 + f12 * h21
        k2, k3 = f10 * h20 + f11 * h21 + f12 * h22, f10 * h30 + f11 * h31 + f12 * h32
        o0, o1 = f20 * h00 + f21 * h10 + f22 * h20, f20 * h10 + f21 * h11 + f22 * h21
        o2, o3 = f20 * h20 + f21 * h21 + f22 * h22, f20 * h30 + f21 * h31 + f22 * h32
        P10, P20 = k0 * f00 + k1 * f01 + k2 * f02, o0 * f00 + o1 * f01 + o2 * f02
        P21 = o0 * f10 + o1 * f11 + o2 * f12
        Z[COV + j] = i0 * f00 + i1 * f01 + i2 * f02 if fine else np.inf
        Z[COV + LANES + j] = P10 if fine else np.inf
        Z[COV + 2 * LANES + j] = k0 * f10 + k1 * f11 + k2 * f12 if fine else np.inf
        Z[COV + 3 * LANES + j] = P20 if fine else np.inf
        Z[COV + 4 * LANES + j] = P21 if fine else np.inf
        Z[COV + 5 * LANES + j] = o0 * f20 + o1 * f21 + o2 * f22 if fine else np.inf
        Z[COV + 6 * LANES + j] = i3 if fine else np.inf
        Z[COV + 7 * LANES + j] = k3 if fine else np.inf
        Z[COV + 8 * LANES + j] = o3 if fine else np.inf
        Z[COV + 9 * LANES + j] = h33 if fine else np.inf
        # The rows of J times that, then W; NaN where there is none.
        none = 0.0 if fine else np.nan
        for_x, for_z = (x0, x1, x2, x3), (z0, z1, z2, z3)
        _gain(Z, GAIN + j, i0 + none, i1, i2, i3, known, for_x, for_z, t0, t1, W)
        _gain(Z, GAIN + 5 * LANES + j, k0 + none, k1, k2, k3, known, for_x, for_z, t0, t1, W)
        _gain(Z, GAIN + 10 * LANES + j, o0 + none, o1, o2, o3, known, for_x, for_z, t0, t1, W)
        _gain(Z, GAIN + 15 * LANES + j, h30 + none, h31, h32, h33, known, for_x, for_z, t0, t1, W)


@inlined
def _gain(Z, at, v0, v1, v2, v3, known, x, z, t0, t1, W):
    """Fill the slopes of an angle against the four numbers and the latitude.

    `v0` to `v3`: its slope times the covariance of phi and latitude; `x`, `z`, (t0, t1, 0, 0): the
    columns of J, as of `_normal`.
    """
    x0, x1, x2, x3 = x
    z0, z1, z2, z3 = z
    o0, o1 = (v0 + v3) * x0 + v1 * z0 + v2 * t0, (v0 + v3) * x1 + v1 * z1 + v2 * t1
    o2, o3 = v0 * x2 + v1 * z2, v0 * x3 + v1 * z3
    o0, o1, o2, o3 = _times(W, o0, o1, o2, o3)
    Z[at], Z[at + LANES], Z[at + 2 * LANES], Z[at + 3 * LANES] = o0, o1, o2, o3
    Z[at + 4 * LANES] = v3 * known + 0.0 * v0


@inlined
def _over_root(x):
    """Return one over the root of a positive number, NaN of another."""
    return 1.0 / math.sqrt(x) if x > 0.0 else np.nan


@inlined
def _sincos(x):
    """Return sine and cosine of a number up to 1e5, to 2e-16, without a branch.

    Polynomials of S. L. Moshier's Cephes library (sin.c), of what is left over quarters of a turn.
    """
    k = x * (2.0 / math.pi) + WHOLE - WHOLE
    x = x - k * QUARTER_1 - k * QUARTER_2 - k * QUARTER_3
    z = x * x
    s = 1.58962301576546568060e-10 * z - 2.50507477628578072866e-8
    s = ((s * z + 2.75573136213857245213e-6) * z - 1.98412698295895385996e-4) * z
    s = x + x * z * ((s + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1)
    c = -1.13585365213876817300e-11 * z + 2.08757008419747316778e-9
    c = ((c * z - 2.75573141792967388112e-7) * z + 2.48015872888517045348e-5) * z
    c = ((c - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2) * z * z
    c = 1.0 - 0.5 * z + c
    k = k - 4.0 * (0.25 * k + WHOLE - WHOLE)  # -2 to 2
    odd, back = abs(k) == 1.0, abs(k) == 2.0
    sine, cosine = c if odd else s, s if odd else c
    sine = -sine if back | (k == -1.0) else sine
    cosine = -cosine if back | (k == 1.0) else cosine
    return sine, cosine


WHOLE = 1.5 * 2.0**52
"""Added and taken off, it leaves the nearest whole number."""

QUARTER_1, QUARTER_2, QUARTER_3 = (
    1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21,
)  # fmt: skip
"""Parts of a quarter of a turn; whole numbers times the first two are exact."""
