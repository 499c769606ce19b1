"""What a transfer alignment did, and what it found: delay, estimates, innovations, hand-over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import format_value
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models.earth import displacement
from foucault.report import chart, page
from foucault.report.orientation import WAYS
from foucault.result import Result
from foucault.units import plain

Times = Sequence[float]

MATCHED = {
    "velocity+attitude": "velocity and attitude",
    "velocity": "velocity",
    "attitude": "attitude",
}
"""What of the messages is used, in words."""

FORMS = {"vector": "attitude as a rotation vector", "angles": "attitude as heading, pitch, roll"}
"""How attitudes are compared, in words."""

METHODS = {
    "rate matching": "what both turned",
    "likelihood": "the likeliest",
    "state": "the middle of its bracket",
}
"""Where the delay starts from, in words."""

WANTED = {"prior": "every state, in units of its prior", "outage": "position after the outage"}
"""What a bound is of, in words."""

GROUPS = {
    "gyro.bias": ("gyro bias", "deg/h"),
    "gyro.scale": ("gyro scale", "ppm"),
    "accel.bias": ("accel bias", "mg"),
    "installation": ("installation", "arcmin"),
    "master": ("delay", "ms"),
    "load": ("installation per g", "arcmin"),
}
"""Group of coefficients -> how a figure calls it, and its unit."""

COMPARED = ("gyro bias", "installation")
"""Groups of coefficients that are drawn with the delay and without it."""

MOST = 40  # So many stretches are listed and marked [1].
BACK = 5.0  # Turns that come to less end where they began [deg].
DOTS = 600  # So many innovations of a component are drawn, and those outside three sd besides [1].
GROUPED = 60  # Points that the course of the NIS is drawn with [1].
GUIDE = 2.0  # Bands are drawn at so many standard deviations [1].
LATE = 0.1  # An axis of estimates shows what they did after this part of the run in full [1].
RANGE = 6.0  # And at least so many final standard deviations [1].
UNSEEN = 0.01  # A part whose delay is less certain than this shows none [s].

MINUTE = float(np.radians(1 / 60))
TIME = chart.axis("time [s]", showgrid=False)
COURSE = "%{x:.1f} s: %{y:.4g}"  # What the pointer says of a line against time.


def started(result: Result) -> float:
    """Return when the slave's log begins by its clock [s]: times of the report count from there."""
    return float(result.diagnostics.get("start", 0.0))


def table_of(result: Result, name: str) -> dict[str, Any] | None:
    """Return a table of the run, its times counted from the start of the slave's log [s]."""
    some = result.tables.get(name)
    if some is None or not len(next(iter(some.values()))):
        return None
    clock = ("time", "start", "end")
    return {k: np.asarray(v, float) - started(result) if k in clock else v for k, v in some.items()}


def done(result: Result) -> page.Section | None:
    """What was matched, by which filter, and where the delay is from."""
    d, f = result.diagnostics, result.diagnostics["filter"]
    noise, n = d["noise"], len(d["passes"]["values"])
    name = {"kalman": "Kalman", "h_infinity": "H-infinity"}[f["name"]]
    form = f"; {FORMS[f['attitude_form']]}" if "attitude" in d["matching"] else ""
    sds = [f"{plain(f['velocity_sd'], 3)} m/s"] if "velocity" in d["matching"] else []
    if form:
        sds.append(f"{plain(f['attitude_sd'] / MINUTE, 3)} arcmin")
    bounded: list[tuple[str, str]] = []
    if f["gamma"] is not None:
        times = f"{f['gamma'] / f['least_gamma']:.2f} times the least, {plain(f['least_gamma'], 4)}"
        bounded = [
            ("gamma", f"{plain(f['gamma'], 4)}, {times}"),
            ("bound of", WANTED.get(f["wanted"], str(f["wanted"]))),
        ]
    start = f"{plain(started(result), 13)} s of the slave's clock, the start of its log"
    pairs = [
        ("matched", MATCHED[d["matching"]] + form),
        ("sd of a difference", ", ".join(sds) + " each component"),
        ("messages used", f"{d['messages']['used']} of {d['messages']['logged']}"),
        ("filter", f"{name}, {f['states']} states, {n} pass{'es' * (n != 1)}"),
        *bounded,
        ("delay", _delay(d["delay"])),
        ("mount", _mount(f)),
        ("noise of the gyros", page.quantity(noise["gyro"], "angle random walk")),
        ("noise of the accelerometers", page.quantity(noise["accel"], "velocity random walk")),
        *([("time 0", start)] if started(result) else []),
    ]
    lead = page.said("transfer.done.lead", "transfer.done.bounded" * bool(bounded))
    return page.section("transfer.done", page.Facts(pairs), lead=lead)


