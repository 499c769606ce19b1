"""A tick never stands beside a value that is beyond its limit, nor a pass beside a doubt."""

from __future__ import annotations

from dataclasses import replace

import pytest

from foucault.errors import finding
from foucault.result import Check, Level, Verdict
from foucault.symptoms import SYMPTOMS
from make_result import make_result


@pytest.mark.parametrize(
    ("value", "low", "high", "passed"),
    [
        (2.0, None, 1.0, False),
        (2.0, 3.0, None, False),
        (2.0, 1.0, 3.0, True),
        (2.0, None, None, True),
        (float("nan"), 1.0, 3.0, True),
    ],
)
def test_a_check_beyond_its_limit_has_not_passed(value, low, high, passed):
    check = Check("any", value, low, high, True, "It is fine.")
    assert check.passed is passed
    assert Verdict.of((check,)).level is (Level.PASS if passed else Level.DOUBTFUL)


def test_a_check_within_its_limits_may_fail_for_another_reason():
    assert not Check("any", 2.0, 1.0, 3.0, False, "It is not.").passed


@pytest.mark.parametrize(("p", "passed"), [(None, True), (0.5, True), (2e-4, True), (9e-5, False)])
def test_nothing_passes_beside_what_is_no_chance(p, passed):
    """Whatever its limits: the verdict follows from the probability itself."""
    check = Check("any", 2.0, None, 3.0, True, "It is fine.", p=p)
    assert check.passed is passed
    assert (Verdict.of((check,)).level is Level.PASS) is passed


def test_doubts_are_warnings():
    assert {row.severity for row in SYMPTOMS.values() if row.doubt or row.advice} == {"warning"}


def test_every_warning_is_either_a_doubt_or_advice():
    """A new one does not slip through: say which it is, and why the numbers may be wrong."""
    warnings = [row for row in SYMPTOMS.values() if row.severity == "warning"]
    assert [row.code for row in warnings if bool(row.doubt) == row.advice] == []


def test_a_pass_never_stands_beside_a_doubt():
    result = make_result()
    assert result.verdict.level is Level.PASS
    said = finding("rate_table.scatter", ppm="34")
    doubted = replace(result, findings=(*result.findings, said))
    assert doubted.verdict.level is Level.DOUBTFUL
    assert doubted.verdict.reasons == (f"{said.message} {said.cure}",)
    # Said once, however often a result is made anew; what is unusable stays so.
    again = replace(doubted, instrument={"name": "any"})
    assert again.verdict == doubted.verdict
    bad = replace(doubted, verdict=Verdict(Level.UNUSABLE, ("It did not converge.",)))
    assert bad.verdict.level is Level.UNUSABLE and len(bad.verdict.reasons) == 2


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("site.gravity_differs", {"given": 9.79, "normal": 9.81, "ppm": 2000.0}),
        ("log.gyro_earth", {"rate": "15", "ratio": "3600", "unit": "deg/s", "likely": "arcsec/s"}),
    ],
)
def test_what_is_wrong_with_place_or_units_is_no_pass(code, words):
    said = finding(code, **words)
    doubted = replace(make_result(), findings=(said,))
    assert doubted.verdict.level is Level.DOUBTFUL
    assert doubted.verdict.reasons == (f"{said.message} {said.cure}",)


def test_a_note_lowers_nothing():
    said = finding("rate_table.no_latitude", sd="9")
    assert replace(make_result(), findings=(said,)).verdict.level is Level.PASS
