"""True, magnetic and grid north, beside published values."""

from __future__ import annotations

import builtins
from dataclasses import replace

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.norths import convergence, norths
from refusals import refuses

PARIS = replace(Site.at(np.radians(48.8462)), longitude=np.radians(2.3464))


def at(latitude: float, longitude: float, height: float = 0.0) -> Site:
    return replace(Site.at(np.radians(latitude), height), longitude=np.radians(longitude))


@pytest.mark.parametrize(("latitude", "longitude", "zone", "middle"), [
    (48.8462, 2.3464, "EPSG:32631", 3.0), (60.0, 12.0, "EPSG:32632", 9.0),
    (-33.9, 18.4, "EPSG:32734", 21.0), (1.3, 103.8, "EPSG:32648", 105.0),
])  # fmt: skip
def test_convergence_of_utm(latitude, longitude, zone, middle) -> None:
    # Of the sphere; the ellipsoid adds cos^2(latitude) e'^2 (longitude - middle)^2 of it.
    away, phi = np.radians(longitude - middle), np.radians(latitude)
    sphere = np.arctan(np.tan(away) * np.sin(phi))
    found = convergence(replace(at(latitude, longitude), grid=zone))
    assert abs(found - sphere) < 1.1 * 0.00674 * away**2 * abs(sphere) + 1e-12
    assert abs(found) > 1e-4


def test_convergence_of_lambert_is_the_cone_times_the_longitude() -> None:
    # Lambert-93: IGN gives n = 0.7256077650 and 3 deg for the middle.
    found = convergence(replace(at(45.0, 5.0), grid="EPSG:2154"))
    assert np.degrees(found) == pytest.approx(0.7256077650 * 2.0, abs=1e-6)


@pytest.mark.parametrize(("date", "height", "latitude", "longitude", "declination"), [
    ("2025-01-01", 28e3, 89.0, -121.0, -99.81), ("2025-01-01", 48e3, 80.0, -96.0, -29.91),
])  # fmt: skip
def test_declination_of_the_world_model(date, height, latitude, longitude, declination) -> None:
    """Test values that NOAA publishes with WMM2025."""
    found = norths(replace(at(latitude, longitude, height), date=date))[1]
    assert np.degrees(found.offset) == pytest.approx(declination, abs=0.06)
    assert found.sd > np.radians(0.2)


def test_headings_from_three_norths() -> None:
    true, magnetic, grid = norths(replace(PARIS, date="2026-05-04", grid="EPSG:32631"))
    assert [n.name for n in (true, magnetic, grid)] == ["true", "magnetic", "grid"]
    assert true.heading(1.0, 0.1) == (1.0, 0.1)
    # Magnetic north is east of true north in Paris, grid north west of it.
    assert 0 < np.degrees(magnetic.offset) < 4
    assert grid.offset < 0
    for north in (magnetic, grid):
        heading, sd = north.heading(0.001, 0.1)
        assert heading == pytest.approx((0.001 - north.offset) % (2 * np.pi))
        assert sd == pytest.approx(np.hypot(0.1, north.sd))
    assert [n.name for n in norths(PARIS)] == ["true"]


def test_what_is_no_grid_is_refused() -> None:
    for grid in ("EPSG:4326", "EPSG:99999", "nowhere"):
        with refuses("norths.grid", f'"{grid}" is no projected grid'):
            norths(replace(PARIS, grid=grid))
    with refuses("norths.no_place", "latitude or longitude is missing"):
        norths(replace(Site.at(0.5), grid="EPSG:32631"))


@pytest.mark.parametrize(("library", "extra", "asked"), [
    ("pyproj", "grid", {"grid": "EPSG:32631"}), ("pygeomag", "world", {"date": "2026-05-04"}),
])  # fmt: skip
def test_a_library_that_is_not_there_is_named(
    library: str, extra: str, asked: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *rest: object, **more: object):
        if name.startswith(library):
            raise ModuleNotFoundError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with refuses(
        "norths.no_library",
        f"and {library}, which brings it, is not installed",
        f"foucault[{extra}]",
    ):
        norths(replace(PARIS, **asked))
