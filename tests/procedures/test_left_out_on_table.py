"""What is not estimated, on a table: its columns, whole sessions, and who is named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from foucault import procedures
from foucault.campaign import parse, simulate
from foucault.diagnose.study import nees
from foucault.estimate.table import TableModel
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.left_out import ByNoise, sizes_of, terms
from foucault.models.noise import grade
from foucault.procedures import fleet, left_out, norm_observation, on_table
from foucault.result import Level

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMED = 'name = "example IMU"'
ARCSEC = float(np.radians(1 / 3600))


@cache
def campaign(name: str, more: str = ""):
    text = (EXAMPLES / f"{name}.toml").read_text()
    return parse(text.replace(NAMED, f'{NAMED}\ngrade = "tactical MEMS"') + more)


@cache
def session(name: str, seed: int):
    return simulate(campaign(name), seed)


def solved(name: str, log, sizes):
    made = campaign(name)
    return procedures.load(name).trial(log, site=made.site, settings=made.settings, sizes=sizes)


@pytest.mark.parametrize("seed", [3001, 3002])
def test_spins_in_one_sense_tell_no_g_sensitivity_from_the_matrix_of_the_gyros(seed) -> None:
    """Both act along the axis of each spin. Of 3002 a reading is where tangents change."""
    made = campaign("norm_observation")
    task = norm_observation.task_of(made.settings)
    readings = on_table.read_positions(session("norm_observation", seed).simulation.log, task, None)
    options = on_table.options_of(readings, task, None)
    start = on_table._start(readings, task, made.site, options)
    model = TableModel(readings, made.site, start, options)
    sizes = {"gyro.g_sensitivity": made.sizes["gyro.g_sensitivity"]}
    (source,) = left_out.columns(options.names, made.site, sizes, on_table.reduced_again(model))(
        start
    )
    at, spins = model.linearise(start), model.kind == 3
    for k, term in enumerate(terms(options.names, made.site, sizes)):
        axes = term.name[-2:]
        beside = f"gyro.scale.{axes[0]}" if axes[0] == axes[1] else f"gyro.misalignment.{axes}"
        a = at.jacobian[spins][:, :, options.names.index(beside)].ravel()
        b = source.shared[spins][:, :, k].ravel()
        assert np.linalg.norm(b - (a @ b) / (a @ a) * a) < 0.01 * np.linalg.norm(b), term.name


def test_what_is_far_beyond_its_size_is_named() -> None:
    log = session("turntable", 3002).simulation.log
    ramp = ((log.time - log.time[0]) / np.ptp(log.time) - 0.5)[:, None]
    size = sizes_of("tactical MEMS")["gyro.bias drift"][0]
    drifted = replace(log, gyro=log.gyro + 20 * size * ramp)
    result = solved("turntable", drifted, campaign("turntable").sizes)
    assert "gyro.bias drift" in result.diagnostics["named"][0]
    assert result.verdict.level is not Level.PASS


def test_undeclared_they_are_taken_for_nothing_there() -> None:
    log = session("multi_position", 3002).simulation.log
    assert "left_out" not in solved("multi_position", log, None).tables


@pytest.mark.parametrize(
    "white", ["tactical", pytest.param("navigation", marks=pytest.mark.thorough)]
)
def test_a_table_that_is_believed_is_not_exact(white: str) -> None:
    """1 arcsec is 5 ug, more than the noise of long rests: it is an error of the table."""
    made, noise = campaign("multi_position"), grade(white).noise
    record = procedures.load("multi_position")
    for seed in (1, 2):
        sim = record.simulate(made.session, settings=made.settings, noise=noise, site=made.site,
                              model=record.draw_errors(white, seed), seed=seed)  # fmt: skip

        def calibrated(sizes, log=sim.log, **settings):
            chosen = made.settings.model_copy(update=settings)
            return record.trial(
                log, site=made.site, settings=chosen, noise=noise, sizes=sizes
            )  # fmt: skip

        exact, counted = calibrated(None), calibrated(ByNoise())
        assert exact.verdict.level is Level.DOUBTFUL or white == "tactical"
        assert counted.verdict.level is Level.PASS, counted.verdict.reasons
        basis = counted.diagnostics["sources"]["errors of single positions"][1]
        assert basis == "angles of 1 arcsec, judgement"
        # Said, they count as said, whether other terms do or not.
        told = calibrated(None, angle_sd=2 * ARCSEC)
        assert told.verdict.level is Level.PASS
        assert "campaign" in told.diagnostics["sources"]["errors of single positions"][1]


@pytest.mark.thorough
def test_a_batch_counts_what_it_does_not_estimate() -> None:
    """Its covariance grows by what terms do to the linear equations, so that NEES is honest."""
    made, scores = campaign("norm_observation"), {None: [], "sizes": []}
    settings = made.settings.model_copy(update={"solution": "linear"})
    task, site = norm_observation.task_of(settings), made.site
    sessions = [session("norm_observation", seed) for seed in range(3001, 3009)]
    read = [
        fleet.arranged(on_table.read_positions(s.simulation.log, task, None),
                       fleet.plan_of(settings)) for s in sessions
    ]  # fmt: skip
    for key, sizes in ((None, None), ("sizes", made.sizes)):
        batch = fleet.solve(read, settings, site, sizes)
        for i, one in enumerate(sessions):
            result = batch.result(i)
            c = result.coefficients
            off = c.values - np.array([one.truth.value(n) for n in c.names])
            scores[key].append(float(nees(off[None], c.cov[None])[0]))
            told = [f.code for f in result.findings]
            assert ("left_out.untested" in told) is (sizes is not None)
    high = chi_square_limits(len(sessions) * len(off), 1e-3)[1]
    assert sum(scores["sizes"]) < high < sum(scores[None]) / 10


def test_rates_at_rest_show_a_g_sensitivity_that_spins_in_one_sense_do_not() -> None:
    """Before it was blamed on the matrix of the gyros, and passed: NEES/n of hundreds."""
    made = session("norm_observation", 3002)
    truth, log = made.truth, made.simulation.log
    size = sizes_of("tactical MEMS")["gyro.g_sensitivity"][0]
    turned = 8 * size * np.array([[1.0, -0.7, 0.3], [0.4, -1.2, 0.9], [-0.8, 0.5, 0.6]])
    felt = replace(log, gyro=log.gyro + log.accel @ turned.T)
    result = solved("norm_observation", felt, campaign("norm_observation").sizes)
    assert any("gyro.g_sensitivity" in some for some in result.diagnostics["named"])
    assert result.verdict.level is Level.DOUBTFUL
    c = result.coefficients
    errors = c.values - np.array([truth.value(n) for n in c.names])
    assert nees(errors[None], c.cov[None])[0] < 2 * len(errors)
