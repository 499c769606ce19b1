"""What the checks say: the sentences of every test, in one table.

A check is a number and its limits; its words are here, where it is inside them, below and above.
``{value}``, ``{low}`` and ``{high}`` are the number and its limits, everything else is given with
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from foucault.result import Check, Level


class Words(NamedTuple):
    """The sentences of a check: inside its limits, below and above them."""

    fine: str
    below: str = ""
    above: str = ""


WORDS = {
    "redundancy": Words(
        "{n} {readings} leave {value:.3g} numbers more than the unknowns need.",
        "{n} {readings} leave {value:.3g} numbers more than the unknowns need: at least {low} are "
        "needed to notice a bad one. {cure}",
    ),
    "noise": Words(
        "The residuals of {what} are {ratio:.2f} times what the noise says ({dof} redundant).",
        "The residuals of {what} are only {ratio:.2f} times what the noise says ({dof} redundant): "
        "the noise is overstated and so are the uncertainties.",
        "The residuals of {what} are {ratio:.1f} times what the noise explains ({dof} redundant)"
        "{then}",
    ),
    "noise untested": Words("Nothing tests the noise of the {what}: no reading is redundant."),
    "noise unknown": Words(
        "The noise of the {what} is unknown and was taken from its residuals ({dof} redundant).",
        "The noise of the {what} is unknown and the residuals do not tell it ({dof} redundant, "
        "{low:g} needed): the uncertainties mean little. Declare [noise], or {more}.",
    ),
    "repeatability": Words(
        "{what} scatters by {size} from one reading to the next beyond the noise.",
        above="{what} scatters by {size} from one reading to the next beyond the noise, more than "
        "{limit}: {cause}.",
    ),
    "evenness": Words(
        "Both halves of the session fit alike ({what}).",
        *["The {what} of the {worse} half of the session fit {times:.1f} times worse than the "
          "others: it was disturbed, warming up, or lost samples, and no single uncertainty "
          "describes all of it."] * 2,
    ),
    "held out": Words(
        "{what} that the fit did not see are predicted to {ratio:.2f} times their predicted "
        "uncertainty{size}.",
        above="{what} that the fit did not see are predicted to {ratio:.2f} times their predicted "
        "uncertainty{size}: the model lacks something, or some of them do not belong to the "
        "others.",
    ),
}  # fmt: skip
"""Key of a check -> its sentences."""


def check(
    key: str,
    name: str,
    value: float,
    low: float | None = None,
    high: float | None = None,
    given: Mapping[str, Any] = MappingProxyType({}),
    *,
    fails: Level = Level.DOUBTFUL,
    excused: bool = False,
) -> Check:
    """Return a check with its sentence.

    `key`: of `WORDS`; `value`, `low`, `high`: the number and its limits [unit of the sentence];
    `given`: what else the sentence says; `excused`: outside its limits, but accounted
    for in the uncertainties: it is said, and does not fail.
    """
    below = low is not None and value < low
    above = high is not None and value > high
    words = WORDS[key]
    text = words.below if below else words.above if above else words.fine
    sentence = text.format(value=value, low=low, high=high, **given)
    if excused:
        low, high = (None if below else low), (None if above else high)
    return Check(name, value, low, high, True, sentence, fails)
