"""What can be wrong with readings taken on a table before anything is estimated.

Directions of gravity must be those of the table angles, and the gyros must turn the way the table
does. Tables are wrong by a degree at most and raw instruments by a few, so that a larger misfit is
a mistake; the usual ones are tried in turn and named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from foucault.diagnose import position_match, position_rates
from foucault.diagnose.position_choice import OTHER_RATE
from foucault.diagnose.position_match import SMALL, Match, directions, rotation, turned
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.models.readings import Readings
from foucault.models.turntable import TablePlan, up_k
from foucault.tables import Log
from foucault.units import plain

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

FITS = np.radians(15.0)
"""Directions that miss by less at the median fit [rad]."""

Miss = Callable[[FloatArray, float], float]
"""How far directions miss, given angles and the sign of the accelerometers [rad]."""

NAMES = ("outer", "middle", "inner")


def check_readings(
    readings: Readings,
    plan: TablePlan | None,
    log: Log | None = None,
    *,
    angles_matter: bool = True,
    shortest: float = 1.0,
) -> Readings:
    """Refuse readings that cannot be right, and tell what is odd about the others.

    Parameters
    ----------
    readings : Readings
        What `find_readings` has found [SI].
    plan : TablePlan or None
        What the table was told to do.
    log : Log or None
        The log, where it is at hand: whether it has table angles of its own [SI].
    angles_matter : bool
        Whether table angles are used; if not, an instrument mounted turned is no mistake.
    shortest : float
        Length that was asked of a rest, for the texts [s].

    Returns
    -------
    Readings
        The same with more findings; spins have the sense that the gyros measure [SI].

    Raises
    ------
    FoucaultError
        Angles in the wrong order or unit, an instrument mounted turned or upside down, gyros and
        table that turn in opposite senses.
    """
    up = directions(readings)
    usable = np.isfinite(up).all(axis=1)
    logged = usable & _logged(readings, log)
    if readings.accel is not None and logged.sum() > 2:
        _angles_fit(up[logged], readings.angles[logged], angles_matter)
    findings, found = list[Finding](), None
    if plan is not None and usable.any():
        spins_known = readings.gyro is not None or bool(readings.spin.any())
        found = position_match.with_plan(readings, plan, spins_known)
        if readings.accel is not None:
            _plan_fits(readings, found, plan, angles_matter)
        elif not found.ordered or (found.row < 0).any():
            found = _perhaps_reversed(readings, found, plan)
        findings += _matching(readings, plan, found, shortest)
    readings, more = _senses(readings, plan, found)
    return replace(readings, findings=readings.findings + tuple(findings + more))


def _logged(readings: Readings, log: Log | None) -> BoolArray:
    """Tell which readings have middle and inner angles of their own, not those of the plan."""
    if log is not None and (log.table is None or np.isnan(log.table.angles[:, 1:]).all()):
        return np.zeros(len(readings), bool)
    return np.asarray(np.isfinite(readings.angles[:, 1:]).all(axis=1))


def enough_readings(readings: Readings, rests: int, spins: int, what: str = "") -> None:
    """Refuse fewer readings than coefficients.

    Parameters
    ----------
    readings : Readings
        What was found [SI].
    rests, spins : int, shape ()
        How many directions of each are needed [1].
    what : str
        More words for the text, where there is more to tell.
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


def _angles_fit(up: FloatArray, angles: FloatArray, matter: bool) -> None:
    given = _near(up, up_k(angles))
    if given < FITS:
        return
    problem = _named(given, lambda A, sign: _near(sign * up, up_k(A)), angles)
    off, C = _miss(up, up_k(angles))
    if problem is None and off < FITS:
        if not matter:
            return
        problem = _mounted(C)
    raise problem or error("table.directions", given=f"{np.degrees(given):.0f}")


def _plan_fits(readings: Readings, found: Match, plan: TablePlan, matter: bool) -> None:
    """Name the mistake where readings are in no position of the plan, or not in its order.

    Regular plans fit themselves upside down or turned, only in another order: what keeps the order
    is the better explanation.
    """
    few = float((found.row >= 0).mean()) < 0.5
    if found.ordered and not few:
        return
    up, nominal_spin = directions(readings), plan.rate != 0

    def miss(angles: FloatArray, sign: float) -> float:
        nominal = up_k(angles)
        spin = readings.spin
        row = position_match.match(sign * up, spin, nominal, nominal_spin, in_order=True).row
        some = row >= 0
        if some.mean() < 0.8:
            return float(np.pi / 2)
        return _near(sign * up[some], nominal[row[some]])

    problem = _named(float(np.pi / 2), miss, plan.angles)
    if problem is None and len(up) == len(plan):
        off, C = _miss(up, up_k(plan.angles))
        if off < FITS:
            if not matter:
                return
            problem = _mounted(C)
    if problem is None and few:
        problem = error("table.directions", given="25 or more")
    if problem is not None:
        raise problem


def _perhaps_reversed(readings: Readings, found: Match, plan: TablePlan) -> Match:
    """Match gyros without accelerometers as if they were reversed, if that keeps the order."""
    up, nominal, spin = directions(readings), up_k(plan.angles), plan.rate != 0
    other = position_match.match(-up, readings.spin, nominal, spin, in_order=True)
    same = position_match.match(up, readings.spin, nominal, spin, in_order=True)
    return other if (other.row >= 0).sum() > (same.row >= 0).sum() else found


