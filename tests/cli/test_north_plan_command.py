"""The command north plan: its table, its advice, its warnings and refusals."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

import commands

GYRO = ("--gyro-noise", "0.003 deg/sqrt(h)")
PLAIN = ("--latitude", "47 deg", *GYRO, "--time", "9 min")
FEW = ("--order", "published", "--order", "palindrome")


run = partial(commands.run, "north", "plan")


@pytest.mark.thorough
def test_minutes_and_what_to_do(tmp_path: Path) -> None:
    file = tmp_path / "stops.csv"
    said = run("--latitude", "47 deg", *GYRO, "--accuracy", "0.1 deg", "-o", file).output
    for words in (
        "minutes for 0.1 deg", "published", "3.9", "continuous, 5 turns",
        "Use palindrome: a linear drift of the gyro does least to it",
        "4.4 minutes give 0.1° (1 sd), 25 to 51 s per stop.",
        "With a rough heading, and two accelerometers or a level case, east-west pair gives",
        "gyro noise", "Tilted by up to 10°", "error by 0.1 deg/h/h of drift", str(file),
    ):  # fmt: skip
        assert words in said
    assert len(file.read_text().splitlines()) == 8


def test_json() -> None:
    words = ("--latitude", "-33 deg", "--gyro-noise", "navigation", "--time", "10 min", *FEW)
    found = json.loads(run(*words, "--json").output)
    assert found["recommended"] == "palindrome" and found["findings"] == []
    row = {r["name"]: r for r in found["orders"]}["published"]
    assert row["time"] == 600.0 and row["time_needed"] is None
    assert sum(row["sources"].values()) == pytest.approx(row["sd"] ** 2, rel=1e-4)
    assert [s["dwell"] for s in row["stops"]] == [142.5] * 4


def test_too_short_and_too_noisy() -> None:
    said = run(
        "--latitude", "47 deg", *GYRO, "--accuracy", "0.05 deg", "--time", "3 min", *FEW
    ).output
    assert "In 3 minutes, 38 s per stop, the heading is good to" in said
    assert "wanted is 0.05 deg" in said and "Use at least" in said and "for each stop" in said
    said = run("--latitude", "80 deg", "--gyro-noise", "mems", "--time", "2 min", *FEW).output
    assert "too noisy by a factor of" in said
    assert "too noisy" not in run("--latitude", "47 deg", *GYRO, "--time", "2 min", *FEW).output


def test_a_floor_is_named() -> None:
    walk = ("--gyro-random-walk", "0.05 deg/h/sqrt(h)")
    words = ("--latitude", "47 deg", *GYRO, *walk, "--accuracy", "0.02 deg", *FEW)
    said = run(*words, "--time", "30 min").output
    assert "not reachable: floor" in said and "from gyro drift" in said
    assert "The accuracy is not reachable" in said


@pytest.mark.thorough
def test_every_setting_counts() -> None:
    def sd(*more: object) -> float:
        words = ("--latitude", "47 deg", *GYRO, "--time", "10 min", "--order", "published", *more)
        return float(json.loads(run(*words, "--json").output)["orders"][0]["sd"])

    plain = sd()
    for more in (
        ("--gyro-bias-instability", "0.05 deg/h"),
        ("--gyro-random-walk", "0.1 deg/h/sqrt(h)"),
        ("--accel-noise", "5 mg/sqrt(Hz)"),
        ("--drift", "1 deg/h/h"),
        ("--drift", "1 deg/h/h", "--drift-ignored"),
        ("--tilt", "20 deg"),
        ("--level-sd", "2 arcmin"),
        ("--index-sd", "1 arcmin"),
        ("--tilt", "20 deg", "--latitude-sd", "1 deg"),
        ("--tilt", "20 deg", "--unknown-latitude"),
        ("--move", "60 s"),
        ("--cycles", 5),
    ):
        assert sd(*more) > 1.0005 * plain, more
    slow = ("--gyro-bias-instability", "0.05 deg/h")
    assert sd(*slow, "--gyro-correlation-time", "5000 s") < sd(*slow)


def test_a_rough_heading_opens_more_orders() -> None:
    words = ("--latitude", "47 deg", *GYRO, "--time", "10 min", "--level-sd", "1 arcsec")
    words = (*words, "--order", "east-west pair", "--order", "published")
    assert "Use published" in run(*words).output
    assert "Use east-west pair" in run(*words, "--rough", "2 deg").output


def test_noise_of_a_campaign(tmp_path: Path) -> None:
    from foucault.campaign.writing import template

    file = tmp_path / "campaign.toml"
    text = template("hand_rotated").split("[noise]")[0] + '\n[noise]\ngrade = "tactical"\n'
    file.write_text(text)
    mine = ("--latitude", "47 deg", "--time", "10 min", *FEW)
    other = run(*mine, "--gyro-noise", "tactical").output
    assert run(*mine, "--noise", file).output == other
    twice = run(*mine, "--noise", file, "--accel-noise", "5 ug/sqrt(Hz)")
    assert twice.exit_code == 1 and "--accel-noise and --noise both say" in twice.stderr


def test_a_calibration_adds_its_uncertainty(tmp_path: Path) -> None:
    for words in (("simulate", "north_seeking", "-o", tmp_path),
                  ("calibrate", tmp_path / "campaign.toml", "-o", tmp_path / "run")):  # fmt: skip
        assert commands.run(*words).exit_code in (0, 3)
    words = ("--latitude", "47 deg", *GYRO, "--time", "10 min", "--order", "published")
    plain = json.loads(run(*words, "--json").output)["orders"][0]
    calibrated = ("--calibration", tmp_path / "run")
    found = json.loads(run(*words, *calibrated, "--json").output)["orders"][0]
    assert found["sd"] > plain["sd"]
    assert found["sources"]["calibration: bias"] > 0 and found["sources"]["scale factor"] > 0
    assert sum(found["sources"].values()) == pytest.approx(found["sd"] ** 2, rel=1e-4)
    file = tmp_path / "run" / "result.json"
    file.write_text(file.read_text().replace('"north_seeking"', '"six_position"', 1))
    other = run(*words, *calibrated)
    assert other.exit_code == 1
    assert "is a result of six_position, not of the calibration" in other.stderr


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--latitude", "89.5 deg", *GYRO, "--time", "9 min"), "89.5000 deg; beyond"),
        (("--latitude", "47", *GYRO, "--time", "9 min"), "--latitude"),
        (("--latitude", "47 deg", "--time", "9 min"), "Nothing says how noisy the gyro is"),
        (("--latitude", "47 deg", "--gyro-noise", "0.01 deg/h", "--time", "9 min"), "deg/h"),
        (
            ("--latitude", "47 deg", "--gyro-noise", "0 deg/sqrt(h)", "--time", "9 min"),
            "needs one above",
        ),
        (("--latitude", "47 deg", *GYRO), "Neither the wanted accuracy nor the time"),
        (
            ("--latitude", "47 deg", *GYRO, "--time", "0 min"),
            "--time: '0 min' is not allowed; it should be greater than 0",
        ),
        (("--latitude", "47 deg", *GYRO, "--accuracy", "0 deg"), "--accuracy: '0 deg'"),
        (("--latitude", "47 deg", *GYRO, "--time", "9 min", "--tilt", "90 deg"), "below 89 deg"),
        (("--latitude", "47 deg", *GYRO, "--time", "9 min", "--order", "star"), "not an order"),
        ((*PLAIN, "--drift-ignored"), "it must be given with --drift"),
        ((*PLAIN, "--latitude-sd", "1 deg", "--unknown-latitude"), "left out with --unknown"),
        ((*PLAIN, "--tilt", "1 deg", "--level-sd", "1 deg"), "--tilt is given; it must be left"),
        (
            (*PLAIN, "--accel-noise", "1 ug/sqrt(Hz)", "--level-sd", "1 deg"),
            "--accel-noise is given",
        ),
        ((*PLAIN, "--gyro-correlation-time", "9 s"), "given with --gyro-bias-instability"),
        ((*PLAIN, "--move", "-1 s"), "--move: '-1 s' is not allowed; it should be 0"),
        ((*PLAIN, "--noise", "campaign.toml"), "Both --gyro-noise and --noise say how"),
    ],
)
def test_refusals(words: tuple[object, ...], said: str) -> None:
    refused = run(*words)
    assert refused.exit_code == 1 and said in refused.stderr


def test_a_refusal_in_json() -> None:
    said = json.loads(run(*PLAIN, "--move", "-1 s", "--json").stdout)
    assert said["error"]["code"] == "campaign.value"
