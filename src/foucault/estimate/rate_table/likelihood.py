"""The likelihood of gyro readings on a rate table: several constant rates about each axis.

In step k the table turns at the rate W_k about the vertical, and the placement of the instrument
says which of its axes is there: ``u`` in fixture axes, tilted by what the fixture is out of square.
Over whole turns the mean rate is that of table and Earth along u; with ``r = (I + S + M) w``::

    w = (W (1 + e) + v) u        gyro = r + A |r| + C r^3 + b + G f        f = g u + (centripetal)

e is the error that all rates of the table share, v the Earth's rate along the vertical. Neither is
seen by the gyros alone, nor are the tilts: they enter with a prior, and so the covariance. The
horizontal part of the Earth's rotation turns with the table: what a part of a turn leaves of it,
``w_ie cos(L) |sinc(turns)|``, and the jitter of the table from one step to the next are added to
the covariance of each reading. Rests whose table angles are known share it: it is one vector in
each placement, with a prior, turned by those angles. Added too is a bias that moves at random from
step to step; where it moves slowly, each step has a bias of its own, with a prior that ties it to
those of the steps near it.

References
----------
.. [1] IEEE Std 647-2006, annex A, and IEEE Std 952-1997, section 12 (rate table tests).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.rate_steps import Steps
from foucault.models.readings import wander
from foucault.result import Estimate, Linearised, Problem

ANY_LATITUDE = 1 / np.sqrt(3)
"""Sd of the sine of a latitude of which nothing is known, all places being alike [1]."""


@dataclass(frozen=True)
class Trust:
    """What is believed of table, fixture, place and bias."""

    rate_sd: float = 0.0  # sd of the relative error that all rates share; 0: none [1]
    rate_jitter: float = 0.0  # sd of another relative error of each step [1]
    # sd of the tilt of each placement about either level axis; 0: none [rad]
    fixture_sd: float = 0.0
    latitude: float | None = None  # geodetic latitude, positive north; None where unknown [rad]
    # sd of how far the bias of each gyro moves during the session; 0: not at all [rad/s]
    bias_sd: float = 0.0
    # correlation time of that; 0: another bias in every step; infinite: a straight line [s]
    bias_time: float = 0.0

    @property
    def drifts(self) -> bool:
        """Whether the bias moves slowly, so that steps near one another share it."""
        return self.bias_sd > 0 and self.bias_time > 0

    @property
    def vertical(self) -> float:
        """The Earth's rate along up, 0 where unknown [rad/s]."""
        return 0.0 if self.latitude is None else float(EARTH_RATE * np.sin(self.latitude))

    @property
    def vertical_sd(self) -> float:
        """Its sd, 0 where known [rad/s]."""
        return EARTH_RATE * ANY_LATITUDE if self.latitude is None else 0.0

    @property
    def horizontal(self) -> float:
        """The Earth's rate across up, or what it can be at most [rad/s]."""
        return EARTH_RATE * (1.0 if self.latitude is None else abs(np.cos(self.latitude)))


@dataclass(frozen=True)
class State:
    """Where the fit is."""

    model: ImuModel  # errors of the instrument
    rate_error: float  # relative error that all rates share, true over said minus 1 [1]
    vertical: float  # the Earth's rate along up, beyond what is known of it [rad/s]
    # (p, 2) tilt of the spin axis in each placement, towards the next two axes of the fixture [rad]
    tilt: FloatArray
    # (n, 3) what moves the bias from step to step, independent and of unit sd; None: it stays [1]
    drift: FloatArray | None = None
    # (p, 2) the Earth's rate in each placement across up, where the table angle is 0, along the
    # next two axes of the fixture, in units of `Trust.horizontal` [1]
    level: FloatArray | float = 0.0


def wanders(steps: Steps, trust: Trust) -> bool:
    """Tell whether the bias moves slowly, as the steps showed or as was declared."""
    return trust.drifts or steps.slow is not None


