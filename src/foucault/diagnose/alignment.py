"""What alignments say about their own data: motion, azimuth, and whether they agree.

Units, axes and signs are tried by `guard.rest`. Motion is judged by the alignment
in inertial space: what turned, and what velocity noise cannot explain.

A steady horizontal velocity adds to the specific force what a tilt adds, and to the rate of the
level what a gyro bias adds: no reading at rest shows it as motion. Methods that take the velocity
for zero are misled by it differently, and so they are by a vehicle that creeps, by a bias beyond
what was declared, and in two positions by triads that are both mirrored. So methods that differ
by more than their covariances allow, or innovations larger than predicted, tell that something is
wrong, not what.

Methods share their readings; the covariance of their difference is at most about the sum of both,
which is taken. Innovations that are too small are no fault: white noise counts twice in the
velocity of a quiet rest, as what is measured of the disturbance holds it too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.guard.rest import contradictions, of_increments
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models import rotation
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.navigate.align import Alignment, bridge_peak, window
from foucault.navigate.increments import Increments
from foucault.navigate.inertial_frame import InertialFit, SensorErrors, inertial_frame
from foucault.units import convert, plain

SURE = 5.0
"""A contradiction is one beyond this many standard deviations: one in a million by chance [1]."""

FALSE_ALARM = 1e-6  # And so are other findings [1].

TURNED = np.radians(1.0)
"""A standing vehicle does not turn by more as people walk about in it [rad]."""

LEFT = 1.0  # Nor does it move by more [m].

POOR = np.radians(5.0)
"""An azimuth of a larger standard deviation is no heading to navigate by [rad]."""

NEAR_POLE = 0.1
"""Cosine of the latitude below which the level part of the Earth's rate is small [1]."""

ALIKE = 1e-5  # Methods that differ by less agree: rounding, and terms of second order [rad].

WORDS = {
    "inertial_frame": "inertial frame",
    "kalman": "Kalman",
    "two_vector": "two vectors",
    "two_position": "two positions",
}


def checked(
    increments: Increments, site: Site, alignment: Alignment, sensors: SensorErrors
) -> Alignment:
    """Return an alignment with what its data and its covariance tell, `findings`.

    `increments`: the log, or the window that was aligned [rad], [m/s]; `site`: where it stood,
    the latitude must be known. Raises units, axes or signs are wrong beyond doubt.
    """
    found: list[Finding] = []
    if alignment.rests:
        of_increments(increments, alignment.rests)
    rests = alignment.rests or ((alignment.start, alignment.end),)
    for rest in () if alignment.moving else rests:
        part = increments[window(increments, *rest)]
        told = contradictions(part, site, sensors)
        moved = motion(part, site, sensors)
        if any(f.code != "alignment.gravity" for f in told):
            # Such gyros turn by themselves, or the Earth is taken to turn otherwise.
            moved = tuple(f for f in moved if f.code == "alignment.left_place")
        found += [*told, *moved]
    more = (*found, *azimuth(alignment, site))
    return replace(alignment, findings=(*alignment.findings, *more))


