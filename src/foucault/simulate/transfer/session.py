"""Simulate transfer alignment: a master INS and a slave IMU on one vehicle.

The vehicle moves by a plan (`plans.transfer.profiles`); the master says where it is and how it is
turned (`simulate.transfer.link`); the slave sits elsewhere, is not quite fastened as it should be,
and errs (`simulate.transfer.slave`). After the hand-over the master is silent and the slave goes on
alone, with a barometer.

Each source of chance has a seed of its own: two runs of one seed that differ in the flexure, say,
have the same noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.models.geodesy import displaced
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.master import MasterTable
from foucault.models.noise import Grade, ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.plans.transfer.profiles import TransferProfile
from foucault.simulate.motion import Motion, TrueTrajectory
from foucault.simulate.noise import draw_noise, noisy_log
from foucault.simulate.transfer.link import Link, MasterNoise, Received, messages
from foucault.simulate.transfer.motion import CarriedMotion, carried
from foucault.simulate.transfer.slave import Fastening, Slave, fastened, felt
from foucault.tables import Log
from foucault.units import parse

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

    Parameters
    ----------
    rng : Generator
        Source of random numbers.
    grade : Grade or None
        Spread of its errors, and its noise; None for `turn_on_grade`.
    installation : float
        Standard deviation of mu about each axis [rad].
    slave : Slave or None
        What else is to be said of it: lever arm, flexure and so on.
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

    Parameters
    ----------
    profile : TransferProfile
        What the vehicle does.
    rate : float
        Samples of the slave in a second [Hz].
    slave : Slave or None
        The slave; None for one without errors where the master is. See `draw_slave`.
    link : Link or None
        How messages come; None for 10 Hz and 100 ms.
    noise : MasterNoise or None
        Errors of the master.
    barometer : Barometer or None
        Errors of the barometer.
    gravity_offset : float
        Local minus normal gravity [m/s^2].
    seed : int, shape ()
        Seed of all that is drawn here [1].

    Notes
    -----
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
