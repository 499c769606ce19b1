"""The likelihood of a session: its start, its pieces, and what it does with outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate.gauss_newton import huber, solve
from foucault.estimate.hand_rotated.likelihood import (
    HEADING_SD,
    KINDS,
    build,
    components,
    fit,
)
from foucault.estimate.hand_rotated.start import first_guess
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.noise import grade
from foucault.models.rotation import log
from foucault.models.session_noise import SessionNoise
from make_session import BLIND, SITE, model_of, quiet_session, reduced, seen_by

NOISE = SessionNoise.declared(grade("tactical").noise, 0.01)


def _session(site=SITE, noise=0.0, model=None):
    simulation = quiet_session(100.0)
    data = seen_by(model or ImuModel(), simulation)
    rng = np.random.default_rng(17)
    accel, gyro = (np.sqrt(psd[0] * 100) for psd in (NOISE.accel_psd, NOISE.gyro_psd))
    data = replace(
        data,
        accel=data.accel + noise * accel * rng.normal(size=data.accel.shape),
        gyro=data.gyro + noise * gyro * rng.normal(size=data.gyro.shape),
    )
    session, state = reduced(simulation, data, site)
    return session, state


def test_the_first_guess_is_near_whatever_the_heading():
    rng = np.random.default_rng(18)
    model = model_of({n: rng.normal(0, 0.01) for n in LINEAR_LOWER})
    session, state = _session(model=model)
    guess = first_guess(session)
    error = log(np.swapaxes(state.C_nb, 1, 2) @ guess.C_nb)
    # Accelerometers are exact; what a gyro matrix fitted without the Earth leaves is second
    # order of a turn of 2e-4 rad, and the heading divides it by the Earth's rate.
    assert np.abs(error).max() < 0.1
    np.testing.assert_allclose(guess.model.accel_matrix, model.accel_matrix, atol=1e-10)


def test_a_first_guess_needs_directions():
    session, _ = _session()
    planar = replace(session, accel_mean=np.tile(session.accel_mean[:2], (7, 1)))
    assert first_guess(planar) is None


def test_observations_and_unknowns_are_counted():
    session, state = _session(noise=1.0)
    estimate = solve(build(session, LINEAR_LOWER, state, NOISE))
    n = 14
    # Rests twice, turns once, three rows each, and one prior on the heading.
    assert len(estimate.residuals) == 3 * (3 * n - 1) + 1
    assert estimate.dof == 3 * (3 * n - 1) + 1 - 21 - 3 * n
    parts = components(estimate, session)
    assert tuple(parts) == KINDS
    heading = estimate.residuals[-1] ** 2
    assert sum(c.chi_square for c in parts.values()) + heading == pytest.approx(estimate.chi_square)
    redundancy = sum(c.redundancy for c in parts.values()) + 1 - estimate.leverage[-1]
    assert redundancy == pytest.approx(estimate.dof)
    for part in parts.values():
        assert part.low < part.chi_square < part.high


def test_an_unknown_heading_has_the_width_of_the_circle():
    session, state = _session(BLIND, noise=1.0)
    estimate = solve(build(session, LINEAR_LOWER, state, NOISE))
    up = state.C_nb[0, 2]
    sd = np.sqrt(up @ estimate.state_cov[21:24, 21:24] @ up)
    assert sd == pytest.approx(HEADING_SD, rel=1e-6)


def test_a_prior_enters_the_coefficients():
    session, state = _session(noise=1.0)
    sd = np.full(21, np.inf)
    sd[0] = 1e-9
    mean = np.zeros(21)
    mean[0] = 0.01
    prior = CoefficientVector(LAYOUT.subset(LINEAR_LOWER), mean, prior_sd=sd)
    estimate = solve(build(session, LINEAR_LOWER, state, NOISE, prior))
    assert estimate.coefficients.value("accel.bias.x") == pytest.approx(0.01, abs=1e-8)
    assert estimate.coefficients.sd[0] == pytest.approx(1e-9, rel=1e-6)


def test_clipping_counts_an_outlier_up_to_the_limit():
    session, state = _session(noise=1.0)
    mean = session.accel_mean.copy()
    mean[4] += 0.2
    bad = replace(session, accel_mean=mean)
    estimate = solve(build(bad, LINEAR_LOWER, state, NOISE), loss=huber)
    whole = components(estimate, bad)["accel_repeatability"].chi_square
    clipped = components(estimate, bad, clipped=True)["accel_repeatability"].chi_square
    of_outlier = estimate.blocks == 4
    # sum w^2 r^2 = 3 limit^2: residuals hold sqrt(w) r.
    square = np.sum(estimate.residuals[of_outlier] ** 2) * estimate.weights[4]
    assert square == pytest.approx(3 * 3.0**2, rel=0.01)
    assert clipped < 0.05 * whole


def test_one_bad_rest_is_not_taken_for_scatter_of_all():
    session, state = _session(noise=1.0)
    mean = session.accel_mean.copy()
    mean[4] += 0.2
    bad = replace(session, accel_mean=mean)
    estimate, noise, _ = fit(bad, LINEAR_LOWER, state, NOISE, loss=huber)
    assert estimate.weights[4] < 0.1
    assert noise.accel_repeatability < 0.02  # a tenth of the outlier
    plain = fit(bad, LINEAR_LOWER, state, NOISE)[1]
    assert plain.accel_repeatability > 2 * noise.accel_repeatability
    # A session as good as its noise is left as it is.
    assert fit(session, LINEAR_LOWER, state, NOISE, loss=huber, pretest=True)[1] is NOISE
