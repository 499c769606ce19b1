"""What three accelerometers that are not at one point, or not at one time with the gyros, read.

An accelerometer at r_i from the point that is navigated, in body axes, reads besides::

    (w x (w x r_i) + w' x r_i) along its own axis i          (size effect)

and one whose readings are stamped later than the gyros' by tau reads ``f(t - tau) = f - tau f'``.
Both are linear in r_i and tau, with products and derivatives of the rates as inputs (see
`kernels.ins_filter`); the derivatives are central differences of the readings.

Where all three are shifted alike the point that is navigated is another one: a set of lever arms is
known but for such a shift. Here r_z is zero: the point is the z accelerometer.

They are taken away as the filter that finds them does: from the readings, with the compensated rate
and the derivatives of rate and specific force as they were read; what `models.imu` knows follows.
That is the whole of the difference from `models.imu`: one sample does not tell them.

References
----------
.. [1] P. G. Savage, *Strapdown Analytics*, 2nd ed., 2007, section 8.1.4.1 (size effect).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout, coefficients_of
from foucault.models.imu import ImuModel
from foucault.tables import Log, gaps

if TYPE_CHECKING:
    from foucault.models.ins_errors import Sensors

LEVER = Layout(coefficients_of("lever"))
"""Lever arms of the x and y accelerometers from the z accelerometer."""

OFFSET = Layout(coefficients_of("accel_delay"))
"""Time between gyros and accelerometers."""

LAYOUT = Layout((*LEVER.coefficients, *OFFSET.coefficients))
"""Both."""

BEFORE, AFTER = 2, 1
"""Samples before and after a block of a log without which its derivatives are not those of the
whole log [1]."""

_PRODUCTS = {(0, 0): 31, (1, 1): 32, (2, 2): 33, (0, 1): 34, (0, 2): 35, (1, 2): 36}
_RATE_CHANGE, _FORCE_CHANGE = 37, 40


@dataclass(frozen=True)
class SizeEffect:
    """Lever arms and delay of the accelerometers of one IMU."""

    # (3, 3) places of the x, y and z accelerometer in its rows, from the point that is navigated,
    # frame b [m]
    arms: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    delay: float = 0.0  # how much later accelerometers read than gyros [s]

    @classmethod
    def of(cls, vector: CoefficientVector) -> SizeEffect:
        """Take what `vector` has of `LAYOUT`; names not in it are zero."""
        arms = np.zeros((3, 3))
        arms[:2] = np.reshape([vector.get(name) for name in LEVER.names], (2, 3))
        return cls(arms, vector.get("accel.delay"))

    def __bool__(self) -> bool:
        """Whether there is anything to take away."""
        return bool(self.arms.any()) or self.delay != 0.0

    def coefficients(self) -> CoefficientVector:
        """Return the coefficients of `LAYOUT`: places from the z accelerometer."""
        values = [*(self.arms[:2] - self.arms[2]).ravel(), self.delay]
        return CoefficientVector(LAYOUT, np.array(values))

    def rotated(self, C_cb: FloatArray) -> SizeEffect:
        """Express the places in axes c, ``x_c = C_cb @ x_b``; accelerometers stay who they are.

        `C_cb` (3, 3): rotation from the present body axes to the new ones [1].
        """
        return replace(self, arms=self.arms @ C_cb.T)

    def felt(self, w_ib_b: FloatArray, dw_b: FloatArray, df_b: FloatArray) -> FloatArray:
        """Return what the accelerometers read besides the specific force, shape (..., 3) [m/s^2].

        `w_ib_b` (..., 3): angular rate [rad/s]; `dw_b` (..., 3): its derivative [rad/s^2]; `df_b`
        (..., 3): derivative of the specific force [m/s^3].
        """
        out = -self.delay * df_b
        if self.arms.any():
            w, dw = np.moveaxis(w_ib_b, -1, 0), np.moveaxis(dw_b, -1, 0)
            square = (w_ib_b**2).sum(axis=-1)
            for i, r in enumerate(self.arms):
                j, k = (i + 1) % 3, (i + 2) % 3
                away = w[i] * (w_ib_b @ r) - r[i] * square + dw[j] * r[k] - dw[k] * r[j]
                out[..., i] += away
        return np.asarray(out)

    def compensate(
        self, model: ImuModel, accel: FloatArray, gyro: FloatArray,
        dgyro: FloatArray, daccel: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """Compute what is true from what the IMU says and from how that changes.

        The rate is compensated first, which it is but for what gyros feel of the specific force;
        with it the readings of the accelerometers, and then both again: what is left is the
        product of a size effect and a g-sensitivity.

        `accel`, `gyro` (..., 3): readings [m/s^2], [rad/s]; `dgyro`, `daccel` (..., 3): their
        derivatives [rad/s^2], [m/s^3]. Returns `f_b`, `w_ib_b` (..., 3): specific force [m/s^2]
        and angular rate [rad/s], frame b.
        """
        _, w_ib_b = model.compensate(accel, gyro)
        assert w_ib_b is not None
        f_b, w_ib_b = model.compensate(accel - self.felt(w_ib_b, dgyro, daccel), gyro)
        assert f_b is not None and w_ib_b is not None
        return f_b, w_ib_b

    def apply(self, model: ImuModel, log: Log) -> Log:
        """Return the log without these errors and those of `model`.

        `log`: readings, those of accelerometers need those of gyros beside them [SI].
        """
        if not self or log.accel is None:
            return model.apply(log)
        if log.gyro is None:
            raise ValueError("accelerometers with lever arms or a delay need the gyro readings")
        f_b, w_ib_b = self.compensate(model, log.accel, log.gyro, *changes(log))
        return replace(log, accel=f_b, gyro=w_ib_b)


def changes(log: Log) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of rate and specific force as read, shape (n, 3) each [SI/s].

    Central differences; beside a gap and at the ends of the log those to the one neighbour there
    is, and zero where there is none. Means over intervals are taken to be those at their middles.

    `log`: readings of both triads [SI]. Of rows that are means over positions all are zero.
    """
    assert log.gyro is not None and log.accel is not None
    both = np.concatenate([log.gyro, log.accel], axis=1)
    out = np.zeros_like(both)
    if len(log) > 1 and log.averaged is None:
        dt = np.diff(log.time, prepend=log.time[0] - log.interval)
        gap = np.concatenate([[False], gaps(dt[1:])])
        joined = ~gap
        at = log.time
        if log.sampled == "increment":
            at = at - dt / 2
            joined &= ~np.roll(gap, 1)  # the mean after a gap is one over a part that is not known
        joined[0] = False
        row = np.arange(len(dt))
        before, after = row - joined, row + np.append(joined[1:], False)
        some = after > before
        apart = np.where(some, at[after] - at[before], 1.0)
        out = np.where(some[:, None], both[after] - both[before], 0.0) / apart[:, None]
    return out[:, :3], out[:, 3:]


