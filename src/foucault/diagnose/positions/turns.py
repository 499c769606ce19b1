"""Whole turns of a spin: between which two times to average.

The horizontal part of the Earth's rotation, and what a leaning outer axis adds, go round in the
instrument and average to zero over whole turns, not over any others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.positions.cells import CELL, Reduced, Source, held
from foucault.diagnose.positions.stretches import Stretch, mean
from foucault.tables import Log

TURN = 2 * np.pi

NEARLY = 0.01
"""Where no angle is logged, so much less than a turn still counts as one [1]."""

ROUNDED = 1e-3
"""The same where an angle is: what stamps and angles are rounded by [1]."""

OFF_LINE = np.radians(0.02)
"""An outer angle this far from uniform rotation belongs to a ramp [rad]."""

OFF_GYRO = 2e-6
"""The same for the angle that the gyros add up, beyond their noise [rad]."""


@dataclass(frozen=True)
class Reach:
    """Where uniform rotation begins and ends."""

    # start, end: first and last time of it [s]
    start: float
    end: float
    # time, angle: (k,) times beyond the cells of the spin, and the outer angle then, without jumps
    # [s], [rad]
    time: FloatArray = field(default_factory=lambda: np.empty(0))
    angle: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Window:
    """The time over which a reading is averaged."""

    # start, end: first and last time [s]
    start: float
    end: float
    rate: float = 0.0  # rate of the outer axis over it, 0 at rest [rad/s]
    turns: float = 0.0  # turns in it, whole; 0 at rest [1]
    whole: float = 0.0  # turns of the spin that it was taken from [1]


def cells_of(data: Reduced, run: Stretch) -> Reach:
    """Return the time that the cells of a stretch cover [s]."""
    return Reach(float(data.cells.start[run.first]), float(data.cells.end[run.last - 1]))


def whole_turns(data: Reduced, run: Stretch, rate: float | None, reach: Reach) -> Window:
    """Choose the whole turns of a spin, as many as there are, from its middle.

    `rate` or None: size of the rate as commanded, where known [rad/s]; `reach`: where uniform
    rotation begins and ends [s].
    """
    start, end = reach.start, reach.end
    if "outer" in data.has:
        time, angle = line(data, run, reach)
        total = float(angle[-1] - angle[0])
        turns = np.floor(abs(total) / TURN + ROUNDED)
        # Never beyond the samples, not even for the last thousandth of a turn.
        spare = max(0.0, 0.5 * (abs(total) - turns * TURN))
        sense = np.sign(total)
        at = np.array([angle[0] + sense * spare, angle[-1] - sense * spare])
        t0, t1 = np.interp(sense * at, sense * angle, time)
        mean_rate = (at[1] - at[0]) / (t1 - t0) if turns else run.rate
        return Window(float(t0), float(t1), float(mean_rate), float(turns), abs(total) / TURN)
    speed = run.rate if rate is None else float(np.copysign(rate, run.rate))
    whole = abs(speed) * (end - start) / TURN
    # Uniform rotation may begin and end anywhere between two samples.
    between = min(2 * data.interval * abs(speed) / TURN, NEARLY)
    turns = np.floor(whole + between + 1e-9 + (NEARLY if rate is None else 0.0))
    # What is beyond the samples is a ramp, or not in the log at all.
    half = min(0.5 * turns * TURN / abs(speed), 0.5 * (end - start))
    middle = 0.5 * (start + end)
    return Window(middle - half, middle + half, speed, float(turns), whole)


def line(data: Reduced, run: Stretch, reach: Reach) -> tuple[FloatArray, FloatArray]:
    """Return the outer angle of a spin, without jumps, and its times, both shape (k,) [rad], [s].

    `reach`: where uniform rotation begins and ends, the first and last point are there [s].
    """
    cells, part = data.cells, slice(run.first, run.last)
    time = np.stack([cells.first[part], cells.last[part]], axis=1).ravel()
    angle = np.stack([cells.from_angles[part, 0], cells.to_angles[part, 0]], axis=1).ravel()
    time, once = np.unique(np.concatenate([time, reach.time]), return_index=True)
    angle = np.concatenate([angle, reach.angle])[once]
    # A rate log stands for half an interval more than its samples.
    first = angle[0] - run.rate * (time[0] - reach.start)
    last = angle[-1] + run.rate * (reach.end - time[-1])
    time = np.concatenate([[reach.start], time, [reach.end]])
    angle = np.concatenate([[first], angle, [last]])
    keep = np.append(np.diff(time) > 0, True)
    return time[keep], angle[keep]


def reaches(source: Source, data: Reduced, runs: list[Stretch]) -> list[Reach]:
    """Find to the sample where uniform rotation begins and ends.

    A spin of exactly whole turns between its ramps would lose a turn by the length of a cell.

    `source`: gives the blocks of the log [SI].
    """
    cells = data.cells
    inner = [cells_of(data, run) for run in runs]
    limits = []
    for run, reach in zip(runs, inner, strict=True):
        a, b, start, end = run.first, run.last, reach.start, reach.end
        if a > 0 and cells.label[a - 1] == cells.label[a] and not cells.broken[a]:
            start = max(float(cells.start[a - 1]), start - 2 * CELL)
        if b < len(cells) and cells.label[b] == cells.label[b - 1] and not cells.broken[b]:
            end = min(float(cells.end[b]), end + 2 * CELL)
        limits.append((start, end))
    before: list[list[Log]] = [[] for _ in runs]
    after: list[list[Log]] = [[] for _ in runs]
    for log in source():
        for k, (r, (lo, hi)) in enumerate(zip(inner, limits, strict=True)):
            for zone, kept in (((lo, r.start), before[k]), ((r.end, hi), after[k])):
                i, j = np.searchsorted(log.time, zone)
                if j > i:
                    kept.append(held(log[int(i) : int(j)]))
    each = zip(runs, inner, limits, before, after, strict=True)
    return [_reach(data, run, reach, ends, parts) for run, reach, ends, *parts in each]


def _reach(
    data: Reduced,
    run: Stretch,
    cells: Reach,
    limits: tuple[float, float],
    parts: list[list[Log]],
) -> Reach:
    """Put what is uniform before and after the cells of a spin to them."""
    ends, time, angle = [cells.start, cells.end], [np.empty(0)], [np.empty(0)]
    for k, (way, part) in enumerate(zip((-1, 1), parts, strict=True)):
        if part:
            t, a = _uniform(data, run, part, way)
            if len(t) == sum(len(p) for p in part):
                ends[k] = limits[k]  # to the end of what the last sample stands for
            elif len(t):
                ends[k] = float(t[-1])
            time, angle = [*time, t], [*angle, a]
    start, end = ends
    known = "outer" in data.has
    return Reach(start, end, *(np.concatenate(x) if known else np.empty(0) for x in (time, angle)))


def _uniform(
    data: Reduced, run: Stretch, parts: list[Log], way: int
) -> tuple[FloatArray, FloatArray]:
    """Return times and outer angles beyond the cells of a spin, as far as they are uniform."""
    time = np.concatenate([p.time for p in parts])[::way]
    tables = [p.table for p in parts if p.table is not None]
    outer = np.concatenate([t.angles[:, 0] for t in tables])[::way] if tables else np.empty(0)
    known, end = cells_of(data, run), 0 if way < 0 else -1
    uniform = np.zeros(len(time))
    if "outer" in data.has:
        at, angle = line(data, run, known)
        uniform = angle[end] + run.rate * (time - at[end])
    if len(outer) and np.isfinite(outer).all():
        off, allowed = np.angle(np.exp(1j * (outer - uniform))), np.full(len(time), OFF_LINE)
    else:
        off, allowed = _turned_more(data, run, parts, way)
    bad = np.flatnonzero(np.abs(off) > allowed)
    good = int(bad[0]) if len(bad) else len(time)
    return time[:good], (uniform + off)[:good]


def _turned_more(
    data: Reduced, run: Stretch, parts: list[Log], way: int
) -> tuple[FloatArray, FloatArray]:
    """Return the angle turned beyond that of uniform rotation, and how much noise makes of it."""
    least = OFF_GYRO
    if "outer" in data.has:
        rates = [p.table.rate for p in parts if p.table is not None and p.table.rate is not None]
        rate, sd, usual, least = np.concatenate(rates), 0.0, run.rate, OFF_LINE
    else:
        w = mean(data.cells, data.cells.gyro, run)
        usual = float(np.linalg.norm(w))
        rate = np.concatenate([p.gyro for p in parts if p.gyro is not None]) @ (w / usual)
        variance = data.cells.gyro_var[run.first : run.last].sum(axis=1)
        sd = float(np.sqrt(np.median(variance)))
    # The first sample stands for the half interval to the cells, and half of the next.
    off = way * np.cumsum(rate[::way] - usual) * data.interval
    count = np.arange(1, len(off) + 1)
    return off, least + 4 * sd * np.sqrt(count) * data.interval
