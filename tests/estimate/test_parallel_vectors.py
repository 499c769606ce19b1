"""Frames tied together by parallel vectors: exact, never a reflection, with the lever arm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.estimate.norm_observation import unify, wahba
from foucault.plans.directions import directions

G = 9.81


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def spins(o, h, C_bd, r):
    """Return mean specific force in b and mean rate in d, one spin at a time."""
    f, w = [], []
    for axis, rate in zip(o, h, strict=True):
        turn = rate * axis
        f.append(G * axis + np.cross(turn, np.cross(turn, r)))
        w.append(C_bd.T @ turn)
    return np.array(f), np.array(w)


HALF_TURNS = [np.diag(d).astype(float) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
MOUNTINGS = [
    np.eye(3), *HALF_TURNS, np.roll(np.eye(3), 1, axis=0),
    Rotation.from_rotvec([3.0, 0.9, -0.1]).as_matrix(),
]  # fmt: skip


@pytest.mark.parametrize("C", MOUNTINGS)
def test_any_rotation_comes_back(C):
    u = unit(np.random.default_rng(1).normal(size=(12, 3)))
    np.testing.assert_allclose(wahba(u @ C.T, u), C, atol=2e-15)


def test_noisy_vectors_give_the_least_squares_rotation():
    rng = np.random.default_rng(2)
    u = unit(rng.normal(size=(10, 3)))
    C = Rotation.from_rotvec([0.4, -2.0, 1.0]).as_matrix()
    v = u @ C.T + 0.1 * rng.normal(size=u.shape)
    other = Rotation.align_vectors(v, u)[0].as_matrix()
    np.testing.assert_allclose(wahba(v, u), other, atol=1e-14)


def test_mirrored_vectors_still_give_a_rotation():
    u = unit(np.random.default_rng(3).normal(size=(8, 3)))
    for v in (-u, u * [1, 1, -1]):
        C = wahba(v, u)
        assert np.linalg.det(C) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("C_bd", MOUNTINGS)
@pytest.mark.parametrize("senses", ["one sense", "both senses", "clockwise"])
def test_spins_of_either_sense_tie_the_frames_without_a_reflection(C_bd, senses):
    o = directions("icosahedron 12")
    sign = {"one sense": 1, "clockwise": -1, "both senses": np.where(np.arange(12) % 3, 1, -1)}
    h = 0.2 * np.broadcast_to(sign[senses], 12) + 5e-5
    r = np.array([0.1, -0.2, 0.05])
    C, arm = unify(*spins(o, h, C_bd, r), h, G)
    assert np.linalg.det(C) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(C, C_bd, atol=1e-14)
    np.testing.assert_allclose(arm, r, atol=1e-13 / 0.04)


def test_without_the_sign_of_the_spin_the_frames_would_be_wrong():
    o, h = directions("icosahedron 12"), np.full(12, -0.2)
    f, w = spins(o, h, np.eye(3), np.zeros(3))
    assert np.abs(unify(f, w, np.abs(h), G)[0] - np.eye(3)).max() > 0.5
    np.testing.assert_allclose(unify(f, w, h, G)[0], np.eye(3), atol=1e-14)


@pytest.mark.parametrize("n", [4, 7, 12])
def test_lever_arm_is_exact_without_antipodes(n):
    rng = np.random.default_rng(n)
    o = unit(rng.normal(size=(n, 3)))
    h = rng.uniform(0.5, 2.0, n) * rng.choice([-1, 1], n)
    C_bd, r = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix(), np.array([0.3, 0.1, -0.2])
    C, arm = unify(*spins(o, h, C_bd, r), h, G)
    np.testing.assert_allclose(arm, r, atol=1e-12)
    np.testing.assert_allclose(C, C_bd, atol=1e-12)


def test_a_lever_arm_left_out_cancels_for_antipodes_only():
    C_bd, r = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix(), np.array([0.3, 0.1, -0.2])
    h = np.full(12, 0.8)
    C, arm = unify(*spins(directions("icosahedron 12"), h, C_bd, r), h, G, lever_arm=False)
    assert np.array_equal(arm, np.zeros(3))
    np.testing.assert_allclose(C, C_bd, atol=1e-12)
    half = unit(directions("icosahedron 12")[:4] + np.array([0.2, 0.1, 0.3]))
    C, _ = unify(*spins(half, h[:4], C_bd, r), h[:4], G, lever_arm=False)
    assert np.abs(C - C_bd).max() > 1e-4
