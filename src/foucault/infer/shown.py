"""What the motion shows of parameters, and not what its noise only seems to show.

Where a motion is itself found from readings, as are attitudes and angular accelerations of a body
in a hand, its noise is in the regressors. The information of a fit, ``I = M' M``, then holds what
the motion shows and what its noise only seems to show, ``E[I] = I_0 + N`` with ``N = E[dM' dM]``,
dM what the noise does to the rows. Where the motion shows nothing, N is all there is: the parameter
looks certain, and goes nowhere. N is the same for the noise drawn once more, whose rows are known::

    N = dM' dM,     dM = M(readings with their noise once more) - M(readings)

A direction is shown where ``I_0`` is ten times N. What is shown is estimated with ``I_0``, the
second derivative of the likelihood once the motion is eliminated [1], and its scores scatter by
``I_0 + N``; in all other directions nothing is learnt.

References
----------
.. [1] W. A. Fuller, *Measurement Error Models*, Wiley, 1987, sections 1.3 and 2.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray

BEYOND = 10.0  # What is shown has so many times the information that noise makes by itself [1].

LITTLE = 0.01
"""Information that is lost without regret, as a part of what was known beforehand [1]."""


@dataclass(frozen=True)
class Shown:
    """The information of what is shown."""

    information: FloatArray  # (p, p) less what noise makes [1 / SI^2]
    scatter: FloatArray  # (p, p) covariance of the scores [1 / SI^2]
    onto: FloatArray  # (p, p) takes a gradient to the part that is shown

    def step(self, score: FloatArray, off: FloatArray, prior_sd: FloatArray) -> FloatArray:
        """Return the step that scores ask for, and what was known beforehand.

        `score` (p,): as they are [1 / SI]; `off` (p,): what was known less where it is, `prior_sd`
        (p,): its sd [SI].
        """
        known = np.diag(prior_sd**-2.0)
        return np.asarray(
            np.linalg.solve(self.information + known, self.onto @ score + off / prior_sd**2)
        )

    def covariance(self, prior_sd: FloatArray) -> FloatArray:
        """Return the covariance of the parameters, (p, p), by `prior_sd` (p,) beforehand [SI]."""
        known = np.diag(prior_sd**-2.0)
        P = np.linalg.inv(self.information + known)
        return np.asarray(P @ (self.scatter + known) @ P)


def shown(information: FloatArray, noise: FloatArray, prior_sd: FloatArray) -> Shown:
    """Return what is shown.

    `information` (p, p): as it was found; `noise` (p, p): the part N that noise makes, not
    negative [1 / SI^2]; `prior_sd` (p,): what was known beforehand [SI].
    """
    size = np.outer(prior_sd, prior_sd)
    apart = noise * size + LITTLE * np.eye(len(prior_sd))
    L = np.linalg.cholesky(apart)
    half = np.linalg.solve(L, (information - noise) * size)
    ratio, Q = np.linalg.eigh(np.linalg.solve(L, half.T))
    seen = Q[:, ratio > BEYOND]
    # Columns of V are the directions, U those that take parameters to their parts along them.
    V, U = np.linalg.solve(L.T, seen), L @ seen
    onto = (U @ V.T) / prior_sd[:, None] * prior_sd
    part = (U * ratio[ratio > BEYOND]) @ U.T / size
    return Shown(part, onto @ information @ onto.T, onto)


def shares(
    parts: Mapping[str, FloatArray], formal: FloatArray, total: FloatArray, beyond: str
) -> dict[str, FloatArray]:
    """Return variances by source that add up to `total` (p,) [SI].

    `parts`: source -> derivative (p,) of the variance by the logarithm of that of its noise [SI]:
    the gain of a best estimate does not change with a small change of the noise; `formal` (p,):
    variance by noise and prior alone; `beyond`: what the rest is called.
    """
    known = np.sum(list(parts.values()), axis=0)
    out = {k: v * np.minimum(1.0, formal / np.maximum(known, 1e-300)) for k, v in parts.items()}
    out["prior"] = np.maximum(formal - np.sum(list(out.values()), axis=0), 0.0)
    if (total > formal * (1 + 1e-9)).any():
        out[beyond] = np.maximum(total - formal, 0.0)
    size = total / np.maximum(np.sum(list(out.values()), axis=0), 1e-300)
    return {name: v * size for name, v in out.items()}
