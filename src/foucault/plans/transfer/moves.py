"""What is open of a motion before a hand-over in a search, and how it is varied."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import atan, degrees, radians
from typing import Literal

import numpy as np

from foucault import units
from foucault.plans.manoeuvres import Accelerate, Climb, Segment, Straight, STurn, Turn
from foucault.plans.transfer.profiles import TransferProfile

Kind = Literal["straight", "turn", "s_turn", "accelerate", "climb"]

KINDS: tuple[Kind, ...] = ("straight", "turn", "s_turn", "accelerate", "climb")

TURNS, S_TURNS = 180, 90
"""Largest turn, and first part of an S-turn [deg]."""

STEP = 5
"""Angles and heights are multiples of it [deg], [m]."""

G = 9.80665


@dataclass(frozen=True)
class Step:
    """A manoeuvre in the numbers that are written."""

    kind: Kind
    amount: int  # angle [deg], speed to reach [m/s] or height to climb [m]; 0 for a straight run
    time: int  # how long it takes [s]


Steps = tuple[Step, ...]


@dataclass(frozen=True)
class Needs:
    """What a plan asks of the vehicle at most."""

    # angle of bank, or in a flat turn the sideways acceleration as the angle of its force [rad]
    bank: float
    acceleration: float  # along the path [m/s^2]
    climb: float  # angle of climb or descent [rad]
    # slowest, fastest: speed [m/s]
    slowest: float
    fastest: float
    # lowest, highest: height against that of the start [m]
    lowest: float
    highest: float


@dataclass(frozen=True)
class Flyable:
    """What the vehicle may do."""

    start: TransferProfile  # where and how it begins; its manoeuvres do not count
    total: int  # time there is [s]
    most: int  # manoeuvres at most, straight runs among them [1]
    shortest: int  # shortest manoeuvre [s]
    # slowest, fastest: speed [m/s]
    slowest: float
    fastest: float
    bank: float  # largest angle of bank, see `Needs` [rad]
    acceleration: float  # largest along the path [m/s^2]
    climb: float  # largest angle of climb; 0 for vehicles that do not [rad]
    height: float  # how far above and below the start it may go [m]
    flat: bool  # whether it turns without rolling

    @property
    def words(self) -> str:
        """What is allowed, in words."""
        out = [
            f"at most {self.most} manoeuvres in {units.span(self.total)}",
            f"{self.slowest:.4g} to {self.fastest:.4g} m/s",
            f"{'sideways force as of a bank' if self.flat else 'bank'} up to "
            f"{degrees(self.bank):.4g} deg",
            f"acceleration up to {self.acceleration:.3g} m/s^2",
        ]
        if self.climb > 0:
            out.append(f"climbs up to {degrees(self.climb):.3g} deg and {self.height:.4g} m")
        return ", ".join(out)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What may be done."""
        speeds, heights = self.fastest - self.slowest >= 1.0, self.climb > 0 and self.height >= STEP
        able = {"accelerate": speeds, "climb": heights}
        return tuple(k for k in KINDS if able.get(k, True))

    def segment(self, step: Step) -> Segment:
        """Return a manoeuvre as it is done."""
        amount, time = float(step.amount), float(step.time)
        match step.kind:
            case "turn":
                return Turn(radians(amount), time, not self.flat)
            case "s_turn":
                return STurn(radians(amount), time, not self.flat)
            case "accelerate":
                return Accelerate(amount, time)
            case "climb":
                return Climb(time, height=amount)
        return Straight(time)

    def profile(self, plan: Steps) -> TransferProfile:
        """Return a plan as it is done; what is left of the time it goes straight on."""
        left = self.total - sum(step.time for step in plan)
        last = (Straight(float(left)),) if left > 0 else ()
        segments = (*(self.segment(step) for step in plan), *last)
        return replace(self.start, name="found", calibration=segments)

    def steps(self, profile: TransferProfile) -> Steps | None:
        """Return a motion in whole numbers, None where it is not of such manoeuvres."""
        out = []
        for s in profile.calibration:
            step = _step(s)
            if step is None or self.segment(step) != s:
                return None
            out.append(step)
        return tuple(out)

    # -- what it asks for

    def fits(self, plan: Steps) -> bool:
        """Whether the vehicle can do it in the time."""
        if len(plan) > self.most or sum(s.time for s in plan) > self.total:
            return False
        if any(s.time < self.shortest for s in plan):
            return False
        n, near = needs_of(self.profile(plan)), 1.0 + 1e-9
        return (
            n.bank <= self.bank * near
            and n.acceleration <= self.acceleration * near
            and n.climb <= self.climb * near
            and self.slowest / near <= n.slowest
            and n.fastest <= self.fastest * near
            and max(n.highest, -n.lowest) <= self.height * near
        )

    # -- how plans are varied

    def draw(self, rng: np.random.Generator) -> Steps:
        """Return a random plan; many are not allowed."""
        n = int(rng.integers(2, self.most + 1))
        times = self._times(rng.dirichlet(np.ones(n + 1)))
        return tuple(self.some(rng, time) for time in times[:n])

    def _times(self, shares: np.ndarray) -> list[int]:
        spare = self.total - len(shares) * self.shortest
        return [self.shortest + int(spare * share) for share in shares]

    def some(self, rng: np.random.Generator, time: int) -> Step:
        """Return a random manoeuvre of so many seconds, `time`, shape () [s]."""
        kind = self.kinds[int(rng.integers(len(self.kinds)))]
        return Step(kind, self._amount(rng, kind, time), time)

    def _amount(self, rng: np.random.Generator, kind: Kind, time: int) -> int:
        """Return an amount that the vehicle can reach in the time, where it is fast."""
        sign = int(rng.choice([-1, 1]))
        if kind == "accelerate":
            return int(rng.integers(int(np.ceil(self.slowest)), int(self.fastest) + 1))
        if kind == "climb":
            most = min(self.height, 0.5 * time * self.slowest * np.sin(self.climb))
            return sign * STEP * int(rng.integers(1, max(int(most / STEP), 1) + 1))
        # The rate of a turn peaks at twice its mean; a fourth of an S-turn is its first part.
        mean = 0.5 * degrees(G * np.tan(self.bank) / self.fastest) * time
        limit, most = (S_TURNS, mean / 4) if kind == "s_turn" else (TURNS, mean)
        most = min(limit, most) if kind != "straight" else 0
        return sign * STEP * int(rng.integers(1, max(int(most / STEP), 1) + 1)) * (most > 0)

    def moved(self, plan: Steps, rng: np.random.Generator, heat: float) -> Steps:
        """Return a neighbour: an amount, times, an order or a manoeuvre changed.

        Shifts shrink with `heat`, shape () [1].
        """
        steps, what = list(plan), rng.random()
        if not steps:
            return self.draw(rng)
        k = int(rng.integers(len(steps)))
        size = 1 + int(6 * heat * rng.random())
        if what < 0.35:
            unit = 1 if steps[k].kind == "accelerate" else STEP
            moved = steps[k].amount + int(rng.choice([-1, 1])) * unit * size
            if steps[k].kind != "straight":
                steps[k] = replace(steps[k], amount=moved)
        elif what < 0.65:  # time goes to another manoeuvre, or to the straight run at the end
            shift = min(2 * size, steps[k].time - self.shortest)
            steps[k] = replace(steps[k], time=steps[k].time - shift)
            other = int(rng.integers(len(steps) + 1))
            if rng.random() < 0.3:
                other, shift = k, min(2 * shift + 1, self.total - sum(s.time for s in plan))
            if other < len(steps):
                steps[other] = replace(steps[other], time=steps[other].time + shift)
        elif what < 0.75:
            j = int(rng.integers(len(steps)))
            steps[j], steps[k] = steps[k], steps[j]
        elif what < 0.9:
            steps[k] = self.some(rng, steps[k].time)
        elif what < 0.95 and len(steps) > 1:
            del steps[k]
        elif len(steps) < self.most and steps[k].time >= 2 * self.shortest:
            half = steps[k].time // 2
            steps[k] = replace(steps[k], time=steps[k].time - half)
            steps.insert(k, self.some(rng, half))
        return tuple(steps)