def _delay(delay: Mapping[str, Any]) -> str:
    if delay["method"] in METHODS:
        value = " ± ".join(_milliseconds(delay["used"], delay["sd"]))
        return f"{value} ms, starting from {METHODS[delay['method']]}"
    if delay["method"] == "none":
        return "none: messages are taken as if they held when they arrive"
    return f"{plain(1e3 * delay['used'])} ms, as given"


def _milliseconds(seconds: float, sd: float) -> tuple[str, str]:
    value, spread = 1e3 * float(seconds), 1e3 * float(sd)
    return page.unsigned(format_value(value, spread)), format_value(spread, spread)


def _mount(f: Mapping[str, Any]) -> str:
    parts = ["gives way under load"] if f["load"] else []
    if f["flexure_sd"] > 0:
        size, time = plain(f["flexure_sd"] / MINUTE, 3), plain(f["flexure_time"], 3)
        parts.append(f"bends by {size} arcmin over {time} s")
    if f["wander"] > 0:
        parts.append("wanders")
    return ", ".join(parts) or "rigid"


# -- the motion ------------------------------------------------------------------------------


def changes(result: Result) -> Times:
    """Return when a manoeuvre begins or ends [s]; nothing where there are too many."""
    some = table_of(result, "stretches")
    if some is None or len(some["start"]) > MOST:
        return []
    return [float(t) for t in some["start"][1:]]


def families(result: Result) -> list[chart.Family]:
    """Return the coefficients in groups of one kind."""
    out = []
    for group, (words, unit) in GROUPS.items():
        some = [
            c for c in result.coefficients.layout.coefficients if c.name.startswith(f"{group}.")
        ]
        if some:
            names = tuple(c.name for c in some)
            labels = tuple(n.rpartition(".")[2] for n in names)
            out.append(
                chart.Family(
                    words, names, labels, page.shown(unit), units.factor(unit, some[0].kind)
                )
            )
    return out


def motion(result: Result) -> page.Section | None:
    """What each manoeuvre has shown of every group of coefficients."""
    some, course = table_of(result, "stretches"), table_of(result, "estimates")
    if some is None or course is None:
        return None
    c, times = result.coefficients, changes(result)
    before = dict(zip(c.names, c.prior_sd, strict=True))
    groups = [f for f in families(result) if all(0 < before[m] < np.inf for m in f.members)]
    path = table_of(result, "smoothed")
    mapped = _map(path) if path is not None and len(path["time"]) > 1 else None
    left = {
        f.name: np.max([course[f"{m}_sd"] / before[m] for m in f.members], axis=0) for f in groups
    }
    known = chart.draw(
        "transfer.motion",
        chart.lines(course["time"], left, COURSE),
        x=TIME,
        shapes=chart.marked(times),
        share=62 if mapped else 100,
    )
    key, n = "transfer.motion", len(some["start"])
    lead = page.said(f"{key}.lead", f"{key}.dotted" if n <= MOST else f"{key}.many", count=n)
    listed = [page.told(f"{key}.listed"), _stretches(some, groups, before)] if n <= MOST else None
    return page.section(key, known, mapped, listed, lead=lead)


def _course(
    name: str, time: FloatArray, y: FloatArray, colour: str = chart.FIRST, **more: Any
) -> chart.Trace:
    return chart.line(name, time, y, colour, f"{COURSE}|{name}", **more)


def _panel(title: str, name: str, time: FloatArray, y: FloatArray) -> chart.Panel:
    """Return a panel with one line, which the title names."""
    return chart.Panel(title, [_course(name, time, y, showlegend=False)])


