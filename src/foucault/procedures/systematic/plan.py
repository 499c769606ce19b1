"""A planned systematic calibration: what it will show, and what a better plan may do.

A covariance depends on motion, noise and prior, not on readings. What a planned session will show
is what the procedure states of a simulated one without noise, of an instrument that is as [prior]
expects. What could be shown at best is what the noise of the sensors alone leaves: velocity at
rest known for sure, turns counted in full, and nothing known beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import starmap
from math import inf
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, Prior
from foucault.diagnose import systematic as judge
from foucault.diagnose.checks import HARDLY, hardly
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.left_out import foretold
from foucault.diagnose.systematic_sequence import lasting
from foucault.errors import Finding, error, finding
from foucault.estimate.systematic import AtRest
from foucault.infer.information import Information, largest_shares, terms
from foucault.models import imu
from foucault.models.deflection import MODELS
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.layouts import with_references
from foucault.models.noise import ImuNoise, grade
from foucault.navigate.increments import increments_of
from foucault.navigate.ins_filter import start_cov
from foucault.plans import sequence_search as sequences
from foucault.plans.limit import Limit
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.optimise import weights_of
from foucault.plans.sequence import RATE, SPIN_RATE, CalibrationSequence, built_in
from foucault.plans.sequence_file import ActionTable, plain_action, plain_start, turns_of
from foucault.procedures.left_out import told_beside
from foucault.procedures.record import Beforehand, Shortest, Stated, checked
from foucault.procedures.systematic.choice import Decided, foreseen_of
from foucault.procedures.systematic.counted import Beside
from foucault.procedures.systematic.problem import (
    Solution,
    SystematicProblem,
    as_parameters,
    prior_of,
    problem_of,
    public,
    require_place,
    solved,
    steady,
)
from foucault.procedures.systematic.quick import Quick, Stills
from foucault.procedures.systematic.settings import (
    FIRST,
    GRADE,
    LAYOUT,
    Session,
    Settings,
    draw_errors,
    planned,
)
from foucault.simulate.systematic import simulate_systematic
from foucault.strict import Strict
from foucault.units import Rate, Seconds, parse

Plan = Beforehand[Settings, Session]

SURE = 1e-2
"""At best the velocity at rest is as sure as this part of what the noise adds to it from one update
to the next [1]."""

BLIND = 1e3  # A coefficient that is left less certain than so many times its prior is not seen [1].

WIDER, FIRM = 10.0, 1.1
"""Nor is one whose bound grows by more than `FIRM` where the prior is `WIDER` times less certain:
it hangs on what the session does not show. Rounding adds far less, what is shared far more [1]."""


@dataclass(frozen=True)
class Foreseen:
    """A planned session, calibrated beforehand."""

    problem: SystematicProblem  # what will be solved
    # what will be found, with covariance: of an instrument as expected, without noise
    solution: Solution

    @property
    def states(self) -> CoefficientVector:
        """The states that are coefficients, with covariance and prior [SI]."""
        return self.solution.states


def reckoned(noise: ImuNoise | None) -> ImuNoise:
    """Return the noise to reckon with [SI]; `noise` or None: as declared, or typical [SI]."""
    return noise or grade(GRADE).noise


def foreseen(
    sequence: CalibrationSequence, b: Plan, *, instrument: ImuModel | None = None
) -> Foreseen:
    """Simulate a sequence, find its rests, and calibrate it without noise.

    `instrument`: the instrument, None takes the means of the prior.
    """
    settings, site, noise, prior = b.settings, b.site, reckoned(b.noise), b.prior
    require_place(site, "the plan of a systematic calibration")
    expected = instrument_of(settings, prior)
    known_as: dict[str, Any] = {
        "site": site, "rate": b.session.rate, "model": instrument or expected,
    }  # fmt: skip
    quiet = simulate_systematic(sequence, **known_as)
    noisy = simulate_systematic(sequence, noise=noise, **known_as)  # where rests are found in
    known = dict(prior)
    if instrument is not None:  # the covariance about it, not the way to it
        vector = instrument.coefficients()
        kept = prior_of(settings.sensors, prior)
        known |= {
            n: (vector.value(n), float(sd))
            for n, sd in zip(kept.names, kept.prior_sd, strict=True) if n in vector.layout
        }  # fmt: skip
    once = settings.model_copy(update={"passes": 1} | _unlike(settings.plan, sequence))
    problem = problem_of(noisy.log, site, once, noise, known)
    start = replace(problem.start, C_nb=_begun(problem, sequence))
    begun = replace(problem, start=start, increments=increments_of(quiet.log))
    return Foreseen(begun, solved(begun, once))


def _unlike(plan: CalibrationSequence | None, done: CalibrationSequence) -> dict[str, Any]:
    """Return settings that name what is done, where it is not what is planned."""
    turns = [
        [a for a in one.actions if isinstance(a, Rotate)] for one in (plan, done) if one is not None
    ]
    if turns[0] == turns[-1]:
        return {}
    actions = tuple(ActionTable.model_validate(plain_action(a)) for a in done.actions)
    return {"sequence": (), "start": plain_start(done), "actions": actions}


def _begun(problem: SystematicProblem, sequence: CalibrationSequence) -> FloatArray:
    return np.asarray(sequence.at(problem.increments.time[[problem.first]])[0][0])


def instrument_of(settings: Settings, prior: Prior) -> ImuModel:
    """Return the instrument that a prior expects: without errors but for the means in it."""
    given = CoefficientVector.prior(settings.sensors.layout, dict(prior))
    if settings.model is not None:
        given = settings.model.general(given)
    return ImuModel.from_coefficients(given.chosen(n for n in given.names if n in imu.LAYOUT))


# -- at best -------------------------------------------------------------------------------------


def bound(problem: SystematicProblem, solution: Solution, settings: Settings) -> dict[str, Any]:
    """Return the Cramer-Rao bound of the sensor noise alone [SI], for result.json.

    It is None where nothing is seen. Without noise it would be zero, and the filter that finds it
    singular: there is none.

    `solution`: what was found: the bound is that about it.
    """
    p = steady(problem)
    if not (p.noise.accel.white > 0 and p.noise.gyro.white > 0):
        return {}
    known = SURE * p.noise.accel.white * np.sqrt(p.at_rest.interval)
    sure = replace(p.at_rest, velocity_sd=known, decorrelate=False)
    begun = [(run.trajectory.C_nb[0], p.phi_sd) for run in solution.run.recordings()]
    if settings.steps == "published":
        begun[0] = p.begun[0]
    found = replace(p.model, at_rest=sure).filtered(
        p.starts(begun), solution.states.values, p.prior.prior_sd
    )
    told = lasting(replace(found.estimate, prior_sd=p.prior.prior_sd))
    near, far = (
        public(replace(solution, states=_hardly_known(told, wide)), settings)
        for wide in (BLIND, WIDER * BLIND)
    )
    seen = (far.sd < FIRM * near.sd) & (near.sd < BLIND * near.prior_sd)
    return {"bound": [float(v) if s else None for v, s in zip(far.sd, seen, strict=True)]}


def _hardly_known(states: CoefficientVector, wide: float) -> CoefficientVector:
    """Return what a session tells where the prior is `wide` times less certain."""
    values, vectors, unit = _told(states)
    half = vectors / np.sqrt(values + wide**-2.0) * unit[:, None]
    return replace(states, cov=half @ half.T)


def without_prior(states: CoefficientVector) -> Information:
    """Return what a session alone tells of its states, whatever was known of them.

    `states`: with covariance, and prior standard deviations that were not correlated [SI].
    """
    values, vectors, unit = _told(states)
    return Information(states.layout, (vectors * np.sqrt(values)).T / unit)


def _told(states: CoefficientVector) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the information of a session alone, its directions, and the unit of both: the prior.

    From the covariance itself: where nothing is told that is the prior's, exactly, whereas the
    rounding of its inverse is that of what is known best.
    """
    unit = states.prior_sd
    assert states.cov is not None
    left, vectors = np.linalg.eigh(states.cov / np.outer(unit, unit))
    left = np.clip(left, np.finfo(float).eps * left[-1], 1.0)
    return (1.0 - left) / left, vectors, unit


