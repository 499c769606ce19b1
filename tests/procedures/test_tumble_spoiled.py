"""Tumbles that break what is taken for granted: named for what they are, or seen through."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.tumble import outlying
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.left_out import sizes_of
from foucault.result import Level
from make_tumble import FAST, PUBLISHED, calibrate, nees, tumble
from refusals import refuses
from sessions import codes, failed

SD = 9.8e-6
"""Of a reading, by the noise of the template [m/s^2]."""


def sentence(result, name):
    return next(c.sentence for c in result.checks if c.name == name)


# -- the Earth as a clock --------------------------------------------------------------------------


def test_a_latitude_of_the_wrong_sign_is_no_narrow_prior():
    made, session = tumble(FAST)
    site = Site.at(-made.site.latitude, made.site.height)
    result = calibrate(made, session.simulation.log, trial=True, site=site)
    assert "session.earth_rate" in codes(result)
    assert sentence(result, "Earth's rate").endswith("the latitude has the wrong sign.")
    assert sentence(result, "prior").endswith("see the check of the Earth's rate.")


def test_a_latitude_ten_degrees_off_is_named_with_its_size():
    made, session = tumble(FAST)
    site = Site.at(made.site.latitude - np.radians(10.0), made.site.height)
    result = calibrate(made, session.simulation.log, trial=True, site=site)
    assert re.search(r"the latitude is \+1[01] deg", sentence(result, "Earth's rate"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("wrong", "words"), [(lambda latitude: -latitude, "the wrong sign"),
                         (lambda latitude: latitude + np.radians(1.0), r"-(1|1\.0\d|0\.9\d) deg")],
)  # fmt: skip
def test_no_term_that_is_counted_takes_a_wrong_latitude_up(wrong, words):
    """An enlarged term, or prior, explained most of it, and the Earth's rate passed."""
    made, session = tumble(PUBLISHED)
    site = Site.at(wrong(made.site.latitude), made.site.height)
    sizes = sizes_of("navigation RLG")
    result = calibrate(made, session.simulation.log, trial=True, site=site, sizes=sizes)
    assert result.diagnostics["named"] and "session.earth_rate" in codes(result)
    assert re.search(f"the latitude (is|has) {words}", sentence(result, "Earth's rate"))


@pytest.mark.thorough
def test_the_earth_is_not_blamed_for_squares_and_cubes_at_their_sizes():
    squares = []
    for seed in range(8):
        made, session = tumble(FAST, seed=seed)
        log, truth = session.simulation.log, np.random.default_rng(seed).standard_normal
        sizes = sizes_of("navigation RLG")
        bent = truth(3) * sizes["accel.quadratic"][0] * log.accel**2
        turned = truth(3) * sizes["gyro.cubic"][0] * log.gyro**3
        log = replace(log, accel=log.accel + bent, gyro=log.gyro + turned)
        result = calibrate(made, log, trial=True, sizes=sizes)
        squares.append(next(c for c in result.checks if c.name == "Earth's rate").value)
    assert sum(squares) < chi_square_limits(16)[1]


@pytest.mark.thorough
def test_stamps_that_are_a_thousandth_wrong_do_not_pass():
    made, session = tumble(PUBLISHED)
    log = session.simulation.log
    result = calibrate(made, replace(log, time=1.001 * log.time), trial=True)
    assert failed(result) == {"gyro.torquer_scale alike"}
    assert "a wrong clock" in sentence(result, "gyro.torquer_scale alike")
    slow = calibrate(made, replace(log, time=1.01 * log.time), trial=True)
    assert {"Earth's rate", "gyro.torquer_scale alike"} <= failed(slow)


@pytest.mark.thorough
def test_the_earth_of_a_clean_tumble_turns_as_it_should():
    squares = []
    for seed in range(10):
        made, session = tumble(FAST, seed=seed)
        result = calibrate(made, session.simulation.log, trial=True)
        check = next(c for c in result.checks if c.name == "Earth's rate")
        assert check.passed and "tumble.outliers" not in codes(result)
        squares.append(check.value)
    low, high = chi_square_limits(20)
    assert low < sum(squares) < high


