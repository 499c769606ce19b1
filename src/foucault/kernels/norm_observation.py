"""Norm observation and frame unification of many instruments at once, with covariance.

Per instrument: the linear norm solution of the accelerometers at rest and of the gyros in spins
(`triads`), the rotation between the two frames from the spins (`frames`), and the first-order
covariance of all 21 coefficients.

Order of the 21: accelerometer bias 3, scale 3, misalignments yx zx zy; gyro bias 3, scale 3,
misalignments xy xz yx yz zx zy. Status as in `triads`.
"""

import math

import numpy as np

from foucault.kernels import kernel
from foucault.kernels.frames import assemble, unify, unify_covariance
from foucault.kernels.triads import NOT_FINITE, SINGULAR, solve_triad, triad_covariance


@kernel
def calibrate_batch(rest, rest_var, f_spin, f_var, w_spin, w_var, h, g, lever_arm):
    """Calibrate n instruments that went through the same positions.

    Parameters: rest (n, m, 3) mean specific forces at rest [m/s^2]; rest_var (m,) their variance
    per axis; f_spin, w_spin (n, k, 3) means over spins [m/s^2], [rad/s]; f_var, w_var (k,); h (k,)
    norm of the true mean rates, signed [rad/s]; g [m/s^2]; lever_arm: solve for it.

    Returns Ma (n, 3, 3), ba (n, 3), Mg (n, 3, 3), bg (n, 3), arm (n, 3), cov (n, 231)
    its lower triangle row by row, arm_cov (n, 3, 3), C_bd (n, 3, 3), status (n,).
    """
    n, m = rest.shape[0], rest.shape[1]
    k = w_spin.shape[1]
    nz = 6 if lever_arm else 3
    # Not filled beforehand: touching this much memory twice costs a tenth of the work.
    Ma, Mg, C = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    ba, bg, arm = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    cov, arm_cov = np.zeros((n, 231)), np.zeros((n, 3, 3))
    status = np.zeros(n, np.int64)
    # Workspaces, once for all instruments.
    G, S, T = np.empty((9, 9)), np.empty((9, 9)), np.empty((9, 9))
    Ca, Cg, K = np.empty((9, 9)), np.empty((9, 9)), np.empty((9, 2))
    row, r0, r1 = np.empty(9), np.empty(9), np.empty(9)
    Ainv, Ginv, GC = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    Lg, X, o = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    f, u, s, kappa = np.empty((k, 3)), np.empty((k, 3)), np.empty(k), np.empty(k)
    H, P, z = np.zeros((6, 6)), np.empty((6, 6)), np.empty(6)
    A, B, D = np.zeros((6, 9)), np.zeros((6, 9)), np.zeros((6, 6))
    Q, W, E, F = np.empty((6, 3)), np.empty((6, 3)), np.empty((12, 3)), np.empty((12, 3))
    Y, V, L = np.empty((12, 9)), np.empty((12, 9)), np.zeros((12, 9))
    first, count = np.empty(12, np.int64), np.empty(12, np.int64)
    norms = np.full(m, g)
    for j in range(k):
        kappa[j] = h[j] * h[j] / g
    for i in range(n):
        status[i] = solve_triad(rest[i], norms, G, K, row, r0, r1, ba[i], Ma[i], Ainv)
        if status[i] != 0:
            continue
        status[i] = solve_triad(w_spin[i], h, G, K, row, r0, r1, bg[i], Lg, Ginv)
        if status[i] != 0:
            continue
        for j in range(k):
            size = 0.0
            for p in range(3):
                x = 0.0
                y = 0.0
                for q in range(p + 1):
                    x += Ainv[p, q] * (f_spin[i, j, q] - ba[i, q])
                    y += Ginv[p, q] * (w_spin[i, j, q] - bg[i, q])
                f[j, p] = x / g
                u[j, p] = y
                size += y * y
            s[j] = math.copysign(1.0 / math.sqrt(size), h[j])
            for p in range(3):
                u[j, p] *= s[j]
        if not unify(f, u, kappa, nz, C[i], arm[i], X, H, z, o):
            status[i] = SINGULAR
            continue
        fine = triad_covariance(rest[i], rest_var, ba[i], Ainv, G, S, T, row, Ca)
        if not (fine and triad_covariance(w_spin[i], w_var, bg[i], Ginv, G, S, T, row, Cg)):
            status[i] = SINGULAR
            continue
        unify_covariance(
            f, u, s, f_var, w_var, kappa, nz, g, C[i], Ainv, Ginv, GC, H, Q, W, A, B, D, o, P, T
        )
        assemble(
            Lg, C[i], Ca, Cg, A, B, D, nz, Mg[i], cov[i], arm_cov[i], T, Y, V, E, F, L, first, count
        )
        if not math.isfinite(cov[i, 230]):
            status[i] = NOT_FINITE
    return Ma, ba, Mg, bg, arm, cov, arm_cov, C, status
