"""What is looked at: pages with an address each, which need no script."""

from __future__ import annotations

import datetime
import json
import math
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response

from foucault import run_folder
from foucault.campaign import comparison
from foucault.coefficients import format_value
from foucault.errors import FoucaultError, error
from foucault.files import sha256
from foucault.procedures import PROCEDURES
from foucault.records import shown as words
from foucault.records.history import compared, fleet, past
from foucault.report import compare, render
from foucault.units import convert
from foucault.workbench.asked import OFFERS, PLACE, files_of, given_log, shown
from foucault.workbench.bench import KNOWN, At, Bench, Form, Known, Operator, Reviewer, page, to
from foucault.workbench.look import FILE as LOOK_FILE
from foucault.workbench.store import Job, Number

router = APIRouter(dependencies=[KNOWN])

FRAMED = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' blob:; style-src "
    "'unsafe-inline'; img-src data: blob:; frame-ancestors 'self'"
)
"""A report runs its own script, in a frame that reaches nothing."""

MANY = 100
"""Rows of a page [1]."""


@router.get("/")
def start(request: Request, bench: At) -> Response:
    """Drop a log; what was done lately."""
    return page(request, "start.html", jobs=bench.store.jobs(12))


@router.get("/logs/{log}")
def log_page(request: Request, bench: At, log: str) -> Response:
    """What a log was taken for, and what can be done with it."""
    files = [p.name for p in files_of(bench.folder, log)]
    jobs = bench.store.jobs(MANY, log)
    looks = [job for job in jobs if job.command == "look"]
    look = looks[0] if looks else None
    seen: dict[str, Any] | None = None
    if look is not None and look.state == "done":
        found = _json(bench.folder / "runs" / str(look.number) / LOOK_FILE)
        seen = None if found is None else _UNSEEN | found
    said = [] if look is None else [w[6:] for w in look.words if w.startswith("--set=")]
    return page(
        request, "log.html", log=log, files=files, look=look, seen=seen, said=said,
        keys=_keys(seen or {}), jobs=[j for j in jobs if j.command != "look"],
        offers={k: o for k, o in OFFERS.items() if o.takes == "log"}, place=PLACE,
        line=shown(["calibrate", *given_log(bench.folder, log), *(f"--set={t}" for t in said),
                    "-o", "run"]),
        failed="" if look is None or look.state != "failed" else bench.said(look),
    )  # fmt: skip


_UNSEEN: dict[str, Any] = {
    "problem": None, "questions": [], "lines": [], "described": False, "procedure": None,
    "todo": "", "titles": [], "findings": None, "log": None, "rests": [], "trace": [], "end": 1.0,
}  # fmt: skip
"""What a look may leave open."""