def _stretches(
    some: Mapping[str, Any], groups: Sequence[chart.Family], before: Mapping[str, float]
) -> page.Table:
    def left(group: chart.Family) -> list[str]:
        sd = np.array([[before[m], *some[f"{m}_sd"]] for m in group.members], float)
        parts = np.exp(np.mean(np.diff(np.log(sd), axis=1), axis=0))
        return [f"{part:.2f}" if part > 0.095 else plain(float(part), 1) for part in parts]

    return page.table(
        ("manoeuvre", [_did(some, k) for k in range(len(some["start"]))]),
        ("from [s]: number", [f"{v:.0f}" for v in some["start"]]),
        ("to [s]: number aside", [f"{v:.0f}" for v in some["end"]]),
        *((f"{g.name}: number", left(g)) for g in groups),
    )


def _did(some: Mapping[str, Any], k: int) -> str:
    kind, turn = str(some["kind"][k]), float(np.degrees(some["turn"][k]))
    faster = float(some["speed"][k])
    if kind == "turning":
        return "turns to and fro" if turn < BACK else f"turns, net {turn:.0f}°"
    if kind == "accelerated":
        return f"{'faster' if faster > 0 else 'slower'} by {abs(faster):.1f} m/s"
    return "straight on"


def _map(path: Mapping[str, FloatArray]) -> page.Figure:
    lat, lon, time = path["latitude"], path["longitude"], path["time"]
    east, north, _ = displacement(lat[0], lon[0], 0.0, lat, lon, np.zeros_like(lat)).T
    at = [int(np.searchsorted(time, t)) for t in np.linspace(time[0], time[-1], 5)[1:-1]]
    marks = [(f"{time[i]:.0f} s", float(east[i]), float(north[i])) for i in at]
    way = ("slave", east, north, chart.FIRST, "solid")
    return chart.paths([way], [], marks, "East and north of the start.", share=38)


# -- estimates, with the delay and without ---------------------------------------------------


def estimates(result: Result) -> page.Section | None:
    """Estimates against time with two standard deviations."""
    some, times, key = table_of(result, "estimates"), changes(result), "transfer.estimates"
    if some is None:
        return None
    lead = page.said(f"{key}.lead", "transfer.motion.dotted" * bool(times))
    drawn = [_estimates([("", some, chart.FIRST, chart.BAND)], f, times) for f in families(result)]
    return page.section(key, drawn, lead=lead)


def _estimates(
    runs: Sequence[tuple[str, Mapping[str, Any], str, str]], family: chart.Family, times: Times
) -> page.Figure:
    """Draw coefficients of one kind along each run, with +-2 sd, one panel each.

    A run is its name, its table, its colour and that of its band.
    """
    panels = []
    for member, label in zip(family.members, family.labels, strict=True):
        courses = [
            (some["time"], some[member] / family.size, some[f"{member}_sd"] / family.size)
            for _, some, _, _ in runs
        ]
        reach = np.array([_reach(y, sd) for _, y, sd in courses])
        low, high = float(reach[:, 0].min()), float(reach[:, 1].max())
        data: list[chart.Trace] = []
        for (name, _, colour, shade), (x, y, sd) in zip(runs, courses, strict=True):
            edges = [np.clip(y + s * sd, low, high) for s in (-GUIDE, GUIDE)]
            data.append(chart.band("±2 sd", x, *edges, fillcolor=shade, showlegend=False))
            hover = f"%{{x:.1f}} s: %{{y:.4g}} ± %{{customdata:.2g}} {family.unit}|{name}"
            named: chart.Trace = {} if name else {"showlegend": False}
            data.append(
                chart.line(
                    name or label, x, y, colour, hover, customdata=chart.numbers(sd), **named
                )
            )
        panels.append(chart.Panel(label, data, {"range": [low, high], "nticks": 5}))
    n, more = len(panels), 20 if len(runs) > 1 else 0
    with_ = "" if not more else " with the delay and without it"
    alt = f"{family.name} along the run{with_ or ' with two standard deviations'}"
    return _panels(
        panels,
        80 + more + (95 if n > 1 else 150) * n,
        times,
        alt,
        up=more,
        notes=[chart.titled(f"<b>{family.name}</b> [{family.unit}]", 4 + more)],
        legend=True if more else None,
    )


