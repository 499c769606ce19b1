"""Search for positions on a table: which to take, and in what order.

A plan is a set of positions. What a session in them tells of the coefficients is a sum over the
positions (see `procedures.on_table.plan`), so that a changed position costs one evaluation of a
tabled function and one small inverse.

The function of the three angles is tabled by trigonometric interpolation on a regular grid: exact
where its harmonics in each angle are no higher than its `degrees`, and as near as its higher ones
are small otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from math import asin, atan2, ceil, cos, floor, inf, pi, remainder, sin
from typing import Any, Literal

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray, IndexArray
from foucault.errors import error
from foucault.models.turntable import up_k
from foucault.plans.directions import spread_outer
from foucault.plans.efficiency import efficiency
from foucault.plans.limit import Limit
from foucault.plans.optimise import Space
from foucault.strict import Strict

Position = tuple[float, float, float]
Range = tuple[float, float]

AXES = ("outer", "middle", "inner")

EVERYWHERE = (-pi, pi)

NEARLY = 1e-7
"""Angles nearer than this are the same; files give them to a millionth of a degree [rad]."""


@dataclass(frozen=True)
class Reach:
    """What the three axes of a table allow in a rest."""

    # outer, middle, inner: (2,) smallest and largest angle [rad]
    outer: Range = EVERYWHERE
    middle: Range = EVERYWHERE
    inner: Range = EVERYWHERE
    step: float = 0.0  # angles are multiples of this; 0 where any angle will do [rad]

    @property
    def ranges(self) -> tuple[Range, Range, Range]:
        """The ranges of outer, middle and inner angle."""
        return self.outer, self.middle, self.inner

    @property
    def words(self) -> str:
        """The limits in words, empty where there are none."""
        said = [
            f"{name} angle {np.degrees(low):g} to {np.degrees(high):g} deg"
            for name, (low, high) in zip(AXES, self.ranges, strict=True)
            if high - low < 2 * pi - NEARLY
        ]
        return ", ".join(
            [*said, *([f"steps of {np.degrees(self.step):g} deg"] if self.step else [])]
        )

    def checked(self) -> Reach:
        """Return itself, or refuse ranges without an angle in them."""
        for name, (low, high) in zip(AXES, self.ranges, strict=True):
            if self._snapped(0.5 * (low + high), (low, high)) is None:
                raise error(
                    "table.range", name=name, low=f"{np.degrees(low):g}",
                    high=f"{np.degrees(high):g}", step=f"{np.degrees(self.step):g}",
                )  # fmt: skip
        return self

    def _snapped(self, angle: float, within: Range) -> float | None:
        """Return the nearest angle that is allowed; None where none is."""
        low, high = within
        # The same angle whole turns away may lie in the range.
        middle = 0.5 * (low + high)
        angle = middle + remainder(angle - middle, 2 * pi)
        if self.step == 0.0:
            return min(max(angle, low), high) if low <= high else None
        first, last = ceil((low - NEARLY) / self.step), floor((high + NEARLY) / self.step)
        return (
            min(max(round(angle / self.step), first), last) * self.step if first <= last else None
        )

    def nearest(self, position: Position) -> Position:
        """Return the allowed position nearest to one, axis by axis [rad], shape (3,)."""
        out = [self._snapped(a, r) for a, r in zip(position, self.ranges, strict=True)]
        return tuple(0.0 if a is None else a for a in out)  # type: ignore[return-value]

    def allows(self, position: Position) -> bool:
        """Tell whether the table can stand at a position [rad], shape (3,)."""
        there = self.nearest(position)
        return all(
            abs(remainder(a - b, 2 * pi)) < NEARLY for a, b in zip(there, position, strict=True)
        )

    def pointing(self, up: FloatArray, outer: float) -> Position:
        """Return the allowed position that turns a direction upwards as nearly as it can.

        `up` (3,): direction that is to be up, case axes, not of length zero [1]; `outer`: outer
        angle [rad].
        """
        x, y, z = (up / np.linalg.norm(up)).tolist()
        middle = asin(min(max(y, -1.0), 1.0))
        inner = atan2(-x, z)
        best, least = (outer, middle, inner), inf
        # Beyond the pole of the middle axis the same direction is reached the other way round.
        for m, i in ((middle, inner), (pi - middle, inner + pi)):
            at = self.nearest((outer, m, i))
            _, a, b = at
            near = -cos(a) * sin(b) * x + sin(a) * y + cos(a) * cos(b) * z
            if 1.0 - near < least - 1e-12:
                best, least = at, 1.0 - near
        return best


def travel_time(angles: FloatArray, rate: float) -> FloatArray:
    """Return how long the slowest axis takes from each position to each other, shape (n, n).

    The outer axis goes the shorter way round; in units of 1 / rate.

    `angles` (n, 3): outer, middle and inner angle [rad]; `rate`: rate of the axes [rad/s].
    """
    apart = np.abs(angles[:, None, :] - angles[None, :, :])
    apart[:, :, 0] = np.abs(np.remainder(apart[:, :, 0] + pi, 2 * pi) - pi)
    return np.asarray(apart.max(axis=2) / rate)


def shortest_order(time: FloatArray) -> IndexArray:
    """Return an order of positions with little travel: nearest neighbours, then 2-opt, shape (n,).

    `time` (n, n): travel from each to each [s].
    """
    n = len(time)
    orders = [_improved(_nearest(time, first), time) for first in range(n)]
    lengths = [time[o[:-1], o[1:]].sum() for o in orders]
    return np.array(orders[int(np.argmin(lengths))], dtype=np.intp)


def _nearest(time: FloatArray, first: int) -> list[int]:
    order, left = [first], set(range(len(time))) - {first}
    while left:
        here = order[-1]
        order.append(min(left, key=lambda k: (time[here, k], k)))
        left.remove(order[-1])
    return order


def _improved(order: list[int], time: FloatArray) -> list[int]:
    """Turn stretches round for as long as that saves travel; the ends are free."""
    n = len(order)

    def leg(a: int, b: int) -> float:
        return float(time[order[a], order[b]]) if a >= 0 and b < n else 0.0

    better = True
    while better:
        better = False
        for i in range(n - 1):
            for j in range(i + 1, n):
                before = leg(i - 1, i) + leg(j, j + 1)
                after = 0.0
                if i > 0:
                    after += float(time[order[i - 1], order[j]])
                if j < n - 1:
                    after += float(time[order[i], order[j + 1]])
                if after < before - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    better = True
    return order


@dataclass(frozen=True)
class Periodic:
    """A function of three angles with symmetric matrices as values."""

    degrees: tuple[int, int, int]  # (3,) highest harmonic in each angle [1]
    size: int  # rows of a matrix [1]
    # (k, size (size + 1) of every product of harmonics, for the upper triangle row by row
    amplitudes: FloatArray

    @classmethod
    def of(
        cls,
        function: Callable[[FloatArray], FloatArray],
        degrees: tuple[int, int, int],
    ) -> Periodic:
        """Table a function.

        `function`: angles, shape (n, 3) [rad] -> symmetric matrices, shape (n, size, size);
        `degrees` (3,): highest harmonic in each angle [1].
        """
        grids = [2 * np.pi * np.arange(2 * d + 1) / (2 * d + 1) for d in degrees]
        values = function(np.array(list(product(*grids))))
        size = values.shape[1]
        upper = values[:, *np.triu_indices(size)]
        inverse = [
            np.linalg.inv([_harmonics(float(x), d) for x in g])
            for g, d in zip(grids, degrees, strict=True)
        ]
        table = upper.reshape(*(len(g) for g in grids), -1)
        amplitudes = np.einsum("ai,bj,ck,ijkt->abct", *inverse, table, optimize=True)
        return cls(degrees, size, amplitudes.reshape(-1, upper.shape[1]))

    @cached_property
    def _upper(self) -> tuple[IndexArray, IndexArray]:
        return np.triu_indices(self.size)

    @property
    def mean(self) -> FloatArray:
        """Mean over all angles, shape (size, size)."""
        out = np.empty((self.size, self.size))
        rows, columns = self._upper
        out[rows, columns] = out[columns, rows] = self.amplitudes[0]
        return out

    def __call__(self, angles: tuple[float, float, float]) -> FloatArray:
        """Return the matrix at three angles, shape (size, size).

        `angles` (3,): the angles [rad].
        """
        a, b, c = (_harmonics(x, d) for x, d in zip(angles, self.degrees, strict=True))
        found = ((a[:, None] * b).ravel()[:, None] * c).ravel() @ self.amplitudes
        out = np.empty((self.size, self.size))
        rows, columns = self._upper
        out[rows, columns] = out[columns, rows] = found
        return out

    def slope(self, angles: tuple[float, float, float], M: FloatArray) -> FloatArray:
        """Return the derivatives of ``sum(M * F)`` by the angles, shape (3,).

        `angles` (3,): the angles [rad]; `M` (size, size): a symmetric matrix.
        """
        rows, columns = self._upper
        along = self.amplitudes @ (M[rows, columns] * np.where(rows == columns, 1.0, 2.0))
        terms = along.reshape(tuple(2 * d + 1 for d in self.degrees))
        a, b, c = (_harmonics(x, d) for x, d in zip(angles, self.degrees, strict=True))
        over_c = terms @ c
        return np.array([
            _derivatives(a) @ over_c @ b,
            a @ over_c @ _derivatives(b),
            a @ (terms @ _derivatives(c)) @ b,
        ])  # fmt: skip


def _derivatives(harmonics: FloatArray) -> FloatArray:
    """Return the derivatives of what `_harmonics` returns, from its values."""
    out = np.zeros_like(harmonics)
    k = np.arange(1, len(harmonics) // 2 + 1)
    out[1::2], out[2::2] = -k * harmonics[2::2], k * harmonics[1::2]
    return out


def _harmonics(angle: float, degree: int) -> FloatArray:
    """Return 1, cos a, sin a, cos 2a, ... at an angle, shape (2 degree + 1,)."""
    terms = [(cos(k * angle), sin(k * angle)) for k in range(1, degree + 1)]
    return np.array([1.0, *(term for pair in terms for term in pair)])


SEEN = 1e-7
"""A pivot of the scaled information below this is rounding: nothing is seen along it [1]."""

FAINT = 1e-13
"""Information added for unknowns that do not count, relative to what there is of each [1]."""


def without(F: FloatArray, kept: int) -> FloatArray:
    """Return the information of the first unknowns, the others eliminated.

    `F` (n, n): information of all; `kept`: number of those kept [1].
    """
    if kept == len(F):
        return F
    across = F[kept:, :kept]
    return np.asarray(F[:kept, :kept] - across.T @ np.linalg.solve(F[kept:, kept:], across))


@dataclass(frozen=True)
class Parts:
    """What one position tells of the coefficients and of all else that positions share."""

    table: Periodic  # information of a position; what it has to itself comes last
    kept: int  # unknowns that positions share, coefficients first [1]

    def __call__(self, position: Position) -> FloatArray:
        """Return the information of a `position` [rad] for what is shared, shape (kept, kept)."""
        return without(self.table(position), self.kept)

    @property
    def usual(self) -> FloatArray:
        """Information that a position has of each on average, were all else known, (kept,)."""
        return np.diag(self.table.mean)[: self.kept]

    def slope(self, position: Position, M: FloatArray) -> FloatArray:
        """Return the derivatives of ``sum(M * F)`` by the angles, shape (3,).

        `position` (3,): the angles [rad]; `M` (kept, kept): a symmetric matrix.
        """
        if self.kept == self.table.size:
            return self.table.slope(position, M)
        F, k = self.table(position), self.kept
        K = np.vstack([np.eye(k), -np.linalg.solve(F[k:, k:], F[k:, :k])])
        return self.table.slope(position, K @ M @ K.T)


def half_covariance(F: FloatArray, used: IndexArray, scale: FloatArray) -> FloatArray | None:
    """Return H with covariance ``H' H``; None where something of the `used` is not seen.

    `F` (u, u): information of all unknowns; `used` (k,): those of interest [1]; `scale` (u,):
    root of the information that is usual of each.
    """
    scaled = F / np.outer(scale, scale)
    others = np.ones(len(F), bool)
    others[used] = False
    # Those that do not count may be unseen: a faint prior keeps them out of the way.
    scaled[others, others] += FAINT
    try:
        root = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return None
    if root.diagonal().min() < SEEN:
        return None
    return np.asarray(np.linalg.inv(root) / scale)


Plan = tuple[Position, ...]
Criterion = Literal["sd", "det"]

KEPT = 50_000  # Positions whose information is remembered [1].

REPLACED, TURNED = 0.1, 0.05
"""Shares of moves that draw one position anew, and that turn all together; the rest shift one."""

DOWNHILL, LAST = 0.002, 0.01
"""Share of moves that slide down to where nothing shifted a little is better; and the heat from
which on that share grows to all [1]."""

SLIDE = 60  # Most steps of such a slide [1].

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


@dataclass(frozen=True, kw_only=True)
class PositionSpace(Space):
    """The sets of positions that a table allows, and how good each of them is."""

    allowed: Reach
    blind: tuple[str, ...]  # coefficients that no allowed positions show; their weight is 0
    count: int  # number of positions [1]
    # whether the outer angle matters; if not it is spread over the circle in the end
    outer_counts: bool
    parts: Parts  # what one position tells
    beforehand: FloatArray  # (u, u) information without any position
    floor: FloatArray  # (p, p) covariance that no plan can take away
    time: Callable[[FloatArray], float]  # angles -> length of the session [s]
    # angles -> what the session needs of the table
    needed: Callable[[FloatArray], tuple[Limit, ...]]
    criterion: Criterion = "sd"  # what is made small
    # model for which a bad rest must be noticed and named, a key of `efficiency.MODELS`; empty
    # where it need not be
    integrity: str = ""

    @property
    def unseen(self) -> tuple[str, ...]:
        """Coefficients that no allowed positions show."""
        return self.blind

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

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        honest = ", with residuals that name a bad rest" if self.integrity else ""
        return f"{self.count} positions, {self.allowed.words or 'any angles'}{honest}"

    def draw(self, rng: np.random.Generator) -> Plan:
        """Return random positions."""
        return tuple(self._anywhere(rng) for _ in range(self.count))

    def _anywhere(self, rng: np.random.Generator) -> Position:
        outer = rng.uniform(*self.allowed.outer) if self.outer_counts else 0.0
        return self.allowed.pointing(rng.standard_normal(3), outer)

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan:
        """Return a neighbour: one position shifted or drawn anew, or all turned together.

        `heat`: from 1 to 0, shifts become smaller [1].
        """
        size = max(NARROW + WIDE * heat**2, self.allowed.step)
        chance, k = rng.random(), int(rng.integers(len(plan)))
        if rng.random() < (DOWNHILL if heat > LAST else 1.0 - heat / LAST):
            return self._slid(plan) if self.allowed.step == 0.0 else self._stepped(plan)
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
        return self.allowed.pointing(up + np.cross(turn, up), outer)

    def cost(self, plan: Plan) -> float:
        """Return the logarithm of how much worse a plan is than the reference; negative: better."""
        if self.integrity and not efficiency(up_k(np.array(plan)), self.integrity).named:
            return inf
        return self.size(plan) - self.unit

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
            for ends in list(self.allowed.ranges)[free]
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
        return tuple(self.allowed.nearest((float(o), float(m), float(i))) for o, m, i in start)

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
        h, each = self.allowed.step, (0, -1, 1)
        moves = product(each if self.outer_counts else (0,), each, each)
        near = (self.allowed.nearest((outer + a * h, middle + b * h, inner + c * h))
                for a, b, c in moves)  # fmt: skip
        return [p for p in dict.fromkeys(near) if p != position]

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
            angles[:, 0] = [self.allowed.nearest((a, 0.0, 0.0))[0] for a in spread]
        return tuple((float(o), float(m), float(i)) for o, m, i in angles)

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
