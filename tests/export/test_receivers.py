"""Each receiver, doing what it does with the exported numbers, gets what `Result.apply` gets."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import make_exported
from foucault.export import RECEIVERS, write
from foucault.export.request import AXES, FAMILIES, family, in_axes
from foucault.export.table import receivers
from foucault.logs.description import LogDescription
from foucault.result import Result
from make_exported import MAIN, load
from make_terms import LOUD, Readings, Same, with_terms

COUNTS = LogDescription.model_validate(
    {
        "file": "log.csv",
        "time": {"column": "t", "unit": "s"},
        "gyro": {
            "columns": ["wx", "-wy", "wz"], "unit": "count",
            "scale": ["4778 count/(rad/s)", "4800 count/(rad/s)", "4760 count/(rad/s)"],
            "zero": [32768, 32770, 32700],
        },
        "accel": {
            "columns": ["fy", "fx", "-fz"], "unit": "count", "reads": "gravity",
            "scale": "415 count/(m/s^2)", "zero": 32768,
        },
    }
)  # fmt: skip


# -- C ----------------------------------------------------------------------------------------


def run_c(
    folder: Path, accel: np.ndarray, gyro: np.ndarray, function: str,
    main: str = MAIN, dt: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    columns = [accel, gyro] if dt is None else [dt[:, None], accel, gyro]
    return make_exported.run_c(folder, main, np.hstack(columns), f"-DFUNCTION={function}")


@pytest.mark.parametrize("which", ["full", "linear"])
def test_c(which: str, request: Any, readings: Readings, tmp_path: Path, same: Same) -> None:
    result: Result = request.getfixturevalue(which)
    header = write(result, "c", tmp_path / "calibration.h").read_text()
    assert ("foucault_solve_force" in header) == (which == "full")
    assert ("foucault_deflection" in header) == (which == "full")
    assert ("foucault_sensed_rate" in header) == (which == "full")
    assert "m/s^2" in header
    assert "malloc" not in header
    assert "foucault_compensate_counts" not in header  # nothing is known of counts
    f_b, w_b = result.model.compensate(*readings)
    got = run_c(tmp_path, *readings, "foucault_compensate")
    same(got[:, :3], f_b)
    same(got[:, 3:], w_b)


@pytest.mark.parametrize("axes", list(AXES))
def test_c_from_counts(
    axes: str, full: Result, readings: Readings, tmp_path: Path, same: Same
) -> None:
    write(full, "c", tmp_path / "calibration.h", log=COUNTS, axes=axes)
    C_sb = AXES[axes]
    counts, true = [], []
    for name, values in zip(("accel", "gyro"), readings, strict=True):
        block = getattr(COUNTS, name)
        zero, factor = block.conversion()
        flip = [-1.0 if c.startswith("-") else 1.0 for c in block.columns]
        raw = values / (factor * flip) + zero  # in the order of the columns
        order = np.argmax(np.abs(C_sb), axis=1)
        counts.append(raw[:, order])
    true = [v @ C_sb.T for v in full.model.compensate(*readings)]
    got = run_c(tmp_path, *counts, "foucault_compensate_counts")
    # A count near 5e4 carries rounding of 1e-16 of it, which is a few 1e-12 of the readings.
    np.testing.assert_allclose(got[:, :3], true[0], atol=1e-11 * np.abs(true[0]).max())
    np.testing.assert_allclose(got[:, 3:], true[1], atol=1e-11 * np.abs(true[1]).max())
    text = (tmp_path / "calibration.h").read_text()
    names = [COUNTS.accel.columns[i].removeprefix("-") for i in order]
    assert f"in this order: {', '.join(names)}" in text


@pytest.mark.parametrize("receiver", ["c", "python"])
@pytest.mark.parametrize(
    "families",
    [("accel.asymmetry",), ("gyro.deflection",), ("accel.asymmetry", "gyro.deflection"),
     ("accel.quadratic", "gyro.asymmetry"), ("accel.asymmetry", "gyro.cubic", "gyro.deflection")],
)  # fmt: skip
def test_each_part_of_the_code_works_without_the_others(
    receiver: str, families: tuple[str, ...], readings: Readings, tmp_path: Path, same: Same
) -> None:
    result = with_terms("accel.bias", "gyro.scale", *families)
    name = {"c": "calibration.h", "python": "calibration.py"}[receiver]
    text = write(result, receiver, tmp_path / name).read_text()
    assert ("deflection[3]" in text or "DEFLECTION" in text) == ("gyro.deflection" in families)
    if receiver == "c":
        got = run_c(tmp_path, *readings, "foucault_compensate")
    else:
        module = load(tmp_path / name)
        pairs = zip(*(r.tolist() for r in readings), strict=True)
        got = np.array([np.concatenate(module.compensate(a, g)) for a, g in pairs])
    f_b, w_b = result.model.compensate(*readings)
    same(got[:, :3], f_b)
    same(got[:, 3:], w_b)


def test_c_survives_what_a_user_may_call_his_instrument(tmp_path: Path) -> None:
    result = with_terms("accel.bias", instrument={"name": "IMU */ #error\n\\", "serial": "1"})
    write(result, "c", tmp_path / "calibration.h")
    got = run_c(tmp_path, np.zeros((1, 3)), np.zeros((1, 3)), "foucault_compensate")
    np.testing.assert_allclose(got[0, :3], -result.model.accel_bias, rtol=1e-15)


# -- from sample to sample ----------------------------------------------------------------------

NEXT_MAIN = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double dt, a[3], g[3], f[3], w[3];
    foucault_state state = {0};
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", &dt, a, a + 1, a + 2, g, g + 1, g + 2) == 7) {
        FUNCTION(&state, dt, a, g, f, w);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\n", f[0], f[1], f[2], w[0], w[1], w[2]);
    }
    return 0;
}
"""


