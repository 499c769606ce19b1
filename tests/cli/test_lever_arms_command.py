"""Lever arms and delay by the commands: found, taken away from a log, not found again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import campaign, run_folder
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.size_effect import LAYOUT
from foucault.plans.sequence import navigation_test
from foucault.result import Result
from foucault.simulate.systematic import simulate_systematic
from make_sequence import NOISE

FAR = {"arms": "3 cm", "delay": "2 ms", "rest_time": "30 s"}
SITE = ["--latitude", "48.8462 deg", "--height", "60 m"]


def template() -> str:
    """Return a campaign of the nineteen positions that asks for lever arms and delay."""
    head, mark, tail = campaign.template("systematic").partition("[simulate]")
    for key in ("lever_arms", "delay"):
        head = head.replace(f"\n{key} = false", f"\n{key} = true")
    for key, value in FAR.items():
        lines = tail.splitlines()
        at = next(i for i, line in enumerate(lines) if line.lstrip("# ").startswith(f"{key} ="))
        lines[at] = f'{key} = "{value}"'
        tail = "\n".join(lines)
    return head + mark + tail + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session, its calibration, and its log compensated by it."""
    folder = tmp_path_factory.mktemp("apart")
    (folder / "campaign.toml").write_text(template())
    assert run("simulate", folder / "campaign.toml", "-o", folder / "s").exit_code == 0
    outcome = run("calibrate", folder / "s" / "campaign.toml", "-o", folder / "run", code=0)
    for words in ("accel.lever.xy", "accel.delay", "verdict: pass"):
        assert words in outcome.output
    clean = folder / "s" / "clean.csv"
    assert run("apply", folder / "run", folder / "s" / "log.csv", "-o", clean).exit_code == 0
    text = (folder / "s" / "campaign.toml").read_text()
    (folder / "s" / "again.toml").write_text(text.replace('"log.csv"', '"clean.csv"'))
    return folder


def velocities(result: Result, which: str) -> np.ndarray:
    table = result.tables["velocities"]
    return np.array([table[f"{which}_{way}"] for way in ("east", "north", "up")])


@pytest.mark.thorough
def test_calibrated_applied_and_calibrated_again(folder: Path) -> None:
    found = run_folder.load_result(folder / "run")
    truth = {row["name"]: row["value"] for row in json.loads(
        (folder / "s" / "truth.json").read_text())["coefficients"]}  # fmt: skip
    some = found.coefficients.chosen(LAYOUT.names)
    err = some.values - [truth[name] for name in some.names]
    assert (np.abs(err) < 4 * some.sd).all() and (np.abs(some.values) > 5 * some.sd).all()
    run("calibrate", folder / "s" / "again.toml", "-o", folder / "again", code=0)
    again = run_folder.load_result(folder / "again")
    # The noise is the same, and with it what it made the first calibration miss.
    assert (np.abs(again.coefficients.values) < 0.1 * again.coefficients.sd).all()
    before, sd = velocities(again, "before"), velocities(again, "sd")
    assert (np.abs(before) < 4 * sd).all()
    np.testing.assert_allclose(before, velocities(found, "after"), rtol=0, atol=0.1 * sd.min())
    assert np.sqrt((velocities(found, "before") ** 2).mean()) > 50 * np.sqrt((before**2).mean())


def test_what_is_exported_of_them(folder: Path, tmp_path: Path) -> None:
    for receiver, words in {
        "c": "foucault_compensate_next", "python": "def compensate_next",
        "json": "accel_places", "csv": "accel.lever.xy,",
    }.items():  # fmt: skip
        made = run("export", folder / "run", "--to", receiver, "-o", tmp_path / "out")
        assert made.exit_code == 0 and words in (tmp_path / "out").read_text()
    outcome = run("export", folder / "run", "--to", "imucal", "-o", tmp_path / "out", code=1)
    assert "--drop accel.lever --drop accel.delay" in " ".join(outcome.output.split())
    page = (folder / "run" / "report.html").read_text(encoding="utf-8")
    assert "result.apply(log)" in page and "accel.<wbr>lever" in page


def test_navigation_is_better_by_what_they_are_worth(folder: Path, tmp_path: Path) -> None:
    """The budget predicts what taking them away changes, and a spin shows it."""
    from foucault import write_log

    told = json.loads((folder / "s" / "truth.json").read_text())
    found = run_folder.load_result(folder / "run")
    site = Site.at(np.radians(48.8462), 60.0)
    assert isinstance(found.model, ImuModel)
    made = simulate_systematic(
        navigation_test("north", before=100.0, rest=100.0), site=site, model=found.model,
        noise=NOISE, rate=50.0, arms=np.array(told["arms"]), delay=told["delay"], seed=3,
    )  # fmt: skip
    write_log(made.log, tmp_path / "spin.csv")
    outcome = run("navigate", tmp_path / "spin.csv", *SITE, "--calibration", folder / "run",
                  "--serial", "0001", "--json")  # fmt: skip
    doc = json.loads(outcome.stdout)
    worth = {row["name"]: row["worth"] for row in doc["contributions"]}
    assert abs(worth["accel.delay"]["east"]) > 30.0
    total = np.sum([[row["east"], row["north"]] for row in worth.values()], axis=0)
    np.testing.assert_allclose(doc["difference"], total, rtol=5e-3, atol=0.5)
