"""Means whose noise nobody declared: what residuals tell of it, and what they follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import finding
from foucault.infer.drift import find_left_out
from foucault.infer.gauss_newton import TOLD, student
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.plans.directions import table_plan
from foucault.procedures import norm_observation, on_table, six_position
from foucault.result import Level, Linearised
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import simulate_readings
from foucault.tables import Log

SITE = Site(9.81, np.radians(45.0))
QUADRATIC = 100e-6 / 9.80665  # 100 ug/g^2


def means(kind="clean", *, plan="icosahedron 12", instrument="tactical", seed=1, spins=True):
    """Return readings without a noise, and the instrument that they are of."""
    model = draw_errors(instrument, seed)
    if kind == "quadratic":
        K = np.zeros((3, 6))
        K[:, :3] = QUADRATIC * np.diag(np.random.default_rng(seed).choice([-1, 1], 3))
        model = replace(model, accel_quadratic=K)
    chosen = table_plan(plan, spin_rate=np.radians(10), rest_time=60.0, turns=4, spins=spins)
    noise = grade(instrument).noise
    r = simulate_readings(chosen, models=model, noise=noise, site=SITE, seed=seed).readings(0)
    if kind == "warming":  # scale factors change by 1000 ppm during the session
        now = 1e-3 * (r.start - r.start.mean()) / np.ptp(r.start)
        r = replace(r, accel=r.accel * (1 + now[:, None]), gyro=r.gyro * (1 + now[:, None]))
    n, eye = len(r), np.eye(3)
    unknown = replace(
        r, declared=False, findings=(finding("readings.noise_unknown"),),
        accel_cov=np.tile(1e-12 * eye, (n, 1, 1)), gyro_cov=np.tile(1e-18 * eye, (n, 1, 1)),
    )  # fmt: skip
    return unknown, model


def calibrated(kind="clean", **options):
    r, model = means(kind, **options)
    settings = norm_observation.Settings(plan=options.get("plan", "icosahedron 12"))
    result = on_table.from_readings(r, norm_observation.task_of(settings), site=SITE)
    c = result.coefficients
    miss = c.values - model.coefficients(c.names).values
    return result, float(miss @ np.linalg.solve(c.cov, miss)) / len(miss)


def failed(result):
    return [c.name for c in result.checks if not c.passed]


def test_a_clean_session_without_a_noise_passes():
    result, _ = calibrated()
    assert result.verdict.level is Level.PASS and not failed(result)


def test_quadratic_terms_show_in_residuals_of_any_size():
    result, nees = calibrated("quadratic")
    assert nees > 3  # scatter does not cover what is no scatter
    assert "quadratic terms of the accelerometers" in failed(result)
    words = " ".join(result.verdict.reasons)
    assert "The residuals follow quadratic terms of the accelerometers" in words
    assert "ug/g^2" in words and "accel_quadratic = true" in words


def test_an_instrument_that_warms_up_is_no_pass_without_a_noise():
    result, nees = calibrated("warming")
    assert nees > 10
    assert "drift" in failed(result)


def test_twelve_rests_do_not_tell_the_noise_of_accelerometers():
    """Twelve lengths of gravity for nine unknowns: three numbers are left."""
    r, _ = means(spins=False)
    settings = norm_observation.Settings(plan="icosahedron 12")
    alone = replace(r, gyro=None)
    result = on_table.from_readings(alone, norm_observation.task_of(settings), site=SITE)
    assert result.verdict.level is Level.DOUBTFUL
    words = " ".join(result.verdict.reasons)
    assert "the residuals do not tell it (3 redundant, 4 needed)" in words
    assert "Declare [noise]" in words


def test_six_faces_do_not_pass_where_residuals_leave_no_noise():
    up = np.concatenate([np.eye(3), -np.eye(3)])
    rng = np.random.default_rng(1)
    accel = SITE.gravity * up + rng.normal(0, 1e-3, (6, 3))
    log = Log(np.arange(6.0), None, accel, averaged=np.full(6, 60.0))
    result = six_position.calibrate(log, site=SITE)
    told = next(c for c in result.checks if c.name == "noise of specific force at rest")
    assert told.low == TOLD and told.passed == (told.value >= TOLD)
    assert "redundant" in told.sentence


def test_the_factor_of_student():
    assert student(4.0) == student(1.0) == pytest.approx(np.sqrt(2))
    assert student(1e9) == pytest.approx(1.0)
    from scipy.stats import t

    assert student(7.0) == pytest.approx(t(7).std())


def test_terms_left_out_are_found_at_their_size_and_at_the_stated_rate():
    """The F test rejects 1 % of what is chance, whatever the noise is, and sees what is there."""
    rng = np.random.default_rng(3)
    J, extra, blocks = rng.normal(size=(40, 6)), rng.normal(size=(40, 2)), np.arange(40)
    alarms = 0
    for _ in range(400):
        r = 7.0 * rng.normal(size=40)
        found = find_left_out(Linearised(r, J, blocks), ("a", "b"), extra)
        alarms += found.significant
    assert 0 <= alarms <= 11  # 4 expected; more than 11 with a probability of .1 %
    found = find_left_out(Linearised(r + extra @ [20.0, 0.0], J, blocks), ("a", "b"), extra)
    assert found.significant
    assert abs(found.size[0] - 20.0) < 4 * found.sd[0]
    assert abs(found.size[1]) < 4 * found.sd[1]
    hidden = find_left_out(Linearised(r, J, blocks), ("a",), J[:, :1])
    assert hidden is None  # the unknowns take it up


@pytest.mark.thorough
def test_the_uncertainties_of_unknown_noise_are_those_of_student():
    """Clean sessions pass, but for what chance does, with the errors that they state on average."""
    found = [calibrated(instrument="mems", seed=seed) for seed in range(40)]
    alarms = sum(result.verdict.level is not Level.PASS for result, _ in found)
    assert alarms <= 4  # 1 % for each of three checks: 1.2; more than 4 with a probability of .7 %
    assert 0.8 < np.mean([nees for _, nees in found]) < 1.2


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["quadratic", "warming"])
@pytest.mark.parametrize("plan", ["icosahedron 12", "dodecahedron 20"])
def test_no_spoiled_session_passes(kind, plan):
    for seed in range(5):
        result, _ = calibrated(kind, plan=plan, seed=seed)
        assert result.verdict.level is Level.DOUBTFUL
