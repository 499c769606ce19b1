"""Coefficients as functions of temperature, and how many terms they need.

The fit is by generalised least squares of what several sessions found.

A piece of evidence at the temperature T (the coefficients that one session found, or a mean over
a part of a ramp) says

    y = H c(T) + e,     c_i(T) = sum over k of theta_ik psi_k(T),     e ~ N(0, C + D)

C is the covariance it came with. D is diagonal: the variance s_f^2 by which coefficients of the
family f (the three biases of the gyros, say) scatter from one piece to the next. It is declared, or
found with the functions by restricted maximum likelihood (REML), which allows for the parameters
that the functions take.

References
----------
.. [1] H. D. Patterson, R. Thompson, "Recovery of inter-block information when block sizes are
   unequal", Biometrika 58, 1971 (restricted likelihood).

How many terms the functions need is told by F-tests.
The functions of a family (the three biases of the gyros, say) are one of several nested spaces:
constant, straight line, parabola ... `choose` starts with the largest that the temperatures allow,
takes the scatter from there, and takes the last term of a family away as long as the sum of squares
grows by no more than chance explains. In this order a term that is missing cannot hide in the
scatter. `against` is the same test of any two designs, for what else may be missing.

References
----------
.. [1] G. A. F. Seber, A. J. Lee, *Linear Regression Analysis*, 2nd ed., 2003, section 4.3 (F-test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import linalg, optimize, special

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.infer.gauss_newton import FALSE_ALARM, student

JITTER = 1e-10
"""Added to the variances, as a part: a covariance may be singular where coefficients are tied [1].
"""

DEPENDENT = 1e-8  # An eigenvalue of a correlation matrix below this belongs to what is tied [1].
NOTHING = 1e-4  # A scatter whose variance is a smaller part of the evidence's own is none [1].


@dataclass(frozen=True)
class Evidence:
    """What one session, or a part of a ramp, says: ``y = H c + e``, in units of its own."""

    # (b,) functions of temperature, and whatever else may be a factor, at this temperature [any]
    basis: FloatArray
    y: FloatArray  # (r,) what was found [unit]
    cov: FloatArray  # (r, r) its covariance [unit^2]
    # (r, n) derivative by the coefficients, and by constants that nobody wants to know [1]
    H: FloatArray
    group: IntArray  # (r,) which s_f each row has [1]


@dataclass(frozen=True)
class Design:
    """Which functions the coefficients have: a row of each array is one parameter."""

    coefficient: IntArray  # (q,) the coefficient, or constant, that it belongs to
    weights: FloatArray  # (q, b) psi as a sum of what `Evidence.basis` holds [any]

    @classmethod
    def of(cls, spaces: Sequence[FloatArray]) -> Design:
        """Put together the functions of every coefficient, `spaces` (k, b) each [any]."""
        owner = np.repeat(np.arange(len(spaces)), [len(s) for s in spaces])
        return cls(owner, np.concatenate(spaces))

    def rows(self, one: Evidence) -> FloatArray:
        """Return the derivative of what `one` says by the parameters, shape (r, q)."""
        return np.asarray(one.H[:, self.coefficient] * (self.weights @ one.basis))


@dataclass(frozen=True)
class Fit:
    """Functions found."""

    design: Design
    theta: FloatArray  # (q,) the parameters [any]
    cov: FloatArray  # (q, q) their covariance [any]
    variance: FloatArray  # (g,) s_f^2 of each group [unit^2]
    evidence: tuple[Evidence, ...]  # what it was fitted to
    chi_square: float  # sum of squares of the residuals over their standard deviations [1]

    @cached_property
    def residuals(self) -> tuple[FloatArray, ...]:
        """What was found minus what the functions say, one array per piece of evidence [unit]."""
        return tuple(e.y - self.design.rows(e) @ self.theta for e in self.evidence)

    @cached_property
    def dof(self) -> int:
        """Degrees of freedom: what is not tied, minus the parameters that are not [1]."""
        seen = sum(_rank(covariance(e, self.variance)) for e in self.evidence)
        return seen - _rank(self.cov)

    def predicted(self, one: Evidence) -> tuple[FloatArray, FloatArray]:
        """Return what `one` would say, shape (r,), and its covariance with that of `one`."""
        X = self.design.rows(one)
        return X @ self.theta, X @ self.cov @ X.T + covariance(one, self.variance)


def covariance(one: Evidence, variance: FloatArray) -> FloatArray:
    """Return the covariance of evidence with scatter `variance` (g,), shape (r, r) [unit^2]."""
    return one.cov + np.diag(variance[one.group] + JITTER * np.diag(one.cov))


def solve(evidence: Sequence[Evidence], design: Design, variance: FloatArray) -> Fit | None:
    """Fit with scatter `variance` (g,) [unit^2] known; None where the evidence cannot tell."""
    A, b = [], []
    for stack in _stacks(evidence, design):
        L = np.linalg.cholesky(stack.covariance(variance))
        white = np.linalg.solve(L, np.concatenate([stack.X, stack.y[..., None]], axis=-1))
        A.append(white[..., :-1].reshape(-1, white.shape[-1] - 1))
        b.append(white[..., -1].ravel())
    return _least_squares(np.concatenate(A), np.concatenate(b), evidence, design, variance)


def _least_squares(
    A: FloatArray, b: FloatArray, evidence: Sequence[Evidence], design: Design,
    variance: FloatArray,
) -> Fit | None:  # fmt: skip
    size = np.linalg.norm(A, axis=0)
    if len(A) < A.shape[1] or not (size > 0).all():
        return None
    Q, R = np.linalg.qr(A / size)
    values = np.linalg.svd(R, compute_uv=False)
    if values[-1] < len(A) * np.finfo(float).eps * values[0]:
        return None
    inverse = linalg.solve_triangular(R, np.eye(len(R))) / size[:, None]
    theta = inverse @ (Q.T @ b)
    square = float(np.sum((b - A @ theta) ** 2))
    return Fit(design, theta, inverse @ inverse.T, variance, tuple(evidence), square)


def scatter(
    evidence: Sequence[Evidence], design: Design, known: FloatArray, wanted: BoolArray,
    *, restricted: bool = True,
) -> FloatArray:  # fmt: skip
    """Find the scatter by restricted maximum likelihood, s_f^2, shape (g,) [unit^2].

    `design`: the functions, all of them to be told by the evidence; `known` (g,): s_f^2 where it
    is declared [unit^2]; `wanted` (g,): which are to be found; `restricted`: false takes the
    likelihood itself, which compares designs.
    """
    if not wanted.any():
        return known
    # The mean variance of each group [unit^2].
    groups = len(known)
    total, count = np.zeros(groups), np.zeros(groups)
    for one in evidence:
        np.add.at(total, one.group, np.diag(one.cov))
        np.add.at(count, one.group, 1.0)
    size, stacks = total / np.maximum(count, 1.0), _stacks(evidence, design)

    # By the logarithm of one and more: of a root, nothing is flat, and never left once it is met.
    def cost(more: FloatArray) -> tuple[float, FloatArray]:
        variance = known.copy()
        variance[wanted] = np.expm1(more) * size[wanted]
        value, slope = _unlikely(stacks, variance, restricted)
        return value, slope[wanted] * np.exp(more) * size[wanted]

    start = np.log1p(np.maximum(_misfit(evidence, design, known), 0.1))[wanted]
    found = optimize.minimize(
        cost, start, jac=True, method="L-BFGS-B", bounds=[(0.0, None)] * len(start),
        options={"maxiter": 300, "ftol": 1e-12, "gtol": 1e-7},
    )  # fmt: skip
    out = known.copy()
    part = np.expm1(found.x)
    out[wanted] = np.where(part > NOTHING, part, 0.0) * size[wanted]
    return out


@dataclass(frozen=True)
class _Stack:
    """Evidence with equally many rows, side by side: the pieces are the first axis."""

    y: FloatArray
    cov: FloatArray
    X: FloatArray
    group: IntArray

    def covariance(self, variance: FloatArray) -> FloatArray:
        """Return the covariances with their scatter, shape (m, r, r) [unit^2]."""
        out = self.cov.copy()
        at = np.arange(self.y.shape[1])
        out[:, at, at] += variance[self.group] + JITTER * self.cov[:, at, at]
        return out


def _stacks(evidence: Sequence[Evidence], design: Design) -> list[_Stack]:
    sizes = dict.fromkeys(len(e.y) for e in evidence)
    alike = [[e for e in evidence if len(e.y) == n] for n in sizes]
    return [
        _Stack(
            np.array([e.y for e in some]),
            np.array([e.cov for e in some]),
            np.array([design.rows(e) for e in some]),
            np.array([e.group for e in some]),
        )
        for some in alike
    ]


def _unlikely(
    stacks: Sequence[_Stack], variance: FloatArray, restricted: bool
) -> tuple[float, FloatArray]:
    """Return minus the log-likelihood, restricted or not, and its derivative by each s_f^2."""
    q = stacks[0].X.shape[-1]
    A, b, value = np.zeros((q, q)), np.zeros(q), 0.0
    inverses = []
    for stack in stacks:
        V = stack.covariance(variance)
        W = np.linalg.inv(V)
        A += np.einsum("mrq,mrs,msp->qp", stack.X, W, stack.X, optimize=True)
        b += np.einsum("mrq,mrs,ms->q", stack.X, W, stack.y, optimize=True)
        value += float(np.linalg.slogdet(V)[1].sum())
        inverses.append(W)
    cov = np.linalg.inv(A)
    value += float(np.linalg.slogdet(A)[1]) if restricted else 0.0
    theta = cov @ b
    slope = np.zeros_like(variance)
    for stack, W in zip(stacks, inverses, strict=True):
        r = stack.y - stack.X @ theta
        Pr = np.einsum("mrs,ms->mr", W, r)
        value += float(np.sum(r * Pr))
        WX, P = W @ stack.X, np.einsum("mrr->mr", W)
        if restricted:
            P = P - np.einsum("mrq,qp,mrp->mr", WX, cov, WX, optimize=True)
        np.add.at(slope, stack.group, 0.5 * (P - Pr**2))
    return 0.5 * value, slope


def _misfit(evidence: Sequence[Evidence], design: Design, variance: FloatArray) -> FloatArray:
    """Return the mean square of the residuals of each group, in sd of the evidence [1]."""
    fit = solve(evidence, design, variance)
    total, count = np.zeros(len(variance)), np.zeros(len(variance))
    for one, r in zip(evidence, fit.residuals if fit else (), strict=False):
        np.add.at(total, one.group, r**2 / np.diag(one.cov))
        np.add.at(count, one.group, 1.0)
    return total / np.maximum(count, 1.0)


def _rank(cov: FloatArray) -> int:
    """How much of a covariance is not tied."""
    sd = np.sqrt(np.diag(cov))
    return int((np.linalg.eigvalsh(cov / np.outer(sd, sd)) > DEPENDENT).sum())


@dataclass(frozen=True)
class Spaces:
    """The functions that every family may have, and which coefficients it has."""

    # per family: the spaces from the smallest to the largest, each shape (k, b) [any]
    nested: tuple[tuple[FloatArray, ...], ...]
    family: IntArray  # (n,) the family of each coefficient [1]
    constant: FloatArray  # (1, b) the space of a constant [any]
    constants: int  # how many constants nobody wants to know follow the coefficients [1]

    def design(self, orders: Sequence[int], more: FloatArray | None = None, of: int = -1) -> Design:
        """Return the design where each family has the space of its order.

        `orders`: number of the space of each family [1]; `more` (k, b) or None: functions that
        one family has besides [any]; `of`: that family [1].
        """
        spaces = []
        for f in self.family:
            space = self.nested[f][orders[f]]
            spaces.append(space if more is None or f != of else np.concatenate([space, more]))
        return Design.of([*spaces, *[self.constant] * self.constants])

    def largest(self) -> list[int]:
        """Return the number of the largest space of each family."""
        return [len(spaces) - 1 for spaces in self.nested]


@dataclass(frozen=True)
class Test:
    """One F-test: does a family need more than it has?"""

    family: int  # number of the family [1]
    order: int  # the space it has [1]
    against: int  # the larger one it was tested against [1]
    F: float  # growth of the sum of squares per term [1]
    p: float  # probability of so much by chance [1]


@dataclass(frozen=True)
class Choice:
    """What the evidence needs."""

    fit: Fit
    orders: tuple[int, ...]  # number of the space of each family [1]
    needed: tuple[Test, ...]  # per family that changes: its space against the next smaller one
    missing: tuple[Test, ...]  # per family that could have more: its space against the largest
    # (g,) degrees of freedom that tell the scatter of each group; infinite where it is taken as
    # known [1]
    dof: FloatArray
    known: FloatArray  # (g,) s_f^2 as declared [unit^2]
    # wanted, untold: (g,) scatters that were to be found; those of them for which there is no
    # freedom, taken as zero
    wanted: BoolArray
    untold: BoolArray

    @property
    def cov(self) -> FloatArray:
        """Covariance of the parameters, the scatter with Student's factor for what tells it."""
        if not np.isfinite(self.dof).any():
            return self.fit.cov
        wide = self.fit.variance * np.array([student(v) ** 2 for v in self.dof])
        again = solve(self.fit.evidence, self.fit.design, wide)
        return self.fit.cov if again is None else again.cov


