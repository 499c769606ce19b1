"""Coefficients over temperature: are functions and covariances right, and what is told of them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from foucault.errors import FoucaultError
from foucault.estimate.temperature import Fit, _stacks, _unlikely
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.temperature import TemperatureModel
from foucault.procedures.temperature import Ramp, Session, Settings, calibrate
from foucault.procedures.temperature.evidence import model_of, solved, task_of
from foucault.result import Check, Level, Result
from foucault.result_document import document
from make_temperature import ROOM, ZERO, sessions, truth, typical
from refusals import refused
from sessions import codes

DEGREES = (-15, 0, 15, 25, 35, 50, 65)
ORDERS = {"accel.bias": 2, "gyro.bias": 2, "accel.scale": 1, "gyro.scale": 1, "": 0}
DRAWS = 100
TRUTH, TEMPLATE = truth()


def check(result: Result, name: str) -> Check:
    return next(c for c in result.checks if c.name == name)


def nees(model: TemperatureModel, family: str = "") -> tuple[float, int]:
    """Return the normalised square of the error of the weights that were estimated, and their
    number."""
    n, p = model.weights.shape
    true, rows = np.zeros((n, p)), [TRUTH.layout.index(name) for name in model.layout.names]
    # The truth counts its powers from another temperature.
    for k in range(TRUTH.weights.shape[1]):
        power = np.polynomial.polynomial.polypow([model.reference - ROOM, 1.0], k)
        true[:, : len(power)] += TRUTH.weights[rows, k : k + 1] * power[:p]
    used = np.diag(model.cov) > 0
    used &= np.repeat([name.startswith(family) for name in model.layout.names], p)
    e, P = (model.weights - true).ravel()[used], model.cov[np.ix_(used, used)]
    sd = np.sqrt(np.diag(P))
    return float((e / sd) @ np.linalg.solve(P / np.outer(sd, sd), e / sd)), int(used.sum())


@pytest.fixture(scope="module")
def usual() -> Result:
    return calibrate(sessions(DEGREES))


def fitted(made: list[Session], settings: Settings) -> tuple[TemperatureModel, Fit]:
    """Fit without the tests of the fit."""
    task = task_of(made, settings, [])
    choice = solved(task, settings)
    return model_of(task, choice), choice.fit


def only(made: list[Session], family: str) -> list[Session]:
    return [replace(s, result=replace(s.result, coefficients=s.result.coefficients[family]))
            for s in made]  # fmt: skip


# -- statistics -------------------------------------------------------------------------------


@pytest.mark.thorough
def test_errors_of_the_functions_are_what_their_covariance_says() -> None:
    own = {"gyro.bias": 2.0, "accel.bias": 1.0}
    unit = dict(zip(TRUTH.layout.names, typical(TEMPLATE.coefficients), strict=True))
    declared = {f: s * unit[f + ".x"] for f, s in own.items()} | {"": 0.0}
    total, chi, dof, each = 0.0, 0.0, 0, 0
    for seed in range(DRAWS):
        made = sessions(DEGREES, seed, scatter=own)
        model, fit = fitted(made, Settings(orders=ORDERS, scatter=declared))
        d2, each = nees(model)
        total += d2
        chi += fit.chi_square
        dof += fit.dof
    assert each == 3 * 3 + 2 * 3 + 3 + 3 * 3 + 2 * 3 + 6
    # Two tests, 1 % together.
    low, high = stats.chi2.ppf([0.0025, 0.9975], DRAWS * each)
    assert low < total < high
    low, high = stats.chi2.ppf([0.0025, 0.9975], dof)
    assert low < chi < high


def test_too_low_an_order_fails_all_of_that() -> None:
    orders = ORDERS | {"gyro.bias": 1}
    total, each = 0.0, 0
    for seed in range(10):
        result = calibrate(sessions(DEGREES, seed), Settings(orders=orders, scatter={"": 0.0}))
        d2, each = nees(result.temperature)
        total += d2
        assert result.verdict.level is Level.DOUBTFUL
        assert not check(result, "chi-square").passed
        assert not check(result, "terms").passed
        assert not check(result, "temperature left out").passed
        assert "gyro.bias is no straight line" in check(result, "terms").sentence
    assert total > 10 * stats.chi2.ppf(0.9999, 10 * each)


def test_too_low_an_order_cannot_hide_in_scatter_that_is_found() -> None:
    result = calibrate(sessions(DEGREES), Settings(orders=ORDERS | {"gyro.bias": 1}))
    assert result.temperature.scatter[result.coefficients.layout.index("gyro.bias.x")] > 0
    assert not check(result, "terms").passed
    assert result.verdict.level is Level.DOUBTFUL


@pytest.mark.thorough
def test_errors_with_scatter_that_is_found_follow_student() -> None:
    """Scatter far above the covariances and alike on three axes: an F distribution."""
    degrees, logs = np.linspace(-15, 65, 9), 0.0
    for seed in range(DRAWS):
        made = sessions(degrees, seed, scatter={"gyro.bias": 300.0})
        model, _ = fitted(only(made, "gyro.bias"), Settings(orders={"": 2}))
        d2, k = nees(model, "gyro.bias")
        assert k == 9
        logs -= 2 * np.log(stats.f.sf(d2 / k, k, 3 * (9 - 3)))
    low, high = stats.chi2.ppf([0.005, 0.995], 2 * DRAWS)
    assert low < logs < high


def test_the_order_is_found(usual: Result) -> None:
    got = {row["family"]: row["function"] for row in usual.diagnostics["families"]}
    assert got == {
        "accel.bias": "parabola", "gyro.bias": "parabola", "accel.scale": "straight line",
        "gyro.scale": "straight line", "accel.misalignment": "constant",
        "gyro.misalignment": "constant",
    }  # fmt: skip
    assert usual.verdict.level is Level.PASS, usual.verdict.reasons
    assert set(usual.temperature.varying()) == {
        n for n in usual.coefficients.names if "misalignment" not in n
    }
    assert usual.temperature.weights.shape[1] == 3
    assert "parabola" not in check(usual, "temperatures").sentence
    (needed,) = (r["needed"] for r in usual.diagnostics["families"] if r["family"] == "gyro.bias")
    assert needed["has"] == "straight line"
    assert needed["against"] == "parabola"
    assert needed["p"] < 1e-6


def test_without_noise_the_truth_is_found() -> None:
    result = calibrate(sessions(DEGREES, noise=0.0), Settings(orders=ORDERS))
    for degrees in (-15, 3.7, 41.0, 65):
        got = result.temperature.values(ZERO + degrees)
        want = TRUTH.values(ZERO + degrees)
        np.testing.assert_allclose(got, want, atol=1e-6 * TEMPLATE.coefficients.sd.min())


def test_one_change_is_found_in_its_own_place() -> None:
    weights = np.zeros_like(TRUTH.weights)
    weights[:, 0] = TRUTH.weights[:, 0]
    i = TRUTH.layout.index("gyro.scale.y")
    weights[i, 1] = 3e-5
    model = replace(TRUTH, weights=weights)
    orders = Settings(orders={"": 1})
    result = calibrate(sessions(DEGREES, model=model, noise=0.0), orders)
    slopes = result.temperature.weights[:, 1] / TEMPLATE.coefficients.sd
    assert slopes[i] == pytest.approx(3e-5 / TEMPLATE.coefficients.sd[i], rel=1e-8)
    assert np.abs(np.delete(slopes, i)).max() < 1e-8 * slopes[i]


def test_the_same_input_gives_the_same_bits(usual: Result) -> None:
    again = calibrate(sessions(DEGREES))
    one, two = (json.dumps(document(replace(r, provenance={}))) for r in (usual, again))
    assert one == two


# -- the result -------------------------------------------------------------------------------


def test_the_result_is_that_at_the_reference(usual: Result) -> None:
    model = usual.temperature
    assert model.low == pytest.approx(ZERO - 15.4)
    assert model.high == pytest.approx(ZERO + 65.3)
    assert model.reference == pytest.approx((model.low + model.high) / 2)
    np.testing.assert_array_equal(usual.coefficients.values, model.values(model.reference))
    assert usual.validity["temperature"] == [model.low, model.high]
    assert usual.validity["accel"] == [-12.0, 12.0]
    wide = calibrate(sessions(DEGREES), Settings(reference=ROOM, margin=2.0))
    assert wide.temperature.reference == ROOM
    assert wide.temperature.high == pytest.approx(ZERO + 67.3)
    np.testing.assert_allclose(wide.temperature.values(ROOM), model.values(ROOM), rtol=1e-9)


def test_scatter_is_found_and_told() -> None:
    result = calibrate(sessions(DEGREES, scatter={"gyro.bias": 20.0}))
    unit = typical(TEMPLATE.coefficients)[TRUTH.layout.index("gyro.bias.x")]
    found = result.temperature.scatter[TRUTH.layout.index("gyro.bias.y")]
    assert 10 * unit < found < 32 * unit
    sd = result.temperature.sd(np.array([ROOM]))[0]
    next_time = result.temperature.sd(np.array([ROOM]), scatter=True)[0]
    i = TRUTH.layout.index("gyro.bias.y")
    assert next_time[i] == pytest.approx(np.hypot(sd[i], found))


def test_declared_scatter_that_is_too_small_or_too_large_shows() -> None:
    unit = typical(TEMPLATE.coefficients)[TRUTH.layout.index("gyro.bias.x")]
    made = sessions(DEGREES, scatter={"gyro.bias": 20.0})
    for size, words in ((0.0, "larger"), (400.0, None)):
        settings = Settings(orders=ORDERS, scatter={"gyro.bias": size * unit, "": 0.0})
        result = calibrate(made, settings)
        assert check(result, "chi-square").passed == (words is None)
        assert words is None or words in check(result, "chi-square").sentence
    many = Settings(orders=ORDERS, scatter={"": 10.0})
    assert "smaller" in check(calibrate(made, many), "chi-square").sentence


def test_piecewise_linear() -> None:
    """A kink that no polynomial follows."""
    knots = (ZERO - 15, ZERO + 20, ZERO + 65)
    weights = np.repeat(TRUTH.weights[:, :1], 3, axis=1)
    i = TRUTH.layout.index("accel.bias.x")
    weights[i] += TEMPLATE.coefficients.sd[i] * np.array([80.0, 0.0, 120.0])
    n = len(TRUTH.layout)
    bent = TemperatureModel(TRUTH.layout, weights, np.zeros((3 * n, 3 * n)), ROOM, knots[0],
                            knots[2], np.array(knots))  # fmt: skip
    degrees = (-15, -3, 10, 20, 31, 42, 53, 65)
    result = calibrate(sessions(degrees, model=bent), Settings(knots=knots))
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    assert result.temperature.kind == "piecewise linear"
    assert result.temperature.low == knots[0]
    T = ZERO + np.array([-10.0, 20.0, 50.0])
    off = (result.temperature.values(T) - bent.values(T)) / result.temperature.sd(T)
    assert np.abs(off).max() < stats.norm.ppf(1 - 0.005 / off.size)
    families = {r["family"]: r["function"] for r in result.diagnostics["families"]}
    assert families["accel.bias"] == "line through 3 knots"
    # No power up to the third follows it, which is told where the scatter is declared.
    powers = Settings(orders={"": 2}, scatter={"": 0.0})
    assert not check(calibrate(sessions(degrees, model=bent), powers), "chi-square").passed


def test_two_temperatures_are_a_line_that_nothing_tests() -> None:
    result = calibrate(sessions((0, 50)))
    assert result.verdict.level is Level.DOUBTFUL
    assert "Calibrate at one temperature more" in check(result, "temperatures").sentence
    (told,) = (f for f in result.findings if f.code == "temperature.no_scatter")
    assert "gyro.bias" in told.message
    assert np.isnan(result.temperature.scatter[result.coefficients.layout.index("gyro.bias.x")])
    assert "Declare it" in told.cure


def test_an_odd_session_is_named() -> None:
    made = sessions(DEGREES)
    odd = made[3]
    vector = odd.result.coefficients
    values = vector.values.copy()
    values[vector.layout.index("accel.scale.z")] += (
        25 * vector.sd[vector.layout.index("accel.scale.z")]
    )
    made[3] = replace(odd, result=replace(odd.result, coefficients=replace(vector, values=values)))
    result = calibrate(made, Settings(orders=ORDERS))
    failed = check(result, "temperature left out")
    assert not failed.passed
    assert "run3" in failed.sentence
    assert "accel.scale" in failed.sentence


@pytest.mark.thorough
def test_hysteresis_is_told_and_only_where_there_is_some() -> None:
    degrees = (25, 45, 65, 40, 20, 0, -15, 5, 30)
    made = sessions(degrees)
    agreed = check(calibrate(made, Settings(visited=True)), "heating and cooling")
    assert agreed.passed
    lag = np.sign(np.diff(degrees, prepend=0))
    moved = []
    for session, sense in zip(made, lag, strict=True):
        vector = session.result.coefficients
        values = vector.values + np.where(
            [n.startswith("gyro.bias") for n in vector.names], 6.0 * sense * vector.sd, 0.0
        )
        result = replace(session.result, coefficients=replace(vector, values=values))
        moved.append(replace(session, result=result))
    result = calibrate(moved, Settings(visited=True))
    assert not check(result, "heating and cooling").passed
    assert "gyro.bias" in check(result, "heating and cooling").sentence
    assert all(c.name != "heating and cooling" for c in calibrate(moved).checks)
    one_way = calibrate(sessions((0, 20, 40, 60)), Settings(visited=True))
    assert "temperature.one_way" in codes(one_way)


def test_sessions_that_estimate_less_and_hold_some() -> None:
    made = sessions(DEGREES)
    for k in (1, 4):
        vector = made[k].result.coefficients
        names = [n for n in vector.names if not n.startswith("gyro.misalignment")]
        made[k] = replace(
            made[k], result=replace(made[k].result, coefficients=vector.chosen(names))
        )
    held = []
    for session in made:
        vector = session.result.coefficients
        free = np.array([not n.startswith("accel.misalignment") for n in vector.names])
        cov = vector.cov * np.outer(free, free)
        vector = replace(vector, free=free, cov=cov, values=np.where(free, vector.values, 1e-4))
        held.append(replace(session, result=replace(session.result, coefficients=vector)))
    result = calibrate(held)
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    assert len(result.coefficients) == 21
    rest = result.coefficients["accel.misalignment"]
    np.testing.assert_array_equal(rest.values, 1e-4)
    assert not rest.free.any()
    (row,) = (r for r in result.diagnostics["families"] if r["family"] == "gyro.misalignment")
    assert row["temperatures"] == 5


def test_what_is_doubtful_is_told() -> None:
    made = sessions(DEGREES)
    doubtful = replace(
        made[0].result, verdict=replace(made[0].result.verdict, level=Level.DOUBTFUL)
    )
    frozen = replace(made[1].result, validity={"temperature": [ZERO] * 2, "temperature_mean": ZERO})
    made[0], made[1] = replace(made[0], result=doubtful), Session.of("frozen", frozen)
    wide = made[6]
    made[6] = replace(wide, low=wide.temperature - 15, high=wide.temperature + 15)
    vector = made[2].result.coefficients
    prior = replace(made[2].result, coefficients=replace(vector, prior_sd=vector.sd * 1.01))
    made[2] = replace(made[2], result=prior)
    result = calibrate(made, Settings(orders=ORDERS))
    said = {f.code: f.message for f in result.findings}
    assert "run0" in said["temperature.doubtful"]
    assert "frozen" in said["temperature.dead"]
    assert "run6" in said["temperature.wide"]
    assert "30.0 K" in said["temperature.wide"]
    assert "gyro.bias.x" in said["temperature.prior"]


# -- ramps ------------------------------------------------------------------------------------


def a_ramp(seed: int = 5, model: TemperatureModel = TRUTH, **changes: Any) -> Ramp:
    """An hour and a half at rest, from -10 to 60 degC and halfway back, 20 Hz."""
    from foucault.models.imu import ImuModel
    from foucault.tables import Log

    rng, n = np.random.default_rng(seed), 20 * 5400
    part = np.linspace(0, 1.5, n)
    T = ZERO - 10 + 70 * np.where(part < 1, part, 2 - part)
    f_b = np.tile([1.2, -2.0, 9.5], (n, 1))
    w = np.tile([3e-5, 4e-5, -5e-5], (n, 1))  # the Earth's rate, of which nothing is said
    accel, gyro = ImuModel.of_samples(model.layout.names, model.values(T)).measure(f_b, w)
    accel = accel + 4e-3 * rng.normal(size=(n, 3))
    gyro = gyro + 1e-3 * rng.normal(size=(n, 3))
    log = Log(np.arange(n) / 20.0, gyro, accel, "rate", T)
    return Ramp.of("ramp", replace(log, **changes))


def only_biases() -> TemperatureModel:
    weights = TRUTH.weights.copy()
    weights[["bias" not in n for n in TRUTH.layout.names], 1:] = 0.0
    return replace(TRUTH, weights=weights)


def test_one_session_and_a_ramp_tell_biases_over_temperature() -> None:
    model = only_biases()
    result = calibrate(sessions((25,), model=model), ramps=[a_ramp(model=model)])
    found = {r["family"]: r["function"] for r in result.diagnostics["families"]}
    assert found["gyro.bias"] == found["accel.bias"] == "parabola"
    T = ZERO + np.array([-8.0, 20.0, 55.0])
    i = [result.coefficients.layout.index(n) for n in result.coefficients.names if "bias" in n]
    off = (result.temperature.values(T) - model.values(T)) / result.temperature.sd(T)
    assert np.abs(off[:, i]).max() < stats.norm.ppf(1 - 0.005 / off[:, i].size)
    # The change is known far better than the level, which is the session's.
    sd = result.temperature.sd(T)[:, i]
    assert np.all(sd > 0.9 * TEMPLATE.coefficients.sd[i])
    assert np.all(sd < 1.3 * TEMPLATE.coefficients.sd[i])
    told = check(result, "what a ramp cannot tell")
    assert not told.passed
    assert "gyro.scale" in told.sentence
    assert "gyro.bias" not in told.sentence
    assert any("1 arcsec is 4.8 ug" in words for words in result.diagnostics["unseen"])
    assert result.temperature.low == pytest.approx(ZERO - 10, abs=0.1)
    assert "temperature_ramps" in result.tables
    assert check(result, "heating and cooling").passed


@pytest.mark.thorough
def test_a_ramp_adds_to_sessions_that_tell_the_scale_factors() -> None:
    alone = calibrate(sessions(DEGREES), Settings(orders=ORDERS))
    both = calibrate(sessions(DEGREES), Settings(orders=ORDERS), [a_ramp()])
    assert both.verdict.level is Level.PASS, both.verdict.reasons
    T = np.array([ZERO + 55.0])
    i = TRUTH.layout.index("gyro.bias.x")
    assert both.temperature.sd(T)[0, i] < alone.temperature.sd(T)[0, i]
    off = (both.temperature.values(T) - TRUTH.values(T)) / both.temperature.sd(T)
    assert np.abs(off).max() < stats.norm.ppf(1 - 0.005 / off.size)


def test_mistakes_with_ramps() -> None:
    n = 20 * 5400
    assert refused(lambda: a_ramp(temperature=None)).code == "temperature.no_column"
    flat = refused(lambda: a_ramp(temperature=np.linspace(290, 290.5, n)))
    assert flat.code == "temperature.no_ramp"
    assert "changes by 0.50 K" in flat.message
    rng = np.random.default_rng(1)
    shaken = 1e-3 * rng.normal(size=(n, 3)) * np.where(np.arange(n) > 60000, 50.0, 1.0)[:, None]
    problem = refused(lambda: a_ramp(gyro=shaken))
    assert problem.code == "temperature.moved"
    turned = np.tile([0.0, 0.0, 9.8], (n, 1))
    turned[50000:] = [9.8, 0.0, 0.0]
    problem = refused(lambda: a_ramp(accel=turned + 4e-3 * rng.normal(size=(n, 3))))
    assert problem.code == "temperature.turned"
    kelvin = refused(lambda: a_ramp(temperature=np.linspace(550, 580, n)))
    assert kelvin.code == "temperature.implausible"
    from foucault.tables import Log

    few = Log(np.arange(20.0), np.zeros((20, 3)), None, "rate", np.linspace(290, 300, 20))
    assert refused(lambda: Ramp.of("few", few)).code == "temperature.short_ramp"


# -- mistakes ---------------------------------------------------------------------------------


def test_rounding_tells_nothing_of_a_sensor_or_a_range() -> None:
    """The mean of equal numbers may be off by a bit."""
    made = sessions((0, 25, 50))
    T = np.nextafter(298.15, 300.0)
    for k, at in ((0, 273.15), (2, 323.15)):
        validity = {"temperature": [at, at], "temperature_mean": np.nextafter(at, T)}
        made[k] = Session.of(f"run{k}", replace(made[k].result, validity=validity))
        assert made[k].dead
    result = calibrate(made)
    assert "temperature.dead" in codes(result)
    assert "temperature.beyond_knots" not in codes(result)


def test_temperatures_to_spare_are_more_than_terms() -> None:
    result = calibrate(sessions((0, 50)), Settings(orders={"": 0}, scatter={"": 0.0}))
    assert check(result, "temperatures").value == 1.0
    assert "2 temperatures for 1 terms, with 1 to spare" in check(result, "temperatures").sentence
    alone = sessions((0, 50))
    vector = alone[1].result.coefficients
    some = vector.chosen(n for n in vector.names if n != "gyro.bias.x")
    alone[1] = changed(alone[1], coefficients=some)
    result = calibrate(alone, Settings(orders={"": 0}, scatter={"": 0.0}))
    assert not check(result, "temperatures").passed
    assert "gyro.bias: 1 temperatures for 1 terms" in check(result, "temperatures").sentence


def test_a_power_that_is_lowered_is_told() -> None:
    result = calibrate(sessions((0, 50)), Settings(orders={"": 2}, scatter={"": 0.0}))
    (note,) = (f for f in result.findings if f.code == "temperature.lower_order")
    assert note.message.startswith("A power of 2 was asked for; accel.bias, ")
    enough = calibrate(sessions((0, 25, 50)), Settings(orders={"": 2}, scatter={"": 0.0}))
    assert "temperature.lower_order" not in codes(enough)


def test_a_log_does_not_count_twice() -> None:
    made = sessions((0, 25, 50))
    copy = replace(made[2], result=replace(made[2].result, provenance=made[0].result.provenance))
    problem = refused(lambda: calibrate([*made[:2], copy]))
    assert problem.code == "temperature.same_log"
    assert "'run0' and 'run2' come from the same log" in problem.message
    prior = {"prior": {"inputs": made[0].result.provenance["inputs"]}}
    late = changed(made[2], provenance=made[2].result.provenance | prior)
    assert refused(lambda: calibrate([*made[:2], late])).code == "temperature.same_log"


def changed(session: Session, **changes: Any) -> Session:
    return replace(session, result=replace(session.result, **changes))


def test_mistakes_in_sessions() -> None:
    made = sessions((0, 25, 50))
    result = made[0].result
    assert refused(lambda: calibrate([])).code == "temperature.no_results"
    one = refused(lambda: calibrate(sessions((25, 25.2, 25.4))))
    assert one.code == "temperature.one"
    assert "3 results" in one.message
    unknown = refused(lambda: Session.of("run", replace(result, validity={})))
    assert unknown.code == "temperature.unknown"
    assert '--at "run=25 degC"' in unknown.cure
    assert Session.of("run", replace(result, validity={}), 300.0).temperature == 300.0
    for span in ([570.0, 571.0], [24.0, 25.0]):
        bad = replace(result, validity={"temperature": span})
        problem = refused(lambda bad=bad: Session.of("run", bad))
        assert problem.code == "temperature.implausible"
        assert "[log.temperature]" in problem.cure
    unusable = replace(result.verdict, level=Level.UNUSABLE, reasons=("Too few rests.",))
    problem = refused(lambda: Session.of("run", replace(result, verdict=unusable)))
    assert problem.code == "temperature.unusable"
    assert "Too few rests." in problem.message
    for vector in (
        replace(result.coefficients, cov=None),
        replace(result.coefficients, values=np.full(21, np.nan)),
    ):
        bad = replace(result, coefficients=vector)
        assert refused(lambda b=bad: Session.of("r", b)).code == "temperature.no_covariance"
    twice = calibrate(made)
    assert refused(lambda: Session.of("r", twice)).code == "temperature.twice"


def test_a_cluster_is_refused() -> None:
    from foucault.coefficients import CoefficientVector
    from foucault.models.cluster import CONSTANTS

    vector = CoefficientVector(CONSTANTS, np.zeros(len(CONSTANTS)), np.eye(len(CONSTANTS)))
    cluster = replace(TEMPLATE, coefficients=vector, procedure="platform_tumble")
    problem = refused(lambda: Session.of("r", cluster))
    assert problem.code == "temperature.not_imu"
    assert "platform_tumble" in problem.message


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"instrument": {"serial": "9"}}, "temperature.instruments"),
        ({"gauge": "another"}, "temperature.unlike"),
        ({"frame": "another"}, "temperature.unlike"),
    ],
)
def test_sessions_that_do_not_belong_together(changes: dict[str, Any], code: str) -> None:
    made = sessions((0, 25, 50))
    made[2] = changed(made[2], **changes)
    problem = refused(lambda: calibrate(made))
    assert problem.code == code
    assert "run2" in problem.message


def test_sessions_read_with_unlike_count_scales() -> None:
    made = sessions((0, 25, 50))
    for k, scale in enumerate((415, 415, 416)):
        said = {"description": {"accel": {"scale": f"{scale} count/(m/s^2)"}}}
        made[k] = changed(made[k], provenance={"input": said})
    problem = refused(lambda: calibrate(made))
    assert problem.code == "temperature.unlike"
    assert "count scale of run0 is 'accel 415 count/(m/s^2)', that of run2" in problem.message
    made[2] = changed(made[2], provenance=made[0].result.provenance)
    kept = calibrate(made).provenance["input"]["description"]
    assert kept["accel"]["scale"].startswith("415")


def test_a_coefficient_held_at_two_values() -> None:
    made = sessions((0, 25, 50))
    for k in range(3):
        vector = made[k].result.coefficients
        free = np.array([n != "gyro.scale.x" for n in vector.names])
        values = np.where(free, vector.values, 1e-4 * k)
        made[k] = changed(made[k], coefficients=replace(vector, free=free, values=values))
    problem = refused(lambda: calibrate(made))
    assert problem.code == "temperature.held"
    assert "gyro.scale.x" in problem.message


def test_mistakes_in_settings() -> None:
    made = sessions((0, 25, 50))

    def asked(**settings: Any) -> FoucaultError:
        return refused(lambda: calibrate(made, Settings(**settings)))

    family = asked(orders={"gyro.bia": 1})
    assert family.code == "temperature.family"
    assert "Did you mean 'gyro.bias'?" in family.message
    order = asked(orders={"gyro.bias": 3})
    assert order.code == "temperature.order"
    assert "at 3 temperatures" in order.message
    assert asked(knots=(ZERO, ZERO + 0.5)).code == "temperature.knots"
    assert asked(knots=(ZERO,)).code == "temperature.knots"
    assert asked(reference=400.0).code == "temperature.asked_outside"
    lonely = asked(knots=(ZERO, ZERO + 2, ZERO + 4, ZERO + 50))
    assert lonely.code == "temperature.undetermined"
    assert "2.00" in lonely.message


def test_sessions_beyond_the_knots_are_told() -> None:
    result = calibrate(sessions(DEGREES), Settings(knots=(ZERO, ZERO + 30, ZERO + 60)))
    assert "temperature.beyond_knots" in codes(result)
    assert result.temperature.low == ZERO


def test_what_drifts_with_time_is_told_apart_only_by_a_temperature_that_comes_again() -> None:
    told = [
        any("What drifts with time" in words for words in calibrate(some).diagnostics["unseen"])
        for some in (sessions([-10, 0, 10, 20, 30]), sessions([-10, 0, 10, 20, 30, -10]))
    ]
    assert told == [True, False]


ORDER = (-15.0, 12.0, 38.0, 65.0, 52.0, 25.0, -2.0, -15.0)
"""Up and down again [degC]."""


def spoilt(made, what, size):
    """Change the second half of sessions: a bias by `size` sds, or the thermometer by so many K."""
    half, out = len(made) // 2, []
    for k, s in enumerate(made):
        c = s.result.coefficients
        if k >= half and what == "thermometer":
            s = replace(s, temperature=s.temperature + size, low=s.low + size, high=s.high + size)
        elif k >= half:
            values = c.values.copy()
            values[c.names.index(what)] += size * c.sd[c.names.index(what)]
            s = replace(s, result=replace(s.result, coefficients=replace(c, values=values)))
        out.append(s)
    return out


@pytest.mark.parametrize(("what", "size", "who"), [
    ("gyro.bias.x", 10.0, "gyro.bias"), ("accel.scale.y", 15.0, "accel.scale"),
    ("thermometer", 2.0, "the sensor of temperature"),
])  # fmt: skip
def test_what_changed_for_good_half_way_is_told(what, size, who):
    """It hid in the scatter, and the thermometer in all of it: passed with NEES/n to 9."""
    for seed in range(3):
        result = calibrate(spoilt(sessions(ORDER, seed), what, size))
        told = check(result, "change for good")
        assert result.verdict.level is not Level.PASS and not told.passed
        assert f"run4 on are explained if {who} changed" in told.sentence


@pytest.mark.parametrize("count", [4, pytest.param(60, marks=pytest.mark.thorough)])
def test_nothing_changes_for_good_in_sessions_that_only_scatter(count):
    own, false = {"accel.bias": 3.0, "gyro.bias": 3.0, "gyro.scale": 1.0}, 0
    for seed in range(100, 100 + count):
        for scatter in ({}, own):
            result = calibrate(sessions(ORDER, seed, scatter=scatter))
            false += not check(result, "change for good").passed
    assert false <= 4 * FALSE_ALARM * 2 * count


def test_scatter_is_not_nothing_where_the_search_for_it_once_was():
    """By its root, nothing was a flat place that the search did not leave again."""
    at = (-15.0, -15.0, 5.0, 5.0, 25.0, 25.0, 45.0, 45.0, 65.0, 65.0)
    own = {"accel.bias": 3.0, "gyro.bias": 3.0, "gyro.scale": 1.0}
    for seed in (122, 126, 127):
        task = task_of(sessions(at, seed, scatter=own), Settings(), ())
        fit = solved(task, Settings()).fit
        _, slope = _unlikely(_stacks(fit.evidence, fit.design), fit.variance, restricted=True)
        assert slope[fit.variance == 0.0].min() > -0.1
