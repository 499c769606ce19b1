"""Are functions of temperature right: terms, scatter, sessions left out, heating and cooling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, special

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.diagnose.words import check
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.temperature.fit import Evidence, solve
from foucault.estimate.temperature.order import Choice, Spaces, against, refit
from foucault.models import size_effect
from foucault.result import Check
from foucault.units import ZERO_CELSIUS

ORDERS = ("constant", "straight line", "parabola", "cubic")


@dataclass(frozen=True)
class Seen:
    """A fit and what it was made from."""

    layout: Layout  # the n coefficients fitted
    families: tuple[str, ...]
    family: IntArray  # (n,) the family of each [1]
    unit: FloatArray  # (n,) unit of the fit [SI]
    spaces: Spaces  # functions there were to choose from
    evidence: tuple[Evidence, ...]  # sessions, then parts of ramps
    choice: Choice
    names: tuple[str, ...]  # names of the sessions
    temperature: FloatArray  # (m,) mean temperature of every session [K]
    counts: IntArray  # (families,) at how many temperatures sessions tell each family [1]
    knots: FloatArray  # (p,) or (0,) knots of piecewise linear functions [K]
    turning: bool  # whether heating and cooling are to be compared

    @property
    def ramps(self) -> bool:
        """Whether there are ramps."""
        return len(self.evidence) > len(self.names)

    def label(self, order: int) -> str:
        """Name one of the nested functions.

        `order`: its number [1].
        """
        if self.knots.size and order == 2:
            return f"line through {self.knots.size} knots"
        return ORDERS[order] if order < len(ORDERS) else f"power {order}"

    @cached_property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Every temperature as predicted without its sessions, where the others can."""
        order = np.argsort(self.temperature, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(self.temperature[order]) > 1.0) + 1)
        found = [self._without(np.sort(group)) for group in groups]
        return tuple(one for one in found if one is not None)

    def _without(self, group: IntArray) -> LeftOut | None:
        rest = [e for k, e in enumerate(self.evidence) if k not in set(group.tolist())]
        design, choice = self.choice.fit.design, self.choice
        found = refit(rest, design, choice.known, choice.wanted) if rest else None
        if found is None:
            return None
        fit, dof, free = found
        if (self.choice.wanted & ~free & ~self.choice.untold).any():
            return None  # too few are left to tell how far sessions scatter
        z = np.full((len(group), len(self.layout)), np.nan)
        worst = (1.0, 0)
        for k, member in enumerate(group):
            one = self.evidence[member]
            said, cov = fit.predicted(one)
            miss, at = one.y - said, np.argmax(one.H, axis=1)
            z[k, at] = miss / np.sqrt(np.diag(cov))
            for f in np.unique(one.group):
                mine = one.group == f
                r, S = miss[mine], cov[np.ix_(mine, mine)]
                square = float(r @ linalg.solve(S, r, assume_a="pos"))
                worst = min(worst, (_chance(square, int(mine.sum()), float(dof[f])), int(f)))
        return LeftOut(group, z, worst[0], worst[1])

    @cached_property
    def hysteresis(self) -> tuple[tuple[int, float, float], ...]:
        """Family, F and probability of a difference between heating and cooling, where told."""
        choice, out = self.choice, []
        small = self.spaces.design(choice.orders)
        extra = np.zeros((1, self.spaces.constant.shape[1]))
        extra[0, -1] = 1.0
        for f, order in enumerate(self.choice.orders):
            if order == 0 or not self.turning:
                continue
            design = self.spaces.design(choice.orders, extra, f)
            # The scatter is that of the larger design, or the difference would be a part of it.
            found = refit(self.evidence, design, choice.known, choice.wanted)
            if found is not None:
                large, dof, _ = found
                fit = solve(self.evidence, small, large.variance)
                assert fit is not None  # a part of what was told
                F, p, _ = against(fit, large, float(dof[f]))
                out.append((f, F, p))
        return tuple(out)


@dataclass(frozen=True)
class LeftOut:
    """One temperature predicted without its sessions."""

    sessions: IntArray  # (k,) its sessions [1]
    # (k, n) what they found minus what the others predict, over its standard deviation [1]
    z: FloatArray
    p: float  # smallest probability of any family by chance [1]
    family: int  # that family [1]


