"""Figures of a transfer alignment: estimates, innovations, what a delay makes, the bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.report.figures import (
    FIRST,
    SECOND,
    SERIES,
    SOFT,
    Trace,
    axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.figures_tumble import Family
from foucault.report.page import Figure

Columns = Mapping[str, npt.NDArray[Any]]
Times = Sequence[float]

DOTS = 600
"""So many innovations of a component are drawn, and those outside three sd besides [1]."""

GUIDE = 2.0
"""Bands are drawn at so many standard deviations [1]."""

LATE = 0.1
"""An axis of estimates shows what they did after this part of the run in full [1]."""

RANGE = 6.0
"""And at least so many final standard deviations [1]."""

GAP = 0.09
"""Between panels, of the height [1]."""


@dataclass(frozen=True)
class Panel:
    """One of several diagrams above one another."""

    title: str
    lines: tuple[tuple[str, FloatArray], ...]  # name and values of each line, shape (n,) [any]
    look: Mapping[str, Any]  # more of its axis


def marked(times: Times) -> list[Trace]:
    """Return a thin line at every one of some times [s], down the whole figure."""
    line = {"color": "var(--faint)", "width": 1, "dash": "dot"}
    place = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": line, "layer": "below"}
    return [place | {"x0": t, "x1": t} for t in times]


def titled(name: str, unit: str) -> list[Trace]:
    """Return a title over the left edge of a figure."""
    return [{
        "text": f"<b>{name}</b> [{unit}]", "x": 0, "xref": "paper", "y": 1, "xanchor": "left",
        "yref": "paper", "yanchor": "bottom", "yshift": 4, "showarrow": False,
        "font": {"color": "var(--ink)", "size": 13},
    }]  # fmt: skip


def domains(n: int) -> list[tuple[str, list[float]]]:
    """Return name and place of the axes of panels above one another, from the uppermost."""
    gap = GAP if n > 1 else 0.0
    each = (1 - gap * (n - 1)) / n
    tops = [1 - k * (each + gap) for k in range(n)]
    refs = [str(n - k) if n - k > 1 else "" for k in range(n)]
    return [(ref, [max(0.0, top - each), top]) for ref, top in zip(refs, tops, strict=True)]


def line(name: str, x: FloatArray, y: FloatArray, colour: str, **more: Any) -> Trace:
    """Return a line."""
    drawn = {"color": colour, "width": 1.8} | more.pop("line", {})
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": numbers(x), "y": numbers(y),
        "line": drawn, "hovertemplate": f"%{{x:.1f}} s: %{{y:.4g}}<extra>{name}</extra>",
    } | more  # fmt: skip


def band(x: FloatArray, low: FloatArray, high: FloatArray, name: str, **more: Any) -> Trace:
    """Return a shaded band between two lines."""
    return {
        "type": "scatter", "mode": "lines", "name": name, "fill": "toself",
        "x": numbers(np.concatenate([x, x[::-1]])),
        "y": numbers(np.concatenate([high, low[::-1]])),
        "fillcolor": "var(--band)", "line": {"width": 0}, "hoverinfo": "skip",
    } | more  # fmt: skip


def panels(time: FloatArray, some: Sequence[Panel], times: Times, alt: str, share: int = 50,
           height: int = 130, caption: str = "") -> Figure:  # fmt: skip
    """Draw lines against time [s], one panel below the other."""
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis("time [s]", anchor="y", showgrid=False)}
    shapes = marked(times)
    seen: set[str] = set()
    for panel, (ref, domain) in zip(some, domains(len(some)), strict=True):
        for (name, y), colour in zip(panel.lines, SERIES, strict=False):
            new = len(panel.lines) > 1 and name not in seen
            data.append(line(name, time, y, colour, yaxis=f"y{ref}", showlegend=new))
            seen.add(name)
        axes[f"yaxis{ref}"] = axis(panel.title, domain=domain, **panel.look)
    look = layout(70 + height * len(some), meta={"zoom": True}, shapes=shapes, **axes)
    return Figure(data, look, caption, share=share, alt=alt)


def estimates(table: Columns, family: Family, times: Times) -> Figure:
    """Draw coefficients of one kind along the run, each with +-2 sd, one panel each."""
    time = np.asarray(table["time"], float)
    values = [np.asarray(table[name], float) / family.size for name in family.members]
    sds = [np.asarray(table[f"{name}_sd"], float) / family.size for name in family.members]
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis("time [s]", anchor="y", showgrid=False)}
    places = domains(len(values))
    for y, sd, label, (ref, domain) in zip(values, sds, family.labels, places, strict=True):
        low, high = _reach(y, sd)
        edges = [np.clip(y + k * sd, low, high) for k in (-GUIDE, GUIDE)]
        on = {"yaxis": f"y{ref}", "showlegend": False}
        data.append(band(time, edges[0], edges[1], "±2 sd", **on))
        words = f"%{{x:.1f}} s: %{{y:.4g}} ± %{{customdata:.2g}} {family.unit}<extra></extra>"
        data.append(line(label, time, y, FIRST, customdata=numbers(sd), **on)
                    | {"hovertemplate": words})  # fmt: skip
        axes[f"yaxis{ref}"] = axis(label, domain=domain, range=[low, high], nticks=5)
    n = len(values)
    look = layout(80 + (95 if n > 1 else 150) * n, meta={"zoom": True}, shapes=marked(times),
                  annotations=titled(family.name, family.unit), **axes)  # fmt: skip
    alt = f"{family.name} along the run with two standard deviations"
    return Figure(data, look, share=50, alt=alt)


def compared(ours: Columns, other: Columns, family: Family, times: Times) -> Figure:
    """Draw coefficients of one kind with the delay and without it, each with its +-2 sd."""
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis("time [s]", anchor="y", showgrid=False)}
    looks = (("delay ignored", other, SECOND, "var(--second-band)"),
             ("with the delay", ours, FIRST, "var(--band)"))  # fmt: skip
    panels_ = zip(family.members, family.labels, domains(len(family.members)), strict=True)
    for k, (name, label, (ref, domain)) in enumerate(panels_):
        courses = [(np.asarray(t["time"], float), np.asarray(t[name], float) / family.size,
                    np.asarray(t[f"{name}_sd"], float) / family.size)
                   for _, t, _, _ in looks]  # fmt: skip
        reach = np.array([_reach(y, sd) for _, y, sd in courses])
        low, high = float(reach[:, 0].min()), float(reach[:, 1].max())
        for (words, _, colour, shade), (x, y, sd) in zip(looks, courses, strict=True):
            edges = [np.clip(y + s * sd, low, high) for s in (-GUIDE, GUIDE)]
            data.append(band(x, edges[0], edges[1], "±2 sd", yaxis=f"y{ref}", showlegend=False,
                             fillcolor=shade))  # fmt: skip
            data.append(line(words, x, y, colour, yaxis=f"y{ref}", showlegend=k == 0))
        axes[f"yaxis{ref}"] = axis(label, domain=domain, range=[low, high], nticks=5)
    n = len(family.members)
    title = titled(family.name, family.unit)[0] | {"yshift": 24}
    look = layout(100 + (95 if n > 1 else 150) * n, meta={"zoom": True}, shapes=marked(times),
                  annotations=[title], showlegend=True, **axes)  # fmt: skip
    look["margin"] = look["margin"] | {"t": 54}
    alt = f"{family.name} along the run with the delay and without it"
    return Figure(data, look, share=50, alt=alt)


def _reach(y: FloatArray, sd: FloatArray) -> tuple[float, float]:
    """Return the range of an axis: the first moments, when nothing is known, may leave it."""
    late = slice(int(LATE * len(y)), None)
    low = min(float(np.min((y - GUIDE * sd)[late])), float(y[-1] - RANGE * sd[-1]))
    high = max(float(np.max((y + GUIDE * sd)[late])), float(y[-1] + RANGE * sd[-1]))
    return low - 0.04 * (high - low), high + 0.04 * (high - low)


def innovations(table: Columns, family: Family, times: Times) -> Figure:
    """Draw innovations of one kind in their band of +-2 sd, one panel for each component."""
    time = np.asarray(table["time"], float)
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis("time [s]", anchor="y", showgrid=False)}
    places = domains(len(family.members))
    for name, label, (ref, domain) in zip(family.members, family.labels, places, strict=True):
        y = np.asarray(table[name], float) / family.size
        sd = np.asarray(table[f"{name}_sd"], float) / family.size
        pick = chosen(np.abs(y) > 3 * sd)
        on = {"yaxis": f"y{ref}", "showlegend": False}
        data.append(band(time[pick], -GUIDE * sd[pick], GUIDE * sd[pick], "±2 sd", **on))
        data.append({
            "type": "scatter", "mode": "markers", "x": numbers(time[pick]), "y": numbers(y[pick]),
            "marker": {"color": FIRST, "size": 3},
            "hovertemplate": f"%{{x:.1f}} s: %{{y:.3g}} {family.unit}<extra>{label}</extra>",
        } | on)  # fmt: skip
        # The first message finds what was known beforehand, and would hide all others.
        top = 1.1 * max(3 * float(np.nanmedian(sd)), float(np.nanquantile(np.abs(y), 0.998)))
        axes[f"yaxis{ref}"] = axis(label, domain=domain, range=[-top, top], nticks=5)
    look = layout(80 + 100 * len(family.members), meta={"zoom": True}, shapes=marked(times),
                  annotations=titled(family.name, family.unit), **axes)  # fmt: skip
    alt = f"Innovations, {family.name}, with two standard deviations, against time"
    return Figure(data, look, share=50, alt=alt)


def chosen(must: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Return the rows that are drawn: an even choice, and those that must be."""
    step = max(1, -(-len(must) // DOTS))
    even = np.zeros(len(must), bool)
    even[::step] = True
    return np.flatnonzero(even | must)


def nis(time: FloatArray, ratio: FloatArray, limits: tuple[float, float], times: Times) -> Figure:
    """Draw means of the normalised innovations squared over their number, with limits."""
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "markers", "x": numbers(time), "y": numbers(ratio),
            "marker": {"color": FIRST, "size": 6}, "showlegend": False,
            "hovertemplate": "%{x:.1f} s: %{y:.3f}<extra></extra>",
        }
    ]  # fmt: skip
    top = 1.1 * max(limits[1], float(np.nanmax(ratio, initial=0.0)))
    look = layout(
        260, meta={"zoom": True}, xaxis=axis("time [s]", showgrid=False),
        yaxis=axis("NIS / number", range=[0, top]),
        shapes=[*(level_line(v) for v in limits), *marked(times)],
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 12}
    alt = "Normalised innovations squared over their number, with limits, against time"
    return Figure(data, look, alt=alt)


