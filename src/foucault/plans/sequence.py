"""Sets of poses for spins about a level axis, from which the deflection of dithered gyros is found.

A gyro on a dither spring bends under specific force, and its sensitive axis with it. Six
coefficients say how far (arcsec per g). In a spin about North the attitude tilts about East; after
whole turns through the angle theta, with u the direction of North in body axes,

    tilt = theta (g / 2) row(u) . T,     u = (sin a cos b, cos a cos b, -sin b)

where the case is turned by the angle a about its z axis and then by b about East. Every entry of
the row is a quadratic form in u, so that six coefficients need six poses, three of them tilted.

`best_poses` seeks better ones: from many random sets each slides down to where no small change of
an angle is better. What is made small is the root mean square of the sds (A-optimal).

What a table does in a systematic calibration: rests and turns, as data.

A sequence is a start orientation and a list of `Rest` and `Rotate` actions: rests, turns about a
body or a level axis, and spins, which are turns by whole turns about a level axis. While an action
lasts the body turns about one axis fixed in it, so that attitude and rate are closed forms::

    C_nb(t) = C_nb(t_k) Exp(a_k s_k(t))      w_nb_b(t) = a_k s_k'(t)

with t_k the beginning of action k, a_k its axis in body axes and s_k the profile of its angle
(`manoeuvres.Profile`). A level axis stays level and so, seen from the turning body, stays put too.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5), eqs. (20)-(26).
.. [2] B. Xie, "Systematic calibration of strapdown inertial measurement units", 2011: nineteen
   positions, reached by quarter turns about body axes.
.. [3] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5): six action sequences of a spin
   about North, and the navigation test.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations
from math import ceil, inf, pi

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import TABLE_AXES, Profile, Rest, Rotate

COEFFICIENTS = ("xyy", "xzz", "yzz", "yxx", "zxx", "zyy")
"""Gyro, direction it bends to, direction of the specific force: the six of the design's columns."""

SINGULAR = 1e-9  # A singular value below this share of the largest is zero [1].

_A = float(np.degrees(np.arctan(2 / (1 + 5**0.5))))

_SETS: dict[str, tuple[tuple[float, float], ...]] = {
    "simple 6": ((0, 0), (90, 0), (0, -90), (45, 0), (0, -45), (90, -45)),
    "face diagonals 6": ((45, 0), (135, 0), (0, -45), (0, 45), (90, -45), (90, 45)),
    "icosahedral 6": (
        (0, _A - 90), (0, 90 - _A), (_A, 0), (180 - _A, 0), (90, -_A), (90, _A),
    ),
}  # fmt: skip

NAMES = tuple(_SETS)  # Names of the sets of poses.


def poses(name: str) -> FloatArray:
    """Return the angles a and b of a named set, shape (n, 2) [rad]."""
    if name not in _SETS:
        raise error(
            "poses.unknown", name=name, hint=suggestion(name, NAMES), allowed=", ".join(NAMES)
        )
    return np.radians(_SETS[name])


def spin_axis(angles: FloatArray) -> FloatArray:
    """Return the axis of the spin in body axes, shape (n, 3) [1]; eq. (20).

    `angles` (n, 2): angle a about z and angle b about East of each pose [rad].
    """
    a, b = angles.T
    return np.stack([np.sin(a) * np.cos(b), np.cos(a) * np.cos(b), -np.sin(b)], axis=1)


def design(u: FloatArray) -> FloatArray:
    """Return the row of each pose, shape (n, 6) [1]; eq. (25).

    `u` (n, 3): axis of the spin in body axes [1].
    """
    x, y, z = u.T
    return np.stack(
        [z**2 + y * z, y**2 - y * z, x**2 + x * z, z**2 - x * z, y**2 + x * y, x**2 - x * y], axis=1
    )


