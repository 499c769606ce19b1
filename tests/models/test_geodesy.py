"""Earth-fixed and geodetic coordinates: published values, round trips, poles and date line."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.earth import (
    FLATTENING,
    SEMI_MAJOR_AXIS,
    displaced,
    displacement,
    east_north_up,
    ecef,
    geodetic,
)

POLE = SEMI_MAJOR_AXIS * (1 - FLATTENING)
ROUNDING = 1e-8  # some units in the last place of 6.4e6 m


def places() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    near = np.concatenate([[0.0], np.geomspace(1e-15, 1e-2, 60)])
    latitude = np.concatenate([
        np.arcsin(rng.uniform(-1, 1, 2000)), np.pi / 2 - near, near - np.pi / 2, near, -near
    ])  # fmt: skip
    return latitude, rng.uniform(-np.pi, np.pi, len(latitude))


def test_a_published_point() -> None:
    # IOGP Publication 373-7-2, geographic/geocentric conversions, example.
    latitude, longitude = np.radians([53 + 48 / 60 + 33.820 / 3600, 2 + 7 / 60 + 46.380 / 3600])
    xyz = [3771793.968, 140253.342, 5124304.349]
    assert ecef(latitude, longitude, 73.0) == pytest.approx(xyz, abs=1e-3)
    found = geodetic(np.array(xyz))
    assert found[0] == pytest.approx(latitude, abs=2e-10)
    assert found[1] == pytest.approx(longitude, abs=2e-10)
    assert found[2] == pytest.approx(73.0, abs=1e-3)


def test_poles_and_equator() -> None:
    assert ecef(np.pi / 2, 1.0, 5.0) == pytest.approx([0, 0, POLE + 5], abs=ROUNDING)
    assert ecef(0.0, -np.pi / 2, 5.0) == pytest.approx([0, -SEMI_MAJOR_AXIS - 5, 0], abs=ROUNDING)
    latitude, longitude, height = geodetic(np.array([[0, 0, POLE + 7], [0, 0, -POLE]]))
    assert latitude == pytest.approx([np.pi / 2, -np.pi / 2], abs=1e-15)
    assert longitude.tolist() == [0, 0]
    assert height == pytest.approx([7, 0], abs=ROUNDING)


@pytest.mark.parametrize("height", [-1e4, -100.0, 0.0, 5e3, 1e5, 1e6])
def test_round_trip_at_all_latitudes(height: float) -> None:
    latitude, longitude = places()
    xyz = ecef(latitude, longitude, height)
    back = geodetic(xyz)
    np.testing.assert_allclose(ecef(*back), xyz, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(back[2], height, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(back[0], latitude, rtol=0, atol=1e-15)


def test_axes_are_right_handed_and_follow_the_point() -> None:
    latitude, longitude = places()
    C_en = east_north_up(latitude, longitude)
    np.testing.assert_allclose(C_en @ C_en.swapaxes(1, 2), np.tile(np.eye(3), (len(C_en), 1, 1)),
                               atol=1e-15)  # fmt: skip
    np.testing.assert_allclose(np.cross(C_en[:, :, 0], C_en[:, :, 1]), C_en[:, :, 2], atol=1e-15)
    up = ecef(latitude, longitude, 1e6) - ecef(latitude, longitude, 0.0)
    np.testing.assert_allclose(up / 1e6, C_en[:, :, 2], atol=1e-13)
    step = 1e-6  # towards north and east
    north = ecef(latitude + step, longitude, 0.0) - ecef(latitude - step, longitude, 0.0)
    along = north / np.linalg.norm(north, axis=1, keepdims=True)
    np.testing.assert_allclose(along, C_en[:, :, 1], atol=1e-9)
    np.testing.assert_array_equal(C_en[:, 2, 0], 0.0)


def test_displacement_and_back() -> None:
    latitude, longitude = places()
    d_n = np.random.default_rng(2).normal(0.0, 1e3, (len(latitude), 3))
    there = displaced(latitude, longitude, 100.0, d_n)
    found = displacement(latitude, longitude, 100.0, *there)
    np.testing.assert_allclose(found, d_n, rtol=0, atol=ROUNDING)


def test_displacement_over_the_date_line_and_the_pole() -> None:
    west, east = np.radians(179.9999), np.radians(-179.9999)
    d = displacement(0.0, west, 0.0, 0.0, east, 0.0)
    assert d[0] == pytest.approx(np.radians(2e-4) * SEMI_MAJOR_AXIS, rel=1e-9)
    assert abs(d[1]) < ROUNDING
    latitude, longitude, _ = displaced(np.radians(10.0), west, 0.0, np.array([1e3, 0.0, 0.0]))
    assert east < longitude < -3.141 and latitude == pytest.approx(np.radians(10.0), abs=1e-7)
    # A kilometre on either side of the pole, along the meridians of 20 and -160 deg.
    off = 1e3 / 6399593.6
    d = displacement(np.pi / 2 - off, np.radians(20), 0.0, np.pi / 2 - off, np.radians(-160), 0.0)
    assert d[1] == pytest.approx(2e3, abs=1e-3) and abs(d[0]) < ROUNDING
    assert d[2] == pytest.approx(-2e3 * off, rel=1e-3)