def _panels(
    some: Sequence[chart.Panel], height: float, times: Times, alt: str, up: float = 0, **more: Any
) -> page.Figure:
    """Draw panels against time [s] with the changes of the motion, half as wide as the page."""
    look = {"share": 50, "top": 34 + up} | more
    return chart.stacked(
        "transfer.panels", some, height=height, x=TIME, shapes=chart.marked(times), alt=alt, **look
    )


def _reach(y: FloatArray, sd: FloatArray) -> tuple[float, float]:
    """Return the range of an axis: the first moments, when nothing is known, may leave it."""
    late = slice(int(LATE * len(y)), None)
    low = min(float(np.min((y - GUIDE * sd)[late])), float(y[-1] - RANGE * sd[-1]))
    high = max(float(np.max((y + GUIDE * sd)[late])), float(y[-1] + RANGE * sd[-1]))
    return low - 0.04 * (high - low), high + 0.04 * (high - low)


def ignored(result: Result) -> page.Section | None:
    """The estimates of the same run where messages are taken as if they held on arrival."""
    ours, other = table_of(result, "estimates"), table_of(result, "undelayed")
    if ours is None or other is None:
        return None
    runs = [
        ("delay ignored", other, chart.SECOND, "var(--second-band)"),
        ("with the delay", ours, chart.FIRST, chart.BAND),
    ]
    some, times = families(result), changes(result)
    drawn = [_estimates(runs, f, times) for f in some if f.name in COMPARED]
    rows = [(n, f) for f in some for n in f.members if n in other]
    a, sd, b, claimed = (
        [float(run[f"{n}{end}"][-1]) / f.size for n, f in rows]
        for run, end in ((ours, ""), (ours, "_sd"), (other, ""), (other, "_sd"))
    )
    off = [abs(y - x) / s for x, y, s in zip(a, b, claimed, strict=True)]
    listed = page.table(
        ("coefficient: name", [n for n, _ in rows]),
        ("unit: short", [f.unit for _, f in rows]),
        ("with the delay: number", [page.known_to(*v) for v in zip(a, sd, strict=True)]),
        ("± sd: number", [format_value(v, v) for v in sd]),
        ("ignored: number", [page.known_to(*v) for v in zip(b, claimed, strict=True)]),
        ("± its sd: number aside", [format_value(v, v) for v in claimed]),
        ("off by, in its sds: number aside", [f"{v:.1f}" for v in off]),
    )
    return page.section("transfer.ignored", drawn, listed)


def delay(result: Result) -> page.Section | None:
    """How late messages are by each method and in parts, and what that is worth in motion."""
    known, key, times = result.diagnostics["delay"], "transfer.delay", changes(result)
    ways = (
        {"the result: state of the filter": (known["used"], known["sd"])} if "sd" in known else {}
    )
    for name, words in (("likelihood", "likeliest"), ("rate_matching", "what both turned")):
        if known.get(name):
            ways[words] = (known[name]["value"], known[name]["sd"])
    found = [_milliseconds(*v) for v in ways.values()]
    methods = (
        page.table(
            ("method", ways),
            ("delay [ms]: number", [v for v, _ in found]),
            ("± sd [ms]: number", [sd for _, sd in found]),
        )
        if ways
        else None
    )
    gone, tried = table_of(result, "delayed"), table_of(result, "likelihood")
    fit, lead, drawn = known.get("likelihood"), "", []
    if gone is not None and known["used"] != 0:
        turned = np.degrees(gone["heading"])
        ways_ = {k: gone[f"velocity_{k}"] for k in ("east", "north")}
        lead = page.said(
            f"{key}.lead",
            used=plain(1e3 * known["used"], 4),
            turn=plain(float(np.nanmax(np.abs(turned))), 2),
            speed=plain(float(np.nanmax(np.hypot(*ways_.values()))), 2),
        )
        some = [_panel("heading [°]", "heading", gone["time"], turned)]
        some += [_panel(f"{k} [m/s]", f"velocity {k}", gone["time"], y) for k, y in ways_.items()]
        alt = "What the slave went on in heading and velocity while each message was under way"
        drawn.append(
            _panels(
                some,
                370,
                times,
                alt,
                caption=page.told(f"{key}.caption"),
                share=50 if tried is not None and fit else 100,
            )
        )
    if tried is not None and fit:
        drawn.append(_likelihood(tried, fit))
    parts = table_of(result, "delay_parts")
    listed = None
    if parts is not None and len(parts["start"]) > 1:
        cells = [
            _milliseconds(v, sd) if sd < UNSEEN else ("not seen", "")
            for v, sd in zip(parts["delay"], parts["delay_sd"], strict=True)
        ]
        listed = [
            page.told(f"{key}.parts"),
            page.table(
                ("from [s]: number", [f"{v:.0f}" for v in parts["start"]]),
                ("to [s]: number", [f"{v:.0f}" for v in parts["end"]]),
                ("delay [ms]: number", [v for v, _ in cells]),
                ("± sd [ms]: number", [sd for _, sd in cells]),
            ),
        ]
    return page.section(key, methods, _drift(known), drawn, listed, lead=lead)


