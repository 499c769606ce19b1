"""The motion of a torqued cluster, compiled and as plain Python, against its obvious twins."""

from __future__ import annotations

import numpy as np
import pytest

import reference
from foucault.kernels import cluster_motion as module
from foucault.models.cluster import angles_of, attitude_of
from foucault.models.earth import earth_rate_n
from make_cluster import G, make_cluster
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
W_N = earth_rate_n(0.7)
START = np.array([0.3, -0.2, 1.1])


def driven(n=40, rate=1e-3, noise=1e-4, seed=1):
    """A cluster, what it is told, and noise that is seen."""
    rng = np.random.default_rng(seed)
    command = rate * rng.standard_normal((n, 3)).repeat(4, axis=0)[:n]
    return make_cluster(seed, 10.0), command, noise * rng.standard_normal((n, 3))


def exponential(form, model, command, noise, dt=0.2, C=None):
    C_pn = np.empty((len(command) + 1, 3, 3))
    C_pn[0] = attitude_of(START) if C is None else C
    kernel(form, module, "integrate_exponential")(model.packed(G), C_pn, command, noise, W_N, dt)
    return C_pn


@FORMS
@pytest.mark.parametrize("rate", [1e-3, 1e-2])
def test_exponential_is_one_rotation_per_interval(form, rate):
    model, command, noise = driven(rate=rate)
    got = exponential(form, model, command, noise)
    want = reference.cluster_exponential(
        model, G, attitude_of(START), command, noise, W_N, 0.2
    )  # fmt: skip
    # The attitude in the middle, where drift is taken, is right to second order of a half step.
    np.testing.assert_allclose(got, want, atol=1e-8 * (rate * 0.2) + 1e-13)


def test_error_of_an_interval_falls_with_its_square():
    """Against a hundred times finer steps: halving the interval leaves a quarter."""
    model = make_cluster(2, 100.0)
    command = np.tile([0.02, -0.03, 0.01], (64, 1))
    fine = exponential("compiled", model, command.repeat(100, 0), np.zeros((6400, 3)), 0.01)[-1]
    off = []
    for k in (1, 2, 4):
        still = np.zeros((64 * k, 3))
        end = exponential("compiled", model, command.repeat(k, 0), still, 1.0 / k)[-1]
        off.append(np.abs(end - fine).max())
    assert off[0] / off[1] == pytest.approx(4, rel=0.1)
    assert off[1] / off[2] == pytest.approx(4, rel=0.1)


@FORMS
def test_backwards_and_forwards_is_where_it_began(form):
    model, command, _ = driven()
    still = np.zeros_like(command)
    there = exponential(form, model, command, still)
    back = exponential(form, model, command[::-1].copy(), still, -0.2, there[-1])
    np.testing.assert_allclose(back[::-1], there, atol=1e-9)


@FORMS
def test_many_steps_leave_a_rotation(form):
    n = 600 if form == "python" else 200_000
    model, command, noise = driven(n)
    C = exponential(form, model, command, noise)[-1]
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-13)


@FORMS
def test_angles_are_integrated_by_classical_runge_kutta(form):
    model, command, _ = driven(5, rate=0.05)
    noise = 1e-3 * np.random.default_rng(3).standard_normal((5, 4, 3))
    C_pn, angles = np.empty((6, 3, 3)), START.copy()
    C_pn[0] = attitude_of(START)
    lost = kernel(form, module, "integrate_angles")(
        model.packed(G), angles, command, noise, W_N, 0.02, C_pn
    )
    end, want = reference.cluster_angles(model, G, START, command, noise, W_N, 0.02)
    assert lost == -1
    np.testing.assert_allclose(angles, end, rtol=1e-13)
    np.testing.assert_allclose(C_pn[1:], want, atol=1e-14)
    np.testing.assert_allclose(angles_of(C_pn[-1]), angles, atol=1e-14)


@FORMS
def test_angles_say_where_they_are_lost(form):
    """Straight through middle = 90 deg: outer and inner jump there, and the rule cannot follow."""
    model = make_cluster(1, 0.0)
    n = 40
    command = np.tile([0.0, -0.05, 0.0], (n, 1))  # turns middle upwards
    start = np.array([0.0, np.pi / 2 - 0.05, 0.0])
    C_pn, angles = np.empty((n + 1, 3, 3)), start.copy()
    lost = kernel(form, module, "integrate_angles")(
        model.packed(G), angles, command, np.zeros((n, 100, 3)), W_N, 0.2, C_pn
    )
    # 0.05 rad at 0.05 rad/s take 1 s, 5 intervals; a step is a fiftieth of 5 mrad.
    assert lost in (4, 5)


@FORMS
@pytest.mark.parametrize("phase", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("arm", [0.0, 0.1])
def test_readings_part_of_the_way(form, phase, arm):
    model, command, noise = driven(30, rate=0.1)
    C_pn = exponential("compiled", model, command, noise)
    rng = np.random.default_rng(4)
    arms, turn = arm * rng.standard_normal((3, 3)), 1e-2 * rng.standard_normal((30, 3))
    got = kernel(form, module, "readings_at")(model.packed(G), C_pn, command, turn, arms, G, phase)
    want = reference.cluster_readings(model, G, C_pn, command, turn, arms, phase)
    np.testing.assert_allclose(G * got, want, atol=2e-14)


@FORMS
def test_readings_of_a_cluster_that_stands_still(form):
    model, C_pn = make_cluster(5), np.tile(attitude_of(START), (4, 1, 1))
    zeros = np.zeros((3, 3))
    got = kernel(form, module, "readings_at")(model.packed(G), C_pn, zeros, zeros, zeros, G, 0.5)
    np.testing.assert_allclose(G * got, np.tile(model.read(G * C_pn[0, :, 2]), (3, 1)), atol=1e-14)
