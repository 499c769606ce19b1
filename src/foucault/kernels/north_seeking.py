"""North seeking of many set-ups at once: the closed form, and maximum likelihood, with covariance.

M and N are the rates along y_b and x_b over the Earth's rate. Status: 0 solved; 1 solved, with
M^2 + N^2 above 1 taken as 1; 2 not converged; 3 singular (an attitude that the readings do not
determine); 4 not finite.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel, part
from foucault.kernels.rotation import atan2
from foucault.kernels.small_matrices import cholesky, invert, substitute

SOLVED, CLAMPED, NOT_CONVERGED, SINGULAR, NOT_FINITE = 0, 1, 2, 3, 4

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


@kernel
def closed_form_batch(
    rate, up, latitude, sign, earth_rate, rate_var, tilt_var, latitude_var, angles, sd, status
):
    """Solve n set-ups in closed form; one call for all with the latitude known, or for unknown.

    All tables are flat: only then is it known how far apart their rows are, and several are solved
    at once. Parameters: rate (n 2,) compensated rate along x_b, y_b [rad/s]; up (n 2,) up along
    x_b, y_b [1]; latitude [rad], NaN where unknown; sign +1 or -1 of the rate along z_b (only where
    latitude is unknown); earth_rate [rad/s]; rate_var [rad^2/s^2], tilt_var [1] variance of each
    component; latitude_var [rad^2].

    Fills angles (n 4,): heading, pitch, roll, latitude [rad]; sd (n 4,) [rad]; status (n,).
    """
    n = len(status)
    scale = 1.0 / earth_rate
    rate_var = rate_var * scale * scale
    tilt_sd, latitude_sd = math.sqrt(tilt_var), math.sqrt(latitude_var)
    known = not math.isnan(latitude)
    sl, cl = math.sin(latitude), math.cos(latitude)
    for i in range(n):  # without a branch, so that several are solved at once
        e, m, x, s = rate[2 * i] * scale, rate[2 * i + 1] * scale, up[2 * i], up[2 * i + 1]
        finite = math.isfinite(e + m + s + x)
        solved = finite & (1.0 - s * s - x * x > 0.0)
        code = SOLVED if solved else SINGULAR if finite else NOT_FINITE
        m = m if solved else 0.5  # anything that can be solved
        e, x, s = e if solved else 0.0, x if solved else 0.0, s if solved else 0.0
        c2 = 1.0 - s * s
        g2 = c2 - x * x  # (cos pitch cos roll)^2
        ct, z = math.sqrt(c2), math.sqrt(g2)
        t_s, r_x = 1.0 / ct, -1.0 / z  # slopes of pitch and roll against the two tilts
        sg, cg = -x * t_s, z * t_s
        r_s = -sg * s * r_x * t_s
        square = 1.0 - m * m - e * e
        clamped = solved & (square <= 0.0) & (not known)
        code = CLAMPED if clamped else code
        W = sign * math.sqrt(max(square, 0.0))
        inverse = 1.0 / W if square > 0.0 else 0.0
        W = (s * m - sl - sg * ct * e) * r_x if known else W
        Wt = (sg * s * e + ct * m) * r_x + W * s * t_s if known else 0.0
        Wr = e - W * sg * ct * r_x if known else 0.0
        We = -sg * ct * r_x if known else -e * inverse
        Wm = s * r_x if known else -m * inverse
        Wl = -cl * r_x if known else 0.0
        X = cg * e + sg * W
        q = cg * W - sg * e
        Y = ct * m - s * q
        # Heading: dpsi = (X dY - Y dX) / (X^2 + Y^2), with the slopes of X, q and Y.
        h2 = X * X + Y * Y
        over = 1.0 / h2
        a, b = -Y * over, X * over
        qe, qm, qt = cg * We - sg, cg * Wm, cg * Wt
        qr = cg * Wr - cg * e - sg * W
        # d psi / d (N, M, pitch, roll), then through the tilts
        pe = a * (cg + sg * We) - b * s * qe
        pm = a * sg * Wm + b * (ct - s * qm)
        pt = a * sg * Wt - b * (s * m + ct * q + s * qt)
        pr = a * (q + sg * Wr) - b * s * qr
        ps, px = pt * t_s + pr * r_s, pr * r_x
        pl = (a * sg - b * s * cg) * Wl
        variance = (pe * pe + pm * pm) * rate_var + (ps * ps + px * px) * tilt_var
        variance += pl * pl * latitude_var
        # dL = dZ / h, as the three components keep their norm where they are not clamped
        Z = s * m + ct * q
        ze, zm = ct * qe, s + ct * qm
        zt, zr = ct * m - s * q + ct * qt, ct * qr
        zs, zx = zt * t_s + zr * r_s, zr * r_x
        square = ((ze * ze + zm * zm) * rate_var + (zs * zs + zx * zx) * tilt_var) * over
        heading_sd = np.inf if clamped else math.sqrt(variance)  # W has no slope there
        place_sd = np.inf if clamped else math.sqrt(square)
        place = latitude if known else atan2(Z, math.sqrt(h2))
        place_sd = latitude_sd if known else place_sd
        psi = atan2(-X, Y)
        psi = psi if psi >= 0.0 else psi + 2.0 * math.pi
        status[i] = code
        angles[4 * i] = psi if solved else np.nan
        angles[4 * i + 1] = atan2(s, ct) if solved else np.nan
        angles[4 * i + 2] = atan2(sg, cg) if solved else np.nan
        angles[4 * i + 3] = place if solved else np.nan
        sd[4 * i] = heading_sd if solved else np.nan
        sd[4 * i + 1] = tilt_sd * t_s if solved else np.nan
        sd[4 * i + 2] = tilt_sd * math.sqrt(r_s * r_s + r_x * r_x) if solved else np.nan
        sd[4 * i + 3] = place_sd if solved else np.nan


@kernel
def likelihood_batch(
    y, cov, starts, A, b, g, earth_rate, latitude, latitude_sd, sign, near, near_sd, rounds,
    angles, P, gain, square, rank, other, other_rank, status,
):  # fmt: skip
    """Solve n set-ups by maximum likelihood of the four numbers and the latitude known before.

    The rotation is corrected by ``C_bn <- C_bn exp([phi x])``, so that no attitude is singular;
    steps are halved until the sum of squares falls. Of the solutions from several starts the best
    counts, and the next best that is another one.

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
    L, W = np.empty((4, 4)), np.empty((4, 4))
    T, J = np.empty((3, 3)), np.empty((4, 4))
    H, Hinv, E = np.empty((4, 4)), np.empty((4, 4)), np.zeros((4, 4))
    h, r, s, WJ = np.empty(4), np.empty(4), np.empty(4), np.empty((4, 4))
    m = len(starts)
    found, each, settled = np.empty((m, 4)), np.empty(m), np.empty(m, np.int8)
    turns = np.empty((m, 3, 3))
    for i in range(len(y)):
        for p in range(4):
            for q in range(4):
                L[p, q] = cov[i, p, q]
        known = 0.0
        if math.isfinite(latitude_sd[i]):
            known = 1.0 / latitude_sd[i] ** 2
        weighed = cholesky(L, len(L))
        if weighed:
            invert(L, W, len(L))
        best = -1
        for k in range(m):
            start, x, C = starts[k, i], found[k], turns[k]
            settled[k], each[k] = NOT_FINITE, np.inf
            if not (weighed and math.isfinite(y[i].sum() + start.sum())):
                continue
            _attitude(start[0], start[1], start[2], C)
            x[3] = start[3]
            miss, settled[k] = _settle(
                C, x, y[i], A, b, g[i], earth_rate, latitude[i], known, rounds,
                W, T, J, H, h, r, s, WJ,
            )  # fmt: skip
            ct = math.hypot(C[0, 2], C[2, 2])
            psi = math.atan2(C[1, 0], C[1, 1])
            x[0] = psi if psi >= 0.0 else psi + 2.0 * math.pi
            x[1] = math.atan2(C[1, 2], ct)
            x[2] = math.atan2(-C[0, 2], C[2, 2])
            against = 0.0 if settled[k] == SOLVED else UNSETTLED  # better than none
            if known == 0.0:
                _uncertainty(C, x[3], A, g[i], earth_rate, W, known, J, H, Hinv, E, WJ, s, P[i],
                             gain[i])  # fmt: skip
                against += _other_side(C, x[3], sign, P[i, 3, 3])
            if abs(x[2]) > 0.5 * math.pi:
                against += AGAINST
            if math.isfinite(near[i]):
                against += 2.0 * (1.0 - math.cos(x[0] - near[i])) / near_sd**2
            each[k] = miss + against if math.isfinite(miss) else np.inf
            if best < 0 or each[k] < rank[i]:
                best, rank[i], square[i] = k, each[k], miss
        other_rank[i] = np.inf
        for p in range(4):
            other[i, p] = np.nan
        if best < 0:
            status[i] = NOT_FINITE
            square[i], rank[i] = np.nan, np.inf
            for p in range(4):
                angles[i, p] = np.nan
            _fill(P[i], gain[i], np.nan)
            continue
        status[i] = settled[best]
        for p in range(4):
            angles[i, p] = found[best, p]
        _uncertainty(turns[best], angles[i, 3], A, g[i], earth_rate, W, known, J, H, Hinv, E, WJ, s,
                     P[i], gain[i])  # fmt: skip
        for k in range(m):
            if settled[k] == SOLVED and each[k] < other_rank[i]:
                turn = abs(found[k, 0] - angles[i, 0])
                turn = min(turn, 2.0 * math.pi - turn)
                if max(turn, abs(found[k, 3] - angles[i, 3])) > DISTINCT:
                    other_rank[i] = each[k]
                    for p in range(4):
                        other[i, p] = found[k, p]


