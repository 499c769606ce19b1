"""What a session on a table contradicts: a prior, the sign of the latitude, a steady instrument."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.diagnose.checks import reversed_earth_at_rest
from foucault.infer.drift import by_time
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.noise import grade
from foucault.procedures import norm_observation, turntable
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors

HOUR = np.radians(1.0) / 3600
MODULES = pytest.mark.parametrize("module", [norm_observation, turntable], ids=["norm", "turn"])


@cache
def simulated(module, name, seed, latitude, plan):
    return module.simulate(
        module.Session(rows="means"), settings=module.Settings(plan=plan),
        model=draw_errors(name, seed), noise=grade(name).noise,
        site=Site(9.81, np.radians(latitude), gravity_sd=0.0), seed=seed,
    )  # fmt: skip


def calibrated(
    module=norm_observation, name="tactical", seed=1, latitude=45.0, said=None, noise=True,
    plan="icosahedron 12", change=None, **more,
):  # fmt: skip
    sim = simulated(module, name, seed, latitude, plan)
    log = sim.log if change is None else change(sim.log)
    result = module.calibrate(
        log, site=Site(9.81, np.radians(latitude if said is None else said), gravity_sd=0.0),
        settings=module.Settings(plan=plan), noise=grade(name).noise if noise else None, **more,
    )  # fmt: skip
    c = result.coefficients
    error = c.values - sim.model.coefficients(c.names).values
    return result, float(error @ np.linalg.solve(c.cov, error)), sim.model


def failed(result):
    return {c.name: c.sentence for c in result.checks if not c.passed}


# -- the Earth's rate ------------------------------------------------------------------------------


@pytest.mark.thorough
@MODULES
@pytest.mark.parametrize("latitude", [20.0, 45.0])
@pytest.mark.parametrize("noise", [True, False], ids=["declared", "unknown"])
def test_mems_gyros_tell_a_latitude_of_the_wrong_sign(module, latitude, noise):
    for seed in range(3 if noise else 1):
        wrong, *_ = calibrated(module, "mems", seed, latitude, -latitude, noise)
        assert wrong.verdict.level is Level.DOUBTFUL
        words = failed(wrong)["vertical Earth rate"]
        assert "the latitude has the wrong sign" in words
        right, *_ = calibrated(module, "mems", seed, latitude, noise=noise)
        assert "vertical Earth rate" not in failed(right)


def rests(k, sd, seed, n=12):
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(n, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    rates = k * up + 5 * HOUR + sd * rng.normal(size=(n, 3))
    return reversed_earth_at_rest(rates, up, np.eye(3), Site(9.81, np.radians(45.0)))


@pytest.mark.thorough
def test_the_sign_of_the_earth_is_blamed_as_rarely_as_is_said():
    made = -2 * EARTH_RATE * np.sin(np.radians(45.0))
    # So noisy that half of what a reversed sign makes is two sd.
    sd = abs(made) * 0.25 * np.sqrt(12)
    alarms = sum(not rests(0.0, sd, seed).passed for seed in range(2000))
    assert alarms <= 2000 * 0.005 + 3 * np.sqrt(2000 * 0.005)
    found = sum(not rests(made, sd, seed).passed for seed in range(500))
    assert found > 400  # 2.7 sd of 4
    # An honest rate of the other sense, or one far smaller, is something else.
    for k in (-made, 0.3 * made):
        assert "the latitude has the wrong sign" not in rests(k, 0.1 * sd, 1).sentence


def test_too_few_rests_tell_nothing_of_the_earth():
    assert rests(0.0, HOUR, 1, n=2) is None
    up = np.tile([[0.0, 0.0, 1.0]], (5, 1))
    site = Site(9.81, np.radians(45.0))
    assert reversed_earth_at_rest(up, up, np.eye(3), site) is None
    assert reversed_earth_at_rest(np.eye(3), np.eye(3), np.eye(3), Site(9.81)) is None


# -- a prior ---------------------------------------------------------------------------------------


@pytest.mark.thorough
@MODULES
def test_a_prior_that_is_right_narrows_and_passes(module):
    for seed in range(5):
        without, _, model = calibrated(module, seed=seed)
        names = tuple(f"accel.scale.{a}" for a in "xyz")
        prior = {n: (v, 1e-7) for n, v in zip(names, model.coefficients(names).values, strict=True)}
        result, nees, _ = calibrated(module, seed=seed, prior=prior)
        assert result.verdict.level is Level.PASS
        assert chi2.cdf(nees, 21) < 0.9999
        narrow, wide = result.coefficients["accel.scale"].sd, without.coefficients["accel.scale"].sd
        assert (narrow < 0.2 * wide).all()


# -- drift -----------------------------------------------------------------------------------------


def warming(log):
    """Both scales grow by 1000 ppm in proportion to time, from the first reading to the last."""
    x = 1 + 1e-3 * by_time(log.time)[:, None]
    return replace(log, accel=log.accel * x, gyro=log.gyro * x)


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [True, False], ids=["declared", "unknown"])
def test_scale_factors_that_drift_in_the_session_are_no_pass(noise):
    for seed in range(3 if noise else 1):
        result, *_ = calibrated(turntable, seed=seed, noise=noise, change=warming)
        assert result.verdict.level is not Level.PASS
        assert "accel.scale" in failed(result)["drift"]
        result, *_ = calibrated(norm_observation, seed=seed, change=warming, plan="dodecahedron 20")
        assert result.verdict.level is not Level.PASS


@pytest.mark.thorough
@MODULES
@pytest.mark.parametrize("noise", [True, False], ids=["declared", "unknown"])
def test_a_steady_instrument_is_not_told_to_drift(module, noise):
    results = [calibrated(module, seed=seed, noise=noise)[0] for seed in range(6 if noise else 2)]
    # That halves of twelve rests fit unevenly is chance in one of 500 sessions, one of these.
    assert all(set(failed(r)) <= {"evenness of specific force at rest"} for r in results)
    assert sum(r.verdict.level is Level.PASS for r in results) >= len(results) - 1
    assert all("drift" in [c.name for c in r.checks] for r in results)
