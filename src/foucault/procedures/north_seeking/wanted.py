"""What a search for stops of a north seeker is told, and the space of plans that follows."""

from __future__ import annotations

from math import inf

import numpy as np
from pydantic import Field

from foucault.coefficients import Coefficient, Layout
from foucault.diagnose.north.plan import Conditions
from foucault.errors import error
from foucault.plans.north.bound import Known
from foucault.plans.north.moves import Rig, schedule
from foucault.plans.north.search import NorthSpace
from foucault.plans.weights import require_seen, weights_of
from foucault.procedures.north_seeking.foresight import silent
from foucault.procedures.north_seeking.settings import Ramp, Session, Settings
from foucault.procedures.record import Beforehand
from foucault.strict import Strict
from foucault.units import AngleSd, Seconds

SOUGHT = Layout((Coefficient("heading", "psi", "angle", "Heading of the case"),))
"""What a plan is made for."""


class Wanted(Strict):
    """What may be changed of the stops of the base in a set-up, and what is wanted."""

    weights: dict[str, float] = Field(default={})
    """How much each counts; here there is "heading" alone."""
    time: Seconds | None = Field(default=None, gt=0, examples=["300 s"])
    """Time of a set-up, moves included; left out, that of the stops in [simulate]."""
    stops: int = Field(default=24, ge=2)
    """Most stops of a set-up."""
    opposite: bool = True
    """Every stop has its opposite, so that what repeats with the index angle cancels."""
    drift: Ramp | None = Field(default=None, ge=0, examples=["0.1 deg/h/h"])
    """Linear drift of the gyro to expect, whose effect counts where the solution does not estimate
    it; left out, gyro_drift of [simulate]."""
    rough_sd: AngleSd | None = Field(default=None, gt=0, examples=["2 deg"])
    """Sd of a rough heading that will be known: then index angles count from it, and the stops can
    look east and west."""


def space(b: Beforehand[Settings, Session]) -> NorthSpace:
    """Return the orders of stops among which the best is searched.

    They are those that the base can do; the stops of the session are those to beat. The noise of
    the instrument must be known.
    """
    settings, session, site, noise, wanted = b.settings, b.session, b.site, b.noise, b.wanted
    weights = weights_of(SOUGHT, wanted.weights)
    if noise is None or not noise.gyro.white > 0:
        raise error("north_search.noise")
    if site.latitude is None:
        raise error("north.fix_latitude")
    level = settings.level_sd if session.accelerometers == "none" else None
    if session.accelerometers == "none" and level is None:
        raise error("north.level_sd")
    if wanted.rough_sd is not None and settings.unknown_latitude:
        raise error("north_search.latitude")
    conditions = Conditions(
        site.latitude, noise, settings.latitude_sd, not settings.unknown_latitude,
        index_sd=settings.index_sd, level_sd=level,
        offset_sd=inf if settings.gyro_offset_sd is None else settings.gyro_offset_sd,
    )  # fmt: skip
    known = Known(
        conditions, abs(session.gyro_drift) if wanted.drift is None else wanted.drift,
        settings.drift, settings.drift_sd,
        session.accelerometers == "case", wanted.rough_sd,
    )  # fmt: skip
    motion = session.motion(settings.index_limit)
    rig = Rig(
        total=motion.length if wanted.time is None else wanted.time,
        move=session.move,
        shortest=settings.shortest,
        settle=settings.settle if session.rows == "samples" else 0.0,
        most=wanted.stops,
        index_limit=inf if settings.index_limit is None else settings.index_limit,
        index_step=settings.index_step,
        opposite=wanted.opposite,
    )
    found = NorthSpace(rig, known, schedule(motion.index, motion.dwell, rig), session.called,
                       silent(session, noise))  # fmt: skip
    require_seen(SOUGHT.names, weights, np.array([not found.shows()]), found.limits)
    return found
