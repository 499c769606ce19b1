"""Functions of the three angles of a table, tabled once and then evaluated in microseconds.

Trigonometric interpolation on a regular grid: exact for a function whose harmonics in each angle
are no higher than its `degrees`, and as near as its higher ones are small otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import cos, sin

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray


@dataclass(frozen=True)
class Periodic:
    """A function of three angles with symmetric matrices as values."""

    degrees: tuple[int, int, int]  # (3,) highest harmonic in each angle [1]
    size: int  # rows of a matrix [1]
    # (k, size (size + 1) of every product of harmonics, for the upper triangle row by row
    amplitudes: FloatArray

    @classmethod
    def of(
        cls,
        function: Callable[[FloatArray], FloatArray],
        degrees: tuple[int, int, int],
    ) -> Periodic:
        """Table a function.

        `function`: angles, shape (n, 3) [rad] -> symmetric matrices, shape (n, size, size);
        `degrees` (3,): highest harmonic in each angle [1].
        """
        grids = [2 * np.pi * np.arange(2 * d + 1) / (2 * d + 1) for d in degrees]
        values = function(np.array(list(product(*grids))))
        size = values.shape[1]
        upper = values[:, *np.triu_indices(size)]
        inverse = [
            np.linalg.inv([_harmonics(float(x), d) for x in g])
            for g, d in zip(grids, degrees, strict=True)
        ]
        table = upper.reshape(*(len(g) for g in grids), -1)
        amplitudes = np.einsum("ai,bj,ck,ijkt->abct", *inverse, table, optimize=True)
        return cls(degrees, size, amplitudes.reshape(-1, upper.shape[1]))

    @cached_property
    def _upper(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        return np.triu_indices(self.size)

    @property
    def mean(self) -> FloatArray:
        """Mean over all angles, shape (size, size)."""
        out = np.empty((self.size, self.size))
        rows, columns = self._upper
        out[rows, columns] = out[columns, rows] = self.amplitudes[0]
        return out

    def __call__(self, angles: tuple[float, float, float]) -> FloatArray:
        """Return the matrix at three angles, shape (size, size).

        `angles` (3,): the angles [rad].
        """
        a, b, c = (_harmonics(x, d) for x, d in zip(angles, self.degrees, strict=True))
        found = ((a[:, None] * b).ravel()[:, None] * c).ravel() @ self.amplitudes
        out = np.empty((self.size, self.size))
        rows, columns = self._upper
        out[rows, columns] = out[columns, rows] = found
        return out

    def slope(self, angles: tuple[float, float, float], M: FloatArray) -> FloatArray:
        """Return the derivatives of ``sum(M * F)`` by the angles, shape (3,).

        `angles` (3,): the angles [rad]; `M` (size, size): a symmetric matrix.
        """
        rows, columns = self._upper
        along = self.amplitudes @ (M[rows, columns] * np.where(rows == columns, 1.0, 2.0))
        terms = along.reshape(tuple(2 * d + 1 for d in self.degrees))
        a, b, c = (_harmonics(x, d) for x, d in zip(angles, self.degrees, strict=True))
        over_c = terms @ c
        return np.array([
            _derivatives(a) @ over_c @ b,
            a @ over_c @ _derivatives(b),
            a @ (terms @ _derivatives(c)) @ b,
        ])  # fmt: skip


def _derivatives(harmonics: FloatArray) -> FloatArray:
    """Return the derivatives of what `_harmonics` returns, from its values."""
    out = np.zeros_like(harmonics)
    k = np.arange(1, len(harmonics) // 2 + 1)
    out[1::2], out[2::2] = -k * harmonics[2::2], k * harmonics[1::2]
    return out


def _harmonics(angle: float, degree: int) -> FloatArray:
    """Return 1, cos a, sin a, cos 2a, ... at an angle, shape (2 degree + 1,)."""
    terms = [(cos(k * angle), sin(k * angle)) for k in range(1, degree + 1)]
    return np.array([1.0, *(term for pair in terms for term in pair)])
