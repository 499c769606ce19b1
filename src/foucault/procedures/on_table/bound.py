"""What a session on a table will tell, before it is made: the bound, for positions still open.

The uncertainty of a calibration depends on where the table stood, how long, and on the noise, but
hardly on what was read: the readings that a session would give are computed, and the likelihood of
the procedure is linearised there. Nothing is drawn and nothing is solved.

Directions of up and errors of single positions are unknowns of one position each. With them
eliminated the information of a session is a sum over its positions, which makes a search fast::

    F = sum_j F(outer_j, middle_j, inner_j)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.diagnose.information import Information, information
from foucault.estimate.table.likelihood import Options, TableModel
from foucault.infer import mixed
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.readings import Readings, mean_variance, slow_part
from foucault.models.references import with_references
from foucault.models.table_geometry import Angles, Free, Geometry
from foucault.models.table_state import State
from foucault.models.turntable import TablePlan, chain
from foucault.plans.table.information import without
from foucault.plans.table.plan import table_plan
from foucault.procedures.on_table import Task, common_rate_sd, options_of
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.result import Linearised

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
    prior: Mapping[str, tuple[float, float]]

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
        self, spin: npt.NDArray[np.bool_], w: FloatArray, accel: FloatArray, gyro: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Add the scatter that errors of the table make, where a calibration estimates it."""
        trust, eye = self.task.trust, np.eye(3)
        if not self.settings.repeatability:
            return accel, gyro
        if self.session.rate_jitter > self.settings.rate_sd:
            left = self.session.rate_jitter**2 - self.settings.rate_sd**2
            turning = np.where(spin[:, None], w, 0.0)
            gyro = gyro + left * turning[:, :, None] * turning[:, None, :]
        if trust is not None and trust.position_sd == 0.0:
            e = self.session
            sizes = (e.position_sd, e.orthogonality_sd, e.zero_sd, e.plumb_sd)
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

    def linearised(self, plan: TablePlan, model: ImuModel, whole: bool = False) -> Linearised:
        """Return white residuals, which are zero, and their derivatives, without the prior.

        `whole`: whether the plan is a whole session, whose slow biases tie its readings together,
        else they are taken as independent, so that its parts add up.
        """
        state = self.state(plan, model)
        read = self.readings(plan, state)
        if whole and self.declared:
            read = replace(read, slow=slow_part(self.noise))
        stated = TableModel(read, self.site, state, replace(self.options, repeatability=False))
        at = mixed.foreseen(stated)
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
        return with_references(found, self.site, self.rate_sd)

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

    @property
    def own(self) -> int:
        """Number of unknowns that each position has to itself in `part` [1]."""
        trusted = self.task.trust is not None and self.task.trust.position_sd > 0
        return 2 * len(self.plan(np.zeros((1, 3)), more=False)) if trusted else 0

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

    def _own_columns(self, n: int) -> npt.NDArray[np.intp]:
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
        cov = with_references(sure, self.site, self.rate_sd).cov
        assert cov is not None
        return cov
