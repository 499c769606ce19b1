"""The positions of a session on a table, judged and improved before it: the three procedures' part.

What a session will tell is computed by `bound`; this module asks it for a campaign: what the
plan in it will give (`foresee`), and among which plans a better one may be sought (`space`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import pi
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra, Foresight, Limit
from foucault.errors import error, finding
from foucault.models.imu import ImuModel
from foucault.models.noise import grade
from foucault.models.turntable import up_k
from foucault.plans.hand_rotated import spread_directions
from foucault.plans.optimise import DRAWS
from foucault.plans.table.directions import positions, spread_outer
from foucault.plans.table.information import Parts, half_covariance, without
from foucault.plans.table.periodic import Periodic
from foucault.plans.table.reach import NEARLY, Reach
from foucault.plans.table.search import Plan, PositionSpace
from foucault.plans.weights import require_seen, weights_of
from foucault.procedures import on_table
from foucault.procedures.on_table import Task
from foucault.procedures.on_table.bound import Bench
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Beforehand
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table.log import timetable

TRIED = 60
"""Random positions that together show whatever any positions could show [1]."""

DRAWN = 3
"""Instruments with drawn errors in which a plan is compared with another [1]."""

CLASS = "tactical"
"""Class whose noise is taken where none is known."""

PLACES = 100
"""Directions that are tried for one more position [1]."""

LONGER = 300.0
"""So much longer rests are foretold too [s]."""


def bench(task: Task, b: Beforehand[Any, Any]) -> Bench:
    """Return the session of a campaign without its positions."""
    known = b.noise or b.typical or grade(CLASS).noise
    return Bench(task, b.session, task.settings.where(b.site), known, b.noise is not None, b.prior)


def reach_of(settings: TableSettings) -> Reach:
    """Return what the table of `settings` allows in a rest."""
    whole = Reach()
    return Reach(
        whole.outer, settings.middle_range or whole.middle, settings.inner_range or whole.inner,
        settings.angle_step or 0.0,
    ).checked()  # fmt: skip


# -- a better plan -------------------------------------------------------------------------


def space(task: Task, beforehand: Beforehand[Any, Any]) -> PositionSpace:
    """Return the sets of positions that the table allows.

    `task`: which procedure, with its settings: the plan to beat, and the limits of the table.
    """
    b, wanted = bench(task, beforehand), beforehand.wanted
    name, said = positions(task.settings.chosen)
    count = wanted.positions or len(said)
    reach = _within_cable(b, reach_of(task.settings), count)
    layout = b.layout
    weights = weights_of(layout, wanted.weights)
    if wanted.criterion == "det" and len({*weights.tolist(), 0.0}) > 2:
        raise error("optimise.det")
    allowed = reach.words or "any angles"
    unseen = require_seen(layout.names, weights, _unseen(b, reach), allowed)
    free = task.trust is None
    degree = 6 if free and task.settings.accel_quadratic else 4
    table = Periodic.of(b.parts, (0 if free else 2, degree, degree))
    integrity = ""
    if wanted.integrity:
        integrity = "accel quadratic" if task.settings.accel_quadratic else "accel"
        integrity = integrity if free else "accel table"
    models = {"no errors": b.usual} | {
        f"{CLASS} instrument {k}": draw_errors(CLASS, k) for k in range(1, DRAWN + 1)
    }
    known = b.beforehand
    made = partial(
        PositionSpace, layout.names, tuple(c.kind for c in layout.coefficients), weights, unseen,
        cases=tuple(models), count=count, reach=reach, outer_counts=not free,
        parts=Parts(table, len(known)), beforehand=known, floor=b.floor,
        bound=partial(_sd, b, models), time=partial(_time, b),
        needed=partial(limits, b),         criterion=wanted.criterion, integrity=integrity,
    )  # fmt: skip
    plans = list(_references(said, name, count, reach))
    candidates = (made(reference=plan, reference_name=called) for plan, called in plans)
    found = next((f for f in candidates if np.isfinite(f.unit)), None)
    if found is None or not any(np.isfinite(found.size(p)) for p, _ in plans if len(p) == count):
        raise error("table.too_few", count=count, limits=allowed)
    return found


def _sd(b: Bench, models: Mapping[str, ImuModel], angles: FloatArray, case: str) -> FloatArray:
    return b.bound(b.plan(angles), models[case]).sd


def _time(b: Bench, angles: FloatArray) -> float:
    return timetable(b.plan(angles))[0]


def _plan(angles: FloatArray) -> Plan:
    return tuple((float(o), float(m), float(i)) for o, m, i in angles)


def _references(
    said: FloatArray, name: str, count: int, reach: Reach
) -> Iterator[tuple[Plan, str]]:
    """Yield plans to beat: the campaign's, as far as the table can, then others that see more."""
    plan = _plan(said)
    if all(reach.allows(p) for p in plan):
        yield plan, name
    else:
        near = [reach.pointing(u, p[0]) for u, p in zip(up_k(said), plan, strict=True)]
        yield tuple(near), f"{name}, as near as the table allows"
    outer = spread_outer(count).tolist()
    spread = zip(spread_directions(count), outer, strict=True)
    yield tuple(reach.pointing(u, o) for u, o in spread), f"{count} positions spread evenly"
    rng = np.random.default_rng(count)
    for _ in range(DRAWS):
        drawn = (rng.standard_normal(3) for _ in range(count))
        yield tuple(reach.pointing(u, 0.0) for u in drawn), f"{count} random positions"


