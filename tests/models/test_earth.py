"""The Earth against published values."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models import earth

DEG = np.pi / 180


@pytest.mark.parametrize(
    ("latitude", "published"),
    [
        (0.0, 9.7803253359),  # NIMA TR8350.2, table 3.4
        (90.0, 9.8321849379),  # NIMA TR8350.2 (WGS-84 as published 2014), pole
        (-90.0, 9.8321849379),
        (45.0, 9.8061977694),  # GeographicLib's Gravity documentation, WGS-84 normal gravity
    ],
)
def test_normal_gravity_on_the_ellipsoid(latitude: float, published: float) -> None:
    # The Somigliana constant has 13 digits: agreement to the last published one.
    assert earth.gravity(latitude * DEG) == pytest.approx(published, abs=6e-10)


@pytest.mark.parametrize("latitude", [0.0, 45.0, 80.0])
@pytest.mark.parametrize("height", [100.0, 1000.0, 3000.0])
def test_gravity_falls_as_the_published_free_air_correction(latitude: float, height: float) -> None:
    # Li and Goetze, Geophysics 66 (2001), eq. (6), in mGal, GRS-80. Both are expansions that
    # leave out terms of the order of the flattening squared, so they agree to 1e-4, not more.
    s2 = np.sin(latitude * DEG) ** 2
    published = -(0.3087691 - 0.0004398 * s2) * height + 7.2125e-8 * height**2
    fall = earth.gravity(latitude * DEG, height) - earth.gravity(latitude * DEG)
    assert fall / 1e-5 == pytest.approx(published, rel=1e-4)


def test_earth_rate_at_the_pole_equator_and_in_between() -> None:
    w = 7.292115e-5
    assert earth.earth_rate_n(0.0) == pytest.approx([0, w, 0])
    assert earth.earth_rate_n(np.pi / 2) == pytest.approx([0, 0, w], abs=1e-20)
    assert earth.earth_rate_n(-30 * DEG) == pytest.approx([0, w * np.sqrt(0.75), -w / 2])


def test_earth_turns_once_in_a_sidereal_day() -> None:
    assert 2 * np.pi / earth.EARTH_RATE == pytest.approx(86164.1, abs=0.05)


def test_site_at_a_latitude_uses_normal_gravity() -> None:
    site = earth.Site.at(45 * DEG, 100.0)
    assert site.gravity == earth.gravity(45 * DEG, 100.0)
    assert site.gravity_source == "normal gravity"
    assert earth.Site(9.81).latitude is None
