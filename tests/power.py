"""How many numbers find out that a covariance is wrong: the power of the tests of NEES."""

from __future__ import annotations

from bisect import bisect_left

from scipy.stats import chi2

from foucault.infer.gauss_newton import chi_square_limits


def power(dof: float, factor: float, tests: int = 1) -> float:
    """Return the probability that a wrong covariance takes NEES out of its limits at 1 %.

    `dof`: coefficients of all sessions together; `factor`: by which variances are too small or too
    large, of both the one that shows less; `tests`: in the family that shares the false alarm [1].
    """
    low, high = chi_square_limits(dof, tests=tests)
    return min(chi2.sf(high / k, dof) + chi2.cdf(low / k, dof) for k in (factor, 1 / factor))


def needed(factor: float, tests: int = 1) -> int:
    """Return how many coefficients find it out in 99 of 100 cases [1]."""
    return bisect_left(range(100_000), 0.99, lo=1, key=lambda dof: power(dof, factor, tests))
