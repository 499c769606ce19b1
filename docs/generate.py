"""Write the generated pages; after a change of messages, coefficients, commands or docstrings."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from generators import (
    api,
    benchmarks,
    coefficients,
    commands,
    guard,
    messages,
    pictures,
    verified,
)

from foucault import campaign
from foucault.run_folder import result_schema

HERE = Path(__file__).parent

PAGES = {
    "messages.md": messages.index,
    **{f"messages/{name}.md": partial(messages.page, name) for name in messages.GROUPS},
    "guard.md": guard.page,
    "coefficients.md": coefficients.page,
    "api.md": api.page,
    "commands.md": commands.page,
    "verified.md": verified.page,
    "benchmarks.md": benchmarks.page,
    **{f"images/{name}.svg": draw for name, draw in pictures.PICTURES.items()},
    "campaign.schema.json": lambda: json.dumps(campaign.schema(), indent=1) + "\n",
    "result.schema.json": lambda: json.dumps(result_schema(), indent=1) + "\n",
}
"""File in this folder -> what it must contain."""


def main() -> None:
    for name, make in PAGES.items():
        path = HERE / name
        path.parent.mkdir(exist_ok=True)
        text = make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(path)


if __name__ == "__main__":
    main()
