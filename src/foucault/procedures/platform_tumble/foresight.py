"""What the planned motion of a tumble will show: simulated without noise, linearised, judged.

The covariance does not depend on the readings, only on motion, noise and prior, so that the
uncertainty of a tumble is known before it is made. The motion depends a little on the errors of
the cluster, which turn it by degrees in an hour, and on where it starts: the usual errors are
taken where [prior] does not name them, and the attitude that [simulate] gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import hardly
from foucault.diagnose.foresight import Extra, Foresight, Leg
from foucault.diagnose.tumble import checks as tumble_checks
from foucault.diagnose.tumble import input as tumble_input
from foucault.diagnose.tumble import report as tumble_report
from foucault.diagnose.tumble.checks import Evidence
from foucault.errors import Finding, error, finding
from foucault.estimate.tumble import fit as estimation
from foucault.estimate.tumble.fit import Fit, Prior, State, Tumble
from foucault.models.cluster import CONSTANTS, SOURCE_SYMBOLS, ClusterModel
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.plans.tumble.reach import needs
from foucault.plans.tumble.torquing import Step, TorquingPlan
from foucault.procedures.platform_tumble.problem import is_slow, noise_of, prior_of, tumble_of
from foucault.procedures.platform_tumble.settings import (
    NOISE,
    PRIOR,
    PlanStep,
    Session,
    Settings,
    simulated,
)
from foucault.procedures.platform_tumble.solution import Solution, coefficients, owed_by
from foucault.procedures.record import Beforehand
from foucault.simulate.tumble import TumbleSimulation
from foucault.tables import AXES

FORETOLD = ("tumble.singular", "tumble.condition", "tumble.azimuth")
"""What is said of a solution that can be said beforehand."""


@dataclass(frozen=True)
class Planned:
    """The planned motion, linearised."""

    given: Beforehand[Settings, Session]  # the plan, and how it will be sampled
    simulation: TumbleSimulation  # the motion, without noise
    noise: ImuNoise  # what is weighed [SI]
    tumble: Tumble  # the log of it
    prior: Prior  # what is known beforehand
    fit: Fit  # the bound about what was simulated
    at: str  # where that is, in words
    told: tuple[Finding, ...]  # what was noticed on the way

    @property
    def found(self) -> CoefficientVector:
        """All 45 with the covariance that a calibration would state."""
        b, t, fit = self.given, self.tumble, self.fit
        owed = owed_by(t, self.prior, fit, b.settings, b.site, self.noise)
        solution = Solution(t, self.prior, fit, fit.cov, owed, b.settings, b.site, self.noise)
        return coefficients(solution)

    @property
    def sd(self) -> FloatArray:
        """The sd of the 42 constants that a calibration would state, shape (42,) [SI]."""
        return np.asarray(self.found.sd[: len(CONSTANTS)])


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what the planned motion will show."""
    p = planned(b)
    return seen(p, more(p))


def planned(b: Beforehand[Settings, Session], errors: ClusterModel | None = None) -> Planned:
    """Simulate the planned motion without noise, and linearise it.

    `errors`: errors of the cluster, None takes the means in the prior and usual errors elsewhere.
    """
    settings, session, site, prior = b.settings, b.session, b.site, b.prior
    told = []
    if settings.filter != "gauss-newton":
        if settings.delay_sd:
            raise error("tumble.filter_delay", filter=settings.filter)
        told.append(finding("preflight.filter", filter=settings.filter))
    noise = b.noise or ImuNoise()
    if not noise.accel.white > 0:
        noise = replace(noise, accel=replace(noise.accel, white=NOISE.accel.white))
        given = f"{NOISE.accel.white / 9.80665e-6:.3g}"
        told.append(finding("preflight.noise", given=given))
    made = _simulated(settings, session, site, errors or _usual(prior))
    tumble_input.require_readings(made.log, site, settings.rate_limit)
    used, said = noise_of(made.log, noise)
    tumble, more = tumble_of(made.log, site, settings, used)
    known = prior_of(settings, site, prior)
    truth = State(made.C_pn[0].T, made.model.packed(site.gravity))
    fit = estimation.bound(tumble, known, truth)
    away = ", ".join(session.attitude)
    usual = "means in [prior], usual errors elsewhere" if prior else "usual errors"
    at = f"{usual}, and an attitude ({away}) from `start`"
    return Planned(b, made, used, tumble, known, fit, at, (*told, *said, *more))


