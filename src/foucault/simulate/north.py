"""Simulate a north seeker: one gyro on an indexing base, set up under one or many headings.

The rate of the Earth and the specific force are turned into the case, then onto the sensing axis,
by rotations one after the other; `models.north_seeker`, which the estimators use, has the products
of these rotations in closed form. Noise of means is drawn as means: white noise and rounding by
their variance, the Markov bias and the random walk by their exact joint law from row to row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.errors import error
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.simulate.noise import draw_noise, quantise
from foucault.simulate.wandering import mean_noise
from foucault.tables import IndexedLog, whole_samples

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

RIGHT, FORWARD, UP = np.eye(3)


@dataclass(frozen=True)
class Placement:
    """One set-up of the instrument.

    Attributes
    ----------
    name : str
        Survey mark, or position of the turntable.
    heading : float
        Of y_b, clockwise from north [rad].
    pitch, roll : float
        Nose up, and right side down [rad].
    """

    name: str
    heading: float
    pitch: float = 0.0
    roll: float = 0.0

    @property
    def attitude(self) -> FloatArray:
        """C_nb, shape (3, 3): maps the case to East-North-Up."""
        turns = exp(np.array([-self.heading * UP, self.pitch * RIGHT, self.roll * FORWARD]))
        return np.asarray(turns[0] @ turns[1] @ turns[2])


@dataclass(frozen=True)
class Stops:
    """The base stops at one index angle after the other.

    Attributes
    ----------
    index : ndarray, shape (k,)
        Index angles in order, clockwise seen from above [rad].
    dwell : ndarray, shape (k,)
        How long it stops at each [s].
    move : float
        Time from one stop to the next [s].
    """

    index: FloatArray
    dwell: FloatArray
    move: float = 10.0

    @property
    def start(self) -> FloatArray:
        """When each stop begins, from the beginning of the set-up, shape (k,) [s]."""
        return np.cumsum(self.dwell + self.move) - self.dwell - self.move

    @property
    def length(self) -> float:
        """Time of a set-up [s]."""
        return float(self.start[-1] + self.dwell[-1])

    def at(self, time: FloatArray, wrong: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index angle as said and its error, shape (m,) each [rad].

        Parameters
        ----------
        time : ndarray, shape (m,)
            From the beginning of the set-up [s].
        wrong : ndarray, shape (k,)
            True minus said angle of each stop [rad].
        """
        times = np.column_stack([self.start, self.start + self.dwell]).ravel()
        said, off = (np.interp(time, times, np.repeat(x, 2)) for x in (self.index, wrong))
        return said, off


