"""The observation model of a session: exact for a perfect log, and its Jacobian."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from foucault.models.earth import earth_rate_n
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.rests_and_turns import Attitudes, Session, predict
from foucault.models.rotation import exp, log
from make_session import BLIND, SITE, model_of, quiet_session, reduced, seen_by

PSD = np.ones(3)
NAMES = (
    *LINEAR_LOWER,
    *(f"accel.quadratic.{a}" for a in "xyz"),
    *(n for n in LAYOUT.names if "g_sensitivity" in n or "cross" in n),
)
KINDS = pytest.mark.parametrize("sampled", ["rate", "increment"])
SITES = pytest.mark.parametrize("site", [SITE, BLIND], ids=["latitude", "no latitude"])


def _errors(seed=1):
    rng = np.random.default_rng(seed)
    small = ("quadratic", "cross", "g_sensitivity")
    return model_of({n: rng.normal(0, 1e-4 if n.split(".")[1] in small else 5e-3) for n in NAMES})


def _predict(session, state, names=NAMES):
    return predict(session, names, state, PSD)


@pytest.mark.thorough
@KINDS
@SITES
def test_jacobian_is_the_derivative_of_the_prediction(sampled, site):
    simulation = quiet_session(400.0, sampled, site, 4)
    model = _errors()
    session, _ = reduced(simulation, seen_by(model, simulation), site)
    rng = np.random.default_rng(2)
    n, p = len(simulation.C_nb), len(NAMES)
    # A point that is off in everything: the residuals must not be small for the test.
    # An accelerometer error reaches the turns only through G, to second order: left out by the
    # model, so here G is zero (its own columns are not).
    wrong = replace(_errors(7), g_sensitivity=np.zeros((3, 3)))
    start = Attitudes(wrong, simulation.C_nb @ exp(rng.normal(0, 0.02, (n, 3))))
    at = _predict(session, start)

    def moved(step):
        values = start.model.coefficients(NAMES).values + step[:p]
        everything = dict(zip(NAMES, values, strict=True))
        model = model_of(everything)
        return Attitudes(model, start.C_nb @ exp(step[p:].reshape(n, 3)))

    # What the sensitivities of a turn leave out: the middle rule, dt^2/24 of the second
    # derivative of C_sb x input over the turn, about (w^2 + w') x |input| x time with w up to
    # 4 rad/s, w' up to 15 rad/s^2, 1.8 s; inputs: 1 (bias), |w| (matrix), |f| (g-sensitivity).
    # Increments have their samples half an interval late in the force: dt^2/12 of f'' too.
    dt = session.log.interval
    rule = dt**2 / 12 * (4**2 + 15) * 1.8
    size = {"gyro_bias": 1.0, "gyro_matrix": 4.0, "g_sensitivity": 10.0}
    step = 1e-5
    for column in range(p + 3 * n):
        d = np.zeros(p + 3 * n)
        d[column] = step
        plus, minus = _predict(session, moved(d)), _predict(session, moved(-d))
        numeric = -(plus.residuals - minus.residuals) / (2 * step)
        if column < p:
            group = NAMES[column].split(".")[1]
            block = {"bias": "gyro_bias"}.get(group, "gyro_matrix")
            block = "g_sensitivity" if group == "g_sensitivity" else block
            reach = size[block] if NAMES[column].startswith("gyro") else 0.0
        else:
            reach = 0.0
        # Central differences: rounding of numbers near 100 (products of forces), and step^2
        # times the third derivative, which is at most about 100.
        numeric_limit = 100 * 2.2e-16 / step + 100 * step**2
        np.testing.assert_allclose(
            at.jacobian[:, :, column],
            numeric,
            atol=numeric_limit + rule * reach,
            err_msg=NAMES[column] if column < p else f"attitude {column - p}",
        )


@KINDS
@SITES
def test_residuals_of_a_perfect_log_vanish_as_the_rate_grows(sampled, site):
    order = 4 if sampled == "rate" else 3
    worst = []
    model = _errors()
    for rate in (100.0, 200.0, 400.0):
        simulation = quiet_session(rate, sampled, site)
        log_ = seen_by(model, simulation)
        inside = round(0.1 * rate)  # as a detector would: rests end before the motion starts
        first, last = simulation.first + inside, simulation.last - inside
        session = Session.reduce(log_, first, last, site)
        r = _predict(session, Attitudes(model, simulation.C_nb)).residuals
        n = len(simulation.C_nb)
        # The rests themselves: rounding only, of sums of up to 1200 numbers near 10.
        np.testing.assert_allclose(r[: 2 * n], 0, atol=1200 * 2.2e-16 * 10)
        worst.append(np.sqrt(np.mean(r[2 * n :] ** 2)))
    for coarse, fine in pairwise(worst):
        # The motion starts and ends on samples, where the errors of the two intervals beside
        # the corner (a jump of the second derivative of the rate) cancel. The next term is
        # smaller by about dt over a tenth of the turn, 0.07: a tenth of an order.
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


@KINDS
def test_unknown_latitude_leaves_the_turn_of_the_earth_in_the_residuals(sampled):
    simulation = quiet_session(400.0, sampled, SITE)
    session, state = reduced(simulation, simulation.log, BLIND)
    n = len(state.C_nb)
    r = _predict(session, state).residuals
    want = np.swapaxes(simulation.C_nb, 1, 2) @ earth_rate_n(SITE.latitude)
    np.testing.assert_allclose(r[n : 2 * n], want, atol=1200 * 2.2e-16 * 1e-4)


def test_the_rate_of_the_earth_moves_rates_and_turns_as_it_says():
    simulation = quiet_session(400.0)
    model = _errors()
    session, state = reduced(simulation, seen_by(model, simulation), SITE)
    state = Attitudes(model, state.C_nb)
    step, n = 0.1, len(state.C_nb)
    there = replace(session, site=replace(SITE, latitude=SITE.latitude + step))
    at, moved = _predict(session, state, ()), _predict(there, state, ())
    change = at.earth @ (there.earth - session.earth)
    seen = (at.residuals - moved.residuals)[n:]
    np.testing.assert_allclose(seen[:n], change[:n], atol=1e-15)
    # Second order: the angle that the Earth turns in a turn, 1e-4 rad, of itself.
    np.testing.assert_allclose(seen[n:], change[n:], atol=1e-8)
    assert np.abs(change[n:]).max() > 1e-6


def test_noise_and_bias_of_a_turn_move_it_as_they_say():
    simulation = quiet_session(400.0)
    model = _errors()
    session, state = reduced(simulation, seen_by(model, simulation), SITE)
    state = Attitudes(model, state.C_nb)
    at = _predict(session, state, ())
    bias = 1e-5 * np.array([1.0, -2.0, 3.0])
    pushed = replace(session, log=replace(session.log, gyro=session.log.gyro + bias))
    change = _predict(pushed, state, ()).residuals - at.residuals
    n = len(state.C_nb)
    # Second order in the push: (3.7e-5 x 2 s)^2, and the middle rule on 7e-5 rad.
    np.testing.assert_allclose(change[2 * n :], at.turn_bias @ bias, atol=1e-8)
    inverse = np.linalg.inv(model.gyro_matrix)
    time = session.turn_time
    trace = np.trace(at.turn_noise, axis1=1, axis2=2)
    assert trace == pytest.approx(time * np.trace(inverse @ inverse.T), rel=1e-12)
    assert (at.turn_path >= np.linalg.norm(log(at.C_se), axis=1) - 1e-9).all()


def test_without_gyros_only_the_accelerometers_are_compared():
    simulation = quiet_session(400.0)
    log_ = replace(simulation.log, gyro=None)
    session, state = reduced(simulation, log_, SITE)
    at = predict(session, ("accel.bias.x",), Attitudes(ImuModel(), state.C_nb), PSD)
    assert at.residuals.shape == (14, 3)
    assert at.turn_noise.shape == (0, 3, 3)
    np.testing.assert_allclose(at.residuals, 0, atol=1200 * 2.2e-16 * 10)
