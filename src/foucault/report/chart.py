"""Figures as plain dictionaries for plotly.js, drawn by one function; colours name the styles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.report.page import GREEK, Figure, data_file

Trace = dict[str, Any]

FIRST, SECOND, THIRD = "var(--first)", "var(--second)", "var(--third)"
SOFT, FAINT, INK, BAND = "var(--soft)", "var(--faint)", "var(--ink)", "var(--band)"
WARNING, BAD = "var(--warning)", "var(--bad)"
SERIES = (FIRST, SECOND, THIRD, "var(--fourth)", "var(--fifth)", "var(--sixth)")
OF_AXES = dict(zip("xyz", SERIES, strict=False))
SCALE = [[0, "var(--low)"], [0.5, "var(--zero)"], [1, "var(--high)"]]

AXIS = {
    "gridcolor": "var(--line)",
    "linecolor": FAINT,
    "zeroline": False,
    "ticks": "outside",
    "tickcolor": "var(--line)",
    "automargin": True,
    "exponentformat": "power",
    "title": {"standoff": 8},
}
LOOK = {
    "template": {"layout": {"xaxis": AXIS, "yaxis": AXIS}},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "font": {
        "family": "system-ui, -apple-system, Segoe UI, Roboto, sans-serif",
        "size": 12.5,
        "color": SOFT,
    },
    "hoverlabel": {"bgcolor": "var(--card)", "bordercolor": "var(--line)", "font": {"color": INK}},
    "dragmode": False,
}
LEGEND = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom", "xanchor": "left"}
"""The look shared by all figures."""

GAP = 0.08  # Between panels, of the height [1].


def numbers(values: npt.ArrayLike) -> list[float | None]:
    """Return numbers for JSON, to the six digits a screen can show; None where not finite."""
    array = np.asarray(values, float).ravel()
    told = zip(array.tolist(), np.isfinite(array).tolist(), strict=True)
    return [_plain(f"{v:.6g}") if finite else None for v, finite in told]


def _plain(text: str) -> float:
    """Return a number that JSON writes without a point where it is whole."""
    number = float(text)
    return int(number) if number.is_integer() and abs(number) < 1e15 else number


def short(values: npt.ArrayLike) -> list[float | None]:
    """Return numbers for JSON to three digits."""
    return [
        _plain(f"{v:.3g}") if np.isfinite(v) else None for v in np.asarray(values, float).ravel()
    ]


def lowered(symbol: str) -> str:
    """Write a symbol for a figure, its index lowered."""
    letter, _, index = symbol.partition("_")
    letter = GREEK.get(letter, letter)
    return f"{letter}<sub>{index}</sub>" if index else letter


# -- traces ----------------------------------------------------------------------------------


def _trace(kind: str, name: str, x: Any, y: Any, hover: str | None, more: Trace) -> Trace:
    """`hover` is what the pointer says, after a bar what stands beside it; None for nothing."""
    if hover is None:
        said: Trace = {"hoverinfo": "skip"}
    else:
        text, _, beside = hover.partition("|")
        said = {"hovertemplate": f"{text}<extra>{beside}</extra>"}
    named = {"name": name} if name else {"showlegend": False}
    return {"type": kind, "x": _shown(x), "y": _shown(y)} | named | said | more


def _shown(values: Any) -> list[Any]:
    """Return a list for JSON: names, and numbers that are lists already, stay as they are."""
    return values if isinstance(values, list) else numbers(values)


def dots(
    name: str,
    x: Any,
    y: Any,
    colour: str = FIRST,
    hover: str | None = None,
    *,
    size: float = 8,
    symbol: Any = "circle",
    marker: Trace | None = None,
    **more: Any,
) -> Trace:
    """Return points; `symbol` is one or one for each."""
    look = {"color": colour, "size": size, "symbol": symbol} | (marker or {})
    return _trace("scatter", name, x, y, hover, {"mode": "markers", "marker": look} | more)


def line(
    name: str,
    x: Any,
    y: Any,
    colour: str = FIRST,
    hover: str | None = None,
    *,
    width: float = 1.8,
    dash: str = "solid",
    shape: str = "linear",
    **more: Any,
) -> Trace:
    """Return a line; None in `y` breaks it."""
    look = {"color": colour, "width": width, "dash": dash, "shape": shape}
    return _trace("scatter", name, x, y, hover, {"mode": "lines", "line": look} | more)


def lines(
    x: Any, some: Mapping[str, Any], hover: str, colours: Iterable[str] = SERIES, **more: Any
) -> list[Trace]:
    """Return a line for each of `some`, name -> y, each in a colour; the pointer says its name."""
    each = zip(some.items(), colours, strict=False)
    return [line(name, x, y, colour, f"{hover}|{name}", **more) for (name, y), colour in each]


def band(name: str, x: FloatArray, low: FloatArray, high: FloatArray, **more: Any) -> Trace:
    """Return a shaded band between two lines, where both are known."""
    known = np.isfinite(low) & np.isfinite(high)
    x, low, high = x[known], low[known], high[known]
    around, edge = np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]])
    return area(name, around, edge, **more)


def area(name: str, x: Any, y: Any, **more: Any) -> Trace:
    """Return a shaded area within a line."""
    fill = {"mode": "lines", "fill": "toself", "fillcolor": BAND, "line": {"width": 0}}
    return _trace("scatter", name, x, y, None, fill | more)


def bars(name: str, x: Any, y: Any, colour: Any, hover: str | None, **more: Any) -> Trace:
    """Return bars, upright unless `orientation` is "h"."""
    marker = {"color": colour} | more.pop("marker", {})
    return _trace("bar", name, x, y, hover, {"marker": marker} | more)


def heat(x: list[str], y: list[str], z: FloatArray, hover: str, top: float, **bar: Any) -> Trace:
    """Return a matrix of colours from -`top` to `top`."""
    look = {"zmin": -top, "zmax": top, "colorscale": SCALE, "xgap": 1, "ygap": 1}
    scale = {"thickness": 10, "outlinewidth": 0} | bar
    rows = {"z": [numbers(row) for row in z], "colorbar": scale}
    return _trace("heatmap", "", x, y, hover, look | rows)


def whiskers(reach: npt.ArrayLike, colour: str, width: float = 0, thickness: float = 1.2) -> Trace:
    """Return error bars of so much on each side, as the `error_y` of a trace."""
    look = {"color": colour, "thickness": thickness, "width": width}
    return {"type": "data", "array": numbers(reach)} | look


# -- axes, lines and words of a figure -------------------------------------------------------


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Return an axis with `title`."""
    return {"title": {"text": title}, **more}


