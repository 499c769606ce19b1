"""The likelihood on faces: exact for large errors, derivatives right, covariance as derived."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.faces.covariance import (
    Belief,
    FaceNoise,
    covariance_parts,
    noise_parts,
    placement_parts,
)
from foucault.estimate.faces.ferraris import published, scale_and_rotation, turn_spread
from foucault.estimate.faces.likelihood import State, build, closed_form, predict, unbiased
from foucault.estimate.faces.scatter import believe, scatter
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, Gauge, ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.session_noise import SessionNoise
from make_faces import POLE, SITE, TURN, perfect, rough_model

GRAVITY = Site(9.81)
SENSITIVE = tuple(
    n for n in LAYOUT.names if n in LINEAR_LOWER or n.startswith("gyro.g_sensitivity.")
)
QUADRATIC = tuple(n for n in LAYOUT.names if n in SENSITIVE or n.startswith("accel.quadratic."))


def whole(body, C_bk, site, names, turns=True, **words):
    rests, t, log = perfect(body, C_bk, site, **words)
    return closed_form(rests, t if turns else None, site, names, log)


def quiet(scene, sd=1e-4):
    n, _, m = scene.sizes
    one = SessionNoise(*np.full((3, 3), 1e-20), ImuNoise())
    return FaceNoise(
        np.full((n, 3), sd**2), np.full((n, 3), (sd / 10) ** 2), np.full((m, 3), sd**2), one
    )


@pytest.mark.parametrize("site", [GRAVITY, POLE], ids=["no Earth", "pole"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_exact_for_errors_of_ten_percent_and_five_degrees(site, seed):
    body, C_bk = rough_model(seed)
    scene, state = whole(body, C_bk, site, SENSITIVE, down=(1,))
    truth = body.coefficients(SENSITIVE).values
    assert np.abs(truth).max() > 0.08
    np.testing.assert_allclose(state.model.coefficients(SENSITIVE).values, truth, atol=1e-12)
    np.testing.assert_allclose(state.C_bk, C_bk, atol=1e-12)
    cov = sum(noise_parts(scene, state, quiet(scene)).values())
    estimate = gauss_newton.solve(build(scene, SENSITIVE, state, cov))
    np.testing.assert_allclose(estimate.coefficients.values, truth, atol=1e-12)
    assert str(estimate.status) == "converged"


def test_exact_with_quadratic_terms_too():
    # The case axes are the body axes: a turned square is not a square of one axis.
    body, _ = rough_model(4, quadratic=True)
    _, state = whole(body, np.eye(3), GRAVITY, QUADRATIC)
    truth = body.coefficients(QUADRATIC).values
    np.testing.assert_allclose(state.model.coefficients(QUADRATIC).values, truth, atol=1e-12)


def test_quadratic_terms_of_a_turned_instrument_come_out_of_the_iteration():
    body, C_bk = rough_model(4, quadratic=True)
    scene, state = whole(body, C_bk, GRAVITY, QUADRATIC)
    cov = sum(noise_parts(scene, state, quiet(scene)).values())
    estimate = gauss_newton.solve(build(scene, QUADRATIC, state, cov), tolerance=1e-9)
    truth = body.coefficients(QUADRATIC).values
    start = state.model.coefficients(QUADRATIC).values
    assert np.abs(start - truth).max() > 1e-6
    miss = np.abs(estimate.coefficients.values - truth)
    accel = np.array([n.startswith("accel.") for n in QUADRATIC])
    assert miss[accel].max() < 1e-11
    assert miss[~accel].max() < 1e-8  # specific force in the turns is taken from the start


def test_without_turns_the_accelerometers_and_the_bias_are_exact():
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    body, C_bk = rough_model(5)
    body = replace(body, g_sensitivity=np.zeros((3, 3)))
    scene, state = whole(body, C_bk, GRAVITY, names, turns=False)
    truth = body.coefficients(names).values
    np.testing.assert_allclose(state.model.coefficients(names).values, truth, atol=1e-12)
    r, _ = predict(scene, names, state)
    assert np.abs(r).max() < 1e-12


def test_jacobian_is_the_derivative():
    body, C_bk = rough_model(6, quadratic=True)
    rests, turns, log = perfect(body, C_bk, SITE)
    scene, state = closed_form(rests, turns, SITE, QUADRATIC, log)
    state = State(state.model, exp(np.array([0.02, -0.01, 0.03])) @ state.C_bk)
    _, J = predict(scene, QUADRATIC, state)
    p, at = len(QUADRATIC), state.model.coefficients(QUADRATIC)

    def value(step):
        vector = CoefficientVector(at.layout, at.values + step[:p])
        moved = State(ImuModel.from_coefficients(vector), exp(step[p:]) @ state.C_bk)
        return -predict(scene, QUADRATIC, moved)[0]

    for k in range(p + 3):
        step = np.zeros(p + 3)
        step[k] = 1e-6
        slope = (value(step) - value(-step)) / 2e-6
        np.testing.assert_allclose(J[:, :, k], slope, atol=2e-7 * max(1, np.abs(slope).max()))


def test_published_solution_is_exact_without_the_earth():
    body, C_bk = rough_model(7)
    rests, turns, _ = perfect(body, C_bk, GRAVITY)
    model, _ = published(rests, turns, GRAVITY).in_gauge(Gauge.LOWER)
    np.testing.assert_allclose(
        model.coefficients(SENSITIVE).values, body.coefficients(SENSITIVE).values, atol=1e-12
    )


def test_published_solution_takes_the_earth_for_g_sensitivity():
    """Both follow up, so that the turns are right all the same; told of the Earth it is not."""
    body, C_bk = rough_model(7)
    rests, turns, log = perfect(body, C_bk, POLE)
    case = body.rotated(C_bk.T)
    blind = published(rests, turns, replace(POLE, latitude=None))
    np.testing.assert_allclose(blind.gyro_matrix, case.gyro_matrix, atol=1e-12)
    taken = EARTH_RATE / POLE.gravity * case.gyro_matrix
    np.testing.assert_allclose(blind.g_sensitivity - case.g_sensitivity, taken, atol=1e-15)
    told = published(rests, turns, POLE, turn_spread(log, turns, case))
    # It takes off what the Earth is, not what a gyro that is 10 % off makes of it.
    left = EARTH_RATE / POLE.gravity * (case.gyro_matrix - np.eye(3))
    np.testing.assert_allclose(told.g_sensitivity - case.g_sensitivity, left, atol=1e-15)


def test_scale_and_rotation_multiply_to_the_matrix():
    matrix = np.eye(3) + 0.1 * np.random.default_rng(0).normal(size=(3, 3))
    K, R = scale_and_rotation(matrix)
    np.testing.assert_allclose(np.diag(K) @ R, matrix, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(R, axis=1), 1.0, atol=1e-15)


def test_attitude_in_a_turn_adds_a_vector_up():
    """About up a vertical vector adds up to itself times T, one across it to nothing."""
    body, C_bk = rough_model(8)
    rests, turns, log = perfect(body, C_bk, GRAVITY)
    spread = turn_spread(log, turns, body.rotated(C_bk.T))
    for j in range(3):
        axis = np.eye(3)[j]
        np.testing.assert_allclose(spread[j] @ axis, axis * 4.0, atol=1e-9)
        across = np.delete(np.eye(3), j, axis=0)
        # The last of 400 intervals is not integrated over: 1 % of the turn stays open.
        assert np.abs(across @ spread[j] @ across.T).max() < 0.011 * 4.0
    assert len(rests) == 6
    np.testing.assert_allclose(turns.angle, TURN)


# -- covariance ----------------------------------------------------------------------------


def test_unknown_earth_rate_of_a_rest():
    """Half of the squared horizontal rate across the vertical, a third of all without latitude."""
    for site in (SITE, Site(9.81)):
        scene, state = whole(ImuModel(), np.eye(3), site, LINEAR_LOWER)
        parts = noise_parts(scene, state, quiet(scene))
        name = "unknown heading" if site.latitude is not None else "unknown Earth rate"
        own = parts[name][18:21, 18:21]  # x up
        if site.latitude is None:
            want = EARTH_RATE**2 / 3 * np.eye(3)
        else:
            want = (EARTH_RATE * np.cos(site.latitude)) ** 2 / 2 * np.diag([0.0, 1.0, 1.0])
        np.testing.assert_allclose(own, want, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(parts[name][:18], 0.0)


def test_a_tilt_shows_in_rest_and_turn_of_one_placement_alike():
    """Moving up by d moves specific force by g d and the axis of the turn by d."""
    rests, turns, log = perfect(ImuModel(), np.eye(3), GRAVITY, down=(1,))
    turns = replace(turns, group=np.array([0, 3, 4]))  # x up, y down, z up
    scene, state = closed_form(rests, turns, GRAVITY, LINEAR_LOWER, log)
    placed, level, angle = placement_parts(scene, state)
    g = GRAVITY.gravity
    own = placed[:3, :3]
    np.testing.assert_allclose(own, g**2 * np.diag([0, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(placed[36:39, :3], g * TURN * np.diag([0, 1, 1]), atol=1e-9)
    # y is down: its positive axis moves against up.
    np.testing.assert_allclose(placed[39:42, 9:12], -g * TURN * np.diag([1, 0, 1]), atol=1e-9)
    np.testing.assert_allclose(level[36:39, 36:39], TURN**2 * np.diag([0, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(angle[36:39, 36:39], np.diag([1, 0, 0]), atol=1e-9)
    assert not placed[:3, 3:18].any()


def test_declared_errors_are_taken_and_the_rest_follows_the_placement():
    scene, state = whole(ImuModel(), np.eye(3), GRAVITY, LINEAR_LOWER)
    belief, found = believe(scene, LINEAR_LOWER, state, quiet(scene), (1e-3, None, 2e-3))
    assert (belief.placement, belief.level, belief.angle) == (1e-3, 1e-3, 2e-3)
    assert "placement" not in found
    parts = covariance_parts(scene, state, quiet(scene), belief, False)
    assert "placement" in parts
    parts = covariance_parts(scene, state, quiet(scene), replace(belief, placement=0.0), True)
    assert "placement, estimated" in parts
    assert Belief().accel == 0.0


def test_placement_is_found_from_opposite_faces():
    """Every even error of a pair of faces is a residual; its mean size is the placement's."""
    rng, sd, found = np.random.default_rng(2), 2e-3, []
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    for _ in range(100):
        d = rng.normal(0, sd, (6, 3)) * (rests.up_k == 0)
        accel = GRAVITY.gravity * (rests.up_k + d)
        scene, state = closed_form(replace(rests, accel=accel), None, GRAVITY, names)
        belief, _ = believe(scene, names, state, quiet(scene), (None, 0.0, 0.0))
        found.append(belief.placement)
    # 6 degrees of freedom, and the sum of squares made 4: 1 / sd^2 is right on the average.
    assert np.mean(1 / np.square(found)) == pytest.approx(1 / sd**2, rel=0.2)


