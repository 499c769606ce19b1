"""What the calibration of a north seeker does to its headings, around the circle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.report.figures import FIRST, SECOND, Trace, axis, layout, level_line, numbers
from foucault.report.page import Block, Column, Figure, Section, Table
from foucault.result import Result

FIGURES = (
    ("std", "standard deviation about the mean"),
    ("max", "largest departure from the mean"),
    ("peak_to_peak", "peak to peak"),
    ("mean", "mean"),
    ("rms", "root mean square, the mean in it"),
)


def headings(result: Result) -> Section | None:
    """Heading error of every set-up before and after, and what the readings leave."""
    table = result.tables.get("headings")
    if table is None:
        return None
    blocks: list[Block] = [_errors(table)]
    figures = result.diagnostics.get("circle_accuracy") or {}
    if figures:
        blocks.append(_figures(figures))
    blocks.append(_left(table))
    lead = (
        "Heading that a fix at each set-up of this session would find, minus the reference: as the "
        "instrument is, and with this calibration. Errors after it belong to the readings it was "
        "made of; a later fix has the calibration's own uncertainty too."
    )
    return Section("Headings before and after", lead, blocks)


def _errors(table: Any) -> Figure:
    x = np.degrees(np.asarray(table["heading"], float)) % 360
    order = np.argsort(x, kind="stable")
    data: list[Trace] = []
    rows = (("before", "before", SECOND, "y2"), ("after", "after", FIRST, "y"))
    for column, name, colour, ref in rows:
        y = np.degrees(np.asarray(table[f"heading_{column}"], float))
        trace: Trace = {
            "type": "scatter", "mode": "markers", "name": name, "x": numbers(x[order]),
            "y": numbers(y[order]), "yaxis": ref, "marker": {"color": colour, "size": 8},
            "hovertemplate": f"%{{x:.1f}}°: %{{y:.4f}}°<extra>{name}</extra>",
        }  # fmt: skip
        if column == "after":
            sd = np.degrees(np.asarray(table["heading_sd"], float))
            trace["error_y"] = {
                "type": "data", "array": numbers(2 * sd[order]), "width": 0, "color": colour,
                "thickness": 1.2,
            }  # fmt: skip
        data.append(trace)
    look = layout(
        400,
        xaxis=axis("reference heading [°]", tick0=0, dtick=30, range=[-8, 368]),
        yaxis=axis("after [°]", domain=[0, 0.46]),
        yaxis2=axis("before [°]", domain=[0.56, 1]),
        shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
    )
    alt = "Heading error of every set-up against the reference heading, before and after"
    return Figure(data, look, "Note the two scales. Bars: two standard deviations.", alt=alt)


def _figures(figures: Mapping[str, Mapping[str, float]]) -> Table:
    columns = [Column("circle accuracy"), Column("before", "number"), Column("after", "number")]
    rows = [
        [words, *(f"{np.degrees(figures[w][key]):.4f}°".replace("-", "−") for w in figures)]
        for key, words in FIGURES
    ]
    return Table(columns, rows)


def _left(table: Any) -> Figure:
    x = np.degrees(np.asarray(table["heading"], float)) % 360
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "markers", "name": f"gyro {name}", "x": numbers(x),
            "y": numbers(np.asarray(table[f"residual_{name}"], float)),
            "marker": {"color": colour, "size": 8},
            "hovertemplate": f"%{{x:.1f}}°: %{{y:.2f}} sd<extra>gyro {name}</extra>",
        }
        for name, colour in (("x", FIRST), ("y", SECOND))
    ]  # fmt: skip
    look = layout(
        280,
        xaxis=axis("reference heading [°]", tick0=0, dtick=30, range=[-8, 368]),
        yaxis=axis("residual / sd"),
        shapes=[level_line(0, "y", "solid"), level_line(2.6), level_line(-2.6)],
    )
    alt = "Standardized residual of the two rates against the reference heading"
    return Figure(data, look, "One in a hundred lies outside the dashed lines.", alt=alt)
