"""Expected value and covariance of Allan-type variances, for any sum of the five noises.

A variance of the family is ``a_i = c_i mean(d_i^2)`` with ``d_i`` a difference of the phase.
Each noise has a generalised covariance s(t) of its phase, so that the covariance of two
differences ``l`` samples apart is ``r_ij(l) = sum_ab w_a w_b s(l + b m_j - a m_i)``, and for
Gaussian noise::

    E a_i        = c_i r_ii(0)
    cov(a_i,a_j) = 2 c_i c_j / (M_i M_j)  sum_l W_ij(l) r_ij(l)^2,   W: how often l occurs

With the noises' strengths p, ``r = sum_n p_n r_n``: both are polynomials in p whose coefficients
depend on the number of samples and the factors m alone. Everything is in units of one sample
interval, p = (Q^2/dt^2, N^2/dt, B^2, K^2 dt, R^2 dt^2). Sums over l are Gauss-Legendre between
the kinks of r where these are far apart, else exact.

References
----------
.. [1] C. A. Greenhall, W. J. Riley, "Uncertainty of stability variances based on finite
   differences", 35th PTTI, 2003 (one noise and one tau at a time; here all together).
.. [2] IEEE Std 952-1997, annex C (the five noises and their slopes).

Fit of the five noises to overlapping Allan variances, by generalised least squares.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray, IntArray

Kind = Literal["overlapping", "modified", "hadamard"]

NOISES = 5  # Quantisation, white, flicker, random walk, ramp: the order of p [1].

_STENCILS = {
    "overlapping": np.array([1.0, -2.0, 1.0]),
    "modified": np.array([1.0, -2.0, 1.0]),
    "hadamard": np.array([-1.0, 3.0, -3.0, 1.0]),
}
SPAN = {"overlapping": 2, "modified": 3, "hadamard": 3}
"""Phase intervals of length m that one term of the sum needs [1]."""

_NORM = {"overlapping": 2.0, "modified": 2.0, "hadamard": 6.0}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_EXACT = 24  # integer lags between two kinks up to which the sum is done term by term
_TAIL = 64.0  # flicker is followed this many reaches beyond the last kink; r^2 falls as l^-4


def terms(kind: Kind, n: int, m: npt.ArrayLike) -> IntArray:
    """Return how many differences of `n` samples [1] there are at factors `m`, shape (k,) [1]."""
    return n + 1 - SPAN[kind] * np.asarray(m) + (kind == "modified")


def norm(kind: Kind, m: npt.ArrayLike) -> FloatArray:
    """Return c, variance over mean square difference, at factors `m`, shape (k,) [1]."""
    return 1.0 / (_NORM[kind] * np.asarray(m, float) ** 2)


def _log(t: FloatArray) -> FloatArray:
    return np.asarray(np.log(np.maximum(t, 1e-300)))


# Generalised covariances of the phase (polynomials that differences annihilate are left out).
_PHASE: tuple[Callable[[FloatArray], FloatArray], ...] = (
    lambda t: (t < 0.5).astype(float),
    lambda t: -t / 2,
    lambda t: t**2 * _log(t) / (2 * np.pi),
    lambda t: t**3 / 12,
)
# Their double sums: the mean over m terms is a second difference of these, divided by m^2.
_SUMMED: tuple[Callable[[FloatArray], FloatArray], ...] = (
    lambda t: t / 2,
    lambda t: -(t**3 - t) / 12,
    lambda t: (t**4 - t**2) * _log(t) / 12 / (2 * np.pi),
    lambda t: (t**5 / 20 - t**3 / 12 + t / 30) / 12,
)


def _kernel(kind: Kind, m_i: float, m_j: float) -> tuple[FloatArray, FloatArray]:
    """Return the offsets (in samples) and weights of the product of two differences."""
    w = _STENCILS[kind]
    place = np.arange(len(w))
    offsets = (place[None, :] * m_j - place[:, None] * m_i).ravel()
    weights = np.outer(w, w).ravel()
    if kind == "modified" and m_i > 1:  # only m_i = m_j is asked for
        offsets = (offsets[:, None] + np.array([-m_i, 0.0, m_i])).ravel()
        weights = (weights[:, None] * np.array([1.0, -2.0, 1.0]) / m_i**2).ravel()
    kinks, where = np.unique(np.round(offsets, 9), return_inverse=True)
    return np.asarray(kinks, float), np.asarray(np.bincount(where, weights), float)


def _covariance_at(
    kind: Kind, m: float, kernel: tuple[FloatArray, FloatArray], lags: FloatArray
) -> FloatArray:
    """Return r_n at the lags for the four random noises, shape (4, lags)."""
    offsets, weights = kernel
    t = np.abs(lags[:, None] + offsets)
    functions = _SUMMED if kind == "modified" and m > 1 else _PHASE
    r = np.array([f(t) @ weights for f in functions])
    outside = (lags > -offsets.min() + 1e-9) | (lags < -offsets.max() - 1e-9)
    r[[0, 1, 3]] *= ~outside  # exactly zero there; what is computed is rounding
    return r


def _lags(
    kinks: FloatArray, low: float, high: float, more: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return lags and weights so that sum(weight f(lag)) is the sum of f over [low, high]."""
    reach = kinks[-1] - kinks[0]
    tail = reach * 2.0 ** np.arange(-6, np.log2(_TAIL) + 1)
    edges = np.concatenate([kinks, more, kinks[-1] + tail, kinks[0] - tail, [low, high]])
    edges = np.unique(np.clip(np.round(edges), max(low, kinks[0] - tail[-1]),
                              min(high, kinks[-1] + tail[-1])))  # fmt: skip
    places, weights = [edges[:1], edges[-1:]], [np.array([0.5]), np.array([0.5])]
    for a, b in pairwise(edges):
        if b - a <= _EXACT:
            inside = np.arange(a, b + 1)
            weight = np.ones(len(inside))
            weight[[0, -1]] = 0.5  # the other half belongs to the neighbour
        else:
            inside = a + (b - a) * (_NODES + 1) / 2
            weight = (b - a) / 2 * _WEIGHTS
        places.append(inside)
        weights.append(weight)
    return np.concatenate(places), np.concatenate(weights)


