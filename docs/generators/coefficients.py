"""The glossary of coefficients, from the models."""

from __future__ import annotations

from foucault import units
from foucault.coefficients import Coefficient
from foucault.models import cluster
from foucault.models.imu import LAYOUT
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT


def page() -> str:
    lines = [
        "# Coefficients",
        "",
        "A name is output axis first, then inputs.",
        "",
        *_table(LAYOUT.coefficients),
        "",
        "## Of accelerometers that are not at one place, or late",
        "",
        "They show where the instrument turns: see [the model](models/imu.md).",
        "",
        *_table(SIZE_EFFECT.coefficients),
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


def _table(coefficients: tuple[Coefficient, ...]) -> list[str]:
    head = ["| name | symbol | SI unit | shown in | meaning |", "|---|---|---|---|---|"]
    return head + [f"| `{c.name}` | {c.symbol} | {_units(c)} | {c.meaning} |" for c in coefficients]


def _units(c: Coefficient) -> str:
    return f"{c.unit} | {', '.join(units.KINDS[c.kind].display)}"