def _drift(known: Mapping[str, Any]) -> str:
    match = known.get("rate_matching")
    if not match or not match["drift_sd"] > 0:
        return ""
    if match["drift"] == 0:
        return page.said("transfer.delay.steady", sd=plain(2e6 * match["drift_sd"], 2))
    sd = 1e6 * match["drift_sd"]
    value = page.unsigned(format_value(1e6 * match["drift"], sd))
    return page.said("transfer.delay.drifting", value=value, sd=format_value(sd, sd))


def _likelihood(tried: Mapping[str, Any], fit: Mapping[str, float]) -> page.Figure:
    """Draw by how much the likelihood of other delays is less than that of the best."""
    at, log_l = tried["delay"], tried["log_likelihood"]
    less, best, sd = log_l.max() - log_l, fit["value"], fit["sd"]
    away = np.geomspace(0.3 * sd, max(float(np.max(np.abs(at - best))), 3 * sd), 60)
    x = np.concatenate([best - away[::-1], best + away])
    pick = less > 0
    data = [
        chart.line(
            "parabola of the sd",
            1e3 * x,
            0.5 * ((x - best) / sd) ** 2,
            chart.SOFT,
            dash="dash",
            width=1.4,
        ),
        chart.dots("tried", 1e3 * at[pick], less[pick], hover="%{x:.3f} ms: %{y:.3g} less|"),
    ]
    low = float(np.log10(max(min(0.1, float(np.min(less[pick], initial=1.0))), 1e-3)))
    high = float(np.log10(np.max(less[pick], initial=10.0)))
    look = chart.log_axis("log-likelihood below the best", range=[low - 0.2, high + 0.3])
    return chart.draw("transfer.likelihood", data, y=look)


# -- the run ---------------------------------------------------------------------------------


def innovations(result: Result) -> page.Section | None:
    """What each message said beyond what was expected, and how it scatters."""
    some, times, key = table_of(result, "innovations"), changes(result), "transfer.innovations"
    if some is None or "nis" not in some:
        return None
    blocks: list[Any] = [_innovations(some, f, times) for f in _channels(result, some)]
    time, ratio, limits = grouped_nis(some)
    if len(time) > 1:
        top = 1.1 * max(limits[1], float(np.nanmax(ratio, initial=0.0)))
        blocks.append(page.said(f"{key}.nis", span=time[1] - time[0]))
        blocks.append(
            chart.draw(
                "transfer.innovations",
                [chart.dots("", time, ratio, hover="%{x:.1f} s: %{y:.3f}|", size=6)],
                x=TIME,
                y=chart.axis("NIS / number", range=[0, top]),
                lines=limits,
                shapes=chart.marked(times),
            )
        )
    scatter = "; ".join(
        f"{name} {s['ratio']:.3f} times as much as expected, allowed {s['low']:.3f} to "
        f"{s['high']:.3f}"
        for name, s in (result.diagnostics.get("innovations") or {}).items()
    )
    bounded = result.diagnostics["filter"]["gamma"] is not None
    lead = page.said(
        f"{key}.lead",
        f"{key}.together" * bool(scatter),
        f"{key}.bounded" * bounded,
        scatter=scatter,
    )
    return page.section(key, blocks, lead=lead)


