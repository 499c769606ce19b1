"""The commands of the records: what they print, and how they end."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

import commands
from foucault import campaign, run_folder
from make_records import edit, make_runs


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    make_runs(tmp_path, 3)
    return tmp_path


run = partial(commands.run, "records")


def test_from_runs_to_a_due_list(home: Path) -> None:
    assert "3 taken in, 0 were in already" in run("add", "--below", ".").output
    assert "0 taken in, 3 were in already" in run("add", *home.glob("0042*")).output
    (home / "t.toml").write_text('"accel.bias" = "1 g"\n')
    assert "Entry 4, by ann" in run("tolerance", "0042", "t.toml", "--who", "ann").output
    run("interval", "0042", 12)
    shown = run("show", "0042", "--at", "2026-06-01")
    assert "accel.bias.x" in shown.output and "Due: 2027-03-14" in shown.output
    assert "fit for use" in shown.output and shown.exit_code == 0
    late = run("due", "--at", "2027-03-01", "--within", 30)
    assert "2027-03-14" in late.output and late.exit_code == 3
    none = run("due", "--at", "2026-06-01")
    assert "Nothing is due within 30 days." in none.output and none.exit_code == 0


def test_a_page_of_its_history_is_written(home: Path) -> None:
    run("add", "--below", ".")
    shown = run("show", "0042", "-o", "history")
    assert shown.exit_code in (0, 3) and (home / "history" / "report.html").is_file()
    run("review", 1, "rejected", "--reason", "x")
    run("review", 2, "rejected", "--reason", "x")
    problem = run("show", "0042", "-o", "more")
    assert problem.exit_code == 1 and "a page of its history needs two" in problem.output


def test_every_number_is_there_as_json(home: Path) -> None:
    run("add", "--below", ".")
    said = json.loads(run("show", "0042", "--json").stdout)
    assert said["level"] == "pass" and said["counted"] == [1, 2, 3]
    assert {"name", "value", "sd", "drift", "repeatability"} <= set(said["coefficients"][0])


def test_an_audit_finds_what_was_edited(home: Path) -> None:
    run("add", "--below", ".")
    fine = run("audit")
    assert "All is as it was written." in fine.output and fine.exit_code == 0
    head = fine.output.splitlines()[1].strip()
    assert run("audit", "--since", head).exit_code == 0
    gone = run("audit", "--since", "0" * 64)
    assert gone.exit_code == 4 and "it is not there any more" in gone.output
    edit(home / "0042-2025")
    bad = run("audit")
    assert bad.exit_code == 4 and "run 2, 0042-2025: its result.json is not" in bad.output


def test_what_is_exported_is_read_again(home: Path) -> None:
    run("add", "--below", ".")
    run("event", "0042", "adjusted", "--on", "2026-04-01", "--words", "trimmed")
    run("reference", "g hall", "gravity", "--certificate", "7", "--renew", "2026-05-01")
    assert "certificate of the gravity" in run("due", "--at", "2026-04-20").output
    run("export", "-o", "j.jsonl")
    assert run("export").output == (home / "j.jsonl").read_text()
    made = run("rebuild", "--journal", "j.jsonl", "--database", "other.sqlite")
    assert "The index holds 3 runs." in made.output
    assert "trimmed" in run("show", "0042", "--database", "other.sqlite").output
    (home / "note.txt").write_text("mine")
    assert run("export", "-o", "note.txt").exit_code == 1  # not an earlier export


def test_one_folder_that_is_none_is_said_and_the_rest_goes_on(home: Path) -> None:
    (home / "empty").mkdir()
    result = run("add", "empty", *home.glob("0042*"))
    assert result.exit_code == 3
    assert "3 taken in" in result.output and "1 could not be" in result.output
    assert "There is no run folder in" in run("add", "--below", "empty").output
    (home / "0042-2024").rename(home / "old")
    assert "lies in old" in run("moved", "old").output


def test_a_run_is_calibrated_again_from_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    session = campaign.simulate(campaign.parse(campaign.template("six_position")), 3)
    file = campaign.save_session(session, tmp_path / "session")
    described, folder = campaign.load(file), tmp_path / "run"
    text = campaign.resolved(described, folder)
    run_folder.save(campaign.calibrate(described), folder, text)
    run("add", "run")
    again = run("rerun", "run")
    assert again.exit_code == 0, again.output
    listed = json.loads(run("list", "--json").stdout)["runs"]
    assert listed[1]["again"] == listed[0]["sha256"]
    first, second = (run_folder.load_result(tmp_path / r["folder"]) for r in listed)
    assert (first.coefficients.values == second.coefficients.values).all()
    assert run("rerun", "--older").exit_code == 0  # none is of another version
    log = tmp_path / "session" / "log.csv"
    log.write_text(log.read_text() + "\n")
    other = run("rerun", "run")
    assert other.exit_code == 3 and "is not the one that the run was made from" in other.output
    log.unlink()
    assert "is not there" in run("rerun", "run").output
    run("add", *make_runs(tmp_path, 1, "5"))
    assert "has no campaign.toml" in run("rerun", "3").output


WHERE = ["--database", "lab.sqlite"]
BOB = [*WHERE, "--who", "bob"]


def test_another_database_and_another_name(home: Path) -> None:
    run("reference", "table 3", "table", "--words", "of the hall", *BOB)
    run("add", "0042-2024", "--date", "2024-05-06", "--reference", "table 3", *BOB)
    run("add", "0042-2025", "--instrument", "spare", *BOB)
    (home / "t.toml").write_text('"accel.bias" = "1 g"\n')
    run("tolerance", "0042", "t.toml", *BOB)
    run("interval", "0042", 12, *BOB)
    run("event", "0042", "note", "--on", "2024-06-01", *BOB)
    run("review", 2, "accepted", "--reason", "looked at", *BOB)
    (home / "0042-2025").rename(home / "there")
    run("moved", "there", *BOB)
    assert "has no campaign.toml" in run("rerun", 2, *BOB).output
    listed = run("list", *WHERE).output
    assert "2024-05-06" in listed and "spare" in listed and "there" in listed
    assert "Due: 2025-05-06" in run("show", "0042", *WHERE).output
    assert run("due", *WHERE).exit_code == 3
    assert run("rebuild", *WHERE).exit_code == run("audit", *WHERE).exit_code == 0
    rows = [json.loads(line) for line in run("export", *WHERE).output.splitlines()]
    assert [r["who"] for r in rows] == ["bob"] * 8 and not (home / "records.sqlite").exists()
