"""A first look at a log: its rate, gaps, readings, noise and rests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.diagnose.rests import Rests, find_rests, measure_noise, rest_table
from foucault.diagnose.spikes import without_spikes
from foucault.errors import Finding
from foucault.tables import AXES, Log

FloatArray = npt.NDArray[np.float64]

STEADY = np.radians(1.0)
"""A quiet time that turns faster than the rests is a turn; drift and Earth are slower [rad/s]."""


@dataclass(frozen=True)
class Axes:
    """Readings of one triad, each shape (3,) [unit of the triad].

    Attributes
    ----------
    mean, sd, lowest, highest : ndarray, shape (3,)
        Over the whole log [unit].
    noise : ndarray, shape (3,)
        White noise at rest, NaN where there is no rest [unit/sqrt(Hz)].
    """

    mean: FloatArray
    sd: FloatArray
    lowest: FloatArray
    highest: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class Inspection:
    """What a log looks like before anything is estimated from it.

    Attributes
    ----------
    log : Log
        The log [SI].
    rests : Rests
        Where the instrument did not move.
    rest_rows : dict of str to ndarray
        first, last, start, end and means of `tables.RESTS`, shape (rests,) each [SI].
    accel, gyro : Axes or None
        Readings [m/s^2], [rad/s].
    shortest, longest : float
        Extremes of the sample interval [s].
    gaps : int, shape ()
        Intervals longer than one and a half nominal ones [1].
    turning : ndarray of bool, shape (rests,)
        Which of the quiet times are turns at a constant rate.
    """

    log: Log
    rests: Rests
    rest_rows: dict[str, npt.NDArray[np.generic]]
    accel: Axes | None
    gyro: Axes | None
    shortest: float
    longest: float
    gaps: int
    turning: npt.NDArray[np.bool_]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed while reading and while looking for rests."""
        return (*self.log.findings, *self.rests.findings)


def inspect(log: Log) -> Inspection:
    """Look at a log.

    Parameters
    ----------
    log : Log
        Readings [SI].
    """
    if log.averaged is not None:
        return _means(log)
    log = without_spikes(log)
    rests = find_rests(log)
    rows = rest_table(log, rests)
    turning = turns_among(log, rests, rows)
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
        gaps=int(np.count_nonzero(step > 1.5 * log.interval)),
        turning=turning,
    )


def _means(log: Log) -> Inspection:
    """Look at a log whose rows are means: nothing moves in a row, and no noise is seen."""
    n = len(log)
    rows, level = np.arange(n, dtype=np.int64), np.full(n, np.nan)
    rests = Rests(rows, rows + 1, level, level, level, float("nan"), 1)
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
        turning=turns_among(log, rests, table),
    )


def turns_among(
    log: Log, rests: Rests, rows: dict[str, npt.NDArray[np.generic]]
) -> npt.NDArray[np.bool_]:
    """Tell which quiet times are turns at a constant rate, shape (n,).

    Parameters
    ----------
    log : Log
        Readings; the rate of a table counts before that of the gyros [SI].
    rests : Rests
        The quiet times.
    rows : dict of str to ndarray, each shape (n,)
        Their means, as `rest_table` has them [SI].
    """
    n = len(rests)
    told = None if log.table is None else log.table.rate
    if told is not None and np.isfinite(told).any():
        spans = zip(rests.first, rests.last, strict=True)
        rate = np.array([abs(float(np.mean(told[a:b]))) for a, b in spans])
        return np.asarray(np.nan_to_num(rate) > STEADY / 10)
    if log.gyro is None or n < 2:
        return np.zeros(n, bool)
    mean = np.stack([np.asarray(rows[f"gyro_{a}"], float) for a in AXES], axis=1)
    # Rests have the same rate, their bias; turns go about many axes. Take the densest of all,
    # and of those that are as dense the slowest.
    apart = np.linalg.norm(mean[:, None] - mean, axis=2)
    alike = np.sum(apart <= STEADY, axis=1)
    near = np.flatnonzero(alike >= 0.7 * alike.max())
    centre = near[np.argmin(np.linalg.norm(mean[near], axis=1))]
    return np.asarray(apart[centre] > STEADY)


def _axes(x: FloatArray | None, interval: float, rests: Rests, counts: bool) -> Axes | None:
    if x is None:
        return None
    noise = (
        np.sqrt(measure_noise(x, interval, rests, increments=counts).psd)
        if len(rests)
        else np.full(3, np.nan)
    )
    return Axes(x.mean(axis=0), x.std(axis=0), x.min(axis=0), x.max(axis=0), noise)
