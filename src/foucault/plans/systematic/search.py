"""Search for a sequence of a systematic calibration: rests, poses, turns and rate of its spins.

A plan has two parts: one of the built-in sequences of quarter turns, whose rests are open, and
spins about North in poses that are open, after and before rests that are open (see
`built_in.action_sequences`). Either the uncertainty is made small in a given time, or
the time for a wanted uncertainty.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf, log
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.diagnose.systematic.rests import LEAST_TURN
from foucault.errors import Finding, FoucaultError
from foucault.plans.manoeuvres import Rotate
from foucault.plans.optimise import DRAWS
from foucault.plans.systematic.moves import Allowed, SpinPlan
from foucault.plans.systematic.sequence import CalibrationSequence
from foucault.plans.systematic.steps import plain_action, plain_start, rows
from foucault.plans.weights import require_seen

PULL = 10.0
"""Cost of a wanted uncertainty that is missed, per its logarithm: more than any time saved [1]."""

MARGIN = 0.995
"""The search, whose uncertainties are a little off, wants so much of what is wanted [1]."""

UNSEEN = 0.7
"""A coefficient that keeps more than this share of its prior is not seen [1]."""

CLEAR = 2.0
"""Turns are at least so many times as large as the least that is found in a log [1]."""

SAMPLED = 4
"""Random plans that show what can be seen at all, beside the plan to beat [1]."""


@dataclass(frozen=True)
class SystematicSpace:
    """The sequences that are allowed, and how good each of them is; a `plans.optimise.Space`."""

    allowed: Allowed  # what may be done
    # names, kinds: the coefficients that are estimated, and the kinds of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (p,) how much each counts [1]
    prior_sd: FloatArray  # (p,) uncertainty beforehand [SI]
    # coefficient or group -> largest sd that is wanted; then the shortest time is sought [SI]
    accuracy: Mapping[str, float]
    reference: CalibrationSequence  # the plan to beat
    reference_name: str  # what to call it
    cases: tuple[str, ...]  # circumstances in which plans are compared
    # sequence -> sd of the coefficients, nearly, shape (p,) [SI]
    quick: Callable[[CalibrationSequence], FloatArray]
    # sequence, case -> sd that a calibration would state, shape (p,) [SI]
    stated: Callable[[CalibrationSequence, str], FloatArray]
    findings: tuple[Finding, ...] = ()  # what was noticed of what is assumed

    @property
    def aim(self) -> str:
        """What is made small: "time" for a wanted accuracy, else "sd"."""
        return "time" if self.accuracy else "sd"

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        wanted = [f"{n} to {sd_limit(n, self._kind(n), sd, sd).said_needed}"
                  for n, sd in self.accuracy.items()]  # fmt: skip
        return ", ".join([self.allowed.words, *wanted])

    def _members(self, name: str) -> list[int]:
        return [k for k, n in enumerate(self.names) if n == name or n.startswith(f"{name}.")]

    def _kind(self, name: str) -> str:
        return self.kinds[self._members(name)[0]]

    # -- how good plans are

    @cached_property
    def _reference_sd(self) -> FloatArray:
        return self.quick(self.reference)

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Coefficients that no allowed plan shows; refuses where one of them counts."""
        rng, least = np.random.default_rng(0), np.full(len(self.names), inf)
        plans = [p for p in (self.draw(rng) for _ in range(DRAWS // 10)) if self.fits(p)]
        for plan in plans[:SAMPLED]:
            least = np.minimum(least, self.quick(self.allowed.sequence(plan)))
        if not plans:
            least = np.zeros(len(self.names))  # the search will say that no plan fits
        blind = least > UNSEEN * self.prior_sd
        counts = self.weights > 0
        for name in self.accuracy:
            counts[self._members(name)] = True
        return require_seen(self.names, counts.astype(float), blind, self.limits)

    def fits(self, plan: SpinPlan) -> bool:
        """Whether a plan keeps time and rests, with turns that can be found in a log."""
        a, sequence = self.allowed, self.allowed.sequence(plan)
        least = min((*plan.rests, plan.after if plan.poses else inf))
        turn = min(abs(t.angle) for t in sequence.actions if isinstance(t, Rotate))
        in_time = sequence.duration <= a.total * (1 + 1e-12)
        return least >= a.shortest and turn >= CLEAR * LEAST_TURN and in_time

    def cost(self, plan: SpinPlan) -> float:
        """Return the cost by the quick uncertainties; infinite beyond the limits."""
        if not self.fits(plan):
            return inf
        return self._priced(
            plan, self.quick(self.allowed.sequence(plan)), self._reference_sd, MARGIN
        )

    def exact_cost(self, plan: SpinPlan) -> float:
        """Return the cost by what a calibration would state; infinite beyond what is wanted."""
        here = self.cases[0]
        try:
            sd = self.sd(plan, here)
        except FoucaultError:  # a calibration would refuse it: rests that it does not find, say
            return inf
        missed = any(sd[self._members(n)].max() > limit for n, limit in self.accuracy.items())
        if missed or not self.fits(plan):
            return inf
        return self._priced(plan, sd, self.sd(self.reference, here), 1.0)

    def _priced(
        self, plan: SpinPlan, sd: FloatArray, reference: FloatArray, margin: float
    ) -> float:
        if self.accuracy:
            missed = sum(
                max(0.0, log(float(sd[self._members(name)].max()) / (margin * limit)))
                for name, limit in self.accuracy.items()
            )
            return log(self.duration(plan) / self.reference.duration) + PULL * missed
        return float(self.weights @ np.log(sd / reference) / self.weights.sum())

    def sd(self, plan: SpinPlan | CalibrationSequence, case: str) -> FloatArray:
        """Return the sd of every coefficient that would be stated in one of `cases` [SI]."""
        return self.stated(self._whole(plan), case)

    def hardly(self, plan: SpinPlan) -> tuple[str, ...]:
        """Return what counts and this plan hardly shows."""
        left = (self.quick(self.allowed.sequence(plan)) > UNSEEN * self.prior_sd) & (
            self.weights > 0
        )
        return tuple(name for name, is_left in zip(self.names, left, strict=True) if is_left)

    # -- how plans are made

    def draw(self, rng: np.random.Generator) -> SpinPlan:
        """Return a random plan; half of them have poses that are good by the closed form."""
        return self.allowed.draw(rng)

    def moved(self, plan: SpinPlan, rng: np.random.Generator, heat: float) -> SpinPlan:
        """Return a neighbour: a pose, an order, a rest, turns or rate changed.

        Shifts shrink with `heat`, shape () [1].
        """
        return self.allowed.moved(plan, rng, heat)

    # -- what is written of them

    def _whole(self, plan: SpinPlan | CalibrationSequence) -> CalibrationSequence:
        return plan if isinstance(plan, CalibrationSequence) else self.allowed.sequence(plan)

    def as_json(self, plan: SpinPlan) -> dict[str, Any]:
        """Return a plan as plain values."""
        return {
            "rests": list(plan.rests), "poses": [list(pose) for pose in plan.poses],
            "turns": plan.turns, "rate": plan.rate, "before": plan.before, "after": plan.after,
        }  # fmt: skip

    def from_json(self, plain: Any) -> SpinPlan:
        """Return the plan that `as_json` wrote."""
        return SpinPlan(
            tuple(int(t) for t in plain["rests"]),
            tuple((float(a), float(b)) for a, b in plain["poses"]),
            int(plain["turns"]), float(plain["rate"]), int(plain["before"]), int(plain["after"]),
        )  # fmt: skip

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
        return rows(self._whole(plan))

    def duration(self, plan: SpinPlan | CalibrationSequence) -> float:
        """Return the time that the plan takes [s]."""
        return self._whole(plan).duration

    def needs(self, plan: SpinPlan | CalibrationSequence) -> tuple[Limit, ...]:
        """Return what a plan needs of time and table, what it attains, and what is allowed."""
        a, sequence = self.allowed, self._whole(plan)
        out = [
            Limit("time", "time", sequence.duration, None if a.total == inf else a.total),
            *table_needs(sequence, None if a.rate == inf else a.rate, a.step),
        ]
        sd = self.sd(sequence, self.cases[0]) if self.accuracy else np.zeros(0)
        for name, limit in self.accuracy.items():
            most = float(sd[self._members(name)].max())
            out.append(sd_limit(name, self._kind(name), most, limit))
        return tuple(out)


def sd_limit(name: str, kind: str, sd: float, wanted: float) -> Limit:
    """Return what is attained of a wanted accuracy.

    `sd`: the largest of it [SI]; `wanted`: what is wanted [SI].
    """
    return Limit(f"largest sd of {name}", kind, sd, wanted, units.display_unit(kind, wanted))


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