def choose(
    evidence: Sequence[Evidence],
    spaces: Spaces,
    fixed: dict[int, int],
    known: FloatArray,
    wanted: BoolArray,
) -> Choice | None:
    """Choose the space of every family; None where the evidence cannot even tell those asked for.

    `fixed`: family -> the number of the space it has to have [1]; `known` (g,): s_f^2 where it is
    declared [unit^2]; `wanted` (g,): which scatters are to be found.
    """
    largest = spaces.largest()
    full = spaces.design(largest)
    if solve(evidence, full, known) is None:
        return None
    free, dof = _told(evidence, full, wanted)
    variance = scatter(evidence, full, known, free)
    tester = _Tester(evidence, spaces, variance, dof, max(1, sum(n > 0 for n in largest)))
    # What is fixed too low leaves its misfit to those it is correlated with: it is not, in tests.
    beside = tester.reduced(largest, set(fixed))
    orders = [fixed.get(f, n) for f, n in enumerate(beside)]
    needed = [tester.test(beside, f, n - 1, n) for f, n in enumerate(orders) if n > 0]
    missing = [
        tester.test(beside, f, n, largest[f]) for f, n in enumerate(orders) if n < largest[f]
    ]
    found = refit(evidence, spaces.design(orders), known, wanted)
    if found is None:
        return None
    fit, dof, free = found
    return Choice(fit, tuple(orders), tuple(needed), tuple(missing), dof, known, wanted,
                  wanted & ~free)  # fmt: skip


