"""Choose the model of deflection of a systematic calibration, or test the one that was named.

What a systematic calibration did not estimate: does it show, and does something stand for it?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector, Prior
from foucault.diagnose.checks import check
from foucault.diagnose.deflection import (
    GENERAL18,
    Choice,
    Told,
    chosen,
    findings,
    in_general,
    judged,
    known_of,
    likely,
)
from foucault.diagnose.systematic import LIKE, WANTED, only_sums, require_deflection
from foucault.errors import Finding, doubting, finding
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.procedures.systematic.problem import (
    Solution,
    SystematicProblem,
    again,
    begins,
    prior_of,
    problem_of,
    sensors_of,
    solved,
)
from foucault.procedures.systematic.settings import AS_PARAMETERS, FIRST, PRIOR, Settings
from foucault.result import Check
from foucault.tables import AXES, Log

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
    given: Prior,
    *,
    compare: bool,
) -> Decided:
    """Solve, with the model that was named or with the one that is chosen.

    `compare`: whether a model that was named is compared with the others.
    """
    asked = settings.deflection == "choose"
    others = _without_deflection(given)
    problem = problem_of(log, site, settings, noise, others if asked else given)
    with doubting(problem.findings):
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
    p: SystematicProblem, settings: Settings, given: Prior
) -> tuple[Choice, SystematicProblem, Settings, Solution]:
    """Choose a model, or none.

    Returns `problem`: with the model that the choice began with. Raises
    ``systematic.choice_unseen`` where the session sees no model whole.
    """
    first = settings.model_copy(update={"deflection": FIRST, "steps": "joint"})
    begun = with_settings(p, first, given)
    base = solved(begun, first)
    choice = compared(begun, first, base, given)
    return replace(choice, used=chosen(choice)), begun, first, base


def _choose(
    p: SystematicProblem, settings: Settings, given: Prior
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


def _tested(p: SystematicProblem, settings: Settings, found: Solution, given: Prior) -> Choice:
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


def compared(p: SystematicProblem, settings: Settings, found: Solution, given: Prior) -> Choice:
    """Compare all models, from a result with one of them or with none."""
    return judged(
        told(p, settings, found, given), {"deflection": PRIOR["deflection"], **given},
        chirality=settings.chirality, known=len(_without_deflection(given)) < len(given),
    )  # fmt: skip


def _without_deflection(given: Prior) -> dict[str, tuple[float, float]]:
    """Return what is given of other coefficients than those of the deflection."""
    return {k: v for k, v in given.items() if k.partition(".")[0] != "deflection"}


def told(p: SystematicProblem, settings: Settings, found: Solution, given: Prior) -> Told:
    """Return what the session says of all bendings, from a result with one model."""
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
    passes: int = PASSES,
    keep: bool = True,
) -> Solution:
    """Filter once more, from a result.

    `other`: where others begin, None begins at the mean of the prior [SI]; `passes`: after it at
    most [1]; `keep`: whether the run of a single pass keeps what a smoother needs.
    """
    layout = p.sensors.layout
    values, sd = p.prior.values.copy(), p.prior.prior_sd.copy()
    there, here = ([x.index(name) for name in same] for x in (layout, found.states.layout))
    values[there], sd[there] = found.states.values[here], found.states.sd[here]
    if other is not None:
        values[[layout.index(name) for name in other.names]] = other.values
    near = CoefficientVector(layout, values, np.diag(sd**2))
    return again(p, near, begins(found.run), passes, keep=keep)


def with_settings(p: SystematicProblem, settings: Settings, given: Prior) -> SystematicProblem:
    """Return the problem with the coefficients of other settings."""
    sensors = sensors_of(settings, p.noise, p.recordings)
    known = known_of(sensors.layout, given)
    prior = prior_of(sensors, known, p.noise, settings.turn_on)
    return replace(p, sensors=sensors, prior=prior)


RATE = FALSE_ALARM / 2  # False-alarm rate of each of two tests of errors that are left out [1].

TAKEN_IN = 3.0
"""One stands for both if it is so many times less certain where both are estimated [1]."""


@dataclass(frozen=True)
class Shown:
    """An error that is left out and shows."""

    chance: float  # probability that so much is seen where there is none [1]
    gain: float  # twice the gain in log-likelihood by it, over what remains for each reading [1]
    finding: Finding  # what is said of it


def left_out(decision: Decided, given: Prior) -> tuple[list[Finding], list[Check]]:
    """Return what the user should know of errors that were not estimated, and the check of them.

    One error that is left out looks a little like another: that which explains the readings best is
    named alone.
    """
    p, settings, found = decision.problem, decision.settings, decision.solution
    out: list[Finding] = []
    shown: list[Shown] = []
    left = _left(settings)
    if left:
        wide = with_both(p, settings, found, given)
        out += stands_for(wide, found, left)
        shown.append(_curves(wide, found, left))
    if decision.choice is None:  # models of deflection were not compared yet
        shown.append(_bends(compared(p, settings, found, given), found))
    if not shown:
        return out, []
    least = min(shown, key=lambda s: (s.chance, -s.gain))
    said = {"message": f"{least.finding.message} {least.finding.cure}"}
    # Other coefficients have taken in what is not estimated.
    judged = check("errors left out", "left out", least.chance, RATE, None, said)
    return [*out, *(() if judged.passed else (least.finding,))], [judged]


def foreseen_of(
    p: SystematicProblem, settings: Settings, found: Solution, given: Prior
) -> list[Finding]:
    """Say beforehand whether asymmetry or quadratic term will stand for both."""
    left = _left(settings)
    return stands_for(with_both(p, settings, found, given), found, left) if left else []


def _left(settings: Settings) -> list[str]:
    """Return which of asymmetry and quadratic term are left out."""
    kept = settings.accel_asymmetry, settings.accel_quadratic
    return [name for name, yes in zip(LIKE, kept, strict=True) if not yes]


def with_both(
    p: SystematicProblem, settings: Settings, found: Solution, given: Prior
) -> CoefficientVector:
    """Return the states with asymmetry and quadratic term, both estimated."""
    both = settings.model_copy(update={"accel_asymmetry": True, "accel_quadratic": True})
    return widened(with_settings(p, both, given), found, found.states.names)


def stands_for(wide: CoefficientVector, found: Solution, left: Sequence[str]) -> list[Finding]:
    """Say whether asymmetry stands for a quadratic term too, or the other way round.

    `wide`: with both estimated [SI].
    """
    if len(left) != 1:
        return []
    (other,), (kept,) = left, set(LIKE) - set(left)
    ratio = wide[kept].sd / found.states[kept].sd
    axes = [axis for axis, much in zip(AXES, ratio, strict=True) if much > TAKEN_IN]
    if not axes:
        return []
    cure = f"set {other.replace('.', '_')} = true"
    if only_sums(wide):
        cure = f"add {WANTED['accel.quadratic']}, and {cure}"
    meaning = f"{kept} + g {other}" if kept == LIKE[0] else f"{kept} + {other} / g"
    return [
        finding("systematic.stands_for", axes=", ".join(axes), kept=kept, left=other,
                meaning=meaning, cure=cure)
    ]  # fmt: skip


def _curves(wide: CoefficientVector, found: Solution, left: Sequence[str]) -> Shown:
    """Test whether asymmetry or quadratic terms that are left out differ from zero."""
    at = [wide.layout.index(f"{group}.{axis}") for group in left for axis in AXES]
    assert wide.cov is not None
    unit = wide.prior_sd[at]
    after = np.linalg.inv(wide.cov[np.ix_(at, at)] / np.outer(unit, unit))
    # Of the session alone: the prior is about zero.
    values, vectors = np.linalg.eigh(after - np.eye(len(at)))
    seen = values >= 1.0
    y = vectors[:, seen].T @ after @ (wide.values[at] / unit)
    square, rank = float(np.sum(y**2 / values[seen])), int(np.count_nonzero(seen))
    chance, gain = _chance(square, rank, found)
    cure = " and ".join(f"{group.replace('.', '_')} = true" for group in left)
    return Shown(chance, gain, finding("systematic.curves", left=" and ".join(left), cure=cure,
                                       chance=likely(chance)))  # fmt: skip


def _bends(choice: Choice, found: Solution) -> Shown:
    """Test whether the gyros bend.

    Quarter turns alone show three combinations or so, and misalignments of the gyros that are off
    by five standard deviations before any check fails.
    """
    chance, gain = bending(choice, found)
    cure = 'Set deflection = "choose"'
    if not any(choice.usable(c) for c in choice.candidates):
        cure = f'Add {WANTED["deflection"]}, and set deflection = "choose"'
    return Shown(chance, gain, finding("systematic.bends", chance=likely(chance), cure=cure))


def bending(choice: Choice, found: Solution) -> tuple[float, float]:
    """Return the probability that any model gains as much where nothing bends [1], and the gain."""
    each = [_chance(c.square, c.rank, found) for c in choice.candidates]
    chance, less = min((chance, -gain) for chance, gain in each)
    return min(1.0, len(each) * chance), -less


def _chance(square: float, rank: int, found: Solution) -> tuple[float, float]:
    """Return the probability of a gain, and the gain, over what the readings scatter with it.

    Innovations that it does not explain count as noise: another error, which looks a little like
    it, is not to be taken for it.
    """
    from scipy.special import chdtrc

    total, dof = float(found.run.nis.sum()), int(found.run.measured.sum())
    gain = square / max(1.0, (total - square) / dof)
    return (float(chdtrc(rank, gain)) if rank else 1.0), gain
