"""Does a calibration hold here: its stops, its temperature, a reference heading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.north.attitude import Fixes
from foucault.models.dwells import Dwells
from foucault.models.rotation import turned
from foucault.units import ZERO_CELSIUS

NEAR_STOP = np.radians(2.0)
"""Index angles that differ by less are the same stop [rad]."""

WARM = 5.0
"""Temperatures within so much of those of the calibration are the same [K]."""

CONTRADICTS = 4.0
"""A heading further from its reference than this contradicts it [sd]."""


def other_conditions(
    dwells: Dwells, temperature: FloatArray | None, validity: Mapping[str, Any]
) -> tuple[Finding, ...]:
    """Compare stops and temperature with those of the calibration.

    `dwells`: readings [SI]; `temperature` (n,) or None: of the instrument [K]; `validity`: what
    the result of the calibration says of itself.
    """
    found = []
    calibrated = [float(a) for a in validity.get("index") or ()]
    if calibrated:
        apart = np.abs(turned(dwells.index[:, None] - np.radians(calibrated))).min(axis=1)
        others = sorted({round(a) % 360 for a in np.degrees(dwells.index[apart > NEAR_STOP])})
        if others:
            given = "stops at " + _list(others) + " deg" if len(others) < 24 else "turned"
            found.append(finding("north.other_stops", given=given, calibrated=_list(calibrated)))
    said = validity.get("temperature")
    if said and temperature is not None:
        low, high = float(np.min(temperature)), float(np.max(temperature))
        if low < said[0] - WARM or high > said[1] + WARM:
            found.append(finding("north.other_temperature", given=_range(low, high),
                                 calibrated=_range(*said)))  # fmt: skip
    return tuple(found)


def contradicted(
    dwells: Dwells, fixes: Fixes, heading_sd: float
) -> tuple[tuple[Finding, ...], ...]:
    """Compare every heading with the reference in the file, where there is one.

    `dwells`: with reference headings, NaN where there are none [rad]; `fixes`: solutions [rad];
    `heading_sd`: standard deviation of the references [rad].
    """
    away = turned(fixes.angles[:, 0] - dwells.heading)
    size = np.abs(away) / np.sqrt(fixes.cov[:, 0, 0] + heading_sd**2)
    return tuple(
        (finding("north.reference", name=name, away=f"{np.degrees(a):.3g}", size=f"{z:.1f}"),)
        if z > CONTRADICTS
        else ()
        for name, a, z in zip(dwells.names, away, size, strict=True)
    )


def _list(angles: list[Any]) -> str:
    return ", ".join(f"{a:g}" for a in angles[:8]) + ", ..." * (len(angles) > 8)


def _range(low: float, high: float) -> str:
    one, two = f"{low - ZERO_CELSIUS:.0f}", f"{high - ZERO_CELSIUS:.0f}"
    return one if one == two else f"{one} to {two}"
