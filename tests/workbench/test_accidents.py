"""What happens to a workbench by accident or behind its back: own words, and nothing lost."""

from __future__ import annotations

import gzip
import io
import json
import shutil
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.records import Records
from foucault.records.entries import Account
from foucault.workbench import people, worker
from foucault.workbench.bench import Bench
from foucault.workbench.serving import add_account
from foucault.workbench.store import Store, hold
from make_records import edit, make_runs
from make_workbench import PASSWORD, client, make_bench, post


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A workbench with a run that is kept, where nobody waits long for a database."""
    monkeypatch.setattr("foucault.records.database.PATIENCE", 0.2)
    made = make_bench(tmp_path / "bench")
    job = made.store.ask("ann", "calibrate", ["calibrate", "logs/x/x.csv", "-o", "runs/{job}"])
    make_runs(made.folder / "runs", 1, folder=str(job.number))
    with made.store.writing() as db:
        db.execute("UPDATE job SET state = 'done', code = 0 WHERE number = ?", (job.number,))
    with client(made) as browser:
        post(browser, f"/jobs/{job.number}/keep", {"instrument": "IMU 7", "date": "2026-03-01"})
    return made


@pytest.fixture
def browser(bench: Bench) -> Iterator[Any]:
    with client(bench) as made:
        yield made


# -- who changed an account ----------------------------------------------------------------


def accounts(bench: Bench) -> list[tuple[str, str, str, str, str]]:
    with bench.records() as records:
        assert records is not None and not records.audit()
        return [(e.who, b.name, b.change, b.role, b.words) for e, b in records.said(Account)]


def test_every_change_of_accounts_is_in_the_journal(
    bench: Bench, browser: Any, quick: None
) -> None:
    add_account(bench.folder, "ann", "administrator", PASSWORD, None)
    post(browser, "/login", {"name": "ann", "password": PASSWORD})
    for role in ("operator", "reviewer"):
        post(browser, "/accounts", {"name": "olga", "role": role, "password": PASSWORD})
    post(browser, "/tokens", {"label": "lims"})
    digest = bench.people.tokens("ann")[0]["digest"]
    post(browser, "/tokens/end", {"digest": digest})
    post(browser, "/tokens/end", {"digest": digest})  # ended once
    post(browser, "/accounts/close", {"name": "olga"})
    said = post(browser, "/accounts/close", {"name": "nobody"})
    assert said.status_code == 404 and "Nobody has an account called" in said.text
    found = accounts(bench)
    assert [one[1:] for one in found] == [
        ("ann", "made", "administrator", ""), ("olga", "made", "operator", ""),
        ("olga", "changed", "reviewer", ""), ("ann", "token made", "", "lims"),
        ("ann", "token ended", "", "lims"), ("olga", "closed", "", ""),
    ]  # fmt: skip
    assert {one[0] for one in found[1:]} == {"ann"} and found[0][0]
    assert PASSWORD not in browser.get("/journal").text
    assert "token made" in browser.get("/journal").text


def test_what_the_journal_cannot_keep_is_not_changed(
    bench: Bench, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("foucault.records.database.PATIENCE", 0.05, raising=False)
    bench.people.add("ann", "administrator", PASSWORD)

    def refuse(_: Any) -> None:
        raise FoucaultError("records.locked", "held", "wait")

    for change in (
        lambda: bench.people.add("eve", "operator", PASSWORD, refuse),
        lambda: bench.people.token("ann", "x", 1.0, refuse),
    ):
        with pytest.raises(FoucaultError, match="held"):
            change()
    assert [a["name"] for a in bench.people.all()] == ["ann"] and not bench.people.tokens("ann")
    token = bench.people.tokens("ann") or bench.people.token("ann", "x")
    assert bench.people.who(token, "token").name == "ann"


# -- what is sent in -----------------------------------------------------------------------


def bombs() -> dict[str, bytes]:
    """Return files that unpack to 80 MB of nothing."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("gyro.npy", bytes(80 << 20))
    return {"x.csv.gz": gzip.compress(b"0\n" * (40 << 20), 1), "x.npz": packed.getvalue()}


def test_a_bomb_is_not_kept(bench: Bench, browser: Any) -> None:
    for name, data in bombs().items():
        assert len(data) < 1 << 20
        said = post(browser, "/logs", files={"file": (name, data)})
        assert said.status_code == 413, name
        assert f"{name} unpacks to more than 200 times its size" in said.text
    assert not list((bench.folder / "logs").iterdir()) and len(bench.store.jobs()) == 1


def test_a_log_that_is_packed_well_is_kept(browser: Any) -> None:
    """A recording at rest that repeats itself is packed well, and still no bomb."""
    text = b"t,ax,ay,az\n" + b"".join(b"%d,0,0,9.8\n" % i for i in range(20000))
    said = post(browser, "/logs", files={"file": ("x.csv.gz", gzip.compress(text))})
    assert said.url.path.startswith("/logs/")
    said = post(browser, "/logs", files={"file": ("y.csv.gz", gzip.compress(text)[:900])})
    assert said.url.path.startswith("/logs/")  # a damaged one is for its reader


def test_a_job_that_wants_all_memory_fails_in_words(bench: Bench) -> None:
    def greedy(words: Any, tell: Any) -> int:
        return int(np.ones((1 << 37,), np.uint8).sum())  # 128 GB

    job = one(bench, greedy)
    assert job.state == "failed" and job.tries == 1
    assert "needs more memory than a job may have" in bench.said(job)


