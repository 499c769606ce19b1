"""Strapdown navigation from angle and velocity increments, finite everywhere on the Earth.

Frame l is level and starts as East-North-Up; it is carried along without turning about up, so that
no term grows near the poles. Its direction against east and north, the wander angle, follows from
the position. A state x (12,) is::

    x[0:4]  quaternion of C_lb        x[4:7]  velocity in l [m/s]
    x[7:11] quaternion of C_el        x[11]   height [m]

The third row of C_el is the Earth's axis p in l; all the Earth does to the motion depends on p and
the height. With theta, dv the increments of one interval, ' and '' those of the ones before and
after it, k' = dt^2 / (6 dt' (dt + dt')) and k'' likewise (1/12 where all are equal)::

    b   = (k' theta' - k'' theta'') / 2, c likewise of dv   (k' theta' or -k'' theta'' at an end)
    phi = theta + b x theta                                                        (coning)
    u   = dv + c1 theta x dv + c2 theta x (theta x dv) + b x dv + c x theta        (sculling)
    c1  = (1 - cos a) / a^2, c2 = (a - sin a) / a^3, a = |theta|:  1/2 and 1/6 for small angles
    v  += (I - zeta x / 2) C_lb u + dt (g - (2 w_ie + w_el) x v)      zeta = dt (w_ie + w_el)
    C_lb = Exp(-zeta) C_lb Exp(phi),    C_el = C_el Exp(dt w_el)

with w_ie, w_el, g and the last v at the middle of the interval, and w_el of the position with the
mean of the velocities at both ends.
"""

import math

import numpy as np

from foucault.kernels import inlined, kernel

# WGS-84, the same figures as `models.earth`; a test compares them.
A = 6378137.0
E2 = 6.694379990141317e-3
W_IE = 7.292115e-5
G_EQUATOR = 9.7803253359
SOMIGLIANA = 1.931852652458e-3
FLATTENING = 1.0 / 298.257223563
CENTRIFUGAL = 3.449786506841e-3  # m = w_ie^2 a^2 b / GM

FREE, HELD, AIDED = 0, 1, 2
"""What the vertical channel does."""


@inlined
def half_rotation(a2):
    """Return cos(a/2) and sin(a/2) / a for the square a2 of an angle."""
    if a2 < 0.05:
        c = 1.0 - a2 * (1 / 8 - a2 * (1 / 384 - a2 * (1 / 46080 - a2 * (1 / 10321920))))
        s = 0.5 - a2 * (1 / 48 - a2 * (1 / 3840 - a2 * (1 / 645120 - a2 * (1 / 185794560))))
    else:
        a = math.sqrt(a2)
        c = math.cos(0.5 * a)
        s = math.sin(0.5 * a) / a
    return c, s


@inlined
def shortfall(a0, a1, a2, a3):
    """Return what brings a quaternion back to length one, to first order."""
    return 1.5 - 0.5 * (a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3)


@inlined
def product(a0, a1, a2, a3, b0, b1, b2, b3):
    """Return the quaternion a b for b of length one, a brought back to length one.

    The length of the result is one step late, but off the path that everything waits for.
    """
    unit = shortfall(a0, a1, a2, a3)
    return (
        (a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3) * unit,
        (a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2) * unit,
        (a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1) * unit,
        (a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0) * unit,
    )


@inlined
def rotation(px, py, pz):
    """Return the quaternion Exp(p)."""
    c, s = half_rotation(px * px + py * py + pz * pz)
    return c, s * px, s * py, s * pz


@inlined
def curvature(pz, h):
    """Return c0, c1 of `transport`, and normal gravity, where the Earth's axis has height pz.

    c0 is 1 / (N + h), and c1 px^2 added to it at px = cos L gives 1 / (M + h).
    """
    s2 = pz * pz
    # 1 / sqrt(1 - y) by its series, exact to rounding for so small a y, and soonest ready.
    y = E2 * s2
    y2 = y * y
    inverse = (1.0 + 0.5 * y) + y2 * (
        (0.375 + 0.3125 * y) + y2 * ((0.2734375 + 0.24609375 * y) + 0.2255859375 * y2)
    )
    N = A * inverse
    bent = inverse * inverse * N
    c0 = 1.0 / (N + h)
    c1 = (1.0 / (bent * (1.0 - E2) + h)) * c0 * (bent * E2)
    t = h * (1 / A)
    g = G_EQUATOR * (1.0 + SOMIGLIANA * s2) * inverse
    g *= 1.0 - 2.0 * (1.0 + FLATTENING + CENTRIFUGAL - 2.0 * FLATTENING * s2) * t + 3.0 * t * t
    return c0, c1, g


@inlined
def transport(c0, c1, px, py, vx, vy):
    """Return the two level components of w_el: (-v_y, v_x) over the radii, finite at the poles.

    By the plane of each component of v: ``w = c0 (z x v) + c1 (v.p) (z x p)``, because
    1/(M+h) - 1/(N+h) is c1 cos^2 L.
    """
    along = c1 * (vx * px + vy * py)
    return -c0 * vy - along * py, c0 * vx + along * px


