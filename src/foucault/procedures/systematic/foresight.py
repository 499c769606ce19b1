"""What a planned systematic calibration will show, told before it is made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import HARDLY, hardly
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.information import largest_shares, terms
from foucault.diagnose.systematic import checks as judge
from foucault.errors import Finding, finding
from foucault.estimate.ins_filter import start_cov
from foucault.estimate.systematic.fit import AtRest
from foucault.models.deflection import MODELS
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.references import with_references
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.systematic.search import table_needs
from foucault.plans.systematic.sequence import CalibrationSequence
from foucault.plans.systematic.steps import turns_of
from foucault.procedures.record import Beforehand
from foucault.procedures.systematic.bound import Foreseen, Prior, without_prior
from foucault.procedures.systematic.left_out import foreseen_of
from foucault.procedures.systematic.plan import (
    HERE,
    Stated,
    noise_of,
    settled,
    wanted_limits,
)
from foucault.procedures.systematic.problem import as_parameters, prior_of, steady
from foucault.procedures.systematic.quick import Quick, Stills
from foucault.procedures.systematic.settings import Session, Settings, planned
from foucault.procedures.systematic.solution import public

LONGER = 300.0
"""How much longer a session is made to see what that would buy [s]."""


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what the planned session will show."""
    settings, session, site = settled(b.settings), b.session, b.site
    sequence, prior = planned(settings, session), as_parameters(b.prior, settings)
    stated = Stated(settings, session.rate, site, noise_of(b.noise, b.typical), prior)
    found = stated.foreseen(sequence, HERE)
    states = found.states
    alone, blind = without_prior(states), _blind(states)
    return Foresight(
        coefficients=with_references(public(found.solution, settings), site),
        linearised_at=("means in [prior], " if prior else "") + "no errors, a perfect table",
        plan=sequence.name,
        duration=sequence.duration,
        states=len(states),
        rank=len(states) - len(blind),
        fastest=max((a.rate for a in sequence.actions if isinstance(a, Rotate)), default=0.0),
        rate_limit=settings.rate_limit,
        hardly=tuple(hardly(states)),
        unseen=tuple(blind),
        remaining=tuple(r.words for r in alone.remaining(states.prior_sd)),
        correlated=alone.with_prior(states.prior_sd).correlated(),
        limits=(
            *table_needs(sequence, settings.rate_limit, settings.angle_step),
            *wanted_limits(b.wanted, states, sequence.duration),
        ),
        more=_more(sequence, found, stated),
        findings=(*found.problem.findings, *_told(found, settings, prior)),
    )


def _blind(states: CoefficientVector) -> list[str]:
    """Return the combinations of which a session tells less than was known, in words."""
    assert states.cov is not None
    unit = states.prior_sd
    values, vectors = np.linalg.eigh(states.cov / np.outer(unit, unit))
    blind = vectors[:, values > HARDLY**2].T
    return [terms(largest_shares(states.layout, v), dots=True) for v in blind]


def _told(found: Foreseen, settings: Settings, prior: Prior) -> list[Finding]:
    """Say what will not be seen, and whether a calibration will refuse that."""
    states = found.states
    out = judge.unseen_of(states, prior_of(settings.sensors, {}).prior_sd)
    out += foreseen_of(found.problem, settings, found.solution, prior)
    if settings.model is None:
        return out
    rank, blind = judge.told_of(states, settings.model.layout.names)
    if blind:
        known = any(name.partition(".")[0] == "deflection" for name in prior)
        out.append(finding(
            "systematic.deflection_planned", model=settings.model.name, rank=rank,
            count=len(settings.model), blind="; ".join(blind[:6]) + "; ..." * (len(blind) > 6),
            then="take from [prior]" if known else "refuse", wanted=judge.WANTED["deflection"],
        ))  # fmt: skip
    return out


# -- what more would buy -------------------------------------------------------------------------


def _more(sequence: CalibrationSequence, found: Foreseen, stated: Stated) -> tuple[Extra, ...]:
    """Return what five more minutes would buy: of rest, and of spins."""
    p = steady(found.problem)
    quick = Quick(p.site, p.sensors, p.noise, p.at_rest, p.start_cov())
    before, out = quick.sd(sequence), []
    for what, longer in (_rested(sequence), _spun(sequence)):
        if longer is not None:
            ratio = quick.sd(longer) / before
            more = longer.duration - sequence.duration
            out.append(Extra.of(what, more, p.sensors.layout.names, ratio))
    return tuple(out)


def _rested(sequence: CalibrationSequence) -> tuple[str, CalibrationSequence]:
    rests = [a.time for a in sequence.actions if isinstance(a, Rest)]
    share = 1.0 + LONGER / sum(rests)
    actions = tuple(
        replace(a, time=share * a.time) if isinstance(a, Rest) else a for a in sequence.actions
    )
    return f"rests {share:.2f} times as long", replace(sequence, actions=actions)


def _spun(sequence: CalibrationSequence) -> tuple[str, CalibrationSequence | None]:
    spins = [a for a in sequence.actions if isinstance(a, Rotate) and abs(turns_of(a)) > 1]
    if not spins:
        return "", None
    more = round(LONGER / sum(2 * np.pi / a.rate for a in spins))
    if more < 1:
        return "", None
    actions = tuple(
        replace(a, angle=a.angle + np.sign(a.angle) * 2 * np.pi * more) if a in spins else a
        for a in sequence.actions
    )
    return f"{more} more turns in every spin", replace(sequence, actions=actions)


# -- what a sequence shows of every model ---------------------------------------------------------


def shown(
    sequence: CalibrationSequence, site: Site, noise: ImuNoise, kept: Stills | None = None
) -> tuple[tuple[int, int], dict[str, tuple[int, int]]]:
    """Return what a sequence shows: errors of the instrument, combinations of every deflection.

    `noise`: white noise of the sensors [SI]; `kept` or None: what is kept from one sequence to
    the next at the same site with the same noise. Returns how many of how many errors of the
    instrument it shows by itself; model of deflection -> how many combinations of how many
    parameters it tells better than 3 arcsec/g.
    """
    kept = {} if kept is None else kept
    plain = _quick_states(sequence, Settings(), site, noise, kept)
    seen = int(np.count_nonzero(plain.sd <= HARDLY * plain.prior_sd))
    models = {}
    for name in MODELS:
        given = Settings.model_validate({"deflection": name})
        states = _quick_states(sequence, given, site, noise, kept)
        part = [n for n in states.names if n.startswith("deflection.")]
        models[name] = (judge.told_of(states, part)[0], len(part))
    return (seen, len(plain)), models


def _quick_states(
    sequence: CalibrationSequence, settings: Settings, site: Site, noise: ImuNoise, kept: Stills
) -> CoefficientVector:
    """Return the states with covariance, from a start as usual."""
    sensors = settings.sensors
    known = prior_of(sensors, {})
    at_rest = AtRest(
        settings.velocity_sd, settings.position_sd, settings.interval, settings.restarts
    )
    P = start_cov(np.diag([5e-3, 5e-3, 0.1]) ** 2, at_rest.velocity_sd, at_rest.position_sd,
                  known.prior_sd)  # fmt: skip
    quick = Quick(site, sensors, noise, at_rest, P, kept)
    return replace(known, cov=quick.cov(sequence))
