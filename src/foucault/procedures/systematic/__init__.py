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

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.detect.noise import without_spikes
from foucault.diagnose import deflection as deflection_verdict
from foucault.diagnose import left_out as not_estimated
from foucault.diagnose import systematic as judge
from foucault.diagnose import systematic_sequence as recordings
from foucault.diagnose.comparable import of_site
from foucault.diagnose.systematic import legs_of
from foucault.errors import FoucaultError, doubting, error
from foucault.infer.linear_filter import Shock
from foucault.models.imu import FULL_EQUATION, SIZE_EQUATION, Gauge
from foucault.models.layouts import gravity_error, with_references
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import EarthSeen, FilterRun, earth_seen
from foucault.procedures.left_out import told_beside
from foucault.procedures.record import Given, Procedure
from foucault.procedures.systematic.choice import Decided, decided, left_out, resumed
from foucault.procedures.systematic.counted import FOLLOWED, counted, heading_sd
from foucault.procedures.systematic.plan import Wanted, bound, foresee, space
from foucault.procedures.systematic.problem import (
    Solution,
    SystematicProblem,
    as_parameters,
    named,
    navigation_tests,
    prior_of,
    public,
    steady,
)
from foucault.procedures.systematic.settings import (
    GRADE,
    LAYOUT,
    PRIOR_LINES,
    Session,
    Settings,
    draw_errors,
    drawn,
    log_table,
    planned,
    simulated,
)
from foucault.result import Result, TableData, Verdict
from foucault.tables import Log, range_below_g

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


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, shown, progress = given.site, given.settings, given.shown, given.progress
    prior = as_parameters(given.prior, settings)
    progress(0.1, "calibrating")
    log = without_spikes(log)
    decision = _calmed(
        log, lambda log: decided(log, site, settings, given.noise, prior, compare=shown)
    )
    problem, settings, solution, choice = (
        decision.problem, decision.settings, decision.solution, decision.choice
    )  # fmt: skip
    base, judged = solution, None
    parts = dict[str, Any]()
    sizes = told_beside(given.sizes, problem.noise, float(np.ptp(log.time)))
    if sizes and settings.steps != "published":
        progress(0.4, "counting with what is not estimated")
        with doubting(problem.findings):
            decision, states, judged, parts = counted(decision, sizes, prior)
        solution = replace(solution, run=decision.solution.run, states=states,
                           status=decision.solution.status)  # fmt: skip
    progress(0.6, "navigating from rest to rest")
    p, run = problem, solution.run
    legs = legs_of(decision.problem.model, run)
    known = recordings.lasting(steady(p).prior)
    usual = recordings.lasting(prior_of(steady(p).sensors, {})).prior_sd
    e = judge.Evidence(p.increments, p.rests, run, recordings.lasting(solution.states),
                       known.values, usual, legs, solution.status, p.seen,
                       _earth(decision))  # fmt: skip
    checks = judge.checks(e)
    apart = _between(decision)
    if apart:
        checks = (*checks, recordings.recordings_check(apart))
    if choice is not None:
        checks = (*checks, deflection_verdict.deflection_check(choice))
    found = public(solution, settings)
    tables: dict[str, TableData] = {}
    if judged is not None:
        checks = (*checks, *not_estimated.checks(judged),
                  judge.followed(heading_sd(sizes or {}, site, found.names), FOLLOWED))  # fmt: skip
    findings = [*log.findings, *problem.findings, *decision.findings, *judge.findings(e)]
    findings += [recordings.told(apart)] if apart else []
    diagnostics = _diagnostics(problem, solution, settings) | of_site(
        site.as_dict(), found.names, gravity_error(found, site))  # fmt: skip
    diagnostics["unseen"] += judge.unnoticed(e)
    if apart:
        times = [(float(part.time[0]), float(part.time[-1])) for _, part in log.recordings()]
        diagnostics["recordings"] = recordings.summary(solution.states, apart, times)
    if choice is not None:
        diagnostics["choice"] = deflection_verdict.summary(choice)
    if shown:
        if judged is None:
            progress(0.7, "looking for what was left out")
            told, more = left_out(decision, prior)
            if any(not c.passed for c in more):  # it looks a little like a change at once
                checks = tuple(c for c in checks if c.passed or c.name != "shifts")
            findings, checks = [*findings, *told], (*checks, *more)
        progress(0.8, "navigating a test with it and without")
        tests, tilts = navigation_tests(found, site, settings.model)
        tables = {**judge.tables(e, problem.numbers), "navigation": tests}
        diagnostics |= {"navigation": tilts} | bound(problem, base, settings)
    if judged is not None:
        tables = {**tables, "left_out": not_estimated.table(judged)}
        diagnostics |= not_estimated.judgement_json(judged)
        if settings.model is None:  # else the coefficients follow from the states
            at = [solution.states.names.index(name) for name in found.names]
            rows = {n: [v[k] for k in at] for n, v in parts["budget"].items()}
            diagnostics |= {"budget": rows, "sources": parts["sources"]}
    return Result(
        procedure="systematic",
        # Where gravity is a state the covariance knows it already.
        coefficients=with_references(found, site) if judged is None else found,
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


PLACES, LONGEST = 3, 5.0
"""What is left out of rests is so many moments at most [1], none of them longer [s]."""


def _calmed(log: Log, decide: Callable[[Log], Decided]) -> Decided:
    """Leave out moments of rests in which the accelerometers read what was no motion.

    Each parts a rest in two, as one that is seen in the readings does. That is believed only where
    nothing changes at once without them.
    """
    first = now = decide(log)
    for _ in range(PLACES):
        at, spans = _knocked(now), now.problem.found.rests.spans
        time, each = now.problem.increments.time, now.problem.at_rest.interval
        rests = [(float(time[a]), float(time[b - 1])) for a, b in spans]
        knocked = next((rest for rest in rests if at is not None and rest[0] < at < rest[1]), None)
        if at is None or knocked is None:
            break
        for k in range(1, round(LONGEST / each / 2) + 1):  # its ends, too
            begin, end = at - (k + 1) * each, at + k * each
            parts = [rest for rest in rests if rest != knocked]
            parts += [rest for rest in ((knocked[0], begin), (end, knocked[1]))
                      if rest[1] - rest[0] >= now.settings.shortest]  # fmt: skip
            try:
                now = decide(replace(log, rests=tuple(sorted(parts))))
            except FoucaultError:  # too little is left of the first rest
                return first
            still = _knocked(now)
            if still is None or not begin - each <= still <= end + each:
                break
    if now is first or any(one.square > one.limit for one in _shifts(now).values()):
        return first
    told = [f for f in now.problem.findings if f.code != "rest.said" or log.rests is not None]
    return replace(now, problem=replace(now.problem, findings=tuple(told)))


def _shifts(now: Decided) -> dict[str, Shock]:
    return judge.shifts_of(now.solution.run, len(now.problem.rests), now.solution.status)


def _knocked(now: Decided) -> float | None:
    """Return when the accelerometers seem to have read for a moment what was no motion [s]."""
    shifts = _shifts(now)
    if not shifts or "velocity" not in judge.alike_of(shifts):
        return None
    one = shifts["velocity"]
    return float(now.solution.run.time[one.epoch]) if one.square > one.limit else None


def _earth(decision: Decided) -> EarthSeen | None:
    """Return what the session says of the Earth's rate, where its one filter can tell."""
    p, found = decision.problem, decision.solution
    if decision.settings.steps == "published" or not p.noise.gyro.white > 0:
        return None
    assert p.site.latitude is not None

    def filtered(increments: Increments) -> FilterRun:
        return resumed(replace(p, increments=increments), found, found.states.names, keep=False).run

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
        "unseen": judge.unseen(p.site, settings.restarts),
    }  # fmt: skip


PROCEDURE = Procedure(
    name="systematic",
    doc=__doc__,
    by_rests=True,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda settings, session, _: planned(settings, session),
    simulation=simulated,
    names=lambda settings, _: names_of(settings),
    every_name=every_name,
    layout=LAYOUT,
    counts=True,
    counts_by_noise=True,
    foresee=foresee,
    space=space,
    Wanted=Wanted,
    assumes_noise=True,
    grade=GRADE,
    draw_errors=draw_errors,
    drawn=drawn,
    more="recordings",
    log_table=log_table,
    prior_lines=PRIOR_LINES,
)
calibrate, simulate, trial = PROCEDURE.calibrate, PROCEDURE.simulate, PROCEDURE.trial
