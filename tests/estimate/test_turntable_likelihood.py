"""The likelihood of a session on a table: exact without noise, honest with it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.diagnose.study import nees
from foucault.errors import Status
from foucault.estimate.table import angle_start, free_start
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.rotation import log as rotation_vector
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import Rig
from make_table import ARCSEC, SITE, model_of, plan_of, silent, simulated, solved, trusting

DEG = np.pi / 180
ARM = np.array([0.2, -0.1, 0.15])
# Errors of a degree in everything of the table, and a mounting of several.
BAD = Rig(
    common=np.array([0.8, -0.5, 0.7, -1.1, 0.9, -0.6]) * DEG, position_sd=1.0 * DEG,
    mounting=np.array([3.0, -2.0, 4.0]) * DEG, lever_arm=ARM, heading=0.3,
)  # fmt: skip
# The norm of a tilted axis sees another share of the Earth's rate: no plumb error for `Free`.
LEVEL = replace(BAD, common=BAD.common * [0, 0, 1, 1, 1, 1])


def big_model(seed=3):
    """30 mg, 1 %, half a degree, 1500 deg/h."""
    return draw_errors("mems", seed)


def errors_of(estimate, model, names=LINEAR_LOWER):
    """Estimate minus truth, in relative units."""
    unit = np.where([n.startswith("accel.bias") for n in names], 9.81, 1.0)
    unit[[n.startswith("gyro.bias") for n in names]] = 0.17
    return (estimate.coefficients.values - model.coefficients(names).values) / unit


# -- without noise -----------------------------------------------------------------------------


@pytest.mark.parametrize("plan", ["icosahedron 12", "dodecahedron 20"])
@pytest.mark.parametrize("senses", [False, True])
def test_nothing_believed_recovers_the_truth_exactly(plan, senses):
    r, s = silent(plan_of(plan, both_senses=senses), big_model(), rig=LEVEL)
    got = solved(r)
    assert got.status is Status.CONVERGED
    assert np.abs(errors_of(got, big_model())).max() < 1e-12
    np.testing.assert_allclose(got.state.lever_arm, ARM, atol=1e-10)
    np.testing.assert_allclose(got.state.geometry.o, s.direction[0], atol=1e-12)
    assert abs(got.state.level) < 1e-12


def test_a_tilted_outer_axis_is_seen_as_less_gravity_in_spins():
    tilted = replace(BAD, common=BAD.common * [1, 1, 0, 0, 0, 0])
    r, _ = silent(plan_of(), big_model(), rig=tilted)
    got = solved(r)
    # cos of the tilt; and the accelerometers keep their truth.
    cos = np.cos(BAD.common[0]) * np.cos(BAD.common[1])
    assert got.state.level == pytest.approx(np.log(cos), abs=1e-10)
    accel = [n.startswith("accel.") for n in LINEAR_LOWER]
    assert np.abs(errors_of(got, big_model())[accel]).max() < 1e-11


@pytest.mark.parametrize("plan", ["icosahedron 12", "dodecahedron 20"])
def test_angles_off_by_a_degree_inside_their_prior_do_not_matter(plan):
    # Readings good to 1e-9 against a prior of a degree: what is left of it is 1e-16.
    r, s = silent(plan_of(plan), big_model(), rig=BAD)
    got = solved(r, trusting(1.0 * DEG, 1.0 * DEG))
    assert got.status is Status.CONVERGED
    assert np.abs(errors_of(got, big_model())).max() < 1e-11
    np.testing.assert_allclose(got.state.lever_arm, ARM, atol=1e-9)
    np.testing.assert_allclose(got.state.geometry.directions(), s.direction[0], atol=1e-11)


def test_a_table_that_is_right_gives_mounting_heading_and_instrument():
    perfect = replace(BAD, common=np.zeros(6), position_sd=0.0)
    r, _ = silent(plan_of(), big_model(), rig=perfect)
    for trust in (trusting(0.0, 0.0), trusting(ARCSEC, 0.0), trusting(ARCSEC, ARCSEC)):
        got = solved(r, trust)
        assert np.abs(errors_of(got, big_model())).max() < 1e-12
        np.testing.assert_allclose(
            -rotation_vector(got.state.geometry.C_bk), BAD.mounting, atol=1e-11
        )
        assert got.state.geometry.heading == pytest.approx(0.3, abs=1e-7)
        # Rounding alone: 6e-15 to 1.2e-14 by the arithmetic of OpenBLAS's processors.
        np.testing.assert_allclose(got.state.geometry.common, 0.0, atol=1e-13)


def test_accelerometers_alone():
    r, _ = silent(plan_of(spins=False), big_model(), rig=LEVEL)
    r = replace(r, gyro=None)
    names = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))
    got = solved(r, names=names)
    assert np.abs(errors_of(got, big_model(), names)).max() < 1e-12


# -- one error at a time ----------------------------------------------------------------------


@pytest.mark.parametrize("which", range(6))
def test_one_error_of_the_table_comes_back_alone(which):
    common = np.zeros(6)
    common[which] = 20 * ARCSEC
    r, _ = silent(plan_of("dodecahedron 20"), ImuModel(), rig=Rig(common=common, heading=0.3))
    # A table without position errors, whose common ones are hardly known.
    got = solved(r, trusting(1 * DEG, 0.0))
    mounting = -rotation_vector(got.state.geometry.C_bk)
    np.testing.assert_allclose(got.coefficients.values, 0.0, atol=1e-11)
    if which == 5:  # a zero error of the inner angle is a rotation of what is mounted there
        mounting[1], common[which] = mounting[1] - common[which], 0.0
    np.testing.assert_allclose(got.state.geometry.common, common, atol=1e-11)
    np.testing.assert_allclose(mounting, 0.0, atol=1e-11)


@pytest.mark.parametrize("axis", range(3))
def test_one_component_of_lever_arm_or_mounting_comes_back_alone(axis):
    one = np.eye(3)[axis]
    for trust in (None, trusting(ARCSEC, ARCSEC)):
        r, _ = silent(plan_of(), ImuModel(), rig=Rig(lever_arm=0.1 * one, heading=0.3))
        got = solved(r, trust)
        np.testing.assert_allclose(got.state.lever_arm, 0.1 * one, atol=1e-11)
        np.testing.assert_allclose(got.coefficients.values, 0.0, atol=1e-12)
    r, _ = silent(plan_of(), ImuModel(), rig=Rig(mounting=0.1 * one, heading=0.3))
    got = solved(r, trusting(ARCSEC, ARCSEC))
    np.testing.assert_allclose(-rotation_vector(got.state.geometry.C_bk), 0.1 * one, atol=1e-12)
    np.testing.assert_allclose(got.coefficients.values, 0.0, atol=1e-12)


# -- with noise ---------------------------------------------------------------------------------

DRAWS = 70


@cache
def drawn(kind, sigma, draws):
    """Errors and covariances of many sessions, as `Free` or as `Angles` sees them."""
    models = [draw_errors("tactical", k) for k in range(draws)]
    s = simulated(plan_of(), models, common=sigma, position=sigma, seed=4)
    errors, covs = [], []
    for k, model in enumerate(models):
        got = solved(s.readings(k), None if kind == "free" else trusting(sigma, sigma))
        errors.append(got.coefficients.values - model.coefficients(LINEAR_LOWER).values)
        covs.append(got.coefficients.cov)
    return np.array(errors), np.array(covs)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["free", "angles"])
def test_errors_have_the_size_that_was_promised(kind):
    """NEES of 21 over sessions that the next test has too: 20 % in variance shows in 98 %."""
    errors, covs = drawn(kind, 5 * ARCSEC, DRAWS)
    low, high = chi_square_limits(errors.size, tests=2)
    assert low < nees(errors, covs).sum() < high


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [5 * ARCSEC, 600 * ARCSEC])
def test_joint_estimate_is_never_worse_than_the_norms_on_the_same_readings(sigma):
    n = DRAWS if sigma < 10 * ARCSEC else 30
    (norm, covs), (joint, _) = (drawn(kind, sigma, n) for kind in ("free", "angles"))
    sd = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    ratio = np.mean((joint / sd) ** 2, axis=0) / np.mean((norm / sd) ** 2, axis=0)
    # Paired variances of correlation rho: ln(ratio) has the variance 4 (1 - rho^2) / n.
    rho = np.array([np.corrcoef(a, b)[0, 1] for a, b in zip(norm.T, joint.T, strict=True)])
    limit = np.exp(3.6 * np.sqrt(4 * (1 - rho**2) / n))  # 3.6: 1 % over 21 coefficients, two runs
    assert (ratio < limit).all()
    if sigma < 10 * ARCSEC:
        assert ratio.mean() < 0.95  # and better where the table is good


@pytest.mark.thorough
def test_joint_estimate_finds_the_errors_of_the_table_within_their_sd():
    n, sigma = 40, 20 * ARCSEC
    s = simulated(
        plan_of(), [draw_errors("tactical", k) for k in range(n)], noise="navigation",
        common=sigma, position=2 * ARCSEC, seed=6,
    )  # fmt: skip
    truth = np.random.default_rng(6).normal(size=(n, 6)) * sigma
    errors, covs = [], []
    for k in range(n):
        got = solved(s.readings(k), trusting(sigma, 2 * ARCSEC))
        at = len(LINEAR_LOWER) + 3 + 3
        errors.append(got.state.geometry.common - truth[k])
        covs.append(got.state_cov[at : at + 6, at : at + 6])
    low, high = chi_square_limits(6 * n)
    assert low < nees(np.array(errors), np.array(covs)).sum() < high
    sd = np.sqrt(np.mean(np.diagonal(np.array(covs), axis1=1, axis2=2), axis=0))
    assert (sd < 0.5 * sigma).sum() >= 4  # it learned something of most of them


# -- starts and covariances ---------------------------------------------------------------------


def test_jitter_acts_along_the_axis_of_spins():
    r, _ = silent(plan_of(), ImuModel(), rig=Rig(heading=0.3))
    model = model_of(r, rate_sd=1e-5)
    (jitter,) = [s for s in model.sources if s.name == "jitter of the spin rate"]
    h = np.radians(10) + EARTH_RATE * np.sin(SITE.latitude)
    along = jitter.sd * jitter.each[model.kind == 3][:, :, 0]
    np.testing.assert_allclose(along, np.outer(np.full(12, 1e-5 * h), [1, 0, 0]), atol=1e-12)
    assert not jitter.each[model.kind < 3].any()


def test_an_unknown_heading_has_the_size_of_the_horizontal_earth_rate():
    r, made = silent(plan_of("dodecahedron 20"), ImuModel(), rig=Rig(heading=0.3))
    assert "unknown heading" not in [s.name for s in model_of(r).sources]  # no rate at rest
    assert model_of(r).rows.tolist() == [*range(40), *range(60, 80)]
    model = model_of(r, gyro_at_rest=True)
    (earth,) = [s for s in model.sources if s.name == "unknown heading"]
    rests = model.kind == 2
    cov = earth.sd**2 * earth.each @ np.swapaxes(earth.each, 1, 2)
    size = (EARTH_RATE * np.cos(SITE.latitude)) ** 2
    up = made.direction[0][~r.spin]
    across = np.eye(3) - up[:, :, None] * up[:, None, :]
    np.testing.assert_allclose(cov[rests], size * across, atol=1e-4 * size)
    assert not cov[~rests].any()


@pytest.mark.parametrize("plan", ["6 faces", "8 corners"])
def test_positions_that_determine_nothing_have_no_start(plan):
    r, _ = silent(plan_of(plan), ImuModel())
    assert free_start(r, SITE, True) is None


def test_angles_of_one_axis_only_have_no_start():
    angles = np.zeros((12, 3))
    angles[:, 1] = np.linspace(0, 5, 12)
    r, _ = silent(plan_of(angles), ImuModel())
    assert angle_start(r, SITE, trusting(0, 0)) is None


def test_six_faces_are_enough_where_the_angles_are_believed():
    r, _ = silent(plan_of("6 faces"), big_model(), rig=Rig(mounting=BAD.mounting, heading=0.3))
    got = solved(r, trusting(0, 0))
    assert np.abs(errors_of(got, big_model())).max() < 1e-12


@pytest.mark.parametrize("heading", [-3.0, -1.0, 0.5, 2.5])
def test_heading_is_found_from_the_rests(heading):
    r, _ = silent(plan_of(), big_model(), rig=Rig(heading=heading))
    start = angle_start(r, SITE, trusting(0, 0))
    assert start.geometry.heading == pytest.approx(heading, abs=0.2)
    got = solved(r, trusting(0, 0))
    assert np.sin(got.state.geometry.heading - heading) == pytest.approx(0, abs=1e-7)
