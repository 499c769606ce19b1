"""Rests that were not quite rests: the instrument was still settling or turning.

A rest is compared with the other rests of the log, so that what all of them share, such as a bias
that drifts, is no motion.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.positions.cells import Reduced
from foucault.diagnose.positions.shaken import rounding
from foucault.errors import Finding, finding
from foucault.models.readings import Readings
from foucault.units import plain

BEYOND_OTHERS = 8.0
"""A change that is so many times that of the other rests is motion [1]."""

LEAST_TURN = np.radians(0.02)
"""Least rate that is called motion; the Earth turns at 0.004 deg/s [rad/s]."""

LEAST_TILT = 2e-5
"""Least change of the direction of gravity over a rest that is called motion [rad]."""


def moving(readings: Readings, change: dict[str, FloatArray], data: Reduced) -> list[Finding]:
    """Name the rests in which the instrument moved.

    `readings`: means [SI]; `change` (n, 3): mean of the second half of each reading less that of
    the first, accel and gyro [SI].
    """
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
        label = _label(data, readings.start[k])
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


def _label(data: Reduced, start: float) -> int:
    cells = data.cells
    k = int(np.searchsorted(cells.start, start + 1e-9, side="right")) - 1
    return int(cells.label[max(k, 0)])
