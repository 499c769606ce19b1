"""What the planned motion of a tumble will show: simulated without noise, linearised, judged.

The covariance does not depend on the readings, only on motion, noise and prior, so that the
uncertainty of a tumble is known before it is made. The motion depends a little on the errors of
the cluster, which turn it by degrees in an hour, and on where it starts: the usual errors are
taken where [prior] does not name them, and the attitude that [simulate] gives.

A better motion is judged by the same.

From the log of a tumble, and what was said of it, to its solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import tumble as judge
from foucault.diagnose.checks import hardly
from foucault.diagnose.foresight import Extra, Foresight, Leg
from foucault.diagnose.left_out import foretold
from foucault.errors import Finding, Status, error, finding, listed
from foucault.estimate import tumble as estimation
from foucault.estimate import tumble_solution as published
from foucault.estimate.tumble import Fit, Prior, State, Tumble
from foucault.estimate.tumble_solution import Solution, is_slow
from foucault.guard import command
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.left_out import Judgement
from foucault.infer.snooping import NEAR, PLACES, mishaps, uneven
from foucault.models import cluster
from foucault.models.cluster import CONSTANTS, LAYOUT, SOURCE_SYMBOLS, ClusterModel, attitude_of
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.plans.optimise import weights_of
from foucault.plans.tumble import Allowed, Conditions, Step, TorquingPlan, TorquingSpace, needs
from foucault.procedures.left_out import told_beside
from foucault.procedures.platform_tumble.counted import beforehand
from foucault.procedures.platform_tumble.settings import (
    GRADE,
    NOISE,
    PRIOR,
    PlanStep,
    Session,
    Settings,
    draw_errors,
    simulated,
)
from foucault.procedures.record import Beforehand, Stated, checked
from foucault.simulate.tumble import TumbleSimulation
from foucault.strict import Strict
from foucault.tables import AXES, Log
from foucault.units import Seconds, parse

FORETOLD = ("tumble.singular", "tumble.condition", "tumble.azimuth")
"""What is said of a solution that can be said beforehand."""


@dataclass(frozen=True)
class Planned:
    """The planned motion, linearised."""

    given: Beforehand[Settings, Session]  # the plan, and how it will be sampled
    simulation: TumbleSimulation  # the motion, without noise
    solution: Solution  # the bound about what was simulated
    at: str  # where that is, in words
    told: tuple[Finding, ...]  # what was noticed on the way
    judged: Judgement | None = None  # what is made of what is not estimated
    bought: tuple[Extra, ...] = ()  # what it would buy to know that better

    @property
    def sd(self) -> FloatArray:
        """The sd of the 42 constants that a calibration would state, shape (42,) [SI]."""
        return np.asarray(self.solution.coefficients.sd[: len(CONSTANTS)])


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what the planned motion will show."""
    p = planned(b)
    return seen(p, more(p))


def planned(b: Beforehand[Settings, Session], errors: ClusterModel | None = None) -> Planned:
    """Simulate the planned motion without noise, and linearise it.

    `errors`: errors of the cluster, None takes the means in the prior and usual errors elsewhere.
    """
    settings, session, site, prior = b.settings, b.session, b.site, b.prior
    told = []
    if settings.filter != "gauss-newton":
        if settings.delay_sd:
            raise error("tumble.filter_delay", filter=settings.filter)
        told.append(finding("preflight.filter", filter=settings.filter))
    noise = b.noise or ImuNoise()
    if not noise.accel.white > 0:
        noise = replace(noise, accel=replace(noise.accel, white=NOISE.accel.white))
        given = f"{NOISE.accel.white / 9.80665e-6:.3g}"
        told.append(finding("preflight.noise", given=given))
    made = _simulated(settings, session, site, errors or _usual(prior))
    command.require_readings(made.log, site, settings.rate_limit)
    used, said = noise_of(made.log, noise)
    tumble, more = tumble_of(made.log, site, settings, used)
    known = prior_of(settings, site, prior)
    truth = State(made.C_pn[0].T, made.model.packed(site.gravity))
    fit = estimation.bound(tumble, known, truth)
    away = ", ".join(session.attitude)
    usual = "means in [prior], usual errors elsewhere" if prior else "usual errors"
    at = f"{usual}, and an attitude ({away}) from `start`"
    solution = Solution(tumble, known, fit, site, used, settings.latitude_sd, settings.angles)
    out = Planned(b, made, solution, at, (*told, *said, *more))
    sizes = told_beside(b.sizes, used, float(np.ptp(made.log.time)))
    if not sizes or settings.filter != "gauss-newton":
        return out
    solution, judged, bought = beforehand(solution, sizes)
    return replace(out, solution=solution, judged=judged, bought=bought)


