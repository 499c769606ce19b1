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

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.compare.gravity import of_site
from foucault.diagnose.foresight import Foresight
from foucault.diagnose.time_base import with_clock
from foucault.diagnose.tumble import checks as judge
from foucault.diagnose.tumble import input as tumble_input
from foucault.diagnose.tumble import report as tumble_report
from foucault.diagnose.tumble.checks import Evidence
from foucault.errors import Finding
from foucault.models import cluster
from foucault.models.cluster import EQUATION
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.plans.tumble.torquing import nominal
from foucault.procedures import Progress, silent
from foucault.procedures.platform_tumble import foresight as tumble_foresight
from foucault.procedures.platform_tumble.log import ERRORS_LINE as ERRORS_LINE
from foucault.procedures.platform_tumble.log import NOISE_LINES as NOISE_LINES
from foucault.procedures.platform_tumble.log import PRIOR_LINES as PRIOR_LINES
from foucault.procedures.platform_tumble.log import Description as Description
from foucault.procedures.platform_tumble.log import log_table as log_table
from foucault.procedures.platform_tumble.log import read_log as read_log
from foucault.procedures.platform_tumble.problem import noise_of, prior_of, tumble_of
from foucault.procedures.platform_tumble.search import Wanted as Wanted
from foucault.procedures.platform_tumble.search import space as space
from foucault.procedures.platform_tumble.settings import NOISE as NOISE
from foucault.procedures.platform_tumble.settings import PRIOR as PRIOR
from foucault.procedures.platform_tumble.settings import SIMULATE as SIMULATE
from foucault.procedures.platform_tumble.settings import Session as Session
from foucault.procedures.platform_tumble.settings import Settings as Settings
from foucault.procedures.platform_tumble.settings import draw_errors as draw_errors
from foucault.procedures.platform_tumble.settings import simulate as simulate
from foucault.procedures.platform_tumble.solution import (
    Solution,
    coefficients,
    owed_by,
    parts,
    public,
    solved,
)
from foucault.result import Result, Verdict, provenance
from foucault.tables import Log, range_below_g

LAYOUT = cluster.LAYOUT
FRAME = "cluster axes p; attitude: outer, middle, inner angle from North-Up-East"
GAUGE = "x accelerometer input axis, y in the x-y accelerometer plane"

MOMENTS = 120
"""In so many moments the estimate is kept for its course in time [1]."""


def names_of(_settings: Settings) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    return LAYOUT.names


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
    """Calibrate and align a torqued cluster.

    Parameters
    ----------
    log : Log
        The command in the gyro columns, and the accelerometers [SI].
    site : Site
        Gravity and latitude.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the accelerometers, and of the drift of the gyros [SI]; None measures the one and
        assumes the other.
    prior : mapping of str to (float, float) or None
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    instrument : mapping or None
        Name, serial and so on, kept in the result.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    Result
        42 coefficients and the final attitude with joint covariance, checks and a verdict [SI].

    Raises
    ------
    FoucaultError
        No command, wrong units or axes, too short: see `foucault.symptoms`.
    """
    arguments = (site, settings or Settings(), noise, prior or {}, dict(instrument or {}))
    return _calibrate(log, *arguments, progress, shown=True)


