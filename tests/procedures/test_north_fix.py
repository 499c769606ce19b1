"""Calibrate, go to the field, find north: closed loops, and every check can fail."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.diagnose.study import nees
from foucault.estimate.north import LATITUDE
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import turned
from foucault.procedures import north_seeking
from foucault.procedures.north_seeking import Session, Settings
from foucault.procedures.north_seeking.fix import find_north
from foucault.result import Level
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    Rotation,
    SeekerErrors,
    Stops,
    simulate_north,
)
from make_dwells import (
    DEG_H,
    FIELD,
    FOUR,
    PALINDROME,
    attitudes,
    make_dwells,
    make_log,
    turn,
)

SITE = Site.at(0.8)
DEG = np.radians(1.0)
PLAIN = {"accel_bias_sd": 0.0, "accel_scale_sd": 0.0, "accel_misalignment_sd": 0.0}
"""Accelerometers without errors, where none are simulated."""
QUIET_FIELD = replace(FIELD, gyro=replace(FIELD.gyro, white=0.1 * FIELD.gyro.white))


@cache
def calibrated(seed=0, dwell=240.0, tilted=False, **settings):
    """An instrument and its calibration."""
    chosen = Settings(**settings)
    model = north_seeking.draw_errors("", seed)
    session = Session(dwell=dwell, tilts=("8 deg", "-8 deg", "0 deg") if tilted else ("0 deg",))
    log = north_seeking.simulate(session, settings=chosen, model=model, noise=FIELD, site=SITE,
                                 seed=100 + seed).log  # fmt: skip
    result = north_seeking.calibrate(log, site=SITE, settings=chosen, noise=FIELD,
                                     instrument={"serial": "A 7"})  # fmt: skip
    return model, result


def field(model=None, *, poses=None, stops=FOUR, dwell=60.0, noise=FIELD, seed=1, errors=None,
          accel="base", rows="means", rotation=False, latitude=0.8):  # fmt: skip
    poses = attitudes(8, 5.0) if poses is None else poses
    setups = tuple(Placement(f"M{i + 1}", *pose) for i, pose in enumerate(poses))
    motion = Rotation(3.0, 6 * DEG) if rotation else Stops(
        np.radians(stops), np.full(len(stops), dwell), 5.0)  # fmt: skip
    made = simulate_north(
        NorthPlan(setups, motion), model=model or ImuModel(), noise=noise, site=Site.at(latitude),
        errors=errors or SeekerErrors(gyro_offset=3e-6), accel=accel, reference=False, rows=rows,
        rate=2.0, seed=seed,
    )  # fmt: skip
    return made.log, poses


def solved(*args, settings=None, calibration=None, known=FIELD, site=SITE, **words):
    log, poses = field(*args, **words)
    if settings is None and calibration is None:
        settings = Settings(**PLAIN)
    survey = find_north(log, site=site, settings=settings, noise=known, calibration=calibration)
    return survey, poses


def check_of(survey, name, i=0):
    return next(c for c in survey.checks[i] if c.name == name)


def err_of(survey, poses):
    return turn(survey.fixes.angles[:, :3], poses)


# -- closed loops --------------------------------------------------------------------------------


LOOPS = {
    "level calibration": ({}, {}),
    "tilted calibration": ({"tilted": True}, {"poses": attitudes(8, 15.0)}),
    "uncertain headings": ({"heading_offset_sd": np.radians(0.05), "heading_sd": 3e-4}, {}),
    "palindrome": ({}, {"stops": PALINDROME, "dwell": 30.0}),
    "rotation": ({}, {"rotation": True, "rows": "samples"}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("loop", LOOPS)
def test_calibrate_and_find_north(loop):
    """One instrument each: its calibration is part of the error of its set-up."""
    before, after = LOOPS[loop]
    errs, covs = [], []
    for seed in range(24):
        model, result = calibrated(seed, **before)
        poses = after.get("poses", attitudes(8, 5.0))[seed % 8][None]
        words = {k: v for k, v in after.items() if k != "poses"}
        survey, poses = solved(model, poses=poses, calibration=result, seed=300 + seed, **words)
        errs.append(err_of(survey, poses)[0])
        covs.append(survey.fixes.cov[0][:3, :3])
        assert survey.noise_source == "declared"
    errs, covs = np.array(errs), np.array(covs)
    total = float(nees(errs, covs).sum())
    low, high = chi_square_limits(errs.size, tests=len(LOOPS))
    assert low < total < high
    # The heading alone, and what it would be without the calibration.
    own = float(np.sum(errs[:, 0] ** 2 / covs[:, 0, 0]))
    low, high = chi_square_limits(24, tests=len(LOOPS))
    assert low < own < high


def test_without_the_calibration_the_errors_show():
    model, result = calibrated(1, dwell=2400.0)
    words = {"poses": attitudes(24, 10.0), "noise": QUIET_FIELD, "known": QUIET_FIELD}
    with_it, poses = solved(model, calibration=result, **words)
    without, _ = solved(model, **words)
    good, bad = (np.abs(err_of(s, poses)[:, 0]).max() for s in (with_it, without))
    assert bad > 3 * good
    assert "north.no_calibration" in [f.code for f in without.findings]
    assert "north.no_calibration" not in [f.code for f in with_it.findings]
    assert with_it.calibration["instrument"] == {"serial": "A 7"} and without.calibration == {}
    assert {"coupling", "scale factor", "calibration: bias"} <= set(with_it.fixes.sources)


@pytest.mark.parametrize("latitude", ["known", "rough", "unknown"])
def test_errors_over_many_set_ups_have_the_size_that_was_promised(latitude):
    poses = np.tile(attitudes(20, 10.0), (10, 1))
    true = 0.8
    settings = {
        "known": Settings(**PLAIN),
        "rough": Settings(**PLAIN, latitude_sd=2e-3),
        "unknown": Settings(**PLAIN, unknown_latitude=True),
    }[latitude]
    errs, covs = [], []
    rng = np.random.default_rng(5)
    if latitude == "rough":  # another place for every ten set-ups
        for k in range(20):
            place = Site.at(true + 2e-3 * rng.standard_normal())
            survey, some = solved(poses=poses[k::20], settings=settings, site=place, seed=k)
            errs.append(err_of(survey, some))
            covs.append(survey.fixes.cov[:, :3, :3])
        # One error of latitude is common to ten set-ups: headings alone are near independent.
        errs, covs = np.concatenate(errs), np.concatenate(covs)
        own = float(np.sum(errs[:, 0] ** 2 / covs[:, 0, 0]))
        low, high = chi_square_limits(len(errs), tests=3)
        assert low < own < high
        return
    survey, _ = solved(poses=poses, settings=settings)
    off = err_of(survey, poses)
    if latitude == "unknown":
        off = np.column_stack([off, survey.fixes.angles[:, 3] - true])
    k = off.shape[1]
    total = float(nees(off, survey.fixes.cov[:, :k, :k]).sum())
    low, high = chi_square_limits(off.size, tests=3)
    assert low < total < high
    assert not low < total / 0.85**2 < high


def test_a_set_up_is_not_changed_by_its_neighbours():
    survey, _ = solved(dwell=90.0)
    log, _ = field(dwell=90.0)
    keep = np.flatnonzero(log.setup == 3)
    one = replace(log.rows(keep), setup=np.zeros(4, int), names=("M4",))
    alone = find_north(one, site=SITE, noise=FIELD, settings=Settings(**PLAIN))  # fmt: skip
    np.testing.assert_allclose(alone.fixes.angles[0], survey.fixes.angles[3], atol=1e-6)
    assert len(survey) == 8 and len(alone) == 1


# -- noise and drift -------------------------------------------------------------------------------


def test_where_the_noise_comes_from():
    _, result = calibrated(0)
    samples, _ = solved(known=None, rows="samples", calibration=result)
    assert samples.noise_source == "measured in the dwells"
    of, _ = solved(known=None, calibration=result)
    assert of.noise_source == "of the calibration"
    assert of.noise.gyro.white == pytest.approx(FIELD.gyro.white)
    left, _ = solved(known=None)
    assert left.noise_source == "from the residuals"
    assert left.noise.gyro.white == pytest.approx(FIELD.gyro.white, rel=0.6)
    assert not [c for c in left.checks[0] if "over index angle" in c.name]
    # Errors over an sd that was found from few readings are a little larger than Gauss's.
    poses = np.tile(attitudes(20, 10.0), (10, 1))
    many, _ = solved(known=None, poses=poses)
    total = float(nees(err_of(many, poses), many.fixes.cov[:, :3, :3]).sum())
    assert 0.7 * 600 < total < 1.3 * 600


def test_coloured_noise_of_the_calibration_is_used():
    coloured = ImuNoise(FIELD.accel, TriadNoise(FIELD.gyro.white, 3e-8, 200.0, 1e-10))
    log = north_seeking.simulate(Session(), model=ImuModel(), noise=coloured, site=SITE, seed=1).log
    result = north_seeking.calibrate(log, site=SITE, noise=coloured)
    survey, _ = solved(known=None, calibration=result)
    assert survey.noise.gyro == coloured.gyro
    assert "gyro drift" in survey.fixes.sources


def test_drift_is_estimated_where_it_costs_little():
    drifting = SeekerErrors(gyro_offset=3e-6, gyro_drift=1e-8)
    for stops, dwell, free in ((PALINDROME, 60.0, True), (FOUR, 60.0, False)):
        survey, poses = solved(stops=stops, dwell=dwell, errors=drifting, seed=2)
        assert (survey.drift_sd > 0) == free
        z = err_of(survey, poses)[:, 0] / survey.fixes.sd[:, 0]
        assert (np.abs(z) < 4).all() == free
        # What it would do is told: a degree per hour and hour.
        effect = np.abs(survey.drift_effect).max()
        assert (effect < 1e-6) == free
    chosen, poses = solved(errors=drifting, settings=Settings(drift_sd=2e-8))
    assert chosen.drift_sd == 2e-8
    assert (np.abs(err_of(chosen, poses)[:, 0]) < 4 * chosen.fixes.sd[:, 0]).all()
    assert solved(stops=PALINDROME, settings=Settings(drift="none"))[0].drift_sd == 0.0


def test_drift_effect_is_what_a_drift_does():
    drift = np.radians(1 / 3600) / 3600
    poses = attitudes(8, 5.0)
    plain, moved = (
        find_north(make_log(make_dwells(poses, 0.8, drift=d)), site=SITE, noise=FIELD,
                   settings=Settings(drift="none"))
        for d in (0.0, drift)
    )  # fmt: skip
    want = turn(moved.fixes.angles[:, 0], plain.fixes.angles[:, 0])
    np.testing.assert_allclose(plain.drift_effect, want, rtol=5e-3)
    assert np.abs(want).max() > 1e-4


# -- less is known ---------------------------------------------------------------------------------


def test_two_neighbouring_stops_with_a_known_offset():
    settings = Settings(gyro_offset=3e-6, gyro_offset_sd=1e-9, near=0.3, level_sd=1e-3)
    survey, poses = solved(stops=(0.0, 90.0), dwell=600.0, accel="case", settings=settings,
                           poses=np.array([[0.35, 0.0, 0.0]]))  # fmt: skip
    assert np.abs(err_of(survey, poses)[0, 0]) < 4 * survey.fixes.sd[0, 0] < 0.01


def test_a_rough_latitude_is_part_of_the_budget():
    survey, _ = solved(settings=Settings(**PLAIN, latitude_sd=1e-2), poses=attitudes(8, 15.0))
    exact, _ = solved(poses=attitudes(8, 15.0))
    assert (survey.fixes.sources[LATITUDE][:, 0] > 0).all()
    assert (exact.fixes.sources[LATITUDE][:, 0] < 1e-15).all()
    assert (survey.fixes.sd[:, 0] >= exact.fixes.sd[:, 0] * (1 - 1e-3)).all()
    assert (survey.bound[:, 0] <= survey.fixes.sd[:, 0] * (1 + 1e-3)).all()


# -- every check can fail --------------------------------------------------------------------------


def test_a_good_fix_passes_everything():
    model, result = calibrated(2)
    survey, _ = solved(model, calibration=result, settings=Settings(accuracy=1 * DEG))
    assert all(v.level is Level.PASS for v in survey.verdicts)
    names = {"solved", "sees the Earth", "gyro over index angle", "accelerometer over index angle",
             "rate and latitude", "one heading", "tilt", "accuracy"}  # fmt: skip
    shared = {"gyro over all set-ups", "accelerometer over all set-ups", "offset drift"}
    assert {c.name for c in survey.checks[0]} == names | shared
    assert not any(survey.setup_findings)


def judged(name, change=None, fails=Level.DOUBTFUL, **words):
    """The check of the first set-up, which must fail, and the verdict with it."""
    known, settings = words.pop("known", FIELD), words.pop("settings", None)
    calibration, site = words.pop("calibration", None), words.pop("site", SITE)
    log, _ = field(**words)
    if change is not None:
        log = change(log)
    survey = find_north(log, site=site, noise=known, settings=settings, calibration=calibration)
    check = check_of(survey, name)
    assert not check.passed
    assert survey.verdicts[0].level is fails is list(Level)[survey.levels[0]]
    return check.sentence


def test_a_gyro_too_noisy_says_by_what_factor():
    noisy = replace(FIELD, gyro=replace(FIELD.gyro, white=150 * FIELD.gyro.white))
    words = judged("sees the Earth", None, Level.UNUSABLE, noise=noisy, known=noisy, dwell=10.0)
    sd = noisy.gyro.white / np.sqrt(10.0) / np.sqrt(2)
    factor = 3.0 / (EARTH_RATE * np.cos(0.8) / sd)
    said = float(words.split("by a factor of ")[1].split(";")[0])
    assert said == pytest.approx(factor, rel=0.2)
    assert "times as long" in words and "take a better gyro" in words


def disturbed(sensor, size):
    def change(log):
        value = getattr(log, sensor).copy()
        value[1] += size
        return replace(log, **{sensor: value})

    return change


def test_a_disturbed_reading():
    words = judged("gyro over index angle", disturbed("gyro", DEG_H))
    assert "times what the noise explains" in words and "disturbance" in words
    words = judged("accelerometer over index angle", disturbed("accel", 5e-3))
    assert "accelerometer" in words


def test_a_disturbed_reading_among_many_is_the_one():
    words = judged("every reading fits", disturbed("gyro", DEG_H), stops=PALINDROME,
                   known=None)  # fmt: skip
    assert "standard deviations" in words


def test_a_case_less_level_than_was_said():
    words = judged("level", settings=Settings(level_sd=np.radians(1 / 60)), accel="case")
    assert "level" in words
    survey, _ = solved(settings=Settings(level_sd=np.radians(5.0)), accel="case")
    assert check_of(survey, "level").passed


def test_a_latitude_that_does_not_fit():
    words = judged("rate and latitude", site=Site.at(0.85), noise=QUIET_FIELD, known=QUIET_FIELD)
    assert "latitude, scale factor or sign of the accelerometer" in words


def test_a_tilt_near_90_deg():
    words = judged("tilt", poses=np.array([[1.0, np.radians(89.8), 0.0]]))
    assert "hardly defined" in words


def test_an_accuracy_that_is_missed():
    words = judged("accuracy", settings=Settings(accuracy=0.001 * DEG))
    assert "0.001 deg was wanted" in words


def test_a_calibration_that_did_not_pass():
    model, result = calibrated(3)
    verdict = replace(result.verdict, level=Level.DOUBTFUL, reasons=("Headings scatter.",))
    doubtful = replace(result, verdict=verdict)
    words = judged("calibration", model=model, calibration=doubtful)
    assert words == "The calibration that was used is doubtful."


def test_a_little_more_noise_than_was_said_shows_over_all_set_ups():
    """Factor 1.8: one redundant reading in each of forty set-ups hardly sees it, forty do."""
    louder = replace(FIELD, gyro=replace(FIELD.gyro, white=1.8 * FIELD.gyro.white))
    survey, _ = solved(poses=attitudes(40, 5.0), noise=louder)
    alone = [check_of(survey, "gyro over index angle", i).passed for i in range(len(survey))]
    assert np.mean(alone) > 0.7
    found = check_of(survey, "gyro over all set-ups")
    assert not found.passed and "more noise than was said" in found.sentence
    honest, _ = solved(poses=attitudes(40, 5.0))
    assert check_of(honest, "gyro over all set-ups").passed


# -- a drift that every set-up shares --------------------------------------------------------------


def drifting(rate: float, stops=(0.0, 90.0, 180.0, 270.0)):
    """Ten set-ups of a gyro whose offset drifts by `rate` [deg/h/h]."""
    errors = SeekerErrors(gyro_offset=3e-6, gyro_drift=rate * DEG / 3600**2)
    survey, _ = solved(poses=attitudes(10, 5.0), stops=stops, errors=errors, dwell=120.0)
    return survey, [c for own in survey.checks for c in own if c.name == "offset drift"]


def test_a_drift_that_moves_headings_is_told_by_the_offsets_of_set_ups() -> None:
    """No residual of four stops in one order shows it: it passed with NEES/n 2."""
    steady, none = drifting(0.0)
    assert len(none) == 10 and all(c.passed for c in none)
    survey, told = drifting(3.0)
    assert not all(c.passed for c in told)
    moved = np.array([c.value for c in told])
    away = np.abs(turned(survey.fixes.angles[:, 0] - steady.fixes.angles[:, 0]))
    np.testing.assert_allclose(moved, away / survey.fixes.sd[:, 0], rtol=0.1, atol=0.1)
    assert not drifting(3.0, (0.0, 90.0, 180.0, 270.0, 270.0, 180.0, 90.0, 0.0))[1]  # estimated
