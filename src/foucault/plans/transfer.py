"""Motions on which a slave is calibrated against its master, and a search for better ones.

Each is a calibration, after which the master falls silent (the hand-over), and an outage, through
which the calibrated instrument navigates alone. The outages have turns in them: a straight one
hides an error of tilt that a bias of an accelerometer makes up for.

=============  ===================================================================================
flight         calibrated for 240 s at 40 to 52 m/s: 100 s of accelerations, a climb and steep
               turns (up to 19 deg/s, 15 m/s^2 sideways: 100 ms of delay are 1.9 deg of heading and
               1.5 m/s), then steady; an outage of 600 s. As in the publication [1]_, which gives
               these times and sizes and leaves the path open
survey         240 s and 600 s of a survey aircraft at 75 to 85 m/s: S-turns of 15 to 25 deg on
               the way to the first line, then lines of 90 to 120 s with half turns between them
straight       the survey aircraft, without any manoeuvre before the hand-over
uav            240 s and 600 s of a small aircraft at 18 to 25 m/s in gusts, with quick turns
ship           240 s and 600 s of a ship at 6 m/s in a swell of 9 s, roll 5 deg, with slow turns
=============  ===================================================================================

The swell of the ship, and the gusts of the small aircraft, fade in and out within some seconds
where one segment follows another.

What is sought are manoeuvres that show the slave's errors before its master falls silent. A plan is
a list of manoeuvres, the last of which goes straight on for what is left of the time. What it shows
is the covariance of a filter beside a master without noise, see
`procedures.transfer_alignment.session`; either the coefficients count, or what all errors together
make of the position after an outage.

References
----------
.. [1] Zhou, Cheng, Lu, "On-line calibration of strapdown INS with delay-compensated H-infinity
   filtering", Southeast University.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import atan, degrees, inf, pi, radians
from typing import Any, Literal

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.plans.limit import Limit
from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    Segment,
    Start,
    Straight,
    STurn,
    Sway,
    Turn,
    plain_manoeuvre,
)
from foucault.plans.optimise import QuickSpace, require_seen

_DEG = pi / 180.0


@dataclass(frozen=True)
class TransferProfile:
    """A motion for the calibration of a slave against its master."""

    name: str  # what it is called
    start: Start  # where and how the vehicle begins
    calibration: tuple[Segment, ...]  # what it does while the master is heard
    outage: tuple[Segment, ...] = ()  # what it does afterwards

    @property
    def plan(self) -> tuple[Segment, ...]:
        """The whole motion."""
        return (*self.calibration, *self.outage)

    @property
    def hand_over(self) -> float:
        """When the master falls silent [s]."""
        return float(sum(segment.time for segment in self.calibration))

    @property
    def end(self) -> float:
        """When the motion ends [s]."""
        return float(sum(segment.time for segment in self.plan))


def _turn(angle: float, time: float) -> Turn:
    return Turn(angle * _DEG, time)


def _s_turn(angle: float, time: float) -> STurn:
    return STurn(angle * _DEG, time)


def _gusts(time: float, seed: int) -> Sway:
    angles = (1.5 * _DEG, 2.0 * _DEG, 4.0 * _DEG)
    return Sway(time, 2.0, angles, (0.1, 0.1, 0.2), tones=4, fade=3.0, seed=seed)


def _swell(time: float, turn: float, seed: int) -> Sway:
    angles = (0.7 * _DEG, 1.5 * _DEG, 5.0 * _DEG)
    return Sway(time, 9.0, angles, (0.3, 0.2, 0.5), tones=4, fade=8.0, seed=seed, turn=turn * _DEG)


_FLIGHT = TransferProfile(
    "flight",
    Start(32 * _DEG, 118 * _DEG, 1000.0, heading=40 * _DEG, speed=40.0),
    (
        Straight(4.0), Accelerate(46.0, 12.0), _s_turn(60, 26.0), Climb(14.0, height=50.0),
        _turn(90, 12.0), Accelerate(52.0, 8.0), _turn(-120, 16.0), Accelerate(48.0, 8.0),
        Straight(140.0),
    ),
    (
        Straight(60.0), _turn(100, 40.0), Straight(60.0), _s_turn(40, 60.0),
        Climb(40.0, height=120.0), Straight(60.0), _turn(-160, 60.0), Accelerate(55.0, 20.0),
        Straight(60.0), _turn(90, 40.0), _s_turn(-30, 60.0), Straight(40.0),
    ),
)  # fmt: skip
_LINES = (
    Straight(120.0), _turn(180, 90.0), Straight(90.0),
    Straight(120.0), _turn(-180, 90.0), Straight(90.0),
)  # fmt: skip
_SURVEY = TransferProfile(
    "survey",
    Start(48 * _DEG, 11 * _DEG, 2000.0, heading=100 * _DEG, speed=75.0),
    (
        Straight(20.0), _s_turn(25, 40.0), Accelerate(85.0, 15.0), _s_turn(-25, 40.0),
        Accelerate(75.0, 15.0), _s_turn(15, 40.0), Straight(70.0),
    ),
    _LINES,
)  # fmt: skip
_STRAIGHT = TransferProfile("straight", _SURVEY.start, (Straight(240.0),), _LINES)
_UAV = TransferProfile(
    "uav",
    Start(47 * _DEG, 8 * _DEG, 500.0, heading=300 * _DEG, speed=18.0),
    (
        _gusts(30.0, 1), _s_turn(60, 20.0), Accelerate(25.0, 6.0), _turn(180, 14.0),
        Climb(15.0, height=30.0), _gusts(35.0, 2), Accelerate(18.0, 5.0), _turn(-90, 8.0),
        _gusts(40.0, 3), _s_turn(-45, 20.0), _turn(120, 12.0), _gusts(35.0, 4),
    ),
    tuple(
        segment
        for k in range(6)
        for segment in (_gusts(60.0, 10 + k), _turn(180 * (-1) ** k, 20.0), Straight(20.0))
    ),
)  # fmt: skip
_SHIP = TransferProfile(
    "ship",
    Start(43 * _DEG, 7 * _DEG, 50.0, heading=200 * _DEG, speed=6.0),
    tuple(_swell(60.0, turn, k) for k, turn in enumerate((0, 60, -90, 30))),
    tuple(_swell(120.0, turn, 10 + k) for k, turn in enumerate((0, 120, -60, 90, -150))),
)

PROFILES = {p.name: p for p in (_FLIGHT, _SURVEY, _STRAIGHT, _UAV, _SHIP)}
"""The motions that are built in, by name."""


def transfer_profile(name: str) -> TransferProfile:
    """Return the built-in motion `name`, one of `PROFILES`."""
    if name not in PROFILES:
        allowed = ", ".join(PROFILES)
        raise error(
            "transfer_plan.profile", given=name, hint=suggestion(name, PROFILES), allowed=allowed
        )
    return PROFILES[name]


Kind = Literal["straight", "turn", "s_turn", "accelerate", "climb"]

KINDS: tuple[Kind, ...] = ("straight", "turn", "s_turn", "accelerate", "climb")

TURNS, S_TURNS = 180, 90  # Largest turn, and first part of an S-turn [deg].
STEP = 5  # Angles and heights are multiples of it [deg], [m].

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
        profile = self.profile(plan)
        slow_enough = needs_of(profile).slowest >= self.slowest * (1 - 1e-9)
        return slow_enough and all(limit.kept for limit in self.needs(profile))

    def needs(self, profile: TransferProfile) -> tuple[Limit, ...]:
        """Return what a motion asks of the vehicle, and what it allows."""
        n = needs_of(profile)
        return (
            Limit("time", "time", profile.hand_over, float(self.total)),
            Limit("bank", "angle", n.bank, self.bank, "deg"),
            Limit("acceleration", "specific force", n.acceleration, self.acceleration, "m/s^2"),
            Limit("angle of climb", "angle", n.climb, self.climb, "deg"),
            Limit("speed", "velocity", n.fastest, self.fastest, "m/s"),
            Limit("height above or below the start", "length", max(n.highest, -n.lowest),
                  self.height, "m"),
        )  # fmt: skip

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


POSITION = "position after the outage"

UNSEEN = 0.9  # A coefficient that keeps more than this share of its prior is not seen [1].


@dataclass(frozen=True, kw_only=True)
class TransferSpace(QuickSpace):
    """The motions that a vehicle can do, and how good each is: coefficients and `POSITION`."""

    allowed: Flyable
    quick: Callable[[TransferProfile], FloatArray]  # motion -> sds, nearly, shape (p,) [SI]
    # the same where what is not estimated is nothing: what a motion does not show even then
    alone: Callable[[TransferProfile], FloatArray]
    hidden = UNSEEN

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
            least = np.minimum(least, self.alone(self.done(plan)))
        if np.isinf(least).all():
            return ()  # the search will say that no plan fits
        return require_seen(self.names, self.weights, least > UNSEEN * self.prior_sd, self.limits)

    def bound(self, plan: Steps | TransferProfile) -> FloatArray:
        """Return the quick uncertainties, shape (p,) [SI]."""
        return self.quick(self.done(plan))

    # -- what is written of them

    def done(self, plan: Steps | TransferProfile) -> TransferProfile:
        """Return a plan as it is done."""
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
        for segment in self.done(plan).calibration:
            rows.append((f"{at:g} s", f"{at + segment.time:g} s", words(segment)))
            at += segment.time
        return tuple(rows)

    def duration(self, plan: Steps | TransferProfile) -> float:
        """Return the time that the plan takes [s]."""
        return self.done(plan).hand_over

    def needs(self, plan: Steps | TransferProfile) -> tuple[Limit, ...]:
        """Return what a plan asks of the vehicle, and what it allows."""
        return self.allowed.needs(self.done(plan))


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
