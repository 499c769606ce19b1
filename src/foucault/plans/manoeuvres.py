"""What a vehicle, a person or a table does with the instrument: a plan as a list of segments.

A plan is a list such as::

    [Rest(300.0), Accelerate(speed=15.0, time=10.0), Straight(60.0),
     Turn(angle=pi / 2, time=8.0, banked=False), Accelerate(speed=0.0, time=10.0), Rest(60.0)]

Each segment begins where the one before has ended. Whatever changes follows a profile whose rate
grows over `ramp` by a 9th-order polynomial, is then constant, and fades in the same way: rates
and accelerations have four continuous derivatives everywhere. Without a `ramp` half of the time
is growth, half of it fading. `label` names a segment in figures and tables.

In a campaign file a manoeuvre of a vehicle is a table::

    manoeuvres = [
      { straight = "20 s" },
      { turn = "90 deg", time = "12 s" },            # positive to the right
      { s_turn = "25 deg", time = "40 s" },
      { accelerate = "85 m/s", time = "15 s" },      # to this speed
      { climb = "50 m", time = "14 s" },             # by this height, and level again
      { sway = ["0.7 deg", "1.5 deg", "5 deg"], period = "9 s", time = "60 s" },
    ]

All changes are built from the 9th-order step S from 0 to 1::

    S(x) = x^5 (126 - 420 x + 540 x^2 - 315 x^3 + 70 x^4)       S'(x) = 630 x^4 (1 - x)^4
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf, isfinite, pi
from numbers import Real
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.units import Angle, Length, Quantity

STEEPEST = 85.0 * pi / 180.0  # Largest angle of climb and of bank [rad].

TABLE_AXES = ("x", "y", "z", "east", "north", "up")
"""What a table may turn the body about: its own axes, and level ones."""


@dataclass(frozen=True)
class Start:
    """Where and how a motion begins.

    Attributes
    ----------
    latitude, longitude : float
        Geodetic latitude and longitude [rad].
    height : float
        Height above the ellipsoid [m].
    heading : float
        Heading of body and vehicle, clockwise from north [rad].
    pitch, roll : float
        How the body is fastened in the level vehicle, or stands on the ground [rad].
    speed : float
        Speed along the heading, level [m/s].
    """

    latitude: float
    longitude: float
    height: float = 0.0
    heading: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    speed: float = 0.0

    def __post_init__(self) -> None:
        _finite(self, "the start")
        if abs(self.latitude) > pi / 2:
            raise _refused("latitude", "the start", self.latitude, "from -pi/2 to pi/2 rad")
        if self.speed < 0:
            raise _refused("speed", "the start", self.speed, "zero or more")


@dataclass(frozen=True)
class Rest:
    """Stand still for `time` [s]."""

    time: float
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time)


@dataclass(frozen=True)
class Straight:
    """Go on for `time` [s] with the same speed, heading and angle of climb."""

    time: float
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time)


@dataclass(frozen=True)
class Accelerate:
    """Change the speed, forwards.

    Attributes
    ----------
    speed : float
        Speed at the end [m/s].
    time : float
        How long it takes [s].
    ramp : float or None
        Growth of the acceleration, and its fading; None for half of the time [s].
    """

    speed: float
    time: float
    ramp: float | None = None
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time, self.ramp)
        if self.speed < 0:
            raise _refused("speed", name(self), self.speed, "zero or more")


@dataclass(frozen=True)
class Turn:
    """Turn by an angle.

    Attributes
    ----------
    angle : float
        Change of heading, positive to the right [rad].
    time : float
        How long it takes [s].
    banked : bool
        Whether the vehicle rolls so that no specific force is felt sideways, as an aircraft does
        (but for the Coriolis force), or stays flat, as ships and cars do. Flat it may turn on
        the spot.
    ramp : float or None
        Growth of the rate, and its fading; None for half of the time [s].
    """

    angle: float
    time: float
    banked: bool = True
    ramp: float | None = None
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time, self.ramp)


@dataclass(frozen=True)
class STurn:
    """Turn by an angle, by twice as much the other way, and back."""

    angle: float  # first change of heading, positive to the right [rad]
    time: float  # how long it all takes [s]
    banked: bool = True
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time)


@dataclass(frozen=True)
class Climb:
    """Change the angle of climb, or climb by a height and be level again; down if negative.

    Attributes
    ----------
    time : float
        How long it takes [s].
    angle : float or None
        Angle of climb at the end; the nose goes with it [rad].
    height : float or None
        Change of height; begins and ends level, the speed along the path stays [m].
    ramp : float or None
        Growth of the rate, and its fading; None for half of the time [s].
    """

    time: float
    angle: float | None = None
    height: float | None = None
    ramp: float | None = None
    label: str = ""

    def __post_init__(self) -> None:
        _timed(self, self.time, self.ramp)
        if (self.angle is None) == (self.height is None):
            both = "neither an angle nor a height" if self.angle is None else "both of them"
            raise error("manoeuvre.climb_twice", what=name(self), given=both)
        if self.angle is not None and abs(self.angle) > STEEPEST:
            raise steep(name(self), "an angle of climb", self.angle)


@dataclass(frozen=True)
class Sway:
    """Oscillate about rest or about a straight run, faded in and out.

    A person walks about in a vehicle, wind shakes it, a ship lies at its mooring. Attitude and
    velocity end as they would have without, and so does the position but for micrometres (what
    goes north while high and south while low covers more ground on the way back).

    Attributes
    ----------
    time : float
        How long it lasts [s].
    period : float
        Period; with more tones than one they lie between half and twice this [s].
    angles : tuple of float, length 3
        Amplitudes of heading, pitch and roll [rad].
    shift : tuple of float, length 3
        Amplitudes of position to the right, forwards and up of the course [m].
    tones : int
        Sinusoids in each of the six, with frequencies and phases drawn at random; together they
        are as strong as one of that amplitude [1].
    fade : float or None
        How long it takes to grow, and to die down; None for a quarter of the time [s].
    seed : int
        Seed of phases and frequencies [1].
    turn : float
        Change of heading meanwhile, flat, positive to the right: a ship that turns in a swell
        [rad].
    """

    time: float
    period: float
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tones: int = 1
    fade: float | None = None
    seed: int = 0
    label: str = ""
    turn: float = 0.0

    def __post_init__(self) -> None:
        _timed(self, self.time, self.fade, "fade")
        if self.period <= 0:
            raise _refused("period", name(self), self.period, "above zero")
        if self.tones < 1:
            raise _refused("tones", name(self), self.tones, "one or more")
        for key in ("angles", "shift"):
            given = getattr(self, key)
            if len(given) != 3 or not all(isfinite(x) for x in given):
                raise _refused(key, name(self), given, "three finite numbers")


@dataclass(frozen=True)
class Rotate:
    """Turn the body on a table, with the instrument at its centre and the vehicle at rest.

    The vehicle keeps its course: a later segment moves it along the heading it had before.

    Attributes
    ----------
    axis : str
        Axis of the body, "x", "y" or "z", or a level one, "east", "north" or "up".
    angle : float
        By how much, counter-clockwise about that axis [rad].
    rate : float
        Largest rate [rad/s].
    ramp : float
        Growth of the rate, and its fading [s].
    """

    axis: str
    angle: float
    rate: float
    ramp: float = 0.5
    label: str = ""

    def __post_init__(self) -> None:
        _finite(self, name(self))
        for key in ("rate", "ramp"):
            if getattr(self, key) <= 0:
                raise _refused(key, name(self), getattr(self, key), "above zero")
        if self.axis not in TABLE_AXES:
            raise error(
                "manoeuvre.axis", what=name(self), given=self.axis, allowed=", ".join(TABLE_AXES),
                hint=suggestion(self.axis, TABLE_AXES),
            )  # fmt: skip

    @property
    def time(self) -> float:
        """How long it takes [s]: a small angle does not reach the rate."""
        return max(abs(self.angle) / self.rate, self.ramp) + self.ramp


Segment = Rest | Straight | Accelerate | Turn | STurn | Climb | Sway | Rotate
Plan = Sequence[Segment]


def name(segment: Segment) -> str:
    """Return what messages call a segment: its kind, and its label if it has one."""
    kind = type(segment).__name__
    return f"{kind} '{segment.label}'" if segment.label else kind


def steep(what: str, quantity: str, angle: float) -> Exception:
    """Return the error that `what` needs `quantity` of too large an `angle` [rad]."""
    given, limit = angle * 180 / pi, STEEPEST * 180 / pi
    return error("manoeuvre.steep", what=what, quantity=quantity, given=given, limit=limit)


def _refused(key: str, what: str, given: object, allowed: str) -> Exception:
    return error("manoeuvre.value", key=key, what=what, given=given, allowed=allowed)


def _finite(segment: Segment | Start, what: str) -> None:
    for field in fields(segment):
        given, kind = getattr(segment, field.name), str(field.type)
        if not kind.startswith(("float", "int")) or (given is None and "None" in kind):
            continue
        if not (isinstance(given, Real) and isfinite(given)):
            raise _refused(field.name, what, given, "a finite number")


def _timed(segment: Segment, time: float, ramp: float | None = None, key: str = "ramp") -> None:
    _finite(segment, name(segment))
    if not 0 < time < inf:
        raise _refused("time", name(segment), time, "above zero")
    if ramp is not None and not 0 < ramp <= time / 2:
        raise _refused(key, name(segment), ramp, f"above zero and at most half of {time} s")


Seconds = Annotated[float, Field(gt=0), Quantity("time")]

KINDS = ("straight", "turn", "s_turn", "accelerate", "climb", "sway")

TONES, FADE = 4, 0.2
"""Sinusoids of a sway in each direction, and the part of it in which it fades in, and out [1]."""


class ManoeuvreTable(BaseModel):
    """One manoeuvre: a straight run, a turn, an S-turn, a change of speed, a climb or a swell."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    straight: Seconds | None = Field(None, description="go straight on for so long")
    turn: Angle | None = Field(None, description="change of heading, positive to the right")
    s_turn: Angle | None = Field(
        None, description="turn so far, by twice as much the other way, and back"
    )
    accelerate: Annotated[float, Field(ge=0), Quantity("velocity")] | None = Field(
        None, description="speed to reach"
    )
    climb: Length | None = Field(None, description="height to climb, down if negative")
    sway: tuple[Angle, Angle, Angle] | None = Field(
        None, description="swell or gusts: amplitudes of heading, pitch and roll"
    )
    time: Seconds | None = Field(None, description="how long it takes")
    period: Seconds | None = Field(None, description="period of a sway")
    flat: bool = Field(False, description="turn without rolling, as ships and cars do")

    @model_validator(mode="after")
    def _one_thing(self) -> ManoeuvreTable:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            what = " and ".join(given) or "none of them"
            raise ValueError(f"it has to have one of {', '.join(KINDS)}, and has {what}")
        (kind,) = given
        if (kind == "straight") == (self.time is not None):
            needs = "says how long by itself" if kind == "straight" else "needs `time`"
            raise ValueError(f"{kind} {needs}")
        if (kind == "sway") != (self.period is not None):
            raise ValueError("`period` goes with a sway, and a sway with a `period`")
        if self.flat and kind not in ("turn", "s_turn"):
            raise ValueError("`flat` goes with turn and s_turn")
        return self

    def segment(self, number: int = 0) -> Segment:
        """Return what it says.

        `number`: place in the plan: two sways are not the same one [1].
        """
        if self.straight is not None:
            return Straight(self.straight)
        assert self.time is not None
        if self.turn is not None:
            return Turn(self.turn, self.time, not self.flat)
        if self.s_turn is not None:
            return STurn(self.s_turn, self.time, not self.flat)
        if self.accelerate is not None:
            return Accelerate(self.accelerate, self.time)
        if self.climb is not None:
            return Climb(self.time, height=self.climb)
        assert self.sway is not None and self.period is not None
        return Sway(self.time, self.period, self.sway, tones=TONES, fade=FADE * self.time,
                    seed=number)  # fmt: skip


