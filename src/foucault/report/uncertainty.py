"""How sure the coefficients are: values, bound, budget, correlation, and what was not seen."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, format_value
from foucault.report import figures
from foucault.report.page import Block, Column, Items, Section, Table
from foucault.result import Result
from foucault.units import ZERO_CELSIUS

TRIADS = {
    "accel": "Accelerometers", "gyro": "Gyros", "attitude": "Attitude",
    "installation": "Installation", "master": "Messages of the master",
    "load": "Installation under load",
}  # fmt: skip
COVERAGE = 2.0  # coverage factor of the expanded uncertainty: about 95 % (JCGM 100:2008, 6.2)
NOTHING_ADDED = 0.9  # of the prior sd: the data hardly added to what was known


def coefficients(result: Result) -> Section | None:
    """Every coefficient with its uncertainty, beside the prior and the bound."""
    vector = result.coefficients
    if not len(vector):
        return None
    prior = bool(np.isfinite(vector.prior_sd).any())
    bound = _bound(result)
    seconds = result.in_seconds.sd if result.clock is not None else None
    columns = [
        Column("coefficient", "name"),
        Column("symbol", "symbol", aside=True),
        Column("value", "number"),
        Column("± sd", "number"),
        Column("± U (k=2)", "number", optional=True),
        *([Column("± sd in seconds", "number")] if seconds is not None else []),
        Column("unit", "short"),
        *([Column("prior sd", "number")] if prior else []),
        *([Column("sd / bound", "number")] if bound is not None else []),
        Column("meaning", "meaning"),
    ]
    rows: list[list[str]] = []
    start = 0
    for head in dict.fromkeys(name.partition(".")[0] for name in vector.names):
        part = vector[head]
        limit = None if bound is None else bound[start : start + len(part)]
        timed = None if seconds is None else seconds[start : start + len(part)]
        rows += [[TRIADS.get(head, head)], *_coefficient_rows(part, prior, limit, timed)]
        start += len(part)
    lead = f"Value and standard deviation (1 sigma). Axes: {result.frame}; {result.gauge}."
    if result.temperature is not None:
        at = f"{result.temperature.reference - ZERO_CELSIUS:.1f}".replace("-", "−")
        lead = f"At {at}\N{NO-BREAK SPACE}°C. {lead}"
    if seconds is not None:
        lead += (
            " sd is in the log's own time: that for whoever integrates with the same stamps. In "
            "seconds, as another clock counts them, the error of the log's clock comes to it."
        )
    if bound is not None:
        lead += (
            " sd / bound compares with the smallest uncertainty that the sensor noise alone "
            "would allow (Cramér-Rao)."
        )
        if prior:
            lead += " A prior can bring it below 1; what else is uncertain, such as gravity, above."
    option = "expanded uncertainty U = 2 sd, about 95 %"
    return Section("Coefficients", lead, [Table(columns, rows, option)])


def _bound(result: Result) -> FloatArray | None:
    """The Cramer-Rao bound, where there is one for every coefficient."""
    values = result.diagnostics.get("bound")
    if values is None or len(values) != len(result.coefficients):
        return None
    return np.array([np.nan if v is None else v for v in values], float)


def _coefficient_rows(
    vector: CoefficientVector, prior: bool, bound: FloatArray | None, seconds: FloatArray | None
) -> list[list[str]]:
    """Return the cells of each coefficient, in the order of the columns."""
    out = []
    for i, row in enumerate(vector.rows()):
        unit, sd = row["display_unit"], row["display_sd"]
        value = row["display_value"]
        known = _signed(format_value(value, sd)) if np.isfinite(value) else "unknown"
        free = row["free"]
        cells = [row["name"], row["symbol"], known]
        cells += [_size(sd) if free else "held", _size(COVERAGE * sd) if free and sd else ""]
        if seconds is not None:
            timed = float(seconds[i]) / units.factor(unit, row["kind"])
            cells.append(_size(timed) if free else "")
        cells.append(shown(unit))
        if prior:
            cells.append(_size((row["prior_sd"] or 0.0) / units.factor(unit, row["kind"])))
        if bound is not None:
            seen = free and row["sd"] is not None and bound[i] > 0
            cells.append(f"{row['sd'] / bound[i]:.2f}" if seen else "")
        out.append([*cells, row["meaning"]])
    return out


def shown(unit: str) -> str:
    """Write a unit with the signs that people use."""
    for plain, sign in (("ug", "µg"), ("us", "µs"), ("deg", "°"), ("percent", "%")):
        unit = re.sub(rf"\b{plain}\b", sign, unit)
    return unit.replace("^2", "²")


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _size(sd: float | None) -> str:
    """Write an uncertainty to its second digit; nothing where there is none."""
    return format_value(sd, sd) if sd and np.isfinite(sd) else ""


def unseen(result: Result) -> Section | None:
    """What the data could not tell, and what no data of this procedure can tell."""
    facts, vector = result.diagnostics, result.coefficients
    items = [("warning", f"Seen badly: {words}.") for words in facts.get("weakest") or []]
    gaps = (facts.get("coverage") or {}).get("missing") or []
    items += [("warning", f"No rest near: {gap.get('words', '')}.") for gap in gaps]
    weak = (
        vector.free & np.isfinite(vector.prior_sd) & (vector.sd > NOTHING_ADDED * vector.prior_sd)
    )
    if weak.any():
        names = ", ".join(f"`{n}`" for n, w in zip(vector.names, weak, strict=True) if w)
        items.append(("warning", f"Known hardly better than beforehand: {names}."))
    held = [f"`{n}`" for n, free in zip(vector.names, vector.free, strict=True) if not free]
    if held:
        items.append(("plain", f"Held at their values, not estimated: {', '.join(held)}."))
    items += [("plain", str(words)) for words in facts.get("unseen") or []]
    if not items:
        return None
    lead = "What these data could not tell, and what this procedure cannot tell in principle."
    return Section("What could not be seen", lead, [Items(items)])


# -- budget --------------------------------------------------------------------------------

CLOCK = "clock of the log"
_MEASURED = ("A", "scatter of the samples within the readings")
_LEFT = ("A", "scatter of the residuals")
_UNKNOWN = ("", "not known; it is part of the scatter")
_DECLARED = ("B", "noise as declared in the campaign")
_BASIS = {
    "scatter between rests": ("A", "scatter of the residuals beyond the noise"),
    "scatter between readings": ("A", "scatter of the residuals beyond the noise"),
    "jitter of the spin rate and unknown Earth rate": ("B", "rate_sd as given; heading unknown"),
    "errors of the table": ("B", "what the campaign says of the table"),
    "errors of the table and prior": ("B", "what the campaign says of table and coefficients"),
    "placement": ("B", "placement as given in the campaign"),
    "placement, estimated": ("A", "scatter of the residuals beyond the noise"),
    "unknown heading": ("B", "heading not given: the whole circle"),
    "unknown Earth rate": ("B", "latitude not given: any direction"),
    "rate jitter": ("B", "rate_sd as given, with the scatter that was found"),
    "rate of the table": ("B", "table_rate_sd as given; tilt of the outer axis"),
    "fixture": ("B", "fixture_sd as given in the campaign"),
    "parts of turns": ("B", "Earth rate across the axis that a part of a turn leaves"),
    "reference headings": ("B", "heading_sd as given"),
    "indexing": ("B", "index_sd as given"),
    "gyro drift": ("B", "slow noise and drift as given"),
    "tilt: drift": ("B", "slow noise as given"),
    "noise and prior": ("B", "white noise and prior as given or assumed"),
    "slow noise of accelerometers": ("B", "slow noise as given in the campaign"),
    "slow noise of gyros": ("B", "slow noise as given in the campaign"),
    "latitude": ("B", "standard uncertainty of the latitude"),
    "table, latitude and what was known before": ("B", "what the campaign says of them"),
    "prior": ("B", "prior as given in the campaign"),
    "local gravity": ("B", "standard uncertainty of local gravity"),
    CLOCK: ("B", "standard uncertainty of the log's clock; in seconds only"),
}
"""Source -> evaluation of type A (statistics) or B (other knowledge), and what it rests on.

