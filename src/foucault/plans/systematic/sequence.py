"""What a table does in a systematic calibration: rests and turns, as data.

A sequence is a start orientation and a list of `Rest` and `Rotate` actions: rests, turns about a
body or a level axis, and spins, which are turns by whole turns about a level axis. While an action
lasts the body turns about one axis fixed in it, so that attitude and rate are closed forms::

    C_nb(t) = C_nb(t_k) Exp(a_k s_k(t))      w_nb_b(t) = a_k s_k'(t)

with t_k the beginning of action k, a_k its axis in body axes and s_k the profile of its angle
(`plans.profiles`). A level axis stays level and so, seen from the turning body, stays put too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from math import ceil, inf, pi

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import TABLE_AXES, Rest, Rotate
from foucault.plans.profiles import Profile

Action = Rest | Rotate

RATE = 10.0 * pi / 180.0
"""Rate of a turn unless said otherwise [rad/s]."""

RAMP = 0.5
"""Growth of a rate, and its fading, unless said otherwise: 90 deg then take 9.5 s [s]."""

REST = 150.0
"""Length of a rest unless said otherwise [s]."""

DIRECTIONS = ("east", "north", "up", "west", "south", "down")
"""Where an axis of the body may point at the start."""

_SAME = 1e-9  # angles nearer than this are one [rad]


@dataclass(frozen=True)
class Position:
    """A rest of a sequence."""

    # start, end: when it begins and ends [s]
    start: float
    end: float
    label: str  # as the sequence calls it
    C_nb: FloatArray  # (3, 3) attitude, body to East-North-Up [1]
    moves: int  # how many turns and spins come before it [1]


@dataclass(frozen=True)
class CalibrationSequence:
    """Rests, turns and spins in order, from a start orientation."""

    name: str  # as people call it
    # (3, 3) C_nb at the beginning: its columns are where x, y and z of the body point [1]
    start: FloatArray
    actions: tuple[Action, ...]

    def __post_init__(self) -> None:
        if not any(isinstance(action, Rest) for action in self.actions):
            raise error("sequence.empty", name=self.name)
        C = np.asarray(self.start, float)
        if (
            C.shape != (3, 3)
            or not np.allclose(C.T @ C, np.eye(3), atol=_SAME)
            or np.linalg.det(C) < 0
        ):
            raise error("sequence.start", name=self.name, given=np.asarray(self.start).tolist())

    @cached_property
    def times(self) -> FloatArray:
        """When each action begins, and the last one ends, shape (k + 1,) [s]."""
        return np.concatenate([[0.0], np.cumsum([action.time for action in self.actions])])

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return float(self.times[-1])

    @cached_property
    def profiles(self) -> tuple[Profile | None, ...]:
        """Profile of the angle of each action, None for a rest."""
        return tuple(
            Profile(action.angle, action.time, action.ramp) if isinstance(action, Rotate) else None
            for action in self.actions
        )

    @cached_property
    def _course(self) -> tuple[FloatArray, FloatArray]:
        C_nb, axis_b = np.empty((len(self.actions) + 1, 3, 3)), np.zeros((len(self.actions), 3))
        C_nb[0] = self.start
        for k, action in enumerate(self.actions):
            C_nb[k + 1] = C_nb[k]
            if isinstance(action, Rotate):
                number = TABLE_AXES.index(action.axis)
                axis_b[k] = np.eye(3)[number] if number < 3 else C_nb[k][number - 3]
                C_nb[k + 1] = C_nb[k] @ exp(axis_b[k] * action.angle)
        return C_nb, axis_b

    @property
    def attitudes(self) -> FloatArray:
        """C_nb when each action begins, and at the end, shape (k + 1, 3, 3) [1]."""
        return self._course[0]

    @property
    def axis_b(self) -> FloatArray:
        """Axis of each action in body axes, zero for a rest, shape (k, 3) [1]."""
        return self._course[1]

    @cached_property
    def positions(self) -> tuple[Position, ...]:
        """The rests."""
        out, moves = [], 0
        for k, action in enumerate(self.actions):
            if isinstance(action, Rest):
                start, end = self.times[k : k + 2].tolist()
                out.append(Position(start, end, action.label, self.attitudes[k], moves))
            elif abs(action.angle) > _SAME:
                moves += 1
        return tuple(out)

    @property
    def moves(self) -> tuple[int, ...]:
        """Numbers of the actions that turn the body."""
        some = enumerate(self.actions)
        return tuple(k for k, a in some if isinstance(a, Rotate) and abs(a.angle) > _SAME)

    @property
    def turned(self) -> dict[str, float]:
        """Total angle turned about each axis that is used, whichever way [rad]."""
        out: dict[str, float] = {}
        for action in self.actions:
            if isinstance(action, Rotate):
                out[action.axis] = out.get(action.axis, 0.0) + abs(action.angle)
        return out

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return C_nb, shape (n, 3, 3) [1], and w_nb_b, shape (n, 3) [rad/s].

        `time` (n,): when, in any order, at rest before the beginning and after the end [s].
        """
        C_nb, w_nb_b = np.empty((len(time), 3, 3)), np.zeros((len(time), 3))
        number = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self) - 1)
        for k in np.unique(number).tolist():
            rows, profile = number == k, self.profiles[k]
            if profile is None:
                C_nb[rows] = self.attitudes[k]
                continue
            t = np.clip(time[rows] - self.times[k], 0.0, profile.time)
            angle, rate, _ = profile.at(t)
            C_nb[rows] = self.attitudes[k] @ exp(self.axis_b[k] * angle[:, None])
            w_nb_b[rows] = self.axis_b[k] * rate[:, None]
        return C_nb, w_nb_b

    def __len__(self) -> int:
        return len(self.actions)

    def then(
        self, other: CalibrationSequence, *, rate: float = RATE, ramp: float = RAMP
    ) -> CalibrationSequence:
        """Return this sequence followed by another, with the turns that lead to its start.

        `rate`: rate of the turns in between [rad/s]; `ramp`: growth of the rate, and its fading
        [s].
        """
        between = turns_to(self.attitudes[-1], other.start, rate=rate, ramp=ramp)
        name = f"{self.name}, then {other.name}"
        return CalibrationSequence(name, self.start, (*self.actions, *between, *other.actions))

    def on_samples(self, rate: float) -> CalibrationSequence:
        """Return the sequence with every action beginning and ending on a sample.

        Rests become longer by less than an interval; turns keep angle and rate and get a longer
        ramp. An attitude in the middle of an interval then belongs to one action.

        `rate`: sample rate [Hz].
        """
        return replace(self, actions=tuple(_on_samples(action, rate) for action in self.actions))


