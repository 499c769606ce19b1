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

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error
from foucault.kernels.ins_filter import ins_filter
from foucault.models.earth import SEMI_MAJOR_AXIS
from foucault.models.geodesy import east_north_up
from foucault.models.ins_errors import Sensors, at_place
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments
from foucault.navigate.state import State
from foucault.navigate.strapdown import Trajectory, require_finite

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Updates:
    """What is measured when; rows without a finite sd only carry the covariance on.

    Attributes
    ----------
    rows : ndarray of int, shape (m,)
        Rows of the increments at whose ends something is measured, rising [1].
    velocity_n : ndarray, shape (m, 3)
        Measured velocity: east, north, up [m/s].
    position : ndarray, shape (m, 3)
        Measured latitude [rad], longitude [rad] and height [m].
    sd : ndarray, shape (m, 6)
        Standard deviations of velocity [m/s] and position [m], east, north, up; infinite where
        nothing is measured. Those of east and north should be equal: they are taken along the
        axes of frame l.
    restart : ndarray of bool, shape (m,)
        There the filter first sets velocity and position to what is measured, with `sd` for
        their uncertainty, and forgets how they went with the rest.
    """

    rows: IntArray
    velocity_n: FloatArray
    position: FloatArray
    sd: FloatArray
    restart: npt.NDArray[np.bool_]

    @classmethod
    def none(cls, rows: IntArray) -> Updates:
        """Return epochs at which nothing is measured.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Rows, rising [1].
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

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Rows, rising [1].
        velocity_sd : float or ndarray, shape (m,)
            Standard deviation of each component; infinite where it does not rest [m/s].
        position : (float, float, float) or None
            Latitude [rad], longitude [rad], height [m].
        position_sd : float, shape ()
            Standard deviation of each component [m].
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
        """Return what the kernel compares with, shape (m, 7) [SI]."""
        normal = east_north_up(self.position[:, 0], self.position[:, 1])[:, :, 2]
        return np.concatenate([self.velocity_n, normal, self.position[:, 2:]], axis=1)


@dataclass(frozen=True)
class FilterRun:
    """What the filter found, epoch by epoch.

    Attributes
    ----------
    sensors : Sensors
        The coefficients that were estimated.
    trajectory : Trajectory
        Corrected states at the epochs.
    coefficients : ndarray, shape (m, p)
        Estimates of the coefficients [SI].
    sd : ndarray, shape (m, 9 + p)
        Standard deviations in the order of `layout` [SI].
    innovation : ndarray, shape (m, 6)
        Measured minus expected; NaN where nothing was measured or it lay beyond the gate [SI].
    variance : ndarray, shape (m, 6)
        Variances of the innovations; finite for those beyond the gate too [SI].
    corrections : ndarray, shape (m, 9 + p)
        What was fed back [SI].
    transitions : ndarray, shape (m, 9, 9 + p), or (0, 9, 9 + p)
        From one epoch to the next, where kept [SI].
    before, after : ndarray, shape (m, 9 + p, 9 + p), or (0, ...)
        Covariances before and after each update, where kept [SI].
    cov : ndarray, shape (9 + p, 9 + p)
        Covariance at the end [SI].
    decay : ndarray, shape (p,)
        1 / correlation time of the coefficients [1/s].
    """

    sensors: Sensors
    trajectory: Trajectory
    coefficients: FloatArray
    sd: FloatArray
    innovation: FloatArray
    variance: FloatArray
    corrections: FloatArray
    transitions: FloatArray
    before: FloatArray
    after: FloatArray
    cov: FloatArray
    decay: FloatArray

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
        """Covariance of the attitude error phi at the end, frame l, shape (3, 3) [rad^2]."""
        return self.cov_at_place()[:3, :3]

    def cov_at_place(self) -> FloatArray:
        """Return the covariance of (phi, velocity, position) at the end, shape (9, 9) [SI]."""
        A = at_place(SEMI_MAJOR_AXIS, self.trajectory.velocity_n[-1])
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


def start_cov(
    phi_cov: FloatArray,
    velocity_sd: float,
    position_sd: float,
    coefficients: FloatArray,
) -> FloatArray:
    """Return the covariance of a start, shape (9 + p, 9 + p) [SI].

    Parameters
    ----------
    phi_cov : ndarray, shape (3, 3)
        Covariance of the attitude error phi [rad^2].
    velocity_sd, position_sd : float, shape ()
        Standard deviation of each component [m/s], [m].
    coefficients : ndarray, shape (p,) or (p, p)
        Standard deviations, or the covariance, of the coefficients [SI].
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

    Parameters
    ----------
    increments : Increments
        Increments as measured, or with known errors removed [SI].
    state : State
        State at the end of row `first`.
    sensors : Sensors
        Coefficients to estimate.
    updates : Updates
        What is measured; the last row is where the run ends.
    P0 : ndarray, shape (9 + p, 9 + p)
        Covariance at the start, see `start_cov` [SI].
    noise : ImuNoise
        White noise of the triads, and random walk of their biases where those are states [SI].
    first : int, shape ()
        Row at whose end the run starts [1].
    estimate : ndarray, shape (p,), or None
        Coefficients at the start, zero by default [SI].
    wander : mapping of str to float or None
        Random walk of coefficients or groups of them [unit/sqrt(s)].
    correlation_time : mapping of str to float or None
        Correlation time of coefficients or groups that are Markov processes; much longer than
        the time between updates [s].
    gate : float, shape ()
        Measurements beyond so many standard deviations are left out [1].
    gravity_offset : float, shape ()
        Measured local minus normal gravity [m/s^2].
    held : bool
        Whether height stays and the vertical velocity is zero.
    keep : bool
        Whether what a smoother needs is kept.

    Raises
    ------
    FoucaultError
        Rows outside the log or an impossible start, or numbers that are not finite.
    """
    rows = updates.rows
    n = len(increments)
    for row in (first, int(rows[-1]) if len(rows) else n):
        if not 0 <= row < n:
            raise error("strapdown.rows", row=row, last=n - 1)
    p = len(sensors)
    q, decay = _process(sensors, noise, wander or {}, correlation_time or {})
    values = np.zeros(p) if estimate is None else np.asarray(estimate, float)
    restart_sd = np.array([0.0, 0.0])
    if updates.restart.any():
        restart_sd = updates.sd[np.flatnonzero(updates.restart)[0]][[0, 3]]
    found = ins_filter(
        increments.dtheta_b, increments.dvel_b, increments.dt, increments.joined, first,
        state.packed(), values, np.ascontiguousarray(P0, float), q, decay,
        sensors.coefficient, sensors.axis, sensors.entry, sensors.weight, sensors.gyros,
        sensors.most, rows, updates.reference(), updates.sd, float(gate),
        updates.restart, restart_sd, gravity_offset, held, keep, keep,
    )  # fmt: skip
    states, coefficients, sd, innovation, variance, X, Phi, before, after, P = found
    time = increments.time[rows]
    require_finite(states, time, rows)
    return FilterRun(sensors, Trajectory(time, states), coefficients, sd, innovation, variance, X,
                     Phi, before, after, P, decay)  # fmt: skip


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

    Parameters
    ----------
    increments : Increments
        Increments [SI].
    state : State
        State at the end of row `first`.
    sensors : Sensors
        Coefficients.
    rows : ndarray of int, shape (m,)
        Rows to look at, rising [1].
    first : int, shape ()
        Row at whose end the run starts [1].
    gravity_offset : float, shape ()
        Measured local minus normal gravity [m/s^2].
    held : bool
        Whether height stays.

    Returns
    -------
    ndarray, shape (m, 9, 9 + p)
        Errors at each row (phi, velocity, position as seen at the place) per unit of the errors
        at the start (psi, dv, dr) and of each coefficient [SI].
    """
    found = run(
        increments, state, sensors, Updates.none(rows), np.zeros((9 + len(sensors),) * 2),
        ImuNoise(), first=first, gravity_offset=gravity_offset, held=held, keep=True,
    )  # fmt: skip
    out = np.empty_like(found.transitions)
    total = np.eye(9, 9 + len(sensors))
    for k, Phi in enumerate(found.transitions):
        total = Phi[:, :9] @ total
        total[:, 9:] += Phi[:, 9:]
        out[k] = at_place(SEMI_MAJOR_AXIS, found.trajectory.velocity_n[k]) @ total
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

    Parameters
    ----------
    increments : Increments
        Increments [SI].
    state : State
        State at the end of row `first`.
    sensors : Sensors
        Coefficients whose errors count.
    rows : ndarray of int, shape (m,)
        Rows to look at, rising [1].
    P0 : ndarray, shape (9 + p, 9 + p)
        Covariance at the start, see `start_cov` [SI].
    noise : ImuNoise
        White noise of the triads [SI].
    first : int, shape ()
        Row at whose end the run starts [1].
    gravity_offset : float, shape ()
        Measured local minus normal gravity [m/s^2].
    held : bool
        Whether height stays.

    Returns
    -------
    ndarray, shape (m, 9, 9)
        Covariance of phi [rad], velocity [m/s] and position [m] errors.
    """
    found = run(
        increments, state, sensors, Updates.none(rows), P0, noise, first=first,
        gravity_offset=gravity_offset, held=held, keep=True,
    )  # fmt: skip
    out = np.empty((len(rows), 9, 9))
    for k, P in enumerate(found.after):
        A = at_place(SEMI_MAJOR_AXIS, found.trajectory.velocity_n[k])
        out[k] = A @ P[:9, :9] @ A.T
    return out


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
    for name, value in correlation_time.items():
        decay[layout.group(name)] = 1.0 / value
    return q, decay