@kernel
def left_batch(
    angles, g, earth_rate, A, first, cosine, sine, ramp, gyro_weights, accel_weights, on_case,
    sensor, factors, size, B,
):  # fmt: skip
    """Fill what c terms of the sensors do to the four numbers of m set-ups.

    Parameters: angles (m, 4) heading, pitch, roll, latitude [rad]; g (m,) [m/s^2]; earth_rate
    [rad/s]; A (2, 3) of the accelerometers [1]; first (m + 1,) rows of each; cosine, sine (n,) of
    the index angle [1]; ramp (n,) of a drift [1]; gyro_weights (n, 2), accel_weights (n, q, 2) of
    every reading in its set-up [1];
    on_case, whether accelerometers stay with the case; sensor (c,) 0 the gyro, 1 + k the
    accelerometer k, -1 gravity itself; factors (c, 3) the numbers of `models.left_out.Monomial`;
    size (c,) [SI].

    Fills B (m, 4, c) [SI].
    """
    C, v, u = np.empty((3, 3)), np.ones(14), np.ones(14)
    for i in range(len(angles)):
        _attitude(angles[i, 0], angles[i, 1], angles[i, 2], C)
        sl, cl = earth_rate * math.sin(angles[i, 3]), earth_rate * math.cos(angles[i, 3])
        for p in range(3):
            u[1 + p], u[4 + p] = g[i] * C[p, 2], cl * C[p, 1] + sl * C[p, 2]
        for p in range(1, 7):
            u[6 + p], v[p], v[6 + p] = abs(u[p]), u[p], abs(u[p])
        for k in range(len(size)):
            for p in range(4):
                B[i, p, k] = 0.0
                if sensor[k] < 0 and p > 1:
                    for q in range(3):
                        B[i, p, k] += A[p - 2, q] * C[q, 2] * size[k]
        for r in range(first[i], first[i + 1]):
            c, s = cosine[r], sine[r]
            for p in (1, 4):  # axes that turn with the base
                v[p], v[p + 1] = c * u[p] - s * u[p + 1], s * u[p] + c * u[p + 1]
                v[p + 6], v[p + 7] = abs(v[p]), abs(v[p + 1])
            u[13], v[13] = ramp[r], ramp[r]
            for k in range(len(size)):
                a, b, d = factors[k, 0], factors[k, 1], factors[k, 2]
                if sensor[k] == 0:
                    x = size[k] * v[a] * v[b] * v[d]
                    B[i, 0, k] += gyro_weights[r, 0] * x
                    B[i, 1, k] += gyro_weights[r, 1] * x
                elif sensor[k] > 0:
                    x = u[a] * u[b] * u[d] if on_case else v[a] * v[b] * v[d]
                    x *= size[k]
                    B[i, 2, k] += accel_weights[r, sensor[k] - 1, 0] * x
                    B[i, 3, k] += accel_weights[r, sensor[k] - 1, 1] * x


