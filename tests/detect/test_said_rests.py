"""Rests that somebody has said: they take the place of those that are found, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault.detect.stretches import find_rests
from foucault.errors import FoucaultError
from foucault.logs.description import LogDescription
from foucault.tables import Log
from make_bare import Columns, phyphox, truth


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log of sixteen rests, and the result of those that are found."""
    folder = tmp_path_factory.mktemp("said")
    (folder / "drive.csv").write_text(phyphox(Columns.of(truth(1))))
    run("calibrate", folder / "drive.csv", "-o", folder / "found")
    return folder


def result(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


def spans(home: Path) -> list[tuple[float, float]]:
    """Return the rests of `home` as inspect says them, from the start [s]."""
    seen = run("--json", "inspect", home / "drive.csv")
    rows = json.loads(seen.stdout)["rests"]
    return [r for r, turns in zip(zip(rows["start"], rows["end"], strict=True), rows["turning"],
                                  strict=True) if not turns]  # fmt: skip


def said(rests: list[tuple[float, float]]) -> str:
    return "rests = " + json.dumps([f"{a:.6f}-{b:.6f} s" for a, b in rests])


def test_the_rests_that_are_found_said_again_give_the_same(home: Path) -> None:
    again = run("calibrate", home / "drive.csv", "--set", said(spans(home)), "-o", home / "same")
    one, other = (result(home / k) for k in ("found", "same"))
    values = [{c["name"]: (c["value"], c["sd"]) for c in r["coefficients"]} for r in (one, other)]
    assert values[0] == values[1]
    told = {f["code"] for f in other["findings"]}
    assert "rest.said" in told and "16 rests are those of [log] rests" in again.stdout


def test_a_rest_that_is_taken_out_is_not_used(home: Path) -> None:
    kept = spans(home)[:-1]
    run("calibrate", home / "drive.csv", "--set", said(kept), "-o", home / "fewer")
    assert result(home / "fewer")["diagnostics"]["detection"]["rests"] == len(kept)
    campaign = (home / "fewer" / "campaign.toml").read_text()
    assert "rests" in campaign
    run("calibrate", home / "fewer" / "campaign.toml", "-o", home / "again")
    one, other = (result(home / k) for k in ("fewer", "again"))
    assert one["coefficients"] == other["coefficients"]


def test_rests_keep_to_their_samples() -> None:
    """First and last sample belong to the rest, in the whole log as in a part of it."""
    rng = np.random.default_rng(1)
    time = 100.0 + np.arange(1000) * 0.01
    log = Log(time, rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3)) + 9.8,
              rests=((100.5, 101.0), (104.0, 106.0)))  # fmt: skip
    assert find_rests(log).spans == [(50, 101), (400, 601)]
    assert find_rests(log[200:700]).spans == [(200, 401)]
    moved, start = log.from_start()
    assert start == 100.0 and find_rests(moved).spans == [(50, 101), (400, 601)]


@pytest.mark.parametrize("given", [
    ["3-1 s"], ["0-2 s", "1-3 s"], ["0-2"], ["a-b s"], ["0-2 kg"], [], "x", [[1.0]], [["1 s", "2"]],
    ["0-1e999 s"], [5],
])  # fmt: skip
def test_rests_that_cannot_be_are_refused(given: object) -> None:
    with pytest.raises(FoucaultError, match=r"\[log\] rests holds"):
        LogDescription.model_validate({"file": "x.csv", "rests": given})


def test_a_rest_beyond_the_log_is_refused(home: Path) -> None:
    wrong = run("calibrate", home / "drive.csv", "--set", said([(1.0, 2.0), (9000.0, 9001.0)]),
                "-o", home / "no", code=1)  # fmt: skip
    assert "[log] rests holds 9000-9001 s, and the log ends" in wrong.stderr


def test_a_procedure_without_rests_refuses_them() -> None:
    """In memory as on the disk: what a file says must not be passed over in silence."""
    from foucault.logs.follow import OnDisk
    from foucault.models.earth import Site
    from foucault.procedures import load

    said = LogDescription.model_validate({"file": "x.csv", "rests": ["0-1 s"]})
    flat = Log(np.arange(9.0), None, np.ones((9, 3)), rests=((0.0, 1.0),))
    for log in (flat, OnDisk(said, Path())):
        with pytest.raises(FoucaultError, match="turntable does not go by rests"):
            load("turntable").calibrate(log, site=Site(9.81, 0.0))