def _simulated(
    settings: Settings, session: Session, site: Site, errors: ClusterModel
) -> TumbleSimulation:
    """Simulate with nothing drawn: given errors, the attitude of the session, no delay."""
    sure = settings.model_copy(update={"latitude_sd": 0.0, "delay_sd": 0.0})
    steady = {"attitude_sd": 0.0, "delay": 0.0, "integrator": "exponential"}
    return simulated(
        session.model_copy(update=steady), settings=sure, model=errors, noise=ImuNoise(),
        site=site, seed=0,
    )  # fmt: skip


def _usual(prior: Mapping[str, tuple[float, float]]) -> ClusterModel:
    """Return errors of usual size and sign, or the means that `prior` gives."""
    usual = [SOURCE_SYMBOLS[n][1] * PRIOR[n.rpartition(".")[0]][1] for n in CONSTANTS.names]
    said = CoefficientVector.prior(CONSTANTS, prior)
    values = np.where(np.isfinite(said.prior_sd), said.values, usual)
    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, values))


def seen(p: Planned, extras: tuple[Extra, ...] = ()) -> Foresight:
    """Return what the planned motion will show."""
    settings, found = p.given.settings, p.solution.coefficients
    shown = judge.observability_json(p.solution)
    told = [f for f in judge.of_motion(p.solution) if f.code in FORETOLD]
    names = hardly(found)
    if names:
        told.insert(0, finding("preflight.unseen", count=len(names), names=", ".join(names)))
    # The legs with what is seen at the end of each.
    grown = shown["growth"]
    out = []
    for leg in shown["legs"]:
        last = int(np.searchsorted(grown["until"], leg["end"] + 1e-6, side="right")) - 1
        x, y, z = leg["rate"]
        rank, alone = grown["rank"][last], grown["alone"][last]
        out.append(Leg(leg["start"], leg["end"], (x, y, z), rank, alone))
    plan, legs = p.simulation.plan, tuple(out)
    return Foresight(
        coefficients=found,
        linearised_at=p.at,
        plan=plan.name,
        duration=plan.duration,
        fastest=float(np.abs(plan.rates).max()),
        rate_limit=settings.rate_limit,
        states=shown["states"],
        rank=legs[-1].rank,
        smallest=shown["smallest"],
        legs=legs,
        limits=needs(plan, settings.limits),
        more=(*p.bought, *extras),
        left_out=None if p.judged is None else foretold(p.judged),
        hardly=tuple(names),
        unseen=tuple(shown["unseen"]),
        remaining=tuple(shown["remaining"]),
        weakest=tuple(shown["weakest"]),
        correlated=tuple((a, b, value) for a, b, value in shown["correlated"]),
        singular=any(f.code == "tumble.singular" for f in told),
        findings=(*p.told, *told),
    )


LONGER = 300.0  # How much longer a plan is made to see what that would buy [s].


def more(p: Planned) -> tuple[Extra, ...]:
    """Return what five more minutes would buy: about the best axis, and at rest."""
    settings, plan, before = p.given.settings, p.simulation.plan, p.sd
    fastest = float(np.abs(plan.rates).max())
    possible = _possible(plan, settings)
    moved, rest = list[Extra](), list[Extra]()
    for sign, axis in ((0.0, 0), *product((1.0, -1.0), range(3))):
        longer = replace(plan, steps=(*plan.steps, Step(sign * fastest * np.eye(3)[axis], LONGER)))
        if possible and not _possible(longer, settings):
            continue
        after = planned(replace(p.given, settings=with_plan(settings, longer)))
        words = f"about {'+-'[sign < 0]}{AXES[axis]} at {np.degrees(fastest):.4g} deg/s"
        what = f"five more minutes {words if sign else 'at rest'}"
        ratio = after.sd / before
        (moved if sign else rest).append(Extra.of(what, LONGER, CONSTANTS.names, ratio))
    return (*sorted(moved, key=lambda extra: extra.ratio)[:1], *rest)


