"""Runs taken in, judged, audited and indexed again, in SQLite and in PostgreSQL."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from foucault import run_folder
from foucault.errors import FoucaultError
from foucault.records import Records
from foucault.records import database as db
from foucault.records import entries as kept
from foucault.records.entries import Entry, Interval, broken
from make_compare import make_results
from make_records import edit, make_records, make_runs, tamper
from refusals import refuses


def content(records: Records) -> dict[str, list[tuple[Any, ...]]]:
    from foucault.records.store import _content

    with records.database.reading() as connection:
        return _content(connection)


def test_a_run_is_taken_in_with_all_that_its_folder_says(records: Records) -> None:
    runs = records.runs("0042")
    assert [r.holds[:4] for r in runs] == ["2024", "2025", "2026"]
    assert {r.instrument for r in runs} == {"IMU 0042"}
    assert runs[0].dated == "computed" and runs[0].verdict == "pass"
    result = run_folder.load_result(records.folder_of(runs[0]))
    rows = content(records)
    mine = [r for r in rows["coefficient"] if r[0] == runs[0].number]
    assert [r[2] for r in mine] == list(result.coefficients.names)
    assert [r[4] for r in mine] == result.coefficients.values.tolist()
    run = next(r for r in rows["run"] if r[0] == runs[0].number)
    assert result.coefficients.cov is not None
    assert bytes(run[-1]) == result.coefficients.cov.astype("<f8").tobytes()
    assert {r[1] for r in rows["log"]} >= set(records.logs_of(runs[0])) != set()


def test_taken_in_twice_it_is_there_once(records: Records) -> None:
    before = records.head
    added, failed = records.add([records.folder_of(r) for r in records.runs()])
    assert (added, failed) == ([], []) and records.head == before


def test_a_folder_that_cannot_be_read_does_not_stop_the_others(
    records: Records, tmp_path: Path
) -> None:
    good = make_runs(tmp_path, 1, "7", seed=9)
    added, failed = records.add([tmp_path / "nowhere", *good])
    assert [r.instrument for r in added] == ["IMU 7"]
    assert [(f.name, p.code) for f, p in failed] == [("nowhere", "result.missing")]


@pytest.mark.parametrize("damage", [Path.unlink, lambda file: file.write_bytes(b"PAR1")])
def test_a_folder_whose_tables_are_not_as_they_were_is_refused(
    records: Records, tmp_path: Path, damage: Callable[[Path], object]
) -> None:
    (folder,) = make_runs(tmp_path, 1, "7", seed=9)
    damage(next((folder / run_folder.TABLE_FOLDER).iterdir()))
    added, failed = records.add([folder])
    assert not added and failed[0][1].code.startswith("result.table")
    assert not records.audit()


def test_a_run_of_no_named_instrument_is_refused(records: Records, tmp_path: Path) -> None:
    result = dataclasses.replace(make_results(1, seed=8)[0], instrument={})
    run_folder.save(result, tmp_path / "bare")
    _, failed = records.add([tmp_path / "bare"])
    assert failed[0][1].code == "records.unnamed"
    added, _ = records.add([tmp_path / "bare"], instrument="IMU 9", date="2025-02-03")
    assert (added[0].instrument, added[0].holds[:10], added[0].dated) == \
        ("IMU 9", "2025-02-03", "given")  # fmt: skip


def test_a_review_changes_what_counts_and_needs_a_reason(records: Records) -> None:
    run = records.runs()[1]
    records.review(str(run.number), "rejected", "the table was being moved")
    assert [r.counts for r in records.runs()] == [True, False, True]
    with refuses("records.entry", match="The reason of this review cannot be"):
        records.review(run.sha256[:10], "accepted", "  ")
    records.review(run.folder, "accepted", "it was not")
    assert all(r.counts for r in records.runs())


def test_the_index_made_again_is_the_same(records: Records) -> None:
    records.review("1", "rejected", "x")
    records.reference("table 3", "table", "No. 7", "2027-01-01")
    before = content(records)
    with records.database.writing() as connection:
        connection.execute(sa.update(db.run).values(verdict="pass", instrument="another"))
        connection.execute(sa.delete(db.coefficient))
    assert {f.where for f in records.audit()} == {"table run", "table coefficient"}
    assert records.rebuild() == 3
    assert content(records) == before and records.audit() == []


def test_an_export_fills_another_database_with_the_same(records: Records, tmp_path: Path) -> None:
    records.recalibrate_every("0042", 12)
    journal = tmp_path / "journal.jsonl"
    journal.write_text(records.export())
    other = Records(tmp_path / "other.sqlite", make=True)
    assert other.rebuild(journal) == 3
    assert other.head == records.head and content(other) == content(records)
    assert other.export() == records.export() and other.audit() == []
    with pytest.raises(FoucaultError, match="has entries already"):
        other.rebuild(journal)
    other.close()


def test_no_entry_can_be_changed_or_removed(records: Records) -> None:
    for change in (sa.update(db.entry).values(who="bob"), sa.delete(db.entry)):
        with pytest.raises(FoucaultError, match="entries are never changed or removed"), \
                records.database.writing() as connection:  # fmt: skip
            connection.execute(change)
    assert {e.who for e in records.entries()} == {"ann"}


def test_what_is_half_written_is_not_kept(records: Records) -> None:
    before = content(records), records.head
    with pytest.raises(ZeroDivisionError), records.database.writing() as connection:
        connection.execute(sa.delete(db.coefficient))
        1 / 0  # noqa: B018
    assert (content(records), records.head) == before


def test_references_have_names_and_are_looked_up(records: Records, tmp_path: Path) -> None:
    records.reference("table 3", "table", "No. 7", "2027-01-01")
    records.reference("table 3", "table", "No. 8", "2028-01-01")
    assert records.references()["table 3"].certificate == "No. 8"
    added, _ = records.add(make_runs(tmp_path, 1, "8", seed=5), references=["table 3"])
    assert records.used_by(added[0]) == ["table 3"]
    with pytest.raises(FoucaultError, match=r"No reference is called 'table 4'. Did you mean"):
        records.add(make_runs(tmp_path, 1, "9", seed=6), references=["table 4"])


def test_an_instrument_is_known_by_name_or_serial(records: Records) -> None:
    assert records.instrument("imu 0042") == records.instrument("0042") == "IMU 0042"
    with pytest.raises(FoucaultError, match=r"No instrument is called '0043'.*there are 1"):
        records.instrument("0043")
    with pytest.raises(FoucaultError, match="No run is called '99'"):
        records.run("99")


# -- what an audit finds -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ("UPDATE entry SET body = replace(body, '2024', '2023') WHERE number = 1", "entry 1"),
        ("UPDATE entry SET who = 'bob' WHERE number = 2", "entry 2"),
        ("UPDATE entry SET made = '2020-01-01' WHERE number = 3", "entry 3"),
    ],
)
def test_an_edited_byte_is_found(tmp_path: Path, change: str, where: str) -> None:
    make_records(tmp_path).close()
    tamper(tmp_path / "records.sqlite", change)
    records = Records(tmp_path / "records.sqlite")
    assert [f.where for f in records.audit()] == [where]
    with pytest.raises(FoucaultError, match=f"Entry {where[-1]} was changed"):
        records.rebuild()
    records.close()


def test_an_entry_that_was_taken_out_is_found_even_at_the_end(tmp_path: Path) -> None:
    records = make_records(tmp_path)
    head = records.head[1]
    records.close()
    gone = ("PRAGMA foreign_keys = OFF", "DELETE FROM entry WHERE number = 3")
    tamper(tmp_path / "records.sqlite", *gone)
    records = Records(tmp_path / "records.sqlite")
    assert records.audit() and not records.has(head)
    records.close()


def test_a_chain_that_was_forged_whole_does_not_have_the_hash_that_was_printed() -> None:
    """Whoever writes all entries again cannot keep the newest hash."""
    chain, forged = list[Entry](), list[Entry]()
    for months in (6, 12, 24):
        for one, more in ((chain, 0.0), (forged, 1.0)):
            body = Interval(instrument="IMU", months=months + more)
            one.append(Entry.after(one[-1] if one else None, body, "ann", "1"))
    assert broken(chain) is None and broken(forged) is None
    assert chain[-1].hash != forged[-1].hash
    assert broken([chain[0], chain[2]]) == 2
    assert broken([forged[0], chain[1]]) == 2


def test_a_clock_that_was_set_back_keeps_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    first = Entry.after(None, Interval(instrument="a", months=1), "ann", "1")
    late = dataclasses.replace(first, made="2999-01-01T00:00:00+00:00")
    second = Entry.after(late, Interval(instrument="a", months=2), "ann", "1")
    assert second.made == late.made


def test_runs_of_one_day_are_told_apart(records: Records, tmp_path: Path) -> None:
    for k, folder in enumerate(make_runs(tmp_path, 3, "7", seed=9)):
        records.add([folder], date="2026-03-01" if k else "2025-03-01")
    numbers = [run.number for run in records.runs("7")]
    assert [one.label for one in records.compared("7")] == [
        "2025-03-01", *(f"2026-03-01, no. {n}" for n in numbers[1:]),
    ]  # fmt: skip


@pytest.mark.parametrize("how", ["edited", "gone", "table"])
def test_a_folder_that_was_touched_is_found(tmp_path: Path, how: str) -> None:
    records = make_records(tmp_path)
    folder = records.folder_of(records.runs()[1])
    if how == "edited":
        edit(folder)
    elif how == "gone":
        shutil.rmtree(folder)
    else:
        file = next((folder / "tables").iterdir())
        file.write_bytes(file.read_bytes()[:-1] + b"x")
    found = records.audit()
    assert [f.where for f in found] == ["run 2, 0042-2025"]
    if how != "table":
        with pytest.raises(FoucaultError, match="is not as it was taken in"):
            records.compared("0042")
    records.close()


def test_a_folder_that_moved_is_found_again(tmp_path: Path) -> None:
    records = make_records(tmp_path)
    folder = records.folder_of(records.runs()[0])
    folder.rename(tmp_path / "elsewhere")
    assert records.audit()
    assert records.moved(tmp_path / "elsewhere").folder == "elsewhere"
    assert records.audit() == [] and records.rebuild() == 3 and records.audit() == []
    with pytest.raises(FoucaultError, match="is not in the records"):
        records.moved(make_runs(tmp_path, 1, "1", seed=99)[0])
    records.close()


# -- databases that are not what they should be --------------------------------------------


def test_there_have_to_be_records(tmp_path: Path) -> None:
    with pytest.raises(FoucaultError, match="There are no records in"):
        Records(tmp_path / "records.sqlite")


@pytest.mark.parametrize(
    "address", ["mysql://here/it", "://", "postgresql://a:b/x", "nosuch+thing://x"]
)
def test_an_address_of_nothing_is_refused(address: str) -> None:
    with pytest.raises(FoucaultError, match="is no address of a database"):
        Records(address)


def test_a_password_is_not_shown() -> None:
    with pytest.raises(FoucaultError) as problem:
        Records("postgresql://ann:secret@127.0.0.1:1/x")
    assert problem.value.code == "records.database" and "secret" not in str(problem.value)


def test_a_database_of_something_else_is_left_alone(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "x.sqlite") as connection:
        connection.execute("CREATE TABLE songs (name)")
    with pytest.raises(FoucaultError, match="it has the tables songs"):
        Records(tmp_path / "x.sqlite", make=True)


def test_a_file_that_is_no_database_is_said(tmp_path: Path) -> None:
    (tmp_path / "x.sqlite").write_text("hello " * 100)
    with pytest.raises(FoucaultError, match="file is not a database"):
        Records(tmp_path / "x.sqlite", make=True)


def test_a_newer_schema_is_refused(tmp_path: Path) -> None:
    make_records(tmp_path).close()
    tamper(tmp_path / "records.sqlite", "UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(FoucaultError, match="has schema 9999; this version knows 0001"):
        Records(tmp_path / "records.sqlite", make=True)


def test_the_tables_are_those_of_the_newest_schema(tmp_path: Path) -> None:
    """What migrations make is what the program takes the tables for."""
    make_records(tmp_path).close()
    from alembic.autogenerate import compare_metadata
    from alembic.runtime.migration import MigrationContext

    engine = sa.create_engine(f"sqlite:///{tmp_path / 'records.sqlite'}")
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), db.meta) == []
    engine.dispose()


def test_who_waits_too_long_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(db, "PATIENCE", 0.05)
    records = make_records(tmp_path)
    other = sqlite3.connect(tmp_path / "records.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(FoucaultError, match="is being written by another program"):
        records.recalibrate_every("0042", 12)
    other.execute("ROLLBACK")
    other.close()
    assert records.recalibrate_every("0042", 12).number == 4
    records.close()


def test_a_full_or_read_only_database_keeps_what_it_has(tmp_path: Path) -> None:
    records = make_records(tmp_path)
    with records.database.engine.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
    for line, words in ((f"max_page_count = {pages}", "no room left"),
                        ("query_only = ON", "can only be read")):  # fmt: skip
        with pytest.raises(FoucaultError, match=words), \
                records.database.engine.connect() as connection:  # fmt: skip
            connection.exec_driver_sql(f"PRAGMA {line}")
            with records.database._said():
                connection.exec_driver_sql(
                    "INSERT INTO log SELECT 1, hex(randomblob(9000)), 'x' FROM entry"
                )
    assert records.audit() == []
    records.close()


@pytest.mark.parametrize("line", ["{", "[]", '{"number": 1}'])
def test_a_file_that_is_no_export_is_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / "j.jsonl").write_text(line + "\n")
    records = Records(tmp_path / "new.sqlite", make=True)
    with pytest.raises(FoucaultError, match=r"Line 1 of .*j.jsonl is no entry"):
        records.rebuild(tmp_path / "j.jsonl")
    records.close()


def test_an_export_with_an_edited_line_is_refused(tmp_path: Path) -> None:
    records = make_records(tmp_path)
    (tmp_path / "j.jsonl").write_text(records.export().replace('"ann"', '"bob"', 1))
    other = Records(tmp_path / "new.sqlite", make=True)
    with pytest.raises(FoucaultError, match="Entry 1 was changed"):
        other.rebuild(tmp_path / "j.jsonl")
    assert other.head == (0, kept.FIRST)  # nothing of it was kept
    other.close()
    records.close()


# -- several at once, and killed -----------------------------------------------------------

ADD = """
import sys
from foucault.records import Records
records = Records(sys.argv[1], make=True, who=sys.argv[2])
for folder in sys.argv[3:]:
    records.add([folder])
    print(folder, flush=True)
