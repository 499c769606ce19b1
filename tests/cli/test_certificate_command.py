"""The commands `certify` and `verify`: what they write, print, refuse, and how they end."""

from __future__ import annotations

import json
import re
import threading
from pathlib import Path
from typing import Any

import pytest

from commands import run
from foucault.certificate import issue
from foucault.cli.certificate import PASSWORD as VARIABLE
from foucault.errors import FoucaultError
from foucault.records import Records
from foucault.result import Level
from make_certificate import PASSWORD, make_key, make_laboratory, make_run
from make_records import edit

SAID = ("run", "laboratory.toml", "job.toml", "-o", "out")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, PASSWORD)
    make_laboratory(tmp_path)
    make_key(tmp_path)
    return tmp_path


@pytest.fixture
def kept(home: Path) -> Path:
    """With records that hold the run and its references, which the job then need not name."""
    run("records", "add", "run", "--date", "2025-03-14")
    job = (home / "job.toml").read_text()
    (home / "job.toml").write_text(job.replace("performed = 2025-03-14\n", ""))
    return home


def test_from_a_run_to_a_certificate_that_is_verified(home: Path) -> None:
    said = run("certify", *SAID, "--key", "laboratory.p12", code=0)
    assert "Certificate 2025-0042: out/2025-0042.pdf and out/2025-0042.xml" in said.output
    assert "Signed by Pendulum Calibration Laboratory." in said.output
    for name in ("pdf", "xml"):
        good = run("verify", f"out/2025-0042.{name}", "--trust", "laboratory.pem", code=0)
        assert "verdict: valid\n" in good.output and "issued on 2025-03-20" in good.output
        open_ = run("verify", f"out/2025-0042.{name}", code=3)
        assert "nothing vouches that the key" in open_.output
        assert "verdict: valid, but look at it" in open_.output
        file = home / "out" / f"2025-0042.{name}"
        file.write_bytes(file.read_bytes().replace(b"2025", b"2026", 1))
        bad = run("verify", file, "--trust", "laboratory.pem", code=4)
        assert "was changed" in bad.output and "verdict: not valid" in bad.output


def test_what_it_says_is_there_as_json(home: Path) -> None:
    made = json.loads(run("certify", *SAID, "--json", "--issued", "2025-04-01", code=0).stdout)
    assert made["number"] == "2025-0042" and made["signer"] == "" and made["entry"] is None
    found = json.loads(run("verify", made["dcc"], "--json", code=4).stdout)
    assert found["issued"] == "2025-03-20" or found["issued"] == "2025-04-01"
    assert found["faults"] == ["it is not signed"] and found["sha256"] == made["dcc_sha256"]


def test_a_file_is_never_overwritten_and_nothing_half_written_is_left(home: Path) -> None:
    assert "Not signed" in run("certify", *SAID, code=0).output
    before = {p.name: p.read_bytes() for p in (home / "out").iterdir()}
    again = run("certify", *SAID, "--issued", "2025-05-01", code=1)
    assert "is there already; a certificate is never overwritten" in again.output
    (home / "out" / "2025-0042.pdf").unlink()  # the second of two files is in the way
    run("certify", *SAID, code=1)
    assert {p.name for p in (home / "out").iterdir()} == {"2025-0042.xml"}
    assert (home / "out" / "2025-0042.xml").read_bytes() == before["2025-0042.xml"]


def test_a_doubtful_run_is_released_by_name(home: Path) -> None:
    make_run(home / "run", level=Level.DOUBTFUL)
    assert "The run is doubtful:" in run("certify", *SAID, code=1).output
    half = run("certify", *SAID, "--reviewer", "A. Noether", code=1)
    assert "--reviewer says nothing without --reason" in half.output
    run("certify", *SAID, "--reviewer", "A. Noether", "--reason", "one rest was bumped", code=0)
    text = (home / "out" / "2025-0042.xml").read_text()
    assert "A. Noether" in text and "one rest was bumped" in text


