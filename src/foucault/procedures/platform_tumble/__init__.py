"""Calibrate and align a torqued cluster at once, from one continuous rotation: platform tumble.

Turn the cluster slowly through the field of gravity by a known command and log command and
accelerometers. Drift, torquer scale factors and misalignments of the gyros turn gravity where the
command did not; with the errors of the accelerometers and the attitude that is 45 unknowns, which
one filter finds together.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.detect.noise import without_spikes
from foucault.diagnose import left_out
from foucault.diagnose import tumble as judge
from foucault.diagnose.comparable import of_site
from foucault.errors import Finding
from foucault.estimate.tumble_solution import Solution
from foucault.guard import command
from foucault.infer.left_out import Judgement
from foucault.models.cluster import EQUATION, LAYOUT
from foucault.models.earth import Site
from foucault.plans.tumble import nominal
from foucault.procedures.left_out import told_beside
from foucault.procedures.platform_tumble import settings as chosen
from foucault.procedures.platform_tumble.counted import counted
from foucault.procedures.platform_tumble.foresight import (
    Wanted,
    foresee,
    noise_of,
    prior_of,
    solved,
    space,
    tumble_of,
)
from foucault.procedures.platform_tumble.settings import (
    GRADE,
    NOISE,
    Session,
    Settings,
    draw_errors,
    drawn,
    simulated,
)
from foucault.procedures.record import Given, Procedure
from foucault.result import Result, Verdict
from foucault.tables import Log, range_below_g

FRAME = "cluster axes p; attitude: outer, middle, inner angle from North-Up-East"
GAUGE = "x accelerometer input axis, y in the x-y accelerometer plane"

MOMENTS = 120  # In so many moments the estimate is kept for its course in time [1].


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, shown = given.site, given.settings, given.shown
    given.progress(0.1, "looking at the log")
    log = without_spikes(
        log, most=0
    )  # rows that are lost; what is small is weighed with the others
    told = _look(log, site, settings)
    used, said = noise_of(log, given.noise)
    tumble, more = tumble_of(log, site, settings, used)
    beforehand = prior_of(settings, site, given.prior)
    given.progress(0.3, "calibrating")
    moments = MOMENTS if shown else 0
    measured = "tumble.measured" in {f.code for f in said}
    solution = solved(tumble, beforehand, settings, site, used, moments=moments, measured=measured)
    judged = None
    if sizes := told_beside(given.sizes, used, float(np.ptp(log.time))):
        given.progress(0.6, "counting with what is not estimated")
        beside = counted(solution, sizes, measured=measured, moments=moments)
        solution, judged = (solution, None) if beside is None else beside
    given.progress(0.8, "judging the result")
    result = _result(solution, settings.filter, shown, judged)
    return replace(
        result,
        findings=(*log.findings, *told, *said, *more, *result.findings),
        validity=range_below_g(log, site.gravity),
    )


# -- the log ---------------------------------------------------------------------------------


def _look(log: Log, site: Site, settings: Settings) -> list[Finding]:
    """Refuse what cannot be right; say what is doubtful."""
    command.require_readings(log, site, settings.rate_limit)
    command.require_gravity(log, site, settings.angles)
    from_its_time = settings.held(log.sampled) == "from its time"
    told = command.motion_findings(log, from_its_time, settings.delay_sd)
    told += judge.gap_findings(log)
    plan, each = settings.torquing, None
    if plan is not None:
        assert site.latitude is not None
        expected = nominal(plan, site.latitude)
        told += judge.plan_findings(log, plan, expected, from_its_time)
        each = nominal(plan, site.latitude, log.interval)
    return [*told, *judge.held_findings(log, each, from_its_time)]


def _result(s: Solution, filter_: str, shown: bool, judged: Judgement | None) -> Result:
    found, checks = s.coefficients, judge.checks(s)
    tables = judge.tables(s) if shown else {}
    budget = {k: np.diag(v).tolist() for k, v in s.parts.items()}
    more: dict[str, Any] = {
        "bound": s.bound.tolist(), "budget": budget, "filter": filter_,
        "unseen": [_of_latitude(s), *judge.unnoticed(s)],
    }  # fmt: skip
    if "local gravity" in s.parts:
        error = _one_error(s.parts["local gravity"], found.names.index("accel.scale.x"))
        more |= of_site(s.site.as_dict(), found.names, error)
    if shown:
        more["observability"] = judge.observability_json(s)
    if judged is not None:
        checks = (*checks, *left_out.checks(judged))
        tables = {**tables, "left_out": left_out.table(judged)}
        more |= left_out.judgement_json(judged)
    return Result(
        procedure="platform_tumble",
        coefficients=found,
        equation=EQUATION,
        frame=FRAME,
        gauge=GAUGE,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*s.findings, *judge.findings(s)),
        status=s.fit.status,
        site=s.site.as_dict(),
        diagnostics=judge.diagnostics(s) | more,
        tables=tables,
    )


def _of_latitude(s: Solution) -> str:
    """Say what a wrong latitude does: to a cluster it is a drift, and no plan tells them apart."""
    part, sd = s.parts.get("latitude"), s.latitude_sd
    if part is None:
        return "A wrong latitude: 0.01 deg is an error of the Earth's rate of 0.003 deg/h."
    c, moved = s.coefficients, np.sqrt(np.diag(part))
    beside = np.sqrt(np.maximum(c.sd**2 - moved**2, np.finfo(float).tiny))
    k = int(np.argmax(moved / beside))
    moved, one = np.radians(0.01) / sd * moved, c.layout.coefficients[k]
    unit = units.display_unit(one.kind, moved[k])
    return (
        "A wrong latitude: no residual tells it from errors of the gyros. 0.01 deg moves "
        f"{one.name} by {units.plain(units.convert(moved[k], one.kind, unit), 2)} {unit}, "
        f"{units.plain(moved[k] / beside[k], 2)} of its standard deviations without it. It counts "
        f"with latitude_sd, {units.plain(np.degrees(sd), 2)} deg here."
    )


def _one_error(cov: FloatArray, k: int) -> FloatArray:
    """Return the error that a covariance of rank one is of; that of number `k` is negative."""
    return np.asarray(-cov[:, k] / np.sqrt(cov[k, k]))


PROCEDURE = Procedure(
    name="platform_tumble",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda settings, _session, _site: settings.planned,
    simulation=simulated,
    names=lambda *_: LAYOUT.names,
    layout=LAYOUT,
    counts=True,
    counts_by_noise=True,
    foresee=foresee,
    space=space,
    Wanted=Wanted,
    grade=GRADE,
    noise=NOISE,
    draw_errors=draw_errors,
    drawn=drawn,
    otherwise=chosen.OTHERWISE,
    Description=chosen.Description,
    read=chosen.read_log,
    log_table=chosen.log_table,
    noise_lines=chosen.NOISE_LINES,
    prior_lines=chosen.PRIOR_LINES,
    errors_line=chosen.ERRORS_LINE,
)
calibrate, simulate, trial = PROCEDURE.calibrate, PROCEDURE.simulate, PROCEDURE.trial
