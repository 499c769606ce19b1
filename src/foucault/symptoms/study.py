"""Rows of the table about Monte Carlo studies."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("study.other", "error",
     "A folder of trials of another campaign, seed or version",
     "'{folder}' holds another {kind}: {what} is not what this one has.",
     "Give another folder with -o, or remove this one if it is no longer needed."),
    ("study.damaged", "error",
     "A folder of trials that does not say what was asked",
     "'{folder}' holds finished parts of a {kind}, but {file} is missing or cannot be read.",
     "Restore {file}, give another folder with -o, or remove this one if it is no longer needed."),
    ("study.missing", "error",
     "A folder that holds no finished study",
     "'{folder}' holds no finished study.",
     "Run `foucault montecarlo CAMPAIGN -n TRIALS -o FOLDER`; an interrupted study goes on."),
)
# fmt: on
