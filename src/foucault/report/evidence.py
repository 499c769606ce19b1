"""What a result rests on: norms, residuals, orientations, rests, and rests left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.report import figures, orientation
from foucault.report.page import Block, Items, Section
from foucault.report.uncertainty import shown
from foucault.result import Result

OBSERVED = {"accel": "Specific force at rest", "gyro": "Angular rate at rest", "turns": "Turns"}
RESIDUAL_LIMIT = 3.0  # guide line; one normal residual in 370 lies outside


def norms(result: Result) -> Section | None:
    """Specific force of every rest against local gravity, before and after."""
    rests = result.tables.get("rests")
    gravity = result.diagnostics.get("gravity", result.site.get("gravity"))
    if rests is None or gravity is None:
        return None
    before, after = rests["norm_before"] - gravity, rests["norm_after"] - gravity
    sd = rests["norm_sd"]
    before_unit, size_before = _unit("specific force", before)
    after_unit, size_after = _unit("specific force", np.concatenate([after, sd]))
    figure = figures.before_after(
        _count(rests),
        before / size_before,
        after / size_after,
        sd / size_after,
        (shown(before_unit), shown(after_unit)),
    )
    lead = (
        "At rest the specific force must have the size of local gravity, whatever the "
        "orientation. Error of its norm, per rest; note the two scales."
    )
    return Section("Specific force before and after", lead, [figure])


def residuals(result: Result) -> Section | None:
    """Standardized residuals against time and against orientation."""
    limits = result.diagnostics.get("residual_limit") or {}
    blocks: list[Block] = []
    for name, what, triad in (("rests", "rest", "accel"), ("turns", "turn", "gyro")):
        table = result.tables.get(name)
        if table is not None and "residual" in table:
            limit = float(limits.get(triad, RESIDUAL_LIMIT))
            size, weight = table["residual"], table["weight"]
            blocks.append(figures.residuals(_middle(table), size, weight, what, limit))
    if not blocks:
        return None
    blocks += _against_orientation(result)
    lead = (
        "What the model leaves unexplained, in units of the standard deviation it should have: "
        f"accelerometers per rest, gyros per turn. Dashed: {RESIDUAL_LIMIT:.0f} sd; a single "
        "point a little beyond is no cause for alarm, a pattern is: against time a drift, against "
        "orientation a term that the model lacks."
    )
    if limits:
        lead = lead.replace(f"{RESIDUAL_LIMIT:.0f} sd; a single", "limit; a single")
    chi = result.diagnostics.get("chi_square", {})
    found = [chi_square_words(what, chi[k]) for k, what in OBSERVED.items() if chi.get(k)]
    return Section("Residuals", lead, [*blocks, *([Items(found)] if found else [])])


def _middle(table: Any) -> FloatArray:
    """The middle of every row in time [s]."""
    return np.asarray((table["start"] + table["end"]) / 2, float)


def _against_orientation(result: Result) -> list[Block]:
    """Norm error over its sd against the direction of up, and turns against their angle."""
    rests, turns = result.tables.get("rests"), result.tables.get("turns")
    gravity = result.diagnostics.get("gravity", result.site.get("gravity"))
    out: list[Block] = []
    if rests is not None and "up_x" in rests and gravity is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            size = (rests["norm_after"] - gravity) / rests["norm_sd"]
        up = np.column_stack([rests[f"up_{a}"] for a in "xyz"]).astype(float)
        out.append(figures.against_up(up, size, rests["weight"], RESIDUAL_LIMIT))
    if turns is not None and "angle" in turns:
        angle = np.rad2deg(turns["angle"])
        size, weight = turns["residual"], turns["weight"]
        out.append(figures.against_angle(angle, size, weight, RESIDUAL_LIMIT))
    return out


def chi_square_words(what: str, row: Sequence[float | None]) -> tuple[str, str]:
    """Say how the residuals of `what` fit; `row` is the sum of squares, limits, and freedom.

    No upper limit, None, is that of residuals in which noise that is not white shows too.
    """
    value, low, high, dof = (float("inf") if v is None else v for v in row)
    fits = low <= value <= high
    word = "inside" if fits else "outside"
    size = [f"{v:.3g}" if v < 1e3 else f"{v:.0f}" for v in (value, low, high)]
    limits = f"{size[1]} to {size[2]}" if high < float("inf") else f"{size[1]} and above"
    text = f"{what}: chi-square {size[0]}, {word} {limits} ({dof:.0f} degrees "
    return ("good" if fits else "warning", text + "of freedom).")


def orientations(result: Result) -> Section | None:
    """Where up pointed, and which directions are missing."""
    rests = result.tables.get("rests")
    if rests is None or "up_x" not in rests:
        return None
    up = np.column_stack([rests[f"up_{a}"] for a in "xyz"]).astype(float)
    coverage = result.diagnostics.get("coverage", {})
    gaps = coverage.get("missing") or []
    missing = np.array([g["direction"] for g in gaps], float).reshape(-1, 3)
    words = [str(g.get("words", "missing")) for g in gaps]
    lead = "Direction of up in body axes, one point per rest."
    if coverage.get("largest_gap") is not None:
        gap = np.rad2deg(coverage["largest_gap"])
        lead += f" The direction farthest from any rest is {gap:.0f}° away."
    blocks: list[Block] = [
        orientation.sphere(up, missing),
        orientation.flat_map(up, missing, words),
    ]
    if words:
        blocks.append(Items([("warning", f"Missing: {w}.") for w in words]))
    return Section("Orientations visited", lead, blocks)


def detection(result: Result) -> Section | None:
    """Where the log was at rest."""
    table = result.tables.get("detection")
    if table is None:
        return None
    facts = result.diagnostics.get("detection", {})
    rests = result.tables.get("rests", {})
    ends = zip(rests.get("start", ()), rests.get("end", ()), strict=True)
    spans = [(float(a), float(b)) for a, b in ends if np.isfinite(a + b)]
    lead = "Moving standard deviation over its value at rest. Shaded: rests used."
    if facts.get("threshold") is not None:
        lead += f" Dashed: threshold {facts['threshold']:.3g}, chosen from the data."
    if facts.get("rests") is not None and facts.get("rest_time") is not None:
        lead += f" {facts['rests']} rests, {facts['rest_time']:.0f} s in all."
    return Section(
        "Detection of rests", lead, [figures.detection(table, facts.get("threshold"), spans)]
    )


def held_out(result: Result) -> Section | None:
    """How well rests are predicted that were not used."""
    rests = result.tables.get("rests")
    if rests is None or not np.isfinite(rests.get("held_out", np.array([np.nan]))).any():
        return None
    known = np.isfinite(rests["held_out"])
    error, sd = rests["held_out"][known], rests["held_out_sd"][known]
    unit, size = _unit("specific force", np.concatenate([error, sd]))
    figure = figures.held_out(_count(rests)[known], error / size, sd / size, shown(unit))
    lead = (
        "Each rest predicted from all the others: error of its norm with ±2 sd. About 19 of 20 "
        "bars should reach zero."
    )
    return Section("Rests left out and predicted", lead, [figure])


def _unit(kind: str, values: FloatArray) -> tuple[str, float]:
    """Return the unit to show `values` [SI] in, and its SI value."""
    finite = np.abs(values[np.isfinite(values)])
    unit = units.display_unit(kind, float(finite.max(initial=0.0)))
    return unit, units.factor(unit, kind)


def _count(table: Any) -> npt.NDArray[np.int64]:
    """Return 1, 2, ... for the rows of `table`."""
    return np.arange(1, len(next(iter(table.values()))) + 1)
