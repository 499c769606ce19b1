"""A planned systematic calibration: what it will show, and what a better plan may do."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.diagnose.foresight import Limit
from foucault.errors import error
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, grade
from foucault.plans.manoeuvres import Rotate
from foucault.plans.systematic.built_in import SPIN_RATE, built_in
from foucault.plans.systematic.moves import Allowed
from foucault.plans.systematic.search import SystematicSpace, sd_limit
from foucault.plans.systematic.sequence import RATE, CalibrationSequence
from foucault.plans.weights import weights_of
from foucault.procedures.fields import Shortest, located
from foucault.procedures.record import Beforehand
from foucault.procedures.systematic.bound import Foreseen, Prior, foreseen
from foucault.procedures.systematic.problem import steady
from foucault.procedures.systematic.quick import Quick
from foucault.procedures.systematic.settings import (
    FIRST,
    GRADE,
    LAYOUT,
    Session,
    Settings,
    draw_errors,
    planned,
)
from foucault.strict import Strict
from foucault.units import Quantity, Seconds, parse

HERE = "the site"
OTHERS = ("latitude 0 deg", "latitude 60 deg", "instrument 1", "turns counted otherwise")
"""Where a plan found is compared, and what else is changed there."""

SPINS = 6
"""Spins that a model of deflection takes [1]."""


class Wanted(Strict):
    """What a better sequence may do."""

    total: Seconds | None = Field(default=None, gt=0, examples=["45 min"])
    """Time there is; left out, that of the plan to beat, or any with `accuracy`."""
    accuracy: dict[str, str] = Field(default={}, examples=[{"deflection": "0.0085 arcsec/g"}])
    """Largest standard deviation that is wanted of coefficients or groups of them: the shortest
    sequence that reaches it is sought. Left out, the smallest uncertainty."""
    first: str | None = Field(default=None, examples=["19 positions"])
    """Built-in sequence of quarter turns to begin with; left out, that of the plan."""
    poses: int | None = Field(default=None, ge=0, le=24, examples=[6])
    """Number of spins; left out, six where there is a model of deflection."""
    most_turns: int = Field(default=40, ge=1)
    """Most turns of a spin."""
    shortest: Shortest = 20.0
    longest: Seconds = Field(default=600.0, gt=0)
    """Longest rest."""
    move_rate: Annotated[float, Quantity("angular rate")] = Field(default=RATE, gt=0)
    """Rate of all turns but the spins."""
    alike: bool = True
    """Whether the rests between quarter turns are alike."""
    weights: dict[str, float] = Field(default={}, examples=[{"deflection": 3.0, "accel": 0.0}])
    """How much coefficients or groups of them count; 1 if left out."""

    @field_validator("accuracy", mode="after")
    @classmethod
    def _known(cls, given: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        located(info, lambda: [accuracy_of(name, text) for name, text in given.items()])
        return given

    @field_validator("first", mode="after")
    @classmethod
    def _there(cls, given: str | None, info: ValidationInfo) -> str | None:
        if given is not None:
            located(info, lambda: [built_in(given)])
        return given


def accuracy_of(name: str, text: str) -> float:
    """Return a wanted standard deviation of a coefficient or a group of them [SI]."""
    kinds = {LAYOUT.coefficients[i].kind for i in LAYOUT.group(name)}
    sd = parse(text, kinds.pop(), f"accuracy.{name}") if len(kinds) == 1 else 0.0
    if not sd > 0:
        raise error("systematic.accuracy", name=name, given=text)
    return sd


def members(layout: Layout, wanted: Wanted) -> dict[str, tuple[list[int], float]]:
    """Return which coefficients each wanted accuracy is of, and how large it is [SI]."""
    out = {}
    for name, text in wanted.accuracy.items():
        at_ = [k for k, n in enumerate(layout.names) if n == name or n.startswith(f"{name}.")]
        if not at_:
            groups = ", ".join(dict.fromkeys(n.rpartition(".")[0] or n for n in layout.names))
            raise error("systematic.accuracy_unknown", name=name, allowed=groups)
        out[name] = (at_, accuracy_of(name, text))
    return out


def settled(settings: Settings) -> Settings:
    """Return settings with a model of deflection, where it is yet to be chosen."""
    if settings.deflection == "choose":
        return settings.model_copy(update={"deflection": FIRST})
    return settings


def noise_of(noise: ImuNoise | None, typical: ImuNoise | None) -> ImuNoise:
    """Return the noise to reckon with [SI]."""
    return noise or typical or grade(GRADE).noise


# -- a better plan -------------------------------------------------------------------------------


@dataclass
class Stated:
    """What a calibration of a sequence would state, without the approximations of a search."""

    settings: Settings  # what was chosen of the filter
    rate: float  # sample rate [Hz]
    site: Site
    noise: ImuNoise  # to reckon with [SI]
    prior: Prior  # what is known beforehand [SI]
    # (p,) what was stated before [SI]
    _kept: dict[str, FloatArray] = field(default_factory=dict, repr=False)

    def __call__(self, sequence: CalibrationSequence, case: str) -> FloatArray:
        """Return the sd of every state that is a coefficient, shape (p,) [SI]."""
        key = f"{case} {sequence.start.tolist()} {sequence.actions}"
        if key not in self._kept:
            self._kept[key] = self.foreseen(sequence, case).states.sd
        return self._kept[key]

    def foreseen(self, sequence: CalibrationSequence, case: str = HERE) -> Foreseen:
        """Return the session in the circumstances of `case`."""
        site, settings, drawn = self.site, self.settings, None
        kind, _, what = case.partition(" ")
        if kind == "latitude":
            site = replace(site, latitude=parse(what, "angle"))
        elif kind == "instrument":
            drawn = draw_errors(GRADE, int(what))
        elif kind == "turns":
            settings = settings.model_copy(update={"decorrelate": not settings.restarts})
        return foreseen(sequence, settings, rate=self.rate, site=site, noise=self.noise,
                        prior=self.prior, instrument=drawn)  # fmt: skip


def space(b: Beforehand[Settings, Session]) -> SystematicSpace:
    """Return the sequences that are allowed; the plan to beat is the campaign's."""
    settings, session, site, wanted = b.settings, b.session, b.site, b.wanted
    if settings.steps == "published":
        raise error("systematic.search_published")
    settings, reference = settled(settings), planned(settings, session)
    used, layout = noise_of(b.noise, b.typical), settings.sensors.layout
    stated = Stated(settings, session.rate, site, used, b.prior)
    p = steady(stated.foreseen(reference).problem)
    quick = Quick(site, settings.sensors, used, p.at_rest, p.start_cov())
    return SystematicSpace(
        allowed=_allowed(settings, wanted, reference),
        names=layout.names,
        kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights_of(layout, wanted.weights),
        prior_sd=p.prior.prior_sd,
        accuracy={name: sd for name, (_, sd) in members(layout, wanted).items()},
        reference=reference,
        reference_name=reference.name,
        cases=(HERE, *OTHERS),
        quick=quick.sd,
        stated=stated,
    )


