"""The linear solution of the norm equations is exact, for errors of any size."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.estimate.norm_observation import design, solve
from foucault.plans.hand_rotated import spread_directions

G = 9.81
L = np.array([[1.3, 0, 0], [0.2, 0.8, 0], [-0.25, 0.15, 1.1]])
BIAS = np.array([1.5, -2.0, 0.7])


def _readings(up_b, L=L, b=BIAS):
    return G * up_b @ L.T + b


@pytest.mark.parametrize("n", [10, 24, 100])
def test_large_unequal_errors_come_back_exactly(n):
    got_L, got_b = solve(_readings(spread_directions(n)), G)
    # Rounding times the condition of the equations.
    rows = design(_readings(spread_directions(n)), G)
    limit = 2.2e-16 * np.linalg.cond(rows) * 4
    np.testing.assert_allclose(got_L, L, atol=limit)
    np.testing.assert_allclose(got_b, BIAS, atol=limit * G)


def test_even_rests_of_a_good_instrument_are_exact_to_rounding():
    small = np.eye(3) + 1e-3 * np.tril(L)
    got_L, got_b = solve(_readings(spread_directions(24), small, 0.01 * BIAS), G)
    np.testing.assert_allclose(got_L, small, atol=1e-14)
    np.testing.assert_allclose(got_b, 0.01 * BIAS, atol=1e-13)


def test_result_is_lower_triangular_with_positive_diagonal():
    got_L, _ = solve(_readings(spread_directions(20)), G)
    assert np.array_equal(got_L, np.tril(got_L))
    assert (np.diag(got_L) > 0).all()


def test_unit_of_the_readings_does_not_matter():
    one, two = (
        solve(_readings(spread_directions(20)), G),
        solve(1e6 * _readings(spread_directions(20)), 1e6 * G),
    )
    np.testing.assert_allclose(one[0], two[0], atol=1e-13)
    np.testing.assert_allclose(1e6 * one[1], two[1], rtol=1e-11)


def _circle(n, height=0.0):
    a = 2 * np.pi * np.arange(n) / n
    r = np.sqrt(1 - height**2)
    return np.stack([r * np.cos(a), r * np.sin(a), np.full(n, height)], 1)


@pytest.mark.parametrize(
    "up_b",
    [
        _circle(20),
        _circle(20, 0.5),
        np.concatenate([_circle(10, 0.4), _circle(10, -0.4)]),
        spread_directions(8),
        np.tile(spread_directions(6), (4, 1)),
    ],
    ids=["great circle", "small circle", "two circles", "eight rests", "six, four times"],
)
def test_directions_that_do_not_determine_an_ellipsoid(up_b):
    assert solve(_readings(up_b), G) is None


def test_what_is_no_ellipsoid_is_refused():
    rng = np.random.default_rng(12)
    x = rng.normal(size=(30, 3))
    hyperboloid = np.stack([x[:, 0], x[:, 1], np.sqrt(1 + x[:, 0] ** 2 + x[:, 1] ** 2)], 1)
    assert solve(G * hyperboloid + 0.1, G) is None
