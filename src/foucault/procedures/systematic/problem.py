"""From the log of a systematic calibration and what was said of it to what the filter takes.

Solve a systematic calibration, and name what was found.

What a calibration is worth in navigation: a spin and a long rest, with it and without.

The navigation test of the source: x up, y east, z north; ten turns at 18 deg/s about east or north,
then 500 s of rest. The instrument is the one that was found; it is compensated by coefficients that
differ from its own as the covariance allows, one draw, so that what remains is no more nor less
than what is promised. Noise is left out: it is the same either way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Prior
from foucault.detect.noise import measure_noise
from foucault.detect.sequence import FoundSequence, find_sequence, require_triads
from foucault.diagnose.noise_at_rest import NoiseAtRest, noise_at_rest
from foucault.diagnose.systematic_sequence import Matched, match_sequence, recognised
from foucault.errors import Finding, FoucaultError, Status, error, finding
from foucault.estimate.systematic import (
    AtRest,
    Start,
    SystematicModel,
    attitude_at_start,
    second_step,
)
from foucault.guard.rest import check_sequence, held_still, require_live
from foucault.infer.filtered import exchanged
from foucault.models import imu, size_effect
from foucault.models.deflection import GENERAL, DeflectionModel
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.layouts import model_of
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import log as rotation_vector
from foucault.models.size_effect import SizeEffect
from foucault.navigate.align import Alignment, align
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.ins_filter import FilterRun, start_cov
from foucault.navigate.strapdown import State, navigate
from foucault.plans.sequence import built_in, navigation_test
from foucault.procedures.systematic.settings import FIRST_REST, PRIOR, Settings
from foucault.simulate.systematic import SystematicSimulation, simulate_systematic
from foucault.tables import Log

WIDER = 3.0
"""The alignment is from readings that the filter goes through again: its uncertainty is widened by
so much that it hardly counts beside them, and says only where to linearise [1]."""

UNKNOWN_HEADING = np.radians(20.0)
"""The heading is no guide if the biases leave it more uncertain than this [rad]."""


@dataclass(frozen=True)
class Begun:
    """How a recording begins."""

    first: int  # row at whose end the filter starts [1]
    start: Alignment  # attitude at its first rest
    phi_sd: FloatArray  # (3,) uncertainty of it that the filter starts with, E N U [rad]


@dataclass(frozen=True)
class SystematicProblem:
    """What is solved."""

    increments: Increments  # the log as measured
    site: Site  # where it stood; the latitude is known
    sensors: Sensors
    rests: tuple[tuple[int, int], ...]  # first and last row of each rest that is used [1]
    numbers: IntArray  # (m,) which rests of the log they are, from 0 [1]
    found: FoundSequence  # rests and turns of the log
    matched: Matched | None  # the log against the sequence, where one is declared
    start: Alignment  # attitude at the first rest
    phi_sd: FloatArray  # (3,) uncertainty of it that the filter starts with, E N U [rad]
    prior: CoefficientVector  # what is known of the coefficients beforehand [SI]
    noise: ImuNoise  # white noise: as declared, or as the rests show where that is more [SI]
    seen: NoiseAtRest  # what the rests show of it
    measured: bool  # whether the noise was measured in the rests
    at_rest: AtRest  # what is known at rest
    findings: tuple[Finding, ...]
    # further recordings, where files recorded one by one are calibrated together
    further: tuple[Begun, ...] = ()

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return 1 + len(self.further)

    @property
    def begun(self) -> list[tuple[FloatArray, FloatArray]]:
        """Attitude at the start of every recording [1], and its uncertainty, E N U [rad]."""
        return [(b.start.C_nb, b.phi_sd) for b in self._recordings]

    @property
    def _recordings(self) -> list[Begun]:
        return [Begun(self.first, self.start, self.phi_sd), *self.further]

    @property
    def model(self) -> SystematicModel:
        """All that a pass of the filter takes, but for where it begins."""
        return SystematicModel(self.increments, self.site, self.sensors, self.rests, self.noise,
                               self.at_rest)  # fmt: skip

    def starts(self, begun: Sequence[tuple[FloatArray, FloatArray]]) -> list[Start]:
        """Return the starts of all recordings.

        `begun` (3, 3): attitude at the start of every recording [1] and its uncertainty, E N U
        [rad].
        """
        return [
            Start(b.first, C_nb, self.start_cov(np.minimum(b.phi_sd, phi_sd))[:9, :9])
            for b, (C_nb, phi_sd) in zip(self._recordings, begun, strict=True)
        ]

    @property
    def first(self) -> int:
        """Row at whose end the filter starts."""
        return self.rests[0][0]

    def start_cov(self, phi_sd: FloatArray | None = None) -> FloatArray:
        """Return the covariance at the start, shape (9 + p, 9 + p) [SI].

        `phi_sd` (3,): uncertainty of the attitude, None for the one of the problem [rad].
        """
        phi, rest = self.phi_sd if phi_sd is None else phi_sd, self.at_rest
        return start_cov(np.diag(phi**2), rest.velocity_sd, rest.position_sd, self.prior.prior_sd)


def problem_of(
    log: Log,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None,
    given: Prior,
) -> SystematicProblem:
    """Find rests and turns, check them, and align.

    `noise`: noise as declared [SI], None measures the white noise in the rests.
    """
    require_place(site, "a systematic calibration")
    require_triads(log)
    require_live(log)
    found, matched, told = _found(log, site, settings)
    numbers = np.flatnonzero(found.still)
    rests = tuple((int(found.rests.first[k]), int(found.rests.last[k]) - 1) for k in numbers)
    # Refuse rests in which less than two measurements are made.
    lasts = np.array([(b - a) * log.interval for a, b in rests])
    if lasts.min() < 2 * settings.interval:
        raise error("systematic.interval", interval=f"{settings.interval:g}",
                    rest=f"{lasts.min():.0f}", number=int(np.argmin(lasts)) + 1)  # fmt: skip
    calm = _bridged(log, found.rests.spans)
    increments = Increments.chained(
        [increments_of(part, gaps="bridge") for _, part in calm.recordings()]
    )
    seen = noise_at_rest(log, [(a, b + 1) for a, b in rests], noise)
    used = _measured(log, found) if noise is None else seen.noise
    told = (*told, *increments.findings, *seen.findings)
    recordings = 1 + len(log.begins)
    sensors = sensors_of(settings, used, recordings)
    prior = prior_of(sensors, given, used, settings.turn_on)
    firsts = [next(rest for rest in rests if rest[0] >= row) for row, _ in log.recordings()]
    begun = [Begun(rest[0], *_aligned(increments, rest, site, used, prior)) for rest in firsts]
    phi_sd = np.max([b.phi_sd for b in begun], axis=0)
    if phi_sd[2] > WIDER * UNKNOWN_HEADING:
        told = (*told, finding("systematic.start_heading",
                               sd=f"{np.degrees(phi_sd[2] / WIDER):.0f}"))  # fmt: skip
    at_rest = AtRest(
        settings.velocity_sd,
        settings.position_sd,
        settings.interval,
        settings.restarts,
        settings.turning_sd,
    )
    return SystematicProblem(
        increments, site, sensors, rests, numbers, found, matched, begun[0].start, begun[0].phi_sd,
        prior, used, seen, noise is None, at_rest, told, tuple(begun[1:]),
    )  # fmt: skip


def _bridged(log: Log, spans: Sequence[tuple[int, int]]) -> Log:
    """Return the log with what rests read beside short gaps, as both of its ends hold half."""
    rows = held_still(log, spans)
    new = {name: getattr(log, name).copy() for name in ("gyro", "accel")}
    for k in rows.tolist():
        a, b = next(each for each in spans if each[0] <= k < each[1])
        near = slice(max(a, k - BESIDE), min(b, k + BESIDE))
        for x in new.values():
            x[k : k + 2] = x[near].mean(axis=0)
    return replace(log, **new) if len(rows) else log


BESIDE = 50  # Readings of a rest before a gap, and after it, that are averaged [1].


def _found(
    log: Log, site: Site, settings: Settings
) -> tuple[FoundSequence, Matched | None, tuple[Finding, ...]]:
    """Find rests and turns of every recording, and compare them with what was to be done."""
    recordings = log.recordings()
    plans = settings.plans(len(recordings))
    fewest = 2 if len(recordings) == 1 else 1  # a recording may be one pose
    doubts: list[Finding] = []
    notes: list[Finding] = []
    elsewhere: list[FoucaultError] = []
    found: list[tuple[int, FoundSequence]] = []
    matched: list[Matched] = []
    for number, ((row, part), plan) in enumerate(zip(recordings, plans, strict=True), 1):
        try:
            one = find_sequence(part, shortest=settings.shortest, fewest=fewest)
            still = int(np.count_nonzero(one.still))
            if still < fewest:
                raise error("systematic.all_move", given=still, rests=len(one.rests))
            try:
                doubts += check_sequence(part, one, site)
            except FoucaultError as problem:  # turns that are not of the plan come before it
                if problem.code != "systematic.latitude":
                    raise
                elsewhere.append(problem)
            if plan is not None:
                same = match_sequence(one, plan)
                before = sum(len(f.rests) for _, f in found)
                matched.append(replace(same, rests=same.rests + before))
                notes += same.findings
            elif (name := recognised(one)) is not None:
                notes.append(finding("systematic.recognised", name=name))
        except FoucaultError as problem:
            if len(recordings) == 1:
                raise
            where = f"Recording {number}, from {part.time[0]:.0f} s on: "
            raise FoucaultError(problem.code, where + problem.message, problem.cure) from None
        found.append((row, one))
    if elsewhere:
        raise elsewhere[0]
    both = FoundSequence.joined(found)
    return both, Matched.joined(matched), (*doubts, *both.findings, *notes)


def sensors_of(settings: Settings, noise: ImuNoise, recordings: int) -> Sensors:
    """Return what is estimated, with what biases wander by and differ by between recordings.

    `noise`: noise of the triads [SI]; `recordings`: their number [1].
    """
    sensors = settings.sensors.with_wander(noise)
    return sensors.with_turn_on(recordings) if recordings > 1 else sensors


def steady(p: SystematicProblem) -> SystematicProblem:
    """Return the problem without what wanders in the biases."""
    if not p.sensors.wanders.any():
        return p
    sensors = p.sensors.without(p.sensors.wanders)
    stay, prior = ~p.sensors.wanders, p.prior
    known = CoefficientVector(sensors.layout, prior.values[stay], prior_sd=prior.prior_sd[stay])
    return replace(p, sensors=sensors, prior=known)


def prior_of(
    sensors: Sensors,
    given: Prior,
    noise: ImuNoise | None = None,
    turn_on: Mapping[str, float] | None = None,
) -> CoefficientVector:
    """Return what is known of the coefficients beforehand: what is usual, but for what is given.

    `noise` or None: noise, where the sensors have biases that wander [SI]; `turn_on` or None:
    standard deviation of what the biases of each triad differ by between recordings [SI].
    """
    names = sensors.layout.names
    slow = noise or ImuNoise()
    wander = {"gyro.wander": (0.0, slow.gyro.bias_instability),
              "accel.wander": (0.0, slow.accel.bias_instability)}  # fmt: skip
    groups = {name.rpartition(".")[0] for name in np.array(names)[sensors.turned_on].tolist()}
    wander |= {g: (0.0, (turn_on or {}).get(g.split(".")[0], np.inf)) for g in groups}
    usual = {k for k in (*PRIOR, *wander) if any(n.startswith(f"{k}.") or n == k for n in names)}
    known = {k: v for k, v in {**PRIOR, **wander}.items() if k in usual}
    return CoefficientVector.prior(sensors.layout, {**known, **given})


POLE = np.radians(89.0)  # Nearer to a pole the heading at the start cannot be found [rad].


def require_place(site: Site, what: str) -> None:
    """Refuse a place without latitude, or where the Earth's rate shows no heading."""
    if site.latitude is None:
        raise error("systematic.site", what=what)
    if abs(site.latitude) > POLE:
        raise error("systematic.pole", given=f"{np.degrees(site.latitude):.4f}", what=what)


