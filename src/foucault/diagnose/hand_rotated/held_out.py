"""Predict what the fit did not see: the norm of specific force at rests left out."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.fit_checks import folds
from foucault.diagnose.norm import norm_with_cov
from foucault.estimate.hand_rotated.likelihood import session_of
from foucault.infer.mixed import Covariance, Fit, HeldOut, held_out
from foucault.models.imu import ImuModel
from foucault.models.rests_and_turns import Session
from foucault.tables import AXES

UNDETERMINED = 1e3
"""A rest left out that is known so many times worse is not determined by the others [1]."""


def norm_columns(
    model: ImuModel, coefficients: CoefficientVector, session: Session
) -> dict[str, FloatArray]:
    """Return the columns of `tables.RESTS` about up and norms, the noise that of each rest.

    `session`: what was observed [SI].
    """
    readings, mean = session.log.accel, session.accel_mean
    assert readings is not None
    spans = zip(session.first, session.last, strict=True)
    cov = np.array([np.diag(readings[a:b].var(axis=0, ddof=1)) / (b - a) for a, b in spans])
    norm, joint = norm_with_cov(model, coefficients, mean, cov)
    f_b, _ = model.compensate(mean, None)
    assert f_b is not None
    up_b = f_b / norm[:, None]
    return {f"up_{axis}": up_b[:, i] for i, axis in enumerate(AXES)} | {
        "norm_before": np.linalg.norm(mean, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)),
        "weight": np.ones(len(norm)),
    }


def norm_slope(fit: Fit) -> FloatArray:
    """Return what the norm of specific force at each rest is per reading, shape (n, 3) [1].

    `fit`: of the model of a session.
    """
    model, up_b = fit.state.model, fit.state.C_nb[:, 2, :]
    f_b = session_of(fit).session.site.gravity * up_b
    by_force = model.slopes(f_b, np.zeros_like(f_b), ()).accel_by_force
    return np.asarray(np.linalg.solve(np.swapaxes(by_force, 1, 2), up_b[:, :, None])[:, :, 0])


def hold_out(fit: Fit, count: int) -> HeldOut | None:
    """Predict the norm of specific force of rests that the fit did not see, or None.

    `count`: number of parts, each is left out once [1].
    """
    parts = folds(fit, "accel", count)
    if len(parts) < 2:
        return None
    slope = norm_slope(fit)
    onto = np.zeros((len(fit.at.residuals), 1, 3))
    onto[: len(slope), 0] = slope
    return held_out(fit, parts, onto, seen=UNDETERMINED**-2)


def rest_cov(fit: Fit) -> FloatArray:
    """Return the covariance of the mean specific force of each rest, shape (n, 3, 3) [SI^2].

    `fit`: of the model of a session.
    """
    k, d = fit.at.residuals.shape
    cov = Covariance(fit.at.sources, fit.sds, (k, d), np.ones(k))
    n = np.arange(len(fit.state.C_nb))
    return np.asarray(cov.whole.reshape(k, d, k, d)[n, :, n, :])


def norm_noise(fit: Fit) -> FloatArray:
    """Return the standard deviation of the norm of each rest by its own noise, shape (n,) [m/s^2].

    `fit`: of the model of a session.
    """
    slope = norm_slope(fit)
    return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", slope, rest_cov(fit), slope)))
