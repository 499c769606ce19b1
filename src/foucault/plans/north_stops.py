"""What a plan for north seeking will give, before anything is measured.

Readings without noise are made for set-ups at all headings, and solved by what solves readings of
the field: the standard deviations are those that the field solution will state, source by source.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.north import Fixes, Known, solve
from foucault.estimate.north_reduction import Nuisance, Pairs, reduce
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation, Dwells, earth_rate_b, up_b
from foucault.models.rotation import turned

HEADINGS = np.radians(np.arange(15.0, 360.0, 30.0))
"""Headings that are averaged over; 45 deg is where drift does most to four positions [rad]."""

LINEAR_DRIFT = "linear drift"
LOST_RATE = "rate along the axis"
"""What the solution adds where that rate, which tells an unknown latitude, is lost in the noise."""

SMALL = 1e-3  # Size of a drift that is tried, over all of the time, in Earth's rates [1].


@dataclass(frozen=True)
class Conditions:
    """Instrument, place, and what is known."""

    latitude: float  # positive north [rad]
    noise: ImuNoise  # of the sensors [SI]
    latitude_sd: float = 0.0  # standard deviation of the latitude [rad]
    latitude_known: bool = True  # false where the readings have to tell the latitude too
    tilt: float = 0.0  # up to which the case may be tilted [rad]
    drift: float = 0.0  # size of a linear drift of the gyro [rad/s^2]
    # whether the solution estimates it, with `drift` as prior standard deviation
    drift_estimated: bool = True
    index_sd: float = 0.0  # of every index angle [rad]
    level_sd: float | None = None  # without accelerometers: how well the case is levelled [rad]
    # the instrument's calibration, with covariance
    compensation: Compensation = field(default_factory=Compensation)
    # of the gyro's constant offset, infinite where the readings have to tell it [rad/s]
    offset_sd: float = np.inf


@dataclass(frozen=True)
class Prediction:
    """What a plan gives, over all headings."""

    sd: float  # standard deviation of the heading, root mean square [rad]
    worst: float  # at the worst heading [rad]
    sources: dict[str, float]  # mean variance of the heading by source [rad^2]
    drift_error: float  # largest error by a linear drift of 1 rad/s^2 that is not estimated [s^2]


def poses(tilt: float) -> FloatArray:
    """Return headings, pitches and rolls to average over, of up to `tilt`, shape (m, 3) [rad]."""
    if tilt == 0:
        return np.stack([HEADINGS, 0 * HEADINGS, 0 * HEADINGS], 1)
    size = tilt / np.sqrt(3)  # root mean square of sizes that are spread evenly
    towards = np.radians(np.arange(45.0, 360.0, 90.0))
    h, t = (x.ravel() for x in np.meshgrid(HEADINGS, towards, indexing="ij"))
    return np.stack([h, size * np.cos(t), size * np.sin(t)], 1)


def predict(
    dwells: Dwells, at: FloatArray, conditions: Conditions, *, near: bool = False,
    drift: bool = True, on_case: bool | None = None,
) -> Prediction:  # fmt: skip
    """Predict the standard deviation of the heading.

    `dwells`: the stops of m set-ups, their readings are of no interest [SI]; `at` (m, 3):
    heading, pitch and roll of each [rad]; `conditions`: instrument, place, and what is known
    [SI]; `near`: whether a rough heading decides between solutions. Its two stops do not show the
    tilt in both directions to one accelerometer that turns with them: two on the case are taken;
    `drift`: whether to find the error by drift too, NaN without; `on_case`: whether two
    accelerometers stay with the case, None takes them for a rough heading alone.
    """
    made = readings(dwells, at, conditions, on_case=near if on_case is None else on_case)
    prior = conditions.drift if conditions.drift_estimated else 0.0
    fixes = _solved(_reduced(made, conditions, prior), at, conditions, near)
    ignored = bool(conditions.drift) and not conditions.drift_estimated
    moved = np.full(len(at), np.nan)
    if drift or ignored:
        moved = _moved_by_drift(made, at, conditions, near)
    sources = {name: v[:, 0] for name, v in fixes.sources.items()}
    variance = fixes.cov[:, 0, 0]
    if ignored:
        sources[LINEAR_DRIFT] = (conditions.drift * moved) ** 2
        variance = variance + sources[LINEAR_DRIFT]
    left = variance - np.asarray(sum(sources.values()))
    if (left > 1e-3 * variance).any():
        sources[LOST_RATE] = np.maximum(left, 0.0)
    return Prediction(
        float(np.sqrt(variance.mean())), float(np.sqrt(variance.max())),
        {name: float(v.mean()) for name, v in sources.items()},
        float(np.abs(moved).max()),
    )  # fmt: skip


def readings(
    dwells: Dwells, at: FloatArray, conditions: Conditions, *, on_case: bool = False
) -> Dwells:
    """Return dwells with the readings that the instrument gives without noise.

    `dwells`: the stops of m set-ups [SI]; `at` (m, 3): heading, pitch and roll of each [rad];
    `conditions`: instrument and place [SI]; `on_case`: whether two accelerometers stay with the
    case, instead of one that turns with the gyro.
    """
    heading, pitch, roll = at.T
    w_b = earth_rate_b(heading, pitch, roll, np.full(len(at), conditions.latitude))
    f_b = gravity(conditions.latitude) * up_b(pitch, roll)
    four = conditions.compensation.predict(w_b, f_b)[dwells.setup]
    axis = np.stack([dwells.sine, dwells.cosine], 1)
    gyro = np.sum(axis * four[:, :2], axis=1)
    accel = four[:, 2:] if on_case else np.sum(axis * four[:, 2:], axis=1, keepdims=True)
    if conditions.level_sd is not None:
        accel = None
    return replace(dwells, gyro=gyro, accel=accel)


def _reduced(made: Dwells, conditions: Conditions, drift_sd: float) -> Pairs:
    nuisance = Nuisance(
        offset_sd=conditions.offset_sd, drift_sd=drift_sd, index_sd=conditions.index_sd
    )
    return reduce(made, conditions.noise, nuisance)


def _solved(pairs: Pairs, at: FloatArray, conditions: Conditions, near: bool) -> Fixes:
    known = Known(
        gravity(conditions.latitude),
        conditions.latitude if conditions.latitude_known else None,
        conditions.latitude_sd,
        "north" if conditions.latitude >= 0 else "south",
        near=at[:, 0] if near else None,
        level_sd=conditions.level_sd,
    )
    return solve(pairs, known, conditions.compensation)


def _moved_by_drift(made: Dwells, at: FloatArray, conditions: Conditions, near: bool) -> FloatArray:
    """Return what a drift of 1 rad/s^2 that is not estimated does to each heading [s^2]."""
    middle = made.start + made.time / 2
    size = SMALL * EARTH_RATE / float(middle.max())
    headings = [
        _solved(_reduced(d, conditions, 0.0), at, conditions, near).angles[:, 0]
        for d in (made, replace(made, gyro=made.gyro + size * middle))
    ]
    return np.asarray(turned(headings[1] - headings[0]) / size)