@kernel
def across_batch(y, cov, angles, A, b, g, earth_rate, latitude_sd, T, B, out):
    """Fill the one number of m set-ups that no attitude explains, and what is done to it.

    At right angles to the slopes, whose cofactors that is, over its sd.

    Parameters: y (m, 4), cov (m, 4, 4) [SI]; angles (m, 4), A (4, 3), b (4,), g (m,), earth_rate as
    of `likelihood_batch`; latitude_sd (m,) of what each has by itself [rad]; T (m, 4, 4) or (1, 4,
    4) what of B is in y [1]; B (m, 4, c) [SI].

    Fills out (m, 2 + c): of y, of a latitude 1 rad further north, of B [sd].
    """
    C, J, X = np.empty((3, 3)), np.empty((4, 4)), np.zeros((4, 4))
    h, r, n, t = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(len(y)):
        _attitude(angles[i, 0], angles[i, 1], angles[i, 2], C)
        lat = angles[i, 3]
        sl, cl = earth_rate * math.sin(lat), earth_rate * math.cos(lat)
        _misfit(C, lat, sl, cl, y[i], A, b, g[i], lat, 0.0, X, h, r)
        _slopes(C, sl, cl, A, g[i], J)
        for p in range(4):
            k, m, q = (p + 1) % 4, (p + 2) % 4, (p + 3) % 4
            n[p] = J[k, 0] * (J[m, 1] * J[q, 2] - J[m, 2] * J[q, 1])
            n[p] -= J[k, 1] * (J[m, 0] * J[q, 2] - J[m, 2] * J[q, 0])
            n[p] += J[k, 2] * (J[m, 0] * J[q, 1] - J[m, 1] * J[q, 0])
            n[p] *= 1.0 if p % 2 == 0 else -1.0
        north, variance = 0.0, 0.0
        for p in range(4):
            north += n[p] * J[p, 3]
            for q in range(4):
                variance += n[p] * cov[i, p, q] * n[q]
        variance += (north * latitude_sd[i]) ** 2
        over = 1.0 / max(math.sqrt(variance), 1e-300)
        out[i, 0], out[i, 1] = 0.0, over * north
        for q in range(4):
            out[i, 0] += over * n[q] * r[q]
            t[q] = 0.0
            for p in range(4):
                t[q] += over * n[p] * T[i if len(T) > 1 else 0, p, q]
        for k in range(B.shape[2]):
            s = 0.0
            for p in range(4):
                s += t[p] * B[i, p, k]
            out[i, 2 + k] = s


