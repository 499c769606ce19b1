"""What people do wrong and what is said: asserted by tests/contracts/test_input_guard.py."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from foucault.symptoms import SYMPTOMS

GUARD = Path(__file__).parents[1] / "guard.toml"


def page() -> str:
    said = tomllib.loads(GUARD.read_text(encoding="utf-8"))
    columns = said["columns"]
    lines = [
        "# What is noticed, and what cannot be",
        "",
        "Every row is a mistake that people make, every column a procedure or a command. Each cell "
        "is tried by a test, with a session of the procedure in which the mistake is made: "
        "**error**, the work ends with a message; *warning*, it is told; *fails*, it is told and "
        "the verdict does not pass; same, it does no harm; **?**, no reading shows it, and the "
        "sections below say why; -, there is nothing to do wrong. `hand_rotated_published` reads "
        "as `hand_rotated`, `multi_position` as `turntable`.",
        "",
        "| mistake | " + " | ".join(f"[{c}](#{c})" for c in columns) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    for key, words in said["mistakes"].items():
        cells = " | ".join(_kind(cells.get(key, "")) for cells in columns.values())
        lines.append(f"| {words} | {cells} |")
    for column, cells in columns.items():
        lines += ["", f"## {column}", "", "| mistake | what is said |", "|---|---|"]
        lines += [f"| {said['mistakes'][k]} | {_told(v, said)} |" for k, v in cells.items()]
    return "\n".join(lines) + "\n"


def _kind(cell: str) -> str:
    """Return what a cell comes to, in a word."""
    if not cell or ": " in cell:
        return {"": "-", "same": "same", "untold": "**?**"}[cell.partition(": ")[0]]
    if "fails" in cell.split():
        return "*fails*"
    code, *how = cell.split()
    ends = "stops" in how or (SYMPTOMS[code].severity == "error" and "told" not in how)
    return "**error**" if ends else "*warning*"


def _told(cell: str, said: dict[str, Any]) -> str:
    """Return a cell in full: the codes of its messages, or the reason why there is none."""
    kind, is_reason, reason = cell.partition(": ")
    if is_reason:
        return ("No harm: " if kind == "same" else "Cannot be told: ") + said["reasons"][reason]
    codes = [word for word in cell.split() if word in SYMPTOMS]
    words = ", ".join(f"[`{code}`](#{code})" for code in codes)
    failing = "the verdict does not pass"
    return words if "fails" not in cell.split() else f"{words}; {failing}" if words else failing
