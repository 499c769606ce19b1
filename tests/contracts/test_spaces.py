"""What every space of plans owes the search, the folder it is kept in, and the report."""

from __future__ import annotations

import json
import pickle
from functools import cache
from math import isfinite

import numpy as np
import pytest

from foucault import campaign, units
from foucault.campaign import optimisation
from foucault.plans import optimise
from foucault.procedures import PROCEDURES, load

NOISE = """
[noise.gyro]
white = "0.003 deg/sqrt(h)"
bias_instability = "0.005 deg/h"
correlation_time = "100 s"
[noise.accel]
white = "5 ug/sqrt(Hz)"
"""
WANTED = {
    "turntable": "positions = 8", "norm_observation": 'criterion = "det"',
    "multi_position": "integrity = true", "platform_tumble": "truths = 1",
    "systematic": "alike = false",
}  # fmt: skip
SLOW = ("systematic", "transfer_alignment", "continuous_spin")
SEARCHED = ("six_position", "ferraris", "multi_position", "turntable", "rate_table")
"""Those whose searches, not one plan, take seconds: with the thorough tests too."""


def searched(slow: tuple[str, ...]) -> list:
    """The procedures with a space of plans, those of `slow` with the thorough tests."""
    names = [name for name in PROCEDURES if load(name).space is not None]
    return [pytest.param(n, marks=[pytest.mark.thorough] * (n in slow)) for n in names]


QUICK = searched(SLOW + SEARCHED)


@cache
def space_of(name: str):
    text, _, _ = campaign.template(name).partition("# [optimise]")
    text += NOISE if name == "north_seeking" else ""  # it has to be known
    return optimisation.space_of(campaign.parse(f"{text}\n[optimise]\n{WANTED.get(name, '')}\n"))


@cache
def plan_of(name: str):
    return some_plan(space_of(name), 3)


def some_plan(space, seed: int):
    """The best of some plans that are allowed, after a few steps from it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimise, "PROBED", 4)
        return optimise.descend(space, np.random.default_rng(seed), 12).plan


@pytest.mark.parametrize("name", QUICK)
def test_what_is_compared_has_a_unit_a_weight_and_an_sd(name):
    space = space_of(name)
    assert len(space.names) == len(space.kinds) == len(space.weights) > 0
    assert set(space.kinds) <= set(units.KINDS) and set(space.unseen) <= set(space.names)
    counts = space.weights > 0
    sd = space.sd(space.reference, space.cases[0])
    assert sd.shape == counts.shape and (sd[counts & np.isfinite(sd)] > 0).all()
    assert space.limits and space.reference_name


@pytest.mark.parametrize("name", QUICK)
def test_a_plan_is_kept_written_and_shown(name):
    space = space_of(name)
    plan = plan_of(name)
    assert isfinite(space.cost(plan))
    assert space.from_json(json.loads(json.dumps(space.as_json(plan)))) == plan
    for shown in (plan, space.reference):
        headings, *rows = space.steps(shown)
        assert rows and {len(row) for row in rows} == {len(headings)}
        assert space.duration(shown) > 0
        assert all(limit.words for limit in space.needs(shown))
    assert set(space.changes(plan)) <= {"procedure", "simulate"}


@pytest.mark.parametrize("name", QUICK)
def test_a_seed_finds_the_same_plan_here_and_in_another_process(name):
    space = space_of(name)
    plan, there = plan_of(name), pickle.loads(pickle.dumps(space))
    assert plan == some_plan(there, 3) != some_plan(space, 4)
    assert there.cost(plan) == space.cost(plan)
