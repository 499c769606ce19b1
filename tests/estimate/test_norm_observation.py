"""The linear solution of the norm equations is exact, for errors of any size."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.estimate.norm_observation import design, published_recovery, solve
from foucault.plans.directions import directions, spread_directions

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


# -- the icosahedron of the paper, in units of local g ------------------------------------------

UNEQUAL = np.array([[1.002, 0, 0], [3e-4, 1.008, 0], [-5e-4, 6e-4, 1.006]])
PAPER_BIAS = np.array([8e-4, -1e-3, -3.2e-3])


def _icosahedron(L=UNEQUAL, b=PAPER_BIAS, norm=1.0):
    return np.reshape(norm, (-1, 1)) * directions("icosahedron 12") @ L.T + b


def test_twelve_positions_and_unequal_misalignments_are_exact():
    got_L, got_b = solve(_icosahedron(), 1.0)
    np.testing.assert_allclose(got_L, UNEQUAL, atol=1e-14)
    np.testing.assert_allclose(got_b, PAPER_BIAS, atol=1e-14)


def test_published_recovery_has_its_published_bias():
    got_L, got_b = published_recovery(_icosahedron(), 1.0)
    # b' A b neglected: half of it in every scale factor.
    A = np.linalg.inv(UNEQUAL @ UNEQUAL.T)
    neglected = PAPER_BIAS @ A @ PAPER_BIAS / 2
    assert neglected == pytest.approx(5.9e-6, rel=0.02)
    np.testing.assert_allclose(np.diag(got_L - UNEQUAL), -neglected, rtol=0.15)
    # Misalignments and biases to first order: theirs are products of two of these errors.
    off = np.abs(np.tril(got_L - UNEQUAL, -1))
    assert off.max() < 2 * 6e-4 * 8e-3
    assert np.abs(got_b - PAPER_BIAS).max() < 2 * 3.2e-3 * 1e-3
    assert np.abs(got_b - PAPER_BIAS).max() > 1e-8  # not exact, and the exact recovery is


def test_published_recovery_does_not_swap_misalignments():
    for row, column in ((1, 0), (2, 0), (2, 1)):
        L = np.eye(3)
        L[row, column] = 1e-3
        got, _ = published_recovery(_icosahedron(L, np.zeros(3)), 1.0)
        assert got[row, column] == pytest.approx(1e-3, rel=1e-6)
        got[row, column] = 0.0
        assert np.abs(np.tril(got, -1)).max() < 1e-14


@pytest.mark.parametrize("earth", [5e-5, 5e-3])
def test_spins_in_both_senses_have_unequal_norms(earth):
    sense = np.tile([1.0, -1.0], 6)
    h = 0.17 * sense + earth  # the Earth adds to one sense and takes from the other
    big = np.array([[1.3, 0, 0], [0.2, 0.8, 0], [-0.25, 0.15, 1.1]])
    for L, b in ((UNEQUAL, 0.01 * PAPER_BIAS), (big, np.array([0.02, -0.05, 0.01]))):
        readings = _icosahedron(L, b, h)
        got_L, got_b = solve(readings, h)
        limit = 2.2e-16 * np.linalg.cond(design(readings, 0.17)) * 8
        np.testing.assert_allclose(got_L, L, atol=max(limit, 1e-14))
        np.testing.assert_allclose(got_b, b, atol=max(limit, 1e-14))


def test_very_unequal_norms_are_iterated_to_the_end():
    rng = np.random.default_rng(4)
    u = np.concatenate([directions("icosahedron 12")] * 2)
    h = rng.uniform(0.3, 3.0, 24)
    b = np.array([0.2, -0.1, 0.15])
    L = np.array([[1.1, 0, 0], [0.1, 0.9, 0], [-0.1, 0.05, 1.2]])
    got_L, got_b = solve(h[:, None] * u @ L.T + b, h)
    np.testing.assert_allclose(got_L, L, atol=1e-13)
    np.testing.assert_allclose(got_b, b, atol=1e-13)


def test_the_sign_of_a_norm_does_not_count():
    readings = _icosahedron()
    for norm in (-1.0, np.full(12, -1.0), np.full(12, 1.0)):
        got_L, got_b = solve(readings, norm)
        np.testing.assert_allclose(got_L, UNEQUAL, atol=1e-14)
        np.testing.assert_allclose(got_b, PAPER_BIAS, atol=1e-14)


def test_fewer_positions_than_unknowns():
    assert solve(_icosahedron()[:8], 1.0) is None
