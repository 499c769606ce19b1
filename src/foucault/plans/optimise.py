"""Search for a better plan: random restarts, each a descent by local moves that cools down.

What a plan is, which plans the rig allows and how good each is, a `Space` says; the search knows
nothing of rigs and instruments. A step from one plan to a neighbour is taken where it is better,
and with probability ``exp(-rise / T)`` where it is worse; T falls geometrically from `HOT` to
`COLD`, so that the last steps only go down. The cost is the weighted mean of the logarithms of
sd over sd of the plan to beat, so that 0 is as good and -0.4 means two thirds of the sd; both
temperatures are in its units and suit every space.

A restart depends on its seed and on the number of evaluations only, never on the time it took.

References
----------
.. [1] S. Kirkpatrick, C. D. Gelatt, M. P. Vecchi, "Optimization by simulated annealing", Science
   220, 1983.
.. [2] A. C. Atkinson, A. N. Donev, R. D. Tobias, *Optimum Experimental Designs, with SAS*, Oxford
   University Press, 2007, chapter 12 (exchange and annealing).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from math import exp, inf, isfinite, log
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Layout
from foucault.errors import Finding, error, suggestion
from foucault.plans.limit import Limit

HOT, COLD = 0.05, 0.0005
"""Temperature at the start and at the end of a descent, in units of the cost [1]."""

DRAWS, PROBED = 400, 32
"""So many random plans are tried before it is said that none is allowed; the best of so many that
are allowed is where a descent begins [1]."""


@dataclass(frozen=True, kw_only=True)
class Space:
    """The plans that a rig allows, and how good each of them is.

    Plans are values: neither the search nor the space changes one in place. The plan to beat may
    be one that is none of the space: what is said of plans is said of it too. A space may also
    have ``begin``, the plan to beat as one of its own, where the first restart begins;
    ``exact_cost(plan)``, by which the best plans of all restarts are compared; ``hardly(plan)``,
    what counts and a plan hardly shows; and for the report ``motion(plan)``, beginning, end and
    rates of every step.
    """

    allowed: Any  # what the rig can do: it draws and moves plans, and says so in `words`
    # names, kinds: what is compared, coefficients or what else a plan is made for, and the kinds
    # of their units, as `units.KINDS` has them
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (n,) how much each counts; they need not add up to one [1]
    reference: Any  # the plan to beat
    reference_name: str  # what to call it
    cases: tuple[str, ...]  # circumstances in which plans are compared, the first of them usual
    # plan as it is done, case -> sd of each that would be stated, shape (n,) [SI]
    stated: Callable[[Any, str], FloatArray]
    findings: tuple[Finding, ...] = ()  # what was noticed of what is assumed
    Plan: ClassVar[type | None] = None  # dataclass of its plans, where they are none of tuples

    def __getstate__(self) -> dict[str, Any]:
        # What is remembered stays behind: not all of it can be sent to another process.
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        words: str = self.allowed.words
        return words

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that no allowed plan shows; refuses where one of them counts."""
        return ()

    def draw(self, rng: np.random.Generator) -> Any:
        """Return a random plan that the rig allows."""
        return self.allowed.draw(rng)

    def moved(self, plan: Any, rng: np.random.Generator, heat: float) -> Any:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1] and may make moves smaller."""
        return self.allowed.moved(plan, rng, heat)

    def cost(self, plan: Any) -> float:
        """Return the cost, smaller is better; infinite where a limit is broken or nothing seen."""
        raise NotImplementedError

    def done(self, plan: Any) -> Any:
        """Return a plan as it is done."""
        return plan

    def sd(self, plan: Any, case: str) -> FloatArray:
        """Return the sd of each of `names` that would be stated in one of `cases` [SI]."""
        return self.stated(self.done(plan), case)

    def as_json(self, plan: Any) -> Any:
        """Return a plan as plain values: as it is, where it is of tuples and numbers."""
        return plan if self.Plan is None else asdict(plan)

    def from_json(self, plain: Any) -> Any:
        """Return the plan that `as_json` wrote."""
        if self.Plan is not None:
            return TypeAdapter(self.Plan).validate_python(plain)
        return tuple(map(self.from_json, plain)) if isinstance(plain, list | tuple) else plain

    def changes(self, plan: Any) -> Mapping[str, Mapping[str, Any]]:
        """Return table -> keys, as in the file, that make a campaign do this plan; None removes."""
        raise NotImplementedError

    def steps(self, plan: Any) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per step."""
        raise NotImplementedError

    def needs(self, plan: Any) -> tuple[Limit, ...]:
        """Return what of the rig a plan needs, and how much of it is allowed."""
        raise NotImplementedError

    def duration(self, plan: Any) -> float:
        """Return the time that the plan takes [s]."""
        duration: float = self.done(plan).duration
        return duration


