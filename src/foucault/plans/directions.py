"""Rests and the moves between them, by hand or on a support that turns: as data.

A plan is a list of attitudes with the time spent in each, and the rotation that leads to the next:
of the shortest way, or about an axis of its own by whole turns. A hand never turns about one fixed
axis, nor stays in one place, so that it wobbles and sways in mid-turn.

Sets of positions on a table: which way is up in the instrument, and the angles that do it.

On a perfect table up points along ``u = (-cos m sin i, sin m, cos m cos i)`` in case axes, with m
the middle and i the inner angle (see `models.turntable`). The outer angle does not change it, so
the positions of a plan are spread over the outer circle: what is wrong with one sector of the
outer axis then does not meet the same positions every time.

`table_plan` adds the spins of the outer axis in each; as a file positions are one line each, with
three angles in degrees.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error, suggestion
from foucault.files import atomic, keep_others, read_text
from foucault.models.rests_and_turns import SIX
from foucault.models.rotation import aligning, exp, log
from foucault.models.turntable import TablePlan, up_k
from foucault.units import parse

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class RestPlan:
    """Attitudes to rest in, the rotations between them, and how long everything takes."""

    C_nb: FloatArray  # (n, 3, 3) attitude of each rest, body to East-North-Up [1]
    rest_time: FloatArray  # (n,) length of each rest [s]
    turn_time: FloatArray  # (n - 1,) length of each rotation [s]
    # (n - 1, 3) rotation vector from each rest to the next, of any size, body axes; None for the
    # shortest way [rad]
    rotation: FloatArray | None = None
    # wobble, sway: (n - 1, 3) rotation vector [rad] and displacement, frame n [m], added in
    # mid-turn and taken back; None for none
    wobble: FloatArray | None = None
    sway: FloatArray | None = None

    @property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Beginning and end of each rest, shape (n,) each [s]."""
        turns = np.concatenate([[0.0], self.turn_time])
        starts = np.cumsum(turns) + np.concatenate([[0.0], np.cumsum(self.rest_time)[:-1]])
        return starts, starts + self.rest_time

    @property
    def duration(self) -> float:
        """Length of the whole plan [s]."""
        return float(self.edges[1][-1])


@dataclass(frozen=True)
class Free:
    """A motion by hand that has no positions."""

    words: str
    time: float  # [s]


def spread_directions(n: int) -> FloatArray:
    """Return n directions spread evenly over the sphere (Fibonacci spiral), shape (n, 3) [1].

    `n`: number of directions [1].
    """
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    azimuth = np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def hand_plan(
    rests: int = 24,
    rest_time: float = 4.0,
    turn_time: float = 2.0,
    first_rest_time: float = 10.0,
    seed: int = 0,
) -> RestPlan:
    """Plan a session by hand: z up first, then rests spread over the sphere, in a random order.

    `rests`: number of rests, the first included [1]; `rest_time`, `turn_time`: typical lengths,
    each varies by a fifth from one to the next [s]; `first_rest_time`: length of the first rest,
    from which gyro bias and noise are seen best [s]; `seed`: seed of the order, headings and
    wobbles [1].
    """
    rng = np.random.default_rng(seed)
    up_b = spread_directions(rests)
    first = int(np.argmax(up_b[:, 2]))
    others = rng.permutation(np.delete(np.arange(rests), first))
    up_b = up_b[np.concatenate([[first], others])]
    up_b[0] = _UP
    heading = np.concatenate([[0.3], rng.uniform(-np.pi, np.pi, rests - 1)])
    C_nb = np.stack([exp(h * _UP) @ aligning(u, _UP) for h, u in zip(heading, up_b, strict=True)])
    vary = rng.uniform(0.8, 1.2, (2, rests))
    times = rest_time * vary[0]
    times[0] = first_rest_time
    wobble, sway = rng.normal(0, 0.25, (rests - 1, 3)), rng.normal(0, 0.05, (rests - 1, 3))
    return RestPlan(C_nb, times, turn_time * vary[1, 1:], wobble=wobble, sway=sway)


def face_plan(
    *,
    rest_time: float = 10.0,
    move_time: float = 2.0,
    turn_time: float = 5.0,
    back_time: float | None = None,
    angle: float | tuple[float, float, float] | None = None,
    placement_sd: float = 0.0,
    level_sd: float = 0.0,
    angle_sd: float = 0.0,
    faces: Sequence[tuple[int, int]] = (*SIX[4:], *SIX[:4]),
    seed: int = 0,
) -> RestPlan:
    """Plan the six faces, and a turn and another rest where an axis is up for the first time.

    A rest on a face is off by a random angle about each of two level axes, the placement. A turn
    is about an axis that is off the vertical by another one, for the support is not level, and its
    angle is not quite what it should be.

    `rest_time`, `move_time`, `turn_time`: length of each rest, of a move to another face and of a
    turn [s]; `back_time`: length of the turn back, after a rest, that follows each, None plans
    none [s]; `angle`: angle of the turns about the axis that is up, of all or of x, y and z, None
    plans no turns [rad]; `placement_sd`, `level_sd`, `angle_sd`: standard deviation of the tilt
    of each placement about each axis, of the axis of a turn against the vertical, and of its
    angle [rad]; `faces`: in their order, each by its axis and +1 where that points up, z up first,
    as logs are described by default [1]; `seed`: seed of headings and errors [1].
    """
    rng = np.random.default_rng(seed)
    attitudes: list[FloatArray] = []
    rotations: list[FloatArray] = []
    times: list[float] = []
    for k, (axis, sign) in enumerate(faces):
        up_b = _tilted(sign * np.eye(3)[axis], placement_sd, rng)
        C = exp(rng.uniform(-np.pi, np.pi) * _UP) @ aligning(up_b, _UP)
        if attitudes:
            rotations.append(log(attitudes[-1].T @ C))
            times.append(move_time)
        attitudes.append(C)
        if angle is not None and sign > 0 and (axis, sign) not in faces[:k]:
            nominal = float(np.broadcast_to(angle, 3)[axis])
            off, about = angle_sd * rng.standard_normal(), _tilted(up_b, level_sd, rng)
            rotations.append((nominal + off) * about)
            times.append(turn_time)
            attitudes.append(C @ exp(rotations[-1]))
            if back_time is not None:  # about the same axis: the support stays as level as it is
                rotations.append((angle_sd * rng.standard_normal() - nominal) * about)
                times.append(back_time)
                attitudes.append(attitudes[-1] @ exp(rotations[-1]))
    rests = np.full(len(attitudes), rest_time)
    return RestPlan(np.array(attitudes), rests, np.array(times), np.array(rotations))