def with_size_effect(sensors: Sensors, *, lever: bool = True, delay: bool = True) -> Sensors:
    """Return the coefficients with lever arms and delay of the accelerometers after them."""
    rows: list[tuple[int, int, int, float]] = []
    more: list[Coefficient] = []
    if lever:
        for c, (i, k) in enumerate((i, k) for i in range(2) for k in range(3)):
            rows += [(len(sensors) + c, 3 + i, *part) for part in _lever_terms(i, k)]
        more += LEVER.coefficients
    if delay:
        c = len(sensors) + len(more)
        rows += [(c, 3 + i, _FORCE_CHANGE + i, -1.0) for i in range(3)]
        more += OFFSET.coefficients
    if not rows:
        return sensors
    coefficient, axis, entry, weight = (np.array(x) for x in zip(*rows, strict=True))
    return replace(
        sensors,
        layout=Layout((*sensors.layout.coefficients, *more)),
        coefficient=np.concatenate([sensors.coefficient, coefficient]),
        axis=np.concatenate([sensors.axis, axis]),
        entry=np.concatenate([sensors.entry, entry]),
        weight=np.concatenate([sensors.weight, weight]),
    )


def _lever_terms(i: int, k: int) -> list[tuple[int, float]]:
    """Return inputs and factors of what r_ik does: (w_i w_k - delta_ik w^2) and w' x r."""
    if i == k:
        return [(_PRODUCTS[j, j], -1.0) for j in range(3) if j != i]
    pair = (min(i, k), max(i, k))
    # (w' x r)_i = w'_(i+1) r_(i+2) - w'_(i+2) r_(i+1)
    turn = ((i + 1) % 3, 1.0) if k == (i + 2) % 3 else ((i + 2) % 3, -1.0)
    return [(_PRODUCTS[pair], 1.0), (_RATE_CHANGE + turn[0], turn[1])]
