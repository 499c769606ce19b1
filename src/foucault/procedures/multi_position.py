"""Calibrate an IMU on a table whose angles are taken as exact: multi-position least squares.

The traditional method: every rest gives the three components of specific force, and every spin
those of the rate, in the axes of the case; a least-squares fit gives the coefficients. Errors of
the table go into them. `turntable` estimates those errors too; `norm_observation` does without
the angles.
"""

from __future__ import annotations

import numpy as np

from foucault.models.earth import Site
from foucault.models.turntable import Trust
from foucault.procedures.on_table import Task, table_procedure
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate
from foucault.procedures.record import OrthogonalitySd, PlumbSd, PositionSd, ZeroSd


class Settings(TableSettings):
    """What can be chosen; the defaults suit most tables."""


ARCSEC = float(np.pi / 648000)


class Session(TableSession):
    """The session that `simulate` makes: on a table as good as this method wants it."""

    plumb_sd: PlumbSd = 1 * ARCSEC
    orthogonality_sd: OrthogonalitySd = 1 * ARCSEC
    zero_sd: ZeroSd = 1 * ARCSEC
    position_sd: PositionSd = 1 * ARCSEC


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    trust = Trust(np.zeros(6), 0.0, settings.where(site).latitude)
    return Task("multi_position", settings, trust)


PROCEDURE = table_procedure("multi_position", __doc__, Settings, Session, task_of)
calibrate = PROCEDURE.calibrate
