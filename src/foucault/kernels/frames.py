"""The rotation between two triads from spins, the lever arm, and their covariance.

See `estimate.norm_observation.unify` for the equations. ``z = (phi, r)`` are the errors of the
rotation C_bd (``C_true = Exp(-phi) C``) and of the lever arm; A, B their derivatives by the nine of
each triad (see `triads`), D what the noise of the spins themselves adds.
"""

from foucault.kernels import kernel, part
from foucault.kernels.small_matrices import cholesky, invert, multiply, polar, substitute


@kernel
def _turned(o, kappa, M, Q):
    """Fill Q (6, 3) = R' M, R = ([o x], kappa (I - o o')): f/g - o across o by phi and r."""
    for k in range(3):
        x = M[0, k]
        y = M[1, k]
        z = M[2, k]
        along = o[0] * x + o[1] * y + o[2] * z
        Q[0, k] = o[2] * y - o[1] * z
        Q[1, k] = o[0] * z - o[2] * x
        Q[2, k] = o[1] * x - o[0] * y
        Q[3, k] = kappa * (x - along * o[0])
        Q[4, k] = kappa * (y - along * o[1])
        Q[5, k] = kappa * (z - along * o[2])


@kernel
def unify(f, u, kappa, nz, C, r, X, H, z, o):
    """Fill C (3, 3) and r (3,) from f (m, 3) over g and unit u (m, 3); H the 6 x 6 normal matrix.

    nz is 6, or 3 where the lever arm is held at zero. Gauss-Newton from the polar factor.
    """
    m = f.shape[0]
    for i in range(3):
        r[i] = 0.0
        for k in range(3):
            s = 0.0
            for j in range(m):
                s += f[j, i] * u[j, k]
            H[i, k] = s
    if not polar(H, C, X):
        return False
    for _ in range(20):
        # R' R and R' e from sums of o, f and their products: see `_turned`.
        for i in range(6):
            z[i] = 0.0
            for k in range(i + 1):
                H[i, k] = 0.0
        level = 0.0
        for j in range(m):
            for i in range(3):
                o[i] = C[i, 0] * u[j, 0] + C[i, 1] * u[j, 1] + C[i, 2] * u[j, 2]
            c = kappa[j]
            e0 = f[j, 0] + c * r[0]
            e1 = f[j, 1] + c * r[1]
            e2 = f[j, 2] + c * r[2]
            along = o[0] * e0 + o[1] * e1 + o[2] * e2
            z[0] += o[1] * e2 - o[2] * e1
            z[1] += o[2] * e0 - o[0] * e2
            z[2] += o[0] * e1 - o[1] * e0
            z[3] -= c * (e0 - along * o[0])
            z[4] -= c * (e1 - along * o[1])
            z[5] -= c * (e2 - along * o[2])
            level += c * c
            for i in range(3):
                for k in range(i + 1):
                    H[i, k] -= o[i] * o[k]
                    H[3 + i, 3 + k] -= c * c * o[i] * o[k]
            H[3, 1] -= c * o[2]
            H[4, 0] += c * o[2]
            H[3, 2] += c * o[1]
            H[5, 0] -= c * o[1]
            H[4, 2] -= c * o[0]
            H[5, 1] += c * o[0]
        for i in range(3):
            H[i, i] += m
            H[3 + i, 3 + i] += level
        if not cholesky(H, nz):
            return False
        substitute(H, z, nz)
        px = z[0]
        py = z[1]
        pz = z[2]
        for k in range(3):  # C <- (I + [z x]) C; the polar factor brings it back to a rotation
            x = C[0, k]
            y = C[1, k]
            w = C[2, k]
            H[0, 3 + k] = x + py * w - pz * y
            H[1, 3 + k] = y + pz * x - px * w
            H[2, 3 + k] = w + px * y - py * x
        if not polar(H[:3, 3:], C, X):
            return False
        size = abs(px) + abs(py) + abs(pz)
        for k in range(3, nz):
            r[k - 3] += z[k]
        if size <= 1e-9:  # what is left is this times the size of the residuals
            break
    return True


