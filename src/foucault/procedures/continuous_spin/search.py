"""Which speeds in which mountings, of the same time in all: the best that a tool can do are sought.

A plan turns at some speeds, one of them backwards at least, in each of some mountings, and for the
same time, that which fills the time of the session. It is judged by what a calibration would state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log
from typing import Any, get_args

import numpy as np
from pydantic import Field

from foucault import procedures, units
from foucault.arrays import FloatArray
from foucault.models.imu import LAYOUT
from foucault.plans.limit import Limit
from foucault.plans.optimise import StatedSpace, require_seen, weights_of
from foucault.procedures.continuous_spin.model import SPAN
from foucault.procedures.rate_table.model import in_si
from foucault.procedures.record import Beforehand, Stated
from foucault.simulate.spin import Mounting
from foucault.strict import Strict
from foucault.units import Rate, Seconds

Plan = tuple[float, tuple[str, ...], tuple[float, ...]]
"""Length of a spin [s], mountings, and rates in each of them [deg/s]."""

HERE = "the session in [simulate]"

EVALUATIONS = 12
"""Plans that a restart judges: each is a simulated session [1]."""

MOUNTINGS = tuple(get_args(Mounting))


class Wanted(Strict):
    """What may be changed of spins, and what is wanted."""

    weights: dict[str, float] = Field(default={})
    """How much each coefficient or group counts; 1 where nothing is said, 0 to leave it out."""
    time: Seconds | None = Field(default=None, gt=0, examples=["3 min"])
    """Time of all spins together; left out, that of the session in [simulate]."""
    fastest: Rate | None = Field(default=None, gt=0, examples=["570 deg/s"])
    """Fastest rate of the tool; left out, that of the session."""
    slowest: Rate | None = Field(default=None, gt=0, examples=["100 deg/s"])
    """Slowest rate; left out, that of the session."""
    speeds: int = Field(default=4, ge=2, le=8)
    """Most spins in a mounting."""
    mountings: int = Field(default=4, ge=3, le=7)
    """Most mountings."""


@dataclass(frozen=True)
class Tool:
    """What a tool can do in a session."""

    known: Beforehand[Any, Any]
    time: float  # of all spins together [s]
    slowest: float  # [deg/s]
    fastest: float  # [deg/s]
    speeds: int  # most in a mounting [1]
    mountings: int  # most [1]

    @property
    def words(self) -> str:
        """What is allowed."""
        return (f"up to {self.speeds} speeds of {self.slowest:.4g} to {self.fastest:.4g} deg/s in "
                f"up to {self.mountings} mountings, {units.span(self.time)} in all")  # fmt: skip

    def draw(self, rng: np.random.Generator) -> Plan | None:
        """Return a random plan; None where none was found that calibrates."""
        size = np.exp(rng.uniform(log(self.slowest), log(self.fastest),
                                  int(rng.integers(2, self.speeds + 1))))  # fmt: skip
        sense = np.where(np.arange(len(size)) % 2, -1.0, 1.0)
        many = int(rng.integers(3, self.mountings + 1))
        more = rng.choice(len(MOUNTINGS), many - 3)
        return self.filled(("x", "y", "z", *(MOUNTINGS[k] for k in more)), size * sense)

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        mountings, rates, way = list(plan[1]), np.array(plan[2]), rng.random()
        if way < 0.15:
            if len(mountings) > 3 and rng.random() < 0.5:
                del mountings[int(rng.integers(3, len(mountings)))]
            elif len(mountings) < self.mountings:
                mountings.append(MOUNTINGS[int(rng.integers(len(MOUNTINGS)))])
        elif way < 0.3 and len(rates) > 2:
            rates = np.delete(rates, int(rng.integers(len(rates))))
        elif way < 0.45 and len(rates) < self.speeds:
            rates = np.append(rates, -rates[int(rng.integers(len(rates)))] * rng.uniform(0.5, 1))
        else:
            k = int(rng.integers(len(rates)))
            rates[k] *= np.exp((0.05 + 0.5 * heat) * rng.standard_normal())
        return self.filled(tuple(mountings), rates)

    def filled(self, mountings: tuple[str, ...], rates: FloatArray) -> Plan | None:
        """Return the plan of `rates` (k,) [deg/s] that takes all of the time; None if it cannot."""
        size = np.round(np.clip(np.abs(rates), self.slowest, self.fastest))
        hold = float(int(self.time / len(mountings) / len(rates)))
        both = (rates > 0).any() and (rates < 0).any() and size.max() >= SPAN * size.min()
        if not both or hold < self.known.settings.shortest + 1:
            return None
        return hold, mountings, tuple((size * np.sign(rates)).tolist())


@dataclass(frozen=True, kw_only=True)
class SpinSpace(StatedSpace):
    """The spins that a tool allows."""

    def changes(self, plan: Plan) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file."""
        return {"simulate": _session(plan) | {"spin_time": f"{plan[0]:g} s"}}

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per spin."""
        rows = [(m, f"{w:g}", f"{plan[0]:g}", f"{abs(w) * plan[0] / 360:.3g}")
                for m in plan[1] for w in plan[2]]  # fmt: skip
        return (("along the axis", "rate (deg/s)", "time (s)", "turns"), *rows)

    def needs(self, plan: Plan) -> tuple[Limit, ...]:
        """Return what a plan needs of the tool."""
        rate, most = np.radians([np.abs(plan[2]).max(), self.allowed.fastest]).tolist()
        return (
            Limit("rate", "angular rate", rate, most, "deg/s"),
            Limit("time of all spins", "time", self.duration(plan), self.allowed.time, "s"),
        )

    def duration(self, plan: Plan) -> float:
        """Return the time of all spins [s]."""
        return plan[0] * len(plan[1]) * len(plan[2])


def _session(plan: Plan) -> dict[str, Any]:
    return {"mountings": [*plan[1]], "rates": [f"{w:g} deg/s" for w in plan[2]]}


def _sd(known: Beforehand[Any, Any], plan: Plan, _: str) -> FloatArray:
    """Return the sd of every coefficient that a calibration would state, shape (p,) [SI]."""
    told = {name: tuple(some) for name, some in _session(plan).items()} | {"spin_time": plan[0]}
    session = known.session.model_copy(update=told)
    found = procedures.load("continuous_spin").foreseen(replace(known, session=session), more=False)
    assert found is not None
    return found.sd


def space(b: Beforehand[Any, Any]) -> SpinSpace:
    """Return the spins among which the best are sought; those of the session are to beat."""
    wanted, session = b.wanted, b.session
    names = procedures.load("continuous_spin").names(b.settings, session)
    layout, rates = LAYOUT.subset(names), np.degrees(in_si(session.rates))
    reference = (session.spin_time, tuple(session.mountings), tuple(rates.tolist()))
    slow, fast = (
        float(np.degrees(said)) if said is not None else float(found)
        for said, found in ((wanted.slowest, np.abs(rates).min()),
                            (wanted.fastest, np.abs(rates).max()))
    )  # fmt: skip
    time = wanted.time or session.spin_time * len(session.mountings) * len(rates)
    tool = Tool(b, time, min(slow, fast), max(slow, fast), wanted.speeds, wanted.mountings)
    weights, stated = weights_of(layout, wanted.weights), Stated(b, _sd)
    require_seen(names, weights, ~np.isfinite(stated(reference, HERE)), tool.words)
    return SpinSpace(
        allowed=tool, names=names, kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights, reference=reference, reference_name=HERE, cases=(HERE,), stated=stated,
    )  # fmt: skip
