"""What a tumble says of the Earth's rate, which its filter takes for known.

The white residuals r of the fit, those of the prior with them, change by ``D x`` where the Earth's
rate along north and up is taken for more by x, and everything else is fitted anew. Then

    x = -(D' D)^-1 D' r,      P = (D' D)^-1

is what an estimate of x beside everything else would be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Status
from foucault.estimate.earth_seen import STEP, EarthSeen
from foucault.estimate.tumble.fit import Fit, Prior, Tumble, linearised
from foucault.models.earth import EARTH_RATE


def earth_in(
    tumble: Tumble, prior: Prior, fit: Fit, latitude: float, latitude_sd: float
) -> EarthSeen | None:
    """Return what a tumble says of the Earth's rate; None where it says nothing.

    `latitude`: where the cluster stands [rad]; `latitude_sd`: sd of that, which is no
    contradiction [rad].
    """
    if fit.status is not Status.CONVERGED:
        return None

    def left(changed: Tumble) -> FloatArray:
        found = linearised(changed, prior, fit)
        return np.concatenate([found.rows[..., -1].ravel(), prior.rows(found.start)[0]])

    r = left(tumble)
    D = np.stack([
        (left(replace(tumble, w_ie_n=tumble.w_ie_n + STEP * EARTH_RATE * way)) - r) / STEP
        for way in np.eye(3)[1:]
    ])  # fmt: skip
    told = D @ D.T
    if not np.isfinite(told).all() or np.linalg.cond(told) > 1e12:
        return None
    cov = np.linalg.inv(told)
    known = latitude_sd * np.array([-np.sin(latitude), np.cos(latitude)])
    return EarthSeen(-cov @ (D @ r), cov + np.outer(known, known), latitude)
