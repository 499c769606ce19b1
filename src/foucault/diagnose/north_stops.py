"""Does a calibration hold here: its stops, its temperature, a reference heading.

Offsets that repeat with the stop, beyond those that look like a rate: twice per turn, or any.

Four stops with four biases have one combination that no rate makes, b(0) + b(180) - b(90) -
b(270). It cancels in the rates of the same stops, but not in the residuals, where it would pass for
noise. Over many set-ups it is the mean of the residuals at each stop.

A gyro whose gains differ from sense to sense, or from axis to axis of the base (ref. [1], eqs.
(36)-(37)), has such a combination too, and it goes with the rates of the set-up: over headings it
is the slope of the residuals at each stop against the rates along x_b and y_b. What the stops share
is in the coefficients.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.errors import Finding, finding
from foucault.estimate.north import Fixes
from foucault.estimate.north_reduction import Nuisance, Pairs, reduce
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Dwells
from foucault.models.rotation import turned
from foucault.units import ZERO_CELSIUS

NEAR_STOP = np.radians(2.0)  # Index angles that differ by less are the same stop [rad].
WARM = 5.0  # Temperatures within so much of those of the calibration are the same [K].
CONTRADICTS = 4.0  # A heading further from its reference than this contradicts it [sd].


def other_conditions(
    dwells: Dwells, temperature: FloatArray | None, validity: Mapping[str, Any]
) -> tuple[Finding, ...]:
    """Compare stops and temperature with those of the calibration.

    `temperature` (n,) or None: of the instrument [K]; `validity`: what the result of the
    calibration says of itself.
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
) -> Callable[[int], tuple[Finding, ...]]:
    """Compare every heading with the reference in the file, where there is one.

    `dwells`: with reference headings, NaN where there are none [rad]; `heading_sd`: standard
    deviation of the references [rad]. Returns what is to say of a set-up.
    """

    def of(i: int) -> tuple[Finding, ...]:
        away = turned(fixes.angles[i, 0] - dwells.heading[i])
        size = np.abs(away) / np.sqrt(fixes.cov[i, 0, 0] + heading_sd**2)
        if not size > CONTRADICTS:
            return ()
        a, z = f"{np.degrees(away):.3g}", f"{size:.1f}"
        return (finding("north.reference", name=dwells.names[i], away=a, size=z),)

    return of


def _list(angles: list[Any]) -> str:
    return ", ".join(f"{a:g}" for a in angles[:8]) + ", ..." * (len(angles) > 8)


def _range(low: float, high: float) -> str:
    one, two = f"{low - ZERO_CELSIUS:.0f}", f"{high - ZERO_CELSIUS:.0f}"
    return one if one == two else f"{one} to {two}"


FEWEST = 6  # Set-ups with the same stops that it takes to see what repeats [1].
SIGNIFICANT = 1e-3  # Offsets are worth a word where chance gives so much less often than this [1].


def stop_offsets(
    dwells: Dwells, noise: ImuNoise, nuisance: Nuisance
) -> tuple[dict[str, float], float]:
    """Return what the gyro reads too much at each stop.

    It is taken off whether it is significant or not: that costs one set-up's redundant readings,
    while what is there and left in would pass for noise.

    `dwells`: set-ups with the same stops in the same order [SI]; `noise`: noise of the sensors,
    its size does not matter [SI]. Returns `offsets`: index angle in whole degrees -> offset
    [rad/s]; empty where these set-ups do not show it; `chance`: how often chance gives so much
    [1].
    """
    stops = _alike(dwells)
    if stops is None:
        return {}, 1.0
    before = reduce(dwells, noise, nuisance)
    if before.dof[:, 0].min() < 1:
        return {}, 1.0
    left = dwells.gyro - before.fit
    found = {f"{stop}": float(left[stops == stop].mean()) for stop in np.unique(stops)}
    return found, _chance(before, reduce(without(dwells, found), noise, nuisance), spent=0, more=1)


def _chance(before: Pairs, after: Pairs, *, spent: int, more: int) -> float:
    """Return how often chance lets the residuals fall by so much, by an F test [1].

    `spent`, `more`: numbers that were taken off each stop before, and now [1].
    """
    from scipy.special import fdtrc

    total, rest = (float(p.chi_square[:, 0].sum()) for p in (before, after))
    shared = int(before.dof[0, 0])
    gained, free = float(more * shared), float(shared * (len(before) - spent - more))
    ratio = (total - rest) / gained / max(rest / free, 1e-300)
    return float(fdtrc(gained, free, max(ratio, 0.0)))


