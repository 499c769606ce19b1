"""The command north: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import run_folder
from foucault.coefficients import CoefficientVector
from foucault.models.north_seeker import RATE_LEVEL, SEEKER
from make_north import ARGUMENTS, PALINDROME, many, write_readings
from make_result import make_result


@pytest.fixture(scope="module")
def readings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("north") / "readings.csv"
    write_readings(file)
    return file


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    """A calibration as `calibrate` leaves it, of instrument SN 4."""
    sd = np.full(len(RATE_LEVEL), 1e-7)
    vector = CoefficientVector(SEEKER.subset(RATE_LEVEL), 0 * sd, np.diag(sd**2))
    result = replace(
        make_result(), procedure="north_seeking", coefficients=vector, instrument={"serial": "SN 4"}
    )
    run_folder.save(result, tmp_path / "run")
    return tmp_path / "run"


def test_one_set_up_on_the_screen_and_nothing_written(readings: Path) -> None:
    result = run("north", readings, *ARGUMENTS, code=0)
    for words in ("Mark 7", "Heading 123.5", "0.054"):
        assert words in result.output
    assert "noise: declared" in result.output and "None was used: bias" in result.output
    assert "To be twice as good, gyro noise must come down" in result.output
    assert "verdict: pass" in result.output
    assert [p.name for p in readings.parent.iterdir()] == ["readings.csv"]


def test_what_all_set_ups_share_is_said_once(tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv", many(12))
    result = run(
        "north", tmp_path / "r.csv", *ARGUMENTS, "--gyro-noise", "0.0003 deg/sqrt(h)", code=3
    )
    assert result.output.count("The residuals of the gyro over all set-ups are") == 1


def test_of_a_long_table_the_screen_has_what_did_not_pass_and_the_first_rows(
    tmp_path: Path,
) -> None:
    write_readings(tmp_path / "r.csv", many(104))
    rows = (tmp_path / "r.csv").read_text().splitlines()
    last = rows[-2].split(",")
    last[3] = str(float(last[3]) + 5e-6)  # rad/s, far beyond the noise
    (tmp_path / "r.csv").write_text("\n".join([*rows[:-2], ",".join(last), rows[-1]]))
    result = run("north", tmp_path / "r.csv", *ARGUMENTS, "-o", tmp_path / "out", code=3)
    assert "\n4 rows more on the page" in result.output
    shown = [
        f"M{k}" for k in range(1, 105) if f" M{k} " in result.output.partition("rows more on")[0]
    ]
    assert shown == [*(f"M{k}" for k in range(1, 100)), "M104"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(f"M{k}<" in page for k in range(100, 104))


def test_where_a_table_cannot_be_written_there_is_no_result(tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv")
    (tmp_path / "out" / "fixes.parquet").mkdir(parents=True)
    result = run("north", tmp_path / "r.csv", *ARGUMENTS, "-o", tmp_path / "out", code=1)
    assert "cannot be written" in result.output and "is whole" not in result.output
    assert not (tmp_path / "out" / "north.json").exists()


def test_many_with_a_wanted_accuracy(tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv", many(5), reference=True)
    out = tmp_path / "out"
    result = run(
        "north", tmp_path / "r.csv", *ARGUMENTS, "--accuracy", "0.02 deg", "-o", out, code=3
    )
    assert "verdict: 0 of 5 pass" in result.output
    assert "minus reference [°]" in result.output
    assert "Dwell at least" in result.output and "The same in 2 more set-ups." in result.output
    assert (out / "report.html").is_file()
    before = (out / "report.html").read_text()
    (out / "report.html").unlink()
    again = run("report", out)
    assert again.exit_code == 0 and (out / "report.html").read_text() == before


def test_too_noisy_is_unusable(tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv", dwell=5.0)
    words = [w.replace("0.003", "3") for w in ARGUMENTS]
    result = run("north", tmp_path / "r.csv", *words)
    assert result.exit_code == 4 and "too noisy by a factor" in result.output


def test_json_says_all(readings: Path, tmp_path: Path) -> None:
    result = run("north", readings, *ARGUMENTS, "-o", tmp_path / "out", "--json")
    said = json.loads(result.stdout)
    assert said["schema"] == "foucault.north/1" and Path(said["report"]).is_file()
    setup = said["setups"][0]
    assert setup["name"] == "Mark 7" and setup["verdict"] == "pass"
    off = setup["heading"]["value"] - np.radians(123.456)
    assert abs(off) < 4 * setup["heading"]["sd"]
    assert setup["heading"]["bound"] <= setup["heading"]["sd"] * (1 + 1e-9)
    file = json.loads((tmp_path / "out" / "north.json").read_text())
    assert file == {k: v for k, v in said.items() if k not in ("folder", "report")}


def test_headings_from_three_norths_each_under_its_name(readings: Path, tmp_path: Path) -> None:
    pytest.importorskip("pygeomag")
    pytest.importorskip("pyproj")
    words = (*ARGUMENTS, "--longitude", "2.3464 deg", "--date", "2026-05-04", "--grid",
             "EPSG:32631")  # fmt: skip
    out = run("north", readings, *words, "-o", tmp_path / "out").output
    assert "Headings from other norths" in out and "EPSG:32631" in out
    file = json.loads((tmp_path / "out" / "north.json").read_text())
    assert [n["name"] for n in file["norths"]] == ["true", "magnetic", "grid"]
    setup = file["setups"][0]
    for north in file["norths"]:
        heading, sd = setup["headings"][north["name"]]
        off = heading - setup["heading"]["value"] + north["offset"]
        assert abs((off + np.pi) % (2 * np.pi) - np.pi) < 1e-12
        assert sd == pytest.approx(np.hypot(setup["heading"]["sd"], north["sd"]))
    titles, row = (tmp_path / "out" / "fixes.csv").read_text().splitlines()
    told = dict(zip(titles.split(","), row.split(","), strict=True))
    for name in ("magnetic", "grid"):
        want = np.degrees(setup["headings"][name][0])
        assert float(told[f"heading from {name} north (deg)"]) == pytest.approx(want, abs=1e-6)
    assert "other norths" in (tmp_path / "out" / "report.html").read_text()
    plain = run("north", readings, *ARGUMENTS).output
    assert "other norths" not in plain


def test_the_latitude_can_be_unknown(readings: Path) -> None:
    words = [w for w in ARGUMENTS if w not in ("--latitude", "47.3 deg")]
    result = run("north", readings, *words, "--unknown-latitude", "--gravity", "9.80828 m/s^2")
    assert result.exit_code == 0 and "latitude" in result.output and "47." in result.output
    south = run("north", readings, *words, "--unknown-latitude", "--gravity", "9.80828 m/s^2",
                "--hemisphere", "south", "--json")  # fmt: skip
    assert json.loads(south.stdout)["setups"][0]["latitude"]["value"] < 0


def test_settings_of_the_command_line_arrive(readings: Path) -> None:
    words = ["--latitude-sd", "0.5 deg", "--near", "120 deg", "--index-sd", "10 arcsec",
             "--drift", "linear", "--height", "430 m"]  # fmt: skip
    said = json.loads(run("north", readings, *ARGUMENTS, *words, "--json").stdout)
    assert said["known"]["latitude_sd"] == pytest.approx(np.radians(0.5))
    assert said["known"]["near"] == pytest.approx(np.radians(120))
    assert said["drift_sd"] == "free" and said["site"]["height"] == 430
    assert "indexing" in said["setups"][0]["budget"]
    assert said["setups"][0]["gyro_drift"] != 0


def test_without_accelerometers_the_level_is_said(readings: Path, tmp_path: Path) -> None:
    rows = [line.split(",") for line in readings.read_text().splitlines()]
    head = next(i for i, row in enumerate(rows) if "specific force (m/s^2)" in row)
    force = rows[head].index("specific force (m/s^2)")
    bare = tmp_path / "bare.csv"
    kept = [row[:force] + row[force + 1 :] for row in rows[head:]]
    bare.write_text("\n".join([",".join(row) for row in kept] + [""]))
    refused = run("north", bare, *ARGUMENTS)
    assert refused.exit_code == 1 and '--level-sd "1 arcmin"' in refused.output
    sd = {}
    for level in ("1 arcmin", "10 arcmin"):
        said = json.loads(run("north", bare, *ARGUMENTS, "--level-sd", level, "--json").stdout)
        sd[level] = said["setups"][0]["heading"]["sd"]
    assert sd["10 arcmin"] > np.radians(10 / 60) > sd["1 arcmin"] > np.radians(1 / 60)


def test_noise_of_the_accelerometer_is_that_of_the_tilt(readings: Path) -> None:
    words = [w.replace("30 ug/sqrt(Hz)", "3 mg/sqrt(Hz)") for w in ARGUMENTS]
    loud = json.loads(run("north", readings, *words, "--json").stdout)["setups"][0]
    calm = json.loads(run("north", readings, *ARGUMENTS, "--json").stdout)["setups"][0]
    assert loud["pitch"]["sd"] > 1.5 * calm["pitch"]["sd"]
    bad = run("north", readings, "--latitude", "47 deg", "--accel-noise", "30 ug")
    assert bad.exit_code == 1 and "--accel-noise: 'ug' does not measure" in bad.output


def test_a_calibration_and_its_serial_number(readings: Path, calibration: Path) -> None:
    result = run("north", readings, *ARGUMENTS, "--calibration", calibration, "--serial", "SN 4")
    assert result.exit_code == 0 and "\nCalibration\ninstrument: SN 4\n" in result.output
    said = json.loads(
        run("north", readings, *ARGUMENTS, "--calibration", calibration, "--json").stdout
    )
    codes = [f["code"] for f in said["findings"]]
    assert "north.whose" in codes and said["calibration"]["instrument"]["serial"] == "SN 4"
    assert said["provenance"]["calibration"]["file"].endswith("result.json")
    assert "calibration: bias" in said["setups"][0]["budget"]
    note = run("north", readings, *ARGUMENTS, "--calibration", calibration / "result.json")
    assert "The calibration is of instrument SN 4; the readings name none." in note.output
    other = run(
        "north", readings, *ARGUMENTS, "--calibration", calibration, "--serial", "SN 5", code=1
    )
    assert "of instrument SN 5, the calibration is of SN 4" in other.output


def test_a_result_of_something_else(readings: Path, tmp_path: Path) -> None:
    run_folder.save(make_result(), tmp_path / "run")
    result = run("north", readings, *ARGUMENTS, "--calibration", tmp_path / "run")
    assert result.exit_code == 1 and "is a result of hand-rotated" in result.output


CAMPAIGN = """
[instrument]
name = "Seeker"
serial = "SN 9"
[site]
latitude = "47.3 deg"
[log]
file = "readings.csv"
setup = "setup"
time = { column = "time (s)", unit = "s" }
index = { column = "index (rad)", unit = "rad" }
gyro = { column = "gyro (rad/s)", unit = "rad/s" }
accel = { column = "specific force (m/s^2)", unit = "m/s^2", reads = "specific force" }
averaged = { column = "dwell (s)", unit = "s" }
[procedure]
name = "north_seeking"
[noise]
gyro = { white = "0.003 deg/sqrt(h)" }
accel = { white = "30 ug/sqrt(Hz)" }
"""


def test_what_is_not_estimated_counts_unless_the_campaign_says_that_there_is_nothing(
    tmp_path: Path,
) -> None:
    """A g-sensitivity goes once per turn of the base, as the Earth's rate does."""
    write_readings(tmp_path / "readings.csv", stops=(0.0, 90.0, 180.0, 270.0))
    heads = {"counted": 'grade = "tactical FOG"', "nothing": "left_out = false"}
    found = {}
    for name, words in heads.items():
        text = CAMPAIGN.replace("[instrument]", f"[instrument]\n{words}")
        (tmp_path / f"{name}.toml").write_text(text)
        found[name] = json.loads(run("north", tmp_path / f"{name}.toml", "--json").stdout)
    counted, nothing = found["counted"], found["nothing"]
    assert counted["setups"][0]["heading"]["sd"] > 1.1 * nothing["setups"][0]["heading"]["sd"]
    left = counted["not_estimated"]
    most = left["group"].index("gyro.g_sensitivity")
    assert left["share"][most] == max(left["share"]) > 0.1
    assert "tactical FOG" in left["basis"][most] and counted["named"] == []
    assert "not_estimated" not in nothing
    assert [f["code"] for f in counted["findings"]].count("north.left_out") == 1
    text = run("north", tmp_path / "counted.toml", "-o", tmp_path / "out").output
    assert "g-sensitivity of the gyros" in text and "What is not estimated counts" in text
    assert "Left out: what it costs" in (tmp_path / "out" / "report.html").read_text()