def _allowed(settings: Settings, wanted: Wanted, reference: CalibrationSequence) -> Allowed:
    turns = [a for a in reference.actions if isinstance(a, Rotate)]
    rate = settings.rate_limit or max([SPIN_RATE, *(t.rate for t in turns)])
    quarters = [name for name in settings.sequence if "positions" in name]
    usual = SPINS if settings.model is not None else 0
    return Allowed(
        first=wanted.first or (quarters[0] if quarters and not settings.actions else FIRST_PART),
        total=wanted.total or (inf if wanted.accuracy else reference.duration),
        poses=usual if wanted.poses is None else wanted.poses,
        rate=rate,
        moves=min(wanted.move_rate, rate),
        step=settings.angle_step or 0.0,
        shortest=max(wanted.shortest, settings.shortest),
        longest=wanted.longest,
        most=wanted.most_turns,
        alike=wanted.alike,
        fill=not wanted.accuracy,
    )


FIRST_PART = "19 positions"
"""The first part where the plan to beat does not name one."""


def wanted_limits(
    wanted: Wanted | None, states: CoefficientVector, duration: float
) -> tuple[Limit, ...]:
    """Return what a session attains of what is wanted.

    `wanted` or None: what is wanted; `states`: what will be known [SI]; `duration`: time it takes
    [s].
    """
    if wanted is None:
        return ()
    out = [Limit("time", "time", duration, wanted.total)] if wanted.total is not None else []
    for name, (at_, sd) in members(states.layout, wanted).items():
        kind = states.layout.coefficients[at_[0]].kind
        out.append(sd_limit(name, kind, float(states.sd[at_].max()), sd))
    return tuple(out)
