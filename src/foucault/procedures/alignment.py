"""Align a log at rest by several methods side by side, and say how sure each of them is.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 5.6.2 (levelling, gyrocompassing).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.diagnose import alignment_checks
from foucault.errors import Finding
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.navigate.align import (
    Alignment,
    Method,
    align,
    check_method,
    measured_errors,
    sensor_errors,
    window,
)
from foucault.navigate.increments import increments_of
from foucault.navigate.inertial_frame import known_latitude
from foucault.navigate.two_vector import latitude_seen
from foucault.procedures.navigation_run import bias_sds
from foucault.procedures.navigation_settings import Settings
from foucault.procedures.navigation_start import opening
from foucault.result import Result
from foucault.tables import Log

METHODS: tuple[Method, ...] = ("inertial_frame", "kalman", "two_vector")
"""Methods for one rest, the one to go by first."""


@dataclass(frozen=True)
class Comparison:
    """What several methods of alignment say of the same log.

    Attributes
    ----------
    found : tuple of Alignment
        One per method, the one to go by first.
    rate_seen : float
        Size of the mean rate in the rest [rad/s].
    latitude_seen : float
        Latitude that gravity and the mean rate show [rad].
    site : Site
        Where it stood.
    noise : ImuNoise or None
        White noise of the sensors that was taken [SI].
    measured : bool
        Whether it was measured in the rest.
    gyro_bias_sd, accel_bias_sd : float
        How well the biases were taken to be known [rad/s], [m/s^2].
    findings : tuple of Finding
        What was noticed.
    """

    found: tuple[Alignment, ...]
    rate_seen: float
    latitude_seen: float
    site: Site
    noise: ImuNoise | None
    measured: bool
    gyro_bias_sd: float
    accel_bias_sd: float
    findings: tuple[Finding, ...]


def align_log(
    log: Log,
    *,
    site: Site,
    methods: Sequence[Method] = (),
    start: float | None = None,
    end: float | None = None,
    rests: Sequence[tuple[float, float]] = (),
    noise: ImuNoise | None = None,
    gyro_bias_sd: float | None = None,
    accel_bias_sd: float | None = None,
    calibration: Result | None = None,
) -> Comparison:
    """Align a log by several methods.

    Parameters
    ----------
    log : Log
        Readings as measured [SI].
    site : Site
        Where it stood; the latitude must be known.
    methods : sequence of {"inertial_frame", "kalman", "two_vector", "two_position"}
        Methods; none for `METHODS`, and "two_position" first where there are rests.
    start, end : float or None
        The rest, from the start of the log; None: the first that is found [s].
    rests : sequence of (float, float)
        Two or more rests at different headings, from the start of the log [s]. Methods for one
        rest take the last of them.
    noise : ImuNoise or None
        White noise of the sensors; None measures it in the rest [SI].
    gyro_bias_sd, accel_bias_sd : float or None
        How well the biases are known; None takes that of the calibration, else zero
        [rad/s], [m/s^2].
    calibration : Result or None
        Of this instrument; its errors are taken out first.

    Raises
    ------
    FoucaultError
        No rest, no latitude, or axes, units and signs that are wrong: see `foucault.symptoms`.
    """
    known_latitude(site)
    two: tuple[Method, ...] = ("two_position",) if len(rests) else ()
    chosen = tuple(methods) or two + METHODS
    for method in chosen:
        check_method(method)
    begin = float(log.time[0])
    spans = [(begin + a, begin + b) for a, b in rests]
    if spans:
        start, end = rests[-1]
    clean = log if calibration is None else calibration.apply(log)
    whole = increments_of(clean)
    said, part = None, log
    if start is not None or end is not None:
        from_, until = start or 0.0, log.duration if end is None else end
        window(whole, begin + from_, begin + until)  # refuses what lies outside the log
        said, part = until - from_, log[int(np.searchsorted(log.time, begin + from_)) :]
    seen = opening(part, Settings(align=said))
    stop = float(log.time[-1]) if seen.still and said is None else seen.end
    of_gyro, of_accel = bias_sds(None if calibration is None else calibration.coefficients)
    gyro_sd = of_gyro if gyro_bias_sd is None else gyro_bias_sd
    accel_sd = of_accel if accel_bias_sd is None else accel_bias_sd
    taken = noise or seen.noise
    rows = whole[window(whole, seen.start, stop)]
    sensors = sensor_errors(rows, taken, gyro_sd, accel_sd)
    # What is plainly wrong is said before any method fails over it.
    alignment_checks.contradictions(rows, site, sensors)
    if spans:
        alignment_checks.check_turns(whole, spans)
    found = tuple(
        align(
            whole, site, method=method, start=seen.start, end=stop, noise=taken,
            gyro_bias_sd=gyro_sd, accel_bias_sd=accel_sd,
            rests=spans if method == "two_position" else (),
        )
        for method in chosen
    )  # fmt: skip
    one = next((a for a in found if a.method != "two_position"), found[0])
    told = alignment_checks.checked(rows, site, replace(one, findings=()), sensors).findings
    f_b, w_ib_b, _ = measured_errors(rows, sensors)
    return Comparison(
        found, float(np.linalg.norm(w_ib_b)), latitude_seen(f_b, w_ib_b), site, taken,
        noise is None, gyro_sd, accel_sd, (*log.findings, *whole.findings, *told),
    )  # fmt: skip
