"""Functions of temperature by generalised least squares, against brute force and in the mean."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from foucault.estimate.temperature import (
    Design,
    Evidence,
    Spaces,
    _stacks,
    _unlikely,
    against,
    choose,
    scatter,
    solve,
)

T = np.linspace(-1, 1, 7)
POWERS = np.vander(T, 4, increasing=True)
SPACES = tuple(np.eye(4)[: k + 1] for k in range(3))
FAMILY = np.array([0, 0, 1])


def pieces(
    rng: np.random.Generator, weights: np.ndarray, own: tuple[float, float] = (0.0, 0.0)
) -> list[Evidence]:
    """Seven sessions of three coefficients, correlated, with scatter `own` of two families."""
    out = []
    for phi in POWERS:
        root = rng.normal(size=(3, 3)) * 0.3 + np.eye(3)
        cov = root @ root.T
        y = weights @ phi + root @ rng.normal(size=3) + np.array(own)[FAMILY] * rng.normal(size=3)
        out.append(Evidence(phi, y, cov, np.eye(3), FAMILY))
    return out


WEIGHTS = np.array([[1.0, 5.0, 0.0, 0.0], [2.0, -4.0, 0.0, 0.0], [7.0, 0.0, 0.0, 0.0]])
DESIGN = Design.of([SPACES[1], SPACES[1], SPACES[0]])


def dense(evidence: list[Evidence], variance: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return X, y and V written out."""
    X = np.concatenate([DESIGN.rows(e) for e in evidence])
    y = np.concatenate([e.y for e in evidence])
    V = np.zeros((len(y), len(y)))
    for k, e in enumerate(evidence):
        at = slice(3 * k, 3 * k + 3)
        V[at, at] = e.cov + np.diag(variance[e.group])
    return X, y, V


def test_the_fit_is_generalised_least_squares() -> None:
    evidence, variance = pieces(np.random.default_rng(1), WEIGHTS), np.array([0.5, 2.0])
    fit = solve(evidence, DESIGN, variance)
    X, y, V = dense(evidence, variance)
    P = np.linalg.inv(X.T @ np.linalg.solve(V, X))
    theta = P @ X.T @ np.linalg.solve(V, y)
    np.testing.assert_allclose(fit.theta, theta, rtol=1e-8)
    np.testing.assert_allclose(fit.cov, P, rtol=1e-8)
    r = y - X @ theta
    assert fit.chi_square == pytest.approx(r @ np.linalg.solve(V, r), rel=1e-8)
    assert fit.dof == 21 - 5
    said, cov = fit.predicted(evidence[2])
    np.testing.assert_allclose(said, (X @ theta)[6:9], rtol=1e-8)
    np.testing.assert_allclose(cov, X[6:9] @ P @ X[6:9].T + V[6:9, 6:9], rtol=1e-8)


@pytest.mark.parametrize("restricted", [True, False])
def test_the_likelihood_and_its_slope(restricted: bool) -> None:
    evidence, variance = pieces(np.random.default_rng(2), WEIGHTS), np.array([0.7, 1.5])

    def value(v: np.ndarray) -> float:
        X, y, V = dense(evidence, v)
        A = X.T @ np.linalg.solve(V, X)
        r = y - X @ np.linalg.solve(A, X.T @ np.linalg.solve(V, y))
        logs = np.linalg.slogdet(V)[1] + restricted * np.linalg.slogdet(A)[1]
        return 0.5 * float(logs + r @ np.linalg.solve(V, r))

    got, slope = _unlikely(_stacks(evidence, DESIGN), variance, restricted)
    assert got == pytest.approx(value(variance), rel=1e-8)
    for k in range(2):
        step = 1e-5 * np.eye(2)[k]
        want = (value(variance + step) - value(variance - step)) / 2e-5
        assert slope[k] == pytest.approx(want, rel=1e-5)


def test_the_scatter_found_is_a_minimum() -> None:
    evidence = pieces(np.random.default_rng(3), WEIGHTS, (6.0, 0.0))
    found = scatter(evidence, DESIGN, np.zeros(2), np.ones(2, bool))
    best, _ = _unlikely(_stacks(evidence, DESIGN), found, True)
    assert found[0] > 5.0
    for part in (0.8, 1.25):
        for k in range(2):
            other = found.copy()
            other[k] = other[k] * part if other[k] > 0 else 0.05
            assert _unlikely(_stacks(evidence, DESIGN), other, True)[0] > best
    declared = scatter(evidence, DESIGN, np.array([4.0, 0.0]), np.array([False, True]))
    assert declared[0] == 4.0


@pytest.mark.thorough
def test_large_scatter_is_found_without_bias() -> None:
    """With scatter far above the covariances, REML is the mean square over its dof."""
    rng, n, found = np.random.default_rng(4), 100, []
    for _ in range(n):
        evidence = pieces(rng, WEIGHTS, (50.0, 0.0))
        found.append(scatter(evidence, DESIGN, np.zeros(2), np.ones(2, bool))[0])
    dof = n * (14 - 4)
    total = dof * np.mean(found) / (50.0**2 + 1.1)
    low, high = stats.chi2.ppf([0.005, 0.995], dof)
    assert low < total < high


