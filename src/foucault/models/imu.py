"""Error model of an inertial measurement unit: what it says for what is true, and back.

For each triad, with true specific force f and true angular rate w in body axes b::

    accel = (I + S_a + M_a) f + b_a + K_a q(f)
    gyro  = (I + S_g + M_g) w + b_g + G f
    q(f)  = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)

A gyro whose scale factor is no constant says ``r + A_g |r| + C_g r^3 + b_g + G f`` instead, with
the rate sensed ``r = (I + S_g + M_g) w`` and diagonal A_g, C_g: see `models.gyro_scale`.

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
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.models import gyro_scale
from foucault.models.imu_layout import LAYOUT, LINEAR_LOWER, PRODUCTS
from foucault.tables import AXES, Log

__all__ = [
    "EQUATION", "INVERSE", "LAYOUT", "LINEAR_LOWER", "PRODUCTS", "SCALE_EQUATION",
    "SCALE_INVERSE", "Gauge", "ImuModel", "coefficient_slot", "gravity_slope", "products",
    "products_slope",
]  # fmt: skip

FloatArray = npt.NDArray[np.float64]

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


class Gauge(StrEnum):
    """Which physical directions define the body axes."""

    LOWER = "x accelerometer input axis, y in the x-y accelerometer plane"
    UPPER = "z accelerometer input axis, y in the y-z accelerometer plane"


@dataclass(frozen=True)
class ImuModel:
    """The error model of one IMU as matrices.

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
    """

    accel_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    accel_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_quadratic: FloatArray = field(default_factory=lambda: np.zeros((3, 6)))
    gyro_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    gyro_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    g_sensitivity: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    gyro_asymmetry: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_cubic: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def from_coefficients(cls, vector: CoefficientVector) -> ImuModel:
        """Build the matrices from named coefficients; names not in `vector` are zero."""
        model = cls()
        for name, value in zip(vector.names, vector.values, strict=True):
            block, where = coefficient_slot(name)
            getattr(model, block)[where] += value
        return model

    def coefficients(self, names: Iterable[str] | None = None) -> CoefficientVector:
        """Return the named coefficients (all of `LAYOUT` by default) of these matrices."""
        layout = LAYOUT if names is None else LAYOUT.subset(names)
        identity = ImuModel()
        values = np.empty(len(layout))
        for i, name in enumerate(layout.names):
            block, where = coefficient_slot(name)
            values[i] = getattr(self, block)[where] - getattr(identity, block)[where]
        return CoefficientVector(layout, values)

    @property
    def straight(self) -> bool:
        """Whether the scale factors of the gyros are constants."""
        return not (self.gyro_asymmetry.any() or self.gyro_cubic.any())

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
        accel = f_b @ self.accel_matrix.T + self.accel_bias
        if self.accel_quadratic.any():
            accel += products(f_b) @ self.accel_quadratic.T
        gyro = w_ib_b @ self.gyro_matrix.T
        if not self.straight:
            gyro = gyro_scale.readout(gyro, self.gyro_asymmetry, self.gyro_cubic)
        gyro = gyro + self.gyro_bias
        if self.g_sensitivity.any():
            gyro += f_b @ self.g_sensitivity.T
        return accel, gyro

    def compensate(
        self, accel: FloatArray | None, gyro: FloatArray | None
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """Compute what is true from what the IMU says: the exact inverse of `measure`.

        The linear part is inverted directly; the quadratic part and the gyros' cubic terms by
        Newton's method, which is exact to rounding for any term that leaves the model invertible.

        Parameters
        ----------
        accel : ndarray, shape (..., 3), or None
            Accelerometer readings [m/s^2].
        gyro : ndarray, shape (..., 3), or None
            Gyro readings [rad/s]. With a g-sensitivity, `accel` must be given too.

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
        rate = gyro - self.gyro_bias
        if self.g_sensitivity.any():
            if f_b is None:
                raise ValueError("a gyro with g-sensitivity needs the accelerometer readings")
            rate -= f_b @ self.g_sensitivity.T
        if not self.straight:
            rate = gyro_scale.sensed(rate, self.gyro_asymmetry, self.gyro_cubic)
        return f_b, rate @ np.linalg.inv(self.gyro_matrix).T

    def _compensate_accel(self, accel: FloatArray) -> FloatArray:
        inverse = np.linalg.inv(self.accel_matrix).T
        f_b: FloatArray = (accel - self.accel_bias) @ inverse
        if not self.accel_quadratic.any():
            return f_b
        for _ in range(20):
            miss = (
                f_b @ self.accel_matrix.T
                + self.accel_bias
                + products(f_b) @ self.accel_quadratic.T
                - accel
            )
            slope = self.accel_matrix + np.einsum(
                "ik,...kj->...ij", self.accel_quadratic, products_slope(f_b)
            )
            step = np.linalg.solve(slope, miss[..., None])[..., 0]
            f_b = f_b - step
            if np.max(np.abs(step), initial=0.0) <= 4e-16 * np.max(np.abs(f_b), initial=1.0):
                break
        return f_b

    def apply(self, log: Log) -> Log:
        """Return the log with these errors removed."""
        f_b, w_ib_b = self.compensate(log.accel, log.gyro)
        return replace(log, accel=f_b, gyro=w_ib_b)

    # -- gauge ---------------------------------------------------------------------------

    def rotated(self, C_cb: FloatArray) -> ImuModel:
        """Express the same instrument in body axes c, where ``x_c = C_cb @ x_b``.

        Readings stay what they are, so every input side is multiplied by ``C_bc``. The gyros'
        asymmetry and cubic terms act on the rate sensed, which is the same in all axes.

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
        )

    def in_gauge(self, gauge: Gauge) -> tuple[ImuModel, FloatArray]:
        """Return the model with the body axes of `gauge`, and the rotation C_cb used."""
        flip = np.eye(3) if gauge is Gauge.LOWER else np.eye(3)[::-1]
        # accel_matrix = T @ Q with T triangular: QR of the transpose, in the order of `gauge`.
        Q, R = np.linalg.qr((flip @ self.accel_matrix).T)
        signs = np.sign(np.diag(R))
        C_cb = flip @ (Q * signs).T
        return self.rotated(C_cb), C_cb


def gravity_slope(vector: CoefficientVector) -> FloatArray:
    """Return how coefficients found by the norm of gravity change with the g that was assumed.

    A g assumed larger by the fraction e makes every specific force larger by it, and so the
    accelerometer matrix and the g-sensitivity smaller by e and the quadratic terms by 2 e.

    Parameters
    ----------
    vector : CoefficientVector
        The coefficients.

    Returns
    -------
    ndarray, shape (n,)
        Derivative with respect to ln(g) [SI unit of each coefficient].
    """
    model = ImuModel.from_coefficients(vector)
    powers = {"accel_matrix": -1.0, "g_sensitivity": -1.0, "accel_quadratic": -2.0}
    out = np.zeros(len(vector))
    for i, name in enumerate(vector.names):
        block, where = coefficient_slot(name)
        out[i] = powers.get(block, 0.0) * getattr(model, block)[where]
    return out


def products(f_b: FloatArray) -> FloatArray:
    """Return q(f), shape (..., 6) [(m/s^2)^2], of `f_b`, shape (..., 3) [m/s^2]."""
    x, y, z = f_b[..., 0], f_b[..., 1], f_b[..., 2]
    return np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)


def products_slope(f_b: FloatArray) -> FloatArray:
    """Return dq/df, shape (..., 6, 3) [m/s^2], of `f_b`, shape (..., 3) [m/s^2]."""
    x, y, z = f_b[..., 0], f_b[..., 1], f_b[..., 2]
    o = np.zeros_like(x)
    rows = [(2 * x, o, o), (o, 2 * y, o), (o, o, 2 * z), (y, x, o), (z, o, x), (o, z, y)]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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


_TRIAD_BLOCKS: dict[str, dict[str, str]] = {
    "accel": {"bias": "accel_bias", "scale": "accel_matrix", "misalignment": "accel_matrix"},
    "gyro": {"bias": "gyro_bias", "scale": "gyro_matrix", "misalignment": "gyro_matrix"},
}


def _slots() -> dict[str, tuple[str, Any]]:
    """Where each coefficient of `LAYOUT` lives: attribute of `ImuModel` and index."""
    out: dict[str, tuple[str, Any]] = {}
    at = {a: i for i, a in enumerate(AXES)}
    for triad, blocks in _TRIAD_BLOCKS.items():
        for a in AXES:
            out[f"{triad}.bias.{a}"] = (blocks["bias"], at[a])
            out[f"{triad}.scale.{a}"] = (blocks["scale"], (at[a], at[a]))
            for i in AXES:
                if i != a:
                    out[f"{triad}.misalignment.{a}{i}"] = (blocks["scale"], (at[a], at[i]))
    for o in AXES:
        out[f"accel.quadratic.{o}"] = ("accel_quadratic", (at[o], at[o]))
        for k, (i, j) in enumerate(PRODUCTS):
            if not o == i == j:
                out[f"accel.cross.{o}{i}{j}"] = ("accel_quadratic", (at[o], k))
        for i in AXES:
            out[f"gyro.g_sensitivity.{o}{i}"] = ("g_sensitivity", (at[o], at[i]))
        out[f"gyro.asymmetry.{o}"] = ("gyro_asymmetry", at[o])
        out[f"gyro.cubic.{o}"] = ("gyro_cubic", at[o])
    return out


_SLOTS = _slots()


def coefficient_slot(name: str) -> tuple[str, Any]:
    """Return the attribute of `ImuModel` and the index in it where coefficient `name` lives."""
    LAYOUT.index(name)  # raises with a suggestion
    return _SLOTS[name]
