"""The slave on the vehicle: how it is fastened, how that gives way, and what its IMU says.

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

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, right_jacobian
from foucault.models.transfer import LIVELY
from foucault.simulate.transfer.motion import CarriedMotion
from foucault.units import STANDARD_GRAVITY

Three = tuple[float, float, float]


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
        dvel = dvel + _applied(carried.C_mn, np.diff(how.velocity_n, axis=0))
    if how.load is None and how.flexure is None and how.velocity_n is None:
        C_ms = slave.C_0 @ exp(np.array(slave.mu))
        return slave.model.measure(dvel @ C_ms * rate, dtheta @ C_ms * rate)
    C_sm = exp(-how.mean) @ slave.C_0.T
    step = np.diff(how.mu, axis=0)
    turned = _applied(right_jacobian(how.mean), step)
    dtheta_s, dvel_s = (_while_turning(_applied(C_sm, x), turned) for x in (dtheta, dvel))
    return slave.model.measure(dvel_s * rate, (dtheta_s + turned) * rate)


def _while_turning(x: FloatArray, turned: FloatArray) -> FloatArray:
    """Return integrals in s of what grows, from those with the mean attitude of each interval."""
    x[1:-1] -= np.cross(turned[1:-1], x[2:] - x[:-2]) / 24
    return x


def _applied(C: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray((C @ x[:, :, None])[:, :, 0])


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
