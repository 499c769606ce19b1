"""What the report says: one function per section, each skipped where it has nothing to show.

A procedure gets a section by filling its table; a new kind of section is one function more in
`SECTIONS`.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.coefficients import CoefficientVector, format_value
from foucault.errors import ADVICE, Status
from foucault.report import figures, orientation
from foucault.report.page import Block, Code, Column, Items, Section, Table, Text
from foucault.result import Level, Result

FloatArray = npt.NDArray[np.float64]

STATES = {Level.PASS: "good", Level.DOUBTFUL: "warning", Level.UNUSABLE: "bad"}
WORDS = {Level.PASS: "Pass", Level.DOUBTFUL: "Doubtful", Level.UNUSABLE: "Unusable"}
TRIADS = {"accel": "Accelerometers", "gyro": "Gyros"}
RESIDUAL_LIMIT = 3.0  # guide line; one normal residual in 370 lies outside


@dataclass(frozen=True)
class Heading:
    """The top of the page: what was calibrated, and the verdict."""

    title: str
    line: list[str]
    state: str
    word: str
    reasons: list[str]


def heading(result: Result) -> Heading:
    """Return the top of the page."""
    names = [str(result.instrument[k]) for k in ("name", "serial") if result.instrument.get(k)]
    reasons = list(result.verdict.reasons)
    if not reasons and result.checks:
        reasons = [f"All {len(result.checks)} checks passed."]
    if result.status is not Status.CONVERGED:
        reasons.append(ADVICE[result.status])
    level = result.verdict.level
    title = f"Calibration of {' '.join(names)}" if names else "Calibration"
    return Heading(title, _line(result), STATES[level], WORDS[level], reasons)


def _line(result: Result) -> list[str]:
    """Procedure, place and date in a few words."""
    site = result.site
    line = [result.procedure]
    if site.get("latitude") is not None:
        degrees = float(np.rad2deg(site["latitude"]))
        line.append(f"{abs(degrees):.4f}° {'N' if degrees >= 0 else 'S'}")
    if site.get("height"):
        line.append(f"{site['height']:.0f} m")
    if site.get("gravity") is not None:
        source = f" ({site['gravity_source']})" if site.get("gravity_source") else ""
        line.append(f"g = {site['gravity']:.5f} m/s²{source}")
    created = result.provenance.get("created")
    return [*line, _date(created)] if created else line


def _date(text: str) -> str:
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{moment.day} {moment:%B %Y, %H:%M}"


def sections(result: Result) -> list[Section]:
    """Return the sections that `result` has something to show in."""
    return [section for make in SECTIONS if (section := make(result)) is not None]


def coefficients(result: Result) -> Section | None:
    """Every coefficient with its standard deviation."""
    vector = result.coefficients
    if not len(vector):
        return None
    prior = bool(np.isfinite(vector.prior_sd).any())
    columns = [
        Column("coefficient", "name"),
        Column("", "symbol", aside=True),
        Column("value", "number"),
        Column("± sd", "number"),
        Column("unit"),
        *([Column("prior sd", "number", aside=True)] if prior else []),
        Column("meaning", aside=True),
    ]
    rows: list[list[str]] = []
    for head in dict.fromkeys(name.partition(".")[0] for name in vector.names):
        rows += [[TRIADS.get(head, head)], *_coefficient_rows(vector[head], prior)]
    lead = f"Value and standard deviation (1 sigma). Axes: {result.frame}; {result.gauge}."
    return Section("Coefficients", lead, [Table(columns, rows)])


def _coefficient_rows(vector: CoefficientVector, prior: bool) -> list[list[str]]:
    """Return name, symbol, value, sd, unit, prior sd where there is one, and meaning."""
    out = []
    for row in vector.rows():
        unit, sd = row["display_unit"], row["display_sd"]
        shown = "" if sd is None else format_value(sd, sd)
        value = row["display_value"]
        known = format_value(value, sd) if np.isfinite(value) else "unknown"
        cells = [row["name"], row["symbol"], known]
        cells += [shown if row["free"] else "held", unit]
        if prior:
            before = (row["prior_sd"] or 0.0) / units.factor(unit, row["kind"])
            cells.append(format_value(before, before) if before else "")
        out.append([*cells, row["meaning"]])
    return out


def norms(result: Result) -> Section | None:
    """Specific force of every rest against local gravity, before and after."""
    rests = result.tables.get("rests")
    gravity = result.diagnostics.get("gravity", result.site.get("gravity"))
    if rests is None or gravity is None:
        return None
    before, after = rests["norm_before"] - gravity, rests["norm_after"] - gravity
    sd = rests["norm_sd"]
    before_unit, size_before = _unit("specific force", before)
    after_unit, size_after = _unit("specific force", np.concatenate([after, sd]))
    figure = figures.before_after(
        _count(rests),
        before / size_before,
        after / size_after,
        sd / size_after,
        (before_unit, after_unit),
    )
    lead = (
        "At rest the specific force must have the size of local gravity, whatever the "
        "orientation. Error of its norm, per rest; note the two scales."
    )
    return Section("Specific force before and after", lead, [figure])


def residuals(result: Result) -> Section | None:
    """Standardized residuals per rest and per turn."""
    limits = result.diagnostics.get("residual_limit") or {}
    blocks: list[Block] = []
    for name, what, triad in (("rests", "rest", "accel"), ("turns", "turn", "gyro")):
        table = result.tables.get(name)
        if table is not None:
            limit = float(limits.get(triad, RESIDUAL_LIMIT))
            size, weight = table["residual"], table["weight"]
            blocks.append(figures.residuals(_count(table), size, weight, what, limit))
    if not blocks:
        return None
    lead = (
        "What the model leaves unexplained, in units of the standard deviation it should have: "
        f"accelerometers per rest, gyros per turn. Dashed: {RESIDUAL_LIMIT:.0f} sd; a single "
        "point a little beyond is no cause for alarm."
    )
    if limits:
        lead = lead.replace(f"{RESIDUAL_LIMIT:.0f} sd; a single", "limit; a single")
    chi = result.diagnostics.get("chi_square", {})
    found = [_chi_square(TRIADS[k], chi[k]) for k in TRIADS if chi.get(k)]
    return Section("Residuals", lead, [*blocks, *([Items(found)] if found else [])])


def _chi_square(what: str, row: list[float]) -> tuple[str, str]:
    value, low, high, dof = row
    fits = low <= value <= high
    word = "inside" if fits else "outside"
    text = f"{what}: chi-square {value:.3g}, {word} {low:.3g} to {high:.3g} ({dof:.0f} degrees "
    return ("good" if fits else "warning", text + "of freedom).")


def orientations(result: Result) -> Section | None:
    """Where up pointed, and which directions are missing."""
    rests = result.tables.get("rests")
    if rests is None or "up_x" not in rests:
        return None
    up = np.column_stack([rests[f"up_{a}"] for a in "xyz"]).astype(float)
    coverage = result.diagnostics.get("coverage", {})
    gaps = coverage.get("missing") or []
    missing = np.array([g["direction"] for g in gaps], float).reshape(-1, 3)
    words = [str(g.get("words", "missing")) for g in gaps]
    lead = "Direction of up in body axes, one point per rest."
    if coverage.get("largest_gap") is not None:
        gap = np.rad2deg(coverage["largest_gap"])
        lead += f" The direction farthest from any rest is {gap:.0f}° away."
    blocks: list[Block] = [
        orientation.sphere(up, missing),
        orientation.flat_map(up, missing, words),
    ]
    if words:
        blocks.append(Items([("warning", f"Missing: {w}.") for w in words]))
    return Section("Orientations visited", lead, blocks)


def detection(result: Result) -> Section | None:
    """Where the log was at rest."""
    table = result.tables.get("detection")
    if table is None:
        return None
    facts = result.diagnostics.get("detection", {})
    rests = result.tables.get("rests", {})
    ends = zip(rests.get("start", ()), rests.get("end", ()), strict=True)
    spans = [(float(a), float(b)) for a, b in ends if np.isfinite(a + b)]
    lead = "Moving standard deviation over its value at rest. Shaded: rests used."
    if facts.get("threshold") is not None:
        lead += f" Dashed: threshold {facts['threshold']:.3g}, chosen from the data."
    if facts.get("rests") is not None and facts.get("rest_time") is not None:
        lead += f" {facts['rests']} rests, {facts['rest_time']:.0f} s in all."
    return Section(
        "Detection of rests", lead, [figures.detection(table, facts.get("threshold"), spans)]
    )


def held_out(result: Result) -> Section | None:
    """How well rests are predicted that were not used."""
    rests = result.tables.get("rests")
    if rests is None or not np.isfinite(rests.get("held_out", np.array([np.nan]))).any():
        return None
    known = np.isfinite(rests["held_out"])
    error, sd = rests["held_out"][known], rests["held_out_sd"][known]
    unit, size = _unit("specific force", np.concatenate([error, sd]))
    figure = figures.held_out(_count(rests)[known], error / size, sd / size, unit)
    lead = (
        "Each rest predicted from all the others: error of its norm with ±2 sd. About 19 of 20 "
        "bars should reach zero."
    )
    return Section("Rests left out and predicted", lead, [figure])


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


def checks(result: Result) -> Section | None:
    """Every test that the verdict rests on."""
    if not result.checks:
        return None
    columns = [
        Column("", "state"),
        Column("check"),
        Column("value", "number"),
        Column("limits", "number", aside=True),
        Column("what it says"),
    ]
    rows = [
        [
            "good" if c.passed else STATES[c.fails],
            c.name,
            "" if np.isnan(c.value) else f"{c.value:.4g}",
            _limits(c.low, c.high),
            c.sentence,
        ]
        for c in result.checks
    ]
    return Section("Checks", "", [Table(columns, rows)])


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{low:.4g} to {high:.4g}"
    if low is not None:
        return f"≥ {low:.4g}"
    return f"≤ {high:.4g}" if high is not None else ""


def findings(result: Result) -> Section | None:
    """What was noticed in the data."""
    if not result.findings:
        return None
    looks = {"warning": "warning", "error": "bad"}
    items = [(looks.get(f.severity, "plain"), f"{f.message} {f.cure}") for f in result.findings]
    return Section("Findings", "Noticed in the data; the work went on.", [Items(items)])


def how_to_apply(result: Result) -> Section | None:
    """Equation, command and a few lines of Python."""
    snippet = (
        "import foucault\n\n"
        'result = foucault.load_result("result.json")\n'
        "print(result.verdict.level, result.coefficients, sep='\\n')\n"
        "# accel [m/s^2] and gyro [rad/s]: readings, each with shape (n, 3)\n"
        "f_b, w_ib_b = result.model.compensate(accel, gyro)"
    )
    equation = result.equation.replace(";  ", "\n").replace("; ", "\n")
    blocks: list[Block] = [
        Code(equation),
        Text("On the command line, from the run folder:"),
        Code("foucault apply result.json LOG -o compensated.parquet"),
        Text("In Python:"),
        Code(snippet),
    ]
    return Section("How to apply it", "The instrument says, for what is true:", blocks)


def provenance(result: Result) -> Section | None:
    """What the result was made from and with."""
    facts = result.provenance
    rows = [
        *[[k, _words(v)] for k, v in result.instrument.items()],
        *[[f"valid for {k}", _words(v)] for k, v in result.validity.items()],
        *[["input", _words(one)] for one in facts.get("inputs", [])],
        *[[k, _words(v)] for k, v in facts.items() if k not in ("inputs", "versions")],
        *[[k, str(v)] for k, v in facts.get("versions", {}).items()],
        ["status", result.status.value],
    ]
    return Section("Provenance", "", [Table([Column("what"), Column("value", "long")], rows)])


def _words(value: Any) -> str:
    """Write a plain JSON value for people."""
    if isinstance(value, dict):
        return ", ".join(f"{k}: {_words(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(_words(v) for v in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "unknown" if value is None else str(value)


def _unit(kind: str, values: FloatArray) -> tuple[str, float]:
    """Return the unit to show `values` [SI] in, and its SI value."""
    finite = np.abs(values[np.isfinite(values)])
    unit = units.display_unit(kind, float(finite.max(initial=0.0)))
    return unit, units.factor(unit, kind)


def _count(table: Any) -> npt.NDArray[np.int64]:
    """Return 1, 2, ... for the rows of `table`."""
    return np.arange(1, len(next(iter(table.values()))) + 1)


SECTIONS: tuple[Callable[[Result], Section | None], ...] = (
    coefficients,
    norms,
    residuals,
    orientations,
    detection,
    held_out,
    correlation,
    checks,
    findings,
    how_to_apply,
    provenance,
)
"""The sections of the report, in order."""
