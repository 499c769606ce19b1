"""The Earth: its rate of rotation, its gravity and its shape, and places on it.

Frame n is East-North-Up. `latitude` is geodetic, positive north. Frame e is Earth-fixed: x to
latitude 0, longitude 0, y to longitude 90 deg east, z to the north pole. Displacements between two
points are straight lines through frame e: exact at any distance, with no flat or spherical Earth
assumed. What is left is the rounding of Earth-fixed coordinates, some nanometres.

References
----------
.. [1] NIMA TR8350.2, *Department of Defense World Geodetic System 1984*, 3rd ed., 2000.
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., Artech House, 2013, sections 2.4.2 to 2.4.4 and 2.4.7, eqs. (5.42), (5.44).
.. [3] B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey Review
   23(181), 1976.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any, overload

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, require

Number = float | FloatArray

EARTH_RATE = 7.292115e-5
"""Angular rate of the Earth relative to inertial space, WGS-84 [rad/s]."""

SEMI_MAJOR_AXIS = 6378137.0
"""WGS-84 semi-major axis [m]."""

FLATTENING = 1.0 / 298.257223563
"""WGS-84 flattening [1]."""

ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
"""WGS-84 first eccentricity squared [1]."""

GRAVITATIONAL_CONSTANT = 3.986004418e14
"""WGS-84 geocentric gravitational constant [m^3/s^2]."""

EQUATORIAL_GRAVITY = 9.7803253359
"""Normal gravity at the equator [m/s^2], ref. [1] table 3.4."""

NORMAL_GRAVITY_SD = 4e-4
"""Typical departure of real from normal gravity, a free-air anomaly of 40 mGal [m/s^2]."""

_SOMIGLIANA = 1.931852652458e-3  # k of ref. [1] eq. (4-1)


@overload
def gravity(latitude: float, height: float = 0.0) -> float: ...
@overload
def gravity(latitude: FloatArray, height: Number = 0.0) -> FloatArray: ...
def gravity(latitude: Number, height: Number = 0.0) -> Number:
    """Compute normal gravity on the WGS-84 ellipsoid, with its free-air term.

    ``g = g_e (1 + k sin^2 L) / sqrt(1 - e^2 sin^2 L)``, then the second-order height term of
    ref. [1] eq. (4-3).

    `latitude` (...): geodetic latitude, positive north [rad]; `height` (...): height above the
    ellipsoid [m]. Returns (...): magnitude of normal gravity [m/s^2].

    Real gravity differs from normal gravity by up to about 1e-3 m/s^2 (100 ppm of scale) in
    mountains; give a measured value where one is to be had.
    """
    s2 = np.sin(latitude) ** 2
    g0 = EQUATORIAL_GRAVITY * (1 + _SOMIGLIANA * s2) / np.sqrt(1 - ECCENTRICITY_SQUARED * s2)
    a = SEMI_MAJOR_AXIS
    polar = a * (1 - FLATTENING)
    m = EARTH_RATE**2 * a**2 * polar / GRAVITATIONAL_CONSTANT
    first = 2.0 / a * (1 + FLATTENING + m - 2 * FLATTENING * s2) * height
    out = np.asarray(g0 * (1 - first + 3.0 * (height / a) ** 2))
    return out if out.ndim else float(out)


def gravity_n(latitude: Number, height: Number = 0.0, offset: float = 0.0) -> FloatArray:
    """Return the gravity vector, ``g_n = (0, 0, -(g + offset))``.

    `latitude` (...): geodetic latitude, positive north [rad]; `height` (...): height above the
    ellipsoid [m]; `offset`: measured local gravity minus normal gravity [m/s^2]. Returns (...,
    3): g_n, frame n [m/s^2].

    Along the normal of the ellipsoid at every height. Above it normal gravity leans towards the
    equator by 8e-9 h sin 2L m/s^2, ref. [2] eq. (2.140): at 10 km as much as a deflection of the
    vertical of 1.7 arcsec. It is left out, as that is.
    """
    g = np.asarray(gravity(np.asarray(latitude), height)) + offset
    return np.stack([np.zeros_like(g), np.zeros_like(g), -g], axis=-1)


def earth_rate_n(latitude: Number) -> FloatArray:
    """Return the Earth's rotation in the local frame.

    ``w_ie_n = w_ie (0, cos L, sin L)`` in East-North-Up.

    `latitude` (...): geodetic latitude, positive north [rad]. Returns (..., 3): w_ie_n, frame n
    [rad/s].
    """
    s, c = np.sin(latitude), np.cos(latitude)
    return EARTH_RATE * np.stack([np.zeros_like(s), c, s], axis=-1)


def radii(latitude: Number) -> tuple[FloatArray, FloatArray]:
    """Return the radii of curvature of the ellipsoid, of the meridian and the prime vertical.

    ``RN = a / sqrt(1 - e^2 sin^2 L)``, ``RM = RN (1 - e^2) / (1 - e^2 sin^2 L)``; ref. [2]
    eqs. (2.105), (2.106).

    `latitude` (...): geodetic latitude, positive north [rad]. Returns `RM`, `RN` (...): along the
    meridian, and across it [m].
    """
    d = 1.0 - ECCENTRICITY_SQUARED * np.sin(np.asarray(latitude, dtype=float)) ** 2
    RN = np.asarray(SEMI_MAJOR_AXIS / np.sqrt(d))
    return np.asarray(RN * (1.0 - ECCENTRICITY_SQUARED) / d), RN


def transport_rate(latitude: Number, height: Number, velocity_n: FloatArray) -> FloatArray:
    """Return the rate at which frame n turns relative to the Earth because it moves.

    ``w_en_n = (-v_N / (RM + h), v_E / (RN + h), v_E tan L / (RN + h))``, ref. [2] eq. (5.44).

    `latitude` (...): geodetic latitude, positive north [rad]; `height` (...): height above the
    ellipsoid [m]; `velocity_n` (..., 3): velocity relative to the Earth, frame n [m/s]. Returns
    (..., 3): w_en_n, frame n [rad/s].

    The up component grows without limit towards the poles, where east and north turn with the
    meridians.
    """
    RM, RN = radii(latitude)
    east = velocity_n[..., 0] / (RN + height)
    north = velocity_n[..., 1] / (RM + height)
    return np.stack(np.broadcast_arrays(-north, east, east * np.tan(latitude)), axis=-1)


def require_latitude(given: float | None) -> None:
    """Refuse a latitude beyond a pole, as one in degrees is.

    `given` or None: geodetic latitude, None where it is unknown [rad].
    """
    require("site.latitude", given, Real, none=True)
    if given is not None and not abs(given) <= np.pi / 2 + 1e-12:
        raise error("site.latitude", given=np.degrees(given))


def require_longitude(given: float | None) -> None:
    """Refuse a longitude beyond a whole turn, as one in degrees is.

    `given` or None: longitude, positive east, None where it is unknown [rad].
    """
    require("site.longitude", given, Real, none=True)
    if given is not None and not abs(given) <= 2 * np.pi + 1e-12:
        raise error("site.longitude", given=np.degrees(given))


@dataclass(frozen=True)
class Site:
    """Where the instrument stands.

    Attributes
    ----------
    gravity : float
        Local magnitude of gravity [m/s^2].
    latitude : float or None
        Geodetic latitude, positive north [rad]; None where unknown (no Earth rate modelled).
    height : float
        Height above the ellipsoid [m].
    gravity_source : str
        "given" or "normal gravity".
    gravity_sd : float
        Standard uncertainty of gravity; a wrong g is a wrong scale of all accelerometers. Left
        out, as in a campaign: that of a gravity model of the place, 40 mGal, for gravity that is
        given too, since a number alone may be from a map or another town [m/s^2].
    longitude : float or None
        Longitude, positive east, where it is known [rad].
    date, grid : str or None
        Day, such as "2026-05-04", for magnetic north, and projection, such as "EPSG:32631", for
        the north of a grid; see `models.norths`.
    """

    gravity: float
    latitude: float | None = None
    height: float = 0.0
    gravity_source: str = "given"
    gravity_sd: float = NORMAL_GRAVITY_SD
    longitude: float | None = None
    date: str | None = None
    grid: str | None = None

    def __post_init__(self) -> None:
        for name, given in (("gravity", self.gravity), ("height", self.height)):
            require(f"site.{name}", given, Real)
        if not 0 < self.gravity < np.inf:
            raise error("site.gravity", given=self.gravity)
        require_latitude(self.latitude)
        require_longitude(self.longitude)

    @classmethod
    def at(cls, latitude: float, height: float = 0.0) -> Site:
        """Return the site at `latitude` [rad] and `height` [m] with normal gravity."""
        require_latitude(latitude)
        return cls(gravity(latitude, height), latitude, height, "normal gravity")

    @property
    def anomaly(self) -> float:
        """Local minus normal gravity; the latitude must be known [m/s^2]."""
        assert self.latitude is not None
        return self.gravity - float(gravity(self.latitude, self.height))

    @property
    def said(self) -> dict[str, Any]:
        """All of it as plain values; of date and grid what there is."""
        asked = ("date", "grid")
        return {k: v for k, v in asdict(self).items() if v is not None or k not in asked}

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the site as plain values for result.json."""
        return {
            "gravity": self.gravity,
            "latitude": self.latitude,
            "height": self.height,
            "gravity_source": self.gravity_source,
            "gravity_sd": self.gravity_sd,
        }


