"""A slave on a vehicle whose motion is known, and what its master says."""

from __future__ import annotations

from functools import cache

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.estimate.transfer import Linearisation, Slave
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.models.transfer import Messages, Mount
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State
from foucault.plans.manoeuvres import Accelerate, Start, Straight, STurn, Turn
from foucault.simulate.motion import motion_of

DEG = np.pi / 180
ARCMIN = DEG / 60
G = 9.80665
RATE = 100.0
SENSORS = Sensors.of(("gyro.bias", "gyro.scale", "accel.bias"))
NOISE = ImuNoise(
    accel=TriadNoise(white=30e-6 * G), gyro=TriadNoise(white=0.06 * DEG / 60.0)
)  # fmt: skip
SD = np.array([2.4 * DEG / 3600] * 3 + [5e-4] * 3 + [1e-3 * G] * 3)
INSTALLATION = 5 * ARCMIN
VELOCITY_SD, ATTITUDE_SD = 0.02, 0.5 * ARCMIN
C_MS = exp(np.array([0.02, -0.05, 30 * DEG]))
PLAN = [
    Straight(5.0), Accelerate(120.0, 10.0), Turn(90 * DEG, 15.0), STurn(40 * DEG, 20.0),
    Straight(10.0), Turn(-90 * DEG, 15.0), Straight(15.0),
]  # fmt: skip


@cache
def flight(rate: float = RATE):
    """Return the motion, the times of its samples, and its mean rates and forces between them."""
    motion, _ = motion_of(PLAN, Start(40 * DEG, 0.2, 2000.0, 0.5, speed=90.0))
    time = np.arange(round(motion.end * rate) + 1) / rate
    dtheta, dvel = motion.increments(time)
    return motion, time, dtheta * rate, dvel * rate


def slave(truth, mu, *, rng=None) -> Slave:
    """Return what a slave without a lever arm measures, with noise where there is a generator."""
    _, time, w, f = flight()
    C_ms = C_MS @ exp(np.asarray(mu))
    w, f = w @ C_ms, f @ C_ms
    accel, gyro = ImuModel.from_coefficients(CoefficientVector(SENSORS.layout, truth)).measure(f, w)
    if rng is not None:
        gyro = gyro + NOISE.gyro.white * np.sqrt(RATE) * rng.normal(size=gyro.shape)
        accel = accel + NOISE.accel.white * np.sqrt(RATE) * rng.normal(size=accel.shape)
    return Slave(Increments.of(time[1:], gyro / RATE, accel / RATE), SENSORS, NOISE)


def master(delay, *, rng=None, every=0.1) -> Messages:
    """Return messages that hold `delay` before they arrive."""
    motion = flight()[0]
    arrival = np.arange(every, motion.end - 0.2, every)
    arrival = arrival[arrival - delay > 0.05]
    true = motion.trajectory(arrival - delay)
    v, C = true.velocity_n, true.C_nb
    if rng is not None:
        v = v + VELOCITY_SD * rng.normal(size=v.shape)
        C = exp(ATTITUDE_SD * rng.normal(size=v.shape)) @ C
    return Messages(arrival, v, C)


def mount(**more) -> Mount:
    return Mount(C_MS, np.zeros(3), **more)


def prior(delay, *, rng=None) -> tuple[Linearisation, np.ndarray]:
    """Return one copy of the master's state at the start, and how well phi to position is known."""
    motion, time = flight()[:2]
    true = motion.trajectory(time[1:2])
    v, C = true.velocity_n[0], true.C_nb[0]
    if rng is not None:
        v = v + VELOCITY_SD * rng.normal(size=3)
        C = exp(ATTITUDE_SD * rng.normal(size=3)) @ C
    state = State(
        float(true.latitude[0]), float(true.longitude[0]), float(true.height[0]), v, C @ C_MS
    )
    sd = [np.hypot(ATTITUDE_SD, INSTALLATION)] * 3 + [VELOCITY_SD] * 3 + [1.0] * 3
    return Linearisation(state, np.zeros(len(SENSORS)), np.zeros(3), delay), np.array(sd)
