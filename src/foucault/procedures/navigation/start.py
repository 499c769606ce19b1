"""Where a navigation starts: what was chosen, the rest, and the attitude that is found in it.

What can be chosen where a log is navigated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from foucault.arrays import FloatArray
from foucault.detect.noise import KNOCKS, without_spikes
from foucault.detect.stretches import How, Rests, find_rests
from foucault.diagnose import alignment as alignment_checks
from foucault.diagnose.alignment import POOR
from foucault.diagnose.noise_at_rest import FEWEST, NoiseAtRest, held_against, noise_of
from foucault.errors import Finding, error
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.noise import ImuNoise
from foucault.models.rotation import matrix_of
from foucault.navigate.align import Alignment, align, sensor_errors, window
from foucault.navigate.increments import Increments, increments_of
from foucault.procedures.record import Stretch
from foucault.tables import Log
from foucault.units import Angle, Length, Quantity, Seconds, Velocity, plain

USUAL = 300.0  # Length of the alignment in a log that rests all along, where nothing is said [s].
PART = 1 / 3  # At most this part of such a log is used for it [1].
LEAST = 10.0  # Shortest rest that is used without being told [s].
WHOLE = 0.95  # A rest that covers this part of a log: the log does not move [1].
CONSTANT = 1e-8  # Readings that change by less are constant [rad/s], [m/s^2].

SEES = 0.5
"""A mean rate at rest that differs from the Earth's by more of it does not show north [1]."""


@dataclass(frozen=True)
class Opening:
    """What the start of a log looks like."""

    # start, end: the rest used for alignment, of the log's clock; equal where there is none [s]
    start: float
    end: float
    still: bool  # whether the whole log is at rest
    found: bool  # whether the rest was found in the readings, or said
    noise: ImuNoise | None  # white noise measured in the rest [SI]
    told: tuple[Finding, ...] = ()  # what is doubtful about that noise
    against: NoiseAtRest | None = None  # the noise that was declared, held against that of the rest


@dataclass(frozen=True)
class Start:
    """The attitude at which a navigation starts."""

    C_nb: FloatArray  # (3, 3) attitude [1]
    # (3, 3) covariance of phi (E, N, U) by sensor noise, and by what was given [rad^2]
    phi_cov: FloatArray
    time: float  # when it holds [s]
    method: str  # how it was found: a method of alignment, "level and given heading", or "given"
    velocity_sd: float = 0.0  # standard deviation of each component of the velocity [m/s]
    # standard deviation of the place, along each of east, north and up [m]
    position_sd: float = 0.0
    findings: tuple[Finding, ...] = ()


def opening(log: Log, settings: Settings, declared: ImuNoise | None = None) -> Opening:
    """Find the rest at the start of a log.

    `log`: the part that is used, as measured [SI]; `declared` or None: noise that is held against
    the rest [SI]. Raises ``navigate.no_rest``: none was found, and nothing was said.
    """
    log = without_spikes(log, most=KNOCKS)
    rests = find_rests(log, How(window=max(0.5, 51 * log.interval)))
    longest = int(np.max(rests.last - rests.first, initial=0))
    still = longest + rests.window >= WHOLE * len(log) or all(
        x is not None and np.ptp(x, axis=0).max() < CONSTANT for x in (log.accel, log.gyro)
    )
    first = float(log.time[0])
    if settings.align is not None:
        return _said(log, first, before(log, settings.align), still, rests, declared)
    if settings.attitude_given:
        quiet = len(rests) > 0 and rests.first[0] <= rests.window
        return Opening(first, first, still, quiet, *_noise(log, rests, None, declared))
    if still:
        return _said(log, first, first + min(USUAL, PART * log.duration), still, rests, declared)
    lengths = log.time[np.maximum(rests.last - 1, 0)] - log.time[rests.first]
    long = np.flatnonzero(lengths >= LEAST)
    if not len(long):
        raise error("navigate.no_rest", least=plain(LEAST), where="in the log")
    a, b = int(rests.first[long[0]]), int(rests.last[long[0]]) - 1
    return Opening(float(log.time[a]), float(log.time[b]), still, True,
                   *_noise(log, rests, (a, b + 1), declared))  # fmt: skip


