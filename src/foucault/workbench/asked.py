"""What somebody asks for on a page or over HTTP, as the words of a command line.

Only what is offered can be asked for, and no option names a file but of the workbench: a log that
was sent in, or what a job has written.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from foucault.campaign.recognised import said_of
from foucault.errors import error, suggestion
from foucault.files import parse_toml, read_text


@dataclass(frozen=True)
class Option:
    """An option of a command, as its form has it."""

    name: str  # with its dashes
    said: str
    choices: tuple[str, ...] = ()
    default: str = ""
    flag: bool = False
    many: bool = False
    path: bool = False
    needed: bool = False

    @property
    def title(self) -> str:
        """Return its name in words."""
        return self.name.lstrip("-").partition("/")[0].replace("-", " ").capitalize()


@dataclass(frozen=True)
class Offer:
    """A command that can be asked for: what it takes, and what it leaves."""

    title: str
    what: str  # in a sentence
    takes: str  # "log", "run", "runs" or "procedure"
    writes: str = "runs/{job}"  # to where; empty: it only says something
    first: tuple[str, ...] = ()  # options that are seen at once
    without: tuple[str, ...] = ()  # options that make no sense here
    also: tuple[str, ...] = ()  # words that are always said


PLACE = ("--latitude", "--height", "--gravity")

OFFERS: dict[str, Offer] = {
    "calibrate": Offer("Calibrate", "The errors of the instrument, with a verdict.", "log",
                       first=(*PLACE, "--set")),
    "align": Offer("Align", "Heading, pitch and roll of a log at rest.", "log", "",
                   ("--latitude", "--height", "--calibration", "--gyro-bias-sd", "--method")),
    "north": Offer("Find north", "Heading of every set-up of a north seeker.", "log",
                   first=("--latitude", "--calibration", "--accuracy")),
    "navigate": Offer("Navigate", "The path with and without a calibration.", "log",
                      first=("--latitude", "--longitude", "--calibration", "--reference",
                             "--align")),
    "allan": Offer("Noise", "Random walks and instability of a log at rest.", "log",
                   first=("--axis", "--rest", "--set"), without=("--column", "--unit", "--rate")),
    "export": Offer("Export", "The result in the form of another program.", "run",
                    "runs/{job}/{name}", ("--to", "--axes", "--drop"), ("--force",)),
    "apply": Offer("Apply", "Take the errors out of a log.", "run", "runs/{job}/corrected.csv",
                   ("--outside",), ("--force", "--stream")),
    "compare": Offer("Compare", "What differs between runs, and by how much.", "runs",
                     first=("--tolerance",)),
    "preflight": Offer("Preflight", "What a session will show, before it is made.", "procedure",
                       "runs/{job}/expected.csv", ("--plan", "--rate", "--segment"),
                       ("--steps",), ("--steps=runs/{job}/operator.html",)),
    "optimise": Offer("Optimise", "A plan that shows more, within the limits of the rig.",
                      "procedure", first=("--restarts", "--time-limit"),
                      without=("--workers", "--scheduler", "--local-cluster", "--round")),
}  # fmt: skip
"""Command -> what it is as an offer."""

PLANNED = frozenset(("procedure", "simulate", "site", "optimise"))
"""Tables of which a plan without a log may say something."""

LOG = re.compile(r"[0-9a-f]{12}")
_FOUND = re.compile(r"runs/\d{1,9}/campaign\.toml")
"""A plan that was found can be looked at as a procedure can."""

_OWN = re.compile(r"runs/\d{1,9}|logs/[0-9a-f]{12}/[^/\\\0]+")

LONG, LONGEST = 2000, 40_000
"""Letters of a value at most, and of what --set is given, which may name many rests [1]."""


def shown(words: Sequence[str]) -> str:
    """Return a command line to copy."""
    parts = []
    for word in words:
        name, equals, value = word.partition("=")
        split = name.startswith("--") and equals
        parts += [name, _quoted(value)] if split else [_quoted(word)]
    return " ".join(["foucault", *parts])


def _quoted(word: str) -> str:
    word = re.sub(r"(://[^:/@\s]+):[^@/\s]+@", r"\1:...@", word)  # no password is shown
    plain = re.search(r"[\"\\$`!]", word)
    return f'"{word}"' if " " in word and not plain else shlex.quote(word)


def inside(folder: Path, text: str) -> str:
    """Return the name of a file or run of the workbench; what lies elsewhere is refused."""
    if not _OWN.fullmatch(text) or ".." in PurePosixPath(text).parts or \
            not (folder / text).exists():  # fmt: skip
        raise error("workbench.outside", given=text)
    return text


def stays(where: Path, value: Any) -> None:
    """Refuse a table in which a text names something outside the folder of its log."""
    if isinstance(value, Mapping):
        for one in value.values():
            stays(where, one)
    elif isinstance(value, list):
        for one in value:
            stays(where, one)
    elif isinstance(value, str) and "\0" not in value:
        home = where.resolve()
        if value.startswith("~") or not (home / value).resolve().is_relative_to(home):
            raise error("workbench.outside", given=value[:80])


def files_of(folder: Path, log: str) -> list[Path]:
    """Return the files of a log, a campaign first; raises ``workbench.no_log``."""
    where = folder / "logs" / log
    if not LOG.fullmatch(log) or not where.is_dir():
        raise error("workbench.no_log", given=log[:40])
    found = sorted(p for p in where.iterdir() if p.is_file() and not p.name.startswith("."))
    return sorted(found, key=lambda p: p.suffix.lower() != ".toml")


def given_log(folder: Path, log: str) -> list[str]:
    """Return the words that name a log: its campaign, or its files."""
    found = files_of(folder, log)
    named = found[:1] if found and found[0].suffix.lower() == ".toml" else found
    return [p.relative_to(folder).as_posix() for p in named]


def check_campaign(file: Path) -> None:
    """Refuse a campaign that names files of others; one that cannot be read is for its reader."""
    try:
        said = parse_toml(read_text(file))
    except (OSError, ValueError):
        return
    stays(file.parent, said)


def words_of(
    folder: Path, command: str, options: Sequence[Option], given: Mapping[str, Sequence[str]], *,
    log: str = "", runs: Sequence[str] = (), name: str = "",
) -> list[str]:  # fmt: skip
    """Return the words of a command that is offered.

    `given`: option -> what was said; `log`: of "log" and, for `apply`, of "run"; `runs`: folders;
    `name`: of a procedure, or of the file that `export` writes.
    """
    offer = OFFERS.get(command)
    if offer is None:
        raise error("workbench.offer", given=command[:40], allowed=", ".join(OFFERS))
    words = [command]
    if offer.takes == "log":
        words += given_log(folder, log)
    elif offer.takes == "procedure":
        found = _FOUND.fullmatch(name) and (folder / name).is_file()
        words.append(name if found else _procedure(name))
    else:
        if not runs or (offer.takes == "runs" and len(runs) < 2):
            raise error("workbench.few_runs", command=command)
        words += [inside(folder, run) for run in runs]
        words += given_log(folder, log) if log else []
    known = {one.name: one for one in options if one.name not in offer.without}
    for key, values in given.items():
        option = known.get(key)
        if option is None:
            raise error("workbench.option", given=key[:40], command=command,
                        hint=suggestion(key, known))  # fmt: skip
        words += _said(folder, option, values, log)
    if offer.writes:
        words += ["-o", offer.writes.replace("{name}", safe_name(name or "calibration.txt"))]
    words += offer.also
    return words


def _procedure(name: str) -> str:
    from foucault.procedures import PROCEDURES

    if name not in PROCEDURES:
        raise error("workbench.procedure", given=name[:40], hint=suggestion(name, PROCEDURES))
    return name


def _said(folder: Path, option: Option, values: Sequence[str], log: str) -> list[str]:
    """Return the words of an option; nothing where nothing was written."""
    texts = [v.strip() for v in values if v.strip()]
    most = LONGEST if option.name == "--set" else LONG
    if any(len(t) > most or any(ord(c) < 32 for c in t) for t in texts):
        raise error("workbench.value", option=option.name, most=most)
    if option.flag:
        return [option.name] if texts else []
    if option.path:
        texts = [inside(folder, t) for t in texts]
    if option.name == "--set" and texts:
        said = said_of(texts)
        stays(folder / "logs" / log, said)
        others = [] if log else sorted(said.keys() - PLANNED)  # none of those names a file
        if others:
            raise error("workbench.option", given=f"--set {others[0]}"[:40], command="a plan",
                        hint=f" Keys of {', '.join(sorted(PLANNED))} can be set.")  # fmt: skip
    return [f"{option.name}={t}" for t in (texts if option.many else texts[:1])]


def safe_name(text: str) -> str:
    """Return a name of a file from what somebody calls one: no folder, no sign with a meaning."""
    last = re.split(r"[/\\]", text)[-1]
    kept = re.sub(r"[^\w.+@()=-]+", "_", last, flags=re.ASCII).strip("._-") or "log"
    stem, dot, end = kept.partition(".")
    return f"{stem[:80]}{dot}{end[-20:]}"