@inlined
def step(x, u, bend, dt, g_offset, held, mid):
    """Carry the state x over one interval, in place.

    Parameters: u (6,) increments of angle and velocity; bend (6,) b and c of the module's text;
    g_offset real minus normal gravity; held: height and vertical velocity stay. Fills mid (10,):
    velocity increment of the specific force in l (3), w_ie (3), w_el (2), gravity, c0.
    """
    t0, t1, t2 = u[0], u[1], u[2]
    d0, d1, d2 = u[3], u[4], u[5]
    b0, b1, b2 = bend[0], bend[1], bend[2]
    e0, e1, e2 = bend[3], bend[4], bend[5]
    a2 = t0 * t0 + t1 * t1 + t2 * t2
    if a2 < 0.05:
        c1 = 0.5 - a2 * (1 / 24 - a2 * (1 / 720 - a2 * (1 / 40320)))
        c2 = 1 / 6 - a2 * (1 / 120 - a2 * (1 / 5040 - a2 * (1 / 362880)))
    else:
        a = math.sqrt(a2)
        c1 = (1.0 - math.cos(a)) / a2
        c2 = (a - math.sin(a)) / (a2 * a)
    x0 = t1 * d2 - t2 * d1
    x1 = t2 * d0 - t0 * d2
    x2 = t0 * d1 - t1 * d0
    u0 = d0 + c1 * x0 + c2 * (t1 * x2 - t2 * x1) + b1 * d2 - b2 * d1 + e1 * t2 - e2 * t1
    u1 = d1 + c1 * x1 + c2 * (t2 * x0 - t0 * x2) + b2 * d0 - b0 * d2 + e2 * t0 - e0 * t2
    u2 = d2 + c1 * x2 + c2 * (t0 * x1 - t1 * x0) + b0 * d1 - b1 * d0 + e0 * t1 - e1 * t0
    # The specific force in l, attitude of the beginning.
    q0, q1, q2, q3 = x[0], x[1], x[2], x[3]
    y0 = 2.0 * (q2 * u2 - q3 * u1)
    y1 = 2.0 * (q3 * u0 - q1 * u2)
    y2 = 2.0 * (q1 * u1 - q2 * u0)
    f0 = u0 + q0 * y0 + q2 * y2 - q3 * y1
    f1 = u1 + q0 * y1 + q3 * y0 - q1 * y2
    f2 = u2 + q0 * y2 + q1 * y1 - q2 * y0
    # The Earth's axis in l and the height, half an interval on; a sphere is enough for that.
    r0, r1, r2, r3 = x[7], x[8], x[9], x[10]
    v0, v1, v2 = x[4], x[5], x[6]
    h = x[11]
    px = 2.0 * (r1 * r3 - r0 * r2)
    py = 2.0 * (r2 * r3 + r0 * r1)
    pz = r0 * r0 - r1 * r1 - r2 * r2 + r3 * r3
    move = (0.5 / A) * dt
    m0, m1 = -move * v1, move * v0
    px, py, pz = px - m1 * pz, py + m0 * pz, pz - m0 * py + m1 * px
    c0, c1, g = curvature(pz, h + 0.5 * dt * v2)
    g += g_offset
    i0, i1, i2 = W_IE * px, W_IE * py, W_IE * pz
    # Velocity at the middle. On the same sphere o turns it, and the force that grows with it.
    o0, o1, o2 = dt * i0 + m0, dt * i1 + m1, dt * i2
    s0, s1, s2 = v0 + 0.25 * f0, v1 + 0.25 * f1, v2 + 0.25 * f2
    n0 = v0 + 0.5 * f0 - (o1 * s2 - o2 * s1)
    n1 = v1 + 0.5 * f1 - (o2 * s0 - o0 * s2)
    n2 = v2 + 0.5 * (f2 - dt * g) - (o0 * s1 - o1 * s0)
    if held:
        n2 = 0.0
    w0, w1 = transport(c0, c1, px, py, n0, n1)
    z0, z1, z2 = 0.5 * dt * (i0 + w0), 0.5 * dt * (i1 + w1), 0.5 * dt * i2
    f0, f1, f2 = f0 - z1 * f2 + z2 * f1, f1 - z2 * f0 + z0 * f2, f2 - z0 * f1 + z1 * f0
    o0, o1, o2 = 2.0 * i0 + w0, 2.0 * i1 + w1, 2.0 * i2
    n0, n1, n2 = (
        v0 + f0 - dt * (o1 * n2 - o2 * n1),
        v1 + f1 - dt * (o2 * n0 - o0 * n2),
        v2 + f2 - dt * (g + o0 * n1 - o1 * n0),
    )
    if held:
        n2 = 0.0
    # Frame l turns little: the series of its rotation needs no more terms.
    p0, p1, p2, p3 = rotation(
        t0 + b1 * t2 - b2 * t1, t1 + b2 * t0 - b0 * t2, t2 + b0 * t1 - b1 * t0
    )
    a0, a1, a2, a3 = (
        q0 + z0 * q1 + z1 * q2 + z2 * q3,
        q1 - z0 * q0 - z1 * q3 + z2 * q2,
        q2 - z1 * q0 - z2 * q1 + z0 * q3,
        q3 - z2 * q0 - z0 * q2 + z1 * q1,
    )
    x[0], x[1], x[2], x[3] = product(a0, a1, a2, a3, p0, p1, p2, p3)
    x[4], x[5], x[6] = n0, n1, n2
    w0, w1 = transport(c0, c1, px, py, 0.5 * (v0 + n0), 0.5 * (v1 + n1))
    b, d = 0.5 * dt * w0, 0.5 * dt * w1
    unit = shortfall(r0, r1, r2, r3) - 0.5 * (b * b + d * d)
    x[7] = (r0 - r1 * b - r2 * d) * unit
    x[8] = (r1 + r0 * b - r3 * d) * unit
    x[9] = (r2 + r0 * d + r3 * b) * unit
    x[10] = (r3 + r1 * d - r2 * b) * unit
    x[11] = h + 0.5 * dt * (v2 + n2)
    mid[0], mid[1], mid[2] = f0, f1, f2
    mid[3], mid[4], mid[5] = i0, i1, i2
    mid[6], mid[7], mid[8], mid[9] = w0, w1, g, c0


