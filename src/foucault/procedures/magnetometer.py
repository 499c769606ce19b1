"""Calibrate a magnetometer beside an IMU that was turned freely by hand, or from rest to rest.

Turn the instrument about all axes for a minute, away from iron, and log gyros, magnetometer and,
where there are any, accelerometers. An ellipsoid fitted to the readings leaves the rotation to the
IMU open, three numbers that cost degrees of heading. Here the gyros say how the field, which stands
still, turned in the body: that gives the rotation, the hard iron without full coverage of the
sphere, and how late the magnetometer is.

The readings are means over cells of a fraction of a radian. With ``C_k`` the attitude of cell k
against the start of the log, by the gyros, m_0 the field and f_0 the specific force at rest in body
axes at the start::

    mag_k   = A mean(C_k') m_0 + h + noise + field wander        f_k = mean(C_k') f_0 + noise

Errors of the gyros are nuisance parameters with a prior, their noise, the bias of the
accelerometers, a field that changes from place to place and what is not estimated (a magnetometer
that bends, hard iron that drifts, the other terms of the IMU) are sources of error.

References
----------
.. [1] M. Kok, T. B. Schon, "Magnetometer calibration using inertial sensors", IEEE Sensors J.
   16(14), 2016.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout, coefficients_of
from foucault.detect.coverage import coverage
from foucault.detect.noise import without_spikes
from foucault.detect.stretches import slowest
from foucault.diagnose.checks import check, left_out_check
from foucault.diagnose.fit_checks import Judged, Limit, checks, scattering
from foucault.errors import Finding, Status, error, finding
from foucault.infer import mixed
from foucault.infer.drift import find_left_out
from foucault.infer.ellipsoid import ellipsoid
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.left_out import Judgement
from foucault.infer.mixed import NOISE_BASIS, Fit, Linearisation, Source
from foucault.logs.axes import rows_per_reading
from foucault.logs.description import OWN_LOG, log_head
from foucault.models import magnetometer as sensor
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import Change, Motion
from foucault.models.magnetometer import LAYOUT, Magnetometer
from foucault.models.noise import ImuNoise, grade
from foucault.models.norths import norths
from foucault.models.rotation import cross_matrix
from foucault.models.rotation import log as rotation_vector
from foucault.models.turning import Cells, Chain, Turning
from foucault.models.world_field import WorldField, world_field
from foucault.plans.directions import Free, RestPlan, hand_plan
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.record import Given, Procedure, result_of
from foucault.result import Check, Result, TableData
from foucault.simulate.magnetometer import draw_errors, simulate_field
from foucault.strict import Strict
from foucault.tables import AXES, Log, temperature_range, whole_means
from foucault.units import (
    STANDARD_GRAVITY,
    Angle,
    AngleSd,
    Quantity,
    Rate,
    RatioSd,
    Seconds,
    plain,
)

Tesla = Annotated[float, Quantity("magnetic field")]

EARTH = (22e-6, 67e-6)  # Intensity of the field anywhere on the Earth [T].

TURN, WAIT = 0.5, 2.0
"""A cell ends after so much turning [rad], or so much time [s], or a part of each."""

MOST = 160
"""Cells that are used, evenly chosen where there are more: the work grows with their cube [1]."""

ENOUGH = 200.0  # Readings at this rate show how the field turns, at the start of a fit [Hz].

STILL = 0.05  # At rest nothing turns faster, bias apart [rad/s].
LATEST, FAR = 0.06, 0.5  # Delays are sought up to this, either way, and to name one up to that [s].

WANDERS = {"field wander, 0.3 s": 0.3, "field wander, 3 s": 3.0}
"""Parts of the field that change from place to place, and for how long they stay [s]."""

HAND = 1.0  # What a hand changes the velocity by from the beginning to the end of a log [m/s].
UNKNOWN = 0.05  # Relative sd of an intensity that only the readings themselves say [1].


class Settings(record.Robust):
    """What can be chosen; the defaults suit an IMU that is not calibrated."""

    loss: Literal["robust", "squares"] = "squares"
    """squares: all cells count, and what iron does to some of them is field wander; robust: those
    beyond 3 sd count little or nothing."""
    terms: Literal["auto", "full", "hard iron"] = "auto"
    """full: matrix and hard iron; hard iron: the matrix is taken for one, known to matrix_sd; auto:
    full, where the motion shows it."""
    temperature: bool = False
    """Estimate the change of the hard iron with temperature too."""
    matrix_sd: RatioSd = Field(default=0.03, gt=0)
    """How well scale factors and axes are known beforehand, where the hard iron alone is found."""
    intensity: Tesla | None = Field(default=None, gt=0, examples=["48.2 uT"])
    """Intensity of the field. Left out: that of the world model where [site] has a `date`, else
    what the readings say themselves, to 5 percent. No heading depends on it."""
    intensity_sd: Tesla | None = Field(default=None, gt=0, examples=["0.5 uT"])
    """Its standard uncertainty. Left out: 0.3 percent, outdoors; indoors 1 to 10 are usual."""
    noise_sd: Tesla | None = Field(default=None, gt=0, examples=["0.3 uT"])
    """Noise of a single reading. Left out: from the readings."""
    wander: bool = True
    """Look for a field that changes from place to place, as it does indoors."""
    gyro_bias_sd: Rate = Field(default=float(np.radians(0.5)), gt=0)
    """How well the biases of the gyros are known beforehand."""
    gyro_scale_sd: RatioSd = Field(default=0.01, gt=0)
    """How well the scale factors of the gyros are known beforehand."""
    gyro_misalignment_sd: AngleSd = Field(default=float(np.radians(0.3)), gt=0)
    """How well the axes of the gyros are known beforehand in those of the body."""
    accel_bias_sd: Annotated[float, Quantity("specific force")] = Field(
        default=5e-3 * STANDARD_GRAVITY, gt=0
    )
    """How well the biases of the accelerometers are known beforehand."""

    def estimated(self) -> tuple[str, ...]:
        """Return the names of all coefficients that are estimated."""
        if self.terms == "hard iron":
            return sensor.IRON + (LAYOUT.names[13:] if self.temperature else ())
        return LAYOUT.names if self.temperature else sensor.LINEAR


# -- what was read ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Observed:
    """A log in cells."""

    log: Log  # without gaps [SI]
    turning: Turning
    cells: Cells  # of the field
    still: Cells  # of the specific force at rest, where it was logged
    rows: IntArray  # (r,) those with new readings of the field, of cells that are not used too [1]
    findings: tuple[Finding, ...] = ()

    @property
    def rest(self) -> IntArray:
        """Number of the rest that each cell of the specific force is of, shape (k,) [1]."""
        first = self.still.rows[self.still.start]
        apart = np.diff(self.still.rows, prepend=-1)[self.still.start] > BRIEF / self.log.interval
        return np.asarray(np.cumsum(apart | (first == first[0])) - 1)

    @property
    def time(self) -> FloatArray:
        """Middle of every reading, shape (n,) [s]."""
        t = self.log.time
        return np.concatenate([c.mean(t[c.rows]) for c in (self.cells, self.still)])


def reduce(log: Log) -> Observed:
    """Return the longest stretch of a log without gaps, in cells."""
    file = log.source.get("file", "The log")
    if log.mag is None:
        raise error("mag.not_logged", file=file)
    if log.gyro is None:
        raise error("mag.no_gyro", file=file)
    if stuck := [
        AXES[k] for k in range(3) if _stuck(log.mag[:, k], _moves(log.gyro), log.interval)
    ]:
        raise error("mag.stuck", axes=", ".join(stuck))
    told = []
    step = np.diff(log.time)
    breaks = np.flatnonzero(step > max(5 * log.interval, 0.05)) + 1
    if len(breaks):
        edges = np.concatenate([[0], breaks, [len(log)]])
        k = int(np.argmax(np.diff(edges)))
        log, whole = log[int(edges[k]) : int(edges[k + 1])], log.duration
        told.append(finding("mag.gap", used=f"{log.duration:.3g}", whole=f"{whole:.3g}"))
    assert log.gyro is not None and log.mag is not None
    rows, slower = _new(log.mag)
    if slower is not None:
        told.append(finding("mag.repeated", rate=f"{slower * log.rate:.3g}", log=f"{log.rate:.3g}"))
    top = [np.mean(log.mag[rows, k] == sign * (sign * log.mag[rows, k]).max())
           for k in range(3) for sign in (1.0, -1.0)]  # fmt: skip
    if max(top) > CLIPPED:
        told.append(finding("mag.saturated", axis=AXES[int(np.argmax(top)) // 2],
                            percent=f"{100 * max(top):.2g}"))  # fmt: skip
    w = log.gyro - slowest(log.gyro)
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(w[1:], axis=1) * np.diff(log.time))])
    if log.duration < SHORT or path[-1] < LITTLE:
        raise error("mag.short", time=f"{log.duration:.3g}", turned=f"{np.degrees(path[-1]):.3g}",
                    least=f"{SHORT:g}", turning=f"{np.degrees(LITTLE):.0f}")  # fmt: skip
    edge = (log.time[rows] > log.time[0] + LATEST) & (log.time[rows] < log.time[-1] - LATEST)
    rows = rows[edge]
    clock = path / TURN + (log.time - log.time[0]) / WAIT
    number = np.floor(clock[rows] * np.clip(MOST / clock[-1], 0.5, 1.0)).astype(int)
    cells = Cells(rows, np.flatnonzero(np.diff(number, prepend=-1)))
    still = _rests(log, w)
    every = np.zeros(len(cells), bool)
    every[np.unique(np.linspace(0, len(cells) - 1, MOST).astype(int))] = True
    summed = log.sampled == "increment"  # few samples that are lost are integrated over
    turned = whole_means(log.time, log.gyro) if summed else log.gyro
    turning = Turning(log.time, turned, log.sampled)
    few = rows[:: max(1, int(log.rate * len(rows) / len(log) / ENOUGH))]
    return Observed(log, turning, cells.chosen(every), still, few, tuple(told))


def _rests(log: Log, w: FloatArray) -> Cells:
    """Return the specific force at rest in cells; `w` (n, 3): rates, bias apart [rad/s]."""
    t, quiet = log.time, np.linalg.norm(w, axis=1) < STILL
    quiet &= (t > t[0] + LATEST) & (t < t[-1] - LATEST) & (log.accel is not None)
    begins = np.flatnonzero(np.diff(quiet, prepend=~quiet[0]))
    run = np.cumsum(np.isin(np.arange(len(t)), begins)) - 1
    part = (t - t[begins][run]) // max(WAIT, 2 * quiet.sum() * log.interval / MOST)
    rows = np.flatnonzero(quiet)
    cells = Cells(rows, np.flatnonzero(np.diff(run[rows] * len(t) + part[rows], prepend=-1)))
    return cells.chosen(cells.count * log.interval > BRIEF)


BRIEF = 0.3  # The shortest rest [s].
CLIPPED = 0.02  # Readings equal to the largest one, of all, that are no chance [1].

SHORT, LITTLE = 5.0, 2 * np.pi
"""The shortest log [s] and the least turning [rad] that show anything."""


MOVING = 0.3
"""Rate at which the field of a magnetometer that works changes from row to row [rad/s]."""


def _moves(gyro: FloatArray) -> BoolArray:
    """Return at which rows `gyro` (n, 3) turns the instrument, bias apart [rad/s], (n,)."""
    return np.asarray(np.linalg.norm(gyro - slowest(gyro), axis=1) > MOVING)


def _stuck(x: FloatArray, moving: BoolArray, interval: float) -> bool:
    """Tell whether an axis stays at one reading, throughout or in a long part of what moves.

    `x` (n,): its readings [T]; `moving` (n,); `interval`: of the rows [s].
    """
    run = np.cumsum(np.diff(x, prepend=x[0]) != 0)[moving]
    longest = int(np.bincount(run).max(initial=0))
    return bool(np.ptp(x) == 0 or longest * interval > max(SHORT, len(run) * interval / 3))


def _new(mag: FloatArray) -> tuple[IntArray, float | None]:
    """Return the rows with new readings, and their share where the others repeat them [1].

    A reading that is written again is no new one: it would be counted twice.
    """
    rows = float(rows_per_reading(mag).min())
    if rows == 1.0:
        return np.arange(len(mag)), None
    new = np.concatenate([[True], (np.diff(mag, axis=0) != 0).any(axis=1)])
    return np.flatnonzero(new), 1.0 / rows


# -- where to start --------------------------------------------------------------------------------


def turned(
    o: Observed, x: FloatArray, latest: float = LATEST
) -> tuple[FloatArray, FloatArray, float, float]:
    """Return Q, c and delay of ``dx/dt = x x (Q w + c)``, over windows, by linear equations.

    `x` (r, 3): direction of the field in sensor axes at `o.rows` [1]; `latest`: delay, either way,
    that is looked for [s]. Returns (3, 3) [1], (3,) [rad/s], [s], and the share of the changes that
    this leaves [1].
    """
    time = o.log.time[o.rows]
    step = np.diff(time)
    step[step > 10 * np.median(step)] = 0.0  # where readings are missing
    width = max(round(0.25 / float(np.median(step))), 2)
    ends = np.arange(0, len(x) - 1, width)
    cross = cross_matrix(x)
    whole = np.array([step[a : a + width].min(initial=1.0) > 0 for a in ends[:-1]])
    change = np.diff(x[ends], axis=0)[whole].ravel()
    scan, tried = np.arange(-latest, latest + 1e-9, 0.005), {}

    def left(k: int) -> float:
        if k not in tried:
            w = [np.interp(time - scan[k], o.log.time, v) for v in o.turning.gyro.T]
            full = np.stack([*w, np.ones(len(x))], axis=1)
            each = (cross[:, :, :, None] * full[:, None, None]).reshape(len(x), 3, 12)
            area = 0.5 * (each[1:] + each[:-1]) * step[:, None, None]
            rows = np.add.reduceat(area[: ends[-1]], ends[:-1])[whole].reshape(-1, 12)
            q = np.linalg.lstsq(rows, change, rcond=1e-6)[0]
            tried[k] = float(np.sum((change - rows @ q) ** 2)), q.reshape(3, 4)
        return tried[k][0]

    # No motion of a hand changes its sense within a few of these steps.
    k = min(range(0, len(scan), 4), key=left)
    k = min(range(max(k - 3, 0), min(k + 4, len(scan))), key=left)
    q, delay = tried[k][1], float(scan[k])
    if 0 < k < len(scan) - 1:  # the vertex of the parabola through the three lowest
        a, b, c = (left(k + j) for j in (-1, 0, 1))
        delay += 0.0025 * (a - c) / max(a - 2 * b + c, 1e-300)
    return q[:, :3], q[:, 3], delay, left(k) / float(np.sum(change**2))


@dataclass(frozen=True)
class State:
    """Where a fit is."""

    mag: Magnetometer
    # field, up: (3,) m_0 and f_0 in body axes of the first row, of the size of B and of gravity [1]
    field: FloatArray
    up: FloatArray
    bias: FloatArray  # (3,) of the gyros [rad/s]
    matrix: FloatArray  # (3, 3) error of the gyros per rate, as it is taken away [1]


def start(o: Observed, settings: Settings, intensity: float | None) -> tuple[State, float]:
    """Return where to start, and the size of the field that the readings say [T].

    `intensity`: of the field, None where only the readings say it [T].

    Gyros that are mirrored, a wrong unit of theirs and the rotation to the IMU, whatever it is,
    show here. A mirrored magnetometer does not: its reading reversed is one of a rotated sensor, as
    ``dx/dt = x x Q w`` is linear in x, so that it looks like a field that points the other way.
    """
    assert o.log.mag is not None
    mag = o.log.mag[o.rows]
    A, h = ellipsoid(mag)
    x = np.asarray(np.linalg.solve(A, (mag - h).T).T, float)
    Q, c, delay, unexplained = turned(o, x)
    if unexplained > UNEXPLAINED:
        *_, delay, less = turned(o, x, FAR)
        if less < UNEXPLAINED and abs(delay) > LATEST:
            raise error("mag.late", delay=plain(1e3 * abs(delay), 3), most=plain(1e3 * LATEST),
                        way="late" if delay > 0 else "early")  # fmt: skip
        raise error("mag.not_turning", percent=f"{100 * unexplained:.0f}", most=plain(FAR))
    if o.turning.gyro.std(axis=0).min() > STILL:  # the motion shows all three axes
        ratios = np.linalg.norm(Q, axis=0)
        if ratios.min() < 0.5 or ratios.max() > 2.0:
            raise error("mag.gyro_unit", ratios=", ".join(f"{r:.3g}" for r in ratios))
        if np.linalg.det(Q) < 0:
            raise error("mag.gyro_mirrored")
    U, _, V = np.linalg.svd(Q)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    bias = np.clip(-R.T @ c, -BIAS, BIAS)
    chain = o.turning.chain(delay, bias, np.zeros((3, 3)))
    seen = np.einsum("nij,kj,nk->i", chain.C[o.rows], R, x)
    up = mean_up(o, chain)
    size = float(np.cbrt(np.linalg.det(A)))
    found = np.eye(3) if settings.terms == "hard iron" else A @ R / (intensity or size)
    field, up = seen / np.linalg.norm(seen), up / np.linalg.norm(up)
    return State(Magnetometer(found, h, delay), field, up, bias, np.zeros((3, 3))), size


def mean_up(o: Observed, chain: Chain) -> FloatArray:
    """Return the mean specific force in axes of the first row, (3,) [m/s^2]: that at rest.

    Of all rows where there was no rest: what a hand adds to gravity is a change of velocity over
    the length of the log.
    """
    if o.log.accel is None:
        return np.array([0.0, 0.0, 1.0])
    rows = o.still.rows if len(o.still) else np.arange(len(o.log))
    return np.asarray(np.einsum("nij,nj->i", chain.C[rows], o.log.accel[rows]) / len(rows))


UNEXPLAINED = 0.2
"""Share of the changes of the field that gyros may leave: one that is dead leaves more [1]."""

BIAS = np.radians(5.0)  # No bias of the gyros is believed to be larger at the start [rad/s].


# -- the model -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sizes:
    """How large what is not estimated is [SI]."""

    intensity: float  # B [T]
    intensity_sd: float  # [T]
    basis: str  # of the intensity
    noise: float  # of a reading [T]
    declared: bool  # whether the noise of a reading is
    imu: ImuNoise  # of the IMU [SI]
    gravity: float  # [m/s^2]


@dataclass(frozen=True)
class FieldModel:
    """The model of a session: cells of the field, then of the specific force at rest."""

    observed: Observed
    settings: Settings
    names: tuple[str, ...]
    start: State
    sizes: Sizes

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.names)

    @cached_property
    def kinds(self) -> dict[str, BoolArray]:
        """Kind of reading -> its components, shape (n, 3)."""
        n, k = len(self.observed.cells), len(self.observed.still)
        field = np.tile(np.arange(n + k)[:, None] < n, 3)
        return {"field": field, "gravity": ~field} if k else {"field": field}

    def values(self, state: State) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return state.mag.coefficients(self.names).values

    def retract(self, state: State, step: FloatArray) -> State:
        """Add `step` (m,): coefficients, field, specific force, bias and matrix of the gyros."""
        p = len(self.names)
        other = np.split(step[p:], [3, 6 if len(self.observed.still) else 3])
        up = state.up + other[1] if len(other[1]) else state.up
        return State(
            state.mag.moved(self.names, step[:p]), state.field + other[0], up,
            state.bias + other[2][:3], state.matrix + other[2][3:].reshape(3, 3),
        )  # fmt: skip

    @property
    def readings(self) -> FloatArray:
        """Readings of the magnetometer in the cells, shape (r, 3) [T]."""
        assert self.observed.log.mag is not None
        return self.observed.log.mag[self.observed.cells.rows]

    @cached_property
    def _read(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean field [T], specific force at rest [g], temperature beyond the reference [K]."""
        o, log, g = self.observed, self.observed.log, self.sizes.gravity
        T = log.temperature
        warm = np.zeros(len(o.cells)) if T is None else o.cells.mean(T[o.cells.rows])
        force = np.zeros((0, 3)) if log.accel is None else o.still.mean(log.accel[o.still.rows]) / g
        return o.cells.mean(self.readings), force, warm - (T is not None) * sensor.REFERENCE

    def missed(self, state: State, chain: Chain) -> FloatArray:
        """Return the readings less those of a magnetometer, shape (n, 3) [T, g].

        `chain`: attitudes at `state`.
        """
        o, (mag, force, warm) = self.observed, self._read
        seen = chain.seen(o.cells, self.sizes.intensity * state.field)
        iron = state.mag.bias + np.outer(warm, state.mag.bias_temperature)
        miss = mag - seen @ state.mag.matrix.T - iron
        if not len(o.still):
            return miss
        return np.concatenate([miss, force - chain.seen(o.still, state.up)])

    def chain(self, state: State) -> Chain:
        """Return the attitudes at a state, as late as the magnetometer."""
        return self.observed.turning.chain(state.mag.delay, state.bias, state.matrix)

    def linearise(self, state: State) -> Linearisation:
        """Compare the readings with those of a magnetometer."""
        o, B, A = self.observed, self.sizes.intensity, state.mag.matrix
        n, k = len(o.cells), len(o.still)
        chain = self.chain(state)
        after = o.turning.chain(state.mag.delay + SOON, state.bias, state.matrix)
        m_0 = B * state.field
        seen, moved = chain.seen(o.cells, m_0), A @ chain.seen_by(o.cells, m_0)
        every = np.zeros((n + k, 3, len(LAYOUT)))
        every[:n] = sensor.slopes(seen, self._read[2])
        every[:n, :, 12] = (after.seen(o.cells, m_0) - seen) @ A.T / SOON
        other = np.zeros((n + k, 3, 18 if k else 15))
        other[:n, :, :3], other[:n, :, -12:] = B * moved[:, :, :3], moved[:, :, 3:]
        tilting = moved[:, :, :3] @ cross_matrix(m_0)  # by an error of the attitude
        if k:
            by, still = chain.seen_by(o.still, state.up), chain.seen(o.still, state.up)
            other[n:, :, 3:6], other[n:, :, 6:] = by[:, :, :3], by[:, :, 3:]
            every[n:, :, 12] = (after.seen(o.still, state.up) - still) / SOON
            tilting = np.concatenate([tilting, by[:, :, :3] @ cross_matrix(state.up)])
        chosen = [LAYOUT.index(name) for name in self.names]
        J = np.concatenate([every[:, :, chosen], other], axis=2)
        known, named = self._known(state)
        sources = self._sources(moved[:, :, :3], tilting, every)
        return Linearisation(self.missed(state, chain), J, sources, known, named)

    def _known(self, state: State) -> tuple[tuple[FloatArray, FloatArray], tuple[str, ...]]:
        """White rows of what is known of intensity and gyros."""
        s, p, m = self.settings, len(self.names), len(self.names) + 15
        m += 3 * bool(len(self.observed.still))
        size = float(np.linalg.norm(state.field))
        sd = self.sizes.intensity_sd / self.sizes.intensity
        of_matrix = np.full((3, 3), s.gyro_misalignment_sd)
        np.fill_diagonal(of_matrix, s.gyro_scale_sd)
        sds = np.concatenate([[sd], np.full(3, s.gyro_bias_sd), of_matrix.ravel()])
        value = np.concatenate([[size - 1.0], state.bias, state.matrix.ravel()])
        rows = np.zeros((13, m))
        rows[0, p : p + 3] = state.field / size
        rows[1:, -12:] = np.eye(12)
        of = np.where(np.eye(3, dtype=bool).ravel(), "gyro scale factors", "gyro misalignments")
        named = ("intensity of the field", *["gyro biases"] * 3, *of.tolist())
        return (-value / sds, rows / sds[:, None]), named

    @cached_property
    def _fixed(self) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
        """What hangs on times alone: noise of the cells, attitude noise, wander between cells."""
        o = self.observed
        t = o.time
        n = len(o.cells)
        length = np.concatenate([o.cells.count, o.still.count]) * o.log.interval
        white = self.sizes.noise / np.sqrt(o.cells.count)
        accel = self.sizes.imu.accel.white / self.sizes.gravity / np.sqrt(length[n:])
        # Knots of the random walk of the attitude: each reading has all steps before it.
        knots = np.linspace(o.log.time[0], o.log.time[-1], KNOTS + 1)
        walk = np.clip((t[:, None] - knots[:-1]) / np.diff(knots), 0.0, 1.0)
        walk *= self.sizes.imu.gyro.white * np.sqrt(np.diff(knots))
        wander = {}
        for name, stays in WANDERS.items():
            cov = np.exp(-np.abs(t[:n, None] - t[:n]) / stays)
            wander[name] = np.asarray(np.linalg.cholesky(cov + 1e-9 * np.eye(n)), float)
        return np.concatenate([white, accel]), walk, wander

    def _sources(
        self, moved: FloatArray, tilting: FloatArray, every: FloatArray
    ) -> tuple[Source, ...]:
        white, walk, wander = self._fixed
        n, k = len(moved), len(tilting) - len(moved)
        each = white[:, None, None] * np.eye(3)
        first, last = np.zeros((2, n + k, 3, 3))
        first[:n], last[n:] = each[:n], each[n:]
        how = NOISE_BASIS["declared" if self.sizes.declared else "measured"]
        drift = mixed.tied(tilting, walk)
        out = [
            Source("magnetometer noise", first, noise=True, type=how[0], basis=how[1]),
            Source("gyro noise", shared=drift, noise=True, basis="noise of the gyros"),
        ]
        for name in wander if self.settings.wander else ():
            some = np.zeros((n + k, 3, 3 * n))
            some[:n] = mixed.tied(moved, wander[name])
            out.append(replace(mixed.scatter(name, None, some), unexplained=False))
        if "mag.scale.x" not in self.names:
            held = self.settings.matrix_sd * every[:, :, :9]
            out.append(Source("matrix taken for one", shared=held, basis="matrix_sd as given"))
        if k:
            bias, own = np.zeros((2, n + k, 3, 3))
            bias[n:] = self.settings.accel_bias_sd / self.sizes.gravity * np.eye(3)
            own[n:] = np.eye(3)
            out += [
                Source("accelerometer noise", last, noise=True, basis="their noise"),
                Source("accelerometer bias", shared=bias, basis="accel_bias_sd as given"),
                mixed.scatter(SHAKEN, own),
            ]
            # A hand is never still, and biases jump: two rests cannot tell it from the attitude.
            rest = self.observed.rest
            if rest[-1] + 1 < FEW:
                alone = mixed.tied(bias, np.eye(rest[-1] + 1)[np.append(np.zeros(n, int), rest)])
                out.append(Source(UNSTEADY, shared=alone, basis="accel_bias_sd as given"))
        return tuple(out)


