"""A first look at a log; while one is recorded, what is still to visit and what looks wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.coverage import coverage, direction_words, named_directions
from foucault.detect.live import LiveRests
from foucault.detect.noise import measure_noise, told_of, without_spikes
from foucault.detect.stretches import (
    Rests,
    find_rests,
    means_of,
    rest_table,
    spun,
    swung,
    turning,
)
from foucault.diagnose.hand_rotated import ENOUGH_RESTS
from foucault.errors import Finding, FoucaultError, finding
from foucault.guard import rest
from foucault.guard.rest import first_rest, same_unit
from foucault.logs import axes as log_axes
from foucault.logs import checks
from foucault.logs.reading import implausible
from foucault.tables import Log, gaps
from foucault.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription, Triad


STEADY = np.radians(1.0)
"""A quiet time that turns faster than the rests is a turn; drift and Earth are slower [rad/s]."""


@dataclass(frozen=True)
class Axes:
    """Readings of one triad, each shape (3,) [unit of the triad]."""

    # mean, sd, lowest, highest: (3,) over the whole log [unit]
    mean: FloatArray
    sd: FloatArray
    lowest: FloatArray
    highest: FloatArray
    noise: FloatArray  # (3,) white noise at rest, NaN where there is no rest [unit/sqrt(Hz)]


@dataclass(frozen=True)
class Inspection:
    """What a log looks like before anything is estimated from it."""

    log: Log  # the log [SI]
    rests: Rests  # where the instrument did not move
    # first, last, start, end and means of "rests" in tables.toml, shape (rests,) each [SI]
    rest_rows: dict[str, npt.NDArray[np.generic]]
    # accel, gyro: readings [m/s^2], [rad/s]
    accel: Axes | None
    gyro: Axes | None
    # shortest, longest: extremes of the sample interval [s]
    shortest: float
    longest: float
    gaps: int  # see `foucault.tables.gaps` [1]
    turning: BoolArray  # (rests,) which of the quiet times are turns at a constant rate

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed while reading and while looking for rests."""
        return (*self.log.findings, *self.rests.findings)


def inspect(log: Log) -> Inspection:
    """Look at a log of readings [SI]."""
    if log.averaged is not None:
        return _means(log)
    given, log = log, without_spikes(log.filled())
    rests = find_rests(log, spins=True)
    turning = turns_among(log, rests)
    log = _as_logged(log, given)
    rows = rest_table(log, rests)
    still = replace(rests, first=rests.first[~turning], last=rests.last[~turning])
    step = np.diff(log.time)
    return Inspection(
        log=log,
        rests=rests,
        rest_rows=rows,
        accel=_axes(log.accel, log.interval, still, log.sampled == "increment"),
        gyro=_axes(log.gyro, log.interval, still, log.sampled == "increment"),
        shortest=float(step.min(initial=np.inf)),
        longest=float(step.max(initial=0.0)),
        gaps=int(np.count_nonzero(gaps(step))),
        turning=turning,
    )


def _as_logged(log: Log, given: Log) -> Log:
    """Return the log without what took the place of axes that were not logged."""
    new: dict[str, Any] = {}
    for name in ("gyro", "accel"):
        axes = list(given.logged(name))
        if len(given) and len(axes) in (1, 2):
            new[name] = np.full((len(log), 3), np.nan)
            new[name][:, axes] = getattr(log, name)[:, axes]
    return replace(log, **new) if new else log


def _means(log: Log) -> Inspection:
    """Look at a log whose rows are means: nothing moves in a row, and no noise is seen."""
    n = len(log)
    rows, level = np.arange(n, dtype=np.int64), np.full(n, np.nan)
    rests = Rests(rows, rows + 1, level, level, level)
    none = replace(rests, first=rows[:0], last=rows[:0])
    table = rest_table(log, rests)
    return Inspection(
        log=log,
        rests=rests,
        rest_rows=table,
        accel=_axes(log.accel, 1.0, none, False),
        gyro=_axes(log.gyro, 1.0, none, False),
        shortest=float("nan"),
        longest=float("nan"),
        gaps=0,
        turning=turns_among(log, rests),
    )