def wander_root(steps: Steps, trust: Trust) -> FloatArray:
    """Return the root L of the covariance of all slow moves of the bias, shape (n, n) [rad/s].

    `steps`: the steps, with the wander that was declared [SI].
    """
    if steps.slow is None:
        return drift_root(steps, trust)
    cov = wander(steps.slow, steps.middle, steps.time)
    if trust.drifts:
        found = drift_root(steps, trust)
        cov = cov + found @ found.T
    least = 1e-9 * float(np.diag(cov).max())
    return np.asarray(np.linalg.cholesky(cov + max(least, 1e-40) * np.eye(len(steps))))


def drift_root(steps: Steps, trust: Trust) -> FloatArray:
    """Return the root L of the covariance of a drift of the bias, shape (n, n) [rad/s].

    `steps`: the steps [SI]; `trust`: how far the bias moves, and how fast: a Gauss-Markov
    process, or a straight line.
    """
    if np.isinf(trust.bias_time):
        line = np.zeros((len(steps), len(steps)))
        line[:, 0] = steps.middle - steps.half_time
        return np.asarray(trust.bias_sd * line / max(np.sqrt(np.mean(line[:, 0] ** 2)), 1e-12))
    apart = np.abs(steps.middle[:, None] - steps.middle)
    alike = np.exp(-apart / trust.bias_time) + 1e-9 * np.eye(len(steps))
    return np.asarray(trust.bias_sd * np.linalg.cholesky(alike))


def tilts(steps: Steps) -> FloatArray:
    """Return the directions that the tilts of each step move up in, shape (n, 3, 2) [1]."""
    eye, axis = np.eye(3), steps.axis
    return np.stack([eye[(axis + 1) % 3], eye[(axis + 2) % 3]], axis=2)


def shared(steps: Steps) -> BoolArray:
    """Tell which steps are rests whose azimuth the table told, shape (n,)."""
    told = np.zeros(len(steps), bool) if steps.azimuth is None else np.isfinite(steps.azimuth)
    return np.asarray(told & (steps.rate == 0.0))


def level_slope(steps: Steps, trust: Trust) -> FloatArray:
    """Return the derivatives of the rate in each step by `State.level`, (n, 3, 2) [rad/s]."""
    mine = shared(steps)
    turn = np.where(mine, 0.0 if steps.azimuth is None else steps.azimuth, 0.0) * steps.sense
    c, s = np.cos(turn), np.sin(turn)
    back = np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0)  # as seen by what is turned
    return np.asarray(trust.horizontal * mine[:, None, None] * (tilts(steps) @ back))


