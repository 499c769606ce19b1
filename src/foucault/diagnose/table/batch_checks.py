"""Checks of an instrument that was solved in a batch: its residuals against those of the fleet."""

from __future__ import annotations

import numpy as np

from foucault.diagnose.table.checks import LARGE, UNITS
from foucault.estimate.table.fit import ENOUGH
from foucault.result import Check, Level
from foucault.units import plain

TRIADS = ("accel", "gyro")
_RESIDUALS = ("specific force at rest", "angular rate in spins")
_SCATTER = ("specific force", "rate")


def explained(
    triad: int, chi_square: float, high: float, redundancy: float, shared: float | None
) -> Check:
    """Check that the residuals of an instrument are like those of the fleet.

    `triad`: 0 for the accelerometers, 1 for the gyros [1]; `chi_square`: sum of squared residuals
    over their variances [1]; `high`: largest that chance explains [1]; `redundancy`: redundant
    readings of the instrument [1]; `shared` or None: redundant readings of the whole fleet, where
    the noise is known from nothing else [1].
    """
    what = _RESIDUALS[triad]
    name = f"noise of {what}"
    if shared is not None and shared < ENOUGH:
        words = (
            f"The noise of the {what} is unknown, and in the whole fleet only {shared:.0f} "
            f"readings are redundant: the uncertainties mean little. Declare [noise]."
        )
        return Check(name, shared, ENOUGH, None, False, words)
    if redundancy < 0.5:
        words = f"Nothing tests the noise of the {what}: no reading is redundant."
        return Check(name, float("nan"), None, None, True, words)
    ratio, fine = np.sqrt(chi_square / redundancy), chi_square <= high
    words = (
        f"The residuals of {what} are {ratio:.2f} times those of the fleet "
        f"({redundancy:.0f} redundant)"
    )
    words += (
        "."
        if fine
        else ": a reading is wrong, or the instrument is noisier than the others; the "
        "uncertainties include it. Calibrate it alone to have a wrong reading named."
    )
    return Check(name, chi_square, None, high, bool(fine), words)


def scatter(triad: int, sd: float) -> Check:
    """Check that the readings belong together at all.

    `triad`: 0 for the accelerometers, 1 for the gyros [1]; `sd`: scatter of the readings about
    the model, per axis [SI].
    """
    kind, what = TRIADS[triad], _SCATTER[triad]
    scale, unit = UNITS[kind]
    size, limit = sd * scale, LARGE[kind] * scale
    fine = size <= limit
    words = f"The {what} scatters by {plain(size, 3)} {unit} from one reading to the next"
    words += (
        "."
        if fine
        else f", more than {plain(limit, 3)} {unit}: the table moved, or the readings do "
        "not belong together."
    )
    return Check(f"scatter of {what}", size, None, limit, fine, words, Level.UNUSABLE)