@kernel
def calibration_batch(angles, g, earth_rate, output, factor, root, T, B):
    """Fill what the uncertainty of n coefficients does to the four numbers of m set-ups.

    Parameters: angles (m, 4), g (m,), earth_rate as of `left_batch`; output (n,) which of the four
    numbers a coefficient is in, factor (n,) what it multiplies there, of 1, f_x ... w_z; root (n,
    c) of their covariance [SI]; T (m, 4, 4) or (1, 4, 4) what of that is in the numbers [1].

    Fills B (m, 4, c) [SI].
    """
    C, v, x = np.empty((3, 3)), np.ones(7), np.empty(4)
    for i in range(len(angles)):
        _attitude(angles[i, 0], angles[i, 1], angles[i, 2], C)
        sl, cl = earth_rate * math.sin(angles[i, 3]), earth_rate * math.cos(angles[i, 3])
        for p in range(3):
            v[1 + p], v[4 + p] = g[i] * C[p, 2], cl * C[p, 1] + sl * C[p, 2]
        for c in range(root.shape[1]):
            for p in range(4):
                x[p] = 0.0
            for k in range(len(root)):
                x[output[k]] += v[factor[k]] * root[k, c]
            for p in range(4):
                s = 0.0
                for q in range(4):
                    s += T[i if len(T) > 1 else 0, p, q] * x[q]
                B[i, p, c] = s


