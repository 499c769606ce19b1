"""What `calibrate --live` shows: the guide in a terminal, as lines, or as JSON."""

from __future__ import annotations

import json
import math
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any

from foucault.cli.screen import Drawn, Screen, Shown, Told, shown_by
from foucault.errors import error
from foucault.run_folder import ENOUGH_FILE, SESSION_FOLDER, STATE_FILE

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.capture.live import Live
    from foucault.capture.said import Words

BAR = 24  # Width of a bar [1].
OFTEN = 0.2  # Time between two states that are kept [s].


def guided(
    screen: Screen, campaign: Path | None, source: str, output: Path, frames: str | None,
    hold: float | None, want: list[str] | None, words: str | None, silence: float | None,
) -> Campaign | None:  # fmt: skip
    """Guide a session and return the campaign of what was recorded; None where it is nothing."""
    from foucault import campaign as campaigns
    from foucault.capture import frame
    from foucault.capture.live import guided
    from foucault.capture.said import Words
    from foucault.capture.source import opened
    from foucault.capture.ways import Asked, wants

    if frames is None:
        raise error("guide.frames")
    if campaign is None:
        told = campaigns.parse(campaigns.template("hand_rotated"), output / "campaign.toml")
    else:
        told = campaigns.load(campaign)
    text = frame.text_of(frames)
    asked = Asked(told, hold, wants(want or ()))
    said, described = Words.of(words or "en"), frame.parsed(text, frames)
    display = shown_by(screen, said, Display, JsonLines, Picture, Lines)
    kept = Kept(output, said)

    def tell(live: Live, ended: bool) -> None:
        display.show(live, ended)
        kept.show(live)

    with display:
        live, recorded = guided(
            opened(source), described, text, output / SESSION_FOLDER, asked, tell=tell,
            silent=silence,
        )  # fmt: skip
    kept.show(live, now=True)
    display.end(live)
    return recorded if live.guide is not None and live.guide.rests else None


@dataclass
class Display(Shown):
    """Shows nothing until the end."""

    about: Words

    def show(self, live: Live, ended: bool) -> None:
        """Show the state; `ended`: whether a rest has just ended."""

    def end(self, live: Live) -> None:
        """Show how it ended."""
        if live.guide is not None and live.guide.stopped:
            self.screen.say(self.about.end(live.guide))


def state(live: Live, words: Words) -> dict[str, Any]:
    """Return all that is shown, as JSON."""
    troubles = [words.say(key, **values) for key, values in live.troubles()]
    guide, silence = live.guide, round(live.silence, 1)
    rows = live.recorder.heard.frames
    if guide is None:
        now = words.say("now.learn")
        return {"rows": rows, "phase": "learn", "task": now, "now": now, "ring": 0.0, "rests": 0,
                "sounds": 0, "silence": silence, "troubles": troubles, "stopped": ""}  # fmt: skip
    bars = [
        {"name": name, "reached": reached, "after": after, "wanted": wanted,
         "ratio": ratio if ratio < float("inf") else None}
        for name, reached, after, wanted, ratio in words.bars(guide)
    ]  # fmt: skip
    asked = None if guide.step is None else guide.step.attitude()
    return {
        "rows": rows, "phase": guide.phase, "task": words.task(guide), "now": words.now(guide),
        "ring": round(guide.ring, 3), "rests": guide.rests, "sounds": guide.sounds, "bars": bars,
        "mistakes": [words.wrong(m) for m in guide.recent(3)],
        "findings": [f"{f.message} {f.cure}" for f in guide.findings()],
        "stopped": guide.stopped, "silence": silence, "troubles": troubles,
        "verdict": None if guide.result is None else str(guide.result.verdict.level),
        "attitude": guide.attitude().round(4).tolist() if guide.found.samples else None,
        "asked": None if asked is None else asked.round(4).tolist(),
        "heading": round(guide.heading, 4), "list": guide.done,
    }  # fmt: skip


@dataclass
class Kept:
    """The state in a file, several times a second: a page shows it, or another program."""

    folder: Path  # of the run
    about: Words
    _at: float = 0.0  # when it was written last [s]

    def show(self, live: Live, *, now: bool = False) -> None:
        """Write it where it is time; ends the session where somebody says that it is enough."""
        if time.monotonic() - self._at < OFTEN and not now:
            return
        self._at = time.monotonic()
        part = self.folder / f".{STATE_FILE}"
        with suppress(OSError):  # a full disk is told by what is recorded
            part.write_text(json.dumps(state(live, self.about)), encoding="utf-8")
            part.replace(self.folder / STATE_FILE)
        if not now and (self.folder / ENOUGH_FILE).exists():
            raise KeyboardInterrupt