@kernel
def strapdown(
    dtheta, dvel, dt, left, right, first, last, x0, g_offset, vertical, heights, gains, out
):
    """Navigate over the rows first + 1 .. last, or from first back to last.

    Parameters: dtheta, dvel (n, 3) increments [rad], [m/s] over dt (n,) [s]; left, right (n,):
    what the rows before and after count for in b and c of the module's text, 0 where there is no
    such row: nothing else keeps a read inside the arrays; x0 (12,) the state at the end of row
    first; g_offset [m/s^2]; vertical FREE, HELD or AIDED; heights (n,) at the ends of the rows [m],
    NaN where unknown, (0,) unless AIDED; gains (3,) of the height loop [1/s, 1/s^2, 1/s^3].

    Fills out (abs(last - first) + 1, 12) with the states: from NumPy it has large pages. A step
    back is the exact inverse of the step forward, found by repeating the latter.
    """
    steps = abs(last - first)
    x = x0.copy()
    held = vertical == HELD
    if held:
        x[6] = 0.0
    y = np.empty(12)
    u = np.empty(6)
    bend = np.empty(6)
    mid = np.empty(10)
    for c in range(12):  # a slice takes longer, and seconds to compile
        out[0, c] = x[c]
    lift = 0.0  # what the height loop has found the vertical specific force to be wrong by
    since = 0.0  # how long ago a height was known, as far as the loop would not overshoot
    for j in range(steps):
        i = first + 1 + j if last > first else first - j
        for c in range(3):
            u[c] = dtheta[i, c]
            u[3 + c] = dvel[i, c]
        k0, k1 = left[i], right[i]
        # Zero times a bad row would be bad too.
        before, after = i - (k0 != 0.0), i + (k1 != 0.0)
        for c in range(3):
            bend[c] = k0 * dtheta[before, c] + k1 * dtheta[after, c]
            bend[3 + c] = k0 * dvel[before, c] + k1 * dvel[after, c]
        if last > first:
            step(x, u, bend, dt[i], g_offset + lift, held, mid)
        else:
            step_back(x, y, u, bend, dt[i], g_offset + lift, held, mid)
        if vertical == AIDED:
            e = heights[i if last > first else i - 1] - x[11]
            since = min(since + dt[i], 1.0 / gains[0])
            if e == e:
                x[11] += gains[0] * e * since
                x[6] += gains[1] * e * (since if last > first else -since)
                lift -= gains[2] * e * since
                since = 0.0
        for c in range(12):
            out[j + 1, c] = x[c]


@inlined
def step_back(x, y, u, bend, dt, g_offset, held, mid):
    """Replace x by the state that `step` carries into x; y (12,) is scratch."""
    target = x.copy()
    for _ in range(5):
        for c in range(12):
            y[c] = x[c]
        step(y, u, bend, dt, g_offset, held, mid)
        for at in (0, 7):  # q <- (target y^-1) q
            c0, c1, c2, c3 = product(
                target[at], target[at + 1], target[at + 2], target[at + 3],
                y[at], -y[at + 1], -y[at + 2], -y[at + 3],
            )  # fmt: skip
            x[at], x[at + 1], x[at + 2], x[at + 3] = product(
                c0, c1, c2, c3, x[at], x[at + 1], x[at + 2], x[at + 3]
            )
        for c in range(4, 7):
            x[c] += target[c] - y[c]
        x[11] += target[11] - y[11]
