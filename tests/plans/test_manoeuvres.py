"""Plans of manoeuvres: what is refused, and with which words."""

from __future__ import annotations

from math import inf, nan, pi, radians

import pytest

from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    Rest,
    Rotate,
    Start,
    Straight,
    STurn,
    Sway,
    Turn,
)
from foucault.simulate.motion import motion_of
from refusals import refuses

HERE = Start(0.5, 0.1)
MOVING = Start(0.5, 0.1, speed=20.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Rest(-1.0), "`time` of Rest is -1.0; it has to be above zero"),
        (lambda: Straight(0.0, label="out"), "`time` of Straight 'out' is 0.0"),
        (lambda: Rest(inf), "`time` of Rest is inf; it has to be a finite number"),
        (lambda: Accelerate(-3.0, 5.0), "`speed` of Accelerate is -3.0; it has to be zero or more"),
        (lambda: Turn(nan, 5.0), "`angle` of Turn is nan"),
        (lambda: Turn(1.0, 5.0, ramp=2.6), "`ramp` of Turn is 2.6; .* at most half of 5.0 s"),
        (lambda: STurn(1.0, -5.0), "`time` of STurn"),
        (lambda: Climb(5.0, angle=0.1, ramp=0.0), "`ramp` of Climb is 0.0"),
        (lambda: Sway(9.0, 0.0), "`period` of Sway is 0.0"),
        (lambda: Sway(9.0, 1.0, tones=0), "`tones` of Sway is 0; it has to be one or more"),
        (lambda: Sway(9.0, 1.0, fade=5.0), "`fade` of Sway is 5.0"),
        (lambda: Sway(9.0, 1.0, angles=(0.1, nan, 0.0)), "`angles` .* three finite numbers"),
        (lambda: Rotate("x", 1.0, 0.0), "`rate` of Rotate is 0.0"),
        (lambda: Start(1.6, 0.0), "`latitude` of the start is 1.6; .* from -pi/2 to pi/2 rad"),
        (lambda: Start(0.1, 0.0, speed=-1.0), "`speed` of the start is -1.0"),
        (lambda: Start(0.1, nan), "`longitude` of the start is nan"),
    ],
)
def test_numbers_that_cannot_be(make, words: str) -> None:
    with refuses("manoeuvre.value", match=words):
        make()


def test_axes_are_suggested() -> None:
    with refuses("manoeuvre.axis", match=r"'nort'\. Did you mean 'north'\?"):
        Rotate("nort", 1.0, 1.0)


@pytest.mark.parametrize(
    ("how", "given"), [({}, "neither"), ({"angle": 0.1, "height": 10.0}, "both of them")]
)
def test_a_climb_has_an_angle_or_a_height(how, given: str) -> None:
    with refuses("manoeuvre.climb_twice", match=f"Climb is given {given}"):
        Climb(10.0, **how)


@pytest.mark.parametrize(
    ("plan", "start", "code", "words"),
    [
        ([], HERE, "manoeuvre.empty", "no segments"),
        ([Straight(2.0), Rest(5.0)], MOVING, "manoeuvre.moving", "at 2 s it still goes at 20 m/s"),
        ([Rotate("z", 1.0, 1.0)], MOVING, "manoeuvre.moving", "Rotate needs a vehicle at rest"),
        ([Rest(3.0), Turn(1.0, 5.0, label="bend")], HERE, "manoeuvre.still", "Turn 'bend' .* 3 s"),
        ([STurn(1.0, 5.0)], HERE, "manoeuvre.still", "STurn needs a vehicle that moves"),
        ([Climb(5.0, height=3.0)], HERE, "manoeuvre.still", "banked=False"),
        ([Climb(5.0, angle=0.1)], HERE, "manoeuvre.still", "Climb"),
        (
            [Climb(5.0, angle=radians(6)), Climb(9.0, height=5.0)], MOVING,
            "manoeuvre.not_level", "at 5 s the vehicle climbs at 6 deg",
        ),
        ([Climb(5.0, height=60.0)], MOVING, "manoeuvre.steep", "angle of climb of 90 deg"),
        ([Turn(pi, 0.5)], MOVING, "manoeuvre.steep", "a bank of 87.* deg; the limit is 85 deg"),
    ],
)  # fmt: skip
def test_plans_that_no_vehicle_can_follow(plan, start: Start, code: str, words: str) -> None:
    with refuses(code, match=words):
        motion_of(plan, start)


def test_a_climb_beyond_the_limit() -> None:
    with refuses("manoeuvre.steep", "angle of climb of -86 deg; the limit is 85"):
        Climb(5.0, angle=radians(-86.0))


def test_what_only_looks_impossible_is_allowed() -> None:
    plan = [
        Turn(1.0, 5.0, banked=False), Climb(3.0, angle=0.0), Accelerate(0.0, 3.0), Straight(1.0),
        Rotate("up", 0.0, 1.0), Accelerate(5.0, 2.0), Climb(4.0, height=0.0), Turn(0.0, 1.0),
        Accelerate(0.0, 2.0), Rest(1.0),
    ]  # fmt: skip
    motion, labels = motion_of(plan, HERE)
    assert motion.end == sum(segment.time for segment in plan) == labels[-1][2]
