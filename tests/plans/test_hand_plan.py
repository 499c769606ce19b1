"""The plan of a hand: where it rests, for how long, and that a seed fixes it."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.detect.coverage import coverage
from foucault.plans.directions import hand_plan, spread_directions


@pytest.mark.parametrize("n", [9, 24, 60])
def test_directions_are_spread_evenly(n):
    d = spread_directions(n)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-15)
    assert np.linalg.norm(d.mean(axis=0)) < 0.05
    apart = np.arccos(np.clip(d @ d.T - 2 * np.eye(n), -1, 1))
    # n caps that fill the sphere have a radius of 2 / sqrt(n); neighbours are not much nearer.
    assert apart.min() > 0.7 * 2 / np.sqrt(n) * np.sqrt(2)


@pytest.mark.parametrize("rests", [12, 24])
def test_a_plan_starts_with_z_up_and_goes_everywhere(rests):
    plan = hand_plan(rests)
    np.testing.assert_allclose(plan.C_nb[0, 2], [0, 0, 1], atol=1e-15)
    eye = np.broadcast_to(np.eye(3), plan.C_nb.shape)
    np.testing.assert_allclose(plan.C_nb @ np.swapaxes(plan.C_nb, 1, 2), eye, atol=1e-14)
    seen = coverage(plan.C_nb[:, 2])
    assert seen.missing == () and seen.half_space < 0


def test_times_are_as_asked():
    plan = hand_plan(10, rest_time=4.0, turn_time=2.0, first_rest_time=7.0, seed=3)
    assert plan.rest_time[0] == 7.0
    assert ((plan.rest_time[1:] >= 3.2) & (plan.rest_time[1:] <= 4.8)).all()
    assert ((plan.turn_time >= 1.6) & (plan.turn_time <= 2.4)).all()
    assert plan.duration == pytest.approx(plan.rest_time.sum() + plan.turn_time.sum())
    assert plan.wobble.shape == plan.sway.shape == (9, 3)


def test_a_seed_fixes_the_plan():
    one, same, other = hand_plan(seed=1), hand_plan(seed=1), hand_plan(seed=2)
    assert np.array_equal(one.C_nb, same.C_nb)
    assert not np.array_equal(one.C_nb, other.C_nb)
