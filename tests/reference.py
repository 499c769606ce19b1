"""Slow, obvious twins of the kernels: plain NumPy, one line per equation, no cleverness."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

FloatArray = np.ndarray


def cross(v: FloatArray) -> FloatArray:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def moving_moments(x: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    mean, variance = np.full(x.shape, np.nan), np.full(x.shape, np.nan)
    half = window // 2
    for i in range(half, len(x) - half):
        part = x[i - half : i + half + 1]
        mean[i], variance[i] = part.mean(axis=0), part.var(axis=0, ddof=1)
    return mean, variance


def multiply_exp(C: FloatArray, p: FloatArray) -> FloatArray:
    return C @ expm(cross(p))


def interval_mean(x: FloatArray, r: int, increments: bool) -> FloatArray:
    """Mean of x over the interval from sample r to r + 1."""
    if increments:
        return x[r + 1]
    before, after = max(r - 1, 0), min(r + 2, len(x) - 1)
    return (-x[before] + 13 * x[r] + 13 * x[r + 1] - x[after]) / 24


def running_product(step: FloatArray) -> FloatArray:
    return np.array(list(accumulate(step, np.matmul, initial=np.eye(3))))


def integrate_turns(
    time: FloatArray,
    w: FloatArray,
    f: FloatArray,
    psd: FloatArray,
    first: FloatArray,
    last: FloatArray,
    increments: bool,
) -> tuple[FloatArray, ...]:
    m = len(first)
    C_se, bias = np.zeros((m, 3, 3)), np.zeros((m, 3, 3))
    scale, force = np.zeros((m, 3, 9)), np.zeros((m, 3, 9))
    noise, path = np.zeros((m, 3, 3)), np.zeros(m)
    for j in range(m):
        C = np.eye(3)
        for r in range(first[j], last[j]):
            dt = time[r + 1] - time[r]
            mean, push = interval_mean(w, r, increments), interval_mean(f, r, increments)
            phi = dt * mean + dt**2 / 12 * np.cross(w[r], w[r + 1])
            middle = multiply_exp(C, phi / 2)  # C_sb half-way through the interval
            bias[j] += middle * dt
            scale[j] += np.einsum("ai,k->aik", middle, mean).reshape(3, 9) * dt
            force[j] += np.einsum("ai,k->aik", middle, push).reshape(3, 9) * dt
            noise[j] += middle @ psd @ middle.T * dt
            path[j] += np.linalg.norm(phi)
            C = multiply_exp(C, phi)
        C_se[j] = C
    return C_se, bias, scale, force, noise, path


def quaternion_product(p: FloatArray, q: FloatArray) -> FloatArray:
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.concatenate([[w], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def integrate_turns_rk4(
    time: FloatArray, w: FloatArray, first: FloatArray, last: FloatArray
) -> FloatArray:
    def slope(q: FloatArray, rate: FloatArray) -> FloatArray:
        return 0.5 * quaternion_product(q, np.concatenate([[0.0], rate]))

    out = []
    for a, b in zip(first, last, strict=True):
        q = np.array([1.0, 0.0, 0.0, 0.0])
        for r in range(a, b):
            dt = time[r + 1] - time[r]
            middle = (w[r] + w[r + 1]) / 2
            k1 = slope(q, w[r])
            k2 = slope(q + dt / 2 * k1, middle)
            k3 = slope(q + dt / 2 * k2, middle)
            k4 = slope(q + dt * k3, w[r + 1])
            q = q + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            q /= np.linalg.norm(q)
        turned = [quaternion_product(quaternion_product(q, np.r_[0.0, e]), q * [1, -1, -1, -1])
                  for e in np.eye(3)]  # fmt: skip
        out.append(np.array(turned)[:, 1:].T)
    return np.array(out)


def norm_observation(rest, f_spin, w_spin, h, g, lever_arm):
    """One instrument by the NumPy solutions: its 21 coefficients and the lever arm."""
    from foucault.estimate import norm_observation

    Ma, ba = norm_observation.solve(rest, g)
    Lg, bg = norm_observation.solve(w_spin, h)
    f = np.array([np.linalg.solve(Ma, x - ba) for x in f_spin])
    w = np.array([np.linalg.solve(Lg, x - bg) for x in w_spin])
    u = [np.sign(s) * x / np.linalg.norm(x) for s, x in zip(h, w, strict=True)]
    C_bd, arm = norm_observation.wahba(f, np.array(u)), np.zeros(3)
    for _ in range(2000 * lever_arm):  # one after the other, until neither moves
        across = [np.eye(3) - np.outer(C_bd @ x, C_bd @ x) for x in u]
        rows = [-(s**2) * P for s, P in zip(h, across, strict=True)]
        miss = [P @ x for P, x in zip(across, f, strict=True)]
        before = arm
        arm = np.linalg.lstsq(np.concatenate(rows), np.concatenate(miss), rcond=None)[0]
        C_bd = norm_observation.wahba(f - np.array([R @ arm for R in rows]), np.array(u))
        if np.abs(arm - before).max() < 1e-13:
            break
    Mg = Lg @ C_bd.T
    off = [Mg[i, j] for i in range(3) for j in range(3) if i != j]
    accel = [*ba, *(np.diag(Ma) - 1), Ma[1, 0], Ma[2, 0], Ma[2, 1]]
    return np.array([*accel, *bg, *(np.diag(Mg) - 1), *off]), arm


def norm_observation_covariance(blocks, variances, steps, h, g, lever_arm):
    """Covariance of the 21 and of the lever arm: every reading moved a little, one by one."""
    slopes = []
    for k in range(3):
        for at in np.ndindex(blocks[k].shape):
            moved = []
            for sign in (1.0, -1.0):
                other = [b.copy() for b in blocks]
                other[k][at] += sign * steps[k]
                values, arm = norm_observation(*other, h, g, lever_arm)
                moved.append(np.concatenate([values, arm]))
            slopes.append((moved[0] - moved[1]) / (2 * steps[k]) * np.sqrt(variances[k][at[0]]))
    J = np.array(slopes)
    return J.T @ J


# -- north seeking ---------------------------------------------------------------------------


def printed_fix(
    N: float, M: float, up_x: float, up_y: float, latitude: float, sign: float
) -> FloatArray:
    """Equations (20)-(33) as printed, corrected: heading, pitch, roll, latitude.

    N and M are the rates along x and y over the Earth's; `latitude` is NaN where unknown, and then
    `sign` chooses the root of (33).
    """
    st = up_y
    ct = np.sqrt(1 - st**2)
    sg = -up_x / ct
    cg = np.sqrt(1 - sg**2)
    sl = np.sin(latitude)
    if np.isnan(latitude):
        B = 2 * (N * sg * ct - M * st)
        C = (M * cg) ** 2 + (N * ct - M * sg * st) ** 2 - (cg * ct) ** 2
        sl = (-B + sign * np.sqrt(max(B**2 - 4 * C, 0.0))) / 2
    cf_cl = (M - st * sl) / ct
    sf_cl = (sg * (st * M - sl) - N * ct) / (cg * ct)
    heading = np.arctan2(sf_cl, cf_cl) % (2 * np.pi)
    if np.isnan(latitude):
        latitude = np.arctan2(sl, np.hypot(sf_cl, cf_cl))
    return np.array([heading, np.arcsin(st), np.arcsin(sg), latitude])


def north_prediction(angles: FloatArray, earth_rate: float, g: float) -> tuple[FloatArray, ...]:
    """Earth's rate and specific force in the case, by three rotations."""
    psi, theta, gamma, latitude = angles
    x, y, z = np.eye(3)
    # Heading is clockwise: the case turns about -z.
    C_bn = turned(y, -gamma) @ turned(x, -theta) @ turned(z, psi)
    w_n = earth_rate * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    return C_bn @ w_n, C_bn @ np.array([0.0, 0.0, g])


