"""How sure the coefficients are: values, bound, budget, correlation, and what was not seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector
from foucault.models.two_imus import ORDINALS
from foucault.report import chart, page
from foucault.report.evidence import NOTHING_ADDED
from foucault.result import Result, TableData
from foucault.units import ZERO_CELSIUS

TRIADS = {
    "accel": "Accelerometers",
    "gyro": "Gyros",
    "mag": "Magnetometer",
    "attitude": "Attitude",
    "installation": "Installation",
    "master": "Messages of the master",
    "load": "Installation under load",
    "pose": "Tracked body",
    **{who: f"{who.capitalize()} IMU" for who in ORDINALS},
}
COVERAGE = 2.0  # coverage factor of the expanded uncertainty: about 95 % (JCGM 100:2008, 6.2)
CLOCK = "clock of the log"

SMALL_SHARE = 0.05
"""A source whose largest share is smaller has a row but no column of its own [percent]."""

MANY = 36  # More coefficients than this need a larger matrix and smaller names [1].


def coefficients(result: Result) -> page.Section | None:
    """Every coefficient with its uncertainty, beside the prior and the bound."""
    vector = result.coefficients
    if not len(vector):
        return None
    prior = bool(np.isfinite(vector.prior_sd).any())
    bound = _bound(result)
    seconds = result.in_seconds.sd if result.clock is not None else None
    if seconds is not None and np.array_equal(seconds, vector.sd, equal_nan=True):
        seconds = None  # nothing hangs on the clock
    heads = page.columns(
        "coefficient: name | symbol: symbol aside | value: number | ± sd: number",
        "± U (k=2): number optional",
        "± sd in seconds: number" * (seconds is not None),
        "unit: short",
        "prior sd: number" * prior,
        "sd / bound: number" * (bound is not None),
        "meaning: meaning",
    )
    rows: list[list[str]] = []
    for head in dict.fromkeys(name.partition(".")[0] for name in vector.names):
        part = vector[head]
        own = [vector.names.index(name) for name in part.names]  # a triad may be in two places
        limit, timed = (None if x is None else x[own] for x in (bound, seconds))
        rows += [[TRIADS.get(head, head)], *_coefficient_rows(part, prior, limit, timed)]
    key = "uncertainty.coefficients"
    at = ""
    if result.temperature is not None:
        at = page.minus(f"{result.temperature.reference - ZERO_CELSIUS:.1f}")
    lead = page.said(
        f"{key}.at" if at else "",
        f"{key}.lead",
        f"{key}.seconds" * (seconds is not None),
        f"{key}.bound" * (bound is not None),
        f"{key}.prior" * (bound is not None and prior),
        at=at,
        frame=result.frame,
        gauge=result.gauge,
    )
    return page.section(key, page.Table(heads, rows, page.said(f"{key}.option")), lead=lead)


def _bound(result: Result) -> FloatArray | None:
    """The Cramer-Rao bound, where there is one for every coefficient."""
    values = result.diagnostics.get("bound")
    if values is None or len(values) != len(result.coefficients):
        return None
    return np.array(values, float)


def _coefficient_rows(
    vector: CoefficientVector, prior: bool, bound: FloatArray | None, seconds: FloatArray | None
) -> list[list[str]]:
    """Return the cells of each coefficient, in the order of the columns."""
    out = []
    for i, row in enumerate(vector.rows()):
        value, sd, free = row["display_value"], row["display_sd"], row["free"]
        one = units.factor(row["display_unit"], row["kind"])
        cells = [row["name"], row["symbol"]]
        cells.append(page.known_to(value, sd) if np.isfinite(value) else "unknown")
        cells += [
            page.size(sd) if free else "held",
            page.size(COVERAGE * sd) if free and sd else "",
        ]
        if seconds is not None:
            cells.append(page.size(float(seconds[i]) / one) if free else "")
        cells.append(page.shown(row["display_unit"]))
        if prior:
            cells.append(page.size((row["prior_sd"] or 0.0) / one))
        if bound is not None:
            seen = free and row["sd"] is not None and bound[i] > 0
            cells.append(f"{row['sd'] / bound[i]:.2f}" if seen else "")
        out.append([*cells, row["meaning"]])
    return out


def unseen(result: Result) -> page.Section | None:
    """What the data could not tell, and what no data of this procedure can tell."""
    facts, vector = result.diagnostics, result.coefficients
    items = [("warning", f"Seen badly: {words}.") for words in facts.get("weakest") or []]
    gaps = (facts.get("coverage") or {}).get("missing") or []
    items += [("warning", f"No rest near: {gap.get('words', '')}.") for gap in gaps]
    prior, free = vector.prior_sd, vector.free
    weak = free & np.isfinite(prior) & (vector.sd > NOTHING_ADDED * prior)
    if weak.any():
        names = ", ".join(f"`{n}`" for n, w in zip(vector.names, weak, strict=True) if w)
        items.append(("warning", f"Known hardly better than beforehand: {names}."))
    held = ", ".join(f"`{n}`" for n, f in zip(vector.names, free, strict=True) if not f)
    if held:
        items.append(("plain", f"Held at their values, not estimated: {held}."))
    items += [("plain", str(words)) for words in facts.get("unseen") or []]
    return page.section("uncertainty.unseen", page.Items(items))


def budget(result: Result) -> page.Section | None:
    """The variance of every coefficient split by source, as the GUM asks."""
    vector = result.coefficients
    given: Mapping[str, Any] = result.diagnostics.get("budget") or {}
    parts = {
        source: np.array(variance, float)
        for source, variance in given.items()
        if len(variance) == len(vector)
    }
    if not parts:
        return None
    if result.clock is not None and (error := result.clock.of(vector.names)).any():
        parts[CLOCK] = error**2
    total = np.sum(list(parts.values()), axis=0)
    share = {s: 100 * v / np.where(total > 0, total, np.nan) for s, v in parts.items()}
    share = {s: v for s, v in share.items() if np.isfinite(v).any()}
    order = sorted(share, key=lambda s: -float(np.nanmean(share[s])))
    if not order:
        return None
    large = [s for s in order if float(np.nanmax(share[s])) >= SMALL_SHARE] or order
    labels = _labels(vector, range(len(vector)))
    alt = "Share of every source in the variance of every coefficient"
    key = "uncertainty.budget"
    return page.section(
        key,
        chart.shares(labels, {s: share[s] for s in large}, alt),
        _sources(result, {s: share[s] for s in order}),
        _contributions(vector, {s: parts[s] for s in large}, total),
        lead=page.said(f"{key}.lead", f"{key}.clock" * (CLOCK in parts)),
    )


NEVER = 1e3  # A term that would have to be so many times its size is never seen [1].


def not_estimated(result: Result) -> page.Section | None:
    """What is left out: what it costs, whether this log would see it, where its size is from."""
    return page.section("uncertainty.not_estimated", left_out_table(result.tables["left_out"]))


def left_out_table(some: TableData) -> page.Table:
    """Return a row for each group of terms that are not estimated, the costliest first."""
    order = np.argsort(-np.asarray(some["share"], float), kind="stable")
    words, numbers = ["what", "size", "basis"], ("share", "seen", "needed")
    words += ["shown_by"] if "shown_by" in some else []
    what, sizes, basis, *by = ([str(some[k][i]) for i in order] for k in words)
    share, seen, needed = ([float(some[k][i]) for i in order] for k in numbers)
    return page.table(
        ("left out", what),
        ("size (1 sd): number", sizes),
        ("largest share of a variance: number", [_percent(100 * v) for v in share]),
        ("seen: number", [_percent(100 * v) for v in seen]),
        ("named from: number", [f"{v:.3g} sizes" if v < NEVER else "never" for v in needed]),
        ("shown by", by[0] if by else None),
        ("size from: aside", basis),
    )


def _labels(vector: CoefficientVector, some: Iterable[int]) -> list[str]:
    """Return a symbol for each of some coefficients, its name where others have that symbol too."""
    every = [vector.layout.coefficients[i] for i in some]
    count = Counter(c.symbol for c in every)
    return [chart.lowered(c.symbol) if count[c.symbol] == 1 else c.name for c in every]


def _sources(result: Result, share: Mapping[str, FloatArray]) -> page.Table:
    """One row per source: type, basis, and its share of the variance."""
    names = result.coefficients.names
    kinds = [basis(result, source) for source in share]
    worst = [int(np.nanargmax(v)) for v in share.values()]
    most = [float(v[k]) for v, k in zip(share.values(), worst, strict=True)]
    return page.table(
        ("source", share),
        ("type: short", [kind for kind, _ in kinds]),
        ("evaluated from: aside", [said for _, said in kinds]),
        ("mean share: number", [_percent(float(np.nanmean(v))) for v in share.values()]),
        ("largest share: number", [_percent(v) for v in most]),
        ("in", [f"`{names[k]}`" for k in worst]),
    )


def basis(result: Result, source: str) -> tuple[str, str]:
    """Return whether a source is of type A or B, and what it rests on."""
    stated = (result.diagnostics.get("sources") or {}).get(source)
    if stated:
        return stated[0], stated[1]
    noise = str((result.diagnostics.get("noise") or {}).get("source", ""))
    if source.endswith(" noise"):
        source = "noise, measured" if noise.startswith("measured") else "noise, declared"
        source = "noise, of the residuals" if noise.endswith("the residuals") else source
        source = "noise, unknown" if noise.startswith("unknown") else source
    kind, _, said = page.told(f"basis.{source}").partition("; ")
    return kind.rstrip(";"), said


def _percent(value: float) -> str:
    return f"{value:.1f} %" if value >= 0.05 else "< 0.1 %"


def _contributions(
    vector: CoefficientVector, parts: Mapping[str, FloatArray], total: FloatArray
) -> page.Table:
    """Standard uncertainty that each source alone contributes to each coefficient."""
    heads = ["u of: name", *(f"{source}: number" for source in parts), "combined: number"]
    rows = []
    for i, row in enumerate(vector.rows()):
        one = units.factor(row["display_unit"], row["kind"])
        combined = float(np.sqrt(total[i])) / one
        digits = 1 - int(np.floor(np.log10(combined))) if combined > 0 else 0
        cells = [*(float(np.sqrt(max(v[i], 0.0))) / one for v in parts.values()), combined]
        texts = [f"{u:.{max(0, min(digits, 9))}f}" for u in cells]
        kept = [text if float(text) else "–" for text in texts]
        rows.append([row["name"], *kept, page.shown(row["display_unit"])])
    return page.Table(page.columns(*heads, "unit: short"), rows)


def correlation(result: Result) -> page.Section | None:
    """Which coefficients the data could not tell apart well."""
    vector = result.coefficients
    keep = np.flatnonzero(np.isfinite(vector.sd) & (vector.sd > 0))
    if vector.cov is None or keep.size < 2:
        return None
    sd = vector.sd[keep]
    matrix = np.round(vector.cov[np.ix_(keep, keep)] / np.outer(sd, sd), 3)
    labels = _labels(vector, keep)
    many = len(labels) > MANY
    ticks = {
        "type": "category",
        "tickfont": {"size": 10 if many else 12.5},
        "ticks": "",
        "showgrid": False,
        "tickmode": "linear",
    }
    data = chart.heat(
        labels, labels, matrix, "%{y}, %{x}: %{z:.2f}|", 1, tickvals=[-1, -0.5, 0, 0.5, 1]
    )
    # About square on a narrow screen, where the columns have no room for their names.
    narrow = {
        "xaxis": {"showticklabels": False},
        "yaxis": {"tickfont": {"size": 10}, "showticklabels": not many},
    }
    figure = chart.draw(
        "uncertainty.correlation",
        [data],
        height=760 if many else 520,
        x=ticks | {"tickangle": -90},
        y=ticks | {"autorange": "reversed"},
        meta={"ratio": 1.05, "narrow": narrow},
    )
    return page.section("uncertainty.correlation", figure)


# ------------------------------------------------------------------------------------------------
# What a fit over temperature showed: functions with the sessions, terms, and what was left out.

LIMIT = 3.0  # Lines of the figures of residuals [sd].


def functions(result: Result) -> page.Section | None:
    """Every family over temperature: the functions, their band, and what the sessions found."""
    curves, model = result.tables["temperature_curves"], result.temperature
    if model is None:
        return None
    families = {row["family"]: row for row in result.diagnostics.get("families") or []}
    key = "temperature.functions"
    low, high, at = (_celsius(v) for v in (model.low, model.high, model.reference))
    knots = ", ".join(_celsius(k) for k in model.knots)
    words = page.said(f"{key}.knots" if knots else f"{key}.powers", knots=knots, at=at)
    return page.section(
        key,
        _figure(result, curves, list(families)),
        _families(families.values()),
        words,
        low=low,
        high=high,
        at=at,
    )


def _figure(result: Result, curves: Mapping[str, Any], families: Sequence[str]) -> page.Figure:
    data: list[chart.Trace] = []
    points = result.tables["temperature_points"]
    ramps = result.tables.get("temperature_ramps") or {}
    # Families that change come first: the list opens with what matters.
    varying = result.temperature.varying() if result.temperature else ()
    changing = {n.rpartition(".")[0] for n in varying}
    every = result.coefficients.layout.coefficients
    choices = []
    for family in sorted(families, key=lambda f: f not in changing):
        members = [c for c in every if (c.name.rpartition(".")[0] or c.name) == family]
        sizes = [np.ptp(_of(curves, c.name, "value")) for c in members]
        sds = [_of(curves, c.name, "sd").max() for c in members]
        unit, scale = page.unit_of(members[0].kind, sizes, sds)
        choices.append(f"{family} [{unit}]")
        for k, c in enumerate(members):
            start = result.coefficients.value(c.name)
            data += _traces(
                c, curves, points, ramps, start, scale, chart.SERIES[k % 6], choices[-1]
            )
    return chart.draw(
        "temperature.figure", data, meta={"choices": choices, "choose": "coefficients"}
    )


def _traces(
    c: Coefficient,
    curves: Mapping[str, Any],
    points: Mapping[str, Any],
    ramps: Mapping[str, Any],
    start: float,
    scale: float,
    colour: str,
    label: str,
) -> list[chart.Trace]:
    """Return band, curve and points of one coefficient."""

    def of(some: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
        y = (_of(some, c.name, "value") - start) / scale
        return _of(some, c.name, "temperature") - ZERO_CELSIUS, y

    x, y = of(curves)
    two_sd = 2 * _of(curves, c.name, "sd") / scale
    of_group: chart.Trace = {"meta": label, "legendgroup": c.name}
    hover = f"%{{x:.1f}} °C: %{{y:.4g}}|{c.name}"
    out = [
        chart.band("", x, y - two_sd, y + two_sd, **of_group),
        chart.line(chart.lowered(c.symbol), x, y, colour, hover, **of_group),
    ]
    if ramps and (np.asarray(ramps["coefficient"]) == c.name).any():
        out.append(
            chart.dots(
                "", *of(ramps), colour, f"{hover}, ramp", size=4, symbol="circle-open", **of_group
            )
        )
    seen = np.asarray(points["coefficient"]) == c.name
    if seen.any():
        bars = chart.whiskers(2 * _of(points, c.name, "sd") / scale, colour, thickness=1.3)
        session = np.asarray(points["session"])[seen].tolist()
        out.append(
            chart.dots(
                "",
                *of(points),
                colour,
                f"%{{customdata}}, {hover}",
                error_y=bars,
                customdata=session,
                **of_group,
            )
        )
    return out


def _families(rows: Any) -> page.Table:
    return page.table(
        ("coefficients: name", [row["family"] for row in rows]),
        ("function", [row["function"] for row in rows]),
        ("temperatures: number aside", [str(row["temperatures"]) for row in rows]),
        ("scatter between sessions: number", [_scatter(row) for row in rows]),
        ("why this function: aside", [_why(row) for row in rows]),
    )


def _scatter(row: Mapping[str, Any]) -> str:
    from foucault.models.layouts import EVERY

    sd = row["scatter"]
    if sd is None or not np.isfinite(sd):
        return "cannot be told"
    kind = EVERY.coefficients[int(EVERY.group(row["family"])[0])].kind
    size = page.quantity(sd, kind, 2) if sd else "none seen"
    return size if row["scatter_found"] else f"{size if sd else 'none'} (declared)"


def _why(row: Mapping[str, Any]) -> str:
    """Say the F-tests in a sentence."""
    words = []
    for key, text in (("needed", "better than a {has}"), ("missing", "a {against} adds nothing")):
        test = row.get(key)
        if test is not None:
            lost = key == "missing" and test["p"] < 0.01
            text = "a {against} may fit better" if lost else text
            p = "< 1e−6" if test["p"] < 1e-6 else page.minus(f"{test['p']:.2g}")
            words.append(f"{text.format(**test)} (F {test['F']:.3g}, p {p})")
    return "; ".join(words)


def left_out(result: Result) -> page.Section | None:
    """Residuals, and every temperature as predicted by the others."""
    points, key = result.tables["temperature_points"], "temperature.left_out"
    figures = []
    if len(result.diagnostics.get("sessions") or []) > 1:  # one is met exactly
        figures.append(
            _scattered(points, "residual", "residual / sd", page.told(f"{key}.residual"))
        )
    if np.isfinite(np.asarray(points["left_out"], float)).any():
        what = "left out: error / sd"
        figures.append(_scattered(points, "left_out", what, page.told(f"{key}.left_out")))
    return page.section(key, figures, _sessions(result))


def _scattered(points: Mapping[str, Any], column: str, what: str, caption: str) -> page.Figure:
    y = np.asarray(points[column], float)
    x = np.asarray(points["temperature"], float) - ZERO_CELSIUS
    triads = np.array([str(n).partition(".")[0] for n in points["coefficient"]])
    said_ = zip(points["coefficient"], points["session"], strict=True)
    labels = np.array([f"{coefficient}, {session}" for coefficient, session in said_])
    data = []
    for k, triad in enumerate(dict.fromkeys(triads.tolist())):
        pick = (triads == triad) & np.isfinite(y)
        hover = "%{text}, %{x:.1f} °C: %{y:.2f} sd|"
        data.append(
            chart.dots(
                TRIADS.get(triad, triad),
                x[pick],
                y[pick],
                chart.SERIES[k % 6],
                hover,
                size=6,
                text=labels[pick].tolist(),
                marker={"opacity": 0.8},
            )
        )
    top = 1.12 * max(LIMIT, float(np.nanmax(np.abs(y), initial=0.0)))
    return chart.draw(
        "temperature.scattered",
        data,
        y=chart.axis(what, range=[-top, top]),
        caption=caption,
        lines=[0, LIMIT, -LIMIT],
        alt=f"{what} of every coefficient of every session against its temperature",
    )


def _sessions(result: Result) -> page.Table:
    rows = list(result.diagnostics.get("sessions") or [])
    ramps = result.diagnostics.get("ramps") or []
    rows += [{"name": r["name"], "range": r["range"], "procedure": "ramp"} for r in ramps]
    means = [_celsius(r["temperature"]) if r.get("temperature") else "" for r in rows]
    return page.table(
        ("session", [r["name"] for r in rows]),
        ("mean [°C]: number", means),
        ("range [°C]: number aside", [" to ".join(map(_celsius, r["range"])) for r in rows]),
        ("procedure: aside", [r["procedure"] for r in rows]),
        ("verdict", [r.get("verdict", "") for r in rows]),
        ("made: aside", [page.date(str(r["created"])) if r.get("created") else "" for r in rows]),
    )


def _of(some: Mapping[str, Any], name: str, column: str) -> FloatArray:
    mine = np.asarray(some["coefficient"]) == name
    return np.asarray(some[column][mine], float)


def _celsius(kelvin: float) -> str:
    return page.minus(f"{kelvin - ZERO_CELSIUS:.1f}")