@kernel
def unify_covariance(f, u, s, ca, cg, kappa, nz, g, C, Ainv, Ginv, GC, H, Q, W, A, B, D, o, P, T):
    """Fill A, B (6, 9), D (6, 6): how errors of both triads and direct noise move z = (phi, r).

    s (m,) is the signed inverse of the norm of each rate; ca, cg (m,) variances per axis; Ainv,
    Ginv the inverse triad matrices; H holds the Cholesky factor of the normal matrix.
    """
    m = f.shape[0]
    for i in range(3):
        for k in range(3):
            t = 0.0
            for p in range(3):
                t += C[i, p] * Ginv[p, k]
            GC[i, k] = t
    # Accelerometers' L^-1 is lower triangular; that of the gyros, turned into b, is not.
    for i in range(6):
        for k in range(9):
            A[i, k] = 0.0
            B[i, k] = 0.0
        for k in range(6):
            D[i, k] = 0.0
    for j in range(m):
        for i in range(3):
            o[i] = C[i, 0] * u[j, 0] + C[i, 1] * u[j, 1] + C[i, 2] * u[j, 2]
        va = ca[j] / (g * g)
        vg = cg[j] * s[j] * s[j]
        _turned(o, kappa[j], Ainv, Q)
        _turned(o, kappa[j], GC, W)
        f0, f1, f2 = f[j, 0], f[j, 1], f[j, 2]
        u0, u1, u2 = u[j, 0], u[j, 1], u[j, 2]
        for i in range(nz):
            q0, q1, q2 = Q[i, 0], Q[i, 1], Q[i, 2]
            w0, w1, w2 = W[i, 0], W[i, 1], W[i, 2]
            A[i, 0] += q0 * f0
            A[i, 1] += q1 * f0
            A[i, 2] += q1 * f1
            A[i, 3] += q2 * f0
            A[i, 4] += q2 * f1
            A[i, 5] += q2 * f2
            A[i, 6] += q0 / g
            A[i, 7] += q1 / g
            A[i, 8] += q2 / g
            B[i, 0] -= w0 * u0
            B[i, 1] -= w1 * u0
            B[i, 2] -= w1 * u1
            B[i, 3] -= w2 * u0
            B[i, 4] -= w2 * u1
            B[i, 5] -= w2 * u2
            B[i, 6] -= w0 * s[j]
            B[i, 7] -= w1 * s[j]
            B[i, 8] -= w2 * s[j]
            a0, a1, a2 = va * q0, va * q1, va * q2
            b0, b1, b2 = vg * w0, vg * w1, vg * w2
            for k in range(i + 1):
                D[i, k] += a0 * Q[k, 0] + a1 * Q[k, 1] + a2 * Q[k, 2]
                D[i, k] += b0 * W[k, 0] + b1 * W[k, 1] + b2 * W[k, 2]
    _solve_normal(H, nz, A, B, D, P, T)


@part
def _solve_normal(H, nz, A, B, D, P, T):
    """Replace A, B by inv(H) A, inv(H) B and D by inv(H) D inv(H), H given as its factor."""
    invert(H, P, nz)
    for i in range(nz):
        for k in range(i):
            D[k, i] = D[i, k]
    multiply(P, A, nz, 9, T)
    multiply(P, B, nz, 9, T)
    multiply(P, D, nz, nz, T)
    for i in range(nz):
        for k in range(i):
            D[k, i], D[i, k] = D[i, k], D[k, i]
    multiply(P, D, nz, nz, T)


