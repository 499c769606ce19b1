"""The program ``foucault``: its options, its exit codes, and how mistakes end it."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import tempfile
import traceback
from contextlib import suppress
from io import TextIOWrapper
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from foucault.cli import (
    capture,
    certificate,
    compare,
    export,
    listen,
    navigate,
    north,
    parts,
    plans,
    preflight,
    records,
    results,
    serve,
    sessions,
    watch,
)
from foucault.cli.options import add, epilog
from foucault.cli.screen import INTERRUPTED, Screen
from foucault.errors import FoucaultError, error

BAD_INPUT, BY_INTERRUPT, FAULT = 1, 130, 70

_EPILOG = epilog(
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
        given = list(pairwise(args[:end]))
        if "--output=" in args[:end] or any(((o, "") in given) for o in ("-o", "--output")):
            raise typer.BadParameter("it is empty, as a variable that is not set is.",
                                     param_hint="'-o' / '--output'")  # fmt: skip
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
            raise _interrupted(ctx.obj.command) from None
        except BrokenPipeError:  # the reader of our output went away
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123  the exit flush must not fail
            raise typer.Exit(0) from None
        except Exception as problem:
            if hasattr(problem, "exit_code"):  # how the parser asks to end, wrong usage included
                raise
            if INTERRUPTED.is_set():  # what was cut short may fail in its own way
                raise _interrupted(ctx.obj.command) from None
            known = _of_the_system(problem)
            ctx.obj.error(known or _fault(problem))
            raise typer.Exit(BAD_INPUT if known else FAULT) from None


def _of_the_system(problem: BaseException) -> FoucaultError | None:
    """Return what the system could not do in words, None where it is not to blame."""
    if isinstance(problem, MemoryError):
        return error("program.memory", reason=str(problem) or "no size is known")
    if isinstance(problem, RecursionError):
        return error("program.nested")
    if isinstance(problem, UnicodeError | OSError) or "null byte" in str(problem):
        name = getattr(problem, "filename", None)
        reason = getattr(problem, "strerror", None) or str(problem) or type(problem).__name__
        return error("program.file", path=name or "A file that was named",
                     reason=str(reason).rstrip("."))  # fmt: skip
    return None


def _fault(problem: BaseException) -> FoucaultError:
    """Return what is needed to find a fault, and keep the whole of it in a file."""
    calls = [f for f in traceback.extract_tb(problem.__traceback__) if "foucault" in f.filename]
    where = f"{Path(calls[-1].filename).name}, line {calls[-1].lineno}" if calls else "nowhere"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="foucault-", suffix=".txt", delete=False, encoding="utf-8",
            errors="replace",
        ) as file:  # fmt: skip
            traceback.print_exception(problem, file=file)
        kept = file.name
    except OSError:
        kept = "nowhere, for it could not be written"
    return error(
        "program.fault", kind=type(problem).__name__, reason=problem, where=where, file=kept
    )


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
    ctx.obj.quiet, ctx.obj.json, ctx.obj.command = quiet, json, ctx.invoked_subcommand or ""


for _command in (
    results.init, results.schema, results.messages, parts.parts, plans.plans, preflight.preflight,
    preflight.optimise, sessions.inspect, sessions.simulate, results.calibrate, results.report,
    results.demo, results.merge, compare.compare, compare.fleet, navigate.align, navigate.navigate,
    navigate.delay, sessions.allan, preflight.montecarlo, results.temperature, export.apply,
    export.export, export.check, watch.watch, capture.capture, listen.listen,
    certificate.certify, certificate.verify, serve.serve,
):  # fmt: skip
    add(app, _command)
north.add_to(app)
records.add_to(app)


_GOES_ON = "what was done is kept, and the same command goes on from there"
KEPT = {
    "montecarlo": _GOES_ON,
    "optimise": _GOES_ON,
    "serve": "all that was kept lies in its folder",
    "fleet": "each instrument has its result from before or a new one, the table that from before",
}
"""What is left of a command that was interrupted, where it is not a result as a whole."""


def _interrupted(command: str) -> typer.Exit:
    kept = KEPT.get(command, "a result that was there before is intact")
    try:
        print(f"interrupted: {kept}", file=sys.stderr, flush=True)
    except OSError:  # the terminal is what ended
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115, PTH123
    return typer.Exit(_BY.get("signal", BY_INTERRUPT))


M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # As in malloc.h.


def _keep_memory() -> None:
    """Keep what is freed, which is wanted again at once; of glibc, where memory has no limit.

    To give it back and ask for other pages, while no other thread may use any, takes up to a tenth
    of the time.
    """
    with suppress(ImportError, AttributeError, OSError, TypeError):
        import ctypes
        import resource

        limits = (resource.RLIMIT_AS, resource.RLIMIT_DATA)
        if all(resource.getrlimit(one)[0] == resource.RLIM_INFINITY for one in limits):
            set_option = ctypes.CDLL(None).mallopt
            set_option(M_TRIM_THRESHOLD, 1 << 28)
            set_option(M_MMAP_THRESHOLD, 1 << 25)


_BY: dict[str, int] = {}  # What has ended the program: "signal" -> its exit code.


def _on_interrupt(number: int, _frame: Any) -> None:
    INTERRUPTED.set()
    _BY["signal"] = 128 + number
    if number != signal.SIGINT:  # whoever asks again does not want to wait
        signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def main() -> None:
    """Run the program."""
    try:
        _prepare()
        app()
    except KeyboardInterrupt:  # before anybody could hear it
        raise SystemExit(BY_INTERRUPT) from None


def _prepare() -> None:
    # What is loaded stays: to look through it for cycles, again as it grows and once more at the
    # end, is a tenth of a short command.
    gc.set_threshold(10_000)
    atexit.register(gc.freeze)
    _keep_memory()
    # A sign that the encoding of a file on Windows lacks becomes a question mark.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    signal.signal(signal.SIGINT, _on_interrupt)
    for name in ("SIGTERM", "SIGHUP"):  # what is half written goes, as with Ctrl-C
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _on_interrupt)
