"""Lever arms and delay as terms, against the vector equations written out."""

from __future__ import annotations

import numpy as np

from foucault.kernels import ins_filter as kernel
from foucault.models.ins_errors import Sensors
from foucault.models.size_effect import with_size_effect


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
        kernel.changes.py_func(dtheta, dvel, dt, left, right, i, s)
        np.testing.assert_allclose(s[37:43], np.concatenate([slope, push]), rtol=1e-9)
    kernel.changes.py_func(dtheta, dvel, dt, 0 * left, 0 * right, 2, s)
    np.testing.assert_array_equal(s[37:43], 0.0)
