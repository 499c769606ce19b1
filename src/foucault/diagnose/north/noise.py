"""Noise and drift of a north seeker, where nobody has said what they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.north.attitude import Fixes
from foucault.estimate.north.reduction import Nuisance, Pairs, reduce
from foucault.infer.mixed import Component
from foucault.models.dwells import Dwells
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise

GUESS = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=1e-6))
"""Noise to start from where none is known [SI]."""

FEWEST = 5
"""Redundant readings that a noise level needs at least [1]."""

NEARLY_FREE = 1.1
"""A drift is estimated by itself where it makes no rate less certain than by this factor [1]."""


def from_residuals(
    pairs: Pairs, accelerometers: bool, more: Sequence[Component] = ()
) -> ImuNoise | None:
    """Measure white noise by what the fits over the index angle leave.

    `pairs`: set-ups, reduced with the noise of `GUESS` [SI]; `more`: how gyro, and accelerometers,
    fit over the set-ups, with the noise of `GUESS`. Returns white noise of both [SI]; None where
    either has too few redundant readings.
    """
    square, dof = pairs.chi_square.sum(axis=0), pairs.dof.sum(axis=0).astype(float)
    for k, over in enumerate(more):
        square[k] += over.chi_square
        dof[k] += over.redundancy
    if dof[0] < FEWEST or (accelerometers and dof[1] < FEWEST):
        return None
    # From few readings the noise itself is uncertain: errors over their sd are then Student's t,
    # whose variance is dof / (dof - 2).
    scale = np.sqrt(square / np.maximum(dof - 2.0, 1.0))
    accel = replace(GUESS.accel, white=GUESS.accel.white * float(scale[1]))
    gyro = replace(GUESS.gyro, white=GUESS.gyro.white * float(scale[0]))
    return ImuNoise(accel if accelerometers else TriadNoise(), gyro)


def drift_sd(
    dwells: Dwells, noise: ImuNoise, wanted: Literal["auto", "none", "linear"], known: float | None
) -> float:
    """Return the standard deviation that the drift is given beforehand [rad/s^2].

    `dwells`: readings [SI]; `noise`: noise of the sensors [SI]; `known` or None: declared
    standard deviation [rad/s^2]. Returns 0 where the drift is taken as none, infinite where it is
    estimated freely.
    """
    if wanted == "none":
        return 0.0
    if known is not None:
        return known
    if wanted == "linear":
        return float("inf")
    plain, free = (reduce(dwells, noise, Nuisance(drift_sd=sd)) for sd in (0.0, np.inf))
    if np.any(free.dof[:, 0] < 1):
        return 0.0
    ratio = _sizes(free) / _sizes(plain)
    return float("inf") if np.all(ratio < NEARLY_FREE**2) else 0.0


def _sizes(pairs: Pairs) -> FloatArray:
    """Return the larger variance of the two rates of every set-up, shape (m,) [rad^2/s^2]."""
    return np.asarray(np.max(np.linalg.eigvalsh(pairs.cov[:, :2, :2]), axis=1))


def signal_to_noise(fixes: Fixes, pairs: Pairs) -> FloatArray:
    """Return the Earth's horizontal rate over the gyro's uncertainty across it, shape (m,) [1].

    Level that is ``w_ie cos L / sd``: one over what the gyro alone leaves uncertain of the heading.

    `fixes`: solutions with their budget [rad]; `pairs`: set-ups [SI].
    """
    gyro = [v[:, 0] for name, v in fixes.sources.items() if name.startswith("gyro")]
    out = 1.0 / np.sqrt(np.maximum(np.sum(gyro, axis=0), 1e-300))
    # Where the rate along z is lost it is that, and not the gyro, which leaves heading uncertain.
    lost = fixes.status == 1
    level = EARTH_RATE * np.cos(fixes.angles[:, 3]) / np.sqrt(_sizes(pairs))
    return np.where(lost, level, out)
