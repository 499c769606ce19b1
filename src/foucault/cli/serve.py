"""The command `serve`: pages over everything, for those who have a browser."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import typer

from foucault.cli import screen as screens
from foucault.cli.options import command
from foucault.cli.screen import Screen
from foucault.errors import library

if TYPE_CHECKING:
    from foucault.workbench.asked import Option


WORKER = "FOUCAULT_WORKER"
"""Environment variable by which this program is a worker of the workbench that began it."""


@command(
    "foucault serve",
    "foucault serve laboratory --port 8400",
    "foucault serve laboratory --account ann --role administrator",
    notes="Needs foucault[workbench]. On this computer alone no password is asked for; as soon as "
    "there is an account everybody needs one, and only then other computers are let in.",
)
def serve(
    ctx: typer.Context,
    screen: Screen,
    folder: Annotated[Path, typer.Argument()] = Path("workbench"),
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8400,
    host: str = "127.0.0.1",
    database: Annotated[str | None, typer.Option("--database")] = None,
    workers: Annotated[int, typer.Option(min=1, max=64)] = 2,
    prefix: str = "",
    account: str | None = None,
    role: Literal["operator", "reviewer", "administrator"] = "operator",
) -> None:
    """Open a workbench: drop a log, see its verdict, keep it."""
    program = ctx.find_root().command
    with library("workbench.library"):
        from foucault.workbench import serving
    where = serving.made(folder)
    if os.environ.get(WORKER):
        from foucault.workbench.look import look
        from foucault.workbench.worker import work as begin

        begin(where, partial(run, program), look)
    elif account is not None:
        serving.add_account(where, account, role, _password(), database)
        screen.say(f"{account.strip()} is {role}. From now on everybody needs an account.")
    else:
        worker = [sys.executable, "-m", "foucault", "serve", str(where)]
        serving.serve(
            where,
            host,
            port,
            database,
            workers,
            worker,
            partial(options_of, program),
            screen.say,
            prefix,
        )


def _password() -> str:
    """Ask for a password on a terminal; otherwise it is a line of standard input."""
    if sys.stdin.isatty():
        import getpass

        return getpass.getpass("Password: ")
    return sys.stdin.readline().rstrip("\r\n")


def run(program: Any, words: Sequence[str], tell: Callable[[float, str], None]) -> int:
    """Run the program in this process with these words; return how it ends."""
    screens.ALSO.append(tell)
    os.environ["COLUMNS"] = "120"
    try:
        program.main(list(words), prog_name="foucault")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    finally:
        screens.ALSO.clear()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(ValueError, OSError):
                stream.flush()
    return 0


def options_of(program: Any, name: str) -> list[Option]:
    """Return the options of a command of the program, as a form has them."""
    from foucault.workbench.asked import Option

    found = program.commands[name]
    if hasattr(found, "commands"):  # `north` alone is its first command
        found = found.commands["find"]
    out = []
    for one in found.params:
        if one.param_type_name != "option" or one.name in ("help", "output") or one.hidden:
            continue
        choices, path = _kind_of(one)
        text = str(one.default) if type(one.default) in (str, int, float) else ""
        out.append(Option(
            one.opts[-1] if one.opts[-1].startswith("--") else one.opts[0], one.help or "",
            choices, text, bool(one.is_flag), bool(one.multiple), path, one.required,
        ))  # fmt: skip
    return out


def _kind_of(option: Any) -> tuple[tuple[str, ...], bool]:
    """Return the choices of an option, and whether it names a file."""
    described = getattr(option, "type_descriptor", None)
    if described is None:  # of an older typer
        choices = tuple(map(str, getattr(option.type, "choices", ())))
        return choices, "Path" in type(option.type).__name__
    kinds = (described.annotation, *get_args(described.annotation))
    words = get_args(described.annotation) if get_origin(described.annotation) is Literal else ()
    return tuple(map(str, words)), any(one is Path for one in kinds)
