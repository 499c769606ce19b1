"""Do coefficients follow the functions of temperature that were fitted?

Checks of terms, scatter, sessions left out, heating and cooling; and the facts, points and curves
that a fit leaves for the report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import linalg, special

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.diagnose.checks import check
from foucault.errors import Finding, finding
from foucault.estimate.temperature import (
    Choice,
    Design,
    Evidence,
    Fit,
    Spaces,
    Test,
    covariance,
    gained,
    refit,
)
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models import size_effect
from foucault.models.temperature import TemperatureModel, basis
from foucault.result import Check
from foucault.units import ZERO_CELSIUS

BEFORE = 2
"""Least sessions before something changed for good, and after it: one is an outlier [1]."""

PASSES = 3  # Steps to how far a thermometer is off: each leaves what functions bend by [1].

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
    reference: float  # temperature that powers are about [K]
    knots: FloatArray  # (p,) or (0,) knots of piecewise linear functions [K]
    turning: bool  # whether heating and cooling are to be compared

    @property
    def ramps(self) -> bool:
        """Whether there are ramps."""
        return len(self.evidence) > len(self.names)

    def label(self, order: int) -> str:
        """Name the nested function of number `order` [1]."""
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
        some = [f for f, order in enumerate(self.choice.orders) if order and self.turning]
        return tuple((f, *told) for f in some if (told := self._beside(self.evidence, f)))

    @cached_property
    def jumps(self) -> tuple[tuple[int, int, float, float], ...]:
        """Session before which something changed for good, what, F and probability, where told.

        What is a family that is another by a constant, or -1: all are at temperatures that are
        wrong by a constant.
        """
        out, m = list[tuple[int, int, float, float]](), len(self.names)
        for k in range(BEFORE, m - BEFORE + 1):
            later = np.arange(m) >= k
            stepped = self._at(self.temperature, np.where(later, 0.5, -0.5))
            for f in range(len(self.families)):
                told = self._beside(stepped, f)
                out += [(k, f, *told)] if told else []
            told = self._misread(later.astype(float))
            out += [(k, -1, *told)] if told else []
        return tuple(out)

    def _beside(self, evidence: tuple[Evidence, ...], f: int) -> tuple[float, float] | None:
        """Return F and probability of the last function of `evidence` in a family, where told."""
        extra = np.zeros((1, self.spaces.constant.shape[1]))
        extra[0, -1] = 1.0
        return self._judged(evidence, self.spaces.design(self.choice.orders, extra, f), f)

    @cached_property
    def _likeliest(self) -> Fit | None:
        choice = self.choice
        found = refit(self.evidence, choice.fit.design, choice.known, choice.wanted,
                      restricted=False)  # fmt: skip
        return found and found[0]

    def _judged(
        self, evidence: tuple[Evidence, ...], design: Design, f: int | None
    ) -> tuple[float, float] | None:
        """Compare the fit with another of evidence that has more; `f`: the family, None: all.

        By what each is likeliest with: the scatter of one of them alone may be small by chance.
        """
        choice, small = self.choice, self._likeliest
        found = refit(evidence, design, choice.known, choice.wanted, restricted=False)
        if found is None or small is None:
            return None
        large, dof, free = found
        if (choice.wanted & ~free & ~choice.untold).any():
            return None
        terms = max(len(large.theta) - len(small.theta), 1)
        gain, least = max(gained(small, large), 0.0), int(np.argmin(dof) if f is None else f)
        left = float(dof[least])
        if np.isinf(left):
            return gain / terms, float(special.chdtrc(terms, gain))
        # Of rows that scatter alike the likelihood ratio is a function of F.
        rows = sum(int(np.sum(one.group == least)) for one in evidence)
        F = left / terms * float(np.expm1(gain / rows))
        return F, float(special.fdtrc(terms, left, F))

    def _misread(self, later: FloatArray) -> tuple[float, float] | None:
        """Return the same of a thermometer that is off by a constant; `later` (m,): where [1]."""
        choice, off = self.choice, 0.0
        if not any(choice.orders):
            return None
        for _ in range(PASSES):
            near = [self._at(self.temperature + (off + step) * later) for step in (-0.5, 0.0, 0.5)]
            found = refit(near[1], choice.fit.design, choice.known, choice.wanted)
            if found is None:
                return None
            fit, rows, left = found[0], [], []
            for low, now, high, r in zip(*near, fit.residuals, strict=True):
                X, root = fit.design.rows(now), np.linalg.cholesky(covariance(now, fit.variance))
                slope = (fit.design.rows(high) - fit.design.rows(low)) @ fit.theta
                rows.append(np.linalg.solve(root, np.c_[X, slope]))
                left.append(np.linalg.solve(root, r))
            off += float(np.linalg.lstsq(np.concatenate(rows), np.concatenate(left))[0][-1])
        return self._judged(self._at(self.temperature + off * later), choice.fit.design, None)

    def _at(self, temperature: FloatArray, more: FloatArray | None = None) -> tuple[Evidence, ...]:
        """Return the evidence with sessions at other temperatures (m,) [K].

        `more` (m,) or None: what the last function is there [1].
        """
        count, out = len(self.names), list(self.evidence)
        terms = self.spaces.constant.shape[1] - 1
        for k, values in enumerate(basis(temperature, terms, self.reference, self.knots)):
            last = out[k].basis[-1] if more is None else more[k]
            out[k] = replace(out[k], basis=np.r_[values, last])
        if more is not None:  # a ramp has a constant of its own
            none = [replace(e, basis=np.r_[e.basis[:-1], 0.0]) for e in out[count:]]
            out[count:] = none
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
            _jump(seen), _one_temperature(seen))  # fmt: skip
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


def _jump(seen: Seen) -> Check | None:
    if not seen.jumps:
        return None
    k, f, F, p = min(seen.jumps, key=lambda row: row[-1])
    what = "the sensor of temperature" if f < 0 else seen.families[f]
    given = {"what": what, "who": seen.names[k], "F": F}
    return check(
        "change for good", "change for good", p, FALSE_ALARM / len(seen.jumps), None, given
    )


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


CURVE = 61  # Points of the curves that reports draw [1].

POINTS = ("session", "temperature", "coefficient", "value", "sd", "sd_total", "residual",
          "left_out")  # fmt: skip
"""Columns of the table of points."""


def facts(seen: Seen, model: TemperatureModel) -> dict[str, Any]:
    """Return the families with their functions and tests, as plain JSON values."""
    choice = seen.choice
    needed = {t.family: t for t in choice.needed}
    missing = {t.family: t for t in choice.missing}
    rows = []
    for f, name in enumerate(seen.families):
        member = seen.layout.names[int(np.flatnonzero(seen.family == f)[0])]
        rows.append({
            "family": name,
            "function": seen.label(choice.orders[f]),
            "temperatures": int(seen.counts[f]),
            "scatter": float(model.scatter[model.layout.index(member)]),
            "scatter_found": bool(choice.wanted[f]),
            "scatter_dof": float(choice.dof[f]),
            "needed": _said(needed.get(f), seen),
            "missing": _said(missing.get(f), seen),
        })  # fmt: skip
    tests = [{"family": seen.families[f], "F": F, "p": p} for f, F, p in seen.hysteresis]
    fit = choice.fit
    return {"families": rows, "hysteresis": tests, "chi_square": fit.chi_square, "dof": fit.dof}


def _said(test: Test | None, seen: Seen) -> dict[str, Any] | None:
    if test is None:
        return None
    pair = {"has": seen.label(test.order), "against": seen.label(test.against)}
    return pair | {"F": test.F, "p": test.p}


def points(seen: Seen) -> dict[str, npt.NDArray[Any]]:
    """Return one row per session and coefficient: what was found, and how far off it is."""
    alone = np.full((len(seen.names), len(seen.layout)), np.nan)
    for one in seen.left_out:
        alone[one.sessions] = one.z
    rows: dict[str, list[Any]] = {k: [] for k in POINTS}
    fit = seen.choice.fit
    for k, name in enumerate(seen.names):
        e = seen.evidence[k]
        total = np.sqrt(np.diag(e.cov) + fit.variance[e.group])
        for row, i in enumerate(np.argmax(e.H, axis=1)):
            values = (name, seen.temperature[k], seen.layout.names[i], e.y[row] * seen.unit[i],
                      np.sqrt(e.cov[row, row]) * seen.unit[i], total[row] * seen.unit[i],
                      fit.residuals[k][row] / total[row], alone[k, i])  # fmt: skip
            for key, value in zip(POINTS, values, strict=True):
                rows[key].append(value)
    return {key: np.array(values) for key, values in rows.items()}


def curves(model: TemperatureModel) -> dict[str, npt.NDArray[Any]]:
    """Return the functions at temperatures from end to end, one row for each coefficient."""
    T = np.unique(np.concatenate([np.linspace(model.low, model.high, CURVE), model.knots]))
    T = T[~model.outside(T)]
    n = len(model.layout)
    return {
        "coefficient": np.repeat(np.array(model.layout.names), len(T)),
        "temperature": np.tile(T, n),
        "value": model.values(T).T.ravel(),
        "sd": model.sd(T).T.ravel(),
        "sd_next": model.sd(T, scatter=True).T.ravel(),
    }


def ramp_points(
    seen: Seen, model: TemperatureModel, parts: Sequence[tuple[str, FloatArray, FloatArray,
                                                              tuple[str, ...]]]
) -> dict[str, npt.NDArray[Any]]:  # fmt: skip
    """Return one row per part of a ramp and sensor: the bias there, as function and residual.

    `parts`: name of each ramp, temperature of its parts, shape (k,) [K], unit of each sensor's
    evidence, shape (s,) [SI], and the name of the bias of each sensor.
    """
    rows: dict[str, list[Any]] = {"ramp": [], "temperature": [], "coefficient": [], "value": []}
    e = len(seen.names)
    for name, temperature, size, biases in parts:
        for T in temperature:
            off = seen.choice.fit.residuals[e] * size
            for bias, miss in zip(biases, off, strict=True):
                if bias in model.layout:
                    at = float(model.values(T)[model.layout.index(bias)])
                    for key, value in zip(rows, (name, T, bias, at + miss), strict=True):
                        rows[key].append(value)
            e += 1
    return {key: np.array(values) for key, values in rows.items()}