def before(log: Log, length: float) -> float:
    """Return the stamp of the last sample of a part at the start of a log, shape () [s].

    The first sample counts as one: 300 s at 20 Hz are 6000 samples, stamped 0 to 299.95 s, and the
    one of 300 s belongs to what comes next.

    `length`: of the part [s].
    """
    end = float(log.time[0]) + length
    last = int(np.searchsorted(log.time, end - 0.5 * log.interval)) - 1
    # Samples of a moment are integrated by the one after too.
    last -= log.sampled != "increment"
    return float(log.time[max(last, 1)]) if end <= log.time[-1] + log.interval else end


def _said(
    log: Log, start: float, end: float, still: bool, rests: Rests, declared: ImuNoise | None
) -> Opening:
    first, last = (int(k) for k in np.searchsorted(log.time, [start, end]))
    return Opening(start, end, still, False, *_noise(log, rests, (first, last), declared))


def _noise(
    log: Log, rests: Rests, rows: tuple[int, int] | None, declared: ImuNoise | None
) -> tuple[ImuNoise | None, tuple[Finding, ...], NoiseAtRest | None]:
    """Measure white noise in a rest, in the longest where none is given."""
    if rows is None and len(rests):
        k = int(np.argmax(rests.last - rests.first))
        rows = (int(rests.first[k]), int(rests.last[k]))
    if rows is None or rows[1] - rows[0] < max(FEWEST, LEAST / log.interval):
        return None, (), None
    return in_rest(log[slice(*rows)], declared)


def in_rest(
    rest: Log, declared: ImuNoise | None
) -> tuple[ImuNoise, tuple[Finding, ...], NoiseAtRest | None]:
    """Return the white noise of a rest, a note where it is not clear, and what was declared of it.

    `declared` or None: noise that is held against it [SI].
    """
    noise, told = noise_of(rest)
    return noise, told, None if declared is None else held_against(rest, declared, noise)


def start_of(log: Log, site: Site, seen: Opening, settings: Settings, noise: ImuNoise) -> Start:
    """Find the attitude at the end of the rest, by noise alone uncertain.

    `log`: readings of the rest, compensated or not [SI]; `site`: where it stood, the latitude must
    be known; `settings`: how it is aligned, and what attitude is given.
    """
    return replace(_turned(log, site, seen, settings, noise),
                   position_sd=settings.position_sd or 0.0)  # fmt: skip


def _turned(log: Log, site: Site, seen: Opening, settings: Settings, noise: ImuNoise) -> Start:
    if settings.attitude_given:
        assert settings.heading is not None
        assert settings.pitch is not None
        assert settings.roll is not None
        C_nb = matrix_of(settings.heading, settings.pitch, settings.roll)
        sd = np.array([settings.level_sd, settings.level_sd, settings.heading_sd])
        return Start(C_nb, np.diag(sd**2), seen.end, "given",
                     velocity_sd=settings.start_velocity_sd)  # fmt: skip
    if settings.heading is not None:
        return _levelled(log, site, seen, settings, noise)
    found = align(
        log, site, method=settings.method, start=seen.start, end=seen.end, noise=noise,
        gaps=settings.gaps,
    )  # fmt: skip
    sway = 0.0 if found.disturbance_sd is None else float(np.mean(found.disturbance_sd))
    return Start(found.C_nb, found.cov, found.time, found.method, velocity_sd=sway,
                 findings=found.findings)  # fmt: skip


def _window(log: Log, seen: Opening, gaps: Literal["stop", "bridge"]) -> Increments:
    whole = increments_of(log, gaps=gaps)
    return whole[window(whole, seen.start, seen.end)]


