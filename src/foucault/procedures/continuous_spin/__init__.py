"""Calibrate an IMU that is spun on a level axis at several speeds: a screwdriver, no turntable.

Clamp an electric screwdriver or a drill with its axis roughly level, the instrument on the chuck,
and let it run at two or three speeds, one of them backwards, for ten seconds each; then turn the
instrument so that another of its axes is along the spin, twice. No rest, no encoder and no level
are needed: gravity turns in the body once a turn, and its phase is the reference of the gyros.
Lever arm, tilt and azimuth of the axis are nuisance parameters, the phase is eliminated sample by
sample.

Tables of the result
--------------------
``spins``: of every spin ``time`` and ``length`` [s], ``mounting`` [1], ``rate`` [rad/s], ``turns``
[1], ``sway`` of the axis [rad], ``wander`` of the rate [1], noise of a reading ``accel_sd``
[m/s^2] and ``gyro_sd`` [rad/s], ``slip`` of the lever arm [m].
``mountings``: of every mounting the axis ``axis_x`` .. ``axis_z`` [1], ``tilt`` [rad], and the
lever arm ``arm`` [m].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import log
from typing import Any, Literal, get_args

import numpy as np
from pydantic import Field

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect import steady
from foucault.detect.noise import without_spikes
from foucault.detect.steady import Spin
from foucault.diagnose.checks import check, reversed_earth_check
from foucault.diagnose.fit_checks import Judged, Limit, checks
from foucault.errors import Finding, FoucaultError, Status, doubting, error, finding
from foucault.estimate import spin as engine
from foucault.guard.mistakes import exchange_words, exchanges
from foucault.infer import mixed
from foucault.infer.mixed import Fit
from foucault.logs.axes import spared
from foucault.logs.description import OWN_LOG, log_head
from foucault.models.earth import EARTH_RATE
from foucault.models.left_out import Motion
from foucault.models.spin import across
from foucault.plans import limit
from foucault.plans.optimise import StatedSpace
from foucault.procedures import left_out, record, solvable
from foucault.procedures.continuous_spin import model as physics
from foucault.procedures.continuous_spin.model import SCATTER, SPAN, SpinModel
from foucault.procedures.left_out import Again
from foucault.procedures.rate_table.model import Rates, in_si
from foucault.procedures.record import Beforehand, Given, Procedure, result_of
from foucault.result import Check, Result, TableData
from foucault.simulate.spin import Mounting, SpinPlan, simulate_spins
from foucault.strict import Strict
from foucault.tables import AXES, Log, temperature_range
from foucault.units import (
    STANDARD_GRAVITY,
    Angle,
    AngleSd,
    Force,
    Length,
    Rate,
    RatioSd,
    Seconds,
    plain,
)


class Settings(record.Robust, record.EarthRate, record.Terms):
    """What can be chosen; the defaults suit a screwdriver."""

    accel_quadratic: record.Quadratic = True
    g_sensitivity: bool = True
    """Estimate the gyros' g-sensitivity too (9 more)."""
    loss: Literal["robust", "squares"] = "squares"
    """robust: a row that contradicts the others, beyond 3 sd, counts little or nothing;
    squares: all count in full."""
    repeatability: record.Repeatability = True
    shortest: Seconds = Field(default=2.0, gt=0)
    """Shortest spin."""
    slowest: Rate = Field(default=float(np.radians(35.0)), gt=0)
    """Slowest spin."""
    same_mounting: Angle = Field(default=float(np.radians(3.0)), gt=0)
    """Spins about axes that are closer than this, either way, are of one mounting."""