def one(bench: Bench, run: Any) -> Any:
    """Let a worker do one job by `run`."""
    import os

    number = bench.store.ask("ann", "allan", ["allan"]).number
    lock, before = hold(bench.folder, "here"), Path.cwd()
    os.chdir(bench.folder)
    try:
        worker._one(bench.store, bench.store.claim("here"), run)
    finally:
        os.chdir(before)
        os.close(lock)
    return bench.store.job(number)


# -- behind its back -----------------------------------------------------------------------


def test_a_file_of_jobs_that_is_taken_away_is_not_made_anew(bench: Bench, browser: Any) -> None:
    """Nobody gets in because the accounts are gone."""
    away = bench.folder / "elsewhere"
    bench.store.file.rename(away)
    said = browser.get("/jobs")
    assert said.status_code == 503 and "is not where it was" in said.text
    assert not bench.store.file.exists()
    away.rename(bench.store.file)
    assert browser.get("/jobs").status_code == 200


def test_records_that_are_taken_away_are_not_begun_anew(bench: Bench, browser: Any) -> None:
    file = bench.folder / "records.sqlite"
    away = bench.folder / "elsewhere"
    file.rename(away)
    for said in (browser.get("/instruments"),
                 post(browser, "/jobs/1/keep", {"instrument": "x"})):  # fmt: skip
        assert said.status_code == 503 and "records.sqlite is not where it was" in said.text
    assert not file.exists()
    away.rename(file)
    assert "IMU 7" in browser.get("/instruments").text


def test_a_run_folder_that_is_deleted_is_said(bench: Bench, browser: Any) -> None:
    shutil.rmtree(bench.folder / "runs" / "1")
    page = browser.get("/jobs/1")
    assert page.status_code == 200 and "result.json" in page.text
    page = browser.get("/instrument?name=IMU 7")
    assert "was taken in" in page.text or "is not there" in page.text
    assert browser.get("/instruments").status_code == 200
    with bench.records() as records:
        assert any("is not there" in f.what for f in records.audit())


def test_a_run_folder_that_is_edited_is_said(bench: Bench, browser: Any) -> None:
    edit(bench.folder / "runs" / "1")
    page = browser.get("/instrument?name=IMU 7")
    assert page.status_code == 400 and "its result.json" in page.text
    assert browser.get("/certify/1").status_code in (400, 409)


def test_two_servers_have_one_database(bench: Bench, tmp_path: Path) -> None:
    """Two workbenches over the same records: entries of both, one chain."""
    other = make_bench(tmp_path / "other")
    other.database = bench.database
    for k, one_ in enumerate((bench, other) * 4):
        with one_.records(f"user {k}", make=True) as records:
            records.reference(f"table {k}", "table")
    with bench.records() as records:
        assert not records.audit() and len(records.references()) == 8
        assert {e.who for e in records.entries()} >= {f"user {k}" for k in range(8)}


def test_a_records_database_that_is_held_full_or_newer_is_a_page(
    bench: Bench, browser: Any
) -> None:
    import sqlite3

    held = sqlite3.connect(bench.database, isolation_level=None)
    held.execute("BEGIN IMMEDIATE")
    began = time.monotonic()
    said = post(browser, "/records/reference", {"name": "t", "what": "table"})
    assert said.status_code == 503 and time.monotonic() - began < 10
    held.execute("ROLLBACK")
    held.execute("UPDATE alembic_version SET version_num = '9999'")
    held.close()
    said = browser.get("/instruments")
    assert said.status_code == 400 and "9999" in said.text and "Update Foucault" in said.text


def test_a_clock_that_jumps_back_keeps_the_order(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jobs go by their numbers and entries by their chain, whatever the clock says."""
    monkeypatch.setattr("foucault.workbench.store.now", lambda: "1999-01-01T00:00:00+00:00")
    first = bench.store.ask("ann", "look", []).number
    second = bench.store.ask("ann", "look", []).number
    assert bench.store.claim("x").number == first < second
    assert [j.number for j in bench.store.jobs(2)] == [second, first]


def test_a_session_is_no_longer_after_a_clock_that_was_set_back(
    bench: Bench, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It lasts until the time that was said when it was begun; logged out it is gone at once."""
    bench.people.add("ann", "administrator", PASSWORD)
    token = bench.people.log_in("ann", PASSWORD, "here")
    real = time.time
    monkeypatch.setattr(people.time, "time", lambda: real() - 86400.0)
    who = bench.people.who(token, "browser")
    assert who is not None
    bench.people.log_out(who.session, "ann")
    assert bench.people.who(token, "browser") is None
    monkeypatch.setattr(people.time, "time", lambda: real() + people.LASTS + 1)
    token = bench.people.log_in("ann", PASSWORD, "here")
    assert bench.people.who(token, "browser") is not None


def test_a_setting_is_kept(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.setting("records") == ""
    store.set("records", "a")
    store.set("records", "b")
    assert Store(tmp_path).setting("records") == "b" and len(store.secret) == 32


def test_the_journal_can_be_made_again(bench: Bench, quick: None, tmp_path: Path) -> None:
    """Entries of accounts are exported and taken in as all others."""
    bench.people.add("ann", "operator", PASSWORD, bench.told("root"))
    with bench.records() as records:
        (tmp_path / "journal.jsonl").write_text(records.export())
        last = json.loads(records.export().splitlines()[-1])
        assert last["kind"] == "account" and last["who"] == "root"
    again = Records(bench.folder / "again.sqlite", make=True)
    again.rebuild(tmp_path / "journal.jsonl")
    assert not again.audit()
    again.close()
