"""What forms do: ask for jobs, keep runs, judge, open accounts. Each answers with a page."""

from __future__ import annotations

import io
import json
import re
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import APIRouter, Request
from fastapi.responses import Response

from foucault.campaign.recognised import said_of
from foucault.errors import error
from foucault.logs.description import LogDescription
from foucault.records.entries import Account
from foucault.workbench.asked import OFFERS, files_of, given_log, stays, words_of
from foucault.workbench.bench import (
    COOKIE,
    Administrator,
    At,
    Bench,
    Form,
    Operator,
    Reviewer,
    give_cookie,
    needs,
    page,
    to,
)
from foucault.workbench.people import Person
from foucault.workbench.store import Job, Number
from foucault.workbench.uploads import take_in

router = APIRouter()


def ask_look(bench: Bench, who: Person, log: str, said: list[str]) -> Job:
    """Ask for a first look at a log; `said`: what `--set` is given."""
    texts = [t.strip() for t in said if t.strip()]
    if texts:
        stays(files_of(bench.folder, log)[0].parent, said_of(texts))
    words = ["inspect", *given_log(bench.folder, log), *(f"--set={t}" for t in texts)]
    return bench.store.ask(who.name, "look", [*words, "--plots=runs/{job}/report.html"], log)


def ask(
    bench: Bench, who: Person, command: str, given: dict[str, list[str]], log: str = "",
    runs: list[str] | None = None, name: str = "",
) -> Job:  # fmt: skip
    """Ask for a command that is offered."""
    options = bench.options(command) if command in OFFERS else []
    words = words_of(bench.folder, command, options, given, log=log, runs=runs or [], name=name)
    return bench.store.ask(who.name, command, words, log)


@router.post("/logs")
def send_log(said: Form, who: Operator, bench: At) -> Response:
    """Take a log in, and look at it."""
    sent = [one for one in said.getlist("file") if not isinstance(one, str)]
    log = take_in(bench.folder, sent)
    ask_look(bench, who, log, [])
    return to(f"/logs/{log}")


def corrected(said: Any) -> list[str]:
    """Return what `--set` is given, of a form that shows what was taken; what is new counts."""
    new = {
        key[4:]: value.strip() for key, value in said.multi_items()
        if key.startswith("key:") and isinstance(value, str) and value.strip()
        and value.strip() != str(said.get(f"was:{key[4:]}", ""))
    }  # fmt: skip
    before = [str(v).strip() for v in said.getlist("set")]
    kept = [one for one in before if one and one.partition("=")[0].strip() not in new]
    return [*kept, *(f"{key} = {value}" for key, value in new.items())]


@router.post("/logs/{log}/look")
def look_again(said: Form, who: Operator, bench: At, log: str) -> Response:
    """Look at a log with other words."""
    ask_look(bench, who, log, corrected(said))
    return to(f"/logs/{log}")


@router.post("/logs/{log}/rests")
def move_rests(said: Form, who: Operator, bench: At, log: str) -> Response:
    """Take the rests as they stand in the form, or have them found again."""
    ends = [said.getlist("first"), said.getlist("last")]
    out = set(map(str, said.getlist("out")))
    rows = [(str(a).strip(), str(b).strip()) for a, b in zip(*ends, strict=False)]
    rests = [r for k, r in enumerate(rows) if all(r) and str(k) not in out]
    again = bool(said.get("again"))
    name = with_rests(bench, who, log, None if again else rests)
    return to(f"/logs/{name}")


def with_rests(bench: Bench, who: Person, log: str, rests: list[tuple[str, str]] | None) -> str:
    """Look at a log with these rests, first and last sample [s]; None: they are looked for.

    Of a bare log they are said by `--set`; a campaign is written anew with them, which makes
    another log. Returns its name; raises ``log.rests``.
    """
    words: list[str] = []
    if rests is not None:
        try:
            inside = sorted((float(a), float(b)) for a, b in rests)
        except ValueError:
            raise error("workbench.rests") from None
        words = [f"{a:.6f}".rstrip("0").rstrip(".") + f"-{b:.6f}".rstrip("0").rstrip(".") + " s"
                 for a, b in inside]  # fmt: skip
        LogDescription.model_validate({"file": "log", "rests": words})
    files = files_of(bench.folder, log)
    line = f"rests = {json.dumps(words)}"
    if files[0].suffix.lower() != ".toml":
        looks = [j for j in bench.store.jobs(100, log) if j.command == "look"]
        said = [w[6:] for w in looks[0].words if w.startswith("--set=")] if looks else []
        kept = [t for t in said if t.partition("=")[0].strip() != "rests"]
        ask_look(bench, who, log, [*kept, *([line] if words else [])])
        return log
    text = re.sub(r"(?m)^rests\s*=\s*\[[^\]]*\][^\n]*\n", "", files[0].read_text(encoding="utf-8"))
    if words:
        text = re.sub(r"(?m)^(\[log\][^\n]*\n)", rf"\g<1>{line}\n", text, count=1)
    with ExitStack() as held:
        sent: list[Any] = [Kept(files[0].name, io.BytesIO(text.encode()))]
        sent += [Kept(f.name, held.enter_context(f.open("rb"))) for f in files[1:]]
        name = take_in(bench.folder, sent)
    ask_look(bench, who, name, [])
    return name


