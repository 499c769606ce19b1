"""Solve a systematic calibration, and name what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Status, error
from foucault.estimate.ins_filter import FilterRun
from foucault.estimate.systematic.fit import attitude_at_start
from foucault.estimate.systematic.published import second_step
from foucault.models import imu, size_effect
from foucault.plans.systematic.built_in import built_in
from foucault.procedures.systematic.problem import SystematicProblem, steady
from foucault.procedures.systematic.settings import Settings

NARROWED = 30.0
"""Later passes begin with so many times the uncertainty that the first has left [1]."""

SETTLED = 0.1
"""Passes have settled where none moves a coefficient by more than this of its uncertainty [1]."""


@dataclass(frozen=True)
class Solution:
    """What was found."""

    run: FilterRun  # the last pass of the filter
    states: CoefficientVector  # the states that are coefficients, with covariance and prior [SI]
    passes: tuple[FloatArray, ...]  # (p,) the same after each pass [SI]
    status: Status  # how the passes ended
    # of the innovations of the last pass, but for a constant, with the prior that it began with: it
    # ranks models that fit very differently, and `deflection_choice` compares them [1]
    log_likelihood: float


def solved(p: SystematicProblem, settings: Settings) -> Solution:
    """Filter in one step or in two."""
    if settings.steps == "published":
        return _published(p, settings)
    return _joint(p, settings.passes)


def _published(p: SystematicProblem, settings: Settings) -> Solution:
    """Filter the first sequence without deflection, and go on with it over the others."""
    p = steady(p)  # the source knows no biases that wander
    few = settings.model_copy(update={"deflection": "none", "steps": "joint"}).sensors
    prior = p.prior
    at = [prior.layout.index(name) for name in few.layout.names]
    known = CoefficientVector(few.layout, prior.values[at], prior_sd=prior.prior_sd[at])
    part = replace(p, sensors=few, prior=known, rests=p.rests[: _first_part(p, settings)])
    one = _joint(part, settings.passes)
    two, begun = second_step(p.model, one.run, one.states, prior)
    passes = (begun, two.coefficients[-1])
    return _solution(two, replace(two.estimate, prior_sd=prior.prior_sd), passes, one.status)


def _joint(p: SystematicProblem, passes: int) -> Solution:
    """Filter in one step, again and again.

    A wide prior lets the filter wander far while it has seen little, and what it finds is then not
    linear in the readings. So later passes have a prior `NARROWED` about the result before, whose
    information is taken out again in the end.
    """
    found = p.model.filtered(p.starts(p.begun), p.prior.values, p.prior.prior_sd, keep=True)
    if passes == 1:
        states = replace(found.estimate, prior_sd=p.prior.prior_sd)
        return _solution(found, states, (states.values,), Status.CONVERGED)
    return again(p, found.estimate, begins(found, [C_nb for C_nb, _ in p.begun]), passes - 1)


def begins(
    found: FilterRun, C_nb: Sequence[FloatArray] | None = None
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the attitude at the start of every recording [1], and its sd, E N U [rad].

    `C_nb` (3, 3): the attitudes that it began with, None for those of its first epochs [1].
    """
    runs = found.recordings()
    before = [run.trajectory.C_nb[0] for run in runs] if C_nb is None else C_nb
    return [
        (attitude_at_start(run, C, found.coefficients[-1]), np.sqrt(np.diag(run.attitude_cov)))
        for run, C in zip(runs, before, strict=True)
    ]


