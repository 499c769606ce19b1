"""Biases that wander as declared: the uncertainty is that of the long-term bias."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.estimate.table import Options, TableModel, free_start
from foucault.infer.drift import by_time
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import ImuNoise, Readings, TriadNoise, slow_part
from foucault.procedures import multi_position, norm_observation, on_table, turntable
from foucault.procedures.on_table import plan as table_plan
from foucault.procedures.record import Beforehand
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors

SITE = Site(9.81, np.radians(45.0))
HOUR = np.radians(1.0) / 3600
WHITE = ImuNoise(
    accel=TriadNoise(white=2e-4),
    gyro=TriadNoise(white=np.radians(0.05) / 60),
)
NOISE = ImuNoise(
    accel=replace(WHITE.accel, bias_instability=15 * 9.80665e-6, correlation_time=300.0),
    gyro=replace(WHITE.gyro, bias_instability=3 * HOUR, correlation_time=300.0),
)
PERFECT = {"plumb_sd": 0.0, "orthogonality_sd": 0.0, "zero_sd": 0.0, "position_sd": 0.0}
BIASES = [f"{t}.bias.{a}" for t in ("accel", "gyro") for a in "xyz"]


@cache
def simulated(module, seed):
    session = module.Session(rate=10.0, **(PERFECT if module is multi_position else {}))
    return module.simulate(
        session, settings=module.Settings(), model=draw_errors("tactical", seed), noise=NOISE,
        site=SITE, seed=seed,
    )  # fmt: skip


def calibrated(module, seed, noise=NOISE, **settings):
    sim = simulated(module, seed)
    result = module.calibrate(sim.log, site=SITE, settings=module.Settings(**settings), noise=noise)
    c = result.coefficients
    return result, c.values - sim.model.coefficients(c.names).values


@pytest.mark.thorough
@pytest.mark.parametrize("module", [turntable, norm_observation, multi_position])
def test_biases_are_within_the_uncertainty_of_the_long_term_bias(module):
    sessions, nees, z, passed = 8, 0.0, [], 0
    for seed in range(sessions):
        result, error = calibrated(module, seed)
        c = result.coefficients
        nees += error @ np.linalg.solve(c.cov, error)
        z.append([error[c.names.index(b)] / c.sd[c.names.index(b)] for b in BIASES])
        passed += result.verdict.level is Level.PASS
    # Tests have false alarms: of 40 sessions one is beyond the 1 % limit of the hold-out, seed 2.
    assert passed >= sessions - 1
    assert chi2.ppf(5e-4, 21 * sessions) < nees < chi2.ppf(1 - 5e-4, 21 * sessions)
    # Biases of a triad share nothing: so many independent ones have a mean square of 1.
    n = 6 * sessions
    assert chi2.ppf(5e-4, n) < np.sum(np.square(z)) < chi2.ppf(1 - 5e-4, n)


@pytest.mark.thorough
@pytest.mark.parametrize("module", [turntable, norm_observation, multi_position])
def test_a_drift_beyond_the_declared_wander_is_told_and_the_wander_is_none(module):
    def told(log):
        result = module.calibrate(log, site=SITE, settings=module.Settings(), noise=NOISE)
        (drift,) = [c for c in result.checks if c.name == "drift"]
        return drift

    log = simulated(module, 1).log
    tau = by_time(log.time)[:, None]
    assert told(log).passed
    assert not told(replace(log, accel=log.accel * (1 + 5e-3 * tau))).passed


@pytest.mark.thorough
@pytest.mark.parametrize("solution", ["likelihood", "linear"])
def test_the_long_term_bias_is_far_less_certain_than_the_mean_of_the_session(solution):
    sd, bare = {}, {"repeatability": False, "loss": "squares"}
    for name, noise in (("slow", NOISE), ("white", WHITE)):
        result, _ = calibrated(norm_observation, 1, noise, solution=solution, **bare)
        sd[name] = result.coefficients["gyro.bias"].sd
    assert (sd["slow"] > 1.0 * HOUR).all()
    assert (sd["white"] < 0.4 * HOUR).all()


@pytest.mark.thorough
def test_the_budget_names_what_wanders():
    result, _ = calibrated(norm_observation, 1)
    budget = result.diagnostics["budget"]
    at = result.coefficients.names.index("gyro.bias.x")
    assert budget["wandering gyro bias"][at] > 0.9 * result.coefficients.sd[at] ** 2
    whole = np.sum(list(budget.values()), axis=0)
    np.testing.assert_allclose(whole, result.coefficients.sd**2, rtol=1e-6)


@pytest.mark.thorough
def test_preflight_foretells_the_long_term_bias():
    result, _ = calibrated(norm_observation, 1)
    foreseen = table_plan.foresee(
        norm_observation.task_of(norm_observation.Settings()),
        Beforehand(norm_observation.Settings(), norm_observation.Session(rate=10.0), SITE, NOISE),
    )
    ratio = result.coefficients.sd / foreseen.coefficients.sd
    assert ratio.max() < 1.2
    assert ratio.min() > 0.8


def test_what_wanders_is_shared_by_the_readings_as_its_covariance_says():
    r = simulated(norm_observation, 1)
    task = norm_observation.task_of(norm_observation.Settings())
    readings = on_table.read_positions(r.log, task, NOISE)
    start = free_start(readings, SITE, True)
    model = TableModel(readings, SITE, start, Options(LINEAR_LOWER, True, True))
    named = {s.name: s for s in model.sources}
    n = len(readings)
    for name, want, own in zip(
        ("accelerometer", "gyro"), readings.wander(), (model.kind < 2, model.kind >= 2),
        strict=True,
    ):  # fmt: skip
        shared = named[f"wandering {name} bias"].shared
        assert not shared[~own].any()
        body = np.einsum("kji,kjc->kic", model.axes[own], shared[own])
        j = model.rows[own] % n
        got = np.einsum("kic,ljc->kilj", body, body)
        np.testing.assert_allclose(
            got, np.einsum("kl,ij->kilj", want[np.ix_(j, j)], np.eye(3)), atol=1e-9 * want.max()
        )


def test_only_what_is_declared_ties_readings_together():
    assert slow_part(WHITE) is None
    slow = slow_part(replace(NOISE, accel=WHITE.accel))
    assert slow.gyro == replace(NOISE.gyro, white=0.0)
    n = 3
    r = Readings(
        np.zeros((n, 3)), np.zeros(n), np.zeros(n), 100.0 * np.arange(n), np.full(n, 60.0),
        np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)),
    )  # fmt: skip
    both = r.with_noise(NOISE)
    accel, gyro = both.wander()
    np.testing.assert_allclose(np.diag(accel) + WHITE.accel.white**2 / 60, both.accel_cov[:, 0, 0])
    assert 0.5 < gyro[0, 1] / gyro[0, 0] < 0.9
    quick = both.without_wander()
    np.testing.assert_allclose(quick.gyro_cov[:, 0, 0], WHITE.gyro.white**2 / 60)
    assert r.with_noise(WHITE).wander() == (None, None)
    assert replace(both, gyro=None).wander()[1] is None


@pytest.mark.thorough
def test_a_correlation_time_of_days_is_no_failure():
    slow = replace(NOISE.gyro, correlation_time=1e9)
    result, _ = calibrated(norm_observation, 1, replace(NOISE, gyro=slow))
    np.testing.assert_allclose(result.coefficients["gyro.bias"].sd, 3 * HOUR, rtol=0.2)
