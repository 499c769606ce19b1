"""The procedures on a table from log to result: variants, refusals, what is in the covariance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from foucault import report, run_folder
from foucault.errors import FoucaultError
from foucault.estimate.table import FORCES, IN_SPINS
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.procedures import multi_position, norm_observation, on_table, turntable
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import TableColumns

SITE = Site(9.81, np.radians(45.0), gravity_sd=0.0)
NOISE = grade("tactical").noise
MODEL = draw_errors("tactical", 5)
PERFECT = {"plumb_sd": 0.0, "orthogonality_sd": 0.0, "zero_sd": 0.0, "position_sd": 0.0}
ARCMIN = np.radians(1 / 60)
MODULES = [norm_observation, multi_position, turntable]


def named(module):
    return module.__name__.rpartition(".")[2]


def simulated_with(model, module, *, seed=1, spins=True, silent=False, session=(), **settings):
    """Simulate a log of means of an instrument."""
    plan = {k: v for k, v in settings.items() if k in ("plan", "both_senses", "four_positions")}
    return module.simulate(
        module.Session(rows="means", **dict(session)), settings=module.Settings(**plan),
        model=model, noise=ImuNoise() if silent else NOISE, site=SITE, seed=seed, spins=spins,
        judged=None,
    )  # fmt: skip


@cache
def _simulated(module, session, options):
    return simulated_with(MODEL, module, session=session, **dict(options))


def simulated(module=norm_observation, *, session=(), **options):
    """Simulate a log of means of the usual instrument, once."""
    return _simulated(module, tuple(sorted(dict(session).items())), tuple(sorted(options.items())))


def run(module=norm_observation, *, log=None, site=SITE, noise=NOISE, prior=None, **options):
    """Calibrate a log of means, or the one that the same options simulate."""
    settings = {k: v for k, v in options.items() if k not in ("seed", "spins", "silent", "session")}
    log = simulated(module, **options).log if log is None else log
    return module.calibrate(
        log, site=site, settings=module.Settings(**settings), noise=noise, prior=prior
    )


def errors_of(result, model=MODEL):
    return result.coefficients.values - model.coefficients(result.coefficients.names).values


def quadratic(result, model=MODEL):
    """NEES of one result, as a probability to be exceeded."""
    e = errors_of(result, model)
    return chi2.sf(e @ np.linalg.solve(result.coefficients.cov, e), len(e))


def code_of(call):
    with pytest.raises(FoucaultError) as caught:
        call()
    return caught.value.code, str(caught.value)


# -- solutions and unifications ----------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("solution", ["likelihood", "linear"])
@pytest.mark.parametrize("spins", [True, False])
def test_errors_are_inside_their_covariance(solution, spins):
    result = run(solution=solution, spins=spins)
    assert result.verdict.level is Level.PASS
    assert 1e-3 < quadratic(result) < 1 - 1e-3
    assert len(result.coefficients) == (21 if spins else 9)


def test_linear_solution_has_the_uncertainty_of_twelve_norms():
    """Per 10 ug in a reading: 5.0 ug of bias, 7.07 ppm of scale, 11.2 urad."""
    result = run(solution="linear")
    unit = NOISE.accel.white / np.sqrt(60) / 9.81 / 1e-5
    sd = dict(zip(result.coefficients.names, result.coefficients.sd, strict=True))
    for name, wanted in (("bias", 5.0 * 9.81), ("scale", 7.07)):
        for a in "xyz":
            assert sd[f"accel.{name}.{a}"] == pytest.approx(wanted * unit * 1e-6, rel=0.01)
    for pair in ("yx", "zx", "zy"):
        assert sd[f"accel.misalignment.{pair}"] == pytest.approx(11.2 * unit * 1e-6, rel=0.015)
    gyro = NOISE.gyro.white / np.sqrt(4 * 36)
    for a in "xyz":
        assert sd[f"gyro.bias.{a}"] == pytest.approx(gyro / 2, rel=0.01)


def test_likelihood_is_no_worse_than_the_linear_solution():
    ml, linear = run(), run(solution="linear")
    assert (ml.coefficients.sd <= linear.coefficients.sd * (1 + 1e-6)).all()
    assert ml.coefficients.sd[0] < 0.75 * linear.coefficients.sd[0]  # spins show up too


@pytest.mark.thorough
def test_published_recovery_shows_its_bias_and_the_exact_one_none():
    bias = 9.81 * np.array([8e-4, -1e-3, -3.2e-3])
    model = ImuModel(
        np.array([[1.002, 0, 0], [3e-4, 1.008, 0], [-5e-4, 6e-4, 1.006]]), bias,
        gyro_bias=np.array([2e-6, -1e-6, 3e-6]),
    )  # fmt: skip
    log = simulated_with(model, norm_observation, silent=True, session={"plumb_sd": 0.0}).log
    exact = errors_of(run(log=log, solution="linear"), model)
    published = errors_of(run(log=log, solution="published"), model)
    scale = [n.startswith("accel.scale") for n in LINEAR_LOWER]
    assert np.abs(exact).max() < 1e-11
    # Half the square of the bias in g, in every accelerometer.
    half = (8e-4**2 + 1e-3**2 + 3.2e-3**2) / 2
    np.testing.assert_allclose(published[scale], -half, rtol=0.05)
    assert half == pytest.approx(5.94e-6, rel=1e-3)


@pytest.mark.thorough
def test_four_positions_believe_the_table_and_parallel_vectors_do_not():
    chosen = {"solution": "linear", "four_positions": True}
    gyro = [n.startswith("gyro.misalignment") for n in LINEAR_LOWER]
    small = {"mounting_sd": 0.1 * ARCMIN}
    for session in (PERFECT | small, small | {"position_sd": 3 * ARCMIN}):
        ours = run(**chosen, session=session)
        theirs = run(**chosen, session=session, unification="four positions")
        same = ours.coefficients.values - theirs.coefficients.values
        untouched = [n.startswith("accel") or n.startswith("gyro.bias") for n in LINEAR_LOWER]
        assert not same[untouched].any()
        z = (errors_of(theirs) / theirs.coefficients.sd)[gyro]
        assert np.abs((errors_of(ours) / ours.coefficients.sd)[gyro]).max() < 4
        if session["position_sd"]:
            assert np.abs(errors_of(theirs)[gyro]).max() > ARCMIN
        else:
            assert np.abs(z).max() < 4


@pytest.mark.thorough
def test_published_recovery_goes_with_either_unification():
    theirs = run(solution="published", four_positions=True, unification="four positions")
    ours = run(solution="published")
    same = [n.startswith("accel") for n in LINEAR_LOWER]
    assert theirs.coefficients.names == ours.coefficients.names
    assert np.abs(errors_of(theirs))[same].max() < 1e-4


def test_four_positions_must_have_been_measured():
    code, words = code_of(lambda: run(solution="linear", unification="four positions"))
    assert code == "unification.four_positions"
    assert "four_positions = true" in words


def test_all_procedures_agree_on_a_perfect_table():
    for module in MODULES:
        result = run(module, session=PERFECT, silent=True)
        assert np.abs(errors_of(result)).max() < 1e-11, named(module)


def test_only_those_that_doubt_the_table_stand_its_errors():
    bad = {"position_sd": 10 * ARCMIN, "orthogonality_sd": 5 * ARCMIN}
    free = run(session=bad)
    joint = run(turntable, session=bad, position_sd=10 * ARCMIN, orthogonality_sd=5 * ARCMIN)
    believed = run(multi_position, session=bad)
    assert quadratic(free) > 1e-3
    assert quadratic(joint) > 1e-3
    assert believed.verdict.level is not Level.PASS
    assert np.abs(errors_of(believed) / free.coefficients.sd).max() > 50


# -- what is estimated ---------------------------------------------------------------------------


def test_names_follow_what_was_chosen():
    s = norm_observation.Settings
    names = norm_observation.Settings.estimated
    assert names(s()) == LINEAR_LOWER
    assert all(n.startswith("accel.") for n in names(s(), gyro=False))
    assert len(names(s(), gyro=False)) == 9
    more = names(s(accel_quadratic=True, g_sensitivity=True))
    assert len(more) == 21 + 3 + 9
    assert "accel.quadratic.y" in more
    assert "gyro.g_sensitivity.zx" in more
    assert len(names(s(accel_quadratic=True, g_sensitivity=True), gyro=False)) == 12


@pytest.mark.thorough
@pytest.mark.parametrize("module", [norm_observation, turntable])
def test_quadratic_terms_and_g_sensitivity_are_recovered(module):
    rng = np.random.default_rng(2)
    quadratic_terms = np.zeros((3, 6))
    quadratic_terms[range(3), range(3)] = 1e-5 * rng.normal(size=3)
    model = replace(
        MODEL, accel_quadratic=quadratic_terms, g_sensitivity=1e-6 * rng.normal(size=(3, 3))
    )
    chosen = {"plan": "dodecahedron 20", "both_senses": True}
    log = simulated_with(model, module, **chosen).log
    result = run(module, log=log, accel_quadratic=True, g_sensitivity=True, **chosen)
    assert len(result.coefficients) == 33
    assert result.verdict.level is Level.PASS
    assert 1e-3 < quadratic(result, model) < 1 - 1e-3
    # They are seen: the largest of each kind stands out of its sd.
    values, sd = result.coefficients.values, result.coefficients.sd
    for kind in ("accel.quadratic", "gyro.g_sensitivity"):
        mine = [n.startswith(kind) for n in result.coefficients.names]
        assert np.abs(values / sd)[mine].max() > 5
    left_out = run(module, log=log, **chosen)
    assert left_out.verdict.level is not Level.PASS or quadratic(left_out, model) < 1e-3


def test_accelerometers_alone():
    log = replace(simulated(spins=False).log, gyro=None)
    for module in MODULES:
        result = run(module, log=log)
        assert all(n.startswith("accel.") for n in result.coefficients.names)
        assert "session.no_gyro" in [f.code for f in result.findings]
        if module is not multi_position:
            assert quadratic(result) > 1e-3


def test_gyros_without_spins_are_left_out_with_a_note():
    result = run(spins=False)
    codes = {f.code: f.severity for f in result.findings}
    assert codes["readings.no_spins"] == "note"
    assert "gyro.bias.x" not in result.coefficients.names


def test_a_lever_arm_is_found_within_its_sd():
    options = {"session": {"lever_arm_sd": 0.5}}
    truth = simulated(**options).rig.lever_arm
    rig = run(**options).tables["rig"]
    assert list(rig["name"]) == ["lever_arm.x", "lever_arm.y", "lever_arm.z"]
    assert np.abs((rig["value"] - truth) / rig["sd"]).max() < 4
    assert (rig["sd"] < 0.01).all()


# -- refusals --------------------------------------------------------------------------------------


def test_gyros_need_a_latitude():
    code, _ = code_of(lambda: run(site=Site(9.81, None)))
    assert code == "readings.no_latitude"
    code, _ = code_of(lambda: run(earth_rate=False))
    assert code == "readings.no_latitude"
    # Accelerometers do not.
    assert len(run(site=Site(9.81, None), spins=False).coefficients) == 9


def test_angles_are_needed_where_they_are_used():
    site = SITE
    for module in (multi_position, turntable):
        task = module.task_of(module.Settings(), site)
        readings = on_table.read_positions(simulated().log, task, NOISE)
        blind = replace(readings, angles=np.full_like(readings.angles, np.nan))
        code, words = code_of(lambda r=blind, t=task: on_table.from_readings(r, t, site=site))
        assert code == "readings.no_angles"
        assert named(module) in words
    task = norm_observation.task_of(norm_observation.Settings())
    assert quadratic(on_table.from_readings(blind, task, site=site)) > 1e-3


def test_angles_that_were_not_logged_are_those_of_the_plan():
    log = simulated().log
    blind = replace(log, table=TableColumns(np.full_like(log.table.angles, np.nan), log.table.rate))
    told, untold = run(turntable), run(turntable, log=blind)
    np.testing.assert_allclose(untold.coefficients.values, told.coefficients.values, rtol=1e-6)


def test_a_log_without_accelerometers():
    code, _ = code_of(lambda: run(log=replace(simulated().log, accel=None)))
    assert code == "session.no_accel"


def rows(log, keep):
    table = replace(log.table, angles=log.table.angles[keep], rate=log.table.rate[keep])
    return replace(
        log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep], table=table,
        averaged=log.averaged[keep],
    )  # fmt: skip


def test_fewer_positions_than_coefficients():
    log = simulated().log
    some = rows(log, np.r_[0:12, 12:17])
    code, words = code_of(lambda: run(log=some))
    assert code == "readings.too_few"
    assert "5 spins" in words
    assert "9 or more" in words
    few = replace(rows(log, np.r_[0:8]), gyro=None)
    code, words = code_of(lambda: run(log=few))
    assert code == "readings.too_few"
    assert "8 rests and spins" in words
    assert (
        "12 or more"
        in code_of(
            lambda: run(log=replace(rows(log, np.r_[0:10]), gyro=None), accel_quadratic=True)
        )[1]
    )


@pytest.mark.parametrize("senses", [False, True])
def test_a_singular_plan_says_which_coefficients_it_cannot_separate(senses):
    level = PERFECT | {"mounting_sd": 0.0}
    code, words = code_of(
        lambda: run(plan="6 faces", both_senses=senses, session=level, silent=True)
    )
    assert code in ("plan.too_few", "plan.singular", "readings.too_few")
    if senses:
        for pair in ("yx", "zx", "zy"):
            assert f"accel.misalignment.{pair}" in words
        assert "accel.bias" not in words


def test_readings_that_no_instrument_gives():
    log = simulated(spins=False).log
    accel = log.accel.copy()
    accel[:, 1] = accel[:, 0]
    code, _ = code_of(lambda: run(log=replace(log, accel=accel, table=None)))
    assert code.startswith(("readings.", "plan.", "table.", "position"))


# -- uncertainties --------------------------------------------------------------------------------


def test_a_prior_narrows_as_conditioning_does():
    plain = run(loss="squares", repeatability=False)
    k = plain.coefficients.layout.index("accel.bias.z")
    P, s = plain.coefficients.cov, plain.coefficients.sd[k]
    mean = plain.coefficients.values[k] + s
    result = run(loss="squares", repeatability=False, prior={"accel.bias.z": (mean, s)})
    gain = P[:, k] / (P[k, k] + s**2)
    np.testing.assert_allclose(result.coefficients.cov, P - np.outer(gain, P[k]), rtol=2e-3,
                               atol=1e-4 * np.abs(P).max())  # fmt: skip
    assert result.coefficients.sd[k] == pytest.approx(s / np.sqrt(2), rel=1e-3)
    moved = result.coefficients.values - plain.coefficients.values
    np.testing.assert_allclose(moved, gain * s, atol=2e-3 * s * np.abs(gain).max())
    assert result.coefficients.prior_sd[k] == s


def scales(result, triad):
    return [n.startswith(f"{triad}.scale") for n in result.coefficients.names]


def test_uncertainty_of_gravity_is_in_the_scales():
    plain, more = run(), run(site=replace(SITE, gravity_sd=9.81e-5))
    extra = more.coefficients.cov - plain.coefficients.cov
    mine = scales(plain, "accel")
    model = ImuModel.from_coefficients(plain.coefficients)
    size = np.diag(model.accel_matrix) * 1e-5
    np.testing.assert_allclose(extra[np.ix_(mine, mine)], np.outer(size, size), rtol=1e-6)
    assert "local gravity" in more.diagnostics["budget"]


def test_uncertainty_of_the_tables_rate_is_in_the_gyro_scales():
    plain, more = run(plumb_sd=0.0), run(plumb_sd=0.0, table_rate_sd=2e-5)
    extra = np.diag(more.coefficients.cov - plain.coefficients.cov)
    mine = scales(plain, "gyro")
    model = ImuModel.from_coefficients(plain.coefficients)
    np.testing.assert_allclose(extra[mine], (2e-5 * np.diag(model.gyro_matrix)) ** 2, rtol=1e-6)
    assert not np.any(extra[scales(plain, "accel")])


def test_a_tilt_towards_north_is_in_the_gyro_scales_where_it_is_not_modelled():
    plain, more = run(plumb_sd=0.0), run(plumb_sd=0.1)
    extra = np.diag(more.coefficients.cov - plain.coefficients.cov)[scales(plain, "gyro")]
    wanted = 0.1 * EARTH_RATE * np.cos(SITE.latitude) / np.radians(10.0)
    np.testing.assert_allclose(np.sqrt(extra), wanted, rtol=2e-3)
    # A joint estimate finds it itself.
    joint = run(turntable).diagnostics["budget"]
    assert "rate of the table" not in joint


@pytest.mark.parametrize(
    ("module", "more"),
    [*((m, {}) for m in MODULES),
     *((norm_observation, {"solution": s}) for s in ("linear", "published"))],
)  # fmt: skip
def test_the_budget_is_the_whole_variance(module, more):
    result = run(module, table_rate_sd=1e-6, site=replace(SITE, gravity_sd=1e-4), **more)
    total = np.sum(list(result.diagnostics["budget"].values()), axis=0)
    np.testing.assert_allclose(total, result.coefficients.sd**2, rtol=1e-6)


def test_the_bound_is_that_of_the_noise_alone():
    result = run(repeatability=False, plumb_sd=0.0, loss="squares")
    np.testing.assert_allclose(result.diagnostics["bound"], result.coefficients.sd, rtol=1e-6)


def test_noise_that_was_declared_is_not_called_unknown():
    assert "readings.noise_unknown" not in [f.code for f in run().findings]
    measured = run(noise=None)
    assert "readings.noise_unknown" in [f.code for f in measured.findings]


@pytest.mark.thorough
def test_without_declared_noise_the_residuals_tell_it():
    """Two variances, from about 19 equations each, estimated: the mean of several sessions."""
    ratios = []
    for seed in range(1, 7):
        known, measured = run(seed=seed), run(seed=seed, noise=None)
        assert {FORCES, IN_SPINS} <= set(measured.diagnostics["noise"]["scatter"])
        assert measured.verdict.level is Level.PASS
        ratios.append(measured.coefficients.sd / known.coefficients.sd)
    mean = np.mean(ratios, axis=0)
    # Rests and spins then weigh alike, although they last 60 and 144 s: a little is lost.
    assert (mean > 0.75).all()
    assert (mean < 1.5).all()


def test_an_outlier_is_named_without_declared_noise_too():
    log = simulated(plan="dodecahedron 20", spins=False).log
    accel = log.accel.copy()
    accel[6] *= 1.001
    result = run(log=replace(log, accel=accel), noise=None, plan="dodecahedron 20")
    assert "readings.outlier" in [f.code for f in result.findings]
    assert any("rest 7" in c.sentence for c in result.checks)
    assert quadratic(result) > 1e-4


def test_declared_noise_of_a_tenth_fails():
    low = ImuNoise(
        TriadNoise(white=NOISE.accel.white / 10), TriadNoise(white=NOISE.gyro.white / 10)
    )
    result = run(noise=low)
    assert result.verdict.level is not Level.PASS
    assert any("declared noise is too small" in c.sentence for c in result.checks if not c.passed)


# -- a result is kept and shown -------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("module", MODULES)
def test_saved_loaded_and_reported(module, tmp_path):
    options = {"solution": "published"} if module is norm_observation else {}
    result = run(module, **options)
    run_folder.save(result, tmp_path)
    back = run_folder.load_result(tmp_path)
    assert np.array_equal(back.coefficients.values, result.coefficients.values)
    assert np.array_equal(back.coefficients.cov, result.coefficients.cov)
    assert back.procedure == named(module)
    assert set(back.tables) >= {"readings", "rig"}
    page = report.write(tmp_path).read_text(encoding="utf-8")
    assert "lever_arm" in page or "lever arm" in page.lower()
    assert len(page) > 10_000


def test_progress_is_told():
    told = []
    norm_observation.calibrate(
        simulated().log, site=SITE, noise=NOISE, progress=lambda x, words: told.append(x)
    )
    assert told == sorted(told)
    assert told[-1] == 1.0


@pytest.mark.thorough
def test_a_large_log_stays_on_disk_and_gives_the_same(tmp_path, monkeypatch):
    from foucault import campaign
    from foucault.campaign import running

    text = campaign.template("turntable").replace('rest_time = "60 s"', 'rest_time = "10 s"')
    made = campaign.save_session(campaign.simulate(campaign.parse(text)), tmp_path)
    in_memory = campaign.calibrate(made)
    monkeypatch.setattr(running, "STREAMED", 0)
    on_disk = campaign.calibrate(made)
    difference = in_memory.coefficients.values - on_disk.coefficients.values
    assert np.abs(difference / in_memory.coefficients.sd).max() < 1e-6
    assert on_disk.provenance["input"]["sha256"] == in_memory.provenance["input"]["sha256"]
    assert on_disk.verdict == in_memory.verdict
