"""What goes wrong between an instrument and a session, told while it happens."""

from __future__ import annotations

from typing import Any, NamedTuple

from foucault.capture.prints import READABLE, text_in
from foucault.capture.recording import Recording

QUIET = 2.0
"""Silence that is told [s]."""

ENOUGH = 2000
"""Bytes in which there should have been a frame [bytes]."""

PART = 0.3
"""Part of the bytes that frames with wrong checksums make, where the rate of the port is right."""

FEW = 5
"""So many frames may be broken before it is told [1]."""


class Trouble(NamedTuple):
    """One thing that is wrong: a key of the words, and what fills them."""

    key: str
    values: dict[str, Any]


def troubles(recording: Recording, silence: float) -> list[Trouble]:
    """Return what is wrong now; `silence`: since something came [s]."""
    heard, out = recording.heard, list[Trouble]()
    if silence > QUIET:
        out.append(Trouble("now.silent", {"seconds": silence}))
    counts = {"broken": heard.broken, "frames": heard.frames + heard.broken}
    if heard.frames:
        if heard.broken > max(FEW, heard.frames / 20):
            out.append(Trouble("trouble.broken", counts))
    elif recording.size > ENOUGH:
        length = recording.frame.length
        long = length if isinstance(length, int) else ENOUGH // 100
        if heard.others > FEW:
            out.append(Trouble("trouble.others", {}))
        elif recording.frame.line is None and text_in(recording.start) > READABLE:
            out.append(Trouble("trouble.text", {}))
        elif heard.broken * long > PART * recording.size or recording.frame.line is not None:
            out.append(Trouble("trouble.broken", counts))
        else:
            out.append(Trouble("trouble.no_frame", {"size": recording.size}))
    if heard.lost > max(FEW, (heard.frames + heard.lost) / 100):
        out.append(Trouble("trouble.lost", {"lost": heard.lost, "frames": heard.frames}))
    if heard.reopened:
        out.append(Trouble("trouble.reopened", {"count": heard.reopened}))
    if recording.slept:
        out.append(Trouble("trouble.slept", {"seconds": recording.slept}))
    if recording.absurd is not None:
        out.append(Trouble("trouble.absurd", {"size": recording.absurd}))
    return out