def _levelled(log: Log, site: Site, seen: Opening, settings: Settings, noise: ImuNoise) -> Start:
    """Take pitch and roll from the mean specific force, the heading as given."""
    part = _window(log, seen, settings.gaps)
    length = float(part.dt.sum())
    f = part.dvel_b.sum(axis=0) / length
    up = f / np.linalg.norm(f)
    assert settings.heading is not None
    C_nb = matrix_of(settings.heading, np.arcsin(up[1]), np.arctan2(-up[0], up[2]))
    level = noise.accel.white**2 / length / site.gravity**2
    cov = np.diag([level, level, settings.heading_sd**2])
    return Start(C_nb, cov, float(part.time[-1]), "level and given heading")


def judged(
    start: Start, log: Log, site: Site, seen: Opening, noise: ImuNoise,
    bias_sd: tuple[float, float], rests: bool = True,
) -> Start:  # fmt: skip
    """Return a start with what its data say of axes, units, motion and heading.

    `log`: readings of the rest, compensated [SI]; `bias_sd`: how well the biases of gyros [rad/s]
    and accelerometers [m/s^2] are known; `rests`: whether a log that looks still is, a steady drive
    does so too. Raises ``navigate.heading``: the gyros do not show north, and no heading is given;
    or axes, units or signs that are wrong.
    """
    if seen.end <= seen.start:  # the attitude is given
        if not (seen.still and rests):
            return start
        seen = replace(seen, end=float(log.time[-1]))
    part = _window(log, seen, "bridge")
    sensors = sensor_errors(part, noise, *bias_sd)
    assert site.latitude is not None
    limit = azimuth_from_gyro_bias(bias_sd[0], site.latitude)
    alone = Alignment(start.C_nb, start.phi_cov, start.method, start.time, seen.start, seen.end,
                      limit, start.findings)  # fmt: skip
    # Wrong units show no north either: they are told first.
    found = alignment_checks.checked(part, site, alone, sensors).findings
    found += alignment_checks.hanging(start.C_nb, log.findings)
    if start.method in ("given", "level and given heading"):  # of north nothing is asked
        of_north = ("alignment.azimuth", "alignment.sway")
        return replace(start, findings=tuple(f for f in found if f.code not in of_north))
    shows_north(log, site, seen, start, bias_sd[0], found)
    return replace(start, findings=found)


def shows_north(
    log: Log, site: Site, seen: Opening, start: Start, gyro_bias_sd: float = 0.0,
    told: tuple[Finding, ...] = (),
) -> None:  # fmt: skip
    """Refuse a heading that the rest does not show.

    `log`: readings of the rest, compensated or not [SI]; `gyro_bias_sd`: how well the gyro biases
    are known [rad/s]. Raises ``navigate.heading``: the gyros do not show north.
    """
    assert site.latitude is not None
    part = _window(log, seen, "bridge")
    rate = float(np.linalg.norm(part.dtheta_b.sum(axis=0) / part.dt.sum()))
    sd = float(
        np.hypot(np.sqrt(start.phi_cov[2, 2]), azimuth_from_gyro_bias(gyro_bias_sd, site.latitude))
    )
    off = abs(rate - EARTH_RATE) > SEES * EARTH_RATE
    if sd <= POOR and not off:
        return
    why = f"the rest shows the heading to {plain(np.degrees(min(sd, np.pi)), 3)} deg only"
    if off:
        seen_rate, earth = (plain(3600 * np.degrees(v), 3) for v in (rate, EARTH_RATE))
        why = (
            f"the gyros read {seen_rate} deg/h at rest where the Earth turns at {earth} deg/h, and "
            "show no north"
        )
    moved = [f for f in told if f.code in ("alignment.left_place", "alignment.turned")]
    level = _level_rate(part)
    if off and level is not None and level > SEES * EARTH_RATE:
        why += (
            ". By the accelerometers it stands still, so that this is their bias, "
            f"{plain(np.degrees(level), 3)} deg/s or more: take it off with a calibration"
        )
    elif moved:
        why += f". It was no rest: {moved[0].message.rstrip('.')}"
    raise error("navigate.heading", why=why)


STEADY = np.radians(1.0)  # Gravity that turns by less than this in the body shows no tilt [rad].


