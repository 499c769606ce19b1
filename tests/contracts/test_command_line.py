"""The command line speaks with one voice, and what its help says is understood."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer.main

from foucault.cli.app import app

PROGRAM: Any = typer.main.get_command(app)

ONE_LINE = 64
"""Letters of a summary that the list of commands shows whole on 80 columns."""

OWN_WORDS = {
    "--accel-noise": 2,  # `north plan` has a default
    "--gyro-noise": 2,  # `north plan` takes the name of a grade
    "--set": 2,  # of [log], or of a campaign with its table
    "--seed": 2,  # `simulate` leaves it to the campaign
    "--force": 2,  # what is overruled
    "--hold": 2,  # of a log that grows, or of a session that is guided
    "--database": 2,  # `serve` has it in its folder
    "--date": 2,  # of a field that changes, or of a log
    "--at": 3,  # a temperature, a time, a day
    "--drift": 2,
    "--level-sd": 2,  # at the start of navigation, or of a case without accelerometers
    "--method": 2,
    "--order": 2,
    "--noise": 2,  # of a run, or of a receiver's file
    "--rate": 4,  # of a plan, a session, a column, a receiver
    "--reason": 2,  # of a review, or of a run that is released
    "--reference": 3,
    "--rest": 2,
    "--frames": 2,  # of one source, or of several
    "--serial": 2,  # of what is looked for, or of each IMU that is recorded
    "--words": 2,  # of a review, or of a guide
    "--workers": 2,
    "--to": 2,  # what to write, or whose file it is
}
"""Options that say different things in different commands, and how many."""

WRITTEN = ("Folder to write", "File to write", "CSV file to write", "Log to write")


def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command with the words that call it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*words, name))
        else:
            yield (*words, name), command


COMMANDS = {" ".join(words): command for words, command in commands(PROGRAM)}


def options(command: Any) -> list[Any]:
    return [p for p in command.params if p.param_type_name == "option" and p.name != "help"]


def examples(command: Any) -> list[str]:
    lines = command.epilog.partition("Example")[2].split("\n\n")[0].splitlines()[1:]
    return [line.strip() for line in lines]


def test_all_commands_are_seen() -> None:
    assert len(COMMANDS) > 20
    assert {"north find", "north plan"} <= set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_what_it_does_in_a_line(name: str) -> None:
    first, *more = COMMANDS[name].help.split("\n")
    assert first[0].isupper()
    assert len(first) <= ONE_LINE
    assert first[-1] in ".?"
    assert not more or not more[0], "a paragraph of its own"


@pytest.mark.parametrize("name", COMMANDS)
def test_everything_that_can_be_given_is_explained(name: str) -> None:
    for parameter in COMMANDS[name].params:
        if parameter.name != "help":
            assert parameter.help, parameter.name
            assert parameter.help[0].isupper() or parameter.help.startswith("inertial_frame")
            assert parameter.help.endswith("."), parameter.help
            assert "'" not in re.sub(r"\w'\w", "", parameter.help), 'cmd.exe knows only "'


@pytest.mark.parametrize("name", COMMANDS)
def test_its_examples_are_understood(name: str) -> None:
    """Every example is a command line that the parser takes, most of them of this command."""
    lines = examples(COMMANDS[name])
    assert any(f"foucault {name.replace(' find', '')} " in f"{line} " for line in lines)
    for line in lines:
        assert "'" not in line, 'cmd.exe knows only "'
        words = shlex.split(line)
        words = words[words.index("foucault") + 1 :]
        words = words[: words.index(">")] if ">" in words else words
        if "--help" in words:
            continue
        group, context = PROGRAM, PROGRAM.make_context("foucault", list(words))
        while hasattr(group, "commands"):
            rest = [*context._protected_args, *context.args]
            word, group, rest = group.resolve_command(context, rest)
            context = group.make_context(word, list(rest), parent=context)


def test_what_is_given_alike_is_called_alike() -> None:
    said: dict[str, set[str]] = {}
    for command in COMMANDS.values():
        for option in options(command):
            for spelling in option.opts:
                if spelling.startswith("--") and spelling != "--output":
                    said.setdefault(spelling, set()).add(option.help)
    assert {name: len(words) for name, words in said.items() if len(words) > 1} == OWN_WORDS


def test_output_is_an_option_of_two_spellings_that_says_what_is_written() -> None:
    for name, command in COMMANDS.items():
        for option in options(command):
            if option.name == "output":
                assert option.opts == ["-o", "--output"], name
                assert option.help.startswith(WRITTEN), (name, option.help)


def test_a_verdict_has_its_exit_codes_explained() -> None:
    for name in ("calibrate", "merge", "compare", "fleet", "align", "navigate", "delay", "watch",
                 "temperature", "montecarlo", "optimise", "preflight", "north find"):  # fmt: skip
        assert "Exit codes:\n  0" in COMMANDS[name].epilog, name


def test_optimise_offers_what_it_takes() -> None:
    from foucault.campaign.reading import improvable
    from foucault.procedures import PROCEDURES

    said = COMMANDS["optimise"].params[0].help
    assert {name for name in PROCEDURES if re.search(rf"\b{name}\b", said)} == set(improvable())