"""


@pytest.mark.thorough
def test_four_at_once_make_one_chain(tmp_path: Path) -> None:
    folders = [make_runs(tmp_path, 6, f"{k}", seed=10 + k) for k in range(4)]
    Records(tmp_path / "records.sqlite", make=True).close()
    work = [
        subprocess.Popen([sys.executable, "-c", ADD, tmp_path / "records.sqlite", f"p{k}", *mine])
        for k, mine in enumerate(folders)
    ]
    assert [p.wait(120) for p in work] == [0] * 4
    records = Records(tmp_path / "records.sqlite")
    assert len(records.runs()) == 24 and records.audit() == []
    assert {e.who for e in records.entries()} == {"p0", "p1", "p2", "p3"}
    records.close()


@pytest.mark.thorough
def test_a_kill_loses_nothing_that_was_taken_in(tmp_path: Path) -> None:
    """Whatever was said to be in is in, the chain is whole, and the work goes on."""
    folders = make_runs(tmp_path, 12, "1")
    file = tmp_path / "records.sqlite"
    Records(file, make=True).close()
    said: set[str] = set()
    for stop in (1, 3, 2, 4):
        work = subprocess.Popen([sys.executable, "-c", ADD, file, "k", *folders],
                                stdout=subprocess.PIPE, text=True)  # fmt: skip
        assert work.stdout is not None
        for _ in range(stop):
            said.add(work.stdout.readline().strip())
        work.kill()
        work.wait()
        work.stdout.close()
        records = Records(file)
        there = {str(records.folder_of(r)) for r in records.runs()}
        assert said <= there and records.audit() == []
        records.close()
    records = Records(file)
    records.add(folders)
    assert len(records.runs()) == 12 and records.audit() == []
    records.close()


def test_an_entry_is_read_back_as_it_was_said(records: Records) -> None:
    entry = records.recalibrate_every("0042", 12.5)
    again = [e for e in records.entries() if e.number == entry.number]
    assert again == [entry] and json.loads(entry.body) == {"instrument": "IMU 0042", "months": 12.5}


def test_an_older_schema_is_brought_up_to_date_only_to_be_written(tmp_path: Path) -> None:
    sqlite3.connect(tmp_path / "records.sqlite").close()
    with refuses("records.older"):
        Records(tmp_path / "records.sqlite")
    Records(tmp_path / "records.sqlite", make=True).close()
    Records(tmp_path / "records.sqlite").close()
