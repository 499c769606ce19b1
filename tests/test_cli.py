"""The command line: what it prints, what it writes, how it ends."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault import campaign, procedures
from foucault.cli import screen
from foucault.logs import read
from foucault.logs.description import LogDescription
from foucault.procedures.record import Procedure
from foucault.result import Level
from foucault.run_folder import load_result
from foucault.symptoms import SYMPTOMS
from make_result import make_result

COMMANDS = [
    "init",
    "inspect",
    "simulate",
    "calibrate",
    "apply",
    "export",
    "report",
    "demo",
    "schema",
    "messages",
]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated session, written once."""
    folder = tmp_path_factory.mktemp("session")
    read = campaign.parse(campaign.template("hand_rotated"))
    return campaign.save_session(campaign.simulate(read), folder)


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Any], None]]:
    """Let the procedure give this result, or raise this, without estimating anything."""

    def give(what: Any) -> None:
        def calibrate(procedure: Any, log: Any, **_: Any) -> Any:
            if isinstance(what, BaseException):
                raise what
            return what

        monkeypatch.setattr(Procedure, "calibrate", calibrate)

    yield give


def test_help_lists_every_command_and_exit_code() -> None:
    out = run("--help").output
    for word in (*COMMANDS, "--quiet", "--json", "Exit codes:", "130 interrupted"):
        assert word in re.sub(r"\s+", " ", out)
    assert run().exit_code == 2


def test_wrong_usage_ends_with_2() -> None:
    for words in (["calibrat"], ["calibrate"], ["calibrate", "x", "--nope"], ["simulate", "x"]):
        result = run(*words, code=2)
        assert "Usage" in result.stderr


def test_version() -> None:
    from foucault import __version__

    assert run("--version").output == f"foucault {__version__}\n"


