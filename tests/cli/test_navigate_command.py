"""The command navigate: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from commands import run
from foucault import run_folder
from foucault.coefficients import CoefficientVector
from foucault.logs import write as write_log
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.tables import declared
from make_navigation import DRIVE, calibration, errors, logged, write_reference

TRUE, FOUND = errors()
SITE = ["--latitude", "47.3 deg", "--longitude", "8.5 deg", "--height", "430 m"]
QUIET = ["--gyro-noise", "0.002 deg/sqrt(h)", "--accel-noise", "5 ug/sqrt(Hz)"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a parked log, a drive and its reference, and the calibration."""
    folder = tmp_path_factory.mktemp("navigate")
    write_log(logged([Rest(600.0)], TRUE, rate=10.0).log, folder / "parked.csv")
    drive = logged(DRIVE, TRUE)
    write_log(drive.log, folder / "drive.parquet")
    write_reference(drive, folder / "reference.csv")
    run_folder.save(calibration(FOUND), folder / "run")
    return folder


def test_a_parked_log_on_the_screen_and_nothing_written(folder: Path) -> None:
    before = sorted(p.name for p in folder.iterdir())
    result = run("navigate", folder / "parked.csv", *SITE, *QUIET, "--calibration", folder / "run",
                 "--serial", "SN 4", code=0)  # fmt: skip
    for words in ("63.08", "inertial frame", "off after 6.67 min", "horizontal [m]",
                  "without calibration [m]", "gyro.bias.x", "All together",
                  "the two runs differ by", "drift about east", "verdict: pass"):  # fmt: skip
        assert words in result.output
    assert sorted(p.name for p in folder.iterdir()) == before