def log_axis(title: str, **more: Any) -> dict[str, Any]:
    """Return a logarithmic axis with a mark for every power of ten."""
    return axis(title, type="log", dtick=1, **more)


def count_axis(what: str, n: int, ticks: float) -> dict[str, Any]:
    """Return an axis that counts `what` from 1 to `n` with about `ticks` ticks."""
    return axis(what, tick0=1, dtick=max(1, round(n / ticks)), range=[0.2, n + 0.8])


def names_axis(names: Sequence[str], size: float = 11.5, room: float = 0.5) -> dict[str, Any]:
    """Return an axis of names, the first on top."""
    return {
        "type": "category",
        "categoryorder": "array",
        "categoryarray": list(names),
        "range": [len(names) - 1 + room, -room],
        "tickmode": "linear",
        "ticks": "",
        "tickfont": {"size": size},
    }


def level(y: float, ref: str = "y", colour: str = SOFT) -> Trace:
    """Return a line across the whole plot: solid at zero, else dashed."""
    look = {"color": colour, "width": 1.3, "dash": "dash" if y else "solid"}
    place = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": ref, "y0": y, "y1": y}
    return place | {"line": look}


def upright(x: float, dash: str = "dash", colour: str = SOFT, **more: Any) -> Trace:
    """Return a line from bottom to top of the plot."""
    x = float(f"{x:.6g}")
    look = {"color": colour, "width": 1.3, "dash": dash}
    place = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": x, "x1": x}
    return place | {"line": look} | more


def marked(times: Iterable[float]) -> list[Trace]:
    """Return a thin line at every one of some times [s], down the whole figure."""
    thin = {"color": FAINT, "width": 1, "dash": "dot"}
    place = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    return [place | {"x0": t, "x1": t, "line": thin} for t in times]


def shaded(
    spans: Iterable[tuple[float, float]], along: str = "x", colour: str = BAND
) -> list[Trace]:
    """Return a shaded part of the plot for each span along an axis."""
    across = "y" if along == "x" else "x"
    look: Trace = {"type": "rect", "fillcolor": colour, "line": {"width": 0}, "layer": "below"}
    look |= {f"{across}ref": "paper", f"{across}0": 0, f"{across}1": 1}
    return [look | {f"{along}0": a, f"{along}1": b} for a, b in spans]


