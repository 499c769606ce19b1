"""The figures of the report as plain dictionaries for plotly.js; colours name the style sheet.

Importing plotly.graph_objects would cost more than all the rest of the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.report.page import GREEK, Figure

Trace = dict[str, Any]

FIRST, SECOND, THIRD = "var(--first)", "var(--second)", "var(--third)"
SOFT = "var(--soft)"
WARNING, BAD = "var(--warning)", "var(--bad)"
SERIES = (FIRST, SECOND, THIRD, "var(--fourth)", "var(--fifth)", "var(--sixth)")


MANY = 36
"""More coefficients than this need a larger matrix and smaller names [1]."""

FULL = 0.99
"""Robust weight above which an observation counts in full [1]."""


def numbers(values: npt.ArrayLike) -> list[float | None]:
    """Return numbers for JSON, to the six digits a screen can show; None where not finite."""
    array = np.asarray(values, float).ravel()
    told = zip(array.tolist(), np.isfinite(array).tolist(), strict=True)
    return [float(f"{v:.6g}") if finite else None for v, finite in told]


def layout(height: int, **more: Any) -> dict[str, Any]:
    """Return the look shared by all figures, with `height` [px] and `more` layout keys."""
    axis = {
        "gridcolor": "var(--line)",
        "linecolor": "var(--faint)",
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": "var(--line)",
        "automargin": True,
        "exponentformat": "power",
        "title": {"standoff": 8},
    }
    font = {"family": "system-ui, -apple-system, Segoe UI, Roboto, sans-serif", "size": 12.5}
    hover = {
        "bgcolor": "var(--card)",
        "bordercolor": "var(--line)",
        "font": {"color": "var(--ink)"},
    }
    return {
        "height": height,
        "template": {"layout": {"xaxis": axis, "yaxis": axis}},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": font | {"color": SOFT},
        "margin": {"l": 8, "r": 8, "t": 34, "b": 8},
        "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom", "xanchor": "left"},
        "hoverlabel": hover,
        "dragmode": False,
        **more,
    }


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Return an axis with `title`."""
    return {"title": {"text": title}, **more}


def count_axis(what: str, n: int, ticks: int) -> dict[str, Any]:
    """Return an axis that counts `what` from 1 to `n` with about `ticks` ticks."""
    return axis(what, tick0=1, dtick=max(1, round(n / ticks)), range=[0.2, n + 0.8])


def level_line(y: float, ref: str = "y", dash: str = "dash", colour: str = SOFT) -> Trace:
    """Return a horizontal line across the whole plot."""
    line = {"color": colour, "width": 1.3, "dash": dash}
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": ref,
        "y0": y,
        "y1": y,
        "line": line,
    }


def before_after(
    n: npt.ArrayLike, before: FloatArray, after: FloatArray, sd: FloatArray, unit: tuple[str, str]
) -> Figure:
    """Draw the norm error per rest: before above, after below with the +-2 sd it may have."""
    x = numbers(n)
    edge = numbers(np.concatenate([2 * sd, -2 * sd[::-1]]))
    dots = {"mode": "markers", "type": "scatter", "x": x}
    data = [
        dots
        | {
            "name": "before",
            "y": numbers(before),
            "yaxis": "y2",
            "marker": {"color": SECOND, "size": 8, "symbol": "diamond"},
            "hovertemplate": f"rest %{{x}}: %{{y:.4g}} {unit[0]}<extra>before</extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "name": "±2 sd",
            "x": x + x[::-1],
            "y": edge,
            "fill": "toself",
            "fillcolor": "var(--band)",
            "line": {"width": 0},
            "hoverinfo": "skip",
        },
        dots
        | {
            "name": "after",
            "y": numbers(after),
            "marker": {"color": FIRST, "size": 8},
            "hovertemplate": f"rest %{{x}}: %{{y:.4g}} {unit[1]}<extra>after</extra>",
        },
    ]
    return Figure(
        data,
        layout(
            370,
            xaxis=count_axis("rest", len(x), 12),
            yaxis=axis(f"after [{unit[1]}]", domain=[0, 0.46]),
            yaxis2=axis(f"before [{unit[0]}]", domain=[0.56, 1]),
            shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
        ),
        alt="Error of the norm of specific force per rest, before and after calibration",
    )


