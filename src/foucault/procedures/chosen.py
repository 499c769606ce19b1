"""Which optional terms are estimated: as set, or what a log tells better than its size.

A term that is not estimated counts at its size: a state with the prior 0 +- size. Estimated with
that prior it is the same state, so that nothing else changes by it, neither value nor uncertainty;
its own value is told besides, and compensated. A choice that the log itself makes therefore spoils
no uncertainty, and plan, bound, hold-out and Monte Carlo are those of the settings that it comes
to. Only what readings contradict, where nothing looks like it, is estimated without its size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

from foucault import units
from foucault.coefficients import Prior
from foucault.diagnose.foresight import Foresight
from foucault.diagnose.left_out import CLEARER
from foucault.errors import Finding, FoucaultError, finding
from foucault.models.left_out import table
from foucault.result import Result, TableData
from foucault.strict import Strict

OPTIONS: Mapping[str, tuple[str, ...]] = {
    "accel_quadratic": ("accel.quadratic",),
    "g_sensitivity": ("gyro.g_sensitivity",),
    "accel_asymmetry": ("accel.asymmetry",),
    "gyro_asymmetry": ("gyro.asymmetry",),
    "asymmetry": ("gyro.asymmetry",),
    "cubic": ("gyro.cubic",),
    "lever_arms": ("accel.lever",),
    "delay": ("accel.delay",),
    "misalignments": ("gyro.misalignment", "accel.scale", "accel.misalignment"),
}
"""Settings that put terms into the estimate, and the groups of these."""


class Chosen(Strict):
    """Who says which optional terms are estimated."""

    terms: Literal["as set", "auto"] = "as set"
    """Which optional terms are estimated: as set here; auto: beside them each that the log tells
    better than its size in [instrument] does, or that it contradicts."""

    @property
    def optional(self) -> dict[str, tuple[str, ...]]:
        """What may still be taken into the estimate: settings that are off, and their groups."""
        return {key: groups for key, groups in OPTIONS.items() if getattr(self, key, None) is False}


@dataclass(frozen=True)
class Taken:
    """Terms that were taken into the estimate, and why."""

    key: str  # the setting
    what: str  # in words, with how much of its size is seen
    seen: float  # share of a size that the readings tell [1]
    contradicted: bool  # whether because no size explains it
    prior: Prior  # group -> mean and sd that it keeps [SI]


G = TypeVar("G")
F = TypeVar("F")


def decided(solve: Callable[[G], F], given: G) -> tuple[F, G]:
    """Solve what is given, with the optional terms that it chooses; return what that came to too.

    `solve`: calibrates or foretells; `given`: with `settings` and `prior` [SI].
    """
    asked: Any = given
    found: Any = solve(given)
    settings = asked.settings
    if not isinstance(settings, Chosen) or settings.terms != "auto":
        return found, given
    if _evidence(found)[0] is None:
        return _noticed(found, finding("left_out.no_choice")), given
    taken, refused, last = dict[str, Taken](), set[str](), given
    while (new := _clearest(found, settings.optional, taken, refused)) is not None:
        every = {**taken, new.key: new}
        known = {group: sd for one in every.values() for group, sd in one.prior.items()}
        last = replace(
            asked, settings=settings.model_copy(update=dict.fromkeys(every, True)),
            prior={**known, **asked.prior},
        )  # fmt: skip
        try:
            other: Any = solve(last)
        except FoucaultError:  # what this log, or this solution, does not give
            refused.add(new.key)
            continue
        if new.key not in taken and other.coefficients.names == found.coefficients.names:
            refused.add(new.key)  # a solution that has terms of its own
            continue
        found, given, taken = other, last, every
    if not taken:
        return found, given
    told = ", ".join(one.what for one in taken.values())
    keys = " and ".join(f"{key} = true" for key in taken)
    if isinstance(found, Result):
        said = dict(found.diagnostics) | {"taken": {k: one.what for k, one in taken.items()}}
        if "prior" in said.get("sources", {}):
            basis = "size of what was taken into the estimate; prior as given in the campaign"
            said["sources"] = said["sources"] | {"prior": ["B", basis]}
        found = replace(found, diagnostics=said)
    return _noticed(found, finding("left_out.taken", terms=told, keys=keys)), given


def _noticed(found: Any, told: Finding) -> Any:
    return replace(found, findings=(*found.findings, told))


def _evidence(found: Result | Foresight) -> tuple[TableData | None, Sequence[Mapping[str, float]]]:
    """Return the table of what is left out, and the sets of groups that readings contradict."""
    if isinstance(found, Foresight):
        return found.left_out, ()
    return found.tables.get("left_out"), found.diagnostics.get("named", ())


def _clearest(
    found: Result | Foresight, optional: Mapping[str, tuple[str, ...]], taken: Mapping[str, Taken],
    refused: set[str],
) -> Taken | None:  # fmt: skip
    """Return what is to be taken in next: what is contradicted first, then what is seen best."""
    columns, named = _evidence(found)
    assert columns is not None
    rows = {str(g): (float(columns["seen"][k]), str(columns["size"][k]))
            for k, g in enumerate(columns["group"])}  # fmt: skip
    alone = {next(iter(one)).removeprefix("prior of ") for one in named if len(one) == 1}
    out = []
    for key, groups in optional.items():
        mine = [g for g in groups if g in rows]
        wrong = alone & set(groups)
        if key in refused or (key in taken and (taken[key].contradicted or not wrong)):
            continue
        seen = max((rows[g][0] for g in mine), default=0.0)
        if not wrong and seen <= CLEARER:
            continue
        words = (f"{table().groups[g].what} ({rows[g][0]:.2g} of {rows[g][1]} seen)" for g in mine)
        prior = {g: (0.0, units.parse(rows[g][1], table().groups[g].kind)) for g in mine}
        what = f"{table().groups[min(wrong)].what} (contradicted)" if wrong else ", ".join(words)
        out.append(Taken(key, what, seen, bool(wrong), {} if wrong else prior))
    return max(out, key=lambda one: (one.contradicted, one.seen), default=None)
