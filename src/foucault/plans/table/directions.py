"""Sets of positions on a table: which way is up in the instrument, and the angles that do it.

On a perfect table up points along ``u = (-cos m sin i, sin m, cos m cos i)`` in case axes, with m
the middle and i the inner angle (see `models.turntable`). The outer angle does not change it, so
the positions of a plan are spread over the outer circle: what is wrong with one sector of the
outer axis then does not meet the same positions every time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error, suggestion
from foucault.models.turntable import up_k
from foucault.plans.hand_rotated import spread_directions
from foucault.units import parse

Positions = str | FloatArray | Sequence[Sequence[str]]

GOLDEN = (1 + 5**0.5) / 2


def _cube(*ones: int) -> FloatArray:
    """Return the directions with so many entries that are not 0, in the order of `ones`."""
    grid = [np.array(p, float) for p in product((1, 0, -1), repeat=3)]
    return np.array([p / np.linalg.norm(p) for k in ones for p in grid if np.abs(p).sum() == k])


def _dodecahedron() -> FloatArray:
    golden = [(0.0, s / GOLDEN, t * GOLDEN) for s, t in product((1, -1), repeat=2)]
    turned = [np.roll(p, k) for k in range(3) for p in golden]
    return np.asarray(np.concatenate([_cube(3), np.array(turned) / np.sqrt(3)]))


def _great_circles() -> FloatArray:
    at = np.arange(8) * np.pi / 4
    out = np.zeros((3, 8, 3))
    for i in range(3):
        out[i, :, i], out[i, :, (i + 1) % 3] = np.cos(at), np.sin(at)
    return out.reshape(-1, 3)


def _icosahedron() -> FloatArray:
    """Return the published angles (Dong et al. 2018, table 1), exact instead of rounded."""
    a, quarter, half = np.arctan(1 / GOLDEN), np.pi / 2, np.pi
    inner = [(0.0, b) for b in (-a, half + a, half - a, a)]
    middle = [(b, 0.0) for b in (quarter - a, quarter + a, a - quarter, 3 * quarter - a)]
    across = [(b, quarter) for b in (half - a, half + a, a, -a)]
    pairs = np.array([*inner, *middle, *across])
    return np.column_stack([spread_outer(len(pairs)), pairs])


def spread_outer(n: int) -> FloatArray:
    """Return outer angles 1/n, 2/n, ... of a turn, the last 0, shape (n,) [rad].

    `n`: number of positions [1].
    """
    return np.asarray(np.arange(1, n + 1) % n * (2 * np.pi / n))


def angles_of(directions: FloatArray) -> FloatArray:
    """Return table angles that realise directions of up, shape (n, 3) [rad].

    ``middle = asin(u_y)``, ``inner = atan2(-u_x, u_z)``, outer angles spread over the circle.

    `directions` (n, 3): directions of up in case axes, of any length but zero [1].
    """
    u = np.asarray(directions, float)
    norm = np.linalg.norm(u, axis=-1)
    if u.ndim != 2 or u.shape[1] != 3 or not np.isfinite(u).all() or (norm < 1e-9).any():
        raise error("plan.positions", what="a direction that is not three numbers, or is zero")
    u = u / norm[:, None]
    middle = np.arcsin(np.clip(u[:, 1], -1.0, 1.0))
    flat = np.hypot(u[:, 0], u[:, 2]) < 1e-9  # up along y: the inner angle does not matter
    inner = np.where(flat, 0.0, np.arctan2(-u[:, 0], u[:, 2]))
    return np.column_stack([spread_outer(len(u)), middle, inner + 0.0])


# Name -> number of positions, words that say it, and what makes its angles.
_SETS: dict[str, tuple[int, frozenset[str], Callable[[], FloatArray]]] = {
    "6 faces": (6, frozenset({"faces"}), lambda: angles_of(_cube(1))),
    "8 corners": (8, frozenset({"corners"}), lambda: angles_of(_cube(3))),
    "12 edges": (12, frozenset({"edges"}), lambda: angles_of(_cube(2))),
    "icosahedron 12": (12, frozenset({"icosahedron"}), _icosahedron),
    "14 faces and corners": (14, frozenset({"faces", "corners"}), lambda: angles_of(_cube(1, 3))),
    "18 faces and edges": (18, frozenset({"faces", "edges"}), lambda: angles_of(_cube(1, 2))),
    "dodecahedron 20": (20, frozenset({"dodecahedron"}), lambda: angles_of(_dodecahedron())),
    "24 on great circles": (24, frozenset({"circles"}), lambda: angles_of(_great_circles())),
    "26 faces, edges and corners": (
        26, frozenset({"faces", "edges", "corners"}), lambda: angles_of(_cube(1, 2, 3)),
    ),
}  # fmt: skip

DIRECTIONS = tuple(_SETS)
"""Names of the sets of positions; beside them there is "fibonacci N" for any N."""

_WORDS = ("faces", "corners", "edges", "icosahedron", "dodecahedron", "circles", "fibonacci")
_FILLERS = frozenset({"and", "on", "of", "the", "great", "three", "cube", "positions", "position"})


def canonical(name: str) -> str:
    """Return the name in `DIRECTIONS`, or "fibonacci N", that a word such as "ico12" means."""
    words, number = _read(name)
    if words is not None and words == {"fibonacci"} and number:
        return f"fibonacci {number}"
    if words is not None:
        exact = [k for k, (n, w, _) in _SETS.items() if words == w and number in (None, n)]
        if exact:
            return exact[0]
        counted = [k for k, (n, _, _) in _SETS.items() if number == n]
        if not words and len(counted) == 1:
            return counted[0]
    raise _unknown(name, words, number)


def _read(name: str) -> tuple[set[str] | None, int | None]:
    """Return the known words and the number in a name; None if there is a word unknown."""
    numbers = [int(n) for n in re.findall(r"\d+", name)]
    words: set[str] = set()
    for word in re.findall(r"[a-z]+", name.lower()):
        if word in _FILLERS:
            continue
        # "ico", "edge" and "vertices" are all said
        known = [w for w in _WORDS if len(word) > 2 and w.startswith(word)]
        known = {"vertices": ["corners"], "sides": ["faces"]}.get(word, known)
        if len(known) != 1:
            return None, None
        words.add(known[0])
    return words, sum(numbers) if numbers else None  # "6+8" is said of 14


def _unknown(name: str, words: set[str] | None, number: int | None) -> FoucaultError:
    hint = suggestion(name, [*DIRECTIONS, "fibonacci 24"])
    if words == {"fibonacci"}:
        hint = " Say how many, for example 'fibonacci 24'."
    elif not words and number is not None:
        same = [k for k, (n, _, _) in _SETS.items() if n == number] or [f"fibonacci {number}"]
        hint = f" Did you mean {' or '.join(repr(k) for k in same)}?"
    return error("plan.unknown", name=name, hint=hint, allowed=", ".join(DIRECTIONS))


def named_angles(name: str) -> FloatArray:
    """Return the table angles of a named set of positions, shape (n, 3) [rad]."""
    known = canonical(name)
    if known in _SETS:
        return _SETS[known][2]()
    return angles_of(spread_directions(int(known.split()[1])))


def directions(name: str) -> FloatArray:
    """Return the directions of up of a named set of positions, case axes, shape (n, 3) [1]."""
    return up_k(named_angles(name))


def positions(given: Positions) -> tuple[str, FloatArray]:
    """Return the name and the table angles of positions, shape (n, 3) [rad].

    `given` (n, 3): a name, or outer, middle and inner angles as numbers [rad] or as texts with
    units, such as ``["30 deg", "0 deg", "-31.7 deg"]``. Raises ``plan.unknown`` and
    ``plan.positions``.
    """
    if isinstance(given, str):
        return canonical(given), named_angles(given)
    if len(given) == 0:
        raise error("plan.positions", what="no position at all")
    if not isinstance(given, np.ndarray):
        return "own positions", _parsed(given)
    if given.ndim != 2 or given.shape[1] != 3 or not np.isfinite(given).all():
        raise error("plan.positions", what="a position that is not three finite angles")
    return "own positions", np.asarray(given, float)


def _parsed(rows: Sequence[Sequence[str]]) -> FloatArray:
    out = np.empty((len(rows), 3))
    for k, row in enumerate(rows):
        if len(row) != 3:
            what = f"position {k + 1} with {len(row)} angles"
            raise error("plan.positions", what=what)
        for i, text in enumerate(row):
            out[k, i] = parse(text, "angle", f"positions[{k + 1}]")
    return out
