"""Jobs, accounts and sessions: tables in one SQLite file that survive every kill.

A job is waiting, running, done, failed or stopped. Who runs it holds a lock on a file of its own
for as long as it lives; the system, and no clock, tells that it is gone. A job whose worker is
gone is waiting again; after `TRIES` it has failed, for it ends whoever takes it.
"""

from __future__ import annotations

import datetime
import fcntl
import json
import os
import secrets
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from foucault.errors import FoucaultError, error

FILE = "workbench.sqlite"

TRIES = 3
"""A job that has ended so many workers is not tried again [1]."""

PATIENCE = 15.0
"""So long somebody waits for another who writes [s]."""

VERSION = 2
"""Of the tables."""

TABLES = """
CREATE TABLE job (
    number INTEGER PRIMARY KEY AUTOINCREMENT, made TEXT NOT NULL, who TEXT NOT NULL,
    command TEXT NOT NULL, words TEXT NOT NULL, log TEXT NOT NULL, state TEXT NOT NULL,
    worker TEXT NOT NULL DEFAULT '', tries INTEGER NOT NULL DEFAULT 0,
    ended TEXT NOT NULL DEFAULT '', code INTEGER, part REAL NOT NULL DEFAULT 0,
    doing TEXT NOT NULL DEFAULT '');
CREATE INDEX job_state ON job (state, number);
CREATE TABLE account (
    name TEXT PRIMARY KEY, role TEXT NOT NULL, secret TEXT NOT NULL, made TEXT NOT NULL,
    closed INTEGER NOT NULL DEFAULT 0);
CREATE TABLE session (
    digest TEXT PRIMARY KEY, name TEXT NOT NULL, kind TEXT NOT NULL, until REAL NOT NULL,
    label TEXT NOT NULL DEFAULT '');
CREATE TABLE attempt (of TEXT NOT NULL, at REAL NOT NULL);
CREATE TABLE setting (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""

REFUSED = """
CREATE TABLE refused (
    day TEXT NOT NULL, name TEXT NOT NULL, address TEXT NOT NULL, count INTEGER NOT NULL,
    first TEXT NOT NULL, last TEXT NOT NULL, locked INTEGER NOT NULL,
    PRIMARY KEY (day, name, address));
"""
"""Since version 2: wrong passwords of a day, by account and address."""

Number = int
"""Of a job: they count from 1 [1]."""

ENDED = ("done", "failed", "stopped")


@dataclass(frozen=True)
class Job:
    """A command line that is to be run, is running, or was."""

    number: int  # from 1 [1]
    made: str  # date and time, ISO 8601
    who: str
    command: str
    words: tuple[str, ...]  # after `foucault`
    log: str  # folder of the log in `logs`; empty: none
    state: str
    worker: str
    tries: int  # so far [1]
    ended: str
    code: int | None  # how the program ended [1]
    part: float  # that is done [1]
    doing: str

    @property
    def over(self) -> bool:
        """Whether nothing more will happen to it."""
        return self.state in ENDED

    @property
    def verdict(self) -> str:
        """Return pass, doubtful or unusable; empty before it is done."""
        words = {0: "pass", 3: "doubtful", 4: "unusable"}
        return words.get(-1 if self.code is None else self.code, "") if self.state == "done" else ""


def now() -> str:
    """Return the time, ISO 8601."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


