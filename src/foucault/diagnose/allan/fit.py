"""Fit of the five noises to overlapping Allan variances, by generalised least squares.

The variances at all tau are correlated, and how much depends on the noises sought. So the
weights are the inverse of the covariance that the fit itself predicts (`allan.covariance`), and
the fit repeats until both agree::

    minimise (a - J p)^T C(p)^-1 (a - J p),   p = (Q^2, N^2, B^2, K^2, R^2) >= 0

Where five noises cannot describe the curve (vibration, filters, heating), an unexplained relative
scatter is added to C until chi-square is what it should be; all uncertainties then include it.

Notes
-----
A noise is seen when its strength is `SEEN` standard deviations above zero, the deviation taken
as if it were absent. Its interval treats p as a chi-square variable with 2 (p/sd)^2 degrees of
freedom. The upper limit of one not seen is the strength whose estimate would be lower than the
one found with a probability of 5 % at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.allan.covariance import NOISES, covariance, expected

SEEN = 3.0
"""A noise is seen when it is this many standard deviations above zero [1]."""

CONFIDENCE = 0.95
"""Probability of the two-sided intervals, and of the one-sided limits [1]."""

_ONE_SIDED = 1.6448536269514722  # normal quantile of CONFIDENCE
_ITERATIONS = 50
_ALL = range(NOISES)
_SMALLEST = 1e-9  # relative


@dataclass(frozen=True)
class Strengths:
    """The strengths of the five noises, in units of one sample interval."""

    p: FloatArray  # (5,) Q^2/dt^2, N^2/dt, B^2, K^2 dt, R^2 dt^2 [unit^2]
    sd: FloatArray  # (5,) standard deviations; NaN where p is zero [unit^2]
    seen: npt.NDArray[np.bool_]  # (5,) which noises are `SEEN` standard deviations above zero
    # low, high: (5,) interval of what is seen; 0 and the upper limit of what is not (inf: none)
    # [unit^2]
    low: FloatArray
    high: FloatArray
    # relative scatter of the variances about the curve that five noises do not explain [1]
    excess: float


@dataclass(frozen=True)
class _Problem:
    """Variances a (k,), columns J (k, 5) and the covariance form T (5, 5, k, k)."""

    a: FloatArray
    J: FloatArray
    T: FloatArray
    excess: float = 0.0

    def root(self, p: FloatArray) -> FloatArray:
        """Return the Cholesky factor of C(p), shape (k, k)."""
        C = np.einsum("a,b,abij->ij", p, p, self.T)
        mean = self.J @ p
        # The floor keeps C positive definite where p has one noise, or the ramp alone.
        C += np.diag(((self.excess + _SMALLEST) * mean) ** 2 + _SMALLEST * np.diag(C))
        return np.asarray(np.linalg.cholesky(C))

    def whitened(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a and J divided by the root of C(p)."""
        L = self.root(p)
        both = np.linalg.solve(L, np.column_stack([self.a, self.J]))
        return np.asarray(both[:, 0]), np.asarray(both[:, 1:])


def fit(variance: FloatArray, n: int, m: npt.NDArray[np.int64]) -> Strengths:
    """Fit the five noises.

    `variance` (k,): overlapping Allan variances [unit^2]; `n`: number of samples they come from
    [1]; `m` (k,): averaging factors [1].
    """
    T = covariance("overlapping", n, tuple(int(each) for each in m))
    problem, p = _solved(_Problem(variance, expected("overlapping", m), T))
    # What the others would be without noise j: where j is zero anyway, what they are.
    without = [_strengths(problem, np.delete(_ALL, j)) if p[j] > 0 else p for j in _ALL]
    cov = _covariance(problem.whitened(p)[1], p > 0)
    sd = np.where(p > 0, np.sqrt(np.diag(cov)), np.nan)
    seen = np.array([p[j] > 0 and _significance(problem, without[j], j) > SEEN for j in _ALL])
    low, high = np.zeros(NOISES), np.zeros(NOISES)
    for j in _ALL:
        if seen[j]:
            low[j], high[j] = _interval(p[j], sd[j])
        else:
            high[j] = _limit(problem, without[j], j)
    return Strengths(p, sd, seen, low, high, problem.excess)