@dataclass
class Kept:
    """A file as a form would bring it."""

    filename: str
    file: Any


@router.post("/do/{command}")
def do(said: Form, who: Operator, bench: At, command: str) -> Response:
    """Ask for a job."""
    given: dict[str, list[str]] = {}
    for key, value in said.multi_items():
        if key.startswith("--") and isinstance(value, str):
            given.setdefault(key, []).append(value)
    runs = [str(v) for v in said.getlist("run")]
    job = ask(bench, who, command, given, str(said.get("log", "")), runs, str(said.get("name", "")))
    return to(f"/jobs/{job.number}")


@router.post("/jobs/{number}/stop")
def stop(request: Request, said: Form, who: Operator, bench: At, number: Number) -> Response:
    """Stop a job; that of somebody else is a reviewer's to stop."""
    job = bench.store.job(number)
    needs(request, "operator" if job.who == who.name else "reviewer")
    bench.store.stop(number)
    return to(f"/jobs/{number}")


@router.post("/jobs/{number}/keep")
def keep(said: Form, who: Operator, bench: At, number: Number) -> Response:
    """Take a run into the records."""
    _, folder = bench.run_of(number)
    with bench.records(who.name, make=True) as records:
        assert records is not None
        taken, failed = records.add(
            [folder], date=str(said.get("date", "")).strip(),
            instrument=str(said.get("instrument", "")).strip(),
            references=[str(v) for v in said.getlist("reference")],
        )  # fmt: skip
        for _, problem in failed:
            raise problem
        name = (taken or [records.run(str(folder))])[0].instrument
    return to(f"/instrument?name={quote(name, safe='')}")


@router.post("/records/{what}")
def record(said: Form, who: Reviewer, bench: At, what: str) -> Response:
    """Add an entry to the records; that is a reviewer's work."""
    name = str(said.get("instrument", ""))

    def text(key: str) -> str:
        return str(said.get(key, "")).strip()

    with bench.records(who.name, make=True) as records:
        assert records is not None
        if what == "review":
            records.review(text("run"), text("decision"), text("reason"))
        elif what == "interval":
            months = text("months")
            records.recalibrate_every(name, float(months) if _number(months) else -1.0)
        elif what == "event":
            records.event(name, *map(text, ("what", "on", "words")))
        elif what == "reference":
            records.reference(*map(text, ("name", "what", "certificate", "due", "words")))
        elif what == "tolerance":
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "tolerance.toml"
                file.write_text(text("text").replace("\r\n", "\n"), encoding="utf-8")
                records.tolerate(name, file)
        else:
            raise error("workbench.offer", given=what[:40],
                        allowed="review, interval, event, reference, tolerance")  # fmt: skip
    return to(f"/instrument?name={quote(name, safe='')}" if name else "/due")


def _number(text: str) -> bool:
    try:
        return float(text) == float(text)
    except ValueError:
        return False


# -- accounts ------------------------------------------------------------------------------


@router.get("/login")
def login(request: Request, to: str = "/") -> Response:
    """Who are you?"""
    return page(request, "login.html", to=to)


@router.post("/login")
def log_in(request: Request, said: Form, bench: At) -> Response:
    """Begin a session."""
    address = request.client.host if request.client else ""

    def told(body: Account) -> None:
        bench.told("nobody")(body)

    name, password = (str(said.get(key, "")) for key in ("name", "password"))
    token = bench.people.log_in(name, password, address, told)
    back = str(said.get("to", "/"))
    out = to(back if back.startswith("/") and not back.startswith(("//", "/\\")) else "/")
    give_cookie(request, out, token)
    return out


@router.post("/logout")
def log_out(said: Form, who: Operator, bench: At) -> Response:
    """End the session."""
    bench.people.log_out(who.session, who.name)
    out = to("/login")
    out.delete_cookie(COOKIE)
    return out


@router.post("/accounts")
def account(said: Form, who: Administrator, bench: At) -> Response:
    """Make an account, or give one another role and password."""
    name, role, password = (str(said.get(key, "")) for key in ("name", "role", "password"))
    bench.people.add(name, role, password, bench.told(who.name))
    return to("/accounts")


@router.post("/accounts/close")
def close(said: Form, who: Administrator, bench: At) -> Response:
    """Close an account."""
    bench.people.close(str(said.get("name", "")), bench.told(who.name))
    return to("/accounts")


@router.post("/tokens/end")
def end_token(said: Form, who: Operator, bench: At) -> Response:
    """End a token of one's own."""
    bench.people.end_token(str(said.get("digest", "")), who.name, bench.told(who.name))
    return to("/accounts")
