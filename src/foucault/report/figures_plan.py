"""Figures of a search for a plan: what was gained, how it moves, and how the search went."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.report.figures import BAD, FIRST, SECOND, SOFT, WARNING, Trace, axis, layout, numbers
from foucault.report.figures_motion import COLOURS, heading, leg_lines, leg_numbers
from foucault.report.page import Figure

Motion = Sequence[tuple[float, float, tuple[float, float, float]]]

AS_GOOD = 1.005
"""Up to this ratio a coefficient is as good: bounds are not known much better [1]."""

MOST_LINES = 200
"""Restarts whose course is drawn, those with the lowest cost [1]."""


@dataclass(frozen=True)
class Ratio:
    """What became of one coefficient."""

    name: str
    # here, low, high: sd over sd of the plan to beat in the first case, and its range over all; NaN
    # where that plan does not show it [1]
    here: float
    low: float
    high: float
    counts: bool = True  # whether the search looked at it

    @property
    def look(self) -> str:
        """How it is drawn, a key of `LOOKS`."""
        if not self.counts:
            return "not counted"
        if self.here > AS_GOOD:
            return "worse"
        return "worse in some case" if self.high > AS_GOOD else "no worse in any case"


LOOKS = {
    "no worse in any case": (FIRST, "circle"),
    "worse in some case": (WARNING, "diamond"),
    "worse": (BAD, "diamond"),
    "not counted": (SOFT, "circle-open"),
}
"""Colour and symbol of a ratio."""

NARROW = 4.0
"""Up to this ratio of its ends an axis has evenly spaced marks [1]."""

WIDE = 0.04
"""Part of the time from which a step has room for its number [1]."""


def ratio_axis(values: Iterable[float], title: str, edge: float = 1.1) -> dict[str, Any]:
    """Return a logarithmic axis that holds `values`, shape (any,), and room of `edge` times [1]."""
    finite = [v for v in values if math.isfinite(v) and v > 0]
    low, high = min(finite) / edge, max(finite) * edge
    marks = _marks(low, high)
    return axis(
        title, type="log", range=[math.log10(low), math.log10(high)], tickvals=marks,
        ticktext=[f"{v:.6g}" for v in marks],
    )  # fmt: skip


def _marks(low: float, high: float) -> list[float]:
    """Return round numbers between two, a handful."""
    if high / low > NARROW:
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)))
        some = (1, 2, 5) if len(decades) < 4 else (1,)
        return [m * 10.0**p for p in decades for m in some if low <= m * 10.0**p <= high]
    size = 10.0 ** math.floor(math.log10((high - low) / 3))
    step = next(m * size for m in (5, 2, 1) if (high - low) / (m * size) >= 3)
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def ratios(rows: Sequence[Ratio], every: Sequence[Ratio], share: int) -> Figure:
    """Draw the ratio of some coefficients on the scale of all, with its range over the cases."""
    lines_x = [v for r in rows for v in (*numbers([r.low, r.high]), None)]
    lines_y = [v for r in rows for v in (r.name, r.name, None)]
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "lines", "x": lines_x, "y": lines_y, "hoverinfo": "skip",
            "line": {"color": "var(--faint)", "width": 3}, "showlegend": False,
        }
    ]  # fmt: skip
    for kind in dict.fromkeys(r.look for r in rows):
        shown = [r for r in rows if r.look == kind]
        colour, symbol = LOOKS[kind]
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": kind,
                "x": numbers([r.here for r in shown]), "y": [r.name for r in shown],
                "customdata": [numbers([r.low, r.high]) for r in shown],
                "marker": {"color": colour, "symbol": symbol, "size": 8,
                           "line": {"width": 1.5, "color": colour}},
                "hovertemplate": "%{y}: %{x:.3f} (%{customdata[0]:.3f} to %{customdata[1]:.3f})"
                "<extra></extra>",
            }
        )  # fmt: skip
    look = layout(
        72 + 19 * len(rows),
        xaxis=ratio_axis(
            [1.0, *(v for r in every for v in (r.here, r.low, r.high))], "sd / sd before"
        ),
        yaxis={"type": "category", "range": [len(rows) - 0.4, -0.6], "categoryorder": "array",
               "categoryarray": [r.name for r in rows], "tickmode": "linear", "ticks": "",
               "tickfont": {"size": 11.5}},
        shapes=[_at_one()],
        showlegend=False,
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 10}
    alt = f"Standard deviation over that of the plan to beat, {rows[0].name} to {rows[-1].name}"
    return Figure(data, look, share=share, alt=alt)


def _at_one(upright: bool = True) -> Trace:
    along, across = ("y", "x") if upright else ("x", "y")
    return {
        "type": "line", f"{along}ref": "paper", f"{along}0": 0, f"{along}1": 1, f"{across}0": 1,
        f"{across}1": 1, "line": {"color": SOFT, "width": 1.3, "dash": "dash"},
    }  # fmt: skip


def motion(title: str, steps: Motion, fastest: float, longest: float) -> Figure:
    """Draw the rates about the three axes against time, on scales that both plans share.

    `steps`: beginning, end [s] and rates [rad/s] of each step; `fastest`: largest rate of both
    plans [rad/s]; `longest`: time of the longer plan [s].
    """
    start, end = (np.array([s[k] for s in steps], float) for k in (0, 1))
    rates = np.degrees([s[2] for s in steps])
    top = float(np.degrees(fastest))
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    for k, (name, colour) in enumerate(COLOURS.items()):
        ref = str(k + 1) if k else ""
        turning = rates[:, k] != 0
        data.append(
            {
                "type": "bar", "x": numbers((start + end)[turning] / 2),
                "y": numbers(rates[turning, k]), "width": numbers((end - start)[turning]),
                "yaxis": f"y{ref}", "marker": {"color": colour, "line": {"width": 0}},
                "customdata": [numbers(p) for p in zip(start[turning], end[turning], strict=True)],
                "hovertemplate": f"about {name}: %{{y:.4g}} °/s, %{{customdata[0]}} s to "
                "%{customdata[1]} s<extra></extra>",
            }
        )  # fmt: skip
        low = 0.7 - 0.35 * k
        axes[f"yaxis{ref}"] = axis(
            f"{name} [°/s]", domain=[low, low + 0.3], range=[-1.3 * top, 1.3 * top],
            tickvals=numbers([-top, 0, top]), zeroline=True, zerolinecolor="var(--faint)",
        )  # fmt: skip
    legs = [{"start": a, "end": b} for a, b in zip(start.tolist(), end.tolist(), strict=True)]
    numbered = [
        number
        for number, leg in zip(leg_numbers(legs), legs, strict=False)
        if leg["end"] - leg["start"] >= WIDE * longest
    ]
    look = layout(
        330, xaxis=axis("time [s]", range=[0, longest], showgrid=False, anchor="y3"), **axes,
        shapes=leg_lines(legs), annotations=[heading(f"<b>{title}</b>"), *numbered],
        showlegend=False, bargap=0,
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 52}
    alt = f"Rates about x, y and z against time: {title}"
    return Figure(data, look, share=50, alt=alt)


def courses(restarts: Sequence[dict[str, Any]]) -> Figure:
    """Draw the cost of every restart, as a ratio, against the plans that it had judged."""
    order = sorted((r for r in restarts if math.isfinite(r["cost"])), key=lambda r: r["cost"])
    drawn, best = order[:MOST_LINES], order[0]
    groups = (
        ("random beginning", [r for r in drawn if not r["continued"] and r is not best], FIRST, 1),
        ("continues an earlier plan", [r for r in drawn if r["continued"] and r is not best],
         SECOND, 1),
        (f"best: restart {best['restart']}", [best], "var(--ink)", 2.6),
    )  # fmt: skip
    data = [_course(name, some, colour, width) for name, some, colour, width in groups if some]
    every = [math.exp(c) for r in drawn for _, c in r["trace"] if math.isfinite(c)]
    most = max(r["evaluations"] for r in drawn)
    first = min(max(r["trace"][0][0], 1) for r in drawn)
    look = layout(
        340, xaxis=axis("plans judged", type="log", dtick=1,
                        range=[math.log10(first), math.log10(1.05 * max(most, first + 1))]),
        yaxis=ratio_axis(every, "cost as a ratio"), shapes=[_at_one(upright=False)],
        showlegend=True,
    )  # fmt: skip
    alt = "Cost of every restart as a ratio against the number of plans judged"
    return Figure(data, look, share=50, alt=alt)


def _course(name: str, some: Sequence[dict[str, Any]], colour: str, width: float) -> Trace:
    x: list[float | None] = []
    y: list[float | None] = []
    for r in some:
        x += [*(float(max(at, 1)) for at, _ in r["trace"]), None]
        y += [*numbers([math.exp(cost) for _, cost in r["trace"]]), None]
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": x, "y": y,
        "opacity": 1.0 if width > 2 else 0.5,
        "line": {"color": colour, "width": width, "shape": "hv"},
        "hovertemplate": "after %{x} plans: %{y:.4f}<extra></extra>",
    }  # fmt: skip


def endings(restarts: Sequence[dict[str, Any]]) -> Figure:
    """Draw where each restart ended, and the best of all so far."""
    ends = [(r["restart"], math.exp(r["cost"]), r["continued"]) for r in restarts]
    so_far = np.minimum.accumulate([v for _, v, _ in ends])
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "markers", "name": name,
            "x": [n for n, _, c in ends if c == continued],
            "y": numbers([v for _, v, c in ends if c == continued]),
            "marker": {"color": colour, "symbol": symbol, "size": 8},
            "hovertemplate": "restart %{x}: %{y:.4f}<extra></extra>",
        }
        for name, continued, colour, symbol in (
            ("random beginning", False, FIRST, "circle"),
            ("continues an earlier plan", True, SECOND, "diamond"),
        )
        if any(c == continued for _, _, c in ends)
    ]  # fmt: skip
    data.append(
        {
            "type": "scatter", "mode": "lines", "name": "best so far",
            "x": [n for n, _, _ in ends], "y": numbers(so_far), "hoverinfo": "skip",
            "line": {"color": "var(--ink)", "width": 1.8, "shape": "hv"},
        }
    )  # fmt: skip
    look = layout(
        340, xaxis=axis("restart", range=[-0.5, ends[-1][0] + 0.5]),
        yaxis=ratio_axis([v for _, v, _ in ends], "cost at the end, as a ratio", edge=1.02),
        showlegend=True,
    )  # fmt: skip
    alt = "Cost at the end of every restart as a ratio, and the best so far"
    return Figure(data, look, share=50, alt=alt)
