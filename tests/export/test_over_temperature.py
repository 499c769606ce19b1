"""Biases over temperature in PX4 and ArduPilot: their formula gives what the calibration says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.export import write
from foucault.export.request import AXES
from foucault.export.table import found_in, receivers
from foucault.models.temperature import TemperatureModel
from foucault.result import Result
from make_terms import with_terms

LOW, HIGH, T0 = 258.15, 333.15, 298.15
TAKES = receivers()["px4"].takes
C = AXES["forward-right-down"]


def changing(terms: int = 4, knots: tuple[float, ...] = ()) -> Result:
    """Return biases that change by about themselves over the range, and scale factors by less."""
    result = with_terms(*TAKES)
    vector, rng = result.coefficients, np.random.default_rng(3)
    if knots:
        weights = vector.values[:, None] * rng.uniform(0.5, 1.5, (len(vector), len(knots)))
    else:
        weights = vector.values[:, None] * 50.0 ** -np.arange(terms) * rng.uniform(0.5, 1, terms)
    for i, name in enumerate(vector.names):
        if ".scale" in name:
            weights[i, 1:] = weights[i, 0] if knots else 0.0
    cov = np.eye(weights.size) * 1e-12
    model = TemperatureModel(vector.layout, weights, cov, T0, LOW, HIGH, np.array(knots))
    return replace(result, temperature=model, coefficients=model.at(T0), procedure="temperature",
                   validity={"temperature": [LOW, HIGH]})  # fmt: skip


def px4(x: dict[str, Any], T: float) -> tuple[Any, Any]:
    """Return what PX4 takes off: thermal offset plus OFF."""
    out = []
    for letter, slot in (("A", "ACC0"), ("G", "GYRO0")):
        d = np.clip(T, x[f"TC_{letter}0_TMIN"], x[f"TC_{letter}0_TMAX"]) - x[f"TC_{letter}0_TREF"]
        thermal = [sum(x[f"TC_{letter}0_X{n}_{i}"] * d**n for n in (1, 2, 3)) for i in range(3)]
        out.append(np.array(thermal) + [x[f"CAL_{slot}_{axis}OFF"] for axis in "XYZ"])
    return out[0], out[1]


def ardupilot(x: dict[str, Any], T: float) -> tuple[Any, Any]:
    """Return what ArduPilot takes off: poly(T) - poly(CALTEMP), then the offset."""
    out = []
    for kind, offset, at in (("ACC", "INS_ACCOFFS", "INS_ACC1_CALTEMP"),
                             ("GYR", "INS_GYROFFS", "INS_GYR1_CALTEMP")):  # fmt: skip

        def poly(T: float, kind: str = kind) -> Any:
            d = np.clip(T, x["INS_TCAL1_TMIN"], x["INS_TCAL1_TMAX"]) - 35.0
            return np.array([
                1e-6 * sum(x[f"INS_TCAL1_{kind}{n}_{axis}"] * d**n for n in (1, 2, 3))
                for axis in "XYZ"
            ])  # fmt: skip

        out.append(poly(T) - poly(x[at]) + [x[f"{offset}_{axis}"] for axis in "XYZ"])
    return out[0], out[1]


RULES = {"px4": px4, "ardupilot": ardupilot}


@pytest.mark.parametrize("name", list(RULES))
@pytest.mark.parametrize("terms", [2, 3, 4])
def test_a_cubic_is_given_back_exactly(name: str, terms: int, tmp_path: Path) -> None:
    result = changing(terms)
    text = write(result, name, tmp_path / "p").read_text()
    x = found_in(receivers()[name], text)
    for T in np.linspace(LOW, HIGH, 9):
        model = result.at(float(T)).model
        for got, want in zip(
            RULES[name](x, T - 273.15), (model.accel_bias, model.gyro_bias), strict=True
        ):
            np.testing.assert_allclose(got, C @ want, atol=1e-12 * np.abs(want).max())
    ends = [RULES[name](x, T) for T in (HIGH - 273.15, HIGH - 253.15)]
    np.testing.assert_array_equal(*ends)  # held at the end of the range
    assert "-15.00 to 60.00 degC" in text
    assert "Scale factors" not in text


@pytest.mark.parametrize("name", list(RULES))
def test_what_is_no_cubic_says_by_how_much(name: str, tmp_path: Path) -> None:
    result = changing(knots=(LOW, 290.0, 310.0, HIGH))
    text = write(result, name, tmp_path / "p").read_text()
    x = found_in(receivers()[name], text)
    T = np.linspace(LOW, HIGH, 201)
    off = [RULES[name](x, t - 273.15)[0] - C @ result.at(float(t)).model.accel_bias for t in T]
    said = re.search(r"Biases of the accel .*?calibration by (\S+) m/s\^2", " ".join(text.split()))
    assert said is not None
    assert float(said[1]) == pytest.approx(np.abs(off).max(), rel=0.06)
    assert float(said[1]) > 1e-3


@pytest.mark.parametrize("name", list(RULES))
def test_what_is_said_is_what_single_precision_leaves(name: str, tmp_path: Path) -> None:
    """Of a cubic nothing is lost but by rounding, which the file says."""
    result = changing()
    text = write(result, name, tmp_path / "p").read_text()
    x = {key: np.float32(v) for key, v in found_in(receivers()[name], text).items()}
    T = np.linspace(LOW, HIGH, 201)
    off = [RULES[name](x, np.float32(t - 273.15))[0] - C @ result.at(float(t)).model.accel_bias
           for t in T]  # fmt: skip
    said = re.search(r"Biases of the accel .*?by (\S+) m/s\^2 at most in single precision",
                     " ".join(text.split()))  # fmt: skip
    assert said is not None
    assert 1e-9 < np.abs(off).max() < 4 * float(said[1]) < 1e-5


def test_scale_factors_that_change_are_told(tmp_path: Path) -> None:
    result = changing()
    assert result.temperature is not None
    weights = result.temperature.weights.copy()
    at = result.coefficients.names.index("accel.scale.x")
    weights[at, 1] = 1e-5
    warm = replace(result, temperature=replace(result.temperature, weights=weights))
    text = " ".join(write(warm, "px4", tmp_path / "p").read_text().split())
    assert f"leaves {1e-5 * (T0 - LOW) * 9.80665:.2g} m/s^2 at 1 g" in text


def test_others_still_know_no_temperature(tmp_path: Path) -> None:
    with pytest.raises(FoucaultError, match="kalibr has no place for coefficients that change"):
        write(changing(), "kalibr", tmp_path / "k")
    text = write(changing().at(T0), "px4", tmp_path / "p").read_text()
    assert "TC_" not in text.replace("TC_A0_ID", "")
