"""Error model of an inertial measurement unit: what it says for what is true, and back.

For each triad, with true specific force f and true angular rate w in body axes b::

    accel = (I + S_a + M_a) f + b_a + K_a q(f)
    gyro  = (I + S_g + M_g) w + b_g + G f
    q(f)  = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)

A gyro whose scale factor is no constant says ``r + A_g |r| + C_g r^3 + b_g + G f`` instead, with
the rate sensed ``r = (I + S_g + M_g) w`` and diagonal A_g, C_g: see `models.deflection`. An
accelerometer that scales unlike in its two senses says ``p + A_a |p| + b_a + K_a q(f)`` with
``p = (I + S_a + M_a) f``. Gyros that bend under specific force sense
``r = (I + S_g + M_g + D(f)) w`` with ``D_ij(f) = T_ijk f_k``: see `models.deflection`.

S is diagonal (scale factor errors), M has a zero diagonal (misalignments, small angles), G is
the g-sensitivity (output axis, then accelerometer axis). Counts are turned into SI by the
nominal count scale of the log description before this model sees them.

Signs: a bias is measured minus true; a positive scale factor error reads too much.

Gauge: the body axes are defined by the instrument itself. ``x_b`` is the input axis of the x
accelerometer and ``y_b`` lies in the plane of the x and y accelerometers, so that M_a is lower
triangular (`Gauge.LOWER`). Other programs use the z accelerometer as reference, which makes M_a
upper triangular (`Gauge.UPPER`); `ImuModel.in_gauge` rotates accelerometer and gyro together.

References
----------
.. [1] IEEE Std 1293-2018, annex K (accelerometer model equation).
.. [2] IEEE Std 647-2006 and 952-1997 (gyro model equation).
.. [3] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, eqs. (4.16), (4.17).

The equations of `models.imu` in words, as results store and reports typeset them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.models import deflection
from foucault.models.imu_layout import (
    LAYOUT,
    LINEAR_LOWER,
    PRODUCTS,
    SHAPES,
    blocks_of,
    by_block,
    coefficient_slot,
    flat,
    places,
    subset,
)
from foucault.tables import AXES, Log, numbers

_ACCEL = "accel = (I + S_a + M_a) f + b_a + K_a q(f);  "
_WORDS = (
    "f: true specific force, w: true angular rate, both in body axes; "
    "q(f) = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)"
)
_ACCEL_INVERSE = "f = (I + S_a + M_a)^-1 (accel - b_a - K_a q(f));  "

EQUATION = f"{_ACCEL}gyro = (I + S_g + M_g) w + b_g + G f;  {_WORDS}"
"""The model equation in words, as stored in results."""

INVERSE = f"{_ACCEL_INVERSE}w = (I + S_g + M_g)^-1 (gyro - b_g - G f)"
"""The same solved for what is true, as `ImuModel.compensate` does it."""

SCALE_EQUATION = (
    f"{_ACCEL}gyro = r + A_g |r| + C_g r^3 + b_g + G f;  r = (I + S_g + M_g) w;  {_WORDS}; "
    "A_g and C_g are diagonal, |r| and r^3 are taken axis by axis"
)
"""The model equation where a gyro's scale factor is no constant."""

SCALE_INVERSE = (
    f"{_ACCEL_INVERSE}r + A_g |r| + C_g r^3 = gyro - b_g - G f;  w = (I + S_g + M_g)^-1 r"
)
"""The same solved for what is true."""

FULL_EQUATION = (
    "accel = p + A_a |p| + b_a + K_a q(f);  p = (I + S_a + M_a) f;  "
    "gyro = r + A_g |r| + C_g r^3 + b_g + G f;  r = (I + S_g + M_g + D(f)) w;  "
    f"D_ij(f) = T_ijx fx + T_ijy fy + T_ijz fz;  {_WORDS}; "
    "A_a, A_g and C_g are diagonal, |p|, |r| and r^3 are taken axis by axis; "
    "T_ijk: angle that the input axis of gyro i bends towards j per specific force along k"
)
"""The model equation with all there is: asymmetries, and gyros that bend under specific force."""

