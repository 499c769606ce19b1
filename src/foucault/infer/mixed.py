"""One estimator for every calibration from means and turns: a mixed model, linearised.

A session says ``y = h(x) + sum_s sd_s B_s u_s`` with independent u_s of unit variance. x are the
coefficients and what is a nuisance (mounting, attitudes). Each *source* of error has a name, what
one standard deviation of each of its causes does to every reading (B_s), and a size sd_s that is
known or is found from the residuals. Noise, placement, an unknown heading, the jitter of a table,
repeatability: all are sources, and from the list of them everything follows that a procedure says::

    fit             Gauss-Newton on the white residuals L^-1 (y - h), L L' = sum_s sd_s^2 B_s B_s'
    repeatability   restricted maximum likelihood of the sizes that nobody declared [1]
    budget          P_s = sd_s^2 A B_s B_s' A' with the gain A = P J' (L L')^-1
    bound           the covariance with the sources that are noise of the sensors alone
    components      sum of squares of each kind of reading, against its redundancy
    held_out        readings predicted from the others, without solving again [2]
    without         the same, with sizes that were found without them
    foreseen        the covariance of a session that was only planned
    planned         the whole fit of such a session, its budget and bound
    drawn           errors of the readings for one trial of a Monte Carlo study

A variance that is found from v degrees of freedom counts as ``v / (v - 2)`` times as large: errors
over it have Student's distribution, whose variance that is. What is there for certain counts at the
mean of its variance, which is the same where nothing hides it, and not nothing where others do.

References
----------
.. [1] H. D. Patterson, R. Thompson, "Recovery of inter-block information when block sizes are
   unequal", Biometrika 58(3), 1971; D. A. Harville, JASA 72, 1977.
.. [2] W. Baarda, "A testing procedure for use in geodetic networks", 1968.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import Status, error
from foucault.infer import gauss_newton
from foucault.infer.gauss_newton import FALSE_ALARM, TOLD, Component, chi_square_limits, student
from foucault.kernels.small_matrices import decorrelate
from foucault.result import Estimate, Linearised, Problem

SIGNIFICANT = 5.4
"""Twice the log-likelihood that a source gains by chance in 1 % of all sessions at most: its size
cannot be negative, so that half of them find none at all [1]."""

FEW = 0.25
"""Outliers up to this share of a kind are single mishaps; more of them are repeatability [1]."""

SETTLED = 1e-3  # A variance that changes by less than this share has settled [1].
NEARLY = 2.0  # A mean square of residuals that is not far from that of the noise [1].
LEAST = 1e-13  # Least variance of a reading for itself, as a part of its whole variance [1].

MANY = 8
"""Numbers read for each cause that they share, above which rows are whitened cause by cause [1]."""

SEEN = 0.01
"""A direction of a reading of which less than this share is redundant is not predicted [1]."""


NOISE_BASIS = {
    "declared": ("B", "noise as declared in the campaign"),
    "measured": ("A", "scatter of the samples within the readings"),
    "unknown": ("A", "scatter of the residuals"),
}
"""Where a noise is from -> type and basis of its sources."""

UNEXPLAINED_BASIS = ("A", "scatter of the residuals beyond the noise")
"""Type and basis of what is found from the residuals."""


@dataclass(frozen=True)
class Source:
    """A named cause of error: what one standard deviation of it does to every reading."""

    name: str  # as in the budget; sources of one name are one row of it and have one size
    # (n, d, c) c causes that every reading has for itself, or None [SI]
    each: FloatArray | None = None
    shared: FloatArray | None = None  # (n, d, k) k causes that readings share, or None [SI]
    sd: float | None = 1.0  # size of the cause, None: to be found [what `each`, `shared` are per]
    noise: bool = False  # noise of the sensors: the bound has nothing else
    # twice the log-likelihood it has to gain to be there, where it is to be found [1]
    price: float = SIGNIFICANT
    # whether it is no cause that anybody names: where it is found, the noise is contradicted
    unexplained: bool = False
    type: str = "B"  # evaluated from the scatter of these data, A, or from other knowledge, B
    basis: str = ""  # what it was evaluated from, for people

    @property
    def certain(self) -> bool:
        """Whether it is there for certain, however small the most likely size may be."""
        return not (self.price or self.noise or self.unexplained)


def scatter(
    name: str, each: FloatArray | None, shared: FloatArray | None = None,
    price: float = SIGNIFICANT,
) -> Source:  # fmt: skip
    """Return what differs beyond the noise, of a size that the residuals tell.

    `each`, `shared`, `price`: as of `Source` [SI], [1].
    """
    kind, basis = UNEXPLAINED_BASIS
    return Source(name, each, shared, None, price=price, unexplained=True, type=kind, basis=basis)


def root(cov: FloatArray) -> FloatArray:
    """Return a root of `cov` (..., n, n) [SI]; what hardly changes is nearly one number."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0))[..., None, :])


def tied(effect: FloatArray, by: FloatArray) -> FloatArray:
    """Return what causes do that readings share, shape (n, d, k c) [SI].

    `effect` (n, d, c): of a cause on each reading [SI]; `by` (n, k): root of their covariance.
    """
    every = np.einsum("ndc,nk->ndkc", effect, by)
    return np.asarray(every.reshape(*effect.shape[:2], -1))


@dataclass(frozen=True)
class Linearisation:
    """A model linearised at a state, before whitening."""

    residuals: FloatArray  # (n, d) readings minus prediction [SI]
    # (n, d, m) derivative of the prediction: coefficients, then nuisance parameters [SI]
    jacobian: FloatArray
    sources: tuple[Source, ...]  # at this state
    # (k,) and (k, m): white rows of what is known of nuisance parameters beforehand [1]
    known: tuple[FloatArray, FloatArray] | None = None
    # (k,) the source that each of these rows is in the budget; () for the prior
    known_from: tuple[str, ...] = ()


class Model(Protocol):
    """What a procedure states, and all that it states."""

    @property
    def layout(self) -> Layout:
        """The coefficients, the first columns of every Jacobian."""
        ...

    @property
    def start(self) -> Any:
        """State to start from."""
        ...

    @property
    def kinds(self) -> Mapping[str, BoolArray]:
        """Kind of reading -> which components of which readings, shape (n, d) each."""
        ...

    def linearise(self, state: Any) -> Linearisation:
        """Compare the readings with the model at `state`."""
        ...

    def retract(self, state: Any, step: FloatArray) -> Any:
        """Apply `step` (m,) to a state [SI]."""
        ...

    def values(self, state: Any) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        ...


