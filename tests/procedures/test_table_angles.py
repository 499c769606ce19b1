"""Angles of a table that were typed wrong in one position."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.diagnose.checks import foreseen_check
from foucault.diagnose.table import checks
from foucault.estimate.table import angle_start, fit
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.procedures import multi_position, on_table, turntable
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import TableColumns

SITE = Site(9.81, np.radians(45.0))
NOISE = grade("tactical").noise
PERFECT = {"plumb_sd": 0.0, "orthogonality_sd": 0.0, "zero_sd": 0.0, "position_sd": 0.0}


@cache
def simulated(module, plan, seed, rows="means", **_):
    session = module.Session(rows=rows, **(PERFECT if module is multi_position else {}))
    return module.simulate(
        session, settings=module.Settings(plan=plan), model=draw_errors("tactical", seed),
        noise=NOISE, site=SITE, seed=seed, judged=None,
    )  # fmt: skip


def calibrated(wrong, *, module=turntable, plan="icosahedron 12", seed=1, noise=NOISE, degrees=1.0,
               axis=1, rows="means"):  # fmt: skip
    sim = simulated(module, plan, seed, rows)
    table, angles = sim.log.table, sim.log.table.angles.copy()
    angles[np.isin(table.position, wrong), axis] += np.radians(degrees)
    log = replace(sim.log, table=TableColumns(angles, table.rate, table.position))
    result = module.calibrate(log, site=SITE, settings=module.Settings(plan=plan), noise=noise)
    c = result.coefficients
    error = c.values - sim.model.coefficients(c.names).values
    return result, float(error @ np.linalg.solve(c.cov, error))


def told(result, code="table.angle"):
    return [f.message for f in result.findings if f.code == code]


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [NOISE, None], ids=["declared", "unknown"])
@pytest.mark.parametrize("plan", ["icosahedron 12", "dodecahedron 20"])
def test_one_angle_typed_wrong_by_a_degree_is_named_and_not_used(noise, plan):
    clean, _ = calibrated([], plan=plan, noise=noise)
    for axis, name in ((1, "middle"), (2, "inner")):
        result, nees = calibrated([6], plan=plan, noise=noise, axis=axis)
        (message,) = told(result)
        assert "rest 7 " in message
        assert f"the {name} angle is about " in message
        assert "1 deg off" in message or "0.9" in message
        assert chi2.cdf(nees, 21) < 0.999
        sd = result.coefficients.sd / clean.coefficients.sd
        assert sd.max() < (1.3 if noise else 2.0)
        assert result.verdict.level is Level.PASS


def test_the_same_wrong_angle_at_rest_and_in_the_spin_is_named_in_both():
    result, nees = calibrated([6, 18])
    rest, spin = told(result)
    assert "rest 7 " in rest and "spin 7 " in spin
    assert "about 1 deg off" in rest
    assert chi2.cdf(nees, 21) < 0.999


def test_a_wrong_angle_of_a_log_of_samples_is_named():
    (message,) = told(calibrated([6], rows="samples")[0])
    assert "rest 7 " in message


def test_a_wrong_angle_that_is_believed_exactly_is_a_reading_left_out():
    result, nees = calibrated([6], module=multi_position)
    assert "specific force of rest 7 " in told(result, "readings.outlier")[0]
    assert chi2.cdf(nees, 21) < 0.999


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [NOISE, None], ids=["declared", "unknown"])
def test_angles_as_good_as_declared_are_not_blamed(noise):
    sessions = [calibrated([], seed=seed, noise=noise)[0] for seed in range(5)]
    assert sum(bool(told(r)) for r in sessions) == 0
    assert all(r.verdict.level is Level.PASS for r in sessions)


def test_a_reading_of_the_wrong_size_is_not_blamed_on_the_angle():
    sim = simulated(turntable, "dodecahedron 20", 1)
    accel = sim.log.accel.copy()
    accel[6] *= 1.003
    result = turntable.calibrate(
        replace(sim.log, accel=accel), site=SITE, noise=NOISE,
        settings=turntable.Settings(plan="dodecahedron 20"),
    )  # fmt: skip
    assert "specific force of rest 7 " in told(result, "readings.outlier")[0]
    assert not told(result)


def test_positions_that_look_alike_are_told_and_the_verdict_is_doubtful():
    sim = simulated(turntable, "icosahedron 12", 1)
    task = turntable.task_of(turntable.Settings(), SITE)
    readings = on_table.read_positions(sim.log, task, NOISE)
    options = on_table.options_of(readings, task, None)
    found = fit(readings, SITE, angle_start(readings, SITE, task.trust), options)
    name = "errors of the table"
    assert next(c for c in checks(found) if c.name == name).passed
    alike = replace(found, angle_suspects=(2, 4))
    failed = next(c for c in checks(alike) if c.name == name)
    assert not failed.passed
    assert "with this plan these look alike: rest 3 (189 s), rest 5 (315 s)." in failed.sentence


def test_an_uncertainty_many_times_that_of_the_plan_fails():
    result, _ = calibrated([])
    c = result.coefficients
    assert foreseen_check(c, c.sd / 3).passed
    failed = foreseen_check(c, c.sd / np.where(np.arange(len(c)) == 3, 83.0, 1.0))
    assert not failed.passed
    assert f"The uncertainty of {c.names[3]} is 83.0 times" in failed.sentence
    assert foreseen_check(c, np.full(len(c), np.nan)).passed
    assert "uncertainty against the plan" in [k.name for k in result.checks]
