"""What is said of the choice of a model of deflection: verdict, check, findings, table."""

from __future__ import annotations

from typing import Any

import numpy as np

from foucault.diagnose import words
from foucault.diagnose.systematic.deflection_choice import CONFIDENCE, UNIT, Choice
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.result import Check


def check(choice: Choice) -> Check:
    """Return the check `deflection`: whether the gyros bend, how, and how sure that is."""
    used, rival = choice.used, choice.rival
    given: dict[str, Any] = {"bounds": _bounds(choice), "rival": rival.label, "rank": rival.rank}
    if used is None:
        given |= {"count": len(rival.model)}
        return words.check("deflection not seen", "deflection", choice.chance, FALSE_ALARM, None,
                           given)  # fmt: skip
    given |= {
        "used": used.label, "count": len(used.model), "chance": likely(choice.chance),
        "seen": "" if rival.whole else f" (seen in part, {rival.rank} of {len(rival.model)})",
        "times": _times(abs(choice.lead)), "less": "less" if choice.lead >= 0 else "more",
    }  # fmt: skip
    key = "deflection" if choice.significant(used) else "deflection not significant"
    return words.check(key, "deflection", -choice.lead, None, choice.limit, given)


def _bounds(choice: Choice) -> str:
    """Say how large deflections can be, by the models that are seen whole."""
    some = [c for c in choice.candidates if c.whole]
    if not some:
        return ""
    best, worst = (f(some, key=lambda c: c.bound) for f in (min, max))
    said = [f"by {best.label} no coefficient is above {best.bound / UNIT:.2g} arcsec/g"]
    if worst.bound > 1.5 * best.bound:
        said.append(f"by {worst.label} none above {worst.bound / UNIT:.2g} arcsec/g")
    return f": {', '.join(said)} ({100 * CONFIDENCE:g} %)"


def likely(chance: float) -> str:
    """Write a probability that may be very small.

    `chance`: the probability [1].
    """
    return f"{chance:.1g}" if chance > 1e-99 else "less than 1e-99"


def _times(log_odds: float) -> str:
    return f"{np.exp(log_odds):.2g} times" if log_odds < 6.0 else f"e^{log_odds:.0f} times"


def findings(choice: Choice, *, asked: bool) -> list[Finding]:
    """Return what the user should know: a model that fits better, or others that fit as well.

    `asked`: whether the model was to be chosen, one that was named needs no choice between
    equals.
    """
    used = choice.used
    if used is not None and choice.beaten:
        rival = choice.rival
        cure = f'Set deflection = "{rival.model.name}"'
        if rival.sided:
            cure += f" and chirality = {rival.model.chirality}"
        if not choice.usable(rival):
            cure = "The session does not see it whole: add spins in six other poses, such as "
            cure += '"spins, icosahedral 6" after "spins, simple 6"'
        return [
            finding("systematic.choice_rival", used=used.label, rival=rival.label, cure=cure,
                    times=_times(-choice.lead))
        ]  # fmt: skip
    shares = {k: v for k, v in choice.shares.items() if v > FALSE_ALARM}
    if asked and used is not None and len(shares) > 1:
        each = ", ".join(f"{k} {100 * v:.0f} %" for k, v in shares.items())
        return [finding("systematic.choice_close", shares=each)]
    return []


def summary(choice: Choice) -> dict[str, Any]:
    """Return the verdict and all models for result.json, no deflection first."""
    none = {
        "model": "none", "chirality": None, "label": "none", "parameters": 0, "rank": 0,
        "log_likelihood": 0.0, "chance": None, "log_odds": 0.0, "bound": None, "usable": True,
        "used": choice.used is None,
    }  # fmt: skip
    bends = [
        {
            "model": c.model.name, "chirality": c.model.chirality if c.sided else None,
            "label": c.label, "parameters": len(c.model), "rank": c.rank,
            "log_likelihood": c.square / 2, "chance": c.chance, "log_odds": c.log_odds,
            "bound": c.bound if c.whole else None, "usable": choice.usable(c),
            "used": c is choice.used,
        }
        for c in choice.candidates
    ]  # fmt: skip
    return {
        "verdict": check(choice).sentence, "false_alarm": FALSE_ALARM,
        "chance": choice.chance, "limit": choice.limit, "models": [none, *bends],
    }  # fmt: skip
