"""`foucault apply` and `foucault export`: what they read, print and write, and how they end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault.logs import read
from foucault.logs.description import LogDescription
from foucault.result import Level, Result
from foucault.run_folder import save
from make_terms import SIZES, with_terms

CAMPAIGN = """
[instrument]
serial = "{serial}"
[site]
gravity = "9.80943 m/s^2"
[log]
file = "{file}"
rate = "50 Hz"
gyro = {{ columns = ["-wx", "wy", "wz"], unit = "deg/s" }}
accel = {{ columns = ["fx", "fy", "fz"], unit = "g" }}
[noise]
grade = "mems"
[procedure]
name = "hand_rotated"
"""


@pytest.fixture
def result() -> Result:
    return with_terms(*(f for f in SIZES if f.endswith(("bias", "scale", "misalignment"))))


@pytest.fixture
def truth(tmp_path: Path, result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Write log.csv, in units and signs of its own, and return it compensated."""
    rng = np.random.default_rng(0)
    gyro, accel = rng.normal(0, 20, (200, 3)), rng.normal(0, 0.5, (200, 3))
    table = np.column_stack([-gyro[:, 0], gyro[:, 1:], accel])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="wx,wy,wz,fx,fy,fz",
               comments="", fmt="%.17g")  # fmt: skip
    return result.model.compensate(accel * 9.80665, np.radians(gyro))


