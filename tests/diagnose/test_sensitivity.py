"""Sensitivity curves: picking, thinning, and when a coefficient is seen."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import Coefficient, Layout
from foucault.diagnose.observability import Sensitivity

NAMES = ("accel.bias.x", "accel.scale.x", "gyro.drift.x")
LAYOUT = Layout(tuple(Coefficient(n, n, "angle", n) for n in NAMES))
OUTPUTS = ("accel.x", "accel.y")


def curves(k: int = 100) -> Sensitivity:
    """x reads bias + scale * ramp; y sees the same bias half as well; nothing sees the drift."""
    time = np.arange(1, k + 1) * 0.5
    slopes = np.zeros((k, 2, 3))
    slopes[:, 0, 0], slopes[:, 1, 0], slopes[:, 0, 1] = 1.0, 0.5, time
    return Sensitivity(time, LAYOUT, OUTPUTS, slopes)


def test_thinning_keeps_the_ends() -> None:
    c = curves(1001)
    thin = c.thinned(11)
    np.testing.assert_array_equal(thin.time, c.time[::100])
    np.testing.assert_array_equal(thin.slopes, c.slopes[::100])
    assert c.thinned(2000) is c


def test_share_of_the_information_grows_as_its_analytic_sum() -> None:
    k, share = 100, curves().share(0.1)
    n = np.arange(1, k + 1)
    np.testing.assert_allclose(share[:, 0], n / k)
    squares = n * (n + 1) * (2 * n + 1)
    np.testing.assert_allclose(share[:, 1], squares / squares[-1])
    np.testing.assert_array_equal(share[:, 2], 0.0)


def test_when_a_coefficient_is_seen() -> None:
    c = curves()
    half = c.when(0.5)
    assert half[0] == c.time[49]
    # A ramp: half of the cube of the time.
    assert half[1] == pytest.approx(c.time[-1] * 0.5 ** (1 / 3), abs=0.5)
    assert np.isnan(half[2])
    assert c.when(1.0)[:2].tolist() == [c.time[-1]] * 2


def test_noise_weighs_the_outputs() -> None:
    time = np.array([1.0, 2.0])
    slopes = np.zeros((2, 2, 1))
    slopes[0, 0], slopes[1, 1] = 1.0, 1.0
    c = Sensitivity(time, Layout(LAYOUT.coefficients[:1]), OUTPUTS, slopes)
    np.testing.assert_allclose(c.share(np.array([1.0, 2.0]))[:, 0], [0.8, 1.0])
    np.testing.assert_allclose(c.information(np.array([1.0, 2.0])).matrix, [[1.25]])


@pytest.mark.parametrize("k", [1, 100])
def test_information_is_that_of_the_whitened_rows(k: int) -> None:
    c, noise = curves(k), np.array([0.1, 0.3])
    rows = (c.slopes / noise[:, None]).reshape(-1, 3)
    info = c.information(noise)
    np.testing.assert_allclose(info.matrix, rows.T @ rows, rtol=1e-9, atol=1e-9)
    assert info.rank == 2