def checks(seen: Seen) -> tuple[Check, ...]:
    """Return every test of the functions."""
    some = (_freedom(seen), _terms(seen), _chi_square(seen), _left_out(seen), _hysteresis(seen),
            _one_temperature(seen))  # fmt: skip
    return tuple(check for check in some if check is not None)


def _freedom(seen: Seen) -> Check | None:
    """More temperatures than terms, or nothing is tested."""
    if seen.ramps:
        return None
    terms = [len(seen.spaces.nested[f][n]) for f, n in enumerate(seen.choice.orders)]
    spare = np.array(seen.counts) - terms
    # Lever arms and delay have no temperature: one will do.
    fixed = [any(n == f or n.startswith(f"{f}.") for n in size_effect.LAYOUT.names)
             for f in seen.families]  # fmt: skip
    f = int(np.argmin(np.where(fixed, spare.max() + 1, spare)))
    given = {"name": seen.families[f], "count": seen.counts[f], "terms": terms[f]}
    low = None if fixed[f] else 1.0
    return check("temperatures", "temperatures", float(spare[f]), low, None, given)


def _terms(seen: Seen) -> Check | None:
    """A term that is missing shows against the largest function that could be told."""
    tests = seen.choice.missing
    if not tests:
        return None
    worst = min(tests, key=lambda t: t.p)
    given = {
        "name": seen.families[worst.family], "has": seen.label(worst.order),
        "more": seen.label(worst.against), "F": worst.F,
    }  # fmt: skip
    return check("terms", "terms", worst.p, FALSE_ALARM / len(tests), None, given)


def _chi_square(seen: Seen) -> Check | None:
    """Where the scatter is declared, residuals are to be what it and the covariances predict."""
    fit = seen.choice.fit
    if seen.choice.wanted.any() or fit.dof < 1:
        return None
    (low, high), given = chi_square_limits(fit.dof), {"dof": fit.dof}
    return check("scatter of sessions", "chi-square", fit.chi_square, low, high, given)


def _left_out(seen: Seen) -> Check | None:
    told = seen.left_out
    if not told:
        return None
    worst = min(told, key=lambda one: one.p)
    limit = FALSE_ALARM / (len(told) * len(seen.families))
    given = {
        "count": len(told), "name": seen.families[worst.family],
        "at": f"{seen.temperature[worst.sessions].mean() - ZERO_CELSIUS:.1f} degC",
        "who": ", ".join(seen.names[k] for k in worst.sessions),
    }  # fmt: skip
    return check("temperature left out", "temperature left out", worst.p, limit, None, given)


def _hysteresis(seen: Seen) -> Check | None:
    if not seen.hysteresis:
        return None
    family, F, p = min(seen.hysteresis, key=lambda row: row[2])
    limit, given = FALSE_ALARM / len(seen.hysteresis), {"name": seen.families[family], "F": F}
    return check("heating and cooling", "heating and cooling", p, limit, None, given)


def _one_temperature(seen: Seen) -> Check | None:
    """With a ramp, what sessions know at one temperature only is taken as constant."""
    alone = [n for n, c in zip(seen.families, seen.counts, strict=True) if c < 2]
    constant = [
        n for n in alone if seen.choice.orders[seen.families.index(n)] == 0
        and n not in ("gyro.bias", "accel.bias")
    ]  # fmt: skip
    if not seen.ramps:
        return None
    count, given = float(len(constant)), {"names": ", ".join(constant)}
    return check("constant over a ramp", "what a ramp cannot tell", count, None, 0.0, given)


def findings(seen: Seen) -> tuple[Finding, ...]:
    """Return what should be known of the fit."""
    count = len(seen.families)
    untold = [n for n, u in zip(seen.families, seen.choice.untold[:count], strict=True) if u]
    out = [finding("temperature.no_scatter", families=", ".join(untold))] if untold else []
    if seen.turning and not seen.hysteresis:
        out.append(finding("temperature.one_way"))
    return tuple(out)


def _chance(square: float, terms: int, dof: float) -> float:
    if np.isinf(dof):
        return float(special.chdtrc(terms, square))
    return float(special.fdtrc(terms, dof, square / terms))
