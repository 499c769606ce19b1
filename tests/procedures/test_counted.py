"""What is not estimated beside another body: taken out of readings, and what that moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import make_two
from foucault.coefficients import CoefficientVector
from foucault.estimate import two_imus as engine
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.left_out import sizes_of
from foucault.procedures.counted import Unit
from foucault.tables import Log

SITE = replace(Site.at(0.8), gravity=9.80665, gravity_sd=0.0)
NAMES = [n for n in LAYOUT.names if n.startswith(("gyro.bias", "gyro.scale", "accel.bias"))]


@pytest.fixture
def case():
    """Return an IMU with errors, 50 readings of it without terms, and so many times each term."""
    rng = np.random.default_rng(1)
    c = CoefficientVector(LAYOUT.subset(NAMES), 0.01 * rng.standard_normal(len(NAMES)))
    unit = Unit(c, np.linspace(0, 60, 50), SITE, sizes_of("consumer MEMS"))
    y = rng.standard_normal((50, 6)) * ([5.0] * 3 + [20.0] * 3)
    return unit, y, rng.standard_normal(len(unit.terms(y)))


def test_readings_without_terms_are_those_of_which_with_terms_were_made(case):
    unit, y, times = case
    read = y.copy()
    for one, k in zip(unit.terms(y), times, strict=True):
        read[:, one.triad] += k * one.read
    assert np.abs(read - y).max() > 0.02
    np.testing.assert_allclose(unit.without(read, times), y, atol=1e-5)


def test_what_terms_and_errors_change_is_what_another_number_of_them_does(case):
    """By differences of what is left of the same readings."""
    unit, read, times = case
    columns, follows = unit.added(unit.without(read, times), times)
    assert follows.tolist() == [-1] * len(times) + unit.rows

    def left(dx, dc):
        other = replace(unit, c=replace(unit.c, values=unit.c.values + dc))
        return other.without(read, times + dx)

    for k in (0, 30, len(times) - 1, len(times), len(follows) - 1):
        step = 1e-2 if k < len(times) else 1e-3
        d = step * (np.arange(len(follows)) == k)
        d = np.split(d, [len(times)])
        slope = (left(-d[0], -d[1]) - left(d[0], d[1])) / (2 * step)
        size = np.abs(slope).max()
        near = np.abs(read).min(axis=1) > 0.2  # where a rate changes its sign it has no derivative
        np.testing.assert_allclose(columns[near, :, k], slope[near], atol=0.02 * size)


def test_a_solution_of_changed_readings_is_what_was_answered():
    """One linear solve a term says what passes from a start find."""
    made, truths = make_two.session(3, duration=20.0)
    t = truths[0]
    readings = [engine.Readings.of(Log(*one)) for one in made]
    start = engine.Slave.started(t["C_cb"], t["lever"], t["tau"], t["kappa"])
    known = [(1e-3, 1e-2), (2.3e-3, 2.8e-2)]
    problem = engine.problem_of(readings, [start], {}, known, 0.02, ("gyro.g_sensitivity",))
    s = engine.solve(problem, [start], 20)
    each = []
    for f in (r.read[:, 3:] for r in readings):
        added = np.zeros((len(f), 6, 2))
        added[:, 0, 0], added[:, 4, 1] = 2e-4 * f[:, 2], 2e-4 * f[:, 0] ** 2
        each.append(added)
    found = engine.answers(s, each)
    for k, (one, column) in enumerate(np.ndindex(2, 2)):
        more = list(readings)
        more[one] = replace(more[one], read=more[one].read + each[one][:, :, column])
        again = engine.solve(replace(problem, readings=tuple(more)), s.slaves, 20)
        sd, moved = np.sqrt(np.diag(s.cov)), again.values - s.values
        kept = np.setdiff1d(np.arange(len(sd)), problem.hold)
        assert np.abs(moved[kept] / sd[kept]).max() > 1.0
        np.testing.assert_allclose(found.A[kept, k] / sd[kept], moved[kept] / sd[kept], atol=0.1)

        def rows(x):
            sds = np.repeat(np.sqrt(s.var), 3, axis=1)
            return np.concatenate(
                [(np.nan_to_num(y) / d).ravel() for y, d in zip(x, sds, strict=True)]
            )

        E = rows(again.left) - rows(s.left)
        assert found.gram[k, k] == pytest.approx(E @ E, rel=0.02)
        assert found.pull[k] == pytest.approx(E @ rows(s.left), abs=0.02 * np.sqrt(E @ E))
