"""A three-axis table: from its angles and its errors to the attitude of what it carries.

Axes: the outer axis is nearly vertical, the middle axis is carried by it, the inner axis by the
middle one. Case axes k are parallel to the middle (x), inner (y) and outer (z) axes when all
angles are zero. Table axes t are fixed to the ground, z up. With active rotation matrices::

    C_tk = Rx(plumb_x) Ry(plumb_y) Rz(outer) Ry(p_mo) Rx(middle + zero_m + e_m)
           Rz(p_im) Ry(inner + zero_i + e_i)

plumb: the outer axis is not vertical; p_mo, p_im: middle not perpendicular to outer, inner not to
middle; zero: constant errors of the angle readings; e: another error in every position.

The outer axis points along ``u = (-cos(middle) sin(inner), sin(middle), cos(middle) cos(inner))``
in case axes where the table is perfect, and so does up.

The body axes b of the instrument (see `models.imu`) are mounted on k with a small rotation:
``C_bk = Exp(-[mounting x])``.

How an instrument was turned on a table: directions, and how they change with the unknowns.

Either nothing is believed of the table (`Free`: every reading has a direction of its own, two
unknowns each), or its angles are believed with errors of known size (`Angles`: the mounting, six
errors that all positions share, two more in every position, and the heading).

What readings on a table must be, and how they change with everything unknown.

Unknown are the coefficients of the instrument, the lever arm, and how the instrument was turned
(a `Geometry`).

With o the direction of up (rest) or of the outer axis (spin) in body axes::

    f = g c o - h^2 (r - (r.o) o)       accel = M_a f + b_a + K q(f)
    w = h o                             gyro  = M_g w + b_g + G f

h is the rate of the table and the Earth's rate along the outer axis, r the lever arm. c is 1 at
rest; in spins it is the cosine of the tilt of the outer axis, unknown on a table of which nothing
is believed.

References
----------
.. [1] Dong, Ren, Chen, Wang, "Calibration method for the laser gyro strapdown inertial navigation
   system based on norm-observation", Infrared and Laser Engineering 47(9), 2018, section 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Layout, coefficients_of
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import Readings
from foucault.models.rotation import cross_matrix, exp

RIG = Layout(coefficients_of("table"))
"""What a session on a table can find beside the coefficients of the instrument."""

COMMON = RIG.names[:6]
"""Names of the angle errors that all positions share."""


@dataclass(frozen=True)
class TablePlan:
    """What a table is told to do: rests, and spins of the outer axis."""

    name: str  # name of the plan, shape ()
    # (n, 3) outer, middle and inner angle of each position; the outer one is where a spin starts
    # [rad]
    angles: FloatArray
    # (n,) rate of the outer axis, counter-clockwise seen from above; 0 for a rest [rad/s]
    rate: FloatArray
    time: FloatArray  # (n,) length of each rest, or of the whole turns of a spin [s]

    def __len__(self) -> int:
        return len(self.rate)


@dataclass(frozen=True)
class TableErrors:
    """Errors of a table that are the same in all positions."""

    # plumb_x, plumb_y: tilt of the outer axis about table x, then y [rad]
    plumb_x: float = 0.0
    plumb_y: float = 0.0
    # middle_outer, inner_middle: departures from the perpendicular p_mo and p_im [rad]
    middle_outer: float = 0.0
    inner_middle: float = 0.0
    # middle_zero, inner_zero: zero errors of the angle readings: true minus said [rad]
    middle_zero: float = 0.0
    inner_zero: float = 0.0

    @property
    def values(self) -> FloatArray:
        """The six errors in the order of `COMMON`, shape (6,) [rad]."""
        return np.array([getattr(self, f.name) for f in fields(self)])

    @classmethod
    def of(cls, values: FloatArray) -> TableErrors:
        """Take six errors in the order of `COMMON` from `values`, shape (6,) [rad]."""
        return cls(*(float(v) for v in values))


@dataclass(frozen=True)
class Chain:
    """Attitudes of the case, and the axes that errors turn it about."""

    C_tk: FloatArray  # (n, 3, 3) attitude of the case [1]
    # (n, 3, 7) in case axes the directions of the seven elementary rotations plumb x, plumb y,
    # outer, p_mo, middle, p_im, inner: a small increase e of one turns ``C_tk`` into ``C_tk Exp([a
    # e x])``
    axes: FloatArray

    @property
    def up_k(self) -> FloatArray:
        """Direction of up in case axes, shape (n, 3) [1]."""
        return np.asarray(self.C_tk[:, 2, :])

    @property
    def outer_k(self) -> FloatArray:
        """Direction of the outer axis in case axes, shape (n, 3) [1]."""
        return np.asarray(self.axes[:, :, 2])


PLUMB_X, PLUMB_Y, OUTER, MIDDLE_OUTER, MIDDLE, INNER_MIDDLE, INNER = range(7)
"""Columns of `Chain.axes`."""

COMMON_AXES = (PLUMB_X, PLUMB_Y, MIDDLE_OUTER, INNER_MIDDLE, MIDDLE, INNER)
"""The column of `Chain.axes` for each of `COMMON`."""

_ABOUT = (0, 1, 2, 1, 0, 2, 1)  # the axis each elementary rotation is about


def chain(
    angles: FloatArray, errors: TableErrors | None = None, position: FloatArray | None = None
) -> Chain:
    """Compute the attitude of the case for angles of the table.

    `angles` (n, 3): outer, middle and inner angle as the table says [rad]; `errors` or None:
    errors that all positions share [rad]; `position` (n, 2) or None: errors of the middle and the
    inner angle in each position [rad].
    """
    e = errors or TableErrors()
    extra = np.zeros((len(angles), 2)) if position is None else position
    one = np.ones(len(angles))
    turns = (
        e.plumb_x * one,
        e.plumb_y * one,
        angles[:, 0],
        e.middle_outer * one,
        angles[:, 1] + e.middle_zero + extra[:, 0],
        e.inner_middle * one,
        angles[:, 2] + e.inner_zero + extra[:, 1],
    )
    C = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    axes = np.empty((len(angles), 3, 7))
    for k in reversed(range(7)):  # C is what follows rotation k: its axis is a row of C
        axes[:, :, k] = C[:, _ABOUT[k], :]
        C = elementary(_ABOUT[k], turns[k]) @ C
    return Chain(C, axes)


def elementary(axis: int, angle: FloatArray) -> FloatArray:
    """Return active rotation matrices about x, y or z, shape (n, 3, 3) [1].

    `axis`: 0, 1 or 2 for x, y or z [1]; `angle` (n,): angles [rad].
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((len(angle), 3, 3))
    c, s = np.cos(angle), np.sin(angle)
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = c
    out[:, i, j], out[:, j, i] = -s, s
    return out