AModel = TypeVar("AModel", bound=Model)


class Covariance:
    """The covariance of all readings by sources of given sizes."""

    def __init__(
        self,
        sources: Iterable[Source],
        sds: Mapping[str, float],
        shape: tuple[int, int],
        weights: FloatArray,
    ) -> None:
        """Add up sources of sizes `sds` [SI], readings of `shape` counting `weights` (n,) [1]."""
        n, d = shape
        self.weights = weights
        self.own: FloatArray = np.zeros((n, d, d))
        shared = [np.zeros((n * d, 0))]
        for source, sd in ((s, size_of(s, sds)) for s in sources):
            if source.each is not None and sd:
                self.own += sd**2 * source.each @ np.swapaxes(source.each, 1, 2)
            if source.shared is not None and sd and source.shared.size:
                shared.append(sd * source.shared.reshape(n * d, -1))
        self.shared: FloatArray = np.concatenate(shared, axis=1)
        # What every reading has for itself keeps an inverse, also where there is no noise, and
        # where what readings share is so much larger that rounding would hide it.
        tied = np.sum(self.shared.reshape(n, -1) ** 2, axis=1)
        least = LEAST * np.maximum(np.trace(self.own, axis1=1, axis2=2), tied)
        self.own = (self.own + least[:, None, None] * np.eye(d)) / weights[:, None, None]

    @cached_property
    def whole(self) -> FloatArray:
        """The covariance of all components, shape (n d, n d) [SI]."""
        return self.shared @ self.shared.T + _on_diagonal(self.own)

    @cached_property
    def inverse(self) -> FloatArray:
        """The inverse of the whole covariance, shape (n d, n d) [1 / SI].

        Of few causes B, ``W - W B (I + B' W B)^-1 B' W`` with W what readings have for themselves.
        """
        (n, d, _), k = self.own.shape, self.shared.shape[1]
        if MANY * k > n * d:
            return np.asarray(np.linalg.inv(self.whole))
        own = np.asarray(np.linalg.inv(self.own), float)
        pull = (own @ self.shared.reshape(n, d, k)).reshape(n * d, k)
        inner = np.eye(k) + self.shared.T @ pull
        return _on_diagonal(own) - pull @ np.linalg.solve(inner, pull.T)

    @cached_property
    def _root(self) -> FloatArray:
        return np.asarray(np.linalg.cholesky(self.whole))

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Return L^-1 times `rows` (n, d, k) [SI], as shape (n d, k)."""
        from scipy.linalg import solve_triangular

        n, d, k = rows.shape
        if MANY * self.shared.shape[1] > n * d:
            return np.asarray(solve_triangular(self._root, rows.reshape(n * d, k), lower=True))
        both = np.concatenate([self.shared.reshape(n, d, -1), rows], axis=2)
        white = np.linalg.solve(np.linalg.cholesky(self.own), both).reshape(n * d, -1)
        shared, white = white[:, :-k], np.ascontiguousarray(white[:, -k:])
        if shared.size:
            decorrelate(np.ascontiguousarray(shared), white)
        return white

    def solve(self, rows: FloatArray) -> FloatArray:
        """Return C^-1 times `rows` (n, d, k) [SI], as shape (n d, k)."""
        from scipy.linalg import cho_solve

        n, d, k = rows.shape
        if not self.shared.size:
            return np.asarray(np.linalg.solve(self.own, rows)).reshape(n * d, k)
        return np.asarray(cho_solve((self._root, True), rows.reshape(n * d, k)))


def _on_diagonal(blocks: FloatArray) -> FloatArray:
    """Return a matrix (n d, n d) of `blocks` (n, d, d)."""
    n, d, _ = blocks.shape
    at = d * np.arange(n)[:, None, None] + np.arange(d)[:, None]
    out = np.zeros((n * d, n * d))
    out[at, np.swapaxes(at, 1, 2)] = blocks
    return out


def size_of(source: Source, sds: Mapping[str, float]) -> float:
    """Return the size of a source: as in `sds` [SI], else as stated, 0 where it is to be found."""
    return sds.get(source.name, source.sd or 0.0)


def columns(source: Source) -> Iterable[FloatArray]:
    """Yield what the causes of a source do to all readings, (n, d, k) each."""
    if source.shared is not None:
        yield source.shared
    if source.each is not None:
        n, d, _ = source.each.shape
        one = np.einsum("iac,ij->iajc", source.each, np.eye(n)).reshape(n, d, -1)
        yield one[:, :, one.any(axis=(0, 1))]


class _Once:
    """A model that remembers its last linearisation: weights and sizes change more often."""

    def __init__(self, model: Model, *last: Any) -> None:
        self._model, self._last = model, cast("tuple[Any, Linearisation]", last or (None, None))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def linearise(self, state: Any) -> Linearisation:
        if self._last[0] is not state:
            at = self._model.linearise(state)
            found = {s.name for s in at.sources if s.sd is None}
            both = {s.name for s in at.sources if s.sd is not None} & found
            if both:  # the size that is found would be put to all of its causes
                raise error("solution.two_sizes", name=min(both))
            self._last = state, at
        return self._last[1]


def stated(
    model: Model,
    sds: Mapping[str, float] | None = None,
    prior: CoefficientVector | None = None,
    *,
    noise_alone: bool = False,
) -> Problem:
    """State a model with sources of given sizes as a least-squares problem.

    `sds`: source -> size [SI]; `prior` or None: what is known of the coefficients [SI];
    `noise_alone`: leave all sources out that are not noise of the sensors.
    """
    sds, once = sds or {}, model if isinstance(model, _Once) else _Once(model)

    def linearise(state: Any, weights: FloatArray) -> Linearised:
        at = once.linearise(state)
        n, d = at.residuals.shape
        some = [s for s in at.sources if s.noise or not noise_alone]
        both = np.concatenate([at.jacobian, at.residuals[:, :, None]], axis=2)
        white = Covariance(some, sds, (n, d), weights).whiten(both)
        J, r, blocks = white[:, :-1], white[:, -1], np.repeat(np.arange(n), d)
        if at.known is not None:
            r, J = np.append(r, at.known[0]), np.concatenate([J, at.known[1]])
            blocks = np.append(blocks, np.full(len(at.known[0]), -1))
        return Linearised(r, J, blocks)

    size = len(next(iter(model.kinds.values())))
    return Problem(model.layout, model.start, linearise, model.retract, model.values, size, prior)


@dataclass(frozen=True)
class Fit:
    """A model solved: everything that checks, budget and report need."""

    model: Model
    problem: Problem  # that was solved, with its prior
    estimate: Estimate
    at: Linearisation  # the model at the solution
    white: Linearised  # the same made white, with the rows of the prior
    # sds, found: source -> size that was used, and the most likely one, of those to be found [SI]
    sds: Mapping[str, float]
    found: Mapping[str, float] = field(default_factory=dict)
    dof: Mapping[str, float] = field(default_factory=dict)  # degrees of freedom of these [1]
    # before, after: fit of each kind without what is unexplained, and with it
    before: Mapping[str, Component] = field(default_factory=dict)
    after: Mapping[str, Component] = field(default_factory=dict)

    @property
    def state(self) -> Any:
        """The full state at the solution."""
        return self.estimate.state

    @property
    def outliers(self) -> IntArray:
        """The readings that were left out."""
        return np.flatnonzero(self.estimate.weights < 0.5)

    @cached_property
    def covariance(self) -> Covariance:
        """Covariance of the readings as it was used."""
        return Covariance(self.at.sources, self.sds, self.at.residuals.shape, self.estimate.weights)

    @cached_property
    def own(self) -> tuple[FloatArray, FloatArray]:
        """White residuals that no shared cause explains, and their redundancy, (n d,) each [1]."""
        return own_part(self.at, self.covariance, self.estimate)

    @cached_property
    def gain(self) -> FloatArray:
        """What one unit of each component does to the coefficients, shape (p, n d)."""
        P = self.estimate.state_cov[: len(self.model.layout)]
        return np.asarray(P @ self.covariance.solve(self.at.jacobian).T)


def solve(
    model: Model,
    sds: Mapping[str, float] | None = None,
    weights: FloatArray | None = None,
    near: Any = None,
) -> Fit:
    """Solve with sources of given sizes, and with readings that are left out beforehand.

    `sds`: source -> size, those to be found are nothing where it is not given [SI]; `weights`
    (n,): what a reading counts, None for 1 [1]; `near`: state to start from, None for the model's.
    """
    sds = {} if sds is None else sds
    problem = stated(model, sds)
    problem = problem if near is None else replace(problem, start=near)
    weights = np.ones(problem.n_blocks) if weights is None else weights
    estimate = gauss_newton.solve(
        problem, loss=partial(gauss_newton.held, weights), weights=weights
    )
    return _fit_of(model, problem, estimate, sds)


def fit(
    model: Model,
    prior: CoefficientVector | None = None,
    *,
    robust: bool = False,
    few: float = FEW,
    near: Fit | None = None,
    own: bool = False,
) -> Fit:
    """Solve; find the sizes of sources that nobody declared; leave out readings that are far off.

    A prior comes last, when sizes and outliers are settled: they would take up what contradicts
    it, and the more wrong a prior, the more surely it would be believed.

    `prior` or None: what is known of the coefficients [SI]; `robust`: leave out readings beyond
    `gauss_newton.ROBUST_LIMIT`, unless a larger share than `few` of their kind are: that is
    repeatability [1]; `near` or None: a solution whose outliers are settled, and which is near;
    `own`: judge kinds of reading by what no shared cause explains, where each of these is tested.
    """
    stating, model = model, cast("Model", _Once(model))
    loss = gauss_newton.huber if robust else gauss_newton.least_squares
    begin, silent = _first_sizes(model)
    first = near.estimate if near else gauss_newton.solve(stated(model, begin), loss=loss)
    # What readings do not determine by themselves is solved with the prior from the beginning.
    carried = prior if first.status is Status.UNOBSERVABLE else None
    if carried is not None:
        first = gauss_newton.solve(stated(model, begin, carried), loss=loss)
    estimate = first
    weights = _outliers(model, begin, estimate, few) if robust else estimate.weights
    known = dict(near.sds) if near else begin
    sds, found, dof = known, begin, begin  # `sds`: those that `estimate` was solved with
    for _ in range(4 if begin or robust else 0):
        found, dof = repeatability(model, estimate.state, weights)
        if found != sds or not np.array_equal(weights, estimate.weights):
            estimate, sds = _solved(model, found, estimate, weights, carried), found
        kept, weights = weights, _outliers(model, found, estimate, few) if robust else weights
        if np.array_equal(kept, weights):
            break
        estimate = _solved(model, found, estimate, weights, carried)
    after = before = components(model, estimate, sds if own else None)
    sources = model.linearise(estimate.state).sources
    alone = {s.name: 0.0 for s in sources if s.unexplained and found.get(s.name)}
    if alone and not silent:
        # Where nothing else was found either, that is what was solved first.
        same = np.array_equal(first.weights, weights)
        same &= not any(known.values()) and not any((found | alone).values())
        bare = first if same else _solved(model, found | alone, estimate, weights, carried)
        before = components(model, bare, found | alone if own else None)
    wide = as_uncertain(model.linearise(estimate.state), found, dof, weights)
    estimate = _solved(model, wide, estimate, weights, carried) if wide != sds else estimate
    whole = _fit_of(model, stated(model, wide, carried), estimate, wide)
    whole = replace(whole, model=stating, found=found, dof=dof, before=before, after=after)
    return whole if carried is not None else with_prior(whole, prior)


def with_prior(at: Fit, prior: CoefficientVector | None) -> Fit:
    """Add a `prior` [SI] to a solution whose sizes and outliers are settled."""
    if prior is None:
        return at
    problem, estimate = stated(at.model, at.sds, prior), at.estimate
    if np.isfinite(prior.prior_sd).any():
        estimate = gauss_newton.add_prior(problem, estimate)
    now = _fit_of(at.model, problem, estimate, at.sds)
    return replace(now, found=at.found, dof=at.dof, before=at.before, after=at.after)


def _first_sizes(model: Model) -> tuple[dict[str, float], bool]:
    """Return what sources of unknown size begin with: nothing, but where nothing else is known.

    Noise that nobody knows begins with what the start leaves: without it what else a reading has
    for itself, such as the jitter of a rate, would stand for all of its noise. Returns also whether
    readings have no error of a known size for themselves.
    """
    at = model.linearise(model.start)
    names = sorted({s.name for s in at.sources if s.sd is None})
    silent = bool(_silent(at, names).any())
    begin = dict.fromkeys(names, 1.0 if silent else 0.0)
    if any(s.noise for s in at.sources if s.sd is None):
        found, _ = repeatability(model, model.start, np.ones(len(at.residuals)))
        begin = {name: found[name] or begin[name] for name in names}
    return begin, silent


def _silent(at: Linearisation, free: Iterable[str]) -> BoolArray:
    """Tell which readings have no error of a known size for themselves, shape (n,)."""
    n, d, _ = at.jacobian.shape
    known = Covariance([s for s in at.sources if s.name not in free], {}, (n, d), np.ones(n))
    return np.asarray(np.trace(known.own, axis1=1, axis2=2) <= 0)


def _fit_of(model: Model, problem: Problem, estimate: Estimate, sds: Mapping[str, float]) -> Fit:
    white = problem.linearise(estimate.state, estimate.weights)
    white = gauss_newton.with_prior(problem, estimate.state, white)
    now = components(model, estimate)
    at = model.linearise(estimate.state)
    return Fit(model, problem, estimate, at, white, sds, before=now, after=now)


def _solved(
    model: Model,
    sds: Mapping[str, float],
    near: Estimate,
    weights: FloatArray,
    prior: CoefficientVector | None,
) -> Estimate:
    problem = replace(stated(model, sds, prior), start=near.state)
    held = partial(gauss_newton.held, weights)
    return gauss_newton.solve(problem, loss=held, weights=weights)


def _outliers(model: Model, sds: Mapping[str, float], estimate: Estimate, few: float) -> FloatArray:
    """Return weights that leave out what is far off, unless so much is that it is no outlier."""
    at = model.linearise(estimate.state)
    n, d = at.residuals.shape
    weights, scatters = np.ones(n), np.zeros(n, bool)
    while True:
        covariance = Covariance(at.sources, sds, (n, d), weights)
        far = norms(at, covariance) * ((weights > 0.5) & ~scatters)
        out = far > gauss_newton.ROBUST_LIMIT
        if covariance.shared.size:  # a reading that is wrong makes those look wrong that it shares
            out &= far == far.max()
        if not out.any():
            return weights
        weights[out] = gauss_newton.LEFT_OUT
        for rows in model.kinds.values():
            mine = rows.any(axis=1)
            if np.sum(weights[mine] < 0.5) > few * mine.sum():
                weights[mine], scatters[mine] = 1.0, True


def norms(at: Linearisation, covariance: Covariance) -> FloatArray:
    """Return how far each reading is from what the others say, as its sd, rms of its components.

    ``(C^-1)_kk^-1 (C^-1 r)_k`` is what the others leave of the residual of reading k, and its
    covariance is ``(C^-1)_kk^-1``. Where readings share errors that are larger than their noise,
    L^-1 r blames the second one for what is wrong with the first.

    Returns (n,): with the weight of each reading undone [1].
    """
    n, d = at.residuals.shape
    if not covariance.shared.size:
        left, cov = at.residuals, np.asarray(covariance.own)
    else:
        inverse = covariance.inverse
        cov = np.asarray(np.linalg.inv(inverse.reshape(n, d, n, d)[np.arange(n), :, np.arange(n)]))
        left = np.einsum("nij,nj->ni", cov, (inverse @ at.residuals.ravel()).reshape(n, d))
    cov = cov - (1 - covariance.weights)[:, None, None] * covariance.own
    square = np.einsum("ni,ni->n", left, np.linalg.solve(cov, left[:, :, None])[:, :, 0])
    return np.asarray(np.sqrt(square / d))


def repeatability(
    model: Model, state: Any, weights: FloatArray
) -> tuple[dict[str, float], dict[str, float]]:
    """Find the sizes of sources that nobody declared by restricted maximum likelihood.

    Of the readings only the contrasts count that no unknown explains; what they say of the sizes
    does not hang on the estimate.

    The degrees of freedom of a variance v are ``v tr(S V)``, the contrasts, each by the share that
    the source has in its variance. As a share s of the whole v has a relative error of
    ``sqrt(2 / n) / s``; the whole has one of ``sqrt(2 / n)``, and Student's factor on v makes up
    for that.

    `state`: near the solution; `weights` (n,): what a reading counts [1]. Returns source -> size,
    0 where it does not gain its price, and source -> degrees of freedom that it was found from.
    """
    found, dof, _ = _sizes(model, state, weights)
    return found, dof


def as_uncertain(
    at: Linearisation, found: Mapping[str, float], dof: Mapping[str, float], weights: FloatArray,
    *, read: bool = True,
) -> dict[str, float]:  # fmt: skip
    """Return the sizes that errors are stated with: the mean of each variance, as it is uncertain.

    `found`: source -> most likely size [SI]; `dof`: degrees of freedom of each [1]; `weights` (n,):
    what a reading counts [1]; `read`: False where nothing was, but will be with these sizes.
    """
    wide = {name: sd * student(dof[name]) for name, sd in found.items()}
    there = {s.name for s in at.sources if s.sd is None and s.certain}
    if there:
        left, r, V = _contrasts(at, {s.name: s.price for s in at.sources if s.sd is None}, weights)
        var = {name: found.get(name, 0.0) ** 2 for name in V}
        z = left @ r if read else None
        wide |= {name: float(np.sqrt(mean_variance(name, V, var, z))) for name in there}
    return wide


def mean_variance(
    name: str, V: Mapping[str, FloatArray], var: Mapping[str, float], z: FloatArray | None
) -> float:
    """Return the mean of a variance, of what is there for certain and may hide behind others.

    See `means`. `V`: source -> covariance of the contrasts by it [1]; `var`: variance of each [SI],
    of the others as large as they are beside it; `z` (q,): the contrasts, None for those of a plan,
    of these variances [1].
    """
    from scipy.linalg import solve_triangular

    root = _root(V[name], V, {n: v for n, v in var.items() if n != name})
    half = solve_triangular(root, V[name], lower=True)
    size, axes = np.linalg.eigh(solve_triangular(root, half.T, lower=True))
    square = 1 + var[name] * size
    if z is not None:
        square = (axes.T @ solve_triangular(root, z, lower=True)) ** 2
    return float(means(size, square[None])[0])


def means(size: FloatArray, square: FloatArray) -> FloatArray:
    """Return the mean of a variance v in each of many trials, (b,).

    Of independent contrasts of variance ``1 + v size``, under Jeffreys' prior, the root of its
    information. Where nothing hides it, that is its most likely value times Student's
    ``v / (v - 2)``; fewer contrasts than `TOLD` are taken for as many, as `student` takes them.

    `size` (k,): what one unit of v makes of the variance of each contrast, none where it is not
    seen; `square` (b, k): their squares [1].
    """
    told = size > UNTOLD * size.max(initial=0.0)
    if not told.any():
        return np.zeros(len(square))
    size, square = size[told], square[:, told]
    v = np.geomspace(1e-3 / size.max(), 1e14 / size.min(), 500)
    more = 1 + v[:, None] * size
    unlikely = square @ (1 / more).T + np.sum(np.log(more), axis=1)
    weight = np.exp((unlikely.min(axis=1, keepdims=True) - unlikely)
                    * max(1.0, TOLD / np.sum(size > STRONG * size.max())) / 2)  # fmt: skip
    weight *= v * np.sqrt(np.sum((size / more) ** 2, axis=1))
    return np.asarray(weight @ v / weight.sum(axis=1))


UNTOLD, STRONG = 1e-9, 1e-4
"""Contrasts that show a size by less than these shares of what the best does tell nothing of it,
and are not counted among those that tell it [1]."""


def likeliest(models: Sequence[AModel], state: Any, weights: FloatArray) -> AModel:
    """Choose the most likely of models that differ in what a source of unknown size does.

    By the restricted likelihood of each, with the sizes that make it largest, every source at its
    price.

    `state`: near the solution; `weights` (n,): what a reading counts [1].
    """
    return min(models, key=lambda model: _sizes(model, state, weights)[2])


def _sizes(
    model: Model, state: Any, weights: FloatArray
) -> tuple[dict[str, float], dict[str, float], float]:
    """Return sizes, their degrees of freedom, and how unlikely the contrasts are with them."""
    at = model.linearise(state)
    free = {s.name: s.price for s in at.sources if s.sd is None}
    none = dict.fromkeys(free, 0.0)
    if not free:
        return none, none, 0.0
    left, r, V = _contrasts(at, free, weights)
    z = left @ r
    return priced(z, V, free) if len(z) else (none, none, 0.0)


def priced(
    z: FloatArray, V: Mapping[str, FloatArray], prices: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float], float]:
    """Return sizes, their degrees of freedom, and how unlikely the contrasts are with them.

    `z` (q,): contrasts that no unknown explains, white by what is known [1]; `V` (q, q): their
    covariance by each source whose size is to be found [1]; `prices`: what each has to gain [1].
    """
    none = dict.fromkeys(prices, 0.0)
    kept, (var, now) = dict(prices), _most_likely(z, V)
    while True:  # one that does not gain its price gives what it explained back to the others
        kept = {name: price for name, price in kept.items() if var[name] or not price}
        best = {
            name: _most_likely(z, {n: V[n] for n in kept if n != name}, now + price)
            for name, price in kept.items()
            if price
        }
        worst = min(best, key=lambda name: best[name][1] - kept[name], default=None)
        if worst is None or best[worst][1] - kept[worst] >= now:
            break
        var, now = best[worst]
        del kept[worst]
    var = {name: var[name] for name in kept}
    root = _root(z, V, var)
    S = _inverse(root)
    dof = {n: v * float(np.sum(S * V[n])) for n, v in var.items()}
    found = none | {n: float(np.sqrt(v)) for n, v in var.items()}
    return found, none | dof, _unlikely(z, root) + sum(kept.values())


def _contrasts(
    at: Linearisation, free: Mapping[str, float], weights: FloatArray
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Return rows that no unknown explains (q, N), what they are rows of, and covariances.

    Of the readings, white by what is known (N,), they leave contrasts (q,), in axes that hang on
    the arithmetic; their covariance by each source is (q, q).

    Where nothing is known of the noise it is a thousandth of the residuals, which are to be told
    from what readings share.
    """
    n, d, _ = at.jacobian.shape
    silent, little = _silent(at, free) & (weights > 0.5), dict.fromkeys(free, 0.0)
    for s in at.sources:
        if s.name in free and s.each is not None and s.each[silent].any():
            ratio = np.linalg.norm(at.residuals[silent]) / np.linalg.norm(s.each[silent])
            little[s.name] = max(little[s.name], 1e-3 * float(ratio), 1e-9)
    known = Covariance(at.sources, little, (n, d), weights)
    left, r = contrasts(known, at, at.residuals)
    V = {}
    for name in free:
        parts = []
        for source in (s for s in at.sources if s.name == name):
            if source.each is not None:
                # What is left out has all of its own variance larger, found or known.
                own = source.each / np.sqrt(weights)[:, None, None]
                one = np.einsum("iac,ij->iajc", own, np.eye(n)).reshape(n, d, -1)
                parts.append(known.whiten(one[:, :, one.any(axis=(0, 1))]))
            if source.shared is not None:
                parts.append(known.whiten(source.shared))
        rows = left[:, : n * d] @ np.concatenate(parts, axis=1)
        V[name] = rows @ rows.T
    return left, r, V


