"""Which functions of temperature are fitted to what: the task, and its solution as a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, Layout
from foucault.errors import error, suggestion
from foucault.estimate.temperature.fit import Evidence
from foucault.estimate.temperature.order import Choice, Spaces, choose
from foucault.models import size_effect
from foucault.models.temperature import TemperatureModel, basis
from foucault.procedures.temperature import evidence
from foucault.procedures.temperature.evidence import Ramp, Session
from foucault.units import ZERO_CELSIUS

HIGHEST = 3
"""Highest power that is tried unless more is asked for [1]."""

SAME = 1.0
"""Sessions whose means are closer than this are at one temperature [K]."""

BY_RAMP = ("gyro.bias", "accel.bias")
"""Families whose change with temperature a ramp alone can tell."""


@dataclass(frozen=True)
class Settings:
    """How to fit."""

    # power of temperature of a family, ``{"gyro.bias": 2}``; "" is for all others. What is not
    # named is told by the evidence [1]
    orders: Mapping[str, int] = field(default_factory=dict)
    knots: tuple[float, ...] = ()  # knots of piecewise linear functions; none for polynomials [K]
    # repeatability of a family from one session to the next, where declared; "" is for all others.
    # What is not named is found with the functions [SI]
    scatter: Mapping[str, float] = field(default_factory=dict)
    reference: float | None = None  # t0; the middle of the range by default [K]
    # how far beyond the temperatures seen the functions are declared to hold [K]
    margin: float = 0.0
    # the sessions are in the order they were made in: compare heating with cooling
    visited: bool = False


@dataclass(frozen=True)
class Task:
    """All that a fit is made of."""

    layout: Layout  # the n coefficients that any session estimates
    # coefficients that sessions have and none estimates, with their values [SI]
    held: Mapping[str, float]
    order: tuple[Coefficient, ...]  # both, in the order of the fullest session
    families: tuple[str, ...]  # families of the n coefficients
    family: npt.NDArray[np.int64]  # (n,) the family of each [1]
    unit: FloatArray  # (n,) typical uncertainty of the family of each [SI]
    spaces: Spaces  # functions that each family may have
    evidence: tuple[Evidence, ...]  # sessions, then parts of ramps
    template: TemperatureModel  # reference, range and knots; no weights yet
    # (families,) at how many temperatures sessions tell each family [1]
    temperatures: npt.NDArray[np.int64]


def task_of(sessions: Sequence[Session], settings: Settings, ramps: Sequence[Ramp]) -> Task:
    """Put together what is to be fitted."""
    order, held = _coefficients(sessions)
    layout = Layout(tuple(c for c in order if c.name not in held))
    named = [family_of(name) for name in layout.names]
    families = tuple(dict.fromkeys(named))
    family = np.array([families.index(f) for f in named], np.int64)
    for given in (*settings.orders, *settings.scatter):
        if given and given not in families:
            raise error("temperature.family", given=given, hint=suggestion(given, families),
                        allowed=", ".join(families))  # fmt: skip
    template = _range(layout, sessions, settings, ramps)
    unit = _units(sessions, layout, family)
    counts = _counts(sessions, layout, family)
    tops = _tops(families, layout, family, counts, settings, ramps)
    spaces = _spaces(tops, family, template, sum(r.readings.shape[1] for r in ramps))
    terms = spaces.constant.shape[1] - 1
    T = np.array([s.temperature for s in sessions])
    turning = 0.5 * heating(T) if settings.visited else np.zeros(len(T))
    each = np.c_[basis(T, terms, template.reference, template.knots), turning]
    parts = [
        np.c_[basis(r.temperature, terms, template.reference, template.knots), 0.5 * r.rising]
        for r in ramps
    ]
    found = evidence.of_sessions(sessions, layout, unit, each, family, spaces.constants)
    found += evidence.of_ramps(ramps, layout, unit, parts, len(families))
    return Task(layout, held, order, families, family, unit, spaces, tuple(found), template,
                counts)  # fmt: skip


def solved(task: Task, settings: Settings) -> Choice:
    """Fit with the orders and scatters that are declared, and find the others."""
    groups = len(task.families) + len(evidence.SENSORS)
    known, wanted = np.zeros(groups), np.zeros(groups, bool)
    wanted[np.concatenate([e.group for e in task.evidence])] = True
    fixed: dict[int, int] = {}
    for f, name in enumerate(task.families):
        declared = settings.scatter.get(name, settings.scatter.get(""))
        if declared is not None:
            unit = task.unit[task.family == f][0]
            known[f], wanted[f] = (declared / unit) ** 2, False
        top = len(task.spaces.nested[f]) - 1
        asked = settings.orders.get(name, settings.orders.get(""))
        asked = top if settings.knots else asked
        if asked is not None:
            fixed[f] = min(asked, top)
    choice = choose(task.evidence, task.spaces, fixed, known, wanted)
    if choice is None:
        raise error("temperature.undetermined", knots=celsius(*task.template.knots) or "none")
    return choice


def model_of(task: Task, choice: Choice) -> TemperatureModel:
    """Return the functions in SI, with what is held and with the highest power that is used."""
    fit, knots = choice.fit, task.template.knots
    whole = Layout(task.order)
    place = np.array([whole.index(name) for name in task.layout.names])
    p = knots.size or max(choice.orders) + 1
    n = len(whole)
    mine = fit.design.coefficient < len(task.layout)
    owner = fit.design.coefficient[mine]
    L = np.zeros((n, p, int(mine.sum())))
    L[place[owner], :, np.arange(len(owner))] = (
        fit.design.weights[mine, :p] * task.unit[owner][:, None]
    )
    weights = L @ fit.theta[mine]
    flat = L.reshape(n * p, -1)
    cov = flat @ fit.cov[np.ix_(mine, mine)] @ flat.T
    for name, value in task.held.items():
        weights[whole.index(name), : p if knots.size else 1] = value
    scatter = np.zeros(n)
    variance = np.where(choice.untold, np.nan, fit.variance)
    scatter[place] = np.sqrt(variance[task.family]) * task.unit
    return replace(task.template, layout=whole, weights=weights, cov=(cov + cov.T) / 2,
                   scatter=scatter)  # fmt: skip


def family_of(name: str) -> str:
    """Return the family of a coefficient: those that differ by their axes only."""
    return name.rpartition(".")[0] or name


def heating(temperature: FloatArray) -> FloatArray:
    """Return 1 where a session is warmer than the one before, -1 where it is colder, shape (m,).

    `temperature` (m,): mean temperature of the sessions in their order [K].
    """
    step = np.sign(np.diff(temperature))
    return np.concatenate([step[:1], step]) if len(step) else np.zeros(len(temperature))


def celsius(*kelvin: float) -> str:
    """Write temperatures `kelvin` [K] for people, in degC."""
    return ", ".join(f"{k - ZERO_CELSIUS:.2f}" for k in kelvin)


def distinct(temperature: FloatArray) -> int:
    """Count temperatures that are not the same.

    `temperature` (m,): temperatures [K].
    """
    rising = np.sort(temperature)
    count, last = 0, -np.inf
    for value in rising:
        if value - last > SAME:
            count, last = count + 1, value
    return count


def _coefficients(
    sessions: Sequence[Session],
) -> tuple[tuple[Coefficient, ...], dict[str, float]]:
    """Return all coefficients in the order of the fullest session, and those that are held."""
    rows: dict[str, Coefficient] = {}
    free: set[str] = set()
    held: dict[str, float] = {}
    for session in sorted(sessions, key=lambda s: -len(s.vector)):
        vector = session.vector
        rows |= {c.name: c for c in vector.layout.coefficients if c.name not in rows}
        for name, value, estimated in zip(vector.names, vector.values, vector.free, strict=True):
            if estimated:
                free.add(name)
            elif held.setdefault(name, float(value)) != value:
                raise error("temperature.held", coefficient=name)
    return tuple(rows.values()), {n: v for n, v in held.items() if n not in free}


def _units(
    sessions: Sequence[Session], layout: Layout, family: npt.NDArray[np.int64]
) -> FloatArray:
    """Return the typical uncertainty of the family of each coefficient [SI]."""
    total, count = np.zeros(len(layout)), np.zeros(len(layout))
    for session in sessions:
        vector = session.vector
        for name, sd, free in zip(vector.names, vector.sd, vector.free, strict=True):
            if free:
                f = family[layout.index(name)]
                total[f] += sd**2
                count[f] += 1
    return np.asarray(np.sqrt(total[family] / count[family]))


def _counts(
    sessions: Sequence[Session], layout: Layout, family: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Return at how many temperatures each family is known: that of its worst known member."""
    out = np.full(int(family.max()) + 1, np.iinfo(np.int64).max)
    for name, f in zip(layout.names, family, strict=True):
        seen = [
            s.temperature
            for s in sessions
            if name in s.vector.layout and s.vector.free[s.vector.layout.index(name)]
        ]
        out[f] = min(out[f], distinct(np.array(seen)))
    return out


