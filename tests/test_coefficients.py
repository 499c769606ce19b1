"""Coefficient vectors: names, slices, printing."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector, format_value
from foucault.errors import FoucaultError
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.units import KINDS, parse


def _vector() -> CoefficientVector:
    layout = LAYOUT.subset(["gyro.bias.x", "gyro.bias.y", "accel.scale.z"])
    values = [parse("10 deg/h", "angular rate"), parse("-0.5 deg/h", "angular rate"), 250e-6]
    sd = np.array([parse("0.02 deg/h", "angular rate"), parse("3 deg/h", "angular rate"), 12e-6])
    return CoefficientVector(layout, np.array(values), np.diag(sd**2))


def test_every_name_is_dotted_unique_and_of_a_known_kind() -> None:
    assert len(set(LAYOUT.names)) == len(LAYOUT)
    assert len(LAYOUT) == (3 + 3 + 6 + 3 + 15 + 3) + (3 + 3 + 6 + 9 + 3 + 3 + 18)
    assert len({c.symbol for c in LAYOUT.coefficients}) == len(LAYOUT)
    for c in LAYOUT.coefficients:
        assert c.kind in KINDS
        assert c.unit == KINDS[c.kind].si
        assert c.meaning


def test_symbols_read_output_axis_then_input_axis() -> None:
    symbol = {c.name: c.symbol for c in LAYOUT.coefficients}
    assert symbol["accel.misalignment.yx"] == "m_ayx"
    assert symbol["gyro.g_sensitivity.xy"] == "g_xy"
    assert symbol["accel.quadratic.x"] == "k_xxx"


def test_lower_gauge_has_21_names_and_no_upper_accelerometer_misalignment() -> None:
    assert len(LINEAR_LOWER) == 21
    assert "accel.misalignment.yx" in LINEAR_LOWER
    assert "accel.misalignment.xy" not in LINEAR_LOWER
    assert "gyro.misalignment.xy" in LINEAR_LOWER


def test_slices_carry_values_and_covariance() -> None:
    bias = _vector()["gyro.bias"]
    assert bias.names == ("gyro.bias.x", "gyro.bias.y")
    assert bias.cov is not None
    assert bias.cov.shape == (2, 2)
    assert bias.sd == pytest.approx(_vector().sd[:2])
    assert _vector()["accel.scale.z"].values == pytest.approx([250e-6])
    assert _vector().get("accel.bias.x", 7.0) == 7.0


def test_a_prefix_is_a_whole_word() -> None:
    with pytest.raises(FoucaultError, match=r"'gyro\.bia' is not part of this model"):
        _vector()["gyro.bia"]


def test_unknown_name_gets_a_suggestion() -> None:
    with pytest.raises(FoucaultError) as caught:
        _vector().value("gyro.bias.xx")
    assert caught.value.message == (
        "Coefficient 'gyro.bias.xx' is not part of this model. Did you mean 'gyro.bias.x'?"
    )
    assert caught.value.cure.endswith("gyro.bias.x, gyro.bias.y, accel.scale.z.")


def test_with_values_leaves_the_original_alone() -> None:
    before = _vector()
    after = before.with_values({"accel.scale.z": 1.0})
    assert after.value("accel.scale.z") == 1.0
    assert before.value("accel.scale.z") == 250e-6


def test_prints_as_a_table_with_one_unit_per_family() -> None:
    lines = str(_vector()).splitlines()
    assert lines[0].split() == ["coefficient", "symbol", "value", "sd", "unit"]
    assert lines[1].split() == ["gyro.bias.x", "b_gx", "10.000", "0.020", "deg/h"]
    assert lines[2].split() == ["gyro.bias.y", "b_gy", "-0.5", "3.0", "deg/h"]
    assert lines[3].split() == ["accel.scale.z", "s_az", "250", "12", "ppm"]


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (1.23456, 0.012, "1.235"),
        (1.23456, 12.0, "1"),
        (-0.5, 3.0, "-0.5"),
        (1.23456789, None, "1.23457"),
        (1.0, 0.0, "1"),
        (1.0, float("nan"), "1"),
    ],
)
def test_values_are_written_to_the_second_digit_of_their_sd(
    value: float, sd: float | None, text: str
) -> None:
    assert format_value(value, sd) == text


def test_rows_agree_in_si_and_display_units() -> None:
    row = _vector().rows()[0]
    assert row["unit"] == "rad/s"
    assert row["display_unit"] == "deg/h"
    assert row["display_value"] == pytest.approx(10.0, rel=1e-14)
    assert parse(f"{row['display_sd']!r} deg/h", "angular rate") == pytest.approx(
        float(_vector().sd[0])
    )


def test_without_covariance_sd_is_unknown() -> None:
    zeros = CoefficientVector.zeros(LAYOUT)
    assert np.isnan(zeros.sd).all()
    assert zeros.rows()[0]["display_sd"] is None
    assert zeros.free.all()
    assert np.isinf(zeros.prior_sd).all()
