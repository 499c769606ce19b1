"""Which stops of a north seeker show the heading best: the space of a search.

A plan is a sequence of stops, index angle and length, that together with the moves between them
takes the time of a set-up. Angles are the detents, or multiples of 1 deg; lengths of 0.1 s: what
is found is what is written. The cost is the logarithm of the heading's root mean square error,
by `north_bound`, over that of the order to beat; comparisons are by `north_plan.predict`, which
solves readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import degrees, inf, isfinite, log, radians
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.diagnose.north.input import spans
from foucault.diagnose.north.plan import poses, predict
from foucault.errors import Finding, error
from foucault.models.dwells import Dwells
from foucault.plans.north.bound import Known, root_mean_square, seen
from foucault.plans.north.moves import (
    DEGREE,
    TICK,
    UNIT,
    Moves,
    Rig,
    Schedule,
    across,
    reduced,
)
from foucault.units import span

TILTED = radians(10.0)
"""Up to which the case is tilted in one of the comparisons [rad]."""

ELSEWHERE = radians(60.0)
"""Latitude of another, north or south as the site is [rad]."""

DRAWN = 100
"""Random plans by which it is told whether any shows the heading [1]."""

PLAIN = 2e-4
"""What a stop, or another index angle, costs: of plans that are alike the simpler is wanted [1]."""


@dataclass(frozen=True)
class NorthSpace:
    """Orders of stops that a base allows: a `plans.optimise.Space`."""

    rig: Rig  # what the base can do
    known: Known  # instrument, place, and what the solution is told [SI]
    beaten: Schedule  # the order to beat; it may be one that the base cannot do
    reference_name: str  # what to call it
    findings: tuple[Finding, ...] = ()  # what the user should know

    names = ("heading",)
    kinds = ("angle",)
    unseen = ()

    def __post_init__(self) -> None:
        if self.moves.fits(2) is None:
            least = 2 * (self.rig.shortest + self.rig.settle) + self.rig.move
            raise error("north_search.too_short", given=span(self.rig.total), least=span(least),
                        stop=span(self.rig.shortest + self.rig.settle))  # fmt: skip

    @property
    def weights(self) -> FloatArray:
        """The heading is all there is [1]."""
        return np.ones(1)

    @property
    def reference(self) -> Schedule:
        """The order to beat."""
        return self.beaten

    @property
    def cases(self) -> tuple[str, ...]:
        """Where plans are compared: beside the site's level set-up, tilted and elsewhere."""
        tilted = f"tilted by up to {degrees(TILTED):.0f} deg"
        away = f"at latitude {degrees(self._elsewhere):.0f} deg"
        return ("level", tilted, away)

    @property
    def _elsewhere(self) -> float:
        return -ELSEWHERE if self.known.conditions.latitude < 0 else ELSEWHERE

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        limit, r = self.rig.index_limit, self.rig
        words = [] if limit == inf else [f"index angles up to {degrees(limit):g} deg"]
        words += [] if r.index_step is None else [f"detents every {degrees(r.index_step):g} deg"]
        words += ["opposite stops"] if r.opposite else []
        return ", ".join([*words, f"at most {r.most} stops in {span(r.total)}"])

    def shows(self) -> bool:
        """Tell whether any of many random plans shows the heading."""
        rng = np.random.default_rng(0)
        return len(self.moves.angles) > 1 and any(
            isfinite(self.cost(self.draw(rng))) for _ in range(DRAWN)
        )

    # -- plans ---------------------------------------------------------------------------------

    @cached_property
    def moves(self) -> Moves:
        """How plans are drawn and changed."""
        return Moves(self.rig)

    def draw(self, rng: np.random.Generator) -> Schedule:
        """Return a random plan that the rig allows."""
        return self.moves.draw(rng) or self.beaten

    def moved(self, plan: Schedule, rng: np.random.Generator, heat: float) -> Schedule:
        """Return a neighbour of `plan`.

        `heat`: 1 at the beginning, 0 at the end: how large moves are [1].
        """
        return self.moves.moved(plan, rng, heat)

    # -- how good they are ---------------------------------------------------------------------

    def cost(self, plan: Schedule) -> float:
        """Return the logarithm of the sd over that of the order to beat, level; and `PLAIN`."""
        if not self._can(plan):
            return inf
        value = self._price(plan)
        return value - self._to_beat if isfinite(value) else inf

    @cached_property
    def _to_beat(self) -> float:
        value = self._price(self.beaten)
        return value if isfinite(value) else 0.0

    def _price(self, plan: Schedule) -> float:
        value = self._bound(plan)
        return log(value) + PLAIN * (len(plan) + len(set(plan.index))) if isfinite(value) else inf

    def _can(self, plan: Schedule) -> bool:
        there = {reduced(a) for a in plan.index}
        if not there <= self.moves.allowed:
            return False
        if max(abs(a) for a in plan.index) * UNIT > self.rig.index_limit * (1 + 1e-9):
            return False
        if self._spread and not spans(sorted({round(a / DEGREE) % 360 for a in there})):
            return False
        return not self.rig.opposite or all(across(a) in there for a in there)

    @property
    def _spread(self) -> bool:
        """Whether stops along one line are refused, as a fix refuses them."""
        by_level = self.known.on_case or self.known.conditions.level_sd is not None
        return self.known.rough_sd is None or not by_level

    def _bound(self, plan: Schedule) -> float:
        if min(plan.dwell) * TICK <= self.rig.settle:  # the order to beat may not fit the time
            return inf
        return root_mean_square(*self._times(plan), self.known)

    def _times(self, plan: Schedule) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return index angle, beginning and length of what is measured of each stop."""
        length = TICK * np.array(plan.dwell, float)
        start = np.cumsum(length + self.rig.move) - length - self.rig.move
        angle = UNIT * np.array(plan.index, float)
        return angle, start + self.rig.settle, length - self.rig.settle

    def sd(self, plan: Schedule, case: str) -> FloatArray:
        """Return the root mean square error of the heading in one of `cases`, shape (1,) [rad]."""
        c = self.known.conditions
        if case == self.cases[1]:
            c = replace(c, tilt=TILTED)
        elif case == self.cases[2]:
            c = replace(c, latitude=self._elsewhere)
        if not isfinite(self._bound(plan)):
            return np.array([inf])
        owed = seen(*self._times(plan), self.known).drift_sd
        ignored = owed == 0 and self.known.drift > 0
        c = replace(c, drift=self.known.drift if ignored else owed, drift_estimated=not ignored)
        at = poses(c.tilt)
        found = predict(self._dwells(plan, at), at, c, near=self.known.rough_sd is not None,
                        drift=False, on_case=self.known.on_case)  # fmt: skip
        return np.array([found.sd])

    def _dwells(self, plan: Schedule, at: FloatArray) -> Dwells:
        """Return the stops of set-ups at many headings, with readings still zero."""
        angle, start, time = self._times(plan)
        m, k = len(at), len(plan)
        index = np.broadcast_to(angle, (m, k)).copy()
        if self.known.rough_sd is not None:  # wrong either way, heading by heading
            wrong = np.where(np.unique(at[:, 0], return_inverse=True)[1] % 2, -1.0, 1.0)
            index -= (at[:, 0] + wrong * self.known.rough_sd)[:, None]
        flat, zero = index.ravel(), np.zeros(m * k)
        return Dwells(
            np.repeat(np.arange(m), k), tuple(str(i) for i in range(m)), np.tile(start, m),
            np.tile(time, m), flat, np.cos(flat), np.sin(flat), zero, zero[:, None],
            np.full(m, np.nan),
        )  # fmt: skip

    # -- plans as text -------------------------------------------------------------------------

    def as_json(self, plan: Schedule) -> dict[str, list[int]]:
        """Return a plan as plain values."""
        return {"index": list(plan.index), "dwell": list(plan.dwell)}

    def from_json(self, plain: Mapping[str, Any]) -> Schedule:
        """Return the plan that `as_json` wrote, here `plain`."""
        return Schedule(tuple(plain["index"]), tuple(plain["dwell"]))

    def changes(self, plan: Schedule) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file.

        `plan`: a plan. One that counts from north is for a fix: one set-up that faces north.
        """
        order = [{"index": f"{a} deg", "dwell": f"{t} s"} for a, t in self._texts(plan)]
        if self.known.rough_sd is None:
            return {"simulate": {"order": order}}
        near = {"near": "0 deg", "near_sd": f"{degrees(self.known.rough_sd):.12g} deg"}
        return {"procedure": near, "simulate": {"order": order, "headings": 1}}

    def _texts(self, plan: Schedule) -> list[tuple[str, str]]:
        angle = [f"{a / DEGREE:.10g}" for a in plan.index]
        return list(zip(angle, [f"{TICK * t:.10g}" for t in plan.dwell], strict=True))

    def steps(self, plan: Schedule) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per stop."""
        counted = "index from north (deg)" if self.known.rough_sd is not None else "index (deg)"
        start = self._times(plan)[1] - self.rig.settle
        rows = [
            (f"{round(s, 1):.10g}", a, t)
            for (a, t), s in zip(self._texts(plan), start, strict=True)
        ]
        return (("start (s)", counted, "dwell (s)"), *rows)

    def needs(self, plan: Schedule) -> tuple[Limit, ...]:
        """Return what a plan needs of the base."""
        widest = UNIT * max(abs(a) for a in plan.index)
        allowed = None if self.rig.index_limit == inf else self.rig.index_limit
        return (Limit("index angle", "angle", widest, allowed),)

    def duration(self, plan: Schedule) -> float:
        """Return the time of a set-up, moves included [s]."""
        return TICK * sum(plan.dwell) + (len(plan) - 1) * self.rig.move
