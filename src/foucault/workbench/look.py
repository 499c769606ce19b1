"""A first look at a log: what it was taken for, how sure, and what may be said instead."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from foucault.campaign import reading, running
from foucault.campaign.recognised import Found, found, said_of
from foucault.diagnose import live
from foucault.errors import FoucaultError
from foucault.files import make_folder, write_text
from foucault.recognise.opening import opened
from foucault.report import noise, save
from foucault.run_folder import REPORT_FILE
from foucault.tables import Log

FILE = "look.json"

Tell = Callable[[float, str], None]


def look(words: Sequence[str], tell: Tell) -> int:
    """Do what `inspect` does, with its words, and keep what was recognised beside its page.

    `words`: "inspect", files, "--set=...", "--plots=FOLDER/report.html".
    """
    files = [Path(w) for w in words[1:] if not w.startswith("--")]
    folder = Path(next(w for w in words if w.startswith("--plots=")).partition("=")[2]).parent
    make_folder(folder)
    said = said_of([w.partition("=")[2] for w in words if w.startswith("--set=")])
    out: dict[str, Any] = {"files": [p.name for p in files], "titles": []}
    log: Log | None = None
    try:
        if files[0].suffix.lower() == ".toml":
            log, campaign = running.read_any(files[0], tell)
            out |= {"procedure": None if campaign is None else campaign.procedure}
        else:
            held = found(files, said, None, tell)
            out |= _taken(held)
            log = held.log
    except FoucaultError as problem:
        if problem.code == "north.not_imu":  # nothing of it is drawn, and all can be done with it
            out |= {"procedure": reading.load(files[0], calibrates=False).procedure}
        else:
            out["problem"] = {"message": problem.message, "cure": problem.cure}
            out["titles"] = _titles(files)
    if log is not None:
        tell(0.6, "drawing")
        log, start = log.from_start()
        try:
            seen = live.inspect(log)
            save(noise.inspected(seen, start), folder / REPORT_FILE)
            out["findings"] = [f.as_dict() for f in seen.findings]
            out |= _rests(seen)
        except FoucaultError as problem:
            out.setdefault("problem", {"message": problem.message, "cure": problem.cure})
    write_text(folder / FILE, json.dumps(out, allow_nan=False, default=str))
    return 0


TITLES = 200
"""Of columns that are shown [1]."""

POINTS = 500
"""Of a trace that is drawn [1]."""


def _rests(seen: live.Inspection) -> dict[str, Any]:
    """Return the rests, first and last sample from the start [s], and traces to move them on."""
    log, rests = seen.log, seen.rests
    x = log.accel if log.accel is not None else log.gyro
    if x is None or log.averaged is not None or len(log) < 2:
        return {}
    kept = x[:: max(1, len(x) // POINTS)]
    low, high = np.nanmin(kept), np.nanmax(kept)
    drawn = 100.0 - 100.0 * (kept - low) / max(high - low, 1e-300)
    step = 1000.0 / max(len(kept) - 1, 1)
    lines = [
        " ".join(f"{k * step:.1f},{y:.1f}" for k, y in enumerate(axis) if y == y)
        for axis in drawn.T.tolist()
    ]
    spans = [
        (round(float(log.time[a]), 6), round(float(log.time[b - 1]), 6))
        for (a, b), turns in zip(rests.spans, seen.turning, strict=True) if not turns
    ]  # fmt: skip
    return {"rests": spans, "trace": lines, "end": log.duration}


def _taken(held: Found) -> dict[str, Any]:
    known, session = held.recognised, held.session
    return {
        "titles": list(known.titles[:TITLES]),
        "lines": [line.as_dict() for line in held.lines],
        "questions": [asdict(q) for q in known.questions],
        "log": known.log,
        "described": known.described,
        "procedure": session.procedure,
        "session": session.what,
        "todo": "" if session.procedure else session.todo.format(file=known.files[0].name),
    }


def _titles(files: Sequence[Path]) -> list[str]:
    """Return the titles of the columns of bare logs, as far as they can be told."""
    out: list[str] = []
    for file in files:
        if file.suffix.lower() != ".toml":
            try:
                raw = opened(file).raw
                out += [str(name) for name in getattr(raw, "names", ())]
            except (FoucaultError, OSError, ValueError):
                pass
    return out[:TITLES]
