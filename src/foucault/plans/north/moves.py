"""Stops of a base in order, as a search changes them: which there are, and their neighbours.

Angles are the detents, or multiples of 1 deg; lengths are multiples of 0.1 s: what is found is what
is written. Stops fill the time of a set-up, with the moves between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, inf, pi, radians

import numpy as np

from foucault.arrays import FloatArray

Move = tuple[list[int], list[int]]

UNIT = radians(1e-3)
"""Unit of the angles of a plan [rad]."""

TURN, HALF, DEGREE = 360_000, 180_000, 1000
"""Units in a turn, in half of one, and in a degree [1]."""

FINEST = radians(1.0)
"""Angles without detents are multiples of this [rad]."""

TICK = 0.1
"""Lengths of stops are multiples of this [s]."""

TRIES = 20
"""So many draws or moves are tried before a plan is returned as it was [1]."""


@dataclass(frozen=True, kw_only=True)
class Rig:
    """What the base can do, and the time there is."""

    total: float  # time of a set-up, moves included [s]
    move: float  # from one stop to the next [s]
    shortest: float  # shortest stop [s]
    settle: float = 0.0  # left out of each stop [s]
    most: int = 24  # most stops [1]
    index_limit: float = inf  # how far the base turns either way from 0 [rad]
    index_step: float | None = None  # detents; None for any angle [rad]
    opposite: bool = True  # whether every stop has its opposite


@dataclass(frozen=True)
class Schedule:
    """Stops in order."""

    index: tuple[int, ...]  # index angles, in units of 0.001 deg [1]
    dwell: tuple[int, ...]  # how long each lasts, in units of 0.1 s [1]

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True)
class Moves:
    """Draws orders of stops that a base allows, and changes them."""

    rig: Rig  # what the base can do

    @property
    def step(self) -> float:
        """Between the angles that there are [rad]."""
        return FINEST if self.rig.index_step is None else self.rig.index_step

    @cached_property
    def angles(self) -> tuple[int, ...]:
        """All angles that differ, each by its smallest turn; with opposites, those that have."""
        widest = floor(min(self.rig.index_limit, pi) / self.step + 1e-9)
        some = (round(n * self.step / UNIT) for n in range(-widest, widest + 1))
        there = {reduced(a) if abs(a) >= HALF else a for a in some}
        if self.rig.opposite:
            there = {a for a in there if reduced(a + HALF) in there}
        return tuple(sorted(there))

    def fits(self, count: int) -> int | None:
        """Return the time that `count` [1] stops share [0.1 s]; None where it is too short."""
        left = floor((self.rig.total - (count - 1) * self.rig.move) / TICK + 1e-6)
        return left if left >= count * self._least else None

    @cached_property
    def _least(self) -> int:
        return ceil((self.rig.shortest + self.rig.settle) / TICK - 1e-6)

    def draw(self, rng: np.random.Generator) -> Schedule | None:
        """Return random stops; None where none fit the time."""
        most = max(n for n in range(2, self.rig.most + 1) if self.fits(n) is not None)
        for _ in range(TRIES):
            found = self._drawn(rng, most)
            if found is not None:
                return found
        return None

    def _drawn(self, rng: np.random.Generator, most: int) -> Schedule | None:
        angles = [self._any(rng) for _ in range(int(rng.integers(1, 4)))]
        if self.rig.opposite:
            angles += [across(a) for a in angles]
        count = int(rng.integers(2, most + 1))
        index = [*angles, *rng.choice(angles, max(count - len(angles), 0)).tolist()]
        rng.shuffle(index)
        return self._settled(index[:most], [1] * len(index[:most]))

    def _any(self, rng: np.random.Generator) -> int:
        return self.angles[int(rng.integers(len(self.angles)))]

    def _settled(self, index: list[int], dwell: list[int]) -> Schedule | None:
        """Join neighbours at one angle and let the stops fill the time; None where they cannot."""
        angles, lengths = [index[0]], [dwell[0]]
        for a, t in zip(index[1:], dwell[1:], strict=True):
            if a == angles[-1]:
                lengths[-1] += t
            else:
                angles.append(a)
                lengths.append(t)
        whole = self.fits(len(angles))
        if whole is None or not 2 <= len(angles) <= self.rig.most:
            return None
        spare = whole - len(angles) * self._least
        above = [max(t - self._least, 0) for t in lengths]
        if sum(above) != spare:
            size = sum(above)
            above = [a * spare // size for a in above] if size else [0] * len(above)
            even, more = divmod(spare - sum(above), len(above))
            above = [a + even + (i < more) for i, a in enumerate(above)]
        return Schedule(tuple(angles), tuple(a + self._least for a in above))

    def moved(self, plan: Schedule, rng: np.random.Generator, heat: float) -> Schedule:
        """Return a neighbour of `plan`.

        `heat`: 1 at the beginning, 0 at the end: how large moves are [1].
        """
        moves = (self._time, self._time, self._swap, self._reverse, self._turned, self._insert,
                 self._remove, self._mirror, self._even, self._square)  # fmt: skip
        for _ in range(TRIES):
            one = moves[int(rng.integers(len(moves)))]
            index = [a if a in self.allowed else reduced(a) for a in plan.index]
            found = self._settled(*one(index, list(plan.dwell), rng, heat))
            if found not in (None, plan) and self.allowed.issuperset(found.index):
                return found
        return plan

    def _time(self, a: list[int], t: list[int], rng: np.random.Generator, heat: float) -> Move:
        """Give time of one stop to another."""
        i, j = (int(x) for x in rng.integers(len(t), size=2))
        size = min(t[i] - self._least, 1 + round(heat * t[i] * rng.random()))
        t[i], t[j] = t[i] - size, t[j] + size
        return a, t

    def _swap(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Exchange two stops."""
        i, j = (int(x) for x in rng.integers(len(t), size=2))
        a[i], a[j] = a[j], a[i]
        return a, t

    def _reverse(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Go through some of the stops backwards."""
        i, j = sorted(int(x) for x in rng.integers(len(t) + 1, size=2))
        a[i:j], t[i:j] = a[i:j][::-1], t[i:j][::-1]
        return a, t

    def _turned(self, a: list[int], t: list[int], rng: np.random.Generator, heat: float) -> Move:
        """Turn the stops at one angle, and those opposite."""
        old = a[int(rng.integers(len(a)))]
        widest = max(1, round(heat * radians(90.0) / self.step))
        steps = int(rng.integers(-widest, widest + 1))
        new = reduced(round((old * UNIT / self.step + steps) * self.step / UNIT))
        if new not in self.allowed:
            return a, t
        change = {old: new}
        if self.rig.opposite:
            change[across(old)] = across(new)
        return [change.get(x, x) for x in a], t

    @cached_property
    def allowed(self) -> frozenset[int]:
        return frozenset(self.angles)

    def _insert(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Stop once more, mostly at an angle that there is; a new one brings its opposite."""
        new = [a[int(rng.integers(len(a)))] if rng.random() < 0.8 else self._any(rng)]
        if self.rig.opposite and across(new[0]) not in a:
            new.append(across(new[0]))
        for one in new:
            i = int(rng.integers(len(a) + 1))
            a.insert(i, one)
            t.insert(i, max(sum(t) // (len(t) + 1), self._least))
        return a, t

    def _remove(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Leave a stop out; with the last at its angle go those opposite."""
        i = int(rng.integers(len(a)))
        gone = a.pop(i)
        t.pop(i)
        if self.rig.opposite and gone not in a:
            keep = [k for k, x in enumerate(a) if x != across(gone)]
            a, t = [a[k] for k in keep], [t[k] for k in keep]
        return (a, t) if a else ([gone], [self._least])

    def _mirror(self, a: list[int], t: list[int], _: np.random.Generator, __: float) -> Move:
        """Go through all stops and back."""
        return a + a[::-1], [x // 2 for x in t + t[::-1]]

    def _even(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Let all stops last as long, or all but the first and the last."""
        if len(a) < 3 or rng.random() < 0.5:
            return a, [10 * self._least] * len(a)
        ends = 10 * self._least
        return a, [ends, *[2 * ends] * (len(a) - 2), ends]

    def _square(self, a: list[int], t: list[int], _: np.random.Generator, __: float) -> Move:
        """Turn all stops to the nearest of forward, right, back and left."""
        return [reduced(HALF // 2 * round(x / (HALF // 2))) for x in a], t


def reduced(angle: int) -> int:
    """Return the direction of `angle` [0.001 deg] by the smallest turn."""
    return HALF - (HALF - angle) % TURN


def across(angle: int) -> int:
    """Return the direction opposite to `angle` [0.001 deg]."""
    return reduced(angle + HALF)


def schedule(index: FloatArray, dwell: FloatArray, rig: Rig) -> Schedule:
    """Return stops as a plan of the whole time there is.

    `index` (k,): index angles [rad]; `dwell` (k,): how long each lasts, scaled to the time [s].
    """
    whole = rig.total - (len(index) - 1) * rig.move
    ends = np.rint(np.cumsum(dwell) / dwell.sum() * floor(whole / TICK + 1e-6)).astype(int)
    turns = np.rint(np.asarray(index) / UNIT).astype(int)
    return Schedule(tuple(turns.tolist()), tuple(np.diff(ends, prepend=0).tolist()))
