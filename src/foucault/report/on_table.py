"""What a session on a table rests on: norms, residuals, orientations, and the table itself.

A section is left out where its columns are missing: rests on faces have no table angles, readings
without gyros no rates. Readings are numbered from 1, rests and spins apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import format_value
from foucault.report import figures_on_table as drawn
from foucault.report import orientation
from foucault.report.evidence import RESIDUAL_LIMIT, chi_square_words
from foucault.report.figures_on_table import Bars, Group, Norms
from foucault.report.page import Block, Column, Figure, Items, Section, Table, Text
from foucault.report.uncertainty import NOTHING_ADDED, shown
from foucault.result import Result

UNTESTED = 1e-3
"""A standardized residual below this is that of a reading which nothing tests [1]."""

USED = 0.5
"""Robust weight below which a reading was left out [1]."""


@dataclass(frozen=True)
class Kind:
    """The rests, or the spins, of a session: their rows in the table, and how to speak of them."""

    group: Group
    rows: IntArray


def kinds(table: Any) -> list[Kind]:
    """Part the readings into rests and spins; without table angles a spin is called a turn."""
    spin = np.asarray(table["rate"], float) != 0.0
    word = "spin" if "middle" in table else "turn"
    out = []
    for what, pick in (("rest", ~spin), (word, spin)):
        rows = np.flatnonzero(pick)
        if rows.size:
            out.append(Kind(Group(what, [_where(table, int(j)) for j in rows]), rows))
    return out


def _where(table: Any, j: int) -> str:
    """Time, table angles and rate of one reading."""
    words = [f"{max(float(table['start'][j]), 0.0):.0f} s"]
    angles = {name: float(table[name][j]) for name in ("middle", "inner") if name in table}
    words += [f"{name} {np.degrees(a):.1f}°" for name, a in angles.items() if np.isfinite(a)]
    if table["rate"][j]:
        words.append(f"{np.degrees(float(table['rate'][j])):.3g} °/s")
    return ", ".join(words).replace("-", "−")


def _column(table: Any, name: str) -> FloatArray | None:
    """Return a column, None where it is missing or empty."""
    if name not in table:
        return None
    values = np.asarray(table[name], float)
    return values if np.isfinite(values).any() else None


def _left_out(table: Any, triad: str) -> BoolArray:
    """Which readings of a triad were not used."""
    weight = _column(table, f"{triad}_weight")
    weight = _column(table, "weight") if weight is None else weight
    return np.zeros(len(table["rate"]), bool) if weight is None else weight < USED


def norms(result: Result) -> Section | None:
    """Error of the norm of every reading, before and after."""
    table = result.tables.get("readings")
    gravity = result.diagnostics.get("gravity", result.site.get("gravity"))
    if table is None:
        return None
    force = rate = None
    if gravity is not None:
        force = _norm_figure(table, "norm", gravity, "accel", "specific force", 100)
    if (true := _column(table, "rate_true")) is not None:
        rate = _norm_figure(table, "rate", true, "gyro", "angular rate", 100)
    determined = rate is not None and _residual_figure(table, "gyro") is None
    spare = " There are only just enough readings, so that nothing is left." if determined else ""
    titles = (
        "Specific force: norm minus local gravity.",
        f"Angular rate: norm minus true rate.{spare}",
    )
    blocks: list[Block] = []
    for title, figure in zip(titles, (force, rate), strict=True):
        blocks += [Text(title), figure] if figure is not None else []
    if not blocks:
        return None
    spins = any(kind.group.what == "spin" for kind in kinds(table))
    lead = ["Error of the norm of each reading; note the two scales."]
    if force is not None:
        taken = spins and rate is not None
        lead.append(
            "Specific force must have the size of local gravity"
            + ("; in spins its centripetal part is taken off first." if taken else ".")
        )
    if rate is not None:
        what = "whole turns" if spins else "each turn"
        whose = "the table" if spins else "the turn"
        lead.append(f"The mean rate of {what} must be that of {whose} and of the Earth.")
    lead.append("Shaded: ±2 sd of a new reading; those that were fitted lie closer.")
    return Section("Norms before and after", " ".join(lead), blocks)


def _norm_figure(
    table: Any, column: str, true: float | FloatArray, triad: str, quantity: str, share: int
) -> Figure | None:
    """Draw |f| - g, or |w| minus the true rate, of all groups that have it."""
    before, after = _column(table, f"{column}_before"), _column(table, f"{column}_after")
    if before is None or after is None:
        return None
    before, after = before - true, after - true
    sd = _column(table, f"{column}_sd")
    sd = np.full(len(after), np.nan) if sd is None else sd
    left = _left_out(table, triad)
    unit_before = _unit(quantity, before)
    unit_after = _unit(quantity, np.concatenate([after[~left], sd[~left]]))
    scale = [units.factor(u, quantity) for u in (unit_before, unit_after)]
    parts = [
        Norms(
            k.group, before[k.rows] / scale[0], after[k.rows] / scale[1], sd[k.rows] / scale[1],
            left[k.rows],
        )
        for k in kinds(table)
        if np.isfinite(after[k.rows]).any()
    ]  # fmt: skip
    return drawn.before_after(quantity, parts, (shown(unit_before), shown(unit_after)), share)


def _unit(kind: str, values: FloatArray) -> str:
    """Return the unit to show `values` [SI] in."""
    finite = np.abs(values[np.isfinite(values)])
    return units.display_unit(kind, float(finite.max(initial=0.0)))


TRIADS = {"accel": ("Accelerometers", "specific force"), "gyro": ("Gyros", "angular rate")}
OBSERVED = {
    "accel at rest": "Specific force at rest",
    "accel in spins": "Specific force in spins",
    "gyro at rest": "Angular rate at rest",
    "gyro in spins": "Angular rate in spins, across the axis",
    "rate of spins": "Angular rate in spins, along the axis",
    "accel": "Specific force at rest",
    "gyro": "Angular rate at rest",
    "turns": "Turns",
}


def residuals(result: Result) -> Section | None:
    """Standardized residual of every reading, and how each kind fits as a whole."""
    table = result.tables.get("readings")
    if table is None or _column(table, "residual") is None:
        return None
    blocks: list[Block] = []
    for triad, (name, quantity) in TRIADS.items():
        figure = _residual_figure(table, triad)
        blocks += [Text(f"{name}: {quantity}."), figure] if figure is not None else []
    if not blocks:
        return None
    chi = result.diagnostics.get("chi_square") or {}
    found = [chi_square_words(OBSERVED.get(k, k), row) for k, row in chi.items() if row]
    limit = f"{RESIDUAL_LIMIT:.0f} sd"
    lead = (
        "What the model leaves unexplained in each reading, in units of the standard deviation it "
        f"should have. Dashed: {limit}; a single bar a little beyond is no cause for alarm. With "
        "few readings to spare a wrong one spreads over the others, so look at the checks too."
    )
    return Section("Residuals", lead, [*blocks, *([Items(found)] if found else [])])


def _residual_figure(table: Any, triad: str) -> Figure | None:
    """Draw the residuals of one triad, where anything tests them."""
    own = _column(table, f"{triad}_residual")
    if own is None:
        # One residual for both triads: rests speak for accelerometers, turns for gyros.
        spin = np.asarray(table["rate"], float) != 0.0
        own = np.where(spin == (triad == "gyro"), np.asarray(table["residual"], float), np.nan)
    tested = np.where(np.abs(own) < UNTESTED, np.nan, own)
    left = _left_out(table, triad)
    groups = [
        Bars(k.group, tested[k.rows], left[k.rows])
        for k in kinds(table)
        if np.isfinite(tested[k.rows]).any()
    ]
    if not groups:
        return None
    look = drawn.Look(
        "residual / sd", "sd", "used", "left out",
        f"Standardized residual of the {TRIADS[triad][1]} of every reading",
    )  # fmt: skip
    return drawn.bars(groups, look, RESIDUAL_LIMIT)


def orientations(result: Result) -> Section | None:
    """Where up pointed at the rests and the outer axis in the spins, and what is missing."""
    table = result.tables.get("readings")
    if table is None or _column(table, "up_x") is None:
        return None
    up = np.column_stack([table[f"up_{a}"] for a in "xyz"]).astype(float)
    parts = {k.group.what: k.rows for k in kinds(table)}
    rests = parts.pop("rest", np.empty(0, np.int64))
    word, spins = next(iter(parts.items()), ("spin", np.empty(0, np.int64)))
    coverage = result.diagnostics.get("coverage") or {}
    gaps = coverage.get("missing") or []
    missing = np.array([g["direction"] for g in gaps], float).reshape(-1, 3)
    words = [str(g.get("words", "missing")) for g in gaps]
    seen, names = (rests, "rest") if len(rests) else (spins, word)
    also = up[spins] if len(rests) and len(spins) else None
    return Section(
        "Orientations visited",
        _orientation_lead(coverage, names, word if also is not None else ""),
        [
            orientation.sphere(up[seen], missing, also, (names, word)),
            orientation.flat_map(up[seen], missing, words, also, (names, word)),
            *([Items([("warning", f"Missing: {w}.") for w in words])] if words else []),
        ],
    )


def _orientation_lead(coverage: Mapping[str, Any], name: str, also: str) -> str:
    lead = f"Direction of up in body axes, one point per {name}."
    if also:
        axis = "of the outer axis" if also == "spin" else "of the axis"
        lead += f" Rings: direction {axis} in each {also}."
    if coverage.get("largest_gap") is not None:
        gap = np.degrees(coverage["largest_gap"])
        lead += f" The direction farthest from any {name} is {gap:.0f}° away."
    return lead


RIG_GROUPS = {
    "lever_arm": (
        "Lever arm",
        "from the centre of the table to the accelerometers, in body axes; it shows as centripetal "
        "acceleration in the spins.",
    ),
    "mounting": (
        "Mounting",
        "how the body axes of the instrument are turned against the case axes of the table.",
    ),
    "table": (
        "Table",
        "its errors, found along with the instrument, beside the sd that was believed before.",
    ),
}
"""First word of the name -> heading, and what the group is."""

HEADING_ALONE = ("Table", "found along with the instrument; its angles were taken as exact.")


def rig(result: Result) -> Section | None:
    """Lever arm, mounting and errors of the table, beside what was believed of them."""
    table = result.tables.get("rig")
    if table is None or not len(table["name"]):
        return None
    names = [str(name) for name in table["name"]]
    heads = list(dict.fromkeys(name.partition(".")[0] for name in names))
    believed = bool(np.isfinite(np.asarray(table["prior_sd"], float)).any())
    columns = [
        Column("quantity", "name"),
        Column("value", "number"),
        Column("± sd", "number"),
        *([Column("known before", "number")] if believed else []),
        Column("unit", "short"),
        Column("meaning", "meaning"),
    ]
    cells = _rig_cells(table, believed)
    rows: list[list[str]] = []
    for head in heads:
        if len(heads) > 1:
            rows.append([RIG_GROUPS.get(head, (head, ""))[0]])
        rows += [c for c, name in zip(cells, names, strict=True) if name.partition(".")[0] == head]
    groups = RIG_GROUPS if believed else RIG_GROUPS | {"table": HEADING_ALONE}
    said = [groups[head] for head in heads if head in groups]
    alone = len(said) == 1
    lead = " ".join(words[0].upper() + words[1:] if alone else f"{n}: {words}" for n, words in said)
    blocks: list[Block] = [Table(columns, rows)]
    if nothing := _nothing_added(table):
        blocks.append(Items([("plain", f"Known hardly better than before: {nothing}.")]))
    return Section(said[0][0] if alone else "The table and the mounting", lead, blocks)


def _nothing_added(table: Any) -> str:
    """Name what the readings said nothing of."""
    sd, before = (np.asarray(table[name], float) for name in ("sd", "prior_sd"))
    weak = np.isfinite(before) & (sd > NOTHING_ADDED * before)
    return ", ".join(f"`{name}`" for name, w in zip(table["name"], weak, strict=True) if w)


def _rig_cells(table: Any, believed: bool) -> list[list[str]]:
    """One row per quantity; those of a family, such as the three of the mounting, share a unit."""
    value, sd, before = (np.asarray(table[name], float) for name in ("value", "sd", "prior_sd"))
    families = [str(name).rpartition(".")[0] for name in table["name"]]
    out = []
    for i, (name, kind) in enumerate(zip(table["name"], table["kind"], strict=True)):
        mine = np.array([family == families[i] for family in families])
        unit = "mm" if kind == "length" else _unit(kind, np.concatenate([value[mine], sd[mine]]))
        size = units.factor(unit, kind)
        cells = [str(name), format_value(value[i] / size, sd[i] / size).replace("-", "−")]
        cells.append(format_value(sd[i] / size, sd[i] / size))
        if believed:
            known = before[i] / size
            cells.append(f"± {format_value(known, known)}" if np.isfinite(known) else "nothing")
        out.append([*cells, shown(unit), str(table["meaning"][i])])
    return out


def control(result: Result) -> Section | None:
    """What a wrong position would have had to be to be noticed."""
    table = result.tables.get("readings")
    smallest = None if table is None else _column(table, "detectable")
    if table is None or smallest is None:
        return None
    groups = [k for k in kinds(table) if (~np.isnan(smallest[k.rows])).any()]
    unit = _unit("specific force", smallest)
    size = units.factor(unit, "specific force")
    parts = [Bars(k.group, smallest[k.rows] / size, np.isinf(smallest[k.rows])) for k in groups]
    look = drawn.Look(
        f"smallest error seen [{shown(unit)}]", shown(unit), "controlled", "not controlled",
        "Smallest error of the specific force of each reading that would have been noticed",
    )  # fmt: skip
    lead = (
        "Smallest error of the specific force of one reading that the others would have shown, in "
        "the direction that they control best. Anything smaller passes into the coefficients."
    )
    state = "warning" if np.isinf(smallest).any() else "plain"
    said = [(state, c.sentence) for c in result.checks if c.name.startswith("control")]
    blocks: Sequence[Block] = [drawn.bars(parts, look), *([Items(said)] if said else [])]
    return Section("What a wrong position would have done", lead, blocks)
