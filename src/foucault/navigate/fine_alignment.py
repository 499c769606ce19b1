"""Fine alignment: the navigator runs on, and zero or given velocity corrects it and its biases.

States are attitude, velocity, position, three gyro and three accelerometer biases
(`navigate.ins_filter`). The start is that of the alignment in inertial space, from the same window;
so that no reading counts twice, the filter is told next to nothing of how good it is: what noise
and disturbance make of its covariance counts `LOOSE` times. What biases make of it is told as it
is, together with the biases. What is measured is the velocity at one instant, and its standard
deviation is that of the disturbance, vibration and rounding as they are in the window.

A gyro bias to the east and an error of azimuth look alike at rest. After a turn about up the same
bias points elsewhere: two rests with a turn between them tell them apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import error
from foucault.infer.linear_filter import Shock, stepped
from foucault.models import rotation
from foucault.models.earth import Site, gravity
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.increments import Increments
from foucault.navigate.inertial_frame import (
    InertialFit,
    SensorErrors,
    inertial_frame,
    known_latitude,
)
from foucault.navigate.ins_filter import FilterRun, Updates, run, start_cov
from foucault.navigate.strapdown import State
from foucault.units import plain

BIASES = ("gyro.bias", "accel.bias")
"""Sensor errors that are estimated beside the attitude."""

LOOSE = 100.0
"""The start is given so many times its covariance: it adds a hundredth of information [1]."""

START_SD = np.array([1e-4, 1e-4, 1e-2])
"""And is not taken to be better than this, which does not depend on the noise [rad]."""

UNKNOWN = 1.0
"""Nor worse [rad]."""

NOISES = ("disturbance", "gyro noise", "accelerometer noise")
"""Parts of the covariance of an alignment in inertial space that are not biases."""

SETTLING = 10
"""The first epochs find the start, and say nothing of consistency [1]."""

RARELY = 1e-6  # A step is found so often where there is none [1].

LEAST_TURN = np.radians(10.0)
"""Two positions are further apart than this in heading [rad]."""


@dataclass(frozen=True)
class FineFit:
    """What a fine alignment found."""

    run: FilterRun  # the filter, epoch by epoch
    C_nb: FloatArray  # (3, 3) attitude at the end [1]
    cov: FloatArray  # (3, 3) covariance of phi (E, N, U) at the end [rad^2]
    # (m,) normalised innovation squared of each epoch after the first `SETTLING` [1]
    nis: FloatArray
    dof: IntArray  # (m,) measurements in each [1]
    start: InertialFit  # the alignment in inertial space that it began with
    # what a step of the biases of gyros or accelerometers would explain best -> its time [s]
    steps: Mapping[str, tuple[Shock, float]]


def by_velocity(
    increments: Increments,
    site: Site,
    sensors: SensorErrors,
    velocity_n: FloatArray | None = None,
    velocity_sd: float = 0.0,
) -> FineFit:
    """Align by zero velocity, or by a velocity that is known.

    `increments`: the window [rad], [m/s]; `site`: where it begins, the latitude must be known;
    `velocity_n` (n, 3): velocity at the end of each interval, E N U, None at rest [m/s];
    `velocity_sd`: standard deviation of a given velocity beside the disturbance [m/s].
    """
    fit = inertial_frame(increments, site, sensors, velocity_n)
    rows = _epoch_rows(increments, fit)
    sd = np.full(len(rows) - 1, np.hypot(_level_sd(fit), velocity_sd))
    updates = Updates.at_rest(rows[1:], velocity_sd=sd)
    v0 = np.zeros(3)
    if velocity_n is not None:
        updates.velocity_n[:] = velocity_n[rows[1:]]
        v0 = velocity_n[rows[0]]
    found = _fine(increments, site, sensors, fit, rows[0], updates, v0)
    return found if velocity_n is not None else _no_better(found)


def _no_better(found: FineFit) -> FineFit:
    """Return a fit at rest whose azimuth is not better known than the gyro bias lets it be.

    The filter measures velocities with the disturbance as noise, and senses the same disturbance:
    it takes an azimuth that would turn the one against the other for seen, to 1/sqrt(2 m) rad in m
    epochs. That is nothing where gyros show north, and must not count where they do not.
    """
    lacking = found.start.parts["gyro bias"][2, 2] - found.cov[2, 2]
    return replace(found, cov=found.cov + np.diag([0.0, 0.0, max(lacking, 0.0)]))


def two_position(
    increments: Increments,
    site: Site,
    sensors: SensorErrors,
    rests: Sequence[tuple[float, float]],
) -> FineFit:
    """Align by two or more rests at different headings; what the gyro bias makes falls away.

    `increments`: from the start of the first rest to the end of the last [rad], [m/s]; `site`:
    where it stands, the latitude must be known; `rests`: start and end of each rest, in order
    [s].
    """
    ends = np.ravel(rests)
    slack = float(increments.dt.max())
    inside = len(ends) and ends[0] >= increments.time[0] - 2 * slack
    inside = inside and ends[-1] <= increments.time[-1] + slack
    if len(rests) < 2 or np.any(np.diff(ends) <= 0) or not inside:
        given = ", ".join(f"{plain(a, 8)} s to {plain(b, 8)} s" for a, b in rests)
        raise _not_two(f"The rests given are {given}" if given else "No rests are given")
    parts = [np.flatnonzero((increments.time > a) & (increments.time <= b)) for a, b in rests]
    fits = [inertial_frame(increments[p[0] : p[-1] + 1], site, sensors) for p in parts]
    rows = [p[0] + _epoch_rows(increments[p[0] : p[-1] + 1], f)
            for p, f in zip(parts, fits, strict=True)]  # fmt: skip
    turn = max(abs(rotation.log(f.history[-1] @ fits[0].history[-1].T)[2]) for f in fits[1:])
    if turn < LEAST_TURN:
        raise _not_two(f"The rests differ by {np.degrees(turn):.1f} deg in heading")
    sd = [np.full(len(r), _level_sd(f)) for r, f in zip(rows, fits, strict=True)]
    updates = Updates.at_rest(
        np.concatenate(rows)[1:].astype(np.int64), velocity_sd=np.concatenate(sd)[1:]
    )
    # Gravity is what the accelerometers saw in the first rest, their bias along up included; in
    # another attitude that is another one, so the vertical says nothing here.
    updates.sd[:, 2] = np.inf
    return _fine(increments, site, sensors, fits[0], rows[0][0], updates, np.zeros(3), held=True)


def _not_two(what: str) -> Exception:
    return error("alignment.two_rests", what=what, least=f"{np.degrees(LEAST_TURN):.0f}")


def _epoch_rows(increments: Increments, fit: InertialFit) -> IntArray:
    """Return the rows at which the epochs of a fit end, shape (m,)."""
    m = len(fit.epochs)
    per = len(increments) // m
    return len(increments) - 1 - per * np.arange(m - 1, -1, -1)


def _level_sd(fit: InertialFit) -> float:
    return float(np.sqrt(np.mean(fit.instant_sd**2)))


def _fine(
    increments: Increments,
    site: Site,
    sensors: SensorErrors,
    fit: InertialFit,
    first: int,
    updates: Updates,
    velocity_n: FloatArray,
    *,
    held: bool = False,
) -> FineFit:
    latitude = known_latitude(site)
    model = Sensors.of(BIASES)
    biases = np.repeat([sensors.gyro_bias_sd, sensors.accel_bias_sd], 3)
    speed_sd = float(np.sqrt(LOOSE)) * max(_level_sd(fit), float(updates.sd[0, 0]))
    found = run(
        increments,
        replace(State.at_rest(fit.history[0], latitude, 0.0, site.height), velocity_n=velocity_n),
        model,
        updates,
        _start_cov(fit, speed_sd, biases),
        _noise(sensors),
        first=int(first),
        # The accelerometers cannot tell gravity from their own scale: what they see is taken.
        gravity_offset=fit.gravity_seen - gravity(latitude, site.height),
        held=held,
        keep=True,
    )
    late = slice(SETTLING, None)
    C_nb = found.trajectory.C_nb[-1]
    lam, adj = found.adjoint
    ways = {name: model.states.group(name) for name in BIASES}
    steps = {
        name: (one, float(found.time[late][one.epoch]))
        for name, one in stepped(lam[late], adj[late], ways, false_alarm=RARELY).items()
    }
    nis, dof = found.nis[late], found.measured[late]
    return FineFit(found, C_nb, found.attitude_cov, nis, dof, fit, steps)


def _start_cov(fit: InertialFit, speed_sd: float, biases: FloatArray) -> FloatArray:
    """Return the covariance of the start: loose, but for what attitude and biases share."""
    loose = LOOSE * sum(np.diag(fit.parts[name]) for name in NOISES) + START_SD**2
    P = start_cov(np.diag(np.minimum(loose, UNKNOWN**2)), speed_sd, 0.0, biases)
    shared = fit.first_by_bias * biases**2
    P[:3, :3] += shared @ fit.first_by_bias.T
    P[:3, 9:] = shared
    P[9:, :3] = shared.T
    return P


def _noise(sensors: SensorErrors) -> ImuNoise:
    """Return the white noise as the filter takes it: one value for the axes of a triad."""
    gyro, accel = (float(np.sqrt(np.mean(p))) for p in (sensors.gyro_psd, sensors.accel_psd))
    return ImuNoise(accel=TriadNoise(white=accel), gyro=TriadNoise(white=gyro))
