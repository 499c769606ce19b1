"""Noise-free sessions give back the errors that were put in: one at a time, and all at once.

A log without noise differs from the model only by the discretisation of the turns. How far that
moves each coefficient follows to first order from the residuals at the truth and the gain of the
estimator: ``|error_i| <= sum_k |pinv(J)_ik| |r_k|``. That bound is the tolerance.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from foucault.detect.stretches import find_rests
from foucault.errors import Status
from foucault.estimate.hand_rotated import RestsAndTurns, first_guess
from foucault.infer import mixed
from foucault.infer.gauss_newton import solve
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, SessionNoise
from foucault.models.rests_and_turns import Attitudes, Session, predict
from foucault.models.rotation import exp, log
from foucault.procedures.hand_rotated import Settings, calibrate
from foucault.result import Level
from make_session import BLIND, SITE, model_of, quiet_session, reduced, seen_by

QUADRATIC = tuple(f"accel.quadratic.{a}" for a in "xyz")
G_SENSITIVITY = tuple(n for n in LAYOUT.names if "g_sensitivity" in n)
PLAIN = {"loss": "squares", "repeatability": False, "held_out": 0}
SIZE = {
    "accel.bias": 0.3, "accel.scale": 0.01, "accel.misalignment": 0.01, "accel.quadratic": 1e-4,
    "gyro.bias": 0.01, "gyro.scale": 0.01, "gyro.misalignment": 0.01, "gyro.g_sensitivity": 1e-5,
}  # fmt: skip


def _settings(names):
    return Settings(
        accel_quadratic=QUADRATIC[0] in names, g_sensitivity=G_SENSITIVITY[0] in names, **PLAIN
    )


@cache
def _tolerance(names, sampled="rate", site=SITE, values=()):
    """What the discretisation of the turns may do to each coefficient, and rounding."""
    rests = 14 if len(names) == 21 else 20
    simulation = quiet_session(400.0, sampled, site, rests)
    model = model_of(dict(values))
    log_ = seen_by(model, simulation)
    found = find_rests(log_)
    session = Session.reduce(log_, found.first, found.last, site)
    noise = SessionNoise.declared(ImuNoise(), log_.interval)
    truth = Attitudes(model, simulation.C_nb)
    problem = mixed.stated(RestsAndTurns(session, names, truth, noise), {"unknown Earth rate": 0.0})
    at = problem.linearise(truth, np.ones(problem.n_blocks))
    r, J = at.residuals, at.jacobian
    scale = np.linalg.norm(J, axis=0)
    gain = np.linalg.pinv(J / scale, rcond=1e-13) / scale[:, None]
    # The iteration stops at 1e-4 sd.
    sd = np.linalg.norm(gain, axis=1)
    # A scale factor error is the difference of a matrix element from 1, known to a few eps.
    bound = np.abs(gain) @ np.abs(r) + 1e-4 * sd + 8 * np.finfo(float).eps
    return simulation, bound[: len(names)]


def _check(names, values, sampled="rate", site=SITE):
    simulation, _ = _tolerance(names, sampled, site)
    tolerance = _tolerance(names, sampled, site, tuple(values.items()))[1]
    result = calibrate(
        seen_by(model_of(values), simulation),
        site=site,
        noise=ImuNoise(),
        settings=_settings(names),
    )
    assert result.status is Status.CONVERGED
    want = model_of(values).coefficients(names).values
    np.testing.assert_array_less(np.abs(result.coefficients.values - want), tolerance)
    return result, tolerance


def _given_names(name):
    if name in QUADRATIC:
        return tuple(n for n in LAYOUT.names if n in LINEAR_LOWER + QUADRATIC)
    if name in G_SENSITIVITY:
        return tuple(n for n in LAYOUT.names if n in LINEAR_LOWER + G_SENSITIVITY)
    return LINEAR_LOWER


@pytest.mark.parametrize("name", [*LINEAR_LOWER, *QUADRATIC, *G_SENSITIVITY])
def test_one_error_returns_exactly_that_error(name):
    size = SIZE[name.rpartition(".")[0]]
    _, tolerance = _check(_given_names(name), {name: size})
    # The bound means something: below a millionth of the error for accelerometers and biases,
    # a few parts in a million for what the turns tell.
    assert tolerance[_given_names(name).index(name)] < 1e-5 * size


def _all_errors(names, seed=3):
    rng = np.random.default_rng(seed)
    return {n: SIZE[n.rpartition(".")[0]] * rng.uniform(-1, 1) for n in names}


@pytest.mark.thorough
@pytest.mark.parametrize("sampled", ["rate", "increment"])
@pytest.mark.parametrize("latitude", [-35.0, 0.0, 60.0, None])
def test_all_errors_at_once(latitude, sampled):
    site = BLIND if latitude is None else Site.at(np.radians(latitude))
    _check(LINEAR_LOWER, _all_errors(LINEAR_LOWER), sampled, site)


def test_quadratic_terms_and_g_sensitivity_with_all_the_others():
    names = tuple(n for n in LAYOUT.names if n in LINEAR_LOWER + QUADRATIC + G_SENSITIVITY)
    _check(names, _all_errors(names))


@pytest.mark.parametrize("latitude", [-35.0, 0.0, 60.0])
def test_the_heading_is_found_where_the_earth_shows_it(latitude):
    site = Site.at(np.radians(latitude))
    simulation = quiet_session(400.0, "rate", site)
    session, _ = reduced(simulation, seen_by(model_of(_all_errors(LINEAR_LOWER)), simulation), site)
    noise = SessionNoise.declared(ImuNoise(), session.log.interval)
    start = first_guess(session)
    estimate = solve(mixed.stated(RestsAndTurns(session, LINEAR_LOWER, start, noise)))
    assert estimate.status is Status.CONVERGED
    error = log(np.swapaxes(simulation.C_nb, 1, 2) @ estimate.state.C_nb)
    # Discretisation of the turns, 1e-8 rad, over an Earth turning 1e-4 rad in the same time.
    assert np.abs(error).max() < 1e-4
    sd = np.sqrt(np.diag(estimate.state_cov)[21:])
    assert np.isfinite(sd).all()


def test_the_heading_is_anyones_guess_where_nothing_shows_it():
    simulation = quiet_session()
    result = calibrate(simulation.log, site=BLIND, noise=ImuNoise(), settings=Settings(**PLAIN))
    assert result.diagnostics["heading_sd"] is None
    near_pole = Site.at(np.radians(89.9999))
    pole = quiet_session(400.0, "rate", near_pole)
    seen = calibrate(pole.log, site=near_pole, noise=ImuNoise(), settings=Settings(**PLAIN))
    here = calibrate(simulation.log, site=SITE, noise=ImuNoise(), settings=Settings(**PLAIN))
    # The horizontal part of the Earth's rate is 1.7e-6 of it there.
    assert seen.diagnostics["heading_sd"] > 1e4 * here.diagnostics["heading_sd"]


@pytest.mark.thorough
@pytest.mark.parametrize("sampled", ["rate", "increment"])
@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_a_log_without_noise_passes_as_it_comes(sampled, rate):
    simulation = quiet_session(rate, sampled)
    result = calibrate(simulation.log, site=SITE)
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    assert result.status is Status.CONVERGED
    # Declared free of noise: it settles too, though the discretisation may contradict it.
    assert calibrate(simulation.log, site=SITE, noise=ImuNoise()).status is Status.CONVERGED


def test_the_attitudes_of_a_session_do_not_matter():
    """A session seen from another north is the same session where the Earth is not modelled."""
    simulation = quiet_session(400.0, "rate", BLIND)
    session, state = reduced(simulation, simulation.log, BLIND)
    turned = exp(np.array([0.0, 0.0, 1.0])) @ state.C_nb
    a = predict(session, (), state, np.ones(3)).residuals
    b = predict(session, (), Attitudes(ImuModel(), turned), np.ones(3)).residuals
    np.testing.assert_allclose(a, b, atol=1e-11)
