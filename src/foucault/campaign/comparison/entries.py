"""Which results to compare, of which instrument each is, and when it holds.

Results are named one by one, or in a TOML file::

    [[result]]
    folder = "2025/run"          # relative to this file
    date = 2025-03-01            # may be left out, as may the others
    instrument = "IMU 7"
    label = "after repair"

A result holds when its log was recorded: at the date given, else at the first date in the log,
else, for want of better, at the date of the computation.
"""

from __future__ import annotations

import datetime
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault.diagnose.compare.comparable import Entry
from foucault.errors import FoucaultError, error, suggestion
from foucault.files import parse_toml, read_text, sha256
from foucault.result import Result
from foucault.run_folder import RESULT_FILE, load_result

KEYS = ("folder", "date", "instrument", "label")

DATED = 1e8
"""Times since 1970 are larger, and lengths of time smaller [s]."""

ONE = "the instrument"
"""What an instrument without a name is called."""


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
    read = [_entry(n, label) for n, label in zip(named, labels, strict=True)]
    read = _of_one(read) if same else read
    _refuse_unclear(read)
    return _sorted([replace(e, instrument=e.instrument or ONE) for e in read])


def _named(path: Path) -> list[Named]:
    if path.suffix.lower() != ".toml":
        return [Named(path)]
    try:
        said = parse_toml(read_text(path))
    except (OSError, tomllib.TOMLDecodeError) as problem:
        raise error("compare.list", path=path, reason=str(problem)) from None
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


def _entry(named: Named, label: str) -> Entry:
    result = load_result(named.path, with_tables=False)
    file = named.path / RESULT_FILE if named.path.is_dir() else named.path
    said = (str(result.instrument.get(key) or "").strip() for key in ("name", "serial"))
    instrument = named.instrument or " ".join(word for word in said if word)
    time, dated = _time(named, result)
    return Entry(label, result, instrument, time, dated, sha256(file))


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


def _of_one(read: list[Entry]) -> list[Entry]:
    name = next((e.instrument for e in read if e.instrument), "")
    return [replace(e, instrument=name) for e in read]


def _refuse_unclear(read: Sequence[Entry]) -> None:
    unsaid = [e for e in read if not e.instrument]
    said = list(dict.fromkeys(e.instrument for e in read if e.instrument))
    if unsaid and said:
        raise error("compare.which", name=unsaid[0].label, others=", ".join(said))


def _sorted(read: list[Entry]) -> list[Entry]:
    """Sort by instrument and time; a date that is missing leaves all of that instrument as is."""
    out = []
    for name in sorted({e.instrument for e in read}):
        mine = [e for e in read if e.instrument == name]
        if all(math.isfinite(e.time) for e in mine):
            mine.sort(key=lambda e: (e.time, e.sha256))
        out += mine
    return out
