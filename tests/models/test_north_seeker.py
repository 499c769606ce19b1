"""The north seeker: printed equations, and every coefficient in its place."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT
from foucault.models.north_seeker import (
    FORCE,
    RATE_LEVEL,
    RATE_TILTED,
    SEEKER,
    Compensation,
    attitude,
    earth_rate_b,
    up_b,
)
from foucault.simulate.north import Placement
from make_dwells import FOUR, attitudes, errors, four_numbers, make_dwells, size

POSES = attitudes(40, 80.0)
PSI, THETA, GAMMA = POSES.T
LATITUDE = np.random.default_rng(3).uniform(-1.5, 1.5, 40)

# Which of the four numbers a coefficient acts on, and what it is multiplied by.
PLACES = {
    "gyro.bias.x": (0, "one"), "gyro.bias.y": (1, "one"),
    "gyro.scale.x": (0, "wx"), "gyro.scale.y": (1, "wy"),
    "gyro.misalignment.xy": (0, "wy"), "gyro.misalignment.xz": (0, "wz"),
    "gyro.misalignment.yx": (1, "wx"), "gyro.misalignment.yz": (1, "wz"),
    "accel.bias.x": (2, "one"), "accel.bias.y": (3, "one"),
    "accel.scale.x": (2, "fx"), "accel.scale.y": (3, "fy"),
    "accel.misalignment.yx": (3, "fx"),
}  # fmt: skip


def truth():
    g = 9.81
    return earth_rate_b(PSI, THETA, GAMMA, LATITUDE), g * up_b(THETA, GAMMA)


def compensation(values):
    names = tuple(n for n in SEEKER.names if n in values)
    vector = CoefficientVector(SEEKER.subset(names), np.array([values[n] for n in names]))
    return Compensation(vector)


def test_the_earths_rate_is_equations_6_to_8():
    st, ct, sg, cg = np.sin(THETA), np.cos(THETA), np.sin(GAMMA), np.cos(GAMMA)
    sf, cf, sl, cl = np.sin(PSI), np.cos(PSI), np.sin(LATITUDE), np.cos(LATITUDE)
    want = np.stack([
        -cg * sf * cl + sg * st * cf * cl - sg * ct * sl,
        ct * cf * cl + st * sl,
        -sg * sf * cl - cg * st * cf * cl + cg * ct * sl,
    ], 1)  # fmt: skip
    found = earth_rate_b(PSI, THETA, GAMMA, LATITUDE) / EARTH_RATE
    np.testing.assert_allclose(found, want, atol=1e-15)


def test_up_is_minus_equations_9_to_11():
    st, ct, sg, cg = np.sin(THETA), np.cos(THETA), np.sin(GAMMA), np.cos(GAMMA)
    gravity = np.stack([sg * ct, -st, -cg * ct], 1)
    np.testing.assert_allclose(up_b(THETA, GAMMA), -gravity, atol=1e-15)


def test_the_attitude_is_three_turns_one_after_the_other():
    C = attitude(PSI, THETA, GAMMA)
    want = np.array([Placement("", *pose).attitude.T for pose in POSES])
    np.testing.assert_allclose(C, want, atol=1e-15)
    np.testing.assert_allclose(C @ np.swapaxes(C, 1, 2), np.broadcast_to(np.eye(3), C.shape),
                               atol=1e-15)  # fmt: skip


def test_plain_cases():
    """Facing east and level, north is to the left; nose up, forward reads up; right down, -x."""
    east = earth_rate_b(*np.radians([[90.0], [0.0], [0.0], [0.0]]))[0] / EARTH_RATE
    np.testing.assert_allclose(east, [-1.0, 0.0, 0.0], atol=1e-15)
    nose, right = up_b(*np.radians([[30.0, 0.0], [0.0, 30.0]]))
    np.testing.assert_allclose(nose, [0.0, 0.5, np.sqrt(0.75)], atol=1e-15)
    np.testing.assert_allclose(right, [-0.5, 0.0, np.sqrt(0.75)], atol=1e-15)


def test_it_has_these_coefficients_and_no_others():
    assert set(PLACES) == set(SEEKER.names) == {*RATE_TILTED, *FORCE}
    assert set(RATE_TILTED) - set(RATE_LEVEL) == {"gyro.misalignment.xz", "gyro.misalignment.yz"}
    assert set(SEEKER.names) <= set(LAYOUT.names)


@pytest.mark.parametrize("name", SEEKER.names)
def test_one_coefficient_changes_exactly_its_number(name):
    w, f = truth()
    value = size(name)
    changed = compensation({name: value}).predict(w, f) - Compensation().predict(w, f)
    by = {"one": np.ones(40)} | {f"w{a}": w[:, k] for k, a in enumerate("xyz")}
    by |= {f"f{a}": f[:, k] for k, a in enumerate("xyz")}
    number, factor = PLACES[name]
    want = np.zeros((40, 4))
    want[:, number] = value * by[factor]
    scale = np.array([EARTH_RATE, EARTH_RATE, 10.0, 10.0])
    np.testing.assert_allclose(changed / scale, want / scale, atol=1e-15)


@pytest.mark.parametrize("names", [SEEKER.names, RATE_LEVEL, FORCE, ()])
def test_slopes_are_those_of_the_prediction(names):
    w, f = truth()
    ours = errors(tuple(n for n in SEEKER.names if n in names))
    slopes = ours.slopes(w, f)
    assert slopes.shape == (40, 4, len(names))
    c = ours.coefficients
    for k, name in enumerate(c.names):
        ends = []
        for sign in (1.0, -1.0):
            values = c.values.copy()
            values[k] += sign * size(name)
            ends.append(Compensation(CoefficientVector(c.layout, values)).predict(w, f))
        numeric = (ends[0] - ends[1]) / (2 * size(name))
        # The prediction is linear: nothing but rounding, of 1e-16 times g over the step.
        np.testing.assert_allclose(slopes[..., k], numeric, atol=1e-11, rtol=1e-9)


def test_predictions_are_those_of_rotations_and_matrices():
    ours = errors()
    latitude = 0.7
    w = earth_rate_b(PSI, THETA, GAMMA, np.full(40, latitude))
    from foucault.models.earth import gravity

    want = four_numbers(POSES, latitude, ours)
    found = ours.predict(w, gravity(latitude) * up_b(THETA, GAMMA))
    np.testing.assert_allclose(found[:, :2], want[:, :2], atol=1e-19)
    np.testing.assert_allclose(found[:, 2:], want[:, 2:], atol=1e-14)


def test_rows_of_one_set_up():
    dwells = make_dwells(attitudes(3), 0.7, offset=1e-6)
    one = dwells.of(1)
    assert len(dwells) == 12 and len(one) == 4 and set(one.setup) == {1}
    np.testing.assert_allclose(np.degrees(one.index), FOUR)
    np.testing.assert_array_equal(one.gyro, dwells.gyro[4:8])
    np.testing.assert_array_equal(one.accel, dwells.accel[4:8])
    assert one.names == dwells.names and make_dwells(POSES[:2], 0.7, accel=None).of(0).accel is None
