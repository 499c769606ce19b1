"""The bound of a torquing plan: compiled and as Python, and made of parts that are known."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.estimate.tumble import Prior, State, Tumble
from foucault.estimate.tumble_pass import look
from foucault.kernels.cluster_plan import (
    attitudes,
    commanded,
    plan_bound,
    plan_information,
    remaining,
)
from foucault.models.cluster import attitude_of
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import exp
from foucault.plans.torquing import from_rates, nominal, starting
from make_cluster import G, make_cluster

RATES = np.radians([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -0.2, 0.2], [0.1, 0.1, -0.1]])
SLOTS = np.array([7, 2, 9, 6])
SLOT, LATITUDE = 15.0, 0.7
START = np.array([0.3, -0.2, 0.5])
W = earth_rate_n(LATITUDE)


def planned():
    plan = from_rates(list(RATES), (SLOTS * SLOT).tolist())
    return nominal(starting(plan, START), LATITUDE, SLOT)


def given():
    scale = np.full(46, 1e-3)
    C_np = np.ascontiguousarray((exp(np.array([0.03, 0.01, -0.02])) @ attitude_of(START)).T)
    arms = np.diag([0.05, 0.05, 0.05])
    return (RATES, SLOTS, SLOT, attitude_of(START), W, make_cluster(1, 1.0).packed(G), scale, C_np,
            1e-13, 1e-10, arms, G)  # fmt: skip


def test_command_and_attitude_are_those_of_the_plan():
    expected = planned()
    args = (RATES, SLOTS, SLOT, attitude_of(START))
    np.testing.assert_allclose(commanded(*args, W), expected.command, rtol=0, atol=1e-16)
    np.testing.assert_allclose(attitudes(*args), expected.C_pn, rtol=0, atol=1e-13)


def test_bound_is_that_of_the_filter_that_solves_readings():
    """`estimate.tumble_pass` solves by NumPy; the same plan as a log of means over the slots."""
    _rates, slots, slot, _, w, theta, scale, C_np, q, r, arms, g = given()
    n = int(slots.sum())
    log = Tumble(
        np.full(n, slot), planned().command, np.zeros((n, 3)), np.ones(n, bool), w, g, q, r, arms,
        mean=True,
    )  # fmt: skip
    sd = np.append(scale[:45], 0.0)  # the delay is known
    at = State(C_np, theta)
    expected = np.sqrt(np.diag(look(log, Prior(at, sd), at).cov))[:45]
    np.testing.assert_allclose(plan_bound(*given()), expected, rtol=1e-6)  # cond 1e8


@pytest.mark.parametrize(
    ("kernel", "arguments"),
    [
        (commanded, (RATES, SLOTS, SLOT, attitude_of(START), W)),
        (attitudes, (RATES, SLOTS, SLOT, attitude_of(START))),
        (plan_information, given()),
        (plan_bound, given()),
    ],
)
def test_compiled_as_python(kernel, arguments):
    plain = kernel.py_func(*arguments)
    np.testing.assert_allclose(
        kernel(*arguments), plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max()
    )


@pytest.mark.parametrize("python", [False, True])
def test_remaining_is_the_root_of_the_diagonal_of_the_inverse(python):
    function = remaining.py_func if python else remaining
    A = np.random.default_rng(3).normal(size=(60, 45))
    expected = np.sqrt(np.diag(np.linalg.inv(A.T @ A + np.eye(45))))
    np.testing.assert_allclose(function(A.T @ A), expected, rtol=1e-10)
    assert np.isnan(function(-10 * np.eye(45))).all()
