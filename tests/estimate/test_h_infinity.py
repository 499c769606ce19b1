"""The H-infinity filter: its limits, its least gamma, and the bound that it promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.infer.linear_filter import LinearSystem, by_prior, h_infinity, kalman, least_gamma

STEP = np.array([[1.0, 0.1], [0.0, 1.0]])


def system(m=60, seed=0):
    """A position that drifts, measured."""
    rng = np.random.default_rng(seed)
    return LinearSystem(
        np.tile(STEP, (m, 1, 1)), np.full((m, 2), 5e-4), np.tile([[1.0, 0.0]], (m, 1, 1)),
        rng.normal(size=(m, 1)), np.ones((m, 1)), np.zeros(2), np.diag([4.0, 1.0]),
    )  # fmt: skip


def test_an_infinite_gamma_is_the_kalman_filter():
    s = system()
    L = by_prior(s)
    plain, bound = kalman(s), h_infinity(s, L, np.inf)
    np.testing.assert_array_equal(bound.states, plain.states)
    far = h_infinity(s, L, 1e7)
    np.testing.assert_allclose(far.states, plain.states, rtol=0, atol=1e-9)


def test_the_least_gamma_exists_and_a_smaller_does_not():
    s = system()
    L = by_prior(s)
    gamma = least_gamma(s, L, within=1e-3)
    assert h_infinity(s, L, gamma).stopped is None
    below = h_infinity(s, L, gamma / 1.002)
    assert below.stopped is not None
    assert np.isnan(below.states[below.stopped + 1 :]).all()
    assert (below.margin[: below.stopped] > 0).all() and below.margin[below.stopped] <= 0


def worst_ratio(s, L, gamma):
    """The largest energy of the error of L x over that of what made it, by its operator.

    The filter is linear: with zero data its error is a matrix times (start, noises), each divided
    by the root of its covariance.
    """
    m, n = len(s.Phi), len(s.x0)
    quiet = replace(s, z=np.zeros_like(s.z))
    zero = h_infinity(quiet, L, gamma)
    assert zero.stopped is None
    columns = []
    kinds = n + m * n + m
    for j in range(kinds):
        x = np.zeros(n)
        z, true = np.zeros_like(s.z), np.zeros((m, n))
        if j < n:
            x = np.linalg.cholesky(s.P0)[:, j]
        for k in range(m):
            x = s.Phi[k] @ x
            i = j - n - k * n
            if 0 <= i < n:
                half = np.diag(s.half[k])
                x = x + np.linalg.cholesky(s.Phi[k] @ half @ s.Phi[k].T + half)[:, i]
            true[k], z[k] = x, s.H[k] @ x
            if j == n + m * n + k:
                z[k] += np.sqrt(s.R[k, 0])
        found = h_infinity(replace(s, z=z), L, gamma)
        columns.append(((true - found.states) @ L.T).ravel())
    return np.linalg.norm(np.array(columns).T, 2)


def test_the_error_stays_below_the_bound():
    s = system(m=15)
    L = np.array([[0.3, 1.0]])
    gamma = 1.05 * least_gamma(s, L)
    bound, plain = worst_ratio(s, L, gamma), worst_ratio(s, L, np.inf)
    assert bound < gamma
    assert bound < plain  # what a Kalman filter promises nothing of


def test_what_cannot_be_is_refused():
    s = system()
    with pytest.raises(FoucaultError, match=r"gamma is -1; it must be above 0"):
        h_infinity(s, by_prior(s), -1.0)
    with pytest.raises(FoucaultError, match=r"L has shape \(2, 3\).*each of the 2 states"):
        h_infinity(s, np.zeros((2, 3)), 1.0)
    with pytest.raises(FoucaultError, match=r"Even with gamma 1e\+12 the filter does not exist"):
        least_gamma(replace(s, P0=np.diag([1e30, 1.0]), R=np.full_like(s.R, np.inf)), np.eye(2))
