"""What is open of a sequence of systematic calibration in a search, and how it is varied."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor, inf

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.systematic.built_in import action_sequences, built_in
from foucault.plans.systematic.pose_search import best_poses
from foucault.plans.systematic.sequence import CalibrationSequence, turns_to

WIDE, NARROW = 40.0, 0.5
"""How far a pose is shifted at the start of a descent and at its end [deg]."""

FIRST_REST = 30
"""Shortest first rest: the attitude is found in it [s]."""


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

    @property
    def words(self) -> str:
        """What is allowed, in words."""
        out = [self.first, f"rests of {self.shortest:g} to {self.longest:g} s"]
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

    def sequence(self, plan: SpinPlan) -> CalibrationSequence:
        """Return a plan as it is done."""
        rests = iter(plan.rests)
        first = tuple(
            replace(a, time=float(next(rests))) if isinstance(a, Rest) else a
            for a in self._first.actions
        )
        if not plan.poses:
            return CalibrationSequence("found", self._first.start, first)
        spins = action_sequences(
            np.radians(plan.poses), turns=plan.turns, spin_rate=np.radians(plan.rate),
            before=float(plan.before), rest=float(plan.after), rate=self.moves,
        )  # fmt: skip
        actions = (*first, *self._between, *spins.actions)
        return CalibrationSequence("found", self._first.start, actions)

    @cached_property
    def _between(self) -> tuple[Rotate, ...]:
        """Turns from the end of the first part to where both gimbals are at zero."""
        return turns_to(self._first.attitudes[-1], np.eye(3), rate=self.moves)

    # -- how plans are varied

    def draw(self, rng: np.random.Generator) -> SpinPlan:
        """Return a random plan; half of them have poses that are good by the closed form."""
        n = len(self._first.positions)
        some = rng.uniform(self.shortest, self.longest, 1 if self.alike else n)
        rests = self._begun(np.broadcast_to(some, n))
        if not self.poses:
            return self._fitted(SpinPlan(rests))
        poses = np.degrees(rng.uniform((-np.pi, -np.pi / 2), (np.pi, np.pi / 2), (self.poses, 2)))
        if self.poses >= 6 and rng.random() < 0.5:
            poses = np.degrees(best_poses(self.poses, starts=2, seed=int(rng.integers(2**31))))
        rate = np.degrees(self.rate) * (1.0 if rng.random() < 0.7 else rng.uniform(0.2, 1.0))
        before, after = int(rng.integers(0, 61)), int(rng.integers(0, 121))
        return self._fitted(SpinPlan(
            rests, self._stepped(poses), int(rng.integers(1, self.most + 1)), self._rate(rate),
            before if before >= self.shortest else 0, ceil(self.shortest) + after,
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
