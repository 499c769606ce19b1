"""Calibrate an IMU on a table whose angles are taken as exact: multi-position least squares.

The traditional method: every rest gives the three components of specific force, and every spin
those of the rate, in the axes of the case; a least-squares fit gives the coefficients. Errors of
the table go into them. `turntable` estimates those errors too; `norm_observation` does without
the angles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from foucault.diagnose.foresight import Foresight
from foucault.logs.streaming import OnDisk
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.table_geometry import Trust
from foucault.plans.table.search import PositionSpace
from foucault.plans.table.search import Wanted as Wanted
from foucault.procedures import Progress, on_table, silent
from foucault.procedures.on_table import STREAMS as STREAMS
from foucault.procedures.on_table import STRETCHES as STRETCHES
from foucault.procedures.on_table import Task
from foucault.procedures.on_table import plan as table_plan
from foucault.procedures.on_table.plan import UNDECLARED as UNDECLARED
from foucault.procedures.on_table.session import LOG_LINES as LOG_LINES
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate
from foucault.result import Result
from foucault.tables import Log
from foucault.units import AngleSd


class Settings(TableSettings):
    """What can be chosen; the defaults suit most tables."""

    repeatability: bool = Field(
        default=True,
        description="Estimate the scatter between readings that the noise does not explain, such "
        "as the errors of the table.",
    )


ARCSEC = float(np.pi / 648000)


class Session(TableSession):
    """The session that `simulate` makes: on a table as good as this method wants it."""

    plumb_sd: AngleSd = Field(
        default=1 * ARCSEC, ge=0, description="Sd of the tilt of the outer axis."
    )
    orthogonality_sd: AngleSd = Field(
        default=1 * ARCSEC, ge=0, description="Sd of the angles between the table's axes."
    )
    zero_sd: AngleSd = Field(
        default=1 * ARCSEC, ge=0, description="Sd of the zero errors of middle and inner angle."
    )
    position_sd: AngleSd = Field(
        default=1 * ARCSEC,
        ge=0,
        description="Sd of the middle and inner angle from one position to the next.",
    )


names_of = on_table.names_of


def calibrate(
    log: Log | OnDisk,
    *,
    site: Site,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Result:
    """Calibrate an IMU by the angles of a table.

    Parameters
    ----------
    log : Log or OnDisk
        Samples with the angles of the table, or means over positions [SI].
    site : Site
        Local gravity, and the latitude where there are gyros.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the instrument [SI]; None measures it.
    prior : mapping of str to (float, float) or None
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    instrument : mapping or None
        Name, serial and so on, kept in the result.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    Result
        Coefficients with covariance, checks and a verdict [SI].
    """
    settings = settings or Settings()
    return on_table.calibrate(
        log, task_of(settings, site), site=site, noise=noise, prior=prior,
        instrument=instrument, progress=progress,
    )  # fmt: skip


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    latitude = site.latitude if settings.earth_rate else None
    trust = Trust(np.zeros(6), 0.0, latitude)
    return Task("multi_position", settings, trust, repeatability=settings.repeatability)


def space(
    settings: Settings, wanted: Wanted, *, session: Session, site: Site, noise: ImuNoise | None,
    prior: Mapping[str, tuple[float, float]], typical: ImuNoise | None = None,
) -> PositionSpace:  # fmt: skip
    """Return the positions to seek a better plan among; `prior` as a campaign has it [SI]."""
    return table_plan.space(
        task_of(settings, site), wanted, session=session, site=site, noise=noise, prior=prior,
        typical=typical,
    )  # fmt: skip


def foresee(
    settings: Settings, *, session: Session, site: Site, noise: ImuNoise | None,
    prior: Mapping[str, tuple[float, float]], typical: ImuNoise | None = None,
) -> Foresight:  # fmt: skip
    """Return what the session will show; noise and `prior` as a campaign has them [SI]."""
    return table_plan.foresee(
        task_of(settings, site),
        session=session,
        site=site,
        noise=noise,
        prior=prior,
        typical=typical,
    )
