"""A figure as a still SVG: what shows without a script, on paper, and in a notebook.

It draws the few kinds of trace that chart.py makes, from the same dictionaries. Colours stay names
of the style sheet, so that a drawing follows light and dark like the page around it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report.page import Figure
from foucault.report.scales import Axis, axis_of, bins, ticks

WIDTH = 9.2  # Width of a drawing for each percent of the page that a figure takes [px].
LETTER = 0.56  # Mean width of a letter over its size [1].
SIZE = 12.0  # Height of the letters [px].

DASHES = {
    "dash": "6 4",
    "dot": "1.5 3",
    "dashdot": "6 3 1.5 3",
    "longdash": "10 4",
    "longdashdot": "10 3 1.5 3",
}
SHADES = 8  # Steps of colour on each side of zero [1].

_SYMBOLS = {
    "circle-open": "m-{r} 0a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z",
    "diamond": "m0-{r}l{r} {r}l-{r} {r}l-{r}-{r}z",
    "triangle-up": "m0-{r}l{r} {d}h-{d}z",
    "triangle-down": "m0 {r}l{r}-{d}h-{d}z",
    "x": "m-{r}-{r}l{d} {d}m-{d} 0l{d}-{d}",
    "line-ew": "m-{r} 0h{d}",
    "arrow": "m0-{r}l{r} {d}h-{d}z",
}
_SYMBOLS["x-thin"] = _SYMBOLS["x"]
_THIN = ("x", "x-thin", "line-ew", "circle-open")
_OURS = re.compile(r"<(/?)(b|i|sub|sup)>|<(br)>|<[^>]*>")


def svg(figure: Figure) -> str:
    """Return a figure as SVG; empty for one in space, which says nothing unless it is turned."""
    look = figure.layout
    if "scene" in look:
        return ""
    wide = max(WIDTH * figure.share, 330.0)
    high = min(float(look["height"]), wide * look.get("meta", {}).get("ratio", math.inf))
    choices = look.get("meta", {}).get("choices")
    data = [t for t in figure.data if not choices or t.get("meta") in (None, choices[0])]
    drawn = _compass(data, look, wide, high) if "polar" in look else _plane(data, look, wide, high)
    said = escape(figure.alt or figure.caption)
    return (
        f'<svg class="still" viewBox="0 0 {wide:.0f} {high:.0f}" role="img" aria-label="{said}" '
        f'style="max-width:{1.25 * wide:.0f}px" font-size="{SIZE:g}">{_joined(drawn)}</svg>'
    )


def _joined(drawn: Iterable[str]) -> str:
    """Write pieces after one another; strokes of one look that follow each other become one."""
    out: list[str] = []
    for piece in drawn:
        look, is_path, way = piece.partition('" d="')
        if out and is_path and "fill:none" in look and "opacity" not in look and out[-1].startswith(
            look + is_path):  # fmt: skip
            out[-1] = out[-1].removesuffix('"/>') + way
        else:
            out.append(piece)
    return "".join(out)


# -- words and strokes ------------------------------------------------------------------------


def _width(text: str, size: float = SIZE) -> float:
    return LETTER * size * len(re.sub(r"<[^>]*>", "", text))


def _text(
    x: float,
    y: float,
    text: str,
    anchor: str = "middle",
    colour: str = "var(--soft)",
    size: float = SIZE,
    turned: float = 0,
) -> str:
    """Words of a figure, with the few tags that they may have."""
    turn = f' transform="rotate({turned:g} {x:.1f} {y:.1f})"' if turned else ""
    large = "" if size == SIZE else f' font-size="{size:g}"'
    spans = {
        "b": '<tspan font-weight="600">',
        "i": '<tspan font-style="italic">',
        "sub": '<tspan baseline-shift="sub" font-size="80%">',
        "sup": '<tspan baseline-shift="super" font-size="80%">',
    }
    out, last, open_spans = [], 0, 0
    for tag in _OURS.finditer(text):
        out.append(escape(text[last : tag.start()]))
        last = tag.end()
        if tag[3]:
            out.append(f'<tspan x="{x:.1f}" dy="1.2em">\u200b</tspan>')
        elif tag[2] and not tag[1]:
            out.append(spans[tag[2]])
            open_spans += 1
        elif tag[2] and open_spans:
            out.append("</tspan>")
            open_spans -= 1
        elif not tag[2]:
            out.append(escape(tag[0]))
    out.append(escape(text[last:]) + "</tspan>" * open_spans)
    paint = f'style="fill:{escape(colour)}" text-anchor="{anchor}"'
    return f'<text x="{x:.1f}" y="{y:.1f}" {paint}{large}{turn}>{"".join(out)}</text>'


def _path(d: str, colour: str, width: float = 1.0, dash: str = "solid", **more: Any) -> str:
    """A stroke, or with `fill` an area; `cap` is how a stroke ends."""
    fill, cap, opacity = (more.get(k, "") for k in ("fill", "cap", "opacity"))
    style = f"stroke:{colour};stroke-width:{width:g};fill:{fill or 'none'}"
    style += f";stroke-dasharray:{DASHES[dash]}" if dash in DASHES else ""
    style += f";stroke-linecap:{cap}" if cap else ""
    style += f";opacity:{opacity:g}" if opacity not in ("", None, 1) else ""
    return f'<path style="{escape(style)}" d="{d}"/>' if d else ""


def _way(x: FloatArray, y: FloatArray, shape: str = "linear", closed: bool = False) -> str:
    """A line through points [px], broken where one is not known; what is too small is left out."""
    out: list[str] = []
    down, last = False, (0, 0)  # [0.1 px]
    end = len(x) - 1
    for k, (p, q) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        if not (math.isfinite(p) and math.isfinite(q)):
            out += ["z"] if closed and down else []
            down = False
            continue
        a, b = round(10 * p), round(10 * q)
        da, db = a - last[0], b - last[1]
        if down and k < end and abs(da) < 5 and abs(db) < 5:
            continue
        if down:
            out.append(f"h{_tenths(da)}v{_tenths(db)}" if shape == "hv" else _step(da, db))
        else:
            out.append(f"M{_tenths(a)} {_tenths(b)}")
        down, last = True, (a, b)
    return "".join(out) + ("z" if closed and down else "")


def _step(da: int, db: int) -> str:
    """A stroke from where the pen is [0.1 px]."""
    return f"l{_tenths(da)}{'' if db < 0 else ' '}{_tenths(db)}"


def _tenths(a: float) -> str:
    """A length as short as SVG can write it [0.1 px]."""
    text = f"{a / 10:.1f}".removesuffix(".0")
    return text.replace("0.", ".", 1) if abs(a) < 9.5 else text


def _marks(trace: Mapping[str, Any], x: FloatArray, y: FloatArray) -> Iterable[str]:
    """The points of a trace, those that look alike in one stroke."""
    look = trace.get("marker", {})
    edge = look.get("line", {})

    def each(key: str, other: Any) -> list[Any]:
        value = look.get(key, other)
        return list(value) if isinstance(value, list | tuple) else [value] * len(x)

    groups: dict[tuple[Any, ...], list[str]] = {}
    rows = zip(x, y, each("color", "var(--first)"), each("size", 8), each("symbol", "circle"),
               strict=False)  # fmt: skip
    for a, b, colour, size, symbol in rows:
        if not (math.isfinite(a) and math.isfinite(b)):
            continue
        if symbol == "circle" and not isinstance(edge.get("color"), list):
            shape = "h0"
        else:
            name = symbol if symbol in _SYMBOLS else symbol.removesuffix("-open")
            r = size / 2
            shape = _SYMBOLS.get(name, _SYMBOLS["circle-open"]).format(r=f"{r:g}", d=f"{size:g}")
        groups.setdefault((str(colour), size, symbol), []).append(
            f"M{_tenths(10 * a)} {_tenths(10 * b)}{shape}")  # fmt: skip
    opacity = look.get("opacity", trace.get("opacity"))
    for (colour, size, symbol), pieces in groups.items():
        stroke = edge.get("color", colour)
        stroke = colour if isinstance(stroke, list) else stroke
        d = "".join(pieces)
        if pieces[0].endswith("h0"):
            yield _path(d, colour, size, cap="round", opacity=opacity)
        elif symbol in _THIN or symbol.endswith("-open"):
            yield _path(d, stroke, edge.get("width", 1.5), opacity=opacity)
        else:
            yield _path(d, stroke, edge.get("width", 0), fill=colour, opacity=opacity)


# -- a plot in the plane ----------------------------------------------------------------------


@dataclass
class _Plot:
    """The axes of a drawing with their pixels, and the box around all of them."""

    axes: dict[str, Axis]
    left: float
    right: float
    top: float
    bottom: float
    out: list[str] = field(default_factory=list)

    def place(self, letter: str, ref: str, values: Any) -> FloatArray:
        """Return pixels of values on an axis, on its "domain", or on the "paper"."""
        if ref == "paper" or ref.endswith(" domain"):
            share = np.asarray(values, float)
            if ref == "paper":
                first, last = (self.left, self.right) if letter == "x" else (self.bottom, self.top)
            else:
                first, last = self.axes[ref.removesuffix(" domain")].pixels
            return np.asarray(first + share * (last - first))
        return self.axes[ref].at(values)


def _plane(data: Sequence[Any], look: Mapping[str, Any], wide: float, high: float) -> list[str]:
    axes = {
        name: axis_of(name, look.get(name.replace(name[0], f"{name[0]}axis"), {}), data, look)
        for name in _axes_used(data, look)
    }
    labels = _legend(data, look, wide)
    scale = next((t["colorbar"] for t in data if t["type"] == "heatmap"), None)
    said = look["margin"]
    ys = [a for a in axes.values() if a.letter == "y" and not a.hidden]
    left = max([said["l"], *(_room(a) for a in ys if a.domain_of_other(axes)[0] < 0.1)]) + 4
    right = wide - max(said["r"], 64.0 if scale else 12.0)
    for a in axes.values():
        if a.letter == "x":
            span = right - left
            a.pixels = (left + span * a.domain[0], left + span * a.domain[1])
    below = max(
        [said["b"], *(_depth(a) for a in axes.values() if a.letter == "x" and not a.hidden)]
    )
    over = look["legend"].get("yanchor") == "bottom"
    rows = 1 + max((row for row, *_ in labels), default=-1)
    top = max(float(said["t"] or 30), 18.0 * rows + 6 if over else 0.0)
    bottom = high - below - (0 if over else 18.0 * rows)
    for a in axes.values():
        if a.letter == "y":
            span = bottom - top
            a.pixels = (bottom - span * a.domain[0], bottom - span * a.domain[1])
    plot = _Plot(axes, left, right, top, bottom)
    _equalised(axes)
    for a in axes.values():
        _grid(plot, a)
    shapes = look.get("shapes", ())
    plot.out += [_shape(plot, s) for s in shapes if s.get("layer") == "below"]
    _bars(plot, [t for t in data if t["type"] in ("bar", "histogram")], look)
    for trace in data:
        if trace["type"] == "heatmap":
            _heat(plot, trace)
        elif trace["type"] == "scatter":
            _scatter(plot, trace)
    plot.out += [_shape(plot, s) for s in shapes if s.get("layer") != "below"]
    for note in look.get("annotations", ()):
        _note(plot, note)
    if "title" in look:
        plot.out.append(_text(4, 14, look["title"]["text"], "start", "var(--ink)", 13))
    base = top - 18.0 * rows + 8 if over else bottom + below + 8
    _write_legend(plot.out, labels, base, look, left, right)
    return plot.out


def _axes_used(data: Sequence[Any], look: Mapping[str, Any]) -> list[str]:
    """Return the names of the axes, as traces call them: x, y2."""
    used = {t.get(f"{letter}axis", letter) for t in data for letter in "xy"}
    used |= {k.replace("axis", "") for k in look if re.fullmatch(r"[xy]axis\d*", k)}
    return sorted(used)


def _room(axis: Axis) -> float:
    """How wide the ticks and the title of an upright axis are [px]."""
    size = axis.look.get("tickfont", {}).get("size", SIZE)
    return max((_width(t, size) for _, t in ticks(axis)), default=0) + 10 + 20 * bool(axis.title)


def _depth(axis: Axis) -> float:
    """How deep the ticks and the title of a level axis are [px]."""
    turned = axis.look.get("tickangle") or (-90 if _crowded(axis) else 0)
    size = axis.look.get("tickfont", {}).get("size", SIZE)
    longest = max((_width(t, size) for _, t in ticks(axis)), default=0)
    lines = max((t.count("<br>") for _, t in ticks(axis)), default=0)
    deep = longest * math.sin(math.radians(abs(turned))) + SIZE if turned else 18.0 + 14 * lines
    return deep + 8 + 18 * bool(axis.title)


def _crowded(axis: Axis) -> bool:
    """Whether the names under an axis run into one another."""
    shown = ticks(axis)
    if axis.names is None or len(shown) < 2 or "tickangle" in axis.look:
        return False
    each = abs(axis.pixels[1] - axis.pixels[0]) / len(shown)
    return max(_width(t) for _, t in shown) > each


def _equalised(axes: Mapping[str, Axis]) -> None:
    """Widen the range of an axis so that a unit is as long on the one it follows."""
    for axis in axes.values():
        other = axes.get(axis.look.get("scaleanchor", ""))
        if other is None:
            continue
        scales = [abs(a.pixels[1] - a.pixels[0]) / (a.span[1] - a.span[0]) for a in (axis, other)]
        least = min(scales)
        for a, scale in zip((axis, other), scales, strict=True):
            middle, half = sum(a.span) / 2, (a.span[1] - a.span[0]) / 2 * scale / least
            a.span = (middle - half, middle + half)


def _grid(plot: _Plot, axis: Axis) -> None:
    """Grid, ticks and title of an axis."""
    if axis.hidden:
        return
    level = axis.letter == "x"
    other = plot.axes.get(axis.anchor)
    across = (
        other.pixels if other else (plot.bottom, plot.top) if level else (plot.left, plot.right)
    )
    edge = across[0]
    size = axis.look.get("tickfont", {}).get("size", SIZE)
    turned = axis.look.get("tickangle") or (-90 if level and _crowded(axis) else 0)
    lines, zero = [], ""
    for value, text in ticks(axis):
        p = float(axis.at([value])[0])
        line = f"M{p:.1f} {across[0]:.1f}V{across[1]:.1f}" if level else (
            f"M{across[0]:.1f} {p:.1f}H{across[1]:.1f}")  # fmt: skip
        if value == 0 and axis.look.get("zeroline"):
            zero = line
        elif axis.look.get("showgrid", True):
            lines.append(line)
        if not axis.look.get("showticklabels", True):
            continue
        if level:
            anchor = "end" if turned else "middle"
            y = edge + (8 if turned else 16)
            plot.out.append(_text(p + (4 if turned else 0), y, text, anchor, size=size,
                                  turned=turned))  # fmt: skip
        else:
            plot.out.append(_text(edge - 6, p + 0.35 * size, text, "end", size=size))
    plot.out.insert(0, _path("".join(lines), "var(--line)"))
    plot.out.append(_path(zero, axis.look.get("zerolinecolor", "var(--faint)")))
    if axis.title:
        middle = sum(axis.pixels) / 2
        if level:
            plot.out.append(_text(middle, edge + _depth(axis) - 6, axis.title))
        else:
            plot.out.append(_text(edge - _room(axis) + 12, middle, axis.title, turned=-90))


def _scatter(plot: _Plot, trace: Mapping[str, Any]) -> None:
    refs = trace.get("xaxis", "x"), trace.get("yaxis", "y")
    x, y = (plot.axes[r].at(trace[k]) for k, r in zip("xy", refs, strict=True))
    mode, line = trace.get("mode", "lines"), trace.get("line", {})
    if "fill" in trace:
        d = _way(x, y, closed=True)
        plot.out.append(_path(d, line.get("color", "none"), line.get("width", 0),
                              fill=trace["fillcolor"]))  # fmt: skip
    elif "lines" in mode:
        d = _way(x, y, line.get("shape", "linear"))
        look = line.get("color", "var(--first)"), line.get("width", 1.8), line.get("dash", "solid")
        plot.out.append(_path(d, *look, opacity=trace.get("opacity")))
    if "error_y" in trace:
        error = trace["error_y"]
        reach = np.array(error["array"], float)
        y0 = np.array(trace["y"], float)
        ends = [plot.axes[refs[1]].at((y0 + s * reach).tolist()) for s in (-1, 1)]
        rows = zip(x, *ends, strict=True)
        d = "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in rows if math.isfinite(a + b + c))
        plot.out.append(_path(d, error["color"], error["thickness"]))
    if "markers" in mode:
        plot.out += _marks(trace, x, y)
    if "text" in mode:
        font = {"color": "var(--soft)", "size": SIZE} | trace.get("textfont", {})
        colours, places = font["color"], trace.get("textposition", "")
        for k, (a, b, text) in enumerate(zip(x, y, trace["text"], strict=False)):
            if text and math.isfinite(a + b):
                colour = colours if isinstance(colours, str) else colours[k]
                place = places if isinstance(places, str) else places[k]
                up = -8 if "top" in place else 4
                anchor, aside = next((w for s, w in SIDES.items() if s in place), ("middle", 0))
                plot.out.append(_text(a + aside, b + up, str(text), anchor, colour, font["size"]))


SIDES = {"right": ("start", 8), "left": ("end", -8)}
"""How words beside a point are anchored, and how far from it they begin [px]."""


def _bars(plot: _Plot, traces: Sequence[Mapping[str, Any]], look: Mapping[str, Any]) -> None:
    """Bars side by side, on top of one another, or each over the others."""
    mode, gap = look.get("barmode", "group"), look.get("bargap", 0.2)
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for trace in traces:
        refs = trace.get("xaxis", "x"), trace.get("yaxis", "y")
        groups.setdefault(refs, []).append(trace)
    for refs, some in groups.items():
        base: dict[float, float] = {}
        for k, trace in enumerate(some):
            flat = trace.get("orientation") == "h"
            along, up = (plot.axes[r] for r in (refs[::-1] if flat else refs))
            at, size, each = _extent(trace, along, flat, gap)
            if mode == "group" and len(some) > 1 and "width" not in trace:
                each = each / len(some)
                at = at + (k - (len(some) - 1) / 2) * each
            start = np.zeros_like(size)
            if mode == "stack":
                start = np.array([base.get(a, 0.0) for a in at.tolist()])
                base |= dict(zip(at.tolist(), (start + np.nan_to_num(size)).tolist(), strict=True))
            corners = (along.of(at - each / 2), along.of(at + each / 2))
            ends = (up.at(start.tolist()), up.at((start + size).tolist()))
            _draw_bars(plot, trace, corners, ends, flat)


def _extent(
    trace: Mapping[str, Any], along: Axis, flat: bool, gap: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the places, the sizes and the widths of bars, each (n,) [the axis]."""
    if trace["type"] == "histogram":
        edges, size = bins(trace)
        return (edges[1:] + edges[:-1]) / 2, size, np.full(size.size, (1 - gap) * np.ptp(edges[:2]))
    names, sizes = ("y", "x") if flat else ("x", "y")
    at = along.numbers(trace[names])
    size = np.array(trace[sizes], float)
    if "width" in trace:
        return at, size, np.broadcast_to(np.asarray(trace["width"], float), at.shape)
    apart = np.diff(np.unique(at))
    return at, size, np.full(at.size, (1 - gap) * (apart.min() if apart.size else 1.0))


