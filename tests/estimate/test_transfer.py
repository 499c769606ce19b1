"""Transfer alignment against a vehicle whose motion is known: every column, NEES, delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.estimate import transfer
from foucault.estimate.transfer import Reset, TransferModel, hand_over, likeliest_delay
from foucault.infer.filtered import fit, parts_out
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.linear_filter import by_prior, h_infinity, kalman, least_gamma
from foucault.models.earth import displaced, east_north_up, ecef
from foucault.models.rotation import exp, log
from foucault.models.transfer import Matching
from foucault.navigate.strapdown import State, states_of
from make_transfer import (
    ARCMIN,
    ATTITUDE_SD,
    INSTALLATION,
    SD,
    SENSORS,
    VELOCITY_SD,
    flight,
    master,
    mount,
    prior,
    slave,
)

ZERO = np.zeros(9)
MATCHING = Matching(VELOCITY_SD, ATTITUDE_SD, vertical=True)
DELAY = 0.08


def all_sd(known, matching, extra=()):
    more = [0.2] if matching.delay else []
    return np.concatenate([known, SD, [INSTALLATION] * 3, more, extra])


def about(*arguments):
    """Return the linear system about what was known beforehand."""
    model = TransferModel(*arguments)
    return model.about(model.start)


def expected(free, x):
    """What the system says that an error x at the start makes of z at every epoch."""
    out = []
    for Phi, H in zip(free.Phi, free.H, strict=True):
        x = np.concatenate([Phi @ x, x[len(Phi) :]])
        out.append(H @ x)
    return np.array(out)


def column(name, attitude):
    """Return z made by a small error that is real, z of none, and the linear system."""
    matching = replace(MATCHING, delay=True, attitude=attitude)
    truth, mu, late = ZERO.copy(), np.zeros(3), 0.0
    known, sd = prior(DELAY)
    size = 1.0
    arguments = mount(), matching, known, all_sd(sd, matching)
    layout = TransferModel(slave(ZERO, mu), master(DELAY), *arguments).layout
    j = layout.index(name)
    x = np.zeros(len(layout))
    if 9 <= j < 18:
        size = 0.1 * SD[j - 9]
        truth[j - 9] = size
    elif name.startswith("installation"):
        size = 0.1 * INSTALLATION
        mu["xyz".index(name[-1])] = size
    elif name == "master.delay":
        late = size = 1e-4
    x[j] = size
    none = about(slave(ZERO, np.zeros(3)), master(DELAY), *arguments)
    if late:
        # Messages that come at the same times, of what was so much earlier.
        said = master(DELAY)
        motion = flight()[0]
        true = motion.trajectory(said.time - DELAY - late)
        said = replace(said, velocity_n=true.velocity_n, C_nm=true.C_nb)
        some = about(slave(ZERO, np.zeros(3)), said, *arguments)
    else:
        some = about(slave(truth, mu), master(DELAY), *arguments)
    real = some.z - none.z
    linear = expected(none, x)
    return real, linear


@pytest.mark.thorough
@pytest.mark.parametrize("attitude", ["vector", "angles"])
@pytest.mark.parametrize(
    "name",
    [*SENSORS.layout.names, "installation.x", "installation.y", "installation.z", "master.delay"],
)
def test_every_column_is_what_the_error_does(name, attitude):
    """A real error changes the differences as the linear system says, all along the flight.

    The start attitude is that of the master: an installation error is a start error too.
    """
    real, linear = column(name, attitude)
    if name.startswith("installation"):
        # The slave's own attitude was taken without it: phi = C_nm C_0 mu at the start.
        known, sd = prior(DELAY)
        matching = replace(MATCHING, delay=True, attitude=attitude)
        free = about(slave(ZERO, np.zeros(3)), master(DELAY), mount(), matching, known,
                     all_sd(sd, matching))  # fmt: skip
        x = np.zeros(len(free.x0))
        mu = np.zeros(3)
        mu["xyz".index(name[-1])] = 0.1 * INSTALLATION
        x[:3] = known.state.C_nb @ mu
        linear = linear + expected(free, x)
    for block in (slice(0, 3), slice(3, 6)):
        scale = np.abs(linear[:, block]).max()
        assert scale > 0
        # The rate that a delay counts with is a mean over some samples before and after.
        near = 0.04 if name == "master.delay" else 0.01
        assert np.abs(real - linear)[:, block].max() < near * scale


def test_start_errors_are_what_they_do():
    known, sd = prior(DELAY)
    arguments = slave(ZERO, np.zeros(3)), master(DELAY), mount(), MATCHING
    model = TransferModel(*arguments, known, all_sd(sd, MATCHING))
    none = model.about(known)
    phi, dv = np.array([2e-4, -1e-4, 3e-4]), np.array([0.05, -0.02, 0.01])
    state = replace(
        known.state, C_nb=exp(-phi) @ known.state.C_nb, velocity_n=known.state.velocity_n + dv
    )
    off = replace(known, state=state)
    some = model.about(off)
    real = some.z - none.z
    x0 = some.x0  # what the prior says of a start that is off
    np.testing.assert_allclose(x0[:3], phi, atol=1e-7)
    np.testing.assert_allclose(x0[3:6], dv, atol=1e-6)
    for block in (slice(0, 3), slice(3, 6)):
        linear = expected(some, x0)[:, block]
        assert np.abs(real[:, block] - linear).max() < 0.005 * np.abs(linear).max()


def drawn(seed, *, delay_state=False, assumed=DELAY):
    rng = np.random.default_rng(seed)
    truth, mu = SD * rng.normal(size=9), INSTALLATION * rng.normal(size=3)
    known, sd = prior(assumed, rng=rng)
    matching = replace(MATCHING, delay=delay_state)
    case = (slave(truth, mu, rng=rng), master(DELAY, rng=rng), mount(), matching, known,
            all_sd(sd, matching))  # fmt: skip
    return case, np.concatenate([truth, mu, [DELAY] if delay_state else []])


@pytest.mark.thorough
def test_parts_of_clean_flights_are_predicted_at_the_stated_rate():
    beyond, flights = 0, 40
    for seed in range(flights):
        found = fit(TransferModel(*drawn(seed)[0]), passes=3)
        edges = np.linspace(0, len(found.system.z), 7).astype(int)
        judged = parts_out(found, edges, 0.05)
        beyond += judged.score > judged.high
    assert beyond <= 7  # 2 are expected; more than 7 come by chance once in a thousand


@pytest.mark.thorough
def test_consistent():
    """NEES and NIS of 20 flights inside two-sided limits at 1 %; a covariance too small is not."""
    nees, nis, runs = 0.0, 0.0, 20
    for seed in range(runs):
        case, truth = drawn(seed)
        found = fit(TransferModel(*case))
        err = found.values - truth
        nees += err @ np.linalg.solve(found.cov, err)
        nis += found.run.nis.sum()
    n, m = runs * len(truth), runs * int(np.isfinite(found.run.innovation).sum())
    low, high = chi_square_limits(n, 0.005)
    assert low < nees < high
    assert not low < nees / 0.7 < high
    low, high = chi_square_limits(m, 0.005)
    assert low < nis < high


@pytest.mark.thorough
def test_the_delay_is_found_either_way():
    errors, sds = [], []
    for seed in range(6):
        case, truth = drawn(seed, delay_state=True, assumed=0.02)
        found = fit(TransferModel(*case), passes=3)
        errors.append(found.values[-1] - truth[-1])
        sds.append(found.cov[-1, -1] ** 0.5)
    low, high = chi_square_limits(6, 0.01)
    assert low < np.sum((np.array(errors) / sds) ** 2) < high
    model = TransferModel(*drawn(0)[0])
    found = likeliest_delay(model, (0.0, 0.2))
    assert abs(found.delay - DELAY) < 4 * found.sd and not found.at_edge
    assert found.sd == pytest.approx(sds[0], rel=0.15)
    outside = likeliest_delay(model, (0.1, 0.2))
    assert outside.at_edge


def test_a_delay_ignored_is_a_false_bias():
    """The source's M1: in a turn a delay looks like an accelerometer bias of -tau w^2 V forward."""
    case, truth = drawn(1, assumed=0.0)
    found = fit(TransferModel(*case))
    err = (found.values - truth) / np.sqrt(np.diag(found.cov))
    assert np.abs(err).max() > 20


