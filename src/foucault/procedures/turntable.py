"""Calibrate an IMU and the table it stands on, all at once.

The angles of the table are believed with errors of known size: tilt of the outer axis, axes that
are not perpendicular, zero errors, and another error in every position. All are estimated with
the instrument. On a perfect table this is as good as the traditional method, on a bad one as norm
observation, and in between better than both; and it says how good the table is.
"""

from __future__ import annotations

import numpy as np

from foucault.models.earth import Site
from foucault.models.turntable import Trust
from foucault.procedures.on_table import Task, table_procedure
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate
from foucault.procedures.record import OrthogonalitySd, PlumbSd, PositionSd, ZeroSd

ARCSEC = float(np.radians(1 / 3600))


class Settings(TableSettings):
    """What can be chosen; the defaults are those of a good table."""

    plumb_sd: PlumbSd = 30 * ARCSEC
    orthogonality_sd: OrthogonalitySd = 10 * ARCSEC
    zero_sd: ZeroSd = 10 * ARCSEC
    position_sd: PositionSd = 60 * ARCSEC


class Session(TableSession):
    """The session that `simulate` makes."""


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    s = settings
    common = np.repeat([s.plumb_sd, s.orthogonality_sd, s.zero_sd], 2)
    trust = Trust(common, s.position_sd, s.where(site).latitude)
    return Task("turntable", settings, trust)


PROCEDURE = table_procedure("turntable", __doc__, Settings, Session, task_of)
calibrate = PROCEDURE.calibrate