def _strengths(problem: _Problem, allowed: Sequence[int] | IntArray) -> FloatArray:
    """Solve for p >= 0, the weights following the solution; those not allowed stay zero."""
    p = np.zeros(NOISES)
    # To start, relative errors that grow with tau as those of white noise do.
    growing = problem.a * np.sqrt(np.arange(1, len(problem.a) + 1))
    p[allowed] = _nonnegative(problem.J[:, allowed] / growing[:, None], problem.a / growing)
    for _ in range(_ITERATIONS):
        a, J = problem.whitened(p)
        new = np.zeros(NOISES)
        new[allowed] = _nonnegative(J[:, allowed], a)
        if not new.any():
            break
        moved = np.abs(problem.J @ (new - p)) / (problem.J @ new)
        p = new
        if moved.max() < 1e-5:
            break
    return p


def _nonnegative(J: FloatArray, a: FloatArray) -> FloatArray:
    from scipy.optimize import nnls

    size = np.linalg.norm(J, axis=0)
    size[size == 0] = 1.0
    return np.asarray(nnls(J / size, a)[0] / size)


def _solved(problem: _Problem) -> tuple[_Problem, FloatArray]:
    """Solve for p; add scatter until chi-square is its expectation, where it is far above it."""
    from scipy.special import chdtri

    def solve(excess: float) -> tuple[_Problem, FloatArray, float, int]:
        this = replace(problem, excess=excess)
        p = _strengths(this, list(_ALL))
        a, J = this.whitened(p)
        return this, p, float(np.sum((a - J @ p) ** 2)), max(1, len(a) - int(np.count_nonzero(p)))

    this, p, found, dof = solve(0.0)
    if found <= chdtri(dof, 0.001):
        return this, p
    low, high = 1e-6, 10.0
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        this, p, found, dof = solve(middle)
        low, high = (middle, high) if found > dof else (low, middle)
    return this, p


def _covariance(J: FloatArray, free: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the covariance of the free strengths, shape (5, 5), by whitened columns J (k, 5)."""
    J = J[:, free]
    size = np.linalg.norm(J, axis=0)
    out = np.zeros((NOISES, NOISES))
    inverse = np.linalg.pinv((J / size).T @ (J / size), hermitian=True)
    out[np.ix_(free, free)] = inverse / np.outer(size, size)
    return out


def _estimate(problem: _Problem, truth: FloatArray, j: int) -> tuple[float, float]:
    """Estimate p_j, negative if need be, with the weights of `truth`; return it and its sd."""
    free = truth > 0
    free[j] = True
    a, J = problem.whitened(truth)
    cov = _covariance(J, free)
    return float((cov @ (J.T @ a))[j]), float(np.sqrt(cov[j, j]))


def _significance(problem: _Problem, truth: FloatArray, j: int) -> float:
    """Return p_j in standard deviations, as they are if noise j is absent."""
    if not truth[:4].any():  # nothing else random could make the curve
        return np.inf
    value, sd = _estimate(problem, truth, j)
    return value / sd


def _interval(p: float, sd: float) -> tuple[float, float]:
    from scipy.stats import chi2

    dof = 2 * (p / sd) ** 2
    low, high = (
        float(chi2.ppf(edge, dof)) for edge in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)
    )
    if not low > 0:  # hardly a degree of freedom: both quantiles can be zero to rounding
        return 0.0, float("inf")
    return float(dof * p / high), float(dof * p / low)


def _limit(problem: _Problem, truth: FloatArray, j: int) -> float:
    """Return the strength of noise j that the data still allow; inf where there is none."""

    def above(strength: float) -> bool:
        tried = truth.copy()
        tried[j] = strength
        value, sd = _estimate(problem, tried, j)
        return strength - max(value, 0.0) > _ONE_SIDED * sd

    low, high = 0.0, _estimate(problem, truth, j)[1]
    for _ in range(60):
        if above(high):
            break
        low, high = high, high * 2
    else:
        return float("inf")
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if above(middle) else (middle, high)
    return high
