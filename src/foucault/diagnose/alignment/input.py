"""What a window of alignment says about its own data: units, axes, signs, motion, azimuth.

At rest the mean specific force is gravity and the mean rate the Earth's, so that::

    |f| = g,    |w| = w_ie,    f . w / |f| = w_ie sin L

What contradicts them is tried on the usual mistakes; where one explains it, and the Earth's rate
stands out of noise and declared bias, it is named. Motion is judged by the alignment in inertial
space: what turned, and what velocity noise cannot explain.

One rest shows only what lies along up. What leaves f . w as it is cannot show: triads that are both
mirrored, or both turned, alike (two columns swapped or one sign wrong in both). Of several rests,
`check_turns` asks `diagnose.axes` whether the gyros turn up as the accelerometers do; mirrored
triads show there where a turn tilts the instrument, and not where it turns about up alone (by other
angles than half a turn, the methods of alignment then contradict one another).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.axes import exchange_words, exchanges, explain_turns, mistake
from foucault.diagnose.force_at_rest import wrong_force
from foucault.errors import Finding, error, finding
from foucault.models import rotation
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.navigate.align import Alignment, bridge_peak, measured_errors, window
from foucault.navigate.increments import Increments
from foucault.navigate.inertial_frame import InertialFit, inertial_frame
from foucault.navigate.sensor_errors import SensorErrors
from foucault.navigate.two_vector import latitude_seen
from foucault.tables import Log
from foucault.units import convert, plain

SURE = 5.0
"""A contradiction is one beyond this many standard deviations: one in a million by chance [1]."""

FALSE_ALARM = 1e-6
"""And so are other findings [1]."""

OFF_GRAVITY = 0.002
"""Accelerometers fit to navigate by see gravity within this part, calibrated or not [1]."""

RATE_BAND = 0.2
"""A factor explains a rate that is the Earth's within this part [1]."""

TURNED = np.radians(1.0)
"""A standing vehicle does not turn by more as people walk about in it [rad]."""

LEFT = 1.0
"""Nor does it move by more [m]."""

POOR = np.radians(5.0)
"""An azimuth of a larger standard deviation is no heading to navigate by [rad]."""

NEAR_POLE = 0.1
"""Cosine of the latitude below which the level part of the Earth's rate is small [1]."""

GROSS = 0.03
"""Axes are suspected where what lies along up is off by more than this part of the Earth's rate,
0.45 deg/h: less may be a bias, and some exchange of axes that read little explains any [1]."""

SHOWN = 3
"""Exchanges of axes that are named [1]."""


@dataclass(frozen=True)
class _Means:
    """Means over the window, and what they may be off by."""

    f: FloatArray
    w: FloatArray
    f_sd: float  # worst axis
    w_sd: float
    site: Site
    latitude: float

    @property
    def along_up(self) -> float:
        return float(self.f @ self.w / np.linalg.norm(self.f))

    @property
    def along_up_sd(self) -> float:
        level = float(np.linalg.norm(self.w)) * self.f_sd / self.site.gravity
        return float(np.hypot(self.w_sd, level))

    @property
    def wanted(self) -> float:
        return float(EARTH_RATE * np.sin(self.latitude))


def checked(
    increments: Increments, site: Site, alignment: Alignment, sensors: SensorErrors
) -> Alignment:
    """Return an alignment with what its data and its covariance tell, `findings`.

    `increments`: the log, or the window that was aligned [rad], [m/s]; `site`: where it stood,
    the latitude must be known. Raises units, axes or signs are wrong beyond doubt.
    """
    found: list[Finding] = []
    if alignment.rests:
        check_turns(increments, alignment.rests)
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


def contradictions(
    increments: Increments, site: Site, sensors: SensorErrors
) -> tuple[Finding, ...]:
    """Compare the means of a rest with gravity and the Earth's rate.

    `increments`: one rest [rad], [m/s]; `site`: where it stood, the latitude must be known.
    Raises A wrong unit, axis or sign explains what the data contradict.
    """
    assert site.latitude is not None
    f, w, noise = measured_errors(increments, sensors)
    f_cov, w_cov = noise.mean_cov(float(increments.dt.sum()))
    sds = [float(np.sqrt(np.diag(cov).max())) for cov in (f_cov, w_cov)]
    means = _Means(f, w, sds[0], sds[1], site, site.latitude)
    interval = float(np.median(increments.dt))
    told = _check_force(means, interval)
    if SURE * means.w_sd > EARTH_RATE:
        return told  # the Earth's rate does not stand out
    _check_rate(means, interval)
    return told + _vertical(means)


def _check_force(means: _Means, interval: float) -> tuple[Finding, ...]:
    seen, given = float(np.linalg.norm(means.f)), means.site.gravity
    if (problem := wrong_force(seen, given, interval)) is not None:
        raise problem
    if abs(seen - given) < max(OFF_GRAVITY * given, SURE * means.f_sd):
        return ()
    return (finding("alignment.gravity", seen=f"{seen:.5g}", given=f"{given:.5g}",
                    off=f"{100 * (seen / given - 1):+.2g}"),)  # fmt: skip


