"""`foucault temperature`, and what its model does in `apply` and `export`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault.logs import read
from foucault.logs import write as write_log
from foucault.logs.description import LogDescription
from foucault.models.imu import ImuModel
from foucault.run_folder import load_result, save
from foucault.tables import Log
from make_temperature import ZERO, sessions, truth

TRUTH, _ = truth()


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Run folders at five temperatures, the first of which does not say its own."""
    monkeypatch.chdir(tmp_path)
    names = []
    for session, degrees in zip(sessions((-15, 5, 25, 45, 65)), (-15, 5, 25, 45, 65), strict=True):
        name = f"at{degrees}"
        result = session.result
        if degrees == -15:
            result = replace(result, validity={"accel": [-12.0, 12.0]})
        save(result, tmp_path / name)
        names.append(name)
    return names


def a_log(T: np.ndarray) -> Log:
    rng = np.random.default_rng(2)
    f_b, w = rng.normal(0, 6, (len(T), 3)), rng.normal(0, 0.5, (len(T), 3))
    accel, gyro = ImuModel.of_samples(TRUTH.layout.names, TRUTH.values(T)).measure(f_b, w)
    return Log(np.arange(len(T)) / 50.0, gyro, accel, "rate", T)


def test_from_results_to_a_calibrated_log(runs: list[str], tmp_path: Path) -> None:
    done = run("temperature", *runs, "--at", "at-15=-15 degC", "-o", "model", code=0)
    assert "parabola" in done.output
    assert "Valid from -15.0 °C to 65.3 °C" in done.output
    assert "verdict: pass" in done.output
    assert (tmp_path / "model/report.html").is_file()
    model = load_result("model").temperature
    T = ZERO + np.linspace(-10, 60, 500)
    write_log(a_log(T), "log.csv")
    assert run("apply", "model", "log.csv", "-o", "out.csv").exit_code == 0
    out = read(LogDescription.model_validate({"file": "out.csv"}), tmp_path)
    rng = np.random.default_rng(2)
    f_b = rng.normal(0, 6, (500, 3))
    # What is left is what the functions are uncertain by, not what the temperature did.
    left, before = out.accel - f_b, a_log(T).accel - f_b
    assert np.abs(left).max() < 0.1 * np.abs(before).max()
    assert np.abs(left.mean(axis=0)).max() < 5 * model.sd(T).mean(axis=0)[:3].max()
    assert run("report", "model").exit_code == 0


@pytest.mark.thorough
def test_json_and_options(runs: list[str]) -> None:
    done = run("--json", "temperature", *runs, "--at", "at-15=258.15 K", "--order", "1", "--order",
               "gyro.bias=2", "--order", "accel.bias=2", "--scatter", "none", "--scatter",
               "gyro.bias=1 deg/h", "--reference", "20 degC", "--margin", "3 K", "--in-order",
               "-o", "model", code=0)  # fmt: skip
    doc = json.loads(done.stdout)["result"]
    said = doc["temperature"]
    assert said["reference"] == pytest.approx(293.15)
    assert said["low"] == pytest.approx(255.15)
    assert doc["diagnostics"]["asked"]["orders"] == {"": 1, "gyro.bias": 2, "accel.bias": 2}
    rows = {r["family"]: r for r in doc["diagnostics"]["families"]}
    assert rows["accel.misalignment"]["function"] == "straight line"
    assert rows["gyro.bias"]["scatter"] == pytest.approx(np.radians(1 / 3600))
    assert not rows["accel.bias"]["scatter_found"]
    assert "chi-square" in [c["name"] for c in doc["checks"]]


def test_knots(runs: list[str]) -> None:
    done = run("temperature", *runs, "--at", "at-15=-15 degC", "--knots",
               "-15 degC, 25 degC, 65 degC", "-o", "model")  # fmt: skip
    assert "line through 3 knots" in done.output
    assert load_result("model").temperature.kind == "piecewise linear"