class Session(Strict):
    """The session that `simulate` makes."""

    rates: Rates = Field(default=("230 deg/s", "-400 deg/s", "570 deg/s"), min_length=1)
    """Rates of the spins in each mounting, negative backwards."""
    mountings: tuple[Mounting, ...] = ("x", "y", "z")
    """Axes of the instrument along the spin axis, one mounting after the other."""
    spin_time: Seconds = Field(default=10.0, gt=0)
    """Length of each spin."""
    mounting_sd: AngleSd = Field(default=float(np.radians(3.0)), ge=0)
    """Sd of the axis of a mounting in the body, about each of two axes."""
    tilt_sd: AngleSd = Field(default=float(np.radians(1.5)), ge=0)
    """Sd of the tilt of the spin axis."""
    lever_arm: Length = Field(default=0.02, ge=0)
    """Sd of the lever arm across the axis, each component."""
    wander: RatioSd = Field(default=0.01, ge=0)
    """Sd of the rate, over 3 s."""
    unbalance: RatioSd = Field(default=0.005, ge=0)
    """What the rate varies once a turn."""
    sway: AngleSd = Field(default=0.0, ge=0)
    """Sd of the direction of the axis, over 0.3 s."""
    vibration: Force = Field(default=0.0, ge=0)
    """Rms of the vibration of the tool, each axis."""
    slip: Length = Field(default=0.0, ge=0)
    """By how much the instrument moves in the chuck before the last spin."""
    rate: record.SampleRate = 100.0
    kind: record.Sampling = "rate"

    def plan(self) -> SpinPlan:
        """Return it as it is simulated."""
        return SpinPlan(**self.model_dump() | {"rates": tuple(in_si(self.rates).tolist())})


# -- calibrating -----------------------------------------------------------------------------------


def _read(log: Log, settings: Settings) -> tuple[tuple[Spin, ...], list[FloatArray]]:
    """Return the spins of a log and the axes of its mountings, or say why there are none."""
    for triad in ("gyro", "accel"):
        if len(log.logged(triad)) < 3:
            raise error("spun.no_triad", triad="gyros" if triad == "gyro" else "accelerometers")
    assert log.gyro is not None
    find = partial(steady.find_spins, shortest=settings.shortest, slowest=settings.slowest)
    found = find(log)
    for times in (1.0,) if found else (np.radians(1.0), np.degrees(1.0)):
        tried = found or find(replace(log, gyro=log.gyro * times))
        turning = [r for s in tried if (r := steady.turning(s))]
        if turning and not 0.67 < (ratio := float(np.median(turning)) / times) < 1.5:
            hint = " The gyros are in deg/s." if 50 < ratio < 65 else ""
            hint = " The gyros are in rad/s." if 1 / 65 < ratio < 1 / 50 else hint
            raise error("spun.gyro_unit", ratio=plain(ratio, 3), hint=hint)
    if not found:
        raise error("spun.none", shortest=plain(settings.shortest, 2),
                    turns=plain(steady.TURNS, 1), slowest=plain(settings.slowest, 2))  # fmt: skip
    spins, axes = steady.grouped(found, settings.same_mounting)
    return tuple(spins), axes


def _begun(
    spins: tuple[Spin, ...], axes: list[FloatArray], gravity: float
) -> tuple[FloatArray, ...]:
    """Return the path of every spin to start from; refuse triads that do not belong together."""
    planes = [steady.plane(s) for s in spins]
    units = [w / np.linalg.norm(w) for w in (s.readings[:, 3:].mean(axis=0) for s in spins)]

    def apart(turn: FloatArray) -> float:
        return float(np.median([abs(e @ turn @ n) for e, n in zip(units, planes, strict=True)]))

    if apart(np.eye(3)) < np.cos(np.radians(20.0)):
        best = max(exchanges(), key=apart)
        words = exchange_words(best) if apart(best) > np.cos(np.radians(20.0)) else "something else"
        raise error(
            "spun.axes", angle=f"{np.degrees(np.arccos(apart(np.eye(3)))):.0f}", words=words
        )
    first = [engine.first_phase(s, across(axes[s.mounting])) for s in spins]
    size = float(np.median([f[1] for f in first])) / gravity
    against = sorted({s.mounting for s, f in zip(spins, first, strict=True) if f[2] < 0})
    if against:
        named = " and ".join(AXES[int(np.argmax(np.abs(axes[m])))] for m in against)
        raise error("spun.sense", axes=named, count=len(against), all=len(axes))
    for factor, words in ((gravity, "g"), (1 / gravity, "m/s^2 read as g")):
        if 0.8 < size * factor < 1.25:
            raise error("spun.accel_unit", words=words, size=plain(size * gravity, 3))
    if size < LEVEL:
        raise error("spun.not_level", percent=f"{100 * size:.0f}")
    if size > 1.25:
        raise error("spun.accel_unit", words="another unit", size=plain(size * gravity, 3))
    return tuple(f[0] for f in first)


