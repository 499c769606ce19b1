"""The IMU error model: what every coefficient does, forward and back, and gauges."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.models.imu import (
    LAYOUT,
    LINEAR_LOWER,
    Gauge,
    ImuModel,
)
from foucault.models.layouts import gravity_slope
from foucault.models.rotation import exp
from foucault.tables import AXES, Log
from make_session import model_of

AT = {a: i for i, a in enumerate(AXES)}
RNG = np.random.default_rng(20)
F = RNG.uniform(-12.0, 12.0, (50, 3))
W = RNG.uniform(-4.0, 4.0, (50, 3))


def _size(name: str) -> float:
    """A large but invertible value: a tenth of the signal, at |f| up to 12 and |w| up to 4."""
    second = ("quadratic", "cross", "g_sensitivity", "cubic", "deflection")
    return 1e-3 if name.split(".")[1] in second else 0.1


def _expected(name: str, value: float) -> tuple[np.ndarray, np.ndarray]:
    """What one coefficient adds to the readings, written out from its name."""
    accel, gyro = F.copy(), W.copy()
    triad, group, axes = name.split(".")
    out, true = (accel, F) if triad == "accel" else (gyro, W)
    o = AT[axes[0]]
    if group == "bias":
        out[:, o] += value
    elif group == "scale":
        out[:, o] += value * true[:, o]
    elif group == "misalignment":
        out[:, o] += value * true[:, AT[axes[1]]]
    elif group == "quadratic":
        out[:, o] += value * true[:, o] ** 2
    elif group == "cross":
        out[:, o] += value * true[:, AT[axes[1]]] * true[:, AT[axes[2]]]
    elif group == "asymmetry":
        out[:, o] += value * np.abs(true[:, o])
    elif group == "cubic":
        out[:, o] += value * true[:, o] ** 3
    elif group == "deflection":
        out[:, o] += value * F[:, AT[axes[2]]] * W[:, AT[axes[1]]]
    else:
        out[:, o] += value * F[:, AT[axes[1]]]
    return accel, gyro


@pytest.mark.parametrize("name", LAYOUT.names)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_coefficient_forward_and_back(name: str, sign: float) -> None:
    value = sign * _size(name)
    model = model_of({name: value})
    accel, gyro = model.measure(F, W)
    want_accel, want_gyro = _expected(name, value)
    # A few roundings of numbers near 10.
    np.testing.assert_allclose(accel, want_accel, rtol=0, atol=1e-14)
    np.testing.assert_allclose(gyro, want_gyro, rtol=0, atol=1e-14)
    f_b, w_b = model.compensate(accel, gyro)
    np.testing.assert_allclose(f_b, F, rtol=0, atol=2e-14)
    np.testing.assert_allclose(w_b, W, rtol=0, atol=2e-14)


def _everything() -> ImuModel:
    rng = np.random.default_rng(3)
    return model_of({n: _size(n) * 0.3 * rng.uniform(-1, 1) for n in LAYOUT.names})


def test_all_coefficients_at_once_invert_exactly() -> None:
    model = _everything()
    f_b, w_b = model.compensate(*model.measure(F, W))
    np.testing.assert_allclose(f_b, F, rtol=0, atol=5e-14)
    np.testing.assert_allclose(w_b, W, rtol=0, atol=5e-14)


def test_coefficients_and_matrices_are_two_forms_of_one_thing() -> None:
    model = _everything()
    again = ImuModel.from_coefficients(model.coefficients())
    for block in vars(model):
        np.testing.assert_allclose(getattr(again, block), getattr(model, block), atol=1e-16)
    assert model.coefficients(["gyro.scale.y"]).values[0] == pytest.approx(
        model.gyro_matrix[1, 1] - 1, abs=1e-16
    )


def test_unknown_coefficient_is_refused() -> None:
    with pytest.raises(FoucaultError, match=r"Did you mean 'gyro.bias.x'\?"):
        ImuModel().coefficients(["gyro.bais.x"])


def test_shapes_may_have_any_leading_axes_and_either_triad_may_be_missing() -> None:
    model = _everything()
    accel, gyro = model.measure(F.reshape(5, 10, 3), W.reshape(5, 10, 3))
    flat, _ = model.measure(F, W)
    np.testing.assert_allclose(accel.reshape(50, 3), flat, atol=1e-14)
    assert gyro.shape == (5, 10, 3)
    f_b, w_b = model.compensate(accel, None)
    assert w_b is None
    np.testing.assert_allclose(f_b, F.reshape(5, 10, 3), atol=5e-14)
    linear = model_of({"gyro.bias.x": 0.1})
    assert linear.compensate(None, W)[0] is None
    for name in ("gyro.g_sensitivity.xy", "gyro.deflection.xyz"):
        assert not linear.gyros_feel_force
        assert model_of({name: 1e-6}).gyros_feel_force
        with pytest.raises(ValueError, match="g-sensitivity or deflection needs the accelerometer"):
            model_of({name: 1e-6}).compensate(None, W)
    one = model.compensate(accel[0, 0], gyro[0, 0])
    np.testing.assert_allclose(one, [F[0], W[0]], atol=5e-14)


def test_apply_compensates_a_log_and_keeps_the_rest() -> None:
    model = _everything()
    accel, gyro = model.measure(F, W)
    log = Log(np.arange(50) * 0.01, gyro, accel, "increment")
    out = model.apply(log)
    np.testing.assert_allclose(out.accel, F, atol=5e-14)
    np.testing.assert_allclose(out.gyro, W, atol=5e-14)
    assert out.sampled == "increment"
    assert out.time is log.time


@pytest.mark.parametrize("gauge", list(Gauge))
def test_a_gauge_is_triangular_and_describes_the_same_instrument(gauge: Gauge) -> None:
    model = _everything()
    turned, C_cb = model.in_gauge(gauge)
    np.testing.assert_allclose(C_cb @ C_cb.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(C_cb) == pytest.approx(1.0)
    beyond = (
        np.triu(turned.accel_matrix, 1)
        if gauge is Gauge.LOWER
        else np.tril(turned.accel_matrix, -1)
    )
    np.testing.assert_allclose(beyond, 0, atol=1e-15)
    assert (np.diag(turned.accel_matrix) > 0).all()
    # x_c = C_cb x_b: the same motion in other axes gives the same readings.
    for got, want in zip(turned.measure(F @ C_cb.T, W @ C_cb.T), model.measure(F, W), strict=True):
        np.testing.assert_allclose(got, want, rtol=0, atol=5e-14)
    again, C_same = turned.in_gauge(gauge)
    np.testing.assert_allclose(C_same, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(again.gyro_matrix, turned.gyro_matrix, atol=1e-15)


def test_any_rotation_of_the_axes_leaves_the_readings_as_they_are() -> None:
    model = _everything()
    C_cb = exp(np.array([0.4, -1.1, 0.7]))  # nothing small
    turned = model.rotated(C_cb)
    true, said = (F @ C_cb.T, W @ C_cb.T), model.measure(F, W)
    for got, want in zip(turned.measure(*true), said, strict=True):
        np.testing.assert_allclose(got, want, rtol=0, atol=5e-14)
    for got, want in zip(turned.compensate(*said), true, strict=True):
        np.testing.assert_allclose(got, want, rtol=0, atol=5e-13)
    # Bendings become scale factors that change with the force; between gauges they are nothing.
    assert np.abs(np.einsum("iik->ik", turned.deflection)).max() > 1e-5
    small, _ = model_of({"accel.misalignment.xy": 5e-4, "gyro.deflection.xyy": 1e-6}).in_gauge(
        Gauge.LOWER
    )
    assert 0 < np.abs(np.einsum("iik->ik", small.deflection)).max() < 1e-9


@pytest.mark.parametrize("triad", ["accel", "gyro"])
def test_asymmetry_is_half_the_difference_of_the_scale_factors_over_their_mean(triad: str) -> None:
    model = model_of({f"{triad}.scale.y": 0.01, f"{triad}.asymmetry.y": 300e-6})
    true = np.array([[0.0, 9.8, 0.0], [0.0, -9.8, 0.0]])
    said = dict(zip(("accel", "gyro"), model.measure(true, true), strict=True))[triad][:, 1]
    plus, minus = said[0] / 9.8, said[1] / -9.8
    assert (plus - minus) / (plus + minus) == pytest.approx(300e-6, rel=1e-12)
    assert (plus + minus) / 2 == pytest.approx(1.01, abs=1e-15)


def test_large_asymmetry_and_quadratic_terms_invert_around_zero() -> None:
    """Newton's method passes from one sense to the other."""
    model = model_of({"accel.asymmetry.x": 0.5, "accel.asymmetry.z": -0.6,
                    "accel.misalignment.xz": 0.2, "accel.quadratic.x": 2e-3})  # fmt: skip
    f = np.concatenate([np.zeros((1, 3)), 10.0 ** np.arange(-12, 2)[:, None] * np.ones(3)])
    f = np.concatenate([f, -f, f * [1, -1, -1]])
    back, _ = model.compensate(model.measure(f, f)[0], None)
    np.testing.assert_allclose(back, f, rtol=1e-14, atol=2e-15)