SOON = 1e-7  # A chain so much later says what the delay does [s].
KNOTS = 60  # Steps of the random walk of the attitude [1].

SHAKEN = "scatter of specific force at rest"
UNSTEADY = "specific force that differs from rest to rest"

FEW = 6  # Rests of which fewer do not tell their own scatter [1].


def observe(log: Log, given: Given[Settings]) -> FieldModel:
    """Return the model that a log states."""
    return _model(reduce(without_spikes(log)), given)[0]


def _model(o: Observed, given: Given[Settings]) -> tuple[FieldModel, list[Finding]]:
    """Return the model, and what was noticed on the way."""
    s, world = given.settings, world_field(given.site)
    said = s.intensity or (world.intensity if world else None)
    state, size = start(o, s, said)
    told = _unit(size, said)
    if s.intensity is not None:
        B, sd, basis = s.intensity, s.intensity_sd or 0.003 * s.intensity, "intensity as given"
    elif world is not None:
        B, sd, basis = world.intensity, s.intensity_sd or 0.003 * world.intensity, "world model"
    else:
        B, sd, basis = size, UNKNOWN * size, "norm of the readings, whose gain nobody knows"
    imu = given.noise or grade("mems").noise
    noise = s.noise_sd or _noise(o, state, B)
    sizes = Sizes(B, sd, basis, noise, s.noise_sd is not None, imu, given.site.gravity)
    return FieldModel(o, s, s.estimated(), state, sizes), told


