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

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.compare.gravity import of_site
from foucault.diagnose.time_base import stretched, with_clock
from foucault.diagnose.transfer import checks as judge
from foucault.diagnose.transfer import findings, report
from foucault.errors import Finding, FoucaultError, error
from foucault.logs.master_description import MasterDescription
from foucault.models.earth import Site
from foucault.models.imu import EQUATION
from foucault.models.noise import ImuNoise
from foucault.procedures import Progress, silent
from foucault.procedures.transfer_alignment.foresight import foresee as foresee
from foucault.procedures.transfer_alignment.input import heard, there, usable
from foucault.procedures.transfer_alignment.log import SlaveLog
from foucault.procedures.transfer_alignment.log import log_table as log_table
from foucault.procedures.transfer_alignment.log import with_master as with_master
from foucault.procedures.transfer_alignment.log import write_log as write_log
from foucault.procedures.transfer_alignment.plan import EVALUATIONS as EVALUATIONS
from foucault.procedures.transfer_alignment.plan import Wanted as Wanted
from foucault.procedures.transfer_alignment.plan import space as space
from foucault.procedures.transfer_alignment.problem import problem_of
from foucault.procedures.transfer_alignment.session import SIMULATE as SIMULATE
from foucault.procedures.transfer_alignment.session import Session as Session
from foucault.procedures.transfer_alignment.session import draw_errors as draw_errors
from foucault.procedures.transfer_alignment.session import simulate as simulate
from foucault.procedures.transfer_alignment.settings import LAYOUT as LAYOUT
from foucault.procedures.transfer_alignment.settings import NOISE as NOISE
from foucault.procedures.transfer_alignment.settings import NOISE_LINES as NOISE_LINES
from foucault.procedures.transfer_alignment.settings import PRIOR_LINES as PRIOR_LINES
from foucault.procedures.transfer_alignment.settings import Settings as Settings
from foucault.procedures.transfer_alignment.solution import (
    Solution,
    bent,
    gravity_error,
    handed_over,
    ignoring_delay,
    solved,
)
from foucault.result import Result, TableData, Verdict, provenance
from foucault.tables import Log, temperature_range

Master = MasterDescription

FRAME = "axes of the slave: right, forward, up as it is mounted nominally"
GAUGE = "b is the case of the slave; its axes are taken to be at right angles"


def names_of(settings: Settings) -> tuple[str, ...]:
    """Return the coefficients of the result."""
    return settings.reported


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
    """Calibrate a slave against its master.

    Parameters
    ----------
    log : SlaveLog
        Readings of the slave beside what its master said [SI].
    site : Site
        Gravity, and the latitude where the master does not say it.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the slave [SI]; None takes that of a tactical instrument.
    prior : mapping of str to (float, float) or None
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    instrument : mapping or None
        Name, serial and so on, kept in the result.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    Result
        Errors of the sensors, installation and delay with covariance, checks and a verdict [SI].
        What is no error of a sensor is not applied to readings.

    Raises
    ------
    FoucaultError
        ``transfer.*``: no master, nothing in common, a delay or a gamma that cannot be.
    """
    started = clock.monotonic()
    settings = settings or Settings()
    result = _calibrate(log, site, settings, noise, prior or {}, progress, shown=True)
    progress(0.9, "looking at the clock")
    slope = _clock_slope(log, result, site, settings, noise, prior or {})
    progress(1.0, "done")
    seconds = clock.monotonic() - started
    result = replace(result, instrument=dict(instrument or {}),
                     provenance=provenance(log.source, seconds))  # fmt: skip
    summed = log.sampled == "increment"
    return with_clock(result, log.clock, turned=True, summed=summed, slope=slope)


FAST = 1e-4
"""A clock so much too fast shows how the estimate hangs on it [1]."""


def _clock_slope(
    log: Log, result: Result, site: Site, settings: Settings, noise: ImuNoise | None,
    given: Mapping[str, tuple[float, float]],
) -> FloatArray | None:  # fmt: skip
    """Return how the estimate changes with the clock that log and messages share, shape (n,).

    What a flight ties to the velocity of a master is a mixture of its turns and of gravity, so that
    it is tried: a clock that is fast for one of the two alone is a delay that drifts, and is seen.
    """
    if not isinstance(log, SlaveLog):
        return None
    start, table = float(log.time[0]), log.messages
    later = replace(table, time=start + (table.time - start) * (1.0 + FAST))
    fast = SlaveLog.of(stretched(log, FAST), later)
    try:
        s = _solved(fast, site, settings, noise, given, silent, shown=False)[0]
    except FoucaultError:
        return None
    other = s.states.chosen(s.problem.settings.reported)
    if other.names != result.coefficients.names:
        return None
    return np.asarray((other.values - result.coefficients.values) / FAST)