def _draw_bars(plot: _Plot, trace: Mapping[str, Any], corners: Any, ends: Any, flat: bool) -> None:
    colour = trace.get("marker", {}).get("color", "var(--first)")
    groups: dict[str, list[str]] = {}
    for k, (a, b, c, d) in enumerate(zip(*corners, *ends, strict=True)):
        if not math.isfinite(a + b + c + d):
            continue
        box = f"M{c:.1f} {a:.1f}H{d:.1f}V{b:.1f}H{c:.1f}z" if flat else (
            f"M{a:.1f} {c:.1f}H{b:.1f}V{d:.1f}H{a:.1f}z")  # fmt: skip
        groups.setdefault(colour if isinstance(colour, str) else colour[k], []).append(box)
        if "text" in trace:
            text = trace["text"] if isinstance(trace["text"], str) else trace["text"][k]
            place = (d + 4, (a + b) / 2 + 4, "start") if flat else ((a + b) / 2, d - 4, "middle")
            plot.out.append(_text(place[0], place[1], str(text or ""), place[2], size=11))
    opacity = trace.get("marker", {}).get("opacity")
    for one, boxes in groups.items():
        plot.out.append(_path("".join(boxes), "none", 0, fill=one, opacity=opacity))


def _heat(plot: _Plot, trace: Mapping[str, Any]) -> None:
    """A matrix of colours, cells of one shade in one stroke, and the scale beside it."""
    x, y, top = plot.axes["x"], plot.axes["y"], trace["zmax"]
    wide, high = (abs(float(np.diff(a.of([0.0, 1.0]))[0])) - 1 for a in (x, y))
    at, rows = x.at(trace["x"]), y.at(trace["y"])
    shades: dict[int, list[str]] = {}
    for row, b in zip(trace["z"], rows, strict=True):
        for z, a in zip(row, at, strict=True):
            if z is not None:
                shade = round(SHADES * min(max(z / top, -1.0), 1.0))
                stroke = f"M{_tenths(10 * (a - wide / 2))} {_tenths(10 * b)}h{_tenths(10 * wide)}"
                shades.setdefault(shade, []).append(stroke)
    for shade, strokes in shades.items():
        plot.out.append(_path("".join(strokes), _shade(shade), round(high, 1)))
    tall = (plot.bottom - plot.top) / (2 * SHADES + 1)
    for k in range(-SHADES, SHADES + 1):
        b = plot.bottom - (k + SHADES + 1) * tall
        box = f"M{plot.right + 10:.1f} {b:.1f}h10v{tall + 0.5:.1f}h-10z"
        plot.out.append(_path(box, "none", 0, fill=_shade(k)))
    for value in trace["colorbar"]["tickvals"]:
        b = plot.bottom - (value / top + 1) / 2 * (plot.bottom - plot.top)
        plot.out.append(_text(plot.right + 24, b + 4, f"{value:g}".replace("-", "−"), "start"))


