"""Which rates, and how long each: among those that a table can do the best are sought.

A plan turns at some speeds, each in both senses and for the same least time, that which fills the
time of the session: a longer step never shows less. Every plan is judged by what a calibration
would state, `Procedure.foreseen` of the same session with means. With white noise of the gyros
alone that is an optimal design for ``w -> 1, w, |w|, w^3`` [1]: few speeds, the fastest among them.

References
----------
.. [1] V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, log
from typing import Any

import numpy as np
from pydantic import Field

from foucault import procedures, units
from foucault.arrays import FloatArray
from foucault.models.imu import LAYOUT
from foucault.plans.limit import Limit
from foucault.plans.optimise import StatedSpace, require_seen, weights_of
from foucault.procedures.rate_table.model import Session, Settings, in_si
from foucault.procedures.record import Beforehand, Stated
from foucault.simulate.rate_table import RatePlan
from foucault.strict import Strict
from foucault.units import Rate, Seconds

Plan = tuple[float, tuple[float, ...]]
"""Least time of a step [s], and the rates in each placement [deg/s]."""

HERE = "the session in [simulate]"

EVALUATIONS = 200  # Plans that a restart judges: each is a session of means [1].
APART = 0.1  # Speeds are whole multiples of it [deg/s].


QUARTER = 1.25  # Speeds are well apart where one is so many times the other [1].


class Wanted(Strict):
    """What may be changed of the rates of a session, and what is wanted."""

    weights: dict[str, float] = Field(default={})
    """How much each coefficient or group counts; 1 where nothing is said, 0 to leave it out."""
    time: Seconds | None = Field(default=None, gt=0, examples=["30 min"])
    """Time of all steps together; left out, that of the session in [simulate]."""
    fastest: Rate | None = Field(default=None, gt=0, examples=["100 deg/s"])
    """Fastest rate of the table; left out, that of the session."""
    slowest: Rate | None = Field(default=None, gt=0, examples=["5 deg/s"])
    """Slowest rate; left out, that of the session."""
    speeds: int = Field(default=6, ge=1, le=40)
    """Most speeds, each in both senses."""
    fewest: int = Field(default=4, ge=1, le=40)
    """Fewest speeds that are a quarter or more apart: four show whether a cubic term is all that
    there is."""


@dataclass(frozen=True)
class Table:
    """What a table can do in a session."""

    known: Beforehand[Settings, Session]
    time: float  # of all steps together [s]
    # slowest, fastest: rates, in units of `APART` [1]
    slowest: int
    fastest: int
    most: int  # speeds [1]
    fewest: int  # speeds that are `QUARTER` apart [1]

    @property
    def words(self) -> str:
        """What is allowed."""
        slow, fast = (f"{k * APART:.10g}" for k in (self.slowest, self.fastest))
        count = f"up to {self.most} speeds, {self.fewest} of them well apart,"
        return f"{count} of {slow} to {fast} deg/s in {units.span(self.time)}"

    def draw(self, rng: np.random.Generator) -> Plan | None:
        """Return a random plan; None where its steps take too long."""
        ends = log(self.slowest), log(self.fastest)
        return self.filled(np.exp(rng.uniform(*ends, size=int(rng.integers(1, self.most + 1)))))

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        speeds = [w / APART for w in plan[1] if w > 0]
        k, way = int(rng.integers(len(speeds))), rng.random()
        if way < 0.2 and len(speeds) > 1:
            del speeds[k]
        elif way < 0.4 and len(speeds) < self.most:
            speeds.append(
                speeds[k] if way < 0.3 else float(rng.uniform(self.slowest, self.fastest))
            )
        else:
            speeds[k] *= exp((0.02 + 0.5 * heat) * float(rng.standard_normal()))
        return self.filled(np.array(speeds))

    def fits(self, plan: Plan) -> bool:
        """Whether enough of the speeds of `plan` are well apart."""
        count, last = 0, 0.0
        for speed in sorted(w for w in plan[1] if w > 0):
            if speed >= QUARTER * last:
                count, last = count + 1, speed
        return count >= self.fewest

    def filled(self, speeds: FloatArray) -> Plan | None:
        """Return the plan of `speeds` (k,) [APART] that takes all of the time, in whole seconds."""
        kept = np.sort(np.clip(np.rint(speeds), self.slowest, self.fastest)).tolist()
        rates = tuple(round(sign * k * APART, 9) for k in kept for sign in (1, -1))
        longest = int(self.time / (len(rates) * len(self._axes)))
        least = int(np.ceil(self.known.settings.shortest))
        holds = range(longest, least - 1, -1)
        fitting = (
            float(hold) for hold in holds if self.duration((float(hold), rates)) <= self.time
        )
        hold = next(fitting, None)
        return None if hold is None else (hold, rates)

    @property
    def _axes(self) -> tuple[str, ...]:
        return self.known.settings.axes or self.known.session.axes

    def steps(self, plan: Plan) -> RatePlan:
        """Return what is done in each placement."""
        hold, rates = plan
        each = RatePlan(self._axes, np.radians(rates), hold)
        rest = self.known.session.rest_time
        return each.with_rests(rest) if rest else each

    def duration(self, plan: Plan) -> float:
        """Return the time of all steps in all placements [s]."""
        return len(self._axes) * float(self.steps(plan).time.sum())


def additions(settings: Settings, session: Session) -> list[tuple[str, Settings, Session]]:
    """Return plans that show more: the other sense, a second speed, the first placement again."""
    listed = settings.rates or session.rates
    rates = in_si(listed)
    speed, axes = np.abs(rates[rates != 0]), settings.axes or session.axes
    plans = []
    if (rates > 0).any() != (rates < 0).any():
        other = tuple(f"{-np.degrees(w):.10g} deg/s" for w in rates)
        plans.append(("each rate in the other sense too", {"rates": listed + other}))
    if len(speed) and speed.max() < 2 * speed.min():
        slower = tuple(f"{np.degrees(w) / 3:.10g} deg/s" for w in rates)
        plans.append(("each rate at a third of it too", {"rates": listed + slower}))
    plans.append(("the first placement again at the end", {"axes": axes + axes[:1]}))
    return [
        (words, settings.model_copy(update=told if settings.rates or settings.axes else {}),
         session.model_copy(update=told))
        for words, told in plans
    ]  # fmt: skip


def _sd(known: Beforehand[Settings, Session], plan: Plan, _: str) -> FloatArray:
    """Return the sd of every coefficient that a calibration would state, shape (p,) [SI]."""
    rates = {"rates": tuple(f"{w!r} deg/s" for w in plan[1])}
    held = {"step_time": plan[0], "rows": "means"}
    settings = known.settings
    settings = settings.model_copy(update=rates) if settings.rates else settings
    session = known.session.model_copy(update=held | rates)
    found = procedures.load("rate_table").foreseen(
        replace(known, settings=settings, session=session), more=False
    )
    assert found is not None
    return found.sd


@dataclass(frozen=True, kw_only=True)
class RateSpace(StatedSpace):
    """The rates that a table allows, for the coefficients of the gyros."""

    allowed: Table
    blind: tuple[str, ...] = ()  # what no allowed plan shows

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that no allowed plan shows."""
        return self.blind

    def fits(self, plan: Plan) -> bool:
        """Whether enough of its speeds are well apart."""
        return self.allowed.fits(plan)

    def changes(self, plan: Plan) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file."""
        hold, rates = plan
        said = [f"{w:.10g} deg/s" for w in rates]
        where = "procedure" if self.allowed.known.settings.rates else "simulate"
        timed: dict[str, dict[str, Any]] = {"simulate": {"step_time": f"{hold:.10g} s"}}
        return timed | {where: timed.get(where, {}) | {"rates": said}}

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per step."""
        done = self.allowed.steps(plan)
        turns = np.abs(done.rates) * done.time / (2 * np.pi)
        rows = (
            tuple(f"{round(v, 4):.10g}" for v in row)
            for row in zip(np.degrees(done.rates), done.time, turns, strict=True)
        )
        return (("rate (deg/s)", "time (s)", "turns"), *rows)

    def needs(self, plan: Plan) -> tuple[Limit, ...]:
        """Return what a plan needs of the table."""
        rates, time = np.abs(np.radians(plan[1])), self.allowed.duration(plan)
        most = float(np.radians(self.allowed.fastest * APART))
        return (
            Limit("rate", "angular rate", float(rates.max()), most, "deg/s"),
            Limit("time of all steps", "time", time, self.allowed.time, "s"),
        )

    def duration(self, plan: Plan) -> float:
        """Return the time of all steps [s]."""
        return self.allowed.duration(plan)


