"""Geodetic and Earth-fixed coordinates, and displacements in metres, on the WGS-84 ellipsoid.

Frame e is Earth-fixed: x to latitude 0, longitude 0, y to longitude 90 deg east, z to the north
pole. Displacements between two points are straight lines through frame e: exact at any distance,
with no flat or spherical Earth assumed. What is left is the rounding of Earth-fixed coordinates,
some nanometres.

References
----------
.. [1] B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey Review
   23(181), 1976.
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., Artech House, 2013, section 2.4.3.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS

Number = float | FloatArray

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

    Parameters
    ----------
    latitude, longitude : float or ndarray, shape (...)
        Where it begins: geodetic latitude and longitude [rad].
    height : float or ndarray, shape (...)
        Height there [m].
    to_latitude, to_longitude : float or ndarray, shape (...)
        Where it ends [rad].
    to_height : float or ndarray, shape (...)
        Height there [m].
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
