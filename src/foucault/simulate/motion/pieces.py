"""A plan of manoeuvres as pieces of time in which all that changes is a smooth function.

The vehicle goes with speed V along a path of course chi (clockwise from the second axis of a level
frame l, which is north or carried along, see `simulate.motion.path`) and angle of climb gamma. Its
own axes v are right, forward, up, with heading, pitch and roll chi, gamma and bank; the body is
fastened in it, and a table may turn it there::

    v_l  = D(chi) u,   u = (0, V cos gamma, V sin gamma) + (rate of a sway to right, forward, up)
    C_lb = C_lv(chi, gamma, bank; + sway) C_vb Exp(axis_b angle)
    tan bank = V chi' / g         no specific force sideways; 0 in a flat turn
    sin gamma = height' / V       in a climb by a height

D is the rotation by -chi about up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.attitude import matrix_of
from foucault.models.earth import gravity
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import (
    STEEPEST,
    TABLE_AXES,
    Accelerate,
    Climb,
    Plan,
    Rest,
    Rotate,
    Segment,
    Start,
    STurn,
    Sway,
    Turn,
    name,
    steep,
)
from foucault.plans.profiles import Profile
from foucault.simulate.motion.profiles import Oscillation

_STILL = Profile()
_STEADY_STEP, _CHANGING_STEP = 1.0, 0.25  # longest panels of quadrature [s]


class Kinematics(NamedTuple):
    """What a piece does at some times: see the text of the module."""

    angles: FloatArray
    rates: FloatArray
    course: FloatArray
    course_rate: FloatArray
    u: FloatArray
    u_rate: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


@dataclass(frozen=True)
class Piece:
    """A piece of time of a motion."""

    # start, time: when it begins, and how long it lasts [s]
    start: float
    time: float
    speed: float  # speed at the beginning [m/s]
    # course, climb: course and angle of climb at the beginning [rad]
    course: float
    climb: float
    C_vb: FloatArray  # (3, 3) body in the vehicle at the beginning [1]
    # accelerate, turn, pitch, rise, spin: changes of speed [m/s], course and angle of climb [rad],
    # of height in a climb by a height [m], of the angle on a table [rad]
    accelerate: Profile = _STILL
    turn: Profile = _STILL
    pitch: Profile = _STILL
    rise: Profile = _STILL
    spin: Profile = _STILL
    axis_b: FloatArray | None = None  # (3,) axis of the table, frame b [1]
    # g of the bank of a turn, infinite where the vehicle stays flat [m/s^2]
    bank_gravity: float = np.inf
    # of heading, pitch, roll [rad] and of the shift right, forward, up [m]
    sway: Oscillation | None = None

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.start + self.time

    def after(self, time: float) -> Piece:
        """Return the steady piece of `time` [s] that follows."""
        C_vb = self.C_vb
        if self.axis_b is not None:
            C_vb = C_vb @ exp(self.axis_b * self.spin.total)
        return Piece(
            self.end, time, self.speed + self.accelerate.total, self.course + self.turn.total,
            self.climb + self.pitch.total, C_vb,
        )  # fmt: skip

    @property
    def profiles(self) -> list[Profile]:
        """The profiles that change anything."""
        some = (self.accelerate, self.turn, self.pitch, self.rise, self.spin)
        return [profile for profile in some if profile.total]

    @property
    def step(self) -> float:
        """Longest time over which all is close to a polynomial of low order [s]."""
        steps = [min(_CHANGING_STEP, profile.ramp / 4) for profile in self.profiles]
        if self.sway is not None:
            steps.append(min(_CHANGING_STEP, self.sway.fade / 4, self.sway.shortest / 4))
        return min(steps, default=_STEADY_STEP)

    def joints(self) -> FloatArray:
        """Return where its functions begin and change, and times in between, `step` apart [s]."""
        marks = [0.0, self.time]
        for profile in self.profiles:
            marks += [profile.ramp, profile.time / 2, profile.time - profile.ramp]
        if self.sway is not None:
            marks += [self.sway.fade, self.time / 2, self.time - self.sway.fade]
        edges = np.unique(marks)
        parts = np.ceil(np.diff(edges) / self.step).astype(int)
        within = [np.arange(n) / n * d for n, d in zip(parts, np.diff(edges), strict=True)]
        spread = [edge + w for edge, w in zip(edges[:-1], within, strict=True)]
        return self.start + np.concatenate(spread)

    def at(self, time: FloatArray) -> Kinematics:
        """Return what it does at `time`, shape (n,) [s]; steady outside of it."""
        t = np.clip(time - self.start, 0.0, self.time)
        V, dV = self.speed + self.accelerate.at(t)[0], self.accelerate.at(t)[1]
        turn, turn_rate, turn_curve = self.turn.at(t)
        climb, climb_rate = self._climb(t, V)
        spin, spin_rate, _ = self.spin.at(t)
        tangent = V * turn_rate / self.bank_gravity
        bank_rate = V * turn_curve / self.bank_gravity / (1.0 + tangent**2)
        angles = np.stack([self.course + turn, climb, np.arctan(tangent)], axis=-1)
        rates = np.stack([turn_rate, climb_rate, bank_rate], axis=-1)
        s, c = np.sin(climb), np.cos(climb)
        zero = np.zeros_like(t)
        u = np.stack([zero, V * c, V * s], axis=-1)
        along, across = dV, V * climb_rate
        u_rate = np.stack([zero, along * c - across * s, along * s + across * c], axis=-1)
        if self.sway is not None:
            shift, shift_rate, shift_curve = self.sway.at(t)
            angles += shift[:3].T
            rates += shift_rate[:3].T
            u += shift_rate[3:].T
            u_rate += shift_curve[3:].T
        return Kinematics(angles, rates, self.course + turn, turn_rate, u, u_rate, spin, spin_rate)

    def _climb(self, t: FloatArray, V: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.rise.total == 0.0:
            change, rate, _ = self.pitch.at(t)
            return self.climb + change, rate
        _, rise, curve = self.rise.at(t)
        sine = rise / V
        return np.arcsin(sine), curve / V / np.sqrt(1.0 - sine**2)


def pieces_of(plan: Plan, start: Start) -> tuple[list[Piece], list[tuple[str, float, float]]]:
    """Return the pieces of a plan, and label, beginning and end [s] of each of its segments."""
    if not plan:
        raise error("manoeuvre.empty")
    C_vb = matrix_of(0.0, start.pitch, start.roll)
    before = Piece(0.0, 0.0, start.speed, start.heading, 0.0, C_vb)
    g = gravity(start.latitude, start.height)
    pieces: list[Piece] = []
    spans = []
    for segment in plan:
        begin = before.end
        for part in _parts(segment):
            before = _piece(part, before.after(part.time), g, name(segment))
            pieces.append(before)
        spans.append((segment.label or type(segment).__name__, begin, before.end))
    return pieces, spans


def _parts(segment: Segment) -> list[Segment]:
    if not isinstance(segment, STurn):
        return [segment]
    a, t = segment.angle, segment.time / 4
    turns = ((a, t), (-2 * a, 2 * t), (a, t))
    return [Turn(angle, time, segment.banked) for angle, time in turns]


def _piece(segment: Segment, steady: Piece, g: float, what: str) -> Piece:
    """Return what a segment makes of the steady piece it begins as."""
    match segment:
        case Rest():
            _require_rest(steady, what)
        case Accelerate():
            change = Profile(segment.speed - steady.speed, segment.time, _ramp(segment))
            return replace(steady, accelerate=change)
        case Turn():
            return _turn(segment, steady, g, what)
        case Climb():
            return _climb(segment, steady, what)
        case Sway():
            turn = Profile(segment.turn, segment.time, segment.time / 2)
            return replace(steady, sway=Oscillation.of(segment), turn=turn)
        case Rotate():
            _require_rest(steady, what)
            C_lb = matrix_of(steady.course, steady.climb, 0.0) @ steady.C_vb
            number = TABLE_AXES.index(segment.axis)
            axis = np.eye(3)[number] if number < 3 else C_lb[number - 3]
            change = Profile(segment.angle, segment.time, segment.ramp)
            return replace(steady, spin=change, axis_b=axis)
    return steady


def _turn(segment: Turn, steady: Piece, g: float, what: str) -> Piece:
    change = Profile(segment.angle, segment.time, _ramp(segment))
    if not segment.banked:
        return replace(steady, turn=change)
    _require_speed(steady, what)
    bank = float(np.arctan(steady.speed * change.peak / g))
    if abs(bank) > STEEPEST:
        raise steep(what, "a bank", bank)
    return replace(steady, turn=change, bank_gravity=g)


def _climb(segment: Climb, steady: Piece, what: str) -> Piece:
    if segment.angle is not None:
        change = segment.angle - steady.climb
        if change:
            _require_speed(steady, what)
        return replace(steady, pitch=Profile(change, segment.time, _ramp(segment)))
    _require_speed(steady, what)
    if abs(steady.climb) > 1e-12:
        raise error(
            "manoeuvre.not_level", what=what, time=steady.start, given=np.degrees(steady.climb)
        )
    rise = Profile(segment.height or 0.0, segment.time, _ramp(segment))
    sine = rise.peak / steady.speed
    if abs(sine) > np.sin(STEEPEST):
        # Past the vertical there is no angle to name: the height itself is longer than the way.
        raise steep(what, "an angle of climb", float(np.arcsin(np.clip(sine, -1.0, 1.0))))
    return replace(steady, climb=0.0, rise=rise)


def _ramp(segment: Accelerate | Turn | Climb) -> float:
    return segment.time / 2 if segment.ramp is None else segment.ramp


def _require_rest(steady: Piece, what: str) -> None:
    if steady.speed > 0:
        raise error("manoeuvre.moving", what=what, time=steady.start, speed=steady.speed)


def _require_speed(steady: Piece, what: str) -> None:
    if steady.speed <= 0:
        raise error("manoeuvre.still", what=what, time=steady.start)
