"""The command align: several methods side by side, with their limits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from commands import run
from foucault import run_folder
from foucault.coefficients import CoefficientVector
from foucault.logs import own
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans.manoeuvres import Rest, Rotate, Start
from foucault.simulate.motion import simulate_motion
from make_navigation import calibration

DPH = np.radians(1) / 3600
HEADING, PITCH, ROLL = np.radians([70.0, 2.0, -3.0])
START = Start(np.radians(47), 0.1, 400.0, HEADING, PITCH, ROLL)
SITE = ("--latitude", "47 deg", "--height", "400 m")
TWO = ("--rest", "0 s to 120 s", "--rest", "141 s to 259 s")
NOISE = ImuNoise(TriadNoise(white=2e-5), TriadNoise(white=3e-8))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rests 180 deg apart in heading; the east gyro of the first is biased by 0.2 deg/h."""
    file = tmp_path_factory.mktemp("align") / "log.csv"
    model = ImuModel(gyro_bias=np.array([0.2, 0.0, 0.0]) * DPH)
    plan = [Rest(120.0), Rotate("up", -np.pi, np.radians(10)), Rest(121.0)]
    own.write(simulate_motion(plan, START, rate=50.0, model=model, noise=NOISE, seed=5).log, file)
    return file


def found(result: Result) -> dict[str, dict[str, float]]:
    return {row["method"]: row for row in json.loads(result.output)["alignments"]}


def test_methods_stand_side_by_side(log: Path) -> None:
    result = run("align", log, *SITE, "--until", "120 s", "--gyro-bias-sd", "0.2 deg/h", code=0)
    for words in ("inertial frame", "Kalman, zero velocity", "two vectors"):
        assert words in result.output
    assert "two positions" not in result.output.replace("two positions take", "")
    limit = 0.2 * DPH / (7.292115e-5 * np.cos(START.latitude))
    assert f"limits the heading to {np.degrees(limit):.1f} deg" in result.output
    rows = found(run("align", log, *SITE, "--until", "120 s", "--gyro-bias-sd", "0.2 deg/h",
                     "--json"))  # fmt: skip
    # The bias of x alone: what it makes of azimuth in this heading.
    made = -0.2 * DPH * np.cos(HEADING) / (7.292115e-5 * np.cos(START.latitude))
    for row in rows.values():
        beside = row["heading_sd"] ** 2 - row["azimuth_bias_sd"] ** 2
        sd = np.sqrt(max(beside, (0.05 * made) ** 2))
        assert row["heading"] - HEADING == pytest.approx(made, abs=4 * sd)
        assert row["pitch"] == pytest.approx(PITCH, abs=4 * row["pitch_sd"] + 1e-6)
        assert row["roll"] == pytest.approx(ROLL, abs=4 * row["roll_sd"] + 1e-6)
        assert row["azimuth_bias_sd"] == pytest.approx(limit, rel=1e-6)


def test_two_positions_take_the_bias_out(log: Path) -> None:
    rows = found(run("align", log, *SITE, *TWO, "--gyro-bias-sd", "0.2 deg/h", "--json"))
    two, one = rows["two_position"], rows["inertial_frame"]
    assert abs(one["heading"] - HEADING - np.pi) > 0.05 * np.radians(1)
    assert two["heading_sd"] < 0.5 * one["heading_sd"]
    assert two["heading"] == pytest.approx(HEADING + np.pi, abs=4 * two["heading_sd"])


def test_biases_that_were_not_declared_are_named(log: Path) -> None:
    words = ("align", log, *SITE, "--until", "120 s", "--method", "two_vector")
    gyro, accel = ("--gyro-bias-sd", "0.2 deg/h"), ("--accel-bias-sd", "50 ug")
    none = run(*words).output
    assert "No bias is declared (--gyro-bias-sd, --accel-bias-sd, or a" in none
    assert "0.01 deg/h would add 0.056 deg of heading" in none and "Kalman" not in none
    one = run(*words, *gyro).output
    assert "No accelerometer bias is declared (--accel-bias-sd, or" in one
    assert "50 ug would add 0.0029 deg of pitch and roll" in one
    assert "No gyro bias is declared (--gyro-bias-sd, or" in run(*words, *accel).output
    assert "is declared" not in run(*words, *gyro, *accel).output


