"""The records themselves: what is taken in, looked up, judged, checked and made again."""

from __future__ import annotations

import datetime
import getpass
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import sqlalchemy as sa
from pydantic import ValidationError

from foucault import __version__
from foucault.campaign import tolerance as tolerances
from foucault.campaign.comparison import Named, moment, named_entry
from foucault.diagnose.comparable import Entry as Compared
from foucault.errors import FoucaultError, error, suggestion
from foucault.files import sha256
from foucault.records import database as db
from foucault.records.database import Database
from foucault.records.entries import (
    FIRST,
    Body,
    Certified,
    Entry,
    Event,
    Interval,
    Limits,
    Reference,
    Reviewed,
    RunAdded,
    RunMoved,
    broken,
    plain,
)
from foucault.result import Result
from foucault.run_folder import RESULT_FILE, load_result, result_file, result_of_hash

BATCH = 50
"""Runs that are taken in at once; what is taken in stays where the work is interrupted."""

Tell = Callable[[float, str], None]
Said = TypeVar("Said", bound=Body)


@dataclass(frozen=True)
class Run:
    """A run as the index has it."""

    number: int  # that of its entry [1]
    sha256: str
    folder: str
    instrument: str
    procedure: str
    verdict: str
    reasons: str
    operator: str
    version: str
    equation: str
    gauge: str
    computed: str
    holds: str
    dated: str
    again: str
    decision: str

    @property
    def counts(self) -> bool:
        """Whether it counts for its instrument: usable, and nobody has rejected it."""
        return self.verdict != "unusable" and self.decision != "rejected"


_RUN = [c for c in db.run.columns if c.name != "covariance"]


@dataclass(frozen=True)
class Fault:
    """What an audit has found wrong."""

    where: str
    what: str