@kernel
def _slopes(M, C, F, S, first, count):
    """Fill F (12, 3) and S (12, 9): the gyro's 12 by phi and by theta_g; S is sparse."""
    row = 6
    for i in range(3):
        first[i] = 6 + i
        count[i] = 1
        S[i, 6 + i] = 1.0
        for k in range(3):
            F[i, k] = 0.0
        for k in range(3):
            at = 3 + i
            if i != k:
                at = row
                row += 1
            k1 = (k + 1) % 3
            k2 = (k + 2) % 3
            # column k of [phi x] has phi[k2] in row k1 and -phi[k1] in row k2
            F[at, k] = 0.0
            F[at, k2] = -M[i, k1]
            F[at, k1] = M[i, k2]
            first[at] = i * (i + 1) // 2
            count[at] = i + 1
            for q in range(i + 1):
                S[at, first[at] + q] = C[k, q]


@part
def _congruence(A, P, nz, T, D):
    """Fill T = A P (nz, 9) and add A P A' to the lower triangle of D."""
    for i in range(nz):
        for k in range(9):
            T[i, k] = 0.0
        for p in range(9):
            a = A[i, p]
            for k in range(9):
                T[i, k] += a * P[p, k]
        for k in range(i + 1):
            t = 0.0
            for p in range(9):
                t += T[i, p] * A[k, p]
            D[i, k] += t


@kernel
def assemble(Lg, C, Ca, Cg, A, B, D, nz, M, cov, arm_cov, T, Y, V, E, F, S, first, count):
    """Fill M (3, 3) = L_g C_db and the covariance of the 21 coefficients and of the lever arm.

    T (6, 9), Y, V, S (12, 9), E, F (12, 3), first, count (12,) are workspaces. With the errors
    ``z = (phi, r) = A theta_a + B theta_g + direct noise`` of the unification,
    ``dM = dL_g C_db - M [phi x]``.
    """
    for i in range(3):
        for k in range(3):
            t = 0.0
            for q in range(i + 1):
                t += Lg[i, q] * C[k, q]
            M[i, k] = t
    order = (6, 7, 8, 0, 2, 5, 1, 3, 4)
    _slopes(M, C, F, S, first, count)
    # z: covariance, and its covariance with theta_a and theta_g
    _congruence(A, Ca, nz, T, D)
    for i in range(12):
        for k in range(9):
            t = F[i, 0] * T[0, k] + F[i, 1] * T[1, k] + F[i, 2] * T[2, k]
            Y[i, k] = t
    at = 0
    for i in range(9):
        for k in range(i + 1):
            cov[at] = Ca[order[i], order[k]]
            at += 1
    for i in range(12):
        at = (9 + i) * (10 + i) // 2
        for k in range(9):
            cov[at + k] = Y[i, order[k]]
    _congruence(B, Cg, nz, T, D)
    for i in range(nz):
        for k in range(i):
            D[k, i] = D[i, k]
    # covariance = (S Cg + Y) S' + S Y' + F Czz F' with Y = F B Cg
    for i in range(12):
        for k in range(9):
            t = 0.0
            for p in range(first[i], first[i] + count[i]):
                t += S[i, p] * Cg[p, k]
            y = F[i, 0] * T[0, k] + F[i, 1] * T[1, k] + F[i, 2] * T[2, k]
            Y[i, k] = y
            V[i, k] = t + y
        for q in range(3):
            E[i, q] = F[i, 0] * D[0, q] + F[i, 1] * D[1, q] + F[i, 2] * D[2, q]
    for i in range(12):
        at = (9 + i) * (10 + i) // 2 + 9
        for k in range(i + 1):
            t = E[i, 0] * F[k, 0] + E[i, 1] * F[k, 1] + E[i, 2] * F[k, 2]
            for p in range(first[k], first[k] + count[k]):
                t += V[i, p] * S[k, p]
            for p in range(first[i], first[i] + count[i]):
                t += S[i, p] * Y[k, p]
            cov[at + k] = t
    for i in range(3):
        for k in range(3):
            arm_cov[i, k] = D[3 + i, 3 + k] if nz == 6 else 0.0