LEVEL = 0.9  # Part of gravity that has to turn in the body; cos 25 deg [1].


def observe(log: Log, given: Given[Settings]) -> SpinModel:
    """Return the model that a log states."""
    s = given.settings
    log = without_spikes(log)
    spins, axes = _read(log, s)
    noticed = _spared(log, spins)
    for told in noticed:
        if told.code == "log.saturated" and told.severity != "note":
            raise error("spun.saturated", what=told.message)
    paths = _begun(spins, axes, given.site.gravity)
    physics.require_spread(spins, axes)
    stuck = [told for told in noticed if told.code == "log.stuck"]
    with doubting(stuck), solvable():  # how it ends with an axis that is stuck is rounding
        start = engine.started(spins, axes, paths, given.noise)
        solved = engine.solve(spins, start, s.estimated(), given.site, given.noise)
        sway = float(np.median(engine.leaning(solved)[0]))
        if stuck and (sway > SWAYS or not solved.converged):
            raise error("solution.singular", why="no convergence")
        if sway > SWAYS:
            raise error("spun.sways", sway=plain(float(np.degrees(sway)), 2),
                        most=plain(float(np.degrees(SWAYS)), 2))  # fmt: skip
    return SpinModel(solved, physics.rows_of(solved), given.noise, s.repeatability)


def _spared(log: Log, spins: tuple[Spin, ...]) -> tuple[Finding, ...]:
    """Return what the reader found; what is outside of the spins does no harm."""
    used = [(np.array([s.time[0] for s in spins]), np.array([np.ptp(s.time) for s in spins]))]
    return spared(log.findings, log, used, used)


SWAYS = float(np.radians(0.3))  # An axis that moves by more is not clamped [rad].


def _again(model: SpinModel) -> Again:
    """Return the readings of the spins with something put into them."""
    time, f_b, w_b = model.motion
    motion = Motion(time, f_b, w_b, float(time[0]), float(time[-1]))
    white = np.median([z.sd.reshape(2, 3).mean(axis=1) * np.sqrt(s.step)
                       for s, z in zip(model.solved.spins, model.solved.point.sizes, strict=True)],
                      axis=0)  # fmt: skip
    if model.noise is not None:
        white = np.array([model.noise.accel.white, model.noise.gyro.white])

    def residuals(state: FloatArray, by: Any) -> FloatArray:
        return model.linearise(state).residuals + model.changed(by)

    slow = left_out.wander_of(model.noise, float(np.ptp(time)))
    return Again(lambda _: (model.solved.point.model, motion), residuals,
                 (float(white[0]), float(white[1])), slow)  # fmt: skip


def _solve(log: Log, given: Given[Settings]) -> Result:
    given.progress(0.1, "finding the spins")
    log = without_spikes(log)
    model = observe(log, given)
    given.progress(0.7, "judging")
    prior = CoefficientVector.prior(model.layout, given.prior)
    how = {"robust": given.settings.robust}
    fit, judged = left_out.fit(model, prior, given.sizes, given.site, _again(model), **how)
    if judged is not None and not judged.named:
        model = model.without(left_out.likeliest(fit, judged, given.site, _again(model)))
        fit, judged = left_out.fit(model, prior, given.sizes, given.site, _again(model), **how)
    if not model.solved.converged:
        late = replace(fit.estimate, status=Status.NOT_CONVERGED)
        fit = replace(fit, estimate=late)
    slips = physics.slips(model)
    sign = reversed_earth_check(fit.estimate.coefficients, given.site)
    told = (*_upside(log, given, fit), *_spared(log, model.solved.spins), *_told(model))
    own = (*([] if sign is None else [sign]), *_own_checks(model, slips))
    return result_of(
        "continuous_spin", fit, (*checks(_judged(fit, model)), *own),
        site=given.site, findings=told,
        tables=_tables(model, slips) if given.shown else {}, diagnostics={},
        validity={"sampled": log.sampled, "rate": log.rate} | temperature_range(log),
        judged=judged,
    )  # fmt: skip


