"""What a systematic calibration found beside its coefficients: sequence, velocities, navigation.

And whether the gyros bend, and by which model: all models side by side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.report import chart, page
from foucault.report.orientation import WAYS
from foucault.result import Result

Columns = Mapping[str, Any]

COLOURS = dict(zip(WAYS, chart.SERIES, strict=False))

COMPENSATED = {
    "none": ("as it is", "dot", "dotted"),
    "all but deflection": ("all but deflection compensated", "dash", "dashed"),
    "all": ("compensated", "solid", "solid"),
}
"""What is compensated: in words, how it is drawn, and how that is called."""

ARCSEC = float(np.radians(1.0 / 3600.0))

QUANTITIES = {
    "shift": (ARCSEC, "tilt [″]", "Tilt"),
    "velocity": (1.0, "velocity [m/s]", "Velocity"),
}
"""What is drawn of the navigation test: its unit [SI], the axis, and its name."""

SAME = np.cos(np.radians(3.0))  # An axis nearer than this points there [1].
ROOM = 26  # Width of the name of an axis [px].
LABELS = 40  # So many rests are named on the axis, more are numbered [1].


def velocities(result: Result) -> page.Section | None:
    """The velocity at the end of every rest, with the calibration and without it."""
    some, key = result.tables["velocities"], "systematic.velocities"
    worst = {
        f"{name}": max(float(np.abs(some[f"{name}_{way}"]).max()) for way in WAYS)
        for name in ("before", "after")
    }
    speeds = {k: f"{v:.3g} m/s" if v >= 1 else f"{1e3 * v:.3g} mm/s" for k, v in worst.items()}
    alone = result.diagnostics["filter"]["decorrelate"]
    lead = page.said(f"{key}.decorrelated" if alone else f"{key}.lead", **speeds)
    return page.section(key, velocity_figure(some), lead=lead)


def velocity_figure(some: Columns) -> page.Figure:
    """Draw the velocity at the end of every rest: before above, after below with +-2 sd."""
    rest = np.asarray(some["rest"], int) + 1
    panels = []
    for name in ("before", "after"):
        most = max(float(np.abs(some[f"{name}_{way}"]).max()) for way in WAYS)
        unit, per = ("m/s", 1.0) if most >= 1.0 else ("mm/s", 1e3)
        data = []
        for k, (way, colour) in enumerate(COLOURS.items()):
            bar: dict[str, Any] = {
                "error_y": chart.whiskers(2 * per * np.asarray(some[f"sd_{way}"], float), colour)
            }
            data.append(
                chart.dots(
                    way,
                    rest + 0.16 * (k - 1),
                    per * np.asarray(some[f"{name}_{way}"], float),
                    colour,
                    f"rest %{{customdata}}: %{{y:.3g}} {unit}|{way}, {name}",
                    size=6,
                    customdata=rest.tolist(),
                    **bar if name == "after" else {},
                )
            )
        panels.append(chart.Panel(f"{name} [{unit}]", data, lines=[0]))
    return chart.stacked(
        "systematic.velocity_figure", panels, x=chart.count_axis("rest", int(rest.max()), 12)
    )


def sequence(result: Result) -> page.Section | None:
    """Where the axes of the body pointed in every rest, and how well each rest fits."""
    facts = result.diagnostics["sequence"]
    labels = list(facts["labels"])
    drawn = [
        _attitudes(result.tables["attitudes"], labels),
        _innovations(result.tables["innovations"], labels),
    ]
    known = {k: facts[k] for k in ("name", "rests", "moves")}
    return page.section("systematic.sequence", drawn, _passes(result), **known)


def _attitudes(some: Columns, labels: Sequence[str]) -> page.Figure:
    """Draw which axis of the body points east, north and up at every rest."""
    rest = np.asarray(some["rest"], int)
    groups: dict[str, list[tuple[int, str, str, str]]] = {a: [] for a in "xyz"}
    for way in WAYS:
        parts = np.array([np.asarray(some[f"{a}.{way}"], float) for a in "xyz"])
        for k, column in enumerate(parts.T):
            i = int(np.abs(column).argmax())
            name = ("−" if column[i] < 0 else "+") + "xyz"[i]
            angle = np.degrees(np.arccos(min(abs(float(column[i])), 1.0)))
            words = f"{labels[rest[k]]}: {name} {angle:.1f}° from {way}"
            name = name if abs(column[i]) > SAME else f"({name})"
            groups["xyz"[i]].append((int(rest[k]) + 1, way, name, words))
    data = []
    for a, some_ in groups.items():
        x, y, text, said_ = ([*v] for v in zip(*some_, strict=True)) if some_ else ([],) * 4
        data.append(
            {
                "type": "scatter",
                "mode": "text",
                "name": a,
                "x": x,
                "y": y,
                "text": text,
                "hovertext": said_,
                "hoverinfo": "text",
                "showlegend": False,
                "textfont": {"color": chart.OF_AXES[a], "size": 13},
            }
        )
    n = int(rest.max()) + 1
    ticks = chart.count_axis("rest", n, 12)
    if n <= LABELS:
        ticks |= {"tickvals": [*range(1, n + 1)], "ticktext": list(labels), "tickangle": -60}
        ticks["title"] = {"text": ""}
    look = {"categoryorder": "array", "categoryarray": list(WAYS), "range": [-0.6, 2.6]}
    return chart.draw("systematic.attitudes", data, x=ticks, y=look, meta={"least": 90 + ROOM * n})


def _innovations(some: Columns, labels: Sequence[str]) -> page.Figure:
    """Draw the scatter of what is seen in every rest over what is allowed for."""
    count = np.maximum(np.asarray(some["count"], float), 1.0)
    ratio = np.sqrt(np.asarray(some["square"], float) / count)
    n = len(ratio)
    data = chart.bars(
        "",
        list(range(1, n + 1)),
        ratio,
        chart.FIRST,
        "%{customdata}: %{y:.3f}|",
        customdata=list(labels),
    )
    look = chart.axis("innovation / sd", range=[0, max(1.15, 1.05 * float(ratio.max()))])
    return chart.draw("systematic.innovations", [data], x=chart.count_axis("rest", n, 12), y=look)


def _passes(result: Result) -> str:
    known = result.diagnostics.get("passes") or {}
    values = np.array(known.get("values") or [], float)
    if len(values) < 2:
        return ""
    c = result.coefficients
    both = [(k, c.layout.index(n)) for k, n in enumerate(known["names"]) if n in c.layout]
    sd = c.sd[[i for _, i in both]]
    steps = np.abs(np.diff(values[:, [k for k, _ in both]], axis=0)) / sd
    words = ", then ".join(f"{step.max():.2g}" for step in steps)
    return page.said("systematic.sequence.passes", count=len(values), steps=words)


def navigation(result: Result) -> page.Section | None:
    """The navigation test about east and about north."""
    some, ends = result.tables["navigation"], result.diagnostics["navigation"]
    drawn = [_navigated(some, about, what) for what in QUANTITIES for about in ("east", "north")]
    used = {end["compensated"] for end in ends}
    key = "; ".join(f"{dash}: {w}" for way, (w, _, dash) in COMPENSATED.items() if way in used)
    return page.section("systematic.navigation", drawn, _ends(ends), key=key.capitalize())


def _navigated(some: Columns, about: str, what: str) -> page.Figure:
    """Draw tilt ("shift") or velocity of the navigation test against time."""
    mine = np.asarray(some["about"]).astype(str) == about
    ways = np.asarray(some["compensated"]).astype(str)
    time = np.asarray(some["time"], float)
    per, title, words = QUANTITIES[what]
    data = []
    for way in dict.fromkeys(ways[mine].tolist()):
        rows = mine & (ways == way)
        told, dash, _ = COMPENSATED[way]
        data += [
            chart.line(
                part,
                time[rows],
                np.asarray(some[f"{what}_{part}"], float)[rows] / per,
                COLOURS[part],
                f"%{{x:.0f}} s: %{{y:.4g}}|{part}, {told}",
                dash=dash,
                legendgroup=part,
                showlegend=way == "all",
            )
            for part in WAYS[:2]
        ]
    return chart.draw(
        "systematic.navigated",
        data,
        y=title,
        caption=f"{words}, spin about {about}.",
        alt=f"{words} east and north after a spin about {about}, compensated and not",
    )


def _ends(ends: Sequence[Mapping[str, Any]]) -> page.Table:
    asis = {end["about"]: end for end in ends if end["compensated"] == "none"}

    def less(what: str) -> list[str]:
        """By how much each level error is less than that of the instrument as it is."""
        out = []
        for end in ends:
            left, before = (float(np.hypot(*r[what][:2])) for r in (end, asis[end["about"]]))
            same = end is asis[end["about"]] or not before
            out.append("" if same else page.unsigned(f"{100 * (1 - left / before):.1f} %"))
        return out

    def level(what: str, k: int, digits: int) -> list[str]:
        return [page.unsigned(f"{end[what][k] / QUANTITIES[what][0]:.{digits}f}") for end in ends]

    return page.table(
        ("spin about", [str(end["about"]) for end in ends]),
        ("instrument", [COMPENSATED[end["compensated"]][0] for end in ends]),
        ("tilt by the spin about east [″]: number", level("shift", 0, 2)),
        ("tilt by the spin about north [″]: number", level("shift", 1, 2)),
        ("less by: number aside", less("shift")),
        ("velocity at the end, east [m/s]: number", level("velocity", 0, 4)),
        ("velocity at the end, north [m/s]: number", level("velocity", 1, 4)),
        ("less by: number aside", less("velocity")),
    )


# -- which model of the deflection -----------------------------------------------------------


def deflection(result: Result) -> page.Section | None:
    """Every model of deflection, how well it explains the session, and what is used."""
    choice = result.diagnostics["choice"]
    used = next(m for m in choice["models"] if m["used"])
    rows = []
    for m in choice["models"]:
        odds, chance = m["log_odds"] - used["log_odds"], m["chance"]
        rows.append(
            [
                "good" if m["used"] else "plain",
                m["label"],
                f"{m['rank']} of {m['parameters']}" if m["parameters"] else "",
                f"{m['log_likelihood']:.1f}",
                "" if chance is None else "< 1e-99" if chance < 1e-99 else f"{chance:.2g}",
                page.minus(f"{odds:+.1f}"),
                "" if m["bound"] is None else f"{m['bound'] * 9.80665 / ARCSEC:.2g}",
                _verdict(m, odds, choice),
            ]
        )
    heads = page.columns(
        ": state | model | seen: number | log-likelihood: number aside",
        "by chance: number aside | log odds: number | none above [″/g]: number aside",
        "verdict",
    )
    notes = page.said("systematic.deflection.notes", limit=choice["limit"])
    return page.section(
        "systematic.deflection", page.Table(heads, rows), notes, lead=choice["verdict"]
    )


def _verdict(m: Mapping[str, Any], odds: float, choice: Mapping[str, Any]) -> str:
    if m["used"]:
        return "used"
    bends = choice["chance"] < choice["false_alarm"]
    if m["model"] == "none":
        return "ruled out" if bends else "as good"
    if not bends:
        return "not needed"
    words = "better" if odds > choice["limit"] else "ruled out"
    if abs(odds) <= choice["limit"]:
        words = "not ruled out"
    return words if m["usable"] else f"{words}; not seen whole"
