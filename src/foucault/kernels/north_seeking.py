"""North seeking of many set-ups at once: the closed form with covariance, and what is left out.

M and N are the rates along y_b and x_b over the Earth's rate. Status: 0 solved; 1 solved, with
M^2 + N^2 above 1 taken as 1; 2 not converged; 3 singular (an attitude that the readings do not
determine); 4 not finite.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel
from foucault.kernels.rotation import atan2

SOLVED, CLAMPED, NOT_CONVERGED, SINGULAR, NOT_FINITE = 0, 1, 2, 3, 4


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
def felt_batch(f, setup, cosine, sine, ramp, on_case, sensor, factors, size, out):
    """Fill what c terms of the accelerometers add to n readings of q of them.

    Parameters: f (m, 3) true specific force in the case [m/s^2]; setup (n,) of each reading; the
    others as of `left_batch`.

    Fills out (n, q, c) [m/s^2].
    """
    v = np.ones(14)
    for r in range(len(setup)):
        x, y, z = f[setup[r], 0], f[setup[r], 1], f[setup[r], 2]
        c, s = cosine[r], sine[r]
        v[1], v[2] = x if on_case else c * x - s * y, y if on_case else s * x + c * y
        v[3], v[13] = z, ramp[r]
        v[7], v[8], v[9] = abs(v[1]), abs(v[2]), abs(v[3])
        for k in range(len(size)):
            x = v[factors[k, 0]] * v[factors[k, 1]] * v[factors[k, 2]] * size[k]
            for q in range(out.shape[1]):
                out[r, q, k] = x if q == sensor[k] - 1 else 0.0


@kernel
def across_batch(
    y, cov, angles, A, b, g, earth_rate, latitude_sd, T, B, more, shared_sd, out
):  # fmt: skip
    """Fill the one number of m set-ups that no attitude explains, and what is done to it.

    At right angles to the slopes, whose cofactors that is, over its sd.

    Parameters: y (m, 4), cov (m, 4, 4) [SI]; angles (m, 4), A (4, 3), b (4,), g (m,), earth_rate as
    of `north_likelihood`; latitude_sd (m,) of what each has by itself [rad]; T (m, 4, 4) or (1, 4,
    4) what of the rest is in y [1]; B (m, 4, c), more (m, 4, d) [SI]; shared_sd of the latitude of
    all [rad].

    Fills out (m, 1 + c + d) of y, B and more [sd]; and of that latitude in one column beyond these,
    where there is one.
    """
    C, J = np.empty((3, 3)), np.empty((4, 4))
    r, n, t = np.empty(4), np.empty(4), np.empty(4)
    for i in range(len(y)):
        _attitude(angles[i, 0], angles[i, 1], angles[i, 2], C)
        sl, cl = earth_rate * math.sin(angles[i, 3]), earth_rate * math.cos(angles[i, 3])
        _miss(C, sl, cl, y[i], A, b, g[i], r)
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
        out[i, 0], c = 0.0, 1
        for q in range(4):
            out[i, 0] += over * n[q] * r[q]
            t[q] = 0.0
            for p in range(4):
                t[q] += over * n[p] * T[i if len(T) > 1 else 0, p, q]
        for D in (B, more):
            for k in range(D.shape[2]):
                s = 0.0
                for p in range(4):
                    s += t[p] * D[i, p, k]
                out[i, c] = s
                c += 1
        if c < out.shape[1]:
            out[i, c] = over * north * shared_sd


@kernel
def calibration_batch(angles, g, earth_rate, output, factor, root, T, B):
    """Fill what the uncertainty of n coefficients does to the four numbers of m set-ups.

    Parameters: angles (m, 4), g (m,), earth_rate as of `left_batch`; output (n,) which of the four
    numbers a coefficient is in, factor (n,) what it multiplies there, of 1, f_x ... w_z; root (n,
    c) of their covariance [SI]; T (m, 4, 4) what of that is in the numbers, none for all [1].

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
                B[i, p, c] = x[p]
                if len(T) > 0:
                    B[i, p, c] = 0.0
                    for q in range(4):
                        B[i, p, c] += T[i, p, q] * x[q]


@kernel
def together_batch(S, B, cov):
    """Fill cov (m, 4, 4) with the sum of S (s, m, 4, 4) and of B B', B (m, 4, c)."""
    t = np.empty((4, 4))
    for i in range(len(cov)):
        for p in range(4):
            for q in range(p + 1):
                t[p, q] = 0.0
                for k in range(len(S)):
                    t[p, q] += S[k, i, p, q]
        for k in range(B.shape[2]):  # outside, for no sum has to wait for another
            for p in range(4):
                for q in range(p + 1):
                    t[p, q] += B[i, p, k] * B[i, q, k]
        for p in range(4):
            for q in range(p + 1):
                cov[i, p, q], cov[i, q, p] = t[p, q], t[p, q]


@kernel
def shares_batch(gain, S, B, first, out):
    """Fill out (s + g, m, a): the variances of a angles by each S (s, m, 4, 4) and group of B.

    Parameters: gain (m, a, 5) slope of the angles against the four numbers; B (m, 4, c), of which
    first (g + 1,) says where each group begins.
    """
    for i in range(len(gain)):
        for p in range(gain.shape[1]):
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
def _attitude(psi, theta, gamma, C):
    sf, cf = math.sin(psi), math.cos(psi)
    st, ct = math.sin(theta), math.cos(theta)
    sg, cg = math.sin(gamma), math.cos(gamma)
    C[0, 0], C[0, 1], C[0, 2] = cg * cf + sg * st * sf, sg * st * cf - cg * sf, -sg * ct
    C[1, 0], C[1, 1], C[1, 2] = ct * sf, ct * cf, st
    C[2, 0], C[2, 1], C[2, 2] = sg * cf - cg * st * sf, -sg * sf - cg * st * cf, cg * ct


@inlined
def _miss(C, sl, cl, y, A, b, g, r):
    """Fill r (4,) with what is left of y; `sl`, `cl`: the Earth's rate times sine and cosine."""
    for p in range(4):
        r[p] = y[p] - b[p]
        for q in range(3):
            r[p] -= A[p, q] * (cl * C[q, 1] + sl * C[q, 2] if p < 2 else g * C[q, 2])


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
