"""The likelihood on faces: exact for large errors, derivatives right, covariance as derived."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.estimate.faces import (
    SCATTER,
    FaceNoise,
    OnFaces,
    State,
    on_faces,
    published,
    scale_and_rotation,
    scene_of,
    turn_spread,
    unbiased,
)
from foucault.infer import gauss_newton, mixed
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, Gauge, ImuModel
from foucault.models.noise import ImuNoise, SessionNoise, TriadNoise, window_covariance
from make_faces import POLE, SITE, TURN, perfect, rough_model

GRAVITY = Site(9.81)
SENSITIVE = tuple(
    n for n in LAYOUT.names if n in LINEAR_LOWER or n.startswith("gyro.g_sensitivity.")
)
QUADRATIC = tuple(n for n in LAYOUT.names if n in SENSITIVE or n.startswith("accel.quadratic."))


def whole(body, C_bk, site, names, turns=True, **words):
    rests, t, log = perfect(body, C_bk, site, **words)
    return scene_of(rests, t if turns else None, site, names, log)


def quiet(scene, sd=1e-4):
    n, _, m = scene.sizes
    one = SessionNoise(*np.full((3, 3), 1e-20), ImuNoise())
    return FaceNoise(
        np.full((n, 3), sd**2), np.full((n, 3), (sd / 10) ** 2), np.full((m, 3), sd**2), one,
        "declared",
    )  # fmt: skip


def modelled(scene, state, names, given=(0.0, 0.0, 0.0), **words):
    return on_faces(scene, state, names, quiet(scene, **words), given)


def part(model, name):
    """Covariance of all readings by one source, for a size of 1, in its own order of axes."""
    at = model.linearise(model.start)
    one = [replace(s, sd=1.0) for s in at.sources if s.name == name]
    assert one
    return mixed.Covariance(one, {}, at.residuals.shape, np.ones(len(at.residuals))).whole


@pytest.mark.parametrize("site", [GRAVITY, POLE], ids=["no Earth", "pole"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_exact_for_errors_of_ten_percent_and_five_degrees(site, seed):
    body, C_bk = rough_model(seed)
    scene, state = whole(body, C_bk, site, SENSITIVE, down=(1,))
    truth = body.coefficients(SENSITIVE).values
    assert np.abs(truth).max() > 0.08
    np.testing.assert_allclose(state.model.coefficients(SENSITIVE).values, truth, atol=1e-12)
    np.testing.assert_allclose(state.C_bk, C_bk, atol=1e-12)
    estimate = mixed.fit(modelled(scene, state, SENSITIVE)).estimate
    np.testing.assert_allclose(estimate.coefficients.values, truth, atol=1e-12)
    assert str(estimate.status) == "converged"


def test_exact_with_quadratic_terms_too():
    # The case axes are the body axes: a turned square is not a square of one axis.
    body, _ = rough_model(4, quadratic=True)
    _, state = whole(body, np.eye(3), GRAVITY, QUADRATIC)
    truth = body.coefficients(QUADRATIC).values
    np.testing.assert_allclose(state.model.coefficients(QUADRATIC).values, truth, atol=1e-12)


def test_quadratic_terms_of_a_turned_instrument_are_exact():
    body, C_bk = rough_model(4, quadratic=True)
    scene, state = whole(body, C_bk, GRAVITY, QUADRATIC)
    problem = mixed.stated(modelled(scene, state, QUADRATIC))
    estimate = gauss_newton.solve(problem, tolerance=1e-9)
    truth = body.coefficients(QUADRATIC).values
    start = state.model.coefficients(QUADRATIC).values
    np.testing.assert_allclose(start, truth, atol=1e-11)
    np.testing.assert_allclose(estimate.coefficients.values, truth, atol=1e-11)


def test_without_turns_the_accelerometers_and_the_bias_are_exact():
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    body, C_bk = rough_model(5)
    body = replace(body, g_sensitivity=np.zeros((3, 3)))
    scene, state = whole(body, C_bk, GRAVITY, names, turns=False)
    truth = body.coefficients(names).values
    np.testing.assert_allclose(state.model.coefficients(names).values, truth, atol=1e-12)
    assert np.abs(modelled(scene, state, names).linearise(state).residuals).max() < 1e-12


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
    told = published(rests, turns, POLE, turn_spread(log, turns, State(case, np.eye(3))))
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
    spread = turn_spread(log, turns, State(body, C_bk))
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
        model = modelled(scene, state, LINEAR_LOWER)
        name = "unknown heading" if site.latitude is not None else "unknown Earth rate"
        (source,) = [s for s in model.linearise(state).sources if s.name == name]
        cov = source.sd**2 * part(model, name)
        own = cov[18:21, 18:21]  # x up
        if site.latitude is None:
            want = EARTH_RATE**2 / 3 * np.eye(3)
        else:
            want = (EARTH_RATE * np.cos(site.latitude)) ** 2 / 2 * np.diag([0.0, 1.0, 1.0])
        np.testing.assert_allclose(own, want, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(cov[:18], 0.0)
        # Along up it is one number: x up and x down feel opposite rates, z up the same as x up.
        along = cov[18, 18:36].reshape(6, 3) / (EARTH_RATE**2 / 3)
        ups = scene.rests.up_k if site.latitude is None else np.zeros((6, 3))
        np.testing.assert_allclose(along[1:], ups[1:], atol=1e-12)


def test_a_tilt_shows_in_rest_and_turn_of_one_placement_alike():
    """Moving up by d moves specific force by g d and the axis of the turn by d."""
    rests, turns, log = perfect(ImuModel(), np.eye(3), GRAVITY, down=(1,))
    turns = replace(turns, group=np.array([0, 3, 4]))  # x up, y down, z up
    scene, state = scene_of(rests, turns, GRAVITY, LINEAR_LOWER, log)
    model = replace(modelled(scene, state, LINEAR_LOWER), given=(1.0, 1.0, 1.0))
    placed, level, angle = (
        part(model, name) for name in ("placement", "level of the turns", "angle of the turns")
    )
    g = GRAVITY.gravity
    own = placed[:3, :3]
    np.testing.assert_allclose(own, g**2 * np.diag([0, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(placed[36:39, :3], g * TURN * np.diag([0, 1, 1]), atol=1e-9)
    # y is down: its positive axis moves against up.
    np.testing.assert_allclose(placed[39:42, 9:12], -g * TURN * np.diag([1, 0, 1]), atol=1e-9)
    np.testing.assert_allclose(level[36:39, 36:39], TURN**2 * np.diag([0, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(angle[36:39, 36:39], np.diag([1, 0, 0]), atol=1e-9)
    assert not placed[:3, 3:18].any()


def test_the_squares_of_tilts_scatter_along_the_vertical():
    """The cosine of a tilt of two angles of sd s has the mean 1 - s^2 and the sd s^2."""
    sd = 0.01
    scene, state = whole(ImuModel(), np.eye(3), GRAVITY, LINEAR_LOWER)
    model = modelled(scene, state, LINEAR_LOWER, (sd, 2 * sd, 0.0))
    drawn = 1 - np.cos(np.hypot(*np.random.default_rng(1).normal(0, sd, (2, 100_000))))
    assert drawn.mean() == pytest.approx(sd**2, rel=0.02)
    g = GRAVITY.gravity
    np.testing.assert_allclose(model.scene.force_k, scene.force_k * (1 - sd**2))
    np.testing.assert_allclose(model.scene.turn_k, scene.turn_k * (1 - 5 * sd**2))
    placed, level = (sd * k * part(model, name) * sd * k
                     for k, name in ((1, "placement"), (2, "level of the turns")))  # fmt: skip
    # As much again for the product with the misalignments, which are as uncertain.
    assert placed[0, 0] == pytest.approx(2 * (g * sd**2) ** 2, rel=1e-3)
    assert level[36, 36] == pytest.approx(2 * (TURN * 4 * sd**2) ** 2, rel=2e-3)


def test_declared_errors_are_taken_and_the_rest_follows_the_placement():
    scene, state = whole(ImuModel(), np.eye(3), GRAVITY, LINEAR_LOWER)
    model = modelled(scene, state, LINEAR_LOWER, (1e-3, None, 2e-3))
    given = [(s.name, s.sd) for s in map(model.tilt, range(3))]
    assert given == [("placement", 1e-3), ("placement", 1e-3), ("angle of the turns", 2e-3)]
    assert model.near == (1e-3, 1e-3)
    found = modelled(scene, state, LINEAR_LOWER, (None, None, 2e-3))
    assert [found.tilt(k).sd for k in range(3)] == [None, None, 2e-3]
    assert found.tilt(0).type == "A" and model.tilt(0).type == "B"


def test_what_slow_noise_does_to_rests_and_turns_is_tied_together():
    """A bias that wanders adds up over a turn as it does over the rests around it."""
    scene, state = whole(ImuModel(), np.eye(3), GRAVITY, LINEAR_LOWER)
    slow = TriadNoise(bias_instability=1e-3, correlation_time=20.0)
    noise = quiet(scene)
    noise = replace(noise, session=replace(noise.session, slow=ImuNoise(slow, slow)))
    none = replace(noise, accel_var=0 * noise.accel_var, gyro_var=0 * noise.gyro_var,
                   turn_var=0 * noise.turn_var)  # fmt: skip
    model = OnFaces(scene, LAYOUT.subset(LINEAR_LOWER), state, none, (0.0, 0.0, 0.0))
    start, time = model.windows
    want = window_covariance(start[6:], start[6:] + time[6:], slow)
    size = np.append(np.ones(6), time[12:])
    got = part(model, "gyro noise")[18:, 18:]
    np.testing.assert_allclose(got, np.kron(want * np.outer(size, size), np.eye(3)), atol=1e-15)
    assert np.allclose(
        part(model, "accelerometer noise")[:18, :18],
        np.kron(window_covariance(start[:6], start[:6] + time[:6], slow), np.eye(3)),
    )


def test_placement_is_found_from_opposite_faces():
    """Every even error of a pair of faces is a residual; its mean size is the placement's."""
    rng, sd, found = np.random.default_rng(2), 2e-3, []
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    for _ in range(100):
        d = rng.normal(0, sd, (6, 3)) * (rests.up_k == 0)
        accel = GRAVITY.gravity * (rests.up_k + d)
        scene, state = scene_of(replace(rests, accel=accel), None, GRAVITY, names)
        fit = mixed.fit(modelled(scene, state, names, (None, 0.0, 0.0)))
        assert not any(fit.found[name] for name in SCATTER.values())
        assert fit.dof["placement"] == pytest.approx(6, abs=0.1)
        found.append(fit.sds["placement"])
    # 6 degrees of freedom, and the sum of squares made 4: 1 / sd^2 is right on the average.
    assert np.mean(1 / np.square(found)) == pytest.approx(1 / sd**2, rel=0.2)