def _shade(shade: int) -> str:
    end = "high" if shade > 0 else "low"
    return f"color-mix(in srgb,var(--{end}) {100 * abs(shade) / SHADES:.0f}%,var(--zero))"


def _shape(plot: _Plot, shape: Mapping[str, Any]) -> str:
    x0, x1 = plot.place("x", shape.get("xref", "x"), [shape["x0"], shape["x1"]])
    y0, y1 = plot.place("y", shape.get("yref", "y"), [shape["y0"], shape["y1"]])
    line = shape["line"]
    if shape["type"] == "line":
        d, fill = f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}", ""
    elif shape["type"] == "rect":
        d, fill = f"M{x0:.1f} {y0:.1f}H{x1:.1f}V{y1:.1f}H{x0:.1f}z", shape["fillcolor"]
    else:
        rx, ry, fill = abs(x1 - x0) / 2, abs(y1 - y0) / 2, shape["fillcolor"]
        d = f"M{min(x0, x1):.1f} {(y0 + y1) / 2:.1f}"
        d += "".join(f"a{rx:.1f} {ry:.1f} 0 1 0 {s * 2 * rx:.1f} 0" for s in (1, -1)) + "z"
    look = line.get("color", "none"), line.get("width", 0), line.get("dash", "solid")
    return _path(d, *look, fill=fill)


