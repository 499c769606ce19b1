"""What a rate table showed: errors of the rate against the rate, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.report.figures import (
    FIRST,
    FULL,
    SECOND,
    THIRD,
    Trace,
    axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.page import Block, Column, Figure, Items, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Result

COLOURS = {"x": FIRST, "y": SECOND, "z": THIRD}
PANELS = (
    ("before", "before", (0.72, 1.0)),
    ("line", "off the line", (0.36, 0.64)),
    ("after", "after", (0.0, 0.28)),
)
"""Column of the table, name of its panel, and where the panel is."""

SPREAD = 0.012
"""How far apart the axes stand at the same rate, as a part of the fastest [1]."""

MEANING = (
    "Scale factor error: of the best straight line. Non-linearity: largest distance from it, as a "
    "part of the fastest rate. Asymmetry: difference of the scale factors of the two senses over "
    "their mean (IEEE Std 647, 952); the coefficient is half of it."
)


def rate_steps(result: Result) -> Section | None:
    """Error of every step against the rate, and the figures that the standards ask for."""
    table = result.tables.get("rate_steps")
    if table is None:
        return None
    blocks: list[Block] = [_figure(table)]
    facts: Mapping[str, Mapping[str, float]] = result.diagnostics.get("rate_table") or {}
    if facts:
        blocks += [_figures_of_merit(facts), Text(MEANING)]
    chi = (result.diagnostics.get("chi_square") or {}).get("steps")
    if chi and result.diagnostics.get("noise", {}).get("source") != "measured by the residuals":
        blocks.append(_fit(chi))
    lead = (
        "Rate that the gyro along the vertical says, minus the true rate, as a part of the fastest "
        "rate; note the three scales. Above: as read. Middle: after the best straight line, which "
        "is bias and scale factor; what is left is asymmetry and non-linearity. Below: after the "
        "calibration, with two standard deviations of the noise."
    )
    return Section("Rates before and after", lead, blocks)


def _figure(table: Any) -> Figure:
    speed = np.asarray(table["rate_true"], float)
    top = float(np.abs(speed).max()) or 1.0
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    for k, (column, title, domain) in enumerate(PANELS):
        values = np.asarray(table[column], float) / top
        sd = np.asarray(table["after_sd"], float) / top if column == "after" else None
        unit = units.display_unit("scale factor error", float(np.nanmax(np.abs(values), initial=0)))
        size = units.factor(unit, "scale factor error")
        ref = f"y{k + 1}" if k else "y"
        data += _panel(table, values / size, None if sd is None else sd / size, ref, shown(unit))
        axes[f"yaxis{k + 1}" if k else "yaxis"] = axis(
            f"{title} [{shown(unit)}]", domain=list(domain)
        )
    look = layout(
        600,
        xaxis=axis("rate about the axis [°/s]", anchor="y3"),
        shapes=[level_line(0, ref, "solid") for ref in ("y", "y2", "y3")],
        **axes,
    )
    alt = (
        "Error of every step against the rate about its axis: as read, off the straight line, and "
        "after calibration"
    )
    caption = "A triangle points where its axis pointed. Axes stand side by side at each rate."
    return Figure(data, look, caption, alt=alt)


def _panel(
    table: Any, values: FloatArray, sd: FloatArray | None, ref: str, unit: str
) -> list[Trace]:
    """Return one trace per axis of the instrument; a triangle points where the axis pointed."""
    degrees = np.degrees(np.asarray(table["rate_true"], float))
    weight, up = np.asarray(table["weight"], float), np.asarray(table["up"], float)
    top = float(np.abs(degrees).max())
    out: list[Trace] = []
    for k, (name, colour) in enumerate(COLOURS.items()):
        mine = np.asarray(table["axis"]) == name
        if not mine.any():
            continue
        symbols = [
            f"triangle-{'up' if u > 0 else 'down'}{'' if w > FULL else '-open'}"
            for u, w in zip(up[mine], weight[mine], strict=True)
        ]
        trace: Trace = {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "legendgroup": name,
            "showlegend": ref == "y",
            "x": numbers(degrees[mine] + (SPREAD * (k - 1) + SPREAD / 3 * up[mine]) * top),
            "customdata": numbers(degrees[mine]),
            "y": numbers(values[mine]),
            "yaxis": ref,
            "marker": {"color": colour, "size": 8, "symbol": symbols},
            "hovertemplate": f"{name}, %{{customdata:.4g}}°/s: %{{y:.4g}} {unit}<extra></extra>",
        }
        if sd is not None:
            bars = {"type": "data", "array": numbers(2 * sd[mine]), "width": 0}
            trace["error_y"] = bars | {"color": colour, "thickness": 1.1}
        out.append(trace)
    return out


def _figures_of_merit(facts: Mapping[str, Mapping[str, float]]) -> Table:
    """What IEEE Std 647 and 952 ask for, as they define it."""
    columns = [
        Column("axis", "short"),
        Column("scale factor error [ppm]", "number"),
        Column("non-linearity [ppm]", "number"),
        Column("asymmetry [ppm]", "number"),
        Column("fastest rate [°/s]", "number"),
    ]
    rows = []
    for name, row in facts.items():
        rows.append([
            name,
            _number(1e6 * (row["scale_factor"] - 1.0)),
            _number(1e6 * row["nonlinearity"]),
            _number(1e6 * row["asymmetry"]),
            f"{np.degrees(row['full_scale']):.4g}",
        ])  # fmt: skip
    return Table(columns, rows)


def _number(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _fit(chi: list[float]) -> Items:
    value, low, high, dof = chi
    fits = low <= value <= high
    words = (
        f"Residuals of all steps: chi-square {value:.3g}, {'inside' if fits else 'outside'} "
        f"{low:.3g} to {high:.3g} ({dof:.0f} degrees of freedom)."
    )
    return Items([("good" if fits else "warning", words)])
