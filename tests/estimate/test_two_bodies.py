"""Offsets of windows: what lost samples make of them, and what errors of instruments do."""

from __future__ import annotations

import numpy as np

from foucault.estimate import two_bodies
from foucault.estimate.two_bodies import JUMPS

STEP = 0.005
"""Of the readings, and so the sample that jumps are counted in [s]."""


def _pair(seed: int, lost: int = 0) -> two_bodies.Clocks:
    """Return the clocks of a good gyro and of a raw one, which lost some samples half-way."""
    rng = np.random.default_rng([seed, 71])
    time = np.arange(0.0, 30.0, STEP)
    waves = rng.uniform(0.12, 0.75, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
    w = 2.5 * np.sin(2 * np.pi * time[:, None, None] * waves[0] + waves[1]).sum(axis=2) / 3**0.5
    raw = w @ (np.eye(3) + rng.normal(0, 5e-3, (3, 3))).T + rng.normal(0, 0.01, 3)
    raw += rng.normal(0, 0.01, w.shape)
    raw = np.delete(raw, slice(3000, 3000 + lost), axis=0)
    return two_bodies.clocks((time, w), (time[: len(raw)], raw), 15.0)


def test_errors_of_a_gyro_are_no_lost_samples() -> None:
    found = [_pair(seed).jumps / STEP for seed in range(12)]
    assert max(found) < JUMPS


def test_lost_samples_are() -> None:
    found = [_pair(seed, lost=4).jumps / STEP for seed in range(12)]
    assert min(found) > JUMPS


def test_what_explains_most_by_changing_is_that_of_least_squares() -> None:
    """Of every block from which on a parameter may be another, all parameters found again."""
    rng, known = np.random.default_rng(3), np.array([2.0, 3.0, 4.0, 5.0])
    J = rng.standard_normal((30, 7, 4)) * [1.0, 0.5, 2.0, 1.0]
    x = np.array([0.3, -0.2, 0.1, 0.5])
    y = J @ x + rng.standard_normal((30, 7))
    y[18:] += J[18:, :, [1, 2]] @ [1.5, -1.0]

    def least(A: np.ndarray) -> tuple[float, np.ndarray]:
        A = np.vstack([A, np.eye(4, A.shape[1]) / known[:, None]])
        b = np.append(y.ravel(), np.zeros(4))
        found = np.linalg.lstsq(A, b)[0]
        return float(np.sum((b - A @ found) ** 2)), found

    whole = J.reshape(-1, 4)
    cost, found = least(whole)
    left = y - J @ found
    told = two_bodies.changes(
        np.arange(30.0), np.einsum("bri,br->bi", J, left), np.einsum("bri,brj->bij", J, J), known,
        {"one": [0], "two": [1, 2]},
    )["two"]  # fmt: skip
    every = []
    for k in range(1, 30):
        later = (J[:, :, [1, 2]] * (np.arange(30) >= k)[:, None, None]).reshape(-1, 2)
        every.append(least(np.hstack([whole, later])))
    best = int(np.argmin([c for c, _ in every]))
    assert told.time == best + 1 == 18
    again = every[best][1]
    np.testing.assert_allclose(told.shock.square, cost - every[best][0], rtol=1e-9)
    np.testing.assert_allclose(told.moved[0], again[:4] - found, atol=1e-12)
    np.testing.assert_allclose(told.shock.size, again[4:], rtol=1e-9)
