"""The search itself, on a space whose best plan is known."""

from __future__ import annotations

from math import inf, log

import numpy as np
import pytest

from foucault.models.imu import LAYOUT
from foucault.plans.optimise import compare, descend, require_seen, weights_of
from refusals import refuses

NAMES = ("accel.bias.x", "accel.bias.y", "accel.bias.z")


class Bowl:
    """Plans are points of a grid; sd grow with the distance from (7, -3, 2); x < 0 is forbidden."""

    names, kinds = NAMES, ("specific force",) * 3
    weights, unseen, cases = np.array([1.0, 1.0, 2.0]), (), ("here", "there")
    reference, reference_name, limits = (20, 20, 20), "corner", "x from 0 on"

    def __init__(self, allowed=True):
        self.allowed, self.judged = allowed, 0

    def draw(self, rng):
        return tuple(int(v) for v in rng.integers(-20, 21, 3))

    def moved(self, plan, rng, heat):
        new = list(plan)
        new[rng.integers(3)] += int(rng.choice([-1, 1]))
        return tuple(new)

    def sd(self, plan, case):
        scale = {"here": 1.0, "there": 3.0}[case]
        return scale * (1.0 + np.abs(np.array(plan) - (7, -3, 2)))

    def cost(self, plan):
        self.judged += 1
        if plan[0] < 0 or not self.allowed:
            return inf
        ratio = np.log(self.sd(plan, "here") / self.sd(self.reference, "here"))
        return float(self.weights @ ratio / self.weights.sum())


def test_finds_the_bottom_and_counts_what_it_judged():
    space = Bowl()
    best = descend(space, np.random.default_rng(0), 3000)
    assert best.plan == (7, -3, 2)
    assert best.evaluations == space.judged == 3000
    assert best.cost == pytest.approx(-(log(14) + log(24) + 2 * log(19)) / 4)
    costs = [cost for _, cost in best.trace]
    assert costs == sorted(costs, reverse=True)


def test_same_seed_same_path():
    runs = [descend(Bowl(), np.random.default_rng(4), 200) for _ in range(2)]
    assert runs[0] == runs[1]
    assert descend(Bowl(), np.random.default_rng(5), 200).trace != runs[0].trace


def test_goes_on_from_a_plan_and_never_returns_worse():
    start = (7, -3, 1)
    best = descend(Bowl(), np.random.default_rng(0), 5, start)
    assert best.cost <= Bowl().cost(start)
    assert best.evaluations == 5


def test_says_that_nothing_is_allowed():
    best = descend(Bowl(allowed=False), np.random.default_rng(0), 3000)
    assert best.plan is None
    assert best.cost == inf


def test_compares_by_the_weights_in_every_case():
    c = compare(Bowl(), (7, -3, 2))
    assert c.geometric_mean == pytest.approx([np.exp(-(log(14) + log(24) + 2 * log(19)) / 4)] * 2)
    assert c.worst == pytest.approx([1 / 14] * 2)
    assert c.sd[1] == pytest.approx([3.0, 3.0, 3.0])


def test_what_the_reference_does_not_see_is_no_gain():
    space = Bowl()
    space.sd = lambda plan, case: np.array([inf, 2.0, 2.0]) if plan[0] == 20 else np.ones(3)
    c = compare(space, (7, -3, 2))
    assert np.isnan(c.ratio[0, 0])
    assert c.geometric_mean[0] == pytest.approx(0.5)


# -- weights


def test_the_longer_name_wins():
    w = weights_of(LAYOUT, {"accel": 0.0, "accel.bias.y": 3.0})
    named = dict(zip(LAYOUT.names, w, strict=True))
    assert named["accel.bias.y"] == 1.0  # over the largest
    assert named["accel.bias.x"] == named["accel.scale.z"] == 0.0
    assert named["gyro.bias.x"] == pytest.approx(1 / 3)
    huge = weights_of(LAYOUT, {"accel.bias": 1e308, "gyro.bias": 1e308})
    assert huge.sum() == pytest.approx(6)


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        ({"accel.bais": 1.0}, "optimise.weight_name", "Did you mean 'accel.bias'"),
        ({"accel.bias": -1.0}, "optimise.weight", "the weight -1"),
        ({"accel.bias": float("nan")}, "optimise.weight", "the weight nan"),
        ({"accel": 0.0, "gyro": 0.0}, "optimise.weightless", "every coefficient"),
    ],
)
def test_refuses_weights(given, code, said):
    with refuses(code, match=said):
        weights_of(LAYOUT, given)


def test_unseen_are_named_and_refused_only_where_they_count():
    unseen = np.array([True, False, True])
    with refuses("optimise.unseen", match=r"2 of the .* accel\.bias\.x, accel\.bias\.z") as caught:
        require_seen(NAMES, np.ones(3), unseen, "turns about x")
    assert "turns about x" in caught.value.message
    kept = require_seen(NAMES, np.array([0.0, 1.0, 0.0]), unseen, "turns about x")
    assert kept == ("accel.bias.x", "accel.bias.z")
