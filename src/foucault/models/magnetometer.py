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

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, coefficients_of
from foucault.errors import error
from foucault.models.rotation import exp
from foucault.tables import Log

REFERENCE = 298.15
"""T_0, the temperature that the hard iron is said at [K]."""

EQUATION = (
    "mag(t) = A m_b(t - delay) + h + h_T (T - T_0);  A = I + S + M;  "
    "m_b: magnetic field in body axes; S: scale, M: misalignment; T_0: 298.15 K"
)
"""The model equation in words, as stored in results."""

INVERSE = "m_b = m - delay (w x m), m = A^-1 (mag - h - h_T (T - T_0)); w: rate in body axes"
"""The equation the other way round, to first order in the turn within the delay."""

FRAME = "body axes x right, y forward, z up, those of the IMU"

OFF = tuple((o, i) for o in range(3) for i in range(3) if o != i)
"""Output and input axis of the elements of A beside its diagonal."""

LAYOUT = Layout(coefficients_of("magnetometer"))
"""The coefficients of a magnetometer beside an IMU."""

LINEAR = LAYOUT.names[:13]
"""Those without temperature."""

IRON = LAYOUT.names[9:13]
"""Hard iron and delay alone."""


@dataclass(frozen=True)
class Magnetometer:
    """Errors of a magnetometer as matrices."""

    matrix: FloatArray = field(default_factory=lambda: np.eye(3))  # (3, 3) A [1]
    bias: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) h [T]
    delay: float = 0.0  # readings are of the field so long before their time [s]
    bias_temperature: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) h_T [T/K]

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
        moved = now.values + [values.get(n, 0.0) for n in now.names]
        return self.from_coefficients(replace(now, values=moved))

    def iron(self, temperature: FloatArray | None) -> FloatArray:
        """Return what is added to the field, (3,), or (n, 3) at each `temperature` (n,) [T, K]."""
        if temperature is None:
            return self.bias
        return self.bias + np.outer(temperature - REFERENCE, self.bias_temperature)

    def measure(self, m_b: FloatArray, temperature: FloatArray | None = None) -> FloatArray:
        """Return readings of a field as it was `delay` before, shape (n, 3) [T].

        `m_b` (n, 3): in body axes [T]; `temperature` (n,) or None: where it is known [K].
        """
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


def slopes(m_b: FloatArray, warm: FloatArray | None = None) -> FloatArray:
    """Return derivatives of readings by the coefficients, shape (n, 3, 16), none by the delay.

    `m_b` (n, 3): field in body axes [T]; `warm` (n,) or None: temperature less its reference [K].
    """
    out = np.zeros((len(m_b), 3, len(LAYOUT)))
    for j, (o, i) in enumerate([*((k, k) for k in range(3)), *OFF]):
        out[:, o, j] = m_b[:, i]
    out[:, :, 9:12] = np.eye(3)
    if warm is not None:
        out[:, :, 13:] = warm[:, None, None] * np.eye(3)
    return out


def halves(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return P, P' and R of the inverse of `matrix` (3, 3) [1], ``A^-1 = R P = P' R``."""
    U, s, V = np.linalg.svd(np.linalg.inv(matrix))
    return V.T @ np.diag(s) @ V, U @ np.diag(s) @ U.T, U @ V


LEVEL_HEADINGS = 24
"""Headings, evenly spread, that errors of a level heading are reckoned over [1]."""


def level_fields(dip: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return fields in a level body at even headings, of level part 1, with north and east there.

    `dip`: positive where the field points down [rad]. Returns (24, 3) each, in b [1].
    """
    psi = np.arange(LEVEL_HEADINGS)[:, None] * (2 * np.pi / LEVEL_HEADINGS)
    # b is right, forward, up: north is (-sin, cos, 0) at heading psi, east (cos, sin, 0).
    north = np.concatenate([-np.sin(psi), np.cos(psi), 0 * psi], axis=1)
    east = np.concatenate([np.cos(psi), np.sin(psi), 0 * psi], axis=1)
    return north - np.tan(dip) * np.array([0.0, 0.0, 1.0]), north, east


def heading_error(matrix: FloatArray, dip: float) -> float:
    """Return the rms error of a level heading from ``matrix m_b`` in the place of m_b [rad].

    `matrix` (3, 3): what a correction leaves [1]; `dip`: of the field [rad].
    """
    m_b, north, east = level_fields(dip)
    seen = m_b @ matrix.T
    off = np.arctan2(np.sum(seen * east, axis=1), np.sum(seen * north, axis=1))
    return float(np.sqrt(np.mean(off**2)))
