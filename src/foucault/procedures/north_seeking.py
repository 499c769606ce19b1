"""Calibrate a north seeker on a turntable, level at known headings, or tilted too.

Set the instrument up at twelve headings (or any others, well spread), let its base stop at every
index angle, and give the heading of the table with each. The result has the bias, scale factor
and coupling of the two rates that the base resolves, six parameters; a tilted table shows the
coupling of the third rate too, two more. `foucault north` takes the result to the field.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.diagnose import north_calibration as evidence
from foucault.diagnose import north_calibration_report as shown
from foucault.diagnose.dwells import find_dwells, measured_noise
from foucault.diagnose.north_input import late_index, stops, units_first
from foucault.diagnose.north_noise import GUESS, drift_sd, from_residuals, noise_json
from foucault.diagnose.north_stops import spent, stop_offsets, without, words
from foucault.errors import Finding, error
from foucault.estimate import north_calibration as estimation
from foucault.estimate.north_calibration import Rig
from foucault.estimate.north_reduction import Nuisance, Pairs, reduce
from foucault.estimate.north_seeking import Known
from foucault.logs import indexed, indexed_own
from foucault.logs.indexed_description import IndexedDescription
from foucault.models.dwells import Dwells
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import EQUATION, SEEKER, Compensation
from foucault.procedures.hand_rotated import Progress, silent
from foucault.procedures.north_settings import MOST_LATITUDE
from foucault.procedures.north_settings import Session as Session
from foucault.procedures.north_settings import Settings as Settings
from foucault.procedures.north_settings import draw_errors as draw_errors
from foucault.procedures.north_settings import simulate as simulate
from foucault.result import Estimate, Problem, Result, Verdict, provenance
from foucault.tables import IndexedLog

FloatArray = npt.NDArray[np.float64]

Description = IndexedDescription
read_log = indexed.read
write_log = indexed_own.write
log_table = indexed_own.log_table
SIMULATE = {"grade": "navigation"}
"""Default of [simulate]."""

Z_COUPLING = ("gyro.misalignment.xz", "gyro.misalignment.yz")
"""The coupling of the rate along the axis of the base."""

FRAME = "axes of the case, right-forward-up: headings of the turntable"
GAUGES = {
    "one axis": "y_b is where the reference headings say, z_b the axis of the turntable",
    "each": "y_b is where the reference headings say, z_b the axis of the base",
}
"""What defines the axes, by the way the table was used."""


def names_in(settings: Settings, session: Session) -> tuple[str, ...]:
    """Return the coefficients that a simulated session gives.

    Parameters
    ----------
    settings : Settings
        What was chosen.
    session : Session
        What is done: a tilted table shows others than a level one.
    """
    tilted = settings.tilt == "each" or (settings.tilt == "auto" and len(set(session.tilts)) > 1)
    return estimation.names_of(
        "each" if tilted else "one axis", session.accelerometers != "none",
        settings.z_coupling != "no",
    )  # fmt: skip


def calibrate(
    log: IndexedLog,
    *,
    site: Site,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Result:
    """Calibrate a north seeker from set-ups at known headings.

    Parameters
    ----------
    log : IndexedLog
        Samples or means, with index angles and reference headings [SI].
    site : Site
        Gravity and latitude.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of gyro and accelerometers [SI]; None measures it.
    prior : mapping of str to (float, float) or None
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    instrument : mapping or None
        Name, serial and so on, kept in the result.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    Result
        Coefficients with covariance, checks and a verdict [SI].

    Raises
    ------
    FoucaultError
        No headings, wrong units or senses, headings that do not span: see `foucault.symptoms`.
    """
    started = clock.monotonic()
    settings = settings or Settings()
    progress(0.1, "finding the dwells")
    dwells = find_dwells(log, settle=settings.settle, shortest=settings.shortest)
    _require_readings(log, dwells)
    told = stops(dwells, Known(site.gravity))
    told += late_index(dwells, settings.index_lag_sd)
    if site.latitude is None:
        raise error("north.calibration_latitude")
    require_latitude(site.latitude)
    progress(0.4, "calibrating")
    declared = noise or measured_noise(log, dwells)
    with units_first(log.findings):
        solution = _solve(dwells, site, settings, declared, noise is not None, prior or {})
    progress(1.0, "done")
    result = _result(solution, dwells, settings, site)
    return replace(
        result,
        findings=(*log.findings, *told, *result.findings),
        instrument=dict(instrument or {}),
        validity=_validity(log, dwells, solution),
        provenance=provenance(log.source, clock.monotonic() - started),
    )


def _require_readings(log: IndexedLog, dwells: Dwells) -> None:
    missing = np.flatnonzero(~np.isfinite(dwells.heading))
    if log.heading is None or len(missing) == len(dwells.names):
        raise error("north.no_heading")
    if len(missing):
        names = ", ".join(f"'{dwells.names[i]}'" for i in missing[:5])
        raise error("north.heading_missing", names=names + ", ..." * (len(missing) > 5))
    finite = np.isfinite(dwells.gyro)
    if dwells.accel is not None:
        finite &= np.isfinite(dwells.accel).all(axis=1)
    if not finite.all():
        raise error("north.not_a_number", name=dwells.names[dwells.setup[np.argmin(finite)]])


def require_latitude(latitude: float) -> None:
    """Refuse a latitude where a gyro cannot find north.

    Parameters
    ----------
    latitude : float
        Positive north [rad].
    """
    if abs(latitude) > MOST_LATITUDE:
        raise error("north.latitude", given=f"{np.degrees(latitude):.4f}")


@dataclass(frozen=True)
class _Solution:
    """The calibration solved, with what led to it."""

    pairs: Pairs
    rig: Rig
    noise: ImuNoise
    source: str
    nuisance: Nuisance
    problem: Problem
    estimate: Estimate
    z_test: tuple[float, float] | None
    findings: tuple[Finding, ...]
    stop_offsets: dict[str, float]


def _solve(
    dwells: Dwells, site: Site, settings: Settings, noise: ImuNoise | None, declared: bool,
    given: Mapping[str, tuple[float, float]],
) -> _Solution:  # fmt: skip
    known = Compensation(_held(accelerometers_before(settings, given)))
    trial = noise or GUESS
    nuisance = Nuisance(
        drift_sd=drift_sd(dwells, trial, settings.drift, settings.drift_sd),
        index_sd=settings.index_sd, lag_sd=settings.index_lag_sd or 0.0,
    )  # fmt: skip
    offsets, chance = stop_offsets(dwells, trial, nuisance)
    told = words(offsets, chance)
    dwells = without(dwells, offsets)
    pairs = reduce(dwells, trial, nuisance)
    pairs = spent(pairs) if offsets else pairs
    rig = _rig(pairs, dwells, site, settings)
    if settings.z_coupling == "auto":
        given = dict.fromkeys(Z_COUPLING, (0.0, settings.z_coupling_sd)) | dict(given)
    source = "declared" if declared else "measured in the dwells"
    if noise is None:
        noise, source = _noise(dwells, pairs, rig, known, given), "from the residuals"
        pairs = reduce(dwells, noise, nuisance)
        pairs = spent(pairs) if offsets else pairs
    problem, estimate = _fit(pairs, rig, settings.z_coupling != "no", known, given)
    evidence.require_sound(estimate)
    z_test: tuple[float, float] | None = None
    if rig.tilt == "each":
        free = estimate
        if settings.z_coupling != "free":
            unknown = {k: v for k, v in given.items() if not k.startswith(Z_COUPLING)}
            free = _fit(pairs, rig, True, known, unknown)[1]
        z_test = evidence.z_significance(free)
        told += tuple(evidence.z_findings(z_test, settings.z_coupling))
    return _Solution(pairs, rig, noise, source, nuisance, problem, estimate, z_test, told, offsets)


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
    tilted = settings.tilt == "auto" and accelerometers and evidence.leans(pairs, rig)
    if settings.tilt == "each" or tilted:
        return replace(rig, tilt="each", level_sd=settings.level_sd or 0.0)
    return rig


def _fit(
    pairs: Pairs, rig: Rig, z_coupling: bool, known: Compensation,
    given: Mapping[str, tuple[float, float]],
) -> tuple[Problem, Estimate]:  # fmt: skip
    names = estimation.names_of(rig.tilt, rig.accelerometers, z_coupling)
    problem = estimation.build(pairs, rig, names, _prior(names, given), known)
    estimate = estimation.fit(problem)
    if rig.heading_sd and rig.tilt == "one axis":  # what wrong headings do depends on the tilt
        table = estimate.state.table[:4]
        problem = estimation.build(pairs, rig, names, _prior(names, given), known, table)
        estimate = estimation.fit(problem)
    return problem, estimate


def _noise(
    dwells: Dwells, pairs: Pairs, rig: Rig, known: Compensation,
    given: Mapping[str, tuple[float, float]],
) -> ImuNoise:  # fmt: skip
    """Measure the noise by what the calibration leaves."""
    _, estimate = _fit(pairs, rig, rig.tilt == "each", known, given)
    found = from_residuals(pairs, dwells.accel is not None, evidence.squares(estimate, pairs))
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

    Parameters
    ----------
    settings : Settings
        Usual sizes of their errors.
    prior : mapping of str to (float, float)
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    usual = {
        "accel.bias": (0.0, settings.accel_bias_sd),
        "accel.scale": (0.0, settings.accel_scale_sd),
        "accel.misalignment": (0.0, settings.accel_misalignment_sd),
    }
    given = {name.rpartition(".")[0] for name in prior} | set(prior)
    return {k: v for k, v in usual.items() if v[1] > 0 and k not in given} | dict(prior)


def _held(given: Mapping[str, tuple[float, float]]) -> CoefficientVector:
    """Return what is known of the accelerometers beforehand."""
    names = [n for n in SEEKER.names if n.startswith("accel.")]
    vector = _prior(tuple(names), given)
    if vector is None:
        return CoefficientVector.zeros(SEEKER.subset(()))
    keep = np.flatnonzero(np.isfinite(vector.prior_sd))
    layout = SEEKER.subset(names[i] for i in keep)
    return CoefficientVector(layout, vector.values[keep], np.diag(vector.prior_sd[keep] ** 2))


def _result(s: _Solution, dwells: Dwells, settings: Settings, site: Site) -> Result:
    checks = evidence.checks(s.pairs, s.rig, s.problem, s.estimate, s.source)
    headings = shown.heading_table(s.estimate, s.pairs, s.rig, dwells)
    return Result(
        procedure="north_seeking",
        coefficients=s.estimate.coefficients,
        equation=EQUATION,
        frame=FRAME,
        gauge=GAUGES[s.rig.tilt],
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(
            *dwells.findings,
            *s.findings,
            *evidence.suspicious(s.estimate, site.latitude or 0.0),
            *evidence.findings(s.problem, s.estimate, dwells, s.source),
        ),
        status=s.estimate.status,
        site=site.as_dict(),
        diagnostics={
            "iterations": s.estimate.iterations,
            "noise": {"source": s.source} | noise_json(s.noise),
            "chi_square": evidence.chi_square(s.estimate, s.pairs),
            "budget": shown.budget(s.problem, s.estimate, s.pairs, s.rig),
            "unseen": shown.unseen(s.rig, s.estimate.coefficients.names),
            "table": shown.table_json(s.estimate, s.rig),
            "circle_accuracy": {
                when: shown.circle_accuracy(headings[f"heading_{when}"])
                for when in ("before", "after")
            },
            "stop_offsets": s.stop_offsets,
            "gyro_offset": float(np.median(s.pairs.offset)),
            "drift": settings.drift if not s.nuisance.drift_sd else "estimated",
            "z_coupling": None if s.z_test is None else list(s.z_test),
            **shown.bound(_noise_alone(s), s.estimate),
        },
        tables={"headings": headings},
    )


def _noise_alone(s: _Solution) -> Problem:
    """The problem as it would be with a perfect table: what bounds any method."""
    rig = replace(s.rig, heading_sd=0.0, heading_offset_sd=0.0, latitude_sd=0.0)
    return estimation.build(s.pairs.noise_alone, rig, s.problem.layout.names)


def _validity(log: IndexedLog, dwells: Dwells, s: _Solution) -> dict[str, Any]:
    tilt = np.degrees(np.abs(estimation.tilts(s.pairs, s.rig.site.gravity, Compensation())).max())
    out: dict[str, Any] = {
        "gyro": [float(dwells.gyro.min()), float(dwells.gyro.max())],
        "index": sorted({round(float(np.degrees(a)) % 360.0, 1) % 360.0 for a in dwells.index}),
        "tilt": float(tilt) if s.rig.accelerometers else None,
    }
    if log.temperature is not None:
        out["temperature"] = [float(log.temperature.min()), float(log.temperature.max())]
        out["temperature_mean"] = float(log.temperature.mean())
    return out
