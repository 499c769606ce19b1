"""The section of a rate table: there where the table is, with the numbers it was given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.procedures.rate_table import Settings, from_readings
from foucault.report.calibration import how_to_apply
from foucault.report.evidence import rate_steps
from make_rates import LATITUDE, make_readings, make_steps

MODEL = ImuModel(gyro_matrix=np.diag([1.01, 1, 1]), gyro_asymmetry=np.array([2e-4, 0, 0]))


@pytest.fixture
def result():
    readings = make_readings(make_steps(MODEL, sd=1e-6))
    return from_readings(readings, Settings(), told=True, site=Site(9.81, LATITUDE))


def test_three_panels_with_one_trace_per_axis(result):
    figure, merits, _, fit = rate_steps(result).blocks
    assert [t["name"] for t in figure.data] == ["x", "y", "z"] * 3
    assert [t["yaxis"] for t in figure.data] == ["y3"] * 3 + ["y2"] * 3 + ["y"] * 3
    first = figure.data[0]
    assert figure.layout["yaxis3"]["title"]["text"] == "before [%]"
    assert max(first["y"]) == pytest.approx(1.0202, abs=2e-3)  # 1 % and 200 ppm
    assert first["customdata"][4] == pytest.approx(100.0, abs=0.01)
    assert first["marker"]["symbol"][:7] == ["triangle-up"] * 6 + ["triangle-down"]
    assert "error_y" in figure.data[6]
    assert figure.layout["yaxis2"]["title"]["text"] == "off the line [ppm]"
    assert [row[0] for row in merits.rows] == ["x", "y", "z"]
    assert merits.rows[0][3] == "400"
    assert fit.items[0][1].startswith("Residuals of all steps: chi-square")


def test_steps_that_were_weighted_down_are_hollow(result):
    weight = result.tables["rate_steps"]["weight"].copy()
    weight[2] = 0.2
    table = dict(result.tables["rate_steps"]) | {"weight": weight}
    figure = rate_steps(replace(result, tables={"rate_steps": table})).blocks[0]
    assert figure.data[0]["marker"]["symbol"][2] == "triangle-up-open"


def test_how_to_apply_shows_the_terms_and_their_inverse(result):
    blocks = how_to_apply(result).blocks
    text = "\n".join(getattr(b, "text", "") + "\n".join(getattr(b, "lines", ())) for b in blocks)
    assert "gyro = r + A_g |r| + C_g r^3 + b_g + G f" in text
    assert "r + A_g |r| + C_g r^3 = gyro - b_g - G f" in text
    assert "a_g = np.array([0.0002" in text or "a_g = np.array([0.00019999" in text
    assert "c_g = np.array" in text
    assert "model.compensate." in text
    assert "np.linalg.inv(W)" not in text
