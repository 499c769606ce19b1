"""Readings on a table: of one instrument, or of many in one batch.

The model of readings on a table, whatever is believed of the table.

Where nothing is believed of it (`table_geometry.Free`) this is norm observation for accelerometers
and gyros with the unification of their frames, all at once. Where the angles are believed exactly
it is the traditional multi-position method, and with errors of known size
(`table_geometry.Angles`) the joint estimate of instrument and table.

Every reading is two observations, its specific force and its rate. The rate of a spin is taken
along its axis and across it: errors of the table's rate act along, and are a kind of their own.

Fit readings on a table: outliers left out, unexplained scatter estimated.

A wrong reading is looked for by data snooping, because with few redundant readings it spreads over
the residuals of all. Where several readings would look alike none is left out, and the result
says so. Scatter beyond the noise is one more variance for each group of readings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import Status
from foucault.estimate import norm_observation
from foucault.estimate.norm_observation import unify, wahba
from foucault.infer import gauss_newton, left_out, mixed
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.left_out import Columns, Judgement, With
from foucault.infer.mixed import NOISE_BASIS, SIGNIFICANT, Linearisation, Source
from foucault.infer.snooping import Snooping, snoop, snoop_fit
from foucault.models import turntable
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.noise import Readings
from foucault.models.turntable import Angles, Free, State, Trust, Unknowns, moved, predict, tangents
from foucault.result import Estimate, Linearised

DEAD = 1e6  # Axes whose scale factors differ by more do not all read something [1].

KINDS = ("accel at rest", "accel in spins", "gyro at rest", "gyro in spins", "rate of spins")
"""The kinds of residual; in spins the rate along the axis, which is the table's, stands alone."""

FORCES, AT_REST, IN_SPINS, ALONG = (
    "scatter of specific forces", "scatter of rates at rest", "scatter of rates in spins",
    "scatter of the rate of spins",
)  # fmt: skip
"""What has one scatter. Errors of the table act on gyros in proportion to the rate, on
accelerometers alike at rest and in spins; one variance each for their rests and spins would let
that with less redundancy shrink to nothing and take the solution with it."""

FOUND_IN = {
    "accel at rest": (FORCES,),
    "accel in spins": (FORCES,),
    "gyro at rest": (AT_REST,),
    "gyro in spins": (IN_SPINS,),
    "rate of spins": (IN_SPINS, ALONG),
}
"""Kind of reading -> the scatter that it tells: along the axis that of all rates comes on top."""

OF_TABLE = (
    *["tilt of the outer axis"] * 2, *["axes of the table that are not square"] * 2,
    *["zero errors of the table"] * 2, "errors of single positions",
)  # fmt: skip
"""The source of each of `turntable.COMMON`, and of the errors of one position."""


@dataclass(frozen=True)
class Options:
    """How to fit."""

    names: tuple[str, ...]
    # lever_arm, level, offset: whether these are unknown, see `table_state.State`
    lever_arm: bool
    level: bool
    offset: bool = False
    prior: CoefficientVector | None = None  # Gaussian prior on the coefficients
    rate_sd: float = 0.0  # relative sd of the rate from one spin to the next [1]
    robust: bool = True
    repeatability: bool = True  # estimate scatter that the noise does not explain
    # look at the rates at rest even where the heading is unknown: they say little of the bias
    # beside the spins, but all there is of a g-sensitivity
    gyro_at_rest: bool = False

    @property
    def unknowns(self) -> Unknowns:
        """What a step has."""
        return Unknowns(self.names, self.lever_arm, self.level, self.offset)


