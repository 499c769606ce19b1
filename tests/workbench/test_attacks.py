"""What is sent to a workbench by somebody who means no good, or by accident."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from commands import run
from foucault.errors import FoucaultError
from foucault.workbench import people, uploads
from foucault.workbench.asked import inside, safe_name, shown, stays
from foucault.workbench.bench import Bench
from foucault.workbench.serving import loopback
from foucault.workbench.store import Store, alive, hold
from make_workbench import PASSWORD, client, make_bench, mark, post

LOG = b"t,ax,ay,az\n0,0,0,9.8\n"


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return make_bench(tmp_path / "bench")


@pytest.fixture
def browser(bench: Bench) -> Iterator[Any]:
    with client(bench) as made:
        yield made


@pytest.fixture
def with_accounts(bench: Bench, quick: None) -> Bench:
    for name, role in (("ann", "administrator"), ("rob", "reviewer"), ("olga", "operator")):
        bench.people.add(name, role, PASSWORD)
    return bench


def log_in(browser: Any, name: str, password: str = PASSWORD) -> Any:
    return post(browser, "/login", {"name": name, "password": password})


# -- names -------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "kept"), [
    ("../../etc/passwd", "passwd"), ("..\\..\\boot.ini", "boot.ini"),
    ("<script>.csv", "script_.csv"),
    ("a\nb.csv", "a_b.csv"), (".hidden", "hidden"), ("-rf.csv", "rf.csv"), ("///", "log"),
    ("drive 7.csv.gz", "drive_7.csv.gz"), ("n" * 400 + ".csv", "n" * 80 + ".csv"),
])  # fmt: skip
def test_a_name_is_made_harmless(name: str, kept: str) -> None:
    assert safe_name(name) == kept


def test_a_hostile_name_is_kept_in_its_folder_and_shown_as_text(bench: Bench, browser: Any) -> None:
    for name in ("../../../x.csv", "<script>alert(1)</script>.csv", "a\r\nX: y.csv"):
        page = post(browser, "/logs", files={"file": (name, LOG)})
        assert page.status_code == 200 and "<script>alert" not in page.text
    outside = [p for p in bench.folder.parent.rglob("*.csv") if bench.folder not in p.parents]
    assert not outside


def test_the_same_log_twice_is_one(bench: Bench, browser: Any) -> None:
    for _ in range(2):
        post(browser, "/logs", files={"file": ("x.csv", LOG)})
    assert len(list((bench.folder / "logs").iterdir())) == 1


@pytest.mark.parametrize("given", [
    "/etc/passwd", "../records.sqlite", "runs/../workbench.sqlite", "runs/9",
    "logs/0123456789ab/../../workbench.sqlite",
])  # fmt: skip
def test_an_option_names_no_file_elsewhere(tmp_path: Path, given: str) -> None:
    with pytest.raises(FoucaultError, match="no file that was sent in"):
        inside(tmp_path, given)


def test_a_campaign_names_no_file_elsewhere(bench: Bench, browser: Any, tmp_path: Path) -> None:
    for text in ('[log]\nfile = "/etc/passwd"', '[log]\nfile = "../../workbench.sqlite"',
                 '[log]\nmore = ["x.csv", "~/x.csv"]'):  # fmt: skip
        page = post(browser, "/logs", files={"file": ("c.toml", text.encode())})
        assert page.status_code == 400 and "no file that was sent in" in page.text
    assert not list((bench.folder / "logs").iterdir())
    stays(tmp_path, {"file": "log.csv", "unit": "deg/s", "rate": ["0.1 deg/s"]})


def test_set_names_no_file_elsewhere(bench: Bench, browser: Any) -> None:
    page = post(browser, "/logs", files={"file": ("x.csv", LOG)})
    for given in ("file = /etc/passwd", 'more = ["../../workbench.sqlite"]'):
        again = post(browser, f"{page.url.path}/look", {"set": given})
        assert again.status_code == 400 and "no file that was sent in" in again.text


def test_only_what_is_offered_is_run(bench: Bench, browser: Any) -> None:
    log = post(browser, "/logs", files={"file": ("x.csv", LOG)}).url.path.split("/")[-1]
    for command, said, words in (
        ("serve", {}, "cannot be asked for here"),
        ("calibrate", {"--output": "/tmp/x"}, "not all of them are offered here"),
        ("calibrate", {"--latitude": "1 deg\n--set=x"}, "has line breaks or control signs"),
        ("export", {"--to": "c"}, "Too few runs"),
        ("preflight", {"name": "/etc/passwd"}, "no procedure"),
        ("export", {"--to": "c", "run": "../../etc"}, "no file that was sent in"),
        ("calibrate", {"log": "../.."}, "Send it in on the first page"),
    ):  # fmt: skip
        page = post(browser, f"/do/{command}", {"log": log} | said)
        assert page.status_code in (400, 404) and words in page.text, (command, said)
    assert [job.command for job in bench.store.jobs()] == ["look"]


def test_a_line_to_copy_is_quoted() -> None:
    words = ["calibrate", "logs/a b.csv", "--set=x = $(rm -rf /)", "--latitude=47.3 deg"]
    assert shown(words) == (
        'foucault calibrate "logs/a b.csv" --set \'x = $(rm -rf /)\' --latitude "47.3 deg"'
    )


# -- sizes -------------------------------------------------------------------------------


def test_five_gigabytes_are_refused_by_their_size(browser: Any) -> None:
    """Nothing of it is read: the answer is there before the first byte."""
    began = time.monotonic()
    page = browser.post("/logs", content=b"", headers={"content-length": str(5 << 30)})
    assert page.status_code == 413 and "larger than 2048 MB" in page.text
    assert time.monotonic() - began < 2
    page = browser.post("/login", content=b"x" * (5 << 20))
    assert page.status_code == 413 and "larger than 4 MB" in page.text


def test_a_stream_without_a_size_is_cut(browser: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from foucault.workbench import web

    monkeypatch.setattr(web, "SMALL", 1000)
    page = browser.post("/login", content=(b"x" * 400 for _ in range(9)),
                        headers={"content-type": "application/x-www-form-urlencoded"})  # fmt: skip
    assert page.status_code == 413


def test_no_room_and_no_content_are_said(
    bench: Bench, browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "holds nothing" in post(browser, "/logs", files={"file": ("x.csv", b"")}).text
    assert "files were sent" in post(browser, "/logs").text
    monkeypatch.setattr(uploads, "SPARE", 1 << 60)
    page = post(browser, "/logs", files={"file": ("x.csv", LOG)})
    assert page.status_code == 507 and "has no room for this file" in page.text
    assert not list((bench.folder / "logs").iterdir())


# -- from elsewhere ----------------------------------------------------------------------


def test_a_form_of_another_site_is_refused(bench: Bench, browser: Any) -> None:
    page = browser.post("/logs", data={"mark": "0" * 64}, files={"file": ("x.csv", LOG)})
    assert page.status_code == 403 and "did not come from a page" in page.text
    good = mark(browser)
    for headers in ({"origin": "https://evil.example"}, {"sec-fetch-site": "cross-site"},
                    {"origin": "null"}):  # fmt: skip
        page = browser.post("/logs", data={"mark": good}, headers=headers)
        assert page.status_code == 403
    assert not bench.store.jobs()


@pytest.mark.parametrize("headers", [{"host": "evil.example"}, {"x-forwarded-for": "10.0.0.9"},
                                     {"host": "127.0.0.1.evil.example:8400"}])  # fmt: skip
def test_without_accounts_only_this_computer_is_answered(
    browser: Any, headers: dict[str, str]
) -> None:
    page = browser.get("/", headers=headers)
    assert page.status_code == 403 and "answers this computer alone" in page.text


def test_every_answer_has_its_headers(browser: Any) -> None:
    for path in ("/", "/jobs", "/static/style.css", "/nowhere", "/api/jobs/9"):
        headers = browser.get(path).headers
        assert "script-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff" and "server" not in headers
    cookie = client_cookie(browser)
    assert "HttpOnly" in cookie and "SameSite=lax" in cookie


def client_cookie(browser: Any) -> str:
    browser.cookies.clear()
    return browser.get("/login").headers["set-cookie"]


def test_static_files_are_those_that_there_are(browser: Any) -> None:
    for name in ("..%2Fweb.py", "%2e%2e/web.py", "none.js"):
        assert browser.get(f"/static/{name}").status_code == 404
    assert browser.get("/static/htmx.min.js").headers["content-type"].startswith("text/javascript")


# -- accounts ----------------------------------------------------------------------------


def test_as_soon_as_there_is_an_account_everybody_needs_one(
    with_accounts: Bench, browser: Any
) -> None:
    for path in ("/", "/jobs", "/accounts", "/jobs/1/report", "/instruments"):
        assert browser.get(path).url.path == "/login"
    assert browser.get("/api/jobs/1").status_code == 401
    assert "do not belong together" in log_in(browser, "ann", "wrong and long enough").text
    assert log_in(browser, "ann").url.path == "/"
    cookie = browser.cookies["foucault"]
    post(browser, "/logout")
    browser.cookies.set("foucault", cookie)
    assert browser.get("/").url.path == "/login"


def test_a_role_may_do_what_it_may(with_accounts: Bench, browser: Any) -> None:
    log_in(browser, "olga")
    page = post(browser, "/records/interval", {"instrument": "x", "months": "12"})
    assert page.status_code == 403 and "olga is operator; this needs a reviewer" in page.text
    assert browser.get("/journal").status_code == 403
    body = {"name": "eve", "role": "administrator", "password": PASSWORD}
    assert post(browser, "/accounts", body).status_code == 403
    log_in(browser, "ann")
    assert post(browser, "/accounts", body).status_code == 200
    assert "eve" in browser.get("/accounts").text
    post(browser, "/accounts/close", {"name": "eve"})
    post(browser, "/accounts/close", {"name": "olga"})
    said = post(browser, "/accounts/close", {"name": "ann"}).text
    assert "Without ann nobody could open" in said
    assert "do not belong together" in log_in(browser, "olga").text
    for name, role, password, words in (
        ("<b>", "operator", PASSWORD, "cannot be the name"),
        ("x", "king", PASSWORD, "is no role; these are:"),
        ("x", "operator", "short", "12 to 256 letters"),
    ):  # fmt: skip
        log_in(browser, "ann")
        said = post(browser, "/accounts", {"name": name, "role": role, "password": password})
        assert said.status_code == 400 and words in said.text


def test_passwords_cannot_be_tried_on_and_on(with_accounts: Bench, browser: Any) -> None:
    for _ in range(5):
        assert log_in(browser, "ann", "not this one at all").status_code == 403
    for password in ("nor this one either", PASSWORD):
        said = log_in(browser, "ann", password)
        assert said.status_code == 429 and "There were too many wrong passwords" in said.text
    with with_accounts.store.writing() as db:  # a clock that was set back frees nobody for long
        db.execute("UPDATE attempt SET at = at + 86400")
    assert log_in(browser, "ann").url.path == "/"


def test_wrong_passwords_are_kept_with_whose_when_and_from_where(
    with_accounts: Bench, browser: Any
) -> None:
    """But not what was written; a name without an account may be a password in the wrong field."""
    for _ in range(7):
        log_in(browser, "olga", "correct horse olga")
    log_in(browser, "my secret passphrase", "x")
    rows = {(r["name"], r["address"]): r for r in with_accounts.people.refused()}
    assert rows["olga", "testclient"]["count"] == 7 and rows["olga", "testclient"]["locked"]
    assert rows["", "testclient"]["count"] == 1 and not rows["", "testclient"]["locked"]
    whole = b"".join(p.read_bytes() for p in with_accounts.folder.glob("*.sqlite*"))
    assert b"correct horse" not in whole and b"secret passphrase" not in (
        b"".join(str(tuple(r.values())).encode() for r in with_accounts.people.refused())
    )
    log_in(browser, "ann")
    page = browser.get("/journal").text
    assert "Wrong passwords" in page and "no account" in page and "locked out" in page
    with with_accounts.records() as records:
        told = [e.body for e in records.entries() if "locked out" in e.body]
        assert len(told) == 1 and "olga" in told[0] and "testclient" in told[0]  # once a day
        assert not records.audit()


def test_a_wrong_token_is_kept_as_a_wrong_password_is(with_accounts: Bench, browser: Any) -> None:
    for token in ("a guess", "another one"):
        said = browser.get("/api/jobs", headers={"Authorization": f"Bearer {token}"})
        assert said.status_code == 401
    assert browser.get("/api/jobs").status_code == 401  # none was given: nobody guessed
    (row,) = with_accounts.people.refused()
    assert (row["name"], row["address"], row["count"]) == ("", "testclient", 2)


def test_who_tries_passwords_cannot_fill_the_disk(with_accounts: Bench, monkeypatch: Any) -> None:
    """Rows of a day are bounded whatever is tried from wherever, and old ones go."""
    made = with_accounts.people
    monkeypatch.setattr(people, "_hasher", lambda: Never())
    monkeypatch.setattr(people, "_nobody", lambda: "")
    monkeypatch.setattr(people, "A_DAY", 20)
    for k in range(60):
        name = "ann" if k % 2 else f"nobody {k}"
        with pytest.raises(FoucaultError):
            made.log_in(name, f"wrong {k}", f"10.0.0.{k}")
    rows = made.refused()
    assert len(rows) <= 22 and sum(r["count"] for r in rows) == 60
    assert {r["name"] for r in rows if r["address"] == people.ANYWHERE} == {"", "ann"}
    monkeypatch.setattr(people, "now", lambda: "2099-01-01T00:00:00+00:00")
    with pytest.raises(FoucaultError):
        made.log_in("ann", "wrong", "10.0.0.1")
    assert len(made.refused()) == 1


class Never:
    """Verifies no password, and takes no time for it."""

    def verify(self, *_: str) -> bool:
        return False


def test_a_workbench_of_before_keeps_its_jobs_and_accounts(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    bench.people.add("ann", "administrator", PASSWORD)
    bench.store.ask("ann", "calibrate", ["calibrate"])
    with bench.store.writing() as db:
        db.execute("DROP TABLE refused")
        db.execute("PRAGMA user_version = 1")
    again = make_bench(tmp_path)
    assert again.people.any() and again.store.job(1).who == "ann" and not again.people.refused()


def test_after_a_login_one_stays_on_this_site(with_accounts: Bench, browser: Any) -> None:
    for to in ("https://evil.example", "//evil.example", "/\\evil.example"):
        said = post(browser, "/login", {"name": "ann", "password": PASSWORD, "to": to},
                    follow_redirects=False)  # fmt: skip
        assert said.headers["location"] == "/"


def test_a_password_is_not_kept(with_accounts: Bench) -> None:
    whole = b"".join(p.read_bytes() for p in with_accounts.folder.glob("workbench.sqlite*"))
    assert b"$argon2id$" in whole and PASSWORD.encode() not in whole


def test_a_program_has_a_token_of_its_own(with_accounts: Bench, browser: Any) -> None:
    import re

    log_in(browser, "olga")
    token = re.search(
        r"<code>([\w-]{43})</code>", post(browser, "/tokens", {"label": "lims"}).text
    )[1]
    headers = {"authorization": f"Bearer {token}"}
    sent = browser.post("/api/logs", files={"file": ("x.csv", LOG)}, headers=headers)
    assert sent.status_code == 201
    asked = {"command": "calibrate", **sent.json(), "options": {"latitude": "47 deg"}}
    job = browser.post("/api/jobs", json=asked, headers=headers)
    assert job.json()["who"] == "olga" and '--latitude "47 deg"' in job.json()["line"]
    wrong = browser.post("/api/jobs", json={"command": "serve"}, headers=headers)
    assert wrong.status_code == 400 and wrong.json()["error"]["code"] == "workbench.offer"
    digest = with_accounts.people.tokens("olga")[0]["digest"]
    post(browser, "/tokens/end", {"digest": digest})
    assert browser.get("/api/jobs/1", headers=headers).status_code == 401
    paths = browser.get("/api/openapi.json").json()["paths"]
    assert {
        "/api/logs",
        "/api/jobs",
        "/api/jobs/{number}",
        "/api/jobs/{number}/files/{name}",
    } <= set(paths)


def test_other_hosts_need_accounts(tmp_path: Path) -> None:
    said = run("serve", tmp_path, "--host", "0.0.0.0", "--port", 0, "--workers", 1,
               "--database", tmp_path / "r.sqlite", code=1)  # fmt: skip
    assert "nobody has an account" in said.stderr
    assert loopback("::1") and loopback("localhost") and not loopback("10.0.0.1")


def test_an_account_is_made_on_the_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from foucault.cli import app

    words = ["serve", str(tmp_path), "--account", "ann", "--role", "administrator"]
    said = CliRunner().invoke(app, words, input=PASSWORD + "\n")
    assert said.exit_code == 0 and "ann is administrator" in said.output
    said = CliRunner().invoke(app, words, input="short\n")
    assert said.exit_code == 1 and "is not the name of its account" in said.stderr


def test_a_port_that_is_taken_is_said(tmp_path: Path) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        said = run("serve", tmp_path, "--port", taken.getsockname()[1], code=1)
    assert "Nothing can listen at" in said.stderr


# -- the file of jobs --------------------------------------------------------------------


def test_a_newer_a_broken_and_a_held_file_are_said(tmp_path: Path, monkeypatch: Any) -> None:
    store = Store(tmp_path)
    with store.writing() as db:
        db.execute("PRAGMA user_version = 9")
    with pytest.raises(FoucaultError, match="has version 9; this program knows 2"):
        Store(tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "workbench.sqlite").write_bytes(b"no database at all" * 100)
    with pytest.raises(FoucaultError, match="file is not a database") as broken:
        Store(tmp_path / "other")
    assert "runs and records do not need it, but jobs and accounts do" in broken.value.cure
    monkeypatch.setattr("foucault.workbench.store.PATIENCE", 0.1)
    with store.writing(), pytest.raises(FoucaultError, match="did not become free"):
        store.ask("ann", "look", [])


@pytest.mark.parametrize(("said", "words"), [
    ("database or disk is full", "is full"),
    ("attempt to write a readonly database", "only be read"),
])  # fmt: skip
def test_a_full_and_a_read_only_disk_are_said(tmp_path: Path, said: str, words: str) -> None:
    store = Store(tmp_path)
    with pytest.raises(FoucaultError, match=words), store.writing():
        raise sqlite3.OperationalError(said)


def test_a_job_of_a_worker_that_is_gone_waits_again_three_times(tmp_path: Path) -> None:
    """By a lock and no clock; what ends whoever reads it is not tried for ever."""
    import os

    store = Store(tmp_path)
    number = store.ask("ann", "look", ["inspect", "runs/{job}"]).number
    assert store.job(number).words == ("inspect", f"runs/{number}")
    for tries in (1, 2, 3):
        lock = hold(tmp_path, "one")
        job = store.claim("one")
        assert job is not None and job.tries == tries and store.claim("two") is None
        assert alive(tmp_path, "one") and store.recover() == 0
        os.close(lock)
        assert store.recover() == 1
        assert not store.end(job, "done", 0), "it is no longer this worker's"
    assert store.job(number).state == "failed" and store.claim("one") is None
    with pytest.raises(FoucaultError, match="There is no job 77"):
        store.job(77)


def test_a_fault_of_a_page_is_a_page(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    from starlette.testclient import TestClient

    from foucault.workbench.web import application

    monkeypatch.setattr(Store, "jobs", lambda *_, **__: 1 / 0)
    quiet = TestClient(application(bench), "http://127.0.0.1", raise_server_exceptions=False)
    said = quiet.get("/jobs")
    assert said.status_code == 500 and "This page has a fault (ZeroDivisionError)" in said.text


def test_what_is_not_done_has_no_files(bench: Bench, browser: Any) -> None:
    job = bench.store.ask("ann", "calibrate", [])
    said = browser.get(f"/jobs/{job.number}/files/result.json")
    assert said.status_code == 409 and "Wait until it is done" in said.text
    post(browser, f"/jobs/{job.number}/stop")
    assert bench.store.job(job.number).state == "stopped"


def test_without_its_libraries_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "foucault.workbench.serving", None)
    monkeypatch.delattr("foucault.workbench.serving", raising=False)
    assert "The workbench needs FastAPI, uvicorn" in run("serve", code=1).stderr
