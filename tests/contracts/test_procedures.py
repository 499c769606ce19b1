"""What every procedure owes, written once: each contract is a test over `PROCEDURES`.

The numbers of a procedure, its words and its own mistakes are asserted in tests/procedures; what a
model, an estimate, a budget and a plan have to be is here. `SESSIONS` has one quick session each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

import drawn_errors
from foucault import monte_carlo
from foucault.arrays import FloatArray
from foucault.diagnose import fit_checks
from foucault.diagnose.fit_checks import Judged
from foucault.diagnose.study import nees
from foucault.errors import Status
from foucault.infer import mixed
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.mixed import Linearisation
from foucault.models.left_out import ByNoise, sizes_of
from foucault.models.noise import GRADES, ImuNoise, TriadNoise, grade
from foucault.procedures import PROCEDURES
from foucault.procedures.record import Given
from foucault.report import uncertainty
from foucault.result import CERTAIN, Check, Level, Result
from power import needed
from sessions import (
    ARCMIN,
    LASER,
    POLE,
    QUIET,
    SEEKER,
    SITE,
    SLAVE,
    Case,
    errors,
    fits,
    instrument,
    made,
    shorter,
    solved,
)

HAND = {"rests": 14, "rest_time": 2.0, "turn_time": 1.5, "first_rest_time": 3.0}
FACES = {"rest_time": 2.0, "move_time": 1.0, "placement_sd": 0.0}
ON_FACES = FACES | {"placement_sd": 3 * ARCMIN}
TURNED = {"turn_time": 2.0, "level_sd": 3 * ARCMIN, "angle_sd": 3 * ARCMIN}
MEANS = {"rows": "means"}
EVERYTHING = {"g_sensitivity": True, "accel_quadratic": True}
BOTH = {"plan": "dodecahedron 20", "both_senses": True}
TILTED = {"tilts": ["8 deg", "-8 deg", "0 deg"]}
FIELD = {"intensity": 49e-6, "intensity_sd": 1e-8, "noise_sd": 3e-7, "gyro_bias_sd": 1e-4,
         "gyro_scale_sd": 1e-3, "gyro_misalignment_sd": 5e-4}  # fmt: skip
KNOWN_IMU = {"gyro_bias_sd": 1e-9, "gyro_scale_sd": 1e-9, "gyro_misalignment_sd": 1e-9,
             "accel_bias_sd": 1e-9, "intensity_sd": 1e-13, "wander": False}  # fmt: skip
SPUN = {"rates": ["290 deg/s", "-460 deg/s"], "spin_time": 5.0}
TRUE_TABLE = dict.fromkeys(("plumb_sd", "orthogonality_sd", "zero_sd", "position_sd"), 0.0)

SESSIONS = {
    "hand_rotated": Case("hand_rotated", {"held_out": 0}, HAND),
    "hand_rotated_published": Case(
        "hand_rotated_published", {"initial_rest": 8.0},
        HAND | {"rests": 20, "first_rest_time": 12.0},
    ),
    "six_position": Case("six_position", {"placement_sd": 3 * ARCMIN}, ON_FACES),
    "ferraris": Case(
        "ferraris",
        {"placement_sd": 3 * ARCMIN, "level_sd": 3 * ARCMIN, "angle_sd": 3 * ARCMIN},
        ON_FACES | TURNED,
    ),
    "norm_observation": Case("norm_observation", {}, MEANS),
    "multi_position": Case("multi_position", {}, MEANS | TRUE_TABLE),
    "turntable": Case("turntable", {}, MEANS),
    "rate_table": Case(
        "rate_table", {"rate_sd": 5e-6, "table_rate_sd": 2e-5, "fixture_sd": 5e-5}, MEANS
    ),
    "continuous_spin": Case("continuous_spin", {}, SPUN),
    "magnetometer": Case("magnetometer", FIELD, {"time": 12.0, "rate": 100.0}),
    "north_seeking": Case("north_seeking", {}, TILTED, noise=SEEKER),
    "platform_tumble": Case(
        "platform_tumble", {"plan": "-x -z -y +z", "rate": np.radians(5.0), "segment": 60.0},
        grade="navigation",
    ),
    "systematic": Case(
        "systematic", {"sequence": ["9 positions"]}, {"rest_time": 30.0, "rate": 25.0},
        grade="navigation", noise=LASER,
    ),
    "transfer_alignment": Case(
        "transfer_alignment", {}, {"rate": 100.0, "message_rate": 5.0, "with_outage": False},
        noise=SLAVE,
    ),
    "imu_pose": Case("imu_pose", {}, {"time": 20.0}, grade="mems"),
    "two_imus": Case("two_imus", {}, {"time": 20.0}, grade="mems"),
}  # fmt: skip
ON_TABLE = ("norm_observation", "multi_position", "turntable")
MIXED = tuple(
    n for n in PROCEDURES
    if n not in ("hand_rotated_published", "platform_tumble", "systematic", "transfer_alignment",
                 "imu_pose", "two_imus")
)  # fmt: skip
BRIEF = ("hand_rotated", "six_position", *ON_TABLE, "rate_table")


def told(name: str) -> Any:
    """The noise that a calibration is told; the published recipe refuses any."""
    return None if name == "hand_rotated_published" else "declared"


VARIANTS = {
    "six_position, squares": Case("six_position", {"accel_quadratic": True}, ON_FACES),
    "ferraris, everything": Case("ferraris", EVERYTHING, ON_FACES | TURNED),
    "norm_observation, everything": Case("norm_observation", BOTH | EVERYTHING, MEANS),
    "turntable, everything": Case("turntable", BOTH | EVERYTHING, MEANS),
    "rate_table, g-sensitivity": Case("rate_table", {"g_sensitivity": True}, MEANS),
    "north_seeking, level": Case(
        "north_seeking", {"heading_sd": 1e-4, "heading_offset_sd": 1e-3}, noise=SEEKER
    ),
}  # fmt: skip
"""More models whose derivatives are of their own."""


@cache
def session(name: str, seed: int = 1) -> Any:
    return made((SESSIONS | VARIANTS)[name], seed)


@cache
def fitted(name: str) -> tuple[Result, Any]:
    """The result of a session, and what the engine found; None where it has its own."""
    with fits() as found:
        result = solved(
            (SESSIONS | VARIANTS)[name], session(name).log, noise=told(name), whole=True
        )
    return result, found[-1] if found else None


def quick_for(names: Iterable[str]) -> list[Any]:
    """Return the procedures, those that are not named with the thorough tests."""
    return [pytest.param(n, marks=[pytest.mark.thorough] * (n not in names)) for n in PROCEDURES]


def test_every_procedure_has_a_session() -> None:
    assert set(SESSIONS) == set(PROCEDURES)
    assert all(SESSIONS[name].procedure == name for name in SESSIONS)
    assert all(isinstance(fitted(name)[1], mixed.Fit) for name in MIXED)


# -- the model -------------------------------------------------------------------------------------

# The sensitivities of a turn by hand are those of its middle rule, see test_rests_and_turns.
NEARLY = {"hand_rotated": 2e-3, "magnetometer": 2e-3}
FAR = {"hand_rotated": 1e-3}
"""How far from the solution, in SI."""


@pytest.mark.parametrize("name", (*MIXED, *VARIANTS))
def test_its_jacobian_is_the_difference_of_its_predictions(name: str) -> None:
    fit = fitted(name)[1]
    model, rng = fit.model, np.random.default_rng(3)
    m = fit.at.jacobian.shape[2]
    sd = np.sqrt(np.diag(fit.estimate.state_cov))
    point = model.retract(
        fit.state, np.minimum(100 * sd, FAR.get(name, 3e-3)) * rng.standard_normal(m)
    )
    at = model.linearise(point)
    assert at.known is None or len(at.known_from) <= len(at.known[0])
    for k in range(m):
        slope, known = at.jacobian[:, :, k], None if at.known is None else at.known[1][:, k]
        h = 1e-6 / max(np.abs(slope).max() / np.abs(at.jacobian).max(), 1e-3)
        two = [model.linearise(model.retract(point, s * h * np.eye(m)[k])) for s in (1, -1)]
        numeric = (two[1].residuals - two[0].residuals) / (2 * h)
        near = NEARLY.get(name, 1e-5) * np.abs(slope).max()
        np.testing.assert_allclose(numeric, slope, atol=near, err_msg=f"unknown {k}")
        if known is not None:
            numeric = (two[1].known[0] - two[0].known[0]) / (2 * h)
            size = np.abs(at.known[1]).max(initial=1.0)
            np.testing.assert_allclose(numeric, known, atol=NEARLY.get(name, 1e-5) * size)


@pytest.mark.parametrize("name", MIXED)
def test_a_step_moves_its_coefficients_by_what_it_says(name: str) -> None:
    fit = fitted(name)[1]
    p, m = len(fit.model.layout), fit.at.jacobian.shape[2]
    step = np.sqrt(np.diag(fit.estimate.state_cov)) * np.random.default_rng(4).standard_normal(m)
    moved = fit.model.values(fit.model.retract(fit.state, step)) - fit.model.values(fit.state)
    np.testing.assert_allclose(moved, step[:p], rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("name", (*MIXED, *VARIANTS))
def test_nothing_unknown_is_pinned_by_what_readings_share(name: str) -> None:
    # A cause that ties rows by accident is a constraint: an unknown heading that shares a row with
    # another reading is pinned to where it started, and its sd is rounding.
    fit = fitted(name)[1]
    sd = np.sqrt(np.diag(fit.estimate.state_cov))[len(fit.model.layout) :]
    assert (sd > PINNED).all()


PINNED = 1e-10
"""No angle of an instrument and no lever arm is known so well, in SI."""


# -- what is said of an estimate -------------------------------------------------------------------


@pytest.mark.parametrize("name", PROCEDURES)
def test_its_budget_adds_up_to_its_variance(name: str) -> None:
    result = fitted(name)[0]
    if "budget" not in result.diagnostics:
        assert name in ("hand_rotated_published", "systematic")
        return
    rows = {k: np.array(v) for k, v in result.diagnostics["budget"].items()}
    assert all((v >= 0).all() for v in rows.values())
    sd = result.coefficients.sd
    np.testing.assert_allclose(sum(rows.values())[: len(sd)], sd**2, rtol=1e-9)
    assert [s for s in rows if not all(uncertainty.basis(result, s))] == []


@cache
def counted(name: str) -> Result:
    """A session calibrated with what is not estimated at its size."""
    case = SESSIONS[name]
    alone = case.record.counted and name not in SHOWN
    how = case.record.trial if alone else case.record.calibrate
    result: Result = how(
        session(name).log, site=case.site, settings=case.stated, prior=case.prior,
        noise=case.sensors if told(name) == "declared" else told(name), sizes=SIZES,
    )  # fmt: skip
    return result


SIZES = sizes_of("tactical MEMS")
SHOWN = ("transfer_alignment", "imu_pose", "two_imus")
"""Their budget asks another run of the filter: no trial has it."""


@pytest.mark.thorough
@pytest.mark.parametrize("name", PROCEDURES)
def test_what_is_not_estimated_is_in_its_budget_and_none_is_pinned(name: str) -> None:
    result = counted(name)
    if not SESSIONS[name].record.counted:
        assert "left_out.not_counted" in [f.code for f in result.findings]
        return
    decide(result)
    some = result.diagnostics["left_out"]
    groups = [g for g, row in some.items() if row["kind"] == "left out"]
    assert groups
    # A term of which nothing would be left is one that a reading ties by accident.
    assert all(row["seen"][1] < 1 - 1e-9 for row in some.values() if row["kind"] != "scatter")
    rows = {k: np.array(v) for k, v in result.diagnostics["budget"].items()}
    sd = result.coefficients.sd
    np.testing.assert_allclose(sum(rows.values())[: len(sd)], sd**2, rtol=1e-6)
    assert all((v >= 0).all() for v in rows.values())
    assert [s for s in rows if not all(uncertainty.basis(result, s))] == []
    share = dict(zip(*(result.tables["left_out"][k] for k in ("group", "share")), strict=True))
    large = {g for g in groups if share[g] > 0.01}
    assert large <= set(rows) or (name == "platform_tumble" and "what is not estimated" in rows)


@pytest.mark.parametrize("name", [
    n if n in MIXED else pytest.param(n, marks=pytest.mark.thorough) for n in PROCEDURES
])  # fmt: skip
def test_a_session_of_which_nobody_says_the_instrument_counts_and_passes(name: str) -> None:
    """As a campaign comes without grade, part or size: the noise of the log tells the class."""
    case = SESSIONS[name]
    result = case.record.trial(
        session(name).log, site=case.site, settings=case.stated, prior=case.prior,
        noise=case.sensors if told(name) == "declared" else None, sizes=ByNoise(),
    )  # fmt: skip
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    if case.record.counted and name != "hand_rotated_published":
        basis = result.tables["left_out"]["basis"]
        assert any("grade told by noise" in str(words) for words in basis)


@pytest.mark.parametrize("name", PROCEDURES)
def test_no_coefficient_is_known_better_than_its_bound(name: str) -> None:
    result = fitted(name)[0]
    if name == "hand_rotated_published":
        assert "bound" not in result.diagnostics
        return
    bound = np.array(result.diagnostics["bound"], float)
    assert (bound > 0).all()
    np.testing.assert_array_less(bound, result.coefficients.sd[: len(bound)] * (1 + 1e-5))


@pytest.mark.parametrize("name", PROCEDURES)
def test_a_session_as_it_should_be_passes_inside_its_covariance(name: str) -> None:
    result = fitted(name)[0]
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    assert result.status is Status.CONVERGED
    if name == "hand_rotated_published":  # its weights are no covariance
        return
    names = SESSIONS[name].names
    e, cov = errors(result, session(name), names)
    low, high = chi_square_limits(len(names), tests=len(PROCEDURES))
    assert low < nees(e[None], cov)[0] < high


SAID = {"redundancy", "noise of turns", "control of the rests", "terms that show",
        "terms not shown"}  # fmt: skip
"""Checks without limit and without probability: sentences that test nothing, as no number does."""


@pytest.mark.parametrize("name", PROCEDURES)
def test_what_is_tested_has_a_limit_or_the_probability_that_decides(name: str) -> None:
    """So that `Check` can refuse to pass what is no chance: see tests/diagnose/test_verdicts."""
    decide(fitted(name)[0])


def decide(result: Result) -> None:
    for check in result.checks:
        bound = check.low is not None or check.high is not None or np.isnan(check.value)
        assert bound or check.p is not None or check.name in SAID, check
        assert check.p is None or check.p >= CERTAIN


@pytest.mark.parametrize("name", MIXED)
def test_sizes_that_nobody_declared_are_those_of_the_solution(name: str) -> None:
    """Asked again where the fit ended, residuals tell the same; 2 % off where noise began at 0."""
    case = SESSIONS[name]
    with fits() as found:
        solved(case, session(name).log, noise=None, whole=True)
    fit = found[-1]
    again, _ = mixed.repeatability(fit.model, fit.state, fit.estimate.weights)
    assert again == pytest.approx(dict(fit.found), rel=5e-3)


@pytest.mark.parametrize("name", MIXED)
def test_uncertainties_are_held_against_those_of_the_plan(name: str) -> None:
    """A good session is as good as its plan; one that scatter alone makes honest is no success."""
    (check,) = (c for c in fitted(name)[0].checks if c.name == "uncertainty against the plan")
    assert 0.9 < check.value < 1.5 and check.passed
    fit = fitted(name)[1]
    problem = mixed.without_scatter(fit)
    assert problem is not None
    sd = fit.estimate.coefficients.sd
    spoiled = replace(
        fit.estimate.coefficients, cov=400 * np.asarray(fit.estimate.coefficients.cov)
    )
    (told,) = fit_checks.against_the_plan(
        replace(fit, estimate=replace(fit.estimate, coefficients=spoiled))
    )
    assert not told.passed and told.value > 10 and (sd > 0).all()


@pytest.mark.parametrize("name", PROCEDURES)
def test_nothing_is_known_without_any_doubt(name: str) -> None:
    c = fitted(name)[0].coefficients
    assert (c.sd[c.free] > 0).all()
    assert np.linalg.eigvalsh(c.cov / np.outer(c.sd, c.sd)).min() > 0


@pytest.mark.parametrize("name", quick_for(PROCEDURES.keys() - {"transfer_alignment", "imu_pose"}))
def test_the_same_log_gives_the_same_bits_and_a_trial_the_same_numbers(name: str) -> None:
    case, log, one = SESSIONS[name], session(name).log, fitted(name)[0]
    two = solved(case, log, noise=told(name), whole=True)
    for a, b in ((one.coefficients.values, two.coefficients.values),
                 (one.coefficients.cov, two.coefficients.cov)):  # fmt: skip
        assert a.tobytes() == b.tobytes()
    assert one.checks == two.checks
    for key, table in one.tables.items():
        for column, values in table.items():
            np.testing.assert_array_equal(values, two.tables[key][column])
    trial = solved(case, log, noise=told(name)).coefficients
    assert trial.names == one.coefficients.names
    away = np.abs(trial.values - one.coefficients.values)
    assert (away < 0.1 * one.coefficients.sd).all()
    np.testing.assert_allclose(trial.sd, one.coefficients.sd, rtol=1e-3)
    again, other = made(case, 1), made(case, 2)
    assert again.log.gyro.tobytes() == log.gyro.tobytes() != other.log.gyro.tobytes()
    assert again.truth_json() == session(name).truth_json()


# -- what was put in comes back --------------------------------------------------------------------

SIZE = {
    "accel.bias": 0.1, "accel.scale": 0.01, "accel.misalignment": 0.01, "accel.quadratic": 1e-4,
    "gyro.bias": 1e-3, "gyro.scale": 0.01, "gyro.misalignment": 0.01, "gyro.g_sensitivity": 1e-5,
    "gyro.asymmetry": 1e-3, "gyro.cubic": 1e-3,
    "mag.scale": 0.03, "mag.misalignment": 0.03, "mag.bias": 3e-5, "mag": 0.01,
}  # fmt: skip
PERFECT = MEANS | TRUE_TABLE
FAINT = ImuNoise(TriadNoise(white=1e-9), TriadNoise(white=1e-11))
EXACT = {
    "six_position": (1e-6, Case("six_position", {}, FACES, site=POLE)),
    "six_position, squares": (
        1e-6, Case("six_position", {"accel_quadratic": True}, FACES, site=POLE)
    ),
    "ferraris": (1e-5, Case("ferraris", {}, FACES | {"turn_time": 4.0}, site=POLE)),
    **{name: (1e-12, Case(name, {}, PERFECT)) for name in ON_TABLE},
    # Level Earth rate in spins that are not quite level is what the g-sensitivity takes.
    "norm_observation, everything": (1e-4, Case("norm_observation", BOTH | EVERYTHING, PERFECT)),
    "multi_position, everything": (1e-12, Case("multi_position", BOTH | EVERYTHING, PERFECT)),
    "turntable, everything": (2e-12, Case("turntable", BOTH | EVERYTHING, PERFECT)),
    "rate_table": (2e-12, Case("rate_table", {"g_sensitivity": True}, MEANS)),
    # A rate that wanders is smoothed, and what is finer than a tenth of a radian averaged.
    "continuous_spin": (1e-6, Case("continuous_spin", {}, {
        "rates": ["750 deg/s", "-1030 deg/s"], "spin_time": 3.0, "wander": 0.0, "unbalance": 0.0},
        site=POLE)),
    "magnetometer": (
        1e-3, Case("magnetometer", FIELD | KNOWN_IMU, {"rate": 200.0, "time": 8.0, "noise_sd": 0.0})
    ),
    "north_seeking": (
        1e-7, Case("north_seeking", {"z_coupling": "free"}, TILTED, noise=SEEKER)
    ),
    "north_seeking, level": (1e-7, Case("north_seeking", {"z_coupling": "no"}, noise=SEEKER)),
}  # fmt: skip
"""Sessions that show their coefficients exactly (no error of a table, no unknown heading), and how
exactly, in usual sizes: rounding, but where samples make turns and steps of five digits."""


def size(name: str) -> float:
    return SIZE[name.rpartition(".")[0]]


@cache
def estimated(case: str) -> tuple[str, ...]:
    return solved(EXACT[case][1], exact(case, {}).log).coefficients.names


def exact(case: str, values: dict[str, float]) -> Any:
    """A session without noise; turns are found by what is less still than the noise of rests."""
    asked = EXACT[case][1]
    return made(asked, 1, instrument(asked, values), FAINT if case == "ferraris" else QUIET)


def beyond(case: str, values: dict[str, float]) -> np.ndarray:
    """What is returned beyond what was put in, in usual sizes."""
    quiet, names = exact(case, values), estimated(case)
    result = solved(EXACT[case][1], quiet.log)
    assert result.status is Status.CONVERGED
    assert result.coefficients.names == names
    return errors(result, quiet, names)[0] / np.array([size(n) for n in names])


def test_every_procedure_of_means_is_asked_to_be_exact() -> None:
    asked = {case.procedure for _, case in EXACT.values()}
    assert asked == set(MIXED) - {"hand_rotated"}, "which has test_one_error of its own"


LONG = ("everything", "magnetometer", "rate_table", "turntable")
"""Ends of cases of many coefficients: each is given an error of its own."""


@pytest.mark.parametrize("case", [
    pytest.param(case, marks=pytest.mark.thorough if case.endswith(LONG) else ())
    for case in EXACT
])  # fmt: skip
def test_one_error_returns_exactly_that_error(case: str) -> None:
    for name in estimated(case):
        off = np.abs(beyond(case, {name: size(name)}))
        assert off.max() < EXACT[case][0], (name, estimated(case)[int(off.argmax())])


@pytest.mark.parametrize("case", EXACT)
def test_all_errors_at_once_return_exactly(case: str) -> None:
    rng = np.random.default_rng(5)
    values = {name: size(name) * float(rng.uniform(-1, 1)) for name in estimated(case)}
    assert np.abs(beyond(case, values)).max() < EXACT[case][0]


@pytest.mark.parametrize("name", [n for n in SESSIONS if n != "two_imus"])
def test_what_is_not_known_of_gravity_is_not_known_of_a_scale(name: str) -> None:
    """Of every procedure that holds specific force against gravity; two side by side share it."""
    known = fitted(name)[0].coefficients
    scales = [n for n in known.names if n.startswith("accel.scale.")]
    if not scales:
        pytest.skip("no scale is held against gravity")
    placed = replace(SESSIONS[name], site=replace(SITE, gravity_sd=0.03))
    unsure = solved(placed, session(name).log, noise=told(name)).coefficients
    assert max(unsure.chosen(scales).sd / known.chosen(scales).sd) > 2.0


# -- a plan ----------------------------------------------------------------------------------------

PALINDROME = {"accelerometers": "case", "order": "palindrome"}
UNSURE = {"heading_sd": ARCMIN, "heading_offset_sd": 3 * ARCMIN, "index_sd": ARCMIN}
BLIND = {"accelerometers": "none"}
SAMPLES = {"dwell": 30.0, "rows": "samples", "rate": 2.0}
OWN = {"order": [{"index": f"{a} deg", "dwell": "70 s"} for a in (-90, 90, 0, 180, -90)]}
TIMED = {"rest_time": 20.0, "turns": 2}
WHOLE = BOTH | EVERYTHING | {"four_positions": True, "rate_sd": 1e-6, "table_rate_sd": 2e-6}
NINE = {"sequence": ["9 positions"]}


def seeker(session: dict[str, Any], **settings: Any) -> Case:
    return Case("north_seeking", settings, session, noise=SEEKER)


def laser(**settings: Any) -> Case:
    rests = {"rest_time": 40.0, "rate": 20.0}
    return Case("systematic", NINE | settings, rests, grade="navigation", noise=LASER)


def on_table(name: str, settings: dict[str, Any]) -> Case:
    session = TIMED | (TRUE_TABLE if name == "multi_position" else {})
    return Case(name, settings, session, site=replace(SITE, gravity_sd=2e-4))


PLANS = {
    **{f"{n}, {how}": (0.03, on_table(n, words)) for n in ON_TABLE for how, words in (
        ("plain", {"plan": "icosahedron 12"}), ("everything", WHOLE))},
    **{f"norm_observation, {how}": (
        0.03, on_table("norm_observation", {"plan": "icosahedron 12", "solution": how})
    ) for how in ("linear", "published")},
    "north_seeking, level": (0.02, seeker({})),
    "north_seeking, palindrome": (0.02, seeker(PALINDROME)),
    "north_seeking, blind": (0.02, seeker(BLIND, level_sd=ARCMIN)),
    "north_seeking, drift": (
        0.02, seeker(TILTED | {"gyro_drift": 1e-10}, drift_sd=1e-10, **UNSURE)
    ),
    "north_seeking, samples": (0.02, seeker(SAMPLES)),
    "north_seeking, stops of its own": (0.02, seeker(OWN, index_limit=np.pi)),
    "hand_rotated, g-sensitivity": (0.03, Case("hand_rotated", {"g_sensitivity": True}, HAND)),
    "six_position, squares": (
        0.03, Case("six_position", {"accel_quadratic": True, "placement_sd": 3 * ARCMIN}, ON_FACES)
    ),
    "ferraris, everything": (
        0.03, Case("ferraris", EVERYTHING | SESSIONS["ferraris"].settings, ON_FACES | TURNED)
    ),
    "rate_table, g-sensitivity": (0.03, VARIANTS["rate_table, g-sensitivity"]),
    "systematic, longer": (0.03, laser()),
    "systematic, quadratic": (0.03, laser(accel_quadratic=True)),
    "systematic, lever arms": (0.03, laser(lever_arms=True)),
}  # fmt: skip
"""Plans, and by what part of an sd the errors of the instrument may change it."""

FORETOLD = [
    *(pytest.param(name, 0.1 if name == "platform_tumble" else 0.03, SESSIONS[name], id=name)
      for name in PROCEDURES if name != "hand_rotated_published"),
    *(pytest.param(name, near, case, id=name, marks=pytest.mark.thorough)
      for name, (near, case) in PLANS.items()),
]  # fmt: skip


@pytest.mark.parametrize(("name", "near", "case"), FORETOLD)
def test_a_calibration_has_the_uncertainties_that_were_foretold(
    name: str, near: float, case: Case
) -> None:
    seed = 1 if name in SESSIONS else 4
    with shorter():
        found = case.record.foreseen(replace(case.beforehand, seed=seed))
    came = fitted(name)[0] if name in SESSIONS else solved(case, made(case, seed).log)
    came = came.coefficients
    assert found.names == came.names
    np.testing.assert_allclose(found.sd, came.sd, rtol=near)
    np.testing.assert_allclose(found.prior_sd, came.prior_sd)
    if found.bound is not None:
        np.testing.assert_array_less(found.bound, found.sd * (1 + 1e-9))
        np.testing.assert_allclose(sum(found.budget.values()), found.sd**2, rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["six_position", "ferraris"])
def test_placements_that_nobody_declared_are_foreseen_as_they_are_found(name: str) -> None:
    """Stated variances scatter as those of a size that so many degrees of freedom tell."""
    case = replace(SESSIONS[name], said={"placement_sd": None, "level_sd": None, "angle_sd": None}
                   if name == "ferraris" else {"placement_sd": None})  # fmt: skip
    record, told, ratios = case.record, case.beforehand, []
    model = record.observe(made(case, 0).log, Given(case.site, case.stated, case.sensors, {}))
    dof = mixed.planned(model, record.sizes(case.planned, case.stated)).dof["placement"]
    found = record.foreseen(told)
    loose = [found.names.index(n) for n in found.names if n.startswith("accel.misalignment.")]
    for seed in range(MANY):
        came = solved(case, made(case, seed).log).coefficients
        ratios.append(float(np.mean(came.sd[loose] ** 2 / found.sd[loose] ** 2)))
    low, high = chi_square_limits(MANY * dof)
    assert low < dof * sum(ratios) < high


MANY = 60
"""Sessions over which a size that is found is compared with that of the plan [1]."""


# -- readings that were left out -------------------------------------------------------------------


@cache
def judged(name: str) -> Judged:
    """What is asked of the fit of a session."""
    asked: list[Judged] = []
    redundancy = fit_checks.redundancy
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_checks, "redundancy", lambda e: asked.append(e) or redundancy(e))
        solved(SESSIONS[name], session(name).log, noise=None)
    return asked[0]


@dataclass(frozen=True)
class Drawn:
    """A model at its solution, with errors that were drawn of its sources, and a wrong reading."""

    model: Any
    start: Any
    error: FloatArray  # (n, d) to put to the residuals [SI]
    known: FloatArray | float  # the same of what is known of nuisance parameters [1]
    sizes: Mapping[str, float] | None  # of noise that nobody knew, without other scatter [SI]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.model, name)

    def linearise(self, state: Any) -> Linearisation:
        at = self.model.linearise(state)
        known = None if at.known is None else (at.known[0] + self.known, at.known[1])
        sources, sizes = at.sources, self.sizes
        if sizes is not None:
            sized = (
                replace(s, sd=sizes[s.name]) if s.sd is None and s.noise else s for s in sources
            )
            sources = tuple(s for s in sized if s.sd is not None)
        return replace(at, residuals=at.residuals + self.error, known=known, sources=sources)


def drawn(name: str, seed: int, wrong: FloatArray | float = 0.0, scatter: bool = True) -> Judged:
    """Draw a session of what was found in another, and solve it."""
    e, rng = judged(name), np.random.default_rng(seed)
    at, sizes = e.fit.at, {s.name: e.fit.found[s.name] for s in e.fit.at.sources if s.sd is None}
    found = (
        sizes
        if scatter
        else {s.name: sizes[s.name] for s in at.sources if s.noise and s.sd is None}
    )
    sized = tuple(s if s.sd is not None else replace(s, sd=found.get(s.name, 0.0))
                  for s in at.sources)  # fmt: skip
    error = drawn_errors.drawn(replace(at, sources=sized), rng) - at.residuals + wrong
    known = 0.0
    if at.known is not None:
        known = rng.standard_normal(len(at.known[0])) - at.known[0]
    model = Drawn(e.fit.model, e.fit.state, error, known, None if scatter else found)
    return replace(e, fit=mixed.fit(model))


def held_out_check(e: Judged) -> Check:
    return next(c for c in fit_checks.checks(e) if c.name.startswith("held-out"))


HELD_OUT = tuple(name for name in MIXED if name != "hand_rotated")
"""By hand every rest has an attitude of its own: see test_held_out."""


@pytest.mark.thorough
@pytest.mark.parametrize("name", HELD_OUT)
def test_sessions_as_they_should_be_are_seldom_doubted(name: str) -> None:
    """One in a hundred is; one in 12 would be found out in 99 % of cases, of slow ones in six."""
    n = 60 if name in ("turntable", "rate_table") else 200
    doubted = sum(not held_out_check(drawn(name, seed)).passed for seed in range(n))
    assert doubted <= binom.ppf(0.995, n, FALSE_ALARM + fit_checks.STRAY)


@pytest.mark.parametrize("name", HELD_OUT)
def test_one_block_that_is_wrong_is_named_and_no_other(name: str) -> None:
    e = judged(name)
    n, d = e.fit.at.residuals.shape
    number = np.arange(n) if e.blocks is None else e.blocks
    blocks = np.unique(number)
    clean = drawn(name, 1, scatter=False)
    apart = mixed.held_out(clean.fit, [np.flatnonzero(number == k) for k in blocks])
    size = np.sqrt(np.diag(clean.fit.covariance.whole)).reshape(n, d)
    for k in blocks[apart.counts > 0][::5]:
        sign = np.random.default_rng(k).choice([-1.0, 1.0], (n, d))
        wrong = np.where((number == k)[:, None], 50 * sign * size, 0.0)
        told = held_out_check(drawn(name, 1, wrong, scatter=False))
        assert not told.passed
        assert f"but for one: {e.named(int(k))} is" in told.sentence
    assert held_out_check(clean).passed


def test_one_rest_that_is_wrong_does_not_hide_behind_the_scatter_that_it_makes() -> None:
    e, k = judged("ferraris"), 0
    wrong = np.zeros_like(e.fit.at.residuals)
    wrong[k, 0] = 0.05
    found = drawn("ferraris", 1, wrong)
    assert any(found.fit.found.values())
    assert f"but for one: {e.named(k)} is" in held_out_check(found).sentence


# -- many sessions ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """Coefficients of one session."""

    name: str

    def __call__(self, index: int, seeds: np.random.SeedSequence) -> dict[str, float]:
        case = SESSIONS[self.name]
        c = solved(
            case, made(case, int(seeds.generate_state(1)[0])).log, noise=told(self.name)
        ).coefficients
        return dict(zip(c.names, c.values.tolist(), strict=True))


@pytest.mark.parametrize("name", quick_for(["six_position", "north_seeking", "norm_observation"]))
def test_one_worker_and_four_find_the_same_bits(name: str) -> None:
    alone = list(monte_carlo.run(Trial(name), range(3), 7))
    together = list(monte_carlo.run(Trial(name), range(3), 7, monte_carlo.threads(4)))
    assert alone == together
    assert alone[0] != alone[1]


TURNS = tuple(np.radians([360.0, -720.0, 90.0]))
SLOW = ImuNoise(
    TriadNoise(white=3e-4, bias_instability=5e-4, correlation_time=60.0, random_walk=2e-5),
    TriadNoise(white=2e-5, bias_instability=2e-5, correlation_time=30.0, random_walk=2e-6),
)


def placed(name: str, sd: float, **words: Any) -> Case:
    sds = {"placement_sd": sd} | ({"level_sd": sd, "angle_sd": sd} if name == "ferraris" else {})
    turned = {"turn_time": 2.0} if name == "ferraris" else {}
    return Case(name, sds | words, FACES | turned | sds)


SCATTER = {
    **{f"hand_rotated, {g}": Case("hand_rotated", {"held_out": 0}, HAND, g) for g in GRADES},
    "hand_rotated, slow noise": Case("hand_rotated", {"held_out": 0}, HAND, noise=SLOW),
    **{f"{n}, {arcmin} arcmin": placed(n, arcmin * ARCMIN)
       for n in ("six_position", "ferraris") for arcmin in (0, 5)},
    "ferraris, published": placed("ferraris", 5 * ARCMIN, solution="published"),
    "ferraris, placement found": replace(placed("ferraris", 5 * ARCMIN), said=dict.fromkeys(
        ("placement_sd", "level_sd", "angle_sd"))),
    "ferraris, unequal angles": placed("ferraris", 3 * ARCMIN, angle=TURNS),
    **{n: SESSIONS[n] for n in ON_TABLE},
    **{f"rate_table, {g}": replace(SESSIONS["rate_table"], grade=g, said={"repeatability": False})
       for g in ("mems", "tactical")},
    "continuous_spin": SESSIONS["continuous_spin"],
    "continuous_spin, a drill": Case(
        "continuous_spin", {}, SPUN | {"unbalance": 0.0, "wander": 0.03, "vibration": 0.5}
    ),
    "magnetometer": SESSIONS["magnetometer"],
    "north_seeking, level": seeker({}),
    "north_seeking, two on the case": seeker({"accelerometers": "case"}),
    "north_seeking, blind": seeker(BLIND, level_sd=ARCMIN),
    "north_seeking, all uncertain": seeker(
        {"order": "palindrome", "gyro_drift": 1e-10}, **UNSURE
    ),
    "north_seeking, tilted": seeker(TILTED),
    "north_seeking, tilted, free": seeker(TILTED, z_coupling="free"),
    "north_seeking, samples": seeker(SAMPLES),
    "platform_tumble": Case("platform_tumble", {"average": 5.0}, grade="navigation"),
    "systematic": SESSIONS["systematic"],
    "transfer_alignment": replace(SESSIONS["transfer_alignment"], settings={"left_out": False}),
    "imu_pose": SESSIONS["imu_pose"],
    "two_imus": SESSIONS["two_imus"],
    "two_imus, three": Case("two_imus", {}, {"time": 20.0, "imus": 3}, grade="mems"),
    "imu_pose, positions alone": Case(
        "imu_pose", {}, {"time": 30.0, "with_attitude": False}, grade="mems"
    ),
    "imu_pose, outliers": Case(
        "imu_pose", {}, {"time": 30.0, "outliers": 0.02, "lost": 0.1}, grade="mems"
    ),
    "imu_pose, tags": Case(
        "imu_pose", {}, {"time": 30.0, "pose_rate": 30.0, "position_noise": 3e-3,
                         "attitude_noise": 3e-1 * np.pi / 180}, grade="mems"
    ),
}  # fmt: skip
"""Sessions whose errors are drawn from what is said of them."""

SLOW_SESSIONS = dict.fromkeys(("transfer_alignment", "imu_pose", "imu_pose, positions alone",
                               "imu_pose, outliers", "imu_pose, tags"), 1.44)  # fmt: skip
"""Those of a fifth of a second and more, and the wrong variance that they find out [1]."""


def scatter(name: str, case: Case, least: int) -> tuple[float, int, list[Level]]:
    """Sum of the NEES of sessions with so many coefficients, their number, and the verdicts."""
    told = None if name.endswith("samples") else "declared"
    total, dof, levels = 0.0, 0, []
    while dof < least:
        done = made(case, 50 + len(levels))
        result = solved(case, done.log, noise=told)
        assert result.status is Status.CONVERGED
        names = case.names if case.procedure != "north_seeking" else result.coefficients.names
        e, cov = errors(result, done, names)
        total, dof = total + float(nees(e[None], cov)[0]), dof + len(e)
        levels.append(result.verdict.level)
    return total, dof, levels


@pytest.mark.thorough
@pytest.mark.parametrize("name", SCATTER)
def test_errors_have_the_size_that_was_promised(name: str) -> None:
    """NEES inside two-sided limits: a covariance that is 20 % off is found out in 99 % of cases.

    That takes 2,160 coefficients in each test, for the false alarm of 1 % is shared by all of
    them; of sessions that are slow 550 find standard deviations wrong by a factor of 1.2.
    """
    least = needed(SLOW_SESSIONS.get(name, 1.2), len(SCATTER))
    total, dof, levels = scatter(name, SCATTER[name], least)
    low, high = chi_square_limits(dof, tests=len(SCATTER))
    assert low < total < high
    # Checks of one session ask the same residuals several times, at 1 % each family.
    doubted = len(levels) - levels.count(Level.PASS)
    assert doubted <= binom.ppf(1 - 0.01 / len(SCATTER), len(levels), 0.05)


def louder(noise: ImuNoise, factor: float) -> ImuNoise:
    """The same with so many times the white noise."""
    return ImuNoise(*(replace(n, white=n.white * factor) for n in (noise.accel, noise.gyro)))


TACTICAL = grade("tactical").noise
BY_HAND = Case("hand_rotated", {"held_out": 0, "repeatability": False}, HAND)
RATES = Case("rate_table", {"repeatability": False}, MEANS)
WRONG = {
    **{f"hand_rotated, noise times {k:.2g}": (replace(BY_HAND, told=louder(TACTICAL, k)), k)
       for k in (1.3, 1 / 1.3)},
    "hand_rotated, slow noise that is not told": (
        replace(BY_HAND, noise=SLOW, told=ImuNoise(
            TriadNoise(white=3e-4), TriadNoise(white=2e-5))), 0.5
    ),
    **{f"ferraris, placement times {k}": (replace(
        placed("ferraris", 5 * ARCMIN),
        said=dict.fromkeys(("placement_sd", "level_sd", "angle_sd"), 5 * k * ARCMIN)), k)
       for k in (0.6, 1.6)},
    **{f"north_seeking, noise times {k}": (replace(seeker({}), told=louder(SEEKER, k)), k)
       for k in (0.6, 1.6)},
    **{f"rate_table, noise times {k}": (replace(RATES, told=louder(TACTICAL, k)), k)
       for k in (0.6, 1.6)},
}  # fmt: skip
"""Sessions of which something wrong is said, and what it is against what is true."""


@pytest.mark.parametrize("name", [
    name if name.startswith("ferraris") else pytest.param(name, marks=pytest.mark.thorough)
    for name in WRONG
])  # fmt: skip
def test_what_is_wrongly_declared_shows_in_the_size_of_errors(name: str) -> None:
    case, factor = WRONG[name]
    total, dof, levels = scatter(name, case, needed(1.69, len(WRONG)))
    low, high = chi_square_limits(dof, tests=len(WRONG))
    assert (total < low) if factor > 1 else (total > high)
    if name.startswith("north"):
        assert levels.count(Level.DOUBTFUL) > 3


def test_nees_is_the_quadratic_form() -> None:
    rng = np.random.default_rng(16)
    root = rng.normal(size=(4, 3, 3)) * [1e-9, 1.0, 1e6]
    cov = np.swapaxes(root, 1, 2) @ root
    e = np.einsum("nji,nj->ni", root, np.ones((4, 3)))  # root' 1: its NEES is 3
    np.testing.assert_allclose(nees(e, cov), 3.0, rtol=1e-6)
    np.testing.assert_allclose(nees(e[:1], cov[0]), 3.0, rtol=1e-6)


# -- what was known beforehand ---------------------------------------------------------------------


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=[pytest.mark.thorough] * (n not in BRIEF))
    for n in PROCEDURES if n != "hand_rotated_published"  # it refuses priors
])  # fmt: skip
def test_a_prior_that_readings_contradict_is_no_pass(name: str) -> None:
    """Ten of its standard deviations off, which are three times those of the estimate."""
    c = fitted(name)[0].coefficients
    k = next(i for i, sd in enumerate(c.sd) if np.isfinite(sd) and sd > 0)
    sd = 3 * float(c.sd[k])
    prior = {c.names[k]: (float(c.values[k]) + 10 * sd, sd)}
    result = solved(replace(SESSIONS[name], prior=prior), session(name).log, noise=told(name))
    failed = [check.name for check in result.checks if not check.passed]
    assert result.verdict.level is not Level.PASS
    assert "prior" in failed


@pytest.mark.parametrize("name", MIXED)
def test_what_was_said_of_the_rig_is_compared_with_what_was_found(name: str) -> None:
    """Every row of what was known beforehand is tested, and says what to declare."""
    every = judged(name)
    sources = set(every.fit.at.known_from)
    if every.fit.at.known is not None:
        assert sources <= set(every.said), "say in `Judged.said` what declares them"
    for what in sources:
        if every.said[what]:
            off = replace(every.fit.at, known=(every.fit.at.known[0] + 1e3, every.fit.at.known[1]))
            checks = fit_checks.known_checks(replace(every.fit, at=off), every.said)
            assert all(not check.passed for check in checks)
