"""From a log taken on a table to its readings: one mean per rest, one per spin.

A log may tell its positions itself (rows that are means, or a column with their numbers), or the
angles of the table, or nothing at all: then the instrument says when it stood still and when it
turned steadily about the vertical. Only what passes by in cells of a quarter of a second is kept,
so that a log on disk of any length takes the memory of its cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.positions import match as position_match
from foucault.diagnose.positions.averaged import averaged_readings
from foucault.diagnose.positions.cells import Reduced, Source, reduce
from foucault.diagnose.positions.choice import Choice, choose
from foucault.diagnose.positions.means import means
from foucault.diagnose.positions.moving import moving
from foucault.diagnose.positions.noise import Glimpses, covariance
from foucault.diagnose.positions.stretches import Stretch
from foucault.diagnose.positions.turns import Window
from foucault.diagnose.spikes import without_spikes
from foucault.errors import error
from foucault.models.noise import ImuNoise
from foucault.models.readings import Readings
from foucault.models.turntable import TablePlan
from foucault.tables import Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription
    from foucault.logs.raw import Progress

BLOCK = 1 << 16
"""Rows that are worked on at once [1]."""


def find_readings(
    log: Log,
    *,
    plan: TablePlan | None = None,
    noise: ImuNoise | None = None,
    spin_rate: float | None = None,
    shortest: float = 1.0,
) -> Readings:
    """Find the rests and spins of a log and average over them.

    `log`: readings with accelerometers, gyros or both, rows that are means already are taken as
    they are [SI]; `plan` or None: what the table was told to do, where known: gives rates, and
    angles that the log has not; `noise`: noise of the instrument, None measures it in the log
    [SI]; `spin_rate` or None: size of the rate of all spins, where there is no plan [rad/s];
    `shortest`: shortest time that counts as a rest [s]. Returns in the order of the log; its
    findings do not repeat those of the log [SI]. Raises no rest and no spin, a spin in both
    senses or of less than a turn, rates that cannot be.
    """
    _finite(log)
    if log.averaged is not None:
        found = averaged_readings(log, commanded_rates(plan, spin_rate))
        found = _matched(found, plan, log.gyro is not None or _told(log), _told(log))
        return found.with_noise(noise) if noise is not None else found
    return _found(partial(_slices, log), plan, noise, spin_rate, shortest)


def stream_readings(
    description: LogDescription,
    folder: str | Path = ".",
    *,
    plan: TablePlan | None = None,
    noise: ImuNoise | None = None,
    spin_rate: float | None = None,
    shortest: float = 1.0,
    progress: Progress | None = None,
) -> Readings:
    """Find the rests and spins of a log on disk without holding more than a part of it.

    `plan` or None: what the table was told to do, where known; `noise`: noise of the instrument,
    None measures it in the log [SI]; `spin_rate` or None: size of the rate of all spins, where
    there is no plan [rad/s]; `shortest`: shortest time that counts as a rest [s]; `progress` or
    None: called with the fraction done, from 0 to 1. Returns as `find_readings` of the whole log
    gives them; its findings begin with those of the log.
    """
    from foucault.logs import streaming
    from foucault.logs.reading import read

    if next(streaming.blocks(description, folder)).averaged is not None:
        log = read(description, folder, progress)
        found = find_readings(log, plan=plan, noise=noise, spin_rate=spin_rate)
        return replace(found, findings=log.findings + found.findings)
    passes = count()

    def source() -> Iterator[Log]:
        k = next(passes)  # three passes at most: cells, ends of spins, means
        told = progress and (lambda done: progress(min(1.0, (k + done) / 3)))
        return streaming.blocks(description, folder, told)

    return _found(source, plan, noise, spin_rate, shortest, tell=True)


def _slices(log: Log) -> Iterator[Log]:
    for start in range(0, len(log), BLOCK):
        yield log[start : start + BLOCK]


def _finite(log: Log) -> None:
    for what in ("accel", "gyro"):
        x = getattr(log, what)
        if x is None:
            continue
        bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
        if len(bad):
            raise error("session.not_finite", what=what, index=int(bad[0]))


def _told(log: Log) -> bool:
    """Tell whether the table says what is a spin."""
    return log.table is not None and log.table.rate is not None


def _found(
    source: Source,
    plan: TablePlan | None,
    noise: ImuNoise | None,
    spin_rate: float | None,
    shortest: float,
    tell: bool = False,
) -> Readings:
    from foucault.logs.streaming import merged

    def cleaned() -> Iterator[Log]:
        return map(without_spikes, source())

    data = reduce(cleaned)
    # Of a log that is held in memory the rest has been told already.
    told = [f for f in merged(data.findings) if tell or f.code == "log.spikes"]
    choice = choose(cleaned, data, commanded_rates(plan, spin_rate), shortest)
    told += choice.findings
    if not choice.runs:
        lost = "".join(f" {f.message}" for f in choice.findings if f.code == "spin.unused")
        raise error("positions.none", shortest=f"{shortest:g}", lost=lost)
    found, change = _averaged(cleaned, data, choice)
    told += moving(found, change, data)
    found = replace(found, findings=tuple(told))
    known, by_table = bool({"gyro", "outer"} & data.has), "outer" in data.has
    found = _matched(found, plan, known, by_table, choice.pauses)
    return found.with_noise(noise) if noise is not None else found


def commanded_rates(plan: TablePlan | None, spin_rate: float | None) -> FloatArray:
    """Return the sizes of the rates that the table was told to turn at, shape (k,) [rad/s].

    `plan` or None: what the table was told to do; `spin_rate` or None: size of the rate of all
    spins [rad/s].
    """
    if spin_rate is not None:
        return np.array([abs(spin_rate)])
    return np.unique(np.abs(plan.rate[plan.rate != 0])) if plan is not None else np.empty(0)


def _averaged(
    source: Source, data: Reduced, choice: Choice
) -> tuple[Readings, dict[str, FloatArray]]:
    """Average over the windows; also tell by how much the second half differs from the first."""
    windows = choice.windows
    seen = Glimpses(windows)
    ends = np.array([[w.start, 0.5 * (w.start + w.end), w.end] for w in windows])
    halves = np.stack([ends[:, :2], ends[:, 1:]], axis=1).reshape(-1, 2)
    found = means(source, halves, data.interval, seen.see)
    both = dict(zip(("accel", "gyro"), found, strict=True))
    mean = {k: None if x is None else 0.5 * (x[::2] + x[1::2]) for k, x in both.items()}
    noise = {
        name: np.zeros((len(windows), 3, 3))
        if mean[name] is None
        else covariance(name, data, choice.runs, windows, seen)
        for name in mean
    }
    readings = Readings(
        np.array([_angles(data, *each) for each in zip(choice.runs, windows, strict=True)]),
        np.array([w.rate for w in windows]),
        np.array([w.turns for w in windows]),
        ends[:, 0], ends[:, 2] - ends[:, 0],
        mean["accel"], mean["gyro"], noise["accel"], noise["gyro"], data.interval,
        data.increments,
    )  # fmt: skip
    return readings, {k: x[1::2] - x[::2] for k, x in both.items() if x is not None}


def _angles(data: Reduced, run: Stretch, window: Window) -> FloatArray:
    """Return the angles of the table at the start of a reading, as it says them, shape (3,)."""
    cells, part = data.cells, slice(run.first, run.last)
    out = cells.from_angles[part].mean(axis=0)
    if window.rate != 0:
        at = np.searchsorted(cells.first[part], window.start, side="right") - 1
        k = run.first + max(int(at), 0)
        out[0] = cells.from_angles[k, 0] + window.rate * (window.start - cells.first[k])
    out[0] += cells.wraps[run.first if window.rate == 0 else k]
    return np.asarray(out)


def _matched(
    readings: Readings,
    plan: TablePlan | None,
    known: bool,
    told: bool,
    pauses: npt.NDArray[np.bool_] | None = None,
) -> Readings:
    """Fill in from the plan what the log does not say: angles, and the rate of spins."""
    if plan is None:
        return readings
    match = position_match.with_plan(readings, plan, known)
    if not position_match.fits(match, len(plan)):  # what was done is not what was planned
        return readings
    row = match.row
    if pauses is not None:  # a pause before a spin is no position that was repeated
        keep = (row >= 0) | ~pauses
        readings, row = readings[keep], row[keep]
    some = row >= 0
    angles, rate, turns = readings.angles.copy(), readings.rate.copy(), readings.turns
    angles[some] = np.where(np.isnan(angles[some]), plan.angles[row[some]], angles[some])
    if not told:
        rate[some] = plan.rate[row[some]]
        turns = np.where(known, turns, np.abs(rate) * readings.time / (2 * np.pi))
    return replace(readings, angles=angles, rate=rate, turns=turns)
