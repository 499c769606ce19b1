"""Spins that end on whole turns, with nothing logged of the moves between positions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures import norm_observation, turntable
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import TableColumns

SITE = Site(9.81, np.radians(45.0))
NOISE = ImuNoise(gyro=TriadNoise(white=5e-6), accel=TriadNoise(white=2e-4))
SPINS = {1.0: (10.0, 4), 20.0: (20.0, 4), 100.0: (40.0, 2)}
"""Sample rate -> rate of the spins [deg/s] and their turns."""


@cache
def simulated(rate, kind, seed):
    spin, turns = SPINS[rate]
    settings = norm_observation.Settings(spin_rate=np.radians(spin))
    session = norm_observation.Session(rate=rate, kind=kind, turns=turns, rest_time=20.0)
    return settings, norm_observation.simulate(
        session, settings=settings, model=draw_errors("tactical", seed), noise=NOISE, site=SITE,
        seed=seed,
    )  # fmt: skip


def whole_turns_only(sim, rate, *, angles=True, less=0):
    """Keep the rests, and of every spin the rows of its whole turns or `less`; drop the moves."""
    spin, turns = SPINS[rate]
    rows = round(turns * 360 / spin * rate) - less
    keep = np.zeros(len(sim.log), bool)
    for a, b, steady in zip(sim.first, sim.last, sim.plan.rate, strict=True):
        keep[a : a + rows if steady else b] = True
    log, table = sim.log, sim.log.table
    return replace(
        log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep],
        table=TableColumns(table.angles[keep], None, None) if angles else None,
    )  # fmt: skip


def calibrated(rate, kind, seed, module=norm_observation, **kept):
    settings, sim = simulated(rate, kind, seed)
    settings = module.Settings(spin_rate=settings.spin_rate)
    log = whole_turns_only(sim, rate, **kept)
    result = module.calibrate(log, site=SITE, settings=settings, noise=NOISE)
    c = result.coefficients
    error = c.values - sim.model.coefficients(c.names).values
    return result, float(error @ np.linalg.solve(c.cov, error))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("angles", [True, False], ids=["outer", "nothing"])
@pytest.mark.parametrize("less", [0, 1])
def test_spins_of_exactly_whole_turns_at_20_hz(kind, angles, less):
    result, nees = calibrated(20.0, kind, 1, angles=angles, less=less)
    assert result.verdict.level is Level.PASS
    assert chi2.cdf(nees, 21) < 0.999
    assert result.coefficients["gyro.scale"].sd.max() < 20e-6
    assert not [f for f in result.findings if f.severity != "note"]


@pytest.mark.thorough
@pytest.mark.parametrize("module", [norm_observation, turntable], ids=["norm", "turntable"])
@pytest.mark.parametrize("rate", SPINS)
@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_errors_are_inside_their_covariance_whatever_the_sample_rate(module, rate, kind):
    sessions = 6
    for angles in (True, False) if module is norm_observation else (True,):
        total = sum(
            calibrated(rate, kind, seed, module, angles=angles, less=seed % 3)[1]
            for seed in range(sessions)
        )
        assert chi2.ppf(5e-4, 21 * sessions) < total < chi2.ppf(1 - 5e-4, 21 * sessions)


def test_a_spin_that_ends_on_a_whole_turn_is_not_averaged_beyond_its_samples():
    from foucault.detect.readings import find_readings

    settings, sim = simulated(1.0, "increment", 1)
    log = whole_turns_only(sim, 1.0, less=1)
    found = find_readings(log, spin_rate=settings.spin_rate)
    spin = found.spin
    assert spin.sum() == 12
    np.testing.assert_array_equal(found.turns[spin], 3)
    np.testing.assert_allclose(found.rate[spin], settings.spin_rate, rtol=1e-9)
    np.testing.assert_allclose(found.time[spin], 3 * 36.0, rtol=1e-9)


def test_means_beside_missing_samples_are_those_of_the_samples():
    """At 1 Hz half an interval towards the next position would be 10 deg/s of somewhere else."""
    from foucault.detect.readings import find_readings

    sim = simulated(1.0, "rate", 1)[1]
    log = whole_turns_only(sim, 1.0)
    found = find_readings(log, spin_rate=np.radians(10.0))
    for start, time, rest, mean in zip(
        found.start, found.time, ~found.spin, found.gyro, strict=True
    ):
        inside = (log.time > start) & (log.time < start + time)
        assert inside.sum() == round(time)
        if rest:
            np.testing.assert_allclose(mean, log.gyro[inside].mean(axis=0), rtol=1e-9, atol=1e-12)


def stretched(factor, module=norm_observation, **settings):
    """Calibrate a log whose stamps run too fast by a factor."""
    settings = {"spin_rate": np.radians(30.0)} | settings
    told = norm_observation.Settings(spin_rate=np.radians(30.0))
    session = norm_observation.Session(rate=20.0, turns=2, rest_time=20.0)
    sim = norm_observation.simulate(
        session, settings=told, model=draw_errors("tactical", 1), noise=NOISE, site=SITE, seed=1
    )
    table = TableColumns(sim.log.table.angles, None, None)
    log = replace(sim.log, time=sim.log.time * factor, table=table)
    return module.calibrate(log, site=SITE, settings=module.Settings(**settings), noise=NOISE)


@pytest.mark.thorough
@pytest.mark.parametrize("module", [norm_observation, turntable], ids=["norm", "turntable"])
def test_stamps_wrong_by_a_thousandth_contradict_the_declared_rate(module):
    result = stretched(1.001, module)
    (told,) = [f for f in result.findings if f.code == "spin.rate_clock"]
    assert "declared with 30 deg/s" in told.message
    assert "says 29.97 deg/s: -999 ppm, and the table's rate is good to 100 ppm" in told.message
    assert result.verdict.level is Level.DOUBTFUL
    assert [c.name for c in result.checks if not c.passed] == ["rate of the table"]


@pytest.mark.thorough
def test_the_tables_own_tolerance_decides_about_the_clock():
    codes = lambda result: [f.code for f in result.findings]  # noqa: E731
    assert "spin.rate_clock" not in codes(stretched(1.0))
    assert "spin.rate_clock" not in codes(stretched(1.0002))
    assert "spin.rate_clock" not in codes(stretched(1.001, table_rate_sd=5e-4))
    # A rate that nobody declared is that of the default, and says nothing.
    assert norm_observation.Settings().spin_rate == pytest.approx(np.radians(10.0))
    assert "spin.rate_clock" not in codes(stretched(1.001, spin_rate=np.radians(30.0) * 0.999))