def test_a_key_that_does_not_open_or_has_expired_writes_nothing(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "wrong")
    wrong = run("certify", *SAID, "--key", "laboratory.p12", code=1)
    assert "The password does not open laboratory.p12" in wrong.output
    monkeypatch.delenv(VARIABLE)
    assert "does not open" in run("certify", *SAID, "--key", "laboratory.p12", code=1).output
    monkeypatch.setenv(VARIABLE, PASSWORD)
    make_key(home, first=-30, last=-1)
    old = run("certify", *SAID, "--key", "laboratory.p12", code=1)
    assert "so it cannot sign today" in old.output and not (home / "out").exists()


def test_a_password_is_asked_for_on_a_terminal(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from foucault.cli import certificate

    monkeypatch.delenv(VARIABLE)
    monkeypatch.setattr(certificate.sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr(certificate.typer, "prompt", lambda *_, **__: PASSWORD)
    assert certificate._key(Path("laboratory.p12")).holder == "Pendulum Calibration Laboratory"


def test_a_revision_replaces_and_says_so(home: Path) -> None:
    run("certify", *SAID, "--key", "laboratory.p12", code=0)
    half = run("certify", *SAID, "--change", "x", code=1)
    assert "--change says nothing without --replaces" in half.output
    said = run(
        "certify", *SAID, "--replaces", "out/2025-0042.pdf", "--change", "the street", code=0
    )
    assert "It replaces 2025-0042." in said.output
    second = run("certify", *SAID, "--replaces", "out/2025-0042-r1.xml", "--change", "y", code=0)
    assert "Certificate 2025-0042-r2" in second.output
    text = (home / "out" / "2025-0042-r1.xml").read_text()
    assert "<dcc:replacedUniqueIdentifier>2025-0042<" in text and "the street" in text
    other = run("certify", *SAID, "--replaces", "job.toml", "--change", "x", code=1)
    assert "is no Digital Calibration Certificate" in other.output
    gone = run("certify", *SAID, "--replaces", "nowhere.pdf", "--change", "x", code=1)
    assert "is neither a PDF nor" in gone.output


def test_records_give_day_references_and_review_and_keep_what_was_issued(home: Path) -> None:
    make_run(home / "run", level=Level.DOUBTFUL)
    run("records", "reference", "table 3", "table", "--certificate", "R-7", "--renew", "2026-01-31")
    run("records", "add", "run", "--date", "2025-03-14", "--reference", "table 3")
    job = (home / "job.toml").read_text()
    job = re.sub(r"used = .*|performed = .*|\[certificate.unused\]\n.*\n", "", job)
    unused = "".join(f'{w} = "x"\n' for w in ("gravity", "clock", "thermometer"))
    (home / "job.toml").write_text(f"{job}\n[certificate.unused]\n{unused}")
    refused = run("certify", "run", *SAID[1:], "--records", "records.sqlite", code=1)
    assert "The run is doubtful" in refused.output
    words = "the chamber explains it"
    run("records", "review", "run", "accepted", "--reason", words, "--who", "ann")
    said = run("certify", "run", *SAID[1:], "--records", "records.sqlite", "--who", "ann", code=0)
    assert "Kept in the records as entry 4." in said.output
    text = (home / "out" / "2025-0042.xml").read_text()
    for one in ("R-7", "2026-01-31", words, "ann", ">2025-03-14<"):
        assert one in text, one
    shown = run("records", "show", "0180-2214", "--at", "2025-04-01")
    assert "2025-03-20: certificate 2025-0042" in shown.output
    listed = json.loads(run("records", "show", "0180-2214", "--at", "2025-04-01", "--json").stdout)
    assert listed["certificates"][0]["certificate"] == "2025-0042"
    assert run("records", "audit").exit_code == 0
    run("records", "export", "-o", "j.jsonl")
    run("records", "rebuild", "--journal", "j.jsonl", "--database", "other.sqlite")
    assert [c.certificate for c in Records("other.sqlite").certificates()] == ["2025-0042"]


def test_records_tell_one_that_was_replaced_and_refuse_a_number_twice(kept: Path) -> None:
    with_records = (*SAID, "--records", "records.sqlite", "--key", "laboratory.p12")
    run("certify", *with_records, code=0)
    trusted = ("--trust", "laboratory.pem", "--records", "records.sqlite")
    first = run("verify", "out/2025-0042.pdf", *trusted, code=0)
    assert "the records know it, and nothing has replaced it" in first.output
    twice = run("certify", *with_records[:-3], "records.sqlite", "-o", "elsewhere", code=1)
    assert "Certificate 2025-0042 was issued on 2025-03-20 already" in twice.output
    assert not list((kept / "elsewhere").iterdir())
    more = ("--replaces", "out/2025-0042.xml", "--change", "x")
    run("certify", *with_records, *more, code=0)
    old = run("verify", "out/2025-0042.pdf", *trusted, code=4)
    assert "it was replaced by 2025-0042-r1 on 2025-03-20" in old.output
    fork = run("certify", *with_records, *more, "-o", "fork", code=1)
    assert "Certificate 2025-0042 was replaced by 2025-0042-r1 already" in fork.output
    copy = kept / "copy.xml"
    copy.write_bytes((kept / "out" / "2025-0042-r1.xml").read_bytes() + b"\n")
    assert "byte for byte" in run("verify", copy, *trusted, code=4).output
    changed = run("certify", *with_records, "--replaces", copy, "--change", "x", code=1)
    assert "is not 2025-0042-r1 as issued" in changed.output
    (kept / "new").mkdir()
    run("records", "add", "run", "--database", "new/records.sqlite")
    strange = ("--trust", "laboratory.pem", "--records", "new/records.sqlite")
    unknown = run("verify", "out/2025-0042-r1.pdf", *strange, code=4)
    assert "the records know no certificate 2025-0042-r1" in unknown.output
    lost = run("certify", *SAID, "--records", "new/records.sqlite", *more, code=1)
    assert "The records know no 2025-0042" in lost.output


def test_a_second_revision_of_the_same_one_is_refused_by_the_records(kept: Path) -> None:
    with_records = (*SAID, "--records", "records.sqlite")
    run("certify", *with_records, code=0)
    more = ("--replaces", "out/2025-0042.xml", "--change", "x")
    run("certify", *with_records, *more, code=0)
    job = (kept / "job.toml").read_text().replace('"2025-0042"', '"2025-0042-r1"')
    (kept / "job.toml").write_text(job)
    (kept / "out" / "2025-0042-r1.xml").unlink()
    again = run("certify", *with_records, *more, code=1)
    assert "was replaced by 2025-0042-r1 already" in again.output


def test_a_run_that_was_edited_or_rejected_is_refused(kept: Path) -> None:
    with_records = (*SAID, "--records", "records.sqlite")
    run("records", "review", "run", "rejected", "--reason", "the mount was loose")
    rejected = run("certify", *with_records, code=1)
    assert "was rejected: the mount was loose" in rejected.output
    edit(kept / "run")
    assert run("certify", *with_records, code=1).exit_code == 1
    assert run("certify", "run", *SAID[1:], "--records", "nowhere.sqlite", code=1).exit_code == 1


def test_of_two_who_give_a_number_at_once_one_is_refused(kept: Path) -> None:
    ends: list[Any] = []
    ready = threading.Barrier(2)

    def one(folder: str) -> None:
        records = Records("records.sqlite")
        ready.wait()
        try:
            ends.append(issue.issue("run", SAID[1:3], folder, records=records).number)
        except FoucaultError as problem:
            ends.append(problem.code)
        finally:
            records.close()

    both = [threading.Thread(target=one, args=(name,)) for name in ("a", "b")]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert sorted(ends) == ["2025-0042", "certificate.issued"]
    assert sorted(len(list((kept / name).iterdir())) for name in "ab") == [0, 2]


def test_an_entry_without_its_files_is_not_kept(kept: Path) -> None:
    (kept / "out").mkdir()
    (kept / "out" / "2025-0042.xml").write_text("in the way")
    run("certify", *SAID, "--records", "records.sqlite", code=1)
    assert Records("records.sqlite").certificates() == []


@pytest.mark.parametrize(
    "name", ["typst", "xmlschema", "signxml", "pyhanko", "lxml", "cryptography"]
)
def test_what_is_not_installed_is_said(
    name: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    for module in [m for m in sys.modules if m.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    from foucault.certificate import dcc

    dcc.schema.cache_clear()
    said = run("certify", *SAID, "--key", "laboratory.p12", code=1)
    assert "which is not installed" in said.output and "foucault[certificate]" in said.output
    dcc.schema.cache_clear()
