"""The sections of a fit over temperature: what they draw is what the tables hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import report
from foucault.procedures.temperature import Settings, calibrate
from foucault.report.calibration import how_to_apply
from foucault.report.page import Figure, Table
from foucault.report.uncertainty import functions, left_out
from foucault.result import Result
from make_temperature import ZERO, sessions

DEGREES = (-15, 0, 20, 40, 65)


@pytest.fixture(scope="module")
def result() -> Result:
    return calibrate(sessions(DEGREES, scatter={"gyro.bias": 20.0}),
                     Settings(scatter={"accel.bias": 0.0}))  # fmt: skip


def test_functions_are_drawn_with_their_band_and_sessions(result: Result) -> None:
    section = functions(result)
    figure, table = section.blocks[:2]
    assert isinstance(figure, Figure)
    assert "Valid from −15.4\N{NO-BREAK SPACE}°C to 65.3" in section.lead
    choices = figure.layout["meta"]["choices"]
    assert len(choices) == 6
    assert choices[0] == "accel.bias [mg]"
    mine = [
        t for t in figure.data if t["meta"] == choices[0] and t["legendgroup"] == "accel.bias.y"
    ]
    band, line, dots = mine
    assert band["fill"] == "toself"
    model, i = result.temperature, result.coefficients.layout.index("accel.bias.y")
    assert dots["x"] == pytest.approx(DEGREES)
    start = result.coefficients.values[i]
    want = (model.values(np.array(line["x"]) + ZERO)[:, i] - start) / 9.80665e-3
    np.testing.assert_allclose(line["y"], want, atol=2e-5 * np.abs(want).max())
    top = np.array(band["y"])[: len(line["x"])] - line["y"]
    sd = model.sd(np.array(line["x"]) + ZERO)[:, i]
    np.testing.assert_allclose(top, 2 * sd / 9.80665e-3, atol=1e-4 * np.abs(want).max())
    assert isinstance(table, Table)
    rows = {row[0]: row for row in table.rows}
    assert rows["accel.bias"][3] == "none (declared)"
    assert "°/h" in rows["gyro.bias"][3]
    assert "better than a constant (F" in rows["accel.scale"][4]


def test_sessions_and_what_was_left_out(result: Result) -> None:
    section = left_out(result)
    one, other, table = section.blocks
    assert one.share == other.share == 50
    assert sum(len(t["y"]) for t in one.data) == 5 * 21
    z = np.concatenate([t["y"] for t in other.data])
    np.testing.assert_allclose(np.sort(z), np.sort(result.tables["temperature_points"]["left_out"]),
                               rtol=1e-5)  # fmt: skip
    assert [row[0] for row in table.rows] == [f"run{k}" for k in range(5)]
    assert table.rows[0][1] == "−15.0"


def test_two_temperatures_have_no_left_out_figure() -> None:
    few = calibrate(sessions((0, 40)))
    assert len(left_out(few).blocks) == 2
    rows = {row[0]: row[3] for row in functions(few).blocks[1].rows}
    assert rows["gyro.bias"] == "cannot be told"


def test_how_to_apply_gives_no_numbers_of_one_temperature(result: Result) -> None:
    text = "\n".join(getattr(b, "text", "") for b in how_to_apply(result).blocks)
    assert "result.at(293.15)" in text
    assert "--at" in text
    assert "np.array" not in text


def test_the_page_and_knots(result: Result) -> None:
    text = report.html(result)
    assert "Over temperature" in text
    bent = calibrate(sessions(DEGREES), Settings(knots=(ZERO - 15, ZERO + 20, ZERO + 65)))
    assert "knots at −15.0, 20.0, 65.0 °C" in functions(bent).blocks[2].text
    # Without the sessions' names nothing breaks.
    assert report.html(replace(result, diagnostics={}))
