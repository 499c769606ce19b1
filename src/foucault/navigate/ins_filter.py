"""Error-state Kalman filter of a strapdown navigator with any sensor errors as states.

Zero velocity, given velocities, positions and heights are measurements; everything found is fed
back at once, so that the errors stay small and the equations of `models.ins_errors` linear. The
recursion is `kernels.ins_filter`.

The smoother, modified Bryson-Frazier form, of an error-state filter that feeds its errors back.

With F the transition from one epoch to the next, P the covariance after an update, and lambda and
Lambda what all later measurements say of the next epoch (`linear_smoother`), what is still wrong
with the states of the filter as seen from the end, and the covariance then, are::

    c_k = -P_k F' lambda_k+1,      P_k - P_k F' Lambda_k+1 F P_k

because the filter expects no error once it has fed it back.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, sections 14.2 and 15.2 (error-state filter, zero-velocity updates).
.. [2] G. J. Bierman, "Fixed interval smoothing with discrete measurements", *International Journal
   of Control* 18 (1973) 65-75.

What errors do to a run without measurements: responses, and the covariance that grows.

What a session says of the Earth's rate, which its filter takes for known.

Attitudes differ from rest to rest and the Earth's rate with them, the biases of the gyros do not:
the Earth is a clock, and a compass needle that dips by the latitude. Were its rate along north and
up more by x, the innovations of the filter would be more by ``D x``, with all coefficients as free
as they are. D is found by taking some of the Earth's rate out of the readings; then

    x = (D' S^-1 D)^-1 D' S^-1 nu,      P = (D' S^-1 D)^-1

is what an estimate of x beside everything else would be, for innovations are white.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error
from foucault.kernels.ins_filter import corrected, ins_filter, transitions_of
from foucault.kernels.linear_filter import linear_smoother
from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS, east_north_up
from foucault.models.ins_errors import Sensors, at_place
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, log
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State, Trajectory, require_finite, states_of


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
        """Return epochs at rising `rows` (m,) [1] at which nothing is measured."""
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
        """Return runs of recordings, each begun with the coefficients of the last, as one."""
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

    @cached_property
    def passed(self) -> FloatArray:
        """How errors go from one epoch to the next, (m, n, n), of a run made with ``keep=True``.

        Between recordings navigation and what wanders begin anew [SI].
        """
        m, n = self.sd.shape
        if len(self.transitions) != m:
            raise ValueError("a run to be smoothed must be made with keep=True")
        Phi = np.tile(np.eye(n), (m, 1, 1))
        Phi[:, :9] = self.transitions
        Phi[1:, 9:, 9:] *= np.exp(-np.diff(self.time)[:, None, None] * self.decay)
        for begin in self.begins:
            Phi[begin, :9, :9] = 0.0
            Phi[begin, 9:, 9:] *= self.decay == 0
        return Phi

    @cached_property
    def adjoint(self) -> tuple[FloatArray, FloatArray]:
        """lambda (m, n) and Lambda (m, n, n) of `linear_smoother`, of a run that was kept [SI]."""
        Phi, n = self.passed, self.sd.shape[1]
        P, R = self.before[:, 3:9, 3:9].copy(), np.zeros_like(self.innovation)
        for r in range(R.shape[1]):
            S, taken = self.variance[:, r], np.isfinite(self.innovation[:, r])
            R[:, r] = S - P[:, r, r]
            P -= np.where(taken, 1 / S, 0.0)[:, None, None] * P[:, :, r, None] * P[:, r, None, :]
        H = np.tile(np.eye(n)[3:9], (len(R), 1, 1))
        lam, adj = linear_smoother(Phi, H, R, self.innovation, self.before, True)[:2]
        return lam, adj

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
    `navigate.strapdown.states_of`, where that is known already [SI]. Returns (m, 9, 9): axes are
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
    keep: bool = False,
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
    stays and the vertical velocity is zero; `keep`: whether what a smoother needs is
    kept. Raises rows outside the log, an impossible start, measurements that cannot be, or numbers
    that are not finite.
    """
    rows = np.asarray(updates.rows, np.int64)
    p = len(sensors)
    _require_rows(increments, rows, first)
    P0 = np.array(P0, float)
    _require(updates, P0, 9 + p)
    q, decay = _process(sensors, noise, wander or {}, correlation_time or {})
    if held:  # the vertical velocity is known
        q[5], P0[5], P0[:, 5] = 0.0, 0.0, 0.0
    values = np.zeros(p) if estimate is None else np.asarray(estimate, float)
    found = ins_filter(
        increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, first,
        state.packed(), values, P0, q, decay,
        sensors.coefficient, sensors.axis, sensors.entry, sensors.weight,
        sensors.most, rows, updates.reference(), updates.sd, float(gate),
        updates.restart, gravity_offset, held, keep,
    )  # fmt: skip
    states, coefficients, sd, innovation, variance, X, Phi, before, after, P = found
    time = increments.time[rows]
    require_finite(states, increments, rows)
    return FilterRun(sensors, Trajectory(time, states), coefficients, sd, innovation, variance, X,
                     Phi, before, after, P, decay)  # fmt: skip