def again(
    p: SystematicProblem, near: CoefficientVector,
    begun: Sequence[tuple[FloatArray, FloatArray]], passes: int,
) -> Solution:  # fmt: skip
    """Filter again, from a result that is near, until passes settle.

    `near`: the result, with covariance [SI]; `begun` (3, 3): attitude at the start of every
    recording [1] and its uncertainty, E N U [rad]; `passes`: most passes [1].
    """
    stay = ~p.sensors.wanders  # what wanders is at the start not what it is at the end
    sd = np.where(stay, np.minimum(p.prior.prior_sd, NARROWED * near.sd), p.prior.prior_sd)
    narrow = [NARROWED * phi_sd for _, phi_sd in begun]
    C_nb, values = [C for C, _ in begun], [np.where(stay, near.values, 0.0)]
    while True:
        starts = p.starts(list(zip(C_nb, narrow, strict=True)))
        found = p.model.filtered(starts, values[-1], sd, keep=True)
        # With the prior that counts: what the session hardly shows would wander on and on without.
        estimate = exchanged(found.estimate, (values[-1], sd), p.prior)
        moved = float((np.abs(estimate.values - values[-1]) / estimate.sd)[stay].max())
        values.append(np.where(stay, estimate.values, 0.0))
        if moved < SETTLED or len(values) > passes:
            break
        C_nb = [C for C, _ in begins(found, C_nb)]
    status = Status.CONVERGED if moved < SETTLED else Status.NOT_CONVERGED
    return _solution(found, estimate, tuple(values), status)


def exchanged(
    estimate: CoefficientVector, used: tuple[FloatArray, FloatArray], prior: CoefficientVector
) -> CoefficientVector:
    """Return an estimate with another prior than the one it was made with.

    ``P^-1 = P_u^-1 - D_u + D``, ``P^-1 x = P_u^-1 x_u - D_u m_u + D m``, D the information of the
    priors and m their means.

    `estimate`: with covariance [SI]; `used` (p,): mean and standard deviation of the prior it was
    made with [SI]; `prior`: the prior it shall have: values and prior_sd [SI].
    """
    assert estimate.cov is not None
    unit = estimate.sd
    mean, sd = used
    old, new = (unit / sd) ** 2, (unit / prior.prior_sd) ** 2
    information = np.linalg.inv(estimate.cov / np.outer(unit, unit)) + np.diag(new - old)
    cov = np.linalg.inv((information + information.T) / 2)
    pull = new * (prior.values - estimate.values) - old * (mean - estimate.values)
    values = estimate.values + unit * (cov @ (pull / unit))
    return replace(
        estimate, values=values, cov=cov * np.outer(unit, unit), prior_sd=prior.prior_sd
    )  # fmt: skip


def _first_part(p: SystematicProblem, settings: Settings) -> int:
    """Return how many of the rests belong to the first of several sequences."""
    if settings.actions or len(settings.sequence) < 2:
        raise error("systematic.first_part", what="one sequence is declared")
    moves = len(built_in(settings.sequence[0]).moves)
    before = np.array([sum(m.after < k for m in p.found.moves) for k in p.numbers])
    return int(np.count_nonzero(before <= moves))


def _solution(
    run: FilterRun, states: CoefficientVector, passes: tuple[FloatArray, ...], status: Status
) -> Solution:
    stay = ~run.sensors.wanders
    if not stay.all():
        assert states.cov is not None
        layout = run.sensors.without(~stay).layout
        states = CoefficientVector(layout, states.values[stay], states.cov[np.ix_(stay, stay)],
                                   prior_sd=states.prior_sd[stay])  # fmt: skip
    logs = run.innovation**2 / run.variance + np.log(run.variance)
    passes = tuple(values[stay] for values in passes)
    return Solution(run, states, passes, status, float(-0.5 * np.nansum(logs)))


def named(states: Sequence[str], deflections: Sequence[str]) -> tuple[str, ...]:
    """Return the coefficients of the result: those that readings are compensated by, in order."""
    some = {*states, *deflections}
    return tuple(name for name in (*imu.LAYOUT.names, *size_effect.LAYOUT.names) if name in some)


def public(s: Solution, settings: Settings) -> CoefficientVector:
    """Return the coefficients of the result [SI]."""
    vector = s.states if settings.model is None else settings.model.general(s.states)
    return vector.chosen(named(vector.names, ()))
