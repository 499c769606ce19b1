"""The page of all validations; its numbers are read from the pages that the scripts wrote."""

from __future__ import annotations

import re
import tomllib
from itertools import product
from pathlib import Path

DOCS = Path(__file__).parents[1]

HEAD = """\
# How it was verified

Each row is one question, with a script that answers it and a page with all its tables; the numbers
here are taken from those pages. *Beside* is what a paper printed, another program computed or a
closed form says; *bound* is the Cramér-Rao bound or the limit that ours must keep. Statistical
limits are two-sided chi-square limits with 1 % false alarms for a whole table.

`make validation` runs all of them, one after the other: more than an hour. Each runs alone too,
`python validation/run.py NAME` with the name in the last column. Those on real logs need [the
logs](install.md#logs-for-the-validation). The tests hold the short form of these checks and run
at every change.
"""


def page() -> str:
    said = tomllib.loads((DOCS / "verified.toml").read_text(encoding="utf-8"))
    lines = [HEAD]
    for group, rows in said.items():
        lines += [
            f"## {group}", "", "| what | beside | bound or limit | ours | tables |",
            "|---|---|---|---|---|",
        ]  # fmt: skip
        for row in rows:
            path = DOCS / "validation" / f"{row['page']}.md"
            values = [filled(row.get(key, ""), path) for key in ("what", "beside", "bound", "ours")]
            link = f"[{row['page']}](validation/{row['page']}.md)"
            lines.append(f"| {' | '.join(values)} | {link} |")
        lines.append("")
    _complete({row["page"] for rows in said.values() for row in rows})
    return "\n".join(lines)


def _complete(pages: set[str]) -> None:
    there = {path.stem for path in (DOCS / "validation").glob("*.md")}
    if missing := there - pages:
        raise KeyError(f"docs/verified.toml says nothing of: {', '.join(sorted(missing))}")


def filled(template: str, path: Path) -> str:
    """Put numbers of a page in the place of ``{row; second cell | column}`` and ``{~regex}``."""
    text = path.read_text(encoding="utf-8")
    return re.sub(r"\{([^{}]+)\}", lambda found: _value(found[1], text, path), template)


def _value(address: str, text: str, path: Path) -> str:
    if address.startswith("~"):
        found = re.search(address[1:], text)
        if found is None:
            raise LookupError(f"{path}: nothing matches '{address}'")
        return found[1]
    row, column = (part.strip() for part in address.split("|"))
    wanted = [part.strip() for part in row.replace("`", "").split(";")]
    tables = re.findall(r"(?:^\|.*\n)+", text, flags=re.M)
    for like_column, like_row in product((str.__eq__, str.startswith), repeat=2):
        for table in tables:
            cells = [_cells(line) for line in table.splitlines()]
            columns = [i for i, title in enumerate(cells[0]) if like_column(title, column)]
            rows = [r for r in cells if len(r) >= len(wanted) and all(map(like_row, r, wanted))]
            if columns and rows:
                return rows[0][columns[0]]
    raise LookupError(f"{path}: no cell '{address}'")


def _cells(line: str) -> list[str]:
    return [cell.replace("`", "").strip() for cell in line[1:-1].split(" | ")]
