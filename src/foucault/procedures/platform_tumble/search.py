"""A better motion for a platform tumble: what may be asked, and what it is judged by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.cluster import CONSTANTS
from foucault.models.earth import earth_rate_n
from foucault.plans.tumble.limits import Allowed
from foucault.plans.tumble.reach import needs
from foucault.plans.tumble.search import Conditions, TorquingSpace
from foucault.plans.tumble.torquing import TorquingPlan
from foucault.plans.weights import weights_of
from foucault.procedures.fields import located
from foucault.procedures.platform_tumble.foresight import Planned, planned, with_plan
from foucault.procedures.platform_tumble.settings import GRADE, Session, Settings, draw_errors
from foucault.procedures.record import Beforehand
from foucault.strict import Strict
from foucault.units import Quantity, parse

DEGREE = float(np.radians(1.0))

LATITUDES = ("0 deg", "28 deg", "40 deg", "60 deg")
"""Where plans are compared beside the site itself."""

HERE = "the site"


def _latitude(text: str) -> float:
    latitude = parse(text, "angle", "latitudes")
    if abs(latitude) > np.pi / 2:
        raise error("optimise.latitude", given=np.degrees(latitude))
    return latitude


class Wanted(Strict):
    """What a better motion may do."""

    axes: Literal["x", "y", "z", "xy", "xz", "yz", "xyz"] = "xyz"
    """Axes of the cluster that may be turned."""
    rates: tuple[str, ...] = Field(default=(), examples=[["0.1 deg/s", "0.2 deg/s"]])
    """Rates about an axis that may be chosen; left out, `rate_limit`, or the largest rate of the
    plan to beat."""
    together: bool = False
    """Whether several axes may turn at once, each at that rate."""
    total: Annotated[float, Quantity("time")] | None = Field(
        default=None, gt=0, examples=["5400 s"]
    )
    """Time there is; left out, that of the plan to beat."""
    shortest: Annotated[float, Quantity("time")] = Field(default=60.0, ge=0)
    """Shortest time at one rate."""
    worst: float = Field(default=1.5, gt=0)
    """No coefficient that counts should get worse than so many times its sd under the plan to beat;
    ignored where the rig cannot do that plan."""
    latitudes: tuple[str, ...] = LATITUDES
    """Where the plan found is compared, beside the site."""
    truths: int = Field(default=4, ge=0)
    """With so many drawn clusters the plan found is compared."""
    weights: dict[str, float] = Field(
        default={}, examples=[{"gyro.drift": 2.0, "accel.quadratic": 0.0}]
    )
    """How much coefficients or groups of them count; 1 if left out."""

    @field_validator("latitudes", mode="after")
    @classmethod
    def _are_latitudes(cls, given: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        located(info, lambda: [_latitude(text) for text in given])
        return tuple(dict.fromkeys(given))


@dataclass(frozen=True)
class Stated:
    """What a calibration would state at the site, at a latitude or for a drawn cluster."""

    given: Beforehand[Settings, Session]  # all but the plan

    def __call__(self, plan: TorquingPlan, case: str) -> FloatArray:
        """Return the sd of the 42 constants: bound, slow noise, latitude and gravity [SI]."""
        return self.planned(plan, case).sd

    def planned(self, plan: TorquingPlan, case: str) -> Planned:
        """Return the motion, linearised in the circumstances of `case`."""
        site, drawn = self.given.site, None
        kind, _, number = case.partition(" ")
        if kind == "latitude":
            site = replace(site, latitude=_latitude(number))
        elif kind == "cluster":
            drawn = draw_errors(GRADE, int(number))
        settings = with_plan(self.given.settings, plan)
        return planned(replace(self.given, settings=settings, site=site), drawn)


def space(b: Beforehand[Settings, Session]) -> TorquingSpace:
    """Return the motions that are allowed; the plan to beat is the campaign's, or the published."""
    settings, site, wanted = b.settings, b.site, b.wanted
    weights = weights_of(CONSTANTS, wanted.weights)
    reference = settings.planned
    allowed = Allowed(
        rates=_rates(settings, wanted, reference),
        axes=wanted.axes,
        together=wanted.together,
        total=wanted.total or sum(step.time for step in reference.steps),
        shortest=wanted.shortest,
        start=settings.angles,
        ramp=settings.ramp,
        limits=settings.limits,
    )
    stated = Stated(b)
    p = stated.planned(reference, HERE)
    assert site.latitude is not None
    t = p.tumble
    conditions = Conditions(
        w_ie_n=earth_rate_n(site.latitude),
        constants=p.simulation.model.packed(site.gravity),
        prior_sd=p.prior.unit,
        C_np=np.ascontiguousarray(p.simulation.C_pn[0].T),
        gyro_psd=t.gyro_psd,
        accel_psd=t.accel_variance * float(t.dt[0]),
        arms=t.arms,
        gravity=site.gravity,
    )
    possible = all(limit.kept for limit in needs(reference, settings.limits))
    cases = [HERE, *(f"latitude {text}" for text in wanted.latitudes)]
    cases += [f"cluster {k}" for k in range(1, wanted.truths + 1)]
    return TorquingSpace(
        allowed=allowed,
        conditions=conditions,
        names=CONSTANTS.names,
        kinds=tuple(c.kind for c in CONSTANTS.coefficients),
        weights=weights,
        reference=reference,
        reference_sd=np.sqrt(np.diag(p.fit.start_cov))[3:45] / p.prior.unit[3:45],
        worst=wanted.worst if possible else np.inf,
        cases=tuple(cases),
        stated=stated,
        findings=p.told,
    )


def _rates(settings: Settings, wanted: Wanted, reference: TorquingPlan) -> tuple[float, ...]:
    limit = settings.rate_limit
    usual = (limit or float(np.abs(reference.rates).max()),)
    rates = tuple(parse(text, "angular rate", "optimise.rates") for text in wanted.rates)
    for rate in rates or usual:
        if not 0 < rate <= (limit or np.inf) * (1 + 1e-9):
            known = "any" if limit is None else f"up to {np.degrees(limit):.4g} deg/s"
            raise error("optimise.rate", given=f"{np.degrees(rate):.4g}", limit=known)
    return tuple(dict.fromkeys(rates or usual))
