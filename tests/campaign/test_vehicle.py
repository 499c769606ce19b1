"""Several IMUs of one vehicle: one command calibrates, compares and ties them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from commands import run
from foucault import procedures
from foucault.diagnose.mounted import tie
from foucault.export.table import found_in, receivers
from foucault.models.rotation import log as rotation_vector
from foucault.recognise.reading import recognise
from foucault.run_folder import load_result
from make_session import SITE
from make_vehicle import TO_FRD, bag_file, bin_file, imus, tlog_file, ulg_file
from refusals import refuses

PLACE = ["--latitude", "48.8462 deg", "--height", "60 m"]


@cache
def flown() -> Any:
    return imus(2, seed=1, rate=50.0)


def told(path: Path, folder: Path, topics: list[str]) -> str:
    """Calibrate a file and return what the screen says, its numbers held against the truth."""
    _, models, turns = flown()
    done = run("calibrate", path, "-o", folder, *PLACE)
    assert done.exit_code in (0, 3), done.output
    about = json.loads((folder / "compare.json").read_text())
    assert [r["instrument"] for r in about["results"]] == topics
    for topic, model in zip(topics, models, strict=True):
        result = load_result(folder / topic.strip("/").replace("/", "_"))
        assert result.instrument["name"] == topic
        vector = result.coefficients
        off = (vector.values - model.coefficients(vector.names).values) / vector.sd
        assert np.abs(off).max() < 5.0, dict(zip(vector.names, off, strict=True))
    (one,) = about["ties"]
    miss = rotation_vector(np.array(one["C_ab"]) @ turns[1].T)
    assert miss @ np.linalg.solve(np.array(one["cov"]), miss) < chi2.ppf(1 - 1e-4, 3)
    (less,) = about["differences"]
    k = less["names"].index("gyro.bias.x")
    want = models[1].gyro_bias[0] - models[0].gyro_bias[0]
    assert abs(less["change"][k] - want) < 5 * less["sd"][k]
    return done.stdout


@pytest.mark.thorough
def test_ardupilot(tmp_path: Path) -> None:
    bin_file(tmp_path / "flight.bin", flown()[0])
    said = told(tmp_path / "flight.bin", tmp_path / "runs", ["IMU/0", "IMU/1"])
    assert "How they are mounted" in said and "Differences from IMU/0" in said
    assert "Between instruments" not in said  # one screen
    assert len(said.splitlines()) < 60
    again = run("report", tmp_path / "runs")
    assert again.exit_code == 0, again.output
    page = (tmp_path / "runs" / "report.html").read_text()
    assert "How they are mounted" in page and "Between instruments" in page
    one = run("calibrate", tmp_path / "flight.bin", "-o", tmp_path / "one", "--set",
              "topic = IMU/1", *PLACE)  # fmt: skip
    assert one.exit_code in (0, 3), one.output
    both = [load_result(tmp_path / where).coefficients for where in ("one", "runs/IMU_1")]
    np.testing.assert_array_equal(both[0].values, both[1].values)
    copy = run("calibrate", tmp_path / "runs/IMU_1/campaign.toml", "-o", tmp_path / "copy")
    assert copy.exit_code in (0, 3), copy.output


@pytest.mark.thorough
def test_what_goes_back_to_the_autopilot_is_that_of_its_sensor(tmp_path: Path) -> None:
    """The log is less offsets that the autopilot had; what is exported takes their place."""
    logs, models, _ = flown()
    bin_file(tmp_path / "flight.bin", logs, own=True)
    done = run("calibrate", tmp_path / "flight.bin", "-o", tmp_path / "runs", *PLACE)
    assert done.exit_code in (0, 3), done.output
    result = load_result(tmp_path / "runs/IMU_1")
    lost = [w for n in ("accel.misalignment", "gyro.scale", "gyro.misalignment")
            for w in ("--drop", n)]  # fmt: skip
    done = run("export", tmp_path / "runs/IMU_1", "--to", "ardupilot", "-o", tmp_path / "p", *lost)
    assert done.exit_code == 0, done.stderr
    x = found_in(receivers()["ardupilot"].of_slot(1), (tmp_path / "p").read_text())
    model, sd = models[1], dict(zip(result.coefficients.names, result.coefficients.sd, strict=True))
    scale = 1 / np.diag(model.accel_matrix)
    for key, want, of in (("ACC2OFFS", TO_FRD @ model.accel_bias, "accel.bias"),
                          ("ACC2SCAL", np.abs(TO_FRD) @ scale, "accel.scale"),
                          ("GYR2OFFS", TO_FRD @ model.gyro_bias, "gyro.bias")):  # fmt: skip
        got = [x[f"INS_{key}_{axis}"] for axis in "XYZ"]
        assert np.abs(got - want).max() < 5 * max(sd[f"{of}.{axis}"] for axis in "xyz"), key


@pytest.mark.thorough
def test_px4(tmp_path: Path) -> None:
    ulg_file(tmp_path / "flight.ulg", flown()[0])
    told(tmp_path / "flight.ulg", tmp_path / "runs", ["vehicle_imu/0", "vehicle_imu/1"])


@pytest.mark.thorough
def test_telemetry(tmp_path: Path) -> None:

    tlog_file(tmp_path / "flight.tlog", flown()[0])
    told(tmp_path / "flight.tlog", tmp_path / "runs", ["HIGHRES_IMU/0", "HIGHRES_IMU/1"])


@pytest.mark.thorough
@pytest.mark.parametrize("mcap", [False, True])
def test_bags(mcap: bool, tmp_path: Path) -> None:
    bag_file(tmp_path / "drive", flown()[0], mcap)
    told(tmp_path / "drive", tmp_path / "runs", ["/imu0", "/imu1"])


@pytest.mark.thorough
def test_one_that_cannot_be_calibrated_does_not_stop_the_others(tmp_path: Path) -> None:
    log, still = flown()[0]
    first = still.gyro[:1] * 0, still.accel[:1]
    still = type(still)(still.time, *(np.repeat(x, len(still), axis=0) for x in first))
    bin_file(tmp_path / "flight.bin", [log, still])
    done = run("calibrate", tmp_path / "flight.bin", "-o", tmp_path / "runs", *PLACE)
    assert done.exit_code == 4
    assert "IMU/1: " in done.stdout and "IMU/0, " in done.stdout
    assert load_result(tmp_path / "runs/IMU_0").instrument["name"] == "IMU/0"
    assert not (tmp_path / "runs" / "compare.json").exists()
    bin_file(tmp_path / "flight.bin", [still, still])
    done = run("calibrate", tmp_path / "flight.bin", "-o", tmp_path / "none", *PLACE)
    assert done.exit_code == 1
    assert "has readings of 2 instruments, and none can be calibrated." in done.stderr


def test_of_one_instrument_nothing_is_asked(tmp_path: Path) -> None:
    """Messages that say the same of it in two ways are no two instruments."""
    logs = flown()[0]
    bin_file(tmp_path / "flight.bin", logs[:1], single=True)
    assert recognise([tmp_path / "flight.bin"]).log["topic"] == "IMU/0"
    keep = {"own_calibration": "keep"}  # what is said counts where a file describes itself too
    assert recognise([tmp_path / "flight.bin"], keep).log["own_calibration"] == "keep"
    bin_file(tmp_path / "flight.bin", logs)
    with refuses("log.several_topics"):
        recognise([tmp_path / "flight.bin"])


@pytest.mark.thorough
def test_the_rotation_is_known_as_well_as_it_says() -> None:
    """NEES over 40 vehicles inside two-sided limits of chi-square at 1 %."""
    calibrate, total, n = procedures.load("hand_rotated").calibrate, 0.0, 40
    for seed in range(1, n + 1):
        logs, _, turns = imus(2, seed, 50.0)
        a, b = (calibrate(log, site=SITE) for log in logs)
        tied = tie(a, logs[0], b, logs[1])
        assert tied is not None
        miss = rotation_vector(tied.C_ab @ turns[1].T)
        total += miss @ np.linalg.solve(tied.cov, miss)
    assert chi2.ppf(0.005, 3 * n) < total < chi2.ppf(0.995, 3 * n)


@pytest.mark.thorough
def test_gravity_along_one_line_ties_nothing() -> None:
    logs, _, _ = imus(2, 1, 50.0)
    calibrate = procedures.load("hand_rotated").calibrate
    a, b = (calibrate(log, site=SITE) for log in logs)
    assert tie(a, logs[0][:100], b, logs[1][:100]) is None
