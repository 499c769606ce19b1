"""A magnetometer beside an IMU: scale, axes and soft iron as one matrix, hard iron, delay.

With m_b the field in body axes, those of the IMU, and t the time of a reading::

    mag(t) = A m_b(t - delay) + h + (T - T_0) h_T

A is a full matrix: scale, non-orthogonality, soft iron *and* the rotation from body axes to those
of the magnetometer, which an ellipsoid alone does not show. Soft iron cannot be told from scale and
non-orthogonality: only the product is in the readings. The inverse needs no rate of change of the
field, which turns in the body as the body turns, ``dm_b/dt = -w x m_b``::

    m_b(t) = Exp(-w delay) A^-1 (mag(t) - h - (T - T_0) h_T)

References
----------
.. [1] M. Kok, T. B. Schon, "Magnetometer calibration using inertial sensors", IEEE Sensors J.
   16(14), 2016.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.errors import error
from foucault.kernels.rotation import integrate_turns
from foucault.models.rotation import cross_matrix, exp
from foucault.tables import AXES, Log

REFERENCE = 298.15
"""T_0, the temperature that the hard iron is said at [K]."""

EQUATION = "mag(t) = A m_b(t - delay) + h + (T - 298.15 K) h_T;  A = I + scale + misalignment"
"""The model equation in words, as stored in results."""

FRAME = "body axes x right, y forward, z up, those of the IMU; m_b: magnetic field"

OFF = tuple((o, i) for o in range(3) for i in range(3) if o != i)
"""Output and input axis of the elements of A beside its diagonal."""

LAYOUT = Layout(
    (
        *(Coefficient(f"mag.scale.{a}", f"A_{a}{a} - 1", "scale factor error",
                      f"magnetometer {a}: gain for the field along {a}, less 1") for a in AXES),
        *(Coefficient(f"mag.misalignment.{AXES[o]}{AXES[i]}", f"A_{AXES[o]}{AXES[i]}",
                      "misalignment",
                      f"magnetometer {AXES[o]}: gain for the field along {AXES[i]}, by rotation, "
                      "non-orthogonality and soft iron") for o, i in OFF),
        *(Coefficient(f"mag.bias.{a}", f"h_{a}", "magnetic field",
                      f"magnetometer {a}: hard iron and bias of the sensor") for a in AXES),
        Coefficient("mag.delay", "delay", "delay", "how late the magnetometer is against the gyros"),
        *(Coefficient(f"mag.bias_temperature.{a}", f"h_T{a}", "magnetic field per kelvin",
                      f"magnetometer {a}: change of hard iron and bias with temperature")
          for a in AXES),
    )
)  # fmt: skip
"""The coefficients of a magnetometer beside an IMU."""

LINEAR = LAYOUT.names[:13]
"""Those without temperature."""

IRON = LAYOUT.names[9:13]
"""Hard iron and delay alone."""


def _no_matrix() -> FloatArray:
    return np.eye(3)


def _none() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True)
class Magnetometer:
    """Errors of a magnetometer as matrices."""

    matrix: FloatArray = field(default_factory=_no_matrix)  # (3, 3) A [1]
    bias: FloatArray = field(default_factory=_none)  # (3,) h [T]
    delay: float = 0.0  # readings are of the field so long before their time [s]
    bias_temperature: FloatArray = field(default_factory=_none)  # (3,) h_T [T/K]

    @classmethod
    def from_coefficients(cls, vector: CoefficientVector) -> Magnetometer:
        """Return the model with the coefficients of `vector`; those it lacks are zero."""
        every = np.array([vector.get(name) for name in LAYOUT.names])
        A = np.diag(1.0 + every[:3])
        A[tuple(np.array(OFF).T)] = every[3:9]
        return cls(A, every[9:12], float(every[12]), every[13:])

    def coefficients(self, names: Iterable[str] = LAYOUT.names) -> CoefficientVector:
        """Return the coefficients `names` of the model."""
        every = [
            *(np.diag(self.matrix) - 1.0), *self.matrix[tuple(np.array(OFF).T)], *self.bias,
            self.delay, *self.bias_temperature,
        ]  # fmt: skip
        return CoefficientVector(LAYOUT, np.array(every)).chosen(names)

    def moved(self, names: Iterable[str], step: FloatArray) -> Magnetometer:
        """Return the model with `step` (k,) added to the coefficients `names` [SI]."""
        values = dict(zip(names, step.tolist(), strict=True))
        now = self.coefficients()
        return self.from_coefficients(
            replace(now, values=now.values + [values.get(n, 0.0) for n in now.names])
        )

    def iron(self, temperature: FloatArray | None) -> FloatArray:
        """Return what is added to the field, (3,), or (n, 3) at temperatures (n,) [T, K]."""
        if temperature is None:
            return self.bias
        return self.bias + np.outer(temperature - REFERENCE, self.bias_temperature)

    def measure(self, m_b: FloatArray, temperature: FloatArray | None = None) -> FloatArray:
        """Return readings of a field `m_b` (n, 3) as it was `delay` before [T]."""
        return np.asarray(m_b @ self.matrix.T + self.iron(temperature))

    def compensate(
        self,
        mag: FloatArray,
        gyro: FloatArray | None = None,
        temperature: FloatArray | None = None,
    ) -> FloatArray:
        """Return the field in body axes at the time of each reading, shape (n, 3) [T].

        `mag` (n, 3): readings [T]; `gyro` (n, 3) or None: rates that the delay is made up by, None
        leaves the field as it was before [rad/s]; `temperature` (n,) or None: where it is known
        [K].
        """
        m_b = np.linalg.solve(self.matrix, (mag - self.iron(temperature)).T).T
        if gyro is None or not self.delay:
            return np.asarray(m_b)
        return np.asarray(np.einsum("nij,nj->ni", exp(-self.delay * gyro), m_b))

    def apply(self, log: Log) -> Log:
        """Return a log whose magnetometer reads the field in body axes [SI]."""
        if log.mag is None:
            raise error("mag.not_logged", file=log.source.get("file", "The log"))
        field_b = self.compensate(log.mag, log.gyro, log.temperature)
        return replace(log, mag=field_b)

    @property
    def polar(self) -> tuple[FloatArray, FloatArray]:
        """P and R of ``A = P R``: P symmetric, R the rotation from body to sensor axes, (3, 3)."""
        U, s, V = np.linalg.svd(self.matrix)
        return U @ np.diag(s) @ U.T, U @ V


# -- readings of a body that turns -----------------------------------------------------------------


@dataclass(frozen=True)
class Cells:
    """Rows of a log in groups, of which each makes one reading: their mean."""

    rows: IntArray  # (r,) rows that are in a group, in rising order [1]
    start: IntArray  # (k,) first of `rows` of each group [1]

    def __len__(self) -> int:
        return len(self.start)

    @property
    def count(self) -> IntArray:
        """Rows of each group, shape (k,) [1]."""
        return np.diff(self.start, append=len(self.rows))

    def mean(self, x: FloatArray) -> FloatArray:
        """Return the mean of `x` (r, ...), given for `rows`, over each group, shape (k, ...)."""
        count = self.count.reshape(-1, *[1] * (x.ndim - 1))
        return np.asarray(np.add.reduceat(x, self.start, axis=0) / count)

    def chosen(self, keep: BoolArray) -> Cells:
        """Return the groups `keep` (k,)."""
        some = np.repeat(keep, self.count)
        count = self.count[keep]
        return Cells(self.rows[some], np.cumsum(count) - count)


@dataclass(frozen=True)
class Chain:
    """Attitudes of a log against that of its first row, by the gyros alone."""

    C: FloatArray  # (n, 3, 3) body axes at each row to those at the first row [1]
    w: FloatArray  # (n, 3) rate [rad/s]
    # (n, 3, 12) rotation, in axes of the first row, per error of rates: bias [s], then per element
    # of a matrix that is multiplied with them, row by row [rad]
    slopes: FloatArray

    def seen(self, cells: Cells, v: FloatArray) -> FloatArray:
        """Return the means of a vector that stands still, ``mean(C' v)``, shape (k, 3).

        `v` (3,): the vector in body axes of the first row.
        """
        return cells.mean(np.swapaxes(self.C[cells.rows], 1, 2) @ v)

    def seen_by(self, cells: Cells, v: FloatArray) -> FloatArray:
        """Return the slopes of `seen`, (k, 3, 15): by v, by bias and by matrix of the gyros."""
        back = np.swapaxes(self.C[cells.rows], 1, 2)
        by_rates = back @ cross_matrix(v) @ self.slopes[cells.rows]
        return cells.mean(np.concatenate([back, by_rates], axis=2))


@dataclass(frozen=True)
class Turning:
    """Rates of a log, to be integrated with other errors and another delay."""

    time: FloatArray  # (n,) [s]
    gyro: FloatArray  # (n, 3) as measured [rad/s]
    sampled: str = "rate"

    @cached_property
    def _curve(self) -> Any:
        from scipy.interpolate import CubicSpline

        if self.sampled == "rate":
            return CubicSpline(self.time, self.gyro)
        # Means over intervals: the angle at their ends.
        step = np.diff(self.time, prepend=2 * self.time[0] - self.time[1])[:, None]
        ends = np.concatenate([[2 * self.time[0] - self.time[1]], self.time])
        return CubicSpline(ends, np.concatenate([np.zeros((1, 3)), np.cumsum(self.gyro * step, 0)]))

    def late(self, delay: float) -> FloatArray:
        """Return the rates as they were `delay` [s] before the time of each row, (n, 3) [rad/s]."""
        if not delay:
            return self.gyro
        t = np.clip(self.time - delay, self.time[0], self.time[-1])
        if self.sampled == "rate":
            return np.asarray(self._curve(t))
        before = np.concatenate([[2 * t[0] - t[1]], t[:-1]])
        step = np.maximum(t - before, 1e-3 * np.median(np.diff(self.time)))
        return np.asarray((self._curve(t) - self._curve(before)) / step[:, None])

    def chain(self, delay: float, bias: FloatArray, matrix: FloatArray) -> Chain:
        """Integrate ``w = w_m - bias - matrix w_m``, all of it `delay` earlier.

        `delay`: of the readings that it is for [s]; `bias` (3,): [rad/s]; `matrix` (3, 3): [1].
        """
        measured = np.ascontiguousarray(self.late(delay))
        w = np.ascontiguousarray(measured - bias - measured @ matrix.T)
        n = np.arange(len(w))
        step, by_bias, _, by_matrix, _, _ = integrate_turns(
            self.time, w, measured, np.zeros((3, 3)), n[:-1], n[1:], self.sampled == "increment"
        )
        C = np.concatenate([np.eye(3)[None], running_product(step)])
        made = C[:-1] @ np.concatenate([by_bias, by_matrix], axis=2)
        slopes = np.concatenate([np.zeros((1, 3, 12)), -np.cumsum(made, axis=0)])
        return Chain(C, w, slopes)


def running_product(step: FloatArray) -> FloatArray:
    """Return the products of the first one, two, ... of `step` (n, 3, 3) [1], same shape.

    In about sqrt(n) blocks at once, then from block to block.
    """
    n = len(step)
    length = max(int(np.sqrt(n)), 1)
    blocks = -(-n // length)
    out = np.tile(np.eye(3), (blocks * length, 1, 1))
    out[:n] = step
    out = out.reshape(blocks, length, 3, 3)
    for k in range(1, length):
        out[:, k] = out[:, k - 1] @ out[:, k]
    for k in range(1, blocks):
        out[k] = out[k - 1, -1] @ out[k]
    return out.reshape(-1, 3, 3)[:n]
