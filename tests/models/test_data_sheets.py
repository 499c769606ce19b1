"""Data sheets: every number has a source and a kind, and what is made of it is as by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from pydantic import ValidationError

from foucault import units
from foucault.models import parts
from refusals import refuses

G = 9.80665
DEG = math.pi / 180
NAMES = list(parts.catalogue())

GRADES = {
    "consumer MEMS", "tactical MEMS", "tactical FOG", "tactical RLG", "navigation RLG",
    "quartz accelerometer",
}  # fmt: skip

DECADES = {
    "consumer MEMS": ((0.01, 10), (10, 1000)),
    "tactical MEMS": ((0.01, 1), (1, 1000)),
    "tactical FOG": ((0.001, 1), (1, 100)),
    "tactical RLG": ((0.001, 1), (1, 100)),
}
"""Grade -> decades of angle random walk [deg/sqrt(h)] and velocity random walk [ug/sqrt(Hz)]."""


@pytest.mark.parametrize("name", NAMES)
def test_every_number_is_of_its_kind_and_has_a_source(name: str) -> None:
    of = parts.part(name)
    assert of.name == name and of.maker and of.grade in GRADES and of.numbers
    for key, said in of.numbers.items():
        value = of.value(key)
        assert value is not None and 0 < value < math.inf, key
        assert of.sources[key].title and of.sources[key].address, key
        assert said.page.strip() and len(said.quote) > 8, key
        if said.over is not None:
            units.parse(said.over, parts.QUANTITIES[key.partition(".")[0] + ".range"])


def number_as_written(text: str) -> str:
    """Return the digits of a number, as 0.8 mg/K and ±0.80 mg/°C share them."""
    return f"{float(text.split()[0]):g}"


@pytest.mark.parametrize("name", NAMES)
def test_every_number_stands_in_its_wording(name: str) -> None:
    # Other than the wording: a unit that ours does not know, or another prefix.
    prefixed = {
        ("ICM-42688-P", "gyro.density"), ("BMI270", "accel.density"), ("LSM6DSV", "gyro.density"),
        ("ADIS16505-1", "accel.bias_instability"), ("HG1700", "accel.random_walk"),
        ("LTYS13CJ1A", "gyro.cross_axis"),
    }  # fmt: skip
    for key, said in parts.part(name).numbers.items():
        if (name, key) in prefixed or (name, key) == ("STIM300", "gyro.range"):
            continue
        quoted = {f"{float(w):g}" for w in numbers_in(said.quote)}
        assert number_as_written(said.text) in quoted, (key, said.text, said.quote)


def numbers_in(text: str) -> list[str]:
    return re.findall(r"(?<![\w.])\.?\d+(?:\.\d+)?", re.sub(r"(?<=\d),(?=\d{3})", "", text))


@pytest.mark.parametrize("name", NAMES)
def test_sizes_are_of_their_order(name: str) -> None:
    of = parts.part(name)
    for key in of.numbers:
        if key.endswith("nonlinearity"):
            assert of.value(key) < 0.05
    for group, (size, basis) in parts.sizes_of(name).items():
        assert group in parts.SIZES and size > 0
        assert any(source.title in basis for source in of.sources.values())
    sizes = {group: size for group, (size, _) in parts.sizes_of(name).items()}
    assert sizes.get("accel.quadratic", 0) * G < 0.01  # at 1 g less than 1 %
    assert sizes.get("clock", 0) < 0.05
    noise = parts.noise_of(name)
    if noise is not None:
        (least, most), (quiet, loud) = DECADES[of.grade]
        assert least < units.convert(noise.gyro.white, "angle random walk", "deg/sqrt(h)") < most
        assert quiet < noise.accel.white / (1e-6 * G) < loud


def test_sizes_by_hand() -> None:
    sizes = parts.sizes_of("ICM-20948")
    # 2 x 0.005 / 2 g = 0.005 per g; 4 x 0.001 / (250 deg/s)^2
    assert sizes["accel.quadratic"][0] == pytest.approx(5e-3 / G, rel=1e-12)
    assert sizes["gyro.cubic"][0] == pytest.approx(0.004 / (250 * DEG) ** 2, rel=1e-12)
    assert sizes["accel.bias drift"][0] == pytest.approx(0.8e-3 * G, rel=1e-12)
    assert sizes["gyro.bias drift"][0] == pytest.approx(0.05 * DEG, rel=1e-12)
    assert sizes["accel.scale drift"][0] == pytest.approx(260e-6, rel=1e-12)
    assert set(sizes) == {"accel.quadratic", "gyro.cubic", "accel.bias drift", "gyro.bias drift",
                          "accel.scale drift"}  # fmt: skip
    assert sizes["accel.bias drift"][1] == (
        "ICM-20948 data sheet DS-000189, revision 1.3, page 12: 0.8 mg/K (typical), 1 K"
    )
    warm = parts.sizes_of("ICM-20948", warming=5.0)
    assert warm["gyro.bias drift"][0] == pytest.approx(0.25 * DEG, rel=1e-12)
    assert warm["accel.quadratic"] == sizes["accel.quadratic"]


def test_limits_count_as_two_standard_deviations() -> None:
    assert parts.sizes_of("ADIS16460")["clock"][0] == pytest.approx(0.015, rel=1e-12)
    assert parts.sizes_of("BJGM25N01")["accel.quadratic"][0] == pytest.approx(10e-6 / G, rel=1e-12)
    # The sheet gives the difference of both senses over their mean: half of it is the coefficient.
    asymmetry, basis = parts.sizes_of("LTYS13CJ1A")["gyro.asymmetry"]
    assert asymmetry == pytest.approx(75e-6, rel=1e-12)
    assert basis.endswith("300 ppm (limit, 2 sd), halved")


def test_a_range_that_is_not_used_is_not_taken() -> None:
    # 15.6 deg/s can be chosen: a cubic term of 0.1 % of it would be 16 % at 100 deg/s.
    size, basis = parts.sizes_of("ICM-42688-P")["gyro.cubic"]
    assert size == pytest.approx(0.004 / (250 * DEG) ** 2, rel=1e-12)
    assert "full scale not said, 250 deg/s taken" in basis
    # Without any range nothing follows.
    assert "gyro.cubic" not in parts.sizes_of("STIM210")


@pytest.mark.parametrize("full_scale", [1.0, 4.0])
def test_nonlinearity_is_that_of_the_best_straight_line(full_scale: float) -> None:
    e = 1e-3
    x = np.linspace(-full_scale, full_scale, 20_001)
    for y in (parts.quadratic_of(e, full_scale) * x**2, parts.cubic_of(e, full_scale) * x**3):
        # The line of least largest error: over a grid of slopes, the middle of what is left.
        slopes = np.linspace(0, 4 * e, 401) if y[0] < 0 else np.array([0.0])
        left = y - slopes[:, None] * x
        worst = (left.max(axis=1) - left.min(axis=1)) / 2
        assert worst.min() == pytest.approx(e * full_scale, rel=1e-6)


def test_noise_of_a_density_and_of_a_random_walk() -> None:
    sheet = parts.noise_of("ICM-20948")
    assert sheet is not None
    assert sheet.gyro.white == pytest.approx(0.015 * DEG / math.sqrt(2), rel=1e-12)
    assert sheet.accel.white == pytest.approx(230e-6 * G / math.sqrt(2), rel=1e-12)
    stim = parts.noise_of("STIM300")
    assert stim is not None
    assert stim.gyro.white == pytest.approx(0.15 * DEG / 60, rel=1e-12)
    assert stim.accel.white == pytest.approx(0.06 / 60, rel=1e-12)
    assert parts.noise_of("STIM210") is None and parts.noise_of("ADIS16445") is None


def test_density_is_one_sided_as_a_sheet_with_both_shows() -> None:
    of = parts.part("ADIS16460")
    density, walk = of.value("gyro.density"), of.value("gyro.random_walk")
    assert density is not None and walk is not None
    assert parts.random_walk_of(density) == pytest.approx(walk, rel=0.02)


def test_names_are_found_as_people_write_them() -> None:
    assert parts.part("icm 20948") is parts.part("ICM-20948")
    with refuses("part.unknown") as caught:
        parts.part("MPU9255")
    assert caught.value.message.startswith("There is no part 'MPU9255'; there are MPU-6050, ")
    assert caught.value.message.endswith(" Did you mean 'MPU-9250'?")


def test_a_number_is_meant_in_one_way() -> None:
    for given in ({}, {"typical": "1 g", "max": "2 g"}):
        with pytest.raises(ValidationError, match="one of typical, sd and max"):
            parts.Stated(page="1", quote="so it says", **given)
    with pytest.raises(ValidationError):
        parts.Stated(typical="1 g", page="", quote="so it says")


def test_no_sheet_speaks_of_what_it_is_not_asked() -> None:
    for name in NAMES:
        assert set(parts.part(name).numbers) <= set(parts.QUANTITIES)
