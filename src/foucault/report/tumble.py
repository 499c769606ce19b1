"""What a platform tumble found beside its coefficients: alignment, motion, and what it showed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.models.cluster import CONSTANTS
from foucault.report import chart, orientation, page
from foucault.result import Result
from foucault.tables import AXES

ATTITUDE = "C_np = C_1(outer) C_2(middle) C_3(inner)"

ANGLES = {
    "outer": "about North",
    "middle": "about Up while outer is 0: azimuth",
    "inner": "about z of the cluster",
}

OF_RESIDUALS = {"stretches", "neighbours", "slow errors"}
"""Checks that stand with the residuals, beside those of each accelerometer."""

START = {"start.east": "ψ_E", "start.north": "ψ_N", "start.up": "ψ_U"}

MOST_LEGS = 24  # Legs of the motion that are listed [1].
MOST_NUMBERS = 20  # Legs that are numbered; more would stand on one another [1].
MOST_UNSEEN = 12  # Combinations that cannot be seen and are named [1].
GUIDE = 3.0  # Lines and bands are drawn at so many standard deviations [1].
DOTS = 700  # So many residuals of an axis are drawn, and beyond the lines twice as many more [1].
TICKS = 2  # Powers of ten that are marked on each side of zero [1].
NEAR = 0.22  # A mark nearer to zero than this part of the axis would stand on the zero [1].
CURVES = 160  # Points of a sensitivity curve that are drawn [1].

Legs = Sequence[Mapping[str, Any]]

_NAME = re.compile(r"\b(?:gyro|accel|start|attitude)\.[\w.]*\w")


def alignment(result: Result) -> page.Section | None:
    """Attitude at the end and at the start, and the delay."""
    found, c = result.diagnostics["attitude"], result.coefficients
    if "attitude.outer" not in c.layout:
        return None
    at = [c.layout.index(f"attitude.{word}") for word in ANGLES]
    start, believed = (np.asarray(found[k], float) for k in ("start", "believed"))
    ends = zip(np.degrees(c.values[at]), np.degrees(c.sd[at]), strict=True)
    apart = (start - believed + np.pi) % (2 * np.pi) - np.pi
    angles = page.table(
        ("angle: short", ANGLES),
        ("at the end: number", [page.unsigned(format_value(v, sd)) + "°" for v, sd in ends]),
        ("± sd: number", [page.quantity(sd, "angle", 2) for sd in c.sd[at]]),
        ("at the start: number", _degrees(start)),
        ("as believed: number aside", _degrees(believed)),
        ("difference: number aside", _degrees(apart)),
        ("turns the axes: aside", ANGLES.values()),
    )
    east, north, up = tips = np.asarray(found["C_pn"], float).T
    pointing = page.table(
        ("axis at the end: short", AXES),
        ("azimuth: number", _degrees(np.arctan2(east, north) % (2 * np.pi))),
        ("elevation: number", _degrees(np.arctan2(up, np.hypot(east, north)))),
        *(
            (f"{word}: number aside", [page.unsigned(f"{v:.6f}") for v in part])
            for word, part in zip(orientation.WAYS, tips, strict=True)
        ),
    )
    known = {
        "start": ("start_sd", "East, North and Up"),
        "end": ("sd", "x, y and z of the cluster"),
    }
    facts = [
        (
            f"attitude at the {when} known to",
            ", ".join(page.quantity(v, "angle", 2) for v in found[key]) + f" about {about}",
        )
        for when, (key, about) in known.items()
    ]
    if delay := result.diagnostics.get("delay"):
        facts.append(("delay of the readings", _delay(delay)))
    return page.section(
        "tumble.alignment", page.Equation([ATTITUDE]), angles, pointing, page.Facts(facts)
    )


def _degrees(angles: Iterable[float]) -> list[str]:
    return [page.unsigned(f"{np.degrees(v):.4f}") + "°" for v in angles]


def _delay(delay: Mapping[str, Any]) -> str:
    if not (delay["sd"] or 0) > 0:  # none where the motion shows no delay
        return "not tested"
    value, sd = (1e3 * delay[key] for key in ("value", "sd"))
    words = f"{page.unsigned(format_value(value, sd))} ± {format_value(sd, sd)} ms"
    if delay["estimated"]:
        return f"{words}, estimated with the rest"
    return f"{words}, tested: {'none seen' if abs(value) < GUIDE * sd else 'NOT taken off'}"


# -- the motion ------------------------------------------------------------------------------


def _legs(result: Result) -> Legs:
    return list((result.diagnostics.get("observability") or {}).get("legs") or [])


def changes(legs: Legs) -> list[chart.Trace]:
    """Return a thin line wherever the command changes, down the whole figure."""
    return chart.marked(leg["start"] for leg in legs[1:])


def leg_numbers(legs: Legs) -> list[chart.Trace]:
    """Return the number of every leg, above its middle."""
    some = legs if len(legs) <= MOST_NUMBERS else []
    return [
        chart.noted(str(k), (leg["start"] + leg["end"]) / 2, xref="x")
        for k, leg in enumerate(some, 1)
    ]


def motion(result: Result) -> page.Section | None:
    """The way of the cluster axes, and the legs of the motion."""
    some, legs = result.tables["path"], _legs(result)
    turned = {word: np.degrees(some[word]) for word in ANGLES}
    data = chart.lines(
        some["time"], turned, "%{x:.0f} s: %{y:.2f}°", chart.OF_AXES.values(), width=2
    )
    angles = chart.draw("tumble.motion", data, shapes=changes(legs), notes=leg_numbers(legs))
    listed = _leg_table(result, legs) if 0 < len(legs) <= MOST_LEGS else None
    return page.section("tumble.motion", orientation.ways(some), angles, listed)


def _leg_table(result: Result, legs: Legs) -> page.Table:
    growth = result.diagnostics["observability"]["growth"]
    until = np.asarray(growth["until"])
    last = [max(0, int(np.searchsorted(until, leg["end"] + 1e-6)) - 1) for leg in legs]
    rates = np.degrees([leg["rate"] for leg in legs]).T
    return page.table(
        ("leg: short", [str(k) for k in range(1, len(legs) + 1)]),
        ("from [s]: number", [f"{leg['start']:.0f}" for leg in legs]),
        ("to [s]: number", [f"{leg['end']:.0f}" for leg in legs]),
        *(
            (f"rate {a} [°/s]: number", [page.unsigned(f"{v:.3f}") for v in some])
            for a, some in zip(AXES, rates, strict=True)
        ),
        ("rank by then: number", [str(growth["rank"][k]) for k in last]),
        ("seen alone by then: number aside", [str(growth["alone"][k]) for k in last]),
    )


def observability(result: Result) -> page.Section | None:
    """What the motion shows, step by step, and what remains."""
    seen = result.diagnostics["observability"]
    if "growth" not in seen:
        return None
    key, rank, whole, growth = "tumble.observability", seen["rank"], seen["states"], seen["growth"]
    until = growth["until"][int(np.argmax(np.asarray(growth["rank"]) == rank))]
    left = page.counted(whole - rank, "combination") + " of coefficients"
    weakest = "" if rank < whole else _rounded(1 / seen["smallest"])
    words = page.said(
        f"{key}.rank" if rank < whole else f"{key}.rank_full",
        rank=rank,
        whole=whole,
        until=until,
        left=left,
        weakest=weakest,
    )
    share = seen["of_prior"]
    drift = [n for n in share if n.startswith("gyro.drift")]
    rest = sorted((n for n in share if n not in drift), key=lambda n: n in START)
    return page.section(
        key,
        words,
        _growth(growth, whole, _legs(result)),
        page.said(f"{key}.of_prior"),
        _of_prior("Drift of the gyros", drift, share, ""),
        _of_prior("All others", rest, share, page.said(f"{key}.start")),
        page.Items(_unseen(seen)),
        title=page.told(f"{key}.title" if rank == whole else f"{key}.title_not_all"),
    )


def _unseen(seen: Mapping[str, Any]) -> list[tuple[str, str]]:
    unseen = [w.removesuffix(": not seen at all") for w in seen["unseen"]]
    items = [("warning", f"Not seen: {_named(w)}.") for w in unseen[:MOST_UNSEEN]]
    if len(unseen) > MOST_UNSEEN:
        items.append(("warning", f"Not seen: {len(unseen) - MOST_UNSEEN} more combinations."))
    if not unseen:
        items += [("plain", f"Remains least known: {_named(w)}.") for w in seen["remaining"][:3]]
    items += [("plain", f"Hard to tell apart: {_named(w)}.") for w in seen["weakest"][:3]]
    pairs = [f"`{a}` and `{b}` ({value:+.2f})" for a, b, value in seen["correlated"][:6]]
    if pairs:
        items.append(("plain", page.minus(f"Errors most correlated: {', '.join(pairs)}.")))
    return items


def _rounded(value: float) -> str:
    return f"{float(f'{value:.2g}'):,.0f}".replace(",", "\N{NO-BREAK SPACE}")


def _named(words: str) -> str:
    """Mark names as code, and write signs as people do."""
    words = page.minus(words).replace(" ...", " and smaller parts")
    return _NAME.sub(lambda m: f"`{m.group()}`", words)


def _growth(growth: Mapping[str, Any], whole: int, legs: Legs) -> page.Figure:
    """Draw how many of `whole` unknowns have been seen by the end of each short turn [s]."""
    until = growth["until"]
    curves = (("combinations seen (rank)", "rank"), ("seen each alone", "alone"))
    data = [
        chart.line(
            name,
            [0, *until],
            [0, *growth[key]],
            colour,
            f"%{{x:.0f}} s: %{{y}}|{name}",
            width=2,
            shape="hv",
            mode="lines+markers",
            marker={"color": colour, "size": 6},
        )
        for (name, key), colour in zip(curves, chart.SERIES, strict=False)
    ]
    return chart.draw(
        "tumble.growth",
        data,
        x=chart.axis("time [s]", showgrid=False, range=[0, 1.005 * until[-1]]),
        y=chart.axis(f"of {whole}", range=[0, 1.06 * whole]),
        lines=[whole],
        shapes=changes(legs),
        notes=leg_numbers(legs),
    )


def _of_prior(
    title: str, names: Sequence[str], share: Mapping[str, float], caption: str
) -> page.Figure:
    """Draw the standard deviation of each unknown over that before, from the least to 1."""
    symbols = {c.name: c.symbol for c in CONSTANTS.coefficients} | START
    labels = [chart.lowered(symbols.get(n, n)) for n in names]
    x = chart.numbers(np.maximum([share[n] for n in names], 1e-12))
    low = math.floor(math.log10(min(max(min(share.values()), 1e-12), 0.1)) - 0.05)
    data = [
        chart.line(
            "",
            [v for one in x for v in (one, 1.0, None)],
            [n for n in labels for _ in range(3)],
            chart.BAND,
            width=5,
        ),
        chart.dots("", x, labels, hover="%{y}: %{x:.2g} of the prior|"),
    ]
    return chart.draw(
        "tumble.of_prior",
        data,
        height=86 + 18 * len(names),
        x=chart.log_axis("sd after / sd before", range=[low, 0.06], tickfont={"size": 11}),
        y=chart.names_axis(labels, 12.5, 0.6),
        notes=[chart.titled(f"<b>{title}</b>")],
        caption=caption,
        alt=f"{title}: standard deviation of each over that before, from 1 down to 1e{low}",
    )


# -- estimates and residuals -----------------------------------------------------------------


def course(result: Result) -> page.Section | None:
    """How each estimate came about in the course of time."""
    some = result.tables["course"]
    return page.section(
        "tumble.course",
        [
            _course(np.asarray(some["time"], float), family, some, _legs(result))
            for family in (*families(3), _attitude())
        ],
    )


def families(most: int = 6) -> list[chart.Family]:
    """Return the coefficients in groups of one kind, at most `most` in each."""
    groups: dict[str, list[str]] = {}
    for name in CONSTANTS.names:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    return [
        _family(group, members[a : a + most])
        for group, members in groups.items()
        for a in range(0, len(members), most)
    ]


def _family(name: str, members: Sequence[str], labels: Iterable[str] = ()) -> chart.Family:
    kind = CONSTANTS.coefficients[CONSTANTS.index(members[0])].kind
    unit = units.KINDS[kind].display[0]
    own = tuple(labels) or tuple(m.rpartition(".")[2] for m in members)
    return chart.Family(name, tuple(members), own, page.shown(unit), units.factor(unit, kind))


def _attitude() -> chart.Family:
    members = tuple(f"attitude.{a}" for a in AXES)
    labels = tuple(f"about {a}" for a in AXES)
    return chart.Family("attitude", members, labels, "arcsec", units.factor("arcsec", "angle"))


def _course(
    time: FloatArray, family: chart.Family, some: Mapping[str, Any], legs: Legs
) -> page.Figure:
    """Draw estimates minus the last in their bands, one panel each.

    Both are compressed beyond the smallest final standard deviation: logarithmic, with zero.
    """
    y, band = np.array(family.of(some)), GUIDE * np.array(family.of(some, ".sd"))
    y = y if family.name == "attitude" else y - y[:, -1:]
    final = band[:, -1]
    unit = float(np.min(final, where=final > 0, initial=np.inf)) / GUIDE
    unit = unit if np.isfinite(unit) else 1.0
    top = float(np.max(np.abs([y, band]), where=np.isfinite([y, band]), initial=10 * unit))

    def drawn(v: Any) -> FloatArray:
        return np.asarray(np.sign(v) * np.log10(1 + np.abs(v) / unit))

    data: list[chart.Trace] = []
    notes, axes = [chart.titled(f"<b>{family.name}</b> [{family.unit}]", 20)], {}
    n, shapes = len(family.members), [chart.level(0)]
    decade = 10.0 ** math.floor(math.log10(0.85 * time[-1]))
    mark = decade * max(k for k in (1, 2, 4, 5, 8) if k * decade <= 0.85 * time[-1])
    for k, label in enumerate(family.labels):
        on = {"xaxis": chart.ref("x", k)}
        edge = np.round(drawn(band[k]), 4)
        data.append(chart.band("", time, -edge, edge, **on))
        hover = f"{label}, %{{x:.0f}} s: %{{customdata[0]}} ± %{{customdata[1]}} {family.unit}|"
        both = [list(pair) for pair in zip(chart.short(y[k]), chart.short(band[k]), strict=True)]
        data.append(
            chart.line(
                "",
                time,
                np.round(drawn(y[k]), 4),
                chart.FIRST,
                hover,
                width=1.6,
                customdata=both,
                **on,
            )
        )
        domain = [k / n + 0.012 * (k > 0), (k + 1) / n - 0.012 * (k < n - 1)]
        axes[chart.ref("xaxis", k)] = {
            "domain": domain,
            "range": [0, time[-1]],
            "tickvals": [mark],
            "showgrid": False,
        }
        notes.append(chart.noted(label, sum(domain) / 2))
        shapes += [one | {"xref": chart.ref("x", k)} for one in changes(legs)]
    ticks, words = _symmetric(unit, top)
    high = 1.05 * float(drawn(top))
    look = {"tickvals": chart.numbers(drawn(ticks)), "ticktext": words, "range": [-high, high]}
    alt = f"{family.name}: estimate minus the last one against time, within three sd"
    return chart.draw("tumble.course", data, y=look, shapes=shapes, notes=notes, alt=alt, **axes)


def _symmetric(unit: float, top: float) -> tuple[FloatArray, list[str]]:
    """Return powers of ten between `unit` and `top`, both signs and zero, and their texts."""
    high = math.floor(math.log10(top))
    step = max(1, math.ceil((high - math.log10(unit)) / TICKS - 0.2))
    powers = [high - step * k for k in range(TICKS)]
    least = NEAR * math.log10(1 + top / unit)
    powers = [p for p in powers if math.log10(1 + 10.0**p / unit) > least]
    values = [sign * 10.0**p for p in powers for sign in (1, -1)]
    said = [f"{10.0**p:g}" if -4 < p < 5 else page.minus(f"10<sup>{p}</sup>") for p in powers]
    return np.array([0.0, *values]), ["0", *(sign + s for s in said for sign in ("", "−"))]


def residuals(result: Result) -> page.Section | None:
    """White residuals against time."""
    some, legs = result.tables["residuals"], _legs(result)
    time = np.asarray(some["time"], float)
    white = {a: np.asarray(some[a], float) for a in AXES}
    panels = []
    for name, y in white.items():
        far = np.flatnonzero(np.abs(y) > GUIDE)
        keep = np.union1d(_evenly(np.arange(len(y)), DOTS), _evenly(far, 2 * DOTS))
        top = 1.08 * float(np.max(np.abs(y), where=np.isfinite(y), initial=4.0))
        data = chart.dots(
            "",
            time[keep],
            np.round(y[keep], 3),
            chart.OF_AXES[name],
            f"%{{x:.0f}} s: %{{y:.2f}} sd|{name}",
            size=4,
            marker={"opacity": 0.65},
        )
        look = {"range": [-top, top]}
        panels.append(chart.Panel(f"{name}: residual / sd", [data], look, (-GUIDE, GUIDE)))
    figure = chart.stacked("tumble.residuals", panels, shapes=changes(legs))
    every = np.concatenate(list(white.values()))
    averaged, key = result.diagnostics.get("averaged"), "tumble.residuals"
    lead = page.said(
        f"{key}.lead",
        f"{key}.averaged" if averaged else "",
        f"{key}.drawn",
        guide=GUIDE,
        count=len(every),
        beyond=int(np.sum(np.abs(every) > GUIDE)),
        expected=0.0027 * len(every),
        averaged=averaged,
    )
    items = None
    if chi := (result.diagnostics.get("chi_square") or {}).get("accel"):
        names = {f"accelerometer {a}" for a in AXES} | OF_RESIDUALS
        tested = [c for c in result.checks if c.name in names]
        items = page.Items(
            [
                page.chi_square("Readings of the accelerometers", chi),
                *(("good" if c.passed else "warning", c.sentence) for c in tested),
            ]
        )
    return page.section(key, figure, items, lead=lead)


def _evenly(rows: npt.NDArray[Any], most: int) -> npt.NDArray[Any]:
    """Return at most `most` [1] of the rows, evenly chosen."""
    n = len(rows)
    return rows if n <= most else rows[np.linspace(0, n - 1, most).astype(int)]


# -- sensitivity -----------------------------------------------------------------------------


def sensitivity(result: Result) -> page.Section | None:
    """How the readings change with each coefficient along the motion."""
    some, legs = result.tables["sensitivity"], _legs(result)
    arcsec = units.factor("arcsec", "angle")
    attitude = chart.Family(
        "attitude at the start", tuple(START), orientation.WAYS, "arcsec", arcsec
    )
    return page.section(
        "tumble.sensitivity",
        [_pictured(title, some, of, legs) for title, of in _four()],
        _explorer(some, [*families(), attitude], legs),
    )


def _four() -> list[tuple[str, list[chart.Family]]]:
    """The four pictures that say most: gyro drift, one gyro, its axes, one accelerometer."""
    senses = ("input", "output", "spin")
    first = [f"gyro.drift_{word}.x" for word in senses]
    axes = ["gyro.misalignment.xy", "gyro.misalignment.xz"]
    own = {w: f"accel.{w}.y" for w in ("bias", "scale", "quadratic")}
    own |= {"yx": "accel.misalignment.yx"}
    return [
        ("Drift of the gyros [µg per °/h]", [_family("drift", [f"gyro.drift.{a}" for a in AXES])]),
        ("X gyro, drift per g [µg per °/h/g]", [_family("first", first, senses)]),
        ("X gyro, misalignments [µg per arcsec]", [_family("axes", axes)]),
        (
            "Y accelerometer [µg per µg, ppm, µg/g², arcsec]",
            [_family(label, [name], [label]) for label, name in own.items()],
        ),
    ]


def _curves(
    some: Mapping[str, Any], families: Sequence[chart.Family], output: str
) -> list[chart.Trace]:
    """Curves of one accelerometer in micro-g per unit."""
    time = np.asarray(some["time"], float)
    rows = _evenly(np.arange(len(time)), CURVES)
    out: list[chart.Trace] = []
    for family in families:
        for member, label in zip(family.members, family.labels, strict=True):
            y = np.asarray(some[f"{output}.{member}"], float)[rows] * family.size / 9.80665e-6
            hover = f"%{{x:.0f}} s: %{{y:.3g}} µg per {family.unit}|{label} → {output}"
            out.append(
                chart.line(
                    label, np.round(time[rows], 1), chart.short(y), chart.SERIES[len(out)], hover
                )
            )
    return out


def _answers(
    outputs: Iterable[tuple[str, list[chart.Trace]]], legs: Legs, height: float, **more: Any
) -> page.Figure:
    """Draw d(reading)/d(coefficient), one panel for each accelerometer."""
    panels = [chart.Panel(a, data, {"nticks": 4, "exponentformat": "none"}) for a, data in outputs]
    zero = [chart.level(0, chart.ref("y", k), chart.FAINT) for k in range(len(panels))]
    time = chart.axis("time [s]", showgrid=False)
    return chart.stacked(
        "tumble.answers", panels, height=height, x=time, shapes=[*zero, *changes(legs)], **more
    )


def _pictured(
    title: str, some: Mapping[str, Any], of: Sequence[chart.Family], legs: Legs
) -> page.Figure:
    """Draw the accelerometers that answer."""
    members = [m for f in of for m in f.members]
    strongest = {a: max(float(np.abs(some[f"{a}.{m}"]).max()) for m in members) for a in AXES}
    outputs = [a for a, v in strongest.items() if v > 1e-4 * max(strongest.values())]
    curves = [(a, _curves(some, of, a)) for a in outputs]
    alt = f"Change of the accelerometers' readings with {title} against time"
    return _answers(
        curves, legs, 320, notes=[chart.titled(f"<b>{title}</b>", 20)], top=60, share=50, alt=alt
    )


def _explorer(some: Mapping[str, Any], of: Sequence[chart.Family], legs: Legs) -> page.Figure:
    """Draw the same of one family at a time, which a list chooses."""
    choices = {f"{f.name} [µg per {f.unit}]": f for f in of}
    curves = [
        (
            a,
            [
                t | {"meta": choice, "legendgroup": t["name"], "showlegend": a == "x"}
                for choice, f in choices.items()
                for t in _curves(some, [f], a)
            ],
        )
        for a in AXES
    ]
    alt = "Change of the accelerometers' readings with the chosen coefficients against time"
    meta = {"choices": list(choices), "choose": "Change of the readings with"}
    return _answers(curves, legs, 440, meta=meta, on="screen", alt=alt)