def titled(text: str, up: float = 4) -> Trace:
    """Return a title over the left edge of a figure, `up` [px]."""
    return {
        "text": text,
        "x": 0,
        "xref": "paper",
        "xanchor": "left",
        "y": 1,
        "yref": "paper",
        "yanchor": "bottom",
        "yshift": up,
        "showarrow": False,
        "font": {"color": INK, "size": 13},
    }


def noted(text: str, x: float, anchor: str = "center", **more: Any) -> Trace:
    """Return words above the plot at a place along its width, or along the axis "x"."""
    place = {"text": text, "x": x, "xref": "paper", "xanchor": anchor, "y": 1, "yref": "paper"}
    return place | {"yanchor": "bottom", "showarrow": False} | more


# -- figures ---------------------------------------------------------------------------------


def draw(key: str, data: Sequence[Trace], **more: Any) -> Figure:
    """Return a figure with the look that figures.toml has for `key`; `more` comes on top of it."""
    return _drawn(data, **_looks(key) | more)


def _looks(key: str) -> dict[str, Any]:
    module, _, name = key.partition(".")
    look: dict[str, Any] = data_file("figures.toml")[module][name]
    return look


def _drawn(
    data: Sequence[Trace],
    height: float,
    x: str | Trace | None = None,
    y: str | Trace | None = None,
    *,
    alt: str = "",
    caption: str = "",
    share: int = 100,
    on: str = "everywhere",
    lines: Iterable[float] = (),
    shapes: Sequence[Trace] = (),
    notes: Sequence[Trace] = (),
    top: float = 34,
    zoom: bool = False,
    meta: Trace | None = None,
    legend: bool | Trace | None = None,
    margin: Trace | None = None,
    **more: Any,
) -> Figure:
    """Return a figure of `height` [px] with room of `top` [px] above it.

    `lines` are levels of the lower y axis; `zoom` lets the pointer choose a part; `more` are keys
    of the layout.
    """
    axes = {"xaxis": x, "yaxis": y}
    look: dict[str, Any] = {"height": height} | LOOK
    look |= {k: _axis(v) for k, v in axes.items() if v is not None}
    look["margin"] = {"l": 8, "r": 8, "t": top, "b": 8} | (margin or {})
    look["legend"] = LEGEND | (legend if isinstance(legend, dict) else {})
    if isinstance(legend, bool):
        look["showlegend"] = legend
    drawn = [*(level(v) for v in lines), *shapes]
    meta = (meta or {}) | ({"zoom": True} if zoom else {})
    extra = {"shapes": drawn, "annotations": list(notes), "meta": meta}
    look |= {k: v for k, v in extra.items() if v} | more
    return Figure(list(data), look, caption, on, share, alt)


def _axis(look: str | Trace) -> Trace:
    """Return an axis from its title, or from its look with one."""
    if isinstance(look, str):
        return axis(look)
    return axis(**look) if isinstance(look.get("title"), str) else look


@dataclass(frozen=True)
class Family:
    """Coefficients that are drawn together, in one unit."""

    name: str  # of the group, shape ()
    members: tuple[str, ...]  # names of its columns
    labels: tuple[str, ...]  # how each is called in the figure
    unit: str  # as people write it, shape ()
    size: float  # one unit [SI]

    def of(self, some: Mapping[str, Any], more: str = "") -> list[FloatArray]:
        """Return the columns of a table in the unit of the family, each (n,)."""
        return [np.asarray(some[f"{m}{more}"], float) / self.size for m in self.members]


@dataclass(frozen=True)
class Panel:
    """One of several diagrams that share an axis: `look` is more of its own axis."""

    title: str
    data: Sequence[Trace]
    look: Mapping[str, Any] = field(default_factory=dict)
    lines: Sequence[float] = ()  # levels across it


def stacked(
    key: str, some: Sequence[Panel], *, gap: float = GAP, heights: Sequence[float] = (), **more: Any
) -> Figure:
    """Return panels above one another on one x axis, the uppermost first; a name is said once.

    `heights` are those of the panels, over that of all of them; alike where there are none. The
    rest is as in `draw`.
    """
    more = _looks(key) | more
    gap, heights = more.pop("gap", gap), more.pop("heights", heights)
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    levels: list[Trace] = []
    seen: set[str] = set()
    n = len(some)
    domains = parts(heights[::-1] or [1 / n] * n, gap)
    for k, panel in enumerate(some):
        ref, domain = f"y{n - k if n - k > 1 else ''}", domains[n - 1 - k]
        for trace in panel.data:
            name = trace.get("name", "")
            once = {"legendgroup": name, "showlegend": name not in seen} if name else {}
            data.append(once | trace | {"yaxis": ref})
            seen.add(name)
        axes[ref.replace("y", "yaxis")] = axis(panel.title, domain=domain, **panel.look)
        levels += [level(v, ref) for v in panel.lines]
    shapes = [*levels, *more.pop("shapes", ())]
    x = {"anchor": "y"} | _axis(more.pop("x"))
    return _drawn(data, **more | axes | {"x": x, "shapes": shapes})


