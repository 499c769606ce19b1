"""A g-sensitivity of the size that a reversed Earth rate would make is doubted."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import reversed_earth_check
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.tables import AXES

PER_G = np.radians(1.0) / 3600 / 9.80665  # deg/h per g
NAMES = [f"gyro.g_sensitivity.{i}{j}" for i in AXES for j in AXES]
# 15.041 deg/h by the sine of 30 deg, there and back.
REVERSED = 15.041


def check(diagonal, *, sd=1.0, latitude=30.0, names=NAMES):
    """Check g-sensitivities [deg/h per g] that are known to `sd`, at a latitude [deg]."""
    values = np.diag(diagonal).astype(float).ravel()[: len(names)] * PER_G
    cov = np.eye(len(names)) * (sd * PER_G) ** 2
    where = Site(9.80665, None if latitude is None else np.radians(latitude))
    return reversed_earth_check(CoefficientVector(LAYOUT.subset(names), values, cov), where)


@pytest.mark.parametrize("latitude", [30.0, -30.0])
def test_twice_the_vertical_rate_downwards_is_a_reversed_sign(latitude):
    made = -np.sign(latitude) * REVERSED
    found = check([made + 1.0, made, made - 1.0], latitude=latitude)
    assert not found.passed and found.value == pytest.approx(0.0, abs=0.01)
    assert f"{made:+.1f} +- 0.6 deg/h per g, mean of all axes" in found.sentence
    assert "Set g_sensitivity = false to see." in found.sentence


@pytest.mark.parametrize("diagonal", [[0, 0, 0], [REVERSED] * 3, [-40, 0, 0], [-100] * 3])
def test_any_other_is_one_of_the_gyros(diagonal):
    found = check(diagonal)
    assert found.passed and found.sentence.endswith("would make it -15.0 about each.")


def test_where_nothing_can_be_said_nothing_is():
    assert check([-REVERSED] * 3, latitude=None) is None
    assert check([-REVERSED] * 3, latitude=0.1) is None
    assert check([-REVERSED] * 3, sd=10.0) is None
    assert check([-REVERSED] * 3, sd=0.0) is None
    assert check([-REVERSED] * 3, names=NAMES[:5]) is None
