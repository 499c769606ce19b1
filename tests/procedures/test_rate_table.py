"""The rate table as a procedure: what was put in comes out, as surely as is promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from foucault import campaign, report, run_folder
from foucault.diagnose.study import nees
from foucault.errors import FoucaultError, Status
from foucault.infer.drift import by_time
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import EQUATION, SCALE_EQUATION, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.procedures.rate_table import (
    Session,
    Settings,
    calibrate,
    from_readings,
    in_si,
    names_of,
    simulate,
)
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from make_rates import LATITUDE, make_readings, make_steps
from make_session import model_of
from refusals import refuses

SITE = Site.at(LATITUDE)
NAMES = names_of(Settings())
ALL = names_of(Settings(g_sensitivity=True))

MEANS = Session(rows="means")
QUIET = {"repeatability": False, "loss": "squares"}


def solved(model, **settings):
    steps = make_steps(model, sd=1e-12, g=SITE.gravity)
    return from_readings(make_readings(steps), Settings(**QUIET, **settings), told=True, site=SITE)


def test_what_is_unknown_of_a_table_hides_nothing_however_little_noise_there_is():
    settings = Settings(**QUIET, table_rate_sd=5e-6, fixture_sd="0.5 arcmin")
    made = simulate(
        MEANS, settings=settings, model=draw_errors("mems", 4), noise=ImuNoise(), site=SITE, seed=4
    )
    found = calibrate(made.log, site=SITE, noise=ImuNoise(), settings=settings)
    errors = found.coefficients.values - made.model.coefficients(NAMES).values
    assert found.status is Status.CONVERGED
    assert found.coefficients["gyro.scale"].sd.max() < 5e-6  # the Earth's rate has no such error
    assert np.abs(errors / found.coefficients.sd).max() < 4.0


def test_samples_without_noise_return_what_was_drawn():
    session = Session(rates=("40 deg/s", "-40 deg/s", "100 deg/s", "-100 deg/s"), step_time=10.0)
    made = simulate(session, model=draw_errors("mems", 5), noise=ImuNoise(), site=SITE, seed=5)
    result = calibrate(made.log, site=SITE, noise=ImuNoise(), settings=Settings(**QUIET))
    assert len(result.tables["rate_steps"]["rate"]) == 24
    error = result.coefficients.values - made.model.coefficients(NAMES).values
    # Means between samples, and the Earth's rate going round in them: 1e-9 of 100 deg/s.
    assert np.abs(error).max() < 5e-9


@pytest.mark.parametrize("table_rate_sd", [0.0, 5e-3])
def test_stamps_that_contradict_the_rate_of_the_table_are_told(table_rate_sd):
    session = Session(rates=("40 deg/s", "-40 deg/s", "100 deg/s", "-100 deg/s"), step_time=10.0)
    made = simulate(
        session, model=draw_errors("mems", 5), noise=grade("mems").noise, site=SITE, seed=5
    )
    settings = Settings(table_rate_sd=table_rate_sd)
    for fast, told in ((1.0, 0), (1.001, 1 - bool(table_rate_sd))):
        log = replace(made.log, time=made.log.time * fast)
        result = calibrate(log, site=SITE, noise=None, settings=settings)
        found = [f.message for f in result.findings if f.code == "table.two_rates"]
        assert len(found) == told
        assert result.verdict.level is (Level.DOUBTFUL if told else Level.PASS)
    if told:
        assert "says 70 deg/s, the outer angle over the time of the log 69.9301 deg/s" in found[0]


def test_rates_from_the_campaign_where_the_log_has_none():
    noise = grade("tactical").noise
    made = simulate(MEANS, model=draw_errors("tactical", 1), noise=noise, site=SITE, seed=1)
    told = calibrate(made.log, site=SITE, noise=noise)
    listed = Settings(rates=MEANS.rates, axes=MEANS.axes)
    bare = replace(made.log, table=None)
    found = calibrate(bare, site=SITE, noise=noise, settings=listed)
    np.testing.assert_allclose(found.coefficients.values, told.coefficients.values, rtol=1e-9)
    blind = replace(bare, accel=None)
    found = calibrate(blind, site=SITE, noise=noise, settings=listed)
    np.testing.assert_allclose(found.coefficients.values, told.coefficients.values, rtol=1e-9)
    with pytest.raises(FoucaultError, match="no rate of the table"):
        calibrate(bare, site=SITE, noise=noise)


def test_samples_without_a_table_give_the_same_but_for_the_noise():
    noise = grade("tactical").noise
    session = Session(rates=("40 deg/s", "-40 deg/s", "100 deg/s", "-100 deg/s"), step_time=20.0)
    made = simulate(session, model=draw_errors("tactical", 2), noise=noise, site=SITE, seed=2)
    settings = Settings(rates=session.rates, axes=session.axes)
    found = calibrate(replace(made.log, table=None), site=SITE, settings=settings)
    assert found.verdict.level == "pass"
    assert found.diagnostics["noise"]["source"] == "measured in the steps"
    white = found.diagnostics["noise"]["gyro_white"]
    assert white == pytest.approx([noise.gyro.white] * 3, rel=0.15)
    error = found.coefficients.values - made.model.coefficients(NAMES).values
    assert nees(error[None], found.coefficients.cov)[0] < chi_square_limits(18)[1]


def test_g_sensitivity_with_accelerometers_off_the_axis():
    noise = ImuNoise()
    values = {n: 1e-5 for n in ALL if "g_sensitivity" in n} | {"gyro.scale.x": 1e-3}
    made = simulate(MEANS, model=model_of(values), noise=noise, site=SITE, seed=3)
    settings = Settings(g_sensitivity=True, **QUIET)
    arm = np.array([0.05, -0.1, 0.15])
    log = made.log
    rate = log.table.rate
    up = log.accel / np.linalg.norm(log.accel, axis=1, keepdims=True)
    force = -(rate**2)[:, None] * (arm - (up @ arm)[:, None] * up)
    off = replace(log, accel=log.accel + force, gyro=log.gyro + force @ made.model.g_sensitivity.T)
    found = calibrate(off, site=SITE, noise=noise, settings=settings)
    want = made.model.coefficients(ALL).values
    assert np.abs(found.coefficients.values - want).max() < 1e-10


def test_figures_of_the_standards():
    model = model_of({"gyro.scale.x": 1e-3, "gyro.asymmetry.x": 200e-6, "gyro.cubic.y": 1e-4})
    found = solved(model)
    x, y = (found.diagnostics["rate_table"][a] for a in "xy")
    assert x["asymmetry"] == pytest.approx(2 * 200e-6, rel=1e-3)  # the whole difference
    assert x["scale_factor"] == pytest.approx(1.001, abs=1e-6)
    assert x["full_scale"] == pytest.approx(np.radians(100.0), rel=1e-4)
    # The line through y = c w^3 by least squares, w as turned at, twelve steps.
    w = found.tables["rate_steps"]["rate_true"][12:24]
    line = np.polyval(np.polyfit(w, w + 1e-4 * w**3, 1), w)
    worst = np.abs(w + 1e-4 * w**3 - line).max()
    assert y["nonlinearity"] == pytest.approx(worst / np.abs(w).max(), rel=1e-3)


def test_the_table_of_steps_says_before_and_after():
    model = model_of({"gyro.scale.x": 1e-3, "gyro.bias.x": 1e-4, "gyro.asymmetry.x": 1e-4})
    steps = solved(model).tables["rate_steps"]
    assert steps["axis"][:12].tolist() == ["x"] * 12
    x = slice(0, 12)
    true = steps["rate_true"][x]
    want = 1e-3 * true + 1e-4 + 1.001 * 1e-4 * np.abs(true)
    np.testing.assert_allclose(steps["before"][x], want, atol=1e-13)
    assert np.abs(steps["after"]).max() < 1e-13
    assert np.abs(steps["line"][x]).max() > 1e-5
    np.testing.assert_allclose(steps["after_sd"][x], 1e-12 / 1.001, rtol=1e-2)


def test_simulated_tables_have_the_errors_of_the_settings():
    settings = Settings(table_rate_sd=1e-3, fixture_sd=1e-3)
    made = simulate(MEANS, settings=settings, model=ImuModel(), noise=ImuNoise(), site=SITE, seed=1)
    steps = calibrate(made.log, site=SITE, noise=ImuNoise()).tables["rate_steps"]
    ratio = steps["gyro"] / steps["rate_true"]
    assert made.errors.rate_error != 0
    assert np.median(ratio) - 1 == pytest.approx(made.errors.rate_error, abs=3e-4)
    # z up: up in body axes is turned by minus the mounting.
    k = int(np.flatnonzero((steps["axis"] == "z") & (steps["up"] > 0) & (steps["rate"] > 1.7))[0])
    turned = made.mounting[4]
    across = made.log.gyro[k, :2] / made.log.gyro[k, 2]
    np.testing.assert_allclose(across, [turned[1] * -1, turned[0]], rtol=2e-2, atol=3e-6)


def test_a_model_with_terms_keeps_them():
    model = model_of({"gyro.asymmetry.x": 5e-4, "gyro.cubic.y": 1e-5})
    made = simulate(MEANS, model=model, noise=ImuNoise(), site=SITE, seed=1)
    np.testing.assert_array_equal(made.model.gyro_asymmetry, model.gyro_asymmetry)
    np.testing.assert_array_equal(made.model.gyro_cubic, model.gyro_cubic)


def test_what_is_estimated_follows_the_settings():
    assert len(NAMES) == 18
    assert len(ALL) == 27
    linear = Settings(asymmetry=False, cubic=False)
    assert len(names_of(linear)) == 12
    steps = make_readings(make_steps())
    assert from_readings(steps, linear, told=True, site=SITE).equation == EQUATION
    assert from_readings(steps, Settings(), told=True, site=SITE).equation == SCALE_EQUATION


def test_result_is_saved_applied_and_reported(tmp_path):
    noise = grade("tactical").noise
    made = simulate(MEANS, model=draw_errors("tactical", 3), noise=noise, site=SITE, seed=3)
    result = calibrate(made.log, site=SITE, noise=noise, instrument={"name": "G"})
    run_folder.save(result, tmp_path / "run", "")
    again = run_folder.load_result(tmp_path / "run")
    np.testing.assert_array_equal(again.coefficients.values, result.coefficients.values)
    np.testing.assert_array_equal(
        again.tables["rate_steps"]["axis"], ["x"] * 16 + ["y"] * 16 + ["z"] * 16
    )
    out = again.apply(made.log)
    along = np.linalg.norm(out.gyro, axis=1)
    np.testing.assert_allclose(along, np.abs(result.tables["rate_steps"]["rate_true"]), atol=3e-5)
    page = report.html(again)
    assert "Rates before and after" in page
    assert "Asymmetry: difference of the scale factors" in page


def test_a_rate_without_unit_is_named_with_its_place():
    text = campaign.template("rate_table").replace(
        'name = "rate_table"', 'name = "rate_table"\nrates = ["1 deg/s", "5"]'
    )
    text = text.replace("\nrates = []", "", 1)
    with pytest.raises(FoucaultError) as caught:
        campaign.parse(text)
    assert "procedure.rates" in str(caught.value)
    with pytest.raises(FoucaultError, match="wants a number and a unit"):
        Settings(rates=("5",))
    np.testing.assert_allclose(in_si(("180 deg/s", "-1 rad/s")), [np.pi, -1.0])


RATES = ("10 deg/s", "-10 deg/s", "40 deg/s", "-40 deg/s", "100 deg/s", "-100 deg/s")
ONE = ("gyro.bias.x", "gyro.bias.y", "gyro.bias.z", "gyro.scale.x", "gyro.misalignment.yx",
       "gyro.misalignment.zx", "gyro.asymmetry.x", "gyro.cubic.x")  # fmt: skip


def one_axis(seed, rows="means", axes=("x up",), grade_name="tactical"):
    session = Session(rates=RATES, axes=axes, step_time=20.0, rest_time=15.0, rows=rows)
    noise, model = grade(grade_name).noise, draw_errors(grade_name, seed)
    return simulate(session, model=model, noise=noise, site=SITE, seed=seed), noise


def miss(result, made):
    found = result.coefficients
    error = found.values - made.model.coefficients(found.names).values
    return float(error @ np.linalg.solve(found.cov, error))


@pytest.mark.parametrize("rows", ["means", "samples"])
def test_one_axis_on_the_table_with_rests_between_the_rates(rows):
    made, noise = one_axis(1, rows)
    known = noise if rows == "means" else None
    bare = replace(made.log, table=None)
    blind = replace(bare, accel=None)
    with_rests = [r for rate in RATES for r in ("0 deg/s", rate)] + ["0 deg/s"]
    one = {"axes": ("x up",)}
    for log, settings in (
        (made.log, Settings(**one)),
        (bare, Settings(rates=RATES, **one)),
        (bare, Settings(rates=tuple(with_rests), **one)),
        (blind, Settings(rates=RATES, **one)),
    ):
        result = calibrate(log, site=SITE, settings=settings, noise=known)
        assert result.coefficients.names == ONE
        assert result.verdict.level is Level.PASS
        assert not result.findings
        rates = np.degrees(result.tables["rate_steps"]["rate"])
        np.testing.assert_allclose(rates[::2], 0.0, atol=1e-9)
        np.testing.assert_allclose(rates[1::2], [10, -10, 40, -40, 100, -100], rtol=1e-6)
        low, high = chi_square_limits(len(ONE))
        assert low < miss(result, made) < high
    assert any("Rates about y and z" in words for words in result.diagnostics["unseen"])
    assert list(result.diagnostics["rate_table"]) == ["x"]
    assert "Asymmetry: difference of the scale factors" in report.html(result)


def test_one_axis_that_is_not_named_says_how():
    made, noise = one_axis(1)
    with pytest.raises(FoucaultError, match="name in `axes` the placements that were meant"):
        calibrate(made.log, site=SITE, noise=noise)
    with pytest.raises(FoucaultError, match="says: y up"):
        calibrate(made.log, site=SITE, noise=noise, settings=Settings(axes=("y up",)))


def test_rests_and_a_reversed_table_or_another_rate():
    made, noise = one_axis(2)
    bare = replace(made.log, table=None)
    for rates, code in (
        (tuple(r[1:] if r[0] == "-" else f"-{r}" for r in RATES), "rate_table.sense"),
        (("10 deg/s", "-10 deg/s", "100 deg/s", "-100 deg/s"), "rate_table.other_rate"),
    ):
        with refuses(code):
            settings = Settings(rates=rates, axes=("x up",))
            calibrate(bare, site=SITE, noise=noise, settings=settings)


def test_a_mems_bias_is_no_rate_where_one_axis_alone_is_spun():
    made, noise = one_axis(3, grade_name="mems")
    shifted = replace(made.log, table=None, gyro=made.log.gyro + np.radians([3.0, -2.0, 1.0]))
    settings = Settings(rates=RATES, axes=("x up",))
    result = calibrate(shifted, site=SITE, noise=noise, settings=settings)
    bias = result.coefficients["gyro.bias"].values - made.model.gyro_bias
    np.testing.assert_allclose(np.degrees(bias), [3.0, -2.0, 1.0], atol=0.02)


@pytest.mark.thorough
def test_errors_of_one_axis_with_rests_are_as_large_as_promised():
    """A covariance that is 20 % off is found out in 99 % of cases."""
    total, n = 0.0, 182
    for seed in range(n):
        made, noise = one_axis(seed, axes=("y up", "y down"))
        settings = Settings(axes=("y up", "y down"), repeatability=False)
        total += miss(calibrate(made.log, site=SITE, noise=noise, settings=settings), made)
    low, high = chi_square_limits(n * len(ONE))
    assert low < total < high


@pytest.mark.thorough
def test_sessions_of_one_axis_with_rests_fall_under_doubt_as_seldom_as_stated():
    """The Earth's rate in the rests of one placement is one vector, not another in each."""
    names, n, doubted = ("y up", "y down"), 100, 0
    squares, dof = [], 0
    for seed in range(n):
        made, noise = one_axis(seed, axes=names)
        result = calibrate(made.log, site=SITE, noise=noise, settings=Settings(axes=names))
        doubted += result.verdict.level is not Level.PASS
        squares.append(result.diagnostics["chi_square_of_noise_alone"]["steps"][0])
        dof += result.diagnostics["chi_square_of_noise_alone"]["steps"][3]
    # Four checks with limits at 1 % each; the residuals are as large as they should be.
    assert doubted <= binom.ppf(0.995, n, 4 * FALSE_ALARM)
    low, high = chi_square_limits(dof)
    assert low < np.sum(squares) < high


