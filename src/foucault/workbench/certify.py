"""Certificates: a page that asks for what lacks by its name, a job that issues, a look at one.

The laboratory's own part lies in the folder of the workbench, where only who keeps the server
writes::

    certificates/laboratory.toml    [certificate] of every job: laboratory, references, languages
    certificates/laboratory.p12     the key that signs; its password is FOUCAULT_KEY_PASSWORD
    certificates/laboratory.pem     its certificate, by which /verify tells one's own

What a form says becomes a file there, by its hash, which the command line reads.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from foucault import run_folder
from foucault.certificate import content, issue, said
from foucault.errors import FoucaultError, error
from foucault.files import make_folder, sha256, write_text
from foucault.workbench.bench import KNOWN, At, Bench, Form, Operator, Reviewer, bench_of, page, to
from foucault.workbench.people import Person
from foucault.workbench.store import Job, Number
from foucault.workbench.uploads import take_in

router = APIRouter(dependencies=[KNOWN])

HOME = "certificates"
LABORATORY, KEY, TRUST = "laboratory.toml", "laboratory.p12", "laboratory.pem"


@dataclass(frozen=True)
class Item:
    """What a form asks for."""

    key: str  # below [certificate]
    title: str
    kind: str = "text"  # of the field; or choices apart by |
    hint: str = ""
    always: bool = False  # asked for also where nothing lacks


_ITEMS: dict[str, tuple[Item, ...]] = {
    "This certificate": (
        Item("number", "Number", hint="2026-0042; also the name of the files", always=True),
        Item("received", "Item received on", "date", always=True),
        Item("performed", "Calibrated on", "date", always=True),
        Item("performed_until", "Last day, if another", "date"),
        Item("issued", "Issued on", "date", "today if left out"),
    ),
    "Customer": (
        *(Item(f"customer.{k}", k.capitalize(), always=True)
          for k in ("name", "street", "postcode", "city")),
        Item("customer.country", "Country", hint="two letters, such as FR", always=True),
        Item("customer.email", "E-mail"),
        Item("from_customer", "Data of the customer that can affect results"),
        Item("next_due", "Next due", hint="only where the customer has agreed to an interval"),
    ),
    "Item": (
        Item("item.description", "What it is", hint="Inertial measurement unit", always=True),
        Item("item.model", "Model", always=True),
        Item("item.serial", "Serial number", always=True),
        Item("item.manufacturer", "Manufacturer", always=True),
        Item("item.condition", "State on arrival", hint="undamaged, sealed", always=True),
        Item("item.customer_id", "What the customer calls it"),
        Item("adjustment.done", "Adjusted or repaired?", "none|adjusted|repaired", always=True),
        Item("adjustment.words", "What was done"),
    ),
    "Method and conditions": (
        Item("method.name", "Method"),
        Item("method.document", "Document", hint="CP-17, issue 4"),
        Item("method.deviations", "Deviations, additions, exclusions", hint="none", always=True),
        Item("conditions.temperature", "Temperature", hint="(23 ± 1) °C", always=True),
        Item("conditions.humidity", "Humidity"),
        Item("conditions.pressure", "Pressure"),
        Item("place.kind", "Where", "laboratory|customer|other"),
        Item("place.words", "Address of that place"),
        *(Item(f"unused.{w}", f"Why no reference for {w}") for w in said.WHATS),
    ),
    "Conformity": (
        Item("conformity.specification", "By which specification",
             hint="only for a statement; the limits are those of the instrument"),
        Item("conformity.rule", "Rule", "guarded|simple"),
        Item("opinions", "Opinions and interpretations"),
        Item("external", "Results of others"),
    ),
    "Laboratory": (
        *(Item(f"laboratory.{k}", k.capitalize())
          for k in ("name", "street", "postcode", "city", "country", "email", "accreditation")),
        Item("authorised_by.name", "Authorised by"),
        Item("authorised_by.role", "Role"),
    ),
}  # fmt: skip
"""What is asked, in the order of the page; what the laboratory's file says is not asked again."""


