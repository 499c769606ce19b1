"""A table of means, one row per pose, of an instrument that nothing held and nobody measured.

The specific force of every pose has the size of gravity, whatever the attitude: that calibrates the
accelerometers, as norm observation does. The turns between the poses are not in the table, so that
of the gyros the bias alone is seen: along up the Earth's rotation is known, across it the heading
is not.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.earth_rate import no_latitude
from foucault.diagnose.first_rest import first_rest_orientation
from foucault.diagnose.hand_rotated.input import check_forces
from foucault.diagnose.positions.readings import find_readings
from foucault.diagnose.table import report as table_report
from foucault.diagnose.table.input import enough_readings
from foucault.diagnose.time_base import with_clock
from foucault.errors import error
from foucault.estimate.hand_rotated.bias import resting_bias
from foucault.infer.mixed import Component
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.noise import ImuNoise
from foucault.models.readings import Readings
from foucault.models.rests_and_turns import Session
from foucault.procedures import Progress, silent, solvable
from foucault.procedures.on_table import NORM_NEEDS, Task, from_readings
from foucault.procedures.on_table.session import TableSettings
from foucault.result import Check, Result, Verdict, provenance
from foucault.tables import AXES, Log, TableColumns

NO_TURNS = (
    "Gyro scale factors, misalignments and g-sensitivity: means of poses do not hold the turns, "
    "and what g-sensitivity makes of the rates is scatter of the bias."
)
"""What of the gyros a table of means cannot show."""


def calibrate_poses(
    log: Log,
    procedure: str,
    settings: TableSettings,
    *,
    site: Site,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    instrument: Mapping[str, Any] | None = None,
    repeatability: bool = True,
    progress: Progress = silent,
) -> Result:
    """Calibrate the accelerometers, and the bias of the gyros, from means over poses.

    `log`: means, one row per pose [SI]; `settings`: which coefficients, and what to do with a
    wrong row; `site`: local gravity, and latitude where the Earth's rotation is to be modelled;
    `noise`: noise of the instrument [SI], None takes it from the residuals; `prior` or None: mean
    and standard deviation of coefficients or groups of coefficients [SI]; `instrument` or None:
    name, serial and so on, kept in the result; `repeatability`: estimate the scatter between
    poses that the noise does not explain; `progress`: called with the fraction done and what is
    being done. Raises too few poses, poses all in a plane, wrong units: see `foucault.symptoms`.
    """
    started, n = clock.monotonic(), len(log)
    if log.accel is None:
        raise error("session.no_accel")
    still = TableColumns(np.full((n, 3), np.nan), np.zeros(n), None)
    progress(0.2, "reading the poses")
    readings = find_readings(replace(log, table=still), noise=noise)
    task = Task(procedure, settings, None, repeatability=repeatability)
    rows = np.arange(n)
    with solvable():
        enough_readings(readings, NORM_NEEDS + 3 * settings.accel_quadratic, 0)
        up_b = check_forces(Session.reduce(log, rows, rows + 1, site))
        found = first_rest_orientation(log, up_b[0])
        progress(0.4, "calibrating")
        alone = from_readings(replace(readings, gyro=None), task, site=site, prior=prior)
        result = alone if log.gyro is None else _with_gyros(alone, readings, site)
    result.diagnostics["plan"] = ""
    whole = replace(
        result,
        findings=(*log.findings, *found, *result.findings),
        instrument=dict(instrument or {}),
        validity=table_report.validity(readings, log, site),
        provenance=provenance(log.source, clock.monotonic() - started),
    )
    progress(1.0, "done")
    return with_clock(whole, log.clock, turned=False, summed=log.sampled == "increment")


def _with_gyros(alone: Result, readings: Readings, site: Site) -> Result:
    """Add the bias of the gyros to a result of the accelerometers."""
    table = alone.tables["readings"]
    up_b = np.column_stack([table[f"up_{axis}"] for axis in AXES])
    gyros = resting_bias(readings, up_b, site)
    names = tuple(f"gyro.bias.{axis}" for axis in AXES)
    c, m = alone.coefficients, len(alone.coefficients)
    assert readings.gyro is not None and c.cov is not None
    cov = np.zeros((m + 3, m + 3))
    cov[:m, :m], cov[m:, m:] = c.cov, gyros.cov
    vector = CoefficientVector(
        LAYOUT.subset((*c.names, *names)), np.append(c.values, gyros.bias), cov,
        prior_sd=np.append(c.prior_sd, np.full(3, np.inf)),
    )  # fmt: skip
    said = dict(alone.diagnostics)
    left = np.diag(gyros.cov - gyros.noise)
    said["budget"] = {k: [*v, 0.0, 0.0, 0.0] for k, v in said["budget"].items()} | {
        "gyro noise": [*np.zeros(m).tolist(), *np.diag(gyros.noise).tolist()],
        "scatter of the rates and unknown Earth rate": [*np.zeros(m).tolist(), *left.tolist()],
    }
    if "bound" in said:
        said["bound"] = [*said["bound"], *np.sqrt(np.diag(gyros.noise)).tolist()]
    said["noise"] = said["noise"] | {"gyro_repeatability": gyros.scatter}
    said["unseen"] = [*said["unseen"], NO_TURNS]
    checks = (*alone.checks, *_explained(gyros.fit, readings.declared))
    found = [f for f in alone.findings if f.code != "session.no_gyro"]
    if site.latitude is None:
        found.append(no_latitude())
    tables = dict(alone.tables)
    tables["readings"] = dict(table) | {
        f"gyro_{axis}": readings.gyro[:, i] for i, axis in enumerate(AXES)
    }
    return replace(
        alone, coefficients=vector, checks=checks, verdict=Verdict.of(checks),
        findings=tuple(found), diagnostics=said, tables=tables,
    )  # fmt: skip


def _explained(fit: Component, declared: bool) -> list[Check]:
    """Hold the rates along up against the noise that was declared."""
    if not declared:
        return []
    fine = fit.low <= fit.chi_square <= fit.high
    words = (
        f"The residuals of the angular rate along up are {np.sqrt(fit.ratio):.2f} times what the "
        "noise says"
    )
    if fit.chi_square > fit.high:
        words += ": g-sensitivity, or a bias that drifts. The uncertainties include the scatter"
    elif not fine:
        words += ": the noise is overstated and so are the uncertainties"
    name = "noise of angular rate at rest"
    return [Check(name, fit.chi_square, fit.low, fit.high, fine, words + ".")]