@dataclass(frozen=True, kw_only=True)
class StatedSpace(Space):
    """A space every plan of which is judged by what a calibration would state of it."""

    def fits(self, plan: Any) -> bool:
        """Whether a plan may be compared with others."""
        return plan is not None

    def cost(self, plan: Any) -> float:
        """Return the weighted mean logarithm of sd over that of the plan to beat."""
        if plan is None or not self.fits(plan):
            return inf
        counts = self.weights > 0
        ours, theirs = (self.sd(p, self.cases[0])[counts] for p in (plan, self.reference))
        theirs = np.where(np.isfinite(theirs), theirs, 1.0)
        total = float(self.weights[counts] @ np.log(ours / theirs)) / self.weights.sum()
        return total if np.isfinite(total) else inf


@dataclass(frozen=True, kw_only=True)
class QuickSpace(Space):
    """A space whose plans are judged nearly while it is searched, and exactly in the end."""

    prior_sd: FloatArray | float  # (n,) uncertainty beforehand, in the unit of `bound`
    hidden: ClassVar[float]  # what keeps more than this share of its prior is not seen [1]

    def bound(self, plan: Any) -> FloatArray:
        """Return the sd of each of `names`, nearly, in any unit, shape (n,)."""
        raise NotImplementedError

    @cached_property
    def beaten(self) -> FloatArray:
        """What `bound` is of the plan to beat, shape (n,)."""
        return self.bound(self.reference)

    def fits(self, plan: Any) -> bool:
        """Whether a plan keeps to what is allowed."""
        return bool(self.allowed.fits(plan))

    def price(self, plan: Any, sd: FloatArray, beaten: FloatArray) -> float:
        """Return the weighted mean logarithm of the ratios of two sds.

        `sd`, `beaten` (n,): of the plan and of that to beat [unit of each name].
        """
        return float(self.weights @ np.log(sd / beaten) / self.weights.sum())

    def cost(self, plan: Any) -> float:
        """Return the cost by what is nearly right; infinite beyond the limits."""
        return self.price(plan, self.bound(plan), self.beaten) if self.fits(plan) else inf

    def exact_cost(self, plan: Any) -> float:
        """Return the cost by what a calibration would state."""
        here = self.cases[0]
        return self.price(plan, self.sd(plan, here), self.sd(self.reference, here))

    def hardly(self, plan: Any) -> tuple[str, ...]:
        """Return what counts and this plan hardly shows."""
        left = (self.bound(plan) > self.hidden * self.prior_sd) & (self.weights > 0)
        return tuple(name for name, is_left in zip(self.names, left, strict=True) if is_left)


@dataclass(frozen=True)
class Descent:
    """The best plan of one restart."""

    plan: Any  # the plan; None where none was allowed
    cost: float  # its cost [1]
    evaluations: int  # plans that were judged [1]
    # after how many evaluations the best cost became what, whenever it fell by more than `NOTED`
    # [1]
    trace: tuple[tuple[int, float], ...]


NOTED = 0.005  # Smaller gains of the cost are not noted in the trace [1].


def descend(
    space: Space,
    rng: np.random.Generator,
    evaluations: int,
    start: Any = None,
    hot: float = HOT,
) -> Descent:
    """Descend from a random plan, or from a given one.

    `evaluations`: so many plans are judged [1]; `hot`: temperature at the start [1].
    """
    plan, cost, first = _begun(space, rng, start)
    best, least, trace = plan, cost, [(first, cost)]
    if cost == inf:
        return Descent(None, inf, first, tuple(trace))
    for used in range(first + 1, evaluations + 1):
        done = (used - first) / (evaluations - first)
        near = space.moved(plan, rng, 1.0 - done)
        price = space.cost(near)
        temperature = hot * exp(done * log(COLD / hot))
        if price <= cost or rng.random() < exp((cost - price) / temperature):
            plan, cost = near, price
            if cost < least:
                best, least = plan, cost
                if cost < trace[-1][1] - NOTED:
                    trace.append((used, cost))
    return Descent(best, least, max(first, evaluations), (*trace, (evaluations, least)))


