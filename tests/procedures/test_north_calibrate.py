"""From simulated tables to coefficients: exact, consistent, and every check can fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose import north_calibration as judge
from foucault.errors import FoucaultError, Status
from foucault.infer import mixed
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.north_seeker import RATE_LEVEL, RATE_TILTED, SEEKER
from foucault.procedures.north_seeking import (
    Session,
    Settings,
    calibrate,
    draw_errors,
    names_in,
    simulate,
)
from foucault.result import Level, Verdict
from make_dwells import FIELD, level, make_dwells, make_log

SITE = Site.at(0.8)
ARCMIN = np.radians(1 / 60)
TILTS = ("8 deg", "-8 deg", "0 deg")


def model_of(values):
    names = tuple(n for n in SEEKER.names if n in values)
    vector = CoefficientVector(SEEKER.subset(names), np.array([values[n] for n in names]))
    return ImuModel.from_coefficients(vector)


def made(session=None, settings=None, *, model=None, noise=FIELD, seed=1):
    model = ImuModel() if model is None else model
    return simulate(session or Session(), settings=settings, model=model, noise=noise, site=SITE,
                    seed=seed)  # fmt: skip


def done(session=None, settings=None, *, model=None, noise=FIELD, seed=1, known="same", **words):
    log = made(session, settings, model=model, noise=noise, seed=seed).log
    given = noise if known == "same" else known
    return calibrate(log, site=SITE, settings=settings, noise=given, **words)


def check_of(result, name):
    return next(c for c in result.checks if c.name == name)


def test_where_the_noise_came_from():
    quiet = done().diagnostics["noise"]
    assert quiet["source"] == "declared"
    dwells = done(Session(dwell=30.0, rows="samples", rate=2.0), known=None)
    assert dwells.diagnostics["noise"]["source"] == "measured in the dwells"
    left = done(known=None)
    assert left.diagnostics["noise"]["source"] == "from the residuals"
    noise = [c for c in left.checks if c.name.startswith("noise")]
    assert len(noise) == 2 and all("unknown" in c.sentence for c in noise), "no test by itself"
    for result in (dwells, left):
        assert result.diagnostics["noise"]["gyro_white"][0] == pytest.approx(
            FIELD.gyro.white, rel=0.25
        )
        assert result.diagnostics["noise"]["accel_white"][0] == pytest.approx(
            FIELD.accel.white, rel=0.25
        )


def test_the_coupling_of_the_third_rate():
    """Free it costs certainty; with what is known of it, less; left out, it is missed if there."""
    model = model_of({"gyro.misalignment.xz": 4e-3, "gyro.misalignment.yz": -3e-3})
    tilted = Session(tilts=TILTS, dwell=600.0)
    free, auto = (done(tilted, Settings(z_coupling=z), model=model) for z in ("free", "auto"))
    for result in (free, auto):
        assert result.diagnostics["z_coupling"][1] < 1e-4
        c = result.coefficients
        i = c.names.index("gyro.misalignment.xz")
        assert abs(c.values[i] - 4e-3) < 4 * c.sd[i]
    assert (auto.coefficients.sd <= free.coefficients.sd * (1 + 1e-9)).all()
    assert len(free.tables["headings"]["heading_after"]) == tilted.headings * len(TILTS)
    without = done(tilted, Settings(z_coupling="no"), model=model)
    assert "gyro.misalignment.xz" not in without.coefficients.names
    assert "north.z_left_out" in [f.code for f in without.findings]
    level = done(model=model)
    i = level.coefficients.names.index("gyro.misalignment.xz")
    assert level.coefficients.sd[i] == pytest.approx(Settings().z_coupling_sd, rel=0.01)
    assert level.diagnostics["z_coupling"] is None


@pytest.mark.parametrize("tilts", [("0 deg",), ("2 deg", "0 deg"), TILTS])
def test_no_coefficient_is_known_better_than_its_bound(tilts, seed=1):
    """What is known of the coupling beforehand is in the sd, so that it is in the bound."""
    settings = Settings(heading_sd=ARCMIN / 10)
    c = done(Session(tilts=tilts), settings, model=draw_errors("", seed), seed=seed)
    bound = np.array(c.diagnostics["bound"])
    assert {"gyro.misalignment.xz", "gyro.misalignment.yz"} <= set(c.coefficients.names)
    np.testing.assert_array_less(bound, c.coefficients.sd * (1 + 1e-9))
    assert (bound > 0.2 * c.coefficients.sd).all()


def test_drift_is_estimated_where_it_is_free():
    drifting = Session(order="palindrome", gyro_drift=3e-10)
    assert done(drifting).diagnostics["drift"] == "estimated"
    assert done(drifting).verdict.level is Level.PASS
    kept = done(drifting, Settings(drift="none"))
    assert kept.diagnostics["drift"] == "none"
    assert not check_of(kept, "noise of gyro readings over index angles").passed
    # Four stops have one number more than unknowns: a drift would take it.
    assert done().diagnostics["drift"] == "auto"


def test_the_result_says_what_a_reader_needs():
    result = done(Session(), Settings(heading_offset_sd=ARCMIN), model=draw_errors("", 3),
                  instrument={"serial": "7"})  # fmt: skip
    d = result.diagnostics
    n = len(result.coefficients)
    assert result.instrument == {"serial": "7"}
    variance = np.diag(result.coefficients.cov)
    np.testing.assert_allclose(np.sum(list(d["budget"].values()), axis=0), variance, rtol=1e-6)
    assert len(d["bound"]) == n
    assert "1 arcmin" in d["unseen"][0]
    table = result.tables["headings"]
    assert len(table["setup"]) == 12 and np.isfinite(table["residual_x"]).all()
    assert set(result.validity["index"]) == {0.0, 90.0, 180.0, 270.0}
    assert set(names_in(Settings(), Session())) == set(result.coefficients.names)
    assert set(names_in(Settings(tilt="each"), Session())) == set(RATE_TILTED)
    assert set(names_in(Settings(), Session(tilts=TILTS))) == set(RATE_TILTED)
    six = names_in(Settings(z_coupling="no"), Session())
    assert set(six) == {*RATE_LEVEL, "accel.bias.x", "accel.bias.y"}


def test_a_prior_counts_and_a_held_accelerometer_too():
    plain = done()
    tight = done(prior={"gyro.bias": (0.0, 1e-12)})
    i = plain.coefficients.names.index("gyro.bias.x")
    assert abs(tight.coefficients.values[i]) < 1e-10 < abs(plain.coefficients.values[i])
    assert tight.coefficients.sd[i] < 1.01e-12


# -- every check can fail --------------------------------------------------------------------------


def spoiled(change, session=None, **words):
    log = made(session or Session()).log
    return calibrate(change(log), site=SITE, noise=FIELD, **words)


def rotated(log, setup, angle):
    heading = log.heading.copy()
    heading[log.setup == setup] += angle
    return replace(log, heading=heading)


def test_a_heading_that_is_off_is_named():
    result = spoiled(lambda log: rotated(log, 4, np.radians(2.0)))
    assert not check_of(result, "noise of gyro rates over headings").passed
    assert result.verdict.level is Level.DOUBTFUL
    fits = check_of(result, "every heading fits")
    assert not fits.passed and "more than chance gives" in fits.sentence
    assert check_of(done(), "every heading fits").passed
    told = next(f for f in result.findings if f.code == "north.heading_outlier")
    assert f"'{made().log.names[4]}'" in told.message and "standard deviations" in told.message


def test_a_reading_that_is_off_shows_over_the_index_angles():
    def change(log):
        gyro, accel = log.gyro.copy(), log.accel.copy()
        gyro[10] += 1e-6
        accel[21] += 3e-3
        return replace(log, gyro=gyro, accel=accel)

    result = spoiled(change)
    for what in ("gyro readings over index angles", "accelerometer readings over index angles",
                 "specific forces over headings"):  # fmt: skip
        assert not check_of(result, f"noise of {what}").passed


def test_few_headings_fail_the_redundancy():
    result = done(Session(headings=3))
    assert not check_of(result, "redundancy").passed
    assert "Add headings" in check_of(result, "redundancy").sentence
    three = done(Session(headings=3, tilts=("0 deg", "8 deg")))
    assert three.verdict.level is not Level.UNUSABLE


def test_a_computation_that_fails_is_unusable():
    good = done()
    assert check_of(good, "converged").passed
    failed = checks_of(Status.NOT_CONVERGED)
    assert not failed.passed and Verdict.of((failed,)).level is Level.UNUSABLE


def checks_of(status):
    """The check of a calibration that ended otherwise."""
    from foucault.estimate import north as estimation
    from foucault.estimate.north_reduction import reduce

    dwells = make_dwells(level(), 0.8)
    pairs = reduce(dwells, FIELD)
    table = estimation.Rig(level()[:, 0], SITE, "one axis", True)
    layout = SEEKER.subset(names_in(Settings(z_coupling="no"), Session()))
    found = mixed.fit(estimation.OnTurntable(pairs, table, layout))
    ended = replace(found, estimate=replace(found.estimate, status=status))
    some = judge.checks(ended, pairs, table, dwells, "declared", judge.each_apart(ended))
    return next(c for c in some if c.name == "converged")


def test_a_table_less_level_than_was_said():
    """Up leans by 3 arcmin to the east, which turns with the heading."""
    psi = level()[:, 0]
    lean = 3 * ARCMIN
    poses = np.column_stack([psi, -lean * np.sin(psi), lean * np.cos(psi)])
    log = make_log(make_dwells(poses, 0.8, headings=psi, noise=FIELD))
    said = {sd: calibrate(log, site=SITE, noise=FIELD, settings=Settings(level_sd=sd))
            for sd in (0.3 * ARCMIN, 3 * ARCMIN)}  # fmt: skip
    wrong, right = (check_of(r, "level") for r in said.values())
    assert right.passed and not wrong.passed
    assert "it is less level than was said" in wrong.sentence


@pytest.mark.parametrize("angles", [(0.0, 180.0), (0.0, 40.0), (0.0, 0.5, 1.0)])
def test_headings_that_do_not_span_are_refused(angles):
    poses = np.column_stack([np.radians(angles), np.zeros((len(angles), 2))])
    log = make_log(make_dwells(poses, 0.8, headings=poses[:, 0], noise=FIELD))
    with pytest.raises(FoucaultError, match=r"These headings do not show: .*(gyro|with the tilt)"):
        calibrate(log, site=SITE, noise=FIELD)
