"""A first look at a log: its rate, gaps, readings, noise and rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.diagnose.rests import Rests, find_rests, measure_noise, rest_table
from foucault.errors import Finding
from foucault.tables import Log

FloatArray = npt.NDArray[np.float64]


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
    """

    log: Log
    rests: Rests
    rest_rows: dict[str, npt.NDArray[np.generic]]
    accel: Axes | None
    gyro: Axes | None
    shortest: float
    longest: float
    gaps: int

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
    rests = find_rests(log)
    step = np.diff(log.time)
    return Inspection(
        log=log,
        rests=rests,
        rest_rows=rest_table(log, rests),
        accel=_axes(log.accel, log.interval, rests),
        gyro=_axes(log.gyro, log.interval, rests),
        shortest=float(step.min(initial=np.inf)),
        longest=float(step.max(initial=0.0)),
        gaps=int(np.count_nonzero(step > 1.5 * log.interval)),
    )


def _axes(x: FloatArray | None, interval: float, rests: Rests) -> Axes | None:
    if x is None:
        return None
    noise = np.sqrt(measure_noise(x, interval, rests).psd) if len(rests) else np.full(3, np.nan)
    return Axes(x.mean(axis=0), x.std(axis=0), x.min(axis=0), x.max(axis=0), noise)
