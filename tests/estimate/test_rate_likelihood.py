"""The likelihood of steps on a rate table: derivatives, and uncertainties by formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.coefficients import CoefficientVector
from foucault.errors import Status
from foucault.estimate import gauss_newton
from foucault.estimate.rate_table.likelihood import (
    State,
    Trust,
    build,
    covariance,
    fit,
    level_slope,
)
from foucault.estimate.rate_table.scatter import fit_scatter, scaled_noise
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.rate_steps import mean_force_of_steps
from make_rates import LATITUDE, SPEEDS, make_steps

FAMILIES = ("bias", "scale", "misalignment", "g_sensitivity", "asymmetry", "cubic")
NAMES = tuple(n for n in LAYOUT.names if n.startswith("gyro.") and n.split(".")[1] in FAMILIES)
PLAIN = tuple(n for n in NAMES if "g_sensitivity" not in n)
KNOWN = Trust(latitude=LATITUDE)
SIZE = {"bias": 0.02, "scale": 0.02, "misalignment": 0.01, "g_sensitivity": 2e-4,
        "asymmetry": 1e-3, "cubic": 1e-3}  # fmt: skip


def bent(seed=2, names=NAMES):
    rng = np.random.default_rng(seed)
    values = [SIZE[n.split(".")[1]] * rng.uniform(-1, 1) for n in names]
    return ImuModel.from_coefficients(CoefficientVector(LAYOUT.subset(names), np.array(values)))


def test_derivatives_are_those_of_the_prediction():
    trust = Trust(1e-5, 1e-6, 1e-4, None)
    steps = make_steps(bent(5), sd=1e-5)
    rng = np.random.default_rng(1)
    state = State(bent(6), 3e-6, 1e-5, 1e-4 * rng.normal(size=(6, 2)))
    problem = build(steps, NAMES, trust, start=state)
    one = np.ones(len(steps))
    at = problem.linearise(state, one)
    assert at.jacobian.shape == (3 * len(steps) + 14, len(NAMES) + 14)
    scale = np.linalg.norm(at.jacobian, axis=0)
    for k in range(at.jacobian.shape[1]):
        h = 1e-3 / scale[k] * 10
        step = np.zeros(at.jacobian.shape[1])
        step[k] = h
        ahead = problem.linearise(problem.retract(state, step), one).residuals
        behind = problem.linearise(problem.retract(state, -step), one).residuals
        numeric = -(ahead - behind) / (2 * h)
        # Second differences, and the square of a tilt of 1e-4.
        np.testing.assert_allclose(numeric / scale[k], at.jacobian[:, k] / scale[k], atol=2e-7)


def test_noise_free_steps_give_back_everything_at_once():
    truth = bent(7)
    _, found = fit(make_steps(truth, sd=1e-9), NAMES, KNOWN)
    assert found.status is Status.CONVERGED
    want = truth.coefficients(NAMES).values
    assert np.abs(found.coefficients.values - want).max() < 1e-12


def test_uncertainties_of_a_straight_line_are_those_of_the_textbook():
    names = ("gyro.bias.z", "gyro.scale.z", "gyro.asymmetry.z")
    steps = make_steps(axes=("z up",), sd=2e-6)
    x = steps.rate + EARTH_RATE * np.sin(LATITUDE)
    rows = np.column_stack([np.ones_like(x), x, np.abs(x)])
    want = 2e-6 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    _, found = fit(steps, names, KNOWN)
    np.testing.assert_allclose(found.coefficients.sd, want, rtol=1e-6)


def test_an_error_that_all_rates_share_is_an_error_of_all_scale_factors():
    _, alone = fit(make_steps(), PLAIN, KNOWN)
    _, found = fit(make_steps(), PLAIN, replace(KNOWN, rate_sd=3e-6))
    for a in "xyz":
        i = PLAIN.index(f"gyro.scale.{a}")
        want = np.hypot(alone.coefficients.sd[i], 3e-6)
        # The Earth's rate, which has no such error, tells a little of it.
        assert found.coefficients.sd[i] == pytest.approx(want, rel=2e-3)
    cov = found.coefficients["gyro.scale"].cov
    assert cov[0, 1] == pytest.approx(3e-6**2, rel=1e-2)
    same = [PLAIN.index(n) for n in PLAIN if "misalignment" in n]
    np.testing.assert_allclose(found.coefficients.sd[same], alone.coefficients.sd[same], rtol=1e-4)


@pytest.mark.parametrize(("axes", "share"), [(("x up", "y up", "z up"), 1.0), (None, 0.5**0.5)])
def test_a_fixture_out_of_square_is_a_misalignment(axes, share):
    steps = make_steps(axes=axes) if axes else make_steps()
    _, found = fit(steps, PLAIN, replace(KNOWN, fixture_sd=1e-4))
    np.testing.assert_allclose(found.coefficients["gyro.misalignment"].sd, 1e-4 * share, rtol=2e-3)


def test_an_unknown_latitude_is_a_bias_of_axes_that_only_point_up():
    names = tuple(n for n in PLAIN if n.split(".")[1] in ("bias", "scale", "misalignment"))
    _, found = fit(make_steps(axes=("x up", "x down", "y up", "z up")), names, Trust())
    sd = found.coefficients["gyro.bias"].sd
    assert sd[0] < 1e-7  # up and down: the Earth's rate changes its sign
    _, one_way = fit(make_steps(axes=("z up",)), ("gyro.bias.z", "gyro.scale.z"), Trust())
    assert one_way.coefficients.sd[0] == pytest.approx(EARTH_RATE / np.sqrt(3), rel=1e-3)


def test_parts_of_turns_leave_a_part_of_the_horizontal_earth_rate():
    steps = make_steps(axes=("z up",), turns=2.25)
    parts = covariance(steps, KNOWN)["parts of turns"]
    left = EARTH_RATE * np.cos(LATITUDE) * np.sin(np.pi * 2.25) / (np.pi * 2.25)
    np.testing.assert_allclose(parts[0], np.diag([left**2 / 2, left**2 / 2, 0.0]), rtol=1e-9)
    whole = covariance(make_steps(turns=3.0), KNOWN)["parts of turns"]
    assert np.abs(whole).max() < (1e-15 * EARTH_RATE) ** 2 * 10


def test_jitter_weighs_fast_steps_less():
    jitter = covariance(make_steps(axes=("y up",)), replace(KNOWN, rate_jitter=1e-5))["rate jitter"]
    want = (1e-5 * (SPEEDS + EARTH_RATE * np.sin(LATITUDE))) ** 2
    np.testing.assert_allclose(jitter[:, 1, 1], want, rtol=1e-12)
    assert not jitter[:, 0].any()


def test_scatter_is_found_where_there_is_some():
    steps = make_steps(sd=1e-8)
    rng = np.random.default_rng(3)
    shaken = steps.gyro * (1 + 2e-5 * rng.normal(size=(len(steps), 1)))
    shaken += 1e-8 * rng.normal(size=shaken.shape)
    wider = fit_scatter(replace(steps, gyro=shaken), PLAIN, KNOWN)
    assert 1.2e-5 < wider.rate_jitter < 3e-5
    _, found = fit(replace(steps, gyro=shaken), PLAIN, wider)
    assert found.chi_square == pytest.approx(found.dof, rel=0.1)
    assert wider.bias_sd == 0


def test_noise_that_nobody_knows_is_taken_from_the_residuals():
    steps = make_steps(sd=1e-7)
    noisy = replace(steps, gyro=steps.gyro + 5e-6 * np.random.default_rng(4).normal(size=(36, 3)))
    scaled = scaled_noise(noisy, PLAIN, KNOWN)
    sd = np.sqrt(scaled.cov[0, 0, 0])
    assert 4e-6 < sd < 6e-6
    few = make_steps(axes=("z up",), rates=SPEEDS[:1])
    assert scaled_noise(few, PLAIN, KNOWN) is few


def test_force_holds_the_centripetal_part_that_the_accelerometers_saw():
    steps = make_steps(axes=("x up", "z down"))
    arm = np.array([0.1, -0.2, 0.3])
    across = arm - (steps.up @ arm)[:, None] * steps.up
    true = 9.81 * steps.up - (steps.rate**2)[:, None] * across
    accel = true + np.array([0.5, -0.2, 0.1])  # a bias says nothing of the rate
    found = mean_force_of_steps(steps.up, steps.placement, steps.rate, accel, Site(9.81))
    np.testing.assert_allclose(found, true, atol=1e-12)
    still = mean_force_of_steps(steps.up, steps.placement, steps.rate, None, Site(9.81))
    np.testing.assert_allclose(still, 9.81 * steps.up)


def test_robust_loss_gives_less_weight_to_a_bad_step():
    steps = make_steps(sd=1e-6)
    gyro = steps.gyro.copy()
    gyro[4, 0] += 1e-3
    _, found = fit(replace(steps, gyro=gyro), PLAIN, KNOWN, loss=gauss_newton.huber)
    assert found.weights[4] < 0.1
    assert np.delete(found.weights, 4).min() > 0.99


@pytest.mark.parametrize("axis", ["x up", "y down"])
def test_rests_at_other_table_angles_see_the_same_earth_turned(axis):
    steps = make_steps(ImuModel(), axes=(axis,), rates=np.zeros(3))
    angle = np.array([0.0, 0.7, -2.0])
    steps = replace(steps, azimuth=angle)
    trust = Trust(latitude=0.8)
    slope = level_slope(steps, trust)
    at_zero = slope[0] @ [0.6, -0.8]
    for k, a in enumerate(angle):  # what stands still turns back about up, seen from the table
        back = Rotation.from_rotvec(-a * steps.up[k])
        np.testing.assert_allclose(slope[k] @ [0.6, -0.8], back.apply(at_zero), atol=1e-15)
    assert np.linalg.norm(at_zero) == pytest.approx(trust.horizontal)
    assert not covariance(steps, trust)["parts of turns"].any()
    unknown = replace(steps, azimuth=np.full(3, np.nan))
    assert covariance(unknown, trust)["parts of turns"].any()
