"""The positions of a session on a table, judged and improved before it: the three procedures' part.

What the plan of a campaign will give says `foresee`; among which plans a better one may be sought,
`space`. Both ask a `Bench`, a session whose positions are still open. The uncertainty of a
calibration depends on where the table stood, how long, and on the noise, but hardly on what was
read: the readings that a session would give are computed, and the likelihood of the procedure is
linearised there. Nothing is drawn and nothing is solved.

Directions of up and errors of single positions are unknowns of one position each. With them
eliminated the information of a session is a sum over its positions, which makes a search fast::

    F = sum_j F(outer_j, middle_j, inner_j)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import pi
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IndexArray
from foucault.coefficients import CoefficientVector, Layout, Prior
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.left_out import foretold
from foucault.errors import error, finding
from foucault.estimate.table import Options, TableModel
from foucault.infer import left_out as left_out_terms
from foucault.infer import mixed
from foucault.infer.information import Information, information
from foucault.infer.left_out import Judgement
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.layouts import with_references
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise, Readings, grade, mean_variance, slow_part
from foucault.models.turntable import Angles, Free, Geometry, State, TablePlan, chain, up_k
from foucault.plans.directions import positions, spread_directions, spread_outer, table_plan
from foucault.plans.limit import Limit
from foucault.plans.optimise import DRAWS, require_seen, weights_of
from foucault.plans.table import (
    NEARLY,
    Parts,
    Periodic,
    Plan,
    PositionSpace,
    Reach,
    half_covariance,
    without,
)
from foucault.procedures import left_out, on_table
from foucault.procedures.on_table import Task, common_rate_sd, options_of, reduced_again
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.record import Beforehand
from foucault.result import Linearised
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import begins, timetable

TOGETHER = 16
"""Positions that are linearised at once: more make matrices that are mostly empty [1]."""

TILTS = (5.0 / 9.0, 4.0 / 9.0, 1.0 / 3.0, 2.0 / 3.0)
"""Variance of a tilt per axis over that of an angle, mean over all directions: of the errors of
single positions (the middle angle tilts by all of its error, the inner one by the cosine of the
middle), of both angles between axes (all, and the sine of the middle), of the zero errors (the
inner one goes into the mounting), of both tilts of the outer axis [1]."""


@dataclass(frozen=True)
class Bench:
    """A session on a table of which only the positions are open."""

    task: Task  # which procedure, with its settings
    session: TableSession  # how long rests and spins last, and the errors of the table
    # gravity and latitude; without a latitude accelerometers alone, as rests alone calibrate
    site: Site
    noise: ImuNoise  # noise of the instrument [SI]
    declared: bool  # whether the calibration will be told that noise; else it will measure it
    # mean and standard deviation of coefficients or groups of coefficients [SI]
    prior: Prior
    sizes: Sizes | None = None  # of what is not estimated, None: it is taken for nothing [SI]

    @property
    def settings(self) -> TableSettings:
        """What was chosen."""
        return self.task.settings

    @property
    def gyro(self) -> bool:
        """Whether gyros can be calibrated."""
        return self.site.latitude is not None

    @property
    def layout(self) -> Layout:
        """The coefficients that will be estimated."""
        return LAYOUT.subset(self.settings.estimated(gyro=self.gyro))

    @cached_property
    def known(self) -> CoefficientVector:
        """What is known of them beforehand."""
        return CoefficientVector.prior(self.layout, self.prior)

    @cached_property
    def usual(self) -> ImuModel:
        """The instrument without errors, but for those that the prior expects."""
        return ImuModel.from_coefficients(self.known)

    def plan(self, angles: FloatArray, *, more: bool = True) -> TablePlan:
        """Return what the table does in positions.

        `angles` (n, 3): outer, middle and inner angle of each [rad]; `more`: whether with the
        rests and spins of `four_positions`, where those are asked for.
        """
        s = self.settings
        return table_plan(
            angles, spin_rate=s.spin_rate, rest_time=self.session.rest_time,
            turns=self.session.turns, spins=self.gyro, both_senses=s.both_senses,
            four_positions=more and s.four_positions,
        )  # fmt: skip

    def state(self, plan: TablePlan, model: ImuModel) -> State:
        """Return where everything unknown is: a perfect table, a lever arm of zero."""
        trust, spin = self.task.trust, plan.rate != 0.0
        at = chain(plan.angles)
        o = np.where(spin[:, None], at.outer_k, at.up_k)
        vertical = EARTH_RATE * np.sin(self.site.latitude or 0.0) if self.gyro else 0.0
        geometry: Geometry = Free(o, float(vertical))
        if trust is not None:
            heading = self.session.heading if self.gyro and trust.latitude is not None else None
            geometry = Angles(
                plan.angles, spin, trust, np.eye(3), np.zeros(6), np.zeros((len(plan), 2)), heading
            )
        return State(model.in_gauge(Gauge.LOWER)[0], geometry, np.zeros(3))

    def readings(self, plan: TablePlan, state: State) -> Readings:
        """Return what would be read but for the errors of the instrument, with its covariance."""
        interval, spin, o = 1.0 / self.session.rate, plan.rate != 0.0, state.geometry.directions()
        along = plan.rate + state.geometry.axis().earth
        w = np.where(spin[:, None], along[:, None] * o, state.geometry.earth()[0])
        accel, gyro = (
            mean_variance(t, plan.time, interval)[:, None, None] * np.eye(3)
            for t in (self.noise.accel, self.noise.gyro)
        )
        accel, gyro = self._scattered(spin, w, accel, gyro)
        turns = np.round(np.abs(plan.rate) * plan.time / (2 * np.pi))
        start = np.concatenate([[0.0], np.cumsum(plan.time)[:-1]])
        return Readings(
            plan.angles, plan.rate, turns, start, plan.time, self.site.gravity * o,
            w if self.gyro else None, accel, gyro, interval, declared=self.declared,
        )  # fmt: skip

    def _scattered(
        self, spin: BoolArray, w: FloatArray, accel: FloatArray, gyro: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Add the scatter of biases and of errors of the table, where a calibration finds it."""
        trust, eye = self.task.trust, np.eye(3)
        if not self.settings.repeatability:
            return accel, gyro
        accel = accel + (self.session.accel_scatter or 0.0) ** 2 * eye
        gyro = gyro + (self.session.gyro_scatter or 0.0) ** 2 * eye
        if self.session.rate_jitter > self.settings.rate_sd:
            left = self.session.rate_jitter**2 - self.settings.rate_sd**2
            turning = np.where(spin[:, None], w, 0.0)
            gyro = gyro + left * turning[:, :, None] * turning[:, None, :]
        e = self.session
        if trust is not None and (trust.position_sd == 0.0 or trust.position_sd < e.position_sd):
            known = (trust.position_sd, *trust.common_sd[[2, 4, 0]])
            made = (e.position_sd, e.orthogonality_sd, e.zero_sd, e.plumb_sd)
            sizes = [np.sqrt(max(m**2 - k**2, 0.0)) for m, k in zip(made, known, strict=True)]
            *others, plumb = (k * sd**2 for k, sd in zip(TILTS, sizes, strict=True))
            # The outer axis is the axis of its spins, tilted or not.
            tilt = sum(others) + np.where(spin, 0.0, plumb)
            accel = accel + (self.site.gravity**2 * tilt)[:, None, None] * eye
            gyro = gyro + (np.sum(w**2, axis=1) * sum(others))[:, None, None] * eye
        return accel, gyro

    @cached_property
    def options(self) -> Options:
        """How the readings of a whole session are fitted, the prior apart."""
        nine = np.zeros((9, 3))
        plan = self.plan(nine, more=False)
        read = self.readings(plan, self.state(plan, ImuModel()))
        return options_of(read, self.task, None)

    def stated(self, plan: TablePlan, model: ImuModel, *, whole: bool) -> TableModel:
        """Return the likelihood of a plan; `model`, `whole`: as of `linearised`."""
        state = self.state(plan, model)
        read = self.readings(plan, state)
        if whole:  # what drifts goes by the clock, not from reading to reading
            read = replace(read, start=begins(plan, self.session.rows))
        if whole and self.declared:
            read = replace(read, slow=slow_part(self.noise))
        found = whole and not self.declared and self.settings.repeatability
        return TableModel(read, self.site, state, replace(self.options, repeatability=found))

    def linearised(self, plan: TablePlan, model: ImuModel, whole: bool = False) -> Linearised:
        """Return white residuals, which are zero, and their derivatives, without the prior.

        `whole`: whether the plan is a whole session, whose slow biases tie its readings together,
        else they are taken as independent, so that its parts add up.
        """
        stated = self.stated(plan, model, whole=whole)
        if whole and self.sizes is not None:
            made = left_out.columns(self.layout.names, self.site, self.sizes, reduced_again(stated))
            stated = replace(stated, more=made(stated.start))
        at = mixed.foreseen(stated, sds=mixed.by_chance(stated) if whole else {})
        return replace(at, blocks=np.where(at.blocks < 0, -1, stated.rows[at.blocks]))

    def information(self, plan: TablePlan, model: ImuModel | None = None) -> Information:
        """Return what a session tells of the coefficients, the prior left out.

        `model`: the instrument, None takes `usual`.
        """
        return information(self.linearised(plan, model or self.usual, True), self.layout)

    def bound(self, plan: TablePlan, model: ImuModel | None = None) -> CoefficientVector:
        """Return the coefficients with the covariance that a calibration will state.

        Prior, gravity and the rate of the table are in it; infinite where nothing is seen.

        `model`: the instrument, None takes `usual`.
        """
        model = model or self.usual
        info = self.information(plan, model).with_prior(self.known.prior_sd)
        values = model.in_gauge(Gauge.LOWER)[0].coefficients(self.layout.names).values
        found = replace(self.known, values=values, cov=info.cov)
        return with_references(found, self.beside, self.rate_sd)

    @property
    def beside(self) -> Site:
        """The site, without the uncertainty of its gravity where that counts already."""
        return self.site if self.sizes is None else replace(self.site, gravity_sd=0.0)

    def judged(self, plan: TablePlan) -> Judgement | None:
        """Return what a session will make of what is not estimated; None where nothing counts."""
        if self.sizes is None:
            return None
        stated = self.stated(plan, self.usual, whole=True)
        made = left_out.columns(self.layout.names, self.site, self.sizes, reduced_again(stated))
        known = self.known if self.prior else None
        _, found = left_out_terms.planned(stated, made, known)
        return replace(found, sizes={g: self.sizes[g] for g in found.groups})

    @property
    def rate_sd(self) -> float:
        """Relative sd of an error that all spin rates share [1]."""
        if not self.gyro:
            return self.settings.table_rate_sd
        plan = self.plan(np.zeros((1, 3)), more=False)
        return common_rate_sd(
            self.readings(plan, self.state(plan, self.usual)), self.task, self.site
        )

    # -- one position at a time ------------------------------------------------------------

    def part(self, position: tuple[float, float, float]) -> FloatArray:
        """Return the information of one position, shape (u + own, u + own): its rest and spins.

        The coefficients come first, then what else all positions share, then the errors of its
        angles. Where nothing is believed of the table its directions of up are eliminated. The
        entries are polynomials in sines and cosines of the angles.

        `position` (3,): outer, middle and inner angle [rad].
        """
        return self._joined(self.plan(np.array([position]), more=False))

    def parts(self, positions: FloatArray) -> FloatArray:
        """Return what `part` does of many positions, shape (n, u + own, u + own).

        `positions` (n, 3): outer, middle and inner angle of each, no two alike [rad].
        """
        found = []
        for some in np.array_split(positions, -(-len(positions) // TOGETHER)):
            plan = self.plan(some, more=False)
            at, n = self.linearised(plan, self.usual), len(plan)
            own = self._own_columns(n)
            common = np.delete(at.jacobian, own, axis=1)
            for position in some:
                mine = np.flatnonzero((plan.angles == position).all(axis=1))
                columns = own.reshape(n, -1)[mine].ravel()
                local = at.jacobian[:, columns]
                rows = (at.blocks >= 0) & np.isin(at.blocks % n, mine)
                rows |= (np.abs(local) > 0).any(axis=1)
                found.append(self._information(common[rows], local[rows]))
        return np.array(found)

    def _joined(self, plan: TablePlan) -> FloatArray:
        """Return the information of a few rests and spins, errors of their angles last."""
        at = self.linearised(plan, self.usual)
        own = self._own_columns(len(plan))
        J = at.jacobian[(at.blocks >= 0) | (np.abs(at.jacobian[:, own]) > 0).any(axis=1)]
        return self._information(np.delete(J, own, axis=1), J[:, own])

    def _information(self, common: FloatArray, local: FloatArray) -> FloatArray:
        """Return the information of some rows: what is local is eliminated, or comes last."""
        if self.task.trust is not None:
            whole = np.concatenate([common, local], axis=1)
            return np.asarray(whole.T @ whole)
        Q, _ = np.linalg.qr(local)
        rest = common - Q @ (Q.T @ common)
        return np.asarray(rest.T @ rest)

    @cached_property
    def beforehand(self) -> FloatArray:
        """What is known without any position, shape (u, u): priors, and four_positions' part."""
        none = np.zeros((1, 3))
        plan = self.plan(none, more=False)
        at = self.linearised(plan, self.usual)
        own = self._own_columns(len(plan))
        prior = np.delete(at.jacobian[at.blocks < 0], own, axis=1)
        out = prior.T @ prior
        n = len(self.layout)
        out[np.arange(n), np.arange(n)] += 1.0 / self.known.prior_sd**2
        if self.settings.four_positions:
            whole = self.plan(np.radians([[45.0, 30.0, 60.0]]))
            mine = (whole.angles == whole.angles[0]).all(axis=1)
            added = TablePlan("", whole.angles[~mine], whole.rate[~mine], whole.time[~mine])
            out = out + without(self._joined(added), len(out))
        return np.asarray(out)

    def _own_columns(self, n: int) -> IndexArray:
        """Return the unknowns that belong to one of n readings alone."""
        o, trust = self.options, self.task.trust
        first = o.unknowns.before_geometry
        if trust is None:
            return first + np.arange(2 * n)
        common = 3 + int(np.sum(trust.common_sd > 0))
        return first + common + np.arange(2 * n if trust.position_sd > 0 else 0)

    @cached_property
    def floor(self) -> FloatArray:
        """Covariance that no plan can take away: gravity's and the table's rate, shape (p, p)."""
        values = self.usual.in_gauge(Gauge.LOWER)[0].coefficients(self.layout.names).values
        n = len(self.layout)
        sure = CoefficientVector(self.layout, values, np.zeros((n, n)))
        cov = with_references(sure, self.beside, self.rate_sd).cov
        assert cov is not None
        return cov


TRIED = 60  # Random positions that together show whatever any positions could show [1].
DRAWN = 3  # Instruments with drawn errors in which a plan is compared with another [1].
CLASS = "tactical"  # Class whose noise is taken where none is known.
PLACES = 100  # Directions that are tried for one more position [1].
LONGER = 300.0  # So much longer rests are foretold too [s].


def bench(task: Task, b: Beforehand[Any, Any]) -> Bench:
    """Return the session of a campaign without its positions."""
    known = b.noise or b.typical or grade(CLASS).noise
    site = task.settings.where(b.site)
    made = Bench(task, b.session, site, known, b.noise is not None, b.prior)
    span = timetable(made.plan(positions(task.settings.chosen)[1]))[0]
    slow = left_out.wander_of(slow_part(known) if made.declared else None, span)
    white = known.accel.white, known.gyro.white
    return replace(made, sizes=left_out.whole(b.sizes, site, white, slow))


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
    # Tell which coefficients no allowed positions show, shape (p,).
    rng = np.random.default_rng(TRIED)
    tried = np.array([
        reach.pointing(rng.standard_normal(3), float(rng.uniform(*reach.outer)))
        for _ in range(TRIED)
    ])  # fmt: skip
    unseen = require_seen(layout.names, weights, ~np.isfinite(b.bound(b.plan(tried)).sd), allowed)
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
        PositionSpace, names=layout.names, kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights, blind=unseen, cases=tuple(models), count=count, allowed=reach,
        outer_counts=not free, parts=Parts(table, len(known)), beforehand=known, floor=b.floor,
        stated=partial(_sd, b, models), time=partial(_time, b), needed=partial(limits, b),
        criterion=wanted.criterion, integrity=integrity,
    )  # fmt: skip
    plans = list(_references(said, name, count, reach))
    candidates = (made(reference=plan, reference_name=called) for plan, called in plans)
    found = next((f for f in candidates if np.isfinite(f.unit)), None)
    if found is None or not any(np.isfinite(found.size(p)) for p, _ in plans if len(p) == count):
        raise error("table.too_few", count=count, limits=allowed)
    return found


def _sd(b: Bench, models: Mapping[str, ImuModel], plan: Plan, case: str) -> FloatArray:
    return b.bound(b.plan(np.array(plan)), models[case]).sd


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
    told, judged = [], b.judged(plan) if seen else None
    if not seen:
        names = [n for n, s in zip(found.names, found.sd, strict=True) if not np.isfinite(s)]
        told.append(finding("table.unseen", plan=name, names=", ".join(names)))
    return Foresight(
        **info.shown(),
        coefficients=found,
        linearised_at=("means in [prior], " if b.prior else "") + "no errors, a perfect table",
        plan=name,
        duration=timetable(plan)[0],
        limits=limits(b, angles),
        more=_more(b, angles, found) if seen else (),
        left_out=None if judged is None else foretold(judged),
        findings=tuple(told),
    )


def _stated(b: Bench, angles: FloatArray) -> CoefficientVector:
    """Return the covariance that a calibration will state, also one by the linear equations."""
    plan = b.plan(angles)
    found = b.bound(plan)
    if b.task.variant is None or not np.isfinite(found.sd).all():
        return found
    read = b.readings(plan, b.state(plan, b.usual))
    return on_table.from_readings(
        read, b.task, site=b.site, prior=b.prior, sizes=b.sizes
    ).coefficients


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