class Records:
    """The records of a laboratory, in a database that is opened here."""

    def __init__(self, where: str | Path | None = None, *, make: bool = False,
                 who: str = "") -> None:  # fmt: skip
        """Open them; `where` and `make` as for `Database`, `who` adds entries: the user if left."""
        self.database = Database(where, make=make)
        self.who = who or user()

    def close(self) -> None:
        """Let go of the database."""
        self.database.close()

    # -- taking in -------------------------------------------------------------------------

    def add(
        self, folders: Sequence[str | Path], *, date: str = "", instrument: str = "",
        references: Sequence[str] = (), again: str = "", progress: Tell = lambda done, words: None,
    ) -> tuple[list[Run], list[tuple[Path, FoucaultError]]]:  # fmt: skip
        """Take run folders in; those that are in already are left as they are.

        `folders`: run folders or their result.json; `date`, `instrument`: what their results do not
        say; `references`: names of references used; `again`: SHA-256 of the run that it repeats.
        Returns what was taken in, and what could not be with why. Raises ``records.*``.
        """
        if date:
            moment(date)
        self._known_references(references)
        added: list[Run] = []
        failed: list[tuple[Path, FoucaultError]] = []
        for start in range(0, len(folders), BATCH):
            batch: list[tuple[RunAdded, Result]] = []
            for folder in folders[start : start + BATCH]:
                progress((start + len(batch)) / len(folders), f"reading {folder}")
                try:
                    named = Named(Path(folder), date, instrument)
                    batch.append(self._as_body(named, references, again))
                except FoucaultError as problem:
                    failed.append((Path(folder), problem))
            with self.database.writing() as connection:
                known = set(connection.scalars(sa.select(db.run.c.sha256)))
                last = _last(connection)
                for body, result in batch:
                    if body.sha256 in known:
                        continue
                    known.add(body.sha256)
                    last = self._append(connection, last, body)
                    added.append(_index_run(connection, last.number, body, result))
        return added, failed

    def _as_body(
        self, named: Named, references: Sequence[str], again: str
    ) -> tuple[RunAdded, Result]:
        entry = named_entry(named, "")
        load_result(named.path)  # a table that an audit would name for ever is refused at once
        result = entry.result
        if not entry.instrument:
            raise error("records.unnamed", folder=named.path)
        holds = "" if not math.isfinite(entry.time) else _iso(entry.time)
        body = _body(
            RunAdded, folder=self._seen(result_file(named.path).parent), sha256=entry.sha256,
            instrument=entry.instrument, holds=holds, dated=entry.dated,
            references=tuple(references), again=again,
        )  # fmt: skip
        return body, result

    def _seen(self, folder: Path) -> str:
        """Return how a folder is named: from that of the database, where it lies below."""
        whole, home = folder.absolute(), self.database.home
        if self.database.file is not None and whole.is_relative_to(home):
            return whole.relative_to(home).as_posix()
        return whole.as_posix()

    def folder_of(self, run: Run) -> Path:
        """Return where the folder of a run lies."""
        return self.database.home / run.folder

    def say(self, body: Body) -> Entry:
        """Add an entry that is about an instrument, a run or a reference."""
        with self.database.writing() as connection:
            entry = self._append(connection, _last(connection), body)
            _index(connection, entry.number, body)
            return entry

    def _append(self, connection: sa.Connection, last: Entry | None, body: Body) -> Entry:
        entry = Entry.after(last, body, self.who, __version__)
        connection.execute(sa.insert(db.entry), vars(entry))
        return entry

    def review(self, which: str, decision: str, reason: str) -> Entry:
        """Accept or reject a run, `which` by its number, folder or hash, with a reason."""
        digest = self.run(which).sha256
        return self.say(_body(Reviewed, sha256=digest, decision=decision, reason=reason))

    def tolerate(self, instrument: str, file: str | Path) -> Entry:
        """Set the limits of an instrument by a tolerance file, which is kept whole."""
        tolerances.load(file)
        text = Path(file).read_text(encoding="utf-8")
        return self.say(_body(Limits, instrument=self.instrument(instrument), text=text))

    def recalibrate_every(self, instrument: str, months: float) -> Entry:
        """Set how long a calibration of an instrument holds; `months`: so long [month]."""
        return self.say(_body(Interval, instrument=self.instrument(instrument), months=months))

    def event(self, instrument: str, what: str, on: str, words: str = "") -> Entry:
        """Say that something was done to an instrument, such as a repair, on a date."""
        moment(on)
        name = self.instrument(instrument)
        return self.say(_body(Event, instrument=name, what=what, on=on, words=words))

    def reference(
        self, name: str, what: str, certificate: str = "", due: str = "", words: str = ""
    ) -> Entry:
        """Name something that calibrations rest on, or renew its certificate."""
        if due:
            moment(due)
        said = {"name": name, "what": what, "certificate": certificate, "due": due, "words": words}
        return self.say(_body(Reference, **said))

    def moved(self, folder: str | Path) -> Run:
        """Say that the folder of a run lies elsewhere now."""
        digest = sha256(result_file(folder))
        run = self._by("sha256", digest)
        if run is None:
            raise error("records.not_in", folder=folder)
        self.say(RunMoved(sha256=digest, folder=self._seen(result_file(folder).parent)))
        return self.run(digest)

    def certify(self, body: Certified, write: Callable[[], object]) -> Entry:
        """Add that a certificate was issued, and `write` its files; both or neither.

        Raises ``certificate.*``: its number was given, or what it replaces is not what was issued.
        """
        with self.database.writing() as connection:
            rows = connection.execute(sa.select(db.entry).where(db.entry.c.kind == body.kind))
            for row in rows.mappings():
                one = Certified.model_validate_json(row["body"])
                if body.replaces and one.replaces == body.replaces:
                    raise error("certificate.replaced", before=body.replaces,
                                number=one.certificate)  # fmt: skip
                if one.certificate == body.certificate:
                    raise error("certificate.issued", number=one.certificate, day=one.issued)
            entry = self._append(connection, _last(connection), body)
            write()
            return entry

    def certificates(self, run: Run | None = None) -> list[Certified]:
        """Return the certificates that were issued, or those of a run, in order."""
        every = [body for _, body in self.said(Certified)]
        return [b for b in every if run is None or b.sha256 == run.sha256]

    # -- looking up ------------------------------------------------------------------------

    def runs(self, instrument: str = "") -> list[Run]:
        """Return all runs, or those of an instrument, in order of time."""
        chosen = sa.select(*_RUN).order_by(db.run.c.holds, db.run.c.number)
        if instrument:
            chosen = chosen.where(db.run.c.instrument == self.instrument(instrument))
        with self.database.reading() as connection:
            return [Run(*row) for row in connection.execute(chosen).all()]

    def run(self, which: str) -> Run:
        """Return a run by its number, its hash or the beginning of it, or its folder."""
        text = str(which)
        found = self._by("number", int(text)) if text.isdigit() and len(text) < 9 else None
        if found is None and (Path(text).exists()):
            with suppress(FoucaultError, OSError):
                found = self._by("sha256", sha256(result_file(text)))
        if found is None:
            near = [r for r in self.runs() if r.folder == text or
                    (len(text) >= 6 and r.sha256.startswith(text))]  # fmt: skip
            found = near[0] if len(near) == 1 else None
        if found is None:
            raise error("records.no_run", given=which)
        return found

    def of_hash(self, digest: str) -> Run | None:
        """Return the run whose result.json has this hash, None where it is not in."""
        return self._by("sha256", digest)

    def _by(self, column: str, value: Any) -> Run | None:
        chosen = sa.select(*_RUN).where(db.run.c[column] == value)
        with self.database.reading() as connection:
            row = connection.execute(chosen).mappings().first()
        return None if row is None else Run(**row)

    def instruments(self) -> list[str]:
        """Return the names of all instruments."""
        chosen = sa.select(db.run.c.instrument).distinct().order_by(db.run.c.instrument)
        with self.database.reading() as connection:
            return list(connection.scalars(chosen))

    def instrument(self, name: str) -> str:
        """Return the name of an instrument as it is kept; one that is not known is refused."""
        known = self.instruments()
        near = [k for k in known if k.lower() == name.strip().lower()]
        near = near or [k for k in known if name.strip() and name.strip() in k.split()]
        if len(near) != 1:
            raise error("records.no_instrument", given=name, hint=suggestion(name, known),
                        count=len(known))  # fmt: skip
        return near[0]

    def entries(self) -> Iterator[Entry]:
        """Yield the chain in order."""
        with self.database.reading() as connection:
            for row in connection.execute(sa.select(db.entry).order_by(db.entry.c.number)):
                yield Entry(*row)

    def newest(self, most: int) -> list[Entry]:
        """Return the newest entries, the last first; `most`: so many [1]."""
        chosen = sa.select(db.entry).order_by(db.entry.c.number.desc()).limit(most)
        with self.database.reading() as connection:
            return [Entry(*row) for row in connection.execute(chosen).all()]

    def said(self, kind: type[Body]) -> list[tuple[Entry, Any]]:
        """Return the entries of a kind in order, with what they say."""
        chosen = sa.select(db.entry).where(db.entry.c.kind == kind.kind)
        with self.database.reading() as connection:
            rows = connection.execute(chosen.order_by(db.entry.c.number)).mappings().all()
        return [(entry, entry.says()) for entry in (Entry(**row) for row in rows)]

    def limits(self, instrument: str) -> tolerances.Tolerance | None:
        """Return the limits that hold for an instrument, None where there are none."""
        text = self.limits_text(instrument)
        return tolerances.parse(text) if text else None

    def limits_text(self, instrument: str) -> str:
        """Return the tolerance file of an instrument; empty where there is none."""
        texts = [b.text for _, b in self.said(Limits) if b.instrument == instrument]
        return texts[-1] if texts else ""

    def references(self) -> dict[str, Reference]:
        """Return what is known of each reference: its newest entry."""
        return {body.name: body for _, body in self.said(Reference)}

    def _known_references(self, names: Sequence[str]) -> None:
        known = self.references() if names else {}
        for name in names:
            if name not in known:
                raise error("records.no_reference", given=name, hint=suggestion(name, known))

    def compared(self, instrument: str, runs: Iterable[Run] | None = None) -> list[Compared]:
        """Return the results of an instrument that count, as `campaign.comparison` takes them."""
        name = self.instrument(instrument)
        some = list(self.runs(name) if runs is None else runs)
        days = Counter(run.holds[:10] for run in some)
        out = []
        for run in some:
            result = self.checked(run)
            time = moment(run.holds) if run.holds else math.nan
            label = day = run.holds[:10]
            if days[day] > 1 or not day:
                label = f"{day}, no. {run.number}" if day else run.folder
            out.append(Compared(label, result, name, time, run.dated, run.sha256))
        return out

    def checked(self, run: Run) -> Result:
        """Return the result of a run; a folder that is gone or was edited is refused."""
        self.refuse_edited(run)
        return result_of_hash(self.folder_of(run), run.sha256)

    def refuse_edited(self, run: Run) -> None:
        """Refuse a run whose folder is gone or was edited; raises ``records.edited``."""
        fault = self._fault(run)
        if fault:
            raise error("records.edited", folder=self.folder_of(run), what=fault)

    def logs_of(self, run: Run) -> list[str]:
        """Return the hashes of the logs that a run was made from."""
        with self.database.reading() as connection:
            of = db.log.c.run == run.number
            return list(connection.scalars(sa.select(db.log.c.sha256).where(of)))

    def logs(self, instrument: str = "") -> dict[int, tuple[str, ...]]:
        """Return the hashes of the logs of each run, or of an instrument's, by its number."""
        chosen = sa.select(db.log.c.run, db.log.c.sha256).order_by(db.log.c.run, db.log.c.sha256)
        if instrument:
            chosen = chosen.join(db.run).where(db.run.c.instrument == instrument)
        out: dict[int, tuple[str, ...]] = {}
        with self.database.reading() as connection:
            for number, digest in connection.execute(chosen).all():
                out[number] = (*out.get(number, ()), digest)
        return out

    def used_by(self, run: Run) -> list[str]:
        """Return the names of the references that a run used."""
        chosen = sa.select(db.used.c.reference).where(db.used.c.run == run.number)
        with self.database.reading() as connection:
            return list(connection.scalars(chosen.order_by(db.used.c.reference)))

    def _fault(self, run: Run) -> str:
        """Return what is wrong with the folder of a run; nothing where it is as it was."""
        file = self.folder_of(run) / RESULT_FILE
        try:
            digest = sha256(file)
        except OSError:
            return "it is not there"
        return "" if digest == run.sha256 else "its result.json is not the one that was taken in"

    # -- the whole -------------------------------------------------------------------------

    def audit(self, progress: Tell = lambda done, words: None) -> list[Fault]:
        """Look at everything: the chain, the folders with their tables, and the index."""
        faults = []
        entries = list(self.entries())
        bad = broken(entries)
        if bad is not None:
            why = "it was changed, or does not follow the one before"
            faults.append(Fault(f"entry {bad}", why))
        for entry in entries:
            try:
                entry.says()
            except (ValueError, KeyError):
                faults.append(Fault(f"entry {entry.number}", "it says nothing that is known"))
        runs = self.runs()
        for i, run in enumerate(runs):
            progress(i / max(len(runs), 1), f"reading {run.folder}")
            fault = self._fault(run)
            if not fault:
                try:
                    load_result(self.folder_of(run))
                except FoucaultError as problem:
                    fault = problem.message
            if fault:
                faults.append(Fault(f"run {run.number}, {run.folder}", fault))
        if not faults:
            faults += self._index_faults(entries)
        return faults

    def _index_faults(self, entries: Sequence[Entry]) -> list[Fault]:
        """Return what of the index differs from one that is made anew."""
        beside = Database("sqlite://", make=True)
        with beside.engine.begin() as connection:
            if entries:
                connection.execute(sa.insert(db.entry), [vars(e) for e in entries])
            _replay(connection, entries, self._result_of)
            wanted = _content(connection)
        beside.close()
        with self.database.reading() as connection:
            there = _content(connection)
        return [
            Fault(f"table {name}", "it is not what entries and run folders say: rebuild it")
            for name in wanted
            if wanted[name] != there[name]
        ]

    def rebuild(self, journal: str | Path | None = None) -> int:
        """Make the index again of the entries and the run folders; returns the number of runs.

        `journal`: an export, whose entries are taken into a database without any.
        """
        with self.database.writing() as connection:
            if journal is not None:
                if _last(connection) is not None:
                    raise error("records.not_empty", path=self.database.shown)
                taken = _of_export(Path(journal))
                connection.execute(sa.insert(db.entry), [vars(e) for e in taken])
            rows = connection.execute(sa.select(db.entry).order_by(db.entry.c.number)).mappings()
            entries = [Entry(**row) for row in rows]
            bad = broken(entries)
            if bad is not None:
                raise error("records.broken", number=bad)
            for table in db.INDEX:
                connection.execute(sa.delete(table))
            return _replay(connection, entries, self._result_of)

    def _result_of(self, body: RunAdded, folder: str) -> Result:
        path = self.database.home / folder
        try:
            digest = sha256(path / RESULT_FILE)
        except OSError:
            raise error("records.edited", folder=path, what="it is not there") from None
        if digest != body.sha256:
            raise error("records.edited", folder=path,
                        what="its result.json is not the one that was taken in")  # fmt: skip
        return load_result(path, with_tables=False)

    def export(self) -> str:
        """Return the chain as lines of JSON, which `rebuild` takes."""
        lines = (json.dumps(plain(e), ensure_ascii=False, sort_keys=True) for e in self.entries())
        return "".join(f"{line}\n" for line in lines)

    @property
    def head(self) -> tuple[int, str]:
        """The number and the hash of the newest entry."""
        with self.database.reading() as connection:
            last = _last(connection)
        return (0, FIRST) if last is None else (last.number, last.hash)

    def has(self, digest: str) -> bool:
        """Whether an entry has this hash: nothing before it was cut off since."""
        with self.database.reading() as connection:
            chosen = sa.select(db.entry.c.number).where(db.entry.c.hash == digest)
            return connection.execute(chosen).first() is not None


