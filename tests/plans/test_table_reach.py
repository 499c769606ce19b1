"""What a table can reach: ranges, steps of a dividing head, and short ways between positions."""

from __future__ import annotations

from itertools import pairwise, permutations
from math import pi

import numpy as np
import pytest

from foucault.models.turntable import up_k
from foucault.plans.directions import spread_directions
from foucault.plans.table import Reach, shortest_order, travel_time
from refusals import refuses

DIRECTIONS = spread_directions(50)


def up(position):
    return up_k(np.array([position]))[0]


def test_without_limits_every_direction_is_reached():
    for u in DIRECTIONS:
        np.testing.assert_allclose(up(Reach().pointing(u, 0.3)), u, atol=1e-12)


def test_half_a_turn_of_the_middle_axis_is_enough_on_either_side():
    """Beyond the pole the inner axis turns by half a turn and the same direction is up."""
    far = Reach(middle=(pi / 2, 3 * pi / 2))
    for u in DIRECTIONS:
        there = far.pointing(u, 0.0)
        assert pi / 2 - 1e-9 <= there[1] <= 3 * pi / 2 + 1e-9
        np.testing.assert_allclose(up(there), u, atol=1e-12)


def test_within_narrow_ranges_the_nearest_is_taken():
    tilting = Reach(middle=(-0.2, 0.5), inner=(-1.0, 1.0))
    grid = [(0.0, m, i) for m in np.linspace(-0.2, 0.5, 8) for i in np.linspace(-1.0, 1.0, 21)]
    near = 0
    for u in DIRECTIONS:
        there = tilting.pointing(u, 0.0)
        assert -0.2 <= there[1] <= 0.5 and -1.0 <= there[2] <= 1.0
        near += up(there) @ u >= max(up(p) @ u for p in grid) - 0.02
    assert near >= 40  # axis by axis is not always nearest on the sphere


def test_steps_of_a_dividing_head():
    head = Reach(middle=(-0.1, 1.7), step=np.radians(15))
    assert head.words == "middle angle -5.72958 to 97.4028 deg, steps of 15 deg"
    for u in DIRECTIONS:
        steps = np.degrees(head.pointing(u, 0.5)) / 15
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert head.allows((0.0, np.radians(90), np.radians(-345)))
    assert not head.allows((0.0, np.radians(105), 0.0))
    assert not head.allows((0.0, np.radians(10), 0.0))
    assert Reach().words == ""


def test_a_range_between_two_steps_has_no_angle():
    with refuses("table.range") as caught:
        Reach(inner=(0.1, 0.2), step=np.radians(15)).checked()
    assert "the inner axis has no angle that is a multiple of 15 deg" in caught.value.message


@pytest.mark.parametrize("seed", range(4))
def test_the_order_is_nearly_the_shortest(seed):
    """Within a tenth of the best of all orders, and never longer than the order as drawn."""
    angles = np.random.default_rng(seed).uniform(-pi, pi, (7, 3))
    time = travel_time(angles, 2.0)
    assert time[1, 4] == pytest.approx(time[4, 1])

    def length(order):
        return sum(time[a, b] for a, b in pairwise(order))

    found = shortest_order(time)
    assert sorted(found.tolist()) == list(range(7))
    best = min(length(p) for p in permutations(range(7)))
    assert best - 1e-12 <= length(found.tolist()) <= 1.1 * best
    assert length(found.tolist()) <= length(range(7))


def test_the_outer_axis_goes_the_shorter_way_the_others_do_not():
    outer = np.array([[-3.0, 0, 0], [3.0, 0, 0]])
    assert travel_time(outer, 1.0)[0, 1] == pytest.approx(2 * pi - 6.0)
    assert travel_time(outer[:, [1, 0, 2]], 1.0)[0, 1] == pytest.approx(6.0)