FULL_INVERSE = (
    "p + A_a |p| = accel - b_a - K_a q(f);  f = (I + S_a + M_a)^-1 p;  "
    "r + A_g |r| + C_g r^3 = gyro - b_g - G f;  w = (I + S_g + M_g + D(f))^-1 r"
)
"""The same solved for what is true."""

SIZE_EQUATION = FULL_EQUATION.replace("K_a q(f);", "K_a q(f) + e;", 1) + (
    ";  e_i = (w x (w x r_i) + dw x r_i)_i - tau df_i;  "
    "dw and df: derivatives of rate and specific force as read; r_i: place of accelerometer i; "
    "tau: how much later accelerometers read than gyros"
)
"""The model equation of accelerometers that are not at one place, or late (see
`models.size_effect`)."""

SIZE_INVERSE = FULL_INVERSE.replace("K_a q(f);", "K_a q(f) - e;", 1)
"""The same solved for what is true."""

INVERSES = {
    EQUATION: INVERSE, SCALE_EQUATION: SCALE_INVERSE, FULL_EQUATION: FULL_INVERSE,
    SIZE_EQUATION: SIZE_INVERSE,
}  # fmt: skip
"""Equation that a result may store -> the same solved for what is true."""

__all__ = [
    "EQUATION", "FRAME", "FULL_EQUATION", "FULL_INVERSE", "INVERSE", "INVERSES", "LAYOUT",
    "LINEAR_LOWER", "PRODUCTS", "SCALE_EQUATION", "SCALE_INVERSE", "SIZE_EQUATION",
    "SIZE_INVERSE", "Gauge", "ImuModel", "Slopes", "coefficient_slot", "products",
    "products_slope",
]  # fmt: skip

FRAME = "body axes, right-forward-up, as the accelerometers define them (see gauge)"
"""The axes of coefficients, in words, as stored in results."""


class Gauge(StrEnum):
    """Which physical directions define the body axes."""

    LOWER = "x accelerometer input axis, y in the x-y accelerometer plane"
    UPPER = "z accelerometer input axis, y in the y-z accelerometer plane"


class Slopes(NamedTuple):
    """How the readings of an IMU change with its coefficients and with what is true."""

    # accel, gyro: (..., 3, p) derivative of the readings by p coefficients [SI]
    accel: FloatArray
    gyro: FloatArray
    # (..., 3, 3) derivative of the accelerometers by the true specific force [1]
    accel_by_force: FloatArray
    gyro_by_force: FloatArray  # (..., 3, 3) derivative of the gyros by it [rad/s/(m/s^2)]
    gyro_by_rate: FloatArray  # (..., 3, 3) derivative of the gyros by the true angular rate [1]


