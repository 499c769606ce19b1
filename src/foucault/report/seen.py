"""Lines of a figure without the points that no one sees.

A point is left out where the line without it is nowhere farther from it than 1/800 of the
axes, half a pixel of a figure 400 pixels high (Douglas and Peucker, The Canadian Cartographer,
1973, 10(2), 112-122).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.report.page import Figure
from foucault.report.scales import Axis, axis_of

PARTS = 800.0  # So many parts of an axis are told apart [1].
FEW = 30  # Lines of fewer points stay as they are [1].


def seen(figure: Figure) -> Figure:
    """Return a figure whose lines have the points that are seen."""
    axes: dict[tuple[str, Any], Axis] = {}  # which several lines share
    return replace(figure, data=[_slim(trace, figure, axes) for trace in figure.data])


def _slim(
    trace: dict[str, Any], figure: Figure, axes: dict[tuple[str, Any], Axis]
) -> dict[str, Any]:
    bent = trace.get("line", {}).get("shape", "linear") == "linear"
    if trace.get("mode") != "lines" or not bent or len(trace.get("x", ())) < FEW:
        return trace
    if trace["type"] == "scatter":
        # Of a figure with choices only the lines of one are drawn at a time.
        group = trace.get("meta")
        way = []
        for letter in "xy":
            name = trace.get(f"{letter}axis", letter)
            if (name, group) not in axes:
                shown = [t for t in figure.data if t.get("meta") == group]
                look = figure.layout.get(f"{letter}axis{name[1:]}", {})
                axes[name, group] = axis_of(name, look, shown, figure.layout)
            way.append(axes[name, group].at(trace[letter]))
    elif trace["type"] == "scatter3d":  # of directions
        way = [np.array(trace[letter], float) / 2.0 for letter in "xyz"]
    else:
        return trace
    kept = points(np.column_stack(way), 1.0 / PARTS).tolist()
    return {
        key: [v for v, keep in zip(value, kept, strict=True) if keep]
        if isinstance(value, list) and len(value) == len(kept)
        else value
        for key, value in trace.items()
    }


def points(p: FloatArray, off: float) -> BoolArray:
    """Tell which points of a line are needed for one that is nowhere farther than `off`, (n,).

    `p` (n, 2 or 3): the points, in order; those that are not known break the line and stay.
    """
    kept: BoolArray = np.asarray(~np.isfinite(p).all(axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], kept, [True]]).astype(int)))
    first, last = edges[::2], edges[1::2] - 1  # of the parts that are still to be looked at
    kept[first], kept[last] = True, True
    while np.any(inner := last - first > 1):
        first, last = first[inner], last[inner]
        count = last - first - 1
        begins = np.cumsum(count) - count
        part = np.repeat(np.arange(len(first)), count)
        rows = np.arange(len(part)) + (first + 1 - begins)[part]
        along, between = (p[last] - p[first])[part], p[rows] - p[first][part]
        length = np.einsum("ni,ni->n", along, along)
        share = np.einsum("ni,ni->n", between, along) / np.where(length > 0, length, 1.0)
        away = between - np.clip(share, 0.0, 1.0)[:, None] * along
        far = np.einsum("ni,ni->n", away, away)
        most = np.maximum.reduceat(far, begins)
        tops = np.flatnonzero(far == most[part])
        top = rows[tops[np.unique(part[tops], return_index=True)[1]]]
        first, last, top = (x[most > off * off] for x in (first, last, top))
        kept[top] = True
        first, last = np.append(first, top), np.append(top, last)
    return kept
