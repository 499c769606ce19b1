"""The same campaign over many instruments: read, calibrate, decide, and one folder for all.

`log.file` is a pattern ("logs/*.csv"; the name of a file is the serial number), or one file with a
column `log.serial`. An instrument that cannot be read or calibrated is listed with its reason and
does not stop the others. The folder holds::

    fleet.json                          what was asked, versions, counts, broken instruments
    fleet.parquet                       a row per instrument
    report.html                         the summary page, written by `report.fleet`
    campaign.toml                       the campaign with every default filled in
    instruments/SERIAL/result.json ...  a run folder per instrument, but for a table only

A fleet can be simulated: the means of many instruments in one file, and the truth beside it.
"""

from __future__ import annotations

import glob
import hashlib
import re
import time as clock
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from foucault import logs, monte_carlo, procedures, run_folder
from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.campaign import bench, earlier
from foucault.campaign.reading import Campaign
from foucault.campaign.running import (
    SESSION_CAMPAIGN,
    given_errors,
    keep_recorded,
    with_nothing_else,
    with_own_log,
    with_seed,
)
from foucault.campaign.study import names_of, write_table
from foucault.campaign.tolerance import DECISIONS, FAIL, PASS, UNDECIDED, Tolerance
from foucault.campaign.writing import log_table, resolved
from foucault.diagnose import compare as diagnose
from foucault.diagnose import table as table_report
from foucault.diagnose.compare import Distribution, Outlying
from foucault.diagnose.references import times_the_table, with_clock
from foucault.errors import Finding, FoucaultError, Status, error, finding
from foucault.files import make_folder, write_text
from foucault.logs.reading import by_serial, of_many
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.models.noise import Readings, grade
from foucault.procedures import Progress, on_table, silent
from foucault.procedures import fleet as of_fleet
from foucault.procedures.norm_observation import task_of
from foucault.procedures.on_table.session import TableSession, TableSettings, draw_rig, plan_of
from foucault.result import Level, Result, Verdict, provenance
from foucault.simulate.table import (
    Fleet,
    SimulatedReadings,
    simulate_readings,
    table_of_means,
    truth_of,
)
from foucault.tables import AXES, Clock, Log, whole_samples

BROKEN = "broken"  # Status of an instrument without a result.

TRIADS = ("accel", "gyro")


@dataclass(frozen=True)
class Row:
    """One instrument."""

    serial: str
    # status, verdict: how the computation ended, and the level of the verdict
    status: str
    verdict: str
    # values, sd: coefficients [SI]
    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    # chi_square, redundancy: (2,) of the residuals of accelerometers and gyros; NaN where not
    # tested [1]
    chi_square: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    redundancy: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    # (3,) the accelerometers from the centre of the table; NaN where unknown [m]
    lever_arm: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    # folder, report: run folder and report, relative to the folder of the fleet; empty where there
    # is none
    folder: str = ""
    report: str = ""
    reasons: tuple[str, ...] = ()  # why the verdict is not a pass
    problem: FoucaultError | None = None  # why there is no result

    @classmethod
    def broken(cls, serial: str, problem: FoucaultError) -> Row:
        """Return the row of an instrument without a result."""
        return cls(serial, BROKEN, BROKEN, problem=problem)

    @classmethod
    def of(cls, serial: str, result: Result, folder: str, report: str) -> Row:
        """Return the row of a result."""
        c = result.coefficients
        squares = np.array([_squares(result, triad) for triad in TRIADS])
        rig = result.tables.get("rig", {})
        found = dict(zip(rig.get("name", ()), rig.get("value", ()), strict=True))
        arm = np.array([float(found.get(f"lever_arm.{a}", np.nan)) for a in AXES])
        return cls(
            serial, str(result.status), str(result.verdict.level),
            dict(zip(c.names, c.values.tolist(), strict=True)),
            dict(zip(c.names, c.sd.tolist(), strict=True)),
            squares[:, 0], squares[:, 1], arm, folder, report, result.verdict.reasons,
        )  # fmt: skip


