"""Commands about campaign files and what the program knows: init, schema, messages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foucault.cli import words
from foucault.cli.screen import Screen


def add_to(app: typer.Typer) -> None:
    """Add the commands of this module to the program."""
    app.command("init", epilog=words.epilog("foucault init hand_rotated -o campaign.toml"))(init)
    app.command(
        "schema",
        epilog=words.epilog(
            "foucault schema > campaign.schema.json",
            "foucault schema --result > result.schema.json",
        ),
    )(schema)
    app.command("messages", epilog=words.epilog("foucault messages > messages.md"))(messages)


def init(
    ctx: typer.Context,
    procedure: Annotated[str, typer.Argument(help="Name of a procedure, such as hand_rotated.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="File to write; standard output if left out."),
    ] = None,
) -> None:
    """Write a commented campaign file to start from."""
    from foucault import campaign
    from foucault.errors import error
    from foucault.files import atomic

    screen: Screen = ctx.obj
    text = campaign.template(procedure)
    if output is None:
        print(text, end="")
        return
    if output.exists():
        raise error("output.exists", path=output)
    with atomic(output) as temporary:
        temporary.write_text(text, encoding="utf-8")
    screen.say(f"Wrote {output}. Fill it in, then run: foucault calibrate {output} -o run")
    screen.data({"campaign": str(output)})


def schema(
    result: Annotated[
        bool, typer.Option("--result", help="Print that of result.json instead.")
    ] = False,
) -> None:
    """Print the JSON schema of campaign files, or of result.json."""
    import json

    from foucault import campaign, run_folder

    print(json.dumps(run_folder.result_schema() if result else campaign.schema(), indent=1))


def messages(ctx: typer.Context) -> None:
    """Print every error and warning with its cure, as Markdown."""
    from dataclasses import asdict

    from foucault.symptoms import SYMPTOMS, markdown

    screen: Screen = ctx.obj
    if screen.json:
        screen.data([asdict(row) for row in SYMPTOMS.values()])
    else:
        print(markdown())