def _possible(plan: TorquingPlan, settings: Settings) -> bool:
    return all(limit.kept for limit in needs(plan, settings.limits))


def with_plan(settings: Settings, plan: TorquingPlan) -> Settings:
    """Return settings that do a plan, whatever limits they have.

    `plan`: what is to be done instead of their plan.
    """
    steps = tuple(
        PlanStep.model_validate(
            {"rate": [f"{v!r} rad/s" for v in step.rate.tolist()], "time": f"{step.time!r} s"}
        )
        for step in plan.steps
    )
    none = {"plan": None, "rate": None, "segment": None, "rate_limit": None}
    return settings.model_copy(update={**none, "steps": steps})


LATITUDES = ("0 deg", "28 deg", "40 deg", "60 deg")
"""Where plans are compared beside the site itself."""

HERE = "the site"


def _latitude(text: str) -> float:
    latitude = parse(text, "angle", "latitudes")
    if abs(latitude) > np.pi / 2:
        raise error("optimise.latitude", given=np.degrees(latitude))
    return latitude


class Wanted(Strict):
    """What a better motion may do."""

    axes: Literal["x", "y", "z", "xy", "xz", "yz", "xyz"] = "xyz"
    """Axes of the cluster that may be turned."""
    rates: tuple[str, ...] = Field(default=(), examples=[["0.1 deg/s", "0.2 deg/s"]])
    """Rates about an axis that may be chosen; left out, `rate_limit`, or the largest rate of the
    plan to beat."""
    together: bool = False
    """Whether several axes may turn at once, each at that rate."""
    total: Seconds | None = Field(default=None, gt=0, examples=["5400 s"])
    """Time there is; left out, that of the plan to beat."""
    shortest: Seconds = Field(default=60.0, ge=0)
    """Shortest time at one rate."""
    worst: float = Field(default=1.5, gt=0)
    """No coefficient that counts should get worse than so many times its sd under the plan to beat;
    ignored where the rig cannot do that plan."""
    latitudes: Annotated[tuple[str, ...], checked(lambda given: [*map(_latitude, given)])] = (
        LATITUDES
    )
    """Where the plan found is compared, beside the site."""
    truths: int = Field(default=4, ge=0)
    """With so many drawn clusters the plan found is compared."""
    weights: dict[str, float] = Field(
        default={}, examples=[{"gyro.drift": 2.0, "accel.quadratic": 0.0}]
    )
    """How much coefficients or groups of them count; 1 if left out."""


def in_case(b: Beforehand[Settings, Session], plan: TorquingPlan, case: str) -> Planned:
    """Return a motion, linearised at the site, at the latitude or for the cluster of a case."""
    drawn = None
    kind, _, number = case.partition(" ")
    if kind == "latitude":
        b = replace(b, site=replace(b.site, latitude=_latitude(number)))
    elif kind == "cluster":
        drawn = draw_errors(GRADE, int(number))
    return planned(replace(b, settings=with_plan(b.settings, plan)), drawn)


def _stated(b: Beforehand[Settings, Session], plan: TorquingPlan, case: str) -> FloatArray:
    """Return the sd of the 42 constants: bound, slow noise, latitude and gravity [SI]."""
    return in_case(b, plan, case).sd