def _level_rate(part: Increments) -> float | None:
    """Return the mean rate across gravity [rad/s]; None unless it alone would have turned gravity.

    A body that turns about a level axis takes gravity round with it. Where the accelerometers do
    not see that, the gyros have a bias; about up a bias and a turn look alike.
    """
    quarter = max(1, len(part.dt) // 4)
    ends = [part.dvel_b[:quarter].sum(axis=0), part.dvel_b[-quarter:].sum(axis=0)]
    first, last = (v / max(float(np.linalg.norm(v)), 1e-300) for v in ends)
    up = first + last
    up = up / max(float(np.linalg.norm(up)), 1e-300)
    time = float(part.dt.sum())
    w = part.dtheta_b.sum(axis=0) / time
    across = float(np.linalg.norm(w - (w @ up) * up))
    still = float(np.linalg.norm(last - first)) < STEADY
    return across if still and across * time > 4.0 * STEADY else None


Method = Literal["inertial_frame", "two_vector", "kalman"]

LEVEL_SD = float(np.radians(0.02))
"""Standard deviation of a pitch or roll that is given without one [rad]."""

HEADING_SD = float(np.radians(0.2))
"""Standard deviation of a heading that is given without one [rad]."""

VELOCITY_SD = 0.1
"""Standard deviation of each component of a velocity that is given without one [m/s]."""


class Settings(Stretch):
    """How a log is aligned and navigated."""

    align: Seconds | None = Field(default=None, gt=0)
    """How long it rests at the start, such as "300 s"; the first rest if left out."""
    method: Method = "inertial_frame"
    """Method that aligns it at the start."""
    heading: Angle | None = None
    """Heading at the start, such as "90.6 deg", where gyros cannot see it; found in the rest if
    left out."""
    heading_sd: Angle = Field(default=HEADING_SD, gt=0)
    """Standard deviation of --heading, such as "0.1 deg"."""
    pitch: Angle | None = None
    """Pitch at the start, such as "1.2 deg"; found in the rest if left out."""
    roll: Angle | None = None
    """Roll at the start, such as "-0.4 deg"; found in the rest if left out."""
    level_sd: Angle = Field(default=LEVEL_SD, gt=0)
    """Standard deviation of --pitch and --roll, such as "1 arcmin"."""
    velocity: tuple[float, float, float] | None = None
    """Velocity at the start, east, north, up, where it is given; it needs the attitude [m/s]."""
    velocity_sd: Velocity | None = Field(default=None, gt=0)
    """Standard deviation of each component, "0.1 m/s" if left out."""
    position_sd: Length | None = Field(default=None, gt=0)
    """Standard deviation of --latitude, --longitude and --height, such as "3 m": the start is
    there, not where the reference is."""
    vertical: Literal["free", "held", "aided"] | None = None
    """Vertical channel: free, held at the start, aided by reference heights."""
    still: bool = False
    """The log never left the site, though it may have turned."""
    rate: Annotated[float, Quantity("frequency")] = Field(default=10.0, gt=0)
    """Rate of the written trajectory; "10 Hz" if left out."""

    @model_validator(mode="after")
    def _whole(self) -> Settings:
        given = {k: getattr(self, k) is not None for k in ("heading", "pitch", "roll")}
        whole = all(given.values()) or not any(given.values())
        if not whole and (given["pitch"] or given["roll"]):
            raise error(
                "navigate.attitude",
                given=", ".join(f"--{k}" for k, is_given in given.items() if is_given),
                missing=", ".join(f"--{k}" for k, is_given in given.items() if not is_given),
            )
        moving = [k for k in ("velocity", "velocity_sd") if getattr(self, k) is not None]
        if moving and not all(given.values()):
            raise error("navigate.velocity", given="--" + moving[0].replace("_", "-"))
        return self

    @property
    def attitude_given(self) -> bool:
        """Whether heading, pitch and roll are given."""
        return self.pitch is not None

    @property
    def start_velocity_sd(self) -> float:
        """Standard deviation of each component of the velocity at a start in motion [m/s]."""
        if self.velocity_sd is not None:
            return self.velocity_sd
        return 0.0 if self.velocity is None else VELOCITY_SD
