"""The same over HTTP, for the system of a laboratory: send a log, follow the job, fetch it all.

With accounts every request needs a token of one; without, this computer alone is answered.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Depends, File, Request, UploadFile
from fastapi.responses import FileResponse
from fastapi.security import HTTPBearer

from foucault.errors import error
from foucault.workbench import actions
from foucault.workbench.asked import shown
from foucault.workbench.bench import At, Bench, bench_of
from foucault.workbench.pages import file_left, files_left
from foucault.workbench.people import Person, user
from foucault.workbench.store import Job, Number
from foucault.workbench.uploads import take_in

router = APIRouter(prefix="/api", tags=["workbench"])

_bearer = HTTPBearer(auto_error=False, description="Token of an account.")


def caller(request: Request, given: Annotated[Any, Depends(_bearer)]) -> Person:
    """Return whose token was given; raises ``workbench.token``."""
    bench = bench_of(request)
    if not bench.people.any() and not bench.open_to_others:
        return user()
    found = None if given is None else bench.people.who(given.credentials, "token")
    if found is None:
        raise error("workbench.token")
    return found


Who = Annotated[Person, Depends(caller)]


def told(bench: Bench, job: Job) -> dict[str, Any]:
    """Return a job as JSON has it."""
    return {
        "number": job.number, "command": job.command, "line": shown(job.words), "log": job.log,
        "who": job.who, "made": job.made, "state": job.state, "part": job.part,
        "doing": job.doing, "code": job.code, "verdict": job.verdict,
        "said": bench.said(job) if job.over else "",
        "files": files_left(bench, job) if job.state == "done" else [],
    }  # fmt: skip


@router.post("/logs", status_code=201)
def send_log(bench: At, who: Who, file: Annotated[list[UploadFile], File()]) -> dict[str, str]:
    """Send a log, in one file or in several that were recorded together; returns its name."""
    return {"log": take_in(bench.folder, file)}


@router.post("/jobs", status_code=201)
def ask(
    bench: At, who: Who,
    command: Annotated[str, Body(examples=["calibrate"])],
    log: Annotated[str, Body()] = "",
    runs: Annotated[list[int] | None, Body(description="numbers of jobs")] = None,
    name: Annotated[str, Body(description="of a procedure, or of a file to write")] = "",
    options: Annotated[
        dict[str, str | list[str]] | None, Body(examples=[{"latitude": "47.3 deg"}])
    ] = None,
) -> dict[str, Any]:  # fmt: skip
    """Ask for a job, as the command line would be called; `runs`: numbers of jobs [1]."""
    given = {
        f"--{key.lstrip('-').replace('_', '-')}": [v] if isinstance(v, str) else v
        for key, v in (options or {}).items()
    }
    folders = [f"runs/{number}" for number in runs or []]
    return told(bench, actions.ask(bench, who, command, given, log, folders, name))


@router.get("/jobs/{number}")
def job(bench: At, who: Who, number: Number) -> dict[str, Any]:
    """Follow a job: its state, how far it is, and when it is done what it has left."""
    return told(bench, bench.store.job(number))


@router.get("/jobs/{number}/files/{name}")
def file(bench: At, who: Who, number: Number, name: str) -> FileResponse:
    """Fetch what a job has left, such as result.json or report.html."""
    return FileResponse(file_left(bench, number, name), filename=name,
                        media_type="application/octet-stream")  # fmt: skip


@router.post("/jobs/{number}/certify", status_code=201)
def certify(
    bench: At, who: Who, number: Number,
    certificate: Annotated[
        dict[str, str | list[str]],
        Body(description="dotted keys below [certificate]", examples=[{"customer.name": "A"}]),
    ],
    reason: Annotated[str, Body(description="of a run that did not pass")] = "",
) -> dict[str, Any]:  # fmt: skip
    """Issue the certificate of a run that is kept; what lacks is named."""
    from foucault.workbench.certify import certify

    if not who.may("reviewer"):
        raise error("workbench.role_needed", name=who.name, role=who.role, needed="reviewer")
    return told(bench, certify(bench, who, number, certificate, reason=reason))


@router.post("/jobs/{number}/keep", status_code=201)
def keep(
    bench: At, who: Who, number: Number, instrument: Annotated[str, Body()] = "",
    date: Annotated[str, Body()] = "",
) -> dict[str, Any]:  # fmt: skip
    """Take a run into the records."""
    _, folder = bench.run_of(number)
    with bench.records(who.name, make=True) as records:
        assert records is not None
        taken, failed = records.add([folder], date=date, instrument=instrument)
        for _, problem in failed:
            raise problem
        kept = (taken or [records.run(str(folder))])[0]
    return {"number": kept.number, "instrument": kept.instrument, "sha256": kept.sha256}
