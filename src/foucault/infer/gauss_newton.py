"""Gauss-Newton with an exact elimination of the nuisance parameters.

At each state the problem gives white residuals r and the Jacobian J of the prediction; the step
minimises ``|r - J dx|^2``. With the columns ordered nuisance first, coefficients last,

    J = Q [[R11, R12], [0, R22]]

so that ``R22' R22`` is the Fisher information of the coefficients with the nuisance parameters
eliminated, and its inverse their covariance. Nothing is squared before it is solved. Whether the
sum of squares that is left is what the noise predicts is judged by its two-sided limits.

References
----------
.. [1] A. Bjorck, *Numerical Methods for Least Squares Problems*, SIAM, 1996, section 9.2.
.. [2] P. J. Huber, *Robust Statistics*, Wiley, 1981, section 7.8 (weights).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, settled
from foucault.coefficients import CoefficientVector
from foucault.errors import Status
from foucault.result import Estimate, Linearised, Problem

FALSE_ALARM = 0.01  # Family-wise probability of rejecting a result that is right [1].


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
    return float(np.sqrt(n / (n - 2.0))) if np.isfinite(n) else 1.0


@lru_cache(1024)
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


@dataclass(frozen=True)
class Component:
    """How one kind of reading, or of innovation, fits."""

    chi_square: float  # sum of squares of the white residuals, as of so many independent ones [1]
    redundancy: float  # degrees of freedom: redundancy of the readings, independent innovations [1]
    # low, high: two-sided limits of the sum of squares at 1 % for all kinds together [1]
    low: float
    high: float
    count: int = 0  # number of innovations [1]

    @property
    def ratio(self) -> float:
        """Sum of squares over redundancy [1]."""
        return self.chi_square / max(self.redundancy, 1e-9)

    @property
    def rms(self) -> tuple[float, float, float]:
        """Root mean square of what is standardised, and its limits [1]."""
        low, rms, high = np.sqrt([self.low, self.chi_square, self.high]) / np.sqrt(self.redundancy)
        return float(rms), float(low), float(high)

    @property
    def inside(self) -> bool:
        """Whether the noise explains the residuals, neither more nor less."""
        return self.low <= self.chi_square <= self.high


def chi_square_density(x: npt.NDArray[np.float64], dof: float) -> npt.NDArray[np.float64]:
    """Return the density of a chi-square variable at `x` (n,), of `dof` [1]."""
    from scipy.special import gammaln, xlogy

    half = dof / 2
    return np.asarray(np.exp(xlogy(half - 1, x) - x / 2 - half * np.log(2) - gammaln(half)))


Loss = Callable[[FloatArray], FloatArray]


def least_squares(norms: FloatArray) -> FloatArray:
    """Give every observation its full weight, whatever `norms`, shape (blocks,), say."""
    return np.ones_like(norms)


ROBUST_LIMIT = 3.0
"""Observations whose standardized residuals exceed this, rms, count as outliers [1]."""

PATIENCE = 8  # After this many steps a gain below the tolerance is none [1].

SETTLED = 0.05
"""A last step shorter than this is of no account, in units of its standard deviation [1]."""

STILL = 0.05
"""A step that is shorter is taken, whatever the sum of squares does: whitening moves by as much
with the state [sd]."""

CREEPS = 100
"""Steps allowed where residuals may be large, as they are with a prior that is wrong [1]."""

LEFT_OUT = 1e-6
"""Weight of an observation that is left out; not zero, so that its residual is still known [1]."""


def huber(norms: FloatArray, limit: float = ROBUST_LIMIT) -> FloatArray:
    """Give weight limit/norm to `norms` (blocks,), rms residuals, beyond `limit` [1]."""
    return np.minimum(1.0, limit / np.maximum(norms, limit))


@dataclass(frozen=True)
class _Step:
    step: FloatArray
    R: FloatArray
    order: npt.NDArray[np.intp]
    scale: FloatArray
    weak: bool


def solve(
    problem: Problem,
    *,
    loss: Loss = least_squares,
    max_iterations: int = 25,
    tolerance: float = 1e-4,
    weights: FloatArray | None = None,
) -> Estimate:
    """Minimise the sum of squared white residuals of a problem.

    `loss`: ``norms -> weights``, both shape (blocks,) [1], `least_squares` or `huber`;
    `max_iterations`: after this many steps the status is NOT_CONVERGED [1]; `tolerance`:
    converged when a step is shorter than this, in units of its standard deviation [1]; `weights`
    (blocks,): robust weights to start from, None starts with full weights [1]. Returns
    coefficients with covariance; the status says how it ended.
    """
    state = problem.start
    weights = np.ones(problem.n_blocks) if weights is None else weights
    at = with_prior(problem, state, problem.linearise(state, weights))
    status, iterations, moved = Status.NOT_CONVERGED, 0, np.inf
    while iterations < max_iterations:
        iterations += 1
        if not (np.isfinite(at.residuals).all() and np.isfinite(at.jacobian).all()):
            status = Status.NOT_FINITE
            break
        part = _solve_step(at, len(problem.layout))
        cost = float(at.residuals @ at.residuals)
        before = state
        state, at, moved = _descend(problem, state, weights, at, part.step)
        gained = cost - float(at.residuals @ at.residuals)
        norms = block_norms(at.residuals, at.blocks, weights)
        new = loss(norms)
        weights, reweighted = new, float(np.max(np.abs(new - weights), initial=0.0))
        if reweighted > 1e-3:
            at = with_prior(problem, state, problem.linearise(state, weights))
        # `moved` is the step in units of its own standard deviation: sqrt(dx' J'J dx).
        # A small step that lowers nothing is the end too: whitening moves with the state. A
        # heading that is hardly visible creeps by hundredths of its sd for long.
        elif moved < tolerance or (
            moved < 100 * tolerance and gained <= (tolerance if iterations > PATIENCE else 0)
        ):
            status = Status.CONVERGED
            break
        elif state is before:  # no part of the step lowers anything, nor will it next time
            break
    # Robust weights can flicker for ever; what they move by then may be of no account.
    if status is Status.NOT_CONVERGED and moved < SETTLED:
        status = Status.CONVERGED
    return _estimate(problem, state, at, weights, status, iterations)


def add_prior(problem: Problem, alone: Estimate) -> Estimate:
    """Add the prior of a problem to what the observations alone say.

    Scatter and outliers are to be settled without the prior (``replace(problem, prior=None)``) and
    then held: they would take up what contradicts it, and the more wrong a prior, the more surely
    it would be believed. `diagnose.checks.judge_prior` compares the two.

    `problem`: the problem with its prior, and with the noise and scatter that the observations
    showed.
    """
    estimate = solve(
        replace(problem, start=alone.state), loss=partial(held, alone.weights),
        weights=alone.weights, max_iterations=CREEPS,
    )  # fmt: skip
    seen = alone.status is Status.CONVERGED
    return replace(estimate, alone=alone.coefficients if seen else None)


def held(weights: FloatArray, norms: FloatArray) -> FloatArray:
    """Return the `weights` (blocks,) that are settled, whatever `norms` (blocks,) say [1]."""
    return weights


def eliminate(at: Linearised, n_coefficients: int) -> FloatArray:
    """Return the square root R22 of the information, nuisance parameters eliminated.

    `at`: a problem linearised at some state, coefficients are its first columns;
    `n_coefficients`: number of coefficients [1]. Returns (n, n): upper triangular; ``R22.T @
    R22`` is the Fisher information [1 / unit^2].
    """
    n = n_coefficients
    part = _solve_step(at, n)
    total = at.jacobian.shape[1]
    return np.asarray(part.R[total - n :, total - n :] * part.scale[:n])


def with_prior(problem: Problem, state: Any, at: Linearised) -> Linearised:
    """Add to `at` the rows of what is known of the coefficients beforehand."""
    prior = problem.prior
    if prior is None:
        return at
    known = np.flatnonzero(np.isfinite(prior.prior_sd))
    sd = prior.prior_sd[known]
    rows = np.zeros((len(known), at.jacobian.shape[1]))
    rows[np.arange(len(known)), known] = 1.0 / sd
    miss = (prior.values[known] - problem.values(state)[known]) / sd
    return Linearised(
        np.concatenate([at.residuals, miss]),
        np.concatenate([at.jacobian, rows]),
        np.concatenate([at.blocks, np.full(len(known), -1)]),
    )


def _solve_step(at: Linearised, n_coefficients: int) -> _Step:
    n = at.jacobian.shape[1]
    order = np.concatenate([np.arange(n_coefficients, n), np.arange(n_coefficients)])
    scale = np.linalg.norm(at.jacobian, axis=0)
    scale[scale == 0] = 1.0
    J = (at.jacobian / scale)[:, order]
    # With the residuals as a last column Q is not needed: its product with them is in R.
    full = np.asarray(np.linalg.qr(np.column_stack([J, at.residuals]), mode="r"))
    R, rhs = full[:n, :n], full[:n, n]
    diagonal = np.abs(np.diag(R))
    weak = bool(J.shape[0] < n or diagonal.min() < 1e-11 * diagonal.max())
    if weak:  # the shortest step, so that the visible part still converges
        step = np.linalg.lstsq(R, rhs, rcond=1e-10)[0]
    else:
        step = np.linalg.solve(R, rhs)
    dx = np.empty(n)
    dx[order] = step
    return _Step(dx / scale, R, order, scale, weak)


def _descend(
    problem: Problem, state: Any, weights: FloatArray, at: Linearised, step: FloatArray
) -> tuple[Any, Linearised, float]:
    """Take the step, halved until the sum of squares does not grow."""
    now = float(at.residuals @ at.residuals)
    moved = float(np.linalg.norm(at.jacobian @ step))
    share = 1.0
    for _ in range(8):
        trial = problem.retract(state, share * step)
        there = with_prior(problem, trial, problem.linearise(trial, weights))
        cost = float(there.residuals @ there.residuals)
        if np.isfinite(cost) and cost <= now * (1 + 1e-9) + 1e-9:
            return trial, there, moved * share
        if moved * share < STILL:  # the whitening moves with the state: settle here
            return trial, there, moved * share
        share *= 0.5
    return state, at, moved


def block_norms(
    residuals: FloatArray, blocks: npt.NDArray[np.int64], weights: FloatArray
) -> FloatArray:
    """Return the root mean square standardized residual of each observation.

    `residuals` (m,): white residuals, the root of the weights in them [1]; `blocks` (m,):
    observation each belongs to, -1 for a prior; `weights` (blocks,): weights the residuals were
    made with, they are undone [1].
    """
    used = blocks >= 0
    square = np.bincount(blocks[used], residuals[used] ** 2, len(weights))
    count = np.bincount(blocks[used], minlength=len(weights))
    return np.sqrt(square / np.maximum(count, 1) / np.maximum(weights, 1e-12))


def _estimate(
    problem: Problem,
    state: Any,
    at: Linearised,
    weights: FloatArray,
    status: Status,
    iterations: int,
) -> Estimate:
    n = len(problem.layout)
    part = _solve_step(at, n)
    total = at.jacobian.shape[1]
    inverse = np.linalg.pinv(part.R, rcond=1e-12) if part.weak else np.linalg.inv(part.R)
    cov = np.empty((total, total))
    cov[np.ix_(part.order, part.order)] = inverse @ inverse.T
    cov /= np.outer(part.scale, part.scale)
    R22 = part.R[total - n :, total - n :] * part.scale[:n]
    weakest: tuple[str, ...] = ()
    if part.weak:
        weakest = _weak_combinations(problem, R22)
        if status is Status.CONVERGED:
            status = Status.UNOBSERVABLE
    values = problem.values(state)
    coefficients = CoefficientVector(
        problem.layout,
        values,
        cov[:n, :n],
        prior_sd=problem.prior.prior_sd if problem.prior else np.full(n, np.inf),
    )
    return Estimate(
        coefficients=coefficients,
        state=state,
        status=status,
        iterations=iterations,
        residuals=at.residuals,
        leverage=np.sum(((at.jacobian / part.scale)[:, part.order] @ inverse) ** 2, axis=1),
        blocks=at.blocks,
        chi_square=float(at.residuals @ at.residuals),
        dof=len(at.residuals) - total,
        information=R22.T @ R22,
        state_cov=cov,
        weights=weights,
        weakest=weakest,
    )


def _weak_combinations(problem: Problem, R22: FloatArray) -> tuple[str, ...]:
    """Name the directions of the coefficients that the data do not see."""
    scale = np.linalg.norm(R22, axis=0)
    invisible = scale <= 1e-9 * scale.max()
    words = [problem.layout.names[i] for i in np.flatnonzero(invisible)]
    seen = np.flatnonzero(~invisible)
    if len(seen):
        _, s, Vt = np.linalg.svd(R22[:, seen] / scale[seen])
        for value, direction in zip(
            s, settled(np.where(s < 1e-9 * s[0], 0.0, s), Vt[: len(s)]), strict=True
        ):
            if value < 1e-9 * s[0]:
                largest = np.argsort(-np.abs(direction))[:4]
                terms = [
                    f"{direction[i]:+.2f} {problem.layout.names[seen[i]]}"
                    for i in largest
                    if abs(direction[i]) > 0.1
                ]
                words.append(" ".join(terms))
    return tuple(words)
