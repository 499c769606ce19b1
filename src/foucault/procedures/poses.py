"""Means over poses that a hand held: the accelerometers by norms, and the bias of the gyros.

What `hand_rotated` makes of a log of means.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.detect.readings import find_readings
from foucault.diagnose import table as table_report
from foucault.diagnose.checks import check
from foucault.diagnose.references import no_latitude
from foucault.errors import error
from foucault.estimate.hand_rotated import resting_bias
from foucault.guard.rest import first_rest, up_of_rests
from foucault.guard.table import enough_readings
from foucault.infer.gauss_newton import Component
from foucault.infer.mixed import NOISE_BASIS
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.noise import Readings
from foucault.models.rests_and_turns import Session as SessionData
from foucault.procedures.on_table import NORM_NEEDS, Task, from_readings
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Given
from foucault.result import Check, Result, Verdict
from foucault.tables import AXES, Log, TableColumns

NO_TURNS = (
    "Gyro scale factors, misalignments and g-sensitivity: means of poses do not hold the turns, "
    "and what g-sensitivity makes of the rates is scatter of the bias."
)
"""What of the gyros a table of means cannot show."""


def solve_poses(log: Log, given: Given[Any]) -> Result:
    """Calibrate the accelerometers, and the bias of the gyros, from means over poses.

    The specific force of every pose of an instrument that nothing held and nobody measured has
    the size of gravity, whatever the attitude: that calibrates the accelerometers, as norm
    observation does. The turns between the poses are not in the table, so that of the gyros the
    bias alone is seen: along up the Earth's rotation is known, across it the heading is not.

    `log`: means, one row per pose [SI]; `given`: noise that is None is taken from the residuals.
    Raises too few poses, poses all in a plane, wrong units: see `foucault.symptoms`.
    """
    site, settings, n = given.site, _for_poses(given.settings), len(log)
    if log.accel is None:
        raise error("session.no_accel")
    still = TableColumns(np.full((n, 3), np.nan), np.zeros(n), None)
    given.progress(0.2, "reading the poses")
    readings = find_readings(replace(log, table=still), noise=given.noise)
    rows = np.arange(n)
    enough_readings(readings, NORM_NEEDS + 3 * settings.accel_quadratic, 0)
    up_b = up_of_rests(SessionData.reduce(log, rows, rows + 1, site))
    found = first_rest(log, up_b[0])
    given.progress(0.4, "calibrating")
    alone = from_readings(
        replace(readings, gyro=None), Task("hand_rotated", settings, None), site=site,
        prior=given.prior,
    )  # fmt: skip
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
    given = {"ratio": np.sqrt(fit.ratio)}
    name = "noise of angular rate at rest"
    return [check("noise along up", name, fit.chi_square, fit.low, fit.high, given)]


def _for_poses(settings: Any) -> TableSettings:
    shared = settings.model_dump(
        include={*TableSettings.model_fields} - {"shortest", "g_sensitivity"}
    )
    return TableSettings(**shared)
