"""A torqued cluster: its true rate and its accelerometers, from 42 packed constants.

`theta` holds the constants of `models.cluster` in units where local gravity is 1: 0-2 drift, 3-5
along input, 6-8 output, 9-11 spin axis, 12-14 products input-output, 15-17 input-spin, 18-20
output-spin, 21-23 torquer scale, 24-29 gyro misalignments xy xz yx yz zx zy, 30-32 accelerometer
bias, 33-35 scale, 36-38 misalignments yx zx zy, 39-41 quadratic.
"""

from foucault.kernels import inlined, kernel


@kernel
def inverse_input_axes(theta, Ti):
    """Write the inverse of T = I + gyro misalignments into Ti (3, 3)."""
    a, b, c = theta[24], theta[25], theta[26]
    d, e, f = theta[27], theta[28], theta[29]
    det = 1.0 - d * f - a * (c - d * e) + b * (c * f - e)
    Ti[0, 0] = (1.0 - d * f) / det
    Ti[0, 1] = (b * f - a) / det
    Ti[0, 2] = (a * d - b) / det
    Ti[1, 0] = (d * e - c) / det
    Ti[1, 1] = (1.0 - b * e) / det
    Ti[1, 2] = (b * c - d) / det
    Ti[2, 0] = (c * f - e) / det
    Ti[2, 1] = (a * e - f) / det
    Ti[2, 2] = (1.0 - a * c) / det


@inlined
def drift_rates(theta, fx, fy, fz):
    """Return the drift of the three gyros [rad/s]; f in local g."""
    xi = fx + theta[24] * fy + theta[25] * fz
    xo = fy - theta[24] * fx
    xs = fz - theta[25] * fx
    yi = theta[26] * fx + fy + theta[27] * fz
    yo = fx - theta[26] * fy
    ys = theta[27] * fy - fz
    zi = theta[28] * fx + theta[29] * fy + fz
    zo = fx - theta[28] * fz
    zs = fy - theta[29] * fz
    ex = theta[0] + (theta[3] + theta[12] * xo + theta[15] * xs) * xi
    ex += (theta[6] + theta[18] * xs) * xo + theta[9] * xs
    ey = theta[1] + (theta[4] + theta[13] * yo + theta[16] * ys) * yi
    ey += (theta[7] + theta[19] * ys) * yo + theta[10] * ys
    ez = theta[2] + (theta[5] + theta[14] * zo + theta[17] * zs) * zi
    ez += (theta[8] + theta[20] * zs) * zo + theta[11] * zs
    return ex, ey, ez


@inlined
def actual_rate(theta, Ti, cx, cy, cz, fx, fy, fz):
    """Return the true rate w_ip_p [rad/s] under the command c, f in local g."""
    ex, ey, ez = drift_rates(theta, fx, fy, fz)
    sx = (1.0 + theta[21]) * cx + ex
    sy = (1.0 + theta[22]) * cy + ey
    sz = (1.0 + theta[23]) * cz + ez
    return (
        Ti[0, 0] * sx + Ti[0, 1] * sy + Ti[0, 2] * sz,
        Ti[1, 0] * sx + Ti[1, 1] * sy + Ti[1, 2] * sz,
        Ti[2, 0] * sx + Ti[2, 1] * sy + Ti[2, 2] * sz,
    )


@inlined
def inputs(theta, fx, fy, fz, wx, wy, wz, ax, ay, az, arms, g):
    """Return what the three accelerometers sense along their input axes, W [local g].

    At the arm r [m] the specific force is f + w x (w x r) + a x r.
    """
    per_g = 1.0 / g
    m00 = -(wy * wy + wz * wz) * per_g
    m11 = -(wx * wx + wz * wz) * per_g
    m22 = -(wx * wx + wy * wy) * per_g
    m01, m10 = (wx * wy - az) * per_g, (wx * wy + az) * per_g
    m02, m20 = (wx * wz + ay) * per_g, (wx * wz - ay) * per_g
    m12, m21 = (wy * wz - ax) * per_g, (wy * wz + ax) * per_g
    x, y, z = arms[0, 0], arms[0, 1], arms[0, 2]
    px = fx + m00 * x + m01 * y + m02 * z
    x, y, z = arms[1, 0], arms[1, 1], arms[1, 2]
    qx = fx + m00 * x + m01 * y + m02 * z
    qy = fy + m10 * x + m11 * y + m12 * z
    x, y, z = arms[2, 0], arms[2, 1], arms[2, 2]
    rx = fx + m00 * x + m01 * y + m02 * z
    ry = fy + m10 * x + m11 * y + m12 * z
    rz = fz + m20 * x + m21 * y + m22 * z
    return px, qy + theta[36] * qx, rz + theta[37] * rx + theta[38] * ry


@kernel
def readings(theta, fx, fy, fz, wx, wy, wz, ax, ay, az, arms, g):
    """Return what the accelerometers say [local g].

    f: specific force [local g]; w: rate [rad/s]; a: angular acceleration [rad/s^2]; arms (3, 3):
    position of each accelerometer in a row [m]; g [m/s^2].
    """
    X, Y, Z = inputs(theta, fx, fy, fz, wx, wy, wz, ax, ay, az, arms, g)
    return (
        theta[30] + (1.0 + theta[33] + theta[39] * X) * X,
        theta[31] + (1.0 + theta[34] + theta[40] * Y) * Y,
        theta[32] + (1.0 + theta[35] + theta[41] * Z) * Z,
    )
