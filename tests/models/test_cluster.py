"""The torqued cluster: printed matrices, cases worked by hand, and its kernels."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.kernels import cluster as kernels
from foucault.models import imu, magnetometer, size_effect
from foucault.models.cluster import (
    CONSTANTS,
    LAYOUT,
    SOURCE_SYMBOLS,
    ClusterModel,
    angle_rates,
    angles_of,
    attitude_of,
    normalised,
)
from foucault.models.imu import ImuModel
from foucault.models.layouts import EVERY, TIES, is_cluster, kind_of, model_of
from foucault.models.rotation import exp
from foucault.tables import AXES, Log
from make_cluster import DEG_H, UG, G, make_cluster, one_error
from refusals import refuses

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def _kernel(form, name):
    function = getattr(kernels, name)
    return function if form == "compiled" else function.py_func


# -- names and signs -----------------------------------------------------------------------------


def by_symbol(model):
    """The errors of a cluster in the symbols of the source."""
    vector = model.coefficients()
    return {
        symbol: sign * vector.value(name)
        for name, (symbol, sign) in SOURCE_SYMBOLS.items()
        if name in vector.layout
    }


def test_every_name_has_one_symbol_of_the_source():
    assert set(SOURCE_SYMBOLS) == set(LAYOUT.names)
    symbols = [symbol for symbol, _ in SOURCE_SYMBOLS.values()]
    assert len(set(symbols)) == 45
    assert all(abs(sign) == 1 for _, sign in SOURCE_SYMBOLS.values())


@pytest.mark.parametrize("seed", range(3))
def test_axes_are_the_printed_matrices(seed):
    model = make_cluster(seed)
    s = by_symbol(model)
    printed = [
        [[1, s["Dxy"], -s["Dxz"]], [-s["Dxy"], 1, 0], [s["Dxz"], 0, 1]],
        [[-s["Dyx"], 1, s["Dyz"]], [1, s["Dyx"], 0], [0, s["Dyz"], -1]],
        [[s["Dzy"], -s["Dzx"], 1], [1, 0, -s["Dzy"]], [0, 1, s["Dzx"]]],
    ]
    np.testing.assert_array_equal(model.gyro_axes, printed)
    T = [[1, s["Dxy"], -s["Dxz"]], [-s["Dyx"], 1, s["Dyz"]], [s["Dzy"], -s["Dzx"], 1]]
    np.testing.assert_array_equal(model.input_axes, T)
    rows = [[1, 0, 0], [-s["th_yz"], 1, 0], [s["th_zy"], -s["th_zx"], 1]]
    np.testing.assert_array_equal(np.eye(3) + model.accel_misalignment, rows)


@pytest.mark.parametrize("seed", range(3))
def test_drift_and_readings_are_the_printed_equations(seed):
    """Equations (10), (12), (16) and (21) with the symbols of the source."""
    model = make_cluster(seed)
    s = by_symbol(model)
    rng = np.random.default_rng(seed)
    f = rng.standard_normal(3)
    command = 1e-3 * rng.standard_normal(3)
    eps, said = np.empty(3), np.empty(3)
    rows = [[1, 0, 0], [-s["th_yz"], 1, 0], [s["th_zy"], -s["th_zx"], 1]]
    for i, a in enumerate(AXES):
        I, O, S = model.gyro_axes[i] @ f  # noqa: E741
        per_g = [s[f"kg1{j}{a}"] * G for j in (1, 2, 3)]
        per_g2 = [s[f"kg3{j}{a}"] * G**2 for j in (1, 2, 3)]
        eps[i] = s[f"kg0{a}"] + np.dot(per_g, (I, O, S)) + np.dot(per_g2, (I * O, I * S, O * S))
        W = G * np.dot(rows[i], f)
        said[i] = s[f"ka0{a}"] + (1 + s[f"ka1{a}"]) * W + s[f"ka2{a}"] * W**2
    np.testing.assert_allclose(model.drift_rate(G * f), eps, rtol=1e-13, atol=1e-20)
    np.testing.assert_allclose(model.read(G * f), said, rtol=1e-14, atol=1e-14)
    K = np.diag([s[f"dK{a}"] for a in AXES])
    w = np.linalg.solve(model.input_axes, (np.eye(3) + K) @ command + eps)
    np.testing.assert_allclose(model.rate(command, G * f), w, rtol=1e-13, atol=1e-20)


def test_layouts_know_every_name_once():
    assert len(set(EVERY.names)) == len(EVERY)
    every = (imu.LAYOUT, size_effect.LAYOUT, LAYOUT, TIES, magnetometer.LAYOUT)
    assert set(EVERY.names) == {name for layout in every for name in layout.names}
    assert kind_of("gyro.drift_input_spin.y") == "g-squared sensitivity"
    assert kind_of("accel.bias.x") == "specific force"
    for layout in every:  # what two models share means the same in both
        assert all(kind_of(c.name) == c.kind for c in layout.coefficients)
    with refuses("coefficient.unknown", match=r"Did you mean 'gyro.drift.x'"):
        kind_of("gyro.drft.x")


def test_a_model_is_told_by_its_coefficients():
    whole = CoefficientVector(LAYOUT, np.arange(45.0))
    assert is_cluster(whole)
    model = model_of(whole)
    assert isinstance(model, ClusterModel)
    np.testing.assert_array_equal(model.coefficients().values, np.arange(42.0))
    assert isinstance(model_of(CoefficientVector.zeros(imu.LAYOUT)), ImuModel)


# -- cases worked by hand ------------------------------------------------------------------------

# What each gyro has along input, output and spin axis with x, y or z of the cluster up.
ALONG = {"x": ("I", "O", "O"), "y": ("O", "I", "S"), "z": ("S", "-S", "I")}


@pytest.mark.parametrize("up", AXES)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_drift_with_an_axis_up_or_down(up, sign):
    model = ClusterModel(
        drift=DEG_H * np.array([1.0, 2.0, 3.0]),
        drift_g=DEG_H / G * np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]]),
        drift_g2=np.full((3, 3), 5 * DEG_H / G**2),  # no product where only one component is
    )
    f = sign * G * np.eye(3)[AXES.index(up)]
    want = [
        model.drift[i]
        + sign * (-1 if "-" in word else 1) * G * model.drift_g[i, "IOS".index(word[-1])]
        for i, word in enumerate(ALONG[up])
    ]
    np.testing.assert_allclose(model.drift_rate(f), want, rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "f", "want"),
    [
        ("gyro.drift_input_output.x", (1, 1, 0), [0.5, 0, 0]),
        ("gyro.drift_input_spin.x", (1, 0, 1), [0.5, 0, 0]),
        ("gyro.drift_output_spin.x", (0, 1, 1), [0.5, 0, 0]),
        ("gyro.drift_input_output.y", (1, 1, 0), [0, 0.5, 0]),
        ("gyro.drift_input_spin.y", (0, 1, 1), [0, -0.5, 0]),
        ("gyro.drift_output_spin.y", (1, 0, 1), [0, -0.5, 0]),
        ("gyro.drift_input_output.z", (1, 0, 1), [0, 0, 0.5]),
        ("gyro.drift_input_spin.z", (0, 1, 1), [0, 0, 0.5]),
        ("gyro.drift_output_spin.z", (1, 1, 0), [0, 0, 0.5]),
    ],
)
def test_drift_by_products_at_45_degrees(name, f, want):
    model = one_error(name, DEG_H / G**2)
    rate = model.drift_rate(G * np.array(f) / np.sqrt(2))
    np.testing.assert_allclose(rate, DEG_H * np.array(want), atol=1e-22)


def test_each_accelerometer_error_reads_what_it_says():
    f = G * np.array([0.6, 0.0, 0.8])
    for name, value, want in (
        ("accel.bias.y", 100 * UG, [0, 100 * UG, 0]),
        ("accel.scale.x", 1e-4, [6e-5 * G, 0, 0]),
        ("accel.misalignment.yx", 1e-4, [0, 6e-5 * G, 0]),
        ("accel.misalignment.zx", 1e-4, [0, 0, 6e-5 * G]),
        ("accel.quadratic.z", 100 * UG / G**2, [0, 0, 64 * UG]),
    ):
        off = one_error(name, value).read(f) - f
        np.testing.assert_allclose(off, want, atol=2e-15)


def test_a_lever_arm_feels_centripetal_and_euler_acceleration():
    w, a, r = np.radians(0.1), np.radians(0.1), 0.05
    model, f = ClusterModel(), np.zeros(3)
    along = model.read(f, np.array([0, 0, w]), r * np.eye(3))
    np.testing.assert_allclose(along, [-(w**2) * r, -(w**2) * r, 0], rtol=1e-15)
    assert abs(along[0]) / UG == pytest.approx(0.0155, abs=5e-5)  # as the source says
    # x at an arm along z, turned about y: no arm along its own axis, all of the Euler term.
    arms = np.array([[0, 0, r], [0, 0, 0], [0, 0, 0]])
    euler = model.read(f, np.zeros(3), arms, np.array([0, a, 0]))
    np.testing.assert_allclose(euler, [a * r, 0, 0], rtol=1e-15)
    assert euler[0] / UG == pytest.approx(8.9, abs=0.01)  # 0.1 deg/s reached in 1 s
    # With arms along their own axes the Euler term has no component along the input axis.
    own = model.read(f, np.zeros(3), r * np.eye(3), np.array([a, 2 * a, 3 * a]))
    np.testing.assert_array_equal(own, np.zeros(3))
    misaligned = one_error("accel.misalignment.yx", 1e-3).read(
        f, np.zeros(3), np.array([[0, 0, 0], [0, 0, r], [0, 0, 0]]), np.array([0, a, 0])
    )
    np.testing.assert_allclose(misaligned, [0, 1e-3 * a * r, 0], rtol=1e-15)


# -- round trips ---------------------------------------------------------------------------------


def test_matrices_and_coefficients_are_the_same():
    model = make_cluster(3)
    vector = model.coefficients()
    assert vector.names == CONSTANTS.names
    again = ClusterModel.from_coefficients(vector)
    np.testing.assert_array_equal(again.coefficients().values, vector.values)
    for name in CONSTANTS.names:
        assert one_error(name, 0.25).coefficients().value(name) == 0.25
        assert np.count_nonzero(one_error(name, 0.25).coefficients().values) == 1


def test_packed_is_the_model_where_gravity_is_one():
    """In units of local g the same equations hold with g = 1."""
    model, g = make_cluster(4), 9.78
    unit = ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, model.packed(g)))
    f = np.array([0.3, -0.5, 0.8])
    np.testing.assert_allclose(unit.drift_rate(f), model.drift_rate(g * f), rtol=1e-13)
    np.testing.assert_allclose(g * unit.read(f), model.read(g * f), rtol=1e-14)
    values = model.coefficients().values
    np.testing.assert_allclose(model.packed(g) / normalised(g), values, rtol=1e-15)


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_compensation_is_the_inverse(size):
    model = make_cluster(5, size)
    rng = np.random.default_rng(6)
    f = rng.standard_normal((200, 3))
    f *= G / np.linalg.norm(f, axis=1)[:, None]
    command = 2e-3 * rng.standard_normal((200, 3))
    f_p, w_p = model.compensate(model.read(f), command)
    np.testing.assert_allclose(f_p, f, atol=2e-14)
    np.testing.assert_allclose(w_p, model.rate(command, f), rtol=1e-12, atol=1e-19)


def test_apply_takes_the_errors_off_a_log():
    model, time = make_cluster(7), np.arange(20.0)
    rng = np.random.default_rng(8)
    f, command = G * rng.standard_normal((20, 3)), 1e-3 * rng.standard_normal((20, 3))
    out = model.apply(Log(time, command, model.read(f)))
    np.testing.assert_allclose(out.accel, f, atol=1e-13)
    np.testing.assert_allclose(out.gyro, model.rate(command, f), rtol=1e-12, atol=1e-18)
    alone = model.apply(Log(time, None, model.read(f)))
    assert alone.gyro is None
    np.testing.assert_allclose(alone.accel, f, atol=1e-13)
    with refuses("apply.needs_accel", "no accelerometer columns"):
        model.apply(Log(time, command, None))


# -- attitude ------------------------------------------------------------------------------------


def passive(axis, x):
    """M_axis(x) of the source."""
    return exp(-x * np.eye(3)[axis])


def test_attitude_is_the_printed_product():
    angles = np.random.default_rng(9).uniform(-3, 3, (20, 3))
    for a in angles:
        C_p_to_nue = passive(0, a[0]) @ passive(1, a[1]) @ passive(2, a[2])
        east_north_up = C_p_to_nue[[2, 0, 1]]
        np.testing.assert_allclose(attitude_of(a), east_north_up.T, atol=1e-15)
    np.testing.assert_array_equal(attitude_of(np.zeros(3)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    np.testing.assert_array_equal(attitude_of(angles), [attitude_of(a) for a in angles])


def test_angles_come_back():
    rng = np.random.default_rng(10)
    angles = rng.uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (200, 3))
    np.testing.assert_allclose(angles_of(attitude_of(angles)), angles, atol=1e-13)
    C = exp(rng.standard_normal((50, 3)))
    np.testing.assert_allclose(attitude_of(angles_of(C)), C, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_angle_rates_are_those_of_the_attitude(seed):
    rng = np.random.default_rng(seed)
    angles, w = rng.uniform(-1.2, 1.2, 3), rng.standard_normal(3)
    h = 1e-5
    later, before = (angles_of(exp(-s * h * w) @ attitude_of(angles)) for s in (1, -1))
    np.testing.assert_allclose((later - before) / (2 * h), angle_rates(angles) @ w, atol=1e-8)


# -- kernels -------------------------------------------------------------------------------------


@FORMS
@pytest.mark.parametrize("seed", range(3))
def test_kernels_are_the_model(form, seed):
    model, g = make_cluster(seed, 10.0), 9.79
    theta = model.packed(g)
    rng = np.random.default_rng(seed)
    f, arms = rng.standard_normal(3), 0.1 * rng.standard_normal((3, 3))
    command, a = 1e-2 * rng.standard_normal(3), 1e-3 * rng.standard_normal(3)
    Ti = np.empty((3, 3))
    _kernel(form, "inverse_input_axes")(theta, Ti)
    np.testing.assert_allclose(Ti, np.linalg.inv(model.input_axes), rtol=1e-13, atol=1e-17)
    drift = _kernel(form, "drift_rates")(theta, *f)
    np.testing.assert_allclose(drift, model.drift_rate(g * f), rtol=1e-13)
    w = _kernel(form, "actual_rate")(theta, Ti, *command, *f)
    np.testing.assert_allclose(w, model.rate(command, g * f), rtol=1e-13)
    w = np.array([0.3, -0.2, 0.5])
    said = _kernel(form, "readings")(theta, *f, *w, *a, arms, g)
    np.testing.assert_allclose(g * np.array(said), model.read(g * f, w, arms, a), rtol=1e-13)
    rows = np.eye(3) + model.accel_misalignment
    want = [rows[k] @ (f + (np.cross(w, np.cross(w, r)) + np.cross(a, r)) / g)
            for k, r in enumerate(arms)]  # fmt: skip
    np.testing.assert_allclose(
        _kernel(form, "inputs")(theta, *f, *w, *a, arms, g), want, rtol=1e-13
    )
