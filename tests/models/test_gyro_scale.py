"""Scale factors that are no constants: what the terms mean, their inverse, other axes."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.models.deflection import readout, sensed
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.rotation import exp

RNG = np.random.default_rng(4)
W = RNG.uniform(-6.0, 6.0, (60, 3))
A, C = np.array([0.2, -0.3, 0.01]), np.array([2e-3, -1e-3, 0.0])


def test_asymmetry_is_half_the_difference_of_the_scale_factors_over_their_mean() -> None:
    values = {"gyro.scale.y": 0.01, "gyro.asymmetry.y": 300e-6}
    model = ImuModel.from_coefficients(CoefficientVector.zeros(LAYOUT).with_values(values))
    w = np.array([[0.0, 2.0, 0.0], [0.0, -2.0, 0.0]])
    gyro = model.measure(np.zeros((2, 3)), w)[1][:, 1]
    plus, minus = gyro[0] / 2.0, gyro[1] / -2.0
    assert (plus - minus) / (plus + minus) == pytest.approx(300e-6, rel=1e-12)
    assert (plus + minus) / 2 == pytest.approx(1.01, abs=1e-15)


def test_cubic_term_grows_with_the_third_power_and_keeps_the_sense() -> None:
    r = np.array([[1.0, 2.0, -2.0]])
    np.testing.assert_allclose(
        readout(r, np.zeros(3), np.full(3, 1e-3)) - r, [[1e-3, 8e-3, -8e-3]], atol=1e-17
    )


def test_inverse_is_exact_also_for_large_terms() -> None:
    y = readout(W, A, C)
    np.testing.assert_allclose(sensed(y, A, C), W, rtol=0, atol=2e-14)
    assert sensed(np.zeros((1, 3)), A, C) == pytest.approx(0.0)


def test_inverse_up_to_near_where_the_readout_turns_back() -> None:
    c = np.full(3, -1e-2)
    turn = np.sqrt(1 / 0.03)
    r = np.linspace(-0.99, 0.99, 31)[:, None] * turn * np.ones(3)
    # Near the turn the slope is 0.02: rounding grows by 50.
    np.testing.assert_allclose(sensed(readout(r, 0 * c, c), 0 * c, c), r, atol=1e-13)


def test_any_rotation_of_the_axes_leaves_the_readings_as_they_are() -> None:
    model = ImuModel(np.eye(3), gyro_matrix=np.eye(3) + 0.02 * RNG.normal(size=(3, 3)),
                     gyro_asymmetry=A, gyro_cubic=C)  # fmt: skip
    C_cb = exp(np.array([0.4, -1.1, 0.7]))  # nothing small
    turned = model.rotated(C_cb)
    want = model.measure(W, W)[1]
    np.testing.assert_allclose(turned.measure(W @ C_cb.T, W @ C_cb.T)[1], want, atol=5e-14)
    back = turned.compensate(None, want)[1]
    np.testing.assert_allclose(back, W @ C_cb.T, atol=5e-14)


def test_straight_says_whether_there_are_such_terms() -> None:
    assert ImuModel().straight
    assert not ImuModel(gyro_asymmetry=np.array([0.0, 1e-6, 0.0])).straight
    assert not ImuModel(gyro_cubic=np.array([0.0, 1e-6, 0.0])).straight
