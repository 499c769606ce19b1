"""What the error of a navigation is made of: terms, coefficients, sources of uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np

from foucault import units
from foucault.diagnose.navigation.free_inertial import TERMS
from foucault.report import figures_navigation as figures
from foucault.report.navigation_detail import Seen, metres, minutes, number
from foucault.report.north_detail import signed
from foucault.report.page import Block, Column, Items, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.units import plain

DRAWN = 14
"""Coefficients that are drawn [1]."""

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


def terms(seen: Seen) -> Section | None:
    """Terms of free inertial drift that the error shows."""
    run = seen.about["runs"][0]
    if "terms" not in run:
        if seen.errors is None or not seen.still:
            return None
        return Section("Schuler and heading terms",
                       f"Not fitted: {seen.about['stationary']}.", [])  # fmt: skip
    table, said = seen.tables["terms"], run["terms"]
    blocks: list[Block] = []
    for a in ("east", "north"):
        parts = {term: table[f"{term}.{a}"] for term in TERMS}
        noise = table[f"noise.{a}"]
        blocks.append(figures.terms(table["age"], table[a], parts, noise, f"error {a}"))
    blocks.append(_term_table(seen))
    if said["alike"]:
        blocks.append(Items([("plain", signed(text)) for text in said["alike"]]))
    if said["chi_square"] > said["limits"][1]:
        more = (
            f"The terms leave {plain(said['chi_square'] / said['dof'], 3)} times the variance that "
            "sensor noise explains: biases that wander, or motion. The standard deviations are "
            "widened by as much."
        )
        blocks.append(Text(more))
    period = said["schuler_period"]
    lead = (
        "The error of a navigator that stands still is made of seven terms, fitted here with the "
        "noise as it is correlated in time; the band is what noise adds after the start. The "
        f"Schuler period is {plain(period / 60, 3)} min"
    )
    age = float(table["age"][-1])
    if age < 0.5 * period:
        lead += f"; in {minutes(age)} of it some terms look alike, and their sd say so"
    return Section("Schuler and heading terms", lead + ".", blocks)


def _term_table(seen: Seen) -> Table:
    both = [run["terms"]["rows"] for run in seen.about["runs"] if "terms" in run]
    columns = [
        Column("term"), Column("value", "number"), Column("± sd", "number"),
        *([Column("without calibration", "number")] if len(both) > 1 else []),
        Column("unit", "short"), Column("east at the end [m]", "number", aside=True),
        Column("north [m]", "number", aside=True), Column("looks like"),
    ]  # fmt: skip
    rows = []
    for k, row in enumerate(both[0]):
        unit = UNIT[row["kind"]]
        value, sd = (units.convert(row[c], row["kind"], unit) for c in ("value", "sd"))
        cells = [row["name"], _to(value, sd), _to(sd, sd)]
        if len(both) > 1:
            cells.append(_to(units.convert(both[1][k]["value"], row["kind"], unit), sd))
        seen_well = abs(row["value"]) > 2 * row["sd"]
        act = next(words for start, words in ACTS.items() if row["name"].startswith(start))
        alike = row["same_as"] if seen_well and row["same_as"] else act
        cells += [shown(unit), number(row["east"]), number(row["north"]), signed(alike)]
        rows.append(cells)
    return Table(columns, rows)


def _to(value: float, sd: float) -> str:
    from foucault.coefficients import format_value

    return signed(format_value(value, sd))


def worth(seen: Seen) -> Section | None:
    """What each coefficient was worth, and what is left of it."""
    rows = seen.about["contributions"]
    if not rows:
        return None
    some = rows[:DRAWN]
    before = np.array([r["worth"]["horizontal"] for r in some], float)
    left = np.array([r["left"]["horizontal"] or 0.0 for r in some], float)
    unit = figures.length_unit(float(np.max(before, initial=0.0)))
    blocks: list[Block] = [figures.contributions([r["name"] for r in some], before, left, unit)]
    blocks.append(_worth_table(rows))
    blocks += _closure(seen, rows)
    lead = (
        "Horizontal position at the end that each coefficient made before it was corrected, "
        "alignment included: the errors of navigation are propagated with it from the start of "
        "the rest. Left: what its standard deviation still makes."
    )
    return Section("What each coefficient is worth", lead, blocks)


def _closure(seen: Seen, rows: Any) -> list[Block]:
    """Compare the sum of all contributions with the two runs."""
    total = seen.about["difference"]
    if total is None:
        return []
    parts = [sum(r["worth"][a] for r in rows) for a in ("east", "north")]
    text = (
        f"All together {metres(parts[0])} east and {metres(parts[1])} north; the two runs differ "
        f"by {metres(total[0])} and {metres(total[1])}."
    )
    miss = float(np.hypot(parts[0] - total[0], parts[1] - total[1]))
    if miss > 0.1 * float(np.hypot(*total)):
        text += (
            " They do not agree: the errors are too large to act one by one, or the two runs did "
            "not start alike."
        )
    return [Text(signed(text))]


def _worth_table(rows: Any) -> Table:
    columns = [
        Column("coefficient", "name"), Column("value", "number"), Column("± sd", "number"),
        Column("unit", "short"), Column("east [m]", "number", aside=True),
        Column("north [m]", "number", aside=True), Column("horizontal [m]", "number"),
        Column("heading [arcsec]", "number", aside=True), Column("left [m]", "number"),
    ]  # fmt: skip
    out = []
    for r in rows:
        unit = units.display_unit(r["kind"], abs(r["value"]))
        value = units.convert(r["value"], r["kind"], unit)
        sd = None if r["sd"] is None else units.convert(r["sd"], r["kind"], unit)
        w, left = r["worth"], r["left"]
        turn = None if w["heading"] is None else 3600 * float(np.degrees(w["heading"]))
        out.append([
            r["name"], _to(value, sd) if sd else signed(f"{value:.4g}"),
            _to(sd, sd) if sd else "", shown(unit),
            number(w["east"]), number(w["north"]), number(w["horizontal"]), number(turn),
            number(left["horizontal"]) if r["sd"] is not None else "",
        ])  # fmt: skip
    return Table(columns, out)


SOURCES = {
    "coefficients": ("calibration", "what is left of all coefficients together, correlated"),
    "alignment": ("alignment", "sensor noise during the rest, and the attitude that was given"),
    "noise": ("sensor noise", "white noise of gyros and accelerometers after the rest"),
    "all": ("all together", ""),
}
"""Source of the predicted error -> name, and what it is."""


def sources(seen: Seen) -> Section:
    """Where the predicted error comes from."""
    end = seen.about["predicted"]
    whole = sum(end["all"][f"{a}_sd"] ** 2 for a in ("east", "north"))
    rows = []
    for key, (name, what) in SOURCES.items():
        if key == "coefficients" and not seen.calibrated:
            continue
        s = end[key]
        part = sum(s[f"{a}_sd"] ** 2 for a in ("east", "north")) / whole if whole else 0.0
        rows.append([
            name, number(s["east_sd"]), number(s["north_sd"]), number(s["cep"]),
            f"{100 * part:.1f} %", number(3600 * float(np.degrees(s["heading_sd"]))), what,
        ])  # fmt: skip
    columns = [
        Column("source"), Column("east sd [m]", "number"), Column("north sd [m]", "number"),
        Column("half of all runs [m]", "number"), Column("share", "number"),
        Column("heading sd [arcsec]", "number", aside=True), Column("what it is", aside=True),
    ]  # fmt: skip
    lead = (
        f"Predicted error after {minutes(end['age'])}, by source. Slow wandering of the biases "
        "after the calibration is not in it."
    )
    if not seen.calibrated:
        lead = (
            f"What noise and alignment alone make after {minutes(end['age'])}. Errors of the "
            "sensors are not in it: there is no calibration."
        )
    return Section("Where the predicted error comes from", lead, [Table(columns, rows)])