def parts(sizes: Sequence[float], gap: float) -> list[list[float]]:
    """Return the ends of parts of a length of 1, so far apart, as large as `sizes` say."""
    free = 1 - gap * (len(sizes) - 1)
    out, start = [], 0.0
    for size in sizes:
        out.append([round(start, 4), round(min(start + free * size, 1.0), 4)])
        start += free * size + gap
    return out


def ref(letter: str, k: int) -> str:
    """Return the name of an axis, the first without a number."""
    return letter if k == 0 else f"{letter}{k + 1}"


# -- figures of several subjects -------------------------------------------------------------


def shares(labels: Sequence[str], share: Mapping[str, FloatArray], alt: str) -> Figure:
    """Draw the `share` [percent] of each source in the variance of what has these labels."""
    edge: Trace = {"line": {"color": "var(--card)", "width": 1}}
    data = [
        bars(
            source,
            values,
            list(labels),
            SERIES[k % len(SERIES)],
            f"%{{y}}: %{{x:.1f}} %|{source}",
            orientation="h",
            # A source beyond the colours has one of them again, paler.
            marker=edge | ({"opacity": 0.45} if k >= len(SERIES) else {}),
        )
        for k, (source, values) in enumerate(share.items())
    ]
    rows = {"type": "category", "autorange": "reversed", "tickmode": "linear", "ticks": ""}
    high = 90 + 20 * max(len(labels), 5)
    # Where it is narrow, the legend has a row for each source, and half of the figure at most.
    return draw(
        "chart.shares",
        data,
        height=high,
        meta={"narrow": {"height": max(high + 20 * len(data), 40 * len(data))}},
        y=rows | {"tickfont": {"size": 13}},
        alt=alt,
    )


def parted(
    names: Sequence[str], values: FloatArray, some: Iterable[tuple[Any, str, str, str]], hover: str
) -> list[Trace]:
    """Return a dot for each name in a row of its own: `some` are rows, word, colour, symbol."""
    return [
        dots(
            word, values[rows], [n for n, p in zip(names, rows, strict=True) if p], colour, hover,
            size=9, symbol=symbol,
        )
        for rows, word, colour, symbol in some if rows.any()
    ]  # fmt: skip


FULL = 0.99  # Robust weight above which an observation counts in full [1].


def weighed(x: FloatArray, y: FloatArray, weight: Any, what: str, place: str) -> list[Trace]:
    """Dots, and diamonds where a robust weight is less than 1."""
    weight = np.asarray(weight, float)
    full, number = weight > FULL, np.arange(1, len(x) + 1)
    groups = [(full, FIRST, "circle", "used in full"), (~full, SECOND, "diamond", "weighted down")]
    hover = f"{what} %{{customdata[0]}}, {place}: %{{y:.2f}} sd, weight %{{customdata[1]:.2f}}"
    return [
        dots(
            name,
            x[pick],
            y[pick],
            colour,
            hover,
            symbol=symbol,
            legendgroup=name,
            customdata=[
                [int(n), w] for n, w in zip(number[pick], numbers(weight[pick]), strict=True)
            ],
        )
        for pick, colour, symbol, name in groups
        if pick.any()
    ]


def within(y: FloatArray, limit: float) -> tuple[list[float], list[float]]:
    """The range of an axis that shows all of `y` and its limits, and the limits."""
    top = 1.12 * max(limit, float(np.max(np.abs(y[np.isfinite(y)]), initial=0.0)))
    negative = bool((y < 0).any())
    return [-top if negative else 0.0, top], [limit, *([-limit] if negative else [])]


def residuals(time: Any, y: FloatArray, weight: Any, what: str, limit: float) -> Figure:
    """Draw standardized residuals against `time` [s]; filled less where the weight is less."""
    span, limits = within(y, limit)
    return draw(
        "chart.residuals",
        weighed(np.asarray(time, float), y, weight, what, "%{x:.1f} s"),
        y=axis(f"{what}: residual / sd", range=span),
        lines=limits,
        alt=f"Standardized residual of every {what} against time, with limits of {limit:g} sd",
    )