def as_parameters(given: Prior, settings: Settings) -> dict[str, tuple[float, float]]:
    """Return what is given of the coefficients of deflection as said of the model's parameters.

    A result says what bends, coefficient by coefficient; the filter has the parameters that make
    them. Coefficients that one parameter makes are one piece of knowledge, so that they count once
    together. Coefficients of another model say nothing of these parameters, and are left out.
    """
    bends = {name: known for name, known in given.items() if name in GENERAL}
    out = {name: known for name, known in given.items() if name not in GENERAL}
    model = settings.model
    if model is None or set(bends) != set(model.names):
        return out
    mean, sd = np.array([bends[name] for name in model.names]).T
    for name, slope in zip(model.layout.names, model.slope.T, strict=True):
        mine = slope != 0.0
        weight = (slope[mine] / sd[mine]) ** 2
        value = float(weight @ (mean[mine] / slope[mine]) / weight.sum())
        if not any(name == key or name.startswith(f"{key}.") for key in given):
            out[name] = (value, float(1.0 / np.sqrt(weight.mean())))
    return out


def _measured(log: Log, found: FoundSequence) -> ImuNoise:
    """Return the white noise of the rests, the same for all axes of a triad."""
    assert log.gyro is not None and log.accel is not None
    counts = log.sampled == "increment"
    white = [
        float(np.sqrt(np.mean(measure_noise(x, log.interval, found.rests, increments=counts).psd)))
        for x in (log.accel, log.gyro)
    ]
    return ImuNoise(TriadNoise(white=white[0]), TriadNoise(white=white[1]))