def _occurrences(lags: FloatArray, count_i: int, count_j: int) -> FloatArray:
    """Return how many pairs (k, k + lag) there are with k < count_i, k + lag < count_j."""
    return np.asarray(np.maximum(np.minimum(count_i, count_j - lags) - np.maximum(0.0, -lags), 0.0))


def _pair(kind: Kind, n: int, m_i: int, m_j: int) -> FloatArray:
    """Return the coefficients of cov(a_i, a_j) in p p^T, shape (5, 5)."""
    count_i, count_j = (int(terms(kind, n, m)) for m in (m_i, m_j))
    kernel = _kernel(kind, m_i, m_j)
    low, high = -(count_i - 1.0), count_j - 1.0
    lags, weights = _lags(np.sort(-kernel[0]), low, high, np.array([0.0, float(count_j - count_i)]))
    weights = weights * _occurrences(lags, count_i, count_j)
    r = _covariance_at(kind, m_i, kernel, lags)
    first = r @ weights
    out = np.zeros((NOISES, NOISES))
    out[:4, :4] = (r * weights) @ r.T
    if kind != "modified" or m_i == 1:  # quantisation is a comb: its few lags, exactly
        comb = -kernel[0]
        comb = comb[(comb >= low) & (comb <= high)]
        at = _covariance_at(kind, m_i, kernel, comb)
        often = _occurrences(comb, count_i, count_j)
        out[0, :4] = out[:4, 0] = at @ (at[0] * often)
        first[0] = at[0] @ often
    # The ramp shifts every difference of an Allan variance by m^2 and multiplies the rest.
    if kind != "hadamard":
        out[4, :4] = out[:4, 4] = float(m_i) ** 2 * m_j**2 * first
    return out * 2 * float(norm(kind, m_i) * norm(kind, m_j)) / count_i / count_j


