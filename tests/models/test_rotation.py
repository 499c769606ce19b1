"""Rotation vectors and matrices, against scipy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.models.rotation import (
    aligning,
    cross_matrix,
    exp,
    log,
    right_jacobian,
    right_jacobian_inverse,
)

RNG = np.random.default_rng(6)
AXES = np.concatenate([np.eye(3), -np.eye(3), RNG.normal(size=(20, 3))])
AXES /= np.linalg.norm(AXES, axis=1)[:, None]
ANGLES = [
    0.0,
    1e-300,
    1e-16,
    1e-9,
    1e-5,
    1e-3,
    0.5,
    np.pi / 2,
    2.0,
    3.0,
    np.pi - 1e-3,
    np.pi - 1e-7,
]


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_and_log_are_inverse_at_any_angle(angle):
    phi = angle * AXES
    C = exp(phi)
    np.testing.assert_allclose(C, Rotation.from_rotvec(phi).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(
        C @ np.swapaxes(C, 1, 2), np.broadcast_to(np.eye(3), C.shape), atol=2e-15
    )
    np.testing.assert_allclose(log(C), phi, rtol=1e-14, atol=4e-15)


def test_log_at_half_a_turn_keeps_axis_up_to_its_sign():
    phi = log(exp(np.pi * AXES))
    np.testing.assert_allclose(np.linalg.norm(phi, axis=1), np.pi, atol=4e-15)
    np.testing.assert_allclose(np.abs(np.sum(phi * AXES, axis=1)), np.pi, atol=1e-14)


def test_log_agrees_with_scipy_beyond_half_a_turn():
    phi = 5.0 * AXES
    np.testing.assert_allclose(log(exp(phi)), Rotation.from_rotvec(phi).as_rotvec(), atol=1e-14)


def test_cross_matrix():
    u, v = RNG.normal(size=(2, 7, 3))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", cross_matrix(v), u), np.cross(v, u), atol=1e-15
    )


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.99e-4, 1.01e-4, 0.01, 1.0, 2.5, 3.1])
def test_right_jacobian_inverse_is_the_derivative(angle):
    phi, step = angle * AXES, 1e-6
    J = right_jacobian_inverse(phi)
    # Central difference: rounding eps/step, and step^2 over the distance to half a turn cubed.
    limit = 4e-16 * 4 / step + step**2 / (np.pi - angle) ** 3
    for i in range(3):
        d = step * np.eye(3)[i]
        numeric = (log(exp(phi) @ exp(d)) - log(exp(phi) @ exp(-d))) / (2 * step)
        np.testing.assert_allclose(J[:, :, i], numeric, atol=limit)
        left = (log(exp(d) @ exp(phi)) - log(exp(-d) @ exp(phi))) / (2 * step)
        np.testing.assert_allclose(np.swapaxes(J, 1, 2)[:, :, i], left, atol=limit)


def test_right_jacobian_inverse_does_not_jump_where_the_series_ends():
    below, above = (right_jacobian_inverse(a * AXES) for a in (1e-4 - 1e-12, 1e-4 + 1e-12))
    # The closed form loses eps/angle^2 of a factor that is multiplied by angle^2.
    np.testing.assert_allclose(below, above, atol=2e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.99e-2, 1.01e-2, 0.3, 1.0, 3.1])
def test_right_jacobian_undoes_its_inverse(angle):
    both = right_jacobian(angle * AXES) @ right_jacobian_inverse(angle * AXES)
    np.testing.assert_allclose(both, np.broadcast_to(np.eye(3), both.shape), atol=1e-14)


@pytest.mark.parametrize(
    "between", [0.0, 1e-14, 1e-8, 1.0, 3.0, np.pi - 1e-8, np.pi - 1e-14, np.pi]
)
def test_aligning_takes_u_to_v(between):
    for u, other in zip(AXES, np.roll(AXES, 7, axis=0), strict=True):
        side = np.cross(u, other)
        if np.linalg.norm(side) < 1e-3:
            continue
        v = exp(between * side / np.linalg.norm(side)) @ u
        C = aligning(u, v)
        # Below 1e-12 between (anti)parallel vectors the axis is not to be had, nor needed.
        np.testing.assert_allclose(C @ u, v, atol=2e-12)
        np.testing.assert_allclose(C @ C.T, np.eye(3), atol=2e-15)
        assert np.linalg.det(C) == pytest.approx(1.0)
        assert np.linalg.norm(log(C)) == pytest.approx(between, abs=2e-8)
