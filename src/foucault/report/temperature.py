"""What a fit over temperature showed: functions with the sessions, terms, and what was left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient
from foucault.models.temperature import TemperatureModel
from foucault.report.certificate import date
from foucault.report.figures import SERIES, Trace, axis, layout, level_line, lowered, numbers
from foucault.report.page import Block, Column, Figure, Section, Table, Text
from foucault.report.uncertainty import TRIADS, shown
from foucault.result import Result
from foucault.units import ZERO_CELSIUS

LIMIT = 3.0
"""Lines of the figures of residuals [sd]."""


def functions(result: Result) -> Section | None:
    """Every family over temperature: the functions, their band, and what the sessions found."""
    curves, model = result.tables.get("temperature_curves"), result.temperature
    if curves is None or model is None:
        return None
    families = {row["family"]: row for row in result.diagnostics.get("families") or []}
    blocks: list[Block] = [_figure(result, curves, list(families)), _families(families.values())]
    low, high, at = (
        f"{_celsius(v)}\N{NO-BREAK SPACE}°C" for v in (model.low, model.high, model.reference)
    )
    blocks.append(Text(_equation(model)))
    lead = (
        f"Valid from {low} to {high} and nowhere else. Drawn is how each coefficient differs from "
        f"its value at {at}. The band is two standard deviations of the function; bars are those "
        "of a session."
    )
    return Section("Over temperature", lead, blocks)


def _equation(model: TemperatureModel) -> str:
    if model.knots.size:
        knots = ", ".join(_celsius(k) for k in model.knots)
        return f"Functions are straight lines between knots at {knots} °C."
    return (
        f"Functions are sums of powers of T − {_celsius(model.reference)} °C; the weights are in "
        "`temperature.functions` of result.json."
    )


def _figure(result: Result, curves: Mapping[str, Any], families: Sequence[str]) -> Figure:
    data: list[Trace] = []
    points = result.tables["temperature_points"]
    ramps = result.tables.get("temperature_ramps") or {}
    # Families that change come first: the list opens with what matters.
    changing = {n.rpartition(".")[0] for n in (result.temperature.varying() if result.temperature
                                               else ())}  # fmt: skip
    order = sorted(families, key=lambda f: f not in changing)
    names = result.coefficients.layout
    choices = []
    for family in order:
        members = [c for c in names.coefficients if (c.name.rpartition(".")[0] or c.name) == family]
        size = max(float(np.ptp(_of(curves, c.name, "value"))) for c in members)
        size = max(size, *(float(_of(curves, c.name, "sd").max()) for c in members))
        unit = units.display_unit(members[0].kind, size)
        label = f"{family} [{shown(unit)}]"
        choices.append(label)
        for k, c in enumerate(members):
            start = result.coefficients.value(c.name)
            scale = units.factor(unit, c.kind)
            data += _traces(c, curves, points, ramps, start, scale, SERIES[k % 6], label)
    look = layout(
        430,
        meta={"choices": choices, "choose": "coefficients"},
        xaxis=axis("temperature [°C]"),
        yaxis=axis("difference from the reference"),
        shapes=[level_line(0, "y", "solid")],
    )
    alt = "Coefficients against temperature with two standard deviations, and what sessions found"
    return Figure(data, look, alt=alt)


def _traces(
    c: Coefficient, curves: Mapping[str, Any], points: Mapping[str, Any], ramps: Mapping[str, Any],
    start: float, scale: float, colour: str, label: str,
) -> list[Trace]:  # fmt: skip
    """Return band, curve and points of one coefficient."""
    x = _of(curves, c.name, "temperature") - ZERO_CELSIUS
    y = (_of(curves, c.name, "value") - start) / scale
    sd = _of(curves, c.name, "sd") / scale
    name = lowered(c.symbol)
    common = {"type": "scatter", "meta": label, "legendgroup": c.name}
    hover = f"%{{x:.1f}} °C: %{{y:.4g}}<extra>{c.name}</extra>"
    band = common | {
        "mode": "lines", "x": numbers(np.r_[x, x[::-1]]),
        "y": numbers(np.r_[y + 2 * sd, (y - 2 * sd)[::-1]]), "fill": "toself",
        "fillcolor": "var(--band)", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False,
    }  # fmt: skip
    line = common | {
        "mode": "lines", "name": name, "x": numbers(x), "y": numbers(y),
        "line": {"color": colour, "width": 1.8}, "hovertemplate": hover,
    }  # fmt: skip
    out: list[Trace] = [band, line]
    if ramps and (np.asarray(ramps["coefficient"]) == c.name).any():
        out.append(common | {
            "mode": "markers", "showlegend": False,
            "x": numbers(_of(ramps, c.name, "temperature") - ZERO_CELSIUS),
            "y": numbers((_of(ramps, c.name, "value") - start) / scale),
            "marker": {"color": colour, "size": 4, "symbol": "circle-open"},
            "hovertemplate": hover.replace("</extra>", ", ramp</extra>"),
        })  # fmt: skip
    seen = np.asarray(points["coefficient"]) == c.name
    if seen.any():
        bars = {"type": "data", "array": numbers(2 * _of(points, c.name, "sd") / scale),
                "color": colour, "thickness": 1.3, "width": 0}  # fmt: skip
        out.append(common | {
            "mode": "markers", "showlegend": False, "error_y": bars,
            "x": numbers(_of(points, c.name, "temperature") - ZERO_CELSIUS),
            "y": numbers((_of(points, c.name, "value") - start) / scale),
            "customdata": np.asarray(points["session"])[seen].tolist(),
            "marker": {"color": colour, "size": 8},
            "hovertemplate": "%{customdata}, " + hover,
        })  # fmt: skip
    return out


def _families(rows: Any) -> Table:
    columns = [
        Column("coefficients", "name"),
        Column("function"),
        Column("temperatures", "number", aside=True),
        Column("scatter between sessions", "number"),
        Column("why this function", "text", aside=True),
    ]
    return Table(columns, [[row["family"], row["function"], str(row["temperatures"]),
                            _scatter(row), _why(row)] for row in rows])  # fmt: skip


def _scatter(row: Mapping[str, Any]) -> str:
    from foucault.models.layouts import EVERY

    kind = EVERY.coefficients[int(EVERY.group(row["family"])[0])].kind
    sd = row["scatter"]
    if sd is None or not np.isfinite(sd):
        return "cannot be told"
    unit = units.display_unit(kind, sd)
    size = f"{units.plain(units.convert(sd, kind, unit), 2)} {shown(unit)}" if sd else "none seen"
    return size if row["scatter_found"] else f"{size if sd else 'none'} (declared)"


def _why(row: Mapping[str, Any]) -> str:
    """Say the F-tests in a sentence."""
    words = []
    for key, text in (("needed", "better than a {has}"), ("missing", "a {against} adds nothing")):
        test = row.get(key)
        if test is not None:
            lost = key == "missing" and test["p"] < 0.01
            said = "a {against} may fit better" if lost else text
            words.append(f"{said.format(**test)} (F {test['F']:.3g}, p {_chance(test['p'])})")
    return "; ".join(words)


def _chance(p: float) -> str:
    return "< 1e−6" if p < 1e-6 else f"{p:.2g}".replace("-", "−")


def left_out(result: Result) -> Section | None:
    """Residuals, and every temperature as predicted by the others."""
    points = result.tables.get("temperature_points")
    if points is None:
        return None
    blocks: list[Block] = []
    if len(result.diagnostics.get("sessions") or []) > 1:  # one is met exactly
        words = "What sessions found minus the functions."
        blocks.append(_scattered(points, "residual", "residual / sd", words))
    if np.isfinite(np.asarray(points["left_out"], float)).any():
        words = "What sessions found minus what the others predict."
        blocks.append(_scattered(points, "left_out", "left out: error / sd", words))
    blocks.append(_sessions(result))
    lead = (
        "One dot for each coefficient of each session, in standard deviations with the scatter "
        "between sessions. At the ends of the range the others must extrapolate."
    )
    return Section("Sessions", lead, blocks)


def _scattered(points: Mapping[str, Any], column: str, what: str, caption: str) -> Figure:
    y = np.asarray(points[column], float)
    triads = np.array([str(n).partition(".")[0] for n in points["coefficient"]])
    data: list[Trace] = []
    x = np.asarray(points["temperature"], float) - ZERO_CELSIUS
    said = zip(points["coefficient"], points["session"], strict=True)
    labels = np.array([f"{coefficient}, {session}" for coefficient, session in said])
    for k, triad in enumerate(dict.fromkeys(triads.tolist())):
        pick = (triads == triad) & np.isfinite(y)
        data.append({
            "type": "scatter", "mode": "markers", "name": TRIADS.get(triad, triad),
            "x": numbers(x[pick]),
            "y": numbers(y[pick]), "text": labels[pick].tolist(),
            "marker": {"color": SERIES[k % 6], "size": 6, "opacity": 0.8},
            "hovertemplate": "%{text}, %{x:.1f} °C: %{y:.2f} sd<extra></extra>",
        })  # fmt: skip
    top = 1.12 * max(LIMIT, float(np.nanmax(np.abs(y), initial=0.0)))
    look = layout(
        320,
        xaxis=axis("temperature [°C]"),
        yaxis=axis(what, range=[-top, top]),
        shapes=[level_line(0, "y", "solid"), level_line(LIMIT), level_line(-LIMIT)],
    )
    return Figure(data, look, caption, share=50, alt=f"{what} of every coefficient of every "
                  "session against its temperature")  # fmt: skip


def _sessions(result: Result) -> Table:
    columns = [
        Column("session"),
        Column("mean [°C]", "number"),
        Column("range [°C]", "number", aside=True),
        Column("procedure", "text", aside=True),
        Column("verdict"),
        Column("made", "text", aside=True),
    ]
    rows = []
    for one in result.diagnostics.get("sessions") or []:
        low, high = (_celsius(v) for v in one["range"])
        made = date(str(one["created"])) if one.get("created") else ""
        rows.append([one["name"], _celsius(one["temperature"]), f"{low} to {high}",
                     one["procedure"], one["verdict"], made])  # fmt: skip
    for one in result.diagnostics.get("ramps") or []:
        low, high = (_celsius(v) for v in one["range"])
        rows.append([one["name"], "", f"{low} to {high}", "ramp", "", ""])
    return Table(columns, rows)


def _of(table: Mapping[str, Any], name: str, column: str) -> FloatArray:
    mine = np.asarray(table["coefficient"]) == name
    return np.asarray(table[column][mine], float)


def _celsius(kelvin: float) -> str:
    return f"{kelvin - ZERO_CELSIUS:.1f}".replace("-", "−")
