"""Simulated transfer alignment: lever arm, flexure, delay, messages, and closure of the slave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from foucault.models.earth import displacement, earth_rate_n, gravity
from foucault.models.imu import LAYOUT
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of, exp, matrix_of, turned
from foucault.models.transfer import LIVELY
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import navigate
from foucault.plans.manoeuvres import Start, Turn
from foucault.plans.transfer import TransferProfile
from foucault.simulate.transfer import (
    Barometer,
    Flexure,
    Link,
    MasterNoise,
    Slave,
    Vibration,
    draw_flexure,
    draw_slave,
    simulate_transfer,
    turn_on_grade,
)
from make_transfer_flight import ARCMIN, DEG, QUIET, SHORT, START
from refusals import refuses

ARM = (1.5, -3.0, -0.7)
MU = (5 * ARCMIN, -40 * ARCMIN, 8 * ARCMIN)
TURNED = matrix_of(90 * DEG, 20 * DEG, -10 * DEG)


def limits(dof: int, tests: int) -> tuple[float, float]:
    """Two-sided limits of a chi-square variable, 1 % over all tests."""
    low, high = chi2.ppf([0.005 / tests, 1 - 0.005 / tests], dof)
    return low, high


def missed(run, last: int | None = None) -> tuple[float, float, float]:
    """Navigate a slave from its true start; return errors of position, velocity, attitude."""
    at = run.truth
    found = navigate(increments_of(run.log), at.state(0), last=last)
    k = len(found) - 1
    away = displacement(at.latitude[k], at.longitude[k], at.height[k],
                        found.latitude[-1], found.longitude[-1], found.height[-1])  # fmt: skip
    off = np.abs(found.C_nb[-1] - at.C_nb[k]).max()
    return np.linalg.norm(away), np.linalg.norm(found.velocity_n[-1] - at.velocity_n[k]), off


def test_a_lever_arm_feels_what_the_textbook_says() -> None:
    # On the spot and flat: the rate grows for 2 s, is constant, and fades.
    spin = TransferProfile("spin", Start(45 * DEG, 0.0), (Turn(-720 * DEG, 20.0, False, ramp=2.0),))
    rate, S = 100.0, 40 * DEG
    for arm in ((0.0, 2.0, 0.0), (0.5, -1.0, 3.0)):
        still, far = (simulate_transfer(spin, rate=rate, slave=Slave(lever_m=a)).log
                      for a in ((0.0, 0.0, 0.0), arm))  # fmt: skip
        more = far.accel - still.accel
        np.testing.assert_array_equal(far.gyro, still.gyro)
        middle = slice(400, 1500)
        w = still.gyro[middle]
        x, y, z = arm
        # Towards the axis. The Earth's rate turns in the body, which with its part of w x (w x l)
        # is the Coriolis force. Gravity points to the Earth's centre and fades above.
        turning = np.gradient(w, 1 / rate, axis=0)
        felt = np.cross(w, np.cross(w, arm)) + np.cross(turning, arm)
        pull = np.array([1.54e-6 * x, 1.54e-6 * y, -3.08e-6 * z])
        np.testing.assert_allclose(more[middle][1:-1], (felt + pull)[1:-1], rtol=0, atol=3e-8)
        np.testing.assert_allclose(more[middle, :2], [[-S**2 * x, -S**2 * y]] * 1100,
                                   rtol=0, atol=3e-4)  # fmt: skip
        # The ramp: the integral of w' x l is the whole change of w x l, but for Coriolis's force.
        w = still.gyro[:300]  # of the ramp, and a second of what is then steady
        ramp = (more[:300] - np.cross(w, np.cross(w, arm))).sum(axis=0) / rate
        np.testing.assert_allclose(ramp[:2], [-S * y, S * x], rtol=0, atol=4e-4)


def test_where_the_slave_is() -> None:
    run = simulate_transfer(SHORT, rate=50.0, slave=Slave(TURNED, MU, ARM))
    at, master = run.truth, run.motion.trajectory(run.log.time)
    _, w_m = run.motion.truth(run.log.time)
    away = displacement(master.latitude, master.longitude, master.height,
                        at.latitude, at.longitude, at.height)  # fmt: skip
    np.testing.assert_allclose(away, master.C_nb @ np.array(ARM), rtol=0, atol=1e-8)
    w_nm = w_m - np.einsum("nji,nj->ni", master.C_nb, earth_rate_n(master.latitude))
    v = master.velocity_n + np.einsum("nij,nj->ni", master.C_nb, np.cross(w_nm, ARM))
    np.testing.assert_allclose(at.velocity_n, v, rtol=0, atol=50 * 1e-6)
    C_nb = master.C_nb @ TURNED @ exp(np.array(MU))
    np.testing.assert_allclose(at.C_nb, C_nb, rtol=0, atol=1e-6)
    # Velocity is the derivative of position: the slave's own, lever arm and all.
    step = displacement(at.latitude[:-2], at.longitude[:-2], at.height[:-2],
                        at.latitude[2:], at.longitude[2:], at.height[2:])  # fmt: skip
    np.testing.assert_allclose(step * 25, at.velocity_n[1:-1], rtol=0, atol=5e-3)


@pytest.mark.parametrize("rate", [100.0, 200.0])
@pytest.mark.parametrize(
    ("changes", "metres"),
    [
        ({}, 1e-4),
        ({"compliance": (2e-3, -1e-3, 5e-4)}, 1e-4),
        ({"flexure": Flexure((5 * ARCMIN,) * 3, 1.0)}, 1e-3),
        ({"vibration": Vibration(1.0, 0.005, 5.0, 15.0)}, 2e-3),
    ],
    ids=["rigid", "load", "flexure", "vibration"],
)
def test_the_slave_navigated_without_errors_comes_where_it_is(rate, changes, metres) -> None:
    slave = Slave(TURNED, MU, ARM, **changes)
    run = simulate_transfer(SHORT, rate=rate, slave=slave, seed=4)
    position, velocity, attitude = missed(run)
    assert position < metres
    assert velocity < metres / 10
    assert attitude < metres / 1e4
    if changes:  # what moves the slave on its mount is in its readings: not so without it
        still = simulate_transfer(SHORT, rate=rate, slave=Slave(TURNED, MU, ARM), seed=4)
        assert missed(replace(run, log=still.log))[0] > 20 * metres


@pytest.mark.parametrize("time", [0.2, 3.0])
def test_flexure_is_as_large_and_as_slow_as_it_says(time: float) -> None:
    sd, dt, rng = np.array([1.0, 2.0, 0.5]) * 1e-3, 0.02, np.random.default_rng(5)
    flexure = Flexure(tuple(sd), time)
    theta, rate = draw_flexure(flexure, 400_000, dt, rng)
    apart = int(8 * time / dt)  # correlation 6e-7
    b = LIVELY / time
    for x, size in ((theta, sd), (rate, b * sd)):
        for axis in range(3):
            some = x[::apart, axis] / size[axis]
            low, high = limits(len(some), 12)
            assert low < some @ some < high
    # exp(-1) after the correlation time; Fisher's z, 1 % over both times and three axes
    one, later = theta[::apart], theta[int(time / dt) :: apart]
    n = min(len(one), len(later))
    for axis in range(3):
        r = np.corrcoef(one[:n, axis], later[:n, axis])[0, 1]
        z = (np.arctanh(r) - np.arctanh(np.exp(-1))) * np.sqrt(n - 3)
        assert abs(z) < norm.ppf(1 - 0.005 / 6)
    # The rate is that of the angle but for the bridge of what drives it, 4 b^3 sd^2 dt / 12.
    off = np.diff(theta, axis=0) / dt - (rate[1:] + rate[:-1]) / 2
    assert np.std(off / sd) == pytest.approx(np.sqrt(b**3 * dt / 3), rel=0.02)


def test_flexure_begins_as_it_goes_on() -> None:
    rng = np.random.default_rng(2)
    flexure = Flexure((1.0, 1.0, 1.0), 1.0)
    drawn = [draw_flexure(flexure, 2, 0.1, rng) for _ in range(300)]
    theta, rate = np.array(drawn)[:, :, 0].transpose(1, 0, 2)
    for x, size in ((theta, 1.0), (rate, LIVELY)):
        low, high = limits(x.size, 3)
        assert low < np.sum((x / size) ** 2) < high
    r = np.corrcoef(theta.ravel(), rate.ravel())[0, 1]
    assert abs(r) * np.sqrt(theta.size) < norm.ppf(1 - 0.005 / 3)


def test_load_bends_by_what_is_felt_upward() -> None:
    bank = 60 * DEG
    start = Start(0.0, 0.0, speed=100.0)
    turn = Turn(np.tan(bank) * gravity(0.0) / 100.0 * 28.0, 30.0, ramp=2.0)
    run = simulate_transfer(TransferProfile("bank", start, (turn,)), rate=50.0,
                            slave=Slave(mu=MU, compliance=(1e-3, -2e-3, 0.0)))  # fmt: skip
    load = run.mu[750] - MU
    more = gravity(0.0) / np.cos(bank) / 9.80665 - 1.0
    np.testing.assert_allclose(load, [1e-3 * more, -2e-3 * more, 0.0], rtol=0, atol=1e-5)
    assert run.mu[0] == pytest.approx(np.array(MU) + 1e-3 * np.array([1, -2, 0]) *
                                      (gravity(0.0) / 9.80665 - 1.0), abs=1e-5)  # fmt: skip


def test_vibration_has_its_size_and_its_band() -> None:
    shaken = Slave(vibration=Vibration(2.0, 0.02, 10.0, 30.0))
    with_it, without = (simulate_transfer(SHORT, rate=200.0, slave=s).log
                        for s in (shaken, Slave()))  # fmt: skip
    for triad, size in (("gyro", 0.02), ("accel", 2.0)):
        more = getattr(with_it, triad) - getattr(without, triad)
        power = np.abs(np.fft.rfft(more, axis=0)) ** 2
        f = np.fft.rfftfreq(len(more), 1 / 200)
        inside = (f > 9) & (f < 31)
        assert power[inside].sum() > 0.99 * power.sum()
        # A mean over an interval has sinc(f dt)^2 of the power; 20 Hz over 60 s are 1200 bins.
        kept = np.mean(np.sinc(np.linspace(10, 30, 201) / 200) ** 2)
        assert np.sqrt(np.mean(more**2) / kept) == pytest.approx(
            size, rel=5 / np.sqrt(2 * 3 * 1200)
        )


def test_a_message_is_true_a_delay_before_it_arrives() -> None:
    link = Link(delay=0.08)
    run = simulate_transfer(SHORT, rate=50.0, link=link, noise=QUIET)
    then = run.motion.trajectory(run.master.time - 0.08)
    np.testing.assert_allclose(run.master.velocity_n, then.velocity_n, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.master.C_nb, then.C_nb, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.master.latitude, then.latitude, rtol=0, atol=1e-14)
    now = run.motion.trajectory(run.master.time)
    assert np.abs(now.velocity_n - run.master.velocity_n).max() > 0.5  # it shows
    assert run.delay == pytest.approx(0.08, abs=1e-12)
    assert len(run.master) == 399 and run.master.time[-1] <= run.hand_over == 40.0


@pytest.mark.parametrize("stamped", ["validity", "both"])
def test_a_master_that_stamps_has_a_clock_of_its_own(stamped) -> None:
    link = Link(delay=0.08, stamped=stamped, drift=200e-6, offset=-3.0)
    run = simulate_transfer(SHORT, rate=50.0, link=link, noise=QUIET)
    valid = (run.master.time + 3.0) / (1 + 200e-6)
    then = run.motion.trajectory(valid)
    np.testing.assert_allclose(run.master.velocity_n, then.velocity_n, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.received.valid, valid, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diff(run.master.time), 0.1, rtol=0, atol=1e-9)
    assert run.delay == pytest.approx(-3.0, abs=0.01)
    assert (run.master.arrival is None) == (stamped == "validity")
    taken = run.master.messages
    np.testing.assert_array_equal(taken.C_nm, run.master.C_nb)
    if run.master.arrival is not None:
        np.testing.assert_array_equal(taken.time, run.master.arrival)
        np.testing.assert_allclose(run.master.arrival, valid + 0.08, rtol=0, atol=1e-9)


def test_jitter_losses_and_repeats_are_counted() -> None:
    link = Link(rate=20.0, delay=0.1, jitter=0.004, lost=0.1, repeated=0.2, silent=((10.0, 12.0),))
    run = simulate_transfer(SHORT, rate=50.0, link=link, seed=9)
    got = run.received
    assert len(run.master) == len(got.table) - got.repeated
    whole = simulate_transfer(SHORT, rate=50.0, link=Link(rate=20.0, delay=0.1), seed=9).master
    assert abs(len(run.master) + got.lost - len(whole)) <= 1
    assert 40 + 0.05 * 760 < got.lost < 40 + 0.16 * 760
    assert 0.13 * 690 < got.repeated < 0.27 * 690
    codes = {f.code: f.message for f in run.master.findings}
    assert set(codes) == {"master.repeated", "master.gaps"}
    assert f"{got.repeated} messages repeat" in codes["master.repeated"]
    assert "the longest is 2." in codes["master.gaps"]
    # jitter about the mean, and none in what is said
    late = run.master.time - np.interp(run.master.time, got.table.time, got.valid)
    assert run.delay == pytest.approx(0.1 + 0.05 / 3 * got.repeated / len(got.table), abs=1e-3)
    once = np.isin(got.table.time, run.master.time)
    late = got.table.time[once] - got.valid[once]
    low, high = limits(len(late), 1)
    clipped = 0.9733  # variance of a normal variable that is cut off at three
    assert low < np.sum((late - 0.1) ** 2) / 0.004**2 / clipped < high
    assert np.all(np.diff(got.table.time) > 0)


def test_the_master_errs_as_it_says() -> None:
    noise = MasterNoise(0.2, (3e-3, 1e-3, 2e-3), 5.0)
    run = simulate_transfer(SHORT, rate=50.0, noise=noise, seed=3)
    then = run.motion.trajectory(run.received.valid)
    m = run.master
    away = displacement(then.latitude, then.longitude, then.height,
                        m.latitude, m.longitude, m.height)  # fmt: skip
    off = turned(m.angles - angles_of(then.C_nb))
    low, high = limits(3 * len(m), 3)
    for e in ((m.velocity_n - then.velocity_n) / 0.2, off / noise.attitude, away / 5.0):
        assert low < np.sum(e**2) < high
    slow = MasterNoise(0.0, (0.0,) * 3, 0.0, 0.3, (4e-3,) * 3, wander_time=1e5)
    run = simulate_transfer(SHORT, rate=50.0, noise=slow, seed=3)
    e = run.master.velocity_n - run.motion.trajectory(run.received.valid).velocity_n
    assert np.std(e, axis=0).max() < 0.05 < np.abs(e.mean(axis=0)).max()


def test_the_errors_of_the_slave_are_those_of_its_model() -> None:
    slave = draw_slave(np.random.default_rng(1), slave=Slave(lever_m=ARM))
    quiet = replace(slave, noise=ImuNoise())
    clean = simulate_transfer(SHORT, rate=50.0, slave=replace(quiet, model=Slave().model)).log
    seen = simulate_transfer(SHORT, rate=50.0, slave=quiet).log
    accel, gyro = slave.model.measure(clean.accel, clean.gyro)
    np.testing.assert_allclose(seen.accel, accel, rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen.gyro, gyro, rtol=0, atol=1e-14)
    noisy = simulate_transfer(SHORT, rate=50.0, slave=slave).log
    for triad in ("accel", "gyro"):
        white = getattr(slave.noise, triad).white * np.sqrt(50.0)
        e = (getattr(noisy, triad) - getattr(seen, triad)) / white
        low, high = limits(e.size, 2)
        assert low < np.sum(e**2) < high


def test_slaves_are_drawn_as_their_grade_says() -> None:
    rng = np.random.default_rng(8)
    grade = turn_on_grade()
    drawn = [draw_slave(rng) for _ in range(100)]
    low, high = limits(300, 4)
    for group, sd in grade.spread.items():
        names = [LAYOUT.names[i] for i in LAYOUT.group(group)]
        values = np.array([s.model.coefficients(names).values for s in drawn])
        assert low < np.sum((values / sd) ** 2) < high
    assert low < np.sum((np.array([s.mu for s in drawn]) / (5 * ARCMIN)) ** 2) < high
    assert np.degrees(grade.spread["gyro.bias"]) * 3600 == pytest.approx(2.4)


def test_the_barometer_wanders_about_the_height() -> None:
    air = Barometer(white=0.0, wander=3.0, correlation_time=1e6)
    run = simulate_transfer(SHORT, rate=50.0, barometer=air, seed=1)
    off = run.barometer - run.truth.height
    assert 0.01 < abs(off.mean()) < 12.0 and np.std(off) < 0.2
    noisy = simulate_transfer(SHORT, rate=50.0, barometer=Barometer(0.5, 0.0), seed=1)
    e = (noisy.barometer - noisy.truth.height) / 0.5
    low, high = limits(len(e), 1)
    assert low < e @ e < high


def test_one_seed_makes_the_same_bits_and_each_chance_has_its_own() -> None:
    def run(seed: int, **changes):
        slave = draw_slave(np.random.default_rng(3), slave=Slave(lever_m=ARM, **changes))
        return simulate_transfer(SHORT, rate=50.0, slave=slave, seed=seed)

    a, again, other = run(1), run(1), run(2)
    bent = run(1, flexure=Flexure((1e-3,) * 3, 1.0))
    for one, two in ((a.log.gyro, again.log.gyro), (a.log.accel, again.log.accel),
                     (a.master.velocity_n, again.master.velocity_n),
                     (a.barometer, again.barometer)):  # fmt: skip
        np.testing.assert_array_equal(one, two)
    assert not np.array_equal(a.log.gyro, other.log.gyro)
    np.testing.assert_array_equal(a.master.velocity_n, bent.master.velocity_n)
    np.testing.assert_array_equal(a.barometer, bent.barometer)
    assert np.std(bent.log.gyro - a.log.gyro) < 0.01
    with pytest.raises(ValueError, match="read-only"):  # shared between runs
        a.carried.dvel_m[0] = 0.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Link(rate=0.0), "`link rate` is 0.0; it has to be above zero"),
        (lambda: Link(delay=-0.1), "`link delay` is -0.1"),
        (lambda: Link(rate=20.0, jitter=0.01), "from 0 to 0.005 s, a tenth of the interval"),
        (lambda: Link(stamped="sent"), '"arrival", "validity" or "both"'),
        (lambda: Link(lost=1.0), "`link lost` is 1.0"),
        (lambda: Flexure((1e-3,) * 3, 0.0), "`flexure correlation_time` is 0.0"),
        (lambda: Slave(2 * np.eye(3)), "orthonormal and right-handed"),
        (lambda: simulate_transfer(SHORT, rate=0.01), "`rate` is 0.01"),
        (lambda: simulate_transfer(SHORT, rate=50.0, slave=Slave(vibration=Vibration(1.0))),
         "below 25 Hz, half of the rate"),
    ],
)  # fmt: skip
def test_numbers_that_cannot_be_are_refused(make, words: str) -> None:
    with refuses("transfer_plan.value") as caught:
        make()
    assert words in str(caught.value)


def test_a_start_far_away_closes_too() -> None:
    run = simulate_transfer(replace(SHORT, start=replace(START, latitude=-80 * DEG)),
                            rate=100.0, slave=Slave(TURNED, MU, ARM))  # fmt: skip
    assert missed(run)[0] < 1e-4


def test_gravity_that_is_not_normal_is_felt():
    with_it, without = (
        simulate_transfer(SHORT, rate=50.0, slave=Slave(TURNED), gravity_offset=a, seed=4)
        for a in (1e-3, 0.0)
    )
    more = with_it.log.accel - without.log.accel
    np.testing.assert_allclose(np.linalg.norm(more, axis=1), 1e-3, rtol=1e-4)
    C_nm = without.carried.truth.C_nb[:-1]
    up_s = (C_nm @ TURNED)[:, 2]
    assert (np.einsum("ij,ij->i", more[: len(up_s)], up_s) > 0.99e-3).all()
