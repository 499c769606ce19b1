"""What a systematic calibration does not estimate and counts with: states of the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector, Prior
from foucault.diagnose.foresight import Extra
from foucault.errors import FoucaultError, error
from foucault.infer.filtered import component
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import (
    NOISE,
    Group,
    Posterior,
    budget,
    fit,
    noted,
    of_priors,
    planned,
    widened,
)
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT
from foucault.models.ins_errors import Sensors
from foucault.models.left_out import GRAVITY, LATITUDE, Sizes
from foucault.models.size_effect import with_size_effect
from foucault.procedures.left_out import declared_states
from foucault.procedures.systematic.choice import Decided, resumed
from foucault.procedures.systematic.problem import Solution, SystematicProblem, prior_of
from foucault.procedures.systematic.settings import SIZE_EFFECT, Settings

Found = tuple[SystematicProblem, Solution]


@dataclass(frozen=True)
class Beside:
    """The filter of a calibration with states for what is not estimated."""

    base: Solution  # without them
    wide: SystematicProblem
    groups: Mapping[str, Group]  # what is judged: what is not estimated, and the priors
    names: tuple[str, ...]  # states of the result
    passes: int  # at most [1]
    latitude: tuple[float, str]  # how well it is known [rad], and what that rests on

    @classmethod
    def of(cls, decision: Decided, sizes: Sizes, given: Prior) -> Beside:
        """Return it for a decision; `sizes`: of what is not estimated [SI]."""
        p, settings, base = decision.problem, decision.settings, decision.solution
        names = base.states.names
        sensors, groups = _widened(p, settings, names, sizes)
        of_size = {n: (0.0, g.size) for g in groups.values() for n in g.names}
        every = sensors.layout.names
        known = {
            k: v for k, v in given.items() if any(n == k or n.startswith(f"{k}.") for n in every)
        }
        prior = prior_of(sensors, of_size | known, p.noise, settings.turn_on)
        at = [every.index(n) for n in names]
        prior.values[at], prior.prior_sd[at] = _of(p.prior, names)
        groups = {
            k: g._replace(size=float(_of(prior, g.names)[1].max())) for k, g in groups.items()
        }
        groups |= of_priors(base.states, [n for n in names if n in LAYOUT])
        wide = replace(p, sensors=sensors, prior=prior)
        latitude = sizes.get(LATITUDE, (0.0, ""))
        return cls(base, wide, groups, names, settings.passes, latitude)

    def solve(self, times: Mapping[str, float]) -> Found:
        """Filter with groups so many `times` as large [1]."""
        more = replace(self.wide, prior=widened(self.wide.prior, self.groups, times))
        return more, resumed(more, self.base, self.names, passes=self.passes)

    def posterior(self, found: Found) -> Posterior:
        """Return what is judged of a solution."""
        problem, s = found
        white = s.run.innovation / np.sqrt(s.run.variance)
        kinds = {"velocity": white[:, :3], "position": white[:, 3:]}
        told = {k: component(u, FALSE_ALARM, 2) for k, u in kinds.items()}
        mean, _ = _of(problem.prior, s.states.names)
        return Posterior(s.states, mean, {k: c for k, c in told.items() if c is not None})

    def beforehand(self) -> tuple[CoefficientVector, Judgement, tuple[Extra, ...]]:
        """Return states and judgement of a session that is only planned, and what more would buy.

        That is what it buys to know sizes better.
        """
        found = self.solve({})
        at = self.posterior(found)
        judged = planned(at, self.groups, self.names)
        bought = declared_states(at, self.groups, judged, self.names)
        return *self.placed(found, judged), bought

    def budget(self, found: Found, states: CoefficientVector) -> dict[str, dict[str, Any]]:
        """Return the variances of `states` by source, the latitude's among them [SI]."""
        out = budget(found[1].states, self.groups, states)
        moved = states.sd**2 - found[1].states.chosen(states.names).sd ** 2
        if moved.any():
            out["budget"][LATITUDE] = moved.tolist()
            out["budget"][NOISE] = (np.array(out["budget"][NOISE]) - moved).tolist()
            out["sources"][LATITUDE] = ["B", self.latitude[1]]
        return out

    def placed(self, found: Found, judged: Judgement) -> tuple[CoefficientVector, Judgement]:
        """Return the states of the result with what the latitude does, and note it."""
        problem, s = found
        states, site = s.states.chosen(self.names), problem.site
        size, basis = self.latitude
        if not size or site.latitude is None:
            return states, judged
        there = replace(problem, site=replace(site, latitude=site.latitude + size))
        off = resumed(there, s, s.states.names, keep=False).states.chosen(self.names)
        moved = off.values - states.values
        assert states.cov is not None
        states = replace(states, cov=states.cov + np.outer(moved, moved))
        share = float(np.max((moved / states.sd) ** 2))
        return states, noted(judged, LATITUDE, Group("source", (), size, basis), share)


