"""Gauss-Newton over a tumble: equal to the dense filter, at the bound, whatever the attitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import reference
from foucault.errors import Status
from foucault.estimate import tumble as estimation
from foucault.estimate.tumble import Prior, State, Tumble
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.cluster import CONSTANTS, attitude_of
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp, log
from foucault.plans import tumble as torquing
from foucault.simulate.tumble import Acquisition, simulate_tumble
from make_cluster import ARCSEC, DEG_H, G, make_cluster

DEG = np.radians(1.0)
SITE = Site(G, 40 * DEG)
NOISE = ImuNoise(
    TriadNoise(white=1e-6 * G * np.sqrt(0.2)), TriadNoise(white=0.05 * DEG_H * np.sqrt(0.002))
)
KIND_SD = {
    "angular rate": DEG_H, "g-sensitivity": 0.5 * DEG_H, "g-squared sensitivity": 0.05 * DEG_H,
    "scale factor error": 4e-4, "misalignment": 120 * ARCSEC, "specific force": 1e-4,
    "quadratic": 1e-4,
}  # fmt: skip
SD = np.array([5 * DEG, 5 * DEG, 5 * DEG, *(KIND_SD[c.kind] for c in CONSTANTS.coefficients), 0.0])


def session(seed=0, plan=None, noise=NOISE, start=(2.0, 3.0, 5.0), block=5, latitude=40.0, **how):
    """Return a simulated tumble, its prior, the truth, and C_pn at the end."""
    site = Site(G, latitude * DEG)
    model = make_cluster(seed)
    plan = plan or torquing.PUBLISHED
    nominal = plan.start
    made = simulate_tumble(
        plan, model=model, noise=noise, site=site, start=nominal + np.array(start) * DEG,
        acquisition=Acquisition(**how), seed=seed,
    )  # fmt: skip
    log_ = made.log
    dt = np.diff(log_.time)
    tumble = Tumble(
        dt, np.ascontiguousarray(log_.gyro[:-1]), log_.accel[1:] / G, np.ones(len(dt), bool),
        earth_rate_n(site.latitude), G, NOISE.gyro.white**2,
        (NOISE.accel.white / G) ** 2 / log_.interval, np.zeros((3, 3)),
        log_.sampled == "increment", block,
    )  # fmt: skip
    prior = Prior(State(attitude_of(nominal).T, np.zeros(42)), SD)
    return tumble, prior, State(made.C_pn[0].T, model.packed(G)), made.C_pn[1]


def short(seed=3, steps=40):
    """Return a tumble of `steps` intervals at a high rate, with random errors of readings."""
    rng = np.random.default_rng(seed)
    dt = rng.uniform(0.1, 0.3, steps)
    command = np.repeat(rng.normal(0.0, 0.02, (steps // 10, 3)), 10, axis=0)
    model, start = make_cluster(seed, 50.0), exp(rng.normal(size=3))
    arms = np.array([[0.05, 0.02, 0.0], [0.01, 0.05, 0.0], [0.0, 0.03, 0.05]])
    reading, C_pn = [], start.T
    for h, c in zip(dt, command, strict=True):
        path = reference.cluster_exponential(
            model, G, C_pn, c[None], np.zeros((1, 3)), earth_rate_n(0.7), h
        )
        C_pn, f = path[-1], G * path[-1][:, 2]
        reading.append(model.read(f, model.rate(c, f), arms) / G + 0.01 * rng.normal(size=3))
    tumble = Tumble(
        dt, command, np.array(reading), np.ones(steps, bool), earth_rate_n(0.7), G, 1e-9, 1e-4, arms
    )  # fmt: skip
    return tumble, State(start, model.packed(G))


def test_every_source_adds_what_the_covariance_changes_with_it():
    tumble, at = short()
    prior = Prior(at, np.where(SD > 0, SD, 1e-2))
    fit = estimation.solve(tumble, prior)
    parts = estimation.by_source(tumble, prior, fit)
    np.testing.assert_allclose(np.sum(list(parts.values()), axis=0), fit.cov, rtol=1e-12)
    assert len(parts) == 3
    for cov in parts.values():
        assert np.linalg.eigvalsh(cov / np.outer(prior.unit, prior.unit)).min() > -1e-6

    def cov(share):
        other = replace(tumble, accel_variance=share * tumble.accel_variance)
        return estimation.linearised(other, prior, fit).cov

    found = np.diag(cov(1.01) - cov(0.99))[3:] / 0.02  # the attitude turns with what is found
    seen = np.diag(parts["white noise of accelerometers"])[3:]
    np.testing.assert_allclose(seen, found, rtol=1e-3)


@pytest.mark.thorough
def test_one_pass_is_the_dense_filter():
    tumble, at = short()
    sd = np.append(np.append([0.1, 0.2, 0.3], np.abs(make_cluster(9, 100.0).packed(G)) + 1e-6), 0.0)
    prior = Prior(at, sd)
    model = make_cluster(3, 50.0)
    x, P, C_pn = reference.cluster_error_filter(
        model, G, at.C_np.T, tumble.dt, tumble.command, tumble.reading, tumble.w_ie_n,
        tumble.gyro_psd, tumble.accel_variance, tumble.arms, sd[:45],
    )  # fmt: skip
    pass_ = estimation.look(tumble, prior, at)
    Y, scale = pass_.out[1][0], np.sqrt(np.diag(P))
    dphi = C_pn @ exp(tumble.w_ie_n * tumble.dt.sum()).T @ (Y[:, :46] @ pass_.x - Y[:, 47])
    np.testing.assert_allclose(dphi / scale[:3], x[:3] / scale[:3], atol=2e-5)
    np.testing.assert_allclose((pass_.x * sd)[3:45] / scale[3:], x[3:] / scale[3:], atol=2e-5)
    np.testing.assert_allclose(
        estimation.bound(tumble, prior, at).cov[:45, :45] / np.outer(scale, scale),
        P / np.outer(scale, scale), atol=2e-5,
    )  # fmt: skip


NAMES = ("gyro.drift.x", "gyro.drift_input.y", "gyro.torquer_scale.z", "gyro.misalignment.zx",
         "accel.quadratic.y", "accel.bias.x")  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_sensitivities_are_those_of_the_simulator(name):
    tumble, _, truth, _ = session(1, noise=ImuNoise())
    k = 3 + CONSTANTS.index(name)
    scale = np.append(SD[:45], 1.0)
    time, slopes = estimation.sensitivities(replace(tumble, block=1), truth, scale)
    plus, minus = (_simulated(truth, name, sign * 0.01 * SD[k]) for sign in (1, -1))
    differences = (plus - minus) / 0.02
    size = np.abs(differences).max()
    np.testing.assert_allclose(slopes[:, :, k] / size, differences / size, atol=5e-4)
    assert len(time) == len(differences)


def _simulated(truth, name, change):
    from foucault.coefficients import CoefficientVector
    from foucault.models.cluster import ClusterModel, angles_of, normalised

    packed = truth.constants.copy()
    packed[CONSTANTS.index(name)] += change
    vector = CoefficientVector(CONSTANTS, packed / normalised(G))
    made = simulate_tumble(
        torquing.PUBLISHED, model=ClusterModel.from_coefficients(vector), noise=ImuNoise(),
        site=SITE, start=angles_of(truth.C_np.T),
    )  # fmt: skip
    return made.log.accel[1:] / G


@pytest.mark.parametrize("block", [1, 5, 25])
def test_without_noise_the_truth_comes_back(block):
    tumble, prior, truth, C_pn = session(2, noise=ImuNoise(), block=block)
    fit = estimation.solve(tumble, prior)
    assert fit.status is Status.CONVERGED
    sd = np.sqrt(np.diag(fit.cov))[3:45]
    # What remains is the pull of the prior: the true values are up to 3 sd of it away from zero.
    miss = (fit.start.constants - truth.constants) / sd
    assert np.abs(miss).max() < 0.5
    assert np.linalg.norm(log(fit.C_np.T @ C_pn.T)) < 20 * ARCSEC


@pytest.mark.thorough
def test_errors_are_as_large_as_promised():
    """NEES of 45 over 40 sessions: a covariance that is 20 % off is found out in 99 % of cases."""
    score = []
    for seed in range(40):
        tumble, prior, truth, C_pn = session(seed)
        fit = estimation.solve(tumble, prior)
        assert fit.status is Status.CONVERGED
        error = np.concatenate([log(fit.C_np.T @ C_pn.T), truth.constants - fit.start.constants])
        score.append(error @ np.linalg.solve(fit.cov[:45, :45], error))
    low, high = chi_square_limits(45 * len(score))
    assert low < sum(score) < high


@pytest.mark.parametrize("start", [(0, 89.0, 0), (0, 90.0, 0), (0, 91.0, 0)])
def test_no_attitude_is_singular(start):
    """A start at middle = 90 deg gives what one beside it gives."""
    plan = torquing.starting(torquing.PUBLISHED, np.array(start) * DEG)
    tumble, prior, truth, C_pn = session(4, plan=plan, start=(0.0, 0.0, 0.0))
    fit = estimation.solve(tumble, prior)
    assert fit.status is Status.CONVERGED
    error = np.append(log(fit.C_np.T @ C_pn.T), fit.start.constants - truth.constants)
    z = error / np.sqrt(np.diag(fit.cov))[:45]
    assert np.abs(z).max() < np.sqrt(chi_square_limits(1, tests=3 * 45)[1])


def test_delay_is_estimated_or_tested():
    tumble, prior, _, _ = session(6, delay=0.004)
    held = estimation.solve(tumble, prior)
    late, sd = held.late
    assert abs(late - 0.004) < 5 * sd < 0.001
    free = estimation.solve(tumble, replace(prior, sd=np.append(SD[:45], 0.1)))
    assert abs(free.start.delay - 0.004) < 5 * np.sqrt(free.cov[-1, -1]) < 0.001
    good = estimation.solve(*session(6)[:2])
    assert abs(good.late[0]) < 5 * good.late[1]


def test_means_over_the_interval_are_readings_too():
    tumble, prior, truth, _ = session(7, sampled="increment")
    fit = estimation.solve(tumble, prior)
    z = (fit.start.constants - truth.constants) / np.sqrt(np.diag(fit.cov))[3:45]
    _, high = chi_square_limits(42)
    assert fit.chi_square / fit.residuals < 1.05
    assert z @ z < 3 * high
    instant = estimation.solve(replace(tumble, mean=False), prior)
    assert instant.chi_square > 1.5 * fit.chi_square or abs(instant.late[0] - 0.1) < 0.01


def test_what_squares_would_lose_is_solved_by_reflections():
    """A motion that shows little, and a prior that says nothing: squares lose all digits."""
    plan = torquing.sequence("-x", segment=300.0)
    tumble, prior, truth, _ = session(8, plan=plan)
    wide = replace(prior, sd=prior.sd * np.append(np.ones(3), np.full(43, 1e5)))
    fit = estimation.bound(tumble, wide, truth)
    assert fit.orthogonal
    assert not estimation.bound(tumble, prior, truth).orthogonal
    unit = fit.start_cov[:45, :45] / np.outer(wide.sd, wide.sd)[:45, :45]
    values = np.linalg.eigvalsh(unit)
    assert values[-1] < 1 + 1e-6  # nothing is less certain than the prior
    assert values[0] > -1e-12


def test_reflections_and_squares_agree():
    tumble, prior, _, _ = session(9)
    at = estimation.levelled(tumble, prior)
    p = estimation.look(tumble, prior, at, rows=True)
    miss, slope = prior.rows(at)
    x, cov = estimation._reflected(p.rows, miss, slope, prior.sought)
    sd = np.sqrt(np.diag(p.cov))[:45]
    np.testing.assert_allclose(x[:45] / sd, p.x[:45] / sd, rtol=1e-5, atol=2e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(cov))[:45], sd, rtol=1e-5)


def test_numbers_that_are_none_are_a_status():
    tumble, prior, _, _ = session(10)
    broken = replace(
        tumble, reading=np.where(np.arange(27000)[:, None] == 50, np.inf, tumble.reading)
    )
    fit = estimation.solve(broken, prior)
    assert fit.status is Status.NOT_FINITE
    assert np.isfinite(fit.cov).all()
    np.testing.assert_array_equal(fit.start.constants, 0.0)


def test_the_course_ends_at_the_estimate():
    tumble, prior, _, _ = session(11)
    fit = estimation.linearised(tumble, prior, estimation.solve(tumble, prior), moments=30)
    history = fit.history
    assert np.all(np.diff(history.time) > 0)
    assert history.time[-1] == pytest.approx(5400.0)
    assert np.abs(history.step[-1] / np.maximum(history.sd[-1], 1e-300))[:45].max() < 0.1
    assert np.all(history.sd[-1, 3:45] <= history.sd[0, 3:45] * (1 + 1e-9))
    np.testing.assert_allclose(history.sd[-1, 3:45], np.sqrt(np.diag(fit.cov))[3:45], rtol=1e-6)


def test_attitudes_are_those_of_the_simulation():
    tumble, _, truth, C_pn = session(12, noise=ImuNoise())
    path = estimation.attitudes(tumble, truth, np.array([0, 100, 27000]))
    np.testing.assert_allclose(path[0], truth.C_np.T, atol=1e-12)
    np.testing.assert_allclose(path[-1], C_pn, atol=1e-9)