@dataclass(frozen=True)
class TableModel:
    """Readings on a table and what makes them differ from the truth: a `mixed.Model`."""

    readings: Readings  # means with the covariance of their noise [SI]
    site: Site
    # where the fit starts: which way is up, and whether the heading is modelled
    start: State
    options: Options
    tested: frozenset[str] = frozenset()  # scatter that few readings tell: it must be significant
    more: tuple[Source, ...] = ()  # what is not estimated, its columns held fixed
    sizes: Mapping[str, float] = field(default_factory=dict)  # source -> its sd instead [SI]

    @cached_property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.options.names)

    @cached_property
    def rows(self) -> IntArray:
        """Numbers of the observations, shape (k,).

        Of n readings j is the specific force of reading j, n + j its rate.
        """
        r, n = self.readings, len(self.readings)
        rates = np.flatnonzero(r.spin | self._heading_known | self.options.gyro_at_rest)
        parts = [np.arange(n)] * (r.accel is not None) + [n + rates] * (r.gyro is not None)
        return np.concatenate(parts)

    @property
    def _heading_known(self) -> bool:
        geometry = self.start.geometry
        return isinstance(geometry, Angles) and geometry.heading is not None

    @property
    def earth_unknown(self) -> bool:
        """Whether rates at rest hold a part of the Earth's whose direction is not known."""
        return bool((self.kind == 2).any()) and not self._heading_known

    @cached_property
    def kind(self) -> IntArray:
        """Index in `KINDS` of each observation, that of spins across the axis, shape (k,)."""
        n = len(self.readings)
        return 2 * (self.rows >= n) + self.readings.spin[self.rows % n]

    @cached_property
    def kinds(self) -> dict[str, BoolArray]:
        """Kind of reading -> which components of which observations, shape (k, 3)."""
        first = np.array([True, False, False])
        out = {name: np.outer(self.kind == k, [True] * 3) for k, name in enumerate(KINDS[:4])}
        out["rate of spins"] = out["gyro in spins"] & first
        out["gyro in spins"] = out["gyro in spins"] & ~first
        return out

    @cached_property
    def axes(self) -> FloatArray:
        """Axes of the components of each observation, one a row, shape (k, 3, 3) [1]."""
        out = np.tile(np.eye(3), (len(self.rows), 1, 1))
        turns = self.kind == 3
        if turns.any():
            assert self.readings.gyro is not None
            w = self.readings.gyro[self.rows[turns] % len(self.readings)]
            along = w / np.linalg.norm(w, axis=1, keepdims=True)
            out[turns] = np.concatenate(
                [along[:, None], np.swapaxes(tangents(along), 1, 2)], axis=1
            )
        return out

    def linearise(self, state: State) -> Linearisation:
        """Compare the readings with the model."""
        r, unknowns = self.readings, self.options.unknowns
        at = predict(state, r, self.site, unknowns)
        miss = [] if r.accel is None else [r.accel - at.accel]
        slope = [] if r.accel is None else [at.accel_slope]
        if r.gyro is not None:
            miss, slope = [*miss, r.gyro - at.gyro], [*slope, at.gyro_slope]
        first = len(r) if r.accel is None else 0
        residuals = np.concatenate(miss)[self.rows - first]
        jacobian = np.concatenate(slope)[self.rows - first]
        turns = self.kind == 3
        residuals[turns] = np.einsum("nij,nj->ni", self.axes[turns], residuals[turns])
        jacobian[turns] = self.axes[turns] @ jacobian[turns]
        value, sd = state.geometry.prior()
        known = np.flatnonzero(np.isfinite(sd))
        rows = np.zeros((len(known), jacobian.shape[2]))
        rows[np.arange(len(known)), unknowns.before_geometry + known] = 1.0 / sd[known]
        used = state.geometry.used if isinstance(state.geometry, Angles) else np.arange(0)
        names = [OF_TABLE[k] for k in used] + [OF_TABLE[-1]] * (len(known) - len(used))
        return Linearisation(residuals, jacobian, self.sources, (-value[known], rows), tuple(names))

    @cached_property
    def sources(self) -> tuple[Source, ...]:
        """Everything that makes readings differ from the model, errors of the table apart."""
        r, o, eye = self.readings, self.options, np.eye(3)
        quick, j = r.without_wander(), self.rows % len(r)
        accel, spin = self.kind < 2, self.kind == 3
        kind, basis = NOISE_BASIS[r.noise_from]
        noise = [
            Source(f"{name} noise", self._own(mine, mixed.root(cov)[j]), noise=True,
                   type=kind, basis=basis)
            for name, mine, cov in (
                ("accelerometer", accel, quick.accel_cov), ("gyro", ~accel, quick.gyro_cov)
            ) if mine.any()
        ]  # fmt: skip
        out = [*noise, *self._wander(), *self._believed()]
        w = np.zeros((len(j), 3, 1)) if r.gyro is None else r.gyro[j][:, :, None]
        turning = self._own(spin, w)  # per unit of the rate
        if o.rate_sd:
            out.append(
                Source("jitter of the spin rate", turning, sd=o.rate_sd, basis="rate_sd as given")
            )
        if self.earth_unknown:
            out.append(self._earth())
        beyond = {
            FORCES: self._own(accel, eye), AT_REST: self._own(self.kind == 2, eye),
            IN_SPINS: self._own(spin, eye), ALONG: turning,
        }  # fmt: skip
        # Noise that was measured within readings is a lower limit of what differs between them:
        # what is more is always added, where enough of them tell it. A noise that nobody knows is
        # all scatter.
        tested = {"declared": set(beyond), "measured": self.tested, "unknown": set()}
        out += [
            mixed.scatter(name, each, price=SIGNIFICANT if name in tested[r.noise_from] else 0.0)
            for name, each in beyond.items()
            if o.repeatability and each.any()
        ]
        return tuple(replace(s, sd=self.sizes.get(s.name, s.sd)) for s in (*out, *self.more))

    @property
    def drifts(self) -> bool:
        """Whether drifts of coefficients are among what was added."""
        return any(s.name.endswith(" drift") for s in self.more)

    def _own(self, mine: BoolArray, roots: FloatArray) -> FloatArray:
        """Turn roots (k, 3, c) or (3, c) from body axes to those of the observations `mine`."""
        return np.where(mine[:, None, None], self.axes @ roots, 0.0)

    def _believed(self) -> list[Source]:
        """Say what the errors of a table rest on: unknowns, of which something is known."""
        geometry = self.start.geometry
        if not isinstance(geometry, Angles):
            return []
        return [Source(name, basis=geometry.trust.basis) for name in dict.fromkeys(OF_TABLE)]

    def _wander(self) -> list[Source]:
        """Return the slow biases as they were declared: they tie the readings together."""
        out, j = [], self.rows % len(self.readings)
        mine = (self.kind < 2, self.kind >= 2)
        for name, own, cov in zip(
            ("accelerometer", "gyro"), mine, self.readings.wander(), strict=True
        ):
            if cov is not None:
                shared = mixed.tied(self._own(own, np.eye(3)), mixed.root(cov)[j])
                out.append(Source(f"wandering {name} bias", shared=shared, noise=True,
                                  basis="bias instability and random walk as given"))  # fmt: skip
        return out

    def _earth(self) -> Source:
        """Return the horizontal part of the Earth's rotation at rest, where the heading is unknown.

        A vector of known size, another one in every rest: nothing tells how a table was turned of
        which nothing is believed. It gets a variance of the size squared along each axis, twice
        that of a random direction, because the directions of several rests may be alike; poses
        that a hand held are not.
        """
        start, j, latitude = self.start, self.rows % len(self.readings), self.site.latitude
        if latitude is None:
            every = self._own(self.kind == 2, start.model.gyro_matrix)
            return Source("unknown Earth rate", every, sd=EARTH_RATE / np.sqrt(3),
                          basis="latitude not given: any direction")  # fmt: skip
        # As the gyros see it: a percent of it is more than the noise of a good gyro.
        across = start.model.gyro_matrix @ tangents(start.geometry.directions())
        alike = 1.0 if self.readings.spin.any() else np.sqrt(0.5)  # no two poses by hand are
        return Source(
            "unknown heading", self._own(self.kind == 2, across[j]),
            sd=EARTH_RATE * np.cos(latitude) * alike, basis="heading not given: the whole circle",
        )  # fmt: skip

    def retract(self, state: State, step: FloatArray) -> State:
        """Apply `step` (m,) to a state [SI]."""
        return moved(state, step, self.options.unknowns)

    def values(self, state: State) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return state.model.coefficients(self.options.names).values