def _simulated(
    settings: Settings, session: Session, site: Site, errors: ClusterModel
) -> TumbleSimulation:
    """Simulate with nothing drawn: given errors, the attitude of the session, no delay."""
    sure = settings.model_copy(update={"latitude_sd": 0.0, "delay_sd": 0.0})
    steady = {"attitude_sd": 0.0, "delay": 0.0, "integrator": "exponential"}
    return simulated(
        session.model_copy(update=steady), settings=sure, model=errors, noise=ImuNoise(),
        site=site, seed=0,
    )  # fmt: skip


def _usual(prior: Mapping[str, tuple[float, float]]) -> ClusterModel:
    """Return errors of usual size and sign, or the means that `prior` gives."""
    usual = [SOURCE_SYMBOLS[n][1] * PRIOR[n.rpartition(".")[0]][1] for n in CONSTANTS.names]
    said = CoefficientVector.prior(CONSTANTS, prior)
    values = np.where(np.isfinite(said.prior_sd), said.values, usual)
    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, values))


def seen(p: Planned, extras: tuple[Extra, ...] = ()) -> Foresight:
    """Return what the planned motion will show."""
    settings, found = p.given.settings, p.found
    slow = is_slow(p.noise.accel) or is_slow(p.noise.gyro)
    e = Evidence(p.tumble, p.prior, p.fit, found, settings.angles, slow)
    shown = tumble_report.observability_json(e)
    told = [f for f in tumble_checks.findings(e) if f.code in FORETOLD]
    names = hardly(found)
    if names:
        told.insert(0, finding("preflight.unseen", count=len(names), names=", ".join(names)))
    plan, legs = p.simulation.plan, _legs(shown)
    return Foresight(
        coefficients=found,
        linearised_at=p.at,
        plan=plan.name,
        duration=plan.duration,
        fastest=float(np.abs(plan.rates).max()),
        rate_limit=settings.rate_limit,
        states=shown["states"],
        rank=legs[-1].rank,
        smallest=shown["smallest"],
        legs=legs,
        limits=needs(plan, settings.limits),
        more=extras,
        hardly=tuple(names),
        unseen=tuple(shown["unseen"]),
        remaining=tuple(shown["remaining"]),
        weakest=tuple(shown["weakest"]),
        correlated=tuple((a, b, value) for a, b, value in shown["correlated"]),
        singular=any(f.code == "tumble.singular" for f in told),
        findings=(*p.told, *told),
    )


LONGER = 300.0
"""How much longer a plan is made to see what that would buy [s]."""


def more(p: Planned) -> tuple[Extra, ...]:
    """Return what five more minutes would buy: about the best axis, and at rest."""
    settings, plan, before = p.given.settings, p.simulation.plan, p.sd
    fastest = float(np.abs(plan.rates).max())
    possible = _possible(plan, settings)
    moved, rest = list[Extra](), list[Extra]()
    for sign, axis in ((0.0, 0), *product((1.0, -1.0), range(3))):
        longer = replace(plan, steps=(*plan.steps, Step(sign * fastest * np.eye(3)[axis], LONGER)))
        if possible and not _possible(longer, settings):
            continue
        after = planned(replace(p.given, settings=with_plan(settings, longer)))
        words = f"about {'+-'[sign < 0]}{AXES[axis]} at {np.degrees(fastest):.4g} deg/s"
        what = f"five more minutes {words if sign else 'at rest'}"
        ratio = after.sd / before
        (moved if sign else rest).append(Extra.of(what, LONGER, CONSTANTS.names, ratio))
    return (*sorted(moved, key=lambda extra: extra.ratio)[:1], *rest)


def _possible(plan: TorquingPlan, settings: Settings) -> bool:
    return all(limit.kept for limit in needs(plan, settings.limits))


def with_plan(settings: Settings, plan: TorquingPlan) -> Settings:
    """Return settings that do a plan, whatever limits they have.

    `plan`: what is to be done instead of their plan.
    """
    steps = tuple(
        PlanStep.model_validate(
            {"rate": [f"{v!r} rad/s" for v in step.rate.tolist()], "time": f"{step.time!r} s"}
        )
        for step in plan.steps
    )
    none = {"plan": None, "rate": None, "segment": None, "rate_limit": None}
    return settings.model_copy(update={**none, "steps": steps})


def _legs(shown: Mapping[str, Any]) -> tuple[Leg, ...]:
    """Return the legs with what is seen at the end of each."""
    grown = shown["growth"]
    out = []
    for leg in shown["legs"]:
        last = int(np.searchsorted(grown["until"], leg["end"] + 1e-6, side="right")) - 1
        x, y, z = leg["rate"]
        rank, alone = grown["rank"][last], grown["alone"][last]
        out.append(Leg(leg["start"], leg["end"], (x, y, z), rank, alone))
    return tuple(out)
