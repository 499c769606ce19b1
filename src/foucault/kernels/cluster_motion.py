"""How a torqued cluster turns under its command, and what its accelerometers say meanwhile.

The command holds for one interval, and so does the noise of the gyros. `integrate_exponential`
takes one rotation vector per interval, from the rate at its middle::

    C_np <- Exp(-w_in_n dt) C_np Exp(w_ip_p dt)

and knows no singular attitude. `integrate_angles` is the published rule: outer, middle and inner
angle by Runge-Kutta steps of fourth order. All specific forces are in local g; `theta` is packed
as in `kernels.cluster`.
"""

import math

import numpy as np

from foucault.kernels import kernel, part
from foucault.kernels.cluster import actual_rate, inverse_input_axes, readings
from foucault.kernels.rotation import multiply_exp


@kernel
def integrate_exponential(theta, C_pn, command, noise, w_n, dt):
    """Integrate over n intervals; C_pn (n + 1, 3, 3) starts with the first attitude.

    Parameters: theta (42,); command (n, 3) [rad/s]; noise (n, 3), the mean rate noise of each
    interval [rad/s]; w_n (3,) rate of the Earth, East-North-Up [rad/s]; dt [s], which may be
    negative: then the intervals follow one another backwards.
    """
    Ti = np.empty((3, 3))
    inverse_input_axes(theta, Ti)
    back = np.zeros((3, 3))
    back[0, 0] = back[1, 1] = back[2, 2] = 1.0
    multiply_exp(back, -w_n[0] * dt, -w_n[1] * dt, -w_n[2] * dt)
    C = np.empty((3, 3))  # C_np
    for i in range(3):
        for j in range(3):
            C[i, j] = C_pn[0, j, i]
    h = 0.5 * dt
    # What the cluster turns by beside its command: hardly another one interval later.
    ox = oy = oz = 0.0
    for k in range(command.shape[0]):
        cx, cy, cz = command[k, 0], command[k, 1], command[k, 2]
        fx, fy, fz = C[2, 0], C[2, 1], C[2, 2]
        if k == 0:
            wx, wy, wz = actual_rate(theta, Ti, cx, cy, cz, fx, fy, fz)
            ox, oy, oz = wx - cx, wy - cy, wz - cz
        # Specific force in the middle of the interval, to second order.
        ux = h * (cx + ox - C[0, 0] * w_n[0] - C[1, 0] * w_n[1] - fx * w_n[2])
        uy = h * (cy + oy - C[0, 1] * w_n[0] - C[1, 1] * w_n[1] - fy * w_n[2])
        uz = h * (cz + oz - C[0, 2] * w_n[0] - C[1, 2] * w_n[1] - fz * w_n[2])
        ax, ay, az = fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux
        mx = fx + ax + 0.5 * (ay * uz - az * uy)
        my = fy + ay + 0.5 * (az * ux - ax * uz)
        mz = fz + az + 0.5 * (ax * uy - ay * ux)
        wx, wy, wz = actual_rate(theta, Ti, cx, cy, cz, mx, my, mz)
        ox, oy, oz = wx - cx, wy - cy, wz - cz
        px, py, pz = noise[k, 0], noise[k, 1], noise[k, 2]
        wx += Ti[0, 0] * px + Ti[0, 1] * py + Ti[0, 2] * pz
        wy += Ti[1, 0] * px + Ti[1, 1] * py + Ti[1, 2] * pz
        wz += Ti[2, 0] * px + Ti[2, 1] * py + Ti[2, 2] * pz
        multiply_exp(C, wx * dt, wy * dt, wz * dt)
        for j in range(3):
            x, y, z = C[0, j], C[1, j], C[2, j]
            for i in range(3):
                C[i, j] = back[i, 0] * x + back[i, 1] * y + back[i, 2] * z
                C_pn[k + 1, j, i] = C[i, j]
        if k % 256 == 255:
            _square(C)


@part
def _square(C):
    """Take the rounding errors of many steps out of a rotation: C <- C (3 I - C^T C) / 2."""
    S = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            S[i, j] = 1.5 if i == j else 0.0
            for r in range(3):
                S[i, j] -= 0.5 * C[r, i] * C[r, j]
    for i in range(3):
        x, y, z = C[i, 0], C[i, 1], C[i, 2]
        for j in range(3):
            C[i, j] = x * S[0, j] + y * S[1, j] + z * S[2, j]


@part
def _angle_rates(theta, Ti, outer, middle, inner, w, w_n):
    """Return the rates of the three angles, eq. (14), under command plus noise w [rad/s]."""
    so, co = math.sin(outer), math.cos(outer)
    sm, cm = math.sin(middle), math.cos(middle)
    si, ci = math.sin(inner), math.cos(inner)
    # North, Up and East in p: the rows of C_p^n, eq. (9).
    nx, ny, nz = cm * ci, cm * si, -sm
    fx, fy, fz = so * sm * ci - co * si, so * sm * si + co * ci, so * cm
    ex, ey, ez = co * sm * ci + so * si, co * sm * si - so * ci, co * cm
    wx, wy, wz = actual_rate(theta, Ti, w[0], w[1], w[2], fx, fy, fz)
    wx += Ti[0, 0] * w[3] + Ti[0, 1] * w[4] + Ti[0, 2] * w[5]
    wy += Ti[1, 0] * w[3] + Ti[1, 1] * w[4] + Ti[1, 2] * w[5]
    wz += Ti[2, 0] * w[3] + Ti[2, 1] * w[4] + Ti[2, 2] * w[5]
    wx -= w_n[0] * ex + w_n[1] * nx + w_n[2] * fx
    wy -= w_n[0] * ey + w_n[1] * ny + w_n[2] * fy
    wz -= w_n[0] * ez + w_n[1] * nz + w_n[2] * fz
    along = (ci * wx + si * wy) / cm
    return -along, si * wx - ci * wy, -sm * along - wz


