"""From the text of a campaign file to a `Campaign` in SI."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from foucault import procedures, units
from foucault.campaign import earlier
from foucault.campaign.tables import (
    CampaignFile,
    PriorEntry,
    SimulateTable,
    all_finite,
    countable,
    file_with,
    joined,
    kind_of_group,
    parse_at,
    validate,
)
from foucault.coefficients import Layout
from foucault.errors import Finding, error, require, suggestion
from foucault.files import read_text, said_in
from foucault.logs.description import LogDescription
from foucault.logs.layout import FileLayout
from foucault.models import earth, noise
from foucault.models.left_out import Sizes
from foucault.procedures.record import Procedure
from foucault.units import STANDARD_GRAVITY

NOWHERE = earth.Site(STANDARD_GRAVITY, gravity_source="none", gravity_sd=0.03)
"""Somewhere on Earth, for what needs no place: the noise of a log, or what is in it [SI]."""


@dataclass(frozen=True)
class Campaign:
    """A campaign file as read: everything in SI."""

    path: Path  # the file; relative paths in it start from its folder
    text: str  # the file as it was, kept in the run folder
    instrument: dict[str, Any]  # name, serial number, operator, note
    site: earth.Site  # where it was calibrated [SI]
    log: Any  # how to read the log: a LogDescription, or what the procedure has instead
    master: Any  # how to read the table of a master, where the procedure has one
    procedure: str  # its name
    settings: Any  # of the procedure [SI]
    noise: noise.ImuNoise | None  # [SI]; None where the procedure estimates it
    prior: dict[str, tuple[float, float]]  # mean and sd of coefficients or groups [SI]
    simulate: SimulateTable  # which instrument to simulate
    session: Any  # what to do with it in a simulation, as the procedure defines it [SI]
    wanted: Any  # what a better plan may do, where the procedure has a plan to improve [SI]
    tables: CampaignFile  # the common tables as written, with defaults
    earlier: earlier.EarlierTable | None = None  # an earlier result that is its prior
    # of what is not estimated, and what that rests on [SI]; None where nothing is said of it
    sizes: Sizes | None = None
    findings: tuple[Finding, ...] = ()  # what was noticed in the file

    @property
    def imu_log(self) -> LogDescription:
        """How to read the log of an IMU; refused where it is that of a north seeker."""
        if not isinstance(self.log, LogDescription):
            raise error("north.not_imu", procedure=self.procedure)
        return self.log

    @property
    def folder(self) -> Path:
        """Folder that relative paths in the file start from."""
        return self.path.parent


def load(path: str | Path, *, calibrates: bool = True) -> Campaign:
    """Read a campaign file; the first mistake in it is raised with its full dotted key.

    Parameters
    ----------
    path : str or Path
        The TOML file.
    calibrates : bool
        Whether it must name a procedure and a site; what reads only its log and noise needs none.
    """
    require("path", path, PathLike, str)
    return parse(
        text_of(Path(path), "campaign.missing", "campaign.syntax"), path, calibrates=calibrates
    )


def text_of(path: Path, missing: str, unread: str) -> str:
    """Return the text of a file, or raise `missing` with the files there are instead, `unread`."""
    try:
        return read_text(path)
    except OSError as problem:
        if path.is_file():
            raise error(unread, path=path, reason=problem) from None
    if path.is_dir():
        names = ", ".join(sorted(p.name for p in path.glob("*.toml"))[:3])
        hint = " It is a folder" + (f"; in it is {names}." if names else ".")
    else:
        near = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        hint = suggestion(path.name, near)
    raise error(missing, path=path, hint=hint)


def parse(text: str, path: str | Path = "campaign.toml", *, calibrates: bool = True) -> Campaign:
    """Read a campaign from `text`; `path` is where it would lie, the others as for `load`."""
    path = Path(path)
    code = "campaign.syntax" if path.suffix.lower() == ".toml" else "campaign.other_file"
    raw = said_in(text, code, path=path, name=path.name)
    if not raw:
        raise error("campaign.empty", path=path)
    if not calibrates:  # what a log is like does not hang on which procedure it is read for
        raw.setdefault("procedure", {"name": "hand_rotated"})
    raw, before = earlier.split(raw)
    all_finite(raw)
    file = validate(_model(raw), raw)
    name = file.procedure.get("name")
    if calibrates and isinstance(file.log, LogDescription):
        file.log.whole()
    if name is None:
        example = f'name = "{next(iter(procedures.PROCEDURES))}"'
        raise error("campaign.required", key="procedure.name", example=example, more="")
    procedure = procedures.load(str(name))
    settings = {k: v for k, v in file.procedure.items() if k != "name"}
    common = {k: v for k, v in file.simulate.items() if k in SimulateTable.model_fields}
    session = {k: v for k, v in file.simulate.items() if k not in common}
    common = {"grade": procedure.grade} | common
    master = _master(procedure, file.master)
    told = validate(procedure.Settings, settings, ("procedure",), ("name",))
    simulated = validate(procedure.Session, session, ("simulate",), SimulateTable.model_fields)
    countable(told, ("procedure",))
    countable(simulated, ("simulate",))
    return Campaign(
        path=path,
        text=text,
        instrument=file.instrument.named(),
        sizes=file.instrument.sizes(),
        site=file.site.site() if calibrates or file.site.said else NOWHERE,
        log=file.log,
        master=master,
        procedure=str(name),
        settings=told,
        noise=None if file.noise is None else file.noise.noise(),
        prior={key: _prior(key, entry, procedure.layout) for key, entry in file.prior.items()},
        simulate=validate(SimulateTable, common, ("simulate",)),
        session=simulated,
        wanted=_wanted(procedure, file.optimise),
        tables=file,
        earlier=before,
        findings=file.site.findings(),
    )


def said_otherwise(
    campaign: Campaign, changes: Mapping[str, Any], instead: Collection[str] = ()
) -> Campaign:
    """Return a campaign whose [procedure] says something else.

    `changes`: keys and what they shall say, as in the file; `instead`: keys that these replace.
    """
    if not changes:
        return campaign
    procedure = procedures.load(campaign.procedure)
    kept = {k: v for k, v in campaign.tables.procedure.items() if k not in ("name", *instead)}
    settings = validate(procedure.Settings, kept | dict(changes), ("procedure",), ("name",))
    return replace(campaign, settings=settings)


def _master(procedure: Procedure[Any, Any], table: Mapping[str, Any]) -> Any:
    """Read [master]; refused where the procedure has none, wanted where it has."""
    if procedure.Master is None and table:
        raise error("campaign.no_master", procedure=procedure.name)
    if procedure.Master is not None and not table:
        raise error("campaign.required", key="master", example="a table [master]", more="")
    return None if procedure.Master is None else validate(procedure.Master, table, ("master",))


def _wanted(procedure: Procedure[Any, Any], table: Mapping[str, Any]) -> Any:
    """Read [optimise]; refused where the procedure has no plan to improve."""
    if procedure.Wanted is not None:
        weights = table.get("weights")
        weighted = {"weights": joined(weights)} if isinstance(weights, Mapping) else {}
        return validate(procedure.Wanted, {**table, **weighted}, ("optimise",))
    if table:
        able = ", ".join(improvable())
        raise error("optimise.procedure", procedure=procedure.name, able=able)
    return None


def improvable() -> tuple[str, ...]:
    """Return the names of the procedures whose plan can be searched for."""
    return tuple(n for n in procedures.PROCEDURES if procedures.load(n).space is not None)


def _model(raw: dict[str, Any]) -> type[CampaignFile]:
    """Return the model of a campaign file: some procedures have a [log] of their own."""
    procedure = raw.get("procedure")
    name = procedure.get("name") if isinstance(procedure, dict) else None
    known = isinstance(name, str) and name in procedures.PROCEDURES
    return file_with(procedures.load(str(name)).Description if known else LogDescription)


SURE = 1e-9  # No instrument is known to so small a part of the smallest unit that people use [1].


def _prior(name: str, entry: PriorEntry, layout: Layout) -> tuple[float, float]:
    kind = kind_of_group(name, layout)
    mean = parse_at(f'prior."{name}".mean', entry.mean, kind)
    sd = parse_at(f'prior."{name}".sd', entry.sd, kind)
    if not sd > 0:
        raise error("prior.sd", name=name, given=repr(entry.sd))
    least, most = (units.factor(units.KINDS[kind].display[i], kind) for i in (0, -1))
    # Squares of what is a billionth of the usual unit are lost beside any other variance.
    if not least * SURE <= sd <= most / SURE:
        raise error("prior.sure", name=name, given=repr(entry.sd))
    return mean, sd


def schema() -> dict[str, Any]:
    """Return the JSON schema of campaign files, with the settings of every procedure."""
    out = CampaignFile.model_json_schema()
    settings, sessions, wanted, masters = [], [], [], []
    for name in procedures.PROCEDURES:
        procedure = procedures.load(name)
        own = _part(out, procedure.Settings, f"Settings of {name}")
        own["properties"] = {"name": {"const": name}} | own.get("properties", {})
        own["required"] = ["name", *own.get("required", [])]
        settings.append(own)
        session = _part(out, procedure.Session, f"Simulated session of {name}")
        common = _part(out, SimulateTable, "")
        session["properties"] = common["properties"] | session.get("properties", {})
        sessions.append(session)
        if procedure.Wanted is not None:
            wanted.append(_part(out, procedure.Wanted, f"Plan to search for, of {name}"))
        if procedure.Master is not None:
            masters.append(_part(out, procedure.Master, f"Master of {name}"))
    logs = list(dict.fromkeys(procedures.load(n).Description for n in procedures.PROCEDURES))
    if len(logs) > 1:
        out["properties"]["log"] = {"anyOf": [_part(out, log, _title(log)) for log in logs]}
    out["properties"]["procedure"] = {"oneOf": settings}
    out["properties"]["simulate"] = {"anyOf": sessions}
    out["properties"]["optimise"] = {"anyOf": wanted}
    out["properties"]["master"] = {"anyOf": masters}
    out["properties"]["prior"]["properties"] = _part(out, earlier.EarlierTable, "")["properties"]
    out["title"] = "Foucault campaign"
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | out


def _title(log: type[FileLayout]) -> str:
    users = [n for n in procedures.PROCEDURES if procedures.load(n).Description is log]
    return f"Log of {', '.join(users)}"


def _part(schema: dict[str, Any], model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the schema of `model`, its definitions moved to those of `schema`."""
    part = model.model_json_schema()
    schema.setdefault("$defs", {}).update(part.pop("$defs", {}))
    return part | {"title": title}