def counted(
    decision: Decided, sizes: Sizes, given: Prior
) -> tuple[Decided, CoefficientVector, Judgement, dict[str, dict[str, Any]]]:
    """Filter again with what is not estimated, and enlarge what the readings contradict.

    Arguments as of `Beside.of`. Returns the decision with these states, those of the result, what
    was made of the others, and the budget.
    """
    beside = Beside.of(decision, sizes, given)
    try:
        found, judged = fit(beside.solve, beside.posterior, beside.groups, beside.names)
        states, judged = beside.placed(found, judged)
        now = replace(decision, problem=found[0], solution=found[1])
        return now, states, judged, beside.budget(found, states)
    except FoucaultError as problem:
        far = heading_sd(sizes, decision.problem.site, beside.names)
        if problem.code != "strapdown.not_finite" or not far > FOLLOWED:
            raise
        raise error("systematic.heading_open", sd=f"{np.degrees(far):.0f}") from problem


FOLLOWED = 0.2
"""Sd of the heading at the first rest from which on the error equations do not hold [rad]."""


def heading_sd(sizes: Sizes, site: Site, names: Sequence[str]) -> float:
    """Return how uncertain what is not estimated leaves the heading at a rest, shape () [rad].

    Along East a g-sensitivity or a drift looks like the Earth's rate turned about up. `sizes`: of
    what is not estimated [SI]; `names`: of what is.
    """
    bends, drifts = (sizes.get(g, (0.0, ""))[0] for g in ("gyro.g_sensitivity", "gyro.bias drift"))
    if any(name.startswith("gyro.g_sensitivity") for name in names):
        bends = 0.0
    north = EARTH_RATE * np.cos(site.latitude or 0.0)
    return float(np.hypot(bends * site.gravity, drifts / 2) / max(north, 1e-9))


def _of(prior: CoefficientVector, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    at = [prior.names.index(n) for n in names]
    return prior.values[at], prior.prior_sd[at]


def _widened(
    p: SystematicProblem, settings: Settings, names: Sequence[str], sizes: Sizes
) -> tuple[Sensors, dict[str, Group]]:
    """Return all that acts on the readings, and what of it is not estimated."""
    gravity = p.site.gravity_sd, "standard uncertainty of local gravity"
    every = {**sizes, **SIZE_EFFECT, GRAVITY: gravity}
    every = {g: s for g, s in every.items() if s[0] > 0 and g != LATITUDE}
    bends = settings.model is not None
    coefficients = [
        LAYOUT.names[i]
        for g in every
        if g in GROUPS and not (bends and g == "gyro.deflection")
        for i in LAYOUT.group(g)
    ]
    mine = [n for n in names if n in LAYOUT]
    sensors = Sensors.of([*mine, *coefficients])
    if settings.model is not None:
        sensors = sensors.with_deflection(settings.model)
    sensors = with_size_effect(sensors)
    drifts = [g.removesuffix(" drift") for g in every if g.endswith(" drift")]
    sensors = sensors.with_drift(drifts)
    if GRAVITY in every:
        sensors = sensors.with_gravity(p.site.gravity)
    sensors = sensors.with_wander(p.noise)
    if p.recordings > 1:
        sensors = sensors.with_turn_on(p.recordings)
    groups = {}
    for group, (size, basis) in every.items():
        key = f"drift.{group.removesuffix(' drift')}" if group.endswith(" drift") else group
        key = "site.gravity" if group == GRAVITY else key
        some = [n for n in sensors.layout.names if n == key or n.startswith(f"{key}.")]
        left = tuple(n for n in some if n not in names)
        if left:
            groups[group] = Group("source", left, size, basis)
    return sensors, groups


GROUPS = frozenset(n.rpartition(".")[0] for n in LAYOUT.names)
"""Groups of coefficients of `models.imu`."""
