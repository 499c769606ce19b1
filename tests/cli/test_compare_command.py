"""The command compare: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands import run
from foucault import run_folder
from make_compare import make_results, moved


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    folders = []
    for i, result in enumerate(make_results(4)):
        folders.append(tmp_path / f"{2024 + i}")
        run_folder.save(result if i < 3 else moved(result, gyro__bias__z=25.0), folders[-1])
    return folders


def test_help_says_how_it_ends() -> None:
    said = " ".join(run("compare", "--help").output.split())
    assert "foucault compare 2024/run" in said and "4 out of tolerance" in said


def test_what_did_not_change_passes(runs: list[Path]) -> None:
    result = run("compare", *runs[:3], code=0)
    assert "has not changed by more than chance explains" in result.output
    assert "MTi-28 0180-2214" in result.output
    assert "the change from 2024 to 2026" in result.output
    assert "gyro.misalignment.zy" in result.output and "per year" in result.output


def test_what_changed_is_doubtful_and_its_report_is_made_again(
    runs: list[Path], tmp_path: Path
) -> None:
    result = run("compare", *runs, "-o", tmp_path / "out", code=3)
    assert "gyro.bias.z by" in result.output and "between 2026 and 2027" in result.output
    page = tmp_path / "out" / "report.html"
    first = page.read_text()
    page.unlink()
    assert run("report", tmp_path / "out").exit_code == 0
    assert page.read_text() == first


def test_out_of_tolerance_in_json(runs: list[Path], tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text('"gyro.bias" = { change = "30 deg/h" }\n')
    result = run("compare", *runs, "--tolerance", limits, "--json", "--dates",
                 "2021-01-01,2022-01-01,2023-01-01,2024-01-01", code=4)  # fmt: skip
    said = json.loads(result.stdout)
    assert said["verdict"]["level"] == "fail" and "report" not in said
    worst = [d for d in said["decisions"] if d["decision"] == "fail"]
    assert [d["name"] for d in worst] == ["gyro.bias.z"]
    assert {r["dated"] for r in said["results"]} == {"given"}


def test_several_instruments(runs: list[Path]) -> None:
    for i, folder in enumerate(runs):
        saved = run_folder.load_result(folder)
        saved.instrument["serial"] = f"SN{i}"
        run_folder.save(saved, folder)
    apart = run("compare", *runs, code=0)
    assert "MTi-28 SN0" in apart.output and "MTi-28 SN1" in apart.output
    rows = [line.split() for line in apart.output.splitlines()]
    assert [row[0] for row in rows if row[-1:] == ["yes"]] == ["gyro.bias.z"]
    assert run("compare", *runs, "--same").exit_code == 3


def test_a_mistake_is_one_sentence(runs: list[Path]) -> None:
    result = run("compare", runs[0])
    assert result.exit_code == 1 and "a comparison takes two or more" in result.output
