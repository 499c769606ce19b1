"""Shaken spins, coarse outputs and wrong units: what is read is told, and what is not."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.readings import find_readings
from foucault.tables import Log
from make_table_log import DEG, FACES, GRAVITY, Session, plain_up, plan_of
from refusals import refuses

BOTH = np.concatenate([FACES, FACES])
RATES = np.array([0.0] * 6 + [10 * DEG, -10 * DEG] * 3)
TABLES = [("angles",), ("rate",), ("position",), ("angles", "rate", "position"), ()]
MEMS = {"gyro_noise": 0.1 * DEG, "accel_noise": 0.01, "accel_bias": (0.3, -0.2, 0.1),
        "gyro_bias": (2 * DEG, -1 * DEG, 0.5 * DEG)}  # fmt: skip
SHAKEN = plan_of(BOTH, RATES, time=15.0, turns=2.25)


@pytest.mark.thorough
@pytest.mark.parametrize("table", TABLES, ids="-".join)
@pytest.mark.parametrize("mg", [3, 20])
def test_a_spin_that_shakes_the_accelerometers_is_not_cut(table, mg):
    session = Session(SHAKEN, rate=20.0, **{**MEMS, "accel_noise": 0.003})
    log = session.log(table)
    rng = np.random.default_rng(7)
    spins = np.zeros(len(log.time), bool)
    for (start, end), rate in zip(session.marks, RATES, strict=True):
        spins |= (log.time > start - 1) & (log.time < end + 1) & (rate != 0)
    shake = mg * 1e-3 * GRAVITY * rng.normal(size=log.accel.shape) * spins[:, None]
    got = find_readings(replace(log, accel=log.accel + shake), plan=SHAKEN)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [2] * 6)
    assert "spin.unused" not in [f.code for f in got.findings]
    # The means hold the noise of the shaking, and nothing else: 1440 samples each.
    want = GRAVITY * plain_up(BOTH[6:]) + session.accel_bias
    np.testing.assert_allclose(got.accel[6:], want, atol=5 * mg * 1e-3 * GRAVITY / np.sqrt(1440))


@pytest.mark.parametrize("labelled", [True, False])
def test_a_steady_turn_that_was_not_used_is_told(labelled):
    session = Session(SHAKEN, rate=20.0, **{**MEMS, "accel_noise": 0.003})
    log = session.log(("position",) if labelled else ())
    start, end = session.marks[8]
    inside = (log.time > start) & (log.time < end)
    # An instrument that is loose: it nods by half a radian every few seconds.
    nod = 0.5 * GRAVITY * np.sign(np.sin(2 * np.pi * log.time / 7.0)) * inside
    accel = log.accel + nod[:, None] * [1.0, 0, 0]
    got = find_readings(replace(log, accel=accel), plan=SHAKEN)
    assert got.spin.sum() == 5
    (told,) = [f for f in got.findings if f.code == "spin.unused"]
    assert "by 2.2" in told.message or "by 2.3" in told.message
    assert "the accelerometers change meanwhile" in told.message


def test_only_steady_turns_that_are_no_spins_are_not_called_no_spins():
    time = np.arange(0, 60, 0.05)
    rng = np.random.default_rng(2)
    turned = 20 * DEG * np.clip(time - 10, 0, 40)  # about a horizontal axis, rests before and after
    rate = np.gradient(turned, time)
    gyro = rate[:, None] * [1.0, 0, 0] + 1e-4 * rng.normal(size=(len(time), 3))
    accel = GRAVITY * np.stack([0 * time, np.sin(turned), np.cos(turned)], 1)
    log = Log(time, gyro, accel + 1e-3 * rng.normal(size=accel.shape))
    got = find_readings(log)
    assert len(got) == 2 and not got.spin.any()
    assert [f.code for f in got.findings] == ["spin.unused"]
    with refuses("positions.none", match=r"turn steadily by 2\.2\d turns"):
        find_readings(log, shortest=30.0)


@pytest.mark.parametrize("mg", [2, 4])
def test_outputs_in_coarse_steps_do_not_break_rests(mg):
    step = mg * 1e-3 * GRAVITY
    session = Session(SHAKEN, rate=20.0, **{**MEMS, "accel_noise": 0.003, "gyro_noise": 3e-4})
    log = session.log(())
    accel = log.accel.copy()
    for start, end in session.marks[:6]:  # on the edge between two steps, in all axes
        inside = (log.time > start - 1) & (log.time < end + 1)
        accel[inside] += (np.floor(accel[inside].mean(0) / step) + 0.5) * step
        accel[inside] -= log.accel[inside].mean(axis=0)
    coarse = replace(log, accel=np.round(accel / step) * step)
    got = find_readings(coarse, plan=SHAKEN)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [2] * 6)
    assert (got.time[:6] > 14.4).all()
    assert "position.not_still" not in [f.code for f in got.findings]
    fine = find_readings(log, plan=SHAKEN)  # as the unrounded log has it
    np.testing.assert_allclose(got.time[:6], fine.time[:6], atol=0.6)


def test_gyros_in_a_wrong_unit_are_named_where_no_table_is_logged():
    session = Session(SHAKEN, **MEMS)
    log = session.log(())
    for factor, likely in ((np.degrees(1), '"deg/s"'), (np.radians(1), '"rad/s"')):
        with refuses("spin.rate_unit") as problem:
            find_readings(replace(log, gyro=log.gyro * factor), plan=SHAKEN)
        assert problem.value.cure.startswith(f"Write unit = {likely} in [log.gyro]")
        assert "[log.table]" not in problem.value.cure
    # Where plan and table agree, the gyros are wrong, not the table.
    log = session.log(("angles",))
    with refuses("spin.rate_unit"):
        find_readings(replace(log, gyro=log.gyro * np.degrees(1)), plan=SHAKEN)
