"""What people see: text and tables on stdout, progress and errors on stderr, or JSON instead."""

from __future__ import annotations

import json
import re
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Self, TypeVar

import typer

from foucault.errors import Finding, FoucaultError
from foucault.escape import screen
from foucault.files import alone, beside, plain_json

if TYPE_CHECKING:
    from foucault.report.page import Document, Section, Table
    from foucault.run_folder import Record

Tell = Callable[[float, str], None]  # Told the fraction done and what is being done.
PATIENCE = 1.0  # A progress bar appears when work takes longer than this [s].

INTERRUPTED = threading.Event()
"""Set by Ctrl-C, for the exception itself can be lost inside a library that is being imported."""

MOST_ROWS = 100  # Of a table that are printed where there is a page, which has all of them [1].

ALSO: list[Tell] = []  # Who else is told how far the work is, where there is no terminal.

EXIT_CODES = {"pass": 0, "doubtful": 3, "unusable": 4, "fail": 4}
COLOURS = {
    "pass": "bold green", "doubtful": "bold yellow", "unusable": "bold red", "fail": "bold red",
}  # fmt: skip
"""Of the levels of a verdict; a comparison fails."""

STATES = {"good": ("ok", "pass"), "warning": ("!", "doubtful"), "bad": ("!!", "fail")}
"""State of a row -> its sign, and the level of that colour."""

SIGNS = str.maketrans({
    "\N{MINUS SIGN}": "-", "\N{NON-BREAKING HYPHEN}": "-", "\N{NO-BREAK SPACE}": " ", "≥": ">=",
    "≤": "<=", "→": "->", "′": "'", "″": '"', "`": "",
})  # fmt: skip
"""Signs of a page that not every terminal has."""


def _plain(text: str) -> str:
    return re.sub(r"√(\w+)", r"sqrt(\1)", text).translate(SIGNS)


def _worst(
    rows: Sequence[Sequence[str]], lines: Sequence[Sequence[str]], most: int | None
) -> list[int]:
    """Return which rows of a table are printed, no more than `most` [1], and their headings.

    The worst of them, then the first. `lines`: what is printed of each; a heading has one cell.
    """
    if most is None or len(rows) <= most:
        return [*range(len(rows))]
    signs = (STATES["bad"][0], STATES["warning"][0])
    heading, of = -1, dict[int, int]()
    for i, row in enumerate(rows):
        if len(row) == 1:
            heading = i
        else:
            of[i] = heading
    order = sorted(of, key=lambda i: next((k for k, s in enumerate(signs) if s in lines[i]), 2))
    kept = {*order[:most], *(of[i] for i in order[:most])}
    return sorted(kept - {-1})


