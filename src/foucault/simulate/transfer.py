"""A master INS and a slave IMU on one vehicle.

What a logger gets of a master INS: messages with noise, late, some lost, some twice.

The master's clock reads ``c = (1 + drift) t + offset`` where that of the slave reads t. A message
is made at every tick of it, says what is true then but for noise, and arrives `delay` and a little
more or less later::

    stamped at arrival     time = t + delay + jitter
    stamped at validity    time = c
    both                   time = c, arrival = t + delay + jitter

The vehicle moves by a plan (`plans.transfer`); the master says where it is and how it is
turned; the slave sits elsewhere, is not quite fastened as it should be,
and errs (`Slave`). After the hand-over the master is silent and the slave goes on
alone, with a barometer.

Each source of chance has a seed of its own: two runs of one seed that differ in the flexure, say,
have the same noise.

The slave sits at l from the master, in the master's body axes m. With everything resolved in m::

    r_s = r_m + C_em l        v_s = v_m + C_nm (w_em x l)
    f_s = f_m + w x (w x l) + w' x l - (G(r_s) - G(r_m))           w = w_im

G is gravitation, gravity without the centrifugal force of the Earth; its difference is 3e-6 of a
g per metre, which is 20 cm in 200 s. The integral of ``w' x l`` over an interval is ``(w(end) -
w(begin)) x l``; the rest is integrated as in `simulate.motion`. Nothing is left out: navigated
without errors, the increments lead to where the slave is.

The slave's axes s against those of the master, m, are those of a nominal mounting, turned by what
nobody knows, by what load and flexure add, and by vibration::

    C_ms = C_0 Exp(mu(t))       mu(t) = mu + k (f_z / g - 1) + theta(t) + vibration
    w_s = C_sm w_m + J(mu) mu'         f_s = C_sm f

f_z is the specific force along z_m where the slave is, g the standard one. Flexure is a
second-order Gauss-Markov process, on each axis on its own, with correlation time tau_c::

    theta'' = -b^2 theta - 2 b theta' + w      b = 2.146 / tau_c      PSD of w: 4 b^3 sigma^2

which is two first-order ones in a row, ``y = theta' + b theta``, ``y' = -b y + w``, drawn by the
exact law of their steps, with a cubic between samples. Its rate turns the slave, and the gyros say
so. Over an interval with the increments D of rate or force in m, and with h = J(mu) mu' dt,

    integral of C_sm x  =  E - h x (E_next - E_before) / 24        E = Exp(-mean of mu) C_0' D

to third order in the length of the interval.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.models.earth import (
    EARTH_RATE,
    displaced,
    earth_rate_n,
    east_north_up,
    ecef,
    gravity_n,
)
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import Grade, ImuNoise, TriadNoise
from foucault.models.rotation import angles_of, exp, matrix_of, right_jacobian
from foucault.models.transfer import LIVELY, MasterTable
from foucault.plans.manoeuvres import Segment, Start
from foucault.plans.transfer import TransferProfile
from foucault.simulate.motion import Motion, TrueTrajectory, motion_of
from foucault.simulate.noise import draw_noise, noisy_log
from foucault.tables import Log, whole_samples
from foucault.units import STANDARD_GRAVITY, parse

Three = tuple[float, float, float]

_ARCMIN = np.pi / 10800


@dataclass(frozen=True)
class MasterNoise:
    """Errors of what a master says: a new one in each message, and one that wanders slowly."""

    velocity: float = 0.05  # sd of each component [m/s]
    attitude: Three = (_ARCMIN, _ARCMIN, _ARCMIN)  # sd of heading, pitch and roll [rad]
    position: float = 1.0  # sd of each component [m]
    velocity_wander: float = 0.0  # sd of each component [m/s]
    attitude_wander: Three = (0.0, 0.0, 0.0)  # sd of heading, pitch and roll [rad]
    wander_time: float = 300.0  # correlation time of what wanders [s]


@dataclass(frozen=True)
class Link:
    """How the messages come."""

    rate: float = 10.0  # messages in a second of the master's clock [Hz]
    delay: float = 0.1  # from validity to arrival [s]
    jitter: float = 0.0  # standard deviation of it; up to three times as much comes [s]
    lost: float = 0.0  # part of the messages that never arrive [1]
    # beginning and end of stretches without messages [s]
    silent: tuple[tuple[float, float], ...] = ()
    # part of the messages that the logger writes a second time, a third of an interval later [1]
    repeated: float = 0.0
    # see the text of the module
    stamped: Literal["arrival", "validity", "both"] = "arrival"
    drift: float = 0.0  # by how much the master's clock is fast; 20e-6 are 20 ppm [1]
    offset: float = 0.0  # what the master's clock reads at time 0 of the slave's [s]

    def __post_init__(self) -> None:
        period = 1.0 / self.rate if self.rate > 0 else np.nan
        for key, good, allowed in (
            ("rate", 0 < self.rate < np.inf, "above zero"),
            ("delay", 0 <= self.delay < np.inf, "zero or more"),
            ("jitter", 0 <= self.jitter <= period / 10,
             f"from 0 to {period / 10:g} s, a tenth of the interval between messages"),
            ("lost", 0 <= self.lost < 1, "from 0 to below 1"),
            ("repeated", 0 <= self.repeated <= 1, "from 0 to 1"),
            ("stamped", self.stamped in ("arrival", "validity", "both"),
             '"arrival", "validity" or "both"'),
            ("drift", abs(self.drift) < 0.1, "a small part of 1"),
        ):  # fmt: skip
            if not good:
                given = getattr(self, key)
                raise error("transfer_plan.value", key=f"link {key}", given=given, allowed=allowed)


@dataclass(frozen=True)
class Received:
    """Messages of a simulated master."""

    table: MasterTable  # as the logger has them, repeated ones twice
    valid: FloatArray  # (k,) when each was true, on the slave's clock [s]
    # lost, repeated: how many were lost, and how many came twice [1]
    lost: int
    repeated: int


def messages(
    motion: Motion, link: Link, noise: MasterNoise, end: float, seeds: list[np.random.SeedSequence]
) -> Received:
    """Draw the messages that arrive until `end`.

    `end`: arrivals after this are not logged [s].
    """
    rng = np.random.default_rng(seeds[1])
    period = 1.0 / link.rate
    # Ticks are not aligned with the samples of the slave.
    first = np.ceil(link.offset / period) + rng.random()
    count = whole_samples(np.floor(((1 + link.drift) * end + link.offset) / period - first)) + 1
    clock = period * (first + np.arange(count))
    valid = (clock - link.offset) / (1 + link.drift)
    late = link.delay + link.jitter * np.clip(rng.standard_normal(count), -3.0, 3.0)
    arrival = valid + np.maximum(late, 0.0)
    lost = rng.random(count) < link.lost
    for begin, stop in link.silent:
        lost |= (valid >= begin) & (valid <= stop)
    twice = rng.random(count) < link.repeated
    said = _said(motion, valid, noise, np.random.default_rng(seeds[0]))
    rows = np.repeat(np.arange(count), 1 + twice)
    again = np.append(False, rows[1:] == rows[:-1])
    came = arrival[rows] + np.where(again, period / 3, 0.0)
    stamp, beside = {"arrival": (came, None), "validity": (clock[rows], None),
                     "both": (clock[rows], came)}[link.stamped]  # fmt: skip
    keep = (came <= end) & ~lost[rows]
    logged = replace(said[rows], time=stamp, arrival=beside)[keep]
    return Received(logged, valid[rows][keep], int(np.sum(lost & (arrival <= end))),
                    int(np.sum(again & keep)))  # fmt: skip


def _said(
    motion: Motion, valid: FloatArray, noise: MasterNoise, rng: np.random.Generator
) -> MasterTable:
    truth = motion.trajectory(valid)

    def drawn(white: float, wander: float) -> FloatArray:
        dt = float(np.mean(np.diff(valid)))
        law = TriadNoise(white * np.sqrt(dt), wander, noise.wander_time)
        return draw_noise(law, valid, rng)

    velocity = truth.velocity_n + drawn(noise.velocity, noise.velocity_wander)
    white, wander = drawn(1.0, 0.0), drawn(0.0, 1.0)
    angles = angles_of(truth.C_nb) + white * noise.attitude + wander * noise.attitude_wander
    away = drawn(noise.position, 0.0)
    place = displaced(truth.latitude, truth.longitude, truth.height, away)
    return MasterTable(valid, velocity, matrix_of(*angles.T), None, *place)


_KEPT = 4  # motions whose increments are kept: trials that differ in noise share them


@dataclass(frozen=True)
class CarriedMotion:
    """A point of a vehicle that moves, with axes parallel to those of the master."""

    motion: Motion  # motion of the master at any time
    # label of each segment of the plan, its beginning and end [s]
    labels: list[tuple[str, float, float]]
    dtheta_m: FloatArray  # (n, 3) increments of angle, frame m [rad]
    dvel_m: FloatArray  # (n, 3) increments of velocity where the slave is, frame m [m/s]
    # (n + 1,) specific force along z of the master where the slave is, at both ends of the
    # intervals [m/s^2]
    lift: FloatArray
    C_mn: FloatArray  # (n, 3, 3) from East-North-Up to m in the middle of the intervals [1]
    truth: TrueTrajectory  # where the point is at the ends of the intervals; its axes b are m


@lru_cache(_KEPT)
def carried(
    plan: tuple[Segment, ...], start: Start, rate: float, lever: tuple[float, float, float]
) -> CarriedMotion:
    """Return what a point of a vehicle goes through; arrays are shared and read-only.

    `rate`: intervals in a second, the first ends at time 0 [Hz]; `lever`: from the master to the
    point, frame m [m].
    """
    motion, labels = motion_of(plan, start, lead=1.0 / rate)
    time = np.arange(-1, whole_samples(np.floor(motion.end * rate + 1e-9)) + 1) / rate
    arm = np.array(lever)
    f, w = motion.truth(time)
    master = motion.trajectory(time)
    truth = displaced_truth(master, w, arm)
    pull = _gravitation(truth) - _gravitation(master)  # frame e
    C_em = east_north_up(master.latitude, master.longitude) @ master.C_nb
    less_m = _rotated_back(C_em, pull)

    def reading(f_b: FloatArray, w_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        return f_b + np.cross(w_b, np.cross(w_b, arm)), w_b

    dtheta, dvel = motion.increments(time, reading)
    dvel += np.cross(np.diff(w, axis=0), arm) - (less_m[1:] + less_m[:-1]) / (2 * rate)
    spin = np.gradient(w, 1.0 / rate, axis=0)
    there = f + np.cross(w, np.cross(w, arm)) + np.cross(spin, arm) - less_m
    C_nm = truth.C_nb
    middle = np.swapaxes(C_nm[1:] + C_nm[:-1], 1, 2) / 2
    made = (dtheta, dvel, np.ascontiguousarray(there[:, 2]), middle)
    later = TrueTrajectory(*(np.ascontiguousarray(getattr(truth, name)[1:]) for name in _TRUTH))
    for array in (*made, *(getattr(later, name) for name in _TRUTH)):
        array.setflags(write=False)
    return CarriedMotion(motion, labels, *made, later)


_TRUTH = ("time", "latitude", "longitude", "height", "velocity_n", "C_nb")


def displaced_truth(master: TrueTrajectory, w_im_m: FloatArray, arm: FloatArray) -> TrueTrajectory:
    """Return where a point of the vehicle is, its velocity, and C_nm in its own East-North-Up.

    `w_im_m` (n, 3): its angular rate, frame m [rad/s]; `arm` (3,): from the master to the point,
    frame m [m].
    """
    C_nm = master.C_nb
    w_em = w_im_m - _rotated_back(C_nm, earth_rate_n(master.latitude))
    arm_n = C_nm @ arm
    place = displaced(master.latitude, master.longitude, master.height, arm_n)
    v_n = master.velocity_n + _rotated(C_nm, np.cross(w_em, arm))
    # Its own East and North differ from those of the master by some 1e-7 rad per metre.
    C_en = east_north_up(master.latitude, master.longitude)
    C_own = np.swapaxes(east_north_up(place[0], place[1]), 1, 2) @ C_en
    return TrueTrajectory(master.time, *place, _rotated(C_own, v_n), C_own @ C_nm)


def _gravitation(at: TrueTrajectory) -> FloatArray:
    """Return gravity without the centrifugal force, frame e, shape (n, 3) [m/s^2]."""
    C_en = east_north_up(at.latitude, at.longitude)
    out = _rotated(C_en, gravity_n(at.latitude, at.height))
    out[:, :2] -= EARTH_RATE**2 * ecef(at.latitude, at.longitude, at.height)[:, :2]
    return out


def _rotated(C: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray((C @ x[:, :, None])[:, :, 0])


def _rotated_back(C: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray((x[:, None, :] @ C)[:, 0])


@dataclass(frozen=True)
class Flexure:
    """Random bending between master and slave."""

    sd: Three  # standard deviation about x, y, z of the slave [rad]
    correlation_time: float  # its correlation time [s]

    def __post_init__(self) -> None:
        _require("flexure sd", self.sd, min(self.sd) >= 0, "zero or more")
        time = self.correlation_time
        _require("flexure correlation_time", time, time > 0, "above zero")


@dataclass(frozen=True)
class Vibration:
    """Vibration of the slave on its mount, alike along and about all axes."""

    accel: float = 0.0  # root mean square of the acceleration along each axis [m/s^2]
    gyro: float = 0.0  # root mean square of the angular rate about each axis [rad/s]
    # low, high: band in which it lies, evenly; `high` is below half of the rate of the log [Hz]
    low: float = 10.0
    high: float = 40.0


@dataclass(frozen=True)
class Slave:
    """An IMU beside a master."""

    # (3, 3) nominal mounting, slave to master [1]
    C_0: FloatArray = field(default_factory=lambda: np.eye(3))
    mu: Three = (0.0, 0.0, 0.0)  # what nobody knows of the mounting, a rotation vector [rad]
    lever_m: Three = (0.0, 0.0, 0.0)  # lever arm from the master to the slave, frame m [m]
    compliance: Three = (0.0, 0.0, 0.0)  # k: what one g more along z of the master adds to mu [rad]
    flexure: Flexure | None = None
    vibration: Vibration | None = None
    # errors of the IMU. What is not linear in them acts on means over an interval
    model: ImuModel = field(default_factory=ImuModel)
    noise: ImuNoise = field(default_factory=ImuNoise)  # its noise [SI]

    def __post_init__(self) -> None:
        near = np.abs(self.C_0 @ self.C_0.T - np.eye(3)).max() < 1e-9
        right = near and np.linalg.det(self.C_0) > 0
        _require("C_0", self.C_0.tolist(), right, "orthonormal and right-handed")


@dataclass(frozen=True)
class Fastening:
    """How the slave is turned and shifted at the ends of all intervals, the first one's too."""

    mu: FloatArray  # (n + 1, 3) mu(t): all that turns it against its nominal mounting [rad]
    mean: FloatArray  # (n, 3) its mean over each interval [rad]
    # load, flexure: (n + 1, 3) what load and random bending have in that; None for nothing [rad]
    load: FloatArray | None = None
    flexure: FloatArray | None = None
    # shift_n, velocity_n: (n + 1, 3) of the vibration, frame n [m], [m/s]
    shift_n: FloatArray | None = None
    velocity_n: FloatArray | None = None


