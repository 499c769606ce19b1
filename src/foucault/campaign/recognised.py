"""A campaign made from a bare log: what `foucault.recognise` took, and what was said beside it."""

from __future__ import annotations

import glob
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from foucault import logs
from foucault.campaign.reading import NOWHERE, Campaign, parse
from foucault.campaign.tables import CampaignFile
from foucault.campaign.writing import changed, relocate, table_text
from foucault.errors import FoucaultError, error
from foucault.escape import commented
from foucault.files import said_in
from foucault.logs import pose
from foucault.procedures import Progress, silent
from foucault.recognise.reading import (
    SURE,
    TAKEN,
    Line,
    Question,
    Recognised,
    question,
    recognise,
)
from foucault.recognise.session import Session, session
from foucault.run_folder import CAMPAIGN_FILE
from foucault.tables import Log

FILE = "campaign.toml"  # Where the campaign of a bare log would lie, beside the log.
MOST = 12  # Lines that say what was taken [1].


@dataclass(frozen=True)
class Found:
    """What a bare log is."""

    recognised: Recognised
    session: Session
    lines: tuple[Line, ...]
    site: Mapping[str, str]  # what is known of the place, as a campaign writes it
    log: Log
    name: str = ""  # of the instrument, where the file is that of a vehicle
    master: Mapping[str, Any] | None = None  # how to read what the instrument is compared with

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
        return self._written(self._files)

    def log_of(self, campaign: Campaign) -> Log | None:
        """Return the log if `campaign` reads it as it was read here."""
        same = campaign.log.model_dump() == self.recognised.description().model_dump()
        return self.log if same else None

    def beside(self, output: Path | None) -> str:
        """Return the campaign as it is written to `output`, from where its files are found."""
        folder = self.recognised.files[0].parent
        files = json.loads(json.dumps(self._files))
        if output is not None:
            relocate(files, folder, output.parent)
        return self._written(files)

    @property
    def _files(self) -> dict[str, Any]:
        """Tables that name files."""
        master = {} if self.master is None else {"master": dict(self.master)}
        return {"log": dict(self.recognised.log)} | master

    def _written(self, files: dict[str, Any]) -> str:
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
        tables = [*named, table_text("site", place) + note,
                  *(table_text(key, said) for key, said in files.items()),
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
    return said_in(lines, "recognise.set", given="; ".join(texts))


def with_keys(campaign: Campaign, texts: Sequence[str]) -> Campaign:
    """Return a campaign of which keys say something else, as ``--set`` has them with their tables.

    Raises ``campaign.set``: a key without a table.
    """
    said = said_of(texts)
    lacking = [key for key, value in said.items() if not isinstance(value, Mapping)]
    if lacking:
        one, table = lacking[0], lacking[0] in CampaignFile.model_fields
        example = f"{one}.key" if table else f"procedure.{one} or simulate.{one}"
        what = "a table and no key" if table else "no table"
        raise error("campaign.set", given=one, what=what, example=example)
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
    beside = _beside_it(paths)
    known = recognise(paths if beside is None else [p for p in paths if p != beside[0]], said)
    try:
        description = known.description()
    except (FoucaultError, ValueError) as problem:
        raise error("recognise.set", given=str(dict(said or {})), reason=problem) from None
    progress(0.2, "reading the log")
    log = logs.read(description, paths[0].parent)
    held = session(log)
    if beside is not None:
        path, held, master = beside
        asked = (*_unit_of_motion(known, said or {}), *master.questions)
        known = replace(known, files=(*known.files, path), questions=known.questions + asked)
    where = dict(site or {})
    lines = [*known.lines, Line("session", held.what, held.why, held.sure)]
    if held.procedure:
        lines.append(Line("procedure", held.procedure, "it calibrates such sessions", held.sure))
    if log.gyro is None and (other := _beside(paths[0])):
        lines.append(Line("gyros", "none", f"{other} lies beside it: give both", TAKEN))
    if log.accel is not None and not {"latitude", "gravity"} & where.keys():
        lines.append(Line("place", "unknown", "g is 9.807 +- 0.03 m/s^2, and so is the scale of "
                          "the accelerometers: --latitude, --height", TAKEN))  # fmt: skip
    while len(lines) > MOST:
        sure = [i for i, line in enumerate(lines) if line.sure == SURE]
        lines.pop(sure[-1] if sure else -1)
    return Found(known, held, tuple(lines), where, log,
                 master=None if beside is None else master.log)  # fmt: skip


def _beside_it(paths: Sequence[Path]) -> tuple[Path, Session, Recognised] | None:
    """Return which of two files tells of the same motion: poses of the body, or a second IMU."""
    if len(paths) != 2:
        return None
    for path in paths:
        said = pose.PoseDescription.model_validate({"file": path.name})
        with suppress(FoucaultError):
            if pose.read(said, path.parent).quaternion is not None:
                why = f"{path.name} says where the body was"
                held = Session("motion beside poses", why, "imu_pose")
                return path, held, Recognised((path,), {"file": path.name}, ())
    with suppress(FoucaultError):
        one, other = (recognise([path]) for path in paths)
        if all(each.described or {"accel", "gyro"} <= each.log.keys() for each in (one, other)):
            why = (
                f"{paths[1].name} is the one to compare with; the other order, the other way round"
            )
            held = Session("two IMUs moved together", why, "two_imus", sure=TAKEN)
            return paths[1], held, other
    return None


def _unit_of_motion(known: Recognised, said: Mapping[str, Any]) -> tuple[Question, ...]:
    """Ask for the unit of accelerometers that no title says: a body that is moved does not rest."""
    scale = known.log.get("accel", {}).get("scale")
    if scale is None or "scale" in said.get("accel", {}):
        return ()
    what = f"'{known.files[0].name}' has no unit of its accelerometers, and nothing rests."
    return (Question(what, 'accel.unit = "m/s^2"', "as is usual", f'accel.scale = "{scale}"',
                     "as their length says, were it at rest"),)  # fmt: skip


def _beside(path: Path) -> str | None:
    """Return the name of the file of gyros that belongs to one of accelerometers, as named."""
    for one, other in (("acc", "gyr"), ("Acc", "Gyr"), ("ACC", "GYR")):
        stem = path.name.partition(one)
        near = [p.name for p in path.parent.glob(f"{glob.escape(stem[0])}{other}*") if stem[1]]
        if len(near) == 1:
            return near[0]
    return None