@pytest.mark.thorough
def test_a_drive_with_its_folder(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["--reference", folder / "reference.csv", "--calibration", folder / "run", "-o", out]
    result = run("navigate", folder / "drive.parquet", *QUIET, *words)
    assert result.exit_code == 0 and f"Report: {out / 'report.html'}" in result.output
    assert "terms of the error" not in result.output
    assert sorted(p.name for p in out.iterdir()) == [
        "budget.parquet", "errors.parquet", "navigation.json", "report.html",
        "trajectory.parquet", "trajectory_without.parquet",
    ]  # fmt: skip
    schema = pq.read_schema(out / "trajectory.parquet")
    assert schema.names == [c.name for c in declared("trajectory")]
    units = [f.metadata[b"unit"].decode() for f in schema]
    assert units == [c.unit for c in declared("trajectory")]
    before = (out / "report.html").read_text()
    (out / "report.html").unlink()
    assert run("report", out).exit_code == 0 and (out / "report.html").read_text() == before
    # What was navigated can be a reference itself: then there is no error.
    words[1:2] = [out / "trajectory.parquet"]
    again = run("navigate", folder / "drive.parquet", *QUIET, *words[:-2], "--json")
    end = json.loads(again.stdout)["runs"][0]["growth"][-1]
    assert end["horizontal"] < 0.5 and abs(end["heading"]) < 1e-6


def test_json_says_all(folder: Path, tmp_path: Path) -> None:
    result = run("navigate", folder / "parked.csv", *SITE, *QUIET, "--calibration", folder / "run",
                 "--align", "200 s", "--until", "8 min", "--rate", "1 Hz", "-o", tmp_path / "o",
                 "--json")  # fmt: skip
    said = json.loads(result.stdout)
    assert said["schema"] == "foucault.navigation/1" and Path(said["report"]).is_file()
    assert said["duration"] == pytest.approx(280, abs=0.2) and said["reference"]["still"]
    assert said["opening"]["end"] == pytest.approx(199.9) and said["settings"]["vertical"] == "held"
    assert [r["name"] for r in said["runs"]] == ["with calibration", "without calibration"]
    growth = said["runs"][0]["growth"]
    assert [round(row["age"]) for row in growth] == [60, 120, 280]
    worth = {r["name"]: r["worth"]["horizontal"] for r in said["contributions"]}
    assert list(worth.values()) == sorted(worth.values(), reverse=True) and len(worth) == 21
    total = np.sum([[r["worth"]["east"], r["worth"]["north"]] for r in said["contributions"]], 0)
    assert total == pytest.approx(said["difference"], rel=0.02, abs=0.01)
    parts = [said["predicted"][k]["covariance"] for k in ("coefficients", "alignment", "noise")]
    assert np.sum(parts, axis=0) == pytest.approx(np.array(said["predicted"]["all"]["covariance"]))
    assert said["provenance"]["calibration"]["file"].endswith("result.json")
    assert pq.read_table(tmp_path / "o" / "trajectory.parquet").num_rows == 282
    file = json.loads((tmp_path / "o" / "navigation.json").read_text())
    assert file == {k: v for k, v in said.items() if k not in ("folder", "report")}


def test_noise_declared_ten_times_too_small_ends_with_three(folder: Path, tmp_path: Path) -> None:
    proud = CoefficientVector(FOUND.layout, 0 * FOUND.values, 1e-6 * FOUND.cov)
    run_folder.save(calibration(proud), tmp_path / "run")
    quiet = ["--gyro-noise", "0.0002 deg/sqrt(h)", "--accel-noise", "0.5 ug/sqrt(Hz)"]
    result = run("navigate", folder / "parked.csv", *SITE, *quiet, "--calibration",
                 tmp_path / "run")  # fmt: skip
    assert result.exit_code == 3 and "The noise that is seen was used" in " ".join(
        result.output.split()
    )


def test_a_given_heading_that_is_hardly_known_ends_with_four(folder: Path) -> None:
    result = run("navigate", folder / "parked.csv", *SITE, "--heading", "63 deg", "--heading-sd",
                 "20 deg")  # fmt: skip
    assert result.exit_code == 4 and "levelled at rest, heading given" in result.output
    whole = run("navigate", folder / "parked.csv", *SITE, "--heading", "63 deg", "--pitch",
                "3 deg", "--roll", "-2 deg", "--level-sd", "1 arcmin")  # fmt: skip
    assert whole.exit_code == 3 and "given" in whole.output.split()
    assert "Not judged: without a calibration nothing is known" in " ".join(whole.output.split())
    assert "noise and alignment alone, half of all runs [m]" in whole.output
    assert "heading [arcmin]" not in whole.output


CAMPAIGN = """
[instrument]
serial = "{serial}"
[site]
latitude = "47.3 deg"
height = "430 m"
[log]
file = "parked.csv"
[procedure]
name = "hand_rotated"
[noise]
gyro = {{ white = "0.002 deg/sqrt(h)" }}
accel = {{ white = "5 ug/sqrt(Hz)" }}
"""


@pytest.mark.thorough
def test_a_campaign_says_the_same(folder: Path) -> None:
    file = folder / "campaign.toml"
    file.write_text(CAMPAIGN.format(serial="SN 4"))
    said = json.loads(run("navigate", file, "--calibration", folder / "run", "--json").stdout)
    bare = run("navigate", folder / "parked.csv", *SITE, *QUIET, "--calibration", folder / "run",
               "--json")  # fmt: skip
    for one, other in zip(said["runs"], json.loads(bare.stdout)["runs"], strict=True):
        for a, b in zip(one["growth"], other["growth"], strict=True):
            assert a["horizontal"] == pytest.approx(b["horizontal"], rel=1e-3)
    assert said["noise"]["source"] == "declared" and said["instrument"]["serial"] == "SN 4"
    file.write_text(CAMPAIGN.format(serial="SN 5"))
    other = run("navigate", file, "--calibration", folder / "run")
    assert other.exit_code == 1 and "the calibration is of SN 4" in other.output
    file.unlink()


def test_a_folder_of_a_calibration_stays(folder: Path) -> None:
    result = run("navigate", folder / "parked.csv", *SITE, "-o", folder / "run", code=1)
    assert "already holds result.json, of another kind of run." in result.output


def test_a_serial_number_that_is_not_that_of_the_calibration(folder: Path) -> None:
    words = ("--calibration", folder / "run", "--serial", "SN 5")
    result = run("navigate", folder / "parked.csv", *SITE, *words)
    assert result.exit_code == 1 and "the calibration is of SN 4" in result.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--align", "300"], "--align"),
        (["--align", "0 s"], "greater than 0"),
        (["--latitude", "3 m"], "--latitude: 'm' does not measure angle"),
        (["--latitude", "95 deg"], "outside -90 to 90 deg"),
        (["--gravity", "98 m/s^2"], "gravity"),
        (["--heading", "10 deg", "--roll", "1 deg"], "was given without --pitch"),
        (["--align", "2 h"], "The alignment was to last from 0 s to 7200 s"),
        (["--reference", "nowhere.csv"], "does not exist"),
    ],
)
def test_mistakes_are_one_sentence(folder: Path, words: list[str], said: str) -> None:
    rest = [] if "--latitude" in words else SITE
    result = run("navigate", folder / "parked.csv", *rest, *words)
    assert result.exit_code == 1 and said in result.output and "Traceback" not in result.output