def space(b: Beforehand[Settings, Session]) -> TorquingSpace:
    """Return the motions that are allowed; the plan to beat is the campaign's, or the published."""
    settings, site, wanted = b.settings, b.site, b.wanted
    weights = weights_of(CONSTANTS, wanted.weights)
    reference = settings.planned
    allowed = Allowed(
        rates=_rates(settings, wanted, reference),
        axes=wanted.axes,
        together=wanted.together,
        total=wanted.total or sum(step.time for step in reference.steps),
        shortest=wanted.shortest,
        start=settings.angles,
        ramp=settings.ramp,
        limits=settings.limits,
    )
    p = in_case(b, reference, HERE)
    assert site.latitude is not None
    t, prior = p.solution.tumble, p.solution.prior
    conditions = Conditions(
        w_ie_n=earth_rate_n(site.latitude),
        constants=p.simulation.model.packed(site.gravity),
        prior_sd=prior.unit,
        C_np=np.ascontiguousarray(p.simulation.C_pn[0].T),
        gyro_psd=t.gyro_psd,
        accel_psd=t.accel_variance * float(t.dt[0]),
        arms=t.arms,
        gravity=site.gravity,
    )
    possible = all(limit.kept for limit in needs(reference, settings.limits))
    cases = [HERE, *(f"latitude {text}" for text in dict.fromkeys(wanted.latitudes))]
    cases += [f"cluster {k}" for k in range(1, wanted.truths + 1)]
    return TorquingSpace(
        allowed=allowed,
        conditions=conditions,
        names=CONSTANTS.names,
        kinds=tuple(c.kind for c in CONSTANTS.coefficients),
        weights=weights,
        reference=reference,
        reference_name=reference.name,
        reference_sd=np.sqrt(np.diag(p.solution.fit.start_cov))[3:45] / prior.unit[3:45],
        worst=wanted.worst if possible else np.inf,
        cases=tuple(cases),
        stated=Stated(b, _stated),
        findings=p.told,
    )


def _rates(settings: Settings, wanted: Wanted, reference: TorquingPlan) -> tuple[float, ...]:
    limit = settings.rate_limit
    usual = (limit or float(np.abs(reference.rates).max()),)
    rates = tuple(parse(text, "angular rate", "optimise.rates") for text in wanted.rates)
    for rate in rates or usual:
        if not 0 < rate <= (limit or np.inf) * (1 + 1e-9):
            known = "any" if limit is None else f"up to {np.degrees(limit):.4g} deg/s"
            raise error("optimise.rate", given=f"{np.degrees(rate):.4g}", limit=known)
    return tuple(dict.fromkeys(rates or usual))


WANDER = 0.01  # Share of the variance of an average that wandering within it may add [1].

COARSE = np.radians(5.0)
"""Over an average the cluster turns less than this, where its slopes are taken at the middle [rad].
"""


def noise_of(log: Log, noise: ImuNoise | None) -> tuple[ImuNoise, list[Finding]]:
    """Return the noise, and where it comes from where it was not declared."""
    told = []
    accel, gyro = (TriadNoise(), TriadNoise()) if noise is None else (noise.accel, noise.gyro)
    if not accel.white > 0:
        white = judge.measured_white(log)
        accel = replace(accel, white=white)
        told.append(finding("tumble.measured", given=f"{white / 9.80665e-6:.3g}"))
    if not gyro.white > 0:
        gyro = replace(gyro, white=NOISE.gyro.white)
        given = np.degrees(gyro.white) * 60.0
        told.append(finding("tumble.noise", given=f"{given:.3g}"))
    if is_slow(accel) or is_slow(gyro):
        told.append(finding("tumble.slow_noise"))
    else:
        told.append(finding("tumble.white", minutes=f"{log.duration / 60:.0f}"))
    return ImuNoise(accel, gyro), told