def test_scatter_of_plain_readings_is_their_spread():
    rng = np.random.default_rng(4)
    x = rng.normal(0, 3.0, 50)
    one = np.ones((50, 1))
    got = scatter(x - x.mean(), one, np.eye(50) * 1e-12, np.eye(50))
    assert got.dof == 49
    assert got.sd == pytest.approx(np.sqrt(np.sum((x - x.mean()) ** 2) / 47), rel=1e-6)
    assert got.significant
    calm = scatter(x - x.mean(), one, np.eye(50) * 100.0, np.eye(50))
    assert calm.sd == 0.0 and not calm.significant


def test_the_change_of_axes_is_unbiased():
    """Two errors of x across, of variance sd^2 / 2 each, make it longer by half their sum.

    What y gets from x it gives to the rotation of the axes; z has it taken off twice.
    """
    sd = 0.01
    names = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    scene, state = closed_form(replace(rests, gyro=None), None, GRAVITY, names)
    placed = placement_parts(scene, state)[0]
    cov = sd**2 * placed + 1e-14 * np.eye(len(placed))
    solved = gauss_newton.solve(build(scene, names, state, cov))
    np.testing.assert_allclose(solved.coefficients["accel.scale"].values, 0.0, atol=1e-14)
    got = unbiased(solved).coefficients["accel.scale"].values
    np.testing.assert_allclose(got, np.array([-1, 0, 1]) * sd**2 / 2, atol=0.01 * sd**2)