def contrasts(
    covariance: Covariance, at: Linearisation, residuals: FloatArray, kept: Any = slice(None)
) -> tuple[FloatArray, FloatArray]:
    """Return rows (k, m) that no column `kept` explains; and `residuals` (n, d), white (m,) [1]."""
    from scipy.linalg import qr

    J, r = covariance.whiten(at.jacobian), covariance.whiten(residuals[:, :, None])[:, 0]
    if at.known is not None:
        J, r = np.concatenate([J, at.known[1]]), np.append(r, at.known[0])
    J = J[:, kept]
    size = np.linalg.norm(J, axis=0)
    Q, R, _ = qr(J[:, size > 0] / size[size > 0], pivoting=True, check_finite=False)
    rank = int(np.sum(np.abs(np.diag(R)) > 1e-10 * np.abs(R).max(initial=0.0)))
    return Q[:, rank:].T, r


def _root(z: FloatArray, V: Mapping[str, FloatArray], var: Mapping[str, float]) -> FloatArray:
    """Return the Cholesky factor of the covariance of the contrasts, shape (k, k) [1]."""
    total = np.eye(len(z)) + sum(v * V[n] for n, v in var.items())
    least = LEAST * np.trace(total)  # without any noise what is found is all there is
    return np.asarray(np.linalg.cholesky(total + least * np.eye(len(z))))


