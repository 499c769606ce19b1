"""Exports of coefficients that change with temperature give what `Result.apply` gives."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.export import calibrate_log, write
from foucault.export.request import AXES
from foucault.logs import read
from foucault.logs import write as write_log
from foucault.logs.description import LogDescription
from foucault.models.imu import ImuModel
from foucault.result import Result
from foucault.run_folder import load_result, save
from foucault.tables import Log
from make_exported import load, run_c
from make_terms import HIGH, LOW, SIZES, T0, Readings, Same, a_model, with_terms
from refusals import refuses

KNOTS = {"polynomial": (), "piecewise": (245.0, 290.0, 310.0, 345.0)}
EACH = [f for f in SIZES if f not in ("accel.lever", "accel.delay")]
LINEAR = [f for f in SIZES if f.endswith(("bias", "scale", "misalignment"))]


def a_result(knots: tuple[float, ...] = (), families: list[str] = EACH) -> Result:
    model = a_model(*families, knots=knots, seed=6)
    return replace(with_terms(*families), temperature=model, coefficients=model.at(T0),
                   procedure="temperature", validity={"temperature": [LOW, HIGH]})  # fmt: skip


@pytest.fixture(params=list(KNOTS))
def changing(request: Any) -> Result:
    return a_result(KNOTS[request.param])


@pytest.fixture
def warmth() -> np.ndarray:
    """Temperatures of the 50 readings, both ends among them [K]."""
    return np.r_[LOW, HIGH, 290.0, np.random.default_rng(2).uniform(LOW, HIGH, 47)]


def applied(result: Result, readings: Readings, T: np.ndarray) -> Log:
    accel, gyro = readings
    return result.apply(Log(np.arange(len(T)) / 100.0, gyro, accel, "rate", T))


# -- the document -----------------------------------------------------------------------------


def test_saved_and_loaded_to_the_bit(changing: Result, tmp_path: Path) -> None:
    save(changing, tmp_path / "run")
    back = load_result(tmp_path / "run")
    for name in ("weights", "cov", "knots", "scatter"):
        got, want = getattr(back.temperature, name), getattr(changing.temperature, name)
        np.testing.assert_array_equal(got, want)
    assert (back.temperature.low, back.temperature.reference) == (LOW, T0)
    assert back.temperature.layout.names == changing.temperature.layout.names


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("covariance", [[1.0]], "covariance must have"),
        ("low", 360.0, "must rise"),
        ("knots", [250.0, 300.0], "knots are those of piecewise"),
        ("functions", [], "same number of weights"),
    ],
)
def test_a_document_that_was_changed_is_refused(
    key: str, value: Any, words: str, tmp_path: Path
) -> None:
    file = save(a_result(families=["gyro.bias"]), tmp_path / "run")
    doc = json.loads(file.read_text())
    doc["temperature"][key] = value
    file.write_text(json.dumps(doc))
    with pytest.raises(FoucaultError, match=words):
        load_result(tmp_path / "run")


def test_functions_of_other_coefficients_are_refused(tmp_path: Path) -> None:
    file = save(a_result(families=["gyro.bias"]), tmp_path / "run")
    doc = json.loads(file.read_text())
    doc["temperature"]["functions"].reverse()
    file.write_text(json.dumps(doc))
    with pytest.raises(FoucaultError, match="differ from the names"):
        load_result(tmp_path / "run")


# -- C ----------------------------------------------------------------------------------------

MAIN = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double t, a[3], g[3], f[3], w[3];
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", &t, a, a + 1, a + 2, g, g + 1, g + 2) == 7) {
        int outside = foucault_compensate_at(t, a, g, f, w);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g %d\n", f[0], f[1], f[2], w[0], w[1], w[2],
               outside);
    }
    return 0;
}
"""


def test_c(
    changing: Result, readings: Readings, warmth: np.ndarray, tmp_path: Path, same: Same
) -> None:
    header = write(changing, "c", tmp_path / "calibration.h").read_text()
    assert "Coefficients change with temperature" in header
    got, want = (
        run_c(tmp_path, MAIN, np.column_stack([warmth, *readings])),
        applied(changing, readings, warmth),
    )
    same(got[:, :3], want.accel)
    same(got[:, 3:6], want.gyro)
    assert not got[:, 6].any()


def test_c_of_a_plain_instrument(
    readings: Readings, warmth: np.ndarray, tmp_path: Path, same: Same
) -> None:
    result = a_result(families=LINEAR)
    header = write(result, "c", tmp_path / "calibration.h").read_text()
    assert "foucault_solve_force" not in header
    got, want = (
        run_c(tmp_path, MAIN, np.column_stack([warmth, *readings])),
        applied(result, readings, warmth),
    )
    same(got[:, :3], want.accel)
    same(got[:, 3:6], want.gyro)