def residuals(
    time: npt.ArrayLike, y: FloatArray, weight: FloatArray, what: str, limit: float
) -> Figure:
    """Draw standardized residuals against `time` [s]; filled less where the weight is less."""
    place = np.asarray(time, float)
    data = _weighed(place, y, weight, what, "%{x:.1f} s")
    return Figure(
        data,
        layout(
            300,
            meta={"zoom": True},
            xaxis=axis("time [s]"),
            yaxis=axis(f"{what}: residual / sd", range=_span(y, limit)),
            shapes=_limit_lines(y, limit),
        ),
        share=50,
        alt=f"Standardized residual of every {what} against time, with limits of {limit:g} sd",
    )


def against_up(up: FloatArray, y: FloatArray, weight: FloatArray, limit: float) -> Figure:
    """Draw the error of the norm over its sd against each component of up, shape (n, 3)."""
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    for i, name in enumerate("xyz"):
        ref = str(i + 1) if i else ""
        traces = _weighed(up[:, i], y, weight, "rest", f"up · {name} = %{{x:.2f}}")
        data += [t | {"xaxis": f"x{ref}", "showlegend": i == 0} for t in traces]
        axes[f"xaxis{ref}"] = axis(
            f"up · {name}",
            domain=[i * 0.345, i * 0.345 + 0.31],
            range=[-1.12, 1.12],
            tickvals=[-1, 0, 1],
            tickangle=0,
        )
    look = layout(
        300,
        yaxis=axis("norm error / sd", range=_span(y, limit)),
        shapes=_limit_lines(y, limit),
        showlegend=bool((np.asarray(weight) <= FULL).any()),
        **axes,
    )
    alt = "Error of the norm of every rest over its sd, against the direction of up along x, y, z"
    caption = "up · x is 1 where x points up, 0 where it is level, −1 where it points down."
    return Figure(data, look, caption, share=62, alt=alt)


def against_angle(angle: FloatArray, y: FloatArray, weight: FloatArray, limit: float) -> Figure:
    """Draw standardized residuals of turns against their `angle` [deg]."""
    look = layout(
        300,
        xaxis=axis("angle turned [°]"),
        yaxis=axis("turn: residual / sd", range=_span(y, limit)),
        shapes=_limit_lines(y, limit),
    )
    data = _weighed(angle, y, weight, "turn", "%{x:.0f}°")
    return Figure(data, look, share=38, alt="Standardized residual of every turn against its angle")


def _weighed(
    x: FloatArray, y: FloatArray, weight: FloatArray, what: str, place: str
) -> list[Trace]:
    """Dots, and diamonds where a robust weight is less than 1."""
    full = np.asarray(weight) > FULL
    number = np.arange(1, len(x) + 1)
    groups = [(full, FIRST, "circle", "used in full"), (~full, SECOND, "diamond", "weighted down")]
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "legendgroup": name,
            "x": numbers(x[pick]),
            "y": numbers(y[pick]),
            "customdata": [
                [int(n), w]
                for n, w in zip(number[pick], numbers(np.asarray(weight)[pick]), strict=True)
            ],
            "marker": {"color": colour, "size": 8, "symbol": symbol},
            "hovertemplate": (
                f"{what} %{{customdata[0]}}, {place}: %{{y:.2f}} sd, "
                "weight %{customdata[1]:.2f}<extra></extra>"
            ),
        }
        for pick, colour, symbol, name in groups
        if pick.any()
    ]


def _span(y: FloatArray, limit: float) -> list[float]:
    """The range of an axis that shows all of `y` and its limits."""
    top = 1.12 * max(limit, float(np.max(np.abs(y[np.isfinite(y)]), initial=0.0)))
    return [-top if (y < 0).any() else 0.0, top]


def _limit_lines(y: FloatArray, limit: float) -> list[Trace]:
    values = (limit, -limit) if (y < 0).any() else (limit,)
    return [level_line(v) for v in values]


def shares(symbols: Sequence[str], share: Mapping[str, FloatArray]) -> Figure:
    """Draw the `share` [percent] of each source in the variance of each coefficient."""
    alt = "Share of every source in the variance of every coefficient"
    return stacked([lowered(s) for s in symbols], share, alt)


def stacked(labels: Sequence[str], share: Mapping[str, FloatArray], alt: str) -> Figure:
    """Draw the `share` [percent] of each source in the variance of what has these labels."""
    data = [
        {
            "type": "bar",
            "orientation": "h",
            "name": source,
            "y": labels,
            "x": numbers(values),
            "marker": {
                "color": SERIES[k % len(SERIES)],
                "line": {"color": "var(--card)", "width": 1},
            },
            "hovertemplate": "%{y}: %{x:.1f} %<extra>" + source + "</extra>",
        }
        for k, (source, values) in enumerate(share.items())
    ]
    look = layout(
        90 + 20 * max(len(labels), 5),
        barmode="stack",
        bargap=0.22,
        xaxis=axis("share of the variance [%]", range=[0, 100.5]),
        yaxis={
            "type": "category",
            "autorange": "reversed",
            "tickmode": "linear",
            "ticks": "",
            "tickfont": {"size": 13},
        },
        showlegend=True,
        minreducedheight=40,  # a legend of several lines on a narrow screen gets its room
    )
    look["legend"] = look["legend"] | {"traceorder": "normal"}
    return Figure(data, look, alt=alt)


