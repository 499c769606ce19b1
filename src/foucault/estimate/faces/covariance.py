"""Covariance of readings on faces: noise, the unknown part of the Earth's rotation, placement.

No instrument lies on a face as it should. Up differs from the case axis by a small random vector
d across it, another one in each placement; turning the instrument on the spot keeps it. The axis
of a turn differs from up by another one, for the support is not level, and the angle of a turn is
not what it was meant to be::

    accel   a_j = L C_bk g (up_k + d)          gyro   w_j = ... + G C_bk g d
    turn    W_t = A_g C_bk angle (axis_k +- d + d_level) + A_g C_bk axis_k d_angle

How large d is can be read from the residuals (see `scatter`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.faces.likelihood import Scene, State
from foucault.models.earth import EARTH_RATE
from foucault.models.faces import FaceReadings, TurnReadings
from foucault.models.noise import ImuNoise
from foucault.models.readings import mean_variance
from foucault.models.session_noise import QUIET_ENDS, SessionNoise, window_covariance

QUIETEST = 1e-10
"""Least sd of a mean, [m/s^2] and [rad/s]: far below what any instrument has."""


@dataclass(frozen=True)
class FaceNoise:
    """Noise of the means and integrals."""

    # accel_var, gyro_var: (n, 3) variance of the means, slow noise and shared rounding left out
    # [SI]
    accel_var: FloatArray
    gyro_var: FloatArray
    turn_var: FloatArray  # (m, 3) variance of the integrals [rad^2]
    session: SessionNoise  # what they were made of; its slow part is added exactly [SI]
    known: bool = True  # false where nobody knows the noise (means without a declaration)

    @classmethod
    def sampled(
        cls, noise: SessionNoise, rests: FaceReadings, turns: TurnReadings | None
    ) -> FaceNoise:
        """Take the noise of samples.

        `noise`: declared, or measured in the rests [SI]; `turns` or None: the turns.
        """
        time = rests.time[:, None]
        turn = np.zeros((0, 1)) if turns is None else turns.time[:, None]
        quiet = np.minimum(turn, QUIET_ENDS)
        return cls(
            noise.accel_psd / time + noise.accel_rounding**2 + 2 * noise.accel_carried / time**2,
            noise.gyro_psd / time + 2 * noise.gyro_carried / time**2,
            noise.turn_psd * turn + (noise.gyro_rounding * quiet) ** 2 + 2 * noise.gyro_carried,
            noise,
        )

    @classmethod
    def of_means(cls, noise: ImuNoise | None, rests: FaceReadings) -> FaceNoise:
        """Take the noise of rows that are means already.

        `noise`: declared noise [SI], None where unknown.
        """
        zero, given = np.zeros(3), noise or ImuNoise()
        var = [mean_variance(t, rests.time, 0.0) for t in (given.accel, given.gyro)]
        three = [np.repeat(v[:, None], 3, axis=1) for v in var]
        plain = SessionNoise(zero, zero, zero, ImuNoise())
        return cls(three[0], three[1], np.zeros((0, 3)), plain, noise is not None)


@dataclass(frozen=True)
class Belief:
    """How far the placements, the axes and the angles of the turns are from what they should be."""

    # placement, level, angle: standard deviations about each axis: of up against the case axis, of
    # the axis of a turn against up, of the angle of a turn [rad]
    placement: float = 0.0
    level: float = 0.0
    angle: float = 0.0
    # accel, gyro: scatter of the rests beyond the noise, or where the noise is unknown [m/s^2],
    # [rad/s]
    accel: float = 0.0
    gyro: float = 0.0


def noise_parts(scene: Scene, state: State, noise: FaceNoise) -> dict[str, FloatArray]:
    """Return what the noise and the Earth add to the covariance, each shape (3 k, 3 k) [SI].

    `scene`: what was observed [SI]; `noise`: its noise [SI].
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
    return np.asarray(np.kron(cov * np.outer(effect, effect), np.eye(3)))