def trial(
    log: Log,
    *,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Result:
    """Calibrate without what only a report shows: one trial of many.

    `log`: the command in the gyro columns, and the accelerometers [SI]; `noise` or None: noise of
    the accelerometers, and of the drift of the gyros [SI]; `prior` or None: mean and standard
    deviation of coefficients or groups of coefficients [SI].
    """
    return _calibrate(log, site, settings, noise, prior or {}, {}, silent, shown=False)


def _calibrate(
    log: Log, site: Site, settings: Settings, noise: ImuNoise | None,
    prior: Mapping[str, tuple[float, float]], instrument: dict[str, Any], progress: Progress,
    *, shown: bool,
) -> Result:  # fmt: skip
    started = clock.monotonic()
    progress(0.1, "looking at the log")
    told = _look(log, site, settings)
    used, said = noise_of(log, noise)
    tumble, more = tumble_of(log, site, settings, used)
    beforehand = prior_of(settings, site, prior)
    progress(0.3, "calibrating")
    solution = solved(
        tumble, beforehand, settings, site, used, moments=MOMENTS if shown else 0,
        measured="tumble.measured" in {f.code for f in said},
    )  # fmt: skip
    progress(0.8, "judging the result")
    result = _result(solution, shown)
    progress(1.0, "done")
    whole = replace(
        result,
        findings=(*log.findings, *told, *said, *more, *result.findings),
        instrument=instrument,
        validity=range_below_g(log, site.gravity),
        provenance=provenance(log.source, clock.monotonic() - started),
    )
    return with_clock(whole, log.clock, turned=True, summed=log.sampled == "increment")


def foresee(
    settings: Settings, *, session: Session, site: Site, noise: ImuNoise | None,
    prior: Mapping[str, tuple[float, float]],
) -> Foresight:  # fmt: skip
    """Return what the planned motion will show; noise and `prior` as a campaign has them [SI]."""
    m = tumble_foresight.planned(settings, session, site, noise, prior)
    owed = owed_by(m.tumble, m.prior, m.fit, settings, site, m.noise)
    s = Solution(m.tumble, m.prior, m.fit, m.fit.cov, owed, settings, site, m.noise)
    extras = tumble_foresight.more(m, settings, session, site, noise, prior)
    return tumble_foresight.seen(m, coefficients(s), settings, extras)


# -- the log ---------------------------------------------------------------------------------


def _look(log: Log, site: Site, settings: Settings) -> list[Finding]:
    """Refuse what cannot be right; say what is doubtful."""
    tumble_input.require_readings(log, site, settings.rate_limit)
    tumble_input.require_gravity(log, site, settings.angles)
    from_its_time = settings.held(log.sampled) == "from its time"
    told = tumble_input.motion_findings(log, from_its_time, settings.delay_sd)
    told += tumble_input.gap_findings(log)
    plan = settings.torquing
    if plan is not None:
        assert site.latitude is not None
        expected = nominal(plan, site.latitude)
        told += tumble_input.plan_findings(log, plan, expected, from_its_time)
    return told


def _result(s: Solution, shown: bool) -> Result:
    found = coefficients(s)
    e = Evidence(s.tumble, s.prior, s.fit, found, s.settings.angles, s.slow, s.advice,
                 None if s.slow or s.settings.filter != "gauss-newton" else s.earth)  # fmt: skip
    checks = judge.checks(e)
    bound = np.sqrt(np.diag(public(s, s.least)))
    added = parts(s)
    budget = {k: np.diag(v).tolist() for k, v in added.items()}
    more: dict[str, Any] = {"bound": bound.tolist(), "budget": budget, "filter": s.settings.filter}
    if "local gravity" in added:
        names = found.names
        error = _one_error(added["local gravity"], names.index("accel.scale.x"))
        more |= of_site(s.site.as_dict(), names, error)
    if shown:
        more["observability"] = tumble_report.observability_json(e)
    return Result(
        procedure="platform_tumble",
        coefficients=found,
        equation=EQUATION,
        frame=FRAME,
        gauge=GAUGE,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*s.findings, *judge.findings(e)),
        status=s.fit.status,
        site=s.site.as_dict(),
        diagnostics=tumble_report.diagnostics(e, s.site, s.noise) | more,
        tables=tumble_report.tables(e, s.site) if shown else {},
    )


def _one_error(cov: FloatArray, k: int) -> FloatArray:
    """Return the error that a covariance of rank one is of; that of number `k` is negative."""
    return np.asarray(-cov[:, k] / np.sqrt(cov[k, k]))
