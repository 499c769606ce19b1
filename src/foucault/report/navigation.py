"""The page of a navigation: where it went, how far off, and what the calibration is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.diagnose.navigation import circular_error
from foucault.diagnose.schuler import TERMS
from foucault.report import chart, page
from foucault.result import Level
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.run_folder import Record

ELLIPSES = 4  # Error ellipses on the map of a path [1].
TINY = 0.001  # Numbers of a smaller size are not written out [any].
DRAWN = 14  # Coefficients that are drawn [1].

TICKS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 180, 240, 360, 720, 1440)
"""Ages that may be marked on a path [min]."""

ROUND = tuple(m * 10.0**k for k in range(-4, 5) for m in (1, 2, 5))
"""Where a logarithmic axis of time has ticks [any]."""

METHODS = {
    "inertial_frame": "inertial frame",
    "two_vector": "two vectors",
    "kalman": "Kalman, zero velocity",
    "given": "given",
    "level and given heading": "levelled at rest, heading given",
}
"""Method of alignment -> words."""

UNIT = {"velocity": "mm/s", "angle": "arcsec", "angular rate": "deg/h"}
"""Unit of each kind of term."""

ACTS = {
    "velocity": "oscillates with the Schuler period",
    "tilt": "oscillates with the Schuler period, always to one side",
    "drift about east": "grows with time, and oscillates",
    "drift about north": "grows with time, and oscillates",
    "drift about up": "grows with the square of time",
}
"""How each term shows in position."""

SOURCES = {
    "coefficients": ("calibration", "what is left of all coefficients together, correlated"),
    "alignment": ("alignment", "sensor noise during the rest, and the attitude that was given"),
    "noise": ("sensor noise", "white noise of gyros and accelerometers after the rest"),
    "all": ("all together", ""),
}
"""Source of the predicted error -> name, and what it is."""

NOISES = {"gyro": "angle random walk", "accel": "velocity random walk"}
"""Kind of the white noise of each sensor."""

LOOKS = ((chart.FIRST, ""), (chart.SECOND, "without_"))
"""Colour of each run, and how the columns of its errors begin."""


class Seen:
    """A record with what the page needs of it at hand."""

    def __init__(self, record: Record) -> None:
        self.about = record.about
        self.tables = record.tables

    @cached_property
    def names(self) -> list[str]:
        """Names of the runs that have a path."""
        some = ["trajectory", "trajectory_without"]
        runs = zip(self.about["runs"], some, strict=False)
        return [r["name"] for r, t in runs if t in self.tables]

    @property
    def still(self) -> bool:
        """Whether it stood at a known site."""
        return bool((self.about["reference"] or {}).get("still"))

    @property
    def errors(self) -> Mapping[str, Any] | None:
        """Table of the errors, where there are any."""
        return self.tables.get("errors")

    @property
    def calibrated(self) -> bool:
        """Whether the errors of the sensors are in what was predicted."""
        return bool(self.about["calibration"])

    @property
    def predicted(self) -> str:
        """What the predicted error is to be called."""
        return "predicted" if self.calibrated else "noise and alignment alone"

    @property
    def by_what(self) -> str:
        """What is predicted, or by what."""
        return "as predicted" if self.calibrated else "by noise and alignment alone"

    def path(self, run: int) -> Mapping[str, Any]:
        """Return the trajectory of a run."""
        return self.tables[("trajectory", "trajectory_without")[run]]

    def growth(self, run: int) -> Sequence[Mapping[str, Any]]:
        """Return the errors of a run at some ages; empty where there are none."""
        runs = self.about["runs"]
        return runs[run]["growth"] if run < len(runs) else []

    def end(self, run: int) -> Mapping[str, Any] | None:
        """Return the errors of a run at its end, where they are known."""
        rows = self.growth(run)
        return rows[-1] if rows and rows[-1]["horizontal"] is not None else None

    def of_runs(self, errors: Mapping[str, Any]) -> list[tuple[str, FloatArray, FloatArray, str]]:
        """Return name, east and north error and colour of every run, that of interest last."""
        return [
            (name, errors[f"{before}east"], errors[f"{before}north"], colour)
            for name, (colour, before) in zip(self.names, LOOKS, strict=False)
            if f"{before}east" in errors
        ][::-1]


def document(record: Record) -> page.Document:
    """Return what there is to say of a navigation."""
    seen = Seen(record)
    about = record.about
    return page.Document.of(
        _heading(seen),
        [make(seen) for make in (where, growth, terms, worth, sources, motion, start)],
        page.findings(page.grouped(about["findings"])),
        page.checks(about["checks"]),
        known(seen),
        page.made_from(about, {"input": "log", "calibration": "", "reference": ""}),
    )


def _heading(seen: Seen) -> page.Heading:
    about = seen.about
    title = f"Navigated for {minutes(about['duration'])}"
    if end := seen.end(0):
        title = f"{metres(end['horizontal'])} off after {minutes(end['age'])}"
        if other := seen.end(1):
            title += f", {metres(other['horizontal'])} without calibration"
    level = Level(about["verdict"])
    reasons = list(about["reasons"]) or in_words(seen)
    return page.Heading(title, page.origin(about), page.STATES[level], page.WORDS[level], reasons)


def in_words(seen: Seen) -> list[str]:
    """Say in a sentence or two what was found."""
    out = []
    rate, end = seen.about["runs"][0].get("radial_rate"), seen.about["predicted"]["all"]
    if rate and rate["nmi/h"] is not None:
        out.append(f"Radial error over time: {plain(rate['nmi/h'], 3)} nmi/h (root mean square).")
    if len(seen.about["checks"]) > 1:
        out.append(f"All {len(seen.about['checks'])} checks passed.")
    if seen.about["reference"] is None:
        out.append("Nothing was compared: there is no reference.")
    if not seen.calibrated:
        out.append("Nothing is known of the errors of the sensors: there is no calibration.")
    elif end["cep"]:
        age = minutes(seen.about["predicted"]["age"])
        out.append(f"Half of all such runs end within {metres(end['cep'])} after {age}.")
    return out


def metres(value: float) -> str:
    """Write a distance [m] for people."""
    unit, one = chart.length_unit(abs(value))
    return f"{plain(value / one, 3)} {unit}"


def minutes(seconds: float) -> str:
    """Write a time [s] for people."""
    unit, one = chart.time_unit(seconds * (1 + 1e-6) if seconds >= 60 else 0.0)
    if 60 <= seconds <= 300:
        unit, one = "min", 60.0
    return f"{plain(seconds / one, 3)} {unit}"


def number(value: float | None) -> str:
    """Write a number to three digits, empty where there is none."""
    if value is None or not math.isfinite(value):
        return ""
    return f"< {TINY}" if 0 < abs(value) < TINY else page.minus(plain(value, 3))


# -- where it went ---------------------------------------------------------------------------


def where(seen: Seen) -> page.Section | None:
    """Paths east and north of the start, with the error ellipse at some times."""
    lines: list[tuple[str, FloatArray, FloatArray, str, str]] = []
    moved, e = not seen.still, seen.errors
    if moved and e is not None and "reference_east" in e:
        lines.append(("reference", e["reference_east"], e["reference_north"], chart.THIRD, "solid"))
    for k in reversed(range(len(seen.names))):
        path = seen.path(k)
        dash = "dot" if moved and e is not None else "solid"
        lines.append((seen.names[k], path["east"], path["north"], LOOKS[k][0], dash))
    key = "navigation.where"
    caption = page.said(f"{key}.moved" if moved else f"{key}.still", by_what=seen.by_what)
    centres = _spread(seen, ELLIPSES) if moved else _spread(seen, 1, about_path=False)
    marks = _marks(seen.path(0)) if moved else []  # else time stands beside it
    beside = []
    if e is not None and np.isfinite(e["east"]).any():
        beside = [_error_map(seen, e) if moved else _over_time(seen, e)]
    share = 50 if beside else 100
    map_ = chart.paths(lines, centres, marks, caption, share, predicted=seen.predicted)
    lead = page.said(f"{key}.beside" if moved and e is not None else f"{key}.lead")
    return page.section(key, map_, beside, page.Facts(_numbers(seen)), lead=lead)


def _error_map(seen: Seen, e: Mapping[str, Any]) -> page.Figure:
    """Error east and north, with the ellipses that were predicted."""
    lines = [(*run, "solid") for run in seen.of_runs(e)]
    caption = page.said("navigation.where.error", by_what=seen.by_what)
    centres = _spread(seen, 1, about_path=False)
    return chart.paths(lines, centres, [], caption, 50, "error ", seen.predicted)


def _spread(
    seen: Seen, count: int, about_path: bool = True
) -> list[tuple[float, float, FloatArray]]:
    """Return centre and covariance of the predicted error at some ages."""
    b = seen.tables["budget"]
    rows = np.linspace(0, len(b["time"]) - 1, count + 1).round().astype(int)[1:]
    path, cov = seen.path(0), _covariance(b)
    out = []
    for i in rows:
        at = [
            float(np.interp(b["time"][i], path["time"], path[c])) if about_path else 0.0
            for c in ("east", "north")
        ]
        out.append((at[0], at[1], cov[i]))
    return out


def _covariance(some: Mapping[str, Any]) -> FloatArray:
    """Return the predicted covariance of the horizontal position, shape (n, 2, 2) [m^2]."""
    ways = (("east_east", "east_north"), ("east_north", "north_north"))
    return np.moveaxis(np.array([[some[f"cov_{w}"] for w in row] for row in ways]), -1, 0)


def _marks(path: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """Return ages to mark on the path, some five of them."""
    age = path["time"] - path["time"][0]
    step = next((60 * t for t in TICKS if age[-1] / (60 * t) <= 6), 86400)
    at = np.arange(step, age[-1], step)
    east, north = (np.interp(at, age, path[c]) for c in ("east", "north"))
    reach = max(float(np.ptp(path["east"])), float(np.ptp(path["north"])), 1e-9)
    out: list[tuple[str, float, float]] = []
    for t, e, n in zip(at, east, north, strict=True):
        if all(math.hypot(e - x, n - y) > 0.12 * reach for _, x, y in [*out, ("", 0.0, 0.0)]):
            out.append((minutes(float(t)), float(e), float(n)))
    return out


def _numbers(seen: Seen) -> list[tuple[str, str]]:
    """Return what the map does not say in numbers."""
    about, end = seen.about, seen.about["predicted"]["all"]
    out = [("navigated for", minutes(about["duration"]))]
    for k, run in enumerate(about["runs"]):
        if last := seen.end(k):
            east, north = metres(run["end"]["east"]), metres(run["end"]["north"])
            text = f"{metres(last['horizontal'])} ({east} east, {north} north)"
            out.append((f"at the end, {run['name']}", page.minus(text)))
    for run in about["runs"]:
        rate = run.get("radial_rate")
        if rate and rate["nmi/h"] is not None:
            text = f"{plain(rate['nmi/h'], 3)} nmi/h, {plain(rate['m/s'] * 3600, 3)} m/h"
            out.append((f"radial error over time, {run['name']}", text))
    if end["cep"]:
        out.append((f"{seen.predicted}, half of all runs end within", metres(end["cep"])))
        text = f"{metres(end['east_sd'])} east, {metres(end['north_sd'])} north"
        out.append((f"{seen.predicted}, sd at the end", text))
    vertical = str(about["settings"]["vertical"])
    return [*out, ("vertical channel", "height held" if vertical == "held" else vertical)]


# -- growth of the error ---------------------------------------------------------------------


def half_at(seen: Seen, age: float) -> float | None:
    """Return the radius that holds half of all errors, as predicted, at an age [s]."""
    e = seen.errors
    return None if e is None else float(np.interp(age, e["age"], circular_error(_covariance(e))))


def growth(seen: Seen) -> page.Section | None:
    """The error against time, with and without the calibration, beside what was predicted."""
    e = seen.errors
    if e is None:
        return None
    drawn = []
    if np.isfinite(e["east"]).any() and not seen.still:  # else it stands beside the map
        drawn = [_over_time(seen, e), _logarithmic(seen, e)]
    key = "navigation.growth"
    lead = page.said(f"{key}.lead" if seen.calibrated else f"{key}.bare")
    return page.section(key, drawn, _panels(seen, e), _growth_table(seen), lead=lead)


def _over_time(seen: Seen, e: Mapping[str, Any]) -> page.Figure:
    """Horizontal error against time, with the radius that holds half of it."""
    t_unit, t = chart.time_unit(float(e["age"][-1]))
    half, runs = circular_error(_covariance(e)), seen.of_runs(e)
    sizes = [np.hypot(east, north) for _, east, north, _ in runs]
    unit, one = chart.length_unit(chart.largest(*sizes, half))
    hover = f"%{{x:.3g}} {t_unit}: %{{y:.4g}} {unit}|"
    data = [
        chart.line(
            f"{seen.predicted}, half of all runs",
            e["age"] / t,
            half / one,
            chart.SOFT,
            f"{hover}{seen.predicted}",
            width=1.6,
            dash="dash",
        )
    ]
    data += [
        chart.line(name, e["age"] / t, y / one, colour, f"{hover}{name}", width=2.2)
        for (name, _, _, colour), y in zip(runs, sizes, strict=True)
    ]
    return chart.draw(
        "navigation.over_time",
        data,
        x=f"since the start [{t_unit}]",
        y=chart.axis(f"horizontal error [{unit}]", rangemode="tozero"),
    )


def _logarithmic(seen: Seen, e: Mapping[str, Any]) -> page.Figure:
    """The same on logarithmic axes; a slope of 1 is a drift, 2 a tilt, 3 a gyro bias."""
    late = e["age"] > 0.005 * e["age"][-1]
    age, half = e["age"][late], circular_error(_covariance(e))[late]
    t_unit, t = chart.time_unit(float(e["age"][-1]))
    sizes = [(run, np.hypot(run[1], run[2])[late]) for run in seen.of_runs(e)]
    data = [
        chart.line(
            seen.predicted, age / t, half, chart.SOFT, width=1.6, dash="dash", showlegend=False
        )
    ]
    data += [
        chart.line(
            run[0],
            age / t,
            np.maximum(y, 1e-9),
            run[3],
            f"%{{y:.4g}} m|{run[0]}",
            width=2.2,
            showlegend=False,
        )
        for run, y in sizes
    ]
    top = max(float(np.nanmax(y, initial=1e-3)) for y in (*(y for _, y in sizes), half))
    low = float(np.nanmin([np.nanpercentile(y, 1) for _, y in sizes] or [top]))
    low = max(low, 1e-5 * top)
    span = [float(np.log10(v / t)) for v in (age[0], age[-1])]
    return chart.draw(
        "navigation.logarithmic",
        data,
        x=chart.axis(f"since the start [{t_unit}]", type="log", tickvals=list(ROUND), range=span),
        y=chart.log_axis(
            "horizontal error [m]", range=[float(np.log10(low)) - 0.1, float(np.log10(top)) + 0.2]
        ),
    )


def _panels(seen: Seen, e: Mapping[str, Any]) -> page.Figure | None:
    """East, north, up, velocity and heading errors with the bands of one and two sd."""
    position = {"east": "east_east", "north": "north_north"}
    position |= {"up": "up_up"} if seen.about["settings"]["vertical"] == "free" else {}
    bands = [2 * np.sqrt(e[f"cov_{c}"]) for c in position.values()]
    unit, one = chart.length_unit(chart.largest(*(e[a] for a in position), *bands))
    rows = [(f"{a} [{unit}]", a, c, one) for a, c in position.items()]
    rows += [(f"v {a} [m/s]", f"velocity_{a}", f"velocity_{a}", 1.0) for a in ("east", "north")]
    rows += [("heading [°]", "heading", "phi_up", float(np.radians(1.0)))]
    t_unit, t = chart.time_unit(float(e["age"][-1]))
    x = e["age"] / t
    panels = []
    for title, name, variance, size_ in rows:
        if not np.isfinite(e[name]).any():
            continue
        sd = np.sqrt(e[f"cov_{variance}"]) / size_
        data = [
            chart.band(f"±2 sd, {seen.predicted}", x, -2 * sd, 2 * sd),
            chart.band("±1 sd", x, -sd, sd),
        ]
        if f"without_{name}" in e:
            other = "without calibration"
            data.append(
                chart.line(
                    other,
                    x,
                    e[f"without_{name}"] / size_,
                    chart.SECOND,
                    f"%{{y:.4g}}|{other}",
                    width=1.6,
                )
            )
        hover = f"%{{y:.4g}}|{title}"
        data.append(chart.line(seen.names[0], x, e[name] / size_, chart.FIRST, hover, width=2.2))
        panels.append(chart.Panel(title, data, lines=[0]))
    if not panels:
        return None
    return chart.stacked(
        "navigation.panels", panels, height=70 + 150 * len(panels), x=f"since the start [{t_unit}]"
    )


def _growth_table(seen: Seen) -> page.Table:
    """Errors at some ages; a column of what is not known is left out."""
    ages = [row["age"] for row in seen.growth(0)]

    def cells(run: int, key: str, one: float = 1.0) -> list[str]:
        rows = {row["age"]: row[key] for row in seen.growth(run)}
        values = [rows.get(age) for age in ages]
        return [number(None if v is None else one * v) for v in values]

    free = seen.about["settings"]["vertical"] == "free"
    columns = [
        ("after: short", [minutes(age) for age in ages]),
        ("horizontal [m]: number", cells(0, "horizontal")),
        ("without calibration [m]: number", cells(1, "horizontal")),
        (
            f"{seen.predicted}, half of all runs [m]: number",
            [number(half_at(seen, age)) for age in ages],
        ),
        ("vertical [m]: number aside", cells(0, "vertical") if free else []),
        ("velocity [m/s]: number", cells(0, "velocity")),
        ("heading [arcmin]: number aside", cells(0, "heading", 60 * float(np.degrees(1.0)))),
    ]
    return page.table(*((heading, some) for heading, some in columns if any(some)))


# -- what the error is made of ---------------------------------------------------------------


def terms(seen: Seen) -> page.Section | None:
    """Terms of free inertial drift that the error shows."""
    run, key = seen.about["runs"][0], "navigation.terms"
    if "terms" not in run:
        if seen.errors is None or not seen.still:
            return None
        why = page.said(f"{key}.not_fitted", why=seen.about["stationary"])
        return page.Section(page.said(f"{key}.title"), why, [])
    some, told = seen.tables["terms"], run["terms"]
    alike = (
        page.Items([("plain", page.minus(text)) for text in told["alike"]])
        if told["alike"]
        else None
    )
    times = plain(told["chi_square"] / told["dof"], 3)
    more = page.said(f"{key}.more", times=times) if told["chi_square"] > told["limits"][1] else ""
    period, age = told["schuler_period"], float(some["age"][-1])
    short = page.said(f"{key}.short", age=minutes(age)) if age < 0.5 * period else ""
    drawn = [_terms(some, way) for way in ("east", "north")]
    return page.section(
        key, drawn, _term_table(seen), alike, more, period=plain(period / 60, 3), short=short
    )


def _terms(some: Mapping[str, Any], way: str) -> page.Figure:
    """Draw the error along one axis, the terms of at least a fiftieth of it, and their sum."""
    parts = {term: some[f"{term}.{way}"] for term in TERMS}
    t_unit, t = chart.time_unit(float(some["age"][-1]))
    largest = chart.largest(some[way], *parts.values())
    sum_, noise = np.sum(list(parts.values()), axis=0), 2 * some[f"noise.{way}"]
    unit, one = chart.length_unit(max(largest, chart.largest(np.abs(sum_) + noise)))
    x, y, total, reach = some["age"] / t, some[way] / one, sum_ / one, noise / one
    hover = f"%{{x:.3g}} {t_unit}: %{{y:.4g}} {unit}|error"
    data: list[chart.Trace] = [
        chart.band("sensor noise, ±2 sd", x, total - reach, total + reach),
        chart.dots("error", x, y, chart.FIRST, hover, size=5),
        chart.line("all terms", x, total, chart.INK, width=1.4),
    ]
    for (name, part), colour in zip(
        parts.items(), (*chart.SERIES[1:], *chart.SERIES[1:3]), strict=True
    ):
        if np.max(np.abs(part)) >= 0.02 * largest:
            data.append(
                chart.line(
                    name, x, part / one, colour, f"%{{y:.4g}} {unit}|{name}", width=1.6, dash="dot"
                )
            )
    return chart.draw(
        "navigation.terms",
        data,
        x=f"since the start [{t_unit}]",
        y=f"error {way} [{unit}]",
        alt=f"Position error error {way} with the terms of free inertial drift",
    )


def _term_table(seen: Seen) -> page.Table:
    both = [run["terms"]["rows"] for run in seen.about["runs"] if "terms" in run]
    rows = both[0]
    unit = [UNIT[r["kind"]] for r in rows]

    def of(some: Sequence[Mapping[str, Any]], key: str) -> list[float]:
        return [units.convert(r[key], r["kind"], u) for r, u in zip(some, unit, strict=True)]

    def like(row: Mapping[str, Any]) -> str:
        if abs(row["value"]) > 2 * row["sd"] and row["same_as"]:
            return page.minus(row["same_as"])
        return next(words for begin, words in ACTS.items() if row["name"].startswith(begin))

    sd = of(rows, "sd")
    values = [[page.known_to(*v) for v in zip(of(some, "value"), sd, strict=True)] for some in both]
    return page.table(
        ("term", [r["name"] for r in rows]),
        ("value: number", values[0]),
        ("± sd: number", [page.known_to(v, v) for v in sd]),
        ("without calibration: number", values[1] if len(both) > 1 else None),
        ("unit: short", map(page.shown, unit)),
        ("east at the end [m]: number aside", [number(r["east"]) for r in rows]),
        ("north [m]: number aside", [number(r["north"]) for r in rows]),
        ("looks like", map(like, rows)),
    )


def worth(seen: Seen) -> page.Section | None:
    """What each coefficient was worth, and what is left of it."""
    rows = seen.about["contributions"]
    if not rows:
        return None
    together, total = "", seen.about["difference"]
    if total is not None:
        parts = [sum(r["worth"][a] for r in rows) for a in ("east", "north")]
        miss = math.hypot(parts[0] - total[0], parts[1] - total[1])
        apart = "navigation.worth.apart" if miss > 0.1 * math.hypot(*total) else ""
        together = page.minus(
            page.said(
                "navigation.worth.together",
                apart,
                parts=[*map(metres, parts)],
                total=[*map(metres, total)],
            )
        )
    return page.section(
        "navigation.worth", _contributions(rows[:DRAWN]), _worth_table(rows), together
    )


def _contributions(rows: Sequence[Mapping[str, Any]]) -> page.Figure:
    """Draw metres at the end by coefficient: before it was corrected, and what is left (sd)."""
    names = [r["name"] for r in rows]
    before, left = (
        np.array([r[k]["horizontal"] or 0.0 for r in rows], float) for k in ("worth", "left")
    )
    unit, one = chart.length_unit(chart.largest(before, left))
    data = [
        chart.bars(
            name, some / one, names, colour, f"%{{y}}: %{{x:.3g}} {unit}|{name}", orientation="h"
        )
        for name, some, colour in (
            ("before correction", before, chart.SECOND),
            ("left, sd", left, chart.FIRST),
        )
    ]
    values = np.concatenate([before, left]) / one
    values = values[np.isfinite(values) & (values > 0)]
    high = float(values.max(initial=1.0))
    low = max(float(values.min(initial=np.inf)), high * 1e-4)
    span = [float(np.log10(low)) - 0.2, float(np.log10(high)) + 0.2]
    look = {"type": "category", "autorange": "reversed", "tickmode": "linear", "ticks": ""}
    return chart.draw(
        "navigation.contributions",
        data,
        height=96 + 30 * len(names),
        x=chart.log_axis(f"horizontal position at the end [{unit}]", range=span),
        y=look,
    )


def _worth_table(rows: Sequence[Mapping[str, Any]]) -> page.Table:
    unit = [page.unit_of(r["kind"], abs(r["value"])) for r in rows]
    value = [r["value"] / one for r, (_, one) in zip(rows, unit, strict=True)]
    sd = [(r["sd"] or 0.0) / one for r, (_, one) in zip(rows, unit, strict=True)]
    both = zip(value, sd, strict=True)
    turn = [
        None if r["worth"]["heading"] is None else 3600 * np.degrees(r["worth"]["heading"])
        for r in rows
    ]
    return page.table(
        ("coefficient: name", [r["name"] for r in rows]),
        ("value: number", [page.known_to(v, s) if s else page.minus(f"{v:.4g}") for v, s in both]),
        ("± sd: number", map(page.size, sd)),
        ("unit: short", [name for name, _ in unit]),
        ("east [m]: number aside", [number(r["worth"]["east"]) for r in rows]),
        ("north [m]: number aside", [number(r["worth"]["north"]) for r in rows]),
        ("horizontal [m]: number", [number(r["worth"]["horizontal"]) for r in rows]),
        ("heading [arcsec]: number aside", map(number, turn)),
        (
            "left [m]: number",
            [number(r["left"]["horizontal"]) if r["sd"] is not None else "" for r in rows],
        ),
    )


def sources(seen: Seen) -> page.Section | None:
    """Where the predicted error comes from."""
    end, key = seen.about["predicted"], "navigation.sources"

    def variance(source: str) -> float:
        return float(sum(end[source][f"{a}_sd"] ** 2 for a in ("east", "north")))

    used = [k for k in SOURCES if k != "coefficients" or seen.calibrated]
    whole = variance("all")
    parts = [variance(k) / whole if whole else 0.0 for k in used]
    listed = page.table(
        ("source", [SOURCES[k][0] for k in used]),
        ("east sd [m]: number", [number(end[k]["east_sd"]) for k in used]),
        ("north sd [m]: number", [number(end[k]["north_sd"]) for k in used]),
        ("half of all runs [m]: number", [number(end[k]["cep"]) for k in used]),
        ("share: number", [f"{100 * part:.1f} %" for part in parts]),
        (
            "heading sd [arcsec]: number aside",
            [number(3600 * float(np.degrees(end[k]["heading_sd"]))) for k in used],
        ),
        ("what it is: aside", [SOURCES[k][1] for k in used]),
    )
    lead = page.said(f"{key}.lead" if seen.calibrated else f"{key}.bare", age=minutes(end["age"]))
    return page.section(key, listed, lead=lead)


# -- motion, start, and what it was made from ------------------------------------------------


def motion(seen: Seen) -> page.Section | None:
    """Velocity, attitude and height of the path."""
    path, vertical = seen.path(0), seen.about["settings"]["vertical"]
    rows = chart.thinned(len(path["time"]))
    t_unit, t = chart.time_unit(float(path["time"][-1] - path["time"][0]))
    x = (path["time"] - path["time"][0])[rows] / t
    ways = ("east", "north", "up")[: 3 if vertical == "free" else 2]
    panels = {
        "velocity [m/s]": {a: path[f"velocity_{a}"] for a in ways},
        "heading [°]": {"heading": np.degrees(np.unwrap(path["heading"]))},
        "pitch, roll [°]": {a: np.degrees(path[a]) for a in ("pitch", "roll")},
    }
    if vertical != "held":
        panels["height [m]"] = {"height": path["height"]}
    alone: dict[str, Any] = {"showlegend": False}
    drawn = [
        chart.Panel(
            title,
            chart.lines(
                x,
                {name: np.asarray(y)[rows] for name, y in some.items()},
                "%{y:.5g}",
                width=1.6,
                **(alone if len(some) == 1 else {}),
            ),
        )
        for title, some in panels.items()
    ]
    figure = chart.stacked(
        "navigation.motion", drawn, height=70 + 150 * len(drawn), x=f"since the start [{t_unit}]"
    )
    return page.section("navigation.motion", figure, name=seen.names[0])


def start(seen: Seen) -> page.Section | None:
    """How each run was aligned."""
    runs = [run["start"] for run in seen.about["runs"]]
    sd = [np.degrees(np.sqrt(np.diag(np.array(s["covariance"], float)))) for s in runs]

    def degrees(name: str) -> list[str]:
        return [page.minus(f"{np.degrees(s[name]):.4f}") for s in runs]

    listed = page.table(
        ("run", [run["name"] for run in seen.about["runs"]]),
        ("heading [°]: number", degrees("heading")),
        ("± sd: number", [page.angle(s[2]) for s in sd]),
        ("pitch [°]: number", degrees("pitch")),
        ("roll [°]: number", degrees("roll")),
        ("± sd: number", [page.angle(float(np.hypot(s[0], s[1]) / math.sqrt(2))) for s in sd]),
        ("found by: aside", [METHODS.get(s["method"], s["method"]) for s in runs]),
    )
    opening, key = seen.about["opening"], "navigation.start"
    time = opening["end"] - opening["start"]
    calibrated = page.said(f"{key}.calibrated") if seen.calibrated else ""
    lead = page.said(
        f"{key}.at_rest" if time > 0 else "",
        f"{key}.lead",
        calibrated=calibrated,
        time=minutes(time) if time > 0 else "",
    )
    return page.section(key, listed, lead=lead)


def known(seen: Seen) -> page.Section | None:
    """Noise, place, reference and calibration."""
    about = seen.about
    noise, site, reference = about["noise"], about["site"], about["reference"]
    pairs = [("noise", str(noise["source"]))]
    pairs += [
        (f"white noise, {k}", page.quantity(noise[k]["white"], kind)) for k, kind in NOISES.items()
    ]
    pairs += [("place", page.place(site)), ("local gravity", page.gravity(site))]
    what = "nothing"
    if reference is not None:
        still = "the known site" if reference["still"] else ""
        what = still or str(reference.get("file", "reference"))
    pairs.append(("compared with", what))
    if used := about["calibration"]:
        text = f"{used['procedure']}, {used['verdict']}, {used['coefficients']} coefficients"
        pairs += [
            ("calibration", text),
            ("of instrument", page.instrument(used.get("instrument") or {})),
            ("made", page.date(str(used.get("created") or ""))),
        ]
    return page.section("navigation.known", page.facts(*pairs))
