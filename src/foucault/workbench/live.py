"""Pages of a guided session: an instrument at this computer, and what to do with it next.

The session is a job like any other, `calibrate --live`; its state is a file of its run folder that
the page asks for several times a second. What is guided, and in which words, is said there alone.
"""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response

from foucault.campaign import template
from foucault.capture import frame, ways
from foucault.capture.said import Words, shipped
from foucault.errors import FoucaultError, error
from foucault.files import make_folder, write_text
from foucault.run_folder import ENOUGH_FILE, STATE_FILE
from foucault.workbench.asked import LONG, given_log
from foucault.workbench.bench import KNOWN, At, Bench, Form, Operator, needs, page, to
from foucault.workbench.pages import logs_of
from foucault.workbench.people import Person
from foucault.workbench.store import Job, Number

router = APIRouter(dependencies=[KNOWN])

OWN = "own"
"""Frames that are described in the form."""

RECENT = 40
"""Jobs that are looked through for sessions that are under way [1]."""


def ports() -> list[tuple[str, str]]:
    """Return the serial ports of this computer: name, and what is plugged in."""
    try:
        from serial.tools.list_ports import comports
    except ImportError:
        return []
    return [(one.device, one.description) for one in comports()]


def source_of(who: Person, given: str) -> str:
    """Return a source that may be recorded; raises ``workbench.source``.

    Whoever is no administrator takes the ports of this computer: a file or a server elsewhere
    would be read with the rights of the workbench.
    """
    text = given.strip()
    kind, _, rest = text.partition(":")
    names = {name for name, _ in ports()}
    mine = (kind == "udp" and rest.isdigit() and 1024 <= int(rest) < 65536) or (
        kind == "serial" and bool(names & {rest, rest.rpartition(":")[0]})
    )
    odd = not text or text[0] == "-" or len(text) > LONG or any(ord(c) < 32 for c in text)
    if odd or not (mine or who.may("administrator")):
        raise error("workbench.source", given=text[:80])
    return text


def words_of(bench: Bench, who: Person, said: Any) -> list[str]:
    """Return the words of the job that a form asks for."""

    def text(key: str) -> str:
        return str(said.get(key, "")).strip()

    home = make_folder(bench.folder / "guides")
    words = ["calibrate", f"--live={source_of(who, text('source'))}"]
    how = text("how") or "hand_rotated"
    if "/" in how:
        log = how.partition("/")[2]
        words.insert(1, given_log(bench.folder, log)[0])
    elif how in ways.GUIDED:
        write_text(home / f"{how}.toml", template(how))
        words.insert(1, f"guides/{how}.toml")
    else:
        raise error("guide.procedure", name=how[:40], allowed=", ".join(ways.GUIDED))
    frames = text("frames")
    if frames == OWN:
        own = str(said.get("own", "")).replace("\r\n", "\n")
        frame.parsed(own, "of the form")
        name = f"{hashlib.sha256(own.encode()).hexdigest()[:12]}.frames.toml"
        write_text(home / name, own)
        frames = f"guides/{name}"
    elif frames not in frame.shipped():
        raise error("capture.unknown", name=frames[:40], allowed=", ".join(frame.shipped()))
    words.append(f"--frames={frames}")
    language = text("words") or "en"
    if language != "en":
        Words.of(language if language.isalpha() else "?")
        words.append(f"--words={language}")
    wanted = [w for w in str(said.get("want", "")).splitlines() if w.strip()]
    ways.wants(wanted)
    hold = text("hold")
    for option, value in [*(("--want", w.strip()) for w in wanted), ("--hold", hold)]:
        if len(value) > LONG or any(ord(c) < 32 for c in value):
            raise error("workbench.value", option=option, most=LONG)
        words += [f"{option}={value}"] if value else []
    return [*words, "-o", "runs/{job}"]


@router.get("/live")
def begin(request: Request, bench: At) -> Response:
    """What to record, how, and what is under way."""
    under_way = [job for job in bench.store.jobs(RECENT) if not job.over and is_live(job)]
    campaigns = [(name, files) for name, files in logs_of(bench)
                 if any(f.endswith(".toml") for f in files)]  # fmt: skip
    return page(request, "live.html", ports=ports(), frames=frame.shipped(), ways=ways.GUIDED,
                languages=shipped(), under_way=under_way, campaigns=campaigns,
                own=OWN)  # fmt: skip


@router.post("/live")
def go(said: Form, who: Operator, bench: At) -> Response:
    """Begin a session."""
    words = words_of(bench, who, said)
    job = bench.store.ask(who.name, "calibrate", words)
    return to(f"/live/{job.number}")


def is_live(job: Job) -> bool:
    """Tell whether a job is a guided session."""
    return job.command == "calibrate" and any(w.startswith("--live=") for w in job.words)


def _session(bench: Bench, number: Number) -> Job:
    job = bench.store.job(number)
    if not is_live(job):
        raise error("workbench.no_session", number=number)
    return job


@router.get("/live/{number}")
def guide(request: Request, bench: At, number: Number) -> Response:
    """The guide: what to do, how the instrument is held, what is known by now."""
    job = _session(bench, number)
    name = next((w.partition("=")[2] for w in job.words if w.startswith("--words=")), "en")
    try:
        words = Words.of(name)
    except FoucaultError:
        words = Words.of()
    source = next(w.partition("=")[2] for w in job.words if w.startswith("--live="))
    return page(request, "guide.html", job=job, source=source, side=words.table["side"],
                heads=words.table["end"]["bars"], language=name)  # fmt: skip


@router.get("/live/{number}/state")
def state(bench: At, number: Number) -> Response:
    """What the guide shows by now, as it keeps it, and the state of the job."""
    job = _session(bench, number)
    out: dict[str, Any] = {"job": job.state, "result": job.verdict}
    file: Path = bench.folder / "runs" / str(number) / STATE_FILE
    try:
        out |= json.loads(file.read_text(encoding="utf-8"))
        out["age"] = round(max(0.0, time.time() - file.stat().st_mtime), 1)
    except (OSError, ValueError):
        out |= {"phase": "wait"}
    if job.over and job.state != "done":
        out["said"] = bench.said(job)[-LONG:].strip()
    return JSONResponse(out)


@router.post("/live/{number}/enough")
def enough(request: Request, said: Form, who: Operator, bench: At, number: Number) -> Response:
    """End a session and calibrate what was recorded; that of somebody else is a reviewer's."""
    job = _session(bench, number)
    needs(request, "operator" if job.who == who.name else "reviewer")
    folder = bench.folder / "runs" / str(number)
    if not job.over and folder.is_dir():
        (folder / ENOUGH_FILE).touch()
    return to(f"/live/{number}")