def _note(plot: _Plot, note: Mapping[str, Any]) -> None:
    x = float(plot.place("x", note["xref"], [note["x"]])[0])
    y = float(plot.place("y", note["yref"], [note["y"]])[0]) - note.get("yshift", 0)
    font = {"color": "var(--soft)", "size": SIZE} | note.get("font", {})
    anchor = {"left": "start", "right": "end"}.get(note.get("xanchor", ""), "middle")
    y += -3 if note.get("yanchor") == "bottom" else 0.35 * font["size"]
    plot.out.append(_text(x, y, note["text"], anchor, font["color"], font["size"]))


# -- the names of what is drawn ---------------------------------------------------------------

Label = tuple[int, float, str, Mapping[str, Any]]  # row, place [px], name, trace


def _legend(data: Sequence[Any], look: Mapping[str, Any], wide: float) -> list[Label]:
    """Return what stands in the legend, in rows."""
    named = [t for t in data if t.get("name") and t.get("showlegend", True)]
    wanted = look.get("showlegend", len(named) > 1)
    once = {t["name"]: t for t in reversed(named)} if wanted else {}
    out: list[Label] = []
    row, at = 0, 0.0
    for name in reversed(once):
        length = 38 + _width(name)
        if at and at + length > 0.9 * wide:
            row, at = row + 1, 0.0
        out.append((row, at, name, once[name]))
        at += length
    return out


