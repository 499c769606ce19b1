"""What the model of a session on a table lacks must show in the verdict or in a finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.estimate.table import ALONG
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import Readings, grade
from foucault.plans.directions import table_plan
from foucault.procedures import norm_observation, on_table, turntable
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import Rig, simulate_readings
from refusals import refuses

SITE = Site.at(np.radians(48.8), 60.0)
DPH = np.pi / 648000


def readings(
    model: ImuModel, *, both: bool = False, seed: int = 1, rig: Rig | None = None
) -> Readings:
    plan = table_plan(
        "dodecahedron 20", spin_rate=np.radians(10.0), rest_time=60.0, turns=4, both_senses=both
    )
    made = simulate_readings(
        plan, models=model, noise=grade("mems").noise, site=SITE, rig=rig, seed=seed
    )
    return replace(made.readings(0), declared=False)


def checked(r: Readings, task: on_table.Task) -> tuple[str, set[str], dict[str, bool]]:
    result = on_table.from_readings(r, task, site=SITE)
    passed = {c.name: c.passed for c in result.checks}
    return result.verdict.level.value, {f.code for f in result.findings}, passed


NORM = norm_observation.task_of(norm_observation.Settings(plan="dodecahedron 20"))


def test_a_clean_session_passes_without_a_word():
    level, codes, _ = checked(readings(draw_errors("mems", 3)), NORM)
    assert level == "pass" and not codes


@pytest.mark.parametrize("both", [False, True])
def test_g_sensitivity_is_noticed_where_it_hurts(both: bool):
    model = replace(draw_errors("mems", 3), g_sensitivity=40 * DPH / 9.81 * np.eye(3))
    level, codes, passed = checked(readings(model, both=both), NORM)
    assert "readings.g_sensitivity" in codes
    # With spins both ways the scale factors are right; with one sense they are not.
    assert passed["g-sensitivity [deg/h per g]"] is both
    assert level == "doubtful"


def test_an_unknown_heading_is_in_the_uncertainty_and_is_nothing_beside_the_plan():
    plan = table_plan("dodecahedron 20", spin_rate=np.radians(10.0), rest_time=60.0, turns=4)
    model = draw_errors("navigation", 3)
    made = simulate_readings(
        plan, models=model, noise=grade("navigation").noise, site=SITE, seed=1, rig=Rig(heading=2.0)
    )
    r = replace(made.readings(0), declared=True)
    settings = norm_observation.Settings(plan="dodecahedron 20", g_sensitivity=True)
    result = on_table.from_readings(r, norm_observation.task_of(settings), site=SITE)
    budget, c = result.diagnostics["budget"], result.coefficients
    share = np.array(budget["unknown heading"]) / c.sd**2
    assert share[c.names.index("gyro.g_sensitivity.xy")] > 0.9
    assert result.diagnostics["sources"]["unknown heading"][0] == "B"
    assert all(check.passed for check in result.checks)
    error = c.values - model.coefficients(c.names).values
    assert error @ np.linalg.solve(c.cov, error) < chi2.isf(1e-3, len(c))


def test_g_sensitivity_asked_for_is_found():
    model = replace(draw_errors("mems", 3), g_sensitivity=40 * DPH / 9.81 * np.eye(3))
    settings = norm_observation.Settings(plan="dodecahedron 20", g_sensitivity=True)
    result = on_table.from_readings(readings(model), norm_observation.task_of(settings), site=SITE)
    c = result.coefficients
    truth = model.coefficients(c.names).values
    assert np.all(np.abs(c.values - truth) < 4.5 * c.sd)
    assert result.verdict.level == "pass"


def test_quadratic_terms_are_suggested():
    K = np.zeros((3, 6))
    K[0, 0] = K[1, 1] = 500e-6 / 9.80665
    model = replace(draw_errors("mems", 3), accel_quadratic=K)
    level, codes, _ = checked(readings(model), NORM)
    assert "readings.quadratic" in codes and level == "doubtful"
    settings = norm_observation.Settings(plan="dodecahedron 20", accel_quadratic=True)
    result = on_table.from_readings(readings(model), norm_observation.task_of(settings), site=SITE)
    assert result.verdict.level == "pass"


def test_a_wrong_rate_of_the_table_is_suspected():
    r = readings(ImuModel())
    level, codes, _ = checked(replace(r, rate=r.rate * 1.05), NORM)
    assert "readings.common_rate" in codes and level == "doubtful"
    logged = replace(r, rate=r.rate * 1.05, rate_logged=True)
    assert "readings.common_rate" not in checked(logged, NORM)[1]


@pytest.mark.thorough
def test_jitter_of_the_rate_is_found_and_no_spin_is_blamed():
    model = draw_errors("navigation", 5)
    errors, sds = [], []
    for seed in range(12):
        plan = table_plan("dodecahedron 20", spin_rate=np.radians(10.0), rest_time=60.0, turns=4)
        made = simulate_readings(
            plan, models=model, noise=grade("navigation").noise, site=SITE,
            rig=Rig(rate_jitter=1e-5), seed=seed,
        )  # fmt: skip
        result = on_table.from_readings(replace(made.readings(0), declared=False), NORM, site=SITE)
        # Along the axis there are 20 readings for 9 unknowns.
        assert result.diagnostics["noise"]["scatter"][ALONG] == pytest.approx(1e-5, rel=0.6)
        c = result.coefficients
        gyro = [n for n in c.names if n.startswith(("gyro.bias", "gyro.scale"))]
        errors += [c.value(n) - model.coefficients([n]).values[0] for n in gyro]
        sds += [c.sd[c.layout.index(n)] for n in gyro]
    z2 = float(np.mean((np.array(errors) / np.array(sds)) ** 2))
    # 72 numbers and a variance from 11 degrees of freedom: a mean square beyond 1.9 is no chance.
    assert z2 < 1.9


def test_a_bias_that_moves_between_rests_and_spins_does_no_harm():
    model = draw_errors("mems", 3)
    r = readings(model, rig=Rig(heading=0.4))
    assert r.gyro is not None
    moved = replace(
        r, gyro=r.gyro + np.where(r.spin[:, None], 0.0, [30 * DPH, -20 * DPH, 10 * DPH])
    )
    task = turntable.task_of(turntable.Settings(plan="dodecahedron 20"), SITE)
    result = on_table.from_readings(moved, task, site=SITE)
    c = result.coefficients
    truth = model.coefficients(LINEAR_LOWER).values
    # The bias given is that in spins.
    assert np.all(np.abs(c.values - truth) < 4.5 * c.sd)


@pytest.mark.thorough
def test_the_published_recovery_is_called_doubtful_where_its_bias_shows():
    r = readings(draw_errors("mems", 3))
    verdicts = {}
    for solution in ("published", "linear"):
        settings = norm_observation.Settings(plan="dodecahedron 20", solution=solution)
        result = on_table.from_readings(r, norm_observation.task_of(settings), site=SITE)
        check = next(c for c in result.checks if c.name == "agreement with the likelihood")
        verdicts[solution] = (result.verdict.level.value, check.passed)
    assert verdicts == {"published": ("doubtful", False), "linear": ("pass", True)}


@pytest.mark.parametrize(
    ("settings", "prior"),
    [
        ({"accel_quadratic": True}, None),
        ({"g_sensitivity": True}, None),
        ({}, {"accel.bias": (0.0, 0.1)}),
    ],
)
def test_the_linear_solution_refuses_what_it_has_no_place_for(settings, prior):
    task = norm_observation.task_of(
        norm_observation.Settings(plan="dodecahedron 20", solution="linear", **settings)
    )
    with refuses("solution.linear"):
        on_table.from_readings(readings(draw_errors("mems", 3)), task, site=SITE, prior=prior)
