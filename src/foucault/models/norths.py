"""The three norths of a place: true, magnetic and of a grid, and headings from each.

A heading is clockwise from its north. With D the declination, the direction of magnetic north
clockwise from true north, and gamma the convergence of the grid's meridians, the direction of grid
north clockwise from true north::

    magnetic = true - D        grid = true - gamma

References
----------
.. [1] J. P. Snyder, *Map Projections: A Working Manual*, USGS Professional Paper 1395, 1987.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.errors import error
from foucault.models.earth import Site
from foucault.models.world_field import day_of, world_field


@dataclass(frozen=True)
class North:
    """One of them."""

    name: str  # true, magnetic or grid
    offset: float  # its direction clockwise from true north [rad]
    sd: float  # standard uncertainty of that [rad]
    basis: str  # what it rests on, for people

    def heading(self, true: float, sd: float = 0.0) -> tuple[float, float]:
        """Return a heading from this north, 0 to 2 pi, and its sd.

        `true`, `sd`: the heading from true north, and its standard deviation [rad].
        """
        turn = 2 * np.pi
        off = float((true - self.offset) % turn)
        return off if off < turn else 0.0, float(np.hypot(sd, self.sd))


def refuse_unknown(date: str | None, grid: str | None) -> None:
    """Refuse a day or a grid that nobody knows, before anything is read."""
    if date is not None:
        day_of(date)
    if grid is not None:
        _projection(grid)


def convergence(site: Site) -> float:
    """Return gamma, the direction of north of the grid of a site, clockwise from true north [rad].

    Its projection has a name that PROJ knows, such as "EPSG:32631" for UTM zone 31 north.
    """
    grid = site.grid
    if site.latitude is None or site.longitude is None:
        raise error("norths.no_place", what=f'grid = "{grid}"')
    system = _projection(str(grid))
    from pyproj import Proj
    from pyproj.exceptions import ProjError

    try:
        place = np.degrees(site.longitude), np.degrees(site.latitude)
        found = Proj(system).get_factors(*place, errcheck=True)
    except ProjError:
        raise error("norths.grid", grid=grid) from None
    return float(np.radians(found.meridian_convergence))


def _projection(grid: str) -> Any:
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ModuleNotFoundError:
        raise error("norths.no_library", what="A grid's north", package="pyproj", extra="grid",
                    key="grid") from None  # fmt: skip
    try:
        system = CRS.from_user_input(grid)
    except CRSError:
        raise error("norths.grid", grid=grid) from None
    if not system.is_projected:
        raise error("norths.grid", grid=grid)
    return system


def norths(site: Site) -> list[North]:
    """Return the norths that a site tells, true north first: by its date and by its grid."""
    out = [North("true", 0.0, 0.0, "the Earth's axis")]
    field = world_field(site)
    if field is not None:
        basis = f"world magnetic model, {site.date}"
        out.append(North("magnetic", field.declination, field.declination_sd, basis))
    if site.grid is not None:
        out.append(North("grid", convergence(site), 0.0, site.grid))
    return out