def test_rests_that_differ_are_no_placement():
    """Rests of one placement differ by noise alone: what else they differ by is scatter."""
    rng = np.random.default_rng(3)
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    twice = replace(
        rests, up_k=np.repeat(rests.up_k, 2, axis=0), accel=np.repeat(rests.accel, 2, axis=0),
        gyro=None, start=10.0 * np.arange(12), time=np.full(12, 8.0),
        group=np.repeat(rests.group, 2),
    )  # fmt: skip
    twice = replace(twice, accel=twice.accel + rng.normal(0, 0.01, (12, 3)))
    names = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))
    scene, state = scene_of(twice, None, GRAVITY, names)
    found = mixed.fit(modelled(scene, state, names, (None, 0.0, 0.0))).found
    assert found[SCATTER["accel"]] == pytest.approx(0.01, rel=0.3)
    assert found["placement"] * GRAVITY.gravity < 0.01


def test_the_change_of_axes_is_unbiased():
    """Two errors of x across, of variance sd^2 / 2 each, make it longer by half their sum.

    What y gets from x it gives to the rotation of the axes; z has it taken off twice.
    """
    sd = 0.01
    names = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    scene, state = scene_of(replace(rests, gyro=None), None, GRAVITY, names)
    model = OnFaces(scene, LAYOUT.subset(names), state, quiet(scene, 1e-7), (sd, 0.0, 0.0))
    solved = gauss_newton.solve(mixed.stated(model))
    np.testing.assert_allclose(solved.coefficients["accel.scale"].values, 0.0, atol=1e-14)
    got = unbiased(solved).coefficients["accel.scale"].values
    np.testing.assert_allclose(got, np.array([-1, 0, 1]) * sd**2 / 2, atol=0.01 * sd**2)


