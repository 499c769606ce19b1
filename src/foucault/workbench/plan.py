"""Pages before a session: its procedure, what of it can be chosen, and the list to go by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Literal, get_args, get_origin

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel

from foucault.campaign.reading import improvable
from foucault.campaign.tables import SiteTable
from foucault.campaign.writing import default_text, sample
from foucault.models.noise import GRADES
from foucault.procedures import PROCEDURES, load
from foucault.run_folder import CAMPAIGN_FILE
from foucault.strict import description_of
from foucault.workbench.actions import ask
from foucault.workbench.asked import shown
from foucault.workbench.bench import KNOWN, At, Form, Operator, page, to
from foucault.workbench.pages import FRAMED, file_left
from foucault.workbench.store import Number

router = APIRouter(dependencies=[KNOWN])

LIST = "operator.html"

RIG = {"plan", "positions", "sequence", "start", "rate", "rates", "segment", "axes", "spin_rate",
       "both_senses", "four_positions", "ramp"}  # fmt: skip
ENDS = ("_limit", "_range", "_step")
"""Keys of [procedure], and ends of keys, that say what a rig does and can."""


@dataclass(frozen=True)
class Choice:
    """A key of a campaign in a form."""

    key: str  # with its table
    said: str
    usual: str  # what it is where nothing is written
    choices: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Return its name in words."""
        return self.key.partition(".")[2].replace("_", " ").capitalize()


def choices_of(model: type[BaseModel], table: str) -> list[Choice]:
    """Return the keys of a table."""

    def plain(text: str) -> str:
        return str(json.loads(text)) if text.startswith('"') else text

    out = []
    for key, field in model.model_fields.items():
        usual = default_text(field)
        words = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
        if field.annotation is bool:
            words = ("true", "false")
        usual = f"none, such as {plain(sample(field))}" if usual is None else plain(usual)
        said = description_of(model, key).removeprefix("Planning. ").replace("`", "")
        out.append(Choice(f"{table}.{key}", said, usual[:120], tuple(map(str, words))))
    return out


@router.get("/plan")
def plan(request: Request) -> Response:
    """Which procedures there are."""
    told = {name: load(name).summary for name in PROCEDURES}
    return page(request, "plan.html", procedures=told)


@router.get("/plan/{name}")
def planned(request: Request, name: str) -> Response:
    """What can be chosen of a session and of the rig."""
    procedure = load(name)
    settings = choices_of(procedure.Settings, "procedure")
    session = choices_of(procedure.Session, "simulate")
    rig = [c for c in settings if c.key.endswith(ENDS) or c.key.partition(".")[2] in RIG]
    place = [c for c in choices_of(SiteTable, "site") if c.key.endswith(("latitude", "height"))]
    grades = Choice("simulate.grade", "Class of the instrument, whose noise is reckoned with.",
                    procedure.grade, tuple(GRADES))  # fmt: skip
    done = [c for c in session if not c.key.endswith("_sd")]
    rest = [c for c in (*settings, *session) if c not in rig and c not in done]
    return page(
        request, "planned.html", name=name, what=procedure.summary, more=rest,
        searched=name in improvable(),
        groups=[("What is done", done), ("Rig and limits", rig),
                ("Instrument and place", [grades, *place])],
        line=shown(["preflight", name, "--steps", LIST]),
    )  # fmt: skip


@router.post("/plan/{name}")
def foresee(said: Form, who: Operator, bench: At, name: str) -> Response:
    """Ask what a session will show, or search for one that shows more."""
    told = [f"{key} = {str(value).strip()}" for key, value in said.multi_items()
            if "." in key and isinstance(value, str) and value.strip()]  # fmt: skip
    given = {"--set": told}
    command = "preflight"
    if said.get("search"):
        command = "optimise"
        given |= {f"--{k}": [str(said.get(k, ""))] for k in ("restarts", "time-limit")}
    job = ask(bench, who, command, given, "", [], name)
    return to(f"/jobs/{job.number}")


@router.post("/jobs/{number}/foresee")
def foresee_found(said: Form, who: Operator, bench: At, number: Number) -> Response:
    """Ask what a plan that was found will show, with its list for the operator."""
    name = f"runs/{number}/{CAMPAIGN_FILE}"
    job = ask(bench, who, "preflight", {}, "", [], name)
    return to(f"/jobs/{job.number}")


@router.get("/jobs/{number}/list")
def listed(bench: At, number: Number) -> Response:
    """The list for the operator: a page to print, which reaches nothing."""
    file = file_left(bench, number, LIST)
    return FileResponse(file, media_type="text/html", headers={"content-security-policy": FRAMED})
