"""Motions before a hand-over: what they ask of a vehicle, and how they are varied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.plans.manoeuvres import Sway
from foucault.plans.transfer import PROFILES, Flyable, Step, needs_of
from foucault.simulate.motion import simulate_motion

START = PROFILES["flight"]


def flyable(**changes):
    usual = Flyable(
        start=replace(START, calibration=()), total=240, most=8, shortest=8, slowest=32.0,
        fastest=48.0, bank=np.radians(45.0), acceleration=1.5, climb=np.radians(8.0),
        height=100.0, flat=False,
    )  # fmt: skip
    return replace(usual, **changes)


def flown(profile):
    """Bank, acceleration, angle of climb, speeds and heights of the simulated motion."""
    made = simulate_motion(profile.calibration, profile.start, rate=20.0)
    truth = made.truth
    v = truth.velocity_n
    speed = np.linalg.norm(v, axis=1)
    h = truth.height - truth.height[0]
    return (
        np.abs(truth.angles[:, 2]).max(),
        np.abs(np.diff(speed)).max() * 20.0,
        np.abs(np.arcsin(v[:, 2] / speed)).max(),
        speed.min(), speed.max(), h.min(), h.max(),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["flight", "survey"])
def test_what_a_motion_asks_for_is_what_is_flown(name):
    profile = PROFILES[name]
    needs = needs_of(profile)
    said = (needs.bank, needs.acceleration, needs.climb, needs.slowest, needs.fastest,
            needs.lowest, needs.highest)  # fmt: skip
    np.testing.assert_allclose(said, flown(profile), rtol=0.02, atol=0.02)


def test_drawn_and_moved_plans_keep_what_is_allowed_or_are_refused():
    a, rng = flyable(), np.random.default_rng(4)
    kept = refused = 0
    plan = a.draw(rng)
    for _ in range(300):
        plan = a.moved(plan, rng, rng.random()) if rng.random() < 0.8 else a.draw(rng)
        profile = a.profile(plan) if sum(s.time for s in plan) <= a.total else None
        if profile is None or not a.fits(plan):
            refused += 1
            continue
        kept += 1
        assert profile.hand_over == a.total
        assert all(s.time >= a.shortest and len(plan) <= a.most for s in plan)
        needs = needs_of(profile)
        assert needs.bank <= a.bank * (1 + 1e-8) and a.slowest <= needs.slowest
    assert kept > 100 and refused > 10


@pytest.mark.parametrize(
    ("step", "change"),
    [
        (Step("turn", 180, 10), {"bank": 1.4}),
        (Step("s_turn", 60, 20), {"bank": 1.4}),
        (Step("accelerate", 48, 8), {"acceleration": 2.5}),
        (Step("accelerate", 60, 60), {"fastest": 60.0}),
        (Step("climb", 50, 8), {"climb": 0.5}),
        (Step("climb", 120, 100), {"height": 120.0}),
        (Step("straight", 0, 250), {"total": 260}),
        (Step("straight", 0, 5), {"shortest": 5}),
    ],
)
def test_each_limit_refuses_what_breaks_it_and_nothing_else(step, change):
    assert not flyable().fits((step,))
    assert flyable(**change).fits((step,))


def test_a_motion_is_the_same_plan_again_where_it_is_of_such_manoeuvres():
    a = flyable()
    plan = (Step("turn", -90, 20), Step("climb", 50, 30), Step("straight", 0, 190))
    assert a.steps(a.profile(plan)) == plan
    swaying = replace(START, calibration=(Sway(60.0, 9.0),))
    assert a.steps(swaying) is None
    assert a.steps(PROFILES["survey"]) is not None


def test_vehicles_that_cannot_do_something_are_not_asked_to():
    rng = np.random.default_rng(0)
    ship = flyable(climb=0.0, height=0.0, flat=True, bank=np.radians(5.0), slowest=40.0,
                   fastest=40.5)  # fmt: skip
    drawn = {step.kind for _ in range(100) for step in ship.draw(rng)}
    assert drawn == {"straight", "turn", "s_turn"}
    assert not ship.segment(Step("turn", 10, 60)).banked
    assert "sideways force" in ship.words
