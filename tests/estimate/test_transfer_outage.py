"""What errors at a hand-over make of the position later, against the motion they must cause."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.estimate.transfer import after_outage
from foucault.models.earth import Site
from foucault.navigate.strapdown import states_of
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment import Session, Settings
from foucault.procedures.transfer_alignment.session import moved, problem_on

SECONDS = 60.0


@pytest.fixture(scope="module")
def flown():
    plan = moved(Session(profile="straight", with_outage=False).motion, Site.at(0.8, 0.0))
    quiet = Session(message_rate=2.0)
    model = problem_on(plan, Beforehand(Settings(), quiet, Site.at(0.8, 0.0)), rate=10.0).model
    return model, model.about(model.start)


@pytest.mark.parametrize("degrees", [0.0, 90.0, 180.0, -90.0])
def test_a_bias_pulls_along_its_axis_after_the_turn(flown, degrees):
    model, free = flown
    L = after_outage(free, Settings().sensors, SECONDS, turn=np.radians(degrees))
    last = states_of(free.history[-1])
    C_nb = last["C_nb"]
    heading = np.arctan2(C_nb[0, 1], C_nb[1, 1]) + np.radians(degrees)
    forward = np.array([np.sin(heading), np.cos(heading)])
    right = np.array([np.cos(heading), -np.sin(heading)])
    to_n = last["C_nl"][:2, :2]
    for axis, way in (("x", right), ("y", forward)):
        moved_n = to_n @ L[:, model.layout.index(f"accel.bias.{axis}")]
        np.testing.assert_allclose(moved_n / (0.5 * SECONDS**2), way, atol=2e-3)
        # A gyro that turns too much about right lifts the nose it computes: gravity, as it is
        # computed, then pulls backward of it, and what it feels forward it takes for motion.
        drifted = to_n @ L[:, model.layout.index(f"gyro.bias.{axis}")]
        wanted = {"x": -forward, "y": right}[axis] * 9.80665 * SECONDS**3 / 6
        np.testing.assert_allclose(drifted / np.linalg.norm(wanted),
                                   wanted / np.linalg.norm(wanted), atol=5e-3)  # fmt: skip


def test_a_tilt_hides_its_bias_straight_on_and_no_longer_after_a_turn(flown):
    """A bias b forward and the tilt that makes up for it move nothing until the heading changes."""
    model, free = flown
    last, sensors = states_of(free.history[-1]), Settings().sensors
    x = np.zeros(len(model.names))
    x[model.layout.index("accel.bias.y")] = 1e-3
    C_lb = last["C_nl"].T @ last["C_nb"]
    pull = C_lb[:, 1] * 1e-3  # f_l x psi = -pull, f_l = g up
    x[0], x[1] = -pull[1] / 9.80665, pull[0] / 9.80665
    moved_m = [np.linalg.norm(after_outage(free, sensors, SECONDS, turn=a) @ x) for a in (0, np.pi)]
    assert moved_m[0] < 0.01 * moved_m[1] and 3.5 < moved_m[1] < 3.7  # 2 b t^2 / 2
