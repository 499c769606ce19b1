"""The report of a comparison: what changed, how, against which limits. It computes nothing."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.report import page
from foucault.report.chart import (
    BAD,
    FIRST,
    INK,
    WARNING,
    axis,
    draw,
    heat,
    level,
    line,
    names_axis,
    parted,
    shaded,
    upright,
    whiskers,
)
from foucault.report.page import (
    Document,
    Figure,
    Heading,
    Section,
    Table,
    known_to,
    minus,
    said,
    section,
    table,
    unit_of,
    words,
)
from foucault.run_folder import Record
from foucault.units import ZERO_CELSIUS, plain

About = Mapping[str, Any]

LISTED = 40  # Limits in the table of a page, the worst first.

PAIRS = 45
"""Pairs in the table of a page; of more results only neighbours, and the first with the last."""

REACH = 2.5  # A limit is drawn where it does not make the axis longer than so many times [1].

LOOKS = {
    "pass": "good",
    "doubtful": "warning",
    "fail": "bad",
    "undecided": "warning",
    "unusable": "bad",
}
SOURCES = {"given": "as given", "log": "from the log", "computed": "of the computation", "": ""}
COURSES = {
    "steady": "steady",
    "change": "changed",
    "drift": "drifts",
    "step": "one step",
    "drift or step": "drifts, or one step",
    "scatter": "scatters",
}


def document(record: Record) -> Document:
    """Return what there is to say of a comparison."""
    about = record.about
    several = len(about["instruments"]) > 1
    each = [
        [
            make(about, one, f": {one['name']}" if several else "")
            for make in (changes, _drawn, pairs)
        ]
        for one in about["instruments"]
        if one["compared"] is not None
    ]
    between = [mounting(about), differences(about), side_by_side(about),
               instruments_drawn(about)] if several else []  # fmt: skip
    noticed = page.findings(about["findings"], "results")
    return Document.of(
        _heading(about),
        _results(about),
        _tolerance(about),
        between,
        each,
        noticed,
        _provenance(about),
    )


def _heading(about: About) -> Heading:
    instruments, results = about["instruments"], about["results"]
    several, limited = len(instruments) > 1, about["tolerance"] is not None
    title = f"{len(instruments)} instruments compared" if several else instruments[0]["name"]
    if not several:
        title = f"{title[:1].upper()}{title[1:]}: has it changed?"
    dates = sorted(day for r in results if (day := _day(r["time"])))
    line = [
        f"{len(results)} results",
        *([" to ".join(dict.fromkeys((dates[0], dates[-1])))] if dates else []),
    ]
    line += [", ".join(dict.fromkeys(r["procedure"] for r in results))]
    changed = any(one["compared"] and one["compared"]["changed"] for one in instruments)
    open_ = any(d["decision"] == "undecided" for d in about["decisions"])
    verdict = about["verdict"]["level"]
    word = {
        "fail": "Out of tolerance",
        "doubtful": "Too near a limit to tell" if open_ else "Changed" if changed else "Doubtful",
        "pass": "Within tolerance" if limited else ("Compared" if several else "Not changed"),
    }[verdict]
    reasons = list(about["verdict"]["reasons"])
    return Heading(title, line, LOOKS[verdict], word, reasons)


def _day(time: float | None) -> str:
    if time is None:
        return ""
    return f"{datetime.datetime.fromtimestamp(time, datetime.UTC):%Y-%m-%d}"


def _results(about: About) -> Section | None:
    rows = about["results"]
    several = len(about["instruments"]) > 1
    warm = [r["temperature_mean"] for r in rows]
    mean = [f"{v - ZERO_CELSIUS:.1f} °C" if v is not None else "" for v in warm]
    return section(
        "compare.results",
        table(
            (": state", [LOOKS[r["verdict"]] for r in rows]),
            ("no.: number", [f"{i}" for i in range(1, len(rows) + 1)]),
            ("result: short", [r["label"] for r in rows]),
            ("instrument", [r["instrument"] for r in rows] if several else None),
            ("date: short", [_day(r["time"]) or "unknown" for r in rows]),
            ("which date: aside", [SOURCES[r["dated"]] for r in rows]),
            ("mean temperature", mean if any(mean) else None),
            ("procedure: aside", [r["procedure"] for r in rows]),
            ("its verdict: aside", [r["verdict"] for r in rows]),
        ),
    )


def _tolerance(about: About) -> Section | None:
    if about["tolerance"] is None:
        return None
    order = ("fail", "undecided", "pass")
    ranked = sorted(
        about["decisions"],
        key=lambda d: (order.index(d["decision"]), -abs(d["value"] or 0.0) / d["limit"]),
    )
    some = ranked[:LISTED]
    unit = _units(about, [d["name"] for d in some], [d["limit"] for d in some])

    def measured(d: About, one: float) -> str:
        known = d["value"] is not None and d["sd"] is not None
        return plus_minus(d["value"] / one, d["sd"] / one) if known else "unknown"

    def limit(d: About, name: str, one: float) -> str:
        return f"±{plain(d['limit'] / one)} {name}{' / year' * (d['what'] == 'drift')}"

    several, key = len(about["instruments"]) > 1, "compare.tolerance"
    both = list(zip(some, unit, strict=True))
    listed = table(
        (": state", [LOOKS[d["decision"]] for d in some]),
        ("coefficient: name", [d["name"] for d in some]),
        ("instrument", [d["instrument"] for d in some] if several else None),
        ("what: short", [d["what"] for d in some]),
        ("measured ± sd: number", [measured(d, one) for d, (_, one) in both]),
        ("limit: short", [limit(d, *u) for d, u in both]),
        ("decision: aside", [d["decision"] for d in some]),
        ("where: aside", [" → ".join(v for v in (d["first"], d["second"]) if v) for d in some]),
    )
    guard = plain(about["tolerance"]["guard_band_sd"])
    more = f"{key}.some" if len(ranked) > LISTED else ""
    lead = said(f"{key}.lead", more, guard=guard, listed=LISTED, count=len(ranked))
    return section(key, listed, lead=lead)


def _provenance(about: About) -> Section:
    made = about["provenance"]
    rows = [("created", str(made.get("created", "")))]
    rows += [("tolerance", about["tolerance"]["file"])] if about["tolerance"] else []
    rows += [(f"SHA-256 of {r['label']}", r["sha256"]) for r in about["results"]]
    return page.provenance([*rows, ("versions", words(made.get("versions") or {}))])


# -- one instrument --------------------------------------------------------------------------


def _kinds(about: About) -> dict[str, str]:
    return {c["name"]: c["kind"] for c in about["coefficients"]}


def _limits(about: About, name: str) -> tuple[float, float]:
    """Return the limits of the value and of a change; infinite where there are none."""
    row = next(c for c in about["coefficients"] if c["name"] == name)
    limit, change = (float("inf") if row[k] is None else row[k] for k in ("limit", "change"))
    return limit, change


def _units(about: About, names: Sequence[str], *sizes: Sequence[float]) -> list[tuple[str, float]]:
    """Return a unit for each name, the same for all of a family, and its size [SI]."""
    kinds = _kinds(about)
    family = np.array([name.rpartition(".")[0] for name in names])
    every = np.abs(np.array(sizes, float))
    return [unit_of(kinds[n], every[:, family == f]) for n, f in zip(names, family, strict=True)]


def changes(about: About, one: About, of: str) -> Section | None:
    """Return what changed from the first result to the last, and from each to the next."""
    c, last, names = one["compared"], len(one["results"]) - 1, one["compared"]["names"]
    ends = next(p for p in c["pairs"] if (p["first"], p["second"]) == (0, last))
    labels = [about["results"][i]["label"] for i in one["results"]]
    what = f"from {labels[0]} to {labels[last]}"
    drawn = [_in_sd(names, np.array(ends["z"]), c["z_limit"], what)]
    if last > 1:
        each = [p for p in c["pairs"] if p["second"] == p["first"] + 1]
        no = [i + 1 for i in one["results"]]
        steps = [f"{no[p['first']]} → {no[p['second']]}" for p in each]
        drawn.append(_intervals(names, np.array([p["z"] for p in each]), c["z_limit"], steps))
    return section(
        "compare.changes",
        drawn,
        _change_table(about, c, ends, last),
        of=of,
        what=what,
        joint="more than" if c["chi_square"] > c["limits"][1] else "no more than",
        dof=c["dof"],
        chi_square=plain(c["chi_square"], 4),
        limit=plain(c["limits"][1], 4),
    )


def _change_table(about: About, c: About, ends: About, last: int) -> Table:
    unit = _units(about, c["names"], ends["change"], ends["sd"])
    one, courses = np.array([v for _, v in unit]), c["courses"]
    change, sd = np.array(ends["change"]) / one, np.array(ends["sd"]) / one
    drift = None
    if any(course["drift"] is not None for course in courses) and last > 1:
        drift = [
            plus_minus(course["drift"] / v, course["drift_sd"] / v)
            for course, v in zip(courses, one, strict=True)
        ]
    return table(
        (": state", ["good" if course["how"] == "steady" else "warning" for course in courses]),
        ("coefficient: name", c["names"]),
        ("change: number", [known_to(*v) for v in zip(change, sd, strict=True)]),
        ("± sd: number aside", [known_to(v, v) for v in sd]),
        ("in sd: number aside", [minus(f"{z:+.1f}") for z in ends["z"]]),
        ("per year ± sd: number aside", drift),
        ("unit: short", [name for name, _ in unit]),
        ("course: short", [COURSES[course["how"]] for course in courses]),
    )


def _drawn(about: About, one: About, of: str) -> Section | None:
    """Return the coefficients of an instrument over time, a figure for each."""
    c, places = one["compared"], _places(about, one["results"])
    odd = {
        n for n, course in zip(c["names"], c["courses"], strict=True) if course["how"] != "steady"
    }
    title = "Result by result" if places == _numbers(one["results"]) else "Over time"
    limits = {name: _limits(about, name) for name in c["names"]}
    return section(
        "compare.drawn",
        _each(about, c, places, limits, odd, joined=True),
        title=f"{title}{of}",
        lead=_drawn_lead(about, "a result", ["change", "far"]),
    )


def _drawn_lead(about: About, what: str, more: Sequence[str]) -> str:
    keys = ["lead", *(["limits", *more] if about["tolerance"] is not None else [])]
    return said(*(f"compare.drawn.{key}" for key in keys), what=what)


def pairs(about: About, one: About, of: str) -> Section | None:
    """Return every pair of results, from three of them on."""
    c, n, key = one["compared"], len(one["results"]), "compare.pairs"
    if n < 3:
        return None
    rows = c["pairs"]
    few = len(rows) > PAIRS
    if few:
        ends = next(p for p in rows if (p["first"], p["second"]) == (0, n - 1))
        rows = [*(p for p in rows if p["second"] == p["first"] + 1), ends]
    far = [int(np.argmax(np.abs(p["z"]))) for p in rows]
    beyond = [
        p["chi_square"] > c["pair_limit"] or abs(p["z"][k]) > c["z_limit"]
        for p, k in zip(rows, far, strict=True)
    ]
    labels = [about["results"][i]["label"] for i in one["results"]]
    alone = [f"`{p['alone']}`" if p["alone"] else "none alone" for p in rows]
    listed = table(
        (": state", ["warning" if b else "good" for b in beyond]),
        ("from: short", [labels[p["first"]] for p in rows]),
        ("to: short", [labels[p["second"]] for p in rows]),
        ("chi-square: number", [plain(p["chi_square"], 3) for p in rows]),
        (
            "largest change: aside",
            [
                f"`{c['names'][k]}` ({minus(format(p['z'][k], '+.1f'))} sd)"
                for p, k in zip(rows, far, strict=True)
            ],
        ),
        ("explained by: short", [text if b else "" for text, b in zip(alone, beyond, strict=True)]),
    )
    lead = said(
        f"{key}.lead",
        f"{key}.some" if few else "",
        count=len(c["names"]),
        pair=plain(c["pair_limit"], 3),
        one=plain(c["z_limit"], 3),
    )
    return section(key, listed, lead=lead, of=of)


# -- several instruments ---------------------------------------------------------------------


def mounting(about: About) -> Section | None:
    """Return how the instruments of one vehicle lie in the axes of the first."""
    ties, degree = about.get("ties") or [], np.radians(1.0)
    if not ties:
        return None
    label = [r["instrument"] for r in about["results"]]
    turned = [
        [plus_minus(r / degree, sd / degree)
         for r, sd in zip(t["rotation"], t["sd"], strict=True)] for t in ties
    ]  # fmt: skip
    return section(
        "compare.mounting",
        table(
            ("instrument: short", [label[t["second"]] for t in ties]),
            *((f"about {a}: number", [row[k] for row in turned]) for k, a in enumerate("xyz")),
            ("unit: short", ["°" for _ in ties]),
            ("rests: number aside", [str(t["rests"]) for t in ties]),
        ),
        first=label[ties[0]["first"]],
    )


def differences(about: About) -> Section | None:
    """Return the biases and scale factors of each instrument less those of the first."""
    rows = about.get("differences") or []
    if not about.get("ties"):
        return None
    label = [one["name"] for one in about["instruments"]]
    kept = [k for k, n in enumerate(rows[0]["names"])
            if n.partition(".")[2].startswith(("bias", "scale"))]  # fmt: skip
    names = [rows[0]["names"][k] for k in kept]
    unit = _units(about, names, *([r["change"][k] for k in kept] for r in rows))
    columns = [
        (f"{label[r['second']]}: number",
         [plus_minus(r["change"][k] / one, r["sd"][k] / one)
          for k, (_, one) in zip(kept, unit, strict=True)]) for r in rows
    ]  # fmt: skip
    return section(
        "compare.differences",
        table(("coefficient: name", names), *columns, ("unit: short", [name for name, _ in unit])),
        first=label[rows[0]["first"]],
    )


def side_by_side(about: About) -> Section | None:
    """Return how the instruments spread beside how well each is known."""
    rows = about["between"]["spreads"]
    names = [s["name"] for s in rows]
    unit = _units(about, names, [s["spread"] for s in rows], [s["sd"] for s in rows])

    def of(key: str, to: str, part: float = 1.0) -> list[str]:
        return [
            known_to(s[key] / one, part * s[to] / one)
            for s, (_, one) in zip(rows, unit, strict=True)
        ]

    return section(
        "compare.side_by_side",
        table(
            ("coefficient: name", names),
            ("mean: number", of("mean", "spread", 0.1)),
            ("spread: number", of("spread", "spread")),
            ("sd of one: number", of("sd", "sd")),
            ("lowest: number aside", of("lowest", "sd")),
            ("highest: number aside", of("highest", "sd")),
            ("unit: short", [name for name, _ in unit]),
            ("told apart: short", ["yes" if s["told_apart"] else "no" for s in rows]),
        ),
    )


def instruments_drawn(about: About) -> Section | None:
    """Return the coefficients over the instruments, a figure for each."""
    b = about["between"]
    places = _numbers([one["results"][-1] for one in about["instruments"]])
    limits = {name: (_limits(about, name)[0], float("inf")) for name in b["names"]}
    odd = {o["name"] for o in b["outlying"]}
    return section(
        "compare.drawn",
        _each(about, b, places, limits, odd, joined=False),
        title="Instrument by instrument",
        lead=_drawn_lead(about, "a calibration", []),
    )


def _places(about: About, rows: Sequence[int]) -> list[str]:
    """Return the dates of results, their numbers where there are not two dates."""
    times = [about["results"][i]["time"] for i in rows]
    if None in times or times[0] == times[-1]:
        return _numbers(rows)
    dates = [datetime.datetime.fromtimestamp(t, datetime.UTC) for t in times]
    return [d.replace(tzinfo=None).isoformat(timespec="seconds") for d in dates]


def _numbers(rows: Sequence[int]) -> list[str]:
    return [f"no. {i + 1}" for i in rows]


def plus_minus(value: float, sd: float) -> str:
    """Write a number with its standard deviation, both in the unit shown."""
    return f"{known_to(value, sd)} ± {known_to(sd, sd)}"


# -- figures ---------------------------------------------------------------------------------


def _each(
    about: About,
    of: About,
    places: Sequence[str],
    limits: Mapping[str, tuple[float, float]],
    odd: set[str],
    *,
    joined: bool,
) -> list[Figure]:
    """Draw each coefficient over time, or over instruments: two sd, and what is allowed.

    `places` are dates, or numbers where there are none; `limits` are those of the value and of a
    change, infinite where there are none; `odd` coefficients are drawn in the colour of a warning;
    `joined` ones are results of one instrument.
    """
    kinds, values, sd = _kinds(about), np.array(of["values"]), np.array(of["sd"])
    return [
        _over_time(
            name,
            kinds[name],
            values[:, k],
            sd[:, k],
            places,
            limits[name],
            WARNING if name in odd else FIRST,
            joined,
        )
        for k, name in enumerate(of["names"])
    ]


def _over_time(
    name: str,
    kind: str,
    values: FloatArray,
    sd: FloatArray,
    places: Sequence[str],
    limits: tuple[float, float],
    colour: str,
    joined: bool,
) -> Figure:
    unit, one = unit_of(kind, values)
    y, error, limit, change = values / one, 2 * sd / one, limits[0] / one, limits[1] / one
    data = line(
        "",
        list(places),
        y,
        colour,
        f"%{{x}}: %{{y:.6g}} {unit}|",
        width=1,
        dash="dot",
        mode="lines+markers" if joined else "markers",
        marker={"color": colour, "size": 7},
        error_y=whiskers(error, colour, 3, 1.4),
    )
    low, high = float(np.min(y - error)), float(np.max(y + error))
    room = REACH * (high - low)
    shapes = []
    if np.isfinite(change) and change < room:
        middle = float(np.max(y) + np.min(y)) / 2
        allowed = (middle - change / 2, middle + change / 2)
        shapes += shaded([allowed], "y")
        low, high = min(low, allowed[0]), max(high, allowed[1])
    for side in (-limit, limit):
        if np.isfinite(side) and low - room < side < high + room:
            shapes.append(level(side, colour=BAD))
            low, high = min(low, side), max(high, side)
    reach = 0.08 * (high - low)
    dates = _dates(places)
    return draw(
        "compare.over_time",
        [data],
        x=dates or {"type": "category", "tickangle": 0, "nticks": 6},
        y=axis(unit, range=[low - reach, high + reach], nticks=5, exponentformat="none"),
        shapes=shapes,
        title={"text": name, "font": {"size": 13, "color": INK}, "x": 0.01, "y": 0.97},
        alt=f"{name} over {'time' if dates else 'the results'}, with two standard deviations",
    )


def _dates(places: Sequence[str]) -> dict[str, Any]:
    """Return an axis of dates, empty where they are none."""
    try:
        times = [datetime.datetime.fromisoformat(p) for p in places]
    except ValueError:
        return {}
    room = max((max(times) - min(times)) * 0.08, datetime.timedelta(hours=12))
    ends = [(min(times) - room).isoformat(), (max(times) + room).isoformat()]
    return {"type": "date", "range": ends, "nticks": 4, "tickangle": 0}


def _in_sd(names: Sequence[str], z: FloatArray, limit: float, what: str) -> Figure:
    """Draw changes over their standard deviations, with the limit that all of them share."""
    far = np.abs(z) > limit
    fine, odd = (~far, "within chance", FIRST, "circle"), (far, "beyond chance", WARNING, "diamond")
    data = parted(names, z, (fine, odd), "%{y}: %{x:.2f} sd|")
    top = 1.1 * max(limit, float(np.max(np.abs(z), initial=0.0)))
    return draw(
        "compare.in_sd",
        data,
        height=90 + 19 * len(names),
        x=axis("change / its sd", range=[-top, top]),
        y=names_axis(names),
        shapes=[upright(-limit), upright(limit), upright(0.0, "solid")],
        alt=f"Changes {what} in standard deviations, with their limit",
    )


def _intervals(names: Sequence[str], z: FloatArray, limit: float, steps: list[str]) -> Figure:
    """Draw the changes from each result to the next, shape (steps, names), as colours."""
    marks = [float(f"{k * limit:.3g}") for k in (-2, -1, 0, 1, 2)]
    data = heat(
        steps,
        list(names),
        np.round(z.T, 2),
        "%{y}, %{x}: %{z:.2f} sd|",
        2 * limit,
        title={"text": "sd", "side": "top"},
        tickvals=marks,
    )
    ticks = {"type": "category", "ticks": "", "showgrid": False, "tickmode": "linear"}
    return draw(
        "compare.intervals",
        [data],
        height=110 + 19 * len(names),
        x=ticks,
        y=ticks | {"autorange": "reversed", "tickfont": {"size": 11.5}},
    )
