"""What a search for a plan has found: the plan beside the one to beat."""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.errors import Finding, error, finding
from foucault.files import atomic, parse_json
from foucault.plans.optimise import Comparison, Space, compare

Turned = tuple[float, float, tuple[float, float, float]]

FOUND_FILE = "found.json"

GAIN = 0.9995
"""Ratios above this are no gain: they are written as 1.000 [1]."""


@dataclass(frozen=True)
class Found:
    """A plan beside the one to beat."""

    procedure: str
    aim: str  # what was made small: "sd", or "time" for what is wanted among `needs`
    reference: str  # what the plan to beat is called
    # steps, reference_steps: both plans as tables: headings, then rows
    steps: tuple[tuple[str, ...], ...]
    reference_steps: tuple[tuple[str, ...], ...]
    # duration, reference_duration: time that they take [s]
    duration: float
    reference_duration: float
    # motion, reference_motion: beginning, end [s] and rates about x, y, z [rad/s] of each step,
    # where it is turned at rates; empty elsewhere
    motion: tuple[Turned, ...]
    reference_motion: tuple[Turned, ...]
    # needs, reference_needs: what both plans need of the rig, where that is said
    needs: tuple[Limit, ...]
    reference_needs: tuple[Limit, ...]
    # names, units: what is compared, and the units of `sd` and `reference_sd` for people
    names: tuple[str, ...]
    units: tuple[str, ...]
    weights: tuple[float, ...]  # how much each counts [1]
    unseen: tuple[str, ...]  # what no allowed plan shows
    cases: tuple[str, ...]
    # sd, reference_sd: standard deviations that would be stated, by case and name [units]
    sd: tuple[tuple[float, ...], ...]
    reference_sd: tuple[tuple[float, ...], ...]
    ratio: tuple[tuple[float, ...], ...]  # one over the other by case and name [1]
    # geometric_mean, worst: of the ratios of what counts, by case [1]
    geometric_mean: tuple[float, ...]
    worst: tuple[float, ...]
    # of each restart its number, cost, evaluations, whether it continued an earlier plan, and its
    # trace
    restarts: tuple[dict[str, Any], ...]
    evaluations: int  # plans that were judged [1]
    seed: int  # of the search [1]
    version: str
    allowed: str  # what plans were allowed, in words
    findings: tuple[Finding, ...]  # what the user should know

    @property
    def gained(self) -> bool:
        """Whether the plan is better than the one to beat, in the first case; or shorter."""
        if self.aim == "time":
            shorter = self.duration <= GAIN * self.reference_duration
            return shorter and not _broken(self.needs)
        return self.geometric_mean[0] <= GAIN

    @property
    def reference_broken(self) -> tuple[str, ...]:
        """Limits of the rig that the plan to beat breaks, in words."""
        return _broken(self.reference_needs)

    @property
    def possible_instead(self) -> bool:
        """Whether the rig can do this plan, and not the one to beat."""
        return bool(self.reference_broken) and not _broken(self.needs)

    @property
    def complete(self) -> bool:
        """Whether all is seen, the rig can do it, and it is better or the other is impossible."""
        useful = self.gained or self.possible_instead
        return not self.unseen and useful and not _broken(self.needs)

    @classmethod
    def of(
        cls, procedure: str, space: Space, plan: Any,
        rows: Mapping[str, npt.NDArray[Any]], seed: int, told: tuple[Finding, ...] = (),
    ) -> Found:  # fmt: skip
        """Compare a plan with the one to beat.

        `rows` (restarts,): columns of the restarts; `seed`: of the search [1].
        """
        c = compare(space, plan)
        total = int(rows["evaluations"].sum())
        found = cls(
            procedure=procedure,
            aim=getattr(space, "aim", "sd"),
            reference=space.reference_name,
            steps=space.steps(plan),
            reference_steps=space.steps(space.reference),
            duration=space.duration(plan),
            reference_duration=space.duration(space.reference),
            motion=_said(space, "motion", plan),
            reference_motion=_said(space, "motion", space.reference),
            needs=_said(space, "needs", plan),
            reference_needs=_said(space, "needs", space.reference),
            unseen=space.unseen,
            **_compared(c),
            restarts=_restarts(rows),
            evaluations=total,
            seed=seed,
            version=importlib.metadata.version("foucault"),
            allowed=space.limits,
            findings=told,
        )
        return replace(found, findings=(*told, *_judged(found)))

    def save(self, folder: str | Path) -> None:
        """Write it into the folder of the search."""
        with atomic(Path(folder) / FOUND_FILE) as temporary:
            temporary.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def _restarts(rows: Mapping[str, npt.NDArray[Any]]) -> tuple[dict[str, Any], ...]:
    """Return what the report says of each restart."""
    kept = ("restart", "cost", "evaluations", "continued")
    return tuple(
        {name: rows[name][i].item() for name in kept} | {"trace": _frozen(json.loads(trace))}
        for i, trace in enumerate(rows["trace"])
    )


def _compared(c: Comparison) -> dict[str, Any]:
    """Return the fields that come from the comparison, in the units that are shown."""
    shown = units.display_units(c.kinds, c.sd[0])
    return {
        "names": c.names,
        "units": shown,
        "weights": _tuple(c.weights),
        "cases": c.cases,
        "sd": tuple(_shown(row, c.kinds, shown) for row in c.sd),
        "reference_sd": tuple(_shown(row, c.kinds, shown) for row in c.reference_sd),
        "ratio": tuple(_tuple(row) for row in c.ratio),
        "geometric_mean": _tuple(c.geometric_mean),
        "worst": _tuple(c.worst),
    }


def _broken(needs: tuple[Limit, ...]) -> tuple[str, ...]:
    return tuple(limit.words for limit in needs if not limit.kept)


def _judged(found: Found) -> tuple[Finding, ...]:
    """Say what the rig cannot do of the plan to beat, or that nothing was gained on it."""
    ratio = found.geometric_mean[0]
    if found.possible_instead:
        broken = ", ".join(found.reference_broken)
        given = {"name": found.reference, "broken": broken, "ratio": ratio}
        return (finding("optimise.reference_limits", **given),)
    if found.gained:
        return ()
    if found.aim == "time":
        given = {"time": f"{found.duration:.0f}", "reference": f"{found.reference_duration:.0f}"}
        return (finding("optimise.no_time", evaluations=found.evaluations, **given),)
    return (finding("optimise.no_gain", evaluations=found.evaluations, ratio=ratio),)


def _said(space: Space, what: str, plan: Any) -> Any:
    """Return what a space may say of a plan, nothing where it does not."""
    method: Callable[[Any], Any] | None = getattr(space, what, None)
    return () if method is None else method(plan)


def _shown(sd: FloatArray, kinds: tuple[str, ...], shown: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(
        units.convert(float(v), kind, unit) for v, kind, unit in zip(sd, kinds, shown, strict=True)
    )


def _tuple(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def load(folder: str | Path) -> Found:
    """Read what a search has found."""
    path = Path(folder) / FOUND_FILE
    try:
        raw = parse_json(path.read_text(encoding="utf-8"))
        plain = {f.name: _frozen(raw[f.name]) for f in fields(Found)}
        for name, kind in (("findings", Finding), ("needs", Limit), ("reference_needs", Limit)):
            plain[name] = tuple(kind(**item) for item in plain[name])
    except (OSError, ValueError, KeyError, TypeError):  # of another version, or cut short
        raise error("optimise.missing", folder=folder) from None
    return Found(**plain)


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _frozen(v) for key, v in value.items()}
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value
