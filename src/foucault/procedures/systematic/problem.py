"""From the log of a systematic calibration and what was said of it to what the filter takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.noise_at_rest import NoiseAtRest, noise_at_rest
from foucault.diagnose.rests import measure_noise
from foucault.diagnose.systematic.input import check_readings, require_readings
from foucault.diagnose.systematic.rests import FoundSequence, find_sequence, require_triads
from foucault.diagnose.systematic.sequence import Matched, match_sequence, recognised
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.estimate.ins_filter import start_cov
from foucault.estimate.systematic.fit import AtRest, Start, SystematicModel
from foucault.models.deflection import GENERAL
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.align import Alignment, align
from foucault.navigate.increments import Increments, increments_of
from foucault.procedures.systematic.settings import FIRST_REST, PRIOR, Settings
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
    numbers: npt.NDArray[np.int64]  # (m,) which rests of the log they are, from 0 [1]
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
    given: Mapping[str, tuple[float, float]],
) -> SystematicProblem:
    """Find rests and turns, check them, and align.

    `log`: readings [SI]; `noise`: noise as declared [SI], None measures the white noise in the
    rests; `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    require_place(site, "a systematic calibration")
    require_triads(log)
    require_readings(log)
    found, matched, told = _found(log, site, settings)
    numbers = np.flatnonzero(found.still)
    rests = tuple((int(found.rests.first[k]), int(found.rests.last[k]) - 1) for k in numbers)
    _require_updates(rests, settings, log)
    increments = Increments.chained([increments_of(part) for _, part in log.recordings()])
    seen = noise_at_rest(log, [(a, b + 1) for a, b in rests], noise)
    used = _measured(log, found) if noise is None else seen.noise
    told = (*told, *seen.findings)
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


def _found(
    log: Log, site: Site, settings: Settings
) -> tuple[FoundSequence, Matched | None, tuple[Finding, ...]]:
    """Find rests and turns of every recording, and compare them with what was to be done."""
    recordings = log.recordings()
    plans = settings.plans(len(recordings))
    fewest = 2 if len(recordings) == 1 else 1  # a recording may be one pose
    doubts: list[Finding] = []
    notes: list[Finding] = []
    found: list[tuple[int, FoundSequence]] = []
    matched: list[Matched] = []
    for number, ((row, part), plan) in enumerate(zip(recordings, plans, strict=True), 1):
        try:
            one = find_sequence(part, shortest=settings.shortest, fewest=fewest)
            still = int(np.count_nonzero(one.still))
            if still < fewest:
                raise error("systematic.all_move", given=still, rests=len(one.rests))
            doubts += check_readings(part, one, site)
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
    both = FoundSequence.joined(found)
    return both, Matched.joined(matched), (*doubts, *both.findings, *notes)


def sensors_of(settings: Settings, noise: ImuNoise, recordings: int) -> Sensors:
    """Return what is estimated, with what biases wander by and differ by between recordings.

    `noise`: noise of the triads [SI]; `recordings`: their number [1].
    """
    sensors = settings.sensors.with_wander(noise)
    return sensors.with_turn_on(recordings) if recordings > 1 else sensors


def _require_updates(rests: tuple[tuple[int, int], ...], settings: Settings, log: Log) -> None:
    """Refuse rests in which less than two measurements are made."""
    lasts = np.array([(b - a) * log.interval for a, b in rests])
    if lasts.min() < 2 * settings.interval:
        raise error("systematic.interval", interval=f"{settings.interval:g}",
                    rest=f"{lasts.min():.0f}", number=int(np.argmin(lasts)) + 1)  # fmt: skip


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
    given: Mapping[str, tuple[float, float]],
    noise: ImuNoise | None = None,
    turn_on: Mapping[str, float] | None = None,
) -> CoefficientVector:
    """Return what is known of the coefficients beforehand: what is usual, but for what is given.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI]; `noise`
    or None: noise, where the sensors have biases that wander [SI]; `turn_on` or None: standard
    deviation of what the biases of each triad differ by between recordings [SI].
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


POLE = np.radians(89.0)
"""Nearer to a pole the heading at the start cannot be found [rad]."""


def require_place(site: Site, what: str) -> None:
    """Refuse a place without latitude, or where the Earth's rate shows no heading."""
    if site.latitude is None:
        raise error("systematic.site", what=what)
    if abs(site.latitude) > POLE:
        raise error("systematic.pole", given=f"{np.degrees(site.latitude):.4f}", what=what)


def as_parameters(
    given: Mapping[str, tuple[float, float]], settings: Settings
) -> dict[str, tuple[float, float]]:
    """Return what is given of the coefficients of deflection as said of the model's parameters.

    A result says what bends, coefficient by coefficient; the filter has the parameters that make
    them. Coefficients that one parameter makes are one piece of knowledge, so that they count once
    together. Coefficients of another model say nothing of these parameters, and are left out.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
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
        raise error("systematic.first_rest", time=f"{end - begin:.1f}",
                    least=f"{FIRST_REST:.0f}")  # fmt: skip

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
