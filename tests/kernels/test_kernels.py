"""Every kernel, compiled and as plain Python, against its obvious twin."""

from __future__ import annotations

from itertools import pairwise

import numba
import numpy as np
import pytest

import reference
from foucault.kernels.moving import moving_moments
from foucault.kernels.rotation import (
    integrate_turns,
    integrate_turns_rk4,
    multiply_exp,
    running_product,
)
from foucault.models.rotation import exp, log

# `integrate_turns` calls a compiled kernel even as .py_func: that one is tested on its own.
FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def _form(kernel, form):
    if form == "python":
        return kernel.py_func
    called_by_python = not kernel.targetoptions.get("no_cpython_wrapper")
    return kernel if called_by_python else numba.njit(lambda *given: kernel(*given))


@FORMS
@pytest.mark.parametrize("window", [3, 5, 51])
def test_moving_moments(form, window):
    x = np.random.default_rng(1).normal(size=(200, 3)) * [1.0, 1e-3, 10.0] + [0.0, 9.8, -1e3]
    mean, variance = _form(moving_moments, form)(x, window)
    want_mean, want_variance = reference.moving_moments(x, window)
    # Sums of `window` numbers about a reference that is one of them.
    np.testing.assert_allclose(mean, want_mean, rtol=1e-14 * window)
    np.testing.assert_allclose(variance, want_variance, rtol=1e-13 * window)


@FORMS
def test_moving_moments_of_a_log_shorter_than_the_window(form):
    mean, variance = _form(moving_moments, form)(np.ones((4, 3)), 5)
    assert np.isnan(mean).all() and np.isnan(variance).all()


@FORMS
def test_moving_moments_hand_a_nan_on_and_forget_it(form):
    x = np.random.default_rng(2).normal(size=(60, 2))
    x[30, 1] = np.nan
    mean, variance = _form(moving_moments, form)(x, 5)
    assert np.isfinite(mean[2:-2, 0]).all()
    assert np.isnan(mean[28:33, 1]).all() and np.isnan(variance[28:33, 1]).all()
    # The sums start afresh once per window, so one NaN reaches at most a window further.
    assert np.isfinite(mean[38:-2, 1]).all()


def test_moving_variance_does_not_drift_over_a_long_log():
    x = 1e6 + np.random.default_rng(3).normal(size=(300_000, 1))
    _, variance = moving_moments(x, 101)
    tail = x[-101:]
    # The spacing of doubles near 1e6 is 1e-10; nothing may have accumulated on top of it.
    assert variance[-51, 0] == pytest.approx(tail.var(ddof=1), rel=1e-9)


@FORMS
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-2, 0.0316, 0.0317, 1.0, 3.0, 7.0])
def test_multiply_exp(form, size):
    rng = np.random.default_rng(4)
    C = exp(rng.normal(size=3))
    p = rng.normal(size=3)
    p *= size / np.linalg.norm(p)
    got = C.copy()
    _form(multiply_exp, form)(got, *p)
    np.testing.assert_allclose(got, reference.multiply_exp(C, p), atol=3e-15)


def _motion():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.008, 0.012, 90))
    w = np.cumsum(rng.normal(0, 0.3, (90, 3)), axis=0)
    f = rng.normal(0, 10, (90, 3))
    psd = np.cov(rng.normal(size=(3, 9)))
    return time, w, f, psd, np.array([0, 30, 60]), np.array([25, 30, 89])


@FORMS
@pytest.mark.parametrize("increments", [False, True])
def test_integrate_turns(form, increments):
    motion = _motion()
    got = _form(integrate_turns, form)(*motion, increments)
    want = reference.integrate_turns(*motion, increments)
    for a, b in zip(got, want, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)
    assert np.array_equal(got[0][1], np.eye(3))  # a turn without samples


@FORMS
def test_running_product(form):
    step = np.random.default_rng(6).normal(size=(7, 3, 3))
    got = _form(running_product, form)(step)
    np.testing.assert_allclose(got, reference.running_product(step), rtol=1e-12, atol=1e-13)
    assert _form(running_product, form)(step[:0]).tolist() == [np.eye(3).tolist()]


@FORMS
def test_integrate_turns_rk4(form):
    time, w, _, _, first, last = _motion()
    got = _form(integrate_turns_rk4, form)(time, w, first, last)
    np.testing.assert_allclose(got, reference.integrate_turns_rk4(time, w, first, last), atol=1e-13)