def turned(axis: FloatArray, angle: float) -> FloatArray:
    K = cross(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def north_likelihood(
    y: FloatArray, cov: FloatArray, start: FloatArray, A: FloatArray, b: FloatArray, g: float,
    earth_rate: float, latitude: float, latitude_sd: float,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """One set-up by general least squares: angles, covariance, sum of squares."""
    white = np.linalg.inv(np.linalg.cholesky(cov))

    def left(angles: FloatArray) -> FloatArray:
        w, f = north_prediction(angles, earth_rate, g)
        out = white @ (y - np.concatenate([A[:2] @ w, A[2:] @ f]) - b)
        if np.isfinite(latitude_sd):
            out = np.append(out, (latitude - angles[3]) / latitude_sd)
        return out

    return north_minimum(left, start)


def north_minimum(left: object, start: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Unknowns, covariance and sum of squares where white residuals are least."""
    scale = 1 / np.linalg.norm(_central(left, start), axis=0)
    found = least_squares(
        lambda u: left(start + scale * u), np.zeros(len(start)), method="lm",
        xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    x = start + scale * found.x
    J = _central(left, x) * scale
    return x, np.outer(scale, scale) * np.linalg.inv(J.T @ J), float(found.fun @ found.fun)


def _central(left: object, x: FloatArray, step: float = 1e-6) -> FloatArray:
    columns = []
    for k in range(len(x)):
        h = np.zeros(len(x))
        h[k] = step
        columns.append((left(x + h) - left(x - h)) / (2 * step))
    return np.stack(columns, axis=1)


def four_position_tilt(A: FloatArray, unit: float) -> tuple[FloatArray, FloatArray]:
    """Pitch and roll of gravity, read along +y, -y, +x, -x in counts, `unit` counts per g.

    Liu Cheng (2016), (20) and (21) with Ka, and sin of roll on the left of (21).
    """
    A1, A2, A3, A4 = np.moveaxis(A, -1, 0)
    st = -(A1 - A2) / (2 * unit)
    sg = (A3 - A4) / (2 * unit * np.sqrt(1 - st**2))
    return np.arcsin(st), np.arcsin(sg)


def four_position_rates(U: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """M and N of readings along +y, -y, +x, -x, `scale` counts per Earth's rate: (24), (25)."""
    U1, U2, U3, U4 = np.moveaxis(U, -1, 0)
    return (U1 - U2) / (2 * scale), (U3 - U4) / (2 * scale)


def four_position_calibration(U: FloatArray, heading: FloatArray, w_n: float) -> FloatArray:
    """b12, Kxy, Kg12, b34, Kg34, Kyx of level readings (m, 4): regressions (40)-(46)."""
    wx, wy = -w_n * np.sin(heading), w_n * np.cos(heading)
    rows = np.stack([np.ones_like(wx), wx, wy], axis=1)
    U12, U34 = (U[:, 0] - U[:, 1]) / 2, (U[:, 2] - U[:, 3]) / 2
    return np.concatenate([np.linalg.lstsq(rows, u, rcond=None)[0] for u in (U12, U34)])


def four_position_compensated(
    U: FloatArray, parameters: FloatArray, w_ie: float
) -> tuple[FloatArray, FloatArray]:
    """M and N with the parameters of a calibration: (48), (49)."""
    b12, Kxy, Kg12, b34, Kg34, Kyx = parameters
    U1, U2, U3, U4 = np.moveaxis(U, -1, 0)
    y, x = (U1 - U2) / 2 - b12, (U3 - U4) / 2 - b34
    determinant = Kg12 * Kg34 - Kxy * Kyx
    wx = (x * Kg12 - y * Kyx) / determinant
    wy = (y * Kg34 - x * Kxy) / determinant
    return wy / w_ie, wx / w_ie


def four_position_heading(
    M: FloatArray, N: FloatArray, theta: FloatArray, gamma: FloatArray, latitude=None, sign=1.0
) -> tuple[FloatArray, FloatArray]:
    """Heading and latitude, (26)-(33); `sign` is that of the rate along z_b."""
    st, ct, sg, cg = np.sin(theta), np.cos(theta), np.sin(gamma), np.cos(gamma)
    if latitude is None:
        B = -2 * (st * M - sg * ct * N)
        C = (sg * st * M - N * ct) ** 2 + (cg * M) ** 2 - (cg * ct) ** 2
        sl = (-B + sign * np.sqrt(np.maximum(B**2 - 4 * C, 0.0))) / 2
    else:
        sl = np.sin(latitude)
    cl = np.sqrt(1 - sl**2)
    cf = (M - st * sl) / (ct * cl)
    sf = (sg * (st * M - sl) - N * ct) / (cl * cg * ct)
    return np.arctan2(sf, cf) % (2 * np.pi), np.arcsin(sl) * np.ones_like(M)


# -- a torqued cluster -------------------------------------------------------------------------


def cluster_exponential(model, g, C_pn, command, noise, w_n, dt) -> FloatArray:
    """Attitudes (n + 1, 3, 3): one rotation per interval, from the rate at its middle."""
    Ti, out = np.linalg.inv(model.input_axes), [C_pn]
    for c, n in zip(command, noise, strict=True):
        C = out[-1]
        middle = C
        for _ in range(4):  # the rate in the middle by the attitude there
            turning = model.rate(c, g * middle[:, 2]) - middle @ w_n
            middle = expm(-cross(turning * dt / 2)) @ C
        w = model.rate(c, g * middle[:, 2]) + Ti @ n
        out.append(expm(-cross(w * dt)) @ C @ expm(cross(w_n * dt)))
    return np.array(out)


def cluster_angles(model, g, angles, command, noise, w_n, dt) -> tuple[FloatArray, FloatArray]:
    """Angles (3,) at the end and attitudes (n, 3, 3): classical Runge-Kutta; noise (n, m, 3)."""
    from foucault.models.cluster import angle_rates, attitude_of

    Ti, h, out = np.linalg.inv(model.input_axes), dt / noise.shape[1], []

    def slope(a: FloatArray, c: FloatArray, n: FloatArray) -> FloatArray:
        C = attitude_of(a)
        return angle_rates(a) @ (model.rate(c, g * C[:, 2]) + Ti @ n - C @ w_n)

    for c, block in zip(command, noise, strict=True):
        for n in block:
            k1 = slope(angles, c, n)
            k2 = slope(angles + h / 2 * k1, c, n)
            k3 = slope(angles + h / 2 * k2, c, n)
            k4 = slope(angles + h * k3, c, n)
            angles = angles + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        out.append(attitude_of(angles))
    return angles, np.array(out)


def cluster_readings(model, g, C_pn, command, turn, arms, phase) -> FloatArray:
    """Accelerometers (n, 3) [m/s^2] part of the way from one attitude to the next."""
    from foucault.models.rotation import log

    out = []
    for k, c in enumerate(command):
        f = expm(cross(phase * log(C_pn[k + 1] @ C_pn[k].T))) @ C_pn[k, :, 2] * g
        out.append(model.read(f, model.rate(c, f), arms, turn[k]))
    return np.array(out)


# -- the published filter of a torqued cluster -------------------------------------------------


def slope(function, x, step: float = 1.0) -> FloatArray:
    """Derivative by central differences: exact, at any step, where `function` is quadratic."""
    ends = [(function(x + step * e), function(x - step * e)) for e in np.eye(len(x))]
    return np.stack([(up - down) / (2 * step) for up, down in ends], axis=-1)


def packed_model(theta: FloatArray):
    """The model whose packed constants are theta: that of a place where gravity is 1 m/s^2."""
    from foucault.coefficients import CoefficientVector
    from foucault.models.cluster import CONSTANTS, ClusterModel

    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, theta))


def published_rate(theta, c, f, full) -> FloatArray:
    """Rate under the command c; without `full`, the drift is not referred to the input axes."""
    model = packed_model(theta)
    if full:
        return model.rate(c, f)
    still = model.drift_rate(f)
    return np.linalg.solve(model.input_axes, (1 + model.torquer_scale) * c) + still


def published_rate_slopes(theta, c, f, full) -> tuple[FloatArray, FloatArray]:
    """d rate / d f (3, 3) and d rate / d theta (3, 42).

    Drift is quadratic in f and in each misalignment, and linear in everything else.
    """
    model = packed_model(theta)
    Ti = np.linalg.inv(model.input_axes)
    M = Ti if full else np.eye(3)
    by_f = M @ slope(model.drift_rate, f)
    by_theta = M @ slope(lambda x: packed_model(x).drift_rate(f), theta)
    torqued = model.rate(c, f) if full else Ti @ ((1 + model.torquer_scale) * c)
    by_theta += Ti @ slope(lambda x: packed_model(x).torquer_scale * c, theta)
    by_theta -= Ti @ slope(lambda x: packed_model(x).input_axes @ torqued, theta)
    return by_f, by_theta


def published_step(theta, C_pn, c, h, w_n, full):
    """Attitude, rate, and Phi (3, 3), Phi_t (3, 42) of a rotation of p over one interval."""
    f = C_pn[:, 2] + h / 2 * np.cross(C_pn[:, 2], c)
    w = published_rate(theta, c, f, full)
    by_f, by_theta = published_rate_slopes(theta, c, f, full)
    half = expm(-cross(w * h / 2))
    Phi = half @ (np.eye(3) + by_f @ cross(f) * h) @ half
    return expm(-cross(w * h)) @ C_pn @ expm(cross(w_n * h)), w, Phi, half @ by_theta * h


def published_look(theta, f, w, arms, g):
    """Predicted readings, and their slopes by a rotation of p (3, 3) and by theta (3, 42)."""

    def said(x, force):
        return packed_model(x).read(force, w, arms / g)

    by_theta = slope(lambda x: said(x, f), theta)
    return said(theta, f), slope(lambda v: said(theta, v), f) @ cross(f), by_theta


def published_filter(log, x, P, w_n, q, arms, g, full=True, iterations=1):
    """Extended Kalman filter of 42 constants and three angles, dense; log: rows (h, c, z, R).

    Returns states (n, 45), covariances (n, 45, 45) and normalised innovations squared (n,).
    """
    from foucault.models.cluster import angle_rates, angles_of, attitude_of

    states, covs, nis = [], [], []
    for h, c, z, R in log:
        theta, chart = x[:42], angle_rates(x[42:])
        C_pn, w, Phi_pp, Phi_pt = published_step(theta, attitude_of(x[42:]), c, h, w_n, full)
        x = np.concatenate([theta, angles_of(C_pn)])
        T = angle_rates(x[42:])
        Phi, Q = np.eye(45), np.zeros((45, 45))
        Phi[42:, 42:], Phi[42:, :42] = T @ Phi_pp @ np.linalg.inv(chart), T @ Phi_pt
        Q[42:, 42:] = T @ T.T * q * h
        P = Phi @ P @ Phi.T + Q
        prior = x
        for _ in range(iterations if not states else 1):
            said, by_phi, by_theta = published_look(x[:42], attitude_of(x[42:])[:, 2], w, arms, g)
            H = np.hstack([by_theta, by_phi @ np.linalg.inv(angle_rates(x[42:]))])
            S = H @ P @ H.T + np.diag(R)
            nu = z - said - H @ (prior - x)
            K = np.linalg.solve(S, H @ P).T
            x = prior + K @ nu
        P = P - K @ S @ K.T
        states.append(x)
        covs.append(P)
        nis.append(nu @ np.linalg.solve(S, nu))
    return np.array(states), np.array(covs), np.array(nis)


def misalignment_filter(log, start, P, w_n, q, arms, g, fed_back):
    """The same with a rotation of p that is never fed back; the constants are where `fed_back`."""
    from foucault.models.cluster import attitude_of

    theta, C_pn, error, nis = start[:42].copy(), attitude_of(start[42:]), np.zeros(45), []
    for h, c, z, R in log:
        C_pn, w, Phi_pp, Phi_pt = published_step(theta, C_pn, c, h, w_n, True)
        Phi, Q = np.eye(45), np.zeros((45, 45))
        Phi[42:, 42:], Phi[42:, :42] = Phi_pp, Phi_pt
        Q[42:, 42:] = np.eye(3) * q * h
        P, error = Phi @ P @ Phi.T + Q, Phi @ error
        said, by_phi, by_theta = published_look(theta, C_pn[:, 2], w, arms, g)
        H = np.hstack([by_theta, by_phi])
        S = H @ P @ H.T + np.diag(R)
        nu = z - said - H @ error
        error = error + P @ H.T @ np.linalg.solve(S, nu)
        P = P - P @ H.T @ np.linalg.solve(S, H @ P)
        nis.append(nu @ np.linalg.solve(S, nu))
        if fed_back:
            theta, error[:42] = theta + error[:42], 0.0
    return theta + error[:42], expm(-cross(error[42:])) @ C_pn, P, np.array(nis)


def cluster_error_filter(model, g, C_pn, dt, command, reading, w_n, q, r, arms, sd):
    """The linearised filter of a cluster, dense: 45 states x = (dphi in p, packed constants).

    Truth ahead of the trajectory of `model` from C_pn, C_true = Exp(-dphi) C_pn. Slopes are central
    differences of the model, the transition is a matrix exponential. Returns x, P and C_pn at the
    end; reading and r in local g.
    """
    from foucault.coefficients import CoefficientVector
    from foucault.models.cluster import CONSTANTS, ClusterModel, normalised

    theta = model.packed(g)

    def cluster(packed: FloatArray):
        vector = CoefficientVector(CONSTANTS, packed / normalised(g))
        return ClusterModel.from_coefficients(vector)

    def slopes(function) -> FloatArray:
        out, step = [], 1e-5
        for k in range(45):
            d = np.zeros(45)
            d[k] = step
            out.append((function(d) - function(-d)) / (2 * step))
        return np.column_stack(out)

    x, P = np.zeros(45), np.diag(np.asarray(sd) ** 2)
    P[:3, :3] = C_pn @ P[:3, :3] @ C_pn.T
    Ti = np.linalg.inv(model.input_axes)
    for h, c, z in zip(dt, command, reading, strict=True):
        path = cluster_exponential(model, g, C_pn, c[None], np.zeros((1, 3)), w_n, h)
        w = model.rate(c, g * C_pn[:, 2])
        middle = expm(-cross((w - C_pn @ w_n) * h / 2)) @ C_pn

        def rate(d, C=middle, c=c):
            return cluster(theta + d[3:]).rate(c, g * (expm(-cross(d[:3])) @ C)[:, 2])

        def read(d, C=path[-1], c=c):
            f = g * (expm(-cross(d[:3])) @ C)[:, 2]
            return cluster(theta + d[3:]).read(f, model.rate(c, g * C[:, 2]), arms) / g

        F = np.zeros((45, 45))
        F[:3] = slopes(rate)
        F[:3, :3] -= cross(rate(np.zeros(45)))
        Phi = expm(F * h)
        half = expm(F[:3, :3] * h / 2)
        P = Phi @ P @ Phi.T
        P[:3, :3] += q * h * half @ Ti @ Ti.T @ half.T
        x, C_pn = Phi @ x, path[-1]
        H = slopes(read)
        S = H @ P @ H.T + r * np.eye(3)
        K = np.linalg.solve(S, H @ P).T
        x = x + K @ (z - read(np.zeros(45)) - H @ x)
        A = np.eye(45) - K @ H
        P = A @ P @ A.T + r * K @ K.T
    return x, P, C_pn


def turning(phi: FloatArray) -> FloatArray:
    """Rodrigues' formula."""
    a = np.linalg.norm(phi)
    if a == 0.0:
        return np.eye(3)
    K = cross(phi / a)
    return np.eye(3) + np.sin(a) * K + 2 * np.sin(a / 2) ** 2 * K @ K


def turn_of_level_frame(p: FloatArray, h: float, v: FloatArray) -> FloatArray:
    """w_el: the velocity split into east and north, which have a radius each."""
    from foucault.models.earth import radii

    north = np.array([p[0], p[1], 0.0]) if np.hypot(p[0], p[1]) > 0.0 else np.array([0.0, 1.0, 0.0])
    north = north / np.linalg.norm(north)
    east = np.array([north[1], -north[0], 0.0])
    RM, RN = radii(np.arctan2(p[2], np.hypot(p[0], p[1])))
    return -(v @ north) / (RM + h) * east + (v @ east) / (RN + h) * north


def bend_of(i, dtheta, dvel, dt, joined):
    """What the rows beside row i tell of its bend: the mean of what each of them tells."""
    told = []
    for beside, sign, there in (
        (i - 1, 1, joined[i]),
        (i + 1, -1, np.append(joined, False)[i + 1]),
    ):
        if there and beside >= 0:
            k = dt[i] ** 2 / (6 * dt[beside] * (dt[i] + dt[beside]))
            told.append(sign * k * np.array([dtheta[beside], dvel[beside]]))
    return np.mean(told, axis=0) if told else np.zeros((2, 3))


def strapdown_step(
    state, theta, dv, bend=((0, 0, 0), (0, 0, 0)), dt=0.0, offset=0.0, held=False, third=True
):
    """One step from (C_lb, v, C_el, h); bend: what the intervals beside this one say of it.

    `third` False leaves out what is of the third order in the increments: what is left of the
    rotation during the interval is half of theta x dv.
    """
    from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS, gravity

    C_lb, v, C_el, h = state
    phi, u = theta.copy(), dv + np.cross(theta, dv) / 2
    a = np.linalg.norm(theta)
    if third and a > 1e-3:
        u = dv + (1 - np.cos(a)) / a**2 * np.cross(theta, dv)
        u += (a - np.sin(a)) / a**3 * np.cross(theta, np.cross(theta, dv))
    elif third:
        u += np.cross(theta, np.cross(theta, dv)) / 6 - a**2 / 24 * np.cross(theta, dv)
    phi += np.cross(bend[0], theta)
    u += np.cross(bend[0], dv) + np.cross(bend[1], theta)
    push = C_lb @ u
    shift = dt / 2 / SEMI_MAJOR_AXIS * np.array([-v[1], v[0], 0.0])
    p = C_el[2] - np.cross(shift, C_el[2])
    h_middle = h + dt / 2 * v[2]
    g = np.array([0.0, 0.0, -gravity(np.arcsin(min(1.0, p[2])), h_middle) - offset])
    w_ie = EARTH_RATE * p
    level = np.array([1.0, 1.0, 0.0 if held else 1.0])

    def slope(v):
        return g - np.cross(2 * w_ie + turn_of_level_frame(p, h_middle, v), v)

    # Coriolis of the first half: on the sphere of the shift, which is w_el dt / 2 there.
    half = np.cross(dt * w_ie + shift, v + push / 4)
    middle = level * (v + (push + dt * g) / 2 - half)
    zeta = dt * (w_ie + turn_of_level_frame(p, h_middle, middle))
    end = level * (v + push - np.cross(zeta, push) / 2 + dt * slope(middle))
    w_el = turn_of_level_frame(p, h_middle, (v + end) / 2)
    C_lb = turning(-zeta) @ C_lb @ turning(phi)
    return C_lb, end, C_el @ turning(dt * w_el), h + dt * (v[2] + end[2]) / 2


def strapdown_step_back(state, *increments, **more):
    """The state that a step carries into `state`, found by trying."""
    C_lb, v, C_el, h = state
    tried = state
    for _ in range(12):
        C, w, E, top = strapdown_step(tried, *increments, **more)
        tried = (
            C_lb @ np.linalg.inv(C) @ tried[0],
            tried[1] + v - w,
            C_el @ np.linalg.inv(E) @ tried[2],
            tried[3] + h - top,
        )
    return tried


def strapdown_run(
    state, dtheta, dvel, dt, joined, first, last, offset=0.0, vertical="free", heights=None,
    gains=(),
):  # fmt: skip
    """All states (C_lb, v, C_el, h) from the end of row first to that of row last."""
    out, lift, since, ahead = [state], 0.0, 0.0, last > first
    for i in range(first + 1, last + 1) if ahead else range(first, last, -1):
        step = strapdown_step if ahead else strapdown_step_back
        C_lb, v, C_el, h = step(
            out[-1], dtheta[i], dvel[i], bend=bend_of(i, dtheta, dvel, dt, joined), dt=dt[i],
            offset=offset + lift, held=vertical == "held",
        )  # fmt: skip
        since += dt[i]
        if vertical == "aided" and np.isfinite(heights[i if ahead else i - 1]):
            e = heights[i if ahead else i - 1] - h
            for_time = min(since, 1 / gains[0])  # after a long time without heights
            h += gains[0] * e * for_time
            v = v + np.array([0.0, 0.0, gains[1] * e * for_time * (1 if ahead else -1)])
            lift -= gains[2] * e * for_time
            since = 0.0
        out.append((C_lb, v, C_el, h))
    return out


def from_start(
    dtheta: FloatArray, dvel: FloatArray, dt: FloatArray, joined: FloatArray
) -> tuple[FloatArray, FloatArray]:
    C, v = np.eye(3), np.zeros(3)
    attitude, velocity = [], []
    for i, (theta, dv) in enumerate(zip(dtheta, dvel, strict=True)):
        b, c = bend_of(i, dtheta, dvel, dt, joined)
        turned = dv + cross(theta) @ dv / 2 + cross(theta) @ cross(theta) @ dv / 6
        v = v + C @ (turned + cross(b) @ dv + cross(c) @ theta)
        C = multiply_exp(C, theta + cross(b) @ theta)
        attitude.append(C)
        velocity.append(v)
    return np.array(attitude), np.array(velocity)


def ins_filter(increments, state, sensors, epochs, P, q, estimate, offset=0.0):
    """The error-state filter, dense: every transition a matrix exponential, an epoch at once.

    state: (C_lb, v, C_el, h); epochs: (row, velocity, (latitude, longitude, height), sd (6,)).
    Returns the state, the coefficients, P, and the NIS of each epoch.
    """
    from foucault.coefficients import CoefficientVector
    from foucault.models.earth import EARTH_RATE, east_north_up, ecef, geodetic, gravity, radii
    from foucault.models.imu import ImuModel
    from foucault.models.ins_errors import dynamics
    from foucault.models.rotation import aligning, log

    i, nis, n, used = 0, [], len(P), None
    for row, v_n, place, sd in epochs:
        model = ImuModel.from_coefficients(CoefficientVector(sensors.layout, estimate))
        F, T = np.eye(n), 0.0
        while i < row:
            i += 1
            dt = increments.dt[i]
            f, w = model.compensate(
                increments.dvel_b / increments.dt[:, None],
                increments.dtheta_b / increments.dt[:, None],
            )
            theta, dv = w * increments.dt[:, None], f * increments.dt[:, None]
            theta[i - 1], dv[i - 1] = used or (theta[i - 1], dv[i - 1])
            used = theta[i], dv[i]
            f, w = f[i], w[i]
            C, v, E, h = state
            bend = bend_of(i, theta, dv, increments.dt, increments.joined)
            state = strapdown_step(state, *used, bend=bend, dt=dt, offset=offset)
            middle = C @ turning(log(C.T @ state[0]) / 2)
            p = (E[2] + state[2][2]) / 2
            w_el = turn_of_level_frame(p, h, (v + state[1]) / 2)
            L = np.arcsin(p[2] / np.linalg.norm(p))
            pull = (gravity(L, h) + offset) / (radii(L)[1] + h)
            F = expm(dynamics(sensors, middle, w, f, EARTH_RATE * p, w_el, pull) * dt) @ F
            T += dt
        half = np.diag(q) * T / 2
        P = F @ (P + half) @ F.T + half
        C, v, E, h = state
        L, lon = np.arcsin(E[2, 2]), np.arctan2(E[1, 2], E[0, 2])
        r = ecef(L, lon, h)
        axes = east_north_up(*(place[:2] if np.isfinite(sd[3:5]).all() else (L, lon)))
        z = np.append(v - E.T @ axes @ v_n, E.T @ (r - ecef(*place)))
        seen = np.flatnonzero(np.isfinite(sd))
        H, R = np.eye(n)[3 + seen], np.diag(sd[seen] ** 2)
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        x, A = K @ z[seen], np.eye(n) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        nis.append(z[seen] @ np.linalg.solve(S, z[seen]))
        C_eb, v_e = E @ turning(x[:3]) @ C, E @ (v - x[3:6])
        L, lon, h = geodetic(r - E @ x[6:9])
        E = aligning(E[:, 2], east_north_up(L, lon)[:, 2]) @ E
        state, estimate = (E.T @ C_eb, E.T @ v_e, E, h), estimate + x[9:]
    return state, estimate, P, np.array(nis)


def north_across(y, cov, w, f, J, A, b, latitude_sd, T, B) -> FloatArray:
    """The direction that no slope of J (4, 4) of attitude and latitude has, and what it says."""
    cov = cov + latitude_sd**2 * np.outer(J[:, 3], J[:, 3])
    across = np.linalg.svd(J[:, :3].T)[2][-1]
    back = across / np.sqrt(across @ cov @ across)
    left = y - np.concatenate([A[:2] @ w, A[2:] @ f]) - b
    return np.array([back @ left, back @ J[:, 3], *(back @ T @ B)])


def north_shares(gain, S, parts) -> FloatArray:
    """Variances of four angles by each covariance S (s, 4, 4) and root of one in `parts`."""
    every = [*S, *(B @ B.T for B in parts)]
    return np.array([np.diag(gain[:, :4] @ one @ gain[:, :4].T) for one in every])
