"""The costs of the published hand-rotated method, as they were published.

Accelerometer: ``sum (g - |f|)^2`` over single samples of the rests. Gyro: ``sum |C_se' u_j -
u_{j+1}|^2`` with u the direction of the mean specific force of a rest, the bias held at the
mean of an initial rest, and a Runge-Kutta integration of the turns. Every residual has the same
weight. The likelihood of `procedures.hand_rotated` uses the second cost for its start.

References
----------
.. [1] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014, eqs. (10) and (14).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.kernels.rotation import integrate_turns, integrate_turns_rk4
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.rotation import cross_matrix
from foucault.result import Estimate, Linearised, Problem
from foucault.tables import AXES, Log

ACCEL_NAMES = tuple(
    [f"accel.bias.{a}" for a in AXES]
    + [f"accel.scale.{a}" for a in AXES]
    + [f"accel.misalignment.{m}" for m in ("yx", "zx", "zy")]
)
GYRO_NAMES = tuple(
    [f"gyro.scale.{a}" for a in AXES]
    + [f"gyro.misalignment.{o}{i}" for o in AXES for i in AXES if o != i]
)


def _problem(names: Sequence[str], model: ImuModel, linearise: object, n_blocks: int) -> Problem:
    """A problem whose state is the error model and whose steps change the named coefficients."""

    def values(state: ImuModel) -> FloatArray:
        return state.coefficients(names).values

    def retract(state: ImuModel, step: FloatArray) -> ImuModel:
        return state.moved(names, step)

    layout = LAYOUT.subset(names)
    return Problem(layout, model, linearise, retract, values, n_blocks)  # type: ignore[arg-type]


def fit_norms(readings: FloatArray, gravity: float, start: ImuModel) -> Estimate:
    """Fit the nine accelerometer coefficients to the norm of single readings.

    `readings` (m, 3): readings at rest [m/s^2]; `gravity`: local gravity [m/s^2]. Returns
    covariance from the residuals' own scatter; chi_square is twice the published cost.
    """

    def linearise(model: ImuModel, weights: FloatArray) -> Linearised:
        f_b, _ = model.compensate(readings, None)
        assert f_b is not None
        norm = np.linalg.norm(f_b, axis=1)
        lever = -(f_b / norm[:, None]) @ np.linalg.inv(model.accel_matrix)
        columns = [lever[:, i] for i in range(3)]
        columns += [lever[:, i] * f_b[:, i] for i in range(3)]
        columns += [lever[:, o] * f_b[:, i] for o, i in ((1, 0), (2, 0), (2, 1))]
        return Linearised(gravity - norm, np.stack(columns, axis=1), np.arange(len(norm)))

    problem = _problem(ACCEL_NAMES, start, linearise, len(readings))
    return _with_own_scatter(gauss_newton.solve(problem, tolerance=1e-12))


def fit_directions(
    log: Log,
    up_b: FloatArray,
    first: IntArray,
    last: IntArray,
    start: ImuModel,
    *,
    runge_kutta: bool = False,
    max_iterations: int = 25,
) -> Estimate:
    """Fit gyro scale and misalignment to the change of the direction of gravity.

    `log`: readings [SI]; `up_b` (n, 3): direction of the compensated specific force of each rest,
    frame b [1]; `first`, `last` (n - 1,): first and last sample of each turn; `start`: where to
    start, its gyro bias is held; `runge_kutta`: integrate as published instead of with the better
    rule of the kernels; `max_iterations`: limit of the Gauss-Newton steps [1]. Returns covariance
    from the residuals' own scatter; chi_square is twice the published cost.
    """
    assert log.gyro is not None
    gyro = log.gyro
    no_noise = np.zeros((3, 3))

    def linearise(model: ImuModel, weights: FloatArray) -> Linearised:
        _, w_b = model.compensate(None, gyro)
        assert w_b is not None
        w_b = np.ascontiguousarray(w_b)  # one layout, one compilation
        C_se, _, scale, _, _, _ = integrate_turns(
            log.time, w_b, w_b, no_noise, first, last, log.sampled == "increment"
        )
        C_used = integrate_turns_rk4(log.time, w_b, first, last) if runge_kutta else C_se
        C_es = np.swapaxes(C_used, 1, 2)
        inverse = np.linalg.inv(model.gyro_matrix)
        turned = C_es @ cross_matrix(up_b[:-1])  # change of C_es u per rotation error in s
        by_element = np.einsum("nab,nbik,io->naok", turned, scale.reshape(-1, 3, 3, 3), inverse)
        order = [(i, i) for i in range(3)]
        order += [(o, i) for o in range(3) for i in range(3) if o != i]
        J = -np.stack([by_element[:, :, o, i] for o, i in order], axis=2)
        miss = up_b[1:] - np.einsum("nij,nj->ni", C_es, up_b[:-1])
        return Linearised(miss.ravel(), J.reshape(-1, 9), np.repeat(np.arange(len(first)), 3))

    model = replace(start, g_sensitivity=np.zeros((3, 3)))
    problem = _problem(GYRO_NAMES, model, linearise, len(first))
    return _with_own_scatter(
        gauss_newton.solve(problem, tolerance=1e-12, max_iterations=max_iterations)
    )


def _with_own_scatter(estimate: Estimate) -> Estimate:
    """Scale the covariance by the residual variance: all that a method without noise knows."""
    variance = estimate.chi_square / max(estimate.dof, 1)
    c = estimate.coefficients
    assert c.cov is not None
    scaled = CoefficientVector(c.layout, c.values, c.cov * variance, c.free, c.prior_sd)
    return replace(
        estimate,
        coefficients=scaled,
        state_cov=estimate.state_cov * variance,
        information=estimate.information / max(variance, 1e-300),
    )