def _aligned(
    increments: Increments,
    rest: tuple[int, int],
    site: Site,
    noise: ImuNoise,
    prior: CoefficientVector,
) -> tuple[Alignment, FloatArray]:
    """Align over the first rest; return how far off that may be, too."""
    assert site.latitude is not None
    a, b = rest
    begin, end = float(increments.time[a]), float(increments.time[b])
    if end - begin < FIRST_REST:
        raise error("systematic.first_rest", time=f"{end - begin:.1f}", least=f"{FIRST_REST:.0f}")

    def sd(group: str) -> float:
        return float(np.max(prior.prior_sd[prior.layout.group(group)]))

    biases = sd("gyro.bias"), sd("accel.bias")
    found = align(increments, site, start=begin, end=end, noise=noise, gyro_bias_sd=biases[0],
                  accel_bias_sd=biases[1])  # fmt: skip
    tilt = np.hypot(biases[1] / site.gravity, sd("accel.misalignment"))
    level = EARTH_RATE * np.cos(site.latitude)
    across = np.hypot(sd("gyro.misalignment"), tilt) * EARTH_RATE  # the Earth's rate, off its axis
    heading = min(np.hypot(biases[0], across) / max(level, 1e-9), np.pi)
    return found, WIDER * np.sqrt(np.array([tilt, tilt, heading]) ** 2 + np.diag(found.cov))


