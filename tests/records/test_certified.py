"""Certificates that the records know, in both databases: number, revision, references, reviews."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from foucault.certificate import issue
from foucault.certificate.issue import Issued, from_records
from foucault.errors import FoucaultError
from foucault.records import Records
from make_certificate import make_laboratory
from make_records import edit


@pytest.fixture
def kept(records: Records, tmp_path: Path) -> tuple[Records, Path]:
    """Records that hold a run to certify, beside those of another instrument."""
    home = tmp_path / "laboratory"
    home.mkdir()
    run, *_ = make_laboratory(home)
    taken, failed = records.add([run], date="2025-03-14", instrument="IMU 7")
    assert len(taken) == 1 and not failed
    return records, home


def issued(records: Records, home: Path, **more: Any) -> Issued:
    files = [home / "laboratory.toml", home / "job.toml"]
    return issue.issue(home / "run", files, home / "out", records=records, **more)


def test_a_number_is_given_once_and_replaced_once(kept: tuple[Records, Path]) -> None:
    records, home = kept
    first = issued(records, home)
    assert first.number == "2025-0042" and first.entry == records.head[0]
    assert [c.certificate for c in records.certificates()] == ["2025-0042"]
    with pytest.raises(FoucaultError, match="2025-0042"):
        issued(records, home)
    second = issued(records, home, replaces=first.page, change="street")
    assert (second.number, second.replaces) == ("2025-0042-r1", "2025-0042")
    with pytest.raises(FoucaultError, match="replaced"):
        issued(records, home, replaces=first.dcc, change="city")
    edited = home / "edited.xml"
    edited.write_bytes(second.dcc.read_bytes().replace(b"Toulouse", b"Bordeaux"))
    with pytest.raises(FoucaultError, match="as issued"):
        issued(records, home, replaces=edited, change="city")
    assert len(list((home / "out").iterdir())) == 4 and not records.audit()


def test_what_cannot_be_written_is_not_in_the_records(kept: tuple[Records, Path]) -> None:
    records, home = kept
    (home / "out").mkdir()
    (home / "out" / "2025-0042.xml").write_text("somebody else's")
    with pytest.raises(FoucaultError, match="2025-0042"):
        issued(records, home)
    assert not records.certificates() and not (home / "out" / "2025-0042.pdf").exists()
    assert (home / "out" / "2025-0042.xml").read_text() == "somebody else's"


def test_references_reviews_and_the_day_come_from_them(kept: tuple[Records, Path]) -> None:
    records, home = kept
    run = records.run(str(home / "run"))
    records.reference("table 3", "table", "T-9", "2027-01-31")
    found = from_records(records, home / "run")
    assert found["performed"] == "2025-03-14" and found["known"]["table 3"]["due"] == "2027-01-31"
    assert found["entry"] == records.head[1] and "review" not in found
    records.review(str(run.number), "accepted", "looked at twice")
    assert from_records(records, home / "run")["review"].reason == "looked at twice"
    records.review(str(run.number), "rejected", "the table was bumped")
    with pytest.raises(FoucaultError, match="the table was bumped"):
        issued(records, home)
    assert not (home / "out").exists() or not list((home / "out").iterdir())


def test_a_run_that_was_edited_is_not_certified(kept: tuple[Records, Path]) -> None:
    records, home = kept
    edit(home / "run")
    with pytest.raises(FoucaultError):
        issued(records, home)
    assert not records.certificates()