# -- parts of the log ------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "words"), [(-1.0, "-1.00 times"), (0.5, "2.00 times")])
def test_a_segment_that_was_not_turned_as_commanded_is_named(factor, words):
    made, session = tumble(FAST)
    log = session.simulation.log
    inside = (log.time >= 60.0) & (log.time < 120.0)
    other = replace(log, gyro=np.where(inside[:, None], factor * log.gyro, log.gyro))
    with refuses("tumble.part", match=f"the cluster turned {words}") as told:
        calibrate(made, other, trial=True)
    start, end = re.findall(r"From ([\d.]+) to ([\d.]+) s", str(told.value))[0]
    assert float(start) == pytest.approx(60.0, abs=6.0) and float(end) == pytest.approx(120, abs=6)


def spiked(log, share, size, seed=0):
    rng = np.random.default_rng(seed)
    accel = log.accel.copy()
    hit = rng.random(accel.shape) < share
    accel[hit] += size * 9.8e-6 * rng.choice([-1.0, 1.0], int(hit.sum()))
    return replace(log, accel=accel), hit.any(axis=1)


@pytest.mark.thorough
@pytest.mark.parametrize(("share", "size"), [(0.01, 1e4), (0.001, 1e3)])
def test_readings_that_jump_are_left_out_and_counted(share, size):
    made, session = tumble(PUBLISHED)
    log, hit = spiked(session.simulation.log, share, size)
    result = calibrate(made, log, trial=True)
    assert not failed(result)
    low, high = chi_square_limits(45)
    assert low < nees(result, session.truth) < high
    told = next(f for f in result.findings if f.code == "tumble.outliers")
    assert "lie farther from what their neighbours predict" in told.message
    assert (outlying(log, SD) & hit).sum() == hit.sum()


