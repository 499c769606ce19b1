"""Results fused are the estimate from all data together, and their differences are chi-square."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate.fusion import Known, fused, with_sources
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import LAYOUT

NAMES = ("gyro.bias.x", "gyro.bias.y", "gyro.scale.x", "accel.bias.x", "accel.scale.x")
UNITS = np.array([1e-5, 1e-5, 1e-3, 1e-2, 1e-3])
PRIOR = 3 * UNITS
MEAN = np.array([1e-5, 0, 0, -1e-2, 0])


def least_squares(H, y, prior=True):
    """Coefficients, covariance and least cost of white observations, unit variance."""
    J = H.T @ H + (np.diag(PRIOR**-2.0) if prior else 0)
    h = H.T @ y + (MEAN / PRIOR**2 if prior else 0)
    P = np.linalg.inv(J)
    x = P @ h
    cost = np.sum((y - H @ x) ** 2) + (np.sum(((x - MEAN) / PRIOR) ** 2) if prior else 0)
    return x, P, cost


def known(x, P, prior=True, names=NAMES):
    sd = PRIOR if prior else np.full(len(names), np.inf)
    means = dict(zip(NAMES, MEAN.tolist(), strict=True)) if prior else {}
    return Known(CoefficientVector(LAYOUT.subset(names), x, P, prior_sd=sd[: len(names)]), means)


def observed(rng, rows, scale=1.0):
    truth = MEAN + PRIOR * rng.standard_normal(5)
    H = scale * rng.standard_normal((rows, 5)) / UNITS
    return truth, H


@pytest.mark.parametrize("prior", [True, False])
def test_two_sessions_are_one_estimate(prior):
    rng = np.random.default_rng(1)
    truth, H1 = observed(rng, 9)
    H2 = rng.standard_normal((7, 5)) / UNITS
    y1, y2 = (H @ truth + rng.standard_normal(len(H)) for H in (H1, H2))
    one, two = (least_squares(H, y, prior) for H, y in ((H1, y1), (H2, y2)))
    both = least_squares(np.vstack([H1, H2]), np.concatenate([y1, y2]), prior)
    got = fused(known(*one[:2], prior), known(*two[:2], prior))
    vector = got.known.vector
    np.testing.assert_allclose(vector.values / UNITS, both[0] / UNITS, rtol=1e-9)
    np.testing.assert_allclose(vector.cov, both[1], rtol=1e-8, atol=1e-12 * np.diag(both[1]).min())
    alone = least_squares(H2, y2, prior=False)[2]
    assert got.chi_square == pytest.approx(both[2] - one[2] - alone, rel=1e-7)
    assert got.dof == 5


def test_a_session_that_sees_less_than_all():
    rng = np.random.default_rng(2)
    truth, H1 = observed(rng, 9)
    H2 = rng.standard_normal((3, 5)) / UNITS  # three of five directions; the prior holds the rest
    y1, y2 = (H @ truth + rng.standard_normal(len(H)) for H in (H1, H2))
    one, two = (least_squares(H, y) for H, y in ((H1, y1), (H2, y2)))
    both = least_squares(np.vstack([H1, H2]), np.concatenate([y1, y2]))
    got = fused(known(*one[:2]), known(*two[:2]))
    np.testing.assert_allclose(got.known.vector.values / UNITS, both[0] / UNITS, rtol=1e-8)
    assert got.dof == 3


def test_a_prior_counts_once():
    x, P = MEAN.copy(), np.diag(PRIOR**2)  # nothing but the prior
    got = fused(known(x, P), known(x, P))
    np.testing.assert_allclose(got.known.vector.sd, PRIOR, rtol=1e-9)
    assert got.dof == 0


def test_other_coefficients_come_beside():
    rng = np.random.default_rng(3)
    A = rng.standard_normal((9, 3)) / UNITS[:3]
    P = np.linalg.inv(A.T @ A)
    gyro = known(UNITS[:3], P, False, NAMES[:3])
    accel = known(UNITS[3:], np.diag(UNITS[3:] ** 2), False, NAMES[3:])
    got = fused(gyro, accel)
    assert got.known.vector.names == NAMES
    np.testing.assert_allclose(got.known.vector.values, UNITS, rtol=1e-9)
    np.testing.assert_allclose(got.known.vector.cov[:3, :3], P, rtol=1e-9)
    assert got.dof == 0
    assert np.isnan(got.change[3:]).all()


def owing(x, P, shared):
    """What a result says whose covariance holds the errors `shared` too."""
    owed = sum((np.outer(L, L) for L in shared.values()), np.zeros_like(P))
    return with_sources(Known(CoefficientVector(LAYOUT.subset(NAMES), x, P + owed)), shared)


def test_what_results_share_is_not_averaged():
    shared = np.array([0, 0, 0, 0, 2e-4])
    one = got = owing(np.zeros(5), np.diag((UNITS / 10) ** 2), {"here": shared})
    for _ in range(99):
        got = fused(got, one).known
    assert got.own.sd[4] == pytest.approx(np.hypot(2e-4, 1e-4 / 10), rel=1e-6)
    assert got.own.sd[0] == pytest.approx(1e-7, rel=1e-6)
    np.testing.assert_allclose(got.shared(NAMES)["here"], shared, rtol=1e-6, atol=1e-12)


def test_errors_of_two_places_are_joined_as_one_least_squares_solution_joins_them():
    rng = np.random.default_rng(7)
    places = [0, 0, 1, 1, 1]
    L = np.array([[0, 0, 1e-3, 2e-2, 1e-3], [0, 0, 2e-4, 4e-3, 2e-4]])
    truth, J, h = UNITS.copy(), np.diag([0, 0, 0, 0, 0, 1.0, 1.0]), np.zeros(7)
    g = rng.standard_normal(2)
    got = None
    for place in places:
        H = rng.standard_normal((8, 5)) / UNITS
        y = H @ (truth + L[place] * g[place]) + rng.standard_normal(8)
        x, P, _ = least_squares(H, y, prior=False)
        one = owing(x, P, {place: L[place]})
        got = one if got is None else fused(got, one).known
        A = np.hstack([H, np.zeros((8, 2))])
        A[:, 5 + place] = H @ L[place]
        J, h = J + A.T @ A, h + A.T @ y
    cov = np.linalg.inv(J)
    sd = np.sqrt(np.diag(cov))[:5]
    np.testing.assert_allclose(got.own.values, (cov @ h)[:5], atol=1e-6 * sd.min())
    np.testing.assert_allclose(got.own.sd, sd, rtol=1e-6)
    for place in (0, 1):
        np.testing.assert_allclose(got.shared(NAMES)[place] / sd, -cov[:5, 5 + place] / sd,
                                   atol=1e-6)  # fmt: skip


def test_a_prior_that_took_a_part_of_what_is_shared():
    # Gravity alone makes 1e-3 of the scale factor, and a prior leaves 1e-4 of it.
    P = np.diag((UNITS / 10) ** 2)
    vector = CoefficientVector(LAYOUT.subset(NAMES), np.zeros(5), P)
    one = with_sources(Known(vector), {"here": np.array([0, 0, 0, 0, 1e-3])})
    assert np.linalg.eigvalsh(one.vector.cov / np.outer(one.vector.sd, one.vector.sd))[0] > 0
    both = fused(one, one).known.own
    assert both.sd[4] == pytest.approx(1e-4, rel=1e-3)
    assert both.sd[3] == pytest.approx(1e-3 / np.sqrt(2), rel=1e-3)


def test_coefficients_that_depend_on_one_another():
    # A model with four parameters for five coefficients: accel.scale.x follows from accel.bias.x.
    T = np.vstack([np.eye(4), [0, 0, 0, 0.1]])
    P = T @ np.diag(UNITS[:4] ** 2) @ T.T
    x = T @ UNITS[:4]
    got = fused(known(x, P, False), known(x, P, False)).known.vector
    np.testing.assert_allclose(got.sd, np.sqrt(np.diag(P) / 2), rtol=1e-4)
    np.testing.assert_allclose(got.values, x, rtol=1e-6)


def test_the_differences_are_chi_square():
    rng = np.random.default_rng(4)
    runs, total, dof, change = 300, 0.0, 0, []
    for _ in range(runs):
        truth, H1 = observed(rng, 8)
        H2 = rng.standard_normal((8, 5)) / UNITS
        some = [known(*least_squares(H, H @ truth + rng.standard_normal(8))[:2]) for H in (H1, H2)]
        got = fused(*some)
        total, dof = total + got.chi_square, dof + got.dof
        change.append(got.change)
    low, high = chi_square_limits(dof, tests=6)
    assert low < total < high
    low, high = chi_square_limits(runs, tests=6)
    squares = np.sum(np.square(change), axis=0)
    assert ((low < squares) & (squares < high)).all()


def test_an_uncertainty_that_is_too_small_is_noticed():
    rng = np.random.default_rng(5)
    truth, H1 = observed(rng, 20)
    H2 = rng.standard_normal((20, 5)) / UNITS
    some = []
    for H in (H1, H2):
        x, P, _ = least_squares(H, H @ truth + rng.standard_normal(20), prior=False)
        some.append(known(x + 3 * np.sqrt(np.diag(P)) * (len(some) - 0.5), P, False))
    got = fused(*some)
    assert got.chi_square > chi_square_limits(got.dof)[1]
    wide = [replace(s, vector=replace(s.vector, cov=16 * s.vector.cov)) for s in some]
    assert fused(*wide).chi_square == pytest.approx(got.chi_square / 16, rel=1e-6)


@pytest.mark.parametrize("loose", [0.0, 1e-12])
def test_combinations_that_the_model_fixes_are_no_degrees_of_freedom(loose):
    """Twelve coefficients of which four are sums of others: differences have eight."""
    rng = np.random.default_rng(11)
    names = LAYOUT.names[:12]
    turned = np.vstack([np.eye(8), rng.standard_normal((4, 8))])
    total, dofs = 0.0, set()
    for _ in range(60):
        truth, some = rng.standard_normal(8), []
        for _ in range(2):
            root = np.linalg.qr(rng.standard_normal((8, 8)))[0] * rng.uniform(0.3, 3, 8)
            own = truth + root @ rng.standard_normal(8)
            P = turned @ (root @ root.T) @ turned.T
            P += loose * np.diag(np.diag(P))  # rounding of a file
            some.append(Known(CoefficientVector(LAYOUT.subset(names), turned @ own, P)))
        step = fused(*some)
        total += step.chi_square
        dofs.add(step.dof)
    assert dofs == {8}
    low, high = chi_square_limits(60 * 8, 0.01)
    assert low < total < high
