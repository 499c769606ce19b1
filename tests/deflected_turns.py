"""What whole turns about a level axis leave of a deflection: the closed form, beside the filter."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.deflection import DeflectionModel


def tilt_form(T: FloatArray) -> FloatArray:
    """Return S of the text above, shape (..., 3, 3) [unit of T].

    `T` (..., 3, 3, 3): gyro, direction, axis of the specific force [rad/(m/s^2)].
    """
    e = np.zeros((3, 3, 3))
    for i in range(3):
        e[i, i - 2, i - 1], e[i, i - 1, i - 2] = 1.0, -1.0
    return np.asarray(np.einsum("ikm,...ijk->...jm", e, T))


def whole_turns(
    T: FloatArray, u: FloatArray, angle: float, gravity: float, *, about: str = "north"
) -> FloatArray:
    """Return the attitude error that whole turns about a level axis leave, shape (..., 3) [rad].

    `T` (3, 3, 3): gyro, direction, axis of the specific force [rad/(m/s^2)]; `u` (..., 3): axis
    of the turns in body axes [1]; `angle`: angle turned through, a multiple of 2 pi, its sign is
    the sense [rad]; `gravity`: gravity [m/s^2]; `about`: "north" or "east": the direction of the
    axis. Returns (..., 3): phi about east, north, up [rad].
    """
    half = 0.5 * angle * gravity
    level = half * np.einsum("...j,jm,...m->...", u, tilt_form(T), u)
    up = -half * (
        np.einsum("iji,...j->...", T, u) - np.einsum("ijk,...i,...j,...k->...", T, u, u, u)
    )
    zero = np.zeros_like(level)
    if about == "east":
        return np.stack([zero, -level, up], axis=-1)
    return np.stack([level, zero, up], axis=-1)


def tilt_design(model: DeflectionModel, u: FloatArray) -> FloatArray:
    """Return ``u' S u`` of one unit of each parameter, shape (n, p) [1].

    `u` (n, 3): axis of the spin in body axes [1].
    """
    return np.asarray(np.einsum("nj,pjm,nm->np", u, tilt_form(model.basis), u))


def tilt_rank(model: DeflectionModel) -> int:
    """How many combinations of the parameters whole turns can tilt by: no poses see more."""
    S = tilt_form(model.basis)
    S = (S + np.swapaxes(S, 1, 2)).reshape(len(model), 9)
    values = np.linalg.svd(S, compute_uv=False)
    return int(np.count_nonzero(values > 1e-9 * max(values[0], 1.0)))