def _noise(o: Observed, state: State, B: float) -> float:
    """Return the noise of a reading, from differences of successive residuals [T].

    What the field or the model does from one reading to the next is slow beside it.
    """
    assert o.log.mag is not None
    rows = o.cells.rows
    chain = o.turning.chain(state.mag.delay, state.bias, state.matrix)
    seen = np.einsum("nji,j->ni", chain.C[rows], B * state.field)
    miss = o.log.mag[rows] - state.mag.measure(seen)
    second = np.diff(miss, 2, axis=0)[(np.diff(rows[:-1]) < 20) & (np.diff(rows[1:]) < 20)]
    return float(np.median(np.std(second, axis=0)) / np.sqrt(6.0))


def again_of(model: FieldModel) -> Again:
    """Return the session read again, at the cells and the rests that were found.

    Without accelerometers nothing is known of the specific force: what it does counts nothing.
    """
    o, sizes = model.observed, model.sizes
    log, gyro = o.log, o.turning.gyro
    force = np.zeros_like(gyro) if log.accel is None else log.accel

    def motion(state: State) -> tuple[ImuModel, Motion]:
        w = gyro - state.bias - gyro @ state.matrix.T
        return ImuModel(), Motion(log.time, force, w, log.time[0], log.time[-1], log.mag)

    last: list[tuple[State, Chain]] = []  # that most terms leave as it is: not of the gyros

    def chain_of(state: State) -> Chain:
        if not last or last[0][0] is not state:
            last[:] = [(state, model.chain(state))]
        return last[0][1]

    def residuals(state: State, by: Change) -> FloatArray:
        changed = {"accel": by.accel, "gyro": by.gyro, "mag": by.mag}
        added = {k: getattr(log, k) + x for k, x in changed.items()
                 if x is not None and getattr(log, k) is not None}  # fmt: skip
        turning = replace(o.turning, gyro=added.get("gyro", gyro))
        read = replace(o, log=replace(log, **added), turning=turning)
        # How strong gravity is does nothing: the specific force at rest is found with its size.
        other = replace(model, observed=read)
        return other.missed(state, chain_of(state) if by.gyro is None else other.chain(state))

    return Again(motion, residuals, (sizes.imu.accel.white, sizes.imu.gyro.white))


