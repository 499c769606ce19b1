"""Navigate a log, and say in metres what its calibration is worth.

Compensate, align at the start, navigate to the end, with and without the calibration; compare with
a reference or with the known site; propagate what each coefficient and the noise contribute.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.noise import KNOCKS, without_spikes
from foucault.diagnose import navigation as reference_checks
from foucault.diagnose.navigation import (
    Budget,
    Growth,
    NavigationError,
    covered,
    error_of,
    growth,
)
from foucault.diagnose.schuler import SchulerFit
from foucault.errors import Finding, error, finding, require
from foucault.logs.reference import Reference
from foucault.models.earth import Site
from foucault.models.layouts import is_imu, of_sensors
from foucault.models.noise import ImuNoise, noise_of
from foucault.navigate.increments import increments_of, navigable, require_readings, require_sound
from foucault.navigate.strapdown import Trajectory
from foucault.procedures import Progress, silent
from foucault.procedures.navigation import run as places
from foucault.procedures.navigation.run import Made, Task, without
from foucault.procedures.navigation.start import Opening, Settings, Start, opening
from foucault.result import Check, Level, Result, Verdict, provenance
from foucault.tables import Log
from foucault.units import plain


@dataclass(frozen=True)
class Run:
    """One navigation of the log."""

    name: str  # with calibration, without calibration, or as measured
    start: Start
    trajectory: Trajectory  # thinned to the rate that is kept
    errors: NavigationError | None
    growth: tuple[Growth, ...]  # the error at some ages
    schuler: SchulerFit | None  # terms of free inertial drift, of a run that stood still


@dataclass(frozen=True)
class NavigationTest:
    """What navigating a log has shown."""

    runs: tuple[Run, ...]  # the one that counts first, then that without the calibration
    reference: Reference | None  # what they were compared with
    budget: Budget  # what coefficients, alignment and noise contribute to the first run
    # (m, 3) position without minus with the calibration at the epochs of the budget, E N U [m]
    difference: FloatArray | None
    opening: Opening  # the rest at the start
    settings: Settings  # what was chosen, the vertical channel included
    site: Site
    longitude: float  # of the start [rad]
    noise: ImuNoise  # noise that was taken [SI]
    # "declared", "declared, raised to that of the rest", "measured in the rest", "of the
    # calibration" or "none"
    noise_source: str
    calibration: dict[str, Any]  # instrument, date and verdict; empty without one
    coefficients: CoefficientVector | None  # those of the calibration
    stationary: str  # why no terms of free inertial drift were fitted; empty where they were
    checks: tuple[Check, ...]  # tests of the first run
    verdict: Verdict  # what they say together
    findings: tuple[Finding, ...]
    instrument: dict[str, Any]  # name, serial and so on
    provenance: dict[str, Any]  # versions, input, date, duration


def navigate_log(
    log: Log,
    *,
    site: Site | None = None,
    longitude: float = 0.0,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    calibration: Result | None = None,
    reference: Reference | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> NavigationTest:
    """Navigate a log with and without its calibration.

    Parameters
    ----------
    log : Log
        Readings as measured: a rest, then a rest still or motion [SI].
    site : Site or None
        Where it started; None takes normal gravity at the start of the reference.
    longitude : float
        Of the start [rad].
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the sensors [SI]; None measures it in the rest.
    calibration : Result or None
        Of this instrument.
    reference : Reference or None
        What is known of the trajectory; None: the known site, where the log never moves.
    instrument : mapping or None
        Name, serial and so on.
    progress : callable
        Called with the fraction done and what is being done.

    Raises
    ------
    FoucaultError
        No latitude, no rest or heading to start with, a gap, a reference of another time: see
        `foucault.symptoms`.
    """
    began = clock.monotonic()
    for name, given, kind in (
        ("site", site, Site), ("settings", settings, Settings), ("noise", noise, ImuNoise),
        ("calibration", calibration, Result), ("reference", reference, Reference),
    ):  # fmt: skip
        require(name, given, kind, none=True)
    require("longitude", longitude, Real)
    navigable(log, fewest=3)
    settings, about = settings or Settings(), dict(instrument or {})
    part = _part(log, settings)
    require_sound(part)
    part = without_spikes(part, most=KNOCKS)
    told = (*part.findings, *_calibration(calibration, about))
    increments_of(part, gaps=settings.gaps)  # refuses what cannot be navigated at all
    require_readings(part)
    progress(0.1, "finding the rest")
    seen = opening(part, settings, noise)
    if reference is not None:
        covered(reference, seen.end, float(part.time[-1]))
        places.resting(reference, seen)
    given = site
    site, place = places.place_of(site, longitude, reference, seen, settings.position_sd)
    reference = places.reference_of(reference, part, seen, settings, site, longitude)
    vertical = places.vertical_of(settings, reference)
    settings = settings.model_copy(update={"vertical": vertical})
    noise, source = _noise(noise, seen, calibration)
    if source == "none":
        told += (finding("navigate.no_noise"),)
    elif seen.noise is not None and (
        noise.accel is seen.noise.accel or noise.gyro is seen.noise.gyro
    ):
        told += seen.told
    told += (finding("navigate.no_reference"),) if reference is None else ()
    task = Task(part, site, place, settings, seen, noise, reference)
    progress(0.2, "aligning and navigating")
    main = Made.of(task, calibration)
    told += places.pushed(settings, main.trajectory)
    runs = [main]
    also: list[Finding] = []
    if calibration is not None:
        progress(0.5, "navigating without the calibration")
        other, also = without(task, main)
        runs += [] if other is None else [other]
    progress(0.7, "propagating the errors of each coefficient")
    vector = None if calibration is None else of_sensors(calibration.coefficients)
    budget = places.budget_of(task, main, vector)
    difference = _difference(runs, budget.time)
    checks = places.checks(main.errors, budget, source, calibration is not None)
    first = () if seen.against is None else (seen.against.check,)
    checks = (checks[0], *first, *places.rest_check(task, main, vector), *checks[1:])
    if main.errors is not None and reference is not None:
        told += reference_checks.course(main.errors, reference)
        told += reference_checks.clock(main.errors, reference)
    why = places.not_stationary(reference, main.trajectory, main.errors)
    progress(1.0, "done")
    also += places.latitude_told(given, place, main.told)
    return NavigationTest(
        tuple(_kept(task, made, why) for made in runs), reference, budget, difference, seen,
        settings, site, place[1], noise, source, _about(calibration), vector, why, checks,
        Verdict.of(checks), _once(*told, *main.told, *also), about,
        provenance(log.source, clock.monotonic() - began),
    )  # fmt: skip


def _part(log: Log, settings: Settings) -> Log:
    if settings.start is None and settings.end is None:
        return log
    begin = float(log.time[0])
    start, end = settings.start or 0.0, log.duration if settings.end is None else settings.end
    if not 0 <= start < end or start >= log.duration:
        raise error("navigate.span", start=plain(start), end=plain(end),
                    duration=plain(log.duration))  # fmt: skip
    rows = np.searchsorted(log.time, [begin + start, begin + end + 0.5 * log.interval])
    return log[int(rows[0]) : int(rows[1])]


def _noise(
    declared: ImuNoise | None, seen: Opening, calibration: Result | None
) -> tuple[ImuNoise, str]:
    if declared is not None:
        at_rest = seen.against
        used = declared if at_rest is None else at_rest.noise
        more = used is not declared and used != declared
        return _filled(
            used, seen.noise
        ), "declared, raised to that of the rest" if more else "declared"
    if seen.noise is not None:
        return seen.noise, "measured in the rest"
    said = {} if calibration is None else calibration.diagnostics.get("noise") or {}
    found = noise_of(said) if "gyro_bias_instability" in said else None
    return (ImuNoise(), "none") if found is None else (found, "of the calibration")


def _filled(declared: ImuNoise, measured: ImuNoise | None) -> ImuNoise:
    """Return the noise with what was not declared as measured."""
    if measured is None:
        return declared
    triads = {
        name: getattr(declared if getattr(declared, name).white > 0 else measured, name)
        for name in ("accel", "gyro")
    }
    return ImuNoise(**triads)


def _calibration(result: Result | None, about: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Refuse a calibration of something else; say what is doubtful about it."""
    if result is None:
        return (finding("navigate.no_calibration"),)
    if not is_imu(result.coefficients):
        file = str(result.provenance.get("file", "the calibration"))
        raise error("navigate.not_imu", file=file, given=result.procedure)
    told: tuple[Finding, ...] = ()
    serial, mine = (str(d.get("serial") or "") for d in (result.instrument, about))
    if serial and mine and serial != mine:
        raise error("navigate.other_serial", given=mine, other=serial)
    if serial and not mine:
        told += (finding("navigate.whose", serial=serial),)
    if result.verdict.level is not Level.PASS:
        reason = next(iter(result.verdict.reasons), "no reason given.")
        level = result.verdict.level.value
        told += (finding("navigate.calibration_doubtful", level=level, reason=reason),)
    if result.coefficients.cov is None:
        told += (finding("navigate.no_cov"),)
    return told


