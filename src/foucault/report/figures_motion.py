"""Figures of the motion of a torqued cluster: where its axes pointed, and what that showed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report.figures import (
    FIRST,
    SECOND,
    SERIES,
    THIRD,
    Trace,
    axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.orientation import disc, discs, flattened, space, tripod, wires
from foucault.report.page import Figure

COLOURS = dict(zip("xyz", (FIRST, SECOND, THIRD), strict=True))

MOST_NUMBERS = 20
"""Legs that are numbered; more would stand on one another [1]."""


def leg_lines(legs: Sequence[Mapping[str, Any]]) -> list[Trace]:
    """Return a thin line wherever the command changes, down the whole figure."""
    line = {"color": "var(--faint)", "width": 1, "dash": "dot"}
    place = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": line, "layer": "below"}
    return [place | {"x0": leg["start"], "x1": leg["start"]} for leg in legs[1:]]


def leg_numbers(legs: Sequence[Mapping[str, Any]]) -> list[Trace]:
    """Return the number of every leg, above its middle."""
    return [
        {
            "text": str(k), "x": (leg["start"] + leg["end"]) / 2, "y": 1, "yref": "paper",
            "xanchor": "center", "yanchor": "bottom", "showarrow": False,
        }
        for k, leg in enumerate(legs, 1)
    ] if len(legs) <= MOST_NUMBERS else []  # fmt: skip


def heading(text: str) -> Trace:
    """Return a heading over the left edge of a figure."""
    return {
        "text": text, "x": 0, "xref": "paper", "xanchor": "left", "y": 1, "yref": "paper",
        "yanchor": "bottom", "yshift": 20, "showarrow": False,
        "font": {"color": "var(--ink)", "size": 13},
    }  # fmt: skip


def path(table: Mapping[str, FloatArray]) -> Figure:
    """Draw the way of the cluster axes on the sphere, East-North-Up."""
    data = [*wires(), *tripod("ENU")]
    for name, colour in COLOURS.items():
        x, y, z = (np.asarray(table[f"{name}.{w}"], float) for w in ("east", "north", "up"))
        common = {"type": "scatter3d", "legendgroup": name, "name": name}
        said = f"{name} axis, %{{customdata}} s<extra></extra>"
        data.append(
            common
            | {
                "mode": "lines", "x": numbers(x), "y": numbers(y), "z": numbers(z),
                "customdata": numbers(np.round(table["time"])),
                "line": {"color": colour, "width": 5}, "hovertemplate": said,
            }
        )  # fmt: skip
        data.append(
            common
            | {
                "mode": "markers", "showlegend": False, "hoverinfo": "skip",
                "x": numbers(x[[0, -1]]), "y": numbers(y[[0, -1]]), "z": numbers(z[[0, -1]]),
                "marker": {
                    "color": colour, "size": [6, 5], "symbol": ["circle-open", "circle"],
                    "line": {"color": colour, "width": 2},
                },
            }
        )  # fmt: skip
    caption = "Ring: at the start; dot: at the end. Turn it with the pointer."
    alt = "Way of the tips of the three cluster axes on a sphere, East, North and Up marked"
    return Figure(data, space(), caption, on="screen", share=38, alt=alt)


def path_map(table: Mapping[str, FloatArray]) -> Figure:
    """Draw the same ways on two discs: upper and lower half of the sphere."""
    data: list[Trace] = []
    shapes: list[Trace] = []
    for half, (sign, ref) in enumerate(((1, ""), (-1, "2"))):
        for name, colour in COLOURS.items():
            tip = np.column_stack([table[f"{name}.{w}"] for w in ("east", "north", "up")])
            data.append(
                _way(tip, sign, colour)
                | {
                    "name": name, "legendgroup": name, "showlegend": half == 0,
                    "xaxis": f"x{ref}", "yaxis": f"y{ref}",
                    "customdata": numbers(np.round(table["time"])),
                    "hovertemplate": f"{name} axis, %{{customdata}} s<extra></extra>",
                }
            )  # fmt: skip
            data.append(_ends(tip, sign, colour, ref) | {"legendgroup": name})
        shapes += disc(ref)
    notes = [
        {"text": text, "x": x, "y": y, "xref": f"x{r}", "yref": f"y{r}", "showarrow": False}
        for r, half in (("", "upper half"), ("2", "lower half"))
        for text, x, y in (("E", 1.13, 0), ("N", 0, 1.13), (f"<b>{half}</b>", 0, -1.2))
    ]
    alt = "Map of the ways of the three cluster axes, upper and lower half of the sphere"
    caption = (
        "Equal-area map, both halves seen from above. Ring: at the start; dot: at the end. An "
        "axis on the rim is level."
    )
    return Figure(data, discs(shapes=shapes, annotations=notes), caption, share=62, alt=alt)


def _way(tip: FloatArray, sign: int, colour: str) -> Trace:
    """A line that breaks where it leaves this half."""
    z = sign * tip[:, 2]
    on = z >= 0
    flat = np.full((len(tip), 2), np.nan)
    flat[on] = flattened(tip[on], z[on])
    line = {"color": colour, "width": 2.5}
    x, y = numbers(flat[:, 0]), numbers(flat[:, 1])
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": line}


def _ends(tip: FloatArray, sign: int, colour: str, ref: str) -> Trace:
    ends = tip[[0, -1]]
    on = (sign * ends[:, 2] > 0) if sign < 0 else (ends[:, 2] >= 0)
    flat = flattened(ends[on], sign * ends[on, 2])
    symbols = [s for s, used in zip(("circle-open", "circle"), on, strict=True) if used]
    return {
        "type": "scatter", "mode": "markers", "showlegend": False, "hoverinfo": "skip",
        "x": numbers(flat[:, 0]), "y": numbers(flat[:, 1]), "xaxis": f"x{ref}", "yaxis": f"y{ref}",
        "marker": {
            "color": colour, "symbol": symbols,
            "size": [12 if s == "circle-open" else 9 for s in symbols],
            "line": {"color": colour, "width": 2},
        },
    }  # fmt: skip


def angles(table: Mapping[str, FloatArray], legs: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw outer, middle and inner angle against time."""
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "lines", "name": word, "x": numbers(table["time"]),
            "y": numbers(np.degrees(table[word])), "line": {"color": colour, "width": 2},
            "hovertemplate": f"%{{x:.0f}} s: %{{y:.2f}}°<extra>{word}</extra>",
        }
        for word, colour in zip(("outer", "middle", "inner"), COLOURS.values(), strict=True)
    ]  # fmt: skip
    look = layout(
        280, meta={"zoom": True}, xaxis=axis("time [s]", showgrid=False),
        yaxis=axis("angle [°]", dtick=90), shapes=leg_lines(legs), annotations=leg_numbers(legs),
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 52}
    look["legend"] = look["legend"] | {"y": 1.1}
    alt = "Outer, middle and inner angle against time"
    return Figure(data, look, "Numbers above: legs of the motion.", alt=alt)


