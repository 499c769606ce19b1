"""Which way a session is guided, and what is wanted of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from foucault import procedures
from foucault.campaign import Campaign
from foucault.capture.guide import Guide
from foucault.capture.hand import ByHand
from foucault.capture.listed import OnTable
from foucault.capture.six import OnSix
from foucault.capture.step import Wanted, Way
from foucault.capture.stops import AtStops
from foucault.detect.stretches import How
from foucault.errors import error
from foucault.logs.description import LogDescription
from foucault.models.noise import grade
from foucault.plans.directions import positions
from foucault.procedures.on_table.plan import bench
from foucault.procedures.record import Beforehand, Given, Procedure
from foucault.result import Result

TABLES = ("norm_observation", "multi_position", "turntable")
"""Procedures of which the positions of the plan are ticked."""

GUIDED = ("hand_rotated", "six_position", *TABLES, "north_seeking")
"""Procedures whose sessions are guided."""

HOLD = 7.0
"""Time to rest, where neither a plan nor anyone says it [s]."""


@dataclass(frozen=True)
class Asked:
    """What a guide is asked for."""

    campaign: Campaign
    hold: float | None = None  # time to rest, None: of the plan, or `HOLD` [s]
    want: Mapping[str, str] | None = None  # coefficient or group -> uncertainty with its unit


def wants(texts: Sequence[str]) -> dict[str, str]:
    """Return what is wanted as ``--want`` has it: coefficient or group -> uncertainty."""
    out = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and name and value):
            raise error("guide.want", given=text)
        out[name] = value
    return out


def beforehand(campaign: Campaign) -> Beforehand[Any, Any]:
    """Return what the usual session of a campaign is judged by."""
    typical = grade(campaign.simulate.grade).noise
    return Beforehand(
        campaign.settings, campaign.session, campaign.site, campaign.noise, campaign.prior,
        typical, campaign.sizes,
    )  # fmt: skip


def given_of(campaign: Campaign) -> Given[Any]:
    """Return what a calibration of the campaign is given."""
    site, settings = campaign.site, campaign.settings
    if isinstance(settings, procedures.record.EarthRate):
        site = settings.where(site)
    return Given(site, settings, campaign.noise, campaign.prior or {}, procedures.silent,
                 campaign.sizes)  # fmt: skip


def judge_of(procedure: Procedure[Any, Any], campaign: Campaign) -> Callable[[Any], Result]:
    """Return what calibrates a log as the campaign would."""

    def judge(log: Any) -> Result:
        return procedure.calibrate(
            log, site=campaign.site, settings=campaign.settings, noise=campaign.noise,
            prior=campaign.prior, sizes=campaign.sizes, instrument=campaign.instrument,
        )  # fmt: skip

    return judge


def guide_of(asked: Asked, used: LogDescription) -> Guide:
    """Return the guide of a campaign; `used`: the complete description of its log."""
    campaign = asked.campaign
    if campaign.procedure not in GUIDED:
        raise error("guide.procedure", name=campaign.procedure, allowed=", ".join(GUIDED))
    procedure = procedures.load(campaign.procedure)
    s, judge = campaign.settings, judge_of(procedure, campaign)
    if campaign.procedure in TABLES:
        # The rests of a table are those of its plan: none is much shorter.
        how = How(shortest=min(s.shortest, campaign.session.rest_time / 2))
        return Guide(_on_table(asked, used.gyro is not None), used, judge, how)
    if campaign.procedure == "north_seeking":
        way = _at_stops(asked, procedure, used.gyro is not None)
        return Guide(way, used, lambda _log: way.result(), How())
    usual = procedure.planned(beforehand(campaign))
    assert usual is not None
    found = usual.found.coefficients
    names = [n for n in found.names if used.gyro is not None or n.startswith("accel.")]
    found = found.chosen(names)
    wanted = Wanted.of(found.layout, found.sd, asked.want or {})
    given, gyro = given_of(campaign), used.gyro is not None
    kind: Any = {"hand_rotated": ByHand, "six_position": OnSix}[campaign.procedure]
    by: Way = kind(given, wanted, HOLD if asked.hold is None else asked.hold, gyro)
    how = How(s.window, s.shortest, s.threshold)
    return Guide(by, used, judge, how)


def _at_stops(asked: Asked, procedure: Procedure[Any, Any], gyro: bool) -> AtStops:
    """Return the stops of a campaign's plan."""
    from foucault.procedures.north_seeking.settings import planned

    campaign = asked.campaign
    if not gyro:
        raise error("guide.no_gyro")
    plan = planned(campaign.settings, campaign.session)
    usual = procedure.foreseen(beforehand(campaign), more=False)
    assert usual is not None
    found = usual.coefficients
    wanted = Wanted.of(found.layout, found.sd, asked.want or {})
    session, judge = campaign.session, judge_of(procedure, campaign)
    stops = session.motion(campaign.settings.index_limit)
    return AtStops(plan, stops, wanted, session.accelerometers, judge, campaign.text, asked.hold)


def _on_table(asked: Asked, gyro: bool) -> OnTable:
    """Return the positions of a campaign's plan."""
    campaign, b = asked.campaign, beforehand(asked.campaign)
    task_of = import_module(f"foucault.procedures.{campaign.procedure}").task_of
    where = (campaign.site,) if campaign.procedure != "norm_observation" else ()
    site = campaign.site if gyro else replace(campaign.site, latitude=None)
    task = task_of(campaign.settings, *where).where(b.sizes)
    made = bench(task, replace(b, site=site))
    plan = made.plan(positions(campaign.settings.chosen)[1])
    found = made.bound(plan)
    wanted = Wanted.of(found.layout, found.sd, asked.want or {})
    return OnTable(made, plan, wanted, asked.hold, gyro)


def worst(guide: Guide) -> float:
    """Return the largest of what is reached over what is wanted, shape () [1]."""
    if guide.reached is None:
        return float("inf")
    with np.errstate(invalid="ignore"):
        return float(np.max(guide.reached.sd / guide.way.wanted.sd))
