"""Offsets that repeat with the stop, beyond those that look like a rate: twice per turn, or any.

Four stops with four biases have one combination that no rate makes, b(0) + b(180) - b(90) -
b(270). It cancels in the rates of the same stops, but not in the residuals, where it would pass for
noise. Over many set-ups it is the mean of the residuals at each stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from foucault.diagnose.north.validity import NEAR_STOP
from foucault.errors import Finding, finding
from foucault.estimate.north.reduction import Nuisance, Pairs, reduce
from foucault.models.dwells import Dwells
from foucault.models.noise import ImuNoise
from foucault.models.rotation import turned

FEWEST = 6
"""Set-ups with the same stops that it takes to see what repeats [1]."""

SIGNIFICANT = 1e-3
"""Offsets are worth a word where chance gives so much less often than this [1]."""


def stop_offsets(
    dwells: Dwells, noise: ImuNoise, nuisance: Nuisance
) -> tuple[dict[str, float], float]:
    """Return what the gyro reads too much at each stop.

    It is taken off whether it is significant or not: that costs one set-up's redundant readings,
    while what is there and left in would pass for noise.

    Parameters
    ----------
    dwells : Dwells
        Set-ups with the same stops in the same order [SI].
    noise : ImuNoise
        Noise of the sensors; its size does not matter [SI].
    nuisance : Nuisance
        What is known beforehand.

    Returns
    -------
    offsets : dict of str to float
        Index angle in whole degrees -> offset [rad/s]; empty where these set-ups do not show it.
    chance : float
        How often chance gives so much [1].
    """
    from scipy.special import fdtrc

    m = len(dwells.names)
    k = len(dwells) // max(m, 1)
    if dwells.turning is not None and dwells.turning.any():
        return {}, 1.0
    stops = np.round(np.degrees(dwells.index)).astype(int) % 360
    if m < FEWEST or len(dwells) != m * k or np.any(stops.reshape(m, k) != stops[:k]):
        return {}, 1.0
    before = reduce(dwells, noise, nuisance)
    if before.dof[:, 0].min() < 1:
        return {}, 1.0
    left = dwells.gyro - before.fit
    found = {f"{stop}": float(left[stops == stop].mean()) for stop in np.unique(stops)}
    after = reduce(without(dwells, found), noise, nuisance)
    total, rest = (float(p.chi_square[:, 0].sum()) for p in (before, after))
    shared = int(before.dof[0, 0])
    ratio = (total - rest) / shared / max(rest / (shared * (m - 1)), 1e-300)
    chance = float(fdtrc(float(shared), float(shared * (m - 1)), max(ratio, 0.0)))
    return found, chance


def without(dwells: Dwells, offsets: Mapping[str, float]) -> Dwells:
    """Take the offsets off the readings of the same stops.

    Parameters
    ----------
    dwells : Dwells
        Readings [SI].
    offsets : mapping of str to float
        Index angle in degrees -> offset [rad/s].
    """
    if not offsets or (dwells.turning is not None and dwells.turning.any()):
        return dwells
    known = np.radians([float(stop) for stop in offsets])
    apart = turned(dwells.index[:, None] - known)
    nearest = np.abs(apart).argmin(axis=1)
    there = np.abs(apart)[np.arange(len(dwells)), nearest] < NEAR_STOP
    values = np.array(list(offsets.values()))[nearest]
    return replace(dwells, gyro=dwells.gyro - np.where(there, values, 0.0))


def spent(pairs: Pairs) -> Pairs:
    """Count one set-up's redundant readings as used up by the offsets.

    Parameters
    ----------
    pairs : Pairs
        Set-ups, the offsets taken off [SI].
    """
    dof = pairs.dof.copy()
    dof[0, 0] = 0
    return replace(pairs, dof=dof)


def words(offsets: Mapping[str, float], chance: float) -> tuple[Finding, ...]:
    """Say what was found, where it is significant.

    Parameters
    ----------
    offsets : mapping of str to float
        Index angle in degrees -> offset [rad/s].
    chance : float
        How often chance gives so much [1].
    """
    if not offsets or chance > SIGNIFICANT:
        return ()
    most = max(offsets, key=lambda stop: abs(offsets[stop]))
    size = f"{np.degrees(offsets[most]) * 3600:.2g}"
    return (finding("north.stop_offsets", size=size, stop=most),)