def up_k(angles: FloatArray) -> FloatArray:
    """Return the direction of up in case axes on a perfect table, shape (n, 3) [1].

    `angles` (n, 3): outer, middle and inner angle [rad].
    """
    a, b = angles[:, 1], angles[:, 2]
    return np.stack([-np.cos(a) * np.sin(b), np.sin(a), np.cos(a) * np.cos(b)], axis=1)


def earth_rate_t(latitude: float, heading: float) -> FloatArray:
    """Return the Earth's rotation in table axes, shape (3,) [rad/s].

    `latitude`: geodetic latitude, positive north [rad]; `heading`: azimuth of table y, clockwise
    from North [rad].
    """
    horizontal = np.cos(latitude)
    return EARTH_RATE * np.array(
        [-horizontal * np.sin(heading), horizontal * np.cos(heading), np.sin(latitude)]
    )


def mean_rate(rate: FloatArray, latitude: float) -> FloatArray:
    """Return the norm of the mean rate over whole turns about up, with the sign of `rate`.

    ``h = rate + w_ie sin L``: the horizontal part of the Earth's rotation averages to zero.

    `rate` (n,): rate of the outer axis, counter-clockwise seen from above [rad/s]; `latitude`:
    geodetic latitude, positive north [rad].
    """
    return np.asarray(rate + EARTH_RATE * np.sin(latitude))


