"""The filter and smoother of poses against one dense least squares, compiled and as Python."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels import pose as kernels
from foucault.models.rotation import cross_matrix, exp

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def of(name: str, form: str):
    kernel = getattr(kernels, name)
    return kernel if form == "compiled" else kernel.py_func


def increments(m=4, each=3):
    rng = np.random.default_rng(2)
    n = m * each + 1
    dt = np.full(n, 0.01)
    theta, force = 0.05 * rng.standard_normal((n, 3)), 0.1 * rng.standard_normal((n, 3))
    late = rng.standard_normal((n, 3))
    return np.arange(m) * each, dt, theta, force, late


def added(form, node, dt, theta, force, late):
    m = len(node)
    out, J, Q = np.zeros((m, 16)), np.zeros((m, 9, 22)), np.zeros((m, 9, 9))
    middle, one = dt[:, None] * force / 2, np.eye(3)
    of("preintegrate", form)(node, dt, theta, force, middle, one, one, theta, force, late,
                             1e-4, 1e-3, out, J, Q)  # fmt: skip
    return out, J, Q


@FORMS
def test_increments_add_up_and_their_slopes_are_differences(form):
    node, dt, theta, force, late = increments()
    out, J, Q = added(form, node, dt, theta, force, late)
    C, v, p = np.eye(3), np.zeros(3), np.zeros(3)
    for k in range(node[1] + 1, node[2] + 1):
        p = p + v * dt[k] + C @ force[k] * dt[k] / 2
        v, C = v + C @ force[k], C @ exp(theta[k])
    np.testing.assert_allclose(out[2, :9].reshape(3, 3), C, atol=1e-12)
    np.testing.assert_allclose(out[2, 9:15], [*v, *p], atol=1e-12)
    assert out[2, 15] == pytest.approx(0.03)
    h = 1e-6
    for column, change in ((0, (1, 0)), (4, (0, 1))):  # biases of gyro x and accelerometer y
        axis = column % 3
        less = -h * dt[:, None] * np.eye(3)[axis]
        d_theta, d_u = change[0] * less, change[1] * less
        # Force in axes of the beginning of an interval: u + theta x u / 2.
        d_force = d_u + np.cross(d_theta, force) / 2 + np.cross(theta, d_u) / 2
        other = added(form, node, dt, theta + d_theta, force + d_force, late)[0]
        from foucault.models.rotation import log

        turn = log(out[2, :9].reshape(3, 3).T @ other[2, :9].reshape(3, 3))
        slope = np.concatenate([turn, other[2, 9:15] - out[2, 9:15]]) / h
        np.testing.assert_allclose(J[2, :, column], slope, atol=5e-3 * np.abs(slope).max())
    assert np.linalg.eigvalsh(Q[2]).min() > 0


def step(k, C, moved, J, G, keep, Phi, B):
    """Fill Phi (d, d) and B (d, 32): from the errors of node k - 1 to those of node k."""
    T, a, b = moved[k, 15], moved[k, 9:12], moved[k, 12:15]
    Phi[:9, :9] = np.eye(9)
    Phi[:3, :3] = moved[k, :9].reshape(3, 3).T
    Phi[3:6, :3], Phi[6:9, :3] = -C @ cross_matrix(a), -C @ cross_matrix(b)
    Phi[6:9, 3:6] = T * np.eye(3)
    Phi[9:, 9:] = np.diag(keep[k])
    B[:3, 10:], B[3:6, 10:], B[6:9, 10:] = J[k, :3], C @ J[k, 3:6], C @ J[k, 6:]
    B[3:6, 8:10], B[6:9, 8:10] = T * G, T**2 / 2 * G


@FORMS
@pytest.mark.parametrize("n", [0, 6], ids=["white", "errors that stay"])
def test_filter_and_smoother_are_one_least_squares(form, n):
    rng = np.random.default_rng(3)
    moved, J, Q = added(form, *increments())
    m, p, d = len(moved), 32, 9 + n
    C = exp(rng.standard_normal((m, 3)))
    u, G = np.zeros((m, d)), rng.standard_normal((3, 2))
    u[:, :9] = 0.01 * rng.standard_normal((m, 9))
    z, H, D = (rng.standard_normal(s) for s in ((m, 6), (m, 6, d), (m, 6, p)))
    H[:, :, 9:] = np.eye(6)[:, :n]
    keep, stays = rng.uniform(0.5, 0.9, (m, n)), rng.uniform(0.5, 2.0, n)
    R = rng.uniform(0.5, 1.0, (m, 6))
    P0 = np.diag(np.append(np.full(9, 4.0), stays))
    R[1, 2] = np.inf
    nu, M = np.zeros((m, 6)), np.zeros((m, 6, p))
    x, P = np.zeros((m, d)), np.zeros((m, d, d))
    motion = (C, moved, J, Q, u, G, keep, stays)
    assert of("forward", form)(*motion, z, H, D, R, P0, nu, M, x, P)
    # The same as one system: rows of the start, of each step, of each measurement.
    wide = d * m
    A, b = [np.diag(np.diag(P0) ** -0.5) @ np.eye(d, wide + p)], [np.zeros(d)]
    for k in range(1, m):
        Phi, B = np.zeros((d, d)), np.zeros((d, p))
        step(k, C[k - 1], moved, J, G, keep, Phi, B)
        T = np.kron(np.diag([0.0, 1.0, 1.0]), C[k - 1]) + np.kron(np.diag([1.0, 0, 0]), np.eye(3))
        cov = np.diag(np.append(np.zeros(9), (1 - keep[k] ** 2) * stays))
        cov[:9, :9] = T @ Q[k] @ T.T
        L = np.linalg.inv(np.linalg.cholesky(cov))
        row = np.zeros((d, wide + p))
        row[:, d * k : d * k + d], row[:, d * k - d : d * k], row[:, wide:] = np.eye(d), -Phi, -B
        A, b = [*A, L @ row], [*b, L @ u[k]]
    for k in range(m):
        row = np.zeros((6, wide + p))
        row[:, d * k : d * k + d], row[:, wide:] = H[k], D[k]
        s = np.where(np.isfinite(R[k]), 1 / np.sqrt(R[k]), 0.0)[:, None]
        A, b = [*A, s * row], [*b, s[:, 0] * z[k]]
    known = 3.0
    whole = np.vstack([*A, np.eye(wide + p)[wide:] * known])
    best = np.linalg.lstsq(whole, np.concatenate([*b, np.zeros(p)]), rcond=None)[0]
    rows = M.reshape(-1, p)
    delta = np.linalg.solve(rows.T @ rows + known**2 * np.eye(p), rows.T @ nu.ravel())
    np.testing.assert_allclose(delta, best[wide:], atol=1e-7)
    following = np.zeros((m, n))
    for k in range(1, m):
        Phi, B = np.zeros((d, d)), np.zeros((d, p))
        step(k, C[k - 1], moved, J, G, keep, Phi, B)
        u[k] += B @ delta
    none = np.zeros((m, 6, 0))
    of("forward", form)(*motion, z - D @ delta, H, none, R, P0, nu, none, x, P)
    assert of("backward", form)(C, moved, Q, u, keep, stays, True, x, P, following)
    np.testing.assert_allclose(x.ravel(), best[:wide], atol=1e-6)
    # The covariance of the motion, the parameters known.
    dense = np.linalg.inv(np.vstack(A)[:, :wide].T @ np.vstack(A)[:, :wide]).reshape(m, d, m, d)
    for k in range(m):
        np.testing.assert_allclose(P[k], dense[k, :, k], atol=1e-7)
        if k + 1 < m:
            np.testing.assert_allclose(following[k], np.diag(dense[k, :, k + 1])[9:], atol=1e-7)
