"""Several results of one instrument as one: each counted by its information.

A result x_i with covariance P_i and a prior of mean m_i and standard deviations D_i^1/2 says, by
its data alone,

    J_i = P_i^-1 - D_i^-1                  h_i = P_i^-1 x_i - D_i^-1 m_i

and independent data add up: ``x = (sum J_i)^-1 sum h_i``. A prior is knowledge from before, so that
it counts once: the first result that has a coefficient brings its prior for it. For a linear model
this is the estimate from all data together; for one that is not, as near as its results are to one
another.

An error that results share (local gravity that was given to all at one site) is a parameter of its
own, of unit variance and mean zero: ``x_i = truth + own_i + L_i g``. It stands beside the
coefficients with the covariance -L_i, as g is found to be zero and the error of x is L_i g, and is
one of the coefficients while results are joined. So more sessions at one site do not make it
smaller, those at another do, and what they say of each other's gravity is used.

Do two results agree? Where both say something, U diagonalises both, ``U' (J_1 + J_2) U = I`` and
``U' J_2 U = diag(l)``, and ``z^2 = l (1 - l) (y_1 - y_2)^2`` is chi-square with one degree of
freedom for every combination of coefficients that both know.

References
----------
.. [1] Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
   Navigation*, 2001, section 7.2 (information form), 8.3 (fusion).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout

LEAST = 1e-6
"""Share of the information in a combination below which a result says nothing of it [1]."""

DEPENDENT = 1e-10
"""Relative variance below which a combination of coefficients is fixed by the model [1]."""

FIXED = 1e-8
"""Relative variance of a difference that the model allows no other value, and rounding [1]."""

TIED = 1e-9  # Coefficients whose correlation is this near to 1 or -1 are one [1].
ALL_SHARED = 1e-6  # Part of the variance in a combination of coefficients that is never shared [1].


@dataclass(frozen=True)
class Known:
    """What a result says of the coefficients."""

    # values with covariance and prior_sd; every coefficient has a standard deviation [SI]
    vector: CoefficientVector
    # mean of the prior of each coefficient, 0 where it is not here [SI]
    means: Mapping[str, float] = field(default_factory=dict)
    # errors that other results share, what each is of -> its name in `vector` [1]
    sources: Mapping[Hashable, str] = field(default_factory=dict)

    @property
    def own(self) -> CoefficientVector:
        """The coefficients without the errors that are shared."""
        said = set(self.sources.values())
        return self.vector.chosen(n for n in self.vector.names if n not in said)

    def shared(self, names: Iterable[str]) -> dict[Hashable, FloatArray]:
        """Return what the errors of coefficients `names`, shape (n,) [SI], owe to each source."""
        index, cov = self.vector.layout.index, self.vector.cov
        assert cov is not None
        at = [index(n) for n in names]
        return {source: -cov[at, index(name)] for source, name in self.sources.items()}


def with_sources(known: Known, shared: Mapping[Hashable, FloatArray]) -> Known:
    """Put the sources of errors that other results share beside the coefficients.

    `known`: what a result says, its covariance with what it shares; `shared` (n,): source ->
    error of each coefficient per standard deviation of the source [SI].
    """
    vector = known.vector
    if not shared:
        return known
    assert vector.cov is not None
    names = {source: f"shared {source}" for source in shared}
    L = at_most(vector, np.stack(list(shared.values()), axis=1))
    k = L.shape[1]
    more = tuple(Coefficient(name, "g", "scale factor error", "shared") for name in names.values())
    return replace(known, sources=names, vector=CoefficientVector(
        Layout((*vector.layout.coefficients, *more)),
        np.concatenate([vector.values, np.zeros(k)]),
        np.block([[vector.cov, -L], [-L.T, np.eye(k)]]),
        np.concatenate([vector.free, np.ones(k, bool)]),
        np.concatenate([vector.prior_sd, np.ones(k)]),
    ))  # fmt: skip


def at_most(vector: CoefficientVector, L: FloatArray) -> FloatArray:
    """Return shared errors no larger than the covariance allows: a prior may have made them less.

    ``P - L L'`` is positive where no eigenvalue of ``L' P^-1 L`` is above one.

    `vector`: the coefficients, each with a standard deviation, and their covariance P [SI]; `L`
    (n, k): errors per standard deviation of their k sources [SI].
    """
    assert vector.cov is not None
    sd = vector.sd
    values, vectors = np.linalg.eigh(vector.cov / np.outer(sd, sd))
    root = (vectors / np.sqrt(np.maximum(values, DEPENDENT * values[-1]))).T @ (L / sd[:, None])
    most = float(np.linalg.norm(root, 2) ** 2)
    return np.asarray(L * min(1.0, np.sqrt((1.0 - ALL_SHARED) / most)) if most > 0 else L)


@dataclass(frozen=True)
class Fused:
    """Two results as one."""

    known: Known  # what both say together
    chi_square: float  # how far they are apart, squared [1]
    dof: int  # combinations of coefficients that both know [1]
    # (n,) by how many of its standard deviations each coefficient of `known` moves away from the
    # first result; NaN where that does not have it [1]
    change: FloatArray


def fused(first: Known, second: Known) -> Fused:
    """Join two results without common data; the prior of `second` counts where `first` has none."""
    one, two = first.vector, second.vector
    more = [c for c in two.layout.coefficients if c.name not in one.layout]
    layout = Layout((*one.layout.coefficients, *more))
    unit = np.array([_smallest_sd(name, one, two) for name in layout.names])
    held = np.isin(two.names, one.names)
    A, a = _placed(layout, unit, first, np.zeros(len(one), bool))
    B, b = _placed(layout, unit, second, held)
    L, U = np.linalg.eigh(A + B)
    W = U / np.sqrt(np.maximum(L, DEPENDENT))  # W' (A + B) W = I
    share, V = np.linalg.eigh(W.T @ B @ W)
    W = W @ V
    y = W.T @ (a + b)
    values, cov = W @ y, W @ W.T
    both = (share > LEAST) & (share < 1 - LEAST)
    z = (share * (W.T @ a) - (1 - share) * (W.T @ b))[both]
    chi_square = float(np.sum(z**2 / (share * (1 - share))[both]))
    vector = _vector(layout, values * unit, cov * np.outer(unit, unit), one, two)
    known = Known(vector, {**second.means, **first.means}, {**second.sources, **first.sources})
    dof = max(int(both.sum()) - _fixed(one, two), 0)
    return Fused(known, chi_square, dof, _change(one, vector, known.sources.values()))


def _fixed(one: CoefficientVector, two: CoefficientVector) -> int:
    """Return how many combinations the model fixes in both, so that they cannot differ."""
    names = [name for name in one.names if name in two.layout]
    if not names:
        return 0
    a, b = one.chosen(names), two.chosen(names)
    assert a.cov is not None and b.cov is not None
    unit = np.minimum(a.sd, b.sd)
    values = np.linalg.eigvalsh((a.cov + b.cov) / np.outer(unit, unit))
    return int(np.sum(values < FIXED * values[-1]))


def _smallest_sd(name: str, *vectors: CoefficientVector) -> float:
    return min(float(v.chosen([name]).sd[0]) for v in vectors if name in v.layout)


def _placed(
    layout: Layout, unit: FloatArray, known: Known, without_prior: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return J and h of a result among the coefficients of `layout`, in units of `unit`."""
    vector = known.vector
    at = np.array([layout.index(name) for name in vector.names])
    s = unit[at]
    assert vector.cov is not None
    values, vectors = np.linalg.eigh(vector.cov / np.outer(s, s))
    J = (vectors / np.maximum(values, DEPENDENT * values[-1])) @ vectors.T
    means = np.array([known.means.get(name, 0.0) for name in vector.names])
    # Coefficients that one parameter of a model makes have one prior between them.
    tied = np.abs(vector.cov / np.outer(vector.sd, vector.sd)) > 1.0 - TIED
    prior = np.where(without_prior, (s / vector.prior_sd) ** 2 / tied.sum(axis=1), 0.0)
    h = J @ (vector.values / s) - prior * means / s
    J = J - np.diag(prior)
    if without_prior.any():  # rounding, where the prior is nearly all that is known
        values, vectors = np.linalg.eigh(J)
        known_by_data = values > LEAST * prior.max(initial=0.0)
        keep = vectors[:, known_by_data]
        J, h = (keep * values[known_by_data]) @ keep.T, keep @ (keep.T @ h)
    out, vector_out = np.zeros((len(layout),) * 2), np.zeros(len(layout))
    out[np.ix_(at, at)], vector_out[at] = J, h
    return out, vector_out


def _vector(
    layout: Layout, values: FloatArray, cov: FloatArray, one: CoefficientVector,
    two: CoefficientVector,
) -> CoefficientVector:  # fmt: skip
    more = [k for k, name in enumerate(two.names) if name not in one.layout]
    prior = np.concatenate([one.prior_sd, two.prior_sd[more]])
    free = np.concatenate([one.free, two.free[more]])
    return CoefficientVector(layout, values, 0.5 * (cov + cov.T), free, prior)


def _change(
    before: CoefficientVector, after: CoefficientVector, sources: Iterable[str]
) -> FloatArray:
    """Return the step to `after` over its standard deviation, which is that of what was learnt."""
    at = [after.layout.index(name) for name in before.names]
    learnt = before.sd**2 - after.sd[at] ** 2
    step = after.values[at] - before.values
    out = np.full(len(after), np.nan)
    some = learnt > LEAST * before.sd**2
    out[np.array(at)[some]] = step[some] / np.sqrt(learnt[some])
    out[np.isin(after.names, list(sources))] = np.nan
    return out
