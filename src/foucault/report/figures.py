"""The figures of the report as plain dictionaries for plotly.js; colours name the style sheet.

Importing plotly.graph_objects would cost more than all the rest of the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.report.page import Figure

FloatArray = npt.NDArray[np.float64]
Trace = dict[str, Any]

FIRST, SECOND, THIRD = "var(--first)", "var(--second)", "var(--third)"
SOFT = "var(--soft)"
WARNING, BAD = "var(--warning)", "var(--bad)"


def numbers(values: npt.ArrayLike) -> list[float | None]:
    """Return numbers for JSON, to the six digits a screen can show; None where not finite."""
    array = np.asarray(values, float)
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in array.ravel()]


def layout(height: int, **more: Any) -> dict[str, Any]:
    """Return the look shared by all figures, with `height` [px] and `more` layout keys."""
    axis = {
        "gridcolor": "var(--line)",
        "linecolor": "var(--faint)",
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": "var(--line)",
        "automargin": True,
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
            430,
            xaxis=count_axis("rest", len(x), 12),
            yaxis=axis(f"after [{unit[1]}]", domain=[0, 0.46]),
            yaxis2=axis(f"before [{unit[0]}]", domain=[0.56, 1]),
            shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
        ),
    )


def residuals(
    x: npt.ArrayLike, y: FloatArray, weight: FloatArray, what: str, limit: float
) -> Figure:
    """Draw standardized residuals with their limits; filled less where the weight is less."""
    full = np.asarray(weight) > 0.99
    groups = [(full, FIRST, "circle", "used in full"), (~full, SECOND, "diamond", "weighted down")]
    place = np.asarray(x, float)
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": numbers(place[pick]),
            "y": numbers(y[pick]),
            "customdata": numbers(np.asarray(weight)[pick]),
            "marker": {"color": colour, "size": 8, "symbol": symbol},
            "hovertemplate": (
                f"{what} %{{x}}: %{{y:.2f}} sd, weight %{{customdata:.2f}}<extra></extra>"
            ),
        }
        for pick, colour, symbol, name in groups
        if pick.any()
    ]
    top = 1.12 * max(limit, float(np.max(np.abs(y[np.isfinite(y)]), initial=0.0)))
    signed = bool((y < 0).any())
    limits, bottom = ((limit, -limit), -top) if signed else ((limit,), 0.0)
    return Figure(
        data,
        layout(
            300,
            xaxis=count_axis(what, len(place), 8),
            yaxis=axis("residual / sd", range=[bottom, top]),
            shapes=[level_line(v) for v in limits],
            showlegend=True,
        ),
        share=50,
    )


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
    return Figure([trace], look | {"shapes": [level_line(0, "y", "solid")], "showlegend": False})


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
            xaxis=axis("time [s]", showgrid=False),
            yaxis=axis("level, 1 = at rest", type="log", dtick=1),
            shapes=shapes,
        ),
    )


def correlation(symbols: Sequence[str], matrix: FloatArray) -> Figure:
    """Draw the correlation matrix."""
    ticks = {"tickfont": {"size": 10}, "ticks": "", "showgrid": False, "tickmode": "linear"}
    labels = [_lowered(s) for s in symbols]
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
        520,
        meta={"ratio": 1.1},  # about square on a narrow screen
        xaxis={"type": "category", "tickangle": -90, **ticks},
        yaxis={"type": "category", "autorange": "reversed", **ticks},
    )
    look["margin"] = look["margin"] | {"t": 8}
    return Figure(data, look)


def _lowered(symbol: str) -> str:
    letter, _, index = symbol.partition("_")
    return f"{letter}<sub>{index}</sub>"