def _require_rows(increments: Increments, rows: IntArray, first: int) -> None:
    """Refuse rows that the kernels would read beyond."""
    for row in (first, *rows[-1:]):
        if not 0 <= row < len(increments):
            raise error("strapdown.rows", row=int(row), last=len(increments) - 1)
    if len(rows) == 0 or rows[0] < first or np.any(np.diff(rows) <= 0):
        what = f"the rows do not rise from row {first} on" if len(rows) else "there are 0 rows"
        raise error("strapdown.measurements", what=what)


def _require(updates: Updates, P0: FloatArray, states: int) -> None:
    """Refuse what the kernel would read beyond, or make states of that are no numbers."""
    m = len(updates)
    shapes = {"velocity_n": (m, 3), "position": (m, 3), "sd": (m, 6), "restart": (m,)}
    wrong = [k for k, shape in shapes.items() if getattr(updates, k).shape != shape]
    given = np.concatenate([updates.velocity_n, updates.position], axis=1) if not wrong else P0
    what = ""
    if wrong:
        what = f"there are {m} rows, and {', '.join(wrong)} does not fit them"
    elif np.isnan(updates.sd).any() or not np.isfinite(given[np.isfinite(updates.sd)]).all():
        what = "a value that is measured, or its standard deviation, is not a number"
    elif P0.shape != (states, states):
        what = f"the covariance at the start has shape {P0.shape} for {states} states"
    elif not np.isfinite(P0).all() or np.any(np.diag(P0) < 0):
        what = "the covariance at the start is not finite, or a variance in it is negative"
    if what:
        raise error("strapdown.measurements", what=what)


def white_noise(sensors: Sensors, noise: ImuNoise) -> FloatArray:
    """Return the white noise of the errors and coefficients, shape (9 + p,) [unit^2/s]."""
    q = np.zeros(9 + len(sensors))
    q[0:3], q[3:6] = noise.gyro.white**2, noise.accel.white**2
    for name, triad in (("gyro.bias", noise.gyro), ("accel.bias", noise.accel)):
        q[9:][[n.startswith(name) for n in sensors.layout.names]] = triad.random_walk**2
    return q


def _process(
    sensors: Sensors,
    noise: ImuNoise,
    wander: Mapping[str, float],
    correlation_time: Mapping[str, float],
) -> tuple[FloatArray, FloatArray]:
    """Return white noise of every state [unit^2/s] and 1 / correlation time of the coefficients."""
    layout = sensors.layout
    q = white_noise(sensors, noise)
    for name, value in wander.items():
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


@dataclass(frozen=True)
class Smoothed:
    """A filter run as seen from its end."""

    trajectory: Trajectory  # states at the epochs
    coefficients: FloatArray  # (m, p) coefficients [SI]
    cov: FloatArray  # (m, 9 + p, 9 + p) covariances [SI]

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (m, 9 + p) [SI]."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))


KNOWN = 1e-12
"""What is left of less than this part of a variance is rounding [1]."""


def smooth(found: FilterRun) -> Smoothed:
    """Smooth a run of `navigate.ins_filter.run` made with ``keep=True``."""
    Phi, (lam, adj) = found.passed[1:], found.adjoint
    P, cov = found.after[:-1], found.after.copy()
    c = np.zeros(found.sd.shape)
    c[:-1] = -np.einsum("kij,klj,kl->ki", P, Phi, lam[1:], optimize=True)
    through = Phi @ P
    cov[:-1] -= through.swapaxes(1, 2) @ adj[1:] @ through
    # Without noise some state is known to rounding.
    gone = np.einsum("kii->ki", cov) <= KNOWN * np.einsum("kii->ki", found.after)
    cov[gone[:, :, None] | gone[:, None, :]] = 0.0
    states = corrected(found.trajectory.history, c)
    return Smoothed(Trajectory(found.time, states), found.coefficients + c[:, 9:], cov)


