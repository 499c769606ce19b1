"""Units against hand-computed values: every unit of the field, wrong kinds, near misses."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from typing import Annotated

import numpy as np
import pytest
from pydantic import BaseModel, Field, ValidationError

from foucault import units
from foucault.errors import FoucaultError
from refusals import refuses

DEG = math.pi / 180
G = 9.80665

BY_HAND = [
    ("1 deg/h", "angular rate", DEG / 3600),
    ("0.01 deg/h", "angular rate", 0.01 * DEG / 3600),
    ("2 deg/s", "angular rate", 2 * DEG),
    ("2 dps", "angular rate", 2 * DEG),
    ("3 dph", "angular rate", 3 * DEG / 3600),
    ("0.5 rad/s", "angular rate", 0.5),
    ("60 rpm", "angular rate", 2 * math.pi),
    ("15.041067 arcsec/s", "angular rate", 15.041067 * DEG / 3600),
    ("0.3 deg/sqrt(h)", "angle random walk", 0.3 * DEG / 60),
    ("0.3 deg/√h".replace("√h", "√(h)"), "angle random walk", 0.3 * DEG / 60),
    ("1 deg/h/sqrt(Hz)", "angle random walk", DEG / 3600),
    ("1 deg/s/sqrt(Hz)", "angle random walk", DEG),
    ("1 deg/h/sqrt(h)", "rate random walk", DEG / 3600 / 60),
    ("1 deg/h/g", "g-sensitivity", DEG / 3600 / G),
    ("1 deg/h/g^2", "g-squared sensitivity", DEG / 3600 / G**2),
    ("50 ug", "specific force", 50e-6 * G),
    ("50 µg", "specific force", 50e-6 * G),
    ("2 mg", "specific force", 2e-3 * G),
    ("1 g", "specific force", G),
    ("9.81 m/s^2", "gravity", 9.81),
    ("9.81 m/s**2", "gravity", 9.81),
    ("980665 mGal", "gravity", G),
    ("100 ug/sqrt(Hz)", "velocity random walk", 100e-6 * G),
    ("0.6 m/s/sqrt(h)", "velocity random walk", 0.01),
    ("60 ug/sqrt(h)", "acceleration random walk", 1e-6 * G),
    ("10 ug/g^2", "quadratic", 10e-6 / G),
    ("1 mg/g^2", "quadratic", 1e-3 / G),
    ("1 ppm/g", "quadratic", 1e-6 / G),
    ("1 ppm/(deg/s)^2", "cubic", 1e-6 / DEG**2),
    ("2 ppb/(deg/s)**2", "cubic", 2e-9 / DEG**2),
    ("3e-5 1/(rad/s)^2", "cubic", 3e-5),
    ("3 arcsec", "angle", 3 * DEG / 3600),
    ("3 arcmin", "misalignment", 3 * DEG / 60),
    ("1 mrad", "misalignment", 1e-3),
    ("200 ppm", "scale factor error", 200e-6),
    ("0.1 %", "scale factor error", 1e-3),
    ("5 ppb", "scale factor error", 5e-9),
    ("415 count/(m/s^2)", "accelerometer count scale", 415.0),
    ("4000 LSB/g", "accelerometer count scale", 4000 / G),
    ("131 LSB/(deg/s)", "gyro count scale", 131 / DEG),
    ("0.1 arcsec", "angle increment", 0.1 * DEG / 3600),
    ("125 ug*s", "velocity increment", 125e-6 * G),
    ("5 ms", "time", 5e-3),
    ("2 min", "time", 120.0),
    ("1 h", "time", 3600.0),
    ("0.2 kHz", "frequency", 200.0),
    ("380 m", "length", 380.0),
    ("4 cm", "length", 0.04),
    ("-45.5 deg", "angle", -45.5 * DEG),
    ("+1e-3 deg/h", "angular rate", 1e-3 * DEG / 3600),
    (".5 deg", "angle", 0.5 * DEG),
]


@pytest.mark.parametrize(("text", "kind", "value"), BY_HAND)
def test_text_becomes_si(text: str, kind: str, value: float) -> None:
    assert units.parse(text, kind) == pytest.approx(value, rel=1e-14)


def test_arcsec_per_g_is_a_deflection_not_a_quadratic_term() -> None:
    assert units._factor_and_dimension("arcsec/g")[0] == pytest.approx(DEG / 3600 / G, rel=1e-14)
    with pytest.raises(FoucaultError, match="does not measure quadratic"):
        units.parse("1 arcsec/g", "quadratic")
    assert units.parse("1 arcsec/g", "deflection") == pytest.approx(DEG / 3600 / G, rel=1e-14)
    assert units.display_unit("deflection", 1e-6) == "arcsec/g"


@pytest.mark.parametrize("kind", units.KINDS)
def test_examples_and_display_units_are_of_their_kind(kind: str) -> None:
    row = units.KINDS[kind]
    assert math.isfinite(units.parse(row.example, kind))
    sizes = [units.factor(unit, kind) for unit in row.display]
    assert sizes == sorted(sizes)
    assert units.factor(row.si, kind) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("1 ppm", "misalignment"),
        ("1 arcsec", "scale factor error"),
        ("1 count", "scale factor error"),
        ("1 deg", "angular rate"),
        ("1 deg/h", "angle random walk"),
        ("1 deg/sqrt(h)", "angular rate"),
        ("1 Hz", "angular rate"),
        ("1 m/s^2", "velocity random walk"),
        ("1 ug", "quadratic"),
        ("1 count/(deg/s)", "accelerometer count scale"),
        ("1 s", "length"),
    ],
)
def test_wrong_kind_is_refused(text: str, kind: str) -> None:
    unit = text.split(" ", 1)[1]
    with refuses("unit.kind") as caught:
        units.parse(text, kind)
    assert caught.value.message == f"'{unit}' does not measure {kind}."
    assert units.KINDS[kind].example in caught.value.cure


@pytest.mark.parametrize(
    "given", [0.01, 3, "0.01", "fast", "", None, True, "deg/h", "1,5 deg/h", "1.2.3 deg/h"]
)
def test_bare_numbers_and_words_are_refused_with_an_example(given: object) -> None:
    with pytest.raises(FoucaultError) as caught:
        units.parse(given, "angular rate", "bias_sd")
    assert caught.value.code in ("unit.missing", "unit.unknown")
    if caught.value.code == "unit.missing":
        assert caught.value.message.startswith(f"bias_sd: {given!r} has no unit")
        assert '"0.01 deg/h"' in caught.value.cure


@pytest.mark.parametrize(
    ("text", "kind", "meant"),
    [
        ("1 degg/h", "angular rate", "deg"),
        ("1 arcsce", "angle", "arcsec"),
        ("2 pmm", "angle", "ppm"),
    ],
)
def test_misspelt_unit_gets_a_suggestion(text: str, kind: str, meant: str) -> None:
    with pytest.raises(FoucaultError, match=rf"not known\. Did you mean .*\b{meant}\b") as caught:
        units.parse(text, kind)
    assert "deg, arcmin, arcsec" in caught.value.cure


@pytest.mark.parametrize("text", ["1 kg", "1 V", "1 gram", "1 __import__('os')", "1 deg//h", "1 ("])
def test_units_outside_the_vocabulary_are_refused(text: str) -> None:
    with pytest.raises(FoucaultError) as caught:
        units.parse(text, "angle")
    assert caught.value.code in ("unit.unknown", "unit.kind")


def test_convert_is_the_inverse_of_parse() -> None:
    assert units.convert(units.parse("7 deg/h", "angular rate"), "angular rate", "deg/h") == (
        pytest.approx(7, rel=1e-14)
    )


@pytest.mark.parametrize(
    ("kind", "text", "unit"),
    [
        ("angular rate", "0.01 deg/h", "deg/h"),
        ("angular rate", "2 deg/s", "deg/s"),
        ("specific force", "999 ug", "ug"),
        ("specific force", "3 mg", "mg"),
        ("misalignment", "20 arcsec", "arcsec"),
        ("misalignment", "-2 arcmin", "arcmin"),
        ("misalignment", "1.5 deg", "deg"),
    ],
)
def test_display_unit_is_the_one_people_would_use(kind: str, text: str, unit: str) -> None:
    assert units.display_unit(kind, units.parse(text, kind)) == unit


class _Settings(BaseModel):
    rate: Annotated[float, units.Quantity("frequency")]


def test_one_unit_for_all_of_a_kind_by_the_middle_one() -> None:
    arcsec, hourly = math.radians(1 / 3600), math.radians(1) / 3600
    kinds = ("misalignment", "angular rate", "misalignment", "misalignment", "g-sensitivity")
    sizes = (0.4 * arcsec, 3 * hourly, 7000 * arcsec, 90 * arcsec, math.inf)
    assert units.display_units(kinds, sizes) == (
        "arcmin", "deg/h", "arcmin", "arcmin", "deg/h/g",
    )  # fmt: skip
    assert units.display_units(kinds[:1], sizes[:1]) == ("arcsec",)


def test_pydantic_field_holds_si_and_a_number_from_python_is_si() -> None:
    assert _Settings.model_validate({"rate": "0.1 kHz"}).rate == 100.0
    assert _Settings(rate=100).rate == 100.0
    assert _Settings(rate=np.float32(0.5)).rate == 0.5
    for wrong in (True, None, "100", [100.0]):
        with pytest.raises(FoucaultError, match=r"rate: .* has no unit"):
            _Settings.model_validate({"rate": wrong})


class _Bounded(BaseModel):
    rate: Annotated[float, units.Quantity("frequency")] = Field(default=1.0, gt=0, le=100.0)


@pytest.mark.parametrize("context", [None, {"locate": True}])
@pytest.mark.parametrize(
    ("text", "reason"), [("0 Hz", "greater than 0"), ("1 kHz", "equal to 100")]
)
def test_bounds_of_a_quantity_hold(text: str, reason: str, context: dict[str, bool] | None) -> None:
    assert _Bounded.model_validate({"rate": "0.1 kHz"}, context=context).rate == 100.0
    with pytest.raises(ValidationError, match=reason):
        _Bounded.model_validate({"rate": text}, context=context)


def test_a_bare_number_in_a_file_is_refused() -> None:
    with pytest.raises(ValidationError) as caught:
        _Settings.model_validate({"rate": 100}, context={"locate": True})
    assert caught.value.errors()[0]["loc"] == ("rate",)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(290.4, 2, "290"), (0.2, 2, "0.2"), (0.0996, 2, "0.1"), (1e4, 4, "10000"), (-1.5, 2, "-1.5"),
     (0.0, 2, "0"), (1e-9, 2, "1e-09"), (float("nan"), 2, "nan"), (987654.0, 2, "990000")],
)  # fmt: skip
def test_plain_numbers(value: float, digits: int, text: str) -> None:
    assert units.plain(value, digits) == text


def test_lengths_of_time_are_read_in_their_own_unit() -> None:
    times = (10.0, 0.01, 0.0098765, 2.5e-4, 1e-6)
    assert [units.span(t) for t in times] == ["10 s", "10 ms", "9.877 ms", "250 us", "1 us"]


def test_schema_of_a_quantity_shows_an_example() -> None:
    assert _Settings.model_json_schema()["properties"]["rate"]["examples"] == ["100 Hz"]


@pytest.mark.parametrize(
    ("written", "meant"),
    [("m/s2", "m/s^2"), ("mps", "m/s"), ("mps2", "m/s^2")],
)
def test_a_usual_way_to_write_a_unit_is_understood_and_asked_back(written: str, meant: str) -> None:
    with pytest.raises(FoucaultError, match=re.escape(f"Did you mean {meant}?")):
        units.parse(f"1 {written}", "angular rate")


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("48d50m46s", 48 + 50 / 60 + 46 / 3600),
        ("48°50'46\"N", 48 + 50 / 60 + 46 / 3600),
        ("48°50'46.5\"S", -48 - 50 / 60 - 46.5 / 3600),
        ("-48 deg 50.5 min", -48 - 50.5 / 60),
        ("48.5° N", 48.5),
        ("45°", 45.0),
    ],
)
def test_degrees_minutes_and_seconds_are_read_as_people_write_them(text, degrees):
    assert units.parse(text, "angle", "site.latitude") == pytest.approx(np.radians(degrees))


@pytest.mark.parametrize(
    "text",
    ["1 17.5 deg", "40+8.8462 deg", "2*3 deg", "45 deg + 3 deg", "3 deg*1", "9^9 deg",
     "1e-6 1e3 deg", "48.5d30m2s"],
)  # fmt: skip
def test_a_quantity_is_one_number_and_one_unit_and_no_sum(text):
    with refuses("unit.unknown"):
        units.parse(text, "angle", "site.latitude")


def test_what_was_read_as_another_angle_says_what_a_quantity_is():
    with pytest.raises(FoucaultError, match=r"'17.5 deg' is not known. A quantity is one number"):
        units.parse("1 17.5 deg", "angle")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("48d61m", "minutes and seconds stay below 60"),
        ("48d30.5m2s", "only the last number has decimals"),
        ("-48d50m46sN", "a sign beside N"),
        ("48d50m46sE", "E is no side of it"),
    ],
)
def test_an_angle_in_parts_that_is_none_is_refused(text, reason):
    with refuses("unit.angle") as raised:
        units.parse(text, "angle", "site.latitude")
    assert f"is not an angle in degrees, minutes and seconds: {reason}." in raised.value.message


@pytest.mark.parametrize(
    ("unit", "kind", "value"),
    [
        ("deg/h/sqrt(h)", "rate random walk", math.radians(1) / 3600 / 60),
        ("degrees per hour", "angular rate", math.radians(1) / 3600),
        ("µg/√(Hz)", "velocity random walk", 9.80665e-6),
        ("(ug) / sqrt(Hz)", "velocity random walk", 9.80665e-6),
        ("m s^-2", "specific force", 1.0),
        ("m*s**(-2)", "specific force", 1.0),
        ("mg g^-1 m/s^2", "specific force", 1e-3),
    ],
)
def test_units_are_words_with_powers(unit, kind, value):
    assert units.factor(unit, kind) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("unit", ["gs", "deg//h", "deg/", "()", "deg^h", "s.x", "m[0]", "9^9 s"])
def test_what_is_no_unit_is_refused(unit):
    with pytest.raises(FoucaultError, match="is not known"):
        units.factor(unit, "angle")


def common() -> set[str]:
    """Units that people read and write most, as `tests/make_units.py` finds them."""
    import make_units

    return set(make_units.common())


def test_what_is_kept_of_pint_is_what_pint_says():
    assert set(units._common()) == common(), "run python tests/make_units.py"
    for unit, (size, dimension) in units._common().items():
        assert (size, dimension) == units._by_pint(unit)


def test_reading_common_units_does_not_load_pint():
    code = "import sys; from foucault import units; units.parse('1 deg/h', 'angular rate')"
    ran = subprocess.run(
        [sys.executable, "-c", f"{code}; print({{'pint', 'dask'}} & set(sys.modules))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ran.stdout.strip() == "set()"