@FORMS
def test_a_nan_stays_in_its_turn(form):
    time, w, f, psd, first, last = _motion()
    w[10, 1] = np.nan
    C_se, _, scale, _, _, path = _form(integrate_turns, form)(time, w, f, psd, first, last, False)
    rk4 = _form(integrate_turns_rk4, form)(time, w, first, last)
    for x in (C_se, scale, rk4):
        assert np.isnan(x[0]).any() and np.isfinite(x[1:]).all()
    assert np.isnan(path[0]) and np.isfinite(path[1:]).all()
    assert np.isnan(C_se[0]).all()


def _coning(dt: float, increments: bool):
    """C = Exp(a(t)) with a(t) a smooth curve; rates by the closed form of the right Jacobian."""
    from numpy.polynomial.legendre import leggauss

    def rate(t):
        a = np.stack([0.6 * np.sin(3 * t), 0.5 * np.cos(3 * t), 0.8 * t], -1)
        d = np.stack([1.8 * np.cos(3 * t), -1.5 * np.sin(3 * t), 0.8 + 0 * t], -1)
        size = np.linalg.norm(a, axis=-1, keepdims=True)
        first = (1 - np.cos(size)) / size**2 * np.cross(a, d)
        second = (size - np.sin(size)) / size**3 * np.cross(a, np.cross(a, d))
        return a, d - first + second

    time = np.arange(-4, round(1.2 / dt) + 5) * dt
    a, w = rate(time)
    if increments:
        nodes, weights = leggauss(6)
        at = time[:, None] + dt * (nodes - 1) / 2
        w = np.einsum("k,nkj->nj", weights / 2, rate(at)[1])
    begin, end = 4, 4 + round(1.2 / dt)
    truth = exp(a[begin]).T @ exp(a[end])
    turn = (np.array([begin]), np.array([end]))
    C_se = integrate_turns(time, w, w, np.zeros((3, 3)), *turn, increments)[0][0]
    return np.linalg.norm(log(truth.T @ C_se))


@pytest.mark.parametrize(("increments", "order"), [(False, 4), (True, 3)])
def test_the_error_of_a_turn_falls_with_its_order(increments, order):
    errors = [_coning(dt, increments) for dt in (0.02, 0.01, 0.005)]
    # The next term is smaller by about w dt = 0.03: the ratio is within a tenth of an order.
    for coarse, fine in pairwise(errors):
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


def test_sensitivities_are_derivatives_of_the_rotation():
    dt = 0.0025
    time = np.arange(0, 400) * dt
    w = np.stack([np.sin(4 * time), 1.5 * np.cos(3 * time), time], 1)
    f = np.stack([9 * np.cos(time), 9 * np.sin(time), 1 + time], 1)
    turn = (np.array([2]), np.array([390]))
    zero = np.zeros((3, 3))
    _, bias, scale, force, _, _ = integrate_turns(time, w, f, zero, *turn, False)

    def turned(dw):
        up = integrate_turns(time, w + dw, f, zero, *turn, False)[0][0]
        down = integrate_turns(time, w - dw, f, zero, *turn, False)[0][0]
        return log(up @ down.T) / 2

    step = 1e-4
    # The middle rule of the sensitivities: dt^2/24 x (w^2 + w') x (time) x |input|, w up to 2,
    # w' up to 5, one second: below 3e-6 of the input. The step itself gives step^2.
    rule = dt**2 / 24 * (2**2 + 5)
    for i in range(3):
        e = np.eye(3)[i] * step
        np.testing.assert_allclose(bias[0][:, i], turned(e) / step, atol=rule)
        for k in range(3):
            for by, x in ((scale, w), (force, f)):
                numeric = turned(e * x[:, k : k + 1]) / step
                limit = (rule + step**2 * np.abs(x[:, k]).max()) * np.abs(x[:, k]).max()
                np.testing.assert_allclose(by[0][:, 3 * i + k], numeric, atol=limit)


def test_noise_of_a_turn_is_its_power_times_the_time():
    time, w, f, _, first, last = _motion()
    noise = integrate_turns(time, w, f, 0.3 * np.eye(3), first, last, False)[4]
    for j in range(3):  # white noise that is alike on all axes stays so in any axes
        want = 0.3 * (time[last[j]] - time[first[j]]) * np.eye(3)
        np.testing.assert_allclose(noise[j], want, atol=1e-14)
