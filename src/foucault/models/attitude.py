"""Heading, pitch and roll, and the attitude matrix of the body.

Heading is clockwise from north, pitch is nose up, roll is right side down; body axes are right,
forward, up, frame n is East-North-Up, and ``x_n = C_nb @ x_b``::

    C_nb = R_z(-heading) R_x(pitch) R_y(roll)

         = [[ cR cH + sR sP sH,   cP sH,    sR cH - cR sP sH],
            [-cR sH + sR sP cH,   cP cH,   -sR sH - cR sP cH],
            [-sR cP,              sP,       cR cP           ]]

with s and c for sine and cosine. The same holds for any other level frame in place of n, with the
heading clockwise from its second axis.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray


def matrix_of(
    heading: float | FloatArray, pitch: float | FloatArray, roll: float | FloatArray
) -> FloatArray:
    """Return C_nb, shape (..., 3, 3).

    `heading`, `pitch`, `roll` (...): angles of the body, of shapes that broadcast [rad].
    """
    H, P, R = np.broadcast_arrays(heading, pitch, roll)
    sH, cH, sP, cP, sR, cR = np.sin(H), np.cos(H), np.sin(P), np.cos(P), np.sin(R), np.cos(R)
    out = np.empty((*H.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1] = cR * cH + sR * sP * sH, cP * sH
    out[..., 1, 0], out[..., 1, 1] = -cR * sH + sR * sP * cH, cP * cH
    out[..., 0, 2], out[..., 1, 2] = sR * cH - cR * sP * sH, -sR * sH - cR * sP * cH
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = -sR * cP, sP, cR * cP
    return out


def angles_of(C_nb: FloatArray) -> FloatArray:
    """Return heading in [0, 2 pi), pitch and roll, shape (..., 3) [rad].

    `C_nb` (..., 3, 3): attitude, body to East-North-Up [1].

    With the nose straight up or down only heading minus or plus roll is defined; roll is then 0.
    """
    level = np.hypot(C_nb[..., 2, 0], C_nb[..., 2, 2])
    pitch = np.arctan2(C_nb[..., 2, 1], level)
    upright = level > 1e-12
    roll = np.where(upright, np.arctan2(-C_nb[..., 2, 0], C_nb[..., 2, 2]), 0.0)
    forward = np.arctan2(C_nb[..., 0, 1], C_nb[..., 1, 1])
    right = np.arctan2(-C_nb[..., 1, 0], C_nb[..., 0, 0])
    heading = np.where(upright, forward, right) % (2 * np.pi)
    # The remainder of a tiny negative angle rounds to 2 pi itself.
    return np.stack([np.where(heading < 2 * np.pi, heading, 0.0), pitch, roll], axis=-1)


def body_rate(angles: FloatArray, rates: FloatArray) -> FloatArray:
    """Return w_nb_b, shape (..., 3) [rad/s], from the rates of heading, pitch and roll.

    ``w_nb_b = R_y(-roll) (R_x(-pitch) (0, 0, -heading') + (pitch', 0, 0)) + (0, roll', 0)``

    `angles` (..., 3): heading, pitch and roll [rad]; `rates` (..., 3): their derivatives [rad/s].
    """
    dH, dP, dR = rates[..., 0], rates[..., 1], rates[..., 2]
    sP, cP = np.sin(angles[..., 1]), np.cos(angles[..., 1])
    sR, cR = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    down = dH * cP
    return np.stack([cR * dP + sR * down, dR - sP * dH, sR * dP - cR * down], axis=-1)