def trial(
    log: Log,
    *,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Result:
    """Calibrate without what only a report shows: one trial of many.

    `log`: readings of the slave beside what its master said [SI]; `site`: gravity, and the
    latitude where the master does not say it; `noise` or None: noise of the slave [SI]; `prior`
    or None: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    return _calibrate(log, site, settings, noise, prior or {}, silent, shown=False)


def _solved(
    log: Log, site: Site, settings: Settings, noise: ImuNoise | None,
    given: Mapping[str, tuple[float, float]], progress: Progress, *, shown: bool,
) -> tuple[Solution, SlaveLog, list[Finding]]:  # fmt: skip
    """Solve what a log shows; return the log as it was used too, and what is odd about it."""
    if not isinstance(log, SlaveLog):
        raise error("transfer.no_master")
    log = usable(log)
    progress(0.1, "matching what both turned")
    settings, silence = heard(log.messages, settings)
    site, elsewhere = there(site, log.messages)
    problem = problem_of(log, site, settings, noise, given)
    progress(0.3, "filtering")
    problem = bent(problem) if settings.estimate_flexure else problem
    return solved(problem, history=shown), log, [*elsewhere, *silence]


def _calibrate(
    log: Log, site: Site, settings: Settings, noise: ImuNoise | None,
    given: Mapping[str, tuple[float, float]], progress: Progress, *, shown: bool,
) -> Result:  # fmt: skip
    s, log, told = _solved(log, site, settings, noise, given, progress, shown=shown)
    settings, used = s.problem.settings, s.problem.site.as_dict()
    checks = judge.checks(s)
    error_of_g = gravity_error(s)
    assert s.states.cov is not None
    all_cov = s.states.cov + np.outer(error_of_g, error_of_g)
    at = [s.states.layout.index(name) for name in settings.reported]
    told += findings.findings(s, s.problem.findings, s.findings)
    tables: dict[str, TableData] = {}
    if shown:
        progress(0.7, "looking at what was found")
        undelayed = ignoring_delay(s) if settings.delay != "none" else None
        tables = report.tables(s, settings.reported, s.backward, undelayed)
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
        site=used,
        validity=_validity(log),
        diagnostics={"start": float(log.time[0])}
        | _diagnostics(log, s)
        | of_site(used, settings.reported, error_of_g[at]),
        tables=tables,
    )


def _diagnostics(log: SlaveLog, s: Solution) -> dict[str, Any]:
    settings, model, rows = s.problem.settings, s.model, s.states.rows()
    return {
        "gravity": s.problem.site.gravity,
        "matching": settings.matching,
        "filter": _filter(s),
        "bound": s.states_of(s.kalman).chosen(settings.reported).sd.tolist(),
        "noise": {"accel": model.slave.noise.accel.white, "gyro": model.slave.noise.gyro.white},
        "delay": _delay(s),
        "hand_over": {"place": "master" if log.messages.has_place else "site"}
        | report.hand_over(handed_over(s), model.slave.increments),
        "passes": {"names": list(model.names[model.first :]),
                   "values": [x.tolist() for x in s.fit.passes]},
        "log_likelihood": s.fit.run.log_likelihood,
        "messages": {"used": int(s.fit.system.used.sum()), "logged": len(model.master)},
        "innovations": judge.innovations(s),
        "mounting": report.mounting(model.mount, s.states),
        "beside": [r for r in rows if r["name"] in settings.beside],
        "unseen": report.unseen(model.mount, left_out=settings.left_out,
                                misalignments=settings.misalignments),
    }  # fmt: skip


SHOWN = ("velocity_sd", "attitude_sd", "attitude_form", "shift", "load", "flexure_sd",
         "flexure_time", "wander")  # fmt: skip
"""Settings that result.json repeats as they are."""


def _filter(s: Solution) -> dict[str, Any]:
    settings, bounded = s.problem.settings, not s.fit.nominal
    return {
        "name": settings.filter,
        "gamma": s.gamma if bounded else None,
        "least_gamma": s.least if bounded else None,
        "wanted": settings.wanted if bounded else None,
        **{key: getattr(settings, key) for key in SHOWN},
        # What is counted with and not in the result.
        "left_out": [r for r in s.states.rows() if r["name"] not in settings.reported],
        "states": len(s.model.names),
    }


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


def _validity(log: Log) -> dict[str, Any]:
    """Return the ranges that the run covered: outside them the result is extrapolated."""
    assert log.gyro is not None
    assert log.accel is not None
    out: dict[str, Any] = {"sampled": log.sampled, "rate": log.rate}
    for name, x in (("accel", log.accel), ("gyro", log.gyro)):
        out[name] = [float(x.min()), float(x.max())]
    return out | temperature_range(log)
