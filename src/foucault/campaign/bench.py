"""Means of many instruments in one file, taken as columns: no log and no folder of each.

The first instrument is read alone, as `fleet` reads all. Those whose rows say the same of the table
to the last bit, and whose sensors read nearly the same in every row, are arranged as it was; the
first of those left is read alone next. What is told of each in the table is what `fleet` tells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IndexArray, IntArray
from foucault.errors import FoucaultError
from foucault.logs.reading import ManyLogs
from foucault.models.noise import Readings
from foucault.tables import Log

NEAR = np.radians(10.0)
"""Directions of specific force within this are those of one attitude: positions are 20 deg apart
and more, and biases of 50 mg turn two by six. Rates of spins within twice this [rad]."""

LIKE = 0.25
"""Sizes within this of each other are of one unit; at rest a gyro reads less of the rate [1]."""

PATTERNS = 20  # So many instruments are looked at for others that are like them [1].

Alone = Callable[[str, "Log | FoucaultError"], "Readings | FoucaultError"]
"""Serial number and log -> its readings in the order of the plan, or why there are none."""


@dataclass
class Arranged:
    """Instruments of a bench by number, those that can be solved and those that cannot."""

    readings: dict[int, Readings] = field(default_factory=dict)  # number -> readings [SI]
    problems: dict[int, FoucaultError] = field(default_factory=dict)  # number [1] -> why none


def arranged(many: ManyLogs, alone: Alone) -> Arranged:
    """Return the readings of all instruments.

    `many`: their rows, of means with the table's rate [SI]; `alone`: reads one of them by itself.
    """
    out, waiting = Arranged(), np.arange(len(many.names))
    tried = 0
    while len(waiting):
        i = int(waiting[0])
        found = alone(many.names[i], many.log(i))
        like = waiting[:1]
        if isinstance(found, FoucaultError):
            out.problems[i] = found
        else:
            out.readings[i] = found
            if tried < PATTERNS and (order := _order(many, i, found)) is not None:
                like = _like(many, i, waiting, found, order)
                for k in like.tolist():
                    rows = many.first[k] + order
                    time, accel, gyro = (many.data[n][rows] for n in ("time", "accel", "gyro"))
                    out.readings[k] = replace(found, start=time, accel=accel, gyro=gyro)
                tried += 1
        waiting = waiting[~np.isin(waiting, np.append(like, i))]
    return out


def _order(many: ManyLogs, i: int, found: Readings) -> IntArray | None:
    """Return which row of instrument `i` each of its readings is, None where they are not rows."""
    rows = slice(int(many.first[i]), int(many.first[i + 1]))
    if "table_rate" not in many.data or found.gyro is None or found.accel is None:
        return None
    order = np.searchsorted(many.data["time"][rows], found.start)
    order = np.minimum(order, rows.stop - rows.start - 1)
    same = all(
        np.array_equal(many.data[name][rows][order], means)
        for name, means in (("accel", found.accel), ("gyro", found.gyro))
    )
    return order if same else None


def _like(
    many: ManyLogs, i: int, waiting: IntArray, found: Readings, order: IntArray
) -> IndexArray:
    """Return those of `waiting` that are arranged as instrument `i` is."""
    count = np.diff(many.first)
    mine = waiting[count[waiting] == count[i]]
    rows = many.first[mine, None] + np.arange(count[i])
    own = slice(int(many.first[i]), int(many.first[i + 1]))
    good = np.ones(len(mine), bool)
    for name, values in many.data.items():
        if name == "time":
            steps = np.diff(values[rows], axis=1), np.diff(values[own])
            good &= (steps[0] > 0).all(axis=1)
        elif name not in ("accel", "gyro", "mag", "temperature"):
            there, here = values[rows], values[own]
            good &= ((there == here) | (np.isnan(there) & np.isnan(here))).all(axis=1)
    assert found.accel is not None and found.gyro is not None
    f, w = (many.data[name][rows][:, order] for name in ("accel", "gyro"))
    spin = found.spin
    good &= _near(f, found.accel, NEAR) & _near(w[:, spin], found.gyro[spin], 2 * NEAR)
    slowest = float(np.abs(found.rate[spin]).min(initial=np.inf))
    with np.errstate(invalid="ignore"):
        good &= np.abs(w[:, ~spin]).reshape(len(mine), -1).max(axis=1) < LIKE * slowest
    return np.asarray(mine[good])


def _near(x: FloatArray, like: FloatArray, angle: float) -> BoolArray:
    """Tell which of `x` (N, n, 3) have the directions and about the sizes of `like` (n, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        size, wanted = np.linalg.norm(x, axis=2), np.linalg.norm(like, axis=1)
        cosine = np.einsum("kni,ni->kn", x, like) / (size * wanted)
        good = (cosine > np.cos(angle)) & (np.abs(size / wanted - 1.0) < LIKE)
    return np.asarray(good.all(axis=1))