def test_what_cannot_be_told_is_none() -> None:
    evidence = pieces(np.random.default_rng(5), WEIGHTS)[:2]
    three = Design.of([SPACES[2], SPACES[0], SPACES[0]])
    assert solve(evidence, three, np.zeros(2)) is None
    same = [Evidence(POWERS[0], e.y, e.cov, e.H, e.group) for e in evidence * 3]
    assert solve(same, DESIGN, np.zeros(2)) is None


def test_tied_coefficients_take_no_freedom() -> None:
    rng, evidence = np.random.default_rng(6), []
    root = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]])  # the second is twice the first
    for phi in POWERS:
        e = root @ rng.normal(size=2)
        evidence.append(Evidence(phi, np.array([1.0, 2.0, 0.0]) * (1 + 3 * phi[1]) + e,
                                 root @ root.T, np.eye(3), np.array([0, 0, 1])))  # fmt: skip
    fit = solve(evidence, DESIGN, np.zeros(2))
    assert fit.dof == 14 - 3  # two of the three lines are one
    np.testing.assert_allclose(fit.theta[2:4], 2 * fit.theta[:2], rtol=1e-6)
    low, high = stats.chi2.ppf([0.0005, 0.9995], fit.dof)
    assert low < fit.chi_square < high


SPACE = Spaces((SPACES, SPACES), FAMILY, SPACES[0], 0)


def test_terms_are_taken_away_until_they_are_needed() -> None:
    evidence = pieces(np.random.default_rng(7), WEIGHTS)
    choice = choose(evidence, SPACE, {}, np.zeros(2), np.zeros(2, bool))
    assert choice.orders == (1, 0)
    (needed,) = choice.needed
    assert (needed.family, needed.order, needed.against) == (0, 0, 1)
    assert needed.p < 1e-6
    assert [t.against for t in choice.missing] == [2, 2]
    assert np.isinf(choice.dof).all()
    # A parabola without a slope is a parabola.
    bent = np.array([[1.0, 0.0, 30.0, 0.0], [1.0, 0.0, -30.0, 0.0], [7.0, 0.0, 0.0, 0.0]])
    evidence = pieces(np.random.default_rng(8), bent)
    assert choose(evidence, SPACE, {}, np.zeros(2), np.ones(2, bool)).orders == (2, 0)
    fixed = choose(evidence, SPACE, {0: 1}, np.zeros(2), np.ones(2, bool))
    assert fixed.orders == (1, 0)
    assert fixed.missing[0].p < 1e-6  # and is told to be too few


def test_scatter_counts_with_students_factor_for_what_tells_it() -> None:
    rng = np.random.default_rng(3)
    evidence = pieces(rng, WEIGHTS, (3.0, 3.0))
    free, none = np.ones(2, bool), np.zeros(2)
    found = choose(evidence, SPACE, {0: 1, 1: 0}, none, free)
    assert found is not None and np.isfinite(found.dof).all()
    wide = solve(evidence, found.fit.design, found.fit.variance * found.dof / (found.dof - 2))
    np.testing.assert_allclose(found.cov, wide.cov)
    assert (np.diag(found.cov) > np.diag(found.fit.cov)).all()
    known = choose(evidence, SPACE, {0: 1, 1: 0}, none + 9.0, ~free)
    assert known is not None
    np.testing.assert_array_equal(known.cov, known.fit.cov)


@pytest.mark.thorough
@pytest.mark.parametrize("wanted", [False, True])
def test_a_term_too_many_is_chosen_as_often_as_said(wanted: bool) -> None:
    """1 % of all choices, for both families together, where nothing changes with temperature."""
    rng, n, wrong = np.random.default_rng(9), 100, 0
    flat = WEIGHTS * np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(n):
        choice = choose(pieces(rng, flat, (3.0, 0.0) if wanted else (0.0, 0.0)), SPACE, {},
                        np.zeros(2), np.full(2, wanted))  # fmt: skip
        wrong += choice.orders != (0, 0)
    # Two tests per family, at most: 2 % in all; more than 6 of 100 is rarer than 1 %.
    assert wrong <= stats.binom.ppf(0.99, n, 0.02)


def test_the_f_test_is_that_of_the_textbook() -> None:
    rng = np.random.default_rng(10)
    x = np.linspace(0, 1, 12)
    y = 1 + 0.4 * x + 0.1 * rng.normal(size=12)
    sse = [np.sum((y - np.polyval(np.polyfit(x, y, k), x)) ** 2) for k in (0, 1)]
    F = (sse[0] - sse[1]) / (sse[1] / 10)
    evidence = [
        Evidence(np.array([1.0, t]), np.array([v]), np.array([[sse[1] / 10]]), np.eye(1),
                 np.array([0]))
        for t, v in zip(x, y, strict=True)
    ]  # fmt: skip
    fits = [solve(evidence, Design.of([np.eye(2)[: k + 1]]), np.zeros(1)) for k in (0, 1)]
    got, p, terms = against(fits[0], fits[1], 10.0)
    assert terms == 1
    assert got == pytest.approx(F, rel=1e-8)
    assert p == pytest.approx(stats.f.sf(F, 1, 10), rel=1e-8)
    assert against(fits[0], fits[1], np.inf)[1] == pytest.approx(stats.chi2.sf(F, 1), rel=1e-7)
