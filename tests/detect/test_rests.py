"""Rests are found where they are, and their noise is measured as it was made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.noise import measure_noise
from foucault.detect.stretches import (
    How,
    Rests,
    detection_table,
    find_rests,
    moments_of,
    rest_table,
    runs,
    trimmed,
)
from foucault.diagnose.live import inspect
from foucault.estimate.hand_rotated import find_published_rests
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.simulate.hand_rotated import simulate
from foucault.tables import Log
from make_session import SITE, quiet_session, short_plan


def made(name="mems", rests=12, **words):
    noise = words.pop("noise", grade(name).noise)
    return simulate(short_plan(rests), model=ImuModel(), noise=noise, site=SITE, seed=1, **words)


@pytest.mark.parametrize("name", ["mems", "tactical", "navigation"])
@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_every_rest_is_found_inside_its_quiet(name, sampled):
    simulation = made(name, sampled=sampled)
    rests = find_rests(simulation.log)
    assert len(rests) == 12
    half = rests.window // 2
    # Not before the motion ends, unless the noise hides its last millimetres: a window apart.
    assert (rests.first > simulation.first - half // 2).all()
    assert (rests.last < simulation.last + half // 2).all()
    assert (rests.first[1:] < simulation.first[1:] + 2 * half).all()
    assert (rests.last[:-1] > simulation.last[:-1] - 2 * half).all()
    assert rests.findings == ()


@pytest.mark.parametrize("shaken", [0.0, 0.05])
def test_a_turn_that_begins_gently_is_no_part_of_a_rest_that_is_shaken(shaken):
    """A turn of a quintic in time, of 2 pi in six seconds; .2 g rms shake all of it."""
    t, end = np.arange(0, 26, 0.01), 10.0
    x = np.clip((t - end) / 6, 0, 1)
    rate = 2 * np.pi / 6 * (30 * x**2 - 60 * x**3 + 30 * x**4)
    rng, shake = np.random.default_rng(3), np.sin(2 * np.pi * 17.3 * t)
    gyro = rng.normal(0, 1e-3, (len(t), 3)) + shaken * shake[:, None] + [0.0, 0.0, 0.01]
    accel = rng.normal(0, 0.01, (len(t), 3)) + 56 * shaken * shake[:, None] + [0, 0, 9.8]
    gyro[:, 2] += rate
    log = Log(t, gyro, accel)
    rests = find_rests(log)
    last, first = rests.last[0], rests.first[-1]  # the fastest of the turn is steady, too
    assert rate[:last].sum() * 0.01 < 1e-4
    assert rate[first:].sum() * 0.01 < 1e-4
    # Not more is cut than the windows that the turn is in.
    assert end - 0.5 < t[last] < end + 0.25
    level, half = rests.level, rests.window // 2
    means, _ = moments_of(gyro, 2 * half + 1)
    rows = np.array([half, 1600 + half]), np.array([1000 + half, len(t) - half])
    by_scatter, by_both = (np.array(trimmed(level, *rows, 100, x)) for x in (None, means))
    assert np.array_equal(by_scatter, by_both) == (shaken == 0)


@pytest.mark.parametrize("missing", ["accel", "gyro"])
def test_one_triad_is_enough(missing):
    log = replace(made().log, **{missing: None})
    assert len(find_rests(log)) == 12


def test_a_threshold_can_be_given():
    log = made().log
    assert find_rests(log, How(threshold=2.5)).threshold == 2.5
    assert len(find_rests(log, How(shortest=2.5))) < 12
    # Anything is quiet below a threshold that nothing exceeds: one long rest.
    assert len(find_rests(log, How(threshold=1e9))) == 1


def test_a_log_without_motion_is_one_rest():
    rng = np.random.default_rng(2)
    time = np.arange(2000) / 100
    log = Log(time, rng.normal(0, 1e-3, (2000, 3)), rng.normal(0, 0.01, (2000, 3)))
    rests = find_rests(log)
    assert len(rests) == 1
    assert rests.last[0] - rests.first[0] == 2000 - rests.window + 1


def test_runs():
    quiet = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], bool)
    first, last = runs(quiet, 2)
    assert first.tolist() == [0, 6] and last.tolist() == [2, 9]
    assert runs(np.zeros(5, bool), 1)[0].size == 0


def test_published_rests_follow_the_recipe_to_the_letter():
    log = made("mems").log
    rests = find_published_rests(log, initial_rest=2.0, factor=6.0, window=51, shortest=50)
    start = log.accel[: np.searchsorted(log.time, 2.0)]
    limit = 6.0 * np.linalg.norm(start.var(axis=0, ddof=1))
    quiet = np.zeros(len(log), bool)
    for i in range(25, len(log) - 25):
        part = log.accel[i - 25 : i + 26]
        quiet[i] = np.linalg.norm(part.var(axis=0, ddof=1)) < limit
    first, last = runs(quiet, 50)
    np.testing.assert_array_equal(rests.first, first)
    np.testing.assert_array_equal(rests.last, last)
    assert rests.threshold == pytest.approx(np.sqrt(6))


def _noise_power(x, log, simulation):
    zero = np.zeros(1)
    rests = Rests(simulation.first, simulation.last, zero, zero, zero, 1.0, 51)
    return measure_noise(x, log.interval, rests)


def test_white_noise_is_measured():
    simulation = made("tactical", 24)
    log, noise = simulation.log, grade("tactical").noise
    blocks = int(np.sum((simulation.last - simulation.first) // 20 - 1))
    # Successive differences of m blocks of white noise have 2/3 of their degrees of freedom.
    low, high = chi_square_limits(blocks * 2 / 3, tests=6)
    for x, triad in ((log.accel, noise.accel), (log.gyro, noise.gyro)):
        got = _noise_power(x, log, simulation)
        ratio = got.psd / triad.white**2 * blocks * 2 / 3
        assert (low < ratio).all() and (ratio < high).all()


def test_slow_motion_in_the_rests_makes_their_means_worse():
    simulation = made("tactical", 24)
    log = simulation.log
    sway = 0.02 * np.sin(2 * np.pi * 0.5 * log.time)[:, None]
    still = _noise_power(log.accel, log, simulation)
    moving = _noise_power(log.accel + sway, log, simulation)
    assert (moving.psd_of_mean > 10 * still.psd_of_mean).all()


def test_tables_of_rests_and_detection():
    log = made().log
    rests = find_rests(log)
    table = rest_table(log, rests)
    assert table["accel_z"][0] == pytest.approx(SITE.gravity, abs=0.01)
    assert (table["end"] > table["start"]).all()
    detection = detection_table(log, rests, rows=100)
    assert len(detection["time"]) <= 100
    # Peaks are kept: the largest level of the log is in the thinned table.
    assert np.nanmax(detection["level"]) == np.nanmax(rests.level)
    assert "gyro_x" not in rest_table(replace(log, gyro=None), rests)


def test_inspection_tells_rate_gaps_noise_and_rests():
    log = made("tactical").log
    keep = np.r_[0:400, 450 : len(log)]
    gappy = Log(log.time[keep], log.gyro[keep], log.accel[keep])
    seen = inspect(gappy)
    assert seen.gaps == 1
    assert seen.longest == pytest.approx(0.51)
    assert seen.shortest == pytest.approx(0.01)
    assert len(seen.rest_rows["start"]) == len(seen.rests)
    # Eleven or twelve rests of some two seconds: white noise to a tenth at many sd.
    assert seen.accel.noise == pytest.approx(np.full(3, 30e-6 * 9.80665), rel=0.3)
    assert seen.accel.highest.max() <= log.accel.max()
    alone = inspect(replace(log, gyro=None))
    assert alone.gyro is None


def test_a_noise_free_log_has_rests_too():
    log = quiet_session(100.0).log
    assert len(find_rests(log)) == 14
    noise = ImuNoise(TriadNoise(quantisation=1e-3), TriadNoise(quantisation=1e-5))
    assert len(find_rests(made(noise=noise).log)) == 12
