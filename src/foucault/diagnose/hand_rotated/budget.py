"""Where the uncertainty comes from: the variance of every coefficient split by source.

The estimate is linear in the observations near the solution, ``dx = A r`` with the gain
``A = P J' inv(Sigma)``. If Sigma is a sum over independent sources, so is the covariance:
``P = sum_s A Sigma_s A'``. What a prior contributes is the remainder.

References
----------
.. [1] JCGM 100:2008, *Guide to the expression of uncertainty in measurement*, section 5.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.references import gravity_error
from foucault.models.rests_and_turns import Prediction, Session
from foucault.models.session_noise import SessionNoise, blocks, correlated, joined
from foucault.result import Estimate

NEGLIGIBLE = 1e-9
"""A source with a smaller share in every variance is left out [1]."""


def session_budget(
    session: Session, at: Prediction, estimate: Estimate, noise: SessionNoise
) -> dict[str, FloatArray]:
    """Split the variance of the coefficients of a session by source.

    `session`: what was observed [SI]; `noise`: its noise, with the scatter that was added [SI].
    Returns (n,): source -> variance [unit^2]; sources that contribute nothing are left out.
    """
    n = len(estimate.coefficients)
    gain = _gain(session, n, estimate, noise, at)
    out = {}
    for source, (part, site) in _sources(session, noise).items():
        turned = at.turn_noise * (source == "gyro noise")
        alone = replace(at, turn_noise=turned)
        where = replace(session, site=site)
        out[source] = _variance(gain, blocks(where, part, alone), correlated(where, part, alone))
    # What is left came from priors: those of the coefficients, or the heading's whole circle.
    left = np.diag(estimate.state_cov)[:n] - np.sum(list(out.values()), axis=0)
    given = bool(np.isfinite(estimate.coefficients.prior_sd).any())
    out["prior" if given else "unknown heading"] = np.maximum(left, 0.0)
    out["local gravity"] = gravity_error(estimate.coefficients, session.site) ** 2
    total = np.sum(list(out.values()), axis=0)
    return {source: v for source, v in out.items() if np.any(v > NEGLIGIBLE * total)}


def _gain(
    session: Session, n: int, estimate: Estimate, noise: SessionNoise, at: Prediction
) -> FloatArray:
    """How the coefficients answer to each observation, robust weights included."""
    share = np.sqrt(estimate.weights)[:, None, None]
    total, tied = blocks(session, noise, at), correlated(session, noise, at)
    J = at.jacobian * share
    k, _, m = J.shape
    if tied is None:
        weighted = np.linalg.solve(total, J)
    else:
        weighted = np.linalg.solve(joined(total, tied), J.reshape(3 * k, m)).reshape(k, 3, m)
    return np.asarray(estimate.state_cov[:n] @ (weighted * share).reshape(3 * k, m).T)


def _sources(session: Session, noise: SessionNoise) -> dict[str, tuple[SessionNoise, Site]]:
    """Each source alone: its noise, and the site that makes or hides the unknown Earth rate."""
    zero, quiet = np.zeros(3), TriadNoise()
    silent = SessionNoise(zero, zero, zero, ImuNoise())
    known = replace(session.site, latitude=session.site.latitude or 0.0)
    accel = ImuNoise(noise.slow.accel, quiet)
    gyro = ImuNoise(quiet, noise.slow.gyro)
    scatter = {
        name: getattr(noise, name)
        for name in ("accel_repeatability", "gyro_repeatability", "turn_repeatability")
    }
    return {
        "accelerometer noise": (
            replace(
                silent,
                accel_psd=noise.accel_psd,
                slow=accel,
                accel_rounding=noise.accel_rounding,
                accel_carried=noise.accel_carried,
            ),
            known,
        ),
        "gyro noise": (
            replace(
                silent,
                gyro_psd=noise.gyro_psd,
                turn_psd=noise.turn_psd,
                slow=gyro,
                gyro_rounding=noise.gyro_rounding,
                gyro_carried=noise.gyro_carried,
            ),
            known,
        ),
        "scatter between rests": (replace(silent, **scatter), known),
        "unknown Earth rate": (silent, session.site),
    }


def _variance(gain: FloatArray, independent: FloatArray, tied: FloatArray | None) -> FloatArray:
    n, k = len(gain), len(independent)
    part = gain.reshape(n, k, 3)
    out = np.einsum("nki,kij,nkj->n", part, independent, part)
    if tied is not None:
        out = out + np.einsum("ni,ij,nj->n", gain, tied, gain)
    return np.asarray(out)