# -- the result ------------------------------------------------------------------------------------

UNITS = (1e-6, 1e-3, 0.01, 0.1, 10.0, 100.0, 1e3, 1e6)
"""How many times too large readings are whose unit was said wrongly [1]."""


def _unit(size: float, intensity: float | None) -> list[Finding]:
    """Refuse a field that is not the Earth's; `size`: that of the readings [T]."""
    low, high = EARTH
    if low <= size <= high or (intensity and 0.5 < size / intensity < 2.0):
        return []
    near = min(UNITS, key=lambda k: abs(np.log(size / k / (intensity or 45e-6))))
    if abs(np.log(size / near / (intensity or 45e-6))) < np.log(1.6):
        raise error("mag.unit", size=f"{size * 1e6:.4g}", times=f"{near:g}")
    return [finding("mag.not_earth", size=f"{size * 1e6:.3g}")]


def _solve(log: Log, given: Given[Settings]) -> Result:
    s = given.settings
    given.progress(0.1, "integrating the gyros")
    log = without_spikes(log)
    model, told = _model(reduce(log), given)
    given.progress(0.3, "calibrating")
    # What is left out takes its time, and makes nothing better seen: first without it.
    auto = s.terms == "auto"
    for sizes in (None, given.sizes) if auto and given.sizes is not None else (given.sizes,):
        fit, left = _fitted(model, replace(given, sizes=sizes))
        if poor := auto and _poor(fit, model):
            break
    if poor:
        hard = s.model_copy(update={"terms": "hard iron"})
        again, _ = _model(model.observed, replace(given, settings=hard))
        fit, left = _fitted(again, given)
        told.append(finding("mag.hard_iron", percent=f"{100 * s.matrix_sd:.3g}"))
        model = again
    given.progress(0.7, "judging")
    o, world = model.observed, world_field(given.site)
    field = FieldSeen(fit, model, world)
    told += field.findings(given.site)
    tables = {"heading": field.budget(), "cells": field.cells()} if given.shown else {}
    if tables and world is not None:
        tables["norths"] = field.norths(given.site)
    return result_of(
        "magnetometer", fit,
        (*checks(_judged(fit, model)), *(() if left else _curved(fit, model)), *field.checks()),
        site=given.site,
        findings=(*log.findings, *o.findings, *told), tables=tables,
        diagnostics={"field": field.json()},
        described=(sensor.EQUATION, sensor.FRAME, "axes of the IMU"), table_rate_sd=None,
        validity={"sampled": log.sampled, "rate": log.rate} | temperature_range(log), judged=left,
    )  # fmt: skip


