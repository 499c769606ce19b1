"""Figures of a tumble: how each estimate came about, residuals, and sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.report.figures import FIRST, SERIES, Trace, axis, layout, level_line, numbers
from foucault.report.figures_motion import COLOURS, heading, leg_lines
from foucault.report.page import Figure

GUIDE = 3.0
"""Lines and bands are drawn at so many standard deviations [1]."""

DOTS = 700
"""So many residuals of an axis are drawn, and beyond the lines twice as many more [1]."""

TICKS = 2
"""Powers of ten that are marked on each side of zero [1]."""

NEAR = 0.22
"""A mark nearer to zero than this part of the axis would stand on the zero [1]."""

CURVES = 160
"""Points of a sensitivity curve that are drawn [1]."""


@dataclass(frozen=True)
class Family:
    """Coefficients that are drawn together, in one unit."""

    name: str  # of the group, shape ()
    members: tuple[str, ...]  # names of its columns
    labels: tuple[str, ...]  # how each is called in the figure
    unit: str  # as people write it, shape ()
    size: float  # one unit [SI]


def _ref(k: int) -> str:
    return str(k + 1) if k else ""


# -- estimates and residuals -----------------------------------------------------------------


def course(
    time: FloatArray, family: Family, values: FloatArray, sd: FloatArray,
    legs: Sequence[Mapping[str, Any]],
) -> Figure:  # fmt: skip
    """Draw estimates minus the last, shape (k, 3) [SI], in their bands; one panel each.

    Both are compressed beyond the smallest final standard deviation: logarithmic, with zero.
    """
    y, band = values / family.size, GUIDE * sd / family.size
    unit = float(np.min(band[-1], where=band[-1] > 0, initial=np.inf)) / GUIDE
    unit = unit if np.isfinite(unit) else 1.0
    top = float(np.max(np.abs([y, band]), where=np.isfinite([y, band]), initial=10 * unit))

    def drawn(v: FloatArray) -> FloatArray:
        return np.asarray(np.sign(v) * np.log10(1 + np.abs(v) / unit))

    data: list[Trace] = []
    axes: dict[str, Any] = {}
    notes: list[Trace] = [heading(f"<b>{family.name}</b> [{family.unit}]")]
    x, n = numbers(time), len(family.members)
    decade = 10.0 ** math.floor(math.log10(0.85 * time[-1]))
    mark = decade * max(k for k in (1, 2, 4, 5, 8) if k * decade <= 0.85 * time[-1])
    for k, label in enumerate(family.labels):
        on = {"xaxis": f"x{_ref(k)}", "type": "scatter", "mode": "lines", "showlegend": False}
        edge = np.concatenate([drawn(band[:, k]), -drawn(band[::-1, k])])
        data.append(
            on
            | {
                "x": x + x[::-1], "y": numbers(np.round(edge, 4)), "fill": "toself",
                "fillcolor": "var(--band)", "line": {"width": 0}, "hoverinfo": "skip",
            }
        )  # fmt: skip
        data.append(
            on
            | {
                "x": x, "y": numbers(np.round(drawn(y[:, k]), 4)),
                "line": {"color": FIRST, "width": 1.6},
                "customdata": [
                    [_short(a), _short(b)]
                    for a, b in zip(y[:, k], band[:, k], strict=True)
                ],
                "hovertemplate": f"{label}, %{{x:.0f}} s: %{{customdata[0]}} ± %{{customdata[1]}} "
                f"{family.unit}<extra></extra>",
            }
        )  # fmt: skip
        domain = [k / n + 0.012 * (k > 0), (k + 1) / n - 0.012 * (k < n - 1)]
        axes[f"xaxis{_ref(k)}"] = {
            "domain": domain, "range": [0, time[-1]], "tickvals": [mark], "showgrid": False,
        }  # fmt: skip
        notes.append(_label(label, sum(domain) / 2))
    ticks, words = _symmetric(unit, top)
    high = 1.05 * float(drawn(np.array(top)))
    look = layout(
        190, annotations=notes, **axes, shapes=[level_line(0, dash="solid"), *_panel_legs(legs, n)],
        yaxis={"tickvals": numbers(drawn(ticks)), "ticktext": words,
               "range": [-high, high]},
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 46}
    alt = f"{family.name}: estimate minus the last one against time, within three sd"
    return Figure(data, look, share=50, alt=alt)


def _short(value: float) -> float | None:
    return float(f"{value:.3g}") if math.isfinite(value) else None


def _panel_legs(legs: Sequence[Mapping[str, Any]], panels: int) -> list[Trace]:
    return [
        line | {"xref": f"x{_ref(k)}", "yref": "paper"}
        for k in range(panels)
        for line in leg_lines(legs)
    ]


def _label(text: str, x: float) -> Trace:
    return {
        "text": text, "x": x, "xref": "paper", "xanchor": "center", "y": 1, "yref": "paper",
        "yanchor": "bottom", "showarrow": False,
    }  # fmt: skip


def _symmetric(unit: float, top: float) -> tuple[FloatArray, list[str]]:
    """Return powers of ten between `unit` and `top`, both signs and zero, and their texts."""
    high = math.floor(math.log10(top))
    step = max(1, math.ceil((high - math.log10(unit)) / TICKS - 0.2))
    powers = [high - step * k for k in range(TICKS)]
    least = NEAR * math.log10(1 + top / unit)
    powers = [p for p in powers if math.log10(1 + 10.0**p / unit) > least]
    values = [sign * 10.0**p for p in powers for sign in (1, -1)]
    words = [sign + _power(p) for p in powers for sign in ("", "−")]
    return np.array([0.0, *values]), ["0", *words]


def _power(p: int) -> str:
    return f"{10.0**p:g}" if -4 < p < 5 else f"10<sup>{p}</sup>".replace("-", "−")


def residuals(
    time: FloatArray, white: Mapping[str, FloatArray], legs: Sequence[Mapping[str, Any]]
) -> Figure:
    """Draw white residuals of three accelerometers against time, thinned."""
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    for k, (name, y) in enumerate(white.items()):
        far = np.flatnonzero(np.abs(y) > GUIDE)
        keep = np.union1d(_evenly(np.arange(len(y)), DOTS), _evenly(far, 2 * DOTS))
        data.append(
            {
                "type": "scatter", "mode": "markers", "x": numbers(time[keep]),
                "y": numbers(np.round(y[keep], 3)), "yaxis": f"y{_ref(k)}", "showlegend": False,
                "marker": {"color": COLOURS[name], "size": 4, "opacity": 0.65},
                "hovertemplate": f"%{{x:.0f}} s: %{{y:.2f}} sd<extra>{name}</extra>",
            }
        )  # fmt: skip
        top = 1.08 * float(np.max(np.abs(y), where=np.isfinite(y), initial=4.0))
        low = (2 - k) / 3
        axes[f"yaxis{_ref(k)}"] = axis(
            f"{name}: residual / sd", domain=[low + 0.02, low + 0.31], range=[-top, top]
        )
    lines = [level_line(v, f"y{_ref(k)}") for k in range(len(white)) for v in (-GUIDE, GUIDE)]
    look = layout(
        480, meta={"zoom": True}, **axes, xaxis=axis("time [s]", anchor=f"y{len(white)}"),
        shapes=[*lines, *leg_lines(legs)],
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 8}
    alt = "White residuals of the three accelerometers against time, with lines at three sd"
    return Figure(data, look, alt=alt)


def _evenly(rows: npt.NDArray[Any], most: int) -> npt.NDArray[Any]:
    """Return at most `most` [1] of the rows, evenly chosen."""
    n = len(rows)
    return rows if n <= most else rows[np.linspace(0, n - 1, most).astype(int)]


# -- sensitivity -----------------------------------------------------------------------------


def sensitivity(
    title: str, table: Mapping[str, FloatArray], families: Sequence[Family],
    legs: Sequence[Mapping[str, Any]],
) -> Figure:  # fmt: skip
    """Draw d(reading)/d(coefficient) of the accelerometers that answer, one panel each."""
    data = [t for family in families for t in _curves(table, family)]
    strongest = {
        a: max(float(np.abs(table[f"{a}.{m}"]).max()) for f in families for m in f.members)
        for a in COLOURS
    }
    shown = [a for a, size in strongest.items() if size > 1e-4 * max(strongest.values())]
    data = [t for t in data if t["meta"][0] in shown]
    names = [t["meta"][1] for t in data]
    for t in data:
        axes = {"yaxis": f"y{_ref(shown.index(t['meta'][0]))}"}
        first = t["meta"][0] == shown[0]
        t.update(axes, line=t["line"] | {"color": SERIES[_place(names, t["meta"][1])]},
                 showlegend=first)  # fmt: skip
        del t["meta"]
    look = _sensitivity_look(shown, legs, 320)
    look["annotations"] = [heading(f"<b>{title}</b>")]
    look["margin"] = look["margin"] | {"t": 60}
    alt = f"Change of the accelerometers' readings with {title} against time"
    return Figure(data, look, share=50, alt=alt)


def explorer(
    table: Mapping[str, FloatArray], families: Sequence[Family], legs: Sequence[Mapping[str, Any]]
) -> Figure:
    """Draw the same of one family at a time, which a list chooses."""
    data: list[Trace] = []
    choices: list[str] = []
    for family in families:
        curves = _curves(table, family)
        names = [t["meta"][1] for t in curves]
        choices.append(f"{family.name} [µg per {family.unit}]")
        for t in curves:
            output, name = t["meta"]
            t |= {"yaxis": f"y{_ref('xyz'.index(output))}", "showlegend": output == "x",
                  "meta": choices[-1]}  # fmt: skip
            t["line"] = t["line"] | {"color": SERIES[_place(names, name)]}
            data.append(t)
    look = _sensitivity_look(list("xyz"), legs, 440)
    look["meta"] |= {"choices": choices, "choose": "Change of the readings with"}
    alt = "Change of the accelerometers' readings with the chosen coefficients against time"
    return Figure(data, look, on="screen", alt=alt)


def _place(names: Sequence[str], name: str) -> int:
    return list(dict.fromkeys(names)).index(name)


def _curves(table: Mapping[str, FloatArray], family: Family) -> list[Trace]:
    """Curves of every accelerometer in micro-g per unit; `meta` says which."""
    time = np.asarray(table["time"], float)
    rows = _evenly(np.arange(len(time)), CURVES)
    out = []
    for a in COLOURS:
        for member, label in zip(family.members, family.labels, strict=True):
            y = np.asarray(table[f"{a}.{member}"], float)[rows] * family.size / (1e-6 * 9.80665)
            out.append(
                {
                    "type": "scatter", "mode": "lines", "name": label, "legendgroup": label,
                    "x": numbers(np.round(time[rows], 1)), "y": [_short(v) for v in y],
                    "line": {"width": 1.8}, "meta": (a, label),
                    "hovertemplate": f"%{{x:.0f}} s: %{{y:.3g}} µg per {family.unit}"
                    f"<extra>{label} → {a}</extra>",
                }
            )  # fmt: skip
    return out


def _sensitivity_look(
    outputs: Sequence[str], legs: Sequence[Mapping[str, Any]], height: int
) -> dict[str, Any]:
    n = len(outputs)
    axes = {
        f"yaxis{_ref(k)}": axis(
            a,
            domain=[1 - (k + 1) / n + 0.035 * (k < n - 1), 1 - k / n - 0.035 * (k > 0)], nticks=4,
            exponentformat="none",
        )
        for k, a in enumerate(outputs)
    }  # fmt: skip
    zero = [level_line(0, f"y{_ref(k)}", "solid", "var(--faint)") for k in range(n)]
    return layout(
        height, meta={"zoom": True}, separators=". ", **axes, shapes=[*zero, *leg_lines(legs)],
        xaxis=axis("time [s]", anchor=f"y{_ref(n - 1)}", showgrid=False),
    )  # fmt: skip
