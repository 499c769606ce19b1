"""Four numbers of a set-up: against brute force, and against the scatter of simulated readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.dwells import find_dwells
from foucault.diagnose.study import nees
from foucault.estimate.north_reduction import (
    GYRO_DRIFT,
    GYRO_NOISE,
    GYRO_OFFSET,
    INDEXING,
    TILT_DRIFT,
    TILT_NOISE,
    UNSEEN,
    Nuisance,
    reduce,
)
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import Dwells
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    Rotation,
    SeekerErrors,
    Stops,
    simulate_north,
)
from make_dwells import DEG_H, FIELD, FOUR, PALINDROME, attitudes, four_numbers, make_dwells

LATITUDE = 0.8
ORDERS = {
    3: (0.0, 120.0, 240.0),
    4: FOUR,
    5: (0.0, 72.0, 144.0, 216.0, 288.0),
    "uneven": (10.0, 35.0, 160.0, 200.0, 300.0),
    "palindrome": PALINDROME,
}
COLOURED = ImuNoise(
    TriadNoise(3e-4, bias_instability=4e-5, correlation_time=200.0),
    TriadNoise(9e-7, 8e-9, 150.0, 2e-10),
)
"""White, Markov and random walk of about equal size over a dwell."""


def uneven(stops, seed=3):
    """One set-up whose dwells differ in length, with readings of any kind."""
    rng = np.random.default_rng(seed)
    d = make_dwells(attitudes(1), LATITUDE, stops=stops)
    time = rng.uniform(30.0, 90.0, len(d))
    start = np.cumsum(time + 10.0) - time
    return replace(
        d, time=time, start=start, gyro=EARTH_RATE * rng.standard_normal(len(d)),
        accel=rng.standard_normal((len(d), 1)),
    )  # fmt: skip


def window_covariance(d, noise, fine=400):
    """Covariance of the means by brute force, sums over instants."""
    at = d.start[:, None] - d.start.min() + d.time[:, None] * (np.arange(fine) + 0.5) / fine
    n = len(d)
    out = np.diag(noise.white**2 / d.time)
    for i in range(n):
        for j in range(n):
            apart = np.abs(at[i][:, None] - at[j])
            markov = noise.bias_instability**2 * np.exp(-apart / noise.correlation_time)
            walk = noise.random_walk**2 * np.minimum(at[i][:, None], at[j])
            out[i, j] += np.mean(markov + walk)
    return out


def generalised(d, y, V, prior):
    """Unknowns c_x, c_y, offset and drift by textbook GLS; prior variances, inf for none."""
    t = d.start + d.time / 2
    t = t - np.sum(t * d.time) / np.sum(d.time)
    X = np.column_stack([np.sin(d.index), np.cos(d.index), np.ones(len(d)), t])
    keep = np.array([1, 1, 1, prior[1] > 0], bool)
    known = np.array([0.0, 0.0, *(1 / max(p, 1e-300) for p in prior)])
    # In columns of like size, so that plain inversion loses nothing.
    scale = 1 / np.linalg.norm(X, axis=0)[keep]
    X, known = X[:, keep] * scale, known[keep] * scale**2
    W = np.linalg.inv(V)
    cov = np.linalg.inv(X.T @ W @ X + np.diag(known))
    return scale * (cov @ X.T @ W @ y), np.outer(scale, scale) * cov


@pytest.mark.thorough
@pytest.mark.parametrize("stops", ORDERS.values(), ids=map(str, ORDERS))
@pytest.mark.parametrize("noise", [FIELD, COLOURED], ids=["white", "coloured"])
def test_it_is_generalised_least_squares(stops, noise):
    d = uneven(stops)
    pairs = reduce(d, noise)
    y = d.gyro
    x, cov = generalised(d, y, window_covariance(d, noise.gyro), (np.inf, 0.0))
    size = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(pairs.values[0, :2] / size[:2], x[:2] / size[:2], atol=1e-2)
    assert np.abs(pairs.values[0, :2] - x[:2]).max() < 1e-6 * np.abs(x).max()
    assert pairs.offset[0] == pytest.approx(x[2], rel=1e-6, abs=1e-6 * EARTH_RATE)
    np.testing.assert_allclose(pairs.cov[0, :2, :2] / np.outer(size[:2], size[:2]),
                               cov[:2, :2] / np.outer(size[:2], size[:2]), atol=1e-5)  # fmt: skip
    X = np.column_stack([np.sin(d.index), np.cos(d.index), np.ones(len(d))])
    np.testing.assert_allclose(pairs.fit, X @ x, rtol=1e-5, atol=1e-6 * EARTH_RATE)
    left = y - X @ x
    want = left @ np.linalg.solve(window_covariance(d, noise.gyro), left)
    assert pairs.chi_square[0, 0] == pytest.approx(want, rel=1e-4, abs=1e-6)
    assert pairs.dof[0, 0] == len(stops) - 3
    force, _ = generalised(d, d.accel[:, 0], window_covariance(d, noise.accel), (np.inf, 0.0))
    np.testing.assert_allclose(pairs.values[0, 2:], force[:2], atol=1e-5)


@pytest.mark.parametrize("drift_sd", [1e-10, 1e-8, np.inf])
@pytest.mark.parametrize("offset_sd", [1e-7, np.inf])
def test_priors_of_offset_and_drift_are_rows_more(drift_sd, offset_sd):
    d = uneven(ORDERS["uneven"])
    offset = 2e-6
    noise = replace(FIELD, gyro=replace(FIELD.gyro, white=3e-5))
    pairs = reduce(d, noise, Nuisance(offset, offset_sd, drift_sd))
    prior = (offset_sd**2, drift_sd**2)
    V = window_covariance(d, noise.gyro)
    x, cov = generalised(d, d.gyro - offset, V, prior)
    np.testing.assert_allclose(pairs.values[0, :2], x[:2], rtol=1e-5, atol=1e-9 * EARTH_RATE)
    assert pairs.offset[0] == pytest.approx(x[2] + offset, rel=1e-4)
    assert pairs.drift[0] == pytest.approx(x[3], rel=1e-4)
    size = np.sqrt(np.diag(cov))[:2]
    np.testing.assert_allclose(pairs.cov[0, :2, :2] / np.outer(size, size),
                               cov[:2, :2] / np.outer(size, size), atol=1e-5)  # fmt: skip
    assert (GYRO_OFFSET in pairs.sources) == np.isfinite(offset_sd)
    assert (GYRO_DRIFT in pairs.sources) == np.isfinite(drift_sd)


def test_two_stops_show_one_direction_and_say_so():
    d = make_dwells(attitudes(4), LATITUDE, stops=(90.0, 270.0), offset=3e-6)
    truth = four_numbers(attitudes(4), LATITUDE)
    pairs = reduce(d, FIELD)
    np.testing.assert_allclose(pairs.values[:, 0], truth[:, 0], rtol=1e-9)
    np.testing.assert_allclose(pairs.values[:, 2], truth[:, 2], rtol=1e-9)
    sd = FIELD.gyro.white / np.sqrt(60.0) / np.sqrt(2)
    np.testing.assert_allclose(pairs.cov[:, 0, 0], sd**2, rtol=1e-6)
    np.testing.assert_allclose(pairs.cov[:, 1, 1], UNSEEN * EARTH_RATE**2, rtol=1e-6)
    np.testing.assert_allclose(pairs.cov[:, 2:, 2:][:, 1, 1], UNSEEN * 9.8**2, rtol=1e-6)
    assert not pairs.dof.any()


def test_two_stops_with_a_known_offset_show_both():
    """Stops at 0 and 90 deg read M + o and N + o."""
    d = make_dwells(attitudes(4), LATITUDE, stops=(0.0, 90.0), offset=3e-6)
    offset_sd = 2e-8
    pairs = reduce(d, FIELD, Nuisance(3e-6, offset_sd))
    np.testing.assert_allclose(pairs.values[:, :2], four_numbers(attitudes(4), LATITUDE)[:, :2],
                               rtol=1e-6)  # fmt: skip
    white = FIELD.gyro.white**2 / 60.0
    np.testing.assert_allclose(pairs.sources[GYRO_NOISE][:, [0, 1], [0, 1]], white, rtol=1e-4)
    np.testing.assert_allclose(pairs.sources[GYRO_OFFSET][:, :2, :2], offset_sd**2, rtol=1e-4)
    without = reduce(d, FIELD)  # a direction between the two is lost then
    assert np.linalg.eigvalsh(without.cov[0, :2, :2])[1] > 0.1 * UNSEEN * EARTH_RATE**2


def test_noise_free_readings_come_back_exactly():
    poses = attitudes(12, 60.0)
    want = four_numbers(poses, LATITUDE)
    for accel in ("base", "case"):
        for stops in ORDERS.values():
            d = make_dwells(poses, LATITUDE, stops=stops, offset=2e-6, accel=accel,
                            accel_offset=0.05)  # fmt: skip
            pairs = reduce(d, FIELD)
            np.testing.assert_allclose(pairs.values[:, :2] / EARTH_RATE, want[:, :2] / EARTH_RATE,
                                       atol=1e-9)  # fmt: skip
            np.testing.assert_allclose(pairs.values[:, 2:], want[:, 2:], atol=1e-8)
            np.testing.assert_allclose(pairs.offset, 2e-6, rtol=1e-7)


def test_a_palindrome_does_not_feel_a_linear_drift():
    drift = 1e-10
    plain, mirrored = (
        reduce(make_dwells(attitudes(3), LATITUDE, stops=s, drift=drift), FIELD)
        for s in (FOUR, PALINDROME)
    )
    want = four_numbers(attitudes(3), LATITUDE)[:, :2]
    np.testing.assert_allclose(mirrored.values[:, :2], want, atol=1e-13)
    # Published order at 65 s from stop to stop: M and N each off by half of a step of 65 s.
    np.testing.assert_allclose(plain.values[:, 1] - want[:, 1], -drift * 65 / 2, rtol=1e-4)
    np.testing.assert_allclose(plain.values[:, 0] - want[:, 0], -drift * 65 / 2, rtol=1e-4)
    np.testing.assert_allclose(plain.drift_slope[:, :2] * drift, plain.values[:, :2] - want,
                               rtol=1e-4)  # fmt: skip
    free = reduce(make_dwells(attitudes(3), LATITUDE, stops=PALINDROME, drift=drift), FIELD,
                  Nuisance(drift_sd=np.inf))  # fmt: skip
    np.testing.assert_allclose(free.drift, drift, rtol=1e-6)
    np.testing.assert_allclose(free.cov[:, :2, :2], mirrored.cov[:, :2, :2], atol=1e-22)


def test_accelerometers_of_the_case_are_means():
    """With coloured noise weighted by it; no component depends on the index angles."""
    d = make_dwells(attitudes(3), LATITUDE, stops=(90.0, 270.0), accel="case", noise=FIELD)
    pairs = reduce(d, FIELD)
    for k in range(3):
        np.testing.assert_allclose(pairs.values[k, 2:], d.of(k).accel.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        pairs.cov[:, [2, 3], [2, 3]], FIELD.accel.white**2 / 120.0, rtol=1e-6
    )
    assert not pairs.cov[:, 2, 3].any()


def test_without_accelerometers_tilt_is_unseen():
    pairs = reduce(make_dwells(attitudes(3), LATITUDE, accel=None), FIELD)
    assert not pairs.values[:, 2:].any()
    np.testing.assert_allclose(pairs.cov[0, 2:, 2:], UNSEEN * 9.8**2 * np.eye(2))
    assert np.isnan(pairs.accel_residuals).all()


def test_index_errors_turn_every_reading_by_itself():
    """Covariance against finite differences of the readings, weighed for it alike."""
    d = make_dwells(attitudes(3, 30.0), LATITUDE, stops=ORDERS["uneven"])
    index_sd = 1e-4
    pairs = reduce(d, FIELD, Nuisance(index_sd=index_sd))
    want = np.zeros((3, 4, 4))
    four = four_numbers(attitudes(3, 30.0), LATITUDE)
    for k in range(len(d)):
        ends = []
        for h in (1e-4, -1e-4):
            s, c = d.sine.copy(), d.cosine.copy()
            s[k], c[k] = np.sin(d.index[k] + h), np.cos(d.index[k] + h)
            pair = four[d.setup]
            moved = replace(d, gyro=c * pair[:, 1] + s * pair[:, 0],
                            accel=(c * pair[:, 3] + s * pair[:, 2])[:, None])  # fmt: skip
            ends.append(reduce(moved, FIELD, Nuisance(index_sd=index_sd)).values)
        slope = (ends[0] - ends[1]) / 2e-4
        want += index_sd**2 * np.einsum("mi,mj->mij", slope, slope)
    scale = np.array([EARTH_RATE, EARTH_RATE, 9.8, 9.8]) * index_sd
    found = pairs.sources[INDEXING] / np.outer(scale, scale)
    np.testing.assert_allclose(found, want / np.outer(scale, scale), atol=1e-6)
    assert np.trace(found[0]) > 1e-3


def test_set_ups_together_are_those_one_by_one():
    """Set-ups with the same stops share their weights; others stand between them."""
    parts = [
        make_dwells(attitudes(3), LATITUDE, stops=s, noise=FIELD, seed=i, offset=1e-6)
        for i, s in enumerate((FOUR, PALINDROME, ORDERS[3]))
    ]
    pick = [(0, 0), (1, 0), (0, 1), (2, 0), (2, 1), (0, 2), (1, 1)]
    rows = [parts[p].of(k) for p, k in pick]
    joined = Dwells(
        np.repeat(np.arange(7), [len(r) for r in rows]), tuple("abcdefg"),
        *(np.concatenate([getattr(r, name) for r in rows]) for name in
          ("start", "time", "index", "cosine", "sine", "gyro", "accel")),
        np.full(7, np.nan),
    )  # fmt: skip
    nuisance = Nuisance(0.0, 1e-5, 1e-9, 1e-4)
    together = reduce(joined, COLOURED, nuisance)
    for i in range(7):
        one = joined.of(i)
        alone = reduce(replace(one, setup=np.zeros(len(one), int), names=("x",),
                               heading=np.full(1, np.nan)), COLOURED, nuisance)  # fmt: skip
        for name in ("values", "offset", "drift", "chi_square", "dof", "drift_slope"):
            a, b = getattr(together, name)[i], getattr(alone, name)[0]
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
        for name, S in alone.sources.items():
            sd = np.sqrt(np.diag(S[0]))
            sd[sd == 0] = 1.0
            size = np.outer(sd, sd)  # what is 0 by symmetry is rounded
            found = together.sources[name][i] / size
            np.testing.assert_allclose(found, S[0] / size, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            together.residuals[joined.setup == i], alone.residuals, rtol=1e-6
        )


# -- against simulated noise ---------------------------------------------------------------------


def simulated(noise, motion, n=600, errors=None, rows="means", seed=4, pause=1e5):
    """Set-ups so far apart in time that their noise is independent."""
    setups = tuple(Placement(f"{i}", 0.4, 0.1, -0.2) for i in range(n))
    plan = NorthPlan(setups, motion, pause=pause)
    made = simulate_north(plan, model=ImuModel(), noise=noise, site=Site.at(LATITUDE),
                          errors=errors, rows=rows, rate=2.0, seed=seed)  # fmt: skip
    return find_dwells(made.log), four_numbers([[0.4, 0.1, -0.2]], LATITUDE)[0]


def consistent(pairs, truth, tests=8):
    """Sum of the NEES of the four numbers with its limits."""
    total = float(nees(pairs.values - truth, pairs.cov).sum())
    low, high = chi_square_limits(4 * len(pairs), tests=tests)
    return low < total < high


@pytest.mark.parametrize("order", [4, "palindrome"])
def test_coloured_noise_scatters_as_predicted(order):
    motion = Stops(np.radians(ORDERS[order]), np.full(len(ORDERS[order]), 60.0), 5.0)
    d, truth = simulated(COLOURED, motion)
    pairs = reduce(d, COLOURED)
    assert consistent(pairs, truth)
    assert {GYRO_DRIFT, TILT_DRIFT, GYRO_NOISE, TILT_NOISE} == set(pairs.sources)
    low, high = chi_square_limits(float(pairs.dof[:, 0].sum()), tests=8)
    assert low < pairs.chi_square[:, 0].sum() < high
    # It can fail: 10 % in the standard deviation, or colour taken for white noise.
    for wrong in (0.9, 1.1):
        other = {k: wrong**2 * S for k, S in pairs.sources.items()}
        assert not consistent(replace(pairs, sources=other), truth)
    white = ImuNoise(TriadNoise(COLOURED.accel.white), TriadNoise(COLOURED.gyro.white))
    assert not consistent(reduce(d, white), truth)


def test_a_drift_that_was_weighed_scatters_as_predicted():
    drift_sd = 3e-9
    truth = four_numbers([[0.4, 0.1, -0.2]], LATITUDE)[0]
    rng = np.random.default_rng(8)
    n = 600
    d = make_dwells(np.tile([[0.4, 0.1, -0.2]], (n, 1)), LATITUDE, stops=ORDERS["uneven"],
                    noise=FIELD, seed=9)  # fmt: skip
    slope = np.repeat(drift_sd * rng.standard_normal(n), 5)
    inside = d.start - np.repeat(d.start.reshape(n, 5)[:, 0], 5)
    d = replace(d, gyro=d.gyro + slope * inside)
    assert consistent(reduce(d, FIELD, Nuisance(drift_sd=drift_sd)), truth)
    assert not consistent(reduce(d, FIELD), truth)


@pytest.mark.thorough
def test_index_errors_scatter_as_predicted():
    motion = Stops(np.radians(PALINDROME), np.full(8, 60.0), 5.0)
    d, truth = simulated(FIELD, motion, errors=SeekerErrors(index_sd=2e-4))
    assert consistent(reduce(d, FIELD, Nuisance(index_sd=2e-4)), truth)
    assert not consistent(reduce(d, FIELD), truth)


def test_pieces_of_a_rotation_scatter_as_predicted():
    noise = ImuNoise(TriadNoise(3e-4), TriadNoise(9e-7))
    wrong = SeekerErrors(gyro_offset=20 * DEG_H, accel_offset=0.01)
    d, truth = simulated(noise, Rotation(3.0, np.radians(6.0)), n=60, rows="samples", pause=60.0,
                         errors=wrong)  # fmt: skip
    pairs = reduce(d, noise)
    assert len(d) > 60 * 30
    assert consistent(pairs, truth)
    # The mean over a whole number of turns: sd of c is sqrt(2) white / sqrt(T).
    want = 2 * noise.accel.white**2 / 180.0
    np.testing.assert_allclose(pairs.cov[:, 2, 2], want, rtol=0.03)


@pytest.mark.parametrize("noise", [FIELD, COLOURED], ids=["white", "coloured"])
def test_setups_of_other_times_are_reduced_together_as_each_alone(noise):
    d = make_dwells(attitudes(4), LATITUDE, stops=FOUR)
    rng = np.random.default_rng(5)
    d = replace(d, start=d.start + np.cumsum(rng.uniform(0.0, 3.0, len(d))),
                gyro=EARTH_RATE * rng.standard_normal(len(d)))  # fmt: skip
    nuisance = Nuisance(index_sd=1e-4, drift_sd=1e-9)
    together = reduce(d, noise, nuisance)
    for i in range(4):
        alone = reduce(d.setups(np.array([i])), noise, nuisance)
        np.testing.assert_allclose(together.values[i], alone.values[0], rtol=1e-9)
        np.testing.assert_allclose(together.cov[i], alone.cov[0], rtol=1e-9, atol=1e-22)
        rows = d.setup == i
        np.testing.assert_allclose(together.residuals[rows], alone.residuals, rtol=1e-6, atol=1e-9)