HERE = "the site"
OTHERS = ("latitude 0 deg", "latitude 60 deg", "instrument 1", "turns counted otherwise")
"""Where a plan found is compared, and what else is changed there."""

SPINS = 6  # Spins that a model of deflection takes [1].


class Wanted(Strict):
    """What a better sequence may do."""

    total: Seconds | None = Field(default=None, gt=0, examples=["45 min"])
    """Time there is; left out, that of the plan to beat, or any with `accuracy`."""
    accuracy: Annotated[
        dict[str, str], checked(lambda given: [*starmap(accuracy_of, given.items())])
    ] = Field(default={}, examples=[{"deflection": "0.0085 arcsec/g"}])
    """Largest standard deviation that is wanted of coefficients or groups of them: the shortest
    sequence that reaches it is sought. Left out, the smallest uncertainty."""
    first: Annotated[str | None, checked(built_in)] = Field(default=None, examples=["19 positions"])
    """Built-in sequence of quarter turns to begin with; left out, that of the plan."""
    poses: int | None = Field(default=None, ge=0, le=24, examples=[6])
    """Number of spins; left out, six where there is a model of deflection."""
    most_turns: int = Field(default=40, ge=1)
    """Most turns of a spin."""
    shortest: Shortest = 20.0
    longest: Seconds = Field(default=600.0, gt=0)
    """Longest rest."""
    move_rate: Rate = Field(default=RATE, gt=0)
    """Rate of all turns but the spins."""
    alike: bool = True
    """Whether the rests between quarter turns are alike."""
    open_turns: bool | None = None
    """Whether axes, senses and order of the quarter turns are open; left out, where there are no
    spins to seek."""
    weights: dict[str, float] = Field(default={}, examples=[{"deflection": 3.0, "accel": 0.0}])
    """How much coefficients or groups of them count; 1 if left out."""


