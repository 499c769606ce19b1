"""Judge what a calibration does not estimate: is it within its size, and would this log see it?"""

from __future__ import annotations

from typing import Any

import numpy as np

from foucault.diagnose.checks import check
from foucault.infer.left_out import Judgement, Seen
from foucault.models.imu import LAYOUT
from foucault.models.left_out import in_words
from foucault.models.left_out import table as typical
from foucault.result import Check, TableData
from foucault.units import plain

CLEARER = 0.5
"""A term of which readings see a larger share than this they know better than its size [1]."""


LAYOUT_GROUPS = frozenset(name.rpartition(".")[0] for name in LAYOUT.names)
"""Groups of coefficients, which can be estimated."""


def _what(group: str) -> str:
    """Say in words what a group is."""
    known = typical().groups
    return known[group].what if group in known else group


def _size(judged: Judgement, group: str, times: float = 1.0) -> str:
    return in_words(group, times * judged.sizes[group][0])


def checks(judged: Judgement, jumped: bool = False) -> tuple[Check, ...]:
    """Return one check for each set of causes that readings contradict, or one for all as passed.

    `jumped`: whether something jumped, which a drift cannot say.

    What cannot be shown though it matters is told, and lowers no verdict: its size is in the
    uncertainties.
    """
    out = []
    for causes in judged.named:
        first, k = next(iter(causes.items()))
        given = {
            "what": _what(first), "cure": _cure(first, jumped),
            "ties": "".join(f", or {_what(n)}" for n in list(causes)[1:]),
            "size": f", {_size(judged, first)}" if first in judged.sizes else "",
            "worst": _worst(judged, first),
        }  # fmt: skip
        out.append(check("left out contradicted", f"size of {first}", k, None, 1.0, given))
    if not out:
        last = judged.after or judged.seen
        tested = [s for n, s in last.items() if n in judged.groups and s.dof]
        count = {"count": len(tested)}
        least = min((s.p for s in tested), default=1.0)
        chance = min(1.0, least * max(len(tested), 1))
        out.append(check("left out", "terms not estimated", least, None, None, count, p=chance))
    clear = [
        n for n in judged.groups
        if n in LAYOUT_GROUPS and n in judged.seen and _most(judged.seen[n]) > CLEARER
    ]  # fmt: skip
    if clear:
        terms = {"terms": ", ".join(f"{_what(n)} ({_size(judged, n, _left(judged.seen[n]))} "
                                    f"instead of {_size(judged, n)})" for n in clear)}  # fmt: skip
        out.append(check("left out seen", "terms that show", float(len(clear)), given=terms))
    some = {n: (0, k) for n, k in judged.unseen.items()}
    some = {n: x for n, x in judged.hidden.items() if n not in some} | some
    if some:
        parts = [
            f"{_what(n)} ({_size(judged, n)})"
            + (f", {count} of its {len(judged.seen[n].u)} terms" if count else "")
            + ("" if np.isinf(k) else f" below {_size(judged, n, k)}")
            + f": {typical().groups[n].shown_by}"
            for n, (count, k) in some.items()
        ]
        terms = {"terms": "; ".join(parts)}
        out.append(check("left out unseen", "terms not shown", float(len(parts)), given=terms))
    return tuple(out)


def _left(seen: Seen) -> float:
    """Return what is left of the size of the term that is seen best, estimated with it [1]."""
    return float(np.sqrt(1.0 - _most(seen)))


def _worst(judged: Judgement, group: str) -> str:
    """Say which term of several is farthest off: the factor of a group is a mean of all."""
    if group not in judged.worst or len(judged.seen[group].u) < 2:
        return ""
    name, times = judged.worst[group]
    return f", most of all {name}, about {plain(times, 2)} times"


def _cure(group: str, jumped: bool) -> str:
    """Say what to do about a group that is larger than its size."""
    if group.startswith("prior of "):
        return "Correct [prior], or leave it out."
    if group not in typical().groups or not typical().groups[group].sizes:
        return "Correct what the campaign says of it, or how well that is known."
    if group.endswith(" drift") and jumped:
        return "It is no drift but the jump."
    if group.endswith(" drift"):
        return (
            "Let the instrument warm up, look for a knock or a cable that made it jump, repeat the "
            "first readings at the end, or declare it."
        )
    return (
        'Estimate it (terms = "auto" does, where the procedure has it and it is alone), declare '
        "its size in [instrument], or take a plan that tells them apart."
    )


def counted_size(judged: Judgement | None, group: str) -> float:
    """Return the size that a `group` is counted with, enlarged or not; 0 where it is not [SI]."""
    if judged is None or group not in judged.groups:
        return 0.0
    times = max((one[group] for one in judged.named if group in one), default=1.0)
    return float(times * judged.sizes[group][0])


def common_g_sensitivity(judged: Judgement | None, gravity: float) -> float:
    """Return the sd of what g-sensitivities that are not estimated add to all rates along up.

    That is the mean of the three axes that act on themselves. `gravity`: local gravity [m/s^2].
    Returns [rad/s], 0 where it does not count.
    """
    return float(counted_size(judged, "gyro.g_sensitivity") * gravity / np.sqrt(3))


def judgement_json(judged: Judgement) -> dict[str, Any]:
    """Return what was made of every group, for result.json; sizes in SI."""
    rows = {}
    for name, s in judged.seen.items():
        size, basis = judged.sizes.get(name, (None, ""))
        share = np.clip(np.diag(s.V), 0.0, 1.0)
        rows[name] = {
            "kind": "left out" if name in judged.groups else s.kind, "size": size,
            "k": s.k, "t": s.T, "dof": s.dof, "p": s.p, "gain": s.gain,
            "seen": [float(share.min()), float(share.max())],
            "needed": _finite(judged.needed[name]), "basis": basis,
        }  # fmt: skip
    return {"left_out": rows, "named": [dict(one) for one in judged.named]}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def table(judged: Judgement) -> TableData:
    """Return the table "left_out": what each group costs, and whether this log would see it."""
    groups = [g for g in judged.groups if g in judged.seen]
    seen = [judged.seen[g] for g in groups]
    named = {n: k for one in judged.named for n, k in one.items()}
    return {
        "group": np.array(groups, dtype=object),
        "what": np.array([_what(g) for g in groups], dtype=object),
        "size": np.array([_size(judged, g) for g in groups], dtype=object),
        "share": np.array([judged.share.get(g, 0.0) for g in groups]),
        "seen": np.array([_most(s) for s in seen]),
        "needed": np.array([judged.needed[g] for g in groups]),
        "times": np.array([named.get(g, np.nan) for g in groups]),
        "basis": np.array([judged.sizes[g][1] for g in groups], dtype=object),
    }


def foretold(judged: Judgement) -> TableData:
    """Return the table "left_out" of a session that is only planned, with what would show each."""
    some = {k: v for k, v in table(judged).items() if k != "times"}
    by = [typical().groups[str(g)].shown_by for g in some["group"]]
    return some | {"shown_by": np.array(by, dtype=object)}


def _most(s: Seen) -> float:
    """Return the largest share of a term that the readings see."""
    return float(np.clip(np.diag(s.V), 0.0, 1.0).max())
