"""The figures of a comparison: coefficients over time, changes in standard deviations."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report import figures
from foucault.report.page import Figure
from foucault.report.uncertainty import shown
from foucault.units import display_unit, factor

REACH = 2.5
"""A limit is drawn where it does not make the axis longer than so many times [1]."""


def over_time(
    name: str, kind: str, values: FloatArray, sd: FloatArray, places: Sequence[str],
    limits: tuple[float, float], odd: bool, *, joined: bool,
) -> Figure:  # fmt: skip
    """Draw one coefficient over time, or over instruments: values with two sd, and what is allowed.

    `places` are dates, or numbers where there are none; `limits` are those of the value and of a
    change, infinite where there are none; `odd` coefficients are drawn in the colour of a warning;
    `joined` ones are results of one instrument.
    """
    unit = display_unit(kind, float(np.max(np.abs(values))))
    size = factor(unit, kind)
    y, error, limit, change = values / size, 2 * sd / size, limits[0] / size, limits[1] / size
    colour = figures.WARNING if odd else figures.FIRST
    x = list(places)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines+markers" if joined else "markers",
            "x": x, "y": figures.numbers(y),
            "error_y": {
                "type": "data", "array": figures.numbers(error), "color": colour,
                "thickness": 1.4, "width": 3,
            },
            "line": {"color": colour, "width": 1, "dash": "dot"},
            "marker": {"color": colour, "size": 7},
            "hovertemplate": f"%{{x}}: %{{y:.6g}} {shown(unit)}<extra></extra>",
        }
    ]  # fmt: skip
    low, high = float(np.min(y - error)), float(np.max(y + error))
    room = REACH * (high - low)
    shapes = []
    if np.isfinite(change) and change < room:
        middle = float(np.max(y) + np.min(y)) / 2
        band = (middle - change / 2, middle + change / 2)
        shapes.append(_band(*band))
        low, high = min(low, band[0]), max(high, band[1])
    for side in (-limit, limit):
        if np.isfinite(side) and low - room < side < high + room:
            shapes.append(figures.level_line(side, colour=figures.BAD))
            low, high = min(low, side), max(high, side)
    reach = 0.08 * (high - low)
    dated = _dated(places)
    look = figures.layout(
        205, showlegend=False, shapes=shapes,
        xaxis=_dates(places) if dated else {"type": "category", "tickangle": 0, "nticks": 6},
        yaxis=figures.axis(
            shown(unit), range=[low - reach, high + reach], nticks=5, exponentformat="none"
        ),
        title={"text": name, "font": {"size": 13, "color": "var(--ink)"}, "x": 0.01, "y": 0.97},
    )  # fmt: skip
    over = "time" if dated else "the results"
    return Figure([*data], look, share=33, alt=f"{name} over {over}, with two standard deviations")


def _dated(places: Sequence[str]) -> bool:
    try:
        return all(bool(datetime.datetime.fromisoformat(p)) for p in places)
    except ValueError:
        return False


def _dates(places: Sequence[str]) -> dict[str, Any]:
    times = [datetime.datetime.fromisoformat(p) for p in places]
    room = max((max(times) - min(times)) * 0.08, datetime.timedelta(hours=12))
    ends = [(min(times) - room).isoformat(), (max(times) + room).isoformat()]
    return {"type": "date", "range": ends, "nticks": 4, "tickangle": 0}


def _band(low: float, high: float) -> dict[str, Any]:
    return {
        "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "y0": low, "y1": high,
        "fillcolor": "var(--band)", "line": {"width": 0}, "layer": "below",
    }  # fmt: skip


def in_sd(names: Sequence[str], z: FloatArray, limit: float, what: str) -> Figure:
    """Draw changes over their standard deviations, with the limit that all of them share."""
    far = np.abs(z) > limit
    data = [
        {
            "type": "scatter", "mode": "markers", "name": word,
            "x": figures.numbers(z[pick]), "y": [names[k] for k, here in enumerate(pick) if here],
            "marker": {"color": colour, "size": 9, "symbol": symbol},
            "hovertemplate": "%{y}: %{x:.2f} sd<extra></extra>",
        }
        for pick, word, colour, symbol in (
            (~far, "within chance", figures.FIRST, "circle"),
            (far, "beyond chance", figures.WARNING, "diamond"),
        )
        if pick.any()
    ]  # fmt: skip
    top = 1.1 * max(limit, float(np.max(np.abs(z), initial=0.0)))
    shapes = [_upright(v, "dash") for v in (-limit, limit)] + [_upright(0.0, "solid")]
    look = figures.layout(
        90 + 19 * len(names), shapes=shapes, showlegend=True,
        xaxis=figures.axis("change / its sd", range=[-top, top]),
        yaxis={
            "type": "category", "categoryorder": "array", "categoryarray": list(names),
            "autorange": "reversed", "tickmode": "linear", "ticks": "", "tickfont": {"size": 11.5},
        },
    )  # fmt: skip
    return Figure(data, look, alt=f"Changes {what} in standard deviations, with their limit")


def _upright(x: float, dash: str) -> dict[str, Any]:
    line = {"color": figures.SOFT, "width": 1.2, "dash": dash}
    return {
        "type": "line", "x0": float(f"{x:.6g}"), "x1": float(f"{x:.6g}"), "yref": "paper",
        "y0": 0, "y1": 1, "line": line,
    }  # fmt: skip


def intervals(names: Sequence[str], z: FloatArray, limit: float, steps: Sequence[str]) -> Figure:
    """Draw the changes from each result to the next, shape (steps, names), as colours."""
    top = 2 * limit
    data = [
        {
            "type": "heatmap", "x": list(steps), "y": list(names),
            "z": [figures.numbers(np.round(row, 2)) for row in z.T],
            "zmin": -top, "zmax": top,
            "colorscale": [[0, "var(--low)"], [0.5, "var(--zero)"], [1, "var(--high)"]],
            "colorbar": {
                "thickness": 10, "outlinewidth": 0, "title": {"text": "sd", "side": "top"},
                "tickvals": [float(f"{v:.3g}") for v in (-top, -limit, 0, limit, top)],
            },
            "xgap": 1, "ygap": 1,
            "hovertemplate": "%{y}, %{x}: %{z:.2f} sd<extra></extra>",
        }
    ]  # fmt: skip
    look = figures.layout(
        110 + 19 * len(names),
        xaxis={"type": "category", "ticks": "", "showgrid": False, "tickmode": "linear"},
        yaxis={
            "type": "category", "autorange": "reversed", "tickmode": "linear", "ticks": "",
            "showgrid": False, "tickfont": {"size": 11.5},
        },
        meta={"narrow": {"xaxis": {"tickfont": {"size": 9}}}},
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 10}
    return Figure(data, look, alt="Change of every coefficient from each result to the next, in sd")
