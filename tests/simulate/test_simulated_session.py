"""The simulator: its truth is a rigid body under gravity on a turning Earth."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.kernels.rotation import integrate_turns
from foucault.models.earth import EARTH_RATE, earth_rate_n
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import GRADES, ImuNoise, TriadNoise, grade
from foucault.models.rotation import log
from foucault.simulate.hand_rotated import draw_errors, simulate
from foucault.simulate.noise import draw_noise, quantise
from make_session import BLIND, SITE, model_of, quiet_session, seen_by, short_plan


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_at_rest_it_feels_gravity_up_and_the_turning_earth(sampled):
    simulation = quiet_session(100.0, sampled)
    for first, last, C_nb in zip(simulation.first, simulation.last, simulation.C_nb, strict=True):
        rest = slice(first, last)
        f = np.broadcast_to(C_nb.T @ [0, 0, SITE.gravity], (last - first, 3))
        w = np.broadcast_to(C_nb.T @ earth_rate_n(SITE.latitude), (last - first, 3))
        np.testing.assert_allclose(simulation.log.accel[rest], f, atol=1e-13)
        np.testing.assert_allclose(simulation.log.gyro[rest], w, atol=1e-17)
    rate = np.linalg.norm(simulation.log.gyro[:100], axis=1)
    np.testing.assert_allclose(rate, EARTH_RATE, rtol=1e-12)


def test_without_latitude_the_earth_stands_still():
    assert (quiet_session(100.0, "rate", BLIND).log.gyro[:100] == 0).all()


def test_the_rate_is_the_derivative_of_the_attitude():
    """Integrated finely, the rates lead from the attitude of one rest to the next."""
    errors = []
    for rate in (200.0, 400.0):
        simulation = quiet_session(rate, "rate", BLIND)
        data, inside = simulation.log, 10
        turn = (simulation.last[:-1] - 1 - inside, simulation.first[1:] + inside)
        C_se = integrate_turns(data.time, data.gyro, data.gyro, np.zeros((3, 3)), *turn, False)[0]
        want = np.swapaxes(simulation.C_nb[:-1], 1, 2) @ simulation.C_nb[1:]
        errors.append(np.abs(log(np.swapaxes(want, 1, 2) @ C_se)).max())
    assert errors[1] < 1e-7  # and what is left is the integration's own error, of fourth order:
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)


def test_increments_are_means_of_the_rates():
    fine = quiet_session(400.0, "rate").log
    coarse = quiet_session(100.0, "increment").log
    # Simpson twice over each interval of four fine steps; its error and Gauss's are of the
    # fourth and sixth order of a smooth motion with corners in its second derivative.
    w = np.array([1, 4, 2, 4, 1]) / 12
    n = len(coarse)
    for name in ("gyro", "accel"):
        x = getattr(fine, name)
        mean = np.array([w @ x[4 * (k - 1) : 4 * k + 1] for k in range(1, n - 1)])
        scale = np.abs(np.diff(x, 2, axis=0)).max()  # dt^2 x second derivative
        np.testing.assert_allclose(getattr(coarse, name)[1 : n - 1], mean, atol=scale)


def test_the_hand_moves_smoothly():
    simulation = quiet_session(400.0)
    jump = np.abs(np.diff(simulation.log.gyro, axis=0)).max()
    # A jump of the rate would not shrink with the interval: 30 rad/s^2 is a quick hand.
    assert jump < 30 / 400
    assert np.abs(simulation.log.gyro).max() > 1.0


def test_errors_and_noise_are_added_as_the_model_says():
    model = model_of(dict.fromkeys(LINEAR_LOWER, 0.01))
    simulation = quiet_session(100.0)
    again = simulate(short_plan(), model=model, noise=ImuNoise(), site=SITE, rate=100.0)
    expected = seen_by(model, simulation)
    np.testing.assert_allclose(again.log.accel, expected.accel, atol=1e-14)
    np.testing.assert_allclose(again.log.gyro, expected.gyro, atol=1e-14)


def test_seeds_make_sessions():
    def noisy(seed):
        return simulate(
            short_plan(5), model=ImuModel(), noise=grade("mems").noise, site=SITE, seed=seed
        )

    assert np.array_equal(noisy(1).log.gyro, noisy(1).log.gyro)
    assert not np.array_equal(noisy(1).log.gyro, noisy(2).log.gyro)
    one, two = noisy(1).log, noisy(2).log
    assert abs(np.corrcoef(one.gyro[:200, 0], two.gyro[:200, 0])[0, 1]) < 0.3


# -- noise -----------------------------------------------------------------------------------

TIME = np.arange(20_000) * 0.01


def test_white_noise_has_its_power():
    x = draw_noise(TriadNoise(white=2e-3), TIME, np.random.default_rng(1))
    low, high = chi_square_limits(x.size)
    assert low < np.sum(x**2) * 0.01 / 4e-6 < high


def test_markov_noise_is_stationary_with_its_correlation():
    noise = TriadNoise(bias_instability=3.0, correlation_time=0.05)
    x = draw_noise(noise, TIME, np.random.default_rng(2))
    keep = np.exp(-0.01 / 0.05)
    drive = (x[1:] - keep * x[:-1]) / (3.0 * np.sqrt(1 - keep**2))
    low, high = chi_square_limits(drive.size, tests=2)
    assert low < np.sum(drive**2) < high
    first = np.array([draw_noise(noise, TIME[:2], np.random.default_rng(s))[0] for s in range(500)])
    low, high = chi_square_limits(first.size, tests=2)
    assert low < np.sum(first**2) / 9 < high


def test_random_walk_grows_with_time():
    x = draw_noise(TriadNoise(random_walk=0.5), TIME, np.random.default_rng(3))
    steps = np.diff(x, axis=0) / (0.5 * 0.1)
    low, high = chi_square_limits(steps.size)
    assert low < np.sum(steps**2) < high


def test_quantise():
    x = np.array([[0.26, -0.26, 0.0]])
    np.testing.assert_allclose(quantise(x, 0.1), [[0.3, -0.3, 0.0]])
    assert quantise(x, 0.0) is x


@pytest.mark.parametrize("name", GRADES)
def test_drawn_errors_have_the_spread_of_their_grade(name):
    spread = grade(name).spread
    sd = np.array([spread[n.rpartition(".")[0]] for n in LINEAR_LOWER])
    drawn = np.array([draw_errors(name, s).coefficients(LINEAR_LOWER).values for s in range(100)])
    square = np.sum((drawn / sd) ** 2, axis=0)
    low, high = chi_square_limits(100, tests=21 * len(GRADES))
    assert (low < square).all() and (square < high).all()
    assert all(not np.array_equal(a, b) for a, b in pairwise(drawn))
