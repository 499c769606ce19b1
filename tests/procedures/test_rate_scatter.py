"""Scatter of steps on a rate table: of the rate and of the bias, each found for what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.study import nees
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.procedures.rate_table import Settings, from_readings, names_of, solved
from foucault.procedures.rate_table.model import RateTable
from make_rates import LATITUDE, make_readings, make_steps

NAMES = names_of(Settings())
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


def found(steps, **settings):
    table = RateTable(steps, NAMES, Settings(**settings), LATITUDE)
    return solved(table, Site.at(LATITUDE), None)


def bias_of(table):
    at = table.linearise(ImuModel())
    rows = next(s for s in at.sources if s.name == "bias drift").shared
    return np.einsum("nik,mik->nm", rows, rows) / 3


def test_the_covariance_of_a_bias_that_moves():
    steps = make_steps()
    table = RateTable(steps, NAMES, Settings(), LATITUDE)
    apart = np.abs(steps.middle[:, None] - steps.middle)
    cov = bias_of(replace(table, bias_time=300.0))
    np.testing.assert_allclose(cov, np.exp(-apart / 300.0), atol=1e-8)
    x = steps.middle - np.sum(steps.time) / 2
    cov = bias_of(replace(table, bias_time=np.inf))
    np.testing.assert_allclose(cov, np.outer(x, x) / np.mean(x**2), atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "drift", [None, line(10 * HOUR), line(100 * HOUR), markov(10 * HOUR), steps_apart(10 * HOUR)],
    ids=["none", "line of 10 deg/h", "line of 100 deg/h", "Gauss-Markov", "each step"],
)  # fmt: skip
def test_errors_have_the_size_that_is_promised(drift):
    """True is the bias that the movement is about, and no other error at all."""
    ratio = []
    for seed in range(8):
        c = found(session(seed, drift)).fit.estimate.coefficients
        ratio.append(nees(c.values[None], c.cov)[0] / len(NAMES))
    # The sd of the mean of eight is 0.12 where all is known.
    assert 0.65 < np.mean(ratio) < 1.4


@pytest.mark.thorough
def test_neither_scatter_takes_the_part_of_the_other():
    jitter = [found(session(k, jitter=5e-5)) for k in range(4)]
    assert all(abs(e.scatter - 5e-5) < 2e-5 for e in jitter)
    assert not any(e.bias_sd for e in jitter)
    bias = [found(session(k, steps_apart(10 * HOUR))) for k in range(4)]
    assert not any(e.scatter for e in bias)
    assert np.mean([e.bias_sd for e in bias]) == pytest.approx(10 * HOUR, rel=0.2)
    both = [found(session(k, markov(10 * HOUR), 1e-4)) for k in range(4)]
    assert all(5e-5 < e.scatter < 2e-4 for e in both)
    assert all(4 * HOUR < e.bias_sd < 25 * HOUR for e in both)


def test_a_bad_step_is_no_scatter():
    steps = session(1)
    steps.gyro[8, 0] += 200 * HOUR
    e = found(steps)
    assert not e.scatter and not e.bias_sd
    assert e.fit.outliers.tolist() == [8]


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
    one, other = (found(steps, loss=loss) for loss in ("robust", "squares"))
    assert one.bias_sd == pytest.approx(other.bias_sd, rel=0.1)
