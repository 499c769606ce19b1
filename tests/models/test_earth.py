"""The Earth against published values."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.campaign.tables import SiteTable
from foucault.models import earth
from foucault.models.earth import east_north_up
from foucault.models.rotation import log

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


def test_a_site_from_python_has_the_gravity_sd_of_a_campaign() -> None:
    for said in ({"latitude": "48 deg"}, {"latitude": "48 deg", "gravity": "9.809 m/s^2"}):
        told = SiteTable.model_validate(said).site()
        assert told.latitude is not None
        given = earth.Site(9.809, told.latitude)
        same = given if "gravity" in said else earth.Site.at(told.latitude)
        assert same.as_dict() == told.as_dict()
        assert same.gravity_sd == 4e-4
    exact = SiteTable.model_validate({"latitude": "48 deg", "gravity_sd": "0 m/s^2"}).site()
    assert exact.gravity_sd == 0.0


def test_gravity_and_earth_rate_of_many_places_are_those_of_each() -> None:
    L, h = np.radians([[-90.0, -12.0], [0.0, 53.0]]), np.array([[0.0, 10.0], [9e3, -30.0]])
    alone = np.vectorize(earth.gravity)(L, h)
    assert isinstance(earth.gravity(0.3), float)
    np.testing.assert_allclose(earth.gravity(L, h), alone, rtol=1e-15)
    np.testing.assert_allclose(earth.gravity_n(L, h, 2e-4)[..., 2], -(alone + 2e-4), rtol=1e-15)
    np.testing.assert_array_equal(earth.gravity_n(L, h)[..., :2], 0.0)
    assert earth.earth_rate_n(L).shape == (2, 2, 3)
    np.testing.assert_array_equal(earth.earth_rate_n(L)[1, 1], earth.earth_rate_n(L[1, 1]))


def test_radii_of_curvature_are_the_published_ones() -> None:
    RM, RN = earth.radii(np.radians([0.0, 90.0]))
    # Moritz, Geodetic Reference System 1980 and NIMA TR8350.2, table 3.5: polar radius of
    # curvature; at the equator a (1 - e^2) and a.
    assert RN[0] == 6378137.0
    assert RM[0] == pytest.approx(6378137.0 * (1 - 6.69437999014e-3), abs=1e-4)
    assert pytest.approx([6399593.6258, 6399593.6258], abs=1e-4) == [RM[1], RN[1]]


def test_quarter_of_the_meridian_has_its_published_length() -> None:
    x, weight = np.polynomial.legendre.leggauss(20)
    RM, _ = earth.radii(np.pi / 4 * (1 + x))
    assert np.pi / 4 * weight @ RM == pytest.approx(10001965.7293, abs=1e-4)


def test_transport_rate_is_how_a_moving_level_frame_turns() -> None:
    rng = np.random.default_rng(5)
    L, lon, h = rng.uniform(-1.5, 1.5, 20), rng.uniform(-3, 3, 20), rng.uniform(-1e3, 2e4, 20)
    v = rng.normal(0.0, 200.0, (20, 3))
    RM, RN = earth.radii(L)
    ahead = 0.05

    def frame(t: float) -> np.ndarray:
        return east_north_up(L + v[:, 1] / (RM + h) * t, lon + v[:, 0] / (RN + h) / np.cos(L) * t)

    turned = log(np.swapaxes(frame(-ahead), 1, 2) @ frame(ahead)) / (2 * ahead)
    # The difference is even in time: what is left is of the third order of the angle.
    np.testing.assert_allclose(turned, earth.transport_rate(L, h, v), rtol=1e-6, atol=1e-11)