def test_gravity_that_is_assumed_wrong_changes_coefficients_by_its_slope() -> None:
    """A body with g (1 + e) in every place of f is another model with the g assumed."""
    model, e = _everything(), 1e-7
    assumed = model.coefficients()
    moved = assumed.values + e * gravity_slope(assumed)
    again = ImuModel.from_coefficients(CoefficientVector(LAYOUT, moved))
    for got, want in zip(again.measure(F * (1 + e), W), model.measure(F, W), strict=True):
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)


def test_lower_gauge_axes_are_the_accelerometers_own() -> None:
    turned, C_cb = _everything().in_gauge(Gauge.LOWER)
    sensitive = _everything().accel_matrix @ C_cb.T
    assert sensitive[0, 1:] == pytest.approx([0, 0], abs=1e-15)  # x_c along the x input axis
    assert turned.accel_matrix[1, 2] == pytest.approx(0, abs=1e-15)  # y_c in the x-y plane


@pytest.mark.parametrize("model", [ImuModel(), _everything()], ids=["nominal", "everything"])
def test_slopes_by_every_coefficient_force_and_rate_are_differences_of_the_readings(model) -> None:
    slopes = model.slopes(F, W, LAYOUT.names)
    assert slopes.accel.shape == slopes.gyro.shape == (50, 3, len(LAYOUT))
    at = model.coefficients()
    for k, name in enumerate(LAYOUT.names):  # linear in any one coefficient but for kinks
        step = 1e-3 * _size(name)
        ends = (at.with_values({name: at.values[k] + s}) for s in (step, -step))
        up, down = (ImuModel.from_coefficients(end) for end in ends)
        _assert_slope(slopes.accel[..., k], slopes.gyro[..., k], up, down, F, F, W, W, step)
    none = np.zeros_like(slopes.accel_by_force[..., 0])
    for j, d in enumerate(1e-5 * np.eye(3)):
        by_f = slopes.accel_by_force[..., j], slopes.gyro_by_force[..., j]
        _assert_slope(*by_f, model, model, F + d, F - d, W, W, 1e-5)
        _assert_slope(none, slopes.gyro_by_rate[..., j], model, model, F, F, W + d, W - d, 1e-5)


def _assert_slope(accel, gyro, up, down, f_up, f_down, w_up, w_down, step) -> None:
    ahead, behind = up.measure(f_up, w_up), down.measure(f_down, w_down)
    for got, a, b in zip((accel, gyro), ahead, behind, strict=True):
        numeric = (a - b) / (2 * step)
        # Rounding of readings up to 12 over the step, and its square times a third derivative.
        np.testing.assert_allclose(got, numeric, rtol=0, atol=1e-14 / step + step**2)


def test_slopes_of_models_that_differ_from_sample_to_sample_are_those_of_each() -> None:
    names = LAYOUT.names
    values = np.random.default_rng(4).uniform(-0.3, 0.3, (len(F), len(names)))
    values *= [_size(name) for name in names]
    together = ImuModel.of_samples(names, values).slopes(F, W, names)
    for i in range(3):
        one = model_of(dict(zip(names, values[i], strict=True))).slopes(F[i], W[i], names)
        for got, want in zip(together, one, strict=True):
            np.testing.assert_allclose(got[i], want, rtol=1e-13, atol=1e-13)


def test_linear_names_are_part_of_the_layout() -> None:
    assert set(LINEAR_LOWER) < set(LAYOUT.names)