def growth(
    until: Sequence[float], seen: Mapping[str, Sequence[int]], whole: int,
    legs: Sequence[Mapping[str, Any]],
) -> Figure:  # fmt: skip
    """Draw how many of `whole` unknowns have been `seen` by the end of each short turn [s]."""
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "lines+markers", "name": name,
            "x": numbers([0, *until]), "y": [0, *counts],
            "line": {"color": colour, "width": 2, "shape": "hv"},
            "marker": {"color": colour, "size": 6},
            "hovertemplate": f"%{{x:.0f}} s: %{{y}}<extra>{name}</extra>",
        }
        for (name, counts), colour in zip(seen.items(), SERIES, strict=False)
    ]  # fmt: skip
    look = layout(
        260, xaxis=axis("time [s]", showgrid=False, range=[0, 1.005 * until[-1]]),
        yaxis=axis(f"of {whole}", range=[0, 1.06 * whole]),
        shapes=[level_line(whole, dash="dash"), *leg_lines(legs)], annotations=leg_numbers(legs),
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 52}
    look["legend"] = look["legend"] | {"y": 1.1}
    return Figure(data, look, alt="Number of unknowns that have been seen against time")


def left_of_prior(
    title: str, symbols: Sequence[str], share: Sequence[float], least: float, caption: str = ""
) -> Figure:
    """Draw the standard deviation of each unknown over that before, from `least` to 1."""
    x = numbers(np.maximum(share, 1e-12))
    lines: list[float | None] = [v for one in x for v in (one, 1.0, None)]
    names = [s for symbol in symbols for s in (symbol, symbol, symbol)]
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "lines", "x": lines, "y": names, "hoverinfo": "skip",
            "line": {"color": "var(--band)", "width": 5}, "showlegend": False,
        },
        {
            "type": "scatter", "mode": "markers", "x": x, "y": list(symbols), "showlegend": False,
            "marker": {"color": FIRST, "size": 8},
            "hovertemplate": "%{y}: %{x:.2g} of the prior<extra></extra>",
        },
    ]  # fmt: skip
    low = math.floor(math.log10(min(max(least, 1e-12), 0.1)) - 0.05)
    look = layout(
        86 + 18 * len(symbols), annotations=[heading(f"<b>{title}</b>") | {"yshift": 4}],
        xaxis=axis("sd after / sd before", type="log", dtick=1, range=[low, 0.06],
                   exponentformat="power", tickfont={"size": 11}),
        yaxis={"type": "category", "range": [len(symbols) - 0.4, -0.6], "tickmode": "linear",
               "ticks": "", "tickfont": {"size": 12.5}},
    )  # fmt: skip
    alt = f"{title}: standard deviation of each over that before, from 1 down to 1e{low}"
    return Figure(data, look, caption, share=50, alt=alt)
