"""What changes at once, against generalised least squares of all that was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

from foucault.infer.linear_filter import LinearSystem, kalman, likeliest, shocks

EPOCHS, STEP = 30, 17


@pytest.fixture(scope="module")
def system():
    """Return position, velocity and a bias of its readings; position steps at an epoch."""
    rng = np.random.default_rng(4)
    Phi = np.tile([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0]], (EPOCHS, 1, 1))
    half = np.tile([0.0, 2e-3, 0.0], (EPOCHS, 1))
    H = np.tile([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]], (EPOCHS, 1, 1))
    R = np.full((EPOCHS, 2), 0.04)
    z = rng.normal(0.0, 0.2, (EPOCHS, 2))
    z[STEP:, 0] += 2.0
    return LinearSystem(Phi, half, H, z, R, np.zeros(3), np.diag([1.0, 1.0, 0.25]))


def _least_squares(s, at):
    """Return of every epoch the squared size [1], the size and the sd of a step of states `at`."""
    F = np.eye(3)
    F[:2] = s.Phi[0]
    causes = np.zeros((3, 3 + 6 * EPOCHS))  # what the state hangs on: start and noise
    causes[:, :3] = np.eye(3)
    rows, out = [], []
    for k in range(EPOCHS):
        causes[:, 3 + 6 * k : 6 + 6 * k] = np.diag(np.sqrt(s.half[k]))
        causes = F @ causes
        causes[:, 6 + 6 * k : 9 + 6 * k] = np.diag(np.sqrt(s.half[k]))
        rows.append(s.H[k] @ causes)
    A = np.concatenate(rows)
    known = linalg.block_diag(s.P0, np.eye(6 * EPOCHS))
    V = A @ known @ A.T + np.diag(s.R.ravel())
    for k in range(EPOCHS):
        B = np.zeros((EPOCHS, 2, len(at)))
        for j in range(k, EPOCHS):
            B[j] = (s.H[j] @ np.linalg.matrix_power(F, j - k))[:, at]
        B = B.reshape(-1, len(at))
        information, pull = B.T @ np.linalg.solve(V, B), B.T @ np.linalg.solve(V, s.z.ravel())
        size = np.linalg.solve(information, pull)
        out.append((pull @ size, size, np.sqrt(np.diag(np.linalg.inv(information)))))
    return out


@pytest.mark.parametrize("at", [[0], [1], [0, 1]])
def test_the_epoch_that_explains_most_is_that_of_least_squares(system, at) -> None:
    found = shocks(system, kalman(system, keep=True), {"way": np.array(at)})["way"]
    every = _least_squares(system, at)
    best = int(np.argmax([square for square, *_ in every]))
    assert found.epoch == best and (at == [1] or best == STEP)
    square, size, sd = every[best]
    np.testing.assert_allclose(found.square, square, rtol=1e-9)
    np.testing.assert_allclose(found.size, size, rtol=1e-8)
    np.testing.assert_allclose(found.sd, sd, rtol=1e-8)
    assert found.square > found.limit


def test_noise_is_no_step(system) -> None:
    z = system.z.copy()
    z[STEP:, 0] -= 2.0
    quiet = replace(system, z=z)
    ways = {"position": np.array([0]), "velocity": np.array([1])}
    for found in shocks(quiet, kalman(quiet, keep=True), ways).values():
        assert found.square < found.limit


def test_what_a_change_explains_is_that_of_the_directions_that_are_seen():
    rng = np.random.default_rng(3)
    A = rng.standard_normal((40, 4, 6))
    own, pull = A @ np.swapaxes(A, 1, 2), rng.standard_normal((40, 4))
    own[1, 3] = own[1, :, 3] = 0.0  # says nothing of one
    own[2] = np.outer(pull[2], pull[2])  # and of all but one
    own[3] = np.kron(np.eye(2), [[1.0, 2.0], [2.0, 1.0]])  # rounding left what is no information
    for k in range(4, 40):
        shock = likeliest(own[k : k + 1], pull[k : k + 1])
        assert shock.square == pytest.approx(pull[k] @ np.linalg.solve(own[k], pull[k]))
        assert shock.sd == pytest.approx(np.sqrt(np.diag(np.linalg.inv(own[k]))))
    some, left = likeliest(own[1:2], pull[1:2]), own[1, :3, :3]
    assert some.square == pytest.approx(pull[1, :3] @ np.linalg.solve(left, pull[1, :3]))
    one = likeliest(own[2:3], pull[2:3])
    assert one.square == pytest.approx(1.0)
    none = likeliest(own[3:4], pull[3:4])
    assert np.isfinite(none.sd).all() and none.square >= 0.0