def test_a_slave_handed_over_goes_on_as_well_as_it_says():
    total, runs = 0.0, 10
    motion = flight()[0]
    for seed in range(runs):
        case, truth = drawn(seed)
        found = fit(TransferModel(*case))
        on = hand_over(case[0], found, motion.end - 0.1)
        time = case[0].increments.time[on.row]
        assert time == pytest.approx(motion.end - 0.1, abs=0.006)
        true = motion.trajectory(np.array([time]))
        C_true = true.C_nb[0] @ mount().C_ms @ exp(truth[9:])
        phi = (C_true @ on.state.C_nb.T - np.eye(3))[[2, 0, 1], [1, 2, 0]]
        err = np.concatenate([phi, on.state.velocity_n - true.velocity_n[0]])
        total += err @ np.linalg.solve(on.cov[:6, :6], err)
    low, high = chi_square_limits(6 * runs, 0.01)
    assert low < total < high


def test_flexure_is_a_process_of_the_sd_and_time_that_were_said():
    """Far on, the covariance of the flexure alone is its stationary one."""
    known, sd = prior(DELAY)
    fixed = mount(flexure_sd=2 * ARCMIN, flexure_time=3.0)
    sd = all_sd(sd, MATCHING, [2 * ARCMIN] * 3 + [2 * ARCMIN * 2.146 / 3.0] * 3)
    model = TransferModel(slave(ZERO, np.zeros(3)), master(DELAY), fixed, MATCHING, known, sd)
    free, at = model.about(known), model.layout.group("flexure")
    P = free.P0
    for Phi, half in zip(free.Phi, free.half, strict=True):
        P = Phi @ (P + np.diag(half)) @ Phi.T + np.diag(half)
    np.testing.assert_allclose(np.sqrt(np.diag(P)[at]), 2 * ARCMIN, rtol=0.01)