@lru_cache(maxsize=32)
def covariance(kind: Kind, n: int, m: tuple[int, ...]) -> FloatArray:
    """Return (5, 5, k, k): t with cov = sum_ab p_a p_b T[a, b], `n` samples, factors `m` [1]."""
    k = len(m)
    out = np.zeros((NOISES, NOISES, k, k))
    for i in range(k):
        for j in range(i, k):
            out[:, :, i, j] = _pair(kind, n, m[i], m[j])
            out[:, :, j, i] = out[:, :, i, j]
    out.setflags(write=False)
    return out


@lru_cache(maxsize=32)
def variances(kind: Kind, n: int, m: tuple[int, ...]) -> FloatArray:
    """Compute the variance of each variance as a form in p.

    `n`: number of samples [1]; `m` (k,): averaging factors [1]. Returns (5, 5, k): t with var =
    sum_ab p_a p_b T[a, b] [1].
    """
    if kind == "overlapping":
        return np.asarray(np.diagonal(covariance(kind, n, m), axis1=2, axis2=3))
    return np.stack([_pair(kind, n, each, each) for each in m], axis=-1)


def expected(kind: Kind, m: npt.ArrayLike) -> FloatArray:
    """Compute the expected variances as a linear function of p.

    `m` (k,): averaging factors [1]. Returns (k, 5): j with E a = J p [1]. For the overlapping
    Allan variance (3/m^2, 1/m, 2 ln 2/pi, m/3, m^2/2), IEEE Std 952 eq. (C.4) to (C.16).
    """
    m = np.asarray(m, float)
    out = np.zeros((len(m), NOISES))
    for i, each in enumerate(m):
        r = _covariance_at(kind, each, _kernel(kind, each, each), np.zeros(1))[:, 0]
        out[i, :4] = r
        out[i, 4] = 0.0 if kind == "hadamard" else each**4
    return out * norm(kind, m)[:, None]


def covariance_of_differences(count: int) -> FloatArray:
    """Return the covariance of a difference of two neighbouring means with `count` next ones.

    Of white noise, flicker and random walk of unit strength, (3, count) [1].
    """
    lags = np.arange(count, dtype=float)
    return _covariance_at("overlapping", 1, _kernel("overlapping", 1, 1), lags)[1:]


def degrees_of_freedom(kind: Kind, n: int, m: npt.ArrayLike, p: FloatArray) -> FloatArray:
    """Return 2 (E a)^2 / var a, (k,) [1], of noises `p` (5,), factors `m`, `n` samples."""
    factors = tuple(int(each) for each in np.asarray(m))
    var = np.einsum("a,b,abk->k", p, p, variances(kind, n, factors))
    return np.asarray(2 * (expected(kind, m) @ p) ** 2 / np.maximum(var, 1e-300))


SEEN = 3.0  # A noise is seen when it is this many standard deviations above zero [1].
CONFIDENCE = 0.95  # Probability of the two-sided intervals, and of the one-sided limits [1].

_ONE_SIDED = 1.6448536269514722  # normal quantile of CONFIDENCE
_ITERATIONS = 50
_ALL = range(NOISES)
_SMALLEST = 1e-9  # relative


@dataclass(frozen=True)
class Strengths:
    """The strengths of the five noises, in units of one sample interval."""

    p: FloatArray  # (5,) Q^2/dt^2, N^2/dt, B^2, K^2 dt, R^2 dt^2 [unit^2]
    sd: FloatArray  # (5,) standard deviations; NaN where p is zero [unit^2]
    seen: BoolArray  # (5,) which noises are `SEEN` standard deviations above zero
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


def fit(variance: FloatArray, n: int, m: IntArray) -> Strengths:
    """Fit the five noises to `variance` (k,) [unit^2] at factors `m` (k,) of `n` samples [1]."""
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


def _covariance(J: FloatArray, free: BoolArray) -> FloatArray:
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
    from scipy.special import gammaincinv

    dof = 2 * (p / sd) ** 2
    low, high = (
        2.0 * float(gammaincinv(dof / 2.0, edge))
        for edge in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)
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
