"""The report of a comparison: what changed, how, against which limits. It computes nothing."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from foucault.files import atomic
from foucault.report import ends, render
from foucault.report.compare_detail import (
    changes,
    drawn,
    in_unit,
    instruments_drawn,
    pairs,
    plus_minus,
    side_by_side,
)
from foucault.report.ends import Heading
from foucault.report.page import Column, Section, Table
from foucault.report.uncertainty import shown
from foucault.units import ZERO_CELSIUS, plain

About = Mapping[str, Any]

LISTED = 40
"""Limits in the table of a page, the worst first."""

LOOKS = {
    "pass": "good", "doubtful": "warning", "fail": "bad", "undecided": "warning",
    "unusable": "bad",
}  # fmt: skip
SOURCES = {"given": "as given", "log": "from the log", "computed": "of the computation", "": ""}


def write(about: About, path: str | Path) -> Path:
    """Write one self-contained HTML file."""
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(about), encoding="utf-8")
    return path


def html(about: About) -> str:
    """Return the report as HTML."""
    several = len(about["instruments"]) > 1
    made: list[Section | None] = [_results(about), _tolerance(about)]
    made += [side_by_side(about), instruments_drawn(about)] if several else []
    for one in about["instruments"]:
        if one["compared"] is not None:
            of = f": {one['name']}" if several else ""
            made += [
                changes(about, one, of),
                drawn(about, one, of),
                pairs(about, one, of),
            ]
    made += [ends.findings(about["findings"], "results"), _provenance(about)]
    return render(_heading(about), [section for section in made if section is not None])


def _heading(about: About) -> Heading:
    instruments, results = about["instruments"], about["results"]
    level = about["verdict"]["level"]
    several = len(instruments) > 1
    title = f"{len(instruments)} instruments compared" if several else instruments[0]["name"]
    if not several:
        title = f"{title[:1].upper()}{title[1:]}: has it changed?"
    dates = sorted(day for r in results if (day := _day(r["time"])))
    line = [f"{len(results)} results"]
    line += [dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"] if dates else []
    line += [", ".join(dict.fromkeys(r["procedure"] for r in results))]
    changed = any(one["compared"] and one["compared"]["changed"] for one in instruments)
    limited = about["tolerance"] is not None
    open_ = any(d["decision"] == "undecided" for d in about["decisions"])
    word = {
        "fail": "Out of tolerance",
        "doubtful": "Too near a limit to tell" if open_ else "Changed" if changed else "Doubtful",
        "pass": "Within tolerance" if limited else ("Compared" if several else "Not changed"),
    }[level]
    reasons = [shown(r).replace(" °", "°").replace(" -", " −") for r in about["verdict"]["reasons"]]
    return Heading(title, line, LOOKS[level], word, reasons)


def _day(time: float | None) -> str:
    if time is None:
        return ""
    return f"{datetime.datetime.fromtimestamp(time, datetime.UTC):%Y-%m-%d}"


def _results(about: About) -> Section:
    several = len(about["instruments"]) > 1
    rows = []
    for i, r in enumerate(about["results"], 1):
        warm = r["temperature_mean"]
        rows.append(
            [
                LOOKS[r["verdict"]], f"{i}", r["label"], *([r["instrument"]] if several else []),
                _day(r["time"]) or "unknown", SOURCES[r["dated"]],
                f"{warm - ZERO_CELSIUS:.1f} °C" if warm is not None else "", r["procedure"],
                r["verdict"],
            ]
        )  # fmt: skip
    columns = [Column("", "state"), Column("no.", "number"), Column("result", "short")]
    columns += [Column("instrument")] if several else []
    columns += [
        Column("date", "short"), Column("which date", aside=True), Column("mean temperature"),
        Column("procedure", aside=True), Column("its verdict", aside=True),
    ]  # fmt: skip
    if not any(row[-3] for row in rows):
        columns, rows = columns[:-3] + columns[-2:], [row[:-3] + row[-2:] for row in rows]
    return Section("Results", "", [Table(columns, rows)])


def _tolerance(about: About) -> Section | None:
    if about["tolerance"] is None:
        return None
    several = len(about["instruments"]) > 1
    kinds = {c["name"]: c["kind"] for c in about["coefficients"]}
    order = ("fail", "undecided", "pass")
    rows = []
    ranked = sorted(
        about["decisions"],
        key=lambda d: (order.index(d["decision"]), -abs(d["value"] or 0.0) / d["limit"]),
    )
    for d in ranked[:LISTED]:
        kind = kinds[d["name"]]
        unit, size = in_unit(kind, d["limit"])
        per = " / year" if d["what"] == "drift" else ""
        known = d["value"] is not None and d["sd"] is not None
        number = plus_minus(d["value"] / size, d["sd"] / size) if known else "unknown"
        between = f"{d['first']} → {d['second']}" if d["first"] else d["second"]
        rows.append(
            [
                LOOKS[d["decision"]], d["name"], *([d["instrument"]] if several else []),
                d["what"], number, f"±{plain(d['limit'] / size)} {shown(unit)}{per}",
                d["decision"], between,
            ]
        )  # fmt: skip
    columns = [Column("", "state"), Column("coefficient", "name")]
    columns += [Column("instrument")] if several else []
    columns += [
        Column("what", "short"), Column("measured ± sd", "number"), Column("limit", "short"),
        Column("decision", aside=True), Column("where", aside=True),
    ]  # fmt: skip
    guard = plain(about["tolerance"]["guard_band_sd"])
    lead = (
        f"Pass: size + {guard} sd is not larger than the limit. Fail: size − {guard} sd is. "
        "Between the two the measurement cannot tell (decision rule of ISO 14253-1). Values are "
        "those of the latest result; of the changes between any two results the worst counts."
    )
    if len(ranked) > LISTED:
        lead += f" The {LISTED} nearest to their limits of {len(ranked)}; all are in compare.json."
    return Section("Tolerance", lead, [Table(columns, rows)])


# -- the rest --------------------------------------------------------------------------------


def _provenance(about: About) -> Section:
    made = about["provenance"]
    facts = [("created", str(made.get("created", "")))]
    facts += [("tolerance", about["tolerance"]["file"])] if about["tolerance"] else []
    facts += [(f"SHA-256 of {r['label']}", r["sha256"]) for r in about["results"]]
    return ends.provenance([*facts, ("versions", ends.words(made.get("versions") or {}))])
