"""Gauss-Newton: on linear problems it is least squares, and it says when it cannot be."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.errors import ADVICE, Status
from foucault.infer.gauss_newton import huber, least_squares, solve
from foucault.models.imu import LAYOUT
from foucault.result import Linearised, Problem

NAMES = ("accel.bias.x", "accel.bias.y", "gyro.scale.z")
RNG = np.random.default_rng(10)
A = RNG.normal(size=(40, 5))  # three coefficients, two nuisance parameters
TRUTH = np.array([1.0, -2.0, 3.0, 4.0, -5.0])
B = A @ TRUTH + RNG.normal(size=40)


def linear(A=A, b=B, prior=None, names=NAMES, block=1):
    blocks = np.arange(len(b)) // block

    def linearise(x, weights):
        share = np.sqrt(weights)[blocks]
        return Linearised(share * (b - A @ x), share[:, None] * A, blocks)

    return Problem(
        LAYOUT.subset(names), np.zeros(A.shape[1]), linearise, np.add,
        lambda x: x[: len(names)], len(b) // block, prior,
    )  # fmt: skip


def test_a_linear_problem_is_least_squares_with_its_covariance():
    got = solve(linear())
    want, square, _, _ = np.linalg.lstsq(A, B)
    cov = np.linalg.inv(A.T @ A)
    assert got.status is Status.CONVERGED
    np.testing.assert_allclose(got.state, want, rtol=1e-12)
    np.testing.assert_allclose(got.coefficients.values, want[:3], rtol=1e-12)
    np.testing.assert_allclose(got.state_cov, cov, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(got.coefficients.cov, cov[:3, :3], rtol=1e-11, atol=1e-14)
    assert got.chi_square == pytest.approx(square[0], rel=1e-12)
    assert got.dof == 35
    hat = A @ cov @ A.T
    np.testing.assert_allclose(got.leverage, np.diag(hat), rtol=1e-11)
    assert got.leverage.sum() == pytest.approx(5)


def test_information_is_the_schur_complement():
    N = A.T @ A
    schur = N[:3, :3] - N[:3, 3:] @ np.linalg.inv(N[3:, 3:]) @ N[3:, :3]
    np.testing.assert_allclose(solve(linear()).information, schur, rtol=1e-11)


def test_scales_of_the_unknowns_do_not_matter():
    scale = np.array([1e-9, 1e9, 1.0, 1e6, 1e-6])
    got = solve(linear(A * scale))
    assert got.status is Status.CONVERGED
    np.testing.assert_allclose(got.state * scale, solve(linear()).state, rtol=1e-9)


def test_a_prior_is_bayes_rule():
    mean, sd = np.array([2.0, 0.0, 0.0]), np.array([0.05, np.inf, 1e-4])
    prior = CoefficientVector(LAYOUT.subset(NAMES), mean, prior_sd=sd)
    got = solve(linear(prior=prior))
    W = np.diag(np.r_[1 / sd**2, 0, 0])
    cov = np.linalg.inv(A.T @ A + W)
    want = cov @ (A.T @ B + W @ np.r_[mean, 0, 0])
    np.testing.assert_allclose(got.state, want, rtol=1e-10)
    np.testing.assert_allclose(got.state_cov, cov, rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(got.coefficients.prior_sd, sd)
    assert (got.blocks == -1).sum() == 2


def test_weights_multiply_information():
    weights = RNG.uniform(0.1, 1, 40)

    def constant(given, norms):
        return given

    got = solve(linear(), loss=partial(constant, weights))
    W = np.diag(weights)
    cov = np.linalg.inv(A.T @ W @ A)
    np.testing.assert_allclose(got.state, cov @ A.T @ W @ B, rtol=1e-10)
    np.testing.assert_allclose(got.state_cov, cov, rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(got.weights, weights)


def test_huber_solves_its_own_equations_and_tames_an_outlier():
    b = B.copy()
    b[7] += 100.0
    plain, robust = solve(linear(b=b)), solve(linear(b=b), loss=huber, max_iterations=60)
    assert robust.status is Status.CONVERGED
    r = b - A @ robust.state
    # At the minimum of Huber's loss the clipped residuals are orthogonal to the columns; the
    # iteration stops when a step is below 1e-4 sd or weights settle to 1e-3.
    gradient = np.linalg.inv(A.T @ A) @ A.T @ np.clip(r, -3.0, 3.0)
    assert np.sqrt(gradient @ A.T @ A @ gradient) < 0.01
    assert robust.weights[7] == pytest.approx(3 / abs(r[7]), rel=2e-3)
    assert np.delete(robust.weights, 7) == pytest.approx(
        np.minimum(1, 3 / np.abs(np.delete(r, 7))), rel=2e-3
    )
    good = solve(linear()).state
    assert np.linalg.norm(A @ (robust.state - good)) < 0.1 * np.linalg.norm(
        A @ (plain.state - good)
    )


def test_losses():
    norms = np.array([0.0, 2.9, 3.0, 6.0, np.inf])
    np.testing.assert_allclose(huber(norms), [1, 1, 1, 0.5, 0])
    np.testing.assert_allclose(huber(norms, limit=2.0)[3], 1 / 3)
    np.testing.assert_allclose(least_squares(norms), 1)


def test_blocks_are_judged_as_a_whole():
    b = B.copy()
    b[6:8] += 60.0
    got = solve(linear(b=b, block=2), loss=huber, max_iterations=60)
    assert got.weights.shape == (20,)
    assert got.weights[3] < 0.2
    assert np.delete(got.weights, 3).min() > 0.5


def test_a_nonlinear_problem_meets_scipy():
    from scipy.optimize import least_squares as scipy_solve

    t = np.linspace(0, 3, 30)
    y = 2 * np.exp(-0.7 * t) + 0.3 + 0.01 * np.random.default_rng(11).normal(size=30)

    def model(x):
        return x[0] * np.exp(-x[1] * t) + x[2]

    def linearise(x, weights):
        J = np.stack([np.exp(-x[1] * t), -x[0] * t * np.exp(-x[1] * t), np.ones(30)], 1)
        return Linearised((y - model(x)) / 0.01, J / 0.01, np.arange(30))

    problem = Problem(LAYOUT.subset(NAMES), np.array([1.0, 1.5, 0.0]), linearise, np.add,
                      lambda x: x, 30)  # fmt: skip
    got = solve(problem, tolerance=1e-9)
    want = scipy_solve(lambda x: model(x) - y, [1.0, 1.5, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert got.status is Status.CONVERGED
    np.testing.assert_allclose(got.state, want.x, rtol=1e-7)
    rough = solve(problem, max_iterations=1)
    assert rough.status is Status.NOT_CONVERGED
    assert "did not settle" in ADVICE[rough.status]


def test_what_is_not_seen_is_named():
    blind = A.copy()
    blind[:, 1] = 0.0
    got = solve(linear(blind))
    assert got.status is Status.UNOBSERVABLE
    assert got.weakest == ("accel.bias.y",)
    assert "Add rests" in ADVICE[got.status]
    # What is seen is estimated all the same.
    want = np.linalg.lstsq(np.delete(blind, 1, axis=1), B)[0]
    np.testing.assert_allclose(np.delete(got.state, 1), want, rtol=1e-8)


def test_what_cannot_be_told_apart_is_named_as_a_combination():
    twins = A.copy()
    twins[:, 2] = twins[:, 0]
    got = solve(linear(twins))
    assert got.status is Status.UNOBSERVABLE
    (words,) = got.weakest
    assert "0.71 accel.bias.x" in words and "0.71 gyro.scale.z" in words
    assert "accel.bias.y" not in words
    # A prior on one of them resolves it.
    prior = CoefficientVector(
        LAYOUT.subset(NAMES), np.zeros(3), prior_sd=np.array([1.0, np.inf, np.inf])
    )
    assert solve(linear(twins, prior=prior)).status is Status.CONVERGED


def test_fewer_observations_than_unknowns():
    got = solve(linear(A[:4], B[:4]))
    assert got.status is Status.UNOBSERVABLE


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_a_status(bad):
    b = B.copy()
    b[5] = bad
    got = solve(linear(b=b))
    assert got.status is Status.NOT_FINITE
    assert "saturated or missing" in ADVICE[got.status]


def test_where_no_part_of_a_step_lowers_anything_it_stops_and_says_so():
    asked = []

    def linearise(x, weights):
        asked.append(x)
        # The slope has the wrong sign, as where the covariance hangs on the state.
        return Linearised(np.full(8, 50.0) + 5 * x[0], np.ones((8, 1)), np.arange(8))

    problem = Problem(LAYOUT.subset(NAMES[:1]), np.zeros(1), linearise, np.add, lambda x: x[:1], 8)
    got = solve(problem)
    assert got.status is Status.NOT_CONVERGED and got.state == 0.0
    assert got.iterations == 1 and len(asked) < 12