def _inverse(root: FloatArray) -> FloatArray:
    """Return the inverse of ``root root'``, shape (k, k)."""
    from scipy.linalg.lapack import dpotri

    lower = np.tril(dpotri(root, lower=1)[0])
    return np.asarray(lower + np.tril(lower, -1).T)


def _unlikely(z: FloatArray, root: FloatArray) -> float:
    """Twice the negative restricted log-likelihood, but for a constant."""
    from scipy.linalg import solve_triangular

    white = solve_triangular(root, z, lower=True, check_finite=False)
    return float(white @ white + 2 * np.sum(np.log(np.diag(root))))


def _most_likely(
    z: FloatArray, V: Mapping[str, FloatArray], below: float = np.inf
) -> tuple[dict[str, float], float]:
    """Return the variances that are most likely: z' S V S z = tr(S V) for each, or none at all.

    Fisher scoring, held above zero; each step is halved until the likelihood does not fall. The
    mean of observed and expected information is found faster, and stops far from the end where
    variances are to fall by orders of magnitude.

    `below`: what only counts if it is more likely than that; where the steps that are left cannot
    make it so, they are not gone [1]. Returns how unlikely it is, too.
    """
    if not V:
        return {}, _unlikely(z, _root(z, V, {}))
    unit = {n: len(z) / max(float(np.trace(v)), 1e-300) for n, v in V.items()}
    # Each begins as large as what it reaches; where the known noise nearly explains that, nothing
    # is the better start.
    size = {n: float(z @ V[n] @ z) * u / len(z) for n, u in unit.items()}
    var = {n: size[n] * u if size[n] > NEARLY else 0.0 for n, u in unit.items()}
    root = _root(z, V, var)
    now = _unlikely(z, root)
    for _ in range(100):
        S = _inverse(root)
        q = S @ z
        score = np.array([q @ v @ q - np.sum(S * v) for v in V.values()])
        # What is at its bound, and would go below, stays there.
        held = np.array([v <= 0 for v in var.values()], bool) & (score < 0)
        step = np.zeros(len(V))
        if not held.all():
            SV = [S @ v for v, stays in zip(V.values(), held, strict=True) if not stays]
            info = np.array([[np.sum(a * b.T) for b in SV] for a in SV])
            step[~held] = np.linalg.lstsq(info, score[~held], rcond=None)[0]
        if now - HOPELESS * float(score @ step) > below:
            break
        share = 1.0
        for _ in range(12):
            new = {n: max(v + share * s, 0.0) for (n, v), s in zip(var.items(), step, strict=True)}
            root = _root(z, V, new)
            there = _unlikely(z, root)
            if there <= now + 1e-9:
                break
            share /= 2
        moved = max((abs(new[n] - var[n]) / (var[n] + 1e-6 * unit[n]) for n in V), default=0.0)
        var, now = new, there
        if moved < SETTLED:
            break
    var = {n: v if v > 1e-6 * unit[n] else 0.0 for n, v in var.items()}
    return var, _unlikely(z, _root(z, V, var))


