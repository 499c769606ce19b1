"""Rotation by a strapdown triad between two instants, with its sensitivities.

``C_{k+1} = C_k Exp(phi_k)`` with the rotation vector of one interval::

    rates      phi = dt (-w_{k-1} + 13 w_k + 13 w_{k+1} - w_{k+2}) / 24 + dt^2/12 w_k x w_{k+1}
    increments phi = dt w_{k+1} + dt^2/12 w_k x w_{k+1}

For rates this is the integral of the cubic through four samples with the fourth-order Magnus
term (the trapezoidal rule alone is 9 arcsec off over a 2 s turn at 100 Hz); for increments it is
the two-sample coning correction. Body axes at the start of the turn are written s,
at the end e, so that ``C_se`` maps e to s.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel

# Series of sin(a) / a and (1 - cos(a)) / a^2 in a^2: a division costs more than the rest.
S3, S5, S7, S9 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0
C4, C6, C8 = -1.0 / 24.0, 1.0 / 720.0, -1.0 / 40320.0


@inlined
def multiply_exp(C, px, py, pz):
    """Replace C by ``C Exp(p)``, in place; Rodrigues' formula."""
    a2 = px * px + py * py + pz * pz
    if a2 < 1e-3:  # series, exact to rounding at this size, below 1.8 deg
        s = 1.0 + a2 * (S3 + a2 * (S5 + a2 * (S7 + a2 * S9)))
        c = 0.5 + a2 * (C4 + a2 * (C6 + a2 * C8))
    else:
        a = math.sqrt(a2)
        s = math.sin(a) / a
        c = (1.0 - math.cos(a)) / a2
    e00 = 1.0 - c * (py * py + pz * pz)
    e11 = 1.0 - c * (px * px + pz * pz)
    e22 = 1.0 - c * (px * px + py * py)
    e01 = c * px * py - s * pz
    e10 = c * px * py + s * pz
    e02 = c * px * pz + s * py
    e20 = c * px * pz - s * py
    e12 = c * py * pz - s * px
    e21 = c * py * pz + s * px
    for i in range(3):
        x = C[i, 0]
        y = C[i, 1]
        z = C[i, 2]
        C[i, 0] = x * e00 + y * e10 + z * e20
        C[i, 1] = x * e01 + y * e11 + z * e21
        C[i, 2] = x * e02 + y * e12 + z * e22


@kernel
def running_product(step):
    """Return one, and the products of the first of `step` (n, 3, 3) [1], (n + 1, 3, 3)."""
    n = step.shape[0]
    C = np.zeros((n + 1, 3, 3))
    for i in range(3):
        C[0, i, i] = 1.0
    for r in range(n):
        for i in range(3):
            for j in range(3):
                C[r + 1, i, j] = (
                    C[r, i, 0] * step[r, 0, j]
                    + C[r, i, 1] * step[r, 1, j]
                    + C[r, i, 2] * step[r, 2, j]
                )
    return C


@kernel
def integrate_turns(time, w, f, psd, first, last, increments):
    """Integrate the rate over each turn and accumulate what an error of the rate would do.

    Parameters: time (n,) [s]; w (n, 3) rate in b [rad/s]; f (n, 3) specific force in b [m/s^2],
    or (0, 3) where C_se and the path alone are asked for; psd (3, 3) power spectral density of the
    rate noise [rad^2/s]; first, last (m,) indices of the first and the last sample of each turn;
    increments: rows are interval means.

    Returns per turn C_se (m, 3, 3); bias (m, 3, 3) = int C_sb dt [s]; scale (m, 3, 9) =
    int C_sb[:, i] w[k] dt at column 3 i + k [rad]; force (m, 3, 9), the same with f [m/s];
    noise (m, 3, 3) = int C_sb psd C_bs dt [rad^2]; path (m,) = int |w| dt [rad].
    """
    m = first.size
    C_se = np.empty((m, 3, 3))
    bias = np.zeros((m, 3, 3))
    scale = np.zeros((m, 3, 9))
    force = np.zeros((m, 3, 9))
    noise = np.zeros((m, 3, 3))
    path = np.zeros(m)
    C = np.empty((3, 3))
    mean = np.empty(3)
    push = np.empty(3)
    sensed = f.shape[0] > 0
    for j in range(m):
        for i in range(3):
            for k in range(3):
                C[i, k] = 1.0 if i == k else 0.0
        for r in range(first[j], last[j]):
            dt = time[r + 1] - time[r]
            a0 = w[r, 0]
            a1 = w[r, 1]
            a2 = w[r, 2]
            b0 = w[r + 1, 0]
            b1 = w[r + 1, 1]
            b2 = w[r + 1, 2]
            if increments:
                mean[0] = b0
                mean[1] = b1
                mean[2] = b2
                for k in range(3 if sensed else 0):
                    push[k] = f[r + 1, k]
            else:
                before = r - 1 if r > 0 else r
                after = r + 2 if r + 2 < time.size else r + 1
                for k in range(3):
                    mean[k] = (13.0 * (w[r, k] + w[r + 1, k]) - w[before, k] - w[after, k]) / 24.0
                for k in range(3 if sensed else 0):
                    push[k] = (13.0 * (f[r, k] + f[r + 1, k]) - f[before, k] - f[after, k]) / 24.0
            q = dt * dt / 12.0
            px = mean[0] * dt + q * (a1 * b2 - a2 * b1)
            py = mean[1] * dt + q * (a2 * b0 - a0 * b2)
            pz = mean[2] * dt + q * (a0 * b1 - a1 * b0)
            path[j] += math.sqrt(px * px + py * py + pz * pz)
            # Sensitivities at the middle of the interval: half the step, accumulate, half.
            multiply_exp(C, 0.5 * px, 0.5 * py, 0.5 * pz)
            for a in range(3 if sensed else 0):
                for i in range(3):
                    c = C[a, i] * dt
                    bias[j, a, i] += c
                    for k in range(3):
                        scale[j, a, 3 * i + k] += c * mean[k]
                        force[j, a, 3 * i + k] += c * push[k]
                    for b in range(3):
                        noise[j, a, b] += c * (
                            psd[i, 0] * C[b, 0] + psd[i, 1] * C[b, 1] + psd[i, 2] * C[b, 2]
                        )
            multiply_exp(C, 0.5 * px, 0.5 * py, 0.5 * pz)
        for i in range(3):
            for k in range(3):
                C_se[j, i, k] = C[i, k]
    return C_se, bias, scale, force, noise, path


