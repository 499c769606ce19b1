"""Search for a sequence of a systematic calibration: rests, poses, turns and rate of its spins.

A plan has two parts: one of the built-in sequences of quarter turns, whose rests are open, and its
turns too where that is wanted: about which axis of the body, in which sense and order; and spins
about North in poses that are open, after and before rests that are open (see
`sequence.action_sequences`). Either the uncertainty is made small in a given time, or
the time for a wanted uncertainty.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor, inf, log
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.detect.sequence import LEAST_TURN
from foucault.errors import FoucaultError
from foucault.plans.limit import Limit
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.optimise import DRAWS, QuickSpace, require_seen
from foucault.plans.sequence import (
    CalibrationSequence,
    action_sequences,
    best_poses,
    built_in,
    turns_to,
)
from foucault.plans.sequence_file import plain_action, plain_start, rows

WIDE, NARROW = 40.0, 0.5
"""How far a pose is shifted at the start of a descent and at its end [deg]."""

FIRST_REST = 30  # Shortest first rest: the attitude is found in it [s].


@dataclass(frozen=True)
class SpinPlan:
    """What is open of a sequence, in the numbers that are written."""

    rests: tuple[int, ...]  # rests of the first part [s]
    # angle a about z and b about East of every spin [deg]
    poses: tuple[tuple[float, float], ...] = ()
    turns: int = 0  # turns of a spin [1]
    rate: float = 0.0  # its rate [deg/s]
    # before, after: rest before a spin, 0 for none, and after it [s]
    before: int = 0
    after: int = 0
    # axis of the body and number of quarters, with its sense, of every turn of the first part;
    # none where the turns are those of the built-in sequence [1]
    quarters: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Allowed:
    """What may be done."""

    first: str  # name of the first part
    total: float  # time there is; infinite if it does not matter [s]
    poses: int  # number of spins; 0 for none [1]
    rate: float  # highest rate [rad/s]
    moves: float  # rate of the moves between the poses and of the first part [rad/s]
    step: float  # angles are multiples of it; 0 for any [rad]
    # shortest, longest: length of a rest [s]
    shortest: float
    longest: float
    most: int  # turns of a spin [1]
    alike: bool  # whether the rests of the first part are alike
    fill: bool  # whether the rests of the first part take all the time that is left
    open_turns: bool = False  # whether the quarter turns of the first part are open

    @property
    def words(self) -> str:
        """What is allowed, in words."""
        out = [self.first, f"rests of {self.shortest:g} to {self.longest:g} s"]
        if self._quarters:
            out.append("quarter and half turns about any axis of the body between them")
        if self.poses:
            fastest = f"{np.degrees(self.rate):.4g} deg/s"
            out.append(f"{self.poses} spins of at most {self.most} turns at {fastest} or less")
            out.append(f"angles in steps of {np.degrees(self.step):g} deg" * (self.step > 0))
        if self.total < inf:
            out.append(f"{units.span(self.total)} in all")
        return ", ".join(word for word in out if word)

    @cached_property
    def _first(self) -> CalibrationSequence:
        first, rate = built_in(self.first), self.moves
        return replace(first, actions=tuple(
            replace(a, rate=rate) if isinstance(a, Rotate) else a for a in first.actions
        ))  # fmt: skip

    @cached_property
    def _quarters(self) -> tuple[tuple[str, int], ...]:
        """The turns of the first part, where they are open and such as can be exchanged."""
        turns = [a for a in self._first.actions if isinstance(a, Rotate)]
        quarters = [(a.axis, a.angle / (np.pi / 2)) for a in turns]
        if not self.open_turns or any(n not in ("x", "y", "z") or k % 1 for n, k in quarters):
            return ()
        return tuple((axis, int(k)) for axis, k in quarters)

    def sequence(self, plan: SpinPlan) -> CalibrationSequence:
        """Return a plan as it is done."""
        rests, quarters = iter(plan.rests), iter(plan.quarters)
        first: list[Rest | Rotate] = []
        for action in self._first.actions:
            if isinstance(action, Rest):
                first.append(replace(action, time=float(next(rests))))
            elif plan.quarters:
                axis, number = next(quarters)
                first.append(replace(action, axis=axis, angle=number * np.pi / 2))
            else:
                first.append(action)
        if not plan.poses:
            return CalibrationSequence("found", self._first.start, tuple(first))
        spins = action_sequences(
            np.radians(plan.poses), turns=plan.turns, spin_rate=np.radians(plan.rate),
            before=float(plan.before), rest=float(plan.after), rate=self.moves,
        )  # fmt: skip
        actions = (*first, *self._between(plan.quarters), *spins.actions)
        return CalibrationSequence("found", self._first.start, actions)

    def _between(self, quarters: tuple[tuple[str, int], ...]) -> tuple[Rotate, ...]:
        """Turns from the end of the first part to where both gimbals are at zero."""
        if quarters not in self._kept:
            done = self.sequence(SpinPlan((1,) * len(self._first.positions), quarters=quarters))
            self._kept[quarters] = turns_to(done.attitudes[-1], np.eye(3), rate=self.moves)
        return self._kept[quarters]

    @cached_property
    def _kept(self) -> dict[tuple[tuple[str, int], ...], tuple[Rotate, ...]]:
        return {}

    def fits(self, plan: SpinPlan) -> bool:
        """Whether a plan keeps time and rests, with turns that can be found in a log."""
        sequence = self.sequence(plan)
        least = min((*plan.rests, plan.after if plan.poses else inf))
        turn = min(abs(t.angle) for t in sequence.actions if isinstance(t, Rotate))
        in_time = sequence.duration <= self.total * (1 + 1e-12)
        return least >= self.shortest and turn >= CLEAR * LEAST_TURN and in_time

    # -- how plans are varied

    def draw(self, rng: np.random.Generator) -> SpinPlan:
        """Return a random plan; half of them have poses that are good by the closed form."""
        n = len(self._first.positions)
        some = rng.uniform(self.shortest, self.longest, 1 if self.alike else n)
        rests = self._begun(np.broadcast_to(some, n))
        quarters = self._quarters
        if quarters:  # from the sequence that is known to one of chance
            other = rng.random(len(quarters)) < rng.random()
            quarters = tuple(
                self._turn(rng) if new else turn for turn, new in zip(quarters, other, strict=True)
            )
        if not self.poses:
            return self._fitted(SpinPlan(rests, quarters=quarters))
        poses = np.degrees(rng.uniform((-np.pi, -np.pi / 2), (np.pi, np.pi / 2), (self.poses, 2)))
        if self.poses >= 6 and rng.random() < 0.5:
            poses = np.degrees(best_poses(self.poses, starts=2, seed=int(rng.integers(2**31))))
        rate = np.degrees(self.rate) * (1.0 if rng.random() < 0.7 else rng.uniform(0.2, 1.0))
        before, after = int(rng.integers(0, 61)), int(rng.integers(0, 121))
        return self._fitted(SpinPlan(
            rests, self._stepped(poses), int(rng.integers(1, self.most + 1)), self._rate(rate),
            before if before >= self.shortest else 0, ceil(self.shortest) + after, quarters,
        ))  # fmt: skip

    def _rate(self, rate: float) -> float:
        return min(floor(10.0 * rate) / 10.0 or 0.1, float(np.degrees(self.rate)))

    def _stepped(self, poses: FloatArray) -> tuple[tuple[float, float], ...]:
        """Return angles that the rig has, to a hundredth of a degree where it has all."""
        unit = np.degrees(self.step) or 0.01
        snapped = np.round(np.asarray(poses) / unit) * unit
        return tuple((float(f"{a:.12g}"), float(f"{b:.12g}")) for a, b in snapped)

    def moved(self, plan: SpinPlan, rng: np.random.Generator, heat: float) -> SpinPlan:
        """Return a neighbour: a pose, an order, a rest, turns or rate changed.

        Shifts shrink with `heat`, shape () [1].
        """
        if plan.quarters and rng.random() < (TURNED if plan.poses else 1.0 - TURNED):
            return self._fitted(self._other_turns(plan, rng))
        if not plan.poses or (not self.alike and rng.random() < 0.3):
            return self._fitted(self._other_rests(plan, rng, heat))
        what = rng.random()
        if what < 0.45:
            k = int(rng.integers(len(plan.poses)))
            size = max(NARROW + WIDE * heat**2, np.degrees(self.step))
            poses = np.array(plan.poses)
            poses[k] += size * rng.standard_normal(2)
            chance = rng.random()
            if chance < 0.05:
                poses[k] = rng.uniform((-180, -90), (180, 90))
            elif chance < 0.15:  # the opposite axis tells the same, and may be nearer
                poses[k] = (plan.poses[k][0] % 360.0 - 180.0, -plan.poses[k][1])
            new = replace(plan, poses=self._stepped(poses))
        elif what < 0.5:
            order = np.arange(len(plan.poses))
            i, j = rng.integers(len(order), size=2)
            order[[i, j]] = order[[j, i]]
            new = replace(plan, poses=tuple(plan.poses[k] for k in order))
        elif what < 0.6:
            turns = plan.turns + self._shift(rng, heat, 6)
            new = replace(plan, turns=min(max(turns, 1), self.most))
        elif what < 0.65:
            rate = plan.rate * np.exp((0.02 + 0.3 * heat) * rng.standard_normal())
            new = replace(plan, rate=self._rate(rate))
        elif what < 0.75:
            before = plan.before + self._shift(rng, heat, 15)
            new = replace(plan, before=before if before >= self.shortest else 0)
            if plan.before == 0 and rng.random() < 0.5:
                new = replace(plan, before=ceil(self.shortest))
        elif what < 0.85:
            after = plan.after + self._shift(rng, heat, 15)
            new = replace(plan, after=max(after, ceil(self.shortest)))
        else:
            new = self._other_rests(plan, rng, heat)
        return self._fitted(new)

    @staticmethod
    def _shift(rng: np.random.Generator, heat: float, most: int) -> int:
        return int(rng.choice([-1, 1]) * rng.integers(1, 2 + int(heat * most)))

    @staticmethod
    def _turn(rng: np.random.Generator) -> tuple[str, int]:
        return str(rng.choice(["x", "y", "z"])), int(rng.choice([-1, 1, 2]))

    def _other_turns(self, plan: SpinPlan, rng: np.random.Generator) -> SpinPlan:
        """Return a plan with another quarter turn, one the other way round, or two exchanged."""
        quarters, what = list(plan.quarters), rng.random()
        i, j = (int(k) for k in rng.integers(len(quarters), size=2))
        if what < 0.6:
            quarters[i] = self._turn(rng)
        elif what < 0.8:
            quarters[i] = (quarters[i][0], -quarters[i][1])
        else:
            quarters[i], quarters[j] = quarters[j], quarters[i]
        return replace(plan, quarters=tuple(quarters))

    def _other_rests(self, plan: SpinPlan, rng: np.random.Generator, heat: float) -> SpinPlan:
        rests, shift = np.array(plan.rests), self._shift(rng, heat, 20)
        if self.alike:
            rests[:] = rests[-1] + shift
        else:
            rests[int(rng.integers(len(rests)))] += shift
        least, most = ceil(self.shortest), floor(self.longest)
        return replace(plan, rests=self._begun(np.clip(rests, least, most)))

    @staticmethod
    def _begun(rests: FloatArray) -> tuple[int, ...]:
        """Return rests of which the first is long enough to align in."""
        first, *others = (int(t) for t in rests)
        return (max(first, FIRST_REST), *others)

    def _fitted(self, plan: SpinPlan) -> SpinPlan:
        """Give the rests of the first part the time that is left, or take what is too much."""
        if self.total == inf or not (self.fill or self.sequence(plan).duration > self.total):
            return plan
        for _ in range(3):  # what is cut off by the limits of a rest goes to the others
            left = self.total - self.sequence(plan).duration
            rests = np.array(plan.rests)
            rests = np.clip(
                np.floor(rests * (1.0 + left / rests.sum()) + 1e-9), 1, floor(self.longest)
            )
            plan = replace(plan, rests=self._begun(rests))
        return plan


PULL = 10.0
"""Cost of a wanted uncertainty that is missed, per its logarithm: more than any time saved [1]."""

MARGIN = 0.995
"""The search, whose uncertainties are a little off, wants so much of what is wanted [1]."""

UNSEEN = 0.7  # A coefficient that keeps more than this share of its prior is not seen [1].

TURNED = 0.2
"""Where quarter turns are open beside spins, so many moves change one; without spins all others
[1]."""

CLEAR = 2.0  # Turns are at least so many times as large as the least that is found in a log [1].
SAMPLED = 4  # Random plans that show what can be seen at all, beside the plan to beat [1].


@dataclass(frozen=True, kw_only=True)
class SystematicSpace(QuickSpace):
    """The sequences that are allowed, and how good each of them is."""

    allowed: Allowed
    # coefficient or group -> its numbers among `names` and the largest sd that is wanted of them;
    # then the shortest time is sought [SI]
    accuracy: Accuracy
    # sequence -> sd of the coefficients, nearly, shape (p,) [SI]
    quick: Callable[[CalibrationSequence], FloatArray]
    # the same where what is not estimated is nothing: what a sequence does not show even then
    alone: Callable[[CalibrationSequence], FloatArray]
    hidden = UNSEEN
    Plan = SpinPlan

    @property
    def aim(self) -> str:
        """What is made small: "time" for a wanted accuracy, else "sd"."""
        return "time" if self.accuracy else "sd"

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        wanted = zip(self.accuracy, sd_limits(self.accuracy, self.kinds), strict=True)
        return ", ".join([self.allowed.words, *(f"{n} to {w.said_allowed}" for n, w in wanted)])

    # -- how good plans are

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Coefficients that no allowed plan shows; refuses where one of them counts."""
        rng, least = np.random.default_rng(0), np.full(len(self.names), inf)
        plans = [p for p in (self.draw(rng) for _ in range(DRAWS // 10)) if self.fits(p)]
        for plan in plans[:SAMPLED]:
            least = np.minimum(least, self.alone(self.done(plan)))
        if not plans:
            least = np.zeros(len(self.names))  # the search will say that no plan fits
        blind = least > UNSEEN * self.prior_sd
        counts = self.weights > 0
        for members, _ in self.accuracy.values():
            counts[members] = True
        return require_seen(self.names, counts.astype(float), blind, self.limits)

    def bound(self, plan: SpinPlan | CalibrationSequence) -> FloatArray:
        """Return the quick uncertainties, shape (p,) [SI]."""
        return self.quick(self.done(plan))

    def cost(self, plan: SpinPlan) -> float:
        """Return the cost by the quick uncertainties, what is wanted a little better."""
        if not self.fits(plan):
            return inf
        return self.price(plan, self.bound(plan), self.beaten, MARGIN)

    def exact_cost(self, plan: SpinPlan) -> float:
        """Return the cost by what a calibration would state; infinite beyond what is wanted."""
        try:
            sd = self.sd(plan, self.cases[0])
        except FoucaultError:  # a calibration would refuse it: rests that it does not find, say
            return inf
        missed = any(sd[of].max() > limit for of, limit in self.accuracy.values())
        return inf if missed or not self.fits(plan) else super().exact_cost(plan)

    def price(
        self, plan: SpinPlan, sd: FloatArray, beaten: FloatArray, margin: float = 1.0
    ) -> float:
        """Return the mean logarithm of the ratios; with an accuracy wanted that of the time.

        `sd`, `beaten` (p,): of the plan and of that to beat [SI]; `margin`: so much of what is
        wanted is wanted [1].
        """
        if not self.accuracy:
            return super().price(plan, sd, beaten)
        missed = sum(
            max(0.0, log(float(sd[of].max()) / (margin * limit)))
            for of, limit in self.accuracy.values()
        )
        return log(self.duration(plan) / self.reference.duration) + PULL * missed

    # -- what is written of them

    def done(self, plan: SpinPlan | CalibrationSequence) -> CalibrationSequence:
        """Return a plan as it is done."""
        return plan if isinstance(plan, CalibrationSequence) else self.allowed.sequence(plan)

    def changes(self, plan: SpinPlan) -> Mapping[str, Mapping[str, Any]]:
        """Return the keys of [procedure] and [simulate] that make a campaign do this plan."""
        sequence = self.allowed.sequence(plan)
        actions = [plain_action(action) for action in sequence.actions]
        start = list(plain_start(sequence))
        return {
            "procedure": {"sequence": None, "start": start, "actions": actions},
            "simulate": {"rest_time": None},
        }

    def steps(self, plan: SpinPlan | CalibrationSequence) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table: what is done when, and where the axes point after it."""
        return rows(self.done(plan))

    def needs(self, plan: SpinPlan | CalibrationSequence) -> tuple[Limit, ...]:
        """Return what a plan needs of time and table, what it attains, and what is allowed."""
        a, sequence = self.allowed, self.done(plan)
        sd = self.sd(sequence, self.cases[0]) if self.accuracy else None
        return (
            Limit("time", "time", sequence.duration, None if a.total == inf else a.total),
            *table_needs(sequence, None if a.rate == inf else a.rate, a.step),
            *sd_limits(self.accuracy, self.kinds, sd),
        )


Accuracy = Mapping[str, tuple[list[int], float]]
"""Coefficient or group -> its numbers, and the largest standard deviation that is wanted [SI]."""


def sd_limits(
    accuracy: Accuracy, kinds: Sequence[str], sd: FloatArray | None = None
) -> tuple[Limit, ...]:
    """Return what is attained of a wanted accuracy.

    `kinds` (p,): of the units of all coefficients; `sd` (p,): their sds, None for those that are
    wanted [SI].
    """
    return tuple(
        Limit(
            f"largest sd of {name}", kinds[of[0]], wanted if sd is None else float(sd[of].max()),
            wanted, units.display_unit(kinds[of[0]], wanted),
        )
        for name, (of, wanted) in accuracy.items()
    )  # fmt: skip


def table_needs(
    sequence: CalibrationSequence, rate: float | None, step: float | None
) -> tuple[Limit, ...]:
    """Return what a sequence needs of the table.

    `rate` or None: highest rate of the table [rad/s]; `step`: angles have to be multiples of it,
    None or 0 for any [rad].
    """
    turns = [a for a in sequence.actions if isinstance(a, Rotate)]
    out = [Limit("highest rate", "angular rate", max((t.rate for t in turns), default=0.0), rate)]
    if step:
        off = max((abs(t.angle - step * round(t.angle / step)) for t in turns), default=0.0)
        out.append(Limit("angles off the steps", "angle", off * (off > 1e-6), 0.0))
    return tuple(out)
