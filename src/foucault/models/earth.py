"""The Earth: its rate of rotation and its gravity.

Frame n is East-North-Up. `latitude` is geodetic, positive north.

References
----------
.. [1] NIMA TR8350.2, *Department of Defense World Geodetic System 1984*, 3rd ed., 2000.
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., Artech House, 2013, sections 2.4.4 and 2.4.7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

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


def gravity(latitude: float, height: float = 0.0) -> float:
    """Compute normal gravity on the WGS-84 ellipsoid, with its free-air term.

    ``g = g_e (1 + k sin^2 L) / sqrt(1 - e^2 sin^2 L)``, then the second-order height term of
    ref. [1] eq. (4-3).

    Parameters
    ----------
    latitude : float, shape ()
        Geodetic latitude, positive north [rad].
    height : float, shape ()
        Height above the ellipsoid [m].

    Returns
    -------
    float
        Magnitude of normal gravity [m/s^2].

    Notes
    -----
    Real gravity differs from normal gravity by up to about 1e-3 m/s^2 (100 ppm of scale) in
    mountains; give a measured value where one is to be had.
    """
    s2 = np.sin(latitude) ** 2
    g0 = EQUATORIAL_GRAVITY * (1 + _SOMIGLIANA * s2) / np.sqrt(1 - ECCENTRICITY_SQUARED * s2)
    a = SEMI_MAJOR_AXIS
    polar = a * (1 - FLATTENING)
    m = EARTH_RATE**2 * a**2 * polar / GRAVITATIONAL_CONSTANT
    first = 2.0 / a * (1 + FLATTENING + m - 2 * FLATTENING * s2) * height
    return float(g0 * (1 - first + 3.0 * (height / a) ** 2))


def earth_rate_n(latitude: float) -> FloatArray:
    """Return the Earth's rotation in the local frame.

    ``w_ie_n = w_ie (0, cos L, sin L)`` in East-North-Up.

    Parameters
    ----------
    latitude : float, shape ()
        Geodetic latitude, positive north [rad].

    Returns
    -------
    ndarray, shape (3,)
        w_ie_n, frame n [rad/s].
    """
    return EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])


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
        Standard uncertainty of gravity [m/s^2]; a wrong g is a wrong scale of all
        accelerometers.
    """

    gravity: float
    latitude: float | None = None
    height: float = 0.0
    gravity_source: str = "given"
    gravity_sd: float = 0.0

    @classmethod
    def at(cls, latitude: float, height: float = 0.0) -> Site:
        """Return the site at `latitude` [rad] and `height` [m] with normal gravity."""
        return cls(gravity(latitude, height), latitude, height, "normal gravity")

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the site as plain values for result.json."""
        return {
            "gravity": self.gravity,
            "latitude": self.latitude,
            "height": self.height,
            "gravity_source": self.gravity_source,
            "gravity_sd": self.gravity_sd,
        }