def test_without_a_place_there_is_no_navigation(folder: Path) -> None:
    result = run("navigate", folder / "parked.csv")
    assert result.exit_code == 1 and 'Give --latitude "47.3 deg"' in result.output


@pytest.mark.thorough
def test_damaged_folders_are_refused(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run("navigate", folder / "parked.csv", *SITE, "-o", out)
    (out / "budget.parquet").write_bytes(b"other")
    assert "budget" in run("report", out).output and run("report", out).exit_code == 1
    (out / "budget.parquet").unlink()
    assert run("report", out).exit_code == 1
    (out / "navigation.json").write_text('{"schema": "foucault.navigation/9"}')
    assert "foucault.navigation/9" in run("report", out).output
    (out / "navigation.json").write_text("{")
    assert run("report", out).exit_code == 1


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log that is turned without leaving its place, with four samples lost while it rests."""
    plan = [Rest(60.0), Rotate("up", np.pi / 2, np.radians(10)), Rest(60.0)]
    log = logged(plan, rate=10.0).log
    keep = np.delete(np.arange(len(log)), np.arange(1000, 1004))
    file = tmp_path_factory.mktemp("turned") / "log.csv"
    write_log(replace(log, **{n: getattr(log, n)[keep] for n in ("time", "gyro", "accel")}), file)
    return file


def document(*words: object) -> dict[str, Any]:
    return json.loads(run("navigate", *words, *SITE, *QUIET, "--json").stdout)


def test_a_log_that_never_left_its_site(turned: Path) -> None:
    moved = document(turned, "--gaps", "bridge")
    still = document(turned, "--gaps", "bridge", "--still")
    codes = [f["code"] for f in moved["findings"]]
    assert "navigate.no_reference" in codes and not moved["runs"][0]["growth"]
    assert still["reference"]["still"] and still["runs"][0]["growth"][-1]["horizontal"] < 50


@pytest.mark.thorough
def test_a_log_that_left_its_site(folder: Path) -> None:
    words = ("navigate", folder / "drive.parquet", *SITE, *QUIET, "--still")
    assert "that the instrument never left its site, but" in run(*words).output
    both = run(*words, "--reference", folder / "reference.csv")
    assert both.exit_code == 1 and "--reference gives where it was" in both.output


def test_gaps_stop_or_are_bridged(turned: Path) -> None:
    words = ("navigate", turned, *SITE, *QUIET)
    stopped = run(*words, "--gaps", "stop")
    assert stopped.exit_code == 1 and stopped.output == run(*words).output
    assert "--gaps bridge" in stopped.output and "the longest 500 ms" in stopped.output
    codes = [f["code"] for f in document(turned, "--gaps", "bridge")["findings"]]
    assert "strapdown.bridged" in codes


@pytest.mark.parametrize("method", ["inertial_frame", "two_vector", "kalman"])
def test_the_method_that_aligns_at_the_start(folder: Path, method: str) -> None:
    said = document(folder / "parked.csv", "--method", method, "--until", "5 min")
    assert said["runs"][0]["start"]["method"] == method


@pytest.mark.thorough
def test_the_vertical_channel(folder: Path, tmp_path: Path) -> None:
    moved = {}
    for vertical in ("held", "free"):
        said = document(folder / "parked.csv", "--vertical", vertical, "-o", tmp_path / vertical)
        assert said["settings"]["vertical"] == vertical
        height = pq.read_table(tmp_path / vertical / "trajectory.parquet")["height"].to_numpy()
        moved[vertical] = np.ptp(height)
    assert moved["held"] < 0.01 < moved["free"]
    refused = run("navigate", folder / "drive.parquet", *SITE, *QUIET, "--vertical", "aided")
    assert refused.exit_code == 1 and "--vertical aided needs heights" in refused.output


def test_a_part_of_the_log(folder: Path) -> None:
    whole = document(folder / "parked.csv", "--align", "60 s")
    part = document(folder / "parked.csv", "--align", "60 s", "--from", "2 min")
    assert whole["duration"] - part["duration"] == pytest.approx(120, abs=0.2)
    late = run("navigate", folder / "parked.csv", *SITE, *QUIET, "--from", "1 h")
    assert late.exit_code == 1 and "the log lasts 600 s" in late.output


def test_gravity_that_is_given_is_used(folder: Path) -> None:
    said = document(folder / "parked.csv", "--gravity", "9.7 m/s^2")
    assert said["site"]["gravity"] == 9.7
    assert "alignment.gravity" in [f["code"] for f in said["findings"]]
