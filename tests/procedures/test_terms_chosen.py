"""terms = "auto": what a log tells better than its size is estimated, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from commands import run
from foucault import procedures
from foucault.campaign import load, parse, simulate, template
from foucault.campaign.study import Trial
from foucault.diagnose.study import nees
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.left_out import sizes_of
from foucault.procedures import PROCEDURES, two_imus
from foucault.procedures.chosen import OPTIONS, Chosen
from foucault.result import Level
from sessions import Case, codes, made, shorter

SIZES = sizes_of("consumer MEMS")
MEANS = {"rows": "means"}
TRUE = dict.fromkeys(("plumb_sd", "orthogonality_sd", "zero_sd", "position_sd"), 0.0)
SMALL = {"placement_sd": np.radians(0.05)}
CASES = {
    "hand_rotated": Case(
        "hand_rotated", {"held_out": 0}, {"rests": 16, "rest_time": 2.0, "turn_time": 1.5}
    ),
    "six_position": Case("six_position", SMALL, SMALL | {"rest_time": 2.0}),
    "ferraris": Case(
        "ferraris", SMALL | {"level_sd": 1e-3, "angle_sd": 1e-3}, SMALL | {"rest_time": 2.0}
    ),
    "norm_observation": Case("norm_observation", {}, MEANS),
    "multi_position": Case("multi_position", {}, MEANS | TRUE),
    "turntable": Case("turntable", {}, MEANS),
    "rate_table": Case("rate_table", {"cubic": False, "rate_sd": 5e-6}, MEANS),
    "transfer_alignment": Case(
        "transfer_alignment", {}, {"rate": 100.0, "message_rate": 5.0, "with_outage": False}
    ),
    "two_imus": Case("two_imus", {"g_sensitivity": False}, {"time": 20.0, "rate": 100.0}),
}  # fmt: skip
TAKEN = {
    "hand_rotated": {"accel.quadratic", "gyro.g_sensitivity"},
    "six_position": {"gyro.g_sensitivity"},
    "ferraris": {"gyro.g_sensitivity"},
    "norm_observation": {"accel.quadratic", "gyro.g_sensitivity"},
    "multi_position": {"accel.quadratic", "gyro.g_sensitivity"},
    "turntable": {"accel.quadratic", "gyro.g_sensitivity"},
    "rate_table": {"gyro.g_sensitivity", "gyro.cubic"},
    "transfer_alignment": {"gyro.misalignment", "accel.scale", "accel.misalignment"},
    "two_imus": {"gyro.g_sensitivity"},
}


def chosen(name: str, terms: str, log=None, sizes=SIZES, **said):
    case = CASES[name]
    case = replace(case, said={"terms": terms, **said})
    log = made(case, 1).log if log is None else log
    return case.record.trial(log, site=case.site, settings=case.stated, noise=case.sensors,
                             sizes=sizes)  # fmt: skip


def groups(names) -> set[str]:
    return {n.rpartition(".")[0] for n in names}


def test_whoever_has_optional_terms_and_counts_them_lets_the_log_choose() -> None:
    for name in PROCEDURES:
        record = procedures.load(name)
        optional = set(OPTIONS) & {
            k for k, f in record.Settings.model_fields.items() if f.annotation is bool
        }
        choose = bool(optional) and record.counted
        assert issubclass(record.Settings, Chosen) == choose, name


@pytest.mark.parametrize("name", CASES)
def test_it_is_estimated_with_its_size_and_all_else_stays(name, monkeypatch) -> None:
    """With the size as prior it is the same estimator: a choice cannot spoil an uncertainty.

    Of two IMUs the first is without that: what it has of a term that is found is an error no more.
    """
    monkeypatch.setattr(two_imus, "ByNoise", lambda: {"accel.quadratic": SIZES["accel.quadratic"]})
    plain, auto = chosen(name, "as set"), chosen(name, "auto")
    a, b = plain.coefficients, auto.coefficients.chosen(plain.coefficients.names)
    assert groups(auto.coefficients.names) - groups(a.names) == TAKEN[name]
    np.testing.assert_allclose(b.sd, a.sd, rtol=1e-3)
    assert (np.abs(b.values - a.values) < 0.01 * a.sd).all()
    new = [n for n in auto.coefficients.names if n not in a.names]
    size = np.array([SIZES.get(n.rpartition(".")[0], (1e-2, ""))[0] for n in new])
    assert (auto.coefficients.chosen(new).sd < size).all()
    assert "left_out.taken" in codes(auto) and "left_out.taken" not in codes(plain)
    assert not groups(new) & set(auto.tables["left_out"]["group"])
    bound = np.array(auto.diagnostics["bound"], float)
    assert (bound <= auto.coefficients.sd[: len(bound)] * (1 + 1e-6)).all()


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_preflight_foresees_what_will_be_chosen(name) -> None:
    case = replace(CASES[name], said={"terms": "auto"})
    with shorter():
        found = case.record.foreseen(replace(case.beforehand, sizes=SIZES, seed=1))
    came = chosen(name, "auto").coefficients
    assert found.names == came.names
    np.testing.assert_allclose(found.sd, came.sd, rtol=0.12)
    assert "left_out.taken" in [f.code for f in found.findings]


def test_what_is_contradicted_is_estimated_without_its_size_and_passes() -> None:
    """A quadratic term of nine sizes is doubtful where it stays out, and found where not."""
    case, true = CASES["hand_rotated"], 9 * SIZES["accel.quadratic"][0]
    sim = made(case, 1)
    model = replace(sim.model, accel_quadratic=sim.model.accel_quadratic.copy())
    model.accel_quadratic[0, 0] = true
    log = made(case, 1, errors=model).log
    assert chosen("hand_rotated", "as set", log).verdict.level is Level.DOUBTFUL
    auto = chosen("hand_rotated", "auto", log)
    assert auto.verdict.level is Level.PASS, auto.verdict.reasons
    assert "contradicted" in auto.diagnostics["taken"]["accel_quadratic"]
    c = auto.coefficients
    k = c.names.index("accel.quadratic.x")
    assert np.isinf(c.prior_sd[k]) and abs(c.values[k] - true) < 4 * c.sd[k] < true


def test_without_sizes_nothing_is_chosen_and_that_is_said() -> None:
    plain, auto = (chosen("hand_rotated", terms, sizes=None) for terms in ("as set", "auto"))
    assert auto.coefficients.names == plain.coefficients.names
    assert "left_out.no_choice" in codes(auto)


def test_a_solution_with_terms_of_its_own_takes_none() -> None:
    auto = chosen("ferraris", "auto", solution="published")
    assert (
        auto.coefficients.names
        == chosen("ferraris", "as set", solution="published").coefficients.names
    )
    assert "left_out.taken" not in codes(auto)


# -- many sessions ---------------------------------------------------------------------------------

SHORT = (("rests = 24", "rests = 16"), ('rest_time = "4 s"', 'rest_time = "2 s"'),
         ('terms = "as set"', 'terms = "auto"'), ("# [noise]", "[noise]"),
         ('# grade = "mems"  ', 'grade = "mems"  '))  # fmt: skip


@cache
def campaign():
    text = template("hand_rotated").replace(
        "[instrument]", '[instrument]\ngrade = "consumer MEMS"', 1
    )
    for pair in SHORT:
        assert text.count(pair[0]) == 1
        text = text.replace(*pair)
    return parse(text)


@cache
def joint(seed: int) -> tuple[float, int, bool]:
    """NEES of all that was estimated, what was taken too; how many; whether it passed."""
    made_, procedure = campaign(), procedures.load("hand_rotated")
    session = simulate(made_, seed)
    result = procedure.trial(session.simulation.log, site=made_.site, settings=made_.settings,
                             noise=made_.noise, sizes=session.sizes)  # fmt: skip
    c = result.coefficients
    error = c.values - np.array([session.truth.value(n) for n in c.names])
    passed = result.verdict.level is Level.PASS
    return float(nees(error[None], c.cov[None])[0]), len(error), passed


@pytest.mark.thorough
def test_a_choice_by_the_log_leaves_its_uncertainties_right() -> None:
    """In 45 sessions, whose covariance were it 20 % off would be found out in 99 % of cases."""
    scores, counts, passed = zip(*(joint(seed) for seed in range(45)), strict=True)
    low, high = chi_square_limits(sum(counts))
    assert low < sum(scores) < high
    assert min(counts) > 21  # something was taken in each
    assert sum(passed) >= 0.9 * len(passed)


def test_a_study_compares_what_every_trial_has() -> None:
    row = Trial(campaign())(0, np.random.SeedSequence(7))
    assert np.isfinite(row["nees"]) and "error.accel.quadratic.x" not in row


# -- from the command line -------------------------------------------------------------------------


@pytest.mark.thorough
def test_the_command_line_chooses_too(tmp_path) -> None:
    file = tmp_path / "c.toml"
    text = campaign().text.replace('terms = "auto"', 'terms = "as set"')
    file.write_text(text)
    session = tmp_path / "s"
    run("simulate", file, "-o", session, code=0)
    assert "Taken into the estimate" in run("preflight", file, "--terms", "auto").output
    ran = tmp_path / "run"
    run("calibrate", session / "campaign.toml", "-o", ran, "--terms", "auto", code=0)
    assert load(ran / "campaign.toml").settings.terms == "auto"
