"""The likelihood of readings on a table, whatever is believed of the table.

Where nothing is believed of it (`table_geometry.Free`) this is norm observation for accelerometers
and gyros with the unification of their frames, all at once. Where the angles are believed exactly
it is the traditional multi-position method, and with errors of known size
(`table_geometry.Angles`) the joint estimate of instrument and table.

The covariance of a reading is that of its noise and of what is not modelled: the run-to-run jitter
of the spin rate, and at rest the horizontal part of the Earth's rotation where the heading is
unknown, a vector of known size and unknown direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton, norm_observation
from foucault.estimate.table.parallel_vectors import unify, wahba
from foucault.models import turntable
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles, Free, Trust, tangents
from foucault.models.table_state import State, Unknowns, moved, predict
from foucault.result import Estimate, Linearised, Problem

DEAD = 1e6
"""Axes whose scale factors differ by more do not all read something [1]."""


@dataclass(frozen=True)
class Observed:
    """Readings with the covariance they have under the model, and their whitening."""

    readings: Readings  # the readings [SI]
    site: Site
    # accel_cov, gyro_cov: (n, 3, 3) covariance of the means under the model [SI]
    accel_cov: FloatArray
    gyro_cov: FloatArray
    gyro_used: npt.NDArray[np.bool_]  # (n,) where the rate is looked at

    @cached_property
    def accel_root(self) -> FloatArray:
        """Matrices that whiten the residuals of the specific forces, shape (n, 3, 3) [1 / SI]."""
        return whitening(self.accel_cov)

    @cached_property
    def gyro_root(self) -> FloatArray:
        """Matrices that whiten the residuals of the rates, shape (n, 3, 3) [1 / SI].

        In spins the first row is along the axis, where errors of the table's rate act.
        """
        if self.readings.gyro is None:  # nothing to whiten: their covariance is empty
            return np.broadcast_to(np.eye(3), self.gyro_cov.shape)
        w = self.readings.gyro
        axis = np.where(self.readings.spin[:, None], w, [1.0, 0.0, 0.0])
        return whitening(self.gyro_cov, axis / np.linalg.norm(axis, axis=1, keepdims=True))

    @cached_property
    def wander_roots(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Matrices that whiten the slow biases of accelerometers and gyros, shape (n, n) [1 / SI].

        None where nothing slow was declared.
        """
        accel, gyro = (None if cov is None else _root(cov) for cov in self.readings.wander())
        return accel, gyro

    @classmethod
    def of(
        cls,
        readings: Readings,
        site: Site,
        start: State,
        *,
        rate_sd: float = 0.0,
        gyro_at_rest: bool = True,
    ) -> Observed:
        """Add to the noise what is not modelled.

        `readings`: means with the covariance of their noise [SI]; `start`: where the fit starts:
        which way is up, and whether the heading is modelled; `rate_sd`: relative sd of the rate
        from one spin to the next [1]; `gyro_at_rest`: whether to look at the rates at rest where
        the heading is unknown: they say little of the bias beside the spins, but all there is of
        a g-sensitivity.
        """
        heading_known = isinstance(start.geometry, Angles) and start.geometry.heading is not None
        readings = readings.without_wander()  # which is unknowns of its own, see `build`
        gyro_cov = readings.gyro_cov
        if readings.gyro is not None:
            w = np.where(readings.spin[:, None], readings.gyro, 0.0)
            gyro_cov = gyro_cov + rate_sd**2 * w[:, :, None] * w[:, None, :]
            rest = ~readings.spin
            if rest.any() and not heading_known:
                gyro_cov = gyro_cov.copy()
                earth = _unknown_earth(start.geometry.directions()[rest], site)
                # As the gyros see it: a percent of it is more than the noise of a good gyro.
                gyro_cov[rest] += start.model.gyro_matrix @ earth @ start.model.gyro_matrix.T
        used = readings.spin | heading_known | gyro_at_rest
        return cls(readings, site, readings.accel_cov, gyro_cov, used)