def true_rate(steps: Steps, trust: Trust, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the rate along the spin axis, shape (n,), and that axis, shape (n, 3) [rad/s], [1].

    `steps`: the steps [SI].
    """
    h = steps.rate * (1.0 + state.rate_error) + trust.vertical + state.vertical
    u = steps.up + np.einsum("nij,nj->ni", tilts(steps), state.tilt[steps.placement])
    return h, u / np.linalg.norm(u, axis=1, keepdims=True)


def covariance(steps: Steps, trust: Trust) -> dict[str, FloatArray]:
    """Return the covariance of the readings by source, shape (n, 3, 3) each [(rad/s)^2].

    `steps`: the steps [SI].
    """
    # A part of a turn begins at any azimuth; rests may all have the same one.
    left = trust.horizontal * np.abs(np.sinc(steps.turns))
    left = np.where(steps.rate == 0.0, 1.0, np.sqrt(0.5)) * left * ~shared(steps)
    across = np.eye(3) - steps.up[:, :, None] * steps.up[:, None, :]
    turning = np.where((steps.rate != 0.0)[:, None], steps.gyro, 0.0)
    moved = 0.0 if trust.drifts else trust.bias_sd
    return {
        "gyro noise": steps.cov,
        "bias drift": np.broadcast_to(moved**2 * np.eye(3), steps.cov.shape),
        "rate jitter": trust.rate_jitter**2 * turning[:, :, None] * turning[:, None, :],
        "parts of turns": (left**2)[:, None, None] * across,
    }


def whitening(parts: list[FloatArray]) -> FloatArray:
    """Return the matrices that whiten the readings, shape (n, 3, 3) [1/(rad/s)].

    `parts` (n, 3, 3): covariances that add up, jitter alone, along one axis, has no inverse
    [(rad/s)^2].
    """
    total = np.sum(parts, axis=0)
    least = 1e-13 * np.trace(total, axis1=1, axis2=2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total + least[:, None, None] * np.eye(3))))


@dataclass(frozen=True)
class Unknowns:
    """Which parameters there are, in the order of a step."""

    names: tuple[str, ...]
    # (m,) sd of what follows them: rate error, Earth's rate, tilts, drift [SI]
    prior_sd: FloatArray
    sources: tuple[str, ...]  # source of uncertainty that each of these m is

    @classmethod
    def of(cls, names: tuple[str, ...], steps: Steps, trust: Trust) -> Unknowns:
        """Take what `trust` leaves open of `steps`."""
        rows = [("rate of the table", trust.rate_sd), ("unknown Earth rate", trust.vertical_sd)]
        if trust.fixture_sd > 0:
            rows += [("fixture", trust.fixture_sd)] * (2 * _placements(steps))
        if shared(steps).any():
            rows += [("level Earth rate", np.sqrt(0.5))] * (2 * _placements(steps))
        rows += [("bias drift", 1.0)] * (3 * len(steps) * wanders(steps, trust))
        rows = [row for row in rows if row[1] > 0]
        return cls(names, np.array([sd for _, sd in rows]), tuple(name for name, _ in rows))

    def columns(self, source: str) -> slice:
        """Return the columns of one source of uncertainty."""
        n = len(self.names)
        first = n + (self.sources.index(source) if source in self.sources else 0)
        return slice(first, first + self.sources.count(source))


def _placements(steps: Steps) -> int:
    return int(steps.placement.max()) + 1


def build(
    steps: Steps,
    names: tuple[str, ...],
    trust: Trust,
    prior: CoefficientVector | None = None,
    start: State | None = None,
) -> Problem:
    """Build the least-squares problem; block j is step j.

    `steps`: what was measured [SI]; `trust`: what is believed of table, fixture and place;
    `prior` or None: Gaussian prior on the coefficients; `start`: where to start, None starts with
    the straight lines through the readings.
    """
    unknowns = Unknowns.of(names, steps, trust)
    root = whitening(list(covariance(steps, trust).values()))
    return Problem(
        layout=LAYOUT.subset(names),
        start=start or _start(steps, trust),
        linearise=partial(_linearise, steps, trust, unknowns, root),
        retract=partial(_moved, unknowns),
        values=lambda state: state.model.coefficients(names).values,
        n_blocks=len(steps),
        prior=prior,
    )


def fit(
    steps: Steps,
    names: tuple[str, ...],
    trust: Trust,
    prior: CoefficientVector | None = None,
    loss: gauss_newton.Loss = gauss_newton.huber,
) -> tuple[Problem, Estimate]:
    """Maximise the likelihood.

    `steps`: what was measured [SI]; `trust`: what is believed of table, fixture and place;
    `prior` or None: Gaussian prior on the coefficients; `loss`: ``norms -> weights``, see
    `gauss_newton.solve`.
    """
    problem = build(steps, names, trust, prior)
    return problem, gauss_newton.solve(problem, loss=loss)


def _start(steps: Steps, trust: Trust) -> State:
    """Take the straight lines through all readings, where there are enough to have them."""
    drift = np.zeros((len(steps), 3)) if wanders(steps, trust) else None
    state = State(ImuModel(), 0.0, 0.0, np.zeros((_placements(steps), 2)), drift)
    h, u = true_rate(steps, trust, state)
    size = float(np.abs(h).max()) or 1.0
    rows = np.column_stack([h[:, None] * u / size, np.ones(len(h))])
    solved, _, rank, _ = np.linalg.lstsq(rows, steps.gyro, rcond=1e-9)
    if rank < 4:
        return state
    matrix, bias = np.asarray(solved[:3].T / size), np.asarray(solved[3])
    return replace(state, model=ImuModel(gyro_matrix=matrix, gyro_bias=bias))


def _linearise(
    steps: Steps, trust: Trust, unknowns: Unknowns, root: FloatArray, state: State,
    weights: FloatArray,
) -> Linearised:  # fmt: skip
    model, n = state.model, len(steps)
    h, u = true_rate(steps, trust, state)
    w = h[:, None] * u
    level = np.zeros((_placements(steps), 2)) + state.level
    by_level = level_slope(steps, trust)
    w = w + np.einsum("nij,nj->ni", by_level, level[steps.placement])
    g = np.linalg.norm(steps.force, axis=1)[:, None]
    force = steps.force + g * (u - steps.up)
    slopes = model.slopes(force, w, unknowns.names)
    parts = [slopes.gyro]
    by_rate = slopes.gyro_by_rate @ u[:, :, None]  # by h, shape (n, 3, 1)
    if trust.rate_sd > 0:
        parts.append(by_rate * steps.rate[:, None, None])
    if trust.vertical_sd > 0:
        parts.append(by_rate)
    if trust.fixture_sd > 0:
        across = (np.eye(3) - u[:, :, None] * u[:, None, :]) @ tilts(steps)
        mine = slopes.gyro_by_rate @ (h[:, None, None] * across)
        mine += slopes.gyro_by_force @ (g[:, :, None] * across)
        wide = np.zeros((n, 3, _placements(steps), 2))
        wide[np.arange(n), :, steps.placement] = mine
        parts.append(wide.reshape(n, 3, -1))
    if shared(steps).any():
        wide = np.zeros((n, 3, _placements(steps), 2))
        mine = slopes.gyro_by_rate @ by_level
        wide[np.arange(n), :, steps.placement] = mine
        parts.append(wide.reshape(n, 3, -1))
    miss = steps.gyro - model.measure(force, w)[1]
    if wanders(steps, trust):
        assert state.drift is not None
        lower = wander_root(steps, trust)
        miss = miss - lower @ state.drift
        parts.append(np.einsum("nk,ij->nikj", lower, np.eye(3)).reshape(n, 3, 3 * n))
    weighted = root * np.sqrt(weights)[:, None, None]
    # The priors of what is not known of table, fixture and place come last.
    m = len(unknowns.prior_sd)
    prior = np.zeros((m, len(unknowns.names) + m))
    prior[:, len(unknowns.names) :] = np.diag(1.0 / unknowns.prior_sd)
    return Linearised(
        np.concatenate([
            np.einsum("nij,nj->ni", weighted, miss).ravel(),
            -_nuisance(state, steps, trust, unknowns),
        ]),
        np.concatenate([(weighted @ np.concatenate(parts, axis=2)).reshape(3 * n, -1), prior]),
        np.concatenate([np.repeat(np.arange(n), 3), np.full(m, -1)]),
    )  # fmt: skip


def _nuisance(state: State, steps: Steps, trust: Trust, unknowns: Unknowns) -> FloatArray:
    """Return rate error, Earth's rate, tilts and so on in units of their sd."""
    values = [state.rate_error] if trust.rate_sd > 0 else []
    values += [state.vertical] if trust.vertical_sd > 0 else []
    values += state.tilt.ravel().tolist() if trust.fixture_sd > 0 else []
    if shared(steps).any():
        values += (np.zeros((_placements(steps), 2)) + state.level).ravel().tolist()
    values += [] if state.drift is None else state.drift.ravel().tolist()
    return np.array(values) / unknowns.prior_sd


def _moved(unknowns: Unknowns, state: State, step: FloatArray) -> State:
    rate, earth, tilt, level, drift = (
        step[unknowns.columns(source)]
        for source in (
            "rate of the table",
            "unknown Earth rate",
            "fixture",
            "level Earth rate",
            "bias drift",
        )
    )
    return State(
        state.model.moved(unknowns.names, step[: len(unknowns.names)]),
        state.rate_error + float(rate.sum()),
        state.vertical + float(earth.sum()),
        state.tilt + (tilt.reshape(-1, 2) if len(tilt) else 0.0),
        state.drift if state.drift is None else state.drift + drift.reshape(-1, 3),
        state.level + (level.reshape(-1, 2) if len(level) else 0.0),
    )
