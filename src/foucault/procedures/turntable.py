"""Calibrate an IMU and the table it stands on, all at once.

The angles of the table are believed with errors of known size: tilt of the outer axis, axes that
are not perpendicular, zero errors, and another error in every position. All are estimated with
the instrument. On a perfect table this is as good as the traditional method, on a bad one as norm
observation, and in between better than both; and it says how good the table is.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from foucault.models.earth import Site
from foucault.models.table_geometry import Trust
from foucault.procedures.on_table import Task
from foucault.procedures.on_table.procedure import table_procedure
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate
from foucault.units import AngleSd

ARCSEC = float(np.radians(1 / 3600))


class Settings(TableSettings):
    """What can be chosen; the defaults are those of a good table."""

    plumb_sd: AngleSd = Field(
        default=30 * ARCSEC, ge=0, description="Sd of the tilt of the outer axis, about each axis."
    )
    orthogonality_sd: AngleSd = Field(
        default=10 * ARCSEC, ge=0, description="Sd of the angles between the table's axes."
    )
    zero_sd: AngleSd = Field(
        default=10 * ARCSEC, ge=0, description="Sd of the zero errors of middle and inner angle."
    )
    position_sd: AngleSd = Field(
        default=60 * ARCSEC,
        ge=0,
        description="Sd of the middle and inner angle from one position to the next.",
    )
    repeatability: bool = Field(
        default=True,
        description="Estimate the scatter between readings that neither noise nor table explain.",
    )


class Session(TableSession):
    """The session that `simulate` makes."""


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    s = settings
    common = np.repeat([s.plumb_sd, s.orthogonality_sd, s.zero_sd], 2)
    trust = Trust(common, s.position_sd, s.where(site).latitude)
    return Task("turntable", settings, trust, repeatability=s.repeatability)


PROCEDURE = table_procedure("turntable", __doc__, Settings, Session, task_of)
calibrate = PROCEDURE.calibrate
