"""Every usual mistake with a hand-rotated session, and what the user is told."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.detect.stretches import find_rests
from foucault.errors import FoucaultError, Status
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import grade
from foucault.plans.directions import spread_directions
from foucault.procedures import hand_rotated_published
from foucault.procedures.hand_rotated import PROCEDURE, Session, Settings, calibrate
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors, simulate
from foucault.tables import Log
from make_session import BLIND, SITE, model_of, plan_with, short_plan
from sessions import codes, failed

NOISE = grade("tactical").noise


@cache
def made(rests=14, model=None, site=SITE):
    model = draw_errors("tactical", 1) if model is None else model_of(dict(model))
    return simulate(short_plan(rests), model=model, noise=NOISE, site=site, seed=2)


def refused(log, **words):
    with pytest.raises(FoucaultError) as caught:
        calibrate(log, **({"site": SITE} | words))
    return caught.value


def the(result, code):
    (found,) = [f for f in result.findings if f.code == code]
    return found


def test_a_good_session_passes_without_warnings():
    result = calibrate(made().log, site=SITE)
    assert result.verdict.level is Level.PASS
    assert {f.severity for f in result.findings} <= {"note"}
    assert all(c.passed for c in result.checks)


@pytest.mark.parametrize("seed", [9, 20])
def test_a_rest_in_which_the_instrument_slipped_misleads_no_turn_beside_it(seed):
    """By .3 deg in .3 s: left in, the turn on its one side made a NEES of 4 to 7 that passed."""
    noise, settings = grade("mems").noise, Settings(accel_quadratic=False)
    still = PROCEDURE.simulate(
        Session(rests=12), settings=settings, model=draw_errors("mems", seed), noise=noise,
        site=SITE, seed=seed,
    )  # fmt: skip
    rng, log = np.random.default_rng(seed), still.log
    k = rng.integers(2, 11)
    axis = rng.standard_normal(3)
    axis *= np.radians(0.3) / np.linalg.norm(axis)
    begin, end = log.time[still.first[k]], log.time[still.last[k] - 1]
    x = np.clip((log.time - begin - rng.uniform(0.3, 0.7) * (end - begin)) / 0.3, 0.0, 1.0)
    part = (x**2 * (3 - 2 * x))[:, None]
    f, w = still.model.compensate(log.accel, log.gyro)
    turned = Rotation.from_rotvec(-part * axis)
    moved = still.model.measure(
        turned.apply(f), turned.apply(w) + np.gradient(part[:, 0], log.time)[:, None] * axis
    )
    result = calibrate(
        replace(log, accel=moved[0], gyro=moved[1]), site=SITE, settings=settings, noise=noise
    )
    error = result.coefficients.values - still.model.coefficients(result.coefficients.names).values
    square = error @ np.linalg.solve(result.coefficients.cov, error)
    assert square < chi_square_limits(len(error))[1]
    assert "rate of the rest" in the(result, "session.outlier").message
    assert result.verdict.level is Level.PASS


# -- axes ------------------------------------------------------------------------------------


def exchanged(order, signs):
    """Gyro columns of the log as a wrong description would read them."""
    log = made().log
    return replace(log, gyro=log.gyro[:, order] * signs)


@pytest.mark.parametrize(
    ("order", "signs", "words"),
    [
        ([1, 0, 2], [1, 1, 1], "x = +y, y = +x, z = +z"),
        ([0, 1, 2], [1, 1, -1], "x = +x, y = +y, z = -z"),
    ],
    ids=["swapped", "one sign"],
)
def test_a_left_handed_triad(order, signs, words):
    problem = refused(exchanged(order, signs))
    assert problem.code == "gyro.left_handed"
    assert words in problem.message
    assert "one of the two triads is left-handed" in problem.message
    assert "[log.gyro] or in [log.accel]" in problem.cure


def test_all_gyro_signs_reversed_or_both_triads_mirrored():
    for problem in (refused(exchanged([0, 1, 2], [-1, -1, -1])), refused(mirrored())):
        assert problem.code == "gyro.reversed"
        assert "both triads are left-handed alike" in problem.cure


def mirrored():
    """Two columns exchanged alike in both triads."""
    log = made().log
    return replace(log, gyro=log.gyro[:, [1, 0, 2]], accel=log.accel[:, [1, 0, 2]])


def reads_gravity():
    return replace(made().log, accel=-made().log.accel)


def test_the_earth_tells_gravity_from_specific_force():
    good = calibrate(made().log, site=SITE)
    (check,) = [c for c in good.checks if c.name == "vertical Earth rate"]
    assert check.passed
    bad = calibrate(reads_gravity(), site=SITE)
    assert bad.verdict.level is Level.UNUSABLE
    (check,) = [c for c in bad.checks if c.name == "vertical Earth rate"]
    assert "Its sign is reversed: the accelerometers read gravity" in check.sentence
    assert "session.g_sensitivity" not in codes(bad)  # it would explain it, and hide it


def test_a_g_sensitivity_does_not_hide_that_gravity_is_read():
    settings = Settings(g_sensitivity=True)
    good, bad = (calibrate(x, site=SITE, settings=settings) for x in (made().log, reads_gravity()))
    (check,) = [c for c in good.checks if c.name == "vertical Earth rate"]
    assert check.passed and check.value > 4
    assert bad.verdict.level is Level.DOUBTFUL
    (check,) = [c for c in bad.checks if c.name == "vertical Earth rate"]
    assert not check.passed and "It may well be that: the accelerometers read" in check.sentence
    # One of its own that is as large is no reversed sign.
    strong = calibrate(made(14, STRONG).log, site=SITE, settings=settings)
    assert next(c for c in strong.checks if c.name == "vertical Earth rate").passed


@pytest.mark.parametrize(
    ("order", "signs", "words"),
    [
        ([1, 2, 0], [1, 1, 1], "x = +z, y = +x, z = +y"),
        ([0, 1, 2], [1, -1, -1], "x = +x, y = -y, z = -z"),
    ],
)
def test_gyro_axes_exchanged(order, signs, words):
    problem = refused(exchanged(order, signs))
    assert problem.code == "gyro.axes"
    assert words in problem.message
    assert "Reorder `columns` of [log.gyro]" in problem.cure


def test_an_exchange_that_is_named_is_the_one_that_cures():
    log = exchanged([1, 2, 0], [1, 1, 1])
    # "x = +z, y = +x, z = +y": body axis = declared column.
    cured = replace(log, gyro=log.gyro[:, [2, 0, 1]])
    np.testing.assert_array_equal(cured.gyro, made().log.gyro)


# -- units -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (180 / np.pi, "the unit is deg/s and was declared as rad/s"),
        (np.pi / 180, "the unit is rad/s and was declared as deg/s"),
        (0.01, "increments were declared as rates"),
        (100.0, "rates were declared as increments"),
    ],
)
def test_a_wrong_unit_of_the_gyros(factor, cause):
    problem = refused(replace(made().log, gyro=made().log.gyro * factor))
    assert problem.code == "gyro.unit"
    assert problem.message.endswith(f"probably {cause}.")
    assert problem.cure == "Correct `unit` and `kind` in [log.gyro]."


@pytest.mark.parametrize("axis", range(3))
def test_one_column_in_another_unit(axis):
    log, one = made().log, np.eye(3)[axis]
    problem = refused(replace(log, gyro=log.gyro * (1 + one * (180 / np.pi - 1))))
    assert problem.code == "gyro.one_axis"
    assert f"readings of gyro {'xyz'[axis]} multiplied by 0.01745 they miss" in problem.message
    for factor, said in ((1 / 9.80665, "0.102"), (9.80665, "9.807"), (1e3, "1000")):
        problem = refused(replace(log, accel=log.accel * (1 + one * (factor - 1))))
        assert problem.code == "accel.one_axis"
        assert f"accelerometer {'xyz'[axis]} are divided by {said}:" in problem.message


@pytest.mark.parametrize(("factor", "ratio"), [(9.80665, "9.81"), (1 / 9.80665, "0.102")])
def test_g_and_metres_per_second_squared(factor, ratio):
    problem = refused(replace(made().log, accel=made().log.accel * factor))
    assert problem.code == "accel.scale_impossible"
    assert f"{ratio} times local gravity" in problem.message
    assert "in g declared as m/s^2 gives 0.102, one in m/s^2 declared as g 9.81" in problem.cure


def test_a_scale_factor_of_a_third_is_a_wrong_unit():
    model = ImuModel(gyro_matrix=1.5 * np.eye(3))
    log = simulate(short_plan(), model=model, noise=NOISE, site=SITE, seed=2).log
    # 50 % is too small a miss for any usual mistake of unit to explain, and no instrument.
    result = calibrate(log, site=SITE)
    assert result.verdict.level is Level.UNUSABLE
    assert "gyro scale" in failed(result)
    assert any("wrong unit or count scale" in reason for reason in result.verdict.reasons)


# -- orientation of the first rest -----------------------------------------------------------


def declared(log, first_rest):
    return replace(log, source={"description": {"accel": {"first_rest": first_rest}}})


def test_a_declared_first_rest_is_checked_and_then_not_mentioned():
    assert "accel.sign_unknown" not in codes(calibrate(declared(made().log, "z up"), site=SITE))
    assert the(calibrate(made().log, site=SITE), "accel.sign_unknown").severity == "note"


def test_gravity_instead_of_specific_force():
    problem = refused(declared(replace(made().log, accel=-made().log.accel), "z up"))
    assert problem.code == "accel.orientation"
    assert problem.message == (
        "The first rest was declared 'z up', but the accelerometers say -z up."
    )
    assert 'set reads = "gravity" in [log.accel]' in problem.cure


def test_axes_exchanged_in_both_triads():
    log = made().log
    problem = refused(declared(replace(log, accel=log.accel[:, [1, 2, 0]],
                                       gyro=log.gyro[:, [1, 2, 0]]), "z up"))  # fmt: skip
    assert problem.code == "accel.orientation"
    assert "say +y up" in problem.message
    assert "Correct the order of `columns` in [log.accel] and [log.gyro]" in problem.cure


def test_a_first_rest_declared_downward():
    assert refused(declared(made().log, "z down")).code == "accel.orientation"


# -- too little ------------------------------------------------------------------------------


def test_fewer_rests_than_coefficients():
    problem = refused(made(8).log)
    assert problem.code == "rests.too_few"
    assert "The log has 8 rests of at least 1 s; 9 coefficients need at least 9." in str(problem)
    more = refused(made(11).log, settings=Settings(accel_quadratic=True))
    assert "12 coefficients need at least 12" in more.message


@pytest.mark.parametrize("samples", [0, 1, 10, 300])
def test_not_enough_samples(samples):
    assert refused(made().log[:samples]).code == "rests.too_few"


def test_rests_too_short_are_mentioned():
    problem = refused(made().log, settings=Settings(shortest="1.8 s"))
    assert problem.code == "rests.too_few"
    assert "quiet times are shorter than that" in problem.message


def test_a_log_in_which_nothing_moves():
    log = made().log
    still = replace(log, accel=np.tile([0.0, 0.0, 9.81], (len(log), 1)), gyro=0 * log.gyro)
    assert refused(still).code == "rests.too_few"


def _seen(up_b):
    plan = plan_with(up_b)
    return simulate(plan, model=draw_errors("tactical", 1), noise=NOISE, site=SITE, seed=2).log


@pytest.mark.parametrize("lean", [0.0, 0.02])
def test_rests_in_a_plane_and_two_more_are_no_pass(lean):
    """Two rests show the third axis: its terms are known much worse than the others."""
    a = 2 * np.pi * np.arange(14) / 14
    across = lean * np.random.default_rng(3).normal(size=14)
    up = np.concatenate([np.stack([np.cos(a), np.sin(a), across], 1), [[0.1, 0, 1], [0, -0.1, -1]]])
    log = _seen(up / np.linalg.norm(up, axis=1, keepdims=True))
    result = calibrate(replace(log, gyro=None), site=SITE)
    sd = result.coefficients["accel.misalignment"].sd
    assert sd.max() > 5 * sd.min()
    assert result.verdict.level is not Level.PASS
    assert "condition" in failed(result)
    assert any(
        "determine the accelerometer coefficients poorly" in r for r in result.verdict.reasons
    )


def test_all_rests_in_a_plane():
    a = 2 * np.pi * np.arange(14) / 14
    problem = refused(_seen(np.stack([np.cos(a), np.sin(a), 0 * a], 1)))
    assert problem.code == "rests.plane"
    assert "up stays in one plane of the body" in problem.message
    assert "-z up" in problem.cure and "+z up" in problem.cure


def test_rests_that_repeat_six_directions():
    six = np.concatenate([np.eye(3), -np.eye(3)])
    problem = refused(_seen(np.tile(six, (3, 1))))
    assert problem.code == "rests.plane"
    assert "too much alike to fit an ellipsoid" in problem.message


def test_all_rests_in_one_half_space():
    up_b = spread_directions(40)
    result = calibrate(_seen(up_b[up_b[:, 2] > 0.05][:16]), site=SITE)
    assert result.verdict.level is Level.DOUBTFUL
    assert "half-space" in failed(result)
    (reason,) = [r for r in result.verdict.reasons if "half-space" in r]
    assert "Add rests with -z up" in reason


def test_few_rests_cannot_show_a_bad_one():
    result = calibrate(made(11).log, site=SITE)
    assert result.verdict.level is Level.DOUBTFUL
    assert any(r.startswith("Only 11 rests") for r in result.verdict.reasons)


# -- disturbed -------------------------------------------------------------------------------


def test_a_rest_that_turns_is_left_out_and_named():
    simulation = made()
    gyro = simulation.log.gyro.copy()
    rest = slice(simulation.first[5], simulation.last[5])
    gyro[rest] += np.radians(3.0) * simulation.C_nb[5, 2]  # about up: gravity does not move
    result = calibrate(replace(simulation.log, gyro=gyro), site=BLIND)
    found = the(result, "rest.moving")
    assert "turns at 3.0" in found.message and found.severity == "warning"
    start = simulation.log.time[simulation.first[5]]
    assert start < result.tables["rests"]["start"].max()
    assert len(result.tables["rests"]["start"]) == 13
    assert not ((result.tables["rests"]["start"] > start - 1)
                & (result.tables["rests"]["end"] < start + 3)).any()  # fmt: skip
    assert result.verdict.level is Level.PASS


def _with_outlier(rests=20):
    simulation = made(rests)
    accel = simulation.log.accel.copy()
    accel[simulation.first[6] : simulation.last[6]] += [0.2, 0.0, 0.0]  # 20 mg
    return simulation, replace(simulation.log, accel=accel)


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [None, NOISE], ids=["measured", "declared"])
def test_an_outlier_rest_is_found_and_counts_less(noise):
    simulation, log = _with_outlier()
    robust = calibrate(log, site=SITE, noise=noise)
    found = the(robust, "session.outlier")
    assert "and was left out" in found.message
    at = float(found.message.partition(" s is")[0].rpartition(" ")[2])
    middle = simulation.log.time[(simulation.first[6] + simulation.last[6]) // 2]
    assert abs(at - middle) < 1.5
    weight = robust.tables["rests"]["weight"]
    assert weight[6] < 0.1
    assert np.delete(weight, 6).min() > 0.5
    plain = calibrate(log, site=SITE, noise=noise, settings=Settings(loss="squares"))
    truth = simulation.model.coefficients(robust.coefficients.names).values
    accel = slice(0, 9)
    miss = [np.linalg.norm((r.coefficients.values - truth)[accel]) for r in (robust, plain)]
    assert miss[0] < 0.2 * miss[1]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("triad", ["accel", "gyro"])
def test_numbers_that_are_not_finite(triad, bad):
    values = getattr(made().log, triad).copy()
    values[1234, 1] = bad
    problem = refused(replace(made().log, **{triad: values}))
    assert problem.code == "session.not_finite"
    assert f"Sample 1234 of {triad}" in problem.message


# -- site and model --------------------------------------------------------------------------


def test_a_wrong_gravity_looks_like_a_common_scale():
    log = made(14, ()).log  # an instrument without errors
    found = the(calibrate(log, site=replace(SITE, gravity=9.78)), "session.common_scale")
    ppm = float(found.message.partition(" ppm")[0].rpartition(" ")[2])
    assert ppm == pytest.approx((SITE.gravity / 9.78 - 1) * 1e6, abs=50)
    assert "gravity used: 9.78000" in found.cure
    assert "session.common_scale" not in codes(calibrate(log, site=SITE))


def test_a_missing_latitude():
    result = calibrate(made().log, site=BLIND)
    found = the(result, "session.no_latitude")
    assert found.severity == "warning" and "up to 9 deg/h" in found.message
    known = calibrate(made().log, site=SITE)
    assert "session.no_latitude" not in codes(known)
    bias, sure = result.coefficients["gyro.bias"], known.coefficients["gyro.bias"]
    assert (bias.sd > sure.sd).all()
    error = bias.values - made().model.gyro_bias
    square = error @ np.linalg.solve(bias.cov, error)
    assert square < chi_square_limits(3)[1]
    # The turns tie the rests together, so that a session tells most of the Earth's rate itself.
    assert (bias.sd < 0.3 * EARTH_RATE / np.sqrt(3)).all()


def test_accelerometers_alone():
    result = calibrate(replace(made(16).log, gyro=None), site=SITE)
    assert result.verdict.level is Level.PASS
    few = calibrate(replace(made().log, gyro=None), site=SITE)
    assert few.verdict.reasons[0].startswith("14 rests leave 5 numbers more than the unknowns")
    assert the(result, "session.no_gyro").severity == "note"
    assert all(n.startswith("accel.") for n in result.coefficients.names)
    assert "turns" not in result.tables
    names = result.coefficients.names
    error = result.coefficients.values - made().model.coefficients(names).values
    low, high = chi_square_limits(9)
    assert low < error @ np.linalg.solve(result.coefficients.cov, error) < high
    quiet = replace(made().log, gyro=None, accel=np.round(made().log.accel, 2))
    assert calibrate(quiet, site=SITE).status is Status.CONVERGED


def test_gyros_alone():
    problem = refused(replace(made().log, accel=None))
    assert problem.code == "session.no_accel"


def test_the_published_recipe_says_what_takes_means_of_poses():
    means = Log(60.0 * np.arange(24), None, made().log.accel[:24], averaged=np.full(24, 10.0))
    with pytest.raises(FoucaultError, match="one per pose") as problem:
        hand_rotated_published.calibrate(means, site=SITE)
    assert 'name = "hand_rotated"' in problem.value.cure


STRONG = tuple((n, 2e-4) for n in LAYOUT.names if "g_sensitivity" in n)


def test_g_sensitivity_that_is_not_modelled():
    log = made(14, STRONG).log
    result = calibrate(log, site=SITE)
    found = the(result, "session.g_sensitivity")
    assert found.severity == "warning" and result.verdict.level is Level.DOUBTFUL
    assert "Set g_sensitivity = true in [procedure]" in found.cure
    share = int(found.message.partition(" %")[0].rpartition(" ")[2])
    assert share > 90
    better = calibrate(log, site=SITE, settings=Settings(g_sensitivity=True))
    assert "session.g_sensitivity" not in codes(better)
    group = better.coefficients["gyro.g_sensitivity"]
    error = group.values - 2e-4
    square = error @ np.linalg.solve(group.cov, error)
    low, high = chi_square_limits(9)
    assert low < square < high
    assert better.verdict.level is Level.PASS


# -- missing rows ------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", [0.1, 0.4, 1.0, 3.0])
def test_a_turn_with_missing_rows_counts_less_and_nobody_is_accused(missing):
    """Up to a whole turn: what a line over the gap misses is seen in the other turns."""
    log = made().log
    rests = find_rests(log)
    middle = (log.time[rests.last[3] - 1] + log.time[rests.first[4]]) / 2 + 0.1
    rows = np.flatnonzero(np.abs(log.time - middle) >= missing / 2)
    result = calibrate(log[rows], site=SITE)
    assert result.verdict.level is Level.PASS and "session.outlier" not in codes(result)
    truth = draw_errors("tactical", 1).coefficients(result.coefficients.names).values
    assert np.abs((result.coefficients.values - truth) / result.coefficients.sd).max() < 4
    assert "gaps in turns" in result.diagnostics["budget"]