@kernel
def integrate_turns_rk4(time, w, first, last):
    """Integrate each turn by the Runge-Kutta rule of the published hand-rotated method.

    Quaternion derivative at both ends and the mean rate in the middle, normalised after every
    step. Parameters as `integrate_turns`; returns C_se (m, 3, 3).
    """
    m = first.size
    C_se = np.empty((m, 3, 3))
    q = np.empty(4)
    k = np.empty((4, 4))
    p = np.empty(4)
    rate = np.empty(3)
    for j in range(m):
        q[0] = 1.0
        q[1] = q[2] = q[3] = 0.0
        for r in range(first[j], last[j]):
            dt = time[r + 1] - time[r]
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                for i in range(3):
                    rate[i] = (1.0 - share) * w[r, i] + share * w[r + 1, i]
                for i in range(4):
                    p[i] = q[i] if stage == 0 else q[i] + share * dt * k[stage - 1, i]
                k[stage, 0] = 0.5 * (-rate[0] * p[1] - rate[1] * p[2] - rate[2] * p[3])
                k[stage, 1] = 0.5 * (rate[0] * p[0] + rate[2] * p[2] - rate[1] * p[3])
                k[stage, 2] = 0.5 * (rate[1] * p[0] - rate[2] * p[1] + rate[0] * p[3])
                k[stage, 3] = 0.5 * (rate[2] * p[0] + rate[1] * p[1] - rate[0] * p[2])
            norm = 0.0
            for i in range(4):
                q[i] += dt * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i]) / 6.0
                norm += q[i] * q[i]
            norm = math.sqrt(norm)
            for i in range(4):
                q[i] /= norm
        a, b, c, d = q[0], q[1], q[2], q[3]
        C_se[j, 0, 0] = a * a + b * b - c * c - d * d
        C_se[j, 1, 1] = a * a - b * b + c * c - d * d
        C_se[j, 2, 2] = a * a - b * b - c * c + d * d
        C_se[j, 0, 1] = 2.0 * (b * c - a * d)
        C_se[j, 1, 0] = 2.0 * (b * c + a * d)
        C_se[j, 0, 2] = 2.0 * (b * d + a * c)
        C_se[j, 2, 0] = 2.0 * (b * d - a * c)
        C_se[j, 1, 2] = 2.0 * (c * d - a * b)
        C_se[j, 2, 1] = 2.0 * (c * d + a * b)
    return C_se


@inlined
def atan2(y, x):
    """Return atan2(y, x) of finite numbers, to 5e-16, without a branch: an eighth of libm's time.

    Rational approximation of S. L. Moshier's Cephes library (atan.c), of up to 0.4142.
    """
    across, along = abs(y), abs(x)
    high, low = max(across, along), min(across, along)
    t = low / high if high > 0.0 else 0.0
    large = t > 0.4142135623730950488
    u = (t - 1.0) / (t + 1.0) if large else t
    z = u * u
    p = -8.750608600031904122785e-1 * z - 1.615753718733365076637e1
    p = ((p * z - 7.500855792314704667340e1) * z - 1.228866684490136173410e2) * z
    q = ((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z
    q = ((q + 4.328810604912902668951e2) * z + 4.853903996359136964868e2) * z
    p, q = p - 6.485021904942025371773e1, q + 1.945506571482613964425e2
    r = u + u * z * (p / q)
    r = r + 0.25 * math.pi if large else r
    r = 0.5 * math.pi - r if across > along else r
    r = math.pi - r if x < 0.0 else r
    return math.copysign(r, y)