def _write_legend(
    out: list[str],
    labels: Sequence[Label],
    base: float,
    look: Mapping[str, Any],
    left: float,
    right: float,
) -> None:
    total = max((at + 38 + _width(name) for _, at, name, _ in labels), default=0.0)
    shift = (left + right - total) / 2 if look["legend"].get("xanchor") == "center" else left
    for row, at, name, trace in labels:
        x, y = shift + at, base + 18 * row
        if trace["type"] in ("bar", "histogram") or "fill" in trace:
            colour = trace.get("fillcolor") or trace.get("marker", {}).get("color", "var(--first)")
            colour = colour if isinstance(colour, str) else "var(--first)"
            out.append(_path(f"M{x:.1f} {y - 5:.1f}h18v10h-18z", "none", 0, fill=colour,
                             opacity=trace.get("marker", {}).get("opacity")))  # fmt: skip
        else:
            line = trace.get("line", {})
            if "lines" in trace.get("mode", "lines"):
                out.append(_path(f"M{x:.1f} {y:.1f}h18", line.get("color", "var(--first)"),
                                 line.get("width", 1.8), line.get("dash", "solid")))  # fmt: skip
            if "markers" in trace.get("mode", ""):
                out += _marks(trace, np.array([x + 9]), np.array([y]))
        out.append(_text(x + 24, y + 4, name, "start"))


