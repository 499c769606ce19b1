"""A reading that stands alone neither cuts a rest nor enters its mean; it is counted and named."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.noise import resolution, spike_sizes, without_spikes
from foucault.detect.readings import find_readings
from foucault.detect.stretches import find_rests, split
from foucault.diagnose.allan import measure_log
from foucault.models.imu import ImuModel
from foucault.models.noise import grade
from foucault.simulate.hand_rotated import simulate
from foucault.tables import IndexedLog, Log
from make_session import SITE, short_plan
from make_table_log import FACES, Session, plan_of
from sessions import Case, codes, made, solved

SAMPLES = 20_000


def static(seed=1, gyro=2e-3, accel=2e-2):
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, SAMPLES, 3))
    return Log(
        np.arange(SAMPLES) / 100, gyro * noise[0] + 0.01, accel * noise[1] + [0.0, 0.0, 9.81]
    )


def spiked(log):
    log.gyro[7777, 1] += 20 * 2e-3
    return log


def emptied(log):
    log.gyro[0] = log.accel[0] = 0.0
    return log


@pytest.mark.parametrize("damage", [spiked, emptied])
def test_a_log_with_one_spike_is_at_rest_as_a_whole(damage):
    log = damage(static())
    rests = find_rests(without_spikes(log))
    assert len(rests) == 1
    assert rests.last[0] - rests.first[0] > 0.99 * SAMPLES
    got = measure_log(log, axes=("gyro.x",))
    assert (got.start, got.end) == (log.time[0], log.time[-1])
    assert [f.code for f in got.findings if f.severity == "warning"] == ["log.spikes"]
    clean = measure_log(static(), axes=("gyro.x",)).channels["gyro.x"]
    np.testing.assert_allclose(got.channels["gyro.x"].deviation[:6], clean.deviation[:6], rtol=1e-3)


def test_spikes_are_counted_named_and_replaced():
    log = static()
    log.accel[[300, 9000, 9001], 2] += 1.0
    log.gyro[300, 0] -= 0.1
    found = without_spikes(log)
    assert [f.code for f in found.findings] == ["log.spikes"]
    words = found.findings[0].message
    assert words.startswith(
        "Spikes, readings that stand alone far from those before and after: 3 (accel.z, gyro.x), "
        "the first at 3 s (gyro.x, "
    )
    assert words.endswith("They were replaced by what is around them.")
    assert np.abs(found.accel[:, 2] - 9.81).max() < 0.12
    untouched = np.ones(SAMPLES, bool)
    untouched[[300, 9000, 9001]] = False
    assert (found.accel[untouched] == log.accel[untouched]).all()


@pytest.mark.parametrize("kind", ["normal", "coarse", "seldom", "still", "bend"])
def test_noise_steps_and_smooth_motion_are_no_spikes(kind):
    rng = np.random.default_rng(2)
    x = {
        "normal": rng.standard_normal((50_000, 3)),
        "coarse": np.round(0.3 * rng.standard_normal((50_000, 3))),
        "seldom": np.where(rng.random((50_000, 3)) < 0.01, 1.0, 0.0),
        "still": np.zeros((500, 3)),
        "bend": np.sin(np.outer(np.arange(5000), [0.01, 0.1, 0.5])) + 5,
    }[kind]
    assert not spike_sizes(x).any()


def test_a_rare_reading_of_noise_rounded_to_its_size_is_no_spike():
    rng = np.random.default_rng(6)
    x = np.round(rng.standard_normal((5000, 1)))
    calm = np.clip(x[2000:2041], -1, 1)
    x[2000:2041] = calm  # nine in ten lie within one step there, by chance
    x[[2017, 2023]] = -1
    x[2020] = np.median(calm) + 5  # of a normal noise one in 300,000
    assert not spike_sizes(x).any()
    x[2020] += 10
    assert spike_sizes(x)[2020, 0] > 8


def test_a_hand_that_turns_an_instrument_makes_no_spikes():
    made = simulate(short_plan(12), model=ImuModel(), noise=grade("mems").noise, site=SITE, seed=1)
    log = made.log
    assert without_spikes(log) is log
    k = int(made.first[4] + made.last[4]) // 2
    bad = replace(log, gyro=log.gyro.copy(), accel=log.accel.copy())
    bad.gyro[k] = bad.accel[k] = 0.0
    clean, cut, mended = (find_rests(x) for x in (log, bad, without_spikes(bad)))
    assert len(cut) < len(clean)  # both halves are too short
    np.testing.assert_array_equal(mended.first, clean.first)
    np.testing.assert_array_equal(mended.last, clean.last)


@pytest.mark.parametrize(("procedure", "share"), [
    *(pytest.param(name, share, marks=marks)
      for share, marks in ((0.0005, ()), (0.005, pytest.mark.thorough)) for name in (
          "continuous_spin", "magnetometer", "transfer_alignment", "two_imus", "imu_pose",
    )),
    ("platform_tumble", 0.0005),  # of a command that changes in that row nothing tells when
])  # fmt: skip
def test_what_no_motion_makes_is_no_reading_while_it_moves(procedure, share):
    """A logger's -9999 for what it lost was taken for another unit, or for other axes."""
    case = Case(procedure, grade="navigation" if procedure == "platform_tumble" else "tactical")
    log = made(case, 3).log
    rng = np.random.default_rng(1)
    gyro, accel = log.gyro.copy(), log.accel.copy()
    accel[rng.random(len(log)) < share] = -9999.0
    gyro[rng.random(len(log)) < share, 1] = -9999.0
    clean, found = (
        solved(case, log, whole=True),
        solved(case, replace(log, gyro=gyro, accel=accel), whole=True),
    )
    assert "log.spikes" in codes(found)
    assert found.verdict.level is clean.verdict.level
    a, b = clean.coefficients, found.coefficients
    assert (np.abs(b.values - a.values) < 0.5 * a.sd + 1e-12).all()
    assert (b.sd < 1.2 * a.sd + 1e-12).all()