# -- starts --------------------------------------------------------------------------------


def free_start(readings: Readings, site: Site, lever_arm: bool) -> State | None:
    """Solve `readings` [SI] by linear norm observation and parallel vectors; None: singular."""
    model, arm, vertical = ImuModel(), np.zeros(3), 0.0
    if site.latitude is not None:
        vertical = float(EARTH_RATE * np.sin(site.latitude))
    h = turntable.mean_rate(readings.rate, site.latitude or 0.0)
    spin, o = readings.spin, np.zeros((len(readings), 3))
    if readings.accel is not None:
        rests = readings.accel[~spin]
        solved = norm_observation.solve(rests, site.gravity) if len(rests) >= 9 else None
        solved = solved or norm_observation.solve(readings.accel, site.gravity)
        if solved is None:
            return None
        model = replace(model, accel_matrix=solved[0], accel_bias=solved[1])
        f = (readings.accel - solved[1]) @ np.linalg.inv(solved[0]).T
        o = f / np.linalg.norm(f, axis=1, keepdims=True)
    if readings.gyro is not None and spin.any():
        solved = norm_observation.solve(readings.gyro[spin], h[spin])
        if solved is None:
            return None
        w_d = (readings.gyro[spin] - solved[1]) @ np.linalg.inv(solved[0]).T
        C_bd = np.eye(3)
        if readings.accel is not None:
            C_bd, arm = unify(f[spin], w_d, h[spin], site.gravity, lever_arm)
        model = replace(model, gyro_matrix=solved[0] @ C_bd.T, gyro_bias=solved[1])
        axis = np.sign(h[spin])[:, None] * w_d @ C_bd.T
        o[spin] = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return State(model, Free(o, vertical), arm)


