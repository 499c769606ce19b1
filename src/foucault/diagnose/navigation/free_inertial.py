"""How the error of a stationary inertial navigator grows: the exact solution of its linear model.

Horizontal position, horizontal velocity and attitude, E-N-U, estimate minus truth, with constant
sensor errors (gyro eps, accelerometer D, both resolved in n, measured minus true)::

    dE' = dV_E                 phi_E' = -dV_N/(R_M+h) + w_U phi_N - w_N phi_U - eps_E
    dN' = dV_N                 phi_N' =  dV_E/(R_N+h) - w_U phi_E - w_U dN/(R_M+h) - eps_N
    dV_E' = -g phi_N + 2 w_U dV_N + D_E
    dV_N' =  g phi_E - 2 w_U dV_E + D_N
    phi_U' = dV_E tan L/(R_N+h) + w_N phi_E + w_N dN/(R_M+h) - eps_U

with ``w_N = w_ie cos L, w_U = w_ie sin L``. Nothing but seven combinations of the ten constants
phi(0), dV_E(0), dV_N(0), eps, D_E, D_N ever shows in position or velocity (substitute
phi_E + D_N/g and phi_N - D_E/g); they are `TERMS`::

    velocity east, velocity north
    tilt about north   phi_N - D_E/g            seen as an acceleration to the west
    tilt about east    phi_E + D_N/g            seen as an acceleration to the north
    drift about east   eps_E + w_N phi_U - w_U D_E/g       a heading error is an east gyro drift
    drift about north  eps_N - w_U D_N/g
    drift about up     eps_U + w_N D_N/g

Within a few hours these are the well-known terms of a channel, with ``w_s = sqrt(g/R)``:
velocity ``sin(w_s t)/w_s``, tilt ``R (1 - cos w_s t)``, drift ``R (t - sin(w_s t)/w_s)``, azimuth
drift ``R w_N (t^2/2 - (1 - cos w_s t)/w_s^2)``; the 24 h and the Foucault period are in the exact
solution, which `responses` computes.

References
----------
.. [1] D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., 2004,
   sections 12.3 and 12.5.
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 5.7.
.. [3] C. F. Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans.
   Automatic Control 23(3), 1978.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.models import earth

STATES = ("east", "north", "velocity east", "velocity north",
          "phi east", "phi north", "phi up")  # fmt: skip
"""Rows of the solution: m, m, m/s, m/s, rad, rad, rad."""

TERMS = ("velocity east", "velocity north", "tilt about east", "tilt about north",
         "drift about east", "drift about north", "drift about up")  # fmt: skip
"""What can be seen in position or velocity: m/s, m/s, rad, rad, rad/s, rad/s, rad/s."""

KINDS = ("velocity", "velocity", "angle", "angle", "angular rate", "angular rate", "angular rate")
"""Kind of each term, a key of `units.KINDS`."""

_START = {0: 2, 1: 3, 2: 4, 3: 5}  # term -> the state it is the start of
_INPUT = {4: 4, 5: 5, 6: 6}  # term -> the state it drives, with a minus sign


@dataclass(frozen=True)
class Place:
    """Where the navigator stands."""

    latitude: float  # geodetic latitude [rad]
    height: float  # height above the ellipsoid [m]
    gravity: float  # local gravity [m/s^2]

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of curvature plus height: of the meridian, of the prime vertical [m]."""
        meridian, across = earth.radii(self.latitude)
        return float(meridian) + self.height, float(across) + self.height

    @property
    def schuler_period(self) -> float:
        """2 pi sqrt(R/g), R the Gaussian mean radius [s]."""
        north, east = self.radii
        return 2 * math.pi * math.sqrt(math.sqrt(north * east) / self.gravity)

    @property
    def earth_rate(self) -> tuple[float, float]:
        """North and up component of the Earth's rate [rad/s]."""
        _, north, up = earth.earth_rate_n(self.latitude)
        return float(north), float(up)


def dynamics(place: Place) -> FloatArray:
    """Return F, shape (7, 7) [SI], of ``x' = F x`` with the states of `STATES`."""
    r_north, r_east = place.radii
    w_n, w_u = place.earth_rate
    g, tan = place.gravity, math.tan(place.latitude)
    return np.array(
        [
            [0, 0, 1, 0, 0, 0, 0],
            [0, 0, 0, 1, 0, 0, 0],
            [0, 0, 0, 2 * w_u, 0, -g, 0],
            [0, 0, -2 * w_u, 0, g, 0, 0],
            [0, 0, 0, -1 / r_north, 0, w_u, -w_n],
            [0, -w_u / r_north, 1 / r_east, 0, -w_u, 0, 0],
            [0, w_n / r_north, tan / r_east, 0, w_n, 0, 0],
        ],
        float,
    )


def responses(time: FloatArray, place: Place) -> FloatArray:
    """Compute what one unit of every term of `TERMS` makes of the states of `STATES`.

    `time` (m,): time since the terms held [s]. Returns (m, 7, 7): states, then terms [SI].

    The attitude rows are exact for tilts and drifts that are attitude and gyro errors; of an
    accelerometer error they are that of the attitude which moves position alike.
    """
    from scipy.linalg import expm

    F = np.zeros((10, 10))
    F[:7, :7] = dynamics(place)
    for term, state in _INPUT.items():
        F[state, term + 3] = -1.0
    Phi = expm(F * np.asarray(time, float)[:, None, None])
    columns = [_START[k] if k in _START else k + 3 for k in range(len(TERMS))]
    return np.asarray(Phi[:, :7, columns])


def noise_covariance(
    time: FloatArray, place: Place, gyro_white: float, accel_white: float
) -> FloatArray:
    """Compute what the white noise of the sensors makes of the states, at all epochs together.

    ``P(t_i, t_j) = Phi(t_i - t_j) P(t_j)`` for t_i >= t_j, ref. [3] for P.

    `time` (m,): time since the start, rising [s]; `gyro_white`, `accel_white`: white noise
    [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]. Returns (m, 7, m, 7): covariance of the states at every
    pair of epochs [SI].
    """
    from scipy.linalg import expm

    m = len(time)
    F = dynamics(place)
    Q = np.diag([0, 0, accel_white**2, accel_white**2, *[gyro_white**2] * 3])
    block = np.zeros((14, 14))
    block[:7, :7], block[:7, 7:], block[7:, 7:] = -F, Q, F.T
    steps, which = np.unique(np.round(np.diff(time, prepend=0.0), 9), return_inverse=True)
    both = expm(block * steps[:, None, None])
    Phi = np.swapaxes(both[:, 7:, 7:], 1, 2)
    noise = Phi @ both[:, :7, 7:]
    out = np.zeros((m, 7, m, 7))
    P = np.zeros((7, 7))
    for i in range(m):
        step = Phi[which[i]]
        if i:
            out[i, :, :i] = np.einsum("ab,bjc->ajc", step, out[i - 1, :, :i])
            out[:i, :, i] = np.transpose(out[i, :, :i], (1, 2, 0))
        P = step @ P @ step.T + noise[which[i]]
        out[i, :, i] = (P + P.T) / 2
    return out
