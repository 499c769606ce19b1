"""Directions and ways on a sphere: a ball to turn, and a flat map for print.

Directions of up in body axes, one point per rest, or where the axes of a cluster pointed. The map
is two discs of equal area (Lambert's projection), both seen from above, so that a direction on the
rim stands at the same place in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.report import chart
from foucault.report.page import Figure

HEIGHT = 330  # of both pictures, which stand side by side [px]
FLAT = {"l": 0, "r": 0, "t": 30, "b": 0}
WAYS = ("east", "north", "up")


def directions(
    up: FloatArray,
    missing: FloatArray,
    words: Sequence[str],
    also: FloatArray | None = None,
    names: tuple[str, str] = ("visited", ""),
) -> list[Figure]:
    """Draw directions, shape (n, 3), and missing ones, shape (m, 3), which have `words`.

    `also` are directions of another kind, shape (k, 3), as rings; `names` says what both kinds are.
    """
    one = "rest" if names[0] == "visited" else names[0]
    kinds = [
        (up, names[0], chart.FIRST, "circle", 5, 9, [f"{one} {k + 1}" for k in range(len(up))])
    ]
    if also is not None:
        rings = [f"{names[1]} {k + 1}" for k in range(len(also))]
        kinds.insert(0, (also, names[1], chart.SECOND, "circle-open", 10, 15, rings))
    if len(missing):
        kinds.append((missing, "missing", chart.BAD, "diamond-open", 7, 9, list(words)))
    order = {"traceorder": "reversed" if also is not None else "normal"}
    ball = [
        _in_space(
            points,
            mode="markers",
            name=name,
            customdata=list(range(1, len(points) + 1)),
            marker={"color": colour, "symbol": symbol, "size": near},
            hovertemplate=f"{name} %{{customdata}}<extra></extra>",
        )
        for points, name, colour, symbol, near, _, _ in kinds
        if len(points)
    ]

    def half(sign: int, on: chart.Trace) -> list[chart.Trace]:
        out = []
        for points, name, colour, symbol, _, size, said in kinds:
            pick = _of_half(points, sign)
            x, y = flattened(points[pick], sign * points[pick, 2]).T
            text = [w for w, p in zip(said, pick, strict=True) if p]
            edge = {"line": {"width": 2 if symbol.endswith("open") else 0}}
            out.append(
                chart.dots(
                    name,
                    x,
                    y,
                    colour,
                    "%{text}|",
                    symbol=symbol,
                    size=size,
                    text=text,
                    marker=edge,
                    legendgroup=name,
                    **on,
                )
            )
        return out

    many = f"with {len(up)} directions visited and {len(missing)} missing"
    return [
        _ball(ball, "xyz", f"Sphere {many}", "Turn it with the pointer.", order),
        _map(
            half,
            ("x", "y", "z up", "z down"),
            f"Map of the sphere {many}",
            "Equal-area map, both halves seen from +z.",
            order,
        ),
    ]


def ways(table: Mapping[str, FloatArray]) -> list[Figure]:
    """Draw the ways of the cluster axes in the course of time, East-North-Up."""
    tips = {
        a: np.column_stack([table[f"{a}.{w}"] for w in WAYS]).astype(float) for a in chart.OF_AXES
    }
    time = chart.numbers(np.round(table["time"]))
    ball: list[chart.Trace] = []
    for a, colour in chart.OF_AXES.items():
        same = {"legendgroup": a, "name": a}
        said = f"{a} axis, %{{customdata}} s<extra></extra>"
        ball.append(
            _in_space(
                tips[a],
                mode="lines",
                line={"color": colour, "width": 5},
                customdata=time,
                hovertemplate=said,
                **same,
            )
        )
        marks = {
            "color": colour,
            "size": [6, 5],
            "symbol": ["circle-open", "circle"],
            "line": {"color": colour, "width": 2},
        }
        ball.append(_quiet(tips[a][[0, -1]], mode="markers", marker=marks, **same))

    def half(sign: int, on: chart.Trace) -> list[chart.Trace]:
        out: list[chart.Trace] = []
        for a, colour in chart.OF_AXES.items():
            flat = np.full((len(time), 2), np.nan)  # a line that breaks where it leaves this half
            seen = sign * tips[a][:, 2] >= 0
            flat[seen] = flattened(tips[a][seen], sign * tips[a][seen, 2])
            out.append(
                chart.line(
                    a,
                    flat[:, 0],
                    flat[:, 1],
                    colour,
                    f"{a} axis, %{{customdata}} s|",
                    width=2.5,
                    customdata=time,
                    legendgroup=a,
                    **on,
                )
            )
            ends = tips[a][[0, -1]]
            pick = _of_half(ends, sign)
            x, y = flattened(ends[pick], sign * ends[pick, 2]).T
            symbols = [s for s, p in zip(("circle-open", "circle"), pick, strict=True) if p]
            sizes = {
                "size": [12 if s == "circle-open" else 9 for s in symbols],
                "line": {"color": colour, "width": 2},
            }
            out.append(
                chart.dots(
                    "",
                    x,
                    y,
                    colour,
                    symbol=symbols,
                    marker=sizes,
                    legendgroup=a,
                    **on | {"showlegend": False},
                )
            )
        return out

    caption = "Ring: at the start; dot: at the end."
    return [
        _ball(
            ball,
            "ENU",
            "Way of the tips of the three cluster axes on a sphere, East, North and Up marked",
            f"{caption} Turn it with the pointer.",
        ),
        _map(
            half,
            ("E", "N", "upper half", "lower half"),
            "Map of the ways of the three cluster axes, upper and lower half of the sphere",
            f"Equal-area map, both halves seen from above. {caption} An axis on the rim is level.",
        ),
    ]


def _of_half(points: FloatArray, sign: int) -> BoolArray:
    """Which directions lie in the upper half, 1, or the lower, -1; on the rim they are upper."""
    return np.asarray(points[:, 2] >= 0 if sign > 0 else points[:, 2] < 0)


def flattened(points: FloatArray, z: FloatArray) -> FloatArray:
    """Return the places of directions, shape (n, 3), on the disc of their height `z` >= 0."""
    return np.asarray(points[:, :2] / np.sqrt(1 + z)[:, None])  # radius sqrt(1 - |z|)


def _in_space(points: FloatArray, **more: Any) -> chart.Trace:
    x, y, z = (chart.numbers(c) for c in np.asarray(points, float).reshape(-1, 3).T)
    return {"type": "scatter3d", "x": x, "y": y, "z": z, **more}


def _quiet(points: FloatArray, **more: Any) -> chart.Trace:
    """A trace in space that says nothing under the pointer."""
    return _in_space(points, hoverinfo="skip", showlegend=False, **more)


def _ball(
    data: Sequence[chart.Trace],
    names: str,
    alt: str,
    caption: str,
    legend: chart.Trace | None = None,
) -> Figure:
    """A ball of wires with three axes, in a cube to turn."""
    t = np.linspace(0, 2 * np.pi, 61)
    c, s, flat = np.cos(t), np.sin(t), np.zeros(t.size)
    parallels, meridians = np.deg2rad([-60, -30, 0, 30, 60]), np.deg2rad(range(0, 180, 30))
    rings = [[np.cos(a) * c, np.cos(a) * s, flat + np.sin(a)] for a in parallels]
    rings += [[c * np.cos(a), c * np.sin(a), s] for a in meridians]
    wires = np.concatenate([np.vstack([np.transpose(r), [[np.nan] * 3]]) for r in rings])
    behind = [_quiet(wires, mode="lines", line={"color": "var(--sphere)", "width": 1})]
    for tip, name in zip(1.25 * np.eye(3), names, strict=True):
        behind.append(
            _quiet(
                np.array([0 * tip, tip]),
                mode="lines+text",
                text=["", name],
                line={"color": chart.SOFT, "width": 3},
                textfont={"color": chart.INK, "size": 14},
            )
        )
    hidden = {"visible": False, "range": [-1.35, 1.35]}
    scene = {
        "xaxis": hidden,
        "yaxis": hidden,
        "zaxis": hidden,
        "aspectmode": "cube",
        "dragmode": "orbit",
        "camera": {"eye": {"x": 0.88, "y": -0.96, "z": 0.6}},
    }
    return chart.draw(
        "orientation.ball",
        [*behind, *data],
        height=HEIGHT,
        scene=scene,
        margin=FLAT,
        alt=alt,
        caption=caption,
        legend=legend,
    )


def _map(
    half: Callable[[int, chart.Trace], list[chart.Trace]],
    names: tuple[str, str, str, str],
    alt: str,
    caption: str,
    legend: chart.Trace | None = None,
) -> Figure:
    """Two discs side by side, each with the traces that `half` makes of its sign and its axes."""
    data: list[chart.Trace] = []
    shapes: list[chart.Trace] = []
    notes: list[chart.Trace] = []
    for sign, ref, title in ((1, "", names[2]), (-1, "2", names[3])):
        data += half(sign, {"xaxis": f"x{ref}", "yaxis": f"y{ref}", "showlegend": sign > 0})
        place = {"xref": f"x{ref}", "yref": f"y{ref}"}
        rim = place | {"layer": "below", "line": {"color": "var(--sphere)", "width": 1}}
        # The rim and the circles 30 and 60 deg below the pole, and a cross.
        for r in (1.0, *np.sqrt(1 - np.cos(np.deg2rad([60.0, 30.0]))).tolist()):
            at = {"x0": -r, "x1": r, "y0": -r, "y1": r, "fillcolor": "rgba(0,0,0,0)"}
            shapes.append(rim | at | {"type": "circle"})
        for a, b in ((1.0, 0.0), (0.0, 1.0)):
            shapes.append(rim | {"type": "line", "x0": -a, "x1": a, "y0": -b, "y1": b})
        for text, x, y in ((names[0], 1.13, 0), (names[1], 0, 1.13), (f"<b>{title}</b>", 0, -1.2)):
            notes.append(place | {"text": text, "x": x, "y": y, "showarrow": False})
    bare = {"visible": False, "range": [-1.27, 1.27]}
    return chart.draw(
        "orientation.map",
        data,
        height=HEIGHT,
        x=bare | {"domain": [0, 0.47]},
        y=bare | {"scaleanchor": "x"},
        xaxis2=bare | {"domain": [0.53, 1], "anchor": "y2"},
        yaxis2=bare | {"scaleanchor": "x2", "anchor": "x2"},
        shapes=shapes,
        notes=notes,
        margin=FLAT,
        alt=alt,
        caption=caption,
        legend=legend,
    )
