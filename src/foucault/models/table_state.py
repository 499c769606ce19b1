"""What readings on a table must be, and how they change with everything unknown.

Unknown are the coefficients of the instrument, the lever arm, and how the instrument was turned
(see `table_geometry`).

With o the direction of up (rest) or of the outer axis (spin) in body axes::

    f = g c o - h^2 (r - (r.o) o)       accel = M_a f + b_a + K q(f)
    w = h o                             gyro  = M_g w + b_g + G f

h is the rate of the table and the Earth's rate along the outer axis, r the lever arm. c is 1 at
rest; in spins it is the cosine of the tilt of the outer axis, unknown on a table of which nothing
is believed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.readings import Readings
from foucault.models.table_geometry import Geometry


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
    f = turntable.mean_force(o, h, 1.0, state.lever_arm) + (g - 1.0)[:, None] * o
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
