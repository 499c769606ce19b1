"""What the sizes of the readings of a north seeker say about the units declared for them.

What the index angle changes in the readings is what is measured: at most the Earth's rate for the
gyro, at most gravity for an accelerometer. Biases that stay the same do not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.logs.layout import COUNTS
from foucault.models.earth import EARTH_RATE
from foucault.tables import IndexedLog
from foucault.units import STANDARD_GRAVITY, factor, plain

if TYPE_CHECKING:
    from foucault.logs.indexed_description import IndexedDescription

RATES = ("deg/h", "deg/s", "rad/s", "mrad/s", "arcsec/s")
"""Units people log slow rates in; arcsec/s and deg/h are the same."""

FORCES = ("m/s^2", "g", "mg")

FEW = 4
"""Fewer rows may well read the same [1]."""

ROUND = np.radians(15.0)
"""Base stops are usually at multiples of this [rad]."""


def implausible(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    """Return what the sizes of the numbers in `log` say about the units declared in `used`."""
    index = _index(log, used)
    return (*_stuck(log), *(index or (*_gyro(log, used), *_accel(log, used))))


def _stuck(log: IndexedLog) -> tuple[Finding, ...]:
    """Tell a sensor that turns with the base and reads one value at every stop."""
    turning = {"gyro": log.gyro}
    if log.accel is not None and log.accel.shape[1] == 1:
        turning["accel"] = log.accel[:, 0]
    if len(log.gyro) < FEW or np.ptp(log.index) == 0:
        return ()
    last = f"{float(log.time[-1] - log.time[0]):.9g}"
    return tuple(
        finding("log.stuck", triad=name, axis="column", start="0", end=last)
        for name, x in turning.items()
        if np.ptp(x) == 0
    )


def _index(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    """Tell degrees read as radians and the reverse: stops are at round angles in one of them."""
    said = log.index / used.index.one()
    for unit, likely, one in (("deg", "rad", 1.0), ("rad", "deg", np.radians(1.0))):
        if used.index.unit != unit:
            continue
        shift = said - said[0]
        near = np.abs(shift * one / ROUND - np.rint(shift * one / ROUND)) < 0.01
        same = np.abs(log.index - log.index[0]) < np.radians(0.1)
        covers = float(np.ptp(shift) * one)
        whole = covers < 2.1 * np.pi if unit == "deg" else covers > ROUND / 2
        round_as_read = np.abs(np.sin(12 * (log.index - log.index[0]))) < 0.05
        if whole and np.mean(near) > 0.9 and not same.all() and np.mean(round_as_read) < 0.9:
            seen = f"they reach from {said.min():.4g} to {said.max():.4g}"
            return (finding("north.index_unit", unit=unit, seen=seen, likely=likely),)
    return ()


def _swing(log: IndexedLog, x: FloatArray) -> tuple[float, float]:
    """Return the largest half-swing of `x` over the index angles of a set-up, and its sd."""
    best = (0.0, np.inf)
    for number in range(len(log.names)):
        lo, hi = np.searchsorted(log.setup, [number, number + 1])
        angle, y = log.index[lo:hi], x[lo:hi]
        A = np.column_stack([np.ones(hi - lo), np.cos(angle), np.sin(angle)])
        fit, _, rank, _ = np.linalg.lstsq(A, y, rcond=1e-6)
        if rank < 2:  # one stop: nothing but the offset
            continue
        left = y - A @ fit
        sd = float(np.sqrt(left @ left / max(hi - lo - rank, 1) * 2 / (hi - lo)))
        best = max(best, (float(np.hypot(*fit[1:])), sd))
    return best


def _gyro(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    size, sd = _swing(log, log.gyro)
    small = 0.003 * EARTH_RATE > size > 10 * sd
    if not small and not (size > 1.5 * EARTH_RATE and size > 10 * sd):
        return ()
    unit = used.gyro.unit
    likely = [
        other
        for other in RATES[:4]
        if unit not in COUNTS
        and 0.05 * EARTH_RATE
        < size / used.gyro.conversion()[1][0] * factor(other, "angular rate")
        < 1.1 * EARTH_RATE
    ]
    if small and not likely:  # near a pole, or a gyro that was not turned
        return ()
    if likely:
        cure = f'The unit is probably wrong; write unit = "{likely[0]}" in [log.gyro].'
    else:
        cure = "Check unit, scale and column in [log.gyro]."
    rate = plain(np.degrees(size) * 3600)
    return (finding("north.gyro_unit", size=rate, unit=unit, cure=cure),)


def _accel(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    if log.accel is None or used.accel is None:
        return ()
    if log.accel.shape[1] == 2:
        size = float(np.quantile(np.hypot(*log.accel.T), 0.9))
    else:
        size = _swing(log, log.accel[:, 0])[0]
    if size <= 1.05 * STANDARD_GRAVITY:
        return ()
    unit = used.accel.unit
    raw = size / abs(float(used.accel.conversion()[1][0]))
    likely = [u for u in FORCES if unit not in COUNTS and u != unit
              and raw * factor(u, "specific force") <= STANDARD_GRAVITY]  # fmt: skip
    if likely:
        cure = f'The unit is probably wrong; write unit = "{likely[0]}" in [log.accel].'
    else:
        cure = "Check unit, scale, zero and columns in [log.accel]."
    return (
        finding("north.accel_unit", size=f"{size / STANDARD_GRAVITY:.4g}", unit=unit, cure=cure),
    )