def free_run(
    increments: Increments,
    state: State,
    sensors: Sensors,
    rows: IntArray,
    transitions: FloatArray,
    *,
    first: int = 0,
    estimate: FloatArray | None = None,
    gravity_offset: float = 0.0,
    held: bool = False,
) -> Trajectory:
    """Navigate from row `first` with nothing measured; return the states at `rows` (m,).

    Arguments as of `run`. `rows` (m,): where the run is looked at, rising [1]; `transitions` (m, 9
    or more, 9 + p or more): its nine first rows are filled with how errors go from one of the rows
    to the next, further columns with zeros [SI]; `first`: row at whose end the run starts [1];
    `estimate` (p,) or None: coefficients, zero by default [SI]; `gravity_offset`: measured local
    minus normal gravity [m/s^2]; `held`: whether height stays and the vertical velocity is zero.
    """
    rows = np.asarray(rows, np.int64)
    _require_rows(increments, rows, first)
    history = np.empty((len(rows), 12))
    values = np.zeros(len(sensors)) if estimate is None else np.asarray(estimate, float)
    transitions_of(
        increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, first,
        state.packed(), values, sensors.coefficient, sensors.axis, sensors.entry, sensors.weight,
        sensors.most, rows, gravity_offset, held, history, transitions,
    )  # fmt: skip
    require_finite(history, increments, rows)
    return Trajectory(increments.time[rows], history)


LONGEST = 30.0
"""White noise is right to 1e-3 of a variance where no epoch of a long run is longer [s]."""


def sensitivity(
    increments: Increments,
    state: State,
    sensors: Sensors,
    rows: IntArray,
    *,
    first: int = 0,
    gravity_offset: float = 0.0,
    held: bool = False,
) -> FloatArray:
    """Return how start errors and coefficients show in a run without measurements.

    `increments`: increments [SI]; `rows` (m,): rows to look at, rising [1]; `first`: row at whose
    end the run starts [1]; `gravity_offset`: measured local minus normal gravity [m/s^2]. Returns
    (m, 9, 9 + p): errors at each row (phi, velocity, position as seen at the place, frame n) per
    unit of the errors at the start (psi, dv, dr) and of each coefficient [SI].
    """
    out = np.zeros((len(rows), 9, 9 + len(sensors)))
    free = free_run(increments, state, sensors, rows, out, first=first,
                    gravity_offset=gravity_offset, held=held)  # fmt: skip
    total = np.eye(9, 9 + len(sensors))
    seen = seen_at_place(free.history)
    for k, Phi in enumerate(out):
        total = Phi[:, :9] @ total
        total[:, 9:] += Phi[:, 9:]
        out[k] = seen[k] @ total
    return out


def spread(
    increments: Increments,
    state: State,
    sensors: Sensors,
    rows: IntArray,
    P0: FloatArray,
    noise: ImuNoise,
    *,
    first: int = 0,
    gravity_offset: float = 0.0,
    held: bool = False,
) -> FloatArray:
    """Return the covariance of a run without measurements, as seen at the place.

    `increments`: increments [SI]; `rows` (m,): rows to look at, rising [1]; `P0` (9 + p, 9 + p):
    covariance at the start, see `start_cov` [SI]; `noise`: white noise of the triads [SI];
    `first`: row at whose end the run starts [1]; `gravity_offset`: measured local minus normal
    gravity [m/s^2]. Returns (m, 9, 9): covariance of phi [rad], velocity [m/s] and position [m]
    errors, frame n.
    """
    # Noise is put in where epochs begin and end: they must be short against what it does.
    time = increments.time[first : int(rows[-1]) + 1]
    marks = np.arange(time[0] + LONGEST, time[-1], LONGEST)
    epochs = np.union1d(rows, first + np.searchsorted(time, marks))
    found = run(
        increments, state, sensors, Updates.none(epochs), P0, noise, first=first,
        gravity_offset=gravity_offset, held=held, keep=True,
    )  # fmt: skip
    wanted = np.searchsorted(epochs, rows)
    A = seen_at_place(found.trajectory.history[wanted])
    return np.asarray(A @ found.after[wanted, :9, :9] @ np.swapaxes(A, 1, 2))


