"""Align a log at rest by several methods side by side, and say how sure each of them is.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 5.6.2 (levelling, gyrocompassing).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from foucault.detect.noise import without_spikes
from foucault.diagnose import alignment as alignment_checks
from foucault.diagnose.noise_at_rest import FEWEST
from foucault.errors import Finding, finding, require
from foucault.guard.rest import contradictions, of_increments
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.navigate.align import (
    Alignment,
    Method,
    align,
    check_method,
    latitude_seen,
    measured_errors,
    sensor_errors,
    window,
)
from foucault.navigate.increments import (
    Increments,
    increments_of,
    navigable,
    require_readings,
    require_sound,
)
from foucault.navigate.inertial_frame import SensorErrors, known_latitude
from foucault.procedures.navigation.run import bias_sds
from foucault.procedures.navigation.start import LEAST, Settings, before, in_rest, opening
from foucault.result import Result
from foucault.tables import Log, numbers

METHODS: tuple[Method, ...] = ("inertial_frame", "kalman", "two_vector")
"""Methods for one rest, the one to go by first."""

BESIDE = 4  # Samples beside a rest that feed the integration at its ends [1].


@dataclass(frozen=True)
class Comparison:
    """What several methods of alignment say of the same log."""

    found: tuple[Alignment, ...]  # one per method, the one to go by first
    rate_seen: float  # size of the mean rate in the rest [rad/s]
    latitude_seen: float  # latitude that gravity and the mean rate show [rad]
    site: Site
    noise: ImuNoise | None  # white noise of the sensors that was taken [SI]
    measured: bool  # whether it was measured in the rest
    # gyro_bias_sd, accel_bias_sd: how well the biases were taken to be known [rad/s], [m/s^2]
    gyro_bias_sd: float
    accel_bias_sd: float
    findings: tuple[Finding, ...]


def align_log(
    log: Log,
    *,
    site: Site,
    methods: Method | Sequence[Method] = (),
    start: float | None = None,
    end: float | None = None,
    rests: Sequence[tuple[float, float]] = (),
    noise: ImuNoise | None = None,
    gyro_bias_sd: float | None = None,
    accel_bias_sd: float | None = None,
    calibration: Result | None = None,
    gaps: Literal["stop", "bridge"] = "stop",
) -> Comparison:
    """Align a log by several methods.

    Parameters
    ----------
    log : Log
        Readings as measured [SI].
    site : Site
        Where it stood; the latitude must be known.
    methods : sequence of {"inertial_frame", "kalman", "two_vector", "two_position"}
        Methods, or one of them; none for `METHODS`, and "two_position" first where there are rests.
    start, end : float or None
        The rest, from the start of the log; None: the first that is found [s].
    rests : sequence of (float, float)
        Two or more rests at different headings, from the start of the log [s]. Methods for one
        rest take the last of them. One alone is the window.
    noise : ImuNoise or None
        White noise of the sensors; None measures it in the rest [SI].
    gyro_bias_sd, accel_bias_sd : float or None
        How well the biases are known; None takes that of the calibration, else zero
        [rad/s], [m/s^2].
    calibration : Result or None
        Of this instrument; its errors are taken out first.
    gaps : {"stop", "bridge"}
        What is done where samples are missing.

    Raises
    ------
    FoucaultError
        No rest, no latitude, or axes, units and signs that are wrong: see `foucault.symptoms`.
    """
    require("site", site, Site)
    require("noise", noise, ImuNoise, none=True)
    require("calibration", calibration, Result, none=True)
    known_latitude(site)
    navigable(log)
    if len(rests):
        rests = numbers("rests", rests, (None, 2)).tolist()
        start, end = rests[-1]
    if start is None and end is None:  # a rest is looked for in all of it
        require_sound(log)
    log = without_spikes(log)
    begin = float(log.time[0])
    given = [(begin + a, before(log, b) if len(rests) > 1 else begin + b) for a, b in rests]
    spans = given if len(given) > 1 else []
    two: tuple[Method, ...] = ("two_position",) if spans else ()
    asked: tuple[Method, ...] = (methods,) if isinstance(methods, str) else tuple(methods)
    chosen = asked or two + METHODS
    for method in chosen:
        check_method(method)
    clean = log if calibration is None else calibration.apply(log)
    require_readings(clean)
    from_, until = _rest(log, start, end)
    # What comes after the rest is not used, nor are its gaps.
    used = clean[_rows(clean, [*given, (from_, until)])]
    whole = increments_of(used, gaps=gaps)
    if start is not None or end is not None:
        window(whole, from_, until)  # refuses what lies outside the log
    of_gyro, of_accel = bias_sds(None if calibration is None else calibration.coefficients)
    gyro_sd = of_gyro if gyro_bias_sd is None else gyro_bias_sd
    accel_sd = of_accel if accel_bias_sd is None else accel_bias_sd
    taken, told = _noise(log, noise, from_, until)
    rows = whole[window(whole, from_, until)]
    sensors = sensor_errors(rows, taken, gyro_sd, accel_sd)
    # What is plainly wrong is said before any method fails over it.
    for span in spans or [(from_, until)]:
        contradictions(whole[window(whole, *span)], site, sensors)
    if spans:
        of_increments(whole, spans)
    found = tuple(
        align(
            whole, site, method=method, start=from_, end=until, noise=taken,
            gyro_bias_sd=gyro_sd, accel_bias_sd=accel_sd,
            rests=given if method == "two_position" else (),
        )
        for method in chosen
    )  # fmt: skip
    f_b, w_ib_b, _ = measured_errors(rows, sensors)
    return Comparison(
        found, float(np.linalg.norm(w_ib_b)), latitude_seen(f_b, w_ib_b), site, taken,
        noise is None, gyro_sd, accel_sd,
        (*log.findings, *told, *judged(found, whole, site, sensors),
         *alignment_checks.hanging(found[0].C_nb, log.findings)),
    )  # fmt: skip


def _rows(log: Log, spans: Sequence[tuple[float, float]]) -> slice:
    """Return the rows of all spans, with those beside that feed the integration at their ends."""
    first, last = min(a for a, _ in spans), max(b for _, b in spans)
    if not log.time[0] - log.interval <= first < last <= log.time[-1] + 2 * log.interval:
        return slice(None)  # what lies outside the log is refused by all of it
    rows = np.searchsorted(log.time, [first, last], side="right")
    return slice(max(0, int(rows[0]) - BESIDE), int(rows[1]) + BESIDE)


def _rest(log: Log, start: float | None, end: float | None) -> tuple[float, float]:
    """Return where the rest begins and ends, as given or the first that is found [s]."""
    begin = float(log.time[0])
    if start is not None or end is not None:
        return begin + (start or 0.0), float(log.time[-1]) if end is None else before(log, end)
    seen = opening(log, Settings())
    return seen.start, float(log.time[-1]) if seen.still else seen.end


def _noise(
    log: Log, declared: ImuNoise | None, start: float, end: float
) -> tuple[ImuNoise | None, tuple[Finding, ...]]:
    """Return the noise as declared or as the rest shows it, and what is doubtful about it."""
    rows = slice(*np.searchsorted(log.time, [start, end]))
    short = rows.stop - rows.start < max(FEWEST, LEAST / log.interval)
    if short:
        return declared, ()
    noise, told, at_rest = in_rest(log[rows], declared)
    if at_rest is None:
        return noise, told
    check = at_rest.check
    more = () if check.passed else (finding("alignment.declared_noise", what=check.sentence),)
    return at_rest.noise, more


def judged(
    found: Sequence[Alignment], whole: Increments, site: Site, sensors: SensorErrors
) -> tuple[Finding, ...]:
    """Return what the data, the covariances and the methods among themselves tell.

    `whole`: the log [rad], [m/s]; `site`: where it stood, the latitude must be known.
    """
    one = next((a for a in found if a.rests), found[0])  # what holds all rests, if any does
    told = alignment_checks.checked(whole, site, one, sensors).findings
    codes = {f.code for f in told}
    swayed = bool(codes & {"alignment.sway", "alignment.turned"})
    otherwise = any(f.severity == "warning" for f in told)  # a step would explain that too
    return (
        *told,
        *(() if otherwise else alignment_checks.steps(found)),
        *alignment_checks.disagreement(found, swayed=swayed),
        *alignment_checks.innovations(found),
    )
