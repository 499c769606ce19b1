"""The command watch: what it shows, how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import commands
from foucault import campaign
from foucault.cli import watch as command
from foucault.cli.watch import picture, summary
from foucault.detect.live import LiveRests
from foucault.diagnose.live import Checklist, LiveRest, checklist
from foucault.errors import finding

run = partial(commands.run, "watch")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated session with its campaign, written once."""
    out = tmp_path_factory.mktemp("session")
    read = campaign.parse(campaign.template("hand_rotated"))
    campaign.save_session(campaign.simulate(read), out)
    return out


@pytest.fixture(scope="module")
def text(folder: Path) -> bytes:
    return (folder / "log.csv").read_bytes()


@pytest.fixture
def busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look more often than people need."""
    monkeypatch.setattr(command, "PAUSE", 0.005)


def part(text: bytes, lines: int) -> bytes:
    return b"".join(text.splitlines(keepends=True)[:lines])


def test_help_has_examples_and_exit_codes() -> None:
    out = run("--help").output
    assert "foucault watch" in out.partition("Example")[2]
    assert "enough rests on all sides" in " ".join(out.split())


def test_a_whole_session_on_standard_input_is_enough(text: bytes, folder: Path) -> None:
    for words in (["--stdin"], [folder / "campaign.toml", "--stdin"]):
        result = run(*words, given=text)
        assert result.exit_code == 0
        lines = result.output.splitlines()
        assert lines[0] == "following standard input, 100 Hz"
        assert "rest 1: +z up, from 0.2 s" in lines
        assert sum(line.startswith("rest ") for line in lines) == 24
        assert lines[-1].startswith("24 rests in 24 orientations over 148.")
        assert lines[-1].endswith("s: enough, on all sides.")


def test_part_of_a_session_is_not_enough(text: bytes) -> None:
    result = run("--stdin", given=part(text, 3000))
    assert result.exit_code == 3
    last = result.output.splitlines()[-1]
    assert last.startswith("4 rests in 4 orientations over 30.0 s: not enough, 12 orientations")
    assert "Next: between " in last
    assert last.endswith("and 3 more.")


def test_how_long_to_hold_is_asked_for(text: bytes) -> None:
    def more(*words: str) -> float:
        lines = run("--json", "--stdin", *words, given=text).output.splitlines()
        return float(json.loads(lines[-1])["hold"])

    assert more("--hold", "60 s") - more("--hold", "20 s") == pytest.approx(40.0)
    result = run("--stdin", "--hold", "3", given=text)
    assert result.exit_code == 1
    assert "--hold" in result.stderr


def test_it_ends_when_there_is_enough(folder: Path, busy: None) -> None:
    result = run(folder / "campaign.toml", "--until-complete")
    assert result.exit_code == 0
    assert "enough, on all sides" in result.output


@dataclass
class Clock:
    """Time that passes only between two looks; so much of the recording goes on meanwhile."""

    recording: Iterator[None]
    now: float = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        next(self.recording, None)


def test_a_file_that_grows(text: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "session.csv"
    lines = text.splitlines(keepends=True)

    def record() -> Iterator[None]:
        yield
        with path.open("wb") as stream:
            for start in range(0, len(lines), 333):
                stream.write(b"".join(lines[start : start + 333])[:-3])
                stream.flush()
                yield
                stream.write(b"".join(lines[start : start + 333])[-3:])

    monkeypatch.setattr(command, "clock", Clock(record()))
    result = run(path, "--timeout", "1.5 s")
    assert result.exit_code == 0
    assert result.output.startswith("waiting for session.csv to appear\nfollowing session.csv")
    assert sum(line.startswith("rest ") for line in result.output.splitlines()) == 24


def test_a_file_that_shrinks_begins_anew(
    text: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "session.csv"
    path.write_bytes(part(text, 8000))

    def restart() -> Iterator[None]:
        yield
        path.write_bytes(part(text, 3000))
        yield

    monkeypatch.setattr(command, "clock", Clock(restart()))
    result = run(path, "--timeout", "1.5 s")
    assert result.exit_code == 3
    assert "note: 'session.csv' was written anew." in result.output
    assert "4 rests in 4 orientations over 30.0 s: not enough" in result.output


def test_a_file_that_never_comes(tmp_path: Path, busy: None) -> None:
    result = run(tmp_path / "none.csv", "--timeout", "0.1 s")
    assert result.exit_code == 1
    assert "No sample came from 'none.csv' within 0.1 s: the file does not exist." in result.stderr
    (tmp_path / "none.csv").write_text("time,gyro_x\n")
    result = run(tmp_path / "none.csv", "--timeout", "0.1 s")
    assert "it has no line of data yet" in result.stderr


def test_mistakes_are_one_sentence(tmp_path: Path, text: bytes) -> None:
    result = run()
    assert result.exit_code == 1
    assert "Neither a log or campaign file nor --stdin was given." in result.stderr
    result = run("--stdin", given=b"")
    assert result.exit_code == 1
    assert "'standard input' has no samples." in result.stderr
    result = run("--stdin", given=b"t,a,b,c\n" + b"1,2,3,4\n" * 5)
    assert result.exit_code == 1
    assert "'standard input' has t, a, b, c" in result.stderr
    result = run("--stdin", given=part(text, 500) + part(text, 500))
    assert result.exit_code == 1
    assert "Time runs backward at row 498" in result.stderr


def test_json_lines(text: bytes) -> None:
    result = run("--json", "--stdin", given=text)
    documents = [json.loads(line) for line in result.output.splitlines()]
    assert [d["event"] for d in documents][-1] == "end"
    assert {d["event"] for d in documents[:-1]} == {"state"}
    last = documents[-1]
    assert last["complete"] is True
    assert len(last["rests"]) == 24
    assert last["rests"][0]["up"] == "+z up"
    assert last["missing"] == []
    assert last["rate"] == pytest.approx(100)
    early = json.loads(run("--json", "--stdin", given=part(text, 3000)).output.splitlines()[-1])
    assert early["complete"] is False
    assert early["missing"]


def test_quiet_says_nothing(text: bytes) -> None:
    result = run("--quiet", "--stdin", given=part(text, 3000))
    assert (result.exit_code, result.output) == (3, "")


def test_settings_of_the_campaign_count(folder: Path, text: bytes, tmp_path: Path) -> None:
    words = (folder / "campaign.toml").read_text()
    assert 'shortest = "1 s"' in words
    file = tmp_path / "campaign.toml"
    file.write_text(words.replace('shortest = "1 s"', 'shortest = "60 s"'))
    result = run(file, "--stdin", given=text)
    assert result.exit_code == 3
    assert "0 rests in 0 orientations" in result.output


def test_wrong_units_are_said(folder: Path, tmp_path: Path, text: bytes) -> None:
    words = (folder / "campaign.toml").read_text().replace('unit = "m/s^2"', 'unit = "g"')
    file = tmp_path / "campaign.toml"
    file.write_text(words)
    result = run(file, "--stdin", given=part(text, 1000))
    assert "warning: The median specific force is 9" in result.output
    assert 'The unit is probably wrong; in [log.accel] write unit = "m/s^2"' in result.output


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent otherwise there")
def test_ctrl_c_ends_with_the_summary(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "session.csv"
    path.write_bytes(part(text, 3000))
    process = subprocess.Popen(
        [sys.executable, "-m", "foucault", "watch", str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    seen = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=30)
    assert seen == "following session.csv, 100 Hz\n"
    assert "4 rests in 4 orientations over 30.0 s: not enough" in rest
    assert process.returncode == 3


# -- the picture -------------------------------------------------------------------------------


def drawn(seen: Checklist | None, silent: float = 0.0, missing: bool = False) -> str:
    console = Console(record=True, width=100, file=open(os.devnull, "w"))  # noqa: SIM115, PTH123
    with console.file:
        console.print(picture("session.csv", seen, silent, missing))
    return console.export_text()


def state(**more: Any) -> Checklist:
    named = {"visited": (("+z up", True), ("-z up", False), ("between +x and -y up", True))}
    rest = LiveRest(0.2, 4.1, "+z up")
    values = {"samples": 9500, "duration": 95.0, "rate": 100.0, "still": True, "still_for": 2.1,
              "hold": 1.5, "rests": (rest,), "orientations": 1, "needed": 12,
              "missing": ("-z up", "+x up", "-x up", "+y up")}  # fmt: skip
    return Checklist(**(values | named | more))


def test_picture_before_anything() -> None:
    assert "waiting for session.csv to appear" in drawn(None, missing=True)
    assert "waiting for the first samples" in drawn(None)


def test_picture_while_capturing() -> None:
    out = drawn(state())
    assert "1:35 min at 100 Hz" in out
    assert "at rest for 2.1 s: hold still 1.5 s more" in out
    assert "1 in 1 orientation; 12 are enough" in out
    assert "+z✓ -z " in out
    assert "+x-y✓" in out
    assert "-z up; +x up; -x up; and 1 more" in out
    assert "good, turn it to the next orientation" in drawn(state(hold=0.0))
    assert "moving: put it down" in drawn(state(still=False))
    assert "learning what quiet is" in drawn(state(still=None))
    assert "no new samples for 7 s" in drawn(state(), silent=7.4)


def test_picture_of_warnings_and_of_the_end() -> None:
    told = finding("watch.not_quiet", accel="0.5", gyro="9")
    out = drawn(state(findings=(told,)))
    assert "warning" in out
    assert "still shakes by 0.5 m/s^2" in out
    done = state(orientations=12, missing=())
    assert "enough on all sides; more make the result better" in drawn(done)
    assert summary(done) == "1 rest in 12 orientations over 95.0 s: enough, on all sides."
    assert summary(None) == "Nothing was recorded."
    some = state(orientations=14, missing=("-z up",))
    assert "not enough, some sides are missing. Next: -z up." in summary(some)


def test_picture_fits_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "get_terminal_size", lambda: os.terminal_size((60, 20)))
    assert max(map(len, drawn(state()).splitlines())) <= 56


def test_what_the_picture_shows_of_a_real_log(folder: Path) -> None:
    from foucault.logs import LogDescription, read

    live = LiveRests()
    live.add(read(LogDescription.model_validate({"file": "log.csv"}), folder))
    out = drawn(checklist(live))
    assert out.count("✓") == 26
    assert "24 in 24 orientations" in out
