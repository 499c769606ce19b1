"""A session by hand that passes has to say something: scatter, predictions, what is not seen."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, rate_table
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_faces import short_log
from make_rates import make_readings, make_steps
from make_session import SITE, short_plan

MEMS = grade("mems").noise


UNSEEN = (
    "ug/g^2 moves a bias",
    "mGal move a scale factor",
    "A wrong time base",
    "A gyro scale factor that changes with the rate",
    "no residual follows",
)


@cache
def made(rests=16):
    model = draw_errors("mems", 1)
    return simulate(short_plan(rests, seed=1), model=model, noise=MEMS, site=SITE, seed=1)


def the(result, name):
    (check,) = [c for c in result.checks if c.name == name]
    return check


@pytest.mark.parametrize(("size", "passes"), [(1.0, True), (4.0, False)])
def test_turns_far_beyond_the_noise_are_no_scatter(size, passes):
    """Each turn is off by a rate of its own, as lost samples make it."""
    simulation, rng = made(), np.random.default_rng(4)
    gyro = simulation.log.gyro.copy()
    for a, b in zip(simulation.last[:-1], simulation.first[1:], strict=True):
        gyro[a:b] += rng.normal(0, size * np.radians(0.04), 3)
    result = hand_rotated.calibrate(replace(simulation.log, gyro=gyro), site=SITE)
    check = the(result, "noise of turns")
    assert check.passed is passes
    assert (check.high is None) is passes
    assert (result.verdict.level is Level.PASS) is passes
    if not passes:
        assert "more than 5 times: something is wrong that is no scatter" in check.sentence


def test_rests_that_are_predicted_far_worse_than_they_are_fitted():
    """Eleven rests of nine coefficients: without any two of them nothing is determined."""
    few, enough = (hand_rotated.calibrate(made(n).log, site=SITE, noise=MEMS) for n in (11, 16))
    bad, good = (the(r, "prediction against fit") for r in (few, enough))
    assert not bad.passed and bad.value > 100 and "hardly determine" in bad.sentence
    assert good.passed and good.value < 4


def test_what_cannot_be_seen_is_said_with_the_size_that_matters():
    by_hand = hand_rotated.calibrate(made().log, site=SITE, noise=MEMS)
    on_faces = ferraris.calibrate(short_log(1)[0], site=SITE, noise=MEMS)
    for result in (by_hand, on_faces):
        said = " ".join(result.diagnostics["unseen"])
        for words in UNSEEN:
            assert words in said
        ppm = 1e6 * result.coefficients["gyro.scale"].sd.min()
        assert f"{float(f'{ppm:.2g}'):.0f} ppm of it are a standard deviation" in said
    steps = make_steps(sd=1e-5)
    steps.gyro[:] += np.random.default_rng(1).normal(0, 1e-5, steps.gyro.shape)
    table = rate_table.from_readings(
        make_readings(steps), rate_table.Settings(), told=True, site=SITE
    )
    said = " ".join(table.diagnostics["unseen"])
    assert "A wrong time base" in said and "changes with the rate" not in said


def disturbed(rests, size):
    """The accelerometers off by a constant in some rests."""
    simulation, rng = made(20), np.random.default_rng(1)
    accel = simulation.log.accel.copy()
    for k in rests:
        a, b = max(simulation.first[k] - 5, 0), simulation.last[k] + 5
        accel[a:b] += rng.normal(0, size, 3)
    return simulation, replace(simulation.log, accel=accel)


@pytest.mark.parametrize(
    ("rests", "size", "words"),
    [
        ((4, 7, 11), 0.08, "make most of it: look there, not at the declared noise"),
        (range(20), 0.02, "it is spread over all of them"),
    ],
    ids=["three rests", "all rests"],
)
def test_what_makes_the_residuals_larger_than_declared_noise_is_named(rests, size, words):
    simulation, log = disturbed(rests, size)
    settings = hand_rotated.Settings(loss="squares")
    result = hand_rotated.calibrate(log, site=SITE, noise=MEMS, settings=settings)
    sentence = the(result, "noise of specific force at rest").sentence
    assert result.verdict.level is Level.DOUBTFUL and words in sentence
    if len(rests) == 3:
        named = np.array([float(t) for t in re.findall(r"([\d.]+) s", sentence)])
        start = simulation.log.time[simulation.first[list(rests)]] - simulation.log.time[0]
        assert (np.abs(named - start[:, None]).min(axis=1) < 1.0).all()  # some others beside them
        assert len(named) <= 5
        # Left out, they do not touch the noise of the others.
        robust = hand_rotated.calibrate(log, site=SITE, noise=MEMS)
        found = [f.message for f in robust.findings if f.code == "session.outlier"]
        assert len(found) == 3 and all("specific force of the rest" in words for words in found)
        assert the(robust, "noise of specific force at rest").passed


def test_a_drift_is_named_before_the_declared_noise():
    log = made(20).log
    tau = (log.time / np.ptp(log.time))[:, None]
    result = hand_rotated.calibrate(
        replace(log, accel=log.accel + 0.04 * tau * [0, 1, 0]), site=SITE, noise=MEMS
    )
    assert "accel.bias.y had drifted" in result.verdict.reasons[0]
    sentence = the(result, "noise of specific force at rest").sentence
    assert "a drift of accel.bias.y during the session makes them" in sentence