Of results that do not say it themselves in `diagnostics.sources`: those of 1.0, and of procedures
that state no sources."""


SMALL_SHARE = 0.05
"""A source whose largest share is smaller has a row but no column of its own [percent]."""


def budget(result: Result) -> Section | None:
    """The variance of every coefficient split by source, as the GUM asks."""
    vector = result.coefficients
    given: Mapping[str, Any] = result.diagnostics.get("budget") or {}
    parts = {
        source: np.array([np.nan if v is None else v for v in variance], float)
        for source, variance in given.items()
        if len(variance) == len(vector)
    }
    if not parts:
        return None
    if result.clock is not None and (error := result.clock.of(vector.names)).any():
        parts[CLOCK] = error**2
    total = np.sum(list(parts.values()), axis=0)
    share = {s: 100 * v / np.where(total > 0, total, np.nan) for s, v in parts.items()}
    share = {s: v for s, v in share.items() if np.isfinite(v).any()}
    order = sorted(share, key=lambda s: -float(np.nanmean(share[s])))
    if not order:
        return None
    large = [s for s in order if float(np.nanmax(share[s])) >= SMALL_SHARE] or order
    symbols = [c.symbol for c in vector.layout.coefficients]
    lead = (
        "Where the variance of each coefficient comes from. Type A: evaluated from the scatter of "
        "these data; type B: from other knowledge."
    )
    if CLOCK in parts:
        lead += f" In seconds: without the {CLOCK} it is the variance in the log's own time."
    blocks: list[Block] = [
        figures.shares(symbols, {s: share[s] for s in large}),
        _sources(result, {s: share[s] for s in order}),
        _contributions(vector, {s: parts[s] for s in large}, total),
    ]
    return Section("Uncertainty budget", lead, blocks)


def _sources(result: Result, share: Mapping[str, FloatArray]) -> Table:
    """One row per source: type, basis, and its share of the variance."""
    noise = str((result.diagnostics.get("noise") or {}).get("source", ""))
    names = result.coefficients.names
    columns = [
        Column("source"),
        Column("type", "short"),
        Column("evaluated from", aside=True),
        Column("mean share", "number"),
        Column("largest share", "number"),
        Column("in"),
    ]
    rows = []
    stated = result.diagnostics.get("sources") or {}
    for source, values in share.items():
        kind, basis = stated.get(source) or _BASIS.get(source, ("", ""))
        if source not in stated and source.endswith(" noise"):
            known = _MEASURED if noise.startswith("measured") else _DECLARED
            known = _LEFT if noise.endswith("the residuals") else known
            kind, basis = _UNKNOWN if noise.startswith("unknown") else known
        worst = int(np.nanargmax(values))
        mean, most = (_percent(float(v)) for v in (np.nanmean(values), values[worst]))
        rows.append([source, kind, basis, mean, most, f"`{names[worst]}`"])
    return Table(columns, rows)


def _percent(value: float) -> str:
    return f"{value:.1f} %" if value >= 0.05 else "< 0.1 %"


def _contributions(
    vector: CoefficientVector, parts: Mapping[str, FloatArray], total: FloatArray
) -> Table:
    """Standard uncertainty that each source alone contributes to each coefficient."""
    columns = [
        Column("u of", "name"),
        *[Column(source, "number") for source in parts],
        Column("combined", "number"),
        Column("unit", "short"),
    ]
    rows = []
    for i, row in enumerate(vector.rows()):
        size = units.factor(row["display_unit"], row["kind"])
        combined = float(np.sqrt(total[i])) / size
        digits = 1 - int(np.floor(np.log10(combined))) if combined > 0 else 0
        cells = [*(float(np.sqrt(max(v[i], 0.0))) / size for v in parts.values()), combined]
        texts = [f"{u:.{max(0, min(digits, 9))}f}" for u in cells]
        kept = [text if float(text) else "–" for text in texts]
        rows.append([row["name"], *kept, shown(row["display_unit"])])
    return Table(columns, rows)


def correlation(result: Result) -> Section | None:
    """Which coefficients the data could not tell apart well."""
    vector = result.coefficients
    keep = np.flatnonzero(np.isfinite(vector.sd) & (vector.sd > 0))
    if vector.cov is None or keep.size < 2:
        return None
    sd = vector.sd[keep]
    symbols = [vector.layout.coefficients[i].symbol for i in keep]
    figure = figures.correlation(symbols, vector.cov[np.ix_(keep, keep)] / np.outer(sd, sd))
    lead = (
        "Strong colours off the diagonal: two coefficients that the data could not tell apart well."
    )
    return Section("Correlation", lead, [figure])
