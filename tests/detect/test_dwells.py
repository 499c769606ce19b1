"""Cutting the log of a north seeker into dwells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from foucault.detect.dwells import find_dwells, measured_noise
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    Rotation,
    Stops,
    simulate_north,
)
from refusals import refuses
from sessions import codes

SETUPS = (Placement("A", 0.3, 0.05, -0.1), Placement("B", 6.2, 0.1, 0.02))
FOUR = Stops(np.radians([0.0, 180.0, 90.0, 270.0]), np.array([60.0, 60.0, 45.0, 30.0]), 6.0)
QUIET = ImuNoise()
NOISY = ImuNoise(TriadNoise(white=2e-4), TriadNoise(white=3e-7))


def log_of(motion=FOUR, noise=QUIET, rows="samples", setups=SETUPS, **words):
    plan = NorthPlan(setups, motion)
    return simulate_north(plan, model=ImuModel(), noise=noise, site=Site.at(0.6), rows=rows,
                          **words).log  # fmt: skip


def test_means_are_dwells():
    log = log_of(rows="means")
    dwells = find_dwells(log)
    np.testing.assert_array_equal(dwells.gyro, log.gyro)
    np.testing.assert_array_equal(dwells.time, np.tile(FOUR.dwell, 2))
    np.testing.assert_allclose(dwells.cosine, np.tile([1, -1, 0, 0], 2), atol=1e-15)
    np.testing.assert_allclose(dwells.heading, [0.3, 6.2])
    assert dwells.names == ("A", "B") and dwells.interval == 0.0
    assert measured_noise(log, dwells) is None


@pytest.mark.parametrize("rate", [1.0, 10.0, 200.0])
def test_stops_are_found_to_the_sample(rate):
    """Each dwell is the stop, less the time to settle after a move; nothing of a move is in it."""
    log = log_of(rate=rate)
    dwells = find_dwells(log, settle=1.0)
    means = log_of(rows="means")
    np.testing.assert_array_equal(dwells.setup, means.setup)
    np.testing.assert_allclose(np.cos(dwells.index - means.index), 1.0, atol=1e-12)
    # A base that begins or ends a move stays within 0.1 deg of the stop for 10 ms or less.
    stop = np.tile(FOUR.dwell - [0.0, 1.0, 1.0, 1.0], 2)
    np.testing.assert_allclose(dwells.time, stop, atol=1.01 / rate + 0.01)
    np.testing.assert_allclose(dwells.gyro, means.gyro, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(dwells.accel, means.accel, atol=1e-5)
    np.testing.assert_allclose(dwells.heading, [0.3, 6.2])
    assert dwells.interval == pytest.approx(1 / rate) and codes(dwells) == []
    longer = find_dwells(log, settle=5.0)
    np.testing.assert_allclose(longer.time[1:4], dwells.time[1:4] - 4.0, atol=1.01 / rate)


def test_an_encoder_that_flickers_and_a_gap():
    log = log_of(rate=10.0)
    flicker = np.radians(0.04) * np.random.default_rng(2).integers(-1, 2, len(log))
    dwells = find_dwells(replace(log, index=(log.index + flicker) % (2 * np.pi)))
    np.testing.assert_allclose(dwells.time, find_dwells(log).time, atol=0.25)
    keep = np.flatnonzero((log.time < 20.0) | (log.time > 30.0))
    cut = find_dwells(log.rows(keep))
    assert len(cut) == 9
    np.testing.assert_allclose(cut.time[:2], [20.0, 29.9], atol=0.11)


@pytest.mark.parametrize(("turns", "pieces"), [(1.0, 72), (5.0, 200), (40.0, 480)])
def test_a_rotation_is_cut_into_pieces_with_exact_means(turns, pieces):
    log = log_of(Rotation(turns, np.radians(6.0)), rate=10.0, setups=SETUPS[:1])
    dwells = find_dwells(log)
    assert len(dwells) == pytest.approx(pieces, abs=1)
    assert dwells.time.sum() == pytest.approx(turns * 60.0, abs=0.2)
    # Readings are linear in cosine and sine, and so are their means.
    A = np.column_stack([dwells.cosine, dwells.sine])
    for x in (dwells.gyro, dwells.accel[:, 0]):
        left = x - A @ np.linalg.lstsq(A, x, rcond=None)[0]
        assert np.abs(left).max() < 1e-13 * max(1.0, np.abs(x).max() * 1e6)
    assert codes(dwells) == []


def test_a_slow_rotation_is_no_stop():
    dwells = find_dwells(log_of(Rotation(1.0, np.radians(0.05)), rate=1.0, setups=SETUPS[:1]))
    assert len(dwells) == pytest.approx(72, abs=1)
    assert np.ptp(dwells.index) > 6.0


def test_both_senses_in_one_setup():
    there = Stops(np.radians([0.0, 720.0, 0.0]), np.full(3, 2.0), 120.0)
    dwells = find_dwells(log_of(there, setups=SETUPS[:1]))
    assert len(dwells) > 100
    assert codes(dwells) == ["north.both_ways"]
    assert "In set-up 'A' the base turned in both senses" in dwells.findings[0].message


def test_means_that_do_not_say_how_long_they_last():
    """Rows 90 or 180 deg apart would pass for samples of a base that turns."""
    means = log_of(rows="means")
    with refuses("north.rows_apart") as caught:
        find_dwells(replace(means, averaged=None))
    assert "In set-up 'A' the index angle steps by 180 deg" in caught.value.message
    assert "dwell (s)" in caught.value.cure


def test_logs_without_dwells():
    short = Stops(np.radians([0.0, 90.0, 180.0]), np.full(3, 4.0), 2.0)
    with refuses("north.no_dwell") as caught:
        find_dwells(log_of(short))
    assert "its longest stop lasts 4" in caught.value.message
    assert '[log.averaged] with column = "dwell"' in caught.value.cure
    assert len(find_dwells(log_of(short), shortest=2.0)) == 6
    log = log_of()
    first = int(np.sum(log.setup == 0))
    tail = log.rows(np.arange(0, first + 20))  # two seconds of B
    dwells = find_dwells(tail)
    assert dwells.names == ("A",) and len(dwells.heading) == 1
    assert codes(dwells) == ["north.setup_without"]
    assert "Set-ups without a dwell of 5 s were left out, 1 in all: B" in dwells.findings[0].message


@pytest.mark.parametrize("motion", [FOUR, Rotation(3.0, np.radians(6.0))])
def test_noise_is_measured(motion):
    got, m = [], 0
    for seed in range(20):
        log = log_of(motion, NOISY, rate=20.0, seed=seed)
        dwells = find_dwells(log)
        noise = measured_noise(log, dwells)
        got.append((noise.gyro.white / 3e-7, noise.accel.white / 2e-4))
        stops = len(dwells) if isinstance(motion, Stops) else 2
        m += int(dwells.time.sum()) - stops
    # Differences of successive means are correlated by -1/2: the sum of the squares of m of them
    # spreads as that of 2 m / 3 independent ones.
    low, high = stats.chi2.ppf([0.00125, 0.99875], 2 * m / 3) / (2 * m / 3)
    for square in np.mean(np.square(got), axis=0):
        assert low < square < high


def test_dwells_too_short_to_measure_noise():
    log = log_of(Stops(np.zeros(1), np.full(1, 6.0)), NOISY, rate=1.0, setups=SETUPS[:1])
    assert measured_noise(log, find_dwells(log)) is None
