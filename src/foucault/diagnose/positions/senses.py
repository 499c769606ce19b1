"""Do the spins of a session turn the way, and at the rate, that the table or the plan says?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.positions import rates as position_rates
from foucault.diagnose.positions.choice import OTHER_RATE
from foucault.diagnose.positions.match import Match, directions
from foucault.errors import Finding, error, finding
from foucault.models.readings import Readings
from foucault.models.turntable import TablePlan, up_k
from foucault.units import plain

RATE_TOLERANCE = 1e-4
"""A table holds the rate that it was told to this, as sd, where nothing else is declared [1]."""

BEYOND = 3.0
"""So many sd of the table's rate are no chance [1]."""

WORDS = {True: "counter-clockwise", False: "clockwise"}
"""Senses seen from above, by the sign of the rate."""


def numbered(readings: Readings, which: npt.NDArray[np.intp], most: int = 6) -> str:
    """Name readings as the report does, numbered from 1 among rests or spins.

    `readings`: what was read [SI]; `which` (k,): readings [1]; `most`: longest list [1].
    """
    spin = readings.spin
    words = [
        f"{'spin' if spin[k] else 'rest'} {int(np.sum(spin[: k + 1] == spin[k]))} "
        f"({plain(readings.start[k], 5)} s)"
        for k in which[:most]
    ]
    more = f" and {len(which) - most} more" if len(which) > most else ""
    return ", ".join(words) + more


def senses(
    readings: Readings,
    plan: TablePlan | None,
    found: Match | None,
    row: IntArray | None,
    by_table: bool,
    table_rate_sd: float | None = None,
) -> tuple[Readings, list[Finding]]:
    """Compare the sense and the size of the spins with what the gyros measure.

    `readings`: what was read [SI]; `plan` or None: what the table was told to do; `found` or
    None: which positions of the plan the readings were taken in; `row` (n,) or None: the same,
    with readings that repeat a position [1]; `by_table`: whether the log tells the rates of the
    spins; `table_rate_sd` or None: relative sd of the rate that was declared, where the angle
    over the stamps can be held against it [1].
    """
    spin = np.flatnonzero(readings.spin)
    if readings.gyro is None or not len(spin):
        return readings, []
    up = _up(readings, plan, found)
    bias = np.zeros(3)
    if np.isfinite(up).all():
        bias = position_rates.bias_across(readings.gyro, up, readings.time)
    along = ((readings.gyro[spin] - bias) * up[spin]).sum(axis=1)
    planned = np.zeros(len(spin))
    if plan is not None and row is not None:
        planned = np.where(row[spin] >= 0, plan.rate[row[spin]], 0.0)
    rate = readings.rate[spin]
    said = rate if by_table or plan is None else np.where(planned != 0, planned, rate)
    known = np.isfinite(along)
    other = known & (along * said < 0)
    out: list[Finding] = []
    if other.any() and other.sum() == known.sum():
        raise error("spin.sense", **_all_other(along[known], planned[known], by_table))
    if other.any():
        out.append(
            finding(
                "spin.sense_some", count=int(other.sum()), spins=len(spin),
                said=_who(by_table or plan is None), which=numbered(readings, spin[other]),
            )
        )  # fmt: skip
    rates = readings.rate.copy()
    rates[spin[known]] = np.copysign(rate[known], along[known])
    readings = replace(readings, rate=rates)
    if plan is not None:
        out += _rates(readings.rate[spin], planned, table_rate_sd)
    return readings, out


def _who(by_table: bool) -> str:
    return "the outer column (or rate) of the log" if by_table else "the plan"


def _all_other(along: FloatArray, planned: FloatArray, by_table: bool) -> dict[str, object]:
    ways = {bool(x > 0) for x in along}
    words: dict[str, object] = {
        "count": len(along),
        "measured": WORDS[ways.pop()] if len(ways) == 1 else "both ways",
        "said": _who(by_table),
        "also": "",
    }
    gyros = 'write "-" before each of `columns` in [log.gyro]'
    if not by_table:
        words["cure"] = (
            f"Either the table turned the other way: change the sign of the spin rate in "
            f"[procedure]. Or the gyros are reversed: {gyros}."
        )
        return words
    told = planned != 0
    column = 'write "-" before the outer column (and rate) of [log.table]'
    words["cure"] = f"Either the table counts the wrong way round: {column}. Or the gyros are "
    words["cure"] = f"{words['cure']}reversed: {gyros}."
    if told.any() and (along[told] * planned[told] > 0).all():
        words["also"] = " The plan says the same as the gyros."
        words["cure"] = (
            f"Probably the table counts the wrong way round: {column}. If not, plan and gyros are "
            f"both reversed: {gyros}, and change the sign of the spin rate in [procedure]."
        )
    elif told.any() and (along[told] * planned[told] < 0).all():
        words["also"] = " The plan says the same as the log."
        words["cure"] = (
            f"Probably the gyros are reversed: {gyros}. If not, the table counts the wrong way "
            f"round: {column}, and change the sign of the spin rate in [procedure]."
        )
    return words


def _up(readings: Readings, plan: TablePlan | None, found: Match | None) -> FloatArray:
    """Return up in each reading by the accelerometers, else by the plan or the table."""
    if readings.accel is not None:
        return directions(readings)
    up = up_k(readings.angles)
    if plan is not None and found is not None:
        some = found.row >= 0
        up[some] = up_k(plan.angles)[found.row[some]] @ found.rotation.T
    return np.asarray(up)


def _rates(rate: FloatArray, planned: FloatArray, table_rate_sd: float | None) -> list[Finding]:
    some = planned != 0
    if not some.any():
        return []
    ratio = np.abs(rate[some] / planned[some])
    measured, told = np.median(np.abs(rate[some])), np.median(np.abs(planned[some]))
    words = {k: plain(np.degrees(v), 6) for k, v in (("told", told), ("measured", measured))}
    if table_rate_sd is None:  # of a plan that the table need not have followed
        as_planned = 1 / OTHER_RATE < measured / told < OTHER_RATE
        return [] if as_planned else [finding("spin.rate_plan", **words)]
    off = float(np.median(ratio)) - 1.0
    spread = 1.4826 * float(np.median(np.abs(ratio - np.median(ratio)))) / np.sqrt(len(ratio))
    sd = float(np.sqrt(max(table_rate_sd, RATE_TOLERANCE) ** 2 + spread**2))
    if abs(off) <= BEYOND * sd:
        return []
    return [finding("spin.rate_clock", ppm=f"{off * 1e6:+.0f}", sd=f"{sd * 1e6:.0f}", **words)]