NARROWED = 30.0
"""Later passes begin with so many times the uncertainty that the first has left [1]."""

SETTLED = 0.1
"""Passes have settled where none moves a coefficient by more than this of its uncertainty [1]."""


@dataclass(frozen=True)
class Solution:
    """What was found."""

    run: FilterRun  # the last pass of the filter
    states: CoefficientVector  # the states that are coefficients, with covariance and prior [SI]
    passes: tuple[FloatArray, ...]  # (p,) the same after each pass [SI]
    status: Status  # how the passes ended
    # of the innovations of the last pass, but for a constant, with the prior that it began with: it
    # ranks models that fit very differently, and `deflection_choice` compares them [1]
    log_likelihood: float


def solved(p: SystematicProblem, settings: Settings) -> Solution:
    """Filter in one step or in two."""
    if settings.steps == "published":
        return _published(p, settings)
    return _joint(p, settings.passes)


def _published(p: SystematicProblem, settings: Settings) -> Solution:
    """Filter the first sequence without deflection, and go on with it over the others."""
    p = steady(p)  # the source knows no biases that wander
    few = settings.model_copy(update={"deflection": "none", "steps": "joint"}).sensors
    prior = p.prior
    at = [prior.layout.index(name) for name in few.layout.names]
    known = CoefficientVector(few.layout, prior.values[at], prior_sd=prior.prior_sd[at])
    part = replace(p, sensors=few, prior=known, rests=p.rests[: _first_part(p, settings)])
    one = _joint(part, settings.passes)
    two, begun = second_step(p.model, one.run, one.states, prior)
    passes = (begun, two.coefficients[-1])
    return _solution(two, replace(two.estimate, prior_sd=prior.prior_sd), passes, one.status)


