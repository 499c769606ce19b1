"""What goes before and after the information of a plan: compiled, as Python, and by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels.cluster_plan import attitudes, commanded, remaining
from foucault.models.cluster import attitude_of
from foucault.models.earth import earth_rate_n
from foucault.plans.tumble import from_rates, nominal, starting

RATES = np.radians([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -0.2, 0.2], [0.1, 0.1, -0.1]])
SLOTS = np.array([7, 2, 9, 6])
SLOT, LATITUDE = 15.0, 0.7
START = np.array([0.3, -0.2, 0.5])
W = earth_rate_n(LATITUDE)


def planned():
    plan = from_rates(list(RATES), (SLOTS * SLOT).tolist())
    return nominal(starting(plan, START), LATITUDE, SLOT)


def test_command_and_attitude_are_those_of_the_plan():
    expected = planned()
    args = (RATES, SLOTS, SLOT, attitude_of(START))
    np.testing.assert_allclose(commanded(*args, W), expected.command, rtol=0, atol=1e-16)
    np.testing.assert_allclose(attitudes(*args), expected.C_pn, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("kernel", "arguments"),
    [
        (commanded, (RATES, SLOTS, SLOT, attitude_of(START), W)),
        (attitudes, (RATES, SLOTS, SLOT, attitude_of(START))),
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