def same(path: Path, truth: tuple[Any, Any]) -> None:
    got = read(LogDescription(file=path.name), path.parent)
    np.testing.assert_allclose(got.accel, truth[0], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(got.gyro, truth[1], rtol=1e-13, atol=1e-13)


def test_apply_reads_as_the_result_alone_remembers(
    tmp_path: Path, result: Result, truth: Any
) -> None:
    from foucault import campaign

    (tmp_path / "campaign.toml").write_text(CAMPAIGN.format(serial="", file="log.csv"))
    log = campaign.read_log(campaign.load(tmp_path / "campaign.toml"))
    save(replace(result, provenance={"input": log.source}), tmp_path / "run")
    alone = tmp_path / "alone.json"
    alone.write_bytes((tmp_path / "run" / "result.json").read_bytes())
    (tmp_path / "log.csv").rename(tmp_path / "flight.csv")
    (tmp_path / "campaign.toml").unlink()
    done = run(
        "apply", alone, tmp_path / "flight.csv", "-o", tmp_path / "out.csv", "--json", code=0
    )
    said = json.loads(done.stdout)
    assert (said["samples"], said["verdict"]) == (200, "pass")
    same(tmp_path / "out.csv", truth)


def test_apply_takes_a_campaign_and_checks_the_instrument(
    tmp_path: Path, result: Result, truth: Any
) -> None:
    save(result, tmp_path / "run")
    campaign = tmp_path / "flight.toml"
    campaign.write_text(CAMPAIGN.format(serial="0180-2214", file="log.csv"))
    assert run("apply", tmp_path / "run", campaign, "-o", tmp_path / "out.npz").exit_code == 0
    same(tmp_path / "out.npz", truth)
    campaign.write_text(CAMPAIGN.format(serial="7", file="log.csv"))
    wrong = run("apply", tmp_path / "run", campaign, "-o", tmp_path / "wrong.csv", code=1)
    assert wrong.stderr.splitlines()[0] == (
        "error: The result is for serial number '0180-2214', the log says serial number '7'."
    )
    assert not (tmp_path / "wrong.csv").exists()
    run("apply", tmp_path / "run", campaign, "-o", tmp_path / "wrong.csv", "--force", code=0)


def test_apply_to_a_log_of_our_own_needs_no_description(tmp_path: Path, result: Result) -> None:
    from foucault.logs import write
    from foucault.tables import Log

    save(result, tmp_path / "run", CAMPAIGN.format(serial="", file="first.csv"))
    rng = np.random.default_rng(1)
    log = Log(np.arange(50) / 50, *rng.normal(size=(2, 50, 3)))
    write(log, tmp_path / "own.csv")
    run("apply", tmp_path / "run", tmp_path / "own.csv", "-o", tmp_path / "out.csv", code=0)
    same(tmp_path / "out.csv", (result.apply(log).accel, result.apply(log).gyro))
    twice = run("apply", tmp_path / "run", tmp_path / "out.csv", "-o", tmp_path / "2.csv", code=1)
    assert "is calibrated already" in twice.stderr


def test_apply_tells_what_is_outside_and_what_is_doubtful(tmp_path: Path, truth: Any) -> None:
    doubtful = with_terms("accel.bias", "gyro.bias", level=Level.DOUBTFUL,
                          validity={"accel": [-0.1, 0.1]})  # fmt: skip
    save(doubtful, tmp_path / "run", CAMPAIGN.format(serial="", file="log.csv"))
    done = run("apply", tmp_path / "run", tmp_path / "log.csv", "-o", tmp_path / "out.csv", code=0)
    assert "warning: The specific force is outside -0.1 to 0.1 m/s^2 in " in done.stdout
    assert "There the result is extrapolated." in done.stdout
    assert "The result is doubtful." in done.stdout


@pytest.mark.parametrize("missing", ["log", "result"])
def test_apply_without_what_it_needs(
    missing: str, tmp_path: Path, result: Result, truth: Any
) -> None:
    save(result, tmp_path / "run", CAMPAIGN.format(serial="", file="log.csv"))
    log = tmp_path / ("nope.csv" if missing == "log" else "log.csv")
    folder = tmp_path / ("nope" if missing == "result" else "run")
    done = run("apply", folder, log, "-o", tmp_path / "out.csv", code=1)
    words = {"log": "does not exist", "result": "There is no '"}[missing]
    assert words in done.stderr


def test_a_result_of_another_schema_is_refused_by_both(
    tmp_path: Path, result: Result, truth: Any
) -> None:
    save(result, tmp_path / "run")
    file = tmp_path / "run" / "result.json"
    file.write_text(file.read_text().replace("foucault.result/1", "foucault.result/9"))
    for words in (["apply", file, tmp_path / "log.csv"], ["export", file, "--to", "json"]):
        done = run(*words, "-o", tmp_path / "out.csv", code=1)
        assert "has schema 'foucault.result/9'; this version of foucault reads" in done.stderr
    assert not (tmp_path / "out.csv").exists()


def test_export_writes_for_every_receiver(tmp_path: Path, result: Result) -> None:
    from foucault.export import RECEIVERS

    save(result, tmp_path / "run", CAMPAIGN.format(serial="", file="log.csv"))
    drop = ["--drop", "accel.misalignment", "--drop", "gyro", "--drop", "noise"]
    more = ["--drop", "accel.bias", "--drop", "accel.scale"]
    for receiver in RECEIVERS:
        out = tmp_path / receiver
        words = [*drop, *([] if receiver in ("px4", "ardupilot") else more)]
        done = run(
            "export", tmp_path / "run", "--to", receiver, "-o", out, *words, "--json", code=0
        )
        assert json.loads(done.stdout)["to"] == receiver
        assert "gyro.scale.x = " in out.read_text()
    # The noise that the campaign declares reaches the receiver that wants it.
    assert "accelerometer_noise_density: 0.0011" in (tmp_path / "kalibr").read_text()


def test_export_in_the_axes_of_the_receiver(tmp_path: Path, result: Result) -> None:
    save(result, tmp_path / "run")
    said = []
    for axes in ("right-forward-up", "forward-left-up"):
        out = tmp_path / f"{axes}.py"
        words = ["export", tmp_path / "run", "--to", "python", "-o", out, "--axes", axes]
        assert run(*words).exit_code == 0
        said.append(out.read_text(encoding="utf-8"))
    assert said[0] != said[1]
    assert run(*words[:-1], "up").exit_code == 1


def test_export_refuses_with_the_words_to_go_on(tmp_path: Path, result: Result) -> None:
    save(result, tmp_path / "run")
    out = tmp_path / "px4.params"
    done = run("export", tmp_path / "run", "--to", "px4", "-o", out, code=1)
    first, second = done.stderr.splitlines()
    assert first.startswith("error: px4 cannot express accel.misalignment.yx, ")
    assert "--drop accel.misalignment --drop gyro.scale --drop gyro.misalignment" in second
    assert not out.exists()
    drop = second.partition("by name: ")[2].partition(". The loss")[0].split()
    assert run("export", tmp_path / "run", "--to", "px4", "-o", out, *drop).exit_code == 0


def test_export_of_an_unusable_result_needs_force(tmp_path: Path) -> None:
    save(with_terms("accel.bias", level=Level.UNUSABLE), tmp_path / "run")
    words = ["export", tmp_path / "run", "--to", "c", "-o", tmp_path / "c.h"]
    done = run(*words, code=1)
    assert done.stderr.startswith("error: The result is unusable: 7 rests cannot determine")
    assert "--force" in done.stderr
    forced = run(*words, "--force", code=0)
    assert "The result is unusable." in forced.stdout
    assert "Verdict: unusable" in (tmp_path / "c.h").read_text()