def _root(cov: FloatArray) -> FloatArray:
    """Return a matrix that whitens: also what a correlation time of days makes nearly alike."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray(axes.T / np.sqrt(np.maximum(size, STIFF * size[-1]))[:, None])


STIFF = 1e-10
"""Slow biases differ by more than this part of their variance [1]."""


def _unknown_earth(up: FloatArray, site: Site) -> FloatArray:
    """Covariance of the part of the Earth's rotation whose direction is unknown.

    Its size is known; it gets a variance of the size squared, twice that of a random direction,
    because the directions of several rests may be alike.
    """
    eye = np.eye(3)
    if site.latitude is None:
        return np.broadcast_to(EARTH_RATE**2 * eye, (len(up), 3, 3))
    size = (EARTH_RATE * np.cos(site.latitude)) ** 2
    return np.asarray(size * (eye - up[:, :, None] * up[:, None, :]))


def whitening(cov: FloatArray, first: FloatArray | None = None) -> FloatArray:
    """Return inverse Cholesky factors of covariances, shape (n, 3, 3) [1 / SI].

    `cov` (n, 3, 3): covariances [SI]; `first` (n, 3): unit vectors along which the first white
    residual is taken, None takes x [1].
    """
    if first is None:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(cov)))
    B = np.concatenate([first[:, :, None], tangents(first)], axis=2)
    across = np.swapaxes(B, 1, 2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(across @ cov @ B)) @ across)


def build(
    observed: Observed,
    names: tuple[str, ...],
    start: State,
    *,
    lever_arm: bool,
    level: bool,
    offset: bool = False,
    prior: CoefficientVector | None = None,
) -> Problem:
    """Build the least-squares problem.

    `observed`: readings and their covariance [SI]; `start`: where to start, its geometry says
    what is believed of the table; `prior` or None: Gaussian prior on the coefficients.
    """
    wander = observed.wander_roots
    unknowns = Unknowns(
        names, lever_arm, level, offset, (wander[0] is not None, wander[1] is not None)
    )
    return Problem(
        layout=LAYOUT.subset(names),
        start=start,
        linearise=partial(_linearise, observed, unknowns),
        retract=lambda state, step: moved(state, step, unknowns),
        values=lambda state: state.model.coefficients(names).values,
        n_blocks=2 * len(observed.readings),
        prior=prior,
    )


def _linearise(
    observed: Observed, unknowns: Unknowns, state: State, weights: FloatArray
) -> Linearised:
    """White residuals: block j is the specific force of reading j, block n + j its rate."""
    r, n = observed.readings, len(observed.readings)
    at = predict(state, r, observed.site, unknowns)
    residuals, slopes, blocks = [], [], []
    everywhere = np.ones(n, bool)
    rows = (
        (r.accel, at.accel, at.accel_slope, observed.accel_root, 0, everywhere),
        (r.gyro, at.gyro, at.gyro_slope, observed.gyro_root, n, observed.gyro_used),
    )
    for measured, predicted, slope, root, first, used in rows:
        if measured is None:
            continue
        root = (root * np.sqrt(weights[first : first + n])[:, None, None])[used]
        miss = (measured - predicted)[used]
        residuals.append(np.einsum("nij,nj->ni", root, miss).reshape(-1))
        slopes.append((root @ slope[used]).reshape(residuals[-1].size, slope.shape[2]))
        blocks.append(np.repeat(first + np.flatnonzero(used), 3))
    value, sd = state.geometry.prior()
    known = np.flatnonzero(np.isfinite(sd))
    prior = np.zeros((len(known), slopes[0].shape[1]))
    prior[np.arange(len(known)), unknowns.before_geometry + known] = 1.0 / sd[known]
    residuals.append(-value[known])
    slopes.append(prior)
    for miss, slope in _slow_rows(observed, state, unknowns.before_geometry + len(sd), prior):
        residuals.append(miss)
        slopes.append(slope)
    out, observations = np.concatenate(residuals), sum(len(b) for b in blocks)
    return Linearised(
        out,
        np.concatenate(slopes),
        np.concatenate([*blocks, np.full(len(out) - observations, -1)]),
    )


def _slow_rows(
    observed: Observed, state: State, column: int, like: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Return what is known of the slow biases: white residuals and slopes of each triad.

    Their unknowns begin at `column`; the slopes have as many columns as `like`.
    """
    n, out = len(observed.readings), []
    for k, white in enumerate(observed.wander_roots):
        if white is None:
            continue
        now = np.zeros((n, 3)) if state.wander is None else state.wander[:, 3 * k : 3 * k + 3]
        slope = np.zeros((3 * n, like.shape[1]))
        slope[:, column : column + 3 * n] = np.kron(white, np.eye(3))
        out.append((-(white @ now).reshape(-1), slope))
        column += 3 * n
    return out


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


def fit(
    observed: Observed,
    names: tuple[str, ...],
    start: State,
    *,
    lever_arm: bool,
    level: bool,
    offset: bool = False,
    prior: CoefficientVector | None = None,
    loss: gauss_newton.Loss = gauss_newton.huber,
) -> tuple[Problem, Estimate]:
    """Maximise the likelihood.

    `observed`: readings and their covariance [SI]; `prior` or None: Gaussian prior on the
    coefficients; `loss`: ``norms -> weights``, see `gauss_newton.solve`.
    """
    problem = build(
        observed, names, start, lever_arm=lever_arm, level=level, offset=offset, prior=prior
    )
    return problem, gauss_newton.solve(problem, loss=loss)
