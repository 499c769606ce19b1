"""Strapdown navigation against the true equations of motion and the formulas of the books."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

import reference
from foucault.models.earth import EARTH_RATE, east_north_up, gravity
from foucault.models.rotation import log as rotation_vector
from foucault.models.rotation import matrix_of
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import HEIGHT_LOOP, navigate
from make_strapdown import (
    DEG,
    VEHICLES,
    coning,
    error_history,
    errors,
    gathered,
    order_run,
    residual,
    schuler_rate,
    sculling,
    standing,
    standing_run,
    static_error_matrix,
    swing_direction,
    textbook,
    true_state,
    vehicle,
)
from refusals import refuses

HOUR = 3600.0
STANDING = matrix_of(1.0, 0.2, -0.3)


# -- the true motion ---------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("name", VEHICLES)
def test_fourth_order_in_attitude_third_in_velocity(name):
    missed = order_run(name, (0.02, 0.01, 0.005), 20.0)
    order = np.log2(missed[:-1] / missed[1:])
    np.testing.assert_allclose(order[:, 0], 4.0, rtol=0, atol=0.15)
    assert np.all(order[:, 1] > 2.85)  # on its way down to three
    assert np.all(missed[-1] < [3e-8, 5e-6, 1e-4])


def test_second_order_in_position_by_the_change_of_acceleration():
    """The trapezium of the velocities misses dt^2 / 12 times the change of acceleration."""
    state, w, f = vehicle(0.5, 0.3, 100.0, np.array([3.0, 4.0, 0.0]), angle=0.0)
    end, steps = 20.0, np.array([0.1, 0.05, 0.025])
    true = true_state(w, f, state, 0.0, end)
    pushed = np.linalg.norm(np.diff(f(np.array([0.0, end])), axis=0))
    for dt in steps:
        time = np.arange(round(end / dt) + 1) * dt
        away = errors(navigate(gathered(w, f, time), state).state(-1), true)[2]
        np.testing.assert_allclose(away, dt**2 / 12 * pushed, rtol=0.02)


@pytest.mark.thorough
def test_over_the_pole_and_the_date_line():
    for name, crossed in (("aircraft over the pole", "pole"), ("aircraft over the date line", "")):
        state, w, f = VEHICLES[name]
        time = np.arange(4001) * 0.01
        run = navigate(gathered(w, f, time), state)
        assert np.isfinite(run.angles).all()
        if crossed:
            assert run.latitude.max() > 89.99 * DEG and run.latitude[-1] < run.latitude.max()
            assert abs(np.cos(run.longitude[-1] - run.longitude[0]) + 1) < 0.1
        else:
            assert run.longitude[0] > 179 * DEG and run.longitude[-1] < -179 * DEG
        missed = errors(run.state(-1), true_state(w, f, state, 0.0, 40.0))
        assert np.all(missed < [1e-7, 2e-5, 2e-4])


@pytest.mark.thorough
@pytest.mark.parametrize("latitude", [0.0, 45.0, -60.0, 89.999, 90.0])
def test_stands_still_for_hours(latitude):
    increments, state = standing(latitude * DEG, 6 * HOUR, 0.02, C_nb=STANDING)
    missed = errors(navigate(increments, state, vertical="held").state(-1), state)
    assert np.all(missed < [1e-9, 5e-7, 5e-3])


@pytest.mark.parametrize("height", [0.0, 1e4])
def test_stands_still_with_free_height(height):
    increments, state = standing(0.9, 0.5 * HOUR, 0.02, C_nb=STANDING, height=height)
    # Measured gravity, and an instrument that feels it.
    felt = replace(increments, dvel_b=increments.dvel_b * (1 + 1e-5))
    run = navigate(felt, state, gravity_offset=1e-5 * gravity(0.9, height))
    assert np.all(errors(run.state(-1), state) < [1e-9, 1e-6, 5e-4])


# -- the books' formulas -----------------------------------------------------------------------

AT = 45 * DEG


@pytest.mark.parametrize("name", textbook(AT, np.zeros(1)))
def test_textbook(name):
    t = np.arange(round(0.75 * HOUR) + 1.0)
    more, want = textbook(AT, t)[name]
    run, state = standing_run(AT, t[-1], 1.0, **more)
    RM = gravity(AT) / schuler_rate(AT) ** 2
    north = (run.latitude - state.latitude) * RM
    # The formulas leave out the Earth's rotation: (w_ie t)^2 / 2 of them, at most.
    np.testing.assert_allclose(north, want, rtol=0, atol=0.02 * np.abs(want).max())


@pytest.mark.parametrize("latitude", [45 * DEG, -20 * DEG])
@pytest.mark.parametrize("name", textbook(AT, np.zeros(1)))
def test_linear_error_equations_over_a_day(name, latitude):
    more, _ = textbook(latitude, np.zeros(1))[name]
    every, dt, hours = 900, 2.0, 24
    run, state = standing_run(latitude, hours * HOUR, dt, **more)
    quiet, _ = standing_run(latitude, hours * HOUR, dt)
    found = error_history(run.every(every), state) - error_history(quiet.every(every), state)
    A, y = np.zeros((8, 8)), np.zeros(8)
    A[:7, :7] = static_error_matrix(latitude)
    A[:3, 7] = -np.array(more.get("gyro_n", (0, 0, 0)))
    A[3:5, 7] = more.get("accel_n", (0, 0, 0))[:2]
    y[:3], y[3:5] = more.get("tilt", (0, 0, 0)), more.get("velocity", (0, 0, 0))[:2]
    y[7] = 1.0
    Phi = expm(A * every * dt)
    want = [y]
    for _ in range(len(found) - 1):
        want.append(Phi @ want[-1])
    want = np.array(want)[:, :7]
    np.testing.assert_allclose(found / np.abs(want).max(axis=0), want / np.abs(want).max(axis=0),
                               rtol=0, atol=3e-3)  # fmt: skip


def test_schuler_period():
    run, _ = standing_run(0.0, 3 * HOUR, 1.0, velocity=(0.0, 0.01, 0.0))
    v = run.velocity_n[:, 1]
    k = np.flatnonzero(np.diff(np.sign(v)))
    crossing = run.time[k] - v[k] / (v[k + 1] - v[k])
    period = 2 * np.mean(np.diff(crossing))
    # On the equator along the meridian; the Earth's rotation shortens it by (w_ie / w_s)^2 / 2.
    np.testing.assert_allclose(period, 2 * np.pi / schuler_rate(0.0), rtol=3e-3)
    np.testing.assert_allclose(2 * np.pi * np.sqrt(6371e3 / 9.81) / 60, 84.4, atol=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("latitude", [50 * DEG, 15 * DEG, -35 * DEG])
def test_foucault_the_swing_turns_with_the_earth(latitude):
    run, _ = standing_run(latitude, 48 * HOUR, 1.0, velocity=(0.0, 0.1, 0.0))
    # The radii of curvature differ along and across the meridian: 0.7 % at 15 deg.
    time, direction = swing_direction(run, 2 * np.pi / schuler_rate(latitude))
    turn = np.polyfit(time, direction, 1)[0]
    np.testing.assert_allclose(turn, -EARTH_RATE * np.sin(latitude), rtol=1e-2)


def test_azimuth_error_goes_round_in_a_day():
    """psi = phi - dtheta stands still in inertial space, so it turns with the Earth seen here."""
    latitude, psi = 40 * DEG, np.array([0.0, 0.0, 1e-5])
    run, state = standing_run(latitude, 24 * HOUR, 1.0, tilt=psi)
    quiet, _ = standing_run(latitude, 24 * HOUR, 1.0)
    rows = 1800
    e = error_history(run.every(rows), state) - error_history(quiet.every(rows), state)
    moved = np.column_stack([-e[:, 5], e[:, 6] * np.cos(latitude), e[:, 6] * np.sin(latitude)])
    axis = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    turned = [expm(-reference.cross(axis) * EARTH_RATE * t) @ psi for t in run.every(rows).time]
    np.testing.assert_allclose(e[:, :3] - moved, turned, rtol=0, atol=1e-4 * 1e-5)


# -- the vertical channel ----------------------------------------------------------------------


def test_free_height_runs_away():
    increments, state = standing(90 * DEG, 0.5 * HOUR, 0.1)
    run = navigate(increments, replace(state, height=1.0))
    rate = np.sqrt(gravity(90 * DEG) - gravity(90 * DEG, 1.0))
    np.testing.assert_allclose(run.height, np.cosh(rate * run.time), rtol=1e-5)
    np.testing.assert_allclose(rate, np.sqrt(2 * 9.832 / 6.3781e6), rtol=1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("every", [1, 100, 3000])
def test_aided_height_settles_however_rare_the_heights_are(every):
    increments, state = standing(AT, 12 * HEIGHT_LOOP, 0.01, accel_n=(0.0, 0.0, 0.01))
    heights = np.full(len(increments), np.nan)
    heights[::every] = 0.0
    run = navigate(increments, replace(state, height=50.0), vertical="aided", heights=heights)
    wrong = 0.01 * HEIGHT_LOOP**2
    assert np.abs(run.height).max() < 50.0 + 0.5 * wrong
    assert abs(run.height[-1]) < 2e-3 * (50.0 + wrong) and abs(run.velocity_n[-1, 2]) < 2e-3
    last = len(increments) - 1
    back = navigate(increments, replace(state, height=50.0), first=last, last=0, vertical="aided",
                    heights=heights)  # fmt: skip
    assert abs(back.height[-1]) < 2e-3 * (50.0 + wrong) and abs(back.velocity_n[-1, 2]) < 2e-3


def test_aided_height_follows_its_loop():
    """Of a metre the loop leaves (1 - 2 t + t^2 / 2) exp(-t), t in time constants."""
    increments, state = standing(90 * DEG, 6 * HEIGHT_LOOP, 0.02)
    run = navigate(increments, replace(state, height=1.0), vertical="aided",
                   heights=np.zeros(len(increments)))  # fmt: skip
    t = run.time / HEIGHT_LOOP
    np.testing.assert_allclose(run.height, (1 - 2 * t + t**2 / 2) * np.exp(-t), rtol=0, atol=2e-3)


def test_held_height_stays():
    state, w, f = VEHICLES["survey vehicle, turning"]
    run = navigate(gathered(w, f, np.arange(500) * 0.01), state, vertical="held")
    assert np.ptp(run.height) == 0.0
    np.testing.assert_allclose(run.velocity_n[:, 2], 0.0, rtol=0, atol=1e-13)


# -- coning, sculling, rotation ----------------------------------------------------------------

FREQUENCIES = pytest.mark.parametrize("frequency", [2.0, 5.0, 10.0, 20.0])
COMPENSATED = pytest.mark.parametrize("compensated", [True, False])


def joined(increments: Increments, compensated: bool) -> Increments:
    return replace(increments, joined=increments.joined & compensated)


@FREQUENCIES
@COMPENSATED
def test_coning_drift(frequency, compensated):
    dt, angle = 0.01, 0.5 * DEG
    time = np.arange(201) * dt
    increments, state, C_nb = coning(angle, frequency, time)
    run = navigate(joined(increments, compensated), state, vertical="held")
    drift = rotation_vector(run.C_nb[-1] @ C_nb.T) / time[-1]
    x = 2 * np.pi * frequency * dt
    missed = np.sin(angle) ** 2 * residual(x, compensated) / dt
    np.testing.assert_allclose(drift, [-missed, 0.0, 0.0], rtol=1e-4, atol=1e-3 * missed)
    if compensated and x < 0.4:
        np.testing.assert_allclose(missed, np.sin(angle) ** 2 * x**5 / 60 / dt, rtol=0.1)


@cache
def sculled(frequency, dt, angle, push):
    """Increments, start and true end of a second of sculling: whole periods."""
    time = np.arange(101) * dt
    increments, state, (w, f) = sculling(angle, push, frequency, time)
    return time, increments, state, true_state(w, f, state, 0.0, time[-1])


@pytest.mark.thorough
@FREQUENCIES
@COMPENSATED
def test_sculling_drift(frequency, compensated):
    dt, angle, push = 0.01, 0.01 * DEG, 10.0
    time, increments, state, true = sculled(frequency, dt, angle, push)
    run = navigate(joined(increments, compensated), state)
    np.testing.assert_allclose(true.velocity_n[2] / time[-1], angle * push / 2, rtol=1e-5)
    drift = (run.velocity_n[-1] - true.velocity_n)[2] / time[-1]
    x = 2 * np.pi * frequency * dt
    np.testing.assert_allclose(drift, -angle * push * residual(x, compensated) / x, rtol=2e-3)


def test_constant_rate_and_force_are_exact():
    """The rotation of the force during an interval, whatever its size; 6.6 ug without 1/6."""
    dt, g = 0.02, 9.80665
    theta, dv = np.array([18 * DEG * dt, 0.0, 0.0]), np.array([0.0, 0.0, g * dt])
    start = np.eye(3), np.zeros(3), east_north_up(0.7, 0.0), 0.0
    with_it = reference.strapdown_step(start, theta, dv, dt=dt)[1]
    without = reference.strapdown_step(start, theta, dv, dt=dt, third=False)[1]
    np.testing.assert_allclose((without - with_it)[2] / dt / g, 6.58e-6, rtol=1e-3)
    for angle in (1e-3, theta[0], 0.3, 2.5):
        turn, push = angle * np.array([0.6, 0.0, 0.8]), np.array([3.0, -2.0, 9.0])
        M = np.zeros((4, 4))
        M[:3, :3], M[:3, 3] = reference.cross(turn), push
        want = reference.turning(turn).T @ expm(M)[:3, 3]  # by the attitude of the end
        # A step so short that neither the Earth nor gravity does anything.
        increments = Increments.of(np.array([0.0, 1e-9]), np.tile(turn, (2, 1)),
                                   np.tile(push, (2, 1)))  # fmt: skip
        _, state = standing(0.7, 1.0, 1.0)
        end = navigate(increments, state).state(-1)
        np.testing.assert_allclose(end.C_nb.T @ end.velocity_n, want, rtol=0, atol=1e-7)


# -- there and back ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("vertical", ["free", "held"])
def test_there_and_back(name, vertical):
    state, w, f = VEHICLES[name]
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.005, 0.02, 3000))
    increments = gathered(w, f, time)
    if vertical == "held":
        state = replace(state, velocity_n=state.velocity_n * [1.0, 1.0, 0.0])
    there = navigate(increments, state, first=100, last=2900, vertical=vertical)
    back = navigate(increments, there.state(-1), first=2900, last=100, vertical=vertical)
    assert len(there) == len(back) == 2801
    np.testing.assert_array_equal(back.time, there.time[::-1])
    for row in (1, 500, -1):
        missed = errors(back.state(row), there.state(-1 - row))
        assert np.all(missed < [1e-12, 1e-9, 1e-6])


@pytest.mark.parametrize("back", [False, True])
def test_in_pieces(back):
    state, w, f = VEHICLES["aircraft over the pole"]
    increments = gathered(w, f, np.arange(2001) * 0.01)
    ends = [0, 1, 700, 1999, 2000]
    if back:
        state, ends = navigate(increments, state).state(-1), ends[::-1]
    whole = navigate(increments, state, first=ends[0], last=ends[-1])
    at = state
    for first, last in pairwise(ends):
        at = navigate(increments, at, first=first, last=last).state(-1)
    assert np.all(errors(at, whole.state(-1)) < [1e-12, 1e-10, 1e-7])
    # A slice of the log is the log: the row it starts at still knows the one before.
    part = navigate(increments[700:], whole.state(700 if not back else 1300), last=100)
    same = navigate(increments, whole.state(700 if not back else 1300), first=700, last=800)
    np.testing.assert_array_equal(part.history, same.history)


def test_every_and_state():
    state, w, f = VEHICLES["survey vehicle, turning"]
    run = navigate(gathered(w, f, np.arange(26) * 0.01), state)
    some = run.every(10)
    np.testing.assert_array_equal(some.history, run.history[[0, 10, 20, 25]])
    np.testing.assert_array_equal(run.every(5).history, run.history[::5])
    at = run.state(-1)
    assert (at.latitude, at.longitude, at.height) == (
        run.latitude[-1], run.longitude[-1], run.height[-1]
    )  # fmt: skip
    np.testing.assert_array_equal(at.C_nb, run.C_nb[-1])
    np.testing.assert_array_equal((at.heading, at.pitch, at.roll), run.angles[-1])


# -- mistakes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "words", "more"),
    [
        ("strapdown.rows", "Row 11 was asked for; the log has rows 0 to 10", {"last": 11}),
        ("strapdown.rows", "Row -1 was asked for", {"first": -1}),
        ("strapdown.vertical", "'hold' is not known. Did you mean 'held'", {"vertical": "hold"}),
        ("strapdown.heights", "no heights were given", {"vertical": "aided"}),
        (
            "strapdown.heights",
            "there are 3 heights for 11 rows",
            {"vertical": "aided", "heights": np.zeros(3)},
        ),
        (
            "strapdown.heights",
            "none of the heights is a number",
            {"vertical": "aided", "heights": np.full(11, np.nan)},
        ),
    ],
)
def test_mistakes(code, words, more):
    increments, state = standing(AT, 10.0, 1.0)
    with refuses(code, match=words):
        navigate(increments, state, **more)


@pytest.mark.parametrize("rows", [(0, 10), (10, 0)])
def test_samples_that_are_not_finite(rows):
    increments, state = standing(AT, 10.0, 1.0)
    increments.dvel_b[4] = np.nan
    with refuses("strapdown.not_finite", "not finite from row 4 on, 4 s"):
        navigate(increments, state, first=rows[0], last=rows[1])