def hanging(C_nb: FloatArray, told: Sequence[Finding]) -> tuple[Finding, ...]:
    """Tell of `C_nb` (3, 3) [1] that z points down where nobody told the log how axes point."""
    if C_nb[2, 2] > -0.5 or all(f.code != "recognise.taken" for f in told):
        return ()
    both = C_nb, C_nb[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    given, other = (", ".join(f"{x:.1f}" for x in np.degrees(rotation.angles_of(C))) for C in both)
    return (finding("alignment.hanging", given=given, other=other),)


def motion(increments: Increments, site: Site, sensors: SensorErrors) -> tuple[Finding, ...]:
    """Tell sway in the window `increments` [rad], [m/s] from a turn and from leaving the place."""
    fit = inertial_frame(increments, site, sensors)
    turn, limit = _turned(fit, sensors)
    found = []
    if np.linalg.norm(turn) > max(TURNED, limit):
        found.append(
            finding("alignment.turned", angle=f"{np.degrees(np.linalg.norm(turn)):.2f}",
                    about_up=f"{np.degrees(turn[2]):.2f}", limit=f"{np.degrees(limit):.2g}")
        )  # fmt: skip
    speed, distance, most = _moved(fit, sensors, site)
    if distance > LEFT and speed > most:
        found.append(
            finding("alignment.left_place", distance=f"{distance:.1f}", speed=f"{speed:.2g}",
                    limit=f"{most:.2g}")
        )  # fmt: skip
    tilt = float(np.linalg.norm(turn[:2]))
    peak, quiet = _swayed(fit, sensors)
    # A steady tilt is left to the comparison of methods: a wrong azimuth looks like one.
    if not found and peak > quiet:
        length = float(fit.epochs[-1])
        azimuth = tilt / (length * float(earth_rate_n(site.latitude or 0.0)[1]))
        found.append(
            finding("alignment.sway", speed=f"{1e3 * fit.disturbance_sd.max():.2g}",
                    angle=plain(convert(tilt, "angle", "arcsec"), 3),
                    peak=plain(convert(peak, "angle", "arcsec"), 3),
                    azimuth=f"{np.degrees(azimuth):.2g}")
        )  # fmt: skip
    return tuple(found)


def _turned(fit: InertialFit, sensors: SensorErrors) -> tuple[FloatArray, float]:
    """Return the turn from the first epoch to the last in n, (3,), and what noise explains."""
    turn = rotation.log(fit.history[-1] @ fit.history[0].T)
    length = float(fit.epochs[-1])
    noise = np.sqrt(sensors.gyro_psd.max() * length) + sensors.gyro_bias_sd * length
    # The level and azimuth of the fit itself turn the Earth's rate: that part is no motion.
    own = np.sqrt(np.trace(fit.cov)) * EARTH_RATE * length
    return turn, float(SURE * (noise + own))


def _swayed(fit: InertialFit, sensors: SensorErrors) -> tuple[float, float]:
    """Return how far an axis parts from a steady turn, and what noise explains; no bias does."""
    angle = rotation.log(fit.history @ fit.history[0].T)
    along = ((fit.epochs - fit.epochs[0]) / (fit.epochs[-1] - fit.epochs[0]))[:, None]
    peak = np.abs(angle - along * angle[-1]).max()
    return float(peak), float(
        bridge_peak(sensors.gyro_psd, float(fit.epochs[-1]), FALSE_ALARM).max()
    )


def _moved(fit: InertialFit, sensors: SensorErrors, site: Site) -> tuple[float, float, float]:
    """Return largest speed, distance moved, and the speed that noise explains.

    Of noise, the velocity at the end without any fit: a level that walks off by white gyro noise,
    and white noise of the accelerometers. Sway comes back: its distance is small, however fast.
    """
    r = fit.disturbance_n - np.median(fit.disturbance_n, axis=0)
    step = np.diff(fit.epochs, prepend=0.0)[:, None]
    place = np.cumsum(r * step, axis=0)
    length = float(fit.epochs[-1])
    level = site.gravity * np.sqrt(sensors.gyro_psd.max() * length**3 / 3)
    noise = np.hypot(level, np.sqrt(sensors.accel_psd.max() * length))
    distance = float(np.linalg.norm(np.ptp(place, axis=0)))
    return float(np.linalg.norm(r, axis=1).max()), distance, float(SURE * noise)


def azimuth(alignment: Alignment, site: Site) -> tuple[Finding, ...]:
    """Tell whether an alignment shows north well enough to navigate by; latitude known."""
    assert site.latitude is not None
    found = []
    sd, level = alignment.heading_sd, float(np.cos(site.latitude))
    if sd > POOR:
        found.append(
            finding("alignment.azimuth", sd=f"{np.degrees(min(sd, np.pi)):.3g}",
                    bias=f"{np.degrees(min(alignment.azimuth_bias_sd, np.pi)):.3g}")
        )  # fmt: skip
    if level < NEAR_POLE:
        found.append(
            finding("alignment.near_pole", latitude=f"{np.degrees(site.latitude):.2f}",
                    share=f"{100 * level:.2g}", times=f"{1 / max(level, 1e-6):.3g}")
        )  # fmt: skip
    return tuple(found)


# -- methods beside one another ------------------------------------------------------------------


def disagreement(found: Sequence[Alignment], *, swayed: bool = False) -> tuple[Finding, ...]:
    """Tell which two of `found` differ most, beyond their covariances; `swayed`: the body moved."""
    used = [a for a in found if not (swayed and a.method == "two_vector")]
    worst, words = chi_square_limits(3, 2 * FALSE_ALARM)[1], None
    for one, other in combinations(used, 2):
        phi = rotation.log(other.C_nb @ one.C_nb.T)
        cov = one.cov + other.cov + ALIKE**2 * np.eye(3)
        size = float(phi @ np.linalg.solve(cov, phi))
        if size > worst:
            worst = size
            sds = np.abs(phi) / np.sqrt(np.diag(cov))
            about = int(np.argmax(sds))
            words = {
                "one": WORDS[one.method], "other": WORDS[other.method],
                "angle": plain(float(np.degrees(abs(phi[about]))), 3),
                "axis": ("east", "north", "up")[about],
                "sd": plain(float(np.degrees(np.sqrt(cov[about, about]))), 2),
            }  # fmt: skip
    return () if words is None else (finding("alignment.disagree", **words),)


def innovations(found: Sequence[Alignment]) -> tuple[Finding, ...]:
    """Tell which filters, of those with innovations, met velocities they had not predicted."""
    told = []
    for one in found:
        if one.nis is None or one.dof is None or not one.dof.sum():
            continue
        dof = int(one.dof.sum())
        ratio, most = float(one.nis.sum()) / dof, chi_square_limits(dof, 2 * FALSE_ALARM)[1] / dof
        if ratio > most:
            told.append(
                finding("alignment.innovations", method=WORDS[one.method], given=plain(ratio, 3),
                        most=plain(most, 3))
            )  # fmt: skip
    return tuple(told)


CHANGED = {
    "gyro.bias": "the bias of a gyro changed, or that of an accelerometer began to drift",
    "accel.bias": "the bias of an accelerometer changed, or the instrument tilted unnoticed",
}
"""What a step within a rest is, in words."""


def steps(found: Sequence[Alignment]) -> tuple[Finding, ...]:
    """Tell of the step of a bias that explains more of innovations than chance would."""
    each = [(one.square - one.limit, name, time) for a in found if not (a.moving or a.rests)
            for name, (one, time) in a.steps.items() if one.square > one.limit]  # fmt: skip
    if not each:
        return ()
    _, name, time = max(each)
    return (finding("alignment.step", what=CHANGED[name], time=f"{time:.0f}"),)
