"""Integration in inertial space, compiled and as plain Python, against its obvious twin."""

import numpy as np
import pytest

import reference
from foucault.kernels.inertial import from_start
from foucault.navigate.increments import bend_weights


@pytest.mark.parametrize("form", [from_start, from_start.py_func], ids=["compiled", "python"])
def test_as_its_twin(form):
    rng = np.random.default_rng(1)
    n = 40
    dt = rng.uniform(0.005, 0.02, n)
    dtheta, dvel = 0.05 * rng.normal(size=(n, 3)), 0.1 * rng.normal(size=(n, 3))
    joined = rng.random(n) > 0.2
    for made, wanted in zip(
        form(dtheta, dvel, *bend_weights(dt, joined)),
        reference.from_start(dtheta, dvel, dt, joined),
        strict=True,
    ):
        np.testing.assert_allclose(made, wanted, rtol=1e-12, atol=1e-13)


def test_nothing_spreads_backwards():
    dtheta = np.zeros((10, 3))
    dtheta[5, 0] = np.nan
    bends = bend_weights(np.ones(10), np.ones(10, bool))
    C_0b, _ = from_start(dtheta, np.ones((10, 3)), *bends)
    assert np.isfinite(C_0b[:4]).all() and np.isnan(C_0b[5:, 1:]).any()


def test_coning_drift_is_taken_out():
    """Coning 0.1 rad wide at 2 Hz: 100 Hz leave far less than the drift of plain increments."""
    n, dt, a, w = 2000, 0.01, 0.1, 4 * np.pi
    t = dt * np.arange(n + 1)
    # The rate of b = (w (cos a - 1) about z) under a cone of half angle a.
    phase = w * t
    integral = np.stack([np.sin(phase), -np.cos(phase), 0 * phase], axis=1) * np.sin(a)
    integral[:, 2] = (np.cos(a) - 1) * w * t
    dtheta = np.diff(integral, axis=0)
    ones = np.ones(n, bool)
    drift = []
    for joined in (ones, ~ones):
        C_0b, _ = from_start(dtheta, np.zeros((n, 3)), *bend_weights(np.full(n, dt), joined))
        # After whole turns of the cone the body is where it was.
        turn = C_0b[50 * np.arange(1, n // 50) - 1]
        drift.append(np.abs(turn[-1] - turn[0]).max())
    assert drift[0] < drift[1] / 50
