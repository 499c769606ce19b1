"""Simulated tumbles: two integrators, one truth; sampling, delay, lever arms and noise by law."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from foucault.kernels.cluster_motion import integrate_exponential
from foucault.models.cluster import LAYOUT, ClusterModel, angles_of
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import log as rotation_of
from foucault.plans.tumble import PUBLISHED, RATE, nominal, sequence, starting
from foucault.procedures.platform_tumble.settings import draw_printed
from foucault.simulate.tumble import Acquisition, simulate_tumble
from make_cluster import DEG_H, UG, G, make_cluster
from refusals import refuses

SITE = Site(G, np.radians(40.0))
QUIET = ImuNoise()
START = np.radians([2.0, 3.0, 5.0])
SHORT = sequence("-x +z -y", RATE, segment=60.0)
PERFECT = ClusterModel()


def simulated(plan=SHORT, model=None, noise=QUIET, start=None, seed=1, integrator="exponential",
              **how):  # fmt: skip
    return simulate_tumble(
        plan, model=make_cluster() if model is None else model, noise=noise, site=SITE,
        start=start, acquisition=Acquisition(**how), integrator=integrator, seed=seed,
    )  # fmt: skip


# -- motion --------------------------------------------------------------------------------------


def test_a_cluster_without_errors_does_what_the_plan_says():
    made, told = simulated(PUBLISHED, PERFECT), nominal(PUBLISHED, SITE.latitude)
    assert len(made.log) == 27001
    np.testing.assert_allclose(made.log.accel[::5], G * told.C_pn[:, :, 2], atol=5e-8 * G)
    np.testing.assert_allclose(made.C_pn, told.C_pn[[0, -1]], atol=5e-8)
    np.testing.assert_array_equal(made.log.gyro[:-1], told.command.repeat(5, axis=0))
    np.testing.assert_array_equal(made.log.gyro[-1], made.log.gyro[-2])
    np.testing.assert_allclose(np.diff(made.log.time), 0.2, rtol=1e-9)


@pytest.mark.thorough
def test_both_integrators_agree_over_the_published_plan():
    made = [
        simulated(PUBLISHED, start=START, integrator=name, arms=0.05 * np.eye(3))
        for name in ("exponential", "published")
    ]
    np.testing.assert_array_equal(made[0].log.gyro, made[1].log.gyro)
    apart = np.abs(made[0].log.accel - made[1].log.accel).max() / UG
    assert 0 < apart < 1e-4  # 3e-5 ug, as the source's steps and 0.2 s have been compared
    np.testing.assert_allclose(made[0].C_pn, made[1].C_pn, atol=1e-9)
    middle = np.degrees(np.abs(np.arcsin(made[1].log.accel[:, 1].clip(-G, G) / G)).max())
    assert middle > 80  # it does tumble


def test_the_published_plan_stays_away_from_the_singular_attitude():
    """With the errors and the start of the source, middle stays below about 6 deg."""
    model = draw_printed(1)
    made = simulated(PUBLISHED, model, start=START)
    C_pn = np.empty((27001, 3, 3))
    C_pn[0] = made.C_pn[0]
    integrate_exponential(
        model.packed(G), C_pn, made.log.gyro[:-1], np.zeros((27000, 3)),
        earth_rate_n(SITE.latitude), 0.2,
    )  # fmt: skip
    np.testing.assert_array_equal(C_pn[-1], made.C_pn[1])
    assert 5 < np.degrees(np.abs(angles_of(C_pn)[:, 1]).max()) < 7


@pytest.mark.thorough
def test_only_one_integrator_goes_through_the_singular_attitude():
    plan = sequence("-y", RATE, segment=1800.0)  # middle from 0 to 180 deg
    middle = nominal(plan, SITE.latitude).C_pn[900]
    assert angles_of(middle)[1] == pytest.approx(np.pi / 2)
    made, told = simulated(plan, PERFECT), nominal(plan, SITE.latitude)
    np.testing.assert_allclose(made.C_pn[1], told.C_pn[-1], atol=5e-8)
    with refuses("torquing.singular", match=r"^(899|900)\S* s after the start") as caught:
        simulated(plan, PERFECT, integrator="published")
    assert "exponential" in caught.value.cure
    # 60 deg on the side of it both are the same.
    aside = starting(plan, np.radians([60.0, 0.0, 60.0]))
    pair = [simulated(aside, integrator=name).log.accel for name in ("exponential", "published")]
    np.testing.assert_allclose(pair[0], pair[1], atol=1e-4 * UG)


# -- sampling ------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("integrator", ["exponential", "published"])
@pytest.mark.parametrize("delay", [0.0, 0.04, 0.2, 0.26, -0.1])
@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_readings_are_those_of_a_fine_log(sampled, delay, integrator):
    """Instants or means, late or early: what a log of 20 ms says at that time."""
    same = {"arms": np.array([[0.0, 0.1, 0], [0, 0, 0.2], [0.1, 0, 0]]), "start": START}
    fine = simulated(interval=0.02, **same).log.accel
    made = simulated(sampled=sampled, delay=delay, integrator=integrator, **same).log
    rows, late = np.arange(3, len(made) - 1), round(delay / 0.02)
    ends = 10 * rows - late
    if sampled == "rate":
        want = fine[ends]
    else:  # the trapezoidal rule, for a command may change within
        weights = np.array([1, *9 * [2], 1]) / 20
        want = sum(w * fine[ends - 10 + k] for k, w in enumerate(weights))
    assert made.sampled == sampled
    np.testing.assert_allclose(made.accel[rows], want, atol=5e-3 * UG)


@pytest.mark.parametrize(("sampled", "early"), [("rate", 0.14), ("increment", 0.24)])
def test_the_first_row_reaches_back_under_the_same_command(sampled, early):
    """Row 0 is read before time 0; there the log of times above 0, continued backwards."""
    fine = simulated(interval=0.02, start=START).log
    made = simulated(sampled=sampled, delay=0.14, start=START)
    cubic = np.polynomial.Polynomial
    fits = [cubic.fit(fine.time[:40], fine.accel[:40, i], 4) for i in range(3)]
    np.testing.assert_allclose(made.log.accel[0], [fit(-early) for fit in fits], atol=1e-3 * UG)
    np.testing.assert_allclose(angles_of(made.C_pn[0]), START, atol=1e-9)


def test_a_command_may_end_at_its_time():
    one = simulated(holds="from its time")
    other = simulated(holds="until its time")
    np.testing.assert_array_equal(one.log.accel, other.log.accel)
    np.testing.assert_array_equal(one.log.gyro[:-1], other.log.gyro[1:])


def test_lever_arms_feel_the_true_rate():
    model = make_cluster(2)
    arms = np.array([[0.05, 0.02, -0.03], [0.1, 0.05, 0.0], [-0.04, 0.03, 0.05]])
    made, bare = simulated(model=model, arms=arms).log, simulated(model=model).log
    rows = np.array([10, 400, 700])
    f_p, w_p = model.compensate(bare.accel[rows], bare.gyro[rows])
    want = model.read(f_p, w_p, arms) - model.read(f_p)
    np.testing.assert_allclose(made.accel[rows] - bare.accel[rows], want, atol=1e-14)
    assert np.abs(want).max() > 0.01 * UG


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_a_step_of_the_command_is_felt_while_it_is_followed(sampled):
    plan = sequence("+y -y", RATE, segment=10.0)
    arms = np.array([[0.0, 0, 0.05], [0, 0, 0], [0, 0, 0]])
    made = simulated(plan, PERFECT, arms=arms, edge=0.05, sampled=sampled).log.accel
    bare = simulated(plan, PERFECT, arms=arms, sampled=sampled).log.accel
    felt = (made - bare)[:, 0]
    at = np.flatnonzero(np.abs(felt) > 0.1 * UG)
    # At 10 s the rate changes by 0.2 deg/s: x at an arm along z, turned about y. A mean has it
    # in the row after, for the 50 ms of its 200 ms that it lasts.
    acceleration = -2 * RATE / 0.05 * 0.05
    if sampled == "rate":
        assert at.tolist() == [50]
        assert felt[50] == pytest.approx(acceleration, rel=1e-3)
    else:
        assert at.tolist() == [51]
        assert felt[51] == pytest.approx(acceleration / 4, rel=1e-3)
    late = simulated(plan, PERFECT, arms=arms, edge=0.5).log.accel - bare
    if sampled == "rate":
        assert np.flatnonzero(np.abs(late[:, 0]) > 0.1 * UG).tolist() == [50, 51, 52]


# -- noise ---------------------------------------------------------------------------------------


WHITE = ImuNoise(
    TriadNoise(white=UG * np.sqrt(0.2)), TriadNoise(white=0.05 * DEG_H * np.sqrt(2e-3))
)


@pytest.mark.thorough
@pytest.mark.parametrize("integrator", ["exponential", "published"])
def test_gyro_noise_turns_the_cluster_by_its_random_walk(integrator):
    plan = sequence("-x", RATE, segment=20.0)
    model = replace(make_cluster(), gyro_misalignment=np.zeros((3, 3)))
    still = simulated(plan, model).C_pn[1]
    off = np.array([
        rotation_of(simulated(plan, model, WHITE, seed=k, integrator=integrator).C_pn[1] @ still.T)
        for k in range(200)
    ])  # fmt: skip
    score = np.sum(off**2) / (WHITE.gyro.white**2 * 20.0)
    low, high = stats.chi2.ppf([0.0025, 0.9975], off.size)
    assert low < score < high


def test_accelerometer_noise_is_white():
    made, bare = simulated(noise=replace(WHITE, gyro=TriadNoise())), simulated()
    off = (made.log.accel - bare.log.accel) / UG  # 1 ug in samples of 0.2 s
    low, high = stats.chi2.ppf([0.0025, 0.9975], off.size)
    assert low < np.sum(off**2) < high
    off = off[1:] * off[:-1]
    assert abs(np.sum(off)) < 3 * np.sqrt(off.size)


@pytest.mark.parametrize("integrator", ["exponential", "published"])
def test_a_slow_drift_is_one_drift_of_a_session(integrator):
    """A Markov bias that hardly changes in the session: the angle grows with the time."""
    slow = ImuNoise(gyro=TriadNoise(bias_instability=DEG_H, correlation_time=1e9))
    plan = sequence("-x", RATE, segment=10.0)
    still = simulated(plan, PERFECT).C_pn[1]
    off = [
        rotation_of(simulated(plan, PERFECT, slow, seed=k, integrator=integrator).C_pn[1] @ still.T)
        for k in range(60)
    ]
    low, high = stats.chi2.ppf([0.0025, 0.9975], 180)
    assert low < np.sum(np.square(off)) / (10 * DEG_H) ** 2 < high


def test_the_published_integrator_draws_the_same_of_a_seed():
    """Its noise is its own; of the other, contracts of all procedures try it."""
    one, two = (simulated(noise=WHITE, integrator="published") for _ in range(2))
    np.testing.assert_array_equal(one.log.accel, two.log.accel)
    np.testing.assert_array_equal(one.C_pn, two.C_pn)


def test_steps_of_command_and_output():
    noise = ImuNoise(TriadNoise(quantisation=10 * UG), TriadNoise(quantisation=DEG_H))
    log = simulated(noise=noise).log
    for values, step in ((log.accel, 10 * UG), (log.gyro, DEG_H)):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-6)
    assert np.ptp(log.gyro) > 100 * DEG_H


# -- what is told --------------------------------------------------------------------------------


def test_truth_is_all_forty_five():
    made = simulated(PUBLISHED, start=START, arms=0.05 * np.eye(3), delay=0.01)
    assert made.truth.names == LAYOUT.names
    np.testing.assert_array_equal(made.truth.values[:42], make_cluster().coefficients().values)
    np.testing.assert_array_equal(made.truth.values[42:], angles_of(made.C_pn[1]))
    said = json.loads(json.dumps(made.truth_json()))
    np.testing.assert_allclose(said["attitude_start"], START, atol=1e-12)
    assert said["delay"] == 0.01
    assert said["plan"]["name"] == "published"
    assert [s["time"] for s in said["plan"]["steps"]] == pytest.approx([1800, 900, 1800, 900])
    np.testing.assert_array_equal(said["C_pn_end"], made.C_pn[1])


def test_what_cannot_be_simulated():
    with refuses("torquing.no_latitude", "latitude"):
        simulate_tumble(SHORT, model=PERFECT, noise=QUIET, site=Site(G))
    for interval in (0.3, 2.0):
        with refuses("torquing.interval", match=f"every {interval} s"):
            simulated(interval=interval)
