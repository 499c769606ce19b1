"""Instruments on a table: means of many at once, or the log of one.

In a rest the mean specific force is g along up, and the mean rate that of the Earth. Over whole
turns of the outer axis, o in body axes and tilted by the plumb errors of the table::

    f = g cos(tilt) o - h^2 (r - (r.o) o)       w = h o,    h = true rate + Earth's rate along o

exactly, but for the square of the tilt: `simulate_readings` makes such means of many instruments at
once. `simulate` makes the log of one, sample by sample: the angles of all three axes move along
smooth profiles, so that rates and accelerations are known in closed form. With a_o, a_m, a_i the
outer, middle and inner axis in case axes (`Chain.axes`)::

    w_tk = a_o o' + a_m m' + a_i i'
    w_tk' = a_o o'' + a_m m'' + a_i i'' + o' a_o x (a_m m' + a_i i') + m' a_m x a_i i'

in which every axis turns with those that follow it. At a lever arm r from the centre, with
w = w_tk + w_ie the rate relative to inertial space and its derivative w' in case axes::

    f = g up + w' x r + w x (w x r) - w_ie x (w_ie x r)

since the last term is part of gravity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, Gauge, ImuModel, coefficient_slot
from foucault.models.noise import ImuNoise, Readings, grade, mean_variance
from foucault.models.rotation import exp
from foucault.models.rotation import log as rotation_vector
from foucault.models.turntable import (
    INNER,
    MIDDLE,
    OUTER,
    RIG,
    TableErrors,
    TablePlan,
    chain,
    earth_rate_t,
)
from foucault.simulate.noise import sampled_log
from foucault.tables import Log, TableColumns, whole_samples


@dataclass(frozen=True)
class Rig:
    """A table with its errors, and how the instrument sits on it.

    Where an array may have a first axis N it holds one value per instrument.
    """

    # (6,) or (N, 6) errors that all positions share, in the order of `models.turntable.COMMON`
    # [rad]
    common: FloatArray = field(default_factory=lambda: np.zeros(6))
    # sd of another error of the middle and of the inner angle in each position [rad]
    position_sd: float = 0.0
    # (N,) relative error of all spin rates, true over said minus 1 [1]
    rate_error: float | FloatArray = 0.0
    rate_jitter: float = 0.0  # sd of another relative error of the rate of each spin [1]
    # accel_scatter, gyro_scatter: sd of another bias of each axis in each position [SI]
    accel_scatter: float = 0.0
    gyro_scatter: float = 0.0
    # (3,) or (N, 3) rotation of the body axes: ``C_bk = Exp(-[mounting x])`` [rad]
    mounting: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3,) or (N, 3) the accelerometers from the centre of the table, body axes [m]
    lever_arm: FloatArray = field(default_factory=lambda: np.zeros(3))
    heading: float = 0.0  # azimuth of table y at outer angle zero [rad]

    @property
    def mounting_matrix(self) -> FloatArray:
        """C_bk, shape (3, 3) or (N, 3, 3) [1]."""
        return exp(-self.mounting)

    def outer_t(self) -> FloatArray:
        """Return the direction of the outer axis in table axes, shape (3,) or (N, 3) [1]."""
        x, y = self.common[..., 0], self.common[..., 1]
        return np.stack([np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y)], axis=-1)

    def draw(
        self, plan: TablePlan, instruments: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw what differs from one position to the next.

        `instruments`: number N of instruments [1]. Returns `position` (N, n, 2): errors of the
        middle and of the inner angle [rad]; `rate` (N, n): true rates of the outer axis, 0 at
        rest [rad/s].
        """
        shape = (instruments, len(plan))
        position = self.position_sd * rng.standard_normal((*shape, 2))
        jitter = self.rate_jitter * rng.standard_normal(shape)
        return position, plan.rate * (1.0 + np.reshape(self.rate_error, (-1, 1)) + jitter)

    def biases(
        self, plan: TablePlan, instruments: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw what specific force and rate are off by in each position, (N, n, 3) each [SI].

        `instruments`: number N of them [1]; `rng`: goes on; a stream of its own is drawn from [1].
        """
        drawn = rng.spawn(1)[0].standard_normal((2, instruments, len(plan), 3))
        return self.accel_scatter * drawn[0], self.gyro_scatter * drawn[1]


@dataclass(frozen=True)
class Fleet:
    """The error models of N instruments, stacked."""

    # every block with two axes in front: the instruments (N), and one (1) for their readings [SI]
    models: ImuModel

    def __len__(self) -> int:
        return len(self.models.accel_bias)

    @classmethod
    def of(cls, models: Sequence[ImuModel]) -> Fleet:
        """Stack models."""
        blocks = (np.stack([getattr(m, f.name) for m in models]) for f in fields(ImuModel))
        return cls(ImuModel(*(block[:, None] for block in blocks)))

    @classmethod
    def from_values(cls, names: Sequence[str], values: FloatArray) -> Fleet:
        """Build the models from coefficients.

        `values` (N, p): their values [SI].
        """
        one, n = cls.of([ImuModel()]).models, len(values)
        alike = cls(ImuModel(*(np.repeat(getattr(one, f.name), n, 0) for f in fields(ImuModel))))
        for k, name in enumerate(names):
            block, where = coefficient_slot(name)
            at = where if isinstance(where, tuple) else (where,)
            getattr(alike.models, block)[(slice(None), 0, *at)] += values[:, k]
        return alike

    @classmethod
    def draw(cls, grade_name: str, instruments: int, seed: int) -> Fleet:
        """Draw the errors of many instruments of a class, as `simulate.hand_rotated` does of one.

        `instruments`: number N of instruments [1]; `seed`: seed [1].
        """
        spread = grade(grade_name).spread
        sd = np.array([spread[name.rpartition(".")[0]] for name in LINEAR_LOWER])
        drawn = np.random.default_rng(seed).standard_normal((instruments, len(sd)))
        return cls.from_values(LINEAR_LOWER, sd * drawn)

    def model(self, i: int) -> ImuModel:
        """Return instrument `i`, shape () [1]."""
        return ImuModel(*(getattr(self.models, f.name)[i, 0] for f in fields(ImuModel)))

    def values(self, names: Iterable[str]) -> FloatArray:
        """Return the named coefficients of all instruments, shape (N, p) [SI]."""
        identity = ImuModel()
        out = []
        for name in names:
            LAYOUT.index(name)
            block, where = coefficient_slot(name)
            at = where if isinstance(where, tuple) else (where,)
            stacked = getattr(self.models, block)[(slice(None), 0, *at)]
            out.append(stacked - getattr(identity, block)[where])
        return np.stack(out, axis=1)


@dataclass(frozen=True)
class SimulatedReadings:
    """Means that N instruments gave in the n positions of a plan, and the truth."""

    plan: TablePlan  # what the table was told
    fleet: Fleet  # true errors: of N instruments, or of the one that all of them are
    accel: FloatArray  # (N, n, 3) mean specific force as measured [m/s^2]
    gyro: FloatArray  # (N, n, 3) mean rate as measured [rad/s]
    # accel_variance, gyro_variance: (n,) variance of the noise of each axis of these means [SI]
    accel_variance: FloatArray
    gyro_variance: FloatArray
    # (N, n, 3) or (1, n, 3) true direction of up (rest) or of the outer axis (spin), body axes [1]
    direction: FloatArray
    # (N, n, 2) true errors of the middle and of the inner angle in each position [rad]
    position: FloatArray
    rate: FloatArray  # (N, n) true rate of the outer axis [rad/s]
    interval: float  # sample interval behind the means, 0 where none was assumed [s]

    def __len__(self) -> int:
        return len(self.accel)

    def readings(self, i: int) -> Readings:
        """Return what instrument `i`, shape () [1], gave, with the covariance of its noise."""
        plan = self.plan
        turns = np.round(np.abs(plan.rate) * plan.time / (2 * np.pi))
        start = np.concatenate([[0.0], np.cumsum(plan.time)[:-1]])
        eye = np.eye(3)
        return Readings(
            plan.angles, plan.rate, turns, start, plan.time, self.accel[i], self.gyro[i],
            self.accel_variance[:, None, None] * eye, self.gyro_variance[:, None, None] * eye,
            self.interval, declared=True,
        )  # fmt: skip


def simulate_readings(
    plan: TablePlan,
    *,
    models: Fleet | Sequence[ImuModel] | ImuModel,
    noise: ImuNoise,
    site: Site,
    rig: Rig | None = None,
    draws: int | None = None,
    interval: float = 0.0,
    seed: int = 0,
) -> SimulatedReadings:
    """Simulate the means that instruments give in the positions of a plan.

    `models`: errors of N instruments, or of one that is drawn again and again; `noise`: noise of
    the instruments [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `rig`: table and mounting, None for perfect ones; `draws`: number N of draws where there is
    one model, None for one per model [1]; `interval`: sample interval, which rounding needs, 0
    where unknown [s]; `seed`: seed of noise, position errors and rate jitter [1].
    """
    rig = rig or Rig()
    fleet = models if isinstance(models, Fleet) else Fleet.of(_listed(models))
    N = len(fleet) if draws is None else draws
    rng = np.random.default_rng(seed)
    position, rate = rig.draw(plan, N, rng)
    accel_bias, gyro_bias = rig.biases(plan, N, rng)
    f_b, w_b, direction = _means(plan, rig, site, position, rate)
    accel, gyro = fleet.models.measure(f_b + accel_bias, w_b + gyro_bias)
    variance = [mean_variance(n, plan.time, interval) for n in (noise.accel, noise.gyro)]
    shape = (N, len(plan), 3)
    silent = [n == type(n)() for n in (noise.accel, noise.gyro)]
    sd = [np.zeros_like(v) if s else np.sqrt(v) for v, s in zip(variance, silent, strict=True)]
    accel = accel + sd[0][:, None] * rng.standard_normal(shape)
    gyro = gyro + sd[1][:, None] * rng.standard_normal(shape)
    return SimulatedReadings(
        plan, fleet, accel, gyro, variance[0], variance[1], direction, position, rate, interval
    )


def _listed(models: Sequence[ImuModel] | ImuModel) -> Sequence[ImuModel]:
    return [models] if isinstance(models, ImuModel) else models


def _means(
    plan: TablePlan, rig: Rig, site: Site, position: FloatArray, rate: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return true mean specific force, rate, and up or the outer axis, body axes."""
    C_tk, outer_k = _attitudes(plan, rig, position)
    C_kb = np.swapaxes(rig.mounting_matrix, -1, -2)
    spin = plan.rate != 0.0
    o = np.where(spin[:, None], outer_k, C_tk[..., 2, :]) @ C_kb
    o_t = np.atleast_2d(rig.outer_t())
    w_t = np.zeros(3) if site.latitude is None else earth_rate_t(site.latitude, rig.heading)
    h = np.where(spin, rate + (o_t @ w_t)[:, None], 0.0)
    r = np.atleast_2d(rig.lever_arm)[:, None, :]
    across = r - np.sum(o * r, axis=2, keepdims=True) * o
    g = site.gravity * np.where(spin, o_t[:, 2:], 1.0)
    f_b = g[..., None] * o - (h**2)[..., None] * across
    at_rest = (np.swapaxes(C_tk, -1, -2) @ w_t) @ C_kb
    return f_b, np.where(spin[:, None], h[..., None] * o, at_rest), o


def _attitudes(plan: TablePlan, rig: Rig, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return attitude and outer axis in case axes for every instrument, or for all at once."""
    n = len(plan)
    alike = rig.position_sd == 0.0 and rig.common.ndim == 1
    N = 1 if alike else len(position)
    common = np.broadcast_to(rig.common, (N, 6))
    # `chain` takes one value per row of angles just as well as one for all.
    errors = TableErrors(*np.repeat(common, n, axis=0).T)
    at = chain(np.tile(plan.angles, (N, 1)), errors, position[:N].reshape(-1, 2))
    return at.C_tk.reshape(N, n, 3, 3), at.outer_k.reshape(N, n, 3)


PAUSE = 8.0
"""Time from the end of a mean to the beginning of the next [s]."""


def serial_numbers(instruments: int) -> list[str]:
    """Return serial numbers SN001 and so on of `instruments`, shape () [1]."""
    digits = max(3, len(str(instruments)))
    return [f"SN{k + 1:0{digits}d}" for k in range(instruments)]


def table_of_means(made: SimulatedReadings) -> dict[str, npt.NDArray[Any]]:
    """Return the means as columns with a row per instrument and position [SI].

    `made`: means of N instruments in n positions [SI].
    """
    plan, N, n = made.plan, len(made), len(made.plan)
    start = np.concatenate([[0.0], np.cumsum(plan.time + PAUSE)[:-1]])
    out: dict[str, npt.NDArray[Any]] = {
        "serial": np.repeat(np.array(serial_numbers(N)), n),
        "time": np.tile(start, N),
        "averaged": np.tile(plan.time, N),
    }
    for name, block in (("gyro", made.gyro), ("accel", made.accel)):
        out |= {f"{name}_{a}": block[:, :, i].ravel() for i, a in enumerate("xyz")}
    out |= {a: np.tile(plan.angles[:, i], N) for i, a in enumerate(("outer", "middle", "inner"))}
    return out | {
        "table_rate": np.tile(plan.rate, N),
        "position": np.tile(np.arange(n), N),
    }


def truth_of(made: SimulatedReadings) -> dict[str, npt.NDArray[Any]]:
    """Return the true coefficients of each instrument as columns [SI]."""
    fleet = made.fleet
    models = [fleet.model(i).in_gauge(Gauge.LOWER)[0] for i in range(len(fleet))]
    vectors = [m.coefficients(LINEAR_LOWER) for m in models]
    values = np.array([v.values for v in vectors]).reshape(len(models), len(LINEAR_LOWER))
    out: dict[str, npt.NDArray[Any]] = {"serial": np.array(serial_numbers(len(models)))}
    return out | {name: values[:, k] for k, name in enumerate(LINEAR_LOWER)}


MOVE_RATE = float(np.pi / 6)  # highest rate of the axes in moves [rad/s]
_PEAK = 1.875  # highest rate of the S-shaped move over its mean rate
_SETTLE = 1.0  # standstill before a spin [s]
_SHORTEST_MOVE = 2.0  # [s]
_SPIN_UP = np.radians(10.0)  # mean angular acceleration at the start of a spin [rad/s^2]
_MORE = 0.05  # a spin lasts this much longer than its whole turns, in turns


@dataclass(frozen=True)
class Simulation:
    """A simulated session on a table."""

    log: Log  # what the instrument and the table said [SI]
    model: ImuModel  # the errors the instrument had: the truth
    plan: TablePlan  # what the table was told
    rig: Rig  # the errors of the table, and how the instrument sat on it
    # first, last: (n,) first sample of each position at rest or steady rate, and the sample after
    # its last
    first: IntArray
    last: IntArray
    # (n, 2) true errors of the middle and of the inner angle in each position [rad]
    position: FloatArray
    rate: FloatArray  # (n,) true rate of the outer axis in each position [rad/s]
    # (n, 3) true direction of up (rest) or of the outer axis (spin), body axes [1]
    direction: FloatArray

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients, in the body axes that results use."""
        C_cb = self.model.in_gauge(Gauge.LOWER)[1]
        return {
            "positions": {
                "first": self.first.tolist(),
                "last": self.last.tolist(),
                "angles": self.plan.angles.tolist(),
                "rate": self.plan.rate.tolist(),
                "time": self.plan.time.tolist(),
                "true_rate": self.rate.tolist(),
                "angle_errors": self.position.tolist(),
                "direction": (self.direction @ C_cb.T).tolist(),
            },
            "rig": dict(zip(RIG.names, self.rig_values(C_cb).tolist(), strict=True)),
        }

    def rig_values(self, C_cb: FloatArray) -> FloatArray:
        """Return the values of `models.turntable.RIG` in body axes c, shape (14,) [SI].

        `C_cb` (3, 3): rotation from the body axes of `model` to c [1].
        """
        rig = self.rig
        return np.concatenate([
            rig.common,
            [float(np.ravel(rig.rate_error)[0]), rig.heading],
            -rotation_vector(C_cb @ rig.mounting_matrix),
            C_cb @ rig.lever_arm,
        ])  # fmt: skip


def simulate(
    plan: TablePlan,
    *,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    rig: Rig | None = None,
    rate: float = 20.0,
    sampled: Literal["rate", "increment"] = "rate",
    move_rate: float = MOVE_RATE,
    accumulate: bool = True,
    seed: int = 0,
) -> Simulation:
    """Simulate the log of a plan sample by sample.

    `noise`: its noise [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `rig`: table and mounting of one instrument, None for perfect ones; `rate`: sample rate [Hz];
    `sampled`: instantaneous rates, or means over the interval before each sample; `move_rate`:
    highest rate of the axes in moves between positions [rad/s]; `accumulate`: whether the outer
    angle of the log grows from turn to turn, or starts anew from 0; `seed`: seed of noise,
    position errors and rate jitter [1].
    """
    rig = rig or Rig()
    rng = np.random.default_rng(seed)
    position, true_rate = (drawn[0] for drawn in rig.draw(plan, 1, rng))
    accel_bias, gyro_bias = (drawn[0] for drawn in rig.biases(plan, 1, rng))
    said, true, edges = _motions(plan, position, true_rate, move_rate)
    between = (edges[1:, 0] + edges[:-1, 1]) / 2

    def felt(time: FloatArray) -> tuple[FloatArray, FloatArray]:
        (f_b, w_b), k = _felt(true, rig, site, time), np.searchsorted(between, time)
        return f_b + accel_bias[k], w_b + gyro_bias[k]

    n = whole_samples(np.floor(said.end * rate)) + 1
    readout = sampled_log(
        felt, samples=n, rate=rate, sampled=sampled,
        model=model, noise=noise, rng=rng,
    )  # fmt: skip
    first = np.ceil(edges[:, 0] * rate - 1e-9).astype(np.int64)
    last = np.minimum(np.floor(edges[:, 1] * rate + 1e-9).astype(np.int64) + 1, n)
    if sampled == "increment":
        first[edges[:, 0] > 0] += 1  # the first interval that lies in the position as a whole
    log = replace(readout, table=_said(said, readout.time, first, last, accumulate))
    return Simulation(
        log, model, plan, rig, first, last, position, true_rate,
        _directions(plan, rig, position),
    )  # fmt: skip


def simulate_means(
    plan: TablePlan,
    *,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    rig: Rig | None = None,
    rate: float = 20.0,
    seed: int = 0,
) -> Simulation:
    """Simulate a log that holds one mean per position, as some tables' programs save it.

    `noise`: its noise [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `rig`: table and mounting of one instrument, None for perfect ones; `rate`: sample rate behind
    the means [Hz]; `seed`: seed of noise, position errors and rate jitter [1].
    """
    rig = rig or Rig()
    made: SimulatedReadings = simulate_readings(
        plan, models=model, noise=noise, site=site, rig=rig, interval=1.0 / rate, seed=seed
    )
    number = np.arange(len(plan))
    log = Log(
        begins(plan, "means"), made.gyro[0], made.accel[0],
        table=TableColumns(plan.angles, plan.rate, number), averaged=plan.time,
    )  # fmt: skip
    return Simulation(
        log, model, plan, rig, number, number + 1, made.position[0], made.rate[0],
        made.direction[0],
    )  # fmt: skip


def _directions(plan: TablePlan, rig: Rig, position: FloatArray) -> FloatArray:
    at = chain(plan.angles, TableErrors.of(rig.common), position)
    o_k = np.where((plan.rate != 0.0)[:, None], at.outer_k, at.up_k)
    return np.asarray(o_k @ rig.mounting_matrix.T)


# -- how the axes move ---------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """Angles of the three axes over time, in pieces.

    In a piece, with tau from 0 to 1 in time T, s = tau^3 (10 - 15 tau + 6 tau^2) and
    S = 3 tau^2 - 2 tau^3::

        angle = begin + change s  (+ for the outer axis the integral of rate0 + (rate1 - rate0) S)
    """

    time: FloatArray  # (p,) length T of each piece [s]
    # begin, change: (p, 3) angles at its start, and their S-shaped change [rad]
    begin: FloatArray
    change: FloatArray
    rates: FloatArray  # (p, 2) rate of the outer axis at its start and end [rad/s]

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return float(self.time.sum())

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angles, rates and accelerations, shape (m, 3) each [rad, s].

        `time` (m,): when [s].
        """
        starts = np.concatenate([[0.0], np.cumsum(self.time)[:-1]])
        k = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
        T = self.time[k][:, None]
        x = np.clip((time - starts[k])[:, None] / T, 0.0, 1.0)
        change = self.change[k]
        angle = self.begin[k] + change * x**3 * (10 - 15 * x + 6 * x**2)
        rate = change * 30 * x**2 * (1 - x) ** 2 / T
        acceleration = change * 60 * x * (1 - x) * (1 - 2 * x) / T**2
        first, more = self.rates[k, :1], np.diff(self.rates[k], axis=1)
        angle[:, :1] += first * T * x + more * T * (x**3 - x**4 / 2)
        rate[:, :1] += first + more * (3 * x**2 - 2 * x**3)
        acceleration[:, :1] += more * 6 * x * (1 - x) / T
        return angle, rate, acceleration


def begins(plan: TablePlan, rows: Literal["samples", "means"]) -> FloatArray:
    """Return when each position of a `plan` begins in a log with such rows, moves included [s]."""
    if rows == "means":
        return np.cumsum(plan.time + _SETTLE + _SHORTEST_MOVE)
    return _motions(plan, np.zeros((len(plan), 2)), plan.rate, MOVE_RATE)[2][:, 0]


def timetable(plan: TablePlan) -> tuple[float, float]:
    """Return how long a `plan` takes [s], and how far the outer axis gets, turns counted [rad]."""
    said, _, _ = _motions(plan, np.zeros((len(plan), 2)), plan.rate, MOVE_RATE)
    outer = said.at(np.concatenate([np.cumsum(said.time) - said.time, [said.end]]))[0][:, 0]
    return said.end, float(np.abs(outer).max())


def _motions(
    plan: TablePlan, position: FloatArray, true_rate: FloatArray, move_rate: float
) -> tuple[Motion, Motion, FloatArray]:
    """Return the motion as the table says it, the true one, and start and end of each position."""
    targets = plan.angles.copy()
    outer = targets[0, 0]
    for k, rate in enumerate(plan.rate):  # the shorter way round, angles never start anew
        targets[k, 0] = outer + np.remainder(targets[k, 0] - outer + np.pi, 2 * np.pi) - np.pi
        outer = targets[k, 0] + _spun(float(rate), float(plan.time[k]))
    said, edges = _motion(plan, targets, plan.rate, move_rate)
    off = np.column_stack([np.zeros(len(plan)), position])
    true, _ = _motion(plan, targets + off, true_rate, move_rate)
    # Both take the same time: the table does not know of its errors.
    return said, replace(true, time=said.time), edges


def _steady(rate: float, time: float) -> tuple[float, float]:
    """Return how long a spin-up and the steady spin last."""
    more = np.clip(_MORE * 2 * np.pi / abs(rate), 1.0, 10.0)
    return max(1.0, abs(rate) / _SPIN_UP), time + float(more)


def _spun(rate: float, time: float) -> float:
    if rate == 0.0:
        return 0.0
    ramp, steady = _steady(rate, time)
    return rate * (ramp + steady)


def _motion(
    plan: TablePlan, targets: FloatArray, rates: FloatArray, move_rate: float
) -> tuple[Motion, FloatArray]:
    pieces: list[tuple[float, FloatArray, FloatArray, tuple[float, float]]] = []
    edges = np.empty((len(plan), 2))
    at, clock, still = targets[0], 0.0, np.zeros(3)

    def add(time: float, change: FloatArray = still, start: float = 0.0, end: float = 0.0) -> None:
        nonlocal at, clock
        pieces.append((time, at, change, (start, end)))
        at = at + change + np.array([(start + end) / 2 * time, 0.0, 0.0])
        clock += time

    for k, target in enumerate(targets):
        change = target - at
        if k:
            add(max(_SHORTEST_MOVE, _PEAK * float(np.abs(change).max()) / move_rate), change)
        said, rate = float(plan.rate[k]), float(rates[k])
        length = float(plan.time[k])
        ramp = 0.0
        if said != 0.0:
            ramp, length = _steady(said, length)
            add(_SETTLE)
            add(ramp, start=0.0, end=rate)
        edges[k] = clock, clock + length
        add(length, start=rate, end=rate)
        if ramp:
            add(ramp, start=rate, end=0.0)
    time, begin, changes, outer = (np.array(part) for part in zip(*pieces, strict=True))
    return Motion(time, begin, changes, outer), edges


def _said(
    motion: Motion, time: FloatArray, first: IntArray, last: IntArray, accumulate: bool
) -> TableColumns:
    angles, rate, _ = motion.at(time)
    if not accumulate:
        angles[:, 0] = np.remainder(angles[:, 0], 2 * np.pi)
    number = np.full(len(time), -1)
    for k, (start, end) in enumerate(zip(first, last, strict=True)):
        number[start:end] = k
    return TableColumns(angles, rate[:, 0], number)


def _felt(motion: Motion, rig: Rig, site: Site, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return true specific force and rate, frame b, shape (n, 3) each, at any times."""
    angles, (o, m, i), (oo, mm, ii) = _columns(motion, time)
    at = chain(angles, TableErrors.of(rig.common))
    a_o, a_m, a_i = at.axes[..., OUTER], at.axes[..., MIDDLE], at.axes[..., INNER]
    w_tk = a_o * o + a_m * m + a_i * i
    slope = a_o * oo + a_m * mm + a_i * ii
    slope += o * np.cross(a_o, a_m * m + a_i * i) + m * np.cross(a_m, a_i * i)
    w_t = np.zeros(3) if site.latitude is None else earth_rate_t(site.latitude, rig.heading)
    earth = at.C_tk.swapaxes(1, 2) @ w_t
    w = w_tk + earth
    slope += np.cross(earth, w_tk)  # the Earth's rate turns the other way in case axes
    C_bk = rig.mounting_matrix
    f = site.gravity * at.up_k
    r = C_bk.T @ rig.lever_arm
    if r.any():
        f = f + np.cross(slope, r) + _centripetal(w, r) - _centripetal(earth, r)
    return f @ C_bk.T, w @ C_bk.T


def _columns(
    motion: Motion, time: FloatArray
) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
    """Return the angles, and rates and accelerations of outer, middle and inner as columns."""
    angles, rates, accelerations = motion.at(time)
    return angles, np.split(rates, 3, axis=1), np.split(accelerations, 3, axis=1)


def _centripetal(w: FloatArray, r: FloatArray) -> FloatArray:
    return np.asarray((w @ r)[:, None] * w - np.sum(w * w, axis=1, keepdims=True) * r)
