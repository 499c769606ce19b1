"""The calibration of a north seeker solved: from dwells to coefficients, with what led to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.north import calibration as judge
from foucault.diagnose.north.noise import GUESS, drift_sd, from_residuals
from foucault.diagnose.north.stops import (
    Gains,
    gain_words,
    spent,
    stop_gains,
    stop_offsets,
    without,
    without_gains,
    words,
)
from foucault.errors import Finding, error
from foucault.estimate.north import calibration as estimation
from foucault.estimate.north.calibration import Rig
from foucault.estimate.north.reduction import Nuisance, Pairs, reduce
from foucault.infer import mixed
from foucault.infer.mixed import NOISE_BASIS, Fit
from foucault.models.dwells import Dwells
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import SEEKER, Compensation
from foucault.procedures.north_seeking.settings import MOST_LATITUDE, Settings

Z_COUPLING = ("gyro.misalignment.xz", "gyro.misalignment.yz")
"""The coupling of the rate along the axis of the base."""


def require_latitude(latitude: float) -> None:
    """Refuse a latitude where a gyro cannot find north.

    `latitude`: positive north [rad].
    """
    if abs(latitude) > MOST_LATITUDE:
        raise error("north.latitude", given=f"{np.degrees(latitude):.4f}")


@dataclass(frozen=True)
class Solution:
    """The calibration solved, with what led to it."""

    pairs: Pairs  # four numbers of every set-up [SI]
    rig: Rig
    noise: ImuNoise  # noise that was weighed [SI]
    source: str  # where it came from
    nuisance: Nuisance  # offset, drift and index angles
    fit: Fit
    # significance of the coupling along z_b: chi-square, and how often chance gives so much [1]
    z_test: tuple[float, float] | None
    findings: tuple[Finding, ...]
    stop_offsets: dict[str, float]  # biases of single stops [rad/s]
    stop_gains: Gains  # by what part of the rates along x_b and y_b single stops read too much [1]


def solved(
    dwells: Dwells, site: Site, settings: Settings, noise: ImuNoise | None, declared: bool,
    given: Mapping[str, tuple[float, float]],
) -> Solution:  # fmt: skip
    """Solve the calibration.

    `dwells`: readings [SI]; `noise`: noise of the sensors, None finds it in the residuals [SI];
    `declared`: whether it was declared, or measured in the dwells; `given`: mean and standard
    deviation of coefficients or groups of coefficients [SI].
    """
    known = Compensation(held(accelerometers_before(settings, given)))
    trial = noise or GUESS
    nuisance = Nuisance(
        drift_sd=drift_sd(dwells, trial, settings.drift, settings.drift_sd),
        index_sd=settings.index_sd, lag_sd=settings.index_lag_sd or 0.0,
    )  # fmt: skip
    offsets, chance = stop_offsets(dwells, trial, nuisance)
    told = words(offsets, chance)
    dwells = without(dwells, offsets)
    gains, chance = stop_gains(dwells, trial, nuisance)
    told += gain_words(gains, chance)
    if gains:
        dwells = without_gains(dwells, gains, reduce(dwells, trial, nuisance).values)
    used = (1 if offsets else 0) + (2 if gains else 0)
    pairs = spent(reduce(dwells, trial, nuisance), used)
    rig = _rig(pairs, dwells, site, settings)
    if settings.z_coupling == "auto":
        given = dict.fromkeys(Z_COUPLING, (0.0, settings.z_coupling_sd)) | dict(given)
    source = "declared" if declared else "measured in the dwells"
    if noise is None:
        noise, source = _noise(dwells, pairs, rig, known, given), judge.UNKNOWN
        pairs = spent(reduce(dwells, noise, nuisance), used)
    basis = NOISE_BASIS[judge.NOISE[source]]
    fit = _fit(pairs, rig, settings.z_coupling != "no", known, given, basis)
    judge.require_sound(fit.estimate)
    z_test: tuple[float, float] | None = None
    if rig.tilt == "each":
        free = fit
        if settings.z_coupling != "free":
            unknown = {k: v for k, v in given.items() if not k.startswith(Z_COUPLING)}
            free = _fit(pairs, rig, True, known, unknown, basis)
        z_test = judge.z_significance(free.estimate)
        told += tuple(judge.z_findings(z_test, settings.z_coupling))
    return Solution(pairs, rig, noise, source, nuisance, fit, z_test, told, offsets, gains)


def _rig(pairs: Pairs, dwells: Dwells, site: Site, settings: Settings) -> Rig:
    """Find out how the table was used."""
    accelerometers = dwells.accel is not None
    if settings.tilt == "each" and not accelerometers:
        raise error("north.tilt_unknown")
    level = settings.level_sd
    if level is None:
        if not accelerometers:
            raise error("north.level_sd")
        level = np.inf
    rig = Rig(
        dwells.heading, site, "one axis", accelerometers, settings.heading_sd,
        settings.heading_offset_sd, level, settings.latitude_sd,
    )  # fmt: skip
    tilted = settings.tilt == "auto" and accelerometers and judge.leans(pairs, rig)
    if settings.tilt == "each" or tilted:
        return replace(rig, tilt="each", level_sd=settings.level_sd or 0.0)
    return rig


def _fit(
    pairs: Pairs, rig: Rig, z_coupling: bool, known: Compensation,
    given: Mapping[str, tuple[float, float]], basis: tuple[str, str],
) -> Fit:  # fmt: skip
    names = estimation.names_of(rig.tilt, rig.accelerometers, z_coupling)
    model = estimation.OnTurntable(pairs, rig, SEEKER.subset(names), known, basis)
    return mixed.fit(model, _prior(names, given))


def _noise(
    dwells: Dwells, pairs: Pairs, rig: Rig, known: Compensation,
    given: Mapping[str, tuple[float, float]],
) -> ImuNoise:  # fmt: skip
    """Measure the noise by what the calibration leaves."""
    fit = _fit(pairs, rig, rig.tilt == "each", known, given, NOISE_BASIS["unknown"])
    found = from_residuals(pairs, dwells.accel is not None, list(fit.after.values()))
    if found is None:
        raise error("north.noise_unknown", what="[noise] in the campaign file")
    return found


def _prior(
    names: tuple[str, ...], given: Mapping[str, tuple[float, float]]
) -> CoefficientVector | None:
    """Return what is known of `names`; what is given of the others does not count here."""
    whole = CoefficientVector.prior(SEEKER, given)
    keep = [SEEKER.index(name) for name in names]
    sd = whole.prior_sd[keep]
    if not np.isfinite(sd).any():
        return None
    return CoefficientVector(SEEKER.subset(names), whole.values[keep], prior_sd=sd)


def accelerometers_before(
    settings: Settings, prior: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return what is known of accelerometers beforehand; a prior goes before it.

    `prior`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    usual = {
        "accel.bias": (0.0, settings.accel_bias_sd),
        "accel.scale": (0.0, settings.accel_scale_sd),
        "accel.misalignment": (0.0, settings.accel_misalignment_sd),
    }
    given = {name.rpartition(".")[0] for name in prior} | set(prior)
    return {k: v for k, v in usual.items() if v[1] > 0 and k not in given} | dict(prior)


def held(given: Mapping[str, tuple[float, float]]) -> CoefficientVector:
    """Return what is known of the accelerometers beforehand.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    names = [n for n in SEEKER.names if n.startswith("accel.")]
    vector = _prior(tuple(names), given)
    if vector is None:
        return CoefficientVector.zeros(SEEKER.subset(()))
    keep = np.flatnonzero(np.isfinite(vector.prior_sd))
    layout = SEEKER.subset(names[i] for i in keep)
    return CoefficientVector(layout, vector.values[keep], np.diag(vector.prior_sd[keep] ** 2))