def gained(small: Fit, large: Fit) -> float:
    """Return twice the log-likelihood that `large` has more, each with the scatter it has."""
    less, more = (
        _unlikely(_stacks(fit.evidence, fit.design), fit.variance, restricted=False)[0]
        for fit in (small, large)
    )
    return 2 * (less - more)


def refit(
    evidence: Sequence[Evidence], design: Design, known: FloatArray, wanted: BoolArray,
    *, restricted: bool = True,
) -> tuple[Fit, FloatArray, BoolArray] | None:  # fmt: skip
    """Fit one design with its scatter; None where the evidence cannot tell it.

    `known` (g,): s_f^2 where it is declared [unit^2]; `wanted` (g,): which scatters are to be
    found; `restricted`: as of `scatter`. Returns `dof` (g,): degrees of freedom that tell each
    scatter; infinite where it is taken as known [1]; `free` (g,): which scatters were found.
    """
    if solve(evidence, design, known) is None:
        return None
    free, dof = _told(evidence, design, wanted)
    variance = scatter(evidence, design, known, free, restricted=restricted)
    fit = solve(evidence, design, variance)
    return None if fit is None else (fit, dof, free)


def against(small: Fit, large: Fit, dof: float) -> tuple[float, float, int]:
    """Return F, its probability by chance and its number of terms, of two fits one in the other.

    `dof`: degrees of freedom that tell the scatter, infinite where it is declared [1].
    """
    terms = max(len(large.theta) - len(small.theta), 1)
    F = max(small.chi_square - large.chi_square, 0.0) / terms
    if np.isinf(dof):
        return F, float(special.chdtrc(terms, F * terms)), terms
    return F, float(special.fdtrc(terms, dof, F)), terms


