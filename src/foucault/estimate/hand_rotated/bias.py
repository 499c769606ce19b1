"""The bias of gyros that rest in known attitudes whose heading is unknown.

Along up the Earth's rotation is known, w sin L, and across it its size, not its direction::

    w_j = b + u_j w sin L + h_j + noise,    h_j across u_j, variance (w cos L)^2 / 2 each way

What scatters beyond the noise is seen along up alone, where nothing of it is the Earth's, from as
many residuals as there are poses less three (Student's distribution where no noise is declared).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.chi_square import chi_square_limits, student
from foucault.infer.mixed import Component
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.readings import Readings


@dataclass(frozen=True)
class RestingBias:
    """The bias of gyros at rest."""

    # bias, cov: (3,) it, and its covariance [rad/s]
    bias: FloatArray
    cov: FloatArray
    noise: FloatArray  # (3, 3) what the noise alone makes of the covariance [rad^2/s^2]
    scatter: float  # standard deviation of a rate, per axis, beyond its noise [rad/s]
    fit: Component  # how well the noise alone explains the rates along up


def resting_bias(readings: Readings, up_b: FloatArray, site: Site) -> RestingBias:
    """Estimate the bias of the gyros from their means at rest.

    `readings`: means with the covariance of their noise [SI]; `up_b` (n, 3): direction of up at
    each, frame b [1].
    """
    assert readings.gyro is not None
    n = len(up_b)
    tied = readings.wander()[1]
    noise = _diagonal(readings.without_wander().gyro_cov)
    if tied is not None:
        noise = noise + np.kron(tied, np.eye(3))
    eye = np.eye(3)
    if site.latitude is None:
        along, earth = 0.0, np.broadcast_to(EARTH_RATE**2 / 3 * eye, (n, 3, 3))
    else:
        along = EARTH_RATE * np.sin(site.latitude)
        across = eye - up_b[:, :, None] * up_b[:, None, :]
        earth = (EARTH_RATE * np.cos(site.latitude)) ** 2 / 2 * across
    rate = readings.gyro - along * up_b
    # Along up alone: E picks that component of every rate.
    E = np.zeros((n, 3 * n))
    E[np.arange(n)[:, None], 3 * np.arange(n)[:, None] + np.arange(3)] = up_b
    seen, vertical = E @ rate.ravel(), E @ (noise + _diagonal(earth)) @ E.T
    low, high = chi_square_limits(n - 3)
    fit = Component(_misfit(seen, up_b, vertical), n - 3.0, low, high)
    variance = 0.0
    if fit.chi_square > (high if readings.declared else n - 3):
        variance = _scatter(seen, up_b, vertical)
    wide = variance * (1.0 if readings.declared else student(n - 3.0) ** 2)
    V = noise + _diagonal(earth) + wide * np.eye(3 * n)
    A = np.tile(eye, (n, 1))
    weighed = np.linalg.solve(V, A)
    cov = np.linalg.inv(A.T @ weighed)
    gain = cov @ weighed.T
    return RestingBias(
        gain @ rate.ravel(), cov, gain @ noise @ gain.T, float(np.sqrt(variance)), fit
    )


def _diagonal(blocks: FloatArray) -> FloatArray:
    n = len(blocks)
    out = np.zeros((n, 3, n, 3))
    out[np.arange(n), :, np.arange(n), :] = blocks
    return out.reshape(3 * n, 3 * n)


def _misfit(seen: FloatArray, up_b: FloatArray, cov: FloatArray) -> float:
    """Sum of the white residuals squared of what is seen along up, the best bias taken away."""
    root = np.linalg.cholesky(cov)
    white = np.linalg.solve(root, np.column_stack([up_b, seen]))
    left = white[:, 3] - white[:, :3] @ np.linalg.lstsq(white[:, :3], white[:, 3], rcond=None)[0]
    return float(left @ left)


def _scatter(seen: FloatArray, up_b: FloatArray, cov: FloatArray) -> float:
    """Variance that, added, makes the residuals as large as expected (Paule and Mandel)."""
    from scipy.optimize import brentq

    n, eye = len(seen), np.eye(len(seen))
    most = 2.0 * _misfit(seen, up_b, eye) / (n - 3)

    def excess(variance: float) -> float:
        return _misfit(seen, up_b, cov + variance * eye) - (n - 3)

    return float(brentq(excess, 0.0, most, xtol=1e-6 * most))
