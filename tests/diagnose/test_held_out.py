"""Held-out readings: predicted as well as promised, and one that is wrong is named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.diagnose.references import norm_with_cov
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import grade
from foucault.procedures.hand_rotated import calibrate
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_session import SITE, short_plan


@cache
def results():
    noise = grade("tactical").noise
    out = []
    for seed in range(12):
        simulation = simulate(short_plan(18, seed), model=draw_errors("tactical", seed),
                              noise=noise, site=SITE, seed=seed)  # fmt: skip
        out.append(calibrate(simulation.log, site=SITE, noise=noise))
    return out


def test_sd_of_a_norm_is_that_of_drawn_coefficients_and_readings():
    model = draw_errors("tactical", 3)
    names = [n for n in LINEAR_LOWER if n.startswith("accel.")]
    truth = model.coefficients(names)
    rng = np.random.default_rng(4)
    root = rng.normal(0, 1e-4, (9, 9))
    f_b = np.array([[0.0, 0.0, 9.8], [6.0, -6.0, 5.0]])
    reading, _ = model.measure(f_b, f_b)
    reading_cov = np.array([np.diag([1e-6, 2e-6, 3e-6])] * 2)
    _, joint = norm_with_cov(model, replace(truth, cov=root @ root.T), reading, reading_cov)
    n, norms = 4000, []
    for _ in range(n):
        values = truth.values + root @ rng.normal(size=9)
        drawn = ImuModel.from_coefficients(replace(truth, values=values))
        noisy = reading + rng.normal(size=(2, 3)) * np.sqrt([1e-6, 2e-6, 3e-6])
        norms.append(np.linalg.norm(drawn.compensate(noisy, None)[0], axis=1))
    square = np.sum((np.array(norms) - np.linalg.norm(f_b, axis=1)) ** 2, axis=0)
    square /= np.diag(joint)
    low, high = chi_square_limits(n, tests=2)
    assert (low < square).all() and (square < high).all()


@pytest.mark.thorough
def test_rests_left_out_are_predicted_as_well_as_promised():
    rests = [r.tables["rests"] for r in results()]
    z = np.concatenate([t["held_out"] / t["held_out_sd"] for t in rests])
    # Rests of one fold share a fit and are not quite independent: judge one rest of each fold.
    one = np.concatenate([(t["held_out"] / t["held_out_sd"])[:5] for t in rests])
    low, high = chi_square_limits(len(one))
    assert low < np.sum(one**2) < high
    assert np.isfinite(z).all()


def test_a_rest_left_out_is_predicted_worse_than_one_that_was_fitted():
    for result in results():
        rests = result.tables["rests"]
        assert (rests["held_out_sd"] > rests["norm_sd"] * (1 - 1e-6)).mean() > 0.9