def test_init_writes_a_template_and_keeps_what_is_there(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    run("init", "hand_rotated", "-o", file, code=0)
    assert file.read_text() == campaign.template("hand_rotated")
    assert run("init", "hand_rotated").output == campaign.template("hand_rotated")
    file.write_text("mine")
    result = run("init", "hand_rotated", "-o", file, code=1)
    assert "exists already and may hold your work." in result.stderr
    assert file.read_text() == "mine"


def test_a_mistake_is_two_sentences_without_a_traceback(tmp_path: Path) -> None:
    result = run("calibrate", tmp_path / "nope.toml", "-o", tmp_path / "run", code=1)
    assert result.stdout == ""
    first, second = result.stderr.splitlines()
    assert first.startswith("error: Campaign file ")
    assert first.endswith("does not exist.")
    assert second.startswith("  Give the path of a campaign file; ")
    assert not (tmp_path / "run").exists()


def test_a_mistake_in_json(tmp_path: Path) -> None:
    result = run("init", "hand_rotatde", "--json", code=1)
    said = json.loads(result.stdout)["error"]
    assert said["code"] == "campaign.procedure"
    assert said["message"] == "Procedure 'hand_rotatde' is not known. Did you mean 'hand_rotated'?"
    assert said["cure"] == f"Known procedures are: {', '.join(procedures.PROCEDURES)}."


def test_schemas_are_json() -> None:
    assert json.loads(run("schema").stdout) == json.loads(json.dumps(campaign.schema()))
    assert json.loads(run("schema", "--result").stdout)["title"]


def test_messages_print_every_symptom() -> None:
    out = run("messages").stdout
    rows = [line for line in out.splitlines() if line.startswith("| ")]
    assert len(rows) == len(SYMPTOMS) + 1
    for row in SYMPTOMS.values():
        assert f"`{row.code}`" in out
    listed = json.loads(run("--json", "messages").stdout)
    assert [row["code"] for row in listed] == list(SYMPTOMS)


def test_simulate_writes_what_a_user_would_have(tmp_path: Path) -> None:
    run("simulate", "hand_rotated", "-o", tmp_path / "s", "--seed", 7, code=0)
    assert sorted(p.name for p in (tmp_path / "s").iterdir()) == [
        "campaign.toml",
        "log.csv",
        "truth.json",
    ]
    assert tomllib.loads((tmp_path / "s" / "campaign.toml").read_text())["simulate"]["seed"] == 7
    assert json.loads((tmp_path / "s" / "truth.json").read_text())["seed"] == 7
    again = run("simulate", tmp_path / "s" / "campaign.toml", "-o", tmp_path / "t", "--json")
    assert json.loads(again.stdout)["campaign"] == str(tmp_path / "t" / "campaign.toml")
    for name in ("log.csv", "truth.json", "campaign.toml"):
        assert (tmp_path / "s" / name).read_bytes() == (tmp_path / "t" / name).read_bytes()


def test_inspect_shows_rates_rests_and_findings(session: Path, tmp_path: Path) -> None:
    truth = json.loads((session.parent / "truth.json").read_text())
    found = len(truth["rests"]["first"])
    out = run("inspect", session).stdout
    assert "100 Hz" in out
    assert f"rests found: {found} " in out
    assert len(out.splitlines()) <= 40 and "+z (" not in out
    (bar,) = re.findall(r"^\[([#=.]+)\]$", out, flags=re.M)
    still = (
        sum(truth["rests"]["last"][k] - truth["rests"]["first"][k] for k in range(found))
        / json.loads(run("inspect", session, "--json").stdout)["samples"]
    )
    assert bar.count("#") / len(bar) == pytest.approx(still, abs=0.12)
    assert "+z (" in run("inspect", session, "--all").stdout
    same = json.loads(run("inspect", session.parent / "log.csv", "--json").stdout)
    assert same["rate"] == pytest.approx(100.0)
    assert same["gaps"] == 0
    assert len(same["rests"]["first"]) == found
    overlap = np.minimum(same["rests"]["last"], truth["rests"]["last"]) - np.maximum(
        same["rests"]["first"], truth["rests"]["first"]
    )
    assert (overlap > 0).all()
    plots = tmp_path / "quick.html"
    assert run("inspect", session, "--plots", plots, "--quiet").stdout == ""
    page = plots.read_text()
    assert "rests found" in page
    assert "Specific force" in page
    assert not re.search(r"<(script|link|img)[^>]* (src|href)=", page)


def test_inspect_reads_the_units_that_titles_give(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    n = 3000
    time = 1717171717.25 + np.arange(n) / 100
    table = np.column_stack([time, rng.normal(0, 0.1, (n, 3)), rng.normal(0, 0.002, (n, 3))])
    table[:, 6] += 1.0
    titles = "t (s),wx (deg/s),wy (deg/s),wz (deg/s),ax (g),ay (g),az (g)"
    np.savetxt(tmp_path / "log.csv", np.delete(table, slice(1000, 1003), axis=0), "%.9f", ",",
               header=titles, comments="")  # fmt: skip
    out = run("inspect", tmp_path / "log.csv").stdout
    assert "accelerometers  ax (g), ay (g), az (g) [g]  (sure: titles; unit: title)" in out
    assert "gyros           wx (deg/s), wy (deg/s), wz (deg/s) [deg/s]" in out
    assert "10 ms to 40 ms" in out
    assert "The longest is 40 ms, 9.99 s from the start" in out
    assert out.count("17171717") == 1, "the time of day is said once, and all else from there"
    same = json.loads(run("inspect", tmp_path / "log.csv", "--json").stdout)
    assert same["start"] == 1717171717.25
    assert same["rests"]["start"][0] == pytest.approx(0.0, abs=1.0)


def test_inspect_of_a_slow_log_writes_plain_numbers(tmp_path: Path) -> None:
    n = 400
    table = np.zeros((n, 4))
    table[:, 0] = 10.0 * np.arange(n)  # ms, called s
    table[:, 1:] = np.random.default_rng(3).normal([0, 0, 9.81], 0.01, (n, 3))
    titles = "t (s),ax (m/s^2),ay (m/s^2),az (m/s^2)"
    np.savetxt(tmp_path / "log.csv", table, "%.9f", ",", header=titles, comments="")
    out = run("inspect", tmp_path / "log.csv").stdout
    assert "10 s to 10 s" in out
    assert 'write unit = "ms" in [log.time], which gives 100 Hz' in out


def test_inspect_of_an_undescribed_log_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,ax,ay,az\n0,0,0,9.8\n0.01,0,0,9.8\n")
    result = run("inspect", tmp_path / "log.csv", code=1)
    assert result.stderr.startswith("error: ")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("level", "code"), [(Level.PASS, 0), (Level.DOUBTFUL, 3), (Level.UNUSABLE, 4)]
)
def test_the_verdict_is_the_exit_code(
    session: Path, tmp_path: Path, answer: Callable[[Any], None], level: Level, code: int
) -> None:
    answer(make_result(level=level))
    result = run("calibrate", session, "-o", tmp_path / "run", code=code)
    assert f"verdict: {level}" in result.stdout
    assert (tmp_path / "run" / "report.html").is_file()
    assert load_result(tmp_path / "run").verdict.level == level
    quiet = run("--quiet", "calibrate", session, "-o", tmp_path / "run")
    assert (quiet.exit_code, quiet.output) == (code, "")
    said = json.loads(run("calibrate", session, "-o", tmp_path / "run", "--json").stdout)
    assert said["result"]["verdict"]["level"] == level
    assert said["report"] == str(tmp_path / "run" / "report.html")


@pytest.mark.parametrize(("problem", "code"), [(KeyboardInterrupt(), 130), (ValueError("x"), 70)])
def test_a_run_that_ends_badly_leaves_the_result_before(
    session: Path,
    tmp_path: Path,
    answer: Callable[[Any], None],
    problem: BaseException,
    code: int,
) -> None:
    answer(make_result(seed=1))
    assert run("calibrate", session, "-o", tmp_path / "run").exit_code == 0
    before = {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    answer(problem)
    result = run("calibrate", session, "-o", tmp_path / "run", code=code)
    assert {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()} == before
    if code == 130:
        assert result.stderr == "interrupted: a result that was there before is intact\n"
    else:
        assert "This is a fault in foucault" in result.stderr


def test_an_interrupted_study_says_how_it_goes_on(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screen, "INTERRUPTED", threading.Event())
    screen.INTERRUPTED.set()
    result = run("montecarlo", session, "-n", 2, "--workers", 1, "-o", tmp_path / "mc", code=130)
    said = "interrupted: what was done is kept, and the same command goes on from there\n"
    assert result.stderr.endswith(said)


@pytest.mark.parametrize("early", ["_prepare", "app"])
def test_an_interrupt_before_anybody_listens_is_no_traceback(
    early: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    program = sys.modules["foucault.cli.app"]
    monkeypatch.setattr(program, "_prepare", lambda: None)
    monkeypatch.setattr(program, early, interrupted)
    with pytest.raises(SystemExit) as caught:
        program.main()
    assert caught.value.code == 130


@pytest.mark.parametrize("words", [["-o", ""], ["--output", ""], ["--output="]])
def test_an_empty_name_of_an_output_is_refused(
    session: Path, tmp_path: Path, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "as a variable that is not set is" in run("calibrate", session, *words, code=2).output
    assert not list(tmp_path.iterdir())


def test_a_link_to_nowhere_is_no_folder(session: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    said = run("calibrate", session, "-o", tmp_path / "link", code=1).output
    assert "link' is not a folder that can be written to" in re.sub(r"\s+", " ", said)


def test_an_interrupt_that_a_library_swallowed_still_ends_the_run(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screen, "INTERRUPTED", threading.Event())
    screen.INTERRUPTED.set()
    run("calibrate", session, "-o", tmp_path / "run", code=130)
    assert not (tmp_path / "run").exists()


def test_a_campaign_in_the_run_folder_is_left_as_it_is(
    tmp_path: Path, answer: Callable[[Any], None]
) -> None:
    answer(make_result())
    run("simulate", "hand_rotated", "-o", tmp_path)
    before = (tmp_path / "campaign.toml").read_bytes()
    assert run("calibrate", tmp_path / "campaign.toml", "-o", tmp_path).exit_code == 0
    assert (tmp_path / "campaign.toml").read_bytes() == before
    assert (tmp_path / "log.csv").is_file()
    assert run("calibrate", tmp_path / "campaign.toml", "-o", tmp_path / "run").exit_code == 0
    kept = (tmp_path / "run" / "campaign.toml").read_text()
    assert campaign.parse(kept, tmp_path / "run" / "campaign.toml").log.file == "../log.csv"


@pytest.mark.parametrize(
    "words",
    [("calibrate", "campaign.toml"), ("fleet", "campaign.toml"), ("merge", "a", "b"),
     ("temperature", "a", "b"), ("montecarlo", "hand_rotated"), ("optimise", "platform_tumble")],
)  # fmt: skip
def test_a_folder_of_another_kind_is_refused_before_the_work(
    words: tuple[str, ...], session: Path, tmp_path: Path, answer: Callable[[Any], None]
) -> None:
    answer(AssertionError("no work is to be done"))
    (tmp_path / "north.json").write_text("{}")
    given = [session if word == "campaign.toml" else word for word in words]
    result = run(*given, "-o", tmp_path, code=1)
    assert f"'{tmp_path}' already holds north.json, of another kind of run." in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["north.json"]


def test_unwritable_output_is_one_clear_error(
    session: Path, tmp_path: Path, answer: Callable[[Any], None]
) -> None:
    answer(make_result())
    (tmp_path / "file").write_text("in the way")
    result = run("calibrate", session, "-o", tmp_path / "file", code=1)
    assert result.stderr.startswith("error: ")
    assert (tmp_path / "file").read_text() == "in the way"
    result = run("simulate", "hand_rotated", "-o", tmp_path / "file", code=1)
    assert result.stderr.startswith("error: ")


def test_report_is_rebuilt_from_the_folder(
    session: Path, tmp_path: Path, answer: Callable[[Any], None]
) -> None:
    answer(make_result())
    run("calibrate", session, "-o", tmp_path / "run")
    page = (tmp_path / "run" / "report.html").read_bytes()
    (tmp_path / "run" / "report.html").unlink()
    assert run("report", tmp_path / "run").exit_code == 0
    assert (tmp_path / "run" / "report.html").read_bytes() == page
    assert run("report", tmp_path / "nothing").exit_code == 1


def test_apply_reads_a_log_as_the_calibrated_one_was_read(
    tmp_path: Path, answer: Callable[[Any], None]
) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(200) / 50.0
    gyro, accel = rng.normal(0, 20, (200, 3)), rng.normal(0, 1, (200, 3))
    table = np.column_stack([t, -gyro[:, 0], gyro[:, 1:], accel])
    header = "t,wx,wy,wz,fx,fy,fz"
    for name in ("first.csv", "second.csv"):
        np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="", fmt="%.17g")
    (tmp_path / "campaign.toml").write_text(
        """
[site]
gravity = "9.80943 m/s^2"
[log]
file = "first.csv"
time = { column = "t", unit = "s" }
gyro = { columns = ["-wx", "wy", "wz"], unit = "deg/s" }
accel = { columns = ["fx", "fy", "fz"], unit = "g" }
[procedure]
name = "hand_rotated"
"""
    )
    result = make_result()
    answer(result)
    code = run("calibrate", tmp_path / "campaign.toml", "-o", tmp_path / "run").exit_code
    assert code == 0
    f_b, w_b = result.model.compensate(accel * 9.80665, np.radians(gyro))
    for log in ("second.csv", "campaign.toml"):
        out = tmp_path / "out.parquet"
        run("apply", tmp_path / "run", tmp_path / log, "-o", out, code=0)
        got = read(LogDescription(file="out.parquet"), tmp_path)
        np.testing.assert_allclose(got.accel, f_b, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(got.gyro, w_b, rtol=1e-13, atol=1e-13)
        out.unlink()
    said = json.loads(
        run("apply", tmp_path / "run" / "result.json", tmp_path / "second.csv",
            "-o", tmp_path / "o.csv", "--json").stdout
    )  # fmt: skip
    assert said["samples"] == 200
    run("apply", tmp_path / "run", tmp_path / "second.csv", "-o", tmp_path / "o.docx", code=1)
    run("apply", tmp_path / "run", tmp_path / "third.csv", "-o", tmp_path / "o.csv", code=1)


@pytest.mark.thorough
def test_demo_prints_the_result_beside_the_truth(tmp_path: Path) -> None:
    result = run("demo", "-o", tmp_path, "--json", code=0)
    said = json.loads(result.stdout)
    assert said["result"]["verdict"]["level"] == "pass"
    assert (tmp_path / "run" / "report.html").is_file()
    assert (tmp_path / "session" / "truth.json").is_file()
    ratios = np.array([float(row["error_over_sd"]) for row in said["truth"]])
    # Each ratio is about standard normal: beyond 4.5 once in 1e5, so never in a fixed session.
    assert np.abs(ratios).max() < 4.5
    out = run("demo", "-o", tmp_path).stdout
    assert "error/sd" in out
    for row in said["truth"]:
        assert row["coefficient"] in out


@pytest.mark.thorough
def test_demo_with_another_seed(tmp_path: Path) -> None:
    for seed in (5, 6):
        assert run("demo", "-o", tmp_path / str(seed), "--seed", seed, "--quiet").exit_code in (
            0,
            3,
        )
    logs = [(tmp_path / s / "session" / "log.csv").read_bytes() for s in "56"]
    assert logs[0] != logs[1]
    assert "seed = 5" in (tmp_path / "5" / "session" / "campaign.toml").read_text()


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_shows_on_a_terminal_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(screen, "PATIENCE", 0.0)
    monkeypatch.setenv("TERM", "xterm")

    def shown(stream: io.StringIO, wait: float = 0.0, **options: bool) -> str:
        monkeypatch.setattr(sys, "stderr", stream)
        with screen.Screen(**options).progress() as tell:
            tell(0.5, "thinking hard")
            end = time.monotonic() + wait
            while "thinking hard" not in stream.getvalue() and time.monotonic() < end:
                time.sleep(0.01)
        return stream.getvalue()

    assert "thinking hard" in shown(_Terminal(), wait=10.0)
    assert shown(io.StringIO()) == ""
    assert shown(_Terminal(), quiet=True) == ""
    assert shown(_Terminal(), json=True) == ""
    monkeypatch.setattr(screen, "PATIENCE", 60.0)
    assert "thinking" not in shown(_Terminal())


@pytest.mark.thorough
def test_output_in_an_encoding_that_lacks_its_signs(tmp_path: Path) -> None:
    """As Windows redirects it: nothing fails, and JSON keeps every sign."""
    folder = tmp_path / "Müller"
    env = dict(os.environ) | {"PYTHONIOENCODING": "ascii"}
    run = [sys.executable, "-m", "foucault", "simulate", "rate_table", "-o", folder]
    said = subprocess.run(run, capture_output=True, text=True, env=env, check=True).stdout
    assert "M?ller" in said
    told = subprocess.run([*run, "--json"], capture_output=True, text=True, env=env, check=True)
    assert json.loads(told.stdout)["folder"] == str(folder)


@pytest.mark.thorough
def test_the_installed_program(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("foucault")
    done = subprocess.run(
        [program, "calibrate", "nope.toml", "-o", "run"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=dict(os.environ),
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "Campaign file 'nope.toml' does not exist." in done.stderr


def test_of_a_long_table_the_worst_rows_stay_under_their_headings() -> None:
    rows = [["first"], *([f"a{i}", "good"] for i in range(6)), ["second"], ["b0", "warning"],
            *([f"c{i}", "good"] for i in range(3)), ["third"], ["d0", "bad"]]  # fmt: skip
    lines = [["", *row] if len(row) == 1 else [row[0], screen.STATES[row[1]][0]] for row in rows]
    shown = [rows[i][0] for i in screen._worst(rows, lines, 4)]
    assert shown == ["first", "a0", "a1", "second", "b0", "third", "d0"]
    assert screen._worst(rows, lines, None) == [*range(len(rows))] == screen._worst(rows, lines, 14)