def detection(
    table: Mapping[str, FloatArray], threshold: float | None, rests: Sequence[tuple[float, float]]
) -> Figure:
    """Draw the moving standard deviation over time with its threshold, rests shaded."""
    names = (("accel_level", "accelerometers", FIRST), ("gyro_level", "gyros", SECOND))
    x = np.asarray(table["time"], float)
    data = [
        line(
            name,
            x,
            np.where(np.asarray(table[column]) > 0, table[column], np.nan),
            colour,
            f"%{{x:.1f}} s: %{{y:.3g}}|{name}",
            width=1.1,
        )
        for column, name, colour in names
        if column in table
    ]
    return draw(
        "chart.detection",
        data,
        shapes=[
            *shaded(rests, colour="var(--rest)"),
            *([] if threshold is None else [level(threshold)]),
        ],
    )


def time_unit(seconds: float) -> tuple[str, float]:
    """Return the unit in which a run of so many `seconds` is drawn, and its size [s]."""
    if seconds > 6 * 3600:
        return "h", 3600.0
    return ("min", 60.0) if seconds > 300 else ("s", 1.0)


def length_unit(metres: float) -> tuple[str, float]:
    """Return the unit in which distances of up to so many `metres` are drawn, and its size [m]."""
    if not np.isfinite(metres) or metres >= 5000:
        return "km", 1000.0
    return ("m", 1.0) if metres >= 0.5 else ("mm", 1e-3)


def largest(*drawn: FloatArray) -> float:
    """Return the largest size of what is drawn on one axis, bands and outlines too [any]."""
    return max(float(np.nanmax(np.abs(v), initial=0.0)) for v in drawn)


POINTS = 1500  # Points that a line is drawn with [1].


def thinned(n: int) -> IntArray:
    """Return the rows of `n` that are drawn, the last one among them."""
    step = -(-n // POINTS)
    return np.arange(n)[::-1][::step][::-1]


def ellipse(cov: FloatArray, times: float = 2.0) -> FloatArray:
    """Return the outline, shape (2, 61), of so many standard deviations of a `cov`, (2, 2)."""
    values, axes = np.linalg.eigh(cov)
    angle = np.linspace(0, 2 * np.pi, 61)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(times * axes @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle))


def paths(
    lines: Sequence[tuple[str, FloatArray, FloatArray, str, str]],
    ellipses: Sequence[tuple[float, float, FloatArray]],
    marks: Sequence[tuple[str, float, float]],
    caption: str,
    share: int = 100,
    what: str = "",
    predicted: str = "predicted",
) -> Figure:
    """Draw paths [m], east to the right, on equal axes.

    `lines` are name, east, north, colour and dash; `ellipses` centre and covariance [m^2], drawn
    for two standard deviations; `marks` text and place of ages.
    """
    edges = [ellipse(cov) for _, _, cov in ellipses]
    drawn = [v for line in lines for v in line[1:3]]
    for (east, north, _), (x, y) in zip(ellipses, edges, strict=True):
        drawn += [east + x, north + y]
    unit, size = length_unit(max((largest(v) for v in drawn), default=1.0))
    data: list[Trace] = []
    for k, ((east, north, _), (x, y)) in enumerate(zip(ellipses, edges, strict=True)):
        data.append(
            area(
                f"±2 sd, {predicted}",
                (east + x) / size,
                (north + y) / size,
                line={"color": FIRST, "width": 1},
                showlegend=k == 0,
                legendgroup="ellipse",
            )
        )
    for name, e, n, colour, dash in lines:
        rows = thinned(len(e))
        hover = f"%{{x:.4g}} east, %{{y:.4g}} {unit} north|{name}"
        data.append(line(name, e[rows] / size, n[rows] / size, colour, hover, width=2.2, dash=dash))
    if marks:
        east, north = np.array([m[1:] for m in marks]).T / size
        data.append(
            dots(
                "",
                east,
                north,
                size=6,
                mode="markers+text",
                text=[f" {m[0]}" for m in marks],
                textposition="middle right",  # a path goes on above and below a point as a rule
                cliponaxis=False,
                textfont={"color": SOFT, "size": 11.5},
            )
        )
    cross = {"line": {"color": INK, "width": 2}}
    data.append(dots("start", [0], [0], INK, size=9, symbol="x-thin", marker=cross))
    return draw(
        "chart.paths",
        data,
        x=axis(f"{what}east [{unit}]", constrain="domain"),
        y=axis(f"{what}north [{unit}]", scaleanchor="x", scaleratio=1, constrain="domain"),
        caption=caption,
        share=share,
    )