def _begun(space: Space, rng: np.random.Generator, start: Any) -> tuple[Any, float, int]:
    if start is not None:
        return start, space.cost(start), 1
    plan, cost, allowed, used = None, inf, 0, 0
    while used < DRAWS:
        used += 1
        drawn = space.draw(rng)
        price = space.cost(drawn)
        if price < inf:
            allowed += 1
        if price < cost:
            plan, cost = drawn, price
        if allowed == PROBED:
            break
    return plan, cost, used


@dataclass(frozen=True)
class Comparison:
    """A plan beside the one to beat, coefficient by coefficient and case by case."""

    # names, kinds: what is compared, and the kinds of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (n,) how much each counts [1]
    cases: tuple[str, ...]
    # reference_sd, sd: (c, n) standard deviations with the plan to beat and with the plan found
    # [SI]
    reference_sd: FloatArray
    sd: FloatArray

    @property
    def ratio(self) -> FloatArray:
        """Sd over sd with the plan to beat, shape (c, n); NaN where that sees nothing [1]."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.sd / self.reference_sd
        return np.where(np.isfinite(self.reference_sd), ratio, np.nan)

    @property
    def geometric_mean(self) -> FloatArray:
        """Weighted geometric mean of the ratios of each case, shape (c,) [1]."""
        known = np.isfinite(self.ratio) & (self.weights > 0)
        share = np.where(known, self.weights, 0.0)
        logs = np.log(np.where(known, self.ratio, 1.0))
        return np.asarray(np.exp((share * logs).sum(1) / share.sum(1)))

    @property
    def worst(self) -> FloatArray:
        """Largest ratio among those that count, of each case, shape (c,) [1]."""
        return np.asarray(np.nanmax(np.where(self.weights > 0, self.ratio, np.nan), axis=1))


def compare(space: Space, plan: Any) -> Comparison:
    """Compare a plan with the one to beat, in all cases, by what would be stated."""
    return Comparison(
        space.names, space.kinds, space.weights, space.cases,
        np.array([space.sd(space.reference, case) for case in space.cases]),
        np.array([space.sd(plan, case) for case in space.cases]),
    )  # fmt: skip


def weights_of(layout: Layout, given: Mapping[str, float]) -> FloatArray:
    """Return the weight of every coefficient, shape (n,), over the largest of them [1].

    `given`: weights of coefficients or of groups of them, 1 where nothing is said, the longer
    name wins [1]. Raises ``optimise.weight``: an unknown name, a weight below zero, or nothing
    left above zero.
    """
    weights = np.ones(len(layout.names))
    groups = {n.rpartition(".")[0] for n in layout.names}
    known = sorted({*layout.names, *groups, *(n.split(".")[0] for n in layout.names)} - {""})
    for name in sorted(given, key=len):
        if name not in known:
            hint = suggestion(name, known)
            allowed = ", ".join(sorted(groups - {""}) or layout.names)
            raise error("optimise.weight_name", name=name, hint=hint, allowed=allowed)
        if not (isfinite(given[name]) and given[name] >= 0):
            raise error("optimise.weight", name=name, given=given[name])
        weights[layout.group(name)] = given[name]
    if not weights.any():
        raise error("optimise.weightless")
    return np.asarray(weights / weights.max())


def require_seen(
    names: tuple[str, ...], weights: FloatArray, unseen: BoolArray, limits: str
) -> tuple[str, ...]:
    """Return the names that no allowed plan shows; refuse those of them that count.

    `weights` (n,): how much each counts [1]; `unseen` (n,): whether no allowed plan shows it.
    """
    counting = [n for n, w, u in zip(names, weights, unseen, strict=True) if u and w > 0]
    if counting:
        some = ", ".join(counting)
        raise error("optimise.unseen", count=len(counting), names=some, limits=limits)
    return tuple(n for n, u in zip(names, unseen, strict=True) if u)