def _squares(result: Result, triad: str) -> tuple[float, float]:
    """Return chi-square and redundancy of a triad, as the procedure gives them."""
    given: Mapping[str, Any] = result.diagnostics.get("chi_square") or {}
    mine = [v for k, v in given.items() if k.startswith(triad) and len(v) == 4]
    if not mine:
        return float("nan"), float("nan")
    return float(sum(v[0] for v in mine)), float(sum(v[3] for v in mine))


@dataclass(frozen=True)
class FleetTable:
    """All instruments, those with a result first."""

    names: tuple[str, ...]
    rows: tuple[Row, ...]
    # values, sd: (N, p) coefficients and standard deviations, NaN where an instrument has none [SI]
    values: FloatArray
    sd: FloatArray
    # (N, p) numbers of `tolerance.DECISIONS`; None without a tolerance
    decisions: IntArray | None = None
    tolerance: Tolerance | None = None

    @classmethod
    def of(cls, names: Sequence[str], rows: Sequence[Row]) -> FleetTable:
        """Stack the rows; coefficients that no instrument has are left out."""
        ordered = sorted(rows, key=lambda r: r.problem is not None)
        some = tuple(n for n in names if any(n in r.values for r in rows))
        nan = float("nan")
        values = np.array([[r.values.get(n, nan) for n in some] for r in ordered], float)
        sd = np.array([[r.sd.get(n, nan) for n in some] for r in ordered], float)
        shape = (len(rows), len(some))
        return cls(some, tuple(ordered), values.reshape(shape), sd.reshape(shape))

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def good(self) -> BoolArray:
        """Which instruments have a result, shape (N,)."""
        return np.array([r.problem is None for r in self.rows], bool)

    @property
    def problems(self) -> dict[str, FoucaultError]:
        """Serial number -> why there is no result."""
        return {r.serial: r.problem for r in self.rows if r.problem is not None}

    def decided(self, tolerance: Tolerance | None) -> FleetTable:
        """Return the table with the decisions that a tolerance makes."""
        if tolerance is None:
            return self
        decisions = tolerance.decide(self.names, self.values, self.sd)
        return replace(self, decisions=decisions, tolerance=tolerance)

    @cached_property
    def outcomes(self) -> list[str]:
        """Pass, undecided, fail or broken of each instrument; without a tolerance the verdict.

        A result that is unusable decides nothing.
        """
        out = []
        for i, row in enumerate(self.rows):
            if row.problem is not None:
                out.append(BROKEN)
            elif self.decisions is None:
                out.append(row.verdict)
            else:
                worst = int(np.max(self.decisions[i], initial=PASS))
                if row.verdict == Level.UNUSABLE:
                    worst = UNDECIDED
                out.append(DECISIONS[worst])
        return out

    def counts(self) -> dict[str, int]:
        """Return how many instruments have each outcome."""
        words = DECISIONS if self.decisions is not None else tuple(map(str, Level))
        order = ("pass", "fail", "undecided") if self.decisions is not None else words
        outcomes = self.outcomes
        return {word: outcomes.count(word) for word in (*order, BROKEN)}

    def misses(self, i: int) -> list[tuple[str, str]]:
        """Return the coefficients of instrument `i`, shape () [1], that do not pass, and how."""
        if self.decisions is None or self.rows[i].problem is not None:
            return []
        found = [(self.names[k], DECISIONS[d]) for k, d in enumerate(self.decisions[i]) if d]
        return sorted(found, key=lambda pair: pair[1] != DECISIONS[FAIL])

    def distributions(self) -> list[Distribution]:
        """Return how each coefficient is distributed over the instruments that can be used."""
        usable = np.array([row.verdict != Level.UNUSABLE for row in self.rows], bool)
        return diagnose.distributions(self.names, self.values[usable], self.sd[usable])

    def outlying(self) -> list[Outlying]:
        """Return what stands out of the fleet, the farthest first."""
        return [*self._outlying]

    @cached_property
    def _outlying(self) -> tuple[Outlying, ...]:
        return (
            *diagnose.outlying(self.names, self.values, self.sd),
            *diagnose.noisy(self.chi_square, self.redundancy),
        )

    @cached_property
    def chi_square(self) -> FloatArray:
        """Chi-square of both triads, shape (N, 2) [1]."""
        return np.array([r.chi_square for r in self.rows]).reshape(-1, 2)

    @cached_property
    def redundancy(self) -> FloatArray:
        """Redundancy of both triads, shape (N, 2) [1]."""
        return np.array([r.redundancy for r in self.rows]).reshape(-1, 2)

    @cached_property
    def ratio(self) -> FloatArray:
        """Size of the residuals over what the noise says, shape (N, 2) [1]."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.sqrt(self.chi_square / self.redundancy)
        return np.where(self.redundancy >= 0.5, ratio, np.nan)

    def columns(self) -> dict[str, tuple[Any, str]]:
        """Return the columns of fleet.parquet with their SI units."""
        text = {
            "serial": [r.serial for r in self.rows],
            "outcome": self.outcomes,
            "status": [r.status for r in self.rows],
            "verdict": [r.verdict for r in self.rows],
            "reason": [_reason(r) for r in self.rows],
            "code": ["" if r.problem is None else r.problem.code for r in self.rows],
            "folder": [r.folder for r in self.rows],
        }
        out: dict[str, tuple[Any, str]] = {k: (v, "") for k, v in text.items()}
        passed = [None if self.decisions is None else o == "pass" for o in self.outcomes]
        out["pass"] = (np.array(passed, object), "")
        units = [LAYOUT.coefficients[LAYOUT.index(n)].unit for n in self.names]
        for what, block in (("", self.values), ("sd.", self.sd)):
            for k, name in enumerate(self.names):
                out[what + name] = (block[:, k], units[k])
        for t, triad in enumerate(TRIADS):
            out[f"chi_square.{triad}"] = (self.chi_square[:, t], "1")
            out[f"redundancy.{triad}"] = (self.redundancy[:, t], "1")
            out[f"residual_ratio.{triad}"] = (self.ratio[:, t], "1")
        arms = np.array([r.lever_arm for r in self.rows]).reshape(-1, 3)
        return out | {f"lever_arm.{a}": (arms[:, k], "m") for k, a in enumerate(AXES)}

    def document(self) -> dict[str, Any]:
        """Return what fleet.json says of the instruments."""
        return {
            "instruments": len(self),
            "counts": self.counts(),
            "broken": [
                {"serial": s, "code": p.code, "message": p.message, "cure": p.cure}
                for s, p in self.problems.items()
            ],
            "outlying": [
                {"serial": self.rows[o.index].serial, "name": o.name, "value": o.value, "z": o.z}
                for o in self.outlying()
            ],
            "distributions": [
                {
                    "name": d.name, "unit": LAYOUT.coefficients[LAYOUT.index(d.name)].unit,
                    "count": d.count, "median": d.median, "spread": d.spread,
                    "lowest": d.lowest, "highest": d.highest,
                    "sd": d.sd if np.isfinite(d.sd) else None,
                }
                for d in self.distributions()
            ],
        }  # fmt: skip


def _reason(row: Row) -> str:
    if row.problem is not None:
        return f"{row.problem.message} {row.problem.cure}"
    return " ".join(row.reasons)


TABLE_FILE, INSTRUMENTS = "fleet.parquet", "instruments"


def _save(
    table: FleetTable, campaign: Campaign, folder: Path, *, batch: bool, seconds: float
) -> None:
    """Write what is said of all instruments together.

    `table`: the instruments, whose run folders are written already [SI]; `seconds`: how long it
    took [s].
    """
    text = resolved(campaign, folder)
    made = {k: v for k, v in provenance({}, seconds).items() if k != "input"}
    document = table.document() | {
        "procedure": campaign.procedure,
        "solved_in_batch": int(table.good.sum()) if batch else 0,
        "campaign": {
            "file": run_folder.CAMPAIGN_FILE, "sha256": hashlib.sha256(text.encode()).hexdigest(),
        },
        "tolerance": None if table.tolerance is None else table.tolerance.as_json(),
        "provenance": made,
    }  # fmt: skip
    run_folder.record(
        "fleet", document, {"fleet": table.columns()}, **{run_folder.CAMPAIGN_FILE: lambda: text}
    ).save(folder)


def load(folder: str | Path) -> tuple[FleetTable, Mapping[str, Any]]:
    """Return the instruments of a folder as they were decided [SI], and what fleet.json says.

    Raises A file is missing, was changed, or is of another schema.
    """
    folder, held = Path(folder), run_folder.read(folder, "fleet")
    said, columns = held.about, held.tables["fleet"]
    broken = {p["serial"]: FoucaultError(p["code"], p["message"], p["cure"])
              for p in said["broken"]}  # fmt: skip
    rows, names = [], [n.removeprefix("sd.") for n in columns if n.startswith("sd.")]
    for i, (serial, where) in enumerate(zip(columns["serial"], columns["folder"], strict=True)):
        if serial in broken:
            rows.append(Row.broken(serial, broken[serial]))
            continue
        row = _of_table(columns, names, i)
        if where:
            page, told = f"{where}/{run_folder.REPORT_FILE}", row
            result = run_folder.load_result(folder / where)
            row = Row.of(serial, result, where, page if (folder / page).is_file() else "")
            if not _alike(row, told, names):  # a later fleet was cut short
                raise error("fleet.mixed", serial=serial, where=folder / where, folder=folder)
        rows.append(row)
    given = said["tolerance"]
    tolerance = None if given is None else Tolerance.from_json(given)
    return FleetTable.of(names, rows).decided(tolerance), said


def _of_table(columns: Mapping[str, Any], names: Sequence[str], i: int) -> Row:
    """Return row `i`, shape () [1], of fleet.parquet where it is all there is."""

    def of(stem: str, parts: Sequence[str]) -> FloatArray:
        return np.array([columns[f"{stem}.{part}"][i] for part in parts], float)

    said = str(columns["reason"][i])
    values, sd = ({n: float(columns[what + n][i]) for n in names} for what in ("", "sd."))
    return Row(
        str(columns["serial"][i]), str(columns["status"][i]), str(columns["verdict"][i]), values,
        sd, of("chi_square", TRIADS), of("redundancy", TRIADS), of("lever_arm", AXES),
        reasons=(said,) if said else (),
    )  # fmt: skip


def _alike(a: Row, b: Row, names: Sequence[str]) -> bool:
    """Tell whether two rows say the same of an instrument."""
    pairs = ((a.values, b.values), (a.sd, b.sd))
    return all(
        np.allclose([x.get(n, np.nan) for n in names], [y.get(n, np.nan) for n in names],
                    rtol=1e-9, atol=0.0, equal_nan=True)
        for x, y in pairs
    )  # fmt: skip


Report = Callable[[Path], Path]
Entry = tuple[str, "Log | FoucaultError"]

LONGEST = 80  # Longest name of a folder that is made of a serial number [1].


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
    table_only: bool = False
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
    table_only: bool = False,
    workers: int = 2,
    progress: Progress = silent,
) -> FleetTable:
    """Calibrate all instruments of a campaign and write one folder.

    `tolerance`: what coefficients may be, None decides nothing; `report`: writes the report of a
    run folder and returns its path, None writes none; `table_only`: whether the table is all that
    is kept, without a run folder for each; `workers`: threads [1]. Returns a row per instrument,
    those without a result last. Raises mistakes in the campaign, and ``fleet.nothing`` where no
    instrument has a result.
    """
    earlier.refuse(campaign, "a fleet")
    started, folder = clock.monotonic(), Path(folder)
    names = names_of(campaign)
    if tolerance is not None:
        tolerance.refuse_unknown(names, campaign.procedure)
    batch = of_fleet.suits(campaign.settings, campaign.site, campaign.prior)
    if table_only and report is not None:
        raise error("fleet.no_reports")
    if table_only and (folder / INSTRUMENTS).exists():
        raise error("fleet.folders", folder=folder)
    work = _Work(campaign, folder, report, batch, table_only)
    if batch and table_only and campaign.log.serial is not None:
        make_folder(folder)
        table = _at_once(work, names, progress)
    else:
        entries = work.named(_entries(campaign, progress))
        make_folder(folder if table_only else folder / INSTRUMENTS)
        rows = list(_rows(work, entries, monte_carlo.threads(workers), progress))
        table = FleetTable.of(names, rows)
    _refuse_nothing(table)
    table = table.decided(tolerance)
    if not table_only:
        _remove_stale(work, table)
    _save(table, campaign, folder, batch=batch, seconds=clock.monotonic() - started)
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
    solved = of_fleet.solve(
        [r.readings for r in reduced], work.campaign.settings, work.campaign.site,
        work.campaign.sizes,
    )  # fmt: skip
    numbered = list(enumerate(reduced))
    rows = over(lambda n: _from_batch(work, solved, *n), numbered)
    for done, row in enumerate(rows, 1):
        progress(0.5 + 0.45 * done / len(reduced), f"writing {done} of {len(reduced)}")
        yield row


def _at_once(work: _Work, names: Sequence[str], progress: Progress) -> FleetTable:
    """Return the table of all instruments of one file, solved and judged as columns."""
    c = work.campaign
    _entries(c, progress)  # mistakes of the campaign
    many = of_many(c.log, c.folder, lambda done: progress(0.3 * done, "reading the log"))

    def alone(serial: str, log: Log | FoucaultError) -> Readings | FoucaultError:
        item = _reduced(work, serial, log)
        return item.readings if isinstance(item, _Reduced) else item.problem  # type: ignore[return-value]

    found = bench.arranged(many, alone)
    problems, numbers = dict(found.problems), np.array(sorted(found.readings), np.int64)
    if not len(numbers):
        return FleetTable.of(names, [Row.broken(many.names[i], p) for i, p in problems.items()])
    progress(0.5, f"solving {len(numbers)} instruments")
    readings = [found.readings[i] for i in numbers.tolist()]
    batch = of_fleet.solve(readings, c.settings, c.site, c.sizes)
    progress(0.8, f"judging {len(numbers)} instruments")
    good, rows = np.ones(len(numbers), bool), list[Row]()
    for k, i in enumerate(numbers.tolist()):
        if (problem := batch.problem(k)) is not None:
            problems[i], good[k] = problem, False
            continue
        said = (Level.PASS, ()) if batch.sure[k] else _judged(batch, k)
        rows.append(batch_row(many.names[i], batch, k, *said))
    order = [LINEAR_LOWER.index(n) for n in names if n in LINEAR_LOWER]
    rows += [Row.broken(many.names[i], problems[i]) for i in sorted(problems)]
    values, sd = np.full((2, len(rows), len(order)), np.nan)
    values[: good.sum()] = batch.estimate.values[good][:, order]
    sd[: good.sum()] = batch.sd[good][:, order]
    return FleetTable(tuple(LINEAR_LOWER[k] for k in order), tuple(rows), values, sd)


def _judged(batch: of_fleet.Batch, k: int) -> tuple[Level, tuple[str, ...]]:
    verdict = Verdict.of(batch.checks(k, batch.estimate.coefficients(k)))
    return verdict.level, verdict.reasons


def batch_row(
    serial: str, batch: of_fleet.Batch, k: int, level: Level, reasons: tuple[str, ...]
) -> Row:
    """Return the row of instrument `k`, shape () [1], of a batch without its coefficients."""
    e, tested = batch.estimate, batch.estimate.redundancy >= 0.5
    arm = e.lever_arm[k] if batch.settings.lever_arm else np.full(3, np.nan)
    return Row(
        serial, str(Status.CONVERGED), str(level), chi_square=np.where(tested, batch.chi_square[k],
        np.nan), redundancy=np.where(tested, e.redundancy, np.nan), lever_arm=arm, reasons=reasons,
    )  # fmt: skip


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
        readings = of_fleet.arranged(readings, of_fleet.plan_of(c.settings))
    except FoucaultError as problem:
        return Row.broken(serial, problem)
    validity = table_report.validity(readings, log, c.site)
    timed = log.clock, times_the_table(log), log.sampled == "increment"
    found = c.findings + log.findings
    return _Reduced(serial, readings, found, validity, provenance(log.source, 0.0), timed)


def _from_batch(work: _Work, batch: of_fleet.Batch, i: int, own: _Reduced) -> Row:
    problem = batch.problem(i)
    if problem is not None:
        return Row.broken(own.serial, problem)
    result, c = batch.result(i), work.campaign
    silent = bool(c.sizes) and batch.beside is None
    told_of = (finding("left_out.not_counted", procedure=c.procedure),) * silent
    result = replace(
        result, findings=own.findings + result.findings + told_of, validity=own.validity,
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
            log, site=c.site, settings=c.settings, noise=c.noise, prior=c.prior, sizes=c.sizes
        )
    except FoucaultError as problem:
        return Row.broken(serial, problem)
    return _saved(work, serial, result)


def _saved(work: _Work, serial: str, result: Result) -> Row:
    instrument = work.campaign.instrument | {"serial": serial}
    result = replace(result, instrument=instrument)
    if work.table_only:
        return Row.of(serial, result, "", "")
    where = work.folders[serial]
    run_folder.save(result, work.folder / where)
    page = "" if work.report is None else f"{where}/{work.report(work.folder / where).name}"
    return Row.of(serial, result, where, page)


def _remove_stale(work: _Work, table: FleetTable) -> None:
    """Remove the result of an earlier run where this one has none; nothing else is touched."""
    for serial in table.problems:
        run_folder.clear(work.folder / work.folders[serial])


MEANS_FILE, TRUTH_FILE = "means.parquet", "truth.parquet"

LOG = f'''\
serial = "serial"                       # a row per instrument and position
file = "{MEANS_FILE}"'''


def simulated(campaign: Campaign, instruments: int, seed: int | None = None) -> SimulatedReadings:
    """Simulate what many instruments of a class say in one session after the other.

    The table is the same for all; each instrument is mounted anew.

    `instruments`: number of them [1]; `seed`: seed, None takes that of the campaign [1].
    """
    session = campaign.session
    if not (isinstance(session, TableSession) and isinstance(campaign.settings, TableSettings)):
        known = [n for n in procedures.PROCEDURES
                 if issubclass(procedures.load(n).Session, TableSession)]  # fmt: skip
        raise error("fleet.simulate", procedure=campaign.procedure, allowed=", ".join(known))
    seed = campaign.simulate.seed if seed is None else seed
    draws = [int(s) for s in np.random.SeedSequence(seed).generate_state(4)]
    typical = grade(campaign.simulate.grade, "simulate.grade")
    plan = plan_of(campaign.settings, session)
    whole_samples(instruments * len(plan))  # before memory is taken
    fleet = Fleet.draw(campaign.simulate.grade, instruments, draws[0])
    fleet = _with_given(fleet, campaign)
    rig = draw_rig(session, draws[1])
    rng = np.random.default_rng(draws[2])
    rig = type(rig)(
        common=rig.common,
        position_sd=rig.position_sd,
        rate_error=rig.rate_error,
        rate_jitter=rig.rate_jitter,
        mounting=session.mounting_sd * rng.standard_normal((instruments, 3)),
        lever_arm=session.lever_arm_sd * rng.standard_normal((instruments, 3)),
        heading=rig.heading,
    )
    return simulate_readings(
        plan, models=fleet, noise=campaign.noise or typical.noise,
        site=campaign.site, rig=rig, interval=1.0 / session.rate, seed=draws[3],
    )  # fmt: skip


def _with_given(fleet: Fleet, campaign: Campaign) -> Fleet:
    """Set the coefficients that the campaign gives, the same for all instruments."""
    given, values = given_errors(campaign, LAYOUT), fleet.values(LAYOUT.names)
    for name, value in given.items():
        values[:, LAYOUT.index(name)] = value
    return Fleet.from_values(LAYOUT.names, values) if given else fleet


def save_simulated(
    campaign: Campaign, made: SimulatedReadings, folder: str | Path, seed: int | None = None
) -> Path:
    """Write a simulated fleet as a test bench would, with the truth beside it.

    `seed` or None: seed that was used, where it is not that of the campaign [1]. Returns the
    campaign file written; `foucault fleet` takes it as it is.
    """
    folder = Path(folder)
    keep_recorded(folder, TRUTH_FILE, (MEANS_FILE, SESSION_CAMPAIGN))
    make_folder(folder)
    write_table(folder / MEANS_FILE, table_of_means(made))
    write_table(folder / TRUTH_FILE, truth_of(made))
    own = log_table(campaign.procedure, averaged=True)
    head, _, rest = own.partition('file = "log.csv"')
    text = with_own_log(campaign.text, head + LOG + rest)
    if seed is not None:
        text = with_seed(text, seed)
    if campaign.sizes is not None and not campaign.sizes:
        text = with_nothing_else(text)
    write_text(folder / SESSION_CAMPAIGN, text)
    return folder / SESSION_CAMPAIGN
