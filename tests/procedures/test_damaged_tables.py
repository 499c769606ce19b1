"""Damaged logs of a table end in words, never in what NumPy says of a matrix."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault import procedures
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.procedures import multi_position, norm_observation, on_table, turntable
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import TableColumns
from refusals import refuses

SITE = Site(9.81, np.radians(45.0))
NOISE = grade("tactical").noise


@cache
def simulated(rows):
    session = turntable.Session(rows=rows, rest_time=10.0, turns=1, rate=4.0)
    settings = turntable.Settings(spin_rate=np.radians(30.0))
    return turntable.simulate(
        session, settings=settings, model=draw_errors("tactical", 1), noise=NOISE, site=SITE, seed=1
    ).log


def log_of(rows, columns):
    log = simulated(rows)
    angles = log.table.angles.copy()
    angles[:, [c not in columns for c in ("outer", "middle", "inner")]] = np.nan
    rate = None if rows == "samples" else log.table.rate
    return replace(log, table=TableColumns(angles, rate))


def swapped(log):
    return replace(log, accel=log.accel[:, [1, 0, 2]])


def of_axis(triad, axis, factor):
    def damage(log):
        x = getattr(log, triad).copy()
        x[:, axis] *= factor
        return replace(log, **{triad: x})

    return damage


def constant(triad, value):
    return lambda log: replace(log, **{triad: np.full_like(getattr(log, triad), value)})


DAMAGE = {
    "accel x, y exchanged": swapped,
    "accel y in g": of_axis("accel", 1, 1 / 9.8),
    "accel z reversed": of_axis("accel", 2, -1.0),
    "accel x dead": of_axis("accel", 0, 0.0),
    "accel dead": constant("accel", 0.0),
    "accel constant": constant("accel", 3.0),
    "gyro x dead": of_axis("gyro", 0, 0.0),
    "gyro dead": constant("gyro", 0.0),
    "gyro constant": constant("gyro", 0.1),
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("rows", "columns"), [("means", "outer middle inner"), ("samples", "middle inner")]
)
@pytest.mark.parametrize("name", DAMAGE)
def test_no_damage_ends_in_a_pass_or_in_a_word_of_numpy(name, rows, columns):
    log = DAMAGE[name](log_of(rows, columns.split()))
    for module in (turntable, norm_observation, multi_position):
        settings = module.Settings(spin_rate=np.radians(30.0))
        try:
            result = module.calibrate(log, site=SITE, settings=settings, noise=NOISE)
        except FoucaultError as problem:
            assert problem.code != "solution.singular"
            if name in ("gyro dead", "gyro constant"):
                assert problem.code in ("readings.gyro_constant", "spin.rate", "table.rate_differs")
        else:
            assert result.verdict.level is not Level.PASS


def test_gyros_that_read_the_same_all_the_time_are_named():
    log = constant("gyro", 0.1)(log_of("samples", ["middle", "inner"]))
    settings = turntable.Settings(spin_rate=np.radians(30.0))
    with refuses("readings.gyro_constant") as problem:
        turntable.calibrate(log, site=SITE, settings=settings)
    assert "All gyros read the same in every rest and every spin" in str(problem.value)


def test_the_angle_that_is_lacking_is_the_one_that_is_named():
    log = log_of("means", ["outer", "middle", "inner"])
    settings = turntable.Settings(spin_rate=np.radians(30.0))
    task = turntable.task_of(settings, SITE)
    readings = on_table.read_positions(log, task, NOISE)
    for lacking, said in (([0], "needs the outer angle of every"),
                          ([1, 2], "needs the middle and inner angle of every")):  # fmt: skip
        angles = readings.angles.copy()
        angles[3, lacking] = np.nan
        with refuses("readings.no_angles") as problem:
            on_table.from_readings(replace(readings, angles=angles), task, site=SITE)
        assert said in str(problem.value)


def test_equations_without_a_solution_are_told_as_such():
    with refuses("solution.singular") as problem, procedures.solvable():
        np.linalg.inv(np.zeros((2, 2)))
    assert "cannot be solved (Singular matrix)" in str(problem.value)
