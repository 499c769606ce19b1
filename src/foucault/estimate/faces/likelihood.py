"""The likelihood of rests on six faces, and of turns about the case axes.

A rest on a face says what the accelerometers measure when f is known in case axes k, a turn what
the gyros add up when the angle is known::

    accel mean     a_j = L C_bk f_k + b_a + K q(C_bk f_k),     f_k = g up_k
    gyro mean      w_j = A_g C_bk w_ie_k + b_g + G C_bk f_k
    gyro integral  W_t = A_g C_bk (angle axis_k + int w_ie_k dt) + b_g T + G C_bk int f_k dt

with L lower triangular (`Gauge.LOWER`) and C_bk the small rotation from case to body axes. In case
axes everything is linear, ``A = L C_bk``: least squares gives the exact start, for errors of any
size, and the iteration from there weighs the readings and carries their covariance through the
change of gauge.

Of the Earth's rotation only the vertical part is known in case axes; the horizontal part, whose
heading is not, is in the covariance (see `covariance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.drift import Drift, by_time, find_drift
from foucault.estimate.faces.ferraris import turn_spread
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.faces import FaceReadings, TurnReadings
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.rotation import cross_matrix, exp
from foucault.result import Estimate, Linearised, Problem
from foucault.tables import Log

PASSES = 2
"""Times that the attitude in the turns is found; each is 1e-4 of the last, or less [1]."""


@dataclass(frozen=True)
class State:
    """Model and mounting: the state of the estimation."""

    model: ImuModel  # the error model in body axes, `Gauge.LOWER`
    C_bk: FloatArray  # (3, 3) rotation from case to body axes [1]


@dataclass(frozen=True)
class Scene:
    """What was observed, and the motion in case axes that should have been."""

    rests: FaceReadings  # the rests [SI]
    turns: TurnReadings | None  # the turns [SI]
    site: Site
    force_k: FloatArray  # (n, 3) specific force at the rests [m/s^2]
    rate_k: FloatArray  # (n, 3) the known part of the rate at the rests [rad/s]
    turn_k: FloatArray  # (m, 3) the known part of the integral of the rate over the turns [rad]
    turn_force_k: FloatArray  # (m, 3) integral of the specific force over the turns [m/s]
    # (m, 3, 3) ``int C_k(t)k(0) dt`` over the turns: what a constant vector adds up to [s]
    spread: FloatArray

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of rests with specific force, of rests with rates, and of turns."""
        n = len(self.rests)
        return n, 0 if self.rests.gyro is None else n, 0 if self.turns is None else len(self.turns)

    @property
    def readings(self) -> FloatArray:
        """Everything that was read, shape (k, 3): rests (accel), rests (gyro), turns [SI]."""
        parts = [self.rests.accel]
        if self.rests.gyro is not None:
            parts.append(self.rests.gyro)
        if self.turns is not None:
            parts.append(self.turns.gyro)
        return np.concatenate(parts)

    def tilted(self, placement: float, level: float) -> Scene:
        """Return the scene for faces that are off by a random angle: its cosine is below one.

        `placement`: standard deviation about each of two axes of how the faces lie [rad];
        `level`: the same of the axis of a turn against the vertical [rad].
        """
        about = self.turn_k if self.turns is None else self.turns.angle[:, None] * self.turns.axis_k
        return replace(
            self,
            force_k=self.force_k * (1 - placement**2),
            turn_k=self.turn_k - about * (placement**2 + level**2),
        )


def closed_form(
    rests: FaceReadings,
    turns: TurnReadings | None,
    site: Site,
    names: Sequence[str],
    log: Log | None = None,
) -> tuple[Scene, State]:
    """Solve by linear least squares in case axes, and change to the body axes.

    `rests`: the rests, on six faces [SI]; `turns` or None: turns about three axes [SI]; `log` or
    None: the log, for the attitude during the turns.
    """
    m = 0 if turns is None else len(turns)
    force = site.gravity * rests.up_k
    vertical = 0.0 if site.latitude is None else EARTH_RATE * np.sin(site.latitude)
    scene = Scene(
        rests, turns, site, force, vertical * rests.up_k,
        np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3, 3)),
    )  # fmt: skip
    model = _accel(scene, names)
    if rests.gyro is None:
        return _in_body(scene, model)
    if turns is not None:
        assert log is not None
        mean, _ = model.compensate(turns.accel / turns.time[:, None], None)
        assert mean is not None
        about = turns.angle[:, None] * turns.axis_k
        scene = replace(scene, turn_k=about, turn_force_k=mean * turns.time[:, None])
        # What the Earth adds depends on the attitude, and the attitude on what it adds.
        for _ in range(PASSES):
            spread = turn_spread(log, turns, _gyro(scene, model, names))
            known = vertical * np.einsum("mij,mj->mi", spread, turns.up_k)
            scene = replace(scene, turn_k=about + known, spread=spread)
    return _in_body(scene, _gyro(scene, model, names))