# -- a compass --------------------------------------------------------------------------------


def _compass(data: Sequence[Any], look: Mapping[str, Any], wide: float, high: float) -> list[str]:
    """A rose, north on top, angles clockwise [deg]."""
    labels = _legend(data, look, wide)
    rows = 1 + max((row for row, *_ in labels), default=-1)
    r = min(wide, high - 18 * rows) / 2 - 34
    cx, cy = wide / 2, r + 32
    ring = look["polar"]["angularaxis"]
    out = [_path(f"M{cx - r:.1f} {cy:.1f}a{r:.1f} {r:.1f} 0 1 0 {2 * r:.1f} 0"
                 f"a{r:.1f} {r:.1f} 0 1 0 {-2 * r:.1f} 0z", "var(--faint)")]  # fmt: skip
    for angle, text in zip(ring["tickvals"], ring["ticktext"], strict=True):
        s, c = math.sin(math.radians(angle)), math.cos(math.radians(angle))
        out.append(_path(f"M{cx:.1f} {cy:.1f}L{cx + r * s:.1f} {cy - r * c:.1f}", "var(--line)"))
        out.append(_text(cx + (r + 18) * s, cy - (r + 18) * c + 5, text, size=14))
    for trace in data:
        radius, angle = (np.array(trace[k], float) for k in ("r", "theta"))
        x = cx + r * radius * np.sin(np.deg2rad(angle))
        y = cy - r * radius * np.cos(np.deg2rad(angle))
        line = trace.get("line", {})
        fill = trace.get("fillcolor", "") if "fill" in trace else ""
        way = _way(x, y, closed=bool(fill))
        look_of = line.get("color", "none"), line.get("width", 0), line.get("dash", "solid")
        out.append(_path(way, *look_of, fill=fill))
        if "markers" in trace.get("mode", ""):
            out += [
                _path(f"M{a:.1f} {b:.1f}h0", line["color"], 9, cap="round")
                for a, b, q in zip(x, y, radius, strict=True)
                if q == 1.0
            ]
    _write_legend(out, labels, high - 18 * rows + 8, look, 0, wide)
    return out