def test_h_infinity_runs_on_the_same_system():
    case, _ = drawn(2)
    found = fit(TransferModel(*case))
    system = found.system
    L = by_prior(system)
    gamma = least_gamma(system, L)
    assert h_infinity(system, L, gamma).stopped is None
    assert h_infinity(system, L, 0.9 * gamma).stopped is not None
    np.testing.assert_array_equal(h_infinity(system, L, np.inf).states, kalman(system).states)


def test_noise_is_no_knowledge_of_the_delay():
    """On a straight run the delay stays as unknown as it was."""
    known, sd = prior(0.02)
    matching = replace(MATCHING, delay=True)
    quiet, noisy = (slave(ZERO, np.zeros(3), rng=rng) for rng in (None, np.random.default_rng(3)))
    said = master(DELAY)
    early = said[said.time < 5.0]  # before anything happens
    told = []
    for one in (quiet, noisy):
        free = about(one, early, mount(), matching, known, all_sd(sd, matching))
        told.append(np.sqrt(kalman(free).cov[-1, -1]))
    assert told[0] == pytest.approx(0.2, rel=0.01)
    assert told[1] > 0.15


def test_a_run_that_is_reset_tells_the_same(monkeypatch):
    """Pieces of a quarter of the flight: what is found, and how sure, is that of one piece.

    Of a slave without noise whose errors are large, so that what a new beginning takes out is.
    """
    truth = np.concatenate([3.0 * SD[:3], 0.2 * SD[3:]])
    matching = replace(MATCHING, delay=True)
    known, sd = prior(DELAY)
    case = (slave(truth, np.zeros(3)), master(DELAY), mount(), matching, known,
            all_sd(sd, matching))  # fmt: skip
    model = TransferModel(*case)
    whole = fit(model, passes=3)
    monkeypatch.setattr(transfer, "PIECE", 23.0)
    free = model.about(known)
    assert np.count_nonzero(np.abs(free.jump).sum(axis=1)) == 3
    assert np.linalg.norm(free.jump[:, 3:6], axis=1).max() > 0.1  # ten times the sd
    parts = fit(model, passes=3)
    sd = [np.sqrt(np.diag(found.cov)) for found in (parts, whole)]
    np.testing.assert_allclose(*sd, rtol=2e-3)
    off = (parts.values - whole.values) / sd[1]
    assert np.abs(off).max() < 0.02
    end, other = hand_over(case[0], parts, 90.0), hand_over(case[0], whole, 90.0)
    sd = np.sqrt(np.diag(other.cov))
    apart = np.abs(end.state.velocity_n - other.state.velocity_n) / sd[3:6]
    turned = np.abs(log(end.state.C_nb @ other.state.C_nb.T)) / sd[:3]
    assert apart.max() < 0.02 and turned.max() < 0.02


def test_a_run_that_is_reset_errs_by_what_was_taken_out():
    """The errors against the truth before and after, in the axes of their own level frames."""
    rng = np.random.default_rng(3)
    truth = State(1.1, 2.0, 500.0, np.array([40.0, -90.0, 3.0]), exp(rng.normal(size=3)))
    wrong = State(
        *(float(x) for x in displaced(1.1, 2.0, 500.0, np.array([900.0, -700.0, 60.0]))),
        truth.velocity_n + np.array([3.0, -2.0, 1.0]),
        exp(np.array([1e-3, -2e-3, 3e-3])) @ truth.C_nb,
    )  # fmt: skip
    reset = Reset.by(wrong.packed(), np.array([9e-4, -2.1e-3, 3.1e-3]), np.array([3.1, -2.0, 0.8]),
                   np.array([880.0, -710.0, 65.0]))  # fmt: skip
    said = reset.turn @ errors_of(wrong.packed(), truth) + reset.jump
    apart = np.abs(said - errors_of(reset.state.packed(), truth))
    assert apart[:3].max() < 1e-5 and apart[3:6].max() < 1e-3 and apart[6:].max() < 1e-2
    assert np.linalg.norm(errors_of(reset.state.packed(), truth)[6:]) < 40.0


def errors_of(row, truth):
    """Return (psi, dv, dr) of a state of the kernels against the truth, as `correct` takes it."""
    x = states_of(row)
    C_le = (east_north_up(float(x["latitude"]), float(x["longitude"])) @ x["C_nl"]).T
    C_en = east_north_up(truth.latitude, truth.longitude)
    psi = -log((C_le.T @ x["C_nl"].T @ x["C_nb"]) @ (C_en @ truth.C_nb).T)
    v = C_le.T @ x["C_nl"].T @ x["velocity_n"] - C_en @ truth.velocity_n
    place = ecef(float(x["latitude"]), float(x["longitude"]), float(x["height"]))
    r = place - ecef(truth.latitude, truth.longitude, truth.height)
    return np.concatenate([C_le @ psi, C_le @ v, C_le @ r])
