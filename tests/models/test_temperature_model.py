"""Coefficients as functions of temperature: values, covariance, and an exact inverse on a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import Layout
from foucault.errors import FoucaultError
from foucault.models.imu import ImuModel
from foucault.models.layouts import of_one_sample
from foucault.models.size_effect import SizeEffect
from foucault.models.temperature import TemperatureModel, basis
from foucault.tables import Log
from make_terms import HIGH, LOW, SIZES, T0, a_model, with_terms


def a_log(n: int = 400, seed: int = 2) -> Log:
    rng = np.random.default_rng(seed)
    T = LOW + (HIGH - LOW) * 0.5 * (1 - np.cos(np.linspace(0, np.pi, n)))
    return Log(np.arange(n) / 100.0, rng.uniform(-6, 6, (n, 3)), rng.uniform(-40, 40, (n, 3)),
               "rate", T)  # fmt: skip


@pytest.mark.parametrize("knots", [(), (240.0, 280.0, 300.0, 345.0)])
def test_values_and_covariance_at_a_temperature(knots: tuple[float, ...]) -> None:
    model = a_model("gyro.bias", "accel.scale", knots=knots)
    T = 287.3
    if knots:
        part = (T - 280.0) / 20.0
        want = (1 - part) * model.weights[:, 1] + part * model.weights[:, 2]
    else:
        want = sum(model.weights[:, k] * (T - T0) ** k for k in range(3))
    vector = model.at(T)
    np.testing.assert_allclose(vector.values, want, rtol=1e-13)
    # The covariance against the definition: J cov J' with J written out.
    n, p = model.weights.shape
    J = np.kron(np.eye(n), basis(T, p, T0, model.knots)[None])
    np.testing.assert_allclose(vector.cov, J @ model.cov @ J.T, rtol=1e-12, atol=0)
    np.testing.assert_allclose(model.sd(np.array([T]))[0], vector.sd, rtol=1e-12)
    wide = replace(model, scatter=np.full(n, 0.25))
    np.testing.assert_allclose(wide.sd(np.array([T]), scatter=True)[0] ** 2 - 0.25**2,
                               vector.sd**2, atol=1e-14)  # fmt: skip


def test_piecewise_linear_functions_pass_the_knots_and_are_straight_between() -> None:
    knots = np.array([250.0, 290.0, 340.0])
    at = basis(knots, 3, T0, knots)
    np.testing.assert_allclose(at, np.eye(3), atol=1e-15)
    T = np.linspace(250, 340, 91)
    np.testing.assert_allclose(basis(T, 3, T0, knots).sum(axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(basis(T, 3, T0, knots) @ knots, T, rtol=1e-14)


@pytest.mark.parametrize("knots", [(), (250.0, 290.0, 340.0)])
def test_every_sample_is_compensated_by_its_own_coefficients(knots: tuple[float, ...]) -> None:
    terms = [f for f in SIZES if f not in ("accel.lever", "accel.delay")]
    model, true = a_model(*terms, knots=knots), a_log()
    each = ImuModel.of_samples(model.layout.names, model.values(true.temperature))
    accel, gyro = each.measure(true.accel, true.gyro)
    got = model.apply(replace(true, accel=accel, gyro=gyro))
    np.testing.assert_allclose(got.accel, true.accel, atol=1e-12 * 40)
    np.testing.assert_allclose(got.gyro, true.gyro, atol=1e-12 * 40)
    # And sample by sample as a constant result at that temperature does it.
    for k in (0, 57, 399):
        one = ImuModel.from_coefficients(model.at(float(true.temperature[k])))
        a, g = one.measure(true.accel[k], true.gyro[k])
        np.testing.assert_allclose(a, accel[k], rtol=1e-13)
        np.testing.assert_allclose(g, gyro[k], rtol=1e-13)


def test_lever_arms_are_taken_away_with_the_errors_of_each_temperature() -> None:
    model, log = a_model(), a_log(60)
    vector = model.constant()
    got = model.apply(log)
    at = [model.layout.index(n) for n in of_one_sample(vector).names]
    each = ImuModel.of_samples(of_one_sample(vector).names, model.values(log.temperature)[:, at])
    want = SizeEffect.of(vector).apply(each, log)
    np.testing.assert_array_equal(got.accel, want.accel)
    # Not what the coefficients at one temperature give.
    alone = SizeEffect.of(vector).apply(ImuModel.from_coefficients(of_one_sample(vector)), log)
    assert np.abs(alone.accel - got.accel).max() > 0.1


def test_a_constant_model_is_the_constant_result() -> None:
    result = with_terms("accel.bias", "accel.scale", "gyro.bias", "gyro.misalignment")
    vector = result.coefficients
    weights = np.c_[vector.values, np.zeros(len(vector))]
    model = TemperatureModel(vector.layout, weights, np.zeros((weights.size,) * 2), T0, LOW, HIGH)
    assert model.varying() == ()
    log = a_log()
    want, got = result.apply(log), replace(result, temperature=model).apply(log)
    np.testing.assert_allclose(got.accel, want.accel, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(got.gyro, want.gyro, rtol=1e-13, atol=1e-13)


def test_what_varies() -> None:
    assert a_model("gyro.bias").varying() == ("gyro.bias.x", "gyro.bias.y", "gyro.bias.z")
    knots = a_model("gyro.bias", "accel.lever", knots=(250.0, 340.0))
    assert knots.varying() == ("gyro.bias.x", "gyro.bias.y", "gyro.bias.z")


def _refused(model: TemperatureModel, log: Log, **more: int) -> FoucaultError:
    with pytest.raises(FoucaultError) as caught:
        model.refuse_outside(log, **more)
    return caught.value


def test_outside_is_refused_with_row_time_and_range() -> None:
    model, log = a_model("gyro.bias"), a_log()
    T = log.temperature.copy()
    T[[7, 30]] = [HIGH + 1.0, LOW - 1.0]
    problem = _refused(model, replace(log, temperature=T), first=1000)
    assert problem.code == "temperature.outside"
    assert "row 1007" in problem.message
    assert "0.070 s" in problem.message
    assert "67.85 degC" in problem.message
    assert "from -23.15 to 66.85 degC" in problem.message
    assert "--outside hold" in problem.cure
    T[7] = np.nan
    assert "row 7 " in _refused(model, replace(log, temperature=T)).message
    assert _refused(model, replace(log, temperature=None)).code == "temperature.unlogged"
    model.refuse_outside(replace(log, temperature=model.held(np.nan_to_num(T, nan=300.0))))
    with pytest.raises(FoucaultError, match=r"At 66\.86 degC"):
        model.at(HIGH + 0.01)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (298.15 + 273.15, r"Kelvin said to be degC look like this: is it 25.0\?"),
        (25.0, "Celsius said to be K look like this: is it 25.0 degC"),
        (345.0, None),
    ],
)
def test_a_wrong_unit_is_named(given: float, words: str | None) -> None:
    log = replace(a_log(), temperature=np.full(400, given))
    message = _refused(a_model("gyro.bias"), log).message
    import re

    assert bool(re.search("look like this", message)) == (words is not None)
    assert words is None or re.search(words, message)


def test_models_of_samples_add_to_the_identity() -> None:
    names = ("accel.scale.x", "accel.misalignment.yx", "gyro.deflection.xyz", "gyro.bias.y")
    values = np.random.default_rng(1).normal(size=(5, 4)) * 1e-3
    many = ImuModel.of_samples(names, values)
    for k in range(5):
        layout = Layout(tuple(ImuModel().coefficients(names).layout.coefficients))
        one = ImuModel.from_coefficients(replace(ImuModel().coefficients(names), layout=layout,
                                                 values=values[k]))  # fmt: skip
        for name in ("accel_matrix", "deflection", "gyro_bias"):
            np.testing.assert_array_equal(getattr(many, name)[k], getattr(one, name))
    assert many.accel_bias.shape == (3,)  # what does not change stays one for all