def _upside(log: Log, given: Given[Settings], fit: Fit) -> tuple[Finding, ...]:
    """Say where gyros that do not fit do so with gravity upside down: the Earth turns unlike."""
    misfit = fit.found.get(SCATTER[1], 0.0)
    if given.site.latitude is None or misfit < MOST:
        return ()
    assert log.accel is not None
    try:
        other = observe(replace(log, accel=-log.accel), given)
    except FoucaultError:
        return ()
    prior = CoefficientVector.prior(other.layout, given.prior)
    then = mixed.fit(other, prior, robust=given.settings.robust).found.get(SCATTER[1], 0.0)
    return (finding("spun.upside", now=plain(misfit, 2)),) if then < misfit / MOST else ()


def _judged(fit: Fit, model: SpinModel) -> Judged:
    spins = model.solved.spins
    names = "accelerometers", "gyros"
    return Judged(
        fit, {n: f"the {n}" for n in names}, "measured",
        np.array([s.time.mean() for s in spins])[model.spin],
        {n: (source,) for n, source in zip(names, SCATTER, strict=True)},
        {source: Limit(f"The noise of the {n} beyond that of their samples", MOST, 1.0, "times it",
                       "an axis that sways, a mounting that slips, or a term that is not estimated")
         for n, source in zip(names, SCATTER, strict=True)},
        readings="rows of the spins", cure="Add spins.", more="repeat the spins",
        blocks=model.spin, named=lambda k: steady.spin_words(spins[k]), predicted="spins",
        said={"azimuth of the axis": "where it was (latitude in [site])"},
    )  # fmt: skip


MOST = 3.0
"""Rows that scatter by more than so many times the noise of the samples are no calibration [1]."""


def _own_checks(model: SpinModel, slips: list[physics.Slip]) -> tuple[Check, ...]:
    at = model.solved
    worst = max(slips, key=lambda s: s.ratio)
    given = {"which": steady.spin_words(at.spins[worst.spin]), "mm": 1e3 * worst.arm,
             "deg": np.degrees(worst.axis)}  # fmt: skip
    sways, slope = engine.leaning(at)
    swaying = float(np.degrees(np.median(sways)))
    chance = 1 + engine.CHANCE * np.sqrt(2 / len(slope))
    leans = float(np.mean(slope[:, 0] ** 2) - chance * np.mean(slope[:, 1] ** 2)) / EARTH_RATE**2
    return (
        check("spin grip", "shift of a spin in its mounting [sd]", worst.ratio, None, HELD, given),
        check("spin sway", "sway of the axis [deg]", swaying, None, CLAMPED),
        check(
            "spin lean", "tilting of the axis [Earth rates]", max(leans, 0.0) ** 0.5, None, LEANS
        ),
    )


HELD = 4.5  # A spin whose grip differs by so many sd from that of its mounting has slipped [1].

LEANS = 1.0
"""An axis that tilts faster, all the while of a spin, looks like g-sensitivity [Earth rates]."""

CLAMPED = 0.1  # An axis that moves by more takes part in the result [deg].


def _told(model: SpinModel) -> list[Finding]:
    """Say what is worth knowing of the tool."""
    sd = max(float(z.sd[:3].max()) for z in model.solved.point.sizes)
    shaken = finding("spun.vibration", mg=plain(1e3 * sd / STANDARD_GRAVITY, 2))
    told = [shaken] if model.vibration.max(initial=0.0) > 0.9 else []
    if model.solved.site.latitude is None:
        unknown = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
        told.append(finding("spun.no_latitude", sd=plain(unknown, 2)))
    return told