def angle_start(readings: Readings, site: Site, trust: Trust) -> State | None:
    """Solve `readings` [SI] as if the table were perfect; None where that is singular."""
    spin, up = readings.spin, turntable.up_k(readings.angles)
    model = ImuModel()
    if readings.accel is not None:
        fit = _affine(site.gravity * up, readings.accel)
        if fit is None:
            return None
        model = replace(model, accel_matrix=fit[0], accel_bias=fit[1])
    if readings.gyro is not None:
        h = turntable.mean_rate(readings.rate, site.latitude or 0.0)
        vertical = EARTH_RATE * np.sin(site.latitude or 0.0)
        fit = _affine(np.where(spin, h, vertical)[:, None] * up, readings.gyro)
        if fit is None:
            return None
        model = replace(model, gyro_matrix=fit[0], gyro_bias=fit[1])
    C_bk = np.eye(3)
    if readings.accel is not None:
        model, C_bk = model.in_gauge(Gauge.LOWER)
    # Where the norms alone determine the instrument, errors of the table cannot mislead the start.
    free = free_start(readings, site, lever_arm=False)
    if free is not None and trust.position_sd > 0:
        model, C_bk = free.model, wahba(free.geometry.directions(), up)
    geometry = Angles(
        readings.angles, spin, trust, C_bk, np.zeros(6), np.zeros((len(readings), 2)),
        _heading(readings, model, C_bk, trust),
    )  # fmt: skip
    if free is not None and trust.position_sd > 0:
        geometry = geometry.pointed(free.geometry.directions())
    return State(model, geometry, np.zeros(3))


def _heading(readings: Readings, model: ImuModel, C_bk: FloatArray, trust: Trust) -> float | None:
    """Find the azimuth of table y from the horizontal rates at rest."""
    rest = ~readings.spin
    if readings.gyro is None or trust.latitude is None or not rest.any():
        return None
    _, w_b = model.compensate(None, readings.gyro[rest])
    assert w_b is not None
    C_tk = turntable.chain(readings.angles[rest]).C_tk
    w_t = np.einsum("nij,nj->ni", C_tk, w_b @ C_bk).mean(axis=0)
    return float(np.arctan2(-w_t[0], w_t[1]))


