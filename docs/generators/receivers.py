"""The table of receivers for the page that answers which number goes in."""

from __future__ import annotations

from foucault.export.table import KINDS, TABLES, Row, receivers

FACTORS = {"rate": " rate^½", "correlation": " (T/2)^½"}


def formula(row: Row) -> str:
    """Return what a row of noise is made of."""
    letter = "N" if row.of[0].endswith("white") else "K"
    power, needs = KINDS[row.kind]
    times = "√2 " if row.times != 1 else ""
    if power == 1:
        return f"{times}{letter}{FACTORS.get(needs, '')}"
    return f"{letter}²" + (" rate" if needs else "")


def page() -> str:
    """Return the table as Markdown."""
    lines: list[str] = []
    for own in (one for table in TABLES for one in receivers(table).values()):
        has = "corrected before" if own.before else ", ".join(own.takes)
        axes = f" Axes: {own.axes}." if own.axes else ""
        more = " for a magnetometer" if own.of_magnetometer else ""
        lines += [f"### {own.name}{more}\n", f"{own.title}. Calibration: {has}.{axes}\n"]
        lines += ["| key | what | kind | unit |", "|---|---|---|---|"]
        for row in own.rows:
            if row.key:
                what = formula(row) if row.noise else row.says or _named(row)
                triad = f"{row.of[0].split('.')[0]}: " if row.noise else ""
                kind = row.kind if row.noise else ""
                lines.append(f"| `{row.shown}` | {triad}{what} | {kind} | {row.unit} |")
        lines += ["", " ".join(own.notes), "", f"Source: {own.source}.", ""]
    return "\n".join(lines)


def _named(row: Row) -> str:
    return ", ".join(name.replace("_", " ").replace(".", ": ") for name in row.of)
