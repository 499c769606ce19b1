"""What a result rests on: norms, residuals, orientations, rates, headings, the table itself.

Readings of a session on a table stand side by side by kind, rests and spins, each numbered from 1.
One that was left out is a cross with its number; where it lies beyond the scale of the others it
stands at the edge.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import format_value
from foucault.report import chart, orientation, page
from foucault.result import Result

RESIDUAL_LIMIT = 3.0  # guide line; one normal residual in 370 lies outside
NOTHING_ADDED = 0.9  # of the prior sd: the data hardly added to what was known

UNTESTED = 1e-3  # A standardized residual below this is that of a reading which nothing tests [1].
USED = 0.5  # Robust weight below which a reading was left out [1].
GAP = 0.05  # Space between two groups, as a part of the width [1].

OBSERVED = {
    "accel": "Specific force at rest",
    "gyro": "Angular rate at rest",
    "turns": "Turns",
    "accel at rest": "Specific force at rest",
    "accel in spins": "Specific force in spins",
    "gyro at rest": "Angular rate at rest",
    "gyro in spins": "Angular rate in spins, across the axis",
    "rate of spins": "Angular rate in spins, along the axis",
}
TRIADS = {"accel": ("Accelerometers", "specific force"), "gyro": ("Gyros", "angular rate")}


def _gravity(result: Result) -> float | None:
    return result.diagnostics.get("gravity", result.site.get("gravity"))


# -- rests and turns by hand -----------------------------------------------------------------


def norms(result: Result) -> page.Section | None:
    """Specific force of every rest against local gravity, before and after."""
    rests, gravity = result.tables["rests"], _gravity(result)
    if gravity is None:
        return None
    where = [f"{v:.0f} s" for v in rests["start"]]
    whole = [Kind("rest", np.arange(len(where)), where)]
    none = np.zeros(len(where), bool)
    before, after = rests["norm_before"] - gravity, rests["norm_after"] - gravity
    figure = _before_after(whole, "specific force", before, after, rests["norm_sd"], none)
    return page.section("evidence.norms", figure)


def residuals(result: Result) -> page.Section | None:
    """Standardized residuals against time and against orientation."""
    limits = result.diagnostics.get("residual_limit") or {}
    blocks: list[Any] = []
    for name, what, triad in (("rests", "rest", "accel"), ("turns", "turn", "gyro")):
        some = result.tables.get(name)
        if some is not None and "residual" in some:
            limit = float(limits.get(triad, RESIDUAL_LIMIT))
            middle = (some["start"] + some["end"]) / 2
            blocks.append(chart.residuals(middle, some["residual"], some["weight"], what, limit))
    if not blocks:
        return None
    rests, turns, gravity = result.tables.get("rests"), result.tables.get("turns"), _gravity(result)
    if rests is not None and "up_x" in rests and gravity is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            off = (rests["norm_after"] - gravity) / rests["norm_sd"]
        blocks.append(_against_up(rests, off))
    if turns is not None and "angle" in turns:
        span, lines = chart.within(turns["residual"], RESIDUAL_LIMIT)
        angle, left = np.rad2deg(turns["angle"]), turns["residual"]
        data = chart.weighed(angle, left, turns["weight"], "turn", "%{x:.0f}°")
        look = chart.axis("turn: residual / sd", range=span)
        blocks.append(chart.draw("evidence.residuals", data, y=look, lines=lines))
    chi = result.diagnostics.get("chi_square", {})
    found = [page.chi_square(OBSERVED[k], chi[k]) for k in ("accel", "gyro", "turns") if chi.get(k)]
    dashed = "limit" if limits else f"{RESIDUAL_LIMIT:.0f} sd"
    return page.section("evidence.residuals", blocks, page.Items(found), limit=dashed)


def _against_up(rests: Any, y: FloatArray) -> page.Figure:
    """Draw the error of the norm over its sd against each component of up."""
    data: list[chart.Trace] = []
    axes: dict[str, Any] = {}
    span, lines = chart.within(y, RESIDUAL_LIMIT)
    for k, name in enumerate("xyz"):
        where = f"up · {name} = %{{x:.2f}}"
        traces = chart.weighed(rests[f"up_{name}"].astype(float), y, rests["weight"], "rest", where)
        data += [t | {"xaxis": chart.ref("x", k), "showlegend": k == 0} for t in traces]
        axes[chart.ref("xaxis", k)] = chart.axis(
            f"up · {name}",
            domain=[k * 0.345, k * 0.345 + 0.31],
            range=[-1.12, 1.12],
            tickvals=[-1, 0, 1],
            tickangle=0,
        )
    light = bool((np.asarray(rests["weight"]) <= chart.FULL).any())
    return chart.draw(
        "evidence.against_up",
        data,
        y=chart.axis("norm error / sd", range=span),
        lines=lines,
        legend=light,
        **axes,
    )


def detection(result: Result) -> page.Section | None:
    """Where the log was at rest."""
    facts = result.diagnostics.get("detection", {})
    rests = result.tables.get("rests", {})
    ends = zip(rests.get("start", ()), rests.get("end", ()), strict=True)
    spans = [(float(a), float(b)) for a, b in ends if np.isfinite(a + b)]
    known = {k: facts[k] for k in ("threshold", "rests", "rest_time") if facts.get(k) is not None}
    keys = ["evidence.detection.lead", *["evidence.detection.threshold"] * ("threshold" in known)]
    keys += ["evidence.detection.rests"] * (known.keys() >= {"rests", "rest_time"})
    figure = chart.detection(result.tables["detection"], facts.get("threshold"), spans)
    return page.section("evidence.detection", figure, lead=page.said(*keys, **known))


def held_out(result: Result) -> page.Section | None:
    """How well rests are predicted that were not used."""
    rests = result.tables["rests"]
    known = np.isfinite(rests.get("held_out", np.array([np.nan])))
    if not known.any():
        return None
    error, sd = rests["held_out"][known], rests["held_out_sd"][known]
    unit, one = page.unit_of("specific force", error, sd)
    n = np.flatnonzero(known) + 1
    data = chart.dots(
        "",
        n,
        error / one,
        chart.FIRST,
        f"rest %{{x}}: %{{y:.4g}} {unit}|",
        error_y=chart.whiskers(2 * sd / one, chart.FIRST, 4, 1.4),
    )
    look = chart.count_axis("rest", int(n.max()), 12)
    figure = chart.draw("evidence.held_out", [data], x=look, y=f"predicted error [{unit}]")
    return page.section("evidence.held_out", figure)


# -- orientations ----------------------------------------------------------------------------


def orientations(result: Result) -> page.Section | None:
    """Where up pointed at the rests and the outer axis in the spins, and what is missing."""
    readings = result.tables.get("readings")
    some = result.tables.get("rests") if readings is None else readings
    if some is None or _column(some, "up_x") is None:
        return None
    up = np.column_stack([some[f"up_{a}"] for a in "xyz"]).astype(float)
    coverage = result.diagnostics.get("coverage") or {}
    gaps = coverage.get("missing") or []
    missing = np.array([g["direction"] for g in gaps], float).reshape(-1, 3)
    words = [str(g.get("words", "missing")) for g in gaps]
    name, names, also, seen = "rest", ("visited", ""), None, np.arange(len(up))
    keys = ["evidence.orientations.lead"]
    if readings is not None:
        parts = {k.what: k.rows for k in kinds(readings)}
        rests = parts.pop("rest", np.empty(0, np.int64))
        word, spins = next(iter(parts.items()), ("spin", np.empty(0, np.int64)))
        seen, name = (rests, "rest") if len(rests) else (spins, word)
        names = (name, word)
        if len(rests) and len(spins):
            also, keys = up[spins], [*keys, "evidence.orientations.rings"]
    if coverage.get("largest_gap") is not None:
        keys.append("evidence.orientations.gap")
    lead = page.said(
        *keys,
        name=name,
        also=names[1],
        axis="outer axis" if names[1] == "spin" else "axis",
        gap=np.degrees(coverage.get("largest_gap") or 0.0),
    )
    drawn = orientation.directions(up[seen], missing, words, also, names)
    items = page.Items([("warning", f"Missing: {w}.") for w in words])
    return page.section("evidence.orientations", drawn, items, lead=lead)


# -- readings on a table ---------------------------------------------------------------------


@dataclass(frozen=True)
class Kind:
    """The rests, or the spins, of a session, and how to speak of them."""

    what: str  # "rest", "spin" or "turn"
    rows: IntArray  # in the table
    where: Sequence[str]  # what the table said in each, for the pointer


def kinds(some: Any) -> list[Kind]:
    """Part the readings into rests and spins; without table angles a spin is called a turn."""
    spin = np.asarray(some["rate"], float) != 0.0
    word = "spin" if "middle" in some else "turn"
    parts = [(what, np.flatnonzero(pick)) for what, pick in (("rest", ~spin), (word, spin))]
    return [
        Kind(what, rows, [_where(some, j) for j in rows.tolist()])
        for what, rows in parts
        if rows.size
    ]


def _where(some: Any, j: int) -> str:
    """Time, table angles and rate of one reading."""
    words = [f"{max(float(some['start'][j]), 0.0):.0f} s"]
    angles = {name: float(some[name][j]) for name in ("middle", "inner") if name in some}
    words += [f"{name} {np.degrees(a):.1f}°" for name, a in angles.items() if np.isfinite(a)]
    if some["rate"][j]:
        words.append(f"{np.degrees(float(some['rate'][j])):.3g} °/s")
    return page.minus(", ".join(words))


def _column(some: Any, name: str) -> FloatArray | None:
    """Return a column, None where it is missing or empty."""
    if name not in some:
        return None
    values = np.asarray(some[name], float)
    return values if np.isfinite(values).any() else None


def _left_out(some: Any, triad: str) -> BoolArray:
    """Which readings of a triad were not used."""
    weight = _column(some, f"{triad}_weight")
    weight = _column(some, "weight") if weight is None else weight
    return np.zeros(len(some["rate"]), bool) if weight is None else weight < USED


def norms_of_readings(result: Result) -> page.Section | None:
    """Error of the norm of every reading, before and after."""
    some, gravity = result.tables["readings"], _gravity(result)
    force = None if gravity is None else _norms(some, "norm", gravity, "accel")
    true = _column(some, "rate_true")
    rate = None if true is None else _norms(some, "rate", true, "gyro")
    if force is None and rate is None:
        return None
    spins = any(kind.what == "spin" for kind in kinds(some))
    determined = rate is not None and _residual_figure(some, "gyro") is None
    key = "evidence.norms_of_readings"
    leads = [f"{key}.lead"]
    if force is not None:
        leads.append(f"{key}.force_spins" if spins and rate is not None else f"{key}.force")
    if rate is not None:
        leads.append(f"{key}.rate_spins" if spins else f"{key}.rate")
    blocks: list[Any] = [page.said(f"{key}.of_accel"), force] if force is not None else []
    if rate is not None:
        blocks += [page.said(f"{key}.of_gyro", f"{key}.just_enough" * determined), rate]
    return page.section(key, blocks, lead=page.said(*leads, f"{key}.shaded"))


def _norms(some: Any, column: str, true: float | FloatArray, triad: str) -> page.Figure | None:
    """Draw |f| - g, or |w| minus the true rate, of all groups that have it."""
    before, after = _column(some, f"{column}_before"), _column(some, f"{column}_after")
    if before is None or after is None:
        return None
    sd = _column(some, f"{column}_sd")
    sd = np.full(len(after), np.nan) if sd is None else sd
    parts = [k for k in kinds(some) if np.isfinite(after[k.rows]).any()]
    left = _left_out(some, triad)
    return _before_after(parts, TRIADS[triad][1], before - true, after - true, sd, left)


def _before_after(
    parts: Sequence[Kind],
    quantity: str,
    before: FloatArray,
    after: FloatArray,
    sd: FloatArray,
    left: BoolArray,
) -> page.Figure:
    """Draw errors of the norm [SI]: before above, after below with the +-2 sd it may have."""
    unit_before, one_before = page.unit_of(quantity, before)
    unit_after, one_after = page.unit_of(quantity, after[~left], sd[~left])
    before, after, sd = before / one_before, after / one_after, sd / one_after
    # Half the range that shows what was used, and its band; left out readings may lie beyond.
    every = np.concatenate([np.abs(after[~left]), 2 * sd[~left]])
    every = every if every.size else np.abs(after)
    span = 1.2 * float(np.max(every[np.isfinite(every)], initial=0.0)) or 1.0
    data: list[chart.Trace] = []
    for k, part in enumerate(parts):
        rows = part.rows
        kept = np.flatnonzero(~left[rows])
        hover = f"{part.what} %{{x}}, %{{text}}: %{{customdata:.4g}} "
        on: chart.Trace = {"xaxis": chart.ref("x", k), "showlegend": k == 0}
        where = [part.where[j] for j in kept.tolist()]
        for name, y, unit, ref, colour, symbol in (
            ("before", before, unit_before, "y2", chart.SECOND, "diamond"),
            ("after", after, unit_after, "y", chart.FIRST, "circle"),
        ):
            value = y[rows[kept]]
            data.append(
                chart.dots(
                    name,
                    kept + 1,
                    value,
                    colour,
                    f"{hover}{unit}|{name}",
                    symbol=symbol,
                    text=where,
                    customdata=chart.numbers(value),
                    yaxis=ref,
                    **on,
                )
            )
            if name == "before":
                data.append(_steps(2 * np.where(left[rows], np.nan, sd[rows])) | on)
    first = True
    for k, part in enumerate(parts):
        out = np.flatnonzero(left[part.rows])
        if not out.size:
            continue
        far = np.abs(after[part.rows[out]]) > span
        edge = np.where(far, np.sign(after[part.rows[out]]) * 0.84 * span, after[part.rows[out]])
        arrows = np.where(edge > 0, "triangle-up", "triangle-down")
        n = len(part.rows)
        for name, y, true, unit, ref, beyond in (
            ("before", before[part.rows[out]], before, unit_before, "y2", far & False),
            ("after", edge, after, unit_after, "y", far),
        ):
            true = true[part.rows[out]]
            words = [
                f"{part.what} {j + 1}" + (f": {_told(v)} {unit}" if b else "")
                for j, v, b in zip(out, true, beyond, strict=True)
            ]
            side = [f"middle {'right' if 2 * j < n else 'left'}" for j in out]
            data.append(
                chart.dots(
                    "left out",
                    out + 1,
                    y,
                    chart.BAD,
                    f"%{{text}}: %{{customdata:.4g}} {unit}|{name}, left out",
                    size=9,
                    symbol=np.where(beyond, arrows, "x").tolist(),
                    text=words,
                    mode="markers+text",
                    textposition=side,
                    textfont={"color": chart.BAD},
                    cliponaxis=False,
                    customdata=chart.numbers(true),
                    yaxis=ref,
                    xaxis=chart.ref("x", k),
                    showlegend=first and ref == "y2",
                )
            )
        first = False
    groups = " and ".join(part.what for part in parts)
    look = chart.axis(f"after [{unit_after}]", domain=[0, 0.46], range=[-span, span])
    return chart.draw(
        "evidence.before_after",
        data,
        y=look | {"exponentformat": "none"},
        yaxis2=chart.axis(f"before [{unit_before}]", domain=[0.56, 1]),
        shapes=[chart.level(0), chart.level(0, "y2")],
        **_count_axes(parts),
        alt=f"Error of the norm of {quantity} per {groups}, before and after calibration",
    )


def _steps(reach: FloatArray) -> chart.Trace:
    """A band of +-`reach` around zero as steps, one per reading."""
    x, y = [], []
    for j in np.flatnonzero(np.isfinite(reach)):
        left, right, top = j + 0.5, j + 1.5, float(f"{reach[j]:.6g}")
        x += [left, right, right, left, left, None]
        y += [top, top, -top, -top, top, None]
    return chart.area("±2 sd", [None if v is None else float(v) for v in x], y)


def _count_axes(parts: Sequence[Kind], ticks: float = 14) -> dict[str, Any]:
    """One axis per group, as wide as it has readings."""
    share = [len(p.rows) / sum(len(q.rows) for q in parts) for p in parts]
    out: dict[str, Any] = {}
    narrow: dict[str, Any] = {}
    for k, (part, domain) in enumerate(zip(parts, chart.parts(share, GAP), strict=True)):
        n, key = len(part.rows), chart.ref("xaxis", k)
        look = chart.count_axis(part.what, n, max(2, round(ticks * share[k])))
        out[key] = look | {"domain": domain, "tickangle": 0, "showgrid": False}
        narrow[key] = {"dtick": max(1, round(n / max(2.0, 6 * share[k])))}
    return out | {"meta": {"narrow": narrow}}


def residuals_of_readings(result: Result) -> page.Section | None:
    """Standardized residual of every reading, and how each kind fits as a whole."""
    some = result.tables["readings"]
    if _column(some, "residual") is None:
        return None
    blocks: list[Any] = []
    for triad, (name, quantity) in TRIADS.items():
        if figure := _residual_figure(some, triad):
            blocks += [f"{name}: {quantity}.", figure]
    if not blocks:
        return None
    chi = result.diagnostics.get("chi_square") or {}
    found = [page.chi_square(OBSERVED.get(k, k), row) for k, row in chi.items() if row]
    limit = f"{RESIDUAL_LIMIT:.0f} sd"
    return page.section("evidence.residuals_of_readings", blocks, page.Items(found), limit=limit)


def _residual_figure(some: Any, triad: str) -> page.Figure | None:
    """Draw the residuals of one triad, where anything tests them."""
    own = _column(some, f"{triad}_residual")
    if own is None:
        # One residual for both triads: rests speak for accelerometers, turns for gyros.
        spin = np.asarray(some["rate"], float) != 0.0
        own = np.where(spin == (triad == "gyro"), np.asarray(some["residual"], float), np.nan)
    tested = np.where(np.abs(own) < UNTESTED, np.nan, own)
    parts = [k for k in kinds(some) if np.isfinite(tested[k.rows]).any()]
    if not parts:
        return None
    alt = f"Standardized residual of the {TRIADS[triad][1]} of every reading"
    left = _left_out(some, triad)
    return _bars(
        parts, tested, left, "residual / sd", "sd", ("used", "left out"), alt, RESIDUAL_LIMIT
    )


def _bars(
    parts: Sequence[Kind],
    y: FloatArray,
    marked: BoolArray,
    title: str,
    unit: str,
    names: tuple[str, str],
    alt: str,
    limit: float | None = None,
) -> page.Figure:
    """Draw one bar per reading; marked ones stand out, and beyond the scale end at its edge."""
    rows = np.concatenate([p.rows for p in parts])
    known = np.zeros(len(y), bool)
    known[rows] = ~np.isnan(y[rows])
    kept = np.abs(y[known & ~marked])
    kept, odd = kept[np.isfinite(kept)], np.abs(y[known & marked])
    top = max(
        float(np.max(kept if kept.size else odd[np.isfinite(odd)], initial=0.0)), limit or 0.0
    )
    top = top or 1.0
    if odd.size:
        top = min(1.6 * top, max(top, float(odd.max())))
    low = -top if (y[known] < 0).any() else 0.0
    data: list[chart.Trace] = []
    for odd_ones, colour, name in ((False, chart.FIRST, names[0]), (True, chart.BAD, names[1])):
        first = True
        for k, part in enumerate(parts):
            at = np.flatnonzero((marked[part.rows] == odd_ones) & known[part.rows])
            if not at.size:
                continue
            values = y[part.rows[at]]
            drawn = np.clip(values, low, top)
            data.append(
                chart.bars(
                    name,
                    at + 1,
                    drawn,
                    colour,
                    f"{part.what} %{{x}}, %{{hovertext}}|{name}",
                    hovertext=[
                        f"{part.where[j]}: {_told(v)} {unit}"
                        for j, v in zip(at.tolist(), values, strict=True)
                    ],
                    text=[_told(v) if v != d else "" for v, d in zip(values, drawn, strict=True)],
                    textposition="outside",
                    textangle=0,
                    cliponaxis=False,
                    constraintext="none",
                    textfont={"color": colour, "size": 12},
                    legendgroup=name,
                    showlegend=first,
                    xaxis=chart.ref("x", k),
                )
            )
            first = False
    lines = [] if limit is None else [limit, *([-limit] if low < 0 else [])]
    odd_one = bool(np.any(marked & known))
    return chart.draw(
        "evidence.bars",
        data,
        y=chart.axis(title, range=[1.14 * low, 1.14 * top]),
        lines=[0, *lines],
        legend=odd_one,
        top=None if odd_one else 12,
        alt=alt,
        **_count_axes(parts),
    )


def _told(value: float) -> str:
    if not np.isfinite(value):
        return "∞"
    return page.minus(f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}")


def control(result: Result) -> page.Section | None:
    """What a wrong position would have had to be to be noticed."""
    some = result.tables["readings"]
    smallest = _column(some, "detectable")
    if smallest is None:
        return None
    parts = [k for k in kinds(some) if (~np.isnan(smallest[k.rows])).any()]
    unit, one = page.unit_of("specific force", smallest)
    blind = np.isinf(smallest)
    alt = "Smallest error of the specific force of each reading that would have been noticed"
    figure = _bars(
        parts,
        smallest / one,
        blind,
        f"smallest error seen [{unit}]",
        unit,
        ("controlled", "not controlled"),
        alt,
    )
    state = "warning" if blind.any() else "plain"
    told = [(state, c.sentence) for c in result.checks if c.name.startswith("control")]
    return page.section("evidence.control", figure, page.Items(told))


RIG = {"lever_arm": "Lever arm", "mounting": "Mounting", "table": "Table"}
"""First word of the name -> heading."""


def rig(result: Result) -> page.Section | None:
    """Lever arm, mounting and errors of the table, beside what was believed of them."""
    some = result.tables["rig"]
    names = [str(name) for name in some["name"]]
    if not names:
        return None
    value, sd, before = (np.asarray(some[k], float) for k in ("value", "sd", "prior_sd"))
    believed = bool(np.isfinite(before).any())
    heads = list(dict.fromkeys(name.partition(".")[0] for name in names))
    families = np.array([name.rpartition(".")[0] for name in names])
    rows: list[list[str]] = []
    for head in heads:
        if len(heads) > 1:
            rows.append([RIG.get(head, head)])
        for i in [i for i, name in enumerate(names) if name.partition(".")[0] == head]:
            mine = families == families[i]  # those of a family share a unit
            kind = some["kind"][i]
            unit, one = page.unit_of(kind, value[mine], sd[mine])
            if kind == "length":
                unit, one = "mm", 1e-3
            cells = [names[i], page.known_to(value[i] / one, sd[i] / one), page.size(sd[i] / one)]
            if believed:
                known = np.isfinite(before[i])
                cells.append(f"± {page.size(before[i] / one)}" if known else "nothing")
            rows.append([*cells, unit, str(some["meaning"][i])])
    heading = page.columns(
        "quantity: name | value: number | ± sd: number",
        "known before: number" * believed,
        "unit: short | meaning: meaning",
    )
    key = "evidence.rig"
    told = [
        (RIG[h], page.said(f"{key}.table_alone" if h == "table" and not believed else f"{key}.{h}"))
        for h in heads
        if h in RIG
    ]
    alone = len(told) == 1
    lead = " ".join(w[0].upper() + w[1:] if alone else f"{n}: {w}" for n, w in told)
    weak = np.isfinite(before) & (sd > NOTHING_ADDED * before)
    nothing = ", ".join(f"`{name}`" for name, w in zip(names, weak, strict=True) if w)
    items = page.Items([("plain", f"Known hardly better than before: {nothing}.")] * bool(nothing))
    title = told[0][0] if alone else None
    return page.section(key, page.Table(heading, rows), items, lead=lead, title=title)


# -- a rate table ----------------------------------------------------------------------------

STEPS = {"before": "before", "line": "off the line", "after": "after"}
"""Column of the table -> name of its panel."""

SPREAD = 0.012  # How far apart the axes stand at the same rate, as a part of the fastest [1].


def rate_steps(result: Result) -> page.Section | None:
    """Error of every step against the rate, and the figures that the standards ask for."""
    some = result.tables["rate_steps"]
    facts: Mapping[str, Mapping[str, float]] = result.diagnostics.get("rate_table") or {}
    blocks: list[Any] = [_steps_figure(some)]
    if facts:  # what IEEE Std 647 and 952 ask for, as they define it
        rows = facts.values()
        ppm = {
            "scale factor error": [1e6 * (r["scale_factor"] - 1.0) for r in rows],
            "non-linearity": [1e6 * r["nonlinearity"] for r in rows],
            "asymmetry": [1e6 * r["asymmetry"] for r in rows],
        }
        blocks.append(
            page.table(
                ("axis: short", facts),
                *(
                    (f"{k} [ppm]: number", [page.minus(f"{x:.4g}") for x in v])
                    for k, v in ppm.items()
                ),
                (
                    "fastest rate [°/s]: number",
                    [f"{np.degrees(r['full_scale']):.4g}" for r in rows],
                ),
            )
        )
        blocks.append(page.said("evidence.rate_steps.meaning"))
    chi = (result.diagnostics.get("chi_square") or {}).get("steps")
    if chi and result.diagnostics.get("noise", {}).get("source") != "measured by the residuals":
        blocks.append(page.Items([page.chi_square("Residuals of all steps", chi)]))
    return page.section("evidence.rate_steps", blocks)


def field(result: Result) -> page.Section | None:
    """What the calibration makes of headings, and the norm of the field before and after."""
    key, facts, cells = "evidence.field", result.diagnostics["field"], result.tables["cells"]
    raw = np.linalg.norm([cells[f"raw_{a}"] for a in "xyz"], axis=0)
    names = (("as read", raw, chart.SECOND), ("corrected", cells["norm"], chart.FIRST))
    data = [chart.dots(name, cells["time"], x * 1e6, colour, "%{x:.1f} s: %{y:.2f} uT|" + name)
            for name, x, colour in names]  # fmt: skip
    degrees = {k: np.degrees(facts[k]) for k in ("dip", "dip_sd") if k in facts}
    if "heading_spread" in facts:
        raw_sd, sd = np.degrees(facts["heading_spread"])
        degrees |= {"raw_sd": raw_sd, "sd": sd}
    keys = [
        f"{key}.lead",
        *[f"{key}.dip"] * ("dip" in degrees),
        *[f"{key}.spread"] * ("sd" in degrees),
    ]
    budget = result.tables["heading"]
    rows = page.table(
        ("cause: short", budget["cause"].tolist()),
        ("level heading [°]: number", [f"{np.degrees(x):.3g}" for x in budget["heading_sd"]]),
    )
    blocks: list[page.Block] = [rows]
    if other := result.tables.get("norths"):
        blocks += [page.Text(page.said(f"{key}.norths")), page.table(
            ("heading from: short", other["north"].tolist()),
            ("add [°]: number", [format_value(*np.degrees([x, s]))
                                 for x, s in zip(other["added"], other["sd"], strict=True)]),
            ("± sd [°]: number", [f"{np.degrees(s):.2g}" for s in other["sd"]]),
            ("by", other["by"].tolist()),
        )]  # fmt: skip
    size = facts["intensity"] * 1e6
    lead = page.said(*keys, intensity=size, basis=facts["intensity_basis"], **degrees)
    return page.section(key, *blocks, chart.draw(key, data, lines=[size]), lead=lead)


def spins(result: Result) -> page.Section | None:
    """What the tool did in every spin, and how the instrument sat in each mounting."""
    some, grips = result.tables["spins"], result.tables["mountings"]

    def shown(values: Any, unit: float = 1.0, digits: int = 3) -> list[str]:
        return [f"{x / unit:.{digits}g}" for x in np.asarray(values, float)]

    degree = np.radians(1.0)
    each = page.table(
        ("start [s]: number", [f"{x:.1f}" for x in some["time"]]),
        ("length [s]: number", [f"{x:.1f}" for x in some["length"]]),
        ("mounting: number", shown(some["mounting"])),
        ("rate [°/s]: number", shown(some["rate"], degree, 4)),
        ("turns: number", shown(some["turns"])),
        ("wander [%]: number", shown(some["wander"], 0.01, 2)),
        ("sway [°]: number", shown(some["sway"], degree, 2)),
        ("noise of a reading [mg]: number", shown(some["accel_sd"], 9.80665e-3, 2)),
        ("and of a gyro [°/s]: number", shown(some["gyro_sd"], degree, 2)),
        ("shift [mm]: number", shown(some["slip"], 1e-3, 2)),
    )
    sat = page.table(
        ("mounting: number", shown(grips["mounting"])),
        *((f"axis {a}: number", [f"{x:.4f}" for x in grips[f"axis_{a}"]]) for a in "xyz"),
        ("tilt [°]: number", shown(grips["tilt"], degree)),
        ("lever arm [mm]: number", shown(grips["arm"], 1e-3)),
    )
    return page.section("evidence.spins", each, sat, lead=page.said("evidence.spins.lead"))


def _steps_figure(some: Any) -> page.Figure:
    """One panel per column, one trace per axis of the instrument."""
    speed, up = (np.asarray(some[k], float) for k in ("rate_true", "up"))
    fastest = float(np.abs(speed).max())
    panels = []
    for column, title in STEPS.items():
        values, sd = (np.asarray(some[k], float) / (fastest or 1.0) for k in (column, "after_sd"))
        unit, one = page.unit_of("scale factor error", values)
        data = []
        for k, (name, colour) in enumerate(chart.OF_AXES.items()):
            mine = np.asarray(some["axis"]) == name
            if not mine.any():
                continue
            symbols = [
                f"triangle-{'up' if u > 0 else 'down'}{'' if w > chart.FULL else '-open'}"
                for u, w in zip(up[mine], np.asarray(some["weight"], float)[mine], strict=True)
            ]
            beside = (SPREAD * (k - 1) + SPREAD / 3 * up[mine]) * fastest
            hover = f"{name}, %{{customdata:.4g}}°/s: %{{y:.4g}} {unit}|"
            bar: chart.Trace = {
                "error_y": chart.whiskers(2 * sd[mine] / one, colour, thickness=1.1)
            }
            data.append(
                chart.dots(
                    name,
                    np.degrees(speed[mine] + beside),
                    values[mine] / one,
                    colour,
                    hover,
                    symbol=symbols,
                    customdata=chart.numbers(np.degrees(speed[mine])),
                    **bar if column == "after" else {},
                )
            )
        panels.append(chart.Panel(f"{title} [{unit}]", data, lines=[0]))
    alt = (
        "Error of every step against the rate about its axis: as read, off the straight line, and "
    )
    return chart.stacked("evidence.steps_figure", panels, alt=f"{alt}after calibration")


# -- a north seeker --------------------------------------------------------------------------

FIGURES = {
    "std": "standard deviation about the mean",
    "max": "largest departure from the mean",
    "peak_to_peak": "peak to peak",
    "mean": "mean",
    "rms": "root mean square, the mean in it",
}


def headings(result: Result) -> page.Section | None:
    """Heading error of every set-up before and after, and what the readings leave."""
    some = result.tables["headings"]
    x = np.degrees(np.asarray(some["heading"], float)) % 360
    circle = chart.axis("reference heading [°]", tick0=0, dtick=30, range=[-8, 368])
    order = np.argsort(x, kind="stable")
    of = {
        k: np.degrees(np.asarray(some[f"heading_{k}"], float))[order]
        for k in ("before", "after", "sd")
    }
    panels = []
    for name, colour in (("before", chart.SECOND), ("after", chart.FIRST)):
        hover = f"%{{x:.1f}}°: %{{y:.4f}}°|{name}"
        bar: chart.Trace = (
            {"error_y": chart.whiskers(2 * of["sd"], chart.FIRST)} if name == "after" else {}
        )
        data = [chart.dots(name, x[order], of[name], colour, hover, **bar)]
        panels.append(chart.Panel(f"{name} [°]", data, lines=[0]))
    alt = "Heading error of every set-up against the reference heading, before and after"
    blocks: list[page.Block] = [chart.stacked("evidence.headings", panels, x=circle, alt=alt)]
    facts = result.diagnostics.get("circle_accuracy") or {}
    if facts:
        cells = {
            w: [page.minus(f"{np.degrees(row[key]):.4f}°") for key in FIGURES]
            for w, row in facts.items()
        }
        blocks.append(
            page.table(
                ("circle accuracy", FIGURES.values()),
                *((f"{w}: number", some) for w, some in cells.items()),
            )
        )
    left = [
        chart.dots(
            f"gyro {a}",
            x,
            np.asarray(some[f"residual_{a}"], float),
            colour,
            f"%{{x:.1f}}°: %{{y:.2f}} sd|gyro {a}",
        )
        for a, colour in (("x", chart.FIRST), ("y", chart.SECOND))
    ]
    alt = "Standardized residual of the two rates against the reference heading"
    blocks.append(chart.draw("evidence.headings_2", left, x=circle, alt=alt))
    return page.section("evidence.headings", blocks)