@kernel
def together_batch(S, B, cov):
    """Fill cov (m, 4, 4) with the sum of S (s, m, 4, 4) and of B B', B (m, 4, c)."""
    for i in range(len(cov)):
        for p in range(4):
            for q in range(p + 1):
                t = 0.0
                for k in range(len(S)):
                    t += S[k, i, p, q]
                for k in range(B.shape[2]):
                    t += B[i, p, k] * B[i, q, k]
                cov[i, p, q], cov[i, q, p] = t, t


@kernel
def shares_batch(gain, S, B, first, out):
    """Fill out (s + g, m, 4): the variances of four angles by each S (s, m, 4, 4) and group of B.

    Parameters: gain (m, 4, 5) slope of the angles against the four numbers; B (m, 4, c), of which
    first (g + 1,) says where each group begins.
    """
    for i in range(len(gain)):
        for p in range(4):
            for k in range(len(S)):
                t = 0.0
                for q in range(4):
                    for r in range(4):
                        t += gain[i, p, q] * S[k, i, q, r] * gain[i, p, r]
                out[k, i, p] = t
            for k in range(len(first) - 1):
                t = 0.0
                for c in range(first[k], first[k + 1]):
                    x = 0.0
                    for q in range(4):
                        x += gain[i, p, q] * B[i, q, c]
                    t += x * x
                out[len(S) + k, i, p] = t


@inlined
def _settle(
    C, x, y, A, b, g, earth_rate, latitude, known, rounds, W, T, J, H, h, r, s, WJ
):  # fmt: skip
    """Turn C, and the latitude x[3], to the least sum of squares; return it, and the status."""
    lat, status = x[3], NOT_CONVERGED
    sl, cl = earth_rate * math.sin(lat), earth_rate * math.cos(lat)
    now = _misfit(C, lat, sl, cl, y, A, b, g, latitude, known, W, h, r)
    for _ in range(rounds):
        _slopes(C, sl, cl, A, g, J)
        _normal(J, W, r, known, latitude - lat, H, s, WJ)
        if _scaled_cholesky(H, s) == 0.0:
            status = SINGULAR
            break
        share, better, new, up, along = 1.0, False, now, sl, cl
        moved = 0.0
        for p in range(4):
            moved += s[p] * s[p]
        for _ in range(12):
            _turned(C, share * s[0], share * s[1], share * s[2], T)
            trial = lat + share * s[3]
            up, along = earth_rate * math.sin(trial), earth_rate * math.cos(trial)
            new = _misfit(T, trial, up, along, y, A, b, g, latitude, known, W, h, r)
            if new <= now * (1.0 + 1e-12) + 1e-12:
                better = True
                break
            share *= 0.5
        if not better:
            # No step helps: the minimum, to rounding, unless the step was a large one.
            status = SOLVED if moved < 1e-8 else NOT_CONVERGED
            break
        gained = now - new
        for p in range(3):
            for q in range(3):
                C[p, q] = T[p, q]
        lat, now, sl, cl = lat + share * s[3], new, up, along
        if moved * share * share < 1e-18 or (gained < 1e-10 and moved < 1e-12):
            status = SOLVED
            break
    if lat > 0.5 * math.pi or lat < -0.5 * math.pi:  # over the pole: the same rate, turned
        lat = math.copysign(math.pi, lat) - lat
        for p in range(3):
            C[p, 0], C[p, 1] = -C[p, 0], -C[p, 1]
    x[3] = lat
    return now, status


