"""White noise and random walk for estimators bound the Allan curve that was measured."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose.allan import Channel, LogAllan, measure, measure_log
from foucault.diagnose.bounding_pair import (
    FIRST,
    LEAST,
    MOST,
    RISE,
    SPAN,
    Pair,
    bounding_pair,
    pair_of,
    pairs,
)
from foucault.tables import Log
from make_alignment import real
from make_stretches import REAL_LOGS

RATE = 100.0
N, K = 2e-4, 2e-5


def noise(rng: np.random.Generator, n: int, flicker: float = 0.0, walk: float = K) -> np.ndarray:
    """Return white noise, a random walk, and a flat part as a sum of Markov processes."""
    from scipy.signal import lfilter

    x = rng.normal(size=n) * N * np.sqrt(RATE)
    x += np.cumsum(rng.normal(size=n)) * walk / np.sqrt(RATE)
    for time in 4.0 ** np.arange(-1, 5):
        a = np.exp(-1 / RATE / time)
        x += flicker * lfilter([1], [1, -a], rng.normal(size=n) * np.sqrt(1 - a**2))
    return x


@pytest.fixture(scope="module")
def channel() -> Channel:
    return measure(noise(np.random.default_rng(1), 300_000, 8e-5), 1 / RATE)


def holds(pair: Pair, channels: list[Channel]) -> None:
    """Look at the promise anew, from the deviations alone."""
    assert pair.first <= FIRST
    assert pair.last >= SPAN * pair.first
    for c in channels:
        inside = (c.tau >= pair.first * 0.999) & (c.tau <= pair.last * 1.001)
        assert inside.sum() >= 5
        ratio = np.sqrt(pair.white**2 / c.tau + pair.walk**2 * c.tau / 3)[inside]
        ratio /= c.deviation[inside]
        assert ratio.min() >= LEAST * (1 - 1e-9)
        if len(channels) == 1:
            assert ratio.max() <= MOST
            assert (ratio.min(), ratio.max()) == pytest.approx((pair.least, pair.most))
    assert pair.walk > 0
    assert pair.white <= RISE * max(c.noise("white").value for c in channels) * (1 + 1e-12)


def test_the_curve_is_bounded_where_n_and_k_of_the_fit_are_not(channel: Channel) -> None:
    pair = pair_of([channel])
    assert pair is not None
    holds(pair, [channel])
    inside = (channel.tau >= pair.first) & (channel.tau <= pair.last)
    white, walk = (channel.noise(n).value for n in ("white", "random_walk"))
    fitted = np.sqrt(white**2 / channel.tau + walk**2 * channel.tau / 3)[inside]
    assert (fitted / channel.deviation[inside]).min() < 0.9  # this is what people inflate for


def test_white_noise_and_a_walk_alone_are_left_as_they_are() -> None:
    tau = 2.0 ** np.arange(-6, 10)
    curve = np.sqrt(N**2 / tau + K**2 * tau / 3)
    pair = bounding_pair(tau, curve, curve, N)
    assert pair is not None
    assert (pair.white, pair.walk) == (pytest.approx(N, rel=1e-9), pytest.approx(K, rel=1e-9))
    assert (pair.first, pair.last, pair.seen) == (tau[0], tau[-1], True)
    assert pair.most == pytest.approx(1.0, rel=1e-9)


def test_without_a_walk_there_is_a_small_one() -> None:
    tau = 2.0 ** np.arange(-6, 10)
    curve = N / np.sqrt(tau)
    pair = bounding_pair(tau, curve, curve, N)
    assert pair is not None
    assert not pair.seen
    assert pair.white == pytest.approx(N)
    assert pair.most == pytest.approx(np.sqrt(1.1), rel=1e-9)
    np.testing.assert_allclose(pair.deviation(tau)[-1] / curve[-1], np.sqrt(1.1))


def test_what_is_steeper_than_both_is_not_bounded() -> None:
    tau = 2.0 ** np.arange(-6, 10)
    assert bounding_pair(tau, 1e-3 * tau, 1e-3 * tau, 1e-3) is None
    assert bounding_pair(tau[:3], tau[:3], tau[:3], 1.0) is None  # no factor of 30


def test_vibration_at_short_times_is_left_out_below() -> None:
    tau = 2.0 ** np.arange(-6, 10)
    curve = np.sqrt(N**2 / tau + K**2 * tau / 3)
    shaken = curve + np.where(tau < 0.1, 10 * curve, 0)
    pair = bounding_pair(tau, shaken, curve, N)
    assert pair is not None
    assert 0.1 < pair.first <= FIRST


def test_all_axes_of_a_triad_are_bounded(channel: Channel) -> None:
    rng = np.random.default_rng(2)
    other = measure(2 * noise(rng, 300_000, 2e-5), 1 / RATE)
    pair = pair_of([channel, other])
    assert pair is not None
    holds(pair, [channel, other])
    single = pair_of([other])
    assert single is not None
    assert pair.white == pytest.approx(single.white, rel=0.4)


def test_pairs_of_a_log_are_by_axis_and_triad() -> None:
    rng = np.random.default_rng(4)
    gyro = np.column_stack([noise(rng, 20_000, walk=1e-6) for _ in range(3)])
    log = Log(np.arange(20_000) / RATE, gyro, None, "rate")
    seen: LogAllan = measure_log(log)
    got = pairs(seen)
    assert list(got) == ["gyro.x", "gyro.y", "gyro.z", "gyro"]
    for name, pair in got.items():
        assert pair is not None
        holds(pair, [c for n, c in seen.channels.items() if n.startswith(name)])
    assert set(pairs(measure_log(log, kind="hadamard")).values()) == {None}


@pytest.mark.thorough
def test_instruments_of_every_kind_are_bounded() -> None:
    """100 records with any mixture of white noise, flicker, walk and rounding."""
    rng = np.random.default_rng(5)
    for _ in range(100):
        n = int(RATE * rng.choice([300, 600, 1800]))
        flicker = N * 10 ** rng.uniform(-2, 0.3) * (rng.random() < 0.8)
        x = noise(rng, n, flicker, N * 10 ** rng.uniform(-4, -1) * (rng.random() < 0.7))
        step = N * np.sqrt(RATE) * rng.choice([0, 0, 0.5, 1, 2])
        c = measure(np.round(x / step) * step if step else x, 1 / RATE)
        pair = pair_of([c])
        assert pair is not None
        holds(pair, [c])


@pytest.mark.parametrize("name", [n for n in REAL_LOGS if n != "19_positions"])
def test_real_instruments_at_rest(name: str) -> None:
    seen = measure_log(real(*REAL_LOGS[name]))
    got = pairs(seen)
    # Rings that are read out in steps fall by 1/tau, which no pair follows over a factor of 30.
    steep = {"ln100": set(got), "ring_laser": {"accel.z"}}.get(name, set())
    assert {key for key, pair in got.items() if pair is None} == steep
    for key, pair in got.items():
        if pair is not None:
            holds(pair, [c for n, c in seen.channels.items() if n.startswith(key)])


@pytest.mark.thorough
def test_the_noise_of_simulated_instruments_comes_back() -> None:
    """500 records: N of the fit covers the truth as often as its interval says, at 1 %."""
    from scipy.stats import binom

    rng = np.random.default_rng(7)
    covered = raised = 0
    for _ in range(500):
        c = measure(noise(rng, 6_000, walk=1e-5), 1 / RATE)
        pair = pair_of([c])
        assert pair is not None
        white = c.noise("white")
        covered += white.low <= N <= white.high
        raised += white.low <= pair.white / pair.raised <= white.high
        assert 1.0 <= pair.raised <= RISE
    low, high = binom.ppf((0.005, 0.995), 500, 0.95)
    assert low <= covered <= high
    assert raised == 500