def _accel(scene: Scene, names: Sequence[str]) -> ImuModel:
    model, f = ImuModel(), scene.force_k
    for i, axis in enumerate("xyz"):
        columns = [f, np.ones((len(f), 1))]
        if f"accel.quadratic.{axis}" in names:
            columns.append(f[:, i : i + 1] ** 2)
        x = np.linalg.lstsq(np.hstack(columns), scene.rests.accel[:, i], rcond=None)[0]
        model.accel_matrix[i], model.accel_bias[i] = x[:3], x[3]
        if len(x) > 4:
            model.accel_quadratic[i, i] = x[4]
    return model


def _gyro(scene: Scene, model: ImuModel, names: Sequence[str]) -> ImuModel:
    rests, turns = scene.rests, scene.turns
    assert rests.gyro is not None
    rates, right = scene.rate_k, rests.gyro
    ones, force = np.ones((len(rests), 1)), scene.force_k
    if turns is not None:
        # Per unit of time, so that rests and turns have equations of like size.
        time = turns.time[:, None]
        rates = np.concatenate([rates, scene.turn_k / time])
        right = np.concatenate([right, turns.gyro / time])
        ones = np.ones((len(right), 1))
        force = np.concatenate([force, scene.turn_force_k / time])
    columns = [ones]
    if "gyro.g_sensitivity.xx" in names:
        columns.append(force)
    if turns is None:
        right = right - rates
    else:
        columns.append(rates)
    rows = np.hstack(columns)
    size = np.linalg.norm(rows, axis=0)
    x = (np.linalg.lstsq(rows / size, right, rcond=None)[0].T / size).astype(float)
    out = replace(model, gyro_bias=x[:, 0])
    if "gyro.g_sensitivity.xx" in names:
        out = replace(out, g_sensitivity=x[:, 1:4])
    return out if turns is None else replace(out, gyro_matrix=x[:, -3:])


def _in_body(scene: Scene, model_k: ImuModel) -> tuple[Scene, State]:
    model, C_bk = model_k.in_gauge(Gauge.LOWER)
    if scene.turns is None:
        model = replace(model, gyro_matrix=np.eye(3))
    # Only the terms that are estimated: a rotation makes small products of the squares.
    own = np.zeros((3, 6))
    own[:, :3] = np.diag(np.diag(model.accel_quadratic[:, :3]))
    return scene, State(replace(model, accel_quadratic=own), C_bk)


def predict(scene: Scene, names: Sequence[str], state: State) -> tuple[FloatArray, FloatArray]:
    """Compare the readings with the model at a state.

    `scene`: what was observed [SI]. Returns `residuals` (k, 3): readings minus prediction, in the
    order of `Scene.readings` [SI]; `jacobian` (k, 3, p + 3): derivative of the prediction; the
    last three columns are the mounting [SI].
    """
    model, C = state.model, state.C_bk
    n, rated, m = scene.sizes
    p = len(names)
    J = np.zeros((n + rated + m, 3, p + 3))
    f, w = scene.force_k @ C.T, scene.rate_k @ C.T
    accel, gyro = model.measure(f, w)
    out = [accel]
    slopes = model.slopes(f, w, names)
    J[:n, :, :p], J[:n, :, p:] = slopes.accel, -slopes.accel_by_force @ cross_matrix(f)
    if rated:
        out.append(gyro)
        J[n : 2 * n, :, :p] = slopes.gyro
        J[n : 2 * n, :, p:] = -slopes.gyro_by_force @ cross_matrix(f)
        if m:  # without turns the gyros' axes are unknown: they say nothing of the mounting
            J[n : 2 * n, :, p:] -= slopes.gyro_by_rate @ cross_matrix(w)
    if m and scene.turns is not None:
        v, F, T = scene.turn_k @ C.T, scene.turn_force_k @ C.T, scene.turns.time
        G = model.g_sensitivity
        out.append(v @ model.gyro_matrix.T + T[:, None] * model.gyro_bias + F @ G.T)
        J[2 * n :, :, p:] = -model.gyro_matrix @ cross_matrix(v) - G @ cross_matrix(F)
        # Linear, so that what holds of rates holds of their integrals; a bias adds up with time.
        summed = np.where([name.startswith("gyro.bias.") for name in names], T[:, None], 1.0)
        J[2 * n :, :, :p] = model.slopes(F, v, names).gyro * summed[:, None]
    return scene.readings - np.concatenate(out), J


