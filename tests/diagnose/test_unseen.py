"""What a session cannot tell in principle is said in words."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose.hand_rotated import unseen
from foucault.models.earth import Site
from foucault.models.rests_and_turns import Session
from foucault.tables import Log


def session(latitude: float | None, gyro: bool, first_rest: str | None) -> Session:
    time = np.arange(40) / 10
    zero = np.zeros((40, 3))
    source = {"description": {"accel": {"first_rest": first_rest} if first_rest else {}}}
    log = Log(time, zero if gyro else None, zero + np.array([0, 0, 9.81]), source=source)
    first, last = np.array([0, 20]), np.array([10, 30])
    return Session.reduce(log, first, last, Site(9.81, latitude))


@pytest.mark.parametrize("latitude", [None, 0.8])
@pytest.mark.parametrize("gyro", [True, False])
def test_earth_rate_is_unseen_only_by_gyros_without_a_latitude(latitude, gyro):
    words = " ".join(unseen(session(latitude, gyro, "z up"), 0.0))
    assert ("Earth's rotation" in words) == (gyro and latitude is None)


@pytest.mark.parametrize("declared", [None, "z up"])
def test_signs_are_unseen_until_the_first_rest_is_declared(declared):
    words = " ".join(unseen(session(0.8, True, declared), 0.0))
    assert ("the first rest is not declared" in words) == (declared is None)


def test_gravity_is_exact_or_has_its_uncertainty():
    assert "it was taken as exact" in unseen(session(0.8, True, "z up"), 0.0)[0]
    assert "its standard uncertainty, 40 mGal," in unseen(session(0.8, True, "z up"), 4e-4)[0]