def turns_among(log: Log, rests: Rests) -> BoolArray:
    """Tell which quiet times turn at a constant rate, by that of a table or the readings, (n,)."""
    n, spans = len(rests), rests.spans
    told = None if log.table is None else log.table.rate
    if told is not None and np.isfinite(told).any():
        rate = np.array([abs(float(np.mean(told[a:b]))) for a, b in spans])
        return np.asarray(np.nan_to_num(rate) > STEADY / 10)
    turns = np.zeros(n, bool)
    if log.accel is not None and log.averaged is None:
        turns = swung(log.accel, spans, rests.window)
    kept = np.flatnonzero(~turns)
    if log.gyro is None or len(kept) < 2:
        return turns
    # Rests have the same rate, their bias; turns go about many axes. Take the densest of all,
    # and of those that are as dense the slowest.
    mean = means_of(log.gyro, spans)[kept]
    apart = np.linalg.norm(mean[:, None] - mean, axis=2)
    alike = np.sum(apart <= STEADY, axis=1)
    near = np.flatnonzero(alike >= 0.7 * alike.max())
    centre = near[np.argmin(np.linalg.norm(mean[near], axis=1))]
    fast = apart[centre] > STEADY
    turns[kept[fast]] = True
    if log.accel is not None and log.averaged is None:
        kept, lasting = kept[~fast], (rests.last - rests.first) * log.interval
        force = means_of(log.accel, [spans[k] for k in kept])
        turns[kept] = spun(mean[~fast], force, lasting[kept])
    return turns


def _axes(x: FloatArray | None, interval: float, rests: Rests, counts: bool) -> Axes | None:
    if x is None:
        return None
    noise = (
        np.sqrt(measure_noise(x, interval, rests, increments=counts).psd)
        if len(rests)
        else np.full(3, np.nan)
    )
    return Axes(x.mean(axis=0), x.std(axis=0), x.min(axis=0), x.max(axis=0), noise)


VISITED = np.radians(30.0)  # A named direction is visited by a rest within this angle [rad].
ALIKE = np.radians(15.0)  # Rests closer than this are one orientation [rad].


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
    """Return up at the rests, samples `first` to before `last` (n,), frame b, shape (n, 3) [1]."""
    f_b = found.means("accel", first, last)
    return np.asarray(f_b / np.maximum(np.linalg.norm(f_b, axis=1), 1e-300)[:, None])


def checklist(
    found: LiveRests,
    findings: tuple[Finding, ...] = (),
    *,
    hold: float = 0.0,
    needed: int = ENOUGH_RESTS,
) -> Checklist:
    """Say what a log holds and lacks: rests of `hold` [s], `needed` orientations [1]."""
    time = found.log.time
    first, last, turns = found.rests()
    first, last = first[~turns], last[~turns]
    sphere = _sphere(up_of(found, first, last))
    since = found.still_since
    still = None if not found.samples or len(found) < found.samples else since is not None
    asked = max(hold, found.how.shortest)
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


EVERY, SPAN = 2.0, 30.0  # The newest `SPAN` of the log is looked at `EVERY` so often [s].

ENOUGH_FOR_TURNS = 6
"""Rests from which the turns between them show exchanged axes and a wrong gyro unit [1]."""

MOST_TURNS = 8  # Turns that are compared with every exchange of axes [1].

UNQUIET = {"accel": 0.3, "gyro": float(np.radians(5.0))}
"""No instrument at rest shakes as much: nobody has held it still yet [m/s^2, rad/s]."""


