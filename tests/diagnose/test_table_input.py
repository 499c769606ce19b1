"""Mistakes of a session on a table are found and called by their names."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.readings import find_readings
from foucault.errors import FoucaultError
from foucault.guard.table import check_readings, enough_readings, rate_findings
from foucault.models.turntable import TablePlan
from foucault.tables import TableColumns
from make_table_log import DEG, FACES, GRAVITY, Session, plain_up, plan_of
from refusals import refuses
from sessions import codes

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
    with refuses(code) as problem:
        checked(*args, **more)
    return str(problem.value)


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
    with refuses("table.unit") as problem:
        check_readings(find_readings(log), None, log)
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
    with refuses("table.gravity", 'reads = "gravity"'):
        check_readings(find_readings(log, plan=RESTS), RESTS, log)


@pytest.mark.thorough
@pytest.mark.parametrize("logged", [True, False], ids=["angles", "no angles"])
def test_an_instrument_mounted_turned_is_named_where_it_matters(logged):
    log = Session(RESTS, **MEMS).log(("angles",) if logged else ())
    turned = {k: getattr(log, k)[:, [1, 2, 0]] for k in ("accel", "gyro")}  # x_b along y_k
    log = replace(log, **turned)
    found = find_readings(log, plan=RESTS)
    with refuses("table.mounting", "along inner, outer, middle"):
        check_readings(found, RESTS, log)
    check_readings(found, RESTS, log, angles_matter=False)


def test_directions_that_nothing_explains_are_refused():
    rng = np.random.default_rng(2)
    found, log = session(RESTS)
    odd = rng.normal(size=(12, 3))
    odd *= GRAVITY / np.linalg.norm(odd, axis=1)[:, None]
    with refuses("table.directions"):
        check_readings(replace(found, accel=odd), RESTS, log)


def test_a_missing_position_is_named_with_its_angles():
    got = checked(RESTS, done=only(RESTS, [k for k in range(12) if k not in (4, 9)]))
    assert codes(got) == ["positions.missing"]
    assert "in 2 of the 12 positions" in got.findings[0].message
    assert "number 5 (outer 120, middle 58.28, inner 0 deg)" in got.findings[0].message
    assert "number 10 (outer 270, middle 211.7, inner 90 deg)" in got.findings[0].message


def test_a_repeated_position_is_named():
    got = checked(RESTS, done=only(RESTS, [0, 1, 2, 3, 4, 5, 6, 7, 3, 8, 9, 10, 11]))
    assert codes(got) == ["positions.repeated"]
    assert "number 4 (outer 90, middle 0, inner 31.72 deg) (rest 9 (" in got.findings[0].message
    assert len(got) == 13


@pytest.mark.parametrize("matter", [True, False])
def test_an_extra_position_is_named_and_left_out_where_its_angles_are_needed(matter):
    extra = np.vstack([ICO[:5], [[0, 0, 0]], ICO[5:]])
    made = Session(plan_of(extra, 0.0, time=5.0), **MEMS)
    log = made.log(())
    got = check_readings(find_readings(log, plan=RESTS), RESTS, log, angles_matter=matter)
    assert codes(got) == ["positions.left_out" if matter else "positions.extra"]
    assert "plan: rest 6 (" in got.findings[0].message
    if not matter:
        assert np.isnan(got.angles[5]).all()
        got = got[np.arange(13) != 5]
    np.testing.assert_array_equal(got.angles, ICO)


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
    with refuses("spin.sense", "In all 12 spins the gyros turn clockwise") as problem:
        check_readings(find_readings(log, plan=plan), plan, log)
    assert '"-" before each of `columns` in [log.gyro]' in problem.value.cure
    assert ('"-" before the outer column' in problem.value.cure) == (by == "table")
    assert f"the other way than the {'plan' if by == 'plan' else 'outer column'}" in str(
        problem.value
    )


def test_spins_in_both_senses_are_used_as_they_were():
    rates = np.where(np.arange(12) % 2, -1, 1) * SPINS.rate
    got = checked(SPINS, done=only(SPINS, np.arange(12), rates), logged=False)
    assert codes(got) == ["spin.sense_some"]
    assert (
        "6 of 12 spins have the other sense than the plan says: spin 2 (" in got.findings[0].message
    )
    np.testing.assert_allclose(got.rate, rates)
    want = rates[:, None] * plain_up(ICO) + Session(SPINS, **MEMS).gyro_bias
    np.testing.assert_allclose(got.gyro, want, atol=5e-4)


@pytest.mark.parametrize("matter", [True, False])
def test_spins_in_both_senses_instead_of_one_are_matched_by_position(matter):
    angles, rates = np.repeat(ICO, 2, axis=0), np.tile([10 * DEG, -10 * DEG], 12)
    log = Session(plan_of(angles, rates, turns=1.2), **MEMS).log(())
    got = check_readings(find_readings(log, plan=SPINS), SPINS, log, angles_matter=matter)
    assert codes(got) == ["spin.sense_some"]
    assert "12 of 24 spins" in got.findings[0].message
    np.testing.assert_allclose(got.rate, rates)
    np.testing.assert_array_equal(got.angles, angles)


def test_a_repeated_rest_has_the_angles_of_the_plan_where_none_are_logged():
    rows = [*range(12), 2]
    got = checked(RESTS, done=only(RESTS, rows), logged=False)
    assert codes(got) == ["positions.repeated"]
    np.testing.assert_array_equal(got.angles, ICO[rows])


@pytest.mark.parametrize("logged", [True, False], ids=["angles", "no angles"])
def test_other_positions_than_planned_are_no_mistake(logged):
    rng = np.random.default_rng(3)
    own = rng.uniform(-np.pi, np.pi, (16, 3)) * [0, 0.5, 1]
    log = Session(plan_of(own, 0.0, time=5.0), **MEMS).log(("angles",) if logged else ())
    found = find_readings(log, plan=RESTS)
    free = check_readings(found, RESTS, log, angles_matter=False)
    assert codes(free) == ["positions.other"]
    assert "needs no angles" in free.findings[0].message
    if not logged:
        assert np.isnan(free.angles).all()
        with refuses("table.directions"):
            check_readings(found, RESTS, log)
        return
    used = check_readings(found, RESTS, log)
    assert codes(used) == ["positions.other"]
    assert "angles of the log were used" in used.findings[0].message
    off = np.angle(np.exp(1j * (used.angles[:, 1:] - own[:, 1:])))
    np.testing.assert_allclose(off, 0, atol=1e-5)


def test_logged_angles_that_nobody_needs_and_that_fit_nothing_are_not_used():
    log = Session(RESTS, **MEMS).log(("angles",))
    rng = np.random.default_rng(5)
    odd = rng.uniform(-3, 3, (1, 3)) * (np.floor(log.time / 9)[:, None] % [3, 5, 7])
    wrong = replace(log, table=TableColumns(np.where(np.arange(3) == 0, log.table.angles, 0 * odd)))
    found = find_readings(log, plan=RESTS)
    found = replace(found, angles=rng.uniform(-3, 3, found.angles.shape))
    got = check_readings(found, RESTS, wrong, angles_matter=False)
    assert codes(got) == ["table.unused"]
    np.testing.assert_array_equal(got.angles[:, 1:], np.full((12, 2), np.nan))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("axis", "degrees", "logged"),
    [(0, 90, True), (1, 90, False), (2, 90, True), (0, 180, False), (1, 180, True),
     (2, 180, False)],
)  # fmt: skip
def test_an_instrument_mounted_turned_is_nothing_odd_where_angles_do_not_matter(
    axis, degrees, logged
):
    from scipy.spatial.transform import Rotation

    both = TablePlan("", np.vstack([ICO, ICO]), np.r_[RESTS.rate, SPINS.rate], np.r_[
        RESTS.time, SPINS.time])  # fmt: skip
    rows = [k for k in range(24) if k != 5]  # one is missing: no one-to-one order
    log = Session(only(both, rows), **MEMS).log(("angles",) if logged else ())
    C = Rotation.from_rotvec(degrees * DEG * np.eye(3)[axis]).as_matrix()
    log = replace(log, accel=log.accel @ C.T, gyro=log.gyro @ C.T)
    got = check_readings(find_readings(log, plan=both), both, log, angles_matter=False)
    assert codes(got) == ["positions.missing"]
    assert "in 1 of the 24" in got.findings[0].message
    np.testing.assert_allclose(np.cos(got.angles[:, 1:] - both.angles[rows, 1:]), 1, atol=1e-9)


def test_another_order_and_another_mounting_together_are_told():
    order = [7, 3, 0, 11, 5, 1, 9, 2, 10, 4, 8, 6]
    log = Session(only(RESTS, order), **MEMS).log(())
    log = replace(log, **{k: getattr(log, k)[:, [1, 2, 0]] for k in ("accel", "gyro")})
    got = check_readings(find_readings(log, plan=RESTS), RESTS, log, angles_matter=False)
    assert codes(got) == ["positions.order"]


def test_a_wrong_sign_of_the_outer_column_is_told_from_reversed_gyros():
    log = Session(SPINS, **MEMS).log(("angles",))
    table = TableColumns(log.table.angles * [-1, 1, 1])
    words = []
    for wrong in (replace(log, table=table), replace(log, gyro=-log.gyro)):
        with refuses("spin.sense", "the other way than the outer column") as problem:
            check_readings(find_readings(wrong, plan=SPINS), SPINS, wrong)
        words.append((str(problem.value), problem.value.cure))
    assert "plan says the same as the gyros" in words[0][0]
    assert words[0][1].startswith('Probably the table counts the wrong way round: write "-"')
    assert "plan says the same as the log" in words[1][0]
    assert words[1][1].startswith("Probably the gyros are reversed")


def test_a_plan_in_the_wrong_order_is_not_blamed_on_columns_that_are_not_there():
    swapped = TablePlan("", ICO[:, [0, 2, 1]], RESTS.rate, RESTS.time)
    with refuses("table.order") as problem:
        checked(swapped, done=RESTS, logged=False)
    assert "[log.table]" not in problem.value.cure
    assert "`plan` or `positions`" in problem.value.cure


def test_a_log_on_disk_tells_by_its_description_what_it_has_of_the_table():
    from foucault.logs import LogDescription

    found, _ = session(SPINS)
    for table, said in (
        (None, "the plan"),
        ({"rate": "r", "rate_unit": "rad/s"}, "the outer column"),
        ({"columns": ["o", "", ""], "unit": "rad"}, "the outer column"),
    ):
        described = LogDescription(file="log.csv", table=table)
        wrong = replace(found, gyro=-found.gyro)
        with refuses("spin.sense", match=f"the other way than {said}"):
            check_readings(wrong, SPINS, described)


def test_gyros_alone_can_be_matched_and_checked():
    made = Session(SPINS, **(MEMS | {"gyro_bias": (0, 0, 0)}))
    log = replace(made.log(("angles",)), accel=None)
    got = check_readings(find_readings(log, plan=SPINS), SPINS, log)
    assert codes(got) == []
    with refuses("spin.sense"):
        flipped = replace(log, gyro=-log.gyro)
        check_readings(find_readings(flipped, plan=SPINS), SPINS, flipped)


def test_a_table_that_turned_at_another_rate_than_planned_is_told():
    slower = only(SPINS, np.arange(12), np.full(12, 7 * DEG))
    got = checked(SPINS, done=replace(slower, time=2 * slower.time))
    assert codes(got) == ["spin.rate_plan"]
    assert "10 deg/s, but the table says 7 deg/s" in got.findings[0].message
    np.testing.assert_allclose(got.rate, 7 * DEG, rtol=1e-9)


def test_a_declared_rate_that_is_far_off_is_the_clock_or_the_table():
    """However far: stamps that are a third too long make every gyro scale factor wrong."""
    planned = np.full(3, 10 * DEG)
    for factor in (0.7, 0.99, 1.01, 1.4):
        assert [f.code for f in rate_findings(factor * planned, planned, 1e-4)] == [
            "spin.rate_clock"
        ]
    assert [f.code for f in rate_findings(0.7 * planned, planned, None)] == ["spin.rate_plan"]
    assert rate_findings(0.99 * planned, planned, None) == []


def test_fewer_readings_than_coefficients_are_refused():
    found, _ = session(RESTS, done=only(RESTS, [0, 2, 4, 6]))
    enough_readings(found, 4, 0)
    with refuses("readings.too_few", "4 rests and spins; 9 or more") as problem:
        enough_readings(found, 9, 0)
    assert "prior" not in problem.value.cure
    with pytest.raises(FoucaultError, match=r"0 spins; 6 or more"):
        enough_readings(found, 4, 6)


def test_six_faces_are_enough_to_tell_the_mistakes():
    faces = plan_of(FACES, 0.0, time=5.0)
    assert codes(checked(faces)) == []
    refused("table.order", faces, angles=lambda a: a[:, [0, 2, 1]])
    assert codes(checked(faces, done=only(faces, [0, 1, 2, 3, 5]))) == ["positions.missing"]


def test_rests_each_followed_by_its_spin_are_in_order():
    plan = TablePlan(
        "both", np.concatenate([ICO, ICO]), np.repeat([0.0, 10 * DEG], 12),
        np.concatenate([RESTS.time, SPINS.time]),
    )  # fmt: skip
    each = np.ravel(np.column_stack([np.arange(12), 12 + np.arange(12)]))
    got = checked(plan, done=only(plan, each))
    assert len(got) == 24
    assert "positions.order" not in codes(got)
    shuffled = np.r_[[3, 1, 2, 0], 4:24]
    assert "positions.order" in codes(checked(plan, done=only(plan, shuffled)))
