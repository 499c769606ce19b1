"""Write the generated pages: every message with its cure, every coefficient with its unit."""

from __future__ import annotations

import json
from pathlib import Path

from foucault import campaign, units
from foucault.models.imu import LAYOUT
from foucault.run_folder import result_schema
from foucault.symptoms import markdown

HERE = Path(__file__).parent


def coefficients_markdown() -> str:
    lines = [
        "# Coefficients",
        "",
        "Written by `docs/generate.py` from the model. A name is output axis first, then inputs.",
        "",
        "| name | symbol | SI unit | shown in | meaning |",
        "|---|---|---|---|---|",
    ]
    for c in LAYOUT.coefficients:
        shown = ", ".join(units.KINDS[c.kind].display)
        lines.append(f"| `{c.name}` | {c.symbol} | {c.unit} | {shown} | {c.meaning} |")
    return "\n".join(lines) + "\n"


def messages_markdown() -> str:
    head = "# Messages\n\nEvery error, warning and note, with its cure.\n\n"
    return head + markdown() + "\n"


PAGES = {
    "messages.md": messages_markdown,
    "coefficients.md": coefficients_markdown,
    "campaign.schema.json": lambda: json.dumps(campaign.schema(), indent=1) + "\n",
    "result.schema.json": lambda: json.dumps(result_schema(), indent=1) + "\n",
}
"""File in this folder -> what it must contain."""


def main() -> None:
    for name, make in PAGES.items():
        (HERE / name).write_text(make(), encoding="utf-8")
        print(HERE / name)


if __name__ == "__main__":
    main()
