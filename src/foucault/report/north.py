"""The page of a search for north: where it is, how sure, and what would make it surer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.coefficients import format_value
from foucault.files import atomic
from foucault.report import (
    certificate,
    ends,
    figures,
    figures_north,
    north_detail,
    north_sources,
    render,
)
from foucault.report.ends import STATES, WORDS, Heading
from foucault.report.figures_north import Needle
from foucault.report.north_detail import Setup, angle_unit, grouped, listed
from foucault.report.page import Block, Column, Figure, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Level

if TYPE_CHECKING:
    from foucault.campaign.north.folder import NorthRecord

LISTED = 500
"""Set-ups in the table of the page; the others are in fixes.csv [1]."""

NEEDLES = 360
"""Needles on the compass rose [1]."""

STACKED = 20
"""Set-ups whose budgets are drawn side by side [1]."""

DETAILED = 3
"""Set-ups shown in detail, where there are more [1]."""

SHORT_NAME = 20
"""Letters that a name of a set-up may have to stay on one line [1]."""

LEVELS = ("unusable", "doubtful", "pass")
"""Verdicts, worst first."""


def write(record: NorthRecord, path: str | Path) -> Path:
    """Write one self-contained HTML file."""
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(record), encoding="utf-8")
    return path


def html(record: NorthRecord) -> str:
    """Return the page as HTML."""
    setups = [Setup(record, i) for i in range(len(record.about["setups"]))]
    if len(setups) == 1:
        head, made = _one_heading(setups[0]), _one(setups[0])
    else:
        head, made = _many_heading(record, setups), _many(record, setups)
    about = record.about
    made += north_sources.made_from(about)
    return render(head, [section for section in made if section is not None])


# -- one set-up ----------------------------------------------------------------------------


def _one_heading(setup: Setup) -> Heading:
    value, sd = setup.degrees("heading"), setup.degrees("heading", "sd")
    known = np.isfinite(value) and np.isfinite(sd)
    level = Level(setup.said["verdict"])
    title = "No heading"
    if known:
        title = f"Heading {format_value(value, sd)}° ± {format_value(2 * sd, sd)}°"
    reasons = list(setup.said["reasons"])
    if not reasons:
        reasons = [f"All {len(setup.said['checks'])} checks passed."]
    line = ["±2 standard deviations"] if known else []
    return Heading(
        title, [setup.name, *line, *_line(setup.about)], STATES[level], WORDS[level], reasons
    )


def _line(about: Mapping[str, Any]) -> list[str]:
    """Instrument, place and date in a few words."""
    instrument = about.get("instrument") or {}
    name = " ".join(str(instrument[k]) for k in ("name", "serial") if instrument.get(k))
    created = (about.get("provenance") or {}).get("created")
    one = not isinstance(about["known"]["latitude"], list)
    parts = [name, certificate.place(about["site"]) if one else "several latitudes"]
    parts.append(certificate.date(str(created)) if created else "")
    return [part for part in parts if part]


def _one(setup: Setup) -> list[Section | None]:
    return [
        _north(setup),
        north_detail.fit(setup),
        north_detail.residuals(setup),
        north_detail.budget(setup),
        north_detail.checks(setup),
        north_detail.findings(setup),
        ends.findings(grouped(setup.about["findings"]), "readings"),
        north_sources.measured(setup),
    ]


def _north(setup: Setup) -> Section:
    """The compass rose, the rose magnified, and the angles."""
    lead = (
        "Heading of the forward axis of the case, clockwise from true north; pitch nose up; roll "
        "right side down. Bound: the smallest standard deviation that the noise of the sensors "
        "alone would allow (Cramér-Rao)."
    )
    blocks: list[Block] = []
    sd = setup.degrees("heading", "sd")
    if np.isfinite(sd) and np.isfinite(setup.degrees("heading")):
        other = setup.other if setup.said["ambiguous"] else None
        reference = setup.reference
        blocks.append(figures_north.rose([setup.needle], other, reference))
        if sd < 30:
            unit = angle_unit(sd)
            bound = setup.degrees("heading", "bound")
            blocks.append(
                figures_north.strip(
                    setup.degrees("heading"), sd, bound if np.isfinite(bound) else None,
                    reference, (shown(unit.name), unit.size),
                )
            )  # fmt: skip
    return Section("Where north is", lead, [*blocks, north_detail.angles(setup)])


# -- many ----------------------------------------------------------------------------------


def _counts(setups: Sequence[Setup]) -> dict[str, int]:
    return {level: sum(s.said["verdict"] == level for s in setups) for level in LEVELS}


def _many_heading(record: NorthRecord, setups: Sequence[Setup]) -> Heading:
    counts = _counts(setups)
    worst = next((level for level in LEVELS if counts[level]), "pass")
    passed = counts["pass"]
    word = "All pass" if passed == len(setups) else f"{passed} of {len(setups)} pass"
    reasons = []
    for level in LEVELS[:2]:
        names = [s.name for s in setups if s.said["verdict"] == level]
        if names:
            reasons.append(f"{WORDS[Level(level)]}: {listed(names)}.")
    reasons += north_detail.common(setups)
    sd = np.array([s.degrees("heading", "sd") for s in setups])
    if np.isfinite(sd).any():
        low, high = (angle_unit(v).words(v) for v in (np.nanmin(sd), np.nanmax(sd)))
        known = low if low == high else f"{low} to {high}"
        reasons.append(f"Standard deviation of the headings: {known}.")
    title = f"North at {len(setups)} set-ups"
    return Heading(title, _line(record.about), STATES[Level(worst)], word, reasons)


def _worst_first(setups: Sequence[Setup]) -> list[Setup]:
    def rank(setup: Setup) -> tuple[int, float]:
        sd = setup.degrees("heading", "sd")
        return LEVELS.index(setup.said["verdict"]), -sd if np.isfinite(sd) else -np.inf

    return sorted(setups, key=rank)


def _many(record: NorthRecord, setups: list[Setup]) -> list[Section | None]:
    order = _worst_first(setups)
    made: list[Section | None] = [_table(setups, order), _roses(setups), _budgets(order)]
    made.append(ends.findings(grouped(record.about["findings"]), "readings"))
    for setup in order[:DETAILED]:
        made += _detail(setup)
    return made


def _table(setups: list[Setup], order: list[Setup]) -> Section:
    lead = "In the order of the file. Angles in degrees, with their standard deviations."
    some = setups
    if len(setups) > LISTED:
        some = order[:LISTED]
        lead = f"The worst {LISTED} of {len(setups)}, worst first; all are in `fixes.csv`."
    estimated = not isinstance(setups[0].about["known"]["latitude"], float) or any(
        s.degrees("latitude", "sd") > 1e-6 for s in setups
    )
    reference = any(s.reference is not None for s in setups)
    name_look = "short" if max(len(s.name) for s in some) <= SHORT_NAME else "text"
    columns = [
        Column("", "state"), Column("set‑up", name_look), Column("heading [°]", "number"),
        Column("± sd [°]", "number"), Column("sd / bound", "number", aside=True),
        *([Column("minus reference [°]", "number")] if reference else []),
        Column("pitch [°]", "number", aside=True), Column("roll [°]", "number", aside=True),
        *([Column("latitude [°]", "number", aside=True), Column("± sd [°]", "number", aside=True)]
          if estimated else []),
        Column("what to know", aside=True),
    ]  # fmt: skip
    rows, common = [], north_detail.common(setups)
    for s in some:
        sd, bound = s.degrees("heading", "sd"), s.degrees("heading", "bound")
        ratio = sd / bound if bound > 0 else np.nan
        cells = [STATES[Level(s.said["verdict"])], s.name, s.text("heading"), s.text_sd("heading")]
        cells.append(f"{ratio:.2f}" if np.isfinite(ratio) else "")
        cells += [s.minus_reference] * reference
        cells += [s.text("pitch"), s.text("roll")]
        cells += [s.text("latitude"), s.text_sd("latitude")] if estimated else []
        rows.append([*cells, north_detail.own(s, common)])
    return Section("Headings", lead, [Table(columns, rows)])


def _roses(setups: list[Setup]) -> Section | None:
    known = [s for s in setups if np.isfinite(s.degrees("heading") + s.degrees("heading", "sd"))]
    if not known:
        return None
    needles: list[Needle] = [s.needle for s in known[:NEEDLES]]
    sd = np.array([s.degrees("heading", "sd") for s in known])
    bound = np.array([s.degrees("heading", "bound") for s in known])
    unit = angle_unit(float(np.median(sd)))
    figure = figures_north.against_bound(
        [s.name for s in known], sd / unit.size, bound / unit.size,
        [s.said["verdict"] for s in known], shown(unit.name),
    )  # fmt: skip
    lead = "Where each pointed, and how sure it is beside what the noise alone would allow."
    return Section("All set-ups", lead, [figures_north.rose(needles), figure])


def _budgets(order: list[Setup]) -> Section | None:
    some = [s for s in order if s.budget][:STACKED]
    if not some:
        return None
    names = list(dict.fromkeys(name for s in some for name in s.budget))
    if len(names) == 1:
        return Section("Uncertainty budget", f"All of it is {names[0]}.", [])
    share = {n: np.array([100 * s.share(n) for s in some]) for n in names}
    labels = [s.name for s in some]
    alt = "Share of every source in the variance of every heading"
    figure: Figure = figures.stacked(labels, figures_north.largest(share), alt)
    lead = "Where the variance of each heading comes from"
    lead += ", the worst first." if len(some) == len(order) else f"; the worst {len(some)}."
    return Section("Uncertainty budget", lead, [figure])


def _detail(setup: Setup) -> list[Section | None]:
    """One set-up in one section."""
    parts = [
        north_detail.fit(setup), north_detail.residuals(setup), north_detail.budget(setup),
        north_detail.checks(setup), north_detail.findings(setup), north_sources.measured(setup),
    ]  # fmt: skip
    blocks: list[Block] = [north_detail.angles(setup)]
    for part in parts:
        if part is not None:
            blocks += [Text(part.lead)] * bool(part.lead) + list(part.blocks)
    return [Section(f"Set-up {setup.name}", setup.said["warnings"], blocks)]
