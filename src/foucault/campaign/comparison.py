"""Results compared: one instrument over time, or several instruments, and whether they keep limits.

Results of one instrument are compared with one another; of several instruments the latest result of
each. See `diagnose.compare` for the tests and `campaign.tolerance` for the limits. Results
are named one by one, or in a TOML file::

    [[result]]
    folder = "2025/run"          # relative to this file
    date = 2025-03-01            # may be left out, as may the others
    instrument = "IMU 7"
    label = "after repair"

A result holds when its log was recorded: at the date given, else at the first date in the log,
else, for want of better, at the date of the computation. The folder holds::

    compare.json    results with their hashes, changes, drifts, limits, verdict [SI, rad]
    report.html     for people, written by `report.compare`
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from foucault import run_folder
from foucault.campaign.tolerance import (
    Decision,
    Judged,
    Tolerance,
    Verdict,
    decisions_on,
    verdict_of,
)
from foucault.diagnose.comparable import (
    Comparable,
    Entry,
    at_one_temperature,
    comparable,
    refuse_dependent,
)
from foucault.diagnose.compare import Between, History, between, history
from foucault.diagnose.mounted import Tie
from foucault.errors import Finding, FoucaultError, error, finding, listed, suggestion
from foucault.files import said_in, sha256
from foucault.models.layouts import EVERY
from foucault.result import Result, provenance
from foucault.run_folder import RESULT_FILE, Record, load_result, result_file
from foucault.units import plain

KEYS = ("folder", "date", "instrument", "label")

DATED = 1e8  # Times since 1970 are larger, and lengths of time smaller [s].
ONE = "the instrument"  # What an instrument without a name is called.


@dataclass(frozen=True)
class Named:
    """A result as somebody named it."""

    path: Path  # run folder or result.json
    date: str = ""  # when it holds; empty where not said
    # instrument, label: which instrument, and what to call the result; empty where not said
    instrument: str = ""
    label: str = ""


def entries(paths: Sequence[str | Path], dates: str = "", *, same: bool = False) -> list[Entry]:
    """Read the results that are to be compared.

    `paths`: run folders, result.json files, or TOML files that list them; `dates`: dates of the
    results, separated by commas, an empty one keeps what is known; `same`: whether all are of one
    instrument, whatever they say. Returns by instrument, then in time; where no time is known, in
    the order given.
    """
    named = [n for path in paths for n in _named(Path(path))]
    if dates:
        texts = [text.strip() for text in dates.split(",")]
        if len(texts) != len(named):
            raise error("compare.dates", given=len(texts), wanted=len(named))
        named = [replace(n, date=text or n.date) for n, text in zip(named, texts, strict=True)]
    if len(named) < 2:
        raise error("compare.one", count=len(named))
    labels = _labels(named)
    read = [named_entry(n, label) for n, label in zip(named, labels, strict=True)]
    if same:
        name = next((e.instrument for e in read if e.instrument), "")
        read = [replace(e, instrument=name) for e in read]
    unsaid = [e for e in read if not e.instrument]
    said = list(dict.fromkeys(e.instrument for e in read if e.instrument))
    if unsaid and said:
        raise error("compare.which", name=unsaid[0].label, others=", ".join(said))
    return _sorted([replace(e, instrument=e.instrument or ONE) for e in read])


def _named(path: Path) -> list[Named]:
    if path.suffix.lower() != ".toml":
        return [Named(path)]
    said = said_in(path, "compare.list", path=path)
    rows = said.get("result")
    if set(said) != {"result"} or not isinstance(rows, list) or not rows:
        raise error("compare.list", path=path, reason="it holds no [[result]], or something else")
    return [_row(path, i, row) for i, row in enumerate(rows, 1)]


def _row(path: Path, number: int, row: Any) -> Named:
    where = f"[[result]] number {number}"
    if not isinstance(row, Mapping) or not isinstance(row.get("folder"), str):
        raise error("compare.list", path=path, reason=f"{where} has no folder")
    for key, value in row.items():
        if key not in KEYS:
            hint = suggestion(key, KEYS)
            raise error("compare.list", path=path, reason=f"{where}: {key} is not known.{hint}")
        dated = key == "date" and isinstance(value, datetime.date)
        if not (isinstance(value, str) or dated):
            raise error("compare.list", path=path, reason=f"{where}: {key} = {value!r} is no text")
    date = row.get("date", "")
    text = date if isinstance(date, str) else date.isoformat()
    given = {key: str(row.get(key, "")).strip() for key in ("instrument", "label")}
    return Named(path.parent / row["folder"], text, **given)


def _labels(named: Sequence[Named]) -> list[str]:
    """Return a short name for each, unlike all others: so many folders of its path as it takes."""
    parts = [
        (n.path.parent if n.path.name == RESULT_FILE else n.path).resolve().parts for n in named
    ]
    out = []
    for n, mine in zip(named, parts, strict=True):
        others = [p for p in parts if p is not mine]
        depth = next(
            (d for d in range(1, len(mine)) if all(p[-d:] != mine[-d:] for p in others)), 1
        )
        out.append(n.label or "/".join(mine[-depth:]))
    return out


def named_entry(named: Named, label: str) -> Entry:
    """Read a result that somebody named [SI]; `label` is what it is called."""
    result = load_result(named.path, with_tables=False)
    said = (str(result.instrument.get(key) or "").strip() for key in ("name", "serial"))
    instrument = named.instrument or " ".join(word for word in said if word)
    time, dated = _time(named, result)
    return Entry(label, result, instrument, time, dated, sha256(result_file(named.path)))


def _time(named: Named, result: Result) -> tuple[float, str]:
    """Return when a result holds, and where that is from."""
    if named.date:
        return moment(named.date), "given"
    recorded = _recorded(named.path, result)
    if math.isfinite(recorded):
        return recorded, "log"
    created = result.provenance.get("created")
    try:
        return (moment(str(created)), "computed") if created else (math.nan, "")
    except FoucaultError:  # somebody else wrote it
        return math.nan, ""


def moment(text: str) -> float:
    """Return the time that a date says, since 1970 and in UTC where it names no zone [s]."""
    try:
        date = datetime.datetime.fromisoformat(text.strip())
    except ValueError:
        raise error("compare.date", given=text) from None
    return (date if date.tzinfo else date.replace(tzinfo=datetime.UTC)).timestamp()


def _recorded(path: Path, result: Result) -> float:
    """Return when the log begins, where its times are dates; else NaN [s]."""
    described = (result.provenance.get("input") or {}).get("description") or {}
    unit = str((described.get("time") or {}).get("unit", ""))
    if unit.lower() != "iso":
        return math.nan
    try:
        tables = load_result(path).tables
    except FoucaultError:  # a result.json that was copied alone
        return math.nan
    columns = [t[c] for t in tables.values() for c in ("start", "time") if c in t and len(t[c])]
    starts = [float(np.nanmin(np.asarray(c, float))) for c in columns]
    return min((s for s in starts if s > DATED), default=math.nan)


def _sorted(read: list[Entry]) -> list[Entry]:
    """Sort by instrument, time and name; without a date all of that instrument stay as they are."""
    out = []
    for name in sorted({e.instrument for e in read}):
        mine = [e for e in read if e.instrument == name]
        if all(math.isfinite(e.time) for e in mine):
            mine.sort(key=lambda e: (e.time, e.label, e.sha256))
        out += mine
    return out


@dataclass(frozen=True)
class Comparison:
    """Results and what comparing them has shown."""

    entries: tuple[Entry, ...]  # the results, by instrument and in time [SI]
    instruments: tuple[Judged, ...]  # each instrument with its results
    between: Between | None  # the instruments compared with one another, where there are several
    shared: Comparable | None  # what all of them have in common, where there are several
    decisions: tuple[Decision, ...]  # what the tolerance says; empty without one
    tolerance: Tolerance | None
    verdict: Verdict  # pass, doubtful or fail, and why
    findings: tuple[Finding, ...]  # what the user should know


def run(
    paths: Sequence[str | Path], *, dates: str = "", same: bool = False,
    tolerance: Tolerance | None = None,
) -> Comparison:  # fmt: skip
    """Compare results.

    `paths`: run folders, result.json files, or TOML files that list them, two results or more;
    `dates`: dates of the results, separated by commas, an empty one keeps what is known; `same`:
    whether all are of one instrument, whatever they say; `tolerance`: limits of values, changes
    and drifts, None decides on changes by chance alone. Returns what was found [SI].
    """
    return of(entries(paths, dates, same=same), tolerance)


def of(read: Sequence[Entry], tolerance: Tolerance | None = None) -> Comparison:
    """Compare results that were read, in the order of `entries`.

    `read`: two results or more [SI]; `tolerance` or None: limits of values, changes and drifts.
    """
    refuse_dependent(read)
    read, taken = at_one_temperature(read)
    groups = [(name, list(mine)) for name, mine in groupby(read, lambda e: e.instrument)]
    if tolerance is not None:
        every = {name for e in read for name in e.result.coefficients.names}
        tolerance.refuse_unknown([n for n in EVERY.names if n in every], "the results")
    instruments, found = [], taken
    found += _dates([e for _, mine in groups if len(mine) > 1 for e in mine])
    for name, mine in groups:
        together = comparable(mine) if len(mine) > 1 else None
        past = None if together is None else history(together.series)
        found += [] if together is None else together.findings
        if past is not None and past.chi_square < past.low:
            given = plain(past.chi_square, 3)
            found.append(finding("compare.too_alike", name=name, given=given, dof=past.dof))
        instruments.append(Judged(name, tuple(mine), together, past))
    shared = comparable([mine[-1] for _, mine in groups]) if len(groups) > 1 else None
    side = None if shared is None else between(shared.series)
    found += [] if shared is None else shared.findings
    decisions = decisions_on(instruments, tolerance)
    told = tuple(dict.fromkeys(found))
    verdict = verdict_of(instruments, side, decisions, told)
    return Comparison(
        tuple(read), tuple(instruments), side, shared, decisions, tolerance, verdict, told
    )


def _dates(read: Sequence[Entry]) -> list[Finding]:
    found = []
    if any(e.instrument == ONE for e in read):
        found.append(finding("compare.unnamed"))
    unknown = [e.label for e in read if not np.isfinite(e.time)]
    if unknown:
        found.append(finding("compare.undated", names=listed(unknown)))
    computed = [e.label for e in read if e.dated == "computed"]
    if computed:
        found.append(finding("compare.computed", names=listed(computed)))
    return found


def record(
    comparison: Comparison, seconds: float = 0.0, ties: Sequence[tuple[int, int, Tie]] = ()
) -> Record:
    """Return what the folder of a comparison keeps.

    `seconds`: how long it took [s]; `ties` (k,): numbers of two results [1], and how the instrument
    of the second lies in the axes of the first.
    """
    c, side = comparison, comparison.between
    number = {id(e): i for i, e in enumerate(c.entries)}
    about = {
        "verdict": {"level": c.verdict.level, "reasons": list(c.verdict.reasons)},
        "results": [_result(e) for e in c.entries],
        "coefficients": _coefficients(c),
        "instruments": [
            {"name": j.name, "results": [number[id(e)] for e in j.entries]} | _history(j)
            for j in c.instruments
        ],
        "between": None if side is None else {
            "names": side.series.names, "values": side.series.values, "sd": side.series.sd,
            "limit": side.limit, "spreads": [asdict(s) for s in side.spreads],
            "outlying": [asdict(o) for o in side.outlying],
        },
        "differences": _differences(c),
        "ties": [
            {"first": a, "second": b}
            | {k: getattr(t, k) for k in ("rests", "C_ab", "rotation", "sd", "cov")}
            for a, b, t in ties
        ],
        "tolerance": None if c.tolerance is None else c.tolerance.as_json(),
        "decisions": [asdict(d) for d in c.decisions],
        "findings": [f.as_dict() for f in c.findings],
        "provenance": {k: v for k, v in provenance({}, seconds).items() if k != "input"},
    }  # fmt: skip
    return run_folder.record("comparison", about)


def _differences(c: Comparison) -> list[dict[str, Any]]:
    """Return every instrument less the first: what both were given drops out."""
    if c.shared is None:
        return []
    x = c.shared.series
    own = x.cov - x.shared @ x.shared.swapaxes(1, 2)
    change, L = x.values - x.values[0], x.shared - x.shared[0]
    var = np.einsum("npp->np", own + own[0] + L @ L.swapaxes(1, 2))
    return [
        {"first": 0, "second": k, "names": x.names, "change": change[k], "sd": np.sqrt(var[k])}
        for k in range(1, len(x))
    ]


def _result(e: Entry) -> dict[str, Any]:
    r, v = e.result, e.result.coefficients
    return {
        "label": e.label,
        "instrument": e.instrument,
        "procedure": r.procedure,
        "time": e.time,
        "dated": e.dated,
        "verdict": str(r.verdict.level),
        "temperature_mean": r.validity.get("temperature_mean"),
        "gauge": r.gauge,
        "sha256": e.sha256,
        "coefficients": {
            n: [float(x), float(s) if free else math.nan]
            for n, x, s, free in zip(v.names, v.values, v.sd, v.free, strict=True)
        },
    }


def _coefficients(c: Comparison) -> list[dict[str, Any]]:
    """Return every coefficient of any result, each once, with its limits."""
    layouts = [j.comparable.layout for j in c.instruments if j.comparable is not None]
    layouts += [] if c.shared is None else [c.shared.layout]
    layouts += [e.result.coefficients.layout for e in c.entries]
    every = list({k.name: k for layout in layouts for k in layout.coefficients}.values())
    limits = c.tolerance or Tolerance(())
    names = [k.name for k in every]
    allowed = (limits.limits(names)[0], *limits.changes(names))
    keys = ("limit", "change", "drift_per_year")
    return [
        {"name": k.name, "symbol": k.symbol, "kind": k.kind, "unit": k.unit}
        | {key: float(limit[i]) for key, limit in zip(keys, allowed, strict=True)}
        for i, k in enumerate(every)
    ]


def _history(judged: Judged) -> dict[str, Any]:
    if judged.history is None:
        return {"compared": None}
    h: History = judged.history
    return {
        "compared": {
            "names": h.series.names,
            "values": h.series.values,
            "sd": h.series.sd,
            "chi_square": h.chi_square,
            "dof": h.dof,
            "limits": [h.low, h.high],
            "changed": h.changed,
            "standing_out": [h.courses[k].name for k in h.standing_out],
            "likeliest": h.courses[h.likeliest].name,
            "alone": h.alone,
            "coefficient_limit": h.limit,
            "drift_limit": h.drift_limit,
            "pair_limit": h.pair_limit,
            "z_limit": h.z_limit,
            "courses": [asdict(course) for course in h.courses],
            "pairs": [
                {
                    "first": p.first, "second": p.second, "chi_square": p.chi_square,
                    "change": p.change, "sd": p.sd, "z": p.z, "w": p.w,
                    "alone": None if p.alone is None else h.series.names[p.alone],
                }
                for p in h.pairs
            ],
        }
    }  # fmt: skip
