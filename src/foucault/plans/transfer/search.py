"""Search for manoeuvres that show a slave's errors before its master falls silent.

A plan is a list of manoeuvres, the last of which goes straight on for what is left of the time.
What it shows is the covariance of a filter beside a master without noise, see
`procedures.transfer_alignment.foresight`; either the coefficients count, or what all errors
together make of the position after an outage.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.errors import Finding
from foucault.plans.manoeuvre_table import plain_manoeuvre
from foucault.plans.manoeuvres import Accelerate, Climb, Segment, Straight, STurn, Sway, Turn
from foucault.plans.transfer.moves import Flyable, Step, Steps, needs_of
from foucault.plans.transfer.profiles import TransferProfile
from foucault.plans.weights import require_seen

POSITION = "position after the outage"

UNSEEN = 0.9
"""A coefficient that keeps more than this share of its prior is not seen [1]."""


@dataclass(frozen=True)
class TransferSpace:
    """The motions that a vehicle can do, and how good each is; a `plans.optimise.Space`."""

    allowed: Flyable  # what the vehicle may do
    # names, kinds: coefficients and `POSITION`, and the kinds of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (p,) how much each counts [1]
    prior_sd: FloatArray  # (p,) uncertainty beforehand; infinite for the position [SI]
    reference: TransferProfile  # the motion to beat
    cases: tuple[str, ...]  # circumstances in which motions are compared
    quick: Callable[[TransferProfile], FloatArray]  # motion -> sds, nearly, shape (p,) [SI]
    # motion, case -> sds that a calibration would state, shape (p,) [SI]
    stated: Callable[[TransferProfile, str], FloatArray]
    findings: tuple[Finding, ...] = ()  # what was noticed of what is assumed

    @property
    def reference_name(self) -> str:
        """What the motion to beat is called."""
        return self.reference.name

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        return self.allowed.words

    @property
    def begin(self) -> Steps | None:
        """The motion to beat as a plan, where it is one."""
        return self.allowed.steps(self.reference)

    # -- how good plans are

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Coefficients that no motion shows, by one that does all there is in turn."""
        a = self.allowed
        each = max(a.shortest, a.total // (2 * len(a.kinds)))
        rng, least = np.random.default_rng(0), np.full(len(self.names), inf)
        some = [tuple(a.some(rng, each) for _ in range(a.most)) for _ in range(40)]
        for plan in [p for p in some if a.fits(p)][:4]:
            least = np.minimum(least, self.quick(a.profile(plan)))
        if np.isinf(least).all():
            return ()  # the search will say that no plan fits
        return require_seen(self.names, self.weights, least > UNSEEN * self.prior_sd, self.limits)

    @cached_property
    def _reference_sd(self) -> FloatArray:
        return self.quick(self.reference)

    def cost(self, plan: Steps | None) -> float:
        """Return the weighted mean of log sd over sd of the motion to beat; infinite beyond limits.

        `plan` or None: a plan.
        """
        if plan is None or not self.allowed.fits(plan):
            return inf
        return self._priced(self.quick(self.allowed.profile(plan)), self._reference_sd)

    def exact_cost(self, plan: Steps) -> float:
        """Return the same by what a calibration would state."""
        here = self.cases[0]
        return self._priced(self.sd(plan, here), self.sd(self.reference, here))

    def _priced(self, sd: FloatArray, reference: FloatArray) -> float:
        return float(self.weights @ np.log(sd / reference) / self.weights.sum())

    def sd(self, plan: Steps | TransferProfile, case: str) -> FloatArray:
        """Return the sds that would be stated in one of `cases` [SI]."""
        return self.stated(self._whole(plan), case)

    def hardly(self, plan: Steps) -> tuple[str, ...]:
        """Return what counts and this plan hardly shows."""
        left = self.quick(self.allowed.profile(plan)) > UNSEEN * self.prior_sd
        return tuple(n for n, w, x in zip(self.names, self.weights, left, strict=True) if x and w)

    # -- how plans are made

    def draw(self, rng: np.random.Generator) -> Steps:
        """Return a random plan."""
        return self.allowed.draw(rng)

    def moved(self, plan: Steps, rng: np.random.Generator, heat: float) -> Steps:
        """Return a neighbour; shifts shrink with `heat`, shape () [1]."""
        return self.allowed.moved(plan, rng, heat)

    # -- what is written of them

    def _whole(self, plan: Steps | TransferProfile) -> TransferProfile:
        return plan if isinstance(plan, TransferProfile) else self.allowed.profile(plan)

    def as_json(self, plan: Steps) -> list[list[Any]]:
        """Return a plan as plain values."""
        return [[s.kind, s.amount, s.time] for s in plan]

    def from_json(self, plain: Any) -> Steps:
        """Return the plan that `as_json` wrote."""
        return tuple(Step(kind, int(amount), int(time)) for kind, amount, time in plain)

    def changes(self, plan: Steps) -> Mapping[str, Mapping[str, Any]]:
        """Return the keys of [simulate] that make a campaign do this plan."""
        segments = self.allowed.profile(plan).calibration
        return {"simulate": {"manoeuvres": [plain_manoeuvre(s) for s in segments]}}

    def steps(self, plan: Steps | TransferProfile) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table: what is done when."""
        rows, at = [("from", "to", "manoeuvre")], 0.0
        for segment in self._whole(plan).calibration:
            rows.append((f"{at:g} s", f"{at + segment.time:g} s", words(segment)))
            at += segment.time
        return tuple(rows)

    def duration(self, plan: Steps | TransferProfile) -> float:
        """Return the time that the plan takes [s]."""
        return self._whole(plan).hand_over

    def needs(self, plan: Steps | TransferProfile) -> tuple[Limit, ...]:
        """Return what a plan asks of the vehicle, and what it allows."""
        profile, a = self._whole(plan), self.allowed
        n = needs_of(profile)
        return (
            Limit("time", "time", profile.hand_over, float(a.total)),
            Limit("bank", "angle", n.bank, a.bank, "deg"),
            Limit("acceleration", "specific force", n.acceleration, a.acceleration, "m/s^2"),
            Limit("angle of climb", "angle", n.climb, a.climb, "deg"),
            Limit("speed", "velocity", n.fastest, a.fastest, "m/s"),
            Limit("height above or below the start", "length", max(n.highest, -n.lowest),
                  a.height, "m"),
        )  # fmt: skip


def words(segment: Segment) -> str:
    """Return what a manoeuvre is, in words."""
    match segment:
        case Turn() | STurn():
            side = "right" if segment.angle > 0 else "left"
            kind = "turn" if isinstance(segment, Turn) else "S-turn"
            return f"{kind} of {abs(np.degrees(segment.angle)):.3g} deg to the {side}"
        case Accelerate():
            return f"speed to {segment.speed:.4g} m/s"
        case Climb(height=float(height)):
            return f"{'climb' if height > 0 else 'descend'} by {abs(height):.4g} m"
        case Straight():
            return "straight on"
        case Sway():
            return f"sway, period {segment.period:g} s"
    return type(segment).__name__.lower()
