"""How to apply: the lines to copy do what the result does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from foucault import report
from foucault.models.imu import FULL_EQUATION, LAYOUT, LINEAR_LOWER
from foucault.report.calibration import how_to_apply, numbers
from foucault.report.page import Code, Equation
from make_result import make_result


def run(code: str) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    space = {"accel": 9.8 * rng.normal(size=(5, 3)), "gyro": rng.normal(size=(5, 3))}
    exec(code, space)  # what a user pastes
    return space


def with_coefficients(extra: dict[str, float]):
    result = make_result()
    layout = LAYOUT.subset((*LINEAR_LOWER, *extra))
    values = np.array([*result.coefficients.values, *extra.values()])
    vector = dataclasses.replace(
        result.coefficients, layout=layout, values=values, cov=None,
        free=np.ones(len(values), bool), prior_sd=np.full(len(values), np.inf),
    )  # fmt: skip
    return dataclasses.replace(result, coefficients=vector)


@pytest.mark.parametrize("extra", [{}, {"gyro.g_sensitivity.xy": 2e-4}])
def test_the_numbers_to_copy_compensate_as_the_result_does(extra):
    result = with_coefficients(extra)
    space = run(numbers(result))
    f_b, w_ib_b = result.model.compensate(space["accel"], space["gyro"])
    np.testing.assert_allclose(space["f_b"], f_b, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(space["w_ib_b"], w_ib_b, rtol=1e-10, atol=1e-12)


def test_quadratic_terms_are_given_but_not_inverted_by_hand():
    text = numbers(with_coefficients({"accel.quadratic.x": 1e-5}))
    assert "K_a = np.array" in text and "f_b = " not in text
    assert "model.compensate" in text


@pytest.mark.parametrize("name", ["accel.asymmetry.y", "gyro.deflection.zxy"])
def test_what_no_line_inverts_is_given_with_its_matrix(name):
    result = with_coefficients({name: 1e-5})
    text = numbers(result)
    assert "f_b = " not in text and "model.compensate" in text
    space = run(text)
    if name.startswith("accel"):
        np.testing.assert_allclose(space["a_a"], [0, 1e-5, 0])
    else:
        np.testing.assert_allclose(space["T"], result.model.deflection)
        assert space["T"][2, 0, 1] == 1e-5


def test_the_full_equation_is_given_with_its_inverse():
    section = how_to_apply(make_result(equation=FULL_EQUATION))
    said = [b.lines for b in section.blocks if isinstance(b, Equation)]
    assert "r = (I + S_g + M_g + D(f)) w" in said[0]
    assert "w = (I + S_g + M_g + D(f))^-1 r" in said[1]


def test_accelerometers_alone_have_no_gyro_lines():
    result = make_result()
    alone = dataclasses.replace(result, coefficients=result.coefficients["accel"])
    text = numbers(alone)
    assert "b_a" in text and "gyro" not in text and "b_g" not in text


def test_equation_is_typeset():
    page = report.html(make_result())
    assert "<b>M</b><sub>a</sub>) <i>f</i> + <i>b</i><sub>a</sub>" in page
    assert "<i>f</i><sub>x</sub><sup>2</sup>" in page
    assert ")<sup>−1</sup> (accel − <i>b</i>" in page


def test_a_model_of_its_own_has_its_equation_and_no_matrices():
    section = how_to_apply(make_result(equation="y = K x + b;  x: rate; y: <reading>"))
    blocks = section.blocks
    assert blocks[0] == Equation(["y = K x + b"])
    assert [b.text for b in blocks[1:3]] == ["Here x: rate.", "Here y: <reading>."]
    assert not any("np.array" in b.text for b in blocks if isinstance(b, Code))
