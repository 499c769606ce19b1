"""How every report begins and ends: the verdict, what was noticed, checks, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.errors import Finding
from foucault.report.page import Column, Items, Section, Table
from foucault.result import Check, Level

STATES = {Level.PASS: "good", Level.DOUBTFUL: "warning", Level.UNUSABLE: "bad"}
WORDS = {Level.PASS: "Pass", Level.DOUBTFUL: "Doubtful", Level.UNUSABLE: "Unusable"}

_LOOKS = {"warning": "warning", "error": "bad"}


@dataclass(frozen=True)
class Heading:
    """The top of the page: what was done, and the verdict."""

    title: str
    line: list[str]
    state: str
    word: str
    reasons: list[str]


def findings(
    noticed: Iterable[Finding | Mapping[str, str]], where: str = "data", title: str = "Findings"
) -> Section | None:
    """Return what was noticed, each with its cure."""
    items = []
    for one in noticed:
        said = one.as_dict() if isinstance(one, Finding) else one
        items.append((_LOOKS.get(said["severity"], "plain"), f"{said['message']} {said['cure']}"))
    lead = f"Noticed in the {where}; the work went on."
    return Section(title, lead, [Items(items)]) if items else None


def provenance(rows: Iterable[Sequence[str]]) -> Section:
    """Return what a report was made from and with, without what is not known."""
    known = [[what, value] for what, value in rows if value]
    return Section("Provenance", "", [Table([Column("what"), Column("value", "long")], known)])


def check_table(checks: Iterable[Check]) -> Table:
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


def words(value: Any) -> str:
    """Write a plain JSON value for people."""
    if isinstance(value, Mapping):
        return "; ".join(f"{k} {words(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(words(v) for v in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "unknown" if value is None else str(value)


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{_number(low)} to {_number(high)}"
    if low is not None:
        return f"≥ {_number(low)}"
    return f"≤ {_number(high)}" if high is not None else ""


def _number(value: float) -> str:
    text = f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"
    return text.replace("-", "−")