def step_by_step(result: Result, dt: np.ndarray, accel: np.ndarray, gyro: np.ndarray) -> Any:
    """Compensate with differences from the sample before, none where dt is zero."""
    out = []
    for x in (gyro, accel):
        change = np.diff(x, axis=0, prepend=x[:1])
        out.append(np.where(dt[:, None] > 0, change / np.where(dt > 0, dt, 1.0)[:, None], 0.0))
    return result.size_effect.compensate(result.model, accel, gyro, *out)


@pytest.fixture
def steps() -> np.ndarray:
    """Intervals between 50 samples, with a beginning and a gap [s]."""
    dt = np.random.default_rng(4).uniform(0.004, 0.006, 50)
    dt[[0, 20]] = 0.0
    return dt


@pytest.mark.parametrize("receiver", ["c", "python"])
@pytest.mark.parametrize("families", [(), ("accel.lever",), ("accel.delay", "gyro.bias")])
def test_lever_arms_and_delay_are_taken_away(
    receiver: str, families: tuple[str, ...], apart: Result, readings: Readings,
    steps: np.ndarray, tmp_path: Path, same: Same,
) -> None:  # fmt: skip
    result = with_terms(*families) if families else apart
    name = {"c": "calibration.h", "python": "calibration.py"}[receiver]
    text = write(result, receiver, tmp_path / name).read_text()
    assert "half an interval old" in text
    if receiver == "c":
        got = run_c(tmp_path, *readings, "foucault_compensate_next", NEXT_MAIN, steps)
    else:
        module, before, got = load(tmp_path / name), None, []
        for dt, a, g in zip(steps.tolist(), *(r.tolist() for r in readings), strict=True):
            f, w, before = module.compensate_next(before, dt, a, g)
            got.append([*f, *w])
        got = np.array(got)
    f_b, w_b = step_by_step(result, steps, *readings)
    same(got[:, :3], f_b)
    same(got[:, 3:], w_b)
    plain = result.model.compensate(*readings)[0]
    assert np.abs(plain - f_b).max() > 0.1
    assert "compensate_next" not in write(with_terms("accel.bias"), receiver,
                                          tmp_path / "other").read_text()  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("axes", list(AXES))
