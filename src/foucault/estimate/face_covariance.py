"""Covariance of readings on faces: noise, the unknown part of the Earth's rotation, placement.

No instrument lies on a face as it should. Up differs from the case axis by a small random vector
d across it, another one in each placement; turning the instrument on the spot keeps it. The axis
of a turn differs from up by another one, for the support is not level, and the angle of a turn is
not what it was meant to be::

    accel   a_j = L C_bk g (up_k + d)          gyro   w_j = ... + G C_bk g d
    turn    W_t = A_g C_bk angle (axis_k +- d + d_level) + A_g C_bk axis_k d_angle

How large d is can be read from the residuals: the readings across the vertical of opposite faces
must have the bias that the faces of that axis have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.estimate.six_position import Scene, State, predict
from foucault.models.earth import EARTH_RATE
from foucault.models.faces import FaceReadings, TurnReadings
from foucault.models.noise import ImuNoise
from foucault.models.readings import mean_variance
from foucault.models.session_noise import QUIET_ENDS, SessionNoise, window_covariance

FloatArray = npt.NDArray[np.float64]

QUIETEST = 1e-10
"""Least sd of a mean, [m/s^2] and [rad/s]: far below what any instrument has."""


@dataclass(frozen=True)
class FaceNoise:
    """Noise of the means and integrals.

    Attributes
    ----------
    accel_var, gyro_var : ndarray, shape (n, 3)
        Variance of the means, slow noise and shared rounding left out [SI].
    turn_var : ndarray, shape (m, 3)
        Variance of the integrals [rad^2].
    session : SessionNoise
        What they were made of; its slow part is added exactly [SI].
    known : bool
        False where nobody knows the noise (means without a declaration).
    """

    accel_var: FloatArray
    gyro_var: FloatArray
    turn_var: FloatArray
    session: SessionNoise
    known: bool = True

    @classmethod
    def sampled(
        cls, noise: SessionNoise, rests: FaceReadings, turns: TurnReadings | None
    ) -> FaceNoise:
        """Take the noise of samples.

        Parameters
        ----------
        noise : SessionNoise
            Declared, or measured in the rests [SI].
        rests : FaceReadings
            The rests.
        turns : TurnReadings or None
            The turns.
        """
        time = rests.time[:, None]
        turn = np.zeros((0, 1)) if turns is None else turns.time[:, None]
        quiet = np.minimum(turn, QUIET_ENDS)
        return cls(
            noise.accel_psd / time + noise.accel_rounding**2,
            noise.gyro_psd / time,
            noise.turn_psd * turn + (noise.gyro_rounding * quiet) ** 2,
            noise,
        )

    @classmethod
    def of_means(cls, noise: ImuNoise | None, rests: FaceReadings) -> FaceNoise:
        """Take the noise of rows that are means already.

        Parameters
        ----------
        noise : ImuNoise or None
            Declared noise [SI]; None where unknown.
        rests : FaceReadings
            The rests.
        """
        zero, given = np.zeros(3), noise or ImuNoise()
        var = [mean_variance(t, rests.time, 0.0) for t in (given.accel, given.gyro)]
        three = [np.repeat(v[:, None], 3, axis=1) for v in var]
        plain = SessionNoise(zero, zero, zero, ImuNoise())
        return cls(three[0], three[1], np.zeros((0, 3)), plain, noise is not None)


@dataclass(frozen=True)
class Belief:
    """How far the placements, the axes and the angles of the turns are from what they should be.

    Attributes
    ----------
    placement, level, angle : float
        Standard deviations about each axis: of up against the case axis, of the axis of a turn
        against up, of the angle of a turn [rad].
    accel, gyro : float
        Scatter where the noise is unknown [m/s^2], [rad/s].
    """

    placement: float = 0.0
    level: float = 0.0
    angle: float = 0.0
    accel: float = 0.0
    gyro: float = 0.0


def noise_parts(scene: Scene, state: State, noise: FaceNoise) -> dict[str, FloatArray]:
    """Return what the noise and the Earth add to the covariance, each shape (3 k, 3 k) [SI].

    Parameters
    ----------
    scene : Scene
        What was observed [SI].
    state : State
        Where the model is taken.
    noise : FaceNoise
        Its noise [SI].
    """
    n, rated, m = scene.sizes
    k = 3 * (n + rated + m)
    out = {"accelerometer noise": np.zeros((k, k))}
    accel = out["accelerometer noise"]
    accel[: 3 * n, : 3 * n] = np.diag(np.maximum(noise.accel_var, QUIETEST**2).ravel())
    slow, rests = noise.session.slow, scene.rests
    if slow.accel.bias_instability or slow.accel.random_walk:
        ends = rests.start + rests.time
        accel[: 3 * n, : 3 * n] += np.kron(
            window_covariance(rests.start, ends, slow.accel), np.eye(3)
        )
    if not rated:
        return out
    gyro = np.zeros((k, k))
    white = [np.maximum(noise.gyro_var, QUIETEST**2).ravel()]
    if m and scene.turns is not None:
        least = QUIETEST**2 * scene.turns.time[:, None] ** 2
        white.append(np.maximum(noise.turn_var, least).ravel())
    gyro[3 * n :, 3 * n :] = np.diag(np.concatenate(white))
    shared = np.tile(noise.session.gyro_rounding, n)  # the same in all rests
    gyro[3 * n : 6 * n, 3 * n : 6 * n] += np.outer(shared, shared)
    if slow.gyro.bias_instability or slow.gyro.random_walk:
        gyro[3 * n :, 3 * n :] += _slow_gyro(scene, noise)
    out["gyro noise"] = gyro
    out[_EARTH[scene.site.latitude is None]] = _earth(scene, state)
    return out


_EARTH = {False: "unknown heading", True: "unknown Earth rate"}


def _slow_gyro(scene: Scene, noise: FaceNoise) -> FloatArray:
    start, time = scene.rests.start, scene.rests.time
    effect = np.ones(len(start))
    if scene.turns is not None:
        start = np.concatenate([start, scene.turns.start])
        effect = np.concatenate([effect, scene.turns.time])  # an integral, not a mean
        time = np.concatenate([time, scene.turns.time])
    cov = window_covariance(start, start + time, noise.session.slow.gyro)
    return np.kron(cov * np.outer(effect, effect), np.eye(3))


def _earth(scene: Scene, state: State) -> FloatArray:
    """Covariance of the part of the Earth's rotation whose direction is unknown."""
    n, rated, m = scene.sizes
    out = np.zeros((3 * (n + rated + m),) * 2)
    seen = state.model.gyro_matrix @ state.C_bk
    up = [scene.rests.up_k] if scene.turns is None else [scene.rests.up_k, scene.turns.up_k]
    spread = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), scene.spread])
    for j, (u, D) in enumerate(zip(np.concatenate(up), spread, strict=True)):
        if scene.site.latitude is None:
            vector = EARTH_RATE**2 / 3 * np.eye(3)
        else:
            vector = (EARTH_RATE * np.cos(scene.site.latitude)) ** 2 / 2 * _across(u)
        part = slice(3 * (n + j), 3 * (n + j) + 3)
        out[part, part] = seen @ D @ vector @ D.T @ seen.T
    return out


