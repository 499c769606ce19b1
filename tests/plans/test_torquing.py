"""Torquing plans: the published one, sequences, lists, ramps, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.cluster import angles_of
from foucault.models.earth import EARTH_RATE, earth_rate_n
from foucault.models.rotation import exp
from foucault.plans.tumble import (
    PUBLISHED,
    RATE,
    TorquingPlan,
    from_rates,
    nominal,
    published,
    sequence,
    starting,
)
from refusals import refuses

LATITUDE = np.radians(40.0)
EAST, NORTH, UP = np.eye(3)

# End of each step of the published plan: where x, y and z of the cluster point (source, table).
ENDS = {
    0: (NORTH, UP, EAST),
    1800: (NORTH, -UP, -EAST),
    2700: (UP, NORTH, -EAST),
    4500: (-UP, NORTH, EAST),
    5400: (NORTH, UP, EAST),
}


def test_published_plan_ends_where_the_source_says():
    told = nominal(PUBLISHED, LATITUDE)
    assert len(told.command) == 5400 == PUBLISHED.duration
    np.testing.assert_array_equal(told.time, np.arange(5401.0))
    for time, axes in ENDS.items():
        np.testing.assert_allclose(told.C_pn[time], axes, atol=1e-14)


def test_published_angles_are_those_of_the_source():
    """Outer 0 to 180 deg, inner to 90, outer to 360, inner back; middle never leaves zero."""
    angles = np.degrees(angles_of(nominal(PUBLISHED, LATITUDE).C_pn))
    assert np.abs(angles[:, 1]).max() < 1e-12
    time = np.arange(5401.0)
    outer = np.interp(time, [0, 1800, 2700, 4500, 5400], [0, 180, 180, 360, 360])
    inner = np.interp(time, [0, 1800, 2700, 4500, 5400], [0, 0, 90, 90, 0])
    np.testing.assert_allclose((angles[:, 0] - outer + 180) % 360 - 180, 0, atol=1e-10)
    np.testing.assert_allclose(angles[:, 2], inner, atol=1e-10)


@pytest.mark.parametrize("interval", [1.0, 0.2])
def test_command_is_the_plan_and_the_rotation_of_the_earth(interval):
    told = nominal(starting(PUBLISHED, np.array([0.1, -0.3, 2.0])), LATITUDE, interval)
    w_n = earth_rate_n(LATITUDE)
    for k in (0, 100, len(told.command) // 2, len(told.command) - 1):
        middle = exp(-told.rate[k] * interval / 2) @ told.C_pn[k]
        np.testing.assert_allclose(told.command[k] - told.rate[k], middle @ w_n, atol=1e-19)
    steps = exp(-told.rate * interval) @ told.C_pn[:-1]
    np.testing.assert_allclose(told.C_pn[1:], steps, atol=1e-14)
    assert set(np.unique(told.rate)) == {-RATE, 0.0, RATE}


def test_an_exact_cluster_follows_the_plan():
    """But for the turn of the Earth's rate in p within a second: w_in w_np^2 / 24 of it each."""
    told = nominal(PUBLISHED, LATITUDE)
    C, w_n = told.C_pn[0], earth_rate_n(LATITUDE)
    for k, w in enumerate(told.command):
        C = exp(-w) @ C @ exp(w_n)
        if k % 450 == 449:
            lost = EARTH_RATE * RATE**2 / 24 * (k + 1)
            assert np.linalg.norm(C - told.C_pn[k + 1]) < np.sqrt(2) * lost + 1e-12
    # Were the Earth's rate left out, it would be off by 0.36 rad.
    assert np.linalg.norm(w_n) * 5400 > 0.3


def test_another_rate_goes_through_the_same_angles():
    fast = published(2 * RATE)
    assert fast.duration == pytest.approx(2700.0)
    np.testing.assert_allclose(
        nominal(fast, LATITUDE, 0.5).C_pn, nominal(PUBLISHED, LATITUDE).C_pn, atol=1e-13
    )


def test_a_sequence_of_signed_axes():
    plan = sequence("-x z, +y -Z", 0.01, segment=30.0)
    assert plan.name == "-x +z +y -z"
    np.testing.assert_array_equal(
        plan.rates, 0.01 * np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, -1]])
    )
    np.testing.assert_array_equal(plan.ends, [0, 30, 60, 90, 120])
    assert [step.time for step in sequence("x y", total=50.0).steps] == pytest.approx([25, 25])
    assert sequence("-x -z -y +z").duration == pytest.approx(5400)
    assert plan.steps[0].label == "-x 17.19 deg"


