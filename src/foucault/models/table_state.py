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

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import ImuModel, coefficient_slot, products, products_slope
from foucault.models.readings import Readings
from foucault.models.table_geometry import Geometry

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """Everything unknown.

    Attributes
    ----------
    model : ImuModel
        The instrument.
    geometry : Geometry
        How it was turned.
    lever_arm : ndarray, shape (3,)
        The accelerometers from the centre of the table, body axes [m].
    level : float
        ln of the norm of the mean specific force in spins over local gravity [1].
    offset : ndarray, shape (3,)
        Gyro bias at rest minus that in spins: they are measured at different times [rad/s].
    wander : ndarray, shape (n, 6), or None
        Slow biases in each reading less their long-term mean, accelerometers and gyros; None for
        zero [SI].
    """

    model: ImuModel
    geometry: Geometry
    lever_arm: FloatArray
    level: float = 0.0
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))
    wander: FloatArray | None = None


@dataclass(frozen=True)
class Unknowns:
    """Which unknowns a step has.

    In order: coefficients, lever arm, level, offset, geometry, and for every reading how far the
    slow biases of accelerometers and of gyros are from their long-term mean.

    Attributes
    ----------
    names : tuple of str
        Coefficients.
    lever_arm, level, offset : bool
        Whether these are unknown.
    wander : tuple of bool, shape (2,)
        Whether the slow biases of accelerometers and of gyros are [1].
    """

    names: tuple[str, ...]
    lever_arm: bool
    level: bool
    offset: bool = False
    wander: tuple[bool, bool] = (False, False)

    @property
    def before_geometry(self) -> int:
        """Number of unknowns before those of the geometry [1]."""
        return len(self.names) + 3 * self.lever_arm + self.level + 3 * self.offset


@dataclass(frozen=True)
class Prediction:
    """What the readings should be, with derivatives.

    Attributes
    ----------
    accel, gyro : ndarray, shape (n, 3)
        Readings without noise [SI].
    accel_slope, gyro_slope : ndarray, shape (n, 3, u)
        Their derivatives by the unknowns.
    f_b, w_b : ndarray, shape (n, 3)
        True specific force and rate [SI].
    """

    accel: FloatArray
    gyro: FloatArray
    accel_slope: FloatArray
    gyro_slope: FloatArray
    f_b: FloatArray
    w_b: FloatArray


def predict(state: State, readings: Readings, site: Site, unknowns: Unknowns) -> Prediction:
    """Predict readings and how they change with everything unknown.

    Parameters
    ----------
    state : State
        Values of the unknowns.
    readings : Readings
        Where the table stood and how it turned.
    site : Site
        Gravity.
    unknowns : Unknowns
        What the derivatives are by.
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
    accel_by_f = state.model.accel_matrix + np.einsum(
        "ik,nkj->nij", state.model.accel_quadratic, products_slope(f)
    )
    own_accel, own_gyro = _coefficient_slope(unknowns.names, f, w)
    gyro_by_all = state.model.gyro_matrix @ w_slope + state.model.g_sensitivity @ f_slope
    if unknowns.offset:
        at = unknowns.before_geometry - len(unknowns.names) - 3
        gyro_by_all[~spin, :, at : at + 3] = eye
    if state.wander is not None:
        accel, gyro = accel + state.wander[:, :3], gyro + state.wander[:, 3:]
    accel_slope = [own_accel, accel_by_f @ f_slope]
    gyro_slope = [own_gyro, gyro_by_all]
    for mine, other, used in (
        (accel_slope, gyro_slope, unknowns.wander[0]),
        (gyro_slope, accel_slope, unknowns.wander[1]),
    ):
        if used:  # three unknowns per reading
            n = len(o)
            mine.append(np.einsum("nm,ij->nimj", np.eye(n), eye).reshape(n, 3, 3 * n))
            other.append(np.zeros((n, 3, 3 * n)))
    return Prediction(
        accel, gyro, np.concatenate(accel_slope, axis=2), np.concatenate(gyro_slope, axis=2), f, w
    )


def _coefficient_slope(
    names: tuple[str, ...], f: FloatArray, w: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the readings by the coefficients, shape (n, 3, len(names))."""
    accel, gyro = np.zeros((len(f), 3, len(names))), np.zeros((len(f), 3, len(names)))
    inputs = {"accel_matrix": f, "accel_quadratic": products(f), "gyro_matrix": w}
    inputs["g_sensitivity"] = f
    for k, name in enumerate(names):
        block, where = coefficient_slot(name)
        side = accel if block.startswith("accel") else gyro
        if block.endswith("bias"):
            side[:, where, k] = 1.0
        else:
            side[:, where[0], k] = inputs[block][:, where[1]]
    return accel, gyro


def moved(state: State, step: FloatArray, unknowns: Unknowns) -> State:
    """Return the state after a step.

    Parameters
    ----------
    state : State
        Values of the unknowns.
    step : ndarray, shape (u,)
        Change of each unknown [SI].
    unknowns : Unknowns
        What the entries of the step are.
    """
    n = len(unknowns.names)
    coefficients = state.model.coefficients()
    added = coefficients.values.copy()
    for name, value in zip(unknowns.names, step[:n], strict=True):
        added[coefficients.layout.index(name)] += value
    model = ImuModel.from_coefficients(replace(coefficients, values=added))
    lever_arm, at = state.lever_arm, n
    if unknowns.lever_arm:
        lever_arm, at = lever_arm + step[at : at + 3], at + 3
    level = state.level + float(step[at]) if unknowns.level else state.level
    at += unknowns.level
    offset = state.offset
    if unknowns.offset:
        offset, at = offset + step[at : at + 3], at + 3
    end = at + len(state.geometry.prior()[0])
    geometry = state.geometry.moved(step[at:end])
    wander = state.wander
    if any(unknowns.wander):
        n = (len(step) - end) // (3 * sum(unknowns.wander))
        wander = np.zeros((n, 6)) if wander is None else wander.copy()
        for k in np.flatnonzero(unknowns.wander):
            wander[:, 3 * k : 3 * k + 3] += step[end : end + 3 * n].reshape(n, 3)
            end += 3 * n
    return State(model, geometry, lever_arm, level, offset, wander)
