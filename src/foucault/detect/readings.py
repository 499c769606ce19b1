"""From a log taken on a table to its readings: one mean per rest, one per spin.

A log may tell its positions itself (rows that are means, or a column with their numbers), or the
angles of the table, or nothing at all: then the instrument says when it stood still and when it
turned steadily about the vertical. Only what passes by in cells of a quarter of a second is kept,
so that a log on disk of any length takes the memory of its cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect import match as position_match
from foucault.detect.cells import Reduced, Source, reduce
from foucault.detect.means import Glimpses, covariance, means
from foucault.detect.noise import without_spikes
from foucault.detect.spins import Choice, Window, choose, nearest, rate_problem
from foucault.detect.stretches import TABLE, require_finite
from foucault.detect.table import Stretch, rounding, spin_rates
from foucault.errors import Finding, error, finding, listed
from foucault.models.noise import ImuNoise, Readings
from foucault.models.turntable import TablePlan
from foucault.tables import Log
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription
    from foucault.logs.raw import Progress

BLOCK = 1 << 16  # Rows that are worked on at once [1].
BEYOND_OTHERS = 8.0  # A change that is so many times that of the other rests is motion [1].

LEAST_TURN = np.radians(0.02)
"""Least rate that is called motion; the Earth turns at 0.004 deg/s [rad/s]."""

LEAST_TILT = 2e-5
"""Least change of the direction of gravity over a rest that is called motion [rad]."""

UNKNOWN_ACCEL = 1e-6
"""Standard deviation of a mean whose noise nobody knows: readings weigh alike, and their scatter,
which is estimated, must be larger than this [m/s^2]."""

UNKNOWN_GYRO = 1e-9  # The same for the gyros [rad/s].
MOST = 12  # So many spins are listed [1].
WHOLE = 0.01  # Turns that are less than this from whole are whole [1].


def find_readings(
    log: Log,
    *,
    plan: TablePlan | None = None,
    noise: ImuNoise | None = None,
    spin_rate: float | None = None,
    shortest: float = TABLE.shortest,
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
    require_finite(log)
    if log.averaged is not None:
        found = averaged_readings(log, commanded_rates(plan, spin_rate))
        told = log.table is not None and log.table.rate is not None
        found = _matched(found, plan, log.gyro is not None or told, told)
        return found.with_noise(noise) if noise is not None else found

    def slices() -> Iterator[Log]:
        return (log[start : start + BLOCK] for start in range(0, len(log), BLOCK))

    return _found(slices, plan, noise, spin_rate, shortest)


def stream_readings(
    description: LogDescription,
    folder: str | Path = ".",
    *,
    plan: TablePlan | None = None,
    noise: ImuNoise | None = None,
    shortest: float = TABLE.shortest,
    progress: Progress | None = None,
) -> Readings:
    """Find the rests and spins of a log on disk without holding more than a part of it.

    `plan` or None: what the table was told to do, where known; `noise`: noise of the instrument,
    None measures it in the log [SI]; `shortest`: shortest time that counts as a rest [s];
    `progress` or None: called with the fraction done, from 0 to 1. Returns as `find_readings` of
    the whole log gives them; its findings begin with those of the log.
    """
    from foucault.logs import follow
    from foucault.logs.reading import read

    if next(follow.blocks(description, folder)).averaged is not None:
        log = read(description, folder, progress)
        found = find_readings(log, plan=plan, noise=noise)
        return replace(found, findings=log.findings + found.findings)
    passes = count()

    def source() -> Iterator[Log]:
        k = next(passes)  # three passes at most: cells, ends of spins, means
        told = progress and (lambda done: progress(min(1.0, (k + done) / 3)))
        return follow.blocks(description, folder, told)

    return _found(source, plan, noise, None, shortest, tell=True)


def _found(
    source: Source,
    plan: TablePlan | None,
    noise: ImuNoise | None,
    spin_rate: float | None,
    shortest: float,
    tell: bool = False,
) -> Readings:
    from foucault.logs.follow import merged

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
    """Return the sizes of rates of a plan, or `spin_rate`, shape (k,) [rad/s]."""
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
    pauses: BoolArray | None = None,
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


# -- rests that were not quite rests ---------------------------------------------------------------


def moving(readings: Readings, change: dict[str, FloatArray], data: Reduced) -> list[Finding]:
    """Name the rests that moved; `change` (n, 3): mean of second half less that of first [SI]."""
    rest = np.flatnonzero(~readings.spin)
    if len(rest) < 2:
        return []
    why: dict[int, str] = {}
    if "accel" in change and readings.accel is not None:
        size = float(np.median(np.linalg.norm(readings.accel, axis=1)))
        tilt = np.linalg.norm(change["accel"][rest], axis=1) / max(size, 1e-12)
        least = max(LEAST_TILT, rounding("accel", data) / max(size, 1e-12))  # of a coarse output
        for k in _odd(tilt, readings.time[rest], least):
            why[int(rest[k])] = f"tilts by {plain(np.degrees(tilt[k]) * 3600, 3)} arcsec"
    if readings.gyro is not None:
        off = np.linalg.norm(readings.gyro[rest] - np.median(readings.gyro[rest], axis=0), axis=1)
        for k in _odd(off, readings.time[rest], LEAST_TURN):
            why[int(rest[k])] = f"turns at {plain(np.degrees(off[k]), 3)} deg/s"
    zero = float(data.cells.first[0])
    out = []
    for k, words in sorted(why.items()):
        start, end = readings.start[k] - zero, readings.start[k] + readings.time[k] - zero
        cell = int(np.searchsorted(data.cells.start, readings.start[k] + 1e-9, side="right")) - 1
        label = int(data.cells.label[max(cell, 0)])
        # Rests are counted from 1, as the report does it.
        name = f"Position {label}" if label >= 0 else f"Rest {int(np.sum(rest <= k))}"
        out.append(
            finding(
                "position.not_still", position=name, start=f"{start:.1f}", end=f"{end:.1f}",
                how=words,
            )
        )  # fmt: skip
    return out


def _odd(size: FloatArray, time: FloatArray, least: float) -> FloatArray:
    # Short rests are noisier than long ones.
    alike = BEYOND_OTHERS * np.median(size * np.sqrt(time)) / np.sqrt(time)
    return np.asarray(np.flatnonzero(size > np.maximum(alike, least)))


# -- rows that are means ---------------------------------------------------------------------------


def averaged_readings(log: Log, commanded: FloatArray) -> Readings:
    """Take each row for a reading [SI], at rates `commanded` (k,), empty for unknown [rad/s]."""
    assert log.averaged is not None
    n = len(log)
    rate = _rates(log, commanded)
    told = log.table is not None and log.table.rate is not None
    turns = np.abs(rate) * log.averaged / (2 * np.pi)
    findings = _parts_of_turns(rate, turns, told or len(commanded) > 0)
    angles = np.full((n, 3), np.nan) if log.table is None else log.table.angles
    findings.append(finding("readings.noise_unknown"))
    return Readings(
        angles, rate, np.round(turns), log.time, log.averaged, log.accel, log.gyro,
        np.broadcast_to(UNKNOWN_ACCEL**2 * np.eye(3), (n, 3, 3)).copy(),
        np.broadcast_to(UNKNOWN_GYRO**2 * np.eye(3), (n, 3, 3)).copy(),
        findings=tuple(findings),
    )  # fmt: skip


def _rates(log: Log, commanded: FloatArray) -> FloatArray:
    """Return the rate of the outer axis in each row, 0 at rest."""
    assert log.averaged is not None
    if log.table is not None and log.table.rate is not None:
        rate = np.nan_to_num(log.table.rate)
        if log.gyro is not None and rate.any():
            spin = rate != 0
            size = np.linalg.norm(log.gyro[spin], axis=1)
            ratio = float(np.median(np.abs(rate[spin]) / np.maximum(size, 1e-12)))
            told, measured = float(np.median(np.abs(rate[spin]))), float(np.median(size))
            code = "table.rate_differs" if nearest(told, commanded) is None else "spin.rate"
            problem = rate_problem(code, ratio, told, measured)
            if problem is not None:
                raise problem
        return rate
    if log.gyro is None:
        return np.zeros(len(log))
    slowest = float(commanded.min()) if len(commanded) else None
    rate = spin_rates(log.gyro, log.accel, log.averaged, slowest)
    for i in np.flatnonzero(rate):
        known = nearest(rate[i], commanded)
        if known is not None:
            rate[i] = np.copysign(known, rate[i])
        elif len(commanded):
            told = float(commanded[np.argmin(np.abs(np.log(abs(rate[i]) / commanded)))])
            problem = rate_problem("spin.rate", told / abs(rate[i]), told, abs(rate[i]))
            if problem is not None:
                raise problem
    return rate


def _parts_of_turns(rate: FloatArray, turns: FloatArray, known: bool) -> list[Finding]:
    """Refuse spins of less than a turn; tell parts of turns, where the rate is known well."""
    spin = rate != 0
    short = np.flatnonzero(spin & (turns < 1 - (WHOLE if known else 0.05)))
    if len(short):
        i = int(short[0])
        raise error(
            "spin.short",
            position=f"Row {i + 1}",
            start="0",
            end="its time",
            turns=f"{turns[i]:.2f}",
        )
    part = np.abs(turns - np.round(turns))
    some = np.flatnonzero(spin & (part > WHOLE))
    if not known or not len(some):
        return []
    worst = max(some, key=lambda i: part[i] / turns[i])
    # Horizontal Earth rate at 45 deg over the part that is left: at most 2 sin(pi x) / (2 pi n).
    left = 10.6 * np.sin(np.pi * part[worst]) / (np.pi * turns[worst])
    number = np.cumsum(spin)  # spins are counted from 1, as the report does it
    rows = listed([f"{number[i]} ({turns[i]:.2f} turns)" for i in some], MOST)
    if len(some) == spin.sum():
        rows = f"all {len(some)} ({turns[some].min():.2f} to {turns[some].max():.2f} turns)"
    return [finding("spin.not_whole", rows=rows, left=f"{left:.2g}")]
