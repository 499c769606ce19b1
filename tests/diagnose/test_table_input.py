"""Mistakes of a session on a table are found and called by their names."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.positions import find_readings
from foucault.diagnose.table_input import check_readings, enough_readings
from foucault.errors import FoucaultError
from foucault.models.turntable import TablePlan
from foucault.tables import TableColumns
from make_table_log import DEG, FACES, GRAVITY, Session, plain_up, plan_of

# Twelve directions of an icosahedron and their opposites: outer, middle, inner [deg].
ICO = np.array([[30 * k, a, b] for k, (a, b) in enumerate(
    [(0, -31.72), (0, 211.72), (0, 148.28), (0, 31.72), (58.28, 0), (121.72, 0), (-58.28, 0),
     (238.28, 0), (148.28, 90), (211.72, 90), (31.72, 90), (-31.72, 90)])]) * DEG  # fmt: skip
MEMS = {"gyro_noise": 0.1 * DEG, "accel_noise": 0.01, "accel_bias": (0.3, -0.2, 0.1),
        "gyro_bias": (2 * DEG, -1 * DEG, 0.5 * DEG), "rate": 50.0}  # fmt: skip
RESTS = plan_of(ICO, 0.0, time=5.0)
SPINS = plan_of(ICO, 10 * DEG, turns=1.2)


def session(plan, done=None, **more):
    """Return the readings of a plan when `done` was done instead, and the log."""
    made = Session(plan if done is None else done, **(MEMS | more))
    log = made.log(("angles",))
    return find_readings(log, plan=plan), log


def only(plan, rows, rates=None):
    """Return some positions of a plan, perhaps at other rates."""
    rate = plan.rate[rows] if rates is None else rates
    return TablePlan(plan.name, plan.angles[rows], rate, plan.time[rows])


def checked(plan, done=None, angles=None, logged=True, **more):
    """Check the readings; `angles` are what the log says of the table instead."""
    made = Session(plan if done is None else done, **(MEMS | more))
    log = made.log(("angles",))
    if not logged:
        log = replace(log, table=None)
    elif angles is not None:
        log = replace(log, table=TableColumns(angles(log.table.angles)))
    return check_readings(find_readings(log, plan=plan), plan, log)


def refused(code, *args, **more):
    with pytest.raises(FoucaultError) as problem:
        checked(*args, **more)
    assert problem.value.code == code
    return str(problem.value)


def codes(readings):
    return [f.code for f in readings.findings]


@pytest.mark.parametrize("plan", [RESTS, SPINS], ids=["rests", "spins"])
@pytest.mark.parametrize("logged", [True, False], ids=["angles", "no angles"])
def test_a_session_as_planned_has_no_findings(plan, logged):
    got = checked(plan, logged=logged)
    assert codes(got) == []
    np.testing.assert_allclose(np.cos(got.angles[:, 1:] - ICO[:, 1:]), 1, atol=1e-9)


def test_angles_off_by_degrees_are_the_tables_errors_not_a_mistake():
    rng = np.random.default_rng(4)
    off = TablePlan("", ICO + rng.normal(0, 3 * DEG, ICO.shape), RESTS.rate, RESTS.time)
    got = checked(RESTS, done=off, angles=lambda a: np.round(a / (5 * DEG)) * 5 * DEG)
    assert codes(got) == []


@pytest.mark.parametrize(
    ("angles", "said"),
    [
        (lambda a: a[:, [0, 2, 1]], "outer, inner, middle"),
        (lambda a: a[:, [2, 1, 0]], "inner, middle, outer"),
        (lambda a: a[:, [1, 2, 0]], "inner, outer, middle"),
        (lambda a: a * [1, -1, 1], "outer, -middle, inner"),
        (lambda a: a[:, [0, 2, 1]] * [1, -1, 1], "outer, inner, -middle"),
    ],
    ids=["middle-inner", "outer-inner", "cycle", "sign", "both"],
)
def test_wrong_order_or_sign_of_the_angles_is_named(angles, said):
    words = refused("table.order", RESTS, angles=angles)
    assert f"with {said} as outer, middle and inner angle" in words


@pytest.mark.parametrize(("factor", "likely"), [(np.degrees(1), "deg"), (np.radians(1), "rad")])
def test_wrong_unit_of_the_angles_is_named(factor, likely):
    log = replace(Session(RESTS, **MEMS).log(("angles",)), gyro=None)
    log = replace(log, table=TableColumns(log.table.angles * factor))
    with pytest.raises(FoucaultError) as problem:
        check_readings(find_readings(log), None, log)
    assert problem.value.code == "table.unit"
    assert f'Write unit = "{likely}"' in problem.value.cure
    # In spins the gyros notice it before.
    refused("table.rate_unit", SPINS, angles=lambda a: a * factor)


def test_wrong_order_or_unit_in_the_plan_itself_is_named():
    swapped = TablePlan("", ICO[:, [0, 2, 1]], RESTS.rate, RESTS.time)
    assert "outer, inner, middle" in refused("table.order", swapped, done=RESTS, logged=False)
    scaled = TablePlan("", np.degrees(ICO), RESTS.rate, RESTS.time)
    refused("table.unit", scaled, done=RESTS, logged=False)


@pytest.mark.parametrize("logged", [True, False], ids=["angles", "no angles"])
def test_gravity_read_as_specific_force_is_named(logged):
    made = Session(RESTS, **MEMS)
    log = made.log(("angles",) if logged else ())
    log = replace(log, accel=-log.accel, gyro=None)
    with pytest.raises(FoucaultError, match='reads = "gravity"') as problem:
        check_readings(find_readings(log, plan=RESTS), RESTS, log)
    assert problem.value.code == "table.gravity"


@pytest.mark.parametrize("logged", [True, False], ids=["angles", "no angles"])
def test_an_instrument_mounted_turned_is_named_where_it_matters(logged):
    log = Session(RESTS, **MEMS).log(("angles",) if logged else ())
    turned = {k: getattr(log, k)[:, [1, 2, 0]] for k in ("accel", "gyro")}  # x_b along y_k
    log = replace(log, **turned)
    found = find_readings(log, plan=RESTS)
    with pytest.raises(FoucaultError, match="along inner, outer, middle") as problem:
        check_readings(found, RESTS, log)
    assert problem.value.code == "table.mounting"
    check_readings(found, RESTS, log, angles_matter=False)


def test_directions_that_nothing_explains_are_refused():
    rng = np.random.default_rng(2)
    found, log = session(RESTS)
    odd = rng.normal(size=(12, 3))
    odd *= GRAVITY / np.linalg.norm(odd, axis=1)[:, None]
    with pytest.raises(FoucaultError) as problem:
        check_readings(replace(found, accel=odd), RESTS, log)
    assert problem.value.code == "table.directions"


def test_a_missing_position_is_named_with_its_angles():
    got = checked(RESTS, done=only(RESTS, [k for k in range(12) if k not in (4, 9)]))
    assert codes(got) == ["positions.missing"]
    assert "in 2 of the 12 positions" in got.findings[0].message
    assert "number 5 (outer 120, middle 58.28, inner 0 deg)" in got.findings[0].message
    assert "number 10 (outer 270, middle 211.7, inner 90 deg)" in got.findings[0].message


def test_a_repeated_position_is_named():
    got = checked(RESTS, done=only(RESTS, [0, 1, 2, 3, 4, 5, 6, 7, 3, 8, 9, 10, 11]))
    assert codes(got) == ["positions.repeated"]
    assert "number 4 (outer 90, middle 0, inner 31.72 deg) (reading 9 at" in got.findings[0].message
    assert len(got) == 13


def test_an_extra_position_is_named_and_has_no_angles():
    extra = np.vstack([ICO[:5], [[0, 0, 0]], ICO[5:]])
    made = Session(plan_of(extra, 0.0, time=5.0), **MEMS)
    log = made.log(())
    got = check_readings(find_readings(log, plan=RESTS), RESTS, log)
    assert codes(got) == ["positions.extra"]
    assert "reading 6 at" in got.findings[0].message
    assert np.isnan(got.angles[5]).all()
    np.testing.assert_array_equal(np.delete(got.angles, 5, axis=0), ICO)


def test_another_order_is_told_and_matched():
    order = [7, 3, 0, 11, 5, 1, 9, 2, 10, 4, 8, 6]
    got = checked(RESTS, done=only(RESTS, order), logged=False)
    assert codes(got) == ["positions.order"]
    np.testing.assert_array_equal(got.angles, ICO[order])


@pytest.mark.parametrize("by", ["plan", "table"])
def test_gyros_that_turn_the_other_way_in_all_spins_are_refused(by):
    log = Session(SPINS, **MEMS).log(("angles",) if by == "table" else ())
    log = replace(log, gyro=-log.gyro)
    plan = SPINS if by == "plan" else None
    with pytest.raises(FoucaultError, match="In all 12 spins the gyros turn clockwise") as problem:
        check_readings(find_readings(log, plan=plan), plan, log)
    assert problem.value.code == "spin.sense"
    for words in ('"-" before the outer column', '"-" before each of `columns` in [log.gyro]'):
        assert words in problem.value.cure


def test_spins_in_both_senses_are_used_as_they_were():
    rates = np.where(np.arange(12) % 2, -1, 1) * SPINS.rate
    got = checked(SPINS, done=only(SPINS, np.arange(12), rates), logged=False)
    assert codes(got) == ["spin.sense_some"]
    assert "6 spins have the other sense" in got.findings[0].message
    np.testing.assert_allclose(got.rate, rates)
    want = rates[:, None] * plain_up(ICO) + Session(SPINS, **MEMS).gyro_bias
    np.testing.assert_allclose(got.gyro, want, atol=5e-4)


def test_gyros_alone_can_be_matched_and_checked():
    made = Session(SPINS, **(MEMS | {"gyro_bias": (0, 0, 0)}))
    log = replace(made.log(("angles",)), accel=None)
    got = check_readings(find_readings(log, plan=SPINS), SPINS, log)
    assert codes(got) == []
    with pytest.raises(FoucaultError) as problem:
        flipped = replace(log, gyro=-log.gyro)
        check_readings(find_readings(flipped, plan=SPINS), SPINS, flipped)
    assert problem.value.code == "spin.sense"


def test_a_table_that_turned_at_another_rate_than_planned_is_told():
    slower = only(SPINS, np.arange(12), np.full(12, 7 * DEG))
    got = checked(SPINS, done=replace(slower, time=2 * slower.time))
    assert codes(got) == ["spin.rate_plan"]
    assert "10 deg/s, but the table says 7 deg/s" in got.findings[0].message
    np.testing.assert_allclose(got.rate, 7 * DEG, rtol=1e-9)


def test_fewer_readings_than_coefficients_are_refused():
    found, _ = session(RESTS, done=only(RESTS, [0, 2, 4, 6]))
    enough_readings(found, 4, 0)
    with pytest.raises(FoucaultError, match="4 rests and spins; 9 or more") as problem:
        enough_readings(found, 9, 0)
    assert problem.value.code == "readings.too_few"
    with pytest.raises(FoucaultError, match=r"0 spins; 6 or more .* Hint"):
        enough_readings(found, 4, 6, "Hint.")


def test_six_faces_are_enough_to_tell_the_mistakes():
    faces = plan_of(FACES, 0.0, time=5.0)
    assert codes(checked(faces)) == []
    refused("table.order", faces, angles=lambda a: a[:, [0, 2, 1]])
    assert codes(checked(faces, done=only(faces, [0, 1, 2, 3, 5]))) == ["positions.missing"]