def fastened(
    slave: Slave, carried: CarriedMotion, rate: float, seeds: list[np.random.SeedSequence]
) -> Fastening:
    """Draw how the slave moves on its mount.

    `carried`: what the place of the slave goes through; `rate`: samples in a second [Hz].
    """
    n, dt = len(carried.lift), 1.0 / rate
    mu, mean = np.tile(slave.mu, (n, 1)), np.tile(slave.mu, (n - 1, 1))
    load = flexure = shift = velocity = None
    if any(slave.compliance):
        load = np.outer(carried.lift / STANDARD_GRAVITY - 1.0, slave.compliance)
        mu += load
        mean += _means(load, np.gradient(load, dt, axis=0), dt)
    if slave.flexure is not None:
        flexure, turning = draw_flexure(slave.flexure, n, dt, np.random.default_rng(seeds[0]))
        mu += flexure
        mean += _means(flexure, turning, dt)
    if slave.vibration is not None:
        v, rng = slave.vibration, np.random.default_rng(seeds[1])
        good = 0 < v.low < v.high < rate / 2
        _require("vibration band", (v.low, v.high), good,
                 f"rising, above zero and below {rate / 2:g} Hz, half of the rate")  # fmt: skip
        angle, sum_of_angle = _band(v, v.gyro, n, rate, rng)
        mu += angle
        mean += np.diff(sum_of_angle, axis=0) * rate
        velocity, shift = _band(v, v.accel, n, rate, rng)
    return Fastening(mu, mean, load, flexure, shift, velocity)


