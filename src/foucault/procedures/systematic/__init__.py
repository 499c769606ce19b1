"""Calibrate an IMU on a table whose angles nobody knows, from its velocity at rest alone.

The instrument navigates through turns and rests. At rest its velocity is zero and its place that of
the site; what the navigator says instead is what all its errors have done, each through the motion
as it was. One filter finds them together: biases, scale factors, misalignments, the asymmetry of
the accelerometers, and where wanted quadratic terms, lever arms, a delay, and how dithered gyros
bend under specific force.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", *Navigation and Control* 2023(5), eqs. (13)-(19).
.. [2] Xie Bo, "Multi-position systematic calibration for a laser strapdown inertial measurement
   unit", thesis, National University of Defense Technology, 2011.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.diagnose.compare.gravity import of_site
from foucault.diagnose.spikes import without_spikes
from foucault.diagnose.systematic import checks as judge
from foucault.diagnose.systematic import deflection_verdict, recordings
from foucault.diagnose.systematic import report as systematic_report
from foucault.diagnose.systematic.legs import legs_of
from foucault.diagnose.time_base import with_clock
from foucault.errors import error
from foucault.estimate.earth_seen import EarthSeen, earth_seen
from foucault.estimate.ins_filter import FilterRun
from foucault.models.earth import Site
from foucault.models.imu import FULL_EQUATION, SIZE_EQUATION, Gauge
from foucault.models.noise import ImuNoise
from foucault.models.references import gravity_error, with_references
from foucault.navigate.increments import Increments
from foucault.procedures import Progress, silent
from foucault.procedures.systematic.bound import bound
from foucault.procedures.systematic.choice import Decided, decided, resumed
from foucault.procedures.systematic.foresight import foresee as foresee
from foucault.procedures.systematic.left_out import left_out
from foucault.procedures.systematic.log import log_table as log_table
from foucault.procedures.systematic.navigation import navigation_tests
from foucault.procedures.systematic.plan import Wanted as Wanted
from foucault.procedures.systematic.plan import space as space
from foucault.procedures.systematic.problem import (
    SystematicProblem,
    as_parameters,
    prior_of,
    steady,
)
from foucault.procedures.systematic.settings import LAYOUT as LAYOUT
from foucault.procedures.systematic.settings import PRIOR_LINES as PRIOR_LINES
from foucault.procedures.systematic.settings import SIMULATE as SIMULATE
from foucault.procedures.systematic.settings import Session as Session
from foucault.procedures.systematic.settings import Settings as Settings
from foucault.procedures.systematic.settings import draw_errors as draw_errors
from foucault.procedures.systematic.settings import simulate as simulate
from foucault.procedures.systematic.solution import Solution, named, public
from foucault.result import Result, TableData, Verdict, provenance
from foucault.tables import Log, range_below_g

RECORDINGS = True
"""Further files of a log are recordings of their own, each with biases of its own."""

UNDECLARED = True
"""A plan is judged with the noise that is typical where none is declared."""

FORESEES_WANTED = True
"""`foresee` is told what is wanted of a plan."""

FRAME = "body axes, as the accelerometers define them (see gauge)"


def names_of(settings: Settings) -> tuple[str, ...]:
    """Return the coefficients of the result that do not follow from others.

    A model of deflection makes more coefficients than it has parameters: of each parameter one is
    named here.
    """
    if settings.deflection == "choose":
        raise error("systematic.choice_study")
    model = settings.model
    deflections = [] if model is None else [
        model.names[int(np.flatnonzero(column)[0])] for column in model.slope.T
    ]  # fmt: skip
    return named(settings.sensors.layout.names, deflections)


def every_name(settings: Settings) -> tuple[str, ...]:
    """Return all coefficients of the result, those too that follow from others."""
    model = settings.model
    return named(settings.sensors.layout.names, () if model is None else model.names)


def calibrate(
    log: Log,
    *,
    site: Site,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Result:
    """Calibrate an IMU from its velocity at rest.

    Parameters
    ----------
    log : Log
        Readings of both triads [SI].
    site : Site
        Where it stood; the latitude must be known.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the instrument [SI]; None measures it in the rests.
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
        No latitude, a log that is not of the sequence, a session too short, a model of deflection
        that it cannot see: see `foucault.symptoms`.
    """
    started = clock.monotonic()
    settings = settings or Settings()
    arguments = (log, site, settings, noise, as_parameters(prior or {}, settings), progress)
    result = _calibrate(*arguments, shown=True)
    progress(1.0, "done")
    seconds = clock.monotonic() - started
    result = replace(result, instrument=dict(instrument or {}),
                     provenance=provenance(log.source, seconds))  # fmt: skip
    return with_clock(result, log.clock, turned=True, summed=log.sampled == "increment")


def trial(
    log: Log,
    *,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Result:
    """Calibrate without what only a report shows: one trial of many.

    `log`: readings of both triads [SI]; `site`: where it stood, the latitude must be known;
    `noise` or None: noise of the instrument [SI]; `prior` or None: mean and standard deviation of
    coefficients or groups of coefficients [SI].
    """
    given = as_parameters(prior or {}, settings)
    return _calibrate(log, site, settings, noise, given, silent, shown=False)


def _calibrate(
    log: Log, site: Site, settings: Settings, noise: ImuNoise | None,
    given: Mapping[str, tuple[float, float]], progress: Progress, *, shown: bool,
) -> Result:  # fmt: skip
    progress(0.1, "calibrating")
    log = without_spikes(log)
    decision = decided(log, site, settings, noise, given, compare=shown)
    problem, settings, solution, choice = (
        decision.problem, decision.settings, decision.solution, decision.choice
    )  # fmt: skip
    progress(0.6, "navigating from rest to rest")
    p, run = problem, solution.run
    legs = legs_of(p.increments, p.rests, site, run, p.noise, p.at_rest)
    known = recordings.lasting(steady(p).prior)
    usual = recordings.lasting(prior_of(steady(p).sensors, {})).prior_sd
    e = judge.Evidence(p.increments, p.rests, run, recordings.lasting(solution.states),
                       known.values, usual, legs, solution.status, p.seen,
                       _earth(decision))  # fmt: skip
    checks = judge.checks(e)
    apart = _between(decision)
    if apart:
        checks = (*checks, recordings.check(apart))
    if choice is not None:
        checks = (*checks, deflection_verdict.check(choice))
    found = public(solution, settings)
    tables: dict[str, TableData] = {}
    findings = [*log.findings, *problem.findings, *decision.findings, *judge.findings(e)]
    findings += [recordings.told(apart)] if apart else []
    diagnostics = _diagnostics(problem, solution, settings) | of_site(
        site.as_dict(), found.names, gravity_error(found, site))  # fmt: skip
    if apart:
        times = [(float(part.time[0]), float(part.time[-1])) for _, part in log.recordings()]
        diagnostics["recordings"] = recordings.summary(solution.states, apart, times)
    if choice is not None:
        diagnostics["choice"] = deflection_verdict.summary(choice)
    if shown:
        progress(0.7, "looking for what was left out")
        told, more = left_out(decision, given)
        findings, checks = [*findings, *told], (*checks, *more)
        progress(0.8, "navigating a test with it and without")
        tests, tilts = navigation_tests(found, site, settings.model)
        tables = {**systematic_report.tables(e, problem.numbers), "navigation": tests}
        diagnostics |= {"navigation": tilts} | bound(problem, solution, settings)
    return Result(
        procedure="systematic",
        coefficients=with_references(found, site),
        equation=SIZE_EQUATION if settings.lever_arms or settings.delay else FULL_EQUATION,
        frame=FRAME,
        gauge=Gauge.LOWER.value,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=tuple(findings),
        status=solution.status,
        site=site.as_dict(),
        validity=range_below_g(log, site.gravity),
        diagnostics=diagnostics,
        tables=tables,
    )


def _earth(decision: Decided) -> EarthSeen | None:
    """Return what the session says of the Earth's rate, where its one filter can tell."""
    p, found = decision.problem, decision.solution
    if decision.settings.steps == "published" or not p.noise.gyro.white > 0:
        return None
    assert p.site.latitude is not None

    def filtered(increments: Increments) -> FilterRun:
        return resumed(replace(p, increments=increments), found, found.states.names).run

    return earth_seen(filtered, p.increments, p.site.latitude)