def accuracy_of(name: str, text: str) -> float:
    """Return a wanted standard deviation of a coefficient or a group of them [SI]."""
    kinds = {LAYOUT.coefficients[i].kind for i in LAYOUT.group(name)}
    sd = parse(text, kinds.pop(), f"accuracy.{name}") if len(kinds) == 1 else 0.0
    if not sd > 0:
        raise error("systematic.accuracy", name=name, given=text)
    return sd


def members(layout: Layout, wanted: Wanted) -> sequences.Accuracy:
    """Return which coefficients each wanted accuracy is of, and how large it is [SI]."""
    out = {}
    for name, text in wanted.accuracy.items():
        at_ = [k for k, n in enumerate(layout.names) if n == name or n.startswith(f"{name}.")]
        if not at_:
            groups = ", ".join(dict.fromkeys(n.rpartition(".")[0] or n for n in layout.names))
            raise error("systematic.accuracy_unknown", name=name, allowed=groups)
        out[name] = (at_, accuracy_of(name, text))
    return out


def settled(b: Plan) -> Plan:
    """Return it with noise to reckon with, and a model of deflection where one is to be chosen."""
    settings = b.settings
    if settings.deflection == "choose":
        settings = settings.model_copy(update={"deflection": FIRST})
    return replace(b, settings=settings, noise=reckoned(b.noise or b.typical))


# -- a better plan -------------------------------------------------------------------------------


def in_case(b: Plan, sequence: CalibrationSequence, case: str = HERE) -> Foreseen:
    """Return what a calibration would state in some circumstances, without approximations."""
    drawn = None
    kind, _, what = case.partition(" ")
    if kind == "latitude":
        b = replace(b, site=replace(b.site, latitude=parse(what, "angle")))
    elif kind == "instrument":
        drawn = draw_errors(GRADE, int(what))
    elif kind == "turns":
        other = {"decorrelate": not b.settings.restarts}
        b = replace(b, settings=b.settings.model_copy(update=other))
    return foreseen(sequence, b, instrument=drawn)


def _stated(b: Plan, sequence: CalibrationSequence, case: str) -> FloatArray:
    """Return the sd of every state that is a coefficient, shape (p,) [SI]."""
    found = in_case(b, sequence, case)
    beside = _beside(found, b, sequence.duration)
    return found.states.sd if beside is None else beside.beforehand()[0].sd


def space(b: Plan) -> sequences.SystematicSpace:
    """Return the sequences that are allowed; the plan to beat is the campaign's."""
    if b.settings.steps == "published":
        raise error("systematic.search_published")
    b, wanted = settled(b), b.wanted
    settings, reference = b.settings, planned(b.settings, b.session)
    layout, found = settings.sensors.layout, in_case(b, reference)
    p = steady(found.problem)
    beside = _beside(found, b, reference.duration)
    quick = partial(_quick_sd, quick_of(found, beside), layout.names)
    return sequences.SystematicSpace(
        allowed=_allowed(settings, wanted, reference),
        names=layout.names,
        kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights_of(layout, wanted.weights),
        prior_sd=p.prior.prior_sd,
        accuracy=members(layout, wanted),
        reference=reference,
        reference_name=reference.name,
        cases=(HERE, *OTHERS),
        quick=quick,
        alone=quick_of(found, None).sd,
        stated=Stated(b, _stated),
    )


def quick_of(found: Foreseen, beside: Beside | None) -> Quick:
    """Return the quick uncertainty, with states for what is not estimated where that counts."""
    p = steady(found.problem if beside is None else beside.wide)
    return Quick(p.site, p.sensors, p.noise, p.at_rest, p.start_cov())


