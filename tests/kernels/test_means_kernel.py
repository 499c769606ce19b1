"""The kernel that weighs means, compiled and as plain Python, against an obvious twin."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels import means as module
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def fitted(form, design, variance, slow, known):
    g, k, p = max(len(design), len(variance), len(slow)), *design.shape[1:]
    out = np.empty((g, p, k)), np.empty((g, k, k)), np.empty((g, k)), np.empty(g, np.int64)
    unseen = np.empty(g)
    none = np.empty((0, k))
    kernel(form, module, "fit_batch")(design, variance, slow, known, *out, unseen, none, none, none,
                                      0.0, none[:, :p], none, none, none, unseen)  # fmt: skip
    missing = np.eye(p)[:2, :2] - out[0][:, :2] @ design[:, :, :2]
    np.testing.assert_allclose(unseen, np.square(missing).sum(axis=(1, 2)), atol=1e-12)
    return out


def twin(X, v, S, known):
    """Return weights and redundancy by inverses, and the redundant readings."""
    P = np.linalg.inv(np.diag(v) + S)
    scale = 1 / np.sqrt(np.diag(X.T @ P @ X) + known)
    N = (X.T @ P @ X + np.diag(known)) * np.outer(scale, scale)
    W = scale[:, None] * np.linalg.pinv(N, rcond=1e-13) @ (X * scale).T @ P
    return W, len(v) - round(np.trace(X @ W))


def problem(g=5, k=6, p=4, seed=1):
    rng = np.random.default_rng(seed)
    a = rng.uniform(0, 2 * np.pi, (g, k))
    X = np.stack([np.sin(a), np.cos(a), np.ones((g, k)), np.linspace(-300.0, 300.0, g * k)
                  .reshape(g, k)], 2)[..., :p]  # fmt: skip
    mix = rng.standard_normal((g, k, 3))
    slow = 1e-14 * mix @ np.swapaxes(mix, 1, 2)
    return np.ascontiguousarray(X), 1e-14 * rng.uniform(0.5, 2, (g, k)), slow, np.zeros(p)


@FORMS
@pytest.mark.parametrize(("k", "p"), [(6, 4), (4, 3), (3, 3), (4, 1)])
def test_weights_are_those_of_least_squares(form, k, p):
    X, v, S, known = problem(k=k, p=p)
    known[-1] = 1e13
    weights, root, redundancy, dof = fitted(form, X, v, S, known)
    for i in range(len(X)):
        W, spare = twin(X[i], v[i], S[i], known)
        np.testing.assert_allclose(weights[i], W, rtol=1e-7, atol=1e-9 * np.abs(W).max())
        assert dof[i] == spare
    white = np.repeat(np.eye(k)[None], len(X), 0)
    kernel(form, module, "whiten_batch")(root, white)
    for i in range(len(X)):
        cov = np.diag(v[i]) + S[i]
        np.testing.assert_allclose(white[i] @ cov @ white[i].T, np.eye(k), atol=1e-9)
        hat = white[i] @ X[i] @ weights[i] @ np.linalg.inv(white[i])
        np.testing.assert_allclose(redundancy[i], 1 - np.diag(hat), atol=1e-9)


@FORMS
@pytest.mark.parametrize("alike", [False, True])
@pytest.mark.parametrize("index_sd", [0.0, 0.3])
def test_what_readings_say_is_what_their_weights_make_of_them(form, alike, index_sd):
    """A wrong index angle makes a reading less certain by its slope at what it says without it."""
    X, v, S, known = problem(g=4)
    if alike:
        X, v, S = X[:1], v[:1], S[:1]
    sine, cosine = (np.ascontiguousarray(X[..., i]) for i in (0, 1))
    g, k, p = 4, *X.shape[1:]
    x = 1e-7 * np.random.default_rng(3).standard_normal((g, k))
    own = 1 if alike and not index_sd else g
    weights, root = np.full((own, p, k), np.nan), np.full((own, k, k), np.nan)
    red, dof, unseen = np.empty((own, k)), np.empty(own, np.int64), np.empty(own)
    unknowns, square = np.empty((g, p)), np.empty(g)
    expected, residuals, white = np.empty((3, g, k))
    kernel(form, module, "fit_batch")(
        X, v, S, known, weights, root, red, dof, unseen, x, cosine, sine, index_sd, unknowns,
        expected, residuals, white, square,
    )  # fmt: skip
    for i in range(g):
        X_i, v_i, S_i = (one[0 if alike else i] for one in (X, v, S))
        e, n = (twin(X_i, v_i, S_i, known)[0] @ x[i])[:2]
        more = (index_sd * (e * X_i[:, 1] - n * X_i[:, 0])) ** 2
        W, spare = twin(X_i, v_i + more, S_i, known)
        at = i if own > 1 else 0
        np.testing.assert_allclose(weights[at], W, rtol=1e-6, atol=1e-9 * np.abs(W).max())
        np.testing.assert_allclose(unknowns[i], W @ x[i], rtol=1e-6)
        left = x[i] - X_i @ W @ x[i]
        np.testing.assert_allclose(expected[i], x[i] - left, atol=1e-14)
        cov = np.diag(v_i + more) + S_i
        np.testing.assert_allclose(square[i], left @ np.linalg.solve(cov, left), rtol=1e-6)
        np.testing.assert_allclose(white[i], np.linalg.solve(np.linalg.cholesky(cov), left),
                                   atol=1e-6)  # fmt: skip
        np.testing.assert_allclose(residuals[i], white[i] / np.sqrt(red[at]), rtol=1e-9)
        assert dof[at] == spare


@FORMS
def test_what_no_reading_shows_gets_no_weight(form):
    """Two opposite stops show one direction and the offset."""
    a = np.radians([[30.0, 210.0]])
    X = np.stack([np.sin(a), np.cos(a), np.ones((1, 2))], 2)
    weights, _, _, dof = fitted(form, X, np.ones((1, 2)), np.zeros((1, 2, 2)), np.zeros(3))
    W, _ = twin(X[0], np.ones(2), np.zeros((2, 2)), np.zeros(3))
    np.testing.assert_allclose(weights[0], W, atol=1e-12)
    assert dof[0] == 0


@FORMS
def test_what_all_share_has_one_row_and_a_bad_row_is_not_a_number(form):
    X, v, S, known = problem()
    v[2] = np.nan
    each = fitted(form, np.repeat(X[:1], 5, 0), v, np.repeat(S[:1], 5, 0), known)
    shared = fitted(form, X[:1], v, S[:1], known)
    for one, other in zip(each[::2], shared[::2], strict=True):
        np.testing.assert_array_equal(one, other)
        assert np.isnan(one[2]).all() and np.isfinite(one[[0, 1, 3, 4]]).all()


@pytest.mark.parametrize("form", ["compiled", "python"])
@pytest.mark.parametrize("alike", [False, True])
def test_what_noise_is_in_two_numbers_is_its_covariance_between_their_weights(form, alike):
    rng = np.random.default_rng(4)
    g, k = 3, 5
    W, white, slow = rng.random((g, 2, k)), rng.random((g, k)), rng.random((g, k, k))
    if alike:
        W, white, slow = W[:1], white[:1], slow[:1]
    S, T = np.zeros((2, 6, 4, 4))
    setups = np.array([5, 0, 2])
    kernel(form, module, "carried_batch")(W, white, slow, setups, 2, S, T)
    for i, n in enumerate(setups):
        j = 0 if alike else i
        np.testing.assert_allclose(S[n, 2:, 2:], W[j] @ np.diag(white[j]) @ W[j].T, rtol=1e-13)
        np.testing.assert_allclose(T[n, 2:, 2:], W[j] @ slow[j] @ W[j].T, rtol=1e-13)
    assert not S[:, :2].any() and not S[[1, 3, 4]].any() and not T[:, :, :2].any()
