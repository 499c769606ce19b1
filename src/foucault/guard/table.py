"""What can be wrong with readings taken on a table before anything is estimated.

Directions of gravity must be those of the table angles, and the gyros must turn about them the way
the table does. Tables are wrong by a degree at most and raw instruments by a few, so that a larger
misfit is a mistake; the usual ones are tried in turn and named. Only directions count: scale factor
errors and misalignments turn them by a degree, an exchange of axes by many.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect import match
from foucault.detect.match import SMALL, Match, directions, rotation, turned
from foucault.detect.spins import OTHER_RATE
from foucault.detect.table import bias_across
from foucault.errors import Finding, FoucaultError, error, finding, listed
from foucault.guard.mistakes import (
    DEGREE,
    NONE,
    Explained,
    Mistake,
    columns,
    exchange_words,
    exchanges,
    explain,
    plainly,
)
from foucault.models.noise import Readings
from foucault.models.turntable import TablePlan, up_k
from foucault.tables import Log, TableColumns
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

FITS = np.radians(15.0)
"""Directions that miss by less at the median fit [rad]."""

AGAIN = np.radians(3.0)
"""A reading this near to a position that was read before is a repetition [rad]."""

SUSPICIOUS, EXPLAINED = np.radians(20.0), np.radians(5.0)
"""A miss of up by the rates of spins that no calibration error explains, and one that such errors
do, rms [rad]."""

MOST = 0.85
"""So many of the spins have to agree; the sense of some may be unknown [1]."""

SLOW = 20.0
"""Spins slower than this multiple of the rates at rest tell no directions [1]."""

RATE_TOLERANCE = 1e-4
"""A table holds the rate that it was told to this, as sd, where nothing else is declared [1]."""

BEYOND = 3.0
"""So many sd of the table's rate are no chance [1]."""

NAMES = ("outer", "middle", "inner")
USED = {
    True: "The table angles of the log were used.",
    False: "The procedure needs no angles and goes on without those of the plan.",
}
"""What was done about positions that are not those of the plan, by whether angles matter."""

