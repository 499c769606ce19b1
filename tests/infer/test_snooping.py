"""Data snooping: what an error of one reading does, against errors that were really put in."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.infer import mixed
from foucault.infer.mixed import Source
from foucault.infer.snooping import ALIKE, POWER, SEEN, Snooping, snoop, snoop_fit
from foucault.models.imu import ImuModel
from foucault.plans.directions import directions
from foucault.result import Linearised
from make_table import ACCEL_NAMES, model_of, plan_of, silent

SD = 1e-6  # of a reading, in g


@cache
def rests(plan):
    r, _ = silent(plan_of(plan, spins=False), ImuModel(), sd=SD)
    return replace(r, gyro=None)


def snooped(readings):
    got = mixed.solve(model_of(readings, names=ACCEL_NAMES))
    return snoop_fit(got), got


def test_antipodes_of_the_icosahedron_cannot_be_told_apart():
    u = directions("icosahedron 12")
    s, _ = snooped(rests("icosahedron 12"))
    opposite = np.argmin(u @ u.T, axis=1)
    for j in range(12):
        assert s.correlation[j, opposite[j]] == pytest.approx(1.0, abs=1e-9)
        assert s.alike(j).tolist() == [opposite[j]]
    # Twelve readings of three, nine coefficients and twenty-four angles leave three equations.
    assert s.redundancy.sum() == pytest.approx(3.0, abs=1e-9)
    np.testing.assert_allclose(s.redundancy, 0.25, atol=1e-9)
    assert (s.dof == 1).all()


def test_what_is_redundant_is_the_norm_alone():
    s, _ = snooped(rests("dodecahedron 20"))
    u = directions("dodecahedron 20")
    np.testing.assert_allclose(np.abs(np.sum(s.direction * u, axis=1)), 1.0, atol=1e-6)
    assert s.redundancy.sum() == pytest.approx(11.0, abs=1e-9)
    np.testing.assert_allclose(s.redundancy, 11 / 20, atol=1e-6)
    assert max(len(s.alike(j)) for j in range(20)) == 0


@pytest.mark.parametrize("plan", ["dodecahedron 20", "14 faces and corners"])
@pytest.mark.parametrize("j", [0, 9])
def test_detectable_error_against_one_that_was_put_in(plan, j):
    r = rests(plan)
    s, _ = snooped(r)
    # An error of so many sd makes the test value what 80 % of all cases exceed.
    wrong = r.accel.copy()
    wrong[j] += s.detectable[j] * s.direction[j] * SD * 9.81
    seen, _ = snooped(replace(r, accel=wrong))
    assert seen.test[j] == pytest.approx(POWER**2, rel=1e-3)
    assert np.argmax(seen.test) == j or np.isclose(seen.test.max(), seen.test[j], rtol=1e-3)
    # The others see the share that the correlation says.
    others = POWER**2 * s.correlation[j] ** 2
    np.testing.assert_allclose(seen.test, others, atol=2e-3 * POWER**2)


def test_power_is_that_of_a_test_at_a_tenth_of_a_percent():
    from scipy.stats import norm

    limit = norm.isf(0.0005)
    found = norm.sf(limit - POWER) + norm.cdf(-limit - POWER)
    assert found == pytest.approx(0.80, abs=0.002)


def test_across_a_direction_nothing_is_controlled():
    r = rests("dodecahedron 20")
    wrong = r.accel.copy()
    wrong[4] += 1e-3 * np.cross(directions("dodecahedron 20")[4], [1.0, 2.0, 3.0])
    before, after = snooped(r)[0], snooped(replace(r, accel=wrong))[0]
    # To first order: the square of the angle shortens nothing, as the norm is taken exactly.
    assert np.abs(after.test - before.test).max() < 1e-2


def test_an_observation_that_alone_tells_an_unknown_is_not_controlled():
    J = np.zeros((9, 3))
    J[:3] = np.eye(3)
    P = np.eye(3)
    at = Linearised(np.arange(9.0), J, np.repeat([0, 1, 2], 3))
    s = snoop(at, P)
    assert s.dof.tolist() == [0, 3, 3]
    assert s.detectable[0] == np.inf
    assert s.redundancy[0] < SEEN
    # Observations that are all redundant and share nothing: plain sums of squares.
    np.testing.assert_allclose(s.test, [0.0, 9 + 16 + 25, 36 + 49 + 64])
    assert s.test[0] == 0.0


def test_priors_are_not_observations():
    J = np.concatenate([np.tile(np.eye(3), (4, 1)), np.eye(3)])
    P = np.linalg.inv(J.T @ J)
    at = Linearised(np.ones(15), J, np.concatenate([np.repeat([5, 2, 7, 1], 3), [-1, -1, -1]]))
    s = snoop(at, P)
    assert s.blocks.tolist() == [5, 2, 7, 1]
    np.testing.assert_allclose(s.redundancy, 1 - 1 / 5)
    np.testing.assert_allclose(s.test, 3 / (1 - 1 / 5))


def test_alike_returns_numbers_of_observations():
    correlation = np.eye(3)
    correlation[0, 2] = correlation[2, 0] = (1 + ALIKE) / 2
    one = np.ones(3)
    s = Snooping(np.array([4, 5, 6]), one, one, one, np.eye(3), correlation)
    assert s.alike(0).tolist() == [6]
    assert s.alike(1).tolist() == []


def test_what_ties_readings_together_is_a_covariance_as_any_other():
    """A bias that all rests share leaves nothing of theirs to see, and tests stay those of z."""
    u = directions("dodecahedron 20")
    r = rests("dodecahedron 20")
    rng = np.random.default_rng(2)
    bias, sd = 50 * SD * 9.81, SD * 9.81
    r = replace(r, accel=r.accel + sd * rng.normal(size=r.accel.shape))
    model = model_of(r, names=ACCEL_NAMES)
    tie = Source("tie", shared=np.tile(np.eye(3), (20, 1, 1)), sd=bias)
    model.__dict__["sources"] = (*model.sources, tie)
    fit = mixed.solve(model)
    s, alone = snoop_fit(fit), snooped(r)[0]
    # The unknown bias takes up what they share: single readings are tested as without it.
    np.testing.assert_allclose(s.test, alone.test, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(s.redundancy, alone.redundancy, atol=1e-3)
    np.testing.assert_allclose(np.abs(np.sum(s.direction * u, axis=1)), 1.0, atol=1e-3)
