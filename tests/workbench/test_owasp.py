"""The ten of OWASP (2021), each tried as an attacker would; docs/workbench.md has the outcome."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.workbench.bench import Bench
from make_workbench import PASSWORD, client, make_bench, post, work_off


@pytest.fixture
def bench(tmp_path: Path, quick: None) -> Bench:
    made = make_bench(tmp_path / "bench")
    for name, role in (("ann", "administrator"), ("olga", "operator"), ("otto", "operator")):
        made.people.add(name, role, PASSWORD)
    return made


@pytest.fixture
def browser(bench: Bench) -> Iterator[Any]:
    with client(bench) as made:
        post(made, "/login", {"name": "olga", "password": PASSWORD})
        yield made


def test_1_what_is_of_another_is_not_reached(bench: Bench, browser: Any) -> None:
    """Broken access control: jobs, tokens and pages of others, by their numbers."""
    job = bench.store.ask("ann", "calibrate", ["calibrate"])
    assert post(browser, f"/jobs/{job.number}/stop").status_code == 403
    bench.people.token("ann", "hers")
    digest = bench.people.tokens("ann")[0]["digest"]
    post(browser, "/tokens/end", {"digest": digest})
    assert bench.people.tokens("ann")
    for path in ("/journal", "/certify/1"):
        assert browser.get(path).status_code == 403
    for path in ("/accounts", "/accounts/close", "/records/review", "/records/event"):
        assert post(browser, path, {"name": "ann", "role": "administrator"}).status_code == 403
    assert "ann" not in browser.get("/accounts").text


def test_2_what_is_secret_is_not_kept_in_words(bench: Bench, browser: Any) -> None:
    """Cryptographic failures: what a copy of the file of jobs gives away."""
    token = bench.people.token("olga", "x")
    whole = b"".join(p.read_bytes() for p in bench.folder.glob("workbench.sqlite*"))
    assert token.encode() not in whole and PASSWORD.encode() not in whole
    assert browser.cookies["foucault"].encode() not in whole
    assert oct(bench.store.file.stat().st_mode)[-3:] == "600"


@pytest.mark.parametrize("text", [
    "' OR '1'='1", "x'; DROP TABLE run; --", "{{ 7 * 7 }}", "{% raw %}", "$(touch hacked)",
    "`touch hacked`", "%0d%0aSet-Cookie: a=b", "<img src=x onerror=alert(1)>", "\u202egnp.exe",
])  # fmt: skip
def test_3_words_stay_words(bench: Bench, browser: Any, text: str) -> None:
    """Injection: SQL, templates, shells, headers, scripts."""
    page = browser.get("/instruments", params={"find": text})
    assert page.status_code == 200 and ">49<" not in page.text
    assert "<img src=x" not in page.text and "a" not in page.cookies
    assert post(browser, "/login", {"name": text, "password": PASSWORD}).status_code == 403
    post(browser, "/login", {"name": "olga", "password": PASSWORD})
    sent = post(browser, "/logs", files={"file": (f"{text}.csv", b"t,ax,ay,az\n0,0,0,9.8\n")})
    asked = {"log": sent.url.path.split("/")[-1], "--latitude": text}
    post(browser, "/do/calibrate", asked)
    jobs = work_off(bench)
    assert not jobs or jobs[-1].state in ("failed", "done")
    assert not list(bench.folder.parent.rglob("hacked"))


def test_4_and_7_a_session_is_not_foisted_nor_guessed(bench: Bench) -> None:
    """Insecure design, authentication: fixation, guessing, a name that is closed."""
    with client(bench) as victim:
        victim.cookies.set("foucault", "known to the attacker")
        post(victim, "/login", {"name": "otto", "password": PASSWORD})
        values = {c.value for c in victim.cookies.jar if c.name == "foucault"}
        with client(bench) as attacker:
            attacker.cookies.set("foucault", "known to the attacker")
            assert attacker.get("/jobs").url.path == "/login"
        assert len(values - {"known to the attacker"}) == 1
    with client(bench) as attacker:
        codes = [post(attacker, "/login", {"name": f"no{k}", "password": "x" * 12}).status_code
                 for k in range(21)]  # fmt: skip
        assert codes[0] == 403 and codes[-1] == 429  # from one address, whatever the names


def test_5_nothing_is_shown_that_helps(bench: Bench, browser: Any) -> None:
    """Misconfiguration: no listing, no trace, no documentation with scripts from elsewhere."""
    for path in ("/docs", "/redoc", "/static/", "/.git/config", "/api/docs", "/metrics"):
        page = browser.get(path)
        assert page.status_code in (401, 404), path
        assert "Traceback" not in page.text and "python" not in page.text.lower()
    assert browser.request("TRACE", "/").status_code in (400, 403, 405)


def test_6_scripts_are_those_that_lie_here(browser: Any) -> None:
    """Outdated components: what a page loads is in the package, and of a version that is named."""
    text = browser.get("/").text
    assert not re.search(r'(?:src|href)="(?:https?:)?//', text)
    script = browser.get("/static/htmx.min.js").text
    assert re.search(r'version:"2\.\d+\.\d+"', script)


class Evil:
    """Is run by whoever unpickles it."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.system, ("touch hacked",)


