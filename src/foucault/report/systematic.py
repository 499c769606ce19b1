"""What a systematic calibration found beside its coefficients: sequence, velocities, navigation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.report import figures_systematic as figures
from foucault.report.figures_systematic import ARCSEC, COMPENSATED
from foucault.report.page import Block, Column, Section, Table, Text
from foucault.result import Result

WAYS = ("east", "north", "up")


def velocities(result: Result) -> Section | None:
    """The velocity at the end of every rest, with the calibration and without it."""
    table = result.tables.get("velocities")
    if table is None:
        return None
    worst = {
        name: max(float(np.abs(table[f"{name}_{way}"]).max()) for way in WAYS)
        for name in ("before", "after")
    }
    run = (
        "Navigated from the beginning of each rest to its end, "
        if result.diagnostics["filter"]["decorrelate"]
        else "Navigated from the end of each rest through the turns that follow to the end of the "
        "next, "
    )
    lead = (
        f"{run}where the velocity should be zero: at most "
        f"{_speed(worst['before'])} without the calibration and {_speed(worst['after'])} with it."
    )
    return Section("Velocity at rest before and after", lead, [figures.velocities(table)])


def _speed(value: float) -> str:
    return f"{value:.3g} m/s" if value >= 1 else f"{1e3 * value:.3g} mm/s"


def sequence(result: Result) -> Section | None:
    """Where the axes of the body pointed in every rest, and how well each rest fits."""
    table, fits = result.tables.get("attitudes"), result.tables.get("innovations")
    facts = result.diagnostics.get("sequence")
    if table is None or fits is None or facts is None:
        return None
    labels = list(facts["labels"])
    blocks: list[Block] = [figures.attitudes(table, labels), figures.innovations(fits, labels)]
    if passes := _passes(result):
        blocks.append(Text(passes))
    lead = (
        f"Sequence: {facts['name']}; {facts['rests']} rests and {facts['moves']} turns. Which axis "
        "of the body points east, north and up; where none is within 3° of it, the nearest, in "
        "brackets."
    )
    return Section("The sequence", lead, blocks)


def _passes(result: Result) -> str:
    values = np.array((result.diagnostics.get("passes") or {}).get("values") or [], float)
    names = (result.diagnostics.get("passes") or {}).get("names") or []
    if len(values) < 2:
        return ""
    c = result.coefficients
    both = [(k, c.layout.index(n)) for k, n in enumerate(names) if n in c.layout]
    sd = c.sd[[i for _, i in both]]
    steps = np.abs(np.diff(values[:, [k for k, _ in both]], axis=0)) / sd
    words = ", then ".join(f"{step.max():.2g}" for step in steps)
    return (
        f"Passes through the session: {len(values)}. From one to the next coefficients moved by "
        f"at most {words} standard deviations."
    )


def navigation(result: Result) -> Section | None:
    """The navigation test about east and about north."""
    table, ends = result.tables.get("navigation"), result.diagnostics.get("navigation")
    if table is None or not ends:
        return None
    blocks: list[Block] = [
        figures.navigation(table, about, what)
        for what in ("shift", "velocity")
        for about in ("east", "north")
    ]
    blocks.append(_ends(ends))
    key = "; ".join(
        f"{line}: {COMPENSATED[way]}"
        for way, line in (("none", "dotted"), ("all but deflection", "dashed"), ("all", "solid"))
        if any(end["compensated"] == way for end in ends)
    )
    lead = (
        "Simulated: x up, y east, z north; an alignment, ten turns at 18 °/s about east or north, "
        "then 500 s of rest. The instrument has the errors found here; what is compensated differs "
        "from them as the uncertainty allows, one draw. Without noise, which is the same either "
        f"way. {key.capitalize()}."
    )
    return Section("What it is worth in navigation", lead, blocks)


def _ends(ends: Sequence[Mapping[str, Any]]) -> Table:
    columns = [
        Column("spin about"),
        Column("instrument"),
        *[Column(f"tilt by the spin about {way} [″]", "number") for way in ("east", "north")],
        Column("less by", "number", aside=True),
        *[Column(f"velocity at the end, {way} [m/s]", "number") for way in ("east", "north")],
        Column("less by", "number", aside=True),
    ]
    asis = {end["about"]: end for end in ends if end["compensated"] == "none"}
    rows = [
        [
            str(end["about"]), COMPENSATED[end["compensated"]],
            *[_signed(f"{v / ARCSEC:.2f}") for v in end["shift"][:2]],
            _less(end, asis[end["about"]], "shift"),
            *[_signed(f"{v:.4f}") for v in end["velocity"][:2]],
            _less(end, asis[end["about"]], "velocity"),
        ]
        for end in ends
    ]  # fmt: skip
    return Table(columns, rows)


def _less(end: Mapping[str, Any], asis: Mapping[str, Any], what: str) -> str:
    """Say by how much a level error is less than that of the instrument as it is."""
    left, before = (float(np.hypot(*run[what][:2])) for run in (end, asis))
    return "" if end is asis or not before else _signed(f"{100 * (1 - left / before):.1f} %")


def _signed(text: str) -> str:
    return text.lstrip("-") if float(text.rstrip(" %")) == 0 else text.replace("-", "−")
