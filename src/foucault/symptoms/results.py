"""Rows of the table about result files and output."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("output.exists", "error",
     "A file to be written is there already",
     "'{path}' exists already and may hold your work.",
     "Choose another name with -o, or remove the file first."),
    ("result.missing", "error",
     "The result or run folder does not exist",
     "There is no '{path}'.",
     "Give a run folder or the result.json in it."),
    ("result.incomplete", "error",
     "A run folder without result.json",
     "'{folder}' holds no result.json: it is no run folder, or its run did not end.",
     "Give another folder, or run `foucault calibrate` again."),
    ("result.not_json", "error",
     "A result file that is not JSON",
     "'{file}' is not a result: {problem}.",
     "Give a result.json written by foucault; if it was edited, mend or restore it."),
    ("result.schema", "error",
     "A result written by another version of the format",
     "'{file}' {given}; this version of foucault reads '{allowed}'.",
     "Use the version of foucault that wrote it (see provenance.versions), or calibrate "
     "again."),
    ("result.invalid", "error",
     "A result with missing or wrong keys",
     "'{file}' is not a complete result: {problems}.",
     "Restore the file as it was written; docs/result.md lists the keys."),
    ("result.covariance", "error",
     "A result whose covariance is not symmetric or has a negative variance",
     "The covariance in '{file}' is not valid: {problem}.",
     "Restore the file as it was written, or calibrate again."),
    ("result.unknown", "error",
     "A result is used that has no number for some coefficients",
     "The result of {procedure} has no number for {names}.",
     "Calibrate again as the report advises; what is not known cannot be taken from a log."),
    ("result.singular", "error",
     "A result whose axes lie in a plane",
     "By the result of {procedure} the three {triad} axes lie in a plane: readings cannot be "
     "turned into what is true.",
     "Restore the file as it was written, or calibrate again."),
    ("result.table_missing", "error",
     "A table of the run folder is missing",
     "Table '{table}' of '{file}' is missing: there is no '{path}'.",
     "Copy the whole run folder, not result.json alone, or calibrate again."),
    ("result.table_changed", "error",
     "A table of the run folder was changed after the run",
     "Table '{table}' of '{file}' is not the one that was saved: the hash of '{path}' "
     "differs.",
     "Restore the run folder as it was written, or calibrate again."),
)
# fmt: on
