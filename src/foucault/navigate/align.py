"""Alignment: the attitude of an instrument from gravity and the Earth's rotation.

==============  ==================================================================================
two_vector      means of specific force and rate; for a body that does not move at all
inertial_frame  specific force integrated in inertial space; withstands sway and slow turns
kalman          the navigator corrected by zero or given velocity, biases estimated with it
two_position    the same over two rests with a turn between them: gyro biases show
==============  ==================================================================================

Of each the covariance is that of phi (E, N, U), ``C_nb_est = (I - [phi x]) C_nb_true``. No method
at rest in one position sees a gyro bias to the east: `Alignment.azimuth_bias_sd` says what it is
worth.

By two vectors, up is the direction of the mean specific force, which is fitted exactly; east is at
right angles to it and to the mean rate::

    u = f / |f|,   e = w x u / |w x u|,   C_nb = [e'; (u x e)'; u']

The part of the mean rate along up is not used: with up it says the latitude (`latitude_seen`).
Errors df, dw of the means, resolved in n, make the attitude error phi (E, N, U)::

    phi_E = -df_N / g,   phi_N = df_E / g,   phi_U = tan L df_E / g - dw_E / (w_ie cos L)

The body must not turn at all, and not sway much: a sway leaves a mean rate of its amplitude over
the length of the mean. `navigate.inertial_frame` withstands it.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., Artech House, 2013, section 5.6.2 (gyrocompassing), eqs. (5.105)-(5.107).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Literal, get_args

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, error, require, suggestion
from foucault.infer.linear_filter import Shock
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of, exp, turned
from foucault.navigate.fine_alignment import FineFit, by_velocity, two_position
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.inertial_frame import SensorErrors, inertial_frame, known_latitude
from foucault.tables import Log
from foucault.units import plain


def two_vector(f_b: FloatArray, w_ib_b: FloatArray) -> FloatArray:
    """Return C_nb, shape (3, 3), from the means of specific force and rate.

    `f_b` (3,): mean specific force, frame b, its direction is fitted exactly [m/s^2]; `w_ib_b`
    (3,): mean angular rate, frame b [rad/s].
    """
    east = np.cross(w_ib_b, f_b)
    size = float(np.linalg.norm(east))
    if not size > 0 or not np.isfinite(size):
        raise error("alignment.parallel", rate=np.linalg.norm(w_ib_b), force=np.linalg.norm(f_b))
    up, east = f_b / np.linalg.norm(f_b), east / size
    return np.array([east, np.cross(up, east), up])


def two_vector_slopes(latitude: float, gravity: float) -> tuple[FloatArray, FloatArray]:
    """Return d phi / d f_n and d phi / d w_n, each shape (3, 3).

    `latitude`: geodetic latitude, positive north [rad]; `gravity`: local gravity [m/s^2]. Returns
    `by_force` (3, 3): attitude error (E, N, U) per error of the mean specific force in n
    [rad/(m/s^2)]; `by_rate` (3, 3): the same per error of the mean rate in n [s].
    """
    by_force, by_rate = np.zeros((3, 3)), np.zeros((3, 3))
    by_force[0, 1], by_force[1, 0] = -1.0 / gravity, 1.0 / gravity
    by_force[2, 0] = np.tan(latitude) / gravity
    by_rate[2, 0] = -1.0 / (EARTH_RATE * np.cos(latitude))
    return by_force, by_rate


def two_vector_covariance(
    C_nb: FloatArray, latitude: float, gravity: float, f_cov: FloatArray, w_cov: FloatArray
) -> FloatArray:
    """Return the covariance of phi (E, N, U), shape (3, 3) [rad^2].

    `C_nb` (3, 3): the attitude found [1]; `latitude`: geodetic latitude, positive north [rad];
    `gravity`: local gravity [m/s^2]; `f_cov`, `w_cov` (3, 3): covariance of the means in b: noise
    and what the biases may be [m^2/s^4], [rad^2/s^2].
    """
    by_force, by_rate = (slope @ C_nb for slope in two_vector_slopes(latitude, gravity))
    return np.asarray(by_force @ f_cov @ by_force.T + by_rate @ w_cov @ by_rate.T)


def latitude_seen(f_b: FloatArray, w_ib_b: FloatArray) -> float:
    """Return the latitude that the means show, ``asin(f . w / (|f| |w|))`` [rad].

    `f_b` (3,): mean specific force, frame b [m/s^2]; `w_ib_b` (3,): mean angular rate, frame b
    [rad/s].
    """
    sine = f_b @ w_ib_b / (np.linalg.norm(f_b) * np.linalg.norm(w_ib_b))
    return float(np.arcsin(np.clip(sine, -1.0, 1.0)))


Method = Literal["inertial_frame", "two_vector", "kalman", "two_position"]

PARTS = 10
"""The means of so many parts of a window tell whether it is as quiet as declared [1]."""


@dataclass(frozen=True)
class Alignment:
    """Attitude at one instant, and how well it is known."""

    C_nb: FloatArray  # (3, 3) attitude at `time` [1]
    # (3, 3) covariance of phi, E N U: ``C_nb_est = (I - [phi x]) C_nb_true`` [rad^2]
    cov: FloatArray
    method: str  # how it was found
    time: float  # when it holds [s]
    # start, end: the window it was found from [s]
    start: float
    end: float
    # azimuth error that the declared gyro bias makes in one position, ``sd(b_E) / (w_ie cos L)``
    # [rad]
    azimuth_bias_sd: float
    findings: tuple[Finding, ...] = ()
    # (3,) standard deviation of the velocity of the disturbance, E N U, where measured [m/s]
    disturbance_sd: FloatArray | None = None
    gravity_seen: float = float("nan")  # size of gravity as the accelerometers say [m/s^2]
    # biases of gyros and accelerometers, where estimated [rad/s], [m/s^2]
    biases: CoefficientVector | None = None
    # (m,) normalised innovation squared of each epoch of a filter [1]
    nis: FloatArray | None = None
    dof: IntArray | None = None  # (m,) measurements in each [1]
    # as of `FineFit`: the time of each [s]
    steps: Mapping[str, tuple[Shock, float]] = field(default_factory=dict)
    rests: tuple[tuple[float, float], ...] = ()  # the rests of two positions [s]
    moving: bool = False  # whether a velocity was given

    @property
    def angles(self) -> FloatArray:
        """Return heading, pitch and roll, shape (3,) [rad]."""
        return angles_of(self.C_nb)

    @property
    def angles_sd(self) -> FloatArray:
        """Return the standard deviations of heading, pitch and roll, shape (3,) [rad]."""
        small = 1e-6 * np.eye(3)
        ways = [angles_of(exp(-side * small) @ self.C_nb) for side in (1.0, -1.0)]
        slopes = turned(ways[0] - ways[1]).T / 2e-6
        return np.sqrt(np.diag(slopes @ self.cov @ slopes.T))

    @property
    def heading_sd(self) -> float:
        """Return the standard deviation of the heading [rad]."""
        return float(np.sqrt(self.cov[2, 2]))


def window(increments: Increments, start: float | None = None, end: float | None = None) -> slice:
    """Return the rows of the intervals from `start` to `end` [s], None: of the log."""
    first, last = float(increments.time[0] - increments.dt[0]), float(increments.time[-1])
    start = first if start is None else start
    end = last if end is None else end
    usual = float(np.median(increments.dt))
    # A log of 300 s by its rate may lack a sample.
    if not (first - 2 * usual <= start < end <= last + 2 * usual):
        raise error("alignment.window", start=plain(start, 8), end=plain(end, 8),
                    first=plain(first, 8), last=plain(last, 8))  # fmt: skip
    return slice(*np.searchsorted(increments.time, [start + usual / 2, end + usual / 2]))


def measured_errors(
    increments: Increments, sensors: SensorErrors
) -> tuple[FloatArray, FloatArray, SensorErrors]:
    """Return the means of a rest, with the noise raised to what parts of it scatter by.

    `increments`: the window [rad], [m/s]. Returns `f_b`, `w_ib_b` (3,): mean specific force
    [m/s^2] and mean rate [rad/s]; `sensors`: as given where `PARTS` of the window scatter no more
    than their noise allows.
    """
    from foucault.infer.gauss_newton import chi_square_limits, student

    length = float(increments.dt.sum())
    each = len(increments) // PARTS
    if each < 1:
        raise error("alignment.too_short", given=plain(length),
                    least=plain(PARTS * float(np.median(increments.dt))))  # fmt: skip
    rows = np.s_[len(increments) - PARTS * each :]
    part = increments.dt[rows].reshape(PARTS, each).sum(axis=1)
    # Noise that no test of six axes at a false alarm of 1 % allows; only the upper limit counts.
    most = chi_square_limits(PARTS - 1, 0.02, 6)[1] / (PARTS - 1)
    psd = {}
    for name, x in (("gyro_psd", increments.dtheta_b), ("accel_psd", increments.dvel_b)):
        means = x[rows].reshape(PARTS, each, 3).sum(axis=1) / part[:, None]
        seen, said = means.var(axis=0, ddof=1) * part.mean(), getattr(sensors, name)
        psd[name] = np.where(seen > most * said, student(PARTS - 1) ** 2 * seen, said)
    f, w = (x.sum(axis=0) / length for x in (increments.dvel_b, increments.dtheta_b))
    return f, w, replace(sensors, **psd)


def align(
    log: Log | Increments,
    site: Site,
    *,
    method: Method = "inertial_frame",
    start: float | None = None,
    end: float | None = None,
    noise: ImuNoise | None = None,
    gyro_bias_sd: float = 0.0,
    accel_bias_sd: float = 0.0,
    velocity_n: FloatArray | None = None,
    velocity_sd: float = 0.0,
    rests: Sequence[tuple[float, float]] = (),
    gaps: Literal["stop", "bridge"] = "stop",
) -> Alignment:
    """Find the attitude at the end of a window.

    Parameters
    ----------
    log : Log or Increments
        Angular rate and specific force, compensated or not [SI].
    site : Site
        Where it stands; the latitude must be known.
    method : {"inertial_frame", "two_vector", "kalman", "two_position"}
        How.
    start, end : float or None
        Ends of the window; None is that of the log, or of the rests [s].
    noise : ImuNoise or None
        Noise of the sensors; None for none [SI].
    gyro_bias_sd, accel_bias_sd : float, shape ()
        Standard deviation of the bias of each sensor [rad/s], [m/s^2].
    velocity_n : ndarray, shape (n, 3), or None
        Velocity at every row of the log, E N U, of a vehicle that moves; not with two_vector and
        two_position [m/s].
    velocity_sd : float, shape ()
        Its standard deviation beside vibration and sway, which are measured; for kalman [m/s].
    rests : sequence of (float, float)
        Start and end of each rest, for two_position [s].
    gaps : {"stop", "bridge"}
        What is done where samples of a log are missing.

    Notes
    -----
    What can be wrong with the data is looked for by `diagnose.alignment.checked`.
    """
    check_method(method)
    latitude = known_latitude(site)
    whole = log if isinstance(log, Increments) else increments_of(log, gaps=gaps)
    if method == "two_position" and len(rests):
        start, end = rests[0][0], rests[-1][1]
    rows = window(whole, start, end)
    part = whole[rows]
    sensors = sensor_errors(part, noise, gyro_bias_sd, accel_bias_sd)
    velocity = None if velocity_n is None else velocity_n[rows]
    if method == "two_vector":
        found = _by_two_vectors(part, site, sensors)
    elif method == "inertial_frame":
        found = _in_inertial_space(part, site, sensors, velocity)
    elif method == "kalman":
        fine = by_velocity(part, site, sensors, velocity, velocity_sd)
        found = _fine(part, method, fine)
    else:
        found = _fine(part, method, two_position(part, site, sensors, rests))
    limit = azimuth_from_gyro_bias(sensors.gyro_bias_sd, latitude)
    return replace(
        found,
        azimuth_bias_sd=limit,
        findings=part.findings,
        rests=tuple(rests) if method == "two_position" else (),
        moving=velocity is not None and method != "two_vector",
    )


def check_method(given: str) -> None:
    """Refuse what is no `Method`, with a suggestion."""
    allowed = get_args(Method)
    if given not in allowed:
        raise error("alignment.method", given=given, hint=suggestion(str(given), allowed),
                    allowed=", ".join(allowed))  # fmt: skip


def sensor_errors(
    increments: Increments,
    noise: ImuNoise | None = None,
    gyro_bias_sd: float = 0.0,
    accel_bias_sd: float = 0.0,
) -> SensorErrors:
    """Return what the instrument errs by during a window.

    `increments`: the window [rad], [m/s]; `noise`: noise of the sensors, None for none [SI];
    `gyro_bias_sd`, `accel_bias_sd`: standard deviation of the bias of each sensor [rad/s],
    [m/s^2]. Raises ``alignment.sd``: one of them is negative, or no number.
    """
    for what, sd in (("gyro_bias_sd", gyro_bias_sd), ("accel_bias_sd", accel_bias_sd)):
        require(what, sd, Real)
        if not 0 <= sd < np.inf:
            raise error("alignment.sd", what=what, given=plain(sd))
    interval, length = float(np.median(increments.dt)), float(increments.dt.sum())
    return SensorErrors.declared(
        noise or ImuNoise(), interval, length, gyro_bias_sd, accel_bias_sd, increments.counted
    )


def _found(part: Increments, method: str, C_nb: FloatArray, cov: FloatArray) -> Alignment:
    end = float(part.time[-1])
    return Alignment(C_nb, cov, method, end, float(part.time[0] - part.dt[0]), end, 0.0)


def _by_two_vectors(part: Increments, site: Site, sensors: SensorErrors) -> Alignment:
    f_b, w_ib_b, noise = measured_errors(part, sensors)
    C_nb = two_vector(f_b, w_ib_b)
    covs = noise.mean_cov(float(part.dt.sum()))
    cov = two_vector_covariance(C_nb, known_latitude(site), site.gravity, *covs)
    cov = cov + _scatter(part, C_nb, sensors.gyro_psd)
    found = _found(part, "two_vector", C_nb, cov)
    return replace(found, gravity_seen=float(np.linalg.norm(f_b)))


def _scatter(part: Increments, C_nb: FloatArray, gyro_psd: FloatArray) -> FloatArray:
    """Return the covariance of the attitude about its mean, (3, 3), where it is more than noise.

    What is found from means is the mean attitude; at the end of the window a body that sways has
    another one, which is off by as much as any of the window.
    """
    length = float(part.dt.sum())
    rate = part.dtheta_b.sum(axis=0) / length
    angle = np.cumsum(part.dtheta_b - rate * part.dt[:, None], axis=0)
    peak = np.abs(angle).max(axis=0)
    if np.all(peak <= bridge_peak(gyro_psd, length)):
        return np.zeros((3, 3))
    return np.asarray(C_nb @ np.cov(angle.T) @ C_nb.T)


def bridge_peak(psd: FloatArray, length: float, false_alarm: float = 0.01) -> FloatArray:
    """Return what white noise hardly lets the angle of a window part from its straight line [rad].

    The angle less its trend from end to end is a Brownian bridge; its peak is beyond x with the
    probability ``2 exp(-2 x^2 / (psd length))``.

    `psd` (3,): white noise of the gyros [rad^2/s]; `length`: length of the window [s];
    `false_alarm`: probability that any axis is beyond [1].
    """
    return np.asarray(np.sqrt(psd * length * np.log(2 * len(psd) / false_alarm) / 2))


def _in_inertial_space(
    part: Increments, site: Site, sensors: SensorErrors, velocity_n: FloatArray | None
) -> Alignment:
    fit = inertial_frame(part, site, sensors, velocity_n)
    found = _found(part, "inertial_frame", fit.C_nb, fit.cov)
    return replace(found, disturbance_sd=fit.disturbance_sd, gravity_seen=fit.gravity_seen)


def _fine(part: Increments, method: str, fit: FineFit) -> Alignment:
    return replace(
        _found(part, method, fit.C_nb, fit.cov),
        disturbance_sd=fit.start.disturbance_sd,
        gravity_seen=fit.start.gravity_seen,
        biases=fit.run.estimate,
        nis=fit.nis,
        dof=fit.dof,
        steps=fit.steps,
    )