def _joint(p: SystematicProblem, passes: int) -> Solution:
    """Filter in one step, again and again.

    A wide prior lets the filter wander far while it has seen little, and what it finds is then not
    linear in the readings. So later passes have a prior `NARROWED` about the result before, whose
    information is taken out again in the end.
    """
    found = p.model.filtered(p.starts(p.begun), p.prior.values, p.prior.prior_sd, keep=True)
    if passes == 1:
        states = replace(found.estimate, prior_sd=p.prior.prior_sd)
        return _solution(found, states, (states.values,), Status.CONVERGED)
    return again(p, found.estimate, begins(found, [C_nb for C_nb, _ in p.begun]), passes - 1)


def begins(
    found: FilterRun, C_nb: Sequence[FloatArray] | None = None
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the attitude at the start of every recording [1], and its sd, E N U [rad].

    `C_nb` (3, 3): the attitudes that it began with, None for those of its first epochs [1].
    """
    runs = found.recordings()
    before = [run.trajectory.C_nb[0] for run in runs] if C_nb is None else C_nb
    return [
        (attitude_at_start(run, C, found.coefficients[-1]), np.sqrt(np.diag(run.attitude_cov)))
        for run, C in zip(runs, before, strict=True)
    ]


def again(
    p: SystematicProblem, near: CoefficientVector,
    begun: Sequence[tuple[FloatArray, FloatArray]], passes: int, *, keep: bool = True,
) -> Solution:  # fmt: skip
    """Filter again, from a result that is near, until passes settle.

    `near`: the result, with covariance [SI]; `begun` (3, 3): attitude at the start of every
    recording [1] and its uncertainty, E N U [rad]; `passes`: most passes [1]; `keep`: whether the
    run of a single pass keeps what a smoother needs.
    """
    keep = keep or passes > 1
    stay = ~p.sensors.wanders  # what wanders is at the start not what it is at the end
    sd = np.where(stay, np.minimum(p.prior.prior_sd, NARROWED * near.sd), p.prior.prior_sd)
    narrow = [NARROWED * phi_sd for _, phi_sd in begun]
    C_nb, values = [C for C, _ in begun], [np.where(stay, near.values, 0.0)]
    while True:
        starts = p.starts(list(zip(C_nb, narrow, strict=True)))
        found = p.model.filtered(starts, values[-1], sd, keep=keep)
        # With the prior that counts: what the session hardly shows would wander on and on without.
        estimate = exchanged(found.estimate, (values[-1], sd), p.prior)
        moved = float((np.abs(estimate.values - values[-1]) / estimate.sd)[stay].max())
        values.append(np.where(stay, estimate.values, 0.0))
        if moved < SETTLED or len(values) > passes:
            break
        C_nb = [C for C, _ in begins(found, C_nb)]
    status = Status.CONVERGED if moved < SETTLED else Status.NOT_CONVERGED
    return _solution(found, estimate, tuple(values), status)


def _first_part(p: SystematicProblem, settings: Settings) -> int:
    """Return how many of the rests belong to the first of several sequences."""
    if settings.actions or len(settings.sequence) < 2:
        raise error("systematic.first_part", what="one sequence is declared")
    moves = len(built_in(settings.sequence[0]).moves)
    before = np.array([sum(m.after < k for m in p.found.moves) for k in p.numbers])
    return int(np.count_nonzero(before <= moves))


def _solution(
    run: FilterRun, states: CoefficientVector, passes: tuple[FloatArray, ...], status: Status
) -> Solution:
    stay = ~run.sensors.wanders
    if not stay.all():
        assert states.cov is not None
        layout = run.sensors.without(~stay).layout
        states = CoefficientVector(layout, states.values[stay], states.cov[np.ix_(stay, stay)],
                                   prior_sd=states.prior_sd[stay])  # fmt: skip
    logs = run.innovation**2 / run.variance + np.log(run.variance)
    passes = tuple(values[stay] for values in passes)
    return Solution(run, states, passes, status, float(-0.5 * np.nansum(logs)))


def named(states: Sequence[str], deflections: Sequence[str]) -> tuple[str, ...]:
    """Return the coefficients of the result: those that readings are compensated by, in order."""
    some = {*states, *deflections}
    return tuple(name for name in (*imu.LAYOUT.names, *size_effect.LAYOUT.names) if name in some)


def public(s: Solution, settings: Settings) -> CoefficientVector:
    """Return the coefficients of the result [SI]."""
    vector = s.states if settings.model is None else settings.model.general(s.states)
    return vector.chosen(named(vector.names, ()))


RATE, BEFORE, REST = 50.0, 100.0, 500.0  # Sample rate [Hz], rest before the spin, and after it [s].
EVERY = 5.0  # Time between the points that are kept [s].


def navigation_tests(
    found: CoefficientVector, site: Site, model: DeflectionModel | None
) -> tuple[dict[str, npt.NDArray[Any]], list[dict[str, Any]]]:
    """Navigate the tests about east and about north.

    `found`: what was found, with covariance [SI]; `model` or None: the model of deflection, if
    there is one: then the tests are also done with everything but the deflection compensated.
    Returns `table`: which test, what is compensated, time since the spin began [s], velocity
    [m/s], and how far the attitude has moved since then [rad]: east, north, up; `ends`: of each
    test and compensation the tilt by the spin [rad] and the velocity at the end [m/s].
    """
    instrument, size = model_of(found), SizeEffect.of(found)
    assert isinstance(instrument, ImuModel)
    assert found.cov is not None
    values, vectors = np.linalg.eigh(found.cov / np.outer(found.sd, found.sd))
    z = np.random.default_rng(0).standard_normal(len(found))
    missed = found.sd * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * z))
    told = CoefficientVector(found.layout, found.values + missed)
    ways = {"none": told.with_values(dict.fromkeys(told.names, 0.0)), "all": told}
    if model is not None:
        stiff = told.with_values(dict.fromkeys(model.names, 0.0))
        ways = {"none": ways["none"], "all but deflection": stiff, "all": told}
    rows: list[dict[str, npt.NDArray[Any]]] = []
    ends: list[dict[str, Any]] = []
    for about in ("east", "north"):
        made = simulate_systematic(navigation_test(about, before=BEFORE, rest=REST), site=site,
                                   model=instrument, rate=RATE, arms=size.arms,
                                   delay=size.delay)  # fmt: skip
        for way, by in ways.items():
            time, velocity, away = _navigated(made, by)
            n = len(time)
            rows.append({"about": np.full(n, about), "compensated": np.full(n, way), "time": time,
                         **_columns("velocity", velocity), **_columns("shift", away)})  # fmt: skip
            spun = made.sequence.actions[1].time
            at = int(np.searchsorted(time, spun - 1e-6))
            ends.append({"about": about, "compensated": way, "shift": away[at].tolist(),
                         "velocity": velocity[-1].tolist()})  # fmt: skip
    return {key: np.concatenate([row[key] for row in rows]) for key in rows[0]}, ends


def _columns(what: str, values: FloatArray) -> dict[str, npt.NDArray[Any]]:
    return {f"{what}_{way}": values[:, k] for k, way in enumerate(("east", "north", "up"))}


def _navigated(
    made: SystematicSimulation, by: CoefficientVector
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Align and navigate; return time since the spin began, velocity and change of attitude."""
    assert made.site.latitude is not None
    model = model_of(by)
    assert isinstance(model, ImuModel)
    increments = increments_of(SizeEffect.of(by).apply(model, made.log))
    first = increments.row_at(BEFORE)
    begin = align(increments, made.site, end=BEFORE)
    state = State.at_rest(begin.C_nb, made.site.latitude, 0.0, made.site.height)
    offset = made.site.anomaly
    run = navigate(increments, state, first=first, gravity_offset=offset, vertical="held")
    rows = np.arange(0, len(run.time), round(EVERY * RATE))
    time = run.time[rows]
    # C_est = (I - [phi x]) C_true
    phi = -rotation_vector(run.C_nb[rows] @ np.swapaxes(made.attitude(time), 1, 2))
    return time - time[0], run.velocity_n[rows], phi - phi[0]