def _affine(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Solve ``y = M x + b``, shapes (n, 3); None if inputs do not span or an axis is dead."""
    size = float(np.abs(x).max()) or 1.0
    rows = np.column_stack([x / size, np.ones(len(x))])
    fit, _, rank, _ = np.linalg.lstsq(rows, y, rcond=1e-9)
    if rank < 4 or np.linalg.cond(fit[:3]) > DEAD:
        return None
    return np.asarray(fit[:3].T / size), np.asarray(fit[3])


ENOUGH = 8.0  # With fewer degrees of freedom scatter is added only where it is significant [1].


@dataclass(frozen=True)
class TableFit:
    """A solution, and which readings are wrong."""

    fit: mixed.Fit
    # (k,) observations of which one is wrong, but it cannot be told which, see `TableModel.rows`
    suspects: tuple[int, ...] = ()
    # (k,) readings of which the angles of one are wrong, but it cannot be told which
    angle_suspects: tuple[int, ...] = ()
    # (p, 3 k) what a unit of each component does to the coefficients of another solution than the
    # fit's, None: they are the fit's [SI]
    gain: FloatArray | None = None
    left_out: Judgement | None = None  # what was made of the terms that are not estimated

    @property
    def model(self) -> TableModel:
        """What was fitted."""
        model = self.fit.model
        assert isinstance(model, TableModel)
        return model

    @property
    def estimate(self) -> Estimate:
        """What was estimated."""
        return self.fit.estimate

    @property
    def scatter(self) -> dict[str, float]:
        """Source -> scatter that was found beyond the noise, see `likelihood` [SI]."""
        return {name: sd for name, sd in self.fit.found.items() if sd > 0}

    @property
    def outliers(self) -> tuple[int, ...]:
        """The observations that were left out, see `TableModel.rows`."""
        return tuple(int(b) for b in self.model.rows[self.fit.outliers])

    @property
    def wrong_angles(self) -> tuple[int, ...]:
        """The readings whose table angles were not believed, because they are far off."""
        geometry = self.estimate.state.geometry
        return geometry.doubted if isinstance(geometry, Angles) else ()

    @cached_property
    def snooping(self) -> Snooping:
        """Tests of the observations at the solution, outliers left out."""
        return snoop_fit(self.fit)

    def solved(self, state: State | None = None, weights: FloatArray | None = None) -> TableFit:
        """Solve again, sizes held, from `state`, observations counting `weights` (k,) [1]."""
        old = self.fit
        at = self.estimate.state if state is None else state
        weights = self.estimate.weights if weights is None else weights
        fit = mixed.solve(old.model, old.sds, weights, at)
        if old.found:
            fit = replace(fit, found=old.found, dof=old.dof, before=old.before)
        return replace(self, fit=fit)


def fit(
    readings: Readings,
    site: Site,
    start: State,
    options: Options,
    columns: Callable[[TableModel], Columns] | None = None,
) -> TableFit:
    """Estimate the coefficients, the outliers, and the scatter that the noise leaves unexplained.

    `readings`: means with the covariance of their noise [SI]; `start`: where to start, its
    geometry says what is believed of the table; `options`: how to fit. A prior comes last, when
    outliers and scatter are settled: they would take up what contradicts it. `columns` or None: of
    what is not estimated, judged before all of these.
    """
    model, prior = TableModel(readings, site, start, options), options.prior
    judged = None
    if columns is not None:
        first, judged = left_out.fit(model, columns(model), prior)
        assert isinstance(first.model, With)
        more = tuple(s for s in first.model.more if s.name in judged.groups)
        model = replace(model, more=more, sizes=first.model.sizes)
        prior = first.problem.prior
    alone = mixed.solve(model)
    if alone.estimate.status is Status.UNOBSERVABLE and prior is not None:
        only = mixed.fit(model, prior, robust=options.robust, own=bool(model.more))
        return TableFit(only, left_out=judged)
    told = dict.fromkeys((s.name for s in model.sources if s.unexplained), 0.0)
    for kind, c in alone.after.items():
        if FOUND_IN[kind][-1] in told:
            told[FOUND_IN[kind][-1]] += c.redundancy
    if ALONG in told:  # it comes on top of another, and the ratio of both variances tells it
        told[ALONG] = 1 / (1 / max(told[ALONG], 1e-9) + 1 / max(told[IN_SPINS], 1e-9))
    few = frozenset(name for name, dof in told.items() if dof < ENOUGH)
    found = TableFit(replace(alone, model=replace(model, tested=few)))
    suspects: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()
    for _ in range(2):  # outliers make scatter, and scatter makes outliers: look twice for each
        now = found
        if options.robust:
            now, alike_angles = _without_wrong_angles(now)
            angles = angles or alike_angles
            now, alike = _without_outliers(now)
            suspects = suspects or alike
        # A noise that nobody knows, and was made up, bends everything: its scatter is found twice.
        if now is found and found.fit.found and readings.noise_from != "unknown":
            break
        found = now
        if options.repeatability:
            again = mixed.fit(now.fit.model, near=now.fit, own=bool(model.more))
            found = replace(now, fit=again)
    if isinstance(found.estimate.state.geometry, Angles):
        found = _believed_again(found)
    return TableFit(mixed.with_prior(found.fit, prior), suspects, angles, left_out=judged)


def _without_wrong_angles(found: TableFit) -> tuple[TableFit, tuple[int, ...]]:
    """Stop believing the angles of the positions that are far off, one by one.

    One angle that was typed wrong is no error of the table: believed, it turns the instrument's
    axes, and as scatter of the readings it would be shared by all of them.
    """
    geometry = found.estimate.state.geometry
    if not isinstance(geometry, Angles) or geometry.trust.position_sd == 0:
        return found, ()
    for _ in range(1 + len(found.model.readings) // 5):
        worst = _worst_angle(found)
        if worst is None:
            break
        j, alike = worst
        if len(alike):
            return found, tuple(sorted((j, *alike)))
        state = found.estimate.state
        doubted = tuple(sorted((*state.geometry.doubted, j)))
        found = found.solved(replace(state, geometry=replace(state.geometry, doubted=doubted)))
    return found, ()


def angle_tests(found: TableFit) -> Snooping:
    """Test the angles of each position, believed with known errors, against the readings."""
    at, geometry = found.fit.white, found.estimate.state.geometry
    first = int(np.sum(at.blocks >= 0)) + len(geometry.used)
    rows = slice(first, first + geometry.position.size)
    number = np.repeat(np.arange(len(geometry.position)), 2)
    alone = Linearised(at.residuals[rows], at.jacobian[rows], number)
    return snoop(alone, found.estimate.state_cov, rows=2)


def _worst_angle(found: TableFit) -> tuple[int, tuple[int, ...]] | None:
    """Return the reading whose angles stand out, and those that would look the same."""
    s, r = angle_tests(found), found.snooping
    seen = np.flatnonzero(s.dof > 0)
    if len(seen) < 2:
        return None
    # A table worse than declared is another matter: one position must stand out from the others.
    usual = max(1.0, float(np.median(s.test[seen] / s.dof[seen])) / MEDIAN)
    alpha = FALSE_ALARM / len(s.blocks)
    limits = np.array([chi_square_limits(d, 2 * alpha)[1] for d in s.dof[seen]])
    score = s.test[seen] / usual / limits
    best = int(np.argmax(score))
    if score[best] <= 1.0:
        return None
    j = int(seen[best])
    own = np.flatnonzero(found.model.rows == j)
    if len(own):
        # Where the specific force has another size than gravity, it is the reading that is wrong.
        rests = found.model.kind < 2
        noise = max(1.0, float(np.median(r.test[rests] / np.maximum(r.dof[rests], 1.0))) / MEDIAN)
        more = float(r.test[own[0]] - s.test[j]) / noise
        if r.dof[own[0]] > s.dof[j] and more > chi_square_limits(1.0, 2 * alpha)[1]:
            return None
    return j, tuple(int(b) for b in s.alike(j))


def _believed_again(found: TableFit) -> TableFit:
    """Believe angles again that are not far off once the scatter of the readings is known."""
    state = found.estimate.state
    g: Angles = state.geometry
    if not g.doubted:
        return found
    first = found.model.options.unknowns.before_geometry + 3 + len(g.used)
    limit = chi_square_limits(2.0, 2 * FALSE_ALARM / len(g.position))[1]
    kept = []
    for j in g.doubted:
        own = slice(first + 2 * j, first + 2 * j + 2)
        cov = found.estimate.state_cov[own, own] + g.trust.position_sd**2 * np.eye(2)
        if g.position[j] @ np.linalg.solve(cov, g.position[j]) > limit:
            kept.append(j)
    if len(kept) == len(g.doubted):
        return found
    return found.solved(replace(state, geometry=replace(g, doubted=tuple(kept))))


MEDIAN = 0.693  # Median of chi-square with two degrees of freedom over its mean, ln 2 [1].


def _without_outliers(found: TableFit) -> tuple[TableFit, tuple[int, ...]]:
    """Take the worst observations out one by one; return those of which one is wrong, if any."""
    for _ in range(1 + len(found.model.readings) // 5):
        worst = _worst(found)
        if worst is None:
            break
        alike = found.snooping.alike(worst)
        if len(alike):
            return found, tuple(sorted(int(b) for b in found.model.rows[[worst, *alike]]))
        weights = found.estimate.weights.copy()
        weights[worst] = gauss_newton.LEFT_OUT
        found = found.solved(weights=weights)
    return found, ()


def _worst(found: TableFit) -> int | None:
    """Return the row of the observation that is significantly worse than the others of its kind.

    Where one kind fits badly as a whole, only it is looked at: it shows in the others too.
    """
    from scipy.special import fdtri

    s, after = found.snooping, found.fit.after
    kept, noise = found.estimate.weights > 0.5, found.model.readings.noise_from
    score = np.zeros(len(s.blocks))
    # Poses by hand tie rates to forces by nothing but up.
    bad = [n for n, c in after.items() if c.chi_square > c.high and found.model.readings.spin.any()]
    worst_kind = max(bad, key=lambda name: after[name].ratio) if bad else None
    for k, name in enumerate(KINDS[:4]):
        mine = np.flatnonzero((found.model.kind == k) & kept & (s.dof > 0))
        parts = {*KINDS[3:]} if k == 3 else {name}
        if not len(mine) or (worst_kind is not None and worst_kind not in parts):
            continue
        # While a noise is not known, rates scatter along up alone: of three components one counts.
        if k == 2 and found.model.earth_unknown and noise == "unknown" and not found.fit.found:
            continue
        # Forces and rates of a spin share its axis: forces take up how far all rates scatter.
        sharing = parts | {KINDS[3]} if k == 1 else parts
        components = [after[part] for part in sharing if part in after]
        # What the others say, of all their residuals and of each kind: one kind may be far worse.
        others, left = np.ones(len(mine)), np.zeros(len(mine))
        whole = [sum(c.chi_square for c in components), sum(c.redundancy for c in components)]
        for square, redundancy in (*((c.chi_square, c.redundancy) for c in components), whole):
            left = np.maximum(redundancy - s.dof[mine], 0.0)
            rest = np.maximum(square - s.test[mine], 0.0) / np.maximum(left, 0.5)
            others = np.where(left > 0.5, np.maximum(others, rest), others)
        # Noise may be too small for all, above all where it was measured; one reading must stand
        # out from the others then. Where it fits them, it is the better yardstick.
        top = np.array([chi_square_limits(max(n, 1e-3))[1] for n in left])
        too_small = (others > 1.0) & ((not found.model.readings.declared) | (others * left > top))
        common = np.where(too_small, others, 1.0)
        alpha = FALSE_ALARM / len(s.blocks)
        known = np.array([chi_square_limits(d, 2 * alpha)[1] for d in s.dof[mine]])
        pairs = zip(s.dof[mine], left, strict=True)
        fitted = np.array([d * float(fdtri(d, max(n, 1.0), 1 - alpha)) for d, n in pairs])
        limit = np.where(too_small, fitted, known)
        score[mine] = s.test[mine] / common / limit
    worst = int(np.argmax(score))
    return worst if score[worst] > 1.0 else None