def build(
    scene: Scene,
    names: tuple[str, ...],
    start: State,
    cov: FloatArray,
    prior: CoefficientVector | None = None,
) -> Problem:
    """Build the least-squares problem.

    `scene`: what was observed [SI]; `cov` (3 k, 3 k): covariance of all readings [SI]; `prior` or
    None: what is known of the coefficients [SI].
    """
    from scipy.linalg import solve_triangular

    layout, root = LAYOUT.subset(names), np.linalg.cholesky(cov)
    p, k = len(names), len(cov) // 3

    def linearise(state: State, weights: FloatArray) -> Linearised:
        r, J = predict(scene, names, state)
        both = np.concatenate([J, r[:, :, None]], axis=2).reshape(3 * k, p + 4)
        white = solve_triangular(root, both, lower=True, check_finite=False)
        return Linearised(white[:, -1], white[:, :-1], np.repeat(np.arange(k), 3))

    def retract(state: State, step: FloatArray) -> State:
        return State(state.model.moved(names, step[:p]), exp(step[p:]) @ state.C_bk)

    def values(state: State) -> FloatArray:
        return state.model.coefficients(names).values

    return Problem(layout, start, linearise, retract, values, k, prior)


def clearest_drift(
    scene: Scene, problem: Problem, estimate: Estimate, cov: FloatArray
) -> Drift | None:
    """Return the drift of a coefficient that the residuals show most clearly.

    `scene`: what was observed [SI]; `cov` (3 k, 3 k): covariance of all readings [SI].
    """
    from scipy.linalg import solve_triangular

    names, rests = problem.layout.names, scene.rests
    middle = rests.start + rests.time / 2
    n, rated, m = scene.sizes
    time = np.concatenate([middle, middle[:rated]])
    if scene.turns is not None:
        time = np.append(time, scene.turns.start + scene.turns.time / 2)
    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    at = gauss_newton.with_prior(problem, estimate.state, at)
    changed = predict(scene, names, estimate.state)[1][:, :, : len(names)]
    changed = (changed * by_time(time)[:, None, None]).reshape(len(cov), -1)
    rows = np.zeros((len(at.residuals), len(names)))
    rows[: len(cov)] = solve_triangular(np.linalg.cholesky(cov), changed, lower=True)
    kinds = np.repeat([0, 1, 2], (n, rated, m))
    return find_drift(at, names, time, kinds=kinds, candidates=rows)


def unbiased(estimate: Estimate) -> Estimate:
    """Take the bias of the change of axes out of a solution.

    The matrices in case axes are linear in the readings, so their errors have no mean. The body
    axes follow the accelerometers that were found, and are bent by the square of these errors:
    an error of placement of 5 arcmin makes 1 ppm of scale factor. The mean of the matrices in case
    axes over the errors of the solution (its sigma points) undoes this to second order.
    """
    state, layout = estimate.state, estimate.coefficients.layout
    p, total = len(layout), len(estimate.state_cov)
    scale = np.sqrt(np.diag(estimate.state_cov))
    if not scale.all():
        return estimate
    values, vectors = np.linalg.eigh(estimate.state_cov / np.outer(scale, scale))
    points = (vectors * np.sqrt(total * np.maximum(values, 0.0))) * scale[:, None]
    blocks = ("accel_matrix", "gyro_matrix", "g_sensitivity")
    mean = {name: np.zeros((3, 3)) for name in blocks}
    for step in np.concatenate([points.T, -points.T]):
        vector = CoefficientVector(layout, estimate.coefficients.values + step[:p])
        model, C_bk = ImuModel.from_coefficients(vector), exp(step[p:]) @ state.C_bk
        for name in blocks:
            mean[name] += getattr(model, name) @ C_bk / (2 * total)
    model, C_bk = replace(state.model, **mean, accel_quadratic=np.zeros((3, 6))).in_gauge(
        Gauge.LOWER
    )
    if not any(name.startswith("gyro.scale.") for name in layout.names):
        model = replace(model, gyro_matrix=np.eye(3))
    model = replace(model, accel_quadratic=state.model.accel_quadratic)
    vector = replace(estimate.coefficients, values=model.coefficients(layout.names).values)
    return replace(estimate, coefficients=vector, state=State(model, C_bk))