def tumble_of(
    log: Log, site: Site, settings: Settings, noise: ImuNoise
) -> tuple[Tumble, list[Finding]]:
    """Turn rows into intervals, and choose how many are averaged."""
    assert log.gyro is not None and log.accel is not None and site.latitude is not None
    command = log.gyro[:-1] if settings.held(log.sampled) == "from its time" else log.gyro[1:]
    reading = log.accel[1:] / site.gravity
    out = judge.outlying(log, noise.accel.white / np.sqrt(log.interval))
    used: BoolArray = np.asarray(np.isfinite(reading).all(axis=1)) & ~out[1:]
    if settings.mask_edges:
        used &= ~judge.edges(log.time, command, settings.mask_edges)
    if int(used.sum()) <= len(LAYOUT):
        raise error("tumble.too_short", given=int(used.sum()), wanted=len(LAYOUT))
    interval = log.interval
    summed, psd = log.sampled == "increment", noise.gyro.white**2
    variance = noise.accel.white**2 / interval / site.gravity**2
    rounded = noise.accel.quantisation**2 / 12 / site.gravity**2
    if summed:  # attitude wanders within the mean
        variance += psd * interval / 12
    else:
        variance += rounded
    block, told = _block(settings.average, interval, command, psd, variance)
    shared = 0.0
    if summed and rounded:  # it is carried on: it counts at both ends of an average
        variance += 2 * rounded / block
        shared = -rounded / block / variance
    tumble = Tumble(
        dt=np.diff(log.time),
        command=np.ascontiguousarray(command),
        reading=np.where(used[:, None], reading, 0.0),
        used=used,
        w_ie_n=earth_rate_n(site.latitude),
        gravity=site.gravity,
        gyro_psd=psd,
        accel_variance=variance,
        arms=settings.lever_arms,
        mean=summed,
        block=block,
        shared=shared,
    )
    if out.any():
        told.append(finding(
            "tumble.outliers", count=int(out.sum()), share=f"{100 * out.mean():.2g}",
            time=f"{log.time[np.argmax(out)]:.6g}",
        ))  # fmt: skip
    masked = np.flatnonzero(~np.isfinite(log.accel).all(axis=1))
    if len(masked):
        told.append(finding("tumble.masked", count=len(masked), time=f"{log.time[masked[0]]:.6g}"))
    return tumble, told


def _block(
    average: float, interval: float, command: FloatArray, psd: float, variance: float
) -> tuple[int, list[Finding]]:
    """Choose how many readings are averaged to one residual."""
    block = max(1, round(average / interval))
    speed = float(np.linalg.norm(command, axis=1).max())
    far = max(1, int(COARSE / (speed * interval)))
    # Within an average of time T the attitude wanders by psd T / 12.
    calm = max(1, int(np.sqrt(12 * WANDER * variance / max(psd * interval, 1e-300))))
    if block <= min(far, calm):
        return block, []
    why = f"the cluster turns by {np.degrees(speed * block * interval):.3g} deg"
    if calm < far:
        why = "noise of the gyros turns it by more than the readings scatter"
    block = min(far, calm)
    given = f"{block * interval:.4g}"
    return block, [finding("tumble.average", asked=f"{average:.4g}", why=why, given=given)]


