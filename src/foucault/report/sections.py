"""What the report says: one function per section, each skipped where it has nothing to show.

A procedure gets a section by filling its table; a new kind of section is one function more in
`SECTIONS`.
"""

from __future__ import annotations

from collections.abc import Callable

from foucault.errors import ADVICE, Status
from foucault.report import certificate as certificates
from foucault.report import (
    ends,
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
from foucault.report.ends import STATES, WORDS, Heading, check_table, words
from foucault.report.evidence import detection, held_out, norms, orientations, residuals
from foucault.report.headings import headings
from foucault.report.merged import merged
from foucault.report.page import Section
from foucault.report.rate_table import rate_steps
from foucault.report.uncertainty import budget, coefficients, correlation, unseen
from foucault.result import Result


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
    title += " over temperature" if result.temperature is not None else ""
    return Heading(title, _line(result), STATES[level], WORDS[level], reasons)


def _line(result: Result) -> list[str]:
    """Procedure, place and date in a few words."""
    table = result.tables.get("merged")
    some = 0 if table is None else len(set(table["result"].tolist())) - 1
    line = [result.procedure, f"{some} results merged" if some else ""]
    line.append(certificates.place(result.site))
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


def findings(result: Result) -> Section | None:
    """What was noticed in the data."""
    return ends.findings(result.findings)


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
    return ends.provenance(row for row in rows if row)


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