HOPELESS = 5.0
"""A step gains half of score times step; all that follow gain no such multiple of that [1]."""


# -- what follows from a fit, for every procedure alike --------------------------------------


def own_part(
    at: Linearisation, covariance: Covariance, estimate: Estimate
) -> tuple[FloatArray, FloatArray]:
    """Return what of each component no cause explains that readings share, and its redundancy.

    Of ``C = D + B B'``, D what readings have for themselves, that is ``D P r`` with ``D P D`` for
    its covariance, P what no unknown explains; white ``D^-1/2`` of it. L^-1 r puts all of a shared
    cause into the reading that comes first, and were it smaller than its size, that would look
    too quiet beside the others.

    Returns white residuals and redundancies, shape (n d,) each [1].
    """
    n, d, m = at.jacobian.shape
    root = np.swapaxes(np.linalg.cholesky(covariance.own), 1, 2)
    inverse = covariance.inverse
    blocks = inverse.reshape(n, d, n, d)[np.arange(n), :, np.arange(n)]
    white = (root @ (inverse @ at.residuals.ravel()).reshape(n, d, 1)).ravel()
    pull = (root @ (inverse @ at.jacobian.reshape(n * d, m)).reshape(n, d, m)).reshape(n * d, m)
    known = np.einsum("ij,jk,ik->i", pull, estimate.state_cov, pull)
    whole = np.einsum("nij,njk,nik->ni", root, blocks, root).ravel()
    return white, np.maximum(whole - known, 0.0)


