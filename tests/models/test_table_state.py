"""What readings on a table must be: slopes against differences, values against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.models import turntable
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import Readings
from foucault.models.rotation import exp
from foucault.models.turntable import Angles, Free, State, Trust, Unknowns, moved, predict, tangents

SITE = Site(9.81, np.radians(48.0))
NAMES = tuple(
    n for n in LAYOUT.names if n.split(".")[1] not in ("asymmetry", "cubic", "deflection")
)
N = 6
SPIN = np.array([False, False, True, True, False, True])


def geometry(rng, *, free=False, position=True, heading=True, common=None):
    if free:
        o = rng.normal(size=(N, 3))
        return Free(o / np.linalg.norm(o, axis=1, keepdims=True), 5e-5)
    sds = np.full(6, 0.1) if common is None else common
    trust = Trust(sds, 0.02 * position, SITE.latitude)
    angles = rng.uniform(-np.pi, np.pi, (N, 3))
    angles[:, 2] = rng.choice([-1, 1], N) * rng.uniform(0.3, 1.2, N)
    # Away from where the inner axis is vertical: there its angle does nothing.
    angles[:, 1] = rng.choice([0, np.pi], N) + rng.uniform(-1.1, 1.1, N)
    mounting = exp(rng.normal(size=3) * 0.2)
    return Angles(
        angles, SPIN, trust, mounting, (sds > 0) * rng.normal(size=6) * 0.05,
        position * rng.normal(size=(N, 2)) * 0.02, 0.7 if heading else None,
    )  # fmt: skip


def model(rng, size=0.05):
    return ImuModel(
        np.eye(3) + size * rng.normal(size=(3, 3)), size * rng.normal(size=3),
        size * 1e-2 * rng.normal(size=(3, 6)), np.eye(3) + size * rng.normal(size=(3, 3)),
        size * 0.1 * rng.normal(size=3), size * 1e-2 * rng.normal(size=(3, 3)),
    )  # fmt: skip


def readings(rng):
    eye = np.broadcast_to(np.eye(3), (N, 3, 3))
    rate = np.where(SPIN, rng.choice([-1.0, 1.0], N) * rng.uniform(0.5, 2.0, N), 0.0)
    none = np.zeros((N, 3))
    return Readings(none, rate, rate, np.zeros(N), np.ones(N), none, none, eye, eye)


def state(seed, level, **kind):
    rng = np.random.default_rng(seed)
    return (
        State(model(rng), geometry(rng, **kind), rng.normal(size=3), 0.01 * level),
        readings(rng),
    )


def both(prediction):
    return np.concatenate([prediction.accel / 10, prediction.gyro], axis=1)


KINDS = {
    "free": ({"free": True}, True),
    "angles": ({}, False),
    "angles, no position errors": ({"position": False}, False),
    "angles, heading unknown": ({"heading": False}, False),
    "angles, some errors": ({"common": np.array([0.1, 0, 0, 0.1, 0, 0.1])}, False),
}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_those_of_the_values(kind, seed):
    make, level = KINDS[kind]
    at, r = state(seed, level, **make)
    unknowns = Unknowns(NAMES, True, level)
    got = predict(at, r, SITE, unknowns)
    slope = np.concatenate([got.accel_slope / 10, got.gyro_slope], axis=1)
    assert slope.shape[2] == unknowns.before_geometry + len(at.geometry.prior()[0])
    for k in range(slope.shape[2]):
        step = np.zeros(slope.shape[2])
        step[k] = 3e-6  # large enough that directions are followed straight (`STRAIGHT`)
        a, b = (
            both(predict(moved(at, s * step, unknowns), r, SITE, unknowns)) for s in (1.0, -1.0)
        )
        np.testing.assert_allclose((a - b) / 6e-6, slope[:, :, k], atol=2e-8, err_msg=f"{k}")


def test_an_error_of_the_plumb_is_in_the_slope_of_spins_too():
    at, r = state(3, False)
    unknowns = Unknowns((), False, False)
    got = predict(at, r, SITE, unknowns)
    along = np.einsum("ni,ni->n", got.w_b, at.geometry.directions())
    earth_t = turntable.earth_rate_t(SITE.latitude, 0.7)
    tilt = Rotation.from_euler("x", at.geometry.common[0]) * Rotation.from_euler(
        "y", at.geometry.common[1]
    )
    outer = tilt.apply([0, 0, 1])
    np.testing.assert_allclose(along[SPIN], (r.rate + outer @ earth_t)[SPIN], rtol=1e-14)
    weight = np.einsum("ni,ni->n", got.f_b, at.geometry.directions())
    np.testing.assert_allclose(weight[SPIN], 9.81 * outer[2], rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(got.f_b[~SPIN], axis=1), 9.81, rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(got.w_b[~SPIN], axis=1), EARTH_RATE, rtol=1e-13)


def test_rates_at_rest_are_those_of_a_product_of_rotations():
    at, r = state(4, False)
    g, got = at.geometry, predict(at, r, SITE, Unknowns((), False, False))
    earth = turntable.earth_rate_t(SITE.latitude, 0.7)
    for k in np.flatnonzero(~SPIN):
        outer, middle, inner = g.readings_angles[k]
        x0, y0, p_mo, p_im, z_m, z_i = g.common
        C_tk = (
            Rotation.from_euler("x", x0) * Rotation.from_euler("y", y0)
            * Rotation.from_euler("z", outer) * Rotation.from_euler("y", p_mo)
            * Rotation.from_euler("x", middle + z_m + g.position[k, 0])
            * Rotation.from_euler("z", p_im)
            * Rotation.from_euler("y", inner + z_i + g.position[k, 1])
        ).as_matrix()  # fmt: skip
        np.testing.assert_allclose(got.w_b[k], g.C_bk @ C_tk.T @ earth, atol=1e-19)
        np.testing.assert_allclose(got.f_b[k], 9.81 * g.C_bk @ C_tk.T[:, 2], atol=1e-14)


def test_first_order_readings_of_a_rest_with_the_inner_angle_zero():
    """Eq. (17) of the paper with C_bk = I - [th x], in units of g."""
    rng = np.random.default_rng(8)
    e = 1e-4
    th, plumb, b, dK = (e * rng.normal(size=n) for n in (3, 2, 3, 3))
    yx, zx, zy = e * rng.normal(size=3)
    a, g = rng.uniform(-np.pi, np.pi, (2, 40))
    x0, y0 = plumb
    matrix = np.array([[1 + dK[0], 0, 0], [yx, 1 + dK[1], 0], [zx, zy, 1 + dK[2]]])
    sin, cos = np.sin, np.cos
    wanted = np.stack([
        -y0 * cos(g) + x0 * sin(g) + th[2] * sin(a) - th[1] * cos(a) + b[0],
        (1 + dK[1]) * sin(a) + y0 * cos(a) * sin(g) + x0 * cos(a) * cos(g) + th[0] * cos(a) + b[1],
        zy * sin(a) + (1 + dK[2]) * cos(a) - y0 * sin(a) * sin(g) - x0 * sin(a) * cos(g)
        - th[0] * sin(a) + b[2],
    ], axis=1)  # fmt: skip
    n = len(a)
    common = np.array([x0, y0, 0, 0, 0, 0])
    rest = Angles(
        np.stack([g, a, np.zeros(n)], axis=1), np.zeros(n, bool),
        Trust(np.ones(6), 0.0, None), exp(-th), common, np.zeros((n, 2)), None,
    )  # fmt: skip
    zero, eye = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
    r = Readings(zero, zero[:, 0], zero[:, 0], zero[:, 0], zero[:, 0] + 1, zero, zero, eye, eye)
    site = Site(9.81, None)
    at = State(ImuModel(accel_matrix=matrix, accel_bias=9.81 * b), rest, np.zeros(3))
    got = predict(at, r, site, Unknowns((), False, False)).accel / 9.81
    # The rest is of second order: products of two of these errors, a dozen of them.
    assert np.abs(got - wanted).max() < 12 * (3 * e) ** 2


def test_tangents_are_unit_vectors_across():
    o = np.random.default_rng(1).normal(size=(20, 3))
    o /= np.linalg.norm(o, axis=1, keepdims=True)
    o[:3] = np.eye(3)
    t = tangents(o)
    frame = np.concatenate([o[:, :, None], t], axis=2)
    np.testing.assert_allclose(
        np.swapaxes(frame, 1, 2) @ frame, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-15
    )


def test_directions_move_by_the_size_of_the_step():
    free = state(5, True, free=True)[0].geometry
    step = np.zeros((N, 2))
    step[2] = [0.3, 0.4]
    new = free.moved(step.reshape(-1))
    turned = np.arccos(np.clip(np.sum(new.o * free.o, axis=1), -1, 1))
    assert turned[2] == pytest.approx(0.5, rel=1e-12)
    others = [0, 1, 3, 4, 5]
    np.testing.assert_allclose(new.o[others], free.o[others], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(new.o, axis=1), 1.0, rtol=1e-15)


def test_angles_follow_directions_along_straight_lines():
    g = state(6, False)[0].geometry
    step = np.random.default_rng(2).normal(size=3 + 6 + 2 * N + 1) * np.radians(1.0)
    straight = g.directions() + g.directions_slope() @ step
    straight /= np.linalg.norm(straight, axis=1, keepdims=True)
    new = g.moved(step)
    np.testing.assert_allclose(new.directions(), straight, atol=1e-12)
    # What all positions share took the step as it is; the angles made up for the rest.
    np.testing.assert_allclose(new.common, g.common + step[3:9], rtol=1e-14)
    np.testing.assert_allclose(new.C_bk, exp(-step[:3]) @ g.C_bk, atol=1e-15)
    plain = g.position + step[9:-1].reshape(N, 2)
    assert 1e-5 < np.abs(new.position - plain).max() < 1e-2


def test_directions_are_taken_over_by_the_angles():
    g = state(7, False)[0].geometry
    other = replace(g, position=g.position + np.radians(2.0) * np.ones((N, 2)))
    new = g.pointed(other.directions())
    np.testing.assert_allclose(new.directions(), other.directions(), atol=1e-13)
    np.testing.assert_allclose(new.position, other.position, atol=1e-12)


def test_an_inner_angle_without_effect_is_left_alone():
    g = state(8, False)[0].geometry
    angles = g.readings_angles.copy()
    angles[0, 1] = np.pi / 2  # the inner axis is vertical
    g = replace(g, readings_angles=angles, common=np.zeros(6), position=np.zeros((N, 2)))
    new = g.pointed(g.directions())
    assert np.abs(new.position).max() < 1e-12


def test_tiny_steps_add_up():
    g = state(9, False)[0].geometry
    step = np.full(3 + 6 + 2 * N + 1, 1e-9)
    new = g.moved(step)
    np.testing.assert_allclose(new.position - g.position, 1e-9, rtol=1e-6)
    assert new.heading == pytest.approx(0.7 + 1e-9, rel=1e-15)


def test_prior_is_on_the_errors_of_the_table_alone():
    g = state(10, False, common=np.array([0.1, 0, 0.3, 0.1, 0, 0.1]))[0].geometry
    value, sd = g.prior()
    assert g.used.tolist() == [0, 2, 3, 5]
    assert np.isinf(sd[:3]).all()  # mounting
    np.testing.assert_allclose(value[3:7] * sd[3:7], g.common[[0, 2, 3, 5]])
    np.testing.assert_allclose(sd[3:7], [0.1, 0.3, 0.1, 0.1])
    np.testing.assert_allclose(value[7:-1] * 0.02, g.position.reshape(-1))
    assert np.isinf(sd[-1])  # heading
    free = state(10, True, free=True)[0].geometry
    assert np.isinf(free.prior()[1]).all()


def test_a_step_moves_coefficients_lever_arm_and_level_in_that_order():
    at, _ = state(11, True, free=True)
    names = ("accel.bias.y", "gyro.g_sensitivity.xz")
    names = LAYOUT.subset(names).names
    step = np.concatenate([[0.1, 0.2], [1, 2, 3], [0.5], np.zeros(2 * N)])
    new = moved(at, step, Unknowns(names, True, True))
    assert new.model.accel_bias[1] == pytest.approx(at.model.accel_bias[1] + 0.1)
    assert new.model.g_sensitivity[0, 2] == pytest.approx(at.model.g_sensitivity[0, 2] + 0.2)
    np.testing.assert_allclose(new.lever_arm, at.lever_arm + np.array([1, 2, 3]))
    assert new.level == pytest.approx(at.level + 0.5)
    np.testing.assert_allclose(new.geometry.o, at.geometry.o, atol=1e-16)
