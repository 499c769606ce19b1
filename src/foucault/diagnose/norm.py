"""How well the norms of mean readings are known after compensation."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.models.imu import ImuModel


def norm_with_cov(
    model: ImuModel, coefficients: CoefficientVector, accel: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the compensated norm of mean specific forces, shape (n,), and its covariance, (n, n).

    ``d|f| = u' L^-1 (daccel - db - dL f - dK q(f))``, L the matrix of the accelerometers.

    `accel` (n, 3): mean readings [m/s^2]; `cov` (n, 3, 3): covariance of the readings [m^2/s^4].
    """
    f_b, _ = model.compensate(accel, None)
    assert f_b is not None
    norm = np.linalg.norm(f_b, axis=1)
    lever = (f_b / norm[:, None]) @ np.linalg.inv(model.accel_matrix)
    slopes = model.slopes(f_b, np.zeros_like(f_b), coefficients.names)
    slope = np.einsum("ni,nik->nk", lever, slopes.accel)
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

    `w_b` (n, 3): compensated mean rates [rad/s]; `f_b` (n, 3) or None: specific force, which the
    g-sensitivity multiplies [m/s^2]; `cov` (n, 3, 3): covariance of the mean readings
    [rad^2/s^2].
    """
    norm = np.linalg.norm(w_b, axis=1)
    lever = (w_b / norm[:, None]) @ np.linalg.inv(model.gyro_matrix)
    force = np.zeros_like(w_b) if f_b is None else f_b
    slope = np.einsum("ni,nik->nk", lever, model.slopes(force, w_b, coefficients.names).gyro)
    variance = np.einsum("ni,nij,nj->n", lever, cov, lever)
    if coefficients.cov is not None:
        variance += np.einsum("nk,kl,nl->n", slope, coefficients.cov, slope)
    return np.asarray(np.sqrt(variance))
