"""Gyros that are stuck, or in a unit that no turn and no rest fits; priors too narrow to be."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import plausible_scales
from foucault.errors import FoucaultError
from foucault.models.imu import LAYOUT
from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, hand_rotated_published, six_position
from foucault.result import Level, Verdict
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_faces import short_log
from make_session import SITE, short_plan

MEMS = grade("mems").noise
ALL = [hand_rotated, hand_rotated_published, six_position, ferraris]


@cache
def log_for(method):
    if method in (six_position, ferraris):
        return short_log(1)[0]
    plan = short_plan(14)
    return simulate(plan, model=draw_errors("mems", 1), noise=MEMS, site=SITE, seed=1).log


def refused(method, log, **words):
    if method is hand_rotated_published:  # whose first rest is as long as that of the log
        words["settings"] = method.Settings(initial_rest=3)
    with pytest.raises(FoucaultError) as caught:
        method.calibrate(log, site=SITE, **words)
    return caught.value


@pytest.mark.parametrize("value", [0.0, np.array([0.01, 0.02, -0.03])], ids=["0", "constant"])
@pytest.mark.parametrize("method", ALL)
def test_gyros_that_are_all_stuck_are_refused_by_name(method, value):
    log = log_for(method)
    problem = refused(method, replace(log, gyro=0 * log.gyro + value))
    assert problem.code == "gyro.stuck"
    assert "All three gyros read one value throughout the log" in problem.message
    assert "Without [log.gyro] the accelerometers are calibrated alone." in problem.cure


@pytest.mark.parametrize("method", [hand_rotated, six_position])
def test_gyros_in_seconds_of_arc_that_were_declared_as_degrees(method):
    log = log_for(method)
    problem = refused(method, replace(log, gyro=log.gyro * 3600))
    assert problem.code == "gyro.unit"
    assert "unit is deg/h or arcsec/s and was declared as deg/s" in problem.message


def test_a_gyro_bias_that_no_gyro_has_is_a_wrong_unit():
    def judged(bias):
        names = tuple(f"gyro.bias.{a}" for a in "xyz")
        vector = CoefficientVector(LAYOUT.subset(names), np.radians([bias, 0.1, 0.1]))
        return plausible_scales(vector)

    assert judged(-20.0) == []
    assert Verdict.of(tuple(judged(-3600.0))).level is Level.UNUSABLE
    assert "A gyro bias of 3600 deg/s is a wrong unit" in judged(-3600.0)[0].sentence


@pytest.mark.parametrize("sd", [1e-300, 0.0, -1e-5, float("nan")])
@pytest.mark.parametrize("method", [hand_rotated, ferraris])
def test_a_prior_too_narrow_to_calculate_with_is_refused(method, sd):
    problem = refused(method, log_for(method), prior={"gyro.scale": (0.0, sd)})
    assert problem.code == "prior.sd"
    assert "is not positive, or too small to calculate with" in problem.message
