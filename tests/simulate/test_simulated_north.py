"""A simulated north seeker against the published equations, and its noise against its law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, mean_variance
from foucault.models.north_seeker import SEEKER, Compensation, earth_rate_b, up_b
from foucault.simulate.noise import mean_noise
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    Rotation,
    SeekerErrors,
    Stops,
    simulate_north,
)

SITE = Site.at(np.radians(29.5))
FOUR = Stops(np.radians([0.0, 180.0, 90.0, 270.0]), np.full(4, 60.0), 5.0)
ATTITUDES = [(0.3, 0.0, 0.0), (2.0, 0.17, 0.17), (4.4, -0.17, 0.14), (5.9, 0.9, -1.1)]
PLAN = NorthPlan(tuple(Placement(f"M{i}", *a) for i, a in enumerate(ATTITUDES)), FOUR)
QUIET = ImuNoise()


def simulated(plan=PLAN, model=None, noise=QUIET, **words):
    return simulate_north(plan, model=model or ImuModel(), noise=noise, site=SITE, **words)


def published(heading, pitch, roll, L):
    """Equations (6) to (11) as printed: rate over the Earth's, and gravity over g."""
    sf, cf, st, ct, sg, cg = (
        f(x) for x in (heading, pitch, roll) for f in (np.sin, np.cos)
    )  # fmt: skip
    sl, cl = np.sin(L), np.cos(L)
    wx = -cg * sf * cl + sg * st * cf * cl - sg * ct * sl
    wy = ct * cf * cl + st * sl
    return wx, wy, sg * ct, -st


@pytest.mark.parametrize(("i", "attitude"), list(enumerate(ATTITUDES)))
def test_it_reads_what_the_published_equations_say(i, attitude):
    log = simulated().log
    mine = log.setup == i
    wx, wy, ax, ay = published(*attitude, SITE.latitude)
    said = np.array([wy, -wy, wx, -wx]) * EARTH_RATE
    np.testing.assert_allclose(log.gyro[mine], said, atol=1e-12 * EARTH_RATE)
    force = -np.array([ay, -ay, ax, -ax]) * SITE.gravity  # specific force is minus gravity
    np.testing.assert_allclose(log.accel[mine, 0], force, atol=1e-11)
    case = simulated(accel="case").log
    np.testing.assert_allclose(case.accel[mine], np.tile([-ax, -ay], (4, 1)) * SITE.gravity,
                               atol=1e-11)  # fmt: skip
    assert simulated(accel=None).log.accel is None


def test_its_errors_are_those_of_the_model_that_is_estimated():
    rng = np.random.default_rng(3)
    values = 1e-3 * rng.standard_normal(len(SEEKER))
    vector = CoefficientVector(SEEKER, values * np.where(["bias" in n for n in SEEKER.names],
                                                         1e-3, 1.0))  # fmt: skip
    errors = SeekerErrors(gyro_offset=2e-6, gyro_drift=3e-10, accel_offset=1e-3)
    log = simulated(model=ImuModel.from_coefficients(vector), errors=errors).log
    heading, pitch, roll = np.array(ATTITUDES).T
    w_b = earth_rate_b(heading, pitch, roll, np.array(SITE.latitude))
    four = Compensation(vector).predict(w_b, SITE.gravity * up_b(pitch, roll))[log.setup]
    s, c = np.sin(log.index), np.cos(log.index)
    gyro = s * four[:, 0] + c * four[:, 1] + 2e-6 + 3e-10 * (log.time + 30.0)
    np.testing.assert_allclose(log.gyro, gyro, rtol=0, atol=1e-16)
    accel = s * four[:, 2] + c * four[:, 3] + 1e-3
    np.testing.assert_allclose(log.accel[:, 0], accel, atol=1e-13)


def test_samples_average_to_means():
    errors = SeekerErrors(gyro_offset=2e-6, gyro_drift=3e-10, index_sd=1e-3, heading_sd=1e-3)
    means = simulated(errors=errors, seed=4)
    samples = simulated(errors=errors, rows="samples", seed=4, rate=2.0)
    np.testing.assert_array_equal(samples.index_err, means.index_err)
    assert samples.log.averaged is None and len(samples.log) == 4 * 2 * 255
    for k, start in enumerate(means.log.time):
        rows = (samples.log.time >= start) & (samples.log.time < start + 60.0)
        assert rows.sum() == 120
        # Samples are instantaneous: their mean time is half an interval before the middle.
        mean = samples.log.gyro[rows].mean() + errors.gyro_drift * 0.25
        assert mean == pytest.approx(means.log.gyro[k], abs=1e-16)
    assert samples.log.interval == 0.5 and samples.log.rate == 2.0