STEP = 1e-3
"""So much of the Earth's rate is taken out [1]."""


@dataclass(frozen=True)
class EarthSeen:
    """The Earth's rate, over what was taken for it."""

    # (2,) by how much it is more along north and up, in parts of the whole Earth's rate [1]
    more: FloatArray
    cov: FloatArray  # (2, 2) covariance of that [1]
    latitude: float  # the latitude that was taken for known [rad]

    @classmethod
    def of(
        cls, r: FloatArray, D: FloatArray, latitude: float, known: FloatArray | float = 0.0
    ) -> EarthSeen | None:
        """Return what white residuals say of it; None where they say nothing.

        `r` (m,): residuals [1]; `D` (2, m): how they become less by the rate along north and up
        [1]; `latitude`: where it stood [rad]; `known` (2, 2): what else is no contradiction [1].
        """
        told = D @ D.T
        if not np.isfinite(told).all() or np.linalg.cond(told) > 1e12:
            return None
        cov = np.linalg.inv(told)
        return cls(np.asarray(cov @ (D @ r)), np.asarray(cov + known), latitude)

    @property
    def square(self) -> float:
        """Squared normalised difference, two degrees of freedom [1]."""
        return self.left_by(np.zeros(2))

    def left_by(self, more: FloatArray) -> float:
        """Return the squared normalised difference from what a cause would make [1].

        `more` (2,): by how much it makes the rate more along north and up [1].
        """
        left = self.more - more
        return float(left @ np.linalg.solve(self.cov, left))

    def along(self, way: FloatArray) -> tuple[float, float, float]:
        """Return what explains the difference best along a way, its sd, and what is left then.

        `way` (2,): what one unit of a cause makes along north and up [1]. Returns `value`, `sd`:
        size of the cause [unit of it]; `left`: squared normalised difference that it leaves, one
        degree of freedom [1].
        """
        weighed = np.linalg.solve(self.cov, way)
        value = float(weighed @ self.more / (weighed @ way))
        return value, float(1 / np.sqrt(weighed @ way)), self.left_by(value * way)

    @property
    def faster(self) -> tuple[float, float, float]:
        """By how much the whole rate is more, as `along` [1]."""
        return self.along(np.array([np.cos(self.latitude), np.sin(self.latitude)]))

    @property
    def farther_north(self) -> tuple[float, float, float]:
        """By how much the latitude is more, as `along` [rad]."""
        return self.along(np.array([-np.sin(self.latitude), np.cos(self.latitude)]))


def earth_seen(
    filtered: Callable[[Increments], FilterRun], increments: Increments, latitude: float
) -> EarthSeen | None:
    """Return what a session at `latitude` [rad] says of the Earth's rate; None for nothing."""
    run = filtered(increments)
    seen = np.isfinite(run.innovation)
    size = np.sqrt(run.variance[seen])
    nu, D = run.innovation[seen] / size, []
    for less in _taken_out(increments, run):
        other = filtered(replace(increments, dtheta_b=less))
        D.append((nu - other.innovation[seen] / size) / STEP)
    return EarthSeen.of(nu, np.stack(D), latitude)


def _taken_out(increments: Increments, run: FilterRun) -> list[FloatArray]:
    """Return the angles turned with `STEP` of the Earth's rate less along north, and along up."""
    C_bn = np.swapaxes(run.trajectory.C_nb, 1, 2)
    time = run.time
    rows = np.flatnonzero((increments.time > time[0]) & (increments.time <= time[-1]))
    middle = increments.time[rows] - increments.dt[rows] / 2
    k = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 2)
    share = np.clip((middle - time[k]) / (time[k + 1] - time[k]), 0.0, 1.0)
    # From one epoch to the next the body turns by less than half a turn: C_b'n = Exp(-r) C_bn.
    turn = log(C_bn[:-1] @ np.swapaxes(C_bn[1:], 1, 2))
    part = exp(-share[:, None] * turn[k])
    out = []
    for way in (1, 2):
        axis_b = np.einsum("kij,kj->ki", part, C_bn[k, :, way])
        out.append(increments.dtheta_b.copy())
        out[-1][rows] -= STEP * EARTH_RATE * increments.dt[rows, None] * axis_b
    return out