@pytest.mark.parametrize("what", ["drift", "noise"])
def test_one_axis_with_rests_that_drifts_or_has_another_noise_is_no_pass(what):
    made, noise = one_axis(1, axes=("y up", "y down"))
    log, settings = made.log, Settings(axes=("y up", "y down"), repeatability=False)
    if what == "drift":
        moved = 20 * np.radians(1.0) / 3600 * (by_time(log.time))[:, None]
        log = replace(log, gyro=log.gyro + moved)
    else:
        noise = replace(noise, gyro=replace(noise.gyro, white=2 * noise.gyro.white))
    result = calibrate(log, site=SITE, noise=noise, settings=settings)
    failed = {c.name for c in result.checks if not c.passed}
    assert ("drift" if what == "drift" else "noise of steps") in failed


WANDERS = ImuNoise(
    TriadNoise(white=50e-6 * 9.81, bias_instability=15e-6 * 9.81),
    TriadNoise(white=np.radians(0.01) / 60, bias_instability=np.radians(3) / 3600),
)


def wandering(seed):
    """Error and result of a session in which the bias wanders as declared."""
    model = draw_errors("mems", seed)
    made = simulate(MEANS, model=model, noise=WANDERS, site=SITE, seed=seed)
    result = calibrate(made.log, site=SITE, noise=WANDERS)
    truth = made.model.coefficients(result.coefficients.names).values
    return result.coefficients.values - truth, result


def test_bias_wander_that_is_declared_is_the_uncertainty_of_the_long_term_bias():
    """A session of some 20 min has four correlation times: its mean bias is not the long-term."""
    _, result = wandering(1)
    sd = np.degrees(result.coefficients["gyro.bias"].sd) * 3600
    assert (sd > 0.8).all() and (sd < 3.0).all()
    assert result.verdict.level is Level.PASS
    assert "rate_table.bias_moved" not in [f.code for f in result.findings]
    share = np.array(result.diagnostics["budget"]["slow noise of gyros"][:3])
    assert (share > 0.9 * result.coefficients["gyro.bias"].sd ** 2).all()


@pytest.mark.thorough
def test_errors_under_declared_wander_are_as_large_as_promised():
    squares, n = 0.0, 25  # standard deviations wrong by 1.2 are found out in 99 %
    for seed in range(n):
        error, result = wandering(seed)
        squares += error @ np.linalg.solve(result.coefficients.cov, error)
    low, high = chi_square_limits(n * len(NAMES))
    assert low < squares < high
