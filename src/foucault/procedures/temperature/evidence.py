"""What sessions and ramps say of coefficients and their change with temperature.

A **session** is a calibration: its coefficients with their covariance, at its mean temperature.

A **ramp** is a log of the instrument at rest in one position while its temperature changes. The
means over short parts of it say ``reading = constant + H (c(T) - c(T0))`` along each sensor, with H
the derivative of the reading by the coefficients at the specific force of that position. The
constant holds the Earth's rate, gravity, and whatever of the coefficients does not change, and is
of no interest: no attitude is needed, and no level of a bias is found, only its change.

Local gravity that all sessions were given: its error is one, however many sessions there are.

It is taken out of the covariance of every session before functions are fitted, and put back into
that of their constant part: functions that fit sessions all wrong by L are wrong by L themselves,
at every temperature.

Which functions of temperature are fitted to what: the task, and its solution as a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.diagnose.comparable import Site, gravity_errors
from foucault.errors import error, suggestion
from foucault.estimate.fusion import at_most
from foucault.estimate.temperature import Choice, Evidence, Spaces, choose
from foucault.models import size_effect
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import is_imu, of_sensors
from foucault.models.temperature import KELVIN_IN_CELSIUS, TemperatureModel, basis
from foucault.result import Level, Result
from foucault.tables import Log
from foucault.units import ZERO_CELSIUS

PART = 60.0  # Means of a ramp are over about this long [s].
PARTS = (12, 80)  # No fewer and no more means than this in a ramp [1].
SPAN = 2.0  # A log whose temperature changes by less is no ramp [K].

TILTED = 0.5
"""Means of accelerometers that change by more are those of an instrument that was turned [m/s^2].
"""

MOVED = 8.0
"""A part of a ramp that is so many times as noisy as the quietest quarter was no rest [1]."""

SENSORS = ("gyro", "accel")


@dataclass(frozen=True)
class Session:
    """One calibration and its temperature."""

    name: str  # how to call it
    result: Result  # the calibration [SI]
    temperature: float  # mean over the session [K]
    # low, high: lowest and highest in the session [K]
    low: float
    high: float

    @classmethod
    def of(cls, name: str, result: Result, declared: float | None = None) -> Session:
        """Take the temperature from the log of the session, or as declared.

        `declared` or None: where the log has none or says it wrongly [K].
        """
        _suits(name, result)
        if declared is not None:
            plausible(declared, name)
            return cls(name, result, declared, declared, declared)
        span = result.validity.get("temperature")
        if not span or None in span:
            raise error("temperature.unknown", name=name)
        low, high = float(span[0]), float(span[1])
        mean = result.validity.get("temperature_mean")
        # A mean of equal numbers may be off by a bit.
        middle = 0.5 * (low + high) if mean is None else min(max(float(mean), low), high)
        for value in (low, high):
            plausible(value, name)
        return cls(name, result, middle, low, high)

    @property
    def vector(self) -> CoefficientVector:
        """The errors of the sensors."""
        return of_sensors(self.result.coefficients)

    @property
    def dead(self) -> bool:
        """Whether the sensor of temperature never moved in the whole session."""
        measured = self.result.validity.get("temperature_mean") is not None
        return measured and self.low == self.high


@dataclass(frozen=True)
class Ramp:
    """Means over parts of a log at rest whose temperature changes."""

    name: str  # how to call it
    temperature: FloatArray  # (k,) mean of each part [K]
    rising: FloatArray  # (k,) 1 where the temperature rises, -1 where it falls [1]
    readings: FloatArray  # (k, s) means of the sensors: gyros [rad/s], then accelerometers [m/s^2]
    variance: FloatArray  # (k, s) variance of the means by the noise of the samples [unit^2]
    triads: tuple[str, ...]  # which triads the log has
    # low, high: lowest and highest temperature [K]
    low: float
    high: float

    @classmethod
    def of(cls, name: str, log: Log) -> Ramp:
        """Take the means of a log.

        `log`: the instrument at rest in one position [SI].
        """
        T = log.temperature
        if T is None:
            raise error("temperature.no_column", file=name)
        low, high = float(T.min()), float(T.max())
        plausible(low, name)
        plausible(high, name)
        if high - low < SPAN:
            raise error("temperature.no_ramp", name=name, change=f"{high - low:.2f}",
                        least=f"{SPAN:g}")  # fmt: skip
        triads = tuple(t for t in SENSORS if getattr(log, t) is not None)
        data = np.concatenate([getattr(log, t) for t in triads], axis=1)
        count = int(np.clip(round(log.duration / PART), *PARTS))
        cuts = np.linspace(0, len(log), count + 1).astype(int)
        if np.diff(cuts).min() < 2:
            raise error("temperature.short_ramp", name=name, samples=len(log), least=2 * count)
        parts = [slice(a, b) for a, b in pairwise(cuts)]
        means = np.array([data[p].mean(axis=0) for p in parts])
        # Differences of neighbours: the ramp itself is no noise.
        spread = np.array([(np.diff(data[p], axis=0) ** 2).mean(axis=0) / 2 for p in parts])
        _at_rest(name, spread, means[:, 3 * triads.index("accel") :][:, :3] if "accel" in triads
                 else means[:, :0], log.time[cuts[:-1]])  # fmt: skip
        middle = np.array([T[p].mean() for p in parts])
        rising = np.where(np.gradient(middle) >= 0, 1.0, -1.0)
        variance = spread / np.diff(cuts)[:, None]
        # A sensor of few bits repeats itself: the rounding is uncertain all the same.
        variance = np.maximum(variance, 1e-6 * np.median(variance, axis=0) + 1e-30)
        return cls(name, middle, rising, means, variance, triads, low, high)

    def derivative(self, layout: Layout) -> FloatArray:
        """Return the derivative of the readings by the coefficients, shape (s, n) [SI]."""
        force = np.zeros(3)
        if "accel" in self.triads:
            at = 3 * self.triads.index("accel")
            force = self.readings[:, at : at + 3].mean(axis=0)
        out = np.zeros((3 * len(self.triads), len(layout)))
        still = dict(zip(("accel", "gyro"), ImuModel().measure(force, np.zeros(3)), strict=True))
        for i, name in enumerate(layout.names):
            if name not in LAYOUT:
                continue  # lever arms and delay: nothing turns
            one = ImuModel.from_coefficients(CoefficientVector(layout.subset([name]), np.ones(1)))
            said = dict(zip(("accel", "gyro"), one.measure(force, np.zeros(3)), strict=True))
            out[:, i] = np.concatenate([said[t] - still[t] for t in self.triads])
        return out


def plausible(temperature: float, name: str) -> None:
    """Refuse what no instrument has: kelvin said to be degC, or the other way round.

    `temperature`: a temperature of a log [K].
    """
    if not ZERO_CELSIUS - KELVIN_IN_CELSIUS <= temperature <= ZERO_CELSIUS + KELVIN_IN_CELSIUS:
        said = f"{temperature - ZERO_CELSIUS:.1f}"
        raise error("temperature.implausible", name=name, given=said, kelvin=f"{temperature:.1f}")


def of_sessions(
    sessions: Sequence[Session], layout: Layout, unit: FloatArray, basis: FloatArray,
    family: npt.NDArray[np.int64], constants: int,
) -> list[Evidence]:  # fmt: skip
    """Return what sessions say, in units of `unit`.

    `unit` (n,): a typical uncertainty of each [SI]; `basis` (m, b): functions of temperature of
    each session [any]; `family` (n,): the family of each coefficient [1]; `constants`: how many
    constants there are besides the coefficients [1].
    """
    out = []
    for session, phi in zip(sessions, basis, strict=True):
        vector = session.vector
        keep = np.flatnonzero(vector.free)
        at = np.array([layout.index(vector.names[i]) for i in keep], np.int64)
        assert vector.cov is not None
        H = np.zeros((len(keep), len(layout) + constants))
        H[np.arange(len(keep)), at] = 1.0
        cov = vector.cov[np.ix_(keep, keep)] / np.outer(unit[at], unit[at])
        out.append(Evidence(phi, vector.values[keep] / unit[at], cov, H, family[at]))
    return out


def of_ramps(
    ramps: Sequence[Ramp], layout: Layout, unit: FloatArray, basis: Sequence[FloatArray],
    groups: int,
) -> list[Evidence]:  # fmt: skip
    """Return what ramps say, each sensor in units of its own noise.

    `unit` (n,): a typical uncertainty of each [SI]; `basis` (k, b): functions of temperature of
    each part of each ramp [any]; `groups`: number of the group of the gyros, that of the
    accelerometers follows [1].
    """
    constants = sum(r.readings.shape[1] for r in ramps)
    out, first = [], len(layout)
    for ramp, functions in zip(ramps, basis, strict=True):
        s = ramp.readings.shape[1]
        size = np.sqrt(ramp.variance.mean(axis=0))
        H = np.zeros((s, len(layout) + constants))
        H[:, : len(layout)] = ramp.derivative(layout) * unit / size[:, None]
        H[np.arange(s), first + np.arange(s)] = 1.0
        first += s
        group = np.repeat([groups + SENSORS.index(t) for t in ramp.triads], 3)
        for k, phi in enumerate(functions):
            cov = np.diag(ramp.variance[k] / size**2)
            out.append(
                Evidence(phi, (ramp.readings[k] - ramp.readings.mean(axis=0)) / size, cov, H, group)
            )
    return out


def _suits(name: str, result: Result) -> None:
    """Refuse a result that cannot be taken."""
    if not is_imu(result.coefficients) or not len(of_sensors(result.coefficients)):
        raise error("temperature.not_imu", name=name, procedure=result.procedure)
    if result.temperature is not None:
        raise error("temperature.twice", name=name)
    if result.verdict.level is Level.UNUSABLE:
        reasons = " ".join(result.verdict.reasons) or "No reason is given."
        raise error("temperature.unusable", name=name, reasons=reasons)
    vector = of_sensors(result.coefficients)
    sd = vector.sd[vector.free]
    if not (np.isfinite(vector.values).all() and np.isfinite(sd).all() and (sd > 0).all()):
        raise error("temperature.no_covariance", name=name)


def _at_rest(name: str, spread: FloatArray, accel: FloatArray, start: FloatArray) -> None:
    """Refuse a ramp during which the instrument was moved."""
    turned = np.abs(accel - accel[:1]).max(axis=1, initial=0.0)
    if turned.max() > TILTED:
        when = start[int(np.argmax(turned > TILTED))]
        raise error("temperature.turned", name=name, time=f"{when:.0f}",
                    change=f"{turned.max():.2f}")  # fmt: skip
    quiet = np.quantile(spread, 0.25, axis=0)
    noisy = np.sqrt(spread / np.maximum(quiet, 1e-300)).max(axis=1)
    if noisy.max() > MOVED and (quiet > 0).any():
        raise error("temperature.moved", name=name, time=f"{start[int(np.argmax(noisy))]:.0f}",
                    ratio=f"{noisy.max():.0f}")  # fmt: skip


Common = dict[Site, dict[str, float]]
"""Site -> coefficient -> its error per standard deviation of gravity [SI]."""


def taken_out(sessions: Sequence[Session]) -> tuple[list[Session], Common]:
    """Take what all sessions owe to the same gravity out of their covariances.

    Returns the same with covariances of what is their own; unchanged where nothing is common;
    what was taken out, the mean over the sessions [SI].
    """
    vectors = [s.result.coefficients for s in sessions]
    errors = [gravity_errors(s.result, v) for s, v in zip(sessions, vectors, strict=True)]
    sites = [site for site in errors[0] if all(site in one for one in errors)]
    if len(sessions) < 2 or not sites or any(v.cov is None for v in vectors):
        return list(sessions), {}
    shared = [
        _shared(v, np.stack([one[site] for site in sites], axis=1))
        for v, one in zip(vectors, errors, strict=True)
    ]
    alone = [
        replace(s, result=replace(s.result, coefficients=replace(v, cov=v.cov - L @ L.T)))
        for s, v, L in zip(sessions, vectors, shared, strict=True)
        if v.cov is not None
    ]
    common: Common = {}
    for k, site in enumerate(sites):
        said: dict[str, list[float]] = {}
        for vector, L in zip(vectors, shared, strict=True):
            for name, value in zip(vector.names, L[:, k].tolist(), strict=True):
                said.setdefault(name, []).append(value)
        common[site] = {name: float(np.mean(values)) for name, values in said.items()}
    return alone, common


def _shared(vector: CoefficientVector, L: FloatArray) -> FloatArray:
    """Return errors that are part of the covariance: what is held has none."""
    known = np.flatnonzero(vector.sd > 0)
    out = np.zeros_like(L)
    out[known] = at_most(vector.chosen(vector.names[i] for i in known), L[known])
    return out


def put_back(model: TemperatureModel, common: Common) -> TemperatureModel:
    """Return functions whose covariance knows the error of gravity too.

    `model`: the functions fitted to what is the sessions' own; `common`: what was taken out [SI].
    """
    p = model.weights.shape[1]
    ones = np.ones(p) if model.knots.size else np.eye(p)[0]
    cov = model.cov.copy()
    for shared in common.values():
        flat = np.outer([shared.get(name, 0.0) for name in model.layout.names], ones).ravel()
        cov += np.outer(flat, flat)
    return replace(model, cov=cov)


HIGHEST = 3  # Highest power that is tried unless more is asked for [1].
SAME = 1.0  # Sessions whose means are closer than this are at one temperature [K].

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
    found = of_sessions(sessions, layout, unit, each, family, spaces.constants)
    found += of_ramps(ramps, layout, unit, parts, len(families))
    return Task(layout, held, order, families, family, unit, spaces, tuple(found), template, counts)


def solved(task: Task, settings: Settings) -> Choice:
    """Fit with the orders and scatters that are declared, and find the others."""
    groups = len(task.families) + len(SENSORS)
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
    cov = flat @ choice.cov[np.ix_(mine, mine)] @ flat.T
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
