"""Two-sided limits of a sum of squares: is it what the noise predicts?"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FALSE_ALARM = 0.01
"""Family-wise probability of rejecting a result that is right [1]."""


TOLD = 4.0
"""Degrees of freedom from which on residuals tell a noise that nobody knows: see `student` [1]."""


def student(dof: float) -> float:
    """Return the factor of a standard deviation for a noise that only the residuals tell [1].

    Errors over the root mean square of n redundant residuals have Student's distribution, of
    variance ``n / (n - 2)``: twice that of a known noise at `TOLD`, and without bounds at 2, so
    that fewer are taken for as many.

    `dof`: degrees of freedom of the residuals [1].
    """
    n = max(dof, TOLD)
    return float(np.sqrt(n / (n - 2.0)))


def chi_square_limits(
    dof: float, false_alarm: float = FALSE_ALARM, tests: int = 1
) -> tuple[float, float]:
    """Return the two-sided limits of a chi-square variable.

    `dof`: degrees of freedom [1]; `false_alarm`: probability that any of the tests falls outside
    by chance [1]; `tests`: number of tests in the family, the probability is shared (Sidak) [1].
    """
    from scipy.special import chdtri

    alpha = 1 - (1 - false_alarm) ** (1 / tests)
    return float(chdtri(dof, 1 - alpha / 2)), float(chdtri(dof, alpha / 2))


def chi_square_density(x: npt.NDArray[np.float64], dof: float) -> npt.NDArray[np.float64]:
    """Return the density of a chi-square variable.

    `x` (n,): where, not negative [1]; `dof`: degrees of freedom [1].
    """
    from scipy.special import gammaln, xlogy

    half = dof / 2
    return np.asarray(np.exp(xlogy(half - 1, x) - x / 2 - half * np.log(2) - gammaln(half)))