def held_out(n: npt.ArrayLike, error: FloatArray, sd: FloatArray, unit: str) -> Figure:
    """Draw the norm error of every rest as predicted without it, with +-2 sd."""
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(n),
        "y": numbers(error),
        "error_y": {"type": "data", "array": numbers(2 * sd), "color": FIRST, "thickness": 1.4},
        "marker": {"color": FIRST, "size": 8},
        "hovertemplate": f"rest %{{x}}: %{{y:.4g}} {unit}<extra></extra>",
    }
    x_axis = count_axis("rest", int(np.max(n)), 12)
    look = layout(280, xaxis=x_axis, yaxis=axis(f"predicted error [{unit}]"))
    look["margin"] = look["margin"] | {"t": 12}
    look |= {"shapes": [level_line(0, "y", "solid")], "showlegend": False}
    alt = "Error of the norm of every rest, predicted without it, with two standard deviations"
    return Figure([trace], look, alt=alt)


def detection(
    table: Mapping[str, FloatArray], threshold: float | None, rests: Sequence[tuple[float, float]]
) -> Figure:
    """Draw the moving standard deviation over time with its threshold, rests shaded."""
    x = numbers(table["time"])
    names = (("accel_level", "accelerometers", FIRST), ("gyro_level", "gyros", SECOND))
    data: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": x,
            "y": numbers(np.where(np.asarray(table[column]) > 0, table[column], np.nan)),
            "line": {"color": colour, "width": 1.1},
            "hovertemplate": f"%{{x:.1f}} s: %{{y:.3g}}<extra>{name}</extra>",
        }
        for column, name, colour in names
        if column in table
    ]
    shapes: list[Trace] = [
        {
            "type": "rect",
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "x0": start,
            "x1": end,
            "fillcolor": "var(--rest)",
            "line": {"width": 0},
            "layer": "below",
        }
        for start, end in rests
    ]
    if threshold is not None:
        shapes.append(level_line(threshold))
    return Figure(
        data,
        layout(
            340,
            meta={"zoom": True},
            xaxis=axis("time [s]", showgrid=False),
            yaxis=axis("level, 1 = at rest", type="log", dtick=1),
            shapes=shapes,
        ),
        alt="Moving standard deviation against time with the threshold and the rests found",
    )


def correlation(symbols: Sequence[str], matrix: FloatArray) -> Figure:
    """Draw the correlation matrix."""
    ticks = {"tickfont": {"size": 12.5}, "ticks": "", "showgrid": False, "tickmode": "linear"}
    labels = [lowered(s) for s in symbols]
    many = len(symbols) > MANY
    ticks["tickfont"] = {"size": 10 if many else 12.5}
    data = [
        {
            "type": "heatmap",
            "x": labels,
            "y": labels,
            "z": [numbers(np.round(row, 3)) for row in matrix],
            "zmin": -1,
            "zmax": 1,
            "colorscale": [[0, "var(--low)"], [0.5, "var(--zero)"], [1, "var(--high)"]],
            "colorbar": {"thickness": 10, "outlinewidth": 0, "tickvals": [-1, -0.5, 0, 0.5, 1]},
            "xgap": 1,
            "ygap": 1,
            "hovertemplate": "%{y}, %{x}: %{z:.2f}<extra></extra>",
        }
    ]
    look = layout(
        760 if many else 520,
        # About square on a narrow screen, where the columns have no room for their names.
        meta={
            "ratio": 1.05,
            "narrow": {
                "xaxis": {"showticklabels": False},
                "yaxis": {"tickfont": {"size": 10}, "showticklabels": not many},
            },
        },
        xaxis={"type": "category", "tickangle": -90, **ticks},
        yaxis={"type": "category", "autorange": "reversed", **ticks},
    )
    look["margin"] = look["margin"] | {"t": 8}
    return Figure(data, look, alt="Correlation of every pair of coefficients, from -1 to 1")


def lowered(symbol: str) -> str:
    """Write a symbol for a figure, its index lowered."""
    letter, _, index = symbol.partition("_")
    letter = GREEK.get(letter, letter)
    return f"{letter}<sub>{index}</sub>" if index else letter
