"""In which order a north seeker's base stops, and for how long.

Each order is data: index angles, and the share of the time spent at each. A linear drift moves the
heading unless every index angle is reached at the same mean time, so that

    sum_k share_k t_k (cos a_k, sin a_k) = 0,    t_k from the middle of the whole;

the palindrome, an order and the same backwards, has that exactly, and costs no noise: its two
stops in the middle are one stop of double length. All of the information on the heading is in the
stops that look east and west, for there the rate changes with the heading. Where north is known
roughly, or after a short first solution, the time goes there: half the variance.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.north.dwells import PIECE, PIECES
from foucault.errors import error, suggestion
from foucault.files import atomic, keep_others
from foucault.models.dwells import Dwells

ROUGH = "a rough heading, and two accelerometers or a level case"
FIRST = "a first solution on the spot"
TURNING = "a base that turns at one rate"

HEADINGS = ("index (deg)", "dwell (s)")
"""The first line of a file of stops."""


@dataclass(frozen=True)
class StopOrder:
    """The base stops at one index angle after the other."""

    name: str  # as people call it
    index: FloatArray  # (k,) index angles in order, clockwise seen from above [rad]
    share: FloatArray  # (k,) of the time at the stops, with the sum 1 [1]
    # (k,) whether the angle counts from north, by a rough heading, not from forward
    from_north: npt.NDArray[np.bool_]
    needs: str = ""  # what is needed beside a base that stops; empty for nothing

    def __len__(self) -> int:
        return len(self.index)

    def shortest(self, move: float, stop: float) -> float:
        """Return the shortest total time [s] that leaves every stop long enough.

        `move`: time from one stop to the next [s]; `stop`: length of the shortest stop [s].
        """
        return (len(self) - 1) * move + stop / float(self.share.min())

    def stops(self, total: float, move: float) -> FloatArray:
        """Return how long each stop lasts, shape (k,) [s].

        `total`: all of the time, moves included [s]; `move`: time from one stop to the next [s].
        """
        return np.asarray(self.share * (total - (len(self) - 1) * move))

    def dwells(
        self, total: float, move: float, heading: FloatArray, rough: FloatArray | float = 0.0
    ) -> Dwells:
        """Return the dwells of m set-ups, with readings still zero.

        `total`: all of the time, moves included [s]; `move`: time from one stop to the next [s];
        `heading` (m,): true heading of each set-up [rad]; `rough` (m,): error of the rough
        heading of each [rad].
        """
        length = self.stops(total, move)
        start = np.cumsum(length + move) - length - move
        known = np.broadcast_to(heading + rough, heading.shape)[:, None]
        index = self.index - np.where(self.from_north, known, 0.0)
        return _dwells(start, length, index, 1.0)

    def repeated(self, times: int) -> StopOrder:
        """Return the order gone through so many `times` [1], stops that meet made one."""
        if times == 1:
            return self
        index, share = np.tile(self.index, times), np.tile(self.share / times, times)
        whole = _joined(index, share, np.tile(self.from_north, times))
        return StopOrder(f"{self.name} x {times}", *whole, self.needs)


@dataclass(frozen=True)
class TurningOrder:
    """The base turns on and on at one rate."""

    name: str  # as people call it
    turns: int  # turns in all of the time, whole ones [1]
    needs: str = TURNING

    def shortest(self, move: float, stop: float) -> float:
        """Return the shortest total time [s]: four shortest stops to a turn.

        `move`: not needed here [s]; `stop`: length of the shortest stop [s].
        """
        return 4 * stop * self.turns

    def dwells(
        self, total: float, move: float, heading: FloatArray, rough: FloatArray | float = 0.0
    ) -> Dwells:
        """Return the dwells of m set-ups, pieces of the rotation, with readings still zero.

        `total`: all of the time [s]; `move`: not needed here [s]; `heading` (m,): true heading of
        each set-up [rad]; `rough` (m,): not needed here [rad].
        """
        whole = 2 * np.pi * self.turns
        count = round(whole / float(np.clip(whole / PIECES, *PIECE)))  # as logs are cut
        length = np.full(count, total / count)
        index = whole * (np.arange(count) + 0.5) / count
        start = np.arange(count) * total / count
        every = np.broadcast_to(index, (len(heading), count))
        return _dwells(start, length, every, float(np.sinc(self.turns / count)))


Order = StopOrder | TurningOrder


def _dwells(start: FloatArray, length: FloatArray, index: FloatArray, shorter: float) -> Dwells:
    """Return dwells with the same times in each set-up; `index` is (m, k)."""
    m, k = index.shape
    flat = index.ravel()
    zero = np.zeros(m * k)
    return Dwells(
        np.repeat(np.arange(m), k), tuple(str(i) for i in range(m)), np.tile(start, m),
        np.tile(length, m), flat, shorter * np.cos(flat), shorter * np.sin(flat), zero,
        zero[:, None], np.full(m, np.nan),
        turning=None if shorter == 1 else np.ones(m * k, np.bool_),
    )  # fmt: skip


def _joined(
    index: FloatArray, share: FloatArray, from_north: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Make one stop of neighbours at the same angle."""
    same = (np.diff(index) == 0) & (from_north[1:] == from_north[:-1])
    first = np.flatnonzero(np.append(True, ~same))
    return index[first], np.add.reduceat(share, first), from_north[first]


