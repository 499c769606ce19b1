"""Delay by rate matching: exact without noise, as sure as it says with it, and the real vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.estimate import delay_matching
from foucault.estimate.delay import Delay, delay_of
from foucault.estimate.delay_matching import (
    GAIN,
    HELD,
    SlaveAttitude,
    covariance,
    filtered,
    match,
    spectrum_of,
    turns_of,
    weigh,
    whitened,
    whitening,
)
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import earth_rate_n, transport_rate
from foucault.models.rotation import exp, log, matrix_of
from foucault.navigate.increments import Increments, increments_of
from foucault.plans.manoeuvres import Climb, Start, Straight, STurn, Turn
from foucault.plans.transfer import TransferProfile
from foucault.simulate.transfer import Flexure, Link, MasterNoise, draw_slave, simulate_transfer
from foucault.tables import Log
from make_alignment import DPH, real
from make_transfer import ARCMIN, DEG

START = Start(45 * DEG, 9 * DEG, 800.0, heading=20 * DEG, speed=45.0)
FLIGHT = TransferProfile(
    "s-turns", START, (
        STurn(40 * DEG, 15.0), Climb(6.0, angle=8 * DEG), Turn(60 * DEG, 12.0),
        Climb(6.0, angle=-5 * DEG), STurn(-50 * DEG, 15.0), Climb(6.0, angle=0.0),
    ), (Straight(1.0),),
)  # fmt: skip


def found(run, **words) -> Delay:
    m = run.master
    w = earth_rate_n(m.latitude) + transport_rate(m.latitude, m.height, m.velocity_n)
    one = delay_of(increments_of(run.log), m.time, m.C_nb, w_in_n=w, **words)
    assert one is not None
    return one


def test_it_is_exact_without_noise() -> None:
    quiet = MasterNoise(velocity=0.0, attitude=(0.0, 0.0, 0.0), position=0.0)
    for delay in (0.0, 0.0613, 0.2):
        one = found(simulate_transfer(FLIGHT, rate=100.0, link=Link(delay=delay), noise=quiet))
        assert one.delay == pytest.approx(delay, abs=2e-7)
        assert np.allclose(one.C_ms, np.eye(3), atol=1e-6)
        assert np.abs(one.bias).max() < 1e-7
        assert one.likeness == pytest.approx(1.0, abs=1e-9)


def test_a_clock_that_counts_from_1970_changes_nothing() -> None:
    run = simulate_transfer(FLIGHT, rate=100.0, link=Link(delay=0.0613), seed=2)
    start = 1754380800.0  # its microseconds are beyond what a number can hold
    late = replace(run.master, time=run.master.time + start)
    one, other = (
        found(run),
        found(replace(run, log=replace(run.log, time=run.log.time + start), master=late)),
    )
    assert one.seen and other.seen
    assert other.delay == pytest.approx(one.delay, abs=2e-6)
    assert other.delay_sd == pytest.approx(one.delay_sd, rel=1e-2)
    assert other.middle - start == pytest.approx(one.middle, abs=1e-2)
    np.testing.assert_allclose(other.part_start - start, one.part_start, atol=1e-5)
    np.testing.assert_allclose(other.turns.end - start, one.turns.end, atol=1e-5)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("flexure", "jitter"), [(None, 0.0), (Flexure((3e-4, 3e-4, 2e-4), 0.8), 0.0), (None, 0.004)]
)
def test_it_is_as_sure_as_it_says(flexure: Flexure | None, jitter: float) -> None:
    """Error over its deviation in 40 runs, without knowing anything of delay or mounting."""
    rng, z, error = np.random.default_rng(12), [], []
    for _ in range(40):
        slave = replace(draw_slave(rng), flexure=flexure)
        link = Link(delay=rng.uniform(0.02, 0.2), jitter=jitter)
        seed = int(rng.integers(1 << 31))
        run = simulate_transfer(FLIGHT, rate=50.0, slave=slave, link=link, seed=seed)
        one = found(run)
        error.append(one.delay - link.delay)
        z.append(error[-1] / one.delay_sd)
        assert one.seen and not one.edge
    low, high = chi_square_limits(len(z), tests=3)
    assert low < np.sum(np.square(z)) < high
    assert np.sqrt(np.mean(np.square(error))) < 1e-3
    assert not low < np.sum(np.square(z)) / 4 < high, "a deviation twice as large would show"


def test_attitude_between_samples() -> None:
    """The cubic between samples, and the rate, against the motion itself."""
    run = simulate_transfer(FLIGHT, rate=50.0)
    slave = SlaveAttitude(increments_of(run.log))
    at = np.arange(2.0, 55.0, 0.0931)
    C, w = slave.at(at)
    wanted = run.motion.trajectory(at).C_nb
    # Against the ground, that turns by less than 0.1 mrad/s.
    turned = log(np.swapaxes(C[:-1], 1, 2) @ C[1:])
    true = log(np.swapaxes(wanted[:-1], 1, 2) @ wanted[1:])
    _, w_b = run.motion.truth(at)
    assert np.abs(turned - true).max() < 0.0931 * 1e-4
    assert np.abs(w - w_b).max() < 2e-4


def test_slopes_against_differences() -> None:
    run = simulate_transfer(FLIGHT, rate=100.0)
    slave, m = SlaveAttitude(increments_of(run.log)), run.master
    turns = turns_of(m.time, m.C_nb)
    C_0, x = matrix_of(0.3, -0.2, 0.5), np.array([0.05, 0.0, 0.0, 0.0, 1e-3, -2e-3, 3e-3])
    x = np.append(x, [0.05, -0.02, 0.01])

    def look(x):
        return delay_matching._look(slave, turns, x, C_0, None, HELD)

    here = look(x)
    for i, h in enumerate([1e-4] + [1e-5] * 9):
        dx = h * np.eye(10)[i]
        up, down = look(x + dx), look(x - dx)
        both = up.used & down.used & here.used
        change = (up.residual - down.residual)[both] / (2 * h)
        size = np.abs(change).max()
        assert np.abs(change - here.slope[both, :, i]).max() < 2e-3 * size


def test_the_slope_by_the_delay_as_the_master_says_it() -> None:
    """From turns before and after, .1 s each: of waves of 2 s all but 2.5 %."""
    time = np.arange(0.0, 40.0, 0.01)
    rate = 0.5 * np.sin(np.pi * time[:, None] + [0.0, 1.0, 2.0])
    slave = SlaveAttitude(increments_of(Log(time, rate, np.zeros_like(rate))))
    at = np.arange(0.5, 39.0, 0.1)
    turns = turns_of(at, slave.at(at)[0])
    here = delay_matching._look(slave, turns, np.zeros(10), np.eye(3), None, HELD)
    one, other = (x[1:-1, :, 0] for x in (here.weighted, here.slope))
    assert np.sum(one * other) == pytest.approx(0.975 * np.sum(other**2), rel=0.02)
    assert np.corrcoef(one.ravel(), other.ravel())[0, 1] > 0.99


@pytest.mark.parametrize("apart", [0.0, 0.3])
def test_covariance_is_that_of_leaving_out(apart: float) -> None:
    """With slopes weighted by themselves, and by others that are `apart` from them."""
    rng = np.random.default_rng(4)
    k, p = 60, 7
    J, e = rng.normal(size=(k, 3, p)), rng.normal(size=(k, 3))
    Z = J + apart * rng.normal(size=J.shape)

    def solved(keep):
        z, j = Z[keep].reshape(-1, p), J[keep].reshape(-1, p)
        return -np.linalg.solve(z.T @ j, z.T @ e[keep].ravel())

    best = solved(np.ones(k, bool))
    left = e + J @ best
    for rows in (1, 5):
        moved = []
        for first in range(0, k, rows):
            keep = np.ones(k, bool)
            keep[first : first + rows] = False
            moved.append(solved(keep) - best)
        wanted = np.array(moved).T @ np.array(moved)
        assert np.allclose(covariance(left, J, rows=rows, weighted=Z), wanted, rtol=1e-6)
    blind = J.copy()
    blind[:, :, 0] = 0.0
    assert covariance(left, blind)[0, 0] == np.inf
    held = covariance(left, blind, HELD[:7, :7])
    assert np.isfinite(held[1:, 1:]).all()


def test_residuals_become_white() -> None:
    """Attitude noise, differenced, and noise of gyros; the filter looks back only."""
    rng = np.random.default_rng(5)
    k = 3000
    residual = np.diff(rng.normal(size=(k + 1, 3)), axis=0) + 0.3 * rng.normal(size=(k, 3))
    S = spectrum_of(residual)
    white = filtered(residual, whitening(S / k))[:k]
    assert np.var(white, axis=0) == pytest.approx(1.0, abs=0.1)
    for lag in (1, 2, 5):
        assert np.abs(np.mean(white[lag:] * white[:-lag], axis=0)).max() < 4 / np.sqrt(k)
    pulse = np.zeros((k, 3))
    pulse[k // 2] = 1.0
    answer = filtered(pulse, whitening(S / k))
    before, after = np.abs(answer[: k // 2]).max(), np.abs(answer[k // 2]).min()
    assert before < 1e-3 * after
    assert np.all(answer[k // 2 : k // 2 + 5, 0] > 0), "a difference is added up again"


def test_weights_make_it_sharper() -> None:
    plain, weighted = [], []
    for seed in range(15):
        run = simulate_transfer(FLIGHT, rate=100.0, slave=draw_slave(np.random.default_rng(seed)),
                                link=Link(delay=0.1), seed=seed)  # fmt: skip
        m = run.master
        slave, turns = SlaveAttitude(increments_of(run.log)), turns_of(m.time, m.C_nb)
        first = match(slave, turns, 0.08, np.eye(3))
        plain.append(first.delay - 0.1)
        weighted.append(weigh(slave, turns, first).delay - 0.1)
    assert np.std(weighted) < 0.8 * np.std(plain)


def test_too_little_in_common() -> None:
    run = simulate_transfer(FLIGHT, rate=100.0)
    m, x = run.master, increments_of(run.log)
    assert delay_of(x, m.time[:15], m.C_nb[:15]) is None
    assert delay_of(x, m.time + 1e4, m.C_nb) is None


def vehicle() -> tuple[Increments, dict]:
    """Return the slave of a real vehicle, and its master: 100 s, roll swings to 33 deg."""
    log_ = real("fog_mems_transfer", {
        "file": "transfer_align_fog_mems.mat", "variable": "mimu",
        "time": {"column": 6, "unit": "s"},
        "gyro": {"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
        "accel": {"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
    })  # fmt: skip
    from foucault.logs import master
    from foucault.logs.master import MasterDescription

    described = MasterDescription.model_validate({
        "file": "transfer_align_fog_mems.mat", "variable": "fogavp",
        "time": {"column": 9, "unit": "s"},
        "velocity": {"columns": [3, 4, 5], "unit": "m/s"},
        "attitude": {"columns": [2, 0, 1], "unit": "rad", "sense": "counter-clockwise"},
        "position": {"columns": [6, 7, 8], "unit": "rad"},
    })  # fmt: skip
    from make_alignment import REAL

    m = master.read(described, REAL / "fog_mems_transfer")
    w = earth_rate_n(m.latitude) + transport_rate(m.latitude, m.height, m.velocity_n)
    return increments_of(log_), {"time": m.time, "C_nb": m.C_nb, "w_in_n": w}


def test_a_real_vehicle() -> None:
    """The delay is about 15.5 ms; another program has the mounting and the biases."""
    x, master = vehicle()
    one = delay_of(x, **master)
    assert one is not None
    assert one.delay == pytest.approx(0.0155, abs=3e-4)
    assert one.delay_sd < 1e-4
    mu = log(one.C_ms) / ARCMIN
    sd = np.sqrt(np.diag(one.mu_cov)) / ARCMIN
    other, other_sd = [-5.4449, 2.5122, -17.5871], [1.26, 0.89, 1.42]
    assert np.all(np.abs(mu - other) < 3 * np.hypot(sd, other_sd))
    assert one.bias / DPH == pytest.approx([-214.51, 159.68, 76.14], abs=4.0)
    # The sampling clocks differ by some ppm, which are 0.8 ms in 100 s.
    assert one.drift == pytest.approx(-8e-6, abs=4 * one.drift_sd) and one.drift_sd < 3e-6


def test_halves_of_a_real_vehicle() -> None:
    x, master = vehicle()
    first, second = (
        delay_of(x, **{key: value[rows] for key, value in master.items()})
        for rows in (slice(0, 500), slice(500, 1000))
    )
    whole = delay_of(x, **master)
    assert first is not None and second is not None and whole is not None
    away = log(first.C_ms.T @ second.C_ms)
    assert np.all(np.abs(away) < 3 * np.sqrt(np.diag(first.mu_cov + second.mu_cov)))
    bias = first.bias - second.bias
    assert np.all(np.abs(bias) < 3 * np.sqrt(np.diag(first.bias_cov + second.bias_cov)))
    drifted = whole.drift * (first.middle - second.middle)
    sd = np.hypot(first.delay_sd, second.delay_sd)
    assert abs(first.delay - second.delay - drifted) < 3 * sd


@pytest.mark.thorough
def test_the_heading_of_a_real_vehicle_closes() -> None:
    """Its gyros, less the errors found, hold the heading of the master within 1.5 arcmin."""
    x, master = vehicle()
    one = delay_of(x, **master)
    assert one is not None
    scale = 1 + one.match.x[GAIN]
    corrected = replace(x, dtheta_b=(x.dtheta_b - x.dt[:, None] * one.bias) / scale)
    time = master["time"] - one.delay
    rows = time > 0
    C_0s, _ = SlaveAttitude(corrected).at(time[rows])
    turns = turns_of(**master)
    C_im = [master["C_nb"][0]]
    for phi in turns.phi_m:
        C_im.append(C_im[-1] @ exp(phi))
    C_is = (np.array(C_im) @ one.C_ms)[rows]
    start = exp(log(C_is[:10] @ np.swapaxes(C_0s[:10], 1, 2) @ (C_0s[0] @ C_is[0].T)).mean(axis=0))
    phi = log((start @ C_is[0] @ C_0s[0].T @ C_0s) @ np.swapaxes(C_is, 1, 2)) / ARCMIN
    assert np.abs(phi[:, 2]).max() < 1.5
    assert np.abs(phi[-10:].mean(axis=0)).max() < 1.0


def test_whitened_rows_are_white_in_the_real_log() -> None:
    x, master = vehicle()
    one = delay_of(x, **master)
    assert one is not None
    e, _ = whitened(one.match, one.match.slope)
    assert np.mean(e**2, axis=0) == pytest.approx(1.0, abs=0.1)