def _within_cable(b: Bench, reach: Reach, count: int) -> Reach:
    """Return the outer angles of rests from which the spins keep within the cable."""
    travel = b.settings.cable_limit
    if travel is None:
        return reach
    needed = timetable(b.plan(np.zeros((count, 3))))[1]
    if needed > travel:
        cure = "one after the other" if not b.settings.both_senses else "there and back"
        raise error(
            "table.cable", needed=f"{needed / (2 * pi):.2f}", allowed=f"{travel / (2 * pi):.2f}",
            turns=b.session.turns, how=cure,
        )  # fmt: skip
    # Within a quarter turn of zero the shorter way from one to another never passes 180 deg.
    most = min(pi / 2 - NEARLY, travel - needed)
    return replace(reach, outer=(-most, most))


def _unseen(b: Bench, reach: Reach) -> npt.NDArray[np.bool_]:
    """Tell which coefficients no allowed positions show, shape (p,)."""
    rng = np.random.default_rng(TRIED)
    tried = np.array([
        reach.pointing(rng.standard_normal(3), float(rng.uniform(*reach.outer)))
        for _ in range(TRIED)
    ])  # fmt: skip
    return ~np.isfinite(b.bound(b.plan(tried)).sd)


# -- what the plan will show ---------------------------------------------------------------


def foresee(task: Task, beforehand: Beforehand[Any, Any]) -> Foresight:
    """Return what a session on a table will show.

    `task`: which procedure, with its settings: positions and spins, and the limits of the table.
    """
    b = bench(task, beforehand)
    name, angles = positions(task.settings.chosen)
    plan = b.plan(angles)
    info = b.information(plan).with_prior(b.known.prior_sd)
    found = _stated(b, angles)
    seen = bool(np.isfinite(found.sd).all())
    told = []
    if not seen:
        names = [n for n, s in zip(found.names, found.sd, strict=True) if not np.isfinite(s)]
        told.append(finding("table.unseen", plan=name, names=", ".join(names)))
    return Foresight(
        coefficients=found,
        linearised_at=("means in [prior], " if b.prior else "") + "no errors, a perfect table",
        plan=name,
        duration=timetable(plan)[0],
        states=len(b.layout),
        rank=info.rank,
        unseen=tuple(c.words for c in info.weakest(len(b.layout), np.inf)),
        weakest=tuple(c.words for c in info.weakest() if np.isfinite(c.factor)),
        correlated=info.correlated(),
        limits=limits(b, angles),
        more=_more(b, angles, found) if seen else (),
        findings=tuple(told),
    )