@dataclass
class Screen:
    """Where and how much to print. One per run of the program."""

    quiet: bool = False
    json: bool = False
    command: str = ""
    log: str = ""  # hash of the log that is spoken of
    everything: bool = False  # whether what was said before is said again

    def say(self, *lines: object, style: str | None = None) -> None:
        """Print lines for people; nothing with --quiet or --json."""
        if not (self.quiet or self.json):
            for line in lines:
                _console().print(screen(line), style=style, markup=False, highlight=False)

    def table(
        self, title: str, headings: Sequence[str], rows: Iterable[Sequence[object]],
        right: Sequence[bool] | None = None,
    ) -> None:  # fmt: skip
        """Print a table; columns after the first are aligned right unless `right` says which."""
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
            to_right = i > 0 if right is None else right[i]
            out.add_column(
                Text(screen(heading)), justify="right" if to_right else "left", no_wrap=i == 0
            )
        for row in rows:
            out.add_row(*(Text(screen(cell)) for cell in row))
        _console().print(out)

    def document(
        self, said: Document, keys: Iterable[str] | None = None, most: int | None = None
    ) -> None:
        """Print the sections of a document that `keys` name, None for all, and its verdict.

        `most`: rows of a table, None for all [1].
        """
        from foucault.report.page import signs

        head = said.heading
        reasons = [_plain(signs(reason)) for reason in head.reasons]
        self.say("", head.title, style="bold")
        self.say(*([", ".join(head.line)] if head.line else []))
        for one in said.sections:
            drawn = all(block.kind == "figure" for block in one.blocks)
            if not drawn and (keys is None or one.key in keys):
                self.section(one, most)
        if head.state not in STATES:
            self.say(*([f"\n{head.word}."] if head.word else []), *reasons)
            return
        self.say("", _plain(f"verdict: {head.word[:1].lower()}{head.word[1:]}"),
                 style=COLOURS[STATES[head.state][1]])  # fmt: skip
        self.say(*(f"  {reason}" for reason in reasons))

    def tell(
        self, said: Document, data: Any, *lines: str, keys: Iterable[str] | None = None,
        code: int | None = None, most: int | None = None,
    ) -> typer.Exit:  # fmt: skip
        """Print a document and what else there is to say, or `data`; return how to end.

        `most`: as of `document` [1].
        """
        if not (self.quiet or self.json):
            self.document(said, keys, most)
        self.say(*lines)
        self.data(data)
        return typer.Exit(STATE_CODES.get(said.heading.state, 0) if code is None else code)

    def section(self, one: Section, most: int | None = None) -> None:
        """Print a section: text, facts, lists and tables; figures are for the page."""
        if one.key != "findings":
            self.say("", _plain(one.title), style="bold")
            self.say(*([_plain(one.lead)] if one.lead else []))
        words = {"warning": "warning: ", "bad": "error: ", "plain": "note: "}
        for block in one.blocks:
            if block.kind == "text" or block.kind == "code":
                self.say(_plain(block.text))  # type: ignore[union-attr]
            elif block.kind == "facts":
                self.say(*(_plain(f"{k}: {v}") for k, v in block.pairs))  # type: ignore[union-attr]
            elif block.kind == "items" and one.key == "findings":
                told = [words.get(state, "") + text for state, text in block.items]  # type: ignore[union-attr]
                before = self._before(told)
                self.say(*(text for text in told if text not in before), style="yellow")
                for command in sorted(set(before.values())):
                    n = list(before.values()).count(command)
                    self.say(f"{n} finding{'s' * (n > 1)} as `foucault {command}` said before.")
            elif block.kind == "items":
                self.say(*(_plain(text) for _, text in block.items))  # type: ignore[union-attr]
            elif block.kind == "table":
                self._table(block, most)  # type: ignore[arg-type]

    def _before(self, sentences: Sequence[str]) -> dict[str, str]:
        """Return what another command said of this log on this terminal, and which."""
        if not self.log or self.everything or self.quiet or self.json or not _on_a_terminal():
            return {}
        from foucault.cli import said

        return said.as_before(self.log, self.command, sentences)

    def _table(self, some: Table, most: int | None) -> None:
        """Print a table of a document; what is aside goes where there is no room, widest first."""
        shown = [i for i, c in enumerate(some.columns) if not c.optional and c.look != "meaning"]
        rows = [[_plain(cell) for cell in row] for row in some.rows]
        widths = [
            max([len(c.heading), *(len(row[i]) for row in rows if len(row) > i)]) + 3
            for i, c in enumerate(some.columns)
        ]
        aside = sorted((i for i in shown if some.columns[i].aside), key=lambda i: widths[i])
        while aside and sum(widths[i] for i in shown) > _console().width:
            shown.remove(aside.pop())
        looks = [some.columns[i].look for i in shown]
        lines = []
        for row in rows:
            aside_of = looks.index("text") if len(row) == 1 and "text" in looks else 0
            cells = [""] * aside_of + [row[0]] if len(row) == 1 else [row[i] for i in shown]
            lines.append([
                STATES.get(cell, ("", ""))[0] if look == "state" else cell
                for look, cell in zip(looks, cells, strict=False)
            ])  # fmt: skip
        kept = _worst(rows, lines, most)
        self.table(
            "", [_plain(some.columns[i].heading) for i in shown], [lines[i] for i in kept],
            right=[look == "number" for look in looks],
        )  # fmt: skip
        more = len(rows) - len(kept)
        self.say(*([f"{more} rows more on the page"] if more else []))

    def findings(self, findings: Iterable[Finding]) -> None:
        """Print what was noticed, each with its cure."""
        for item in findings:
            self.say(f"{item.severity}: {item.message}", style="yellow")
            self.say(f"  {item.cure}")

    def data(self, value: Any) -> None:
        """Print `value` as JSON, with --json only; what is not finite is null."""
        if self.json:  # in ASCII: whoever reads it need know no encoding
            print(json.dumps(plain_json(value), indent=1))

    def error(self, problem: FoucaultError) -> None:
        """Print what was wrong and what to do; both in JSON too with --json."""
        from rich.console import Console

        console = Console(stderr=True, soft_wrap=True)
        for line, style in (f"error: {problem.message}", "bold red"), (f"  {problem.cure}", "red"):
            console.print(screen(line), style=style, markup=False, highlight=False)
        self.data({"error": {k: getattr(problem, k) for k in ("code", "message", "cure")}})

    @contextmanager
    def work(self, folder: Path | None, kind: str = "result") -> Iterator[Tell]:
        """Yield `progress`, with the folder to write held alone; one of another kind is refused."""
        from foucault.run_folder import refuse_others

        if folder is not None:
            refuse_others(folder, kind)
        with nullcontext() if folder is None else alone(folder), self.progress() as tell:
            yield tell

    @contextmanager
    def progress(self) -> Iterator[Tell]:
        """Yield ``tell(fraction, words)``; a bar appears on a terminal after a second."""
        if self.quiet or self.json or not sys.stderr.isatty():
            yield _told
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