class Watchman:
    """Looks at a growing log from time to time and remembers what he saw.

    `found`: the log and its rests; `used`: the complete description of the log.
    """

    def __init__(self, found: LiveRests, used: LogDescription) -> None:
        self._found, self._used = found, used
        self._checked = 0
        self._once: dict[str, Finding] = {}  # what has happened, by what and where
        self._now: list[Finding] = []  # what is so now
        self._turns: list[Finding] = []
        self._turns_at = 0

    def findings(self) -> tuple[Finding, ...]:
        """Return what looks wrong so far."""
        found = self._found
        if found.samples and (len(found) - self._checked) * found.interval >= EVERY:
            self._look(found.log)
            self._checked = len(found)
        return (*self._once.values(), *told_of(found.spikes), *self._now)

    def _look(self, log: Log) -> None:
        found = self._found
        start = max(0, min(self._checked, len(log) - round(SPAN / found.interval)) - 1)
        part = log[start:]
        told = list(checks.timing(part.time, start))
        # At rest a coarse axis only seems stuck.
        if np.sum(found.level(start) >= found.limit) * found.interval > 2.0:
            for name, x in (("gyro", part.gyro), ("accel", part.accel)):
                block = getattr(self._used, name)
                if x is not None and block is not None:
                    told += log_axes.check(part.time, x, name, _limits(block))
        told += log_axes.unmoved(log)
        for item in told:
            what = item.message.partition(" is ")[0] if item.code == "log.saturated" else ""
            self._once.setdefault(item.code + what, item)
        self._now = [*implausible(part, self._used), *self._unquiet(), *self._of_rests(log)]

    def _unquiet(self) -> list[Finding]:
        quiet = self._found.quiet
        if all(quiet.get(name, 0.0) <= limit for name, limit in UNQUIET.items()):
            return []
        gyro = np.degrees(quiet.get("gyro", 0.0))
        return [finding("watch.not_quiet", accel=f"{quiet['accel']:.2g}", gyro=f"{gyro:.2g}")]

    def _of_rests(self, log: Log) -> list[Finding]:
        first, last, turns = self._found.rests()
        told = []
        if turns.any():
            _, rate = turning(self._found.means("gyro", first, last))
            time = log.time - log.time[0]
            told += [
                finding("rest.moving", start=f"{time[first[i]]:.1f}",
                        end=f"{time[last[i] - 1]:.1f}", rate=f"{np.degrees(rate[i]):.2f}")
                for i in np.flatnonzero(turns)
            ]  # fmt: skip
        first, last = first[~turns], last[~turns]
        if not len(first):
            return told
        up_b = up_of(self._found, first, last)
        try:
            same_unit(self._found.means("accel", first, last), STANDARD_GRAVITY)
            first_rest(log, up_b[0])
        except FoucaultError as problem:
            told.append(_warning(problem))
        return told + self._of_turns(log, up_b, first, last)

    def _of_turns(
        self, log: Log, up_b: FloatArray, first: IntArray, last: IntArray
    ) -> list[Finding]:
        # To try every exchange of axes takes long: not again before there is half as much more.
        n = len(first)
        if log.gyro is None or n < max(ENOUGH_FOR_TURNS, 1.5 * self._turns_at):
            return self._turns
        self._turns_at = n
        some = slice(max(0, n - MOST_TURNS - 1), n)
        bias = self._found.means("gyro", first, last).mean(axis=0)
        ends, starts = last[some][:-1] - 1, first[some][1:]
        problem = rest.problem(log, up_b[some], bias, ends, starts)
        self._turns = [] if problem is None else [_warning(problem)]
        return self._turns


def _warning(problem: FoucaultError) -> Finding:
    return Finding(problem.code, "warning", problem.message, problem.cure)


def _limits(block: Triad) -> FloatArray | None:
    """Return the range of each axis, shape (3, 2) [SI]; increments are means by now."""
    limits = block.limits()
    if limits is None or block.kind == "increment":
        return None
    zero, factor = block.conversion()
    return np.sort((limits[None, :] - zero[:, None]) * factor[:, None], axis=1)
