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

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, inf, log
from typing import Any, Protocol

import numpy as np

from foucault.arrays import FloatArray

HOT, COLD = 0.05, 0.0005
"""Temperature at the start and at the end of a descent, in units of the cost [1]."""

DRAWS, PROBED = 400, 32
"""So many random plans are tried before it is said that none is allowed; the best of so many that
are allowed is where a descent begins [1]."""


class Space(Protocol):
    """The plans that a rig allows, and how good each of them is.

    Plans are values: neither the search nor the space changes one in place. A space may also have
    ``begin``, the plan to beat as one of its own, where the first restart begins;
    ``exact_cost(plan)``, by which the best plans of all restarts are compared; ``hardly(plan)``,
    what counts and a plan hardly shows; ``findings``, what the user should know; and for the
    report ``needs(plan)``, what of the rig a plan needs as `diagnose.foresight.Limit`, and
    ``motion(plan)``, beginning, end and rates of every step.

    Attributes
    ----------
    names : tuple of str
        What is compared: coefficients, or what else a plan is made for.
    kinds : tuple of str
        Kind of the unit of each, as `units.KINDS` has it.
    weights : ndarray, shape (n,)
        How much each counts; they need not add up to one [1].
    unseen : tuple of str
        Those that no allowed plan shows; their weight is 0.
    reference : object
        The plan to beat.
    reference_name : str
        What to call it.
    cases : tuple of str
        Circumstances in which plans are compared: latitudes, true errors, headings.
    limits : str
        What is allowed, in words.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray
    unseen: tuple[str, ...]
    reference: Any
    reference_name: str
    cases: tuple[str, ...]
    limits: str

    def draw(self, rng: np.random.Generator) -> Any:
        """Return a random plan that the rig allows."""
        ...

    def moved(self, plan: Any, rng: np.random.Generator, heat: float) -> Any:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1] and may make moves smaller."""
        ...

    def cost(self, plan: Any) -> float:
        """Return the cost, smaller is better; infinite where a limit is broken or nothing seen."""
        ...

    def sd(self, plan: Any, case: str) -> FloatArray:
        """Return the sd of each of `names` that would be stated in one of `cases` [SI]."""
        ...

    def as_json(self, plan: Any) -> Any:
        """Return a plan as plain values."""
        ...

    def from_json(self, plain: Any) -> Any:
        """Return the plan that `as_json` wrote."""
        ...

    def changes(self, plan: Any) -> Mapping[str, Mapping[str, Any]]:
        """Return table -> keys, as in the file, that make a campaign do this plan; None removes."""
        ...

    def steps(self, plan: Any) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per step."""
        ...

    def duration(self, plan: Any) -> float:
        """Return the time that the plan takes [s]."""
        ...


@dataclass(frozen=True)
class Descent:
    """The best plan of one restart."""

    plan: Any  # the plan; None where none was allowed
    cost: float  # its cost [1]
    evaluations: int  # plans that were judged [1]
    # after how many evaluations the best cost became what, whenever it fell by more than `NOTED`
    # [1]
    trace: tuple[tuple[int, float], ...]


NOTED = 0.005
"""Smaller gains of the cost are not noted in the trace [1]."""


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
