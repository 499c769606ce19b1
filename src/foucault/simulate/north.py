"""Simulate a north seeker: one gyro on an indexing base, set up under one or many headings.

The rate of the Earth and the specific force are turned into the case, then onto the sensing axis,
by rotations one after the other; `models.north_seeker`, which the estimators use, has the products
of these rotations in closed form. Noise of means is drawn as means: white noise and rounding by
their variance, the Markov bias and the random walk by their exact joint law from row to row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import error
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.simulate.noise import draw_noise, mean_noise, quantise
from foucault.tables import IndexedLog, whole_samples

RIGHT, FORWARD, UP = np.eye(3)


@dataclass(frozen=True)
class Placement:
    """One set-up of the instrument."""

    name: str  # survey mark, or position of the turntable
    heading: float  # of y_b, clockwise from north [rad]
    # pitch, roll: nose up, and right side down [rad]
    pitch: float = 0.0
    roll: float = 0.0

    @property
    def attitude(self) -> FloatArray:
        """C_nb, shape (3, 3): maps the case to East-North-Up."""
        turns = exp(np.array([-self.heading * UP, self.pitch * RIGHT, self.roll * FORWARD]))
        return np.asarray(turns[0] @ turns[1] @ turns[2])


@dataclass(frozen=True)
class Stops:
    """The base stops at one index angle after the other."""

    index: FloatArray  # (k,) index angles in order, clockwise seen from above [rad]
    dwell: FloatArray  # (k,) how long it stops at each [s]
    move: float = 10.0  # time from one stop to the next [s]

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

        `time` (m,): from the beginning of the set-up [s]; `wrong` (k,): true minus said angle of
        each stop [rad].
        """
        times = np.column_stack([self.start, self.start + self.dwell]).ravel()
        said, off = (np.interp(time, times, np.repeat(x, 2)) for x in (self.index, wrong))
        return said, off


@dataclass(frozen=True)
class Rotation:
    """The base turns on and on at one rate."""

    turns: float  # turns in each set-up [1]
    rate: float  # rate, positive clockwise seen from above [rad/s]

    @property
    def length(self) -> float:
        """Time of a set-up [s]."""
        return 2 * np.pi * self.turns / abs(self.rate)

    def at(self, time: FloatArray, wrong: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index angle as said and its error, shape (m,) each [rad].

        `time` (m,): from the beginning of the set-up [s]; `wrong` (1,): true minus said angle
        [rad].
        """
        return self.rate * time, np.full(len(time), wrong[0])


@dataclass(frozen=True)
class NorthPlan:
    """What is done: set-ups, each with the same motion of the base."""

    setups: tuple[Placement, ...]
    motion: Stops | Rotation  # what the base does in each
    pause: float = 60.0  # time between two set-ups, in which nothing is logged [s]


@dataclass(frozen=True)
class SeekerErrors:
    """What is wrong beside the coefficients of the instrument."""

    gyro_offset: float = 0.0  # offset of the gyro, the same at every index angle [rad/s]
    gyro_drift: float = 0.0  # its change with time, from the beginning of the log [rad/s^2]
    accel_offset: float = 0.0  # offset of an accelerometer on the base [m/s^2]
    # sd of true minus said index angle: of every stop, or of each rotation as a whole [rad]
    index_sd: float = 0.0
    heading_sd: float = 0.0  # sd of said minus true reference heading of each set-up [rad]
    heading_offset: float = 0.0  # said minus true reference heading of all set-ups [rad]
    # what the gyro reads too much with the cosine and sine of twice the index angle [rad/s]
    twice_per_turn: tuple[float, float] = (0.0, 0.0)
    lean: tuple[float, float] = (0.0, 0.0)  # of the table's axis, about East and North [rad]
    # errors of the sensors themselves, in axes that turn with them: y along the sensing axis of the
    # gyro, and of an accelerometer beside it, z up
    own: ImuModel = field(default_factory=ImuModel)


@dataclass(frozen=True)
class NorthSimulation:
    """A simulated session of a north seeker."""

    log: IndexedLog  # what the instrument said [SI]
    model: ImuModel  # the errors it had: the truth
    plan: NorthPlan
    site: Site
    errors: SeekerErrors  # what else was wrong
    index_err: FloatArray  # (m, k) true minus said index angle of each set-up and stop [rad]

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

    `plan`: set-ups, and what the base does in each; `model`: errors of the instrument, those that
    the base resolves; `noise`: its noise [SI]; `errors`: what else is wrong, None for nothing;
    `accel` or None: one accelerometer along the sensing axis, two that stay with the case, or
    none; `reference`: whether the log says the heading, as in a calibration; `rate`: sample rate,
    also behind means [Hz]; `rows`: a row per sample, or one per stop of the base; `seed`: seed of
    all that is drawn [1].
    """
    if site.latitude is None:
        raise error("north.no_latitude")
    errors = errors or SeekerErrors()
    rng = np.random.default_rng(seed)
    stops = len(plan.motion.index) if isinstance(plan.motion, Stops) else 1
    wrong = errors.index_sd * rng.standard_normal((len(plan.setups), stops))
    table = _means(plan, wrong) if rows == "means" else _samples(plan, wrong, rate)
    w_n, f_n = earth_rate_n(site.latitude), site.gravity * UP
    C_nb = exp(np.array([*errors.lean, 0.0])) @ np.array([p.attitude for p in plan.setups])
    f_b, w_b = f_n @ C_nb, w_n @ C_nb  # v_n @ C_nb is C_bn v_n
    force, turn = model.measure(f_b, w_b)
    C_bk = exp(-table.true[:, None] * UP)
    axis = C_bk @ FORWARD
    felt = [np.einsum("nji,nj->ni", C_bk, v[table.setup]) for v in (f_b, w_b)]
    own = [read - true for read, true in zip(errors.own.measure(*felt), felt, strict=True)]
    gyro = np.einsum("ni,ni->n", axis, turn[table.setup]) + own[1][:, 1]
    twice = np.stack([np.cos(2 * table.true), np.sin(2 * table.true)], 1)
    gyro += twice @ np.array(errors.twice_per_turn)
    gyro += errors.gyro_offset + errors.gyro_drift * table.middle
    gyro = _disturbed(gyro[:, None], noise.gyro, table, rate, rows, rng)[:, 0]
    along: FloatArray | None = None
    if accel == "base":
        along = np.einsum("ni,ni->n", axis, force[table.setup])[:, None] + own[0][:, 1:2]
        along += errors.accel_offset
    elif accel == "case":
        more = errors.own.measure(f_b, w_b)[0] - f_b
        along = (force + more)[table.setup, :2]
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