def mean_force(up: FloatArray, h: FloatArray, gravity: float, lever_arm: FloatArray) -> FloatArray:
    """Return the mean specific force over whole turns, shape (n, 3) [m/s^2].

    ``f = g o - h^2 (r - (r.o) o)``: gravity along the axis, and the centripetal acceleration.

    `up` (n, 3): direction o of up at rest, or of the outer axis in a spin, body axes [1]; `h`
    (n,): rate about it, 0 at rest [rad/s]; `gravity`: local gravity [m/s^2]; `lever_arm` (3,):
    the accelerometers from the centre of the table, body axes [m].
    """
    across = lever_arm - (up @ lever_arm)[:, None] * up
    return np.asarray(gravity * up - (h**2)[:, None] * across)


@dataclass(frozen=True)
class Axis:
    """The outer axis: the Earth's rate along it, its cosine with up, and their derivatives."""

    earth: float  # Earth's rate along the outer axis [rad/s]
    level: float  # cosine of the angle between the outer axis and up [1]
    # earth_slope, level_slope: (u,) derivatives by the unknowns of the geometry
    earth_slope: FloatArray
    level_slope: FloatArray


class Geometry(Protocol):
    """How the instrument was turned: directions, rest rates, and their derivatives."""

    def directions(self) -> FloatArray:
        """Return up (rest) or the outer axis (spin) in body axes, shape (n, 3) [1]."""
        ...

    def directions_slope(self) -> FloatArray:
        """Return the derivative of `directions` by the unknowns, shape (n, 3, u) [1 / rad]."""
        ...

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's rate in body axes at rest and its derivative by the unknowns.

        Shapes (n, 3) [rad/s] and (n, 3, u).
        """
        ...

    def axis(self) -> Axis:
        """Return what the tilt of the outer axis does to spins."""
        ...

    def moved(self, step: FloatArray) -> Geometry:
        """Return the geometry after a `step`, shape (u,) [rad]."""
        ...

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns that have a prior of mean zero, over their sd, and the sd.

        Both shape (u,) [1] and [rad]; an infinite sd where there is none.
        """
        ...


@dataclass(frozen=True)
class Free:
    """Nothing is believed of the table: every reading has its own direction."""

    o: FloatArray  # (n, 3) directions, body axes [1]
    vertical: float = 0.0  # vertical part of the Earth's rate, 0 where unknown [rad/s]

    def directions(self) -> FloatArray:
        """Return `o`."""
        return self.o

    def directions_slope(self) -> FloatArray:
        """Return two tangents per direction, each an unknown of its own."""
        n = len(self.o)
        out = np.zeros((n, 3, n, 2))
        out[np.arange(n), :, np.arange(n), :] = tangents(self.o)
        return out.reshape(n, 3, 2 * n)

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the vertical part; the horizontal part is in the covariance of the readings."""
        return self.vertical * self.o, self.vertical * self.directions_slope()

    def axis(self) -> Axis:
        """Take the outer axis for vertical; `State.level` is there for the specific force."""
        none = np.zeros(2 * len(self.o))
        return Axis(self.vertical, 1.0, none, none)

    def moved(self, step: FloatArray) -> Free:
        """Return the directions moved along their tangents by `step`, shape (2 n,) [rad]."""
        shift = np.einsum("nik,nk->ni", tangents(self.o), step.reshape(-1, 2))
        size = np.linalg.norm(shift, axis=1, keepdims=True)
        o = np.cos(size) * self.o + np.sinc(size / np.pi) * shift
        return replace(self, o=o / np.linalg.norm(o, axis=1, keepdims=True))

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return that nothing is known."""
        n = 2 * len(self.o)
        return np.zeros(n), np.full(n, np.inf)


def tangents(o: FloatArray) -> FloatArray:
    """Return two unit vectors across each direction, shape (n, 3, 2) [1].

    `o` (n, 3): unit vectors [1].
    """
    K = cross_matrix(o)
    first = K[np.arange(len(o)), :, np.argmin(np.abs(o), axis=1)]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, (K @ first[:, :, None])[:, :, 0]], axis=2)


