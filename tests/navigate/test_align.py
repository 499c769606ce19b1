"""One function for all alignments: windows, real logs of standing instruments, wrong requests."""

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.align import (
    align,
    bridge_peak,
    check_method,
    measured_errors,
    sensor_errors,
    two_vector_covariance,
    window,
)
from foucault.navigate.increments import increments_of
from foucault.navigate.inertial_frame import SensorErrors
from foucault.plans.manoeuvres import Rest, Rotate, Sway
from foucault.tables import Log
from make_alignment import (
    DPH,
    LN100_SITE,
    RING_SITE,
    attitude_error,
    ln100_log,
    moving,
    resting,
    ring_log,
    with_errors,
)
from refusals import refuses

SITE = Site.at(np.radians(47.0), 400.0)
# Of the ring laser unit, from its own log between 300 s and 600 s: validation/alignment.py.
RING_NOISE = ImuNoise(TriadNoise(white=2e-6 * 9.80665), TriadNoise(white=np.radians(0.00075) / 60))
RING_BIASES = {"gyro_bias_sd": 0.01 * DPH, "accel_bias_sd": 50e-6 * 9.80665}
SENSORS = SensorErrors(np.full(3, 4e-14), np.full(3, 1e-10))


@pytest.fixture(scope="module")
def ring():
    return increments_of(ring_log())


@pytest.mark.parametrize(("start", "end"), [(0.0, 300.0), (600.0, 899.9)])
@pytest.mark.parametrize("method", ["inertial_frame", "kalman"])
def test_a_standing_vehicle_with_people_in_it(ring, method, start, end):
    found = align(ring, RING_SITE, method=method, start=start, end=end,
                  noise=RING_NOISE, **RING_BIASES)  # fmt: skip
    assert abs(np.degrees(found.angles[0]) - 90.61) < 0.05
    assert found.start == pytest.approx(start, abs=0.011)
    assert found.time == found.end == pytest.approx(end, abs=0.011)
    limit = azimuth_from_gyro_bias(0.01 * DPH, RING_SITE.latitude)
    assert found.azimuth_bias_sd == pytest.approx(limit)
    assert limit < found.heading_sd < 1.5 * limit
    if method == "kalman" and start == 600.0:
        low, high = chi_square_limits(found.dof.sum())
        assert low < found.nis.sum() < high


def test_two_vectors_do_not_withstand_people(ring):
    noisy = align(ring, RING_SITE, method="two_vector", end=300.0, noise=RING_NOISE)
    off = abs(np.degrees(noisy.angles[0]) - 90.61)
    assert 6.5 < off < 7.5
    assert off < 3 * np.degrees(noisy.heading_sd), "and say so"
    calm = align(ring, RING_SITE, method="two_vector", start=600.0, noise=RING_NOISE)
    assert abs(np.degrees(calm.angles[0]) - 90.61) < 0.3


@pytest.mark.parametrize("method", ["two_vector", "inertial_frame", "kalman"])
def test_ln100(method):
    found = align(ln100_log(), LN100_SITE, method=method, noise=RING_NOISE, **RING_BIASES)
    # The x axis points up: pitch is that of y, and its heading the azimuth of the y axis.
    assert 7.285 < np.degrees(found.angles[0]) < 7.335
    assert abs(np.degrees(found.angles[2]) + 90) < 0.5


def test_a_window_of_the_log():
    increments, _ = resting(SITE, 100.0, 0.01, 0.0)
    part = increments[window(increments, 20.0, 60.0)]
    assert len(part) == 4000
    assert (part.time - part.dt)[0] == pytest.approx(20.0) and part.time[-1] == pytest.approx(60)
    assert len(increments[window(increments)]) == len(increments)
    for start, end in ((-1.0, 50.0), (50.0, 50.0), (60.0, 20.0), (0.0, 101.0)):
        with refuses("alignment.window", r"the log has 0 s to 100 s"):
            window(increments, start, end)


def test_a_log_of_rates_is_as_good():
    increments, C_nb = resting(SITE, 60.0, 0.01, 1.0, 0.2, -0.1)
    rates = [x / increments.dt[:, None] for x in (increments.dtheta_b, increments.dvel_b)]
    log = Log(increments.time, *rates, sampled="rate")
    for method in ("two_vector", "inertial_frame", "kalman"):
        found = align(log, SITE, method=method)
        np.testing.assert_allclose(found.C_nb, C_nb, atol=1e-7)


def test_two_positions_and_their_biases():
    plan = [Rest(100.0), Rotate("up", np.pi / 2, 0.2), Rest(100.0)]
    exact, truth = moving(plan, SITE, 10.0, heading=1.0)
    biases = np.array([[0.05, -0.05, 0.02], [0, 0, 0]]) * DPH
    made = with_errors(exact, SENSORS, np.random.default_rng(4), biases)
    words = {"gyro_bias_sd": 0.1 * DPH, "accel_bias_sd": 1e-5, "start": 0.0, "noise": ImuNoise(
        TriadNoise(white=1e-5), TriadNoise(white=2e-7))}  # fmt: skip
    rests = ((0.0, 99.0), (112.0, float(made.time[-1])))
    found = align(made, SITE, method="two_position", rests=rests, **words)
    one = align(made, SITE, method="kalman", end=99.0, **words)
    assert found.heading_sd < 0.4 * one.heading_sd
    error = found.angles[0] - (1.0 - np.pi / 2) % (2 * np.pi)
    assert abs(error) < 3 * found.heading_sd
    assert found.biases is not None
    level = [found.biases.layout.names.index(f"gyro.bias.{a}") for a in "xy"]
    sd = np.sqrt(np.diag(found.biases.cov))[level]
    assert np.all(np.abs(found.biases.values[level] - biases[0, :2]) < 3.3 * sd)
    assert np.all(sd < 0.04 * DPH)
    assert truth.C_nb[-1] == pytest.approx(found.C_nb, abs=5e-3)


