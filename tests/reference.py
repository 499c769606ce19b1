"""Slow, obvious twins of the kernels: plain NumPy, one line per equation, no cleverness."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

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
    from foucault.estimate import norm_observation, parallel_vectors

    Ma, ba = norm_observation.solve(rest, g)
    Lg, bg = norm_observation.solve(w_spin, h)
    f = np.array([np.linalg.solve(Ma, x - ba) for x in f_spin])
    w = np.array([np.linalg.solve(Lg, x - bg) for x in w_spin])
    u = [np.sign(s) * x / np.linalg.norm(x) for s, x in zip(h, w, strict=True)]
    C_bd, arm = parallel_vectors.wahba(f, np.array(u)), np.zeros(3)
    for _ in range(2000 * lever_arm):  # one after the other, until neither moves
        across = [np.eye(3) - np.outer(C_bd @ x, C_bd @ x) for x in u]
        rows = [-(s**2) * P for s, P in zip(h, across, strict=True)]
        miss = [P @ x for P, x in zip(across, f, strict=True)]
        before = arm
        arm = np.linalg.lstsq(np.concatenate(rows), np.concatenate(miss), rcond=None)[0]
        C_bd = parallel_vectors.wahba(f - np.array([R @ arm for R in rows]), np.array(u))
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