def components(
    model: Model, estimate: Estimate, sds: Mapping[str, float] | None = None
) -> dict[str, Component]:
    """Judge every kind of a solution, at one false-alarm rate; what was left out does not count.

    `sds` or None: judge what readings have for themselves beside causes of these sizes, each of
    which is tested by itself [SI].
    """
    used = estimate.blocks >= 0
    if sds is None:
        residuals, free = estimate.residuals[used], 1 - estimate.leverage[used]
    else:
        at = model.linearise(estimate.state)
        shape = at.residuals.shape
        covariance = Covariance(at.sources, sds, (shape[0], shape[1]), estimate.weights)
        residuals, free = own_part(at, covariance, estimate)
    kept = estimate.weights[estimate.blocks[used]] > 0.5
    rows = {k: mine.ravel() & kept for k, mine in model.kinds.items() if mine.any()}
    out = {}
    for kind, mine in rows.items():
        redundancy = float(np.sum(free[mine]))
        low, high = chi_square_limits(max(redundancy, 1e-3), tests=len(rows))
        out[kind] = Component(float(np.sum(residuals[mine] ** 2)), redundancy, low, high)
    return out


def budget(at: Fit, gain: FloatArray | None = None) -> dict[str, FloatArray]:
    """Return the variance of every coefficient by source; what is left came from the prior [GUM].

    `gain` (p, n d): of another estimate from the same readings, None: of the fit. Returns source
    -> variances, shape (p,) [SI]; what is nothing is left out.
    """
    n, d = at.at.residuals.shape
    other, gain = gain is not None, (at.gain if gain is None else gain).reshape(-1, n, d)
    out: dict[str, FloatArray] = {}
    for source in at.at.sources:
        sd = size_of(source, at.sds)
        part = np.zeros(len(gain))
        if source.each is not None:
            part += sd**2 * np.sum(np.einsum("pnd,ndc->pnc", gain, source.each) ** 2, axis=(1, 2))
        if source.shared is not None:
            part += sd**2 * np.sum(np.einsum("pnd,ndk->pk", gain, source.shared) ** 2, axis=1)
        out[source.name] = out.get(source.name, np.zeros(len(gain))) + part
    if at.at.known is not None and not other:
        rows = (at.estimate.state_cov[: len(gain)] @ at.at.known[1].T) ** 2
        for name, column in zip(at.at.known_from, rows.T, strict=False):
            out[name] = out.get(name, np.zeros(len(gain))) + column
    explained = np.sum(list(out.values()), axis=0)
    total = explained if other else np.diag(at.estimate.state_cov)[: len(gain)]
    if at.at.known is not None or np.isfinite(at.estimate.coefficients.prior_sd).any():
        out["prior"] = np.maximum(total - explained, 0.0)
    return {name: v for name, v in out.items() if (v > 1e-9 * total).any()}


