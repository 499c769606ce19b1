"""A first look at a log: its rate, gaps, readings, noise and rests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.rests import Rests, find_rests, measure_noise, rest_table
from foucault.diagnose.spikes import without_spikes
from foucault.errors import Finding
from foucault.tables import AXES, Log

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
    # first, last, start, end and means of `tables.RESTS`, shape (rests,) each [SI]
    rest_rows: dict[str, npt.NDArray[np.generic]]
    # accel, gyro: readings [m/s^2], [rad/s]
    accel: Axes | None
    gyro: Axes | None
    # shortest, longest: extremes of the sample interval [s]
    shortest: float
    longest: float
    gaps: int  # intervals longer than one and a half nominal ones [1]
    turning: npt.NDArray[np.bool_]  # (rests,) which of the quiet times are turns at a constant rate

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed while reading and while looking for rests."""
        return (*self.log.findings, *self.rests.findings)


def inspect(log: Log) -> Inspection:
    """Look at a log.

    `log`: readings [SI].
    """
    if log.averaged is not None:
        return _means(log)
    given, log = log, without_spikes(log.filled())
    rests = find_rests(log)
    rows = rest_table(log, rests)
    turning = turns_among(log, rests, rows)
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
        gaps=int(np.count_nonzero(step > 1.5 * log.interval)),
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

    `log`: readings, the rate of a table counts before that of the gyros [SI]; `rows` (n,): their
    means, as `rest_table` has them [SI].
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
