"""Readings of a systematic calibration with a wrong unit, axis or sign, before any sequence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.sequence import find_sequence
from foucault.diagnose.systematic_sequence import match_sequence
from foucault.errors import FoucaultError
from foucault.guard.rest import check_sequence
from foucault.models.earth import Site
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.sequence import CalibrationSequence, quarter_turns
from foucault.tables import Log
from make_sequence import DEG, SITE, simulated
from refusals import refuses

G = 9.80665
SWAP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])


@pytest.fixture(scope="module")
def log() -> Log:
    told = quarter_turns("some", "UEN", "+y +y +z -x +x +y +z -y", rest=60.0)
    return simulated(told, seed=4).log


def refused(log: Log, site: Site = SITE) -> FoucaultError:
    with pytest.raises(FoucaultError) as caught:
        check_sequence(log, find_sequence(log), site)
    return caught.value


def test_what_is_right_raises_nothing(log: Log) -> None:
    assert check_sequence(log, find_sequence(log), SITE) == ()
    rough = replace(log, accel=log.accel * 1.02 + 0.05, gyro=log.gyro * 1.01 + 1e-3)
    assert check_sequence(rough, find_sequence(rough), SITE) == ()


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1 / G, "0.99.. m/s.2, 0.102 times local gravity: the unit is g and was declared as m/s.2"),
        (G, "9.80. times local gravity: the unit is m/s.2 and was declared as g"),
        (0.02, "0.02 times local gravity: increments were declared as rates"),
        (50.0, "50 times local gravity: rates were declared as increments"),
        (3.0, "3 times local gravity: no usual mistake makes this"),
    ],
)
def test_specific_force_of_a_wrong_unit(log: Log, factor: float, words: str) -> None:
    problem = refused(replace(log, accel=log.accel * factor))
    assert problem.code == "alignment.force"
    with pytest.raises(FoucaultError, match=words):
        raise problem


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (180 / np.pi, "the unit is deg/s and was declared as rad/s"),
        (np.pi / 180, "the unit is rad/s and was declared as deg/s"),
        (0.02, "increments were declared as rates"),
    ],
)
def test_rates_of_a_wrong_unit(log: Log, factor: float, words: str) -> None:
    problem = refused(replace(log, gyro=log.gyro * factor))
    assert problem.code == "gyro.unit"
    assert words in problem.message


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("gyro", "accel", "code", "words"),
    [
        (SWAP, np.eye(3), "gyro.left_handed", "gyro x = +y, y = +x, z = +z"),
        (np.diag([1.0, 1, -1]), np.eye(3), "gyro.left_handed", "z = -z (body axis"),
        (-np.eye(3), np.eye(3), "gyro.reversed", "with all three gyro signs reversed"),
        (np.eye(3)[[1, 2, 0]], np.eye(3), "gyro.axes", "x = +z, y = +x, z = +y"),
        (np.eye(3), SWAP, "gyro.axes", "x = -y, y = -x, z = -z"),
        (SWAP, SWAP, "gyro.reversed", "signs reversed"),
        (np.eye(3), -np.eye(3), "alignment.vertical_sign", "the sign is reversed"),
    ],
)
def test_axes_and_signs(
    log: Log, gyro: np.ndarray, accel: np.ndarray, code: str, words: str
) -> None:
    problem = refused(replace(log, gyro=log.gyro @ gyro.T, accel=log.accel @ accel.T))
    assert problem.code == code
    assert words in problem.message
    if code == "alignment.vertical_sign":
        assert 'reads = "gravity"' in problem.cure
    if not np.array_equal(accel, np.eye(3)) and code == "gyro.axes":
        assert "all three accelerometer signs are reversed besides" in problem.cure


def test_a_latitude_that_is_another(log: Log) -> None:
    found = find_sequence(log)
    words = "Gravity and the Earth's rate in all rests show a latitude of 34"
    (said,) = check_sequence(log, found, Site.at(36 * DEG, 380.0))
    assert said.code == "systematic.latitude"
    assert said.message.startswith(words) and "36.0 deg was given" in said.message
    far = refused(log, Site.at(40 * DEG, 380.0))
    assert far.code == "systematic.latitude"
    assert far.message.startswith(words) and "40.0 deg was given" in far.message
    assert refused(log, Site.at(-34 * DEG, 380.0)).code == "alignment.vertical_sign"


def test_gyros_that_do_not_see_the_earth_say_nothing_of_it(log: Log) -> None:
    noise = np.random.default_rng(1).normal(0, 3e-2, log.gyro.shape)
    coarse = replace(log, gyro=log.gyro + noise)
    assert check_sequence(coarse, find_sequence(coarse), Site.at(-34 * DEG, 380.0)) == ()


def test_a_turn_beyond_the_range_of_the_gyros(log: Log) -> None:
    found = find_sequence(log)
    move = found.moves[2]
    gyro = log.gyro.copy()
    gyro[move.first : move.last] = np.clip(gyro[move.first : move.last], -0.1, 0.1)
    problem = refused(replace(log, gyro=gyro))
    assert problem.code == "systematic.turn_contradicts"
    start = float(problem.message.removeprefix("From ").split(" to ")[0])
    assert start == pytest.approx(move.start, abs=1.0)
    assert "1 of 8 times it is so. No exchange of axes" in problem.message
    assert "a turn beyond the range of the gyros" in problem.cure


def test_samples_that_are_missing(log: Log) -> None:
    keep = np.delete(np.arange(len(log)), slice(5000, 5100))
    parts = {name: getattr(log, name)[keep] for name in ("time", "gyro", "accel")}
    problem = refused(replace(log, **parts))
    assert problem.code == "systematic.gap"
    assert "missing at 99.98 s (1 in all, the longest 2.02 s; the usual interval is 20 ms)" in (
        problem.message
    )
    assert "--gaps" not in str(problem) and "whichever hold more rests" in problem.cure


# -- a start at another heading ----------------------------------------------------------------


def test_turns_of_the_table_that_started_at_another_heading() -> None:
    some = ["north", "east", "-north", "up", "east", "north"]
    actions = [Rest(60.0)]
    for axis in some:
        angle = -90 * DEG if axis[0] == "-" else 90 * DEG
        actions += [Rotate(axis.lstrip("-"), angle, 10 * DEG), Rest(60.0)]
    told = CalibrationSequence("table", np.eye(3), tuple(actions))
    for more in (90.0, -35.0):
        done = replace(told, start=exp(np.array([0, 0, -more * DEG])))
        found = find_sequence(simulated(done, seed=5).log)
        with refuses("systematic.heading_start") as caught:
            match_sequence(found, told)
        angle = float(caught.value.message.split(" was ")[1].split(" deg")[0])
        assert angle == pytest.approx(more, abs=1.5)
        assert caught.value.cure == "Correct `start`: where x, y and z pointed at first."