def _channels(result: Result, some: Mapping[str, Any]) -> list[chart.Family]:
    vector = result.diagnostics["filter"]["attitude_form"] == "vector"
    names = WAYS if vector else ("heading", "pitch", "roll")
    about = "attitude, about" if vector else "attitude"
    out = []
    for words, names_, unit, size in (
        ("velocity", {f"velocity_{way}": way for way in WAYS}, "m/s", 1.0),
        (about, {f"attitude_{k}": name for k, name in enumerate(names, 1)}, "arcmin", MINUTE),
    ):
        used = {k: v for k, v in names_.items() if k in some}
        if used:
            out.append(chart.Family(words, tuple(used), tuple(used.values()), unit, size))
    return out


def _innovations(some: Mapping[str, Any], family: chart.Family, times: Times) -> page.Figure:
    """Draw innovations of one kind in their band of +-2 sd, one panel for each component."""
    time, panels = some["time"], []
    both = zip(family.of(some), family.of(some, "_sd"), family.labels, strict=True)
    for y, sd, label in both:
        pick = chosen(np.abs(y) > 3 * sd)
        edge = GUIDE * sd[pick]
        data = [chart.band("±2 sd", time[pick], -edge, edge, showlegend=False)]
        data.append(
            chart.dots(
                "",
                time[pick],
                y[pick],
                size=3,
                hover=f"%{{x:.1f}} s: %{{y:.3g}} {family.unit}|{label}",
            )
        )
        # The first message finds what was known beforehand, and would hide all others.
        top = 1.1 * max(3 * float(np.nanmedian(sd)), float(np.nanquantile(np.abs(y), 0.998)))
        panels.append(chart.Panel(label, data, {"range": [-top, top], "nticks": 5}))
    alt = f"Innovations, {family.name}, with two standard deviations, against time"
    notes = [chart.titled(f"<b>{family.name}</b> [{family.unit}]")]
    return _panels(panels, 80 + 100 * len(panels), times, alt, notes=notes)


