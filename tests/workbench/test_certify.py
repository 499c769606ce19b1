"""A certificate from the workbench: what lacks is asked for by name, issued, replaced, verified."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from foucault.workbench import certify
from foucault.workbench.bench import Bench
from foucault.workbench.store import Job
from make_certificate import LABORATORY, PASSWORD, make_key, make_run
from make_workbench import client, make_bench, post, work_off

SAID = {
    "number": "2026-0042", "received": "2025-03-10", "performed": "2025-03-14",
    "issued": "2025-03-20", "used": ["gravimeter point 3", "frequency standard", "thermometer 12"],
    "customer.name": "Aero <Works>", "customer.street": "Hangar 4", "customer.postcode": "31000",
    "customer.city": "Toulouse", "customer.country": "FR", "item.description": "IMU",
    "item.condition": 'undamaged, "sealed"', "method.deviations": "none",
    "adjustment.done": "none", "unused.table": "turned by hand",
}  # fmt: skip


def done(bench: Bench, folder: Path, **changes: Any) -> Job:
    """Put a run that stands into the workbench, as the job that has made it."""
    job = bench.store.ask("ann", "calibrate", ["calibrate", "logs/x/x.csv", "-o", "runs/{job}"])
    make_run(bench.folder / "runs" / str(job.number), **changes)
    with bench.store.writing() as db:
        db.execute("UPDATE job SET state = 'done', code = 0 WHERE number = ?", (job.number,))
    return job


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A workbench with the laboratory's file and key, and a run that is kept."""
    made = make_bench(tmp_path / "bench")
    home = made.folder / certify.HOME
    home.mkdir()
    (home / "laboratory.toml").write_text(LABORATORY)
    make_key(home)
    monkeypatch.setenv("FOUCAULT_KEY_PASSWORD", PASSWORD)
    done(made, tmp_path)
    with client(made) as browser:
        post(browser, "/jobs/1/keep", {"instrument": "IMU 7", "date": "2025-03-14"})
    return made


@pytest.mark.thorough
def test_what_lacks_is_asked_for_and_issued_and_replaced(bench: Bench) -> None:
    with client(bench) as browser:
        page = browser.get("/certify/1").text
        assert "It lacks" in page and "signed with the key of the laboratory" in page
        for name in ("number", "customer.name", "item.condition", "unused.table"):
            assert f"<code>{name}</code>" in page
        assert 'name="laboratory.name"' not in page  # its file has said it
        some = {k: v for k, v in SAID.items() if k not in ("item.condition", "unused.table")}
        refused = post(browser, "/certify/1", some)
        assert refused.status_code == 400 and not work_off(bench)
        alert = re.search(r'role="alert">(.*?)</section>', refused.text, re.S)[1]
        assert "lacks item.condition, used or unused.table" in alert
        assert 'value="Aero &lt;Works&gt;"' in refused.text  # nothing that was written is lost
        post(browser, "/certify/1", SAID)
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        said = browser.get(f"/jobs/{job.number}").text
        assert "2026-0042.pdf" in said and "2026-0042.xml" in said
        assert f"--who {job.who}" in said and "--records records.sqlite" in said
        for ending, begins in (("pdf", b"%PDF-"), ("xml", b"<?xml")):
            got = browser.get(f"/jobs/{job.number}/files/2026-0042.{ending}")
            assert got.content.startswith(begins)
            assert got.headers["content-disposition"].startswith("attachment")
        # the same number once more
        post(browser, "/certify/1", SAID)
        again = work_off(bench)[-1]
        assert again.state == "failed" and "2026-0042" in bench.said(again)
        # a revision
        form = browser.get(f"/certify/1?replaces={job.number}").text
        assert "Replace a certificate" in form and 'value="Toulouse"' in form
        change = {**SAID, "customer.city": "Blagnac", "replaces": str(job.number)}
        assert "says what is changed" in post(browser, "/certify/1", change).text
        post(browser, "/certify/1", {**change, "change": "city of the customer"})
        revised = work_off(bench)[-1]
        assert revised.state == "done", bench.said(revised)
        assert (bench.folder / f"runs/{revised.number}/2026-0042-r1.pdf").is_file()
        # verified: the new one, the replaced one, one with a byte changed
        files = [bench.folder / f"runs/{revised.number}/2026-0042-r1.pdf",
                 bench.folder / f"runs/{job.number}/2026-0042.xml"]  # fmt: skip
        edited = bytearray(files[0].read_bytes())
        edited[len(edited) // 2] ^= 1
        words = []
        for data in (files[0].read_bytes(), files[1].read_bytes(), bytes(edited)):
            name = "c.xml" if data.startswith(b"<") else "c.pdf"
            sent = post(browser, "/verify", files={"file": (name, data)})
            work_off(bench)
            words.append(re.search(r'class="big">([^<]*)', browser.get(sent.url.path).text)[1])
        assert words == ["Valid", "Not valid", "Not valid"]
        assert "it was replaced by 2026-0042-r1" in "".join(
            bench.said(j) for j in bench.store.jobs(9)
        )
        with bench.records() as records:
            assert [c.certificate for c in records.certificates()] == ["2026-0042", "2026-0042-r1"]
            assert not records.audit()


def test_the_day_of_issue_is_left_open(bench: Bench) -> None:
    with client(bench) as browser:
        page = browser.get("/certify/1").text
    day = re.search(r'<input type="date" name="issued" value="([^"]*)"', page)
    assert day is not None and day[1] == ""
    assert re.search(r'<input type="date" name="performed" value="2025-03-14"', page)


def test_what_is_not_kept_is_not_certified(bench: Bench, tmp_path: Path) -> None:
    done(bench, tmp_path, seed=9)
    with client(bench) as browser:
        said = browser.get("/certify/2")
        assert said.status_code == 409 and "Keep the run on its page first" in said.text
        assert browser.get("/certify/99").status_code == 404


@pytest.mark.thorough
def test_a_run_that_did_not_pass_needs_a_reason(bench: Bench, tmp_path: Path) -> None:
    from foucault.result import Level, Verdict

    job = done(bench, tmp_path, seed=5, verdict=Verdict(Level.DOUBTFUL, ("a rest was bumped",)))
    with client(bench) as browser:
        post(browser, f"/jobs/{job.number}/keep", {"instrument": "IMU 8", "date": "2025-03-14"})
        assert "a rest was bumped" in browser.get(f"/certify/{job.number}").text
        said = post(browser, f"/certify/{job.number}", SAID)
        assert said.status_code == 400 and "Say why it is released" in said.text
        post(browser, f"/certify/{job.number}", {**SAID, "reason": "left out"})
        asked = work_off(bench)[-1]
        assert asked.state == "done", bench.said(asked)
        assert "--reason=left out" in asked.words


@pytest.mark.thorough
def test_conformity_goes_by_the_limits_of_the_instrument(bench: Bench) -> None:
    more = {**SAID, "conformity.specification": "data sheet", "conformity.rule": "guarded"}
    with client(bench) as browser:
        said = post(browser, "/certify/1", more)
        assert said.status_code == 400 and "The instrument has no limits" in said.text
        post(browser, "/records/tolerance", {"instrument": "IMU 7",
                                             "text": '"accel.bias" = "60 mg"'})  # fmt: skip
        post(browser, "/certify/1", more)
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)