def stops(name: str, degrees: tuple[float, ...]) -> StopOrder:
    """Return an order of equal stops; neighbours at the same angle are one stop.

    `degrees` (k,): index angles in order [deg].
    """
    index = np.radians(degrees)
    k = len(index)
    return StopOrder(name, *_joined(index, np.full(k, 1.0 / k), np.zeros(k, bool)))


PUBLISHED = stops("published", (0, 180, 90, 270))
SEQUENTIAL = stops("sequential", (0, 90, 180, 270))
PALINDROME = stops("palindrome", (0, 180, 90, 270, 270, 90, 180, 0))
PAIR = StopOrder(
    "east-west pair", np.radians([90.0, 270.0]), np.full(2, 0.5), np.ones(2, bool), ROUGH
)
"""The sensing axis looks east, then west."""
AGAIN = StopOrder(
    "east-west-east", np.radians([90.0, 270.0, 90.0]), np.array([0.25, 0.5, 0.25]),
    np.ones(3, bool), ROUGH,
)  # fmt: skip
"""The same, and back: a drift cancels, at the cost of a move."""


def positions(count: int) -> StopOrder:
    """Return `count` [1] positions spread evenly; two are the east-west pair.

    Two positions show one component of the rate. That says where north is, if they lie near east
    and west, and if the latitude is known.
    """
    if count < 2:
        raise error("north_plan.positions", given=count)
    if count == 2:
        return PAIR
    return stops(f"{count} positions", tuple(360.0 * i / count for i in range(count)))


def two_stage(share: float) -> StopOrder:
    """Return the published order for a `share` [1] of the time, then the east-west pair."""
    parts = [PUBLISHED.share * share, PAIR.share * (1 - share)]
    return StopOrder(
        "two-stage", np.concatenate([PUBLISHED.index, PAIR.index]), np.concatenate(parts),
        np.concatenate([PUBLISHED.from_north, PAIR.from_north]), FIRST,
    )  # fmt: skip


def continuous(turns: int) -> TurningOrder:
    """Return a rotation of so many whole `turns` [1]."""
    if turns < 1:
        raise error("north_plan.count", given=turns, what="turns")
    return TurningOrder(f"continuous, {turns} turn{'s' * (turns > 1)}", turns)


SHARES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
"""Of the time for the first stage, to choose from [1]."""

NAMES = (
    "published", "sequential", "palindrome", "6 positions", "east-west pair", "east-west-east",
    "two-stage", "continuous 5",
)  # fmt: skip
"""Orders that are compared where none is named."""


_COUNT = re.compile(r"[0-9]{1,5}")
"""A number of positions or turns that somebody can mean."""


def orders(name: str, cycles: int = 1) -> tuple[Order, ...]:
    """Return the order called `name`; several to choose from, where a share is to be found.

    `name`: as in `NAMES`, with any number of positions or turns; `cycles`: how often orders of
    stops are gone through [1].
    """
    if cycles < 1:
        raise error("north_plan.count", given=cycles, what="cycles")
    known = " ".join(name.lower().replace("-", " ").replace(",", " ").split())
    words = known.split()
    number = next((int(w) for w in words if _COUNT.fullmatch(w)), None)
    fixed = {"published": PUBLISHED, "sequential": SEQUENTIAL, "palindrome": PALINDROME,
             "east west pair": PAIR, "east west east": AGAIN}  # fmt: skip
    if known == "two stage":  # its two stages follow one another once
        return tuple(two_stage(share) for share in SHARES)
    if number is not None and words[0] == "continuous":
        return (continuous(number),)
    if number is not None and words[-1] in ("positions", "position"):
        return (positions(number).repeated(cycles),)
    if known not in fixed:
        allowed = (*NAMES[:3], "N positions", *NAMES[4:7], "continuous N")
        hint = suggestion(name.lower(), allowed)
        raise error("north_plan.order", name=name, hint=hint, allowed=", ".join(allowed))
    return (fixed[known].repeated(cycles),)


def write_stops(order: Order, total: float, move: float, path: str | Path) -> None:
    """Write the stops as CSV, index angle [deg] and length [s], whole or not at all.

    `order`: the order, a rotation has no stops and is refused; `total`: all of the time, moves
    included [s]; `move`: time from one stop to the next [s].
    """
    if isinstance(order, TurningOrder):
        raise error("north_plan.no_stops", name=order.name)
    rows = zip(np.degrees(order.index), order.stops(total, move), order.from_north, strict=True)
    lines = [",".join((*HEADINGS, "counted from"))]
    keep_others(path, [lines[0].encode()])
    lines += [f"{a:.6f},{t:.3f},{'north' if n else 'forward'}" for a, t, n in rows]
    with atomic(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
