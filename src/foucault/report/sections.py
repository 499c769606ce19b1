"""What the report says: one function per section, each skipped where it has nothing to show.

A procedure gets a section by filling its table; a new kind of section is one row more in
`SECTIONS`.
"""

from __future__ import annotations

from importlib import import_module

from foucault.errors import ADVICE, Status
from foucault.report import certificate as certificates
from foucault.report import ends
from foucault.report.ends import STATES, WORDS, Heading, check_table, words
from foucault.report.page import Section
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
    has = {"", *result.tables, *result.diagnostics}
    made = [_made(place, result) for place, shown in SECTIONS if shown in has]
    return [section for section in made if section is not None]


def _made(place: str, result: Result) -> Section | None:
    module, _, name = place.rpartition(".")
    section: Section | None = getattr(import_module(f"foucault.report.{module}"), name)(result)
    return section


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


SECTIONS = (
    ("certificate.certificate", ""),
    ("tumble.alignment", "attitude"),
    ("temperature.functions", "temperature_curves"),
    ("temperature.left_out", "temperature_points"),
    ("uncertainty.coefficients", ""),
    ("merged.merged", "merged"),
    ("systematic_choice.deflection", "choice"),
    ("systematic.velocities", "velocities"),
    ("systematic.navigation", "navigation"),
    ("systematic.sequence", "sequence"),
    ("transfer_run.mounting", "mounting"),
    ("transfer.done", "filter"),
    ("transfer_delay.delay", "filter"),
    ("transfer_delay.ignored", "undelayed"),
    ("transfer.estimates", "estimates"),
    ("transfer.motion", "stretches"),
    ("transfer_run.innovations", "innovations"),
    ("transfer_run.bound", "gamma"),
    ("transfer_run.attitude", "smoothed"),
    ("transfer_run.handed", "hand_over"),
    ("evidence.norms", "rests"),
    ("on_table.norms", "readings"),
    ("rate_table.rate_steps", "rate_steps"),
    ("headings.headings", "headings"),
    ("evidence.residuals", "rests"),
    ("on_table.residuals", "readings"),
    ("evidence.orientations", "rests"),
    ("on_table.orientations", "readings"),
    ("on_table.control", "readings"),
    ("on_table.rig", "rig"),
    ("tumble.motion", "path"),
    ("tumble.observability", "observability"),
    ("tumble.course", "course"),
    ("tumble.residuals", "residuals"),
    ("tumble.sensitivity", "sensitivity"),
    ("uncertainty.unseen", ""),
    ("uncertainty.budget", "budget"),
    ("uncertainty.correlation", ""),
    ("evidence.held_out", "rests"),
    ("evidence.detection", "detection"),
    ("sections.findings", ""),
    ("sections.checks", ""),
    ("application.how_to_apply", ""),
    ("sections.provenance", ""),
)
"""The sections of the report, in order: function, and the table or diagnostic that it shows; what a
result does not have is not loaded."""
