"""A long log as short cells: what is kept of it while the positions of a table are looked for.

Rests and spins last seconds, samples come by the thousand. Means, scatter and table angles of
cells of a quarter of a second tell where they begin and end, and they fit into memory whatever the
length of the log. A cell ends where the label of the position changes and where samples are
missing, so that no cell belongs to two positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.detect.noise import lattice
from foucault.detect.stretches import TABLE
from foucault.tables import Log, TableColumns

CELL = TABLE.window  # Length of a cell [s].

SAMPLES = 40_000
"""Most samples of the log that are kept as they are: an axis in coarse steps does not move at rest,
only with the moves and spins does it show its steps [1]."""

HOLE = 0.25  # Where no sample came for longer, a rest or a spin is broken [s].


def longest_step(interval: float) -> float:
    """Return the longest step without samples missing, `interval` apart [s]."""
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
    # (3,) steps of the output of accel and gyro, 0 where it is not rounded [SI]
    output_steps: dict[str, FloatArray] = field(default_factory=dict)

    def steps(self, name: str) -> FloatArray:
        """Return the steps of the output of a triad, 0 where it is not rounded, (3,) [SI]."""
        return self.output_steps.get(name, np.zeros(3))


def held(log: Log) -> Log:
    """Copy a part of a block, so that the block itself can be freed."""

    def copied(x: FloatArray | None) -> FloatArray | None:
        return None if x is None else x.copy()

    table = log.table
    if table is not None:
        label = None if table.position is None else table.position.copy()
        table = TableColumns(table.angles.copy(), copied(table.rate), label)
    return Log(log.time.copy(), copied(log.gyro), copied(log.accel), log.sampled, table=table)


Rows = dict[str, Any]
"""Rows of a log as plain columns; the outer angle without jumps, and what the log says less it."""


def reduce(source: Source) -> Reduced:
    """Reduce a log to cells, block by block; `source` gives the blocks of the log [SI]."""
    parts: list[dict[str, Any]] = []
    findings: list[tuple[Any, ...]] = []
    state: _State | None = None
    for block in source():
        state = state or _State(block)
        findings.append(block.findings)
        parts += state.cells_of(block)
    assert state is not None
    parts += state.cells_of(None)
    cells = Cells(**{f.name: np.concatenate([p[f.name] for p in parts]) for f in fields(Cells)})
    steps = {k: np.array([lattice(x[:, i]) for i in range(3)]) for k, x in state.kept.items()}
    return Reduced(
        _closed(cells, state), state.interval, state.increments, state.has, tuple(findings), steps
    )


class _State:
    """What goes on from one block to the next."""

    def __init__(self, log: Log) -> None:
        self.interval = log.interval
        self.increments = log.sampled == "increment"
        self.samples = max(1, round(CELL / log.interval)) if len(log) > 1 else 1
        self.row = 0  # number of the first row that is held
        self.before = np.nan  # time of the sample before it
        self.held: Rows = {}
        self.kept: dict[str, FloatArray] = {}
        self._every = 1
        self._smooth = self._time = self._rate = np.nan
        table = log.table
        has = {name for name in ("accel", "gyro") if getattr(log, name) is not None}
        if table is not None:
            seen = np.isfinite(table.angles).any(axis=0)
            has |= set(np.array(["outer", "middle", "inner"])[seen].tolist())
            has |= {"outer"} if table.rate is not None else set()
            has |= {"label"} if table.position is not None else set()
        self.has = frozenset(has)

    def cells_of(self, block: Log | None) -> list[dict[str, Any]]:
        """Return the cells that are complete now; at the end, of all that is left."""
        if block is not None:
            for name in self.has & {"accel", "gyro"}:
                before = self.kept.get(name, np.empty((0, 3)))
                self.kept[name] = np.concatenate([before, getattr(block, name)[:: self._every]])
            while self.kept and len(next(iter(self.kept.values()))) > SAMPLES:
                self.kept = {name: x[::2].copy() for name, x in self.kept.items()}
                self._every *= 2
            new = self._rows(block)
            held = self.held or {k: x[:0] for k, x in new.items()}
            self.held = {k: np.concatenate([held[k], x]) for k, x in new.items()}
        part, cut = self._reduced(self.held, final=block is None)
        if cut:
            self.before = float(self.held["time"][cut - 1])
        self.row += cut
        self.held = {k: x[cut:].copy() for k, x in self.held.items()}
        return [part] if part else []

    def _rows(self, log: Log) -> Rows:
        n, table = len(log), log.table
        none = np.broadcast_to(np.nan, (n, 3))
        angles = np.array(none if table is None else table.angles)
        angles[:, 0], wraps = self._unwrapped(log)
        label = None if table is None else table.position
        return {
            "time": log.time, "angles": angles, "wraps": wraps,
            "accel": none if log.accel is None else log.accel,
            "gyro": none if log.gyro is None else log.gyro,
            "label": np.full(n, -1) if label is None else np.asarray(label, np.int64),
        }  # fmt: skip

    def _unwrapped(self, log: Log) -> tuple[FloatArray, FloatArray]:
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

    def _reduced(self, rows: Rows, final: bool) -> tuple[dict[str, Any] | None, int]:
        """Return the cells that are complete, and the number of rows they take."""
        time, label = rows["time"], rows["label"]
        n = len(time)
        if n == 0:
            return None, 0
        number = (self.row + np.arange(n)) // self.samples
        step = np.diff(time, prepend=self.before)
        gap = step > longest_step(self.interval)
        new = gap | (np.diff(number, prepend=number[0]) > 0)
        new |= np.diff(label, prepend=label[0]) != 0
        new[0] = True
        first = np.flatnonzero(new)
        cut = n if final else int(first[-1])
        first = first if final else first[:-1]
        if not len(first):
            return None, 0
        last = np.append(first[1:], cut) - 1
        count = last + 1 - first
        part: dict[str, Any] = {
            "start": np.where(gap[first], np.nan, time[first] - step[first]),
            "end": np.full(len(first), np.nan),
            "first": time[first],
            "last": time[last],
            "count": count,
            "from_angles": rows["angles"][first],
            "to_angles": rows["angles"][last],
            "wraps": rows["wraps"][first],
            "label": label[first],
            "broken": gap[first].astype(np.int64),
        }
        for name in ("accel", "gyro"):
            x = rows[name][:cut]
            mean = np.add.reduceat(x, first) / count[:, None]
            square = np.add.reduceat((x - np.repeat(mean, count, axis=0)) ** 2, first)
            part[name], part[f"{name}_var"] = mean, square / np.maximum(count - 1, 1)[:, None]
        return part, cut


def _closed(cells: Cells, state: _State) -> Cells:
    """Give each cell the time that its samples stand for: up to the middle between samples.

    Increments stand for the interval before their time.
    """
    dt = state.interval if np.isfinite(state.interval) else 0.0
    before = np.where(np.isnan(cells.start), cells.first - dt, cells.start)
    follows = np.append(cells.broken[1:] == 0, False)
    if state.increments:
        return replace(cells, start=before, end=cells.last)
    start = 0.5 * (before + cells.first)
    end = np.where(follows, np.append(start[1:], np.nan), cells.last + 0.5 * dt)
    return replace(cells, start=start, end=end)