def _check_rate(means: _Means, interval: float) -> None:
    size = float(np.linalg.norm(means.w))
    if abs(size - EARTH_RATE) < max(RATE_BAND * EARTH_RATE, SURE * means.w_sd):
        return
    causes = {
        180 / np.pi: "the unit is rad/s and was declared as deg/s",
        np.pi / 180: "the unit is deg/s and was declared as rad/s",
        1 / interval: "the gyro columns are increments and were declared as rates",
        interval: "the gyro columns are rates and were declared as increments",
    }
    factor = min(causes, key=lambda x: abs(np.log(x * max(size, 1e-300) / EARTH_RATE)))
    # A unit changes what lies along up as much; a bias of that size hardly does.
    off = max(abs(factor * size - EARTH_RATE),
              abs(abs(factor * means.along_up) - abs(means.wanted)))  # fmt: skip
    if off < RATE_BAND * EARTH_RATE:
        words = {"factor": f"{factor:.4g}", "then": _dph(factor * size), "cause": causes[factor]}
        raise error("alignment.gyro_unit", given=_dph(size), earth=_dph(EARTH_RATE), **words)


def _vertical(means: _Means) -> tuple[Finding, ...]:
    """Check f . w against g w_ie sin L."""
    sd, seen, wanted = means.along_up_sd, means.along_up, means.wanted
    if abs(seen - wanted) < SURE * sd:
        return ()
    words = {"given": _dph(seen), "wanted": _dph(wanted), "sd": _dph(sd)}
    size = float(np.linalg.norm(means.w))
    whole = abs(size - EARTH_RATE) < SURE * means.w_sd
    # Biases that nobody declared are small against the Earth's rate where its sign is turned.
    clear = min(abs(wanted), size) > RATE_BAND * EARTH_RATE > abs(size - EARTH_RATE)
    near = SURE * sd if whole else RATE_BAND * abs(wanted) if clear else 0.0
    if abs(seen + wanted) < near:
        raise error("alignment.vertical_sign", **words)
    gross = abs(seen - wanted) > GROSS * EARTH_RATE
    fits = _fitting(means) if whole and gross else []
    latitude = latitude_seen(means.f, means.w)
    if fits:
        more = [exchange_words(x) for x in fits[1:SHOWN]]
        raise error("alignment.axes", exchange=exchange_words(fits[0]),
                    more="".join(f", or {m}" for m in more)
                    + (f", and {len(fits) - SHOWN} more" if len(fits) > SHOWN else ""),
                    latitude=f"{abs(np.degrees(latitude)):.2f}", **words)  # fmt: skip
    if whole:
        sd_latitude = sd / (EARTH_RATE * max(np.cos(latitude), NEAR_POLE))
        return (finding("alignment.latitude", seen=f"{np.degrees(latitude):.2f}",
                        sd=f"{np.degrees(sd_latitude):.2g}",
                        declared=f"{np.degrees(means.latitude):.2f}"),)  # fmt: skip
    return (finding("alignment.earth_rate", given=_dph(size), vertical=_dph(seen),
                    earth=_dph(EARTH_RATE), wanted=_dph(wanted), sd=_dph(sd)),)  # fmt: skip


def _fitting(means: _Means) -> list[FloatArray]:
    """Return the exchanges of gyro axes that would fit, those that change least first."""
    up = means.f / np.linalg.norm(means.f)
    tried = exchanges()[1:]
    fits = [x for x in tried if abs(up @ x @ means.w - means.wanted) < SURE * means.along_up_sd]
    # A swap of two columns or one sign is likelier than both; what keeps an axis, than what not.
    return sorted(fits, key=lambda x: 3 - np.trace(np.abs(x)) + 0.6 * np.sum(x < 0))


def check_turns(increments: Increments, rests: Sequence[tuple[float, float]]) -> None:
    """Refuse gyro axes or units that the turns between the rests of an alignment contradict.

    `increments`: the log [rad], [m/s]; `rests`: start and end of each rest, in order [s]. Raises
    an exchange of axes or another unit explains how up turned from rest to rest.
    """
    dt = increments.dt[:, None]
    log = Log(increments.time, increments.dtheta_b / dt, increments.dvel_b / dt, "increment")
    rows = [np.flatnonzero((log.time > a) & (log.time <= b)) for a, b in rests]
    assert log.gyro is not None and log.accel is not None
    up_b = np.array([log.accel[r].mean(axis=0) for r in rows])
    up_b /= np.linalg.norm(up_b, axis=1)[:, None]
    bias = np.mean([log.gyro[r].mean(axis=0) for r in rows], axis=0)
    first, last = (np.array([r[k] for r in part]) for k, part in ((-1, rows[:-1]), (0, rows[1:])))
    problem = mistake(log, *explain_turns(log, up_b, bias, first, last))
    if problem is not None:
        raise problem


def motion(increments: Increments, site: Site, sensors: SensorErrors) -> tuple[Finding, ...]:
    """Tell harmless sway in a window from a turn and from leaving the place.

    `increments`: the window [rad], [m/s]; `site`: where it stood, the latitude must be known.
    """
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
    """Tell whether an alignment shows north well enough to navigate by.

    `site`: where it stood, the latitude must be known.
    """
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


def _dph(rate: float) -> str:
    return f"{convert(rate, 'angular rate', 'deg/h'):.4g}"
