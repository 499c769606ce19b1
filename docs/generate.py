"""Write the generated pages: every message with its cure, every coefficient with its unit."""

from __future__ import annotations

import json
from pathlib import Path

from foucault import campaign, units
from foucault.coefficients import Coefficient
from foucault.models import cluster
from foucault.models.imu import LAYOUT
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.run_folder import result_schema
from foucault.symptoms import markdown

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
