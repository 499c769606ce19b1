"""Simulated sessions on faces: what they read at rest, and what a turn adds up to."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.earth import EARTH_RATE, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.simulate.hand_rotated import simulate
from make_faces import SITE, TURN, short_plan

QUIET = ImuNoise()


def run(plan, **words):
    return simulate(plan, model=ImuModel(), noise=QUIET, site=SITE, rate=200.0, **words)


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_rests_read_gravity_and_the_earth(sampled):
    s = run(short_plan(seed=4), sampled=sampled)
    up = [(2, 1), (2, 1), (2, -1), (0, 1), (0, 1), (0, -1), (1, 1), (1, 1), (1, -1)]
    for j, (axis, sign) in enumerate(up):
        f = s.log.accel[s.first[j] : s.last[j]]
        w = s.log.gyro[s.first[j] : s.last[j]]
        np.testing.assert_allclose(f, np.tile(SITE.gravity * sign * np.eye(3)[axis], (len(f), 1)),
                                   atol=1e-12)  # fmt: skip
        np.testing.assert_allclose(w, np.tile(s.C_nb[j].T @ earth_rate_n(SITE.latitude),
                                              (len(w), 1)), atol=1e-17)  # fmt: skip


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_a_turn_adds_up_to_its_angle_and_the_earths(sampled):
    s = run(short_plan(seed=4), sampled=sampled)
    a, b = s.last[6], s.first[7]  # about y, y up
    total = s.log.gyro[a:b].sum(axis=0) * s.log.interval
    vertical = EARTH_RATE * np.sin(SITE.latitude) * (b - a) * s.log.interval
    assert total[1] == pytest.approx(TURN + vertical, abs=1e-9)
    # The turn starts and ends slowly: some of the horizontal rate stays, less than all of it.
    assert 0 < np.linalg.norm(total[[0, 2]]) < EARTH_RATE * 2.0


def test_attitude_after_a_turn_is_that_before():
    plan = short_plan(seed=1, placement_sd=0.01)
    np.testing.assert_allclose(plan.C_nb[1], plan.C_nb[0], atol=1e-12)
    # With errors of its own the turn ends elsewhere.
    off = short_plan(seed=1, placement_sd=0.01, level_sd=0.01, angle_sd=0.01)
    assert np.abs(off.C_nb[1] - off.C_nb[0]).max() > 1e-3


def test_errors_have_the_size_that_was_asked():
    sd, tilts, turned, level = 3e-3, [], [], []
    for seed in range(60):
        plan = short_plan(seed=seed, placement_sd=sd, level_sd=2 * sd, angle_sd=3 * sd)
        up = plan.C_nb[:, 2, :]
        tilts.append(np.array([up[2, [0, 1]], up[5, [1, 2]], up[8, [0, 2]]]))
        for j, axis in ((0, 2), (3, 0), (6, 1)):
            phi = plan.rotation[j]
            turned.append(np.linalg.norm(phi) - abs(TURN))
            about = -phi / np.linalg.norm(phi)
            level.append(np.delete(about - up[j], axis))
    for values, want in ((tilts, sd), (level, 2 * sd), (turned, 3 * sd)):
        assert np.sqrt(np.mean(np.square(values))) == pytest.approx(want, rel=0.2)
