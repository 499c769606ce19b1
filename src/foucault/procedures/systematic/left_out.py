"""What a systematic calibration did not estimate: does it show, and does something stand for it?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.systematic.checks import LIKE, WANTED, only_sums
from foucault.diagnose.systematic.deflection_choice import Choice
from foucault.diagnose.systematic.deflection_verdict import likely
from foucault.diagnose.words import check
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.procedures.systematic.choice import Decided, compared, widened, with_settings
from foucault.procedures.systematic.problem import SystematicProblem
from foucault.procedures.systematic.settings import Settings
from foucault.procedures.systematic.solution import Solution
from foucault.result import Check
from foucault.tables import AXES

Given = Mapping[str, tuple[float, float]]


RATE = FALSE_ALARM / 2
"""False-alarm rate of each of two tests of errors that are left out [1]."""

TAKEN_IN = 3.0
"""One stands for both if it is so many times less certain where both are estimated [1]."""


@dataclass(frozen=True)
class Shown:
    """An error that is left out and shows."""

    chance: float  # probability that so much is seen where there is none [1]
    gain: float  # twice the gain in log-likelihood by it, over what remains for each reading [1]
    finding: Finding  # what is said of it


def left_out(decision: Decided, given: Given) -> tuple[list[Finding], list[Check]]:
    """Return what the user should know of errors that were not estimated, and the check of them.

    One error that is left out looks a little like another: that which explains the readings best is
    named alone.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
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
    p: SystematicProblem, settings: Settings, found: Solution, given: Given
) -> list[Finding]:
    """Say beforehand whether asymmetry or quadratic term will stand for both.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    left = _left(settings)
    return stands_for(with_both(p, settings, found, given), found, left) if left else []


def _left(settings: Settings) -> list[str]:
    """Return which of asymmetry and quadratic term are left out."""
    kept = settings.accel_asymmetry, settings.accel_quadratic
    return [name for name, yes in zip(LIKE, kept, strict=True) if not yes]


def with_both(
    p: SystematicProblem, settings: Settings, found: Solution, given: Given
) -> CoefficientVector:
    """Return the states with asymmetry and quadratic term, both estimated.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
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