@dataclass(frozen=True)
class PoseQuality:
    """How well a set of poses tells the six coefficients."""

    rows: FloatArray  # (n, 6) the design [1]

    @property
    def rank(self) -> int:
        """Combinations of the six that are seen."""
        return int(np.linalg.matrix_rank(self.rows, tol=SINGULAR * np.linalg.norm(self.rows, 2)))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value, infinite where something is unseen [1]."""
        return float(np.linalg.cond(self.rows)) if self.rank == 6 else float("inf")

    @property
    def sd(self) -> FloatArray:
        """Sd of each coefficient per sd of ``2 tilt / (theta g)`` in a pose, shape (6,) [1]."""
        if self.rank < 6:
            return np.full(6, np.inf)
        return np.sqrt(np.diag(np.linalg.inv(self.rows.T @ self.rows)))

    @property
    def spread(self) -> float:
        """Root mean square of `sd` [1]."""
        return float(np.sqrt(np.mean(self.sd**2)))


def quality(angles: FloatArray) -> PoseQuality:
    """Judge a set of poses.

    `angles` (n, 2): angle a about z and angle b about East of each pose [rad].
    """
    return PoseQuality(design(spin_axis(angles)))


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


_COUNT = re.compile(r"[0-9]{1,3}")  # A number of poses that somebody can mean.


def poses_named(name: str) -> tuple[str, FloatArray]:
    """Return name and angles, shape (n, 2) [rad], of a set: one of `NAMES`, or "optimised N"."""
    words = name.lower().split()
    if len(words) == 2 and words[0] in ("optimised", "optimized") and _COUNT.fullmatch(words[1]):
        return f"optimised {words[1]}", best_poses(int(words[1]), starts=STARTS)
    return name, poses(name)


Action = Rest | Rotate

RATE = 10.0 * pi / 180.0  # Rate of a turn unless said otherwise [rad/s].
RAMP = 0.5  # Growth of a rate, and its fading, unless said otherwise: 90 deg then take 9.5 s [s].
REST = 150.0  # Length of a rest unless said otherwise [s].

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


SPIN_RATE = 18.0 * pi / 180.0  # Rate of the published spins: ten turns in 200 s [rad/s].


def quarter_turns(
    name: str,
    start: Iterable[str],
    turns: str,
    *,
    rest: float = REST,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return rests with quarter turns about body axes between them.

    `start`: where x, y and z point at first, such as "UEN"; `turns`: axis and sense of each turn,
    such as "+y -x", a half turn is "+2y"; `rest`: length of each rest [s]; `rate`: rate of the
    turns [rad/s]; `ramp`: growth of the rate, and its fading [s].
    """
    actions: list[Action] = [Rest(rest, "P1")]
    for k, word in enumerate(turns.split(), 2):
        quarters = int(word[1:-1] or 1) * (-1 if word[0] == "-" else 1)
        turn = Rotate(word[-1], quarters * pi / 2, rate, ramp, f"to P{k}")
        actions += [turn, Rest(rest, f"P{k}")]
    return CalibrationSequence(name, orientation(start), tuple(actions))


nineteen_positions = partial(
    quarter_turns, "19 positions", "UEN", "+y +y +y -y -y -y +z +x +x +x -x -x -x +z +z -z -z -z"
)
"""The nineteen positions of ref. [1]: 3021 s with the defaults of `quarter_turns`."""

nine_positions = partial(quarter_turns, "9 positions", "ENU", "-2x +2z -y +2y +z -2x -y -2z")
"""Nine positions: our own, the best found among chains of eight quarter or half turns.

Sought was the least of the largest ratio of a coefficient's sd to that of the nineteen positions,
rests as long, over the 24 errors of the instrument: 2.0, in half of the time.
"""


def gimbal_moves(
    before: FloatArray, after: FloatArray, *, rate: float = RATE, ramp: float = RAMP
) -> list[Action]:
    """Return the moves of a gimbal from one pair of angles to another: inner, then outer.

    The inner axis is z of the body, the outer one East; both senses are counter-clockwise.

    `before`, `after` (2,): outer and inner angle [rad]; `rate`: rate of the moves [rad/s];
    `ramp`: growth of the rate, and its fading [s].
    """
    (outer, inner) = np.asarray(after, float) - np.asarray(before, float)
    moves = (("z", inner, "inner"), ("east", outer, "outer"))
    return [Rotate(axis, float(a), rate, ramp, label) for axis, a, label in moves if abs(a) > 1e-9]


