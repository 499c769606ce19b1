"""Sessions of systematic calibration that break what it takes for granted: none of them passes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from test_systematic import SITE, codes, failed, nees, simulated, trial

from foucault.detect.stretches import SEQUENCE, find_rests
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.procedures import systematic
from foucault.procedures.systematic.settings import Settings
from foucault.result import Level
from foucault.tables import Log
from make_sequence import DEG, DPH, NOISE
from refusals import refuses

UG = 9.80665e-6
NAMES = systematic.names_of(Settings())


def outlying(made, share=0.01, size=20.0):
    """Return the log of a simulation with samples that are off by `size` sd of the noise."""
    rng = np.random.default_rng(5)
    out = {}
    for name, triad in (("gyro", NOISE.gyro), ("accel", NOISE.accel)):
        x = getattr(made.log, name).copy()
        hit = rng.random(x.shape) < share
        off = size * triad.white / np.sqrt(made.log.interval)
        x[hit] += off * rng.choice([-1.0, 1.0], int(hit.sum()))
        out[name] = x
    return replace(made, log=replace(made.log, **out))


@pytest.mark.thorough
def test_a_short_gap_within_a_rest_is_bridged_and_one_within_a_turn_is_not():
    made = simulated(seed=3)
    rests = find_rests(made.log, SEQUENCE).spans
    a, b = rests[4]

    def cut(row: int) -> Log:
        lost = slice(row, row + max(1, round(0.3 / made.log.interval)))
        keep = np.delete(np.arange(len(made.log)), lost)
        return replace(
            made.log, **{n: getattr(made.log, n)[keep] for n in ("time", "gyro", "accel")}
        )

    whole, result = trial(made), trial(replace(made, log=cut((a + b) // 2)))
    assert set(codes(result)) == {*codes(whole), "strapdown.bridged"}
    assert result.verdict.level is whole.verdict.level is Level.PASS
    off = (result.coefficients.values - whole.coefficients.values) / whole.coefficients.sd
    assert np.abs(off).max() < 0.3
    with refuses("systematic.gap"):
        trial(replace(made, log=cut(b + (rests[5][0] - b) // 2)))


@pytest.mark.thorough
def test_outlying_samples_are_named_and_weighed():
    """One sample in a hundred 20 sd off is five times the variance."""
    made = outlying(simulated(seed=2))
    result = trial(made)
    assert failed(result) == {"noise"} and codes(result) == ["log.spikes", *["rest.outliers"] * 2]
    assert nees(result, made.model, NAMES) < chi_square_limits(24)[1]
    measured = trial(made, noise=None)
    assert measured.verdict.level is Level.PASS
    assert codes(measured) == ["log.spikes", *["rest.outliers"] * 2]
    assert nees(measured, made.model, NAMES) < chi_square_limits(24)[1]


@pytest.mark.thorough
def test_wander_that_is_declared_is_in_the_uncertainty_of_the_long_term_bias():
    """Markov biases of 300 s, exactly as simulated: the result is of the long term."""
    noise = ImuNoise(
        replace(NOISE.accel, bias_instability=15 * UG, correlation_time=300.0),
        replace(NOISE.gyro, bias_instability=0.02 * DPH, correlation_time=300.0),
    )
    score, sessions = [], 8
    for seed in range(sessions):
        made = simulated(seed=seed, noise=noise)
        result = trial(made, noise=noise)
        assert result.coefficients.names == NAMES and not result.findings
        assert not failed(result)
        score.append(nees(result, made.model, NAMES))
    low, high = chi_square_limits(24 * sessions)
    assert low < sum(score) < high
    calm = trial(made)  # not declared: it shows
    assert failed(calm) >= {"rests", "velocities"}
    wider = result.coefficients["accel.bias"].sd / calm.coefficients["accel.bias"].sd
    assert (wider > 3.0).all()


@pytest.mark.thorough
@pytest.mark.parametrize("part", [0.2, 1.0])
def test_gyros_that_bend_do_not_pass_without_deflection(part):
    """Quarter turns show some bending before any check of the residuals fails."""
    model = systematic.simulate(
        systematic.Session(rest_time=25.0, rate=5.0), settings=Settings(deflection="coupled6"),
        model=systematic.draw_errors("navigation", 1), noise=NOISE, site=SITE, seed=1,
    ).model  # fmt: skip
    made = simulated(model=replace(model, deflection=part * model.deflection))
    result = systematic.calibrate(made.log, site=SITE, noise=NOISE)
    assert nees(result, made.model, NAMES) > 2 * chi_square_limits(24)[1]
    assert "left out" in failed(result) and "systematic.bends" in codes(result)
    check = next(c for c in result.checks if c.name == "left out")
    assert check.sentence.startswith("The readings are explained better if the gyros bend")
    assert result.verdict.level is Level.DOUBTFUL


@pytest.mark.thorough
def test_an_asymmetry_that_is_left_out_does_not_pass():
    model = systematic.draw_errors("navigation", 1)
    made = simulated(model=replace(model, accel_asymmetry=np.array([3e-4, 0.0, 0.0])))
    settings = Settings(accel_asymmetry=False)
    result = systematic.calibrate(made.log, site=SITE, noise=NOISE, settings=settings)
    assert "left out" in failed(result) and "systematic.curves" in codes(result)


# -- what changes at once --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("triad", "size", "words"),
    [
        ("gyro", 0.08 * DPH, "the biases of the gyros changed"),
        ("accel", 8 * UG, "the biases of the accelerometers changed"),
    ],
)
def test_a_bias_that_steps_is_named_with_its_time(triad, size, words):
    made = simulated(seed=2)
    step = size * (made.log.time > 400.0)[:, None] * [0.0, 0.0, 1.0]
    result = trial(replace(made, log=replace(made.log, **{triad: getattr(made.log, triad) + step})))
    assert "shifts" in failed(result)
    told = next(c.sentence for c in result.checks if c.name == "shifts")
    time = float(re.search(rf"{words} at (\d+) s", told)[1])
    assert time == pytest.approx(400.0, abs=40.0)


@pytest.mark.parametrize("seed", [2, 5])
def test_a_knock_in_a_rest_that_the_readings_hardly_show_is_left_out(seed):
    """Of 1 s and 3 mg: taken in, it makes a NEES of 7 to 12 for each coefficient."""
    made = simulated(seed=seed)
    a, b = find_rests(made.log, SEQUENCE).spans[4 + seed]
    middle = made.log.time[(a + b) // 2]
    during = np.clip((made.log.time - middle) / 1.0, 0.0, 1.0)
    knock = 3e-2 * np.sin(np.pi * during)[:, None] ** 2 * [0.6, -0.5, 0.6]
    result = trial(replace(made, log=replace(made.log, accel=made.log.accel + knock)))
    assert not failed(result) and codes(result) == ["systematic.bump"]
    told = result.findings[0].message
    begin, end = (float(x) for x in re.findall(r"([\d.]+) s", told))
    assert begin < middle < middle + 1.0 < end < begin + 5.5
    assert nees(result, made.model, NAMES) < chi_square_limits(24)[1]


def test_steps_that_need_not_show_are_named_by_their_size():
    result = trial(simulated(seed=2))
    assert not failed(result)
    (told,) = (line for line in result.diagnostics["unseen"] if line.startswith("Biases"))
    assert 0.02 < float(re.search(r"gyros by less than ([\d.]+) deg/h", told)[1]) < 0.2


# -- the Earth as a clock --------------------------------------------------------------------------


@pytest.mark.thorough
def test_stamps_that_are_a_thousandth_wrong_are_seen_by_the_earth():
    made = simulated(seed=4)
    log = replace(made.log, time=1.001 * made.log.time)
    result = trial(replace(made, log=log))
    assert failed(result) == {"Earth's rate"} and codes(result) == ["session.earth_rate"]
    told = next(c for c in result.checks if c.name == "Earth's rate").sentence
    assert "the times of the log run 0." in told and "fast" in told
    assert "Compare the times of the log with a clock" in result.findings[0].cure
    assert "by the times and at the latitude that were given" in result.findings[0].message


@pytest.mark.thorough
def test_a_latitude_a_tenth_of_a_degree_off_is_seen():
    made = simulated(seed=4)
    result = trial(made, site=Site.at(SITE.latitude + 0.1 * DEG, SITE.height))
    assert "Earth's rate" in failed(result)
    told = next(c for c in result.checks if c.name == "Earth's rate").sentence
    assert re.search(r"the latitude is -0\.(1|0[89]\d?|1[01]) deg", told)


@pytest.mark.thorough
def test_the_earth_of_a_clean_session_turns_as_it_should():
    """Two degrees of freedom each, over 10 sessions."""
    squares = []
    for seed in range(10):
        result = trial(simulated(seed=seed))
        check = next(c for c in result.checks if c.name == "Earth's rate")
        assert check.passed
        squares.append(check.value)
    low, high = chi_square_limits(20)
    assert low < sum(squares) < high


@pytest.mark.thorough
def test_a_prior_that_the_log_contradicts_is_named_however_narrow_it_is():
    made = simulated(seed=2)
    truth = made.model.coefficients(("gyro.scale.x",)).values[0]
    for sd in (1e-5, 1e-7, 1e-9):
        result = trial(made, prior={"gyro.scale.x": (truth + 1e-4, sd)})
        assert "prior" in failed(result)
        told = next(c for c in result.checks if c.name == "prior").sentence
        assert told.startswith("gyro.scale.x is ")
    result = trial(made, prior={"gyro.scale.x": (truth + 1e-7, 1e-7)})
    assert not failed(result)


# -- readings that cannot be -----------------------------------------------------------------------

FEW = systematic.Session(rest_time=30.0, rate=5.0)


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"gyro": 0.0}, "systematic.one_value", "gyro x, gyro y, gyro z read one value"),
        ({"accel": 0.0}, "systematic.one_value", "accel x, accel y, accel z read one value"),
        ({"gyro": np.diag([1.0, 0.0, 1.0])}, "systematic.one_value", "gyro y read one value"),
        ({"gyro": 3600.0}, "systematic.rest_rate", "deg/h or arcsec/s and was declared as deg/s"),
        (
            {"gyro": 3600.0 / DEG},
            "systematic.rest_rate",
            "deg/h or arcsec/s and was declared as rad",
        ),
        ({"accel": np.diag([1.0, 1 / 9.80665, 1.0])}, "accel.one_axis", "accelerometer y are div"),
        ({"accel": np.diag([9.80665, 1.0, 1.0])}, "accel.one_axis", "x are divided by 9.807"),
    ],
)
def test_readings_that_cannot_be_are_named_for_what_they_are(change, code, words):
    log = simulated(session=FEW).log
    for name, factor in change.items():
        matrix = factor * np.eye(3) if np.isscalar(factor) else factor
        log = replace(log, **{name: getattr(log, name) @ matrix})
    with refuses(code, match=words):
        systematic.trial(log, site=SITE, settings=Settings(), noise=NOISE)
