"""What of a navigation and its reference fits neither drift nor noise: clock and course.

Over some minutes the error of a navigator that moves is, in the horizontal plane,

    e(t) = tau v(t) + phi J p(t) + s p(t) + cubic in t

with the velocity v of the reference, its displacement p from the start, a heading error phi and a
scale error s; J turns by 90 degrees. Only a reference whose times are too large by tau makes an
error that goes with the velocity, and an antenna ahead of the instrument one that looks alike.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.navigation.errors import NavigationError
from foucault.errors import Finding, finding
from foucault.logs.reference import Reference
from foucault.models import geodesy
from foucault.models.rotation import turned
from foucault.units import plain

SPAN = 1200.0
"""For so long the drift of a navigator is a cubic, a quarter of a Schuler period [s]."""

EXPLAINS = 0.75
"""Part of the variance that drift leaves, of which the clock must explain as much [1]."""

FEWEST = 20
"""Epochs below which nothing is said [1]."""

LEAST, MOST = 0.02, 60.0
"""A clock that is off by less, or by more, is not spoken of [s]."""

STEPS = 6
"""Steps of the search [1]."""

STEADY = 0.02
"""Part of the velocity that must not look like drift [1]."""


WAY = 100.0
"""Courses are compared once the reference is so far from the start [m]."""

ASTRAY = np.radians(5.0)
"""Courses that differ by less are those of a poor heading, of which its sd tells [rad]."""


def course(errors: NavigationError, reference: Reference) -> tuple[Finding, ...]:
    """Return a warning where a navigation sets out in another direction than its reference."""
    if reference.still or reference.position is None:
        return ()
    place = reference.position[np.searchsorted(reference.time, errors.time)]
    known = np.isfinite(errors.position[:, :2]).all(axis=1)
    if not known.any():
        return ()
    path = geodesy.displacement(*place[known][0], *place[known].T)[:, :2]
    away = np.flatnonzero(np.hypot(*path.T) > WAY)
    if not len(away):
        return ()
    there = path[away[0]]
    error = errors.position[known][[0, away[0]], :2]
    computed = there + error[1] - error[0]
    # Drift that is as long as the way is no matter of heading.
    share = float(np.hypot(*computed) / np.hypot(*there))
    seen, wanted = (float(np.arctan2(*x)) for x in (computed, there))
    off = float(turned(np.array([seen - wanted]))[0])
    if abs(off) < ASTRAY or not 2 / 3 < share < 3 / 2:
        return ()
    words = {k: f"{np.degrees(v) % 360:.0f}" for k, v in (("seen", seen), ("wanted", wanted))}
    return (finding("navigate.course", off=f"{np.degrees(off):.0f}", **words),)


def clock(errors: NavigationError, reference: Reference) -> tuple[Finding, ...]:
    """Return a warning where a clock that is off explains most of the error beside drift."""
    late, speed = clock_offset(errors, reference)
    if not abs(late) > LEAST:
        return ()
    size = plain(abs(late), 2)
    way = "late" if late > 0 else "early"
    return (finding("navigate.clock", offset=size, way=way, distance=plain(abs(late) * speed, 2),
                    change="less" if late > 0 else "more",
                    place="ahead of" if late < 0 else "behind"),)  # fmt: skip


def clock_offset(errors: NavigationError, reference: Reference) -> tuple[float, float]:
    """Return by how much the times of a reference are too large, and the speed it is seen by.

    Returns `late`, `speed`: naN where the error does not show it [s], root mean square [m/s].
    """
    unseen = float("nan"), float("nan")
    if reference.still or reference.position is None:
        return unseen
    rows = np.searchsorted(reference.time, errors.time)
    known = np.isfinite(errors.position[:, :2]).all(axis=1) & (errors.age <= SPAN)
    if np.count_nonzero(known) < FEWEST:
        return unseen
    place = reference.position[rows[known]]
    path = geodesy.displacement(*place[0], *place.T)[:, :2]
    age = errors.age[known]
    velocity = np.gradient(path, age, axis=0)
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))
    if not speed > 0:
        return unseen
    across = path @ np.array([[0.0, -1.0], [1.0, 0.0]])
    drift = np.polynomial.polynomial.polyvander(age / age[-1], 3)
    A = np.column_stack([np.kron(np.eye(2), drift), _flat(across), _flat(path)])
    basis = np.linalg.svd(A / np.linalg.norm(A, axis=0), full_matrices=False)[0]
    e = _flat(errors.position[known, :2])
    late = explained = 0.0
    for _ in range(STEPS):  # on a long way off its course is not straight
        ahead = np.column_stack([np.interp(age + late, age, x) for x in path.T]) - path
        fast = np.column_stack([np.interp(age + late, age, x) for x in velocity.T])
        alone, left, v = (x - basis @ (basis.T @ x) for x in (e, e - _flat(ahead), _flat(fast)))
        if not np.linalg.norm(v) > STEADY * speed * np.sqrt(len(age)):
            return unseen  # a steady speed looks like drift
        step = float(v @ left / (v @ v))
        explained = 1 - float(np.sum((left - step * v) ** 2) / np.sum(alone**2))
        late += step
        if not abs(late) < MOST:
            return unseen
    return (late, speed) if explained > EXPLAINS else unseen


def _flat(x: FloatArray) -> FloatArray:
    return np.concatenate(x.T)
