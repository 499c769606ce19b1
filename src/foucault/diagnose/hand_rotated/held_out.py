"""Predict what the fit did not see: the norm of specific force at rests left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.norm import norm_with_cov
from foucault.models.imu import ImuModel
from foucault.models.rests_and_turns import Attitudes, Session
from foucault.models.session_noise import SessionNoise
from foucault.result import Estimate
from foucault.tables import AXES


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


def hold_out(
    session: Session,
    noise: SessionNoise,
    refit: Callable[[IntArray], Estimate],
    folds: int,
    used: npt.NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predict the norm of rests that the fit did not see.

    `refit`: ``rests -> Estimate`` without the accelerometers of the rests given by number;
    `folds`: number of parts, each is left out once [1]; `used` (rests,): rests that the solution
    uses, an outlier need not be predicted. Returns `error` (rests,): predicted norm minus local g
    [m/s^2]; `sd` (rests,): its predicted standard deviation [m/s^2]; `white` (rests,): the errors
    made white within each part, which shares one estimate [1].
    """
    n = len(session.accel_mean)
    error, sd, white = np.full((3, n), np.nan)
    cov = rest_cov(session, noise)
    for fold in range(folds):
        out = (np.arange(n) % folds == fold) & used
        if not out.any():
            continue
        estimate = refit(np.flatnonzero(out))
        state: Attitudes = estimate.state
        norm, joint = norm_with_cov(
            state.model, estimate.coefficients, session.accel_mean[out], cov[out]
        )
        factor = np.linalg.cholesky(joint)  # first: a singular solution has no variances
        error[out], sd[out] = norm - session.site.gravity, np.sqrt(np.diag(joint))
        white[out] = np.linalg.solve(factor, error[out])
    return error, sd, white


def rest_cov(session: Session, noise: SessionNoise) -> FloatArray:
    """Return the covariance of the mean specific force of each rest, shape (n, 3, 3).

    `noise`: noise of the rests [SI].
    """
    time = session.rest_time[:, None, None]
    white = np.diag(noise.accel_psd) / time + 2 * np.diag(noise.accel_carried) / time**2
    slow = noise.slow.accel.bias_instability**2 + noise.accel_repeatability**2
    walk = noise.slow.accel.random_walk**2 * session.log.time[session.first]
    rounding = np.diag(noise.accel_rounding**2)
    return np.asarray(white + rounding + (slow + walk)[:, None, None] * np.eye(3))
