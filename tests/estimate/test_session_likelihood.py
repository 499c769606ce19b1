"""The likelihood of a session: its start, its pieces, and what it does with outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate.hand_rotated import (
    HEADING_SD,
    SCATTER,
    RestsAndTurns,
    first_guess,
)
from foucault.infer import mixed
from foucault.infer.gauss_newton import chi_square_limits, solve
from foucault.models.earth import EARTH_RATE, earth_rate_n
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, SessionNoise, TriadNoise, grade, window_covariance
from foucault.models.rotation import log
from make_session import BLIND, SITE, model_of, quiet_session, reduced, seen_by

SITE_RATE = earth_rate_n(SITE.latitude)
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


def _model(session, state, price=None, noise=NOISE):
    return RestsAndTurns(session, LINEAR_LOWER, state, noise, price=price)


def test_observations_and_unknowns_are_counted():
    session, state = _session(noise=1.0)
    at = mixed.fit(_model(session, state))
    n, estimate = 14, at.estimate
    # Rests twice, turns once, three rows each, and one prior on the heading.
    assert len(estimate.residuals) == 3 * (3 * n - 1) + 1
    assert estimate.dof == 3 * (3 * n - 1) + 1 - 21 - 3 * n
    assert tuple(at.after) == ("accel", "gyro", "turns")
    heading = estimate.residuals[-1] ** 2
    parts = at.after.values()
    assert sum(c.chi_square for c in parts) + heading == pytest.approx(estimate.chi_square)
    redundancy = sum(c.redundancy for c in parts) + 1 - estimate.leverage[-1]
    assert redundancy == pytest.approx(estimate.dof)
    assert all(part.inside for part in parts)


def test_an_unknown_heading_has_the_width_of_the_circle():
    session, state = _session(BLIND, noise=1.0)
    estimate = solve(mixed.stated(_model(session, state)))
    up = state.C_nb[0, 2]
    sd = np.sqrt(up @ estimate.state_cov[21:24, 21:24] @ up)
    assert sd == pytest.approx(HEADING_SD, rel=1e-6)


def test_an_unknown_latitude_leaves_one_vector_for_the_whole_session():
    session, state = _session(BLIND, noise=1.0)
    at = mixed.fit(_model(session, state))
    (earth,) = [s for s in at.at.sources if s.name == "unknown Earth rate"]
    assert earth.sd**2 == pytest.approx(EARTH_RATE**2 / 3)  # all three axes: its full size
    n = len(session.accel_mean)
    assert not earth.shared[:n].any()
    C_bn = np.swapaxes(at.state.C_nb, 1, 2)
    np.testing.assert_allclose(earth.shared[n : 2 * n], at.state.model.gyro_matrix @ C_bn)
    turned = C_bn[:-1] * session.turn_time[:, None, None]
    np.testing.assert_allclose(earth.shared[2 * n :], turned, atol=1e-3)
    # What it is follows from the rests, up to the heading.
    found = mixed.causes(at, "unknown Earth rate")
    assert found[2] == pytest.approx(SITE_RATE[2], abs=0.3 * EARTH_RATE)
    assert np.hypot(*found[:2]) == pytest.approx(SITE_RATE[1], abs=0.3 * EARTH_RATE)
    # Taken for nothing, it is an error of the bias far beyond its uncertainty.
    bias = slice(LINEAR_LOWER.index("gyro.bias.x"), LINEAR_LOWER.index("gyro.bias.z") + 1)
    nothing = solve(mixed.stated(at.model, {"unknown Earth rate": 0.0}))
    squares = [
        e.coefficients.values[bias]
        @ np.linalg.solve(e.state_cov[bias, bias], e.coefficients.values[bias])
        for e in (at.estimate, nothing)
    ]
    assert squares[0] < chi_square_limits(3)[1] < squares[1]


def test_a_prior_enters_the_coefficients():
    session, state = _session(noise=1.0)
    sd = np.full(21, np.inf)
    sd[0] = 1e-9
    mean = np.zeros(21)
    mean[0] = 0.01
    prior = CoefficientVector(LAYOUT.subset(LINEAR_LOWER), mean, prior_sd=sd)
    coefficients = mixed.fit(_model(session, state), prior).estimate.coefficients
    assert coefficients.value("accel.bias.x") == pytest.approx(0.01, abs=1e-8)
    assert coefficients.sd[0] == pytest.approx(1e-9, rel=1e-6)


def test_one_bad_rest_is_not_taken_for_scatter_of_all():
    session, state = _session(noise=1.0)
    mean = session.accel_mean.copy()
    mean[4] += 0.2
    bad = replace(session, accel_mean=mean)
    at = mixed.fit(_model(bad, state, 0.0), robust=True)
    assert at.outliers.tolist() == [4]
    assert at.found[SCATTER["accel"]] < 0.02  # a tenth of the outlier
    plain = mixed.fit(_model(bad, state, 0.0))
    assert plain.found[SCATTER["accel"]] > 2 * at.found[SCATTER["accel"]]
    # A session as good as its noise is left as it is.
    good = mixed.fit(_model(session, state, mixed.SIGNIFICANT), robust=True)
    assert not any(good.found.values()) and not len(good.outliers)


def test_an_outlier_is_left_out_of_the_fit_of_its_kind():
    session, state = _session(noise=1.0)
    mean = session.accel_mean.copy()
    mean[4] += 0.2
    bad = replace(session, accel_mean=mean)
    whole = mixed.fit(_model(bad, state)).after["accel"].chi_square
    part = mixed.fit(_model(bad, state), robust=True).after["accel"]
    assert part.inside and part.chi_square < 0.05 * whole


def _covariance(at):
    n, d = at.residuals.shape
    return mixed.Covariance(at.sources, {}, (n, d), np.ones(n)).whole.reshape(n, d, n, d)


def test_sources_add_what_each_observation_suffers():
    session, state = _session()
    psd = [np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.full(3, 4e-6)]
    noise = SessionNoise(*psd, ImuNoise())
    model = _model(session, state, 0.0, noise)
    at = model.linearise(state)
    T, n = session.rest_time, len(session.rest_time)
    sds = dict(zip(SCATTER.values(), (0.1, 0.2, 0.3), strict=True))
    cov = mixed.Covariance(at.sources, sds, at.residuals.shape, np.ones(3 * n - 1)).own
    for j in range(n):
        np.testing.assert_allclose(cov[j], np.diag([1, 2, 3]) / T[j] + 0.01 * np.eye(3))
        np.testing.assert_allclose(cov[n + j], np.diag([4, 5, 6]) / T[j] + 0.04 * np.eye(3))
    # White noise alike on all axes: psd x time in any axes.
    want = 4e-6 * session.turn_time + 0.09
    for j in range(n - 1):
        np.testing.assert_allclose(cov[2 * n + j], want[j] * np.eye(3), atol=1e-12)


def test_slow_noise_ties_rests_and_turns_together():
    session, state = _session()
    triad = TriadNoise(white=1e-3, bias_instability=2e-3, correlation_time=1e9)
    noise = SessionNoise.declared(ImuNoise(gyro=triad), 0.01)
    model = _model(session, state, noise=noise)
    (slow,) = [s for s in model.linearise(state).sources if s.name == "slow noise of gyros"]
    n = len(session.rest_time)
    assert not slow.shared[:n].any()
    tied = np.einsum("iac,jbc->iajb", slow.shared, slow.shared)
    # A constant bias: full variance in a rest, and times its effect in a turn.
    np.testing.assert_allclose(tied[n, :, 2 * n - 1], 4e-6 * np.eye(3), rtol=1e-6, atol=1e-14)
    effect = model.predict(state).turn_bias[0]
    np.testing.assert_allclose(tied[n, :, 2 * n], 4e-6 * effect.T, rtol=1e-6, atol=1e-12)


def test_the_covariance_of_slow_noise_is_that_of_its_windows():
    session, state = _session()
    triad = TriadNoise(white=1e-3, bias_instability=2e-3, random_walk=1e-4)
    noise = SessionNoise.declared(ImuNoise(triad, triad), 0.01)
    cov = _covariance(_model(session, state, noise=noise).linearise(state))
    time = session.log.time - session.log.time[0]
    start, end = time[session.first], time[session.last - 1]
    n = len(start)
    want = window_covariance(start, end, triad) + np.diag(1e-6 / session.rest_time)
    for axis in range(3):
        np.testing.assert_allclose(cov[:n, axis, :n, axis], want, rtol=1e-9)
        np.testing.assert_allclose(cov[n : 2 * n, axis, n : 2 * n, axis], want, rtol=1e-9)
    np.testing.assert_allclose(cov[:n, :, n:], 0.0)