def space(b: Beforehand[Settings, Session]) -> RateSpace:
    """Return the rates among which the best are sought; those of the session are to beat."""
    wanted, names = b.wanted, procedures.load("rate_table").names(b.settings, b.session)
    layout = LAYOUT.subset(names)
    rates = np.degrees(in_si(b.settings.rates or b.session.rates))
    reference, speed = (b.session.step_time, tuple(rates.tolist())), np.abs(rates[rates != 0])
    slow, fast = (
        float(np.degrees(said)) if said is not None else found
        for said, found in ((wanted.slowest, speed.min()), (wanted.fastest, speed.max()))
    )
    limits = max(round(slow / APART), 1), round(fast / APART)
    counts = max(wanted.speeds, wanted.fewest), wanted.fewest
    table = Table(b, inf, *limits, *counts)
    time = table.duration(reference) if wanted.time is None else wanted.time
    table = Table(b, time, min(limits), max(limits), *counts)
    weights = weights_of(layout, wanted.weights)
    stated = Stated(b, _sd)
    widest = table.filled(np.linspace(min(limits), max(limits), max(counts[1], 4)))
    best = stated(reference if widest is None else widest, HERE)
    blind = require_seen(names, weights, ~np.isfinite(best), table.words)
    return RateSpace(
        allowed=table, names=names, kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights, reference=reference, reference_name=HERE,
        cases=(HERE,), stated=stated, blind=blind,
    )  # fmt: skip
