"""The checklist of a session while it is captured: what there is, and what is still to visit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.coverage import coverage, direction_words, named_directions
from foucault.diagnose.hand_rotated.checks import ENOUGH_RESTS
from foucault.diagnose.live.rests import LiveRests
from foucault.errors import Finding

VISITED = np.radians(30.0)
"""A named direction is visited by a rest within this angle [rad]."""

ALIKE = np.radians(15.0)
"""Rests closer than this are one orientation [rad]."""


@dataclass(frozen=True)
class LiveRest:
    """One rest as the list shows it."""

    # start, end: times of its first and last sample, from the first of the log [s]
    start: float
    end: float
    up: str  # direction of up in words


@dataclass(frozen=True)
class Checklist:
    """What was captured so far, and what is missing."""

    samples: int  # samples so far [1]
    duration: float  # time recorded [s]
    rate: float  # sample rate [Hz]
    still: bool | None  # whether the instrument rests now; None before that can be told
    still_for: float  # for how long it has not moved [s]
    hold: float  # how much longer to hold it still; 0 when it may be turned [s]
    # the rests so far; one that still lasts counts when it is long enough
    rests: tuple[LiveRest, ...]
    orientations: int  # how many of them differ [1]
    needed: int  # rests that are enough [1]
    # the 26 faces, edges and corners, and whether a rest was near
    visited: tuple[tuple[str, bool], ...]
    missing: tuple[str, ...]  # orientations still to visit, the most useful first
    findings: tuple[Finding, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether there are enough rests, on all sides."""
        return self.orientations >= self.needed and not self.missing


def up_of(found: LiveRests, first: IntArray, last: IntArray) -> FloatArray:
    """Return the direction of up at each rest, frame b, shape (n, 3) [1].

    `first`, `last` (n,): first sample of each rest and the sample after its last.
    """
    f_b = found.means("accel", first, last)
    return np.asarray(f_b / np.maximum(np.linalg.norm(f_b, axis=1), 1e-300)[:, None])


def checklist(
    found: LiveRests,
    findings: tuple[Finding, ...] = (),
    *,
    hold: float = 0.0,
    needed: int = ENOUGH_RESTS,
) -> Checklist:
    """Say what a growing log holds and what it still needs.

    `hold`: length that is asked of a rest, if longer than the shortest that counts [s]; `needed`:
    orientations that are enough [1].
    """
    time = found.log.time
    first, last, turns = found.rests()
    first, last = first[~turns], last[~turns]
    sphere = _sphere(up_of(found, first, last))
    since = found.still_since
    still = None if not found.samples or len(found) < found.samples else since is not None
    asked = max(hold, found.shortest)
    return Checklist(
        samples=len(time),
        duration=float(time[-1] - time[0]),
        rate=1.0 / found.interval,
        still=still,
        still_for=found.run + found.samples * found.interval if still else 0.0,
        hold=max(0.0, asked - found.run) if still else asked,
        rests=tuple(
            LiveRest(float(time[a] - time[0]), float(time[b - 1] - time[0]), words)
            for a, b, words in zip(first, last, sphere.words, strict=True)
        ),
        orientations=sphere.orientations,
        needed=needed,
        visited=sphere.visited,
        missing=sphere.missing,
        findings=findings,
    )


@dataclass(frozen=True)
class _Sphere:
    """What the directions of up of some rests say; `words` of each rest."""

    words: tuple[str, ...]
    orientations: int
    visited: tuple[tuple[str, bool], ...]
    missing: tuple[str, ...]


def _sphere(up_b: FloatArray) -> _Sphere:
    # Rounded, because the mean of a rest that lasts moves a little with every sample.
    return _sphere_of(np.round(up_b, 2).tobytes())


@lru_cache(maxsize=4)
def _sphere_of(packed: bytes) -> _Sphere:
    up_b = np.frombuffer(packed).reshape(-1, 3)
    up_b = up_b / np.maximum(np.linalg.norm(up_b, axis=1), 1e-300)[:, None]
    alike = up_b @ up_b.T > np.cos(ALIKE)
    kept: list[int] = []
    for i in range(len(up_b)):
        if not alike[i, kept].any():
            kept.append(i)
    named = named_directions()
    words = [direction_words(u) for u in named]
    near = (named @ up_b.T).max(axis=1, initial=-1.0) > np.cos(VISITED)
    missing = words[:6]
    if len(up_b):
        missing = [there for _, there in coverage(up_b).missing]
    return _Sphere(
        tuple(direction_words(u) for u in up_b),
        len(kept),
        tuple(zip(words, near.tolist(), strict=True)),
        tuple(missing),
    )