def at(table: Mapping[str, Any], key: str) -> str:
    """Return what a table says at a dotted key; empty for nothing."""
    value: Any = table
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return "" if value is None or isinstance(value, Mapping) else str(value)


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables that dotted keys name."""
    out: dict[str, Any] = {}
    for key, value in flat.items():
        *tables, last = key.split(".")
        inner = out
        for table in tables:
            inner = inner.setdefault(table, {})
        inner[last] = value
    return out


@dataclass(frozen=True)
class Asked:
    """A certificate as far as it was said."""

    said: dict[str, Any]  # [certificate] of laboratory, form, run and records
    lacks: tuple[str, ...]
    known: dict[str, str]  # what the run knows, by key
    release: str  # why it may not be issued without a reason; empty: it passed
    limits: str  # tolerance file of the instrument; empty: none
    laboratory: frozenset[str]  # keys that its file says


def asked(bench: Bench, number: Number, flat: Mapping[str, Any]) -> Asked:
    """Return what is said and lacks of a certificate of a run; raises ``workbench.not_kept``."""
    job, folder = bench.run_of(number)
    if job.command != "calibrate":
        raise error("workbench.no_job", number=number)
    home = bench.folder / HOME
    own = said.read([home / LABORATORY]) if (home / LABORATORY).is_file() else {}
    flat = dict(flat)
    if not flat.get("conformity.specification"):
        flat.pop("conformity.rule", None)
    with bench.records() as records:
        digest = sha256(run_folder.result_file(folder))
        if records is None or all(r.sha256 != digest for r in records.runs()):
            raise error("workbench.not_kept", number=number)
        more = issue.from_records(records, folder)
        instrument = records.run(str(folder)).instrument
        limits = records.limits_text(instrument)
    if flat.get("conformity.specification"):
        if not limits:
            raise error("workbench.no_limits")
        flat["conformity.tolerance"] = "limits.toml"  # written where it is issued
    known = {k: more[k] for k in ("known", "used", "performed") if k in more}
    lacks, whole, result = content.lacking(folder, said.over(own, nested(flat)), **known)
    release = "" if result.verdict.level == "pass" or "review" in more else \
        f"The run is {result.verdict.level}. " + " ".join(result.verdict.reasons[:2])  # fmt: skip
    items = [i.key for i in _each()]
    flat_own = frozenset(k for k in items if at(own, k))
    return Asked(whole, tuple(lacks), {k: at(whole, k) for k in items}, release,
                 limits, flat_own)  # fmt: skip


def certify(bench: Bench, who: Person, number: Number, flat: Mapping[str, Any], *,
            reason: str = "", replaces: str = "", change: str = "") -> Job:  # fmt: skip
    """Ask for the job that issues; raises ``certificate.missing``, naming what lacks.

    `flat`: dotted keys below [certificate]; `replaces`: file of a certificate job, with `change`.
    """
    given = {k: v for k, v in flat.items() if v not in ("", [])}
    at_hand = asked(bench, number, given)
    if at_hand.lacks:
        raise error("certificate.missing", names=", ".join(at_hand.lacks))
    if at_hand.release and not reason:
        raise error("workbench.release", reason=at_hand.release)
    home = make_folder(bench.folder / HOME)
    if given.get("conformity.specification"):
        digest = hashlib.sha256(at_hand.limits.encode()).hexdigest()[:12]
        write_text(home / f"{digest}.tolerance.toml", at_hand.limits)
        given["conformity.tolerance"] = f"{digest}.tolerance.toml"
    else:
        given.pop("conformity.rule", None)
    text = "[certificate]\n" + "".join(
        f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in given.items()
    )
    name = f"{hashlib.sha256(text.encode()).hexdigest()[:12]}.toml"
    write_text(home / name, text)
    words = ["certify", f"runs/{number}"]
    words += [f"{HOME}/{LABORATORY}"] if (home / LABORATORY).is_file() else []
    words += [f"{HOME}/{name}", "-o", "runs/{job}", f"--records={_records(bench)}"]
    words += [f"--who={who.name}"]
    words += [f"--key={HOME}/{KEY}"] if (home / KEY).is_file() else []
    words += [f"--reviewer={who.name}", f"--reason={reason}"] if at_hand.release else []
    words += [f"--replaces={replaces}", f"--change={change}"] if replaces else []
    return bench.store.ask(who.name, "certify", words)


def _records(bench: Bench) -> str:
    """Return how the records are named as seen from the folder of the workbench."""
    file = Path(bench.database)
    if file.is_relative_to(bench.folder):
        return file.relative_to(bench.folder).as_posix()
    return bench.database


def issued(bench: Bench, number: Number) -> tuple[int, str, dict[str, Any]]:
    """Return of a job that issued: its run, its PDF and what its form said.

    Raises ``workbench.not_done``, ``workbench.no_name``.
    """
    job, folder = bench.run_of(number)
    pages = sorted(p.name for p in folder.glob("*.pdf")) if folder.is_dir() else []
    if job.command != "certify" or not pages:
        raise error("workbench.no_name", number=number, given="PDF")
    file = next(w for w in reversed(job.words[: job.words.index("-o")]) if w.endswith(".toml"))
    raw = said.read([bench.folder / file])
    return int(job.words[1].split("/")[-1]), f"runs/{number}/{pages[0]}", raw


# -- pages ---------------------------------------------------------------------------------------


@router.get("/certify/{number}")
def form(request: Request, who: Reviewer, number: Number, replaces: int = 0) -> Response:
    """What a certificate of a run lacks, by its name; `replaces`: job that issued another [1]."""
    return _form(request, number, {}, replaces)


def _form(request: Request, number: Number, flat: Mapping[str, Any], replaces: int,
          problem: FoucaultError | None = None, status: int = 200) -> Response:  # fmt: skip
    bench = bench_of(request)
    change = str(flat.get("change", ""))
    before: dict[str, Any] = {}
    if replaces:
        number, _, before = issued(bench, replaces)
    given = {i.key: at(before, i.key) for i in _each()} | {"used": before.get("used", [])}
    given |= dict(flat)
    given = {k: v for k, v in given.items() if v and k != "change"}
    if problem is not None and problem.code == "workbench.no_limits":
        given.pop("conformity.specification")
    at_hand = asked(bench, number, given)
    lacks = {n.removeprefix("used or ") for n in at_hand.lacks}
    groups = [
        (title, [(i, at_hand.known.get(i.key) or given.get(i.key, ""), i.key in lacks)
                 for i in items if i.key not in at_hand.laboratory])
        for title, items in _ITEMS.items()
    ]  # fmt: skip
    references = at_hand.said.get("references") or {}
    with bench.records() as records:
        kept = [] if records is None else list(records.references())
    key = (bench.folder / HOME / KEY).is_file()
    return page(
        request, "certify.html", status, number=number, groups=groups, lacks=at_hand.lacks,
        references=sorted({*references, *kept}), used=set(at_hand.said.get("used") or ()),
        release=at_hand.release, signed=key, problem=problem, replaces=replaces,
        change=change,
    )  # fmt: skip


def _each() -> Iterator[Item]:
    for items in _ITEMS.values():
        yield from items


@router.post("/certify/{number}")
def ask(request: Request, said: Form, who: Reviewer, bench: At, number: Number) -> Response:
    """Issue it, or say once more what lacks; nothing that was written is lost."""
    flat: dict[str, Any] = {i.key: str(said.get(i.key, "")).strip() for i in _each()}
    flat["used"] = [str(v) for v in said.getlist("used")]
    text = str(said.get("replaces", ""))
    replaces = int(text) if text.isdigit() and len(text) < 10 else 0
    change = str(said.get("change", "")).strip()
    try:
        at_number, file = number, ""
        if replaces:
            at_number, file, _ = issued(bench, replaces)
            if not change:
                raise error("workbench.change")
        job = certify(bench, who, at_number, flat, replaces=file, change=change,
                      reason=str(said.get("reason", "")).strip())  # fmt: skip
    except FoucaultError as problem:
        if problem.code in ("workbench.not_kept", "workbench.no_job", "workbench.no_name"):
            raise
        return _form(request, number, flat | {"change": change}, replaces, problem, 400)
    return to(f"/jobs/{job.number}")


@router.get("/verify")
def verify_page(request: Request, bench: At) -> Response:
    """Send a certificate in to have it looked at."""
    trust = (bench.folder / HOME / TRUST).is_file()
    return page(request, "verify.html", trust=trust)


@router.post("/verify")
def verify(said: Form, who: Operator, bench: At) -> Response:
    """Ask for a look at a certificate that somebody has got."""
    sent = [one for one in said.getlist("file") if not isinstance(one, str)]
    job = look_at(bench, who, sent)
    return to(f"/jobs/{job.number}")


def look_at(bench: Bench, who: Person, sent: Any) -> Job:
    """Take a certificate in, and ask what it is worth by the records and the laboratory's key."""
    name = take_in(bench.folder, sent, f"{HOME}/sent")
    file = next(p for p in sorted((bench.folder / HOME / "sent" / name).iterdir()))
    words = ["verify", file.relative_to(bench.folder).as_posix()]
    if (bench.folder / HOME / TRUST).is_file():
        words.append(f"--trust={HOME}/{TRUST}")
    with bench.records() as records:
        if records is not None:
            words.append(f"--records={_records(bench)}")
    return bench.store.ask(who.name, "verify", words)
