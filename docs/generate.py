"""Write the generated pages: every message with its cure, every coefficient with its unit."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from foucault import campaign, units
from foucault.coefficients import Coefficient
from foucault.models import cluster
from foucault.models.imu import LAYOUT
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.run_folder import result_schema
from foucault.symptoms import SYMPTOMS, markdown

HERE = Path(__file__).parent


def coefficients_markdown() -> str:
    lines = [
        "# Coefficients",
        "",
        "Written by `docs/generate.py` from the models. A name is output axis first, then inputs.",
        "",
        "| name | symbol | SI unit | shown in | meaning |",
        "|---|---|---|---|---|",
        *(f"| `{c.name}` | {c.symbol} | {_units(c)} | {c.meaning} |" for c in LAYOUT.coefficients),
        "",
        "## Of accelerometers that are not at one place, or late",
        "",
        "They show where the instrument turns: see [the model](models/imu.md).",
        "",
        "| name | symbol | SI unit | shown in | meaning |",
        "|---|---|---|---|---|",
        *(
            f"| `{c.name}` | {c.symbol} | {_units(c)} | {c.meaning} |"
            for c in SIZE_EFFECT.coefficients
        ),
        "",
        "## Of a torqued cluster",
        "",
        "With the symbol and sign of the source of the [platform "
        "tumble](procedures/platform_tumble.md). See [the model](models/cluster.md).",
        "",
        "| name | symbol | source | SI unit | shown in | meaning |",
        "|---|---|---|---|---|---|",
    ]
    for c in cluster.LAYOUT.coefficients:
        source, sign = cluster.SOURCE_SYMBOLS[c.name]
        source = source if sign > 0 else f"-{source}"
        lines.append(f"| `{c.name}` | {c.symbol} | {source} | {_units(c)} | {c.meaning} |")
    return "\n".join(lines) + "\n"


def _units(c: Coefficient) -> str:
    return f"{c.unit} | {', '.join(units.KINDS[c.kind].display)}"


def messages_markdown() -> str:
    head = "# Messages\n\nEvery error, warning and note, with its cure.\n\n"
    return head + markdown() + "\n"


GUARD = HERE / "guard.toml"
"""What people do wrong and what is said: asserted by tests/contracts/test_input_guard.py."""


def guard_markdown() -> str:
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
    words = ", ".join(f"`{code}`" for code in codes)
    failing = "the verdict does not pass"
    return words if "fails" not in cell.split() else f"{words}; {failing}" if words else failing


PAGES = {
    "messages.md": messages_markdown,
    "guard.md": guard_markdown,
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
