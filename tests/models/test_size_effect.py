"""Lever arms and delay: as terms, against the vector equations, and taken away again."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.kernels import ins_transition as kernel
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.layouts import EVERY, gravity_slope, model_of
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.models.size_effect import SizeEffect, changes, with_size_effect
from foucault.navigate.increments import increments_of
from foucault.navigate.ins_filter import Updates, run
from foucault.navigate.strapdown import State, navigate
from foucault.tables import Log, usual_step


def inputs(w, f, dw, df):
    s = np.empty(kernel.INPUTS)
    kernel.sense.py_func(np.concatenate([w, f]), s, kernel.INPUTS - 1)
    s[37:40], s[40:43] = dw, df
    return s


def test_terms_are_the_size_effect_and_the_delay():
    rng = np.random.default_rng(2)
    sensors = with_size_effect(Sensors.of(["gyro.bias", "accel.scale"]))
    assert len(sensors) == 6 + 6 + 1 and sensors.gyros == 3
    for _ in range(5):
        w, f, dw, df = rng.normal(size=(4, 3))
        s = inputs(w, f, dw, df)
        r, tau = rng.normal(size=(2, 3)), rng.normal()
        value = np.concatenate([np.zeros(6), r.ravel(), [tau]])
        out = np.zeros(6)
        np.add.at(out, sensors.axis, sensors.weight * s[sensors.entry] * value[sensors.coefficient])
        want = -tau * df
        for i in range(2):
            want[i] += (np.cross(w, np.cross(w, r[i])) + np.cross(dw, r[i]))[i]
        np.testing.assert_allclose(out[3:], want, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(out[:3], 0.0)


def test_changes_are_central_differences():
    t = np.array([0.0, 0.01, 0.03, 0.04, 0.05])
    dt = np.diff(t, prepend=-0.01)
    middle = t - dt / 2
    slope, push = np.array([1.0, -2.0, 3.0]), np.array([5.0, 0.5, -1.0])
    dtheta, dvel = ((np.outer(middle, x) + 0.3) * dt[:, None] for x in (slope, push))
    left, right = np.ones(5), np.ones(5)
    left[[0, 3]], right[[2, 4]] = 0.0, 0.0  # a gap before row 3
    s = np.empty(kernel.INPUTS)
    for i in range(5):
        kernel.changes.py_func(dtheta, dvel, dt, left, right, i, 0.0, 1.0, s)
        np.testing.assert_allclose(s[37:43], np.concatenate([slope, push]), rtol=1e-9)
    kernel.changes.py_func(dtheta, dvel, dt, 0 * left, 0 * right, 2, 0.0, 1.0, s)
    np.testing.assert_array_equal(s[37:43], 0.0)


# -- taken away ------------------------------------------------------------------------------------

PLACES = np.array([[0.03, -0.02, 0.05], [-0.04, 0.06, 0.01], [0.02, 0.01, -0.03]])


def spinning(t, axis=(0.6, -0.8, 0.0), growth=0.4):
    """Return rate, specific force and their derivatives of a body that spins up at rest."""
    a = np.array(axis)
    angle, rate = 0.5 * growth * t**2, growth * t
    w, dw = np.outer(rate, a), np.outer(np.full(len(t), growth), a)
    f = np.array([exp(-a * x) @ [0.3, 0.1, 9.8] for x in angle])
    return w, f, dw, -np.cross(w, f)


def test_a_known_rotation_with_known_places_and_delay():
    """Accelerometers on circles: d2/dt2 of C_nb r_i, and the force of a moment ago."""
    t, tau, h = np.linspace(0.0, 3.0, 7), 2e-3, 1e-3
    w, _, dw, df = spinning(t)
    felt = SizeEffect(PLACES, tau).felt(w, dw, df)
    axis = np.array([0.6, -0.8, 0.0])
    for k, now in enumerate(t):
        at = [exp(axis * 0.2 * (now + s * h) ** 2) for s in (-1.0, 0.0, 1.0)]  # C_nb
        pull = at[1].T @ ((at[0] - 2 * at[1] + at[2]) / h**2) @ PLACES.T
        np.testing.assert_allclose(felt[k], np.diag(pull) - tau * df[k], atol=2e-6)


def test_what_the_filter_takes_away_is_what_is_applied():
    """The filter navigates with coefficients as the strapdown does with the compensated log."""
    rng = np.random.default_rng(7)
    names = ("gyro.bias", "gyro.scale", "gyro.misalignment", "gyro.deflection", "accel.bias",
             "accel.scale", "accel.misalignment", "accel.asymmetry", "accel.quadratic")  # fmt: skip
    sensors = with_size_effect(Sensors.of(names))
    p = len(sensors)
    estimate = 1e-5 * rng.normal(size=p)
    estimate[-7:] = 0.01 * rng.normal(size=7)
    vector = CoefficientVector(sensors.layout, estimate)
    w, f, _, _ = spinning(np.arange(300) / 100.0)
    log = Log(np.arange(300) / 100.0, w, f, "increment")
    state = State.at_rest(np.eye(3), 0.7)
    found = run(increments_of(log), state, sensors, Updates.none([299]), np.zeros((9 + p, 9 + p)),
                ImuNoise(), estimate=estimate)  # fmt: skip
    size = SizeEffect.of(vector)
    logs = size.apply(model_of(vector), log), model_of(vector).apply(log)
    with_it, without = (navigate(increments_of(made), state).state(-1) for made in logs)
    told = found.trajectory.state(-1)
    np.testing.assert_allclose(told.velocity_n, with_it.velocity_n, rtol=0, atol=2e-8)
    np.testing.assert_allclose(told.C_nb, with_it.C_nb, rtol=0, atol=2e-9)
    assert np.abs(told.velocity_n - without.velocity_n).max() > 0.01


def test_readings_are_turned_back_into_what_is_true():
    """Gyros that feel the force and accelerometers that feel the rate, to a second round."""
    rng = np.random.default_rng(8)
    names = ("gyro.deflection", "gyro.g_sensitivity", "accel.scale", "gyro.misalignment")
    layout = LAYOUT.subset([LAYOUT.names[i] for name in names for i in LAYOUT.group(name)])
    errors = CoefficientVector(layout, 1e-7 * rng.normal(size=len(layout)))
    model = ImuModel.from_coefficients(errors)
    size = SizeEffect(PLACES, 1e-3)
    w, f, dw, df = spinning(np.linspace(0.0, 4.0, 9))
    accel, gyro = model.measure(f, w)
    accel = accel + size.felt(w, dw, df)
    f_b, w_ib_b = size.compensate(model, accel, gyro, dw, df)
    np.testing.assert_allclose(f_b, f, rtol=0, atol=3e-9)
    np.testing.assert_allclose(w_ib_b, w, rtol=0, atol=1e-14)


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_changes_of_a_log_beside_a_gap(sampled):
    t = np.array([0.0, 0.01, 0.02, 0.03, 0.0375, 0.05, 0.09, 0.10, 0.11, 0.115])
    dt = np.diff(t, prepend=-usual_step(np.diff(t)))
    at = t - dt / 2 if sampled == "increment" else t
    slope, push = np.array([1.0, -2.0, 3.0]), np.array([5.0, 0.5, -1.0])
    log = Log(t, np.outer(at, slope) + 0.3, np.outer(at, push), sampled)
    dw, df = changes(log)
    alone = [6] if sampled == "increment" else []  # the mean after the gap is of no use
    some = np.setdiff1d(np.arange(10), alone)
    np.testing.assert_allclose(dw[some], np.tile(slope, (len(some), 1)), rtol=1e-9)
    np.testing.assert_allclose(df[some], np.tile(push, (len(some), 1)), rtol=1e-9)
    assert not dw[alone].any()
    means = Log(t, log.gyro, log.accel, averaged=np.full(10, 5.0))
    assert not np.any(changes(means))
    assert not np.any(changes(log[:1]))


def test_coefficients_and_places_are_two_forms_of_one_thing():
    size = SizeEffect(PLACES - PLACES[2], 2e-3)
    vector = size.coefficients()
    assert vector.names == SIZE_EFFECT.names and len(vector) == 7
    again = SizeEffect.of(vector)
    np.testing.assert_array_equal(again.arms, size.arms)
    assert again.delay == size.delay and bool(again)
    assert not SizeEffect() and SizeEffect(delay=1e-6)
    shifted = SizeEffect(PLACES, 2e-3).coefficients()
    np.testing.assert_allclose(shifted.values, vector.values)
    assert all(name in EVERY for name in vector.names)
    whole = ImuModel().coefficients().with_others(vector)
    assert model_of(whole).accel_linear and not gravity_slope(whole)[-7:].any()


def test_a_log_without_one_triad():
    log = Log(np.arange(3.0), np.ones((3, 3)), None)
    np.testing.assert_array_equal(SizeEffect(PLACES).apply(ImuModel(), log).gyro, log.gyro)
    with pytest.raises(ValueError, match="need the gyro readings"):
        SizeEffect(PLACES).apply(ImuModel(), Log(np.arange(3.0), None, np.ones((3, 3))))
