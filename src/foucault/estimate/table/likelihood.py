"""The model of readings on a table, whatever is believed of the table.

Where nothing is believed of it (`table_geometry.Free`) this is norm observation for accelerometers
and gyros with the unification of their frames, all at once. Where the angles are believed exactly
it is the traditional multi-position method, and with errors of known size
(`table_geometry.Angles`) the joint estimate of instrument and table.

Every reading is two observations, its specific force and its rate. The rate of a spin is taken
along its axis and across it: errors of the table's rate act along, and are a kind of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate import norm_observation
from foucault.estimate.table.parallel_vectors import unify, wahba
from foucault.infer.mixed import (
    NOISE_BASIS,
    SIGNIFICANT,
    UNEXPLAINED_BASIS,
    Linearisation,
    Source,
)
from foucault.models import turntable
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles, Free, Trust, tangents
from foucault.models.table_state import State, Unknowns, moved, predict

DEAD = 1e6
"""Axes whose scale factors differ by more do not all read something [1]."""

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
            Source(f"{name} noise", self._own(mine, _root(cov)[j]), noise=True,
                   type=kind, basis=basis)
            for name, mine, cov in (
                ("accelerometer", accel, quick.accel_cov), ("gyro", ~accel, quick.gyro_cov)
            ) if mine.any()
        ]  # fmt: skip
        out = [*noise, *self._wander()]
        w = np.zeros((len(j), 3, 1)) if r.gyro is None else r.gyro[j][:, :, None]
        turning = self._own(spin, w)  # per unit of the rate
        if o.rate_sd:
            out.append(
                Source("jitter of the spin rate", turning, sd=o.rate_sd, basis="rate_sd as given")
            )
        if (self.kind == 2).any() and not self._heading_known:
            out.append(self._earth())
        kind, basis = UNEXPLAINED_BASIS
        scatter = {
            FORCES: self._own(accel, eye), AT_REST: self._own(self.kind == 2, eye),
            IN_SPINS: self._own(spin, eye), ALONG: turning,
        }  # fmt: skip
        # Noise that was measured within readings is a lower limit of what differs between them:
        # what is more is always added, where enough of them tell it. A noise that nobody knows is
        # all scatter.
        tested = {"declared": set(scatter), "measured": self.tested, "unknown": set()}
        out += [
            Source(
                name, each, sd=None, unexplained=True, type=kind, basis=basis,
                price=SIGNIFICANT if name in tested[r.noise_from] else 0.0,
            )
            for name, each in scatter.items()
            if o.repeatability and each.any()
        ]  # fmt: skip
        return tuple(out)

    def _own(self, mine: BoolArray, roots: FloatArray) -> FloatArray:
        """Turn roots (k, 3, c) or (3, c) from body axes to those of the observations `mine`."""
        return np.where(mine[:, None, None], self.axes @ roots, 0.0)

    def _wander(self) -> list[Source]:
        """Return the slow biases as they were declared: they tie the readings together."""
        out, j = [], self.rows % len(self.readings)
        mine = (self.kind < 2, self.kind >= 2)
        for name, own, cov in zip(
            ("accelerometer", "gyro"), mine, self.readings.wander(), strict=True
        ):
            if cov is not None:
                shared = np.einsum("kij,kl->kilj", self._own(own, np.eye(3)), _root(cov)[j])
                out.append(Source(
                    f"wandering {name} bias", shared=shared.reshape(len(j), 3, -1), noise=True,
                    basis="bias instability and random walk as given",
                ))  # fmt: skip
        return out

    def _earth(self) -> Source:
        """Return the horizontal part of the Earth's rotation at rest, where the heading is unknown.

        A vector of known size, another one in every rest: nothing tells how a table was turned of
        which nothing is believed. It gets a variance of the size squared along each axis, twice
        that of a random direction, because the directions of several rests may be alike.
        """
        start, j = self.start, self.rows % len(self.readings)
        # As the gyros see it: a percent of it is more than the noise of a good gyro.
        across = start.model.gyro_matrix @ tangents(start.geometry.directions())
        return Source(
            "unknown heading", self._own(self.kind == 2, across[j]),
            sd=EARTH_RATE * np.cos(self.site.latitude or 0.0),
            basis="heading not given: the whole circle",
        )  # fmt: skip

    def retract(self, state: State, step: FloatArray) -> State:
        """Apply `step` (m,) to a state [SI]."""
        return moved(state, step, self.options.unknowns)

    def values(self, state: State) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return state.model.coefficients(self.options.names).values


def _root(cov: FloatArray) -> FloatArray:
    """Return a root of covariances, also of what a correlation time of days makes nearly alike."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0))[..., None, :])


# -- starts --------------------------------------------------------------------------------


def free_start(readings: Readings, site: Site, lever_arm: bool) -> State | None:
    """Solve by the linear norm observation and the parallel vectors; None where that is singular.

    `readings`: rests and spins [SI].
    """
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
    """Solve as if the table were perfect; None where that is singular.

    `readings`: rests and spins with the angles of the table [SI].
    """
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
