"""Better motions for a torqued cluster: sequences of turns about its axes, judged by their bound.

A plan is a tuple of (turn, slots): which of the allowed rates, and for how many slots of time. The
bound is that of `kernels.cluster_information` at the latitude of the site and at errors of usual
size; how good the best plan is at other latitudes and with other errors is looked at in the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf, log
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.errors import Finding, error
from foucault.kernels.cluster_information import COLUMNS, information_pass
from foucault.kernels.cluster_plan import KNOWN, attitudes, commanded, remaining
from foucault.models.cluster import angles_of, attitude_of
from foucault.plans.tumble.limits import FEWEST, Allowed
from foucault.plans.tumble.reach import Reach, needs
from foucault.plans.tumble.torquing import Motion, Step, TorquingPlan
from foucault.plans.weights import require_seen

Turns = tuple[tuple[int, int], ...]

NO_ROWS: FloatArray = np.zeros((0, 3, COLUMNS))
NO_MOMENTS: npt.NDArray[np.int64] = np.zeros(0, np.int64)
"""Neither white rows nor the course in time are wanted."""

UNSEEN = 0.5
"""A coefficient that keeps more than this share of its prior is not seen [1]."""

SAMPLED = 48
"""So many random plans show together what can be seen at all [1]."""

TRIED = 40
"""Random plans that are drawn in search of such as keep the limits [1]."""

PARTS = 6
"""In so many points of a slot the gimbals are looked at: one per degree [1]."""

LOCK = float(np.radians(88.0))
"""Middle angle from which on the turns of outer and inner gimbal mean nothing [rad]."""

STRIDE = 0.05
"""Largest part of the whole time that one move shifts from one segment to another [1]."""


@dataclass(frozen=True)
class Conditions:
    """What the bound of a plan depends on beside the plan: local gravity is 1."""

    w_ie_n: FloatArray  # (3,) the Earth's rate in n [rad/s]
    constants: FloatArray  # (42,) where it is linearised, packed
    prior_sd: FloatArray  # (46,) of attitude [rad] and constants [packed], all above zero
    C_np: FloatArray  # (3, 3) true attitude at the start [1]
    gyro_psd: float  # white noise of the gyros [rad^2/s]
    accel_psd: float  # white noise of the accelerometers [local g^2 s]
    arms: FloatArray  # (3, 3) positions of the accelerometers [m]
    gravity: float  # local gravity [m/s^2]


@dataclass(frozen=True)
class TorquingSpace:
    """The torquing plans that are allowed; a `plans.optimise.Space`."""

    allowed: Allowed  # what the rig can do
    conditions: Conditions  # what the bound depends on
    # names, kinds: the 42 constants and the kinds of their units
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    weights: FloatArray  # (42,) how much each counts [1]
    reference: TorquingPlan  # the plan to beat
    reference_sd: FloatArray  # (42,) its bound over the prior [1]
    # bound over bound of the plan to beat that no constant that counts should exceed [1]
    worst: float
    cases: tuple[str, ...]  # circumstances in which plans are compared
    # sd that a calibration of a plan would state in one of them, shape (42,) [SI]
    stated: Callable[[TorquingPlan, str], FloatArray]
    findings: tuple[Finding, ...] = ()  # what was noticed of what is assumed

    @property
    def reference_name(self) -> str:
        """Name of the plan to beat."""
        return self.reference.name

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        return self.allowed.words

    # -- what is seen

    def bound(self, plan: Turns) -> FloatArray:
        """Return the bound over the prior of the 42 constants [1]."""
        return np.asarray(remaining(self.information(plan))[3:])

    def information(self, plan: Turns) -> FloatArray:
        """Return what a plan tells of attitude and constants, lower half, shape (45, 45) [1].

        One reading stands for the mean over a slot.
        """
        c, a, turns = self.conditions, self.allowed, np.array(plan)
        command = commanded(a.turns[turns[:, 0]], turns[:, 1], a.slot, self._start, c.w_ie_n)
        dt, reading, used = self._readings
        gram = information_pass(
            dt, command, reading, used, c.constants, c.prior_sd,
            np.ascontiguousarray(c.C_np), c.w_ie_n, c.gyro_psd,
            c.accel_psd / a.slot, c.arms, c.gravity, True, 1, NO_ROWS, NO_MOMENTS, 0.0,
        )[0][0]  # fmt: skip
        return np.ascontiguousarray(gram[:KNOWN, :KNOWN].T)

    @cached_property
    def _readings(self) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Length of the slots, readings, which do not matter, and that all of them count."""
        n = self.allowed.slots
        return np.full(n, self.allowed.slot), np.zeros((n, 3)), np.ones(n, bool)

    @cached_property
    def _start(self) -> FloatArray:
        return np.ascontiguousarray(attitude_of(self.allowed.start))

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Constants that no allowed plan shows; refuses where one of them counts."""
        rng = np.random.default_rng(0)
        plans = []
        for tried in range(TRIED):
            plan = self.draw(rng)
            if self.keeps_limits(plan):
                plans.append(plan)
            if len(plans) == SAMPLED or (not plans and tried == TRIED - 1):
                break
        if not plans:
            raise error("optimise.limits", tried=TRIED, limits=self.allowed.words)
        left = remaining(np.sum([self.information(plan) for plan in plans], axis=0))[3:]
        return require_seen(self.names, self.weights, left > UNSEEN, self.allowed.words)

    def keeps_limits(self, plan: Turns) -> bool:
        """Whether the gimbals can follow."""
        limited = bool(self.allowed.limits.angles)
        return not limited or self._keeps(Reach.of(self._path(plan, self._start)))

    def _keeps(self, reach: Reach) -> bool:
        limits = self.allowed.limits
        # Where the middle angle is 90 deg, outer and inner gimbal turn at will.
        return limits.keep(reach) and (limits.cable is None or reach.middle < LOCK)

    def _path(self, plan: Turns, C_pn: FloatArray) -> FloatArray:
        turns = np.array(plan)
        rates, slot = self.allowed.turns[turns[:, 0]], self.allowed.slot / PARTS
        return np.asarray(attitudes(rates, turns[:, 1] * PARTS, slot, C_pn))

    def hardly(self, plan: Turns) -> tuple[str, ...]:
        """Return what counts and this plan hardly shows."""
        left = (self.bound(plan) > UNSEEN) & (self.weights > 0)
        return tuple(name for name, is_left in zip(self.names, left, strict=True) if is_left)

    def exact_cost(self, plan: Turns) -> float:
        """Return the cost by what a calibration would state at the site, limits kept exactly."""
        if not all(limit.kept for limit in self.needs(plan)):
            return inf
        here = self.cases[0]
        return self._weighed(np.log(self.sd(plan, here) / self.sd(self.reference, here)))

    def cost(self, plan: Turns) -> float:
        """Return the weighted mean logarithm of the ratios, and the excess of the worst."""
        if not self.keeps_limits(plan):
            return inf
        return self._weighed(np.log(self.bound(plan) / self.reference_sd))

    def _weighed(self, ratio: FloatArray) -> float:
        mean = float(self.weights @ ratio / self.weights.sum())
        if not np.isfinite(mean):
            return inf
        return mean + max(0.0, float(ratio[self.weights > 0].max()) - log(self.worst))

    def sd(self, plan: Turns | TorquingPlan, case: str) -> FloatArray:
        """Return the sd of the 42 constants that would be stated in one of `cases` [SI]."""
        return self.stated(self._whole(plan), case)

    # -- how plans are made

    def draw(self, rng: np.random.Generator) -> Turns:
        """Return a random plan; mostly one whose gimbals keep their limits."""
        a = self.allowed
        k = int(rng.integers(FEWEST, a.most + 1))
        cuts = np.sort(rng.choice(a.slots - k * a.least + k - 1, k - 1, replace=False))
        spare = np.diff([-1, *cuts, a.slots - k * a.least + k - 1]) - 1
        turns = rng.integers(len(a.turns), size=k).tolist()
        if a.limits.angles:
            turns = self._within(turns, (spare + a.least).tolist(), rng)
        return self._tidy([(t, int(s) + a.least) for t, s in zip(turns, spare, strict=True)])

    def _within(self, turns: list[int], slots: list[int], rng: np.random.Generator) -> list[int]:
        """Exchange turns that would take the gimbals beyond their limits, where others do not."""
        out: list[int] = []
        C, first = self._start, angles_of(self._start)
        wound = first
        for turn, n in zip(turns, slots, strict=True):
            for other in (turn, *rng.permutation(len(self.allowed.turns)).tolist()):
                path = self._path(((other, n),), C)
                angles = np.unwrap(np.vstack([wound, angles_of(path)[1:]]), axis=0)
                if self._keeps(Reach.since(self._start, first, path, angles)):
                    break
            out.append(other)
            C, wound = path[-1], angles[-1]
        return out

    def moved(self, plan: Turns, rng: np.random.Generator, heat: float) -> Turns:
        """Return a plan with one thing changed; shifts of time shrink with `heat`, shape () [1]."""
        new, k = list(plan), len(plan)
        i, j = int(rng.integers(k)), int(rng.integers(k))
        turn = int(rng.integers(len(self.allowed.turns)))
        what = rng.random()
        if what < 0.2:
            new[i] = (turn, new[i][1])
        elif what < 0.55:
            most = 1 + int(heat * STRIDE * self.allowed.slots)
            shift = min(int(rng.integers(1, most + 1)), new[i][1])
            new[i] = (new[i][0], new[i][1] - shift)
            new[j] = (new[j][0], new[j][1] + shift)
        elif what < 0.65:
            new[i], new[j] = new[j], new[i]
        elif what < 0.8:
            if new[i][1] >= 2 * self.allowed.least:
                cut = int(rng.integers(self.allowed.least, new[i][1] - self.allowed.least + 1))
                new[i : i + 1] = [(new[i][0], cut), (turn, new[i][1] - cut)]
        elif what < 0.88:
            new.insert(j, new.pop(i))
        elif what < 0.95:
            a, b = min(i, j), max(i, j) + 1
            new[a:b] = new[a:b][::-1]
        else:
            new[i] = (turn, new[i][1])
            new[j] = (int(rng.integers(len(self.allowed.turns))), new[j][1])
        return self._tidy(new)

    def _tidy(self, plan: list[tuple[int, int]]) -> Turns:
        """Join neighbours that turn alike; give the time of segments too short to one beside."""
        out: list[tuple[int, int]] = []
        owed = 0
        for turn, slots in plan:
            if slots < self.allowed.least:
                owed += slots
            elif out and out[-1][0] == turn:
                out[-1] = (turn, out[-1][1] + slots + owed)
                owed = 0
            else:
                out.append((turn, slots + owed))
                owed = 0
        if owed:
            out[-1] = (out[-1][0], out[-1][1] + owed)
        return tuple(out)

    # -- what is written of them

    def torquing(self, plan: Turns) -> TorquingPlan:
        """Return a plan as it is commanded."""
        a = self.allowed
        steps = []
        for turn, slots in plan:
            rate, time = a.turns[turn], slots * a.slot
            words = " ".join(f"{v:+z.4g}" for v in np.degrees(rate * time))
            steps.append(Step(rate, time, f"by {words} deg"))
        return TorquingPlan("found", a.start, tuple(steps), a.ramp)

    def _whole(self, plan: Turns | TorquingPlan) -> TorquingPlan:
        return plan if isinstance(plan, TorquingPlan) else self.torquing(plan)

    def as_json(self, plan: Turns) -> list[list[int]]:
        """Return a plan as a list of turn and slots."""
        return [list(pair) for pair in plan]

    def from_json(self, plain: Any) -> Turns:
        """Return the plan that `as_json` wrote."""
        return tuple((int(turn), int(slots)) for turn, slots in plain)

    def changes(self, plan: Turns) -> Mapping[str, Mapping[str, Any]]:
        """Return the keys of [procedure] that make a campaign do this plan."""
        steps = [
            {
                "rate": [f"{v:z.12g} deg/s" for v in np.degrees(step.rate)],
                "time": f"{step.time!r} s",
            }
            for step in self.torquing(plan).steps
        ]
        return {"procedure": {"plan": None, "rate": None, "segment": None, "steps": steps}}

    def motion(self, plan: Turns | TorquingPlan) -> Motion:
        """Return beginning, end [s] and rates [rad/s] of every step."""
        return self._whole(plan).motion

    def needs(self, plan: Turns | TorquingPlan) -> tuple[Limit, ...]:
        """Return what of the rig the plan needs, and how much of it is allowed."""
        return needs(self._whole(plan), self.allowed.limits)

    def steps(self, plan: Turns | TorquingPlan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table: time, rates and angle of every step."""
        rows: list[tuple[str, ...]] = [
            ("from (s)", "to (s)", "x (deg/s)", "y (deg/s)", "z (deg/s)", "turn (deg)")
        ]
        for begins, ends, rate in self.motion(plan):
            rates = [f"{v:z.4g}" for v in np.degrees(rate)]
            angle = np.degrees(np.linalg.norm(rate) * (ends - begins))
            rows.append((f"{begins:g}", f"{ends:g}", *rates, f"{angle:.4g}"))
        return tuple(rows)

    def duration(self, plan: Turns | TorquingPlan) -> float:
        """Return the time that the plan takes [s]."""
        return self._whole(plan).duration
