"""The chain of a table against rotations multiplied elsewhere, and the geometry it implies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.models import turntable
from foucault.models.earth import EARTH_RATE, earth_rate_n
from foucault.models.turntable import TableErrors, chain

RNG = np.random.default_rng(47)
ANGLES = RNG.uniform(-np.pi, np.pi, (7, 3))
COMMON = RNG.normal(size=6) * 0.1
POSITION = RNG.normal(size=(7, 2)) * 0.05

# The middle and inner angles of the icosahedron as they are printed, in degrees.
PRINTED = np.array(
    [[0, b] for b in (-31.7175, 211.7175, 148.2825, 31.7175)]
    + [[a, 0] for a in (58.2825, 121.7175, -58.2825, 238.2825)]
    + [[a, 90] for a in (148.2825, 211.7175, 31.7175, -31.7175)]
)


def product(angles, common, position):
    """Multiply the seven rotations one by one, written out from the definition of the table."""
    outer, middle, inner = angles
    x0, y0, p_mo, p_im, z_m, z_i = common
    turns = [
        ("x", x0), ("y", y0), ("z", outer), ("y", p_mo), ("x", middle + z_m + position[0]),
        ("z", p_im), ("y", inner + z_i + position[1]),
    ]  # fmt: skip
    out = Rotation.identity()
    for axis, angle in turns:
        out = out * Rotation.from_euler(axis, angle)
    return out.as_matrix()


def test_chain_is_the_product_of_its_seven_rotations():
    C_tk = chain(ANGLES, TableErrors.of(COMMON), POSITION).C_tk
    for k in range(len(ANGLES)):
        np.testing.assert_allclose(C_tk[k], product(ANGLES[k], COMMON, POSITION[k]), atol=1e-15)


def test_six_errors_keep_their_order_and_names():
    errors = TableErrors.of(COMMON)
    assert np.array_equal(errors.values, COMMON)
    named = dict(zip(turntable.COMMON, COMMON, strict=True))
    assert errors.plumb_y == named["table.plumb.y"]
    assert errors.middle_outer == named["table.orthogonality.middle_outer"]
    assert errors.inner_zero == named["table.zero.inner"]


def test_axes_are_what_small_errors_turn_the_case_about():
    at, e = chain(ANGLES, TableErrors.of(COMMON), POSITION), 1e-6

    def turned(which, step):
        angles, common, position = ANGLES.copy(), COMMON.copy(), POSITION.copy()
        if which == turntable.OUTER:
            angles[:, 0] += step
        else:
            common[turntable.COMMON_AXES.index(which)] += step
        return chain(angles, TableErrors.of(common), position).C_tk

    for which in range(7):
        a, b = turned(which, e), turned(which, -e)
        turn = Rotation.from_matrix(np.swapaxes(b, 1, 2) @ a).as_rotvec() / (2 * e)
        np.testing.assert_allclose(at.axes[:, :, which], turn, atol=1e-9)


def test_position_errors_turn_about_middle_and_inner_axis():
    e = 1e-6
    at = chain(ANGLES, TableErrors.of(COMMON), POSITION)
    for column, axis in enumerate((turntable.MIDDLE, turntable.INNER)):
        step = np.zeros((7, 2))
        step[:, column] = e
        a, b = (chain(ANGLES, TableErrors.of(COMMON), POSITION + s * step).C_tk for s in (1, -1))
        turn = Rotation.from_matrix(np.swapaxes(b, 1, 2) @ a).as_rotvec() / (2 * e)
        np.testing.assert_allclose(at.axes[:, :, axis], turn, atol=1e-9)


def test_up_and_outer_axis_in_case_axes():
    at = chain(ANGLES)
    np.testing.assert_allclose(at.up_k, turntable.up_k(ANGLES), atol=1e-15)
    np.testing.assert_allclose(at.outer_k, at.up_k, atol=1e-15)
    at = chain(ANGLES, TableErrors.of(COMMON), POSITION)
    up, outer = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    tilt = Rotation.from_euler("x", COMMON[0]) * Rotation.from_euler("y", COMMON[1])
    np.testing.assert_allclose(at.up_k, up @ at.C_tk, atol=1e-15)
    np.testing.assert_allclose(at.outer_k, tilt.apply(outer) @ at.C_tk, atol=1e-15)


def test_printed_angles_are_an_icosahedron():
    u = turntable.up_k(np.radians(np.column_stack([np.zeros(12), PRINTED])))
    inner = np.sort(u @ u.T, axis=1)
    one = 1 / np.sqrt(5)
    wanted = [-1] + [-one] * 5 + [one] * 5 + [1]
    # Angles printed to half of 1e-4 degrees.
    np.testing.assert_allclose(inner, np.tile(wanted, (12, 1)), atol=2 * np.radians(1e-4))
    m, n = 0.525731, 0.850651
    corners = {(s * m, 0.0, t * n) for s in (1, -1) for t in (1, -1)}
    corners |= {(0.0, s * n, t * m) for s in (1, -1) for t in (1, -1)}
    corners |= {(s * n, t * m, 0.0) for s in (1, -1) for t in (1, -1)}
    off = [min(np.linalg.norm(v - np.array(c)) for c in corners) for v in u]
    assert max(off) < 2e-6


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_elementary_rotations_are_active_and_right_handed(axis):
    angle = np.array([0.3, -2.0])
    got = turntable.elementary(axis, angle)
    np.testing.assert_allclose(
        got, Rotation.from_euler("xyz"[axis], angle[:, None]).as_matrix(), atol=1e-15
    )
    v, right = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    assert got[0] @ v @ right > 0


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, 2.3])
def test_earth_rate_in_table_axes(heading):
    latitude = np.radians(40.0)
    # Table y points to `heading`, clockwise from North: x to the right of it.
    y = np.array([np.sin(heading), np.cos(heading), 0.0])
    x = np.cross(y, [0.0, 0.0, 1.0])
    w = earth_rate_n(latitude)
    np.testing.assert_allclose(
        turntable.earth_rate_t(latitude, heading), [x @ w, y @ w, w[2]], atol=1e-20
    )


def test_whole_turns_about_up_leave_the_vertical_part_alone():
    latitude, rate = np.radians(-33.0), np.radians(np.array([10.0, -1.0]))
    h = turntable.mean_rate(rate, latitude)
    for one, wanted in zip(rate, h, strict=True):
        outer = 2 * np.pi * np.arange(64) / 64 * np.sign(one)
        angles = np.column_stack([outer, np.full(64, 0.7), np.full(64, -0.4)])
        C_tk = chain(angles).C_tk
        w = np.array([0, 0, one]) + turntable.earth_rate_t(latitude, 0.3)
        mean = np.einsum("nji,j->ni", C_tk, w).mean(axis=0)
        np.testing.assert_allclose(mean, wanted * turntable.up_k(angles[:1])[0], atol=1e-18)


def test_mean_rate_differs_from_the_instantaneous_norm_as_the_method_says():
    # |w|^2 = w_T^2 + w_e^2 + 2 w_T w_e sin L of one instant, against (w_T + w_e sin L)^2.
    for degrees, excess in ((10.0, 4.4e-8), (1.0, 4.3e-6), (0.1, 4.1e-4)):
        rate, sin = np.radians(degrees), np.sin(np.radians(45.0))
        instant = np.sqrt(rate**2 + EARTH_RATE**2 + 2 * rate * EARTH_RATE * sin)
        mean = turntable.mean_rate(np.array([rate]), np.radians(45.0))[0]
        assert instant / mean - 1 == pytest.approx(excess, rel=0.02)


def test_mean_force_of_a_spin_is_the_average_of_its_instants():
    gravity, h = 9.81, 0.7
    r = np.array([0.2, -0.1, 0.3])
    o = np.array([[0.6, 0.0, 0.8]])
    instants = []
    for a in 2 * np.pi * np.arange(32) / 32:
        about = Rotation.from_rotvec(a * o[0]).inv()  # the case turns, so what is fixed turns back
        up = about.apply(o[0])
        w = h * o[0]
        instants.append(gravity * up + np.cross(w, np.cross(w, r)))
    got = turntable.mean_force(o, np.array([h]), gravity, r)
    np.testing.assert_allclose(got[0], np.mean(instants, axis=0), atol=1e-14)


def test_a_tilted_axis_sees_another_share_of_the_earths_rate():
    # Averaged over a turn of the outer axis, the Earth's rate lies along that axis.
    common = np.zeros(6)
    common[:2] = np.radians([0.5, -1.0])
    latitude, heading = np.radians(45.0), 0.3
    angles = np.column_stack([2 * np.pi * np.arange(16) / 16, np.full(16, 1.0), np.full(16, 0.2)])
    at = chain(angles, TableErrors.of(common))
    mean = np.einsum("nji,j->ni", at.C_tk, turntable.earth_rate_t(latitude, heading)).mean(axis=0)
    o = at.outer_k[0]
    share = o @ mean
    np.testing.assert_allclose(mean, share * o, atol=1e-19)
    tilted = Rotation.from_euler("x", common[0]) * Rotation.from_euler("y", common[1])
    w_t = turntable.earth_rate_t(latitude, heading)
    assert share == pytest.approx(tilted.apply([0, 0, 1]) @ w_t, rel=1e-12)
    assert abs(share / (EARTH_RATE * np.sin(latitude)) - 1) > 1e-3