def likelihood(tried: FloatArray, short: FloatArray, best: float, sd: float) -> Figure:
    """Draw by how much the likelihood of other delays [s] is less than that of the best."""
    away = np.geomspace(0.3 * sd, max(float(np.max(np.abs(tried - best))), 3 * sd), 60)
    x = np.concatenate([best - away[::-1], best + away])
    pick = short > 0
    data = [
        line("parabola of the sd", 1e3 * x, 0.5 * ((x - best) / sd) ** 2, SOFT,
             line={"dash": "dash", "width": 1.4}, hoverinfo="skip", hovertemplate=None),
        {
            "type": "scatter", "mode": "markers", "name": "tried", "x": numbers(1e3 * tried[pick]),
            "y": numbers(short[pick]), "marker": {"color": FIRST, "size": 8},
            "hovertemplate": "%{x:.3f} ms: %{y:.3g} less<extra></extra>",
        },
    ]  # fmt: skip
    bottom = float(np.log10(max(min(0.1, float(np.min(short[pick], initial=1.0))), 1e-3)))
    top = float(np.log10(np.max(short[pick], initial=10.0)))
    look = layout(
        300, xaxis=axis("delay [ms]"), showlegend=True,
        yaxis=axis("log-likelihood below the best", type="log", dtick=1, exponentformat="power",
                   range=[bottom - 0.2, top + 0.3]),
    )  # fmt: skip
    alt = "How much less likely other delays are than the best"
    return Figure(data, look, "The best itself lies below the axis.", share=50, alt=alt)