def test_two_positions_alone(log: Path) -> None:
    """Every rest is checked, the first as well as the last."""
    result = run("align", log, *SITE, *TWO, "--method", "two_position", "--gyro-bias-sd",
                 "0.2 deg/h", "--json", code=0)  # fmt: skip
    (row,) = found(result).values()
    assert row["method"] == "two_position"
    assert row["heading"] == pytest.approx(HEADING + np.pi, abs=4 * row["heading_sd"])


def test_one_rest_is_the_window(log: Path, recwarn: pytest.WarningsRecorder) -> None:
    words = ("--gyro-bias-sd", "0.2 deg/h", "--json")
    one = found(run("align", log, *SITE, "--rest", "0 s to 120 s", *words))
    same = found(run("align", log, *SITE, "--from", "0 s", "--until", "120 s", *words))
    assert one == same and len(one) == 3
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


@pytest.mark.parametrize("cut", [0, 40])
def test_a_gap_is_bridged_where_that_is_asked_for(log: Path, tmp_path: Path, cut: int) -> None:
    lines = log.read_text().splitlines(keepends=True)
    file = tmp_path / "gap.csv"
    file.write_text("".join(lines[:3000] + lines[3000 + cut :]))
    words = ("align", file, *SITE, "--until", "110 s", "--gyro-bias-sd", "0.2 deg/h")
    if not cut:
        assert run(*words).exit_code == 0
        return
    refused = run(*words)
    assert refused.exit_code == 1 and "--gaps bridge" in " ".join(refused.stderr.split())
    bridged = run(*words, "--gaps", "bridge", code=3)
    assert "Gaps were bridged, 1 in all" in " ".join(bridged.output.split())
    assert bridged.output.count("were bridged") == 1


def test_titles_of_increments(tmp_path: Path) -> None:
    """The same log as rates and as increments gives the same attitude."""
    made = simulate_motion([Rest(60.0)], START, rate=20.0, noise=NOISE, seed=2).log
    rates = np.column_stack([made.gyro, made.accel])
    made_of = {}
    for name, units, x in (("rate", ("deg/s", "m/s^2"), rates * [*[180 / np.pi] * 3, 1, 1, 1]),
                           ("increment", ("rad", "m/s"), rates / 20.0)):  # fmt: skip
        heads = [f"{t}_{a} ({u})" for t, u in zip(("gyro", "accel"), units, strict=True)
                 for a in "xyz"]  # fmt: skip
        file = tmp_path / f"{name}.csv"
        np.savetxt(file, np.column_stack([made.time, x]), "%.12g", ",", comments="",
                   header=",".join(["time (s)", *heads]))  # fmt: skip
        words = ("align", file, *SITE, "--until", "59 s", "--method", "inertial_frame", "--json")
        made_of[name] = found(run(*words))["inertial_frame"]
    for key in ("heading", "pitch", "roll"):
        assert made_of["rate"][key] == pytest.approx(made_of["increment"][key], abs=2e-4)
    words = ("align", tmp_path / "increment.csv", *SITE, "--until", "59 s")
    text = " ".join(run(*words).output.split())
    assert "[m/s] sums (sure); gyros gyro_x (rad)" in text


