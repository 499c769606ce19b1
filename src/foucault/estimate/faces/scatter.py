"""How large an error is that nobody declared: from the residuals that it leaves.

Opposite faces tell errors of placement: their readings across the vertical must have the bias that
the faces of that axis have. Rests that were repeated tell what is left beyond that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.chi_square import chi_square_limits, student
from foucault.estimate.faces.covariance import Belief, FaceNoise, noise_parts, placement_parts
from foucault.estimate.faces.likelihood import Scene, State, predict


@dataclass(frozen=True)
class Scatter:
    """What the residuals say of an error of unknown size."""

    # its standard deviation, 0 where the noise explains the residuals [unit of the error]
    sd: float
    chi_square: float  # sum of squares of the residuals without it [1]
    dof: int  # degrees of freedom [1]

    @property
    def significant(self) -> bool:
        """Whether the residuals are larger than chance allows."""
        return self.dof > 0 and self.chi_square > chi_square_limits(self.dof)[1]


def scatter(
    residuals: FloatArray, jacobian: FloatArray, known: FloatArray, unit: FloatArray
) -> Scatter:
    """Find the size of an error from the residuals that it leaves.

    `residuals` (k,): residuals at any state [SI]; `jacobian` (k, p): Jacobian of the prediction
    [SI]; `known` (k, k): covariance of what is known [SI]; `unit` (k, k): covariance of the error
    for sd 1 [SI].

    The sd is such that the sum of squares is two less than its degrees of freedom (but not less
    than half of them): with few degrees of freedom the most likely sd would promise too much,
    and 1 / sd^2 then has the right mean (that of Student's distribution).
    """
    left = _left_alone(jacobian, unit)
    dof = left.shape[1]
    if dof < 1:
        return Scatter(0.0, 0.0, 0)
    r, base, more = left.T @ residuals, left.T @ known @ left, left.T @ unit @ left

    def square(variance: float) -> float:
        return float(r @ np.linalg.solve(base + variance * more, r))

    target, first = max(dof - 2.0, dof / 2), square(0.0)
    if first <= target:
        return Scatter(0.0, first, dof)
    low, high = 0.0, float(r @ r) / float(np.trace(more)) + 1e-30
    while square(high) > target:  # every combination is one that the error reaches
        low, high = high, 4 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if square(middle) > target else (low, middle)
    return Scatter(float(np.sqrt(high)), first, dof)


def _left_alone(jacobian: FloatArray, unit: FloatArray) -> FloatArray:
    """Combinations of readings that the coefficients leave alone and the error does not, (k, m)."""
    size = np.linalg.norm(jacobian, axis=0)
    seen = size > 0
    basis, s, _ = np.linalg.svd(jacobian[:, seen] / size[seen], full_matrices=True)
    left = basis[:, int(np.sum(s > 1e-10 * s.max(initial=0.0))) :]
    values, vectors = np.linalg.eigh(left.T @ unit @ left)
    return np.asarray(left @ vectors[:, values > 1e-6 * values.max(initial=0.0)])


def believe(
    scene: Scene,
    names: tuple[str, ...],
    state: State,
    noise: FaceNoise,
    given: tuple[float | None, float | None, float | None],
) -> tuple[Belief, dict[str, Scatter]]:
    """Settle what is believed of placements and turns: as declared, else from the residuals.

    `scene`: what was observed [SI]; `noise`: noise of the readings [SI]; `given`: placement,
    level and angle as declared, None: to be found, the last two are then like the placement
    [rad]. Returns the standard deviations [rad]; what the residuals said before: "repeats"
    between rests on one face [m/s^2], "placement" of opposite faces [rad], "accel" of means
    without noise [m/s^2], and "gyro" [rad/s].
    """
    n, rated, _ = scene.sizes
    r, J = predict(scene, names, state)
    r, J = r.reshape(-1), J.reshape(3 * len(J), -1)
    base = np.asarray(sum(noise_parts(scene, state, noise).values()))
    placed, _, _ = placement_parts(scene, state)
    if given[0] is not None:
        base = base + given[0] ** 2 * placed
    a, w = slice(0, 3 * n), slice(3 * n, 3 * (n + rated))
    found: dict[str, Scatter] = {}
    rates = 0.0
    if rated:
        found["gyro"] = scatter(r[w], J[w], base[w, w], np.eye(3 * rated))
        rates = found["gyro"].sd if found["gyro"].significant or not noise.known else 0.0
    if not noise.known:
        found["accel"] = scatter(r[a], J[a], base[a, a], np.eye(3 * n))
        wide = found["accel"].sd * student(found["accel"].dof)
        rates *= student(found["gyro"].dof) if rated else 1.0
        return Belief(given[0] or 0.0, accel=wide, gyro=rates), found
    # What no coefficient and no placement explains: rests that were repeated.
    free = np.hstack([J[a], placed[a, a]])
    found["repeats"] = scatter(r[a], free, base[a, a], np.eye(3 * n))
    again = found["repeats"].sd if found["repeats"].significant else 0.0
    size = given[0]
    if size is None:
        known = base[a, a] + again**2 * np.eye(3 * n)
        found["placement"] = scatter(r[a], J[a], known, placed[a, a])
        size = found["placement"].sd
    level, angle = (size if x is None else x for x in given[1:])
    return Belief(size, level, angle, again, rates), found