def enlarged(at: Fit, gain: FloatArray | None = None) -> FloatArray:
    """Return by how much every variance is larger than with the most likely sizes, (p,) [SI].

    `gain`: as of `budget` [SI].
    """
    gain = at.gain if gain is None else gain
    likely = replace(at, sds={**at.sds, **at.found})
    wide, small = (
        np.sum([np.zeros(len(gain)), *budget(one, gain).values()], axis=0) for one in (at, likely)
    )
    return np.asarray(wide - small)


def degrees(variance: FloatArray, more: FloatArray) -> FloatArray:
    """Return the degrees of freedom that each variance was found from, infinite where it is known.

    It counts ``v / (v - 2)`` times, see `student`; more than 20,000 are taken for known.

    `variance`, `more` (p,): each, and how much of it is `enlarged` [SI].
    """
    found = more > 1e-4 * variance
    dof = 2 * variance / np.where(found, more, 1.0)
    return np.where(found, np.maximum(dof, TOLD), np.inf)


def causes(at: Fit, name: str) -> FloatArray:
    """Return what the readings say of the causes that they share, ``sd^2 B' C^-1 (y - h)``.

    It is the most likely value of each, shape (k,), drawn towards none as any prior draws.

    `name`: of a source; its sizes count [unit of its sd].
    """
    pull = at.covariance.solve(at.at.residuals[:, :, None])[:, 0]
    shared = [
        size_of(s, at.sds) ** 2 * s.shared.reshape(len(pull), -1)
        for s in at.at.sources if s.name == name and s.shared is not None
    ]  # fmt: skip
    return np.asarray(pull @ np.concatenate(shared, axis=1)) if shared else np.zeros(0)


def bases(at: Fit) -> dict[str, list[str]]:
    """Return type and basis of every source that has one, for result.json."""
    return {s.name: [s.type, s.basis] for s in at.at.sources if s.basis}


def noise_alone(at: Fit) -> Problem:
    """Return the problem whose information is the Cramer-Rao bound: sensor noise, its prior."""
    once = cast("Model", _Once(at.model, at.state, at.at))
    return stated(once, at.sds, at.problem.prior, noise_alone=True)


def without_scatter(at: Fit) -> Problem | None:
    """Return the problem as a plan states it: all that was declared, and no unexplained scatter.

    None where nothing but scatter says how noisy some readings are.
    """
    none = {s.name: 0.0 for s in at.at.sources if s.unexplained}
    if _silent(at.at, none).any():
        return None
    once = cast("Model", _Once(at.model, at.state, at.at))
    return stated(once, {**at.sds, **none})


@dataclass(frozen=True)
class HeldOut:
    """Readings predicted from the others."""

    # error, sd: (n, q) read minus predicted, and the standard deviation of that; NaN where a
    # reading was not left out, NaN and infinite where the others do not determine it [SI]
    error: FloatArray
    sd: FloatArray
    score: float  # sum of squares of the errors, white within each part [1]
    count: int  # how many of them the others determine [1]
    # dof, scale: the score has mean and variance of `scale` times chi-square with `dof` degrees of
    # freedom, because parts share what predicts them [1]
    dof: float
    scale: float
    # scores, counts: (parts,) the same of every part by itself, which is chi-square: the test of
    # one wrong part among right ones [2]
    scores: FloatArray
    counts: IntArray

    @property
    def high(self) -> float:
        """What chance allows of `score`; less than expected is no fault [1]."""
        return self.scale * chi_square_limits(max(self.dof, 1e-3), 2 * FALSE_ALARM)[1]


