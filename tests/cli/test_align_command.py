"""The command align: several methods side by side, with their limits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from foucault.cli import app
from foucault.logs import own
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans.manoeuvres import Rest, Rotate, Start
from foucault.simulate.motion import simulate_motion

DPH = np.radians(1) / 3600
HEADING, PITCH, ROLL = np.radians([70.0, 2.0, -3.0])
START = Start(np.radians(47), 0.1, 400.0, HEADING, PITCH, ROLL)
SITE = ("--latitude", "47 deg", "--height", "400 m")
TWO = ("--rest", "0 s to 120 s", "--rest", "141 s to 259 s")
NOISE = ImuNoise(TriadNoise(white=2e-5), TriadNoise(white=3e-8))


def run(*words: object) -> Result:
    result = CliRunner().invoke(app, [str(w) for w in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


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
    result = run("align", log, *SITE, "--until", "120 s", "--gyro-bias-sd", "0.2 deg/h")
    assert result.exit_code == 0
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


def test_without_a_bias_the_sds_are_called_those_of_noise(log: Path) -> None:
    result = run("align", log, *SITE, "--until", "120 s", "--method", "two_vector")
    assert "the sds are of noise alone" in result.output
    assert "Kalman" not in result.output


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--rest", "0 s - 120 s"), "does not say when it starts and when it ends"),
        (("--method", "two_vectors"), "Did you mean 'two_vector'?"),
        (("--rest", "0 s to 900 s", "--rest", "950 s to 990 s"), "the log has"),
        (("--until", "120"), "--until"),
    ],
)
def test_bad_words_are_refused(log: Path, words: tuple[str, ...], text: str) -> None:
    result = CliRunner().invoke(app, ["align", str(log), *SITE, *words])
    assert result.exit_code == 1
    assert text in " ".join(result.stderr.split())


def test_no_latitude(log: Path) -> None:
    result = CliRunner().invoke(app, ["align", str(log)])
    assert result.exit_code == 1
    assert "latitude" in result.stderr


def test_wrong_hemisphere(log: Path) -> None:
    result = CliRunner().invoke(app, ["align", str(log), "--latitude=-47 deg", "--until", "120 s"])
    assert result.exit_code == 1
    assert "the sign is reversed" in " ".join(result.stderr.split())


def test_a_turn_in_the_window_is_doubtful(log: Path) -> None:
    result = run("align", log, *SITE, "--until", "200 s", "--gyro-bias-sd", "0.2 deg/h")
    assert result.exit_code == 3
    assert "the instrument turned by" in " ".join(result.output.split())
