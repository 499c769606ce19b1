"""A campaign made from a bare log: what `foucault.recognise` took, and what was said beside it."""

from __future__ import annotations

import glob
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foucault import logs
from foucault.campaign.reading import NOWHERE, Campaign, parse
from foucault.campaign.writing import changed, relocate, table_text
from foucault.errors import FoucaultError, error
from foucault.escape import commented
from foucault.files import parse_toml
from foucault.procedures import Progress, silent
from foucault.recognise.reading import SURE, TAKEN, Line, Recognised, question, recognise
from foucault.recognise.session import Session, session
from foucault.run_folder import CAMPAIGN_FILE
from foucault.tables import Log

FILE = "campaign.toml"
"""Where the campaign of a bare log would lie, beside the log."""

MOST = 12
"""Lines that say what was taken [1]."""


@dataclass(frozen=True)
class Found:
    """What a bare log is."""

    recognised: Recognised
    session: Session
    lines: tuple[Line, ...]
    site: Mapping[str, str]  # what is known of the place, as a campaign writes it
    log: Log
    name: str = ""  # of the instrument, where the file is that of a vehicle

    @property
    def head(self) -> str:
        """Remarks that say what was taken, and what is open."""
        known = self.recognised
        said = [f"What {', '.join(p.name for p in known.files)} was taken for, why, and how sure:"]
        said += [f"  {one.what}: {one.took} ({one.sure}: {one.why})" for one in self.lines]
        for open_ in known.questions:
            said += [f"OPEN: {open_.what} One of:", f"  {open_.one}", f"  {open_.other}"]
        return commented(said, "#")

    @property
    def text(self) -> str:
        """The campaign, as it lies beside the log."""
        return self._written(dict(self.recognised.log))

    def log_of(self, campaign: Campaign) -> Log | None:
        """Return the log if `campaign` reads it as it was read here."""
        same = campaign.log.model_dump() == self.recognised.description().model_dump()
        return self.log if same else None

    def beside(self, output: Path | None) -> str:
        """Return the campaign as it is written to `output`, from where its files are found."""
        folder = self.recognised.files[0].parent
        log = json.loads(json.dumps(self.recognised.log))
        if output is not None:
            relocate(log, folder, output.parent)
        return self._written(log)

    def _written(self, log: dict[str, Any]) -> str:
        place, held = dict(self.site), self.session
        note = ""
        if not {"latitude", "gravity"} & place.keys():
            place |= {
                "gravity": f"{NOWHERE.gravity} m/s^2",
                "gravity_sd": f"{NOWHERE.gravity_sd} m/s^2",
            }
            note = "# Write latitude and height instead: gravity then follows from them.\n"
        settings = {"name": held.procedure or "hand_rotated"} | held.settings
        named = [table_text("instrument", {"name": self.name})] if self.name else []
        tables = [*named, table_text("site", place) + note, table_text("log", log),
                  table_text("procedure", settings)]  # fmt: skip
        return "\n\n".join(block.strip() for block in (self.head, *tables)) + "\n"

    @property
    def campaign(self) -> Campaign:
        """The campaign; raises what is open, or why nothing can be calibrated."""
        name = self.recognised.files[0].name
        # What is open may be why nothing can be calibrated, but not of a log without two rests.
        if self.recognised.questions and (self.session.procedure or self.session.rests > 1):
            raise question(self.recognised)
        if self.session.procedure is None:
            raise error("recognise.no_session", file=name, what=self.session.what,
                        why=self.session.why, todo=self.session.todo.format(file=name))  # fmt: skip
        return parse(self.text, self.recognised.files[0].parent / FILE)


def said_of(texts: Sequence[str]) -> dict[str, Any]:
    """Return keys of [log] as ``--set`` has them: TOML lines, several apart by ";"."""
    lines = "\n".join(part for text in texts for part in _parts(text))
    try:
        return parse_toml(lines)
    except tomllib.TOMLDecodeError as problem:
        raise error("recognise.set", given="; ".join(texts), reason=problem) from None