def _means(x: FloatArray, slope: FloatArray, dt: float) -> FloatArray:
    """Return the means of the cubics through values and slopes, over each interval."""
    return np.asarray((x[1:] + x[:-1]) / 2 - np.diff(slope, axis=0) * dt / 12)


def felt(
    slave: Slave, carried: CarriedMotion, how: Fastening, rate: float, gravity_offset: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return what an IMU without noise says: mean accel [m/s^2] and gyro [rad/s], shape (n, 3).

    `rate`: samples in a second [Hz]; `gravity_offset`: local minus normal gravity [m/s^2].
    """
    dvel, dtheta = carried.dvel_m + gravity_offset / rate * carried.C_mn[:, :, 2], carried.dtheta_m
    if how.velocity_n is not None:
        dvel = dvel + _rotated(carried.C_mn, np.diff(how.velocity_n, axis=0))
    if how.load is None and how.flexure is None and how.velocity_n is None:
        C_ms = slave.C_0 @ exp(np.array(slave.mu))
        return slave.model.measure(dvel @ C_ms * rate, dtheta @ C_ms * rate)
    C_sm = exp(-how.mean) @ slave.C_0.T
    step = np.diff(how.mu, axis=0)
    turned = _rotated(right_jacobian(how.mean), step)
    dtheta_s, dvel_s = (_while_turning(_rotated(C_sm, x), turned) for x in (dtheta, dvel))
    return slave.model.measure(dvel_s * rate, (dtheta_s + turned) * rate)


def _while_turning(x: FloatArray, turned: FloatArray) -> FloatArray:
    """Return integrals in s of what grows, from those with the mean attitude of each interval."""
    x[1:-1] -= np.cross(turned[1:-1], x[2:] - x[:-2]) / 24
    return x


def draw_flexure(
    flexure: Flexure, n: int, dt: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw random bending [rad] and its rate [rad/s], shape (n, 3) each.

    `n`: number of samples [1]; `dt`: from one to the next [s].
    """
    from scipy.signal import lfilter
    from scipy.special import gammainc

    b = LIVELY / flexure.correlation_time
    x = 2 * b * dt
    # Of a unit process: q / (2 b) = 2 b^2, and integrals of s^k exp(-2 b s) over a step.
    y_var, both, theta_var = 2 * b**2 * gammainc(1, x), b * gammainc(2, x), gammainc(3, x)
    normal = rng.standard_normal((2, n, 3))
    drive_y = np.sqrt(y_var) * normal[0]
    along = both / np.sqrt(y_var)
    drive = along * normal[0] + np.sqrt(max(theta_var - along**2, 0.0)) * normal[1]
    # Stationary from the first sample: var theta 1, var y 2 b^2, covariance b.
    drive_y[0] = np.sqrt(2) * b * normal[0, 0]
    drive[0] = np.sqrt(0.5) * (normal[0, 0] + normal[1, 0])
    keep = np.exp(-b * dt)
    y = lfilter([1.0], [1.0, -keep], drive_y, axis=0)
    drive[1:] += dt * keep * y[:-1]
    theta = lfilter([1.0], [1.0, -keep], drive, axis=0)
    sd = np.array(flexure.sd)
    return np.asarray(sd * theta), np.asarray(sd * (y - b * theta))


def _band(
    band: Vibration, rms: float, n: int, rate: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw the first and the second integral of noise in a band, shape (n, 3) each [unit s^k]."""
    from scipy.fft import irfft, next_fast_len, rfftfreq

    m = next_fast_len(n, real=True)
    f = rfftfreq(m, 1.0 / rate)
    inside = (f >= band.low) & (f <= band.high)
    w = 2 * np.pi * f[inside, None]
    bins = np.zeros((2, len(f), 3), complex)
    normal = rng.standard_normal((2, len(w), 3))
    drawn = rms * m / (2 * np.sqrt(len(w))) * (normal[0] + 1j * normal[1])
    bins[0, inside], bins[1, inside] = drawn / (1j * w), -drawn / w**2
    first, second = irfft(bins, m, axis=1)[:, :n]
    return first, second


def _require(key: str, given: object, good: bool, allowed: str) -> None:
    if not good:
        raise error("transfer_plan.value", key=key, given=given, allowed=allowed)


INSTALLATION = parse("5 arcmin", "angle")
"""How well a slave is fastened by hand, about each axis [rad]."""


def turn_on_grade() -> Grade:
    """Return the class of slave that the publication uses: 2.4 deg/h, 1 mg and 500 ppm anew.

    Gyros with 0.06 deg/sqrt(h) of random walk; that of the accelerometers, which it does not give,
    is that of a tactical instrument.
    """
    spread = {
        "gyro.bias": parse("2.4 deg/h", "angular rate"),
        "accel.bias": parse("1 mg", "specific force"),
        "gyro.scale": parse("500 ppm", "scale factor error"),
    }
    noise = ImuNoise(
        TriadNoise(white=parse("30 ug/sqrt(Hz)", "velocity random walk")),
        TriadNoise(white=parse("0.06 deg/sqrt(h)", "angle random walk")),
    )
    return Grade(noise, spread)


def draw_slave(
    rng: np.random.Generator,
    *,
    grade: Grade | None = None,
    installation: float = INSTALLATION,
    slave: Slave | None = None,
) -> Slave:
    """Draw the errors of mounting and IMU that a slave has this time.

    `grade`: spread of its errors, and its noise, None for `turn_on_grade`; `installation`: standard
    deviation of mu about each axis [rad]; `slave`: what else is to be said of it: lever arm,
    flexure and so on.
    """
    grade = grade or turn_on_grade()
    names = [LAYOUT.names[i] for group in grade.spread for i in LAYOUT.group(group)]
    sd = np.array([s for group, s in grade.spread.items() for _ in LAYOUT.group(group)])
    layout = LAYOUT.subset(names)
    values = dict(zip(names, sd * rng.standard_normal(len(sd)), strict=True))
    vector = CoefficientVector(layout, np.array([values[name] for name in layout.names]))
    x, y, z = installation * rng.standard_normal(3)
    return replace(
        slave or Slave(), mu=(float(x), float(y), float(z)), noise=grade.noise,
        model=ImuModel.from_coefficients(vector),
    )  # fmt: skip


@dataclass(frozen=True)
class Barometer:
    """Errors of the height that a barometer says."""

    white: float = 0.5  # standard deviation of each value [m]
    wander: float = 2.0  # standard deviation of what changes slowly, with the air [m]
    correlation_time: float = 600.0  # of that [s]


@dataclass(frozen=True)
class TransferSimulation:
    """A simulated transfer alignment and the outage after it."""

    profile: TransferProfile  # what the vehicle did
    log: Log  # what the slave said, means of increments [SI]
    master: MasterTable  # the master's messages in order, each once, until the hand-over
    received: Received  # the same as they were logged, with the time of their validity
    barometer: FloatArray  # (n,) height that a barometer said at the times of the log [m]
    slave: Slave  # how the slave was fastened, and what errors it had
    fastening: Fastening  # how it moved on its mount, from one interval before the first row on
    carried: CarriedMotion  # what its place went through

    @property
    def hand_over(self) -> float:
        """When the master falls silent [s]."""
        return self.profile.hand_over

    @property
    def motion(self) -> Motion:
        """Motion of the master at any time."""
        return self.carried.motion

    @property
    def delay(self) -> float:
        """Mean of stamp minus validity over the messages [s]."""
        return float(np.mean(self.received.table.time - self.received.valid))

    @property
    def mu(self) -> FloatArray:
        """All that turns the slave against its nominal mounting, shape (n, 3) [rad]."""
        return self.fastening.mu[1:]

    @cached_property
    def truth(self) -> TrueTrajectory:
        """Where the slave truly was, at the times of the log; axes b are s."""
        at, how = self.carried.truth, self.fastening
        steady = how.load is None and how.flexure is None and how.shift_n is None
        C_ms = self.slave.C_0 @ exp(self.mu[0] if steady else self.mu)
        place, v_n = (at.latitude, at.longitude, at.height), at.velocity_n
        if how.shift_n is not None and how.velocity_n is not None:
            place, v_n = displaced(*place, how.shift_n[1:]), v_n + how.velocity_n[1:]
        return TrueTrajectory(at.time, *place, v_n, at.C_nb @ C_ms)


def simulate_transfer(
    profile: TransferProfile,
    *,
    rate: float = 200.0,
    slave: Slave | None = None,
    link: Link | None = None,
    noise: MasterNoise | None = None,
    barometer: Barometer | None = None,
    gravity_offset: float = 0.0,
    seed: int = 0,
) -> TransferSimulation:
    """Simulate one run.

    `profile`: what the vehicle does; `rate`: samples of the slave in a second [Hz]; `slave`: None
    for one without errors where the master is, see `draw_slave`; `link`: how messages come, None
    for 10 Hz and 100 ms; `noise`, `barometer`: errors of the master and of the barometer;
    `gravity_offset`: local minus normal gravity [m/s^2]; `seed`: of all that is drawn here [1].

    Runs of one profile, rate and lever arm share the motion: the first takes some seconds, those
    after it tenths of one.
    """
    if not rate * profile.end >= 2.0:
        raise error("transfer_plan.value", key="rate", given=rate,
                    allowed="large enough for two samples")  # fmt: skip
    slave, link, air = slave or Slave(), link or Link(), barometer or Barometer()
    x, y, z = (float(a) for a in slave.lever_m)
    there = carried(profile.plan, profile.start, float(rate), (x, y, z))
    imu, bend, shake, errs, way, pressure = np.random.SeedSequence(seed).spawn(6)
    how = fastened(slave, there, rate, [bend, shake])
    accel, gyro = felt(slave, there, how, rate, gravity_offset)
    log = noisy_log(
        there.truth.time, accel, gyro, sampled="increment", noise=slave.noise,
        rng=np.random.default_rng(imu),
    )  # fmt: skip
    got = messages(there.motion, link, noise or MasterNoise(), profile.hand_over, [errs, way])
    law = TriadNoise(air.white / np.sqrt(rate), air.wander, air.correlation_time)
    height = there.truth.height + draw_noise(law, log.time, np.random.default_rng(pressure))[:, 0]
    return TransferSimulation(
        profile, log, got.table.cleaned(), got, height, slave, how, there
    )  # fmt: skip
