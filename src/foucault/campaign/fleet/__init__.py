"""The same campaign over many instruments: read, calibrate, decide, and one folder for all.

`log.file` is a pattern ("logs/*.csv"; the name of a file is the serial number), or one file with a
column `log.serial`. An instrument that cannot be read or calibrated is listed with its reason and
does not stop the others.
"""

from __future__ import annotations

import glob
import hashlib
import re
import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from foucault import logs, monte_carlo, procedures, run_folder
from foucault.campaign import earlier
from foucault.campaign.fleet.folder import INSTRUMENTS, save
from foucault.campaign.fleet.table import FleetTable, Row
from foucault.campaign.reading import Campaign
from foucault.campaign.study import names_of
from foucault.campaign.tolerance import Tolerance
from foucault.diagnose.table import report as table_report
from foucault.diagnose.time_base import times_the_table, with_clock
from foucault.errors import Finding, FoucaultError, error
from foucault.files import unwritable
from foucault.logs.serials import by_serial
from foucault.models.readings import Readings
from foucault.procedures import Progress, on_table, silent
from foucault.procedures.norm_observation import task_of
from foucault.procedures.on_table import batch as on_table_batch
from foucault.result import Result, provenance
from foucault.tables import Clock, Log

Report = Callable[[Path], Path]
Entry = tuple[str, "Log | FoucaultError"]

LONGEST = 80
"""Longest name of a folder that is made of a serial number [1]."""


@dataclass
class _Reduced:
    """An instrument that waits for the batch: its means, and what its log leaves behind.

    `timed`: the clock of its log, whether that timed the table, and whether it is increments.
    """

    serial: str
    readings: Readings
    findings: tuple[Finding, ...]
    validity: dict[str, Any]
    provenance: dict[str, Any]
    timed: tuple[Clock, bool, bool]


@dataclass
class _Work:
    """What all steps need."""

    campaign: Campaign
    folder: Path
    report: Report | None
    batch: bool
    folders: dict[str, str] = field(default_factory=dict)

    def named(self, entries: Iterable[Entry]) -> Iterator[Entry]:
        """Give every instrument a folder of its own, in the order of the logs."""
        taken: set[str] = set()
        for serial, log in entries:
            name = folder_name(serial)
            if name.casefold() in taken:  # not all systems tell a from A
                name += "-" + _digest(serial)
            taken.add(name.casefold())
            self.folders[serial] = f"{INSTRUMENTS}/{name}"
            yield serial, log


def _digest(serial: str) -> str:
    return hashlib.sha256(serial.encode()).hexdigest()[:8]


def folder_name(serial: str) -> str:
    """Return a name for the folder of an instrument that no path can hide in.

    `serial`: serial number, characters other than letters, digits, "." (not first), "_" and "-"
    are replaced, and a digest is then added so that different numbers stay different.
    """
    name = re.sub(r"[^A-Za-z0-9._-]", "_", serial)
    name = re.sub(r"^\.+|\.+$", "_", name)[:LONGEST]
    return name if name == serial and name else f"{name}-{_digest(serial)}".lstrip("-")


def run(
    campaign: Campaign,
    folder: str | Path,
    *,
    tolerance: Tolerance | None = None,
    report: Report | None = None,
    workers: int = 2,
    progress: Progress = silent,
) -> FleetTable:
    """Calibrate all instruments of a campaign and write one folder.

    `tolerance`: what coefficients may be, None decides nothing; `report`: writes the report of a
    run folder and returns its path, None writes none; `workers`: threads [1]; `progress`: called
    with the fraction done and what is being done. Returns a row per instrument, those without a
    result last. Raises mistakes in the campaign, and ``fleet.nothing`` where no instrument has a
    result.
    """
    earlier.refuse(campaign, "a fleet")
    started, folder = clock.monotonic(), Path(folder)
    names = names_of(campaign)
    if tolerance is not None:
        tolerance.refuse_unknown(names, campaign.procedure)
    batch = on_table_batch.suits(campaign.settings, campaign.site, campaign.prior)
    work = _Work(campaign, folder, report, batch)
    entries = work.named(_entries(campaign, progress))
    try:
        (folder / INSTRUMENTS).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    rows = list(_rows(work, entries, monte_carlo.threads(workers), progress))
    table = FleetTable.of(names, rows)
    _refuse_nothing(table)
    table = table.decided(tolerance)
    _remove_stale(work, table)
    save(table, campaign, folder, batch=batch, seconds=clock.monotonic() - started)
    return table


def _rows(
    work: _Work, entries: Iterable[Entry], over: monte_carlo.Map, progress: Progress
) -> Iterator[Row]:
    if not work.batch:
        yield from over(lambda e: _calibrated(work, *e), entries)
        return
    reduced: list[_Reduced] = []
    for item in over(lambda e: _reduced(work, *e), entries):
        if isinstance(item, _Reduced):
            reduced.append(item)
        else:
            yield item
    if not reduced:
        return
    progress(0.5, f"solving {len(reduced)} instruments")
    solved = on_table_batch.solve(
        [r.readings for r in reduced], work.campaign.settings, work.campaign.site
    )
    numbered = list(enumerate(reduced))
    rows = over(lambda n: _from_batch(work, solved, *n), numbered)
    for done, row in enumerate(rows, 1):
        progress(0.5 + 0.45 * done / len(reduced), f"writing {done} of {len(reduced)}")
        yield row


