"""Six rests and three turns: another program's numbers, and what the result says."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from foucault.campaign import parse
from foucault.campaign.running import simulate as simulate_campaign
from foucault.campaign.writing import template
from foucault.detect.faces import _creeping, find_faces, find_turns
from foucault.diagnose.study import nees
from foucault.errors import FoucaultError, finding
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs import LogDescription, read
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import ByNoise
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures import ferraris, six_position
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import Log, declared
from make_faces import IMUCAL, MEMS, SITE, TURN, calibrate, moved, short_log
from refusals import refuses
from sessions import Case, made, solved, truth

ARCMIN = np.radians(1 / 60)
REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))
SESSION = REAL / "ferraris_session"
needs_session = pytest.mark.skipif(
    not SESSION.is_dir(), reason=f"real logs are not here: set FOUCAULT_DATA ({SESSION})"
)


@cache
def session():
    words = {
        "file": "example_ferraris_session.csv",
        "rate": "102.4 Hz",
        "accel": {"columns": ["acc_x", "acc_y", "acc_z"], "unit": "m/s^2"},
        "gyro": {"columns": ["gyr_x", "gyr_y", "gyr_z"], "unit": "deg/s"},
    }
    log = read(LogDescription.model_validate(words), SESSION)
    rows = json.loads((SESSION / "example_ferraris_session_list.json").read_text())
    return log, {name: (row["start"], row["end"]) for name, row in rows.items()}


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_drift_that_faces_take_up_is_told_from_within_the_rests(seed):
    log, _ = short_log(seed, rest_time=10.0)
    drift = np.linspace(0.0, 0.05, len(log))[:, None] * [0.0, 1.0, 0.0]
    for x, drifts in ((log, False), (replace(log, accel=log.accel + drift), True)):
        result = six_position.calibrate(x, site=SITE, settings=six_position.Settings())
        told = next(c for c in result.checks if c.name == "drift of accel within rests [mg]")
        assert told.passed is not drifts
        assert told.sentence.startswith("Within the rests accel.bias.")
        assert (("accel.bias.y drifts, by " in told.sentence)
                and ("more than the uncertainties know" in told.sentence)) is drifts  # fmt: skip


@needs_session
def test_published_solution_gives_the_other_programs_numbers():
    log, sections = session()
    result = calibrate(log, Site(9.81), None, solution="published", sections=sections)
    got = result.diagnostics["published"]
    for name, want in IMUCAL.items():
        scale = np.radians(1.0) if name in ("b_g", "K_ga") else 1.0
        # An entry of a small matrix is as good as the differences it is made of.
        floor = {"R_a": 1e-12, "R_g": 1e-11, "K_ga": 1e-13}.get(name, 0.0)
        np.testing.assert_allclose(
            np.array(got[name]), scale * np.array(want), rtol=1e-9, atol=floor, err_msg=name
        )
    # The coefficients are the same matrices in the body axes.
    C_bk = np.array(result.diagnostics["mounting"])
    matrix = np.diag(IMUCAL["K_a"]) @ IMUCAL["R_a"]
    np.testing.assert_allclose(result.model.accel_matrix @ C_bk, matrix, atol=1e-9)
    assert result.status == "converged"


@needs_session
def test_the_pass_of_the_real_log_is_earned():
    """Against the other program, and against the early and the late repeat of each face."""
    log, sections = session()
    site, sd = Site(9.81, np.radians(49.6)), np.radians([0.15, 0.15, 0.5])
    scale = [f"accel.scale.{a}" for a in "xyz"]
    settings = ferraris.Settings(angle_sd=sd[2])
    whole = ferraris.calibrate(log, site=site, settings=settings, sizes=ByNoise())
    c = whole.coefficients.chosen(scale)
    assert whole.verdict.level == "pass" and not whole.diagnostics["named"]
    low, high = chi_square_limits(3)
    assert low < np.sum(((c.values - np.array(IMUCAL["K_a"]) + 1) / c.sd) ** 2) < high
    start, time = (whole.tables["readings"][k][: len(whole.diagnostics["faces"])]
                   for k in ("start", "time"))  # fmt: skip
    first = np.ceil(start * 102.4).astype(int) + 1
    rows = np.column_stack([first, first + (time * 102.4).astype(int) - 3])
    found = []
    for which in (0, -1):  # the first and the last rest with each axis up
        chosen = dict(sections)
        for face, key in (("x up", "x_p"), ("y up", "y_p"), ("z up", "z_p")):
            mine = np.flatnonzero(np.array(whole.diagnostics["faces"]) == face)
            chosen[key] = tuple(rows[mine][which].tolist())
        part = calibrate(log, site, None, sections=chosen, placement_sd=sd[0], level_sd=sd[1],
                         angle_sd=sd[2])  # fmt: skip
        found.append(part.coefficients.chosen(scale).values)
    off = (found[0] - found[1]) / 2 / c.sd
    assert low < np.sum(off**2) < high and np.abs(off).max() > 1  # the drift of x is there


@needs_session
def test_the_likelihood_finds_faces_and_turns_of_the_real_log_itself():
    log, sections = session()
    found = calibrate(log, Site(9.81), None)
    # One turn about each axis: 2.8 % of scale may be 10 deg that were not turned.
    assert found.verdict.level is Level.DOUBTFUL
    assert "A single turn cannot tell" in " ".join(found.verdict.reasons)
    # With the angle known the turns are no reason any more; that its scale moved in between is.
    told = calibrate(log, Site(9.81), None, angle_sd=np.radians(0.5))
    (reason,) = told.verdict.reasons
    assert "accel.scale.x had drifted by -1400 +- 350 ppm" in reason
    assert len(found.diagnostics["faces"]) == 13
    assert found.diagnostics["turns"] == [
        f"about {a}, {a} up, clockwise seen from above" for a in "xyz"
    ]
    cut = calibrate(log, Site(9.81), None, sections=sections)
    # Found and cut by hand they use the same data, weighed otherwise: within 4 sd of the wider.
    gap = found.coefficients.values - cut.coefficients.values
    assert (np.abs(gap) < 4 * np.maximum(found.coefficients.sd, cut.coefficients.sd)).all()
    published = calibrate(log, Site(9.81), None, sections=sections, solution="published")
    both = [published.coefficients.value(n) for n in cut.coefficients.names]
    assert (np.abs(cut.coefficients.values - both) < 4 * cut.coefficients.sd).all()
    # It stood on faces that were off by some arc-minutes.
    assert 3 * ARCMIN < found.diagnostics["placement_sd"] < 40 * ARCMIN


@needs_session
def test_published_with_the_earth_differs_by_the_earth():
    log, sections = session()
    there = Site(9.81, np.radians(49.6))
    words = {"solution": "published", "sections": sections}
    off = calibrate(log, there, None, earth_rate=False, **words).diagnostics["published"]
    on = calibrate(log, there, None, **words).diagnostics["published"]
    gap = np.array(off["K_ga"]) - np.array(on["K_ga"])
    taken = EARTH_RATE * np.sin(there.latitude) / 9.81
    np.testing.assert_allclose(gap, taken * np.eye(3), atol=1e-15)
    # What was taken for g-sensitivity also acted in the turns: their scale hardly changes.
    assert np.abs(np.array(off["K_g"]) / on["K_g"] - 1).max() < 2e-6


# -- what the result says --------------------------------------------------------------------


def test_one_result_in_full():
    log, _ = short_log(seed=2, placement_sd=3 * ARCMIN)
    result = calibrate(log, placement_sd=3 * ARCMIN, g_sensitivity=True, accel_quadratic=True)
    assert result.coefficients.names == ferraris.names_of(
        ferraris.Settings(g_sensitivity=True, accel_quadratic=True)
    )
    assert len(result.coefficients) == 33
    d = result.diagnostics
    assert (np.array(d["bound"]) <= result.coefficients.sd * (1 + 1e-9)).all()
    # The variance split by source adds up to the variance.
    total = np.sum(list(d["budget"].values()), axis=0)
    np.testing.assert_allclose(total, result.coefficients.sd**2, rtol=1e-6)
    table = result.tables["readings"]
    assert set(table) <= {c.name for c in declared("readings")}
    assert {len(column) for column in table.values()} == {12}
    g = SITE.gravity
    miss = (table["norm_after"] - g)[:9] / table["norm_sd"][:9]
    assert np.abs(miss).max() < 4
    np.testing.assert_allclose(table["rate_after"][9:], table["rate_true"][9:], rtol=1e-3)
    assert (table["rate"][9:] < 0).all() and (table["turns"][9:] == 1).all()
    sentences = " ".join(c.sentence for c in result.checks)
    assert "9 rests on 6 faces leave" in sentences
    assert "nothing is left over" in sentences
    assert any("not square to one another" in words for words in d["unseen"])
    assert "about y, y up, clockwise seen from above" in sentences


def test_six_single_rests_say_what_they_cannot_see():
    model = draw_errors("mems", 4)
    sim = six_position.simulate(
        six_position.Session(rest_time=2.0), model=model, noise=MEMS, site=SITE, seed=4
    )
    result = six_position.calibrate(sim.log, site=SITE, noise=MEMS)
    (words,) = [c.sentence for c in result.checks if c.name == "redundancy"]
    assert "leave 6 of 18 equations" in words
    assert "scale factors and misalignments are not tested" in words
    z = (result.coefficients.values - model.coefficients(result.coefficients.names).values) / (
        result.coefficients.sd
    )
    assert np.abs(z).max() < 4.5


def test_overlooked_placement_fails_the_check_and_left_out_it_is_estimated():
    log, _ = short_log(seed=6, placement_sd=20 * ARCMIN)
    result = calibrate(log, placement_sd=0.0)
    (check,) = [c for c in result.checks if c.name.startswith("noise of specific force")]
    assert not check.passed and "placement_sd" in check.sentence
    result = calibrate(log)
    assert result.verdict.level is Level.PASS
    assert 8 * ARCMIN < result.diagnostics["placement_sd"] < 50 * ARCMIN


def test_a_disturbed_rest_is_named():
    log, _ = short_log(seed=2)
    bumped = moved(log, 690, 910, accel=np.array([0.0, 0.05, 0.0]))
    result = calibrate(bumped, placement_sd=0.0)
    found = [f for f in result.findings if f.code == "faces.outlier"]
    assert len(found) == 1
    assert "specific force" in found[0].message


def test_a_turn_that_went_too_far_is_doubted():
    log, _ = short_log(seed=2, angle=TURN * 1.08)
    result = calibrate(log, placement_sd=0.0)
    (check,) = [c for c in result.checks if c.name == "whole turns"]
    assert not check.passed and "deg that were turned too much" in check.sentence


def level_of(log, **settings):
    result = calibrate(log, **settings)
    (check,) = [c for c in result.checks if c.name == "whole turns"]
    return result, check


def test_a_single_turn_cannot_tell_its_scale_from_its_end():
    """350 deg and a good gyro look like 360 deg and a gyro that is 2.8 % off."""
    log, _ = short_log(seed=2, model=ImuModel(), angle=TURN * 350 / 360)
    result, check = level_of(log)
    assert result.verdict.level is Level.DOUBTFUL
    assert check.value == pytest.approx(-1000 / 360, abs=0.1)
    assert "A single turn cannot tell" in check.sentence
    # Declared, the uncertainty knows it: 5 deg of 360.
    result, check = level_of(log, angle_sd=np.radians(5.0))
    assert check.passed
    sd = result.coefficients["gyro.scale"].sd
    assert sd == pytest.approx([5 / 360 * 350 / 360] * 3, rel=0.01)
    assert np.abs(result.coefficients["gyro.scale"].values / sd).max() < 3
    # Known beforehand, it is no turn that is doubted.
    site = {"site": SITE, "noise": MEMS, "settings": ferraris.Settings()}
    good, _ = short_log(seed=2, model=ImuModel(gyro_matrix=1.028 * np.eye(3)))
    assert not level_of(good)[1].passed
    known = ferraris.calibrate(good, prior={"gyro.scale": (0.028, 1e-3)}, **site)
    assert next(c for c in known.checks if c.name == "whole turns").passed


def test_accelerometers_see_the_tilt_after_a_turn_and_not_the_heading():
    short, _ = short_log(seed=2, model=ImuModel(), angle=TURN * 350 / 360)
    whole, _ = short_log(seed=2, model=ImuModel())
    said = [level_of(log)[0] for log in (short, whole)]
    for r in said:
        accel = next(c for c in r.checks if c.name == "noise of specific force at rest")
        assert accel.passed
        assert r.diagnostics["placement_sd"] < ARCMIN
    rests = find_faces(whole, SITE.gravity)
    k = int(
        np.flatnonzero(
            rests.adjacent
            & (rests.readings.up_k @ [1, 1, 1] > 0)
            & np.append((np.diff(rests.readings.up_k, axis=0) == 0).all(1), False)
        )[0]
    )
    tilted = moved(
        whole,
        rests.first[k + 1] - 5,
        rests.last[k + 1] + 5,
        accel=SITE.gravity * np.radians(0.5) * np.roll(rests.readings.up_k[k], 1),
    )
    words = " ".join(c.sentence for c in level_of(tilted)[0].checks)
    assert "The specific force at rest scatters by" in words


def test_a_turn_at_a_constant_rate_is_no_rest():
    """Its middle is as quiet as a rest, and so is that of a slow turn."""
    log, _ = short_log(seed=2, rest_time=4.0, turn_time=4.0, model=ImuModel())
    rests = find_faces(log, SITE.gravity)
    for k in np.flatnonzero(rests.adjacent).tolist():
        a, b = rests.last[k], rests.first[k + 1]
        c = (a + b) // 2
        steady = log.gyro[c - 120 : c + 120]
        noise = steady - np.median(steady, axis=0)
        flat = steady.mean(axis=0) + 0.01 * noise / max(np.abs(noise).max(), 1e-9)
        log.gyro[c - 120 : c + 120] = flat
    found = find_faces(log, SITE.gravity)
    assert len(found.rests.left_out)
    assert not [f for f in found.findings if f.code == "rest.moving"]
    # Slow and short: nobody meant to turn.
    creeping = replace(
        found.rests,
        left_out=np.array([[np.radians(2.0), 10.0]]),
        findings=(finding("rest.moving", start="1", end="11", rate="2"),),
    )
    assert len(_creeping(creeping)) == 1


def test_repeated_turns_are_tested():
    """Both after one another on one face: a turn too far shows in the residuals."""
    one, _ = short_log(seed=2)
    again = replace(one, time=one.time + one.time[-1] + one.interval)
    both = Log(*(np.concatenate([getattr(x, n) for x in (one, again)])
                 for n in ("time", "gyro", "accel")))  # fmt: skip
    fine = calibrate(both, placement_sd=0.0)
    assert len(fine.diagnostics["turns"]) == 6
    assert fine.diagnostics["chi_square"]["turns"][3] > 5
    far = replace(both, gyro=np.concatenate([one.gyro, one.gyro * [1.002, 1, 1]]))
    result = calibrate(far, placement_sd=0.0)
    (check,) = [c for c in result.checks if c.name == "noise of turns"]
    assert not check.passed


def test_without_latitude_the_bias_says_so():
    log, _ = short_log(seed=2)
    result = calibrate(log, Site(SITE.gravity))
    assert "session.no_latitude" in [f.code for f in result.findings]
    assert result.coefficients["gyro.bias"].sd.min() > EARTH_RATE / np.sqrt(3) / 3.1
    off = calibrate(log, earth_rate=False)
    np.testing.assert_array_equal(off.coefficients.values, result.coefficients.values)


def test_a_prior_is_used_by_the_likelihood_and_refused_by_the_published_solution():
    log, _ = short_log(seed=2)
    prior = {"gyro.bias.x": (0.0, 1e-7)}
    result = ferraris.calibrate(log, site=SITE, noise=MEMS, prior=prior)
    assert result.coefficients["gyro.bias.x"].sd[0] < 1e-7
    with refuses("ferraris.prior"):
        ferraris.calibrate(
            log, site=SITE, prior=prior, settings=ferraris.Settings(solution="published")
        )


@pytest.mark.thorough
def test_on_a_table_that_vibrates_the_angle_is_that_of_the_turn():
    """At .2 g rms the scatter of a rest hides how a turn begins: it became part of the rest."""
    sds = {"placement_sd": 3 * ARCMIN, "level_sd": 3 * ARCMIN, "angle_sd": 12 * ARCMIN}
    case, square, count = Case("ferraris", sds, {**sds, "turn_time": 6.0}, grade="mems"), 0.0, 0
    passed = 0
    for seed in range(30):
        simulation, rng = made(case, seed), np.random.default_rng(seed)
        log, cycles = simulation.log, rng.uniform(6.0, 24.0, 3)
        one, two = (np.sin(2 * np.pi * (log.time[:, None] * cycles + rng.random(3))) for _ in "ag")
        log = replace(log, accel=log.accel + 2.8 * one, gyro=log.gyro + 0.05 * two)
        result = solved(case, log, noise=None, whole=True)
        passed += result.verdict.level is Level.PASS
        c = result.coefficients
        square += nees(c.values - truth(simulation, c.names), c.cov)
        count += len(c)
    assert passed >= 25  # a slow beat of vibration and sampling looks like a drift
    # A sine that is measured as if it were white makes the uncertainties careful.
    assert square < chi_square_limits(count)[1]


def test_means_with_and_without_a_noise():
    rng = np.random.default_rng(1)
    up = np.concatenate([np.eye(3), -np.eye(3), np.eye(3), -np.eye(3)])
    accel = SITE.gravity * up + [0.2, -0.1, 0.05] + rng.normal(0, 1e-3, (12, 3))
    log = Log(np.arange(12.0), None, accel, averaged=np.full(12, 60.0))
    unknown = six_position.calibrate(log, site=SITE)
    assert "readings.noise_unknown" in [f.code for f in unknown.findings]
    assert unknown.verdict.level is Level.PASS
    white = ImuNoise(TriadNoise(white=1e-3 * np.sqrt(60.0)))
    settings = six_position.Settings(placement_sd=0.0)
    known = six_position.calibrate(log, site=SITE, noise=white, settings=settings)
    names = known.coefficients.names
    assert all(n.startswith("accel.") for n in names)
    np.testing.assert_allclose(known.coefficients["accel.bias"].sd, 1e-3 / np.sqrt(12), rtol=0.05)
    ratio = unknown.coefficients.sd / known.coefficients.sd
    assert (ratio > 0.6).all() and (ratio < 1.6).all()


def test_angle_must_be_whole_turns():
    assert ferraris.Settings(angle="720 deg").angle == pytest.approx(-2 * TURN)
    for angle in ("0 deg", "-350 deg"):
        with pytest.raises(ValueError, match="whole turns"):
            ferraris.Settings(angle=angle)


UNEQUAL = ("360 deg", "-720 deg", "90 deg")


def test_each_axis_may_have_a_known_angle_of_its_own():
    angles = ferraris.Settings(angle=UNEQUAL).angle
    np.testing.assert_allclose(angles, np.radians([360, -720, 90]))
    ends = {"angle_sd": np.radians(0.05), "level_sd": ARCMIN, "placement_sd": ARCMIN}
    log, model = short_log(seed=4, angle=angles, **ends)
    result = calibrate(log, angle=UNEQUAL, **ends)
    assert result.verdict.level is Level.PASS
    truth = model.coefficients(result.coefficients.names).values
    error = result.coefficients.values - truth
    low, high = chi_square_limits(len(error))
    assert low < nees(error[None], result.coefficients.cov[None]).sum() < high
    # The error of the angle is so much of each turn.
    sd = result.coefficients["gyro.scale"].sd
    np.testing.assert_allclose(sd, 0.05 / np.array([360, 720, 90]), rtol=0.1)
    # A part of a turn leads to another heading.
    groups = find_turns(log, find_faces(log, SITE.gravity), angles)[0].readings.group
    assert len(set(groups)) == 7
    # The same angle for all is another session.
    with pytest.raises(FoucaultError, match="measures 89 deg about z, 360 deg are declared"):
        calibrate(log, angle=(TURN, -2 * TURN, TURN), **ends)
    with pytest.raises(FoucaultError, match=r"about z goes against the declared angle of -90 deg"):
        calibrate(log, angle=("360 deg", "-720 deg", "-90 deg"), **ends)
    with pytest.raises(FoucaultError, match=r"declared angle of -360, .720, -90 deg") as caught:
        calibrate(log, angle=("-360 deg", "720 deg", "-90 deg"), **ends)
    assert 'set angle = ["+360 deg", "-720 deg", "+90 deg"] in' in str(caught.value)


@pytest.mark.parametrize("angle", [-TURN, UNEQUAL])
def test_turns_back_are_told_by_the_gyros(angle):
    angles = ferraris.Settings(angle=angle).angle
    ends = {"angle_sd": np.radians(0.05), "level_sd": ARCMIN, "placement_sd": ARCMIN}
    log, model = short_log(seed=4, angle=angles, back_time=3.0, **ends)
    result = calibrate(log, angle=angle, **ends)
    assert result.verdict.level is Level.PASS and len(result.diagnostics["turns"]) == 6
    senses = [text.split(", ")[2] for text in result.diagnostics["turns"]]
    assert all(a != b for a, b in zip(senses[::2], senses[1::2], strict=True))
    truth = model.coefficients(result.coefficients.names).values
    low, high = chi_square_limits(len(truth))
    error = result.coefficients.values - truth
    assert low < nees(error[None], result.coefficients.cov[None]).sum() < high
    once = calibrate(short_log(seed=4, angle=angles, **ends)[0], angle=angle, **ends)
    sds = [made.coefficients["gyro.scale"].sd for made in (once, result)]
    np.testing.assert_allclose(sds[1], sds[0] / np.sqrt(2), rtol=0.1)
    with pytest.raises(FoucaultError, match="The first turn about each axis goes against"):
        calibrate(log, angle=tuple(-np.broadcast_to(angles, 3)), **ends)


@pytest.mark.parametrize("back", ["10 s", "2.5 s"])
def test_turned_back_at_another_speed_a_cubic_scale_factor_shows(back):
    """Five times what is typical: 0.5 % at 150 deg/s."""
    told = f'[simulate]\nback_time = "{back}"\nplacement_sd = "0 arcmin"\n'
    text = template("ferraris").replace("[simulate]\n", told)
    campaign = parse(text)
    made = simulate_campaign(campaign, 0)
    log = made.simulation.log
    bent = replace(log, gyro=log.gyro * (1 + 5e-3 * (log.gyro / np.radians(150)) ** 2))
    level = {}
    for some in (log, bent):
        result = ferraris.calibrate(some, site=campaign.site, settings=campaign.settings,
                                    noise=campaign.noise, sizes=campaign.sizes)  # fmt: skip
        names = result.coefficients.names
        error = result.coefficients.values - [made.truth.value(n) for n in names]
        assert nees(error[None], result.coefficients.cov[None]).sum() < 1.2 * len(error)
        level[some is bent] = result.verdict.level
    assert level == {False: Level.PASS, True: Level.DOUBTFUL}


@pytest.mark.parametrize("missing", [0.1, 0.5])
def test_a_turn_with_missing_rows_counts_less(missing):
    """Half a second of a turn of two: bridged, it is known far worse than the others."""
    ends = {"angle_sd": np.radians(0.05), "level_sd": ARCMIN, "placement_sd": ARCMIN}
    log, model = short_log(seed=4, angle=TURN, **ends)
    first = find_turns(log, find_faces(log, SITE.gravity), TURN)[1]
    a, b = int(first.first[1]), int(first.last[1])
    fastest = a + int(np.abs(log.gyro[a:b]).max(axis=1).argmax())
    cut = (a + fastest) // 2 + np.arange(round(missing * log.rate))
    short = log[np.setdiff1d(np.arange(len(log)), cut)]
    turns = find_turns(short, find_faces(short, SITE.gravity), TURN)[1]
    off = turns.gyro[1] - first.gyro[1]
    assert (turns.bridged > 0).tolist() == [False, True, False]
    assert np.abs(off).max() < 3.5 * turns.bridged[1]
    np.testing.assert_allclose(turns.time, first.time, atol=1e-9)
    result = calibrate(short, angle=TURN, **ends)
    error = result.coefficients.values - model.coefficients(result.coefficients.names).values
    assert result.verdict.level is Level.PASS
    assert np.abs(error / result.coefficients.sd).max() < 4
    whole = calibrate(log, angle=TURN, **ends)
    worse = result.coefficients["gyro.scale"].sd / whole.coefficients["gyro.scale"].sd
    axis = int(np.argmax(turns.axis_k[1]))
    assert worse[axis] == worse.max() and np.delete(worse, axis).max() < 1.1
    assert (worse[axis] > 20) == (missing == 0.5)


def test_angles_of_the_axes_are_read_from_a_campaign():
    one = 'angle = ["360 deg", "-720 deg", "90 deg"]'
    text, count = re.subn(r'^(# )?angle = "-360 deg"', one, template("ferraris"), flags=re.M)
    assert count == 1
    campaign = parse(text)
    np.testing.assert_allclose(campaign.settings.angle, np.radians([360, -720, 90]))
    for wrong, said in (('["360 deg", "1 rad/s", "90 deg"]', "angle"),
                        ('["360 deg", "10 deg", "90 deg"]', "45 deg or more"),
                        ('["360 deg", "90 deg"]', "angle")):  # fmt: skip
        with pytest.raises(FoucaultError, match=said):
            parse(text.replace(one, f"angle = {wrong}"))