def test_counts_from_sample_to_sample(
    axes: str, apart: Result, readings: Readings, steps: np.ndarray, tmp_path: Path
) -> None:
    """In other axes the accelerometers change places, and their places are told in those axes."""
    write(apart, "c", tmp_path / "calibration.h", log=COUNTS, axes=axes)
    module = load(write(apart, "python", tmp_path / "calibration.py", log=COUNTS, axes=axes))
    order = np.argmax(np.abs(AXES[axes]), axis=1)
    counts = []
    for name, values in zip(("accel", "gyro"), readings, strict=True):
        zero, factor = getattr(COUNTS, name).conversion()
        flip = [-1.0 if c.startswith("-") else 1.0 for c in getattr(COUNTS, name).columns]
        counts.append((values / (factor * flip) + zero)[:, order])
    want = [x @ AXES[axes].T for x in step_by_step(apart, steps, *readings)]
    in_c = run_c(tmp_path, *counts, "foucault_compensate_counts", NEXT_MAIN, steps)
    before, in_python = None, []
    for dt, a, g in zip(steps.tolist(), *(c.tolist() for c in counts), strict=True):
        f, w, before = module.compensate_counts(before, dt, a, g)
        in_python.append([*f, *w])
    for got in (in_c, np.array(in_python)):
        np.testing.assert_allclose(got[:, :3], want[0], atol=1e-10 * np.abs(want[0]).max())
        np.testing.assert_allclose(got[:, 3:], want[1], atol=1e-10 * np.abs(want[1]).max())


def test_json_tells_places_and_delay(apart: Result, full: Result, tmp_path: Path) -> None:
    doc = json.loads(write(apart, "json", tmp_path / "calibration.json").read_text())
    size = doc["size_effect"]
    np.testing.assert_array_equal(size["accel_places"], apart.size_effect.arms)
    assert size["accel_delay"] == apart.size_effect.delay
    assert "(w x (w x r_i) + dw x r_i)_i" in size["equation"]
    assert "size_effect" not in json.loads(write(full, "json", tmp_path / "other").read_text())


# -- Python -----------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["full", "linear"])
def test_python(which: str, request: Any, readings: Readings, tmp_path: Path, same: Same) -> None:
    result: Result = request.getfixturevalue(which)
    path = write(result, "python", tmp_path / "calibration.py")
    assert "import" not in path.read_text().replace("important", "")
    module = load(path)
    f_b, w_b = result.model.compensate(*readings)
    got = [module.compensate(a, g) for a, g in zip(*(r.tolist() for r in readings), strict=True)]
    same([f for f, _ in got], f_b)
    same([w for _, w in got], w_b)


def test_python_from_counts(full: Result, readings: Readings, tmp_path: Path) -> None:
    module = load(write(full, "python", tmp_path / "calibration.py", log=COUNTS))
    counts = []
    for name, values in zip(("accel", "gyro"), readings, strict=True):
        block = getattr(COUNTS, name)
        zero, factor = block.conversion()
        flip = [-1.0 if c.startswith("-") else 1.0 for c in block.columns]
        counts.append(values / (factor * flip) + zero)
    f_b, w_b = full.model.compensate(*readings)
    f, w = module.compensate_counts(counts[0][3].tolist(), counts[1][3].tolist())
    np.testing.assert_allclose(f, f_b[3], rtol=1e-11)
    np.testing.assert_allclose(w, w_b[3], rtol=1e-11)


# -- JSON and CSV -----------------------------------------------------------------------------


def test_json(full: Result, readings: Readings, tmp_path: Path, same: Same) -> None:
    doc = json.loads(write(full, "json", tmp_path / "calibration.json").read_text())
    accel, gyro = readings
    go, back = (
        doc["forward"],
        {k: np.array(v) for k, v in doc["inverse"].items() if k != "equation"},
    )

    def q(f: np.ndarray) -> np.ndarray:
        x, y, z = f.T
        return np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z])

    f = (accel - go["accel_bias"]) @ back["accel_inverse"].T
    for _ in range(60):  # as the file says: repeated until f stands still
        rest = accel - go["accel_bias"] - q(f) @ np.transpose(go["accel_quadratic"])
        f = rest / (1 + go["accel_asymmetry"] * np.sign(rest)) @ back["accel_inverse"].T
    y = gyro - go["gyro_bias"] - f @ np.transpose(go["g_sensitivity"])
    r = y
    for _ in range(60):
        r = (y - go["gyro_cubic"] * r**3) / (1 + go["gyro_asymmetry"] * np.sign(r))
    D = np.einsum("ijk,nk->nij", go["deflection"], f)
    w = r @ back["gyro_inverse"].T
    for _ in range(60):
        w = (r - np.einsum("nij,nj->ni", D, w)) @ back["gyro_inverse"].T
    f_b, w_b = full.model.compensate(accel, gyro)
    same(f, f_b)
    same(w, w_b)
    p = f @ np.transpose(go["accel_matrix"])
    again = p + go["accel_asymmetry"] * np.abs(p) + go["accel_bias"]
    same(again + q(f) @ np.transpose(go["accel_quadratic"]), accel)
    r = w @ np.transpose(go["gyro_matrix"]) + np.einsum("nij,nj->ni", D, w)
    back_again = r + go["gyro_asymmetry"] * np.abs(r) + go["gyro_cubic"] * r**3
    same(back_again + go["gyro_bias"] + f @ np.transpose(go["g_sensitivity"]), gyro)
    assert doc["units"] == {"accel": "m/s^2", "gyro": "rad/s"}


