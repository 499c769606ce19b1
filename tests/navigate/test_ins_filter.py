"""The error-state filter: its estimates and covariances against least squares and the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.diagnose.study import nees
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import displaced, displacement, east_north_up
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.ins_errors import STATES, Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.ins_filter import Updates, run, spread, start_cov
from foucault.navigate.strapdown import navigate, states_of
from foucault.plans.manoeuvres import Start
from make_ins import (
    DEG,
    FLIGHT,
    SITE,
    at_rest,
    chained,
    errors,
    increments,
    made,
    off,
    still,
    tumble,
    unit,
    with_one,
)

NOISE = ImuNoise(accel=TriadNoise(white=5e-5), gyro=TriadNoise(white=1e-6))
STAND = Start(*SITE, heading=0.4, pitch=0.03, roll=-0.05)
NONE = Sensors.of(())


def linear_problem(seed=1):
    """Rests and turns with start errors so small that all is linear."""
    rng = np.random.default_rng(seed)
    motion, time, state = made(tumble(8.0), STAND, rate=50)
    sensors = Sensors.of(("gyro.bias", "accel.bias", "accel.scale"))
    sd = 1e-3 * np.concatenate([
        [1e-4] * 3, [1e-2] * 3, [1e-1] * 3, [1e-6] * 3, [1e-3] * 3, [1e-4] * 3
    ])  # fmt: skip
    P0 = np.diag(sd**2)
    model = ImuModel.from_coefficients(_vector(sensors, sd[9:] * rng.standard_normal(9)))
    log = increments(motion, time, model)
    rows = np.arange(25, len(time), 25)
    updates = still(rows, 1e-5, 1e-4, rng)
    updates.sd[1::3, :3] = np.inf
    updates.sd[::2, 3:] = np.inf
    return log, off(state, sd[:9] * rng.standard_normal(9)), sensors, updates, P0


def _vector(sensors, values):
    from foucault.coefficients import CoefficientVector

    return CoefficientVector(sensors.layout, np.asarray(values, float))


def test_without_process_noise_it_is_least_squares():
    log, state, sensors, updates, P0 = linear_problem()
    found = run(log, state, sensors, updates, P0, ImuNoise())
    free = run(log, state, sensors, Updates.none(updates.rows), 0 * P0, ImuNoise(), keep=True)
    F = np.concatenate([chained(free.transitions), np.zeros((len(updates), 9, 18))], axis=1)
    F[:, 9:, 9:] = np.eye(9)
    # What was measured of the errors of the free run, row by row.
    H, z, R = [], [], []
    for k, x in enumerate(free.trajectory.history):
        seen = np.flatnonzero(np.isfinite(updates.sd[k]))
        v, d = _measured_error(x, updates, k)
        H.append(F[k, 3 + seen])
        z.append(np.append(v, d)[seen])
        R.append(updates.sd[k, seen] ** 2)
    H, z, R = np.concatenate(H), np.concatenate(z), np.concatenate(R)
    information = np.linalg.inv(P0) + H.T @ (H / R[:, None])
    cov = np.linalg.inv(information)
    x = F[-1] @ cov @ H.T @ (z / R)
    cov = F[-1] @ cov @ F[-1].T
    sd = np.sqrt(np.diag(cov))
    assert np.max(np.abs(found.cov - cov) / np.outer(sd, sd)) < 1e-5
    got = errors(free.trajectory.history[-1:], found.trajectory.history[-1:])[0]
    got = np.append(got, found.coefficients[-1])
    # Hundreds of sds were found, by transitions that are right to 1e-5.
    assert np.max(np.abs(x) / sd) > 100
    assert np.max(np.abs(got - x) / sd) < 1e-2


def _measured_error(x, updates, k):
    """Computed minus measured velocity and position of a state, in l."""
    at = states_of(x[None])
    C_nl = at["C_nl"][0]
    v = at["velocity_n"][0] - updates.velocity_n[k]
    d = -displacement(float(at["latitude"][0]), float(at["longitude"][0]), float(at["height"][0]),
                      *updates.position[k])  # fmt: skip
    return C_nl.T @ v, C_nl.T @ d


@pytest.mark.thorough
@pytest.mark.parametrize("name", LAYOUT.names)
def test_one_coefficient_comes_back(name):
    """Noise-free: an injected error is found, as large as it is and with its sign."""
    log, state, updates = ONE
    motion, time = MOTION
    value = 3 * unit(name)
    log = increments(motion, time, with_one(name, value))
    sensors = Sensors.of((name,))
    P0 = start_cov(np.diag([1e-8] * 3), 1e-4, 1e-3, np.array([10 * value]))
    found = run(log, state, sensors, updates, P0, QUIET)
    assert found.estimate.values[0] == pytest.approx(value, rel=3e-3)


QUIET = ImuNoise(accel=TriadNoise(white=1e-7), gyro=TriadNoise(white=1e-9))


def _tumbled():
    motion, time, state = made(tumble(4.0, 0.8), STAND)
    updates = still(np.arange(50, len(time), 50), 1e-5, 1e-4)
    return (motion, time), (None, state, updates)


MOTION, ONE = _tumbled()


@pytest.mark.parametrize("i", range(9))
def test_one_start_error_comes_back(i):
    """Attitude, velocity and position: what is fed back is the error, with its sign."""
    (motion, time), (_, state, updates) = MOTION, ONE
    e = np.repeat([1e-4, 1e-2, 1.0], 3)[i] * np.eye(9)[i]
    P0 = np.diag(np.repeat([1e-3, 0.1, 10.0], 3) ** 2)
    found = run(increments(motion, time), off(state, e), NONE, updates, P0, QUIET)
    truth = motion.trajectory(time[updates.rows[-1:]]).state(0).packed()
    left = errors(found.trajectory.history[-1:], truth[None])[0]
    assert np.all(np.abs(left) < np.array([1e-7] * 2 + [1e-5] + [1e-6] * 3 + [1e-5] * 3))
    if i > 2:  # these are seen at once; so many of them are found by the first measurement
        assert found.corrections[0, i] == pytest.approx(e[i], rel=0.02)


@pytest.mark.parametrize("k", range(6))
def test_each_measurement_has_its_sign(k):
    """One component measured, all else unknown: the state goes to what was measured."""
    log, state = at_rest(1)
    updates = Updates.none(np.array([20]))
    updates.position[:] = SITE
    updates.sd[0, k] = 1e-4
    d = np.zeros(3)
    d[k % 3] = 0.5
    if k < 3:
        updates.velocity_n[0] = d
    else:
        updates.position[0] = displaced(*SITE, d)
    found = run(log, state, NONE, updates, np.diag([0.0] * 3 + [1.0] * 6), ImuNoise())
    end = found.trajectory.state(-1)
    moved = displacement(*SITE, end.latitude, end.longitude, end.height)
    got = np.append(end.velocity_n, moved)
    assert got[k] == pytest.approx(0.5, abs=2e-3)
    assert found.measured[0] == 1


def test_a_moving_instrument_is_corrected_in_axes_of_the_place():
    """Velocity east and north after a flight that has turned frame l."""
    start = Start(80 * DEG, 0.2, 3000.0, 1.5, speed=250.0)
    motion, time, state = made(FLIGHT * 4, start, rate=20, headings="start")
    truth = motion.trajectory(time)
    rows = np.arange(100, len(time), 100)
    updates = Updates(
        rows, truth.velocity_n[rows],
        np.stack([truth.latitude, truth.longitude, truth.height], axis=-1)[rows],
        np.tile([1e-3] * 3 + [0.1] * 3, (len(rows), 1)), np.zeros(len(rows), bool),
    )  # fmt: skip
    e = np.array([1e-4, -2e-4, 3e-4, 0.1, -0.2, 0.3, 5.0, -4.0, 3.0])
    P0 = np.diag(np.repeat([1e-3, 0.3, 10.0], 3) ** 2)
    found = run(increments(motion, time), off(state, e), NONE, updates, P0, NOISE)
    end = found.trajectory.state(-1)
    np.testing.assert_allclose(end.velocity_n, truth.velocity_n[-1], rtol=0, atol=5e-4)
    place = truth.latitude[-1], truth.longitude[-1], truth.height[-1]
    assert np.abs(displacement(end.latitude, end.longitude, end.height, *place)).max() < 0.05
    C_nl = states_of(found.trajectory.history)["C_nl"][-1]
    assert abs(np.arctan2(C_nl[1, 0], C_nl[0, 0])) > 1 * DEG  # l has turned


def test_a_velocity_is_taken_in_axes_of_the_place_that_is_measured_with_it():
    """A kilometre from the pole, where a decimetre turns north by an arcminute."""
    rng = np.random.default_rng(9)
    start = Start(89.99 * DEG, 0.2, 3000.0, 1.5, speed=250.0)
    motion, time, state = made(FLIGHT, start, rate=50, headings="start")
    truth = motion.trajectory(time)
    rows = np.arange(25, len(time), 25)
    sd = np.tile([1e-3] * 3 + [0.1] * 3, (len(rows), 1))
    d = 0.1 * rng.standard_normal((len(rows), 3))
    place = displaced(truth.latitude[rows], truth.longitude[rows], truth.height[rows], d)
    # The vector is measured well; its east and north are those of the measured place.
    C_en = east_north_up(truth.latitude[rows], truth.longitude[rows])
    v_e = np.einsum("kij,kj->ki", C_en, truth.velocity_n[rows])
    v_e += 1e-3 * rng.standard_normal(v_e.shape)
    v_n = np.einsum("kji,kj->ki", east_north_up(*place[:2]), v_e)
    updates = Updates(rows, v_n, np.stack(place, axis=-1), sd, np.zeros(len(rows), bool))
    P0 = np.diag(np.repeat([1e-4, 0.1, 1.0], 3) ** 2)
    wrong = off(state, np.sqrt(np.diag(P0)) * rng.standard_normal(9))
    found = run(increments(motion, time), wrong, NONE, updates, P0, NOISE)
    assert found.nis.sum() < chi_square_limits(6 * len(rows))[1]


def test_innovations_are_white_and_as_large_as_predicted():
    rng = np.random.default_rng(5)
    model = ImuModel(gyro_bias=np.array([2e-8, -1e-8, 3e-8]), accel_bias=np.array([4e-4, 0, -3e-4]))
    log, state = at_rest(1500, model=model, noise=NOISE, seed=6)
    updates = still(np.arange(20, len(log), 20), 2e-4, 0.02, rng)
    sensors = Sensors.of(("gyro.bias", "accel.bias"))
    P0 = start_cov(np.diag([1e-3, 1e-3, 1e-2]) ** 2, 0.1, 1.0,
                   np.array([5e-8] * 3 + [5e-4] * 3))  # fmt: skip
    start = off(state, np.array([5e-4, -6e-4, 4e-3, 0.05, -0.04, 0.03, 0.5, 0.4, -0.3]))
    found = run(log, start, sensors, updates, P0, NOISE)
    low, high = chi_square_limits(found.measured.sum(), tests=7)
    assert low < found.nis.sum() < high
    e = found.innovation / np.sqrt(found.variance)
    n = len(e) - 1
    for row in e.T:  # lag one, each component
        z2 = (row[1:] @ row[:-1]) ** 2 / n
        assert z2 < chi2.ppf(0.99 ** (1 / 7), 1)
    wrong = ImuNoise(NOISE.accel, TriadNoise(white=NOISE.gyro.white / 3))
    small = replace(updates, sd=updates.sd / 1.1)
    found = run(log, start, sensors, small, P0, wrong)
    assert not low < found.nis.sum() < high


TABLE = (
    *LINEAR_LOWER[9:], *LINEAR_LOWER[:9], "accel.quadratic.x", "accel.quadratic.y",
    "accel.quadratic.z",
)  # fmt: skip
PRIOR = {"gyro.bias": 3e-7, "gyro.scale": 1e-4, "gyro.misalignment": 5e-4, "accel.bias": 2e-3,
         "accel.scale": 2e-4, "accel.misalignment": 5e-4, "accel.quadratic": 2e-5}  # fmt: skip


def tabled(seed, motion, time, state, noise):
    """33 states on a table that is turned between rests, all drawn: errors, covariance, NIS."""
    rng = np.random.default_rng([seed, 33])
    sensors = Sensors.of(TABLE)
    sd = np.empty(24)
    for name, value in PRIOR.items():
        sd[sensors.layout.group(name)] = value
    P0 = start_cov(np.diag([3e-4, 3e-4, 3e-3]) ** 2, 0.01, 0.01, sd)
    e = np.linalg.cholesky(P0) @ rng.standard_normal(33)
    model = ImuModel.from_coefficients(_vector(sensors, e[9:]))
    log = increments(motion, time, model, noise, rng)
    updates = still(np.arange(20, len(time), 20), 1e-3, 0.01, rng)
    found = run(log, off(state, e[:9]), sensors, updates, P0, noise)
    truth = motion.trajectory(time[-1:]).state(0).packed()
    left = errors(found.trajectory.history[-1:], truth[None])[0]
    return np.append(left, e[9:] - found.coefficients[-1]), found


def test_33_states_on_a_table_err_as_predicted():
    """NEES of all, of navigation and of every group of coefficients, two-sided at 1 %."""
    runs = 30
    noise = ImuNoise(accel=TriadNoise(white=5e-5), gyro=TriadNoise(white=2e-7))
    motion, time, state = made(tumble(15.0, 0.5), STAND, rate=20)
    made_ = [tabled(seed, motion, time, state, noise) for seed in range(runs)]
    left, covs = np.array([m[0] for m in made_]), np.array([m[1].cov for m in made_])
    states = Sensors.of(TABLE).states
    groups = [np.arange(33), np.arange(9), *(states.group(name) for name in PRIOR)]
    for g in groups:
        low, high = chi_square_limits(runs * len(g), tests=len(groups) + 1)
        assert low < nees(left[:, g], covs[:, g[:, None], g]).sum() < high
    total = sum(m[1].measured.sum() for m in made_)
    low, high = chi_square_limits(total, tests=len(groups) + 1)
    assert low < sum(m[1].nis.sum() for m in made_) < high
    # Every coefficient was found, and a covariance that is wrong by a quarter is seen.
    sd = np.sqrt(np.diagonal(covs, axis1=1, axis2=2)).mean(axis=0)
    assert all(np.all(sd[states.group(k)] < 0.6 * v) for k, v in PRIOR.items())
    low, high = chi_square_limits(33 * runs, tests=len(groups) + 1)
    for wrong in (covs / 1.25, covs * 1.25):
        assert not low < nees(left, wrong).sum() < high


# -- what else it can do -------------------------------------------------------------------


def test_covariance_stays_symmetric_and_positive():
    """Two hours: the vertical channel grows e times in ten minutes, and so would asymmetry."""
    log, state = at_rest(7200, rate=2, noise=NOISE)
    sensors = Sensors.of(("gyro.bias", "accel.bias"))
    P0 = start_cov(np.diag([1e-6] * 3), 0.1, 0.1, np.array([1e-7] * 3 + [1e-3] * 3))
    found = run(log, state, sensors, still(np.arange(2, len(log), 2), 1e-3, 0.01), P0, NOISE)
    sd = np.sqrt(np.diag(found.cov))
    R = found.cov / np.outer(sd, sd)
    assert np.abs(R - R.T).max() < 1e-9
    assert np.linalg.eigvalsh((R + R.T) / 2)[0] > 0


def test_the_gate_leaves_out_what_is_far_off():
    rng = np.random.default_rng(2)
    log, state = at_rest(60, noise=NOISE)
    updates = still(np.arange(20, len(log), 20), 1e-3, 0.01, rng)
    P0 = start_cov(np.diag([1e-8] * 3), 1e-2, 1e-2, np.zeros(0))
    without = replace(updates, sd=updates.sd.copy())
    without.sd[30, 1] = np.inf
    updates.velocity_n[30, 1] = 0.1
    found = run(log, state, NONE, updates, P0, NOISE, gate=5.0)
    assert found.refused == 1
    assert np.isnan(found.innovation[30, 1])
    assert found.measured[30] == 5
    other = run(log, state, NONE, without, P0, NOISE)
    np.testing.assert_array_equal(found.trajectory.history, other.trajectory.history)
    np.testing.assert_array_equal(found.cov, other.cov)
    spoilt = run(log, state, NONE, updates, P0, NOISE)
    assert spoilt.refused == 0
    assert np.abs(spoilt.trajectory.history[30] - found.trajectory.history[30]).max() > 1e-3


def test_a_restart_forgets_velocity_and_position():
    log, state = at_rest(40, noise=NOISE)
    rng = np.random.default_rng(3)
    updates = still(np.arange(20, len(log), 20), 1e-3, 0.01, rng)
    P0 = start_cov(np.diag([1e-4] * 3), 1e-2, 1e-2, np.zeros(0))
    updates.restart[20] = True
    updates.sd[20, :3], updates.sd[20, 3:] = 2e-3, 0.03
    updates.velocity_n[20] = [0.5, -0.5, 0.2]  # a jump that would spoil the attitude
    updates.position[20] = displaced(*SITE, np.array([3.0, -2.0, 1.0]))
    found = run(log, state, NONE, updates, P0, NOISE, keep=True)
    end = found.trajectory.state(20)
    np.testing.assert_allclose(end.velocity_n, updates.velocity_n[20], rtol=0, atol=1e-6)
    moved = displacement(*SITE, end.latitude, end.longitude, end.height)
    np.testing.assert_allclose(moved, [3.0, -2.0, 1.0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.sd[20, 3:9], [2e-3] * 3 + [0.03] * 3)
    assert not found.after[20][3:9, :3].any()
    assert not found.measured[20]
    np.testing.assert_array_equal(found.after[20][:3, :3], found.before[20][:3, :3])
    # Position alone: velocity goes on as it was.
    updates.sd[20, :3] = np.inf
    only = run(log, state, NONE, updates, P0, NOISE)
    assert np.abs(only.trajectory.velocity_n[20]).max() < 0.1
    assert np.isfinite(only.sd).all()


def test_coefficients_wander_and_are_forgotten():
    """A random walk spreads as q t; a Markov process settles at q tau / 2."""
    log, state = at_rest(2000, rate=1)
    rows = np.arange(1, len(log))
    sensors = Sensors.of(("gyro.bias", "accel.bias"))
    P0 = np.zeros((15, 15))
    noise = ImuNoise(gyro=TriadNoise(random_walk=1e-9))
    found = run(
        log, state, sensors, Updates.none(rows), P0, noise,
        wander={"accel.bias.z": 2e-6}, correlation_time={"accel.bias.z": 100.0},
    )  # fmt: skip
    sd = dict(zip(found.layout.names, found.sd[-1], strict=True))
    assert sd["gyro.bias.x"] == pytest.approx(1e-9 * np.sqrt(2000))
    assert sd["accel.bias.x"] == 0.0
    assert sd["accel.bias.z"] == pytest.approx(2e-6 * np.sqrt(100 / 2), rel=1e-3)
    start = np.zeros(6)
    start[sensors.layout.index("accel.bias.z")] = 1e-5
    gone = run(log, state, sensors, Updates.none(rows[:100]), P0, noise, estimate=start,
               correlation_time={"accel.bias.z": 100.0})  # fmt: skip
    assert gone.coefficients[-1].max() == pytest.approx(1e-5 / np.e)


def test_a_wandering_bias_is_followed():
    rate, n = 20, 20 * 1500 + 1
    rng = np.random.default_rng(4)
    log, state = at_rest(1500, noise=NOISE, seed=8)
    walk = 3e-6
    bias = np.cumsum(walk / np.sqrt(rate) * rng.standard_normal((n, 3)), axis=0)
    log = replace(log, dvel_b=log.dvel_b + bias / rate)
    updates = still(np.arange(rate, n, rate), 2e-4, 0.02, rng)
    sensors = Sensors.of(("accel.bias",))
    P0 = start_cov(np.diag([1e-5, 1e-5, 1e-4]) ** 2, 1e-4, 1e-3, np.array([1e-9] * 3))
    noise = ImuNoise(TriadNoise(white=5e-5, random_walk=walk), NOISE.gyro)
    low, high = chi_square_limits(6 * len(updates))
    assert low < run(log, state, sensors, updates, P0, noise).nis.sum() < high
    assert not low < run(log, state, sensors, updates, P0, NOISE).nis.sum() < high


@pytest.mark.thorough
def test_spread_is_the_scatter_of_free_runs():
    """Attitude, sensor errors and noise, half an hour: NEES of what is seen at the place."""
    rate, length, runs = 10, 1800, 200
    sensors = Sensors.of(("gyro.bias", "accel.bias"))
    log, state = at_rest(length, rate=rate)
    sd = np.array([2e-8] * 3 + [2e-4] * 3)
    P0 = start_cov(np.diag([5e-5, 5e-5, 5e-4]) ** 2, 1e-2, 1.0, sd)
    rows = np.array([600 * rate, length * rate])
    noise = ImuNoise(accel=TriadNoise(white=3e-4), gyro=TriadNoise(white=1e-6))
    cov = spread(log, state, sensors, rows, P0, noise)
    rng = np.random.default_rng(11)
    root = np.linalg.cholesky(P0)
    errs = np.empty((runs, 2, 9))
    for k in range(runs):
        e = root @ rng.standard_normal(15)
        model = ImuModel.from_coefficients(_vector(sensors, e[9:]))
        noisy, _ = at_rest(length, rate=rate, model=model, noise=noise, seed=100 + k)
        path = navigate(noisy, off(state, e[:9]))
        for j, row in enumerate(rows):
            end = path.state(row)
            d = -displacement(end.latitude, end.longitude, end.height, *SITE)
            turn = d[0] * np.tan(SITE[0]) / 6.4e6
            phi = -(end.C_nb - end.C_nb.T)
            phi = np.array([phi[2, 1], phi[0, 2], phi[1, 0]]) / 2
            phi[2] -= turn
            errs[k, j] = np.concatenate([phi, end.velocity_n, d])
    groups = {"all": range(9), "phi": range(3), "velocity": range(3, 6), "position": range(6, 9)}
    for j in range(2):
        for group in groups.values():
            g = np.array(group)
            low, high = chi_square_limits(runs * len(g), tests=8)
            one = np.broadcast_to(cov[j][np.ix_(g, g)], (runs, len(g), len(g)))
            assert low < nees(errs[:, j, g], one).sum() < high
    assert not low < nees(errs[:, 1, 6:], one / 1.3).sum() < high
    # Whatever else is asked for, the last row is the same.
    alone = spread(log, state, sensors, rows[1:], P0, noise)
    np.testing.assert_allclose(alone[0], cov[1], rtol=1e-3)


def test_held_height_is_known_to_the_covariance():
    log, state = at_rest(600, rate=10)
    sensors = Sensors.of(("accel.bias",))
    P0 = start_cov(np.diag([1e-10] * 3), 0.1, 1.0, np.array([1e-3] * 3))
    rows = np.array([len(log) - 1])
    held = spread(log, state, sensors, rows, P0, NOISE, held=True)[0]
    free = spread(log, state, sensors, rows, P0, NOISE)[0]
    assert held[8, 8] == pytest.approx(1.0)
    assert held[5, 5] < 1e-12
    assert free[8, 8] > 1e4
    np.testing.assert_allclose(held[[0, 3, 6], [0, 3, 6]], free[[0, 3, 6], [0, 3, 6]], rtol=1e-3)
    # A vertical velocity of zero says nothing of the vertical accelerometer then.
    found = run(log, state, sensors, still(np.arange(10, len(log), 10), 1e-3, np.inf), P0, NOISE,
                held=True)  # fmt: skip
    assert found.sd[-1, 9 + sensors.layout.index("accel.bias.z")] == pytest.approx(1e-3)


def test_coefficients_that_are_not_asked_for_take_no_part():
    log, state = at_rest(10)
    found = run(log, state, NONE, still(np.arange(20, 200, 20), 1e-3, 0.01), np.eye(9), NOISE)
    assert found.coefficients.shape == (9, 0)
    assert found.layout.names == STATES.names
