"""Headings from true, magnetic and grid north, wherever a heading is given."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from foucault.coefficients import format_value
from foucault.models.norths import North
from foucault.report.page import Section, Table, columns, section


def from_each_north(
    what: str, found: Iterable[tuple[str, float, float]], norths: Sequence[North]
) -> Section | None:
    """Return every heading from every north; None where there is true north alone.

    `what`: they are of, for the head of the table; `found`: name, heading and its sd [rad].
    """
    if len(norths) < 2:
        return None
    rows = []
    for name, heading, heading_sd in found:
        for north in norths:
            x, sd = np.degrees(north.heading(heading, heading_sd))
            about = format_value(np.degrees(north.offset), np.degrees(north.sd) or 1e-4)
            rows.append([name, north.name, format_value(x, sd), f"{sd:.2g}", about, north.basis])
    heads = columns(what, "north", "heading (deg): number", "sd: number",
                    "this north, from true north (deg): number", "by")  # fmt: skip
    return section("headings.norths", Table(heads, rows))
