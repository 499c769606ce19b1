"""Choose the model of deflection of a systematic calibration, or test the one that was named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.systematic.checks import require_deflection
from foucault.diagnose.systematic.deflection_choice import (
    GENERAL18,
    Choice,
    Told,
    chosen,
    in_general,
    judged,
    known_of,
)
from foucault.diagnose.systematic.deflection_verdict import findings
from foucault.errors import Finding
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.procedures.systematic.problem import (
    SystematicProblem,
    prior_of,
    problem_of,
    sensors_of,
)
from foucault.procedures.systematic.settings import AS_PARAMETERS, FIRST, PRIOR, Settings
from foucault.procedures.systematic.solution import Solution, again, begins, solved
from foucault.tables import Log

Given = Mapping[str, tuple[float, float]]

PASSES = 1
"""Passes with all bendings, from the result with one model; more change nothing that matters [1].
"""


@dataclass(frozen=True)
class Decided:
    """A result, with the model of deflection that was named or chosen."""

    problem: SystematicProblem
    settings: Settings
    solution: Solution
    choice: Choice | None  # all models, where they were compared
    findings: list[Finding]


def decided(
    log: Log,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None,
    given: Given,
    *,
    compare: bool,
) -> Decided:
    """Solve, with the model that was named or with the one that is chosen.

    `log`: readings [SI]; `noise` or None: noise as declared [SI]; `given`: mean and standard
    deviation of coefficients or groups of coefficients [SI]; `compare`: whether a model that was
    named is compared with the others.
    """
    asked = settings.deflection == "choose"
    others = _without_deflection(given)
    problem = problem_of(log, site, settings, noise, others if asked else given)
    if asked:
        problem, settings, solution, choice = _choose(problem, settings, given)
    else:
        solution, choice = solved(problem, settings), None
    told: list[Finding] = []
    if settings.model is not None:
        known = asked or len(others) < len(given)
        told += require_deflection(solution.states, settings.model, known=known)
        if compare and choice is None:
            choice = _tested(problem, settings, solution, given)
    if choice is not None:
        told += findings(choice, asked=asked)
    return Decided(problem, settings, solution, choice, told)


def choice_of(
    p: SystematicProblem, settings: Settings, given: Given
) -> tuple[Choice, SystematicProblem, Settings, Solution]:
    """Choose a model, or none.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI]. Returns
    `problem`: with the model that the choice began with. Raises ``systematic.choice_unseen``
    where the session sees no model whole.
    """
    first = settings.model_copy(update={"deflection": FIRST, "steps": "joint"})
    begun = with_settings(p, first, given)
    base = solved(begun, first)
    choice = compared(begun, first, base, given)
    return replace(choice, used=chosen(choice)), begun, first, base


def _choose(
    p: SystematicProblem, settings: Settings, given: Given
) -> tuple[SystematicProblem, Settings, Solution, Choice]:
    """Choose a model, or none, and solve with it."""
    choice, begun, first, base = choice_of(p, settings, given)
    what: dict[str, Any] = {"deflection": "none", "steps": "joint"}
    if choice.used is not None:
        model = choice.used.model
        what = {"deflection": model.name, "chirality": model.chirality}
    final = settings.model_copy(update=what)
    if final == first:
        return begun, final, base, choice
    problem = with_settings(p, final, given)
    return problem, final, solved(problem, final), choice


def _tested(p: SystematicProblem, settings: Settings, found: Solution, given: Given) -> Choice:
    """Compare the model that was named with the others."""
    if settings.steps == "published":  # the second step does not tell what the first has used
        settings = settings.model_copy(update={"steps": "joint"})
        found = solved(p, settings)
    choice = compared(p, settings, found, given)
    mine = next(
        c for c in choice.candidates
        if c.model.name == settings.deflection and c.model.chirality == settings.chirality
    )  # fmt: skip
    return replace(choice, used=mine)


def compared(p: SystematicProblem, settings: Settings, found: Solution, given: Given) -> Choice:
    """Compare all models, from a result with one of them or with none.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    return judged(
        told(p, settings, found, given), {"deflection": PRIOR["deflection"], **given},
        chirality=settings.chirality, known=len(_without_deflection(given)) < len(given),
    )  # fmt: skip


def _without_deflection(given: Given) -> dict[str, tuple[float, float]]:
    """Return what is given of other coefficients than those of the deflection."""
    return {k: v for k, v in given.items() if k.partition(".")[0] != "deflection"}


def told(p: SystematicProblem, settings: Settings, found: Solution, given: Given) -> Told:
    """Return what the session says of all bendings, from a result with one model.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    general = settings.model_copy(update={"deflection": GENERAL18.name})
    problem = with_settings(p, general, _without_deflection(given))
    same = [name for name in found.states.names if name not in AS_PARAMETERS]
    bent = CoefficientVector(GENERAL18.layout, np.zeros(len(GENERAL18)))
    if settings.model is not None:
        mine = [found.states.layout.index(name) for name in settings.model.layout.names]
        bent = replace(bent, values=in_general(settings.model) @ found.states.values[mine])
    states = widened(problem, found, same, bent)
    return Told.of(states, np.zeros(len(GENERAL18)))


def widened(
    p: SystematicProblem,
    found: Solution,
    same: Sequence[str],
    other: CoefficientVector | None = None,
) -> CoefficientVector:
    """Return the states of a problem with more of them, from a result with fewer.

    `other`: where others begin, None begins at the mean of the prior [SI].
    """
    return resumed(p, found, same, other).states


def resumed(
    p: SystematicProblem,
    found: Solution,
    same: Sequence[str],
    other: CoefficientVector | None = None,
) -> Solution:
    """Filter once more, from a result.

    `other`: where others begin, None begins at the mean of the prior [SI].
    """
    layout = p.sensors.layout
    values, sd = p.prior.values.copy(), p.prior.prior_sd.copy()
    there, here = ([x.index(name) for name in same] for x in (layout, found.states.layout))
    values[there], sd[there] = found.states.values[here], found.states.sd[here]
    if other is not None:
        values[[layout.index(name) for name in other.names]] = other.values
    near = CoefficientVector(layout, values, np.diag(sd**2))
    return again(p, near, begins(found.run), PASSES)


def with_settings(p: SystematicProblem, settings: Settings, given: Given) -> SystematicProblem:
    """Return the problem with the coefficients of other settings.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    sensors = sensors_of(settings, p.noise, p.recordings)
    known = known_of(sensors.layout, given)
    prior = prior_of(sensors, known, p.noise, settings.turn_on)
    return replace(p, sensors=sensors, prior=prior)