@pytest.mark.parametrize("step", [1.75e-4, 1e-5])
def test_a_reading_far_off_is_no_step_of_the_output(step):
    x = step * np.round(1e-3 / step * np.sin(np.arange(3000) / 30))
    assert resolution(x) == pytest.approx(step, rel=1e-6)
    x[[1000, 2000]] = -9999.0
    assert resolution(x) == pytest.approx(step, rel=1e-6)
    np.testing.assert_array_equal(np.flatnonzero(spike_sizes(x[:, None])), [1000, 2000])


def test_a_few_windows_of_motion_do_not_cut_the_rest_around_them():
    rng = np.random.default_rng(3)
    level = 10 ** (0.03 * rng.standard_normal(100_000))
    level[500:550] *= 30
    assert 1.3 < split(level) < 25
    assert split(level[:500]) > level[:500].max()
    slow = 10 ** (0.03 * rng.standard_normal(1000))
    slow[:500] *= 2.5
    assert slow[:500].min() > split(slow) > slow[500:].max()


def test_a_real_turn_is_cut_out_and_a_small_part_is_a_warning():
    log = static()
    log.gyro[16000:16200, 2] += np.radians(45)
    got = measure_log(log, axes=("gyro.x",))
    assert [f.code for f in got.findings if f.code.startswith("allan.l")] == ["allan.longest_rest"]
    assert got.end < 160
    log = static()
    for k in range(1000, SAMPLES, 3000):
        log.gyro[k : k + 200, 2] += np.radians(45)
    got = measure_log(log, axes=("gyro.x",))
    told = next(f for f in got.findings if f.code == "allan.small_part")
    assert told.severity == "warning"
    assert "% of the log" in told.message


def test_a_shaken_log_that_stays_where_it_is_is_used_as_a_whole():
    log = static()
    for k in range(1000, SAMPLES, 3000):
        log.accel[k : k + 100] += np.resize([0.5, -0.5], (100, 1))
    got = measure_log(log, axes=("gyro.x",))
    assert (got.start, got.end) == (log.time[0], log.time[-1])
    told = next(f for f in got.findings if f.code == "allan.shaken")
    assert "but stays where it is; all of the log is used" in told.message


def test_a_spike_on_a_table_changes_no_reading():
    session = Session(plan_of(FACES, 0.0, time=20.0), gyro_noise=1e-4, accel_noise=1e-2)
    log = session.log(("angles",))
    clean = find_readings(log)
    start, end = session.marks[2]
    k = int(np.searchsorted(log.time, (start + end) / 2))
    log.gyro[k] = log.accel[k] = 0.0
    got = find_readings(log)
    assert [f.code for f in got.findings if f.code.startswith("log.")] == ["log.spikes"]
    assert len(got) == len(clean)
    np.testing.assert_allclose(got.accel, clean.accel, atol=1e-4)
    np.testing.assert_allclose(got.time, clean.time)


def test_a_spike_of_a_north_seeker_is_set_apart():
    rng = np.random.default_rng(4)
    log = IndexedLog(
        np.arange(1000.0) / 10, np.zeros(1000), 1e-6 * rng.standard_normal(1000), None,
        np.zeros(1000, np.int64), ("one",),
    )  # fmt: skip
    log.gyro[500] = 1e-3
    found = without_spikes(log)
    assert abs(found.gyro[500]) < 1e-5
    assert "1 (gyro), the first at 50 s (gyro, " in found.findings[0].message


@pytest.mark.parametrize("after", [1, 2, 5, 15])
@pytest.mark.parametrize("size", [-60.0, 40.0, 300.0])
def test_a_spike_beside_a_step_is_one_and_a_peak_at_it_is_none(after: int, size: float) -> None:
    """An index table turns between two readings, or while one or two are taken."""
    rng = np.random.default_rng(after)
    x = np.repeat([0.0, 100.0, -20.0, 100.0], 200)[:, None] + rng.normal(size=(800, 1))
    for step in (200, 400, 600):
        for at in (step - 1 - after, step + after):
            spoilt = x.copy()
            spoilt[at] += size
            assert np.flatnonzero(spike_sizes(spoilt)).tolist() == [at]
    assert not spike_sizes(x).any()
    for passed in ([500.0], [-90.0], [300.0, 700.0], [50.0]):  # while it turns
        turned = x.copy()
        turned[200 : 200 + len(passed), 0] = passed
        assert not spike_sizes(turned).any()
