"""How well the norm of a mean rate is known after compensation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.models.imu import ImuModel, coefficient_slot

FloatArray = npt.NDArray[np.float64]


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
    slope = np.zeros((len(norm), len(coefficients)))
    inputs = {"gyro_matrix": w_b, "g_sensitivity": np.zeros_like(w_b) if f_b is None else f_b}
    for k, name in enumerate(coefficients.names):
        block, where = coefficient_slot(name)
        if block == "gyro_bias":
            slope[:, k] = lever[:, where]
        elif block in inputs:
            slope[:, k] = lever[:, where[0]] * inputs[block][:, where[1]]
    variance = np.einsum("ni,nij,nj->n", lever, cov, lever)
    if coefficients.cov is not None:
        variance += np.einsum("nk,kl,nl->n", slope, coefficients.cov, slope)
    return np.asarray(np.sqrt(variance))