def _body(kind: type[Said], **said: Any) -> Said:
    """Return what an entry is to say; raises ``records.entry``."""
    try:
        return kind.model_validate(said)
    except ValidationError as problem:
        first = problem.errors()[0]
        raise error("records.entry", kind=kind.kind, field=".".join(map(str, first["loc"])),
                    given=str(first["input"])[:80], reason=first["msg"]) from None  # fmt: skip


def user() -> str:
    """Return the name of the user of this computer."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container without names
        return f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"


def _iso(time: float) -> str:
    at = datetime.datetime.fromtimestamp(time, datetime.UTC)
    return at.isoformat(timespec="seconds")


def _last(connection: sa.Connection) -> Entry | None:
    chosen = sa.select(db.entry).order_by(db.entry.c.number.desc()).limit(1)
    row = connection.execute(chosen).mappings().first()
    return None if row is None else Entry(**row)


# -- the index -----------------------------------------------------------------------------


def _index_run(connection: sa.Connection, number: int, body: RunAdded, result: Result) -> Run:
    """Put a run that was taken in into the index."""
    vector, made = result.coefficients, result.provenance
    run = Run(
        number=number, sha256=body.sha256, folder=body.folder, instrument=body.instrument,
        procedure=result.procedure, verdict=str(result.verdict.level),
        reasons="\n".join(result.verdict.reasons),
        operator=str(result.instrument.get("operator") or ""),
        version=str((made.get("versions") or {}).get("foucault", "")), equation=result.equation,
        gauge=result.gauge, computed=str(made.get("created") or ""), holds=body.holds,
        dated=body.dated, again=body.again, decision="",
    )  # fmt: skip
    cov = None if vector.cov is None else np.asarray(vector.cov, "<f8").tobytes()
    connection.execute(sa.insert(db.run), {**vars(run), "covariance": cov})
    rows = [
        {"run": number, "position": i, "name": c.name, "unit": c.unit, "value": _finite(v),
         "sd": _finite(s), "free": bool(f)}
        for i, (c, v, s, f) in enumerate(zip(
            vector.layout.coefficients, vector.values, vector.sd, vector.free, strict=True))
    ]  # fmt: skip
    if rows:
        connection.execute(sa.insert(db.coefficient), rows)
    for digest, file in dict(_logs(made)).items():
        connection.execute(sa.insert(db.log), {"run": number, "sha256": digest, "file": file})
    for name in dict.fromkeys(body.references):
        connection.execute(sa.insert(db.used), {"run": number, "reference": name})
    return run


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _logs(made: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the hash and name of each log that a result was made from."""
    for one in [made.get("input") or {}, *(made.get("inputs") or [])]:
        digests, files = str(one.get("sha256") or ""), str(one.get("file") or "")
        for digest in filter(None, digests.split(" + ")):
            yield digest, files