def with_keys(campaign: Campaign, texts: Sequence[str]) -> Campaign:
    """Return a campaign of which keys say something else, as ``--set`` has them with their tables.

    Raises ``campaign.set``: a key without a table.
    """
    said = said_of(texts)
    lacking = [key for key, value in said.items() if not isinstance(value, Mapping)]
    if lacking:
        raise error("campaign.set", given=lacking[0])
    file = campaign.folder / CAMPAIGN_FILE
    return parse(changed(campaign, said, "Some keys by --set."), file)


def _parts(text: str) -> list[str]:
    """Return the assignments in a text; a word gets the quotes of TOML."""
    out = []
    for part in text.split(";"):
        key, equals, value = (one.strip() for one in part.partition("="))
        if equals and ((key.endswith("columns") and '"' not in value) or not _is_toml(value)):
            words = [json.dumps(w.strip()) for w in value.strip("[]").split(",")]
            value = f"[{', '.join(words)}]" if value.startswith("[") else json.dumps(value)
        out.append(f"{key} = {value}" if equals else part.strip())
    return out


def _is_toml(value: str) -> bool:
    try:
        tomllib.loads(f"x = {value}")
    except tomllib.TOMLDecodeError:
        return False
    return True


def site_of(said: Mapping[str, float]) -> dict[str, str]:
    """Return keys of [site] as a campaign writes them; `said`: the same [SI]."""
    unit = {"latitude": "rad", "height": "m", "gravity": "m/s^2"}
    out = {key: f"{value!r} {unit[key]}" for key, value in said.items()}
    if "latitude" in said:
        out["latitude"] = f"{math.degrees(said['latitude']):.10g} deg"
    return out


def found(
    paths: Sequence[Path], said: Mapping[str, Any] | None = None,
    site: Mapping[str, str] | None = None, progress: Progress = silent,
) -> Found:  # fmt: skip
    """Tell what a bare log holds, in one file or several that were recorded together.

    `said`: keys of [log] that are known; `site`: keys of [site], as a campaign writes them.
    """
    folder = {path.parent.resolve() for path in paths}
    if len(folder) > 1:
        raise error("recognise.folders", files=", ".join(map(str, paths)))
    progress(0.05, "reading the log")
    known = recognise(paths, said)
    try:
        description = known.description()
    except (FoucaultError, ValueError) as problem:
        raise error("recognise.set", given=str(dict(said or {})), reason=problem) from None
    progress(0.2, "reading the log")
    log = logs.read(description, paths[0].parent)
    held = session(log)
    where = dict(site or {})
    lines = [*known.lines, Line("session", held.what, held.why, held.sure)]
    if held.procedure:
        lines.append(Line("procedure", held.procedure, "it calibrates such sessions", held.sure))
    if log.gyro is None and (other := _beside(paths[0])):
        lines.append(Line("gyros", "none", f"{other} lies beside it: give both", TAKEN))
    if log.accel is not None and not {"latitude", "gravity"} & where.keys():
        lines.append(Line("place", "unknown", "g is 9.807 +- 0.03 m/s^2, and so is the scale of "
                          "the accelerometers: --latitude, --height", TAKEN))  # fmt: skip
    return Found(known, held, tuple(_shortened(lines)), where, log)


def _beside(path: Path) -> str | None:
    """Return the name of the file of gyros that belongs to one of accelerometers, as named."""
    for one, other in (("acc", "gyr"), ("Acc", "Gyr"), ("ACC", "GYR")):
        stem = path.name.partition(one)
        near = [p.name for p in path.parent.glob(f"{glob.escape(stem[0])}{other}*") if stem[1]]
        if len(near) == 1:
            return near[0]
    return None


def _shortened(lines: list[Line]) -> list[Line]:
    """Return at most `MOST` lines: of what is sure the last go first."""
    while len(lines) > MOST:
        sure = [i for i, line in enumerate(lines) if line.sure == SURE]
        lines.pop(sure[-1] if sure else -1)
    return lines