@dataclass(frozen=True)
class _Tester:
    """Tests families against one another, all with the scatter of the largest design."""

    evidence: Sequence[Evidence]
    spaces: Spaces
    variance: FloatArray
    dof: FloatArray
    tests: int
    fits: dict[tuple[int, ...], Fit] = field(default_factory=dict)

    def fit(self, orders: tuple[int, ...]) -> Fit:
        if orders not in self.fits:
            fit = solve(self.evidence, self.spaces.design(orders), self.variance)
            assert fit is not None  # a part of what was told
            self.fits[orders] = fit
        return self.fits[orders]

    def test(self, orders: Sequence[int], family: int, small: int, large: int) -> Test:
        fits = [
            self.fit(tuple(order if f == family else n for f, n in enumerate(orders)))
            for order in (small, large)
        ]
        F, p, _ = against(fits[0], fits[1], self.dof[family])
        return Test(family, small, large, F, p)

    def reduced(self, orders: list[int], fixed: set[int]) -> list[int]:
        """Take terms away while chance explains them."""
        while True:
            tests = [
                self.test(orders, f, n - 1, n)
                for f, n in enumerate(orders)
                if n > 0 and f not in fixed
            ]
            worst = max(tests, key=lambda t: t.p, default=None)
            if worst is None or worst.p <= FALSE_ALARM / self.tests:
                return orders
            orders = [worst.order if f == worst.family else n for f, n in enumerate(orders)]


def _told(
    evidence: Sequence[Evidence], design: Design, wanted: BoolArray
) -> tuple[BoolArray, FloatArray]:
    """Return which scatters there is freedom to find, and how much of it tells each."""
    rows = np.zeros(len(wanted))
    owner: dict[int, int] = {}
    for one in evidence:
        np.add.at(rows, one.group, 1.0)
        for row, group in zip(one.H, one.group, strict=True):
            # A row of a session is of one coefficient; one of a ramp is led by its own constant.
            owner.setdefault(int(np.flatnonzero(row)[-1]), int(group))
    for coefficient in design.coefficient:
        if int(coefficient) in owner:
            rows[owner[int(coefficient)]] -= 1.0
    free = wanted & (rows > 0)
    return free, np.where(free, rows, np.inf)