def bound(time: FloatArray, used: FloatArray, times: Times) -> Figure:
    """Draw how much of the bound of an H-infinity filter is used up along the run."""
    look = layout(
        280, meta={"zoom": True}, xaxis=axis("time [s]", showgrid=False),
        yaxis=axis("part of γ² used", type="log", dtick=1, exponentformat="power",
                   range=[float(np.log10(max(1e-9, float(np.nanmin(used))))) - 0.2, 0.3]),
        shapes=[level_line(1.0, colour="var(--bad)"), *marked(times)], showlegend=False,
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 12}
    alt = "Part of the bound that is used, against time; there is a filter while it is below 1"
    return Figure([line("part of γ²", time, used, FIRST)], look, alt=alt)


def known(table: Columns, families: Sequence[Family], before: Mapping[str, FloatArray],
          times: Times, share: int) -> Figure:  # fmt: skip
    """Draw how much of what was uncertain of each group is left, worst of its axes."""
    time = np.asarray(table["time"], float)
    data = []
    for family, colour in zip(families, SERIES, strict=False):
        left = np.max([np.asarray(table[f"{m}_sd"], float) / before[m] for m in family.members],
                      axis=0)  # fmt: skip
        data.append(line(family.name, time, left, colour))
    look = layout(
        430, meta={"zoom": True}, xaxis=axis("time [s]", showgrid=False), showlegend=True,
        yaxis=axis("sd / prior sd", type="log", dtick=1, exponentformat="power"),
        shapes=marked(times),
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 52}
    alt = "Standard deviation over that beforehand of every group against time"
    return Figure(data, look, share=share, alt=alt)
