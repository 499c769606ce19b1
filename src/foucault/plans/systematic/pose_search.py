"""Search for poses in which spins tell the deflection of dithered gyros best.

From many random sets each slides down to where no small change of an angle is better; the best of
them is taken. What is made small is the root mean square of the standard deviations (A-optimal).
"""

from __future__ import annotations

import re
from math import pi

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.plans.systematic.spin_poses import design, poses, quality, spin_axis

FREE = (-pi, pi)


def best_poses(
    count: int = 6,
    *,
    starts: int = 100,
    seed: int = 0,
    about_z: tuple[float, float] = FREE,
    about_east: tuple[float, float] = (-pi / 2, pi / 2),
) -> FloatArray:
    """Return the angles of a good set of poses, shape (count, 2) [rad].

    `count`: number of poses, six at least [1]; `starts`: random sets to start from [1]; `seed`:
    seed [1]; `about_z` (2,): range of the angle a about the z axis of the case [rad];
    `about_east` (2,): range of the angle b about East [rad]. Raises ``poses.singular``: no six
    coefficients from so few poses, or within such limits.
    """
    from scipy.optimize import minimize

    rng = np.random.default_rng(seed)
    low, high = np.array([about_z, about_east]).T
    bounds = [about_z, about_east] * count
    best, least = np.zeros((count, 2)), np.inf
    for _ in range(starts):
        begun = rng.uniform(low, high, (count, 2))
        found = minimize(_spread, begun.ravel(), jac=True, method="L-BFGS-B", bounds=bounds)
        if found.fun < least and quality(found.x.reshape(-1, 2)).rank == 6:
            best, least = found.x.reshape(-1, 2), float(found.fun)
    if not np.isfinite(least):
        ends = [f"{np.degrees(a):g}" for a in (*about_z, *about_east)]
        raise error(
            "poses.singular", count=count, z=" to ".join(ends[:2]), east=" to ".join(ends[2:])
        )
    return best


def _spread(flat: FloatArray) -> tuple[float, FloatArray]:
    """Return the log of the mean variance and its slope; finite where it is singular."""
    angles = flat.reshape(-1, 2)
    u = spin_axis(angles)
    A = design(u)
    # A faint prior, so that a start from which something is unseen has a slope too.
    C = np.linalg.inv(A.T @ A + 1e-12 * np.eye(6))
    trace = float(np.trace(C))
    by_row = -2.0 * A @ C @ C / trace
    a, b = angles.T
    by_a = np.stack([np.cos(a) * np.cos(b), -np.sin(a) * np.cos(b), 0.0 * a], axis=1)
    by_b = np.stack([-np.sin(a) * np.sin(b), -np.cos(a) * np.sin(b), -np.cos(b)], axis=1)
    slope = np.stack([np.sum(by_row * _along(u, by), axis=1) for by in (by_a, by_b)], axis=1)
    return float(np.log(trace)), slope.ravel()


def _along(u: FloatArray, change: FloatArray) -> FloatArray:
    """Return how the rows change when u does: they are quadratic forms."""
    return np.asarray(0.5 * (design(u + change) - design(u - change)))


STARTS = 10
"""Random sets from which a set that is asked for by name is found; half of them get there [1]."""


_COUNT = re.compile(r"[0-9]{1,3}")
"""A number of poses that somebody can mean."""


def poses_named(name: str) -> tuple[str, FloatArray]:
    """Return name and angles, shape (n, 2) [rad], of a set: one of `NAMES`, or "optimised N"."""
    words = name.lower().split()
    if len(words) == 2 and words[0] in ("optimised", "optimized") and _COUNT.fullmatch(words[1]):
        return f"optimised {words[1]}", best_poses(int(words[1]), starts=STARTS)
    return name, poses(name)