def test_8_what_is_sent_in_is_not_run(bench: Bench, browser: Any) -> None:
    """Integrity: a file with an object of Python in it, and a campaign that names a program."""
    buffer = io.BytesIO()
    np.savez(buffer, time=np.array([Evil()], object), gyro=np.array([Evil()], object))
    sent = post(browser, "/logs", files={"file": ("x.npz", buffer.getvalue())})
    page = browser.get(sent.url.path)
    work_off(bench)
    page = browser.get(sent.url.path)
    assert "Not to be read as it is" in page.text or "could not be looked at" in page.text
    assert not list(bench.folder.parent.rglob("hacked")) and not Path("hacked").exists()


def test_9_who_did_what_is_kept(bench: Bench, browser: Any) -> None:
    """Logging: what an operator did stands with the name, and no page changes it."""
    post(browser, "/tokens", {"label": "x"})
    with bench.records() as records:
        entry = list(records.entries())[-1]
        assert (entry.who, entry.kind) == ("olga", "account") and not records.audit()
    for path in ("/journal", "/records/audit", "/records/rebuild"):
        assert post(browser, path).status_code in (400, 403, 404, 405)


@pytest.mark.parametrize("given", [
    "file = http://127.0.0.1:1/x", "file = //127.0.0.1/x", "file = file:///etc/passwd",
    "file = /proc/self/environ", 'more = ["../../../etc/passwd"]',
])  # fmt: skip
def test_10_no_address_is_fetched(bench: Bench, browser: Any, given: str) -> None:
    """Forged requests of the server: by a log, by its words, by a certificate."""
    sent = post(browser, "/logs", files={"file": ("x.csv", b"t,ax,ay,az\n0,0,0,9.8\n")})
    work_off(bench)
    answer = post(browser, f"{sent.url.path}/look", {"set": given})
    if answer.status_code != 400:  # the name of a file beside the log, which there is none
        work_off(bench)
        text = browser.get(sent.url.path).text
        assert "root:" not in text and "PATH=" not in text


def test_10_a_certificate_reaches_no_file(bench: Bench, browser: Any) -> None:
    text = (
        '<?xml version="1.0"?><!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/passwd">'
        '<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
        "<dcc:digitalCalibrationCertificate "
        'xmlns:dcc="https://ptb.de/dcc">&x;&b;</dcc:digitalCalibrationCertificate>'
    )
    sent = post(browser, "/verify", files={"file": ("c.xml", text.encode())})
    work_off(bench)
    page = browser.get(sent.url.path).text
    assert "root:" not in page and "aaaaaaaaaaaaaaaaaaaa" not in page
    assert "it declares entities" in page and "Traceback" not in page
