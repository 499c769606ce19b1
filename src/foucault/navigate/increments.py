"""From a log to what strapdown navigation adds up: increments of angle and of velocity.

A log of increments holds them already, as means over each interval. Of a log of instantaneous
values the integral of the cubic through four samples is taken::

    dtheta_k = dt (13 (w_k-1 + w_k) - w_k-2 - w_k+1) / 24
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding, require, require_word
from foucault.logs.checks import finite, timing
from foucault.tables import AXES, Log, whole_means
from foucault.tables import gaps as wide
from foucault.units import plain, span

SLOWEST = 1.0
"""Longest usual interval: nobody samples an instrument to be navigated more slowly [s]."""


@dataclass(frozen=True)
class Increments:
    """What the instrument added up over each interval, in body axes."""

    time: FloatArray  # (n,) end of each interval [s]
    dt: FloatArray  # (n,) its length [s]
    dtheta_b: FloatArray  # (n, 3) integral of the angular rate w_ib_b [rad]
    dvel_b: FloatArray  # (n, 3) integral of the specific force f_b [m/s]
    # (n,) whether the interval before ends where this one begins, and neither holds a gap
    joined: npt.NDArray[np.bool_]
    findings: tuple[Finding, ...] = ()  # gaps that were bridged
    # whether the instrument added them up: what rounding leaves out is in the next one
    counted: bool = False

    @classmethod
    def of(cls, time: FloatArray, dtheta_b: FloatArray, dvel_b: FloatArray) -> Increments:
        """Take increments as they are, without a gap.

        `time` (n,): end of each interval [s], the first is taken to be as long as the second;
        `dtheta_b` (n, 3): increments of angle [rad]; `dvel_b` (n, 3): increments of velocity
        [m/s].
        """
        joined = np.ones(len(time), bool)
        joined[:1] = False
        return cls(time, _lengths(time), np.ascontiguousarray(dtheta_b, float),
                   np.ascontiguousarray(dvel_b, float), joined)  # fmt: skip

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def chained(cls, parts: Sequence[Increments]) -> Increments:
        """Return recordings with times that rise as one; none goes on where another ended."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([p.time for p in parts]), np.concatenate([p.dt for p in parts]),
            np.concatenate([p.dtheta_b for p in parts]), np.concatenate([p.dvel_b for p in parts]),
            np.concatenate([p.joined for p in parts]), tuple(f for p in parts for f in p.findings),
            parts[0].counted,
        )  # fmt: skip

    def __getitem__(self, rows: slice) -> Increments:
        """Return the intervals of a slice."""
        return Increments(
            self.time[rows], self.dt[rows], self.dtheta_b[rows], self.dvel_b[rows],
            self.joined[rows], self.findings, self.counted,
        )  # fmt: skip

    @cached_property
    def bends(self) -> tuple[FloatArray, FloatArray]:
        """What the rows before and after count for in coning and sculling, see `bend_weights`."""
        return bend_weights(self.dt, self.joined)

    def row_at(self, time: float) -> int:
        """Return the row whose interval ends nearest to `time` in the log [s]."""
        k = int(np.searchsorted(self.time, time))
        if k == len(self) or (k > 0 and time - self.time[k - 1] < self.time[k] - time):
            k -= 1
        return k


def increments_of(log: Log, *, gaps: Literal["stop", "bridge"] = "stop") -> Increments:
    """Return the increments of a log.

    Parameters
    ----------
    log : Log
        Angular rate and specific force in body axes, compensated or not [SI].
    gaps : {"stop", "bridge"}
        What is done where samples are missing: an error, or the readings before and after are
        taken to hold half each of what is missing.

    Raises
    ------
    FoucaultError
        A triad is missing, the rows are means over positions, or there is a gap.

    Notes
    -----
    The first row has no interval before it; it is taken as long as the usual one. Navigation that
    starts at row 0 does not use it but for coning and sculling.
    """
    navigable(log)
    require_sound(log)
    require_word("gaps", gaps, ("stop", "bridge"))
    assert log.gyro is not None and log.accel is not None
    dt = _lengths(log.time)
    usual = log.interval
    if not usual <= SLOWEST:
        raise error("strapdown.slow", interval=span(usual), rate=plain(1 / usual))
    gap = np.concatenate([[False], wide(dt[1:])])
    found: tuple[Finding, ...] = ()
    if gap.any():
        words = _words(log.time, dt, gap, usual)
        if gaps == "stop":
            raise error("strapdown.gap", **words)
        found = (finding("strapdown.bridged", **words),)
    both = np.concatenate([log.gyro, log.accel], axis=1)
    total = _integrals(both, log.time, dt, gap, log.sampled)
    joined = ~(gap | np.roll(gap, 1))
    joined[0] = False
    return Increments(log.time, dt, total[:, :3].copy(), total[:, 3:].copy(), joined, found,
                      log.sampled == "increment")  # fmt: skip