def plain_manoeuvre(segment: Segment) -> dict[str, Any]:
    """Return a segment of one of `KINDS` but a sway as a campaign has it."""
    if isinstance(segment, Straight):
        return {"straight": f"{segment.time:.12g} s"}
    lasting = {"time": f"{segment.time:.12g} s"}
    if isinstance(segment, Turn | STurn):
        key = "turn" if isinstance(segment, Turn) else "s_turn"
        flat = {} if segment.banked else {"flat": True}
        return {key: f"{np.degrees(segment.angle):.12g} deg"} | lasting | flat
    if isinstance(segment, Accelerate):
        return {"accelerate": f"{segment.speed:.12g} m/s"} | lasting
    assert isinstance(segment, Climb) and segment.height is not None
    return {"climb": f"{segment.height:.12g} m"} | lasting


Three = tuple[FloatArray, FloatArray, FloatArray]


def step(x: FloatArray) -> Three:
    """Return S, S' and S'' at x, shape (n,) each [1].

    `x` (n,): from 0 to 1 [1].
    """
    rest = x * (1.0 - x)
    third = rest**3
    s = x**5 * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + x * 70.0))))
    return s, 630.0 * third * rest, 2520.0 * third * (1.0 - 2.0 * x)


@dataclass(frozen=True)
class Profile:
    """A change from zero to `total`: the rate grows over `ramp`, is constant, and fades.

    With peak = total / (time - ramp) and x = t / ramp, in the first half of the time::

        rate = peak S(min(x, 1))    value = peak (ramp integral of S + max(t - ramp, 0))

    and the second half is the first one backwards.
    """

    total: float = 0.0  # value at the end [any unit]
    time: float = 1.0  # how long it takes [s]
    ramp: float = 0.5  # growth of the rate, and its fading, at most half of the time [s]

    @property
    def peak(self) -> float:
        """Largest rate [unit/s]."""
        return self.total / (self.time - self.ramp)

    def at(self, t: FloatArray) -> Three:
        """Return value, rate and acceleration, shape (n,) each [unit, s].

        `t` (n,): time since it began [s].
        """
        if self.total == 0.0:
            zero = np.zeros_like(t)
            return zero, zero, zero
        late = t > self.time / 2
        since = np.where(late, self.time - t, t)
        x = np.minimum(since / self.ramp, 1.0)
        s, slope, _ = step(x)
        integral = x**6 * (21.0 + x * (-60.0 + x * (67.5 + x * (-35.0 + x * 7.0))))
        value = self.peak * (self.ramp * integral + np.maximum(since - self.ramp, 0.0))
        curve = self.peak / self.ramp * slope
        return (
            np.where(late, self.total - value, value),
            self.peak * s,
            np.where(late, -curve, curve),
        )