@part
def _other_side(C, lat, sign, variance):
    """Return what speaks against a solution south of the equator, or north, in squares of a sd."""
    beyond = max(-sign * lat, 0.0)
    out = min(beyond * beyond / max(variance, LEAST), AGAINST)
    along = C[2, 1] * math.cos(lat) + C[2, 2] * math.sin(lat)
    return out + DEFAULT if sign * along < 0.0 else out


@inlined
def _attitude(psi, theta, gamma, C):
    sf, cf = math.sin(psi), math.cos(psi)
    st, ct = math.sin(theta), math.cos(theta)
    sg, cg = math.sin(gamma), math.cos(gamma)
    C[0, 0], C[0, 1], C[0, 2] = cg * cf + sg * st * sf, sg * st * cf - cg * sf, -sg * ct
    C[1, 0], C[1, 1], C[1, 2] = ct * sf, ct * cf, st
    C[2, 0], C[2, 1], C[2, 2] = sg * cf - cg * st * sf, -sg * sf - cg * st * cf, cg * ct


@inlined
def _misfit(C, lat, sl, cl, y, A, b, g, latitude, known, W, h, r):
    """Fill h with what is predicted, r with what is left; return the sum of squares.

    `sl`, `cl`: the Earth's rate times sine and cosine of `lat`.
    """
    for p in range(4):
        h[p] = b[p]
        for q in range(3):
            truth = cl * C[q, 1] + sl * C[q, 2] if p < 2 else g * C[q, 2]
            h[p] += A[p, q] * truth
        r[p] = y[p] - h[p]
    total = 0.0
    for p in range(4):
        for q in range(4):
            total += r[p] * W[p, q] * r[q]
    return total + known * (latitude - lat) ** 2 if known > 0.0 else total


@inlined
def _slopes(C, sl, cl, A, g, J):
    """Fill J (4, 4): slope of the prediction against phi (E, N, U) and latitude.

    ``d (C v) = C (phi x v)``: specific force sees tilt alone and heading is one unknown by itself,
    so that however exact the tilt, scaling keeps the normal equations well conditioned.
    """
    for p in range(4):
        x, y, z = 0.0, 0.0, 0.0
        for q in range(3):
            x += A[p, q] * C[q, 0]
            y += A[p, q] * C[q, 1]
            z += A[p, q] * C[q, 2]
        if p < 2:
            J[p, 0] = z * cl - y * sl
            J[p, 1] = x * sl
            J[p, 2] = -x * cl
            J[p, 3] = z * cl - y * sl
        else:
            J[p, 0] = -y * g
            J[p, 1] = x * g
            J[p, 2] = 0.0
            J[p, 3] = 0.0


@inlined
def _normal(J, W, r, known, miss, H, s, WJ):
    """Fill H = J' W J and s = J' W r, with the latitude known before; WJ (4, 4) = W J."""
    for p in range(4):
        for q in range(4):
            total = 0.0
            for k in range(4):
                total += W[p, k] * J[k, q]
            WJ[p, q] = total
    for p in range(4):
        s[p] = 0.0
        for k in range(4):
            s[p] += WJ[k, p] * r[k]
        for q in range(4):
            total = 0.0
            for k in range(4):
                total += J[k, p] * WJ[k, q]
            H[p, q] = total
    if known > 0.0:
        H[3, 3] += known
        s[3] += known * miss