@dataclass(frozen=True)
class Rotation:
    """The base turns on and on at one rate.

    Attributes
    ----------
    turns : float
        Turns in each set-up [1].
    rate : float
        Rate, positive clockwise seen from above [rad/s].
    """

    turns: float
    rate: float

    @property
    def length(self) -> float:
        """Time of a set-up [s]."""
        return 2 * np.pi * self.turns / abs(self.rate)

    def at(self, time: FloatArray, wrong: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index angle as said and its error, shape (m,) each [rad].

        Parameters
        ----------
        time : ndarray, shape (m,)
            From the beginning of the set-up [s].
        wrong : ndarray, shape (1,)
            True minus said angle [rad].
        """
        return self.rate * time, np.full(len(time), wrong[0])


@dataclass(frozen=True)
class NorthPlan:
    """What is done: set-ups, each with the same motion of the base.

    Attributes
    ----------
    setups : tuple of Placement, length m
        In order.
    motion : Stops or Rotation
        What the base does in each.
    pause : float
        Time between two set-ups, in which nothing is logged [s].
    """

    setups: tuple[Placement, ...]
    motion: Stops | Rotation
    pause: float = 60.0


@dataclass(frozen=True)
class SeekerErrors:
    """What is wrong beside the coefficients of the instrument.

    Attributes
    ----------
    gyro_offset : float
        Offset of the gyro, the same at every index angle [rad/s].
    gyro_drift : float
        Its change with time, from the beginning of the log [rad/s^2].
    accel_offset : float
        Offset of an accelerometer on the base [m/s^2].
    index_sd : float
        Sd of true minus said index angle: of every stop, or of each rotation as a whole [rad].
    heading_sd : float
        Sd of said minus true reference heading of each set-up [rad].
    twice_per_turn : tuple of float, length 2
        What the gyro reads too much with the cosine and sine of twice the index angle [rad/s].
    heading_offset : float
        Said minus true reference heading of all set-ups [rad].
    """

    gyro_offset: float = 0.0
    gyro_drift: float = 0.0
    accel_offset: float = 0.0
    index_sd: float = 0.0
    heading_sd: float = 0.0
    heading_offset: float = 0.0
    twice_per_turn: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class NorthSimulation:
    """A simulated session of a north seeker.

    Attributes
    ----------
    log : IndexedLog
        What the instrument said [SI].
    model : ImuModel
        The errors it had: the truth.
    plan : NorthPlan
        What was done.
    site : Site
        Where it was.
    errors : SeekerErrors
        What else was wrong.
    index_err : ndarray, shape (m, k)
        True minus said index angle of each set-up and stop [rad].
    """

    log: IndexedLog
    model: ImuModel
    plan: NorthPlan
    site: Site
    errors: SeekerErrors
    index_err: FloatArray

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        setups = self.plan.setups
        return {
            "latitude": self.site.latitude,
            "setups": [p.name for p in setups],
            "heading": [p.heading for p in setups],
            "pitch": [p.pitch for p in setups],
            "roll": [p.roll for p in setups],
            "gyro_offset": self.errors.gyro_offset,
            "gyro_drift": self.errors.gyro_drift,
            "accel_offset": self.errors.accel_offset,
            "index_err": self.index_err.tolist(),
        }


@dataclass(frozen=True)
class _Rows:
    """Rows before noise: times from the start of the log and index angles, shape (n,)."""

    setup: IntArray
    start: FloatArray
    middle: FloatArray
    length: FloatArray
    said: FloatArray
    true: FloatArray


def simulate_north(
    plan: NorthPlan,
    *,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    errors: SeekerErrors | None = None,
    accel: Literal["base", "case"] | None = "base",
    reference: bool = True,
    rate: float = 10.0,
    rows: Literal["samples", "means"] = "means",
    seed: int = 0,
) -> NorthSimulation:
    """Simulate a session.

    Parameters
    ----------
    plan : NorthPlan
        Set-ups, and what the base does in each.
    model : ImuModel
        Errors of the instrument, those that the base resolves.
    noise : ImuNoise
        Its noise [SI].
    site : Site
        Gravity and latitude.
    errors : SeekerErrors or None
        What else is wrong; None for nothing.
    accel : {"base", "case"} or None
        One accelerometer along the sensing axis, two that stay with the case, or none.
    reference : bool
        Whether the log says the heading, as in a calibration.
    rate : float
        Sample rate, also behind means [Hz].
    rows : {"samples", "means"}
        A row per sample, or one per stop of the base.
    seed : int, shape ()
        Seed of all that is drawn [1].
    """
    if site.latitude is None:
        raise error("north.no_latitude")
    errors = errors or SeekerErrors()
    rng = np.random.default_rng(seed)
    stops = len(plan.motion.index) if isinstance(plan.motion, Stops) else 1
    wrong = errors.index_sd * rng.standard_normal((len(plan.setups), stops))
    table = _means(plan, wrong) if rows == "means" else _samples(plan, wrong, rate)
    w_n, f_n = earth_rate_n(site.latitude), site.gravity * UP
    C_nb = np.array([p.attitude for p in plan.setups])
    force, turn = model.measure(f_n @ C_nb, w_n @ C_nb)  # v_n @ C_nb is C_bn v_n
    axis = np.einsum("nij,j->ni", exp(-table.true[:, None] * UP), FORWARD)
    gyro = np.einsum("ni,ni->n", axis, turn[table.setup])
    twice = np.stack([np.cos(2 * table.true), np.sin(2 * table.true)], 1)
    gyro += twice @ np.array(errors.twice_per_turn)
    gyro += errors.gyro_offset + errors.gyro_drift * table.middle
    gyro = _disturbed(gyro[:, None], noise.gyro, table, rate, rows, rng)[:, 0]
    along: FloatArray | None = None
    if accel == "base":
        along = np.einsum("ni,ni->n", axis, force[table.setup])[:, None] + errors.accel_offset
    elif accel == "case":
        along = force[table.setup, :2]
    if along is not None:
        along = _disturbed(along, noise.accel, table, rate, rows, rng)
    off = errors.heading_offset + errors.heading_sd * rng.standard_normal(len(plan.setups))
    heading = (np.array([p.heading for p in plan.setups]) + off)[table.setup]
    log = IndexedLog(
        table.start, table.said, gyro, along, table.setup, tuple(p.name for p in plan.setups),
        heading if reference else None, averaged=table.length if rows == "means" else None,
    )  # fmt: skip
    return NorthSimulation(log, model, plan, site, errors, wrong)


def _means(plan: NorthPlan, wrong: FloatArray) -> _Rows:
    """Return one row per stop."""
    motion = plan.motion
    if isinstance(motion, Rotation):
        raise error("north.means_of_rotation")
    m, k = wrong.shape
    begin = np.arange(m)[:, None] * (motion.length + plan.pause)
    start = (begin + motion.start).ravel()
    length, said = np.tile(motion.dwell, m), np.tile(motion.index, m)
    setup = np.repeat(np.arange(m), k)
    return _Rows(setup, start, start + length / 2, length, said, said + wrong.ravel())


def _samples(plan: NorthPlan, wrong: FloatArray, rate: float) -> _Rows:
    """Return a row per sample, on one grid of time; those of the pauses are not logged."""
    m = len(plan.setups)
    each = whole_samples(m * np.round(plan.motion.length * rate)) // m
    apart = each + round(plan.pause * rate)
    number = np.arange(m)[:, None] * apart + np.arange(each)
    parts = [plan.motion.at(np.arange(each) / rate, one) for one in wrong]
    said = np.concatenate([part[0] for part in parts])
    off = np.concatenate([part[1] for part in parts])
    time = number.ravel() / rate
    length = np.full(len(time), 1.0 / rate)
    return _Rows(np.repeat(np.arange(m), each), time, time, length, said, said + off)


def _disturbed(
    true: FloatArray,
    noise: TriadNoise,
    table: _Rows,
    rate: float,
    rows: str,
    rng: np.random.Generator,
) -> FloatArray:
    """Add noise to readings, shape (n, columns), and round samples."""
    if noise == TriadNoise():
        return true
    columns = true.shape[1]
    if rows == "means":
        return true + mean_noise(noise, table.start, table.length, 1.0 / rate, columns, rng)
    number = np.rint(table.start * rate).astype(np.int64)
    drawn = draw_noise(noise, np.arange(number[-1] + 1) / rate, rng)
    return quantise(true + drawn[number, :columns], noise.quantisation)
