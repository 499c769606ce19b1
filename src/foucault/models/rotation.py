"""Rotation vectors and matrices, vectorised. ``C_ab`` maps b to a: ``x_a = C_ab @ x_b``.

References
----------
.. [1] G. S. Chirikjian, *Stochastic Models, Information Theory, and Lie Groups*, vol. 2, 2012,
   section 10.3 (Jacobians of SO(3)).

Heading, pitch and roll, and the attitude matrix of the body.

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


def turned(angle: FloatArray) -> FloatArray:
    """Return `angle`, shape (...) [rad], between -pi and pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return [v x], shape (..., 3, 3), so that ``[v x] u = v x u``.

    `v` (..., 3): vectors [any unit].
    """
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def cross(v: FloatArray, u: FloatArray) -> FloatArray:
    """Return v x u, shape (..., 3), in half the time of `numpy.cross`.

    `v`, `u` (..., 3): vectors [any unit].
    """
    v0, v1, v2 = v[..., 0], v[..., 1], v[..., 2]
    u0, u1, u2 = u[..., 0], u[..., 1], u[..., 2]
    out = np.empty(np.broadcast_shapes(v.shape, u.shape))
    out[..., 0], out[..., 1], out[..., 2] = v1 * u2 - v2 * u1, v2 * u0 - v0 * u2, v0 * u1 - v1 * u0
    return out


def exp(phi: FloatArray) -> FloatArray:
    """Return the rotation matrix Exp(phi), shape (..., 3, 3), of a rotation vector.

    `phi` (..., 3): rotation vectors [rad].
    """
    square = np.einsum("...i,...i->...", phi, phi)[..., None, None]
    half = np.maximum(0.5 * np.sqrt(square), 1e-30)  # of no rotation, whose limits are the same
    K = cross_matrix(phi)
    sinc = np.sin(half) / half
    # sin a / a and (1 - cos a) / a^2, the latter without cancellation.
    return np.asarray(np.eye(3) + (sinc * np.cos(half)) * K + (0.5 * sinc**2) * (K @ K))


def log(C: FloatArray) -> FloatArray:
    """Return the rotation vector, shape (..., 3), of rotation matrices; angle below pi.

    `C` (..., 3, 3): rotation matrices [1].

    Goes through the quaternion of largest pivot, so that it is accurate at all angles.
    """
    trace = np.trace(C, axis1=-2, axis2=-1)
    q = np.empty((*trace.shape, 4))
    q[..., 0] = 1 + trace
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0)), 1):
        q[..., k] = C[..., i, j] - C[..., j, i]
    if np.any(trace < 0):  # the scalar part is the pivot up to 120 deg
        q = _by_pivot(C, trace, q)
    w, v = q[..., :1], q[..., 1:]
    sine = np.sqrt(np.einsum("...i,...i->...", v, v))[..., None]
    small = sine < 1e-12 * w
    return v * (2 * np.where(small, 1.0, np.arctan2(sine, w)) / np.where(small, w, sine))


def _by_pivot(C: FloatArray, trace: FloatArray, scalar: FloatArray) -> FloatArray:
    """Return four times the quaternion's largest part times it, its first part not negative.

    The row of the symmetric matrix 4 q q' with that pivot; `scalar` is the first, q = (w, x, y, z).
    """
    d = 2 * np.diagonal(C, axis1=-2, axis2=-1) - trace[..., None]
    sym = C + np.swapaxes(C, -1, -2)
    xy, xz, yz = sym[..., 0, 1], sym[..., 0, 2], sym[..., 1, 2]
    sx, sy, sz = scalar[..., 1], scalar[..., 2], scalar[..., 3]
    rows = np.stack(
        [
            scalar,
            np.stack([sx, 1 + d[..., 0], xy, xz], -1),
            np.stack([sy, xy, 1 + d[..., 1], yz], -1),
            np.stack([sz, xz, yz, 1 + d[..., 2]], -1),
        ],
        -2,
    )
    pivot = np.argmax(np.concatenate([trace[..., None], d], -1), axis=-1)
    q = np.take_along_axis(rows, pivot[..., None, None], axis=-2)[..., 0, :]
    return np.where(q[..., :1] < 0, -q, q)


def right_jacobian(phi: FloatArray) -> FloatArray:
    """Return J, shape (..., 3, 3), with ``Exp(phi + d) = Exp(phi) Exp(J d)`` to first order.

    `phi` (..., 3): rotation vectors [rad]. Its transpose is the left Jacobian.
    """
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    K = cross_matrix(phi)
    half = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos a) / a^2 without cancellation
    a = np.where(angle < 1e-2, 1.0, angle)
    third = np.where(angle < 1e-2, 1 / 6 - angle**2 / 120, (a - np.sin(a)) / a**3)
    return np.asarray(np.eye(3) - half * K + third * (K @ K))


def right_jacobian_inverse(phi: FloatArray) -> FloatArray:
    """Return J, shape (..., 3, 3), with ``Log(Exp(phi) Exp(d)) = phi + J d`` to first order.

    `phi` (..., 3): rotation vectors, angle below pi [rad]. Its transpose is the left inverse
    Jacobian.
    """
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    K = cross_matrix(phi)
    a = np.where(angle < 1e-4, 1.0, angle)
    factor = np.where(
        angle < 1e-4,
        1.0 / 12.0 + angle**2 / 720.0,
        1.0 / a**2 - (1 + np.cos(a)) / (2 * a * np.sin(a)),
    )
    return np.asarray(np.eye(3) + 0.5 * K + factor * (K @ K))


def aligning(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the smallest rotation C with ``C @ u = v`` for unit vectors, shape (3, 3).

    `u`, `v` (3,): unit vectors [1].
    """
    axis = np.cross(u, v)
    sine, cosine = float(np.linalg.norm(axis)), float(u @ v)
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        other = np.eye(3)[np.argmin(np.abs(u))]
        axis, sine = np.cross(u, other), 0.0
    return exp(np.arctan2(sine, cosine) * axis / np.linalg.norm(axis))


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