@dataclass(frozen=True)
class ImuModel:
    """The error model of one IMU as matrices.

    Where coefficients differ from sample to sample, as with temperature, every matrix has one more
    axis in front, that of the samples: `measure` and `compensate` take those. With two more, of N
    and of 1, it is that of N instruments, of which `measure` takes readings (N, n, 3).

    Attributes
    ----------
    accel_matrix : ndarray, shape (3, 3)
        I + S_a + M_a [1].
    accel_bias : ndarray, shape (3,)
        b_a, measured minus true [m/s^2].
    accel_quadratic : ndarray, shape (3, 6)
        K_a, rows output axes, columns `PRODUCTS` [1/(m/s^2)].
    gyro_matrix : ndarray, shape (3, 3)
        I + S_g + M_g [1].
    gyro_bias : ndarray, shape (3,)
        b_g, measured minus true [rad/s].
    g_sensitivity : ndarray, shape (3, 3)
        G, output axis then specific force axis [rad/s/(m/s^2)].
    gyro_asymmetry : ndarray, shape (3,)
        Diagonal of A_g, of the rate sensed [1].
    gyro_cubic : ndarray, shape (3,)
        Diagonal of C_g, of the rate sensed [1/(rad/s)^2].
    accel_asymmetry : ndarray, shape (3,)
        Diagonal of A_a, of the specific force sensed [1].
    deflection : ndarray, shape (3, 3, 3)
        T: gyro, direction it bends to, axis of the specific force [rad/(m/s^2)].
    """

    accel_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    accel_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_quadratic: FloatArray = field(default_factory=lambda: np.zeros((3, 6)))
    gyro_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    gyro_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    g_sensitivity: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    gyro_asymmetry: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_cubic: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_asymmetry: FloatArray = field(default_factory=lambda: np.zeros(3))
    deflection: FloatArray = field(default_factory=lambda: np.zeros((3, 3, 3)))

    def __post_init__(self) -> None:
        for name, shape in SHAPES.items():
            object.__setattr__(self, name, numbers(name, getattr(self, name), shape, more=True))

    @classmethod
    def from_coefficients(cls, vector: CoefficientVector) -> ImuModel:
        """Build the matrices from named coefficients; names not in `vector` are zero."""
        entries = flat(cls())
        entries[places(vector.names)] += vector.values
        return cls(**blocks_of(entries))

    @classmethod
    def of_samples(cls, names: Iterable[str], values: FloatArray) -> ImuModel:
        """Build a model whose coefficients differ from sample to sample.

        Parameters
        ----------
        names : iterable of str
            Names of n coefficients.
        values : ndarray, shape (m, n)
            Their values at every sample [SI].
        """
        start = cls()
        blocks: dict[str, FloatArray] = {}
        for name, column in zip(names, values.T, strict=True):
            block, where = coefficient_slot(name)
            if block not in blocks:
                one = getattr(start, block)
                blocks[block] = np.broadcast_to(one, (len(values), *one.shape)).copy()
            where = where if isinstance(where, tuple) else (where,)
            blocks[block][(slice(None), *where)] += column
        return replace(start, **blocks)

    def coefficients(self, names: Iterable[str] | None = None) -> CoefficientVector:
        """Return the named coefficients (all of `LAYOUT` by default) of these matrices."""
        layout = LAYOUT if names is None else subset(tuple(names))
        return CoefficientVector(layout, (flat(self) - _IDENTITY)[places(layout.names)])

    def moved(self, names: Iterable[str], step: FloatArray) -> ImuModel:
        """Return the model with something added to the named coefficients.

        Parameters
        ----------
        names : iterable of str, length p
            Coefficients of `LAYOUT`.
        step : ndarray, shape (p,)
            What is added to each [SI].
        """
        entries = flat(self)
        entries[places(tuple(names))] += step
        return ImuModel(**blocks_of(entries))

    @property
    def straight(self) -> bool:
        """Whether the scale factors of the gyros are constants."""
        return not (self.gyro_asymmetry.any() or self.gyro_cubic.any())

    @property
    def accel_linear(self) -> bool:
        """Whether what the accelerometers say is linear in the specific force."""
        return not (self.accel_quadratic.any() or self.accel_asymmetry.any())

    @property
    def gyros_feel_force(self) -> bool:
        """Whether the gyros cannot be compensated without the accelerometers."""
        return bool(self.g_sensitivity.any() or self.deflection.any())

    # -- forward and inverse -------------------------------------------------------------

    def measure(self, f_b: FloatArray, w_ib_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what the IMU says, without noise.

        Parameters
        ----------
        f_b : ndarray, shape (..., 3)
            True specific force, frame b [m/s^2].
        w_ib_b : ndarray, shape (..., 3)
            True angular rate relative to inertial space, frame b [rad/s].

        Returns
        -------
        accel : ndarray, shape (..., 3)
            Accelerometer readings [m/s^2].
        gyro : ndarray, shape (..., 3)
            Gyro readings [rad/s].
        """
        accel = self._accel(f_b)
        gyro = _times(self.gyro_matrix, w_ib_b)
        if self.deflection.ndim == 4:  # one for every sample
            gyro = gyro + _times(deflection.bending(self.deflection, f_b), w_ib_b)
        elif self.deflection.any():
            T = self.deflection[:, 0] if self.deflection.ndim > 4 else self.deflection
            gyro = gyro + deflection.felt(T, f_b, w_ib_b)
        if not self.straight:
            gyro = deflection.readout(gyro, self.gyro_asymmetry, self.gyro_cubic)
        gyro = gyro + self.gyro_bias
        if self.g_sensitivity.any():
            gyro += _times(self.g_sensitivity, f_b)
        return accel, gyro

    def slopes(self, f_b: FloatArray, w_ib_b: FloatArray, names: Sequence[str]) -> Slopes:
        """Differentiate `measure` by coefficients, by the specific force and by the rate.

        With ``p = (I + S_a + M_a) f``, ``r = (I + S_g + M_g + D(f)) w`` and the diagonal
        ``B = I + A_g sign(r) + 3 C_g r^2``::

            d accel / d f = (I + A_a sign(p)) (I + S_a + M_a) + K_a dq/df
            d gyro / d f  = G + B dD/df w,    d gyro / d w = B (I + S_g + M_g + D(f))

        Parameters
        ----------
        f_b : ndarray, shape (..., 3)
            True specific force, frame b [m/s^2].
        w_ib_b : ndarray, shape (..., 3)
            True angular rate relative to inertial space, frame b [rad/s].
        names : sequence of str, length p
            Coefficients of `LAYOUT`.
        """
        f_b, w_ib_b = np.broadcast_arrays(f_b, w_ib_b)
        shape, matrix, bend = (*f_b.shape, 3), self.gyro_matrix, None
        if self.deflection.any():
            matrix = matrix + deflection.bending(self.deflection, f_b)
        p, r = _times(self.accel_matrix, f_b), _times(matrix, w_ib_b)
        if not self.straight:
            bend = deflection.readout_slope(r, self.gyro_asymmetry, self.gyro_cubic)
        # What multiplies the coefficients of each block, and the slope of what that goes through.
        inputs: dict[str, Callable[[], FloatArray]] = {
            "accel_bias": lambda: np.ones(3),
            "accel_matrix": lambda: f_b,
            "accel_quadratic": lambda: products(f_b),
            "accel_asymmetry": lambda: np.abs(p),
            "gyro_bias": lambda: np.ones(3),
            "gyro_matrix": lambda: w_ib_b,
            "g_sensitivity": lambda: f_b,
            "gyro_asymmetry": lambda: np.abs(r),
            "gyro_cubic": lambda: r**3,
            "deflection": lambda: w_ib_b[..., :, None] * f_b[..., None, :],
        }
        through = {"gyro_matrix": bend, "deflection": bend}
        if self.accel_asymmetry.any():
            through["accel_matrix"] = 1.0 + self.accel_asymmetry * np.sign(p)
        by_name = np.zeros((2, *f_b.shape, len(names)))
        for block, (columns, axis, *inner) in by_block(tuple(names)).items():
            at: tuple[Any, ...] = (..., *inner)
            slope = inputs[block]()[at]
            if (scale := through.get(block)) is not None:
                slope = slope * scale[..., axis]
            by_name[int(not block.startswith("accel"))][..., axis, columns] = slope
        gyro_by_force, gyro_by_rate = self.g_sensitivity, matrix
        if self.deflection.any():
            turned = np.einsum("...ijk,...j->...ik", self.deflection, w_ib_b)
            gyro_by_force = gyro_by_force + (turned if bend is None else bend[..., None] * turned)
        if bend is not None:
            gyro_by_rate = bend[..., None] * matrix
        return Slopes(
            by_name[0],
            by_name[1],
            np.broadcast_to(self._accel_slope(f_b), shape),
            np.broadcast_to(gyro_by_force, shape),
            np.broadcast_to(gyro_by_rate, shape),
        )

    def compensate(
        self, accel: FloatArray | None, gyro: FloatArray | None
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """Compute what is true from what the IMU says: the exact inverse of `measure`.

        The linear part is inverted directly, at every sample where the gyros bend; the quadratic
        part of the accelerometers and the gyros' cubic terms by Newton's method, which is exact to
        rounding for any term that leaves the model invertible.

        Parameters
        ----------
        accel : ndarray, shape (..., 3), or None
            Accelerometer readings [m/s^2].
        gyro : ndarray, shape (..., 3), or None
            Gyro readings [rad/s]. With g-sensitivity or deflection, `accel` must be given too.

        Returns
        -------
        f_b : ndarray, shape (..., 3), or None
            Specific force, frame b [m/s^2].
        w_ib_b : ndarray, shape (..., 3), or None
            Angular rate, frame b [rad/s].
        """
        f_b = None if accel is None else self._compensate_accel(accel)
        if gyro is None:
            return f_b, None
        if f_b is None and self.gyros_feel_force:
            raise ValueError(
                "a gyro with g-sensitivity or deflection needs the accelerometer readings"
            )
        rate = gyro - self.gyro_bias
        if f_b is not None and self.g_sensitivity.any():
            rate -= _times(self.g_sensitivity, f_b)
        if not self.straight:
            rate = deflection.sensed(rate, self.gyro_asymmetry, self.gyro_cubic)
        if f_b is None or not self.deflection.any():
            return f_b, _times(_inverse(self.gyro_matrix), rate)
        matrix = self.gyro_matrix + deflection.bending(self.deflection, f_b)
        return f_b, np.asarray(np.linalg.solve(matrix, rate[..., None])[..., 0], float)

    def _accel(self, f_b: FloatArray) -> FloatArray:
        sensed = _times(self.accel_matrix, f_b)
        accel = sensed + self.accel_bias
        if self.accel_asymmetry.any():
            accel += self.accel_asymmetry * np.abs(sensed)
        if self.accel_quadratic.any():
            accel += _times(self.accel_quadratic, products(f_b))
        return np.asarray(accel)

    def _accel_slope(self, f_b: FloatArray) -> FloatArray:
        """Derivative of the readings by the specific force, shape (..., 3, 3) or (3, 3) [1]."""
        if self.accel_linear:
            return self.accel_matrix
        sense = np.sign(_times(self.accel_matrix, f_b))
        slope = (1.0 + self.accel_asymmetry * sense)[..., None] * self.accel_matrix
        return np.asarray(slope + self.accel_quadratic @ products_slope(f_b))

    def _compensate_accel(self, accel: FloatArray) -> FloatArray:
        sensed = accel - self.accel_bias
        if self.accel_asymmetry.any():
            sensed = deflection.sensed(sensed, self.accel_asymmetry, np.zeros(3))
        f_b = _times(_inverse(self.accel_matrix), sensed)
        size, back = np.inf, self.accel_matrix
        for _ in range(20 if self.accel_quadratic.any() else 0):
            if size > 1e-3:  # nearer the slope hardly changes
                back = np.asarray(np.linalg.inv(self._accel_slope(f_b)), float)
            step = (back @ (self._accel(f_b) - accel)[..., None])[..., 0]
            f_b = f_b - step
            size = np.max(np.abs(step), initial=0.0) / np.max(np.abs(f_b), initial=1.0)
            if size <= 4e-16:
                break
        return f_b

    def apply(self, log: Log) -> Log:
        """Return the log with these errors removed."""
        f_b, w_ib_b = self.compensate(log.accel, log.gyro)
        return replace(log, accel=f_b, gyro=w_ib_b)

    # -- gauge ---------------------------------------------------------------------------

    def rotated(self, C_cb: FloatArray) -> ImuModel:
        """Express the same instrument in body axes c, where ``x_c = C_cb @ x_b``.

        Readings stay what they are, so every input side is multiplied by ``C_bc``. Asymmetry and
        the gyros' cubic terms act on what is sensed, which is the same in all axes. Deflection
        has two input sides, and none of them is the gyro's own axis any more: what was a bending
        gets a part T_iik, a scale factor that changes with the specific force. The matrices keep
        it, so that nothing is lost; it has no coefficient, because for the small angles between
        gauges it is that angle times a bending, some 1e-9 per g.

        Parameters
        ----------
        C_cb : ndarray, shape (3, 3)
            Rotation from the present body axes to the new ones [1].
        """
        C_bc = C_cb.T
        return replace(
            self,
            accel_matrix=self.accel_matrix @ C_bc,
            gyro_matrix=self.gyro_matrix @ C_bc,
            g_sensitivity=self.g_sensitivity @ C_bc,
            accel_quadratic=_rotate_quadratic(self.accel_quadratic, C_bc),
            deflection=np.einsum("ijk,jm,kn->imn", self.deflection, C_bc, C_bc),
        )

    def in_gauge(self, gauge: Gauge) -> tuple[ImuModel, FloatArray]:
        """Return the model with the body axes of `gauge`, and the rotation C_cb used."""
        flip = np.eye(3) if gauge is Gauge.LOWER else np.eye(3)[::-1]
        # accel_matrix = T @ Q with T triangular: QR of the transpose, in the order of `gauge`.
        Q, R = np.linalg.qr((flip @ self.accel_matrix).T)
        signs = np.sign(np.diag(R))
        C_cb = flip @ (Q * signs).T
        return self.rotated(C_cb), C_cb


_IDENTITY = flat(ImuModel())


def products(f_b: FloatArray) -> FloatArray:
    """Return q(f), shape (..., 6) [(m/s^2)^2], of `f_b`, shape (..., 3) [m/s^2]."""
    x, y, z = f_b[..., 0], f_b[..., 1], f_b[..., 2]
    return np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)


def products_slope(f_b: FloatArray) -> FloatArray:
    """Return dq/df, shape (..., 6, 3) [m/s^2], of `f_b`, shape (..., 3) [m/s^2]."""
    out = np.zeros((*f_b.shape[:-1], 6, 3))
    out[..., [0, 1, 2], [0, 1, 2]] = 2 * f_b
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), 3):
        out[..., row, i], out[..., row, j] = f_b[..., j], f_b[..., i]
    return out


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Multiply every vector by a matrix: the same one, its own, or that of its instrument."""
    if matrix.ndim == 2:
        return np.asarray(vector @ matrix.T)
    if matrix.ndim == 4:
        return np.asarray(vector @ np.swapaxes(matrix[:, 0], 1, 2))
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


def _inverse(matrix: FloatArray) -> FloatArray:
    """Invert a matrix, or every one of many: by cofactors, as they are nearly the identity."""
    if matrix.ndim == 2:
        return np.asarray(np.linalg.inv(matrix), np.float64)
    m = np.ascontiguousarray(np.moveaxis(matrix, 0, -1))
    out = np.empty_like(m)
    for i in range(3):
        for j in range(3):  # indices run on in a circle
            out[j, i] = m[i - 2, j - 2] * m[i - 1, j - 1] - m[i - 2, j - 1] * m[i - 1, j - 2]
    out /= m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    return np.moveaxis(out, -1, 0)


def _rotate_quadratic(K: FloatArray, C_bc: FloatArray) -> FloatArray:
    """Re-express K q(f_b) as K' q(f_c) with f_b = C_bc f_c."""
    if not K.any():
        return K
    index = [tuple(AXES.index(a) for a in pair) for pair in PRODUCTS]
    out = np.zeros_like(K)
    for column, (i, j) in enumerate(index):
        quadratic_form = np.outer(C_bc[i], C_bc[j])  # f_i f_j = f_c' (c_i c_j') f_c
        quadratic_form = quadratic_form + quadratic_form.T
        for target, (p, q) in enumerate(index):
            share = quadratic_form[p, q] * (0.5 if p == q else 1.0)
            out[:, target] += K[:, column] * share
    return out