def _keys(seen: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the keys of [log] that a form corrects, with what was taken."""
    out = []
    log = seen.get("log") or {}
    for triad in ("accel", "gyro"):
        block = log.get(triad)
        if isinstance(block, dict):
            columns = block.get("columns", "")
            out.append((f"{triad}.columns", json.dumps(columns) if columns else ""))
            out.append((f"{triad}.unit", str(block.get("unit", ""))))
    if isinstance(log.get("accel"), dict):
        out.append(("accel.reads", str(log["accel"].get("reads", "specific force"))))
    return [*out, ("rate", str(log.get("rate", "")))] if out else []


def _json(file: Path) -> dict[str, Any] | None:
    try:
        said = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) else None


@router.get("/do/{command}")
def form(
    request: Request, bench: At, command: str, log: str = "", run: str = "", name: str = ""
) -> Response:
    """A form with the options of a command, in its own words."""
    offer = OFFERS.get(command)
    if offer is None:
        raise error("workbench.offer", given=command[:40], allowed=", ".join(OFFERS))
    options = [o for o in bench.options(command) if o.name not in offer.without]
    order = {one: i for i, one in enumerate(offer.first)}
    options.sort(key=lambda o: order.get(o.name, 99))
    looks = [j for j in bench.store.jobs(MANY, log) if j.command == "look"] if log else []
    said = [w[6:] for w in looks[0].words if w.startswith("--set=")] if looks else []
    return page(
        request, "form.html", command=command, offer=offer, log=log, run=run, name=name, said=said,
        first=[o for o in options if o.name in order or o.needed],
        more=[o for o in options if o.name not in order and not o.needed],
        files=[] if not log else [p.name for p in files_of(bench.folder, log)],
        runs=bench.runs(), logs=logs_of(bench), procedures=list(PROCEDURES),
    )  # fmt: skip


def logs_of(bench: Bench) -> list[tuple[str, list[str]]]:
    """Return the logs that were sent in, newest first, with their files."""
    home = bench.folder / "logs"
    found = [p for p in home.iterdir() if p.is_dir() and not p.name.startswith(".")]
    found.sort(key=lambda p: p.stat().st_mtime, reverse=True)
    return [(p.name, sorted(f.name for f in p.iterdir())) for p in found[:MANY]]


@router.get("/logs")
def logs(request: Request, bench: At) -> Response:
    """The logs that were sent in."""
    return page(request, "logs.html", logs=logs_of(bench))


@router.get("/jobs")
def jobs(request: Request, bench: At, before: int = 1 << 62) -> Response:
    """What was asked for, newest first; `before`: number of a job [1]."""
    return page(request, "jobs.html", jobs=bench.store.jobs(MANY, before=before),
                most=MANY)  # fmt: skip


@router.get("/jobs/{number}")
def job_page(request: Request, bench: At, number: Number) -> Response:
    """A job: how far it is; when it is done its verdict, its report, and what to do with it."""
    job = bench.store.job(number)
    if job.command == "look":
        return to(f"/logs/{job.log}")
    said: dict[str, Any] = {"job": job, "text": bench.said(job) if job.over else ""}
    if job.state == "done":
        said |= _left(bench, job)
    return page(request, "job.html", **said)


def _left(bench: Bench, job: Job) -> dict[str, Any]:
    """Return what there is to say of what a job has left."""
    folder = bench.folder / "runs" / str(job.number)
    out: dict[str, Any] = {"rows": [], "reasons": [], "references": []}
    out |= {"files": files_left(bench, job), "kept": None, "problem": None, "before": None}
    if job.command != "calibrate":
        return out
    try:
        file = run_folder.result_file(folder)
        digest = sha256(file) if file.is_file() else ""
        result = run_folder.result_of_hash(folder, digest)
    except FoucaultError as problem:
        return out | {"problem": problem}
    out["reasons"] = list(result.verdict.reasons)
    instrument = result.instrument.get("serial") or result.instrument.get("name") or ""
    last: dict[str, float] = {}
    with bench.records() as records:
        if records is not None:
            out["kept"] = records.of_hash(digest)
            out["references"] = sorted(records.references())
            of = out["kept"].instrument if out["kept"] is not None else str(instrument)
            runs = records.runs(of) if of in records.instruments() else []
            own = [r for r in runs if r.sha256 != digest and r.counts
                   and r.procedure == result.procedure]  # fmt: skip
            if own:
                out["before"] = own[-1]
                try:
                    c = records.checked(own[-1]).coefficients
                    last = dict(zip(c.names, map(float, c.values), strict=True))
                except FoucaultError as problem:
                    out["problem"] = problem
    out["rows"] = [_row(row, last) for row in result.coefficients.rows()]
    out["instrument"] = str(instrument)
    return out


def _row(row: dict[str, Any], last: dict[str, float]) -> tuple[str, ...]:
    """Return the cells of a coefficient beside the last one."""
    value, sd = row["display_value"], row["display_sd"]
    cells = (row["name"], format_value(value, sd), "" if sd is None else format_value(sd, sd),
             row["display_unit"])  # fmt: skip
    if row["name"] not in last:
        return (*cells, "", "")
    before = convert(last[row["name"]], row["kind"], row["display_unit"])
    return (*cells, format_value(before, sd), format_value(value - before, sd))


@router.get("/jobs/{number}/state")
def state(request: Request, bench: At, number: Number) -> Response:
    """The part of a page that changes while a job runs; when it is over the page is loaded."""
    job = bench.store.job(number)
    out = page(request, "state.html", job=job)
    if job.over:
        out.headers["HX-Refresh"] = "true"
    return out


ASIDE = (
    LOOK_FILE,
    "tables",
    run_folder.SESSION_FOLDER,
    run_folder.STATE_FILE,
    run_folder.ENOUGH_FILE,
)
"""What a job leaves and nobody takes with a browser."""


def files_left(bench: Bench, job: Job) -> list[str]:
    """Return the names of the files that a job has left."""
    folder = bench.folder / "runs" / str(job.number)
    found = [p.name for p in folder.iterdir()] if folder.is_dir() else []
    return sorted(n for n in found if not n.startswith(".") and n not in ASIDE)


def file_left(bench: Bench, number: Number, name: str) -> Path:
    """Return a file that a job has left; raises ``workbench.no_name``."""
    job, folder = bench.run_of(number)
    if name not in files_left(bench, job):
        raise error("workbench.no_name", number=number, given=name[:80])
    found = folder / name
    if found.is_symlink() or not found.is_file():
        raise error("workbench.no_name", number=number, given=name[:80])
    return found


@router.get("/jobs/{number}/files/{name}")
def download(bench: At, number: Number, name: str) -> Response:
    """A file to keep; no browser opens it."""
    return FileResponse(file_left(bench, number, name), filename=name,
                        media_type="application/octet-stream")  # fmt: skip


@router.get("/jobs/{number}/report")
def report(bench: At, number: Number) -> Response:
    """The report, for a frame that reaches nothing."""
    file = file_left(bench, number, run_folder.REPORT_FILE)
    return FileResponse(file, media_type="text/html", headers=_framed())


def _framed() -> dict[str, str]:
    return {"content-security-policy": FRAMED}


# -- records -------------------------------------------------------------------------------


@router.get("/instruments")
def instruments(request: Request, bench: At, find: str = "", page_of: int = 1) -> Response:
    """All instruments: runs, the last one, when it is due; `page_of`: from 1 [1]."""
    rows: list[dict[str, Any]] = []
    with bench.records() as records:
        for name, runs, counted, due in [] if records is None else fleet(records):
            serial = name.lower()
            if find.strip().lower() in serial:
                last = (counted or runs)[-1]
                rows.append({
                    "name": name, "runs": len(runs), "last": last.holds[:10],
                    "verdict": last.verdict if counted else "unusable",
                    "procedure": last.procedure,
                    "due": "" if math.isnan(due) else words.day(due),
                })  # fmt: skip
    first = max(page_of - 1, 0) * MANY
    return page(request, "instruments.html", rows=rows[first : first + MANY], count=len(rows),
                find=find, page_of=page_of, pages=math.ceil(len(rows) / MANY))  # fmt: skip


@router.get("/instrument")
def instrument(request: Request, bench: At, name: str) -> Response:
    """An instrument: what it was, is, and will be when it is due."""
    with bench.records() as records:
        if records is None:
            raise error("records.no_instrument", given=name[:80], hint="", count=0)
        found = past(records, name)
        jobs = {run.number: _job_of(run.folder) for run in found.runs}
        limits = records.limits(found.instrument)
    level = str(found.level)
    limited = any(math.isfinite(o.limit) for o in found.outlooks)
    headings = words.HEADINGS if limited else words.HEADINGS[:-2]
    return page(
        request, "instrument.html", found=found, level=level, word=words.WORDS[level],
        due="" if math.isnan(found.due) else words.day(found.due), late=found.due < found.now,
        headings=headings, rows=[words.row(o)[: len(headings)] for o in found.outlooks],
        counted={r.number for r in found.counted}, jobs=jobs, limits=limits,
        first=found.first_reached,
        reaches="" if found.first_reached is None else words.day(found.first_reached.reaches),
        line=shown(["records", "show", found.instrument]),
    )  # fmt: skip


def _job_of(folder: str) -> int | None:
    """Return the job that has written a run folder of this workbench."""
    parts = Path(folder).parts
    return int(parts[-1]) if len(parts) == 2 and parts[0] == "runs" and parts[1].isdigit() else None


@router.get("/history")
def history(bench: At, name: str) -> Response:
    """Coefficients over time, for a frame that reaches nothing."""
    with bench.records() as records:
        found = None if records is None else past(records, name)
        read = None if records is None or found is None else compared(records, found)
    if found is None or read is None:
        raise error("records.one", name=name, count=0 if found is None else len(found.counted))
    text = render(compare.document(comparison.record(read)))
    return Response(text, media_type="text/html", headers=_framed())


@router.get("/due")
def due(request: Request, bench: At) -> Response:
    """What is due, soonest first, and the references that calibrations rest on."""

    rows, references = [], []
    with bench.records() as records:
        if records is not None:
            rows = [(due, name) for name, _, _, due in fleet(records) if not math.isnan(due)]
            references = sorted(records.references().values(), key=lambda r: r.due or "9")
    rows.sort()
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return page(request, "due.html", rows=[(words.day(at), name) for at, name in rows], today=today,
                references=references)  # fmt: skip


@router.get("/journal")
def journal(request: Request, who: Reviewer, bench: At) -> Response:
    """Who said what when: the newest entries of the records."""
    entries: list[Any] = []
    with bench.records() as records:
        if records is not None:
            entries = records.newest(MANY)
    refused = bench.people.refused()
    return page(request, "journal.html", entries=entries, refused=refused)


# -- accounts ------------------------------------------------------------------------------


@router.get("/accounts")
def accounts(request: Request, who: Known, bench: At) -> Response:
    """One's own tokens; for an administrator all accounts."""
    people = bench.people
    every = people.all() if who.may("administrator") else []
    return page(request, "accounts.html", every=every, tokens=people.tokens(who.name), token="")


@router.post("/tokens")
def token(request: Request, said: Form, who: Operator, bench: At) -> Response:
    """Make a token, which is shown this once."""
    people = bench.people
    if not people.any():
        raise error("workbench.token")
    made = people.token(who.name, str(said.get("label", "")), 365.0, bench.told(who.name))
    every = people.all() if who.may("administrator") else []
    return page(request, "accounts.html", every=every, tokens=people.tokens(who.name), token=made)
