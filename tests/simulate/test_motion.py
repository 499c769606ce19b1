"""Simulated motion: exact increments, closure against an integrator in another frame, poles."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.models.earth import (
    displacement,
    earth_rate_n,
    east_north_up,
    ecef,
    gravity,
    gravity_n,
    radii,
    transport_rate,
)
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp, log, matrix_of
from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    Rest,
    Rotate,
    Start,
    Straight,
    STurn,
    Sway,
    Turn,
)
from foucault.simulate.motion import motion_of, simulate_motion
from make_motion import DEG, START, drive, flight, integrated
from refusals import refuses

EPS = np.finfo(float).eps
POLAR = Start(89.5 * DEG, 10 * DEG, 100.0, speed=200.0)


def ended(plan, start=START, **how):
    motion, _ = motion_of(plan, start, **how)
    return motion.trajectory(np.array([motion.end]))


def test_at_rest_the_increments_are_those_of_earth_and_gravity() -> None:
    motion, _ = motion_of([Rest(20.0)], START, gravity_offset=3e-4)
    time = np.arange(0, 2001) / 100
    dtheta, dvel = motion.increments(time)
    C_bn = matrix_of(START.heading, START.pitch, START.roll).T
    g = gravity(START.latitude, START.height) + 3e-4
    dt = np.diff(time)[:, None]
    np.testing.assert_allclose(
        dtheta, C_bn @ earth_rate_n(START.latitude) * dt, rtol=0, atol=2 * EPS * 1e-6
    )
    np.testing.assert_allclose(dvel, g * C_bn[:, 2] * dt, rtol=0, atol=4 * EPS * 0.1)


@pytest.mark.thorough
@pytest.mark.parametrize("plan", [drive(1), flight(1)], ids=["drive", "flight"])
def test_increments_of_any_rate_add_up_to_the_same(plan) -> None:
    motion, _ = motion_of(plan, START)
    length = int(motion.end)
    fine = motion.increments(np.arange(400 * length + 1) / 400)
    # Times are rounded to EPS * length, over which rates change by less than this [rad/s, m/s^2].
    slip = EPS * length * np.array([1.0, 30.0])
    for rate in (1, 8, 50):
        coarse = motion.increments(np.arange(rate * length + 1) / rate)
        for one, other, more in zip(coarse, fine, slip, strict=True):
            sums = np.add.reduceat(other, np.arange(0, len(other), 400 // rate))
            rounding = 400 // rate * EPS * np.abs(other).max()
            np.testing.assert_allclose(sums, one, rtol=0, atol=rounding + more)
        if rate == 50:
            angle = np.add.reduceat(fine[0], np.arange(0, len(fine[0]), 8)) - coarse[0]
            assert np.abs(angle).max() < 1e-15


@pytest.mark.thorough
@pytest.mark.parametrize("offset", [0.0, -5e-4])
@pytest.mark.parametrize("plan", [drive(1), flight(1)], ids=["drive", "flight"])
def test_what_is_felt_leads_to_where_the_truth_is(plan, offset: float) -> None:
    # Independent of the simulator: frame e, other equations, another integrator.
    motion, _ = motion_of(plan, START, gravity_offset=offset)
    assert 200 < motion.end < 350
    C_eb, v_e, r_e = integrated(motion, motion.path.edges[1:], offset)
    truth = motion.trajectory(np.array([motion.end]))
    C_en = east_north_up(truth.latitude[0], truth.longitude[0])
    away = r_e - ecef(truth.latitude[0], truth.longitude[0], truth.height[0])
    assert np.linalg.norm(away) < 1e-5
    np.testing.assert_allclose(v_e, C_en @ truth.velocity_n[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(C_eb, C_en @ truth.C_nb[0], rtol=0, atol=1e-11)


@pytest.mark.parametrize("plan", [drive(1), flight(1)], ids=["drive", "flight"])
def test_rates_and_forces_are_derivatives_of_the_trajectory(plan) -> None:
    motion, _ = motion_of(plan, START)
    time = np.linspace(1.0, motion.end - 1.0, 1501)
    h = 1e-3
    f_b, w_b = motion.truth(time)
    at = motion.trajectory(time)
    far, near, on, past = (motion.trajectory(time + k * h) for k in (-2, -1, 1, 2))
    C_bn = at.C_nb.swapaxes(1, 2)

    def turned(a, b):
        return log(a.C_nb.swapaxes(1, 2) @ b.C_nb)

    w_nb = (8 * turned(near, on) - turned(far, past)) / (12 * h)
    dv = (8 * (on.velocity_n - near.velocity_n) - past.velocity_n + far.velocity_n) / (12 * h)
    w_ie = earth_rate_n(at.latitude)
    w_en = transport_rate(at.latitude, at.height, at.velocity_n)
    w_in = np.einsum("nij,nj->ni", C_bn, w_ie + w_en)
    f_n = dv + np.cross(2 * w_ie + w_en, at.velocity_n) - gravity_n(at.latitude, at.height)
    np.testing.assert_allclose(w_b, w_nb + w_in, rtol=0, atol=1e-9)
    np.testing.assert_allclose(f_b, np.einsum("nij,nj->ni", C_bn, f_n), rtol=0, atol=1e-8)
    dL = (8 * (on.latitude - near.latitude) - past.latitude + far.latitude) / (12 * h)
    np.testing.assert_allclose(dL * (radii(at.latitude)[0] + at.height), at.velocity_n[:, 1],
                               rtol=0, atol=1e-5)  # fmt: skip


def test_segments_end_as_they_say() -> None:
    level = Start(40 * DEG, 0.0, 50.0, heading=350 * DEG)
    plan = [Accelerate(30.0, 10.0), Turn(80 * DEG, 20.0, ramp=4.0), Climb(20.0, height=80.0)]
    end = ended(plan, level)
    assert np.linalg.norm(end.velocity_n) == pytest.approx(30.0, abs=1e-13)
    assert end.angles[0] == pytest.approx([70 * DEG, 0, 0], abs=1e-14)
    assert end.height[0] == pytest.approx(130.0, abs=1e-8)
    end = ended([*plan, Climb(5.0, angle=-6 * DEG), STurn(30 * DEG, 20.0)], level)
    assert end.angles[0] == pytest.approx([70 * DEG, -6 * DEG, 0], abs=1e-14)
    assert end.velocity_n[0, 2] == pytest.approx(-30 * np.sin(6 * DEG), abs=1e-13)
    end = ended([*plan, Accelerate(0.0, 7.0), Rest(5.0), Turn(-DEG, 3.0, banked=False)], level)
    assert end.velocity_n.tolist() == [[0, 0, 0]]
    assert end.angles[0, 0] == pytest.approx(69 * DEG, abs=1e-14)


def test_a_steady_turn_has_the_rate_and_the_bank_of_the_textbook() -> None:
    start = Start(0.0, 0.0, speed=100.0)
    motion, _ = motion_of([Turn(np.pi, 62.0, ramp=2.0)], start)
    f_b, _ = motion.truth(np.linspace(3.0, 59.0, 50))
    at = motion.trajectory(np.array([30.0]))
    bank = np.arctan(100.0 * np.pi / 60.0 / gravity(0.0))
    assert at.angles[0, 2] == pytest.approx(bank, abs=1e-14)  # right turn, right side down
    # Felt sideways: Coriolis force and the curve of the Earth alone.
    assert np.abs(f_b[:, 0]).max() < 2 * 7.3e-5 * 100 + 100**2 / 6.3e6
    flat, _ = motion_of([Turn(np.pi, 62.0, banked=False, ramp=2.0)], start)
    f_b, _ = flat.truth(np.array([30.0]))
    assert f_b[0, 0] == pytest.approx(100 * np.pi / 60, abs=0.02)  # pushed to the right


@pytest.mark.parametrize("tones", [1, 5])
def test_a_sway_comes_back_and_is_as_large_as_it_says(tones: int) -> None:
    level = Start(45 * DEG, 7 * DEG, heading=20 * DEG)
    sway = Sway(400.0, 3.0, (0.01, 0.02, 0.03), (0.1, 0.2, 0.3), tones=tones, fade=5.0, seed=3)
    motion, _ = motion_of([sway], level)
    at = motion.trajectory(np.linspace(5.0, 395.0, 40001))
    end = motion.trajectory(np.array([400.0]))
    home = (level.latitude, level.longitude, level.height)
    gone = displacement(*home, end.latitude, end.longitude, end.height)
    # Going north high and south low covers less ground one way: up to rate * 0.3 m * 0.3 m / R.
    assert np.abs(gone).max() < 400.0 * 2 * np.pi / 3.0 * 0.3 * 0.3 / 6.3e6
    assert end.angles[0] == pytest.approx([20 * DEG, 0, 0], abs=1e-15)
    d_n = displacement(*home, at.latitude, at.longitude, at.height)
    d_v = d_n @ exp(np.array([0.0, 0.0, -20 * DEG]))  # right, forward, up
    swings = np.column_stack([at.angles - [20 * DEG, 0, 0], d_v])
    wanted = np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]) / np.sqrt(2)
    # Tones beat: over the window the mean square of their sum is off by less than this.
    np.testing.assert_allclose(np.sqrt(np.mean(swings**2, axis=0)), wanted, rtol=0.02 * tones)


def test_a_table_turns_the_body_and_leaves_the_vehicle() -> None:
    before = matrix_of(START.heading, START.pitch, START.roll)
    turns = [Rotate("y", 40 * DEG, 10 * DEG), Rotate("east", -25 * DEG, 30 * DEG, ramp=1.0)]
    end = ended(turns)
    expected = exp(np.array([-25 * DEG, 0, 0])) @ before @ exp(np.array([0, 40 * DEG, 0]))
    np.testing.assert_allclose(end.C_nb[0], expected, atol=1e-15)
    position = ended([Rest(1.0)])
    for key in ("latitude", "longitude", "height"):
        assert getattr(end, key) == getattr(position, key)
    gone = ended([*turns, Accelerate(10.0, 10.0)])
    assert np.arctan2(gone.velocity_n[0, 0], gone.velocity_n[0, 1]) == pytest.approx(30 * DEG)
    motion, labels = motion_of(turns, START)
    assert turns[0].time == pytest.approx(4.5) and labels[0][1:] == (0.0, turns[0].time)
    assert turns[1].time == pytest.approx(2.0)  # too small an angle for the rate asked
    f_b, w_b = motion.truth(np.linspace(0.6, 3.9, 20))
    np.testing.assert_allclose(w_b[:, 1], 10 * DEG, atol=7.3e-5)
    np.testing.assert_allclose(np.linalg.norm(f_b, axis=1), gravity(50 * DEG, 200.0), rtol=1e-14)


def test_along_a_meridian_both_kinds_of_headings_feel_the_same() -> None:
    plan, start = [Straight(60.0), Climb(30.0, height=50.0)], Start(-30 * DEG, 3.0, speed=90.0)
    time = np.linspace(0.0, 90.0, 91)
    north, carried = (
        motion_of(plan, start, headings=headings)[0] for headings in ("north", "start")
    )
    for one, other in zip(north.truth(time), carried.truth(time), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)
    ends = north.trajectory(time[-1:]), carried.trajectory(time[-1:])
    assert displacement(*(x for at in ends for x in (at.latitude, at.longitude, at.height))
                        ) == pytest.approx(np.zeros((1, 3)), abs=2e-8)  # fmt: skip


def test_straight_over_the_pole() -> None:
    motion, _ = motion_of([Straight(900.0)], POLAR, headings="start")
    time = np.linspace(0.0, 900.0, 9001)
    at = motion.trajectory(time)
    before, after = at.longitude[0], at.longitude[-1]
    assert (before, abs(after - before)) == pytest.approx((10 * DEG, np.pi), abs=1e-9)
    assert at.latitude.max() > 89.9995 * DEG
    # The way to the pole and on, along the meridian at the height of the motion.
    x, weight = np.polynomial.legendre.leggauss(12)
    way = 0.0
    for latitude in at.latitude[[0, -1]]:
        half = (np.pi / 2 - latitude) / 2
        way += half * weight @ (radii(latitude + half * (1 + x))[0] + 100.0)
    assert way == pytest.approx(200.0 * 900.0, abs=1e-6)
    np.testing.assert_allclose(at.angles[-1], [np.pi, 0, 0], atol=1e-8)
    np.testing.assert_allclose(at.velocity_n[-1], [0, -200, 0], atol=1e-6)
    f_b, w_b = motion.truth(time)
    assert np.abs(np.diff(f_b, axis=0)).max() < 1e-4 and np.abs(np.diff(w_b, axis=0)).max() < 1e-8


def test_a_start_at_the_pole_goes_along_the_meridian_given() -> None:
    start = Start(np.pi / 2, 25 * DEG, heading=np.pi, speed=50.0)  # south, along that meridian
    motion, _ = motion_of([Straight(100.0)], start, headings="start")
    at = motion.trajectory(np.array([0.0, 100.0]))
    assert at.latitude[0] == pytest.approx(np.pi / 2, abs=1e-15)
    assert at.longitude[1] == pytest.approx(25 * DEG, abs=1e-9)
    way = (np.pi / 2 - at.latitude[1]) * radii(np.pi / 2)[0]
    assert way == pytest.approx(5000.0, abs=1e-4)  # RM is that of the pole
    assert at.angles[1, 0] == pytest.approx(np.pi, abs=1e-9)


def test_over_the_date_line() -> None:
    start = Start(10 * DEG, np.radians(179.9999), heading=90 * DEG, speed=100.0)
    at = motion_of([Straight(10.0)], start)[0].trajectory(np.array([0.0, 10.0]))
    assert at.longitude[0] > 0 > at.longitude[1]
    turned = (at.longitude[1] - at.longitude[0]) % (2 * np.pi)
    assert turned * radii(10 * DEG)[1] * np.cos(10 * DEG) == pytest.approx(1000.0, abs=1e-6)


def test_turns_about_the_pole_close_in_frame_e() -> None:
    plan = [Straight(40.0), Turn(200 * DEG, 60.0), STurn(50 * DEG, 40.0), Straight(40.0)]
    start = Start(-89.97 * DEG, 60 * DEG, 3000.0, heading=170 * DEG, speed=120.0)
    motion, _ = motion_of(plan, start, headings="start")
    assert motion.trajectory(np.linspace(0, motion.end, 500)).latitude.min() < -89.98 * DEG
    C_eb, _, r_e = integrated(motion, motion.path.edges[1:])
    truth = motion.trajectory(np.array([motion.end]))
    C_en = east_north_up(truth.latitude[0], truth.longitude[0])
    away = r_e - ecef(truth.latitude[0], truth.longitude[0], truth.height[0])
    assert np.linalg.norm(away) < 1e-5
    np.testing.assert_allclose(C_eb, C_en @ truth.C_nb[0], rtol=0, atol=1e-11)


def test_headings_from_north_are_refused_at_the_pole() -> None:
    with refuses("manoeuvre.pole") as caught:
        motion_of([Straight(900.0)], POLAR)
    assert 'headings="start"' in str(caught.value) and "89.9 deg" in str(caught.value)


def test_log_of_increments_and_its_truth() -> None:
    made = simulate_motion(drive(1), START, rate=50.0)
    assert made.log.sampled == "increment"
    dtheta, dvel = made.motion.increments(np.arange(-1, len(made.log)) / 50.0)
    dt = np.diff(np.arange(-1, len(made.log)) / 50.0)[:, None]
    np.testing.assert_array_equal(made.log.gyro, dtheta / dt)
    np.testing.assert_array_equal(made.log.accel, dvel / dt)
    np.testing.assert_array_equal(made.truth.time, made.log.time)
    assert [label for label, _, _ in made.labels][:3] == ["align", "Sway", "Rotate"]
    assert made.labels[-1][2] == made.motion.end
    state = made.truth.state(0)
    assert (state.latitude, state.height) == (START.latitude, START.height)
    assert (state.heading, state.pitch, state.roll) == pytest.approx(
        (START.heading, START.pitch, START.roll), abs=1e-15
    )


def test_log_of_rates_is_the_truth_at_its_times() -> None:
    made = simulate_motion(drive(1), START, rate=20.0, sampled="rate")
    f_b, w_b = made.motion.truth(made.log.time)
    np.testing.assert_array_equal(made.log.accel, f_b)
    np.testing.assert_array_equal(made.log.gyro, w_b)


def test_errors_of_the_instrument_act_on_rates_not_on_increments() -> None:
    quadratic = np.zeros((3, 6))
    quadratic[:, :3] = 1e-3
    model = ImuModel(accel_quadratic=quadratic, gyro_bias=np.array([1e-4, 0.0, -1e-4]))
    plan = [Sway(4.0, 0.5, shift=(0.01, 0.02, 0.03))]
    made = simulate_motion(plan, START, rate=5.0, model=model)
    f_b, w_b = made.motion.truth((np.arange(20 * 10000) + 0.5) / 50000)
    accel, gyro = (x.reshape(20, 10000, 3).mean(axis=1) for x in model.measure(f_b, w_b))
    np.testing.assert_allclose(made.log.accel[1:], accel, rtol=0, atol=1e-7)
    np.testing.assert_allclose(made.log.gyro[1:], gyro, rtol=0, atol=1e-12)
    of_means, _ = model.measure(f_b.reshape(20, 10000, 3).mean(axis=1), w_b[:20])
    assert np.abs(made.log.accel[1:] - of_means).max() > 1e-3


def test_noise_is_that_of_the_model_and_of_the_seed() -> None:
    noise = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=1e-5))
    plan = [Rest(50.0)]
    clean = simulate_motion(plan, START, rate=100.0).log
    one, again, other = (
        simulate_motion(plan, START, rate=100.0, noise=noise, seed=s).log for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.gyro, again.gyro)
    assert np.abs(one.gyro - other.gyro).max() > 0
    from scipy.stats import chi2

    low, high = chi2.ppf([0.0025, 0.9975], 3 * len(clean))
    for key, white in (("accel", 1e-3), ("gyro", 1e-5)):
        z = (getattr(one, key) - getattr(clean, key)) / (white * 10)
        assert low < np.sum(z**2) < high


def test_headings_are_from_one_or_the_other() -> None:
    with pytest.raises(FoucaultError, match=r"`headings` .* 'grid'; .* \"north\" or \"start\""):
        motion_of([Rest(1.0)], START, headings="grid")  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [0.0, -5.0, 0.01, float("nan")])
def test_a_rate_without_a_sample_is_refused(rate: float) -> None:
    with pytest.raises(FoucaultError, match=r"`rate` of the simulation .* 0\.1 Hz or more"):
        simulate_motion([Rest(10.0)], START, rate=rate)