def gimbal_sequence(
    angles: FloatArray,
    *,
    name: str = "gimbal positions",
    start: FloatArray | None = None,
    rest: float = REST,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return rests at pairs of angles of a two-axis gimbal.

    ``C_nb = R_E(outer) C_nb(0, 0) R_z(inner)``: the outer axis points East, the inner one is z of
    the body.

    `angles` (n, 2): outer and inner angle of each position [rad]; `start` (3, 3): C_nb where both
    angles are zero, None for x east, y north, z up [1]; `rest`: length of each rest [s]; `rate`:
    rate of the moves [rad/s]; `ramp`: growth of the rate, and its fading [s].
    """
    angles = np.atleast_2d(np.asarray(angles, float))
    if angles.ndim != 2 or angles.shape[1] != 2 or not np.isfinite(angles).all():
        raise error("sequence.gimbal", name=name, given=f"shape {angles.shape}")
    actions: list[Action] = [Rest(rest, "P1")]
    for k in range(1, len(angles)):
        actions += gimbal_moves(angles[k - 1], angles[k], rate=rate, ramp=ramp)
        actions.append(Rest(rest, f"P{k + 1}"))
    return CalibrationSequence(name, _gimbal(angles[0], start), tuple(actions))


def _gimbal(angles: FloatArray, start: FloatArray | None) -> FloatArray:
    outer, inner = angles
    zero = np.eye(3) if start is None else np.asarray(start, float)
    return exp(np.array([outer, 0.0, 0.0])) @ zero @ exp(np.array([0.0, 0.0, inner]))


def action_sequences(
    angles: str | FloatArray = "simple 6",
    *,
    about: str = "north",
    turns: int = 10,
    spin_rate: float = SPIN_RATE,
    before: float = 0.0,
    rest: float = 200.0,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return the action sequences of ref. [2]: to each pose with the gimbals, a spin, a rest.

    `angles` (n, 2): name of a set of poses, see `poses`, or angle a about z
    and b about East of each [rad]; `turns`: turns of each spin: whole ones, or the gimbals' outer
    axis would not be East after it [1]; `spin_rate`: rate of the spins [rad/s]; `before`, `rest`:
    length of the rest before each spin (0: none) and after it [s]; `rate`: rate of the gimbals
    [rad/s]; `ramp`: growth of each rate, and its fading [s].
    """
    if turns < 1 or turns != int(turns):
        raise error("sequence.turns", given=turns)
    name = f"spins, {angles}" if isinstance(angles, str) else f"spins, {len(angles)} poses"
    pairs = poses(angles) if isinstance(angles, str) else np.atleast_2d(angles)
    pairs, now = np.asarray(pairs)[:, ::-1], np.zeros(2)
    actions: list[Action] = []
    for k, pair in enumerate(pairs, 1):
        actions += gimbal_moves(now, pair, rate=rate, ramp=ramp)
        if before > 0:
            actions.append(Rest(before, f"before S{k}"))
        actions += [spin(about, turns, spin_rate, ramp=ramp, label=f"S{k}"), Rest(rest, f"S{k}")]
        now = pair
    return CalibrationSequence(name, np.eye(3), tuple(actions))


def navigation_test(
    about: str, *, before: float = 300.0, rest: float = 500.0
) -> CalibrationSequence:
    """Return the navigation test of ref. [2]: x up, y east, z north; ten turns, then a long rest.

    `before`: length of the rest before them, for alignment [s]; `rest`: of that after them [s].
    """
    actions = (
        Rest(before, "alignment"), spin(about, 10, SPIN_RATE, label="spin"), Rest(rest, "rest")
    )  # fmt: skip
    return CalibrationSequence(f"navigation test about {about}", orientation("UEN"), actions)


BUILT_IN: dict[str, Callable[[], CalibrationSequence]] = {
    "19 positions": nineteen_positions,
    "9 positions": nine_positions,
    "spins, simple 6": lambda: action_sequences("simple 6"),
    "spins, face diagonals 6": lambda: action_sequences("face diagonals 6"),
    "spins, icosahedral 6": lambda: action_sequences("icosahedral 6"),
    "navigation test about east": lambda: navigation_test("east"),
    "navigation test about north": lambda: navigation_test("north"),
}
"""The sequences by name, with their usual times."""


def built_in(name: str) -> CalibrationSequence:
    """Return the sequence called `name`, one of `BUILT_IN`."""
    if name not in BUILT_IN:
        raise error(
            "sequence.unknown", name=name, hint=suggestion(name, BUILT_IN),
            allowed=", ".join(BUILT_IN),
        )  # fmt: skip
    return BUILT_IN[name]()