class Store:
    """The file of a workbench; each use has a connection of its own, so that forks share none."""

    def __init__(self, folder: Path) -> None:
        """Open it in a folder, or make it there; raises ``workbench.*``."""
        self.folder = folder
        self.file = folder / FILE
        if not self.file.exists():
            self.file.touch(0o600)
        with self.writing() as db:
            there = db.execute("PRAGMA user_version").fetchone()[0]
            if there > VERSION:
                raise error("workbench.newer", path=self.file, there=there, known=VERSION)
            if there < VERSION:
                for line in ((TABLES if there == 0 else "") + REFUSED).strip().split(";\n"):
                    db.execute(line)
                db.execute(f"PRAGMA user_version = {VERSION}")
            if there == 0:
                db.execute("INSERT INTO setting VALUES ('secret', ?)", (secrets.token_hex(32),))
        with suppress(OSError):
            self.file.chmod(0o600)

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection."""
        db = None
        try:
            # One that was taken away while it is served is not made anew, without its accounts.
            address = f"{self.file.absolute().as_uri()}?mode=rw"
            db = sqlite3.connect(address, timeout=PATIENCE, isolation_level=None, uri=True)
            db.row_factory = sqlite3.Row
            db.execute("PRAGMA journal_mode = WAL")
            yield db
        except sqlite3.Error as problem:
            raise _in_words(self.file, problem) from problem
        finally:
            if db is not None:
                db.close()

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection that nobody writes beside; all of the block is kept, or none."""
        with self.reading() as db:
            db.execute("BEGIN IMMEDIATE")
            try:
                yield db
            except BaseException:
                db.execute("ROLLBACK")
                raise
            db.execute("COMMIT")

    def setting(self, key: str) -> str:
        """Return what was set, empty for nothing."""
        with self.reading() as db:
            row = db.execute("SELECT value FROM setting WHERE key = ?", (key,)).fetchone()
        return "" if row is None else str(row[0])

    def set(self, key: str, value: str) -> None:
        """Keep a setting."""
        if self.setting(key) != value:
            with self.writing() as db:
                db.execute("INSERT OR REPLACE INTO setting VALUES (?, ?)", (key, value))

    @property
    def secret(self) -> bytes:
        """What signs cookies and forms."""
        return bytes.fromhex(self.setting("secret"))

    # -- jobs ------------------------------------------------------------------------------

    def ask(self, who: str, command: str, words: Sequence[str], log: str = "") -> Job:
        """Add a job; "{job}" in its words becomes its number."""
        with self.writing() as db:
            row = db.execute(
                "INSERT INTO job (made, who, command, words, log, state) "
                "VALUES (?, ?, ?, '', ?, 'waiting') RETURNING number", (now(), who, command, log),
            ).fetchone()  # fmt: skip
            said = json.dumps([w.replace("{job}", str(row[0])) for w in words])
            db.execute("UPDATE job SET words = ? WHERE number = ?", (said, row[0]))
        return self.job(row[0])

    def job(self, number: Number) -> Job:
        """Return a job; raises ``workbench.no_job``."""
        with self.reading() as db:
            row = db.execute("SELECT * FROM job WHERE number = ?", (number,)).fetchone()
        if row is None:
            raise error("workbench.no_job", number=number)
        return _job(row)

    def jobs(self, most: int = 50, log: str = "", before: int = 1 << 62) -> list[Job]:
        """Return the newest jobs, of one log if it is named.

        `most`: so many [1]; `before`: number of a later one [1].
        """
        with self.reading() as db:
            rows = db.execute(
                "SELECT * FROM job WHERE (? = '' OR log = ?) AND number < ? "
                "ORDER BY number DESC LIMIT ?", (log, log, before, most),
            ).fetchall()  # fmt: skip
        return [_job(row) for row in rows]

    def claim(self, worker: str) -> Job | None:
        """Give a worker the job that has waited longest."""
        with self.reading() as db:
            if db.execute("SELECT 1 FROM job WHERE state = 'waiting' LIMIT 1").fetchone() is None:
                return None
        with self.writing() as db:
            row = db.execute(
                "UPDATE job SET state = 'running', worker = ?, tries = tries + 1, part = 0, "
                "doing = '' WHERE number = (SELECT min(number) FROM job WHERE state = 'waiting') "
                "RETURNING *", (worker,),
            ).fetchone()  # fmt: skip
        return None if row is None else _job(row)

    def tell(self, job: Job, part: float, doing: str) -> None:
        """Keep how far a job is; `part`: that is done [1]."""
        with suppress(FoucaultError), self.writing() as db:
            db.execute("UPDATE job SET part = ?, doing = ? WHERE number = ? AND state = 'running' "
                       "AND worker = ?", (part, doing, job.number, job.worker))  # fmt: skip

    def end(self, job: Job, state: str, code: int | None) -> bool:
        """Say how a job ended, `code`: exit code [1]; False where it is no longer this worker's."""
        with self.writing() as db:
            return db.execute(
                "UPDATE job SET state = ?, code = ?, ended = ?, part = 1 "
                "WHERE number = ? AND state = 'running' AND worker = ?",
                (state, code, now(), job.number, job.worker),
            ).rowcount == 1  # fmt: skip

    def give_back(self, job: Job) -> None:
        """Let a job wait again, or fail where it has ended too many workers."""
        state = "waiting" if job.tries < TRIES else "failed"
        with self.writing() as db:
            db.execute(
                "UPDATE job SET state = ?, worker = '', ended = ? "
                "WHERE number = ? AND state = 'running' AND worker = ?",
                (state, now() if state == "failed" else "", job.number, job.worker),
            )  # fmt: skip

    def stop(self, number: Number) -> None:
        """Stop a job that is not over; a worker that runs it sees that and ends it."""
        with self.writing() as db:
            db.execute("UPDATE job SET state = 'stopped', ended = ? WHERE number = ? AND state "
                       "IN ('waiting', 'running')", (now(), number))  # fmt: skip

    def recover(self) -> int:
        """Give back the jobs of workers that are gone; returns how many there were."""
        with self.reading() as db:
            rows = db.execute("SELECT * FROM job WHERE state = 'running'").fetchall()
        gone = [job for job in map(_job, rows) if not alive(self.folder, job.worker)]
        for job in gone:
            self.give_back(job)
        return len(gone)


def _job(row: sqlite3.Row) -> Job:
    return Job(**{**dict(row), "words": tuple(json.loads(row["words"] or "[]"))})


def _in_words(where: Path, problem: sqlite3.Error) -> FoucaultError:
    said = str(problem)
    if not where.exists():
        return error("workbench.gone", path=where)
    for sign, code in (("locked", "locked"), ("readonly", "read_only"), ("full", "full")):
        if sign in said:
            return error(f"workbench.{code}", path=where)
    return error("workbench.database", path=where, reason=said)


# -- who is alive --------------------------------------------------------------------------


def hold(folder: Path, worker: str) -> int:
    """Hold the lock of a worker for as long as this process and its children live."""
    (folder / "workers").mkdir(exist_ok=True)
    held = os.open(folder / "workers" / worker, os.O_RDWR | os.O_CREAT, 0o600)
    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return held


def alive(folder: Path, worker: str) -> bool:
    """Tell whether somebody holds the lock of a worker; that of one who is gone is removed."""
    file = folder / "workers" / worker
    try:
        held = os.open(file, os.O_RDWR)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.unlink(missing_ok=True)
    except BlockingIOError:
        return True
    finally:
        os.close(held)
    return False
