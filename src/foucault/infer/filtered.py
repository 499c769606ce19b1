"""One estimator for everything that navigates: a linear system about a free run, pass by pass.

A model states, about a point (start, coefficients, mounting, delay), what happens from epoch to
epoch and what is measured::

    x_k = Phi_k x_k-1 + u_k + w_k,    z_k = H_k x_k + v_k

Everything else follows from that system::

    fit         Kalman filter; the point moves to the smoothed start; again until nothing moves
    bound       of a linear system the covariance of the Kalman filter is the posterior bound
    components  innovations of each kind of measurement, by how many of them are independent
    parts_out   parts of the run, each predicted from all others
    budget      what each source of error does to the end, from the end backwards
    foreseen    the covariance of a planned run: a filter needs no measurement for that
    robust      the same system with a bound: `infer.linear_filter`

A kernel that filters on its own way may return what it has made white instead: rows of residuals
and what they say of the state at the start. Of such `Whitened` rows the same is known.

References
----------
.. [1] M. S. Bartlett, "On the theoretical specification and sampling properties of autocorrelated
   time-series", *J. Royal Statistical Society, Supplement* 8 (1946).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Generic, Protocol, TypeVar

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import FALSE_ALARM, Component, chi_square_limits
from foucault.infer.linear_filter import LinearRun, LinearSystem, kalman, smoothed_start

LAGS, FEW = 50, 5
"""Autocorrelations that count for how many innovations there are in effect, and for whether they
are independent at all [1]."""

P = TypeVar("P")
S = TypeVar("S", bound=LinearSystem)
S_co = TypeVar("S_co", bound=LinearSystem, covariant=True)


class LinearModel(Protocol[P, S_co]):
    """What is stated of something that navigates, and all that is stated."""

    @property
    def names(self) -> tuple[str, ...]:
        """States, those of navigation first."""

    @property
    def first(self) -> int:
        """Number of the state where those of navigation are over: the values begin there."""

    @property
    def kinds(self) -> Mapping[str, slice]:
        """Kind of measurement -> its columns of z."""

    @property
    def start(self) -> P:
        """What was known beforehand: the first pass is linear about it."""

    def about(self, point: P) -> S_co:
        """Return the system about a point."""

    def retract(self, point: P, x: FloatArray) -> P | None:
        """Return the point that errors `x` (n,) [SI] at the start lead to; None for none."""

    def values(self, point: P) -> FloatArray:
        """Return what a point adds to the states after those of navigation, (n - first,) [SI]."""


@dataclass(frozen=True)
class Fit(Generic[P, S]):
    """A model solved."""

    model: LinearModel[P, S]
    point: P  # what the last pass was linear about
    system: S  # the last system
    run: LinearRun  # the last pass of the filter
    passes: tuple[FloatArray, ...]  # (n - first,) the values after each pass [SI]

    @property
    def values(self) -> FloatArray:
        """States after those of navigation at the end, shape (n - first,) [SI]."""
        first = self.model.first
        return np.asarray(self.model.values(self.point) + self.run.states[-1, first:])

    @property
    def cov(self) -> FloatArray:
        """Their covariance, shape (n - first, n - first) [SI]."""
        return self.run.cov[self.model.first :, self.model.first :]

    @property
    def nominal(self) -> bool:
        """Whether the filter is a Kalman filter, whose covariance is that of its error."""
        return not np.isfinite(self.run.margin).any()

    @property
    def moved(self) -> FloatArray:
        """By how much of its sd the last of two passes has moved each, shape (n - first,) [1]."""
        return _moved(self.passes, self.run.sd[-1, self.model.first :])


def _moved(passes: tuple[FloatArray, ...], sd: FloatArray) -> FloatArray:
    return np.asarray(np.abs(passes[-1] - passes[-2]) / sd)


def fit(model: LinearModel[P, S], *, passes: int = 2, settled: float = 0.0) -> Fit[P, S]:
    """Filter, move the point of linearisation to where the smoothed run began, and again.

    `passes`: how often at most [1]; `settled`: no more passes follow one that has moved nothing by
    more of its uncertainty [1].

    Passes that go astray end: what the last one found is as much as there is.
    """
    point, first, found = model.start, model.first, tuple[FloatArray, ...]()
    system = model.about(point)
    for k in range(passes):
        last = k + 1 == passes
        run = kalman(system, keep=not last)
        found = (*found, model.values(point) + run.states[-1, first:])
        if last or (k and float(np.max(_moved(found, run.sd[-1, first:]))) < settled):
            break
        further = model.retract(point, smoothed_start(system, run))
        if further is None:
            break
        try:
            system = model.about(further)
        except FoucaultError:  # navigated with such errors nothing stays finite
            break
        point = further
    return Fit(model, point, system, run, found)


def foreseen(model: LinearModel[P, S]) -> Fit[P, S]:
    """Return what a planned run will show: the covariance rests on no measurement."""
    return fit(model, passes=1)


def response(at: Fit[P, S], other: LinearModel[P, S]) -> FloatArray:
    """Return by how much the values were others if another model were true, (n - first,) [SI]."""
    system = other.about(at.point)
    return replace(at, system=system, run=kalman(system)).values - at.values


def exchanged(
    estimate: CoefficientVector, used: tuple[FloatArray, FloatArray], prior: CoefficientVector
) -> CoefficientVector:
    """Return an estimate with another prior than the one it was made with.

    Where the measurements say little, P is nearly the covariance of the prior, and where they say
    all, it is nearly singular: it is not inverted. Another mean m, a prior k times as wide (S is
    1 / sd of the old one, H chooses), and a narrower one as a measurement, one after the other::

        x + P S^2 (m - m_u)
        V = 1 - S H P H' S    G = P H' S (V + 1 / (k^2 - 1))^-1    x + G S H (x - m)    P + G S H P
        R = (1 / sd^2 - S^2)^-1    K = P H' (H P H' + R)^-1    x + K H (m - x)    (1 - K H) P

    `estimate`: with covariance [SI]; `used` (p,): mean and standard deviation of the prior it was
    made with [SI]; `prior`: the prior it shall have: values and prior_sd [SI]. A prior of sd zero
    stays; an infinite one counts as 7e7 times as wide.
    """
    assert estimate.cov is not None
    x, P, (mean, old), m, new = estimate.values, estimate.cov, used, prior.values, prior.prior_sd
    x = x + P @ ((m - mean) / np.where(old > 0, old, np.inf) ** 2)
    wide, narrow = np.flatnonzero((new > old) & (old > 0)), np.flatnonzero(new < old)
    if len(wide):
        s = old[wide]
        PS = P[:, wide] / s
        seen, axes = np.linalg.eigh(np.eye(len(s)) - PS[wide] / s[:, None])
        V = axes * np.maximum(seen, 0.0) @ axes.T
        more = np.maximum(1 / ((new[wide] / s) ** 2 - 1), np.finfo(float).eps)
        G = np.linalg.solve(V + np.diag(more), PS.T).T
        x, P = x + G @ ((x - m)[wide] / s), P + G @ PS.T
    if len(narrow):
        R = np.diag(new[narrow] ** 2 / (1 - (new[narrow] / old[narrow]) ** 2))
        S = P[np.ix_(narrow, narrow)] + R
        unit = np.sqrt(np.where(np.diag(S) > 0, np.diag(S), 1.0))
        K = P[:, narrow] / unit @ np.linalg.pinv(S / np.outer(unit, unit), hermitian=True) / unit
        left = np.eye(len(x))
        left[:, narrow] -= K
        x, P = x + K @ (m - x)[narrow], left @ P @ left.T + K @ R @ K.T
    return replace(estimate, values=x, cov=(P + P.T) / 2, prior_sd=new)


@dataclass(frozen=True)
class HeldOut:
    """Parts of a session, each predicted from all others: the worst is judged.

    The squared distance of a part from its prediction is chi-square where the model is right. Parts
    that are predicted by the same others are related, so that no sum of them is; a limit for the
    worst of so many holds whatever they share.
    """

    scores: FloatArray  # (parts,) squared normalised distance of each from its prediction [1]
    counts: FloatArray  # (parts,) how many measurements that are [1]
    false_alarm: float = FALSE_ALARM  # probability that any is beyond its limit by chance [1]

    @cached_property
    def limits(self) -> FloatArray:
        """What chance allows of each, shape (parts,); less than expected is no fault [1]."""
        each = 2 * self.false_alarm
        return np.array([chi_square_limits(n, each, len(self.counts))[1] for n in self.counts])

    @property
    def worst(self) -> int:
        """Number of the part that comes nearest to its limit, or is farthest beyond it."""
        some = np.flatnonzero(self.counts)  # a part of which all was left out tells nothing
        if not len(some):
            return 0
        return int(some[np.argmax(self.scores[some] / self.limits[some])])

    @property
    def score(self) -> float:
        """That of the worst part [1]."""
        return float(self.scores[self.worst])

    @property
    def count(self) -> float:
        """Number of measurements in it [1]."""
        return float(self.counts[self.worst])

    @property
    def high(self) -> float:
        """Its limit [1]."""
        return float(self.limits[self.worst])


def parts_out(at: Fit[P, S], edges: IntArray, false_alarm: float = FALSE_ALARM) -> HeldOut:
    """Predict parts of the epochs that the filter does not see, all of a part together.

    `edges` (parts + 1,): epochs at which parts begin, and the end [1]; `false_alarm`: probability
    that any is beyond its limit by chance [1].

    A density is a product, ``p(z) = p(z_F | others) p(others)``, and the squares of all innovations
    add up to what stands in its exponent: the distance of the part F from what the others predict
    is by how much that sum is smaller without F.
    """
    s, run = at.system, at.run if at.nominal else kalman(at.system)
    scores, counts, x, P = list[float](), list[float](), s.x0, s.P0
    for a, b in pairwise(edges.tolist()):
        later = s.between(slice(a, None), x, P)
        R = later.R.copy()
        R[: b - a] = np.inf
        scores.append(float(run.nis[a:].sum() - kalman(replace(later, R=R)).nis.sum()))
        counts.append(float(np.isfinite(run.innovation[a:b]).sum()))
        x, P = run.states[b - 1], kalman(s.between(slice(a, b), x, P)).cov
    return HeldOut(np.array(scores), np.array(counts), false_alarm)


ROUNDING = 1e-9  # A change of which no larger share is left beside all others is not seen [1].


@dataclass(frozen=True)
class Whitened:
    """Rows that a kernel has made white: ``residuals = slopes x + e``, e of unit variance each."""

    residuals: FloatArray  # (b, q) at the solution [1]
    slopes: FloatArray  # (b, q, n) by the unknowns [1 / their unit]
    cov: FloatArray  # (n, n) covariance of the unknowns [their unit^2]
    # (b, q, c) what else was absorbed, as `seen` has it of the unknowns [1]
    beside: FloatArray | None = None

    @cached_property
    def seen(self) -> FloatArray:
        """Slopes by independent unknowns of unit variance, shape (b, q, k) [1]."""
        values, vectors = np.linalg.eigh(self.cov)
        own = np.asarray(self.slopes @ (vectors * np.sqrt(np.maximum(values, 0.0))))
        return own if self.beside is None else np.concatenate([own, self.beside], axis=-1)

    @cached_property
    def leverage(self) -> FloatArray:
        """Share of each residual that the fit absorbs, shape (b, q) [1]."""
        return np.asarray(np.sum(self.seen**2, axis=-1))

    def parts(self, count: int) -> list[IntArray]:
        """Return the rows in `count` parts [1], one after the other, those that have any."""
        return [p for p in np.array_split(np.arange(len(self.residuals)), count) if len(p)]

    def square(
        self, rows: slice | IntArray, columns: slice | int = slice(None)
    ) -> tuple[float, float]:
        """Return the sum of squares of residuals `rows`, `columns` [1], and its dof."""
        some = (rows, columns)
        dof = max(float(np.sum(1 - self.leverage[some])), 1.0)
        return float(np.sum(self.residuals[some] ** 2)), dof

    def sums(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return sums of the residuals over parts, and their covariance.

        `count`: number of parts [1]. Returns `sums` (q k,): over the square root of the number of
        terms [1]; `cov` (q k, q k): what it is where noise and model are right [1].
        """
        pieces = self.parts(count)
        total = [np.sum(self.residuals[p], axis=0) / np.sqrt(len(p)) for p in pieces]
        absorbed = np.concatenate([np.sum(self.seen[p], axis=0) / np.sqrt(len(p)) for p in pieces])
        return np.concatenate(total), np.eye(len(absorbed)) - absorbed @ absorbed.T

    def told(self, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the residuals say of changes that nothing else stands for.

        `moved` (b, q, k, d): how one unit of each moves the rows [1]. Returns the information of
        each (k, d, d) beside all that is estimated, and ``moved' residuals`` (k, d), which is zero
        where the fit absorbs it all [1].
        """
        rows, k, d = self.residuals.size, *moved.shape[2:]
        D, A = moved.reshape(rows, k, d), self.seen.reshape(rows, -1)
        across = np.tensordot(A, D, (0, 0))
        whole = np.einsum("rki,rkj->kij", D, D, optimize=True)
        own = whole - np.einsum("aki,akj->kij", across, across, optimize=True)
        left = np.linalg.eigvalsh(own)[:, 0] > ROUNDING * np.einsum("kii->k", whole)
        pull = np.tensordot(self.residuals.ravel(), D, (0, 0))
        return np.where(left[:, None, None], own, whole), np.where(left[:, None], pull, 0.0)

    def neighbours(self) -> tuple[float, float, float]:
        """Return the sum of ``r_k r_k+1`` of all rows, its mean and its standard deviation [1].

        What the fit has absorbed relates neighbours where the model is right: residuals of unit
        variance, ``cov r = C = 1 - A A'`` with A the slopes `seen`, give ``r' B r`` the mean
        ``tr B C`` and the variance ``2 tr (B C)^2``, B half of the shift of one row to and fro.
        """
        width = self.residuals.shape[1]
        size = [value / dof for value, dof in (self.square(slice(None), k) for k in range(width))]
        r, A, pairs = self.residuals / np.sqrt(size), self.seen, (len(self.residuals) - 1) * width
        BA = np.zeros_like(A)
        BA[1:] += A[:-1] / 2
        BA[:-1] += A[1:] / 2
        ABA = np.einsum("bqk,bql->kl", A, BA)
        variance = pairs - 4 * float(np.sum(BA**2)) + 2 * float(np.sum(ABA**2))
        return float(np.sum(r[1:] * r[:-1])), -float(np.trace(ABA)), float(np.sqrt(variance))

    def parts_out(self, pieces: Sequence[IntArray], false_alarm: float = FALSE_ALARM) -> HeldOut:
        """Predict parts of the rows from all others, without solving again.

        With A the slopes `seen` of a part and r its residuals the others leave ``(1 - A A')^-1 r``,
        of covariance ``(1 - A A')^-1``.

        `pieces`: rows that are left out together [1]; `false_alarm`: probability that any is beyond
        its limit by chance [1].
        """
        scores, counts = list[float](), list[float]()
        for piece in pieces:
            r = self.residuals[piece].ravel()
            A = self.seen[piece].reshape(len(r), -1)
            pull = A.T @ r
            scores.append(float(r @ r + pull @ np.linalg.solve(np.eye(len(pull)) - A.T @ A, pull)))
            counts.append(float(len(r)))
        return HeldOut(np.array(scores), np.array(counts), false_alarm)


def budget(
    at: Fit[P, S], known: Mapping[str, IntArray], driven: Mapping[str, IntArray]
) -> dict[str, FloatArray]:
    """Return the variance of every value by source of error; they add up.

    `known`: source -> numbers of the states whose prior it is, not correlated with those of
    another [1]; `driven`: source -> numbers of the states that its noise acts on [1]. Each kind of
    measurement is a source too. Returns source -> variances (n - first,) [SI].

    The error at the end is linear in every noise before. L, what an error of the state makes of it,
    is known from the end backwards::

        L (I - K H) Phi -> L,    (L K)^2 R and L^2 N are the variances of each noise
    """
    s, run, first = at.system, kalman(at.system, keep=True), at.model.first
    L, b = np.eye(len(s.x0))[first:], s.Phi.shape[1]
    measured, moved = np.zeros((len(L), s.R.shape[1])), np.zeros(L.shape)
    for k in range(len(s.R) - 1, -1, -1):
        taken = np.isfinite(run.innovation[k])
        H, R = s.H[k][taken], s.R[k][taken]
        H_P = H @ run.before[k]
        LK = L @ np.linalg.solve(H_P @ H.T + np.diag(R), H_P).T
        measured[:, taken] += LK**2 * R
        L = L - LK @ H
        moved += L**2 * s.half[k]
        onto = L[:, :b] @ s.Phi[k]
        onto[:, b:] += L[:, b:]
        L = onto
        moved += L**2 * s.half[k]
    start = {n: np.einsum("pi,ij,pj->p", L[:, i], s.P0[np.ix_(i, i)], L[:, i])
             for n, i in known.items()}  # fmt: skip
    noise = {n: moved[:, i].sum(axis=1) for n, i in driven.items()}
    return start | noise | {n: measured[:, c].sum(axis=1) for n, c in at.model.kinds.items()}


# -- are the innovations what they should be? ------------------------------------------------------


def autocorrelation(u: FloatArray, lags: int) -> FloatArray:
    """Return the autocorrelation of `u` (m,) [unit] at lags 1 to `lags`, shape (lags,) [1]."""
    total = float(u @ u)
    return np.array([u[k:] @ u[:-k] / total for k in range(1, lags + 1)])


def independent(u: FloatArray) -> float:
    """Return as how many independent values the squares of `u` (m,) scatter [1]_ [1]."""
    m = len(u)
    rho = autocorrelation(u, min(LAGS, m // 4))
    # A sequence of independent values has squared correlations of 1 / m on average.
    return m / (1.0 + 2.0 * max(0.0, float(np.sum(rho**2 - 1.0 / m))))


def _columns(u: FloatArray) -> list[FloatArray]:
    return [c[np.isfinite(c)] for c in u.T if np.isfinite(c).sum() > LAGS]


def component(u: FloatArray, false_alarm: float, tests: int = 1) -> Component | None:
    """Judge standardised innovations by the chi-square of as many as are independent.

    `u` (m, q): innovations over their standard deviations, NaN where there is none [1];
    `false_alarm`: of all tests [1]; `tests`: how many kinds are judged [1].
    """
    columns = _columns(u)
    if not columns:
        return None
    count = sum(len(c) for c in columns)
    free = sum(independent(c) for c in columns)
    square = float(sum(c @ c for c in columns)) / count
    return Component(square * free, free, *chi_square_limits(free, false_alarm, tests), count)


def components(at: Fit[P, S], false_alarm: float = FALSE_ALARM) -> dict[str, Component]:
    """Return the innovations of every kind against what is expected of them, where there are some.

    `false_alarm`: probability that any is outside its two-sided limits by chance [1].

    What is not modelled makes innovations depend on one another; the sum of their squares then
    scatters as that of fewer, ``n / (1 + 2 sum rho_k^2)`` with rho_k their autocorrelation [1]_.
    """
    kinds = at.model.kinds
    made = {k: component(at.run.white[:, c], false_alarm, len(kinds)) for k, c in kinds.items()}
    return {kind: one for kind, one in made.items() if one is not None}


def dependence(run: LinearRun, false_alarm: float = FALSE_ALARM) -> tuple[float, float]:
    """Return how innovations depend on those before, and what `false_alarm` allows [1]."""
    columns = _columns(run.white)
    sums = np.array([len(c) * np.sum(autocorrelation(c, FEW) ** 2) for c in columns])
    limit = chi_square_limits(FEW, 2 * false_alarm, max(len(columns), 1))[1]
    return float(sums.max(initial=0.0)), float(limit)