def _told(fraction: float, words: str) -> None:
    _stop_if_interrupted()
    for also in ALSO:
        also(fraction, words)


def _stop_if_interrupted() -> None:
    if INTERRUPTED.is_set():
        raise KeyboardInterrupt


def _on_a_terminal() -> bool:
    return sys.stdout.isatty()


def _console() -> Any:
    from rich.console import Console

    # Made anew each time: stdout may have been redirected since. Nothing is folded in a file.
    return Console() if sys.stdout.isatty() else Console(width=200, soft_wrap=True)


# -- What goes on and is shown while it does -----------------------------------------------------


S = TypeVar("S", bound="Shown")


@dataclass
class Shown:
    """Shows nothing: what --quiet wants, and what all other ways to show begin with."""

    screen: Screen
    about: Any  # what it speaks of, or in which words

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: Any) -> None:
        return None


@dataclass
class Drawn(Shown):
    """A picture in the terminal, kept up to date in its place."""

    _live: Any = None

    def __enter__(self) -> Self:
        from rich.live import Live

        self._live = Live(auto_refresh=False, vertical_overflow="visible")
        self._live.__enter__()
        return self

    def __exit__(self, *problem: Any) -> None:
        self._live.__exit__(*problem)

    def draw(self, picture: Any) -> None:
        """Put `picture` in its place."""
        self._live.update(picture, refresh=True)


@dataclass
class Told(Shown):
    """One JSON document per line: at every change, and once a second."""

    _last: Any = ()
    _at: float = 0.0

    def due(self, state: object) -> bool:
        """Whether something is to be said: `state` is another, or a second is over."""
        if state == self._last and monotonic() - self._at <= 1.0:
            return False
        self._last, self._at = state, monotonic()
        return True


def shown_by(
    screen: Screen, about: Any, nothing: type[S], json: type[S], picture: type[S], lines: type[S]
) -> S:
    """Return the way to show that suits the screen: a picture on a terminal, lines in a file."""
    if screen.json:
        return json(screen, about)
    if screen.quiet:
        return nothing(screen, about)
    return (picture if _on_a_terminal() else lines)(screen, about)


# -- Folders as commands leave them: what was found, its page, and what a screen shows of it -----


