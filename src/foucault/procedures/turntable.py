"""Calibrate an IMU and the table it stands on, all at once.

The angles of the table are believed with errors of known size: tilt of the outer axis, axes that
are not perpendicular, zero errors, and another error in every position. All are estimated with
the instrument. On a perfect table this is as good as the traditional method, on a bad one as norm
observation, and in between better than both; and it says how good the table is.
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
    """Calibrate an IMU and the table it stands on.

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
        Coefficients with covariance, checks and a verdict; the table's own errors are in its
        table "rig" [SI].
    """
    settings = settings or Settings()
    return on_table.calibrate(
        log, task_of(settings, site), site=site, noise=noise, prior=prior,
        instrument=instrument, progress=progress,
    )  # fmt: skip


def task_of(settings: Settings, site: Site) -> Task:
    """Return the task that `settings` describe at a `site`."""
    s = settings
    latitude = site.latitude if s.earth_rate else None
    common = np.repeat([s.plumb_sd, s.orthogonality_sd, s.zero_sd], 2)
    trust = Trust(common, s.position_sd, latitude)
    return Task("turntable", settings, trust, repeatability=s.repeatability)


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
