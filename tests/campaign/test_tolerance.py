"""Limits of coefficients: the file, its mistakes, and the decision rule."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.campaign import tolerance
from foucault.models.imu import LINEAR_LOWER
from refusals import refuses

TEXT = """
"accel.bias" = "5 mg"
"accel.bias.z" = "10 mg"
gyro.bias = "20 deg/h"
"gyro.scale.x" = { limit = "500 ppm", sd = "20 ppm" }
"""
MG = 9.80665e-3


def test_groups_and_single_coefficients_in_si():
    found = tolerance.parse(TEXT)
    value, sd = found.limits(LINEAR_LOWER)
    at = LINEAR_LOWER.index
    assert value[at("accel.bias.x")] == pytest.approx(5 * MG)
    assert value[at("accel.bias.z")] == pytest.approx(10 * MG)  # the longer name decides
    assert value[at("gyro.bias.y")] == pytest.approx(np.radians(20 / 3600))
    assert (value[at("gyro.scale.x")], sd[at("gyro.scale.x")]) == pytest.approx((5e-4, 2e-5))
    assert np.isinf(value[at("gyro.scale.y")]) and np.isinf(sd[at("gyro.bias.x")])
    limits = found.as_json()["limits"]
    assert limits["gyro.scale.x"] == pytest.approx({"limit": 5e-4, "sd": 2e-5})
    assert "sd" not in limits["accel.bias"]


def test_nested_tables_are_the_same():
    nested = '[accel]\nbias = "5 mg"\n[accel.scale]\nlimit = "1 %"\nsd = "10 ppm"\n'
    a = tolerance.parse(nested).limits(LINEAR_LOWER)
    b = tolerance.parse(
        '"accel.bias" = "5 mg"\n"accel.scale" = { limit = "1 %", sd = "10 ppm" }'
    ).limits(LINEAR_LOWER)
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("value", "sd", "decision"),
    [
        (8.0, 1.0, "pass"),  # 8 + 2 = 10: just inside
        (-8.0, 1.0, "pass"),
        (8.01, 1.0, "undecided"),
        (12.0, 1.0, "undecided"),  # 12 - 2 = 10: just not outside
        (12.01, 1.0, "fail"),
        (-12.01, 1.0, "fail"),
        (0.0, 5.01, "undecided"),
        (0.0, np.nan, "undecided"),
        (30.0, np.nan, "undecided"),
    ],
)
def test_the_guard_band(value, sd, decision):
    limit = tolerance.Tolerance((tolerance.Entry("accel.bias", 10.0),))
    names = ("accel.bias.x", "gyro.bias.x")
    found = limit.decide(names, np.array([[value, 99.0]]), np.array([[sd, 1.0]]))
    assert tolerance.DECISIONS[found[0, 0]] == decision
    assert found[0, 1] == tolerance.PASS  # nothing is asked of it


def test_a_coefficient_may_have_to_be_known_well():
    limit = tolerance.Tolerance((tolerance.Entry("accel.bias.x", 10.0, 0.5),))
    sd = np.array([[0.5], [0.51], [0.51]])
    found = limit.decide(("accel.bias.x",), np.array([[1.0], [1.0], [20.0]]), sd)
    assert [tolerance.DECISIONS[d] for d in found[:, 0]] == ["pass", "undecided", "fail"]


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ('"accel.bias" = 5', "unit.missing", '"accel.bias".limit: 5 has no unit'),
        ('"accel.bias" = "5 deg/h"', "unit.kind", "'deg/h' does not measure specific force"),
        ('"accel.bais" = "5 mg"', "tolerance.name", "accel.bias"),
        ('"accel" = "5 mg"', "tolerance.kind", "several kinds: specific force, scale factor error"),
        ('"gyro.scale" = { limit = "5 ppm", std = "1 ppm" }', "tolerance.key", "std"),
        ('"gyro.scale" = { sd = "1 ppm" }', "tolerance.no_limit", "has no limit"),
        ('"gyro.scale" = "-5 ppm"', "tolerance.positive", "not positive"),
        ('"gyro.scale" = { limit = "5 ppm", sd = "0 ppm" }', "tolerance.positive", "sd = "),
        ("", "tolerance.empty", "holds no limit"),
        ("accel.bias = 5 mg", "tolerance.syntax", "not valid TOML"),
    ],
)
def test_mistakes_are_named(text, code, words):
    with refuses(code) as problem:
        tolerance.parse(text)
    assert words in str(problem.value)


def test_a_file_that_is_not_there_and_one_that_is_no_text(tmp_path):
    (tmp_path / "tolerance.toml").write_text(TEXT)
    assert len(tolerance.load(tmp_path / "tolerance.toml").entries) == 4
    with refuses("tolerance.missing", match=r"Did you mean.*tolerance\.toml"):
        tolerance.load(tmp_path / "tolerances.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xc3\x28")
    with refuses("tolerance.syntax"):
        tolerance.load(tmp_path / "bytes.toml")


def test_what_is_not_estimated_cannot_be_limited():
    found = tolerance.parse('"accel.quadratic" = "10 ug/g^2"')
    with refuses("tolerance.not_estimated", match=r"'accel\.quadratic' has a limit"):
        found.refuse_unknown(LINEAR_LOWER, "norm_observation")
    tolerance.parse(TEXT).refuse_unknown(LINEAR_LOWER, "norm_observation")