def test_a_campaign_says_the_same(readings: Path, tmp_path: Path, calibration: Path) -> None:
    file = readings.parent / "campaign.toml"
    # The class of the noise is that of its sizes: the one that is declared stays.
    file.write_text(CAMPAIGN.replace("[instrument]", '[instrument]\ngrade = "navigation RLG"'))
    try:
        said = json.loads(run("north", file, "--json").stdout)
        bare = json.loads(run("north", readings, *ARGUMENTS, "--json").stdout)
        assert said["setups"][0]["heading"] == pytest.approx(bare["setups"][0]["heading"], rel=1e-5)
        assert said["instrument"]["serial"] == "SN 9"
        louder = run("north", file, "--gyro-noise", "0.006 deg/sqrt(h)", "--json")
        double = json.loads(louder.stdout)["setups"][0]["heading"]["sd"]
        assert double == pytest.approx(2 * said["setups"][0]["heading"]["sd"], rel=2e-2)
        other = run("north", file, "--calibration", calibration)
        assert other.exit_code == 1 and "the calibration is of SN 4" in other.output
        twice = run("north", file, "--accel-reads", "gravity")
        assert twice.exit_code == 1 and "which states it in [log.accel]" in twice.output
    finally:
        file.unlink()


def test_a_campaign_of_something_else(tmp_path: Path) -> None:
    run("init", "hand_rotated", "-o", tmp_path / "campaign.toml")
    result = run("north", tmp_path / "campaign.toml", code=1)
    assert "is a campaign of hand_rotated, not of a north seeker" in result.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--latitude", "47.3"], "--latitude"),
        (["--latitude", "95 deg"], "outside -90 to 90 deg"),
        (["--latitude", "89.5 deg"], "beyond +-89 deg"),
        (["--latitude", "3 m"], "--latitude: 'm' does not measure angle"),
        (["--latitude-sd", "0 deg"], "--latitude-sd"),
        (["--gyro-noise", "0.003 deg/h"], "--gyro-noise: 'deg/h' does not measure"),
        (["--unknown-latitude"], "--latitude and --unknown-latitude contradict one another"),
    ],
)
def test_mistakes_are_one_sentence(readings: Path, words: list[str], said: str) -> None:
    result = run("north", readings, *ARGUMENTS, *words)
    assert result.exit_code == 1 and said in result.output and "Traceback" not in result.output


def test_help_speaks_of_north_alone() -> None:
    for words in (["north", "--help"], ["north", "plan", "--help"]):
        result = run(*words, code=0)
        assert f"foucault {' '.join(words[:-1])} " in result.output.partition("Example")[2]
    usage = run("north").output
    assert "foucault north find" not in usage
    assert len(PALINDROME) == 8
