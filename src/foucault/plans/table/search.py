"""Search for positions on a table: which to take, and in what order.

A plan is a set of positions. What a session in them tells of the coefficients is a sum over the
positions (see `procedures.on_table.bound`), so that a changed position costs one evaluation of a
tabled function and one small inverse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from itertools import product
from math import inf
from typing import Any, Literal

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.models.turntable import up_k
from foucault.plans.table.directions import spread_outer
from foucault.plans.table.efficiency import efficiency
from foucault.plans.table.information import Parts, half_covariance
from foucault.plans.table.reach import NEARLY, Position, Reach, shortest_order, travel_time
from foucault.strict import Strict

Plan = tuple[Position, ...]
Criterion = Literal["sd", "det"]

KEPT = 50_000
"""Positions whose information is remembered [1]."""

REPLACED, TURNED = 0.1, 0.05
"""Shares of moves that draw one position anew, and that turn all together; the rest shift one."""

DOWNHILL, LAST = 0.002, 0.01
"""Share of moves that slide down to where nothing shifted a little is better; and the heat from
which on that share grows to all [1]."""

SLIDE = 60
"""Most steps of such a slide [1]."""

WIDE, NARROW = 0.6, 0.003
"""How far a position is shifted at the start of a descent and at its end [rad]."""


class Wanted(Strict):
    """What a better set of positions is wanted for."""

    positions: int | None = Field(default=None, ge=1, examples=[20])
    """Number of positions; left out, that of the plan."""
    criterion: Criterion = "sd"
    """sd: the geometric mean of the standard deviations is made small; det: the volume of their
    common ellipsoid (D-optimal), which does not depend on axes."""
    integrity: bool = False
    """Take only plans in whose residuals a bad rest shows, and shows which it is."""
    weights: dict[str, float] = Field(default={}, examples=[{"accel.bias": 3.0, "gyro": 0.0}])
    """How much coefficients or groups of them count; 1 where nothing is said."""


@dataclass(frozen=True)
class PositionSpace:
    """The sets of positions that a table allows, and how good each of them is.

    It is a `plans.optimise.Space`.
    """

    # names, kinds: coefficients and the kinds of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (p,) how much each counts [1]
    unseen: tuple[str, ...]  # coefficients that no allowed positions show; their weight is 0
    reference: Plan  # the plan to beat
    reference_name: str  # what to call it
    cases: tuple[str, ...]  # circumstances in which plans are compared
    count: int  # number of positions [1]
    reach: Reach  # what the table allows
    # whether the outer angle matters; if not it is spread over the circle in the end
    outer_counts: bool
    parts: Parts  # what one position tells
    beforehand: FloatArray  # (u, u) information without any position
    floor: FloatArray  # (p, p) covariance that no plan can take away
    # ``(angles, case) -> sd`` of the coefficients, without approximations
    bound: Callable[[FloatArray, str], FloatArray]
    time: Callable[[FloatArray], float]  # angles -> length of the session [s]
    # angles -> what the session needs of the table
    needed: Callable[[FloatArray], tuple[Limit, ...]]
    criterion: Criterion = "sd"  # what is made small
    # model for which a bad rest must be noticed and named, a key of `efficiency.MODELS`; empty
    # where it need not be
    integrity: str = ""

    @property
    def begin(self) -> Plan | None:
        """The plan to beat, where it has as many positions: some cannot be beaten by much."""
        return self.reference if len(self.reference) == self.count else None

    @cached_property
    def _remembered(self) -> Callable[[Position], FloatArray]:
        return lru_cache(KEPT)(self.parts)

    @cached_property
    def _ordered(self) -> Callable[[Plan], Plan]:
        return lru_cache(8)(self._in_order)

    @cached_property
    def _scale(self) -> FloatArray:
        """Root of the information that is usual of each unknown."""
        usual = self.count * self.parts.usual + np.diag(self.beforehand)
        return np.sqrt(np.where(usual > 0.0, usual, 1.0))

    @cached_property
    def unit(self) -> float:
        """What the criterion makes of the reference [1]."""
        return self.size(self.reference)

    def __reduce__(self) -> tuple[Any, ...]:
        # What is remembered stays behind; it cannot be sent to another process.
        return PositionSpace, tuple(getattr(self, f.name) for f in fields(self))

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        honest = ", with residuals that name a bad rest" if self.integrity else ""
        return f"{self.count} positions, {self.reach.words or 'any angles'}{honest}"

    def draw(self, rng: np.random.Generator) -> Plan:
        """Return random positions."""
        return tuple(self._anywhere(rng) for _ in range(self.count))

    def _anywhere(self, rng: np.random.Generator) -> Position:
        outer = rng.uniform(*self.reach.outer) if self.outer_counts else 0.0
        return self.reach.pointing(rng.standard_normal(3), outer)

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan:
        """Return a neighbour: one position shifted or drawn anew, or all turned together.

        `heat`: from 1 to 0, shifts become smaller [1].
        """
        size = max(NARROW + WIDE * heat**2, self.reach.step)
        chance, k = rng.random(), int(rng.integers(len(plan)))
        if rng.random() < (DOWNHILL if heat > LAST else 1.0 - heat / LAST):
            return self._slid(plan) if self.reach.step == 0.0 else self._stepped(plan)
        if chance < REPLACED:
            return (*plan[:k], self._anywhere(rng), *plan[k + 1 :])
        if chance < REPLACED + TURNED:
            turn = size * rng.standard_normal(3)
            return tuple(self._shifted(p, rng, 0.0, turn) for p in plan)
        return (*plan[:k], self._shifted(plan[k], rng, size, np.zeros(3)), *plan[k + 1 :])

    def _shifted(
        self, position: Position, rng: np.random.Generator, size: float, turn: FloatArray
    ) -> Position:
        up = up_k(np.array([position]))[0]
        outer = position[0]
        if size > 0.0:
            up = up + size * rng.standard_normal(3)
            outer += size * rng.standard_normal() if self.outer_counts else 0.0
        return self.reach.pointing(up + np.cross(turn, up), outer)

    def cost(self, plan: Plan) -> float:
        """Return the logarithm of how much worse a plan is than the reference; negative: better."""
        if self.integrity and not self._honest(plan):
            return inf
        return self.size(plan) - self.unit

    def _honest(self, plan: Plan) -> bool:
        return efficiency(up_k(np.array(plan)), self.integrity).named

    def size(self, plan: Plan) -> float:
        """Return the logarithm of what the criterion makes small; infinite: nothing is seen."""
        return self.judged(plan)[0]

    def judged(self, plan: Plan) -> tuple[float, FloatArray]:
        """Return `size`, and M: where the information grows by dF it falls by ``sum(M * dF)``."""
        F = self.beforehand + sum(self._remembered(p) for p in plan)
        used = np.flatnonzero(self.weights > 0)
        half = half_covariance(F, used, self._scale)
        if half is None:
            return inf, np.zeros_like(F)
        inner = half[:, used]
        cov = inner.T @ inner + self.floor[np.ix_(used, used)]
        across = half.T @ inner
        if self.criterion == "det":
            size = np.linalg.slogdet(cov)[1] / (2 * len(used))
            return float(size), across @ np.linalg.solve(cov, across.T) / (2 * len(used))
        share = 0.5 * self.weights[used] / self.weights.sum()
        variance = np.diag(cov)
        return float(share @ np.log(variance)), (across * (share / variance)) @ across.T

    def _slid(self, plan: Plan) -> Plan:
        """Return the plan at the foot of the slope that a plan is on."""
        from scipy.optimize import minimize

        free = slice(None) if self.outer_counts else slice(1, None)
        start = np.array(plan)
        bounds = [
            (None, None) if ends[1] - ends[0] > 2 * np.pi - NEARLY else ends
            for ends in list(self.reach.ranges)[free]
        ] * len(plan)

        def judged(x: FloatArray) -> tuple[float, FloatArray]:
            angles = start.copy()
            angles[:, free] = x.reshape(len(plan), -1)
            there: Plan = tuple((float(o), float(m), float(i)) for o, m, i in angles)
            size, M = self.judged(there)
            if size == inf:
                return 1e3, np.zeros_like(x)
            slope = np.array([self.parts.slope(p, M) for p in there])
            return size, -slope[:, free].ravel()

        found = minimize(
            judged, start[:, free].ravel(), jac=True, method="L-BFGS-B", bounds=bounds,
            options={"maxiter": SLIDE},
        )  # fmt: skip
        start[:, free] = found.x.reshape(len(plan), -1)
        return tuple(self.reach.nearest((float(o), float(m), float(i))) for o, m, i in start)

    def _stepped(self, plan: Plan) -> Plan:
        """Return the plan from which no single step of one position leads further down."""
        size, improved = self.size(plan), True
        while improved:
            improved = False
            for k in range(len(plan)):
                for near in self._beside(plan[k]):
                    other = (*plan[:k], near, *plan[k + 1 :])
                    there = self.size(other)
                    if there < size - 1e-9:
                        plan, size, improved = other, there, True
        return plan

    def _beside(self, position: Position) -> list[Position]:
        """Return the positions that are one step away in any of their angles."""
        outer, middle, inner = position
        h, each = self.reach.step, (0, -1, 1)
        moves = product(each if self.outer_counts else (0,), each, each)
        near = (self.reach.nearest((outer + a * h, middle + b * h, inner + c * h))
                for a, b, c in moves)  # fmt: skip
        return [p for p in dict.fromkeys(near) if p != position]

    def sd(self, plan: Plan, case: str) -> FloatArray:
        """Return the bound of each coefficient, without approximations, shape (p,) [SI]."""
        return self.bound(np.array(plan), case)

    def ordered(self, plan: Plan) -> Plan:
        """Return the same positions in an order with little travel.

        Where the outer angle does not matter, it advances evenly from one to the next. The plan to
        beat stays as it is.
        """
        return plan if plan == self.reference else self._ordered(plan)

    def _in_order(self, plan: Plan) -> Plan:
        angles = np.array(plan)
        angles = angles[shortest_order(travel_time(angles, 1.0))]
        if not self.outer_counts:
            spread = spread_outer(len(angles))
            angles[:, 0] = [self.reach.nearest((a, 0.0, 0.0))[0] for a in spread]
        return tuple((float(o), float(m), float(i)) for o, m, i in angles)

    def as_json(self, plan: Plan) -> list[list[float]]:
        """Return a `plan` as lists of angles [rad]."""
        return [list(p) for p in plan]

    def from_json(self, plain: list[list[float]]) -> Plan:
        """Return the plan that `as_json` wrote.

        `plain` (n, 3): angles [rad].
        """
        return tuple((float(o), float(m), float(i)) for o, m, i in plain)

    def changes(self, plan: Plan) -> Mapping[str, Mapping[str, Any]]:
        """Return the keys of [procedure] that make a campaign use the positions of a `plan`."""
        degrees = np.degrees(np.array(self.ordered(plan)))
        listed = [[f"{_rounded(a, 6)} deg" for a in row] for row in degrees]
        return {"procedure": {"plan": None, "positions": listed}}

    def needs(self, plan: Plan) -> tuple[Limit, ...]:
        """Return what a `plan` needs of the table."""
        return self.needed(np.array(self.ordered(plan)))

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the positions of a `plan` in order, as a table for people."""
        degrees = np.degrees(np.array(self.ordered(plan)))
        rows = [(str(k), *(_rounded(a, 4) for a in row)) for k, row in enumerate(degrees, 1)]
        return (("position", "outer (deg)", "middle (deg)", "inner (deg)"), *rows)

    def duration(self, plan: Plan) -> float:
        """Return the time of rests, moves and spins of a `plan` [s]."""
        return self.time(np.array(self.ordered(plan)))


def _rounded(value: float, digits: int) -> str:
    """Write `value` to so many decimals, without zeros at its end."""
    text = f"{value:z.{digits}f}"
    return text.rstrip("0").rstrip(".")
