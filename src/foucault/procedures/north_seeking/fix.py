"""Find north: heading, pitch, roll and latitude of set-ups in the field, each with its evidence.

The calibration of `procedures.north_seeking` and its uncertainty go in; every set-up of a file is
solved in one call. What is not known of the noise comes from the calibration, or from what the fits
leave.

The calibration of a north seeker solved: from dwells to coefficients, with what led to them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.detect.dwells import find_dwells, measured_noise
from foucault.detect.noise import without_spikes
from foucault.diagnose import north as judge
from foucault.diagnose import north_calibration as calibrating
from foucault.diagnose.left_out import checks as left_out_checks
from foucault.diagnose.north import (
    GUESS,
    Each,
    alive,
    drift_sd,
    from_residuals,
    late_index,
    require_plausible,
    stops,
    units_first,
)
from foucault.diagnose.north_stops import (
    Gains,
    contradicted,
    gain_words,
    other_conditions,
    spent,
    stop_gains,
    stop_offsets,
    without,
    without_gains,
    words,
)
from foucault.errors import Finding, error, finding
from foucault.estimate import north as estimation
from foucault.estimate.north import LATITUDE, Fixes, Known, Rig
from foucault.estimate.north_reduction import Nuisance, Pairs, Squares, reduce
from foucault.guard.north import causes
from foucault.infer import mixed
from foucault.infer.left_out import Judgement, With
from foucault.infer.mixed import NOISE_BASIS, Fit
from foucault.models.earth import Site
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise, noise_of
from foucault.models.north_seeker import SEEKER, Compensation, Dwells
from foucault.models.norths import North, norths
from foucault.procedures import Progress, left_out, silent
from foucault.procedures.north_seeking.blocks import Found, Seeking, in_blocks, joined
from foucault.procedures.north_seeking.counted import (
    again,
    beside,
    completed,
    on_case,
    stood,
    with_rig,
)
from foucault.procedures.north_seeking.field import Scatter, Terms, judgement, whole_sizes
from foucault.procedures.north_seeking.field import told as of_headings
from foucault.procedures.north_seeking.settings import MOST_LATITUDE, Settings
from foucault.result import Check, Level, Result, Verdict, provenance
from foucault.tables import IndexedLog

DRIFT_UNIT = np.radians(1.0 / 3600.0) / 3600.0
"""1 deg/h per hour [rad/s^2]."""


@dataclass(frozen=True)
class Survey:
    """The solution of a file of readings: m set-ups, n dwells."""

    dwells: Dwells  # the readings [SI]
    pairs: Pairs  # four numbers of every set-up, without its readings [SI]
    fixes: Fixes  # heading, pitch, roll, latitude of every set-up; sources of the heading [rad]
    known: Known  # place, and what decided between solutions
    noise: ImuNoise  # noise that was taken [SI]
    # "declared", "measured in the dwells", "of the calibration" or "from the residuals"
    noise_source: str
    compensation: Compensation  # errors of the instrument
    # instrument, date and verdict of the calibration; empty without one
    calibration: dict[str, Any]
    # sd that the gyro's linear drift had before: 0 none, infinite where free [rad/s^2]
    drift_sd: float
    checks: Sequence[tuple[Check, ...]]  # tests of every set-up
    verdicts: Sequence[Verdict]  # what they say together
    levels: IntArray  # (m,) of the verdicts, in the order of `Level` [1]
    setup_findings: Sequence[tuple[Finding, ...]]  # what was noticed of every set-up
    findings: tuple[Finding, ...]  # what was noticed of the whole file
    bound: FloatArray  # (m, 4) Cramer-Rao bound, white noise and a perfect instrument alone [rad]
    # (m,) heading error of a linear drift of 1 deg/h per hour that is not estimated [rad]
    drift_effect: FloatArray
    instrument: dict[str, Any]  # name, serial and so on
    site: Site
    provenance: dict[str, Any]  # versions, input, date, duration
    norths: Sequence[North]  # those that headings are given from, true north first
    # some set-ups, by their numbers (k,), with all that is found of them and of their readings [SI]
    again: Callable[[IntArray], Found]
    left_out: Judgement | None = None  # what was made of what is not estimated

    def __len__(self) -> int:
        return len(self.fixes)


def find_north(
    log: IndexedLog,
    *,
    site: Site,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    calibration: Result | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sizes: Sizes | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Survey:
    """Find the heading of every set-up of a log.

    `log`: samples or means with index angles [SI]; `site`: gravity, and the latitude unless it is
    to be estimated; `settings`: what can be chosen, None takes the defaults; `noise`: noise of
    the sensors [SI], None takes it from the dwells, the calibration or the residuals;
    `calibration`: of this instrument, None takes one without errors, but for `prior`; `prior` or
    None: mean and standard deviation of coefficients that were not calibrated [SI]; `sizes` or
    None: of what is not estimated, None takes it for nothing [SI]; `instrument` or None: name,
    serial and so on; `progress`: called with the fraction done and what is being done. Raises wrong
    units or signs, stops that do not show the heading, the calibration of another instrument: see
    `foucault.symptoms`.
    """
    started = clock.monotonic()
    settings, about = settings or Settings(), dict(instrument or {})
    said_lag = settings.index_lag_sd
    settings, assumed = completed(settings, sizes)
    compensation, told = _compensation(
        calibration, accelerometers_before(settings, prior or {}), about
    )
    progress(0.1, "finding the dwells")
    log = without_spikes(log)
    stuck = alive(log)
    dwells = find_dwells(log, settle=settings.settle, shortest=settings.shortest)
    if calibration is not None:
        dwells = without(dwells, calibration.diagnostics.get("stop_offsets") or {})
    known = _known(site, settings, dwells)
    told = (
        *log.findings,
        *stuck,
        *dwells.findings,
        *told,
        *stops(dwells, known),
        *late_index(dwells, said_lag),
    )
    if known.latitude is None and settings.hemisphere is None:
        other = "south" if known.hemisphere == "north" else "north"
        told += (finding("north.hemisphere", hemisphere=known.hemisphere, other=other),)
    progress(0.4, "solving")
    noise, source = _noise(log, dwells, noise, calibration, settings)
    free = drift_sd(dwells, noise, settings.drift, settings.drift_sd)
    nuisance, m = _nuisance(settings, free), len(dwells.names)
    gains = {} if calibration is None else calibration.diagnostics.get("stop_gains") or {}
    if gains:
        values = in_blocks(m, lambda some: reduce(dwells.setups(some), noise, nuisance).values)
        dwells = without_gains(dwells, gains, np.concatenate([*values]))
    own = beside(sizes, settings, noise)
    seeking = Seeking(dwells, known, noise, nuisance, compensation, site, own)
    with units_first(log.findings):
        found, together = seeking.found({})
        require_plausible(together.implausible)
    told += causes(dwells, seeking.of, found.fixes, known, compensation)
    judged, times, pairs = None, dict[str, float](), found.pairs
    if together.products is not None:
        times, seen, named = together.products.of(together.groups).judged()
        if named:
            found, _ = seeking.found(times)
        pairs = found.pairs
        if together.misfit:
            assert together.scatter is not None
            pairs = together.scatter.accounted(pairs, times)
        whole, groups = whole_sizes(own or {}, site), together.groups
        judged = judgement(known, whole, groups, found.fixes, seen, named, settings.index_sd,
                           assumed)  # fmt: skip
        told += of_headings(judged)
        known = replace(known, latitude_sd=known.latitude_sd * times.get(LATITUDE, 1.0))
    fixes = found.fixes
    asked = judge.Judged(
        dwells, pairs, fixes, found.ratio, known, noise, source, settings.accuracy, found.level,
        found.drift_effect, found.most, found.row,
    )  # fmt: skip
    beyond = () if judged is None else left_out_checks(judged)
    tests = judge.checks(asked, _level(calibration), beyond)
    sd = float(np.hypot(settings.heading_sd, settings.heading_offset_sd))
    against = contradicted(dwells, fixes, sd)
    if calibration is not None:
        told += other_conditions(dwells, log.temperature, calibration.validity)
    progress(1.0, "done")
    each = Each(m, lru_cache(1)(tests.of))  # which the verdict asks for again
    return Survey(
        dwells, pairs, fixes, known, noise, source, compensation, _about(calibration), free,
        each, Each(m, lambda i: Verdict.of(each[i]).doubted(told)),
        tests.levels(told), Each(m, lambda i: (*judge.findings(asked, i), *against(i))), told,
        found.bound, DRIFT_UNIT * found.drift_effect, about, site,
        provenance(log.source, clock.monotonic() - started), norths(site),
        lambda some: seeking.of_some(times, some)[0], judged,
    )  # fmt: skip


def _known(site: Site, settings: Settings, dwells: Dwells) -> Known:
    latitude, sd, gravity = _places(site, settings, dwells)
    if latitude is None and not settings.unknown_latitude:
        raise error("north.fix_latitude")
    for one in [] if latitude is None else np.unique(latitude):
        require_latitude(float(one))
        side = "north" if one >= 0 else "south"
        if settings.hemisphere not in (None, side):
            second = f"the latitude, {np.degrees(one):.4g} deg"
            raise error("north.contradiction", first=f"hemisphere {settings.hemisphere}",
                        second=second)  # fmt: skip
    level = settings.level_sd
    if dwells.accel is None and level is None:
        raise error("north.level_sd")
    return Known(
        gravity, latitude, sd, settings.hemisphere or "north", settings.near,
        settings.near_sd, level,
    )  # fmt: skip


Places = tuple[float | FloatArray | None, float | FloatArray, float | FloatArray]


def _places(site: Site, settings: Settings, dwells: Dwells) -> Places:
    """Return latitude, its sd and gravity: of each set-up where the log says them, else of all."""
    if dwells.latitude is None and dwells.latitude_sd is None:
        return (None if settings.unknown_latitude else site.latitude, settings.latitude_sd,
                site.gravity)  # fmt: skip
    if settings.unknown_latitude:
        raise error("north.latitude_both", given="A column of latitudes")
    none = np.full(len(dwells.names), np.nan)
    said = none if dwells.latitude is None else dwells.latitude
    usual = np.nan if site.latitude is None else site.latitude
    latitude = np.where(np.isfinite(said), said, usual)
    without = np.flatnonzero(np.isnan(latitude))
    if len(without):
        raise error("north.place_missing", count=len(without), name=dwells.names[without[0]])
    sd = none if dwells.latitude_sd is None else dwells.latitude_sd
    sd = np.where(np.isfinite(sd), sd, settings.latitude_sd)
    gravity = np.full(len(latitude), site.gravity)
    if site.gravity_source != "given":  # that of the place, at each latitude
        gravity = np.array([Site.at(float(one), site.height).gravity for one in latitude])
    return latitude, sd, gravity


def _nuisance(settings: Settings, drift: float) -> Nuisance:
    sd = np.inf if settings.gyro_offset_sd is None else settings.gyro_offset_sd
    lag = settings.index_lag_sd or 0.0
    return Nuisance(settings.gyro_offset, sd, drift, settings.index_sd, lag)


def _noise(
    log: IndexedLog, dwells: Dwells, declared: ImuNoise | None, calibration: Result | None,
    settings: Settings,
) -> tuple[ImuNoise, str]:  # fmt: skip
    """Return the noise, and where it comes from: what is nearest to these readings."""
    if declared is not None:
        return declared, "declared"
    measured = measured_noise(log, dwells)
    if measured is not None:
        return measured, "measured in the dwells"
    if calibration is not None:
        found = noise_of(calibration.diagnostics.get("noise") or {})
        if found is not None:
            return found, "of the calibration"
    free = drift_sd(dwells, GUESS, settings.drift, settings.drift_sd)
    nuisance = _nuisance(settings, free)
    m = len(dwells.names)
    left, _ = joined(m, lambda some: (Squares.of(dwells.setups(some), GUESS, nuisance), None))
    found = from_residuals(left, dwells.accel is not None)
    if found is None:
        also = ' and --accel-noise "5 ug/sqrt(Hz)"' if dwells.accel is not None else ""
        what = f'--gyro-noise "0.003 deg/sqrt(h)"{also}, or [noise] in the campaign file'
        raise error("north.noise_unknown", what=what)
    return found, "from the residuals"


def _compensation(
    calibration: Result | None, prior: Mapping[str, tuple[float, float]], about: dict[str, Any]
) -> tuple[Compensation, tuple[Finding, ...]]:
    """Return what is known of the instrument: the calibration, and priors of what it lacks."""
    names: list[str] = []
    values: list[float] = []
    cov = np.zeros((0, 0))
    told: tuple[Finding, ...] = ()
    serial = ""
    if calibration is None:
        told = (finding("north.no_calibration"),)
    else:
        if calibration.procedure != "north_seeking":
            file = str(calibration.provenance.get("file", "the calibration"))
            raise error("north.other_result", file=file, given=calibration.procedure)
        serial = str(calibration.instrument.get("serial") or "")
        mine = str(about.get("serial") or "")
        if serial and mine and serial != mine:
            raise error("north.other_serial", given=mine, other=serial)
        c = calibration.coefficients
        names, values = list(c.names), list(c.values)
        cov = np.zeros((len(c), len(c))) if c.cov is None else c.cov
        if calibration.verdict.level is not Level.PASS:
            reason = next(iter(calibration.verdict.reasons), "")
            level = calibration.verdict.level.value
            told = (finding("north.calibration_doubtful", level=level, reason=reason),)
    for key in prior:
        SEEKER.group(key)  # raises where there is no such coefficient
    more = {
        n: prior[key]
        for n in SEEKER.names
        for key in prior
        if n not in names and (n == key or n.startswith(key + "."))
    }
    full = np.zeros((len(names) + len(more),) * 2)
    full[: len(names), : len(names)] = cov
    full[len(names) :, len(names) :] = np.diag([sd**2 for _, sd in more.values()])
    vector = CoefficientVector(
        SEEKER.subset([*names, *more]), np.array([*values, *(v for v, _ in more.values())]), full
    )
    return Compensation(vector, serial), told


def _level(calibration: Result | None) -> Level | None:
    return None if calibration is None else calibration.verdict.level


def _about(calibration: Result | None) -> dict[str, Any]:
    if calibration is None:
        return {}
    return {
        "instrument": dict(calibration.instrument),
        "created": calibration.provenance.get("created"),
        "verdict": calibration.verdict.level.value,
        "site": dict(calibration.site),
        "coefficients": len(calibration.coefficients),
    }


Z_COUPLING = ("gyro.misalignment.xz", "gyro.misalignment.yz")
"""The coupling of the rate along the axis of the base."""


def require_latitude(latitude: float) -> None:
    """Refuse a latitude where a gyro cannot find north.

    `latitude`: positive north [rad].
    """
    if abs(latitude) > MOST_LATITUDE:
        raise error("north.latitude", given=f"{np.degrees(latitude):.4f}")


@dataclass(frozen=True)
class Solution:
    """The calibration solved, with what led to it."""

    pairs: Pairs  # four numbers of every set-up [SI]
    rig: Rig
    noise: ImuNoise  # noise that was weighed [SI]
    source: str  # where it came from
    nuisance: Nuisance  # offset, drift and index angles
    fit: Fit
    # significance of the coupling along z_b: chi-square, and how often chance gives so much [1]
    z_test: tuple[float, float] | None
    findings: tuple[Finding, ...]
    stop_offsets: dict[str, float]  # biases of single stops [rad/s]
    stop_gains: Gains  # by what part of the rates along x_b and y_b single stops read too much [1]
    judged: Judgement | None = None  # what was made of what is not estimated


def solved(
    dwells: Dwells, site: Site, settings: Settings, noise: ImuNoise | None, declared: bool,
    given: Mapping[str, tuple[float, float]], sizes: Sizes | None = None,
) -> Solution:  # fmt: skip
    """Solve the calibration.

    `dwells`: readings [SI]; `noise`: noise of the sensors, None finds it in the residuals [SI];
    `declared`: whether it was declared, or measured in the dwells; `given`: mean and standard
    deviation of coefficients or groups of coefficients [SI]; `sizes` or None: of what is not
    estimated [SI].
    """
    settings, assumed = completed(settings, sizes)
    known = Compensation(held(accelerometers_before(settings, given)))
    trial = noise or GUESS
    nuisance = Nuisance(
        drift_sd=drift_sd(dwells, trial, settings.drift, settings.drift_sd),
        index_sd=settings.index_sd, lag_sd=settings.index_lag_sd or 0.0,
    )  # fmt: skip
    offsets, chance = stop_offsets(dwells, trial, nuisance)
    told = words(offsets, chance)
    dwells = without(dwells, offsets)
    gains, chance = stop_gains(dwells, trial, nuisance)
    told += gain_words(gains, chance)
    if gains:
        dwells = without_gains(dwells, gains, reduce(dwells, trial, nuisance).values)
    used = (1 if offsets else 0) + (2 if gains else 0)
    pairs = spent(reduce(dwells, trial, nuisance), used)
    rig = replace(_rig(pairs, dwells, site, settings), assumed=assumed)
    rig = stood(rig, settings, sizes)
    if settings.z_coupling == "auto":
        given = dict.fromkeys(Z_COUPLING, (0.0, settings.z_coupling_sd)) | dict(given)
    source = "declared" if declared else "measured in the dwells"
    if noise is None:
        noise, source = _noise_solution(dwells, pairs, rig, known, given), calibrating.UNKNOWN
        pairs = spent(reduce(dwells, noise, nuisance), used)
    sizes = beside(sizes, settings, noise)
    basis = NOISE_BASIS[calibrating.NOISE[source]]

    def fitted(
        z_coupling: bool, given: Mapping[str, tuple[float, float]]
    ) -> tuple[Fit, Judgement | None]:
        names = estimation.names_of(rig.tilt, rig.accelerometers, z_coupling)
        model = estimation.OnTurntable(pairs, rig, SEEKER.subset(names), known, basis)
        prior, of = _prior(names, given), again(model, dwells, noise)
        if sizes is not None:  # what is enlarged later says nothing of what the headings show
            calibrating.require_sound(mixed.fit(model, prior).estimate)
        return left_out.fit(model, prior, sizes, site, of)

    fit, judged = fitted(settings.z_coupling != "no", given)
    if judged is None:
        calibrating.require_sound(fit.estimate)
    z_test: tuple[float, float] | None = None
    if rig.tilt == "each":
        free = fit
        if settings.z_coupling != "free":
            unknown = {k: v for k, v in given.items() if not k.startswith(Z_COUPLING)}
            free, _ = fitted(True, unknown)
        z_test = calibrating.z_significance(free.estimate)
        told += tuple(calibrating.z_findings(z_test, settings.z_coupling))
    if judged is not None:
        misfit = any(c.chi_square > c.high for c in calibrating.within(pairs).values())
        if misfit:
            model = fit.model.model if isinstance(fit.model, With) else fit.model
            assert isinstance(model, estimation.OnTurntable)
            _, f_b, _, _ = model.truth(fit.state)
            times = {g: k for one in judged.named for g, k in one.items()}
            span = float(dwells.start.min()), float((dwells.start + dwells.time).max())
            forces = {g: size for g, size in judged.sizes.items() if g.startswith("accel.")}
            own = Terms.of((), site, forces, on_case(dwells))
            scatter = Scatter.of(pairs, dwells, f_b, span, own)
            pairs = scatter.accounted(pairs, times)
        judged = with_rig(judged, rig, settings.index_sd)
    return Solution(pairs, rig, noise, source, nuisance, fit, z_test, told, offsets, gains, judged)


def _rig(pairs: Pairs, dwells: Dwells, site: Site, settings: Settings) -> Rig:
    """Find out how the table was used."""
    accelerometers = dwells.accel is not None
    if settings.tilt == "each" and not accelerometers:
        raise error("north.tilt_unknown")
    level = settings.level_sd
    if level is None:
        if not accelerometers:
            raise error("north.level_sd")
        level = np.inf
    rig = Rig(
        dwells.heading, site, "one axis", accelerometers, settings.heading_sd,
        settings.heading_offset_sd, level, settings.latitude_sd,
    )  # fmt: skip
    tilted = settings.tilt == "auto" and accelerometers and calibrating.leans(pairs, rig)
    if settings.tilt == "each" or tilted:
        return replace(rig, tilt="each", level_sd=settings.level_sd or 0.0)
    return rig


def _noise_solution(
    dwells: Dwells, pairs: Pairs, rig: Rig, known: Compensation,
    given: Mapping[str, tuple[float, float]],
) -> ImuNoise:  # fmt: skip
    """Measure the noise by what the calibration leaves."""
    names = estimation.names_of(rig.tilt, rig.accelerometers, rig.tilt == "each")
    model = estimation.OnTurntable(pairs, rig, SEEKER.subset(names), known)
    fit = mixed.fit(model, _prior(names, given))
    found = from_residuals(pairs, dwells.accel is not None, list(fit.after.values()))
    if found is None:
        raise error("north.noise_unknown", what="[noise] in the campaign file")
    return found


def _prior(
    names: tuple[str, ...], given: Mapping[str, tuple[float, float]]
) -> CoefficientVector | None:
    """Return what is known of `names`; what is given of the others does not count here."""
    whole = CoefficientVector.prior(SEEKER, given)
    keep = [SEEKER.index(name) for name in names]
    sd = whole.prior_sd[keep]
    if not np.isfinite(sd).any():
        return None
    return CoefficientVector(SEEKER.subset(names), whole.values[keep], prior_sd=sd)


def accelerometers_before(
    settings: Settings, prior: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return what is known of accelerometers beforehand; a prior goes before it.

    `prior`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    usual = {
        "accel.bias": (0.0, settings.accel_bias_sd),
        "accel.scale": (0.0, settings.accel_scale_sd),
        "accel.misalignment": (0.0, settings.accel_misalignment_sd),
    }
    given = {name.rpartition(".")[0] for name in prior} | set(prior)
    return {k: v for k, v in usual.items() if v[1] > 0 and k not in given} | dict(prior)


def held(given: Mapping[str, tuple[float, float]]) -> CoefficientVector:
    """Return what is known of the accelerometers beforehand.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    names = [n for n in SEEKER.names if n.startswith("accel.")]
    vector = _prior(tuple(names), given)
    if vector is None:
        return CoefficientVector.zeros(SEEKER.subset(()))
    keep = np.flatnonzero(np.isfinite(vector.prior_sd))
    layout = SEEKER.subset(names[i] for i in keep)
    return CoefficientVector(layout, vector.values[keep], np.diag(vector.prior_sd[keep] ** 2))
