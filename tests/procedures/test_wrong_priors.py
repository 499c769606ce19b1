"""A prior that the log contradicts is told, however narrow it is; one that is right never is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import binom

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import prior_check
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, rate_table, six_position
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_faces import short_log
from make_rates import make_readings, make_steps
from make_session import SITE, short_plan

OFF = -7364e-6
MODEL = draw_errors("tactical", 1)


@cache
def by_hand(noise):
    plan = short_plan(14)
    return simulate(plan, model=MODEL, noise=grade(noise).noise, site=SITE, seed=2).log


def prior_of(result):
    (check,) = [c for c in result.checks if c.name == "prior"]
    return check


def told(result, name):
    """The prior that is wrong is a reason, and the first of its kind."""
    check = prior_of(result)
    assert result.verdict.level is not Level.PASS and not check.passed
    assert check.value > check.high and name in check.sentence
    assert "the prior is wrong or too narrow" in check.sentence
    assert "Leave [prior] out" in check.sentence


@pytest.mark.parametrize("sd", [1e-9, 1e-4, 1e-3])
@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("noise", ["tactical", "mems"])
def test_a_narrow_prior_that_a_session_by_hand_contradicts(noise, declared, sd):
    prior = {"gyro.scale": (OFF, sd)}
    known = grade(noise).noise if declared else None
    result = hand_rotated.calibrate(by_hand(noise), site=SITE, noise=known, prior=prior)
    told(result, "gyro.scale")
    # Its scatter is that of the log alone.
    alone = hand_rotated.calibrate(by_hand(noise), site=SITE, noise=known)
    for key in ("accel_repeatability", "gyro_repeatability", "turn_repeatability"):
        assert result.diagnostics["noise"][key] == alone.diagnostics["noise"][key]


def test_a_prior_that_is_right_is_believed():
    true = MODEL.coefficients().value("gyro.scale.x")
    prior = {"gyro.scale.x": (true + 5e-6, 1e-5)}
    noise = grade("tactical").noise
    result = hand_rotated.calibrate(by_hand("tactical"), site=SITE, noise=noise, prior=prior)
    assert result.verdict.level is Level.PASS and prior_of(result).passed
    k = result.coefficients.names.index("gyro.scale.x")
    assert result.coefficients.sd[k] < 1.01e-5


@pytest.mark.parametrize("method", [ferraris, six_position])
def test_a_narrow_prior_that_a_session_on_faces_contradicts(method):
    log, model = short_log()
    scale = model.coefficients().value("accel.scale.x")
    right, wrong = (
        method.calibrate(log, site=SITE, noise=grade("mems").noise,
                         prior={"accel.scale.x": (scale + off, 1e-4)})
        for off in (0.0, 0.02)
    )  # fmt: skip
    assert prior_of(right).passed
    told(wrong, "accel.scale.x")


@pytest.mark.parametrize("sd", [1e-9, 1e-4])
def test_a_narrow_prior_that_a_rate_table_contradicts(sd):
    model = ImuModel(gyro_matrix=np.eye(3) * (1 - OFF))
    steps = make_steps(model, sd=1e-5)
    steps.gyro[:] += np.random.default_rng(1).normal(0, 1e-5, steps.gyro.shape)
    settings = rate_table.Settings(cubic=False, asymmetry=False)
    kwargs = {"told": True, "site": SITE}
    result = rate_table.from_readings(
        make_readings(steps), settings, prior={"gyro.scale": (0.0, sd)}, **kwargs
    )
    told(result, "gyro.scale")
    assert result.diagnostics["rate_scatter"] == 0.0
    right = rate_table.from_readings(
        make_readings(steps), settings, prior={"gyro.scale": (-OFF, 1e-4)}, **kwargs
    )
    assert right.verdict.level is Level.PASS


def linear(rng, mean, sd, n=2000):
    """Estimates of two coefficients from data and priors, both as they say."""
    A = np.array([[1.0, 0.5], [0.0, 2.0], [1.0, 1.0]])
    names = ("gyro.scale.x", "gyro.scale.y")
    info = A.T @ A + np.diag(sd**-2.0)
    cov = np.linalg.inv(info)
    for _ in range(n):
        x = mean + rng.normal(0, sd)
        y = A @ x + rng.normal(0, 1, 3)
        values = cov @ (A.T @ y + mean / sd**2)
        yield (
            CoefficientVector(LAYOUT.subset(names), values, cov, prior_sd=sd),
            (mean - values) / sd,
        )


@pytest.mark.parametrize("sd", [np.array([1e-3, 10.0]), np.array([1.0, 1.0]), np.array([50.0, 20])])
def test_priors_that_are_right_fail_as_often_as_is_stated(sd):
    made = linear(np.random.default_rng(3), np.array([2.0, -1.0]), sd)
    wrong = sum(not prior_check(*one).passed for one in made)
    # One test of each and one of both: as often as stated where they are independent, and a
    # third as often where they are one and the same.
    low, high = binom.ppf([0.005, 0.995], 2000, [FALSE_ALARM / 3, FALSE_ALARM])
    assert low <= wrong <= high


def test_priors_that_are_wrong_together_are_told_together():
    sd, cov = np.full(3, 1.0), 0.5 * np.eye(3)
    names = tuple(f"gyro.scale.{a}" for a in "xyz")
    vector = CoefficientVector(LAYOUT.subset(names), np.zeros(3), cov, prior_sd=sd)
    check = prior_check(vector, np.full(3, 2.9 * np.sqrt(0.5)))
    assert not check.passed and check.value > check.high
    assert "The 3 coefficients that were known before, taken together, are 5.0" in check.sentence


def test_a_prior_that_nothing_else_sees_is_not_tested():
    sd = np.array([1e-3])
    vector = CoefficientVector(
        LAYOUT.subset(("gyro.scale.x",)), np.zeros(1), np.diag(sd**2), prior_sd=sd
    )
    assert prior_check(vector, np.zeros(1)).passed
