"""Calibrate a slave IMU in motion against the better INS of its vehicle.

The slave is navigated beside its master, whose messages come late. What the two say of velocity and
attitude at the same instants shows the errors of the slave's gyros and accelerometers, how it is
turned against its nominal mounting, and how late the messages are. Manoeuvres show it: a straight
run hides what an S-turn or a change of speed makes plain.

Tables of the result
--------------------
``innovations``: time; of each of velocity_east, velocity_north, velocity_up, attitude_1..3 [m/s],
[rad] that is used the innovation and ``..._sd``; nis [1]. ``estimates``: time; of each coefficient
of the result its value and ``..._sd`` along the run [SI]. ``undelayed``: the same, had the delay
been ignored. ``smoothed``: time, latitude, longitude
[rad], heading, pitch, roll of the slave, phi_east_sd, phi_north_sd, phi_up_sd [rad]. ``delayed``:
time; what the delay is worth: heading [rad], velocity_east, velocity_north [m/s] of the slave when
a message arrives less those when it held. ``stretches``: what the vehicle did: start, end [s], kind
(straight, accelerated, turning), turn [rad], speed gained [m/s], and ``..._sd`` of every
coefficient at its end [SI]. ``delay_parts``: start, end, delay, delay_sd [s], rate matching in
parts of the log. ``gamma`` (H-infinity): time, margin, the least 1 - l P l' / gamma^2 [1].
``likelihood``: delay [s], log_likelihood [1].

References
----------
.. [1] Y.-C. Lim, J. Lyou, "Transfer alignment error compensator design for nonlinear measurement
   equations with a time delay", *J. Mechanical Science and Technology* 23 (2009).
.. [2] Zhou, Cheng, Lu, "On-line calibration of strapdown INS with delay-compensated H-infinity
   filtering", Southeast University.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import left_out
from foucault.diagnose import transfer as judge
from foucault.diagnose.comparable import of_site
from foucault.diagnose.references import BY_CLOCK
from foucault.diagnose.transfer_motion import of_resolution
from foucault.errors import Finding, error
from foucault.logs.master import MasterDescription
from foucault.models.imu import EQUATION
from foucault.procedures.record import Given, Procedure
from foucault.procedures.transfer_alignment import counted
from foucault.procedures.transfer_alignment import settings as chosen
from foucault.procedures.transfer_alignment.problem import (
    Solution,
    bent,
    clock_slope,
    gravity_error,
    handed_over,
    ignoring_delay,
    noticed,
    problem_of,
    solved,
)
from foucault.procedures.transfer_alignment.session import (
    EVALUATIONS,
    GRADE,
    Session,
    Wanted,
    draw_errors,
    drawn,
    foresee,
    simulated,
    space,
)
from foucault.procedures.transfer_alignment.settings import Settings, SlaveLog, heard, there, usable
from foucault.result import Result, TableData, Verdict
from foucault.tables import Log, ranges

FRAME = "axes of the slave: right, forward, up as it is mounted nominally"
GAUGE = "b is the case of the slave; its axes are taken to be at right angles"


def _solved(log: Log, given: Given[Settings]) -> tuple[Solution, SlaveLog, list[Finding]]:
    """Solve what a log shows; return the log as it was used too, and what is odd about it."""
    if not isinstance(log, SlaveLog):
        raise error("transfer.no_master")
    log = usable(log)
    given.progress(0.1, "matching what both turned")
    settings, silence = heard(log.messages, given.settings)
    site, elsewhere = there(given.site, log.messages)
    sizes = chosen.sized(settings, given.sizes, given.noise, float(np.ptp(log.time)))
    problem = problem_of(log, site, settings, given.noise, given.prior, sizes=sizes)
    given.progress(0.3, "filtering")
    problem = bent(problem) if settings.estimate_flexure else problem
    return solved(problem, history=given.shown), log, [*elsewhere, *silence]


def _solve(log: Log, given: Given[Settings]) -> Result:
    s, log, told = _solved(log, given)
    settings, site = s.problem.settings, s.problem.site.as_dict()
    checks = judge.checks(s)
    error_of_g = gravity_error(s)
    assert s.states.cov is not None
    # Where gravity is a state the covariance knows it already.
    beside = np.zeros_like(error_of_g) if "site.gravity" in s.model.counted else error_of_g
    all_cov = s.states.cov + np.outer(beside, beside)
    at = [s.states.layout.index(name) for name in settings.reported]
    told += [*of_resolution(log, s.model.slave.noise), *noticed(s)]
    tables: dict[str, TableData] = {}
    more: dict[str, Any] = {}
    if given.shown:
        given.progress(0.7, "looking at what was found")
        undelayed = ignoring_delay(s) if settings.delay != "none" else None
        tables = judge.tables(s, settings.reported, s.backward, undelayed)
        more = _budget(s, beside, at)
        more[BY_CLOCK] = clock_slope(s)[at].tolist()
    if s.judged is not None:
        checks = (*checks, *left_out.checks(s.judged))
        tables = {**tables, "left_out": left_out.table(s.judged)}
        more |= left_out.judgement_json(s.judged)
    return Result(
        procedure="transfer_alignment",
        coefficients=replace(s.states, cov=all_cov).chosen(settings.reported),
        equation=EQUATION,
        frame=FRAME,
        gauge=GAUGE,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*log.findings, *told),
        status=s.status,
        site=site,
        validity=ranges(log),
        diagnostics={"start": float(log.time[0])}
        | _diagnostics(log, s)
        | more
        | of_site(site, settings.reported, error_of_g[at]),
        tables=tables,
    )


def _diagnostics(log: SlaveLog, s: Solution) -> dict[str, Any]:
    settings, model, rows = s.problem.settings, s.model, s.states.rows()
    return {
        "gravity": s.problem.site.gravity,
        "matching": settings.matching,
        "filter": _filter(s),
        "bound": model.estimate(s.kalman, s.prior).chosen(settings.reported).sd.tolist(),
        "noise": {"accel": model.slave.noise.accel.white, "gyro": model.slave.noise.gyro.white},
        "delay": _delay(s),
        "hand_over": {"place": "master" if log.messages.has_place else "site"}
        | judge.hand_over(handed_over(s), model.slave.increments),
        "passes": {"names": list(model.names[model.first :]),
                   "values": [x.tolist() for x in s.fit.passes]},
        "log_likelihood": s.fit.run.log_likelihood,
        "messages": {"used": int(s.fit.system.used.sum()), "logged": len(model.master)},
        "innovations": judge.innovations(s),
        "mounting": judge.mounting(model.mount, s.states),
        "beside": [r for r in rows if r["name"] in settings.beside],
        "unseen": judge.unseen(model.mount, left_out=settings.left_out,
                                misalignments=settings.misalignments),
    }  # fmt: skip


SHOWN = ("velocity_sd", "attitude_sd", "attitude_form", "shift", "load", "flexure_sd",
         "flexure_time", "wander")  # fmt: skip
"""Settings that result.json repeats as they are."""


def _filter(s: Solution) -> dict[str, Any]:
    settings, bounded = s.problem.settings, not s.fit.nominal
    reported = settings.reported
    return {
        "name": settings.filter,
        "gamma": s.gamma if bounded else None,
        "least_gamma": s.least if bounded else None,
        "wanted": settings.wanted if bounded else None,
        **{key: getattr(settings, key) for key in SHOWN},
        # What is counted with and not in the result.
        "left_out": [r for r in s.states.rows() if r["name"] not in reported],
        "states": len(s.model.names),
    }


def _budget(s: Solution, gravity: FloatArray, at: list[int]) -> dict[str, Any]:
    """Return where the variance of the coefficients `at` is from; a bounded filter has none.

    `gravity` (n,): what is added for an error of local gravity [SI].
    """
    if not s.fit.nominal:
        return {}
    rows = [s.model.names.index(s.states.names[i]) - s.model.first for i in at]
    parts = {n: v[rows] for n, v in counted.budget(s.fit, s.problem.groups).items()}
    parts["local gravity"] = gravity[at] ** 2 + parts.get("local gravity", 0.0)
    parts = {n: v.tolist() for n, v in parts.items() if v.any()}
    basis = counted.BASIS | {n: g.basis for n, g in s.problem.groups.items()}
    return {"budget": parts, "sources": {n: ["B", basis[n]] for n in parts if n in basis}}


def _delay(s: Solution) -> dict[str, Any]:
    """Say where the delay is from: of each method value and standard deviation [s]."""
    settings, start = s.problem.settings, s.model.start.delay
    out: dict[str, Any] = {"method": settings.delay, "used": start}
    if settings.estimates_delay:
        found = s.states["master.delay"]
        out |= {"method": settings.delay_method, "started": start, "used": float(found.values[0]),
                "sd": float(found.sd[0])}  # fmt: skip
    if s.delay is not None:
        out["rate_matching"] = {"value": s.delay.delay, "sd": s.delay.delay_sd,
                                "drift": s.delay.drift, "drift_sd": s.delay.drift_sd}  # fmt: skip
    if s.likeliest is not None:
        out["likelihood"] = {"value": s.likeliest.delay, "sd": s.likeliest.sd}
    return out


PROCEDURE = Procedure(
    name="transfer_alignment",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: session.motion,
    simulation=simulated,
    names=lambda settings, _: settings.reported,
    layout=chosen.LAYOUT,
    counts=True,
    counts_by_noise=True,
    foresee=foresee,
    space=space,
    Wanted=Wanted,
    evaluations=EVALUATIONS,
    grade=GRADE,
    noise=chosen.NOISE,
    draw_errors=draw_errors,
    drawn=drawn,
    always=lambda settings: settings.always,
    write=chosen.write_log,
    Master=MasterDescription,
    with_master=chosen.with_master,
    log_table=chosen.log_table,
    noise_lines=chosen.NOISE_LINES,
    prior_lines=chosen.PRIOR_LINES,
)
calibrate, simulate, trial = PROCEDURE.calibrate, PROCEDURE.simulate, PROCEDURE.trial
