"""A long log as short cells: what is kept of it while the positions of a table are looked for.

Rests and spins last seconds, samples come by the thousand. Means, scatter and table angles of
cells of a quarter of a second tell where they begin and end, and they fit into memory whatever the
length of the log. A cell ends where the label of the position changes and where samples are
missing, so that no cell belongs to two positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.tables import Log, TableColumns

CELL = 0.25
"""Length of a cell [s]."""

SAMPLES = 20_000
"""Most samples of the log that are kept as they are [1]."""

HOLE = 0.25
"""Where no sample came for longer, a rest or a spin is broken [s]."""


def longest_step(interval: float) -> float:
    """Return the longest time from a sample to the next without samples missing [s].

    `interval`: sample interval [s].
    """
    return max(HOLE, 1.5 * interval)


Source = Callable[[], Iterator[Log]]
"""Gives the blocks of a log, from its beginning each time it is called."""


@dataclass(frozen=True)
class Cells:
    """A log, reduced."""

    # start, end: (m,) the time that the samples of each cell stand for [s]
    start: FloatArray
    end: FloatArray
    # first, last: (m,) time of its first and of its last sample [s]
    first: FloatArray
    last: FloatArray
    count: IntArray  # (m,) its samples [1]
    # accel, gyro: (m, 3) means; NaN where not logged [m/s^2] and [rad/s]
    accel: FloatArray
    gyro: FloatArray
    # accel_var, gyro_var: (m, 3) variance of the samples about the mean [SI]
    accel_var: FloatArray
    gyro_var: FloatArray
    # from_angles, to_angles: (m, 3) table angles at the first and last sample, the outer one
    # without jumps; NaN where not logged [rad]
    from_angles: FloatArray
    to_angles: FloatArray
    # (m,) what the outer angle at the first sample was in the log, less `from_angles` [rad]
    wraps: FloatArray
    label: IntArray  # (m,) number of the position, -1 for none [1]
    broken: IntArray  # (m,) 1 where samples are missing before the cell [1]

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Reduced:
    """What the first pass over a log leaves."""

    cells: Cells
    interval: float  # sample interval [s]
    increments: bool  # whether rows are means over the interval before their time
    has: frozenset[str]  # which of accel, gyro, outer, middle, inner and label the log has
    findings: tuple[tuple[Any, ...], ...]  # what the reader told of each block
    # (k, 3) some samples from all over the log, accel and gyro [SI]
    samples: dict[str, FloatArray] = field(default_factory=dict)


def held(log: Log) -> Log:
    """Copy a part of a block, so that the block itself can be freed.

    `log`: the part [SI].
    """

    def copied(x: FloatArray | None) -> FloatArray | None:
        return None if x is None else x.copy()

    table = log.table
    if table is not None:
        label = None if table.position is None else table.position.copy()
        table = TableColumns(table.angles.copy(), copied(table.rate), label)
    return Log(log.time.copy(), copied(log.gyro), copied(log.accel), log.sampled, table=table)


def reduce(source: Source) -> Reduced:
    """Reduce a log to cells, block by block.

    `source`: gives the blocks of the log [SI].
    """
    parts: list[dict[str, Any]] = []
    findings: list[tuple[Any, ...]] = []
    state: _State | None = None
    for block in source():
        state = state or _State(block)
        findings.append(block.findings)
        state.see(block)
        rows = state.joined(_Rows(block, state.unwrapped(block)))
        part, cut = _reduced(rows, state, final=False)
        parts += [part] if part else []
        state.keep(rows, cut)
    assert state is not None
    assert state.held is not None
    part, _ = _reduced(state.held, state, final=True)
    parts += [part] if part else []
    columns = {f.name: np.concatenate([p[f.name] for p in parts]) for f in fields(Cells)}
    return Reduced(
        _closed(Cells(**columns), state), state.interval, state.increments, state.has,
        tuple(findings), state.kept,
    )  # fmt: skip


class _Rows:
    """Rows of a log as plain columns; the outer angle without jumps."""

    def __init__(self, log: Log, outer: tuple[FloatArray, FloatArray]) -> None:
        n = len(log)
        table = log.table
        none = np.broadcast_to(np.nan, (n, 3))
        self.time = log.time
        self.accel = none if log.accel is None else log.accel
        self.gyro = none if log.gyro is None else log.gyro
        self.angles = np.array(none if table is None else table.angles)
        self.angles[:, 0], self.wraps = outer
        label = None if table is None else table.position
        self.label = np.full(n, -1) if label is None else np.asarray(label, np.int64)

    _NAMES = ("time", "accel", "gyro", "angles", "wraps", "label")

    def __getitem__(self, rows: slice) -> _Rows:
        out = object.__new__(_Rows)
        for name in self._NAMES:
            setattr(out, name, getattr(self, name)[rows].copy())
        return out

    def __add__(self, other: _Rows) -> _Rows:
        out = object.__new__(_Rows)
        for name in self._NAMES:
            setattr(out, name, np.concatenate([getattr(self, name), getattr(other, name)]))
        return out

    def __len__(self) -> int:
        return len(self.time)


class _State:
    """What goes on from one block to the next."""

    def __init__(self, log: Log) -> None:
        self.interval = log.interval
        self.increments = log.sampled == "increment"
        self.samples = max(1, round(CELL / log.interval)) if len(log) > 1 else 1
        self.row = 0  # number of the first row that is held
        self.before = np.nan  # time of the sample before it
        self.held: _Rows | None = None
        self.kept: dict[str, FloatArray] = {}
        self._every = 1
        self._raw = self._smooth = self._time = self._rate = np.nan
        table = log.table
        has = {name for name in ("accel", "gyro") if getattr(log, name) is not None}
        if table is not None:
            seen = np.isfinite(table.angles).any(axis=0)
            names = np.array(["outer", "middle", "inner"])
            has |= set(names[seen].tolist())
            has |= {"outer"} if table.rate is not None else set()
            has |= {"label"} if table.position is not None else set()
        self.has = frozenset(has)

    def see(self, log: Log) -> None:
        """Keep some of the samples."""
        for name in ("accel", "gyro"):
            x = getattr(log, name)
            if x is not None:
                before = self.kept.get(name, np.empty((0, 3)))
                self.kept[name] = np.concatenate([before, x[:: self._every]])
        while self.kept and len(next(iter(self.kept.values()))) > SAMPLES:
            self.kept = {name: x[::2].copy() for name, x in self.kept.items()}
            self._every *= 2

    def unwrapped(self, log: Log) -> tuple[FloatArray, FloatArray]:
        """Return the outer angle without jumps, and what the log says less that."""
        table = log.table
        none = np.full(len(log), np.nan)
        if table is None:
            return none, none
        raw = table.angles[:, 0]
        if np.isfinite(raw).all():
            before = raw[0] if np.isnan(self._smooth) else self._smooth
            smooth = np.unwrap(np.concatenate([[before], raw]))[1:]
            self._smooth = float(smooth[-1])
            return smooth, raw - smooth
        if table.rate is None:
            return none, none
        # Only the rate is logged: the angle since the start of the log is its integral.
        start = np.isnan(self._time)
        time = np.concatenate([[log.time[0] if start else self._time], log.time])
        rate = np.concatenate([[table.rate[0] if start else self._rate], table.rate])
        turned = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))
        turned += 0.0 if start else self._smooth
        self._time, self._rate, self._smooth = time[-1], rate[-1], float(turned[-1])
        return turned, none

    def joined(self, rows: _Rows) -> _Rows:
        """Return the rows that are held, and `rows` after them."""
        return rows if self.held is None else self.held + rows

    def keep(self, rows: _Rows, cut: int) -> None:
        """Hold the rows after the first `cut`."""
        if cut:
            self.before = float(rows.time[cut - 1])
        self.row += cut
        self.held = rows[cut:]


def _reduced(rows: _Rows, state: _State, final: bool) -> tuple[dict[str, Any] | None, int]:
    """Return the cells that are complete, and the number of rows they take."""
    n = len(rows)
    if n == 0:
        return None, 0
    number = (state.row + np.arange(n)) // state.samples
    step = np.diff(rows.time, prepend=state.before)
    gap = step > longest_step(state.interval)
    new = gap | (np.diff(number, prepend=number[0]) > 0)
    new |= np.diff(rows.label, prepend=rows.label[0]) != 0
    new[0] = True
    first = np.flatnonzero(new)
    cut = n if final else int(first[-1])
    first = first if final else first[:-1]
    if not len(first):
        return None, 0
    last = np.append(first[1:], cut) - 1
    count = last + 1 - first
    part: dict[str, Any] = {
        "start": np.where(gap[first], np.nan, rows.time[first] - step[first]),
        "end": np.full(len(first), np.nan),
        "first": rows.time[first],
        "last": rows.time[last],
        "count": count,
        "from_angles": rows.angles[first],
        "to_angles": rows.angles[last],
        "wraps": rows.wraps[first],
        "label": rows.label[first],
        "broken": gap[first].astype(np.int64),
    }
    for name in ("accel", "gyro"):
        x = getattr(rows, name)[:cut]
        mean = np.add.reduceat(x, first) / count[:, None]
        rest = x - np.repeat(mean, count, axis=0)
        part[name] = mean
        part[f"{name}_var"] = np.add.reduceat(rest**2, first) / np.maximum(count - 1, 1)[:, None]
    return part, cut


def _closed(cells: Cells, state: _State) -> Cells:
    """Give each cell the time that its samples stand for: up to the middle between samples.

    Increments stand for the interval before their time.
    """
    dt = state.interval if np.isfinite(state.interval) else 0.0
    before = np.where(np.isnan(cells.start), cells.first - dt, cells.start)
    follows = np.append(cells.broken[1:] == 0, False)
    if state.increments:
        start, end = before, cells.last
    else:
        start = 0.5 * (before + cells.first)
        end = np.where(follows, np.append(start[1:], np.nan), cells.last + 0.5 * dt)
    return Cells(**{f.name: getattr(cells, f.name) for f in fields(Cells)}
                 | {"start": start, "end": end})  # fmt: skip