@pytest.mark.parametrize("words", [("align", "--gyro-bias-sd", "0.001 deg/h"), ("navigate",)])
def test_axes_that_point_down_are_asked_about(tmp_path: Path, words: tuple[str, ...]) -> None:
    """Forward-right-down, as usual in aviation, in a log that does not say so."""
    made = simulate_motion([Rest(120.0)], START, rate=20.0, noise=NOISE, seed=2).log
    x = np.column_stack([made.time, made.gyro, made.accel])
    other = x[:, [0, 2, 1, 3, 5, 4, 6]] * [1, 1, 1, -1, 1, 1, -1]
    heads = [f"{t}_{a} ({u})" for t, u in (("gyro", "rad/s"), ("accel", "m/s^2")) for a in "xyz"]
    file = tmp_path / "log.csv"
    doubt = "nobody said how the axes point"
    for rows, doubtful in ((x, False), (other, True)):
        np.savetxt(file, rows, "%.12g", ",", header=",".join(["time (s)", *heads]), comments="")
        done = run(*words, file, *SITE)
        text = " ".join(done.output.split())
        assert (doubt in text) == doubtful, text
        if doubtful:
            assert done.exit_code == 3
            told = text.split("as forward-right-down they give ")[1].split(" deg")[0]
            angles = [float(word) for word in told.split(", ")]
            np.testing.assert_allclose(angles, np.degrees([HEADING, PITCH, ROLL]), atol=0.3)
    campaign = tmp_path / "campaign.toml"
    columns = '{ columns = ["%s_y (%s)", "%s_x (%s)", "-%s_z (%s)"], unit = "%s" }'
    campaign.write_text(
        '[site]\nlatitude = "47 deg"\nheight = "400 m"\n[log]\nfile = "log.csv"\n'
        'time = { column = "time (s)", unit = "s" }\n'
        + "".join(f"{t} = {columns % (t, u, t, u, t, u, u)}\n"
                  for t, u in (("gyro", "rad/s"), ("accel", "m/s^2")))
    )  # fmt: skip
    assert doubt not in run(*words, campaign).output


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--rest", "0 s - 120 s"), "does not say when it starts and when it ends"),
        (("--method", "two_vectors"), "Did you mean 'two_vector'?"),
        (("--rest", "0 s to 900 s", "--rest", "950 s to 990 s"), "the log has"),
        (("--until", "120"), "--until"),
        (("--gyro-bias-sd", "-1 deg/h"), "--gyro-bias-sd: '-1 deg/h' is not allowed"),
        (("--accel-bias-sd", "-1 ug"), "it should be 0 or more"),
        (("--gyro-noise", "0 deg/sqrt(h)"), "it should be greater than 0"),
        (("--accel-noise", "-1 ug/sqrt(Hz)"), "it should be greater than 0"),
        (("--method", "two_position"), "No rests are given"),
        (
            ("--rest", "0 s to 120 s", "--method", "two_position"),
            "The rests given are 0 s to 120 s. Give two rests of the log",
        ),
    ],
)
def test_bad_words_are_refused(log: Path, words: tuple[str, ...], text: str) -> None:
    result = run("align", log, *SITE, *words, code=1)
    assert text in " ".join(result.stderr.split())


def test_no_latitude(log: Path) -> None:
    result = run("align", log, code=1)
    assert "latitude" in result.stderr


def test_headings_from_three_norths_each_under_its_name(log: Path) -> None:
    words = ("align", log, *SITE, "--longitude", "2.3464 deg", "--until", "120 s", "--method",
             "inertial_frame", "--gyro-bias-sd", "0.2 deg/h", "--date", "2026-05-04", "--grid",
             "EPSG:32631")  # fmt: skip
    row = json.loads(run(*words, "--json").output)["alignments"][0]
    assert set(row["headings"]) == {"true", "magnetic", "grid"}
    assert row["headings"]["true"] == [row["heading"] % (2 * np.pi), row["heading_sd"]]
    off = np.degrees(row["headings"]["true"][0] - row["headings"]["grid"][0])
    assert (off + 180) % 360 - 180 == pytest.approx(-0.4780, abs=1e-4)
    assert row["headings"]["magnetic"][1] > row["heading_sd"]
    shown = run(*words).output
    assert "Headings from other norths" in shown
    assert "EPSG:32631" in shown
    plain = run("align", log, *SITE, "--until", "120 s", "--gyro-bias-sd", "0.2 deg/h").output
    assert "Headings from other norths" not in plain


