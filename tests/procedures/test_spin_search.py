"""Spins that are sought: plans keep to the tool, and every neighbour is one that calibrates."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.procedures import continuous_spin
from foucault.procedures import continuous_spin as search
from foucault.procedures.continuous_spin import Tool, Wanted
from foucault.procedures.record import Beforehand
from sessions import SITE

KNOWN = Beforehand(
    continuous_spin.Settings(),
    continuous_spin.Session(rates=("290 deg/s", "-460 deg/s"), spin_time=5.0), SITE,
    wanted=Wanted(),
)  # fmt: skip
TOOL = Tool(KNOWN, 90.0, 100.0, 570.0, 4, 5)


def test_every_plan_keeps_to_what_the_tool_can_do_and_calibrates() -> None:
    rng = np.random.default_rng(1)
    plan, kept = None, 0
    for _ in range(300):
        plan = TOOL.draw(rng) if plan is None else TOOL.moved(plan, rng, 0.5)
        if plan is None:
            continue
        kept += 1
        hold, mountings, rates = plan
        size = np.abs(rates)
        assert {"x", "y", "z"} <= set(mountings)
        assert len(mountings) <= 5 and 2 <= len(rates) <= 4
        assert min(rates) < 0 < max(rates) and size.max() >= 1.25 * size.min()
        assert size.min() >= 100 and size.max() <= 570
        assert hold * len(mountings) * len(rates) <= 90
    assert kept > 150


@pytest.mark.thorough
def test_a_plan_is_judged_by_what_a_calibration_states() -> None:
    space = search.space(KNOWN)
    assert space.reference == (5.0, ("x", "y", "z"), pytest.approx((290.0, -460.0)))
    assert space.cost(space.reference) == 0.0
    assert space.cost(None) == np.inf
    # Twice the time is better by sqrt(2), where noise is all there is.
    longer = (10.0, *space.reference[1:])
    assert -0.4 < space.cost(longer) < -0.15
    told = space.changes(longer)["simulate"]
    assert told["spin_time"] == "10 s" and told["mountings"] == ["x", "y", "z"]
    assert continuous_spin.Session.model_validate(told | {"spin_time": 10.0}).rates == (
        "290 deg/s", "-460 deg/s",
    )  # fmt: skip
    assert len(space.steps(longer)) == 7
    assert all(limit.kept for limit in space.needs(space.reference))
