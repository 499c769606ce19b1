"""How well the directions in which an instrument was held cover the sphere, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from foucault.arrays import FloatArray


@dataclass(frozen=True)
class Coverage:
    """How well directions cover the sphere."""

    # angle from the loneliest point of the sphere to the nearest direction [rad]
    largest_gap: float
    # largest, over all axes, of the smallest cosine between the axis and the directions: not
    # negative where all directions lie in one half-space [1]
    half_space: float
    # smallest singular value of the directions relative to an even spread: zero where all lie in a
    # plane through the origin [1]
    flatness: float
    # (3,) directions that would fill the largest gaps, in body axes and in words [1]
    missing: tuple[tuple[FloatArray, str], ...]


def coverage(up_b: FloatArray) -> Coverage:
    """Judge unit vectors `up_b` (n, 3) [1]; six gaps beyond 50 deg are named."""
    grid = _grid()
    cosine = grid @ up_b.T
    gap = np.arccos(np.clip(cosine.max(axis=1), -1, 1))
    missing: list[tuple[FloatArray, str]] = []
    left = gap.copy()
    while len(missing) < 6 and left.max() > np.radians(50.0):
        best = grid[int(np.argmax(left))]
        missing.append((best, direction_words(best)))
        left = np.minimum(left, np.arccos(np.clip(grid @ best, -1, 1)))
    singular = np.linalg.svd(up_b, compute_uv=False)
    return Coverage(
        largest_gap=float(gap.max()),
        half_space=float(cosine.min(axis=1).max()),
        flatness=float(singular[-1] / np.sqrt(len(up_b) / 3)) if len(up_b) >= 3 else 0.0,
        missing=tuple(missing),
    )


@cache
def named_directions() -> FloatArray:
    """Return the 6 faces, 12 edges and 8 corners of a cube, shape (26, 3) [1]."""
    corners = np.array([c for c in np.ndindex(3, 3, 3) if c != (1, 1, 1)], float) - 1
    named = corners[np.argsort(np.abs(corners).sum(axis=1), kind="stable")]
    return np.asarray(named / np.linalg.norm(named, axis=1)[:, None])


@cache
def _grid() -> FloatArray:
    """The 26 named directions first (they are easy to say), then an even spread."""
    k = np.arange(600) + 0.5
    z = 1 - k / 300
    azimuth = np.pi * (1 + np.sqrt(5)) * k
    r = np.sqrt(1 - z * z)
    return np.concatenate(
        [named_directions(), np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], 1)]
    )


def direction_words(up_b: FloatArray) -> str:
    """Say `up_b` (3,) [1] in words: "+z up", "between +x and -y up"."""
    order = np.argsort(-np.abs(up_b))
    strong = [i for i in order if abs(up_b[i]) > 0.38 * abs(up_b[order[0]])]
    names = [("+" if up_b[i] > 0 else "-") + "xyz"[i] for i in strong]
    if len(names) == 1:
        return f"{names[0]} up"
    return f"between {', '.join(names[:-1])} and {names[-1]} up"


def coverage_json(c: Coverage, directions: int) -> dict[str, Any]:
    """Return coverage by so many rests, `directions` [1], as plain values for result.json."""
    missing = [{"direction": d.tolist(), "words": words} for d, words in c.missing]
    return {
        "missing": missing,
        "largest_gap": c.largest_gap,
        "half_space": c.half_space,
        "flatness": c.flatness,
        "directions": directions,
    }
