"""Figures of a session on a table: norms before and after, residuals, smallest errors seen.

Readings stand side by side by kind, rests and spins, each numbered from 1. A reading that was left
out is a cross with its number; where it lies beyond the scale of the others it stands at the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.report.figures import (
    BAD,
    FIRST,
    SECOND,
    Trace,
    axis,
    count_axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.page import Figure

GAP = 0.05
"""Space between two groups, as a part of the width [1]."""


@dataclass(frozen=True)
class Group:
    """Readings of one kind."""

    what: str  # "rest", "spin" or "turn"
    where: Sequence[str]  # what the table said in each, for the pointer

    def __len__(self) -> int:
        return len(self.where)


@dataclass(frozen=True)
class Norms:
    """Errors of the norm of one group, in the units of the figure."""

    group: Group  # the readings, n of them
    # before, after, sd: (n,) error as measured, after compensation, and the standard deviation it
    # should have
    before: FloatArray
    after: FloatArray
    sd: FloatArray
    left_out: BoolArray  # (n,) readings that were not used


def before_after(
    quantity: str, norms: Sequence[Norms], units: tuple[str, str], share: int
) -> Figure:
    """Draw errors of the norm per reading: before above, after below with the +-2 sd it may have.

    `share`: part of the width that the figure takes [percent].
    """
    span = _span(norms)
    data: list[Trace] = []
    for k, part in enumerate(norms):
        data += [
            trace | {"xaxis": _ref("x", k), "showlegend": k == 0}
            for trace in (_before(part, units[0]), _band(part), _after(part, units[1]))
        ]
    for k, part in enumerate(norms):
        if part.left_out.any():
            first = not any(p.left_out.any() for p in norms[:k])
            for trace in _crosses(part, span, units):
                data.append(trace | {"xaxis": _ref("x", k)})
                data[-1]["showlegend"] = first and trace["yaxis"] == "y2"
    look = layout(
        370,
        **_count_axes([part.group for part in norms], 14 * share / 100),
        yaxis=axis(
            f"after [{units[1]}]", domain=[0, 0.46], range=[-span, span], exponentformat="none"
        ),
        yaxis2=axis(f"before [{units[0]}]", domain=[0.56, 1]),
        shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
        showlegend=True,
    )
    groups = " and ".join(part.group.what for part in norms)
    alt = f"Error of the norm of {quantity} per {groups}, before and after calibration"
    return Figure(data, look, share=share, alt=alt)


def _ref(letter: str, k: int) -> str:
    return letter if k == 0 else f"{letter}{k + 1}"


def _span(norms: Sequence[Norms]) -> float:
    """Half the range that shows what was used, and its band; left out readings may lie beyond."""
    sizes = [np.abs(part.after[~part.left_out]) for part in norms]
    sizes += [2 * part.sd[~part.left_out] for part in norms]
    if not any(s.size for s in sizes):
        sizes = [np.abs(part.after) for part in norms]
    every = np.concatenate(sizes)
    return 1.2 * float(np.max(every[np.isfinite(every)], initial=0.0)) or 1.0


def _count_axes(groups: Sequence[Group], ticks: float) -> dict[str, Any]:
    """One axis per group, as wide as it has readings."""
    total = sum(len(g) for g in groups)
    free = 1.0 - GAP * (len(groups) - 1)
    out: dict[str, Any] = {}
    narrow: dict[str, Any] = {}
    left = 0.0
    for k, g in enumerate(groups):
        width, n = free * len(g) / total, len(g)
        key = _ref("x", k).replace("x", "xaxis")
        look = count_axis(g.what, n, max(2, round(ticks * n / total)))
        out[key] = look | {
            "domain": [round(left, 4), round(left + width, 4)], "tickangle": 0, "showgrid": False
        }  # fmt: skip
        narrow[key] = {"dtick": max(1, round(n / max(2.0, 6 * n / total)))}
        left += width + GAP
    return out | {"meta": {"narrow": narrow}}


def _before(part: Norms, unit: str) -> Trace:
    kept = ~part.left_out
    return _dots(part.group, kept, part.before, SECOND, "diamond") | {
        "name": "before",
        "yaxis": "y2",
        "hovertemplate": _hover(part.group, unit, "before"),
    }


def _after(part: Norms, unit: str) -> Trace:
    kept = ~part.left_out
    return _dots(part.group, kept, part.after, FIRST, "circle") | {
        "name": "after",
        "yaxis": "y",
        "hovertemplate": _hover(part.group, unit, "after"),
    }


def _hover(group: Group, unit: str, which: str) -> str:
    return f"{group.what} %{{x}}, %{{text}}: %{{customdata:.4g}} {unit}<extra>{which}</extra>"


def _dots(group: Group, pick: BoolArray, y: FloatArray, colour: str, symbol: str) -> Trace:
    rows = np.flatnonzero(pick).tolist()
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [j + 1 for j in rows],
        "y": numbers(y[rows]),
        "customdata": numbers(y[rows]),
        "text": [group.where[j] for j in rows],
        "marker": {"color": colour, "size": 8, "symbol": symbol},
    }


def _band(part: Norms) -> Trace:
    """+-2 sd as steps, one per reading."""
    n, high = np.arange(1, len(part.group) + 1), 2 * part.sd
    known = np.isfinite(high) & ~part.left_out
    x, y = [], []
    for j in np.flatnonzero(known):
        left, right, top = n[j] - 0.5, n[j] + 0.5, float(high[j])
        x += [left, right, right, left, left, None]
        y += [top, top, -top, -top, top, None]
    return {
        "type": "scatter",
        "mode": "lines",
        "name": "±2 sd",
        "x": [None if v is None else float(v) for v in x],
        "y": [None if v is None else float(f"{v:.6g}") for v in y],
        "fill": "toself",
        "fillcolor": "var(--band)",
        "line": {"width": 0},
        "hoverinfo": "skip",
    }


def _crosses(part: Norms, span: float, units: tuple[str, str]) -> list[Trace]:
    """What was left out, with its number; at the edge where it lies beyond."""
    rows = np.flatnonzero(part.left_out)
    beyond = np.abs(part.after[rows]) > span
    edge = np.where(beyond, np.sign(part.after[rows]) * 0.84 * span, part.after[rows])
    arrows = np.where(part.after[rows] > 0, "triangle-up", "triangle-down")
    symbols = np.where(beyond, arrows, "x")
    out = []
    for y, ref, unit, shapes, true in (
        (part.before[rows], "y2", units[0], np.full(len(rows), "x"), part.before[rows]),
        (edge, "y", units[1], symbols, part.after[rows]),
    ):
        which = "before, left out" if ref == "y2" else "after, left out"
        out.append(
            _dots(part.group, part.left_out, part.after, BAD, "x")
            | {
                "mode": "markers+text",
                "name": "left out",
                "y": numbers(y),
                "yaxis": ref,
                "customdata": numbers(true),
                "text": [
                    f"{part.group.what} {j + 1}" + (f": {_size(v)} {unit}" if far else "")
                    for j, v, far in zip(rows, true, shapes != "x", strict=True)
                ],
                "textposition": [
                    f"middle {'right' if 2 * j < len(part.group) else 'left'}" for j in rows
                ],
                "textfont": {"color": BAD},
                "cliponaxis": False,
                "marker": {"color": BAD, "size": 9, "symbol": shapes.tolist()},
                "hovertemplate": f"%{{text}}: %{{customdata:.4g}} {unit}<extra>{which}</extra>",
            }
        )
    return out


@dataclass(frozen=True)
class Bars:
    """One number per reading of a group: residuals, or smallest errors seen."""

    group: Group  # the readings, n of them
    y: FloatArray  # (n,) the numbers; NaN where there is none, infinite where there is no limit
    marked: BoolArray  # (n,) readings that were not used, or that nothing controls


@dataclass(frozen=True)
class Look:
    """How bars are labelled: `title` of the axis, `unit`, and what the two colours mean."""

    title: str
    unit: str
    plain: str
    marked: str
    alt: str
    caption: str = ""
    share: int = 100


def bars(groups: Sequence[Bars], look: Look, limit: float | None = None) -> Figure:
    """Draw one bar per reading; marked ones stand out, and beyond the scale end at its edge.

    `limit` or None: dashed line, in the unit of the bars [1].
    """
    low, high = _bar_range(groups, limit)
    data: list[Trace] = []
    for marked, colour, name in ((False, FIRST, look.plain), (True, BAD, look.marked)):
        some = [(k, g) for k, g in enumerate(groups) if np.any((g.marked == marked) & _known(g))]
        for at, (k, g) in enumerate(some):
            rows = np.flatnonzero((g.marked == marked) & _known(g))
            words = [f"{g.group.where[j]}: {_size(g.y[j])} {look.unit}" for j in rows.tolist()]
            shown = np.clip(g.y[rows], low, high)
            beyond = g.y[rows] != shown
            data.append({
                "type": "bar",
                "name": name,
                "legendgroup": name,
                "showlegend": at == 0,
                "x": (rows + 1).tolist(),
                "y": numbers(shown),
                "xaxis": _ref("x", k),
                "hovertext": words,
                "text": [_size(v) if b else "" for v, b in zip(g.y[rows], beyond, strict=True)],
                "textposition": "outside",
                "textangle": 0,
                "cliponaxis": False,
                "constraintext": "none",
                "textfont": {"color": colour, "size": 12},
                "marker": {"color": colour},
                "hovertemplate": f"{g.group.what} %{{x}}, %{{hovertext}}<extra>{name}</extra>",
            })  # fmt: skip
    legend = any(np.any(g.marked & _known(g)) for g in groups)
    lines = [] if limit is None else [limit, *([-limit] if low < 0 else [])]
    drawn = layout(
        280,
        **_count_axes([g.group for g in groups], 14 * look.share / 100),
        yaxis=axis(look.title, range=[1.14 * low, 1.14 * high]),
        shapes=[level_line(0, "y", "solid"), *(level_line(v) for v in lines)],
        showlegend=legend,
        bargap=0.35,
        barmode="overlay",
    )
    if not legend:
        drawn["margin"] = drawn["margin"] | {"t": 12}
    return Figure(data, drawn, look.caption, share=look.share, alt=look.alt)


def _known(g: Bars) -> BoolArray:
    return np.asarray(~np.isnan(g.y))


def _size(value: float) -> str:
    if not np.isfinite(value):
        return "∞"
    return (f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}").replace("-", "−")


def _bar_range(groups: Sequence[Bars], limit: float | None) -> tuple[float, float]:
    """What shows every bar that is not marked, and the limit."""
    kept = np.concatenate([g.y[~g.marked] for g in groups])
    marked = np.concatenate([g.y[_known(g) & g.marked] for g in groups])
    both = np.abs(kept[np.isfinite(kept)]) if np.isfinite(kept).any() else np.abs(marked)
    top = max(float(np.max(both[np.isfinite(both)], initial=0.0)), limit or 0.0) or 1.0
    if marked.size:
        top = min(1.6 * top, max(top, float(np.abs(marked).max())))
    negative = any(np.any(g.y[_known(g)] < 0) for g in groups)
    return (-top if negative else 0.0), top