def test_a_ramp(runs: list[str]) -> None:
    n = 20 * 1500
    part = np.linspace(0, 1, n)
    T = ZERO + 10 + 40 * part
    rng = np.random.default_rng(1)
    accel, gyro = ImuModel.of_samples(TRUTH.layout.names, TRUTH.values(T)).measure(
        np.tile([0.0, 0.0, 9.8], (n, 1)), np.zeros((n, 3))
    )
    noise = 1e-3 * rng.normal(size=(n, 6))
    write_log(Log(np.arange(n) / 20.0, gyro + noise[:, :3], accel + noise[:, 3:], "rate", T),
              "warming.parquet")  # fmt: skip
    done = run("temperature", "at25", "--ramp", "warming.parquet", "-o", "model", code=3)
    assert "known at one temperature, taken as constant over all" in done.output
    assert "temperature_ramps" in load_result("model").tables


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], "temperature.unknown"),
        (["--at", "at-15"], "temperature.at"),
        (["--at", "nowhere=25 degC"], "temperature.at"),
        (["--at", "at-15=25 degC", "--at", "at-15=26 degC"], "temperature.at_twice"),
        (["--at", "at-15=-10 K"], "temperature.implausible"),
        (["--at", "at-15=300 degC"], "temperature.implausible"),
        (["--at", "at-15=25"], "unit.missing"),
        (["--at", "at-15=25 deg"], "unit.kind"),
        (["--order", "gyro.bias=x"], "temperature.assignment"),
        (["--scatter", "gyro.bias"], "temperature.assignment"),
        (["--scatter", "gyro.bias=5 mg"], "unit.kind"),
        (["--margin", "5 degC"], "unit.unknown"),
    ],
)
def test_mistakes(words: list[str], code: str, runs: list[str]) -> None:
    done = run("--json", "temperature", *runs, *words, "-o", "model", code=1)
    assert json.loads(done.stdout)["error"]["code"] == code
    assert not Path("model").exists()


def test_outside_error_and_hold(runs: list[str]) -> None:
    run("temperature", *runs, "--at", "at-15=-15 degC", "-o", "model")
    write_log(a_log(ZERO + np.linspace(50, 80, 100)), "log.csv")
    done = run("--json", "apply", "model", "log.csv", "-o", "out.csv", code=1)
    said = json.loads(done.stdout)["error"]
    assert said["code"] == "temperature.outside"
    assert "--outside hold" in said["cure"]
    done = run("apply", "model", "log.csv", "-o", "out.csv", "--outside", "hold", code=0)
    assert "are outside -15.00 to 65.30 degC" in done.output
    done = run("--json", "apply", "model", "log.csv", "-o", "out.csv", "--outside", "guess")
    assert json.loads(done.stdout)["error"]["code"] == "temperature.outside_choice"


def test_a_log_without_temperature_is_told_the_way_out_and_it_works(runs: list[str]) -> None:
    run("temperature", *runs, "--at", "at-15=-15 degC", "-o", "model")
    log = replace(a_log(np.full(100, ZERO + 25.0)), temperature=None)
    write_log(log, "log.csv")
    done = run("--json", "apply", "model", "log.csv", "-o", "out.csv", code=1)
    said = json.loads(done.stdout)["error"]
    assert said["code"] == "temperature.unlogged" and "-15.00 to 65.30 degC" in said["message"]
    assert 'foucault apply --at "25 degC"' in said["cure"]
    run("apply", "model", "log.csv", "-o", "out.csv", "--at", "25 degC", code=0)
    want = load_result("model").at(298.15).apply(log)
    np.testing.assert_allclose(
        read(LogDescription(file="out.csv"), Path()).accel, want.accel, rtol=0, atol=1e-12
    )
    done = run("--json", "apply", "at25", "log.csv", "-o", "x.csv", "--at", "25 degC", code=1)
    assert json.loads(done.stdout)["error"]["code"] == "temperature.option"


def test_functions_are_no_prior_and_are_not_merged(runs: list[str]) -> None:
    run("temperature", *runs, "--at", "at-15=-15 degC", "-o", "model")
    done = run("--json", "merge", "model", "at25", "-o", "merged")
    assert json.loads(done.stdout)["error"]["code"] == "temperature.as_prior"


@pytest.mark.thorough
def test_export_at_a_temperature(runs: list[str]) -> None:
    run("temperature", *runs, "--at", "at-15=-15 degC", "-o", "model")
    assert run("export", "model", "--to", "c", "-o", "calibration.h").exit_code == 0
    assert "foucault_at(double kelvin" in Path("calibration.h").read_text()
    done = run("--json", "export", "model", "--to", "kalibr", "-o", "imu.yaml")
    assert json.loads(done.stdout)["error"]["code"] == "temperature.receiver"
    run("export", "model", "--to", "json", "--at", "25 degC", "-o", "room.json", code=0)
    room = json.loads(Path("room.json").read_text())
    want = load_result("model").temperature.at(298.15)["gyro.bias"].values
    np.testing.assert_array_equal(room["forward"]["gyro_bias"], want)
    done = run("--json", "export", "model", "--to", "json", "--at", "90 degC", "-o", "hot.json")
    assert json.loads(done.stdout)["error"]["code"] == "temperature.asked_outside"
    done = run("--json", "export", "at25", "--to", "json", "--at", "25 degC", "-o", "x.json")
    assert json.loads(done.stdout)["error"]["code"] == "temperature.option"
