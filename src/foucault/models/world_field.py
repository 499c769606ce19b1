"""The magnetic field of the Earth at a place, by the world magnetic model: offline, by pygeomag.

References
----------
.. [1] NOAA/NCEI, "The US/UK World Magnetic Model for 2025-2030", 2024.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass

import numpy as np

from foucault.errors import error
from foucault.models.earth import Site


@dataclass(frozen=True)
class WorldField:
    """The field that the model says, and its standard uncertainties."""

    intensity: float  # [T]
    dip: float  # positive where the field points down [rad]
    declination: float  # of its level part, clockwise from true north [rad]
    intensity_sd: float  # [T]
    # dip_sd, declination_sd: crust included, buildings not [rad]
    dip_sd: float
    declination_sd: float


FIRST, LAST = 2010.0, 2030.0
"""Years that the models in pygeomag are for, five each."""


def day_of(date: str) -> datetime.date:
    """Return a day that the models are for."""
    try:
        day = datetime.date.fromisoformat(date)
    except ValueError:
        raise error("norths.date", given=date) from None
    if not FIRST <= _year(day) < LAST:
        raise error("norths.date", given=date)
    return day


def _year(day: datetime.date) -> float:
    """Return a day as a year with its fraction."""
    return day.year + (day.timetuple().tm_yday - 0.5) / 365.25


def world_field(site: Site) -> WorldField | None:
    """Return the field at a site on its day; None where none is given."""
    date = site.date
    if date is None:
        return None
    if site.latitude is None or site.longitude is None:
        raise error("norths.no_place", what=f'date = "{date}"')
    day = day_of(date)
    try:
        from pygeomag import GeoMag
    except ModuleNotFoundError:
        raise error("norths.no_library", what="The world magnetic model", package="pygeomag",
                    extra="world", key="date") from None  # fmt: skip
    when = _year(day)
    model = GeoMag(coefficients_file=f"wmm/WMM_{int(when // 5) * 5}.COF")
    place = np.degrees(site.latitude), np.degrees(site.longitude)
    at = model.calculate(*place, site.height / 1e3, when)
    off = at.calculate_uncertainty()
    dip, declination, dip_sd, declination_sd = np.radians([at.i, at.d, off.i, off.d]).tolist()
    return WorldField(at.f * 1e-9, dip, declination, off.f * 1e-9, dip_sd, declination_sd)