def chosen(must: BoolArray) -> IntArray:
    """Return the rows that are drawn: an even choice, and those that must be."""
    step = max(1, -(-len(must) // DOTS))
    even = np.zeros(len(must), bool)
    even[::step] = True
    return np.flatnonzero(even | must)


def grouped_nis(some: Mapping[str, Any]) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Return times, means of the NIS over its number, and their limits.

    `some` (m,): the innovations.
    """
    used = [k for k in some if f"{k}_sd" in some]
    count = np.sum([np.isfinite(some[k]) for k in used], axis=0)
    nis, time = some["nis"], some["time"]
    seen = (count > 0) & np.isfinite(nis)
    nis, time, count = nis[seen], time[seen], count[seen]
    each = max(1, -(-len(nis) // GROUPED))
    n = len(nis) // each
    if n == 0:
        return np.empty(0), np.empty(0), (0.0, 0.0)
    square, number = (x[: n * each].reshape(n, each).sum(axis=1) for x in (nis, count))
    fewest = int(number.min())
    low, high = chi_square_limits(fewest, FALSE_ALARM, n)
    middle = time[: n * each].reshape(n, each).mean(axis=1)
    return middle, square / number, (low / fewest, high / fewest)


def bound(result: Result) -> page.Section | None:
    """How near the H-infinity filter comes to the end of its bound."""
    some = table_of(result, "gamma")
    if some is None:
        return None
    used, time = 1 - some["margin"], some["time"]
    worst = int(np.nanargmax(used))
    least = float(np.log10(max(1e-9, float(np.nanmin(used)))))
    figure = chart.draw(
        "transfer.bound",
        [_course("part of γ²", time, used)],
        x=TIME,
        y=chart.log_axis("part of γ² used", range=[least - 0.2, 0.3]),
        shapes=[chart.level(1.0, colour=chart.BAD), *chart.marked(changes(result))],
    )
    gamma = plain(result.diagnostics["filter"]["gamma"], 4)
    return page.section(
        "transfer.bound",
        figure,
        gamma=gamma,
        most=plain(float(used[worst]), 2),
        when=plain(float(time[worst]), 4),
    )


def attitude(result: Result) -> page.Section | None:
    """Heading, pitch and roll of the slave as seen from the end, with sd."""
    some, times = table_of(result, "smoothed"), changes(result)
    if some is None:
        return None
    time, heading = some["time"], np.degrees(np.unwrap(some["heading"]))
    heading -= 360 * np.floor(heading[0] / 360)
    level_ = chart.lines(time, {n: np.degrees(some[n]) for n in ("pitch", "roll")}, COURSE)
    angles = [
        _panel("heading [°]", "heading", time, heading),
        chart.Panel("pitch, roll [°]", level_),
    ]
    sds = [some[f"phi_{way}_sd"] / MINUTE for way in WAYS]
    about = chart.lines(time, {f"about {w}": sd for w, sd in zip(WAYS, sds, strict=True)}, COURSE)
    middle = [float(np.median(sd)) for sd in sds]
    return page.section(
        "transfer.attitude",
        _panels(angles, 330, times, "Heading, pitch and roll of the slave against time"),
        _panels(
            [chart.Panel("sd [arcmin]", about, {"rangemode": "tozero"})],
            330,
            times,
            "Standard deviations of the attitude against time",
        ),
        level=plain(max(middle[:2]), 2),
        up=plain(middle[2], 2),
    )


def mounting(result: Result) -> page.Section | None:
    """How the slave is turned on its master, and how that is used."""
    known = result.diagnostics["mounting"]
    cells = [
        [page.unsigned(f"{np.degrees(x):.4f}") for x in known[k]] for k in ("nominal", "angles")
    ]
    angles = page.table(
        ("of the slave on its master", ("heading", "pitch", "roll")),
        ("nominal [°]: number", cells[0]),
        ("found [°]: number", cells[1]),
    )
    matrix = "\n".join(f"    [{', '.join(f'{x:.9f}' for x in row)}]," for row in known["C_ms"])
    code = (
        f"C_ms = np.array([  # x_m = C_ms @ x_s\n{matrix}\n])\n"
        "C_ns = C_nm @ C_ms    # attitude of the slave from that of its master, and\n"
        "C_nm = C_ns @ C_ms.T  # the other way: f_m = C_ms @ f_s, w_m = C_ms @ w_s"
    )
    arm = ", ".join(page.unsigned(plain(x, 4)) for x in known["lever_arm"])
    return page.section("transfer.mounting", angles, page.Code(code), arm=arm)


def handed(result: Result) -> page.Section | None:
    """The state in which the slave goes on alone."""
    state = result.diagnostics["hand_over"]
    sd = np.sqrt(np.diag(np.array(state["covariance"], float)))
    level_, up = float(np.max(sd[:2])) / MINUTE, float(sd[2]) / MINUTE
    rows = [
        [k, page.unsigned(f"{np.degrees(state[k]):.7f}"), "°", ""]
        for k in ("latitude", "longitude")
    ]
    rows.append(["height", page.unsigned(f"{state['height']:.2f}"), "m", ""])
    for way, v, s in zip(WAYS, state["velocity"], sd[3:], strict=True):
        rows.append(
            [f"velocity {way}", page.unsigned(format_value(v, s)), "m/s", format_value(s, s)]
        )
    for name, s in (("heading", up), ("pitch", level_), ("roll", level_)):
        degrees = page.unsigned(f"{np.degrees(state[name]):.4f}")
        rows.append([name, degrees, "°", f"{format_value(s, s)} arcmin"])
    heads = page.columns("quantity | value: number | unit: short | ± sd: number")
    at, key = float(state["time"]) - started(result), "transfer.handed"
    speed = float(np.sqrt(np.mean(sd[3:6] ** 2)))
    angles = " ".join(
        f"--{n} '{np.degrees(state[n]):.5f} deg'" for n in ("heading", "pitch", "roll")
    )
    code = (
        f"foucault navigate LOG --reference REFERENCE --calibration result.json \\\n"
        f"    --from '{plain(at, 9)} s' {angles} \\\n"
        f"    --heading-sd '{format_value(up, up)} arcmin' "
        f"--level-sd '{format_value(level_, level_)} arcmin' \\\n"
        f"    --velocity '{', '.join(f'{v:.4f} m/s' for v in state['velocity'])}' "
        f"--velocity-sd '{format_value(speed, speed)} m/s' -o navigation"
    )
    place = page.told(f"{key}.{state.get('place', 'master')}")
    return page.section(
        key,
        page.Table(heads, rows),
        page.told(f"{key}.more"),
        page.Code(code),
        at=plain(at, 6),
        place=place,
    )