def test_a_turning_base_and_what_it_cannot_be():
    plan = NorthPlan(PLAN.setups[1:2], Rotation(2.0, -0.1))
    log = simulated(plan, rows="samples", rate=4.0).log
    assert log.duration == pytest.approx(4 * np.pi / 0.1, abs=0.5)
    wx, wy, _, _ = published(*ATTITUDES[1], SITE.latitude)
    said = EARTH_RATE * (wx * np.sin(-0.1 * log.time) + wy * np.cos(-0.1 * log.time))
    np.testing.assert_allclose(log.gyro, said, atol=1e-12 * EARTH_RATE)
    with pytest.raises(FoucaultError, match=r'no stops to write one mean of.*rows = "samples"'):
        simulated(plan, rows="means")
    with pytest.raises(FoucaultError, match="The latitude is not given"):
        simulate_north(PLAN, model=ImuModel(), noise=QUIET, site=Site(9.8))


def test_truth_and_seed():
    noise = ImuNoise(TriadNoise(white=1e-4), TriadNoise(white=1e-6))
    one, same, other = (simulated(noise=noise, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.log.gyro, same.log.gyro)
    assert (one.log.gyro != other.log.gyro).all()
    truth = one.truth_json()
    assert truth["heading"] == [a[0] for a in ATTITUDES] and truth["setups"][2] == "M2"
    assert simulated(reference=False).log.heading is None


# -- noise ---------------------------------------------------------------------------------

COLOURED = TriadNoise(white=2.0, bias_instability=0.7, correlation_time=50.0, random_walk=0.05)


def test_means_have_the_covariance_of_the_process():
    """Rows 1 and 3 of three means with pauses, against integrals of the covariance function."""
    start, length = np.array([0.0, 40.0, 200.0]), np.array([30.0, 0.2, 60.0])
    n = 20_000
    drawn = np.array(mean_noise(COLOURED, start, length, 0.1, n, np.random.default_rng(5)))
    want = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b = (start[k] + (np.arange(400) + 0.5) / 400 * length[k] for k in (i, j))
            lag, first = np.abs(a[:, None] - b), np.minimum(a[:, None], b)
            both = 0.49 * np.exp(-lag / 50.0) + 0.05**2 * first
            want[i, j] = both.mean() + (4.0 / length[i] if i == j else 0.0)
    L = np.linalg.cholesky(want)
    white = np.linalg.solve(L, drawn)
    np.testing.assert_allclose(
        [mean_variance(COLOURED, length[:1], 0.0)[0]], want[:1, 0], rtol=1e-4
    )
    # 3 variances and 3 covariances of unit normals, two-sided, 1 % in all.
    p = 0.01 / 6
    low, high = stats.chi2.ppf([p / 2, 1 - p / 2], n)
    for k in range(3):
        assert low < white[k] @ white[k] < high
        other = white[k] @ white[(k + 1) % 3] / np.sqrt(n)
        assert abs(other) < stats.norm.ppf(1 - p / 2)


def test_short_steps_join_smoothly():
    """The series of short steps and the closed form are one law."""
    tau = TriadNoise(bias_instability=1.0, correlation_time=1.0)
    for x in (1e-6, 0.0099, 0.0101, 3.0):
        n = 100_000
        drawn = mean_noise(tau, np.array([0.0, x]), np.full(2, x), 0.1, n, np.random.default_rng(6))
        rise = drawn[1] - drawn[0]
        exact = 2 * mean_variance(tau, np.array([x]), 0.0)[0] - 2 * (np.expm1(-x) / x) ** 2
        if x < 1e-3:
            exact = 2 * x * (2 / 3)  # the difference of means of a short random walk
        low, high = stats.chi2.ppf([0.00125, 0.99875], n)
        assert low < rise @ rise / exact < high


def test_noise_of_samples_and_rounding():
    gyro = TriadNoise(white=1e-6, quantisation=3e-6)
    noise = ImuNoise(TriadNoise(white=1e-3), gyro)
    one = simulated(noise=noise, rows="samples", rate=10.0).log
    true = simulated(rows="samples", rate=10.0).log
    steps = one.gyro / 3e-6
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    n = len(one)
    left = (one.accel - true.accel)[:, 0] / (1e-3 * np.sqrt(10.0))
    low, high = stats.chi2.ppf([0.005, 0.995], n)
    assert low < left @ left < high
