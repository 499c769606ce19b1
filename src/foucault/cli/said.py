"""What commands have said of a log on this terminal, so that the next does not say it again."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

FORGOTTEN = 3600.0  # What was said is said again after this [s].

FILE = "said.json"


def as_before(log: str, command: str, sentences: Sequence[str]) -> dict[str, str]:
    """Return which sentences another command has said of a log lately, and which command.

    `log`: hash of its content. What this command says is kept for the next; a command that is run
    again says all of it again.
    """
    import platformdirs

    file = Path(platformdirs.user_cache_dir("foucault")) / FILE
    marks = {s: sha256(f"{log}{s}".encode()).hexdigest()[:16] for s in sentences}
    kept = _kept(file)
    out = {s: kept[m][0] for s, m in marks.items() if m in kept and kept[m][0] != command}
    kept |= {m: (command, time.time()) for s, m in marks.items() if s not in out}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(kept), encoding="utf-8")
    except OSError:  # then it is said once more
        pass
    return out


def _kept(file: Path) -> dict[str, tuple[str, float]]:
    """Return what was said not long ago: which command, and when [s], by a mark of the sentence."""
    try:
        held = json.loads(file.read_text(encoding="utf-8"))
        return {m: (c, t) for m, (c, t) in held.items() if 0 <= time.time() - t < FORGOTTEN}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
