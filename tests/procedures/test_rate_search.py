"""Rates that are sought: the optimum that theory has, within what the table can do."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from foucault.campaign import optimisation, parse, template
from foucault.campaign.running import with_nothing_else
from foucault.plans.optimise import compare, descend
from refusals import refuses

ODD = '[optimise.weights]\n"gyro.scale" = 1.0\n"gyro.cubic" = 1.0\n' + "".join(
    f'"gyro.{what}" = 0.0\n' for what in ("bias", "misalignment", "asymmetry")
)


OWN = ["20 deg/s", "-20 deg/s", "80 deg/s", "-80 deg/s"]


# A gyro that holds nothing else: with white noise alone the optimum is known.
TEXT = with_nothing_else(template("rate_table"))


def space_of(wanted="", old="", new=""):
    text, _, _ = TEXT.partition("# [optimise]")
    assert old in text
    return optimisation.space_of(parse(text.replace(old, new, 1) + wanted))


@pytest.mark.thorough
def test_two_speeds_are_those_of_the_optimal_design():
    """Readings k w + c w^3 at 1 and s, equally long: var k var c ~ (1 + s^6)(1 + s^2)/(s - s^3)^4.

    Long steps, so that whole turns do not count.
    """
    space = space_of(f'[optimise]\nspeeds = 2\nfewest = 2\ntime = "5 h"\n{ODD}')
    s = minimize_scalar(
        lambda s: np.log((1 + s**6) * (1 + s**2) / (s - s**3) ** 4), bounds=(0.1, 0.9),
        method="bounded",
    ).x  # fmt: skip
    best = space.cost(space.allowed.filled(np.array([1000 * s, 1000.0])))
    found = descend(space, np.random.default_rng(1), 150)
    assert found.cost == pytest.approx(best, abs=0.003)
    for other in (s - 0.15, s + 0.15):  # it is no plateau
        assert space.cost(space.allowed.filled(np.array([1000 * other, 1000.0]))) > best + 0.01
    slow, fast = sorted({abs(w) for w in found.plan[1]})
    assert fast == 100.0 and slow == pytest.approx(100 * s, abs=6)


def test_a_plan_fills_the_time_and_keeps_within_the_table():
    space = space_of('[optimise]\nfastest = "60 deg/s"\nslowest = "20 deg/s"\ntime = "20 min"\n')
    rng = np.random.default_rng(3)
    plan = descend(space, rng, 1).plan
    for heat in np.linspace(1, 0, 40):
        plan = space.moved(plan, rng, heat)
        hold, rates = plan
        assert {abs(w) for w in rates} <= set(np.round(np.arange(20, 60.05, 0.1), 1).tolist())
        assert sum(rates) == 0 and len(rates) <= 12
        assert space.duration(plan) <= 1200 < space.duration((hold + 1, rates))
        assert all(limit.kept for limit in space.needs(plan))
    assert not space.needs(space.reference)[0].kept  # 100 deg/s are beyond this table


def test_what_is_found_is_what_preflight_says_of_it():
    """The plan goes into the file; what is stated of it comes true."""
    space = space_of()
    plan = space.allowed.filled(np.array([572.0, 1000.0]))
    assert compare(space, plan).geometric_mean[0] == pytest.approx(0.793, abs=0.005)
    assert space.cost(plan) == inf  # two speeds do not show what they leave
    made = parse(TEXT)
    said = space.changes(plan)["simulate"]
    session = type(made.session).model_validate(made.session.model_dump() | said)
    found = optimisation.foresee(replace(made, session=session))
    np.testing.assert_allclose(space.sd(plan, space.cases[0]), found.sd, rtol=0.01)


def test_rates_of_the_procedure_are_changed_there():
    space = space_of(
        "[optimise]\nfewest = 2\n", old="\nrates = []\n", new=f"\nrates = {json.dumps(OWN)}\n"
    )
    assert space.reference[1] == (20.0, -20.0, 80.0, -80.0)
    plan = space.allowed.filled(np.array([400.0, 800.0]))
    changes = space.changes(plan)
    assert changes["procedure"] == {"rates": ["40 deg/s", "-40 deg/s", "80 deg/s", "-80 deg/s"]}
    assert set(changes["simulate"]) == {"step_time"}
    assert np.isfinite(space.cost(plan))


def test_what_no_plan_shows_is_refused_where_it_counts():
    with refuses("optimise.unseen", "gyro.cubic.x"):
        space_of('[optimise]\nfastest = "60 deg/s"\nslowest = "60 deg/s"\n')
    short = space_of('[optimise]\ntime = "60 s"\n')
    assert short.cost(short.draw(np.random.default_rng(0))) == inf
