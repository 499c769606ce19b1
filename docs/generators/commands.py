"""The page of the command line: what every command says of itself."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from typing import Any

import typer.main

from foucault.cli.app import app

HEAD = """\
# Command line

What `foucault --help` and `foucault COMMAND --help` print. Quantities are text with their unit.
"""


def page() -> str:
    program: Any = typer.main.get_command(app)
    lines = [HEAD, "```text", _help(program), "```"]
    for name, command in program.commands.items():
        lines += ["", f"## {name}", "", "```text", _help(program, name), "```"]
        for sub in getattr(command, "commands", {}):
            lines += ["", f"### {name} {sub}", "", "```text", _help(program, name, sub), "```"]
    return "\n".join(lines) + "\n"


def _help(program: Any, *words: str) -> str:
    said = io.StringIO()
    with redirect_stdout(said):
        program.main(
            [*words, "--help"], prog_name="foucault", standalone_mode=False, terminal_width=88
        )
    return "\n".join(line.rstrip() for line in said.getvalue().strip().splitlines())
