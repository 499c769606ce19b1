"""Left-out terms as states of a filter: the rule of `infer.left_out` where a system is solved.

A filter takes a term that is left out for a constant state, with the prior 0 +- its size. Its
estimate and covariance at the end are the test itself::

    u = (x - m) / s      V = I - P / s^2      (s the size, or the sd of the prior, m its mean)

and so is that of what was said to be known of a coefficient. What a prior that is off by s does to
the estimate is ``P[:, j] / s``, which says what a group costs. Innovations that are larger than
they should be, and that no term explains, make every u larger too: they are a cause as others are,
and where they are the likeliest the test of all others is by as much more lenient.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.infer.gauss_newton import Component
from foucault.infer.left_out import (
    ROUNDS,
    Judgement,
    Seen,
    detectable,
    farthest,
    guilty,
    hidden,
    joined,
    seen_of,
)

T = TypeVar("T")


class Group(NamedTuple):
    """Terms of one size, or coefficients that something was known of."""

    kind: Literal["source", "prior"]
    names: tuple[str, ...]  # of the states
    size: float = np.nan  # of what is left out, 1 sd [SI]
    basis: str = ""  # what it rests on


@dataclass(frozen=True)
class Posterior:
    """What a filter has found of its constant states."""

    states: CoefficientVector  # with covariance and the sd that was known beforehand [SI]
    mean: FloatArray  # (n,) what was known beforehand [SI]
    # innovations of each kind of measurement, as many as are independent
    innovations: Mapping[str, Component]


Solve = Callable[[Mapping[str, float]], T]
"""Solve it with sizes so many times as large, by group; what is not named keeps its own."""


def fit(
    solve: Solve[T],
    posterior: Callable[[T], Posterior],
    groups: Mapping[str, Group],
    reported: Sequence[str],
) -> tuple[T, Judgement]:
    """Solve with what is left out at its size; enlarge what the readings contradict.

    `posterior`: what a solution says; `groups`: what is judged, by its name; `reported`: names of
    the coefficients whose variances count.
    """
    sizes, named = dict[str, float](), list[dict[str, float]]()
    first, scatter = dict[str, Seen](), 1.0
    for _ in range(ROUNDS):
        found = solve(sizes)
        seen = tested(posterior(found), groups, scatter)
        first = first or seen
        blamed = guilty(seen)
        causes = {n: s for n, s in blamed.items() if s.kind != "scatter"}
        if not blamed:
            break
        if not causes:
            scatter = max(s.k for s in blamed.values())
            continue
        for name, s in causes.items():
            sizes[name] = sizes.get(name, 1.0) * s.k
        order = sorted(causes, key=lambda name: -causes[name].gain)
        named.append({name: causes[name].k for name in order})
    judged = _judged(first, named, posterior(found).states, groups, reported)
    return found, replace(judged, after=seen)


def planned(at: Posterior, groups: Mapping[str, Group], reported: Sequence[str]) -> Judgement:
    """Judge what is left out in a session that is only planned: nothing is contradicted.

    `at`: with the covariance that it will have; `groups`, `reported`: as of `fit`.
    """
    seen = tested(replace(at, states=replace(at.states, values=at.mean), innovations={}), groups)
    return _judged(seen, [], at.states, groups, reported)


def _judged(
    seen: Mapping[str, Seen], named: list[dict[str, float]], last: CoefficientVector,
    groups: Mapping[str, Group], reported: Sequence[str],
) -> Judgement:  # fmt: skip
    """Say what was made of every group: as `seen` first, and what it is of the `last` sd."""
    out = tuple(n for n, g in groups.items() if g.kind == "source" and n in seen)
    needed = {n: float(detectable(s, len(seen)).min()) for n, s in seen.items()}
    sized = {n: (groups[n].size, groups[n].basis) for n in out}
    worst = {
        n: (groups[n].names[far[0]].removeprefix(OF), far[1])
        for n in out if (far := farthest(seen[n])) is not None
    }  # fmt: skip
    share, terms = shares(last, groups, reported), dict[str, tuple[int, float]]()
    for n in out:
        each = {name: Group("source", (name,)) for name in groups[n].names}
        of_each = np.array([*shares(last, each, reported).values()])
        if (found := hidden(seen[n], len(seen), of_each)) is not None:
            terms[n] = found
    return Judgement(seen, joined(named), needed, share, out, sized, worst, terms)


OF = "left out "  # What the name of a state begins with that is nothing but such a term.


def tested(at: Posterior, groups: Mapping[str, Group], scatter: float = 1.0) -> dict[str, Seen]:
    """Test every group, and the innovations of every kind while none is known to scatter.

    `scatter`: sd of the innovations over what is expected of it, where that is more [1]. What
    nothing shows and what has no effect is not there.
    """
    c, out = at.states, dict[str, Seen]()
    assert c.cov is not None
    total = np.outer(c.sd, c.sd)
    for name, group in groups.items():
        i = [c.names.index(n) for n in group.names]
        sd = c.prior_sd[i]
        V = np.eye(len(i)) - c.cov[np.ix_(i, i)] / np.outer(sd, sd)
        others = [k for k in range(len(c)) if k not in i]
        related = np.abs(c.cov[np.ix_(others, i)] / total[np.ix_(others, i)])
        if np.abs(V).max() > SEES_NOTHING or related.max(initial=0.0) > SEES_NOTHING:
            u = (c.values[i] - at.mean[i]) / sd / scatter
            out[name] = seen_of(group.kind, u, (V + V.T) / 2)
    if scatter == 1.0:
        out |= {f"scatter of {n}": _scatter(s) for n, s in at.innovations.items()}
    return out


SEES_NOTHING = 1e-9
"""Share, and correlation, below which a term and the measurements have nothing to do with each
other [1]."""


def _scatter(s: Component) -> Seen:
    """Judge innovations: n independent ones of mean square m gain n (m - 1 - ln m)."""
    from scipy.special import chdtrc

    n, m = s.redundancy, s.chi_square / s.redundancy
    gain = n * (m - 1.0 - np.log(m)) if m > 1.0 else 0.0
    none, p = np.zeros((1, 1)), float(chdtrc(n, s.chi_square))
    k = float(np.sqrt(max(m, 1.0)))
    return Seen("scatter", none[0], none, s.chi_square, round(n), p, k, float(gain))


def shares(
    states: CoefficientVector, groups: Mapping[str, Group], reported: Sequence[str]
) -> dict[str, float]:
    """Return the largest share of each group in a variance of what is `reported`."""
    assert states.cov is not None
    total = states.chosen(reported).sd ** 2
    return {n: float((by / total).max()) for n, by in parts(states, groups, reported).items()}


def parts(
    states: CoefficientVector, groups: Mapping[str, Group], reported: Sequence[str]
) -> dict[str, FloatArray]:
    """Return the variance that each group makes of what is `reported`, (p,) each [SI].

    A prior that is off by s moves the estimate by ``P[:, j] / s``.
    """
    assert states.cov is not None
    at, out = [states.names.index(n) for n in reported], dict[str, FloatArray]()
    for name, group in groups.items():
        i = [states.names.index(n) for n in group.names]
        out[name] = np.sum((states.cov[np.ix_(at, i)] / states.prior_sd[i]) ** 2, axis=1)
    return out


def budget(
    states: CoefficientVector, groups: Mapping[str, Group], reported: CoefficientVector
) -> dict[str, dict[str, Any]]:
    """Return variances of what is `reported` [SI] by source, for result.json.

    What no group makes is the noise; what was added to the `reported` afterwards is in it.
    """
    out = parts(states, groups, reported.names)
    out[NOISE] = np.maximum(reported.sd**2 - np.sum(list(out.values()), axis=0), 0.0)
    known = {n: g.basis or "prior as given in the campaign, or usual" for n, g in groups.items()}
    known[NOISE] = "noise of the readings and of what they are held against"
    return {
        "budget": {n: v.tolist() for n, v in out.items()},
        "sources": {n: ["B", known[n]] for n in out},
    }


NOISE = "noise"  # Source of what no group makes.


def widened(
    states: CoefficientVector, groups: Mapping[str, Group], times: Mapping[str, float]
) -> CoefficientVector:
    """Return what is known beforehand with groups so many `times` as uncertain [1]."""
    sd = states.prior_sd.copy()
    for name, k in times.items():
        sd[[states.names.index(n) for n in groups[name].names]] *= k
    return replace(states, prior_sd=sd)


def of_priors(c: CoefficientVector, names: Sequence[str]) -> dict[str, Group]:
    """Return what was known of coefficients as groups; `names`: of those that have a prior."""
    out: dict[str, list[str]] = {}
    for name in names:
        if np.isfinite(c.prior_sd[c.names.index(name)]):
            out.setdefault(f"prior of {name.rpartition('.')[0]}", []).append(name)
    return {group: Group("prior", tuple(some)) for group, some in out.items()}


def noted(judged: Judgement, name: str, group: Group, share: float) -> Judgement:
    """Note a term that is no state: it is as large as its size says, whatever the readings say.

    `name`: of the group; `share`: largest share of it in a variance [1].
    """
    none = np.zeros((1, 1))
    return replace(
        judged, groups=(*judged.groups, name), share={**judged.share, name: share},
        seen={**judged.seen, name: Seen("source", none[0], none, 0.0, 0, 1.0, 1.0, 0.0)},
        needed={**judged.needed, name: np.inf},
        sizes={**judged.sizes, name: (group.size, group.basis)},
    )  # fmt: skip
