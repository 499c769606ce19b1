"""What a procedure does not estimate, as sources: a test of each, and the rule that judges them.

A term that is left out has a typical size. Its column is how the residuals change when one size of
it is put into what was read. It enters as any source does::

    y = h(x) + J dx + sum_g k_g B_g t_g + noise,   t_g ~ N(0, I),   k_g = 1 as declared

which is a state t_g with the prior 0 +- k_g, or ``k_g^2 B_g B_g'`` more covariance: the same thing.
With P the inverse covariance of the readings without what x can explain, and B for k_g B_g::

    u = B' P r = E(t | y)      V = B' P B = I - cov(t | y)      T = u' V^+ u ~ chi^2(rank V)

T is large where a term is larger than its size: the score test [1]. V is the share of it that the
readings see. A size k times as large gains ``sum (k^2 - 1) w^2 / (1 + (k^2 - 1) l) -
ln(1 + (k^2 - 1) l)`` in twice the restricted log-likelihood, l the eigenvalues of V and w the parts
of u along them: causes are ranked without a further fit.

References
----------
.. [1] C. R. Rao, "Large sample tests of statistical hypotheses concerning several parameters",
   Proc. Camb. Phil. Soc. 44, 1948.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.infer import mixed
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.infer.mixed import Covariance, Fit, Linearisation, Model, Source

VISIBLE = 1e-4
"""Share of a direction below which it is not seen: rounding and curvature are as large [1]."""

ALIKE = 6.0
"""Twice the log-likelihood within which readings do not tell one cause from another [1]."""

ROUNDS = 8  # Times that something is enlarged at most [1].

UNSEEN = 10.0
"""Sizes that a group would need to be named from which on this plan cannot show it [1]."""

MATTERS = 0.01  # Share of a variance from which on a group that cannot be shown is told [1].


@dataclass(frozen=True)
class With:
    """A model with more sources, whose columns are held fixed, and with other sizes."""

    model: Model
    more: tuple[Source, ...] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)  # source -> its sd instead [SI]

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return self.model.layout

    @property
    def start(self) -> Any:
        """State to start from."""
        return self.model.start

    @property
    def kinds(self) -> Mapping[str, BoolArray]:
        """Kind of reading -> which components of which readings, shape (n, d) each."""
        return self.model.kinds

    @property
    def drifts(self) -> bool:
        """Whether drifts of coefficients are among what was added."""
        return any(s.name.endswith(" drift") for s in self.more)

    def linearise(self, state: Any) -> Linearisation:
        """Compare the readings with the model at `state`."""
        at = self.model.linearise(state)
        every = (*at.sources, *self.more)
        return replace(
            at, sources=tuple(replace(s, sd=self.sizes.get(s.name, s.sd)) for s in every)
        )

    def retract(self, state: Any, step: FloatArray) -> Any:
        """Apply `step` (m,) to a state [SI]."""
        return self.model.retract(state, step)

    def values(self, state: Any) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return self.model.values(state)


def scatters(model: Model) -> tuple[Source, ...]:
    """Return a scatter for every kind of reading that has none: else its misfit blames a term."""
    free = [s for s in model.linearise(model.start).sources if s.sd is None and s.unexplained]
    out = []
    for kind, rows in model.kinds.items():
        d = rows.shape[1]
        seen = [s.each[rows.any(axis=1)] for s in free if s.each is not None]
        if rows.any() and not any(each.any() for each in seen):
            each = np.eye(d) * rows[:, :, None]
            out.append(mixed.scatter(f"scatter of {kind}", each, price=ALIKE))
    return tuple(out)


class Seen(NamedTuple):
    """What the readings say of one group: see the head of this file."""

    kind: Literal["source", "prior", "scatter"]
    u: FloatArray  # (c,) E(t | y), sizes of each term [1]
    V: FloatArray  # (c, c) share of it that the readings see [1]
    T: float  # chi-square of `dof` while all are of their size [1]
    dof: int
    p: float  # probability of so large a T by chance [1]
    k: float  # best size, in units of the present one; of a scatter its size [SI]
    gain: float  # of that in twice the log-likelihood [1]


def tested(at: Fit) -> dict[str, Seen]:
    """Test every source of known size that is not noise, every group of the prior, every scatter.

    A coefficient with a prior is not projected out: its prior is a source, and the residuals are
    taken against its mean. What has no effect is not there.
    """
    n, d, _ = at.at.jacobian.shape
    layout, prior = at.model.layout, at.problem.prior
    known = np.zeros(at.at.jacobian.shape[2], bool)
    r, priors = at.at.residuals, tuple[Source, ...]()
    if prior is not None:
        known[: len(layout)] = np.isfinite(prior.prior_sd)
        off = (at.estimate.coefficients.values - prior.values)[known[: len(layout)]]
        r = r + at.at.jacobian[:, :, known] @ off
        priors = tuple(
            Source(f"prior of {group}", shared=at.at.jacobian[:, :, rows] * prior.prior_sd[rows])
            for group, rows in _known(layout, prior).items()
        )
    covariance = Covariance((*at.at.sources, *priors), at.sds, (n, d), at.estimate.weights)
    rows, z = mixed.contrasts(covariance, at.at, r, ~known)
    left, z = rows[:, : n * d], rows @ z
    groups: dict[str, tuple[Literal["source", "prior", "scatter"], list[FloatArray]]] = {}
    for source in (*at.at.sources, *priors):
        found = source.sd is None
        if source.noise or (found and (not source.unexplained or at.sds.get(source.name))):
            continue
        kind: Literal["source", "prior", "scatter"] = (
            "scatter" if found else "prior" if source in priors else "source"
        )
        sd = 1.0 if found else mixed.size_of(source, at.sds)
        groups.setdefault(source.name, (kind, []))[1].extend(sd * B for B in mixed.columns(source))
    out = {}
    for name, (kind, parts) in groups.items():
        B = np.concatenate(parts, axis=2) if parts else np.zeros((n, d, 0))
        if B.any():
            B = left @ covariance.whiten(B)
            out[name] = seen_of(kind, B.T @ z, B.T @ B)
    return out


def seen_of(kind: Literal["source", "prior", "scatter"], u: FloatArray, V: FloatArray) -> Seen:
    """Judge a group by E(t | y), `u` (c,), and I - cov(t | y), `V` (c, c) [1]."""
    from scipy.special import chdtrc

    share, along = np.linalg.eigh(V)
    least = VISIBLE if kind != "scatter" else 0.0
    kept = share > max(least, 1e-6 * float(share.max(initial=0.0)))
    seen, w = share[kept], (along.T @ u)[kept]
    if not len(seen):
        return Seen(kind, u, V, 0.0, 0, 1.0, 1.0, 0.0)
    T = float(np.sum(w**2 / seen))
    more = np.geomspace(1e-3, 1e9, 600) / seen.max()  # k^2 - 1, or the variance of a scatter
    a = more[:, None]
    gain = np.sum(a * w**2 / (1 + a * seen) - np.log1p(a * seen), axis=1)
    best, top = more[np.argmax(gain)], max(float(gain.max()), 0.0)
    own = float(kind != "scatter")
    k = float(np.sqrt(best + own)) if top else own
    return Seen(kind, u, V, T, len(seen), float(chdtrc(len(seen), T)), k, top)


def _known(layout: Layout, prior: CoefficientVector) -> dict[str, list[int]]:
    out: dict[str, list[int]] = {}
    for i in np.flatnonzero(np.isfinite(prior.prior_sd)):
        out.setdefault(layout.names[i].rpartition(".")[0], []).append(int(i))
    return out


def farthest(seen: Seen) -> tuple[int, float] | None:
    """Return which term of a group is farthest off, and how many sizes that is, u / V of it [1].

    None where no term is seen.
    """
    share = np.diag(seen.V)
    if not (share > VISIBLE).any():
        return None
    off = np.where(share > VISIBLE, seen.u / np.maximum(share, VISIBLE), 0.0)
    sure = np.abs(seen.u) / np.sqrt(np.maximum(share, VISIBLE))  # a weak alias may look huge
    k = int(np.argmax(np.where(share > VISIBLE, sure, 0.0)))
    return k, float(abs(off[k]))


def detectable(seen: Seen, groups: int, power: float = 0.9) -> FloatArray:
    """Return how many sizes of each term are named in a share `power` of sessions, (c,) [1].

    `groups`: tests that share the false alarms [1].
    """
    from scipy.special import chdtri, chndtrinc

    if not seen.dof:
        return np.full(len(seen.V), np.inf)
    level = chdtri(seen.dof, FALSE_ALARM / groups)
    need = chndtrinc(level, seen.dof, 1.0 - power)  # the non-centrality
    share = np.diag(seen.V)
    return np.where(share > VISIBLE, np.sqrt(need / np.maximum(share, VISIBLE)), np.inf)


def hidden(seen: Seen, groups: int, share: FloatArray) -> tuple[int, float] | None:
    """Return how many terms matter that are not seen, and how many sizes the nearest of them needs.

    A group may be named by one term while others of it go unnoticed. None where all that matter
    are seen.

    `groups`: tests that share the false alarms [1]; `share` (c,): largest of each term in a
    variance [1].
    """
    needed = detectable(seen, groups)
    some = (needed > UNSEEN) & (share > MATTERS)
    return (int(some.sum()), float(needed[some].min())) if some.any() else None


def guilty(seen: Mapping[str, Seen]) -> dict[str, Seen]:
    """Return the likeliest of the suspects, and all that the readings cannot tell from it."""
    suspects = {n: s for n, s in seen.items() if s.p < FALSE_ALARM / len(seen) and s.gain > 0}
    most = max((s.gain for s in suspects.values()), default=0.0)
    return {n: s for n, s in suspects.items() if s.gain > most - ALIKE}


@dataclass(frozen=True)
class Judgement:
    """What was made of the terms that are not estimated."""

    seen: Mapping[str, Seen]  # every group, tested at its size
    # sets of groups that the readings cannot tell apart, the likeliest first, and how many times
    # its size each is [1]
    named: tuple[Mapping[str, float], ...]
    # group -> sizes of its most visible term at which it is named in 90 % of sessions [1]
    needed: Mapping[str, float]
    share: Mapping[str, float]  # group -> largest share of it in a variance [1]
    groups: tuple[str, ...] = ()  # those that were left out
    sizes: Mapping[str, tuple[float, str]] = field(default_factory=dict)  # [SI], and their basis
    # group -> the term of it that is farthest off, and how many times its size that is [1]
    worst: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    # group -> how many terms of it are not seen though they matter, at how many sizes one was [1]
    hidden: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    # every group as tested when nothing more was named: scatter may have explained what looked odd
    # at first; empty where it was tested once
    after: Mapping[str, Seen] = field(default_factory=dict)

    @property
    def unseen(self) -> dict[str, float]:
        """Groups that this plan cannot show though they matter: how many sizes it would take."""
        return {
            n: self.needed[n] for n in self.groups
            if n in self.needed and self.needed[n] > UNSEEN and self.share.get(n, 0.0) > MATTERS
        }  # fmt: skip


Columns = Callable[[Any], tuple[Source, ...]]  # State -> a source for every group that is left out.


def fit(
    model: Model,
    columns: Columns,
    prior: CoefficientVector | None = None,
    **how: Any,
) -> tuple[Fit, Judgement]:
    """Fit with what is left out at its size; enlarge what the readings contradict.

    First without scatter that nobody explains and with all readings, since that would take up what
    a cause explains; the likeliest cause is enlarged until none is contradicted, then scatter is
    found and outliers are left out as `mixed.fit` does.

    `model`: that was to be fitted; `columns`: its columns at a state; `prior` or None: what is
    known of the coefficients, enlarged where it is contradicted [SI]; `how`: of `mixed.fit`.
    """
    sources = model.linearise(model.start).sources
    extra = scatters(model)
    free = [s.name for s in (*sources, *extra) if s.sd is None and s.unexplained]
    off, sizes = dict.fromkeys(free, 0.0), dict[str, float]()
    named, first, state = list[dict[str, float]](), dict[str, Seen](), None
    at = mixed.fit(With(model, extra, off), prior)
    for _ in range(ROUNDS):
        state = at.state if state is None else state
        more = (*extra, *columns(state))
        at = mixed.fit(With(model, more, off | sizes), prior)
        seen, state = tested(_as_free(at, set(off))), at.state
        first = first or seen
        blamed = guilty(seen)
        causes = {n: s for n, s in blamed.items() if s.kind != "scatter"}
        if not blamed or (not causes and not off):
            break
        if not causes:
            off = {}
            continue
        every = {s.name: s.sd for s in at.at.sources}
        for name, s in causes.items():
            if s.kind == "prior":
                assert prior is not None
                sd = prior.prior_sd.copy()
                sd[_known(prior.layout, prior)[name.removeprefix("prior of ")]] *= s.k
                prior = replace(prior, prior_sd=sd)
            else:
                sizes[name] = s.k * (every[name] or 0.0)
        order = sorted(causes, key=lambda name: -causes[name].gain)
        named.append({name: causes[name].k for name in order})
    last = mixed.fit(With(model, more, sizes), prior, own=True, **how)
    return last, replace(_judged(first, named, last, more, extra), after=seen)


def planned(
    model: Model,
    columns: Columns,
    prior: CoefficientVector | None = None,
    sds: Mapping[str, float] | None = None,
) -> tuple[Fit, Judgement]:
    """Return fit and judgement of a session that was only planned, as `mixed.planned` does.

    What a session would see of each group hangs on its plan alone; that nothing is contradicted is
    taken for granted.

    `model`: of the planned session; `columns`, `prior`: as of `fit`; `sds` or None: source -> size
    of those to be found [SI].
    """
    extra = scatters(model)
    more = (*extra, *columns(model.start))
    sources = (*model.linearise(model.start).sources, *extra)
    off = {s.name: 0.0 for s in sources if s.sd is None and s.unexplained}
    first = tested(_as_free(mixed.planned(With(model, more, off), sds, prior), set(off)))
    last = mixed.planned(With(model, more), sds, prior)
    return last, _judged(first, [], last, more, extra)


def _judged(
    first: Mapping[str, Seen], named: list[dict[str, float]], last: Fit,
    more: tuple[Source, ...], extra: tuple[Source, ...],
) -> Judgement:  # fmt: skip
    """Say what was made of every group: as tested at `first`, and what it is of the `last` sd."""
    parts, total = mixed.budget(last), np.diag(last.estimate.state_cov)[: len(last.model.layout)]
    share = {n: float((v / total).max()) for n, v in parts.items()}
    groups = tuple(dict.fromkeys(s.name for s in more if s not in extra))
    needed = {n: float(detectable(s, len(first)).min()) for n, s in first.items()}
    terms, n, d = dict[str, tuple[int, float]](), *last.at.residuals.shape
    for s in last.at.sources:
        if s.name in groups and s.name in first and s.shared is not None:
            moved = np.einsum("pnd,ndk->pk", last.gain.reshape(-1, n, d), s.shared)
            of_each = mixed.size_of(s, last.sds) ** 2 * moved**2 / total[:, None]
            if (found := hidden(first[s.name], len(first), of_each.max(axis=0))) is not None:
                terms[s.name] = found
    return Judgement(first, joined(named), needed, share, groups, hidden=terms)


def _as_free(at: Fit, held: set[str]) -> Fit:
    """Let the test know what is a scatter, though it was held at nothing."""
    sources = tuple(replace(s, sd=None) if s.name in held else s for s in at.at.sources)
    return replace(at, at=replace(at.at, sources=sources))


def joined(named: list[dict[str, float]]) -> tuple[Mapping[str, float], ...]:
    """Join what was enlarged twice: sizes multiply, and it stays where it was first `named` [1]."""
    out: list[dict[str, float]] = []
    for one in named:
        before = [o for o in out if set(o) & set(one)]
        into = before[0] if before else {}
        if not before:
            out.append(into)
        for name, k in one.items():
            into[name] = into.get(name, 1.0) * k
    return tuple(out)
