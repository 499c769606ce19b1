"""A warning of a log is not said again by the next command; a command run again says all."""

from __future__ import annotations

import json

import platformdirs
import pytest
from typer.testing import CliRunner

import make_bare as make
from foucault.cli import said, screen
from foucault.cli.app import app


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache"))
    return tmp_path / "cache" / said.FILE


def test_another_command_of_the_same_log_has_said_it(cache):
    assert said.as_before("log", "inspect", ["a", "b"]) == {}
    assert said.as_before("log", "allan", ["b", "c"]) == {"b": "inspect"}
    assert said.as_before("log", "allan", ["b", "c"]) == {"b": "inspect"}
    assert said.as_before("log", "inspect", ["a", "b"]) == {}
    assert said.as_before("log", "calibrate", ["c"]) == {"c": "allan"}
    assert said.as_before("another log", "allan", ["a", "b"]) == {}


@pytest.mark.parametrize("broken", ["", "[1]", '{"a": 3}', "no json"])
def test_what_cannot_be_remembered_is_said(cache, broken):
    said.as_before("log", "inspect", ["a"])
    cache.write_text(broken)
    assert said.as_before("log", "allan", ["a"]) == {}
    held = {m: (c, t - said.FORGOTTEN - 1) for m, (c, t) in json.loads(cache.read_text()).items()}
    cache.write_text(json.dumps(held))
    assert said.as_before("log", "inspect", ["a"]) == {}
    cache.unlink()
    cache.mkdir()
    assert said.as_before("log", "allan", ["a"]) == {}


def test_only_a_terminal_is_spared(tmp_path, monkeypatch, cache):
    file = make.write("untitled", tmp_path, make.truth(1, 50.0, 12))

    def run(*words: str) -> str:
        done = CliRunner().invoke(app, [*words, str(file)])
        assert done.exit_code == 0
        return " ".join(done.output.split())

    note = "The log moves; its longest rest"
    assert note in run("allan")
    assert not cache.exists()
    monkeypatch.setattr(screen, "_on_a_terminal", lambda: True)
    assert note in run("allan")
    assert note in run("allan")
    told = said.as_before
    monkeypatch.setattr(said, "as_before", lambda log, command, texts: told(log, "watch", texts))
    again = run("allan")
    assert note not in again
    assert "as `foucault allan` said before" in again