@dataclass(frozen=True)
class Kind:
    """A kind of run, as a folder holds it."""

    page: str  # its document, in `report`
    shown: str  # keys of the sections that the screen shows
    reader: str = ""  # of a folder: "module:function"; none for a record


KINDS = {
    "result": Kind(
        "calibration", "temperature.functions uncertainty.coefficients findings",
        "run_folder:load_result",
    ),
    "north": Kind(
        "north",
        "north.where north.headings headings.norths north.budget north.known north.calibration "
        "findings",
    ),
    "navigation": Kind(
        "navigation",
        "navigation.start navigation.growth navigation.worth navigation.terms findings",
    ),
    "search": Kind(
        "optimisation",
        "optimisation.coefficients optimisation.cases optimisation.plan findings",
        "campaign.optimisation:load",
    ),
    "comparison": Kind(
        "compare",
        "compare.results compare.mounting compare.differences compare.changes "
        "compare.side_by_side findings",
    ),
    "fleet": Kind(
        "fleet", "fleet.outcomes fleet.attention fleet.outlying", "campaign.fleet:load"
    ),
    "study": Kind("study", "study.coefficients checks", "campaign.study:load"),
}  # fmt: skip

STATE_CODES = {"good": 0, "warning": 3, "bad": 4}


@dataclass
class Found:
    """What a command has found, and the folder it is kept in, where one is wanted."""

    kind: str
    held: tuple[Any, ...]  # what `document` of its page takes
    folder: Path | None = None

    @cached_property
    def document(self) -> Document:
        """What there is to say of it."""
        made = import_module(f"foucault.report.{KINDS[self.kind].page}")
        more = {"folder": self.folder} if self.kind == "search" else {}
        said: Document = made.document(*self.held, **more)
        return said

    @cached_property
    def html(self) -> str:
        """All of it as a page."""
        from foucault.report import render

        return render(self.document)

    def page(self) -> Path:
        """Write the page."""
        from foucault.report import save
        from foucault.run_folder import REPORT_FILE

        assert self.folder is not None
        return save(self.html, self.folder / REPORT_FILE)

    def tell(
        self, screen: Screen, data: Mapping[str, Any], *lines: str, code: int | None = None
    ) -> typer.Exit:
        """Print what was found and where it is, or `data`; return how the program ends."""
        from foucault.run_folder import REPORT_FILE

        where = {}
        if self.folder is not None:
            where = {"folder": str(self.folder), "report": str(self.folder / REPORT_FILE)}
            lines += (f"Report: {where['report']}",)
        keys = KINDS[self.kind].shown.split()
        if any(one.key == "compare.differences" for one in self.document.sections):
            keys.remove("compare.side_by_side")  # which says the same of many instruments
        most = None if self.folder is None else MOST_ROWS
        return screen.tell(
            self.document, where | dict(data), *lines, keys=keys, code=code, most=most
        )


def found_in(folder: Path) -> Found:
    """Return what whatever command has written a folder has found."""
    from foucault import run_folder

    kind = run_folder.kind_of(folder)
    module, _, name = KINDS[kind].reader.partition(":")
    if not module:
        return Found(kind, (run_folder.read(folder, kind),), folder)
    held = getattr(import_module(f"foucault.{module}"), name)(folder)
    return Found(kind, held if isinstance(held, tuple) else (held,), folder)


def written(folder: Path, kind: str, *held: Any) -> Found:
    """Write the page of a folder, which is whole without it, from what was found."""
    with beside(folder):
        found = Found(kind, held, folder) if held else found_in(folder)
        found.page()
        return found


def kept(record: Record, folder: Path | None) -> Found:
    """Write a record with its page, if a folder is wanted."""
    found = Found(record.kind, (record,), folder)
    if folder is None:
        return found
    with ThreadPoolExecutor(1) as pool:
        page = pool.submit(lambda: found.html)  # made as long as the tables need the disk
        found.held = (record.save(folder),)
        with beside(folder):
            page.result()
            found.page()
    return found
