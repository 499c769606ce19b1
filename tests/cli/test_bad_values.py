"""Every option that takes a value refuses one that makes no sense, and names one of the two."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest
import typer.main

from foucault import campaign, run_folder
from foucault.cli import app
from foucault.logs import own
from foucault.plans.manoeuvres import Rest
from foucault.simulate.motion import simulate_motion
from make_certificate import write_files
from make_navigation import START
from make_result import make_result

PROGRAM: Any = typer.main.get_command(app)

ANY_WORDS = {"--serial", "--who"}
"""Options that take any text."""

LINES = {
    "init": "hand_rotated",
    "plans": '"icosahedron 12"',
    "preflight": "platform_tumble",
    "optimise": "platform_tumble -o new",
    "inspect": "log.csv",
    "simulate": "hand_rotated -o new",
    "calibrate": "hand_rotated.toml -o new",
    "demo": "-o new",
    "merge": "run other -o new",
    "compare": "run other",
    "fleet": "hand_rotated.toml -o new",
    "align": 'log.csv --latitude "47 deg"',
    "navigate": "log.csv",
    "delay": "log.csv log.csv",
    "allan": "log.csv",
    "montecarlo": "six_position -n 2 -o new",
    "temperature": "run other -o new",
    "apply": "run log.csv -o new.csv",
    "export": "run --to json -o new.json",
    "check": "imu.yaml",
    "watch": "log.csv",
    "certify": "run laboratory.toml job.toml -o new",
    "verify": "hand_rotated.toml",
    "north": "log.csv",
    "north plan": '--latitude "47 deg" --gyro-noise navigation --time "10 min"',
}
"""What each command needs beside the option that is tried."""


def options_with_values() -> list[Any]:
    """Return every command, one of its options, and a value that makes no sense."""
    out = []
    for words in LINES:
        command = PROGRAM
        for word in words.split():
            command = command.commands[word]
        command = command.commands["find"] if words == "north" else command
        for option in command.params:
            spelling = option.opts[-1]
            if option.param_type_name == "option" and not option.is_flag:
                bad = "-1" if option.type_descriptor.annotation is int else "nonsense"
                bad = "log.csv/below" if spelling in ("--output", "--plots", "--steps") else bad
                if spelling not in ANY_WORDS:
                    out.append(pytest.param(words, spelling, bad, id=f"{words} {spelling}"))
    return out


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a campaign and two results."""
    folder = tmp_path_factory.mktemp("bad")
    own.write(simulate_motion([Rest(20.0)], START, rate=20.0).log, folder / "log.csv")
    (folder / "hand_rotated.toml").write_text(campaign.template("hand_rotated"))
    run_folder.save(make_result(), folder / "run")
    noises = [f"{triad}_{kind}: 0.001" for triad in ("accelerometer", "gyroscope")
              for kind in ("noise_density", "random_walk")]  # fmt: skip
    kalibr = "\n".join(["rostopic: /imu0", "update_rate: 100.0", *noises, ""])
    (folder / "imu.yaml").write_text(kalibr)
    shutil.copytree(folder / "run", folder / "other")
    write_files(folder)
    return folder


@pytest.mark.parametrize(("words", "option", "bad"), options_with_values())
def test_a_bad_value_is_refused(
    words: str, option: str, bad: str, files: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(files)
    before = sorted(files.iterdir())
    line = shlex.split(f"{words} {LINES[words]}")
    with pytest.raises(SystemExit) as end:
        PROGRAM.main([*line, option, bad], prog_name="foucault")
    said = capsys.readouterr().err
    assert end.value.code in (1, 2), said
    assert option in said or bad in said
    assert "Traceback" not in said and "\n" in said
    assert sorted(files.iterdir()) == before, "nothing is written"


def test_every_command_is_tried() -> None:
    # No option of theirs takes a value; those of the records are tried beside their database, of
    # what listens until it is stopped by tests of their own.
    silent = {"schema", "messages", "report", "parts"}
    others = {"records", "capture", "listen", "serve"}
    assert set(LINES) | silent | others == set(PROGRAM.commands) | {"north plan"}