def _tables(model: SpinModel, slips: list[physics.Slip]) -> dict[str, TableData]:
    at = model.solved
    spins, sizes = at.spins, at.point.sizes
    wander = [float(np.std(path[:, 1]) / abs(s.rate)) for s, path in
              zip(spins, at.point.paths, strict=True)]  # fmt: skip
    grips = at.point.grips
    return {
        "spins": {
            "time": np.array([s.time[0] for s in spins]),
            "length": np.array([float(np.ptp(s.time)) for s in spins]),
            "mounting": np.array([s.mounting + 1 for s in spins]),
            "rate": np.array([s.rate for s in spins]),
            "turns": np.array([s.turns for s in spins]),
            "sway": engine.leaning(at)[0],
            "wander": np.array(wander),
            "accel_sd": np.array([float(z.sd[:3].mean()) for z in sizes]),
            "gyro_sd": np.array([float(z.sd[3:].mean()) for z in sizes]),
            "slip": np.array([s.arm for s in slips]),
        },
        "mountings": {
            "mounting": np.arange(1, len(grips) + 1),
            **{f"axis_{a}": np.array([g.C_bm[k, 2] for g in grips]) for k, a in enumerate(AXES)},
            "tilt": np.array([g.tilt for g in grips]),
            "arm": np.array([float(np.hypot(*g.arm)) for g in grips]),
        },
    }


# -- which spins are best --------------------------------------------------------------------------

# A plan turns at some speeds, one of them backwards at least, in each of some mountings, and for
# the same time, that which fills the time of the session. It is judged by what a calibration would
# state.

Plan = tuple[float, tuple[str, ...], tuple[float, ...]]
"""Length of a spin [s], mountings, and rates in each of them [deg/s]."""

EVALUATIONS = 12  # Plans that a restart judges: each is a simulated session [1].

MOUNTINGS = tuple(get_args(Mounting))


class Wanted(record.Wanted):
    """What may be changed of spins, and what is wanted."""

    time: Seconds | None = Field(default=None, gt=0, examples=["3 min"])
    """Time of all spins together; left out, that of the session in [simulate]."""
    fastest: Rate | None = Field(default=None, gt=0, examples=["570 deg/s"])
    """Fastest rate of the tool; left out, that of the session."""
    slowest: Rate | None = Field(default=None, gt=0, examples=["100 deg/s"])
    """Slowest rate; left out, that of the session."""
    speeds: int = Field(default=4, ge=2, le=8)
    """Most spins in a mounting."""
    mountings: int = Field(default=4, ge=3, le=7)
    """Most mountings."""


@dataclass(frozen=True)
class Tool:
    """What a tool can do in a session."""

    known: Beforehand[Any, Any]
    time: float  # of all spins together [s]
    slowest: float  # [deg/s]
    fastest: float  # [deg/s]
    speeds: int  # most in a mounting [1]
    mountings: int  # most [1]

    @property
    def words(self) -> str:
        """What is allowed."""
        return (f"up to {self.speeds} speeds of {self.slowest:.4g} to {self.fastest:.4g} deg/s in "
                f"up to {self.mountings} mountings, {units.span(self.time)} in all")  # fmt: skip

    def draw(self, rng: np.random.Generator) -> Plan | None:
        """Return a random plan; None where none was found that calibrates."""
        size = np.exp(rng.uniform(log(self.slowest), log(self.fastest),
                                  int(rng.integers(2, self.speeds + 1))))  # fmt: skip
        sense = np.where(np.arange(len(size)) % 2, -1.0, 1.0)
        many = int(rng.integers(3, self.mountings + 1))
        more = rng.choice(len(MOUNTINGS), many - 3)
        return self.filled(("x", "y", "z", *(MOUNTINGS[k] for k in more)), size * sense)

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        mountings, rates, way = list(plan[1]), np.array(plan[2]), rng.random()
        if way < 0.15:
            if len(mountings) > 3 and rng.random() < 0.5:
                del mountings[int(rng.integers(3, len(mountings)))]
            elif len(mountings) < self.mountings:
                mountings.append(MOUNTINGS[int(rng.integers(len(MOUNTINGS)))])
        elif way < 0.3 and len(rates) > 2:
            rates = np.delete(rates, int(rng.integers(len(rates))))
        elif way < 0.45 and len(rates) < self.speeds:
            rates = np.append(rates, -rates[int(rng.integers(len(rates)))] * rng.uniform(0.5, 1))
        else:
            k = int(rng.integers(len(rates)))
            rates[k] *= np.exp((0.05 + 0.5 * heat) * rng.standard_normal())
        return self.filled(tuple(mountings), rates)

    def filled(self, mountings: tuple[str, ...], rates: FloatArray) -> Plan | None:
        """Return the plan of `rates` (k,) [deg/s] that takes all of the time; None if it cannot."""
        size = np.round(np.clip(np.abs(rates), self.slowest, self.fastest))
        hold = float(int(self.time / len(mountings) / len(rates)))
        both = (rates > 0).any() and (rates < 0).any() and size.max() >= SPAN * size.min()
        if not both or hold < self.known.settings.shortest + 1:
            return None
        return hold, mountings, tuple((size * np.sign(rates)).tolist())


