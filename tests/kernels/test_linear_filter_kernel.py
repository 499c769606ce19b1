"""The linear filter and smoother, compiled and as plain Python, against one big least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.infer import linear_filter
from foucault.infer.linear_filter import h_infinity
from foucault.kernels import linear_filter as module
from plain_kernels import kernel

FORMS = ["compiled", "python"]


def system(m=12, q=3, n=5, seed=0):
    """Some of Phi, H and the measurements are zero or missing, as in use."""
    rng = np.random.default_rng(seed)
    Phi = np.eye(n) + 0.1 * rng.normal(size=(m, n, n))
    Phi[:, 3] = np.eye(n)[3]
    H = rng.normal(size=(m, q, n))
    H[:, :, 4] = 0.0
    R = 0.5 + rng.random((m, q))
    R[5:6, 1] = np.inf
    root = rng.normal(size=(n, n))
    return linear_filter.LinearSystem(
        Phi, 0.1 * rng.random((m, n)), H, rng.normal(size=(m, q)), R, rng.normal(size=n),
        root @ root.T + np.eye(n),
    )  # fmt: skip


def noise_of(s, k):
    half = np.diag(s.half[k])
    return s.Phi[k] @ half @ s.Phi[k].T + half


def least_squares(s):
    """Solve for all states at once: from the start, (m + 1, n), and their covariances."""
    m, q, n = s.H.shape
    A, b = np.zeros(((m + 1) * n,) * 2), np.zeros((m + 1) * n)
    A[:n, :n] = np.linalg.inv(s.P0)
    b[:n] = A[:n, :n] @ s.x0
    for k in range(m):
        F = np.hstack([-s.Phi[k], np.eye(n)])
        both, now = slice(k * n, (k + 2) * n), slice((k + 1) * n, (k + 2) * n)
        A[both, both] += F.T @ np.linalg.solve(noise_of(s, k), F)
        for a in range(q):
            if np.isfinite(s.R[k, a]):
                A[now, now] += np.outer(s.H[k, a], s.H[k, a]) / s.R[k, a]
                b[now] += s.H[k, a] * s.z[k, a] / s.R[k, a]
    C = np.linalg.inv(A)
    cov = [C[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(m + 1)]
    return (C @ b).reshape(m + 1, n), np.array(cov)


@pytest.mark.parametrize("form", FORMS)
def test_filter_and_smoother_are_least_squares(monkeypatch, form):
    for name in ("linear_filter", "linear_smoother"):
        monkeypatch.setattr(linear_filter, name, kernel(form, module, name))
    s = system()
    run = linear_filter.kalman(s, keep=True)
    states, cov = least_squares(s)
    np.testing.assert_allclose(run.states[-1], states[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.cov, cov[-1], rtol=0, atol=1e-12)
    back = linear_filter.smoothed(s, run)
    np.testing.assert_allclose(back.states, states[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.cov, cov[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.start, states[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.start_cov, cov[0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(linear_filter.smoothed_start(s, run), back.start)
    assert np.isnan(run.innovation[5, 1]) and np.isfinite(run.innovation).sum() == 35


@pytest.mark.parametrize("form", FORMS)
def test_rows_that_are_left_out_are_those_of_the_identity(monkeypatch, form):
    for name in ("linear_filter", "linear_smoother"):
        monkeypatch.setattr(linear_filter, name, kernel(form, module, name))
    s = system()
    s.Phi[:, 2:] = np.eye(5)[2:]
    few = replace(s, Phi=np.ascontiguousarray(s.Phi[:, :2]))
    all_rows, run = linear_filter.kalman(s, keep=True), linear_filter.kalman(few, keep=True)
    np.testing.assert_allclose(run.states, all_rows.states, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.cov, least_squares(s)[1][-1], rtol=0, atol=1e-12)
    back, wanted = linear_filter.smoothed(few, run), linear_filter.smoothed(s, all_rows)
    np.testing.assert_allclose(back.cov, wanted.cov, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.start, wanted.start, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.start_cov, wanted.start_cov, rtol=0, atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_a_known_step_moves_what_is_expected_and_nothing_else(monkeypatch, form):
    """As if the state without it were filtered, with measurements less what the steps make."""
    for name in ("linear_filter", "linear_smoother"):
        monkeypatch.setattr(linear_filter, name, kernel(form, module, name))
    s = system()
    jump = np.zeros((12, 5))
    jump[[3, 7]] = np.random.default_rng(1).normal(size=(2, 5))
    made, total = np.zeros(5), []
    for k in range(12):
        made = s.Phi[k] @ made + jump[k]
        total.append(made)
    total = np.array(total)
    moved = replace(s, jump=jump, z=s.z + np.einsum("kqn,kn->kq", s.H, total))
    plain, run = linear_filter.kalman(s, keep=True), linear_filter.kalman(moved, keep=True)
    np.testing.assert_allclose(run.states - total, plain.states, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.innovation, plain.innovation, rtol=0, atol=1e-12)
    one, other = linear_filter.smoothed(s, plain), linear_filter.smoothed(moved, run)
    np.testing.assert_allclose(other.states - total, one.states, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.start, one.start, rtol=0, atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_h_infinity_is_its_dense_twin(monkeypatch, form):
    monkeypatch.setattr(linear_filter, "linear_filter", kernel(form, module, "linear_filter"))
    s, n = system(), 5
    L = np.random.default_rng(1).normal(size=(2, n))
    gamma = 6.0
    run = h_infinity(s, L, gamma)
    x, P = s.x0, s.P0
    for k in range(len(s.Phi)):
        x, P = s.Phi[k] @ x, s.Phi[k] @ P @ s.Phi[k].T + noise_of(s, k)
        given = np.isfinite(s.R[k])
        h = s.H[k][given]
        S = h @ P @ h.T + np.diag(s.R[k][given])
        K = P @ h.T @ np.linalg.inv(S)
        x, P = x + K @ (s.z[k][given] - h @ x), P - K @ S @ K.T
        np.testing.assert_allclose(run.states[k], x, rtol=0, atol=1e-12)
        rest = gamma**2 * np.eye(2) - L @ P @ L.T
        assert np.linalg.eigvalsh(rest).min() > 0
        cov = P
        P = P + P @ L.T @ np.linalg.solve(rest, L @ P)
    np.testing.assert_allclose(run.cov, cov, rtol=0, atol=1e-12)
    assert run.stopped is None and (run.margin > 0).all()


def test_log_likelihood_is_that_of_all_measurements_together():
    """From the joint covariance of all that is measured, without any recursion."""
    s = system(m=4)
    m, q, n = s.H.shape
    states, cov = [s.x0], np.zeros(((m + 1) * n,) * 2)
    cov[:n, :n] = s.P0
    for k in range(m):
        now, before = slice((k + 1) * n, (k + 2) * n), slice(0, (k + 1) * n)
        cov[now, before] = s.Phi[k] @ cov[k * n : (k + 1) * n, before]
        cov[before, now] = cov[now, before].T
        last = cov[k * n : (k + 1) * n, k * n : (k + 1) * n]
        cov[now, now] = s.Phi[k] @ last @ s.Phi[k].T + noise_of(s, k)
        states.append(s.Phi[k] @ states[-1])
    H = np.zeros((m * q, (m + 1) * n))
    for k in range(m):
        H[k * q : (k + 1) * q, (k + 1) * n : (k + 2) * n] = s.H[k]
    S = H @ cov @ H.T + np.diag(s.R.ravel())
    e = s.z.ravel() - H @ np.concatenate(states)
    want = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
    assert linear_filter.kalman(s).log_likelihood == pytest.approx(want, rel=1e-12)


def test_a_measurement_beyond_the_gate_changes_nothing():
    s = system()
    s.z[7, 2] = 1e3
    run = linear_filter.kalman(s, gate=8.0)
    s.R[7, 2] = np.inf
    without = linear_filter.kalman(s)
    np.testing.assert_array_equal(run.states, without.states)
    assert np.isnan(run.innovation[7, 2]) and np.isfinite(run.variance[7, 2])