def _named(given: float, miss: Miss, angles: FloatArray) -> FoucaultError | None:
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
        off = miss(angles[:, order] * np.array([1, *signs]), 1.0)
        if off < FITS:
            names = [("-" if s < 0 else "") + NAMES[k]
                     for k, s in zip(order, (1, *signs), strict=True)]  # fmt: skip
            hint = ""
            if order == (0, 1, 2):
                hint = " An instrument mounted the other way round on the table looks the same."
            return error("table.order", exchange=", ".join(names), hint=hint,
                         better=f"{np.degrees(off):.1f}", **said)  # fmt: skip
    return None


def _mounted(C: FloatArray) -> FoucaultError:
    along = []
    for row in C:  # a body axis in case axes
        k = int(np.argmax(np.abs(row)))
        along.append(("-" if row[k] < 0 else "") + ("middle", "inner", "outer")[k])
    angle = f"{np.degrees(turned(C)):.0f}"
    return error("table.mounting", angle=angle, axes=", ".join(along))


def _matching(readings: Readings, plan: TablePlan, found: Match, shortest: float) -> list[Finding]:
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
    extra = np.flatnonzero(found.row < 0)
    up = directions(readings)
    again: list[str] = []
    others: list[str] = []
    nominal = up_k(plan.angles) @ found.rotation.T
    same_kind = readings.spin[:, None] == (plan.rate != 0)[None, :]
    for k in extra:
        near = (nominal @ up[k] > np.cos(position_match.FAR)) & same_kind[k]
        at = f"reading {k + 1} at {plain(readings.start[k] - readings.start[0], 5)} s"
        if near.any():
            again.append(f"{_position(plan, int(np.argmax(near)))} ({at})")
        else:
            others.append(at)
    if again:
        out.append(finding("positions.repeated", which=_list(again)))
    if others:
        out.append(finding("positions.extra", which=_list(others)))
    if not found.ordered:
        out.append(finding("positions.order"))
    return out


def _position(plan: TablePlan, k: int) -> str:
    outer, middle, inner = (plain(float(np.degrees(a)), 4) for a in plan.angles[k])
    spin = ", spin" if plan.rate[k] else ""
    return f"number {k + 1} (outer {outer}, middle {middle}, inner {inner} deg{spin})"


def _list(words: list[str], most: int = 6) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def _senses(
    readings: Readings, plan: TablePlan | None, found: Match | None
) -> tuple[Readings, list[Finding]]:
    """Compare the sense and the size of the spins with what the gyros measure."""
    spin = np.flatnonzero(readings.spin)
    out: list[Finding] = []
    if readings.gyro is None or not len(spin):
        return readings, out
    up = _up(readings, plan, found)
    bias = np.zeros(3)
    if np.isfinite(up).all():
        bias = position_rates.bias_across(readings.gyro, up, readings.time)
    along = ((readings.gyro[spin] - bias) * up[spin]).sum(axis=1)
    known = np.isfinite(along)
    other = known & (along * readings.rate[spin] < 0)
    said = "the plan" if plan is not None else "the table"
    if len(spin[other]) and other.sum() == known.sum():
        senses = {bool(x > 0) for x in along[known]}
        words = {True: "counter-clockwise", False: "clockwise"}
        measured = words[senses.pop()] if len(senses) == 1 else "both ways"
        raise error("spin.sense", count=int(other.sum()), measured=measured, said=said)
    if other.any():
        which = _list([f"at {plain(readings.start[k] - readings.start[0], 5)} s"
                       for k in spin[other]])  # fmt: skip
        out.append(finding("spin.sense_some", count=int(other.sum()), said=said, which=which))
        rate = readings.rate.copy()
        rate[spin[other]] *= -1
        readings = replace(readings, rate=rate)
    out += _rates(readings, plan, found, spin)
    return readings, out


def _up(readings: Readings, plan: TablePlan | None, found: Match | None) -> FloatArray:
    """Return up in each reading by the accelerometers, else by the plan or the table."""
    if readings.accel is not None:
        return directions(readings)
    up = up_k(readings.angles)
    if plan is not None and found is not None:
        some = found.row >= 0
        up[some] = up_k(plan.angles)[found.row[some]] @ found.rotation.T
    return np.asarray(up)


def _rates(
    readings: Readings, plan: TablePlan | None, found: Match | None, spin: npt.NDArray[np.intp]
) -> list[Finding]:
    if plan is None or found is None:
        return []
    row = found.row[spin]
    pairs = [(abs(readings.rate[k]), abs(plan.rate[j]))
             for k, j in zip(spin, row, strict=True) if j >= 0 and plan.rate[j] != 0]  # fmt: skip
    if not pairs:
        return []
    measured, planned = np.median(np.array(pairs), axis=0)
    if 1 / OTHER_RATE < measured / planned < OTHER_RATE:
        return []
    told = plain(float(np.degrees(planned)), 4)
    return [finding("spin.rate_plan", told=told, measured=plain(float(np.degrees(measured)), 4))]