def _step(segment: Segment) -> Step | None:
    match segment:
        case Straight():
            return Step("straight", 0, round(segment.time))
        case Turn():
            return Step("turn", round(degrees(segment.angle)), round(segment.time))
        case STurn():
            return Step("s_turn", round(degrees(segment.angle)), round(segment.time))
        case Accelerate():
            return Step("accelerate", round(segment.speed), round(segment.time))
        case Climb(height=float(height)):
            return Step("climb", round(height), round(segment.time))
    return None


def needs_of(profile: TransferProfile) -> Needs:
    """Return what a motion before its hand-over asks of the vehicle; a sway asks for nothing."""
    v = [float(profile.start.speed)]
    h, bank, along, climb = [0.0], [0.0], [0.0], [0.0]
    for s, speed in _with_speed(profile):
        v.append(speed)
        match s:
            case Turn() | STurn():
                # Rates fade in and out over half of the time each unless a ramp is said.
                first = s.time / 4 if isinstance(s, STurn) else s.time
                ramp = (s.ramp or first / 2) if isinstance(s, Turn) else first / 2
                bank.append(atan(abs(s.angle) / (first - ramp) * speed / G))
            case Accelerate():
                along.append(abs(s.speed - speed) / (s.time - (s.ramp or s.time / 2)))
                v.append(s.speed)
            case Climb(height=float(height)):
                rise = abs(height) / (s.time - (s.ramp or s.time / 2))
                climb.append(float(np.arcsin(min(rise / speed, 1.0))) if speed > 0 else 0.0)
                h.append(h[-1] + height)
            case Climb(angle=float(angle)):
                climb.append(abs(angle))
    return Needs(max(bank), max(along), max(climb), min(v), max(v), min(h), max(h))


def _with_speed(profile: TransferProfile) -> Iterator[tuple[Segment, float]]:
    speed = float(profile.start.speed)
    for s in profile.calibration:
        yield s, speed
        if isinstance(s, Accelerate):
            speed = s.speed