def _tilted(u: FloatArray, sd: float, rng: np.random.Generator) -> FloatArray:
    """Turn a unit vector by random angles about two axes across it."""
    draw = sd * rng.standard_normal(3)
    return np.asarray(exp(draw - (draw @ u) * u) @ u)


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


FOUR_POSITIONS = np.radians(
    [[0.0, 0.0, 0.0], [0.0, 90.0, 0.0], [180.0, 0.0, 0.0], [180.0, 90.0, 0.0]]
)
"""Outer, middle and inner angle of the published frame unification (Dong et al. 2018, table 2)."""


def table_plan(
    name_or_positions: Positions,
    *,
    spin_rate: float,
    rest_time: float,
    turns: int,
    spins: bool = True,
    both_senses: bool = False,
    four_positions: bool = False,
) -> TablePlan:
    """Plan rests in all positions, then spins of the outer axis in all of them.

    `name_or_positions` (n, 3): name of a set of positions, or outer, middle and inner angles
    [rad]; `spin_rate`: rate of the outer axis, counter-clockwise seen from above [rad/s];
    `rest_time`: length of each rest [s]; `turns`: whole turns of each spin [1]; `both_senses`:
    whether each spin is followed by one the other way; `four_positions`: whether the rests and
    spins that the published frame unification needs are added where they are missing.
    """
    name, angles = positions(name_or_positions)
    if spins and not (spin_rate and turns >= 1):
        raise error("plan.spin", rate=f"{np.degrees(spin_rate):g}", turns=turns)
    if not rest_time > 0:
        raise error("plan.rest_time", given=f"{rest_time:g}")
    spun = angles
    if four_positions:
        spun = _with_missing(angles, FOUR_POSITIONS[:2], outer=False)
        angles = _with_missing(angles, FOUR_POSITIONS, outer=True)
    if not spins:
        spun = angles[:0]
    senses = (1.0, -1.0) if both_senses else (1.0,)
    rate = np.tile([spin_rate * s for s in senses], len(spun))
    one_spin = turns * 2 * np.pi / abs(spin_rate) if spins else 0.0
    return TablePlan(
        name,
        np.concatenate([angles, np.repeat(spun, len(senses), axis=0)]),
        np.concatenate([np.zeros(len(angles)), rate]),
        np.concatenate([np.full(len(angles), rest_time), np.full(len(rate), one_spin)]),
    )


def _with_missing(angles: FloatArray, needed: FloatArray, outer: bool) -> FloatArray:
    """Add those of the needed positions that are missing; in spins the outer angle is free."""
    first = 0 if outer else 1
    apart = np.abs(np.sin((angles[:, None, first:] - needed[:, first:]) / 2)).max(axis=2)
    return np.concatenate([angles, needed[(apart > 1e-9).all(axis=0)]])


HEADINGS = ("outer", "middle", "inner")  # The first line of a file.


def write_positions(
    angles: FloatArray, path: str | Path, headings: tuple[str, ...] = HEADINGS
) -> None:
    """Write positions as CSV in degrees, whole or not at all.

    `angles` (n, k): outer, middle and inner angle of each position, or what `headings` name
    [rad].
    """
    keep_others(path, [",".join(headings).encode() + b"\n"])
    lines = [",".join(headings), *(",".join(f"{a:.9f}" for a in row) for row in np.degrees(angles))]
    with atomic(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")


def read_positions(path: str | Path) -> FloatArray:
    """Read positions from CSV in degrees, shape (n, 3) [rad].

    Raises ``plan.file``.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as problem:
        raise error("plan.file", path=path, why=problem.strerror) from None
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines) if row]
    if not rows or tuple(cell.lower() for cell in rows[0]) != HEADINGS:
        raise error("plan.file", path=path, why="its first line is not `outer,middle,inner`")
    if len(rows) == 1:
        raise error("plan.file", path=path, why="it holds no position")
    return np.radians([_angles(row, path, k) for k, row in enumerate(rows[1:], 2)])


def _angles(row: list[str], path: str | Path, line: int) -> list[float]:
    try:
        angles = [float(cell) for cell in row]
    except ValueError:
        angles = []
    if len(angles) != 3 or not np.isfinite(angles).all():
        raise error("plan.file", path=path, why=f"line {line} is not three angles")
    return angles
