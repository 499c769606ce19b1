"""Heading, pitch and roll against the definition, and their rates against differences."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.rotation import angles_of, body_rate, cross_matrix, log, matrix_of

RIGHT, FORWARD, UP = np.eye(3)
EAST, NORTH = RIGHT, FORWARD
HALF = np.pi / 2


@pytest.mark.parametrize(
    ("angles", "right", "forward", "up"),
    [
        ((0, 0, 0), EAST, NORTH, UP),
        ((HALF, 0, 0), -NORTH, EAST, UP),  # heading clockwise
        ((0, HALF, 0), EAST, UP, -NORTH),  # nose up
        ((0, 0, HALF), -UP, NORTH, EAST),  # right side down
        ((-HALF, 0, HALF), -UP, -EAST, NORTH),
    ],
)
def test_signs(angles, right, forward, up) -> None:
    np.testing.assert_allclose(
        matrix_of(*angles), np.column_stack([right, forward, up]), atol=1e-15
    )


def drawn(n: int = 500) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.column_stack([
        rng.uniform(0, 2 * np.pi, n), rng.uniform(-HALF, HALF, n), rng.uniform(-np.pi, np.pi, n)
    ])  # fmt: skip


def test_round_trip_and_rotation() -> None:
    angles = drawn()
    C = matrix_of(*angles.T)
    np.testing.assert_allclose(C @ C.swapaxes(1, 2), np.tile(np.eye(3), (len(C), 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(C), 1.0)
    np.testing.assert_allclose(angles_of(C), angles, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(angles_of(C[7]), angles_of(C)[7])


@pytest.mark.parametrize("pitch", [HALF, -HALF])
def test_nose_straight_up_or_down_keeps_the_attitude(pitch: float) -> None:
    C = matrix_of(np.array([0.3, 4.0, 6.2]), pitch, np.array([0.0, -1.0, 3.0]))
    found = angles_of(C)
    np.testing.assert_array_equal(found[:, 2], 0.0)
    np.testing.assert_allclose(matrix_of(*found.T), C, atol=1e-15)


def test_heading_is_below_a_full_turn() -> None:
    assert angles_of(matrix_of(-1e-17, 0.0, 0.0))[0] == 0.0
    assert angles_of(matrix_of(-1e-3, 0.0, 0.0))[0] == pytest.approx(2 * np.pi - 1e-3)


def test_attitude_error_about_up_is_the_heading_error() -> None:
    angles, phi = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1e-6])
    estimate = (np.eye(3) - cross_matrix(phi)) @ matrix_of(*angles)
    assert angles_of(estimate)[0] - angles[0] == pytest.approx(1e-6, rel=1e-6)


def test_body_rate_is_how_the_matrix_turns() -> None:
    angles, dt = drawn(), 1e-4
    rates = np.random.default_rng(4).normal(size=angles.shape)
    before, after = (matrix_of(*(angles + sign * dt * rates).T) for sign in (-1, 1))
    turned = log(before.swapaxes(1, 2) @ after) / (2 * dt)
    np.testing.assert_allclose(body_rate(angles, rates), turned, atol=1e-6)