def test_a_key_that_has_expired_signs_nothing(bench: Bench) -> None:
    make_key(bench.folder / certify.HOME, first=-20, last=-10)
    with client(bench) as browser:
        post(browser, "/certify/1", SAID)
        job = work_off(bench)[-1]
        assert job.state == "failed" and "cannot sign today" in bench.said(job)
        assert not list(bench.folder.glob(f"runs/{job.number}/*.pdf"))
        with bench.records() as records:
            assert not records.certificates()


def test_what_is_said_wrongly_is_said(bench: Bench) -> None:
    for more in ({"customer.country": "France"}, {"received": "2026-99-01"},
                 {"number": "../../x"}, {"performed": "2024-01-01"}):  # fmt: skip
        with client(bench) as browser:
            post(browser, "/certify/1", SAID | more)
            job = work_off(bench)[-1]
            assert job.state == "failed", more
    assert not list(bench.folder.parent.glob("*.pdf"))


def test_it_is_a_reviewers_work(bench: Bench) -> None:
    bench.people.add("olga", "operator", "quiet granite bench 7")
    with client(bench) as browser:
        post(browser, "/login", {"name": "olga", "password": "quiet granite bench 7"})
        assert browser.get("/certify/1").status_code == 403
        assert post(browser, "/certify/1", SAID).status_code == 403
        assert browser.get("/verify").status_code == 200


@pytest.mark.thorough
def test_a_laboratory_system_gets_it_over_http(bench: Bench) -> None:
    with client(bench) as browser:
        some = {k: v for k, v in SAID.items() if k != "number"}
        said = browser.post("/api/jobs/1/certify", json={"certificate": some})
        assert said.status_code == 400
        assert said.json()["error"]["code"] == "certificate.missing"
        assert "lacks number" in said.json()["error"]["message"]
        asked = browser.post("/api/jobs/1/certify", json={"certificate": SAID})
        assert asked.status_code == 201
        work_off(bench)
        job = browser.get(f"/api/jobs/{asked.json()['number']}").json()
        assert job["files"] == ["2026-0042.pdf", "2026-0042.xml"], job
        got = browser.get(f"/api/jobs/{job['number']}/files/2026-0042.xml")
        assert got.content.startswith(b"<?xml")


@pytest.mark.parametrize("data", [b"nothing of the kind", b"%PDF-1.7\n%%EOF", b"<dcc/>"])
def test_what_is_no_certificate_is_said(bench: Bench, data: bytes) -> None:
    with client(bench) as browser:
        sent = post(browser, "/verify", files={"file": ("c.pdf", data)})
        job = work_off(bench)[-1]
        said = browser.get(sent.url.path).text
    assert (job.state == "failed" or "Not valid" in said) and "Traceback" not in said