@inlined
def _scaled_cholesky(H, s):
    """Replace s by inv(H) s, H by the factor of H scaled to a unit diagonal; 0 if singular."""
    d0, d1, d2, d3 = H[0, 0], H[1, 1], H[2, 2], H[3, 3]
    if not (d0 > 0.0 and d1 > 0.0 and d2 > 0.0 and d3 > 0.0):
        return 0.0
    d = (1.0 / math.sqrt(d0), 1.0 / math.sqrt(d1), 1.0 / math.sqrt(d2), 1.0 / math.sqrt(d3))
    for p in range(4):
        s[p] *= d[p]
        for q in range(4):
            H[p, q] *= d[p] * d[q]
    if not cholesky(H, len(H)):
        return 0.0
    substitute(H, s, len(H))
    for p in range(4):
        s[p] *= d[p]
    return 1.0


@inlined
def _turned(C, x, y, z, T):
    """Fill T with C exp([phi x])."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = 0.5 * (math.sin(half) / half) ** 2 if angle > 1e-9 else 0.5
    for k in range(3):
        u, v, w = C[k, 0], C[k, 1], C[k, 2]
        # row x phi, and that x phi
        p, q, r = v * z - w * y, w * x - u * z, u * y - v * x
        T[k, 0] = u + a * p + c * (q * z - r * y)
        T[k, 1] = v + a * q + c * (r * x - p * z)
        T[k, 2] = w + a * r + c * (p * y - q * x)


@part
def _fill(P, gain, variance):
    """Fill a covariance with `variance`, and a gain with NaN."""
    for p in range(4):
        for q in range(4):
            P[p, q] = variance
        for q in range(5):
            gain[p, q] = np.nan


@inlined
def _uncertainty(C, lat, A, g, earth_rate, W, known, J, H, Hinv, E, WJ, s, P, gain):
    """Fill covariance and gain of heading, pitch, roll and latitude."""
    _slopes(C, earth_rate * math.sin(lat), earth_rate * math.cos(lat), A, g, J)
    for p in range(4):
        s[p] = 0.0
    _normal(J, W, s, known, 0.0, H, s, WJ)
    d = (math.sqrt(H[0, 0]), math.sqrt(H[1, 1]), math.sqrt(H[2, 2]), math.sqrt(H[3, 3]))
    if _scaled_cholesky(H, s) == 0.0:
        _fill(P, gain, np.inf)
        return
    invert(H, Hinv, len(H))
    for p in range(4):
        for q in range(4):
            Hinv[p, q] /= d[p] * d[q]
    # Slopes of heading, pitch and roll, first against a small rotation of the case,
    # C_bn <- (I - [phi_b x]) C_bn, then against phi: phi_b = -C_bn phi.
    ct = math.hypot(C[0, 2], C[2, 2])
    sg, cg, t = -C[0, 2] / ct, C[2, 2] / ct, C[1, 2] / ct
    for q in range(3):
        x, y, z = -C[0, q], -C[1, q], -C[2, q]
        E[0, q] = (sg * x - cg * z) / ct
        E[1, q] = cg * x + sg * z
        E[2, q] = sg * t * x + y - cg * t * z
    E[3, 3] = 1.0
    for p in range(4):
        for q in range(4):
            total = 0.0
            for k in range(4):
                total += E[p, k] * Hinv[k, q]
            J[p, q] = total
    for p in range(4):
        for q in range(4):
            total, x = 0.0, 0.0
            for k in range(4):
                total += J[p, k] * E[q, k]
                x += J[p, k] * WJ[q, k]
            P[p, q] = total
            gain[p, q] = x
        gain[p, 4] = J[p, 3] * known
