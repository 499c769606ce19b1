"""What people see: text and tables on stdout, progress and errors on stderr, or JSON instead."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from foucault.errors import Finding, FoucaultError
from foucault.escape import screen
from foucault.result import Level

PATIENCE = 1.0
"""A progress bar appears when work takes longer than this [s]."""

INTERRUPTED = threading.Event()
"""Set by Ctrl-C, for the exception itself can be lost inside a library that is being imported."""

EXIT_CODES = {Level.PASS: 0, Level.DOUBTFUL: 3, Level.UNUSABLE: 4}
COLOURS = {Level.PASS: "bold green", Level.DOUBTFUL: "bold yellow", Level.UNUSABLE: "bold red"}


@dataclass
class Screen:
    """Where and how much to print. One per run of the program."""

    quiet: bool = False
    json: bool = False

    def say(self, *lines: object, style: str | None = None) -> None:
        """Print lines for people; nothing with --quiet or --json."""
        if not (self.quiet or self.json):
            for line in lines:
                _console().print(screen(line), style=style, markup=False, highlight=False)

    def table(self, title: str, headings: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Print a table; columns after the first are aligned right."""
        if self.quiet or self.json:
            return
        from rich import box
        from rich.table import Table
        from rich.text import Text

        out = Table(
            title=Text(screen(title)) if title else None,
            title_justify="left",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
        )
        for i, heading in enumerate(headings):
            out.add_column(heading, justify="right" if i else "left", no_wrap=i == 0)
        for row in rows:
            out.add_row(*(Text(screen(cell)) for cell in row))
        _console().print(out)

    def findings(self, findings: Iterable[Finding]) -> None:
        """Print what was noticed, each with its cure."""
        for item in findings:
            self.say(f"{item.severity}: {item.message}", style="yellow")
            self.say(f"  {item.cure}")

    def data(self, value: Any) -> None:
        """Print `value` as JSON, with --json only."""
        if self.json:
            print(json.dumps(value, indent=1))  # in ASCII: whoever reads it need know no encoding

    def error(self, problem: FoucaultError) -> None:
        """Print what was wrong and what to do; both in JSON too with --json."""
        from rich.console import Console

        console = Console(stderr=True, soft_wrap=True)
        console.print(
            screen(f"error: {problem.message}"), style="bold red", markup=False, highlight=False
        )
        console.print(screen(f"  {problem.cure}"), style="red", markup=False, highlight=False)
        parts = {"code": problem.code, "message": problem.message, "cure": problem.cure}
        self.data({"error": parts})

    @contextmanager
    def progress(self) -> Iterator[Callable[[float, str], None]]:
        """Yield ``tell(fraction, words)``; a bar appears on a terminal after a second."""
        if self.quiet or self.json or not sys.stderr.isatty():
            yield lambda fraction, words: _stop_if_interrupted()
            return
        from rich.console import Console
        from rich.progress import Progress

        bar = Progress(console=Console(stderr=True), transient=True)
        task = bar.add_task("working", total=1.0)
        timer = threading.Timer(PATIENCE, bar.start)
        timer.daemon = True
        timer.start()

        def tell(fraction: float, words: str) -> None:
            _stop_if_interrupted()
            bar.update(task, completed=fraction, description=words)

        try:
            yield tell
        finally:
            timer.cancel()
            timer.join()
            bar.stop()


def _stop_if_interrupted() -> None:
    if INTERRUPTED.is_set():
        raise KeyboardInterrupt


def _console() -> Any:
    from rich.console import Console

    # Made anew each time: stdout may have been redirected since. Nothing is folded in a file.
    return Console() if sys.stdout.isatty() else Console(width=200, soft_wrap=True)
