"""The page of a navigation: where it went, how far off, and what the calibration is worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.files import atomic
from foucault.report import certificate, ends, navigation_parts, render
from foucault.report import figures_navigation as figures
from foucault.report import navigation_detail as detail
from foucault.report.ends import STATES, WORDS, Heading
from foucault.report.figures import FIRST, SECOND, THIRD
from foucault.report.navigation_detail import Seen, metres, minutes
from foucault.report.north_detail import grouped
from foucault.report.page import Block, Column, Facts, Figure, Section, Table
from foucault.result import Level

if TYPE_CHECKING:
    from foucault.campaign.navigation.folder import NavigationRecord

ELLIPSES = 4
"""Error ellipses on the map of a path [1]."""


def write(record: NavigationRecord, path: str | Path) -> Path:
    """Write one self-contained HTML file."""
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(record), encoding="utf-8")
    return path


def html(record: NavigationRecord) -> str:
    """Return the page as HTML."""
    seen = Seen(record)
    made = [
        _map(seen), _growth(seen), navigation_parts.terms(seen), navigation_parts.worth(seen),
        navigation_parts.sources(seen), detail.motion(seen), detail.start(seen),
        ends.findings(grouped(record.about["findings"])), detail.checks(seen),
        detail.known(seen), detail.made_from(seen),
    ]  # fmt: skip
    return render(_heading(seen), [section for section in made if section is not None])


def _heading(seen: Seen) -> Heading:
    about = seen.about
    level = Level(about["verdict"])
    title = f"Navigated for {minutes(about['duration'])}"
    end = seen.growth(0)[-1] if seen.growth(0) else None
    if end is not None and end["horizontal"] is not None:
        title = f"{metres(end['horizontal'])} off after {minutes(end['age'])}"
        other = seen.growth(1)[-1] if seen.growth(1) else None
        if other is not None and other["horizontal"] is not None:
            title += f", {metres(other['horizontal'])} without calibration"
    reasons = list(about["reasons"]) or detail.in_words(seen)
    instrument = about.get("instrument") or {}
    name = " ".join(str(instrument[k]) for k in ("name", "serial") if instrument.get(k))
    created = (about.get("provenance") or {}).get("created")
    line = [name, certificate.place(about["site"]),
            certificate.date(str(created)) if created else ""]  # fmt: skip
    return Heading(title, [p for p in line if p], STATES[level], WORDS[level], reasons)


def _map(seen: Seen) -> Section:
    """Paths east and north of the start, with the error ellipse at some times."""
    lines: list[tuple[str, FloatArray, FloatArray, str, str]] = []
    moved = not seen.still
    e = seen.errors
    if moved and e is not None and "reference_east" in e:
        lines.append(("reference", e["reference_east"], e["reference_north"], THIRD, "solid"))
    for k in reversed(range(len(seen.names))):
        path = seen.path(k)
        dash = "dot" if moved and e is not None else "solid"
        lines.append((seen.names[k], path["east"], path["north"], (FIRST, SECOND)[k], dash))
    marks = detail.marks(seen, seen.path(0)) if moved else []  # else time stands beside it
    blocks: list[Block] = []
    caption = "East and north of the start. "
    if moved:
        caption += f"Shaded: two standard deviations {seen.by_what}, about the path."
        centres = detail.spread(seen, ELLIPSES, about_path=True)
    else:
        caption += "It stood still: what is drawn is error. Shaded: where 86 % of all runs end "
        caption += f"{seen.by_what}."
        centres = detail.spread(seen, 1, about_path=False)
    beside: list[Block] = []
    if e is not None and np.isfinite(e["east"]).any():
        beside = [_error_map(seen) if moved else _over_time(seen)]
    share = 50 if beside else 100
    blocks.append(figures.paths(lines, centres, marks, caption, share=share,
                                predicted=seen.predicted))  # fmt: skip
    blocks += beside
    blocks.append(Facts(detail.numbers_of(seen)))
    lead = "The path that the readings give"
    lead += ", beside the reference." if moved and e is not None else "."
    return Section("Where it went", lead, blocks)


def _error_map(seen: Seen) -> Figure:
    """Error east and north, with the ellipses that were predicted."""
    e = seen.errors
    assert e is not None
    lines = [
        (seen.names[k], e[f"{before}east"], e[f"{before}north"], (FIRST, SECOND)[k], "solid")
        for k, before in reversed(list(enumerate(("", "without_")[: len(seen.names)])))
        if f"{before}east" in e
    ]
    centres = detail.spread(seen, 1, about_path=False)
    caption = f"Estimate minus reference. Shaded: where 86 % of all runs end {seen.by_what}."
    return figures.paths(lines, centres, [], caption, share=50, what="error ",
                         predicted=seen.predicted)  # fmt: skip


def _over_time(seen: Seen) -> Figure:
    """Horizontal error against time."""
    e = seen.errors
    assert e is not None
    lines = [
        (name, np.hypot(e[f"{before}east"], e[f"{before}north"]), (FIRST, SECOND)[k])
        for k, (name, before) in enumerate(zip(seen.names, ("", "without_"), strict=False))
        if f"{before}east" in e
    ]
    return figures.growth(e["age"], lines[::-1], (seen.predicted, detail.half(e)), share=50)


def _growth(seen: Seen) -> Section | None:
    """The error against time, with and without the calibration, beside what was predicted."""
    e = seen.errors
    if e is None:
        return None
    unit = figures.time_unit(float(e["age"][-1]))
    blocks: list[Block] = []
    if np.isfinite(e["east"]).any() and not seen.still:  # else it stands beside the map
        blocks += [_over_time(seen), detail.growth_figure(seen, unit, share=50)]
    blocks += detail.error_panels(seen, unit)
    blocks.append(_table(seen))
    lead = (
        "Estimate minus reference. The bands are what noise, alignment and the uncertainty of the "
        "calibration let expect."
    )
    if not seen.calibrated:
        lead = "Estimate minus reference. The bands hold noise and alignment only: errors of the "
        lead += "sensors are not calibrated, and nothing is known of their size."
    return Section("Growth of the error", lead, blocks)


def _table(seen: Seen) -> Table:
    """Errors at some ages."""
    free = seen.about["settings"]["vertical"] == "free"
    columns = [
        (Column("after", "short"), [minutes(row["age"]) for row in seen.growth(0)]),
        (Column("horizontal [m]", "number"), _cells(seen, 0, "horizontal")),
        (Column("without calibration [m]", "number"), _cells(seen, 1, "horizontal")),
        (Column(f"{seen.predicted}, half of all runs [m]", "number"),
         [detail.number(detail.half_at(seen, row["age"])) for row in seen.growth(0)]),
        (Column("vertical [m]", "number", aside=True),
         _cells(seen, 0, "vertical") if free else []),
        (Column("velocity [m/s]", "number"), _cells(seen, 0, "velocity")),
        (Column("heading [arcmin]", "number", aside=True),
         _cells(seen, 0, "heading", 60 * float(np.degrees(1.0)))),
    ]  # fmt: skip
    shown = [(column, cells) for column, cells in columns if any(cells)]
    rows = zip(*(cells for _, cells in shown), strict=True)
    return Table([column for column, _ in shown], [list(row) for row in rows])


def _cells(seen: Seen, run: int, key: str, size: float = 1.0) -> list[str]:
    """Return a column of errors of a run at the ages of the first, empty where not known."""
    known = {row["age"]: row[key] for row in seen.growth(run)}
    values = [known.get(row["age"]) for row in seen.growth(0)]
    return [detail.number(None if v is None else size * v) for v in values]
