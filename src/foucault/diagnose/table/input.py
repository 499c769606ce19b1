"""What can be wrong with readings taken on a table before anything is estimated.

Directions of gravity must be those of the table angles, and the gyros must turn the way the table
does. Tables are wrong by a degree at most and raw instruments by a few, so that a larger misfit is
a mistake; the usual ones are tried in turn and named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.diagnose.positions import match as position_match
from foucault.diagnose.positions.match import SMALL, Match, directions, rotation, turned
from foucault.diagnose.positions.senses import numbered, senses
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.models.readings import Readings
from foucault.models.turntable import TablePlan, up_k
from foucault.tables import Log, TableColumns
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

FITS = np.radians(15.0)
"""Directions that miss by less at the median fit [rad]."""

AGAIN = np.radians(3.0)
"""A reading this near to a position that was read before is a repetition [rad]."""

Miss = Callable[[FloatArray, float], float]
"""How far directions miss, given angles and the sign of the accelerometers [rad]."""

NAMES = ("outer", "middle", "inner")


def check_readings(
    readings: Readings,
    plan: TablePlan | None,
    log: Log | LogDescription | None = None,
    *,
    angles_matter: bool = True,
    shortest: float = 1.0,
    table_rate_sd: float | None = None,
) -> Readings:
    """Refuse readings that cannot be right, and tell what is odd about the others.

    `readings`: what `find_readings` has found [SI]; `plan` or None: what the table was told to
    do; `log` or None: the log, or what is known of it: whether it has table angles and rates of
    its own [SI]; `angles_matter`: whether table angles are used, if not, neither other positions
    than planned nor an instrument mounted turned are a mistake; `shortest`: length that was asked
    of a rest, for the texts [s]; `table_rate_sd` or None: relative sd of the rate of the plan,
    where it was declared, the outer angle over the time of the log is held against it then [1].
    Returns the same with more findings; spins have the sense that the gyros measure, repeated
    positions the angles of the plan [SI]. Raises angles in the wrong order or unit, an instrument
    mounted turned or upside down, gyros and table that turn in opposite senses.
    """
    up = directions(readings)
    usable = np.isfinite(up).all(axis=1)
    own, by_table = _told(log, plan)
    logged = np.asarray(usable & np.isfinite(readings.angles[:, 1:]).all(axis=1) & own, bool)
    findings, found, row = list[Finding](), None, None
    if readings.accel is not None and logged.sum() > 2:
        findings += _angles_fit(up[logged], readings.angles[logged], angles_matter)
        if findings:
            readings = replace(readings, angles=np.full_like(readings.angles, np.nan))
            logged = np.zeros(len(readings), bool)
    if plan is not None and usable.any():
        known = readings.gyro is not None or bool(readings.spin.any())
        found = position_match.with_plan(readings, plan, known, free=not angles_matter)
        matter = angles_matter and logged.sum() <= 2
        if readings.accel is None:
            if not found.ordered or (found.row < 0).any():
                found = _perhaps_reversed(readings, found, plan)
        elif not _plan_fits(readings, found, plan, matter):
            findings.append(finding("positions.other", used=USED[angles_matter]))
            angles = np.where(logged[:, None], readings.angles, np.nan)
            readings, found = replace(readings, angles=angles), None
    if plan is not None and found is not None:
        row = _with_repeats(readings, plan, found)
        left_out: BoolArray = np.zeros(len(readings), bool)
        if not own:
            readings = _with_angles(readings, plan, row)
            if angles_matter:
                left_out = np.asarray(np.isnan(readings.angles[:, 1:]).any(axis=1))
        findings += _matching(readings, plan, found, row, left_out, shortest)
    timed = readings.interval > 0 and _outer(log)
    readings, more = senses(readings, plan, found, row, by_table, table_rate_sd if timed else None)
    if row is not None and left_out.any():
        readings = readings[~left_out]
    return replace(readings, findings=readings.findings + tuple(findings + more))


USED = {
    True: "The table angles of the log were used.",
    False: "The procedure needs no angles and goes on without those of the plan.",
}
"""What was done about positions that are not those of the plan, by whether angles matter."""


def _told(log: Log | LogDescription | None, plan: TablePlan | None) -> tuple[bool, bool]:
    """Tell whether the log has middle and inner angles, and whether it has rates, of its own."""
    if log is None:
        return True, plan is None
    table = log.table
    if table is None:
        return False, False
    if isinstance(table, TableColumns):
        seen = np.isfinite(table.angles)
        return bool(seen[:, 1:].any()), bool(seen[:, 0].any()) or table.rate is not None
    names = [c not in (None, "") for c in table.columns or (None, None, None)]
    return any(names[1:]), names[0] or table.rate is not None


def _outer(log: Log | LogDescription | None) -> bool:
    """Tell whether the log has the outer angle."""
    table = None if log is None else log.table
    if table is None:
        return False
    if isinstance(table, TableColumns):
        return bool(np.isfinite(table.angles[:, 0]).any())
    columns = table.columns
    return columns is not None and columns[0] is not None and columns[0] != ""


def enough_readings(readings: Readings, rests: int, spins: int, what: str = "") -> None:
    """Refuse fewer readings than coefficients.

    `readings`: what was found [SI]; `rests`, `spins`: how many directions of each are needed [1];
    `what`: more words for the text, where there is more to tell.
    """
    spin = readings.spin
    # A spin tells the direction of gravity too.
    for given, needed, words in ((len(spin), rests, "rests and spins"),
                                 (int(spin.sum()), spins, "spins")):  # fmt: skip
        if given < needed:
            raise error(
                "readings.too_few", given=given, needed=needed, what=words, hint=what and " " + what
            )


def _miss(up: FloatArray, nominal: FloatArray) -> tuple[float, FloatArray]:
    """Return how far directions miss after the best rotation, and that rotation."""
    C = rotation(up, nominal)
    cosine = np.clip((up * (nominal @ C.T)).sum(axis=1), -1.0, 1.0)
    return float(np.median(np.arccos(cosine))), C


def _near(up: FloatArray, nominal: FloatArray) -> float:
    """Return how far directions miss if the instrument is mounted as planned [rad]."""
    off, C = _miss(up, nominal)
    if turned(C) < SMALL:
        return off
    return float(np.median(np.arccos(np.clip((up * nominal).sum(axis=1), -1.0, 1.0))))


def _angles_fit(up: FloatArray, angles: FloatArray, matter: bool) -> list[Finding]:
    """Compare directions with the angles of the log; refuse them, or go on without them."""
    given = _near(up, up_k(angles))
    off, C = _miss(up, up_k(angles))
    if given < FITS or (off < FITS and not matter):
        return []
    turned_too = " An instrument mounted turned looks the same." if off < FITS else ""
    cure = LOGGED + turned_too
    problem = _named(given, lambda A, sign: _near(sign * up, up_k(A)), angles, cure)
    if problem is None and off < FITS:
        problem = _mounted(C)
    said = f"{np.degrees(given):.0f}"
    if problem is None and not matter:
        return [finding("table.unused", given=said)]
    raise problem or error("table.directions", given=said)


def _plan_fits(readings: Readings, found: Match, plan: TablePlan, matter: bool) -> bool:
    """Tell whether readings are in positions of the plan, and name the mistake if it matters.

    Regular plans fit themselves upside down or turned, only in another order: what keeps the order
    is the better explanation.
    """
    fits = position_match.fits(found, len(plan))
    as_planned = turned(found.rotation) < SMALL
    if found.ordered and fits and (as_planned or not matter):
        return True
    up, nominal_spin = directions(readings), plan.rate != 0

    def miss(angles: FloatArray, sign: float) -> float:
        nominal = up_k(angles)
        spin = readings.spin
        row = position_match.match(sign * up, spin, nominal, nominal_spin, in_order=True).row
        some = row >= 0
        if some.mean() < 0.8:
            return float(np.pi / 2)
        return _near(sign * up[some], nominal[row[some]])

    if miss(plan.angles, -1.0) < FITS:
        raise error("table.gravity")
    if not matter:
        return fits
    problem = _named(float(np.pi / 2), miss, plan.angles, PLANNED)
    if problem is None and fits and not as_planned:
        problem = _mounted(found.rotation)
    if problem is None and not fits:
        problem = error("table.directions", given="25 or more")
    if problem is not None:
        raise problem
    return True


def _perhaps_reversed(readings: Readings, found: Match, plan: TablePlan) -> Match:
    """Match gyros without accelerometers as if they were reversed, if that keeps the order."""
    up, nominal, spin = directions(readings), up_k(plan.angles), plan.rate != 0
    other = position_match.match(-up, readings.spin, nominal, spin, in_order=True)
    same = position_match.match(up, readings.spin, nominal, spin, in_order=True)
    return other if (other.row >= 0).sum() > (same.row >= 0).sum() else found


LOGGED = (
    'Correct `columns` of [log.table] like that ("-" before a name flips it); if they are right, '
    "check order and signs of `columns` in [log.accel]."
)
PLANNED = (
    "Correct the order and the signs of the angles in `plan` or `positions` of [procedure]: outer, "
    "middle, inner."
)
"""What to do about angles in the wrong order, where the log has them and where it has not."""


def _named(given: float, miss: Miss, angles: FloatArray, cure: str) -> FoucaultError | None:
    """Try the usual mistakes, the simplest first; return the first that explains the directions."""
    if miss(angles, -1.0) < FITS:
        return error("table.gravity")
    said = {"given": f"{np.degrees(given):.0f}"}
    for factor, unit in ((np.radians(1.0), "deg"), (np.degrees(1.0), "rad")):
        off = miss(angles * factor, 1.0)
        if off < FITS:
            return error("table.unit", factor=plain(factor, 4), likely=unit,
                         better=f"{np.degrees(off):.1f}", **said)  # fmt: skip
    orders = [(order, signs) for signs in product((1, -1), repeat=2)
              for order in permutations(range(3))]  # fmt: skip
    orders.sort(key=lambda o: (sum(s < 0 for s in o[1]), sum(i != k for i, k in enumerate(o[0]))))
    for order, signs in orders[1:]:
        tried = angles[:, order] * np.array([1, *signs])
        if not np.isfinite(tried[:, 1:]).all():  # an angle that the log does not have
            continue
        off = miss(tried, 1.0)
        if off < FITS:
            names = [("-" if s < 0 else "") + NAMES[k]
                     for k, s in zip(order, (1, *signs), strict=True)]  # fmt: skip
            hint = ""
            if order == (0, 1, 2) and "mounted" not in cure:
                hint = " An instrument mounted the other way round on the table looks the same."
            return error("table.order", exchange=", ".join(names), cure=cure, hint=hint,
                         better=f"{np.degrees(off):.1f}", **said)  # fmt: skip
    return None


def _mounted(C: FloatArray) -> FoucaultError:
    along = []
    for row in C:  # a body axis in case axes
        k = int(np.argmax(np.abs(row)))
        along.append(("-" if row[k] < 0 else "") + ("middle", "inner", "outer")[k])
    angle = f"{np.degrees(turned(C)):.0f}"
    return error("table.mounting", angle=angle, axes=", ".join(along))


def _with_repeats(readings: Readings, plan: TablePlan, found: Match) -> IntArray:
    """Return the position of each reading, also of those that repeat one or turn the other way."""
    row, up = found.row.copy(), directions(readings)
    nominal = up_k(plan.angles)
    apart = position_match.off(found, up, nominal)
    usual = float(np.median(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else 0.0
    same_kind = readings.spin[:, None] == (plan.rate != 0)[None, :]
    cosine = np.where(same_kind, up @ (nominal @ found.rotation.T).T, -2.0)
    for k in np.flatnonzero((row < 0) & np.isfinite(up).all(axis=1)):
        best = int(np.argmax(cosine[k]))
        if cosine[k, best] > np.cos(max(AGAIN, 3 * usual)):
            row[k] = best
    return row


def _with_angles(readings: Readings, plan: TablePlan, row: IntArray) -> Readings:
    """Fill in the angles of the plan where the log has none."""
    planned = np.where((row >= 0)[:, None], plan.angles[row], np.nan)
    angles = np.where(np.isnan(readings.angles), planned, readings.angles)
    return replace(readings, angles=angles)


def _matching(
    readings: Readings,
    plan: TablePlan,
    found: Match,
    row: IntArray,
    left_out: BoolArray,
    shortest: float,
) -> list[Finding]:
    """Tell positions that are missing, repeated or extra, and another order."""
    out = []
    missing = found.unused(len(plan))
    if len(missing):
        which = _list([_position(plan, int(k)) for k in missing])
        out.append(
            finding(
                "positions.missing", count=len(missing), planned=len(plan), which=which,
                shortest=f"{shortest:g}",
            )
        )  # fmt: skip
    more = found.row < 0
    # A spin in the other sense is no repetition: the senses are told apart from this.
    ways = {(int(j), bool(r > 0)) for j, r in zip(found.row, readings.rate, strict=True)}
    again = [
        k
        for k in np.flatnonzero(more & (row >= 0))
        if readings.rate[k] == 0 or (int(row[k]), bool(readings.rate[k] > 0)) in ways
    ]
    if again:
        words = [f"{_position(plan, int(row[k]))} ({numbered(readings, np.array([k]))})"
                 for k in again]  # fmt: skip
        out.append(finding("positions.repeated", which=_list(words)))
    for code, some in (("positions.extra", ~left_out), ("positions.left_out", left_out)):
        others = np.flatnonzero(more & (row < 0) & some)
        if len(others):
            out.append(finding(code, which=numbered(readings, others)))
    if not found.ordered and not _each_in_order(readings, found):
        out.append(finding("positions.order"))
    return out


def _each_in_order(readings: Readings, found: Match) -> bool:
    """Tell whether rests and spins are each in the order of the plan, if not one after another."""
    return all(
        bool(np.all(np.diff(found.row[(found.row >= 0) & kind]) > 0))
        for kind in (readings.spin, ~readings.spin)
    )


def _position(plan: TablePlan, k: int) -> str:
    outer, middle, inner = (plain(float(np.degrees(a)), 4) for a in plan.angles[k])
    spin = ", spin" if plan.rate[k] else ""
    return f"number {k + 1} (outer {outer}, middle {middle}, inner {inner} deg{spin})"


def _list(words: list[str], most: int = 6) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
