"""States of people and of kernels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.models.rotation import exp
from foucault.models.rotation import matrix_of as attitude
from foucault.navigate.strapdown import State, matrix_of, quaternion_of, state_of, states_of
from make_strapdown import errors
from refusals import refuses

HALF = np.pi * np.eye(3)


def turns() -> list[np.ndarray]:
    """Rotations of every size: none, tiny, any, half turns about axes and between them."""
    rng = np.random.default_rng(0)
    some = [s * v / np.linalg.norm(v) for s in (1e-9, 1.0, 3.0, np.pi - 1e-8, np.pi)
            for v in rng.standard_normal((20, 3))]  # fmt: skip
    return [np.zeros(3), *HALF, *some]


def test_quaternions_and_matrices():
    for phi in turns():
        C = exp(phi)
        q = quaternion_of(C)
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(matrix_of(q), C, rtol=0, atol=1e-14)
        a = np.linalg.norm(phi)
        want = np.concatenate([[np.cos(a / 2)], np.sinc(a / 2 / np.pi) / 2 * phi])
        np.testing.assert_allclose(q * np.sign(q @ want), want, rtol=0, atol=1e-14)


@pytest.mark.parametrize("latitude", [0.0, 0.7, -1.4, np.pi / 2 - 1e-9, np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("longitude", [0.0, 3.1, -3.1, np.pi])
def test_packed_and_back(latitude, longitude):
    state = State(latitude, longitude, 321.0, np.array([9.0, -2.0, 0.3]), attitude(1.0, 0.2, -2.0))
    x = state.packed()
    assert x.shape == (12,)
    np.testing.assert_array_equal(x[4:7], state.velocity_n)
    again = state_of(x)
    assert np.all(errors(again, state) < [1e-14, 1e-13, 1e-8])
    if abs(latitude) < 1.5:
        assert again.latitude == pytest.approx(latitude, abs=1e-15)
        assert np.cos(again.longitude - longitude) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(again.C_nb, state.C_nb, rtol=0, atol=1e-14)


def test_the_level_frame_may_have_wandered():
    """The state is the same whatever the wander angle."""
    state = State(0.6, 2.0, 5.0, np.array([9.0, -2.0, 0.3]), attitude(1.0, 0.2, -2.0))
    x = state.packed()
    turn = exp(np.array([0.0, 0.0, 0.9]))  # C_l'l
    wandered = np.concatenate([
        quaternion_of(turn @ state.C_nb), turn @ state.velocity_n,
        quaternion_of(matrix_of(x[7:11]) @ turn.T), [5.0],
    ])  # fmt: skip
    found = states_of(np.stack([x, wandered]))
    np.testing.assert_allclose(found["C_nl"][1], turn.T, rtol=0, atol=1e-14)
    for name in ("latitude", "longitude", "height", "velocity_n", "C_nb"):
        np.testing.assert_allclose(found[name][1], found[name][0], rtol=0, atol=1e-14)


def test_angles():
    state = State.at_rest(attitude(4.0, -0.3, 0.1), 0.5, 0.6, 7.0)
    assert (state.latitude, state.longitude, state.height) == (0.5, 0.6, 7.0)
    np.testing.assert_array_equal(state.velocity_n, np.zeros(3))
    np.testing.assert_allclose((state.heading, state.pitch, state.roll), (4.0, -0.3, 0.1))


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("latitude of the start is 47 rad", {"latitude": 47.0}),
        ("latitude of the start is -1.6 rad", {"latitude": -1.6}),
        ("state of the start is not finite", {"latitude": np.nan}),
        ("state of the start is not finite", {"height": np.inf}),
        ("state of the start is not finite", {"velocity_n": np.array([0.0, np.nan, 0.0])}),
        ("no rotation matrix", {"C_nb": 1.001 * np.eye(3)}),
        ("no rotation matrix", {"C_nb": np.diag([1.0, 1.0, -1.0])}),
    ],
)
def test_impossible_starts(words, change):
    with refuses("strapdown.state", match=words):
        replace(State.at_rest(np.eye(3), 0.5), **change).packed()


@pytest.mark.parametrize(
    ("words", "change"),
    [
        (r"velocity_n is of shape \(2,\)", {"velocity_n": np.zeros(2)}),
        (r"C_nb is of shape \(4,\)", {"C_nb": np.array([1.0, 0.0, 0.0, 0.0])}),
        ("C_nb is of <U1", {"C_nb": ["a"]}),
    ],
)
def test_states_of_other_shapes(words, change):
    with refuses("argument.array", match=words):
        replace(State.at_rest(np.eye(3), 0.5), **change)


def test_lists_are_states_too():
    state = State.at_rest(np.eye(3).tolist(), 0.5)
    assert state.packed().shape == (12,) and state.heading == 0.0
