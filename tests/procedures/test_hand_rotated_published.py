"""The published recipe as a procedure: what it finds, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import ImuNoise, grade
from foucault.plans.directions import hand_plan
from foucault.procedures import hand_rotated_published as published
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_session import BLIND
from refusals import refuses

SETTINGS = published.Settings(initial_rest="8 s")


@cache
def made():
    model = draw_errors("tactical", 2)
    noise = grade("tactical").noise
    return simulate(hand_plan(16, 3.0, 2.0, 10.0, 4), model=model, noise=noise, site=BLIND, seed=5)


def test_it_finds_the_errors_to_its_own_uncertainty():
    result = published.calibrate(made().log, site=BLIND, settings=SETTINGS)
    assert result.verdict.level is Level.PASS
    assert result.procedure == "hand_rotated_published"
    assert len(result.tables["rests"]["start"]) == 16
    assert set(result.coefficients.names) == set(LINEAR_LOWER)
    truth = made().model.coefficients(result.coefficients.names).values
    # Single samples at rest share nothing but white noise, so the accelerometers' covariance
    # is right; that of the gyros is what 45 residuals suggest. 4.5 sd: 1 % over 21 with those
    # 30 degrees of freedom.
    z = (result.coefficients.values - truth) / result.coefficients.sd
    assert np.abs(z).max() < 4.5
    assert not result.coefficients.free[list(result.coefficients.names).index("gyro.bias.x")]
    assert len(result.diagnostics["costs"]) == 2


def test_what_the_earth_does_to_biases_is_in_their_uncertainty():
    misses = []
    for seed in range(12):
        at = Site.at(np.radians(-60.0 + 10 * seed))
        plan, model = hand_plan(16, 3.0, 2.0, 10.0, seed), draw_errors("tactical", seed)
        sim = simulate(plan, model=model, noise=grade("tactical").noise, site=at, seed=seed)
        c = published.calibrate(sim.log, site=at, settings=SETTINGS).coefficients
        z = (c.values - sim.model.coefficients(c.names).values) / c.sd
        misses += [z[c.names.index(f"gyro.bias.{axis}")] for axis in "xyz"]
    # Its size is that of a sphere of directions: mostly one sd in all, never more than sqrt(3).
    assert 0.9 < np.sum(np.square(misses)) / 36 < 1.1
    assert np.abs(misses).max() < np.sqrt(3.0) * 1.1


def test_a_first_rest_that_is_too_short_is_told():
    with refuses("published.first_rest") as caught:
        published.calibrate(made().log, site=BLIND, settings=published.Settings(initial_rest=14))
    assert "it moves after 9." in caught.value.message  # by half a window before the first turn


@pytest.mark.parametrize(
    ("words", "what"),
    [({"noise": ImuNoise()}, "[noise]"), ({"prior": {"gyro.bias": (0.0, 1.0)}}, "[prior]")],
)
def test_it_has_no_place_for_noise_and_prior(words, what):
    with refuses("published.unweighted") as caught:
        published.calibrate(made().log, site=BLIND, settings=SETTINGS, **words)
    assert what in caught.value.message


def test_it_refuses_what_the_better_procedure_refuses():
    log = made().log
    for wrong, code in (
        (replace(log, gyro=log.gyro[:, [1, 0, 2]]), "gyro.left_handed"),
        (replace(log, accel=log.accel / 9.80665), "accel.scale_impossible"),
        (log[:1500], "rests.too_few"),
        (replace(log, accel=None), "session.no_accel"),
    ):
        with refuses(code):
            published.calibrate(wrong, site=BLIND, settings=SETTINGS)


def test_accelerometers_alone():
    result = published.calibrate(replace(made().log, gyro=None), site=BLIND, settings=SETTINGS)
    assert all(n.startswith("accel.") for n in result.coefficients.names)
    assert len(result.diagnostics["costs"]) == 1