def _about(calibration: Result | None) -> dict[str, Any]:
    if calibration is None:
        return {}
    return {
        "procedure": calibration.procedure,
        "instrument": dict(calibration.instrument),
        "created": calibration.provenance.get("created"),
        "verdict": calibration.verdict.level.value,
        "site": dict(calibration.site),
        "coefficients": len(calibration.coefficients),
    }


def _once(*findings: Finding) -> tuple[Finding, ...]:
    """Return findings without those that say the same again."""
    return tuple({(f.code, f.message): f for f in findings}.values())


def _difference(runs: list[Made], time: FloatArray) -> FloatArray | None:
    """Return the position of the second run minus that of the first at some epochs."""
    if len(runs) < 2:
        return None
    first = runs[0].trajectory
    i = np.searchsorted(first.time, time)
    some = replace(first, time=first.time[i], history=first.history[i])
    position = np.column_stack([some.latitude, some.longitude, some.height])
    return error_of(runs[1].trajectory, Reference(some.time, position)).position


def _kept(task: Task, made: Made, why: str) -> Run:
    """Thin a run to what is kept of it."""
    step = max(1, round(1 / (task.settings.rate * made.log.interval)))
    rows = () if made.errors is None else growth(made.errors)
    fit = None if why else places.schuler_of(task.site, made.errors, task.noise)
    return Run(made.name, made.start, made.trajectory.every(step), made.errors, rows, fit)
