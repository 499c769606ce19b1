"""What the samples tell: gaps, jitter, saturated and stuck axes, wrong units."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import axes, checks
from foucault.tables import Log

RNG = np.random.default_rng
G = 9.80665


def codes(found):
    return [f.code for f in found]


def test_even_time_says_nothing():
    assert checks.timing(1e9 + np.arange(1000) / 128.0) == ()
    jitter = RNG(1).uniform(-0.0004, 0.0004, 1000)
    assert checks.timing(np.arange(1000) / 100.0 + jitter) == ()


def test_gaps_are_counted_and_placed():
    time = np.delete(np.arange(1000) / 100.0, [100, 500, 501, 502])
    (found,) = checks.timing(time)
    assert found.code == "log.gap"
    assert found.message == (
        "Time has gaps, 2 in all; about 4 samples are missing. The longest is 40 ms, 4.99 s from "
        "the start, where 10 ms is usual."
    )


def test_irregular_rate():
    time = np.cumsum(RNG(2).uniform(0.006, 0.013, 1000))
    (found,) = checks.timing(time)
    assert found.code == "log.irregular"
    assert "% of the intervals are more than 10 % off the usual" in found.message


def session(n=4000, noise=0.02, seed=3):
    """Specific force of four rests with turns between, noise and 16-bit counts."""
    rng = RNG(seed)
    time = np.arange(n) / 100.0
    angle = np.pi / 2 * np.floor(time / 10.0)
    turning = np.clip((time % 10.0) - 9.0, 0.0, 1.0)
    angle = angle + np.pi / 2 * turning
    f = G * np.column_stack([np.sin(angle), 0.3 * np.cos(3 * angle), np.cos(angle)])
    f += rng.normal(0.0, noise, (n, 3))
    return time, f


def counts(f, size=0.002):
    return np.round(f / size) * size


@pytest.mark.parametrize("size", [0.0005, 0.002, 0.01, 0.03, 0.1, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.001, 0.02])
def test_healthy_sensors_of_any_resolution_are_left_alone(size, noise):
    time, f = session(noise=noise)
    assert axes.check(time, counts(f, size), "accel") == ()


def test_a_log_without_noise_is_left_alone():
    time, f = session(noise=0.0)
    assert axes.check(time, f, "accel") == ()


def test_slow_turns_over_the_top_are_not_saturation():
    time = np.arange(6000) / 100.0
    f = np.column_stack([np.sin(time * w) for w in (0.2, 0.9, 3.0)]) * G
    assert axes.check(time, counts(f, 0.01), "accel") == ()
    assert axes.check(time, counts(f + RNG(5).normal(0, 0.005, f.shape), 0.01), "accel") == ()


def test_saturated_gyro():
    time = np.arange(3000) / 100.0
    rate = np.zeros((3000, 3))
    rate[1000:1200, 1] = 6.0 * np.sin(np.linspace(0, 2 * np.pi, 200))
    rate = counts(rate + RNG(6).normal(0.0, 0.005, rate.shape), 0.001)
    assert axes.check(time, rate, "gyro") == ()
    clipped = np.clip(rate, -4.363, 4.363)
    (found,) = axes.check(time, clipped, "gyro")
    assert found.code == "log.saturated"
    at_limit = int((np.abs(clipped[:, 1]) == 4.363).sum())
    first = time[np.argmax(np.abs(clipped[:, 1]) == 4.363)]
    assert found.message == (
        f"gyro y is saturated; samples at the limit: {at_limit}, the first {first:.9g} s from "
        "the start."
    )


def test_declared_range_finds_a_single_sample():
    time, f = session()
    f = counts(f)
    f[1234, 2] = 2 * G
    limits = np.array([[-2 * G, 2 * G]] * 3)
    (found,) = axes.check(time, f, "accel", limits)
    assert (
        found.message
        == "accel z is saturated; samples at the limit: 1, the first 12.34 s from the start."
    )
    assert axes.check(time, session()[1], "accel", limits) == ()


def test_stuck_axis():
    time, f = session()
    f = counts(f)
    f[1500:1700, 0] = f[1500, 0]
    (found,) = axes.check(time, f, "accel")
    assert found.code == "log.stuck"
    assert "accel x repeats one reading from 15 s to 16.99 s" in found.message
    f[:, 2] = 0.0
    assert codes(axes.check(time, f, "accel")) == ["log.stuck", "log.stuck"]


def test_an_axis_constant_for_less_than_a_second_is_not_stuck():
    time, f = session()
    f = counts(f)
    f[1500:1590, 0] = f[1499, 0]
    assert "log.stuck" not in codes(axes.check(time, f, "accel"))


@pytest.mark.parametrize("interval", [0.1, 0.01, 0.001])
@pytest.mark.parametrize(
    ("said", "one", "kind", "truth"),
    [
        ("g", G, "rate", ("m/s^2", "rate")),
        ("m/s^2", 1.0, "rate", ("g", "rate")),
        ("mg", G / 1000, "rate", ("g", "rate")),
        ("g", G, "rate", ("mg", "rate")),
        ("m/s^2", 1.0, "rate", ("mg", "rate")),
        ("m/s^2", 1.0, "rate", ("m/s", "increment")),
        ("m/s", 1.0, "increment", ("m/s^2", "rate")),
        ("g", G, "rate", ("g*s", "increment")),
        ("m/s", 1.0, "increment", ("g*s", "increment")),
    ],
)
def test_accelerometer_in_another_unit(interval, said, one, kind, truth):
    _, f = session()
    size = {"m/s^2": 1.0, "g": G, "mg": G / 1000, "m/s": 1.0, "g*s": G}
    raw = f / size[truth[0]] * (interval if truth[1] == "increment" else 1.0)
    seen = raw * one / (interval if kind == "increment" else 1.0)
    (found,) = checks.accel_scale(seen, interval, said, one, kind)
    assert found.code == "log.accel_unit"
    assert f'unit = "{truth[0]}"' in found.cure
    assert (f'kind = "{truth[1]}"' in found.cure) == (truth[1] != kind)


def test_right_units_say_nothing():
    _, f = session()
    assert checks.accel_scale(f, 0.01, "m/s^2", 1.0, "rate") == ()
    assert checks.accel_scale(1.08 * f, 0.01, "count", None, "rate") == ()


def test_specific_force_that_nothing_explains():
    _, f = session()
    for one in (None, 1.0):
        (found,) = checks.accel_scale(2 * f, 0.01, "count", one, "rate")
        assert found.code == "log.accel_norm"
        assert "Check unit, scale, zero and columns in [log.accel]" in found.cure


def test_gyro_rates_that_no_gyro_measures():
    rate = RNG(8).normal(0.0, 2.0, (2000, 3))
    assert checks.gyro_scale(rate, "rad/s", "rate") == ()
    (found,) = checks.gyro_scale(np.degrees(rate), "rad/s", "rate")
    assert found.code == "log.gyro_unit"
    assert 'in [log.gyro] write unit = "deg/s"' in found.cure
    (found,) = checks.gyro_scale(rate / 0.01, "rad", "increment")
    assert 'kind = "rate" with a unit such as "rad/s"' in found.cure
    rate[7] = 1e6  # a single spike is no wrong unit
    assert checks.gyro_scale(rate, "rad/s", "rate") == ()


def test_read_reports_what_the_checks_find(read_text):
    time, f = session()
    rows = [f"{t:.2f},{x:.4f},{y:.4f},{z:.4f}" for t, (x, y, z) in zip(time, f, strict=True)]
    del rows[100:103]
    log = read_text(
        "\n".join(["t,ax,ay,az", *rows]),
        time={"unit": "s"},
        accel={"unit": "g", "saturation": 9.0},
    )
    assert codes(log.findings) == ["log.gap", *["log.saturated"] * 2, "log.accel_unit"]


@pytest.mark.parametrize(
    ("kelvin", "told"), [(298.15, None), (571.3, " is 298."), (25.0, " is -248.")]
)
def test_kelvin_said_to_be_degrees_celsius(kelvin, told):
    found = checks.temperature_scale(np.full(20, kelvin))
    assert [f.code for f in found] == ([] if told is None else ["log.temperature_unit"])
    assert all(told in f.message and "[log.temperature]" in f.cure for f in found)


def host_stamps(n=20_000, seed=1, lost=0.0):
    """Even samples at 100 Hz that a busy host stamps in bursts, as it gets to them."""
    rng = RNG(seed)
    true = np.arange(n) / 100.0
    true = true[rng.uniform(size=n) >= lost]
    stamps = true.copy()
    begin = 0
    while begin < len(true):
        size = int(rng.integers(1, 60)) if rng.uniform() < 0.2 else 1
        stamps[begin : begin + size] = true[min(begin + size, len(true)) - 1]
        begin += size
    order = np.arange(len(true)) * 1e-4 % 5e-3
    return np.maximum.accumulate(stamps + order + 1e-6 * np.arange(len(true)))


def test_the_rate_advised_is_the_number_over_the_time():
    time = host_stamps()
    time = time[np.concatenate([[True], np.diff(time) > 0])]
    even = np.arange(20_000) / 100.0
    assert checks.even_rate(even) == pytest.approx(100.0, rel=1e-9)
    found = [f for f in checks.timing(host_stamps() + np.arange(20_000) * 1e-9)
             if f.code == "log.irregular"]  # fmt: skip
    (irregular,) = found
    said = float(irregular.cure.split('rate = "')[1].split(" Hz")[0])
    assert said == pytest.approx(100.0, rel=2e-4)
    assert 'Hz" in [log]: their number over their time' in irregular.cure


def test_no_rate_is_advised_where_samples_are_lost_or_another_log_has_the_clock():
    rng = RNG(4)
    time = np.arange(20_000) / 100.0 + rng.uniform(0, 0.004, 20_000)
    lost = np.delete(time, np.r_[5000:5200, 9000:9300])
    assert checks.even_rate(time) == pytest.approx(100.0, rel=1e-4)
    assert checks.even_rate(lost) is None
    (irregular,) = (f for f in checks.timing(lost) if f.code == "log.irregular")
    assert "No rate can take the place of [log.time]: samples are lost" in irregular.cure
    (irregular,) = checks.timing(time, shared=True)
    assert "Keep [log.time]: another log or a table" in irregular.cure
    (kept,) = checks.on_a_shared_clock(checks.timing(time))
    assert kept.cure == irregular.cure


def test_a_time_that_repeats_beside_another_log_is_kept_too():
    time = np.floor(np.arange(1000) / 100.0 * 50) / 50
    with pytest.raises(FoucaultError) as raised, checks.beside_another():
        checks.timing(time)
    assert "Keep [log.time]" in raised.value.cure and "Hz" not in raised.value.cure
    with pytest.raises(FoucaultError) as raised:
        checks.timing(time)
    assert 'rate = "100' in raised.value.cure


@pytest.mark.parametrize("end", [1700, None])
def test_two_axes_that_stop_together_are_both_named(end):
    time, f = session()
    f = counts(f)
    f[1500:end, 0], f[1500:end, 2] = f[1500, 0], f[1500, 2]
    found = axes.check(time, f, "accel")
    assert codes(found) == ["log.stuck", "log.stuck"]
    assert "accel x repeats one reading from 15 s" in found[0].message
    assert "accel z repeats one reading from 15 s" in found[1].message


def test_two_axes_that_are_still_in_a_log_without_noise_are_not_stuck():
    time = np.arange(3000) / 100
    turn = np.sin(time) * (time > 10)
    x = np.stack([turn * (time < 20), turn * (time < 20), turn], axis=1)
    assert axes.check(time, x, "gyro") == ()


@pytest.mark.parametrize("digits", [12, 6])
def test_two_axes_that_stop_in_a_smooth_motion_are_named(digits):
    """A slow tumble: from sample to sample it moves by a thousand times its noise."""
    time = 0.2 * np.arange(1200)
    angle = np.radians(5.0) * time
    f = G * np.stack([np.sin(angle), np.cos(angle), np.sin(1.1 * angle + 0.3)], axis=1)
    f = np.round(f + 1e-5 * np.random.default_rng(1).standard_normal(f.shape), digits)
    f[600:840, :2] = f[600, :2]
    assert codes(axes.check(time, f, "accel")) == ["log.stuck"] * 2


@pytest.mark.parametrize("digits", [12, 4])
def test_a_smooth_motion_without_noise_is_not_taken_for_noise(digits):
    x = np.round(G * np.sin(np.radians(1.0) * np.arange(1200)), digits)
    assert not axes.noisy(x)
    assert axes.noisy(x + 1e-3 * np.random.default_rng(1).standard_normal(1200))


@pytest.mark.parametrize("count", [0.01, 1.0])
def test_a_logger_that_repeats_its_last_row_in_a_rest_is_told(count):
    """Where other rests show noise; a sensor too coarse for it is not called stuck."""
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(3000)
    turning = np.clip(np.abs(time - 15.0) - 3.0, None, 0.0)[:, None]  # from 12 to 18 s
    x = turning * [1.0, 0.7, -0.4] + 0.02 * (1 + 60 * (turning < 0)) * rng.standard_normal(
        (3000, 3)
    )
    x = count * np.round(x / count)
    if count < 0.1:
        x[2200:2700] = x[2200]
    else:
        x[:1200] += count * (rng.random((1200, 3)) < 0.3) * (time[:1200, None] > 11.9)
    assert codes(axes.check(time, x, "gyro")) == ["log.stuck"] * (3 if count < 0.1 else 0)


def test_pulses_that_repeat_are_not_stuck():
    rng = np.random.default_rng(1)
    time = np.arange(40_000) / 20
    # Pulses of a steady rate: one in twenty readings has one more, now and then one in thirty.
    phase = np.cumsum(5.05 + 0.012 * rng.standard_normal(len(time)))
    x = np.stack([np.diff(np.floor(phase), prepend=0.0), *rng.integers(0, 99, (2, len(time)))], 1)
    longest = np.diff(np.flatnonzero(np.diff(x[:, 0]))).max()
    assert longest > 20  # more than a second
    assert axes.check(time, x, "gyro") == ()


REPEATED = {"each twice": 2.0, "each four times": 4.0, "one in two": 1.5}


@pytest.mark.parametrize("rows", REPEATED.values(), ids=REPEATED)
@pytest.mark.parametrize("size", [1e-6, 0.002, 0.01])
def test_a_triad_that_is_slower_than_its_log_is_told(rows, size):
    """Coarse or fine: all three axes go on at once."""
    time, f = session()
    at = np.floor(np.floor(np.arange(len(f)) / rows) * rows + 1e-9).astype(int)
    (found,) = [item for item in axes.check(time, counts(f, size)[at], "accel")
                if item.code == "log.held"]  # fmt: skip
    assert found.message.startswith("accel x, y, z: each reading is written in ")
    said = [float(word) for word in found.message.split() if word[0].isdigit()]
    assert said == pytest.approx([rows, 100 / rows, 100.0], rel=0.01)
    assert found.severity == "warning" and "keep one row of each reading" in found.cure


def test_one_axis_that_is_slower_than_its_log_is_told():
    time, f = session()
    f = counts(f)
    f[:, 1] = f[np.arange(len(f)) // 3 * 3, 1]
    (found,) = axes.check(time, f, "accel")
    assert found.code == "log.held" and found.message.startswith("accel y: ")
    assert axes.rows_per_reading(f) == pytest.approx([1.0, 3.0, 1.0], rel=0.03)


COARSE = {"gyro": np.radians(0.06), "accel": 5e-3 * G}


@pytest.mark.parametrize("triad", COARSE)
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2, 0.5])
def test_coarse_steps_at_rest_are_neither_stuck_nor_slow(triad, noise):
    rng = RNG(11)
    for start in rng.uniform(-0.5, 0.5, 8):  # somewhere between two counts
        x = start + noise * rng.standard_normal((6000, 3))
        values = COARSE[triad] * np.round(x + np.array([0.0, 0.3, 12.4]))
        told = [f.message.split()[1] for f in axes.check(np.arange(6000) / 100.0, values, triad)]
        # One that reads a single value throughout is dead or too coarse: nothing tells which.
        assert told == ["xyz"[k] for k in range(3) if np.ptp(values[:, k]) == 0]


def test_a_ring_laser_that_is_locked_in_is_not_slow():
    """It reads zero at rest, and jumps by far more than a count where it is shaken."""
    rng = RNG(12)
    pulses = np.round(40 * rng.standard_normal((9000, 3))) * (rng.random((9000, 3)) > 0.5)
    assert axes.check(np.arange(9000) / 100.0, pulses, "gyro") == ()


@cache
def tumbling(n=4000, seed=5):
    """A log that turns all the time about axes that change, in coarse steps."""
    rng = RNG(seed)
    time = np.arange(n) / 100.0
    w = np.column_stack([np.sin(0.7 * time), np.cos(0.9 * time + 1), 0.8 * np.sin(1.3 * time + 2)])
    f = np.empty((n, 3))
    f[0] = [0.0, 0.0, G]
    for k in range(1, n):  # df/dt = f x w
        f[k] = f[k - 1] + 0.01 * np.cross(f[k - 1], (w[k] + w[k - 1]) / 2)
        f[k] *= G / np.linalg.norm(f[k])
    f, w = (x + s * rng.standard_normal((n, 3)) for x, s in ((f, 0.01), (w, 1e-4)))
    return Log(time, COARSE["gyro"] * np.round(w / COARSE["gyro"]),
               COARSE["accel"] * np.round(f / COARSE["accel"]), mag=1e-6 * f)  # fmt: skip


@pytest.mark.parametrize("axis", [0, 1, 2, slice(None)])
@pytest.mark.parametrize("triad", ["accel", "mag"])
def test_a_field_that_stays_while_the_gyros_turn_is_stuck_however_coarse(triad, axis):
    log = tumbling()
    assert axes.unmoved(log) == ()
    values = getattr(log, triad).copy()
    values[2000:, axis] = values[2000, axis]
    found = axes.unmoved(replace(log, **{triad: values}))
    named = "xyz" if axis == slice(None) else "xyz"[axis]
    assert [f.message.split()[:2] for f in found] == [[triad, a] for a in named]
    assert all(f.code == "log.stuck" for f in found)
    # Most procedures do without a magnetometer: they are not to doubt what they found.
    assert {f.severity for f in found} == {"note" if triad == "mag" else "warning"}


def test_gyros_that_all_stay_while_gravity_turns_are_stuck():
    log = tumbling()
    gyro = log.gyro.copy()
    gyro[2000:] = gyro[2000]
    found = axes.unmoved(replace(log, gyro=gyro))
    assert codes(found) == ["log.stuck"] * 3
    assert "gyro x repeats one reading from 20 s to 39.99 s" in found[0].message


def test_an_axis_along_which_the_table_spins_is_not_stuck():
    """A coarse accelerometer along a level axis of rotation; all of them with a vertical one."""
    time = np.arange(6000) / 100.0
    spin = np.where(time < 30, 0.5, 0.0)
    angle = np.cumsum(spin) * 0.01
    f = G * np.column_stack([np.sin(angle), np.cos(angle), 0 * time])
    w = np.column_stack([0 * time, 0 * time, spin])
    f[3000:], w[3000:] = [0.0, 0.0, G], [0.0, 0.0, 0.5]
    for gyro in (w, 57.3 * w, w[:, [1, 2, 0]]):  # a wrong unit or order says nothing of it either
        log = Log(time, gyro, COARSE["accel"] * np.round(f / COARSE["accel"]))
        assert axes.unmoved(log) == ()


def turning_with_the_earth(factor=1.0, seconds=60, seed=2):
    rng = RNG(seed)
    w = np.array([0.3, 0.5, 0.81])
    w *= 7.292115e-5 * factor / np.linalg.norm(w)
    return w + rng.normal(0, 1e-6, (seconds * 100, 3))


def test_rests_that_turn_3600_times_as_fast_as_the_earth_name_arcsec():
    for unit, one, kind, likely in (
        ("deg", np.pi / 180, "increment", '"arcsec"'),
        ("deg/s", np.pi / 180, "rate", '"arcsec/s" or "deg/h"'),
    ):
        (found,) = checks.earth_scale(turning_with_the_earth(3600.0), 0.01, unit, one, kind)
        assert found.code == "log.gyro_earth"
        assert "times the Earth's rate, with unit" in found.message
        assert f"The unit is probably {likely}: correct it in [log.gyro]." in found.cure
    for factor in (1.0, 60.0, 1000.0, 5000.0):
        assert checks.earth_scale(turning_with_the_earth(factor), 0.01, "deg", 1.0, "rate") == ()


def test_too_fast_a_gyro_in_degrees_may_be_in_arcsec():
    gyro = np.full((1000, 3), 4000.0)
    (found,) = checks.gyro_scale(gyro, "deg", "increment")
    assert 'unit = "arcsec"' in found.cure


def test_a_count_scale_per_g_says_which_g():
    (found,) = checks.standard_gravity("1e6 count/g")
    assert "per 1 g = 9.80665 m/s^2, the standard one" in found.message
    assert "for 1 g, write it per m/s^2" in found.cure
    assert checks.standard_gravity(("415 count/(m/s^2)",) * 3) == ()
    assert checks.standard_gravity("4e6 count/mg") != () and checks.standard_gravity(None) == ()


def test_what_is_constant_just_long_enough_is_found_wherever_it_begins():
    for first in range(25):
        values = RNG(first).normal(size=(100, 2))
        values[first : first + 11] = values[first]
        assert axes._longest(values, 11) == (first, first + 11)
        assert axes._longest(values, 10) == (first, first + 11)
        values[first, 1] = 0.0  # one row less, and all of them for the first axis alone
        assert axes._longest(values[:, :1], 11) == (first, first + 11)
        assert np.subtract(*axes._longest(values, 11)[::-1]) < 11