def _quick_sd(quick: Quick, names: tuple[str, ...], sequence: CalibrationSequence) -> FloatArray:
    every = quick.sensors.layout.names
    return quick.sd(sequence)[[every.index(n) for n in names]]


def _beside(found: Foreseen, b: Plan, span: float) -> Beside | None:
    """Return the filter with what is not estimated, None where that is taken for nothing.

    `span`: of the session [s].
    """
    p, sizes = found.problem, told_beside(b.sizes, found.problem.noise, span)
    if not sizes or b.settings.steps == "published":
        return None
    return Beside.of(Decided(p, b.settings, found.solution, None, []), sizes, b.prior)


def _allowed(
    settings: Settings, wanted: Wanted, reference: CalibrationSequence
) -> sequences.Allowed:
    turns = [a for a in reference.actions if isinstance(a, Rotate)]
    rate = settings.rate_limit or max([SPIN_RATE, *(t.rate for t in turns)])
    quarters = [name for name in settings.sequence if "positions" in name]
    usual = SPINS if settings.model is not None else 0
    poses = usual if wanted.poses is None else wanted.poses
    return sequences.Allowed(
        first=wanted.first or (quarters[0] if quarters and not settings.actions else FIRST_PART),
        total=wanted.total or (inf if wanted.accuracy else reference.duration),
        poses=poses,
        rate=rate,
        moves=min(wanted.move_rate, rate),
        step=settings.angle_step or 0.0,
        shortest=max(wanted.shortest, settings.shortest),
        longest=wanted.longest,
        most=wanted.most_turns,
        alike=wanted.alike,
        fill=not wanted.accuracy,
        open_turns=poses == 0 if wanted.open_turns is None else wanted.open_turns,
    )


FIRST_PART = "19 positions"  # The first part where the plan to beat does not name one.


def wanted_limits(
    wanted: Wanted | None, states: CoefficientVector, duration: float
) -> tuple[Limit, ...]:
    """Return what a session attains of what is wanted.

    `wanted` or None: what is wanted; `states`: what will be known [SI]; `duration`: time it takes
    [s].
    """
    if wanted is None:
        return ()
    time = [Limit("time", "time", duration, wanted.total)] if wanted.total is not None else []
    kinds = [c.kind for c in states.layout.coefficients]
    return (*time, *sequences.sd_limits(members(states.layout, wanted), kinds, states.sd))


LONGER = 300.0  # How much longer a session is made to see what that would buy [s].


def foresee(b: Plan) -> Foresight:
    """Return what the planned session will show."""
    b = settled(b)
    settings, prior = b.settings, as_parameters(b.prior, b.settings)
    sequence = planned(settings, b.session)
    found = in_case(replace(b, prior=prior), sequence)
    states = found.states
    alone, blind = without_prior(states), _blind(states)
    beside = _beside(found, replace(b, prior=prior), sequence.duration)
    judged, bought = None, tuple[Extra, ...]()
    if beside is None:
        result = with_references(public(found.solution, settings), b.site)
    else:
        whole, judged, bought = beside.beforehand()
        result = public(replace(found.solution, states=whole), settings)
    return Foresight(
        coefficients=result,
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
            *sequences.table_needs(sequence, settings.rate_limit, settings.angle_step),
            *wanted_limits(b.wanted, states, sequence.duration),
        ),
        more=(*bought, *_more(sequence, found, beside)),
        left_out=None if judged is None else foretold(judged),
        findings=(*found.problem.findings, *_warned(found, settings, prior)),
    )


def _blind(states: CoefficientVector) -> list[str]:
    """Return the combinations of which a session tells less than was known, in words."""
    assert states.cov is not None
    unit = states.prior_sd
    values, vectors = np.linalg.eigh(states.cov / np.outer(unit, unit))
    blind = vectors[:, values > HARDLY**2].T
    return [terms(largest_shares(states.layout, v), dots=True) for v in blind]


def _warned(found: Foreseen, settings: Settings, prior: Prior) -> list[Finding]:
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


def _more(
    sequence: CalibrationSequence, found: Foreseen, beside: Beside | None
) -> tuple[Extra, ...]:
    """Return what five more minutes would buy: of rest, and of spins."""
    names = steady(found.problem).sensors.layout.names
    quick = partial(_quick_sd, quick_of(found, beside), names)
    before, out = quick(sequence), []
    for what, longer in (_rested(sequence), _spun(sequence)):
        if longer is not None:
            ratio = quick(longer) / before
            more = longer.duration - sequence.duration
            out.append(Extra.of(what, more, names, ratio))
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
