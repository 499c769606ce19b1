"""Noise as declared or measured, scatter between rests, and the same bits from the same input."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.noise import ImuNoise, grade
from foucault.procedures.hand_rotated import Settings, calibrate
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_session import SITE, short_plan

NOISE = grade("tactical").noise


@cache
def made(rests=14):
    model = draw_errors("tactical", 1)
    return simulate(short_plan(rests), model=model, noise=NOISE, site=SITE, seed=2)


@pytest.mark.parametrize("factor", [1 / 3, 3.0], ids=["too small", "too large"])
def test_declared_noise_that_the_residuals_contradict(factor):
    wrong = ImuNoise(
        replace(NOISE.accel, white=NOISE.accel.white * factor),
        replace(NOISE.gyro, white=NOISE.gyro.white * factor),
    )
    result = calibrate(made().log, site=SITE, noise=wrong)
    assert result.verdict.level is Level.DOUBTFUL
    words = "the declared noise is too small" if factor < 1 else "the noise is overstated"
    # Turns hardly have a redundancy of their own: where they are much better known than the rests,
    # the attitudes follow them. Rests tell noise that is too small, each by both triads.
    assert sum(words in reason for reason in result.verdict.reasons) >= (2 if factor < 1 else 1)
    right = calibrate(made().log, site=SITE, noise=NOISE)
    assert right.verdict.level is Level.PASS


@pytest.mark.thorough
def test_scatter_between_rests_is_estimated():
    """Offsets drawn for every rest: the estimate is a variance from its redundancy."""
    sd, ratios, dof = 0.01, [], []
    rng = np.random.default_rng(15)
    simulation = made(24)
    for _ in range(8):
        accel = simulation.log.accel.copy()
        for a, b in zip(simulation.first, simulation.last, strict=True):
            accel[a - 5 if a else 0 : b + 5] += rng.normal(0, sd, 3)
        result = calibrate(replace(simulation.log, accel=accel), site=SITE,
                           settings=Settings(held_out=0))  # fmt: skip
        found = [f.message for f in result.findings if f.code == "session.scatter"]
        assert any("specific forces at rest scatter" in words for words in found)
        ratios.append((result.diagnostics["noise"]["accel_repeatability"] / sd) ** 2)
        dof.append(result.diagnostics["chi_square_of_noise_alone"]["accel"][3])
    # Each estimate is sd^2 chi-square / redundancy, and settles to 2 %.
    total = float(np.dot(ratios, dof))
    low, high = chi_square_limits(float(np.sum(dof)))
    assert low * 0.98 < total < high * 1.02


def test_scatter_can_be_left_out():
    result = calibrate(made().log, site=SITE, settings=Settings(repeatability=False))
    assert result.diagnostics["noise"]["accel_repeatability"] == 0.0
