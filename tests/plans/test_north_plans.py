"""Orders of stops of a north seeker: their times, their file, and which is chosen."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from foucault import units
from foucault.errors import FoucaultError
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans import north_orders as plans
from foucault.plans.north_orders import Task, at_time, compare
from foucault.plans.north_stops import Conditions
from refusals import refuses

LATITUDE = np.radians(47.0)
ARW = units.parse("0.003 deg/sqrt(h)", "angle random walk")
NOISE = ImuNoise(TriadNoise(5e-5), TriadNoise(ARW))
HEADING = np.radians([15.0, 100.0, 340.0])
TASK = Task(Conditions(LATITUDE, NOISE))


def moment(order: plans.Order) -> float:
    """What a linear drift does: sum of time x (t - middle) x (cos, sin), over its scale."""
    d = order.dwells(600.0, 7.0, HEADING[:1])
    t = d.start + d.time / 2
    t = t - np.average(t, weights=d.time)
    return float(np.hypot(np.sum(d.time * t * d.cosine), np.sum(d.time * t * d.sine))) / 600.0**2


def test_stops_fill_the_time_and_neighbours_are_one() -> None:
    order = plans.PALINDROME
    np.testing.assert_allclose(np.degrees(order.index), [0, 180, 90, 270, 90, 180, 0])
    np.testing.assert_allclose(order.share * 8, [1, 1, 1, 2, 1, 1, 1])
    d = order.dwells(600.0, 10.0, HEADING)
    assert len(d) == 21 and len(d.names) == 3
    one = d.of(1)
    np.testing.assert_allclose(one.time[[0, 3]], [67.5, 135.0])
    np.testing.assert_allclose(one.start[1:], one.start[:-1] + one.time[:-1] + 10.0)
    assert one.start[-1] + one.time[-1] == pytest.approx(600.0)
    assert order.shortest(10.0, 5.0) == pytest.approx(6 * 10.0 + 8 * 5.0)
    twice = order.repeated(2)
    assert len(twice) == 13 and twice.share.sum() == pytest.approx(1.0)


def test_drift_cancels_in_the_palindrome_only() -> None:
    assert moment(plans.PALINDROME) < 1e-15
    assert moment(plans.PALINDROME.repeated(3)) < 1e-15
    published, sequential = moment(plans.PUBLISHED), moment(plans.SEQUENTIAL)
    assert sequential == pytest.approx(2 * published) and published > 0.01
    assert moment(plans.continuous(5)) < published / 2


def test_the_pair_looks_east_and_west() -> None:
    d = plans.PAIR.dwells(100.0, 0.0, HEADING, np.radians([0.0, 2.0, -2.0]))
    # The axis at index a looks towards heading + a.
    towards = np.degrees(HEADING[d.setup] + d.index) % 360
    np.testing.assert_allclose(towards, [90, 270, 88, 268, 92, 272], atol=1e-9)
    both = plans.two_stage(0.1)
    assert both.share[:4].sum() == pytest.approx(0.1) and not both.from_north[:4].any()
    assert both.from_north[4:].all()


def test_east_west_and_back_costs_a_move_and_cancels_a_drift() -> None:
    there, back = (compare(replace(TASK, total=300.0, rough_sd=0.01), (name,)).rows[0]
                   for name in ("east-west pair", "East west east"))  # fmt: skip
    assert back.order is plans.AGAIN and back.at is not None and there.at is not None
    assert back.sd == pytest.approx(there.sd * np.sqrt(290 / 280), rel=1e-3)
    assert back.at.drift_error < 1e-4 * there.at.drift_error
    both = compare(replace(TASK, total=300.0, rough_sd=0.01), ("east-west pair", "east-west-east"))
    assert both.best.order is plans.AGAIN and "linear drift" in both.reason


def test_pieces_of_a_rotation_are_those_of_a_log() -> None:
    order = plans.continuous(5)
    d = order.dwells(300.0, 10.0, HEADING)
    assert len(d) == 600 and d.time.sum() == pytest.approx(900.0)
    one = d.of(0)
    fine = np.arange(60000).reshape(200, 300) + 0.5
    angle = 2 * np.pi * 5 * fine / 60000
    np.testing.assert_allclose(one.cosine, np.cos(angle).mean(axis=1), atol=1e-6)
    np.testing.assert_allclose(one.sine, np.sin(angle).mean(axis=1), atol=1e-6)


def test_names() -> None:
    assert plans.orders("Palindrome")[0] is plans.PALINDROME
    assert plans.orders("2 positions")[0] is plans.PAIR
    assert plans.orders("east west pair")[0] is plans.PAIR
    assert len(plans.orders("two-stage")) == len(plans.SHARES)
    assert plans.orders("continuous 3")[0].name == "continuous, 3 turns"
    assert len(plans.orders("5 positions", 2)[0].index) == 10
    for name, said in (
        ("palindrom", "'palindrom' is not an order of stops. Did you mean 'palindrome'?"),
        ("1 positions", "1 positions cannot tell the rate of the Earth from the offset"),
        ("continuous 0", "0 turns: at least one is needed"),
    ):
        with pytest.raises(FoucaultError, match=said.replace("?", r"\?")):
            plans.orders(name)
    with pytest.raises(FoucaultError, match="0 cycles: at least one"):
        plans.orders("published", 0)


def test_the_file_of_stops(tmp_path: Path) -> None:
    path = tmp_path / "stops.csv"
    plans.write_stops(plans.two_stage(0.2), 650.0, 10.0, path)
    lines = path.read_text().splitlines()
    assert lines[0] == "index (deg),dwell (s),counted from"
    assert lines[1] == "0.000000,30.000,forward" and lines[-1] == "270.000000,240.000,north"
    with pytest.raises(FoucaultError, match="'continuous, 2 turns' has no stops to write"):
        plans.write_stops(plans.continuous(2), 60.0, 0.0, path)


@pytest.mark.thorough
def test_minutes_of_white_noise_follow_the_closed_form() -> None:
    task = replace(TASK, accuracy=np.radians(0.1), move=10.0)
    found = compare(task, ("published", "palindrome", "8 positions", "east-west pair"))
    still = 2 * ARW**2 / (np.radians(0.1) * EARTH_RATE * np.cos(LATITUDE)) ** 2
    moves = {"published": 3, "palindrome": 6, "8 positions": 7}
    for row in found.rows[:3]:
        assert row.needed == pytest.approx(still + 10.0 * moves[row.order.name], rel=2e-3)
        assert row.at is not None and row.at.sd == pytest.approx(np.radians(0.1), rel=1e-3)
    # The guessed rough heading is off by 2 deg: 1 / cos^2 of it, in time.
    assert found.rows[3].needed == pytest.approx(still / 2 + 10.0, rel=4e-3)
    assert found.best.order is plans.PALINDROME
    assert "linear drift" in found.reason
    assert found.beyond is found.rows[3]
    able = compare(replace(task, rough_sd=0.01), ("palindrome", "east-west pair"))
    assert able.best.order is plans.PAIR


def test_two_stages_come_near_the_floor() -> None:
    task = replace(TASK, total=300.0, move=0.0)
    row = compare(task, ("two-stage",)).rows[0]
    floor = ARW / np.sqrt(300.0) / (EARTH_RATE * np.cos(LATITUDE))
    assert floor < row.sd < 1.06 * floor
    share = float(row.order.share[:4].sum())  # type: ignore[union-attr]
    assert share * 300.0 / 4 >= 5.0  # every stop is long enough
    assert at_time(plans.two_stage(0.1), 300.0, task).sd == pytest.approx(
        floor * np.sqrt(2 / 1.9), rel=1e-3
    )


def test_slow_noise_sets_a_floor_and_repeating_helps() -> None:
    walk = units.parse("0.05 deg/h/sqrt(h)", "rate random walk")
    gyro = replace(NOISE.gyro, random_walk=walk)
    conditions = replace(TASK.conditions, noise=ImuNoise(NOISE.accel, gyro))
    task = Task(conditions, accuracy=np.radians(0.02))
    found = compare(task, ("published",))
    row = found.rows[0]
    assert row.needed == inf and row.floor is not None
    assert row.floor.sd > np.radians(0.02) and row.limit == "gyro drift"
    assert found.repeats is not None and found.repeats[1] < row.sd
    other = compare(task, ("published",), cycles=found.repeats[0]).rows[0]
    assert other.floor is None or other.floor.sd < row.floor.sd
    slower = compare(replace(TASK, accuracy=np.radians(1e-4)), ("published",)).rows[0]
    assert slower.limit == "noise in 86400 s"  # it is only a matter of time
    # More time than that of the floor makes it worse.
    assert at_time(plans.PUBLISHED, 4 * row.floor_time, task).sd > row.floor.sd


def test_what_cannot_be_done() -> None:
    with pytest.raises(FoucaultError, match="In 20 s no order has the time for its moves"):
        compare(replace(TASK, total=20.0), ("published", "palindrome"))
    unknown = replace(TASK.conditions, latitude_known=False)
    found = compare(Task(unknown, total=600.0, rough_sd=0.02), ("published", "east-west pair"))
    assert found.rows[1].why == "the latitude must be known" and found.rows[1].sd == inf
    assert found.best is found.rows[0]
    short = compare(replace(TASK, total=60.0), ("published", "palindrome")).rows[1]
    assert short.why == "too short for its stops"


@pytest.mark.parametrize("name", ["9" * 5000, "9" * 5000 + " positions", "continuous \u00b2"])
def test_a_number_that_nobody_means(name):
    with refuses("north_plan.order"):
        plans.orders(name)
