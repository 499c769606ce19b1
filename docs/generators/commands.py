"""The page of the command line: what every command says of itself."""

from __future__ import annotations

import typer.main
from typer.testing import CliRunner

from foucault.cli.app import app

HEAD = """\
# Command line

What `foucault --help` and `foucault COMMAND --help` print. Quantities are text with their unit.
"""


def page() -> str:
    lines = [HEAD, "```text", _help(), "```"]
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        lines += ["", f"## {name}", "", "```text", _help(name), "```"]
        for sub in getattr(command, "commands", {}):
            lines += ["", f"### {name} {sub}", "", "```text", _help(name, sub), "```"]
    return "\n".join(lines) + "\n"


def _help(*words: str) -> str:
    said = CliRunner().invoke(
        app, [*words, "--help"], prog_name="foucault", env={"COLUMNS": "88"}, terminal_width=88
    )
    return "\n".join(line.rstrip() for line in said.output.strip().splitlines())
