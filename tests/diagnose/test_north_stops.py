"""Stops with biases of their own: found where they are there, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.north_stops import SIGNIFICANT, stop_gains, stop_offsets, without
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures.north_seeking import Session, calibrate, simulate
from foucault.procedures.north_seeking.fix import find_north
from foucault.result import Level

SITE = Site.at(0.8)
DEG_H = np.radians(1 / 3600)
NOISE = ImuNoise(TriadNoise(5e-5), TriadNoise(white=5e-7))


def session(size, seed=3, **words):
    return simulate(
        Session(twice_per_turn_sd=size, **words), model=ImuModel(), noise=NOISE, site=SITE,
        seed=seed,
    )  # fmt: skip


def test_four_biases_of_four_stops_are_found_as_far_as_no_rate_makes_them():
    made = session(0.3 * DEG_H)
    result = calibrate(made.log, site=SITE, noise=NOISE)
    found = result.diagnostics["stop_offsets"]
    assert set(found) == {"0", "90", "180", "270"}
    even = made.errors.twice_per_turn[0]
    sd = 5e-7 / np.sqrt(120.0) / 2 / np.sqrt(12)  # of the combination, over twelve set-ups
    for stop, sign in (("0", 1), ("180", 1), ("90", -1), ("270", -1)):
        assert abs(found[stop] - sign * even) < 4 * sd
    code = next(f for f in result.findings if f.code == "north.stop_offsets")
    assert "reads the same amounts too much in every set-up" in code.message
    assert result.verdict.level is Level.PASS


def test_without_it_every_fix_would_be_doubtful():
    made = session(1.0 * DEG_H)
    result = calibrate(made.log, site=SITE, noise=NOISE)
    good = find_north(made.log, site=SITE, noise=NOISE, calibration=result)
    bad = find_north(made.log, site=SITE, noise=NOISE)
    assert all(v.level is Level.PASS for v in good.verdicts)
    assert not any(v.level is Level.PASS for v in bad.verdicts)
    # It cancels in the rates of opposite stops: the headings are the same.
    from_biased = reduce(bad.dwells, NOISE).values
    np.testing.assert_allclose(reduce(good.dwells, NOISE).values, from_biased, atol=1e-15)


def test_chance_is_not_taken_for_it():
    """1 in 1000 by its limit: 60 sessions with more than 2 would be one chance in 30,000."""
    from foucault.detect.dwells import find_dwells

    dwells = [find_dwells(session(0.0, seed).log) for seed in range(60)]
    chances = np.array([stop_offsets(d, NOISE, Nuisance())[1] for d in dwells])
    assert np.sum(chances < SIGNIFICANT) <= 2
    assert 0.35 < chances.mean() < 0.65  # evenly spread: 4 sd of a mean of sixty


def test_few_set_ups_and_other_stops_are_left_alone():
    from foucault.detect.dwells import find_dwells

    few = find_dwells(session(1.0 * DEG_H, headings=5).log)
    assert stop_offsets(few, NOISE, Nuisance()) == ({}, 1.0)
    off = without(few, {"45": 1.0})
    np.testing.assert_array_equal(off.gyro, few.gyro)
    moved = without(few, {"90": 1.0})
    assert np.sum(moved.gyro != few.gyro) == 5
    assert moved.gyro[2] == pytest.approx(few.gyro[2] - 1.0)


GAIN = np.array([[2e-3, -1e-3], [-2e-3, 3e-3], [1e-3, 2e-3], [-3e-3, 1e-3]])
"""What the stops 0, 90, 180, 270 read more of the rates along x_b and y_b [1]."""


def with_senses(made):
    """The log of a gyro whose gains and cross terms differ from stop to stop."""
    log = made.log
    heading, level = log.heading, EARTH_RATE * np.cos(SITE.latitude)
    rates = level * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    stop = np.round(np.degrees(log.index) / 90).astype(int) % 4
    return replace(log, gyro=log.gyro + np.einsum("ni,ni->n", GAIN[stop], rates))


def test_gains_of_two_senses_are_found_apart_and_later_fixes_are_not_doubtful():
    noise = ImuNoise(TriadNoise(5e-5), TriadNoise(white=5e-8))
    made = simulate(Session(), model=ImuModel(), noise=noise, site=SITE, seed=3)
    result = calibrate(with_senses(made), site=SITE, noise=noise)
    assert result.verdict.level is Level.PASS
    told = next(f for f in result.findings if f.code == "north.stop_gains")
    assert "differ from one sense of the base to the other by up to" in told.message
    # As far as no rate makes them: the combination 0 + 180 - 90 - 270.
    found = result.diagnostics["stop_gains"]
    even = (GAIN[0] + GAIN[2] - GAIN[1] - GAIN[3]) / 4
    sd = 5e-8 / np.sqrt(120.0) / 2 / (EARTH_RATE * np.cos(SITE.latitude) * np.sqrt(6))
    for stop, sign in (("0", 1), ("180", 1), ("90", -1), ("270", -1)):
        np.testing.assert_allclose(found[stop], sign * even, atol=4 * sd)
    again = simulate(Session(), model=ImuModel(), noise=noise, site=SITE, seed=8)
    log = with_senses(again)
    fix = find_north(log, site=SITE, noise=noise, calibration=result)
    assert all(v.level is Level.PASS for v in fix.verdicts)
    bare = replace(result, diagnostics=result.diagnostics | {"stop_gains": {}})
    without_it = find_north(log, site=SITE, noise=noise, calibration=bare)
    assert not any(v.level is Level.PASS for v in without_it.verdicts)


@pytest.mark.thorough
def test_chance_is_not_taken_for_gains():
    from foucault.detect.dwells import find_dwells

    dwells = [find_dwells(session(0.0, seed).log) for seed in range(60)]
    chances = np.array([stop_gains(d, NOISE, Nuisance())[1] for d in dwells])
    assert np.sum(chances < 0.01) <= 4  # 0.6 are expected
    assert 0.35 < chances.mean() < 0.65
