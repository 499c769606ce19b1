"""Figures of a navigation: map with error ellipses, growth of the error, terms, contributions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from foucault.report.page import Figure

POINTS = 1500
"""Points that a line is drawn with [1]."""

TICKS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 180, 240, 360, 720, 1440)
"""Ages that may be marked on a path [min]."""


ROUND = tuple(m * 10.0**k for k in range(-4, 5) for m in (1, 2, 5))
"""Where a logarithmic axis of time has ticks [any]."""


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


def thinned(n: int) -> npt.NDArray[np.int64]:
    """Return the rows of `n` that are drawn, the last one among them."""
    step = -(-n // POINTS)
    return np.arange(n)[::-1][::step][::-1]


def ellipse(cov: FloatArray, times: float = 2.0) -> FloatArray:
    """Return the outline, shape (2, 61), of so many standard deviations of a `cov`, (2, 2)."""
    values, axes = np.linalg.eigh(cov)
    angle = np.linspace(0, 2 * np.pi, 61)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(times * axes @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle))


def _line(name: str, x: FloatArray, y: FloatArray, colour: str, **more: Any) -> Trace:
    line = {"color": colour, "width": 2.2} | more.pop("line", {})
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": numbers(x), "y": numbers(y),
        "line": line,
    } | more  # fmt: skip


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
    reach = max(
        (float(np.nanmax(np.abs(v), initial=0.0)) for _, e, n, _, _ in lines for v in (e, n)),
        default=1.0,
    )
    unit, size = length_unit(reach)
    data: list[Trace] = []
    for k, (east, north, cov) in enumerate(ellipses):
        x, y = ellipse(cov)
        data.append(
            _line(f"±2 sd, {predicted}", (east + x) / size, (north + y) / size, FIRST,
                  line={"width": 1}, fill="toself", fillcolor="var(--band)", showlegend=k == 0,
                  legendgroup="ellipse", hoverinfo="skip")
        )  # fmt: skip
    for name, e, n, colour, dash in lines:
        rows = thinned(len(e))
        data.append(
            _line(name, e[rows] / size, n[rows] / size, colour, line={"dash": dash},
                  hovertemplate=f"%{{x:.4g}} east, %{{y:.4g}} {unit} north<extra>{name}</extra>")
        )  # fmt: skip
    if marks:
        data.append(
            {
                "type": "scatter", "mode": "markers+text", "showlegend": False,
                "x": numbers([m[1] / size for m in marks]),
                "y": numbers([m[2] / size for m in marks]),
                "text": [m[0] for m in marks], "textposition": "top center",
                "marker": {"color": FIRST, "size": 6}, "hoverinfo": "skip",
                "textfont": {"color": SOFT, "size": 11.5},
            }
        )  # fmt: skip
    data.append(
        {
            "type": "scatter", "mode": "markers", "name": "start", "x": [0], "y": [0],
            "marker": {"color": "var(--ink)", "size": 9, "symbol": "x-thin",
                       "line": {"color": "var(--ink)", "width": 2}},
            "hoverinfo": "skip",
        }
    )  # fmt: skip
    look = layout(
        450,
        meta={"ratio": 1.0, "zoom": True},
        xaxis=axis(f"{what}east [{unit}]", constrain="domain"),
        yaxis=axis(f"{what}north [{unit}]", scaleanchor="x", scaleratio=1, constrain="domain"),
        showlegend=True,
    )
    return Figure(data, look, caption, share=share, alt="Map of the paths, north on top")


def growth(
    age: FloatArray, lines: Sequence[tuple[str, FloatArray, str]],
    expected: tuple[str, FloatArray], share: int = 100,
) -> Figure:  # fmt: skip
    """Draw the horizontal error [m] against `age` [s], with the radius that holds half of it."""
    predicted, sd = expected
    t_unit, t = time_unit(float(age[-1]))
    largest = max((float(np.nanmax(y, initial=0.0)) for _, y, _ in lines), default=0.0)
    unit, size = length_unit(max(largest, float(np.nanmax(sd, initial=0.0))))
    data = [
        _line(f"{predicted}, half of all runs", age / t, sd / size, SOFT,
              line={"width": 1.6, "dash": "dash"},
              hovertemplate=f"%{{x:.3g}} {t_unit}: %{{y:.4g}} {unit}<extra>{predicted}</extra>")
    ]  # fmt: skip
    for name, y, colour in lines:
        data.append(
            _line(name, age / t, y / size, colour,
                  hovertemplate=f"%{{x:.3g}} {t_unit}: %{{y:.4g}} {unit}<extra>{name}</extra>")
        )  # fmt: skip
    look = layout(
        360,
        meta={"zoom": True},
        xaxis=axis(f"since the start [{t_unit}]"),
        yaxis=axis(f"horizontal error [{unit}]", rangemode="tozero"),
        showlegend=True,
    )
    alt = "Horizontal position error against time, with what was predicted"
    return Figure(data, look, share=share, alt=alt)


def logarithmic(
    age: FloatArray, lines: Sequence[tuple[str, FloatArray, str]],
    expected: tuple[str, FloatArray], t_unit: tuple[str, float], share: int = 100,
) -> Figure:  # fmt: skip
    """Draw the same on logarithmic axes; a slope of 1 is a drift, 2 a tilt, 3 a gyro bias."""
    predicted, half = expected
    late = age > 0.005 * age[-1]
    dashed = {"width": 1.6, "dash": "dash"}
    data = [_line(predicted, age[late] / t_unit[1], half[late], SOFT, line=dashed,
                  showlegend=False)]  # fmt: skip
    data += [
        _line(name, age[late] / t_unit[1], np.maximum(y[late], 1e-9), colour, showlegend=False,
              hovertemplate=f"%{{y:.4g}} m<extra>{name}</extra>")
        for name, y, colour in lines
    ]  # fmt: skip
    top = max(float(np.nanmax(y[late], initial=1e-3)) for _, y, _ in [*lines, ("", half, "")])
    low = float(np.nanmin([np.nanpercentile(y[late], 1) for _, y, _ in lines] or [top]))
    low = max(low, 1e-5 * top)
    look = layout(
        360,
        meta={"zoom": True},
        xaxis=axis(f"since the start [{t_unit[0]}]", type="log", tickvals=list(ROUND),
                   range=[float(np.log10(v / t_unit[1])) for v in (age[late][0], age[-1])]),
        yaxis=axis("horizontal error [m]", type="log", dtick=1, exponentformat="power",
                   range=[float(np.log10(low)) - 0.1, float(np.log10(top)) + 0.2]),
        showlegend=False,
    )  # fmt: skip
    return Figure(data, look, share=share, alt="The same on logarithmic axes")


def banded(
    time: FloatArray,
    panels: Sequence[tuple[str, FloatArray, FloatArray, FloatArray | None]],
    t_unit: tuple[str, float],
    height: int = 150,
    alt: str = "",
    names: tuple[str, str] = ("error", "without calibration"),
    predicted: str = "predicted",
) -> Figure:
    """Draw errors with the bands of one and two standard deviations, one panel below the other.

    A panel is its title, the error, its sd and the error of another run.
    """
    n, gap = len(panels), 0.07 if len(panels) > 1 else 0.0
    each = (1 - gap * (n - 1)) / n
    x = time / t_unit[1]
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis(f"since the start [{t_unit[0]}]", anchor="y")}
    shapes = []
    for k, (title, y, sd, other) in enumerate(panels):
        ref = str(n - k) if n - k > 1 else ""
        place = {"yaxis": f"y{ref}"}
        for times, name in ((2, f"±2 sd, {predicted}"), (1, "±1 sd")):
            data.append(_band(x, times * sd, name, k == 0) | place)
        if other is not None:
            data.append(
                _line(names[1], x, other, SECOND, line={"width": 1.6}, showlegend=k == 0,
                      legendgroup=names[1], hovertemplate=f"%{{y:.4g}}<extra>{names[1]}</extra>")
                | place
            )  # fmt: skip
        data.append(
            _line(names[0], x, y, FIRST, showlegend=k == 0, legendgroup=names[0],
                  hovertemplate=f"%{{y:.4g}}<extra>{title}</extra>") | place
        )  # fmt: skip
        top = 1 - k * (each + gap)
        axes[f"yaxis{ref}"] = axis(title, domain=[max(0.0, top - each), top])
        shapes.append(level_line(0, f"y{ref}", "solid"))
    look = layout(70 + height * n, meta={"zoom": True}, shapes=shapes, showlegend=True, **axes)
    return Figure(data, look, alt=alt)


def _band(x: FloatArray, reach: FloatArray, name: str, shown: bool) -> Trace:
    known = np.isfinite(reach)
    x, reach = x[known], reach[known]
    return {
        "type": "scatter", "mode": "lines", "name": name, "legendgroup": name,
        "x": numbers(np.concatenate([x, x[::-1]])),
        "y": numbers(np.concatenate([reach, -reach[::-1]])), "fill": "toself",
        "fillcolor": "var(--band)", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": shown,
    }  # fmt: skip


def series(
    time: FloatArray, panels: Sequence[tuple[str, Sequence[tuple[str, FloatArray]]]],
    t_unit: tuple[str, float], height: int = 170, alt: str = "", share: int = 100,
) -> Figure:  # fmt: skip
    """Draw quantities over time, one panel below the other; a panel is its title and its lines."""
    n, gap = len(panels), 0.08 if len(panels) > 1 else 0.0
    each = (1 - gap * (n - 1)) / n
    rows = thinned(len(time))
    x = time[rows] / t_unit[1]
    data: list[Trace] = []
    axes: dict[str, Any] = {"xaxis": axis(f"since the start [{t_unit[0]}]", anchor="y")}
    seen: set[str] = set()
    for k, (title, lines) in enumerate(panels):
        ref = str(n - k) if n - k > 1 else ""
        for i, (name, y) in enumerate(lines):
            data.append(
                _line(name, x, np.asarray(y)[rows], SERIES[i % len(SERIES)], line={"width": 1.6},
                      yaxis=f"y{ref}", showlegend=len(lines) > 1 and name not in seen,
                      legendgroup=name,
                      hovertemplate=f"%{{y:.5g}}<extra>{name}</extra>")
            )  # fmt: skip
            seen.add(name)
        top = 1 - k * (each + gap)
        axes[f"yaxis{ref}"] = axis(title, domain=[max(0.0, top - each), top])
    look = layout(70 + height * n, meta={"zoom": True}, showlegend=len(seen) > 1, **axes)
    return Figure(data, look, alt=alt, share=share)


def terms(
    age: FloatArray, observed: FloatArray, parts: Mapping[str, FloatArray], noise: FloatArray,
    axis_name: str,
) -> Figure:  # fmt: skip
    """Draw the error along one axis [m], the terms of at least a hundredth of it, and their sum.

    `noise` is the sd [m] that sensor noise adds to the sum.
    """
    t_unit, t = time_unit(float(age[-1]))
    largest = max(float(np.max(np.abs(v))) for v in (observed, *parts.values()))
    unit, size = length_unit(largest)
    total = np.sum(list(parts.values()), axis=0)
    band = _band(age / t, 2 * noise / size, "sensor noise, ±2 sd", True)
    band["y"] = numbers(np.concatenate([total + 2 * noise, (total - 2 * noise)[::-1]]) / size)
    data = [
        band,
        {
            "type": "scatter", "mode": "markers", "name": "error", "x": numbers(age / t),
            "y": numbers(observed / size), "marker": {"color": FIRST, "size": 5},
            "hovertemplate": f"%{{x:.3g}} {t_unit}: %{{y:.4g}} {unit}<extra>error</extra>",
        },
        _line("all terms", age / t, total / size, "var(--ink)", line={"width": 1.4}),
    ]  # fmt: skip
    colours = dict(zip(parts, (*SERIES[1:], SERIES[1], SERIES[2]), strict=False))
    for name, y in parts.items():
        if np.max(np.abs(y)) >= 0.02 * largest:
            data.append(
                _line(name, age / t, y / size, colours[name], line={"width": 1.6, "dash": "dot"},
                      hovertemplate=f"%{{y:.4g}} {unit}<extra>{name}</extra>")
            )  # fmt: skip
    look = layout(
        400,
        meta={"zoom": True},
        xaxis=axis(f"since the start [{t_unit}]"),
        yaxis=axis(f"{axis_name} [{unit}]"),
        shapes=[level_line(0, "y", "solid")],
        showlegend=True,
    )
    alt = f"Position error {axis_name} with the terms of free inertial drift"
    return Figure(data, look, share=50, alt=alt)


def contributions(
    names: Sequence[str], worth: FloatArray, left: FloatArray, unit: tuple[str, float]
) -> Figure:
    """Draw metres at the end by coefficient: before it was corrected, and what is left (sd)."""
    bar = {"type": "bar", "orientation": "h", "y": list(names)}
    said = f"%{{y}}: %{{x:.3g}} {unit[0]}<extra>"
    data = [
        bar | {"name": "before correction", "x": numbers(worth / unit[1]),
               "marker": {"color": SECOND}, "hovertemplate": said + "before correction</extra>"},
        bar | {"name": "left, sd", "x": numbers(left / unit[1]), "marker": {"color": FIRST},
               "hovertemplate": said + "left, sd</extra>"},
    ]  # fmt: skip
    values = np.concatenate([worth, left])
    values = values[np.isfinite(values) & (values > 0)] / unit[1]
    low = max(float(values.min(initial=np.inf)), float(values.max(initial=1.0)) * 1e-4)
    high = float(values.max(initial=1.0))
    look = layout(
        96 + 30 * len(names),
        barmode="group",
        bargap=0.25,
        xaxis=axis(f"horizontal position at the end [{unit[0]}]", type="log",
                   range=[float(np.log10(low)) - 0.2, float(np.log10(high)) + 0.2], dtick=1),
        yaxis={"type": "category", "autorange": "reversed", "tickmode": "linear", "ticks": ""},
        showlegend=True,
    )  # fmt: skip
    look["legend"] = look["legend"] | {"traceorder": "normal"}
    return Figure(data, look, alt="Horizontal position at the end by coefficient")
