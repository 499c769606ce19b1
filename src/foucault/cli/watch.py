"""The command watch: follow a log while it is recorded, and say what is still missing."""

from __future__ import annotations

import json
import re
import sys
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command, quantity
from foucault.cli.screen import INTERRUPTED, Drawn, Screen, Shown, Told, shown_by
from foucault.errors import FoucaultError, error

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.diagnose.live import Checklist
    from foucault.logs.description import LogDescription
    from foucault.logs.follow import Follower

PAUSE = 0.2  # Time between two looks at the log [s].
STALLED = 2.0  # Without a new sample for so long, it is said [s].
ENOUGH, TOO_FEW = 0, 3  # Exit codes.


@command(
    "foucault watch campaign.toml",
    "foucault watch session.csv",
    "some_logger | foucault watch campaign.toml --stdin",
    notes="It ends with Ctrl-C or the end of standard input.",
    exits={0: "enough rests on all sides", 3: "not enough"},
)
def watch(
    screen: Screen,
    log: Annotated[Path | None, typer.Argument()] = None,
    stdin: Annotated[bool, typer.Option("--stdin")] = False,
    until_complete: Annotated[bool, typer.Option("--until-complete")] = False,
    hold: Annotated[Amount, quantity("time", "", least="0 or more")] = "3 s",
    timeout: Annotated[Amount | None, quantity("time", "", least="0 or more")] = None,
    taken: options.Taken = None,
) -> None:
    """Follow a growing log: rests found, orientations missing."""
    session = _open(log, stdin, hold, taken)
    name = session.follower.tail.name
    display = shown_by(screen, name, Display, JsonLines, Picture, Lines)
    with suppress(KeyboardInterrupt), display:
        _follow(session, display, until_complete, timeout)
    seen = session.finish()
    if seen is None and session.follower.tail.ended:
        raise error("log.empty", file=session.follower.tail.name)
    display.end(seen)
    raise typer.Exit(ENOUGH if seen is not None and seen.complete else TOO_FEW)


def _open(path: Path | None, stdin: bool, hold: float, taken: Sequence[str] | None) -> Session:
    from foucault import campaign as campaigns
    from foucault.campaign.recognised import said_of
    from foucault.logs.description import LogDescription
    from foucault.logs.follow import Follower, StreamTail, open_tail

    campaign = campaigns.load(path) if path is not None and path.suffix == ".toml" else None
    if campaign is not None:
        description, folder = campaign.imu_log, campaign.folder
    elif path is not None and not stdin:
        description, folder = _described(path, options.known([path], taken)), path.parent
    elif stdin:
        said = {"file": "standard input"} | said_of(taken or ())
        description, folder = LogDescription.model_validate(said), Path()
    else:
        raise error("watch.nothing")
    if stdin:
        return Session(Follower(StreamTail(sys.stdin.buffer), description), hold, campaign)
    file = next(iter(description.files()))
    return Session(Follower(open_tail(folder / file, description), description), hold, campaign)


def _described(path: Path, said: Mapping[str, Any]) -> LogDescription:
    """Describe a log that says itself what it holds, or by what it holds already."""
    from foucault.logs.description import LogDescription, describes_itself
    from foucault.recognise.reading import question, recognise

    alone = LogDescription.model_validate({"file": path.name})
    if describes_itself(path) or not path.is_file():
        return alone
    try:
        seen = recognise([path], said)
    except FoucaultError as problem:
        if problem.code in ("recognise.no_table", "recognise.short"):  # not yet
            return alone
        raise
    if seen.questions:
        raise question(seen)
    return seen.description()