@dataclass(frozen=True, kw_only=True)
class SpinSpace(StatedSpace):
    """The spins that a tool allows."""

    def changes(self, plan: Plan) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file."""
        return {"simulate": _session(plan) | {"spin_time": f"{plan[0]:g} s"}}

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per spin."""
        rows = [(m, f"{w:g}", f"{plan[0]:g}", f"{abs(w) * plan[0] / 360:.3g}")
                for m in plan[1] for w in plan[2]]  # fmt: skip
        return (("along the axis", "rate (deg/s)", "time (s)", "turns"), *rows)

    def needs(self, plan: Plan) -> tuple[limit.Limit, ...]:
        """Return what a plan needs of the tool."""
        rate, most = np.radians([np.abs(plan[2]).max(), self.allowed.fastest]).tolist()
        return (
            limit.Limit("rate", "angular rate", rate, most, "deg/s"),
            limit.Limit("time of all spins", "time", self.duration(plan), self.allowed.time, "s"),
        )

    def duration(self, plan: Plan) -> float:
        """Return the time of all spins [s]."""
        return plan[0] * len(plan[1]) * len(plan[2])


def _session(plan: Plan) -> dict[str, Any]:
    return {"mountings": [*plan[1]], "rates": [f"{w:g} deg/s" for w in plan[2]]}


def _does(known: Beforehand[Any, Any], plan: Plan) -> dict[str, Any]:
    """Return the session that does a plan."""
    told = {name: tuple(some) for name, some in _session(plan).items()} | {"spin_time": plan[0]}
    return {"session": known.session.model_copy(update=told)}


def space(b: Beforehand[Any, Any]) -> SpinSpace:
    """Return the spins among which the best are sought; those of the session are to beat."""
    wanted, session = b.wanted, b.session
    rates = np.degrees(in_si(session.rates))
    reference = (session.spin_time, tuple(session.mountings), tuple(rates.tolist()))
    slow, fast = record.ends(b, np.abs(rates))
    time = wanted.time or session.spin_time * len(session.mountings) * len(rates)
    tool = Tool(b, time, min(slow, fast), max(slow, fast), wanted.speeds, wanted.mountings)
    return record.space_of(SpinSpace, "continuous_spin", b, _does, tool, reference)[0]


PROCEDURE = Procedure(
    name="continuous_spin",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: session.plan(),
    simulation=lambda session, *, settings, model, noise, site, seed: simulate_spins(
        session.plan(), model, noise, site, seed
    ),
    observe=observe,
    by_hand=True,
    again=lambda model, *_: _again(model),
    space=space,
    Wanted=Wanted,
    evaluations=EVALUATIONS,
    names=lambda settings, _: settings.estimated(),
    more="stretches",
    log_table=lambda log: OWN_LOG if log is not None and log.sampled == "increment" else log_head(),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