@dataclass(frozen=True)
class Trust:
    """How far the angles of a table are believed."""

    # (6,) sd of the errors that all positions share, in the order of `COMMON`; 0 where an
    # error is excluded [rad]
    common_sd: FloatArray
    # sd of the errors that differ from one position to the next; 0 excludes them [rad]
    position_sd: float
    latitude: float | None  # latitude, for the Earth's rate at rest [rad]
    basis: str = "what the campaign says of the table"  # what these sizes rest on


DOUBTED = np.radians(30.0)
"""Sd of an angle that is not believed: wide enough to say nothing, and finite, since an inner angle
about the vertical is seen by nothing else [rad]."""

STRAIGHT = 1e-6
"""Steps smaller than this need no correction: its square is beyond any reading [rad]."""


@dataclass(frozen=True)
class Angles:
    """The angles of the table are believed, with errors of known size."""

    readings_angles: FloatArray  # (n, 3) outer, middle and inner angle as the table says [rad]
    spin: npt.NDArray[np.bool_]  # (n,) which readings are spins
    trust: Trust  # sizes of the errors
    C_bk: FloatArray  # (3, 3) mounting [1]
    common: FloatArray  # (6,) errors that all positions share [rad]
    position: FloatArray  # (n, 2) errors of the middle and inner angle in each position [rad]
    heading: float | None  # azimuth of table y [rad]; None where no rest says anything of it
    doubted: tuple[int, ...] = ()  # (k,) readings whose middle and inner angle are not believed [1]

    @property
    def used(self) -> npt.NDArray[np.intp]:
        """Which of the common errors are unknowns, shape (<= 6,)."""
        return np.flatnonzero(self.trust.common_sd > 0)

    @cached_property
    def _chain(self) -> Chain:
        errors = TableErrors.of(self.common)
        return chain(self.readings_angles, errors, self.position)

    def directions(self) -> FloatArray:
        """Return up (rest) or the outer axis (spin)."""
        at = self._chain
        return np.where(self.spin[:, None], at.outer_k, at.up_k) @ self.C_bk.T

    def directions_slope(self) -> FloatArray:
        """Return the derivative by mounting, common errors, position errors and heading."""
        at = self._chain
        o = np.where(self.spin[:, None], at.outer_k, at.up_k) @ self.C_bk.T
        axes = self.C_bk @ at.axes
        # What comes before the outer axis does not move it.
        axes[self.spin, :, : OUTER + 1] = 0.0
        return self._slope(o, axes, np.zeros_like(o))

    def _slope(self, v: FloatArray, axes: FloatArray, heading: FloatArray) -> FloatArray:
        """Return how vectors v, shape (n, 3), turn: ``dv = v x a de`` for every axis a."""
        n = len(v)
        cross = cross_matrix(v)
        turned = cross @ axes
        columns = [cross, turned[:, :, [COMMON_AXES[k] for k in self.used]]]
        if self.trust.position_sd > 0:
            each = np.zeros((n, 3, n, 2))
            each[np.arange(n), :, np.arange(n), :] = turned[:, :, [MIDDLE, INNER]]
            columns.append(each.reshape(n, 3, 2 * n))
        if self.heading is not None:
            columns.append(heading[:, :, None])
        return np.concatenate(columns, axis=2)

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's rate at rest."""
        at = self._chain
        n = len(self.spin)
        if self.heading is None or self.trust.latitude is None:
            zero = np.zeros((n, 3))
            return zero, self._slope(zero, np.zeros((n, 3, 7)), zero)
        C_bt = self.C_bk @ np.swapaxes(at.C_tk, 1, 2)
        w_t = earth_rate_t(self.trust.latitude, self.heading)
        w = C_bt @ w_t
        quarter = earth_rate_t(self.trust.latitude, self.heading + np.pi / 2)
        by_heading = C_bt @ np.array([quarter[0], quarter[1], 0.0])
        return w, self._slope(w, self.C_bk @ at.axes, by_heading)

    def axis(self) -> Axis:
        """Return what the plumb errors of the table do."""
        x, y = self.common[:2]
        o = np.array([np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y)])
        by_x = np.array([0.0, -np.cos(x) * np.cos(y), -np.sin(x) * np.cos(y)])
        by_y = np.array([np.cos(y), np.sin(x) * np.sin(y), -np.cos(x) * np.sin(y)])
        w, quarter = np.zeros(3), np.zeros(3)
        if self.trust.latitude is not None:
            w = earth_rate_t(self.trust.latitude, self.heading or 0.0)
            quarter = earth_rate_t(self.trust.latitude, (self.heading or 0.0) + np.pi / 2)
            quarter[2] = 0.0
        if self.heading is None:
            w[:2] = 0.0
        earth, level = np.zeros(len(self.prior()[0])), np.zeros(len(self.prior()[0]))
        for k, by in ((0, by_x), (1, by_y)):
            for at in 3 + np.flatnonzero(self.used == k):
                earth[at], level[at] = w @ by, by[2]
        if self.heading is not None:
            earth[-1] = quarter @ o
        return Axis(float(w @ o), float(o[2]), earth, level)

    def moved(self, step: FloatArray) -> Angles:
        """Return the geometry after a `step`, shape (u,) [rad].

        Directions follow the step along straight lines: readings tell them far better than the
        angles, and an iteration that left them would bend its way along a narrow valley.
        """
        used, n = self.used, len(self.spin)
        common = self.common.copy()
        common[used] += step[3 : 3 + len(used)]
        at = 3 + len(used)
        heading = None if self.heading is None else self.heading + float(step[-1])
        new = replace(self, C_bk=exp(-step[:3]) @ self.C_bk, common=common, heading=heading)
        if self.trust.position_sd == 0:
            return new
        new = replace(new, position=self.position + step[at : at + 2 * n].reshape(n, 2))
        if np.abs(step).max() < STRAIGHT:
            return new
        o = self.directions() + self.directions_slope() @ step
        return new.pointed(o / np.linalg.norm(o, axis=1, keepdims=True))

    def pointed(self, o: FloatArray) -> Angles:
        """Change the angles of every position until they give directions.

        `o` (n, 3): directions wanted, body axes [1].
        """
        new = self
        for _ in range(4):
            at = new._chain
            now = np.where(new.spin[:, None], at.outer_k, at.up_k) @ new.C_bk.T
            axes = new.C_bk @ at.axes[:, :, [MIDDLE, INNER]]
            # The inner angle does nothing where its axis is vertical: it is left as it is then.
            turn = np.linalg.pinv(cross_matrix(now) @ axes, rcond=1e-2) @ (o - now)[:, :, None]
            new = replace(new, position=new.position + turn[:, :, 0])
            if np.abs(turn).max(initial=0.0) < STRAIGHT:
                break
        return new

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the errors of the table over their sds, and the sds."""
        none, free = np.zeros(3), np.full(3, np.inf)
        values, sds = [none, self.common[self.used]], [free, self.trust.common_sd[self.used]]
        if self.trust.position_sd > 0:
            values.append(self.position.reshape(-1))
            each = np.full(self.position.shape, self.trust.position_sd)
            each[list(self.doubted)] = DOUBTED
            sds.append(each.reshape(-1))
        if self.heading is not None:
            values.append(np.zeros(1))
            sds.append(np.full(1, np.inf))
        sd = np.concatenate(sds)
        return np.concatenate(values) / sd, sd


@dataclass(frozen=True)
class State:
    """Everything unknown."""

    model: ImuModel
    geometry: Geometry  # how it was turned
    lever_arm: FloatArray  # (3,) the accelerometers from the centre of the table, body axes [m]
    level: float = 0.0  # ln of the norm of the mean specific force in spins over local gravity [1]
    # (3,) gyro bias at rest minus that in spins: they are measured at different times [rad/s]
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Unknowns:
    """Which unknowns a step has: coefficients, lever arm, level, offset, geometry."""

    names: tuple[str, ...]
    # lever_arm, level, offset: whether these are unknown
    lever_arm: bool
    level: bool
    offset: bool = False

    @property
    def before_geometry(self) -> int:
        """Number of unknowns before those of the geometry [1]."""
        return len(self.names) + 3 * self.lever_arm + self.level + 3 * self.offset


@dataclass(frozen=True)
class Prediction:
    """What the readings should be, with derivatives."""

    # accel, gyro: (n, 3) readings without noise [SI]
    accel: FloatArray
    gyro: FloatArray
    # accel_slope, gyro_slope: (n, 3, u) their derivatives by the unknowns
    accel_slope: FloatArray
    gyro_slope: FloatArray
    # f_b, w_b: (n, 3) true specific force and rate [SI]
    f_b: FloatArray
    w_b: FloatArray


def predict(state: State, readings: Readings, site: Site, unknowns: Unknowns) -> Prediction:
    """Predict readings and how they change with everything unknown.

    `readings`: where the table stood and how it turned.
    """
    spin = readings.spin
    o, o_slope = state.geometry.directions(), state.geometry.directions_slope()
    w_earth, earth_slope = state.geometry.earth()
    axis = state.geometry.axis()
    h = np.where(spin, readings.rate + axis.earth, 0.0)
    g = site.gravity * np.where(spin, axis.level * np.exp(state.level), 1.0)
    f = mean_force(o, h, 1.0, state.lever_arm) + (g - 1.0)[:, None] * o
    w = np.where(spin[:, None], h[:, None] * o, w_earth)
    r, along = state.lever_arm, o @ state.lever_arm
    eye = np.eye(3)
    f_by_o = (g + h**2 * along)[:, None, None] * eye
    f_by_o = f_by_o + (h**2)[:, None, None] * (o[:, :, None] * r)
    # Unknowns in order: what acts on f and on w.
    parts_f, parts_w = [], []
    if unknowns.lever_arm:
        across = eye - o[:, :, None] * o[:, None, :]
        parts_f.append(-(h**2)[:, None, None] * across)
        parts_w.append(np.zeros((len(o), 3, 3)))
    if unknowns.level:
        parts_f.append((np.where(spin, g, 0.0)[:, None] * o)[:, :, None])
        parts_w.append(np.zeros((len(o), 3, 1)))
    if unknowns.offset:
        parts_f.append(np.zeros((len(o), 3, 3)))
        parts_w.append(np.zeros((len(o), 3, 3)))  # it acts on the reading, not on the rate
    # Of the outer axis: what its tilt does to the rate along it and to gravity's share.
    by_rate = -2 * h[:, None] * (r - along[:, None] * o)
    f_by_axis = by_rate[:, :, None] * axis.earth_slope
    f_by_axis = f_by_axis + (g / axis.level)[:, None, None] * o[:, :, None] * axis.level_slope
    w_by_axis = o[:, :, None] * axis.earth_slope
    turns = spin[:, None, None]
    parts_f.append(f_by_o @ o_slope + np.where(turns, f_by_axis, 0.0))
    parts_w.append(np.where(turns, h[:, None, None] * o_slope + w_by_axis, earth_slope))
    f_slope, w_slope = np.concatenate(parts_f, axis=2), np.concatenate(parts_w, axis=2)
    accel, gyro = state.model.measure(f, w)
    gyro = gyro + np.where(spin[:, None], 0.0, state.offset)
    slopes = state.model.slopes(f, w, unknowns.names)
    gyro_by_all = slopes.gyro_by_rate @ w_slope + slopes.gyro_by_force @ f_slope
    if unknowns.offset:
        at = unknowns.before_geometry - len(unknowns.names) - 3
        gyro_by_all[~spin, :, at : at + 3] = eye
    accel_slope = np.concatenate([slopes.accel, slopes.accel_by_force @ f_slope], axis=2)
    gyro_slope = np.concatenate([slopes.gyro, gyro_by_all], axis=2)
    return Prediction(accel, gyro, accel_slope, gyro_slope, f, w)


def moved(state: State, step: FloatArray, unknowns: Unknowns) -> State:
    """Return the state after a step.

    `step` (u,): change of each unknown [SI].
    """
    n = len(unknowns.names)
    model = state.model.moved(unknowns.names, step[:n])
    lever_arm, at = state.lever_arm, n
    if unknowns.lever_arm:
        lever_arm, at = lever_arm + step[at : at + 3], at + 3
    level = state.level + float(step[at]) if unknowns.level else state.level
    at += unknowns.level
    offset = state.offset
    if unknowns.offset:
        offset, at = offset + step[at : at + 3], at + 3
    geometry = state.geometry.moved(step[at:])
    return State(model, geometry, lever_arm, level, offset)