def _stated(b: Bench, angles: FloatArray) -> CoefficientVector:
    """Return the covariance that a calibration will state, also one by the linear equations."""
    plan = b.plan(angles)
    found = b.bound(plan)
    if b.task.variant is None or not np.isfinite(found.sd).all():
        return found
    read = b.readings(plan, b.state(plan, b.usual))
    return on_table.from_readings(read, b.task, site=b.site, prior=b.prior).coefficients


def limits(b: Bench, angles: FloatArray) -> tuple[Limit, ...]:
    """Return what the positions of a session need of the table, and what it allows.

    `angles` (n, 3): outer, middle and inner angle of each position [rad].
    """
    s, reach = b.settings, reach_of(b.settings)
    out = [
        Limit("outer angle, turns counted", "angle", timetable(b.plan(angles))[1], s.cable_limit)
    ]
    for k, (name, ends) in enumerate((("middle", s.middle_range), ("inner", s.inner_range)), 1):
        if ends is None:
            continue
        # Whole turns away is the same place; outside the range the nearer way counts.
        there = np.array([reach.nearest(tuple(a))[k] for a in angles])
        off = np.remainder(angles[:, k] - there + pi, 2 * pi) - pi
        off = off if s.angle_step is None else np.where(np.abs(off) <= s.angle_step / 2, 0.0, off)
        needed = there + off
        out.append(Limit(f"largest {name} angle", "angle", float(needed.max()), ends[1]))
        out.append(
            Limit(f"smallest {name} angle, negative", "angle", -float(needed.min()), -ends[0])
        )
    if s.angle_step is not None:
        off = np.abs(angles - s.angle_step * np.round(angles / s.angle_step)).max()
        out.append(Limit("angles off the steps", "angle", float(off) * (off > NEARLY), 0.0))
    return tuple(out)


def _more(b: Bench, angles: FloatArray, found: CoefficientVector) -> tuple[Extra, ...]:
    """Foretell one more position in the best place, and five minutes more of rest."""
    time = timetable(b.plan(angles))[0]
    extended = np.vstack([angles, _best(b, angles)])
    longer = replace(
        b, session=b.session.model_copy(
            update={"rest_time": b.session.rest_time + LONGER / _rests(b, angles)}
        ),
    )  # fmt: skip
    out = []
    at = ", ".join(f"{a:.0f}" for a in np.degrees(extended[-1, 1:]))
    for what, other, there in (
        (f"one more position (middle, inner {at} deg)", b, extended),
        (f"rests of {longer.session.rest_time:.0f} s", longer, angles),
    ):
        more = timetable(other.plan(there))[0] - time
        ratio = _stated(other, there).sd / found.sd
        out.append(Extra.of(what, more, found.names, ratio))
    return tuple(out)


def _rests(b: Bench, angles: FloatArray) -> int:
    return int(np.sum(b.plan(angles).rate == 0.0))


def _best(b: Bench, angles: FloatArray) -> FloatArray:
    """Return the position that adds most, of many over the sphere that the table allows."""
    known = b.beforehand
    kept, used = len(known), np.arange(len(b.layout))
    F = known + sum(without(b.part(p), kept) for p in _plan(angles))
    reach, scale = reach_of(b.settings), np.sqrt(np.where(np.diag(F) > 0.0, np.diag(F), 1.0))
    places = list(dict.fromkeys(reach.pointing(u, 0.0) for u in spread_directions(PLACES)))

    def size(part: FloatArray) -> float:
        half = half_covariance(F + without(part, kept), used, scale)
        if half is None:
            return np.inf
        return float(np.log(np.sum(half[:, used] ** 2, axis=0) + np.diag(b.floor)[used]).sum())

    return np.array(places[int(np.argmin([size(part) for part in b.parts(np.array(places))]))])