def _earth(scene: Scene, state: State) -> FloatArray:
    """Covariance of the part of the Earth's rotation whose direction is unknown.

    It is one vector for all of a placement: whole turns lead back to the same heading.
    """
    n, rated, m = scene.sizes
    up, group = scene.rests.up_k, scene.rests.group
    if scene.turns is not None:
        up = np.concatenate([up, scene.turns.up_k])
        group = np.concatenate([group, scene.turns.group])
    if scene.site.latitude is None:
        root = EARTH_RATE / np.sqrt(3) * np.broadcast_to(np.eye(3), (n + m, 3, 3))
    else:
        root = EARTH_RATE * np.cos(scene.site.latitude) / np.sqrt(2) * _across(up)
    spread = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), scene.spread])
    B = np.zeros((n + rated + m, 3, int(group.max(initial=0)) + 1, 3))
    B[n + np.arange(n + m), :, group] = state.model.gyro_matrix @ state.C_bk @ spread @ root
    rows = B.reshape(3 * len(B), -1)
    return np.asarray(rows @ rows.T)


def _across(u: FloatArray) -> FloatArray:
    """Projection on the plane across unit vectors, shape (..., 3, 3)."""
    return np.asarray(np.eye(3) - u[..., :, None] * u[..., None, :])


def placement_parts(scene: Scene, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return covariances of unit errors of placement, level and angle, each (3 k, 3 k) [SI/rad^2].

    `scene`: what was observed [SI].
    """
    n, rated, m = scene.sizes
    rests, turns, model = scene.rests, scene.turns, state.model
    placed = rests.group
    if turns is not None:
        # An axis that is level is off by itself; a vertical one by as much as up is.
        own = np.arange(m) + max(rests.group.max(initial=0), turns.group.max(initial=0)) + 1
        placed = np.concatenate([placed, np.where(turns.about_up == 0, own, turns.group)])
    B = np.zeros((n + rated + m, 3, int(placed.max(initial=0)) + 1, 3))
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
        sign = np.where(turns.about_up == 0, 1.0, turns.about_up)
        B[2 * n + row, :, placed[n:]] = sign[:, None, None] * off
    rows = 3 * (n + rated + m)
    roots = [x.reshape(rows, -1) for x in (B, level, angle)]
    return roots[0] @ roots[0].T, roots[1] @ roots[1].T, roots[2] @ roots[2].T


def second_order(scene: Scene, state: State, belief: Belief) -> FloatArray:
    """Return the covariance of what the squares of the tilts do, shape (3 k, 3 k) [SI].

    Along the vertical the cosine of the tilt scatters about its mean (see `Scene.tilted`) by the
    square of its sd, and so does its product with the misalignments, of which as much is unknown.

    `scene`: what was observed [SI]; `belief`: standard deviations of the tilts [rad].
    """
    n, rated, m = scene.sizes
    group = scene.rests.group
    if scene.turns is not None:
        group = np.concatenate([group, scene.turns.group])
    first = int(group.max(initial=0)) + 1
    B = np.zeros((n + rated + m, 3, first + m))
    size, C_bk, model = np.sqrt(2) * belief.placement**2, state.C_bk, state.model
    B[np.arange(n), :, group[:n]] = size * scene.force_k @ (model.accel_matrix @ C_bk).T
    if m:
        row, turned = np.arange(m), scene.turn_k @ (model.gyro_matrix @ C_bk).T
        B[2 * n + row, :, group[n:]] = size * turned
        B[2 * n + row, :, first + row] = np.sqrt(2) * belief.level**2 * turned
    rows = B.reshape(3 * len(B), -1)
    return np.asarray(rows @ rows.T)


def covariance_parts(
    scene: Scene, state: State, noise: FaceNoise, belief: Belief, estimated: bool
) -> dict[str, FloatArray]:
    """Return the covariance of all readings split by source, each shape (3 k, 3 k) [SI].

    `scene`: what was observed [SI]; `noise`: its noise [SI]; `belief`: what is believed of
    placements and turns [rad]; `estimated`: whether the placement was estimated from the
    residuals, not declared.
    """
    out = noise_parts(scene, state, noise)
    placed, level, angle = placement_parts(scene, state)
    tilts = belief.placement**2 * placed + belief.level**2 * level + belief.angle**2 * angle
    if tilts.any():
        tilts = tilts + second_order(scene, state, belief)
        out["placement, estimated" if estimated else "placement"] = tilts
    n, rated, _ = scene.sizes
    size = np.zeros(len(placed))
    size[: 3 * n] = belief.accel
    if rated:
        size[3 * n : 6 * n] = belief.gyro
    if scene.turns is not None:  # a bias that is off adds up over the turn
        size[6 * n :] = np.repeat(belief.gyro * scene.turns.time, 3)
    if size.any():
        out["scatter between rests"] = np.diag(size**2)
    return out