def test_noise_is_measured_where_it_is_larger_than_declared():
    rng = np.random.default_rng(6)
    increments, _ = resting(SITE, 100.0, 0.1, 0.0)
    as_declared = with_errors(increments, SENSORS, rng)
    assert measured_errors(as_declared, SENSORS)[2].gyro_psd.tolist() == [4e-14] * 3
    louder = SensorErrors(np.full(3, 4e-12), np.full(3, 1e-8))
    measured = measured_errors(with_errors(increments, louder, rng), SENSORS)[2]
    # Variances with 9 degrees of freedom, six at 1 % together.
    low, high = chi_square_limits(9, tests=6)
    for seen, true in ((measured.gyro_psd, 4e-12), (measured.accel_psd, 1e-8)):
        assert np.all((low / 9 < seen / true) & (seen / true < high / 9))


@pytest.mark.thorough
def test_the_mean_of_two_vectors_holds_the_sway():
    """NEES of pitch and roll of 40 windows that end anywhere in a sway, two-sided at 1 %."""
    rng = np.random.default_rng(9)
    sway = {"angles": (0.002, 0.003, 0.002), "shift": (0.01, 0.01, 0.01), "tones": 3}
    noise = ImuNoise(TriadNoise(white=2e-4), TriadNoise(white=6e-7))
    total, trials = 0.0, 40
    for seed in range(trials):
        exact, truth = moving([Sway(140.0, 4.0, seed=seed, **sway)], SITE, 10.0, heading=0.6)
        sensors = sensor_errors(exact, noise)
        made = with_errors(exact, sensors, rng)
        end = int(rng.integers(1000, 1300))
        found = align(made, SITE, method="two_vector", end=float(made.time[end]), noise=noise)
        phi = attitude_error(found.C_nb, truth.C_nb[np.searchsorted(truth.time, found.time - 1e-6)])
        total += phi[:2] @ np.linalg.solve(found.cov[:2, :2], phi[:2])
    low, high = chi_square_limits(2 * trials)
    assert low < total < high


def test_a_quiet_rest_scatters_no_more_than_its_noise():
    increments, _ = resting(SITE, 300.0, 0.1, 0.0)
    noise = ImuNoise(TriadNoise(white=1e-5), TriadNoise(white=2e-7))
    sensors = sensor_errors(increments, noise)
    made = with_errors(increments, sensors, np.random.default_rng(1))
    found = align(made, SITE, method="two_vector", noise=noise)
    cov = two_vector_covariance(found.C_nb, SITE.latitude, SITE.gravity, *sensors.mean_cov(300.0))
    np.testing.assert_allclose(found.cov, cov, rtol=1e-12, atol=1e-30)


def test_the_peak_of_a_brownian_bridge():
    """The limit is passed by chance as often as it says: 400 windows of three axes."""
    rng = np.random.default_rng(2)
    steps = rng.normal(size=(400, 3, 2000)) * np.sqrt(4e-14 * 0.1)
    x = np.cumsum(steps - steps.mean(axis=2, keepdims=True), axis=2)
    beyond = np.any(np.abs(x).max(axis=2) > bridge_peak(np.full(3, 4e-14), 200.0, 0.2), axis=1)
    assert 0.12 < beyond.mean() < 0.24, "a little less often, as samples miss the peak"


@pytest.mark.parametrize("name", ["gyro_bias_sd", "accel_bias_sd"])
@pytest.mark.parametrize("value", [-1e-6, float("nan")])
def test_no_negative_standard_deviation(name, value):
    increments, _ = resting(SITE, 30.0, 0.1, 0.0)
    with refuses("alignment.sd", name, match="standard deviation is zero or more"):
        align(increments, SITE, **{name: value})


def test_an_unknown_method():
    with refuses("alignment.method", "Did you mean 'two_vector'"):
        check_method("two_vectors")


def test_a_gap_stops_an_alignment():
    increments, _ = resting(SITE, 60.0, 0.1, 0.0)
    keep = np.r_[0:200, 220:600]
    rates = [x[keep] / 0.1 for x in (increments.dtheta_b, increments.dvel_b)]
    log = Log(increments.time[keep], *rates, sampled="increment")
    with refuses("strapdown.gap", "Samples are missing at"):
        align(log, SITE)
    found = align(log, SITE, gaps="bridge")
    assert [f.code for f in found.findings] == ["strapdown.bridged"]


def test_too_few_samples():
    increments, _ = resting(SITE, 0.5, 0.1, 0.0)
    with refuses("alignment.too_short", match=r"0\.5 s long; at least 1 s"):
        align(increments, SITE, method="two_vector")
