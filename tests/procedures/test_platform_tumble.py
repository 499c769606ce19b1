"""A platform tumble by its public path: one error, all errors, priors, arms, edges and holds."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import foucault
from foucault import campaign
from foucault.errors import Status
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.cluster import CONSTANTS
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log as rotation_vector
from foucault.procedures import platform_tumble
from foucault.procedures.platform_tumble.settings import PRIOR, Session
from foucault.result import Level
from make_cluster import ARCSEC, DEG_H, SIZES, UG, G, one_error
from make_tumble import FAST, PUBLISHED, calibrate, campaign_of, nees, tumble
from sessions import codes, failed

SITE = Site(G, np.radians(40.0), gravity_sd=0.0)
LEVEL = Session(attitude=("0 deg",) * 3, attitude_sd=0.0)
BIAS = CONSTANTS.group("accel.bias")
SCALE = CONSTANTS.group("accel.scale")


def prior_sd():
    """Standard deviations known beforehand, in the order of the coefficients."""
    out = np.zeros(len(CONSTANTS))
    for name, (_, sd) in PRIOR.items():
        out[CONSTANTS.group(name)] = sd
    return out


# -- what was put in comes back --------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("name", CONSTANTS.names)
def test_one_error_alone_comes_back(name):
    """By name and sign, and nothing else; the prior at zero pulls as linear theory says."""
    k = CONSTANTS.index(name)
    value = 0.8 * SIZES[CONSTANTS.coefficients[k].kind]
    exact = campaign_of(f'{PUBLISHED}\nlatitude_sd = "0 deg"')
    made = platform_tumble.simulate(
        LEVEL, settings=exact.settings, model=one_error(name, value), noise=ImuNoise(), site=SITE,
        seed=1,
    )  # fmt: skip
    result = calibrate(exact, made.log, trial=True, site=SITE)
    assert result.status is Status.CONVERGED
    truth = np.zeros(len(CONSTANTS))
    truth[k] = value
    found, cov = result.coefficients.values[:42], result.coefficients.cov[:42, :42]
    pull = cov @ (truth / prior_sd() ** 2)
    assert abs(found[k] - value) < 0.05 * value
    np.testing.assert_array_less(np.abs(found + pull - truth), 0.1 * np.sqrt(np.diag(cov)))


def test_the_attitude_at_the_end_is_the_one_it_has():
    made, session = tumble()
    result = calibrate(made, session.simulation.log, trial=True)
    C_pn = np.array(result.diagnostics["attitude"]["C_pn"])
    away = rotation_vector(C_pn.T @ session.simulation.C_pn[1])
    sd = np.array(result.diagnostics["attitude"]["sd"])
    assert np.abs(away).max() < 5 * sd.max() < 100 * ARCSEC
    start = np.array(result.diagnostics["attitude"]["start"])
    np.testing.assert_allclose(
        start, session.simulation.truth_json()["attitude_start"], atol=100 * ARCSEC
    )


def test_a_calibration_shows_its_progress_and_a_trial_no_tables():
    made, session = tumble()
    heard = []
    whole = calibrate(
        made, session.simulation.log, instrument={"name": "platform"},
        progress=lambda done, what: heard.append((done, what)),
    )  # fmt: skip
    trial = calibrate(made, session.simulation.log, trial=True)
    assert set(whole.tables) == {"course", "residuals", "sensitivity", "path"}
    assert not trial.tables
    assert whole.instrument == {"name": "platform"}
    assert [done for done, _ in heard] == sorted(done for done, _ in heard)
    assert heard[-1] == (1.0, "done")


@pytest.mark.parametrize("middle", ["89.9 deg", "90 deg"])
def test_a_start_where_the_angles_are_no_measure(middle):
    start = f'{PUBLISHED}\nstart = ["0 deg", "{middle}", "0 deg"]'
    made, session = tumble(start, 'attitude = ["0 deg", "0 deg", "0 deg"]', seed=8)
    result = calibrate(made, session.simulation.log, trial=True)
    assert result.verdict.level is Level.PASS, failed(result)
    error = (result.coefficients.values - session.truth.values)[:42]
    low, high = chi_square_limits(42, tests=2)
    assert low < error @ np.linalg.solve(result.coefficients.cov[:42, :42], error) < high


# -- what is known beforehand ----------------------------------------------------------------------


def test_uncertain_gravity_is_one_error_of_all_scale_factors():
    made, session = tumble()
    log, sd = session.simulation.log, 2e-4
    sure, unsure = (
        calibrate(made, log, trial=True, site=replace(made.site, gravity_sd=given)).coefficients
        for given in (0.0, sd)
    )
    more = unsure.cov - sure.cov
    # By units: what is per g moves with g, a bias not at all, 1 + scale factor error against it.
    slope, quadratic = np.zeros(45), CONSTANTS.group("accel.quadratic")
    for k, c in enumerate(CONSTANTS.coefficients):
        power = {"g-sensitivity": 1, "g-squared sensitivity": 2}.get(c.kind, 0)
        slope[k] = -power * sure.values[k]
    slope[SCALE], slope[quadratic] = -1 - sure.values[SCALE], -2 * sure.values[quadratic]
    slope *= sd / made.site.gravity
    size = np.sqrt(np.outer(np.diag(unsure.cov), np.diag(unsure.cov)))
    np.testing.assert_allclose(more / size, np.outer(slope, slope) / size, atol=1e-9)
    np.testing.assert_array_equal(sure.values, unsure.values)


@pytest.mark.thorough
def test_a_prior_in_the_campaign_holds_what_it_names(tmp_path):
    session = tumble()[1]
    file = foucault.campaign.save_session(session, tmp_path)
    free = foucault.calibrate(file)
    file.write_text(
        file.read_text() + '[prior]\n"accel.bias.x" = { mean = "50 ug", sd = "0.001 ug" }\n'
        '"gyro.drift" = { mean = "-3 deg/h", sd = "50 deg/h" }\n'
    )
    held = foucault.calibrate(foucault.load_campaign(file))
    k = BIAS[0]
    assert held.coefficients.values[k] == pytest.approx(50 * UG, abs=0.01 * UG)
    assert held.coefficients.sd[k] <= 0.001 * UG * (1 + 1e-6)
    assert abs(free.coefficients.values[k] - session.truth.values[k]) < 5 * free.coefficients.sd[k]
    np.testing.assert_allclose(held.coefficients.prior_sd[:3], 50 * DEG_H)
    # Nothing is kept but what was said: y and z stay as they are.
    assert held.coefficients.sd[BIAS[1]] > 0.05 * UG


# -- how it is driven and read ---------------------------------------------------------------------

LENGTHWISE = 'arms = [["5 cm", "0 m", "0 m"], ["0 m", "5 cm", "0 m"], ["0 m", "0 m", "5 cm"]]'
CROSSWISE = 'arms = [["0 m", "5 cm", "0 m"], ["0 m", "0 m", "5 cm"], ["5 cm", "0 m", "0 m"]]'


@pytest.mark.parametrize(("kind", "mask"), [("increment", "0 s"), ("rate", "0.1 s")])
def test_lever_arms(kind, mask):
    """At 5 deg/s an arm of 5 cm along an input axis is 40 ug while it turns about another.

    Readings at the very time of a step have no rate that is right for them, so they are masked.
    """
    words = f'{FAST}\npasses = 20\nmask_edges = "{mask}"'
    made, session = tumble(f"{words}\n{LENGTHWISE}", f'kind = "{kind}"')
    log = session.simulation.log
    known = calibrate(made, log, trial=True)
    assert known.verdict.level is Level.PASS, failed(known)
    low, high = chi_square_limits(45, tests=2)
    assert low < nees(known, session.truth) < high
    without = calibrate(campaign_of(words), log, trial=True)
    assert "residuals" in failed(without)


def test_readings_after_a_step_of_the_command_can_be_left_out():
    """The cluster follows a step in 0.6 s, and an arm across feels it."""
    words = f"{FAST}\n{CROSSWISE}\npasses = 20"
    session = tumble(words, 'edge = "0.6 s"')[1]
    log = session.simulation.log
    felt = calibrate(campaign_of(words), log, trial=True)
    masked = calibrate(campaign_of(f'{words}\nmask_edges = "1 s"'), log, trial=True)
    assert "tumble.mishap" in codes(felt) and "tumble.mishap" not in codes(masked)
    low, high = chi_square_limits(45, tests=2)
    for result in (felt, masked):
        assert result.verdict.level is Level.PASS, failed(result)
        assert low < nees(result, session.truth) < high


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("holds", ["from its time", "until its time"])
def test_commands_that_hold_either_way(holds, kind):
    words = f'{PUBLISHED}\ncommand_holds = "{holds}"'
    made, session = tumble(words, f'kind = "{kind}"', seed=9)
    result = calibrate(made, session.simulation.log, trial=True)
    assert result.verdict.level is Level.PASS, failed(result)
    low, high = chi_square_limits(45, tests=4)
    assert low < nees(result, session.truth) < high
    wrong = "until its time" if holds == "from its time" else "from its time"
    other = campaign_of(f'{PUBLISHED}\ncommand_holds = "{wrong}"')
    assert "residuals" in failed(calibrate(other, session.simulation.log, trial=True))


def test_a_delay_is_estimated_with_the_rest():
    made, session = tumble(f'{PUBLISHED}\ndelay_sd = "20 ms"', seed=10)
    result = calibrate(made, session.simulation.log, trial=True)
    delay, true = result.diagnostics["delay"], session.simulation.truth_json()["delay"]
    assert delay["estimated"]
    assert true != 0
    assert abs(delay["value"] - true) < 4 * delay["sd"] < 1e-3
    assert result.verdict.level is Level.PASS, failed(result)
    low, high = chi_square_limits(45)
    assert low < nees(result, session.truth) < high


# -- what the result is for ------------------------------------------------------------------------


def test_a_result_is_saved_loaded_and_applied(tmp_path):
    made, session = tumble()
    log = session.simulation.log
    result = calibrate(made, log)
    foucault.save_result(result, tmp_path)
    again = foucault.load_result(tmp_path)
    np.testing.assert_array_equal(again.coefficients.values, result.coefficients.values)
    np.testing.assert_array_equal(again.coefficients.cov, result.coefficients.cov)
    assert again.verdict == result.verdict
    assert set(again.tables) == set(result.tables)
    right = again.apply(log)
    # Every reading has the size of gravity, but for the noise.
    noise = made.noise.accel.white / np.sqrt(log.interval)
    off = (np.linalg.norm(right.accel, axis=1) - made.site.gravity) / noise
    low, high = chi_square_limits(len(off))
    assert low < off @ off < high
    raw = (np.linalg.norm(log.accel, axis=1) - made.site.gravity) / noise
    assert raw @ raw > 100 * high
    # The command has become the rate, to a few hundredths of a degree per hour.
    true = session.simulation.model.apply(log).gyro
    assert np.abs(right.gyro - true).max() < 0.02 * DEG_H
    assert np.abs(log.gyro - true).max() > DEG_H


@pytest.mark.thorough
@pytest.mark.parametrize("quantisation", [1e-3, 1e-4])
def test_a_tumble_read_as_pulses_knows_how_well_it_is_known(quantisation):
    """Counts of 100 ug and of 10 ug beside 1 ug of noise, each carried to the next reading."""
    made = campaign_of(FAST, 'kind = "increment"')
    accel = replace(made.noise.accel, quantisation=quantisation)
    made = replace(made, noise=replace(made.noise, accel=accel))
    off, nees, levels = [], [], []
    for seed in range(8):
        session = campaign.simulate(made, seed)
        result = calibrate(made, session.simulation.log, trial=True)
        c = result.coefficients
        err = c.values - session.truth.chosen(c.names).values
        off.append(err / c.sd)
        nees.append(err @ np.linalg.solve(c.cov, err) / len(err))
        levels.append(result.verdict.level)
    assert 1 / 1.3 < np.sqrt(np.mean(np.square(off))) < 1.3
    assert 0.75 < np.mean(nees) < 1.25
    assert levels.count(Level.PASS) >= 7


def test_a_report_says_what_a_wrong_latitude_does_and_that_no_residual_shows_it():
    """0.01 deg is 10 sd of the latitude: 10 times its part of the budget, of the drift it hits."""
    made, session = tumble()
    log = session.simulation.log
    result = calibrate(made, log, trial=True)
    said = next(w for w in result.diagnostics["unseen"] if w.startswith("A wrong latitude"))
    name, size, unit = re.search(r"moves (\S+) by (\S+) (\S+),", said).groups()
    part = np.sqrt(result.diagnostics["budget"]["latitude"][result.coefficients.names.index(name)])
    assert name.startswith("gyro.drift.") and unit == "deg/h"
    assert float(size) == pytest.approx(10 * part / DEG_H, rel=0.03)
    exact = campaign_of(f'{PUBLISHED}\nlatitude_sd = "0 deg"')
    assert "0.003 deg/h" in calibrate(exact, log, trial=True).diagnostics["unseen"][0]
