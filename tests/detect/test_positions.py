"""Readings are the means over whole turns and rests that an independent table made."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from foucault.detect import readings
from foucault.detect.means import means
from foucault.detect.readings import find_readings, stream_readings
from foucault.logs import LogDescription, write
from foucault.logs.own import write_blocks
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.tables import Log, TableColumns
from make_table_log import DEG, EARTH, FACES, GRAVITY, Session, plain_up, plan_of
from refusals import refuses

HOUR = np.degrees(1.0) * 3600  # deg/h in 1 rad/s
BOTH = np.concatenate([FACES, FACES])
RATES = np.array([0.0] * 6 + [10 * DEG, -10 * DEG] * 3)
TABLES = [("angles",), ("rate",), ("position",), ("angles", "rate", "position"), ()]
MEMS = {"gyro_noise": 0.1 * DEG, "accel_noise": 0.01, "accel_bias": (0.3, -0.2, 0.1),
        "gyro_bias": (2 * DEG, -1 * DEG, 0.5 * DEG)}  # fmt: skip


def vertical(rate, latitude=45 * DEG):
    """Mean rate over whole turns."""
    return rate + EARTH * np.sin(latitude)


@pytest.mark.thorough
@pytest.mark.parametrize("table", TABLES, ids="-".join)
@pytest.mark.parametrize("increments", [False, True], ids=["rates", "increments"])
@pytest.mark.parametrize("errors", [{}, MEMS], ids=["perfect", "mems"])
def test_rests_and_spins_are_found_in_every_kind_of_log(table, increments, errors):
    session = Session(plan_of(BOTH, RATES, turns=2.3), 50.0, increments=increments, **errors)
    got = find_readings(session.log(table), plan=session.plan)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [2] * 6)
    np.testing.assert_allclose(got.rate, RATES, rtol=1e-6)
    wrapped = np.angle(np.exp(1j * (got.angles[:, 1:] - BOTH[:, 1:])))
    np.testing.assert_allclose(wrapped, 0, atol=1e-5)
    start, end = np.array(session.marks).T
    pause = np.where(RATES == 0, session.settle, 0.0)  # at rest already, if the table is silent
    early = 0.1 if errors else 0.02  # the end of a ramp may hide in the noise
    assert (got.start > start - pause - early).all()
    assert (got.start + got.time < end + early).all()
    assert (got.time[:6] > 9.4).all()  # at most a cell is lost at either end
    # Means of the true signals plus biases; noise at 6 sd.
    sd = np.sqrt(np.trace(got.gyro_cov, axis1=1, axis2=2))
    spin = slice(6, 12)
    want = vertical(RATES[spin])[:, None] * plain_up(BOTH[spin]) + session.gyro_bias
    off = np.linalg.norm(got.gyro[spin] - want, axis=1)
    assert (off < 6 * sd[spin] + 1e-3 / HOUR).all()
    off = np.linalg.norm(got.accel - GRAVITY * plain_up(BOTH) - session.accel_bias, axis=1)
    sd = np.sqrt(np.trace(got.accel_cov, axis1=1, axis2=2))
    assert (off < 6 * sd + 1e-5).all()


@pytest.mark.thorough
@pytest.mark.parametrize("table", TABLES, ids="-".join)
@pytest.mark.parametrize("increments", [False, True], ids=["rates", "increments"])
def test_nothing_of_the_horizontal_earth_rate_is_left(table, increments):
    # Five turns and a quarter: taken whole they would leave up to 0.46 deg/h.
    session = Session(plan_of(FACES, 10 * DEG, turns=5.25), 50.0, increments=increments)
    log = session.log(table)
    got = find_readings(log, plan=session.plan)
    np.testing.assert_array_equal(got.turns, 5)
    left = got.gyro - vertical(got.rate)[:, None] * plain_up(FACES)
    assert np.abs(left).max() * HOUR < 1e-3
    start, end = session.marks[0]
    inside = (log.time >= start) & (log.time <= end)
    whole = log.gyro[inside].mean(axis=0) - vertical(10 * DEG) * plain_up(FACES)[0]
    assert np.linalg.norm(whole) * HOUR > 0.1  # the test can fail


@pytest.mark.thorough
@pytest.mark.parametrize("table", TABLES, ids="-".join)
@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_a_spin_of_exactly_one_turn_is_not_lost(table, rate):
    session = Session(plan_of(BOTH, RATES, turns=1), rate=rate)
    got = find_readings(session.log(table), plan=session.plan)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [1] * 6)
    left = got.gyro[6:] - vertical(got.rate[6:])[:, None] * plain_up(BOTH[6:])
    assert np.abs(left).max() * HOUR < 0.3  # part of a sample of the ramp


def test_angle_that_wraps_gives_the_same_turns():
    session = Session(plan_of(FACES, -10 * DEG, turns=3.4))
    log = session.log(("angles",))
    smooth = find_readings(log)
    angles = log.table.angles.copy()
    angles[:, 0] = np.mod(angles[:, 0], 2 * np.pi)
    wrapped = find_readings(replace(log, table=TableColumns(angles)))
    np.testing.assert_array_equal(wrapped.turns, 3)
    np.testing.assert_allclose(wrapped.gyro, smooth.gyro, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(wrapped.rate, -10 * DEG, rtol=1e-9)
    # The outer angle at the start is what the table said then.
    at = np.interp(wrapped.start, log.time, log.table.angles[:, 0])
    np.testing.assert_allclose(np.exp(1j * wrapped.angles[:, 0]), np.exp(1j * at), atol=1e-9)
    assert (np.abs(wrapped.angles[:, 0]) < 2 * np.pi).all()


def test_the_rate_is_that_of_the_angle_not_of_the_command():
    session = Session(plan_of(FACES, 10.01 * DEG, turns=2.3))
    commanded = plan_of(FACES, 10 * DEG, turns=2.3)
    got = find_readings(session.log(("angles",)), plan=commanded)
    np.testing.assert_allclose(got.rate, 10.01 * DEG, rtol=1e-9)
    got = find_readings(session.log(()), plan=commanded)
    np.testing.assert_allclose(got.rate, 10 * DEG, rtol=1e-15)


def test_without_any_command_the_gyros_give_rate_and_sense():
    session = Session(plan_of(BOTH, RATES, turns=2.3))
    got = find_readings(session.log(()), spin_rate=10 * DEG)
    np.testing.assert_allclose(got.rate, RATES, rtol=1e-15)
    assert np.isnan(got.angles).all()
    got = find_readings(session.log(()))
    # |w| holds the vertical Earth rate, 5e-5 rad/s of 0.17; what rests feel of it is not exact.
    np.testing.assert_allclose(got.rate, RATES, rtol=8e-4)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [2] * 6)


def test_accelerometers_alone_are_enough_for_rests():
    session = Session(plan_of(FACES, 0.0), accel_noise=0.01)
    log = replace(session.log(()), gyro=None, table=None)
    got = find_readings(log, plan=session.plan)
    assert got.gyro is None
    np.testing.assert_array_equal(got.angles, FACES)
    np.testing.assert_allclose(got.accel, GRAVITY * plain_up(FACES), atol=6 * 0.01 / 30)


def test_a_log_without_moves_is_one_rest():
    session = Session(plan_of(FACES[:1], 0.0, time=30.0), gyro_noise=1e-3, accel_noise=1e-2)
    got = find_readings(session.log(()))
    assert len(got) == 1
    assert got.time[0] > 30.0


def test_samples_on_the_edge_count_with_their_part():
    # Straight lines are integrated exactly, also between samples; so are steps of increments.
    time = np.arange(50) * 0.1
    line = np.outer(time, [1.0, -2.0, 0.5])
    window = np.array([[0.517, 3.333], [-0.05, 4.95]])
    got, none = means(lambda: iter([Log(time, None, line)]), window, 0.1)
    assert none is None
    middle = window.mean(axis=1)[:, None] * [1.0, -2.0, 0.5]
    np.testing.assert_allclose(got[0], middle[0], rtol=1e-14)
    np.testing.assert_allclose(got[1], line.mean(axis=0), rtol=1e-3)
    steps = Log(time, line, None, "increment")
    _, got = means(lambda: iter([steps[:17], steps[17:30], steps[30:]]), window, 0.1)
    weight = [max(0, min(t, 3.333) - max(t - 0.1, 0.517)) for t in time]
    np.testing.assert_allclose(got[0], weight @ line / 2.816, rtol=1e-12)


def test_blocks_of_any_length_give_the_same_means(monkeypatch):
    session = Session(plan_of(BOTH, RATES, turns=1.6), rate=40.0, **MEMS)
    for table in (("position",), ("rate",)):
        log = session.log(table)
        whole = find_readings(log, plan=session.plan)
        monkeypatch.setattr(readings, "BLOCK", 333)
        parts = find_readings(log, plan=session.plan)
        monkeypatch.undo()
        for name in ("accel", "gyro", "rate", "start", "time", "accel_cov", "gyro_cov"):
            np.testing.assert_allclose(
                getattr(parts, name), getattr(whole, name), rtol=1e-10, err_msg=name
            )


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("increments", [False, True], ids=["rates", "increments"])
def test_a_log_on_disk_gives_what_it_gives_in_memory(tmp_path, suffix, increments, monkeypatch):
    from foucault.logs import follow

    monkeypatch.setattr(follow, "BLOCK_ROWS", 1000)
    session = Session(plan_of(BOTH, RATES, turns=1.6), rate=40.0, increments=increments, **MEMS)
    log = session.log(("angles", "position"))
    write(log, tmp_path / f"log{suffix}")
    seen = []
    got = stream_readings(
        LogDescription(file=f"log{suffix}"), tmp_path, plan=session.plan, progress=seen.append
    )
    want = find_readings(log, plan=session.plan)
    for name in ("accel", "gyro", "rate", "angles", "start", "time", "turns"):
        np.testing.assert_allclose(getattr(got, name), getattr(want, name), rtol=1e-10)
    np.testing.assert_allclose(got.gyro_cov, want.gyro_cov, rtol=1e-9)
    assert seen == sorted(seen) and seen[-1] <= 1.0


@pytest.mark.thorough
def test_memory_stays_flat_however_long_the_log(tmp_path):
    log = Session(plan_of(FACES, 0.0, time=20.0), rate=500.0).log(("position",))
    once = log.duration + log.interval

    def peak(repeats):
        file = tmp_path / f"log{repeats}.parquet"
        write_blocks((replace(log, time=log.time + k * once) for k in range(repeats)), file)
        tracemalloc.start()  # of arrays; that of pyarrow is tested with the reader
        found = stream_readings(LogDescription(file=file.name), tmp_path)
        memory = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert len(found) == 6 * repeats
        return memory

    # A part of it is always held; three times the log does not take three times that.
    assert peak(9) < 1.4 * peak(3)


def test_rows_that_are_means_are_readings():
    session = Session(plan_of(BOTH, RATES, turns=3), **MEMS)
    log = session.log(averaged=True)
    got = find_readings(log, plan=session.plan)
    np.testing.assert_array_equal(got.rate, RATES)
    np.testing.assert_array_equal(got.turns, [0] * 6 + [3] * 6)
    np.testing.assert_array_equal(got.gyro, log.gyro)
    np.testing.assert_array_equal(got.angles, BOTH)
    assert [f.code for f in got.findings] == ["readings.noise_unknown"]
    blind = find_readings(replace(log, table=None), plan=session.plan)  # the gyros tell
    np.testing.assert_array_equal(blind.rate, RATES)
    np.testing.assert_array_equal(blind.turns, got.turns)
    np.testing.assert_array_equal(blind.angles, BOTH)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_means_on_disk_are_readings_too(tmp_path, suffix):
    session = Session(plan_of(BOTH, RATES, turns=3), **MEMS)
    log = session.log(averaged=True)
    write(log, tmp_path / f"means{suffix}")
    got = stream_readings(LogDescription(file=f"means{suffix}"), tmp_path, plan=session.plan)
    np.testing.assert_array_equal(got.accel, log.accel)
    np.testing.assert_array_equal(got.rate, RATES)


def test_means_over_parts_of_turns_are_told():
    session = Session(plan_of(FACES, 10 * DEG, turns=5.25))
    got = find_readings(session.log(averaged=True))
    (told,) = [f for f in got.findings if f.code == "spin.not_whole"]
    assert "all 6 (5.25 to 5.25 turns)" in told.message
    assert "0.45 deg/h" in told.message
    with refuses("spin.short"):
        find_readings(Session(plan_of(FACES, 10 * DEG, turns=0.7)).log(averaged=True))


def test_every_mean_over_parts_of_turns_is_listed_by_its_number():
    session = Session(plan_of(BOTH, RATES, turns=5.0))
    log = session.log(averaged=True)
    time = log.averaged.copy()
    time[[7, 9]] *= 1.05
    got = find_readings(replace(log, averaged=time))
    (told,) = [f for f in got.findings if f.code == "spin.not_whole"]
    assert "whole turns: 2 (5.25 turns), 4 (5.25 turns)." in told.message  # after six rests


def test_declared_noise_is_used_as_it_is():
    session = Session(plan_of(BOTH, RATES, turns=1.6), **MEMS)
    noise = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=2e-4))
    got = find_readings(session.log(), noise=noise)
    assert got.declared
    np.testing.assert_allclose(got.accel_cov[:, 0, 0], 1e-6 / got.time, rtol=1e-12)
    np.testing.assert_allclose(got.gyro_cov[:, 2, 2], 4e-8 / got.time, rtol=1e-12)


def test_noise_is_measured_apart_in_rests_and_spins():
    # A leaning table: 0.17 m/s^2 go round in the accelerometers and are no noise.
    session = Session(plan_of(BOTH, RATES, time=60.0, turns=3.2), plumb=1 * DEG, **MEMS)
    log = session.log()
    got = find_readings(log)
    variance = np.array([0.01**2, (0.1 * DEG) ** 2]) / session.rate
    # 4,300 cells in spins, 1,400 at rest: 5 % is over two sd of a measured variance.
    for cov, true in ((got.accel_cov, variance[0]), (got.gyro_cov, variance[1])):
        for which in (got.spin, ~got.spin):
            measured = cov[which][:, range(3), range(3)] * got.time[which][:, None] / true
            np.testing.assert_allclose(measured.mean(), 1, atol=0.06)
            np.testing.assert_allclose(measured, 1, atol=0.15)
    assert not got.declared
    # More noise in the spins alone shows in the spins alone.
    rng = np.random.default_rng(8)
    turning = np.abs(np.gradient(log.table.angles[:, 0], log.time)) > 9 * DEG
    more = log.gyro + 0.3 * DEG * rng.normal(size=log.gyro.shape) * turning[:, None]
    shaken = find_readings(replace(log, gyro=more))
    ratio = shaken.gyro_cov[:, 0, 0] / got.gyro_cov[:, 0, 0]
    np.testing.assert_allclose(ratio[:6], 1, atol=0.05)
    np.testing.assert_allclose(ratio[6:], 10, rtol=0.1)


def test_steps_of_the_output_that_noise_does_not_blur_stay_in_the_mean():
    session = Session(plan_of(FACES, 0.0), gyro_noise=1e-5, accel_noise=1e-5)
    log = session.log()
    coarse = replace(log, accel=np.round(log.accel / 1e-2) * 1e-2)
    jumpy = coarse.accel.copy()
    jumpy[::50, :] += 1e-2  # now and then a step, so that the step can be seen
    got = find_readings(replace(log, accel=jumpy))
    # Four faces have x level and share its rounding; up and down have their own.
    share = np.where(np.abs(got.accel[:, 0]) > 5, 1, 4)
    sd = np.sqrt(got.accel_cov[:, 0, 0])
    np.testing.assert_allclose(sd, 1e-2 * np.sqrt(share / 12), rtol=0.2)


def test_a_labelled_position_that_moves_is_told_and_cut():
    session = Session(plan_of(FACES, 0.0), settle=0.0, accel_noise=1e-3, gyro_noise=1e-3)
    log = session.log(("position",))
    position = log.table.position.copy()
    late, (start, end) = 3, session.marks[3]
    position[(log.time > start - 4) & (log.time < start)] = late
    lost, (a, b) = 5, session.marks[5]
    position[(log.time >= a) & (log.time < b)] = -1
    position[(log.time > a - 3) & (log.time < a - 0.5)] = lost
    got = find_readings(replace(log, table=TableColumns(log.table.angles, None, position)))
    assert len(got) == 5
    assert got.start[late] > start - 0.02
    assert got.start[late] + got.time[late] < end + 0.02
    told = {f.message.split(" (")[0]: f.message for f in got.findings}
    assert [f.code for f in got.findings] == ["position.moving"] * 2
    assert "only" in told["Position 3"] and "none of it" in told["Position 5"]


@pytest.mark.parametrize("how", ["tilts by", "turns at 0.04"])
def test_a_rest_that_is_not_still_is_named(how):
    session = Session(plan_of(FACES, 0.0, time=20.0), accel_noise=1e-3, gyro_noise=1e-4)
    log = session.log()
    start, end = session.marks[4]
    since = np.clip(log.time - start, 0, 20)
    inside = (log.time > start) & (log.time < end)
    gyro, accel = log.gyro.copy(), log.accel.copy()
    if how == "tilts by":  # settles by a minute of arc; up is along -x there
        accel[:, 1] += GRAVITY * 4e-4 * np.exp(-since / 10) * inside
    else:  # about the vertical: gravity does not tell
        gyro[:, 0] -= 0.04 * DEG * inside
    got = find_readings(replace(log, gyro=gyro, accel=accel, table=None), spin_rate=10 * DEG)
    assert len(got) == 6
    (told,) = got.findings
    assert told.code == "position.not_still"
    assert told.message.startswith("Rest 5 ")
    assert how in told.message


def test_a_position_that_turns_on_slowly_is_no_rest_but_is_named():
    session = Session(plan_of(FACES, 0.0, time=20.0), accel_noise=1e-3, gyro_noise=1e-4)
    log = session.log()
    start, end = session.marks[4]
    gyro = log.gyro.copy()
    gyro[(log.time > start) & (log.time < end), 0] -= 0.3 * DEG
    got = find_readings(replace(log, gyro=gyro, table=None))
    (told,) = got.findings
    assert told.code == "rest.moving"
    assert "110.2-130.7 s turns at 0.3 deg/s" in told.message or "at 0.3 deg/s" in told.message
    assert not ((got.start > start) & (got.start < end)).any()


def test_parts_of_turns_of_numbered_spins_are_told():
    session = Session(plan_of(FACES, 10 * DEG, turns=2.4))
    got = find_readings(session.log(("position", "angles")))
    np.testing.assert_array_equal(got.turns, 2)
    (told,) = got.findings
    assert told.code == "spin.cut"
    assert "all 6 spins" in told.message and "0.40 of a turn" in told.message


@pytest.mark.parametrize("table", [("position", "angles"), ("position",), ("angles",), ()])
def test_a_spin_of_less_than_a_turn_is_refused(table):
    session = Session(plan_of(FACES[:3], 10 * DEG, turns=0.8))
    with refuses("spin.short", match=r"0\.[78]\d* of a turn"):
        find_readings(session.log(table), plan=session.plan)


@pytest.mark.parametrize("table", [("position", "angles"), ("position",)])
def test_both_senses_in_one_position_are_refused(table):
    angles, rates = np.repeat(FACES[:3], 2, axis=0), np.tile([10 * DEG, -10 * DEG], 3)
    session = Session(plan_of(angles, rates, turns=1.3))
    log = session.log(table)
    position = log.table.position.copy()
    (start, _), (_, end) = session.marks[2:4]
    position[(log.time >= start) & (log.time < end)] = 2
    mixed = replace(log, table=TableColumns(log.table.angles, None, position))
    with refuses("spin.both_senses", match=r"Position 2 .* both senses"):
        find_readings(mixed)
    assert len(find_readings(log)) == 6  # numbered apart they are two


@pytest.mark.parametrize(
    ("factor", "likely"), [(np.degrees(1), 'unit = "deg"'), (np.radians(1), 'unit = "rad"')]
)
def test_a_wrong_unit_of_the_outer_angle_is_named(factor, likely):
    session = Session(plan_of(BOTH, RATES, turns=1.3), **MEMS)
    log = session.log(("angles",))
    with refuses("table.rate_unit") as problem:
        find_readings(replace(log, table=TableColumns(log.table.angles * factor)))
    assert likely in problem.value.cure
    with refuses("table.rate_differs"):
        find_readings(replace(log, table=TableColumns(log.table.angles * 1.5)))


def test_another_rate_than_commanded_is_refused():
    session = Session(plan_of(BOTH, RATES, turns=1.3))
    with refuses("spin.rate", "20 deg/s, but the gyros measure 10"):
        find_readings(session.log(()), spin_rate=20 * DEG)
    with refuses("spin.rate"):
        find_readings(replace(session.log(averaged=True), table=None), spin_rate=20 * DEG)


def test_a_log_that_never_rests_is_refused():
    rng = np.random.default_rng(1)
    time = np.arange(2000) / 100
    shaken = rng.normal(0, 1, (2, 2000, 3)) * (1 + 10 * np.abs(np.sin(time)))[:, None]
    with refuses("positions.none"):
        find_readings(Log(time, shaken[0], shaken[1]))


@pytest.mark.parametrize("labelled", [True, False], ids=["labels", "nothing"])
def test_moves_that_nobody_logged_are_no_lost_data(labelled):
    session = Session(plan_of(FACES, 0.0, time=10.0), accel_noise=1e-3, gyro_noise=1e-4, rate=20.0)
    log = session.log(("position",))
    inside = log.table.position >= 0
    label = log.table.position if labelled else np.full(len(log), -1)

    def found(keep):
        table = TableColumns(log.table.angles[keep], None, label[keep])
        kept = replace(
            log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep],
            table=table if labelled else None,
        )  # fmt: skip
        return find_readings(kept).findings

    (told,) = found(inside)
    assert told.code == "positions.unlogged"
    assert "5 gaps, all between one position and the next" in told.message
    start, _ = session.marks[2]
    lost = inside & ~((log.time > start + 4) & (log.time < start + 5))
    assert "positions.unlogged" not in [f.code for f in found(lost)]
    # Rows that are missing have not moved.
    assert "position.moving" not in [f.code for f in found(lost)]
