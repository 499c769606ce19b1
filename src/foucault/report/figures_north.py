"""Figures of a search for north: compass rose, fit over the index angle, uncertainty, budget."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report.figures import (
    BAD,
    FIRST,
    SECOND,
    SOFT,
    THIRD,
    WARNING,
    Trace,
    axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.page import Figure

COLOURS = {"pass": FIRST, "doubtful": WARNING, "unusable": BAD}
MARKS = {"pass": "circle", "doubtful": "diamond", "unusable": "x"}
POINTS = ("N", "30°", "60°", "E", "120°", "150°", "S", "210°", "240°", "W", "300°", "330°")

WEDGE = (2.0, 20.0)
"""Half-width that the wedge of two standard deviations gets on the compass rose [deg]."""


@dataclass(frozen=True)
class Needle:
    """A heading on the compass rose [deg], with its standard deviation [deg]."""

    name: str
    heading: float
    sd: float
    verdict: str = "pass"


def magnified(sd: float) -> int:
    """Return how many times wider a wedge of two `sd` [deg] is drawn, a power of ten."""
    if not sd > 0:
        return 1
    return int(10 ** max(0, math.ceil(math.log10(WEDGE[0] / (2 * sd)))))


def rose(
    needles: Sequence[Needle], other: float | None = None, reference: float | None = None
) -> Figure:
    """Draw headings [deg] on a compass; of one alone its wedge, other solution and reference."""
    data: list[Trace] = []
    alone = len(needles) == 1
    if alone:
        data += _wedge(needles[0])
        if reference is not None:
            data.append(_line("reference", [reference], THIRD, 2.5, "dot"))
        if other is not None:
            data.append(_line("other solution", [other], SOFT, 2, "dash"))
    for verdict, colour in COLOURS.items():
        mine = [n for n in needles if n.verdict == verdict]
        if mine:
            name = "heading" if alone else verdict
            data.append(_arrows(name, mine, colour if not alone else FIRST, 4.0 if alone else 1.8))
    ring = {"linecolor": "var(--faint)", "gridcolor": "var(--line)"}
    look = layout(
        390,
        meta={"ratio": 1.0},
        polar={
            "bgcolor": "rgba(0,0,0,0)",
            "radialaxis": {"visible": False, "range": [0, 1.04]},
            "angularaxis": ring
            | {
                "direction": "clockwise",
                "rotation": 90,
                "tickvals": list(range(0, 360, 30)),
                "ticktext": list(POINTS),
                "tickfont": {"size": 14},
                "ticks": "outside",
                "tickcolor": "var(--faint)",
            },
        },
        showlegend=len(data) > 2 if alone else True,
    )
    look["margin"] = {"l": 44, "r": 44, "t": 34, "b": 34}
    look["legend"] = look["legend"] | {"y": -0.1, "yanchor": "top", "x": 0.5, "xanchor": "center"}
    words = ", ".join(f"{n.heading:.2f}°" for n in needles[:6])
    alt = f"Compass rose, north on top; heading {words}"
    return Figure(data, look, _rose_caption(needles), share=44 if alone else 50, alt=alt)


def _rose_caption(needles: Sequence[Needle]) -> str:
    if len(needles) > 1:
        return "One needle per set-up: heading of its forward axis, clockwise from true north."
    wider = magnified(needles[0].sd)
    scale = f", drawn {wider:,} times wider".replace(",", " ") if wider > 1 else ""
    return f"True north is up. Shaded: ±2 sd{scale}."


def _wedge(needle: Needle) -> list[Trace]:
    half = min(2 * needle.sd * magnified(needle.sd), 180.0)
    if not math.isfinite(half):
        return []
    arc = np.linspace(needle.heading - half, needle.heading + half, 41)
    return [
        {
            "type": "scatterpolar",
            "mode": "lines",
            "name": "±2 sd",
            "r": [0, *np.ones(len(arc)).tolist(), 0],
            "theta": numbers([arc[0], *arc, arc[-1]]),
            "fill": "toself",
            "fillcolor": "var(--band)",
            "line": {"width": 0},
            "hoverinfo": "skip",
        }
    ]


def _line(name: str, headings: Sequence[float], colour: str, width: float, dash: str) -> Trace:
    r: list[float | None] = []
    theta: list[float | None] = []
    for heading in headings:
        r += [0.0, 1.0, None]
        theta += [*numbers([heading, heading]), None]
    return {
        "type": "scatterpolar",
        "mode": "lines",
        "name": name,
        "r": r,
        "theta": theta,
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": "%{theta:.4f}°<extra>" + name + "</extra>",
    }


def _arrows(name: str, needles: Sequence[Needle], colour: str, width: float) -> Trace:
    line = _line(name, [n.heading for n in needles], colour, width, "solid")
    words = [f"{n.name}: {n.heading:.4f}° ± {n.sd:.2g}°" for n in needles]
    return line | {
        "mode": "lines+markers",
        "marker": {
            "color": colour, "symbol": "arrow", "angleref": "previous", "size": 5 + 3 * width,
            "opacity": 1, "standoff": 0,
        },
        "customdata": [w for word in words for w in (word, word, None)],
        "hovertemplate": "%{customdata}<extra></extra>",
    }  # fmt: skip


def strip(
    heading: float, sd: float, bound: float | None, reference: float | None, unit: tuple[str, float]
) -> Figure:
    """Draw how sure a heading [deg] is: the rose magnified; `unit` and its size in deg."""
    name, size = unit
    x = np.linspace(-4, 4, 161)
    density = np.exp(-(x**2) / 2)
    inside = np.abs(x) <= 2
    shape = {"type": "scatter", "mode": "lines", "hoverinfo": "skip"}
    at = x * sd / size
    data: list[Trace] = [
        shape
        | {
            "name": "±2 sd",
            "x": numbers([at[inside][0], *at[inside], at[inside][-1]]),
            "y": numbers([0, *density[inside], 0]),
            "fill": "toself",
            "fillcolor": "var(--band)",
            "line": {"width": 0},
        },
        shape | {"name": "heading", "x": numbers(at), "y": numbers(density),
                 "line": {"color": FIRST, "width": 2.5}},
    ]  # fmt: skip
    if bound:
        y = np.exp(-((at * size / bound) ** 2) / 2)
        data.append(shape | {"name": "bound of the noise alone", "x": numbers(at), "y": numbers(y),
                             "line": {"color": SECOND, "width": 1.6, "dash": "dash"}})  # fmt: skip
    lines = []
    reach = 4 * sd / size
    if reference is not None:
        off = (reference - heading) / size
        reach = max(reach, 1.15 * abs(off))
        data.append(shape | {"name": "reference", "x": [off, off], "y": [0, 1.08],
                             "line": {"color": THIRD, "width": 2.5, "dash": "dot"}})  # fmt: skip
    lines.append(level_line(0, "y", "solid"))
    look = layout(
        390,
        meta={"ratio": 0.9},
        xaxis=axis(f"from the heading [{name}]", range=[-reach, reach], showgrid=True),
        yaxis={"visible": False, "range": [0, 1.12]},
        shapes=lines,
        showlegend=True,
    )
    alt = "Probability of the heading about its value, with two standard deviations"
    return Figure(data, look, "The same, magnified.", share=56, alt=alt)


def fit(
    index: FloatArray, y: FloatArray, fitted: FloatArray, sd: FloatArray,
    curve: tuple[FloatArray, FloatArray], what: str, unit: str, share: int = 100,
) -> Figure:  # fmt: skip
    """Draw readings against the index angle [deg] on the curve, and below what it leaves."""
    order = np.argsort(index, kind="stable")
    bars = {"type": "data", "array": numbers(2 * sd[order]), "color": FIRST, "thickness": 1.2,
            "width": 3 if len(index) <= 40 else 0}  # fmt: skip
    dots: Trace = {
        "type": "scatter",
        "mode": "markers",
        "name": f"{what} ±2 sd",
        "x": numbers(index[order]),
        "marker": {"color": FIRST, "size": 8 if len(index) <= 40 else 5},
        "error_y": bars,
        "hovertemplate": f"%{{x:.1f}}°: %{{y:.5g}} {unit}<extra></extra>",
    }
    angle, value = curve
    data: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": "fit",
            "x": numbers(angle),
            "y": numbers(value),
            "yaxis": "y2",
            "line": {"color": SECOND, "width": 1.8},
            "hoverinfo": "skip",
        },
        dots | {"y": numbers(y[order]), "yaxis": "y2"},
        dots | {"y": numbers((y - fitted)[order]), "showlegend": False},
    ]
    look = layout(
        430,
        xaxis=axis("index angle [°]", range=[-8, 368], tick0=0, dtick=90, anchor="y"),
        yaxis=axis(f"reading − fit [{unit}]", domain=[0, 0.34]),
        yaxis2=axis(f"{what} [{unit}]", domain=[0.42, 1]),
        shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
        showlegend=True,
    )
    alt = f"{what} against the index angle with the cosine fitted, and what it leaves"
    return Figure(data, look, share=share, alt=alt)


def budget(sources: Sequence[str], sd: FloatArray, share: FloatArray, unit: str) -> Figure:
    """Draw what every source does to the heading [unit], with its share [percent]."""
    label = [f"{100 * s:.0f} %" if abs(s) >= 0.01 else "< 1 %" for s in share]
    data = [
        {
            "type": "bar",
            "orientation": "h",
            "y": list(sources),
            "x": numbers(sd),
            "text": label,
            "textposition": "outside",
            "cliponaxis": False,
            "marker": {"color": [FIRST if v >= 0 else SECOND for v in sd]},
            "hovertemplate": f"%{{y}}: %{{x:.3g}} {unit}, %{{text}}<extra></extra>",
        }
    ]
    top = float(np.max(np.abs(sd), initial=0.0)) or 1.0
    low = min(0.0, 1.25 * float(np.min(sd, initial=0.0)))
    look = layout(
        76 + 27 * len(sources),
        bargap=0.3,
        xaxis=axis(f"sd of the heading from it alone [{unit}]", range=[low, 1.16 * top]),
        yaxis={"type": "category", "autorange": "reversed", "tickmode": "linear", "ticks": ""},
        showlegend=False,
    )
    look["margin"] = look["margin"] | {"t": 8}
    return Figure(data, look, alt="Standard deviation of the heading by source")


def against_bound(
    names: Sequence[str], sd: FloatArray, bound: FloatArray, verdicts: Sequence[str], unit: str
) -> Figure:
    """Draw the sd of every heading beside its bound [unit]."""
    n = np.arange(1, len(names) + 1)
    dots: Trace = {"type": "scatter", "mode": "markers", "customdata": list(names)}
    data: list[Trace] = []
    for verdict, colour in COLOURS.items():
        pick = np.array([v == verdict for v in verdicts])
        if pick.any():
            some = [name for name, p in zip(names, pick, strict=True) if p]
            data.append(dots | {
                "name": f"sd, {verdict}", "x": numbers(n[pick]), "y": numbers(sd[pick]),
                "customdata": some,
                "marker": {"color": colour, "size": 8, "symbol": MARKS[verdict]},
                "hovertemplate": f"%{{customdata}}: %{{y:.3g}} {unit}<extra></extra>",
            })  # fmt: skip
    data.append(dots | {
        "name": "bound of the noise alone", "x": numbers(n), "y": numbers(bound),
        "marker": {"color": SECOND, "size": 10, "symbol": "line-ew",
                   "line": {"color": SECOND, "width": 2}},
        "hovertemplate": f"%{{customdata}}: bound %{{y:.3g}} {unit}<extra></extra>",
    })  # fmt: skip
    all_ = np.concatenate([sd, bound])
    all_ = all_[np.isfinite(all_) & (all_ > 0)]
    wide = len(all_) > 0 and all_.max() > 20 * all_.min()
    scale: dict[str, Any] = {"type": "log"} if wide else {"rangemode": "tozero"}
    look = layout(
        390,
        xaxis=axis("set-up", tick0=1, dtick=max(1, round(len(names) / 8)),
                   range=[0.4, len(names) + 0.6]),
        yaxis=axis(f"sd of the heading [{unit}]", **scale),
        showlegend=True,
    )  # fmt: skip
    alt = "Standard deviation of every heading beside the Cramér-Rao bound"
    return Figure(data, look, share=50, alt=alt)


def largest(share: Mapping[str, FloatArray], most: int = 5) -> dict[str, FloatArray]:
    """Return the largest sources of `share` [percent], the others as one."""
    order = sorted(share, key=lambda s: -float(np.nanmean(share[s])))
    if len(order) <= most + 1:
        return {s: share[s] for s in order}
    rest = np.sum([share[s] for s in order[most:]], axis=0)
    return {s: share[s] for s in order[:most]} | {"others": rest}
