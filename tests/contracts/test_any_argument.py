"""Whatever a command is given, it ends in words: no traceback, no minute, no 2 GB.

Every command is run with every file that it reads, every number and every text exchanged for what
nobody means; some commands together in a process with limited memory.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from contextlib import nullcontext
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
from sessions import shorter

TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS / "cli"), str(TESTS)]
LINES: dict[str, str] = {
    **importlib.import_module("test_bad_values").LINES,
    "report": "run",
    "optimise": "six_position -o new --restarts 1 --evaluations 5",
    "montecarlo": "six_position -n 2 -o new",
    "calibrate": "hand_rotated.toml -o new",
}

PROGRAM: Any = typer.main.get_command(app)

SECONDS, MEMORY = 60.0, 2 << 30
"""What a mistake may take [s], [byte]."""

DAMAGED_RESULTS = {
    "null": ("value", None), "text": ("value", "0.1"), "negative": ("sd", -1.0),
    "huge": ("value", 1e300), "number": ("name", 7), "other": ("name", "=1+1"),
}  # fmt: skip

FILES = (
    "missing", "folder", "empty.csv", "empty.toml", "junk.csv", "junk.toml", "junk.json",
    "deep.toml", "deep.json", "long.toml", "n" * 5000, "short.csv.gz", "junk.parquet", "junk.npz",
    "other.toml", "digits.toml", *(f"{k}" for k in DAMAGED_RESULTS), "nan.csv",
)  # fmt: skip

WRITTEN = ("missing", "folder", "n" * 5000, "junk.csv", "other")
"""What an option that names a file to write is given: what was in a file is not looked at."""

NUMBERS = ("-1", "0", "1000000000000", "1" + "0" * 400, "1e9", "nan")

TEXTS = (
    "", "nan", "1e999 m", "-1e30 m", "0 rad/s", "9" * 5000 + " s", "(" * 5000, "a=b=c",
    "\u202e\x1b[2J", "1e-320 deg",
)  # fmt: skip


def prepared(folder: Path) -> None:
    """Write good files, and bad ones of every kind."""
    own.write(simulate_motion([Rest(20.0)], START, rate=20.0).log, folder / "log.csv")
    (folder / "hand_rotated.toml").write_text(campaign.template("hand_rotated"))
    run_folder.save(make_result(), folder / "run")
    shutil.copytree(folder / "run", folder / "other")
    write_files(folder)
    bad = folder / "bad"
    (bad / "folder").mkdir(parents=True)
    for name in ("empty.csv", "empty.toml"):
        (bad / name).write_bytes(b"")
    junk = bytes(range(256)) * 40
    for name in ("junk.csv", "junk.toml", "junk.json", "junk.parquet", "junk.npz"):
        (bad / name).write_bytes(junk)
    (bad / "short.csv.gz").write_bytes(b"\x1f\x8b\x08\x00" + junk[:50])
    (bad / "deep.toml").write_text("x = " + "[" * 5000 + "]" * 5000)
    (bad / "deep.json").write_text("[" * 50_000)
    (bad / "digits.toml").write_text("x = 1" + "0" * 5000)
    (bad / "other.toml").write_text('[[result]]\nfolder = "\\u0000"\n[procedure]\nname = 7\n')
    long = (folder / "hand_rotated.toml").read_text()
    (bad / "long.toml").write_text(long.replace("log.csv", "n" * 5000 + ".csv"))
    (bad / "nan.csv").write_text("time,gyro_x,gyro_y\nnan,inf,\n1e999,-,\n")
    for kind, (key, value) in DAMAGED_RESULTS.items():
        shutil.copytree(folder / "run", bad / kind)
        file = bad / kind / run_folder.RESULT_FILE
        doc = json.loads(file.read_text())
        doc["coefficients"][0][key] = value
        if kind == "other":
            doc["diagnostics"] = {"mounting": {"C_ms": "x"}, "noise": "x", "detection": [1]}
            doc["provenance"] = {"prior": "x", "input": {"description": [1]}, "inputs": [{}]}
            doc["coefficients"][0]["name"] = "accel.bias.x"
        file.write_text(json.dumps(doc))


def cases(words: str) -> list[list[str]]:
    """Return command lines: what the command needs, one word of it exchanged or one added."""
    import shlex

    good, command = shlex.split(LINES[words]), PROGRAM
    for word in words.split():
        command = command.commands[word]
    command = command.commands["find"] if words == "north" else command
    first = [*words.split(), *(["find"] if words == "north" else [])]
    out = []
    for i, word in enumerate(good):
        before = good[i - 1] if i else ""
        if before.startswith("-") or word.startswith("-"):
            continue
        some = FILES if "." in word or word in ("run", "other") else (*FILES[:6], *TEXTS)
        out += [[*first, *good[:i], _path(f), *good[i + 1 :]] for f in some]
    for option in command.params:
        if option.param_type_name != "option" or option.is_flag:
            continue
        spelling, kind = option.opts[-1], option.type_descriptor.annotation
        if option.name in ("output", "scheduler", "workers", "local_cluster", "host", "port"):
            continue
        files = WRITTEN if "to write" in (option.help or "") else FILES
        some = NUMBERS if kind is int else files if kind is Path else TEXTS
        at = [_path(v) if some is files else v for v in some]
        out += [[*first, *good, spelling, value] for value in at]
    return [[w for w in words if "\x00" not in w] for words in out]


def _path(name: str) -> str:
    return f"bad/{name}" if name in FILES and len(name) < 999 else name


def tried(words: str, files: Path, folder: Path) -> list[str]:
    """Run all cases of a command on a copy of the files; return what went wrong."""
    from typer.testing import CliRunner

    os.chdir(shutil.copytree(files, folder / words))
    wrong = []
    for k, case in enumerate(cases(words)):
        shutil.rmtree("new", ignore_errors=True)
        begun = time.monotonic()
        # What more of a plan would buy has nothing to do with arguments: the first case has it.
        with shorter() if k else nullcontext():
            done = CliRunner().invoke(app, case)
        took = time.monotonic() - begun
        said = " ".join(w[:60] for w in case)
        other = done.exception is not None and not isinstance(done.exception, SystemExit)
        if other or done.exit_code in (70, 130) or "Traceback" in done.output:
            wrong.append(f"{said}: {done.exit_code} {done.exception!r} {done.output[-500:]}")
        if took > SECONDS:
            wrong.append(f"{said}: {took:.0f} s")
        if any(p.name.startswith(".partial") for p in Path().rglob(".*")):
            wrong.append(f"{said}: left something half written")
    return wrong


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("any")
    prepared(made)
    return made


COMMANDS = [w for w in LINES if w not in ("watch", "demo")]


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(4))
def test_a_command_ends_in_words(first: int, folder: Path, tmp_path: Path) -> None:
    program = [sys.executable, __file__, str(folder), str(tmp_path), *COMMANDS[first::4]]
    paths = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    done = subprocess.run(
        program, capture_output=True, text=True, check=False, timeout=600,
        env=os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-3000:]


if __name__ == "__main__":
    used = 4 << 30  # code and libraries are mapped, not used
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    files, here, *commands = sys.argv[1:]
    found = [wrong for words in commands for wrong in tried(words, Path(files), Path(here))]
    peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if peak > MEMORY:
        found.append(f"{peak / 1e9:.1f} GB")
    print("\n\n".join(found))
    sys.exit(1 if found else 0)