def navigable(log: Log, fewest: int = 2) -> None:
    """Refuse a log [SI] of which no integral can be taken.

    One that lacks a triad, an axis or times, or whose rows are means or fewer than `fewest` [1];
    what may be left out of it is not looked at, see `require_sound`.
    """
    require("the log", log, Log)
    if len(log) < fewest:
        raise error("strapdown.few", rows=len(log), fewest=fewest)
    for name in ("gyro", "accel"):
        if not log.logged(name):
            raise error("strapdown.no_triad", missing=name)
        absent = [a for i, a in enumerate(AXES) if i not in log.logged(name)]
        if absent:
            raise error("strapdown.no_axis", triad=name, missing=", ".join(absent))
    if log.averaged is not None:
        raise error("strapdown.averaged")
    finite({"time": log.time}, "error", str(log.source.get("file", "the log")))


def require_sound(log: Log) -> None:
    """Refuse readings that are missing or no numbers, and a time that does not rise [SI]."""
    blocks = {name: getattr(log, name) for name in ("gyro", "accel")}
    finite(blocks, "error", str(log.source.get("file", "the log")))
    timing(log.time)


def require_readings(log: Log) -> None:
    """Refuse a triad that reads zero throughout: no instrument at rest on Earth does [SI]."""
    for name in ("gyro", "accel"):
        if not np.any(getattr(log, name)):
            raise error("strapdown.zero", triad=name)


def bend_weights(dt: FloatArray, joined: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return the weights k'/2 and -k''/2 of the rows before and after, shape (n,) each [1].

    With a rate that changes linearly over an interval and one beside it, ``dt^3 / 12 w x w'`` is
    ``k theta' x theta``, ``k = dt^2 / (6 dt' (dt + dt'))``. The mean of both sides is free of the
    error that one side has where the rate is not linear; where one is missing the other counts.

    `dt` (n,): lengths of the intervals [s]; `joined` (n,): whether each goes on where the one
    before ended.
    """
    left, right = np.zeros(len(dt)), np.zeros(len(dt))
    both = joined[1:]
    left[1:] = np.where(both, dt[1:] ** 2 / (6 * dt[:-1] * (dt[:-1] + dt[1:])), 0.0)
    right[:-1] = np.where(both, -(dt[:-1] ** 2) / (6 * dt[1:] * (dt[:-1] + dt[1:])), 0.0)
    inner = (left != 0) & (right != 0)
    left[inner] *= 0.5
    right[inner] *= 0.5
    return left, right


def _lengths(time: FloatArray) -> FloatArray:
    dt = np.diff(time, prepend=time[0])
    # Steps that differ by rounding of the time only are equal: seconds of the day have 12 digits.
    usual = (time[-1] - time[0]) / (len(time) - 1)
    even = np.abs(dt[1:] - usual) <= 8 * np.spacing(np.abs(time[-1])) + 1e-9 * usual
    dt[1:][even] = usual
    dt[0] = np.median(dt[1:])
    return dt


def _integrals(
    x: FloatArray, time: FloatArray, dt: FloatArray, gap: npt.NDArray[np.bool_], sampled: str
) -> FloatArray:
    """Integrate over each interval; of what a gap leaves out both neighbours hold half."""
    if sampled == "increment":
        mean = whole_means(time, x)
    else:
        mean = x.copy()
        mean[1:] = 0.5 * (x[:-1] + x[1:])
        # The cubic needs two intervals on either side that are whole and equally long.
        inner = slice(2, -1)
        whole = ~(gap[1:-2] | gap[2:-1] | gap[3:])
        for side in (dt[1:-2], dt[3:]):
            whole &= np.abs(side - dt[inner]) < 0.1 * dt[inner]
        cubic = (13.0 * (x[1:-2] + x[2:-1]) - x[:-3] - x[3:]) / 24.0
        mean[inner] = np.where(whole[:, None], cubic, mean[inner])
    return np.asarray(mean * dt[:, None])


def _words(
    time: FloatArray, dt: FloatArray, gap: npt.NDArray[np.bool_], usual: float
) -> dict[str, object]:
    rows = np.flatnonzero(gap)
    places = ", ".join(f"{plain(float(time[r - 1]), 8)} s" for r in rows[:3])
    return {
        "where": places + (" ..." if len(rows) > 3 else ""),
        "count": len(rows),
        "longest": span(float(dt[gap].max())),
        "usual": span(usual),
    }
