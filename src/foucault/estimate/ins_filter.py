"""Error-state Kalman filter of a strapdown navigator with any sensor errors as states.

Zero velocity, given velocities, positions and heights are measurements; everything found is fed
back at once, so that the errors stay small and the equations of `models.ins_errors` linear. The
recursion is `kernels.ins_filter`.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, sections 14.2 and 15.2 (error-state filter, zero-velocity updates).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error
from foucault.kernels.ins_filter import ins_filter
from foucault.models.earth import SEMI_MAJOR_AXIS
from foucault.models.geodesy import east_north_up
from foucault.models.ins_errors import Sensors, at_place
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments
from foucault.navigate.state import State, states_of
from foucault.navigate.strapdown import Trajectory, require_finite


@dataclass(frozen=True)
class Updates:
    """What is measured when; rows without a finite sd only carry the covariance on."""

    # (m,) rows of the increments at whose ends something is measured, rising. White noise is taken
    # in where epochs begin and end: add rows with nothing measured to cut long ones [1]
    rows: IntArray
    # (m, 3) measured velocity: east, north, up of the position that is measured with it, else of
    # the computed one, which leaves out (velocity) x (position error) tan L / R [m/s]
    velocity_n: FloatArray
    position: FloatArray  # (m, 3) measured latitude [rad], longitude [rad] and height [m]
    # (m, 6) standard deviations of velocity [m/s] and position [m], east, north, up; infinite where
    # nothing is measured. Those of east and north should be equal: they are taken along the axes of
    # frame l
    sd: FloatArray
    # (m,) there velocity and position are set to what is measured, as uncertain as `sd` says, and
    # forget how they went with the rest, which learns nothing from them
    restart: npt.NDArray[np.bool_]

    @classmethod
    def none(cls, rows: IntArray) -> Updates:
        """Return epochs at which nothing is measured.

        `rows` (m,): rows, rising [1].
        """
        m = len(rows)
        return cls(np.asarray(rows, np.int64), np.zeros((m, 3)), np.zeros((m, 3)),
                   np.full((m, 6), np.inf), np.zeros(m, bool))  # fmt: skip

    @classmethod
    def at_rest(
        cls,
        rows: IntArray,
        *,
        velocity_sd: float | FloatArray,
        position: tuple[float, float, float] | None = None,
        position_sd: float = np.inf,
    ) -> Updates:
        """Return zero velocity, and the same position where it is given, at all rows.

        `rows` (m,): rows, rising [1]; `velocity_sd` (m,): standard deviation of each component,
        infinite where it does not rest [m/s]; `position` or None: latitude [rad], longitude
        [rad], height [m]; `position_sd`: standard deviation of each component [m].
        """
        out = cls.none(rows)
        out.sd[:, :3] = np.reshape(velocity_sd, (-1, 1))
        if position is not None:
            out.position[:] = position
            out.sd[:, 3:] = position_sd
        return out

    def __len__(self) -> int:
        return len(self.rows)

    def reference(self) -> FloatArray:
        """Return what the kernel compares with, shape (m, 8) [SI]."""
        normal = east_north_up(self.position[:, 0], self.position[:, 1])[:, :, 2]
        known = np.isfinite(self.sd[:, 3:5]).all(axis=1)
        return np.column_stack([self.velocity_n, normal, self.position[:, 2], known])


PER_EPOCH = ("coefficients", "sd", "innovation", "variance", "corrections", "transitions",
             "before", "after")  # fmt: skip
"""What a `FilterRun` has of every epoch besides its trajectory."""


@dataclass(frozen=True)
class FilterRun:
    """What the filter found, epoch by epoch."""

    sensors: Sensors  # the coefficients that were estimated
    trajectory: Trajectory  # corrected states at the epochs
    coefficients: FloatArray  # (m, p) estimates of the coefficients [SI]
    sd: FloatArray  # (m, 9 + p) standard deviations in the order of `layout` [SI]
    # (m, 6) computed minus measured velocity and position, less what was known of that error; NaN
    # where nothing was measured or it lay beyond the gate [SI]
    innovation: FloatArray
    # (m, 6) variances of the innovations; finite for those beyond the gate too [SI]
    variance: FloatArray
    corrections: FloatArray  # (m, 9 + p) what was fed back [SI]
    transitions: FloatArray  # (m, 9, 9 + p) from one epoch to the next, where kept [SI]
    # before, after: (m, 9 + p, 9 + p) covariances before and after each update, where kept [SI]
    before: FloatArray
    after: FloatArray
    cov: FloatArray  # (9 + p, 9 + p) covariance at the end [SI]
    decay: FloatArray  # (p,) 1 / correlation time of the coefficients [1/s]
    # epochs with which further recordings begin: there nothing of navigation, and of what wanders,
    # is left of the one before [1]
    begins: tuple[int, ...] = ()

    @classmethod
    def joined(cls, runs: Sequence[FilterRun], sensors: Sensors) -> FilterRun:
        """Return runs of recordings, each with the coefficients of the one before, as one.

        `sensors`: the coefficients, with the terms of all recordings.
        """
        if len(runs) == 1:
            return replace(runs[0], sensors=sensors)

        def together(name: str) -> FloatArray:
            return np.concatenate([getattr(run, name) for run in runs])

        history = np.concatenate([run.trajectory.history for run in runs])
        return replace(
            runs[-1], sensors=sensors, trajectory=Trajectory(together("time"), history),
            begins=tuple(np.cumsum([len(run.time) for run in runs[:-1]]).tolist()),
            **{name: together(name) for name in PER_EPOCH},
        )  # fmt: skip

    def recordings(self) -> list[FilterRun]:
        """Return the run of each recording; of one made with ``keep=True`` where there are more."""
        if not self.begins:
            return [self]
        t = self.trajectory
        return [
            replace(
                self, sensors=self.sensors.during(k), cov=self.after[b - 1], begins=(),
                trajectory=Trajectory(t.time[a:b], t.history[a:b]),
                **{name: getattr(self, name)[a:b] for name in PER_EPOCH},
            )
            for k, (a, b) in enumerate(pairwise([0, *self.begins, len(self.time)]))
        ]  # fmt: skip

    @property
    def layout(self) -> Layout:
        """Meaning of the states: nine errors of navigation, then the coefficients."""
        return self.sensors.states

    @property
    def time(self) -> FloatArray:
        """Times of the epochs, shape (m,) [s]."""
        return self.trajectory.time

    @property
    def estimate(self) -> CoefficientVector:
        """The coefficients at the end, with covariance."""
        return CoefficientVector(self.sensors.layout, self.coefficients[-1], self.cov[9:, 9:])

    @property
    def attitude_cov(self) -> FloatArray:
        """Covariance of the attitude error phi at the end, frame n, shape (3, 3) [rad^2]."""
        return self.cov_at_place()[:3, :3]

    def cov_at_place(self) -> FloatArray:
        """Return the covariance of (phi, velocity, position) at the end, frame n, (9, 9) [SI]."""
        A = seen_at_place(self.trajectory.history[-1:])[0]
        return np.asarray(A @ self.cov[:9, :9] @ A.T)

    @cached_property
    def nis(self) -> FloatArray:
        """Normalised innovation squared of each epoch, shape (m,) [1]."""
        return np.asarray(np.nansum(self.innovation**2 / self.variance, axis=1))

    @cached_property
    def measured(self) -> IntArray:
        """How many measurements each epoch took in, shape (m,) [1]."""
        return np.asarray(np.isfinite(self.innovation).sum(axis=1), np.int64)

    @property
    def refused(self) -> int:
        """How many measurements lay beyond the gate."""
        return int(np.count_nonzero(np.isnan(self.innovation) & np.isfinite(self.variance)))


def seen_at_place(
    history: FloatArray, states: Mapping[str, FloatArray] | None = None
) -> FloatArray:
    """Return the matrices from (psi, dv, dr) in l to (phi, velocity, position) in n.

    `history` (m, 12): states of `kernels.strapdown` [SI]; `states` or None: what they mean, see
    `navigate.state.states_of`, where that is known already [SI]. Returns (m, 9, 9): axes are
    those of the computed place; that its meridian points elsewhere than that of the true place,
    by dr_E tan L / R, is left out: it has no bound near a pole [SI].
    """
    C_nl = (states or states_of(history))["C_nl"]
    v0, v1, v2 = history[:, 4:7].T
    share = 1.0 / (SEMI_MAJOR_AXIS + history[:, 11])
    out = np.zeros((len(history), 9, 9))
    for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
        out[:, block, block] = C_nl
    # `models.ins_errors.at_place` for all epochs at once.
    out[:, 0:3, 6] = C_nl[:, :, 1] * share[:, None]
    out[:, 0:3, 7] = -C_nl[:, :, 0] * share[:, None]
    across = np.stack([-v2, np.zeros_like(v2), v0], -1), np.stack([np.zeros_like(v2), -v2, v1], -1)
    for column, turned in zip((6, 7), across, strict=True):
        out[:, 3:6, column] = np.einsum("kij,kj->ki", C_nl, turned) * share[:, None]
    return out


def start_cov(
    phi_cov: FloatArray,
    velocity_sd: float,
    position_sd: float,
    coefficients: FloatArray,
) -> FloatArray:
    """Return the covariance of a start at rest, shape (9 + p, 9 + p) [SI].

    `phi_cov` (3, 3): covariance of the attitude error phi [rad^2]; `velocity_sd`, `position_sd`:
    standard deviation of each component [m/s], [m]; `coefficients` (p,) or (p, p): standard
    deviations, or the covariance, of the coefficients [SI].
    """
    p = len(coefficients)
    P = np.zeros((9 + p, 9 + p))
    P[:3, :3] = phi_cov
    P[3:6, 3:6] = velocity_sd**2 * np.eye(3)
    P[6:9, 6:9] = position_sd**2 * np.eye(3)
    A = np.linalg.inv(at_place(SEMI_MAJOR_AXIS, np.zeros(3)))
    P[:9, :9] = A @ P[:9, :9] @ A.T
    P[9:, 9:] = np.diag(coefficients**2) if coefficients.ndim == 1 else coefficients
    return P


def run(
    increments: Increments,
    state: State,
    sensors: Sensors,
    updates: Updates,
    P0: FloatArray,
    noise: ImuNoise,
    *,
    first: int = 0,
    estimate: FloatArray | None = None,
    wander: Mapping[str, float] | None = None,
    correlation_time: Mapping[str, float] | None = None,
    gate: float = np.inf,
    gravity_offset: float = 0.0,
    held: bool = False,
    keep: bool | Literal["transitions"] = False,
) -> FilterRun:
    """Navigate from row `first` and correct at the updates.

    `increments`: increments as measured, or with known errors removed [SI]; `updates`: what is
    measured, the last row is where the run ends; `P0` (9 + p, 9 + p): covariance at the start,
    see `start_cov` [SI]; `noise`: white noise of the triads, random walk of their biases and what
    they wander by, where those are states [SI]; `first`: row at whose end the run starts [1];
    `estimate` (p,) or None: coefficients at the start, zero by default [SI]; `wander` or None:
    random walk of coefficients or groups of them [unit/sqrt(s)]; `correlation_time` or None:
    correlation time of coefficients or groups that are Markov processes, much longer than the
    time between updates [s]; `gate`: measurements beyond so many standard deviations are left out
    [1]; `gravity_offset`: measured local minus normal gravity [m/s^2]; `held`: whether height
    stays and the vertical velocity is zero; `keep`: whether what a smoother needs is kept, or the
    transitions alone. Raises rows outside the log, an impossible start, measurements that cannot
    be, or numbers that are not finite.
    """
    rows = np.asarray(updates.rows, np.int64)
    n, p = len(increments), len(sensors)
    for row in (first, *rows[-1:]):
        if not 0 <= row < n:
            raise error("strapdown.rows", row=int(row), last=n - 1)
    P0 = np.array(P0, float)
    _require(updates, P0, first, 9 + p)
    q, decay = _process(sensors, noise, wander or {}, correlation_time or {})
    if held:  # the vertical velocity is known
        q[5], P0[5], P0[:, 5] = 0.0, 0.0, 0.0
    values = np.zeros(p) if estimate is None else np.asarray(estimate, float)
    found = ins_filter(
        increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, first,
        state.packed(), values, P0, q, decay,
        sensors.coefficient, sensors.axis, sensors.entry, sensors.weight, sensors.gyros,
        sensors.most, rows, updates.reference(), updates.sd, float(gate),
        updates.restart, gravity_offset, held, bool(keep), keep is True,
    )  # fmt: skip
    states, coefficients, sd, innovation, variance, X, Phi, before, after, P = found
    time = increments.time[rows]
    require_finite(states, increments, rows)
    return FilterRun(sensors, Trajectory(time, states), coefficients, sd, innovation, variance, X,
                     Phi, before, after, P, decay)  # fmt: skip


def _require(updates: Updates, P0: FloatArray, first: int, states: int) -> None:
    """Refuse what the kernel would read beyond, or make states of that are no numbers."""
    m = len(updates)
    shapes = {"velocity_n": (m, 3), "position": (m, 3), "sd": (m, 6), "restart": (m,)}
    wrong = [k for k, shape in shapes.items() if getattr(updates, k).shape != shape]
    given = np.concatenate([updates.velocity_n, updates.position], axis=1) if not wrong else P0
    what = ""
    if m == 0 or wrong:
        what = f"there are {m} rows, and {', '.join(wrong) or 'nothing'} does not fit them"
    elif updates.rows[0] < first or np.any(np.diff(updates.rows) <= 0):
        what = f"the rows do not rise from row {first} on"
    elif np.isnan(updates.sd).any() or not np.isfinite(given[np.isfinite(updates.sd)]).all():
        what = "a value that is measured, or its standard deviation, is not a number"
    elif P0.shape != (states, states):
        what = f"the covariance at the start has shape {P0.shape} for {states} states"
    elif not np.isfinite(P0).all() or np.any(np.diag(P0) < 0):
        what = "the covariance at the start is not finite, or a variance in it is negative"
    if what:
        raise error("strapdown.measurements", what=what)


def _process(
    sensors: Sensors,
    noise: ImuNoise,
    wander: Mapping[str, float],
    correlation_time: Mapping[str, float],
) -> tuple[FloatArray, FloatArray]:
    """Return white noise of every state [unit^2/s] and 1 / correlation time of the coefficients."""
    layout = sensors.layout
    q = np.zeros(9 + len(sensors))
    q[0:3], q[3:6] = noise.gyro.white**2, noise.accel.white**2
    biases = {"gyro.bias": noise.gyro.random_walk, "accel.bias": noise.accel.random_walk}
    known = {k: v for k, v in biases.items() if any(n.startswith(k) for n in layout.names)}
    for name, value in {**known, **wander}.items():
        q[9 + layout.group(name)] = value**2
    decay = np.zeros(len(sensors))
    markov = {f"{t}.wander": n for t, n in (("gyro", noise.gyro), ("accel", noise.accel))}
    for name, triad in markov.items():
        if any(n.startswith(name) for n in layout.names):
            at = layout.group(name)
            decay[at] = 1.0 / triad.correlation_time
            q[9 + at] = 2.0 * triad.bias_instability**2 / triad.correlation_time
    for name, value in correlation_time.items():
        if not value > 0:
            what = f"the correlation time of {name} is {value} s"
            raise error("strapdown.measurements", what=what)
        decay[layout.group(name)] = 1.0 / value
    return q, decay
