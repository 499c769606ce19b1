"""A table of means, one row per pose, of an instrument that nothing held and nobody measured.

The specific force of every pose has the size of gravity, whatever the attitude: that calibrates the
accelerometers, as norm observation does. The turns between the poses are not in the table, so that
of the gyros the bias alone is seen: along up the Earth's rotation is known, across it the heading
is not.
"""

from __future__ import annotations

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
from foucault.errors import error
from foucault.estimate.hand_rotated.bias import resting_bias
from foucault.infer.mixed import NOISE_BASIS, Component
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.readings import Readings
from foucault.models.rests_and_turns import Session
from foucault.procedures.on_table import NORM_NEEDS, Task, from_readings
from foucault.procedures.record import Given
from foucault.result import Check, Result, Verdict
from foucault.tables import AXES, Log, TableColumns

NO_TURNS = (
    "Gyro scale factors, misalignments and g-sensitivity: means of poses do not hold the turns, "
    "and what g-sensitivity makes of the rates is scatter of the bias."
)
"""What of the gyros a table of means cannot show."""


def solve_poses(log: Log, task: Task, given: Given[Any]) -> Result:
    """Calibrate the accelerometers, and the bias of the gyros, from means over poses.

    `log`: means, one row per pose [SI]; `task`: which coefficients, and what to do with a wrong
    row; `given`: noise that is None is taken from the residuals. Raises too few poses, poses all
    in a plane, wrong units: see `foucault.symptoms`.
    """
    site, settings, n = given.site, task.settings, len(log)
    if log.accel is None:
        raise error("session.no_accel")
    still = TableColumns(np.full((n, 3), np.nan), np.zeros(n), None)
    given.progress(0.2, "reading the poses")
    readings = find_readings(replace(log, table=still), noise=given.noise)
    rows = np.arange(n)
    enough_readings(readings, NORM_NEEDS + 3 * settings.accel_quadratic, 0)
    up_b = check_forces(Session.reduce(log, rows, rows + 1, site))
    found = first_rest_orientation(log, up_b[0])
    given.progress(0.4, "calibrating")
    alone = from_readings(replace(readings, gyro=None), task, site=site, prior=given.prior)
    result = alone if log.gyro is None else _with_gyros(alone, readings, site)
    result.diagnostics["plan"] = ""
    return replace(
        result,
        findings=(*log.findings, *found, *result.findings),
        validity=table_report.validity(readings, log, site),
    )


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
    measured, unknown = NOISE_BASIS[readings.noise_from], ("A", "scatter of the rates at rest")
    said["sources"] = said["sources"] | {
        "gyro noise": [*measured], "scatter of the rates and unknown Earth rate": [*unknown],
    }  # fmt: skip
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