def test_c_outside_is_told_and_held(readings: Readings, tmp_path: Path, same: Same) -> None:
    result = a_result()
    write(result, "c", tmp_path / "calibration.h")
    T = np.r_[LOW - 5.0, HIGH + 5.0, np.nan, np.full(47, 300.0)]
    got = run_c(tmp_path, MAIN, np.column_stack([T, *readings]))
    held = np.nan_to_num(np.clip(T, LOW, HIGH), nan=LOW)
    np.testing.assert_array_equal(got[:, 6], [1.0, 1.0, 1.0] + [0.0] * 47)
    same(got[:, :3], applied(result, readings, held).accel)


NEXT = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double t, a[3], g[3], f[3], w[3];
    foucault_state state = {0};
    foucault_coefficients c;
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", &t, a, a + 1, a + 2, g, g + 1, g + 2) == 7) {
        foucault_at(t, &c);
        foucault_compensate_next(&c, &state, 0.01, a, g, f, w);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\n", f[0], f[1], f[2], w[0], w[1], w[2]);
    }
    return 0;
}
"""


def test_lever_arms_in_c_and_python(
    readings: Readings, warmth: np.ndarray, tmp_path: Path, same: Same
) -> None:
    result = a_result(families=list(SIZES))
    write(result, "c", tmp_path / "calibration.h")
    got = run_c(tmp_path, NEXT, np.column_stack([warmth, *readings]))
    module = load(write(result, "python", tmp_path / "calibration.py"))
    before, rows = None, []
    for T, a, g in zip(warmth, *readings, strict=True):
        f, w, before = module.compensate_next(module.coefficients_at(T), before, 0.01, a, g)
        rows.append([*f, *w])
    same(got, rows)
    # The definition: what changed since the sample before, with the coefficients of now.
    dot = [np.diff(r, axis=0, prepend=r[:1]) / 0.01 for r in readings]
    size = result.size_effect
    for k in (0, 1, 20):
        model = ImuModel.from_coefficients(a_result(families=EACH).temperature.at(warmth[k]))
        alone = result.temperature.at(float(warmth[k]))
        names = [n for n in alone.names if not n.startswith(("accel.lever", "accel.delay"))]
        model = ImuModel.from_coefficients(alone.chosen(names))
        f, w = size.compensate(model, readings[0][k], readings[1][k], dot[1][k], dot[0][k])
        np.testing.assert_allclose(rows[k], [*f, *w], rtol=0, atol=1e-10)


# -- Python, JSON -----------------------------------------------------------------------------


@pytest.mark.parametrize("axes", list(AXES))
def test_python(
    changing: Result, axes: str, readings: Readings, warmth: np.ndarray, tmp_path: Path, same: Same
) -> None:
    text = write(changing, "python", tmp_path / "calibration.py", axes=axes).read_text()
    assert "import" not in text.replace("no imports", "")
    module, C_sb = load(tmp_path / "calibration.py"), AXES[axes]
    turned = [r @ C_sb.T for r in readings]
    got = [module.compensate_at(T, a, g) for T, a, g in zip(warmth, *turned, strict=True)]
    want = applied(changing, readings, warmth)
    same([g[0] for g in got], want.accel @ C_sb.T)
    same([g[1] for g in got], want.gyro @ C_sb.T)
    for T in (LOW - 0.1, HIGH + 0.1, float("nan")):
        with pytest.raises(ValueError, match="known from 250"):
            module.coefficients_at(T)


def test_json(changing: Result, readings: Readings, tmp_path: Path, same: Same) -> None:
    doc = json.loads(write(changing, "json", tmp_path / "calibration.json").read_text())
    assert set(doc["forward"]) == set(doc["inverse"]) == {"equation"}
    said, T = doc["temperature"], 295.5
    if said["knots"]:
        phi = [np.interp(T, said["knots"], row) for row in np.eye(len(said["knots"]))]
    else:
        phi = [(T - said["reference"]) ** k for k in range(3)]
    blocks = {n: np.tensordot(phi, np.array(v), 1) for n, v in said["terms"].items()}
    want = applied(changing, readings, np.full(50, T))
    got = ImuModel(**blocks).compensate(*readings)
    same(got[0], want.accel)
    same(got[1], want.gyro)


def test_what_is_dropped_is_dropped_at_all_temperatures(tmp_path: Path) -> None:
    doc = json.loads(write(a_result(), "json", tmp_path / "c.json", drop=["gyro.bias"]).read_text())
    assert not np.any(doc["temperature"]["terms"]["gyro_bias"])
    assert np.any(doc["temperature"]["terms"]["accel_bias"])
    assert any("gyro.bias.x" in line for line in doc["about"])


@pytest.mark.parametrize("receiver", ["csv", "kalibr", "imucal", "basalt", "ros2"])
def test_receivers_without_temperature_refuse(receiver: str, tmp_path: Path) -> None:
    with refuses("temperature.receiver") as caught:
        write(a_result(families=["accel.bias"]), receiver, tmp_path / "file")
    assert "--at" in caught.value.cure


def test_one_temperature_is_an_ordinary_result(
    changing: Result, readings: Readings, tmp_path: Path, same: Same
) -> None:
    T = 288.0
    one = changing.at(T)
    assert one.temperature is None
    module = load(write(one, "python", tmp_path / "calibration.py"))
    got = [module.compensate(a, g) for a, g in zip(*readings, strict=True)]
    want = applied(changing, readings, np.full(50, T))
    same([g[0] for g in got], want.accel)
    same([g[1] for g in got], want.gyro)
    with refuses("temperature.option"):
        one.at(T)


# -- logs -------------------------------------------------------------------------------------


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    from foucault.logs import follow, formats

    for module in (follow, formats):
        monkeypatch.setattr(module, "BLOCK_ROWS", 300)


def a_log(T: np.ndarray | None = None, n: int = 1000) -> Log:
    rng = np.random.default_rng(3)
    T = np.linspace(LOW, HIGH, n) if T is None else T
    return Log(np.arange(n) / 100.0, rng.normal(0, 0.5, (n, 3)), rng.normal(0, 6, (n, 3)),
               "rate", T)  # fmt: skip


def apply(result: Result, log: Log, folder: Path, **more: Any) -> tuple[Log, Any]:
    write_log(log, folder / "log.parquet")
    done = calibrate_log(result, LogDescription.model_validate({"file": "log.parquet"}), folder,
                         folder / "out.parquet", **more)  # fmt: skip
    out = read(LogDescription.model_validate({"file": "out.parquet"}), folder)
    return out, done


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("families", [EACH, list(SIZES)], ids=["each", "apart"])
def test_blocks_are_compensated_as_the_whole(families: list[str], tmp_path: Path) -> None:
    result, log = a_result(families=families), a_log()
    out, done = apply(result, log, tmp_path)
    want = result.apply(log)
    np.testing.assert_allclose(out.accel, want.accel, rtol=0, atol=1e-13)
    np.testing.assert_allclose(out.gyro, want.gyro, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(out.temperature, log.temperature)
    assert "temperature" not in " ".join(f.code for f in done.findings)


@pytest.mark.usefixtures("small_blocks")
def test_outside_names_the_row_of_the_log_and_writes_nothing(tmp_path: Path) -> None:
    T = np.full(1000, 300.0) + np.linspace(0, 0.1, 1000)
    T[[777, 900]] = HIGH + 2.0
    with refuses("temperature.outside") as caught:
        apply(a_result(families=LINEAR), a_log(T), tmp_path)
    assert "row 777 " in caught.value.message
    assert "7.770 s" in caught.value.message
    assert not (tmp_path / "out.parquet").exists()


@pytest.mark.usefixtures("small_blocks")
def test_held_at_the_end_of_the_range(tmp_path: Path) -> None:
    result = a_result(families=list(SIZES))
    T = np.linspace(300.0, HIGH + 9.0, 1000)
    out, done = apply(result, a_log(T), tmp_path, hold=True)
    want = result.apply(a_log(np.minimum(T, HIGH)))
    np.testing.assert_allclose(out.accel, want.accel, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(out.temperature, T)  # what was measured is kept
    (told,) = (f for f in done.findings if f.code == "temperature.held_outside")
    first = int(np.flatnonzero(T > HIGH)[0])
    assert f"{(T > HIGH).sum()} samples" in told.message
    assert f"row {first}" in told.message


def test_no_temperature_is_refused_held_or_not(tmp_path: Path) -> None:
    for hold in (False, True):
        with refuses("temperature.unlogged"):
            apply(a_result(families=LINEAR), replace(a_log(), temperature=None), tmp_path,
                  hold=hold)  # fmt: skip


def test_hold_needs_functions(tmp_path: Path) -> None:
    with refuses("temperature.option"):
        apply(with_terms("gyro.bias"), a_log(), tmp_path, hold=True)


def test_a_frozen_sensor_is_told(tmp_path: Path) -> None:
    _, done = apply(a_result(families=LINEAR), a_log(np.full(1000, 300.0)), tmp_path)
    (told,) = (f for f in done.findings if f.code == "temperature.constant")
    assert "26.85 degC in all 1000 samples" in told.message