def _range(
    layout: Layout, sessions: Sequence[Session], settings: Settings, ramps: Sequence[Ramp]
) -> TemperatureModel:
    """Return where the functions are to hold, with no functions yet."""
    spans = [(s.low, s.high) for s in sessions] + [(r.low, r.high) for r in ramps]
    low, high = min(s[0] for s in spans), max(s[1] for s in spans)
    if distinct(np.array([s.temperature for s in sessions])) < 2 and not ramps:
        raise error("temperature.one", count=len(sessions), span=f"{high - low:.2f}")
    knots = np.array(sorted(settings.knots), float)
    if knots.size and (knots.size < 2 or np.diff(knots).min() < SAME):
        raise error("temperature.knots", given=celsius(*knots), least=f"{SAME:g}")
    low, high = low - settings.margin, high + settings.margin
    if knots.size:
        low, high = max(low, float(knots[0])), min(high, float(knots[-1]))
    reference = 0.5 * (low + high) if settings.reference is None else settings.reference
    if not low <= reference <= high:
        raise error("temperature.asked_outside", given=celsius(reference), low=celsius(low),
                    high=celsius(high))  # fmt: skip
    n = len(layout)
    return TemperatureModel(layout, np.zeros((n, 1)), np.zeros((n, n)), reference, low, high, knots)