def _across(u: FloatArray) -> FloatArray:
    """Projection on the plane across unit vectors, shape (..., 3, 3)."""
    return np.asarray(np.eye(3) - u[..., :, None] * u[..., None, :])


def placement_parts(scene: Scene, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return covariances of unit errors of placement, level and angle, each (3 k, 3 k) [SI/rad^2].

    Parameters
    ----------
    scene : Scene
        What was observed [SI].
    state : State
        Where the model is taken.
    """
    n, rated, m = scene.sizes
    rests, turns, model = scene.rests, scene.turns, state.model
    groups = int(rests.group.max(initial=0)) + 1
    if turns is not None:
        groups = max(groups, int(turns.group.max(initial=0)) + 1)
    B = np.zeros((n + rated + m, 3, groups, 3))
    g = scene.site.gravity * state.C_bk @ _across(rests.up_k)
    row = np.arange(n)
    B[row, :, rests.group] = model.accel_matrix @ g
    if rated:
        B[n + row, :, rests.group] = model.g_sensitivity @ g
    level = np.zeros((n + rated + m, 3, m, 3))
    angle = np.zeros((n + rated + m, 3, m))
    if m and turns is not None:
        row = np.arange(m)
        seen = model.gyro_matrix @ state.C_bk
        off = turns.angle[:, None, None] * (seen @ _across(turns.axis_k))
        level[2 * n + row, :, row] = off
        angle[2 * n + row, :, row] = turns.axis_k @ seen.T
        # An axis that is level is off by itself; a vertical one by as much as up is.
        sign = np.where(turns.about_up == 0, 1.0, turns.about_up)
        B[2 * n + row, :, turns.group] = sign[:, None, None] * off
    rows = 3 * (n + rated + m)
    b, l, a = (x.reshape(rows, -1) for x in (B, level, angle))
    # Second order: the cosine of the tilt scatters about its mean, see `Scene.tilted`.
    return b @ b.T, l @ l.T, a @ a.T


def second_order(scene: Scene, state: State, belief: Belief) -> FloatArray:
    """Return the covariance of what a tilt does along the vertical, shape (3 k, 3 k) [SI].

    Parameters
    ----------
    scene : Scene
        What was observed [SI].
    state : State
        Where the model is taken.
    belief : Belief
        Standard deviations of the tilts [rad].
    """
    n, rated, m = scene.sizes
    along = np.zeros((n + rated + m, 3))
    along[:n] = scene.force_k @ (state.model.accel_matrix @ state.C_bk).T * belief.placement**2
    if m:
        size = belief.placement**2 + belief.level**2
        along[2 * n :] = scene.turn_k @ (state.model.gyro_matrix @ state.C_bk).T * size
    out = np.zeros((along.size, along.size))
    for j, v in enumerate(along):
        out[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = np.outer(v, v)
    return out


def covariance_parts(
    scene: Scene, state: State, noise: FaceNoise, belief: Belief, estimated: bool
) -> dict[str, FloatArray]:
    """Return the covariance of all readings split by source, each shape (3 k, 3 k) [SI].

    Parameters
    ----------
    scene : Scene
        What was observed [SI].
    state : State
        Where the model is taken.
    noise : FaceNoise
        Its noise [SI].
    belief : Belief
        What is believed of placements and turns [rad].
    estimated : bool
        Whether the placement was estimated from the residuals, not declared.
    """
    out = noise_parts(scene, state, noise)
    placed, level, angle = placement_parts(scene, state)
    tilts = belief.placement**2 * placed + belief.level**2 * level + belief.angle**2 * angle
    if tilts.any():
        tilts = tilts + second_order(scene, state, belief)
        out["placement, estimated" if estimated else "placement"] = tilts
    n, rated, _ = scene.sizes
    for name, sd, part in (
        ("accel", belief.accel, slice(0, 3 * n)),
        ("gyro", belief.gyro, slice(3 * n, 3 * (n + rated))),
    ):
        if sd > 0:
            words = f"scatter of the means ({name})"
            out[words] = np.zeros_like(placed)
            out[words][part, part] = sd**2 * np.eye(part.stop - part.start)
    return out


@dataclass(frozen=True)
class Scatter:
    """What the residuals say of an error of unknown size.

    Attributes
    ----------
    sd : float
        Its standard deviation, 0 where the noise explains the residuals [unit of the error].
    chi_square : float
        Sum of squares of the residuals without it [1].
    dof : int
        Degrees of freedom [1].
    """

    sd: float
    chi_square: float
    dof: int


def scatter(
    residuals: FloatArray, jacobian: FloatArray, known: FloatArray, unit: FloatArray
) -> Scatter:
    """Find the size of an error from the residuals that it leaves.

    Parameters
    ----------
    residuals : ndarray, shape (k,)
        Residuals at any state [SI].
    jacobian : ndarray, shape (k, p)
        Jacobian of the prediction [SI].
    known : ndarray, shape (k, k)
        Covariance of what is known [SI].
    unit : ndarray, shape (k, k)
        Covariance of the error for sd 1 [SI].

    Notes
    -----
    The sd is such that the sum of squares is two less than its degrees of freedom (but not less
    than half of them): with few degrees of freedom the most likely sd would promise too much,
    and 1 / sd^2 then has the right mean (that of Student's distribution).
    """
    size = np.linalg.norm(jacobian, axis=0)
    J = jacobian[:, size > 0] / size[size > 0]
    basis, s, _ = np.linalg.svd(J, full_matrices=True)
    rank = int(np.sum(s > 1e-10 * s[0]))
    dof = len(residuals) - rank
    if dof < 1:
        return Scatter(0.0, 0.0, 0)
    left = basis[:, rank:]  # combinations of the readings that the coefficients leave alone
    r, base, more = left.T @ residuals, left.T @ known @ left, left.T @ unit @ left

    def square(variance: float) -> float:
        return float(r @ np.linalg.solve(base + variance * more, r))

    target, first = max(dof - 2.0, dof / 2), square(0.0)
    if first <= target or not more.any():
        return Scatter(0.0, first, dof)
    low, high = 0.0, float(r @ r) / float(np.trace(more)) + 1e-30
    while square(high) > target and high < 1e6:
        low, high = high, 4 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if square(middle) > target else (low, middle)
    return Scatter(float(np.sqrt(high)), first, dof)


def believe(
    scene: Scene,
    names: tuple[str, ...],
    state: State,
    noise: FaceNoise,
    given: tuple[float | None, float | None, float | None],
) -> tuple[Belief, dict[str, Scatter]]:
    """Settle what is believed of placements and turns: as declared, else from the residuals.

    Parameters
    ----------
    scene : Scene
        What was observed [SI].
    names : tuple of str
        The coefficients.
    state : State
        A state near the solution.
    noise : FaceNoise
        Noise of the readings [SI].
    given : tuple of float or None
        Placement, level and angle as declared; None: to be found; the last two are then like the
        placement [rad].

    Returns
    -------
    Belief
        The standard deviations [rad].
    dict of str to Scatter
        What the residuals of "accel" and "gyro" said before.
    """
    n, rated, _ = scene.sizes
    r, J = predict(scene, names, state)
    r, J = r.reshape(-1), J.reshape(3 * len(J), -1)
    base = sum(noise_parts(scene, state, noise).values())
    placed, _, _ = placement_parts(scene, state)
    placement = given[0]
    if placement is not None:
        base = base + placement**2 * placed
    a, w = slice(0, 3 * n), slice(3 * n, 3 * (n + rated))
    unit = placed if noise.known and placement is None else np.eye(len(r))
    found = {"accel": scatter(r[a], J[a], base[a, a], unit[a, a])}
    if rated:
        found["gyro"] = scatter(r[w], J[w], base[w, w], np.eye(3 * rated))
    if not noise.known:
        rates = found["gyro"].sd if "gyro" in found else 0.0
        return Belief(placement or 0.0, accel=found["accel"].sd, gyro=rates), found
    size = found["accel"].sd if placement is None else placement
    level, angle = (size if x is None else x for x in given[1:])
    return Belief(size, level, angle), found