@dataclass
class JsonLines(Display, Told):
    """One JSON document per line: at every change, and once a second."""

    def show(self, live: Live, ended: bool) -> None:
        guide = live.guide
        if guide is not None and self.due(
            (guide.phase, guide.rests, len(guide.mistakes), [t.key for t in live.troubles()])
        ):
            print(json.dumps(state(live, self.about)), flush=True)

    def end(self, live: Live) -> None:
        if live.guide is not None:
            print(json.dumps(state(live, self.about)), flush=True)


@dataclass
class Lines(Display):
    """A line for everything that happens, for files and pipes."""

    _rests: int = 0
    _wrong: int = 0
    _task: str = ""
    _told: set[str] = field(default_factory=set)
    _wrongs: set[str] = field(default_factory=set)  # between the instrument and here, by now

    def show(self, live: Live, ended: bool) -> None:
        words, say = self.about, self.screen.say
        wrong = dict(live.troubles())
        for key in wrong.keys() - self._wrongs:
            say(words.say(key, **wrong[key]))
        self._wrongs = set(wrong)
        guide = live.guide
        if guide is None:
            return
        for item in guide.findings():
            if item.code not in self._told:
                self._told.add(item.code)
                say(f"{item.severity}: {item.message}", f"  {item.cure}")
        for mistake in guide.mistakes[self._wrong :]:
            say(f"  {words.wrong(mistake)}")
        self._wrong = len(guide.mistakes)
        if guide.rests > self._rests:
            self._rests = guide.rests
            worst = max(words.bars(guide), key=lambda row: float(row[4]), default=None)
            if worst is not None and worst[4] < float("inf"):
                say(f"  {worst[0]}: {worst[1]} of {worst[3]}")
        if not guide.stopped and (task := words.task(guide)) != self._task:
            self._task = task
            say(f"{guide.rests + 1}. {task}")


@dataclass
class Picture(Display, Drawn):
    """The guide in the terminal, kept up to date in its place; a bell at the end of a rest."""

    def show(self, live: Live, ended: bool) -> None:
        if ended:
            with suppress(OSError):
                sys.stdout.write("\a")
        self.draw(picture(live, self.about))


def picture(live: Live, words: Words) -> Any:
    """Draw the guide for a terminal."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    width = min(get_terminal_size().columns - 4, 96)
    guide, rows = live.guide, list[Any]()
    rows += [Text(words.say(key, **values), "bold red") for key, values in live.troubles()]
    if guide is None:
        rows.append(Text(words.say("now.learn"), "bold yellow"))
        return Panel(Group(*rows), width=width, subtitle="Ctrl-C ends")
    colour = {"rest": "bold yellow", "next": "bold green", "done": "bold green"}
    rows += [Text(words.task(guide), "bold"), Text("")]
    full = round(BAR * guide.ring)
    rows.append(Text(f"{'●' * full}{'○' * (BAR - full)}  {words.now(guide)}",
                     colour.get(guide.phase, "cyan")))  # fmt: skip
    table = Table(box=None, padding=(0, 1))
    heads = [str(head) for head in words.table["end"]["bars"]]
    for k, head in enumerate((heads[0], "", *heads[1:])):
        table.add_column(head, justify="left" if k < 2 else "right")
    for name, reached, after, wanted, ratio in words.bars(guide):
        table.add_row(name, Text(bar(ratio), "green" if ratio <= 1 else "yellow"), reached, after,
                      wanted)  # fmt: skip
    rows += [Text(""), table]
    rows += [Text(words.wrong(m), "red") for m in guide.recent(2)]
    rows += [Text(f"{f.message} {f.cure}", "red") for f in guide.findings()]
    return Panel(Group(*rows), width=width, title=f"{guide.rests}", subtitle="Ctrl-C ends")


def bar(ratio: float) -> str:
    """Draw what is reached against what is wanted, which is at the mark; `ratio` [1].

    Its length is logarithmic, ten times what is wanted fill it.
    """
    at = BAR // 2
    if not math.isfinite(ratio):
        return "█" * BAR
    full = min(BAR, max(1, round(at * (1 + math.log10(max(ratio, 1e-3))))))
    drawn = "█" * full + "·" * (BAR - full)
    return drawn[:at] + "|" + drawn[at:]
