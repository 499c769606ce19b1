"""What can go wrong and what helps: the one table of all errors, warnings and notes.

Rows are (code, severity, symptom, message, cure); message and cure are `str.format` templates.
An "error" stops the work; a "warning" or a "note" is reported and the work goes on. A procedure
that needs rows of its own adds a file here. The documentation prints the table.
"""

from __future__ import annotations

from dataclasses import dataclass

from foucault.symptoms import (
    alignment,
    allan,
    campaign,
    cluster,
    compare,
    deflection,
    delay,
    export,
    faces,
    fleet,
    h_infinity,
    logs,
    manoeuvres,
    master,
    merge,
    navigation,
    north,
    north_command,
    north_plan,
    north_search,
    north_seeking,
    observability,
    optimise,
    platform_tumble,
    preflight,
    program,
    rate_table,
    results,
    sequences,
    session,
    strapdown,
    study,
    systematic_procedure,
    temperature,
    torquing,
    transfer,
    turntable,
    watch,
)
from foucault.symptoms.doubts import ADVICE as ADVICE
from foucault.symptoms.doubts import DOUBTS as DOUBTS


@dataclass(frozen=True)
class Symptom:
    """One row of the table: what the user sees and what helps."""

    code: str
    severity: str
    symptom: str
    message: str
    cure: str


SYMPTOMS: dict[str, Symptom] = {
    row[0]: Symptom(*row)
    for row in sorted(
        (
            *alignment.ROWS,
            *allan.ROWS,
            *campaign.ROWS,
            *cluster.ROWS,
            *compare.ROWS,
            *deflection.ROWS,
            *delay.ROWS,
            *export.ROWS,
            *fleet.ROWS,
            *h_infinity.ROWS,
            *logs.ROWS,
            *manoeuvres.ROWS,
            *master.ROWS,
            *merge.ROWS,
            *navigation.ROWS,
            *north.ROWS,
            *north_command.ROWS,
            *north_plan.ROWS,
            *north_search.ROWS,
            *north_seeking.ROWS,
            *observability.ROWS,
            *optimise.ROWS,
            *results.ROWS,
            *sequences.ROWS,
            *session.ROWS,
            *strapdown.ROWS,
            *systematic_procedure.ROWS,
            *turntable.ROWS,
            *platform_tumble.ROWS,
            *preflight.ROWS,
            *program.ROWS,
            *rate_table.ROWS,
            *faces.ROWS,
            *watch.ROWS,
            *study.ROWS,
            *temperature.ROWS,
            *torquing.ROWS,
            *transfer.ROWS,
        )
    )
}
"""Code -> row."""


def markdown() -> str:
    """Return the table for the documentation."""
    lines = ["| symptom | | message | what to do |", "|---|---|---|---|"]
    for row in SYMPTOMS.values():
        cells = (row.symptom, f"{row.severity} `{row.code}`", row.message, row.cure)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)
