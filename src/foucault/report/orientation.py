"""Two pictures of the orientations visited: a sphere to turn, and a flat map for print.

Both show the direction of up in body axes, one point per rest. The map is two discs of equal
area (Lambert's projection), each seen from +z: the half where z points up and the half where
it points down, so that a direction on the rim stands at the same place in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report.figures import BAD, FIRST, SECOND, SOFT, Trace, layout, numbers
from foucault.report.page import Figure

HEIGHT = 330  # of both pictures, which stand side by side [px]


def sphere(
    up: FloatArray,
    missing: FloatArray,
    also: FloatArray | None = None,
    names: tuple[str, str] = ("visited", ""),
) -> Figure:
    """Draw directions, shape (n, 3), and missing ones, shape (m, 3), on a sphere.

    `also` are directions of another kind, shape (k, 3), as rings; `names` says what both kinds are.
    """
    data = [*wires(), *tripod()]
    styles = [(up, names[0], FIRST, "circle", 5), (missing, "missing", BAD, "diamond-open", 7)]
    if also is not None:
        styles.insert(0, (also, names[1], SECOND, "circle-open", 10))
    for points, name, colour, symbol, size in styles:
        if len(points):
            x, y, z = (numbers(points[:, i]) for i in range(3))
            data.append(
                {
                    "type": "scatter3d",
                    "mode": "markers",
                    "name": name,
                    "x": x,
                    "y": y,
                    "z": z,
                    "customdata": list(range(1, len(points) + 1)),
                    "marker": {"color": colour, "symbol": symbol, "size": size},
                    "hovertemplate": name + " %{customdata}<extra></extra>",
                }
            )
    look = space()
    look["legend"] = look["legend"] | {"traceorder": "reversed" if also is not None else "normal"}
    alt = f"Sphere with {len(up)} directions visited and {len(missing)} missing"
    return Figure(data, look, "Turn it with the pointer.", on="screen", share=38, alt=alt)


def space(height: int = HEIGHT) -> dict[str, Any]:
    """Return the look of a figure in space of `height` [px]: a cube to turn, without axes."""
    hidden = {"visible": False, "range": [-1.35, 1.35]}
    scene = {
        "xaxis": hidden,
        "yaxis": hidden,
        "zaxis": hidden,
        "aspectmode": "cube",
        "dragmode": "orbit",
        "camera": {"eye": {"x": 0.88, "y": -0.96, "z": 0.6}},
    }
    look = layout(height, scene=scene, meta={"ratio": 0.9})
    look["margin"] = {"l": 0, "r": 0, "t": 30, "b": 0}
    return look


def wires() -> list[Trace]:
    """The sphere as parallels and meridians, which hide nothing behind them."""
    t = np.linspace(0, 2 * np.pi, 61)
    gap = [np.nan]
    x, y, z = [], [], []
    for latitude in np.deg2rad([-60, -30, 0, 30, 60]):
        x += [*(np.cos(latitude) * np.cos(t)), *gap]
        y += [*(np.cos(latitude) * np.sin(t)), *gap]
        z += [*np.full(t.size, np.sin(latitude)), *gap]
    for longitude in np.deg2rad([0, 30, 60, 90, 120, 150]):
        x += [*(np.cos(t) * np.cos(longitude)), *gap]
        y += [*(np.cos(t) * np.sin(longitude)), *gap]
        z += [*np.sin(t), *gap]
    line = {"color": "var(--sphere)", "width": 1}
    return [quiet(x=numbers(x), y=numbers(y), z=numbers(z), mode="lines", line=line)]


def tripod(names: Sequence[str] = "xyz") -> list[Trace]:
    """Three axes from the middle of the sphere, with their `names`."""
    out: list[Trace] = []
    for i, name in enumerate(names):
        tip = [0.0, 0.0, 0.0]
        tip[i] = 1.25
        ends = {a: [0.0, tip[k]] for k, a in enumerate("xyz")}
        out.append(
            quiet(
                **ends,
                mode="lines+text",
                line={"color": SOFT, "width": 3},
                text=["", name],
                textfont={"color": "var(--ink)", "size": 14},
            )
        )
    return out


def quiet(**trace: Any) -> Trace:
    """A trace in space that says nothing under the pointer."""
    return {"type": "scatter3d", "hoverinfo": "skip", "showlegend": False, **trace}


def flat_map(
    up: FloatArray,
    missing: FloatArray,
    words: Sequence[str],
    also: FloatArray | None = None,
    names: tuple[str, str] = ("visited", ""),
) -> Figure:
    """Draw the same directions on two discs; `words` name the missing ones."""
    one = "rest" if names[0] == "visited" else names[0]
    rests = [f"{one} {k + 1}" for k in range(len(up))]
    data: list[Trace] = []
    shapes: list[Trace] = []
    for half, (sign, ref) in enumerate(((1, ""), (-1, "2"))):
        on = {"xaxis": f"x{ref}", "yaxis": f"y{ref}", "showlegend": half == 0}
        if also is not None:
            spins = [f"{names[1]} {k + 1}" for k in range(len(also))]
            data.append(_dots(also, spins, sign, names[1], SECOND, "circle-open") | on)
            data[-1]["marker"] |= {"size": 15}
        data.append(_dots(up, rests, sign, names[0], FIRST, "circle") | on)
        if len(missing):
            data.append(_dots(missing, words, sign, "missing", BAD, "diamond-open") | on)
        shapes += disc(ref)
    notes = [
        {"text": text, "x": x, "y": y, "xref": f"x{r}", "yref": f"y{r}", "showarrow": False}
        for r, half in (("", "z up"), ("2", "z down"))
        for text, x, y in (("x", 1.13, 0), ("y", 0, 1.13), (f"<b>{half}</b>", 0, -1.2))
    ]
    look = discs(shapes=shapes, annotations=notes)
    look["legend"] = look["legend"] | {"traceorder": "reversed" if also is not None else "normal"}
    alt = f"Map of the sphere with {len(up)} directions visited and {len(missing)} missing"
    return Figure(data, look, "Equal-area map, both halves seen from +z.", share=62, alt=alt)


def discs(height: int = HEIGHT, **more: Any) -> dict[str, Any]:
    """Return the look of two discs side by side of `height` [px], with `more` layout keys."""
    bare = {"visible": False, "range": [-1.27, 1.27]}
    look = layout(
        height,
        xaxis=bare | {"domain": [0, 0.47]},
        yaxis=bare | {"scaleanchor": "x"},
        xaxis2=bare | {"domain": [0.53, 1], "anchor": "y2"},
        yaxis2=bare | {"scaleanchor": "x2", "anchor": "x2"},
        meta={"ratio": 0.62},  # a narrow screen needs less height
        **more,
    )
    look["margin"] = {"l": 0, "r": 0, "t": 30, "b": 0}
    return look


def _dots(
    points: FloatArray, words: Sequence[str], sign: int, name: str, colour: str, symbol: str
) -> Trace:
    z = points[:, 2] * sign
    pick = (z >= 0) if sign > 0 else (z > 0)
    flat = flattened(points[pick], z[pick])
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "legendgroup": name,
        "x": numbers(flat[:, 0]),
        "y": numbers(flat[:, 1]),
        "text": [w for w, p in zip(words, pick, strict=True) if p],
        "marker": {
            "color": colour,
            "size": 9,
            "symbol": symbol,
            "line": {"width": 2 if symbol.endswith("open") else 0},
        },
        "hovertemplate": "%{text}<extra></extra>",
    }


def flattened(points: FloatArray, z: FloatArray) -> FloatArray:
    """Return the places of directions, shape (n, 3), on the disc of their height `z` >= 0."""
    return np.asarray(points[:, :2] / np.sqrt(1 + z)[:, None])  # radius sqrt(1 - |z|)


def disc(ref: str) -> list[Trace]:
    """The rim and the circles 30 and 60 deg below the pole."""
    radii = [1.0, *np.sqrt(1 - np.cos(np.deg2rad([60.0, 30.0])))]
    line = {"color": "var(--sphere)", "width": 1}
    place = {"type": "circle", "xref": f"x{ref}", "yref": f"y{ref}", "layer": "below"}
    circles = [
        place | {"x0": -r, "x1": r, "y0": -r, "y1": r, "line": line, "fillcolor": "rgba(0,0,0,0)"}
        for r in map(float, radii)
    ]
    cross = [
        place | {"type": "line", "x0": -a, "x1": a, "y0": -b, "y1": b, "line": line}
        for a, b in ((1.0, 0.0), (0.0, 1.0))
    ]
    return circles + cross