def test_rates_beyond_all_measure_leave_the_rest_alone():
    """Scatter a million times the noise is found, and the accelerometers do not feel it."""
    rng = np.random.default_rng(5)
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    rests = replace(rests, gyro=rests.gyro + rng.normal(0, 5.0, (6, 3)),
                    accel=rests.accel + rng.normal(0, 1e-4, (6, 3)))  # fmt: skip
    scene, state = scene_of(rests, None, GRAVITY, names)
    found = mixed.fit(modelled(scene, state, names, (None, 0.0, 0.0))).found
    assert found[SCATTER["gyro"]] == pytest.approx(5.0, rel=0.5)
    assert found[SCATTER["accel"]] == 0.0 and found["placement"] < 1e-4


def test_a_noise_that_nobody_knows_is_found_beside_a_placement_that_was_declared():
    rng, sd, placement = np.random.default_rng(6), 1e-4, 5e-4
    rests, _, _ = perfect(ImuModel(), np.eye(3), GRAVITY)
    names = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias.")))
    four = {x: np.repeat(getattr(rests, x), 4, axis=0) for x in ("up_k", "accel", "time", "start")}
    four["accel"] = four["accel"] + GRAVITY.gravity * (
        rng.normal(0, placement, (24, 3)) * (four["up_k"] == 0)
    ) + rng.normal(0, sd, (24, 3))  # fmt: skip
    gyro = rng.normal(0, 1e-6, (24, 3))
    rests = replace(rests, **four, gyro=gyro, group=np.arange(24))
    scene, state = scene_of(rests, None, GRAVITY, names)
    noise = FaceNoise.of_means(None, rests)
    fit = mixed.fit(on_faces(scene, state, names, noise, (placement, 0.0, 0.0)))
    assert fit.found["accelerometer noise"] == pytest.approx(sd * np.sqrt(8.0), rel=0.3)
    assert fit.after["accel"].inside
