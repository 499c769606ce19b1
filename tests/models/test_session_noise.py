"""Covariance of a session: slow noise against drawn noise, whitening against its definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import sqrtm

from foucault.estimate.chi_square import chi_square_limits
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rests_and_turns import predict
from foucault.models.session_noise import (
    QUIETEST,
    SessionNoise,
    blocks,
    correlated,
    whiten,
    window_covariance,
)
from foucault.simulate.noise import draw_noise
from make_session import BLIND, SITE, quiet_session, reduced

START = np.array([0.0, 3.0, 3.5, 20.0, 40.0])
END = np.array([2.0, 3.5, 12.0, 20.2, 60.0])


def _windows(noise, rng, dt=0.02, trials=1000):
    """Mean of drawn noise over each window, shape (3 trials, windows)."""
    time = np.arange(0, round(60 / dt) + 1) * dt
    rows = []
    for _ in range(trials):
        x = draw_noise(noise, time, rng)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(x, axis=0)])
        a, b = np.searchsorted(time, START), np.searchsorted(time, END - 1e-9)
        rows.append(((total[b] - total[a]) / (b - a)[:, None]).T)
    return np.concatenate(rows)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "noise",
    [
        TriadNoise(bias_instability=2.0, correlation_time=5.0),
        TriadNoise(bias_instability=2.0, correlation_time=500.0),
        TriadNoise(random_walk=0.3),
        TriadNoise(bias_instability=1.0, correlation_time=20.0, random_walk=0.2),
    ],
)
def test_window_covariance_is_that_of_drawn_noise(noise):
    drawn = _windows(noise, np.random.default_rng(8))
    cov = window_covariance(START, END, noise)
    assert np.linalg.eigvalsh(cov).min() > 0
    white = np.linalg.solve(np.linalg.cholesky(cov), drawn.T)
    n = white.shape[1]
    # Every white component has unit variance, every pair no correlation. 15 tests, 4 cases.
    tests = 4 * 15
    low, high = chi_square_limits(n, tests=tests)
    square = np.sum(white**2, axis=1)
    assert (low < square).all() and (square < high).all()
    for i in range(5):
        for j in range(i):
            # u + v and u - v have variance 2 each and are as independent as u and v are.
            both = np.sum((white[i] + white[j]) ** 2) / 2
            assert low < both < high


def test_a_wrong_window_covariance_would_be_seen():
    noise = TriadNoise(bias_instability=2.0, correlation_time=5.0)
    drawn = _windows(noise, np.random.default_rng(8), trials=400)
    for wrong in (TriadNoise(bias_instability=2.3, correlation_time=5.0),
                  TriadNoise(bias_instability=2.0, correlation_time=3.0)):  # fmt: skip
        white = np.linalg.solve(np.linalg.cholesky(window_covariance(START, END, wrong)), drawn.T)
        low, high = chi_square_limits(white.shape[1], tests=5)
        square = np.sum(white**2, axis=1)
        assert ((square < low) | (square > high)).any()


@pytest.mark.parametrize("tau", [1e-3, 1.0, 1e3, 1e9])
def test_window_covariance_has_its_limits(tau):
    cov = window_covariance(START, END, TriadNoise(bias_instability=1.0, correlation_time=tau))
    if tau == 1e9:  # a constant
        np.testing.assert_allclose(cov, 1.0, rtol=1e-6)
    if tau == 1e-3:  # white, with density 2 tau
        np.testing.assert_allclose(np.diag(cov), 2e-3 / (END - START), rtol=6e-3)
    assert np.isfinite(cov).all() and np.linalg.eigvalsh(cov).min() > -1e-12


def test_declared_noise_takes_rounding_as_white():
    noise = ImuNoise(TriadNoise(white=3e-3, quantisation=0.01), TriadNoise(quantisation=1e-4))
    got = SessionNoise.declared(noise, 0.02)
    assert got.accel_psd == pytest.approx(np.full(3, 9e-6 + 1e-4 / 12 * 0.02))
    assert got.gyro_psd == pytest.approx(np.full(3, 1e-8 / 12 * 0.02))
    assert np.array_equal(got.turn_psd, got.gyro_psd)


def test_noise_that_is_not_there_is_still_a_number():
    got = SessionNoise.declared(ImuNoise(), 0.01)
    for psd in (got.accel_psd, got.gyro_psd, got.turn_psd):
        assert np.array_equal(psd, np.full(3, QUIETEST**2))


def _session(site):
    simulation = quiet_session(100.0, "rate", SITE, 5)
    session, state = reduced(simulation, simulation.log, site)
    return session, predict(session, ("gyro.bias.x", "accel.scale.y"), state, np.full(3, 4e-6))


def test_blocks_add_what_each_observation_suffers():
    session, at = _session(SITE)
    noise = SessionNoise(
        np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.full(3, 4e-6), ImuNoise(),
        0.1, 0.2, 0.3,
    )  # fmt: skip
    cov = blocks(session, noise, at)
    T = session.rest_time
    n = len(T)
    for j in range(n):
        np.testing.assert_allclose(cov[j], np.diag([1, 2, 3]) / T[j] + 0.01 * np.eye(3))
        np.testing.assert_allclose(cov[n + j], np.diag([4, 5, 6]) / T[j] + 0.04 * np.eye(3))
    # White noise alike on all axes: psd x time in any axes.
    want = 4e-6 * session.turn_time + 0.09
    for j in range(n - 1):
        np.testing.assert_allclose(cov[2 * n + j], want[j] * np.eye(3), atol=1e-12)


def test_an_unknown_latitude_adds_the_earths_rate():
    known, at = _session(SITE)
    blind, at_blind = _session(BLIND)
    noise = SessionNoise.declared(ImuNoise(), 0.01)
    more = blocks(blind, noise, at_blind) - blocks(known, noise, at)
    n = len(known.rest_time)
    third = EARTH_RATE**2 / 3 * np.eye(3)
    np.testing.assert_allclose(more[:n], 0)
    np.testing.assert_allclose(more[n : 2 * n], np.broadcast_to(third, (n, 3, 3)), rtol=1e-9)
    want = third * known.turn_time[:, None, None] ** 2
    np.testing.assert_allclose(more[2 * n :], want, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("slow", [False, True])
def test_whitening_is_an_inverse_square_root_of_the_covariance(slow):
    session, at = _session(SITE)
    triad = TriadNoise(white=1e-3, bias_instability=2e-3, random_walk=1e-4)
    noise = SessionNoise.declared(
        ImuNoise(triad, triad) if slow else ImuNoise(TriadNoise(1e-3), TriadNoise(1e-3)), 0.01
    )
    independent, tied = blocks(session, noise, at), correlated(session, noise, at)
    assert (tied is not None) == slow
    k = len(independent)
    rng = np.random.default_rng(9)
    r, J = rng.normal(size=(k, 3)), rng.normal(size=(k, 3, 4))
    white_r, white_J = whiten(r, J, independent, tied)

    dense = np.zeros((3 * k, 3 * k)) if tied is None else tied.copy()
    for j in range(k):
        dense[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] += independent[j]
    inverse = np.linalg.inv(dense)
    root = np.real(sqrtm(inverse))
    # Any inverse square root gives the same inner products: the likelihood knows no other.
    flat = J.reshape(3 * k, 4)
    want_r, want_J = root @ r.ravel(), root @ flat
    assert white_r @ white_r == pytest.approx(want_r @ want_r, rel=1e-9)
    np.testing.assert_allclose(white_J.T @ white_J, want_J.T @ want_J, rtol=1e-8)
    np.testing.assert_allclose(white_J.T @ white_r, want_J.T @ want_r, rtol=1e-7)


def test_slow_noise_ties_rests_and_turns_together():
    session, at = _session(SITE)
    slow = SessionNoise.declared(
        ImuNoise(gyro=TriadNoise(white=1e-3, bias_instability=2e-3, correlation_time=1e9)), 0.01
    )
    tied = correlated(session, slow, at)
    n = len(session.rest_time)
    np.testing.assert_allclose(tied[: 3 * n, : 3 * n], 0)
    rest, turn = tied[3 * n : 3 * n + 3], slice(6 * n, 6 * n + 3)
    # A constant bias: full variance in a rest, and times its effect in a turn.
    np.testing.assert_allclose(rest[:, 3 * n : 3 * n + 3], 4e-6 * np.eye(3), rtol=1e-6)
    np.testing.assert_allclose(rest[:, turn], 4e-6 * at.turn_bias[0].T, rtol=1e-6, atol=1e-12)
