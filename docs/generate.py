"""Put together what Sphinx reads: the pages that are written, and those that are made.

Made are the pages that messages, coefficients, commands and docstrings say by themselves; they are
never kept beside the others.
"""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path

from generators import (
    api,
    benchmarks,
    coefficients,
    commands,
    contributing,
    guard,
    messages,
    packages,
    parts,
    pictures,
    receivers,
    verified,
)

from foucault import campaign
from foucault.result_document import result_schema

HERE = Path(__file__).parent
KEPT = (".md", ".png", ".txt")
BUILT = (
    api.FOLDER,
    "gallery",
    "sg_execution_times.rst",
)  # by Sphinx, which keeps what is up to date

PAGES = {
    "messages.md": messages.index,
    **{f"messages/{name}.md": partial(messages.page, name) for name in messages.GROUPS},
    "guard.md": guard.page,
    "coefficients.md": coefficients.page,
    "api.md": api.page,
    "parts.md": parts.page,
    "receivers_table.txt": receivers.page,
    "commands.md": commands.page,
    "verified.md": verified.page,
    "benchmarks.md": benchmarks.page,
    "images/packages.svg": packages.draw,
    "contributing.md": contributing.page,
    **{f"images/{name}.svg": draw for name, draw in pictures.PICTURES.items()},
    "campaign.schema.json": lambda: json.dumps(campaign.schema(), indent=1) + "\n",
    "result.schema.json": lambda: json.dumps(result_schema(), indent=1) + "\n",
}
"""File beside those of this folder -> what it contains."""


def main(target: Path) -> None:
    """Write all into a folder; what has not changed keeps its time, so that a build is short."""
    wanted = {p.relative_to(HERE): p.read_bytes() for p in HERE.rglob("*") if p.suffix in KEPT}
    wanted |= {Path(name): make().encode() for name, make in PAGES.items()}
    for name, content in wanted.items():
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)
    for path in target.rglob("*"):
        name = path.relative_to(target)
        if path.is_file() and name.parts[0] not in BUILT and name not in wanted:
            path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
