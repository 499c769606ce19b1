"""Scatter of steps on a rate table: of the rate and of the bias, each found for what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.consistency import nees
from foucault.estimate import gauss_newton
from foucault.estimate.rate_table.likelihood import State, Trust, build, drift_root, fit
from foucault.estimate.rate_table.scatter import fit_scatter
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.procedures.rate_table import Settings, from_readings, names_of
from make_rates import LATITUDE, make_readings, make_steps

NAMES = names_of(Settings())
KNOWN = Trust(latitude=LATITUDE)
HOUR = np.radians(1 / 3600)
NOISE = 1.5 * HOUR


def session(seed, drift=None, jitter=0.0):
    """Steps with white noise, a drift(rng, time) [rad/s] and a scatter of the rate."""
    steps, rng = make_steps(sd=NOISE), np.random.default_rng(seed)
    gyro = steps.gyro * (1 + jitter * rng.normal(size=(len(steps), 1)))
    gyro = gyro + NOISE * rng.normal(size=gyro.shape)
    if drift is not None:
        gyro = gyro + drift(rng, steps.middle)
    return replace(steps, gyro=gyro)


def line(size):
    half = make_steps().half_time
    return lambda rng, t: size * ((t - half) / np.ptp(t))[:, None] * np.ones(3)


def markov(sd, tau=300.0):
    def made(rng, t):
        alike = np.exp(-np.abs(t[:, None] - t) / tau)
        return sd * np.linalg.cholesky(alike) @ rng.normal(size=(len(t), 3))

    return made


def steps_apart(sd):
    return lambda rng, t: sd * rng.normal(size=(len(t), 3))


def found(steps):
    trust = fit_scatter(steps, NAMES, KNOWN)
    _, estimate = fit(steps, NAMES, trust)
    return trust, estimate


def test_derivatives_by_a_bias_that_moves():
    steps = make_steps(sd=1e-5)
    for time in (300.0, np.inf):
        trust = replace(KNOWN, bias_sd=1e-4, bias_time=time)
        n = len(steps)
        drift = np.random.default_rng(1).normal(size=(n, 3))
        state = State(ImuModel(), 0.0, 0.0, np.zeros((6, 2)), drift)
        problem = build(steps, NAMES, trust, start=state)
        at = problem.linearise(state, np.ones(n))
        step = np.random.default_rng(2).normal(size=at.jacobian.shape[1])
        step[: len(NAMES)] *= 1e-6
        moved = problem.linearise(problem.retract(state, step), np.ones(n)).residuals
        np.testing.assert_allclose(at.residuals - moved, at.jacobian @ step, atol=1e-5)


def test_the_covariance_of_a_bias_that_moves():
    steps = make_steps()
    root = drift_root(steps, Trust(bias_sd=2e-6, bias_time=300.0))
    apart = np.abs(steps.middle[:, None] - steps.middle)
    np.testing.assert_allclose(root @ root.T, 4e-12 * np.exp(-apart / 300.0), atol=1e-19)
    root = drift_root(steps, Trust(bias_sd=2e-6, bias_time=np.inf))
    x = steps.middle - np.sum(steps.time) / 2
    np.testing.assert_allclose(root @ root.T, 4e-12 * np.outer(x, x) / np.mean(x**2), atol=1e-24)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "drift", [None, line(10 * HOUR), line(100 * HOUR), markov(10 * HOUR), steps_apart(10 * HOUR)],
    ids=["none", "line of 10 deg/h", "line of 100 deg/h", "Gauss-Markov", "each step"],
)  # fmt: skip
def test_errors_have_the_size_that_is_promised(drift):
    """True is the bias that the movement is about, and no other error at all."""
    ratio = []
    for seed in range(8):
        _, estimate = found(session(seed, drift))
        c = estimate.coefficients
        ratio.append(nees(c.values[None], c.cov)[0] / len(NAMES))
    # The sd of the mean of eight is 0.12 where all is known.
    assert 0.65 < np.mean(ratio) < 1.4


@pytest.mark.thorough
def test_neither_scatter_takes_the_part_of_the_other():
    jitter = np.array([
        [t.rate_jitter * 1e6, t.bias_sd / HOUR]
        for t in (found(session(k, jitter=5e-5))[0] for k in range(4))
    ])  # fmt: skip
    assert (np.abs(jitter[:, 0] - 50) < 20).all()
    assert not jitter[:, 1].any()
    bias = [found(session(k, steps_apart(10 * HOUR)))[0] for k in range(4)]
    assert not any(t.rate_jitter for t in bias)
    assert np.mean([t.bias_sd for t in bias]) == pytest.approx(10 * HOUR, rel=0.2)
    both = [found(session(k, markov(10 * HOUR), 1e-4))[0] for k in range(4)]
    assert all(5e-5 < t.rate_jitter < 2e-4 for t in both)
    assert all(4 * HOUR < t.bias_sd < 25 * HOUR for t in both)


def test_a_bad_step_is_no_scatter():
    steps = session(1)
    steps.gyro[8, 0] += 200 * HOUR
    trust, estimate = found(steps)
    assert trust == KNOWN
    assert estimate.weights[8] < 0.1


def test_a_bias_that_moves_is_told_in_words_and_doubted_where_it_is_large():
    def result(size):
        readings = make_readings(session(3, line(size)))
        return from_readings(readings, Settings(), told=True, site=Site.at(LATITUDE))

    small, large = result(10 * HOUR), result(100 * HOUR)
    assert small.verdict.level == "pass"
    assert large.verdict.level == "doubtful"
    for r in (small, large):
        told = next(f for f in r.findings if f.code == "rate_table.bias_moved")
        assert "along a straight line, and is that of the middle of the session" in told.message
        assert r.diagnostics["bias_drift"]["kind"] == "line"
        assert r.diagnostics["rate_scatter"] == 0
        total = np.sum(list(r.diagnostics["budget"].values()), axis=0)
        np.testing.assert_allclose(total, r.coefficients.sd**2, rtol=1e-6)
        assert "bias drift" in r.diagnostics["budget"]
    assert "times the noise of a step: let the gyros warm up" in " ".join(large.verdict.reasons)
    assert np.abs(large.coefficients["gyro.scale"].values).max() < 1e-3
    still = from_readings(make_readings(session(3)), Settings(), told=True, site=Site.at(LATITUDE))
    assert still.diagnostics["bias_drift"] == {"sd": 0.0, "kind": "none"}
    assert not still.findings


def test_squares_and_robust_find_the_same_where_nothing_is_bad():
    steps = session(4, markov(10 * HOUR))
    one = fit_scatter(steps, NAMES, KNOWN)
    other = fit_scatter(steps, NAMES, KNOWN, loss=gauss_newton.least_squares)
    assert one.bias_sd == pytest.approx(other.bias_sd, rel=0.1)
