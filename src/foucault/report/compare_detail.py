"""What a comparison shows of each instrument, and of several side by side. It computes nothing."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.coefficients import format_value
from foucault.report.compare_figures import in_sd, intervals, over_time
from foucault.report.page import Block, Column, Figure, Section, Table
from foucault.report.uncertainty import shown
from foucault.units import display_unit, factor, plain

About = Mapping[str, Any]

PAIRS = 45
"""Pairs in the table of a page; of more results only neighbours, and the first with the last."""

COURSES = {
    "steady": "steady", "change": "changed", "drift": "drifts", "step": "one step",
    "drift or step": "drifts, or one step", "scatter": "scatters",
}  # fmt: skip


def _kinds(about: About) -> dict[str, str]:
    return {c["name"]: c["kind"] for c in about["coefficients"]}


def _limits(about: About, name: str) -> tuple[float, float]:
    """Return the limits of the value and of a change; infinite where there are none."""
    row = next(c for c in about["coefficients"] if c["name"] == name)
    none = float("inf")
    limit, change = (none if row[k] is None else row[k] for k in ("limit", "change"))
    return limit, change


def changes(about: About, one: About, of: str) -> Section:
    """Return what changed from the first result to the last, and from each to the next."""
    c = one["compared"]
    first, last = 0, len(one["results"]) - 1
    ends = next(p for p in c["pairs"] if (p["first"], p["second"]) == (first, last))
    drifting = any(course["drift"] is not None for course in c["courses"]) and last > 1
    labels = [about["results"][i]["label"] for i in one["results"]]
    what = f"from {labels[first]} to {labels[last]}"
    z = np.array(ends["z"])
    blocks: list[Block] = [in_sd(c["names"], z, c["z_limit"], what)]
    if last > 1:
        each = [p for p in c["pairs"] if p["second"] == p["first"] + 1]
        no = [i + 1 for i in one["results"]]
        steps = [f"{no[p['first']]} → {no[p['second']]}" for p in each]
        blocks.append(intervals(c["names"], np.array([p["z"] for p in each]), c["z_limit"], steps))
    blocks.append(_change_table(about, c, ends, drifting))
    joint = "more than" if c["chi_square"] > c["limits"][1] else "no more than"
    lead = (
        f"First the change {what} over its standard deviation. All coefficients of all results "
        f"together differ by {joint} chance explains: chi-square {plain(c['chi_square'], 4)} of "
        f"{c['dof']} degrees of freedom, limit {plain(c['limits'][1], 4)}. One comparison in a "
        "hundred of an instrument that does not change is beyond a limit."
    )
    return Section(f"Changes{of}", lead, blocks)


def _change_table(about: About, c: About, ends: About, drifting: bool) -> Table:
    kinds = _kinds(about)
    sizes: dict[str, float] = {}
    for name, change, sd in zip(c["names"], ends["change"], ends["sd"], strict=True):
        family = name.rpartition(".")[0]
        sizes[family] = max(sizes.get(family, 0.0), abs(change), sd)
    rows = []
    for k, (name, course) in enumerate(zip(c["names"], c["courses"], strict=True)):
        unit, size = in_unit(kinds[name], sizes[name.rpartition(".")[0]])
        cells = ["warning" if course["how"] != "steady" else "good", name]
        cells += [_number(ends["change"][k] / size, ends["sd"][k] / size)]
        cells += [_size(ends["sd"][k] / size), _signed(f"{ends['z'][k]:+.1f}")]
        if drifting:
            cells.append(plus_minus(course["drift"] / size, course["drift_sd"] / size))
        rows.append([*cells, shown(unit), COURSES[course["how"]]])
    columns = [
        Column("", "state"), Column("coefficient", "name"), Column("change", "number"),
        Column("± sd", "number", aside=True), Column("in sd", "number", aside=True),
        *([Column("per year ± sd", "number", aside=True)] if drifting else []),
        Column("unit", "short"), Column("course", "short"),
    ]  # fmt: skip
    return Table(columns, rows)


def drawn(about: About, one: About, of: str) -> Section:
    """Return the coefficients of an instrument over time, a figure for each."""
    c, kinds = one["compared"], _kinds(about)
    values, sd = np.array(c["values"]), np.array(c["sd"])
    places = _places(about, one["results"])
    figures = [
        over_time(
            name, kinds[name], values[:, k], sd[:, k], places, _limits(about, name),
            c["courses"][k]["how"] != "steady", joined=True,
        )
        for k, name in enumerate(c["names"])
    ]  # fmt: skip
    title = "Result by result" if places == _numbers(one["results"]) else "Over time"
    return Section(f"{title}{of}", _drawn_lead(about, "a result"), figures)


def _drawn_lead(about: About, what: str) -> str:
    lead = f"Each coefficient with two standard deviations of {what}."
    if about["tolerance"] is not None:
        lead += (
            " Dashed: limit of the value. Shaded: as wide as the limit of a change; all results "
            "have to fit in. Limits far beyond the values are not drawn."
        )
    return lead


def pairs(about: About, one: About, of: str) -> Section | None:
    """Return every pair of results, from three of them on."""
    c, n = one["compared"], len(one["results"])
    if n < 3:
        return None
    listed = c["pairs"]
    few = len(listed) > PAIRS
    if few:
        kept = [p for p in listed if p["second"] == p["first"] + 1]
        listed = [*kept, next(p for p in listed if (p["first"], p["second"]) == (0, n - 1))]
    labels = [about["results"][i]["label"] for i in one["results"]]
    rows = []
    for p in listed:
        far = int(np.argmax(np.abs(p["z"])))
        beyond = p["chi_square"] > c["pair_limit"] or abs(p["z"][far]) > c["z_limit"]
        rows.append(
            [
                "warning" if beyond else "good", labels[p["first"]], labels[p["second"]],
                plain(p["chi_square"], 3),
                f"`{c['names'][far]}` ({_signed(format(p['z'][far], '+.1f'))} sd)",
                (f"`{p['alone']}`" if p["alone"] else "none alone") if beyond else "",
            ]
        )  # fmt: skip
    columns = [
        Column("", "state"), Column("from", "short"), Column("to", "short"),
        Column("chi-square", "number"), Column("largest change", aside=True),
        Column("explained by", "short"),
    ]  # fmt: skip
    lead = (
        f"Chi-square of all {len(c['names'])} coefficients together, limit "
        f"{plain(c['pair_limit'], 3)}; of one change {plain(c['z_limit'], 3)} sd. Both limits are "
        "shared by all pairs. Where they are passed: the coefficient whose change alone leaves "
        "nothing to explain. Correlations inside a result count, so that it may be clearer than "
        "it looks by itself."
    )
    lead += " Listed are neighbours, and the first with the last." if few else ""
    return Section(f"Each pair{of}", lead, [Table(columns, rows)])


# -- several instruments ---------------------------------------------------------------------


def side_by_side(about: About) -> Section:
    """Return how the instruments spread beside how well each is known."""
    b, kinds = about["between"], _kinds(about)
    sizes: dict[str, float] = {}
    for s in b["spreads"]:
        family = s["name"].rpartition(".")[0]
        sizes[family] = max(sizes.get(family, 0.0), s["spread"], s["sd"])
    rows = []
    for s in b["spreads"]:
        unit, size = in_unit(kinds[s["name"]], sizes[s["name"].rpartition(".")[0]])
        rows.append(
            [
                s["name"], _number(s["mean"] / size, s["spread"] / size / 10),
                _size(s["spread"] / size), _size(s["sd"] / size),
                _number(s["lowest"] / size, s["sd"] / size),
                _number(s["highest"] / size, s["sd"] / size), shown(unit),
                "yes" if s["told_apart"] else "no",
            ]
        )  # fmt: skip
    columns = [
        Column("coefficient", "name"), Column("mean", "number"), Column("spread", "number"),
        Column("sd of one", "number"), Column("lowest", "number", aside=True),
        Column("highest", "number", aside=True), Column("unit", "short"),
        Column("told apart", "short"),
    ]  # fmt: skip
    lead = (
        "The latest result of each instrument. Spread is the standard deviation of the "
        "instruments, beside that of one calibration; told apart: the instruments differ by more "
        "than chance."
    )
    return Section("Between instruments", lead, [Table(columns, rows)])


def instruments_drawn(about: About) -> Section:
    """Return the coefficients over the instruments, a figure for each."""
    b, kinds = about["between"], _kinds(about)
    values, sd = np.array(b["values"]), np.array(b["sd"])
    places = _numbers([one["results"][-1] for one in about["instruments"]])
    odd = {o["name"] for o in b["outlying"]}
    figures: list[Figure] = []
    for k, name in enumerate(b["names"]):
        limits = (_limits(about, name)[0], float("inf"))
        figures.append(
            over_time(
                name,
                kinds[name],
                values[:, k],
                sd[:, k],
                places,
                limits,
                name in odd,
                joined=False,
            )
        )
    lead = _drawn_lead(about, "a calibration").partition(" Shaded")[0]
    return Section("Instrument by instrument", lead, figures)


def _places(about: About, rows: Sequence[int]) -> list[str]:
    """Return the dates of results, their numbers where there are not two dates."""
    times = [about["results"][i]["time"] for i in rows]
    if None in times or times[0] == times[-1]:
        return _numbers(rows)
    dates = [datetime.datetime.fromtimestamp(t, datetime.UTC) for t in times]
    return [d.replace(tzinfo=None).isoformat(timespec="seconds") for d in dates]


def _numbers(rows: Sequence[int]) -> list[str]:
    return [f"no. {i + 1}" for i in rows]


def in_unit(kind: str, value: float) -> tuple[str, float]:
    """Return the unit in which people would read a value of `kind`, and its size [SI]."""
    unit = display_unit(kind, value)
    return unit, factor(unit, kind)


def plus_minus(value: float, sd: float) -> str:
    """Write a number with its standard deviation, both in the unit shown."""
    return f"{_number(value, sd)} ± {_size(sd)}"


def _number(value: float, sd: float) -> str:
    return _signed(format_value(value, sd))


def _size(sd: float) -> str:
    return format_value(sd, sd)


def _signed(text: str) -> str:
    return text.replace("-", "−")
