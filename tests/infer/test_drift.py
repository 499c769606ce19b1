"""Residuals against time: a drift is named with its size, chance is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from foucault.infer.drift import by_time, find_drift, jumps
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.left_out import ByNoise
from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, rate_table
from foucault.result import Level, Linearised
from foucault.simulate.hand_rotated import draw_errors, simulate
from make_faces import short_log
from make_rates import make_readings, make_steps
from make_session import SITE, short_plan

NAMES = ("accel.scale.x", "accel.scale.y", "accel.scale.z", "accel.bias.x")
TIME = np.sort(np.random.default_rng(5).uniform(10.0, 400.0, 16))
MEMS = grade("mems").noise


def solved(rng, drift=(0, 0, 0, 0), sd=(1.0, 1.0), moment=None):
    """Sixteen observations of three rows and two kinds, fitted by four coefficients."""
    moment = by_time(TIME) if moment is None else moment
    J = rng.normal(size=(16, 3, 4))
    noise = np.where(np.arange(16) < 8, *sd)[:, None] * rng.normal(size=(16, 3))
    y = noise + J @ np.array(drift, float) * moment[:, None]
    J, y = J.reshape(-1, 4), y.ravel()
    r = y - J @ np.linalg.lstsq(J, y)[0]
    return Linearised(r, J, np.repeat(np.arange(16), 3))


def changed(at, time=TIME, moments=None, **how):
    """The clearest drift, or jump at `moments`."""
    moments = {None: by_time(time)} if moments is None else moments
    rows = np.maximum(at.blocks, 0)
    columns = {when: at.jacobian * moment[rows, None] for when, moment in moments.items()}
    return find_drift(at, NAMES, columns, **how)


def test_times_run_from_minus_a_half_to_a_half():
    np.testing.assert_allclose(by_time(np.array([5.0, 7.0, 9.0])), [-0.5, 0.0, 0.5])
    assert (by_time(np.full(3, 7.0)) == 0).all()


@pytest.mark.parametrize(
    ("drift", "name", "size"),
    [
        ((0, 0, 0, 8.0), "accel.bias.x", 8.0),
        ((0, -9.0, 0, 0), "accel.scale.y", -9.0),
        ((5.0, 5.0, 5.0, 0), "accel.scale", 5.0),
    ],
)
def test_a_drift_is_named_with_its_size(drift, name, size):
    found = changed(solved(np.random.default_rng(1), drift))
    assert found.significant and found.name == name
    assert abs(found.size - size) < 4 * found.sd < 4.0


def test_a_jump_is_named_with_its_size_and_time_and_is_clearer_than_a_drift():
    moments = jumps(TIME)
    assert len(moments) == 13 and all(np.sum(x < 0) >= 2 <= np.sum(x > 0) for x in moments.values())
    for when, moment in moments.items():
        at = solved(np.random.default_rng(1), (0, 0, 0, 9.0), moment=moment)
        found, drift = changed(at, moments=moments), changed(at)
        assert found.significant and (found.name, found.when) == ("accel.bias.x", when)
        assert abs(found.size - 9.0) < 4 * found.sd < 6.0
        assert found.ratio / found.limit > drift.ratio / drift.limit
    assert not jumps(TIME[:3])


@pytest.mark.parametrize("moments", [None, jumps(TIME)])
@pytest.mark.parametrize("sd", [(1.0, 1.0), (10.0, 1.0)])
def test_chance_is_taken_for_a_drift_as_often_as_is_stated(sd, moments):
    """Scatter of any size, of each kind its own, since none is believed."""
    rng, kinds = np.random.default_rng(2), np.repeat([0, 1], 8)
    wrong = sum(
        changed(solved(rng, sd=sd), moments=moments, kinds=kinds).significant for _ in range(1500)
    )
    low, high = binom.ppf([0.005, 0.995], 1500, [FALSE_ALARM / 3, 1.3 * FALSE_ALARM])
    assert low <= wrong <= high  # Welch's degrees of freedom are an approximation


def test_scatter_fitted_to_a_drift_does_not_hide_it():
    at = solved(np.random.default_rng(1), (0, 0, 0, 30.0))
    size = np.sqrt(np.mean(at.residuals**2))
    believed = replace(at, residuals=at.residuals / size, jacobian=at.jacobian / size)
    one, other = map(changed, (at, believed))
    assert other.significant and other.ratio == pytest.approx(one.ratio)
    assert other.size == pytest.approx(one.size)


def test_what_would_not_show_is_not_judged():
    rng = np.random.default_rng(1)
    J = np.eye(4)
    at = Linearised(rng.normal(size=4), J, np.arange(4))
    assert changed(at, TIME[:4]) is None  # nothing is redundant
    still = solved(rng)
    assert changed(still, np.full(16, 3.0)) is None  # no time passes


def the(result):
    return next(c for c in result.checks if c.name in ("drift", "jump"))


def drifting(log, gyro=0.0, accel=0.0, scale=0.0):
    tau = by_time(log.time)[:, None]
    return replace(
        log, gyro=log.gyro + gyro * tau, accel=log.accel * (1 + scale * tau) + accel * tau
    )


DRIFTS = [
    ({"gyro": np.radians(0.03) * np.array([1, 0, 0])}, "gyro.bias.x had drifted by"),
    ({"accel": 9.81e-3 * np.array([0, 1, 0])}, "accel.bias.y had drifted by"),
]


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize(
    ("drift", "words"), [*DRIFTS, ({"scale": 1e-3}, "accel.scale had drifted by")]
)
def test_a_session_by_hand_that_drifts_is_no_pass(drift, words, declared):
    plan = short_plan(20)
    log = simulate(plan, model=draw_errors("mems", 1), noise=MEMS, site=SITE, seed=1).log
    noise = MEMS if declared else None
    good, bad = (
        hand_rotated.calibrate(x, site=SITE, noise=noise) for x in (log, drifting(log, **drift))
    )
    assert good.verdict.level is Level.PASS and the(good).passed
    assert the(good).sentence.startswith("The residuals do not follow time")
    assert bad.verdict.level is Level.DOUBTFUL
    assert words in the(bad).sentence and "Let the instrument warm up" in the(bad).sentence
    # What follows from the drift comes after it.
    assert bad.verdict.reasons[0] == the(bad).sentence


@pytest.mark.parametrize("sizes", [None, ByNoise()])
def test_a_session_by_hand_in_which_a_bias_jumps_is_no_pass(sizes):
    """With drifts counted too, which have a size of their own."""
    plan = short_plan(20)
    log = simulate(plan, model=draw_errors("mems", 1), noise=MEMS, site=SITE, seed=1).log
    half = log.time[:, None] > np.mean(log.time[[0, -1]])
    spoiled = replace(log, accel=log.accel + half * [9.81e-3, 0, 0])
    good, bad = (
        hand_rotated.calibrate(x, site=SITE, noise=MEMS, sizes=sizes) for x in (log, spoiled)
    )
    assert good.verdict.level is Level.PASS
    assert bad.verdict.level is Level.DOUBTFUL
    assert "accel.bias.x had jumped by" in bad.verdict.reasons[0]
    at = float(bad.verdict.reasons[0].split(" at ")[1].split(" s")[0])
    assert abs(at - np.mean(log.time[[0, -1]])) < 0.1 * np.ptp(log.time)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.thorough) for k in (2, 3))]
)
def test_accelerometers_that_slip_against_the_gyros_are_named_by_the_angle(seed):
    """By 0.2 deg, which misalignments of two gyros show together; one by one most were missed."""
    plan, named = short_plan(20), 0
    log = simulate(plan, model=draw_errors("mems", seed), noise=MEMS, site=SITE, seed=seed).log
    half = log.time[:, None] > np.mean(log.time[[0, -1]])
    for axis, angle in zip("xyz", np.radians(0.2) * np.eye(3), strict=True):
        slipped = replace(log, accel=log.accel - half * np.cross(angle, log.accel))
        result = hand_rotated.calibrate(slipped, site=SITE, noise=MEMS, sizes=ByNoise())
        first = (*result.verdict.reasons, "")[0]
        told = f"the angle of the gyros' axes about {axis} had jumped by "
        if told in first:
            named += 1
            assert float(first.split(told)[1].split()[0]) == pytest.approx(-12.0, abs=3.0)  # arcmin
    assert named == 2  # about x this session shows it too little


@pytest.mark.parametrize(("drift", "words"), DRIFTS)
def test_a_session_on_faces_that_drifts_is_no_pass(drift, words):
    log, _ = short_log(1)
    good, bad = (
        ferraris.calibrate(x, site=SITE, noise=MEMS) for x in (log, drifting(log, **drift))
    )
    assert the(good).passed
    assert bad.verdict.level is Level.DOUBTFUL and words in the(bad).sentence


def test_a_scale_that_drifts_on_a_rate_table_is_no_pass():
    rng, sd = np.random.default_rng(3), 1e-5
    steps = make_steps(draw_errors("mems", 2), sd=sd)
    steps.gyro[:] += rng.normal(0, sd, steps.gyro.shape)
    steps.gyro[:] *= 1 + 1e-3 * by_time(steps.middle)[:, None]
    result = rate_table.from_readings(
        make_readings(steps), rate_table.Settings(), told=True, site=SITE
    )
    assert result.verdict.level is Level.DOUBTFUL
    assert "gyro.scale had drifted by" in the(result).sentence
