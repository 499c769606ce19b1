"""Strapdown navigation of simulated motion comes to where the motion was, and back."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.earth import displacement
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import navigate
from foucault.plans.manoeuvres import Start, Straight
from foucault.simulate.motion import simulate_motion
from make_motion import DEG, START, drive, flight

POLAR = Start(89.5 * DEG, 10 * DEG, 100.0, heading=5 * DEG, speed=200.0)
RUNS = {
    "drive": (drive(), START, "north"),
    "flight": (flight(), START, "north"),
    "over the pole": ([Straight(900.0)], POLAR, "start"),
}


def away(there, row: int, truth, at: int) -> float:
    return float(np.linalg.norm(displacement(
        truth.latitude[at], truth.longitude[at], truth.height[at],
        there.latitude[row], there.longitude[row], there.height[row],
    )))  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", RUNS)
def test_millimetres_over_a_quarter_of_an_hour_there_and_back(name: str) -> None:
    plan, start, headings = RUNS[name]
    made = simulate_motion(plan, start, rate=200.0, headings=headings, gravity_offset=2e-4)
    increments = increments_of(made.log)
    out = navigate(increments, made.truth.state(0), gravity_offset=2e-4)
    assert away(out, -1, made.truth, -1) < 1e-3
    assert np.abs(out.C_nb[-1] - made.truth.C_nb[-1]).max() < 1e-8
    np.testing.assert_allclose(out.velocity_n[-1], made.truth.velocity_n[-1], rtol=0, atol=1e-5)
    last = len(increments) - 1
    home = navigate(increments, out.state(-1), first=last, last=0, gravity_offset=2e-4)
    assert away(home, -1, made.truth, 0) < 1e-4


@pytest.mark.thorough
def test_the_error_falls_with_the_interval() -> None:
    plan = drive(2)
    missed = []
    for rate in (50.0, 100.0, 200.0):
        made = simulate_motion(plan, START, rate=rate)
        missed.append(away(navigate(increments_of(made.log), made.truth.state(0)), -1,
                           made.truth, -1))  # fmt: skip
    assert missed[0] > 4 * missed[1] > 16 * missed[2]  # better than second order