@dataclass
class Session:
    """A log that is followed, its rests, and what was seen last."""

    follower: Follower
    hold: float
    campaign: Campaign | None
    seen: Checklist | None = None
    _found: Any = None
    _checks: Any = None
    _restarts: int = 0

    def step(self) -> bool:
        """Take what is new; tell whether there was anything."""
        part = self.follower.poll()
        if self.follower.restarts != self._restarts:
            self._restarts, self.seen, self._found = self.follower.restarts, None, None
        if part is None:
            return False
        if self._found is None:
            self._begin()
        self._found.add(part)
        self._look()
        return True

    def _begin(self) -> None:
        from foucault.detect.live import LiveRests
        from foucault.detect.stretches import How
        from foucault.diagnose.live import Watchman

        used: LogDescription | None = self.follower.used
        assert used is not None
        settings = None if self.campaign is None else self.campaign.settings
        asked = {
            name: getattr(settings, name)
            for name in ("window", "shortest", "threshold")
            if hasattr(settings, name)
        }
        self._found = LiveRests(How(**asked))
        self._checks = Watchman(self._found, used)

    def _look(self) -> None:
        from foucault.diagnose.live import checklist

        if self._found.samples:
            findings = (*self.follower.findings, *self._checks.findings())
            self.seen = checklist(self._found, findings, hold=self.hold)

    def finish(self) -> Checklist | None:
        """Decide once more from everything; None where there was nothing."""
        if self._found is not None:
            self._found.finish()
            self._look()
        return self.seen


def _follow(
    session: Session, display: Display, until_complete: bool, timeout: float | None
) -> None:
    tail, last = session.follower.tail, clock.monotonic()
    while not INTERRUPTED.is_set():
        if session.step():
            last = clock.monotonic()
        silent = clock.monotonic() - last
        display.show(session.seen, silent, tail.missing)
        seen = session.seen
        if tail.ended:
            return
        if until_complete and seen and seen.complete and (not seen.still or seen.hold == 0):
            return
        if timeout is not None and silent >= timeout:
            if seen is None:
                what = "the file does not exist" if tail.missing else "it has no line of data yet"
                raise error("watch.timeout", file=tail.name, timeout=f"{timeout:g}", what=what)
            return
        if not session.follower.behind:
            clock.sleep(PAUSE)


# -- what people see ---------------------------------------------------------------------------


@dataclass
class Display(Shown):
    """Shows nothing until the end."""

    about: str  # name of the log

    def show(self, seen: Checklist | None, silent: float, missing: bool) -> None:
        """Show the state; `silent` is the time since the last sample [s]."""

    def end(self, seen: Checklist | None) -> None:
        """Show how it ended."""
        self.screen.say(summary(seen))


@dataclass
class JsonLines(Display, Told):
    """One JSON document per line: at every change, and once a second."""

    def show(self, seen: Checklist | None, silent: float, missing: bool) -> None:
        codes = () if seen is None else tuple(item.code for item in seen.findings)
        if self.due((missing, seen and (seen.still, len(seen.rests), seen.missing), codes)):
            self._print("state", seen, waiting_for_file=missing, silent=round(silent, 1))

    def end(self, seen: Checklist | None) -> None:
        self._print("end", seen)

    def _print(self, event: str, seen: Checklist | None, **more: Any) -> None:
        document = {"event": event, "log": self.about, "complete": False} | more
        if seen is not None:
            document |= asdict(seen) | {"complete": seen.complete}
            document["visited"] = [words for words, near in seen.visited if near]
        print(json.dumps(document), flush=True)


@dataclass
class Lines(Display):
    """A line for everything that happens, for files and pipes."""

    _told: set[str] = field(default_factory=set)
    _rests: int = 0
    _samples: int = 0

    def show(self, seen: Checklist | None, silent: float, missing: bool) -> None:
        if missing:
            self._once(f"waiting for {self.about} to appear")
        if seen is None:
            return
        if seen.samples < self._samples:  # the log began anew
            self._rests = 0
        self._samples = seen.samples
        self._once(f"following {self.about}, {seen.rate:.4g} Hz")
        for item in seen.findings:
            self._once(f"{item.severity}: {item.message}", f"  {item.cure}", key=item.code)
        ended = len(seen.rests) - bool(seen.still and seen.hold > 0)
        self._tell_rests(seen, ended)
        if seen.complete:
            self._once("enough rests on all sides; more make the result better, Ctrl-C ends")

    def end(self, seen: Checklist | None) -> None:
        if seen is not None:
            self._tell_rests(seen, len(seen.rests))
        super().end(seen)

    def _tell_rests(self, seen: Checklist, ended: int) -> None:
        for k in range(self._rests, ended):
            rest = seen.rests[k]
            self.screen.say(f"rest {k + 1}: {rest.up}, from {rest.start:.1f} s")
        if ended > self._rests and seen.missing:
            self.screen.say(f"  next: {_next(seen)}")
        self._rests = max(self._rests, ended)

    def _once(self, *lines: str, key: str = "") -> None:
        if (key or lines[0]) not in self._told:
            self._told.add(key or lines[0])
            self.screen.say(*lines)


