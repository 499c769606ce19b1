"""Simulate a session on a table: the log a user would save, with the truth beside it.

The angles of all three axes move along smooth profiles, so that rates and accelerations are known
in closed form. With a_o, a_m, a_i the outer, middle and inner axis in case axes (`Chain.axes`)::

    w_tk = a_o o' + a_m m' + a_i i'
    w_tk' = a_o o'' + a_m m'' + a_i i'' + o' a_o x (a_m m' + a_i i') + m' a_m x a_i i'

in which every axis turns with those that follow it. At a lever arm r from the centre, with
w = w_tk + w_ie the rate relative to inertial space and its derivative w' in case axes::

    f = g up + w' x r + w x (w x r) - w_ie x (w_ie x r)

since the last term is part of gravity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.models.earth import Site
from foucault.models.imu import Gauge, ImuModel
from foucault.models.noise import ImuNoise
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
from foucault.simulate.table.readings import Rig, SimulatedReadings, simulate_readings
from foucault.tables import Log, TableColumns, whole_samples

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
    said, true, edges = _motions(plan, position, true_rate, move_rate)
    n = whole_samples(np.floor(said.end * rate)) + 1
    readout = sampled_log(
        partial(_felt, true, rig, site), samples=n, rate=rate, sampled=sampled,
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
        np.cumsum(plan.time + _SETTLE + _SHORTEST_MOVE), made.gyro[0], made.accel[0],
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
