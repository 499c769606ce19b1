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
    open_ = [(a, b - 1) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]
    for pair in open_:
        kept[list(pair)] = True
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        along, between = p[b] - p[a], p[a + 1 : b] - p[a]
        length = float(along @ along)
        share = np.clip(between @ along / length, 0.0, 1.0) if length else np.zeros(len(between))
        away = between - share[:, None] * along
        far = np.einsum("ni,ni->n", away, away)
        k = int(far.argmax())
        if far[k] > off * off:
            kept[a + 1 + k] = True
            open_ += [(a, a + 1 + k), (a + 1 + k, b)]
    return kept
