"""How well the norms of mean readings are known after compensation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.models.imu import ImuModel, coefficient_slot, products

FloatArray = npt.NDArray[np.float64]


def norm_with_cov(
    model: ImuModel, coefficients: CoefficientVector, accel: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the compensated norm of mean specific forces, shape (n,), and its covariance, (n, n).

    ``d|f| = u' L^-1 (daccel - db - dL f - dK q(f))``, L the matrix of the accelerometers.

    Parameters
    ----------
    model : ImuModel
        The error model.
    coefficients : CoefficientVector
        The estimated coefficients, with covariance.
    accel : ndarray, shape (n, 3)
        Mean readings [m/s^2].
    cov : ndarray, shape (n, 3, 3)
        Covariance of the readings [m^2/s^4].
    """
    f_b, _ = model.compensate(accel, None)
    assert f_b is not None
    norm = np.linalg.norm(f_b, axis=1)
    lever = (f_b / norm[:, None]) @ np.linalg.inv(model.accel_matrix)
    inputs = {"accel_matrix": f_b, "accel_quadratic": products(f_b)}
    slope = _slope(coefficients, lever, "accel_bias", inputs)
    joint = np.diag(np.einsum("ni,nij,nj->n", lever, cov, lever))
    if coefficients.cov is not None:
        joint = joint + slope @ coefficients.cov @ slope.T
    return norm, joint


def rate_norm_sd(
    model: ImuModel,
    coefficients: CoefficientVector,
    w_b: FloatArray,
    f_b: FloatArray | None,
    cov: FloatArray,
) -> FloatArray:
    """Return the standard deviation of the norm of compensated rates, shape (n,) [rad/s].

    ``|w| = u' w`` and ``w = W^-1 (gyro - b - G f)``, hence
    ``d|w| = u' W^-1 (dgyro - db - dW w - dG f)``.

    Parameters
    ----------
    model : ImuModel
        The error model.
    coefficients : CoefficientVector
        The estimated coefficients, with covariance.
    w_b : ndarray, shape (n, 3)
        Compensated mean rates [rad/s].
    f_b : ndarray, shape (n, 3), or None
        Specific force, which the g-sensitivity multiplies [m/s^2].
    cov : ndarray, shape (n, 3, 3)
        Covariance of the mean readings [rad^2/s^2].
    """
    norm = np.linalg.norm(w_b, axis=1)
    lever = (w_b / norm[:, None]) @ np.linalg.inv(model.gyro_matrix)
    inputs = {"gyro_matrix": w_b, "g_sensitivity": np.zeros_like(w_b) if f_b is None else f_b}
    slope = _slope(coefficients, lever, "gyro_bias", inputs)
    variance = np.einsum("ni,nij,nj->n", lever, cov, lever)
    if coefficients.cov is not None:
        variance += np.einsum("nk,kl,nl->n", slope, coefficients.cov, slope)
    return np.asarray(np.sqrt(variance))


def _slope(
    coefficients: CoefficientVector,
    lever: FloatArray,
    bias: str,
    inputs: Mapping[str, FloatArray],
) -> FloatArray:
    """Change of norms with coefficients but for the sign; `lever` is u' times the inverse."""
    slope = np.zeros((len(lever), len(coefficients)))
    for k, name in enumerate(coefficients.names):
        block, where = coefficient_slot(name)
        if block == bias:
            slope[:, k] = lever[:, where]
        elif block in inputs:
            slope[:, k] = lever[:, where[0]] * inputs[block][:, where[1]]
    return slope
