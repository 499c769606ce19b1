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

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.detect.dwells import find_dwells, measured_noise
from foucault.detect.noise import without_spikes
from foucault.diagnose import north_calibration as judge
from foucault.diagnose.north import alive, late_index, stops, units_first
from foucault.errors import error
from foucault.estimate import north as estimation
from foucault.estimate.north import Known
from foucault.logs import indexed, indexed_own
from foucault.logs.indexed_own import IndexedDescription
from foucault.models.earth import Site
from foucault.models.noise import noise_json
from foucault.models.north_seeker import EQUATION, Compensation, Dwells
from foucault.procedures.north_seeking.counted import completed, drawn
from foucault.procedures.north_seeking.fix import Solution, require_latitude, solved
from foucault.procedures.north_seeking.foresight import Wanted, foresee, space
from foucault.procedures.north_seeking.settings import (
    Session,
    Settings,
    draw_errors,
    planned,
    simulated,
)
from foucault.procedures.record import Given, Procedure, result_of
from foucault.result import Result
from foucault.tables import IndexedLog, temperature_range

FRAME = "axes of the case, right-forward-up: headings of the turntable"
GAUGES = {
    "one axis": "y_b is where the reference headings say, z_b the axis of the turntable",
    "each": "y_b is where the reference headings say, z_b the axis of the base",
}
"""What defines the axes, by the way the table was used."""


def names_in(settings: Settings, session: Session) -> tuple[str, ...]:
    """Return the coefficients that a simulated session gives.

    `session`: what is done: a tilted table shows others than a level one.
    """
    tilted = settings.tilt == "each" or (settings.tilt == "auto" and len(set(session.tilts)) > 1)
    return estimation.names_of(
        "each" if tilted else "one axis", session.accelerometers != "none",
        settings.z_coupling != "no",
    )  # fmt: skip


def _solve(log: IndexedLog, given: Given[Settings]) -> Result:
    site, settings = given.site, completed(given.settings, given.sizes)[0]
    given.progress(0.1, "finding the dwells")
    log = without_spikes(log)
    stuck = alive(log)
    dwells = find_dwells(log, settle=settings.settle, shortest=settings.shortest)
    _require_readings(log, dwells)
    if dwells.latitude is not None or dwells.latitude_sd is not None:
        raise error("north.one_place")
    told = stops(dwells, Known(site.gravity))
    told += late_index(dwells, settings.index_lag_sd)
    if site.latitude is None:
        raise error("north.calibration_latitude")
    require_latitude(site.latitude)
    given.progress(0.4, "calibrating")
    declared = given.noise is not None
    noise = given.noise or measured_noise(log, dwells)
    with units_first(log.findings):
        solution = solved(dwells, site, given.settings, noise, declared, given.prior, given.sizes)
    result = _result(solution, dwells, settings, site)
    return replace(
        result,
        findings=(*log.findings, *stuck, *told, *result.findings),
        validity=_validity(log, dwells, solution),
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


def _result(s: Solution, dwells: Dwells, settings: Settings, site: Site) -> Result:
    estimate, apart = s.fit.estimate, judge.each_apart(s.fit)
    checks = judge.checks(s.fit, s.pairs, s.rig, dwells, s.source, apart)
    headings = judge.heading_table(s.fit, s.pairs, s.rig, dwells, apart)
    return result_of(
        "north_seeking",
        s.fit,
        checks,
        site=site,
        described=(EQUATION, FRAME, GAUGES[s.rig.tilt]),
        findings=(
            *dwells.findings,
            *s.findings,
            *judge.suspicious(estimate, site.latitude or 0.0),
            *judge.findings(apart, estimate, dwells, s.source),
        ),
        diagnostics={
            "noise": {"source": s.source} | noise_json(s.noise),
            "chi_square": judge.chi_square(s.fit, s.pairs),
            "unseen": judge.unseen(s.rig, estimate.coefficients.names),
            "table": judge.table_json(s.fit, s.rig),
            "circle_accuracy": {
                when: judge.circle_accuracy(headings[f"heading_{when}"])
                for when in ("before", "after")
            },
            "stop_offsets": s.stop_offsets,
            "stop_gains": s.stop_gains,
            "gyro_offset": float(np.median(s.pairs.offset)),
            "drift": settings.drift if not s.nuisance.drift_sd else "estimated",
            "z_coupling": None if s.z_test is None else list(s.z_test),
        },
        tables={"headings": headings},
        table_rate_sd=None,
        judged=s.judged,
    )


def _validity(log: IndexedLog, dwells: Dwells, s: Solution) -> dict[str, Any]:
    tilt = np.degrees(np.abs(estimation.tilts(s.pairs, s.rig.site.gravity, Compensation())).max())
    out: dict[str, Any] = {
        "gyro": [float(dwells.gyro.min()), float(dwells.gyro.max())],
        "index": sorted({round(float(np.degrees(a)) % 360.0, 1) % 360.0 for a in dwells.index}),
        "tilt": float(tilt) if s.rig.accelerometers else None,
    }
    return out | temperature_range(log)


PROCEDURE = Procedure(
    name="north_seeking",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda settings, session, _: planned(settings, session),
    simulation=simulated,
    names=names_in,
    foresee=foresee,
    space=space,
    Wanted=Wanted,
    grade="navigation",
    counts=True,
    counts_by_noise=True,
    draw_errors=draw_errors,
    drawn=drawn,
    Description=IndexedDescription,
    read=indexed.read,
    write=indexed_own.write,
    # Rates of the Earth are compared with rates as read.
    clocked=lambda _: (False, False),
    log_table=indexed_own.log_table,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
