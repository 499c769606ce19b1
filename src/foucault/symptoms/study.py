"""Rows of the table about Monte Carlo studies."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("study.other", "error",
     "A study folder of another campaign, seed or version",
     "'{folder}' holds another study: {what} is not what this one has.",
     "Give another folder with -o, or remove this one if it is no longer needed."),
    ("study.missing", "error",
     "A folder that holds no finished study",
     "'{folder}' holds no finished study.",
     "Run `foucault montecarlo CAMPAIGN -n TRIALS -o FOLDER`; an interrupted study goes on."),
)
# fmt: on
