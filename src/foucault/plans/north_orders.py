"""In which order a north seeker's base stops, and for how long.

Each order is data: index angles, and the share of the time spent at each. A linear drift moves the
heading unless every index angle is reached at the same mean time, so that

    sum_k share_k t_k (cos a_k, sin a_k) = 0,    t_k from the middle of the whole;

the palindrome, an order and the same backwards, has that exactly, and costs no noise: its two
stops in the middle are one stop of double length. All of the information on the heading is in the
stops that look east and west, for there the rate changes with the heading. Where north is known
roughly, or after a short first solution, the time goes there: half the variance.

`compare` says which order is best for a wanted accuracy, and how long it takes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, inf, isfinite, log, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.dwells import PIECE, PIECES
from foucault.errors import error, suggestion
from foucault.estimate.north_reduction import GYRO_NOISE, TILT_NOISE
from foucault.files import atomic, keep_others
from foucault.models.north_seeker import Dwells
from foucault.plans.north_stops import Conditions, Prediction, poses, predict
from foucault.units import span

ROUGH = "a rough heading, and two accelerometers or a level case"
FIRST = "a first solution on the spot"
TURNING = "a base that turns at one rate"

HEADINGS = ("index (deg)", "dwell (s)")  # The first line of a file of stops.


@dataclass(frozen=True)
class StopOrder:
    """The base stops at one index angle after the other."""

    name: str  # as people call it
    index: FloatArray  # (k,) index angles in order, clockwise seen from above [rad]
    share: FloatArray  # (k,) of the time at the stops, with the sum 1 [1]
    # (k,) whether the angle counts from north, by a rough heading, not from forward
    from_north: BoolArray
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
        return dwells_at(start, length, index)

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
        return dwells_at(start, length, every, float(np.sinc(self.turns / count)))


Order = StopOrder | TurningOrder


def dwells_at(
    start: FloatArray, length: FloatArray, index: FloatArray, shorter: float = 1.0
) -> Dwells:
    """Return dwells of set-ups that are timed alike, with readings still zero.

    `start`, `length` (k,): when each begins and how long it lasts [s]; `index` (m, k): index
    angles of each set-up [rad]; `shorter`: what a rotation leaves of cosine and sine [1].
    """
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
    index: FloatArray, share: FloatArray, from_north: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
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


SHARES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)  # Of the time for the first stage, to choose from [1].

NAMES = (
    "published", "sequential", "palindrome", "6 positions", "east-west pair", "east-west-east",
    "two-stage", "continuous 5",
)  # fmt: skip
"""Orders that are compared where none is named."""


_COUNT = re.compile(r"[0-9]{1,5}")  # A number of positions or turns that somebody can mean.


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


LONGEST = 86400.0  # Longest time that is tried [s].

SHORTEST = 5.0
"""Shortest stop: what is left of it after settling is cut out of a log from so long on [s]."""

SEEN = 3.0  # The Earth's rate is seen where it is so many sd of what is measured of it [1].
ALIKE = 1.1  # Plans whose sd differ by less than this are alike; then what is safer decides [1].
NO_DRIFT = 1.3e5  # Errors by drift that differ by less are alike; 0.001 deg for 0.1 deg/h/h [s^2].
UNREACHED = 1e6  # Puts orders that do not reach the accuracy after all that do [1].
LIMITING = 0.1  # Share of the variance from which on a source is what sets the floor [1].
REPEATS = (2, 3, 5, 8)  # How often an order may be repeated [1].
STEPS = 14  # Times that are tried before the search between two of them [1].


@dataclass(frozen=True)
class Task:
    """What is to be planned."""

    conditions: Conditions  # instrument, place, and what is known [SI]
    accuracy: float | None = None  # wanted standard deviation of the heading [rad]
    total: float | None = None  # time there is [s]
    move: float = 10.0  # time from one stop to the next [s]
    rough_sd: float | None = None  # standard deviation of a rough heading; None without one [rad]


GUESS = np.radians(2.0)
"""Rough heading to show what the east-west pair would give, where none is to be had [rad]."""


@dataclass(frozen=True)
class Row:
    """What one order gives."""

    order: Order  # the order; of those to choose from, the best
    # time for the wanted accuracy; infinite where it is not reached, NaN where none is wanted [s]
    needed: float
    at: Prediction | None  # in `time`; None where that is too short for its stops
    time: float  # the time there is, else the time needed, else that of the floor [s]
    # the best that it gives in any time, where the accuracy is not reached
    floor: Prediction | None = None
    floor_time: float = np.nan  # in which it does [s]
    why: str = ""  # why there is nothing to say

    @property
    def sd(self) -> float:
        """Standard deviation in `time` [rad]."""
        return inf if self.at is None else self.at.sd

    @property
    def limit(self) -> str:
        """What sets the floor: white noise would go down with more time, this does not."""
        sources = {} if self.floor is None else self.floor.sources
        fixed = {name: v for name, v in sources.items() if name not in (GYRO_NOISE, TILT_NOISE)}
        name = max(fixed, key=lambda n: fixed[n], default="")
        if name and fixed[name] > LIMITING * sum(sources.values()):
            return name
        return f"noise in {span(LONGEST)}"

    @property
    def drift_error(self) -> float:
        """Largest error by a linear drift of 1 rad/s^2 that is not estimated [s^2]."""
        return inf if self.at is None else self.at.drift_error

    def as_dict(self, move: float, drift: float) -> dict[str, Any]:
        """Return the row as plain values.

        `move`: time from one stop to the next [s]; `drift`: linear drift to give the effect of
        [rad/s^2].
        """
        stops = None
        if isinstance(self.order, StopOrder) and self.at is not None:
            of = (self.order.index, self.order.stops(self.time, move), self.order.from_north)
            stops = [
                {"index": float(a), "dwell": float(t), "from_north": bool(n)}
                for a, t, n in zip(*of, strict=True)
            ]
        return {
            "name": self.order.name,
            "needs": self.order.needs,
            "time_needed": _finite(self.needed),
            "floor": None if self.floor is None else self.floor.sd,
            "floor_source": None if self.floor is None else self.limit,
            "time": _finite(self.time),
            "sd": _finite(self.sd),
            "worst_sd": None if self.at is None else self.at.worst,
            "drift_error": _finite(self.drift_error * drift),
            "sources": {} if self.at is None else self.at.sources,
            "stops": stops,
        }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


@dataclass(frozen=True)
class Choice:
    """All that were compared, and the one to take."""

    task: Task
    rows: tuple[Row, ...]
    best: Row  # the one to take
    reason: str
    beyond: Row | None = None  # A better one, if what it needs is to be had
    # how often to go through the best in the same time [1] and the sd that this gives [rad], where
    # slow noise makes it pay
    repeats: tuple[int, float] | None = None

    @property
    def signal(self) -> float:
        """The Earth's horizontal rate over the sd of what is measured across it [1]."""
        return 1.0 / self.best.sd