Gains = dict[str, list[float]]
"""Index angle in whole degrees -> what the gyro reads too much there, as a part of the rates along
x_b and y_b [1]."""

GAINS = 0.01  # Gains that differ are taken off where chance gives so much less often than this [1].


def stop_gains(dwells: Dwells, noise: ImuNoise, nuisance: Nuisance) -> tuple[Gains, float]:
    """Return by what part of the rates the gyro reads too much at each stop, beyond what all share.

    `dwells`: set-ups with the same stops in the same order, offsets of the stops taken off [SI];
    `noise`: noise of the sensors, its size does not matter [SI]. Returns `gains`: by index angle
    [1]; empty where the test does not see them; `chance`: how often chance gives so much [1].
    """
    stops = _alike(dwells)
    if stops is None:
        return {}, 1.0
    before = reduce(dwells, noise, nuisance)
    if before.dof[:, 0].min() < 1:
        return {}, 1.0
    left = dwells.gyro - before.fit
    rates = before.values[dwells.setup, :2]
    found: Gains = {}
    for stop in np.unique(stops):
        at = stops == stop
        design = np.column_stack([np.ones(at.sum()), rates[at]])
        found[f"{stop}"] = np.linalg.lstsq(design, left[at], rcond=None)[0][1:].tolist()
    after = reduce(without_gains(dwells, found, before.values), noise, nuisance)
    chance = _chance(before, after, spent=1, more=2)
    return (found if chance < GAINS else {}), chance


def without_gains(dwells: Dwells, gains: Gains, values: FloatArray) -> Dwells:
    """Take off what gains of single stops make of the rates.

    `gains`: by index angle [1]; `values` (m, 4): rates along x_b and y_b of every set-up, and two
    numbers that do not count [SI].
    """
    if not gains:
        return dwells
    rates = values[dwells.setup, :2]
    table = np.array(list(gains.values()))
    nearest, there = _nearest(dwells, gains)
    more = np.einsum("ni,ni->n", table[nearest], rates)
    return replace(dwells, gyro=dwells.gyro - np.where(there, more, 0.0))


def gain_words(gains: Gains, chance: float) -> tuple[Finding, ...]:
    """Say which `gains` by index angle [1] were found, by chance so often: `chance` [1]."""
    if not gains:
        return ()
    size = f"{1e6 * max(abs(k) for row in gains.values() for k in row):.2g}"
    return (finding("north.stop_gains", size=size, p=f"{chance:.1g}"),)


def _alike(dwells: Dwells) -> IntArray | None:
    """Return the index angles of all rows in whole degrees where all set-ups have the same."""
    m = len(dwells.names)
    k = len(dwells) // max(m, 1)
    if dwells.turning is not None and dwells.turning.any():
        return None
    stops = np.round(np.degrees(dwells.index)).astype(int) % 360
    if m < FEWEST or len(dwells) != m * k or np.any(stops.reshape(m, k) != stops[:k]):
        return None
    return np.asarray(stops)


def without(dwells: Dwells, offsets: Mapping[str, float]) -> Dwells:
    """Take the `offsets`, index angle in degrees -> offset [rad/s], off the same stops."""
    if not offsets or (dwells.turning is not None and dwells.turning.any()):
        return dwells
    nearest, there = _nearest(dwells, offsets)
    values = np.array(list(offsets.values()))[nearest]
    return replace(dwells, gyro=dwells.gyro - np.where(there, values, 0.0))


def _nearest(dwells: Dwells, stops: Mapping[str, object]) -> tuple[IntArray, BoolArray]:
    """Return which of the stops each row is at, and whether it is there."""
    known = np.radians([float(stop) for stop in stops])
    apart = np.abs(turned(dwells.index[:, None] - known))
    nearest = apart.argmin(axis=1)
    return nearest, apart[np.arange(len(dwells)), nearest] < NEAR_STOP


def spent(pairs: Pairs, setups: int = 1) -> Pairs:
    """Count redundant readings of so many `setups` [1] as used up by the offsets and gains."""
    dof = pairs.dof.copy()
    dof[:setups, 0] = 0
    return replace(pairs, dof=dof)


def words(offsets: Mapping[str, float], chance: float) -> tuple[Finding, ...]:
    """Say which `offsets`, by index angle [rad/s], are significant, by chance `chance` [1]."""
    if not offsets or chance > SIGNIFICANT:
        return ()
    most = max(offsets, key=lambda stop: abs(offsets[stop]))
    size = f"{np.degrees(offsets[most]) * 3600:.2g}"
    return (finding("north.stop_offsets", size=size, stop=most),)