def test_a_row_of_zeros_is_left_out():
    log = tumble(FAST)[1].simulation.log
    for row in (len(log) // 3, len(log) - 1):
        accel = log.accel.copy()
        accel[row] = 0.0
        found = np.flatnonzero(outlying(replace(log, accel=accel), SD))
        assert row in found and len(found) <= 3
    assert not outlying(log, SD).any()


# -- a knock -----------------------------------------------------------------------------------


def pushed(log, axis, size, start, time, soft):
    """Return the log with a push of `size` [g] on an accelerometer, from `start` for `time` [s]."""
    part = (log.time - log.time[0] - start) / time
    accel, during = log.accel.copy(), (part >= 0) & (part < 1)
    accel[during, axis] += 9.8 * size * (np.sin(np.pi * part[during]) if soft else 1.0)
    return replace(log, accel=accel)


@pytest.mark.parametrize(
    ("plan", "axis", "size", "start", "time", "soft"),
    [
        (FAST, 0, 1e-3, 90.0, 2.0, False),
        (FAST, 1, 1e-2, 30.0, 2.0, False),
        (FAST, 2, 1e-3, 178.0, 8.0, True),
        (PUBLISHED, 0, 1e-3, 2000.0, 2.0, False),
        (PUBLISHED, 1, 1e-4, 900.0, 20.0, True),
    ],
)
def test_a_knock_is_named_and_left_out(plan, axis, size, start, time, soft):
    """Deflections, priors and another Earth's rate were made of it, and all was unusable."""
    made, session = tumble(plan)
    log = pushed(session.simulation.log, axis, size, start, time, soft)
    for sizes in (None, sizes_of("navigation RLG")):
        result = calibrate(made, log, trial=True, sizes=sizes)
        assert result.verdict.level is Level.PASS
        assert "tumble.mishap" in codes(result)
        low, high = chi_square_limits(45)
        assert nees(result, session.truth) < high
        if sizes is None:
            assert low < nees(result, session.truth)
        (told,) = (f for f in result.findings if f.code == "tumble.mishap")
        begin, end = map(float, re.search(r"at ([\d.]+) to ([\d.]+) s", told.message).groups())
        assert start - 10 < begin < start + time and start < end < start + time + 10


@pytest.mark.parametrize("plan", [FAST, PUBLISHED])
def test_what_shifts_for_good_is_no_knock(plan):
    made, session = tumble(plan)
    log = session.simulation.log
    half = log.time > log.time[len(log) // 2]
    result = calibrate(made, replace(log, accel=log.accel + 1e-3 * half[:, None] * [1, 0, 0]),
                       trial=True)  # fmt: skip
    assert "tumble.mishap" not in codes(result)
    assert result.verdict.level is Level.DOUBTFUL


def shifted(log, kind, size, start):
    """Return the log with drift [deg/h], bias [ug] of x or attitude [arcsec] changed at `start`."""
    from_on = (log.time > log.time[0] + start)[:, None] * [1.0, 0.0, 0.0]
    if kind == "bias":
        return replace(log, accel=log.accel + size * 9.8e-6 * from_on)
    turn = np.radians(size / 3600)
    once = np.diff(from_on, axis=0, prepend=0.0) / log.interval
    return replace(log, gyro=log.gyro - turn * (from_on if kind == "drift" else once))


@pytest.mark.parametrize(
    ("kind", "size", "words"),
    [
        ("drift", 0.005, "the drift of the gyros changed"),
        ("bias", 2.0, "the biases of the accelerometers changed"),
        ("attitude", 5.0, "the cluster turned otherwise than commanded"),
    ],
)
def test_what_shifts_for_good_is_named_with_its_time(kind, size, words):
    """A drift that jumps by 0.003 deg/h passed with NEES over n of 36 to 53."""
    made, session = tumble(PUBLISHED)
    log = shifted(session.simulation.log, kind, size, 3000.0)
    for sizes in (None, sizes_of("navigation RLG")):
        result = calibrate(made, log, trial=True, sizes=sizes)
        assert "shifts" in failed(result)
        told = sentence(result, "shifts")
        assert words in told
        time = float(re.search(rf"{words} at (\d+) s", told)[1])
        assert time == pytest.approx(3000.0, abs=60.0)


def test_a_drift_that_need_not_show_is_said_not_to():
    made, session = tumble(FAST)
    result = calibrate(made, shifted(session.simulation.log, "drift", 0.01, 120.0), trial=True)
    assert result.verdict.level is Level.PASS  # NEES over n of 4 to 20
    (told,) = (line for line in result.diagnostics["unseen"] if line.startswith("Biases"))
    assert float(re.search(r"gyros by less than ([\d.]+) deg/h", told)[1]) > 0.02


@pytest.mark.parametrize("plan", [FAST, PUBLISHED])
def test_no_knock_is_found_beside_an_outlier_where_the_noise_is_larger(plan):
    """The noise 10 % larger than was said: residuals are too large, and even."""
    made, session = tumble(plan)
    log = session.simulation.log
    louder = np.random.default_rng(1).standard_normal(log.accel.shape) * SD * np.sqrt(1.1**2 - 1)
    accel = log.accel + louder
    accel[len(accel) // 3] += 1.0
    result = calibrate(made, replace(log, accel=accel), trial=True)
    assert "tumble.outliers" in codes(result) and "tumble.mishap" not in codes(result)


def test_where_slow_noise_is_declared_no_knock_is_looked_for():
    """Residuals are larger and related by it, as after a knock."""
    made, session = tumble(PUBLISHED)
    log = pushed(session.simulation.log, 1, 1e-4, 900.0, 20.0, soft=True)
    wander = {"bias_instability": 1e-5, "correlation_time": 300.0}
    noise = replace(made.noise, accel=replace(made.noise.accel, **wander))
    assert "tumble.mishap" not in codes(calibrate(made, log, trial=True, noise=noise))