def test_no_rest_leads_to_options_that_align_has(tmp_path: Path) -> None:
    made = simulate_motion([Rotate("x", 0.4, 0.05), Rotate("x", -0.4, 0.05)], START, rate=20.0)
    own.write(made.log, tmp_path / "moving.csv")
    result = run("align", tmp_path / "moving.csv", *SITE, code=1)
    text = " ".join(result.stderr.split())
    assert "No rest of 10 s or more" in text
    assert "`foucault align` takes --from" in text and "--until" in text


def test_a_triad_that_is_missing(tmp_path: Path) -> None:
    heads = "time (s),gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)"
    rows = np.column_stack([np.arange(500) / 10, np.random.default_rng(1).normal(size=(500, 3))])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", comments="", header=heads)
    result = run("align", tmp_path / "log.csv", *SITE, code=1)
    assert "to a log that is given alone" in " ".join(result.stderr.split())


def test_a_turn_in_the_window_is_doubtful(log: Path) -> None:
    result = run("align", log, *SITE, "--until", "200 s", "--gyro-bias-sd", "0.2 deg/h", code=3)
    assert "the instrument turned by" in " ".join(result.output.split())


def test_a_calibration_takes_the_bias_out(log: Path, tmp_path: Path) -> None:
    layout = LAYOUT.subset(["gyro.bias.x", "gyro.bias.y", "gyro.bias.z"])
    bias = CoefficientVector(layout, np.array([0.2, 0.0, 0.0]) * DPH, np.eye(3) * (0.01 * DPH) ** 2)
    run_folder.save(calibration(bias), tmp_path / "run")
    words = ("align", log, *SITE, "--until", "120 s", "--method", "inertial_frame", "--json")
    (raw,) = found(run(*words)).values()
    said = run(*words, "--calibration", tmp_path / "run")
    (better,) = found(said).values()
    assert json.loads(said.stdout)["gyro_bias_sd"] == pytest.approx(0.01 * DPH)
    assert abs(raw["heading"] - HEADING) > np.radians(0.3)
    assert better["heading"] == pytest.approx(HEADING, abs=4 * better["heading_sd"])
    assert better["azimuth_bias_sd"] < np.radians(0.1)


def test_the_site_is_what_the_command_line_says(log: Path) -> None:
    words = ("align", log, "--until", "60 s", "--method", "two_vector", "--json")
    site = json.loads(run(*words, *SITE).stdout)["site"]
    assert site["height"] == 400 and site["gravity"] == pytest.approx(9.8067, abs=2e-3)
    other = json.loads(run(*words, "--latitude", "47 deg", "--height", "5 km").stdout)["site"]
    assert other["gravity"] - site["gravity"] == pytest.approx(-4600 * 3.086e-6, rel=0.02)
    wrong = run(*words, *SITE, "--gravity", "9.9 m/s^2")
    said = json.loads(wrong.stdout)
    assert wrong.exit_code == 3 and said["site"]["gravity"] == 9.9
    assert "alignment.gravity" in [f["code"] for f in said["findings"]]


def test_noise_that_is_declared_counts(log: Path) -> None:
    words = ("align", log, *SITE, "--until", "30 s", "--method", "two_vector", "--json")
    quiet = ("--gyro-noise", "0.001 deg/sqrt(h)", "--accel-noise", "10 ug/sqrt(Hz)")
    (low,) = found(run(*words, *quiet)).values()
    (high,) = found(run(*words, *quiet[2:], "--gyro-noise", "0.1 deg/sqrt(h)")).values()
    (rough,) = found(run(*words, *quiet[:2], "--accel-noise", "1 mg/sqrt(Hz)")).values()
    assert high["heading_sd"] > 20 * low["heading_sd"]
    assert rough["pitch_sd"] > 20 * low["pitch_sd"]