@dataclass
class Picture(Display, Drawn):
    """The checklist in the terminal, kept up to date in its place."""

    def show(self, seen: Checklist | None, silent: float, missing: bool) -> None:
        self.draw(picture(self.about, seen, silent, missing))


def summary(seen: Checklist | None) -> str:
    """Say in one line what was captured and whether it is enough."""
    if seen is None:
        return "Nothing was recorded."
    n, m = len(seen.rests), seen.orientations
    have = f"{_count(n, 'rest')} in {_count(m, 'orientation')} over {seen.duration:.1f} s"
    if seen.complete:
        return f"{have}: enough, on all sides."
    few = f"{seen.needed} orientations are needed" if m < seen.needed else "some sides are missing"
    return f"{have}: not enough, {few}. Next: {_next(seen)}."


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _next(seen: Checklist) -> str:
    more = len(seen.missing) - 3
    shown = "; ".join(seen.missing[:3]) or "any orientation that differs from the others"
    return shown + (f"; and {more} more" if more > 0 else "")


def picture(name: str, seen: Checklist | None, silent: float, missing: bool) -> Any:
    """Draw the checklist for a terminal."""
    from rich.panel import Panel
    from rich.text import Text

    # Short of the edge, where the ^C of Ctrl-C would break the line and the picture.
    width = min(get_terminal_size().columns - 4, 100)
    return Panel(
        _rows(name, seen, silent, missing), title=Text(name), title_align="left",
        subtitle="Ctrl-C ends", width=width,
    )  # fmt: skip


def _rows(name: str, seen: Checklist | None, silent: float, missing: bool) -> Any:
    from rich.table import Table
    from rich.text import Text

    rows = Table.grid(padding=(0, 2))
    rows.add_column(style="dim", no_wrap=True)
    rows.add_column()
    if seen is None:
        words = f"waiting for {name} to appear" if missing else "waiting for the first samples"
        rows.add_row("now", Text(words, "bold yellow"))
        return rows
    minutes, seconds = divmod(int(seen.duration), 60)
    recorded = f"{minutes}:{seconds:02d} min at {seen.rate:.4g} Hz"
    rows.add_row("recorded", Text(recorded))
    rows.add_row("now", _now(seen, silent))
    colour = "green" if seen.complete else "default"
    have = f"{len(seen.rests)} in {_count(seen.orientations, 'orientation')}; "
    rows.add_row("rests", Text(f"{have}{seen.needed} are enough", colour))
    for words, size in (("faces", 1), ("edges", 2), ("corners", 3)):
        rows.add_row(words, _marks(seen, size))
    enough = "enough on all sides; more make the result better"
    rows.add_row("next", Text(enough, "bold green") if seen.complete else Text(_next(seen), "bold"))
    for item in seen.findings:
        rows.add_row(Text(item.severity, "yellow"), Text(f"{item.message} {item.cure}", "yellow"))
    return rows


def _now(seen: Checklist, silent: float) -> Any:
    from rich.text import Text

    if silent > STALLED:
        return Text(f"no new samples for {silent:.0f} s", "bold yellow")
    if seen.still is None:
        return Text("learning what quiet is: leave the instrument at rest", "bold")
    if not seen.still:
        return Text("moving: put it down, or hold it still", "bold cyan")
    held = f"at rest for {seen.still_for:.1f} s: "
    if seen.hold > 0:
        return Text(f"{held}hold still {seen.hold:.1f} s more", "bold yellow")
    return Text(f"{held}good, turn it to the next orientation", "bold green")


def _marks(seen: Checklist, size: int) -> Any:
    from rich.text import Text

    marks = [(re.findall(r"[+-][xyz]", words), near) for words, near in seen.visited]
    out = Text()
    for letters, near in sorted(marks, key=lambda mark: [word[::-1] for word in mark[0]]):
        if len(letters) == size:
            name = "".join(letters)
            out.append(f"{name}✓ " if near else f"{name}  ", "green" if near else "dim")
    return out