LOGGED = (
    'Correct `columns` of [log.table] like that ("-" before a name flips it); if they are right, '
    "check order and signs of `columns` in [log.accel]."
)
PLANNED = (
    "Correct the order and the signs of the angles in `plan` or `positions` of [procedure]: outer, "
    "middle, inner."
)
"""What to do about angles in the wrong order, where the log has them and where it has not."""


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
    of a rest, for the texts [s]; `table_rate_sd` or None: relative sd of the rate of the plan [1];
    where it was declared the outer angle over the time of the log is held against it.
    Returns the same with more findings; spins have the sense that the gyros measure, repeated
    positions the angles of the plan [SI]. Raises angles in the wrong order or unit, an instrument
    mounted turned or upside down, gyros and table that turn in opposite senses.
    """
    up = directions(readings)
    usable = np.isfinite(up).all(axis=1)
    outer, own, rated = _has(log)
    by_table = plan is None if log is None else outer or rated
    logged = np.asarray(usable & np.isfinite(readings.angles[:, 1:]).all(axis=1) & own, bool)
    findings, found, row = list[Finding](), None, None
    if readings.accel is not None and logged.sum() > 2:
        findings += _angles_fit(up[logged], readings.angles[logged], angles_matter)
        if findings:
            readings = replace(readings, angles=np.full_like(readings.angles, np.nan))
            logged = np.zeros(len(readings), bool)
    if plan is not None and usable.any():
        known = readings.gyro is not None or bool(readings.spin.any())
        found = match.with_plan(readings, plan, known, free=not angles_matter)
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
        if not own:  # the angles of the plan where the log has none
            planned = np.where((row >= 0)[:, None], plan.angles[row], np.nan)
            angles = np.where(np.isnan(readings.angles), planned, readings.angles)
            readings = replace(readings, angles=angles)
            if angles_matter:
                left_out = np.asarray(np.isnan(readings.angles[:, 1:]).any(axis=1))
        findings += _matching(readings, plan, found, row, left_out, shortest)
    timed = readings.interval > 0 and outer
    readings, more = senses(readings, plan, found, row, by_table, table_rate_sd if timed else None)
    readings = replace(readings, rate_logged=by_table and log is not None)
    if row is not None and left_out.any():
        readings = readings[~left_out]
    return replace(readings, findings=readings.findings + tuple(findings + more))


def _has(log: Log | LogDescription | None) -> tuple[bool, bool, bool]:
    """Tell whether a log has the outer angle, other angles, and rates of the table."""
    if log is None:
        return False, True, False
    table = log.table
    if table is None:
        return False, False, False
    if isinstance(table, TableColumns):
        seen = np.isfinite(table.angles)
        return bool(seen[:, 0].any()), bool(seen[:, 1:].any()), table.rate is not None
    names = [c not in (None, "") for c in table.columns or (None, None, None)]
    return names[0], any(names[1:]), table.rate is not None


def enough_readings(readings: Readings, rests: int, spins: int) -> None:
    """Refuse fewer readings than coefficients: so many `rests`, `spins` are needed [1]."""
    spin = readings.spin
    # A spin tells the direction of gravity too.
    for given, needed, words in ((len(spin), rests, "rests and spins"),
                                 (int(spin.sum()), spins, "spins")):  # fmt: skip
        if given < needed:
            raise error("readings.too_few", given=given, needed=needed, what=words, hint="")


# -- angles --------------------------------------------------------------------------------------


def _near(up: FloatArray, nominal: FloatArray) -> float:
    """Return how far directions miss if the instrument is mounted as planned [rad]."""
    off, C = _turned(up, nominal)
    return off if turned(C) < SMALL else _off(up, nominal)


def _turned(up: FloatArray, nominal: FloatArray) -> tuple[float, FloatArray]:
    """Return how far directions miss after the best rotation, and that rotation."""
    C = rotation(up, nominal)
    return _off(up, nominal @ C.T), C


def _off(up: FloatArray, nominal: FloatArray) -> float:
    return float(np.median(np.arccos(np.clip((up * nominal).sum(axis=1), -1.0, 1.0))))


def _angles_fit(up: FloatArray, angles: FloatArray, matter: bool) -> list[Finding]:
    """Compare directions with the angles of the log; refuse them, or go on without them."""
    off, C = _turned(up, up_k(angles))
    given = off if turned(C) < SMALL else _off(up, up_k(angles))
    if given < FITS or (off < FITS and not matter):
        return []

    def miss(mistake: Mistake) -> float:
        return _near(mistake.right(up, "accel"), up_k(mistake.right(angles, "angles")))

    cure = LOGGED + (" An instrument mounted turned looks the same." if off < FITS else "")
    problem = _named(miss, given, angles, cure) or (_mounted(C) if off < FITS else None)
    said = f"{np.degrees(given):.0f}"
    if problem is None and not matter:
        return [finding("table.unused", given=said)]
    raise problem or error("table.directions", given=said)


def _plan_fits(readings: Readings, found: Match, plan: TablePlan, matter: bool) -> bool:
    """Tell whether readings are in positions of the plan, and name the mistake if it matters.

    Regular plans fit themselves upside down or turned, only in another order: what keeps the order
    is the better explanation.
    """
    fits = match.fits(found, len(plan))
    as_planned = turned(found.rotation) < SMALL
    if found.ordered and fits and (as_planned or not matter):
        return True
    up, nominal_spin = directions(readings), plan.rate != 0

    def miss(mistake: Mistake) -> float:
        seen, nominal = mistake.right(up, "accel"), up_k(mistake.right(plan.angles, "angles"))
        row = match.match(seen, readings.spin, nominal, nominal_spin, in_order=True).row
        some = row >= 0
        return float(np.pi / 2) if some.mean() < 0.8 else _near(seen[some], nominal[row[some]])

    if miss(UPSIDE_DOWN) < FITS:
        raise error("table.gravity")
    if not matter:
        return fits
    problem = _named(miss, float(np.pi / 2), plan.angles, PLANNED)
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
    other, same = (
        match.match(sign * up, readings.spin, nominal, spin, in_order=True) for sign in (-1.0, 1.0)
    )
    return other if (other.row >= 0).sum() > (same.row >= 0).sum() else found


UPSIDE_DOWN = Mistake(exchange=-np.eye(3), of="accel", code="table.gravity")


def _of_angles() -> list[Mistake]:
    """Return the usual mistakes of table angles, the simplest first."""
    orders = [
        (order, (1, *signs)) for signs in product((1, -1), repeat=2)
        for order in permutations(range(3))
    ]  # fmt: skip
    orders.sort(key=lambda o: (sum(s < 0 for s in o[1]), sum(i != k for i, k in enumerate(o[0]))))
    return [
        UPSIDE_DOWN,
        Mistake("deg", DEGREE, of="angles", code="table.unit"),
        Mistake("rad", 1 / DEGREE, of="angles", code="table.unit"),
        *(
            Mistake(exchange=np.eye(3)[list(order)] * np.array(signs)[:, None], of="angles",
                    code="table.order")
            for order, signs in orders[1:]
        ),
    ]  # fmt: skip


def _named(
    miss: Callable[[Mistake], float], given: float, angles: FloatArray, cure: str
) -> FoucaultError | None:
    """Return the simplest of the usual mistakes that explains the directions."""
    # Not with an angle that the log does not have in the place of another.
    tried = [m for m in _of_angles() if np.isfinite(m.right(angles, "angles")[:, 1:]).all()]
    by = explain(miss, tried, wrong=0.0, fits=FITS, within=FITS, now=given).by
    if not by:
        return None
    likely = by[0]
    said = {"given": f"{np.degrees(given):.0f}", "better": f"{np.degrees(miss(likely)):.1f}"}
    if likely.code == "table.unit":
        return error("table.unit", factor=plain(likely.factor, 4), likely=likely.words, **said)
    names = ", ".join(columns(likely.exchange, NAMES))
    hint = ""
    if np.array_equal(np.abs(likely.exchange), np.eye(3)) and "mounted" not in cure:
        hint = " An instrument mounted the other way round on the table looks the same."
    return error(likely.code, exchange=names, cure=cure, hint=hint, **said)


def _mounted(C: FloatArray) -> FoucaultError:
    axes = ", ".join(columns(C, ("middle", "inner", "outer")))  # of each body axis
    return error("table.mounting", angle=f"{np.degrees(turned(C)):.0f}", axes=axes)


# -- positions of a plan -------------------------------------------------------------------------


def _with_repeats(readings: Readings, plan: TablePlan, found: Match) -> IntArray:
    """Return the position of each reading, also of those that repeat one or turn the other way."""
    row, up, nominal = found.row.copy(), directions(readings), up_k(plan.angles)
    apart = match.off(found, up, nominal)
    usual = float(np.median(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else 0.0
    same_kind = readings.spin[:, None] == (plan.rate != 0)[None, :]
    cosine = np.where(same_kind, up @ (nominal @ found.rotation.T).T, -2.0)
    for k in np.flatnonzero((row < 0) & np.isfinite(up).all(axis=1)):
        best = int(np.argmax(cosine[k]))
        if cosine[k, best] > np.cos(max(AGAIN, 3 * usual)):
            row[k] = best
    return row


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
        which = listed([_position(plan, int(k)) for k in missing], 6)
        out.append(finding("positions.missing", count=len(missing), planned=len(plan), which=which,
                           shortest=f"{shortest:g}"))  # fmt: skip
    more = found.row < 0
    # A spin in the other sense is no repetition: the senses are told apart from this.
    ways = {(int(j), bool(r > 0)) for j, r in zip(found.row, readings.rate, strict=True)}
    again = [
        f"{_position(plan, int(row[k]))} ({numbered(readings, np.array([k]))})"
        for k in np.flatnonzero(more & (row >= 0))
        if readings.rate[k] == 0 or (int(row[k]), bool(readings.rate[k] > 0)) in ways
    ]
    if again:
        out.append(finding("positions.repeated", which=listed(again, 6)))
    for code, some in (("positions.extra", ~left_out), ("positions.left_out", left_out)):
        others = np.flatnonzero(more & (row < 0) & some)
        if len(others):
            out.append(finding(code, which=numbered(readings, others)))
    # Rests and spins may each be in the order of the plan, if not one after another.
    each = (found.row[(found.row >= 0) & kind] for kind in (readings.spin, ~readings.spin))
    if not found.ordered and not all(np.all(np.diff(rows) > 0) for rows in each):
        out.append(finding("positions.order"))
    return out


def _position(plan: TablePlan, k: int) -> str:
    outer, middle, inner = (plain(float(np.degrees(a)), 4) for a in plan.angles[k])
    spin = ", spin" if plan.rate[k] else ""
    return f"number {k + 1} (outer {outer}, middle {middle}, inner {inner} deg{spin})"


def numbered(readings: Readings, which: IntArray) -> str:
    """Name `which` (k,) readings [1] as the report does, numbered from 1 among rests or spins."""
    spin = readings.spin
    words = [
        f"{'spin' if spin[k] else 'rest'} {int(np.sum(spin[: k + 1] == spin[k]))} "
        f"({plain(readings.start[k], 5)} s)"
        for k in which
    ]
    return listed(words, 6)


# -- gyro axes -----------------------------------------------------------------------------------


def check_gyro_axes(readings: Readings) -> None:
    """Refuse readings whose gyro axes are exchanged or of the wrong sign.

    The mean rate over whole turns of a spin lies along up, as the mean specific force does, in the
    sense in which the table turned. All three gyros reversed look like a table that turns the other
    way and are left to `senses`.

    `readings`: one mean per rest and spin, the rates with the sense that the table or the plan
    says [SI]. Raises one exchange of gyro axes explains the spins, and the declared axes do not.
    """
    spin = readings.spin
    if readings.gyro is None or readings.accel is None or not spin.any():
        return
    rest = readings.gyro[~spin]
    bias = np.median(rest, axis=0) if len(rest) else np.zeros(3)
    w = readings.gyro[spin] - bias
    still = float(np.median(np.linalg.norm(rest - bias, axis=1))) if len(rest) else 0.0
    if np.median(np.linalg.norm(w, axis=1)) < SLOW * still:
        return
    seen = explain_spins(readings.accel[spin], w, readings.rate[spin])
    # One alone; the axes as declared but for some spins, or all reversed, are none.
    E = seen.by[0].exchange if len(seen.by) == 1 else np.eye(3)
    if np.array_equal(np.abs(E), np.eye(3)) and abs(np.trace(E)) == 3:
        return
    raise error(
        "spin.left_handed" if seen.by[0].left_handed else "spin.axes", what=plainly(E),
        exchange=exchange_words(E), declared=f"{np.degrees(seen.now):.0f}",
        better=f"{np.degrees(seen.least):.1f}",
    )  # fmt: skip


def explain_spins(f: FloatArray, w: FloatArray, h: FloatArray) -> Explained:
    """Compare the directions of rates and specific forces under all exchanges of gyro axes.

    `f` (n, 3): mean specific force of each spin [m/s^2]; `w` (n, 3): mean rate of each spin,
    without bias [rad/s]; `h` (n,): rate of the table, positive counter-clockwise seen from above
    [rad/s].
    """
    up, axis = (x / np.maximum(np.linalg.norm(x, axis=1), 1e-300)[:, None] for x in (f, w))
    most = max(1, round(MOST * len(h)))

    def miss(mistake: Mistake, most: int = most) -> float:
        cosine = np.sum(mistake.right(axis) * np.sign(h)[:, None] * up, axis=1)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        return float(np.sqrt(np.mean(np.sort(angle)[:most] ** 2)))

    tried = [Mistake(exchange=exchange) for exchange in exchanges()]
    now = miss(NONE, len(h))
    return explain(miss, tried, wrong=SUSPICIOUS, fits=EXPLAINED, within=SUSPICIOUS, now=now)


# -- sense and rate of spins ---------------------------------------------------------------------


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
    up = up_k(readings.angles)  # by the accelerometers, else by the plan or the table
    if readings.accel is not None:
        up = directions(readings)
    elif plan is not None and found is not None:
        some = found.row >= 0
        up[some] = up_k(plan.angles)[found.row[some]] @ found.rotation.T
    bias = np.zeros(3)
    if np.isfinite(up).all():
        bias = bias_across(readings.gyro, up, readings.time)
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
        raise _all_other(along[known], planned[known], by_table)
    if other.any():
        who = _who(by_table or plan is None)
        out.append(finding("spin.sense_some", count=int(other.sum()), spins=len(spin), said=who,
                           which=numbered(readings, spin[other])))  # fmt: skip
    rates = readings.rate.copy()
    rates[spin[known]] = np.copysign(rate[known], along[known])
    readings = replace(readings, rate=rates)
    if plan is not None:
        out += rate_findings(readings.rate[spin], planned, table_rate_sd)
    return readings, out


def _who(by_table: bool) -> str:
    return "the outer column (or rate) of the log" if by_table else "the plan"


def _all_other(along: FloatArray, planned: FloatArray, by_table: bool) -> FoucaultError:
    """Blame the table, the plan or the gyros for spins that all have the other sense."""
    ways = {True: "counter-clockwise", False: "clockwise"}
    seen = {ways[bool(x > 0)] for x in along}
    gyros = 'write "-" before each of `columns` in [log.gyro]'
    column = 'write "-" before the outer column (and rate) of [log.table]'
    plan, also = "change the sign of the spin rate in [procedure]", ""
    told = planned != 0
    if not by_table:
        cure = f"Either the table turned the other way: {plan}. Or the gyros are reversed: {gyros}."
    elif told.any() and (along[told] * planned[told] > 0).all():
        also = " The plan says the same as the gyros."
        cure = (
            f"Probably the table counts the wrong way round: {column}. If not, plan and gyros are "
            f"both reversed: {gyros}, and {plan}."
        )
    elif told.any() and (along[told] * planned[told] < 0).all():
        also = " The plan says the same as the log."
        cure = (
            f"Probably the gyros are reversed: {gyros}. If not, the table counts the wrong way "
            f"round: {column}, and {plan}."
        )
    else:
        cure = (
            f"Either the table counts the wrong way round: {column}. Or the gyros are reversed: "
            f"{gyros}."
        )
    measured = seen.pop() if len(seen) == 1 else "both ways"
    return error("spin.sense", count=len(along), measured=measured, said=_who(by_table),
                 also=also, cure=cure)  # fmt: skip


def rate_columns(log: Log, readings: Readings, table_rate_sd: float) -> list[Finding]:
    """Compare the rate of the table in a log with its angle over the time, where it has both.

    `readings`: those of `log`, spins at the rate of the angle [SI]; `table_rate_sd`: relative sd
    of the rate [1].
    """
    table, spin = log.table, readings.spin
    if log.averaged is not None or table is None or table.rate is None:
        return []
    if not np.isfinite(table.angles[:, 0]).any():
        return []
    start, end = readings.start[spin], readings.start[spin] + readings.time[spin]
    rows = np.searchsorted(log.time, [start, end]).T
    said = np.array([np.median(table.rate[a : max(a + 1, b)]) for a, b in rows])
    return rate_findings(readings.rate[spin], np.nan_to_num(said), table_rate_sd, "table.two_rates")


def rate_findings(
    rate: FloatArray, planned: FloatArray, table_rate_sd: float | None,
    code: str = "spin.rate_clock",
) -> list[Finding]:  # fmt: skip
    """Compare `rate` (n,) [rad/s] with `planned` (n,), 0 for none, and `table_rate_sd` [1]."""
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
    return [finding(code, ppm=f"{off * 1e6:+.0f}", sd=f"{sd * 1e6:.0f}", **words)]
