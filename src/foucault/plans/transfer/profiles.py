"""Motions on which one instrument is calibrated against another in the same vehicle.

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

References
----------
.. [1] Zhou, Cheng, Lu, "On-line calibration of strapdown INS with delay-compensated H-infinity
   filtering", Southeast University.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from foucault.errors import error, suggestion
from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    Segment,
    Start,
    Straight,
    STurn,
    Sway,
    Turn,
)

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