def _index(connection: sa.Connection, number: int, body: Body) -> None:
    """Put what an entry says of a run into the index; other kinds are looked up as they are."""
    change: dict[str, str] = {}
    if isinstance(body, Reviewed):
        change = {"decision": body.decision}
    elif isinstance(body, RunMoved):
        change = {"folder": body.folder}
    if change:
        of = db.run.c.sha256 == body.sha256  # type: ignore[attr-defined]
        connection.execute(sa.update(db.run).where(of).values(**change))


def _replay(
    connection: sa.Connection, entries: Sequence[Entry],
    result_of: Callable[[RunAdded, str], Result],
) -> int:  # fmt: skip
    """Make the index of `entries`; returns the number of runs."""
    said = [(entry.number, entry.says()) for entry in entries]
    # A run is read where it lies now.
    where = {b.sha256: b.folder for _, b in said if isinstance(b, RunMoved)}
    count = 0
    for number, body in said:
        if isinstance(body, RunAdded):
            count += 1
            result = result_of(body, where.get(body.sha256, body.folder))
            _index_run(connection, number, body, result)
        else:
            _index(connection, number, body)
    return count


def _content(connection: sa.Connection) -> dict[str, list[tuple[Any, ...]]]:
    """Return the rows of the index, table by table, in order."""
    out = {}
    for table in db.INDEX:
        order = list(table.primary_key.columns)
        rows = connection.execute(sa.select(table).order_by(*order))
        out[table.name] = [
            tuple(bytes(v) if isinstance(v, memoryview) else v for v in row) for row in rows
        ]
    return out


def _of_export(file: Path) -> list[Entry]:
    """Return the entries of an export."""
    out = []
    try:
        for line in file.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            kind = db.entry.columns.keys()
            body = json.dumps(
                row["body"], sort_keys=True, ensure_ascii=False, separators=(",", ":")
            )
            out.append(Entry(**{**{k: row[k] for k in kind}, "body": body}))
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise error("records.export", path=file, line=len(out) + 1, reason=problem) from None
    return out
