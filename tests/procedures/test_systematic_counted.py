"""What a systematic calibration counts with: its inputs, what is named, and its uncertainties."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.kernels import ins_transition
from foucault.models.earth import Site
from foucault.models.ins_errors import Sensors
from foucault.models.left_out import sizes_of
from foucault.procedures import systematic
from foucault.procedures.systematic.settings import Settings
from foucault.result import Level
from make_left_out import ramp
from make_sequence import NOISE

SITE = Site.at(np.radians(40.0), 100.0)
SIZES = sizes_of("navigation RLG")
SESSION = systematic.Session(rest_time=30.0, rate=25.0)


@cache
def session(seed=0):
    """Return the log of nineteen positions, and the truth."""
    model = systematic.draw_errors("navigation", seed)
    made = systematic.simulate(SESSION, settings=Settings(), model=model, noise=NOISE, site=SITE,
                               seed=seed)  # fmt: skip
    return made.log, model.coefficients()


def trial(log, sizes=SIZES, site=SITE, **more):
    return systematic.trial(log, site=site, settings=Settings(), noise=NOISE, sizes=sizes, **more)


def nees(result, truth):
    found = result.coefficients
    err = found.values - truth.chosen(found.names).values
    return float(err @ np.linalg.solve(found.cov, err))


def test_drifts_and_gravity_add_what_the_formulas_say():
    sensors = Sensors.of(("gyro.bias", "gyro.scale", "accel.bias", "accel.scale"))
    wide = sensors.with_drift(("gyro.bias", "accel.scale", "accel.bias")).with_gravity(9.8)
    assert wide.layout.names[: wide.gyros] == (
        *sensors.layout.names[:6], *(f"drift.gyro.bias.{a}" for a in "xyz"),
    )  # fmt: skip
    w, f, r = np.array([0.3, -0.2, 0.1]), np.array([1.0, -7.0, 6.0]), 0.375
    s = np.zeros(ins_transition.INPUTS)
    dt = np.full(8, 0.5)
    at = (w * dt[:, None], f * dt[:, None], dt, np.zeros(8), np.zeros(8))
    ins_transition.changes.py_func(*at, 6, 3.25, 4.0, s)  # the middle is at 3.5 of 4
    assert s[43] == pytest.approx(r)
    ins_transition.sense.py_func(np.concatenate([w, f]), s, ins_transition.INPUTS - 1)
    adds = np.zeros((6, len(wide)))
    np.add.at(adds, (wide.axis, wide.coefficient), wide.weight * s[wide.entry])
    names = wide.layout.names
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(
            adds[:3, names.index(f"drift.gyro.bias.{axis}")], r * np.eye(3)[k]
        )
        np.testing.assert_allclose(
            adds[3:, names.index(f"drift.accel.bias.{axis}")], r * np.eye(3)[k]
        )
        by = r * f[k] * np.eye(3)[k]
        np.testing.assert_allclose(adds[3:, names.index(f"drift.accel.scale.{axis}")], by)
    np.testing.assert_allclose(adds[3:, names.index("site.gravity")], f / 9.8)
    assert (np.diff((wide.axis >= 3).astype(int)) >= 0).all()  # those of the gyros come first


@pytest.mark.thorough
def test_nothing_is_named_and_the_table_says_all():
    log, truth = session()
    result = trial(log)
    assert result.verdict.level is Level.PASS
    assert result.diagnostics["named"] == []
    rows = result.diagnostics["left_out"]
    left = {"accel.quadratic", "accel.cross", "gyro.g_sensitivity", "gyro.asymmetry",
            "gyro.cubic", "gyro.deflection", "accel.bias drift", "gyro.bias drift",
            "accel.scale drift", "gyro.scale drift", "local gravity", "accel.lever",
            "accel.delay", "latitude"}  # fmt: skip
    assert {n for n, r in rows.items() if r["kind"] == "left out"} == left
    assert set(result.tables["left_out"]["group"]) == left
    assert set(result.coefficients.names) == set(trial(log, None).coefficients.names)
    assert nees(result, truth) < chi_square_limits(len(truth), 0.01)[1]


@pytest.mark.thorough
def test_drifts_of_seven_sizes_are_named_and_their_states_are_right():
    log, truth = session()
    size = 7 * SIZES["accel.bias drift"][0]
    result = trial(replace(log, accel=log.accel + size * ramp(log) * [1, -1, 1]))
    assert result.verdict.level is Level.DOUBTFUL
    (named,) = result.diagnostics["named"]
    assert named["accel.bias drift"] == pytest.approx(7.0, rel=0.1)
    assert nees(result, truth) < chi_square_limits(len(truth), 0.01)[1]


@pytest.mark.thorough
def test_a_latitude_that_is_off_is_counted_as_it_moves_the_result():
    log, _ = session()
    far = np.radians(0.05)  # farther off, drifts are enlarged for it
    there = replace(SITE, latitude=SITE.latitude + far)
    known = trial(log, dict(SIZES) | {"latitude": (far, "as given")}).coefficients
    sizes = dict(SIZES) | {"latitude": (1e-9, "as given")}
    narrow = trial(log, sizes).coefficients
    moved = (trial(log, sizes, there).coefficients.values - narrow.values) / narrow.sd
    counts = np.sqrt(np.maximum(known.sd**2 - narrow.sd**2, 0.0)) / narrow.sd
    assert np.abs(moved).max() > 0.5
    np.testing.assert_allclose(counts, np.abs(moved), atol=0.1)


@pytest.mark.thorough
def test_sizes_that_leave_the_heading_open_are_said_to_and_never_a_missing_sample():
    """10 deg/h/g along East is the Earth's rate: no filter takes that for a small error."""
    log, _ = session()
    far = "What is not estimated leaves the heading at rest uncertain by"
    assert not any(far in reason for reason in trial(log).verdict.reasons)
    wide = dict(SIZES) | {"gyro.g_sensitivity": sizes_of("tactical MEMS")["gyro.g_sensitivity"]}
    try:
        reasons = trial(log, wide).verdict.reasons
    except FoucaultError as problem:
        assert problem.code == "systematic.heading_open"
        reasons = (problem.message,)
    assert any(f"{far} 5" in reason for reason in reasons)