def _on_samples(action: Action, rate: float) -> Action:
    time = ceil(action.time * rate - 1e-6) / rate
    if isinstance(action, Rest):
        return replace(action, time=time)
    steady = abs(action.angle) / action.rate
    return replace(action, ramp=time - steady if steady >= time / 2 else time / 2)


def spin(axis: str, turns: float, rate: float, *, ramp: float = RAMP, label: str = "") -> Rotate:
    """Return a spin: turns about a level axis, counter-clockwise if positive.

    `turns`: how many turns, whole ones bring the attitude back [1]; `rate`: largest rate [rad/s];
    `ramp`: growth of the rate, and its fading [s].
    """
    return Rotate(axis, 2 * pi * turns, rate, ramp, label)


def orientation(directions: Iterable[str]) -> FloatArray:
    """Return C_nb, shape (3, 3) [1], of a body whose x, y and z point along named directions.

    `directions`: three of `DIRECTIONS`, or their first letters, with a leading "-" for the
    opposite.
    """
    words = [str(word) for word in directions]
    columns = [unit for unit in map(_direction, words) if unit is not None]
    C = np.array(columns).T if len(columns) == len(words) == 3 else np.zeros((3, 3))
    if abs(float(np.linalg.det(C)) - 1.0) > _SAME:
        raise error("sequence.directions", given=", ".join(words), allowed=", ".join(DIRECTIONS))
    return C


def _direction(word: str) -> FloatArray | None:
    sign, word = (-1.0, word[1:]) if word.startswith("-") else (1.0, word)
    for number, name in enumerate(DIRECTIONS):
        if word.lower() in (name, name[0]):
            return np.asarray(np.eye(3)[number % 3] * (sign if number < 3 else -sign))
    return None


def pointing(C_nb: FloatArray) -> tuple[str, str, str]:
    """Return where x, y and z point, such as ("U", "E", "-N"); degrees are given where between.

    `C_nb` (3, 3): attitude, body to East-North-Up [1].
    """
    x, y, z = (_named(column) for column in np.asarray(C_nb).T)
    return x, y, z


def _named(direction: FloatArray) -> str:
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) > np.cos(np.radians(3.0)):
        return ("-" if direction[k] < 0 else "") + "ENU"[k]
    heading = round(float(np.degrees(np.arctan2(direction[0], direction[1]))), 1) % 360.0
    return f"{heading:.1f}/{np.degrees(np.arcsin(np.clip(direction[2], -1, 1))):+.1f} deg"


def turns_to(
    before: FloatArray, after: FloatArray, *, rate: float = RATE, ramp: float = RAMP
) -> tuple[Rotate, ...]:
    """Return the turns about body axes that lead from one attitude to another, least angle first.

    Of the twelve orders of Euler angles the one that turns least is taken.

    `before`, `after` (3, 3): C_nb before and after [1]; `rate`: rate of the turns [rad/s];
    `ramp`: growth of the rate, and its fading [s].
    """
    turn = np.asarray(before).T @ np.asarray(after)
    best: tuple[float, list[tuple[str, float]]] = (inf, [])
    for i, j, k in permutations("XYZ"):
        for order in (i + j + k, i + j + i):
            pairs = zip(order.lower(), _euler(turn, order), strict=True)
            moves = [(axis, angle) for axis, angle in pairs if abs(angle) > _SAME]
            path = sum(abs(angle) for _, angle in moves) + 1e-6 * len(moves)
            if path < best[0] - _SAME:
                best = (path, moves)
    return tuple(Rotate(axis, angle, rate, ramp, "to the start") for axis, angle in best[1])


def _euler(C: FloatArray, order: str) -> list[float]:
    import warnings

    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():  # in gimbal lock the third angle is zero, as it should be
        warnings.simplefilter("ignore")
        return [float(angle) for angle in Rotation.from_matrix(C).as_euler(order)]
