"""The program ``foucault``: its options, its exit codes, and how mistakes end it."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from foucault.cli import (
    align,
    allan,
    campaigns,
    compare,
    delay,
    export,
    fleet,
    merge,
    navigate,
    north,
    optimise,
    plans,
    preflight,
    results,
    sessions,
    study,
    temperature,
    watch,
    words,
)
from foucault.cli.screen import INTERRUPTED, Screen
from foucault.errors import FoucaultError

BAD_INPUT, BY_INTERRUPT, FAULT = 1, 130, 70

_EPILOG = words.epilog(
    "foucault init hand_rotated -o campaign.toml",
    "foucault inspect campaign.toml",
    "foucault calibrate campaign.toml -o run",
    notes="--quiet and --json may stand before or after the command. `foucault COMMAND --help` "
    "shows its options and examples.",
    exits={
        0: "done, or a result that passed",
        1: "bad input: what is wrong and what to do is printed",
        2: "wrong usage",
        3: "a doubtful result",
        4: "an unusable result",
        70: "a fault in foucault itself",
        130: "interrupted",
    },
)

_ANYWHERE = ("--quiet", "-q", "--json")


class _Program(TyperGroup):
    """Commands whose mistakes are sentences, not tracebacks."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the options of the whole program from wherever they stand."""
        end = args.index("--") if "--" in args else len(args)
        first = [a for a in args[:end] if a in _ANYWHERE]
        rest = [a for a in args[:end] if a not in _ANYWHERE] + args[end:]
        return super().parse_args(ctx, first + rest)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; turn every way it can fail into words and an exit code."""
        ctx.ensure_object(Screen)
        try:
            return super().invoke(ctx)
        except FoucaultError as problem:
            ctx.obj.error(problem)
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            raise _interrupted() from None
        except BrokenPipeError:  # the reader of our output went away
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123  the exit flush must not fail
            raise typer.Exit(0) from None
        except Exception as problem:
            if hasattr(problem, "exit_code"):  # how the parser asks to end, wrong usage included
                raise
            if INTERRUPTED.is_set():  # what was cut short may fail in its own way
                raise _interrupted() from None
            traceback.print_exc()
            print("\nThis is a fault in foucault: please report it.", file=sys.stderr)
            raise typer.Exit(FAULT) from None


app = typer.Typer(
    cls=_Program,
    name="foucault",
    help="Calibrate, align and navigate inertial instruments against gravity and the Earth.",
    epilog=_EPILOG,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        from foucault import __version__

        print(f"foucault {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    ctx: typer.Context,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON document on standard output.")
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    ctx.obj.quiet, ctx.obj.json = quiet, json


for _module in (
    campaigns, plans, preflight, optimise, sessions, results, merge, compare, fleet, north, align,
    navigate, delay, allan, study, temperature, export, watch,
):  # fmt: skip
    _module.add_to(app)


def _interrupted() -> typer.Exit:
    print("interrupted: a result that was there before is intact", file=sys.stderr)
    return typer.Exit(_BY.get("signal", BY_INTERRUPT))


_BY: dict[str, int] = {}
"""What has ended the program: "signal" -> its exit code."""


def _on_interrupt(number: int, _frame: Any) -> None:
    INTERRUPTED.set()
    _BY["signal"] = 128 + number
    if number != signal.SIGINT:  # whoever asks again does not want to wait
        signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def main() -> None:
    """Run the program."""
    # A sign that the encoding of a file on Windows lacks becomes a question mark.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    signal.signal(signal.SIGINT, _on_interrupt)
    for name in ("SIGTERM", "SIGHUP"):  # what is half written goes, as with Ctrl-C
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _on_interrupt)
    app()
