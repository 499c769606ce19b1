"""What every page needs: the folder, who asks, forms that are ours, templates."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Depends, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from foucault import __version__
from foucault.errors import FoucaultError, error
from foucault.workbench.asked import Option
from foucault.workbench.people import LASTS, People, Person, user
from foucault.workbench.store import Job, Number, Store
from foucault.workbench.worker import said

if TYPE_CHECKING:
    from foucault.records import Records
    from foucault.records.entries import Body

COOKIE = "foucault"
HERE = Path(__file__).parent

STATUS = {
    "workbench.not_kept": 409,
    "workbench.no_job": 404, "workbench.no_log": 404, "workbench.no_name": 404,
    "workbench.no_account": 404, "workbench.no_session": 404, "workbench.source": 403,
    "campaign.procedure": 404, "records.no_instrument": 404, "records.no_run": 404,
    "workbench.not_done": 409,
    "workbench.role_needed": 403, "workbench.form": 403, "workbench.foreign": 403,
    "workbench.login": 403, "workbench.token": 401, "workbench.attempts": 429,
    "workbench.large": 413, "workbench.space": 507, "workbench.full": 507,
    "workbench.locked": 503, "workbench.read_only": 503, "workbench.database": 503,
    "workbench.gone": 503, "workbench.bomb": 413,
    "records.locked": 503, "records.read_only": 503, "records.full": 507,
}  # fmt: skip
"""Code of an error -> status of HTTP; 400 of all others."""


class LoginNeededError(Exception):
    """Whoever asks has to say first who it is."""


class Bench:
    """One workbench."""

    def __init__(self, store: Store, database: str, options: Callable[[str], list[Option]],
                 open_to_others: bool = False, prefix: str = "") -> None:  # fmt: skip
        """Of a file of jobs and accounts, records, and the options that commands have.

        `prefix`: of the paths of pages, where a proxy takes it off.
        """
        self.prefix = prefix
        self.store, self.database, self.people = store, database, People(store)
        self.folder, self.open_to_others = store.folder, open_to_others
        self.options = cache(options)

    @contextmanager
    def records(self, who: str = "", *, make: bool = False) -> Iterator[Records | None]:
        """Yield the records; None where there are none yet and none are made."""
        from foucault.records import Records

        file = None if "://" in self.database else Path(self.database)
        if file is not None and not file.is_file() and self.store.setting("records"):
            raise error("workbench.gone", path=file)
        try:
            held = Records(self.database, make=make, who=who)
        except FoucaultError as problem:
            if problem.code != "records.none":
                raise
            yield None
            return
        if make and file is not None:
            self.store.set("records", file.name)
        try:
            yield held
        finally:
            held.close()

    def told(self, who: str) -> Callable[[Body], None]:
        """Return what keeps in the journal that `who` has changed an account."""
        with self.records(who, make=True):  # what is said stands in a transaction of the store
            pass

        def say(body: Body) -> None:
            with self.records(who, make=True) as records:
                assert records is not None
                records.say(body)

        return say

    def run_of(self, number: Number) -> tuple[Job, Path]:
        """Return a job that is done, and the folder that it has written."""
        job = self.store.job(number)
        if job.state != "done":
            raise error("workbench.not_done", number=number, state=job.state)
        return job, self.folder / "runs" / str(number)

    def said(self, job: Job) -> str:
        """Return what a job has said."""
        return said(self.folder, job.number)

    def runs(self) -> list[Job]:
        """Return the newest jobs that have left a result."""
        return [job for job in self.store.jobs(300)
                if job.state == "done" and job.command == "calibrate"]  # fmt: skip


def bench_of(request: Request) -> Bench:
    """Return the workbench that a request is of."""
    found: Bench = request.app.state.bench
    return found


def person(request: Request) -> Person:
    """Return who asks, by the cookie; raises `LoginNeededError`."""
    known = getattr(request.state, "person", None)
    if known is None:
        bench = bench_of(request)
        if not bench.people.any() and not bench.open_to_others:
            known = user()
        else:
            known = bench.people.who(request.cookies.get(COOKIE, ""), "browser")
        if known is None:
            raise LoginNeededError
        request.state.person = known
    found: Person = known
    return found


def needs(request: Request, role: str) -> Person:
    """Return who asks, who has to have a role; raises ``workbench.role_needed``."""
    who = person(request)
    if not who.may(role):
        raise error("workbench.role_needed", name=who.name, role=who.role, needed=role)
    return who


def _who(role: str) -> Any:
    def asking(request: Request) -> Person:
        return needs(request, role)

    return Depends(asking)


async def form_of(request: Request) -> AsyncIterator[Any]:
    """Yield what a form says, which has to be one of our pages; raises ``workbench.form``."""
    if request.url.path != "/login":  # nothing is read of whoever is not known
        person(request)
    cookie = request.cookies.get(COOKIE, "")
    async with request.form(max_files=24, max_fields=200) as said:
        mark = str(said.get("mark", ""))
        wanted = bench_of(request).people.mark(cookie)
        if not cookie or not hmac.compare_digest(mark.encode(), wanted.encode()):
            raise error("workbench.form")
        yield said


Form = Annotated[Any, Depends(form_of)]
"""What a form says."""

At = Annotated[Bench, Depends(bench_of)]
KNOWN = Depends(person)
Known = Annotated[Person, KNOWN]
Operator = Annotated[Person, _who("operator")]
Reviewer = Annotated[Person, _who("reviewer")]
Administrator = Annotated[Person, _who("administrator")]
"""Whoever asks, who has to have a role."""


def page(request: Request, template: str, status: int = 200, /, **said: Any) -> HTMLResponse:
    """Return a page with the cookie by which its forms are known; `status`: of HTTP [1]."""
    bench = bench_of(request)
    cookie = request.cookies.get(COOKIE, "")
    fresh = "" if cookie else secrets.token_urlsafe(32)
    try:
        who: Person | None = person(request)
    except (LoginNeededError, FoucaultError):
        who = None
    text = templates().get_template(template).render(
        mark=bench.people.mark(cookie or fresh), who=who, here=request.url.path,
        accounts=bench.people.any(), version=__version__, root=bench.prefix, **said,
    )  # fmt: skip
    out = HTMLResponse(text, status)
    if fresh:
        give_cookie(request, out, fresh)
    return out


def give_cookie(request: Request, response: Response, token: str) -> None:
    """Let a browser keep a token that no script can read and no other site can send."""
    response.set_cookie(
        COOKIE, token, max_age=int(LASTS), httponly=True, samesite="lax",
        secure=request.url.scheme == "https", path=bench_of(request).prefix or "/",
    )  # fmt: skip


def to(where: str) -> RedirectResponse:
    """Return the answer to a form: another page."""
    return RedirectResponse(where, 303)


@cache
def templates() -> Any:
    """The pages; whatever anybody wrote is escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    from foucault.workbench.asked import shown

    made = Environment(
        loader=FileSystemLoader(HERE / "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters["line"] = shown
    made.filters["when"] = lambda text: text[:16].replace("T", " ")
    return made
