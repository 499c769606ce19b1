"""Calibrate an IMU on a table whose angles are taken as exact: multi-position least squares.

The traditional method: every rest gives the three components of specific force, and every spin
those of the rate, in the axes of the case; a least-squares fit gives the coefficients. Errors of
the table go into them. Where what is not estimated counts, the angles are as good as `angle_sd`
says: they are never exact, and below their errors noise averages away. `turntable` is told more of
them; `norm_observation` does without the angles.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from foucault.models.earth import Site
from foucault.models.turntable import Trust
from foucault.procedures.on_table import Task, table_procedure
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate
from foucault.procedures.record import OrthogonalitySd, PlumbSd, PositionSd, ZeroSd
from foucault.units import AngleSd

ARCSEC = float(np.pi / 648000)


class Settings(TableSettings):
    """What can be chosen; the defaults suit most tables."""

    angle_sd: AngleSd | None = Field(default=None, ge=0, examples=["1 arcsec"])
    """Sd of every angle of the table: the tilt of its outer axis, its axes' squareness, their
    zeros, and each position. Left out: 1 arcsec where what is not estimated counts, else exact."""


class Session(TableSession):
    """The session that `simulate` makes: on a table as good as this method wants it."""

    plumb_sd: PlumbSd = 1 * ARCSEC
    orthogonality_sd: OrthogonalitySd = 1 * ARCSEC
    zero_sd: ZeroSd = 1 * ARCSEC
    position_sd: PositionSd = 1 * ARCSEC


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    latitude, said = settings.where(site).latitude, settings.angle_sd
    if said is not None:
        return Task("multi_position", settings, Trust(np.full(6, said), said, latitude))
    counted = Trust(np.full(6, ARCSEC), ARCSEC, latitude, "angles of 1 arcsec, judgement")
    return Task("multi_position", settings, Trust(np.zeros(6), 0.0, latitude), counted=counted)


PROCEDURE = table_procedure("multi_position", __doc__, Settings, Session, task_of)
calibrate = PROCEDURE.calibrate
