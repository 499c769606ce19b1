"""Means over poses that a hand held: the accelerometers by norms, and the bias of the gyros.

What `hand_rotated` makes of a log of means.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.detect.readings import find_readings
from foucault.diagnose import table as table_report
from foucault.errors import error
from foucault.guard.rest import first_rest, up_of_rests
from foucault.guard.table import enough_readings
from foucault.models.rests_and_turns import Session as SessionData
from foucault.procedures.on_table import NORM_NEEDS, Task, from_readings
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Given
from foucault.result import Result
from foucault.tables import Log, TableColumns

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
    shared = given.settings.model_dump(
        include={*TableSettings.model_fields} - {"shortest", "g_sensitivity"}
    )
    site, settings, n = given.site, TableSettings(**shared), len(log)
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
    result = from_readings(
        readings, Task("hand_rotated", settings, None, poses=True), site=site, prior=given.prior
    )
    result.diagnostics["plan"] = ""
    if log.gyro is not None:
        result.diagnostics["unseen"].append(NO_TURNS)
    return replace(
        result,
        findings=(*log.findings, *found, *result.findings),
        validity=table_report.validity(readings, log, site),
    )