def _tops(
    families: tuple[str, ...], layout: Layout, family: npt.NDArray[np.int64],
    counts: npt.NDArray[np.int64], settings: Settings, ramps: Sequence[Ramp],
) -> list[int]:  # fmt: skip
    """Return the number of the largest space that each family may have."""
    tops = []
    for f, name in enumerate(families):
        most = int(counts[f]) - 1
        top = min(HIGHEST, max(most - 1, min(most, 1)))
        if any(n in size_effect.LAYOUT for n, k in zip(layout.names, family, strict=True)
               if k == f):  # fmt: skip
            top = most = 0  # these are taken as constant
        elif name in BY_RAMP and any(name.startswith(t) for r in ramps for t in r.triads):
            top = most = max(top, HIGHEST)
        if settings.knots:
            tops.append(2 if top > 0 else 0)
            continue
        asked = settings.orders.get(name)
        if asked is not None and asked > most:
            raise error("temperature.order", family=name, given=asked, allowed=most,
                        temperatures=int(counts[f]))  # fmt: skip
        asked = min(settings.orders.get("", 0), most) if asked is None else asked
        tops.append(max(top, asked))
    return tops


def _spaces(
    tops: Sequence[int], family: npt.NDArray[np.int64], template: TemperatureModel, constants: int
) -> Spaces:
    """Return the nested functions: powers of temperature, or constant, line and all knots."""
    half, knots = max(0.5 * (template.high - template.low), SAME), template.knots
    if knots.size:
        ones, line = np.ones((1, knots.size)), (knots - template.reference)[None] / half
        all_of = [ones, np.vstack([ones, line]), np.eye(knots.size)]
        all_of = all_of[:2] if knots.size == 2 else all_of
    else:
        powers = np.diag(half ** -np.arange(max(tops) + 1.0))
        all_of = [powers[: k + 1] for k in range(len(powers))]
    padded = [np.c_[space, np.zeros(len(space))] for space in all_of]  # no part in hysteresis
    return Spaces(tuple(tuple(padded[: top + 1]) for top in tops), family, padded[0], constants)
