"""What the checks say: the sentences of every test, in one table, `words.toml`.

A check is a number and its limits; its words are said where it is inside them, below and above.
``{value}``, ``{low}`` and ``{high}`` are the number and its limits, everything else is given with
it. A sentence that begins with ``...`` goes on from the one inside the limits: with a blank after
it, else in place of its full stop.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from foucault.result import Check, Level


class Words(NamedTuple):
    """The sentences of a check: inside its limits, below and above them; one does for both sides.

    Without either the first is said in any case.
    """

    fine: str
    below: str = ""
    above: str = ""


@cache
def sentences() -> Mapping[str, Words]:
    """Return the table `words.toml`: key of a check -> its sentences."""
    text = (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
    return {key: Words(**row) for key, row in tomllib.loads(text).items()}


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
    passed: bool = True,
) -> Check:
    """Return a check with its sentence.

    `key`: of `sentences`; `value`, `low`, `high`: the number and its limits [unit of the sentence];
    `given`: what else the sentence says; `excused`: outside its limits, but accounted
    for in the uncertainties: it is said, and does not fail; `passed`: False where no number says
    that it fails.
    """
    below = low is not None and value < low
    above = high is not None and value > high
    words, text = sentences()[key], ""
    if below or above:
        text = (words.below or words.above) if below else (words.above or words.below)
    if text.startswith("..."):
        text = words.fine.removesuffix("" if text[3] == " " else ".") + text[3:]
    sentence = (text or words.fine).format(value=value, low=low, high=high, **given)
    if excused:
        low, high = (None if below else low), (None if above else high)
    return Check(name, value, low, high, passed, sentence, fails)
