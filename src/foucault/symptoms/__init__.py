"""What can go wrong and what helps: the one table of all errors, warnings and notes.

A file for the first word of each code, a row for the rest of it: ``[kind]`` in `allan.toml` is
``allan.kind``. Message and cure are `str.format` templates. An "error" stops the work; a "warning"
or a "note" is reported and the work goes on. Of the warnings those with a `doubt` lower a pass: the
numbers may be wrong beyond their uncertainty, and the doubt says why; the others are `advice`. The
documentation prints the table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path


@dataclass(frozen=True)
class Symptom:
    """One row of the table: what the user sees and what helps."""

    code: str
    severity: str
    symptom: str
    message: str
    cure: str
    doubt: str = ""  # of a warning that lowers a pass: why the numbers may be wrong
    advice: bool = False  # a warning that does not


_HERE = Path(__file__).parent


@cache
def _rows(word: str) -> dict[str, Symptom]:
    """Return the rows whose code begins with a word: no command needs them all."""
    file = _HERE / f"{word}.toml"
    if not (word.isidentifier() and file.is_file()):
        return {}
    rows = tomllib.loads(file.read_text(encoding="utf-8"))
    return {f"{word}.{rest}": Symptom(f"{word}.{rest}", **row) for rest, row in rows.items()}


class _Table(Mapping[str, Symptom]):
    def __getitem__(self, code: str) -> Symptom:
        return _rows(code.partition(".")[0])[code]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(c for file in _HERE.glob("*.toml") for c in _rows(file.stem)))

    def __len__(self) -> int:
        return sum(1 for _ in self)


SYMPTOMS: Mapping[str, Symptom] = _Table()
"""Code -> row, in order of the codes."""


def doubtful(code: str) -> bool:
    """Return whether a finding of `code` lowers a pass; one of an older program may be unknown."""
    row = SYMPTOMS.get(code)
    return row is not None and bool(row.doubt)


def markdown() -> str:
    """Return the table for the documentation."""
    lines = ["| symptom | | message | what to do |", "|---|---|---|---|"]
    for row in SYMPTOMS.values():
        cells = (row.symptom, f"{row.severity} `{row.code}`", row.message, row.cure)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)