def compare(task: Task, names: Iterable[str] = NAMES, cycles: int = 1) -> Choice:
    """Compare orders.

    `cycles`: how often orders of stops are gone through [1].
    """
    rows = tuple(_row(orders(name, cycles), task) for name in names)
    return _chosen(task, rows)


def at_time(order: Order, total: float, task: Task, *, drift: bool = True) -> Prediction:
    """Predict what an order gives in a time.

    `total`: all of the time, moves included [s]; `task`: conditions, moves and rough heading
    [SI]; `drift`: whether to find the error by drift too.
    """
    c = task.conditions
    at = poses(c.tilt)
    off = 0.0
    if order.needs == ROUGH:
        off = GUESS if task.rough_sd is None else task.rough_sd
    elif order.needs == FIRST and isinstance(order, StopOrder):
        k = len(PUBLISHED)
        share = float(order.share[:k].sum())
        first = share * (total - (len(order) - 1) * task.move) + (k - 1) * task.move
        off = predict(PUBLISHED.dwells(first, task.move, at[:, 0]), at, c, drift=False).sd
    # Either side, heading by heading: the mean square is off^2.
    rough = np.where(np.unique(at[:, 0], return_inverse=True)[1] % 2, -off, off)
    dwells = order.dwells(total, task.move, at[:, 0], rough)
    return predict(dwells, at, c, near=order.needs == ROUGH, drift=drift)


def _best_at(
    some: tuple[Order, ...], total: float, task: Task
) -> tuple[Order | None, Prediction | None]:
    """Return the best of orders that have the time for their stops."""
    fit = [o for o in some if o.shortest(task.move, SHORTEST) <= total * (1 + 1e-9)]
    found = [(o, at_time(o, total, task, drift=False)) for o in fit]
    return min(found, key=lambda f: f[1].sd, default=(None, None))


