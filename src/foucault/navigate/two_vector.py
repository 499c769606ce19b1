"""Attitude at rest from two vectors: gravity and the Earth's rotation, each as a mean.

Up is the direction of the mean specific force, which is fitted exactly; east is at right angles to
it and to the mean rate::

    u = f / |f|,   e = w x u / |w x u|,   C_nb = [e'; (u x e)'; u']

The part of the mean rate along up is not used: with up it says the latitude (`latitude_seen`).
Errors df, dw of the means, resolved in n, make the attitude error phi (E, N, U)::

    phi_E = -df_N / g,   phi_N = df_E / g,   phi_U = tan L df_E / g - dw_E / (w_ie cos L)

The body must not turn at all, and not sway much: a sway leaves a mean rate of its amplitude over
the length of the mean. `navigate.inertial_frame` withstands it.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., Artech House, 2013, section 5.6.2 (gyrocompassing), eqs. (5.105)-(5.107).
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.earth import EARTH_RATE


def two_vector(f_b: FloatArray, w_ib_b: FloatArray) -> FloatArray:
    """Return C_nb, shape (3, 3), from the means of specific force and rate.

    `f_b` (3,): mean specific force, frame b, its direction is fitted exactly [m/s^2]; `w_ib_b`
    (3,): mean angular rate, frame b [rad/s].
    """
    east = np.cross(w_ib_b, f_b)
    size = float(np.linalg.norm(east))
    if not size > 0 or not np.isfinite(size):
        raise error("alignment.parallel", rate=np.linalg.norm(w_ib_b), force=np.linalg.norm(f_b))
    up, east = f_b / np.linalg.norm(f_b), east / size
    return np.array([east, np.cross(up, east), up])


def two_vector_slopes(latitude: float, gravity: float) -> tuple[FloatArray, FloatArray]:
    """Return d phi / d f_n and d phi / d w_n, each shape (3, 3).

    `latitude`: geodetic latitude, positive north [rad]; `gravity`: local gravity [m/s^2]. Returns
    `by_force` (3, 3): attitude error (E, N, U) per error of the mean specific force in n
    [rad/(m/s^2)]; `by_rate` (3, 3): the same per error of the mean rate in n [s].
    """
    by_force, by_rate = np.zeros((3, 3)), np.zeros((3, 3))
    by_force[0, 1], by_force[1, 0] = -1.0 / gravity, 1.0 / gravity
    by_force[2, 0] = np.tan(latitude) / gravity
    by_rate[2, 0] = -1.0 / (EARTH_RATE * np.cos(latitude))
    return by_force, by_rate


def two_vector_covariance(
    C_nb: FloatArray, latitude: float, gravity: float, f_cov: FloatArray, w_cov: FloatArray
) -> FloatArray:
    """Return the covariance of phi (E, N, U), shape (3, 3) [rad^2].

    `C_nb` (3, 3): the attitude found [1]; `latitude`: geodetic latitude, positive north [rad];
    `gravity`: local gravity [m/s^2]; `f_cov`, `w_cov` (3, 3): covariance of the means in b: noise
    and what the biases may be [m^2/s^4], [rad^2/s^2].
    """
    by_force, by_rate = (slope @ C_nb for slope in two_vector_slopes(latitude, gravity))
    return np.asarray(by_force @ f_cov @ by_force.T + by_rate @ w_cov @ by_rate.T)


def latitude_seen(f_b: FloatArray, w_ib_b: FloatArray) -> float:
    """Return the latitude that the means show, ``asin(f . w / (|f| |w|))`` [rad].

    `f_b` (3,): mean specific force, frame b [m/s^2]; `w_ib_b` (3,): mean angular rate, frame b
    [rad/s].
    """
    sine = f_b @ w_ib_b / (np.linalg.norm(f_b) * np.linalg.norm(w_ib_b))
    return float(np.arcsin(np.clip(sine, -1.0, 1.0)))
