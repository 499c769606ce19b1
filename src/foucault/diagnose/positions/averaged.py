"""A log whose rows are means over positions: every row is a reading."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.positions.choice import nearest, rate_problem
from foucault.diagnose.positions.rates import spin_rates
from foucault.errors import Finding, error, finding
from foucault.models.readings import Readings
from foucault.tables import Log

UNKNOWN_ACCEL = 1e-6
"""Standard deviation of a mean whose noise nobody knows: readings weigh alike, and their scatter,
which is estimated, must be larger than this [m/s^2]."""

UNKNOWN_GYRO = 1e-9
"""The same for the gyros [rad/s]."""

MOST = 12
"""So many spins are listed [1]."""

WHOLE = 0.01
"""Turns that are less than this from whole are whole [1]."""


def averaged_readings(log: Log, commanded: FloatArray) -> Readings:
    """Take each row of a log for a reading.

    `log`: means [SI]; `commanded` (k,): sizes of the rates that the table was told, empty where
    unknown [rad/s].
    """
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
    rows = ", ".join(f"{number[i]} ({turns[i]:.2f} turns)" for i in some[:MOST])
    rows += f" and {len(some) - MOST} more" if len(some) > MOST else ""
    if len(some) == spin.sum():
        rows = f"all {len(some)} ({turns[some].min():.2f} to {turns[some].max():.2f} turns)"
    return [finding("spin.not_whole", rows=rows, left=f"{left:.2g}")]
