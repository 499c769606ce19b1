"""The built-in motions of transfer alignment are what their page says."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.rotation import angles_of
from foucault.plans.transfer import PROFILES, transfer_profile
from foucault.simulate.motion import motion_of
from make_transfer_flight import DEG
from refusals import refuses


def moved(name: str):
    profile = transfer_profile(name)
    motion, _ = motion_of(profile.plan, profile.start)
    time = np.arange(0.0, profile.end, 0.1)
    at = motion.trajectory(time)
    return profile, motion, time, at


@pytest.mark.parametrize("name", PROFILES)
def test_it_is_calibrated_for_240_s_and_alone_for_600_s(name: str) -> None:
    profile, motion, time, at = moved(name)
    assert (profile.hand_over, profile.end, motion.end) == (240.0, 840.0, 840.0)
    outage = time > 240.0
    course = np.unwrap(np.arctan2(at.velocity_n[:, 0], at.velocity_n[:, 1]))
    assert np.ptp(course[outage]) > 45 * DEG  # turns in it
    speed = np.linalg.norm(at.velocity_n, axis=1)
    low, high = {"flight": (40, 55), "survey": (75, 85), "straight": (75, 75), "uav": (17, 26),
                 "ship": (5, 7)}[name]  # fmt: skip
    assert low - 0.01 < speed.min() and speed.max() < high + 0.01
    assert np.abs(at.angles[:, 2]).max() < 60 * DEG


def test_the_flight_is_as_hard_as_the_published_one() -> None:
    _, motion, time, at = moved("flight")
    later = motion.trajectory(np.minimum(time + 0.1, motion.end))
    hard = time < 100
    heading = np.abs(np.angle(np.exp(1j * (angles_of(later.C_nb) - at.angles)[:, 0])))
    velocity = np.linalg.norm(later.velocity_n - at.velocity_n, axis=1)
    assert heading[hard].max() == pytest.approx(1.9 * DEG, abs=0.1 * DEG)
    assert velocity[hard].max() == pytest.approx(1.5, abs=0.05)
    steady = (time > 100) & (time < 239)
    assert heading[steady].max() < 0.01 * DEG


def test_the_straight_run_does_nothing_before_the_hand_over() -> None:
    _, _, time, at = moved("straight")
    calibration = time < 240
    assert np.ptp(at.angles[calibration], axis=0).max() < 1e-12
    assert np.ptp(at.angles[~calibration, 2]) > 20 * DEG


def test_the_ship_rolls_while_it_turns() -> None:
    _, _, time, at = moved("ship")
    turning = (time > 75) & (time < 105)
    assert np.std(at.angles[turning, 2]) > 1.5 * DEG
    course = np.unwrap(at.angles[:, 0])
    assert course[1200] - course[600] == pytest.approx(60 * DEG, abs=1e-9)


def test_an_unknown_motion_is_refused() -> None:
    with refuses("transfer_plan.profile", "Did you mean 'survey'"):
        transfer_profile("survei")