def _between(decision: Decided) -> list[recordings.Between]:
    """Return what the biases of the recordings differ by, where there are more than one."""
    count, states = decision.problem.recordings, decision.solution.states
    if count == 1:
        return []
    declared = decision.settings.turn_on.items()
    return [recordings.between(states, triad, sd, count) for triad, sd in declared]


def _diagnostics(p: SystematicProblem, s: Solution, settings: Settings) -> dict[str, Any]:
    plan, labels = settings.plan, [f"rest {k + 1}" for k in p.numbers]
    if p.matched is not None:
        said = dict(zip(p.matched.rests.tolist(), p.matched.positions, strict=True))
        labels = [said[k].label if k in said else f"rest {k + 1}" for k in p.numbers.tolist()]
    start = p.start.angles, p.start.angles_sd
    return {
        "gravity": p.site.gravity,
        "sequence": {
            "name": "as found" if plan is None else plan.name,
            "rests": len(p.rests), "moves": len(p.found.moves), "labels": labels,
        },
        "filter": {
            "steps": settings.steps, "velocity_sd": settings.velocity_sd,
            "position_sd": settings.position_sd, "interval": settings.interval,
            "decorrelate": settings.restarts, "deflection": settings.deflection,
            "chirality": settings.chirality,
        },
        "noise": {
            "measured": p.measured, "accel": p.noise.accel.white, "gyro": p.noise.gyro.white,
        },
        "start": {"angles": start[0].tolist(), "sd": start[1].tolist()},
        "passes": {"names": list(s.states.names), "values": [x.tolist() for x in s.passes]},
        "log_likelihood": s.log_likelihood,
        "unseen": systematic_report.unseen(p.site, settings.restarts),
    }  # fmt: skip