def _refuse_nothing(table: FleetTable) -> None:
    if table.problems and not table.good.any():
        serial, problem = next(iter(table.problems.items()))
        raise error(
            "fleet.nothing", count=len(table.problems), serial=serial, message=problem.message,
            cure=problem.cure,
        )  # fmt: skip


# -- the instruments -----------------------------------------------------------------------


def _entries(campaign: Campaign, progress: Progress) -> Iterator[Entry]:
    """Return serial numbers and logs, one after the other; mistakes of the campaign raise now."""
    files = campaign.imu_log.files()
    if len(files) != 1:
        raise error("fleet.files", count=len(files), files=", ".join(files))
    name = next(iter(files))
    if glob.has_magic(name) and not (campaign.folder / name).exists():
        return _of_files(campaign, name, progress)
    told = lambda done: progress(0.5 * done, "reading the log")  # noqa: E731
    return by_serial(campaign.log, campaign.folder, told)


def _of_files(campaign: Campaign, pattern: str, progress: Progress) -> Iterator[Entry]:
    paths = sorted(p for p in campaign.folder.glob(pattern) if p.is_file())
    if not paths:
        raise error("fleet.no_files", pattern=pattern, folder=campaign.folder)
    serials: dict[str, Path] = {}
    for path in paths:
        serial = path.name.split(".")[0] if path.name.endswith(".csv.gz") else path.stem
        if serial in serials:
            files = f"{serials[serial].name} and {path.name}"
            raise error("fleet.serial_twice", serial=serial, files=files)
        serials[serial] = path
    return _read_each(campaign, serials, progress)


def _read_each(campaign: Campaign, serials: dict[str, Path], progress: Progress) -> Iterator[Entry]:
    read: dict[str, str] = {}
    for number, (serial, path) in enumerate(serials.items()):
        progress(0.5 * number / len(serials), f"instrument {number + 1} of {len(serials)}")
        own = campaign.log.model_copy(update={"file": str(path.relative_to(campaign.folder))})
        try:
            log = logs.read(own, campaign.folder)
            first = read.setdefault(log.source["sha256"], serial)
            if first != serial:
                raise error("fleet.same_log", other=first)
        except FoucaultError as problem:
            yield serial, problem
        else:
            yield serial, log


def _reduced(work: _Work, serial: str, log: Log | FoucaultError) -> _Reduced | Row:
    if isinstance(log, FoucaultError):
        return Row.broken(serial, log)
    c = work.campaign
    try:
        readings = on_table.read_positions(log, task_of(c.settings), c.noise)
        readings = on_table_batch.arranged(readings, on_table_batch.plan_of(c.settings))
    except FoucaultError as problem:
        return Row.broken(serial, problem)
    validity = table_report.validity(readings, log, c.site)
    found = c.findings + log.findings
    timed = log.clock, times_the_table(log), log.sampled == "increment"
    return _Reduced(serial, readings, found, validity, provenance(log.source, 0.0), timed)


def _from_batch(work: _Work, batch: on_table_batch.Batch, i: int, own: _Reduced) -> Row:
    problem = batch.problem(i)
    if problem is not None:
        return Row.broken(own.serial, problem)
    result = batch.result(i)
    result = replace(
        result, findings=own.findings + result.findings, validity=own.validity,
        provenance=own.provenance,
    )  # fmt: skip
    clock, turned, summed = own.timed
    result = with_clock(result, clock, turned=turned, summed=summed)
    return _saved(work, own.serial, result)


def _calibrated(work: _Work, serial: str, log: Log | FoucaultError) -> Row:
    if isinstance(log, FoucaultError):
        return Row.broken(serial, log)
    c = work.campaign
    log = replace(log, findings=c.findings + log.findings)
    try:
        result = procedures.load(c.procedure).calibrate(
            log, site=c.site, settings=c.settings, noise=c.noise, prior=c.prior
        )
    except FoucaultError as problem:
        return Row.broken(serial, problem)
    return _saved(work, serial, result)


def _saved(work: _Work, serial: str, result: Result) -> Row:
    instrument = work.campaign.instrument | {"serial": serial}
    result = replace(result, instrument=instrument)
    where = work.folders[serial]
    run_folder.save(result, work.folder / where)
    page = "" if work.report is None else f"{where}/{work.report(work.folder / where).name}"
    return Row.of(serial, result, where, page)


def _remove_stale(work: _Work, table: FleetTable) -> None:
    """Remove the result of an earlier run where this one has none; nothing else is touched."""
    for serial in table.problems:
        run_folder.clear(work.folder / work.folders[serial])