def _fitted(model: FieldModel, given: Given[Settings]) -> tuple[Fit, Judgement | None]:
    """Solve; where the hard iron alone is found, what is known of the matrix does not count."""
    names = np.array(LAYOUT.names)
    mine = {n: v for n, v in given.prior.items() if {*names[LAYOUT.group(n)]} & {*model.names}}
    return left_out.fit(
        model, CoefficientVector.prior(model.layout, mine), given.sizes, given.site,
        again_of(model), robust=given.settings.robust,
    )  # fmt: skip


def _poor(fit: Fit, model: FieldModel) -> bool:
    """Whether the matrix is less well seen than known, the gain that all of it shares aside."""
    if fit.estimate.status is Status.UNOBSERVABLE:
        return True
    shared = np.append(np.diag(fit.state.mag.matrix), fit.estimate.coefficients.values[3:9])
    shared *= model.sizes.intensity_sd / model.sizes.intensity
    left = fit.estimate.coefficients.sd[:9] ** 2 - shared**2
    return bool(left.max() > model.settings.matrix_sd**2)


def _judged(fit: Fit, model: FieldModel) -> Judged:
    o, s = model.observed, model.sizes
    n = len(o.cells)
    part = np.concatenate([np.arange(n) * PARTS // n, np.full(len(o.still), PARTS)])
    edge = s.intensity * UNEVEN

    def named(k: int) -> str:
        mine = o.time[part == k] - o.log.time[0]
        return "the rests" if k == PARTS else f"the part from {mine[0]:.0f} s to {mine[-1]:.0f} s"

    return Judged(
        fit, {"field": "the field", "gravity": "specific force at rest"},
        "declared" if s.declared else "measured", o.time,
        {"field": tuple(WANDERS), "gravity": (SHAKEN,)},
        {name: Limit("The field", edge, 1e6, "uT", "iron near the path, or the field of a room "
                     "with steel in it") for name in WANDERS},
        readings="cells", cure="Turn for longer.", more="turn for longer", blocks=part,
        named=named, predicted="parts of the log", said=SAID,
    )  # fmt: skip


SAID = {
    what: f"how large they are ({key} in [procedure]), or calibrate them first"
    for what, key in (
        ("gyro biases", "gyro_bias_sd"), ("gyro scale factors", "gyro_scale_sd"),
        ("gyro misalignments", "gyro_misalignment_sd"),
    )
} | {
    "intensity of the field": "what it is, or how well that is known (intensity_sd in [procedure])"
}  # fmt: skip
"""What is known of gyros and field, and the setting that says it."""

CURVED = Layout(coefficients_of("magnetometer_curved"))
"""What a sensor that bends adds to its readings."""


def _curved(fit: Fit, model: FieldModel) -> list[Check]:
    """Look for a sensor that bends: it is no field that changes, though it may look like one."""
    o, B, n = model.observed, model.sizes.intensity, len(model.observed.cells)
    y = (model.readings - fit.state.mag.bias) / B
    slope = np.zeros((*fit.at.residuals.shape, 6))
    for k in range(6):
        slope[:n, k % 3, k] = B * o.cells.mean(y ** (2 + k // 3))[:, k % 3]
    columns = np.zeros((len(fit.white.residuals), 6))
    columns[: slope.shape[0] * slope.shape[1]] = fit.covariance.whiten(slope)
    found = find_left_out(fit.white, CURVED.names, columns, kinds=scattering(_judged(fit, model)))
    return left_out_check(found, CURVED, "quadratic and cubic terms of the magnetometer",
                          "Choose a wider range, or take away the iron that does it.")  # fmt: skip


PARTS = 8  # Parts of a log that are held out in turn [1].
UNEVEN = 0.03  # A field that changes by more of itself is no place to calibrate in [1].


@dataclass(frozen=True)
class FieldSeen:
    """What a fit says of the field, and of the heading that follows from it."""

    fit: Fit
    model: FieldModel
    world: WorldField | None

    @cached_property
    def chain(self) -> Chain:
        """Attitudes as found, each as late as the magnetometer."""
        return self.model.chain(self.fit.state)

    @cached_property
    def up(self) -> FloatArray:
        """Direction of up in body axes of the first row, (3,) [g]."""
        o = self.model.observed
        found = (
            self.fit.state.up if len(o.still) else mean_up(o, self.chain) / self.model.sizes.gravity
        )
        return np.asarray(found)

    @cached_property
    def dip(self) -> tuple[float, float]:
        """Dip, positive where the field points down, and its sd; NaN without gravity [rad]."""
        o, cov, p = self.model.observed, self.fit.estimate.state_cov, len(self.model.names)
        if o.log.accel is None:
            return np.nan, np.nan
        some = cov[p : p + 6, p : p + 6]
        if not len(o.still):
            sd = np.hypot(HAND / o.log.duration, self.model.settings.accel_bias_sd)
            some = np.zeros((6, 6))
            some[:3, :3] = cov[p : p + 3, p : p + 3]
            some[3:, 3:] = (sd / self.model.sizes.gravity) ** 2 * np.eye(3)
        size = float(np.linalg.norm(self.up))
        m, u = self.fit.state.field / np.linalg.norm(self.fit.state.field), self.up / size
        sine = float(np.clip(-m @ u, -1.0, 1.0))
        slope = -np.concatenate([u - (u @ m) * m, (m - (u @ m) * u) / size])
        return float(np.arcsin(sine)), float(
            np.sqrt(slope @ some @ slope) / max(np.sqrt(1 - sine**2), 1e-3)
        )

    @cached_property
    def level(self) -> tuple[float, float]:
        """Level part of the field [T], and the tangent of its dip, as headings are reckoned."""
        dip = self.dip[0]
        if not np.isfinite(dip):
            dip = self.world.dip if self.world else USUAL_DIP
        return self.model.sizes.intensity * float(np.cos(dip)), float(np.tan(dip))

    @cached_property
    def heading_sd(self) -> float:
        """Rms over all level headings of what the coefficients leave uncertain of them [rad].

        An error of the field turns a heading by its east component over the level part.
        """
        c, (level, tangent) = self.fit.estimate.coefficients, self.level
        assert c.cov is not None
        m_b, _, east = sensor.level_fields(float(np.arctan(tangent)))
        by = sensor.slopes(level * m_b)[:, :, [LAYOUT.index(n) for n in c.names]]
        slope = (
            np.einsum("ni,ij,njp->np", east, np.linalg.inv(self.fit.state.mag.matrix), by) / level
        )
        return float(np.sqrt(np.mean(np.einsum("np,pq,nq->n", slope, c.cov, slope))))

    def budget(self) -> TableData:
        """Return what makes a level heading uncertain, as a table."""
        level, tangent = self.level
        wander = np.sqrt(sum(v**2 for n, v in self.fit.found.items() if n in WANDERS))
        rows = {
            "calibration": self.heading_sd,
            "field that changes from place to place": wander / level,
            "noise of one reading": self.model.sizes.noise / level,
            "tilt of 1 mrad": 1e-3 * abs(tangent),
        }
        if self.world is not None:
            rows["declination of the world model"] = self.world.declination_sd
        return {"cause": np.array([*rows]), "heading_sd": np.array([*rows.values()], float)}

    def norths(self, site: Site) -> TableData:
        """Return what a magnetic heading lacks of one from other norths, as a table."""
        known = {n.name: n for n in norths(site)}
        magnetic = known.pop("magnetic")
        return {
            "north": np.array([*known]),
            "added": np.array([magnetic.offset - n.offset for n in known.values()]),
            "sd": np.array([np.hypot(magnetic.sd, n.sd) for n in known.values()]),
            "by": np.array([magnetic.basis + f", {n.basis}" * (n.name != "true")
                            for n in known.values()]),
        }  # fmt: skip

    def cells(self) -> TableData:
        """Return the cells, as read and corrected, as a table."""
        o, mag = self.model.observed, self.fit.state.mag
        n, raw = len(o.cells), o.cells.mean(self.model.readings)
        true = self.chain.seen(o.cells, self.model.sizes.intensity * self.fit.state.field)
        left = self.fit.at.residuals[:n]
        field_b = np.linalg.solve(mag.matrix, left.T).T + true
        columns = {"time": o.time[:n], "weight": self.fit.estimate.weights[:n]}
        for name, x in (("raw", raw), ("field", field_b), ("residual", left)):
            columns |= {f"{name}_{a}": x[:, k] for k, a in enumerate(AXES)}
        return columns | {"norm": np.linalg.norm(field_b, axis=1)}

    def spread(self) -> list[float]:
        """Return the sd of headings in this session, before and after the correction [rad]."""
        o, state = self.model.observed, self.fit.state
        C, mag, T = self.chain.C[o.cells.rows], self.model.readings, o.log.temperature
        u = self.up / np.linalg.norm(self.up)
        north = state.field - (state.field @ u) * u
        axes = np.stack([north, np.cross(north, u)]).T / np.linalg.norm(north)
        out = []
        for field_b in (
            mag,
            state.mag.compensate(mag, None, None if T is None else T[o.cells.rows]),
        ):
            level = np.einsum("nij,nj->ni", C, field_b) @ axes @ np.array([1.0, 1j])
            out.append(float(np.std(np.angle(level * np.conj(np.mean(level / np.abs(level)))))))
        return out

    def checks(self) -> tuple[Check, ...]:
        """Return the tests that are its own."""
        o, state, (dip, _) = self.model.observed, self.fit.state, self.dip
        seen = self.chain.seen(o.cells, state.field / np.linalg.norm(state.field))
        even = float(np.linalg.eigvalsh(np.cov(seen.T))[0] * 3)  # a cone about an axis has none
        missing = ", ".join(w for _, w in coverage(seen).missing) or "nothing"
        gains = np.linalg.svd(state.mag.matrix, compute_uv=False)
        out = [
            check("mag heading", "level heading [deg]", np.degrees(self.heading_sd), None, HEADING),
            check("mag coverage", "coverage", even, EVEN, None, {"missing": missing}),
            check("mag axes", "axis ratio", float(gains[0] / gains[2]), None, RATIO),
        ]
        if self.world is not None and np.isfinite(dip):
            given = {"dip": np.degrees(dip), "world": np.degrees(self.world.dip)}
            off = given["dip"] - given["world"]
            out.append(check("mag dip", "dip off the world model [deg]", off, -3.0, 3.0, given))
        return tuple(out)

    def findings(self, site: Site) -> list[Finding]:
        """Say what people want to know, and what looks reversed or turned."""
        c, (dip, sd), out = self.fit.estimate.coefficients, self.dip, []
        _, R = self.fit.state.mag.polar
        angle = float(np.degrees(np.linalg.norm(rotation_vector(R))))
        latitude = 0.0 if site.latitude is None else site.latitude
        clear = abs(latitude) > np.radians(25.0) and abs(dip) > max(5 * sd, np.radians(15.0))
        if angle > TURNED:
            out.append(finding("mag.axes", angle=f"{angle:.3g}", axes=_along(R)))
            if not clear:
                out.append(finding("mag.either_sign", axes=_along(R), other=_along(-R)))
        gain = float(np.cbrt(abs(np.linalg.det(self.fit.state.mag.matrix))))
        if abs(np.log(gain)) > GAIN:
            size = f"{1e6 * gain * self.model.sizes.intensity:.3g}"
            out.append(finding("mag.gain", size=size, ratio=f"{gain:.3g}"))
        some = [k for k, n in enumerate(c.names) if n != "mag.delay"]
        assert c.cov is not None
        far = float(c.values[some] @ np.linalg.solve(c.cov[np.ix_(some, some)], c.values[some]))
        if far < chi_square_limits(len(some))[1]:
            out.append(finding("mag.already_right"))
        if clear and dip * latitude < 0:
            degrees = {"dip": f"{np.degrees(dip):.3g}", "latitude": f"{np.degrees(latitude):.3g}"}
            out.append(finding("mag.dip_reversed", **degrees))
        return out

    def json(self) -> dict[str, Any]:
        """Return what the fit says of the field, for result.json."""
        sizes, (P, R), (dip, sd) = self.model.sizes, self.fit.state.mag.polar, self.dip
        out: dict[str, Any] = {
            "intensity": sizes.intensity, "intensity_sd": sizes.intensity_sd,
            "intensity_basis": sizes.basis, "level_heading_sd": self.heading_sd,
            "rotation": R.tolist(), "symmetric": P.tolist(), "noise_of_a_reading": sizes.noise,
        }  # fmt: skip
        if np.isfinite(dip):
            out |= {"dip": dip, "dip_sd": sd, "heading_spread": self.spread()}
        return out if self.world is None else out | {"world": asdict(self.world)}


def _along(R: FloatArray) -> str:
    """Say along which axes of the IMU the magnetometer's are, by its attitude `R` (3, 3)."""
    along = np.abs(R).argmax(axis=1)
    return ", ".join(f"{a} along {'-' if R[k, along[k]] < 0 else ''}{AXES[along[k]]}"
                     for k, a in enumerate(AXES))  # fmt: skip


USUAL_DIP = np.radians(60.0)  # Where neither accelerometers nor a world model say it [rad].
GAIN = 4 * UNKNOWN  # Logarithm of a gain of all axes that is no sensor's [1].

TURNED = 30.0
"""Axes turned by more are not a sensor that sits askew, but one with other axes [deg]."""

HEADING = 1.0  # A level heading that is known worse is hardly worth a calibration [deg].

EVEN = 0.03
"""Spread of the field along its least covered direction, of that over a whole sphere, below which
hard iron and field are hardly told apart there [1]."""

RATIO = 1.3  # Soft iron does not stretch the field by more; saturation or a wrong scale does [1].


# -- a simulated session ---------------------------------------------------------------------------


class Session(Strict):
    """The session that `simulate` makes."""

    motion: Literal["free", "rests"] = "free"
    """free: turned all the time, with a rest before and after; rests: turned from rest to rest."""
    time: Seconds = Field(default=60.0, gt=5)
    """Length of the free turning."""
    pace: Rate = Field(default=float(np.radians(150.0)), gt=0)
    """How fast it is turned, rms."""
    rests: int = Field(default=24, ge=2)
    """Number of rests, where it is turned from rest to rest."""
    rest_time: Seconds = Field(default=2.0, gt=0)
    """Length of a rest."""
    turn_time: Seconds = Field(default=1.5, gt=0)
    """Length of a turn."""
    rate: record.SampleRate = 100.0
    kind: record.Sampling = "rate"
    intensity: Tesla = Field(default=49e-6, gt=0)
    """Intensity of the field."""
    dip: Angle = float(np.radians(66.0))
    """Dip of the field, positive where it points down."""
    noise_sd: Tesla = Field(default=0.3e-6, ge=0)
    """Noise of a reading of the magnetometer."""
    wander_sd: Tesla = Field(default=0.0, ge=0)
    """How much the field changes from place to place."""
    wander_time: Seconds = Field(default=1.0, gt=0)
    """For how long it stays the same."""


def _planned(session: Session) -> RestPlan | Free:
    """Return what a hand is to do."""
    if session.motion == "free":
        return Free("turn it through all directions", session.time)
    plan = hand_plan(session.rests)
    rests, turns = np.full(session.rests, session.rest_time), session.turn_time
    return replace(plan, rest_time=rests, turn_time=np.full(session.rests - 1, turns))


MAG_LINE = """\
mag = { columns = ["mag_x", "mag_y", "mag_z"], unit = "T" }    # T, uT, nT, mG, G or count
# Counts need a scale:  mag = { columns = [...], unit = "count", scale = "6.7 count/uT" }
# A magnetometer in the same case often has other axes: name its columns in the order of the IMU.
# Where the temperature was logged:  temperature = { column = "temperature", unit = "degC" }
"""

NOISE_LINES = """\
# Noise of gyros and accelerometers. Left out, that of MEMS instruments is taken; that of the
# magnetometer is noise_sd above.
# [noise]
# grade = "mems"                        # mems, tactical, navigation: typical values
# part = "ICM-20948"                    # or the data sheet of one; `foucault parts` lists them
"""


def log_table(log: Log | None) -> str:
    """Write [log] of the template, or of a log that was simulated."""
    return OWN_LOG if log is not None and log.sampled == "increment" else log_head() + MAG_LINE


PROCEDURE = Procedure(
    name="magnetometer",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: _planned(session),
    simulation=simulate_field,
    observe=observe,
    again=lambda model, *_: again_of(model),
    names=lambda settings, _: settings.estimated(),
    layout=LAYOUT,
    draw_errors=draw_errors,
    table_rate_sd=None,
    sizes=lambda session, _: dict.fromkeys(WANDERS, session.wander_sd),
    log_table=log_table,
    noise_lines=NOISE_LINES,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
