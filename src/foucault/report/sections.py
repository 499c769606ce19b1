"""What the report says: one function per section, each skipped where it has nothing to show.

A procedure gets a section by filling its table; a new kind of section is one function more in
`SECTIONS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.errors import ADVICE, Status
from foucault.report import certificate as certificates
from foucault.report import (
    on_table,
    systematic,
    systematic_choice,
    temperature,
    transfer,
    transfer_delay,
    transfer_run,
    tumble,
)
from foucault.report.application import how_to_apply
from foucault.report.certificate import certificate
from foucault.report.evidence import detection, held_out, norms, orientations, residuals
from foucault.report.headings import headings
from foucault.report.merged import merged
from foucault.report.page import Column, Items, Section, Table
from foucault.report.rate_table import rate_steps
from foucault.report.uncertainty import budget, coefficients, correlation, unseen
from foucault.result import Check, Level, Result

STATES = {Level.PASS: "good", Level.DOUBTFUL: "warning", Level.UNUSABLE: "bad"}
WORDS = {Level.PASS: "Pass", Level.DOUBTFUL: "Doubtful", Level.UNUSABLE: "Unusable"}


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
    if result.status is not Status.CONVERGED and ADVICE[result.status] not in reasons:
        reasons.append(ADVICE[result.status])
    level = result.verdict.level
    title = f"Calibration of {' '.join(names)}" if names else "Calibration"
    return Heading(title, _line(result), STATES[level], WORDS[level], reasons)


def _line(result: Result) -> list[str]:
    """Procedure, place and date in a few words."""
    line = [result.procedure, certificates.place(result.site)]
    created = result.provenance.get("created")
    line.append(certificates.date(str(created)) if created else "")
    return [part for part in line if part]


def sections(result: Result) -> list[Section]:
    """Return the sections that `result` has something to show in."""
    return [section for make in SECTIONS if (section := make(result)) is not None]


def checks(result: Result) -> Section | None:
    """Every test that the verdict rests on."""
    if not result.checks:
        return None
    return Section("Checks", "Every test that the verdict rests on.", [check_table(result.checks)])


def check_table(checks: tuple[Check, ...]) -> Table:
    """Return checks with their limits, one row each."""
    columns = [
        Column("", "state"),
        Column("check"),
        Column("value", "number", aside=True),
        Column("limits", "number", aside=True),
        Column("what it says"),
    ]
    rows = [
        [
            "good" if c.passed else STATES[c.fails],
            c.name,
            "" if np.isnan(c.value) else _number(c.value),
            _limits(c.low, c.high),
            c.sentence,
        ]
        for c in checks
    ]
    return Table(columns, rows)


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{_number(low)} to {_number(high)}"
    if low is not None:
        return f"≥ {_number(low)}"
    return f"≤ {_number(high)}" if high is not None else ""


def _number(value: float) -> str:
    text = f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"
    return text.replace("-", "−")


def findings(result: Result) -> Section | None:
    """What was noticed in the data."""
    if not result.findings:
        return None
    looks = {"warning": "warning", "error": "bad"}
    items = [(looks.get(f.severity, "plain"), f"{f.message} {f.cure}") for f in result.findings]
    return Section("Findings", "Noticed in the data; the work went on.", [Items(items)])


def provenance(result: Result) -> Section | None:
    """What the result was made from and with; what the certificate says is not said again."""
    facts = result.provenance
    inputs = [*facts.get("inputs", []), *([facts["input"]] if facts.get("input") else [])]
    rest = {k: v for k, v in facts.items() if k not in ("inputs", "input", "versions", "created")}
    rows = [
        *[[k, words(v)] for k, v in result.instrument.items() if k not in certificates.KNOWN],
        *[[f"input {k}", words(v)] for one in inputs for k, v in one.items()],
        *[[k, words(v)] for k, v in rest.items()],
        ["versions", words(facts["versions"])] if facts.get("versions") else [],
        ["status", result.status.value],
    ]
    columns = [Column("what"), Column("value", "long")]
    return Section("Provenance", "", [Table(columns, [row for row in rows if row])])


def words(value: Any) -> str:
    """Write a plain JSON value for people."""
    if isinstance(value, dict):
        return "; ".join(f"{k} {words(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(words(v) for v in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "unknown" if value is None else str(value)


SECTIONS: tuple[Callable[[Result], Section | None], ...] = (
    certificate,
    tumble.alignment,
    temperature.functions,
    temperature.left_out,
    coefficients,
    merged,
    systematic_choice.deflection,
    systematic.velocities,
    systematic.navigation,
    systematic.sequence,
    transfer_run.mounting,
    transfer.done,
    transfer_delay.delay,
    transfer_delay.ignored,
    transfer.estimates,
    transfer.motion,
    transfer_run.innovations,
    transfer_run.bound,
    transfer_run.attitude,
    transfer_run.handed,
    norms,
    on_table.norms,
    rate_steps,
    headings,
    residuals,
    on_table.residuals,
    orientations,
    on_table.orientations,
    on_table.control,
    on_table.rig,
    tumble.motion,
    tumble.observability,
    tumble.course,
    tumble.residuals,
    tumble.sensitivity,
    unseen,
    budget,
    correlation,
    held_out,
    detection,
    findings,
    checks,
    how_to_apply,
    provenance,
)
"""The sections of the report, in order."""