def held_out(
    at: Fit, parts: Sequence[IntArray], onto: FloatArray | None = None, seen: float = SEEN
) -> HeldOut:
    """Predict readings from all others, part by part, as if they had not been seen.

    With ``W = C^-1 - C^-1 J P J' C^-1``, C the covariance of the readings, what the others leave of
    the readings F is ``e = W_FF^-1 (W r)_F`` and has the covariance ``W_FF^-1`` [2]. Directions
    that the others do not determine do not count.

    `parts`: numbers of the readings that are left out together, each reading once [1]; `onto`
    (n, q, d) or None: what is predicted of each reading, None: all of its components [1]; `seen`:
    least share that is redundant of a direction of a reading [1].
    """
    from scipy.linalg import block_diag

    n, d = at.at.residuals.shape
    q = d if onto is None else onto.shape[1]
    rows = [(d * part[:, None] + np.arange(d)).ravel() for part in parts]
    every = np.concatenate(rows)
    one = np.zeros((n * d, len(every)))
    one[every, np.arange(len(every))] = 1.0
    E = at.covariance.whiten(one.reshape(n, d, -1))
    wide = np.sqrt(np.diag(at.estimate.state_cov))
    wide[wide == 0] = 1.0  # a heading that nobody knows beside biases: each in units of its sd
    values, vectors = np.linalg.eigh(at.estimate.state_cov / np.outer(wide, wide))
    root = wide[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    B = E.T @ at.white.jacobian[: n * d] @ root
    W = E.T @ E - B @ B.T
    v = E.T @ at.white.residuals[: n * d]
    error, sd = np.full((2, n, q), np.nan)
    white, first, counts = [], 0, []
    for part, mine in zip(parts, rows, strict=True):
        own = slice(first, first + len(mine))
        first += len(mine)
        unit = np.sqrt(np.sum(E[:, own] ** 2, axis=0))
        size, axes = np.linalg.eigh(W[own, own] / np.outer(unit, unit))
        told = size > seen
        half = axes[:, told] / np.sqrt(size[told]) / unit[:, None]  # W_FF^-1 = half half'
        P = np.eye(len(mine)) if onto is None else block_diag(*onto[part])
        lost = np.sum((P / unit @ axes[:, ~told]) ** 2, axis=1) > seen * np.sum(
            (P / unit) ** 2, axis=1
        )
        A = P @ half
        error[part] = np.where(lost, np.nan, A @ (half.T @ v[own])).reshape(-1, q)
        sd[part] = np.where(lost, np.inf, np.sqrt(np.sum(A**2, axis=1))).reshape(-1, q)
        if onto is not None:  # the directions that are predicted
            _, s, V = np.linalg.svd(A, full_matrices=False)
            half = half @ V[s > 1e-9 * s.max(initial=0.0)].T
        wide = np.zeros((len(every), half.shape[1]))
        wide[own] = half
        white.append(wide)
        counts.append(half.shape[1])
    A = np.concatenate(white, axis=1)
    z, M = A.T @ v, A.T @ W @ A
    square = float(np.sum(M**2))
    count = len(z)
    where = np.repeat(np.arange(len(parts)), counts)
    return HeldOut(
        error, sd, float(z @ z), count, count**2 / max(square, 1e-300), square / max(count, 1),
        np.array([z[where == k] @ z[where == k] for k in range(len(parts))]), np.array(counts),
    )  # fmt: skip


def without(at: Fit, part: IntArray) -> tuple[HeldOut, float]:
    """Predict readings with sizes that were found without them too.

    A reading that is wrong makes the scatter that it then hides behind.

    `part`: their numbers [1]. Returns the prediction, with sizes as they were found, and the
    degrees of freedom of the one that was found worst; infinite where none was found [1].
    """
    weights = at.estimate.weights.copy()
    weights[part] = gauss_newton.LEFT_OUT
    found, dof = repeatability(at.model, at.state, weights)
    told = min((dof[name] for name, sd in found.items() if sd), default=np.inf)
    return held_out(solve(at.model, found, at.estimate.weights, at.state), [part]), told


def planned(
    model: Model, sds: Mapping[str, float] | None = None, prior: CoefficientVector | None = None
) -> Fit:
    """Return the fit of a session that was only planned: its residuals decide nothing.

    Sizes that they will tell are those of the plan, as uncertain as the redundancy of the plan
    leaves them, as in `fit`.

    `sds` or None: source -> size of those to be found, nothing where it is not given [SI]: what is
    there for certain is stated as it is then, which is not nothing; `prior` or None: what is known
    of the coefficients [SI].
    """
    once, every = cast("Model", _Once(model)), np.ones(len(next(iter(model.kinds.values()))))
    at = once.linearise(model.start)
    free = {s.name: s.price for s in at.sources if s.sd is None}
    var = {name: sd**2 for name, sd in (sds or {}).items() if sd and name in free}
    left, r, V = _contrasts(at, free, every)
    z, dof = left @ r, dict.fromkeys(free, 0.0)
    if var and len(z):
        S = _inverse(_root(z, V, var))
        dof |= {name: v * float(np.sum(S * V[name])) for name, v in var.items()}
    found = {name: float(np.sqrt(v)) for name, v in var.items()}
    wide = by_chance(once) | as_uncertain(at, found, dof, every, read=False)
    problem = stated(once, dict.fromkeys(free, 0.0) | wide, prior)
    estimate = gauss_newton.solve(problem, loss=partial(gauss_newton.held, every), weights=every)
    return replace(_fit_of(once, problem, estimate, wide), model=model, dof=dof)


DRAWS = 40  # Sessions without scatter that are drawn, to see how much of it is found by chance [1].


def by_chance(model: Model) -> dict[str, float]:
    """Return the sizes that scatter is stated with where there is none, rms over sessions.

    One that costs nothing is found by chance in about half of them, and few degrees of freedom
    tell it: see `student`. Returns source -> size [SI].
    """
    at = model.linearise(model.start)
    names = {s.name: 0.0 for s in at.sources if s.sd is None and s.unexplained and not s.price}
    if not names or _silent(at, names).any():
        return {}
    left, r, V = _contrasts(at, names, np.ones(len(at.residuals)))
    mean = dict.fromkeys(names, 0.0)
    if not len(left):  # no reading is redundant
        return mean
    # Of the readings: drawn of the contrasts they would hang on the axes of these.
    for white in np.random.default_rng(0).standard_normal((DRAWS, len(r))):
        found, dof, _ = priced(left @ white, V, names)
        for name, sd in found.items():
            mean[name] += (sd * student(dof[name])) ** 2 / DRAWS
    return {name: float(np.sqrt(v)) for name, v in mean.items()}


def foreseen(
    model: Model, prior: CoefficientVector | None = None, sds: Mapping[str, float] | None = None
) -> Linearised:
    """Return a plan linearised at its start, with a `prior` [SI]: covariance and bound follow.

    `sds` or None: source -> size of those to be found, nothing where it is not given [SI].
    """
    problem = stated(model, sds or {}, prior)
    at = problem.linearise(model.start, np.ones(problem.n_blocks))
    return gauss_newton.with_prior(problem, model.start, at)