def test_csv(full: Result, tmp_path: Path) -> None:
    text = write(full, "csv", tmp_path / "calibration.csv").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    vector = full.coefficients
    assert [row["name"] for row in rows] == list(vector.names)
    assert [float(row["value"]) for row in rows] == vector.values.tolist()
    assert [row["unit"] for row in rows] == [c.unit for c in vector.layout.coefficients]
    cov = [[float(row[f"cov:{name}"]) for name in vector.names] for row in rows]
    np.testing.assert_array_equal(cov, vector.cov)


def test_csv_leaves_out_what_is_dropped(full: Result, tmp_path: Path) -> None:
    text = write(full, "csv", tmp_path / "c.csv", drop=["accel.cross"]).read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert not any("accel.cross" in line for line in lines)
    assert "LOST" in text
    assert "accel.cross.xyy = " in text


@pytest.mark.parametrize("axes", list(AXES))
def test_axes_turn_readings_and_truth_together(
    axes: str, full: Result, readings: Readings, same: Same
) -> None:
    C = AXES[axes]
    assert np.linalg.det(C) == pytest.approx(1.0)
    turned = in_axes(full.model, C)
    f_b, w_b = full.model.compensate(*readings)
    f_s, w_s = turned.compensate(*(r @ C.T for r in readings))
    same(f_s, f_b @ C.T)
    same(w_s, w_b @ C.T)


# -- what every file says ---------------------------------------------------------------------


def taken(receiver: str) -> tuple[str, ...]:
    """Return the coefficients that a receiver can be given."""
    own = receivers().get(receiver)
    return FAMILIES if own is None or own.before else own.takes


@pytest.mark.parametrize("receiver", list(RECEIVERS))
def test_every_file_says_what_it_is_and_what_is_lost(receiver: str, tmp_path: Path) -> None:
    result = with_terms(*FAMILIES)
    drop = [f for f in FAMILIES if f not in taken(receiver)] or ["gyro.scale"]
    path = write(result, receiver, tmp_path / "out", drop=drop, noise=LOUD)
    text = path.read_text()
    for words in (
        "Calibration by foucault", "serial 0180-2214", "Verdict: pass", "(I + S_a + M_a) f",
        "a bias is measured minus true", "LOST", "x accelerometer input axis",
    ):  # fmt: skip
        assert words in text, words
    lost = [n for n in result.coefficients.names if family(n) in drop]
    for name in lost:
        assert f"{name} = {result.coefficients.value(name)!r}" in text
    docs = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    assert f"## {receiver}" in docs.lower() or f"| {receiver} |" in docs


@pytest.mark.parametrize("receiver", ["c", "python", "json", "csv"])
def test_a_slave_says_how_it_is_mounted(receiver: str, linear: Result, tmp_path: Path) -> None:
    known = {"mounting": {"C_ms": [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]}, "delay": {"used": 0.08}}
    slave = replace(linear, diagnostics=known)
    text = write(slave, receiver, tmp_path / "slave").read_text()
    assert "x_master = C_ms x_slave" in text
    assert "C_ms = ((0.000000000, -1.000000000, 0.000000000), (1" in text
    assert "come 80.000 ms late" in text
    assert "C_ms" not in write(linear, receiver, tmp_path / "alone").read_text()