def test_a_list_of_rates_starts_where_it_is_told():
    plan = from_rates([np.array([0.01, 0.02, 0.0]), np.zeros(3)], [10.0, 5.0])
    start = np.array([0.2, 1.2, -0.4])
    told = nominal(starting(plan, start), LATITUDE)
    np.testing.assert_allclose(angles_of(told.C_pn[0]), start, atol=1e-14)
    np.testing.assert_allclose(
        told.C_pn[10], exp(np.array([-0.1, -0.2, 0.0])) @ told.C_pn[0], atol=1e-15
    )
    np.testing.assert_array_equal(told.C_pn[10:], told.C_pn[10:11].repeat(6, axis=0))


def test_steps_that_end_within_a_command():
    """The mean rate of the second in which a step ends: the angle stays exact."""
    plan = sequence("x -x", 0.01, segment=10.3)
    told = nominal(plan, LATITUDE)
    assert len(told.command) == 21
    assert told.rate[10, 0] == pytest.approx(0.01 * (0.3 - 0.7))
    assert told.rate[20, 0] == pytest.approx(-0.01 * 0.6)
    assert told.rate[:, 0].sum() == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(told.C_pn[-1], told.C_pn[0], atol=1e-14)


@pytest.mark.parametrize("ramp", [2.0, 3.7])
def test_a_ramp_keeps_the_angles(ramp):
    plan = starting(sequence("x z", 0.01, segment=40.0), np.zeros(3), ramp)
    assert plan.duration == 80 + ramp
    fine = np.linspace(0, plan.duration, 100 * 80 + 1)
    rate = plan.mean_rates(fine)
    np.testing.assert_allclose(
        (rate * np.diff(fine)[:, None]).sum(axis=0), [0.4, 0, 0.4], atol=1e-12
    )
    middle = (fine[1:] + fine[:-1]) / 2
    want_x = np.interp(middle, [0, ramp, 40, 40 + ramp], [0, 0.01, 0.01, 0])
    want_z = np.interp(middle, [40, 40 + ramp, 80, 80 + ramp], [0, 0.01, 0.01, 0])
    np.testing.assert_allclose(rate[:, 0], want_x, atol=1e-5)  # one interval of the ramp
    np.testing.assert_allclose(rate[:, 2], want_z, atol=1e-5)
    told = nominal(plan, LATITUDE)
    steps = exp(-told.rate) @ told.C_pn[:-1]
    np.testing.assert_allclose(told.C_pn[1:], steps, atol=1e-14)


def refused(code, make, match):
    with refuses(code, match=match):
        make()


def test_plans_that_cannot_be():
    x = np.array([0.01, 0.0, 0.0])
    refused("torquing.empty", lambda: sequence("  "), "has no steps")
    refused("torquing.empty", lambda: TorquingPlan("mine", np.zeros(3), ()), "'mine' has no steps")
    refused("torquing.time", lambda: from_rates([x], [0.0]), r"Step 1 .* takes 0.0 s")
    refused("torquing.time", lambda: from_rates([x, x], [1.0, np.inf]), "Step 2 .* takes inf s")
    refused("torquing.time", lambda: starting(PUBLISHED, np.zeros(3), -1.0), "The ramp .* -1.0 s")
    refused(
        "torquing.rate",
        lambda: from_rates([x * np.nan], [1.0]),
        "Step 1 .* rate nan, nan, nan rad/s",
    )
    refused("torquing.rate", lambda: from_rates([x[:2]], [1.0]), "Step 1 .* rate 0.01, 0 rad/s")
    refused("torquing.rate", lambda: sequence("x", 0.0), "rate 0 rad/s")
    refused("torquing.sequence", lambda: sequence("-x -w"), "'-w' is neither an axis")
    refused("torquing.sequence", lambda: sequence("publishd"), "Did you mean 'published'")


def test_a_rate_beyond_the_limit_of_the_rig():
    assert PUBLISHED.within(RATE) is PUBLISHED
    plan = from_rates([np.array([0.0, 0.002, 0.0]), np.array([0.0, 0.0, -0.004])], [1.0, 1.0])
    refused(
        "torquing.limit", lambda: plan.within(0.003),
        r"Step 2 of the torquing plan 'user plan' turns at 0.229183 deg/s about z; .* 0.171887",
    )  # fmt: skip