@kernel
def integrate_angles(theta, angles, command, noise, w_n, dt, C_pn):
    """Integrate the angles over n intervals of as many steps each as there is noise.

    Parameters: theta (42,); angles (3,), outer, middle and inner, changed in place [rad]; command
    (n, 3) [rad/s]; noise (n, steps, 3), constant over each step [rad/s]; w_n (3,) rate of the
    Earth, East-North-Up [rad/s]; dt, length of an interval [s]; C_pn (n + 1, 3, 3), its rows 1 to
    n are written.

    Returns the number of the first interval in which one step changed an angle by more than a
    fiftieth of the distance to middle = 90 deg, -1 if none did: there the rule fails.
    """
    Ti = np.empty((3, 3))
    inverse_input_axes(theta, Ti)
    steps = noise.shape[1]
    h = dt / steps
    w = np.empty(6)
    lost = -1
    for k in range(command.shape[0]):
        for i in range(3):
            w[i] = command[k, i]
        for s in range(steps):
            for i in range(3):
                w[3 + i] = noise[k, s, i]
            o, m, q = angles[0], angles[1], angles[2]
            ao, am, aq = _angle_rates(theta, Ti, o, m, q, w, w_n)
            r = 0.5 * h
            bo, bm, bq = _angle_rates(theta, Ti, o + r * ao, m + r * am, q + r * aq, w, w_n)
            co, cm, cq = _angle_rates(theta, Ti, o + r * bo, m + r * bm, q + r * bq, w, w_n)
            do, dm, dq = _angle_rates(theta, Ti, o + h * co, m + h * cm, q + h * cq, w, w_n)
            po = h / 6.0 * (ao + 2.0 * bo + 2.0 * co + do)
            pm = h / 6.0 * (am + 2.0 * bm + 2.0 * cm + dm)
            pq = h / 6.0 * (aq + 2.0 * bq + 2.0 * cq + dq)
            near = 0.02 * abs(math.cos(m))
            if lost < 0 and not (abs(po) < near and abs(pm) < near and abs(pq) < near):
                lost = k
            angles[0], angles[1], angles[2] = o + po, m + pm, q + pq
        so, co = math.sin(angles[0]), math.cos(angles[0])
        sm, cm = math.sin(angles[1]), math.cos(angles[1])
        sq, cq = math.sin(angles[2]), math.cos(angles[2])
        C_pn[k + 1, 0, 1], C_pn[k + 1, 1, 1], C_pn[k + 1, 2, 1] = cm * cq, cm * sq, -sm
        C_pn[k + 1, 0, 2] = so * sm * cq - co * sq
        C_pn[k + 1, 1, 2] = so * sm * sq + co * cq
        C_pn[k + 1, 2, 2] = so * cm
        C_pn[k + 1, 0, 0] = co * sm * cq + so * sq
        C_pn[k + 1, 1, 0] = co * sm * sq - so * cq
        C_pn[k + 1, 2, 0] = co * cm
    return lost


@kernel
def readings_at(theta, C_pn, command, turn, arms, g, phase):
    """Return what the accelerometers say at one phase of every interval, shape (n, 3) [local g].

    Parameters: theta (42,); C_pn (n + 1, 3, 3) at the ends of the intervals; command (n, 3)
    [rad/s]; turn (n, 3) angular acceleration at that moment [rad/s^2]; arms (3, 3), a row per
    accelerometer [m]; g [m/s^2]; phase, 0 at the beginning of an interval, 1 at its end. In
    between the cluster turns at one rate relative to East-North-Up.
    """
    Ti = np.empty((3, 3))
    inverse_input_axes(theta, Ti)
    n = command.shape[0]
    out = np.empty((n, 3))
    lever = False
    for i in range(3):
        for j in range(3):
            lever = lever or arms[i, j] != 0.0
    wx = wy = wz = 0.0
    for k in range(n):
        A = C_pn[k]
        fx, fy, fz = A[0, 2], A[1, 2], A[2, 2]
        if phase != 0.0:
            B = C_pn[k + 1]
            px = py = pz = 0.0  # the sine of the rotation vector of B A^T
            for j in range(3):
                px += 0.5 * (B[2, j] * A[1, j] - B[1, j] * A[2, j])
                py += 0.5 * (B[0, j] * A[2, j] - B[2, j] * A[0, j])
                pz += 0.5 * (B[1, j] * A[0, j] - B[0, j] * A[1, j])
            s2 = px * px + py * py + pz * pz
            size = phase if s2 < 1e-300 else phase * math.asin(math.sqrt(s2)) / math.sqrt(s2)
            px, py, pz = size * px, size * py, size * pz
            a2 = px * px + py * py + pz * pz
            a = math.sqrt(a2)
            s = 1.0 - a2 / 6.0 if a2 < 1e-8 else math.sin(a) / a
            c = 0.5 - a2 / 24.0 if a2 < 1e-8 else 2.0 * (math.sin(0.5 * a) / a) ** 2
            ax, ay, az = py * fz - pz * fy, pz * fx - px * fz, px * fy - py * fx
            fx += s * ax + c * (py * az - pz * ay)
            fy += s * ay + c * (pz * ax - px * az)
            fz += s * az + c * (px * ay - py * ax)
        if lever:
            wx, wy, wz = actual_rate(
                theta, Ti, command[k, 0], command[k, 1], command[k, 2], fx, fy, fz
            )
        out[k, 0], out[k, 1], out[k, 2] = readings(
            theta, fx, fy, fz, wx, wy, wz, turn[k, 0], turn[k, 1], turn[k, 2], arms, g
        )
    return out
