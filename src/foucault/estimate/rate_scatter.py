"""How large the noise of steps on a rate table is, or their scatter, where nobody knows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.rate_table import Trust, fit
from foucault.models.rate_steps import Steps


def fit_scatter(
    steps: Steps,
    names: tuple[str, ...],
    trust: Trust,
    prior: CoefficientVector | None = None,
    loss: gauss_newton.Loss = gauss_newton.huber,
) -> Trust:
    """Return `trust` with the jitter that makes the residuals as large as they should be.

    Parameters
    ----------
    steps : Steps
        What was measured [SI].
    names : tuple of str
        Coefficients to estimate.
    trust : Trust
        What is believed; the residuals are larger than its jitter and the noise explain.
    prior : CoefficientVector or None
        Gaussian prior on the coefficients.
    loss : callable
        ``norms -> weights``, see `gauss_newton.solve`.
    """
    low, high = np.log(1e-9), np.log(1e-1)
    for _ in range(20):
        middle = 0.5 * (low + high)
        jitter = float(np.hypot(trust.rate_jitter, np.exp(middle)))
        _, found = fit(steps, names, replace(trust, rate_jitter=jitter), prior, loss)
        low, high = (middle, high) if found.chi_square > found.dof else (low, middle)
    return replace(trust, rate_jitter=float(np.hypot(trust.rate_jitter, np.exp(high))))


def scaled_noise(
    steps: Steps, names: tuple[str, ...], trust: Trust, prior: CoefficientVector | None = None
) -> Steps:
    """Return the steps with noise as large as the residuals say, where nobody knows it.

    Parameters
    ----------
    steps : Steps
        What was measured; the noise of its means is right but for a common factor [SI].
    names : tuple of str
        Coefficients to estimate.
    trust : Trust
        What is believed of table, fixture and place.
    prior : CoefficientVector or None
        Gaussian prior on the coefficients.
    """
    for loss in (gauss_newton.least_squares, gauss_newton.huber):
        _, found = fit(steps, names, trust, prior, loss)
        if found.dof < 1:
            return steps
        steps = replace(steps, cov=steps.cov * max(found.chi_square / found.dof, 1e-12))
    return steps