def prior_of(settings: Settings, site: Site, given: Mapping[str, tuple[float, float]]) -> Prior:
    """Return what is known beforehand, in the units of the kernels.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    known = CoefficientVector.prior(CONSTANTS, {**PRIOR, **given})
    factor = cluster.normalised(site.gravity)
    sd = np.concatenate(
        [
            [settings.start_sd, settings.start_sd, settings.azimuth_sd],
            known.prior_sd * factor,
            [settings.delay_sd],
        ]
    )
    start = attitude_of(settings.angles).T
    return Prior(State(start, known.values * factor), sd)


def shifted(tumble: Tumble, prior: Prior, rows: int) -> tuple[Tumble, Prior]:
    """Return log and prior as if each reading had come `rows` intervals later.

    `prior`: what is known beforehand, of the delay too; `rows`: whole intervals of the delay,
    which readings are put back by [1].
    """
    order = np.arange(len(tumble.dt)) + rows
    there = (order >= 0) & (order < len(order))
    order = np.clip(order, 0, len(order) - 1)
    late = rows * float(np.median(tumble.dt))
    back = replace(tumble, reading=tumble.reading[order], used=tumble.used[order] & there)
    return back, replace(prior, mean=replace(prior.mean, delay=prior.mean.delay - late))


ENOUGH = 200  # Rows of which noise is even enough to tell what stands out [1].
SHORT = 0.05  # What does not belong to the others in more than this share is no mishap [1].
SHIFTS = 4  # So often a delay is put back by whole intervals [1].
SEARCHED = 4  # Azimuths tried where the first start leads nowhere [1].
BETTER = 3.0  # A command relative to the ground must fit so many times better to be spoken of [1].


def solved(
    tumble: Tumble, prior: Prior, settings: Settings, site: Site, noise: ImuNoise, *,
    measured: bool = False, moments: int = 0,
) -> Solution:  # fmt: skip
    """Solve a tumble by the filter that was chosen.

    `measured`: the noise of the accelerometers was measured: what the fit leaves says it better;
    `moments`: in how many moments the estimate is kept for its course in time [1].
    """
    told, advice = list[Finding](), ""
    if settings.filter == "gauss-newton":
        slow = is_slow(noise.accel) or is_slow(noise.gyro)
        fit, tumble, prior, told = _solve(tumble, prior, settings, slow=slow)
        if measured and fit.status is Status.CONVERGED:
            scale = fit.chi_square / max(fit.residuals - len(LAYOUT), 1)
            tumble = replace(tumble, accel_variance=tumble.accel_variance * scale)
            fit = estimation.linearised(tumble, prior, fit)
        elif not _explains(fit):
            told += _relative(tumble, prior, fit, settings)
        if moments and len(fit.time):
            fit = estimation.linearised(tumble, prior, fit, moments=moments)
        least = None
    else:
        fit, least, advice = _filter(tumble, prior, settings.filter, moments)
        told.append(finding("tumble.filter", filter=settings.filter, advice=advice))
    return Solution(tumble, prior, fit, site, noise, settings.latitude_sd, settings.angles, least,
                    advice, tuple(told))  # fmt: skip


def _relative(tumble: Tumble, prior: Prior, fit: Fit, settings: Settings) -> list[Finding]:
    """Try whether the command is one relative to the ground."""
    C_pn, rows = prior.mean.C_np.T, []
    for turn in exp(-tumble.command * tumble.dt[:, None]):
        rows.append(C_pn @ tumble.w_ie_n)
        C_pn = turn @ C_pn
    other = estimation.solve(
        replace(tumble, command=tumble.command + np.array(rows)), prior, passes=settings.passes
    )
    if other.status is not Status.CONVERGED:
        return []
    times = np.sqrt(fit.chi_square / max(other.chi_square, 1e-300))
    if fit.status is Status.CONVERGED and times < BETTER:
        return []
    if other.chi_square > BETTER**2 * other.residuals:
        return []
    return [finding("tumble.relative", times=f"{times:.3g}")]


def _solve(
    tumble: Tumble, prior: Prior, settings: Settings, *, slow: bool
) -> tuple[Fit, Tumble, Prior, list[Finding]]:
    """Solve, from other azimuths too where the first start does not explain the readings.

    What does not belong to the others for a moment is left out, and said; where noise is `slow`,
    it looks like that too.

    A delay of more than half an interval is put back by whole ones, so that what is left of it is
    small enough to be linear; log and prior are returned as they were solved.
    """
    fit = estimation.solve(tumble, prior, passes=settings.passes)
    if not _explains(fit):
        other = _elsewhere(tumble, prior, settings)
        worse = fit.status is not Status.CONVERGED
        if other is not None and (worse or other.chi_square < 0.5 * fit.chi_square):
            fit = other
    for _ in range(SHIFTS if settings.delay_sd else 0):
        # What is left must be no less than zero: before it, another command may have held.
        rows = int(np.floor(fit.start.delay / float(np.median(tumble.dt)) + 0.01))
        if rows == 0:
            break
        tumble, prior = shifted(tumble, prior, rows)
        fit = estimation.solve(tumble, prior, passes=settings.passes)
    if slow or (calm := _without_mishaps(tumble, prior, fit, settings.passes)) is None:
        return fit, tumble, prior, []
    return calm[1], calm[0], prior, [_of_mishaps(tumble, calm[0])]


def _without_mishaps(
    tumble: Tumble, prior: Prior, fit: Fit, passes: int
) -> tuple[Tumble, Fit] | None:
    """Leave out readings that do not belong to the others for a moment; None where none do.

    So few that the others are even.
    """
    b, q = fit.rows.shape[:2]
    if b < ENOUGH or fit.chi_square < chi_square_limits(fit.residuals)[1]:
        return None
    if not uneven(np.sum(fit.rows[..., -1] ** 2, axis=1), q)[0]:
        return None
    (miss, slope), on = prior.rows(fit.start), prior.sought
    slope = slope[np.ix_(on, on)]
    found = mishaps(fit.rows[..., -1], fit.rows[..., on], slope.T @ slope, slope.T @ miss[on])
    # The time of a row is the mean of its readings.
    row = np.searchsorted((fit.time[1:] + fit.time[:-1]) / 2, tumble.time)
    jumps = np.unique(row[~tumble.used])  # with which a knock begins and ends
    best = None
    for first in (jumps[np.diff(jumps, prepend=-b) > SHORT * b], found):
        length = 1
        while 0 < len(first) <= PLACES and len(first) * length <= SHORT * b:
            far = ((row >= first[:, None]) & (row < first[:, None] + length)).any(axis=0)
            used = tumble.used & ~far
            calm = replace(tumble, used=used, reading=np.where(used[:, None], tumble.reading, 0.0))
            left = estimation.solve(calm, prior, fit.start, passes=passes)
            square = np.sum(left.rows[..., -1] ** 2, axis=1)
            spoilt, limit = uneven(square, q) if _explains(left) else (True, 0.0)
            if not spoilt:
                best = best or (calm, left)
                beside = np.searchsorted(left.time, fit.time[first])[:, None] + np.arange(-2, 5)
                if square[np.clip(beside, 0, len(square) - 1)].max() < limit:
                    return calm, left
            length += 1 + length // 2
    return best


def _of_mishaps(tumble: Tumble, calm: Tumble) -> Finding:
    """Say which readings of a tumble were left out to make it `calm`."""
    at, n = np.flatnonzero(tumble.used & ~calm.used), len(tumble.used)
    ends = np.flatnonzero(np.diff(at) > NEAR * n)
    first, last = at[np.append(0, ends + 1)], at[np.append(ends, len(at) - 1)]
    t = tumble.time
    when = listed([f"{t[a]:.6g} to {t[b]:.6g} s" for a, b in zip(first, last, strict=True)])
    return finding("tumble.mishap", count=len(at), share=f"{100 * len(at) / n:.2g}", when=when)


def _explains(fit: Fit) -> bool:
    return fit.status is Status.CONVERGED and fit.chi_square < 2 * fit.residuals


def _elsewhere(tumble: Tumble, prior: Prior, settings: Settings) -> Fit | None:
    """Search the azimuth that was said to be known: it may be wrong by any angle."""
    wide = replace(prior, sd=np.concatenate([[np.pi] * 3, prior.sd[3:]]))
    level = estimation.levelled(tumble, prior)
    found = []
    for k in range(1, SEARCHED + 1):
        about = exp(np.array([0.0, 0.0, 2 * np.pi * k / SEARCHED]))
        start = replace(level, C_np=about @ level.C_np)
        found.append(estimation.solve(tumble, wide, start, passes=settings.passes))
    good = [fit for fit in found if _explains(fit)]
    if not good:
        return None
    best = min(good, key=lambda fit: fit.chi_square)
    return estimation.solve(tumble, prior, best.start, passes=settings.passes)


def _filter(tumble: Tumble, prior: Prior, name: str, moments: int) -> tuple[Fit, FloatArray, str]:
    """Run a published filter; return it as a solution, the bound, and what to say of it."""
    if prior.sd[-1] > 0:
        raise error("tumble.filter_delay", filter=name)
    options = published.LITERAL if name == "published literal" else published.ANNEALED
    found = published.filter_angles(tumble, prior, options, moments=max(moments, 2))
    start = estimation.beginning(tumble, prior, found.constants, found.C_np)
    at = estimation.bound(tumble, prior, start, rows=True)
    cov = np.zeros_like(at.cov)
    cov[:45, :45] = found.cov
    history = published.history(tumble, found, start) if moments else None
    fit = replace(
        at,
        C_np=found.C_np,
        cov=cov,
        status=found.status,
        passes=1,
        late=(0.0, 0.0),
        history=history,
    )
    return fit, at.cov, found.advice