def _row(some: tuple[Order, ...], task: Task) -> Row:
    if some[0].needs == ROUGH and not task.conditions.latitude_known:
        return Row(some[0], inf, None, np.nan, why="the latitude must be known")
    needed, floor, floor_time = np.nan, None, np.nan
    if task.accuracy is not None:
        needed, floor, floor_time = _needed(some, task, task.accuracy)
    time = task.total
    if time is None:
        time = needed if isfinite(needed) else floor_time
    order = _best_at(some, time, task)[0]
    if order is None:
        return Row(some[-1], needed, None, time, floor, floor_time, "too short for its stops")
    return Row(order, needed, at_time(order, time, task), time, floor, floor_time)


def _needed(
    some: tuple[Order, ...], task: Task, accuracy: float
) -> tuple[float, Prediction | None, float]:
    """Return the time for an accuracy; infinite, with the best there is and when, without one."""
    from scipy.optimize import brentq

    least = min(o.shortest(task.move, SHORTEST) for o in some)
    floor, floor_time, before = None, np.nan, least
    for time in np.geomspace(least, max(LONGEST, 2 * least), STEPS):
        order, found = _best_at(some, float(time), task)
        assert order is not None and found is not None
        if found.sd <= accuracy:
            low = max(log(before), log(order.shortest(task.move, SHORTEST)))
            ends = {log(time): log(found.sd / accuracy)}  # each prediction takes a while

            def over(x: float, order: Order = order, ends: dict[float, float] = ends) -> float:
                if x not in ends:
                    ends[x] = log(at_time(order, exp(x), task, drift=False).sd / accuracy)
                return ends[x]

            if over(low) <= 0:
                return exp(low), None, np.nan
            return exp(brentq(over, low, log(time), xtol=1e-3)), None, np.nan
        if floor is None or found.sd < floor.sd:
            floor, floor_time = found, float(time)
        before = float(time)
    return inf, floor, floor_time


def _cost(row: Row, task: Task) -> float:
    """What is to be small: the sd in the time there is, or the root of the time needed."""
    if task.accuracy is None or task.total is not None:
        return row.sd
    if isfinite(row.needed):
        return sqrt(row.needed)
    return UNREACHED * (inf if row.floor is None else row.floor.sd)


def _given(order: Order, task: Task) -> bool:
    """Tell whether there is what an order needs."""
    return not order.needs or (order.needs == ROUGH and task.rough_sd is not None)


def _chosen(task: Task, rows: tuple[Row, ...]) -> Choice:
    able = [r for r in rows if _given(r.order, task)]
    able = able or list(rows)
    lowest = min(_cost(r, task) for r in able)
    alike = [r for r in able if r.at is not None and _cost(r, task) <= ALIKE * lowest]
    if not alike:
        least = min(r.order.shortest(task.move, SHORTEST) for r in able)
        raise error("north_plan.too_short", given=span(task.total or 0.0),
                    stop=span(SHORTEST), least=span(least))  # fmt: skip
    best = min(alike, key=lambda r: (round(r.drift_error / NO_DRIFT), _cost(r, task)))
    reason = "nothing else that can be done with what there is does better"
    if len(alike) > 1 and best.drift_error < min(alike, key=lambda r: _cost(r, task)).drift_error:
        most = f"{ALIKE - 1:.0%}".replace("%", " %")
        reason = f"a linear drift of the gyro does least to it, and it costs {most} of sd at most"
    better = [r for r in rows if r not in able and _cost(r, task) * ALIKE < _cost(best, task)]
    beyond = min(better, key=lambda r: _cost(r, task), default=None)
    return Choice(task, rows, best, reason, beyond, _repeats(best, task))


def _repeats(row: Row, task: Task) -> tuple[int, float] | None:
    """Return how often to go through the order in the same time, and the sd, where that pays."""
    order, noise = row.order, task.conditions.noise.gyro
    if not isinstance(order, StopOrder) or order.needs or not row.time > 0:
        return None
    if not (noise.bias_instability or noise.random_walk):
        return None  # white noise does not mind, and every move costs time
    found = []
    for times in REPEATS:
        more = order.repeated(times)
        if more.shortest(task.move, SHORTEST) <= row.time:
            found.append((times, at_time(more, row.time, task, drift=False).sd))
    best = min(found, key=lambda f: f[1], default=None)
    return best if best is not None and best[1] * ALIKE < row.sd else None
