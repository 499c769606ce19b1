"""Noise figures of the typical classes, in the units people know them in."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import GRADES, grade


def test_grades_run_from_bad_to_good():
    assert GRADES == ("mems", "tactical", "navigation")
    for group in ("accel.bias", "gyro.bias", "accel.scale", "gyro.misalignment"):
        spreads = [grade(name).spread[group] for name in GRADES]
        assert spreads == sorted(spreads, reverse=True)
    for triad in ("accel", "gyro"):
        white = [getattr(grade(name).noise, triad).white for name in GRADES]
        assert white == sorted(white, reverse=True)


def test_figures_are_in_si():
    tactical = grade("tactical")
    assert tactical.noise.gyro.white == pytest.approx(np.radians(0.05) / 60)
    assert tactical.noise.accel.white == pytest.approx(30e-6 * 9.80665)
    assert tactical.spread["gyro.bias"] == pytest.approx(np.radians(10) / 3600)
    assert tactical.spread["accel.scale"] == pytest.approx(1e-3)
    assert tactical.spread["accel.misalignment"] == pytest.approx(np.radians(3 / 60))


def test_every_linear_coefficient_has_a_spread():
    for name in GRADES:
        assert {n.rpartition(".")[0] for n in LINEAR_LOWER} == set(grade(name).spread)


def test_an_unknown_grade_says_which_there_are():
    with pytest.raises(FoucaultError, match="one of mems, tactical, navigation"):
        grade("consumer")