_ROUNDS = 3  # of Bowring's step; each gains some six digits up to 1000 km of height


def ecef(latitude: Number, longitude: Number, height: Number) -> FloatArray:
    """Return the Earth-fixed coordinates of points, frame e, shape (..., 3) [m].

    `latitude`, `longitude` (...): geodetic latitude and longitude [rad]; `height` (...): height
    above the ellipsoid [m].
    """
    s, c = np.sin(latitude), np.cos(latitude)
    N = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s**2)
    p = (N + height) * c
    z = (N * (1.0 - ECCENTRICITY_SQUARED) + height) * s
    xyz = np.broadcast_arrays(p * np.cos(longitude), p * np.sin(longitude), z)
    return np.stack(xyz, axis=-1)


def geodetic(xyz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return geodetic latitude [rad], longitude in (-pi, pi] [rad] and height [m], shape (...).

    `xyz` (..., 3): points, frame e [m].

    Better than a micrometre at every latitude for heights from -10 km to 1000 km. On the axis
    the longitude is 0.
    """
    x, y, z = np.moveaxis(np.asarray(xyz, dtype=float), -1, 0)
    p = np.hypot(x, y)
    a, b = SEMI_MAJOR_AXIS, SEMI_MAJOR_AXIS * (1.0 - FLATTENING)
    across, along = ECCENTRICITY_SQUARED * a, ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED) * b
    reduced = np.arctan2(z, (1.0 - FLATTENING) * p)
    for _ in range(_ROUNDS):
        latitude = np.arctan2(z + along * np.sin(reduced) ** 3, p - across * np.cos(reduced) ** 3)
        reduced = np.arctan2((1.0 - FLATTENING) * np.sin(latitude), np.cos(latitude))
    s = np.sin(latitude)
    # Free of the division by a cosine or sine that fails at pole or equator.
    height = p * np.cos(latitude) + z * s - a * np.sqrt(1.0 - ECCENTRICITY_SQUARED * s**2)
    return latitude, np.arctan2(y, x), height


def east_north_up(latitude: Number, longitude: Number) -> FloatArray:
    """Return C_en, shape (..., 3, 3), whose columns are east, north and up in frame e.

    `latitude`, `longitude` (...): geodetic latitude and longitude [rad]. At a pole north is along
    the meridian given.
    """
    L, lon = np.broadcast_arrays(latitude, longitude)
    sL, cL, s, c = np.sin(L), np.cos(L), np.sin(lon), np.cos(lon)
    out = np.zeros((*L.shape, 3, 3))
    out[..., 0, 0], out[..., 1, 0] = -s, c
    out[..., 0, 1], out[..., 1, 1], out[..., 2, 1] = -sL * c, -sL * s, cL
    out[..., 0, 2], out[..., 1, 2], out[..., 2, 2] = cL * c, cL * s, sL
    return out


def displacement(
    latitude: Number,
    longitude: Number,
    height: Number,
    to_latitude: Number,
    to_longitude: Number,
    to_height: Number,
) -> FloatArray:
    """Return the vector from one point to another, frame n of the first, shape (..., 3) [m].

    ``d_n = C_ne (r_e(to) - r_e)``, exact at any distance.

    `latitude`, `longitude`, `height` (...): geodetic, where it begins [rad], [m]; `to_latitude`,
    `to_longitude`, `to_height` (...): where it ends [rad], [m].
    """
    d_e = ecef(to_latitude, to_longitude, to_height) - ecef(latitude, longitude, height)
    return np.asarray(np.einsum("...ji,...j->...i", east_north_up(latitude, longitude), d_e))


def displaced(
    latitude: Number, longitude: Number, height: Number, d_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitude, longitude [rad] and height [m], shape (...), after a displacement.

    The inverse of `displacement`, exact at any distance.

    `latitude`, `longitude` (...): where it begins: geodetic latitude and longitude [rad];
    `height` (...): height there [m]; `d_n` (..., 3): displacement, frame n of the point where it
    begins [m].
    """
    d_e = np.einsum("...ij,...j->...i", east_north_up(latitude, longitude), d_n)
    return geodetic(ecef(latitude, longitude, height) + d_e)
