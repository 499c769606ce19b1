"""What explains a specific force at rest that is not gravity: units, or increments and rates."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error
from foucault.units import STANDARD_GRAVITY

GRAVITY_BAND = 1.25
"""The mean specific force is gravity within this factor, whatever the calibration [1]."""


ALIKE = 1.05
"""Magnitudes within this factor are one, whatever the calibration [1]."""


def one_axis_off(mean: FloatArray, gravity: float) -> tuple[int, float] | None:
    """Return the one accelerometer whose unit explains why some rests do not read gravity.

    Where one column is in another unit, ``sum (s_i f_i)^2 = g^2`` holds in all rests with its
    factor, and without it in those alone in which its axis is level.

    `mean` (n, 3): mean specific force of each rest [m/s^2]; `gravity`: local gravity [m/s^2].
    Returns its axis, and what its readings are over what they should be [1]; None where all are
    alike or no such factor explains it.
    """
    size = np.linalg.norm(mean, axis=1)
    if len(mean) < 3 or size.max() < ALIKE * size.min():
        return None
    for axis in range(3):
        for factor in (STANDARD_GRAVITY, 1 / STANDARD_GRAVITY):
            right = mean.copy()
            right[:, axis] /= factor
            size = np.linalg.norm(right, axis=1)
            if size.max() < ALIKE * size.min() and 1 / ALIKE < size.mean() / gravity < ALIKE:
                return axis, factor
    return None


def wrong_force(
    seen: float, gravity: float, interval: float, band: float = GRAVITY_BAND
) -> FoucaultError | None:
    """Return what explains a specific force at rest that is not gravity by far.

    `seen`: its magnitude [m/s^2]; `gravity`: local gravity [m/s^2]; `interval`: usual interval
    between samples [s]; `band`: it is gravity within this factor, wider where the instrument
    moves [1]. Returns None where it is gravity but for errors of accelerometers.
    """
    ratio = seen / gravity
    if 1 / band < ratio < band:
        return None
    causes = {
        interval: "increments were declared as rates",
        1 / interval: "rates were declared as increments",
        1 / STANDARD_GRAVITY: "the unit is g and was declared as m/s^2",
        STANDARD_GRAVITY: "the unit is m/s^2 and was declared as g",
    }
    near = min(causes, key=lambda r: abs(np.log(max(ratio, 1e-300) / r)))
    known = 1 / GRAVITY_BAND < ratio / near < GRAVITY_BAND
    return error("alignment.force", given=f"{seen:.4g}", ratio=f"{ratio:.4g}",
                 cause=causes[near] if known else "no usual mistake makes this")  # fmt: skip
